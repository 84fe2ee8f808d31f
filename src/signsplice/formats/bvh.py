"""BVH files (Biovision Hierarchy, ``.bvh``): a strict reader and an exact writer.

Conventions, where other readers differ: a position channel replaces its component of the joint's OFFSET (Blender and
bvhio; rejected: three.js, which adds both). Rotations are the intrinsic product of the channels in the file's order.
A clip that was read is written with the same numbers to the last digit, names, channel orders and Frame Time.
"""

from __future__ import annotations

import re
import warnings
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from signsplice.errors import FormatError, InputError
from signsplice.formats.atomic import read_bytes
from signsplice.formats.bvh_hierarchy import Hierarchy, number_of, short
from signsplice.formats.numbers import format_rows, parse_plain
from signsplice.motion import euler_channels, euler_curves
from signsplice.motion.clip import Clip, EndSite, Skeleton
from signsplice.motion.euler_channels import Channels

Float = NDArray[np.float64]

_FRAMES = re.compile(r"frames\s*:\s*(\S*)\s*(.*)", re.IGNORECASE)
_FRAME_TIME = re.compile(r"frame\s+time\s*:\s*(\S*)\s*(.*)", re.IGNORECASE)


def read(path: str | Path) -> Clip:
    """The clip in a BVH file, named after the file, in the file's length unit.

    Raises ``FormatError`` ("FILE:LINE: what, expected what") for anything that is not valid BVH, ``InputError`` for a
    file that cannot be read.
    """
    return parse(read_bytes(path), str(path))


def parse(content: bytes, file: str = "") -> Clip:
    """The clip in the bytes of a BVH file named ``file``. Raises ``FormatError``."""
    lines = _lines(content, file)
    motion = next((n for n, line in enumerate(lines) if line.strip().upper() == b"MOTION"), None)
    hierarchy = Hierarchy(file)
    for number, line in enumerate(lines[:motion], start=1):
        hierarchy.read_line(number, _text(line).split())
    hierarchy.close(motion)
    if motion is None:
        raise FormatError(
            "the file ends without MOTION, expected frames after the hierarchy", file=file, line=len(lines)
        )
    n_frames, frame_time, first = _motion_head(lines, motion + 1, file)
    values = _frame_values(lines[first:], first + 1, n_frames, sum(map(len, hierarchy.channels)), file)
    return _clip(hierarchy, values, frame_time, Path(file).stem)


def standard_fps(frame_time: float) -> float:
    """The frame rate from which a printed Frame Time was rounded.

    Files round it (0.033333 for 30 fps). Whole rates up to 1000, then the NTSC rates (n * 1000/1001), are candidates;
    the nearest whose period rounds to the printed number is returned, or 1 / frame_time if there is none.
    """
    text = repr(float(frame_time))
    mantissa, _, exponent = text.partition("e")
    decimals = len(mantissa.partition(".")[2]) - int(exponent or 0)
    half = 0.5 * 10.0 ** -min(decimals, 15) * 1.000001
    whole = max(1, round(1.0 / frame_time)) if frame_time > 0.0009 else 0
    for rate in (float(whole), *(n * 1000.0 / 1001.0 for n in (24, 30, 48, 60, 120, 240))):
        if rate and abs(1.0 / rate - frame_time) <= half:
            return rate
    near = [float(n) for n in range(1, 1001) if abs(1.0 / n - frame_time) <= half]
    return min(near, key=lambda rate: abs(1.0 / rate - frame_time)) if near else 1.0 / frame_time


