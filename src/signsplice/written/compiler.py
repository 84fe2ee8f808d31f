"""Compiles written signs (``tree``) into the notation: postures, movements between them, repetitions.

A sign whose hands mirror each other throughout compiles to ``hands=symmetric``, or to ``hands=alternating`` if they
alternate in a single movement. Every other two-handed sign compiles to ``hands=base``: its weak hand has its own
postures and paths.
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
from signsplice.written.hands import KINDS, WrittenHand, complete_hand, from_skin, palm_point, weak_arm
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
class TrackedSegment:
    """A segment, and whether it is a return movement (``Step.back``)."""

    segment: Segment
    is_return: bool = False


def collapse_repetitions(track: list[TrackedSegment]) -> list[Segment]:
    """Write repetitions of one movement as ``times=``, repeated circles as more revolutions, local movements as
    more cycles.
    """
    segments: list[Segment] = []
    k = 0
    while k < len(track):
        segment = track[k].segment
        times = 1
        while (
            segment.kind == "M" and segments and k + 2 < len(track) and track[k + 1].is_return
            and not track[k + 1].segment.circles
            and track[k + 2].segment == segment
            and (track[k + 1].segment.strong, track[k + 1].segment.weak) == (segments[-1].strong, segments[-1].weak)
        ):  # fmt: skip
            times, k = times + 1, k + 2
        before = segments[-1] if segments else None
        k += 1
        if times == 1 and before is not None and _continues(before, segment):
            segments[-1] = _longer(before, segment)
            continue
        segments.append(replace(segment, times=times) if times > 1 else segment)
    return segments


def _continues(before: Segment, segment: Segment) -> bool:
    """Whether a segment adds a turn, or more of the same local movement, in one place."""
    same_hands = before.kind == segment.kind == "M" and before.strong == segment.strong and before.weak == segment.weak
    same_path = replace(before.path, revolutions=0.0) == replace(segment.path, revolutions=0.0)
    same_weak_path = replace(before.weak_path, revolutions=0.0) == replace(segment.weak_path, revolutions=0.0)
    same_local = before.local == segment.local or (
        before.local and segment.local and before.local.kind == segment.local.kind
    )
    return bool(
        same_hands
        and same_path
        and same_weak_path
        and same_local
        and before.tempo == segment.tempo
        and before.times == 1
    )


def _longer(before: Segment, segment: Segment) -> Segment:
    """Joins two segments in one place."""
    local, weak_local = before.local, before.weak_local
    if not segment.circles:
        local = local and replace(local, cycles=min(local.cycles + 2.0, 10.0))
        weak_local = weak_local and replace(weak_local, cycles=min(weak_local.cycles + 2.0, 10.0))
    path, weak_path = (replace(a, revolutions=min(a.revolutions + b.revolutions, 6.0)) for a, b in
                       ((before.path, segment.path), (before.weak_path, segment.weak_path)))  # fmt: skip
    return replace(before, local=local, weak_local=weak_local, path=path, weak_path=weak_path)


_GAP_CM = {"close": 3.0, "armextended": 12.0}
"""Contact -> gap between the hands of a pair, cm; 0 for every other contact."""
_PAIR_SPACE = "space:0,2,26"
"""Default location of a pair: out, up and forward from the chest joint, cm."""
_PAIR_FORWARD = 24.0
"""Least distance from the chest joint to a pair in front of the body, cm."""
_MET_CM = 0.01
"""Tolerance of the gap of a pair, cm."""
_TEMPO = (0.25, 3.0)
"""Lowest and highest tempo of a segment."""
_RETURN_TEMPO = 1.2
"""Tempo of a return movement."""
_DEFAULT_WEAK_HAND = WrittenPosture(fingers=("or",), palm=("d",), place=Place("stomach", contact="close"))
"""Default weak hand of a one-handed sign that is made at the weak hand."""


def compile_sign(sign: WrittenSign, lenient: bool = False) -> Sign:
    """Compiles a written sign into the notation. Raises ``InputError`` with the gloss if the sign cannot be compiled.

    lenient: missing parts of a posture get defaults
    """
    try:
        compiled = _compile_parts(sign, lenient)
    except InputError as error:
        raise InputError(f"{_where(sign)}: {error}") from error
    if problems := faults(compiled):
        raise InputError(f"{_where(sign)}: {problems[0]}")
    return compiled


def _where(sign: WrittenSign) -> str:
    return f"{sign.where.file}: {sign.gloss}" if sign.where.file else sign.gloss


def _compile_parts(sign: WrittenSign, lenient: bool) -> Sign:
    """Compiles a sign, or the parts of a compound one after another, without checking the result."""
    parts = sign.parts or (sign,)
    gloss = re.sub(r"[\s=:]+", "-", sign.gloss.strip()) or "SIGN"
    mirrored = all(is_symmetric(part) for part in parts)
    two_handed = any(is_two_handed(part) for part in parts)
    compiler = _Compiler(parts, "symmetric" if mirrored else "base" if two_handed else "one", lenient)
    alternating = mirrored and any(map(alternates, parts))
    if alternating and not _one_move(compiler):
        compiler, alternating = _Compiler(parts, "base", lenient), False
    hands = "alternating" if alternating else compiler.hands
    segments = collapse_repetitions(compiler.track)
    if any(s.kind == "M" for s in segments):
        segments = [*segments, Segment("H", segments[-1].strong, segments[-1].weak)]
    else:
        segments = [replace(segments[-1], kind="H")]
    result = Sign(gloss, hands, tuple(segments), _source(sign), kind="written", gestures=body_tracks(sign))
    return parse(notation_text(result))[gloss]  # the sign that its text gives: numbers are rounded there


def _same_direction(strong_step: Step, weak_step: Step) -> bool:
    """Whether both hands move in the same direction. The weak step is in the weak hand's own axes, so it is compared
    with the mirrored strong step.
    """
    mirror_view = View((-1.0, 1.0, 1.0), 1)
    mirrored_path = replace(
        strong_step.path,
        direction=mirror_view.polar(strong_step.path.direction),
        start=mirror_view.polar(strong_step.path.start),
    )
    if strong_step.path.kind == "circle":
        mirrored_path = replace(mirrored_path, direction=mirror_view.axis(strong_step.path.direction))
    difference = plus(mirror_view.polar(strong_step.travel), weak_step.travel, -1.0)
    return unit(difference) is None and notation_path(mirrored_path) == notation_path(weak_step.path)


def _of_weak_hand(step: Step) -> Step:
    """The weak hand's part of a step that only the strong hand makes: the weak hand stays in place."""
    target = None if step.target is None else step.target.weak
    return Step(target=target, literal=True, marks=step.marks, back=step.back)


