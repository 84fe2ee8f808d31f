"""Folders of SMPL-X poses in which each file is a frame, as OSX, SMPLer-X and Neural Sign Actors write them."""

from __future__ import annotations

import re
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from signsplice.errors import InputError
from signsplice.formats import smplx
from signsplice.formats.reading import ReadLimits, check_most, format_errors, read_bytes
from signsplice.motion import Clip

READERS = {".npz": "npz", ".npy": "npy", ".pkl": "pickles"}
"""Suffix of a frame's file -> module of this package that reads it."""


def load(folder: Path, limits: ReadLimits) -> Clip:
    """Load the clip of a folder of frames, in the order of the number in which their names differ.

    Raises ``InputError`` if it has no frames, files of several kinds, or names that do not tell the order, and
    ``FormatError`` for a frame that is not valid.
    """
    try:
        paths = [*folder.iterdir()]
    except OSError as error:
        raise InputError(f"{folder}: cannot be read ({error.strerror})") from error
    paths = [path for path in paths if path.suffix.lower() in READERS and not path.name.startswith(".")]
    suffixes = sorted({path.suffix.lower() for path in paths})
    if len(suffixes) != 1:
        what = f"holds {' and '.join(suffixes)} files, expected a file" if paths else "is a folder, expected a file"
        raise InputError(f"{folder}: {what}, or a folder with files of one kind ({', '.join(READERS)}), a frame each")
    check_most(len(paths), "frames", limits.frames, str(folder))
    path_of = _by_number(folder, paths)
    frames: list[dict[str, NDArray[Any]]] = []
    n_bytes, n_unpacked, module = 0, 0, import_module(f"{__package__}.{READERS[suffixes[0]]}")
    for path in path_of.values():
        content = read_bytes(path, limits.file_bytes - n_bytes)
        n_bytes += len(content)
        with format_errors(str(path), f"{suffixes[0]} file"), np.errstate(all="ignore"):
            frames.append(module.parse_arrays(content, str(path), limits))
        n_unpacked += sum(values.nbytes for values in frames[-1].values())
        limits.check_memory(f"{len(frames):,} frames", n_unpacked, n_bytes, str(folder))
    with format_errors(str(folder), "folder of frames"), np.errstate(all="ignore"):
        arrays = smplx.join_frames(frames, [path.name for path in path_of.values()])
        clip = smplx.build_clip(arrays, str(folder), limits, n_bytes)
    first, last = min(path_of), max(path_of)
    n_missing = last - first + 1 - len(path_of)
    gap = f"{n_missing} of the frames {first} to {last} have no file: the others follow each other"
    return replace(clip, notes=(*clip.notes, gap)) if n_missing else clip


def _by_number(folder: Path, paths: list[Path]) -> dict[int, Path]:
    """Return the file of each frame by its number, rising. Raises ``InputError`` if names differ in anything else."""
    parts = [re.split("([0-9]+)", path.stem) for path in paths]  # text, digits, text, ...
    if any(len(row) != len(parts[0]) or row[::2] != parts[0][::2] for row in parts):
        expected = "expected names that differ in the frame's number alone, such as 000001.npz"
        raise InputError(f"{folder}: holds {paths[0].name} and other names, {expected}")
    columns = [list(map(int, column)) for column in list(zip(*parts, strict=True))[1::2]]
    changing = [column for column in columns if len(set(column)) > 1] or [list(range(len(paths)))]
    if len(changing) > 1 or len(set(changing[0])) < len(paths):
        expected = "expected one number to change, the frame's: put each person and recording into an own folder"
        raise InputError(f"{folder}: the names of its files do not tell the order of frames, {expected}")
    return dict(sorted(zip(changing[0], paths, strict=True)))