def encode(clip: Clip) -> bytes:
    """The bytes of a clip's BVH file (UTF-8); numbers that were read from a file are written as the same numbers.

    Raises ``InputError`` for a joint name that BVH cannot hold.
    """
    spaced = next((name for name in clip.skeleton.names if len(name.split()) != 1), None)
    if spaced is not None:
        raise InputError(f"joint name {spaced!r} is empty or has white space, which BVH cannot hold; rename it")
    names, values = euler_curves.complete(clip)
    given = clip.channels
    offsets = clip.skeleton.offsets if given is None else given.offsets
    frame_time = 1.0 / clip.fps
    if given is not None and given.frame_time > 0.0 and standard_fps(given.frame_time) == clip.fps:
        frame_time = given.frame_time
    # The hierarchy is written depth first, and columns follow it, whatever the order of the joints.
    starts = euler_channels.first_columns(names)
    columns = [starts[joint] + n for joint in _depth_first(clip.skeleton) for n in range(len(names[joint]))]
    if columns != sorted(columns):
        values = values[:, columns]
    lines = ["HIERARCHY"]
    _write_joint(lines, clip.skeleton, names, offsets)
    lines += ["MOTION", f"Frames: {len(values)}", f"Frame Time: {frame_time!r}"]
    return ("\n".join([*lines, format_rows(values)]) + "\n").encode()


def _depth_first(skeleton: Skeleton) -> list[int]:
    """All joints, each followed by its descendants."""
    order: list[int] = []
    stack = [0]
    while stack:
        joint = stack.pop()
        order.append(joint)
        stack += reversed(skeleton.children[joint])
    return order


def _write_joint(lines: list[str], skeleton: Skeleton, names: euler_channels.Names, offsets: Float) -> None:
    """Append the hierarchy's lines; a stack instead of recursion, so that depth has no limit."""
    stack: list[tuple[int, int]] = [(0, 0)]  # (joint, depth); joint -1 closes a brace
    while stack:
        joint, depth = stack.pop()
        tab = "\t" * depth
        if joint < 0:
            lines.append(tab + "}")
            continue
        lines.append(f"{tab}{'JOINT' if depth else 'ROOT'} {skeleton.names[joint]}")
        lines.append(tab + "{")
        lines.append(f"{tab}\tOFFSET {_numbers(offsets[joint])}")
        lines.append(" ".join([f"{tab}\tCHANNELS", str(len(names[joint])), *names[joint]]))
        for site in skeleton.end_sites:
            if site.joint == joint:
                lines += [f"{tab}\tEnd Site", tab + "\t{", f"{tab}\t\tOFFSET {_numbers(site.offset)}", tab + "\t}"]
        stack.append((-1, depth))
        stack += [(child, depth + 1) for child in reversed(skeleton.children[joint])]


def _numbers(row: Float) -> str:
    return " ".join(map(repr, row.tolist()))


def _lines(content: bytes, file: str) -> list[bytes]:
    """The file's lines; line ends may be LF, CRLF or CR."""
    if not content.strip():
        raise FormatError("the file is empty, expected HIERARCHY", file=file, line=1)
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise FormatError("the file is UTF-16 text, expected UTF-8; save it as UTF-8", file=file, line=1)
    if b"\0" in content:
        line = content[: content.index(b"\0")].count(b"\n") + 1
        raise FormatError("the file is binary (it holds a zero byte), expected BVH text", file=file, line=line)
    content = content.removeprefix(b"\xef\xbb\xbf")
    if b"\r" in content:
        content = content.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    return content.split(b"\n")


def _text(line: bytes) -> str:
    try:
        return line.decode("utf-8")
    except UnicodeDecodeError:
        return line.decode("latin-1")  # older encodings; every byte is a character


def _motion_head(lines: list[bytes], at: int, file: str) -> tuple[int, float, int]:
    """Number of frames, Frame Time in seconds, and the index of the first line after them."""
    found: list[str] = []
    for pattern, what in ((_FRAMES, "Frames: and a number"), (_FRAME_TIME, "Frame Time: and seconds")):
        while at < len(lines) and not lines[at].strip():
            at += 1
        text = _text(lines[at]).strip() if at < len(lines) else ""
        match = pattern.fullmatch(text)
        if match is None or not match[1] or match[2]:
            seen = f"found {short(text)}" if text else "the file ends here"
            raise FormatError(f"{seen}, expected {what}", file=file, line=min(at + 1, len(lines)))
        found.append(match[1])
        at += 1
        if pattern is _FRAMES and not re.fullmatch(r"\+?\d{1,18}", match[1]):
            raise FormatError(f"Frames: {short(match[1])}, expected a whole number", file=file, line=at)
        if pattern is _FRAMES and int(match[1]) == 0:
            raise FormatError("Frames: 0, expected at least one frame", file=file, line=at)
    frame_time = number_of(found[1], file, at)
    if frame_time <= 0.0:
        raise FormatError(f"Frame Time: {found[1]}, expected more than 0 seconds", file=file, line=at)
    return int(found[0]), frame_time, at


