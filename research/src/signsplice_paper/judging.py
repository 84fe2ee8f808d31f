"""Judging: every bundle of a folder and every method on clips, on every split that allows it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

from signsplice.errors import InputError
from signsplice_paper import (
    baselines,
    bundles,
    curve,
    kept_frames,
    pair_samples,
    position_baselines,
    protocol,
    published,
    results,
)
from signsplice_paper.clip_methods import ClipAnswers, ClipMethod
from signsplice_paper.configs import PaperConfig
from signsplice_paper.curve import Curve
from signsplice_paper.environment import environment
from signsplice_paper.kept_frames import KeptFrames
from signsplice_paper.mean_transition import NAME as MEAN_TRANSITION
from signsplice_paper.mean_transition import MeanAnswers
from signsplice_paper.protocol import Answer, Protocol
from signsplice_paper.results import CLASSICAL, FITTED, MEAN, SHIPPED, ResultRow, Results
from signsplice_paper.systems import open_bundle
from signsplice_workshop.corpora.pairs import Pairs

ProgressBar = Callable[[str], AbstractContextManager[Callable[[int, int], None] | None]]
"""Title -> a context that yields a callback (done, total), or None."""
Scores = dict[str, float]
MoreScores = Callable[[str], Scores]
"""A split -> scores on other pairs of it than the test part."""
Opener = Callable[[Path], Any]
"""A bundle's folder -> the system."""


@dataclass(frozen=True)
class Judgement:
    """What judging one method or bundle adds.

    - rows: new rows, one for each split
    - curves: the bundle's training curve, if any
    - kept: the frames for figures 6 and 7, with those of this method or bundle
    """

    rows: tuple[ResultRow, ...]
    curves: tuple[Curve, ...]
    kept: tuple[KeptFrames, ...]


