"""Elbows move steadily and keep out of the trunk; hands and arms of both sides, and fingers and thumbs, keep apart."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from signing import sign, signer_of
from signsplice.body import capsules, collision
from signsplice.motion import kinematics
from signsplice.synth import elbows, planner, truth
from signsplice.synth.manner import USUAL, Manner
from signsplice.synth.planner import IsolatedWord
from word_measures import arm_in_arm, finger_in_thumb, swivel_steps


@cache
def made(gloss: str, manner: Manner = USUAL) -> IsolatedWord:
    return planner.isolated(sign(gloss), signer_of(None, manner))


def depths(one: IsolatedWord) -> tuple[float, float]:
    """How deep an arm lies in the other, and a forearm in the trunk, cm, at most."""
    rotations, positions = kinematics.forward(one.clip)
    body = capsules.body_capsules(one.clip.skeleton)
    arms = arm_in_arm(body, *capsules.capsule_ends(body, rotations, positions)).max()
    return float(arms), float(collision.forearm_penetration(one.clip.skeleton, rotations, positions).max())


@pytest.mark.parametrize("gloss", ["SOUR", "YEAR", "LION", "COOK", "HAT", "PURPLE"])
def test_no_elbow_turns_by_more_than_3_cm_in_a_frame(gloss: str) -> None:
    assert swivel_steps(made(gloss).clip).max() < 3.0


@pytest.mark.parametrize("pair", [("FROG", "WALK"), ("NOT", "STAND"), ("LAUGH", "YOUR")])
def test_no_elbow_jumps_between_two_signs(pair: tuple[str, str]) -> None:
    p, q = (made(gloss) for gloss in pair)
    splice = truth.splice(p, q)
    before, after = p.states[splice.pre - 2 : splice.pre + 1], q.states[splice.post : splice.post + 3]
    assert elbows.largest_step(splice.states, before, after, p.signer) < 8.0
    sudden = splice.states.copy()
    sudden[:, 63:] = 0.0
    if pair == ("FROG", "WALK"):
        assert elbows.largest_step(sudden, before, after, p.signer) > 12.0, "where the easy place jumps"


@pytest.mark.parametrize("gloss", ["NIGHT", "DAY", "TREE", "MORNING", "PAPER", "DOCTOR", "BOOK", "WRITE", "ELEPHANT"])
def test_arms_keep_out_of_one_another_and_of_the_trunk(gloss: str) -> None:
    arms, trunk = depths(made(gloss))
    assert arms < 0.5
    assert trunk < 1.2


@pytest.mark.parametrize("gloss", ["NIGHT", "DAY", "MORNING", "DOCTOR"])
def test_what_touches_an_arm_still_touches_it(gloss: str) -> None:
    assert depths(made(gloss))[0] > -0.5


def test_elbows_of_plain_motion_are_where_they_are_easy() -> None:
    assert np.abs(made("NIGHT", Manner()).states[:, 63:]).max() == 0.0
    assert np.abs(made("NIGHT").states[:, 63:]).max() > 0.05


@pytest.mark.parametrize("gloss", ["FROG", "UNDERSTAND", "MILK"])
def test_thumbs_make_way_for_fingers(gloss: str) -> None:
    one = made(gloss)
    body = capsules.body_capsules(one.clip.skeleton)
    inside = slice(one.events.start, one.events.end + 1)
    assert finger_in_thumb(body, *capsules.capsule_ends(body, *kinematics.forward(one.clip[inside]))).max() < 0.5
