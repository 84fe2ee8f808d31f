"""Contacts of a clip as events: from when to when a hand touches head, trunk, arm or the other hand, and how near the
same two are on another body.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from signsplice.body.capsules import BodyCapsules
from signsplice.body.touch import SkinPairs, near_pairs, pair_gaps

Float = NDArray[np.float64]

TOUCH_M, PART_M = 0.005, 0.012
"""A contact begins where skins are nearer than the first and ends where they are farther apart than the second, m."""
KEPT_M = 0.005
"""A contact is kept where its distance changes by less than this, m."""
_SHORTEST, _HOLE = 2, 3
"""Frames that a contact lasts at least; and gaps between two contacts that count as none."""
_PRESS_M = 0.002
_FAR_M = 0.10
"""Distances are known up to this one, m."""


@dataclass(frozen=True)
class Contact:
    """A contact of one hand.

    hand: "left" or "right".
    region: what it touches: "head", "neck", "trunk", "arm" (the other one) or "hand" (the other one).
    frames: first frame and end, half-open.
    before_mm, after_mm: median skin distance at the source and on the other body, mm; negative inside.
    is_kept: whether that is the same within ``KEPT_M``; pressing deeper at the source than 2 mm need not be kept.
    """

    hand: str
    region: str
    frames: tuple[int, int]
    before_mm: float
    after_mm: float
    is_kept: bool


REGIONS = ("head", "neck", "trunk", "arm", "hand")


def region_distances(starts: Float, ends: Float, radii: Float, body: BodyCapsules, pairs: SkinPairs) -> Float:
    """Least skin distance (T, 2, 5) of the left and the right hand from each of ``REGIONS``, m; at most 0.1."""
    frames, k = near_pairs(starts, ends, radii, pairs, _FAR_M)
    distance = pair_gaps(starts, ends, radii, pairs, frames, k).distance
    region = np.array([_region(body, row) for row in pairs.other], np.intp)[k]
    out = np.full((len(starts), 2, len(REGIONS)), _FAR_M)
    np.minimum.at(out, (frames, pairs.own_side[k], region), distance)
    hands = out[:, :, REGIONS.index("hand")]
    hands[:] = hands.min(axis=1, keepdims=True)  # two hands that touch both do
    return out


def _region(body: BodyCapsules, row: int) -> int:
    if body.sides[row]:
        return REGIONS.index("arm" if body.parts[row] in ("sleeve", "cuff") else "hand")
    return REGIONS.index({"shirt": "trunk", "neck": "neck"}.get(body.parts[row], "head"))


def contacts(before: Float, after: Float) -> tuple[Contact, ...]:
    """The contacts in distances (T, 2, 5) at the source, and what became of them in those on the other body."""
    found = []
    for side, hand in enumerate(("left", "right")):
        for n, region in enumerate(REGIONS):
            if region == "hand" and side == 0:
                continue  # the right hand's
            for start, stop in _events(before[:, side, n]):
                then, now = (float(np.median(x[start:stop, side, n])) for x in (before, after))
                is_kept = abs(now - max(then, -_PRESS_M)) < KEPT_M
                found.append(Contact(hand, region, (start, stop), 1e3 * then, 1e3 * now, is_kept))
    return tuple(sorted(found, key=lambda one: one.frames))


def _events(distance: Float) -> list[tuple[int, int]]:
    """Half-open ranges of frames in which a distance (T,) is that of a contact."""
    touching = np.zeros(len(distance), bool)
    now = False
    for frame, value in enumerate(distance):
        now = value < (PART_M if now else TOUCH_M)
        touching[frame] = now
    edges = np.flatnonzero(np.diff(np.r_[False, touching, False].astype(int)))
    events: list[tuple[int, int]] = []
    for start, stop in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        if events and start - events[-1][1] <= _HOLE:
            events[-1] = (events[-1][0], stop)
        else:
            events.append((start, stop))
    return [(start, stop) for start, stop in events if stop - start >= _SHORTEST]
