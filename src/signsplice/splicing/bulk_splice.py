"""Many sentences spliced together: the same frames as one by one, bit for bit, in less time.

A word is read by the networks once, whatever the number of sentences. What is computed frame by frame (curves, what the
network is shown and answers, poses, collisions, scores) is computed for the seams of many sentences in one go; every
frame gets the numbers that it would get alone.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from typing import NamedTuple, TypeVar

from signsplice.errors import SignspliceError
from signsplice.motion import Clip
from signsplice.splicing.engine import joined_sentence
from signsplice.splicing.gap import FilledGap
from signsplice.splicing.options import SpliceOptions
from signsplice.splicing.result import SpliceResult
from signsplice.splicing.seam import seam_positions
from signsplice.splicing.sentence import PlannedWords, SentenceBuilder
from signsplice.splicing.transition_cache import TransitionCache

_WORDS_AT_ONCE = 256
"""About so many words are worked on together: more take more memory and are hardly faster."""
Result = SpliceResult | SignspliceError
T = TypeVar("T")


class _Asked(NamedTuple):
    clips: Sequence[Clip]
    options: SpliceOptions
    starts: Collection[int]
    pauses: Mapping[int, str] | None
    brows: Mapping[int, str] | None


def splice_many(
    sentences: Sequence[Sequence[Clip]],
    options: Sequence[SpliceOptions] | SpliceOptions | None = None,
    transitions: TransitionCache | None = None,
    starts: Sequence[Collection[int]] | None = None,
    pauses: Sequence[Mapping[int, str] | None] | None = None,
    brows: Sequence[Mapping[int, str] | None] | None = None,
) -> list[Result]:
    """What ``splice`` gives of each sentence alone, in order; where it raises a ``SignspliceError``, that error.

    options: of all sentences, or of each.
    transitions: where those of earlier calls are found.
    starts, pauses, brows: of each sentence, as in ``splice``.

    Clips that are one word should be one object in all sentences: what is computed of a word is kept as long as that
    object lives. Raises ``ValueError`` where there are not as many options, starts, pauses or brows as sentences.
    """
    if options is None or isinstance(options, SpliceOptions):
        options = [options or SpliceOptions()] * len(sentences)
    if starts is None:
        starts = [()] * len(sentences)
    out: list[Result] = []
    block: list[_Asked] = []
    nothing = [None] * len(sentences)
    for one in zip(
        sentences,
        options,
        starts,
        nothing if pauses is None else pauses,
        nothing if brows is None else brows,
        strict=True,
    ):
        block.append(_Asked(*one))
        if sum(len(sentence.clips) for sentence in block) >= _WORDS_AT_ONCE:
            out += _spliced(block, transitions)
            block = []
    return out + _spliced(block, transitions)


def _spliced(block: Sequence[_Asked], transitions: TransitionCache | None) -> list[Result]:
    """``splice_many`` of few sentences, each step for all of them."""
    done: dict[int, Result] = {}

    def each(step: Callable[[int], T], rows: Iterable[int]) -> dict[int, T]:
        """What a step makes of every sentence that it does not end."""
        made: dict[int, T] = {}
        for row in rows:
            try:
                made[row] = step(row)
            except SignspliceError as error:
                done[row] = error
        return made

    builders = each(lambda row: SentenceBuilder(block[row].options), range(len(block)))
    planned = each(lambda row: builders[row].plan(block[row].clips, *block[row][2:]), builders)
    filled: dict[int, list[FilledGap]] = {}
    for rows in _with_same_passes(builders, planned):
        try:
            filled |= _filled({row: (builders[row], planned[row]) for row in rows}, transitions)
        except SignspliceError:  # of some of them
            filled |= each(lambda row: _filled({row: (builders[row], planned[row])}, transitions)[row], rows)
    finished = each(lambda row: builders[row].finish(planned[row], filled[row]), filled)
    windows = [(seam.gap, seam.filled) for seams in finished.values() for seam in seams]
    began = time.perf_counter()
    positions = iter(seam_positions(windows))
    seconds = (time.perf_counter() - began) / max(1, len(finished))
    seen = {row: [next(positions) for _ in seams] for row, seams in finished.items()}

    def joined(row: int) -> SpliceResult:
        builders[row].seconds["join"] += seconds
        return joined_sentence(builders[row], [*builders[row].pieces(finished[row], seen[row]), *builders[row].end()])

    done |= each(joined, finished)
    return [done[row] for row in range(len(block))]


def _with_same_passes(builders: dict[int, SentenceBuilder], rows: Iterable[int]) -> list[list[int]]:
    """Sentences whose gaps are filled in the same way."""
    groups: dict[tuple[object, ...], list[int]] = {}
    for row in rows:
        groups.setdefault(builders[row].gap_passes.signature(id), []).append(row)
    return list(groups.values())


def _filled(
    sentences: dict[int, tuple[SentenceBuilder, PlannedWords]], transitions: TransitionCache | None
) -> dict[int, list[FilledGap]]:
    """The new frames of sentences that are filled in the same way; each takes its gaps' part of the time."""
    gaps = {row: planned.gaps for row, (_, planned) in sentences.items()}
    passes = next(builder.gap_passes for builder, _ in sentences.values())
    asked = [gap for some in gaps.values() for gap in some]
    began = time.perf_counter()
    filled = iter(passes.fill(asked) if transitions is None else transitions.fill(passes, asked))
    seconds = (time.perf_counter() - began) / max(1, sum(map(len, gaps.values())))
    for row, (one, _) in sentences.items():
        one.seconds["transition"] += seconds * len(gaps[row])
    return {row: [next(filled) for _ in some] for row, some in gaps.items()}
