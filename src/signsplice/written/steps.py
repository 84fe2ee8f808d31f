"""Splits the motions of a written sign into steps of one hand: its travel, its local movement, its final posture.

Sizes and bulges, cm, follow the open player of gestural SiGML (performs). The manner of a motion is a factor on the
usual tempo. Vectors are in the hand's own axes: out points to its own side.
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


@dataclass(frozen=True)
class MotionSettings:
    """Sizes and tempos of motions that their descriptions leave open."""

    largest_bulge: float = 0.5
    """Largest bulge of a curve, as a fraction of the chord: half a circle."""
    swing_cm: float = 5.0
    """Advance of the hand in one swing of a zigzag, cm."""
    local_cycles: float = 3.0
    """Cycles of a local movement."""
    fast_tempo: float = 1.5
    """Factor on the tempo of a fast motion."""
    slow_tempo: float = 0.625
    """Factor on the tempo of a slow or tense motion."""
    rest_s: float = 0.3
    """Pause of a rest, seconds."""
    halt_s: float = 0.15
    """Pause of a halt, seconds."""
    rebound: float = 0.25
    """Length of a rebound, as a fraction of the motion."""
    repetition_shift_cm: float = 5.0
    """Shift of each pass of a shifted repetition, cm."""


_MOTIONS = MotionSettings()

_STRAIGHT_CM = {"small": 6.0, "": 12.0, "big": 20.0}
"""Size -> length of a straight motion, cm."""
_BULGE_CM = {"small": 2.0, "": 6.0, "big": 19.0}
"""Size -> bulge of a curve, cm."""
_RADIUS_CM = {"small": 2.5, "": 5.0, "big": 10.0}
"""Size -> radius of a circle, cm."""
_ZIGZAG_CM = {"small": 1.5, "": 2.0, "big": 4.0}
"""Size -> size of a zigzag, cm."""
_ELLIPSE_RATIO = {"small": 0.75, "": 0.5, "big": 0.25}
"""Size -> ratio of the short to the long axis of an ellipse."""
_ELLIPSE_LETTERS = {"h": "l", "v": "u"}
"""Direction of an ellipse's long axis -> letter."""
_WRIST_MOTIONS = {"nodding": ("nod", 18.0), "swinging": ("swing", 14.0), "twisting": ("twist", 22.0),
                  "stircw": ("stir", 14.0), "stirccw": ("stir", -14.0)}  # fmt: skip
"""Wrist motion -> local movement and amplitude, degrees."""
_WRIST_SIZES = {"small": 0.6, "": 1.0, "big": 1.7}
"""Size -> factor on the amplitude of a wrist motion."""
_N_REPETITIONS = {"fromstart": 1, "fromstart_several": 2, "manyrandom": 2, "continue": 1, "continue_several": 2}
"""Kind of repetition -> number of further passes."""
_NO_TRAVEL: Vector = (0.0, 0.0, 0.0)
"""No travel."""


@dataclass(frozen=True)
class Step:
    """A step of one hand.

    travel: displacement, cm
    path: shape of its path
    local: local movement, or None
    target: written posture at its end, or None
    literal: whether ``target`` is written for this hand alone
    tempo: factor on the usual tempo
    pause_s: pause after the step, seconds
    marks: groups that begin with this step
    back: group to whose beginning the hand returns, or None
    beyond: displacement from that beginning, cm
    brushing: place, or pair of parts, along which the hand brushes
    swaps: whether the hands swap
    anywhere: whether it is a circle without a written start
    """

    travel: Vector = _NO_TRAVEL
    path: Path = field(default_factory=Path)
    local: Local | None = None
    target: WrittenPosture | None = None
    literal: bool = False
    tempo: float = 1.0
    pause_s: float = 0.0
    marks: tuple[int, ...] = ()
    back: int | None = None
    beyond: Vector = _NO_TRAVEL
    brushing: Place | Pair | None = None
    swaps: bool = False
    anywhere: bool = False


@dataclass(frozen=True)
class View:
    """How a hand interprets written motions.

    signs: factors that convert vectors written for the right hand to this hand's own axes
    which: 0 strong, 1 weak
    literal: whether the motion is written for the weak hand alone
    opposite: whether the hand moves in the opposite phase
    """

    signs: Vector = (1.0, 1.0, 1.0)
    which: int = 0
    literal: bool = False
    opposite: bool = False

    def polar(self, v: Vector) -> Vector:
        """Converts a direction to this hand's own axes."""
        return to_vector(sign * x for sign, x in zip(self.signs, v, strict=True))

    def axis(self, v: Vector) -> Vector:
        """Converts an axis of rotation, which a mirror also reverses."""
        parity = math.prod(self.signs)
        return to_vector(parity * x for x in self.polar(v))


