"""HamNoSys 4 as a tree: the symbols of a text, or the elements of HamNoSys SiGML, by one grammar.

    sign    = part, {"plus", part}                                         a compound
    part    = {symmetry | "alternatingmotion" | "nonipsi"}, posture, {action}
    posture = {slot | "parbegin", {slot}, "plus", {slot}, "parend"}        slot: handshape, F, palm, location
    action  = core, {modifier | location | contact | repetition}
    core    = move, ["between", move] | circle | wrist | "replace", {slot} | bracket, {action}, ["plus", {action}], end

The order of the slots is that of Hamburg's overview of HamNoSys; other orders are read too. Notations with the defects
that dictionaries have are mended, and each mend is noted.
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
    merge_postures,
    symmetry_kind,
    weak_has_own,
)

_SYMMETRY = symbols.KINDS["symmetry"]
_KINDS = {"parbegin": "parallel", "seqbegin": "sequence", "fusionbegin": "fusion"}
_GESTURES = {
    "head nodding": "NO", "head twisting": "SH", "head moved": "ND", "head moveu": "NU", "head moveo": "PF",
    "head movei": "PB", "head movel": "TL", "head mover": "TR", "shoulders moveu": "UB",
}  # fmt: skip
"""Movements of the head and the shoulders, and their codes."""
_FLIPS = {"fingerstraightmod": "depths", "largemod": "heights"}
"""Symbols after one of symmetry, and in what else the hands mirror one another."""
_SHAPED = {"arc": ("curve", "straight"), "ellipse": ("ellipse", "circle"), "zigzag": ("zigzag", "straight", "circle")}
"""Kind of symbol -> what of a motion it says, and of which kinds of motion."""


def sign(found: Sequence[Token], reading: Reading) -> WrittenSign:
    """The tree of a notation's symbols. Raises ``FormatError`` for what is not understood, or notes it where the
    reading is lenient.
    """
    check_length(len(found), reading)
    balanced = repair_symbols(found, reading)
    parts = [_part(part, reading) for part in compound(balanced)]
    if len(parts) == 1:
        return replace(parts[0], notes=tuple(reading.notes))
    tiers = tuple(tier for part in parts for tier in part.tiers)
    return WrittenSign(reading.gloss, parts=tuple(parts), tiers=tiers, notes=tuple(reading.notes), where=parts[0].where)


def _part(balanced: Sequence[Token], reading: Reading) -> WrittenSign:
    """A sign that is no compound, or one part of a compound."""
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
    hands = "weak" if weak else "two" if weak_has_own(posture, motions) else "one"
    if kinds:
        hands = symmetry_kind(kinds[0] == "mirrored", "largemod" in flips, "fingerstraightmod" in flips)
    tiers = tuple(parser.tiers)
    return WrittenSign(reading.gloss, hands, alternating, False, posture, tuple(motions), tiers=tiers, where=where)


class _Parser(Slots):
    """Reads actions; postures and places are read by ``Slots``."""

    def actions(self, top: bool = False) -> list[Motion]:
        """Actions up to a plus, a closing bracket or the end."""
        found = list[Motion]()
        while (t := self.peek()).name not in ("", *CLOSERS):
            if t.name == "plus":
                if not top or not found:
                    break
                self.next()
                self.reading.note("hamplus outside brackets joins the actions beside it", t.position)
                other = self.action_or_hold(t)
                found[-1] = Motion("split", parts=(found[-1], other), where=self.where(t))
                continue
            found.append(self.action())
        if top:
            while (t := self.peek()).name:
                self.reading.refuse("stands where no symbol of its kind is expected", t.ham_name, self.next().position)
            last = self.tokens[-1].name if self.tokens else ""
            earlier = any(m.repeat for m in found[:-1])
            if len(found) > 1 and last in symbols.REPEATS and found[-1].repeat and not earlier:
                repeat, parts = found[-1].repeat, (*found[:-1], replace(found[-1], repeat=""))
                found = [Motion("sequence", parts=parts, repeat=repeat, where=found[0].where)]
        return found

    def action(self) -> Motion:
        """One action with all that belongs to it."""
        t = self.peek()
        if t.name == "nondominant":
            self.next()
            rest = Motion("hold", where=self.where(t))
            return Motion("split", parts=(rest, self.action_or_hold(t)), where=self.where(t))
        return self.parse_modifiers(replace(self.core(t), where=self.where(t)))

    def action_or_hold(self, t: Token) -> Motion:
        """One action, or none where none comes after the symbol."""
        ends = self.at("", *CLOSERS, "plus")
        return Motion("hold", where=self.where(t)) if ends else self.action()

    def core(self, t: Token) -> Motion:
        """An action without what modifies it."""
        name = t.name
        if is_posture(name) or self.is_posture_bracket():
            self.reading.note(f"{t.ham_name} after the first action is read as hamreplace", t.position)
            return self.posture_change(t)
        if self.is_location():
            return Motion("posture")  # to where ``parse_modifiers`` finds
        self.next()
        if name in symbols.BRACKETS and (found := self.of_the_body(t)) is not None:
            return found
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
        """What brackets hold that begin with a part of the body and a movement of it; the bracket is passed."""
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
        """The direction of a movement that was passed, or two whose mean is meant."""
        if not self.at("between") or not self.peek(1).name.startswith(kind):
            return (t.name.removeprefix(kind),)
        self.next()
        return t.name.removeprefix(kind), self.next().name.removeprefix(kind)

    def posture_change(self, t: Token) -> Motion:
        """A change of posture with no path."""
        for early in self.take(*symbols.KINDS["size"], *symbols.KINDS["growth"]):
            self.reading.note(f"{early.ham_name} before what changes is left out", early.position)
        posture = self.posture()
        if posture == WrittenPosture():
            self.reading.refuse("changes nothing", t.ham_name, t.position)
            return Motion("hold")
        return Motion("posture", target=posture)

    def bracket(self, t: Token) -> Motion:
        """What brackets hold; a plus within them splits it between the hands."""
        halves = [self.actions()]
        while self.take("plus"):
            halves.append(self.actions())
        self.take(symbols.BRACKETS[t.name])
        if len(halves) > 2:
            self.reading.refuse(f"holds {len(halves)} parts, expected two at most", t.ham_name, t.position)
        made = [
            self.combine_motions(_KINDS[t.name] if len(halves) == 1 else "sequence", half, t) for half in halves[:2]
        ]
        return made[0] if len(made) == 1 else Motion("split", parts=tuple(made))

    def combine_motions(self, kind: str, parts: list[Motion], t: Token) -> Motion:
        """Some motions as one; of those at one time straight ones come in turn: one alone would say their sum."""
        straight = [m for m in parts if kind == "parallel" and m.kind == "straight" and not m.repeat]
        if len(straight) > 1:
            self.reading.note(f"straight movements in {t.ham_name} come in turn", t.position)
            turns = Motion("sequence", parts=tuple(straight), where=straight[0].where)
            others = [m for m in parts if all(m is not one for one in straight)]
            parts = [turns, *others]
        if len(parts) == 1:
            return parts[0]
        if not parts:
            return Motion("hold", where=self.where(t))
        fused = WrittenManner(fused=kind == "fusion")
        return Motion(kind, parts=tuple(parts), manner=fused, where=self.where(t))

    def parse_modifiers(self, m: Motion) -> Motion:
        """An action with its sizes, curves, manner, target and repetitions."""
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
                again = Motion("sequence", parts=(m,), where=m.where) if m.repeat else m
                m = replace(again, repeat=symbols.REPEATS[name])
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
        """A motion that brackets repeat, each time further in a direction; the closing bracket comes next."""
        self.next()
        again = symbols.REPEATS[self.next().name]
        shift = self.next().name.removeprefix("move") if self.peek().name.startswith("move") else ""
        self.take(*symbols.KINDS["size"])
        self.refuse_until("seqend", "a repetition")
        return replace(m, repeat=again, shift=shift)

    def apply_path_shape(self, m: Motion, shaping: str, t: Token) -> Motion:
        """A motion, or the last within its brackets, with a curve, a zigzag or a long axis."""
        key, *kinds = _SHAPED[shaping]
        if m.kind in kinds or (shaping == "ellipse" and m.zigzag):  # the way of its swings
            return _apply_size(m, key, symbols.KINDS[shaping][t.name])
        if m.parts:
            return replace(m, parts=(*m.parts[:-1], self.apply_path_shape(m.parts[-1], shaping, t)))
        self.reading.refuse(f"does not go with a motion of the kind {m.kind}", t.ham_name, t.position)
        return m

    def apply_clock_symbol(self, m: Motion, t: Token) -> Motion:
        """A circle with its start, then its end; each whole circle is a turn more."""
        at = t.name.removeprefix("clock")
        if m.kind != "circle":
            self.reading.refuse(f"does not go with a motion of the kind {m.kind}", t.ham_name, t.position)
            return m
        if at == "full":
            return replace(m, turns=m.turns + 1.0)
        if not m.start:
            return replace(m, start=at)
        return replace(m, end=at, turns=m.turns - 1.0 if not m.end else m.turns)

    def parse_target(self, m: Motion) -> Motion:
        """A motion with the place, the site or the contact that it ends at, or that it brushes along."""
        found = self.location()
        if found == WrittenPosture():
            return m
        if found.place is not None and found.place.contact == "brushing":
            return replace(m, brushing=found.place)
        if found.pair is not None and found.pair.contact == "brushing":
            return replace(m, brushing_pair=found.pair)
        target, contact = m.target, "" if found.pair is None else found.pair.contact
        if target is not None and found == WrittenPosture(pair=Pair(contact=contact)):  # nearer to the same place
            if target.pair is not None:
                found = WrittenPosture(pair=replace(target.pair, contact=contact))
            elif target.place is not None:
                found = WrittenPosture(place=replace(target.place, contact=contact))
        return replace(m, target=merge_postures(target, found))


def _apply_size(m: Motion, key: str, size: str) -> Motion:
    """A motion of a size, or the motions within brackets that have none of their own."""
    if m.parts and key == "size":
        return replace(m, parts=tuple(part if part.size else _apply_size(part, key, size) for part in m.parts))
    return replace(m, **{key: size})  # type: ignore[arg-type]


def sign_of_element(element: Element, reading: Reading) -> WrittenSign:
    """The tree of an ``hns_sign``. Raises ``FormatError`` for what is not understood, or notes it where the reading is
    lenient.
    """
    tiers = hns_tiers((e for e in below(element) if e.tag.startswith("hnm_")), reading)
    found = list[Token]()
    for e in below(element):
        if e.tag.startswith("ham") and not e.tag.startswith("hamnosys"):
            found += symbols.resolve_symbol(e.tag.removeprefix("ham"), f"<{e.tag[:60]}>", e.line, reading)
        elif e.children and not e.tag.startswith(("hnm_", "hamnosys", "hns_")):
            reading.note(f"<{e.tag[:60]}> is left out, what is in it is read", e.line)
        elif not e.tag.startswith(("hnm_", "hamnosys", "hns_")):
            reading.refuse("is no symbol of HamNoSys 4", f"<{e.tag}>", e.line)
    written = "".join(e.text for e in (element, *element.find_elements("hamnosys_manual"))).strip()
    if not found and (written := written or element.attributes.get("hamnosys", "")):
        found = symbols.tokens(written, reading)
    if not found:
        raise reading.error("has no symbol of HamNoSys", f"<{element.tag}>", element.line)
    made = sign(found, reading)
    return replace(made, tiers=(*made.tiers, *tiers))
