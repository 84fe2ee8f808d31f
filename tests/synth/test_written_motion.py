"""Written signs in motion: strokes as long as written, hands that stay together, arms that do not turn suddenly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from signsplice.motion import FloatArray, kinematics, rotation
from signsplice.signer import arms, locations, planner, pose
from signsplice.signer.collisions import between_hands
from signsplice.signer.notation import parse
from signsplice.signer.planner import IsolatedWord
from signsplice.signer.signer import JOINTS, STANDARD
from signsplice.written import signing

LOWERED = """LOWERED  hands=one kind=written
  X shape=pinch12open at=space:3.78,24.83,16.46 palm=in fingers=0,0.383,0.924
  M shift=0,-12,0 fingers=fwd
  H
"""
CROSSED = """CROSSED  hands=base kind=written
  X shape=finger23.across at=base-2.mid.radial by=3.mid.ulnar touch=yes palm=-0.707,0,-0.707 fingers=-0.707,0,0.707 \
w.shape=finger23.across w.at=space:0,9.5,25 w.by=2.mid.radial w.palm=-0.707,0,-0.707 w.fingers=-0.707,0,0.707
  M w.shift=0,-6,0
  H
"""
PATS = """PATS  hands=base kind=written
  X shape=flat at=base-palm off=3 palm=down fingers=fwd w.shape=flat w.at=space:0,2,26 w.palm=up w.fingers=fwd
  M off=0 touch=yes times=3
  H
"""
BY_THE_SHOULDER = """BY-THE-SHOULDER  hands=one kind=written
  X shape=flat at=ear off=4 palm=in fingers=up
  M off=0 shift=4,0,0.4 fingers=0,0.707,-0.707
  M fingers=up
  H
"""
AT_EARS = """AT-EARS  hands=symmetric kind=written
  X shape=ceeall at=cheek by=5.tip touch=yes palm=-0.924,0.271,-0.271 fingers=0,0.707,0.707
  M at=chin:2.5,0 touch=yes palm=-0.383,0,-0.924 fingers=up path=arc:0.707,-0.707,0:2
  H
"""

TO_THE_RIGHT = """TO-THE-RIGHT  hands=one kind=written
  X shape=flat at=space:0,5,25 palm=down fingers=out
  M shift=0,-12,0
  H
"""
COMES_AND_STIRS = """COMES-AND-STIRS  hands=base kind=written
  X shape=finger23spread at=space:15,19,30 palm=fwd fingers=up w.shape=rest w.at=rest w.palm=in w.fingers=down
  M shape=finger23spread.hooked times=2
  M shape=finger2 at=space:6,21,25 palm=down fingers=in w.shape=finger2 w.at=space:6,21,25 w.palm=down w.fingers=in
  M local=stir:14:7 for=2.7
  H
"""

LEAVES = """LEAVES  hands=base kind=written
  X shape=fist at=base-palm by=back touch=yes palm=up fingers=fwd \
w.shape=fist w.at=space:0,9.5,25 w.palm=in w.fingers=fwd
  M shift=-6,0,8 touch=no
  H
