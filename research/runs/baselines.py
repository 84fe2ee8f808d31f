"""Scores the baselines of positions on a corpus of pairs: `python research/runs/baselines.py PAIRS OUT.csv`."""

import csv
import sys
import time
from pathlib import Path

from signsplice_paper.position_baselines import BASELINES, score_positions
from signsplice_workshop.corpora.pairs import Pairs

pairs = Pairs(sys.argv[1])
with Path(sys.argv[2]).open("w", encoding="utf-8", newline="") as file:
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(("corpus", "baseline", "split", "pairs", "pre", "post", "exact", "within one"))
    for name, make_baseline in BASELINES.items():
        for split in pairs.head["splits"]:
            start = time.process_time()
            numbers = pairs.split(split, "test")
            scores = score_positions(pairs, numbers, make_baseline(pairs, split))
            writer.writerow((pairs.head["hash"], name, split, len(numbers), *(f"{x:.3f}" for x in scores.values())))
            print(f"{name}, {split}: {scores} in {time.process_time() - start:.1f} s", flush=True)
