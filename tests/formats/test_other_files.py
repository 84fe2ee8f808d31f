"""Archives, and files that are written whole or not at all."""

from __future__ import annotations

import json
import zipfile
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import random_clip

from broken_bvh import VALID
from signsplice.errors import FormatError, InputError
from signsplice.formats import atomic, bvh, encode, load, npz, save
from signsplice.motion import Clip
from signsplice.splicing.engine import SpliceOptions, splice


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


def test_quaternions_of_32_bits_are_unit_again_and_others_refused(words: dict[str, Clip]) -> None:
    clip = words["HELLO"]
    back = npz.parse(npz.encode(clip, rounded=True))
    np.testing.assert_allclose(np.linalg.norm(back.local_rotations, axis=-1), 1.0, atol=1e-12)
    np.testing.assert_allclose(back.local_rotations, clip.local_rotations, atol=3e-5)
    np.testing.assert_allclose(back.root_positions, clip.root_positions, atol=2.0**-17)
    assert np.array_equal(back.skeleton.offsets, clip.skeleton.offsets)
    with np.load(BytesIO(npz.encode(clip, rounded=True))) as stored:
        arrays = dict(stored)
    arrays["local_rotations"] = arrays["local_rotations"] * np.float32(1.001)
    longer = BytesIO()
    np.savez(longer, **arrays)
    with pytest.raises(InputError, match="expected unit quaternions"):
        npz.parse(longer.getvalue())


def test_foreign_archives_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "x.npz"
    np.savez(path, a=np.zeros(3))
    with pytest.raises(
        FormatError, match=r"x\.npz: is no valid \.npz file \(it is no clip that signsplice wrote, nor poses"
    ):
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


def changed_head(**changes: Any) -> Any:
    """A change of an archive's description."""

    def change(head: dict[str, Any], arrays: dict[str, Any]) -> None:
        head.update(changes)

    return change


def changed_array(name: str, change: Any) -> Any:
    """A change of one of an archive's arrays."""

    def apply(head: dict[str, Any], arrays: dict[str, Any]) -> None:
        arrays[name] = change(arrays[name])

    return apply


