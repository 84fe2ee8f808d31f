"""Faces as CSV: the 52 coefficients and 9 rotations of Live Link Face (Epic Games), or some columns that ARKit names.

A header line names the columns in any order and case. ``Timecode`` is HH:MM:SS:FF.sss with as many frames a second as
its frame numbers imply. Those of under a second imply none: then the rate that makes it as long as the clip is taken,
else 60, with a note unless it is the only one. Without timecodes, rows are a frame each if the clip has as many frames,
else 60 a second.
Rotations of head and eyes are not read: the body's clip has the head, and eyeLook* has the gaze.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from signsplice.errors import FormatError, InputError, LimitError
from signsplice.formats.reading import DEFAULT_LIMITS, ReadLimits, format_errors, open_file, read_bytes
from signsplice.motion import Clip, FloatArray, copy_unchecked
from signsplice.motion.face import ARKIT_CHANNELS, Face

_TIME = "timecode"
"""Live Link's first column, in lower case."""
_COUNT = "blendshapecount"
"""Live Link's second column, in lower case; 0 in rows without a face."""
ROTATIONS = tuple(f"{part}{axis}" for part in ("Head", "LeftEye", "RightEye") for axis in ("Yaw", "Pitch", "Roll"))
_CHANNELS = {name.lower(): name for name in ARKIT_CHANNELS}
_OTHERS = {_TIME, _COUNT, *(name.lower() for name in ROTATIONS)}
_LEAST_NAMES = 5
"""A table beside a clip with fewer of ARKit's names, and without Live Link's first two columns, holds no face."""
_FPS = 60.0
_RATES = (24, 25, 30, 48, 50, 60, 100, 120)
_CODE = re.compile(r"(\d+):(\d+):(\d+)[:;](\d+(?:\.\d+)?)", re.ASCII)
_NEAR_S = 1e-5
"""A time within this many seconds of a row is that row's: timecodes have three decimals of a frame."""
_ROWS_OF_FRAMES = 10
"""A face may have a tenth as many rows as a clip may have frames."""
_FAR = (-0.5, 2.0)
"""Weights outside 0 to 1 are clipped; weights outside this range are errors of unit."""
_UNCOVERED_S = 0.1
"""Seconds of a clip's ends that a face may leave uncovered without a note."""
_SAME_LENGTH = 0.1
"""Largest difference between a face and its clip, as a fraction of the clip, for a rate that fits."""
_SPOILT = 0.02
"""Largest fraction of a capture's rows with a time no later than the row before."""


def with_face(
    clip: Clip,
    path: str | Path,
    offset_s: float = 0.0,
    limits: ReadLimits = DEFAULT_LIMITS,
    fps: float | None = None,
) -> Clip:
    """Return a clip with the face in a CSV file, whose first row is shown ``offset_s`` seconds after the clip's first
    frame; before the first row and after the last one, the face is held. ``fps``: frames a second of its timecodes, or
    of its rows; by default as they imply.

    Raises ``InputError`` for a file that cannot be read, ``FormatError`` with the line if its content is not valid, and
    ``LimitError`` for too many rows.
    """
    if not np.isfinite(offset_s):
        raise InputError(f"face offset {offset_s}, expected seconds")
    content = read_bytes(path, limits.file_bytes)
    n_lines, max_rows = content.count(b"\n"), limits.frames / _ROWS_OF_FRAMES
    if n_lines > max_rows + 1:
        raise LimitError(f"about {n_lines:,} rows, expected at most {max_rows:,.0f}", file=str(path))
    with format_errors(str(path), "face in CSV"):
        return _on_clip(clip, content.decode("utf-8-sig"), str(path), offset_s, fps)


def sidecar(path: Path) -> Path | None:
    """Return NAME.csv beside a clip's NAME.bvh if its first line names face coefficients, else None."""
    file = path.with_suffix(".csv")
    if path.suffix.lower() == ".csv" or not file.is_file():
        return None
    with open_file(file) as (content, _):
        first = content.readline(10_000).decode("utf-8-sig", "replace").lower().replace('"', "")
    names = [name.strip() for name in first.split(",")]
    is_face = names[:2] == [_TIME, _COUNT] or sum(name in _CHANNELS for name in names) >= _LEAST_NAMES
    return file if is_face else None