def _source(sign: WrittenSign) -> str:
    return f"compiled from {sign.where.file}" if sign.where.file else "compiled"


def _one_move(compiler: _Compiler) -> bool:
    """Whether the notation can alternate the sign: one movement, which is a circle or ends without touch."""
    moves = [s for s in collapse_repetitions(compiler.track) if s.kind == "M"]
    return len(moves) == 1 and (moves[0].path.kind == "circle" or not moves[0].strong.touch)


class _Compiler:
    """The segments compiled so far, and both hands after them.

    hands: hands of the notation: one, symmetric or base
    track: the segments
    pair: the last written pair, or None
    saved: (0 strong or 1 weak, group) -> the hand at the beginning of that group of steps
    written_hands: kind of hands of the part being compiled (``KINDS``)
    written_for_both: whether it is written for both hands
    """

    def __init__(self, parts: Sequence[WrittenSign], hands: str, lenient: bool) -> None:
        self.hands, self.lenient = hands, lenient
        self.track: list[TrackedSegment] = []
        self.strong, self.weak = WrittenHand(0), WrittenHand(1)
        self.pair: Pair | None = None
        self.saved: dict[tuple[int, int], WrittenHand] = {}
        self.written_hands, self.written_for_both = "one", False
        for part in parts:
            self._add(part)

    def _add(self, sign: WrittenSign) -> None:
        """Add a sign, or a part of a compound."""
        self.written_hands, self.written_for_both = sign.hands, sign.hands not in ("one", "weak")
        held_weak = self.weak if sign.holdover else WrittenHand(1)
        self.strong, self.weak, self.pair = WrittenHand(0, meets=self.hands == "symmetric"), WrittenHand(1), None
        self.saved = {}
        weak_takes_part = is_two_handed(sign)
        if sign.hands != "weak":
            written = self.strong.apply_written_posture(sign.posture, self.written_hands)
            self.strong = complete_hand(written, self.lenient)
        if sign.holdover:
            self.weak = held_weak
        elif self.hands == "base" and weak_takes_part:
            start = self.weak.apply_written_posture(sign.posture, self.written_hands, literal=sign.hands == "weak")
            if self.written_hands == "one":
                start = WrittenHand(1, start.shape).apply_written_posture(_DEFAULT_WEAK_HAND, "one", literal=True)
                start = start.apply_written_posture(sign.posture.weak, "one", literal=True)
            self.weak = complete_hand(start, self.lenient)
        self._place(
            sign.posture,
            first=True,
            moves=(sign.hands != "weak", self.hands == "base" and weak_takes_part and not sign.holdover),
        )
        self._emit(Step(), Step())
        _, _, weak_signs = KINDS[self.written_hands]
        weak_view = View(weak_signs, 1, literal=sign.hands == "weak", opposite=sign.alternating)
        strong_steps: list[Step] = []
        weak_steps: list[Step] = []
        for group, motion in enumerate(sign.motions, 100):  # from 100: groups in g have numbers above 10 g
            strong_part = steps(motion, View(), group) if sign.hands != "weak" else []
            weak_part: list[Step] = []
            if self.hands == "base" and weak_takes_part:
                weak_moves = sign.hands not in ("one", "two") or splits((motion,))
                weak_part = (
                    steps(motion, weak_view, group) if weak_moves else [_of_weak_hand(step) for step in strong_part]
                )
            count = max(len(strong_part), len(weak_part))
            strong_steps += subdivide_steps(strong_part, count)
            weak_steps += subdivide_steps(weak_part, count)
        for strong_step, weak_step in zip(strong_steps, weak_steps, strict=True):
            self._step(strong_step, weak_step)

    def _step(self, strong_step: Step, weak_step: Step) -> None:
        for k, step in enumerate((strong_step, weak_step)):
            for mark in step.marks:
                self.saved[k, mark] = (self.strong, self.weak)[k]
        if strong_step.brushing is not None:
            self._brush(strong_step.brushing)
        weak_before = self.weak.posture
        if strong_step.anywhere and not (
            on_base(self.strong.current_posture.location) and weak_step.path.kind == "circle"
        ):
            strong_step = replace(
                strong_step,
                path=from_skin(strong_step.path, self.strong.current_posture, weak_before, self.hands == "symmetric"),
            )
        if weak_step.anywhere:
            weak_step = replace(weak_step, path=from_skin(weak_step.path, self.weak.current_posture, None, False))
        targets = [strong_step.target, weak_step.target]
        if strong_step.swaps or weak_step.swaps:
            self._swap()
        self.weak = self._move_hand(self.weak, weak_step, None, None)
        alone = weak_step.path.kind != "straight" and not _same_direction(strong_step, weak_step)
        self.strong = self._move_hand(self.strong, strong_step, self.weak.posture, weak_before, alone)
        for target in dict.fromkeys(t for t in targets if t is not None):
            self._place(target, first=False, moves=(target is strong_step.target, target is weak_step.target))
        self._emit(strong_step, weak_step)

    def _move_hand(
        self, hand: WrittenHand, step: Step, weak: Posture | None, weak_before: Posture | None, alone: bool = False
    ) -> WrittenHand:
        """Returns a hand after a step, before it moves to a target place. ``weak``, ``weak_before``, ``alone``: as in
        ``WrittenHand.move_by``.
        """
        if hand.posture is None:
            return hand
        if step.back is not None and (hand.which, step.back) in self.saved:
            saved = self.saved[hand.which, step.back]
            return saved if unit(step.beyond) is None else saved.move_by(step.beyond, weak, weak_before)
        changed = hand.apply_written_posture(step.target, self.written_hands, step.literal)
        return changed.move_by(step.travel, weak, weak_before, fast=step.tempo > 1.0, alone=alone)

    def _swap(self) -> None:
        """Swap the palm positions of the two hands."""
        if self.weak.posture is None:
            raise InputError("hands exchange, but the sign has one")
        a, b = self.strong.current_posture, self.weak.current_posture
        strong_palm, weak_palm = palm_point(a, b), palm_point(b, None)
        self.strong = self.strong.move_by(plus((-weak_palm[0], weak_palm[1], weak_palm[2]), strong_palm, -1.0), b, b)
        self.weak = self.weak.move_by(
            plus((-strong_palm[0], strong_palm[1], strong_palm[2]), weak_palm, -1.0), None, None
        )

    def _brush(self, brushing: Place | Pair) -> None:
        """Touch the surface that the hand then brushes along."""
        if self.strong.current_posture.touch:
            return
        touched = replace(brushing, contact="touch")
        posture = WrittenPosture(place=touched) if isinstance(touched, Place) else WrittenPosture(pair=touched)
        self.strong = self.strong.apply_written_posture(posture, self.written_hands)
        self._place(posture, first=False, moves=(True, False))
        self._emit(Step(), Step())

    def _place(self, posture: WrittenPosture, first: bool, moves: tuple[bool, bool]) -> None:
        """Move the hands that ``moves`` names (strong, weak), or both if they are a pair, to the place of a posture."""
        weak_posture = posture.weak or WrittenPosture()
        pair = posture.pair or weak_posture.pair
        if (first or posture.place is not None) and moves[0]:
            self.strong = self.strong.at_place(self.written_for_both)
        if moves[1] and (first or posture.place is not None or weak_posture.place is not None):
            self.weak = self.weak.at_place(self.written_for_both)
        if pair is None:
            return
        if self.written_hands == "weak" or (self.written_hands == "one" and pair.weak is None and pair.place is None):
            self._change_contact(pair)
            return
        last = self.pair or Pair()
        bare = pair.weak is None and pair.strong is None
        self.pair = replace(pair, weak=last.weak, strong=last.strong) if bare and not first else pair
        self._meet(self.pair, posture.place, first)

    def _change_contact(self, pair: Pair) -> None:
        """Move the only hand to its last place with another contact."""
        hand = self.weak if self.written_hands == "weak" else self.strong
        place = replace(hand.place or Place("chest"), contact=pair.contact)
        if place.between is not None:
            place = replace(place, between=replace(place.between, contact=pair.contact))
        hand = replace(hand, place=place).at_place(two_handed=False)
        if hand.which:
            self.weak = hand
        else:
            self.strong = hand

    def _meet(self, pair: Pair, place: Place | None, first: bool) -> None:
        """Bring both hands together at the written parts, or at their nearest points if none are written."""
        gap = _GAP_CM.get(pair.contact, 0.0)
        where = self._middle(pair.place or place, first)
        strong_part = part_of_hand(pair.strong) if pair.strong is not None else "palm"
        if self.hands == "symmetric":
            strong_spot = replace(where, part=strong_part, off=0.5 * gap, touches=False)
            if where.touches:
                strong_spot = replace(strong_spot, off=0.0, shift=(1.5 + 0.5 * gap, 0.0, 0.0))
            else:
                _, up, forward = point_of(where)
                forward = max(forward, _PAIR_FORWARD)
                strong_spot = replace(strong_spot, location=f"space:0,{up:.4g},{forward:.4g}", shift=(0.0, 0.0, 0.0))
            self.strong = self.strong.at(strong_spot, one_handed=False, touch=gap < 1.0)
            if pair.strong is None and not where.touches:
                self.strong = self._apart(gap)
            return
        if self.weak.posture is None:
            raise InputError("hands meet, but the sign has one")
        arm_location = pair.weak is not None and ON_ARM.get(pair.weak.part)
        weak_part = part_of_hand(pair.weak) if pair.weak is not None and not arm_location else "palm"
        if pair.place is not None or place is not None or first:
            if not where.touches:
                outward, up, forward = point_of(where)
                forward = max(forward, _PAIR_FORWARD)
                where = Spot(f"space:{0.0 - outward:.4g},{up:.4g},{forward:.4g}")  # as the weak hand sees it
            self.weak = self.weak.at(replace(where, part=weak_part), one_handed=False)
        weak = self.weak.current_posture
        if pair.weak is None and pair.strong is None:
            self.strong = self._place_next_to_weak_hand(weak, gap)
        else:
            where = Spot(arm_location or f"base-{weak_part}", gap, part=strong_part)
            self.strong = self.strong.at(where, one_handed=False, touch=gap < 1.0)

    def _apart(self, gap: float) -> WrittenHand:
        """Returns the strong hand at the distance from the midline that leaves ``gap`` between two mirrored hands."""
        posture = replace(self.strong.current_posture, touch=False)
        no_arm = WeakArm(STANDARD, np.zeros(27))
        for _ in range(4):
            state = strong_hand(posture, no_arm, meets=True)
            missing = gap - float(between_hands(pose.of_hands(state, state)[None], STANDARD)[0])
            posture = replace(posture, off=posture.off + 0.5 * missing)
            if abs(missing) < _MET_CM:
                break
        return replace(self.strong, posture=replace(posture, touch=gap < 1.0))

    def _middle(self, place: Place | None, first: bool) -> Spot:
        """Returns the location of a pair."""
        if place is not None:
            return spot(place, own_side=False)
        if self.hands == "symmetric" and not first:
            _, up, forward = palm_point(self.strong.current_posture, None, meets=True)
            return Spot(f"space:0,{up:.2f},{forward:.2f}")
        if self.strong.place is not None:
            return spot(self.strong.place, own_side=False)
        return Spot(_PAIR_SPACE)

    def _place_next_to_weak_hand(self, weak: Posture, gap: float) -> WrittenHand:
        """Returns the strong hand next to the weak hand, at its height, with ``gap`` between their skins."""
        weak_palm = palm_point(weak, None)
        arm = weak_arm(weak)
        outward = -weak_palm[0] + 9.0 + gap
        usual = self.strong.at(Spot("base-palm", part="palm"), one_handed=False).current_posture
        usual_palm = palm_point(usual, weak)
        for _ in range(4):
            shift = plus((outward, weak_palm[1], weak_palm[2]), usual_palm, -1.0)
            posture = replace(usual, shift=shift)
            state = pose.of_hands(strong_hand(posture, arm), arm.hand)
            missing = gap - float(between_hands(state[None], STANDARD)[0])
            outward += missing
            if abs(missing) < _MET_CM:
                break
        return replace(self.strong, posture=posture)

    def _emit(self, strong_step: Step, weak_step: Step) -> None:
        """Append a movement to the current postures of both hands; the sign's first posture if the track is empty."""
        strong = self.strong.current_posture
        weak = self.weak.current_posture if self.hands == "base" else None
        last = self.track[-1].segment if self.track else None
        if last is None:
            self.track.append(TrackedSegment(Segment("X", strong, weak)))
            return
        if on_base(strong.location) and on_base(last.strong.location) and weak_step.path.kind != "straight":
            strong_step = replace(strong_step, path=Path())  # carried along
        is_return = strong_step.back is not None or weak_step.back is not None
        tempo = (
            _RETURN_TEMPO if is_return else float(np.clip(common_tempo(strong_step.tempo, weak_step.tempo), *_TEMPO))
        )
        segment = Segment(
            "M", strong, weak,
            path=strong_step.path, local=strong_step.local,
            weak_path=weak_step.path if self.hands == "base" else Path(),
            weak_local=weak_step.local if self.hands == "base" else None,
            tempo=tempo,
        )  # fmt: skip
        still = strong == last.strong and weak == last.weak
        if not still or segment.local or segment.weak_local or segment.circles:
            if still and not segment.circles:
                segment = replace(segment, path=Path())
            self.track.append(TrackedSegment(segment, is_return))
        pause = max(strong_step.pause_s, weak_step.pause_s)
        if pause:
            self.track.append(TrackedSegment(Segment("H", strong, weak, seconds=pause)))
