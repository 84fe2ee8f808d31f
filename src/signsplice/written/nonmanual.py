"""The nonmanual part of a written sign: parsed from SiGML into tiers, and rendered as a face, gestures of head and
trunk, and shoulders, timed with the hands.

Our own tables (words/faces.txt) define the codes. Lanes run in parallel; the items of a lane share the time of the
hands (Elliott et al. 2004), those of a mouthing in proportion to their sounds.

Mouthing: phonemes in SAMPA -> visemes -> a mouth over time. Phonemes are never guessed from spelling. The table follows
the places of articulation in the IPA and the symbols of SAMPA (Wells 1997; X-SAMPA for the rest): sounds that look
alike share a viseme (Fisher 1968, "Confusions among visually perceived consonants"). A mouthing spans its sign (Boyes
Braem and Sutton-Spence 2001, "The Hands are the Head of the Mouth"): the sounds are stretched over it.

Lifted, hunched or shrugged shoulders are turned in the clip, and the arms are bent again so that the hands stay. The
written shoulders add to the planner's shoulders, which follow the hands.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate

import numpy as np

from signsplice.body import collision
from signsplice.errors import InputError
from signsplice.motion import Clip, FloatArray, rotation
from signsplice.motion.face import ARKIT_CHANNELS, MOUTH, VISEMES, Face
from signsplice.signer.body_motion import gesture_level
from signsplice.signer.phonology import Gesture
from signsplice.signer.signer import ARM_JOINTS, JOINTS
from signsplice.signer.tables import sections, to_vector
from signsplice.written.reading import Element, Reading, factor
from signsplice.written.tree import Tier, WrittenSign


@dataclass(frozen=True)
class FaceTiming:
    """Times of mouths and faces of written signs."""

    sounds_per_s: float = 6.7
    """Phonemes a second without a sign."""
    most_sounds_per_s: float = 11.0
    """Highest rate of a mouthing, sounds a second; a longer mouthing continues while the hands go down."""
    blended_fraction: float = 0.5
    """Fraction of a sound's time that blends its shape into the next, on each side of their border: the next sound
    shows before it is heard (Cohen and Massaro 1993).
    """
    item_sounds: float = 3.0
    """Length of an item other than a mouthing, sounds."""
    mouth_ramp_s: float = 0.08
    """Half the duration of the mouth's blend from or to rest, centred on the border of an item, seconds."""
    face_ramp_s: float = 0.2
    """Half the duration of the blend of other parts of the face, seconds."""
    face_lead_s: float = 0.15
    """Time that brows, lids and gaze last beyond the hands, before and after, seconds."""
    least_face_s: float = 0.3
    """Least duration of a face, seconds."""
    end_item_s: float = 0.28
    """Duration of items at the end of a sign, such as a blink, seconds."""


@dataclass(frozen=True)
class ShoulderLimits:
    """Limits of written movements of shoulders."""

    turn_fractions: tuple[float, ...] = (1.0, 0.5, 0.25)
    """Fractions of the written shoulder turn, tried in this order until the hands are clear of the body."""
    hand_depth_cm: float = 0.4
    """Allowed depth of a hand in the body, cm."""
    arm_reach: float = 0.995
    """Longest reach of an arm, as a fraction of its bones; beyond it the hand moves with the shoulder."""


TIMING = FaceTiming()
_SHOULDERS = ShoulderLimits()

_SOUNDS_OF = {
    "PP": "p b m", "FF": "f v", "TH": "T D", "DD": "t d l 5 L", "kk": "k g N x h C G ? c X q",
    "CH": "S Z tS dZ", "SS": "s z", "nn": "n J", "RR": "r R 4", "aa": "a A { V a: A:", "E": "e E @ 3 e: E: 3:",
    "I": "i I j i:",
    "O": "o O Q 9 2 o: O: 2: 9:", "U": "u U y Y w H u: y:",
}  # fmt: skip
SOUNDS = {
    **{sound: (viseme,) for viseme, sounds in _SOUNDS_OF.items() for sound in sounds.split()},
    "ts": ("DD", "SS"), "dz": ("DD", "SS"), "aI": ("aa", "I"), "eI": ("E", "I"), "OI": ("O", "I"), "OY": ("O", "I"),
    "aU": ("aa", "U"), "@U": ("E", "U"), "oU": ("O", "U"), "I@": ("I", "E"), "e@": ("E", "E"), "U@": ("U", "E"),
}  # fmt: skip
"""SAMPA -> its visemes in order."""
_SIGNS = re.compile("|".join(re.escape(sound) for sound in sorted(SOUNDS, key=len, reverse=True)))
_NO_SOUND = re.compile(r"[\s.\"%'_|:~-]+")
"""Separators of syllables and words, and marks of stress, length and nasal sounds."""
_SHAPE_LENGTHS = {1: 1.0, 2: 0.75}
"""Number of shapes of a sound -> length of each."""


