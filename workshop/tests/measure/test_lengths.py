"""measure.lengths: the table of Czech signing, and the product's numbers that follow from it."""

from __future__ import annotations

import numpy as np
import pytest

from signsplice.signer import notation, planner
from signsplice.splicing import durations
from signsplice_workshop.measure import lengths

TABLE = lengths.read()


def test_the_table_holds_the_published_percentiles() -> None:
    transitions_ms = np.percentile(1e3 * TABLE.transitions, (5, 25, 50, 75, 95))
    assert transitions_ms.tolist() == [160.0, 200.0, 250.0, 320.0, 480.0]
    running_ms = np.percentile(1e3 * np.concatenate(list(TABLE.running.values())), (25, 50, 75))
    assert running_ms.tolist() == [260.0, 400.0, 540.0]
    assert (len(TABLE.alone), len(TABLE.transitions)) == (333, 621)


def test_the_product_has_the_numbers_that_the_table_gives() -> None:
    fitted = (*lengths.fit_signs(TABLE), *lengths.fit_transitions(TABLE))
    human = durations.HUMAN
    product = (human.sign_fraction, human.mean_sign_s, human.still_transition_s, human.doubling_s)
    assert fitted == pytest.approx(product, abs=0.005)
    assert np.median(TABLE.transitions) == durations.HUMAN.median_transition_s


def test_lengths_are_predicted_better_from_the_sign_alone_than_by_the_mean() -> None:
    glosses = [gloss for gloss in TABLE.running if gloss in TABLE.alone]
    actual = np.array([np.median(TABLE.running[gloss]) for gloss in glosses])
    predicted = np.array([durations.running_sign_s(float(np.median(TABLE.alone[gloss]))) for gloss in glosses])
    assert np.abs(predicted - actual).mean() < 0.9 * np.abs(np.median(actual) - actual).mean()


def test_travels_at_cuts_are_those_that_the_fit_was_made_for() -> None:
    signs = list(notation.everyday().values())[::6]
    travels = lengths.measure_travels([planner.synthesize_word(sign).clip for sign in signs])
    assert np.median(travels) == pytest.approx(np.median(lengths.TRAVEL_WIDTHS), rel=0.2)
