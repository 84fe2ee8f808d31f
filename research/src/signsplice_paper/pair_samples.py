"""Samples of training and validation pairs, on which a system is scored in addition to the test part.

- PAA on a fixed sample of the pairs that a system learned from: whether it can at least learn them by heart.
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
    """Returns a fixed sample of the pairs of a part."""
    numbers = pairs.split(split, part)
    order = stream("paper-taught", len(numbers)).permutation(len(numbers))[:count]
    return [numbers[k] for k in sorted(order.tolist())]


def sample_validation(pairs: Pairs, split: str, count: int = N_VALID) -> list[int]:
    """Returns the first pairs of the split's validation part, in the fixed order in which a training judges them."""
    numbers = pairs.split(split, "valid")
    return [numbers[k] for k in stream("judged", len(numbers)).permutation(len(numbers))[:count].tolist()]
