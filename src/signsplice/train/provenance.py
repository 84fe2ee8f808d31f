"""Where a network comes from: its command, and the sha256 of the data that it is trained on.

Every bundle names both for each of its networks, so that its training can be repeated and its data checked with
``sha256sum``. Nothing in them depends on the machine or on where a bundle is written: absolute paths are shortened to
their last part, and commands are recorded without the folder that they write.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from signsplice.errors import InputError
from signsplice.formats import atomic

KEYS = ("command", "seed", "data", "signsplice", "started_from", "tuned")
"""What a bundle says of how a network was trained; the last two only where it was trained further or tuned."""

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