LITERAL = View((-1.0, 1.0, 1.0), 1, literal=True)
"""The view of a weak hand with a motion of its own."""


def steps(motion: Motion, view: View, group: int = 0) -> list[Step]:
    """Returns the steps of one hand in a motion. Raises ``InputError`` if the motion is not supported."""
    view = replace(view, opposite=view.opposite or (motion.alternating and view.which == 1))
    hand_steps = _once(motion, view, 10 * group + 1)
    if motion.target is not None:
        hand_steps = hand_steps or [Step()]
        hand_steps[-1] = replace(
            hand_steps[-1], target=merge_postures(hand_steps[-1].target, motion.target), literal=view.literal
        )
        pair = motion.target.pair
        if motion.target.place is not None or (pair is not None and pair.place is not None):
            hand_steps[-1] = replace(hand_steps[-1], travel=_NO_TRAVEL)
    hand_steps = _apply_manner(hand_steps, motion.manner)
    return _repeat_steps(hand_steps, motion, view, group) if motion.repeat else hand_steps


def _once(motion: Motion, view: View, group: int) -> list[Step]:
    """Returns the steps of a motion without its target, manner and repetition."""
    if motion.kind in ("straight", "circle"):
        path_step = _straight(motion, view) if motion.kind == "straight" else _circle(motion, view)
        return [replace(path_step, brushing=motion.brushing or motion.brushing_pair)]
    if motion.kind in _WRIST_MOTIONS:
        kind, amplitude = _WRIST_MOTIONS[motion.kind]
        return [Step(local=Local(kind, amplitude * _WRIST_SIZES[motion.size], _MOTIONS.local_cycles))]
    if motion.kind == "fingerplay":
        return [Step(local=Local("wiggle", LOCALS["wiggle"][0], _MOTIONS.local_cycles))]
    if motion.kind in ("posture", "hold", "swap"):
        return [Step(swaps=motion.kind == "swap")]
    if motion.kind == "crossing":
        raise InputError("two strokes that cross (crossmotion) are not known, write them one after the other")
    if motion.kind == "split":
        part = motion.parts[min(view.which, len(motion.parts) - 1)]
        return steps(part, replace(LITERAL, opposite=view.opposite) if view.which else view, group)
    views = [view] * len(motion.parts)
    if motion.kind == "parallel" and any(part.kind == "circle" for part in motion.parts):
        # Hands that circle in alternation still travel in the same direction.
        views = [replace(view, opposite=view.opposite and part.kind != "straight") for part in motion.parts]
    parts = [
        steps(part, part_view, 10 * group + n)
        for n, (part, part_view) in enumerate(zip(motion.parts, views, strict=True))
    ]
    if motion.kind in ("sequence", "fusion"):
        return [step for part in parts for step in part]
    if motion.kind == "parallel":
        return together(parts)
    raise InputError(f"motion {motion.kind!r} is not known")


def _straight(motion: Motion, view: View) -> Step:
    heading = direction(motion.direction)
    size = _STRAIGHT_CM[motion.size]
    if motion.size_end:
        size = 0.5 * (size + _STRAIGHT_CM[motion.size_end])
    sign = -1.0 if view.opposite else 1.0
    travel = view.polar(to_vector(sign * size * c for c in heading))
    if motion.curve:
        bulge = min(_BULGE_CM[motion.curve_size], _MOTIONS.largest_bulge * size)
        return Step(travel, Path("arc", view.polar(facing(heading, (motion.curve,))), size=bulge))
    if motion.zigzag:
        swings = max(2, round(size / _MOTIONS.swing_cm))
        swing_axis = view.polar(facing(heading, (motion.ellipse or "l",)))
        return Step(travel, Path("zigzag", swing_axis, size=_ZIGZAG_CM[motion.zigzag_size], revolutions=swings))
    return Step(travel)


def _circle(motion: Motion, view: View) -> Step:
    axis = direction(motion.direction)
    start = facing(axis, (motion.start or "u",))
    size, ratio = _RADIUS_CM[motion.size], 1.0
    turns = motion.turns
    if motion.end:
        end = facing(axis, (motion.end,))
        angle = math.atan2(dot(cross(axis, start), end), dot(start, end)) / (2.0 * math.pi)
        turns += angle % 1.0 if angle % 1.0 > 0.02 or turns else 1.0
    if motion.ellipse:
        long = facing(axis, (_ELLIPSE_LETTERS.get(motion.ellipse, motion.ellipse),))
        narrow = _ELLIPSE_RATIO[motion.ellipse_size]
        if abs(dot(long, start)) > 0.5:
            ratio = narrow
        else:
            size, ratio = narrow * size, 1.0 / narrow
    if view.opposite:
        start = (-start[0], -start[1], -start[2])
    path = Path("circle", view.axis(axis), size=size, revolutions=turns, start=view.polar(start), ratio=ratio)
    return Step(_chord(path), path, anywhere=not (motion.start or motion.end or view.opposite))


