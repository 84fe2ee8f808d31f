"""What a written sign says beside its hands: read from SiGML as items of the tree, and made as a face, gestures of head
and trunk, and shoulders, timed with its hands.

Codes by tables of our own (words/faces.txt). Lanes run side by side; the items of a lane share the time of the hands
(Elliott et al. 2004), a mouthing by its sounds.

Mouthing: phonemes in SAMPA -> visemes -> a mouth over time. Phonemes are given; none is guessed from spelling. The
table follows the places of articulation in the IPA and what SAMPA (Wells 1997; X-SAMPA for the rest) names by them:
sounds that look alike share a viseme (Fisher 1968, "Confusions among visually perceived consonants"). A mouthing goes
with its sign in time (Boyes Braem and Sutton-Spence 2001, "The Hands are the Head of the Mouth"): the sounds are
stretched over it.

Shoulders that are lifted, hunched or shrugged are turned in the clip, arms bent anew so that hands stay: the planner's
shoulders follow the hands, what is written comes on top.
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
A_SECOND = 6.7
"""Phonemes a second where there is no sign to go with."""
_SIGNS = re.compile("|".join(re.escape(sound) for sound in sorted(SOUNDS, key=len, reverse=True)))
_NO_SOUND = re.compile(r"[\s.\"%'_|:~-]+")
"""What parts syllables and words, marks of stress, of length and of nasal sounds."""
_LENGTHS = {1: 1.0, 2: 0.75}
"""Length of each shape of a sound that has one, or two."""
_WIDTH = 0.5
"""Fraction of a sound's time in which its shape goes over into the next one's, on either side of their border: what
is said next shows before it is heard (Cohen and Massaro 1993).
"""


def visemes(sampa: str) -> list[list[str]]:
    """The visemes of each sound of a text in SAMPA. Raises ``InputError`` for what is no sound, or where none is."""
    found, at = list[list[str]](), 0
    while at < len(sampa):
        if between := _NO_SOUND.match(sampa, at):
            at = between.end()
            continue
        sound = _SIGNS.match(sampa, at)
        if sound is None:
            known = " ".join(SOUNDS)
            raise InputError(f"mouth {sampa[:60]!r}: {sampa[at]!r} is no sound of SAMPA that is known: {known}")
        found.append(list(SOUNDS[sound[0]]))
        at = sound.end()
    if not found:
        raise InputError(f"mouth {sampa[:60]!r} has no sound, expected phonemes in SAMPA such as h @ l @U")
    return found


def shapes(sampa: str) -> list[tuple[str, float]]:
    """Each viseme of a text in SAMPA with its length in sounds. Raises as ``visemes`` does."""
    return [(name, _LENGTHS[len(sound)]) for sound in visemes(sampa) for name in sound]


def mouthing(sampa: str, fps: float, seconds: float | None = None) -> Face:
    """The mouth that says the sounds of a text in SAMPA, from closed to closed; by default at ``A_SECOND``."""
    said = [("sil", 0.5), *shapes(sampa), ("sil", 0.5)]
    lengths = np.array([length for _, length in said])  # sounds
    channels = tuple(name for name in ARKIT_CHANNELS if any(name in VISEMES[shape] for shape, _ in said))
    targets = np.array([[VISEMES[shape].get(name, 0.0) for name in channels] for shape, _ in said])  # (S, C)
    seconds = lengths.sum() / A_SECOND if seconds is None else seconds
    n_frames = max(2, round(seconds * fps))
    at = np.linspace(0.0, lengths.sum(), n_frames)  # (T,)
    return Face(channels, np.clip(blend_targets(at, lengths, targets), 0.0, 1.0))


def blend_targets(at: FloatArray, lengths: FloatArray, targets: FloatArray) -> FloatArray:
    """Targets (S, C) one after another at places (T,) in the unit of their lengths (S,), each eased into the next."""
    borders = np.cumsum(lengths)[:-1]
    out = np.tile(targets[0], (len(at), 1))
    for border, before, after, step in zip(borders, lengths[:-1], lengths[1:], np.diff(targets, axis=0), strict=True):
        half = _WIDTH * min(before, after)
        u = np.clip((at - border + half) / (2.0 * half), 0.0, 1.0)
        out += (u**3 * (10.0 - 15.0 * u + 6.0 * u**2))[:, None] * step
    return out


def with_mouthing(clip: Clip, sampa: str, frames: tuple[int, int]) -> Clip:
    """A clip whose mouth says sounds during its sign, half-open ``frames``, and is closed else; the rest of its face is
    kept. Raises ``InputError`` as ``visemes`` does.
    """
    start, stop = frames
    mouth = mouthing(sampa, clip.fps, (stop - start) / clip.fps)
    kept = () if clip.face is None else tuple(name for name in clip.face.channels if not name.startswith(MOUTH))
    channels = tuple(name for name in ARKIT_CHANNELS if name in (*mouth.channels, *kept))
    weights = np.zeros((len(clip), len(channels)))
    if clip.face is not None:
        weights += np.where([name in kept for name in channels], clip.face.of(channels), 0.0)
    stop = min(start + len(mouth), len(clip))
    weights[start:stop] += mouth.of(channels)[: stop - start]
    return replace(clip, face=Face(channels, weights))


LANES = {
    "mouth_picture": "mouth", "mouth_gesture": "mouth", "eye_brows": "face", "eye_lids": "face", "nose": "face",
    "eye_gaze": "gaze", "head": "head", "body": "body", "shoulder": "shoulder",
}  # fmt: skip
"""Tier -> the lane in which its items follow one another where the text has no lanes of its own."""
_TIERS = {tier if "_" in tier or tier == "nose" else f"{tier}_movement": tier for tier in LANES}
"""Element of gestural SiGML -> its tier."""
_KEYS = {"mouth_picture": "picture", "eye_gaze": "direction"}
"""Tier -> the attribute that holds its code, where that is not ``movement``."""
_PARALLEL = ("mouthing_par", "head_par", "body_par", "facial_expr_par", "shoulder_par", "eye_par")
_HNS = {"hnm_" + tier.replace("_", ""): tier for tier in LANES}
"""Element of HamNoSys SiGML -> its tier."""


def gestural_tiers(nonmanual: Element, reading: Reading) -> list[Tier]:
    """What is not done by the hands; items of a lane follow one another, those of a ``*_par`` run together."""
    found = list[Tier]()
    for lane in nonmanual.children:
        if lane.tag == "extra_tier":
            reading.note("<extra_tier> is left out", lane.line)
            continue
        start = 0
        for item in lane.children:
            together = item.children if item.tag in _PARALLEL else (item,)
            made = [_tier(e, lane.tag, start, reading) for e in together]
            found += [one for one in made if one is not None]
            start += any(made)
    return found


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
    """What is not done by the hands in SiGML of HamNoSys; items of a lane follow one another."""
    found, starts = list[Tier](), dict[str, int]()
    for item in items:
        name, code = _HNS.get(item.tag, ""), item.attributes.get("tag") or item.attributes.get("picture", "")
        if name and code:
            lane = LANES[name]
            found.append(Tier(name, code, starts.get(lane, 0), lane=lane))
            starts[lane] = starts.get(lane, 0) + 1
        elif not name or any(item.attributes.values()):
            reading.note(f"<{item.tag[:60]}> without what is known of it is left out", item.line)
    return found


_BODIES = ("head", "body")
_FACES = tuple(tier for tier in LANES if tier not in (*_BODIES, "shoulder"))
_MOUTH_RAMP_S, _RAMP_S = 0.08, 0.2
"""How long the mouth, and other parts of the face, take from rest and to rest, on either side of an item's time."""
_EARLY_S = 0.15
"""How much longer than the hands sign brows, lids and gaze last, before and after."""
_MOST_SOUNDS_S, _ITEM_SOUNDS = 11.0, 3.0
"""Sounds a second that a mouth says at most, beyond which it goes on when the hands go down; and how many sounds an
item that is no mouthing takes as long as."""
_LEAST_S = 0.3
"""Least time of a face."""
_END_S = 0.28
"""Time of what comes at the end of a sign alone, as a blink does."""
_GESTURE = re.compile(r"[DJLCT]\d\d")
_Shape = Mapping[str, float]


