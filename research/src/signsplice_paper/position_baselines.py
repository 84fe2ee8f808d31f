"""Baselines of splice positions: the commonest and the mean cut of a word, the commonest cut by the partner's true
class, the cut of its nearest neighbour, and a Gaussian process; and a reader that knows the rules.

All but the last are counted or fitted for each word on the training part, by gloss. For a word that the training part
lacks they have the mean cut of all words. Frames of words before are counted from the end, since words differ in length
by signer. The reader knows ``readable`` and sees the motion.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Hashable, Mapping, Sequence

import numpy as np

from signsplice.motion import FloatArray
from signsplice_paper.extra_metrics import resample_frames
from signsplice_workshop.corpora import readable
from signsplice_workshop.corpora.pairs import Pairs
from signsplice_workshop.corpora.readable import Card

Positions = Callable[[int], tuple[int | None, int | None]]
"""A pair's number -> pre and post."""

LOOK_FRAMES = 8
"""Frames that a word is resampled to before words are compared."""
LENGTH_SCALE, NOISE = 0.5, 0.1
"""Length of the Gaussian process's kernel, in median distances of words, and standard deviation of its noise."""


class WordCuts:
    """For each word the commonest (or the mean) cut in the training part of a split next to partners of a class; a
    callable ``Positions``.

    - classes: the class of each word as a partner; all the same for None
    """

    def __init__(
        self, pairs: Pairs, split: str, commonest: bool, classes: Callable[[int], Hashable] | None = None
    ) -> None:
        self.pairs = pairs
        self.classes = classes or (lambda _: None)
        by_word: tuple[dict[Hashable, list[int]], dict[Hashable, list[int]]] = (defaultdict(list), defaultdict(list))
        for number in pairs.split(split, "train"):
            p, q, pre, post = pairs.index[number, :4].tolist()
            from_end, from_start = len(pairs.word(p)) - pre, post
            for key in (self._make_key(p, q), self._make_key(p)):
                by_word[0][key].append(from_end)
            for key in (self._make_key(q, p), self._make_key(q)):
                by_word[1][key].append(from_start)
        self._cuts = tuple(_choose_cuts(cuts, commonest) for cuts in by_word)
        self._any = tuple(round(float(np.mean([n for row in cuts.values() for n in row]))) for cuts in by_word)

    def __call__(self, number: int) -> tuple[int, int]:
        """Returns pre and post of a pair."""
        p, q = self.pairs.index[number, :2].tolist()
        n, m = len(self.pairs.word(p)), len(self.pairs.word(q))
        from_end, from_start = (
            cuts.get(self._make_key(word, partner), cuts.get(self._make_key(word), usual))
            for cuts, usual, word, partner in zip(self._cuts, self._any, (p, q), (q, p), strict=True)
        )
        return min(max(n - from_end, 0), n - 1), min(from_start, m - 1)

    def _make_key(self, word: int, partner: int | None = None) -> Hashable:
        """Returns the key of a word's cuts: its gloss, and its partner's class."""
        gloss = self.pairs.gloss(word)
        return gloss if partner is None else (gloss, self.classes(partner))


def _choose_cuts(by_word: Mapping[Hashable, list[int]], commonest: bool) -> dict[Hashable, int]:
    if commonest:
        return {key: Counter(sorted(cuts)).most_common(1)[0][0] for key, cuts in by_word.items()}
    return {key: round(float(np.mean(cuts))) for key, cuts in by_word.items()}


def make_partner_classes(pairs: Pairs) -> Callable[[int], Hashable]:
    """Returns the function from a word to its class as a partner: all properties of its card that the rules use."""
    fields = ("two_first", "two_last", "high_first", "high_last", "open_first", "open_last", "touches_last")
    return lambda word: tuple(pairs.head["words"][word]["card"][name] for name in fields)


