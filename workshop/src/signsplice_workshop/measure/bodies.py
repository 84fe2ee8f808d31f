"""Measures words on bodies of other proportions: what copied rotations and the fit keep of contacts, places and
smoothness.

The other bodies are the source's own rig with stretched bones and new skin, so that every place of the source has its
counterpart on them. Some bodies and a third of the words are held out: no choice of the fit was made on them, and they
have rows of their own.
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
from signsplice.body.fit import WRISTS
from signsplice.body.retarget import fit_body, signing
from signsplice.errors import InputError
from signsplice.lexicon import open_shipped_lexicon
from signsplice.motion import Clip, EndSite, FloatArray, Skeleton, kinematics, rotation
from signsplice.rig.align import Reference, copy_rotations, placement
from signsplice.rig.info import rig_info
from signsplice.rig.roles import SIDES
from signsplice.signer.signer import stream
from signsplice_workshop.measure.measures import Measure, Progress, Row, format_measures, make_row, track_progress


@dataclass(frozen=True)
class BodyProportions:
    """Sizes of a body as factors of the source's.

    shoulders: distance of the shoulders.
    arms: length of upper arms and forearms.
    hands: length of palms and fingers.
    trunk: height of the trunk and neck.
    shape: shape of the skin.
    held_out: whether choices of the fit ignored this body.
    """

    shoulders: float = 1.0
    arms: float = 1.0
    hands: float = 1.0
    trunk: float = 1.0
    shape: BodyShape = field(default_factory=BodyShape)
    held_out: bool = False

    @property
    def is_stretched(self) -> bool:
        """Whether its bones differ from the source's, not its skin alone."""
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
"""Bodies by name; no choice of the fit was made on those with ``held_out``."""


def scale_bones(skeleton: Skeleton, body: BodyProportions) -> Skeleton:
    """Returns the skeleton with stretched bones, in the axes of the T-pose: shoulders sideways, trunk and neck upward,
    arms, palms and fingers along themselves. Raises ``InputError`` if its arms are not known by name.
    """
    info = rig_info(skeleton)
    joints, (left, _, _, right) = info.roles.joints, info.arm_joints[:4]
    factors = np.ones((len(skeleton), 3))
    chest = kinematics.common_ancestor(skeleton, [left, right])
    neck = joints.get("neck", joints.get("head", chest))
    factors[_joints_between(skeleton, joints.get("hips", 0), neck), 1] *= body.trunk
    fingers: set[int] = set()
    for side in SIDES:
        arm, wrist = joints[f"{side}UpperArm"], joints[f"{side}Hand"]
        factors[_joints_between(skeleton, chest, arm), 0] *= body.shoulders
        factors[_joints_between(skeleton, arm, wrist)] *= body.arms
        hand = kinematics.subtree(skeleton, wrist)
        factors[hand[1:]] *= body.hands
        fingers |= set(hand)
    offsets, changed = np.array(skeleton.offsets), np.flatnonzero((factors != 1.0).any(axis=1))
    parent_rotations = info.t_pose.rotations[skeleton.parents[changed]]
    t_pose_offsets = factors[changed] * rotation.rotate(parent_rotations, offsets[changed])
    offsets[changed] = rotation.rotate(rotation.inverse(parent_rotations), t_pose_offsets)
    sites = [
        EndSite(site.joint, site.offset * (body.hands if site.joint in fingers else 1.0)) for site in skeleton.end_sites
    ]
    return Skeleton(skeleton.names, skeleton.parents, offsets, tuple(sites), skeleton.roles)


def _joints_between(skeleton: Skeleton, ancestor: int, joint: int) -> list[int]:
    """Returns the joints from below ``ancestor`` down to ``joint``."""
    path = kinematics.path_to_root(skeleton, joint)
    return path[: path.index(ancestor)] if ancestor in path else []


Index = NDArray[np.intp]
Mask = NDArray[np.bool_]

