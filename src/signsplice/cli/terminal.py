"""What commands print: text with its hidden characters shown, warnings, progress; checks for packages they need."""

from __future__ import annotations

import re
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, TextIO

from signsplice.errors import MissingExtraError

if TYPE_CHECKING:
    from rich.console import Console

_LINE_S = 10.0
"""Seconds from one line of progress to the next without a terminal."""
_HIDDEN = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")
"""Controls of ASCII and Latin-1 but tab and line feed, marks that break lines or override their direction (Unicode
Standard Annex 9), and surrogates, which stand for bytes of file names that are not UTF-8.
"""


def visible(text: str) -> str:
    r"""Return a text with its hidden characters as escapes: ``\x1b``, or from 7f ``\u009b``, as JSON reads them."""
    return _HIDDEN.sub(lambda c: f"\\x{ord(c[0]):02x}" if c[0] < " " else f"\\u{ord(c[0]):04x}", text)


def one_line(text: str) -> str:
    """Return ``visible(text)`` with its line feeds as escapes too."""
    return visible(text).replace("\n", "\\x0a")


class VisibleStream:
    """A text stream that shows hidden characters: names in a file from elsewhere could move the cursor or forge lines.

    raw: receives the text.
    """

    def __init__(self, raw: TextIO) -> None:
        self.raw = raw

    def write(self, text: str) -> int:
        """Write a text, visibly, unless it is the end of a line that the next one replaces."""
        shown = text if text == "\r" else visible(text)
        encoding = getattr(self.raw, "encoding", None) or "utf-8"
        return self.raw.write(shown.encode(encoding, "backslashreplace").decode(encoding))

    def __getattr__(self, name: str) -> Any:
        return getattr(self.raw, name)


@contextmanager
def visible_output() -> Iterator[None]:
    """Show hidden characters on standard output and standard error."""
    streams = sys.stdout, sys.stderr
    try:
        sys.stdout, sys.stderr = (stream and VisibleStream(stream) for stream in streams)
        yield
    finally:
        sys.stdout, sys.stderr = streams


def warn(lines: Iterable[str]) -> None:
    """Write each line as a warning to standard error."""
    for line in lines:
        print(f"warning: {one_line(line)}", file=sys.stderr)


def note(lines: Iterable[str]) -> None:
    """Write each line as a note to standard error."""
    for line in lines:
        print(f"note: {one_line(line)}", file=sys.stderr)


def size(n_bytes: int) -> str:
    """Format a number of bytes in MB, or in kB below one MB."""
    return f"{n_bytes / 1e6:.0f} MB" if n_bytes >= 1_000_000 else f"{n_bytes / 1e3:.0f} kB"


def require(what: str, extra: str, *modules: str) -> None:
    """Raise ``MissingExtraError`` if a package of an extra is not installed; ``what`` needs it."""
    missing = next((name for name in modules if find_spec(name) is None), None)
    if missing is not None:
        raise MissingExtraError(f"{what} {missing}; install it with: pip install '.[{extra}]' in signsplice's folder")


def open_console() -> Console:
    """Return a console of Rich on standard error, which gets Rich's own control sequences as they are."""
    from rich.console import Console

    return Console(file=getattr(sys.stderr, "raw", sys.stderr))


@contextmanager
def progress(what: str) -> Iterator[Callable[[int, int], None] | None]:
    """Show a progress bar on standard error if that is a terminal, otherwise a line every ten seconds."""
    if not sys.stderr.isatty():
        told = time.monotonic()

        def tell(done: int, total: int) -> None:
            nonlocal told
            if time.monotonic() - told >= _LINE_S:
                told = time.monotonic()
                print(f"{what}: {done:,} of {total:,}", file=sys.stderr, flush=True)

        yield tell
        return
    from rich.progress import Progress

    with Progress(console=open_console(), transient=True) as bar:
        task = bar.add_task(what, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


def with_option_names(message: str) -> str:
    """Return a message of the library in which command-line options replace the fields of ``SpliceOptions``."""

    def option(field: re.Match[str]) -> str:
        name = {"duration": "transition_time"}.get(field[1], field[1])
        return "--" + name.replace("_", "-")

    return re.sub(r"SpliceOptions\.(\w+)", option, message)
