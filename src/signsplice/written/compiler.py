"""Compiles written signs (``tree``) into the notation: postures, movements between them, what is repeated.

A sign whose hands mirror one another in all that is written is compiled as ``hands=symmetric``, every other one with
two hands as ``hands=base``: the weak hand has postures and paths of its own.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from signsplice.errors import InputError
from signsplice.signer import pose
from signsplice.signer.collisions import between_hands
from signsplice.signer.locations import WeakArm, strong_hand
from signsplice.signer.notation import notation_path, notation_text, parse
from signsplice.signer.phonology import Path, Posture, Segment, Sign, faults, on_base
from signsplice.signer.signer import STANDARD
from signsplice.written.hands import KINDS, HandState, complete_hand_state, from_skin, palm_point, weak_arm
from signsplice.written.nonmanual import body_tracks
from signsplice.written.steps import Step, View, common_tempo, steps, subdivide_steps
from signsplice.written.tree import (
    Pair,
    Place,
    WrittenPosture,
    WrittenSign,
    alternates,
    is_symmetric,
    is_two_handed,
    splits,
)
from signsplice.written.vocabulary import ON_ARM, Spot, part_of_hand, plus, point_of, spot, unit


@dataclass(frozen=True)
class Tracked:
    """A segment, and whether it is an unmarked way back."""

    segment: Segment
    back: bool = False


def collapse_repetitions(track: list[Tracked]) -> list[Segment]:
    """Segments with repetitions of one movement as ``times=``, of circles and local movements as more of them."""
    out: list[Segment] = []
    k = 0
    while k < len(track):
        segment = track[k].segment
        again = 1
        while (
            segment.kind == "M" and out and k + 2 < len(track) and track[k + 1].back
            and not track[k + 1].segment.circles
            and track[k + 2].segment == segment
            and (track[k + 1].segment.strong, track[k + 1].segment.weak) == (out[-1].strong, out[-1].weak)
        ):  # fmt: skip
            again, k = again + 1, k + 2
        before = out[-1] if out else None
        k += 1
        if again == 1 and before is not None and _continues(before, segment):
            out[-1] = _longer(before, segment)
            continue
        out.append(replace(segment, times=again) if again > 1 else segment)
    return out


def _continues(before: Segment, segment: Segment) -> bool:
    """Whether a segment is another turn, or more of the same local movement, in one place."""
    same = before.kind == segment.kind == "M" and before.strong == segment.strong and before.weak == segment.weak
    shape = replace(before.path, revolutions=0.0) == replace(segment.path, revolutions=0.0)
    own = replace(before.weak_path, revolutions=0.0) == replace(segment.weak_path, revolutions=0.0)
    kinds = before.local == segment.local or (
        before.local and segment.local and before.local.kind == segment.local.kind
    )
    return bool(same and shape and own and kinds and before.tempo == segment.tempo and before.times == 1)


def _longer(before: Segment, segment: Segment) -> Segment:
    """Two segments in one place as one."""
    local, own = before.local, before.weak_local
    if not segment.circles:
        local = local and replace(local, cycles=min(local.cycles + 2.0, 10.0))
        own = own and replace(own, cycles=min(own.cycles + 2.0, 10.0))
    path, weak_path = (replace(a, revolutions=min(a.revolutions + b.revolutions, 6.0)) for a, b in
                       ((before.path, segment.path), (before.weak_path, segment.weak_path)))  # fmt: skip
    return replace(before, local=local, weak_local=own, path=path, weak_path=weak_path)


_GAP_CM = {"close": 3.0, "armextended": 12.0}
"""Between two hands that are a pair; 0 for every other contact."""
_PAIR_SPACE = "space:0,2,26"
_PAIR_FORWARD = 24.0
"""How far before the chest joint two hands that meet before the body are at least, cm."""
_MET_CM = 0.01
"""How far from what is written the gap of a pair may stay."""
_TEMPO = (0.25, 3.0)
_RETURN_TEMPO = 1.2
_WEAK_ARM = WrittenPosture(fingers=("or",), palm=("d",), place=Place("stomach", contact="close"))
"""The weak hand of a one-handed sign that is made at it, where nothing is written of it."""


def compile_sign(sign: WrittenSign, lenient: bool = False) -> Sign:
    """A written sign in the notation. Raises ``InputError`` that names the gloss and what cannot be made; ``lenient``:
    what is not written of a posture is as usual.
    """
    try:
        made = _compile_parts(sign, lenient)
    except InputError as error:
        raise InputError(f"{_where(sign)}: {error}") from error
    if found := faults(made):
        raise InputError(f"{_where(sign)}: {found[0]}")
    return made


def _where(sign: WrittenSign) -> str:
    return f"{sign.where.file}: {sign.gloss}" if sign.where.file else sign.gloss


def _compile_parts(sign: WrittenSign, lenient: bool) -> Sign:
    parts = sign.parts or (sign,)
    gloss = re.sub(r"[\s=:]+", "-", sign.gloss.strip()) or "SIGN"
    mirrored = all(is_symmetric(part) for part in parts)
    two = any(is_two_handed(part) for part in parts)
    made = _Compiler(parts, "symmetric" if mirrored else "base" if two else "one", lenient)
    alternating = mirrored and any(map(alternates, parts))
    if alternating and not _one_move(made):
        made, alternating = _Compiler(parts, "base", lenient), False
    hands, segments = "alternating" if alternating else made.hands, collapse_repetitions(made.track)
    if any(s.kind == "M" for s in segments):
        segments = [*segments, Segment("H", segments[-1].strong, segments[-1].weak)]
    else:
        segments = [replace(segments[-1], kind="H")]
    whole = Sign(gloss, hands, tuple(segments), _source(sign), kind="written", gestures=body_tracks(sign))
    return parse(notation_text(whole))[gloss]


def _same_direction(mine: Step, its: Step) -> bool:
    """Whether the strong hand goes the weak one's way."""
    own = View((-1.0, 1.0, 1.0), 1)
    there = replace(mine.path, direction=own.polar(mine.path.direction), start=own.polar(mine.path.start))
    if mine.path.kind == "circle":
        there = replace(there, direction=own.axis(mine.path.direction))
    apart = plus(own.polar(mine.travel), its.travel, -1.0)
    return unit(apart) is None and notation_path(there) == notation_path(its.path)