TOUCH_M = 0.005
"""Largest skin distance of a touching pair at the source, and largest error of a contact that is kept, m."""
PRESS_M = 0.002
"""Largest depth that a touch has to keep, m: a deeper touch at the source counts as this deep."""
SEPARATE_M, NEW_CONTACT_M = 0.015, 0.002
"""A contact is new if its pair is farther apart than the first at the source, and nearer than the second after, m."""
SIGNS = 0.99
"""Least activity of an arm in a frame that counts (``body.retarget.signing``)."""
HEAD_HEIGHT = 0.13
"""Height of a head of the usual size, as a fraction of stature."""
SIGNATURE = (
    f"touch:source<{1e3 * TOUCH_M:g}mm|kept:|after-max(source,-{1e3 * PRESS_M:g}mm)|<{1e3 * TOUCH_M:g}mm"
    f"|clear:source>-{1e3 * PRESS_M:g}mm"
    f"|made:source>{1e3 * SEPARATE_M:g}mm,after<{1e3 * NEW_CONTACT_M:g}mm|depth:beyond-source|frames:signing>{SIGNS:g}"
    f"|place:nearest-anchor<{1e3 * WRISTS.anchor_fade_m:g}mm-of-head-and-trunk,/{HEAD_HEIGHT:g}-stature-x-head"
    "|directions:palm-normal,index,degrees|smooth:wrists,peak-speed,rms-third-difference,/source"
)

_FINGERS = ("Thumb", "Index", "Middle", "Ring", "Little")
_ANCHORS = (*(f"{finger}Distal" for finger in _FINGERS), "IndexPalm", "LittlePalm", "Mitten")


@dataclass(frozen=True, eq=False)
class LostContact:
    """The touching pair of a clip with the greatest change from its source distance; of clear pairs if it has any.

    word: name of the clip.
    frame: frame of the clip.
    pair: keys of the two capsules.
    before, after: skin distances, m.
    error: change of the distance, m.
    """

    word: str
    frame: int
    pair: str
    before: float
    after: float
    error: float


