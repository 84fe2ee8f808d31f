"""Encodes clips as bytes of a lexicon's frames file, and decodes them.

Values that are constant over a word are stored once. The layout, little-endian:

1. one byte, 0 or 1, for each joint: whether its rotation changes; one for the root position; if bone lengths change,
   one more for each joint: whether its translation changes; zeros up to a multiple of 8;
2. for each of rotations, root position and bone translations: the constant values, then the changing ones frame by
   frame;
3. zeros up to a multiple of 8;
4. if the word has a face: eight bytes with a bit for each of ARKit's 52 coefficients that it has, lowest first, then
   its weights frame by frame in float32, and zeros up to a multiple of 8.

Rotations are quaternions x y z w in float32, or in int16 with a unit of 1/32767 (an error below 1e-4 rad). All else is
float32. Changing int16 rotations are compressed to about a quarter: a uint32 with the number of compressed bytes, then
the differences between successive frames, all low bytes before all high bytes, deflated.
"""

from __future__ import annotations

import hashlib
import struct
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from signsplice.errors import InputError
from signsplice.lexicon.gloss import Entry
from signsplice.motion import Clip, FloatArray, Skeleton
from signsplice.motion.face import ARKIT_CHANNELS, Face

Buffer = bytes | memoryview

FRAMES = "frames.bin"
MAGIC = b"signsplice frames 2\n".ljust(32, b"\0")
"""First 32 bytes of the file; the 32 bytes of the lexicon's SHA-256 follow."""
HEAD_BYTES = len(MAGIC) + 32
FORMS = ("float32", "int16")
_UNIT = 32767.0
_ALIGN = 8
_FREE_BYTES = 64 << 20
"""Memory that any clip may take, bytes."""
_GROWTH = 10
"""Memory that a clip may take beyond that, as a multiple of the size of its changing numbers."""
_LENGTH_TOLERANCE = 2e-4
"""Rounding changes a quaternion's length by less than this; a larger change means damage."""


def encode(clip: Clip, form: str) -> bytes:
    """Encode a clip's motion in one of ``FORMS``. Raises ``InputError`` if a position exceeds float32."""
    rotations = clip.local_rotations / np.linalg.norm(clip.local_rotations, axis=-1, keepdims=True)
    tracks: list[NDArray[Any]] = [
        np.rint(rotations * _UNIT).astype("<i2") if form == "int16" else rotations.astype("<f4"),
        _positions(clip.root_positions[:, None], clip.name),
    ]
    if clip.translations is not None:
        tracks.append(_positions(clip.translations, clip.name))
    changing = [np.any(track != track[:1], axis=(0, 2)) for track in tracks]
    _check_memory(len(clip), changing, 0)
    parts = [_pad_bytes(np.concatenate(changing).astype(np.uint8).tobytes())]
    for track, changes in zip(tracks, changing, strict=True):
        varying = track[:, changes]
        parts.append(track[0, ~changes].tobytes())
        parts.append(_compress_rotations(varying) if varying.dtype.kind == "i" else varying.tobytes())
    block = _pad_bytes(b"".join(parts))
    if clip.face is not None:
        channels = tuple(name for name in ARKIT_CHANNELS if name in clip.face.channels)
        bits = sum(1 << k for k, name in enumerate(ARKIT_CHANNELS) if name in channels)
        block += _pad_bytes(struct.pack("<Q", bits) + clip.face.of(channels).astype("<f4").tobytes())
    return block


def _face(block: Buffer, n_frames: int, at: int) -> Face | None:
    """Decode the face that begins at a byte; None if the block ends there."""
    if at == len(block):
        return None
    (bits,) = struct.unpack("<Q", bytes(_numbers(block, np.dtype(np.uint8), 8, at)))
    channels = tuple(name for k, name in enumerate(ARKIT_CHANNELS) if bits >> k & 1)
    count = n_frames * len(channels)
    if bits >> len(ARKIT_CHANNELS) or not channels or _align_up(at + 8 + 4 * count) != len(block):
        raise InputError("its frames are not as many as the index says")
    weights = _numbers(block, np.dtype("<f4"), count, at + 8)
    return Face(channels, weights.reshape(n_frames, len(channels)).astype(np.float64))