"""
_SHOULDERS = "at=shoulder/chest:14,8 touch=yes palm=-0.27,-0.27,-0.92 fingers=-0.71,0.71,0"
MIRRORED = {
    "at the shoulders": f"shape=flat by=2.tip {_SHOULDERS}",
    "on the chest": f"shape=fist by=ulnar {_SHOULDERS}",
    "together": "shape=pinchall at=space:0,14,25 by=4.tip touch=yes palm=back fingers=0,0.707,0.707",
}


def made(text: str) -> IsolatedWord:
    (written,) = parse(text).values()
    return planner.synthesize_word(written)


def heights(one: IsolatedWord) -> FloatArray:
    """Heights (T,) of the right palm above the chest, cm."""
    joints = [JOINTS[name] for name in ("Spine2", "RightHand", "RightHandMiddle1")]
    rotations, positions = kinematics.forward(one.clip, joints)
    away = positions[:, 1:].mean(axis=1) - positions[:, 0]
    return np.asarray(np.einsum("tba,tb->ta", rotations[:, 0], away)[:, 1])


def test_a_stroke_is_as_long_as_written_and_the_hand_then_stays() -> None:
    one = made(LOWERED)
    height = heights(one)[one.events.start : one.events.end + 1]
    assert height[0] - height.min() == pytest.approx(12.0, abs=1.2)
    assert np.ptp(height[-8:]) < 0.5


def test_a_hand_that_pats_is_lifted_between_touches() -> None:
    one = made(PATS)
    height = heights(one)
    (patted,) = [timed for timed in one.segments if timed.segment.times == 3]
    assert len(patted.passes) == 3
    assert all(height[begin] - height[stop] > 1.5 for begin, stop in patted.passes)


def test_a_hand_near_its_shoulder_comes_back_to_the_written_direction() -> None:
    one = made(BY_THE_SHOULDER)
    for timed in (one.segments[0], one.segments[2]):
        posture = timed.segment.strong
        turned = pose.hand_rotations(one.states[timed.end], STANDARD)[0]
        assert rotation.angle_between(turned, locations.facing(posture.palm, posture.fingers)) < np.deg2rad(25.0)


def test_a_base_hand_stays_when_the_other_one_leaves_it() -> None:
    one = made(LEAVES)
    weak = one.states[one.segments[0].end : one.segments[-1].end + 1, 27:30]
    assert np.linalg.norm(weak - weak[0], axis=1).max() < 3.0


@pytest.mark.parametrize("where", MIRRORED)
def test_hands_that_mirror_one_another_do(where: str) -> None:
    one = made(f"MIRRORED  hands=symmetric kind=written\n  X {MIRRORED[where]}\n  M shift=0,-12,0 touch=no\n  H\n")
    strong, weak = (one.states[one.events.start : one.events.end + 1, first : first + 3] for first in (0, 27))
    assert np.linalg.norm(strong - weak, axis=1).max() < 2.0


def test_hands_that_touch_move_together() -> None:
    one = made(CROSSED)
    span = slice(one.events.start, one.events.end + 1)
    assert between_hands(one.states, STANDARD)[span].max() < 0.5
    height = heights(one)[span]
    assert height[0] - height[-1] == pytest.approx(6.0, abs=1.2)


def test_forearms_turn_over_in_their_own_time() -> None:
    assert list(signing.jumps(made(AT_EARS).clip)) == []


def test_a_hand_that_no_wrist_can_turn_so_far_does_not_flip() -> None:
    quats = made(TO_THE_RIGHT).clip.local_rotations[:, JOINTS["RightHand"]]
    assert rotation.angle_between(quats[1:], quats[:-1]).max() < np.deg2rad(60.0)


def test_a_hand_that_turns_over_in_a_frame_is_named() -> None:
    clip = made(LOWERED).clip
    quats = clip.local_rotations.copy()
    quats[20, JOINTS["RightHand"]] = rotation.exp([0.0, 0.0, 1.4])
    quats[21, JOINTS["RightHand"]] = rotation.exp([0.0, 0.0, -1.2])
    assert "a hand turns over at frame 21" in " ".join(signing.jumps(replace(clip, local_rotations=quats)))


def test_a_hand_that_has_come_stays_while_wrists_move() -> None:
    one = made(COMES_AND_STIRS)
    weak = one.states[one.segments[2].end : one.segments[3].end, 27:30]
    assert np.linalg.norm(weak - weak[0], axis=1).max() < 3.0


def test_arms_that_turn_over_nowhere_are_left_alone() -> None:
    states = made(LOWERED).states
    assert arms.limit_forearm_speed(states, STANDARD, 30.0) is states


CIRCLES = """CIRCLES  hands=one kind=written
  X shape=flat at=space:7.5,9.5,30 palm=fwd fingers=up
  M path=circle:-1,0,0:5:3:0,1,0
  H
"""
SWINGS = """SWINGS  hands=one kind=written
  X shape=finger2.across at=space:7.5,14,25 palm=fwd fingers=up
  M local=swing:14:3
  H
"""
ENDS_ASIDE = """ENDS-ASIDE  hands=one kind=written
  X shape=finger2.across at=space:7.5,14,30 palm=in fingers=up
  M fingers=out palm=up
  H
"""


def test_circles_are_even_and_come_to_rest_without_a_hitch() -> None:
    word = made(CIRCLES)
    begin, end = word.segments[1].begin, word.segments[2].end
    wrists = pose.hands(word.states)[begin : end + 1, 0, pose.WRIST]
    speed = np.linalg.norm(np.diff(wrists, axis=0), axis=-1)
    turning, resting = np.split(speed, [word.segments[1].end - begin - 2])
    assert turning.min() > 0.6 * turning.max()
    assert (np.diff(resting) < 0.05).all()


def test_a_wrist_swings_about_its_own_axis() -> None:
    word = made(SWINGS)
    segment = word.segments[1]
    hands = pose.hand_rotations(word.states, STANDARD)[segment.begin : segment.end + 1, 0]
    turns = rotation.log(rotation.multiply(rotation.inverse(hands[0]), hands))
    wide = np.rad2deg(np.ptp(turns, axis=0))
    assert wide[1] > 22.0
    assert max(wide[0], wide[2]) < 0.5 * wide[1]


def test_an_elbow_stays_while_the_hand_stays() -> None:
    word = made(ENDS_ASIDE)
    hold = word.segments[2]
    positions = kinematics.forward(word.clip)[1]
    elbow = (positions[:, JOINTS["RightForeArm"]] - positions[:, JOINTS["Spine2"]])[hold.begin + 7 : hold.end + 1]
    assert np.linalg.norm(elbow[:, None] - elbow, axis=-1).max() < 0.5