@dataclass(frozen=True, eq=False)
class BodyMeasurement:
    """Measurement of one clip on another body.

    word: name of the clip.
    pair_errors: (K,) change of distance of every pair of capsules that touches at the source, m.
    clear: (K,) whether that pair lies no deeper than ``PRESS_M`` at the source: deeper ones are the source's own fault.
    frame_errors: (F,) the error of the nearest pair of each frame with a touch, m.
    n_signing: number of frames in which an arm signs.
    n_made: number of these with a contact that the source lacks.
    hand_depth, forearm_depth: greatest depth beyond the source's own, m.
    place_errors: (P,) distance of a hand's anchor nearest to head or trunk from its place, head heights.
    palm_degrees, index_degrees: (D,) change of direction, degrees.
    peak_ratio, jerk_ratio: peak speed and RMS jerk of the wrists over the source's.
    arm_ratio: arm length over the source's.
    worst: the contact with the greatest change; None if nothing touches.
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

    clip: the motion. Raises ``InputError`` if its arms are not known by name.
    """

    def __init__(self, clip: Clip) -> None:
        self.clip = clip
        self.body = build_capsules(clip.skeleton, BodyShape())
        self.posed = pose_body(clip, self.body)
        self._signs = signing(clip) >= SIGNS
        self._pairs = _hand_and_forearm_pairs(self.body, frozenset(self.body.keys))
        self._near_pairs = _find_near_pairs(self.posed, self._pairs, SEPARATE_M)
        self._smoothness = _smoothness(self.posed.wrists)

    def measure(self, retargeted: Clip, body: BodyCapsules, head: float = 1.0) -> BodyMeasurement:
        """Measures what ``retargeted``, this clip on another body of the same rig, keeps. ``head``: size of its head, 1
        is the usual.
        """
        posed = pose_body(retargeted, body)
        frames, k = np.divmod(
            np.union1d(self._near_pairs, _find_near_pairs(posed, self._pairs, SEPARATE_M)), len(self._pairs.own)
        )
        own_side, other_side = self._pairs.own_side[k], self._pairs.other_side[k]
        signs = self._signs[frames, own_side] | ((other_side >= 0) & self._signs[frames, np.maximum(other_side, 0)])
        frames, k = frames[signs], k[signs]
        before, after = (
            pair_clearances(body_pose.starts, body_pose.ends, body_pose.radii, self._pairs, frames, k).distance
            for body_pose in (self.posed, posed)
        )
        is_hand = np.array([part != "cuff" for part in self.body.parts])[self._pairs.own[k]]
        deeper = np.maximum(np.maximum(-after, 0.0) - np.maximum(-before, 0.0), 0.0)
        errors = np.abs(after - np.maximum(before, -PRESS_M))
        touches = np.flatnonzero(is_hand & (before < TOUCH_M))
        is_new = is_hand & (before > SEPARATE_M) & (after < NEW_CONTACT_M)
        (peak, jerk), sizes = _smoothness(posed.wrists), rig_info(retargeted.skeleton).sizes
        return BodyMeasurement(
            word=self.clip.name,
            pair_errors=errors[touches],
            clear=before[touches] >= -PRESS_M,
            frame_errors=errors[touches][_find_nearest_rows(frames[touches], before[touches])],
            n_signing=int(self._signs.any(axis=1).sum()),
            n_made=len(np.unique(frames[is_new])),
            hand_depth=float(deeper[is_hand].max(initial=0.0)),
            forearm_depth=float(deeper[~is_hand].max(initial=0.0)),
            place_errors=self._place_errors(posed) / (HEAD_HEIGHT * head * (sizes.stature * sizes.unit.metres)),
            palm_degrees=self._direction_angles(posed, _palm_normals),
            index_degrees=self._direction_angles(posed, _index_directions),
            peak_ratio=peak / max(self._smoothness[0], 1e-9),
            jerk_ratio=jerk / max(self._smoothness[1], 1e-9),
            arm_ratio=float(np.mean(posed.arm_lengths) / np.mean(self.posed.arm_lengths)),
            worst=self._find_worst_contact(frames, k, before, after, errors, touches),
        )

    def _find_worst_contact(
        self, frames: Index, k: Index, before: FloatArray, after: FloatArray, errors: FloatArray, touches: Index
    ) -> LostContact | None:
        if not len(touches):
            return None
        clear = touches[before[touches] >= -PRESS_M]
        candidates = clear if len(clear) else touches
        row = int(candidates[errors[candidates].argmax()])
        pair = f"{self.body.keys[self._pairs.own[k[row]]]} - {self.body.keys[self._pairs.other[k[row]]]}"
        return LostContact(
            self.clip.name, int(frames[row]), pair, float(before[row]), float(after[row]), float(errors[row])
        )

    def _place_errors(self, posed: PosedBody) -> FloatArray:
        """Returns the distance (P,), m, of each hand's anchor nearest to head or trunk from the same place on the body:
        the same fraction along the capsule's axis, direction from it, and skin distance scaled by the ratio of the
        hands.
        """
        body, errors = self.body, [np.empty(0)]
        solid = np.array([*body.groups.head, *body.groups.trunk], np.intp)
        for side, name in enumerate(SIDES):
            anchor_rows = [
                n for n, key in enumerate(body.keys) if key.removeprefix(name) in _ANCHORS and body.sides[n] == name
            ]
            anchors = np.array(anchor_rows, np.intp)
            if not len(anchors) or not len(solid):
                continue
            anchor_ends, start = self.posed.ends[:, anchors, None], self.posed.starts[:, None, solid]
            axis = self.posed.ends[:, None, solid] - start
            fractions = np.clip(((anchor_ends - start) * axis).sum(-1) / ((axis * axis).sum(-1) + 1e-12), 0.0, 1.0)[
                ..., None
            ]
            offsets = anchor_ends - start - fractions * axis
            distances = np.linalg.norm(offsets, axis=-1) + 1e-9
            start_radii, end_radii = self.posed.radii[solid].T
            radii = start_radii + fractions[..., 0] * (end_radii - start_radii)
            clearance = distances - radii - self.posed.radii[anchors, 1, None]
            flat_clearance = clearance.reshape(len(clearance), -1)
            nearest = flat_clearance.argmin(axis=1)
            frames = np.flatnonzero((flat_clearance.min(axis=1) < WRISTS.anchor_fade_m) & self._signs[:, side])
            i, c = np.divmod(nearest[frames], len(solid))
            fraction = fractions[frames, i, c]
            start, end = posed.starts[frames, solid[c]], posed.ends[frames, solid[c]]
            radii = posed.radii[solid[c]]
            target_distance = radii[:, 0] + fraction[:, 0] * (radii[:, 1] - radii[:, 0]) + posed.radii[anchors[i], 1]
            target_distance = target_distance + clearance[frames, i, c] * posed.palm_length / self.posed.palm_length
            target = (
                start
                + fraction * (end - start)
                + offsets[frames, i, c] * (target_distance / distances[frames, i, c])[:, None]
            )
            errors.append(np.linalg.norm(posed.ends[frames, anchors[i]] - target, axis=-1))
        return np.concatenate(errors)

    def _direction_angles(
        self, posed: PosedBody, direction: Callable[[PosedBody, str], FloatArray | None]
    ) -> FloatArray:
        """Returns the angles (D,), degrees, between a direction of the hands at the source and on the body, where they
        sign.
        """
        angles = [np.empty(0)]
        for side, name in enumerate(SIDES):
            before, after = direction(self.posed, name), direction(posed, name)
            if before is None or after is None:
                continue
            sine, cosine = np.linalg.norm(np.cross(before, after), axis=-1), (before * after).sum(-1)
            angles.append(np.degrees(np.arctan2(sine, cosine))[self._signs[:, side]])
        return np.concatenate(angles)


