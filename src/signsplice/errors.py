"""Exceptions. Every message is one line: where, what was given, what was expected, what to do."""

from __future__ import annotations

from collections.abc import Mapping, Sequence


class SignspliceError(Exception):
    """Base of every error that signsplice raises on purpose."""


class InputError(SignspliceError):
    """A wrong input or call; nothing was written. The command line exits with status 2."""


class FormatError(InputError):
    """A file that does not follow its format.

    what: what was found and what was expected.
    file: path; empty for text that is not from a file.
    line: line number; None for a format without lines.

    The message is ``FILE:LINE: what``.
    """

    def __init__(self, what: str, *, file: str = "", line: int | None = None) -> None:
        what = " ".join(what.splitlines())  # it may quote what the file holds
        self.file, self.line, self.what = file, line, what
        where = f"{file or '<text>'}:{line}: " if line is not None else f"{file}: " if file else ""
        super().__init__(where + what)


class LimitError(FormatError):
    """A file that asks for more than ``formats.limits`` allows. The limits can be lifted for files that are trusted."""


class RigMismatchError(InputError):
    """Two skeletons with too few body parts in common to retarget motion from one to the other."""


class UnknownGlossError(InputError):
    """Glosses that a lexicon does not have.

    unknown: each of them -> the glosses nearest to it, none where nothing is near.
    where: the lexicon.
    """

    def __init__(self, unknown: Mapping[str, Sequence[str]], where: str) -> None:
        self.unknown = {gloss: tuple(nearest) for gloss, nearest in unknown.items()}
        self.where = where
        glosses = (
            f"{gloss!r} ({'nearest: ' + ', '.join(nearest) if nearest else 'nothing is near it'})"
            for gloss, nearest in self.unknown.items()
        )
        super().__init__(f"{where}: no gloss {'; '.join(glosses)}; `signsplice lexicon list` shows all")

    def __reduce__(self) -> tuple[type[UnknownGlossError], tuple[Mapping[str, Sequence[str]], str]]:
        return type(self), (self.unknown, self.where)


class MissingExtraError(SignspliceError):
    """A package is missing that an extra installs; the message names the extra."""
