"""Skin distances at the events of words, beside distances measured in another way."""

from __future__ import annotations

import pytest

from signing import made, word
from signsplice.rig.roles import SIDES
from signsplice.signer.collisions import TOUCH_CM
from signsplice.signer.planner import IsolatedWord, touches
from signsplice.signer.signer import STANDARD, draw_signer
from signsplice_workshop.corpora.touches import find_touching_sides, measure_skin_clearances, measure_touches
from signsplice_workshop.measure.corpus_checks import skin_distance

LEFT_HANDED = next(seed for seed in range(100) if draw_signer(seed).left_handed)


def measured(one: IsolatedWord, frame: int) -> float:
    return skin_distance(one.clip, frame, find_touching_sides(one.sign.hands, one.signer))


@pytest.mark.parametrize("seed", [None, LEFT_HANDED])
@pytest.mark.parametrize("gloss", ["MOTHER", "BOOK", "LEARN", "HELLO", "DAY", "FRIEND"])
def test_events_and_geometry_agree(gloss: str, seed: int | None) -> None:
    one = word(gloss, seed)
    e = measure_touches(one)
    assert e.gap_first_cm == pytest.approx(measured(one, e.start), abs=1e-5)
    assert e.gap_last_cm == pytest.approx(measured(one, e.end), abs=1e-5)
    assert e.touches_first == (measured(one, e.start) <= TOUCH_CM)
    assert e.touches_last == (measured(one, e.end) <= TOUCH_CM)


def test_a_touch_is_seen_whatever_the_notation_says() -> None:
    """The palm is 3 cm from the chin, but the fingers lie at nose and forehead: only the motion knows."""
    one = made("H shape=B-open at=chin by=palm off=3 palm=in fingers=up")
    assert not touches(one.sign.segments[0], one.sign)
    assert measure_touches(one).touches_first
    assert measured(one, one.events.start) < 0.0
    away = made("H shape=B-open at=chin by=palm off=9 palm=in fingers=up")
    events = measure_touches(away)
    assert not events.touches_first
    assert events.gap_first_cm is not None
    assert 0.5 < events.gap_first_cm < 9.0


def test_arms_of_the_other_side_count() -> None:
    weak = "w.shape=B w.at=space-low-mid w.palm=down w.fingers=in-in-fwd"
    one = made(f"H shape=1 at=forearm-weak by=index palm=down fingers=in-fwd {weak}", hands="base")
    assert measure_touches(one).touches_first
    (hand_alone,) = measure_skin_clearances(one.clip, [one.events.start], ("right",))
    assert hand_alone == pytest.approx(measure_touches(one).gap_first_cm)


def test_whose_touches_count() -> None:
    def sides(hands: str, seed: int | None = None) -> tuple[str, ...]:
        signer = STANDARD if seed is None else draw_signer(seed)
        return find_touching_sides(hands, signer)

    assert sides("one") == sides("base") == ("right",)
    assert sides("one", LEFT_HANDED) == ("left",)
    assert sides("symmetric") == sides("alternating", LEFT_HANDED) == SIDES
