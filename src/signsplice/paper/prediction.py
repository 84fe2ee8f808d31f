"""What a system says of two words, and what every system is: the one thing that the evaluation knows of networks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]

N_NUMBERS = 159
"""Numbers a frame: 53 joints, three coordinates each, in [-0.5, 0.5]."""


@dataclass(frozen=True, eq=False)
class Prediction:
    """A splice as a system predicts it.

    ``pre``: last frame kept of the word before, ``post``: first frame kept of the word after, None where the system
    emitted no such token; ``frames`` (n, 159): the transition, n = 0 where it could make none.
    """

    pre: int | None
    post: int | None
    frames: Float


class System(Protocol):
    """Anything that splices two words given as positions; the systems that the paper compares, and others beside
    them.
    """

    @property
    def name(self) -> str:
        """The system's name, as in the paper's tables."""
        ...

    def predict(self, before: Float, after: Float) -> Prediction:
        """The splice of ``before`` (N, 159) and ``after`` (M, 159), both in [-0.5, 0.5]."""
        ...
