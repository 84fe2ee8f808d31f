"""What a training writes beside its weights: a log, and where the network comes from.

The log is JSON lines, and TensorBoard files where TensorBoard is installed. Every bundle names the command and the
sha256 of the data of each of its networks, so that its training can be repeated and its data checked with
``sha256sum``. Nothing in them depends on the machine or on where a bundle is written: absolute paths are shortened to
their last part, and commands are recorded without the folder that they write.
"""

from __future__ import annotations

import hashlib
import json
import subprocess
from collections.abc import Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import TracebackType
from typing import Any

from signsplice.errors import InputError
from signsplice.formats import atomic

LOG_FILE = "log.jsonl"


class Log:
    """Appends to ``log.jsonl`` of a folder. Lines after ``step`` are removed first: those steps are done again.

    Writes nothing where ``enabled`` is False.
    """

    def __init__(self, folder: Path, step: int, enabled: bool = True) -> None:
        self._file = None
        self._board: Any = None
        if not enabled:
            return
        path = folder / LOG_FILE
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
    return max((line.get("cpu_s", 0.0) for line in lines(folder / LOG_FILE) if line["step"] <= step), default=0.0)


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


KEYS = ("command", "seed", "data", "signsplice", "commit", "started_from", "tuned")
"""What a bundle says of how a network was trained: the commit only where it is known, the last two only where it was
trained further or tuned.
"""

Option = str | int | Path | bool | Sequence[Path] | None


def command(words: Sequence[str], options: Mapping[str, Option], program: str = "signsplice") -> list[str]:
    """The words of a command of a program: ``words``, then every option with its value.

    An option that is None is left out, a flag stands alone, and an option with several values is repeated.
    """
    words = [program, *words]
    for option, value in options.items():
        if isinstance(value, bool):
            words.append(f"--{option}" if value else f"--no-{option}")
        elif isinstance(value, (str, int, Path)):
            words += [f"--{option}", portable(value) if isinstance(value, Path) else str(value)]
        elif value is not None:
            for one in value:
                words += [f"--{option}", portable(one)]
    return words


def portable(path: Path) -> str:
    """A path as it was given if it is relative; relative to the working folder if it lies there; else its last part."""
    if path.is_absolute():
        here = Path.cwd()
        return path.relative_to(here).as_posix() if path.is_relative_to(here) else path.name
    return path.as_posix()


def software() -> str:
    """The version of this package."""
    try:
        return version("signsplice")
    except PackageNotFoundError:
        return "unknown"


def commit() -> str | None:
    """The commit of the checkout that this code lies in, with a + where tracked files differ from it; None outside."""
    here = Path(__file__).parent

    def git(*words: str) -> str:
        return subprocess.run(
            ["git", "-C", str(here), *words], capture_output=True, text=True, check=True
        ).stdout.strip()

    try:
        return git("rev-parse", "HEAD") + ("+" if git("status", "--porcelain", "--untracked-files=no") else "")
    except (OSError, subprocess.CalledProcessError):
        return None


def sha256(path: Path) -> str:
    """The sha256 of a file, read in pieces. Raises ``InputError`` where it cannot be read."""
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error


def folder_sha256(folder: Path, *patterns: str) -> dict[str, str]:
    """The sha256 of a folder's files whose names match one of the patterns, by name."""
    paths = {path for pattern in patterns for path in folder.glob(pattern) if path.is_file()}
    return {path.name: sha256(path) for path in sorted(paths)}


def write_json(path: Path, content: Any) -> None:
    """Write JSON whole or not at all."""
    atomic.write(path, json.dumps(content, indent=1) + "\n")
