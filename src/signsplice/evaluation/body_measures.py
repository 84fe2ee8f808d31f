"""What a clip keeps on another body: contacts, places, directions and smoothness, each against the source."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from signsplice.body.capsules import BodyCapsules, BodyShape, shaped_capsules
from signsplice.body.collision import SkinPairs, forearm_pairs, near_pairs, pair_clearances, skin_pairs
from signsplice.body.contacts import PosedBody, posed_body
from signsplice.body.fit import NEAR_M
from signsplice.body.retarget import signing
from signsplice.motion import Clip, FloatArray
from signsplice.rig.info import rig_info
from signsplice.rig.roles import SIDES

Index = NDArray[np.intp]
Mask = NDArray[np.bool_]

TOUCH_M = 0.005
"""Skin distance at the source up to which a pair touches, and the error up to which it is kept, m."""
PRESS_M = 0.002
"""Depth that a touch may have, m: deeper ones at the source need not be as deep."""
APART_M, MADE_M = 0.015, 0.002
"""A contact is made where a pair is farther apart than the first at the source, and nearer than the second after, m."""
SIGNS = 0.99
"""Frames count for an arm that signs at least so much (``body.retarget.signing``)."""
HEAD_HEIGHT = 0.13
"""Height of a head of the usual size, fraction of stature."""
SIGNATURE = (
    f"touch:source<{1e3 * TOUCH_M:g}mm|kept:|after-max(source,-{1e3 * PRESS_M:g}mm)|<{1e3 * TOUCH_M:g}mm"
    f"|clear:source>-{1e3 * PRESS_M:g}mm"
    f"|made:source>{1e3 * APART_M:g}mm,after<{1e3 * MADE_M:g}mm|depth:beyond-source|frames:signing>{SIGNS:g}"
    f"|place:nearest-anchor<{1e3 * NEAR_M:g}mm-of-head-and-trunk,/{HEAD_HEIGHT:g}-stature-x-head"
    "|directions:palm-normal,index,degrees|smooth:wrists,peak-speed,rms-third-difference,/source"
)

_FINGERS = ("Thumb", "Index", "Middle", "Ring", "Little")
_ANCHORS = (*(f"{finger}Distal" for finger in _FINGERS), "IndexPalm", "LittlePalm", "Mitten")


@dataclass(frozen=True, eq=False)
class LostContact:
    """The touching pair of a clip that is farthest from its distance at the source; where there are clear ones, of
    those.

    word: name of the clip.
    frame: its frame there.
    pair: keys of the two capsules.
    before, after: skin distances, m.
    error: how far it is from kept, m.
    """

    word: str
    frame: int
    pair: str
    before: float
    after: float
    error: float


@dataclass(frozen=True, eq=False)
class BodyMeasurement:
    """One clip on another body.

    word: name of the clip.
    pair_errors: (K,) change of distance of every pair of capsules that touches at the source, m.
    clear: (K,) whether that pair lies no deeper than ``PRESS_M`` at the source: deeper ones are the source's own fault.
    frame_errors: (F,) the error of the nearest pair of each frame with a touch.
    n_signing: frames in which an arm signs.
    n_made: those with a contact that was not there.
    hand_depth, forearm_depth: greatest depth beyond the source's own, m.
    place_errors: (P,) distance of the anchor of a hand that is nearest to head or trunk from its place, head heights.
    palm_degrees, index_degrees: (D,) change of direction.
    peak_ratio, jerk_ratio: peak speed and RMS jerk of the wrists over the source's.
    arm_ratio: arm length over the source's.
    worst: the contact that is farthest from kept; None where nothing touches.
    """

    word: str
    pair_errors: FloatArray
    clear: Mask
    frame_errors: FloatArray
    n_signing: int
    n_made: int
    hand_depth: float
    forearm_depth: float
    place_errors: FloatArray
    palm_degrees: FloatArray
    index_degrees: FloatArray
    peak_ratio: float
    jerk_ratio: float
    arm_ratio: float
    worst: LostContact | None


class SourceClip:
    """A clip as it was signed, on a body of usual shape.

    clip: its motion. Raises ``InputError`` where its arms are not known by name.
    """

    def __init__(self, clip: Clip) -> None:
        self.clip = clip
        self.body = shaped_capsules(clip.skeleton, BodyShape())
        self.posed = posed_body(clip, self.body)
        self._signs = signing(clip) >= SIGNS
        self._pairs = _all_pairs(self.body, frozenset(self.body.keys))
        self._near = _near(self.posed, self._pairs, APART_M)
        self._smoothness = _smoothness(self.posed.wrists)

    def measure(self, made: Clip, body: BodyCapsules, head: float = 1.0) -> BodyMeasurement:
        """What ``made``, this clip on another body of the same rig, keeps; head: size of its head, 1 is the usual."""
        posed = posed_body(made, body)
        frames, k = np.divmod(np.union1d(self._near, _near(posed, self._pairs, APART_M)), len(self._pairs.own))
        own, other = self._pairs.own_side[k], self._pairs.other_side[k]
        signs = self._signs[frames, own] | ((other >= 0) & self._signs[frames, np.maximum(other, 0)])
        frames, k = frames[signs], k[signs]
        before, after = (
            pair_clearances(b.starts, b.ends, b.radii, self._pairs, frames, k).distance for b in (self.posed, posed)
        )
        is_hand = np.array([part != "cuff" for part in self.body.parts])[self._pairs.own[k]]
        deeper = np.maximum(np.maximum(-after, 0.0) - np.maximum(-before, 0.0), 0.0)
        errors = np.abs(after - np.maximum(before, -PRESS_M))
        touches = np.flatnonzero(is_hand & (before < TOUCH_M))
        new = is_hand & (before > APART_M) & (after < MADE_M)
        (peak, jerk), sizes = _smoothness(posed.wrists), rig_info(made.skeleton).sizes
        return BodyMeasurement(
            word=self.clip.name,
            pair_errors=errors[touches],
            clear=before[touches] >= -PRESS_M,
            frame_errors=errors[touches][_first_of_each(frames[touches], before[touches])],
            n_signing=int(self._signs.any(axis=1).sum()),
            n_made=len(np.unique(frames[new])),
            hand_depth=float(deeper[is_hand].max(initial=0.0)),
            forearm_depth=float(deeper[~is_hand].max(initial=0.0)),
            place_errors=self._place_errors(posed) / (HEAD_HEIGHT * head * (sizes.stature * sizes.unit.metres)),
            palm_degrees=self._turned(posed, _palm_normals),
            index_degrees=self._turned(posed, _index_directions),
            peak_ratio=peak / max(self._smoothness[0], 1e-9),
            jerk_ratio=jerk / max(self._smoothness[1], 1e-9),
            arm_ratio=float(np.mean(posed.arm_lengths) / np.mean(self.posed.arm_lengths)),
            worst=self._worst(frames, k, before, after, errors, touches),
        )

    def _worst(
        self, frames: Index, k: Index, before: FloatArray, after: FloatArray, errors: FloatArray, touches: Index
    ) -> LostContact | None:
        if not len(touches):
            return None
        clear = touches[before[touches] >= -PRESS_M]
        rows = clear if len(clear) else touches
        n = int(rows[errors[rows].argmax()])
        pair = f"{self.body.keys[self._pairs.own[k[n]]]} - {self.body.keys[self._pairs.other[k[n]]]}"
        return LostContact(self.clip.name, int(frames[n]), pair, float(before[n]), float(after[n]), float(errors[n]))

    def _place_errors(self, posed: PosedBody) -> FloatArray:
        """Distance (P,), m, of each hand's anchor that is nearest to head or trunk from the same place there: the same
        fraction along the capsule's axis, direction from it, and skin distance by the ratio of the hands.
        """
        body, found = self.body, [np.empty(0)]
        solid = np.array([*body.groups.head, *body.groups.trunk], np.intp)
        for side, name in enumerate(SIDES):
            rows = [
                n for n, key in enumerate(body.keys) if key.removeprefix(name) in _ANCHORS and body.sides[n] == name
            ]
            anchors = np.array(rows, np.intp)
            if not len(anchors) or not len(solid):
                continue
            a, start = self.posed.ends[:, anchors, None], self.posed.starts[:, None, solid]
            axis = self.posed.ends[:, None, solid] - start
            t = np.clip(((a - start) * axis).sum(-1) / ((axis * axis).sum(-1) + 1e-12), 0.0, 1.0)[..., None]
            out = a - start - t * axis
            away = np.linalg.norm(out, axis=-1) + 1e-9
            start_radii, end_radii = self.posed.radii[solid].T
            radii = start_radii + t[..., 0] * (end_radii - start_radii)
            clearance = away - radii - self.posed.radii[anchors, 1, None]
            at = clearance.reshape(len(clearance), -1).argmin(axis=1)
            near = np.flatnonzero((clearance.reshape(len(clearance), -1).min(axis=1) < NEAR_M) & self._signs[:, side])
            i, c = np.divmod(at[near], len(solid))
            fraction = t[near, i, c]
            start, end = posed.starts[near, solid[c]], posed.ends[near, solid[c]]
            radii = posed.radii[solid[c]]
            wanted = radii[:, 0] + fraction[:, 0] * (radii[:, 1] - radii[:, 0]) + posed.radii[anchors[i], 1]
            wanted = wanted + clearance[near, i, c] * posed.hand_length / self.posed.hand_length
            place = start + fraction * (end - start) + out[near, i, c] * (wanted / away[near, i, c])[:, None]
            found.append(np.linalg.norm(posed.ends[near, anchors[i]] - place, axis=-1))
        return np.concatenate(found)

    def _turned(self, posed: PosedBody, direction: Callable[[PosedBody, str], FloatArray | None]) -> FloatArray:
        """Degrees (D,) between a direction of the hands at the source and after, where they sign."""
        found = [np.empty(0)]
        for side, name in enumerate(SIDES):
            before, after = direction(self.posed, name), direction(posed, name)
            if before is None or after is None:
                continue
            sine, cosine = np.linalg.norm(np.cross(before, after), axis=-1), (before * after).sum(-1)
            found.append(np.degrees(np.arctan2(sine, cosine))[self._signs[:, side]])
        return np.concatenate(found)


def _all_pairs(body: BodyCapsules, keys: frozenset[str]) -> SkinPairs:
    """Pairs of hands, then those of forearms."""
    hands, forearms = skin_pairs(body, keys), forearm_pairs(body, keys)
    return SkinPairs(
        np.concatenate([hands.own, forearms.own]),
        np.concatenate([hands.other, forearms.other]),
        np.concatenate([hands.own_side, forearms.own_side]),
        np.concatenate([hands.other_side, forearms.other_side]),
        hands.blocks + forearms.blocks,
    )


def _near(posed: PosedBody, pairs: SkinPairs, margin: float) -> Index:
    """Frame times number of pairs plus pair (N,), of what may be nearer than ``margin``."""
    frames, k = near_pairs(posed.starts, posed.ends, posed.radii, pairs, margin)
    return np.asarray(frames * len(pairs.own) + k, np.intp)


def _first_of_each(frames: Index, distance: FloatArray) -> Index:
    """The row of the least distance of each frame."""
    order = np.lexsort((distance, frames))
    return np.asarray(order[np.unique(frames[order], return_index=True)[1]])


def _palm_normals(posed: PosedBody, side: str) -> FloatArray | None:
    """Normals (T, 3) of a palm; None without index and little finger."""
    keys = posed.body.keys
    if f"{side}IndexPalm" not in keys or f"{side}LittlePalm" not in keys:
        return None
    wrist = posed.wrists[:, SIDES.index(side)]
    index, little = (posed.ends[:, keys.index(f"{side}{finger}Palm")] - wrist for finger in ("Index", "Little"))
    return np.cross(index, little)


def _index_directions(posed: PosedBody, side: str) -> FloatArray | None:
    """Vectors (T, 3) from the knuckle to the tip of the index finger; None without it."""
    keys = posed.body.keys
    if f"{side}IndexPalm" not in keys or f"{side}IndexDistal" not in keys:
        return None
    return np.asarray(posed.ends[:, keys.index(f"{side}IndexDistal")] - posed.ends[:, keys.index(f"{side}IndexPalm")])


def _smoothness(wrists: FloatArray) -> tuple[float, float]:
    """Peak step and RMS third difference of wrists (T, 2, 3), m; 0 of clips that are too short."""
    step, third = np.diff(wrists, axis=0), np.diff(wrists, n=3, axis=0)
    peak = float(np.linalg.norm(step, axis=-1).max(initial=0.0))
    return peak, float(np.sqrt((third * third).sum(-1).mean())) if len(third) else 0.0
