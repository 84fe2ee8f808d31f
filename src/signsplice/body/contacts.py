"""A body over time: capsules and arms in every frame of a clip, and the contacts of its hands."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from signsplice.body.capsules import BodyCapsules, capsule_ends
from signsplice.body.collision import Near, SkinPairs
from signsplice.motion import Clip, FloatArray, kinematics
from signsplice.rig.info import rig_info
from signsplice.rig.roles import SIDES

_LEG = ("leg", "shoe")


@dataclass(frozen=True, eq=False)
class PosedBody:
    """A body over time, in metres.

    body: its capsules.
    starts, ends: (T, C, 3) of their axes in the world.
    radii: (C, 2).
    shoulders, wrists: (T, 2, 3) left and right.
    arm_lengths: (2,) upper arm and forearm together.
    """

    body: BodyCapsules
    starts: FloatArray
    ends: FloatArray
    radii: FloatArray
    shoulders: FloatArray
    wrists: FloatArray
    arm_lengths: FloatArray

    @property
    def palm_length(self) -> float:
        """The median length of the palms' capsules in the first frame, m."""
        palms = [n for n, part in enumerate(self.body.parts) if part == "palm"]
        return float(np.median(np.linalg.norm(self.ends[0, palms] - self.starts[0, palms], axis=-1)))

    def with_arms(self, elbows: FloatArray, wrists: FloatArray) -> PosedBody:
        """Returns the body with these elbows and wrists (T, 2, 3); hands keep their rotations."""
        starts, ends, moves = self.starts.copy(), self.ends.copy(), wrists - self.wrists
        for n, (part, side) in enumerate(zip(self.body.parts, self.body.sides, strict=True)):
            if not side or part in _LEG:
                continue
            arm = SIDES.index(side)
            if part == "sleeve":
                ends[:, n] = elbows[:, arm]
            elif part == "cuff":
                starts[:, n], ends[:, n] = elbows[:, arm], wrists[:, arm]
            else:
                starts[:, n] += moves[:, arm]
                ends[:, n] += moves[:, arm]
        return replace(self, starts=starts, ends=ends, wrists=wrists)


def pose_body(clip: Clip, body: BodyCapsules) -> PosedBody:
    """Returns a clip's body over time, in metres."""
    info = rig_info(clip.skeleton)
    metres = info.sizes.unit.metres
    rotations, positions = kinematics.forward(clip)
    starts, ends = capsule_ends(body, rotations, positions)
    joints = info.arm_joints
    shoulders, elbows, wrists = (metres * positions[:, [joints[k], joints[3 + k]]] for k in range(3))
    lengths = np.linalg.norm(elbows[0] - shoulders[0], axis=-1) + np.linalg.norm(wrists[0] - elbows[0], axis=-1)
    return PosedBody(body, metres * starts, metres * ends, metres * body.radii, shoulders, wrists, lengths)


TOUCH_M = 0.005
"""A contact begins when skins come nearer than this, m."""
SEPARATION_M = 0.012
"""A contact ends when skins are farther apart than this, m."""
KEPT_M = 0.005
"""A contact is kept if its distance changes by less than this, m."""
PRESS_M = 0.002
"""A contact deeper than this at the source may become as shallow as this, m: skin gives, capsules do not."""
REGIONS = ("head", "neck", "trunk", "arm", "hand")
"""Regions that a hand touches; the last two are of the other side."""
_SHORTEST = 2
"""Least duration of a contact, frames."""
_HOLE = 3
"""Longest gap that does not separate two contacts, frames."""


@dataclass(frozen=True)
class Contact:
    """A contact of one hand.

    hand: "left" or "right"; "right" if both hands meet.
    region: one of ``REGIONS``.
    frames: first frame and end, half-open, in the clip before placement and resampling.
    before_mm, after_mm: median skin distance at the source and on the other body, mm; negative inside. ``after_mm`` is
        None if it was not measured, since an avatar has no skin there that can be read.
    is_kept: whether both distances agree within ``KEPT_M``; a contact deep at the source may become less deep. None if
        it was not measured.
    """

    hand: str
    region: str
    frames: tuple[int, int]
    before_mm: float
    after_mm: float | None
    is_kept: bool | None


def count_kept(contacts: Sequence[Contact], body: BodyCapsules) -> str:
    """Returns how many contacts on a body are kept, and how many were not measured, for a message."""
    if body.guessed_regions.issuperset(REGIONS):
        return "contacts not measured"
    measured = [contact.is_kept for contact in contacts if contact.is_kept is not None]
    more = f", {len(contacts) - len(measured)} not measured" if len(measured) < len(contacts) else ""
    return f"{sum(measured)} of {len(measured)} contacts kept{more}"


def find_contacts(
    body: BodyCapsules,
    pairs: SkinPairs,
    near: Near,
    after: FloatArray,
    n_frames: int,
    guessed_regions: Collection[str] = (),
) -> tuple[Contact, ...]:
    """Returns the contacts of a clip of ``n_frames``, in order.

    near: all pairs nearer than ``SEPARATION_M`` at the source.
    after: (N,) their distances on the other body, m.
    guessed_regions: those of the other body whose contacts are not measured.
    """
    frames, k, before = near.frames, near.k, near.distance
    region = np.array([_region(body, row) for row in range(len(body.keys))], np.intp)[pairs.other[k]]
    side = np.where(region == REGIONS.index("hand"), 1, pairs.own_side[k])
    tables = np.full((2, n_frames, 2, len(REGIONS)), np.inf)
    for table, distance in zip(tables, (before, after), strict=True):
        np.minimum.at(table, (frames, side, region), distance)
    contacts = []
    for n_hand, hand in enumerate(SIDES):
        for n, name in enumerate(REGIONS):
            for start, stop in _events(tables[0, :, n_hand, n]):
                was, now = (_median(table[start:stop, n_hand, n]) for table in tables)
                is_kept = was - KEPT_M < now < max(was, -PRESS_M) + KEPT_M
                found = Contact(hand, name, (start, stop), round(1e3 * was, 1), round(1e3 * now, 1), is_kept)
                contacts.append(replace(found, after_mm=None, is_kept=None) if name in guessed_regions else found)
    return tuple(sorted(contacts, key=lambda contact: contact.frames))


def _median(distance: FloatArray) -> float:
    return float(np.median(distance[np.isfinite(distance)]))


def _region(body: BodyCapsules, row: int) -> int:
    if body.sides[row]:
        return REGIONS.index("arm" if body.parts[row] in ("sleeve", "cuff") else "hand")
    return REGIONS.index({"shirt": "trunk", "neck": "neck"}.get(body.parts[row], "head"))


def _events(distance: FloatArray) -> list[tuple[int, int]]:
    """Returns half-open ranges of frames in which a distance (T,) is that of a contact."""
    touching = np.zeros(len(distance), bool)
    is_touching = False
    for frame, value in enumerate(distance.tolist()):
        is_touching = value < (SEPARATION_M if is_touching else TOUCH_M)
        touching[frame] = is_touching
    edges = np.flatnonzero(np.diff(np.r_[False, touching, False].astype(int))).tolist()
    events: list[tuple[int, int]] = []
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        if events and start - events[-1][1] <= _HOLE:
            events[-1] = (events[-1][0], stop)
        else:
            events.append((start, stop))
    return [(start, stop) for start, stop in events if stop - start >= _SHORTEST]
