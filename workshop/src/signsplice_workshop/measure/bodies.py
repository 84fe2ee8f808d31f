"""Words on bodies of other proportions: what rotations alone, and the fit, leave of contacts, places and smoothness.

The other bodies are the source's own rig with bones stretched and skin shaped anew, so that every place of the one has
its counterpart on the other. Some bodies and a third of the words are kept aside: no choice of the fit was made on
them, and they have rows of their own.
"""

from __future__ import annotations

import hashlib
import re
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from signsplice.body.capsules import BodyCapsules, BodyShape, build_capsules
from signsplice.body.collision import SkinPairs, forearm_pairs, near_pairs, pair_clearances, skin_pairs
from signsplice.body.contacts import PosedBody, pose_body
from signsplice.body.fit import NEAR_M
from signsplice.body.retarget import fit_body, signing
from signsplice.errors import InputError
from signsplice.lexicon import open_shipped_lexicon
from signsplice.motion import Clip, EndSite, FloatArray, Skeleton, kinematics, rotation
from signsplice.rig.align import Reference, copy_rotations, placement
from signsplice.rig.info import rig_info
from signsplice.rig.roles import SIDES
from signsplice.signer.signer import stream
from signsplice_workshop.measure.measures import Measure, Progress, Row, markdown_rows, row_of, track_progress


@dataclass(frozen=True)
class BodyProportions:
    """How a body differs from the source's; 1 for each is the same.

    shoulders: distance of the shoulders.
    arms: length of upper arms and forearms.
    hands: length of palms and fingers.
    trunk: height of the trunk and neck.
    shape: its skin.
    held_out: whether it is kept aside.
    """

    shoulders: float = 1.0
    arms: float = 1.0
    hands: float = 1.0
    trunk: float = 1.0
    shape: BodyShape = field(default_factory=BodyShape)
    held_out: bool = False

    @property
    def is_stretched(self) -> bool:
        """Whether its bones differ, not its skin alone."""
        return (self.shoulders, self.arms, self.hands, self.trunk) != (1.0, 1.0, 1.0, 1.0)


BODIES: Mapping[str, BodyProportions] = {
    "narrow": BodyProportions(shoulders=0.7, arms=0.85),
    "broad": BodyProportions(shoulders=1.4, arms=0.9, shape=BodyShape(trunk_width=1.3)),
    "child": BodyProportions(shoulders=0.8, arms=0.8, hands=0.9, shape=BodyShape(head=1.25)),
    "chibi": BodyProportions(shoulders=0.65, arms=0.8, shape=BodyShape(head=1.7)),
    "long arms": BodyProportions(shoulders=1.1, arms=1.2),
    "short arms": BodyProportions(arms=0.8),
    "small head": BodyProportions(shape=BodyShape(head=0.9)),
    "small hands": BodyProportions(hands=0.85, shape=BodyShape(hands=0.85)),
    "large hands": BodyProportions(hands=1.2, shape=BodyShape(hands=1.2)),
    "short trunk": BodyProportions(trunk=0.85),
    "belly": BodyProportions(shape=BodyShape(trunk_width=1.1, trunk_depth=1.3, limbs=1.1)),
    "thin": BodyProportions(shoulders=0.9, trunk=1.1, shape=BodyShape(trunk_width=0.8, trunk_depth=0.85, limbs=0.8)),
    "stout": BodyProportions(
        1.2, 0.9, 0.95, 0.95, BodyShape(trunk_width=1.2, trunk_depth=1.3, limbs=1.2, hands=1.1), held_out=True
    ),
    "youth": BodyProportions(0.85, 0.9, 0.95, 0.9, BodyShape(head=1.15, trunk_width=0.9), held_out=True),
    "lanky": BodyProportions(0.95, 1.15, 1.1, 1.15, BodyShape(head=0.95, trunk_depth=0.9, limbs=0.9), held_out=True),
}
"""Bodies by name; those with ``held_out`` are kept aside."""