INVALID: dict[str, tuple[Any, str]] = {
    "head is a list": (lambda head, arrays: arrays.update(raw="[]"), "version None"),
    "head is nested deeply": (lambda head, arrays: arrays.update(raw="[" * 100_000), "it nests too deeply"),
    "another version": (changed_head(version=2), "version 2, expected 1"),
    "names are numbers": (changed_head(names=[1, 2]), "lists of joint names"),
    "a half character": (changed_head(names=["a\ud800", "b"]), "a joint name is no text"),
    "a long name": (changed_head(names=["a" * 301, "b"]), "at most 300 characters"),
    "names are equal": (changed_head(names=["a", "a"]), "'a' appears twice"),
    "the clip's name is a number": (changed_head(name=7), "its name is no text"),
    "fps is text": (changed_head(fps="30"), "fps '30', expected a number"),
    "fps is true": (changed_head(fps=True), "fps True, expected a number"),
    "fps is not finite": (changed_head(fps=float("nan")), "expected a positive number"),
    "roles are a list": (changed_head(roles=["hips"]), "roles, expected role -> joint name"),
    "a role is none": (changed_head(roles={"hips": None}), "roles, expected role -> joint name"),
    "a role is unknown": (changed_head(roles={"tail": "Hips"}), "tail"),
    "a role's joint is missing": (changed_head(roles={"hips": "gone"}), "no joint 'gone'"),
    "no such end joint": (changed_head(end_joints=[5]), "end site of joint 5"),
    "an end joint is true": (changed_head(end_joints=[True]), "lists of joint names and joint numbers"),
    "end joints are missing": (changed_head(end_joints=[]), "0 end sites with 1 offsets"),
    "channels of one joint": (changed_head(channels=[[*"ab"]]), "different channel names"),
    "a channel twice": (changed_head(channels=[["Xrotation"] * 2]), "different channel names"),
    "starts are empty": (changed_head(starts=[]), "starts: expected 0"),
    "starts fall": (changed_head(starts=[0, 1, 1]), "starts: expected 0"),
    "starts beyond": (changed_head(starts=[0, 2]), "starts: expected 0"),
    "frame time": (changed_head(frame_time="x"), "frame_time: expected seconds"),
    "frame time is infinite": (changed_head(frame_time=float("inf")), "at inf s a frame"),
    "complex rotations": (changed_array("local_rotations", lambda a: a + 0j), "holds complex128"),
    "text for offsets": (changed_array("offsets", lambda a: a.astype("U4")), "holds <U4"),
    "whole rotations": (changed_array("local_rotations", lambda a: a.astype("i8")), "holds int64"),
    "parents of numbers": (changed_array("parents", lambda a: a.astype(float)), "expected whole numbers"),
    "parents in a circle": (changed_array("parents", lambda a: a[::-1]), "expected the root first"),
    "flat offsets": (changed_array("offsets", np.ravel), "offsets has shape"),
    "two numbers an end": (changed_array("end_offsets", lambda a: a[:, :2]), "end site of joint 1 with offset"),
    "far away": (changed_array("root_positions", lambda a: a + 1e13), "a finite number below 1e"),
    "infinite channels": (changed_array("channel_values", lambda a: a / 0.0), "a number is infinite"),
    "channels of fewer joints": (changed_array("channel_offsets", lambda a: a[:1]), "channels of 2 joints"),
    "endless offsets": (changed_array("channel_offsets", lambda a: a * np.inf), "channel_offsets: not finite"),
    "other offsets": (
        changed_array("channel_offsets", lambda a: np.add(a, [[0.0], [1.0]])),
        "channel_offsets: .*others than",
    ),
    "fewer channels": (changed_array("channel_values", lambda a: a[:, 1:]), "channel values"),
    "no offsets": (lambda head, arrays: arrays.pop("offsets"), "it has no 'offsets'"),
    "no names and no parents": (
        lambda head, arrays: (head.pop("names"), arrays.pop("parents")),
        "it has no 'names'",
    ),
    "no numbers of channels": (lambda head, arrays: arrays.pop("channel_values"), "it has no 'channel_values'"),
    "no weights of a face": (changed_head(face=["jawOpen"]), "it has no 'face_weights'"),
    "roles are missing": (lambda head, arrays: head.pop("roles"), "it has no 'roles'"),
}


@pytest.mark.parametrize("what", INVALID)
@pytest.mark.filterwarnings("ignore:divide by zero", "ignore:invalid value")
def test_archives_are_checked_before_a_clip_is_made(what: str, tmp_path: Path) -> None:
    change, message = INVALID[what]
    with np.load(BytesIO(encode(bvh.parse(VALID.encode(), "a.bvh"), "a.npz"))) as stored:
        arrays = {name: stored[name] for name in stored.files}
    head = json.loads(str(arrays.pop("head")))
    change(head, arrays)
    np.savez(tmp_path / "a.npz", head=np.array(arrays.pop("raw", json.dumps(head))), **arrays)
    with pytest.raises(FormatError, match=message) as caught:
        load(tmp_path / "a.npz")
    assert str(caught.value).startswith(f"{tmp_path / 'a.npz'}: is no valid .npz file (")
    assert "\n" not in str(caught.value)


def test_archives_with_random_changes_are_refused_or_can_be_spliced(tmp_path: Path) -> None:
    """What is read can be spliced and written, whatever byte was changed, compressed or not."""
    rng = np.random.default_rng(0)
    content = BytesIO()
    with np.load(BytesIO(encode(bvh.parse(VALID.encode(), "a.bvh"), "a.npz"))) as stored:
        np.savez(content, **stored)
    whole = bytearray(content.getvalue())
    options = SpliceOptions(cutter="ends", transition="slerp", duration="fixed")
    refused = 0
    for _ in range(400):
        broken = bytearray(whole)
        for at in rng.integers(0, len(whole), rng.integers(1, 3)):
            broken[at] ^= 1 << rng.integers(8)
        (tmp_path / "a.npz").write_bytes(bytes(broken))
        try:
            clip = load(tmp_path / "a.npz")
        except FormatError:
            refused += 1
        else:
            encode(splice([clip, clip], options).clip, "a.npz")
    assert 200 < refused < 400


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
