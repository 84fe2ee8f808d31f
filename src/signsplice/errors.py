"""What can go wrong, as kinds that a caller can tell apart.

Every message is one line: where, what was found, what was expected, what to do.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence


class SignspliceError(Exception):
    """Base of every error that signsplice raises on purpose."""


class InputError(SignspliceError):
    """An input or a call was wrong; nothing was written. The command line answers with exit status 2."""


class FormatError(InputError):
    """A file does not say what its format requires.

    The message has the form ``FILE:LINE: what, expected what``; the line is left out where a format has none.
    """

    def __init__(self, what: str, *, file: str = "", line: int | None = None) -> None:
        self.file, self.line, self.what = file, line, what
        where = f"{file or '<text>'}:{line}: " if line is not None else f"{file}: " if file else ""
        super().__init__(where + what)


class RigMismatchError(InputError):
    """Two skeletons have nothing in common, so no motion can be carried from one to the other."""


class UnknownGlossError(InputError):
    """A lexicon has no such word. ``unknown``: each gloss asked for -> the nearest ones that there are."""

    def __init__(self, unknown: Mapping[str, Sequence[str]], where: str) -> None:
        self.unknown = {gloss: tuple(nearest) for gloss, nearest in unknown.items()}
        self.where = where
        told = (
            f"{gloss!r} ({'nearest: ' + ', '.join(nearest) if nearest else 'nothing is near it'})"
            for gloss, nearest in self.unknown.items()
        )
        super().__init__(f"{where}: no gloss {'; '.join(told)}; `signsplice lexicon list` shows all")

    def __reduce__(self) -> tuple[type[UnknownGlossError], tuple[Mapping[str, Sequence[str]], str]]:
        return type(self), (self.unknown, self.where)


class MissingExtraError(SignspliceError):
    """A part needs a package that an extra installs; the message names the extra."""
