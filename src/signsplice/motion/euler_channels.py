"""Euler channels: the numbers an animator sees, beside the rotations they stand for.

A file's Euler numbers hold more than its rotations do: whole turns, which of two equal triples was meant, decimals. A
clip therefore carries them along, frame by frame, and ``curves`` gives them back untouched where a frame is still the
one that was read.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from signsplice.errors import InputError
from signsplice.motion import rotation
from signsplice.motion.arrays import FloatArray

Names = tuple[tuple[str, ...], ...]

_BLOCK = 4096
"""Frames that are converted at a time, to keep the memory of intermediate results small."""
POSITIONS = ("Xposition", "Yposition", "Zposition")
ROTATIONS = ("Xrotation", "Yrotation", "Zrotation")


@dataclass(frozen=True, eq=False)
class Channels:
    """The channels of a clip as a file gave them.

    names: for each joint its channels in the file's order ("Zrotation", ...). values: (T, C) degrees and length units,
    C all channels in order; NaN where no file gave the number. offsets: (J, 3) the rest translations as written, which
    position channels replace. frame_time: seconds a frame as written. starts: frames at which numbers of another origin
    begin. root_moved: the root was moved since the file was read, so its numbers no longer hold.
    """

    names: Names
    values: FloatArray
    offsets: FloatArray
    frame_time: float
    starts: tuple[int, ...] = (0,)
    root_moved: bool = False

    def __post_init__(self) -> None:
        width = sum(map(len, self.names))
        if self.values.ndim != 2 or self.values.shape[1] != width:
            raise InputError(f"channel values {self.values.shape}, expected (T, {width})")
        for field in ("values", "offsets"):
            view = np.asarray(getattr(self, field), np.float64).view()
            view.flags.writeable = False
            object.__setattr__(self, field, view)
        if self.offsets.shape[1:] != (3,) or not 0.0 <= self.frame_time < np.inf:
            raise InputError(f"channel offsets {self.offsets.shape} at {self.frame_time} s a frame, expected (J, 3)")

    def __getitem__(self, frames: slice) -> Channels:
        start, stop, _ = frames.indices(len(self.values))
        inner = tuple(s - start for s in self.starts if start < s < stop)
        return replace(self, values=self.values[start:stop], starts=(0, *inner))

    def forgotten(self, n_frames: int) -> Channels:
        """The same layout for ``n_frames`` new frames, every number still to be derived. Takes no memory."""
        values = np.broadcast_to(np.nan, (n_frames, self.values.shape[1]))
        return replace(self, values=values, starts=(0,), root_moved=False)

    def without_root(self) -> Channels:
        """The same numbers, save those of the root, which are to be derived anew. Takes no memory."""
        return replace(self, root_moved=True)

    def settled(self) -> Channels:
        """The same, with the root's numbers set to NaN in ``values`` where it was moved."""
        if not self.root_moved:
            return self
        values = np.array(self.values)
        values[:, : len(self.names[0])] = np.nan
        return replace(self, values=values, root_moved=False)

    @staticmethod
    def concatenate(parts: Sequence[tuple[Channels | None, int]]) -> Channels | None:
        """Channels of clips joined in time, each given with its number of frames; the layout is the first one's.

        Numbers of a part whose layout differs from the first one's are left to be derived. None where the first has
        none.
        """
        layout = parts[0][0]
        if layout is None:
            return None
        width = layout.values.shape[1]
        values = np.empty((sum(n for _, n in parts), width))
        starts: list[int] = []
        row = 0
        for channels, n_frames in parts:
            if channels is not None and (channels.names is layout.names or channels.names == layout.names):
                values[row : row + n_frames] = channels.values
                if channels.root_moved:
                    values[row : row + n_frames, : len(layout.names[0])] = np.nan
                starts += [row + s for s in channels.starts]
            else:
                values[row : row + n_frames] = np.nan
                starts.append(row)
            row += n_frames
        return replace(layout, values=values, starts=tuple(starts), root_moved=False)


def default_names(n_joints: int) -> Names:
    """Channels for a clip that no file gave any: XYZ position and ZXY rotation on the root, ZXY rotation elsewhere."""
    rotations = ("Zrotation", "Xrotation", "Yrotation")
    return ((*POSITIONS, *rotations), *([rotations] * (n_joints - 1)))


def rotation_axes(names: Sequence[str]) -> str:
    """The letters of a joint's rotation channels in order: ("Zrotation", "Xrotation") -> "ZX"."""
    return "".join(name[0].upper() for name in names if name.endswith("rotation"))


def first_columns(names: Names) -> list[int]:
    """Column (J,) at which each joint's channels begin."""
    ends = np.cumsum([0, *map(len, names)])
    return [int(c) for c in ends[:-1]]


def to_motion(names: Names, values: FloatArray, offsets: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Local rotations (T, J, 4) and translations (T, J, 3) that channel ``values`` (T, C) stand for.

    A position channel replaces its component of the offset (rejected: adding to it, which puts 6-channel files far
    off). Rotations are the product of the channels in their order, intrinsic.
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
