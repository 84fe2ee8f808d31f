"""networks.phases: the strokes of a word by the phases of its frames, and frames in which one hand is alone."""

from __future__ import annotations

import numpy as np

from signsplice.splicing.networks.phases import frames_alone, stroke_span


def scores(phases: str, **doubtful: float) -> np.ndarray:
    """Scores (T, 5) of frames whose phases are certain: rest, preparation, hold, Stroke, retraction by their first
    letters; those of letters in ``doubtful`` are strokes with that probability, else holds.
    """
    rows = np.array([[float(letter == one) for one in "rphSt"] for letter in phases])
    for letter, probability in doubtful.items():
        rows[[one == letter for one in phases]] = [0.0, 0.0, 1.0 - probability, probability, 0.0]
    return np.asarray(np.log(np.maximum(rows, 1e-9)))


def span(phases: str, active: tuple[int, int] | None = None, **doubtful: float) -> tuple[int, int] | None:
    raised = np.zeros(len(phases), bool)
    raised[slice(*(active or (0, None)))] = True
    return stroke_span(scores(phases, **doubtful), raised)


def test_a_stroke_goes_from_the_first_movement_to_the_last() -> None:
    assert span("rphhSShShtr") == (4, 7)
    assert span("SS") == (0, 1)


def test_frames_that_may_be_movements_belong_to_the_stroke_beside_them() -> None:
    assert span("rphhSSdhhtr", d=0.08) == (4, 6)
    assert span("rphhSShhdtr", d=0.08) == (4, 8), "near it too"
    assert span("rphhSShhhhhdtr", d=0.08) == (4, 5), "far from it only where one of them is sure"
    assert span("rphhSShhhhhdStr", d=0.08) == (4, 12)


def test_a_stroke_that_goes_on_where_the_arms_are_low_is_whole() -> None:
    assert span("rpppSSSSSSSSttrr", active=(2, 8)) == (4, 11)
    assert span("rSSSSSSSSSSSttrr", active=(6, 13)) == (1, 11)
    assert span("rpppSSSSttttrSSr", active=(2, 9)) == (4, 7), "but not what lies at rest as a whole"


def test_the_stroke_of_a_sign_that_is_all_hold_is_its_middle() -> None:
    assert span("rphhhhhtr") == (4, 4)
    assert span("rrppptttrr") is None


def test_a_hand_is_alone_while_the_other_rests() -> None:
    wrists = np.zeros((40, 2, 3))
    wrists[5:25, 1, 1] = 0.5  # one hand
    wrists[15:35, 0, 1] = 0.5  # then the other too, and on
    assert np.flatnonzero(frames_alone(wrists)).tolist() == list(range(25, 35))
    assert np.flatnonzero(frames_alone(wrists[:, ::-1])).tolist() == list(range(5, 15))
    wrists[30:, 0, 1] = 0.0  # not much longer than the first
    assert not frames_alone(wrists).any()
    assert not frames_alone(wrists[:1]).any()
