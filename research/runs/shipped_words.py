"""Pairs of words that ship, spliced by LpTransformer, LPT+ and the default: are positions found, and are they right?

    python research/runs/shipped_words.py [PAIRS] [SYSTEM ...]

None of these words taught a system that ships. A position that the system lacks, or at which a word would be left
before it is entered, is filled by the default and counts as filled. Whole: both signs keep all their movements. Down:
pairs that keep frames between the two in which both arms are down. Jump: the median change of the wrists' velocity
where frames of a sign meet new ones, m/s; peak: of their highest speed.
"""

from __future__ import annotations

import sys

import numpy as np

import signsplice as ss
from signsplice.splicing.lptransformer import SHIPPED
from signsplice_workshop.measure import seams

LINE = "| {:24} | {:>6} | {:>6} | {:>6} | {:>6} | {:>6} | {:>6} | {:>6} |"


def main() -> None:
    """Prints a row for each method."""
    n_pairs = int(sys.argv[1]) if len(sys.argv) > 1 else 500
    systems = sys.argv[2:] or list(SHIPPED)
    pairs = seams.word_pairs(n_pairs)
    print(LINE.format("method", "pairs", "filled", "whole", "down", "jump", "peak", "new s"))
    for system in (*systems, None):
        options = ss.SpliceOptions() if system is None else ss.SpliceOptions(system=system)
        filled, measured = 0, []
        for before, after in pairs:
            (seam,) = ss.splice([before.clip, after.clip], options).seams
            filled += any("joined by cutter" in line for line in seam.warnings)
            measured.append(seams.measure_spliced(before, after, options))
        whole_percent = 100.0 * np.mean([seam.whole for seam in measured])
        down = np.mean([seam.arms_down > 0 for seam in measured])
        jump, peak = (np.median([getattr(seam, name) for seam in measured]) for name in ("velocity_jump", "peak_speed"))
        seconds = np.mean([seam.seconds for seam in measured])
        cells = (f"{whole_percent:.1f} %", f"{100.0 * down:.1f} %", f"{jump:.2f}", f"{peak:.2f}", f"{seconds:.2f}")
        print(LINE.format(system or "signsplice", n_pairs, filled, *cells), flush=True)


if __name__ == "__main__":
    main()
