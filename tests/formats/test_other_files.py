"""Archives, and files that are written whole or not at all."""

from __future__ import annotations

import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from conftest import random_clip
from signsplice.errors import FormatError, InputError
from signsplice.formats import atomic, bvh, load, save


def test_archives_keep_everything(tmp_path: Path) -> None:
    save(random_clip(1), tmp_path / "a.bvh")
    for clip in (random_clip(1), load(tmp_path / "a.bvh")):
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
    with pytest.raises(FormatError, match=r"x\.npz: is no valid \.npz file \(it is no clip that signsplice wrote\)"):
        load(path)
    path.write_bytes(b"not a zip at all")
    with pytest.raises(FormatError, match=r"is no valid \.npz file"):
        load(path)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as bomb:
        bomb.writestr("head.npy", bytes(100 << 20))
    with pytest.raises(FormatError, match="far more than a clip"):
        load(path)
    np.savez(path, head=np.array([object()], dtype=object))
    with pytest.raises(FormatError, match=r"is no valid \.npz file"):
        load(path)


def test_archives_with_invalid_arrays_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "x.npz"
    save(random_clip(0), path)
    with np.load(path) as stored:
        arrays = {key: stored[key] for key in stored.files}
    arrays["local_rotations"] = np.full_like(arrays["local_rotations"], np.nan)
    np.savez(path, **arrays)
    with pytest.raises(FormatError, match="expected unit quaternions"):
        load(path)


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