def decode(block: Buffer, form: str, has_translations: bool, skeleton: Skeleton, entry: Entry) -> Clip:
    """Decode the clip of an entry from bytes in one of ``FORMS``; ``has_translations``: whether bone lengths change.
    Raises ``InputError`` if the bytes are damaged or have another shape.
    """
    n_frames = entry.n_frames
    widths = [len(skeleton), 1, len(skeleton)][: 3 if has_translations else 2]
    if len(block) < sum(widths):
        raise InputError("its frames end early")
    marks = np.frombuffer(block, np.uint8, sum(widths))
    if np.any(marks > 1):
        raise InputError("its frames are not where the index says")
    changing = np.split(marks.astype(bool), np.cumsum(widths)[:-1])
    _check_memory(n_frames, changing, len(block))
    types = [np.dtype("<i2" if form == "int16" else "<f4"), np.dtype("<f4"), np.dtype("<f4")]
    offset = _align_up(sum(widths))
    tracks: list[FloatArray] = []
    for changes, n_parts, dtype in zip(changing, (4, 3, 3), types, strict=False):
        n_changing = int(changes.sum())
        n_constant = len(changes) - n_changing
        constant = _dequantize(_numbers(block, dtype, n_parts * n_constant, offset).reshape(n_constant, n_parts))
        offset += constant.size * dtype.itemsize
        count = n_frames * n_changing * n_parts
        if dtype.kind == "i":
            numbers, size = _decompress_rotations(block, n_frames, count, offset)
        else:
            numbers, size = _numbers(block, dtype, count, offset), count * dtype.itemsize
        varying = _dequantize(numbers.reshape(n_frames, n_changing, n_parts))
        offset += size
        track = np.empty((n_frames, len(changes), n_parts))
        track[:, ~changes] = constant
        track[:, changes] = varying
        tracks.append(track)
    face, bones = _face(block, n_frames, _align_up(offset)), tracks[2] if has_translations else None
    return Clip(skeleton, tracks[0], tracks[1][:, 0], entry.fps, entry.gloss, bones, face=face)


def _check_memory(n_frames: int, changing: list[NDArray[np.bool_]], n_bytes: int) -> None:
    """Raise ``InputError`` if a clip would take far more memory than its changing numbers: constant values take no
    bytes in the file, however many frames there are.
    """
    needed, unpacked = 0, n_bytes
    for changes, n_parts in zip(changing, (4, 3, 3), strict=False):
        needed += 8 * n_parts * n_frames * len(changes)
        unpacked += 2 * n_parts * n_frames * int(changes.sum())
    if needed > _FREE_BYTES + _GROWTH * unpacked:
        raise InputError(f"{n_frames} frames take {needed >> 20} MiB of memory, though few of its joints move")


def _numbers(block: Buffer, dtype: np.dtype[Any], count: int, at: int) -> NDArray[Any]:
    if at + count * dtype.itemsize > len(block):
        raise InputError("its frames end early")
    return np.frombuffer(block, dtype, count, at)


def _compress_rotations(rotations: NDArray[np.int16]) -> bytes:
    """Compress rotations (T, K, 4) in int16. Differences may overflow; their cumulative sum undoes that."""
    steps = np.diff(rotations.reshape(len(rotations), -1), axis=0, prepend=np.int16(0)).astype("<i2")
    split = np.ascontiguousarray(steps.T).view(np.uint8).reshape(-1, 2).T
    packed = zlib.compress(np.ascontiguousarray(split).tobytes(), 9)
    return struct.pack("<I", len(packed)) + packed


def _decompress_rotations(block: Buffer, n_frames: int, count: int, at: int) -> tuple[NDArray[np.int16], int]:
    """Return the numbers (count,) that ``_compress_rotations`` stored, and their size in bytes. Decompresses at most
    ``count`` numbers.
    """
    (size,) = struct.unpack("<I", bytes(_numbers(block, np.dtype(np.uint8), 4, at)))
    packed = bytes(_numbers(block, np.dtype(np.uint8), size, at + 4))
    try:
        raw = zlib.decompressobj().decompress(packed, 2 * count + 1) if count else b""
    except zlib.error as error:
        raise InputError(f"its frames cannot be unpacked ({error})") from error
    if len(raw) != 2 * count:
        raise InputError("its frames are not as many as the index says")
    low, high = np.frombuffer(raw, np.uint8).reshape(2, -1)
    steps = np.ascontiguousarray((low + (high.astype(np.int16) << 8)).reshape(-1, n_frames).T)
    return np.cumsum(steps, axis=0, dtype=np.int16).reshape(-1), 4 + size


def fingerprint(block: Buffer, skeleton_sha256: str, fps: float, n_frames: int) -> str:
    """Return the SHA-256 of a word: of its skeleton's hash, its frame rate, its length and its bytes."""
    digest = hashlib.sha256(bytes.fromhex(skeleton_sha256) + struct.pack("<dq", fps, n_frames))
    digest.update(block)
    return digest.hexdigest()


def _dequantize(numbers: NDArray[Any]) -> NDArray[Any]:
    """Return stored numbers unchanged, but int16 rotations as unit quaternions in float64."""
    if numbers.dtype.kind != "i":
        return numbers
    values = numbers.astype(np.float64)
    lengths = np.sqrt(np.einsum("...c,...c->...", values, values))
    if np.any(np.abs(lengths - _UNIT) > _LENGTH_TOLERANCE * _UNIT):
        raise InputError("a rotation is not of unit length")
    values /= lengths[..., None]
    return values


def _positions(values: FloatArray, name: str) -> NDArray[np.float32]:
    with np.errstate(over="ignore"):
        stored = values.astype("<f4")
    if not np.isfinite(stored).all():
        raise InputError(f"clip {name!r}: a position of {np.abs(values).max():g}, expected below 3.4e38")
    return stored


def _align_up(n: int) -> int:
    return -(-n // _ALIGN) * _ALIGN


def _pad_bytes(part: bytes) -> bytes:
    return part.ljust(_align_up(len(part)), b"\0")