def _frame_values(lines: list[bytes], first_line: int, n_frames: int, width: int, file: str) -> Float:
    """Numbers (T, C) of the frame lines. Memory depends on the file's size, not on the number of frames it declares."""
    rows = [(number, line) for number, line in enumerate(lines, first_line) if line and not line.isspace()]
    if width == 0:
        raise FormatError("the skeleton has no channels, expected at least the root's", file=file, line=first_line - 1)
    text = b"\n".join([line for _, line in rows]) + b"\n"
    counts = _token_counts(text)
    wrong = np.flatnonzero(counts != width)
    if rows and wrong.size and wrong[0] < n_frames:
        number, count = rows[wrong[0]][0], counts[wrong[0]]
        cut = "; the file seems to be cut off here" if wrong[0] == len(rows) - 1 and count < width else ""
        commas = "; it has commas: numbers need a decimal point and white space between them"
        hint = commas if b"," in rows[wrong[0]][1] else cut
        raise FormatError(f"{count} numbers in a frame, expected {width}{hint}", file=file, line=number)
    if len(rows) != n_frames:
        line = rows[n_frames][0] if len(rows) > n_frames else rows[-1][0] if rows else first_line - 1
        raise FormatError(
            f"{len(rows)} frames follow, expected {n_frames} as Frames: says; correct one of the two",
            file=file,
            line=line,
        )
    values = _parsed(text)
    if values.size != n_frames * width or not np.isfinite(values).all():
        for number, row in rows:
            for token in _text(row).split():
                number_of(token, file, number)
        raise FormatError("a number cannot be read", file=file, line=first_line)
    return values.reshape(n_frames, width)


def _parsed(text: bytes) -> Float:
    """The numbers of a text; their count differs from that of its tokens if one is not a number."""
    plain = parse_plain(text)
    if plain is not None:
        return plain
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # numpy warns of text that is not a number
        try:
            return np.fromstring(_text(text), sep=" ")
        except ValueError:
            return np.empty(0)


def _token_counts(text: bytes) -> NDArray[np.intp]:
    """Number of white-space-separated tokens in each line; counted on the bytes, since splitting is slow."""
    flat = np.frombuffer(text, np.uint8)
    space = flat <= 32
    ends = np.flatnonzero(space[1:] & ~space[:-1]) + 1  # first white space after each token
    breaks = np.flatnonzero(flat == 10)
    return np.diff(np.searchsorted(ends, breaks, side="right"), prepend=0)


def _clip(hierarchy: Hierarchy, values: Float, frame_time: float, name: str) -> Clip:
    written = np.array(hierarchy.offsets, np.float64)
    names = tuple(hierarchy.channels)
    rotations, translations = euler_channels.to_motion(names, values, written)
    # Position channels that never change are bone lengths: they belong to the skeleton.
    moving = np.any(translations[:, 1:] != translations[:1, 1:])
    offsets = written.copy()
    offsets[1:] = np.median(translations[:, 1:], axis=0) if moving else translations[0, 1:]
    skeleton = Skeleton(
        names=tuple(hierarchy.names),
        parents=np.array(hierarchy.parents, np.intp),
        offsets=offsets,
        end_sites=tuple(EndSite(joint, np.array(offset)) for joint, offset in hierarchy.sites),
    )
    return Clip(
        skeleton=skeleton,
        local_rotations=rotations,
        root_positions=np.ascontiguousarray(translations[:, 0]),
        fps=standard_fps(frame_time),
        name=name,
        translations=translations if moving else None,
        channels=Channels(names, values, written, frame_time),
    )
