"""BVH files (Biovision Hierarchy, ``.bvh``): a strict reader and an exact writer.

Conventions, where other readers differ: a position channel replaces its component of the joint's OFFSET (Blender and
bvhio; rejected: three.js, which adds both). Rotations are the intrinsic product of the channels in the file's order.
A clip that was read is written with the same numbers to the last digit, names, channel orders and Frame Time.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import islice

import numpy as np

from signsplice.errors import FormatError, InputError, LimitError
from signsplice.formats.reading import DEFAULT_LIMITS, JOINT_FRAME_BYTES, ReadLimits, stem
from signsplice.motion import Channels, Clip, EndSite, FloatArray, Skeleton, euler
from signsplice.motion.clip import ChannelNames
from signsplice.motion.euler import POSITIONS, ROTATIONS

_MAX_WORDS = 50_000
_LONGEST = 32
"""Words in the longest statement, CHANNELS, with some extra words that are invalid."""

_NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?")
_CHANNELS = {name.lower(): name for name in (*POSITIONS, *ROTATIONS)}


@dataclass
class Hierarchy:
    """The declarations of HIERARCHY; ``read_line`` parses its lines one by one.

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
        """Make the error for ``what``, with the file and the line (by default the last one read)."""
        return FormatError(what, file=self.file, line=self._last_line if line is None else line)

    def too_much(self, what: str) -> LimitError:
        """Make the error for a skeleton that exceeds a limit."""
        return LimitError(f"{what}, expected a skeleton", file=self.file, line=self._last_line)

    def read_line(self, number: int, text: str) -> None:
        """Parse line ``number`` (from 1). Raises ``FormatError`` if it is not valid."""
        tokens = text.split(None, _MAX_WORDS)
        self._last_line = number
        if len(tokens) > _MAX_WORDS:
            raise self.fail(f"more than {_MAX_WORDS} words in one line, expected a statement a line")
        if not self._started:
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


_LINE = re.compile(rb"\S[^\n]*")
"""A line that is not blank; skipping blank lines costs next to nothing."""
_MOTION = re.compile(rb"(?im)^[^\S\n]*MOTION[^\S\n]*$")
_FRAMES = re.compile(r"frames\s*:\s*(\S*)\s*(.*)", re.IGNORECASE)
_FRAME_TIME = re.compile(r"frame\s+time\s*:\s*(\S*)\s*(.*)", re.IGNORECASE)
_BLOCK = 4096
"""Frames parsed at a time, to limit the memory of their text."""
_LONG = 100
"""Bytes of text that no valid number needs, including the space around it."""
_NUMBER_BYTES = 8
"""Bytes of memory of a number of the file."""
_ROUNDED = 0.0025
"""Fraction by which a rate may differ from a Frame Time without a note (60 fps from 0.0167)."""
_MOST_ROUNDED = 0.0101
"""Fraction by which a usual rate may differ from a Frame Time, with a note (30 fps from 0.033)."""


