"""Reads how long people hold signs and travel between them, from annotated motion capture of Czech Sign Language
(``czech_lengths.csv``), and fits the numbers of ``splicing.durations``.

The annotations are Ondřej Valach's (github.com/oValach/Sign_Language_BT, MIT): 333 signs alone, and 33 takes of running
signing with 917 signs and 621 transitions between two of them. Doubtful ones are left out.
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from signsplice.motion import Clip, FloatArray
from signsplice.rig.info import arms
from signsplice.splicing.durations import travel_widths
from signsplice.splicing.options import choose

TABLE = Path(__file__).with_name("czech_lengths.csv")
PERCENTILES = np.arange(5, 96, 5)
"""Percentiles at which travels and times are matched."""
TRAVEL_WIDTHS = (
    0.21, 0.29, 0.33, 0.38, 0.44, 0.49, 0.56, 0.65, 0.75, 0.88, 1.01, 1.08, 1.13, 1.18, 1.20, 1.24, 1.29, 1.33, 1.41,
)  # fmt: skip
"""Percentiles of the farther hand's travel, shoulder widths, at 1,554 of the default cutter's cuts
(``measure_travels``): words that ship in random orders, by the standard signer and signers 201 to 203.
"""


@dataclass(frozen=True)
class Lengths:
    """Annotated lengths, seconds.

    alone: lengths of signs shown alone, by gloss.
    running: lengths of signs in running signing, by gloss.
    transitions: lengths between two signs.
    """

    alone: dict[str, FloatArray]
    running: dict[str, FloatArray]
    transitions: FloatArray


def read(path: Path = TABLE) -> Lengths:
    """Returns the lengths of a table like ``TABLE``."""
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    signs = [row for row in rows if row["kind"] == "sign"]
    return Lengths(
        {row["gloss"]: _seconds(row["alone_ms"]) for row in signs if row["alone_ms"]},
        {row["gloss"]: _seconds(row["running_ms"]) for row in signs if row["running_ms"]},
        np.concatenate([_seconds(row["running_ms"]) for row in rows if row["kind"] == "transition"]),
    )


def _seconds(milliseconds: str) -> FloatArray:
    return np.array(milliseconds.split(), np.float64) / 1e3


def fit_signs(lengths: Lengths) -> tuple[float, float]:
    """Returns the median over glosses of a sign's length in running signing over its length alone, and the mean length
    of signs in running signing, seconds.
    """
    ratios = [
        np.median(running) / np.median(lengths.alone[gloss])
        for gloss, running in lengths.running.items()
        if gloss in lengths.alone
    ]
    return float(np.median(ratios)), float(np.concatenate(list(lengths.running.values())).mean())


def fit_transitions(lengths: Lengths, travel_widths: Sequence[float] = TRAVEL_WIDTHS) -> tuple[float, float]:
    """Returns the numbers a and b, seconds, of T = a + b log2(1 + D) that give travels of D shoulder widths
    (percentiles ``PERCENTILES``) the same percentiles as the annotated transitions, with the least squared error of
    log T.
    """
    doublings, seconds = np.log2(1.0 + np.array(travel_widths)), np.percentile(lengths.transitions, PERCENTILES)

    def errors(ab: FloatArray) -> FloatArray:
        return np.asarray(np.log(ab[0] + ab[1] * doublings) - np.log(seconds))

    travel_s, doubling_s = least_squares(errors, (0.1, 0.1), bounds=(1e-3, 1.0)).x.tolist()
    return travel_s, doubling_s


def measure_travels(clips: Sequence[Clip]) -> FloatArray:
    """Returns the travel of the farther hand in each transition of a sentence cut by the default cutter, shoulder
    widths.
    """
    cuts = choose().cutter.cut_all(clips)
    return np.array(
        [travel_widths(arms(p), arms(q), cut.pre, cut.post) for (p, q), cut in zip(pairwise(clips), cuts, strict=True)]
    )
