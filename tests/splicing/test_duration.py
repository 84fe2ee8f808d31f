"""splicing.durations: how long transitions take, against their formulas."""

from __future__ import annotations

import numpy as np
import pytest

from signsplice.errors import InputError
from signsplice.motion import Clip, resample
from signsplice.rig.info import arms
from signsplice.splicing.contracts import Cut, find
from signsplice.splicing.durations import DURATIONS, HUMAN, RUNNING_S, TravelDuration, travel_widths
from signsplice.splicing.engine import SpliceOptions, splice

PRE, POST = 43, 12
"""Frames of the first and the fifth word of the sentence between which a hand has far to go."""
TEMPO = DURATIONS["tempo"]


def test_far_transitions_take_as_long_as_people_take(sentence: list[Clip]) -> None:
    before, after = sentence[0], sentence[4]
    widths = travel_widths(arms(before), arms(after), PRE, POST)
    assert widths > 1.0
    expected = 0.1 + 0.2 * np.log2(1.0 + widths)
    assert TravelDuration(RUNNING_S).seconds(before, after, Cut(PRE, POST)) == pytest.approx(expected)
    assert TEMPO.seconds(before, after, Cut(PRE, POST)) == pytest.approx(expected / HUMAN.sign_fraction), (
        "as signs alone"
    )


def test_no_transition_is_shorter_than_the_human_median(sentence: list[Clip]) -> None:
    assert TEMPO.seconds(sentence[0], sentence[0], Cut(40, 40)) == 0.25
    assert DURATIONS["fixed"].seconds(sentence[0], sentence[4], Cut(PRE, POST)) == 0.25


def test_transitions_last_longer_at_slower_tempos(sentence: list[Clip]) -> None:
    clips, cut = (sentence[0], sentence[4]), Cut(PRE, POST)
    running = TravelDuration(RUNNING_S).seconds(*clips, cut)
    assert TravelDuration(1.4).seconds(*clips, cut) == pytest.approx(2.0 * running)
    assert TravelDuration(0.5).seconds(*clips, cut) == running


def test_rates_of_frames_do_not_change_durations(sentence: list[Clip]) -> None:
    before, after = (resample(sentence[k], 60.0) for k in (0, 4))
    expected = TEMPO.seconds(sentence[0], sentence[4], Cut(PRE, POST))
    assert TEMPO.seconds(before, after, Cut(2 * PRE, 2 * POST)) == pytest.approx(expected, rel=0.02)


def test_default_transitions_are_near_those_of_people(sentence: list[Clip]) -> None:
    for tempo, most in (("citation", 0.5), ("natural", 0.35)):
        seconds = [seam.seconds for seam in splice(sentence, SpliceOptions(tempo=tempo)).seams]
        assert min(seconds) >= 0.25 - 0.5 / 30.0
        assert np.median(seconds) < most


def test_an_unknown_duration_is_refused() -> None:
    with pytest.raises(InputError, match="no duration 'x', expected one of tempo, fixed"):
        find("duration", "x", DURATIONS)
