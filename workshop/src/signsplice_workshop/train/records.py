"""Files that a training writes beside its weights: a log, and the origin of the network.

The log is JSON lines, and TensorBoard files if TensorBoard is installed. Every bundle names the command and the sha256
of the data of each of its networks, so that its training can be repeated and its data checked with ``sha256sum``.
Nothing in them depends on the machine or on where a bundle is written: absolute paths are shortened to their last part,
and commands are recorded without the folder that they write.
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

    Writes nothing if ``enabled`` is False.
    """

    def __init__(self, folder: Path, step: int, enabled: bool = True) -> None:
        self._file = None
        self._board: Any = None
        if not enabled:
            return
        path = folder / LOG_FILE
        kept_lines = [line for line in read_lines(path) if line["step"] <= step]
        atomic.write(path, "".join(json.dumps(line) + "\n" for line in kept_lines))
        self._file = path.open("a", encoding="utf-8")
        try:
            from torch.utils.tensorboard import SummaryWriter
        except ImportError:
            return
        self._board = SummaryWriter(folder / "tensorboard", purge_step=step + 1)

    def write(self, step: int, **numbers: float) -> None:
        """Appends one line."""
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


def read_cpu_seconds(folder: Path, step: int) -> float:
    """Returns the processor seconds in a training's log up to a step, of the first process; 0 without a log."""
    return max((line.get("cpu_s", 0.0) for line in read_lines(folder / LOG_FILE) if line["step"] <= step), default=0.0)


def read_lines(path: Path) -> list[dict[str, Any]]:
    """Returns the lines of a log, without one that an interruption cut off."""
    if not path.exists():
        return []
    entries = []
    for text in path.read_text(encoding="utf-8").splitlines():
        try:
            entries.append(json.loads(text))
        except ValueError:
            continue
    return entries


KEYS = ("command", "seed", "data", "signsplice", "commit", "started_from", "tuned")
"""Fields of a bundle about the training of a network: the commit only if it is known, the last two only if it was
trained further or tuned.
"""

Option = str | int | Path | bool | Sequence[Path] | None


def format_command(words: Sequence[str], options: Mapping[str, Option], program: str = "signsplice") -> list[str]:
    """Returns the words of a command of a program: ``words``, then every option with its value.

    An option that is None is left out, a flag stands alone, and an option with several values is repeated.
    """
    words = [program, *words]
    for option, value in options.items():
        if isinstance(value, bool):
            words.append(f"--{option}" if value else f"--no-{option}")
        elif isinstance(value, (str, int, Path)):
            words += [f"--{option}", shorten_path(value) if isinstance(value, Path) else str(value)]
        elif value is not None:
            for path in value:
                words += [f"--{option}", shorten_path(path)]
    return words


def shorten_path(path: Path) -> str:
    """Returns a relative path as it is, one in the working folder relative to it, and any other path's last part."""
    if path.is_absolute():
        working_folder = Path.cwd()
        return path.relative_to(working_folder).as_posix() if path.is_relative_to(working_folder) else path.name
    return path.as_posix()


def find_version() -> str:
    """Returns the version of this package."""
    try:
        return version("signsplice")
    except PackageNotFoundError:
        return "unknown"


def find_commit() -> str | None:
    """Returns the commit of the checkout with this code, with a + if tracked files differ from it; None outside of
    one.
    """
    folder = Path(__file__).parent

    def git(*words: str) -> str:
        return subprocess.run(
            ["git", "-C", str(folder), *words], capture_output=True, text=True, check=True
        ).stdout.strip()

    try:
        return git("rev-parse", "HEAD") + ("+" if git("status", "--porcelain", "--untracked-files=no") else "")
    except (OSError, subprocess.CalledProcessError):
        return None


def hash_file(path: Path) -> str:
    """Returns the sha256 of a file, read in pieces. Raises ``InputError`` if it cannot be read."""
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error


def hash_folder(folder: Path, *patterns: str) -> dict[str, str]:
    """Returns the sha256 of a folder's files whose names match one of the patterns, by name."""
    paths = {path for pattern in patterns for path in folder.glob(pattern) if path.is_file()}
    return {path.name: hash_file(path) for path in sorted(paths)}


def write_json(path: Path, content: Any) -> None:
    """Writes JSON whole or not at all."""
    atomic.write(path, json.dumps(content, indent=1) + "\n")
