"""Random numbers by name: each drawn thing has its own stream, so that one draw never changes another."""

from __future__ import annotations

import hashlib

import numpy as np


def stream(*names: str | int) -> np.random.Generator:
    """A generator (PCG64) seeded by the names alone: the same on every machine and in every order of draws."""
    digest = hashlib.sha256("\x1f".join(map(str, names)).encode("utf-8", "surrogatepass")).digest()
    return np.random.Generator(np.random.PCG64(int.from_bytes(digest[:16], "little")))
