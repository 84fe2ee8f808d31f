"""Exceptions. Every message is one line: location, actual value, expected value, remedy."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

_MOST_QUOTED = 80
"""Characters of a gloss that a message quotes."""


class SignspliceError(Exception):
    """Base of every error that signsplice raises on purpose."""


class InputError(SignspliceError):
    """The input or call is invalid; nothing was written. The command line exits with status 2."""


class FormatError(InputError):
    """A file does not follow its format.

    what: the actual and the expected content.
    file: path; empty for text that is not from a file.
    line: line number; None for a format without lines.

    The message is ``FILE:LINE: what``.
    """

    def __init__(self, what: str, *, file: str = "", line: int | None = None) -> None:
        what = " ".join(what.splitlines())  # it may quote the file's content
        self.file, self.line, self.what = file, line, what
        where = f"{file or '<text>'}:{line}: " if line is not None else f"{file}: " if file else ""
        super().__init__(where + what)


class LimitError(FormatError):
    """A file exceeds ``formats.limits``, which can be lifted for trusted files."""


class RigMismatchError(InputError):
    """Two skeletons share too few body parts to retarget motion between them."""


class UnknownGlossError(InputError):
    """A lexicon lacks some glosses.

    unknown: missing gloss -> the nearest glosses; empty if none is similar enough.
    where: name of the lexicon.
    """

    def __init__(self, unknown: Mapping[str, Sequence[str]], where: str) -> None:
        self.unknown = {gloss: tuple(nearest) for gloss, nearest in unknown.items()}
        self.where = where
        super().__init__(f"{where}: {self.describe('nothing is near it')}; `signsplice lexicon list` shows all")

    def describe(self, without_nearest: str = "") -> str:
        """Return the glosses and the nearest ones in one line, without control characters and with long ones shortened.
        ``without_nearest``: what is said of a gloss that none is near.
        """
        lines = []
        for gloss, nearest in self.unknown.items():
            hint = f"nearest: {', '.join(_quote(name)[1:-1] for name in nearest)}" if nearest else without_nearest
            lines.append(_quote(gloss) + (f" ({hint})" if hint else ""))
        return f"no gloss {'; '.join(lines)}"

    def __reduce__(self) -> tuple[type[UnknownGlossError], tuple[Mapping[str, Sequence[str]], str]]:
        return type(self), (self.unknown, self.where)


class MissingExtraError(SignspliceError):
    """A package of an extra is not installed; the message names the extra."""


def _quote(name: str) -> str:
    return repr(name if len(name) <= _MOST_QUOTED else name[: _MOST_QUOTED - 3] + "...")
