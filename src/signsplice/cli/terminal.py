"""Warnings and progress on standard error, and checks for packages that a command needs."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec

from signsplice.errors import MissingExtraError

_LONG = 500
"""Minimum number of steps for which progress is printed without a terminal."""


def warn(lines: Iterable[str]) -> None:
    """Write each line as a warning to standard error."""
    for line in lines:
        print(f"warning: {line}", file=sys.stderr)


def note(lines: Iterable[str]) -> None:
    """Write each line as a note to standard error."""
    for line in lines:
        print(f"note: {line}", file=sys.stderr)


def size(n_bytes: int) -> str:
    """Format a number of bytes in MB, or in kB below one MB."""
    return f"{n_bytes / 1e6:.0f} MB" if n_bytes >= 1_000_000 else f"{n_bytes / 1e3:.0f} kB"


def require(what: str, extra: str, *modules: str) -> None:
    """Raise ``MissingExtraError`` if a package of an extra is not installed; ``what`` needs it."""
    missing = next((name for name in modules if find_spec(name) is None), None)
    if missing is not None:
        raise MissingExtraError(f"{what} {missing}; install it with: pip install '.[{extra}]' in signsplice's folder")


@contextmanager
def progress(what: str) -> Iterator[Callable[[int, int], None] | None]:
    """Show a progress bar on standard error if that is a terminal, otherwise a line for each tenth of long work."""
    if not sys.stderr.isatty():

        def tell(done: int, total: int) -> None:
            if total >= _LONG and done % (total // 10) == 0:
                print(f"{what}: {done:,} of {total:,}", file=sys.stderr, flush=True)

        yield tell
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(what, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


def with_option_names(message: str) -> str:
    """Return a message of the library in which command-line options replace the fields of ``SpliceOptions``."""

    def option(field: re.Match[str]) -> str:
        name = {"duration": "transition_time"}.get(field[1], field[1])
        return "--" + name.replace("_", "-")

    return re.sub(r"SpliceOptions\.(\w+)", option, message)