def scale_bones(skeleton: Skeleton, body: BodyProportions) -> Skeleton:
    """The skeleton with its bones stretched, in the axes of the T-pose: shoulders sideways, trunk and neck upward,
    arms, palms and fingers along themselves. Raises ``InputError`` where its arms are not known by name.
    """
    info = rig_info(skeleton)
    joints, (left, _, _, right) = info.roles.joints, info.arm_joints[:4]
    factors = np.ones((len(skeleton), 3))
    chest = kinematics.common_ancestor(skeleton, [left, right])
    neck = joints.get("neck", joints.get("head", chest))
    factors[_path(skeleton, joints.get("hips", 0), neck), 1] *= body.trunk
    fingers: set[int] = set()
    for side in SIDES:
        arm, wrist = joints[f"{side}UpperArm"], joints[f"{side}Hand"]
        factors[_path(skeleton, chest, arm), 0] *= body.shoulders
        factors[_path(skeleton, arm, wrist)] *= body.arms
        hand = kinematics.subtree(skeleton, wrist)
        factors[hand[1:]] *= body.hands
        fingers |= set(hand)
    offsets, changed = np.array(skeleton.offsets), np.flatnonzero((factors != 1.0).any(axis=1))
    above = info.t_pose.rotations[skeleton.parents[changed]]
    upright = factors[changed] * rotation.rotate(above, offsets[changed])
    offsets[changed] = rotation.rotate(rotation.inverse(above), upright)
    sites = [EndSite(s.joint, s.offset * (body.hands if s.joint in fingers else 1.0)) for s in skeleton.end_sites]
    return Skeleton(skeleton.names, skeleton.parents, offsets, tuple(sites), skeleton.roles)


def _path(skeleton: Skeleton, above: int, joint: int) -> list[int]:
    """The joints from below ``above`` down to ``joint``."""
    way = kinematics.path_to_root(skeleton, joint)
    return way[: way.index(above)] if above in way else []


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
        self.body = build_capsules(clip.skeleton, BodyShape())
        self.posed = pose_body(clip, self.body)
        self._signs = signing(clip) >= SIGNS
        self._pairs = _all_pairs(self.body, frozenset(self.body.keys))
        self._near = _near(self.posed, self._pairs, APART_M)
        self._smoothness = _smoothness(self.posed.wrists)

    def measure(self, made: Clip, body: BodyCapsules, head: float = 1.0) -> BodyMeasurement:
        """What ``made``, this clip on another body of the same rig, keeps; head: size of its head, 1 is the usual."""
        posed = pose_body(made, body)
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
            palm_degrees=self._direction_angles(posed, _palm_normals),
            index_degrees=self._direction_angles(posed, _index_directions),
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

    def _direction_angles(
        self, posed: PosedBody, direction: Callable[[PosedBody, str], FloatArray | None]
    ) -> FloatArray:
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


ROTATIONS, FITTED = "rotations", "fitted"
_TIMED_FRAMES = 150


TUNED_ON = frozenset(
    (
        *("NAME", "MY", "MOTHER", "FATHER", "THINK", "THANK-YOU", "PLEASE", "EAT", "DRINK"),
        *("DEAF", "KNOW", "FAMILY", "SCHOOL", "STOP", "PAPER", "COFFEE", "HELP"),
    )
)
"""Words on which weights and thresholds of the fit were chosen."""


@dataclass(frozen=True, eq=False)
class _Made:
    """A word on a body by one method: its measurement, shortfall in m, processor time in s, the same of rotations alone
    where bones differ, and the frames.
    """

    measured: BodyMeasurement
    shortfall: float
    seconds: float
    plain_seconds: float | None
    n_frames: int


def _mean(values: NDArray[np.bool_]) -> float | None:
    return float(np.mean(values)) if len(values) else None


def _quantile(values: FloatArray, fraction: float) -> float | None:
    return float(np.quantile(values, fraction)) if len(values) else None


def _all(field: str, words: Sequence[_Made]) -> FloatArray:
    """The values of all words, one after another."""
    return np.concatenate([np.atleast_1d(getattr(word.measured, field)) for word in words])


def _quantile_of(field: str, fraction: float) -> Callable[[Sequence[_Made]], float | None]:
    return lambda words: _quantile(_all(field, words), fraction)


def _contact_fraction(field: str) -> Callable[[Sequence[_Made]], float | None]:
    """Fraction of errors that are less than ``TOUCH_M``."""
    return lambda words: _mean(_all(field, words) < TOUCH_M)


def _clear_contact_fraction(words: Sequence[_Made]) -> float | None:
    return _mean(_all("pair_errors", words)[_all("clear", words).astype(bool)] < TOUCH_M)


def _ratio(field: str, statistic: Callable[[FloatArray], float]) -> Callable[[Sequence[_Made]], float]:
    return lambda words: float(statistic(_all(field, words)))


def _by_arm(field: str, statistic: Callable[[FloatArray], float]) -> Callable[[Sequence[_Made]], float]:
    return lambda words: float(statistic(_all(field, words) / _all("arm_ratio", words)))


def _most(field: str) -> Callable[[Sequence[_Made]], float]:
    return lambda words: max(getattr(word.measured, field) for word in words)


