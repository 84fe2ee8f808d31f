"""Lexicons of the synthetic signer: words as BVH with a table."""

from __future__ import annotations

import csv
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from signing import sign
from signsplice.errors import InputError
from signsplice.formats import load
from signsplice.motion import Clip, kinematics
from signsplice.signer import folders, planner
from signsplice.signer.phonology import Gesture, owned_channels
from signsplice.signer.signer import STANDARD, draw_signer

BVH_CM = 0.01
"""Error of positions by BVH's rounding, cm."""
SIGNS = tuple(sign(gloss) for gloss in ("I", "MOTHER", "BOOK", "YOU", "fs-A"))


def positions_of(clip: Clip) -> Any:
    return kinematics.forward(clip)[1]


# --- lexicons


@pytest.fixture(scope="module")
def lexicon(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("folders") / "lexicon"
    folders.write_lexicon(SIGNS, STANDARD, folder)
    return folder


def test_a_lexicon_has_a_file_for_every_word_and_a_table(lexicon: Path) -> None:
    assert {path.name for path in lexicon.iterdir()} == {f"{s.gloss}.bvh" for s in SIGNS} | {"glosses.csv"}
    rows = list(csv.DictReader((lexicon / "glosses.csv").read_text(encoding="utf-8").splitlines()))
    assert [row["gloss"] for row in rows] == [s.gloss for s in SIGNS]
    assert [row["kind"] for row in rows] == ["sign"] * 4 + ["letter"]
    assert {row["signer"] for row in rows} == {"standard"}
    assert {row["checked"] for row in rows} == {"no"}
    for row, one in zip(rows, SIGNS, strict=True):
        assert row["file"] == f"{one.gloss}.bvh"
        assert row["source"] == one.source
        assert row["synonyms"].split(";") == [*one.synonyms, *([""] * (not one.synonyms))]
    assert [row["owns"] for row in rows] == [
        *("right arm", "right arm", "left arm;right arm", "right arm", "right arm")
    ]


@pytest.mark.parametrize("gloss", ["I", "BOOK", "fs-A"])
def test_the_files_hold_the_planned_words(gloss: str, lexicon: Path) -> None:
    clip = load(lexicon / f"{gloss}.bvh")
    planned = planner.synthesize_word(sign(gloss)).clip
    assert len(clip) == len(planned)
    assert clip.fps == pytest.approx(30.0, abs=1e-3)
    assert clip.skeleton.names == planned.skeleton.names
    assert np.abs(positions_of(clip) - positions_of(planned)).max() < BVH_CM


def test_progress_is_reported_and_the_table_names_the_signer(tmp_path: Path) -> None:
    reported: list[tuple[int, int]] = []
    folders.write_lexicon(
        SIGNS[:2], draw_signer(3), tmp_path / "l", fps=24.0, progress=lambda done, of: reported.append((done, of))
    )
    assert reported == [(1, 2), (2, 2)]
    assert "signer-3" in (tmp_path / "l" / "glosses.csv").read_text()
    assert load(tmp_path / "l" / "I.bvh").fps == pytest.approx(24.0, abs=1e-3)


def test_a_sign_owns_the_strong_arm_a_weak_arm_that_it_needs_and_what_it_nods_or_leans() -> None:
    one, both = {"left arm"}, {"left arm", "right arm"}
    owned = {"I": one, "BOOK": both, "HOSPITAL": both, "NOT": one | {"head"}, "TIRED": both | {"trunk"}}
    left_handed = replace(STANDARD, left_handed=True)
    assert {gloss: owned_channels(sign(gloss), left_handed) for gloss in owned} == owned
    assert owned_channels(sign("I")) == {"right arm"}
    leaning = replace(sign("I"), gestures=(Gesture("trunk", (5.0, 0.0, 0.0)),))
    assert owned_channels(leaning) == {"right arm", "trunk"}


def test_glosses_become_names_that_file_systems_allow() -> None:
    assert folders.file_name("THANK-YOU") == "THANK-YOU"
    assert folders.file_name("a/b:c*?\x01") == "a_b_c___"
    assert folders.file_name("日本") == "日本"


def test_two_glosses_of_one_file_name_are_refused(tmp_path: Path) -> None:
    twice = [replace(SIGNS[0], gloss=gloss) for gloss in ("A/B", "A|B")]
    with pytest.raises(InputError, match=r"A/B and A\|B would both be A_B.bvh"):
        folders.write_lexicon(twice, STANDARD, tmp_path / "l")
    assert list(tmp_path.iterdir()) == []


def test_an_interrupted_call_leaves_no_part_of_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    old = tmp_path / "l"
    folders.write_lexicon(SIGNS[:1], STANDARD, old)
    before = {path.name: path.read_bytes() for path in old.iterdir()}
    real, calls = planner.synthesize_word, 0

    def failing(*arguments: Any, **named: Any) -> planner.IsolatedWord:
        nonlocal calls
        calls += 1
        if calls == 2:
            raise KeyboardInterrupt
        return real(*arguments, **named)

    monkeypatch.setattr(planner, "synthesize_word", failing)
    with pytest.raises(KeyboardInterrupt):
        folders.write_lexicon(SIGNS, STANDARD, old)
    assert [path.name for path in tmp_path.iterdir()] == ["l"]
    assert {path.name: path.read_bytes() for path in old.iterdir()} == before


def test_a_folder_of_something_else_stays_as_it_is(tmp_path: Path) -> None:
    mine = tmp_path / "mine"
    mine.mkdir()
    (mine / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match=r"mine: is there already and has no glosses\.csv"):
        folders.write_lexicon(SIGNS[:1], STANDARD, mine)
    assert [path.name for path in mine.iterdir()] == ["notes.txt"]


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_own_output_is_replaced(lexicon: Path, tmp_path: Path) -> None:
    for signer in (draw_signer(3), STANDARD):
        folders.write_lexicon(SIGNS[:2], signer, tmp_path / "l")
    folders.write_lexicon(SIGNS, STANDARD, tmp_path / "l")
    assert contents(tmp_path / "l") == contents(lexicon)


def test_own_output_without_the_newest_column_is_replaced(lexicon: Path, tmp_path: Path) -> None:
    shutil.copytree(lexicon, tmp_path / "l")
    lines = (lexicon / "glosses.csv").read_text(encoding="utf-8").splitlines()
    table = "".join(f"{line.rpartition(',')[0]}\n" for line in lines)
    (tmp_path / "l" / "glosses.csv").write_text(table, encoding="utf-8")
    folders.write_lexicon(SIGNS, STANDARD, tmp_path / "l")
    assert contents(tmp_path / "l") == contents(lexicon)


COLUMNS = "file,gloss,synonyms,signer,source,checked,kind\n"
RECORDED = {
    "only names": ("file,gloss\nHELLO.bvh,HELLO\n", "HELLO.bvh", "has other columns than a table of `synth lexicon`"),
    "empty": ("", "HELLO.bvh", "has other columns"),
    "a signer": (COLUMNS + "HELLO.bvh,HELLO,,Anna,,no,sign\n", "HELLO.bvh", "csv:2: is no word of `synth lexicon`"),
    "checked": (COLUMNS + "HELLO.bvh,HELLO,,standard,,yes,sign\n", "HELLO.bvh", "csv:2: is no word of"),
    "few cells": (COLUMNS + "HELLO.bvh,HELLO\n", "HELLO.bvh", "csv:2: is no word of"),
    "no table": (COLUMNS + '"HELLO', "HELLO.bvh", r"glosses\.csv: is no valid table of `synth lexicon`"),
    "another skeleton": (COLUMNS + "HELLO.bvh,HELLO,,standard,,no,sign\n", "HELLO.bvh", "is on another skeleton than"),
    "another file": (
        COLUMNS + "I.bvh,I,,standard,,no,sign\n",
        "notes.txt",
        r"holds notes\.txt beside its glosses\.csv",
    ),
    "a folder": (COLUMNS + "I.bvh,I,,standard,,no,sign\n", "more/HELLO.bvh", r"holds more beside its glosses\.csv"),
}


@pytest.mark.parametrize(("table", "file", "message"), RECORDED.values(), ids=RECORDED)
def test_own_recordings_beside_a_table_stay(table: str, file: str, message: str, tmp_path: Path) -> None:
    mine = tmp_path / "mine"
    (mine / file).parent.mkdir(parents=True)
    (mine / file).write_text("HIERARCHY\nROOT mixamorig:Hips\n")
    (mine / "glosses.csv").write_text(table)
    before = contents(mine)
    with pytest.raises(InputError, match=message):
        folders.write_lexicon(SIGNS[:1], STANDARD, mine)
    assert contents(mine) == before


def test_a_recording_in_the_place_of_a_synthetic_word_stays(lexicon: Path, tmp_path: Path) -> None:
    mine = tmp_path / "mine"
    shutil.copytree(lexicon, mine)
    (mine / "BOOK.bvh").write_text("HIERARCHY\nROOT Hips\n")
    before = contents(mine)
    with pytest.raises(InputError, match=r"BOOK\.bvh: is on another skeleton than signer standard"):
        folders.write_lexicon(SIGNS, STANDARD, mine)
    assert contents(mine) == before
