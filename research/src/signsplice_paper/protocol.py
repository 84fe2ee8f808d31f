"""The protocol: which pairs are judged, and how: the test part of a split of one corpus, one pair at a time, timed.

A bundle may be judged only if it was trained on the same corpus and on the training part of the split, or on a corpus
to teach on, whose words and signers are in no corpus to judge on: so it never saw a pair on which it is judged. If all
splits have one training part, one bundle serves all.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from signsplice.errors import InputError
from signsplice.motion import FloatArray
from signsplice.signer.signer import stream
from signsplice_paper import extra_metrics, metrics, viewed
from signsplice_paper.prediction import Prediction, System
from signsplice_workshop.corpora import readable_pairs
from signsplice_workshop.corpora.pairs import Pairs

Answer = Callable[[int], Prediction]
"""A pair's number -> a system's prediction."""
Positions = tuple[int | None, int | None]
Progress = Callable[[int, int], None]

SPLITS = ("random", "unseen-words", "unseen-signer", "unseen-both")
SCORES_WITH_BONES_KEPT = ("accuracy", "mse", "bleu-4", "joint_jumps", "bone_change")
"""Scores with a second value, ``..._bones``, of frames that keep the skeleton's bones; on the pairs of ``viewed``."""
WARM_UP = 3
"""Untimed calls before the first timed one, because first calls allocate."""


@dataclass(frozen=True)
class Protocol:
    """The pairs that are judged.

    - corpus: hash of the corpus
    - split: name of the split
    - part: train, valid or test
    - pair_numbers: the pairs' numbers in the corpus
    - fps: frames per second of the corpus
    """

    corpus: str
    split: str
    part: str
    pair_numbers: tuple[int, ...]
    fps: float

    @property
    def signature(self) -> str:
        """The protocol in one line; rows are comparable if it is the same."""
        return (
            f"paper|corpus:{self.corpus}|split:{self.split}|part:{self.part}|pairs:{len(self.pair_numbers)}|fps:{self.fps:g}"
            f"|batch:1|threads:1|clock:search+generation|warm-up:{WARM_UP}"
        )


@dataclass(frozen=True)
class Judged:
    """A system's scores.

    - scores: by name: those of ``metrics``; of at most ``viewed.N_VIEWED`` pairs joint jumps and changes of bone
      length (``viewed``), and for systems that give joint positions without rotations ``SCORES_WITH_BONES_KEPT``;
      ``ms_mean`` and ``ms_median`` of the time per pair, and ``frames_ms``, the duration of the true transition
    - n_pairs: number of pairs judged
    """

    scores: dict[str, float]
    n_pairs: int


def choose(pairs: Pairs, split: str, part: str = "test", limit: int | None = None) -> Protocol:
    """Returns the pairs of a part of a split; a fixed choice of ``limit`` of them if there are more.

    Raises ``InputError`` if the split or part is unknown or holds no pair.
    """
    numbers = pairs.split(split, part)
    if limit is not None and limit < len(numbers):
        order = stream("paper-limit", len(numbers)).permutation(len(numbers))[:limit]
        numbers = [numbers[k] for k in sorted(order.tolist())]
    if not numbers:
        raise InputError(f"{pairs.folder}: no pair in {split} {part}; make a corpus of more words")
    return Protocol(pairs.head["hash"], split, part, tuple(numbers), pairs.head["fps"])


def check_allowed(trained_on: Mapping[str, Any], pairs: Pairs, protocol: Protocol, name: str = "bundle") -> None:
    """Raises ``InputError`` if a bundle must not be judged by a protocol: it was trained on another corpus (except one
    to teach on), on another training part than the split's, or on a pair that is judged.

    trained_on: the ``corpus`` and ``split`` that it was trained on.
    """
    # A corpus to teach on has this one split.
    if trained_on.get("split") == readable_pairs.TAUGHT and pairs.truth_kind == readable_pairs.TRUTH:
        return
    if trained_on.get("corpus") != protocol.corpus:
        raise InputError(
            f"{name}: trained on corpus {trained_on.get('corpus')}, judged on {protocol.corpus}; "
            "judge it on the pairs it was trained on, or move it away"
        )
    split = trained_on.get("split")
    if not isinstance(split, str):
        raise InputError(f"{name}: states no split that it was trained on, expected one of {', '.join(SPLITS)}")
    training_pairs = pairs.split(split, "train")
    seen_pairs = set(training_pairs) | set(pairs.split(split, "valid"))
    if protocol.part == "test" and seen_pairs & set(protocol.pair_numbers):
        raise InputError(
            f"{name}: trained on split {split}, and {len(seen_pairs & set(protocol.pair_numbers))} of the "
            f"{len(protocol.pair_numbers)} pairs of {protocol.split} {protocol.part} were seen in training"
        )
    if training_pairs != pairs.split(protocol.split, "train"):
        raise InputError(
            f"{name}: trained on split {split}, judged on {protocol.split}, which has another training part"
        )


def may_judge(trained_on: Mapping[str, Any], pairs: Pairs, protocol: Protocol) -> bool:
    """Returns whether ``check_allowed`` accepts a bundle."""
    try:
        check_allowed(trained_on, pairs, protocol)
    except InputError:
        return False
    return True


