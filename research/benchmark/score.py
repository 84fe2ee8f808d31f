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
    """Returns the corpus's metadata, and pre, post and frames (n, K) of each pair of the part."""
    head = json.loads((folder / "corpus.json").read_text(encoding="utf-8"))
    index, new_frames = np.load(folder / "pairs.npy"), np.load(folder / "new_positions.npy", mmap_mode="r")
    truth = {}
    for pair in head["splits"][split][part]:
        _, _, pre, post, first, count = index[pair].tolist()
        truth[pair] = (pre, post, np.asarray(new_frames[first : first + count], np.float64))
    return head, truth


def read_predictions(folder: Path, pairs: set[int], n_numbers: int) -> dict[int, tuple[int, int, Array]]:
    """Returns pre, post and frames (n, K) of each pair. Raises ``SystemExit`` with the error if an array is wrong."""
    splices, frames = np.load(folder / "splices.npy"), np.load(folder / "frames.npy", mmap_mode="r")
    if splices.ndim != 2 or splices.shape[1] != 5 or splices.dtype.kind != "i":
        raise SystemExit(f"splices.npy: {splices.dtype} {splices.shape}, expected whole numbers (n, 5)")
    if frames.ndim != 2 or frames.shape[1] != n_numbers or not np.isfinite(frames).all():
        raise SystemExit(f"frames.npy: {frames.shape}, expected finite numbers (F, {n_numbers})")
    numbers = splices[:, 0].tolist()
    if len(set(numbers)) != len(numbers) or set(numbers) != pairs:
        raise SystemExit(f"splices.npy: {len(numbers)} pairs, expected each of the {len(pairs)} of the part once")
    if np.any(splices[:, 3:] < 0) or np.any(splices[:, 3] + splices[:, 4] > len(frames)):
        raise SystemExit("splices.npy: frames that are not in frames.npy")
    return {
        pair: (pre, post, np.asarray(frames[first : first + count], np.float64))
        for pair, pre, post, first, count in splices.tolist()
    }


def count_ngrams(predicted: Array, true: Array) -> tuple[list[int], list[int]]:
    """Returns for n = 1..4 how many predicted n-grams equal a true one, and the size of a maximum matching of both."""
    n, m = len(predicted), len(true)
    equal_frames = ((predicted[:, None] - true[None]) ** 2).mean(-1) <= TOLERANCE if n and m else np.zeros((n, m), bool)
    hits, matched = [], []
    for order in range(1, ORDERS + 1):
        rows, columns = max(0, n - order + 1), max(0, m - order + 1)
        equal_ngrams = np.ones((rows, columns), bool)
        for k in range(order):
            equal_ngrams &= equal_frames[k : k + rows, k : k + columns]
        hits.append(int(equal_ngrams.any(axis=1).sum()) if equal_ngrams.size else 0)
        matched.append(compute_matching_size(equal_ngrams))
    return hits, matched


def compute_matching_size(equal: Array) -> int:
    """Returns the size of a maximum matching of a bipartite graph (N, M), found by augmenting paths."""
    partner: dict[int, int] = {}

    def augment(row: int, visited: set[int]) -> bool:
        for column in np.flatnonzero(equal[row]).tolist():
            if column not in visited:
                visited.add(column)
                if column not in partner or augment(partner[column], visited):
                    partner[column] = row
                    return True
        return False

    return sum(augment(row, set()) for row in range(len(equal)))


