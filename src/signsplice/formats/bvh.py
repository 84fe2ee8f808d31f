"""BVH files (Biovision Hierarchy, ``.bvh``): a reader of what programs write, and an exact writer.

Content with one meaning is read, with a note if anything is renamed, left out or guessed; content with two is refused.
Conventions, where other readers differ: a position channel replaces its component of the joint's OFFSET (Blender and
bvhio; rejected: three.js, which adds both). Rotations are the intrinsic product of the channels in the file's order.
A clip that was read is written with the same numbers to the last digit, names, channel orders and Frame Time.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from itertools import islice

import numpy as np

from signsplice.errors import FormatError, InputError
from signsplice.formats.bvh_hierarchy import SCALES, Declaration, Hierarchy, number_of, short
from signsplice.formats.gltf_document import EVEN, renamed, unique
from signsplice.formats.reading import DEFAULT_LIMITS, JOINT_FRAME_BYTES, ReadLimits, stem
from signsplice.motion import Channels, Clip, EndSite, FloatArray, Skeleton, euler
from signsplice.motion.clip import ChannelNames

_LINE = re.compile(rb"\S[^\n]*")
"""A line that is not blank; skipping blank lines costs next to nothing."""
_MOTION = re.compile(rb"(?im)(?:^|\})[^\S\n]*(MOTION)(?=[^\S\n]*(?:$|frames))")
_HEAD = (
    (re.compile(rb"\s*frames[^\S\n]*:?[^\S\n]*([^\s:]\S*)", re.IGNORECASE), "Frames: and a number"),
    (re.compile(rb"(?im)\s*frame[^\S\n]*time[^\S\n]*:?[^\S\n]*([^\s:]\S*)[^\S\n]*$"), "Frame Time: and seconds"),
)
"""The lines between MOTION and the frames, each with what is expected there."""
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
_NO_NAME = re.compile(r"[\x00-\x1f\x7f-\x9f]")
"""Control characters, which end a name like white space."""
_RATES = 10.0, 1000.0
"""Least and largest Frame Time that is a rate, which some captures print in the place of a time: no frame lasts so many
seconds.
"""


def parse(content: bytes, file: str = "", limits: ReadLimits = DEFAULT_LIMITS) -> Clip:
    """Parse a BVH file into a clip named after ``file``, in the file's length unit.

    Raises ``FormatError`` ("FILE:LINE: what, expected what") for anything that is not valid BVH.
    """
    text = _normalize_text(content, file)
    motion = _MOTION.search(text)
    hierarchy = Hierarchy(file, limits)
    for number, words in _lines(text, 0, len(text) if motion is None else motion.start(1)):
        hierarchy.read_line(number, _decode_line(words[0]))
    if motion is None:
        hierarchy.close(None)
        what = "the file ends without MOTION, expected frames after the hierarchy"
        raise FormatError(what, file=file, line=_line_number(text, len(text)))
    hierarchy.close(_line_number(text, motion.end()))
    n_frames, frame_time, first = _motion_head(text, motion.end(), file)
    if _RATES[0] <= frame_time <= _RATES[1]:
        hierarchy.notes.append(f"its Frame Time of {frame_time:g} is read as a rate: {frame_time:g} fps")
        frame_time = 1.0 / frame_time
    columns = _columns(hierarchy, text, first)
    if not columns:
        line = _line_number(text, first)
        raise FormatError("the skeleton has no channels, expected at least the root's", file=file, line=line)
    # A number takes at least two bytes of text, which bounds the frames, whatever the lines hold.
    n_lines = sum(1 for _ in _LINE.finditer(text, first))
    n_possible = min(n_lines, (len(text) - first) // (2 * len(columns)) + 1)
    n_joints, fps = len(hierarchy.names), standard_fps(frame_time)
    n_bytes = n_possible * (n_joints * JOINT_FRAME_BYTES + len(columns) * _NUMBER_BYTES)
    limits.check_clip(n_possible, n_joints, fps, n_bytes, len(content), file)
    values = np.empty((n_possible, len(columns)))
    n_read = _read_frames(text, first, n_frames, values, file)
    values = values[:n_read]
    _check_scales(hierarchy, columns, values, text, first)
    if n_read != n_frames:
        hierarchy.notes.append(f"Frames: says {n_frames}, but {n_read} frames follow, which are read")
    if n_read != n_lines:
        hierarchy.notes.append(f"the text after its {n_read} frames is not read")
    return _clip(hierarchy, columns, values, frame_time, stem(file))


def _columns(hierarchy: Hierarchy, text: bytes, first: int) -> list[tuple[Declaration, str]]:
    """Return the joint or End Site and the channel of each number of a frame.

    Programs disagree whether frames hold numbers for channels of End Sites: the first frame's length tells.
    """
    columns = [(declaration, name) for declaration in hierarchy.declarations for name in declaration.channels]
    joint_columns = [column for column in columns if not column[0].is_site]
    row = _LINE.search(text, first)
    n_numbers = 0 if row is None else len(_decode_line(row[0]).split(None, len(columns)))
    return joint_columns if n_numbers == len(joint_columns) else columns


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
    """Encode a clip as a BVH file (UTF-8); numbers that were read from a file are written unchanged, and names as
    ``written_names`` says. Raises ``InputError`` for a joint without a name.
    """
    names, values = euler.complete(clip)
    stored = clip.channels
    offsets = clip.skeleton.offsets if stored is None else stored.offsets
    frame_time = 1.0 / clip.fps
    if stored is not None and stored.frame_time > 0.0 and standard_fps(stored.frame_time) == clip.fps:
        frame_time = stored.frame_time
    lines, order = _hierarchy(clip.skeleton, written_names(clip), names, offsets)
    # Columns follow the hierarchy, whatever the order of the joints.
    starts = euler.first_columns(names)
    columns = [starts[joint] + n for joint in order for n in range(len(names[joint]))]
    if columns != sorted(columns):
        values = values[:, columns]
    lines += ["MOTION", f"Frames: {len(values)}", f"Frame Time: {frame_time!r}"]
    return ("\n".join([*lines, format_rows(values)]) + "\n").encode()


def written_names(clip: Clip) -> list[str]:
    """Return the joint names that ``encode`` writes, which differ from the clip's where BVH cannot hold those.

    Names of a BVH file stay. In others, white space becomes an underscore: Blender reads both so, but three.js and
    pybvh end a name at white space.
    """
    names = clip.skeleton.names
    held = ["_".join(_NO_NAME.sub(" ", name).split()).replace("{", "_") for name in names]
    if not all(held):
        raise InputError(f"joint name {names[held.index('')]!r} is empty, which BVH cannot hold; rename it")
    can_stay = [name.replace(" ", "_") for name in names] == held
    if clip.channels is not None and can_stay:
        return list(names)
    return unique(held, "_")


def _hierarchy(
    skeleton: Skeleton, joint_names: Sequence[str], names: ChannelNames, offsets: FloatArray
) -> tuple[list[str], list[int]]:
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
        lines += [f"{tab}{'JOINT' if depth else 'ROOT'} {joint_names[joint]}", tab + "{"]
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
        content = content.decode("utf-16", "replace").encode()
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


def _motion_head(text: bytes, start: int, file: str) -> tuple[int, float, int]:
    """Return the number of frames, the Frame Time in seconds, and the position in the text after them."""
    values = []
    for pattern, what in _HEAD:
        match, line = pattern.match(text, start), _LINE.search(text, start)
        at = len(text) if line is None else line.start()
        if match is None:
            seen = "the file ends here" if line is None else f"found {short(_decode_line(line[0]).strip())}"
            raise FormatError(f"{seen}, expected {what}", file=file, line=_line_number(text, at))
        values.append((_decode_line(match[1]), _line_number(text, at)))
        start = match.end()
    (count, count_line), (seconds, seconds_line) = values
    if not re.fullmatch(r"\+?\d{1,18}", count):
        raise FormatError(f"Frames: {short(count)}, expected a whole number", file=file, line=count_line)
    frame_time = number_of(seconds, file, seconds_line)
    if frame_time <= 0.0:
        raise FormatError(f"Frame Time: {seconds}, expected more than 0 seconds", file=file, line=seconds_line)
    return int(count), frame_time, start


def _read_frames(text: bytes, start: int, n_frames: int, values: FloatArray, file: str) -> int:
    """Parse the frame lines into ``values`` (T, C), and return their number.

    After ``n_frames`` frames, a line that is no frame ends them; before, it raises ``FormatError``.
    """
    rows, width, done = _LINE.finditer(text, start), values.shape[1], 0
    while block := list(islice(rows, _BLOCK)):
        # Numpy takes 20 times the text of too many numbers.
        is_long = any(row.end() - row.start() > _LONG * (width + _LONG) for row in block)
        numbers = None if is_long else _numbers([row[0] for row in block])
        is_whole = numbers is not None and numbers.shape == (len(block), width)
        if not is_whole:
            n_valid, error = _first_invalid(text, block, width, file)
            if done + n_valid < n_frames:
                raise error
            numbers = _numbers([row[0] for row in block[:n_valid]]) if n_valid else np.empty((0, width))
        if numbers is not None:
            values[done : done + len(numbers)] = numbers
            done += len(numbers)
        if not is_whole:
            break
    if done == 0:
        line = _line_number(text, len(text))
        raise FormatError("no frame follows, expected at least one line of numbers", file=file, line=line)
    return done


def _first_invalid(text: bytes, rows: list[re.Match[bytes]], width: int, file: str) -> tuple[int, FormatError]:
    """Return the index of the first line that is no frame of ``width`` numbers, and its error."""
    for n, row in enumerate(rows):
        line = _decode_line(row[0])
        n_numbers = sum(1 for _ in re.finditer(r"\S+", line))
        try:
            if n_numbers != width:
                is_cut = n_numbers < width and _LINE.search(text, row.end()) is None
                commas = "; it has commas: numbers need a decimal point and white space between them"
                hint = commas if "," in line else "; the file seems to be cut off here" if is_cut else ""
                raise FormatError(f"{n_numbers} numbers in a frame, expected {width}{hint}")
            for token in line.split():
                number_of(token, file, 0)
        except FormatError as error:
            return n, FormatError(error.what, file=file, line=_line_number(text, row.start()))
    return 0, FormatError("a number cannot be read", file=file, line=_line_number(text, rows[0].start()))


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


def _check_scales(
    hierarchy: Hierarchy, columns: Sequence[tuple[Declaration, str]], values: FloatArray, text: bytes, first: int
) -> None:
    """Raise ``FormatError`` if a channel scales its joint: programs disagree whether its children grow with it."""
    for column, (declaration, channel) in enumerate(columns):
        if not declaration.is_site and channel in SCALES:
            hierarchy.note("scale channels are left out: all their numbers are 1")
            wrong = np.flatnonzero(np.abs(values[:, column] - 1.0) > EVEN)
            if len(wrong):
                what = f"{channel} of {declaration.label} is {values[wrong[0], column]:g}, expected 1"
                row = next(islice(_LINE.finditer(text, first), int(wrong[0]), None))
                raise hierarchy.fail(f"{what}; export the file without scales", _line_number(text, row.start()))


def _clip(
    hierarchy: Hierarchy, columns: Sequence[tuple[Declaration, str]], values: FloatArray, frame_time: float, name: str
) -> Clip:
    kept = [not declaration.is_site and channel not in SCALES for declaration, channel in columns]
    values = values if all(kept) else np.ascontiguousarray(values[:, kept])
    joints = [joint for joint in hierarchy.declarations if not joint.is_site]
    names = tuple(tuple(channel for channel in joint.channels if channel not in SCALES) for joint in joints)
    written = np.array([joint.offset for joint in joints], np.float64)
    rotations, translations = euler.to_motion(names, values, written)
    # Position channels that never change are bone lengths: they belong to the skeleton.
    moving = np.any(translations[:, 1:] != translations[:1, 1:])
    offsets = written.copy()
    offsets[1:] = np.median(translations[:, 1:], axis=0) if moving else translations[0, 1:]
    sites = tuple(EndSite(site.joint, np.array(site.offset)) for site in hierarchy.declarations if site.is_site)
    joint_names = unique(hierarchy.names, "_")
    skeleton = Skeleton(tuple(joint_names), np.array(hierarchy.parents, np.intp), offsets, sites)
    return Clip(
        skeleton=skeleton,
        local_rotations=rotations,
        root_positions=np.ascontiguousarray(translations[:, 0]),
        fps=standard_fps(frame_time),
        name=name,
        translations=translations if moving else None,
        channels=Channels(names, values, written, frame_time),
        notes=(*renamed(hierarchy.names, joint_names), *hierarchy.notes, *_rate_notes(frame_time)),
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
