"""Clips encoded as bytes: they come back within the stated tolerance, and damage is detected."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from conftest import random_clip
from hypothesis import given
from hypothesis import strategies as st

from signsplice.errors import InputError
from signsplice.lexicon.frames import FORMS, decode, encode
from signsplice.lexicon.gloss import Entry
from signsplice.motion import Clip, rotation
from signsplice.motion.face import ARKIT_CHANNELS
from signsplice_workshop.measure.faces import add_random_face


def entry_of(clip: Clip, n_frames: int) -> Entry:
    return Entry(clip.name, "sign", (), clip.fps, n_frames, "", "", False, None, None, "")


def round_trip(clip: Clip, form: str) -> Clip:
    entry = entry_of(clip, len(clip))
    return decode(encode(clip, form), form, clip.translations is not None, clip.skeleton, entry)


def with_constant(clip: Clip, joints: list[int]) -> Clip:
    """The clip with constant rotations of some joints."""
    rotations = clip.local_rotations.copy()
    rotations[:, joints] = rotations[:1, joints]
    return replace(clip, local_rotations=rotations)


@given(
    seed=st.integers(0, 1000),
    n_frames=st.integers(1, 40),
    form=st.sampled_from(FORMS),
    constant=st.lists(st.integers(0, 6), max_size=7, unique=True),
    bones_stretch=st.booleans(),
)
def test_clips_come_back_within_the_tolerance(
    seed: int, n_frames: int, form: str, constant: list[int], bones_stretch: bool
) -> None:
    clip = with_constant(random_clip(seed, n_frames, n_joints=7), constant)
    if bones_stretch:
        noise = np.random.default_rng(seed).normal(size=(n_frames, 7, 3))
        noise[:, constant] = 1.0
        clip = replace(clip, translations=clip.skeleton.offsets + noise)
    back = round_trip(clip, form)
    tolerance = 1e-4 if form == "int16" else 1e-6
    assert np.max(rotation.angle_between(clip.local_rotations, back.local_rotations)) < tolerance
    assert np.all(np.sum(clip.local_rotations * back.local_rotations, axis=-1) > 0.0), "quaternion signs are kept"
    assert np.allclose(back.root_positions, clip.root_positions, rtol=1e-7, atol=0.0)
    assert (back.fps, back.name) == (clip.fps, clip.name)
    assert (back.translations is None) == (clip.translations is None)
    if clip.translations is not None and back.translations is not None:
        assert np.allclose(back.translations, clip.translations, rtol=1e-7, atol=0.0)
    if constant:
        assert np.ptp(back.local_rotations[:, constant], axis=0).max() == 0.0


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("channels", [ARKIT_CHANNELS, ("jawOpen", "eyeBlinkLeft", "tongueOut")])
def test_a_face_comes_back_in_float32_and_a_clip_without_one_keeps_its_bytes(
    form: str, channels: tuple[str, ...]
) -> None:
    plain = random_clip(3, 17)
    clip = add_random_face(plain, 1, channels)
    face = round_trip(clip, form).face
    assert face is not None
    assert clip.face is not None
    assert face.channels == tuple(name for name in ARKIT_CHANNELS if name in channels)
    assert np.array_equal(face.of(channels), clip.face.weights.astype(np.float32))
    assert round_trip(plain, form).face is None
    assert encode(clip, form)[: len(encode(plain, form))] == encode(plain, form)
    again = replace(clip, face=round_trip(clip, form).face)
    assert encode(again, form) == encode(clip, form)


def test_damage_in_a_face_is_found() -> None:
    clip = add_random_face(random_clip(3, 17), 1, ("jawOpen",))
    block, at = encode(clip, "float32"), len(encode(replace(clip, face=None), "float32"))
    wrong = [block[: at + 8], block + b"\0" * 8, block[:at] + b"\xff" * 8 + block[at + 8 :]]
    wrong += [block[:at] + bytes(8) + block[at + 8 :], block[: at + 8] + b"\x00\x00\x40\x40" + block[at + 12 :]]
    for damaged in wrong:
        with pytest.raises(InputError):
            decode(damaged, "float32", False, clip.skeleton, entry_of(clip, 17))


def test_compact_rotations_are_within_the_tolerance() -> None:
    rng = np.random.default_rng(1)
    q = rng.normal(size=(4000, 1, 4))
    q /= np.linalg.norm(q, axis=-1, keepdims=True)
    clip = random_clip(0, n_frames=1, n_joints=1)
    clip = replace(clip, local_rotations=q, root_positions=np.zeros((4000, 3)))
    assert np.max(rotation.angle_between(q, round_trip(clip, "int16").local_rotations)) < 1e-4


def test_constant_values_take_almost_no_space() -> None:
    clip = random_clip(0, n_frames=100, n_joints=20)
    quiet = with_constant(replace(clip, root_positions=np.zeros((100, 3))), list(range(2, 20)))
    assert len(encode(quiet, "float32")) < 0.15 * len(encode(clip, "float32"))
    assert len(encode(clip, "int16")) < 0.6 * len(encode(clip, "float32"))


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize(
    ("n_frames", "n_joints", "change"),
    [
        (21, 12, lambda b: b),  # the index counts other frames
        (19, 12, lambda b: b),
        (20, 11, lambda b: b),
        (20, 12, lambda b: b""),
        (20, 12, lambda b: b[:5]),
        (20, 12, lambda b: b[:-8]),
        (20, 12, lambda b: b + bytes(8)),
        (20, 12, lambda b: b"\7" + b[1:]),
        (20, 12, lambda b: b[:64] + b"\xff" * 16 + b[80:]),
        (20, 12, lambda b: b[:16] + bytes(len(b) - 16)),
    ],
)
def test_damaged_bytes_are_refused(form: str, n_frames: int, n_joints: int, change: object) -> None:
    assert callable(change)
    clip = random_clip(0)
    block = change(encode(clip, form))
    skeleton = clip.skeleton if n_joints == 12 else random_clip(0, n_joints=n_joints).skeleton
    with pytest.raises(InputError):
        decode(block, form, False, skeleton, entry_of(clip, n_frames))
