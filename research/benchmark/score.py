"""Scores a folder of predictions for the splices of a corpus. Needs Python 3.11 and numpy, nothing else.

    python score.py PAIRS PREDICTIONS [--split random] [--part test]

PAIRS is the corpus (research/docs/benchmark.md says how it is made). PREDICTIONS holds two arrays:

    splices.npy  (n, 5)  whole numbers: pair, pre, post, first frame, number of frames
    frames.npy   (F, K)  the transitions' frames, one after another, as coordinates in [-0.5, 0.5]

pair: its row in pairs.npy. pre: last frame kept of the word before; post: first frame kept of the word after; -1: not
found. Every pair of the split's part stands once. It prints JSON; the scores are those of `signsplice-paper judge`.
"""

from __future__ import annotations

import argparse
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
VISIBLE = 0.002  # squared error that a frame too many or too few counts as: lambda^2 / K = sigma^2
TOLERANCE = 1e-4  # two frames are equal up to this mean squared difference
ORDERS = 4
VERSION = 1


def read_truth(folder: Path, split: str, part: str) -> tuple[dict[str, Any], dict[int, tuple[int, int, Array]]]:
    """The corpus's head, and pre, post and frames of each pair of the part."""
    head = json.loads((folder / "corpus.json").read_text(encoding="utf-8"))
    index, new = np.load(folder / "pairs.npy"), np.load(folder / "new_positions.npy", mmap_mode="r")
    truth = {}
    for pair in head["splits"][split][part]:
        _, _, pre, post, first, count = index[pair].tolist()
        truth[pair] = (pre, post, np.asarray(new[first : first + count], np.float64))
    return head, truth


def read_predictions(folder: Path, pairs: set[int], n_numbers: int) -> dict[int, tuple[int, int, Array]]:
    """Pre, post and frames of each pair. Raises ``SystemExit`` with what is wrong."""
    splices, frames = np.load(folder / "splices.npy"), np.load(folder / "frames.npy", mmap_mode="r")
    if splices.ndim != 2 or splices.shape[1] != 5 or splices.dtype.kind != "i":
        raise SystemExit(f"splices.npy: {splices.dtype} {splices.shape}, expected whole numbers (n, 5)")
    if frames.ndim != 2 or frames.shape[1] != n_numbers or not np.isfinite(frames).all():
        raise SystemExit(f"frames.npy: {frames.shape}, expected finite numbers (F, {n_numbers})")
    given = splices[:, 0].tolist()
    if len(set(given)) != len(given) or set(given) != pairs:
        raise SystemExit(f"splices.npy: {len(given)} pairs, expected each of the {len(pairs)} of the part once")
    if np.any(splices[:, 3:] < 0) or np.any(splices[:, 3] + splices[:, 4] > len(frames)):
        raise SystemExit("splices.npy: frames that are not in frames.npy")
    return {
        pair: (pre, post, np.asarray(frames[first : first + count], np.float64))
        for pair, pre, post, first, count in splices.tolist()
    }


def ngrams(made: Array, true: Array) -> tuple[list[int], list[int]]:
    """For n = 1..4: how many predicted n-grams equal a true one, and the size of a maximum matching of both."""
    n, m = len(made), len(true)
    near = ((made[:, None] - true[None]) ** 2).mean(-1) <= TOLERANCE if n and m else np.zeros((n, m), bool)
    found, matched = [], []
    for order in range(1, ORDERS + 1):
        rows, columns = max(0, n - order + 1), max(0, m - order + 1)
        equal = np.ones((rows, columns), bool)
        for k in range(order):
            equal &= near[k : k + rows, k : k + columns]
        found.append(int(equal.any(axis=1).sum()) if equal.size else 0)
        matched.append(matching(equal))
    return found, matched


def matching(equal: Array) -> int:
    """The size of a maximum matching of a bipartite graph (N, M), by augmenting paths."""
    partner: dict[int, int] = {}

    def augment(row: int, seen: set[int]) -> bool:
        for column in np.flatnonzero(equal[row]).tolist():
            if column not in seen:
                seen.add(column)
                if column not in partner or augment(partner[column], seen):
                    partner[column] = row
                    return True
        return False

    return sum(augment(row, set()) for row in range(len(equal)))


