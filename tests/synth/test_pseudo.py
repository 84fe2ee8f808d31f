"""Pseudo-signs: lawful, the same for a seed, various, within reach, and clear of the body when they are signed."""

from __future__ import annotations

from collections import Counter
from functools import cache

import numpy as np
import pytest

from signsplice.evaluation.corpus_checks import over_limit
from signsplice.synth import locations, phonology, planner, pose, pseudo, truth
from signsplice.synth.avoidance import intrusion
from signsplice.synth.phonology import Posture, Sign
from signsplice.synth.signer import STANDARD, signer

SEEDS = range(60)


@cache
def drawn(seed: int) -> Sign:
    return pseudo.sign(seed)


def strong_postures(sign: Sign) -> list[Posture]:
    return [segment.strong for segment in sign.segments]


@pytest.mark.parametrize("seed", SEEDS)
def test_every_seed_is_a_lawful_sign(seed: int) -> None:
    sign = drawn(seed)
    assert phonology.faults(sign) == []
    assert (sign.gloss, sign.kind) == (f"PSEUDO-{seed}", "pseudo")
    assert sign.segments[0].kind in ("H", "X")
    assert sign.segments == sign.segments[:1] or any(segment.kind == "M" for segment in sign.segments)
    assert (sign.segments[0].weak is not None) == (sign.hands == "base")
    for segment in sign.segments:
        assert np.linalg.norm(segment.strong.palm) == pytest.approx(1.0)
        assert np.linalg.norm(segment.strong.fingers) == pytest.approx(1.0)


def test_a_seed_is_one_sign_whatever_was_drawn_before() -> None:
    again = [pseudo.sign(seed) for seed in (7, 3, 7)]
    assert again[0] == again[2] == drawn(7)
    assert again[1] == drawn(3)


def test_they_are_various() -> None:
    signs = [drawn(seed) for seed in SEEDS]
    assert len({sign.segments for sign in signs}) == len(signs)
    hands = Counter(sign.hands for sign in signs)
    assert set(hands) == set(phonology.HANDS)
    assert hands["one"] < 0.9 * len(signs)
    assert len({p.place for sign in signs for p in strong_postures(sign)}) >= 15
    assert len({p.shape for sign in signs for p in strong_postures(sign)}) >= 20
    assert len({p.part for sign in signs for p in strong_postures(sign)}) >= 6
    moves = [segment for sign in signs for segment in sign.segments if segment.kind == "M"]
    assert {"straight", "arc", "circle"} <= {move.path.kind for move in moves}
    assert any(move.local is not None for move in moves)
    assert any(move.times > 1 for move in moves)
    assert {sign.segments[-1].kind for sign in signs} == {"M", "H"}
    assert {sign.segments[0].kind for sign in signs} == {"X", "H"}


@pytest.mark.parametrize("seed", SEEDS)
def test_they_are_within_reach_of_the_standard_signer(seed: int) -> None:
    sign = drawn(seed)
    for segment in sign.segments:
        weak = locations.weak(segment.weak, STANDARD) if segment.weak is not None else np.zeros(27)
        numbers = locations.strong(segment.strong, STANDARD, weak, sign.hands in ("symmetric", "alternating"))
        arm = pose.reach(numbers[pose.WRIST], STANDARD)
        assert arm.bend > 0.3, "the arm is not stretched"
        wrist = pose.wrist_angles(arm, numbers[pose.TURN], STANDARD)
        (low_side, high_side), (low_bent, high_bent) = pose.WRIST_LIMITS
        assert low_side < wrist.deviation < high_side
        assert low_bent < wrist.flexion < high_bent
        assert abs(wrist.turn) < pose.FOREARM_LIMIT
        assert pseudo.easy(numbers)


def test_what_is_no_ease() -> None:
    easy = locations.strong(Posture("B", "space", "palm", (-1.0, 0.0, 0.0), (0.0, 0.6, 0.8)), STANDARD, np.zeros(27))
    assert pseudo.easy(easy)
    far, bent = easy.copy(), easy.copy()
    far[2] += 40.0
    bent[4] += 1.5
    assert not pseudo.easy(far)
    assert not pseudo.easy(bent)


@pytest.mark.parametrize("seed", [0, 5, 11, 23, 42])
def test_signed_they_are_clear_of_the_body_and_can_be_spliced(seed: int) -> None:
    who = STANDARD if seed % 2 else signer(3)
    one, two = planner.isolated(drawn(seed), who), planner.isolated(drawn(seed + 1), who)
    for word in (one, two):
        assert intrusion(word.states, who)[0].max() < 0.5
        assert over_limit(word.clip.local_rotations) == 0.0
    true = truth.splice(one, two)
    assert one.events.start <= true.pre < one.events.down
    assert two.events.up < true.post <= two.events.end
