"""Parses HamNoSys 4 into a tree; symbols of a text and elements of HamNoSys SiGML share one grammar.

    sign    = part, {"plus", part}                                         a compound
    part    = {symmetry | "alternatingmotion" | "nonipsi"}, posture, {action}
    posture = {slot | "parbegin", {slot}, "plus", {slot}, "parend"}        slot: handshape, F, palm, location
    action  = core, {modifier | location | contact | repetition}
    core    = move, ["between", move] | circle | wrist | "replace", {slot} | bracket, {action}, ["plus", {action}], end

The order of the slots follows Hamburg's overview of HamNoSys; other orders are accepted. The parser repairs the defects
common in dictionaries, and notes each repair.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import takewhile

from signsplice.written import symbols
from signsplice.written.hamnosys_slots import Slots
from signsplice.written.nonmanual import hns_tiers
from signsplice.written.reading import Element, Reading, below
from signsplice.written.symbols import CLOSERS, Token, check_length, compound, is_action, is_posture, repair_symbols
from signsplice.written.tree import (
    Motion,
    Pair,
    Tier,
    WrittenManner,
    WrittenPosture,
    WrittenSign,
    involves_weak_hand,
    merge_postures,
    symmetry_kind,
)

_SYMMETRY = symbols.KINDS["symmetry"]
_KINDS = {"parbegin": "parallel", "seqbegin": "sequence", "fusionbegin": "fusion"}
_GESTURES = {
    "head nodding": "NO", "head twisting": "SH", "head moved": "ND", "head moveu": "NU", "head moveo": "PF",
    "head movei": "PB", "head movel": "TL", "head mover": "TR", "shoulders moveu": "UB",
}  # fmt: skip
"""Movement of the head or shoulders -> its code."""
_FLIPS = {"fingerstraightmod": "depths", "largemod": "heights"}
"""Symbol after a symmetry symbol -> another direction in which the hands mirror each other."""
_SHAPED = {"arc": ("curve", "straight"), "ellipse": ("ellipse", "circle"), "zigzag": ("zigzag", "straight", "circle")}
"""Kind of symbol -> the field of ``Motion`` that it sets, and the kinds of motion that accept it."""


def sign(found: Sequence[Token], reading: Reading) -> WrittenSign:
    """Parses the symbols of a notation. Raises ``FormatError`` on unknown content, or notes it if the reading is
    lenient.
    """
    check_length(len(found), reading)
    balanced = repair_symbols(found, reading)
    parts = [_part(part, reading) for part in compound(balanced)]
    if len(parts) == 1:
        return replace(parts[0], notes=tuple(reading.notes))
    tiers = tuple(tier for part in parts for tier in part.tiers)
    return WrittenSign(reading.gloss, parts=tuple(parts), tiers=tiers, notes=tuple(reading.notes), where=parts[0].where)


def _part(balanced: Sequence[Token], reading: Reading) -> WrittenSign:
    """Parses a sign that is not a compound, or one part of a compound."""
    where = reading.where("", balanced[0].position if balanced else 0)
    kinds = [_SYMMETRY[t.name] for t in balanced if t.name in _SYMMETRY]
    if len(set(kinds)) > 1:
        reading.refuse("has two kinds of symmetry, expected one", "hamsymmlr", where.position)
    flips = [t.name for t in takewhile(lambda t: t.name in _FLIPS, balanced[1:])] if kinds else []
    if flips and balanced[0].name in _SYMMETRY:
        balanced = [balanced[0], *balanced[1 + len(flips) :]]
    front = next((n for n, t in enumerate(balanced) if t.name not in (*_SYMMETRY, "alternatingmotion", "nonipsi")), 0)
    alternating = any(t.name == "alternatingmotion" for t in balanced[:front])
    crossed = any(t.name == "nonipsi" for t in balanced)
    rest = list[Token]()
    for t in balanced[front:]:
        if t.name in (*_SYMMETRY, "nonipsi"):
            reading.note(f"{t.ham_name} is read as if it stood first", t.position)
        elif t.name == "nomotion" and not rest:
            reading.note(f"{t.ham_name} before the posture is left out", t.position)
        else:
            rest.append(t)
    weak = bool(rest) and rest[0].name == "nondominant" and not kinds and all(t.name != "plus" for t in rest)
    parser = _Parser(rest[1:] if weak else rest, reading, kinds[:1] == ["mirrored"], bool(kinds))
    posture = parser.posture()
    motions = parser.actions(top=True)
    if posture == WrittenPosture():
        raise reading.error("has no handshape, direction or place before its movement", "", where.position)
    if crossed and posture.place is not None and not posture.place.side:
        posture = replace(posture, place=replace(posture.place, side="left_at"))
    hands = "weak" if weak else "two" if involves_weak_hand(posture, motions) else "one"
    if kinds:
        hands = symmetry_kind(kinds[0] == "mirrored", "largemod" in flips, "fingerstraightmod" in flips)
    tiers = tuple(parser.tiers)
    return WrittenSign(reading.gloss, hands, alternating, False, posture, tuple(motions), tiers=tiers, where=where)


class _Parser(Slots):
    """Parses actions; ``Slots`` parses postures and places."""

    def actions(self, top: bool = False) -> list[Motion]:
        """Parses actions up to a plus, a closing bracket or the end."""
        motions = list[Motion]()
        while (t := self.peek()).name not in ("", *CLOSERS):
            if t.name == "plus":
                if not top or not motions:
                    break
                self.next()
                self.reading.note("hamplus outside brackets joins the actions beside it", t.position)
                weak_motion = self.action_or_hold(t)
                motions[-1] = Motion("split", parts=(motions[-1], weak_motion), where=self.where(t))
                continue
            motions.append(self.action())
        if top:
            while (t := self.peek()).name:
                self.reading.refuse("stands where no symbol of its kind is expected", t.ham_name, self.next().position)
            last = self.tokens[-1].name if self.tokens else ""
            earlier = any(m.repeat for m in motions[:-1])
            if len(motions) > 1 and last in symbols.REPEATS and motions[-1].repeat and not earlier:
                repeat, parts = motions[-1].repeat, (*motions[:-1], replace(motions[-1], repeat=""))
                motions = [Motion("sequence", parts=parts, repeat=repeat, where=motions[0].where)]
        return motions

    def action(self) -> Motion:
        """Parses one action with its modifiers."""
        t = self.peek()
        if t.name == "nondominant":
            self.next()
            rest = Motion("hold", where=self.where(t))
            return Motion("split", parts=(rest, self.action_or_hold(t)), where=self.where(t))
        return self.parse_modifiers(replace(self.core(t), where=self.where(t)))

    def action_or_hold(self, t: Token) -> Motion:
        """Parses one action, or returns a hold if no action follows."""
        ends = self.at("", *CLOSERS, "plus")
        return Motion("hold", where=self.where(t)) if ends else self.action()

    def core(self, t: Token) -> Motion:
        """Parses an action without its modifiers."""
        name = t.name
        if is_posture(name) or self.is_posture_bracket():
            self.reading.note(f"{t.ham_name} after the first action is read as hamreplace", t.position)
            return self.posture_change(t)
        if self.is_location():
            return Motion("posture")  # ``parse_modifiers`` adds the target
        self.next()
        if name in symbols.BRACKETS and (body_motion := self.of_the_body(t)) is not None:
            return body_motion
        if name == "replace":
            return self.posture_change(t)
        if name in symbols.BRACKETS:
            return self.bracket(t)
        if name in ("movecross", "moveX"):
            return Motion("crossing")
        if name.startswith("move"):
            return Motion("straight", self.two_directions(t, "move"))
        if name.startswith("circle"):
            return Motion("circle", self.two_directions(t, "circle"))
        if name in symbols.KINDS["wrist"]:
            return Motion(name)
        if name == "fingerplay":
            return Motion(name, digits=tuple(symbols.DIGITS[d.name] for d in self.take(*symbols.DIGITS)))
        if name != "nomotion":
            self.reading.refuse("modifies no action", t.ham_name, t.position)
        return Motion("hold")

    def of_the_body(self, t: Token) -> Motion | None:
        """Parses brackets that begin with a body part and its movement, after the opening bracket; else None."""
        part, after = self.peek(), self.peek(1)
        if not is_action(after.name):
            return None
        if part.name in ("elbow", "elbowinside", "lowerarm", "upperarm"):
            self.reading.note(f"{part.ham_name} that moves is read as a movement of the hand", self.next().position)
            return self.bracket(t)
        if part.name not in ("head", "shoulders"):
            return None
        self.next()
        code = _GESTURES.get(f"{part.name} {after.name}")
        if code is None:
            self.reading.note(f"{after.ham_name} of {part.ham_name} is left out", after.position)
        else:
            tier = part.name.removesuffix("s")
            self.tiers.append(Tier(tier, code, lane=tier))
        self.bracket(t)
        return Motion("hold")

    def two_directions(self, t: Token, kind: str) -> tuple[str, ...]:
        """Returns the direction of the movement just read, or two directions whose mean is meant."""
        if not self.at("between") or not self.peek(1).name.startswith(kind):
            return (t.name.removeprefix(kind),)
        self.next()
        return t.name.removeprefix(kind), self.next().name.removeprefix(kind)

    def posture_change(self, t: Token) -> Motion:
        """Parses a change of posture without a path."""
        for modifier in self.take(*symbols.KINDS["size"], *symbols.KINDS["growth"]):
            self.reading.note(f"{modifier.ham_name} before what changes is left out", modifier.position)
        posture = self.posture()
        if posture == WrittenPosture():
            self.reading.refuse("changes nothing", t.ham_name, t.position)
            return Motion("hold")
        return Motion("posture", target=posture)

    def bracket(self, t: Token) -> Motion:
        """Parses the content of brackets; a plus splits it between the hands."""
        halves = [self.actions()]
        while self.take("plus"):
            halves.append(self.actions())
        self.take(symbols.BRACKETS[t.name])
        if len(halves) > 2:
            self.reading.refuse(f"holds {len(halves)} parts, expected two at most", t.ham_name, t.position)
        motions = [
            self.combine_motions(_KINDS[t.name] if len(halves) == 1 else "sequence", half, t) for half in halves[:2]
        ]
        return motions[0] if len(motions) == 1 else Motion("split", parts=tuple(motions))

    def combine_motions(self, kind: str, parts: list[Motion], t: Token) -> Motion:
        """Joins motions. Parallel straight motions become a sequence: their sum would be a single straight motion."""
        straight = [m for m in parts if kind == "parallel" and m.kind == "straight" and not m.repeat]
        if len(straight) > 1:
            self.reading.note(f"straight movements in {t.ham_name} come in turn", t.position)
            turns = Motion("sequence", parts=tuple(straight), where=straight[0].where)
            remaining = [m for m in parts if all(m is not straight_motion for straight_motion in straight)]
            parts = [turns, *remaining]
        if len(parts) == 1:
            return parts[0]
        if not parts:
            return Motion("hold", where=self.where(t))
        fused = WrittenManner(fused=kind == "fusion")
        return Motion(kind, parts=tuple(parts), manner=fused, where=self.where(t))

    def parse_modifiers(self, m: Motion) -> Motion:
        """Adds sizes, curves, manner, target and repetitions to an action."""
        sized = "size"
        while (t := self.peek()).name:
            name, kinds = t.name, symbols.KINDS
            if shaping := next((kind for kind in _SHAPED if name in kinds[kind]), ""):
                m = self.apply_path_shape(m, shaping, t)
                sized = f"{_SHAPED[shaping][0]}_size" if shaping != "ellipse" or not m.zigzag else sized
            elif name in kinds["size"]:
                m = _apply_size(m, sized, kinds["size"][name])
            elif name in kinds["growth"]:
                m = _apply_size(m, "size_end", kinds["growth"][name])
            elif name.startswith("clock"):
                m = self.apply_clock_symbol(m, t)
            elif name in kinds["manner"]:
                m = replace(m, manner=replace(m.manner, **{name: True}))
            elif name in symbols.REPEATS:
                base = Motion("sequence", parts=(m,), where=m.where) if m.repeat else m
                m = replace(base, repeat=symbols.REPEATS[name])
            elif name == "alternatingmotion":
                m = replace(m, alternating=True)
            elif name == "seqbegin" and self.peek(1).name in symbols.REPEATS:
                m = self.parse_repeat_shift(m)
            elif self.is_location():
                m = self.parse_target(m)
                continue
            else:
                break
            self.next()
        return m

    def parse_repeat_shift(self, m: Motion) -> Motion:
        """Parses bracketed repetition, each pass shifted in a direction, up to the closing bracket."""
        self.next()
        repeat = symbols.REPEATS[self.next().name]
        shift = self.next().name.removeprefix("move") if self.peek().name.startswith("move") else ""
        self.take(*symbols.KINDS["size"])
        self.refuse_until("seqend", "a repetition")
        return replace(m, repeat=repeat, shift=shift)

    def apply_path_shape(self, m: Motion, shaping: str, t: Token) -> Motion:
        """Adds a curve, a zigzag or a long axis to a motion, or to the last motion within its brackets."""
        key, *kinds = _SHAPED[shaping]
        if m.kind in kinds or (shaping == "ellipse" and m.zigzag):  # direction of its swings
            return _apply_size(m, key, symbols.KINDS[shaping][t.name])
        if m.parts:
            return replace(m, parts=(*m.parts[:-1], self.apply_path_shape(m.parts[-1], shaping, t)))
        self.reading.refuse(f"does not go with a motion of the kind {m.kind}", t.ham_name, t.position)
        return m

    def apply_clock_symbol(self, m: Motion, t: Token) -> Motion:
        """Sets the start of a circle, then its end; each full clock symbol adds a turn."""
        clock = t.name.removeprefix("clock")
        if m.kind != "circle":
            self.reading.refuse(f"does not go with a motion of the kind {m.kind}", t.ham_name, t.position)
            return m
        if clock == "full":
            return replace(m, turns=m.turns + 1.0)
        if not m.start:
            return replace(m, start=clock)
        return replace(m, end=clock, turns=m.turns - 1.0 if not m.end else m.turns)

    def parse_target(self, m: Motion) -> Motion:
        """Adds the place, site or contact at which a motion ends, or along which it brushes."""
        posture = self.location()
        if posture == WrittenPosture():
            return m
        if posture.place is not None and posture.place.contact == "brushing":
            return replace(m, brushing=posture.place)
        if posture.pair is not None and posture.pair.contact == "brushing":
            return replace(m, brushing_pair=posture.pair)
        target, contact = m.target, "" if posture.pair is None else posture.pair.contact
        if target is not None and posture == WrittenPosture(pair=Pair(contact=contact)):  # nearer to the same place
            if target.pair is not None:
                posture = WrittenPosture(pair=replace(target.pair, contact=contact))
            elif target.place is not None:
                posture = WrittenPosture(place=replace(target.place, contact=contact))
        return replace(m, target=merge_postures(target, posture))


def _apply_size(m: Motion, key: str, size: str) -> Motion:
    """Sets the size of a motion, or of the motions within its brackets that have no size."""
    if m.parts and key == "size":
        return replace(m, parts=tuple(part if part.size else _apply_size(part, key, size) for part in m.parts))
    return replace(m, **{key: size})  # type: ignore[arg-type]


def sign_of_element(element: Element, reading: Reading) -> WrittenSign:
    """Parses an ``hns_sign``. Raises ``FormatError`` on unknown content, or notes it if the reading is lenient."""
    tiers = hns_tiers((e for e in below(element) if e.tag.startswith("hnm_")), reading)
    tokens = list[Token]()
    for e in below(element):
        if e.tag.startswith("ham") and not e.tag.startswith("hamnosys"):
            tokens += symbols.resolve_symbol(e.tag.removeprefix("ham"), f"<{e.tag[:60]}>", e.line, reading)
        elif e.children and not e.tag.startswith(("hnm_", "hamnosys", "hns_")):
            reading.note(f"<{e.tag[:60]}> is left out, what is in it is read", e.line)
        elif not e.tag.startswith(("hnm_", "hamnosys", "hns_")):
            reading.refuse("is no symbol of HamNoSys 4", f"<{e.tag}>", e.line)
    written = "".join(e.text for e in (element, *element.find_elements("hamnosys_manual"))).strip()
    if not tokens and (written := written or element.attributes.get("hamnosys", "")):
        tokens = symbols.tokens(written, reading)
    if not tokens:
        raise reading.error("has no symbol of HamNoSys", f"<{element.tag}>", element.line)
    parsed = sign(tokens, reading)
    return replace(parsed, tiers=(*parsed.tiers, *tiers))