def _on_clip(clip: Clip, text: str, file: str, offset_s: float, fps: float | None) -> Clip:
    rows = csv.reader(text.splitlines())
    names = [name.strip().lower() for name in next(rows, [])]
    columns = {_CHANNELS[name]: k for k, name in enumerate(names) if name in _CHANNELS}
    if not columns:
        raise FormatError("its first line names no coefficient, expected ARKit's: EyeBlinkLeft, ...", file=file)
    if len(set(names)) != len(names):
        raise FormatError("two columns have one name", file=file, line=1)
    channels = tuple(name for name in ARKIT_CHANNELS if name in columns)
    order, time_column = [columns[name] for name in channels], names.index(_TIME) if _TIME in names else None
    weights, codes, n_unseen = list[FloatArray](), list[FloatArray](), 0
    for line, row in enumerate(rows, 2):
        if len(row) == len(names):
            weights.append(_weights([row[k] for k in order], file, line))
            codes.append(np.zeros(4) if time_column is None else _parts(row[time_column], file, line))
        elif _COUNT in names[:2] and row[1:2] == ["0"]:
            n_unseen += 1
        elif row:
            raise FormatError(f"{len(row)} columns, expected {len(names)} as in the first line", file=file, line=line)
    if not weights:
        raise FormatError("has no row of a face, expected one a frame", file=file)
    rate, is_guess = fps or (clip.fps if len(weights) == len(clip) else _FPS), False
    if time_column is None:
        times = np.arange(len(weights)) / rate
    else:
        rate, is_guess = (fps, False) if fps else _timecode_rate(np.array(codes), (len(clip) - 1) / clip.fps, file)
        times = _times(np.array(codes), rate, file)
    table, later = np.array(weights), np.append(True, times[1:] > np.maximum.accumulate(times)[:-1])  # (N, C), (N,)
    n_unseen += len(times) - int(later.sum())
    if _SPOILT * len(times) < len(times) - later.sum():
        first = int(np.argmin(later)) + 1
        raise FormatError(f"the timecode of row {first} is no later than that of one before", file=file)
    table, times = table[later], times[later] + offset_s
    notes = _notes(channels, names, table, n_unseen, Path(file).name)
    if is_guess:
        notes.append(f"{Path(file).name}: timecodes of under a second do not say their rate; {rate:g} fps is taken")
    return _attach_face(clip, Face(channels, np.clip(table, 0.0, 1.0)), times, Path(file).name, notes)


def with_face_of(clip: Clip, other: Clip, file: str, offset_s: float = 0.0) -> Clip:
    """Return a clip with the face of another one, from ``file``, likewise. Raises ``InputError`` if that has none."""
    if other.face is None:
        raise InputError(f"{file}: holds no face, expected one for {clip.name!r}")
    return _attach_face(clip, other.face, np.arange(len(other)) / other.fps + offset_s, Path(file).name, [])


def _attach_face(clip: Clip, face: Face, times: FloatArray, name: str, notes: Sequence[str]) -> Clip:
    """Return a clip with a face whose frames are shown at ``times``, seconds, and with notes on it."""
    frame_times, end = np.arange(len(clip)) / clip.fps, (len(clip) - 1) / clip.fps
    if times[0] > _UNCOVERED_S or times[-1] < end - _UNCOVERED_S:
        line = f"{name} has a face from {times[0]:.2f} to {times[-1]:.2f} s of {end:.2f} s; it is held beyond"
        notes = [*notes, line]
    sampled = np.stack([_between(frame_times, times, column) for column in face.weights.T], axis=1)
    return copy_unchecked(clip, face=Face(face.channels, sampled), notes=(*clip.notes, *notes))


def _between(at: FloatArray, times: FloatArray, values: FloatArray) -> FloatArray:
    """Interpolate values at times ``at`` linearly between rows; near a row, exactly that row's."""
    nearest = np.clip(np.searchsorted(times, at - _NEAR_S), 0, len(times) - 1)
    return np.where(np.abs(times[nearest] - at) < _NEAR_S, values[nearest], np.interp(at, times, values))


def _weights(cells: Sequence[str], file: str, line: int) -> FloatArray:
    """Parse the weights (C,) of a row, before clipping to 0 to 1."""
    try:
        values = np.array([float(cell) for cell in cells])
    except ValueError as error:
        raise FormatError(f"{str(error)[:80]}, expected a number", file=file, line=line) from error
    wrong = values[~((values >= _FAR[0]) & (values <= _FAR[1]))]  # NaN too
    if len(wrong):
        raise FormatError(f"a weight of {wrong[0]:g}, expected 0 to 1", file=file, line=line)
    return values