def _hand_and_forearm_pairs(body: BodyCapsules, keys: frozenset[str]) -> SkinPairs:
    """Returns the pairs of hands, then those of forearms."""
    hands, forearms = skin_pairs(body, keys), forearm_pairs(body, keys)
    return SkinPairs(
        np.concatenate([hands.own, forearms.own]),
        np.concatenate([hands.other, forearms.other]),
        np.concatenate([hands.own_side, forearms.own_side]),
        np.concatenate([hands.other_side, forearms.other_side]),
        hands.blocks + forearms.blocks,
    )


def _find_near_pairs(posed: PosedBody, pairs: SkinPairs, margin: float) -> Index:
    """Returns frame times number of pairs plus pair (N,), of the pairs that may be nearer than ``margin``."""
    frames, k = near_pairs(posed.starts, posed.ends, posed.radii, pairs, margin)
    return np.asarray(frames * len(pairs.own) + k, np.intp)


def _find_nearest_rows(frames: Index, distance: FloatArray) -> Index:
    """Returns the row of the least distance in each frame."""
    order = np.lexsort((distance, frames))
    return np.asarray(order[np.unique(frames[order], return_index=True)[1]])


def _palm_normals(posed: PosedBody, side: str) -> FloatArray | None:
    """Returns the normals (T, 3) of a palm; None without index and little finger."""
    keys = posed.body.keys
    if f"{side}IndexPalm" not in keys or f"{side}LittlePalm" not in keys:
        return None
    wrist = posed.wrists[:, SIDES.index(side)]
    index, little = (posed.ends[:, keys.index(f"{side}{finger}Palm")] - wrist for finger in ("Index", "Little"))
    return np.cross(index, little)


def _index_directions(posed: PosedBody, side: str) -> FloatArray | None:
    """Returns the vectors (T, 3) from the knuckle to the tip of the index finger; None without it."""
    keys = posed.body.keys
    if f"{side}IndexPalm" not in keys or f"{side}IndexDistal" not in keys:
        return None
    return np.asarray(posed.ends[:, keys.index(f"{side}IndexDistal")] - posed.ends[:, keys.index(f"{side}IndexPalm")])