def _read_shapes() -> dict[str, _Shape]:
    """Name -> coefficients, of the table and the visemes."""
    found: dict[str, _Shape] = dict(VISEMES)
    for name, *pairs in _WORDS["shapes"]:
        shape = dict[str, float]()
        for pair in pairs:
            channel, _, weight = pair.partition("=")
            sides = (channel,) if channel in ARKIT_CHANNELS else (f"{channel}Left", f"{channel}Right")
            shape |= dict.fromkeys(sides, float(weight))
        found[name] = shape
    return found


_WORDS = sections(__file__, "faces")
_SHAPES = _read_shapes()
_CODES = {table: {code: tuple(words) for code, *words in rows} for table, rows in _WORDS.items() if table != "shapes"}
"""Table -> code -> its words."""


@dataclass(frozen=True)
class _Item:
    """An item of the face.

    tier: where it stands
    shapes: coefficients one after another, and the length of each, in sounds
    at_end: it comes at the end of the sign alone
    """

    tier: Tier
    shapes: tuple[_Shape, ...]
    lengths: tuple[float, ...]
    at_end: bool = False


def with_face(clip: Clip, sign: WrittenSign, hands: tuple[int, int]) -> Clip:
    """A clip with the face of its sign, whose hands sign in the half-open frames ``hands``; itself where the sign has
    none.
    """
    return replace(clip, face=face) if (face := face_of(sign, hands, len(clip), clip.fps)) else clip


