"""Conversion between the Euler channels that an animator sees and rotations.

A file's Euler numbers hold more than its rotations: whole turns, the choice between two equal triples, decimals. A clip
therefore carries them along (``clip.Channels``), and ``complete`` returns them unchanged for frames that were not
edited. For new frames (a transition, a retargeted pose) it derives them so that no curve jumps by a half or whole
revolution.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from signsplice.motion import rotation
from signsplice.motion.clip import ChannelNames, Channels, Clip, bone_translations
from signsplice.motion.rotation import FloatArray

_BLOCK = 4096
"""Frames converted at a time, to limit the memory of intermediate results."""
POSITIONS = ("Xposition", "Yposition", "Zposition")
ROTATIONS = ("Xrotation", "Yrotation", "Zrotation")
_WIDEN_DEG = 1e-4
"""A joint gets missing rotation channels only if it rotates by more than this about their axes."""
_DECIMALS = 8
"""Decimals of derived numbers, far finer than any capture resolves."""
_LOCKED = 1e-6
"""Below this cosine of the middle angle, only the sum or difference of the other two angles is determined."""


def default_names(n_joints: int) -> ChannelNames:
    """Return channels for a clip without any: XYZ position and ZXY rotation on the root, ZXY rotation elsewhere."""
    rotations = ("Zrotation", "Xrotation", "Yrotation")
    return ((*POSITIONS, *rotations), *([rotations] * (n_joints - 1)))


def rotation_axes(names: Sequence[str]) -> str:
    """Return the letters of a joint's rotation channels in order: ("Zrotation", "Xrotation") -> "ZX"."""
    return "".join(name[0].upper() for name in names if name.endswith("rotation"))


def first_columns(names: ChannelNames) -> list[int]:
    """Return the first column (J,) of each joint's channels."""
    ends = np.cumsum([0, *map(len, names)])
    return [int(c) for c in ends[:-1]]


