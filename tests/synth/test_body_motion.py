"""Head and trunk move with a signer's manner, hands keep their places on the body, and elbows hang low."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from signing import mirror, sign, signer_of
from signsplice.body import capsules, collision
from signsplice.motion import FloatArray, kinematics, rotation
from signsplice.signer import planner, pose
from signsplice.signer.collisions import penetration
from signsplice.signer.planner import IsolatedWord
from signsplice.signer.signer import JOINTS, PLAIN, STANDARD, USUAL, Manner, Signer
from signsplice_workshop.corpora import truth
from signsplice_workshop.measure.corpus_checks import over_limit

TURNING = Manner(body_motion=1.0)
MEETING = Manner(head_to_hand=1.0)
LOW = Manner(low_elbows=1.0)
ALL = Manner(body_motion=1.0, head_to_hand=1.0, low_elbows=1.0)
AT_HEAD = ("MOTHER", "THINK", "EAT", "DEAF")
ELSEWHERE = ("BOOK", "CAR")


@cache
def made(gloss: str, manner: Manner, seed: int | None = None) -> IsolatedWord:
    return planner.synthesize_word(sign(gloss), replace(signer_of(seed), manner=manner))


def speed(one: IsolatedWord, joint: str) -> float:
    """Root mean square of a joint's local angular speed between rest and rest, degrees/s."""
    local_quats = one.clip.local_rotations[one.events.up : one.events.down + 1, JOINTS[joint]]
    step = rotation.angle_between(local_quats[:-1], local_quats[1:])
    return float(np.rad2deg(np.sqrt(np.square(step).mean())) * one.clip.fps)


def gap_to_head(one: IsolatedWord) -> FloatArray:
    """Distance (T,) of the strong hand's skin from that of head and neck, cm."""
    body = capsules.body_capsules(one.clip.skeleton)
    ends = capsules.capsule_ends(body, *kinematics.forward(one.clip))
    strong = body.groups.left if one.signer.left_handed else body.groups.right
    return np.asarray(-collision.overlap(*ends, body.radii, strong, body.groups.head)[0].max(axis=(1, 2)))


def height_of_elbows(one: IsolatedWord) -> float:
    """Mean height of the strong elbow from the shoulder within the sign, upper arm lengths."""
    side = "Left" if one.signer.left_handed else "Right"
    joints = [JOINTS[f"{side}Arm"], JOINTS[f"{side}ForeArm"]]
    positions = kinematics.forward(one.clip, joints)[1][one.events.start : one.events.end + 1]
    bone = positions[:, 1] - positions[:, 0]
    return float((bone[:, 1] / np.linalg.norm(bone, axis=-1)).mean())


# Length, and sums of the sizes of all numbers of the states and of the local rotations, of motion without traits.
PLAIN_MOTION = {
    ("MOTHER", None): (66, 9227.417062, 4016.147208),
    ("LEARN", None): (81, 9199.514623, 4994.630577),
    ("HAT", 13): (78, 11141.166589, 4789.991527),
}


@pytest.mark.parametrize(("gloss", "seed"), PLAIN_MOTION)
def test_plain_motion_stays_as_it_was(gloss: str, seed: int | None) -> None:
    one = made(gloss, PLAIN, seed)
    length, states, rotations = PLAIN_MOTION[gloss, seed]
    assert len(one) == length
    assert np.abs(one.states).sum() == pytest.approx(states, abs=1e-4)
    assert np.abs(one.clip.local_rotations).sum() == pytest.approx(rotations, abs=1e-4)


# --- head and trunk


SEEN = replace(STANDARD, manner=USUAL)


@pytest.mark.parametrize("gloss", ["BOOK", "CAR", "HOUSE", "YOU", "HAPPY", "TREE", "fs-L"])
def test_the_head_faces_the_addressee_where_no_hand_is_near_it(gloss: str) -> None:
    """What is left is the drift of a standing signer: under 3 degrees about every axis."""
    one = planner.synthesize_word(sign(gloss), SEEN)
    forward = kinematics.forward(one.clip, [JOINTS["Head"]])[0][:, 0, :, 2]
    assert np.rad2deg(np.arccos(forward[one.events.up : one.events.down + 1, 2])).max() < 3.0


