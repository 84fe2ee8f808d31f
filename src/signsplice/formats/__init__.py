"""Reading and writing of clips. ``FORMATS`` is the table of file formats: a new format is one module and one row.

A format's module is imported only when a file of that format is read or written.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from signsplice.errors import InputError
from signsplice.formats.atomic import replacing, write
from signsplice.formats.reading import DEFAULT_LIMITS, ReadLimits, check_most, format_errors, read_bytes

if TYPE_CHECKING:
    from signsplice.motion import Clip


@dataclass(frozen=True)
class FileFormat:
    """A file format: one row of ``FORMATS``.

    suffix: suffix of its files, lower case with the dot.
    module: module of this package with ``parse(content, file, limits) -> Clip``, which may raise anything, and, if
        clips are written, ``encode(clip) -> bytes``.
    reads, writes: whether clips are read and written in it.
    has_buffers: whether a file may name others in its folder: then ``parse`` also takes that ``folder``.
    has_takes: whether one of a file's motions can be chosen: then ``parse`` also takes ``take``, its name. Of other
        files the first motion is read.
    media_type: its Content-Type in HTTP; empty for a format that the HTTP service neither accepts nor sends.
    holds_faces: whether its files can hold a clip's face.
    """

    suffix: str
    module: str
    reads: bool = True
    writes: bool = True
    has_buffers: bool = False
    has_takes: bool = False
    media_type: str = ""
    holds_faces: bool = True


FORMATS = {
    row.suffix: row
    for row in (
        FileFormat(".bvh", "bvh", media_type="text/plain; charset=utf-8", holds_faces=False),
        FileFormat(".npz", "npz"),
        FileFormat(".smplx.npz", "smplx", reads=False, holds_faces=False),
        FileFormat(".npy", "npy", writes=False, holds_faces=False),
        FileFormat(".pkl", "pickles", writes=False, holds_faces=False),
        FileFormat(".glb", "glb", has_buffers=True, media_type="model/gltf-binary"),
        FileFormat(".gltf", "glb", writes=False, has_buffers=True),
        FileFormat(".vrma", "vrma", has_buffers=True, media_type="model/gltf-binary"),
        FileFormat(".fbx", "fbx", writes=False, has_takes=True),
        FileFormat(".pose", "pose", media_type="application/x-pose", holds_faces=False),
    )
}
"""Suffix -> format, in the order of messages and help texts."""

READ_SUFFIXES = tuple(row.suffix for row in FORMATS.values() if row.reads)
"""Suffixes that ``load`` reads."""
WRITE_SUFFIXES = tuple(row.suffix for row in FORMATS.values() if row.writes)
"""Suffixes that ``save`` and ``encode`` write."""
WIRE_SUFFIXES = tuple(row.suffix for row in FORMATS.values() if row.media_type)
"""Suffixes that ``parse`` reads and that the HTTP service accepts and sends."""
WIRE_FORMATS = tuple(suffix.removeprefix(".") for suffix in WIRE_SUFFIXES)
"""The names that they have there."""


_RATES = 1e-3, 1e5
"""Lowest and highest rate that a clip or a face may be said to have, frames a second."""


@dataclass(frozen=True)
class ReadAs:
    """How a file is read where it does not say, or says what is wrong; fields that are not given follow the file.

    fps: frames a second at which its frames were recorded, whatever the file says; no frame is made or left out.
    face_fps: frames a second of a face in CSV: of its timecodes, or, without those, of its rows.
    take: of FBX files, the name of one of several motions; by default the first that moves its joints.
    rest_frame: the frame whose pose is the rest pose, if the rig shows no person with all rotations zero; by default
        the first that shows one.
    roles: role -> joint name, for rigs that are not recognised by joint names.

    Raises ``InputError`` for a rate outside 0.001 to 100,000, a frame that is no whole number, and unknown roles.
    """

    fps: float | None = None
    face_fps: float | None = None
    take: str = ""
    rest_frame: int | None = None
    roles: Mapping[str, str] | None = field(default=None, hash=False)

    def __post_init__(self) -> None:
        for name, rate in (("fps", self.fps), ("face_fps", self.face_fps)):
            if rate is not None and not (isinstance(rate, int | float) and _RATES[0] <= rate <= _RATES[1]):
                raise InputError(f"{name} {rate!r:.40}, expected frames a second, {_RATES[0]:g} to {_RATES[1]:,.0f}")
        if self.rest_frame is not None and not isinstance(self.rest_frame, int):
            raise InputError(f"rest_frame {self.rest_frame!r:.40}, expected a frame's number")
        if self.roles is not None:
            from signsplice.rig.roles import ROLES, unknown_role

            if not isinstance(self.roles, Mapping):
                raise InputError(f"roles {self.roles!r:.40}, expected role -> joint name, as of roles.read")
            for role in self.roles:
                if role not in ROLES:
                    raise InputError(unknown_role(str(role)[:40]))

    def or_else(self, other: ReadAs) -> ReadAs:
        """Return these values, with those of ``other`` for fields that are not given."""
        given = {name: value for name, value in vars(self).items() if value not in (None, "")}
        return replace(other, **given)


AS_WRITTEN = ReadAs()
"""As the file says."""


def load(
    path: str | Path,
    limits: ReadLimits = DEFAULT_LIMITS,
    rest_frame: int | None = None,
    face: str | Path | None = None,
    face_offset: float = 0.0,
    take: str = "",
    read: ReadAs = AS_WRITTEN,
) -> Clip:
    """Load a clip from a file with one of ``READ_SUFFIXES``, or from a folder whose files are frames (``frames``). If
    it holds no face, that in a NAME.csv beside it is read (``live_link``).

    face: a CSV file, or another clip's file, with the clip's face, instead of the file beside it.
    face_offset: time of the first row or frame of that file after the clip's first frame, seconds.
    read: how the file is read where it does not say, or says what is wrong.
    rest_frame, take: those of ``read``, if given.

    Raises ``InputError`` for another suffix or a file that cannot be read, ``FormatError`` if its content is not valid,
    and ``LimitError`` if it exceeds ``limits``, which ``NO_LIMITS`` lifts.
    """
    is_folder = Path(path).is_dir()
    path = path if Path(path).name else Path(path).resolve()  # "." is a folder too
    row = FORMATS[".npz"] if is_folder else _format(path, "read", READ_SUFFIXES)
    if take and not row.has_takes:
        raise InputError(f"{path}: take {take!r:.80}, expected none: {row.suffix} files have one motion")
    read = ReadAs(take=take, rest_frame=rest_frame).or_else(read)
    take = read.take if row.has_takes else ""
    # A wrong rate does not make a clip too long.
    within = limits if read.fps is None else replace(limits, seconds=math.inf)
    if is_folder:
        from signsplice.formats import frames

        clip = frames.load(Path(path), within)
    else:
        clip = _parse_content(row, read_bytes(path, limits.file_bytes), str(path), within, Path(path).parent, take)
    if read.take and not row.has_takes:
        clip = replace(
            clip, notes=(*clip.notes, f"{row.suffix} files have one motion: take {read.take!r:.40} is not used")
        )
    if read.fps is not None:
        notes = (*clip.notes, f"read at {read.fps:.6g} fps as asked, not at {clip.fps:.6g}")
        clip = replace(clip, fps=read.fps, notes=notes if read.fps != clip.fps else clip.notes)
        limits.check_clip(len(clip), len(clip.skeleton), clip.fps, 0.0, 0.0, str(path))
    if face is not None or (clip.face is None and Path(path).with_suffix(".csv").is_file()):
        clip = _add_face(clip, Path(path), face, face_offset, limits, read.face_fps)
    if read.roles is not None:
        from signsplice.formats.roles import with_roles

        try:
            clip = with_roles(clip, read.roles)
        except InputError as error:
            raise InputError(f"{path}: {error}") from error
    if read.rest_frame is None:
        return clip
    from signsplice.rig.rest_pose import with_rest_pose

    return with_rest_pose(clip, read.rest_frame)


def _add_face(
    clip: Clip, path: Path, face: str | Path | None, offset: float, limits: ReadLimits, face_fps: float | None
) -> Clip:
    """Return the clip of a file with the face in another file, or without one with that in the CSV file beside it."""
    from signsplice.formats import live_link

    if face is not None and Path(face).suffix.lower() in READ_SUFFIXES:
        return live_link.with_face_of(clip, load(face, limits), str(face), offset)
    face_file = face or live_link.sidecar(path)
    return clip if face_file is None else live_link.with_face(clip, face_file, offset, limits, face_fps)


def parse(content: bytes, file: str, limits: ReadLimits = DEFAULT_LIMITS) -> Clip:
    """Parse the bytes of a file whose name has one of ``WIRE_SUFFIXES`` into a clip. For uploads: no file is opened,
    whatever the bytes refer to. Raises the errors of ``load``.
    """
    row = _format(file, "taken", WIRE_SUFFIXES)
    check_most(len(content), "bytes", limits.file_bytes, file)
    return _parse_content(row, content, file, limits, None)


def _parse_content(
    row: FileFormat, content: bytes, file: str, limits: ReadLimits, folder: Path | None, take: str = ""
) -> Clip:
    """Parse the bytes of a file into a clip: the error boundary of all parsers."""
    import numpy as np

    module = import_module(f"{__name__}.{row.module}")
    with (
        format_errors(file, f"{row.suffix} file"),
        np.errstate(all="ignore"),  # the clip refuses numbers that are not finite
    ):
        options = {"folder": folder} if row.has_buffers else {"take": take} if row.has_takes else {}
        clip: Clip = module.parse(content, file, limits, **options)
        if clip.skeleton.roles:
            from signsplice.rig.info import rig_info

            _ = rig_info(clip.skeleton).roles  # raises if they do not fit the joints
    return clip


def save(clip: Clip, path: str | Path) -> None:
    """Write a clip to a file with one of ``WRITE_SUFFIXES``, whole or not at all; its face goes to a file NAME.csv
    beside it if the format holds none. Raises ``InputError`` for another suffix, a clip that the format cannot hold, or
    a file that cannot be written.
    """
    check_suffix(path)
    with replacing(path) as temporary:
        try:
            content = encode(clip, str(path))
        except InputError as error:
            raise InputError(f"{path}: {error}") from error
        temporary.write_bytes(content)
    if clip.face is not None and not _format(path, "written", WRITE_SUFFIXES).holds_faces:
        from signsplice.formats import live_link

        write(Path(path).with_suffix(".csv"), live_link.encode(clip))


def encode(clip: Clip, file: str) -> bytes:
    """Encode a clip as the bytes of a file whose name has one of ``WRITE_SUFFIXES``. Raises ``InputError`` for another
    suffix or a clip that the format cannot hold.
    """
    row = _format(file, "written", WRITE_SUFFIXES)
    content: bytes = import_module(f"{__name__}.{row.module}").encode(clip)
    return content


def check_suffix(path: str | Path) -> None:
    """Raise ``InputError`` if ``save`` would refuse a path because of its suffix."""
    _format(path, "written", WRITE_SUFFIXES)


def join_suffixes(suffixes: Sequence[str]) -> str:
    """Join suffixes into a phrase: ".bvh, .glb or .vrma"."""
    return f"{', '.join(suffixes[:-1])} or {suffixes[-1]}"


def _format(path: str | Path, done: str, suffixes: Sequence[str]) -> FileFormat:
    """Return the format of a path. Raises ``InputError`` that says what cannot be ``done`` with it."""
    suffix, double_suffix = Path(path).suffix.lower(), "".join(Path(path).suffixes[-2:]).lower()
    if double_suffix in suffixes:
        return FORMATS[double_suffix]
    if suffix in suffixes:
        return FORMATS[suffix]
    expected = f"expected {join_suffixes(suffixes)}"
    if suffix == ".vrm":
        raise InputError(f"{path}: is an avatar, no clip, {expected}; `signsplice convert` puts clips onto avatars")
    raise InputError(f"{path}: a file with suffix {suffix or '(none)'} cannot be {done}, {expected}")
