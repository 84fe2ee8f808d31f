"""Contacts of a clip as events: from when to when a hand touches head, trunk, arm or the other hand, and how near the
same two are on another body.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from signsplice.body.capsules import BodyCapsules
from signsplice.body.clearance import Near, SkinPairs
from signsplice.motion.arrays import FloatArray
from signsplice.rig.naming import SIDES

TOUCH_M, PART_M = 0.005, 0.012
"""A contact begins where skins are nearer than the first and ends where they are farther apart than the second, m."""
KEPT_M = 0.005
"""A contact is kept where its distance changes by less than this, m."""
PRESS_M = 0.002
"""Pressing deeper than this, m, need not be kept: skin gives, capsules do not."""
REGIONS = ("head", "neck", "trunk", "arm", "hand")
"""What a hand touches; the last two are those of the other side."""
_SHORTEST, _HOLE = 2, 3
"""Frames that a contact lasts at least; and gaps between two contacts that count as none."""


@dataclass(frozen=True)
class Contact:
    """A contact of one hand.

    hand: "left" or "right"; "right" where both hands meet.
    region: one of ``REGIONS``.
    frames: first frame and end, half-open, of the clip before it was placed or resampled.
    before_mm, after_mm: median skin distance at the source and on the other body, mm; negative inside.
    is_kept: whether that is the same within ``KEPT_M``; where it lies deep at the source, it may lie less deep.
    """

    hand: str
    region: str
    frames: tuple[int, int]
    before_mm: float
    after_mm: float
    is_kept: bool


def find_contacts(
    body: BodyCapsules, pairs: SkinPairs, near: Near, after: FloatArray, n_frames: int
) -> tuple[Contact, ...]:
    """The contacts of a clip of ``n_frames``, in order.

    near: all pairs that are nearer than ``PART_M`` at the source; after: (N,) their distances on the other body, m.
    """
    frames, k, before = near.frames, near.k, near.distance
    region = np.array([_region(body, row) for row in range(len(body.keys))], np.intp)[pairs.other[k]]
    side = np.where(region == REGIONS.index("hand"), 1, pairs.own_side[k])
    tables = np.full((2, n_frames, 2, len(REGIONS)), np.inf)
    for table, distance in zip(tables, (before, after), strict=True):
        np.minimum.at(table, (frames, side, region), distance)
    found = []
    for n_hand, hand in enumerate(SIDES):
        for n, name in enumerate(REGIONS):
            for start, stop in _events(tables[0, :, n_hand, n]):
                then, now = (_median(table[start:stop, n_hand, n]) for table in tables)
                is_kept = then - KEPT_M < now < max(then, -PRESS_M) + KEPT_M
                found.append(Contact(hand, name, (start, stop), round(1e3 * then, 1), round(1e3 * now, 1), is_kept))
    return tuple(sorted(found, key=lambda one: one.frames))


def _median(distance: FloatArray) -> float:
    return float(np.median(distance[np.isfinite(distance)]))


def _region(body: BodyCapsules, row: int) -> int:
    if body.sides[row]:
        return REGIONS.index("arm" if body.parts[row] in ("sleeve", "cuff") else "hand")
    return REGIONS.index({"shirt": "trunk", "neck": "neck"}.get(body.parts[row], "head"))


def _events(distance: FloatArray) -> list[tuple[int, int]]:
    """Half-open ranges of frames in which a distance (T,) is that of a contact."""
    touching = np.zeros(len(distance), bool)
    is_touching = False
    for frame, value in enumerate(distance.tolist()):
        is_touching = value < (PART_M if is_touching else TOUCH_M)
        touching[frame] = is_touching
    edges = np.flatnonzero(np.diff(np.r_[False, touching, False].astype(int))).tolist()
    events: list[tuple[int, int]] = []
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        if events and start - events[-1][1] <= _HOLE:
            events[-1] = (events[-1][0], stop)
        else:
            events.append((start, stop))
    return [(start, stop) for start, stop in events if stop - start >= _SHORTEST]
