"""A training's log: JSON lines, and TensorBoard files where TensorBoard is installed."""

from __future__ import annotations

import json
from pathlib import Path
from types import TracebackType
from typing import Any

from signsplice.formats import atomic

NAME = "log.jsonl"


class Log:
    """Appends to ``log.jsonl`` of a folder. Lines after ``step`` are removed first: those steps are done again.

    Writes nothing where ``enabled`` is False.
    """

    def __init__(self, folder: Path, step: int, enabled: bool = True) -> None:
        self._file = None
        self._board: Any = None
        if not enabled:
            return
        path = folder / NAME
        kept = [line for line in lines(path) if line["step"] <= step]
        atomic.write(path, "".join(json.dumps(line) + "\n" for line in kept))
        self._file = path.open("a", encoding="utf-8")
        try:
            from torch.utils.tensorboard import SummaryWriter
        except ImportError:
            return
        self._board = SummaryWriter(folder / "tensorboard", purge_step=step + 1)

    def write(self, step: int, **numbers: float) -> None:
        """Append one line."""
        if self._file is None:
            return
        self._file.write(json.dumps({"step": step, **{k: round(v, 7) for k, v in numbers.items()}}) + "\n")
        self._file.flush()
        if self._board is not None:
            for name, value in numbers.items():
                self._board.add_scalar(name, value, step)

    def __enter__(self) -> Log:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._file is not None:
            self._file.close()
        if self._board is not None:
            self._board.close()


def cpu_seconds(folder: Path, step: int) -> float:
    """Processor seconds in a training's log up to a step, of the first process; 0 without a log."""
    return max((line.get("cpu_s", 0.0) for line in lines(folder / NAME) if line["step"] <= step), default=0.0)


def lines(path: Path) -> list[dict[str, Any]]:
    """The lines of a log; one that an interruption cut off is left out."""
    if not path.exists():
        return []
    found = []
    for text in path.read_text(encoding="utf-8").splitlines():
        try:
            found.append(json.loads(text))
        except ValueError:
            continue
    return found
