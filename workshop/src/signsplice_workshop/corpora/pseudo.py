"""Pseudo-signs: random, well-formed signs without meaning, any number of them by seed, to train networks on.

Hands and places have the frequencies of the lexicon of American Sign Language (ASL-LEX 2.0, Sehyr et al. 2021). They
are drawn once for each sign; only the rest is drawn again until the posture is easy.

| of 2,000 signs | here | ASL-LEX |
| --- | --- | --- |
| one hand | .38 | .39 |
| both hands, symmetric or alternating | .37 | .35 |
| at the other hand, at the first posture | .24 | .25 |
| in neutral space, at the first posture | .35 | .36 |

As in ASL-LEX, few handshapes make up most signs. Kinds of movement follow this package's words in round numbers,
including those that end or begin with a touch. Rare kinds are drawn more often than they occur, so that networks see
all of them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from signsplice.motion import FloatArray
from signsplice.signer import locations, phonology, pose
from signsplice.signer.collisions import hand_clearances
from signsplice.signer.locations import WeakArm, resting
from signsplice.signer.phonology import Local, Path, Posture, Segment, Sign, faults
from signsplice.signer.pose import MIRROR, is_well_within_limits
from signsplice.signer.signer import STANDARD, stream
from signsplice.signer.tables import Vector, sections

T = TypeVar("T")

FREQUENCIES = {
    title: {name: float(weight) for weight, *names in rows for name in names}
    for title, rows in sections(__file__, "frequencies").items()
}
"""The tables of frequencies.txt: weights of names."""
_BASES = (
    Posture("B", "space-low-mid", "palm", (0.0, 1.0, 0.0), (-0.6, 0.0, 0.8)),
    Posture("B", "space-low-mid", "palm", (0.0, -1.0, 0.0), (-0.8, 0.0, 0.6)),
    Posture("S", "space-low-mid", "palm", (0.0, -1.0, 0.0), (-0.7, 0.0, 0.7)),
    Posture("1", "space-mid", "palm", (-1.0, 0.0, 0.0), (-0.2, 0.6, 0.7)),
    Posture("B", "space-mid", "palm", (-1.0, 0.0, 0.0), (0.0, 0.5, 0.85)),
    Posture("B-open", "space-mid", "palm", (0.0, 1.0, 0.0), (-0.5, 0.0, 0.87), shift=(0.0, -6.0, 2.0)),
)
"""Postures of a weak hand at which the strong hand signs."""
_LOCAL_RANGES = {
    **{"wiggle": (18.0, 26.0), "twist": (22.0, 36.0), "nod": (20.0, 34.0), "bend": (40.0, 62.0), "tremble": (0.6, 1.4)},
}
"""Smallest and largest amplitude of local movements: degrees; cm for tremble."""

_NEAR_BODY = 0.4
"""Fraction of the postures at the body that are some centimetres from their location."""
_FAR = 0.35
"""Fraction of the movements away from a touch that end at another location."""
_HELD_BETWEEN = 0.35
"""Fraction of the movements before the last one that end in a hold."""
_SIX_DIRECTIONS = tuple(phonology.DIRECTIONS.values())
_TRIES = 400
_TOUCH_TRIES = 16
"""Touches of one place hardly differ, so that more tries would fail too."""
_BATCH = 16
"""Number of drawn segments that are checked together."""


def draw_sign(seed: int) -> Sign:
    """Returns the pseudo-sign of a seed, ``PSEUDO-<seed>``: without ``phonology.faults``, within reach and joint
    limits.
    """
    rng = stream("pseudo", seed)
    hands, place, course = draw_kind(rng)
    starts = FREQUENCIES[f"locations {_choose_table(hands)} {place}"]
    if course in ("touch", "release"):
        starts = {location: weight for location, weight in starts.items() if location not in phonology.IN_SPACE}
    for _ in range(_TRIES):
        segments = _draw_segments(hands, course, starts, rng)
        drawn_sign = Sign(f"PSEUDO-{seed}", hands, tuple(segments or ()), source="drawn at random", kind="pseudo")
        if segments and not faults(drawn_sign):
            return drawn_sign
    raise RuntimeError(f"no pseudo-sign for seed {seed}")  # does not happen for the first 10,000 seeds


def draw_kind(rng: np.random.Generator) -> tuple[str, str, str]:
    """Returns hands, place and course of a sign, names in ``FREQUENCIES``. They are drawn once, not in each try, so
    that those with few easy postures do not become rare.
    """
    hands = _pick(rng, FREQUENCIES["hands"])
    place = _pick(rng, FREQUENCIES[f"places {_choose_table(hands)}"])
    course = _pick(rng, FREQUENCIES["courses"])
    return hands, place, "free" if place == "neutral" and course != "still" else course


def _choose_table(hands: str) -> str:
    return "symmetric" if hands == "alternating" else hands


def _collect_locations(hands: str) -> dict[str, float]:
    """Returns the locations of all places where such signs are made, with their frequencies."""
    table = _choose_table(hands)
    place_weights = {place: FREQUENCIES[f"locations {table} {place}"] for place in FREQUENCIES[f"places {table}"]}
    return {
        location: fraction * weight / sum(place_weights[place].values())
        for place, fraction in FREQUENCIES[f"places {table}"].items()
        for location, weight in place_weights[place].items()
    }


def _draw_segments(hands: str, course: str, starts: dict[str, float], rng: np.random.Generator) -> list[Segment] | None:
    """Returns segments with easy postures, drawn one by one; None if one could not be drawn."""
    table = _collect_locations(hands)
    base = _draw_base(rng) if hands == "base" else None
    hold_probability = {"free": 0.22, "touch": 0.15, "release": 0.70, "still": 1.0}[course]
    first_kind = "H" if rng.random() < hold_probability else "X"
    segments: list[Segment] = []

    def add(draw: Callable[[], Segment], tries: int = _TRIES) -> bool:
        for _ in range(max(1, tries // _BATCH)):
            segment = _find_easy_segment([draw() for _ in range(_BATCH)], hands)
            if segment is not None:
                segments.append(segment)
                return True
        return False

    def draw_first() -> Segment:
        start = _draw_posture(rng, _pick(rng, starts))
        if course == "touch":
            start = _shift_posture(rng, replace(start, off=float(rng.uniform(3.0, 8.0))), float(rng.uniform(0.0, 3.0)))
        return Segment(first_kind, replace(start, off=0.0) if course == "release" else start, base)

    if not add(draw_first):
        return None
    if course == "still":
        return segments
    n_movements = _pick(rng, {1: 0.66, 2: 0.20, 3: 0.10, 4: 0.04})
    for n in range(n_movements):
        start, is_later = segments[-1].strong, n > 0
        if n == 0 and course == "touch":
            draw = partial(_draw_touch, rng, start, base)
        elif n == 0 and course == "release":
            draw = partial(_draw_release, rng, start, base, table)
        else:
            draw = partial(_draw_movement, rng, start, segments[-1].weak, table, is_later=is_later)
        if not add(draw, _TOUCH_TRIES if n == 0 and course == "touch" else _TRIES):
            return None
        if n + 1 < n_movements and rng.random() < _HELD_BETWEEN:
            segments.append(Segment("H", segments[-1].strong, segments[-1].weak))
    if rng.random() < (0.64 if course == "touch" else 0.42) and segments[-1].kind == "M":
        segments.append(Segment("H", segments[-1].strong, segments[-1].weak))
    return segments


def _draw_base(rng: np.random.Generator) -> Posture:
    """Returns the posture of a weak hand at which the strong hand signs."""
    base = _BASES[rng.integers(len(_BASES))]
    return replace(base, shape=_pick(rng, FREQUENCIES["shapes"])) if rng.random() < 0.35 else base


def _draw_touch(rng: np.random.Generator, start: Posture, base: Posture | None) -> Segment:
    """Returns a movement that ends in a touch, or in several, one after another."""
    end = replace(start, off=0.0, shift=(0.0, 0.0, 0.0))
    if rng.random() < 0.15:
        end = replace(end, palm=_draw_direction(rng))
    path = _draw_arc(rng) if rng.random() < 0.4 else Path()
    return Segment("M", end, base, path, times=_pick(rng, {1: 0.55, 2: 0.35, 3: 0.10}))


def _draw_release(rng: np.random.Generator, start: Posture, base: Posture | None, table: dict[str, float]) -> Segment:
    """Returns a movement away from a touch, a little or to another location; handshape and palm may change on it."""
    if rng.random() < _FAR:
        end = replace(_draw_posture(rng, _pick(rng, table)), shape=start.shape)
    else:
        end = _shift_posture(rng, replace(start, off=float(rng.uniform(3.0, 13.0))), float(rng.uniform(0.0, 5.0)))
    if rng.random() < 0.3:
        end = replace(end, shape=_pick(rng, FREQUENCIES["shapes"]))
    if rng.random() < 0.25:
        end = replace(end, palm=_draw_direction(rng))
    return Segment("M", end, base, _draw_arc(rng), times=_pick(rng, {1: 0.85, 2: 0.15}))


def _draw_posture(rng: np.random.Generator, location: str) -> Posture:
    neutral = location in phonology.NEUTRAL
    off = 0.0 if neutral or rng.random() < 0.7 else float(rng.uniform(2.0, 4.0))
    shift = (0.0, 0.0, 0.0)
    if neutral:
        shift = float(rng.normal(0, 3)), float(rng.normal(0, 3)), float(rng.normal(0, 2))
    elif rng.random() < _NEAR_BODY:
        x, y, z = rng.normal(0.0, (2.5, 2.5, 1.0)) * (rng.random(3) < 0.6)
        shift = float(x), float(y), float(z)
    part = "palm" if neutral else _pick(rng, FREQUENCIES["parts"])
    return Posture(
        _pick(rng, FREQUENCIES["shapes"]), location, part, _draw_direction(rng), _draw_direction(rng), off, shift
    )


def _draw_movement(
    rng: np.random.Generator, start: Posture, base: Posture | None, table: dict[str, float], is_later: bool
) -> Segment:
    """Returns a movement from ``start``: to another location or posture, in a circle, a zigzag, a long diagonal, within
    the hand, or with the base.
    """
    movement = _pick(rng, FREQUENCIES["movements"])
    if movement == "base" and base is None:
        movement = "move"
    times = _pick(rng, {1: 0.76, 2: 0.19, 3: 0.05}) if not is_later else 1
    if movement == "circle":
        plane = _pick(rng, {"frontal": 1.0, "sagittal": 1.0, "horizontal": 1.0})
        revolutions = float(_pick(rng, {1.0: 0.50, 2.0: 0.28, 3.0: 0.02, -1.0: 0.15, -2.0: 0.05}))
        path = Path("circle", plane=plane, size=float(rng.uniform(1.5, 4.5)), revolutions=revolutions)
        return Segment("M", start, base, path)
    if movement == "local":
        local = _pick(rng, {"wiggle": 0.25, "twist": 0.35, "nod": 0.17, "bend": 0.15, "tremble": 0.08})
        cycles = _pick(rng, {1.5: 0.25, 2.0: 0.35, 2.5: 0.15, 3.0: 0.2, 5.0: 0.05})
        return Segment("M", start, base, local=Local(local, float(rng.uniform(*_LOCAL_RANGES[local])), cycles))
    if movement == "shape":
        times = _pick(rng, {1: 0.5, 2: 0.3, 3: 0.2})
        return Segment("M", replace(start, shape=_pick(rng, FREQUENCIES["shapes"])), base, times=times)
    if movement == "zigzag":
        end = start if rng.random() < 0.5 else _shift_posture(rng, start, float(rng.uniform(5.0, 12.0)))
        swings = float(_pick(rng, {2.0: 0.5, 3.0: 0.4, 4.0: 0.1}))
        path = Path("zigzag", _draw_direction(rng), size=float(rng.uniform(1.0, 7.0)), revolutions=swings)
        return Segment("M", end, base, path)
    if movement == "slash":
        distance = rng.uniform(0.4, 1.0, 3) * (-1.0, -1.0, 0.3) * rng.uniform(10.0, 24.0)
        x, y, z = np.array(start.shift) + distance * (rng.choice((-1.0, 1.0)), 1.0, 1.0)
        end = replace(start, shift=(float(x), float(y), float(z)), palm=_draw_direction(rng))
        return Segment("M", end, base, _draw_arc(rng))
    if movement == "base" and base is not None:
        if rng.random() < 0.3:  # both hands turn over, one at the other
            return Segment(
                "M", replace(start, palm=_draw_direction(rng)), replace(base, palm=_draw_direction(rng)), times=times
            )
        # Both hands move together, or the base alone; it may turn over.
        moved_base = _shift_posture(rng, base, float(rng.uniform(3.0, 9.0)))
        if rng.random() < 0.25:
            moved_base = replace(moved_base, palm=_draw_direction(rng))
        return Segment("M", start, moved_base, _draw_arc(rng), times=times)
    if movement == "far":
        end = _draw_posture(rng, _pick(rng, table))
        return Segment("M", replace(end, shape=start.shape), base, _draw_arc(rng))
    end = _shift_posture(rng, start, float(rng.uniform(3.0, 14.0)))
    if movement == "rotation":
        end = replace(_shift_posture(rng, start, float(rng.uniform(0.0, 5.0))), palm=_draw_direction(rng))
    if rng.random() < 0.1:
        end = replace(end, shape=_pick(rng, FREQUENCIES["shapes"]))
    return Segment("M", end, base, _draw_arc(rng), times=times)


def _draw_arc(rng: np.random.Generator) -> Path:
    return Path("arc", _draw_direction(rng), size=float(rng.uniform(1.5, 4.0))) if rng.random() < 0.4 else Path()


def _shift_posture(rng: np.random.Generator, posture: Posture, size: float) -> Posture:
    offset = np.array(_draw_direction(rng)) * size
    x, y, z = (float(a + b) for a, b in zip(posture.shift, offset, strict=True))
    return replace(posture, shift=(x, y, z))


def _draw_direction(rng: np.random.Generator) -> Vector:
    """Returns a unit vector: one of the six directions, or midway between two."""
    a, b = (np.array(_SIX_DIRECTIONS[rng.integers(6)]) for _ in range(2))
    direction = a + b * (rng.random() < 0.4)
    length = float(np.linalg.norm(direction))
    x, y, z = (direction / length) if length > 0.1 else a
    return float(x), float(y), float(z)


def _pick(rng: np.random.Generator, table: dict[T, float]) -> T:
    names: Sequence[T] = list(table)
    weights = np.array(list(table.values()))
    return names[int(np.searchsorted(np.cumsum(weights / weights.sum()), rng.random()))]


def _find_easy_segment(segments: Sequence[Segment], hands: str) -> Segment | None:
    """Returns the first segment whose posture the standard signer's arms reach with every angle well within its limits
    and without a hand in the body; None if there is none.
    """
    mirrored = hands in ("symmetric", "alternating")
    arms = {segment.weak: _solve_weak_arm(segment.weak) for segment in segments}
    reachable = [
        segment
        for segment in segments
        if abs(np.dot(segment.strong.palm, segment.strong.fingers)) <= 0.9 and not _is_out_of_reach(segment)
    ]
    if not reachable:
        return None
    solved = [locations.strong_wrist(segment.strong, arms[segment.weak], mirrored) for segment in reachable]
    wrists, quats, angles = (np.stack(parts) for parts in zip(*solved, strict=True))
    hand_states = np.concatenate([wrists, pose.hand_rotvecs(wrists, quats, STANDARD), angles], axis=-1)
    chosen = np.flatnonzero(is_well_within_limits(hand_states) & _is_in_front(hand_states, mirrored))
    if not len(chosen):
        return None
    rest = resting(STANDARD)[27:54]
    weak = [rest if reachable[k].weak is None else arms[reachable[k].weak].hand for k in chosen]
    strong = hand_states[chosen]
    states = pose.of_hands(strong, strong if mirrored else np.array(weak))
    body_and_hand = hand_clearances(states, STANDARD)[:, [0, 1, 3]]  # arms are cleared afterwards
    clear = np.flatnonzero(body_and_hand.min(axis=1) > -0.5)
    return reachable[chosen[clear[0]]] if len(clear) else None


def _solve_weak_arm(posture: Posture | None) -> WeakArm:
    return WeakArm(STANDARD, np.zeros(27) if posture is None else locations.weak_hand(posture, STANDARD))


def _is_out_of_reach(segment: Segment) -> bool:
    """Returns whether the segment is at a weak arm that hangs."""
    return segment.weak is None and segment.strong.location == "forearm-weak"


def _is_in_front(hand_states: FloatArray, mirrored: bool) -> NDArray[np.bool_]:
    """Returns whether wrists are in front of the chest, and on the strong side if hands mirror each other."""
    wrists = hand_states[..., pose.WRIST] * MIRROR
    return np.asarray((wrists[..., 2] > 2.0) & ((wrists[..., 0] > 1.0) | (not mirrored)))
