"""The face and the gestures of head and trunk that a written sign has, timed with its hands.

Codes by tables of our own (words/faces.txt); mouthings by ``signer.mouthing``. Lanes run side by side; the items of a
lane share the time of the hands (Elliott et al. 2004), a mouthing by its sounds.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from signsplice.errors import InputError
from signsplice.motion.arrays import FloatArray
from signsplice.motion.clip import Clip
from signsplice.motion.face import ARKIT_CHANNELS, Face
from signsplice.motion.face_shapes import VISEMES
from signsplice.signer import mouthing
from signsplice.signer.phonology import Gesture
from signsplice.signer.tables import sections
from signsplice.written.tree import Tier, WrittenSign

_FACES = ("mouth_picture", "mouth_gesture", "eye_brows", "eye_lids", "eye_gaze", "nose")
_BODIES = ("head", "body")
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
    face = face_of(sign, hands, len(clip), clip.fps)
    return clip if face is None else replace(clip, face=face)


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


def body_tracks(sign: WrittenSign) -> tuple[Gesture, ...]:
    """The gestures of head and trunk of a sign. What ``left_out`` names is not among them."""
    found = list[Gesture]()
    for lane in _lanes(sign, _BODIES):
        for n, group in enumerate(lane):
            for tier in {tier.code: tier for tier in group}.values():  # what is written twice is made once
                row = _CODES[tier.tier].get(tier.code, ())
                if row:
                    part, degrees, cycles = row
                    x, y, z = (tier.amount * float(angle) for angle in degrees.split(","))
                    begin, end = n / len(lane), (n + 1) / len(lane)
                    found.append(Gesture(part, (x, y, z), float(cycles), begin, end))
    return tuple(found)


def shoulder_tracks(sign: WrittenSign) -> Iterator[tuple[str, FloatArray, float, float, float]]:
    """Of each movement of the shoulders of a sign that is made: the side (Left, Right, both), degrees (2,) up and
    forward, cycles, and the fractions of the time of the hands at which it begins and ends.
    """
    for lane in _lanes(sign, ("shoulder",)):
        for n, group in enumerate(lane):
            for tier in {tier.code: tier for tier in group}.values():
                if row := _CODES["shoulder"].get(tier.code):
                    side, degrees, cycles = row
                    angles = tier.amount * np.array(degrees.split(","), np.float64)
                    yield side, angles, float(cycles), n / len(lane), (n + 1) / len(lane)


def left_out(sign: WrittenSign) -> tuple[str, ...]:
    """What of a sign's face and body is not made, one line each."""
    lines = list[str]()
    for tier in sign.tiers:
        try:
            if tier.tier == "mouth_picture" and not _GESTURE.fullmatch(tier.code):
                mouthing.visemes(tier.code)
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
            sounds = mouthing.shapes(tier.code)
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
    return mouthing.blended(t - begin + 2.0 * ramp, lengths, targets) * min(item.tier.amount, 2.0)
