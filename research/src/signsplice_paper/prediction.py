"""The interface between systems and their evaluation: a system predicts a splice of two words."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from signsplice.motion import FloatArray

N_NUMBERS = 159
"""Numbers per frame: 53 joints with three coordinates each, in [-0.5, 0.5]."""


@dataclass(frozen=True, eq=False)
class Prediction:
    """A predicted splice.

    - pre: last kept frame of the word before, None if the system emitted no such token
    - post: first kept frame of the word after, None if the system emitted no such token
    - frames: the transition (n, 159); n = 0 if the system could make none
    - rotations: the transition's local rotations (n, J, 4), of methods on clips; None if only the numbers are known
    """

    pre: int | None
    post: int | None
    frames: FloatArray
    rotations: FloatArray | None = None


class System(Protocol):
    """A system that splices two words given as joint positions."""

    @property
    def name(self) -> str:
        """The system's name."""
        ...

    def predict(self, before: FloatArray, after: FloatArray) -> Prediction:
        """Returns the splice of ``before`` (N, 159) and ``after`` (M, 159), both in [-0.5, 0.5]."""
        ...

    def positions(self, before: FloatArray, after: FloatArray) -> tuple[int | None, int | None]:
        """Returns the positions pre and post alone."""
        ...
