"""The table of formats: every row's module does what the row promises, and other suffixes are refused."""

from __future__ import annotations

import re
import sys
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from conftest import random_clip

from signsplice import formats, lexicon
from signsplice.errors import FormatError, InputError
from signsplice.formats import (
    FORMATS,
    READ_SUFFIXES,
    WIRE_SUFFIXES,
    WRITE_SUFFIXES,
    FileFormat,
    ReadAs,
    encode,
    join_suffixes,
    load,
    parse,
    save,
)
from signsplice.motion import Clip


@pytest.mark.parametrize("suffix", READ_SUFFIXES)
def test_each_module_has_the_functions_of_its_row(suffix: str) -> None:
    row = FORMATS[suffix]
    module = import_module(f"{formats.__name__}.{row.module}")
    assert callable(module.parse)
    assert not row.writes or callable(module.encode)


def test_suffix_lists_follow_from_the_table() -> None:
    lists = (READ_SUFFIXES, WRITE_SUFFIXES, WIRE_SUFFIXES)
    for suffix, row in FORMATS.items():
        promised = [row.reads, row.writes, bool(row.media_type)]
        assert [suffix in suffixes for suffixes in lists] == promised
    for suffixes, shipped in zip(
        lists,
        ((".bvh", ".npz", ".glb", ".gltf", ".vrma"), (".bvh", ".npz", ".glb", ".vrma"), (".bvh", ".glb", ".vrma")),
        strict=True,
    ):
        assert [suffix for suffix in suffixes if suffix in shipped] == list(shipped), "in the table's order"


def test_the_documentation_lists_every_format() -> None:
    lines = (Path(__file__).parents[2] / "docs" / "formats.md").read_text().splitlines()
    rows = {line.split("`")[1]: line.split(" | ")[1:4] for line in lines if line.startswith(("| [`", "| `"))}
    for suffix in READ_SUFFIXES:
        yes = [suffix in suffixes for suffixes in (READ_SUFFIXES, WRITE_SUFFIXES, WIRE_SUFFIXES)]
        assert [cell.startswith("yes") for cell in rows[suffix]] == yes


@pytest.mark.parametrize("suffix", WRITE_SUFFIXES)
def test_every_written_format_is_read_back(suffix: str, tmp_path: Path) -> None:
    clip = random_clip(0, n_frames=4, n_joints=3)
    clip = replace(clip, skeleton=replace(clip.skeleton, roles={"hips": clip.skeleton.names[0]}))
    if suffix in (".smplx.npz", ".pose"):  # of persons alone
        with lexicon.open_shipped_lexicon() as words:
            clip = words.clip("HELLO")[:4]
    path = tmp_path / f"clip{suffix.upper()}"
    save(clip, path)
    assert path.read_bytes() == encode(clip, path.name)
    assert len(load(path)) == len(clip)
    if suffix in WIRE_SUFFIXES:
        assert len(parse(path.read_bytes(), path.name)) == len(clip)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("a.glb", "a.glb: no such file"),
        ("a.pose", "a.pose: no such file"),
        ("a.txt", "suffix .txt cannot be read"),
        ("a", r"suffix \(none\) cannot be read"),
        ("missing.bvh", "missing.bvh: no such file"),
    ],
)
def test_files_that_cannot_be_loaded_have_a_clear_error(name: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=message):
        load(tmp_path / name)


def test_other_suffixes_are_neither_written_nor_parsed(tmp_path: Path) -> None:
    clip = random_clip(0)
    with pytest.raises(
        InputError, match=rf"a\.gltf: .* cannot be written, expected {re.escape(join_suffixes(WRITE_SUFFIXES))}$"
    ):
        save(clip, tmp_path / "a.gltf")
    with pytest.raises(
        InputError, match=rf"a\.npz: .* cannot be taken, expected {re.escape(join_suffixes(WIRE_SUFFIXES))}$"
    ):
        parse(b"", "a.npz")
    assert not list(tmp_path.iterdir())


def test_a_clip_that_a_format_cannot_hold_is_refused_by_path(tmp_path: Path) -> None:
    clip = random_clip(0)
    unnamed = replace(clip.skeleton, names=(" ", *clip.skeleton.names[1:]))
    with pytest.raises(InputError, match=r"a\.bvh: joint name ' ' is empty"):
        save(replace(clip, skeleton=unnamed), tmp_path / "a.bvh")
    assert not list(tmp_path.iterdir())


def test_the_format_in_the_guide_for_contributors_works(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, words: dict[str, Clip]
) -> None:
    guide = (Path(__file__).parents[2] / "CONTRIBUTING.md").read_text()
    code = guide.split("# src/signsplice/formats/json_clip.py\n")[1].split("```")[0]
    module = ModuleType("signsplice.formats.json_clip")
    exec(code, module.__dict__)
    monkeypatch.setitem(sys.modules, module.__name__, module)
    monkeypatch.setitem(formats.FORMATS, ".jclip", FileFormat(".jclip", "json_clip"))
    for name in ("READ_SUFFIXES", "WRITE_SUFFIXES"):
        monkeypatch.setattr(formats, name, (*getattr(formats, name), ".jclip"))
    formats.save(words["SIGN"], tmp_path / "SIGN.jclip")
    read = formats.load(tmp_path / "SIGN.jclip")
    assert np.array_equal(read.local_rotations, words["SIGN"].local_rotations)
    (tmp_path / "broken.jclip").write_text("[1, 2]")
    with pytest.raises(FormatError, match=r"broken\.jclip: "):
        formats.load(tmp_path / "broken.jclip")


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"fps": 0.0}, "fps 0.0, expected frames a second"), ({"fps": "25"}, "fps '25', expected"),
        ({"face_fps": float("nan")}, "face_fps nan, expected"), ({"rest_frame": 1.5}, "rest_frame 1.5, expected"),
        ({"roles": "file.json"}, "roles 'file.json', expected role -> joint name"),
        ({"roles": {"nose": "x"}}, "nose"),
    ],
)  # fmt: skip
def test_how_a_file_is_read_must_make_sense(wrong: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError, match=re.escape(said)):
        ReadAs(**wrong)


def test_a_take_of_a_file_with_one_motion_is_said_not_to_be_used(words: dict[str, Clip], tmp_path: Path) -> None:
    save(words["I"], tmp_path / "I.bvh")
    clip = load(tmp_path / "I.bvh", read=ReadAs(take="Take 001"))
    assert clip.notes == (".bvh files have one motion: take 'Take 001' is not used",)