def face_of(sign: WrittenSign, hands: tuple[int, int], n_frames: int, fps: float) -> Face | None:
    """The face of a sign for a clip of ``n_frames`` whose hands sign in the half-open frames ``hands``; None where the
    sign has none. What ``left_out`` names is not in it.
    """
    start, seconds = hands[0] / fps, max((hands[1] - hands[0]) / fps, _LEAST_S)
    t = np.arange(n_frames) / fps  # (T,)
    weights = np.zeros((n_frames, len(ARKIT_CHANNELS)))
    for lane in _lanes(sign, _FACES):
        groups = [[item for item in map(_item, group) if item is not None] for group in lane]
        parts = [max((sum(item.lengths) / item.tier.speed for item in group), default=0.0) for group in groups]
        sounds = [item for group in groups for item in group if item.tier.tier == "mouth_picture"]
        early = 0.0 if any(item.tier.tier.startswith("mouth") for group in groups for item in group) else _EARLY_S
        total = max(seconds, sum(parts) / _MOST_SOUNDS_S) if sounds else seconds + 2.0 * early
        begin = start - early
        for group, part in zip(groups, parts, strict=True):
            end = begin + total * part / max(sum(parts), 1e-9)
            for item in group:
                window = (start + seconds - _END_S, start + seconds) if item.at_end else (begin, end)
                np.maximum(weights, _track(item, t, *window), out=weights)
            begin = end
    weights = weights.round(6)
    shown = [name for name, column in zip(ARKIT_CHANNELS, weights.T, strict=True) if column.any()]
    columns = [ARKIT_CHANNELS.index(name) for name in shown]
    return Face(tuple(shown), np.clip(weights[:, columns], 0.0, 1.0)) if shown else None


def body_tracks(sign: WrittenSign, tiers: Sequence[str] = _BODIES) -> tuple[Gesture, ...]:
    """The gestures of head and trunk of a sign, or those of other tiers. What ``left_out`` names is not among them."""
    made = list[Gesture]()
    for lane in _lanes(sign, tiers):
        for n, group in enumerate(lane):
            for tier in {tier.code: tier for tier in group}.values():  # what is written twice is made once
                if words := _CODES[tier.tier].get(tier.code):
                    part, angles, cycles = words
                    degrees = to_vector(tier.amount * float(angle) for angle in (*angles.split(","), "0")[:3])
                    made.append(Gesture(part, degrees, float(cycles), n / len(lane), (n + 1) / len(lane)))
    return tuple(made)


def left_out(sign: WrittenSign) -> tuple[str, ...]:
    """What of a sign's face and body is not made, one line each."""
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
    """The table of a tier's codes; a gesture that is written as a mouthing is one."""
    return "mouth_gesture" if tier.tier == "mouth_picture" else tier.tier


def _lanes(sign: WrittenSign, tiers: Sequence[str]) -> Iterator[list[list[Tier]]]:
    """For each lane with some of the tiers the items of each of its times."""
    lanes = dict[str, list[Tier]]()
    for tier in sign.tiers:
        lanes.setdefault(tier.lane, []).append(tier)
    for items in lanes.values():
        starts = sorted({tier.start for tier in items})
        groups = [[tier for tier in items if tier.start == start and tier.tier in tiers] for start in starts]
        if any(groups):
            yield groups


