"""Evaluating a folder: which bundles and methods are judged, and results.json after each of them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from signsplice_paper import bundles, clip_methods, kept_frames, results
from signsplice_paper.configs import PaperConfig
from signsplice_paper.judging import Judge
from signsplice_paper.plan import Choice, Run
from signsplice_paper.results import Results

Warn = Callable[[str], object]


def _run(config: PaperConfig) -> Run:
    """The training that made a bundle."""
    return Run(
        config.system or "", config.scale or "", config.optimiser or "", config.split or "", config.fr, config.seed or 0
    )


def evaluate(judge: Judge, out: Path, folder: Path, scale: str, choice: Choice, warn: Warn) -> tuple[int, Results]:
    """Judge the methods on clips and the bundles in ``folder``: the number of new rows, and all results.

    results.json and frames.npz in ``out`` are written after every method and bundle, so that an interrupted call loses
    at most one. ``judge.known`` are the results before. ``choice``: which bundles; methods on
    clips are judged only if it names none.
    """
    configs = bundles.read_all(folder)
    chosen = [config for config in configs if config.scale == scale and choice.allows(_run(config))]
    named = bool(choice.systems or choice.optimisers or choice.seeds)
    if not chosen:
        warn(f"{folder}: no bundle of scale {scale} there" + ("" if named else "; only methods on clips are judged"))
    methods = [] if named else clip_methods.methods_to_compare()
    known, n_rows = judge.known, 0
    for judgement in judge.judgements(methods, chosen, kept_frames.load(out / kept_frames.FILE)):
        n_rows += len(judgement.rows)
        if judgement.rows or judgement.curves:
            known = known.merge(judgement.rows, judgement.curves)
            results.save(known, out / results.FILE)
            if judgement.kept:
                kept_frames.save(judgement.kept, out / kept_frames.FILE)
    return n_rows, known
