"""Splits of a corpus of pairs into training, validation and test, drawn by seed."""

from __future__ import annotations

from collections.abc import Sequence

from signsplice.synth.rng import stream


def draw_splits(seed: int, n_words: int, pairs: Sequence[tuple[int, int, int]]) -> dict[str, dict[str, list[int]]]:
    """Numbers of the pairs (signer, word before, word after) for training, validation and test, by seed.

    random: pairs drawn 80 : 10 : 10 (the paper's protocol; the paper does not print its ratio). unseen-words: words
    drawn 70 : 10 : 20; a pair belongs where both of its words do, and other pairs are left out. unseen-signer: training
    and validation of random, tested on the second signer.
    """
    rng = stream("splits", seed, n_words)
    first = [k for k, (signer, _, _) in enumerate(pairs) if signer == 0]
    order = rng.permutation(first).tolist()
    a, b = round(0.8 * len(order)), round(0.9 * len(order))
    random = {"train": sorted(order[:a]), "valid": sorted(order[a:b]), "test": sorted(order[b:])}
    words = rng.permutation(n_words).tolist()
    a, b = round(0.7 * n_words), round(0.8 * n_words)
    groups = {"train": set(words[:a]), "valid": set(words[a:b]), "test": set(words[b:])}
    unseen = {
        name: [k for k in first if pairs[k][1] in group and pairs[k][2] in group] for name, group in groups.items()
    }
    others = [k for k, (signer, _, _) in enumerate(pairs) if signer == 1]
    return {
        "random": random,
        "unseen-words": unseen,
        "unseen-signer": {"train": random["train"], "valid": random["valid"], "test": others},
    }