def visemes(sampa: str) -> list[list[str]]:
    """The visemes of each sound of a SAMPA text. Raises ``InputError`` if a symbol is unknown or there is no sound."""
    sounds, position = list[list[str]](), 0
    while position < len(sampa):
        if between := _NO_SOUND.match(sampa, position):
            position = between.end()
            continue
        sound = _SIGNS.match(sampa, position)
        if sound is None:
            known = " ".join(SOUNDS)
            raise InputError(f"mouth {sampa[:60]!r}: {sampa[position]!r} is no sound of SAMPA that is known: {known}")
        sounds.append(list(SOUNDS[sound[0]]))
        position = sound.end()
    if not sounds:
        raise InputError(f"mouth {sampa[:60]!r} has no sound, expected phonemes in SAMPA such as h @ l @U")
    return sounds


def shapes(sampa: str) -> list[tuple[str, float]]:
    """Each viseme of a SAMPA text with its length in sounds. Raises as ``visemes`` does."""
    return [(name, _SHAPE_LENGTHS[len(sound)]) for sound in visemes(sampa) for name in sound]


def mouthing(sampa: str, fps: float, seconds: float | None = None) -> Face:
    """Returns a mouth that speaks a SAMPA text, from closed to closed; by default at ``TIMING.sounds_per_s``."""
    timed_visemes = [("sil", 0.5), *shapes(sampa), ("sil", 0.5)]
    lengths = np.array([length for _, length in timed_visemes])  # sounds
    channels = tuple(name for name in ARKIT_CHANNELS if any(name in VISEMES[shape] for shape, _ in timed_visemes))
    targets = np.array([[VISEMES[shape].get(name, 0.0) for name in channels] for shape, _ in timed_visemes])  # (S, C)
    seconds = lengths.sum() / TIMING.sounds_per_s if seconds is None else seconds
    n_frames = max(2, round(seconds * fps))
    positions = np.linspace(0.0, lengths.sum(), n_frames)  # (T,)
    return Face(channels, np.clip(blend_targets(positions, lengths, targets), 0.0, 1.0))


def blend_targets(at: FloatArray, lengths: FloatArray, targets: FloatArray) -> FloatArray:
    """Plays targets (S, C) of lengths (S,) in sequence, each eased into the next; (T, C) at positions ``at`` (T,)."""
    borders = np.cumsum(lengths)[:-1]
    weights = np.tile(targets[0], (len(at), 1))
    for border, before, after, step in zip(borders, lengths[:-1], lengths[1:], np.diff(targets, axis=0), strict=True):
        half = TIMING.blended_fraction * min(before, after)
        u = np.clip((at - border + half) / (2.0 * half), 0.0, 1.0)
        weights += (u**3 * (10.0 - 15.0 * u + 6.0 * u**2))[:, None] * step
    return weights


def with_mouthing(clip: Clip, sampa: str, frames: tuple[int, int]) -> Clip:
    """Replaces the mouth of a clip: it speaks during the sign, half-open ``frames``, and is closed elsewhere. The rest
    of the face stays. Raises ``InputError`` as ``visemes`` does.
    """
    start, stop = frames
    mouth = mouthing(sampa, clip.fps, (stop - start) / clip.fps)
    kept_names = () if clip.face is None else tuple(name for name in clip.face.channels if not name.startswith(MOUTH))
    channels = tuple(name for name in ARKIT_CHANNELS if name in (*mouth.channels, *kept_names))
    weights = np.zeros((len(clip), len(channels)))
    if clip.face is not None:
        weights += np.where([name in kept_names for name in channels], clip.face.of(channels), 0.0)
    stop = min(start + len(mouth), len(clip))
    weights[start:stop] += mouth.of(channels)[: stop - start]
    return replace(clip, face=Face(channels, weights))


