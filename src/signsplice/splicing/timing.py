"""How long each part of a splice takes."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Literal

Part = Literal["harmonize", "cut", "transition", "join"]
"""Parts as the report names them: aligning clips, choosing cuts, making new frames, joining and scoring."""
PARTS: tuple[Part, ...] = ("harmonize", "cut", "transition", "join")


class Timing:
    """Seconds that were spent on each part so far."""

    def __init__(self) -> None:
        self._seconds: dict[Part, float] = defaultdict(float)

    @contextmanager
    def of(self, part: Part) -> Iterator[None]:
        """Count the time of the block to a part."""
        start = time.perf_counter()
        yield
        self._seconds[part] += time.perf_counter() - start

    def add(self, part: Part, seconds: float) -> None:
        """Count seconds to a part."""
        self._seconds[part] += seconds

    @property
    def milliseconds(self) -> dict[str, float]:
        """Milliseconds by part."""
        return {part: 1e3 * self._seconds[part] for part in PARTS}