def parse(content: bytes, file: str = "", limits: ReadLimits = DEFAULT_LIMITS) -> Clip:
    """Parse a BVH file into a clip named after ``file``, in the file's length unit.

    Raises ``FormatError`` ("FILE:LINE: what, expected what") for anything that is not valid BVH.
    """
    text = _normalize_text(content, file)
    motion = _MOTION.search(text)
    hierarchy = Hierarchy(file, limits)
    for number, words in _lines(text, 0, len(text) if motion is None else motion.start()):
        hierarchy.read_line(number, _decode_line(words[0]))
    n_lines = text.count(b"\n") + 1
    if motion is None:
        hierarchy.close(None)
        raise FormatError("the file ends without MOTION, expected frames after the hierarchy", file=file, line=n_lines)
    hierarchy.close(_line_number(text, motion.end()))
    n_frames, frame_time, first = _motion_head(text, motion.end(), n_lines, file)
    width = sum(map(len, hierarchy.channels))
    if width == 0:
        line = _line_number(text, first)
        raise FormatError("the skeleton has no channels, expected at least the root's", file=file, line=line)
    # A number takes at least two bytes of text, which bounds the frames that can follow, whatever the file declares.
    n_possible = min(n_frames, (len(text) - first) // (2 * width) + 1)
    n_joints, fps = len(hierarchy.names), standard_fps(frame_time)
    n_bytes = n_possible * (n_joints * JOINT_FRAME_BYTES + width * _NUMBER_BYTES)
    limits.check_clip(n_possible, n_joints, fps, n_bytes, len(content), file)
    values = np.empty((n_possible, width))
    _read_frames(text, first, n_frames, values, file)
    return _clip(hierarchy, values, frame_time, stem(file))


def standard_fps(frame_time: float) -> float:
    """Return the frame rate that a printed Frame Time was rounded from (30 fps for 0.033333), else 1 / frame_time.

    Candidates are the nearest whole rate and the NTSC rates (n * 1000/1001). Their period must round to the printed
    number, and differ from it by a fraction below ``_ROUNDED``, or below ``_MOST_ROUNDED`` for the usual rates,
    multiples of 5 or 12.
    """
    text = repr(float(frame_time))
    mantissa, _, exponent = text.partition("e")
    decimals = len(mantissa.partition(".")[2]) - int(exponent or 0)
    half = 0.5 * 10.0 ** -min(decimals, 15) * 1.000001
    nearest_rate = round(1.0 / frame_time) if frame_time > 0.0009 else 0
    is_usual = nearest_rate % 5 == 0 or nearest_rate % 12 == 0
    ntsc = [(n * 1000.0 / 1001.0, _ROUNDED) for n in (24, 30, 48, 60, 120, 240)]
    for rate, tolerance in ((float(nearest_rate), _MOST_ROUNDED if is_usual else _ROUNDED), *ntsc):
        if rate and abs(1.0 / rate - frame_time) <= min(half, tolerance / rate):
            return rate
    return 1.0 / frame_time


def _rate_notes(frame_time: float) -> tuple[str, ...]:
    """Return a line about a rate guessed from a Frame Time with few digits; none if the two are practically equal."""
    fps = standard_fps(frame_time)
    if abs(fps * frame_time - 1.0) <= _ROUNDED:
        return ()
    return (f"its Frame Time of {frame_time!r} s is read as {fps:.6g} fps, which it seems to be rounded from",)


def encode(clip: Clip) -> bytes:
    """Encode a clip as a BVH file (UTF-8); numbers that were read from a file are written unchanged.

    Raises ``InputError`` for a joint name that BVH cannot hold.
    """
    spaced = next((name for name in clip.skeleton.names if name.split() != [name]), None)
    if spaced is not None:
        raise InputError(f"joint name {spaced!r} is empty or has white space, which BVH cannot hold; rename it")
    names, values = euler.complete(clip)
    stored = clip.channels
    offsets = clip.skeleton.offsets if stored is None else stored.offsets
    frame_time = 1.0 / clip.fps
    if stored is not None and stored.frame_time > 0.0 and standard_fps(stored.frame_time) == clip.fps:
        frame_time = stored.frame_time
    lines, order = _hierarchy(clip.skeleton, names, offsets)
    # Columns follow the hierarchy, whatever the order of the joints.
    starts = euler.first_columns(names)
    columns = [starts[joint] + n for joint in order for n in range(len(names[joint]))]
    if columns != sorted(columns):
        values = values[:, columns]
    lines += ["MOTION", f"Frames: {len(values)}", f"Frame Time: {frame_time!r}"]
    return ("\n".join([*lines, format_rows(values)]) + "\n").encode()


def _hierarchy(skeleton: Skeleton, names: ChannelNames, offsets: FloatArray) -> tuple[list[str], list[int]]:
    """Return the lines of the hierarchy and its joints in that order, each followed by its descendants.

    A stack replaces recursion, so that depth has no limit.
    """
    lines, order = ["HIERARCHY"], list[int]()
    tips: dict[int, list[FloatArray]] = {}
    for site in skeleton.end_sites:
        tips.setdefault(site.joint, []).append(site.offset)
    stack: list[tuple[int, int]] = [(0, 0)]  # (joint, depth); joint -1 closes a brace
    while stack:
        joint, depth = stack.pop()
        tab = "\t" * depth
        if joint < 0:
            lines.append(tab + "}")
            continue
        order.append(joint)
        lines += [f"{tab}{'JOINT' if depth else 'ROOT'} {skeleton.names[joint]}", tab + "{"]
        lines.append(f"{tab}\tOFFSET {_decimals(offsets[joint])}")
        lines.append(" ".join([f"{tab}\tCHANNELS", str(len(names[joint])), *names[joint]]))
        for tip in tips.get(joint, ()):
            lines += [f"{tab}\tEnd Site", tab + "\t{", f"{tab}\t\tOFFSET {_decimals(tip)}", tab + "\t}"]
        stack.append((-1, depth))
        stack += [(child, depth + 1) for child in reversed(skeleton.children[joint])]
    return lines, order


def _decimals(row: FloatArray) -> str:
    return " ".join(map(repr, row.tolist()))


def _normalize_text(content: bytes, file: str) -> bytes:
    """Return the file's bytes with LF line ends; the file may have LF, CRLF or CR."""
    if not content or content.isspace():
        raise FormatError("the file is empty, expected HIERARCHY", file=file, line=1)
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise FormatError("the file is UTF-16 text, expected UTF-8; save it as UTF-8", file=file, line=1)
    if b"\0" in content:
        line = _line_number(content, content.index(b"\0"))
        raise FormatError("the file is binary (it holds a zero byte), expected BVH text", file=file, line=line)
    content = content.removeprefix(b"\xef\xbb\xbf")
    if b"\r" in content:
        content = content.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    return content


def _lines(text: bytes, start: int, stop: int) -> Iterator[tuple[int, re.Match[bytes]]]:
    """Yield the non-blank lines of a part of the text, each with its number from 1."""
    number, seen = _line_number(text, start), start
    for line in _LINE.finditer(text, start, stop):
        number += text.count(b"\n", seen, line.start())
        seen = line.start()
        yield number, line


def _line_number(text: bytes, at: int) -> int:
    return text.count(b"\n", 0, at) + 1


def _decode_line(line: bytes) -> str:
    try:
        return line.decode("utf-8")
    except UnicodeDecodeError:
        return line.decode("latin-1")  # older encodings; every byte is a character


def _motion_head(text: bytes, start: int, n_lines: int, file: str) -> tuple[int, float, int]:
    """Return the number of frames, the Frame Time in seconds, and the position in the text after them."""
    values: list[str] = []
    lines = _lines(text, start, len(text))
    for pattern, what in ((_FRAMES, "Frames: and a number"), (_FRAME_TIME, "Frame Time: and seconds")):
        number, line = next(lines, (n_lines, None))
        words = "" if line is None else _decode_line(line[0]).strip()
        match = pattern.fullmatch(words)
        if line is None or match is None or not match[1] or match[2]:
            seen = f"found {short(words)}" if words else "the file ends here"
            raise FormatError(f"{seen}, expected {what}", file=file, line=number)
        values.append(match[1])
        start = line.end()
        if pattern is _FRAMES and not re.fullmatch(r"\+?\d{1,18}", match[1]):
            raise FormatError(f"Frames: {short(match[1])}, expected a whole number", file=file, line=number)
        if pattern is _FRAMES and int(match[1]) == 0:
            raise FormatError("Frames: 0, expected at least one frame", file=file, line=number)
    frame_time = number_of(values[1], file, number)
    if frame_time <= 0.0:
        raise FormatError(f"Frame Time: {values[1]}, expected more than 0 seconds", file=file, line=number)
    return int(values[0]), frame_time, start


def _read_frames(text: bytes, start: int, n_frames: int, values: FloatArray, file: str) -> None:
    """Parse the frame lines into ``values`` (T, C). Raises ``FormatError`` unless they are ``n_frames`` rows of C."""
    rows, width = _LINE.finditer(text, start), values.shape[1]
    done, last = 0, start
    while block := list(islice(rows, _BLOCK)):
        stop = done + len(block)
        for row in block:
            if row.end() - row.start() > _LONG * (width + _LONG):
                _check_width(text, row, width, file)  # since numpy takes 20 times the text of so many numbers
        numbers = _numbers([row[0] for row in block])
        if stop > n_frames or numbers is None or numbers.shape != (len(block), width):
            for row in block[: n_frames - done]:
                _check_width(text, row, width, file)
                _check_numbers(text, row, file)
            if stop <= n_frames:
                raise FormatError("a number cannot be read", file=file, line=_line_number(text, block[0].start()))
            last = block[n_frames - done].start()
            done = stop + sum(1 for _ in rows)
            break
        values[done:stop] = numbers
        done, last = stop, block[-1].start()
    if done != n_frames:
        raise FormatError(
            f"{done} frames follow, expected {n_frames} as Frames: says; correct one of the two",
            file=file,
            line=_line_number(text, last),
        )


def _numbers(rows: list[bytes]) -> FloatArray | None:
    """Parse lines into numbers (R, C), bit for bit as ``float`` does; None unless each holds the same count of finite
    numbers.
    """
    if not rows[0].decode("latin-1").split():
        return None  # rare white space; numpy would warn of text without numbers
    try:
        numbers = np.loadtxt(rows, comments=None, ndmin=2)
    except ValueError:
        return None
    return numbers if np.isfinite(numbers).all() else None


def _check_width(text: bytes, row: re.Match[bytes], width: int, file: str) -> None:
    """Raise ``FormatError`` if a line does not hold one number for each channel."""
    n_tokens = sum(1 for _ in re.finditer(r"\S+", _decode_line(row[0])))
    if n_tokens != width:
        line = _line_number(text, row.start())  # counts from the text's start: only for the line that is wrong
        is_cut = n_tokens < width and _LINE.search(text, row.end()) is None
        commas = "; it has commas: numbers need a decimal point and white space between them"
        hint = commas if b"," in row[0] else "; the file seems to be cut off here" if is_cut else ""
        raise FormatError(f"{n_tokens} numbers in a frame, expected {width}{hint}", file=file, line=line)


def _check_numbers(text: bytes, row: re.Match[bytes], file: str) -> None:
    """Raise ``FormatError`` for the first invalid number of a line."""
    for token in _decode_line(row[0]).split():
        try:
            number_of(token, file, 0)
        except FormatError as error:
            raise FormatError(error.what, file=file, line=_line_number(text, row.start())) from None


def _clip(hierarchy: Hierarchy, values: FloatArray, frame_time: float, name: str) -> Clip:
    written = np.array(hierarchy.offsets, np.float64)
    names = tuple(hierarchy.channels)
    rotations, translations = euler.to_motion(names, values, written)
    # Position channels that never change are bone lengths: they belong to the skeleton.
    moving = np.any(translations[:, 1:] != translations[:1, 1:])
    offsets = written.copy()
    offsets[1:] = np.median(translations[:, 1:], axis=0) if moving else translations[0, 1:]
    sites = tuple(EndSite(joint, np.array(offset)) for joint, offset in hierarchy.sites)
    skeleton = Skeleton(tuple(hierarchy.names), np.array(hierarchy.parents, np.intp), offsets, sites)
    return Clip(
        skeleton=skeleton,
        local_rotations=rotations,
        root_positions=np.ascontiguousarray(translations[:, 0]),
        fps=standard_fps(frame_time),
        name=name,
        translations=translations if moving else None,
        channels=Channels(names, values, written, frame_time),
        notes=_rate_notes(frame_time),
    )


_WHOLE = 6
"""Digits before the decimal point that ``format_rows`` prints with array operations."""
_FRACTION = 8
"""Digits after the decimal point that ``format_rows`` prints with array operations."""
_PAIRS = np.frombuffer("".join(f"{n:02d}" for n in range(100)).encode(), np.uint8).reshape(100, 2)


def format_rows(values: FloatArray) -> str:
    """Format rows of numbers (R, C) as lines of text, by array operations; ``float`` reads back the same numbers.

    Numbers with at most 6 digits before and 8 after the point are printed in parallel, without superfluous zeros; rows
    with any other number are printed with Python's ``repr``.
    """
    with np.errstate(over="ignore"):  # a number that overflows is not plain
        scaled = np.rint(np.abs(values) * 10.0**_FRACTION)
    plain = (scaled < 10.0 ** (_WHOLE + _FRACTION)) & (scaled / 10.0**_FRACTION == np.abs(values))
    if not plain.all():
        return "\n".join(
            format_rows(row[None]) if fits else " ".join(map(repr, row.tolist()))
            for row, fits in zip(values, plain.all(axis=1), strict=True)
        )
    n_rows, n_columns = values.shape
    remaining = scaled.astype(np.int64).ravel()
    # Sign, digits, point, digits, space; then unneeded characters are removed.
    text = np.empty((remaining.size, 1 + _WHOLE + 1 + _FRACTION + 1), np.uint8)
    text[:, 0], text[:, 1 + _WHOLE], text[:, -1] = ord("-"), ord("."), ord(" ")
    text.reshape(n_rows, n_columns, -1)[:, -1, -1] = ord("\n")
    for pair in range((_WHOLE + _FRACTION) // 2):
        remaining, two_digits = np.divmod(remaining, 100)
        column = text.shape[1] - 3 - 2 * pair - (2 * pair >= _FRACTION)
        text[:, column : column + 2] = _PAIRS[two_digits]
    keep = np.ones(text.shape, bool)
    keep[:, 0] = np.signbit(values).ravel()
    digits = text != ord("0")
    keep[:, 1:_WHOLE] = np.logical_or.accumulate(digits[:, 1:_WHOLE], axis=1)
    decimals = digits[:, _WHOLE + 2 : -1]
    keep[:, _WHOLE + 3 : -1] = np.logical_or.accumulate(decimals[:, :0:-1], axis=1)[:, ::-1]
    return text[keep].tobytes()[:-1].decode("ascii")