LANES = {
    "mouth_picture": "mouth", "mouth_gesture": "mouth", "eye_brows": "face", "eye_lids": "face", "nose": "face",
    "eye_gaze": "gaze", "head": "head", "body": "body", "shoulder": "shoulder",
}  # fmt: skip
"""Tier -> the lane of its items if the text has no lanes; items of a lane follow one another."""
_TIERS = {tier if "_" in tier or tier == "nose" else f"{tier}_movement": tier for tier in LANES}
"""Element of gestural SiGML -> its tier."""
_KEYS = {"mouth_picture": "picture", "eye_gaze": "direction"}
"""Tier -> the attribute with its code; the default is ``movement``."""
_PARALLEL = ("mouthing_par", "head_par", "body_par", "facial_expr_par", "shoulder_par", "eye_par")
_HNS = {"hnm_" + tier.replace("_", ""): tier for tier in LANES}
"""Element of HamNoSys SiGML -> its tier."""


def gestural_tiers(nonmanual: Element, reading: Reading) -> list[Tier]:
    """Parses nonmanual tiers; items of a lane follow one another, items of a ``*_par`` run together."""
    tiers = list[Tier]()
    for lane in nonmanual.children:
        if lane.tag == "extra_tier":
            reading.note("<extra_tier> is left out", lane.line)
            continue
        start = 0
        for item in lane.children:
            together = item.children if item.tag in _PARALLEL else (item,)
            lane_tiers = [_tier(e, lane.tag, start, reading) for e in together]
            tiers += [tier for tier in lane_tiers if tier is not None]
            start += any(lane_tiers)
    return tiers


def _tier(e: Element, lane: str, start: int, reading: Reading) -> Tier | None:
    name = _TIERS.get(e.tag, "")
    key = _KEYS.get(name, "movement")
    code = e.attributes.get(key) or e.attributes.get("movement", "")
    if not name or not code:
        reading.refuse(f"is no {'item of a tier' if not name else key} that is known", f"<{e.tag}>", e.line)
        return None
    if key == "direction" and key not in e.attributes:
        reading.note("<eye_gaze> movement is read as direction", e.line)
    if name == "shoulder" and lane == "head_tier":
        reading.note("<shoulder_movement> among movements of the head is read as one", e.line)
        name = "head"
    for silent in sorted(e.attributes.keys() - {key, "movement", "direction", "amount", "speed"}):
        reading.note(f"{silent[:40]} of <{e.tag}> is left out", e.line)
    amount, speed = (factor(e, k, reading) for k in ("amount", "speed"))
    return Tier(name, code, start, amount, speed, lane.removesuffix("_tier") or LANES[name])


def hns_tiers(items: Iterable[Element], reading: Reading) -> list[Tier]:
    """Parses nonmanual tiers of HamNoSys SiGML; items of a lane follow one another."""
    tiers, starts = list[Tier](), dict[str, int]()
    for item in items:
        name, code = _HNS.get(item.tag, ""), item.attributes.get("tag") or item.attributes.get("picture", "")
        if name and code:
            lane = LANES[name]
            tiers.append(Tier(name, code, starts.get(lane, 0), lane=lane))
            starts[lane] = starts.get(lane, 0) + 1
        elif not name or any(item.attributes.values()):
            reading.note(f"<{item.tag[:60]}> without what is known of it is left out", item.line)
    return tiers


_BODIES = ("head", "body")
_FACES = tuple(tier for tier in LANES if tier not in (*_BODIES, "shoulder"))
_GESTURE = re.compile(r"[DJLCT]\d\d")
_Shape = Mapping[str, float]


def _read_shapes() -> dict[str, _Shape]:
    """Returns name -> coefficients, from the table and the visemes."""
    shape_table: dict[str, _Shape] = dict(VISEMES)
    for name, *pairs in _WORDS["shapes"]:
        shape = dict[str, float]()
        for pair in pairs:
            channel, _, weight = pair.partition("=")
            sides = (channel,) if channel in ARKIT_CHANNELS else (f"{channel}Left", f"{channel}Right")
            shape |= dict.fromkeys(sides, float(weight))
        shape_table[name] = shape
    return shape_table


_WORDS = sections(__file__, "faces")
_SHAPES = _read_shapes()
_CODES = {table: {code: tuple(words) for code, *words in rows} for table, rows in _WORDS.items() if table != "shapes"}
"""Table -> code -> its words."""


@dataclass(frozen=True)
class _Item:
    """An item of the face.

    tier: its tier in the tree
    shapes, lengths: coefficients in sequence, and the length of each in sounds
    at_end: the item comes only at the end of the sign
    """

    tier: Tier
    shapes: tuple[_Shape, ...]
    lengths: tuple[float, ...]
    at_end: bool = False


