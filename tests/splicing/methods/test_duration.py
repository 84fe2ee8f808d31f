"""splicing.duration: the rules against their formulas."""

from __future__ import annotations

import numpy as np
import pytest

from signsplice.errors import InputError
from signsplice.motion import Clip
from signsplice.rig.info import arms
from signsplice.splicing.gap import Cut
from signsplice.splicing.methods import find
from signsplice.splicing.methods.duration import DURATIONS, travel_widths

PRE, POST = 43, 12
"""Frames of the first and the fifth word of the sentence in which both hands move fast."""


def test_travel_follows_its_law_and_fixed_is_the_human_median(sentence: list[Clip]) -> None:
    before, after = sentence[0], sentence[4]
    width = travel_widths(arms(before), arms(after), PRE, POST)
    travel, fixed = (DURATIONS[name].seconds(before, after, Cut(PRE, POST)) for name in ("travel", "fixed"))
    assert travel == pytest.approx(0.051 + 0.149 * np.log2(1 + width / 0.15))
    assert fixed == 0.25


def test_tempo_is_at_least_the_human_median(sentence: list[Clip]) -> None:
    assert DURATIONS["tempo"].seconds(sentence[0], sentence[0], Cut(40, 40)) == 0.25


def test_speed_is_distance_over_the_mean_speed_of_both_ends(sentence: list[Clip]) -> None:
    before, after = sentence[0], sentence[4]
    a, b = arms(before), arms(after)
    distances = np.linalg.norm(b.wrists[POST] - a.wrists[PRE], axis=-1)
    hand = int(np.argmax(distances))
    steps = (a.wrists[PRE, hand] - a.wrists[PRE - 1, hand], b.wrists[POST + 1, hand] - b.wrists[POST, hand])
    speed = np.mean([np.linalg.norm(step) * 30.0 for step in steps])
    seconds = DURATIONS["speed"].seconds(before, after, Cut(PRE, POST))
    assert seconds == pytest.approx(distances[hand] / speed)


def test_an_unknown_duration_is_refused() -> None:
    with pytest.raises(InputError, match="no duration 'x', expected one of tempo"):
        find("duration", "x", DURATIONS)
