"""Judging: scores every bundle of a folder and every method on clips, on every split that allows it."""

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
from signsplice_paper.environment import read_environment
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
"""A split -> scores on pairs of it outside the test part."""
Opener = Callable[[Path], Any]
"""A bundle's folder -> the system."""


@dataclass(frozen=True)
class Judgement:
    """The results of judging one method or bundle.

    - rows: new rows, one for each split
    - curves: the bundle's training curve, if any
    - figure_pairs: the frames for figures 6 and 7, with those of this method or bundle
    """

    rows: tuple[ResultRow, ...]
    curves: tuple[Curve, ...]
    figure_pairs: tuple[KeptFrames, ...]


@dataclass(frozen=True)
class Judge:
    """How to judge, and the results so far.

    - pairs: the corpus
    - known: earlier results; rows of the same bundle, protocol and metrics are not judged again
    - progress: makes a progress bar
    - opener: opens a bundle
    - limit: largest number of pairs of a split, None for all
    - splits: the judged splits, all if none is named
    - rejudge: whether to judge known rows again
    - judged_in: commit, versions and machine, read once: a later commit is not that of the code in memory
    """

    pairs: Pairs
    known: Results
    progress: ProgressBar
    opener: Opener = open_bundle
    limit: int | None = None
    rejudge: bool = False
    splits: tuple[str, ...] = ()
    judged_in: Mapping[str, Any] = field(default_factory=read_environment)

    def choose_protocols(self) -> list[Protocol]:
        """Returns the test part of every split that has pairs in it. Raises ``InputError`` if none has."""
        known_splits = [split for split in protocol.SPLITS if split in self.pairs.head["splits"]]
        splits = [split for split in known_splits if self.pairs.split(split, "test")]
        if not splits:
            raise InputError(f"{self.pairs.folder}: no pair to test in any split; make a corpus of more words")
        return [protocol.choose(self.pairs, split, limit=self.limit) for split in splits]

    def judge_all(
        self, methods: Iterable[ClipMethod], configs: Sequence[PaperConfig], figure_pairs: Sequence[KeptFrames]
    ) -> Iterator[Judgement]:
        """Judges the mean transition, methods on clips and baselines, if there are methods, then bundles; yields one
        judgement each. ``figure_pairs``: frames of earlier calls.
        """
        protocols = self.choose_protocols()
        current_pairs = kept_frames.merge(figure_pairs, kept_frames.choose(self.pairs, protocols[0]))
        protocols = [p for p in protocols if not self.splits or p.split in self.splits]
        yield self.judge_mean(protocols)
        methods = list(methods)
        if methods:
            yield self.judge_baselines(protocols, configs)
        for method in methods:
            judgement = self.judge_method(method, protocols, current_pairs)
            current_pairs = list(judgement.figure_pairs)
            yield judgement
        for config in configs:
            judgement = self.judge_bundle(config, protocols, current_pairs)
            current_pairs = list(judgement.figure_pairs)
            yield judgement

    def judge_mean(self, protocols: Sequence[Protocol]) -> Judgement:
        """Judges the mean transition of every split's training part."""
        row, rows = ResultRow(MEAN_TRANSITION, "", MEAN), []
        for p in protocols:
            if self.pairs.split(p.split, "train"):
                rows += self._judge_rows(row, "", MeanAnswers(self.pairs, p.split), [p], [])[0]
        return Judgement(tuple(rows), (), ())

    def judge_method(
        self, method: ClipMethod, protocols: Sequence[Protocol], figure_pairs: list[KeptFrames]
    ) -> Judgement:
        """Judges a method on clips, whose networks never saw a corpus of pairs."""
        answer = ClipAnswers(self.pairs, method)
        bundle = method.parts.bundle
        scale = SHIPPED if method.learned else CLASSICAL
        row = ResultRow(method.name, "", scale, given=method.given, bundle=bundle and bundle[:12])
        is_shown = (method.name, method.given) in kept_frames.SHOWN_METHODS
        label = kept_frames.make_label(method.name, scale, "", method.given) if is_shown else ""
        rows, figure_pairs = self._judge_rows(row, label, answer, protocols, figure_pairs, answer.prepare)
        return Judgement(tuple(rows), (), tuple(figure_pairs))

    def judge_baselines(self, protocols: Sequence[Protocol], configs: Sequence[PaperConfig]) -> Judgement:
        """Judges the truth, this project's default, and ridge regression at the commonest and mean cuts, at the true
        cuts, and at those of LPT+, if ``configs`` have it.
        """
        lpt_plus_configs = [config for config in configs if config.system == published.LPT_PLUS and not config.seed]
        rows: list[ResultRow] = []
        for p in protocols:
            truth = ResultRow("truth", "", CLASSICAL, given="positions and length")
            rows += self._judge_rows(truth, "", baselines.TrueAnswers(self.pairs), [p], [])[0]
            default = ResultRow("signsplice", "", SHIPPED)
            rows += self._judge_rows(default, "", baselines.DefaultAnswers(self.pairs), [p], [])[0]
            if not self.pairs.split(p.split, "train"):
                continue
            ridge = baselines.Ridge(self.pairs, p.split)
            cuts: dict[str, position_baselines.Positions] = {
                "commonest-cut": position_baselines.WordCuts(self.pairs, p.split, commonest=True),
                "mean-cut": position_baselines.WordCuts(self.pairs, p.split, commonest=False),
                "true-positions": lambda number: tuple(self.pairs.index[number, 2:4].tolist()),
            }
            for config in lpt_plus_configs:
                if config.corpus == p.corpus and protocol.may_judge(config.stored, self.pairs, p):
                    cuts["lpt-plus-positions"] = _LazySystem(self, config.path.parent).predict_positions
            for name, positions in cuts.items():
                given_truth = "positions" if name == "true-positions" else "nothing"
                row = ResultRow(f"{name}+ridge", "", FITTED, given=given_truth, n_parameters=ridge.n_parameters)
                rows += self._judge_rows(row, "", baselines.RidgeAnswers(ridge, positions), [p], [])[0]
        return Judgement(tuple(rows), (), ())

    def judge_bundle(
        self, config: PaperConfig, protocols: Sequence[Protocol], figure_pairs: list[KeptFrames]
    ) -> Judgement:
        """Judges a bundle. Raises ``InputError`` if no protocol allows it."""
        folder = config.path.parent
        allowed = [p for p in protocols if protocol.may_judge(config.stored, self.pairs, p)]
        if not allowed:
            protocol.check_allowed(config.stored, self.pairs, protocols[0], folder.name)
        row = bundles.make_result_row(config)
        is_other_corpus = row.corpus != allowed[0].corpus
        row = replace(row, taught=row.corpus if is_other_corpus else "")
        # Figures 6 and 7 show seed 0.
        is_shown = row.fr in (None, published.BEST_FR) and not row.seed and not is_other_corpus
        label = kept_frames.make_label(row.system, row.scale, row.optimiser) if is_shown else ""
        system = _LazySystem(self, folder)
        score_others = None if is_other_corpus else partial(self._score_other_pairs, system)
        rows, figure_pairs = self._judge_rows(row, label, system, allowed, figure_pairs, score_others=score_others)
        stored_curve = curve.load(folder, row.bundle or "")
        return Judgement(tuple(rows), () if stored_curve is None else (stored_curve,), tuple(figure_pairs))

    def _judge_rows(
        self,
        template: ResultRow,
        label: str,
        answer: Answer,
        protocols: Sequence[Protocol],
        figure_pairs: list[KeptFrames],
        prepare: Callable[[Sequence[int]], None] | None = None,
        score_others: MoreScores | None = None,
    ) -> tuple[list[ResultRow], list[KeptFrames]]:
        """Returns new rows on some protocols, and the figure pairs with the frames for the random split under
        ``label``, if it is given. ``score_others``: scores on other pairs of a split.
        """
        rows = []
        shared = {
            **self.judged_in,
            "metrics_id": results.hash_signatures(),
            "truth": self.pairs.head.get("truth", "partner"),
        }
        for p in protocols:
            row = replace(template, split=p.split, part=p.part, corpus=p.corpus, protocol=p.signature, **shared)
            known_row = None if self.rejudge else self._find_known_row(template, p)
            if known_row is not None and all(not label or label in pair.made for pair in figure_pairs):
                continue
            if prepare is not None:
                prepare(p.pair_numbers)
            with self.progress(f"{template.system}, {p.split}") as advance:
                judged = protocol.judge(answer, self.pairs, p, advance)
            scores = judged.scores | ({} if score_others is None else score_others(p.split))
            rows.append(replace(row, scores=results.replace_nonfinite(scores), n_pairs=judged.n_pairs))
            if p.split == "random" and label:
                figure_pairs = kept_frames.add_answers(figure_pairs, label, answer, self.pairs)
        return rows, figure_pairs

    def _score_other_pairs(self, answer: Any, split: str) -> Scores:
        """Returns ``paa_train`` and ``accuracy_valid`` of a system on a split."""
        training, validation = (
            pair_samples.sample(self.pairs, split, "train"),
            pair_samples.sample_validation(self.pairs, split),
        )
        if isinstance(answer, ClipAnswers):
            answer.prepare([*training, *validation])
        positions_of = (
            answer.predict_positions if isinstance(answer, _LazySystem) else lambda k: (answer(k).pre, answer(k).post)
        )
        return {
            "paa_train": protocol.compute_paa(positions_of, self.pairs, training),
            "accuracy_valid": protocol.compute_accuracy(answer, self.pairs, validation),
        }

    def _find_known_row(self, template: ResultRow, p: Protocol) -> ResultRow | None:
        """Returns the known row that was judged on the same bundle by the same protocol and metrics."""
        row = replace(template, split=p.split, part=p.part)
        known_row = next((known for known in self.known.rows if known.key == row.key), None)
        if known_row is None or (known_row.protocol, known_row.metrics_id) != (p.signature, results.hash_signatures()):
            return None
        return known_row if known_row.bundle == row.bundle else None


class _LazySystem:
    """The predictions of a bundle, which is opened for the first pair."""

    def __init__(self, judge: Judge, folder: Path) -> None:
        self.judge, self.folder = judge, folder

    @cached_property
    def system(self) -> Any:
        """The opened bundle."""
        return self.judge.opener(self.folder)

    def __call__(self, number: int) -> Any:
        return protocol.make_answer(self.judge.pairs, self.system)(number)

    def predict_positions(self, number: int) -> protocol.Positions:
        """Returns the positions alone."""
        return protocol.make_position_answer(self.judge.pairs, self.system)(number)
