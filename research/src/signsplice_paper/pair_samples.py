"""Scores on other pairs than those of the test part, and on chosen ones of it.

- PAA on a fixed sample of the pairs that a system learned from: what it cannot even learn by heart.
- Accuracy on the validation pairs that its training was judged on: the last point of its curve.
"""

from __future__ import annotations

from signsplice.signer.signer import stream
from signsplice_workshop.corpora.pairs import Pairs

N_TAUGHT = 500
N_VALID = 256

SIGNATURES = {
    "paa_train": f"paa|of:predicted|pairs:{N_TAUGHT}-of-train",
    "accuracy_valid": f"accuracy|pairs:first-{N_VALID}-of-valid",
}


def sample(pairs: Pairs, split: str, part: str, count: int = N_TAUGHT) -> list[int]:
    """A fixed sample of the pairs of a part."""
    numbers = pairs.split(split, part)
    order = stream("paper-taught", len(numbers)).permutation(len(numbers))[:count]
    return [numbers[k] for k in sorted(order.tolist())]


def validation(pairs: Pairs, split: str, count: int = N_VALID) -> list[int]:
    """The first pairs of the split's validation part, in the fixed order in which a training judges them."""
    numbers = pairs.split(split, "valid")
    return [numbers[k] for k in stream("judged", len(numbers)).permutation(len(numbers))[:count].tolist()]
