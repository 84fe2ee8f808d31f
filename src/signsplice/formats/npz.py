"""NumPy archives (``.npz``): the arrays of a clip unchanged, quick to open."""

from __future__ import annotations

import json
import math
import zipfile
from collections.abc import Mapping
from dataclasses import asdict
from io import BytesIO
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from signsplice.errors import InputError, LimitError
from signsplice.formats import smplx
from signsplice.formats.json_files import as_object
from signsplice.formats.reading import DEFAULT_LIMITS, ReadLimits, check_most
from signsplice.motion import Channels, Clip, EndSite, FloatArray, Skeleton
from signsplice.motion.euler import POSITIONS, ROTATIONS
from signsplice.motion.face import Face
from signsplice.motion.points import Component, Framing, PointLayout, Points

VERSION = 1
"""Version of the archives that ``encode`` writes."""
_ENTRY = b"PK\x01\x02"
"""First bytes of each member's entry in an archive's directory."""
_LEAST_ALLOWED = 64 << 20
"""Bytes that any archive may unpack to, however small it is."""
_HEAD = "head"
"""Name of the array with the description, as JSON text."""
_INTEGERS = "parents"
"""Name of the only array of whole numbers."""
_ARRAYS = {
    "parents": 1, "offsets": 2, "end_offsets": 2, "local_rotations": 3, "root_positions": 2,
    "translations": 3, "channel_values": 2, "channel_offsets": 2, "face_weights": 2,
    "point_values": 3, "point_confidence": 2,
}  # fmt: skip
"""Names of arrays -> number of their dimensions."""
_OF_FRAMES = ("local_rotations", "root_positions", "translations", "face_weights")
"""Names of the arrays that are rounded."""
_ROUNDED_TO = 2.0**-16
"""Rounded values are multiples of this, in each array's own unit."""


def encode(clip: Clip, rounded: bool = False) -> bytes:
    """Encode every array of a clip in an archive. ``rounded``: values of frames become multiples of ``_ROUNDED_TO`` in
    32 bits, about a third of the bytes, and the channels of the clip's file are left out.
    """
    skeleton = clip.skeleton
    channels = None if clip.channels is None or rounded else clip.channels.mask_moved_root()
    head: dict[str, Any] = {
        "version": VERSION,
        "name": clip.name,
        "fps": clip.fps,
        "names": skeleton.names,
        "end_joints": [site.joint for site in skeleton.end_sites],
        "roles": dict(skeleton.roles) if skeleton.roles is not None else None,
        "report": clip.report,
    }
    arrays = {
        "parents": skeleton.parents,
        "offsets": skeleton.offsets,
        "end_offsets": np.array([site.offset for site in skeleton.end_sites]).reshape(-1, 3),
        "local_rotations": clip.local_rotations,
        "root_positions": clip.root_positions,
    }
    if clip.translations is not None:
        arrays["translations"] = clip.translations
    if channels is not None:
        head |= {"channels": channels.names, "frame_time": channels.frame_time, "starts": channels.starts}
        arrays |= {"channel_values": channels.values, "channel_offsets": channels.offsets}
    if clip.face is not None:
        head["face"], arrays["face_weights"] = clip.face.channels, clip.face.weights
    if clip.points is not None:
        head["points"] = {**asdict(clip.points.layout), "framing": asdict(clip.points.framing)}
        arrays |= {"point_values": clip.points.values, "point_confidence": clip.points.confidence}
    if rounded:
        frames = {name: arrays[name] for name in _OF_FRAMES if name in arrays}
        arrays |= {name: (np.rint(a / _ROUNDED_TO) * _ROUNDED_TO).astype(np.float32) for name, a in frames.items()}
    archive = BytesIO()
    np.savez_compressed(archive, head=np.array(json.dumps(head)), **arrays)  # type: ignore[arg-type]
    return archive.getvalue()


