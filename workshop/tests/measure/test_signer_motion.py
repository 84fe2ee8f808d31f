"""How a signer moves: measured on motions whose answer is known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from signing import mirror, word
from signsplice.motion import Clip, FloatArray, kinematics, rotation
from signsplice.signer import pose
from signsplice.signer.locations import resting
from signsplice.signer.signer import JOINTS, STANDARD
from signsplice_workshop.measure.corpus_realism import find_half_change, find_reaches, signer_motion
from signsplice_workshop.measure.hands import busier_side, hand_likeness

FPS = 30.0


def moved(weak: Callable[[FloatArray], FloatArray]) -> Clip:
    """Both hands before the chest, going out and back together; ``weak`` makes the weak wrists from the strong ones."""
    state = np.tile(resting(STANDARD), (60, 1))
    t = np.arange(60) / FPS
    wrist = np.array([-20.0, -12.0, 25.0]) + np.outer(np.sin(2.0 * np.pi * 0.7 * t), [-8.0, 3.0, 0.0])
    state[:, 0:3], state[:, 27:30] = wrist, weak(wrist)
    state[:, 30:33] = state[:, 3:6]
    return pose.clip(state, STANDARD, FPS)


def test_joints_turn_at_the_speed_that_was_set() -> None:
    """30 degrees a second about one axis, on top of a sign; relative to the parent, so that the hand does not count the
    upper arm's turn.
    """
    clip = word("MOTHER").clip
    turn = rotation.exp(np.deg2rad(30.0) / clip.fps * np.arange(len(clip))[:, None] * [0.0, 1.0, 0.0])
    local = np.array(clip.local_rotations)
    local[:, JOINTS["RightArm"]] = turn
    local[:, JOINTS["RightHand"]] = rotation.IDENTITY
    motion = signer_motion([replace(clip, local_rotations=local)], "right")
    assert motion.angular_deg["UpperArm"] == pytest.approx(30.0)
    assert motion.angular_deg["Hand"] == pytest.approx(0.0, abs=1e-6)
    assert len(motion.speed) == len(motion.abduction_deg) == len(motion.wrist_bend_deg)
    assert 10 < len(motion.speed) < len(clip), "rests do not count"


def test_the_strong_side_is_the_one_that_is_measured() -> None:
    clip = word("MOTHER").clip
    rotations, roots = mirror(clip)
    left_handed = replace(clip, local_rotations=rotations, root_positions=roots)
    assert (busier_side(clip), busier_side(left_handed)) == ("right", "left")
    one, other = signer_motion([clip], "right"), signer_motion([left_handed], "left")
    for field in ("speed", "abduction_deg", "wrist_bend_deg"):
        assert np.allclose(getattr(one, field), getattr(other, field), atol=1e-3), field
    wrong = signer_motion([clip], "left")
    assert np.median(wrong.speed) < 0.3 * np.median(one.speed)


def test_speed_is_in_arm_lengths() -> None:
    clip = word("MOTHER").clip
    _, positions = kinematics.forward(clip, [JOINTS["RightHand"]])
    fastest = np.linalg.norm(np.diff(positions[:, 0], axis=0), axis=-1).max() * clip.fps / 55.0
    assert signer_motion([clip], "right").speed.max() == pytest.approx(fastest)


def test_hands_that_mirror_each_other_are_no_distance_apart() -> None:
    motion = hand_likeness([moved(lambda wrist: wrist)])
    assert len(motion.cm) > 30
    assert motion.cm.max() < 1e-3
    assert motion.lag == pytest.approx(0.0, abs=0.1)


def test_hands_that_differ_in_place_and_time_are_measured_so() -> None:
    lower = hand_likeness([moved(lambda wrist: wrist - np.array([0.0, 2.0, 0.0]))])
    assert np.median(lower.cm) == pytest.approx(2.0, abs=0.1)
    late = hand_likeness([moved(lambda wrist: np.roll(wrist, 2, axis=0))])
    assert np.median(late.lag) == pytest.approx(2.0, abs=0.3)
    still = hand_likeness([moved(lambda wrist: np.broadcast_to(wrist[0], wrist.shape))])
    assert len(still.cm) == len(still.lag) == 0
    told = hand_likeness([moved(lambda wrist: np.broadcast_to(wrist[0], wrist.shape))], [[(10, 30)]])
    assert (len(told.cm), len(told.lag)) == (21, 0), "stretches that are told count as they are"
    assert told.cm.max() > 8.0


def test_the_upper_arm_hangs_at_no_angle_and_is_level_at_ninety() -> None:
    clip = word("MOTHER").clip
    local = np.array(clip.local_rotations)
    local[:, JOINTS["RightShoulder"]] = rotation.IDENTITY
    local[:, JOINTS["RightArm"]] = rotation.IDENTITY  # the rest pose is a T-pose
    assert signer_motion([replace(clip, local_rotations=local)], "right").abduction_deg == pytest.approx(90.0, abs=3.0)


def test_a_reach_lies_between_two_minima_and_is_fast() -> None:
    speed = np.array([0.3, 0.1, 0.4, 0.9, 0.8, 0.2, 0.3, 0.4, 0.3, 0.1, 0.2, 0.05, 0.6])
    assert find_reaches(speed) == [(1, 5)]
    assert find_reaches(speed[:2]) == []


def test_a_finger_is_half_formed_where_half_of_its_way_is_done() -> None:
    linear = np.outer(np.arange(11.0), [4.0, 0.0, 3.0])
    assert find_half_change(linear) == pytest.approx(0.5)
    early = np.array([[0.0], [10.0], [30.0], [40.0], [40.0]])
    assert find_half_change(early) == pytest.approx(1.5 / 4.0)
    assert find_half_change(0.3 * linear) is None, "15 degrees are no change of handshape"


def test_a_clip_without_motion_has_no_figures() -> None:
    still = word("MOTHER").clip[:3]
    motion = signer_motion([still], "right")
    assert all(len(getattr(motion, field)) == 0 for field in ("speed", "abduction_deg", "forming"))