def _parts(code: str, file: str, line: int) -> FloatArray:
    """Parse hours, minutes, seconds and frames (4,) of a timecode."""
    match = _CODE.fullmatch(code.strip())
    if match is None:
        raise FormatError(f"timecode {code!r:.40}, expected HH:MM:SS:FF.sss", file=file, line=line)
    return np.array([float(part) for part in match.groups()])


def _timecode_rate(parts: FloatArray, clip_seconds: float, file: str) -> tuple[float, bool]:
    """Return the frames a second of timecodes (N, 4), and whether that is a guess: frame numbers that never start anew
    show which rates are too low, and no more.
    """
    frames = parts[:, 3]
    if frames.max() >= _RATES[-1]:
        raise FormatError(f"a timecode has frame {int(frames.max())}, expected below {_RATES[-1]}", file=file)
    rates = np.array([rate for rate in _RATES if rate > int(frames.max())], float)
    if np.any(np.diff(frames) < 0.0) or frames.max() >= _FPS:
        return float(rates[0]), False
    differences = np.abs(np.ptp(frames) / rates - clip_seconds)
    fits = differences <= _SAME_LENGTH * clip_seconds
    return float(rates[differences.argmin()]) if fits.any() else _FPS, len(frames) > 1 and fits.sum() != 1


def _times(parts: FloatArray, rate: float, file: str) -> FloatArray:
    """Convert timecodes (N, 4) of ``rate`` frames a second to seconds (N,) from the first."""
    highest = int(parts[:, 3].max())
    if highest >= rate:
        raise FormatError(f"a timecode has frame {highest}, expected below {rate:g}, its frames a second", file=file)
    times = parts[:, :3] @ [3600.0, 60.0, 1.0] + parts[:, 3] / rate
    times = np.where(times < times[0] - 43_200.0, times + 86_400.0, times)  # past midnight
    return np.asarray(times - times[0])


def _notes(channels: Sequence[str], names: Sequence[str], weights: FloatArray, n_unseen: int, name: str) -> list[str]:
    """Return lines about missing coefficients and differences from the file."""
    lines = []
    missing = [channel for channel in ARKIT_CHANNELS if channel not in channels]
    if 0 < len(missing) < len(channels):  # else the file is not meant to have them all
        lines.append(f"{name} lacks {len(missing)} of 52 coefficients: {', '.join(missing[:4])}")
    unknown = [column for column in names if column not in _CHANNELS and column not in _OTHERS]
    if unknown:
        lines.append(f"{name}: columns that are no coefficients are not read: {', '.join(unknown)[:80]}")
    outside = int(((weights < 0.0) | (weights > 1.0)).sum())
    if outside:
        lines.append(f"{name}: {outside} weights outside 0 to 1 were brought to its nearer end")
    if n_unseen:
        lines.append(f"{name}: {n_unseen} rows have no face, or no later time, and are filled from those beside them")
    return lines


def encode(clip: Clip) -> bytes:
    """Encode a clip's face as Live Link Face does, or, if coefficients are missing, only the present ones. Raises
    ``InputError`` for a clip without a face.
    """
    if clip.face is None:
        raise InputError(f"clip {clip.name!r} has no face")
    is_whole = len(clip.face.channels) == len(ARKIT_CHANNELS)
    channels = tuple(name for name in ARKIT_CHANNELS if name in clip.face.channels)
    rest = ROTATIONS if is_whole else ()
    lines = [",".join(("Timecode", "BlendshapeCount", *(name[0].upper() + name[1:] for name in channels), *rest))]
    for k, row in enumerate(clip.face.of(channels)):
        frames = k / clip.fps * _FPS
        seconds, frame = divmod(round(frames, 3), _FPS)
        minutes = int(seconds) // 60
        code = f"{minutes // 60:02d}:{minutes % 60:02d}:{int(seconds) % 60:02d}:{frame:06.3f}"
        lines.append(",".join((code, str(len(channels) + len(rest)), *(f"{w:.9g}" for w in row), *("0" for _ in rest))))
    return ("\n".join(lines) + "\n").encode()
