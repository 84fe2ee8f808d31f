"""The HIERARCHY section of a BVH file, parsed strictly, statement by statement."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

import numpy as np

from signsplice.errors import FormatError, LimitError
from signsplice.formats.limits import ReadLimits
from signsplice.motion.euler import POSITIONS, ROTATIONS

_MAX_WORDS = 50_000
_LONGEST = 32
"""Words in the longest statement, CHANNELS, with some that are wrong there."""

_NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?")
_CHANNELS = {name.lower(): name for name in (*POSITIONS, *ROTATIONS)}


@dataclass
class Hierarchy:
    """What the lines of HIERARCHY declare; ``read_line`` takes them one by one.

    file: name of the file, for messages.
    limits: of joints and their depth.
    names: of the joints, in file order.
    parents: index of each joint's parent, -1 for the root.
    offsets: each joint's OFFSET, None until it is read.
    channels: names of each joint's channels, in file order.
    sites: End Sites, each the index of its joint and its OFFSET.
    """

    file: str
    limits: ReadLimits
    names: list[str] = field(default_factory=list)
    parents: list[int] = field(default_factory=list)
    offsets: list[list[float] | None] = field(default_factory=list)
    channels: list[tuple[str, ...]] = field(default_factory=list)
    sites: list[tuple[int, list[float] | None]] = field(default_factory=list)
    _lines: dict[str, int] = field(default_factory=dict)  # joint name -> line that declared it
    _open: list[tuple[int, bool, int]] = field(default_factory=list)  # (joint, is an End Site, line) of each open brace
    _declared: tuple[int, bool, int] | None = None  # what the next brace opens
    _started: bool = False
    _last_line: int = 1

    def fail(self, what: str, line: int | None = None) -> FormatError:
        """The error to raise for ``what``, with the file and the line (the last one read by default)."""
        return FormatError(what, file=self.file, line=self._last_line if line is None else line)

    def too_much(self, what: str) -> LimitError:
        """The error to raise where a skeleton exceeds a limit."""
        return LimitError(f"{what}, expected a skeleton", file=self.file, line=self._last_line)

    def read_line(self, number: int, text: str) -> None:
        """Parse line ``number`` (from 1). Raises ``FormatError`` where it is not valid."""
        tokens = text.split(None, _MAX_WORDS)
        self._last_line = number
        if len(tokens) > _MAX_WORDS:
            raise self.fail(f"more than {_MAX_WORDS} words in one line, expected a statement a line")
        if not self._started:
            if tokens[0].upper() != "HIERARCHY":
                raise self.fail(f"found {short(tokens[0])}, expected HIERARCHY; is this a BVH file?")
            self._started, tokens = True, tokens[1:]
        at = 0
        while at < len(tokens):
            words = tokens[at : at + _LONGEST]
            at += len(words) - len(self._read_statement(words))

    def _read_statement(self, tokens: list[str]) -> list[str]:
        """Parse the statement at the front of a line's tokens; returns the tokens after it."""
        word, rest = tokens[0], tokens[1:]
        key = word.upper()
        if self._declared is not None and word != "{":
            kind = "End Site" if self._declared[1] else f"joint {short(self.names[self._declared[0]])}"
            raise self.fail(f"found {short(word)}, expected {{ after {kind}; a joint's name has no white space")
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
        if key == "END":
            if not rest or rest[0].upper() != "SITE":
                raise self.fail(f"found {' '.join(map(short, tokens[:2]))}, expected End Site")
            joint = self._current(word)
            if len(self.sites) >= self.limits.joints:
                raise self.too_much(f"more than {self.limits.joints:g} End Sites")
            self.sites.append((joint, None))
            self._declared = (len(self.sites) - 1, True, self._last_line)
            return rest[1:]
        if key == "OFFSET":
            return self._read_offset(rest)
        if key == "CHANNELS":
            return self._read_channels(rest)
        if key in ("FRAMES:", "FRAME"):
            raise self.fail(f"found {short(word)} without MOTION before it, expected a line MOTION")
        raise self.fail(f"found {short(word)}, expected JOINT, End Site, OFFSET, CHANNELS or a brace")

    def _current(self, word: str) -> int:
        if not self._open or self._open[-1][1]:
            where = "inside an End Site" if self._open else "outside a joint"
            raise self.fail(f"{word} {where}, expected it inside a joint's braces")
        return self._open[-1][0]

    def _declare_joint(self, key: str, rest: list[str]) -> list[str]:
        if not rest or rest[0] == "{":
            raise self.fail(f"{key} without a name, expected a name after it")
        name = rest[0]
        if key == "ROOT" and self.names:
            raise self.fail(f"a second ROOT {short(name)}, expected one skeleton a file; split the file")
        if key == "JOINT" and not self.names:
            raise self.fail(f"JOINT {short(name)} comes first, expected ROOT")
        parent = self._current(f"JOINT {name[:40]}") if key == "JOINT" else -1
        if name in self._lines:
            raise self.fail(
                f"joint name {short(name)} stands twice (first in line {self._lines[name]}), expected different names"
            )
        if len(self.names) >= self.limits.joints:
            raise self.too_much(f"more than {self.limits.joints:g} joints")
        self._lines[name] = self._last_line
        self.names.append(name)
        self.parents.append(parent)
        self.offsets.append(None)
        self.channels.append(())
        self._declared = (len(self.names) - 1, False, self._last_line)
        return rest[1:]

    def _read_offset(self, rest: list[str]) -> list[str]:
        numbers = [number_of(token, self.file, self._last_line) for token in rest[:3]]
        if len(numbers) != 3 or (len(rest) > 3 and _NUMBER.fullmatch(rest[3])):
            raise self.fail(f"OFFSET with {len(rest)} values, expected 3 numbers")
        if not self._open:
            raise self.fail("OFFSET outside a joint, expected it inside braces")
        index, is_site, _ = self._open[-1]
        if (self.sites[index][1] if is_site else self.offsets[index]) is not None:
            raise self.fail("a second OFFSET in one joint, expected one")
        if is_site:
            self.sites[index] = (self.sites[index][0], numbers)
        else:
            self.offsets[index] = numbers
        return rest[3:]

    def _read_channels(self, rest: list[str]) -> list[str]:
        joint = self._current("CHANNELS")
        if not rest or not rest[0].isdecimal():
            raise self.fail(f"CHANNELS {short(rest[0]) if rest else ''}, expected a number of channels")
        count = int(rest[0][:4])
        found = [token for token in rest[1 : 1 + count] if token not in "{}"]
        extra = rest[1 + count : 2 + count]
        if len(found) != count or (extra and extra[0].lower() in _CHANNELS):
            raise self.fail(f"CHANNELS {count} with {len(rest) - 1} names, expected {count} channel names")
        names = []
        for token in found:
            if token.lower() not in _CHANNELS:
                raise self.fail(
                    f"unknown channel {short(token)}, expected one of {', '.join((*POSITIONS, *ROTATIONS))}"
                )
            names.append(_CHANNELS[token.lower()])
        if len(set(names)) != len(names):
            raise self.fail(f"joint {short(self.names[joint])} has a channel twice, expected different channels")
        if self.channels[joint]:
            raise self.fail("a second CHANNELS in one joint, expected one")
        self.channels[joint] = tuple(names)
        return rest[1 + count :]

    def _close_brace(self) -> None:
        if not self._open:
            raise self.fail("found } with no open brace, expected MOTION; the braces are unbalanced")
        index, is_site, line = self._open.pop()
        if (self.sites[index][1] if is_site else self.offsets[index]) is None:
            what = "End Site" if is_site else f"joint {short(self.names[index])}"
            raise self.fail(f"{what} without OFFSET, expected OFFSET and 3 numbers", line)

    def close(self, motion: int | None) -> None:
        """Check at the end of HIERARCHY that everything is declared and closed; ``motion``: line of MOTION, if any."""
        self._last_line = motion or self._last_line
        if not self._started:
            raise self.fail("found MOTION, expected HIERARCHY before it")
        if self._open or self._declared is not None:
            index, is_site, line = self._open[-1] if self._open else self._declared or (0, False, 0)
            what = "End Site" if is_site else f"joint {short(self.names[index])}"
            raise self.fail(f"{what} (line {line}) is never closed, expected }}; the braces are unbalanced")
        if not self.names:
            raise self.fail("no ROOT, expected a skeleton between HIERARCHY and MOTION")


def short(token: str) -> str:
    """A token quoted for a message, cut if it is long."""
    return repr(token if len(token) <= 40 else token[:37] + "...")


def number_of(token: str, file: str, line: int) -> float:
    """The finite number that a token is. Raises ``FormatError`` that says why it is not one."""
    if _NUMBER.fullmatch(token):
        value = float(token)
        if np.isfinite(value):
            return value
        raise FormatError(f"{short(token)} is too large for a number", file=file, line=line)
    if "," in token and _NUMBER.fullmatch(token.replace(",", ".", 1)):
        raise FormatError(
            f"{short(token)} has a decimal comma, expected a point; save the file with points", file=file, line=line
        )
    if token.lstrip("+-").lower() in ("nan", "inf", "infinity"):
        raise FormatError(
            f"{short(token)} is not a finite number, expected one; export the file anew", file=file, line=line
        )
    raise FormatError(f"{short(token)} is not a number, expected one", file=file, line=line)
