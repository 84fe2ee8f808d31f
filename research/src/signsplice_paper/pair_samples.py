"""Scores on other pairs than those of the test part, and on chosen ones of it.

- PAA on a fixed sample of the pairs that a system learned from: what it cannot even learn by heart.
- Accuracy on the validation pairs that its training was judged on: the last point of its curve.
- PAA by how near the true cut is to another frame (``margins``).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import pairwise

from signsplice.signer.signer import stream
from signsplice_workshop.corpora.pairs import Pairs

N_TAUGHT = 500
N_VALID = 256
MARGINS = (0.1, 0.2, 0.35)
"""Limits between the groups of pairs, frames; margins are at most 0.5."""

SIGNATURES = {
    "paa_train": f"paa|of:predicted|pairs:{N_TAUGHT}-of-train",
    "accuracy_valid": f"accuracy|pairs:first-{N_VALID}-of-valid",
    "paa_margin": f"paa|of:predicted|by:frames-from-another-cut|limits:{','.join(f'{m:g}' for m in MARGINS)}",
}


def taught(pairs: Pairs, split: str) -> list[int]:
    """A fixed sample of ``N_TAUGHT`` pairs of the split's training part."""
    numbers = pairs.split(split, "train")
    order = stream("paper-taught", len(numbers)).permutation(len(numbers))[:N_TAUGHT]
    return [numbers[k] for k in sorted(order.tolist())]


def validation(pairs: Pairs, split: str, count: int = N_VALID) -> list[int]:
    """The first pairs of the split's validation part, in the fixed order in which a training judges them."""
    numbers = pairs.split(split, "valid")
    return [numbers[k] for k in stream("judged", len(numbers)).permutation(len(numbers))[:count].tolist()]


def margin_names() -> list[str]:
    """The groups in words, from the nearest to the farthest."""
    limits = [f"{limit:g}" for limit in MARGINS]
    return [
        f"under {limits[0]}",
        *(f"{a} to {b}" for a, b in pairwise(limits)),
        f"{limits[-1]} or more",
    ]


def by_margin(off: Mapping[int, tuple[int, int] | None], margins: Mapping[int, float]) -> dict[str, float]:
    """``paa_margin_1`` .. and ``n_margin_1`` ..: PAA and number of pairs predicted in every group; empty where no
    margin is known.

    off: errors of the positions by pair, None where a token is missing.
    """
    known = [(margins[k], errors) for k, errors in off.items() if k in margins and errors is not None]
    if not known:
        return {}
    out = {}
    limits = (-math.inf, *MARGINS, math.inf)
    for n, (low, high) in enumerate(pairwise(limits), 1):
        exact = [errors == (0, 0) for margin, errors in known if low <= margin < high]
        out[f"paa_margin_{n}"] = sum(exact) / len(exact) if exact else float("nan")
        out[f"n_margin_{n}"] = float(len(exact))
    return out
