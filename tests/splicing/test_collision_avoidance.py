"""Body sense: hands led through the body on purpose, and what is left of it."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import signsplice as ss
from conftest import random_clip
from other_rigs import mirror, on_other_rig, with_rest_pose, without
from signing import word
from signsplice.body import collision
from signsplice.body.arm_ik import move_wrists
from signsplice.motion import kinematics, rotation
from signsplice.motion.clip import Clip, concatenate
from signsplice.rig.info import rig_info
from signsplice.splicing.collision_avoidance import TOLERANCE_M, avoid_all_collisions, avoid_collisions
from signsplice.splicing.gap import Gap
from signsplice.splicing.transition import find_transition

CM = 0.01
ASIDE = (-25.0, -25.0, 25.0)
TURN = rotation.exp([0.3, 2.0, -0.4])


def held(left: tuple[float, float, float], right: tuple[float, float, float], n_frames: int = 8) -> Clip:
    """Both wrists held at places relative to the middle between the shoulders, cm: left, up, ahead."""
    still = word("SIGN").clip[:1]
    still = concatenate([still] * n_frames)
    joints = rig_info(still.skeleton).arm_joints
    for _ in range(3):
        _, places = kinematics.forward(still, joints)
        middle = 0.5 * (places[:, 0] + places[:, 3])
        moves = np.stack([middle + left - places[:, 2], middle + right - places[:, 5]], axis=1)
        still = move_wrists(still, moves)
    return still


@cache
def through(what: str) -> tuple[Clip, Clip]:
    """Two held poses whose straight connection leads a hand through something."""
    ends = {
        "the head": (((-14.0, 18.0, 19.0), ASIDE), ((28.0, -8.0, -2.0), ASIDE)),
        "the trunk": (((-6.0, 1.0, 15.0), ASIDE), ((28.0, -14.0, -4.0), ASIDE)),
        "the other hand": (((16.0, -15.0, 30.0), (-16.0, -16.0, 30.0)), ((-14.0, -15.0, 30.0), (14.0, -16.0, 30.0))),
    }
    first, second = ends[what]
    return held(*first), held(*second)


def deepest(clip: Clip) -> float:
    """Depth of the deepest hand, cm."""
    depth, _ = collision.hand_penetration(clip.skeleton, *kinematics.forward(clip))
    return float(depth.max())


def wrists(clip: Clip) -> np.ndarray:
    return kinematics.forward(clip, [rig_info(clip.skeleton).arm_joints[n] for n in (2, 5)])[1]


@pytest.mark.parametrize("transition", ["slerp", "hermite", "minimum-jerk"])
@pytest.mark.parametrize("what", ["the head", "the trunk", "the other hand"])
def test_hands_are_led_around(what: str, transition: str) -> None:
    before, after = through(what)
    assert max(deepest(before), deepest(after)) * CM < TOLERANCE_M, "the signs themselves are free"
    straight = find_transition(transition).between(Gap(before, after, 14))
    assert deepest(straight) > 2.0, f"the straight way goes through {what}"
    led = avoid_collisions(straight, before, after)
    assert led.depth_before == pytest.approx(deepest(straight) * CM)
    assert deepest(led.clip) * CM <= TOLERANCE_M + 1e-9
    assert led.depth == 0.0
    steps = np.linalg.norm(np.diff(wrists(concatenate([before[-1:], led.clip, after[:1]])), axis=0), axis=-1)
    longest = np.linalg.norm(np.diff(wrists(concatenate([before[-1:], straight, after[:1]])), axis=0), axis=-1).max()
    assert steps.max() < 2.5 * longest, "around, and not by a leap"


def test_gaps_that_are_looked_at_together_are_each_led_alone() -> None:
    hermite = find_transition("hermite")
    ends = [through("the head"), held_twice(), through("the trunk")]
    gaps = [(hermite.between(Gap(*pair, 9 + n)), *pair) for n, pair in enumerate(ends)]
    together, alone = avoid_all_collisions(gaps), [avoid_collisions(*gap) for gap in gaps]
    for one, other in zip(together, alone, strict=True):
        np.testing.assert_array_equal(one.clip.local_rotations, other.clip.local_rotations)
        assert (one.depth_before, one.depth) == (other.depth_before, other.depth)
    assert together[0].depth_before
    assert together[1].depth_before == 0.0
    assert avoid_all_collisions([]) == []


def held_twice() -> tuple[Clip, Clip]:
    """Two poses with nothing between them."""
    return held((26.0, -12.0, 30.0), (-26.0, -12.0, 30.0)), held((28.0, -4.0, 32.0), (-24.0, -8.0, 31.0))


def test_bones_and_everything_but_arms_stay() -> None:
    before, after = through("the head")
    straight = find_transition("hermite").between(Gap(before, after, 12))
    led = avoid_collisions(straight, before, after).clip
    changed = np.abs(led.local_rotations - straight.local_rotations).max(axis=(0, 2)) > 1e-12
    names = {led.skeleton.names[j] for j in np.flatnonzero(changed)}
    assert names
    assert {n.split(":")[-1] for n in names} <= {
        side + part for side in ("Left", "Right") for part in ("Arm", "ForeArm", "Hand")
    }
    np.testing.assert_array_equal(led.root_positions, straight.root_positions)
    turns = [kinematics.forward(clip, [rig_info(clip.skeleton).arm_joints[2]])[0] for clip in (led, straight)]
    np.testing.assert_allclose(turns[0], turns[1], atol=1e-9)


def test_seams_stay_smooth() -> None:
    """Next to both signs the path moves by a small share of what it moves in the middle."""
    before, after = through("the head")
    straight = find_transition("hermite").between(Gap(before, after, 20))
    way = np.linalg.norm(wrists(avoid_collisions(straight, before, after).clip) - wrists(straight), axis=-1).max(axis=1)
    assert max(way[0], way[-1]) < 0.03 * way.max()
    assert max(way[1], way[-2]) < 0.2 * way.max()


def test_what_touches_nothing_is_left_as_it_is() -> None:
    before, after = held((22.0, -15.0, 30.0), (-22.0, -15.0, 30.0)), held((22.0, 0.0, 30.0), (-22.0, 0.0, 30.0))
    straight = find_transition("hermite").between(Gap(before, after, 10))
    led = avoid_collisions(straight, before, after)
    assert led.clip is straight
    assert (led.depth_before, led.depth) == (0.0, 0.0)


def test_what_the_signs_themselves_press_in_is_no_fault() -> None:
    """Both ends lie deep in the face: the frames between may, and are not thrown out of it at once."""
    before = held((-2.0, 18.0, 6.0), ASIDE)
    after = held((-1.0, 17.0, 6.5), ASIDE)
    assert min(deepest(before), deepest(after)) > 1.0
    straight = find_transition("slerp").between(Gap(before, after, 8))
    assert avoid_collisions(straight, before, after).depth == 0.0
    assert np.abs(wrists(avoid_collisions(straight, before, after).clip) - wrists(straight)).max() < 0.5


@pytest.mark.parametrize("lacking", [("Thumb", "Index", "Middle", "Ring", "Pinky"), ("Head",), ("Shoulder",)])
def test_rigs_that_lack_joints_are_led_around_what_there_is(lacking: tuple[str, ...]) -> None:
    before, after = (without(clip, *lacking) for clip in through("the trunk"))
    straight = find_transition("slerp").between(Gap(before, after, 12))
    led = avoid_collisions(straight, before, after)
    assert led.depth_before is not None
    assert led.depth_before > 0.01
    assert led.depth == 0.0


CLOTHES = {
    "other axes and unit": lambda clip: on_other_rig(clip, TURN, 0.01),
    "another rest pose": lambda clip: with_rest_pose(clip, {"LeftArm": (0.0, 0.3, 0.9)}),
    "the mirror": mirror,
}


@pytest.mark.parametrize("clothes", CLOTHES)
def test_other_rigs_are_led_alike(clothes: str) -> None:
    before, after = through("the head")
    put = CLOTHES[clothes]
    straight = find_transition("slerp").between(Gap(before, after, 12))
    expected = put(avoid_collisions(straight, before, after).clip)
    found = avoid_collisions(put(straight), put(before), put(after)).clip
    np.testing.assert_allclose(wrists(found), wrists(expected), atol=2e-3 * np.abs(wrists(expected)).max())


def test_a_rig_without_arms_passes() -> None:
    clip = random_clip(2)
    led = avoid_collisions(clip[5:9], clip[:5], clip[9:])
    assert led.depth is None
    np.testing.assert_array_equal(led.clip.local_rotations, clip.local_rotations[5:9])


def test_the_engine_leads_hands_around_on_request() -> None:
    before, after = through("the head")
    clips = [replace(before, name="BEFORE"), replace(after, name="AFTER")]
    plain = ss.SpliceOptions(cutter="ends", transition="slerp", transition_time=0.5)
    with_sense = replace(plain, avoid_collisions=True)
    off, on = ss.splice(clips, plain), ss.splice(clips, with_sense)
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
