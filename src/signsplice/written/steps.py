"""Motions of a written sign as steps of one hand: how it travels, what it does meanwhile, what it is at the end.

Sizes and bulges, cm, are those of the open player of gestural SiGML (performs), the manner of a motion a factor on the
usual tempo. Vectors are those of the hand: out to its own side.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import reduce

from signsplice.errors import InputError
from signsplice.signer.phonology import LOCALS, Local, Path
from signsplice.signer.tables import Vector, to_vector
from signsplice.written.tree import Motion, Pair, Place, WrittenManner, WrittenPosture, merge_postures
from signsplice.written.vocabulary import cross, direction, dot, facing, plus, unit

_TRAVEL = {"small": 6.0, "": 12.0, "big": 20.0}
_BULGE = {"small": 2.0, "": 6.0, "big": 19.0}
_MOST_BULGE = 0.5
"""The most that a motion bulges, as a fraction of its chord: half a circle."""
_RADIUS = {"small": 2.5, "": 5.0, "big": 10.0}
_ZIGZAG = {"small": 1.5, "": 2.0, "big": 4.0}
_SWING_CM = 5.0
"""How far hands go on in one swing of a zigzag."""
_ELLIPSE = {"small": 0.75, "": 0.5, "big": 0.25}
_ELLIPSE_LETTERS = {"h": "l", "v": "u"}
_WRIST = {"nodding": ("nod", 18.0), "swinging": ("swing", 14.0), "twisting": ("twist", 22.0),
          "stircw": ("stir", 14.0), "stirccw": ("stir", -14.0)}  # fmt: skip
_WRIST_SIZE = {"small": 0.6, "": 1.0, "big": 1.7}
_CYCLES = 3.0
_FAST, _SLOW = 1.5, 0.625
_REST_S, _HALT_S = 0.3, 0.15
_AGAIN = {"fromstart": 1, "fromstart_several": 2, "manyrandom": 2, "continue": 1, "continue_several": 2}
_REBOUND = 0.25
_BASE_SHIFT_CM = 5.0
_STILL: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Step:
    """A step of one hand.

    travel: displacement, cm
    path: its shape
    local: local movement, or None
    target: what is written of the hands at its end, or None
    literal: whether that is written for this hand alone
    tempo: how many times as fast as usual
    pause_s: how long hands then stay
    marks: groups that begin with this step
    back: group to whose beginning the hand returns, or None
    beyond: displacement from there
    brushing: place, or pair of parts, that the hand brushes along
    swaps: whether hands exchange what they are
    anywhere: whether it is a circle of which nothing says where it begins
    """

    travel: Vector = _STILL
    path: Path = field(default_factory=Path)
    local: Local | None = None
    target: WrittenPosture | None = None
    literal: bool = False
    tempo: float = 1.0
    pause_s: float = 0.0
    marks: tuple[int, ...] = ()
    back: int | None = None
    beyond: Vector = _STILL
    brushing: Place | Pair | None = None
    swaps: bool = False
    anywhere: bool = False


@dataclass(frozen=True)
class View:
    """How a hand reads what is written.

    signs: factors on vectors written for the right hand, in this hand's own directions
    which: 0 strong, 1 weak
    literal: whether what is read is written for the weak hand alone
    opposite: whether it goes the other way at a time
    """

    signs: Vector = (1.0, 1.0, 1.0)
    which: int = 0
    literal: bool = False
    opposite: bool = False

    def polar(self, v: Vector) -> Vector:
        """A direction in this hand's own directions."""
        return to_vector(sign * x for sign, x in zip(self.signs, v, strict=True))

    def axis(self, v: Vector) -> Vector:
        """An axis of rotation likewise: a mirror reverses it once more."""
        parity = math.prod(self.signs)
        return to_vector(parity * x for x in self.polar(v))


LITERAL = View((-1.0, 1.0, 1.0), 1, literal=True)
"""A weak hand for which something is written."""


def steps(motion: Motion, view: View, group: int = 0) -> list[Step]:
    """The steps of a motion of one hand. Raises ``InputError`` for what cannot be made."""
    view = replace(view, opposite=view.opposite or (motion.alternating and view.which == 1))
    made = _once(motion, view, 10 * group + 1)
    if motion.target is not None:
        made = made or [Step()]
        made[-1] = replace(made[-1], target=merge_postures(made[-1].target, motion.target), literal=view.literal)
        pair = motion.target.pair
        if motion.target.place is not None or (pair is not None and pair.place is not None):
            made[-1] = replace(made[-1], travel=_STILL)
    made = _apply_manner(made, motion.manner)
    return _repeat_steps(made, motion, view, group) if motion.repeat else made


