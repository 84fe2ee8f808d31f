"""Clips of one skeleton laid end to end: what is computed frame by frame is computed for all of them at once.

Every frame gets the same numbers, bit for bit, as in its own clip: its own arithmetic does not change, only how many
frames share an operation.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from signsplice.motion.clip import Clip, bone_translations, unchecked_copy

MOST_FRAMES = 1500
"""Frames that are laid end to end: more do not fit into a processor's nearest memory, and are no faster."""


@dataclass(frozen=True, eq=False)
class JoinedClips:
    """Some clips, one after another.

    rows: which of the clips asked for.
    clip: all of their frames.
    starts: (G + 1,) the first frame of each of the G clips, and the number of all frames.
    """

    rows: list[int]
    clip: Clip
    starts: NDArray[np.intp]

    def __iter__(self) -> Iterator[tuple[int, slice]]:
        """Which clip, and its frames."""
        for row, start, stop in zip(self.rows, self.starts[:-1].tolist(), self.starts[1:].tolist(), strict=True):
            yield row, slice(start, stop)


def joined(clips: Sequence[Sequence[Clip]], most: int = MOST_FRAMES) -> Iterator[JoinedClips]:
    """Clips, each given as its parts in order, laid end to end with those of the same skeleton and rate, about ``most``
    frames at a time; the channels of files and faces are left out.
    """
    groups: dict[tuple[int, float, bool], list[int]] = {}
    for row, parts in enumerate(clips):
        moving = any(part.translations is not None for part in parts)
        groups.setdefault((id(parts[0].skeleton), parts[0].fps, moving), []).append(row)
    for (_, _, moving), rows in groups.items():
        lengths = [sum(len(part.local_rotations) for part in clips[row]) for row in rows]
        first = n_frames = 0
        for k, length in enumerate(lengths):
            if n_frames and n_frames + length > most:
                yield _joined(clips, rows[first:k], lengths[first:k], moving)
                first, n_frames = k, 0
            n_frames += length
        yield _joined(clips, rows[first:], lengths[first:], moving)


def _joined(clips: Sequence[Sequence[Clip]], rows: list[int], lengths: list[int], moving: bool) -> JoinedClips:
    parts = [part for row in rows for part in clips[row]]
    whole = unchecked_copy(
        parts[0],
        local_rotations=np.concatenate([part.local_rotations for part in parts]),
        root_positions=np.concatenate([part.root_positions for part in parts]),
        translations=np.concatenate([bone_translations(part) for part in parts]) if moving else None,
        channels=None,
        face=None,
    )
    return JoinedClips(rows, whole, np.concatenate([[0], np.cumsum(lengths)]).astype(np.intp))