@dataclass(frozen=True)
class Judge:
    """How to judge, and what is known already.

    - pairs: the corpus
    - known: earlier results; rows of the same bundle, protocol and metrics are not judged again
    - progress: makes a progress bar
    - opener: opens a bundle
    - limit: largest number of pairs of a split, None for all
    - splits: those that are judged, all if none is named
    - again: whether to judge known rows again
    - judged_in: commit, versions and machine, read once: a later commit is not that of the code in memory
    """

    pairs: Pairs
    known: Results
    progress: ProgressBar
    opener: Opener = open_bundle
    limit: int | None = None
    again: bool = False
    splits: tuple[str, ...] = ()
    judged_in: Mapping[str, Any] = field(default_factory=environment)

    def protocols(self) -> list[Protocol]:
        """The test part of every split that has pairs in it. Raises ``InputError`` if none has."""
        known = [split for split in protocol.SPLITS if split in self.pairs.head["splits"]]
        splits = [split for split in known if self.pairs.split(split, "test")]
        if not splits:
            raise InputError(f"{self.pairs.folder}: no pair to test in any split; make a corpus of more words")
        return [protocol.choose(self.pairs, split, limit=self.limit) for split in splits]

    def judgements(
        self, methods: Iterable[ClipMethod], configs: Sequence[PaperConfig], kept: Sequence[KeptFrames]
    ) -> Iterator[Judgement]:
        """Judge the mean transition, methods on clips and baselines, if there are methods, then bundles; one judgement
        each. ``kept``: frames of earlier calls.
        """
        protocols = self.protocols()
        frames = kept_frames.merge(kept, kept_frames.choose(self.pairs, protocols[0]))
        protocols = [p for p in protocols if not self.splits or p.split in self.splits]
        yield self.judge_mean(protocols)
        methods = list(methods)
        if methods:
            yield self.judge_baselines(protocols, configs)
        for method in methods:
            judgement = self.judge_method(method, protocols, frames)
            frames = list(judgement.kept)
            yield judgement
        for config in configs:
            judgement = self.judge_bundle(config, protocols, frames)
            frames = list(judgement.kept)
            yield judgement

    def judge_mean(self, protocols: Sequence[Protocol]) -> Judgement:
        """Judge the mean transition of every split's training part."""
        row, rows = ResultRow(MEAN_TRANSITION, "", MEAN), []
        for p in protocols:
            if self.pairs.split(p.split, "train"):
                rows += self._rows(row, "", MeanAnswers(self.pairs, p.split), [p], [])[0]
        return Judgement(tuple(rows), (), ())

    def judge_method(self, method: ClipMethod, protocols: Sequence[Protocol], kept: list[KeptFrames]) -> Judgement:
        """Judge a method on clips, whose networks never saw a corpus of pairs."""
        answer = ClipAnswers(self.pairs, method)
        bundle = method.parts.bundle
        scale = SHIPPED if method.learned else CLASSICAL
        row = ResultRow(method.name, "", scale, given=method.given, bundle=bundle and bundle[:12])
        shown = (method.name, method.given) in kept_frames.SHOWN_METHODS
        label = kept_frames.label(method.name, scale, "", method.given) if shown else ""
        rows, kept = self._rows(row, label, answer, protocols, kept, answer.prepare)
        return Judgement(tuple(rows), (), tuple(kept))

    def judge_baselines(self, protocols: Sequence[Protocol], configs: Sequence[PaperConfig]) -> Judgement:
        """Judge the truth, this project's default, and ridge regression at the commonest and mean cuts, at the true
        ones, and at those of LPT+, where ``configs`` have it.
        """
        improved = [config for config in configs if config.system == published.LPT_PLUS and not config.seed]
        rows: list[ResultRow] = []
        for p in protocols:
            truth = ResultRow("truth", "", CLASSICAL, given="positions and length")
            rows += self._rows(truth, "", baselines.TrueAnswers(self.pairs), [p], [])[0]
            default = ResultRow("signsplice", "", SHIPPED)
            rows += self._rows(default, "", baselines.DefaultAnswers(self.pairs), [p], [])[0]
            if not self.pairs.split(p.split, "train"):
                continue
            ridge = baselines.Ridge(self.pairs, p.split)
            cuts: dict[str, position_baselines.Positions] = {
                "commonest-cut": position_baselines.WordCuts(self.pairs, p.split, commonest=True),
                "mean-cut": position_baselines.WordCuts(self.pairs, p.split, commonest=False),
                "true-positions": lambda number: tuple(self.pairs.index[number, 2:4].tolist()),
            }
            for config in improved:
                if config.corpus == p.corpus and protocol.may_judge(config.stored, self.pairs, p):
                    cuts["lpt-plus-positions"] = _LazySystem(self, config.path.parent).positions
            for name, positions in cuts.items():
                given = "positions" if name == "true-positions" else "nothing"
                row = ResultRow(f"{name}+ridge", "", FITTED, given=given, n_parameters=ridge.n_parameters)
                rows += self._rows(row, "", baselines.RidgeAnswers(ridge, positions), [p], [])[0]
        return Judgement(tuple(rows), (), ())

    def judge_bundle(self, config: PaperConfig, protocols: Sequence[Protocol], kept: list[KeptFrames]) -> Judgement:
        """Judge a bundle. Raises ``InputError`` if no protocol allows it."""
        folder = config.path.parent
        allowed = [p for p in protocols if protocol.may_judge(config.stored, self.pairs, p)]
        if not allowed:
            protocol.check_allowed(config.stored, self.pairs, protocols[0], folder.name)
        row = bundles.result_row(config)
        elsewhere = row.corpus != allowed[0].corpus
        row = replace(row, taught=row.corpus if elsewhere else "")
        shown = row.fr in (None, published.BEST_FR) and not row.seed and not elsewhere  # figures 6 and 7 show seed 0
        label = kept_frames.label(row.system, row.scale, row.optimiser) if shown else ""
        system = _LazySystem(self, folder)
        more = None if elsewhere else partial(self._other_pairs, system)
        rows, kept = self._rows(row, label, system, allowed, kept, more=more)
        known = curve.load(folder, row.bundle or "")
        return Judgement(tuple(rows), () if known is None else (known,), tuple(kept))

    def _rows(
        self,
        like: ResultRow,
        label: str,
        answer: Answer,
        protocols: Sequence[Protocol],
        kept: list[KeptFrames],
        prepare: Callable[[Sequence[int]], None] | None = None,
        more: MoreScores | None = None,
    ) -> tuple[list[ResultRow], list[KeptFrames]]:
        """New rows on some protocols, and the kept frames with those for the random split under ``label``, if any.
        ``more``: scores on other pairs of a split.
        """
        rows = []
        shared = {
            **self.judged_in,
            "metrics_id": results.signature_id(),
            "truth": self.pairs.head.get("truth", "partner"),
        }
        for p in protocols:
            row = replace(like, split=p.split, part=p.part, corpus=p.corpus, protocol=p.signature, **shared)
            old = None if self.again else self._old(like, p)
            if old is not None and all(not label or label in pair.made for pair in kept):
                continue
            if prepare is not None:
                prepare(p.numbers)
            with self.progress(f"{like.system}, {p.split}") as advance:
                judged = protocol.judge(answer, self.pairs, p, advance)
            scores = judged.scores | ({} if more is None else more(p.split))
            rows.append(replace(row, scores=results.finite(scores), n_pairs=judged.n_pairs))
            if p.split == "random" and label:
                kept = kept_frames.with_answers(kept, label, answer, self.pairs)
        return rows, kept

    def _other_pairs(self, answer: Any, split: str) -> Scores:
        """``paa_train`` and ``accuracy_valid`` of a system on a split."""
        taught, valid = pair_samples.sample(self.pairs, split, "train"), pair_samples.validation(self.pairs, split)
        if isinstance(answer, ClipAnswers):
            answer.prepare([*taught, *valid])
        found = answer.positions if isinstance(answer, _LazySystem) else lambda k: (answer(k).pre, answer(k).post)
        return {
            "paa_train": protocol.paa(found, self.pairs, taught),
            "accuracy_valid": protocol.accuracy(answer, self.pairs, valid),
        }

    def _old(self, like: ResultRow, p: Protocol) -> ResultRow | None:
        """The known row that was judged on the same bundle by the same protocol and metrics."""
        row = replace(like, split=p.split, part=p.part)
        old = next((known for known in self.known.rows if known.key == row.key), None)
        if old is None or (old.protocol, old.metrics_id) != (p.signature, results.signature_id()):
            return None
        return old if old.bundle == row.bundle else None


class _LazySystem:
    """The answers of a bundle, which is opened for the first pair."""

    def __init__(self, judge: Judge, folder: Path) -> None:
        self.judge, self.folder = judge, folder

    @cached_property
    def system(self) -> Any:
        """The opened bundle."""
        return self.judge.opener(self.folder)

    def __call__(self, number: int) -> Any:
        return protocol.answers(self.judge.pairs, self.system)(number)

    def positions(self, number: int) -> protocol.Positions:
        """The positions alone."""
        return protocol.positions(self.judge.pairs, self.system)(number)
