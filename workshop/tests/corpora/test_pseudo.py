"""Pseudo-signs are well-formed, the same for a seed, varied, within reach, and clear of the body when signed."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from signsplice.signer import locations, phonology, planner, pose
from signsplice.signer.collisions import penetration
from signsplice.signer.locations import WeakArm
from signsplice.signer.phonology import Posture, Sign
from signsplice.signer.signer import STANDARD, draw_signer, stream
from signsplice_workshop.corpora import pseudo, truth
from signsplice_workshop.measure.corpus_checks import over_limit


@pytest.fixture(scope="module")
def signs() -> list[Sign]:
    """The pseudo-signs of the first seeds."""
    return [pseudo.draw_sign(seed) for seed in range(44)]


def strong_postures(sign: Sign) -> list[Posture]:
    return [segment.strong for segment in sign.segments]


def test_every_seed_makes_a_well_formed_sign(signs: list[Sign]) -> None:
    for seed, sign in enumerate(signs):
        assert phonology.faults(sign) == [], seed
        assert (sign.gloss, sign.kind) == (f"PSEUDO-{seed}", "pseudo")
        assert sign.segments[0].kind in ("H", "X"), seed
        assert sign.segments == sign.segments[:1] or any(segment.kind == "M" for segment in sign.segments), seed
        assert (sign.segments[0].weak is not None) == (sign.hands == "base"), seed
        for posture in strong_postures(sign):
            assert np.linalg.norm([posture.palm, posture.fingers], axis=1) == pytest.approx(1.0), seed


def test_a_seed_makes_one_sign_in_every_order_of_draws(signs: list[Sign]) -> None:
    again = [pseudo.draw_sign(seed) for seed in (7, 3, 7)]
    assert again == [signs[7], signs[3], signs[7]]


def test_pseudo_signs_vary(signs: list[Sign]) -> None:
    assert len({sign.segments for sign in signs}) == len(signs)
    hands = Counter(sign.hands for sign in signs)
    assert set(hands) == set(phonology.HANDS)
    assert hands["one"] < 0.9 * len(signs)
    assert len({p.location for sign in signs for p in strong_postures(sign)}) >= 15
    assert len({p.shape for sign in signs for p in strong_postures(sign)}) >= 20
    assert len({p.part for sign in signs for p in strong_postures(sign)}) >= 6
    moves = [segment for sign in signs for segment in sign.segments if segment.kind == "M"]
    assert {"straight", "arc", "circle"} <= {move.path.kind for move in moves}
    assert any(move.local is not None for move in moves)
    assert any(move.times > 1 for move in moves)
    assert {sign.segments[-1].kind for sign in signs} == {"M", "H"}
    assert {sign.segments[0].kind for sign in signs} == {"X", "H"}


def test_hands_and_places_are_as_frequent_as_in_the_lexicon_of_asl() -> None:
    kinds = [pseudo.draw_kind(stream("pseudo", seed)) for seed in range(2000)]
    hands = Counter(hands for hands, _, _ in kinds)
    places = Counter(place for _, place, _ in kinds)
    found = (hands["one"], hands["symmetric"] + hands["alternating"], hands["base"], places["hand"], places["neutral"])
    assert np.array(found) / 2000 == pytest.approx([0.39, 0.35, 0.25, 0.25, 0.36], abs=0.02), "ASL-LEX 2.0"


def test_no_try_changes_what_was_drawn_first(signs: list[Sign]) -> None:
    for seed, sign in enumerate(signs):
        hands, place, course = pseudo.draw_kind(stream("pseudo", seed))
        table = "symmetric" if hands == "alternating" else hands
        assert sign.hands == hands, seed
        assert sign.segments[0].strong.location in pseudo.FREQUENCIES[f"locations {table} {place}"], seed
        if course == "touch":
            assert sign.segments[0].strong.off > 0.0, seed
            assert sign.segments[1].strong.off == 0.0, seed


def test_all_postures_are_within_reach_and_joint_limits(signs: list[Sign]) -> None:
    for sign in signs:
        for segment in sign.segments:
            weak = np.zeros(27) if segment.weak is None else locations.weak_hand(segment.weak, STANDARD)
            meets = sign.hands in ("symmetric", "alternating")
            hand_state = locations.strong_hand(segment.strong, WeakArm(STANDARD, weak), meets)
            arm = pose.solve_arm(hand_state[pose.WRIST], STANDARD)
            assert arm.bend > 0.3, f"{sign.gloss}: the arm is stretched"
            angles = pose.arm_angles(arm, hand_state[pose.ROTVEC], STANDARD)
            (low_side, high_side), (low_bent, high_bent) = pose.WRIST_LIMITS
            assert low_side < angles.deviation < high_side, sign.gloss
            assert low_bent < angles.flexion < high_bent, sign.gloss
            assert abs(angles.twist) < pose.FOREARM_LIMIT, sign.gloss
            assert pose.is_well_within_limits(hand_state), sign.gloss


def test_far_or_bent_hands_are_not_easy() -> None:
    posture = Posture("B", "space", "palm", (-1.0, 0.0, 0.0), (0.0, 0.6, 0.8))
    easy = locations.strong_hand(posture, WeakArm(STANDARD, np.zeros(27)))
    assert pose.is_well_within_limits(easy)
    far, bent = easy.copy(), easy.copy()
    far[2] += 40.0
    bent[4] += 1.5
    assert not pose.is_well_within_limits(far)
    assert not pose.is_well_within_limits(bent)


@pytest.mark.parametrize("seed", [0, 5, 11, 23, 42])
def test_signed_they_are_clear_of_the_body_and_can_be_spliced(seed: int, signs: list[Sign]) -> None:
    signer = STANDARD if seed % 2 else draw_signer(3)
    one, two = planner.synthesize_word(signs[seed], signer), planner.synthesize_word(signs[seed + 1], signer)
    for word in (one, two):
        assert penetration(word.states, signer)[0].max() < 0.5
        assert over_limit(word.clip.local_rotations) == 0.0
    true = truth.splice(one, two)
    assert one.events.start <= true.pre < one.events.down
    assert two.events.up < true.post <= two.events.end