def with_face(clip: Clip, sign: WrittenSign, hands: tuple[int, int]) -> Clip:
    """Adds the face of a sign to its clip; the hands sign in the half-open frames ``hands``. Returns the clip unchanged
    if the sign has no face.
    """
    return replace(clip, face=face) if (face := face_of(sign, hands, len(clip), clip.fps)) else clip


def face_of(sign: WrittenSign, hands: tuple[int, int], n_frames: int, fps: float) -> Face | None:
    """The face of a sign over ``n_frames``, in which the hands sign in the half-open frames ``hands``. Returns None if
    the sign has no face. It omits the items that ``left_out`` names.
    """
    start, seconds = hands[0] / fps, max((hands[1] - hands[0]) / fps, TIMING.least_face_s)
    t = np.arange(n_frames) / fps  # (T,)
    weights = np.zeros((n_frames, len(ARKIT_CHANNELS)))
    for lane in _lanes(sign, _FACES):
        groups = [[item for item in map(_item, group) if item is not None] for group in lane]
        parts = [max((sum(item.lengths) / item.tier.speed for item in group), default=0.0) for group in groups]
        sounds = [item for group in groups for item in group if item.tier.tier == "mouth_picture"]
        has_mouth = any(item.tier.tier.startswith("mouth") for group in groups for item in group)
        lead_s = 0.0 if has_mouth else TIMING.face_lead_s
        total = max(seconds, sum(parts) / TIMING.most_sounds_per_s) if sounds else seconds + 2.0 * lead_s
        begin = start - lead_s
        for group, part in zip(groups, parts, strict=True):
            end = begin + total * part / max(sum(parts), 1e-9)
            for item in group:
                window = (start + seconds - TIMING.end_item_s, start + seconds) if item.at_end else (begin, end)
                np.maximum(weights, _track(item, t, *window), out=weights)
            begin = end
    weights = weights.round(6)
    shown = [name for name, column in zip(ARKIT_CHANNELS, weights.T, strict=True) if column.any()]
    columns = [ARKIT_CHANNELS.index(name) for name in shown]
    return Face(tuple(shown), np.clip(weights[:, columns], 0.0, 1.0)) if shown else None


def body_tracks(sign: WrittenSign, tiers: Sequence[str] = _BODIES) -> tuple[Gesture, ...]:
    """The gestures of head and trunk of a sign, or of other tiers, without the items that ``left_out`` names."""
    gestures = list[Gesture]()
    for lane in _lanes(sign, tiers):
        for n, group in enumerate(lane):
            for tier in {tier.code: tier for tier in group}.values():  # a repeated code counts once
                if words := _CODES[tier.tier].get(tier.code):
                    part, angles, cycles = words
                    degrees = to_vector(tier.amount * float(angle) for angle in (*angles.split(","), "0")[:3])
                    gestures.append(Gesture(part, degrees, float(cycles), n / len(lane), (n + 1) / len(lane)))
    return tuple(gestures)


def left_out(sign: WrittenSign) -> tuple[str, ...]:
    """Lists the items of a sign's face and body that are not supported, one line each."""
    lines = list[str]()
    for tier in sign.tiers:
        try:
            if tier.tier == "mouth_picture" and not _GESTURE.fullmatch(tier.code):
                visemes(tier.code)
            elif tier.code not in _CODES.get(_table(tier), {}):
                raise InputError("is no code that is known")
        except InputError as error:
            lines.append(f"{tier.tier} {tier.code[:40]} is left out: {str(error)[:120]}")
    return tuple(lines)


def _table(tier: Tier) -> str:
    """Returns the code table of a tier; mouth gestures may be written as mouthings."""
    return "mouth_gesture" if tier.tier == "mouth_picture" else tier.tier


def _lanes(sign: WrittenSign, tiers: Sequence[str]) -> Iterator[list[list[Tier]]]:
    """Yields each lane that has some of the tiers, as groups of simultaneous items in order."""
    lanes = dict[str, list[Tier]]()
    for tier in sign.tiers:
        lanes.setdefault(tier.lane, []).append(tier)
    for items in lanes.values():
        starts = sorted({tier.start for tier in items})
        groups = [[tier for tier in items if tier.start == start and tier.tier in tiers] for start in starts]
        if any(groups):
            yield groups