def _once(motion: Motion, view: View, group: int) -> list[Step]:
    """The steps of a motion without its target, manner and repetition."""
    if motion.kind in ("straight", "circle"):
        made = _straight(motion, view) if motion.kind == "straight" else _circle(motion, view)
        return [replace(made, brushing=motion.brushing or motion.brushing_pair)]
    if motion.kind in _WRIST:
        kind, amplitude = _WRIST[motion.kind]
        return [Step(local=Local(kind, amplitude * _WRIST_SIZE[motion.size], _CYCLES))]
    if motion.kind == "fingerplay":
        return [Step(local=Local("wiggle", LOCALS["wiggle"][0], _CYCLES))]
    if motion.kind in ("posture", "hold", "swap"):
        return [Step(swaps=motion.kind == "swap")]
    if motion.kind == "crossing":
        raise InputError("two strokes that cross (crossmotion) are not known, write them one after the other")
    if motion.kind == "split":
        part = motion.parts[min(view.which, len(motion.parts) - 1)]
        return steps(part, replace(LITERAL, opposite=view.opposite) if view.which else view, group)
    views = [view] * len(motion.parts)
    if motion.kind == "parallel" and any(part.kind == "circle" for part in motion.parts):
        # Hands that circle by turns go the same way meanwhile.
        views = [replace(view, opposite=view.opposite and part.kind != "straight") for part in motion.parts]
    parts = [steps(part, own, 10 * group + n) for n, (part, own) in enumerate(zip(motion.parts, views, strict=True))]
    if motion.kind in ("sequence", "fusion"):
        return [step for part in parts for step in part]
    if motion.kind == "parallel":
        return together(parts)
    raise InputError(f"motion {motion.kind!r} is not known")


def _straight(motion: Motion, view: View) -> Step:
    along = direction(motion.direction)
    size = _TRAVEL[motion.size]
    if motion.size_end:
        size = 0.5 * (size + _TRAVEL[motion.size_end])
    way = -1.0 if view.opposite else 1.0
    travel = view.polar(to_vector(way * size * c for c in along))
    if motion.curve:
        bulge = min(_BULGE[motion.curve_size], _MOST_BULGE * size)
        return Step(travel, Path("arc", view.polar(facing(along, (motion.curve,))), size=bulge))
    if motion.zigzag:
        swings = max(2, round(size / _SWING_CM))
        across = view.polar(facing(along, (motion.ellipse or "l",)))
        return Step(travel, Path("zigzag", across, size=_ZIGZAG[motion.zigzag_size], revolutions=swings))
    return Step(travel)


def _circle(motion: Motion, view: View) -> Step:
    axis = direction(motion.direction)
    start = facing(axis, (motion.start or "u",))
    size, ratio = _RADIUS[motion.size], 1.0
    turns = motion.turns
    if motion.end:
        end = facing(axis, (motion.end,))
        angle = math.atan2(dot(cross(axis, start), end), dot(start, end)) / (2.0 * math.pi)
        turns += angle % 1.0 if angle % 1.0 > 0.02 or turns else 1.0
    if motion.ellipse:
        long = facing(axis, (_ELLIPSE_LETTERS.get(motion.ellipse, motion.ellipse),))
        narrow = _ELLIPSE[motion.ellipse_size]
        if abs(dot(long, start)) > 0.5:
            ratio = narrow
        else:
            size, ratio = narrow * size, 1.0 / narrow
    if view.opposite:
        start = (-start[0], -start[1], -start[2])
    path = Path("circle", view.axis(axis), size=size, revolutions=turns, start=view.polar(start), ratio=ratio)
    return Step(_chord(path), path, anywhere=not (motion.start or motion.end or view.opposite))


def _chord(path: Path) -> Vector:
    """From the beginning of a circle to its end, cm."""
    angle = 2.0 * math.pi * path.revolutions
    across = cross(path.direction, path.start)
    total: Vector = plus(_STILL, path.start, path.size * (math.cos(angle) - 1.0))
    total = plus(total, across, path.size * path.ratio * math.sin(angle))
    return total if unit(total) is not None and math.sqrt(dot(total, total)) > 0.05 else _STILL


