"""Number parsing, archives, and files that are written whole or not at all."""

from __future__ import annotations

import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from conftest import random_clip
from signsplice.errors import FormatError, InputError
from signsplice.formats import atomic, bvh, load, npz, save
from signsplice.formats.numbers import parse_plain

plain_decimals = st.from_regex(r"[+-]?([0-9]{1,8}(\.[0-9]{0,7})?|\.[0-9]{1,8})", fullmatch=True)


@given(st.lists(plain_decimals, min_size=1, max_size=50), st.sampled_from([" ", "\n", "\t", " \n "]))
def test_plain_numbers_are_parsed_as_float_does(tokens: list[str], between: str) -> None:
    values = parse_plain(between.join(tokens).encode())
    wanted = np.array([float(token) for token in tokens])
    assert values is not None
    assert np.array_equal(values, wanted)
    assert np.array_equal(np.signbit(values), np.signbit(wanted))


@pytest.mark.parametrize(
    "text", ["1e5", "1..2", "1-2", "--1", "-", ".", "1.2.3", "nan", "1,2", "+-3", "1 2 -", "123456789", "1_0"]
)
def test_other_text_is_left_to_the_slower_parser(text: str) -> None:
    assert parse_plain(text.encode()) is None


def test_long_texts_are_parsed_in_blocks() -> None:
    rng = np.random.default_rng(0)
    numbers = np.round(rng.uniform(-200.0, 200.0, 60_000), 6)
    text = "\n".join(" ".join(f"{x:.6f}" for x in row) for row in numbers.reshape(-1, 60))
    values = parse_plain(text.encode())
    assert values is not None
    assert np.array_equal(values, numbers)
    one_line = parse_plain(text.replace("\n", " ").encode())
    assert one_line is not None
    assert np.array_equal(one_line, numbers)


def test_archives_keep_everything(tmp_path: Path) -> None:
    save(random_clip(1), tmp_path / "a.bvh")
    for clip in (random_clip(1), bvh.read(tmp_path / "a.bvh")):
        save(clip, tmp_path / "a.npz")
        again = load(tmp_path / "a.npz")
        assert np.array_equal(again.local_rotations, clip.local_rotations)
        assert np.array_equal(again.root_positions, clip.root_positions)
        assert again.skeleton.names == clip.skeleton.names
        assert (again.fps, again.name) == (clip.fps, clip.name)
        assert len(again.skeleton.end_sites) == len(clip.skeleton.end_sites)
        assert bvh.encode(again) == bvh.encode(clip)
    named = replace(random_clip(1), skeleton=replace(random_clip(1).skeleton, roles={"hips": "joint0"}))
    save(named, tmp_path / "a.npz")
    assert load(tmp_path / "a.npz").skeleton.roles == {"hips": "joint0"}


def test_foreign_archives_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "x.npz"
    np.savez(path, a=np.zeros(3))
    with pytest.raises(FormatError, match=r"x\.npz: is not a clip that signsplice wrote"):
        npz.read(path)
    path.write_bytes(b"not a zip at all")
    with pytest.raises(FormatError, match="is not a clip"):
        npz.read(path)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as bomb:
        bomb.writestr("head.npy", bytes(100 << 20))
    with pytest.raises(FormatError, match="far more than a clip"):
        npz.read(path)
    np.savez(path, head=np.array([object()], dtype=object))
    with pytest.raises(FormatError, match="is not a clip"):
        npz.read(path)


def test_archives_with_invalid_arrays_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "x.npz"
    save(random_clip(0), path)
    with np.load(path) as stored:
        arrays = {key: stored[key] for key in stored.files}
    arrays["local_rotations"] = np.full_like(arrays["local_rotations"], np.nan)
    np.savez(path, **arrays)
    with pytest.raises(FormatError, match="holds no valid clip"):
        npz.read(path)


def test_folders_are_refused_where_a_file_is_expected(tmp_path: Path) -> None:
    (tmp_path / "d.bvh").mkdir()
    with pytest.raises(InputError, match="is a folder"):
        load(tmp_path / "d.bvh")
    with pytest.raises(InputError, match="is a folder"):
        save(random_clip(0), tmp_path / "d.bvh")
    with pytest.raises(InputError, match="does not exist"):
        save(random_clip(0), tmp_path / "no" / "where.bvh")


def _write_half(path: Path, failure: type[BaseException]) -> None:
    with atomic.replacing(path) as temporary:
        temporary.write_text("half")
        raise failure


def test_a_failed_write_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "out.bvh"
    path.write_text("precious")
    for failure in (RuntimeError, KeyboardInterrupt):
        with pytest.raises(failure):
            _write_half(path, failure)
    assert path.read_text() == "precious"
    assert [p.name for p in tmp_path.iterdir()] == ["out.bvh"]
    with atomic.replacing(path) as temporary:
        temporary.write_text("whole")
    assert path.read_text() == "whole"