def make_answer(pairs: Pairs, system: System) -> Answer:
    """Returns the predictor of a system that sees only joint coordinates: from a pair's number to its prediction."""

    def answer(number: int) -> Prediction:
        p, q = pairs.index[number, :2].tolist()
        return system.predict(pairs.word(p).astype(np.float64), pairs.word(q).astype(np.float64))

    return answer


def make_position_answer(pairs: Pairs, system: System) -> Callable[[int], Positions]:
    """Returns the predictor of splice positions, without frames, of a system that sees only joint coordinates."""

    def predict_positions(number: int) -> Positions:
        p, q = pairs.index[number, :2].tolist()
        return system.positions(pairs.word(p).astype(np.float64), pairs.word(q).astype(np.float64))

    return predict_positions


def judge(answer: Answer, pairs: Pairs, protocol: Protocol, progress: Progress | None = None) -> Judged:
    """Returns the scores of a system on the pairs of a protocol, judged one at a time.

    Raises ``InputError`` for a prediction with wrong shapes, values that are not finite, or positions out of range.
    """
    layouts: dict[int, extra_metrics.NumberLayout] = {}
    viewer = viewed.Viewer(pairs)
    order = stream("viewed", len(protocol.pair_numbers)).permutation(len(protocol.pair_numbers))[: viewed.N_VIEWED]
    viewed_numbers = {protocol.pair_numbers[k] for k in order.tolist()}
    for number in protocol.pair_numbers[:WARM_UP]:
        answer(number)
    scores: dict[str, list[metrics.PairScore]] = {"": [], "_bones": []}
    views: dict[str, list[viewed.PairView]] = {"": [], "_bones": []}
    seconds = []
    for done, number in enumerate(protocol.pair_numbers, 1):
        p, q = pairs.index[number, :2].tolist()
        before, after = pairs.word(p).astype(np.float64), pairs.word(q).astype(np.float64)
        start = time.perf_counter()
        prediction = answer(number)
        seconds.append(time.perf_counter() - start)
        _check_prediction(prediction, (before, after), number)
        signer = pairs.signer(p)
        if signer not in layouts:
            layouts[signer] = extra_metrics.make_number_layout(pairs.word_clip(p), pairs.spaces[signer])
        pre, post, frames = pairs.truth(number)
        truth = (pre, post, frames.astype(np.float64))
        scores[""].append(metrics.score(prediction, truth, (before, after), layouts[signer]))
        if number in viewed_numbers:
            views[""].append(viewer.view(number, prediction))
            if prediction.rotations is None:
                fitted = viewer.fit_bones(number, prediction)
                scores["_bones"].append(metrics.score(fitted, truth, (before, after), layouts[signer]))
                views["_bones"].append(viewer.view(number, fitted))
        if progress is not None:
            progress(done, len(protocol.pair_numbers))
    summary = metrics.summarise(scores[""]) | viewed.summarise(views[""])
    if scores["_bones"]:
        with_bones = metrics.summarise(scores["_bones"]) | viewed.summarise(views["_bones"])
        summary |= {f"{name}_bones": with_bones[name] for name in SCORES_WITH_BONES_KEPT}
    times = _summarise_times(seconds) | {"frames_ms": 1e3 * summary["n_frames"] / protocol.fps}
    return Judged(summary | times, len(seconds))


def compute_accuracy(answer: Answer, pairs: Pairs, numbers: Sequence[int]) -> float:
    """Returns the Accuracy of a system on some pairs, NaN without any."""
    accuracies = [
        metrics.compute_accuracy(answer(k).frames, np.asarray(pairs.truth(k)[2], np.float64)) for k in numbers
    ]
    return float(np.mean(accuracies)) if accuracies else float("nan")


def compute_paa(positions_of: Callable[[int], Positions], pairs: Pairs, numbers: Sequence[int]) -> float:
    """Returns the PAA of positions on some pairs, NaN without any."""
    true = pairs.index[list(numbers), 2:4].tolist() if numbers else []
    errors = [
        metrics.measure_position_errors(positions_of(k), (pre, post))
        for k, (pre, post) in zip(numbers, true, strict=True)
    ]
    return metrics.summarise_positions(errors)["paa"]


def _check_prediction(prediction: Prediction, words: tuple[FloatArray, FloatArray], number: int) -> None:
    n_before, n_after, n_numbers = len(words[0]), len(words[1]), words[0].shape[1]
    frames = prediction.frames
    if frames.ndim != 2 or frames.shape[1] != n_numbers or not np.isfinite(frames).all():
        raise InputError(f"pair {number}: predicted frames {frames.shape}, expected finite (n, {n_numbers})")
    for token, position, count in (("pre", prediction.pre, n_before), ("post", prediction.post, n_after)):
        if position is not None and not 0 <= position < count:
            raise InputError(f"pair {number}: predicted {token} {position}, expected a frame of a word of {count}")


def _summarise_times(seconds: Sequence[float]) -> dict[str, float]:
    return {"ms_mean": 1e3 * float(np.mean(seconds)), "ms_median": 1e3 * float(np.median(seconds))}
