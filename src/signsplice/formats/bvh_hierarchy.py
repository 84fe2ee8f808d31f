"""The declarations in a BVH file: joints, End Sites and their channels.

Words may stand on any lines, keywords in upper or lower case. A joint's name goes to the brace or the end of the line:
names may have spaces, as those of 3ds Max.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field

import numpy as np

from signsplice.errors import FormatError, LimitError
from signsplice.formats.reading import ReadLimits
from signsplice.motion.euler import POSITIONS, ROTATIONS

_MAX_WORDS = 50_000
_LONGEST = 32
"""Words in the longest statement, CHANNELS, with some extra words that are invalid."""

_NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?")
SCALES = ("Xscale", "Yscale", "Zscale")
"""Channels that some programs write, with the number 1."""
_CHANNELS = {name.lower(): name for name in (*POSITIONS, *ROTATIONS, *SCALES)}


@dataclass
class Declaration:
    """A joint or an End Site, as declared.

    joint: index of the joint, or of the one that the End Site is in.
    is_site: whether it is an End Site.
    label: what it is called in messages.
    line: where it is declared.
    offset: its OFFSET, None until it is read.
    channels: names of its channels, in file order.
    """

    joint: int
    is_site: bool
    label: str
    line: int
    offset: list[float] | None = None
    channels: list[str] = field(default_factory=list)


@dataclass
class Hierarchy:
    """The declarations of HIERARCHY; ``read_line`` parses its lines one by one.

    file: name of the file, for messages.
    limits: of joints and their depth.
    names: of the joints, in file order; a name may stand twice.
    parents: index of each joint's parent, -1 for the root.
    declarations: joints and End Sites, in file order.
    notes: what is read in another form than it stands there.
    """

    file: str
    limits: ReadLimits
    names: list[str] = field(default_factory=list)
    parents: list[int] = field(default_factory=list)
    declarations: list[Declaration] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    _open: list[Declaration] = field(default_factory=list)  # declarations with an open brace
    _declared: Declaration | None = None  # what the next brace opens
    _started: bool = False
    _last_line: int = 1

    def fail(self, what: str, line: int | None = None) -> FormatError:
        """Make the error for ``what``, with the file and the line (by default the last one read)."""
        return FormatError(what, file=self.file, line=self._last_line if line is None else line)

    def too_much(self, what: str) -> LimitError:
        """Make the error for a skeleton that exceeds a limit."""
        return LimitError(f"{what}, expected a skeleton", file=self.file, line=self._last_line)

    def read_line(self, number: int, text: str) -> None:
        """Parse line ``number`` (from 1). Raises ``FormatError`` if it is not valid."""
        text = text.rstrip()
        tokens = (f"{text[:-1]} {{" if text.endswith("{") else text).split(None, _MAX_WORDS)
        self._last_line = number
        if len(tokens) > _MAX_WORDS:
            raise self.fail(f"more than {_MAX_WORDS} words in one line, expected a statement a line")
        if not self._started and tokens:
            if tokens[0].upper() != "HIERARCHY":
                raise self.fail(f"found {short(tokens[0])}, expected HIERARCHY; is this a BVH file?")
            self._started, tokens = True, tokens[1:]
        position = 0
        while position < len(tokens):
            words = tokens[position : position + _LONGEST]
            position += len(words) - len(self._read_statement(words))

    def _read_statement(self, tokens: list[str]) -> list[str]:
        """Parse the first statement of a line's tokens; returns the remaining tokens."""
        word, rest = tokens[0], tokens[1:]
        key = word.upper()
        if self._declared is not None and word != "{":
            raise self.fail(f"found {short(word)}, expected {{ after {self._declared.label}")
        if word == "{":
            if self._declared is None:
                raise self.fail("found {, expected ROOT, JOINT or End Site before it")
            self._open.append(self._declared)
            self._declared = None
            if len(self._open) > self.limits.depth:
                raise self.too_much(f"joints nest deeper than {self.limits.depth:g}")
            return rest
        if word == "}":
            self._close_brace()
            return rest
        if key in ("ROOT", "JOINT"):
            return self._declare_joint(key, rest)
        if key in ("END", "ENDSITE"):
            joint = self._current(word)
            if len(self.declarations) - len(self.names) >= self.limits.joints:
                raise self.too_much(f"more than {self.limits.joints:g} End Sites")
            name, rest = _split_name(rest)
            if name.upper() not in ("", "SITE"):
                self.note("names of End Sites are not kept")
            self._declare(Declaration(joint, True, "End Site", self._last_line))
            return rest
        if key == "OFFSET":
            return self._read_offset(rest)
        if key == "CHANNELS":
            return self._read_channels(rest)
        if key in ("FRAMES:", "FRAME"):
            raise self.fail(f"found {short(word)} without MOTION before it, expected a line MOTION")
        raise self.fail(f"found {short(word)}, expected JOINT, End Site, OFFSET, CHANNELS or a brace")

    def _current(self, word: str) -> int:
        if not self._open or self._open[-1].is_site:
            where = "inside an End Site" if self._open else "outside a joint"
            raise self.fail(f"{word} {where}, expected it inside a joint's braces")
        return self._open[-1].joint

    def _declare(self, declaration: Declaration) -> None:
        self.declarations.append(declaration)
        self._declared = declaration

    def note(self, what: str) -> None:
        """Add a line to the notes, once."""
        if what not in self.notes:
            self.notes.append(what)

    def _declare_joint(self, key: str, rest: list[str]) -> list[str]:
        name, rest = _split_name(rest)
        if key == "ROOT" and self.names:
            raise self.fail(f"a second ROOT {short(name)}, expected one skeleton a file; split the file")
        if key == "JOINT" and not self.names:
            raise self.fail(f"JOINT {short(name)} comes first, expected ROOT")
        parent = self._current(f"JOINT {name[:40]}") if key == "JOINT" else -1
        if len(self.names) >= self.limits.joints:
            raise self.too_much(f"more than {self.limits.joints:g} joints")
        if not name:
            self.note("joints without a name are numbered")
            name = f"joint{len(self.names)}"
        self._declare(Declaration(len(self.names), False, f"joint {short(name)}", self._last_line))
        self.names.append(name)
        self.parents.append(parent)
        return rest

    def _read_offset(self, rest: list[str]) -> list[str]:
        numbers = [number_of(token, self.file, self._last_line) for token in rest[:3]]
        if len(numbers) != 3 or (len(rest) > 3 and _NUMBER.fullmatch(rest[3])):
            raise self.fail(f"OFFSET with {len(rest)} values, expected 3 numbers")
        if not self._open:
            raise self.fail("OFFSET outside a joint, expected it inside braces")
        if self._open[-1].offset is not None:
            raise self.fail("a second OFFSET in one joint, expected one")
        self._open[-1].offset = numbers
        return rest[3:]

    def _read_channels(self, rest: list[str]) -> list[str]:
        if not self._open:
            raise self.fail("CHANNELS outside a joint, expected it inside a joint's braces")
        declaration = self._open[-1]
        if not rest or not rest[0].isdecimal():
            raise self.fail(f"CHANNELS {short(rest[0]) if rest else ''}, expected a number of channels")
        count = int(rest[0][:4])
        tokens = [token for token in rest[1 : 1 + count] if token not in "{}"]
        extra = rest[1 + count : 2 + count]
        if len(tokens) != count or (extra and extra[0].lower() in _CHANNELS):
            raise self.fail(f"CHANNELS {count} with {len(rest) - 1} names, expected {count} channel names")
        names = []
        for token in tokens:
            if token.lower() not in _CHANNELS:
                raise self.fail(
                    f"unknown channel {short(token)}, expected one of {', '.join((*POSITIONS, *ROTATIONS))}"
                )
            names.append(_CHANNELS[token.lower()])
        if len(set(names)) != len(names):
            raise self.fail(f"{declaration.label} has a channel twice, expected different channels")
        if declaration.channels:
            raise self.fail("a second CHANNELS in one joint, expected one")
        if declaration.is_site:
            self.note("channels of End Sites are not read: they turn no joint")
        declaration.channels = names
        return rest[1 + count :]

    def _close_brace(self) -> None:
        if not self._open:
            raise self.fail("found } with no open brace, expected MOTION; the braces are unbalanced")
        declaration = self._open.pop()
        if declaration.offset is None:
            raise self.fail(f"{declaration.label} without OFFSET, expected OFFSET and 3 numbers", declaration.line)

    def close(self, motion: int | None) -> None:
        """Check at the end of HIERARCHY that everything is declared and closed; ``motion``: line of MOTION, if any."""
        self._last_line = motion or self._last_line
        if not self._started:
            raise self.fail("found MOTION, expected HIERARCHY before it")
        declaration = self._open[-1] if self._open else self._declared
        if declaration is not None:
            where = f"{declaration.label} (line {declaration.line})"
            raise self.fail(f"{where} is never closed, expected }}; the braces are unbalanced")
        if not self.names:
            raise self.fail("no ROOT, expected a skeleton between HIERARCHY and MOTION")


def _split_name(tokens: list[str]) -> tuple[str, list[str]]:
    """Return the name at the start of a line's tokens, up to a brace or the line's end, and the remaining tokens."""
    n_words = tokens.index("{") if "{" in tokens else len(tokens)
    return " ".join(tokens[:n_words]), tokens[n_words:]


def short(token: str) -> str:
    """Quote a token for a message; a long one is shortened."""
    return repr(token if len(token) <= 40 else token[:37] + "...")


def number_of(token: str, file: str, line: int) -> float:
    """Parse a token as a finite number. Raises ``FormatError`` that says why it is not one."""
    if _NUMBER.fullmatch(token):
        value = float(token)
        if np.isfinite(value):
            return value
        what = "is too large for a number"
    elif "," in token and _NUMBER.fullmatch(token.replace(",", ".", 1)):
        what = "has a decimal comma, expected a point; save the file with points"
    elif token.lstrip("+-").lower() in ("nan", "inf", "infinity"):
        what = "is not a finite number, expected one; export the file anew"
    else:
        what = "is not a number, expected one"
    raise FormatError(f"{short(token)} {what}", file=file, line=line)