class SimilarPartners:
    """For each word the cuts next to similar partners in the training part of a split; a callable ``Positions``.

    The similarity of words is that of their numbers in ``LOOK_FRAMES`` frames, spread evenly over each.

    - process: whether each word's cuts are weighed by a Gaussian process for each frame that occurs, with a kernel
      exp(-d^2 / 2 l^2); else the nearest partner's cut
    """

    def __init__(self, pairs: Pairs, split: str, process: bool) -> None:
        self.pairs, self.process = pairs, process
        self.usual = WordCuts(pairs, split, commonest=True)
        training_cuts: tuple[dict[str, list[tuple[int, int]]], dict[str, list[tuple[int, int]]]] = ({}, {})
        for number in pairs.split(split, "train"):
            p, q, pre, post = pairs.index[number, :4].tolist()
            training_cuts[0].setdefault(pairs.gloss(p), []).append((q, len(pairs.word(p)) - pre))
            training_cuts[1].setdefault(pairs.gloss(q), []).append((p, post))
        self.training_cuts = training_cuts
        words = (np.asarray(pairs.word(k), np.float64) for k in range(len(pairs.head["words"])))
        self.looks = np.array([resample_frames(word, LOOK_FRAMES).ravel() for word in words])
        training_looks = self.looks[sorted({word for rows in training_cuts[0].values() for word, _ in rows})]
        self.length = LENGTH_SCALE * float(np.median(_compute_distances(training_looks, training_looks)))

    def __call__(self, number: int) -> tuple[int, int]:
        """Returns pre and post of a pair."""
        p, q = self.pairs.index[number, :2].tolist()
        pre, post = self.usual(number)
        from_end, from_start = (
            self._predict_cut(k, word, partner) for k, (word, partner) in enumerate(((p, q), (q, p)))
        )
        n, m = len(self.pairs.word(p)), len(self.pairs.word(q))
        return (
            pre if from_end is None else min(max(n - from_end, 0), n - 1),
            post if from_start is None else min(from_start, m - 1),
        )

    def _predict_cut(self, side: int, word: int, partner: int) -> int | None:
        """Returns the cut of a word next to a partner; None for a word that was not taught."""
        rows = self.training_cuts[side].get(self.pairs.gloss(word))
        if rows is None:
            return None
        partners, cuts = np.array(rows).T
        distances = _compute_distances(self.looks[[partner]], self.looks[partners])[0]
        if not self.process:
            return int(cuts[distances.argmin()])
        kernel = np.exp(-0.5 * (_compute_distances(self.looks[partners], self.looks[partners]) / self.length) ** 2)
        weights = np.linalg.solve(
            kernel + NOISE**2 * np.eye(len(kernel)), np.exp(-0.5 * (distances / self.length) ** 2)
        )
        values = np.unique(cuts)
        return int(values[np.argmax([(weights * (cuts == value)).sum() for value in values])])


def _compute_distances(a: FloatArray, b: FloatArray) -> FloatArray:
    """Returns the distances (A, B) between rows."""
    squares = (a**2).sum(1)[:, None] + (b**2).sum(1)[None] - 2.0 * a @ b.T
    return np.asarray(np.sqrt(np.maximum(squares, 0.0)))


class RuleReader:
    """Reads each word's card from its motion, by ``readable.extract_card``, and applies the rules; a callable
    ``Positions``.
    """

    def __init__(self, pairs: Pairs) -> None:
        self.pairs = pairs
        self.cards: dict[int, Card | None] = {}

    def __call__(self, number: int) -> tuple[int | None, int | None]:
        """Returns pre and post of a pair; None for both if a word cannot be read."""
        p, q = (self._read_card(word) for word in self.pairs.index[number, :2].tolist())
        return (
            (None, None)
            if p is None or q is None
            else (readable.find_leave_frame(p, q), readable.find_enter_frame(p, q))
        )

    def _read_card(self, word: int) -> Card | None:
        if word not in self.cards:
            signer = self.pairs.signers[self.pairs.signer(word)]
            hands = self.pairs.head["words"][word]["hands"]
            self.cards[word] = readable.extract_card(self.pairs.word_clip(word), signer, hands)
        return self.cards[word]


BASELINES: dict[str, Callable[[Pairs, str], Positions]] = {
    "commonest cut": lambda pairs, split: WordCuts(pairs, split, commonest=True),
    "mean cut": lambda pairs, split: WordCuts(pairs, split, commonest=False),
    "commonest cut by the partner's class": lambda pairs, split: WordCuts(
        pairs, split, True, make_partner_classes(pairs)
    ),
    "nearest neighbour": lambda pairs, split: SimilarPartners(pairs, split, process=False),
    "Gaussian process": lambda pairs, split: SimilarPartners(pairs, split, process=True),
    "reader of the rules": lambda pairs, _: RuleReader(pairs),
}


def score_positions(pairs: Pairs, numbers: Sequence[int], positions: Positions) -> dict[str, float]:
    """Returns fractions of pairs: with pre exact, with post, with both, and with both within one frame. A missing
    position counts as wrong.
    """
    true = pairs.index[np.asarray(numbers), 2:4].astype(np.float64)
    guesses = np.array([[np.nan if k is None else k for k in positions(number)] for number in numbers])
    errors = np.abs(guesses - true)  # (P, 2); NaN for a missing position
    exact, close = errors == 0.0, (errors <= 1.0).all(axis=1)
    pre, post = exact.mean(axis=0).tolist()
    return {"pre": pre, "post": post, "exact": float(exact.all(axis=1).mean()), "within one": float(close.mean())}