def scores(predicted: dict[int, tuple[int, int, Array]], truth: dict[int, tuple[int, int, Array]]) -> dict[str, float]:
    """The paper's scores over all pairs; NaN where there is nothing to count."""
    accuracy, mse, same, off, lengths, counts = [], [], [], [], [], []
    for pair, (pre, post, true) in truth.items():
        found_pre, found_post, made = predicted[pair]
        n, m = len(made), len(true)
        same.append(n == m)
        if n == m:
            accuracy.append(float(1.0 - np.abs(made - true).mean()) if m else 1.0)
            mse.append(float(((made - true) ** 2).sum() / true.shape[1]))
        else:
            accuracy.append(1.0 - abs(n - m) * math.sqrt(VISIBLE))
            mse.append((n - m) ** 2 * VISIBLE)
        off.append(None if min(found_pre, found_post) < 0 else (abs(found_pre - pre), abs(found_post - post)))
        lengths.append((n, m))
        counts.append(ngrams(made, true))
    known = [errors for errors in off if errors is not None]
    exact = sum(errors == (0, 0) for errors in known)
    n_made, n_true = (sum(column) for column in zip(*lengths, strict=True))
    out = {
        "accuracy": mean(accuracy),
        "accuracy_equal": mean([a for a, s in zip(accuracy, same, strict=True) if s]),
        "mse": mean(mse),
        "mse_equal": mean([e for e, s in zip(mse, same, strict=True) if s]),
        "length_exact": mean(same),
        "length_off": mean([abs(n - m) for n, m in lengths]),
        "length_ratio": n_made / max(1, n_true),
        "pta": len(known) / len(off),
        "paa": exact / len(known) if known else math.nan,
        "paa_all": exact / len(off),
        "within_1": mean([max(errors) <= 1 for errors in known]),
        "within_2": mean([max(errors) <= 2 for errors in known]),
    }
    return out | bleu(counts, lengths)


def bleu(counts: list[tuple[list[int], list[int]]], lengths: list[tuple[int, int]]) -> dict[str, float]:
    """The paper's BLEU-n, a mean over pairs of one n alone, and Papineni's over the corpus."""
    out, logs = {}, 0.0
    n_made, n_true = (sum(column) for column in zip(*lengths, strict=True))
    brevity = 1.0 if n_made >= n_true else math.exp(1.0 - n_true / n_made) if n_made else 0.0
    for k in range(ORDERS):
        both = [(max(0, n - k), max(0, m - k)) for n, m in lengths]
        shares = [found[k] / n if n else 0.0 for (found, _), (n, m) in zip(counts, both, strict=True) if m]
        out[f"bleu-{k + 1}"] = mean(shares)
        total, wanted = (sum(column) for column in zip(*both, strict=True))
        hits = sum(matched[k] for _, matched in counts)
        precision = hits / total if total else 0.0 if wanted else math.nan
        logs += math.log(precision) if precision > 0.0 else precision if math.isnan(precision) else -math.inf
        out[f"papineni-{k + 1}"] = brevity * math.exp(logs / (k + 1))
    return out


def mean(values: list[Any]) -> float:
    """The mean, NaN of nothing."""
    return float(np.mean(values)) if values else math.nan


def main() -> None:
    """Read, score, print."""
    ask = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ask.add_argument("pairs", type=Path)
    ask.add_argument("predictions", type=Path)
    ask.add_argument("--split", default="random")
    ask.add_argument("--part", default="test")
    given = ask.parse_args()
    head, truth = read_truth(given.pairs, given.split, given.part)
    n_numbers = next(iter(truth.values()))[2].shape[1]
    found = scores(read_predictions(given.predictions, set(truth), n_numbers), truth)
    found = {name: None if math.isnan(value) else value for name, value in found.items()}
    about = {"version": VERSION, "corpus": head["hash"], "split": given.split, "part": given.part, "pairs": len(truth)}
    print(json.dumps(about | {"scores": found}, indent=1))


if __name__ == "__main__":
    main()