def _smoothness(wrists: FloatArray) -> tuple[float, float]:
    """Returns the peak step and the RMS third difference of wrists (T, 2, 3), m; 0 for a clip that is too short."""
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
class _TransferredWord:
    """A word on a body by one method: its measurement, shortfall in m, processor time in s, the processor time of
    copied rotations alone if bones differ, and number of frames.
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


def _concatenate_field(field: str, words: Sequence[_TransferredWord]) -> FloatArray:
    """Returns the values of a field of all words, one word after another."""
    return np.concatenate([np.atleast_1d(getattr(word.measured, field)) for word in words])


def _quantile_of(field: str, fraction: float) -> Callable[[Sequence[_TransferredWord]], float | None]:
    return lambda words: _quantile(_concatenate_field(field, words), fraction)


def _contact_fraction(field: str) -> Callable[[Sequence[_TransferredWord]], float | None]:
    """Returns a function that gives the fraction of errors that are less than ``TOUCH_M``."""
    return lambda words: _mean(_concatenate_field(field, words) < TOUCH_M)


def _clear_contact_fraction(words: Sequence[_TransferredWord]) -> float | None:
    return _mean(_concatenate_field("pair_errors", words)[_concatenate_field("clear", words).astype(bool)] < TOUCH_M)


def _statistic_of(
    field: str, statistic: Callable[[FloatArray], float]
) -> Callable[[Sequence[_TransferredWord]], float]:
    return lambda words: float(statistic(_concatenate_field(field, words)))


def _statistic_by_arm(
    field: str, statistic: Callable[[FloatArray], float]
) -> Callable[[Sequence[_TransferredWord]], float]:
    return lambda words: float(statistic(_concatenate_field(field, words) / _concatenate_field("arm_ratio", words)))


def _maximum_of(field: str) -> Callable[[Sequence[_TransferredWord]], float]:
    return lambda words: max(getattr(word.measured, field) for word in words)


def _new_contact_fraction(words: Sequence[_TransferredWord]) -> float | None:
    n_signing = sum(word.measured.n_signing for word in words)
    return sum(word.measured.n_made for word in words) / n_signing if n_signing else None


def _milliseconds(words: Sequence[_TransferredWord]) -> float:
    return 1e3 * _TIMED_FRAMES * sum(word.seconds for word in words) / sum(word.n_frames for word in words)


def _time_ratio(words: Sequence[_TransferredWord]) -> float | None:
    ratios = [word.seconds / max(word.plain_seconds, 1e-9) for word in words if word.plain_seconds is not None]
    return _quantile(np.array(ratios), 0.5)


def _worst_contact(words: Sequence[_TransferredWord]) -> LostContact | None:
    lost_contacts = [word.measured.worst for word in words if word.measured.worst is not None]
    return max(lost_contacts, key=lambda contact: contact.error, default=None)


MEASURES = (
    Measure("body", "body"),
    Measure("method", "method"),
    Measure("held_out"),
    Measure("n_words", function=len),
    Measure("n_touching", function=lambda words: len(_concatenate_field("frame_errors", words))),
    Measure("kept_frames", "frames kept", "{:.1f}", 100.0, _contact_fraction("frame_errors")),
    Measure("kept_pairs", "pairs kept", "{:.1f}", 100.0, _contact_fraction("pair_errors")),
    Measure("kept_clear", "clear pairs kept", "{:.1f}", 100.0, _clear_contact_fraction),
    Measure("clear", function=lambda words: _mean(_concatenate_field("clear", words).astype(bool))),
    Measure("error_p95", "p95, mm", "{:.1f}", 1e3, _quantile_of("pair_errors", 0.95)),
    Measure("made", "made", "{:.1f}", 100.0, _new_contact_fraction),
    Measure("hand_depth", "hand deeper, mm", "{:.1f}", 1e3, _maximum_of("hand_depth")),
    Measure("forearm_depth", "forearm deeper, mm", "{:.1f}", 1e3, _maximum_of("forearm_depth")),
    Measure("place_median", "place, % of head", "{:.1f}", 100.0, _quantile_of("place_errors", 0.5)),
    Measure("place_p95", "place, % of head", " ({:.0f})", 100.0, _quantile_of("place_errors", 0.95)),
    Measure("palm_degrees", "palm, °", "{:.1f}", None, _quantile_of("palm_degrees", 0.5)),
    Measure("index_degrees", "index, °", "{:.1f}", None, _quantile_of("index_degrees", 0.5)),
    Measure("peak_median", function=_statistic_of("peak_ratio", np.median)),
    Measure("peak_worst", function=_statistic_of("peak_ratio", np.max)),
    Measure("jerk_median", function=_statistic_of("jerk_ratio", np.median)),
    Measure("jerk_worst", function=_statistic_of("jerk_ratio", np.max)),
    Measure("peak_by_arm_median", "peak", "{:.2f}", None, _statistic_by_arm("peak_ratio", np.median)),
    Measure("peak_by_arm_worst", "peak", " ({:.2f})", None, _statistic_by_arm("peak_ratio", np.max)),
    Measure("jerk_by_arm_median", "jerk", "{:.2f}", None, _statistic_by_arm("jerk_ratio", np.median)),
    Measure("jerk_by_arm_worst", "jerk", " ({:.2f})", None, _statistic_by_arm("jerk_ratio", np.max)),
    Measure("shortfall", "short, cm", "{:.0f}", 100.0, lambda words: max(word.shortfall for word in words)),
    Measure("milliseconds", "ms", "{:.1f}", None, _milliseconds),
    Measure("time_ratio", "times", "{:.1f}", None, _time_ratio),
    Measure("worst", function=_worst_contact),
)
"""Measures of a method on a body over words: whether body and words are held out; frames with a touch; fraction of
touching frames (nearest pair), of touching pairs, and of clear pairs that are kept (clear pairs do not lie deep in
the body at the source; ``clear``: their fraction); change of touching pairs' distance, m; fraction of the signing
frames with a contact that the source lacks; greatest depth beyond the source's own, m; error of the place of the
anchor nearest to head or trunk, head heights; median change of direction, degrees; ratios to the source, median and
greatest word, also divided by the ratio of arm lengths; greatest distance of a hand from its place that a warning
names, m; processor time for 150 frames, and over that of copied rotations alone, None if skeletons are the same; the
contact with the greatest change.
"""


def is_held_out(gloss: str) -> bool:
    """Whether a word is held out: a third of all, by the hash of their names, but none that choices were made on."""
    return gloss not in TUNED_ON and hashlib.sha256(gloss.encode()).digest()[0] % 3 == 0


def draw_words(n_words: int) -> tuple[list[Clip], list[Clip]]:
    """Returns ``n_words`` different words that ship, letters excluded: two thirds that are not held out, and one third
    that is; the same number always gives the same words. Raises ``InputError`` for fewer than 3 or more than there
    are.
    """
    lexicon = open_shipped_lexicon()
    names = [entry.gloss for entry in lexicon.entries() if entry.kind == "sign"]
    held_out_words = [name for name in names if is_held_out(name)]
    other_words = [name for name in names if not is_held_out(name)]
    n_held_out = n_words // 3
    if n_words < 3 or n_held_out > len(held_out_words) or n_words - n_held_out > len(other_words):
        raise InputError(f"{n_words} words, expected 3 to {min(3 * len(held_out_words), 3 * len(other_words) // 2)}")
    rng = stream("bodies", n_words)
    other_words = rng.choice(other_words, n_words - n_held_out, replace=False).tolist()
    held_out_words = rng.choice(held_out_words, n_held_out, replace=False).tolist()
    return [lexicon.clip(name) for name in other_words], [lexicon.clip(name) for name in held_out_words]


def signature(n_words: int | None = None) -> str:
    """Returns the recipe of the numbers. ``n_words``: number of words drawn, None for captures."""
    drawn = "captures" if n_words is None else f"everyday,drawn:{n_words},kept-aside:sha256%3"
    return f"bodies|words:{drawn}|{SIGNATURE}|time:process,per-{_TIMED_FRAMES}-frames,in-turns"


def compare(
    words: Sequence[Clip],
    held_out_words: Sequence[Clip],
    bodies: Mapping[str, BodyProportions] = BODIES,
    progress: Progress | None = None,
) -> list[Row]:
    """Returns two rows for each body, copied rotations alone and fitted: bodies that are not held out with ``words``,
    held-out bodies with ``held_out_words``. Raises ``InputError`` for a clip whose arms are not known by name.
    """
    sources = {False: [SourceClip(clip) for clip in words], True: [SourceClip(clip) for clip in held_out_words]}
    rows: list[Row] = []
    for name, body in track_progress(bodies.items(), progress):
        if sources[body.held_out]:
            rows += _measure_body(name, body, sources[body.held_out])
    return rows


def _measure_body(name: str, body: BodyProportions, sources: Sequence[SourceClip]) -> list[Row]:
    skeletons: dict[int, Skeleton] = {}
    results: dict[str, list[_TransferredWord]] = {ROTATIONS: [], FITTED: []}
    for source in sources:
        skeleton = source.clip.skeleton
        if id(skeleton) not in skeletons:
            skeletons[id(skeleton)] = scale_bones(skeleton, body)
        plain, fitted = _transfer(source, skeletons[id(skeleton)], body)
        results[ROTATIONS].append(plain)
        results[FITTED].append(fitted)
    return [
        make_row(MEASURES, words, body=name, method=method, held_out=body.held_out) for method, words in results.items()
    ]


def _transfer(
    source: SourceClip, skeleton: Skeleton, proportions: BodyProportions
) -> tuple[_TransferredWord, _TransferredWord]:
    """Returns a word with copied rotations alone, and fitted: each timed from the same start, with no cached values of
    the clip.
    """
    clip, body = source.clip, build_capsules(skeleton, proportions.shape)
    reference = Reference(skeleton, clip.fps, placement(clip), clip.local_rotations[0], "the body")
    copy_rotations(clip[:1], reference)  # neither time includes the cached values of both rigs
    clip.derived.clear()
    start = time.process_time()
    copied = copy_rotations(clip, reference)[0]
    copy_seconds = time.process_time() - start
    clip.derived.clear()
    start = time.process_time()
    fit_start = copy_rotations(clip, reference)[0]
    result = fit_body(clip, source.body, fit_start, body)
    fit_seconds = time.process_time() - start
    shortfall = max([0.0, *(0.01 * float(cm) for line in result.warnings for cm in re.findall(r"(\d+) cm", line))])
    plain_seconds = copy_seconds if proportions.is_stretched else None
    return (
        _TransferredWord(
            source.measure(copied, body, proportions.shape.head), 0.0, copy_seconds, plain_seconds, len(clip)
        ),
        _TransferredWord(
            source.measure(result.clip, body, proportions.shape.head), shortfall, fit_seconds, plain_seconds, len(clip)
        ),
    )


def table(rows: Sequence[Row], n_words: int | None = None) -> list[str]:
    """Returns the rows as Markdown with their signature; held-out bodies have a table of their own."""
    lines = [f"`{signature(n_words)}`"]
    for held_out in (False, True):
        group = [row for row in rows if row.held_out == held_out]
        if group:
            subject = "Bodies kept aside" if held_out else "Other bodies"
            restriction = (
                "" if n_words is None else " that are kept aside too" if held_out else " that are not kept aside"
            )
            caption = f"{subject}: {group[0].n_words} clips{restriction}, {group[0].n_touching} touching frames."
            lines += ["", *format_measures(MEASURES, group), "", caption]
    return lines
