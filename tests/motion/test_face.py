"""Faces: what a clip does, its face does with it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from conftest import random_clip

from signsplice.errors import InputError
from signsplice.motion import concatenate, copy_unchecked, resample, sample_clip
from signsplice.motion.face import ARKIT_CHANNELS, PRESETS, VISEMES, Face, face_from, shape_of, target_weights
from signsplice_workshop.measure.faces import add_random_face, random_face


@pytest.mark.parametrize(
    ("channels", "weights", "expected"),
    [
        (("jawopen",), [[0.0]], "none of ARKit's"),
        (("jawOpen", "jawOpen"), [[0.0, 0.0]], "twice"),
        (("jawOpen",), [[0.0, 0.0]], r"\(1, 2\)"),
        (("jawOpen",), [[1.01]], "1.01 at frame 0"),
        (("jawOpen",), [[0.0], [np.nan]], "nan at frame 1"),
        ((), np.zeros((1, 0)), "0 coefficients"),
    ],
)
def test_a_face_that_is_none_is_refused(channels: tuple[str, ...], weights: object, expected: str) -> None:
    with pytest.raises(InputError, match=expected):
        Face(channels, np.array(weights))


def test_a_face_has_as_many_frames_as_its_clip() -> None:
    with pytest.raises(InputError, match="a face of 3 frames for 20 frames"):
        replace(random_clip(0), face=random_face(0, 3))
    clip = add_random_face(random_clip(0), 0)
    assert copy_unchecked(clip, local_rotations=clip.local_rotations[:5], root_positions=np.zeros((5, 3))).face is None


def test_slices_and_joins_keep_every_weight() -> None:
    clip = add_random_face(random_clip(0), 0)
    joined = concatenate([clip[:7], clip[7:8], clip[8:]])
    assert joined.face is not None
    assert clip.face is not None
    assert np.array_equal(joined.face.weights, clip.face.weights)


def test_a_part_without_a_face_is_at_rest_and_channels_are_joined_by_name() -> None:
    bare = random_clip(0)
    one, two = add_random_face(bare, 1, ("jawOpen",)), add_random_face(bare, 2, ("tongueOut", "browInnerUp"))
    face = concatenate([one, bare, two]).face
    assert face is not None
    assert face.channels == ("jawOpen", "browInnerUp", "tongueOut")
    assert not face[20:40].weights.any()
    assert not face.of(["jawOpen"])[20:].any()
    assert np.array_equal(face.of(["tongueOut", "browInnerUp"])[40:], two.face.weights)  # type: ignore[union-attr]
    assert concatenate([bare, bare]).face is None


def test_time_passes_for_a_face_as_for_the_body() -> None:
    clip = add_random_face(random_clip(0, 31), 0)
    twice, half = resample(clip, 60.0).face, resample(clip, 30.0, speed=2.0).face
    assert clip.face is not None
    assert twice is not None
    assert half is not None
    assert np.array_equal(twice.weights[::2], clip.face.weights)
    assert np.array_equal(half.weights, clip.face.weights[::2])
    assert np.allclose(twice.weights[1::2], 0.5 * (clip.face.weights[1:] + clip.face.weights[:-1]), atol=1e-15)
    warped = sample_clip(clip, np.array([0.0, 3.0, 3.25])).face
    assert warped is not None
    assert np.allclose(warped.weights[2], 0.75 * clip.face.weights[3] + 0.25 * clip.face.weights[4], atol=1e-15)


def test_in_the_mirror_left_is_right_and_twice_is_itself() -> None:
    face = random_face(3, 9)
    mirrored = face.mirror()
    for left, right in (("eyeLookInLeft", "eyeLookInRight"), ("jawLeft", "jawRight"), ("browInnerUp", "browInnerUp")):
        assert np.array_equal(mirrored.of([left]), face.of([right]))
    assert set(mirrored.channels) == set(ARKIT_CHANNELS)
    assert mirrored.mirror().channels == face.channels


@pytest.mark.parametrize(
    ("name", "channel"),
    [("eyeBlink_L", "eyeBlinkLeft"), ("Head.JawOpen", "jawOpen"), ("MOUTHSMILERIGHT", "mouthSmileRight"),
     ("mouthLeft", "mouthLeft"), ("jawLeft", "jawLeft"), ("browOuterUp_R", "browOuterUpRight")],
)  # fmt: skip
def test_targets_are_known_by_arkits_names_as_programs_write_them(name: str, channel: str) -> None:
    assert shape_of(name) == {channel: 1.0}


def test_visemes_and_presets_are_known_in_all_their_spellings() -> None:
    assert len(VISEMES) == 15
    for names in (("viseme_aa", "V_AA", "aa", "A", "Fcl_MTH_A"), ("blink", "Blink", "Fcl_EYE_Close")):
        assert len({tuple(sorted((shape_of(name) or {}).items())) for name in names}) == 1
    assert shape_of("hair_sway") is shape_of("A01") is None
    assert shape_of("neutral") == {}


def test_a_face_by_arkits_names_comes_back_exactly_whatever_stands_beside_them() -> None:
    face = random_face(0, 12)
    names = (*PRESETS, *ARKIT_CHANNELS)
    weights, lost = target_weights(face, names)
    again = face_from(names, weights)
    assert again is not None
    assert np.array_equal(again.of(ARKIT_CHANNELS), face.of(ARKIT_CHANNELS))
    assert not lost


def test_targets_that_show_a_viseme_alone_get_it_back_and_what_they_cannot_show_is_named() -> None:
    names = tuple(f"viseme_{name}" for name in VISEMES)
    shown = np.eye(len(names))[1:]  # each but silence alone
    face = face_from(names, shown)
    assert face is not None
    weights, lost = target_weights(face, names)
    assert np.abs(weights - shown).max() < 1e-9
    assert not lost
    raised = Face(("browInnerUp", "jawOpen"), np.array([[0.9, 0.5]]))
    assert target_weights(raised, names)[1] == ("browInnerUp",)


def test_no_emotion_is_made_of_a_smile() -> None:
    smile = Face(("mouthSmileLeft", "mouthSmileRight"), np.array([[0.8, 0.8]]))
    weights, lost = target_weights(smile, ("happy", "joy", "relaxed"))
    assert not weights.any()
    assert lost == ("mouthSmileLeft", "mouthSmileRight")
