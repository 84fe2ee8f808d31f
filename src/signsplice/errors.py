"""What can go wrong, as kinds that a caller can tell apart.

Every message is one line: where, what was found, what was expected, what to do.
"""


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


class MissingExtraError(SignspliceError):
    """A part needs a package that an extra installs; the message names the extra."""
