"""networks.phases: the strokes of a word by the phases of its frames, and frames in which one hand is alone."""

from __future__ import annotations

import numpy as np

from signsplice.splicing.features import frames_alone, stroke_span


def scores(phases: str, **doubtful: float) -> np.ndarray:
    """Scores (T, 5) of frames whose phases are certain: rest, preparation, hold, Stroke, retraction by their first
    letters; those of letters in ``doubtful`` are strokes with that probability, else holds.
    """
    rows = np.array([[float(letter == one) for one in "rphSt"] for letter in phases])
    for letter, probability in doubtful.items():
        rows[[one == letter for one in phases]] = [0.0, 0.0, 1.0 - probability, probability, 0.0]
    return np.asarray(np.log(np.maximum(rows, 1e-9)))


def span(
    phases: str, active: tuple[int, int] | None = None, low: str = "r", **doubtful: float
) -> tuple[int, int] | None:
    """The strokes; a hand is as low as it rests in phases of ``low``. L: as S."""
    raised = np.zeros(len(phases), bool)
    raised[slice(*(active or (0, None)))] = True
    wrists = np.zeros((len(phases), 2, 3))
    wrists[:, 1, 1] = [0.0 if letter in low else 0.5 for letter in phases]
    return stroke_span(scores(phases.replace("L", "S"), **doubtful), raised, wrists)


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


def test_hands_that_part_before_they_rise_and_meet_as_they_sink_make_no_stroke() -> None:
    """Seen so where a signer's hands rest on one another."""
    assert span("rLLLpppppSSSSttttLLr", low="rL") == (9, 12)
    assert span("rLLLpppppSSSSttttLLr", low="r") == (1, 18), "but hands that are higher than they rest"
    assert span("rLLLpphhhhhSSSSttttr", low="rL") == (11, 14), "they may wait for the stroke"
    assert span("rLLLhhhhhSSSSttttr", low="rL") == (1, 12), "but not in place of the way"
    assert span("r" + 10 * "L" + "pppppSSSSttttr", low="rL") == (1, 19), "or move for longer"
    assert span("rrLLLLttr", low="rL") == (2, 5), "or sign nothing else"


def test_a_moment_amid_the_way_is_no_stroke() -> None:
    assert span("rppSSSppppSSSSSttttSStttr") == (10, 14)
    assert span("rppSSSSSppppSSSSSttttr") == (3, 16), "what takes longer is"
    assert span("rppSSShhhhhSSSSSttttr") == (3, 15), "and what leads to a hold"


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
