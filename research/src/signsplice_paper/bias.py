"""The bias of the tokens' logits, chosen by one rule for all systems: the least one with which nearly all validation
pairs emit both tokens.

It needs no training, and changes no predicted position.
"""

from __future__ import annotations

import numpy as np

from signsplice.motion import FloatArray

EMITTED = 0.999
"""Fraction of validation pairs for which both tokens must be emitted."""


def choose_bias(shortfalls: FloatArray) -> float:
    """Returns the bias of the tokens' logits.

    shortfalls: what each pair's tokens lack to be emitted (B,), the larger of both.
    """
    return max(0.0, float(np.quantile(shortfalls, EMITTED, method="higher")) + 1e-3)