def _chord(path: Path) -> Vector:
    """Returns the vector from the start of a circle to its end, cm."""
    angle = 2.0 * math.pi * path.revolutions
    sideways = cross(path.direction, path.start)
    total: Vector = plus(_NO_TRAVEL, path.start, path.size * (math.cos(angle) - 1.0))
    total = plus(total, sideways, path.size * path.ratio * math.sin(angle))
    return total if unit(total) is not None and math.sqrt(dot(total, total)) > 0.05 else _NO_TRAVEL


def _apply_manner(hand_steps: list[Step], manner: WrittenManner) -> list[Step]:
    """Applies a manner to steps: tempo, tension, a rebound, and a rest or halt at the end."""
    fast = _MOTIONS.fast_tempo if manner.fast else 1.0
    slow = _MOTIONS.slow_tempo if manner.slow or manner.tense else 1.0
    tempo = manner.speed * fast * slow
    hand_steps = [replace(step, tempo=step.tempo * tempo) for step in hand_steps]
    if manner.tense:
        hand_steps = [
            s if s.local or s.back is not None else replace(s, local=Local("tremble", 0.4, 3.0)) for s in hand_steps
        ]
    if hand_steps and manner.bouncing and unit(hand_steps[-1].travel) is not None:
        travel = to_vector(-_MOTIONS.rebound * x for x in hand_steps[-1].travel)
        hand_steps.append(Step(travel, tempo=_MOTIONS.fast_tempo))
    pause = _MOTIONS.rest_s * manner.rest + _MOTIONS.halt_s * manner.halt
    if pause and hand_steps:
        hand_steps[-1] = replace(hand_steps[-1], pause_s=pause)
    return hand_steps


def _repeat_steps(hand_steps: list[Step], motion: Motion, view: View, group: int) -> list[Step]:
    """Repeats steps as the motion says, with return movements."""
    if not hand_steps:
        return hand_steps
    first = hand_steps[0]
    hand_steps = [replace(first, marks=(*first.marks, group)), *hand_steps[1:]]
    in_place = len(hand_steps) == 1 and unit(first.travel) is None and first.target is None
    if motion.repeat == "swap":
        return [*hand_steps, Step(swaps=True)]
    if motion.repeat in ("reverse", "tofroto"):
        return [*hand_steps, Step(back=group), *(hand_steps if motion.repeat == "tofroto" else ())]
    if motion.repeat not in _N_REPETITIONS:
        raise InputError(f"repetition {motion.repeat!r} is not known")
    count = _N_REPETITIONS[motion.repeat]
    unmarked = [replace(step, marks=step.marks[:-1] if step is hand_steps[0] else step.marks) for step in hand_steps]
    if motion.repeat.startswith("continue") or (in_place and not motion.shift):
        return hand_steps + unmarked * count
    shift = view.polar(direction((motion.shift,))) if motion.shift else _NO_TRAVEL
    repeated = list(hand_steps)
    for n in range(count):
        beyond = plus(_NO_TRAVEL, shift, (n + 1) * _MOTIONS.repetition_shift_cm)
        repeated += [Step(back=group, beyond=beyond), *unmarked]
    return repeated


def together(parts: Sequence[list[Step]]) -> list[Step]:
    """Merges simultaneous steps; shorter lists are subdivided to the length of the longest."""
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
    """The tempo of two simultaneous motions: the slower if one is below 1, otherwise the faster."""
    return min(one, other) if min(one, other) < 1.0 else max(one, other)


def subdivide_steps(made: list[Step], count: int) -> list[Step]:
    """Divides steps into ``count`` steps, not fewer than given, each in equal pieces."""
    if not made:
        return [Step()] * count
    pieces = [count // len(made) + (n < count % len(made)) for n in range(len(made))]
    divided = []
    for step, n in zip(made, pieces, strict=True):
        if n == 1:
            divided.append(step)
            continue
        travel, path, local = to_vector(x / n for x in step.travel), Path(), step.local
        if step.path.kind == "circle":  # rounded to whole turns
            path = replace(step.path, revolutions=max(1.0, round(step.path.revolutions / n)))
        if local is not None:
            local = replace(local, cycles=max(1.0, local.cycles / n))
        piece = replace(step, travel=travel, path=path, local=local)
        first, last = replace(piece, target=None, pause_s=0.0, back=None, swaps=False), replace(piece, marks=())
        divided += [first, *[replace(first, marks=())] * (n - 2), last]
    return divided