def _new_contact_fraction(words: Sequence[_Made]) -> float | None:
    n_signing = sum(word.measured.n_signing for word in words)
    return sum(word.measured.n_made for word in words) / n_signing if n_signing else None


def _milliseconds(words: Sequence[_Made]) -> float:
    return 1e3 * _TIMED_FRAMES * sum(word.seconds for word in words) / sum(word.n_frames for word in words)


def _time_ratio(words: Sequence[_Made]) -> float | None:
    ratios = [word.seconds / max(word.plain_seconds, 1e-9) for word in words if word.plain_seconds is not None]
    return _quantile(np.array(ratios), 0.5)


def _worst(words: Sequence[_Made]) -> LostContact | None:
    lost = [word.measured.worst for word in words if word.measured.worst is not None]
    return max(lost, key=lambda one: one.error, default=None)


MEASURES = (
    Measure("body", "body"),
    Measure("method", "method"),
    Measure("held_out"),
    Measure("n_words", function=len),
    Measure("n_touching", function=lambda words: len(_all("frame_errors", words))),
    Measure("kept_frames", "frames kept", "{:.1f}", 100.0, _contact_fraction("frame_errors")),
    Measure("kept_pairs", "pairs kept", "{:.1f}", 100.0, _contact_fraction("pair_errors")),
    Measure("kept_clear", "clear pairs kept", "{:.1f}", 100.0, _clear_contact_fraction),
    Measure("clear", function=lambda words: _mean(_all("clear", words).astype(bool))),
    Measure("error_p95", "p95, mm", "{:.1f}", 1e3, _quantile_of("pair_errors", 0.95)),
    Measure("made", "made", "{:.1f}", 100.0, _new_contact_fraction),
    Measure("hand_depth", "hand deeper, mm", "{:.1f}", 1e3, _most("hand_depth")),
    Measure("forearm_depth", "forearm deeper, mm", "{:.1f}", 1e3, _most("forearm_depth")),
    Measure("place_median", "place, % of head", "{:.1f}", 100.0, _quantile_of("place_errors", 0.5)),
    Measure("place_p95", "place, % of head", " ({:.0f})", 100.0, _quantile_of("place_errors", 0.95)),
    Measure("palm_degrees", "palm, °", "{:.1f}", None, _quantile_of("palm_degrees", 0.5)),
    Measure("index_degrees", "index, °", "{:.1f}", None, _quantile_of("index_degrees", 0.5)),
    Measure("peak_median", function=_ratio("peak_ratio", np.median)),
    Measure("peak_worst", function=_ratio("peak_ratio", np.max)),
    Measure("jerk_median", function=_ratio("jerk_ratio", np.median)),
    Measure("jerk_worst", function=_ratio("jerk_ratio", np.max)),
    Measure("peak_by_arm_median", "peak", "{:.2f}", None, _by_arm("peak_ratio", np.median)),
    Measure("peak_by_arm_worst", "peak", " ({:.2f})", None, _by_arm("peak_ratio", np.max)),
    Measure("jerk_by_arm_median", "jerk", "{:.2f}", None, _by_arm("jerk_ratio", np.median)),
    Measure("jerk_by_arm_worst", "jerk", " ({:.2f})", None, _by_arm("jerk_ratio", np.max)),
    Measure("shortfall", "short, cm", "{:.0f}", 100.0, lambda words: max(word.shortfall for word in words)),
    Measure("milliseconds", "ms", "{:.1f}", None, _milliseconds),
    Measure("time_ratio", "times", "{:.1f}", None, _time_ratio),
    Measure("worst", function=_worst),
)
"""Of a method on a body over words: whether body and words are kept aside; frames with a touch; fraction of touching
frames (nearest pair), of touching pairs, and of those that do not lie deep in the body at the source already
(``clear``: their fraction) that are kept; change of touching pairs' distance, m; fraction of the signing frames with a
contact that was not there; greatest depth beyond the source's own, m; error of the place of the anchor nearest to head
or trunk, head heights; median change of direction, degrees; ratios to the source, median and greatest word, also
divided by the ratio of arm lengths; greatest distance of a hand from its place that a warning names, m; processor time
for 150 frames, and over that of rotations alone, None where skeletons are the same; the contact that is farthest from
kept.
"""


def is_kept_aside(gloss: str) -> bool:
    """Whether a word is kept aside: a third of all, by the hash of their names, but none that choices were made on."""
    return gloss not in TUNED_ON and hashlib.sha256(gloss.encode()).digest()[0] % 3 == 0


