"""Pseudo-signs: random and lawful, any number by seed, for data of any size. They mean nothing.

Frequencies follow what is known of American Sign Language's lexicon in round numbers: about half of the signs use one
hand, few handshapes carry most signs, neutral space and face are the commonest places (ASL-LEX 2.0, Sehyr et al. 2021).
Kinds of movement are those of the lexicon that ships, touching and parting among them, in round numbers too; rare kinds
are drawn more often than they are met, so that what learns from pseudo-signs has seen all.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from signsplice.synth import locations, pose
from signsplice.synth.avoidance import intrusion
from signsplice.synth.locations import MIRROR
from signsplice.synth.phonology import (
    DIRECTIONS,
    IN_SPACE,
    NEUTRAL,
    Local,
    Path,
    Posture,
    Segment,
    Sign,
    Vector,
    faults,
)
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
    **dict.fromkeys(("crown", "under-chin", "cheek-weak", "chin-weak", "waist", "upper-arm-weak", "above-head"), 1.0),
}
_MIRRORED_PLACES = {
    **{"space": 5.0, "space-mid": 5.0, "space-out": 2.0, "space-low": 2.0, "space-high": 2.0, "space-low-mid": 1.5},
    **dict.fromkeys(("chest-strong", "cheek", "temple", "waist"), 0.7),
}
_BASE_PLACES = {
    **{"base-palm": 5.0, "base-back": 3.0, "base-radial": 2.0, "base-fingertips": 1.0, "base-index": 1.0},
    **{"base-wrist": 1.0, "forearm-weak": 1.0, "base-fingers": 1.0},
    **dict.fromkeys(("base-ulnar", "base-heel", "base-fingers-back"), 0.5),
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
    Posture("B-open", "space-mid", "palm", (0.0, 1.0, 0.0), (-0.5, 0.0, 0.87), shift=(0.0, -6.0, 2.0)),
)
_MANNERS = {"free": 0.70, "touch": 0.16, "part": 0.10, "still": 0.04}
"""How a sign is made: it moves freely; comes to touch the body or its fellow, once or more; begins there, mostly in a
touch, and parts from it; or is a posture alone.
"""
_MOVEMENTS = {
    **{"move": 0.36, "turn": 0.12, "circle": 0.11, "local": 0.13, "shape": 0.09, "zigzag": 0.05, "far": 0.06},
    **{"base": 0.04, "slash": 0.04},
}
_LOCAL_RANGES = {
    **{"wiggle": (18.0, 26.0), "twist": (22.0, 36.0), "nod": (20.0, 34.0), "bend": (40.0, 62.0), "tremble": (0.6, 1.4)},
}
_ASIDE = 0.4
"""Share of the postures at the body that are not right at their place but some centimetres from it."""
_AWAY = 0.35
"""Share of the partings that go to another place."""
_ELSEWHERE = 0.12
"""Share of the signs with a base that do not begin at it."""
_SHOWN = tuple(DIRECTIONS.values())
_TRIES = 400
_AT_ONCE = 16
"""Draws that are looked at together."""


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
    base = _base(rng) if hands == "base" else None
    begins = _PLACES if hands == "base" and rng.random() < _ELSEWHERE else table
    manner = _pick(rng, _MANNERS)
    if manner in ("touch", "part"):
        begins = {place: weight for place, weight in begins.items() if place not in IN_SPACE}
    held = {"free": 0.22, "touch": 0.15, "part": 0.70, "still": 1.0}[manner]
    first = "H" if rng.random() < held else "X"
    segments: list[Segment] = []

    def add(draw: Callable[[], Segment]) -> bool:
        for _ in range(_TRIES // _AT_ONCE):
            found = _at_ease([draw() for _ in range(_AT_ONCE)], hands)
            if found is not None:
                segments.append(found)
                return True
        return False

    def begin() -> Segment:
        here = _posture(rng, _pick(rng, begins))
        if manner == "touch":
            here = _shifted(rng, replace(here, off=float(rng.uniform(3.0, 8.0))), float(rng.uniform(0.0, 3.0)))
        return Segment(first, replace(here, off=0.0) if manner == "part" else here, base)

    if not add(begin):
        return None
    if manner == "still":
        return segments
    for n in range(_pick(rng, {1: 0.77, 2: 0.14, 3: 0.07, 4: 0.02})):
        here, again = segments[-1].strong, n > 0
        if n == 0 and manner == "touch":
            draw = partial(_touch, rng, here, base)
        elif n == 0 and manner == "part":
            draw = partial(_part, rng, here, base, table)
        else:
            draw = partial(_movement, rng, here, segments[-1].weak, table, again=again)
        if not add(draw):
            return None
        if n == 0 and rng.random() < 0.1:
            segments.append(Segment("H", segments[-1].strong, segments[-1].weak))
    if rng.random() < (0.60 if manner == "touch" else 0.36) and segments[-1].kind == "M":
        segments.append(Segment("H", segments[-1].strong, segments[-1].weak))
    return segments


def _base(rng: np.random.Generator) -> Posture:
    """How the weak hand is held that the other signs at."""
    base = _BASES[rng.integers(len(_BASES))]
    return replace(base, shape=_pick(rng, _SHAPES)) if rng.random() < 0.35 else base


def _touch(rng: np.random.Generator, here: Posture, base: Posture | None) -> Segment:
    """A movement that ends in a touch, or in several, one after another."""
    there = replace(here, off=0.0, shift=(0.0, 0.0, 0.0))
    if rng.random() < 0.15:
        there = replace(there, palm=_way(rng))
    path = _bow(rng) if rng.random() < 0.4 else Path()
    return Segment("M", there, base, path, times=_pick(rng, {1: 0.55, 2: 0.35, 3: 0.10}))


def _part(rng: np.random.Generator, here: Posture, base: Posture | None, table: dict[str, float]) -> Segment:
    """A movement away from a touch, a little or to another place, the hand changed or turned by the way or not."""
    if rng.random() < _AWAY:
        there = replace(_posture(rng, _pick(rng, table)), shape=here.shape)
    else:
        there = _shifted(rng, replace(here, off=float(rng.uniform(3.0, 13.0))), float(rng.uniform(0.0, 5.0)))
    if rng.random() < 0.3:
        there = replace(there, shape=_pick(rng, _SHAPES))
    if rng.random() < 0.25:
        there = replace(there, palm=_way(rng))
    return Segment("M", there, base, _bow(rng), times=_pick(rng, {1: 0.85, 2: 0.15}))


def _posture(rng: np.random.Generator, place: str) -> Posture:
    free = place in NEUTRAL
    off = 0.0 if free or rng.random() < 0.7 else float(rng.uniform(2.0, 4.0))
    shift = (0.0, 0.0, 0.0)
    if free:
        shift = float(rng.normal(0, 3)), float(rng.normal(0, 3)), float(rng.normal(0, 2))
    elif rng.random() < _ASIDE:
        x, y, z = rng.normal(0.0, (2.5, 2.5, 1.0)) * (rng.random(3) < 0.6)
        shift = float(x), float(y), float(z)
    part = "palm" if free else _pick(rng, _PARTS)
    return Posture(_pick(rng, _SHAPES), place, part, _way(rng), _way(rng), off, shift)


def _movement(
    rng: np.random.Generator, here: Posture, base: Posture | None, table: dict[str, float], again: bool
) -> Segment:
    """A movement from ``here``: to another place or posture, round, to and fro, far down, within the hand, or with the
    base.
    """
    kind = _pick(rng, _MOVEMENTS)
    if kind == "base" and base is None:
        kind = "move"
    times = _pick(rng, {1: 0.76, 2: 0.19, 3: 0.05}) if not again else 1
    if kind == "circle":
        plane = _pick(rng, {"frontal": 1.0, "sagittal": 1.0, "horizontal": 1.0})
        turns = float(_pick(rng, {1.0: 0.50, 2.0: 0.28, 3.0: 0.02, -1.0: 0.15, -2.0: 0.05}))
        return Segment(
            "M", here, base, Path("circle", plane=plane, size=float(rng.uniform(1.5, 4.5)), revolutions=turns)
        )
    if kind == "local":
        local = _pick(rng, {"wiggle": 0.25, "twist": 0.35, "nod": 0.17, "bend": 0.15, "tremble": 0.08})
        cycles = _pick(rng, {1.5: 0.25, 2.0: 0.35, 2.5: 0.15, 3.0: 0.2, 5.0: 0.05})
        return Segment("M", here, base, local=Local(local, float(rng.uniform(*_LOCAL_RANGES[local])), cycles))
    if kind == "shape":
        times = _pick(rng, {1: 0.5, 2: 0.3, 3: 0.2})
        return Segment("M", replace(here, shape=_pick(rng, _SHAPES)), base, times=times)
    if kind == "zigzag":
        there = here if rng.random() < 0.5 else _shifted(rng, here, float(rng.uniform(5.0, 12.0)))
        turns = float(_pick(rng, {2.0: 0.5, 3.0: 0.4, 4.0: 0.1}))
        return Segment(
            "M", there, base, Path("zigzag", _way(rng), size=float(rng.uniform(1.0, 4.0)), revolutions=turns)
        )
    if kind == "slash":
        far = rng.uniform(0.4, 1.0, 3) * (-1.0, -1.0, 0.3) * rng.uniform(10.0, 24.0)
        x, y, z = np.array(here.shift) + far * (rng.choice((-1.0, 1.0)), 1.0, 1.0)
        return Segment("M", replace(here, shift=(float(x), float(y), float(z)), palm=_way(rng)), base, _bow(rng))
    if kind == "base" and base is not None:
        if rng.random() < 0.3:  # both hands turn over, one at the other
            return Segment("M", replace(here, palm=_way(rng)), replace(base, palm=_way(rng)), times=times)
        # Both hands go together, or the base alone; it may turn over.
        moved = _shifted(rng, base, float(rng.uniform(3.0, 9.0)))
        if rng.random() < 0.25:
            moved = replace(moved, palm=_way(rng))
        return Segment("M", here, moved, _bow(rng), times=times)
    if kind == "far":
        there = _posture(rng, _pick(rng, table))
        return Segment("M", replace(there, shape=here.shape), base, _bow(rng))
    there = _shifted(rng, here, float(rng.uniform(3.0, 14.0)))
    if kind == "turn":
        there = replace(_shifted(rng, here, float(rng.uniform(0.0, 5.0))), palm=_way(rng))
    if rng.random() < 0.1:
        there = replace(there, shape=_pick(rng, _SHAPES))
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


def _at_ease(segments: Sequence[Segment], hands: str) -> Segment | None:
    """The first of some segments whose posture the standard signer's arms reach with every angle within easy limits,
    and without a hand in the body; None where there is none.
    """
    meets = hands in ("symmetric", "alternating")
    bases = {s.weak: np.zeros(27) if s.weak is None else locations.weak(s.weak, STANDARD) for s in segments}
    lawful = [s for s in segments if abs(np.dot(s.strong.palm, s.strong.fingers)) <= 0.9 and not _out_of_reach(s)]
    if not lawful:
        return None
    held = [locations.strong_at(s.strong, STANDARD, bases[s.weak], meets) for s in lawful]
    wrists, turned, angles = (np.stack(parts) for parts in zip(*held, strict=True))
    numbers = np.concatenate([wrists, pose.turn_of(wrists, turned, STANDARD), angles], axis=-1)
    for k in np.flatnonzero(easy(numbers) & _off_the_body(numbers, meets)):
        other = bases[lawful[k].weak] if lawful[k].weak is not None else resting(STANDARD)[27:54]
        state = np.concatenate([numbers[k], numbers[k] if meets else other, np.zeros(9)])
        if intrusion(state[None], STANDARD)[0].max() < 0.5:
            return lawful[k]
    return None


def _out_of_reach(segment: Segment) -> bool:
    """Whether it is at a weak arm that hangs."""
    return segment.weak is None and segment.strong.place == "forearm-weak"


def easy(numbers: np.ndarray) -> NDArray[np.bool_]:
    """Whether a hand's numbers (..., 27) ask no more than 85 % of any wrist or forearm limit of the standard signer,
    and a place for which the elbow stays bent by 20 degrees or more.
    """
    arm = pose.reach(numbers[..., pose.WRIST], STANDARD)
    wrist = pose.wrist_angles(arm, numbers[..., pose.TURN], STANDARD)
    low, high = 0.85 * pose.WRIST_LIMITS.T
    asked = np.stack([wrist.deviation, wrist.flexion], axis=-1)
    bent = np.all((asked > low) & (asked < high), axis=-1)
    return np.asarray(bent & (np.abs(wrist.turn) < 0.85 * pose.FOREARM_LIMIT) & (arm.bend > 0.35))


def _off_the_body(numbers: np.ndarray, meets: bool) -> NDArray[np.bool_]:
    """Whether wrists lie before the chest, and on the strong side where hands mirror one another."""
    wrists = numbers[..., pose.WRIST] * MIRROR
    return np.asarray((wrists[..., 2] > 2.0) & ((wrists[..., 0] > 1.0) | (not meets)))
