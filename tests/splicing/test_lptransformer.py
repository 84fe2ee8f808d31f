"""LpTransformer and LPT+ as they ship: any rig, bones kept, by name everywhere."""

from __future__ import annotations

import numpy as np
import pytest

import signsplice as ss
from other_rigs import on_other_rig, without
from signing import word
from signsplice.errors import InputError
from signsplice.motion import Clip, kinematics, rotation
from signsplice.rig.info import canonical_motion
from signsplice.signer.signer import JOINTS
from signsplice.splicing import options as methods
from signsplice.splicing.bundle import BUNDLE_FILE, WEIGHTS, Sessions, config_of
from signsplice.splicing.lptransformer import (
    SHIPPED,
    LpTransformer,
    cull,
    numbers_of,
    on_standard_body,
    open_system,
    positions_of,
    rig_clip,
    splice_positions,
)

BEFORE, AFTER = word("MOTHER").clip, word("BOOK").clip
TURN = rotation.exp(np.array([0.3, -1.1, 0.4]))


def turned(a: Clip, b: Clip) -> float:
    """Largest angle, radians, between canonical rotations of two clips."""
    return float(rotation.angle_between(canonical_motion(a).quats, canonical_motion(b).quats).max())


def test_the_standard_body_shows_the_arms_of_a_clip() -> None:
    body = on_standard_body(BEFORE)
    assert turned(body, BEFORE) < 1e-6
    seen = kinematics.forward(body)[1], kinematics.forward(BEFORE)[1]
    hand = JOINTS["RightHandIndex3"]
    travelled, true = (positions[:, hand] - positions[:, 0] for positions in seen)
    assert np.abs(travelled - true).max() < 0.5, "cm; the words' hips sway"


@pytest.mark.parametrize("scale", [0.01, 1.0, 3.0])
def test_another_rig_gives_the_same_numbers(scale: float) -> None:
    other = on_other_rig(BEFORE, TURN, scale)
    np.testing.assert_allclose(numbers_of(on_standard_body(other)), numbers_of(on_standard_body(BEFORE)), atol=1e-6)


def test_numbers_become_positions_again() -> None:
    body = on_standard_body(BEFORE)
    positions = positions_of(numbers_of(body))
    np.testing.assert_allclose(positions, kinematics.forward(body)[1], atol=1e-9)
    assert np.abs(numbers_of(body)).max() < 0.5


def test_frames_of_the_standard_body_return_to_the_rig() -> None:
    other = on_other_rig(BEFORE, TURN, 1.0)
    returned = rig_clip(on_standard_body(other)[20:30], other[:20], other[30:])
    assert turned(returned, other[20:30]) < 1e-6


@pytest.mark.parametrize("name", SHIPPED)
def test_what_ships_splices_words_of_any_rig_alike(name: str) -> None:
    options = ss.SpliceOptions(system=name)
    here = ss.splice([BEFORE, AFTER], options)
    there = ss.splice([on_other_rig(clip, TURN, 0.01) for clip in (BEFORE, AFTER)], options)
    (seam,), (other,) = here.seams, there.seams
    assert (seam.pre_frame, seam.post_frame, seam.n_transition) == (
        other.pre_frame,
        other.post_frame,
        other.n_transition,
    )
    assert seam.n_transition > 0
    assert turned(there.clip, here.clip) < 1e-4
    assert here.system is not None
    assert here.system["name"] == name


@pytest.mark.parametrize("name", SHIPPED)
def test_no_bone_changes_its_length_and_a_rig_may_lack_fingers(name: str) -> None:
    plain = [without(clip, "Thumb", "Index", "Middle", "Ring", "Pinky") for clip in (BEFORE, AFTER)]
    made = ss.splice(plain, ss.SpliceOptions(system=name)).clip
    positions = kinematics.forward(made)[1]
    bones = np.linalg.norm(positions[:, 1:] - positions[:, made.skeleton.parents[1:]], axis=-1)
    np.testing.assert_allclose(bones, np.broadcast_to(bones[:1], bones.shape), rtol=1e-9)


def test_a_stream_of_two_words_at_a_time_gives_the_same_frames() -> None:
    words, options = [BEFORE, AFTER, BEFORE], ss.SpliceOptions(system="lpt-plus")
    pieces = list(ss.stream(words, options))
    np.testing.assert_array_equal(
        np.concatenate([piece.clip.local_rotations for piece in pieces]),
        ss.splice(words, options).clip.local_rotations,
    )


def test_letters_of_a_spelled_word_are_joined_as_letters() -> None:
    words = ss.open_lexicon()
    letters = [words.clip("fs-A"), words.clip("fs-N")]
    (seam,) = ss.splice(letters, ss.SpliceOptions(system="lpt-plus")).seams
    (plain,) = ss.splice(letters, ss.SpliceOptions()).seams
    assert (seam.pre_frame, seam.post_frame) == (plain.pre_frame, plain.post_frame)


def test_systems_are_among_the_methods() -> None:
    listed = [(method.name, default) for kind, method, default in methods.all_methods() if kind == "system"]
    assert listed == [("lptransformer", False), ("lpt-plus", False)]
    assert open_system("lpt-plus") is open_system("lpt-plus"), "opened once"
    with pytest.raises(InputError, match="is no trained system; those that ship: lptransformer, lpt-plus"):
        ss.SpliceOptions(system="lptransforme")
    with pytest.raises(InputError, match=r"give it as SpliceOptions\.bundle"):
        ss.SpliceOptions(system=str(WEIGHTS))


def test_positions_are_where_a_token_wins() -> None:
    logits = np.zeros((9, 3), np.float32)
    logits[:, 0] = 1.0
    assert splice_positions(logits, 5) == (None, None)
    logits[2, 1] = logits[7, 2] = 3.0
    assert splice_positions(logits, 5) == (2, 2)


def test_culling_keeps_frames_beside_the_positions_and_repeats_edges() -> None:
    before, after = np.arange(6.0)[:, None], 10.0 + np.arange(4.0)[:, None]
    rows, real = cull(before, after, 1, 2, 3)
    assert rows[:, 0].tolist() == [0.0, 0.0, 1.0, 12.0, 13.0, 13.0]
    assert real.tolist() == [False, True, True, True, True, False]
    for pre, post, fr in ((6, 0, 3), (0, 4, 3), (0, 0, 0)):
        with pytest.raises(InputError):
            cull(before, after, pre, post, fr)


def test_a_bundle_without_a_rate_or_a_longest_transition_is_refused() -> None:
    system = open_system("lpt-plus")
    assert isinstance(system, LpTransformer)
    stored = {key: value for key, value in system.graphs.config.stored.items() if key != "fps"}
    with pytest.raises(InputError, match="fps"):
        LpTransformer(Sessions(WEIGHTS, config_of(stored, WEIGHTS / BUNDLE_FILE)))
    stored = dict(system.graphs.config.stored)
    stored["runs"] = {key: value for key, value in stored["runs"].items() if key != "most_frames"}
    with pytest.raises(InputError, match=r"bundle\.json: .* \(it has no 'most_frames'\); export the system anew$"):
        LpTransformer(Sessions(WEIGHTS, config_of(stored, WEIGHTS / BUNDLE_FILE)))