def draw_words(n_words: int) -> tuple[list[Clip], list[Clip]]:
    """``n_words`` different words that ship, letters apart: two thirds that are not kept aside, and one third that is;
    the same number always gives the same words. Raises ``InputError`` for fewer than 3 or more than there are.
    """
    words = open_shipped_lexicon()
    names = [entry.gloss for entry in words.entries() if entry.kind == "sign"]
    aside = [name for name in names if is_kept_aside(name)]
    usual = [name for name in names if not is_kept_aside(name)]
    n_aside = n_words // 3
    if n_words < 3 or n_aside > len(aside) or n_words - n_aside > len(usual):
        raise InputError(f"{n_words} words, expected 3 to {min(3 * len(aside), 3 * len(usual) // 2)}")
    rng = stream("bodies", n_words)
    usual = rng.choice(usual, n_words - n_aside, replace=False).tolist()
    aside = rng.choice(aside, n_aside, replace=False).tolist()
    return [words.clip(name) for name in usual], [words.clip(name) for name in aside]


def signature(n_words: int | None = None) -> str:
    """The recipe of the numbers; n_words: of words drawn, None for captures."""
    drawn = "captures" if n_words is None else f"everyday,drawn:{n_words},kept-aside:sha256%3"
    return f"bodies|words:{drawn}|{SIGNATURE}|time:process,per-{_TIMED_FRAMES}-frames,in-turns"


def compare(
    words: Sequence[Clip],
    aside: Sequence[Clip],
    bodies: Mapping[str, BodyProportions] = BODIES,
    progress: Progress | None = None,
) -> list[Row]:
    """Two rows for each body, rotations alone and fitted: bodies that are not kept aside with ``words``, the others
    with ``aside``. Raises ``InputError`` for a clip whose arms are not known by name.
    """
    sources = {False: [SourceClip(clip) for clip in words], True: [SourceClip(clip) for clip in aside]}
    rows: list[Row] = []
    for name, body in track_progress(bodies.items(), progress):
        if sources[body.held_out]:
            rows += _rows(name, body, sources[body.held_out])
    return rows


def _rows(name: str, body: BodyProportions, sources: Sequence[SourceClip]) -> list[Row]:
    skeletons: dict[int, Skeleton] = {}
    made: dict[str, list[_Made]] = {ROTATIONS: [], FITTED: []}
    for source in sources:
        skeleton = source.clip.skeleton
        if id(skeleton) not in skeletons:
            skeletons[id(skeleton)] = scale_bones(skeleton, body)
        plain, fitted = _both(source, skeletons[id(skeleton)], body)
        made[ROTATIONS].append(plain)
        made[FITTED].append(fitted)
    return [row_of(MEASURES, words, body=name, method=method, held_out=body.held_out) for method, words in made.items()]


def _both(source: SourceClip, skeleton: Skeleton, on: BodyProportions) -> tuple[_Made, _Made]:
    """A word with rotations alone, and fitted: each timed from the same start, with nothing kept of the clip."""
    clip, body = source.clip, build_capsules(skeleton, on.shape)
    to = Reference(skeleton, clip.fps, placement(clip), clip.local_rotations[0], "the body")
    copy_rotations(clip[:1], to)  # what is kept of both rigs belongs to neither time
    clip.derived.clear()
    start = time.process_time()
    carried = copy_rotations(clip, to)[0]
    plain = time.process_time() - start
    clip.derived.clear()
    start = time.process_time()
    again = copy_rotations(clip, to)[0]
    result = fit_body(clip, source.body, again, body)
    fitted = time.process_time() - start
    short = max([0.0, *(0.01 * float(cm) for line in result.warnings for cm in re.findall(r"(\d+) cm", line))])
    compared = plain if on.is_stretched else None
    return (
        _Made(source.measure(carried, body, on.shape.head), 0.0, plain, compared, len(clip)),
        _Made(source.measure(result.clip, body, on.shape.head), short, fitted, compared, len(clip)),
    )


def table(rows: Sequence[Row], n_words: int | None = None) -> list[str]:
    """The rows as Markdown, those kept aside in a table of their own, with their signature."""
    out = [f"`{signature(n_words)}`"]
    for held_out in (False, True):
        part = [row for row in rows if row.held_out == held_out]
        if part:
            what = "Bodies kept aside" if held_out else "Other bodies"
            which = "" if n_words is None else " that are kept aside too" if held_out else " that are not kept aside"
            caption = f"{what}: {part[0].n_words} clips{which}, {part[0].n_touching} touching frames."
            out += ["", *markdown_rows(MEASURES, part), "", caption]
    return out