def _item(tier: Tier) -> _Item | None:
    """Returns the shapes of an item; None if it is not supported."""
    if tier.tier == "mouth_picture" and not _GESTURE.fullmatch(tier.code):
        try:
            sounds = shapes(tier.code)
        except InputError:
            return None
        return _Item(tier, tuple(VISEMES[name] for name, _ in sounds), tuple(length for _, length in sounds))
    names = list(_CODES[_table(tier)].get(tier.code, ()))
    at_end = names[:1] == ["end"]
    series = tuple(_SHAPES[name] for name in names[at_end:])
    return _Item(tier, series, (TIMING.item_sounds / len(series),) * len(series), at_end) if series else None


def _track(item: _Item, t: FloatArray, begin: float, end: float) -> FloatArray:
    """Returns the weights (T, 52) of an item shown from ``begin`` to ``end``, seconds."""
    ramp = TIMING.mouth_ramp_s if item.tier.tier.startswith("mouth") else TIMING.face_ramp_s
    stretch = (end - begin) / sum(item.lengths)
    lengths = np.array([2.0 * ramp, *(stretch * length for length in item.lengths), 2.0 * ramp])
    targets = np.array([[shape.get(name, 0.0) for name in ARKIT_CHANNELS] for shape in ({}, *item.shapes, {})])
    return blend_targets(t - begin + 2.0 * ramp, lengths, targets) * min(item.tier.amount, 2.0)


def with_shoulders(clip: Clip, sign: WrittenSign, hands: tuple[int, int]) -> Clip:
    """Adds the shoulders of a sign to its clip of the synthetic signer, as far as the hands leave room for them; the
    hands sign in the half-open frames ``hands``. Returns the clip unchanged if the sign has no shoulder movement.
    """
    tracks = body_tracks(sign, ("shoulder",))  # of Left, Right or both: up, forward
    if not tracks:
        return clip
    least = max(_SHOULDERS.hand_depth_cm, float(collision.hand_depths(clip).max()))
    for part in _SHOULDERS.turn_fractions:
        quats = clip.local_rotations.copy()
        for track in tracks:
            level = part * gesture_level(len(clip), clip.fps, hands, track)
            for side in ("Left", "Right") if track.part == "both" else (track.part,):
                _turn(quats, side, np.deg2rad(track.degrees[:2]) * level[:, None], clip)
        moved = replace(clip, local_rotations=quats)
        if collision.hand_depths(moved).max() <= least:
            return moved
    return replace(clip, notes=(*clip.notes, "the shoulders stay: the hands are in their way"))


def _turn(quats: FloatArray, side: str, angles: FloatArray, clip: Clip) -> None:
    """Turn a collar bone up and forward by angles (T, 2), in local rotations (T, J, 4); changes ``quats`` in place."""
    joints = [JOINTS[side + name] for name in ARM_JOINTS]
    arm, fore, hand = (clip.skeleton.offsets[joint] for joint in joints[1:])
    collar, upper_quats, fore_quats, hand_quats = accumulate((quats[:, joint] for joint in joints), rotation.multiply)
    upper, lower = rotation.rotate(upper_quats, fore), rotation.rotate(fore_quats, hand)
    before, sign = rotation.rotate(collar, arm), 1.0 if side == "Left" else -1.0
    turn = rotation.exp(np.stack([0.0 * angles[:, 0], -sign * angles[:, 1], sign * angles[:, 0]], axis=-1))
    collar = rotation.multiply(turn, collar)
    line = before + upper + lower - rotation.rotate(collar, arm)  # from the turned shoulder to the fixed wrist
    a, b = np.linalg.norm(fore), np.linalg.norm(hand)
    distance = np.linalg.norm(line, axis=-1, keepdims=True)
    axis = line / distance
    distance = np.minimum(distance, _SHOULDERS.arm_reach * (a + b))
    elbow_direction = upper - np.sum(upper * axis, axis=-1, keepdims=True) * axis
    elbow_direction = elbow_direction / np.maximum(np.linalg.norm(elbow_direction, axis=-1, keepdims=True), 1e-9)
    part = (a**2 - b**2 + distance**2) / (2.0 * distance)
    elbow = part * axis + np.sqrt(np.maximum(a**2 - part**2, 0.0)) * elbow_direction
    upper_quats = rotation.multiply(rotation.between_vectors(upper, elbow), upper_quats)
    fore_quats = rotation.multiply(rotation.between_vectors(lower, distance * axis - elbow), fore_quats)
    chain = [collar, upper_quats, fore_quats, hand_quats]
    quats[:, joints[0]] = collar
    for joint, parent_quats, child_quats in zip(joints[1:], chain, chain[1:], strict=False):
        quats[:, joint] = rotation.multiply(rotation.inverse(parent_quats), child_quats)