def to_motion(names: ChannelNames, values: FloatArray, offsets: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Convert channel ``values`` (T, C) to local rotations (T, J, 4) and translations (T, J, 3).

    A position channel replaces its component of the offset (rejected: adding to it, which displaces 6-channel files).
    Rotations are the intrinsic product of the channels in their order.
    """
    n_frames, n_joints = len(values), len(names)
    rotations = np.empty((n_frames, n_joints, 4))
    translations = np.empty((n_frames, n_joints, 3))
    translations[:] = offsets
    starts = first_columns(names)
    groups: dict[tuple[str, ...], list[int]] = {}
    for joint, channels in enumerate(names):
        groups.setdefault(channels, []).append(joint)
    for channels, joints in groups.items():
        first = np.array([starts[j] for j in joints])
        rotating = [i for i, name in enumerate(channels) if name.endswith("rotation")]
        cols = first[:, None] + np.array(rotating, np.intp)
        for start in range(0, n_frames, _BLOCK):
            rows = slice(start, start + _BLOCK)
            angles = np.deg2rad(values[rows][:, cols])  # (B, K, A)
            rotations[rows, joints] = rotation.from_euler(angles, rotation_axes(channels))
        for i, name in enumerate(channels):
            if name in POSITIONS:
                translations[:, joints, POSITIONS.index(name)] = values[:, first + i]
    return rotations, translations


def complete(clip: Clip) -> tuple[ChannelNames, FloatArray]:
    """Return channel names and values (T, C) of every frame of a clip, with no number missing.

    Numbers from a file stay unchanged, except that a whole run may shift by whole revolutions, or to the other equal
    triple, so that curves continue from the frame before; the first run never changes. All other numbers are derived
    from the rotations. A joint gets missing channels only if its motion needs them.
    """
    channels = None if clip.channels is None else clip.channels.mask_moved_root()
    n_frames, n_joints = len(clip), len(clip.skeleton)
    usual = default_names(n_joints)
    if channels is None and clip.translations is None:
        angles = _nearest_euler_angles(clip.local_rotations, _three(""), None).reshape(n_frames, -1)
        return usual, np.round(np.concatenate([clip.root_positions, angles], axis=1), _DECIMALS)
    if channels is not None:
        channels, edited = _still_valid(clip, channels)
        if not edited and len(channels.starts) == 1 and not np.isnan(channels.values).any():
            return channels.names, channels.values
    if channels is None:
        channels = Channels(usual, np.full((n_frames, 3 * n_joints + 3), np.nan), clip.skeleton.offsets, 0.0)
    axes = [_three(rotation_axes(names)) for names in channels.names]
    angles = _channel_angles(channels)
    spans = list(zip(channels.starts, (*channels.starts[1:], n_frames), strict=True))
    for order in sorted(set(axes)):
        joints = np.array([j for j in range(n_joints) if axes[j] == order])
        angles[:, joints] = _complete_angles(angles[:, joints], clip.local_rotations[:, joints], order, spans)
    return _encode_channels(clip, channels, axes, angles)


def _still_valid(clip: Clip, given: Channels) -> tuple[Channels, bool]:
    """Return the given numbers, with NaN for those that no longer match the clip's rotations and positions, and whether
    there are any such.
    """
    rotations, translations = to_motion(given.names, given.values, given.offsets)
    turned = np.abs(np.einsum("tjc,tjc->tj", rotations, clip.local_rotations)) < 1.0 - 1e-11  # half angle of some 5e-6
    positions = bone_translations(clip)
    limit = 1e-9 * max(1.0, float(np.abs(positions).max()))
    moved = np.abs(translations - positions) > limit
    moved[:, 0] = np.abs(translations[:, 0] - clip.root_positions) > limit
    if not (turned.any() or moved.any()):
        return given, False
    values = np.array(given.values)
    for joint, (start, names) in enumerate(zip(first_columns(given.names), given.names, strict=True)):
        for i, name in enumerate(names):
            stale = moved[:, joint, POSITIONS.index(name)] if name in POSITIONS else turned[:, joint]
            values[stale, start + i] = np.nan
    return replace(given, values=values), True


def _three(axes: str) -> str:
    """Return ``axes`` followed by the letters it lacks."""
    return axes + "".join(letter for letter in "ZXY" if letter not in axes)


def _channel_angles(given: Channels) -> FloatArray:
    """Return angles (T, J, 3), degrees, about each joint's three axes: as given, 0 about axes without a channel, else
    NaN.
    """
    angles = np.zeros((len(given.values), len(given.names), 3))
    for joint, (start, names) in enumerate(zip(first_columns(given.names), given.names, strict=True)):
        turning = [i for i, name in enumerate(names) if name.endswith("rotation")]
        if turning:
            angles[:, joint, : len(turning)] = given.values[:, [start + i for i in turning]]
        else:
            angles[:, joint] = np.nan
    angles[np.isnan(angles).any(axis=-1)] = np.nan
    return angles


def _complete_angles(
    angles: FloatArray, rotations: FloatArray, axes: str, spans: Sequence[tuple[int, int]]
) -> FloatArray:
    """Complete angles (T, K, 3), degrees, of joints with one order of axes: missing ones are derived, and each span
    continues the one before.
    """
    completed = np.array(angles)
    for start, stop in spans:
        known = ~np.isnan(completed[start:stop]).any(axis=(0, 2))
        if start > 0 and known.any():
            completed[start:stop, known] = _unwrap_span(completed[start:stop, known], completed[start - 1, known])
        new = np.flatnonzero(~known)
        if new.size:
            before = completed[start - 1, new] if start > 0 else None
            completed[start:stop, new] = _nearest_euler_angles(rotations[start:stop, new], axes, before)
    return completed


def _unwrap_span(angles: FloatArray, before: FloatArray) -> FloatArray:
    """Move a whole span (S, K, 3), degrees, to the equivalent angles nearest to ``before`` (K, 3)."""
    first = angles[0]
    alternative = np.stack([first[:, 0] + 180.0, 180.0 - first[:, 1], first[:, 2] + 180.0], axis=-1)
    shift = 360.0 * np.round((before - first) / 360.0)
    alternative_shift = 360.0 * np.round((before - alternative) / 360.0)
    cost = np.abs(first + shift - before).sum(-1)
    alternative_cost = np.abs(alternative + alternative_shift - before).sum(-1)
    mirrored = np.stack([angles[..., 0] + 180.0, 180.0 - angles[..., 1], angles[..., 2] + 180.0], axis=-1)
    # The other triple must be nearer by a clear margin, so that equal costs leave numbers unchanged.
    return np.asarray(np.where((alternative_cost < cost - 1e-6)[:, None], mirrored + alternative_shift, angles + shift))


def _nearest_euler_angles(rotations: FloatArray, axes: str, before: FloatArray | None) -> FloatArray:
    """Convert ``rotations`` (S, K, 4) to angles (S, K, 3), degrees, each frame nearest to the one before it."""
    angles = rotation.to_euler(rotations, axes)
    sign = 1.0 if axes in ("XYZ", "YZX", "ZXY") else -1.0
    previous = None if before is None else np.deg2rad(before)
    if not (np.cos(angles[..., 1]) < _LOCKED).any():
        return np.rad2deg(rotation.nearest_euler_sequence(angles, previous))
    for frame in range(len(angles)):
        if previous is not None:
            a, b, c = angles[frame].T
            locked = np.cos(b) < _LOCKED
            if locked.any():  # only a +- c is fixed there: the first angle stays, the third takes the rest
                c = np.where(locked, c - sign * np.sign(b) * (previous[:, 0] - a), c)
                a = np.where(locked, previous[:, 0], a)
            angles[frame] = rotation.nearest_euler(np.stack([a, b, c], axis=-1), previous)
        previous = angles[frame]
    return np.rad2deg(angles)


def _encode_channels(
    clip: Clip, given: Channels, axes: Sequence[str], angles: FloatArray
) -> tuple[ChannelNames, FloatArray]:
    """Return names and values (T, C) of ``angles`` and positions in the layout of ``given``, with channels added if
    it cannot hold them.
    """
    names: list[tuple[str, ...]] = []
    curves: list[FloatArray] = []
    known_curves: list[FloatArray] = []
    nothing = np.full(len(clip), np.nan)
    for joint, (start, channels) in enumerate(zip(first_columns(given.names), given.names, strict=True)):
        position = _positions(clip, joint)
        wider: list[str] = []
        for axis, name in enumerate(POSITIONS):
            if name not in channels and np.any(position[:, axis] != given.offsets[joint, axis]):
                wider.append(name)
        n_axes = len(rotation_axes(channels))
        if n_axes < 3 and np.abs(angles[:, joint, n_axes:]).max() > _WIDEN_DEG:
            wider += [f"{letter}rotation" for letter in axes[joint][n_axes:]]
        names.append((*channels, *wider))
        curves += [_curve(name, axes[joint], angles[:, joint], position) for name in names[-1]]
        known_curves += [*given.values[:, start : start + len(channels)].T, *(nothing for _ in wider)]
    if not curves:
        return tuple(names), np.empty((len(clip), 0))
    return tuple(names), _round_new_values(np.stack(curves, axis=1), np.stack(known_curves, axis=1), names)


def _positions(clip: Clip, joint: int) -> FloatArray:
    """Return a joint's translation (T, 3) from its parent in every frame; for the root, its position in the world."""
    if joint == 0:
        return clip.root_positions
    if clip.translations is not None:
        return clip.translations[:, joint]
    return np.broadcast_to(clip.skeleton.offsets[joint], (len(clip), 3))


def _curve(name: str, axes: str, angles: FloatArray, position: FloatArray) -> FloatArray:
    """Return one channel's curve (T,): an angle of ``angles`` (T, 3), or a component of ``position`` (T, 3)."""
    return position[:, POSITIONS.index(name)] if name in POSITIONS else angles[:, axes.index(name[0].upper())]


def _round_new_values(curves: FloatArray, given: FloatArray, names: Sequence[Sequence[str]]) -> FloatArray:
    """Round curves (T, C) except the numbers that were given (T, C). A given angle counts only if its curve still has
    that value.
    """
    is_position = np.array([name in POSITIONS for channels in names for name in channels])
    stays = np.where(is_position, ~np.isnan(given), curves == given)
    return np.where(stays, given, np.round(curves, _DECIMALS))
