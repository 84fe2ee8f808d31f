"""The contracts of cutters, transitions and durations: a new one is a small class that is passed to splice."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from signsplice.errors import InputError
from signsplice.motion import Clip, concatenate, rotation
from signsplice.splicing.contracts import Cut, Cutter, Duration, Gap, Method, Transition, find
from signsplice.splicing.curves import CurveProblem, CurveTransition
from signsplice.splicing.engine import SpliceOptions, Stream, inbetween, splice, stream
from signsplice.splicing.seam import SeamScore


class Freeze(Transition):
    """Holds the first pose of the next sign."""

    name, summary = "freeze", "the first pose of the next sign"

    def between(self, gap: Gap) -> Clip:
        return concatenate([gap.after[:1]] * gap.n_frames)


class Middle(Cutter):
    """Leaves and enters every sign near its middle."""

    name, summary = "middle", "the middle of each clip"

    def cut(self, before: Clip, after: Clip) -> Cut:
        return Cut(len(before) // 2 + 5, len(after) // 2 - 5)


class ByEntry(Duration):
    """As many frames as the number of the frame at which the next sign is entered."""

    name, summary = "by-entry", "the number of the entry frame"

    def seconds(self, before: Clip, after: Clip, cut: Cut) -> float:
        return cut.post / before.fps


def spliced(clips: Sequence[Clip], options: SpliceOptions) -> tuple[Clip, list[SeamScore]]:
    """A sentence and its seams by ``splice``."""
    result = splice(clips, options)
    return result.clip, list(result.seams)


def streamed(clips: Sequence[Clip], options: SpliceOptions) -> tuple[Clip, list[SeamScore]]:
    """A sentence and its seams by ``stream``."""
    pieces = list(stream(clips, options))
    return concatenate([piece.clip for piece in pieces]), [piece.seam for piece in pieces if piece.seam is not None]


Join = Callable[[Sequence[Clip], SpliceOptions], tuple[Clip, list[SeamScore]]]
both = pytest.mark.parametrize("join", [spliced, streamed])


@both
def test_a_new_transition_makes_the_frames(join: Join, sentence: list[Clip]) -> None:
    options = SpliceOptions("ends", Freeze(), transition_time=0.2, person=0.0, free_hand="transition")
    clip, seams = join(sentence[:2], options)
    assert [seam.n_transition for seam in seams] == [6]
    new = clip.local_rotations[len(sentence[0]) :][:6]
    np.testing.assert_array_equal(new[:, 1:], np.repeat(sentence[1].local_rotations[:1, 1:], 6, axis=0))
    assert splice(sentence, options).transition == Stream(options).transition == "freeze"


@both
def test_a_new_cutter_chooses_the_cuts(join: Join, sentence: list[Clip]) -> None:
    options = SpliceOptions(Middle(), "slerp", "fixed")
    _, seams = join(sentence, options)
    assert [seam.pre_frame for seam in seams] == [len(clip) // 2 + 5 for clip in sentence[:-1]]
    assert [seam.post_frame for seam in seams] == [len(clip) // 2 - 5 for clip in sentence[1:]]
    assert splice(sentence, options).cutter == Stream(options).cutter == "middle"


@both
def test_a_new_duration_chooses_the_number_of_frames(join: Join, sentence: list[Clip]) -> None:
    _, seams = join(sentence, SpliceOptions("pose-velocity", "slerp", ByEntry()))
    assert [seam.n_transition for seam in seams] == [seam.post_frame for seam in seams]


@both
def test_a_new_curve_is_a_function(join: Join, sentence: list[Clip]) -> None:
    def slow_start(problem: CurveProblem) -> np.ndarray:
        u = problem.times[:, None, None] / problem.seconds  # (n, 1, 1)
        return np.asarray(u**2 * problem.displacement)

    transition = CurveTransition("slow-start", "the square of time", slow_start)
    options = SpliceOptions("ends", transition, transition_time=0.3, person=0.0, free_hand="transition")
    clip, _ = join(sentence[:2], options)
    first, *new, last = clip.local_rotations[len(sentence[0]) - 1 :][:11]
    expected = (np.arange(1, 10)[:, None] / 10) ** 2 * rotation.angle_between(first, last)  # (9, J)
    np.testing.assert_allclose(rotation.angle_between(first, np.stack(new)), expected, atol=1e-6)


def test_a_new_transition_fills_the_gaps_of_a_clip(sentence: list[Clip]) -> None:
    result = inbetween(sentence[0], [(20, 26)], Freeze())
    assert result.transition == "freeze"
    expected = np.repeat(sentence[0].local_rotations[26:27], 6, axis=0)
    np.testing.assert_array_equal(result.clip.local_rotations[20:26], expected)


def test_a_transition_fills_all_gaps_of_a_sentence_at_once(sentence: list[Clip]) -> None:
    class Batched(Transition):
        name, summary = "batched", "for tests"

        def fill(self, gaps: Sequence[Gap]) -> list[Clip]:
            sizes.append(len(gaps))
            return Freeze().fill(gaps)

        def warnings(self, gap: Gap) -> tuple[str, ...]:
            return (f"{gap.n_frames} new frames",)

    sizes: list[int] = []
    options = SpliceOptions("pose-velocity", Batched(), transition_time=0.2)
    result = splice(sentence, options)
    assert sizes == [len(sentence) - 1]
    assert all("6 new frames" in seam.warnings for seam in result.seams)
    sizes.clear()
    list(stream(sentence, options))
    assert [size for size in sizes if size] == [1] * (len(sentence) - 1)


def test_a_transition_of_the_wrong_length_is_refused(sentence: list[Clip]) -> None:
    class Short(Freeze):
        def between(self, gap: Gap) -> Clip:
            return gap.after[:1]

    with pytest.raises(InputError, match="transition freeze made 1 frames, expected 15"):
        splice(sentence[:2], SpliceOptions(transition=Short(), transition_time=0.5))


def test_a_cut_outside_its_clips_is_refused(sentence: list[Clip]) -> None:
    class Outside(Middle):
        def cut(self, before: Clip, after: Clip) -> Cut:
            return Cut(len(before), 0)

    with pytest.raises(InputError, match=r"cutter middle chose Cut\(pre=\d+, post=0\) for clips of \d+ and \d+ frames"):
        splice(sentence[:2], SpliceOptions(cutter=Outside()))


def test_a_cutter_of_whole_sentences_is_called_once_and_for_the_last_word_alone(sentence: list[Clip]) -> None:
    class Whole(Cutter):
        name, summary = "whole", "for tests"

        def __init__(self, n_cuts: int) -> None:
            self.n_cuts = n_cuts

        def cut_all(self, clips: Sequence[Clip]) -> list[Cut]:
            calls.append(len(clips))
            return [Cut(len(clip) // 2 + 5, 7) for clip in clips[: self.n_cuts]]

    calls: list[int] = []
    n_seams = len(sentence) - 1
    plain = SpliceOptions(transition="slerp", duration="fixed")
    _, seams = spliced(sentence, replace(plain, cutter=Whole(n_seams)))
    assert calls == [len(sentence), 2]
    assert [seam.post_frame for seam in seams] == [7] * n_seams
    _, seams = streamed(sentence, replace(plain, cutter=Whole(1)))
    assert calls[2:] == [2] * (n_seams + 1), "a stream sees two words at a time"
    assert [seam.post_frame for seam in seams] == [7] * n_seams
    clip, _ = spliced(sentence[:1], replace(plain, cutter=Whole(0)))
    assert len(clip) == len(sentence[0])
    for wrong in (n_seams - 1, n_seams + 1):
        with pytest.raises(InputError, match=f"cutter whole chose {wrong} cuts for {len(sentence)} clips"):
            splice(sentence, replace(plain, cutter=Whole(wrong)))


def test_a_method_is_found_by_its_name_or_the_names_are_listed() -> None:
    table: dict[str, Method] = {method.name: method for method in (Freeze(), Middle())}
    assert find("method", "middle", table) is table["middle"]
    assert not table["middle"].learned
    with pytest.raises(InputError, match="no method 'x', expected one of freeze, middle"):
        find("method", "x", table)