def test_the_head_is_the_same_over_a_spelled_word() -> None:
    words = [planner.synthesize_word(sign(f"fs-{letter}"), SEEN) for letter in "SIGNLY"]
    held = np.rad2deg([one.states[(one.events.start + one.events.end) // 2, pose.HEAD] for one in words])
    assert np.ptp(held, axis=0).max() < 3.0


def test_the_trunk_goes_with_hands_that_reach_and_more_with_more_of_the_trait() -> None:
    sizes = [speed(made("SWIM", Manner(body_motion=size)), "Spine") for size in (0.0, 0.5, 1.0, 1.5)]
    assert sizes[0] < 0.5 * sizes[1] < sizes[1] < sizes[2] < sizes[3] < 10.0


def test_body_motion_is_over_at_rest_and_smooth() -> None:
    for gloss in ("MOTHER", "BOOK"):
        one, plain = made(gloss, ALL), made(gloss, PLAIN)
        e = one.events
        change = np.rad2deg((one.states - plain.states)[:, 54:60])
        assert np.abs(change[: e.up + 1]).max() < 1e-9
        assert np.abs(change[e.down :]).max() < 1e-9
        assert np.abs(change).max() < 30.0
        assert np.abs(np.diff(change, n=2, axis=0)).max() < 1.6, "degrees a frame and frame"


@pytest.mark.parametrize("gloss", ["MOTHER", "EAT"])
def test_the_head_goes_to_meet_a_hand_and_the_trunk_does_not(gloss: str) -> None:
    one, plain = made(gloss, MEETING), made(gloss, PLAIN)
    e = one.events
    change = np.rad2deg(one.states - plain.states)
    nod = change[:, pose.HEAD.start]
    assert 2.0 < nod[e.start : e.end + 1].max() < 5.0, "forward"
    assert nod[e.start] > 1.0, "it sets out with the preparation"
    assert np.abs(change[:, pose.TRUNK]).max() == 0.0


def test_the_head_tilts_to_a_hand_at_its_side_and_meets_none_far_away() -> None:
    one, far = (made(gloss, MEETING).states - made(gloss, PLAIN).states for gloss in ("THINK", "CAR"))
    assert np.rad2deg(one[:, pose.HEAD.start + 2]).max() > 2.5, "to the strong side"
    assert np.abs(far[:, pose.HEAD]).max() < np.deg2rad(0.5)


# --- hands keep their places


@pytest.mark.parametrize("manner", [TURNING, MEETING, ALL, Manner(body_motion=1.5, head_to_hand=1.5)])
def test_a_hand_that_touches_the_head_touches_it_wherever_it_goes(manner: Manner) -> None:
    for gloss in AT_HEAD:
        one, plain = made(gloss, manner), made(gloss, PLAIN)
        within = slice(one.events.start, one.events.end + 1)
        gap, usual = gap_to_head(one)[within], gap_to_head(plain)[within]
        touching = usual < 0.3
        assert touching.any(), gloss
        assert np.abs(gap - usual)[touching].max() < 0.5, f"{gloss}: 5 mm"
        assert gap.min() > -0.25, gloss


def test_a_head_that_moves_takes_a_touching_hand_along() -> None:
    """The hand would not touch where it stayed."""
    one, plain = made("MOTHER", ALL), made("MOTHER", PLAIN)
    middle = (one.events.start + one.events.end) // 2
    assert np.linalg.norm((one.states - plain.states)[middle, :3]) > 1.0


@pytest.mark.parametrize("manner", [TURNING, ALL])
def test_two_hands_that_touch_still_touch(manner: Manner) -> None:
    for gloss in ("BOOK", "LEARN"):
        gaps = []
        for one in (made(gloss, manner), made(gloss, PLAIN)):
            body = capsules.body_capsules(one.clip.skeleton)
            ends = capsules.capsule_ends(body, *kinematics.forward(one.clip))
            gaps.append(-collision.overlap(*ends, body.radii, body.groups.left, body.groups.right)[0].max(axis=(1, 2)))
        e = made(gloss, PLAIN).events
        touching = gaps[1][e.start : e.end + 1] < 0.15
        assert touching.any()
        assert np.abs(gaps[0] - gaps[1])[e.start : e.end + 1][touching].max() < 0.52


@pytest.mark.parametrize("seed", [None, 0, 7])
def test_no_trait_breaks_a_joint_or_puts_a_hand_into_the_body(seed: int | None) -> None:
    much = Manner(body_motion=1.5, head_to_hand=1.5, low_elbows=1.5)
    for gloss in ("MOTHER", "BOOK", "HAT"):
        one = made(gloss, much, seed)
        assert over_limit(one.clip.local_rotations) == 0.0
        assert penetration(one.states, one.signer)[0].max() < 0.25


def test_transitions_carry_the_body_on() -> None:
    p, q = made("MOTHER", ALL), made("BOOK", ALL)
    splice = truth.splice(p, q)
    body = np.concatenate([p.states[: splice.pre + 1], splice.states, q.states[splice.post :]])[:, 54:60]
    steps = np.rad2deg(np.abs(np.diff(body, axis=0)))
    seams = steps[splice.pre - 2 : splice.pre + len(splice.states) + 3]
    assert seams.max() < 6.0, "degrees a frame"
    assert np.rad2deg(np.ptp(splice.states[:, 54:60], axis=0)).max() > 0.5
    assert penetration(splice.states, p.signer)[0].max() < truth.TOO_DEEP_CM


def test_a_left_handed_signer_moves_head_and_trunk_as_in_a_mirror() -> None:
    left: Signer = replace(signer_of(3), left_handed=True, manner=ALL)
    one, two = (planner.synthesize_word(sign("DEAF"), replace(left, left_handed=side)) for side in (False, True))
    rotations, roots = mirror(one.clip)
    assert np.abs(np.sum(rotations * two.clip.local_rotations, axis=-1)).min() > 1.0 - 1e-9
    assert np.allclose(roots, two.clip.root_positions, atol=1e-9)


# --- low elbows


@pytest.mark.parametrize("seed", [None, 3])
def test_elbows_are_lower_and_hands_where_they_were(seed: int | None) -> None:
    for gloss in ("MORE", "HELP"):
        low, usual = made(gloss, LOW, seed), made(gloss, PLAIN, seed)
        assert height_of_elbows(low) < height_of_elbows(usual) + 0.01, gloss
        turned = []
        for one in (low, usual):
            within = one.states[one.events.start : one.events.end + 1]
            rotations, positions = kinematics.forward(pose.clip(within, one.signer, 30.0))
            hands = [JOINTS["LeftHand"], JOINTS["RightHand"]]
            turned.append((rotation.from_matrix(rotations[:, hands]), positions[:, hands]))
        assert np.abs(turned[0][1] - turned[1][1]).max() < 1.0, gloss
        assert np.rad2deg(rotation.angle_between(turned[0][0], turned[1][0])).max() < 15.0, "but for their limits"
    assert height_of_elbows(made("MORE", LOW, seed)) < height_of_elbows(made("MORE", PLAIN, seed)) - 0.05


def test_elbows_hang_no_lower_than_the_trunk_lets_them() -> None:
    """Hands before the belly: elbows lie beside the trunk, which the cost of height alone would not see."""
    for gloss in ("CAR", "HOUSE"):
        one = made(gloss, LOW)
        body = capsules.body_capsules(one.clip.skeleton)
        ends = capsules.capsule_ends(body, *kinematics.forward(one.clip))
        cuffs = [n for n, part in enumerate(body.parts) if part == "cuff"]
        trunk = [n for n in body.groups.trunk if "Shoulder" not in body.keys[n]]
        depth = collision.overlap(*ends, body.radii, cuffs, trunk)[0].max(axis=(1, 2))
        assert depth[one.events.start : one.events.end + 1].max() < 4.5, gloss
