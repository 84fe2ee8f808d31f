"""splicing.collision_avoidance: transitions that lead a hand into the body are led around it, and no others change."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from conftest import random_clip

import signsplice as ss
from other_rigs import mirror, on_other_rig, with_rest_pose, without
from signing import word
from signsplice.body import collision
from signsplice.body.arm_ik import move_wrists
from signsplice.body.capsules import body_capsules, capsule_ends
from signsplice.motion import Clip, concatenate, kinematics, rotation
from signsplice.rig.info import rig_info
from signsplice.splicing.collisions import TOLERANCE_M, avoid_collisions, turn_elbow
from signsplice.splicing.contracts import Gap
from signsplice.splicing.curves import find_transition
from signsplice_workshop.measure.collisions import hand_penetration

CM = 0.01
ASIDE = (-25.0, -25.0, 25.0)
"""A position of the right wrist that is away from everything, as in ``held``."""


def held(left: tuple[float, float, float], right: tuple[float, float, float], n_frames: int = 8) -> Clip:
    """A still clip with both wrists at positions from the middle between the shoulders, cm: left, up, forward."""
    still = concatenate([word("SIGN").clip[:1]] * n_frames)
    joints = rig_info(still.skeleton).arm_joints
    for _ in range(3):
        _, positions = kinematics.forward(still, joints)
        middle = 0.5 * (positions[:, 0] + positions[:, 3])
        moves = np.stack([middle + left - positions[:, 2], middle + right - positions[:, 5]], axis=1)
        still = move_wrists(still, moves)
    return still


@cache
def poses_around(obstacle: str) -> tuple[Clip, Clip]:
    """Two held poses; on a straight line between them a hand goes through the obstacle."""
    ends = {
        "the head": (((-14.0, 18.0, 19.0), ASIDE), ((28.0, -8.0, -2.0), ASIDE)),
        "the trunk": (((-6.0, 1.0, 15.0), ASIDE), ((28.0, -14.0, -4.0), ASIDE)),
        "the other hand": (((16.0, -15.0, 30.0), (-16.0, -16.0, 30.0)), ((-14.0, -15.0, 30.0), (14.0, -16.0, 30.0))),
    }
    first, second = ends[obstacle]
    return held(*first), held(*second)


def deepest(clip: Clip) -> float:
    """Depth of the deepest hand, cm."""
    depth, _ = hand_penetration(clip.skeleton, *kinematics.forward(clip))
    return float(depth.max())


def wrists(clip: Clip) -> np.ndarray:
    """Positions (T, 2, 3) of both wrists."""
    return kinematics.forward(clip, [rig_info(clip.skeleton).arm_joints[n] for n in (2, 5)])[1]


@pytest.mark.parametrize("transition", ["slerp", "hermite", "minimum-jerk"])
@pytest.mark.parametrize("obstacle", ["the head", "the trunk", "the other hand"])
def test_hands_are_led_around_obstacles(obstacle: str, transition: str) -> None:
    before, after = poses_around(obstacle)
    assert max(deepest(before), deepest(after)) * CM < TOLERANCE_M, "no collision in the signs themselves"
    straight = find_transition(transition).between(Gap(before, after, 14))
    assert deepest(straight) > 2.0, f"a straight path goes through {obstacle}"
    cleared = avoid_collisions(straight, before, after)
    assert cleared.depth_before == pytest.approx(deepest(straight) * CM)
    assert deepest(cleared.clip) * CM <= TOLERANCE_M + 1e-9
    assert cleared.depth == 0.0
    steps = np.linalg.norm(np.diff(wrists(concatenate([before[-1:], cleared.clip, after[:1]])), axis=0), axis=-1)
    longest = np.linalg.norm(np.diff(wrists(concatenate([before[-1:], straight, after[:1]])), axis=0), axis=-1).max()
    assert steps.max() < 2.75 * longest, "no step is a leap"


def test_a_transition_in_the_open_is_left_as_it_is() -> None:
    pair = poses_in_the_open()
    straight = find_transition("hermite").between(Gap(*pair, 10))
    cleared = avoid_collisions(straight, *pair)
    assert cleared.clip is straight
    assert cleared.depth_before == cleared.depth == 0.0


def poses_in_the_open() -> tuple[Clip, Clip]:
    """Two held poses with nothing between them."""
    return held((26.0, -12.0, 30.0), (-26.0, -12.0, 30.0)), held((28.0, -4.0, 32.0), (-24.0, -8.0, 31.0))


def test_only_arms_change_and_hands_keep_their_rotation() -> None:
    before, after = poses_around("the head")
    straight = find_transition("hermite").between(Gap(before, after, 12))
    cleared = avoid_collisions(straight, before, after).clip
    changed = np.abs(cleared.local_rotations - straight.local_rotations).max(axis=(0, 2)) > 1e-12
    names = {cleared.skeleton.names[j] for j in np.flatnonzero(changed)}
    assert names
    assert {n.split(":")[-1] for n in names} <= {
        side + part for side in ("Left", "Right") for part in ("Arm", "ForeArm", "Hand")
    }
    np.testing.assert_array_equal(cleared.root_positions, straight.root_positions)
    hand = rig_info(cleared.skeleton).arm_joints[2]
    rotations, expected = (kinematics.forward(clip, [hand])[0] for clip in (cleared, straight))
    np.testing.assert_allclose(rotations, expected, atol=1e-9)


def test_with_one_arm_fixed_the_other_hand_alone_is_led_around_all_of_it() -> None:
    """The left hand goes down through the right forearm, which lies across."""
    right = (4.0, -22.0, 24.0)
    before, after = held((14.0, -6.0, 24.0), right), held((6.0, -42.0, 20.0), right)
    straight = find_transition("minimum-jerk").between(Gap(before, after, 16))
    cleared = avoid_collisions(straight, before, after, fixed=1)
    assert cleared.depth_before is not None
    assert cleared.depth_before > 0.01
    assert cleared.depth == 0.0
    moved = np.abs(wrists(cleared.clip) - wrists(straight)).max(axis=(0, 2))
    assert moved[0] > 1.0
    assert moved[1] == 0.0


def test_an_elbow_turns_out_of_the_trunk_and_the_hands_stay() -> None:
    before, after = held((10.0, -30.0, 22.0), ASIDE), held((12.0, -32.0, 22.0), ASIDE)
    straight = find_transition("minimum-jerk").between(Gap(before, after, 20))
    joint = rig_info(straight.skeleton).arm_joints[0]
    inwards = np.zeros((20, 2))
    inwards[:, 0] = 0.6 * np.sin(np.linspace(0.0, np.pi, 20))
    turned = max(
        (move_wrists(straight, np.zeros((20, 2, 3)), side * inwards) for side in (1.0, -1.0)),
        key=lambda clip: _forearm_depth(clip),
    )
    cleared = turn_elbow(turned, before, after, 0)
    assert _forearm_depth(turned) > 1.0
    assert _forearm_depth(cleared) < 0.5 * _forearm_depth(turned)
    np.testing.assert_allclose(wrists(cleared), wrists(turned), atol=1e-6)
    assert joint in np.flatnonzero(np.abs(cleared.local_rotations - turned.local_rotations).max(axis=(0, 2)) > 1e-6)


def _forearm_depth(clip: Clip) -> float:
    """Depth of the left forearm in the trunk beyond that of the first and the last frame, cm."""
    posed = collision.pose_capsules(clip.skeleton, *kinematics.forward(clip))
    body = posed.body
    own = [n for n, part in enumerate(body.parts) if part == "cuff" and body.sides[n] == "left"]
    depth = collision.overlap(posed.starts, posed.ends, body.radii, own, body.groups.trunk)[0].max(axis=(1, 2))
    return float(depth.max() - max(depth[0], depth[-1], 0.0))


def test_next_to_both_signs_the_path_hardly_changes() -> None:
    before, after = poses_around("the head")
    straight = find_transition("hermite").between(Gap(before, after, 20))
    moves = np.linalg.norm(wrists(avoid_collisions(straight, before, after).clip) - wrists(straight), axis=-1)
    largest = moves.max(axis=1)
    assert max(largest[0], largest[-1]) < 0.03 * largest.max()
    assert max(largest[1], largest[-2]) < 0.2 * largest.max()


def test_a_transition_without_a_collision_is_returned_unchanged() -> None:
    before, after = held((22.0, -15.0, 30.0), (-22.0, -15.0, 30.0)), held((22.0, 0.0, 30.0), (-22.0, 0.0, 30.0))
    straight = find_transition("hermite").between(Gap(before, after, 10))
    cleared = avoid_collisions(straight, before, after)
    assert cleared.clip is straight
    assert (cleared.depth_before, cleared.depth) == (0.0, 0.0)


def test_a_transition_may_be_as_deep_as_its_ends() -> None:
    """Both signs press the hand deep into the face: the frames between may too, and do not leave it at once."""
    before = held((-2.0, 18.0, 6.0), ASIDE)
    after = held((-1.0, 17.0, 6.5), ASIDE)
    assert min(deepest(before), deepest(after)) > 1.0
    straight = find_transition("slerp").between(Gap(before, after, 8))
    cleared = avoid_collisions(straight, before, after)
    assert cleared.depth == 0.0
    assert np.abs(wrists(cleared.clip) - wrists(straight)).max() < 0.5


def hand_gap(clip: Clip) -> np.ndarray:
    """Skin distance (T,) of the two hands, cm; negative inside."""
    body = body_capsules(clip.skeleton)
    starts, ends = capsule_ends(body, *kinematics.forward(clip))
    depth, _ = collision.overlap(starts, ends, body.radii, body.groups.left, body.groups.right)
    return np.asarray(-depth.max(axis=(1, 2)))


def bent(clip: Clip, amount: float) -> Clip:
    """The clip with the hands moved toward one another by ``amount`` cm each in its middle, away from its ends."""
    share = np.sin(np.linspace(0.0, np.pi, len(clip) + 2)[1:-1]) ** 2
    left, right = wrists(clip).swapaxes(0, 1)
    across = (right - left) / np.linalg.norm(right - left, axis=-1, keepdims=True)
    return move_wrists(clip, amount * share[:, None, None] * np.stack([across, -across], axis=1))


@pytest.mark.parametrize("amount", [0.8, 1.5])
def test_hands_that_touch_at_both_ends_stay_together(amount: float) -> None:
    apart = held((12.0, -15.0, 30.0), (-12.0, -15.0, 30.0))
    closer = 0.5 * float(hand_gap(apart)[0])
    before, after = (held((12.0 - closer, up, 30.0), (closer - 12.0, up, 30.0)) for up in (-15.0, -11.0))
    at_ends = hand_gap(concatenate([before[-1:], after[:1]]))
    assert np.abs(at_ends).max() < 0.2, "the hands touch at both ends"
    pressed = bent(find_transition("slerp").between(Gap(before, after, 10)), amount)
    assert hand_gap(pressed).min() < -0.5, "between them one hand is in the other"
    cleared = avoid_collisions(pressed, before, after)
    assert cleared.depth == 0.0
    found = hand_gap(cleared.clip)
    assert found.min() >= -100.0 * TOLERANCE_M - 1e-6
    assert found.max() <= at_ends.max() + 0.05, "and no frame parts them"


@pytest.mark.parametrize("missing", [("Thumb", "Index", "Middle", "Ring", "Pinky"), ("Head",), ("Shoulder",)])
def test_rigs_with_missing_joints_avoid_what_is_there(missing: tuple[str, ...]) -> None:
    before, after = (without(clip, *missing) for clip in poses_around("the trunk"))
    straight = find_transition("slerp").between(Gap(before, after, 12))
    cleared = avoid_collisions(straight, before, after)
    assert cleared.depth_before is not None
    assert cleared.depth_before > 0.01
    assert cleared.depth == 0.0


RIGS = {
    "other axes and unit": lambda clip: on_other_rig(clip, rotation.exp([0.3, 2.0, -0.4]), 0.01),
    "another rest pose": lambda clip: with_rest_pose(clip, {"LeftArm": (0.0, 0.3, 0.9)}),
    "the mirror": mirror,
}


@pytest.mark.parametrize("rig", RIGS)
def test_every_rig_takes_the_same_path(rig: str) -> None:
    before, after = poses_around("the head")
    on_rig = RIGS[rig]
    straight = find_transition("slerp").between(Gap(before, after, 12))
    expected = on_rig(avoid_collisions(straight, before, after).clip)
    found = avoid_collisions(on_rig(straight), on_rig(before), on_rig(after)).clip
    np.testing.assert_allclose(wrists(found), wrists(expected), atol=2e-3 * np.abs(wrists(expected)).max())


def test_a_transition_on_a_rig_without_arms_stays_as_it_is() -> None:
    clip = random_clip(2)
    cleared = avoid_collisions(clip[5:9], clip[:5], clip[9:])
    assert cleared.depth is None
    np.testing.assert_array_equal(cleared.clip.local_rotations, clip.local_rotations[5:9])


def test_splice_and_inbetween_avoid_collisions_on_request() -> None:
    before, after = poses_around("the head")
    clips = [replace(before, name="BEFORE"), replace(after, name="AFTER")]
    plain = ss.SpliceOptions(cutter="ends", transition="slerp", transition_time=0.5)
    off, on = ss.splice(clips, plain), ss.splice(clips, replace(plain, avoid_collisions=True))
    assert off.seams[0].intrusion_mm is None
    assert on.seams[0].intrusion_mm == 0.0
    assert deepest(off.clip) > 2.0
    assert deepest(on.clip) * CM <= TOLERANCE_M + 1e-9
    sign = slice(*on.spans[0].output)
    np.testing.assert_array_equal(on.clip.local_rotations[sign], off.clip.local_rotations[sign])
    whole = concatenate([before, find_transition("slerp").between(Gap(before, after, 12)), after])
    filled = ss.inbetween(whole, [(len(before), len(before) + 12)], "slerp", avoid_collisions=True)
    assert filled.seams[0].intrusion_mm == 0.0
    assert ss.inbetween(whole, [(len(before), len(before) + 12)], "slerp").seams[0].intrusion_mm is None
