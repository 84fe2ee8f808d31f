"""The bias of the tokens, by one rule for all systems: as much as it takes to find both in nearly all validation pairs.

It needs no training, and moves no position.
"""

from __future__ import annotations

import numpy as np

from signsplice.motion import FloatArray
from signsplice_paper.systems.splicers import NONE, POST, PRE, PaperSystem
from signsplice_workshop.corpora.pairs import Pairs

EMITTED = 0.999
"""Fraction of validation pairs for which both tokens must be emitted."""


def of_margins(missing: FloatArray) -> float:
    """The bias, from what each pair's tokens lack to be emitted (B,): the larger of both."""
    return max(0.0, float(np.quantile(missing, EMITTED, method="higher")) + 1e-3)


def token_bias(system: PaperSystem, pairs: Pairs, split: str) -> float:
    """The bias with which a trained system emits both tokens on ``EMITTED`` of the validation pairs; 0 without any."""
    missing = []
    for number in pairs.split(split, "valid"):
        p, q = pairs.index[number, :2].tolist()
        logits = system.tokens(pairs.word(p).astype(np.float64), pairs.word(q).astype(np.float64))
        margins = logits[:, [NONE]].astype(np.float64) - logits[:, [PRE, POST]]  # (N + M, 2)
        missing.append(margins.min(axis=0).max())
    return of_margins(np.array(missing)) if missing else 0.0
