"""Evaluation of a folder of bundles: chooses bundles and methods, and writes results.json after each of them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from signsplice_paper import bundles, clip_methods, kept_frames, results
from signsplice_paper.configs import PaperConfig
from signsplice_paper.judging import Judge
from signsplice_paper.plan import Choice, Run
from signsplice_paper.results import Results

Warn = Callable[[str], object]


def _make_run(config: PaperConfig) -> Run:
    """Returns the training that made a bundle."""
    return Run(
        config.system or "", config.scale or "", config.optimiser or "", config.split or "", config.fr, config.seed or 0
    )


def evaluate(
    judge: Judge, output_folder: Path, folder: Path, scale: str, choice: Choice, warn: Warn
) -> tuple[int, Results]:
    """Judges the methods on clips and the bundles in ``folder``; returns the number of new rows, and all results.

    results.json and frames.npz in ``output_folder`` are written after every method and bundle, so that an interrupted
    call loses at most one. ``judge.known``: the results before. ``choice``: selects bundles; methods on clips are
    judged only if it selects none by name.
    """
    configs = bundles.read_all(folder)
    chosen_configs = [config for config in configs if config.scale == scale and choice.allows(_make_run(config))]
    is_selective = bool(choice.systems or choice.optimisers or choice.seeds)
    if not chosen_configs:
        warn(
            f"{folder}: no bundle of scale {scale} there"
            + ("" if is_selective else "; only methods on clips are judged")
        )
    methods = [] if is_selective else clip_methods.list_methods()
    known, n_rows = judge.known, 0
    for judgement in judge.judge_all(methods, chosen_configs, kept_frames.load(output_folder / kept_frames.FILE)):
        n_rows += len(judgement.rows)
        if judgement.rows or judgement.curves:
            known = known.merge(judgement.rows, judgement.curves)
            results.save(known, output_folder / results.FILE)
            if judgement.figure_pairs:
                kept_frames.save(judgement.figure_pairs, output_folder / kept_frames.FILE)
    return n_rows, known