def parse(content: bytes, file: str = "", limits: ReadLimits = DEFAULT_LIMITS) -> Clip:
    """Parse an archive that ``encode`` made, or that holds SMPL-X poses, into a clip. Raises ``InputError``, or errors
    of numpy and zipfile, for any other.
    """
    arrays, unpacked = _read_arrays(content, file, limits)
    if _HEAD not in arrays:
        return smplx.build_clip(arrays, file, limits, unpacked)
    clip = _clip(json.loads(str(arrays.pop(_HEAD))), arrays)
    limits.check_clip(len(clip), len(clip.skeleton), clip.fps, clip.nbytes, unpacked, file)
    return clip


def parse_arrays(content: bytes, file: str, limits: ReadLimits) -> dict[str, NDArray[Any]]:
    """Parse the arrays of an archive of SMPL-X poses. Raises as ``parse`` does."""
    arrays, _ = _read_arrays(content, file, limits)
    if _HEAD in arrays:
        raise InputError("it is a clip that signsplice wrote, expected one frame of SMPL-X")
    return arrays


def _read_arrays(content: bytes, file: str, limits: ReadLimits) -> tuple[dict[str, NDArray[Any]], int]:
    """Return the arrays of an archive that a clip is made of, and the bytes that all of them unpack to."""
    check_most(content.count(_ENTRY), "members", limits.members, file)  # before zipfile makes an object of each
    with zipfile.ZipFile(BytesIO(content)) as archive:
        unpacked = sum(member.file_size for member in archive.infolist())
        max_bytes = min(limits.unpacked_bytes, max(_LEAST_ALLOWED, limits.expansion * len(content)))
        if unpacked > max_bytes:
            what = f"unpacks to {unpacked >> 20:,} MiB, far more than a clip does"
            raise LimitError(f"{what}; expected at most {max_bytes / 2**20:,.0f} MiB", file=file)
        members = {name.removesuffix(".npy") for name in archive.NameToInfo}
        is_ours = _HEAD in members
        if not is_ours and not smplx.is_smplx(members):
            raise InputError("it is no clip that signsplice wrote, nor poses of SMPL-X")
        names = [name for name in ((_HEAD, *_ARRAYS) if is_ours else smplx.NAMES) if name in members]
        for name in names:
            _check_member(archive, name, is_ours)
    with np.load(BytesIO(content), allow_pickle=False) as stored:
        return {name: stored[name] for name in names}, unpacked


def _check_member(archive: zipfile.ZipFile, name: str, is_ours: bool) -> None:
    """Raise ``InputError`` if an array has a wrong type or does not match its bytes, before memory is allocated."""
    member = archive.getinfo(f"{name}.npy")
    if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise InputError(f"{name} is compressed by method {member.compress_type}, expected deflate or none")
    with archive.open(member) as stored:
        if is_ours:
            check_array(stored, member.file_size, name, "U" if name == _HEAD else "i" if name == _INTEGERS else "f")
        else:
            check_array(stored, member.file_size, name)


def check_array(stored: IO[bytes], n_bytes: int, name: str, kind: str = "") -> None:
    """Raise ``InputError`` if an array in a file of ``n_bytes`` has a wrong type or does not match its bytes.

    kind: of one of our own arrays; empty for one of others, which holds floats, or a single whole number: a frame rate.
    """
    if np.lib.format.read_magic(stored) != (1, 0):
        raise InputError(f"{name} is no array of version 1.0")
    shape, _, dtype = np.lib.format.read_array_header_1_0(stored)
    n_bytes -= stored.tell()
    expected = kind or "f"
    is_count = not kind and not shape and dtype.kind in "iu"
    if (dtype.kind != expected and not is_count) or (not is_count and expected == "f" and dtype.itemsize not in (4, 8)):
        raise InputError(f"{name} holds {dtype}, expected {_KINDS[expected]}")
    if (kind and len(shape) != _ARRAYS.get(name, 0)) or math.prod(shape) * dtype.itemsize != n_bytes:
        raise InputError(f"{name} has shape {shape} in {n_bytes} bytes")


_KINDS = {"U": "text", "i": "whole numbers", "f": "numbers of 32 or 64 bits"}