def _item(tier: Tier) -> _Item | None:
    """What an item shows, None for one that is not made."""
    if tier.tier == "mouth_picture" and not _GESTURE.fullmatch(tier.code):
        try:
            sounds = shapes(tier.code)
        except InputError:
            return None
        return _Item(tier, tuple(VISEMES[name] for name, _ in sounds), tuple(length for _, length in sounds))
    names = list(_CODES[_table(tier)].get(tier.code, ()))
    at_end = names[:1] == ["end"]
    found = tuple(_SHAPES[name] for name in names[at_end:])
    return _Item(tier, found, (_ITEM_SOUNDS / len(found),) * len(found), at_end) if found else None


def _track(item: _Item, t: FloatArray, begin: float, end: float) -> FloatArray:
    """Weights (T, 52) of an item that is shown from ``begin`` to ``end``, seconds."""
    ramp = _MOUTH_RAMP_S if item.tier.tier.startswith("mouth") else _RAMP_S
    stretch = (end - begin) / sum(item.lengths)
    lengths = np.array([2.0 * ramp, *(stretch * length for length in item.lengths), 2.0 * ramp])
    targets = np.array([[shape.get(name, 0.0) for name in ARKIT_CHANNELS] for shape in ({}, *item.shapes, {})])
    return blend_targets(t - begin + 2.0 * ramp, lengths, targets) * min(item.tier.amount, 2.0)


_PARTS, _DEEP_CM = (1.0, 0.5, 0.25), 0.4
"""How much of what is written is tried, until no hand is deeper than this in what moves."""
_REACH = 0.995
"""How long an arm is at most, over its bones: a hand that hangs comes along with what is beyond."""


def with_shoulders(clip: Clip, sign: WrittenSign, hands: tuple[int, int]) -> Clip:
    """A clip of the synthetic signer with the shoulders of its sign, whose hands sign in the half-open frames
    ``hands``, as far as these are not in their way; itself where the sign has none.
    """
    tracks = body_tracks(sign, ("shoulder",))  # of Left, Right or both: up, forward
    if not tracks:
        return clip
    least = max(_DEEP_CM, float(collision.hand_depths(clip).max()))
    for part in _PARTS:
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
    """Turn a collar bone up and forward by angles (T, 2) in local rotations (T, J, 4), in place."""
    joints = [JOINTS[side + name] for name in ARM_JOINTS]
    arm, fore, hand = (clip.skeleton.offsets[joint] for joint in joints[1:])
    collar, upper_quats, fore_quats, hand_quats = accumulate((quats[:, joint] for joint in joints), rotation.multiply)
    upper, lower = rotation.rotate(upper_quats, fore), rotation.rotate(fore_quats, hand)
    before, sign = rotation.rotate(collar, arm), 1.0 if side == "Left" else -1.0
    turn = rotation.exp(np.stack([0.0 * angles[:, 0], -sign * angles[:, 1], sign * angles[:, 0]], axis=-1))
    collar = rotation.multiply(turn, collar)
    line = before + upper + lower - rotation.rotate(collar, arm)  # from the shoulder to the wrist, as that stays
    a, b = np.linalg.norm(fore), np.linalg.norm(hand)
    distance = np.linalg.norm(line, axis=-1, keepdims=True)
    along = line / distance
    distance = np.minimum(distance, _REACH * (a + b))
    out = upper - np.sum(upper * along, axis=-1, keepdims=True) * along
    out = out / np.maximum(np.linalg.norm(out, axis=-1, keepdims=True), 1e-9)
    part = (a**2 - b**2 + distance**2) / (2.0 * distance)
    elbow = part * along + np.sqrt(np.maximum(a**2 - part**2, 0.0)) * out
    upper_quats = rotation.multiply(rotation.between_vectors(upper, elbow), upper_quats)
    fore_quats = rotation.multiply(rotation.between_vectors(lower, distance * along - elbow), fore_quats)
    chain = [collar, upper_quats, fore_quats, hand_quats]
    quats[:, joints[0]] = collar
    for joint, parent, own in zip(joints[1:], chain, chain[1:], strict=False):
        quats[:, joint] = rotation.multiply(rotation.inverse(parent), own)
