"""Which pairs are judged and how: the test part of a split of one corpus, a pair at a time, timed.

A bundle may be judged only where it was trained on the same corpus, and on the training part that belongs to the
split, so that no pair it learned from is among those it is judged on. ``unseen-signer`` trains as ``random`` does:
one bundle serves both.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from signsplice.errors import InputError
from signsplice.paper import extra_metrics, metrics
from signsplice.paper.prediction import Prediction, System
from signsplice.synth.corpus import EXTENT, Pairs
from signsplice.synth.rng import stream

Float = NDArray[np.float64]
Answer = Callable[[int], Prediction]
"""A pair's number -> what a system says about it."""
Progress = Callable[[int, int], None]

SPLITS = ("random", "unseen-words", "unseen-signer")
WARM_UP = 3
"""Calls before the clock runs: a first call allocates."""


@dataclass(frozen=True)
class Protocol:
    """What is judged: pairs by number, of a part of a split of a corpus (by hash)."""

    corpus: str
    split: str
    part: str
    numbers: tuple[int, ...]
    fps: float

    @property
    def signature(self) -> str:
        """The recipe of the judging, in one line; two tables' rows are of one kind where this is the same."""
        return (
            f"paper|corpus:{self.corpus}|split:{self.split}|part:{self.part}|pairs:{len(self.numbers)}|fps:{self.fps:g}"
            f"|batch:1|threads:1|clock:search+generation|warm-up:{WARM_UP}"
        )


@dataclass(frozen=True)
class Judged:
    """A system's scores by name, ``ms_mean`` and ``ms_median`` of the time for a pair among them."""

    scores: dict[str, float]
    n_pairs: int


def choose(pairs: Pairs, split: str, part: str = "test", limit: int | None = None) -> Protocol:
    """The pairs of a part of a split; ``limit`` of them, drawn once and for all, where there are more.

    Raises ``InputError`` where the split or part is unknown or holds no pair.
    """
    numbers = pairs.split(split, part)
    if limit is not None and limit < len(numbers):
        drawn = stream("paper-limit", len(numbers)).permutation(len(numbers))[:limit]
        numbers = [numbers[k] for k in sorted(drawn.tolist())]
    if not numbers:
        raise InputError(f"{pairs.folder}: no pair in {split} {part}; make a corpus of more words")
    return Protocol(pairs.head["hash"], split, part, tuple(numbers), pairs.head["fps"])


def refuse(facts: Mapping[str, Any], pairs: Pairs, protocol: Protocol, name: str = "bundle") -> None:
    """Raise ``InputError`` where a bundle must not be judged so: trained on another corpus, on another training part
    than the split's, or on a pair that is judged.
    """
    if facts.get("corpus") != protocol.corpus:
        raise InputError(
            f"{name}: trained on corpus {facts.get('corpus')}, judged on {protocol.corpus}; "
            "judge it on the pairs it was trained on, or move it away"
        )
    trained = facts.get("split")
    if not isinstance(trained, str):
        raise InputError(f"{name}: says no split it was trained on, expected one of {', '.join(SPLITS)}")
    learned = pairs.split(trained, "train")
    seen = set(learned) | set(pairs.split(trained, "valid"))
    if protocol.part == "test" and seen & set(protocol.numbers):
        raise InputError(
            f"{name}: trained on split {trained}, and {len(seen & set(protocol.numbers))} of the "
            f"{len(protocol.numbers)} pairs of {protocol.split} {protocol.part} were seen in training"
        )
    if learned != pairs.split(protocol.split, "train"):
        raise InputError(
            f"{name}: trained on split {trained}, judged on {protocol.split}, whose training part is another"
        )


def may_judge(facts: Mapping[str, Any], pairs: Pairs, protocol: Protocol) -> bool:
    """Whether ``refuse`` lets a bundle pass."""
    try:
        refuse(facts, pairs, protocol)
    except InputError:
        return False
    return True


def answers(pairs: Pairs, system: System) -> Answer:
    """How a system that sees only the 159 numbers answers for a pair."""

    def answer(number: int) -> Prediction:
        p, q = pairs.index[number, :2].tolist()
        return system.predict(pairs.word(p).astype(np.float64), pairs.word(q).astype(np.float64))

    return answer


def judge(answer: Answer, pairs: Pairs, protocol: Protocol, progress: Progress | None = None) -> Judged:
    """A system's scores on the pairs of a protocol, one at a time; raises ``InputError`` for a prediction that is
    none.
    """
    half = len(pairs.head["words"]) // 2
    bodies: dict[int, extra_metrics.NumberLayout] = {}
    for number in protocol.numbers[:WARM_UP]:
        answer(number)
    scores, seconds = [], []
    for done, number in enumerate(protocol.numbers, 1):
        p, q = pairs.index[number, :2].tolist()
        before, after = pairs.word(p).astype(np.float64), pairs.word(q).astype(np.float64)
        begun = time.perf_counter()
        prediction = answer(number)
        seconds.append(time.perf_counter() - begun)
        _check(prediction, len(before), len(after), number)
        who = p // half
        if who not in bodies:
            bodies[who] = extra_metrics.number_layout(pairs.word_clip(p), EXTENT * pairs.signers[who].stature_cm)
        pre, post, frames = pairs.truth(number)
        scores.append(metrics.score(prediction, (pre, post, frames.astype(np.float64)), (before, after), bodies[who]))
        if progress is not None:
            progress(done, len(protocol.numbers))
    times = _milliseconds(seconds)
    return Judged(metrics.summary(scores) | times, len(scores))


def _check(prediction: Prediction, n_before: int, n_after: int, number: int) -> None:
    frames = prediction.frames
    if frames.ndim != 2 or frames.shape[1] != metrics.NUMBERS or not np.isfinite(frames).all():
        raise InputError(f"pair {number}: predicted frames {frames.shape}, expected finite (n, {metrics.NUMBERS})")
    for what, position, count in (("pre", prediction.pre, n_before), ("post", prediction.post, n_after)):
        if position is not None and not 0 <= position < count:
            raise InputError(f"pair {number}: predicted {what} {position}, expected a frame of a word of {count}")


def _milliseconds(seconds: Sequence[float]) -> dict[str, float]:
    return {"ms_mean": 1e3 * float(np.mean(seconds)), "ms_median": 1e3 * float(np.median(seconds))}
