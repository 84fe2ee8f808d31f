"""Pseudo-signs: random and lawful, any number by seed, for data of any size. They mean nothing.

Frequencies follow what is known of American Sign Language's lexicon in round numbers: about half of the signs use one
hand, few handshapes carry most signs, neutral space and face are the commonest places (ASL-LEX 2.0, Sehyr et al. 2021).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import TypeVar

import numpy as np

from signsplice.synth import places, pose
from signsplice.synth.clearance import intrusion
from signsplice.synth.phonology import DIRECTIONS, NEUTRAL, Local, Path, Posture, Segment, Sign, Vector, faults
from signsplice.synth.places import MIRROR
from signsplice.synth.planner import resting
from signsplice.synth.rng import stream
from signsplice.synth.signer import STANDARD

T = TypeVar("T")

_HANDS = {"one": 0.60, "symmetric": 0.14, "alternating": 0.08, "base": 0.18}
_SHAPES = {
    **dict.fromkeys(("B", "1", "5"), 8.0),
    **dict.fromkeys(("A", "S", "C", "F", "V", "O-flat", "5-claw", "B-bent", "L", "X"), 3.0),
    **dict.fromkeys(("Y", "H", "O", "10", "W", "K", "I", "8-open", "3", "V-bent", "R", "ILY", "E", "D", "G"), 1.2),
}
_PLACES = {
    **{"space": 6.0, "space-mid": 3.0, "space-out": 2.0, "space-high": 3.0, "space-low": 1.5, "face-space": 2.0},
    **dict.fromkeys(("chin", "forehead", "mouth", "cheek", "chest", "temple", "nose"), 2.0),
    **dict.fromkeys(("ear", "eye", "shoulder", "chest-strong", "heart", "belly", "throat", "jaw", "mouth-corner"), 0.7),
    **dict.fromkeys(("space-in", "space-far", "side-space", "shoulder-weak", "space-high-out"), 0.8),
}
_MIRRORED_PLACES = {
    **{"space": 5.0, "space-mid": 5.0, "space-out": 2.0, "space-low": 2.0, "space-high": 2.0, "space-low-mid": 1.5},
    **dict.fromkeys(("chest-strong", "cheek", "temple", "waist"), 0.7),
}
_BASE_PLACES = {
    **{"base-palm": 5.0, "base-back": 3.0, "base-radial": 2.0, "base-fingertips": 1.0, "base-index": 1.0},
    **{"base-wrist": 1.0, "forearm-weak": 1.0, "base-fingers": 1.0},
}
_PARTS = {
    **dict.fromkeys(("palm", "index", "tips", "fingertips"), 3.0),
    **dict.fromkeys(("radial", "ulnar", "middles", "pinch", "thumb", "back"), 1.0),
}
_BASES = (
    Posture("B", "space-low-mid", "palm", (0.0, 1.0, 0.0), (-0.6, 0.0, 0.8)),
    Posture("B", "space-low-mid", "palm", (0.0, -1.0, 0.0), (-0.8, 0.0, 0.6)),
    Posture("S", "space-low-mid", "palm", (0.0, -1.0, 0.0), (-0.7, 0.0, 0.7)),
    Posture("1", "space-mid", "palm", (-1.0, 0.0, 0.0), (-0.2, 0.6, 0.7)),
    Posture("B", "space-mid", "palm", (-1.0, 0.0, 0.0), (0.0, 0.5, 0.85)),
)
_SHOWN = tuple(DIRECTIONS.values())
_TRIES = 400


def sign(seed: int) -> Sign:
    """The pseudo-sign of a seed, ``PSEUDO-<seed>``: lawful by ``phonology.faults``, within reach and joint limits."""
    rng = stream("pseudo", seed)
    # Drawn once: hands that find few postures at ease must not become rare for it.
    hands = _pick(rng, _HANDS)
    for _ in range(_TRIES):
        segments = _segments(hands, rng)
        made = Sign(f"PSEUDO-{seed}", hands, tuple(segments or ()), source="drawn at random", kind="pseudo")
        if segments and not faults(made):
            return made
    raise RuntimeError(f"no pseudo-sign for seed {seed}")  # not met in the first 10,000 seeds


def _segments(hands: str, rng: np.random.Generator) -> list[Segment] | None:
    """Segments at ease one by one; None where none was found for one of them."""
    table = {"base": _BASE_PLACES, "one": _PLACES}.get(hands, _MIRRORED_PLACES)
    base = _BASES[rng.integers(len(_BASES))] if hands == "base" else None
    first = "H" if rng.random() < 0.22 else "X"
    segments: list[Segment] = []

    def add(draw: Callable[[], Segment]) -> bool:
        for _ in range(_TRIES):
            segment = draw()
            if _at_ease(segment, hands):
                segments.append(segment)
                return True
        return False

    if not add(lambda: Segment(first, _posture(rng, _pick(rng, table)), base)):
        return None
    for n in range(2 if rng.random() < 0.12 else 1):
        here, again = segments[-1].strong, n > 0
        if not add(partial(_movement, rng, here, base, table, again=again)):
            return None
        if n == 0 and rng.random() < 0.1:
            segments.append(Segment("H", segments[-1].strong, base))
    if rng.random() < 0.36:
        segments.append(Segment("H", segments[-1].strong, base))
    return segments


def _posture(rng: np.random.Generator, place: str) -> Posture:
    free = place in NEUTRAL
    off = 0.0 if free or rng.random() < 0.7 else float(rng.uniform(2.0, 4.0))
    shift = (float(rng.normal(0, 3)), float(rng.normal(0, 3)), float(rng.normal(0, 2))) if free else (0.0, 0.0, 0.0)
    part = "palm" if free else _pick(rng, _PARTS)
    return Posture(_pick(rng, _SHAPES), place, part, _way(rng), _way(rng), off, shift)


def _movement(
    rng: np.random.Generator, here: Posture, base: Posture | None, table: dict[str, float], again: bool
) -> Segment:
    """A movement from ``here``: to another place or posture, round, to and fro, or within the hand."""
    kind = _pick(
        rng, {"move": 0.42, "turn": 0.14, "circle": 0.12, "local": 0.14, "shape": 0.08, "zigzag": 0.02, "far": 0.05}
    )
    times = _pick(rng, {1: 0.76, 2: 0.19, 3: 0.05}) if not again else 1
    if kind == "circle":
        path = Path("circle", plane=_pick(rng, {"frontal": 1.0, "sagittal": 1.0, "horizontal": 1.0}))
        turns = float(_pick(rng, {1.0: 0.55, 2.0: 0.25, -1.0: 0.15, -2.0: 0.05}))
        return Segment(
            "M", here, base, Path("circle", plane=path.plane, size=float(rng.uniform(2.0, 4.5)), turns=turns)
        )
    if kind == "local":
        local = _pick(rng, {"wiggle": 0.3, "twist": 0.3, "nod": 0.2, "bend": 0.15, "tremble": 0.05})
        amplitude = {"wiggle": 22.0, "twist": 28.0, "nod": 25.0, "bend": 45.0, "tremble": 0.7}[local]
        return Segment("M", here, base, local=Local(local, amplitude, float(_pick(rng, {1.5: 0.6, 2.5: 0.4}))))
    if kind == "shape":
        return Segment("M", replace(here, shape=_pick(rng, _SHAPES)), base, times=times)
    if kind == "zigzag":
        there = _shifted(rng, here, 12.0)
        return Segment("M", there, base, Path("zigzag", _way(rng), size=float(rng.uniform(2, 4)), turns=2.0))
    if kind == "far":
        there = _posture(rng, _pick(rng, table))
        return Segment("M", replace(there, shape=here.shape), base, _bow(rng))
    there = _shifted(rng, here, float(rng.uniform(3.0, 10.0)))
    if kind == "turn":
        there = replace(_shifted(rng, here, 4.0), palm=_way(rng))
    return Segment("M", there, base, _bow(rng), times=times)


def _bow(rng: np.random.Generator) -> Path:
    return Path("arc", _way(rng), size=float(rng.uniform(1.5, 4.0))) if rng.random() < 0.4 else Path()


def _shifted(rng: np.random.Generator, here: Posture, size: float) -> Posture:
    way = np.array(_way(rng)) * size
    x, y, z = (float(a + b) for a, b in zip(here.shift, way, strict=True))
    return replace(here, shift=(x, y, z))


def _way(rng: np.random.Generator) -> Vector:
    """A direction: one of the six, or midway between two."""
    a, b = (np.array(_SHOWN[rng.integers(6)]) for _ in range(2))
    way = a + b * (rng.random() < 0.4)
    length = float(np.linalg.norm(way))
    x, y, z = (way / length) if length > 0.1 else a
    return float(x), float(y), float(z)


def _pick(rng: np.random.Generator, table: dict[T, float]) -> T:
    names: Sequence[T] = list(table)
    weights = np.array(list(table.values()))
    return names[int(np.searchsorted(np.cumsum(weights / weights.sum()), rng.random()))]


def _at_ease(segment: Segment, hands: str) -> bool:
    """Whether the standard signer's arms reach a segment's posture with every angle within easy limits."""
    if abs(np.dot(segment.strong.palm, segment.strong.fingers)) > 0.9:
        return False
    base = places.weak(segment.weak, STANDARD) if segment.weak is not None else np.zeros(27)
    if segment.weak is None and segment.strong.place.endswith("-weak") and "arm" in segment.strong.place:
        return False
    meets = hands in ("symmetric", "alternating")
    numbers = places.strong(segment.strong, STANDARD, base, meets)
    if not (easy(numbers) and _off_the_body(numbers, meets)):
        return False
    other = numbers if meets else base if segment.weak is not None else resting(STANDARD)[27:54]
    return bool(intrusion(np.concatenate([numbers, other, np.zeros(9)])[None], STANDARD)[0].max() < 0.5)


def easy(numbers: np.ndarray) -> bool:
    """Whether a hand's 27 numbers ask no more than 85 % of any wrist or forearm limit of the standard signer, and a
    place for which the elbow stays bent by 20 degrees or more.
    """
    arm = pose.reach(numbers[pose.WRIST], STANDARD)
    wrist = pose.wrist_angles(arm, numbers[pose.TURN], STANDARD)
    low, high = 0.85 * pose.WRIST_LIMITS.T
    asked = np.array([wrist.deviation, wrist.flexion])
    return bool(
        np.all(asked > low) and np.all(asked < high) and abs(wrist.turn) < 0.85 * pose.FOREARM_LIMIT and arm.bend > 0.35
    )


def _off_the_body(numbers: np.ndarray, meets: bool) -> bool:
    """Whether wrist and knuckles lie before the chest and on the strong side where hands mirror one another."""
    wrist = numbers[pose.WRIST] * MIRROR
    return bool(wrist[2] > 2.0 and (not meets or wrist[0] > 1.0))
