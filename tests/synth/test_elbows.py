"""Elbows move steadily and keep out of the trunk; hands and arms of both sides, and fingers and thumbs, keep apart."""

from __future__ import annotations

from functools import cache
from itertools import product

import numpy as np
import pytest

from signing import sign, signer_of
from signsplice.body import capsules, collision, swivel
from signsplice.motion import kinematics
from signsplice.signer import arms, planner
from signsplice.signer.figure import pose_signer
from signsplice.signer.notation import parse
from signsplice.signer.planner import IsolatedWord
from signsplice.signer.signer import USUAL, Manner
from signsplice_workshop.corpora import truth
from word_measures import arm_in_arm, finger_in_thumb, swivel_steps


@cache
def made(gloss: str, manner: Manner = USUAL) -> IsolatedWord:
    return planner.synthesize_word(sign(gloss), signer_of(None, manner))


def depths(one: IsolatedWord) -> tuple[float, float]:
    """How deep an arm lies in the other, and a forearm in the trunk, cm, at most."""
    rotations, positions = kinematics.forward(one.clip)
    body = capsules.body_capsules(one.clip.skeleton)
    arms = arm_in_arm(body, *capsules.capsule_ends(body, rotations, positions)).max()
    return float(arms), float(collision.forearm_penetration(one.clip.skeleton, rotations, positions).max())


@pytest.mark.parametrize("gloss", ["SOUR", "YEAR", "LION", "COOK", "HAT", "PURPLE"])
def test_no_elbow_turns_by_more_than_3_cm_in_a_frame(gloss: str) -> None:
    assert swivel_steps(made(gloss).clip).max() < 3.0


@pytest.mark.parametrize(
    ("first", "then", "most_cm"),
    [
        ("shape=flat at=ear off=3 palm=fwd fingers=up", "shift=8,0,-6 palm=back times=2", 15.0),
        ("shape=finger2345 at=space:0,14,25 palm=back fingers=down", "at=space:0,14,30 palm=fwd fingers=up", 8.0),
    ],
)
def test_elbows_of_written_signs_do_not_flip(first: str, then: str, most_cm: float) -> None:
    (written,) = parse(f"X  hands=one kind=written\n  X {first}\n  M {then}\n  H\n").values()
    assert swivel_steps(planner.synthesize_word(written).clip).max() < most_cm


@pytest.mark.parametrize(("shape", "at", "part", "palm", "fingers"), [
    ("flat", "chest", "palm", "back", "in"),
    ("flat", "belly", "ulnar", "up", "in"),
])  # fmt: skip
def test_the_written_part_of_a_hand_touches(shape: str, at: str, part: str, palm: str, fingers: str) -> None:
    text = f"X shape={shape} at=space palm={palm} fingers={fingers}\n  M at={at} by={part} touch=yes\n  H\n"
    (written,) = parse(f"A  hands=one kind=written\n  {text}").values()
    one = planner.synthesize_word(written)
    posture = written.segments[1].strong
    assert pose_signer(one.states, one.signer).distance(posture, one.segments[1].end)[0] < 0.5


@pytest.mark.parametrize("pair", [("FROG", "WALK"), ("NOT", "STAND"), ("LAUGH", "YOUR")])
def test_no_elbow_jumps_between_two_signs(pair: tuple[str, str]) -> None:
    p, q = (made(gloss) for gloss in pair)
    splice = truth.splice(p, q)
    before, after = p.states[splice.pre - 2 : splice.pre + 1], q.states[splice.post : splice.post + 3]
    assert truth.measure_largest_elbow_step(splice.states, before, after, p.signer) < 8.0
    sudden = splice.states.copy()
    sudden[:, 63:] = 0.0
    if pair == ("FROG", "WALK"):
        assert truth.measure_largest_elbow_step(sudden, before, after, p.signer) > 12.0, "where the easy place jumps"


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


def test_no_other_choices_cost_less() -> None:
    rng = np.random.default_rng(5)
    costs, changes = rng.random((5, 3)), rng.random((4, 3, 3))

    def total(choice: tuple[int, ...]) -> float:
        return float(costs[range(5), choice].sum() + sum(changes[n][choice[n : n + 2]] for n in range(4)))

    best = min(product(range(3), repeat=5), key=total)
    assert tuple(swivel.least_cost_choices(costs, changes)) == best


def test_finer_steps_turn_an_elbow_no_farther_than_it_must() -> None:
    frames = np.ones((30, 1))
    arm = swivel.BentArm(
        frames * [0.0, 0.0, 0.0], frames * [0.0, -0.25, 0.1], frames * [0.0, 0.0, 0.3], np.array([0.04, 0.03])
    )
    beside = np.array([-0.055, -0.14, 0.2])
    obstacles = swivel.Obstacles(
        (frames * beside)[:, None], (frames * beside)[:, None] + [0.0, 0.0, 0.01], np.full((1, 2), 0.03)
    )
    free = np.zeros((30, 1))
    coarse, fine = (swivel.choose(arm, obstacles, free, 30.0, *grid) for grid in ((), (arms.CLEARING_TURNS,)))
    assert 0.0 < np.abs(fine).max() < np.abs(coarse).max()
