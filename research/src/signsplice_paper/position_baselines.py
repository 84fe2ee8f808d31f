"""What a network has to beat on splice positions: the commonest and the mean cut of a word, the commonest one by the
partner's true class, its nearest neighbour, and a Gaussian process; and a reader who knows the rules.

All but the last are counted or fitted for each word on the training part, by gloss, and know nothing of a word that it
lacks: there they have the mean cut of all. Frames of words before are counted from the end, since words differ in
length by signer. The reader knows ``readable`` and sees the motion.
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
"""Frames that a word is resampled to where words are compared."""
LENGTH_SCALE, NOISE = 0.5, 0.1
"""Of the Gaussian process: the length of its kernel, over the median distance of words, and the deviation of its
noise."""


class WordCuts:
    """For each word the cut that is commonest (or the mean one) in the training part of a split beside partners of a
    class; a callable ``Positions``.

    - classes: the class of each word as a partner; all the same where None
    """

    def __init__(
        self, pairs: Pairs, split: str, commonest: bool, classes: Callable[[int], Hashable] | None = None
    ) -> None:
        self.pairs = pairs
        self.classes = classes or (lambda _: None)
        by_word: tuple[dict[Hashable, list[int]], dict[Hashable, list[int]]] = (defaultdict(list), defaultdict(list))
        for number in pairs.split(split, "train"):
            p, q, pre, post = pairs.index[number, :4].tolist()
            left, entered = len(pairs.word(p)) - pre, post
            for key in (self._key(p, q), self._key(p)):
                by_word[0][key].append(left)
            for key in (self._key(q, p), self._key(q)):
                by_word[1][key].append(entered)
        self._cuts = tuple(_choose(cuts, commonest) for cuts in by_word)
        self._any = tuple(round(float(np.mean([n for row in cuts.values() for n in row]))) for cuts in by_word)

    def __call__(self, number: int) -> tuple[int, int]:
        """Pre and post of a pair."""
        p, q = self.pairs.index[number, :2].tolist()
        n, m = len(self.pairs.word(p)), len(self.pairs.word(q))
        left, entered = (
            cuts.get(self._key(word, partner), cuts.get(self._key(word), usual))
            for cuts, usual, word, partner in zip(self._cuts, self._any, (p, q), (q, p), strict=True)
        )
        return min(max(n - left, 0), n - 1), min(entered, m - 1)

    def _key(self, word: int, partner: int | None = None) -> Hashable:
        """What a word's cuts are counted under: its gloss, and its partner's class."""
        gloss = self.pairs.gloss(word)
        return gloss if partner is None else (gloss, self.classes(partner))


def _choose(by_word: Mapping[Hashable, list[int]], commonest: bool) -> dict[Hashable, int]:
    if commonest:
        return {key: Counter(sorted(cuts)).most_common(1)[0][0] for key, cuts in by_word.items()}
    return {key: round(float(np.mean(cuts))) for key, cuts in by_word.items()}


def partner_class(pairs: Pairs) -> Callable[[int], Hashable]:
    """What of a partner the rules ask for: all properties of its card."""
    fields = ("two_first", "two_last", "high_first", "high_last", "open_first", "open_last", "touches_last")
    return lambda word: tuple(pairs.head["words"][word]["card"][name] for name in fields)


class SimilarPartners:
    """For each word the cuts beside partners that look alike, in the training part of a split; a callable
    ``Positions``.

    A word's look is its numbers in ``LOOK_FRAMES`` frames, spread evenly over it.

    - process: whether each word's cuts are weighed by a Gaussian process for each frame that occurs, with a kernel
      exp(-d^2 / 2 l^2); else the nearest partner's cut
    """

    def __init__(self, pairs: Pairs, split: str, process: bool) -> None:
        self.pairs, self.process = pairs, process
        self.usual = WordCuts(pairs, split, commonest=True)
        seen: tuple[dict[str, list[tuple[int, int]]], dict[str, list[tuple[int, int]]]] = ({}, {})
        for number in pairs.split(split, "train"):
            p, q, pre, post = pairs.index[number, :4].tolist()
            seen[0].setdefault(pairs.gloss(p), []).append((q, len(pairs.word(p)) - pre))
            seen[1].setdefault(pairs.gloss(q), []).append((p, post))
        self.seen = seen
        words = (np.asarray(pairs.word(k), np.float64) for k in range(len(pairs.head["words"])))
        self.looks = np.array([resample_frames(word, LOOK_FRAMES).ravel() for word in words])
        taught = self.looks[sorted({word for rows in seen[0].values() for word, _ in rows})]
        self.length = LENGTH_SCALE * float(np.median(_distances(taught, taught)))

    def __call__(self, number: int) -> tuple[int, int]:
        """Pre and post of a pair."""
        p, q = self.pairs.index[number, :2].tolist()
        pre, post = self.usual(number)
        left, entered = (self._predict_cut(k, word, partner) for k, (word, partner) in enumerate(((p, q), (q, p))))
        n, m = len(self.pairs.word(p)), len(self.pairs.word(q))
        return (
            pre if left is None else min(max(n - left, 0), n - 1),
            post if entered is None else min(entered, m - 1),
        )

    def _predict_cut(self, side: int, word: int, partner: int) -> int | None:
        """The cut of a word beside a partner; None for a word that was not taught."""
        rows = self.seen[side].get(self.pairs.gloss(word))
        if rows is None:
            return None
        partners, cuts = np.array(rows).T
        near = _distances(self.looks[[partner]], self.looks[partners])[0]
        if not self.process:
            return int(cuts[near.argmin()])
        kernel = np.exp(-0.5 * (_distances(self.looks[partners], self.looks[partners]) / self.length) ** 2)
        weights = np.linalg.solve(kernel + NOISE**2 * np.eye(len(kernel)), np.exp(-0.5 * (near / self.length) ** 2))
        values = np.unique(cuts)
        return int(values[np.argmax([(weights * (cuts == value)).sum() for value in values])])


def _distances(a: FloatArray, b: FloatArray) -> FloatArray:
    """Distances (A, B) between rows."""
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
        """Pre and post of a pair; None for both where a word cannot be read."""
        p, q = (self._card(word) for word in self.pairs.index[number, :2].tolist())
        return (None, None) if p is None or q is None else (readable.leave(p, q), readable.enter(p, q))

    def _card(self, word: int) -> Card | None:
        if word not in self.cards:
            signer = self.pairs.signers[self.pairs.signer(word)]
            hands = self.pairs.head["words"][word]["hands"]
            self.cards[word] = readable.extract_card(self.pairs.word_clip(word), signer, hands)
        return self.cards[word]


BASELINES: dict[str, Callable[[Pairs, str], Positions]] = {
    "commonest cut": lambda pairs, split: WordCuts(pairs, split, commonest=True),
    "mean cut": lambda pairs, split: WordCuts(pairs, split, commonest=False),
    "commonest cut by the partner's class": lambda pairs, split: WordCuts(pairs, split, True, partner_class(pairs)),
    "nearest neighbour": lambda pairs, split: SimilarPartners(pairs, split, process=False),
    "Gaussian process": lambda pairs, split: SimilarPartners(pairs, split, process=True),
    "reader of the rules": lambda pairs, _: RuleReader(pairs),
}


def score_positions(pairs: Pairs, numbers: Sequence[int], positions: Positions) -> dict[str, float]:
    """Fractions of pairs: with pre exact, with post, with both, and with both within one frame. A position that is not
    found is neither.
    """
    true = pairs.index[np.asarray(numbers), 2:4].astype(np.float64)
    guesses = np.array([[np.nan if k is None else k for k in positions(number)] for number in numbers])
    errors = np.abs(guesses - true)  # (P, 2); NaN where none was found
    exact, close = errors == 0.0, (errors <= 1.0).all(axis=1)
    pre, post = exact.mean(axis=0).tolist()
    return {"pre": pre, "post": post, "exact": float(exact.all(axis=1).mean()), "within one": float(close.mean())}
