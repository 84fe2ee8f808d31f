"""Landmarks of videos (``.pose``, versions 0.1 and 0.2), with the pose of a standard person fitted to them.

The format is that of github.com/sign-language-processing/pose (docs/specs): a header that names the points, then
coordinates and confidences as 32-bit floats, little-endian. Written files are of version 0.2.
"""

from __future__ import annotations

import math
import struct
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from signsplice.body.landmarks import find_anchors, project
from signsplice.errors import InputError
from signsplice.formats.reading import DEFAULT_LIMITS, ReadLimits, check_most, stem
from signsplice.formats.smplx import skeleton
from signsplice.motion import Clip
from signsplice.motion.cache import CACHE
from signsplice.motion.points import Component, Float32, Framing, PointLayout, Points

_VERSIONS = 0.1, 0.2
_N_JOINTS = 52
_LEAST_SEEN = 0.3
"""Fraction of frames in which a person must be seen to count as one."""


class _Cursor:
    """Reads numbers and texts of a file in order. Raises ``InputError`` where it ends early."""

    def __init__(self, content: bytes) -> None:
        self.content, self.at = content, 0

    def numbers(self, layout: str) -> tuple[Any, ...]:
        size = struct.calcsize(layout)
        self._check(size)
        self.at += size
        return struct.unpack_from(layout, self.content, self.at - size)

    def text(self) -> str:
        (size,) = self.numbers("<H")
        self._check(size)
        self.at += size
        return self.content[self.at - size : self.at].decode()

    def floats(self, *shape: int) -> NDArray[np.float32]:
        n_bytes = 4 * math.prod(shape)
        self._check(n_bytes)
        self.at += n_bytes
        return np.frombuffer(self.content, "<f4", math.prod(shape), self.at - n_bytes).reshape(shape)

    def _check(self, n_bytes: int) -> None:
        if self.at + n_bytes > len(self.content):
            raise InputError(f"it ends at byte {len(self.content):,}, {self.at + n_bytes:,} expected: cut short?")


def parse(content: bytes, file: str = "", limits: ReadLimits = DEFAULT_LIMITS) -> Clip:
    """Parse a file into a clip of a standard person that carries its landmarks. Raises ``InputError`` for other
    content, several people, and where no signer is seen; ``LimitError`` for too much.
    """
    layout, values, confidence, fps, n_people = read(content, file, limits)
    if not len(values):
        raise InputError("it has no frames")
    notes: tuple[str, ...] = ()
    if n_people > 1:
        seen = (confidence > 0.0).any(axis=2).mean(axis=0)  # (people,)
        people = np.flatnonzero(seen > _LEAST_SEEN)
        if len(people) > 1:
            raise InputError(f"it shows {len(people)} people, expected one: save the signer's points alone")
        values, confidence = values[:, people[:1]], confidence[:, people[:1]]
        notes = (f"of {n_people} people one is seen in most frames: the others are left out",)
    if not values.shape[1]:
        raise InputError("it shows nobody: no person in any frame")
    limits.check_clip(len(values), _N_JOINTS, fps, values.nbytes + confidence.nbytes, values.nbytes, file)
    return clip_of(layout, values[:, 0], confidence[:, 0], fps, stem(file), notes)


def clip_of(
    layout: PointLayout,
    values: Float32,
    confidence: Float32,
    fps: float,
    name: str,
    notes: tuple[str, ...] = (),
) -> Clip:
    """Return the clip of a standard person fitted to landmarks (T, P, D). Raises the errors of ``parse``."""
    from signsplice.body.landmark_fit import fit_person  # it imports scipy, which stored landmarks do not need

    bones = CACHE.recent(skeleton, _N_JOINTS, most=2)
    plain = np.where((confidence > 0.0)[..., None], values, np.float32(0.0))
    fitted = fit_person(CACHE.recent(find_anchors, layout, bones, most=8), plain, confidence, fps, bones)
    points = Points(layout, values, confidence, fitted.framing)
    notes = (*notes, *fitted.notes)
    return Clip(bones, fitted.local_rotations, fitted.root_positions, fps, name, notes=notes, points=points)


