"""The bias of the tokens, by one rule for all systems: as much as it takes to find both in nearly all validation pairs.

It needs no training, and moves no position.
"""

from __future__ import annotations

import numpy as np

from signsplice.motion import FloatArray

EMITTED = 0.999
"""Fraction of validation pairs for which both tokens must be emitted."""


def of_margins(missing: FloatArray) -> float:
    """The bias, from what each pair's tokens lack to be emitted (B,): the larger of both."""
    return max(0.0, float(np.quantile(missing, EMITTED, method="higher")) + 1e-3)
