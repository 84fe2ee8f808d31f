"""Random numbers by name: each thing that is drawn has a stream of its own, so that no draw moves another."""

from __future__ import annotations

import hashlib

import numpy as np


def stream(*names: str | int) -> np.random.Generator:
    """A generator (PCG64) seeded by the names alone: the same on every machine, whatever else was drawn before."""
    digest = hashlib.sha256("\x1f".join(map(str, names)).encode()).digest()
    return np.random.Generator(np.random.PCG64(int.from_bytes(digest[:16], "little")))