def _clip(head: Any, arrays: Mapping[str, Any]) -> Clip:
    """Build the clip from an archive's description and arrays. Raises ``InputError`` if they are not valid."""
    if not isinstance(head, dict) or head.get("version") != VERSION:
        version = head.get("version") if isinstance(head, dict) else None
        raise InputError(f"version {version!r:.40}, expected {VERSION}")
    if not _are(head["names"], str) or not _are(head["end_joints"], int):
        raise InputError("names, end_joints: expected lists of joint names and joint numbers")
    if len(head["end_joints"]) != len(arrays["end_offsets"]):
        raise InputError(f"{len(head['end_joints'])} end sites with {len(arrays['end_offsets'])} offsets")
    sites = tuple(map(EndSite, head["end_joints"], arrays["end_offsets"]))
    skeleton = Skeleton(tuple(head["names"]), arrays["parents"], arrays["offsets"], sites, head["roles"])
    if not _are([head["fps"]], int, float):
        raise InputError(f"fps {head['fps']!r:.40}, expected a number")
    return Clip(
        skeleton=skeleton,
        local_rotations=_unit(arrays["local_rotations"]),
        root_positions=arrays["root_positions"],
        fps=head["fps"],
        name=head["name"],
        translations=arrays.get("translations"),
        channels=_channels(head, arrays) if "channels" in head else None,
        face=_face(head["face"], arrays["face_weights"]) if "face" in head else None,
        points=_points(head["points"], arrays) if "points" in head else None,
        report=as_object(head.get("report")) or None,
    )


def _unit(quats: FloatArray) -> FloatArray:
    """Return quaternions (T, J, 4); 32-bit ones in 64 bits, scaled to unit length if only rounding changed it."""
    if quats.dtype.itemsize != 4:
        return quats
    wide = quats.astype(np.float64)
    lengths = np.linalg.norm(wide, axis=-1, keepdims=True)
    np.divide(wide, lengths, out=wide, where=np.abs(lengths - 1.0) < 2.0 * _ROUNDED_TO)
    return wide


def _face(names: Any, weights: Any) -> Face:
    if not _are(names, str):
        raise InputError("face: expected a list of coefficients")
    return Face(tuple(names), weights)


def _points(described: Any, arrays: Mapping[str, Any]) -> Points:
    components = tuple(
        Component(
            str(group["name"]),
            tuple(map(str, group["points"])),
            tuple((int(a), int(b)) for a, b in group["limbs"]),
            tuple((int(r), int(g), int(b)) for r, g, b in group["colors"]),
            str(group["format"]),
        )
        for group in described["components"]
    )
    width, height, depth = map(int, described["size"])
    framing = Framing(*(float(described["framing"][name]) for name in ("scale", "x", "y", "z")))
    layout = PointLayout(components, (width, height, depth))
    return Points(layout, arrays["point_values"], arrays["point_confidence"], framing)


def _channels(head: Mapping[str, Any], arrays: Mapping[str, Any]) -> Channels:
    names, known = head["channels"], {*POSITIONS, *ROTATIONS}
    if not _are(names, list) or not all(len(set(row)) == len(row) and known.issuperset(row) for row in names):
        raise InputError("channels: expected a list of different channel names for each joint")
    values, starts = arrays["channel_values"], head["starts"]
    if not _are(starts, int) or starts[:1] != [0] or starts != sorted(set(starts)) or starts[-1] >= len(values):
        raise InputError("starts: expected 0 and rising numbers of frames")
    if np.isinf(values).any():
        raise InputError("channel_values: a number is infinite")
    offsets, rest = arrays["channel_offsets"], arrays["offsets"]
    holds = np.array([[name not in row for name in POSITIONS] for row in names])  # (J, 3): no channel replaces it
    if not np.isfinite(offsets).all() or (
        offsets.shape == rest.shape == holds.shape and np.any(offsets[holds] != rest[holds])
    ):
        raise InputError("channel_offsets: not finite, or others than offsets where no channel replaces them")
    if not _are([head["frame_time"]], int, float):
        raise InputError("frame_time: expected seconds")
    return Channels(tuple(map(tuple, names)), values, offsets, float(head["frame_time"]), tuple(starts))


def _are(values: Any, *kinds: type) -> bool:
    """Whether a value is a list whose items have exactly these types; True is no number."""
    return isinstance(values, list) and all(type(value) in kinds for value in values)