def compute_scores(
    predicted: dict[int, tuple[int, int, Array]], truth: dict[int, tuple[int, int, Array]]
) -> dict[str, float]:
    """Returns the paper's scores over all pairs; NaN if there is nothing to count."""
    accuracy, mse, same_length, position_errors, lengths, counts = [], [], [], [], [], []
    for pair, (pre, post, true_frames) in truth.items():
        predicted_pre, predicted_post, predicted_frames = predicted[pair]
        n, m = len(predicted_frames), len(true_frames)
        same_length.append(n == m)
        if n == m:
            accuracy.append(float(1.0 - np.abs(predicted_frames - true_frames).mean()) if m else 1.0)
            mse.append(float(((predicted_frames - true_frames) ** 2).sum() / true_frames.shape[1]))
        else:
            accuracy.append(1.0 - abs(n - m) * math.sqrt(VISIBLE))
            mse.append((n - m) ** 2 * VISIBLE)
        position_errors.append(
            None if min(predicted_pre, predicted_post) < 0 else (abs(predicted_pre - pre), abs(predicted_post - post))
        )
        lengths.append((n, m))
        counts.append(count_ngrams(predicted_frames, true_frames))
    known = [errors for errors in position_errors if errors is not None]
    exact = sum(errors == (0, 0) for errors in known)
    n_predicted, n_true = (sum(column) for column in zip(*lengths, strict=True))
    summary = {
        "accuracy": compute_mean(accuracy),
        "accuracy_equal": compute_mean([a for a, s in zip(accuracy, same_length, strict=True) if s]),
        "mse": compute_mean(mse),
        "mse_equal": compute_mean([e for e, s in zip(mse, same_length, strict=True) if s]),
        "length_exact": compute_mean(same_length),
        "length_off": compute_mean([abs(n - m) for n, m in lengths]),
        "length_ratio": n_predicted / max(1, n_true),
        "pta": len(known) / len(position_errors),
        "paa": exact / len(known) if known else math.nan,
        "paa_all": exact / len(position_errors),
        "within_1": compute_mean([max(errors) <= 1 for errors in known]),
        "within_2": compute_mean([max(errors) <= 2 for errors in known]),
    }
    return summary | compute_bleu(counts, lengths)


def compute_bleu(counts: list[tuple[list[int], list[int]]], lengths: list[tuple[int, int]]) -> dict[str, float]:
    """Returns the paper's BLEU-n, a mean over pairs of one n alone, and Papineni's over the corpus."""
    summary, logs = {}, 0.0
    n_predicted, n_true = (sum(column) for column in zip(*lengths, strict=True))
    brevity = 1.0 if n_predicted >= n_true else math.exp(1.0 - n_true / n_predicted) if n_predicted else 0.0
    for k in range(ORDERS):
        ngram_counts = [(max(0, n - k), max(0, m - k)) for n, m in lengths]
        precisions = [equal[k] / n if n else 0.0 for (equal, _), (n, m) in zip(counts, ngram_counts, strict=True) if m]
        summary[f"bleu-{k + 1}"] = compute_mean(precisions)
        n_predicted_ngrams, n_true_ngrams = (sum(column) for column in zip(*ngram_counts, strict=True))
        n_matched = sum(matched[k] for _, matched in counts)
        precision = n_matched / n_predicted_ngrams if n_predicted_ngrams else 0.0 if n_true_ngrams else math.nan
        logs += math.log(precision) if precision > 0.0 else precision if math.isnan(precision) else -math.inf
        summary[f"papineni-{k + 1}"] = brevity * math.exp(logs / (k + 1))
    return summary


def compute_mean(values: list[Any]) -> float:
    """Returns the mean, NaN for no values."""
    return float(np.mean(values)) if values else math.nan


def main() -> None:
    """Reads the corpus and the predictions, and prints the scores as JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pairs", type=Path)
    parser.add_argument("predictions", type=Path)
    parser.add_argument("--split", default="random")
    parser.add_argument("--part", default="test")
    arguments = parser.parse_args()
    head, truth = read_truth(arguments.pairs, arguments.split, arguments.part)
    n_numbers = next(iter(truth.values()))[2].shape[1]
    summary = compute_scores(read_predictions(arguments.predictions, set(truth), n_numbers), truth)
    summary = {name: None if math.isnan(value) else value for name, value in summary.items()}
    header = {
        "version": VERSION,
        "corpus": head["hash"],
        "split": arguments.split,
        "part": arguments.part,
        "pairs": len(truth),
    }
    print(json.dumps(header | {"scores": summary}, indent=1))


if __name__ == "__main__":
    main()