def read(
    content: bytes, file: str = "", limits: ReadLimits = DEFAULT_LIMITS
) -> tuple[PointLayout, Float32, Float32, float, int]:
    """Read a file's layout, coordinates (T, people, P, D), confidences (T, people, P), frame rate and number of people.
    Raises ``InputError`` if they do not fit together.
    """
    cursor = _Cursor(content)
    (version,) = cursor.numbers("<f")
    if not any(abs(version - known) < 1e-3 for known in _VERSIONS):
        if not 0.0 <= version < 10.0:
            raise InputError("it does not begin as the pose format does")
        raise InputError(f"version {version:.4g}, expected 0.1 or 0.2: convert it by pose-format")
    size, (n_components,) = cursor.numbers("<3H"), cursor.numbers("<H")
    components, n_named = [], 0
    for _ in range(n_components):
        name, letters = cursor.text(), cursor.text()
        if letters not in ("XYC", "XYZC"):
            raise InputError(f"its points have {letters[:8]!r}, expected coordinates and a confidence (XYC, XYZC)")
        n_points, n_limbs, n_colors = cursor.numbers("<3H")
        n_named += n_points + n_limbs + n_colors
        check_most(n_named, "points, limbs and colours", 16 * limits.joints, file)
        points = tuple(cursor.text() for _ in range(n_points))
        limbs = tuple(cursor.numbers("<2H") for _ in range(n_limbs))
        colors = tuple(cursor.numbers("<3H") for _ in range(n_colors))
        components.append(Component(name, points, limbs, colors, letters))
    layout = PointLayout(tuple(components), size)
    if not layout.names:
        raise InputError("it names no points")
    check_most(len(layout.names), "points", 4 * limits.joints, file)
    fps, n_frames, n_people = cursor.numbers("<fIH") if version > 0.15 else cursor.numbers("<3H")
    n_numbers = len(layout.names) * n_people * (layout.n_dims + 1)
    if version <= 0.15 and n_numbers:  # its 16 bits do not hold long recordings
        n_frames = (len(content) - cursor.at) // (4 * n_numbers)
    check_most(n_frames, "frames", limits.frames, file)
    if not (math.isfinite(fps) and fps > 0.0):
        raise InputError(f"frame rate {fps:g}, expected a positive number")
    values = cursor.floats(n_frames, n_people, len(layout.names), layout.n_dims)
    confidence = cursor.floats(n_frames, n_people, len(layout.names))
    if cursor.at != len(content):
        raise InputError(f"{len(content) - cursor.at:,} bytes follow its last frame: is it damaged?")
    return layout, values, confidence, float(fps), n_people


def encode(clip: Clip) -> bytes:
    """Encode the landmarks of a clip; of motion without any, those of a camera ahead of it (``landmarks.project``).
    Raises ``InputError`` if its arms are not known.
    """
    return _encode(project(clip) if clip.points is None else clip.points, clip.fps)


def pack_points(points: Points) -> bytes:
    """Pack landmarks with their framing, deflated."""
    framing = points.framing
    head = struct.pack("<4d", framing.scale, framing.x, framing.y, framing.z)
    return zlib.compress(head + _encode(points, 1.0), 6)


_HEADER_BYTES, _FRAME_BYTES = 1 << 20, 1 << 16
"""Most bytes of a header, and of a frame: 4,096 points of four numbers."""


def unpack_points(packed: bytes, n_frames: int) -> Points:
    """Unpack landmarks of ``n_frames`` at most. Raises ``InputError``, or an error of zlib or struct, for others."""
    content = zlib.decompressobj().decompress(packed, _HEADER_BYTES + _FRAME_BYTES * n_frames)
    layout, values, confidence, _, _ = read(content[32:])
    return Points(layout, values[:, 0], confidence[:, 0], Framing(*struct.unpack_from("<4d", content)))


def _encode(points: Points, fps: float) -> bytes:
    parts = [struct.pack("<f3HH", 0.2, *points.layout.size, len(points.layout.components))]
    for group in points.layout.components:
        parts += [_text(group.name), _text(group.format)]
        parts.append(struct.pack("<3H", len(group.points), len(group.limbs), len(group.colors)))
        parts += [_text(name) for name in group.points]
        parts += [struct.pack("<2H", *limb) for limb in group.limbs]
        parts += [struct.pack("<3H", *color) for color in group.colors]
    parts.append(struct.pack("<fIH", fps, len(points), 1))
    return b"".join([*parts, points.values.astype("<f4").tobytes(), points.confidence.astype("<f4").tobytes()])


def _text(text: str) -> bytes:
    return struct.pack("<H", len(text.encode())) + text.encode()