def _apply_manner(made: list[Step], manner: WrittenManner) -> list[Step]:
    """Steps made fast, slow, tense, with a rest or a halt after them, or with a rebound."""
    tempo = manner.speed * (_FAST if manner.fast else 1.0) * (_SLOW if manner.slow or manner.tense else 1.0)
    made = [replace(step, tempo=step.tempo * tempo) for step in made]
    if manner.tense:
        made = [s if s.local or s.back is not None else replace(s, local=Local("tremble", 0.4, 3.0)) for s in made]
    if made and manner.bouncing and unit(made[-1].travel) is not None:
        made.append(Step(to_vector(-_REBOUND * x for x in made[-1].travel), tempo=_FAST))
    pause = _REST_S * manner.rest + _HALT_S * manner.halt
    if pause and made:
        made[-1] = replace(made[-1], pause_s=pause)
    return made


def _repeat_steps(made: list[Step], motion: Motion, view: View, group: int) -> list[Step]:
    """Steps as often as the repetition of a motion says, with ways back."""
    if not made:
        return made
    one = made[0]
    made = [replace(one, marks=(*one.marks, group)), *made[1:]]
    whole = len(made) == 1 and unit(one.travel) is None and one.target is None
    if motion.repeat == "swap":
        return [*made, Step(swaps=True)]
    if motion.repeat in ("reverse", "tofroto"):
        return [*made, Step(back=group), *(made if motion.repeat == "tofroto" else ())]
    if motion.repeat not in _AGAIN:
        raise InputError(f"repetition {motion.repeat!r} is not known")
    again = _AGAIN[motion.repeat]
    unmarked = [replace(step, marks=step.marks[:-1] if step is made[0] else step.marks) for step in made]
    if motion.repeat.startswith("continue") or (whole and not motion.shift):
        return made + unmarked * again
    shift = view.polar(direction((motion.shift,))) if motion.shift else _STILL
    out = list(made)
    for n in range(again):
        beyond = plus(_STILL, shift, (n + 1) * _BASE_SHIFT_CM)
        out += [Step(back=group, beyond=beyond), *unmarked]
    return out


def together(parts: Sequence[list[Step]]) -> list[Step]:
    """Steps that are made at the same time, stretched to as many as the longest has."""
    count = max((len(part) for part in parts), default=0)
    return [reduce(_merge_steps, row) for row in zip(*(subdivide_steps(part, count) for part in parts), strict=True)]


def _merge_steps(one: Step, other: Step) -> Step:
    locals_ = one.local or other.local
    if one.local is not None and other.local is not None:
        locals_ = replace(one.local, also=other.local)
    return replace(
        one,
        travel=plus(one.travel, other.travel),
        path=other.path if one.path.kind == "straight" else one.path,
        local=locals_,
        target=merge_postures(one.target, other.target),
        literal=one.literal or other.literal,
        tempo=common_tempo(one.tempo, other.tempo),
        pause_s=max(one.pause_s, other.pause_s),
        marks=(*one.marks, *other.marks),
        back=other.back if one.back is None else one.back,
        beyond=plus(one.beyond, other.beyond),
        brushing=one.brushing or other.brushing,
        swaps=one.swaps or other.swaps,
        anywhere=one.anywhere or other.anywhere,
    )


def common_tempo(one: float, other: float) -> float:
    """The tempo of two motions at the same time: the slower one's, where neither is slow the faster one's."""
    return min(one, other) if min(one, other) < 1.0 else max(one, other)


def subdivide_steps(made: list[Step], count: int) -> list[Step]:
    """Steps as ``count`` steps, at least as many: each is made in even pieces."""
    if not made:
        return [Step()] * count
    pieces = [count // len(made) + (n < count % len(made)) for n in range(len(made))]
    out = []
    for step, n in zip(made, pieces, strict=True):
        if n == 1:
            out.append(step)
            continue
        travel, path, local = to_vector(x / n for x in step.travel), Path(), step.local
        if step.path.kind == "circle":  # whole turns as near as may be
            path = replace(step.path, revolutions=max(1.0, round(step.path.revolutions / n)))
        if local is not None:
            local = replace(local, cycles=max(1.0, local.cycles / n))
        piece = replace(step, travel=travel, path=path, local=local)
        first, last = replace(piece, target=None, pause_s=0.0, back=None, swaps=False), replace(piece, marks=())
        out += [first, *[replace(first, marks=())] * (n - 2), last]
    return out
