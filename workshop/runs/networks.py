#!/usr/bin/env python
"""Compares the networks with rules: workshop/docs/measured/networks.md.

    python workshop/runs/networks.py [TAKE.bvh]

Pairs of words that ship are spliced by either cutter with either transition. Frames are hidden from a captured take,
from its last third drawn anew between keys, and from words of three synthetic signers in four rest poses. Intervals are
of 1,000 bootstraps over blocks of gaps in a row.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from itertools import islice, product
from pathlib import Path

import numpy as np

import signsplice as ss
from measured import format_versions, stamp
from signsplice.motion import Clip, FloatArray, concatenate, resample
from signsplice.rig.keyedness import judge_keyedness
from signsplice.signer import planner
from signsplice.signer.signer import RESTS, STANDARD, draw_signer
from signsplice.splicing.contracts import Gap, Transition
from signsplice.splicing.curves import find_transition
from signsplice.splicing.options import SpliceOptions, choose
from signsplice_workshop.corpora import pseudo
from signsplice_workshop.corpora.rekeying import DRAWINGS, rekey_clip
from signsplice_workshop.measure import motion_scores, seams
from signsplice_workshop.measure.hands import wrist_positions
from signsplice_workshop.measure.hidden_frames import LENGTHS, SHOWN
from signsplice_workshop.measure.measures import format_table, make_row

PAGE = Path(__file__).parents[1] / "docs" / "measured" / "networks.md"
_BLOCK, _DRAWS = 8, 1000
_STRIDE = 4
N_PAIRS = 500


def score_hidden_frames(clips: Sequence[Clip], transitions: Sequence[Transition], n_frames: int) -> FloatArray:
    """Returns scores (transitions, gaps, 5) of gaps of ``n_frames``: errors of hands, fingers and trunk, thousandths of
    the arm's length; mean jerk of the wrists; path of the wrists over the true one.
    """
    gaps, windows = [], []
    for clip in clips:
        keyed = judge_keyedness(clip).is_keyed
        for start in range(0, len(clip) - n_frames - 2 * SHOWN + 1, _STRIDE):
            window = clip[start : start + n_frames + 2 * SHOWN]
            windows.append(window)
            gaps.append(Gap(window[:SHOWN], window[-SHOWN:], n_frames, keyed))
    rows = []
    for transition in transitions:
        scores = []
        for window, gap, generated in zip(windows, gaps, transition.fill(gaps), strict=True):
            errors = motion_scores.group_errors(generated, window[SHOWN:-SHOWN])
            paths = [wrist_positions(clip) for clip in (concatenate([gap.before, generated, gap.after]), window)]
            inner = [path[SHOWN - 1 : 1 - SHOWN] for path in paths]
            jerk = np.linalg.norm(np.diff(paths[0][4:-4], n=3, axis=0), axis=-1).mean()
            lengths = [np.linalg.norm(np.diff(path, axis=0), axis=-1).sum() for path in inner]
            scores.append((errors.hands, errors.fingers, errors.trunk, jerk, lengths[0] / max(lengths[1], 1e-9)))
        rows.append(scores)
    return np.array(rows)


def format_ratio(scores: FloatArray, base: FloatArray) -> str:
    """Returns the mean of scores (n,) over that of a base (n,), with its 95 % interval."""
    rng = np.random.default_rng(0)
    blocks = np.array_split(np.arange(len(scores)), max(1, len(scores) // _BLOCK))
    sums = np.array([[scores[rows].sum(), base[rows].sum()] for rows in blocks])
    drawn = sums[rng.integers(len(sums), size=(_DRAWS, len(sums)))].sum(axis=1)
    low, high = np.quantile(drawn[:, 0] / drawn[:, 1], [0.025, 0.975])
    return f"{scores.sum() / base.sum():.2f} ({low:.2f} to {high:.2f})"


_ROWS = (("learned", "hands", 0, 0), ("", "jerk", 0, 3), ("quintic", "hands", 2, 0), ("", "jerk", 2, 3))
"""Method, score, row and column of the scores of ``score_hidden_frames``."""


def make_rows(name: str, clips: Sequence[Clip], transitions: Sequence[Transition]) -> list[list[str]]:
    """Returns rows of the first transition, and of the third, over the second, by score; of the hands with
    intervals.
    """
    by_length = {n: score_hidden_frames(clips, transitions, n) for n in LENGTHS}
    keyed = float(np.mean([judge_keyedness(clip).is_keyed for clip in clips]))
    rows: list[list[str]] = []
    for method, score, row, column in _ROWS:
        pairs = [(scores[row, :, column], scores[1, :, column]) for scores in by_length.values()]
        cells = [
            format_ratio(*pair) if (row, column) == (0, 0) else f"{pair[0].sum() / pair[1].sum():.2f}" for pair in pairs
        ]
        rows.append([f"{name}, {keyed:.0%} judged keyed" if not rows else "", method, score, *cells])
    paths = [f"{np.median(scores[0, :, 4]):.2f}" for scores in by_length.values()]
    return [*rows, ["", "learned", "path over the true one", *paths]]


def make_words(seed: int, rest: str) -> list[Clip]:
    """Returns eight pseudo-signs by a signer in a rest pose."""
    signer = replace(STANDARD if seed == 0 else draw_signer(seed), rest=rest)
    return [planner.synthesize_word(pseudo.draw_sign(8_000 + 100 * seed + k), signer).clip for k in range(8)]


def make_seam_lines() -> list[str]:
    """Returns a table of the seams of ``N_PAIRS`` pairs of words that ship, by cutter and transition."""
    pairs = seams.word_pairs(N_PAIRS)
    rows = [
        make_row(
            seams.MEASURES,
            [
                seams.measure_spliced(before, after, SpliceOptions(*names, avoid_collisions=False))
                for before, after in pairs
            ],
            method=" + ".join(names),
        )
        for names in product(("learned", "pose-velocity"), ("learned", "hermite", "quintic"))
    ]
    return seams.table(rows)


def main(take: str | None = None) -> None:
    """Writes the page, or only prints the table without a take."""
    learned = choose().transition
    transitions = [learned, find_transition("hermite"), find_transition("quintic")]
    rows: list[list[str]] = []
    if take is not None:
        clip = ss.load(take)
        last = clip[2 * len(clip) // 3 :]
        for part, motion in (("whole take", clip), ("its last third", last)):
            rows += make_rows(f"{part}, 30 fps", [motion], transitions)
            rows += make_rows(f"{part}, 24 fps", [resample(motion, 24.0)], transitions)
        rng = np.random.default_rng(5)
        for kind in DRAWINGS:
            drawn = [rekey_clip(last, key_distance, kind, rng) for key_distance in (3, 6, 12)]
            rows += make_rows(f"last third, {kind}", drawn, transitions)
    for seed, name in ((0, "standard signer"), (11, "signer 11"), (12, "signer 12")):
        for rest in RESTS if seed == 0 else islice(RESTS, 1):
            rows += make_rows(f"words, {name}, {rest}", make_words(seed, rest), transitions)
    lines = format_table(("motion", "method", "over Hermite", *LENGTHS), rows)
    print("\n".join(lines))
    if take is not None:
        made_with = format_versions([{"made_with": stamp()}])
        PAGE.write_text(
            "\n".join([*HEAD[:3], *made_with, *HEAD[3:], *make_seam_lines(), "", *HIDDEN, *lines, ""]), encoding="utf-8"
        )


HEAD = [
    "# Networks beside rules",
    "",
    "Made by `python workshop/runs/networks.py TAKE`, with the take of [hidden frames](hidden-frames.md).",
    "",
    "## Seams",
    "",
    f"{N_PAIRS} pairs of words that ship, without collision avoidance, each cutter with each transition.",
    "",
]
HIDDEN = [
    "## Hidden frames, by group",
    "",
    "The learned transition and quintic over the limited Hermite curve, by number of hidden frames; below 1 is better.",
    "Intervals of 95 % over blocks of gaps. No choice was made on the take's last third. Fingers, trunk and head of",
    "the learned transition are those of Hermite, bit for bit. Words are eight pseudo-signs that no training has seen.",
    "",
]


if __name__ == "__main__":
    main(*sys.argv[1:2])