def _of_weak_hand(step: Step) -> Step:
    """What a step of the strong hand alone says of the weak one, which stays where it is."""
    target = None if step.target is None else step.target.weak
    return Step(target=target, literal=True, marks=step.marks, back=step.back)


def _source(sign: WrittenSign) -> str:
    return f"compiled from {sign.where.file}" if sign.where.file else "compiled"


def _one_move(made: _Compiler) -> bool:
    moves = [s for s in collapse_repetitions(made.track) if s.kind == "M"]
    return len(moves) == 1 and (moves[0].path.kind == "circle" or not moves[0].strong.touch)


class _Compiler:
    """The segments of a sign so far and both hands at their end."""

    def __init__(self, parts: Sequence[WrittenSign], hands: str, lenient: bool) -> None:
        self.hands, self.lenient = hands, lenient
        self.track: list[Tracked] = []
        self.strong, self.weak = HandState(0), HandState(1)
        self.pair: Pair | None = None
        self.saved: dict[tuple[int, int], HandState] = {}
        self.kind, self.two = "one", False
        for part in parts:
            self._add(part)

    def _add(self, sign: WrittenSign) -> None:
        """Add a sign, or a part of a compound."""
        self.kind, self.two = sign.hands, sign.hands not in ("one", "weak")
        held = self.weak if sign.holdover else HandState(1)
        self.strong, self.weak, self.pair = HandState(0, meets=self.hands == "symmetric"), HandState(1), None
        self.saved = {}
        own = is_two_handed(sign)
        if sign.hands != "weak":
            self.strong = complete_hand_state(self.strong.apply_written_posture(sign.posture, self.kind), self.lenient)
        if sign.holdover:
            self.weak = held
        elif self.hands == "base" and own:
            start = self.weak.apply_written_posture(sign.posture, self.kind, literal=sign.hands == "weak")
            if self.kind == "one":
                start = HandState(1, start.shape).apply_written_posture(_WEAK_ARM, "one", literal=True)
                start = start.apply_written_posture(sign.posture.weak, "one", literal=True)
            self.weak = complete_hand_state(start, self.lenient)
        self._place(
            sign.posture, first=True, hands=(sign.hands != "weak", self.hands == "base" and own and not sign.holdover)
        )
        self._emit(Step(), Step(), first=True)
        weak_view = View(KINDS[self.kind][2], 1, literal=sign.hands == "weak", opposite=sign.alternating)
        strong_steps: list[Step] = []
        weak_steps: list[Step] = []
        for n, motion in enumerate(sign.motions):
            mine = steps(motion, View(), 100 + n) if sign.hands != "weak" else []
            its: list[Step] = []
            if self.hands == "base" and own:
                moves = sign.hands not in ("one", "two") or splits((motion,))
                its = steps(motion, weak_view, 100 + n) if moves else [_of_weak_hand(step) for step in mine]
            count = max(len(mine), len(its))
            strong_steps += subdivide_steps(mine, count)
            weak_steps += subdivide_steps(its, count)
        for mine_step, its_step in zip(strong_steps, weak_steps, strict=True):
            self._step(mine_step, its_step)

    def _step(self, mine: Step, its: Step) -> None:
        for k, step in enumerate((mine, its)):
            for mark in step.marks:
                self.saved[k, mark] = (self.strong, self.weak)[k]
        if mine.brushing is not None:
            self._brush(mine.brushing)
        before = self.weak.posture
        if mine.anywhere and not (on_base(self.strong.current_posture.location) and its.path.kind == "circle"):
            mine = replace(
                mine, path=from_skin(mine.path, self.strong.current_posture, before, self.hands == "symmetric")
            )
        if its.anywhere:
            its = replace(its, path=from_skin(its.path, self.weak.current_posture, None, False))
        targets = [mine.target, its.target]
        if mine.swaps or its.swaps:
            self._swap()
        self.weak = self._move_hand(self.weak, its, None, None)
        alone = its.path.kind != "straight" and not _same_direction(mine, its)
        self.strong = self._move_hand(self.strong, mine, self.weak.posture, before, alone)
        for target in dict.fromkeys(t for t in targets if t is not None):
            self._place(target, first=False, hands=(target is mine.target, target is its.target))
        self._emit(mine, its, first=False)

    def _move_hand(
        self, state: HandState, step: Step, weak: Posture | None, before: Posture | None, alone: bool = False
    ) -> HandState:
        """A hand after a step, places apart."""
        if state.posture is None:
            return state
        if step.back is not None and (state.which, step.back) in self.saved:
            saved = self.saved[state.which, step.back]
            return saved if unit(step.beyond) is None else saved.move_by(step.beyond, weak, before)
        changed = state.apply_written_posture(step.target, self.kind, step.literal)
        return changed.move_by(step.travel, weak, before, fast=step.tempo > 1.0, alone=alone)

    def _swap(self) -> None:
        """Let hands exchange their shapes, directions and places."""
        if self.weak.posture is None:
            raise InputError("hands exchange, but the sign has one")
        a, b = self.strong.current_posture, self.weak.current_posture
        one, other = palm_point(a, b), palm_point(b, None)
        self.strong = self.strong.move_by(plus((-other[0], other[1], other[2]), one, -1.0), b, b)
        self.weak = self.weak.move_by(plus((-one[0], one[1], one[2]), other, -1.0), None, None)

    def _brush(self, brushing: Place | Pair) -> None:
        """Let the hand touch first what it then brushes along."""
        if self.strong.current_posture.touch:
            return
        along = replace(brushing, contact="touch")
        posture = WrittenPosture(place=along) if isinstance(along, Place) else WrittenPosture(pair=along)
        self.strong = self.strong.apply_written_posture(posture, self.kind)
        self._place(posture, first=False, hands=(True, False))
        self._emit(Step(), Step(), first=False)

    def _place(self, posture: WrittenPosture, first: bool, hands: tuple[bool, bool]) -> None:
        """Bring the hands to where a posture is written to be."""
        own = posture.weak or WrittenPosture()
        pair = posture.pair or own.pair
        if (first or posture.place is not None) and hands[0]:
            self.strong = self.strong.at_place(self.two)
        if hands[1] and (first or posture.place is not None or own.place is not None):
            self.weak = self.weak.at_place(self.two)
        if pair is None:
            return
        if self.kind == "weak" or (self.kind == "one" and pair.weak is None and pair.place is None):
            self._nearer(pair)
            return
        last = self.pair or Pair()
        bare = pair.weak is None and pair.strong is None
        self.pair = replace(pair, weak=last.weak, strong=last.strong) if bare and not first else pair
        self._meet(self.pair, posture.place, first)

    def _nearer(self, pair: Pair) -> None:
        """Bring the only hand to its last place with another contact."""
        state = self.weak if self.kind == "weak" else self.strong
        place = replace(state.place or Place("chest"), contact=pair.contact)
        if place.between is not None:
            place = replace(place, between=replace(place.between, contact=pair.contact))
        state = replace(state, place=place).at_place(two_handed=False)
        if state.which:
            self.weak = state
        else:
            self.strong = state

    def _meet(self, pair: Pair, place: Place | None, first: bool) -> None:
        """Bring both hands together: the parts that are written, or else where they are nearest."""
        gap = _GAP_CM.get(pair.contact, 0.0)
        where = self._middle(pair.place or place, first)
        strong_part = part_of_hand(pair.strong) if pair.strong is not None else "palm"
        if self.hands == "symmetric":
            here = replace(where, part=strong_part, off=0.5 * gap, touches=False)
            if where.touches:
                here = replace(here, off=0.0, shift=(1.5 + 0.5 * gap, 0.0, 0.0))
            else:
                _, up, forward = point_of(where)
                forward = max(forward, _PAIR_FORWARD)
                here = replace(here, location=f"space:0,{up:.4g},{forward:.4g}", shift=(0.0, 0.0, 0.0))
            self.strong = self.strong.at(here, False, touch=gap < 1.0)
            if pair.strong is None and not where.touches:
                self.strong = self._apart(gap)
            return
        if self.weak.posture is None:
            raise InputError("hands meet, but the sign has one")
        arm = pair.weak is not None and ON_ARM.get(pair.weak.part)
        weak_part = part_of_hand(pair.weak) if pair.weak is not None and not arm else "palm"
        if pair.place is not None or place is not None or first:
            if not where.touches:
                out, up, forward = point_of(where)
                forward = max(forward, _PAIR_FORWARD)
                where = Spot(f"space:{0.0 - out:.4g},{up:.4g},{forward:.4g}")  # as the weak hand sees it
            self.weak = self.weak.at(replace(where, part=weak_part), False)
        weak = self.weak.current_posture
        if pair.weak is None and pair.strong is None:
            self.strong = self._nearest(weak, gap)
        else:
            where = Spot(arm or f"base-{weak_part}", gap, part=strong_part)
            self.strong = self.strong.at(where, False, touch=gap < 1.0)

    def _apart(self, gap: float) -> HandState:
        """The strong hand so far from the midline that the skins of both hands, which mirror one another, are ``gap``
        apart.
        """
        made = replace(self.strong.current_posture, touch=False)
        nobody = WeakArm(STANDARD, np.zeros(27))
        for _ in range(4):
            state = strong_hand(made, nobody, meets=True)
            missing = gap - float(between_hands(pose.of_hands(state, state)[None], STANDARD)[0])
            made = replace(made, off=made.off + 0.5 * missing)
            if abs(missing) < _MET_CM:
                break
        return replace(self.strong, posture=replace(made, touch=gap < 1.0))

    def _middle(self, place: Place | None, first: bool) -> Spot:
        """Where a pair is."""
        if place is not None:
            return spot(place, own_side=False)
        if self.hands == "symmetric" and not first:
            _, up, forward = palm_point(self.strong.current_posture, None, meets=True)
            return Spot(f"space:0,{up:.2f},{forward:.2f}")
        if self.strong.place is not None:
            return spot(self.strong.place, own_side=False)
        return Spot(_PAIR_SPACE)

    def _nearest(self, weak: Posture, gap: float) -> HandState:
        """The strong hand beside the weak one, at its height, so that their skins are ``gap`` apart."""
        middle = palm_point(weak, None)
        arm = weak_arm(weak)
        out = -middle[0] + 9.0 + gap
        usual = self.strong.at(Spot("base-palm", part="palm"), False).current_posture
        zero = palm_point(usual, weak)
        for _ in range(4):
            shift = plus((out, middle[1], middle[2]), zero, -1.0)
            made = replace(usual, shift=shift)
            state = pose.of_hands(strong_hand(made, arm), arm.hand)
            missing = gap - float(between_hands(state[None], STANDARD)[0])
            out += missing
            if abs(missing) < _MET_CM:
                break
        return replace(self.strong, posture=made)

    def _emit(self, mine: Step, its: Step, first: bool) -> None:
        """Add a movement to the postures of both hands now, or the first posture."""
        strong = self.strong.current_posture
        weak = self.weak.current_posture if self.hands == "base" else None
        last = self.track[-1].segment if self.track else None
        if last is None:
            self.track.append(Tracked(Segment("X", strong, weak)))
            return
        if on_base(strong.location) and on_base(last.strong.location) and its.path.kind != "straight":
            mine = replace(mine, path=Path())  # carried along
        back = mine.back is not None or its.back is not None
        tempo = _RETURN_TEMPO if back else float(np.clip(common_tempo(mine.tempo, its.tempo), *_TEMPO))
        segment = Segment(
            "M", strong, weak,
            path=mine.path, local=mine.local,
            weak_path=its.path if self.hands == "base" else Path(),
            weak_local=its.local if self.hands == "base" else None,
            tempo=tempo,
        )  # fmt: skip
        still = strong == last.strong and weak == last.weak
        if not still or segment.local or segment.weak_local or segment.circles:
            if still and not segment.circles:
                segment = replace(segment, path=Path())
            self.track.append(Tracked(segment, back))
        pause = max(mine.pause_s, its.pause_s)
        if pause:
            self.track.append(Tracked(Segment("H", strong, weak, seconds=pause)))
