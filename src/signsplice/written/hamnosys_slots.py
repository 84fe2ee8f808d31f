"""The slots of HamNoSys postures: handshapes, directions of fingers and palm, places, sites and contacts."""

from __future__ import annotations

from collections.abc import Callable, Container, Sequence
from dataclasses import replace

from signsplice.written import symbols
from signsplice.written.symbols import CLOSERS, PALMS, SITES, Row, Token, is_posture
from signsplice.written.tree import Pair, Place, Site, WrittenPosture, WrittenShape, merge_postures, with_weak

_ARM = ("elbow", "elbowinside", "lowerarm", "upperarm")
_ON_HEAD = tuple(symbols.PLACES)[: tuple(symbols.PLACES).index("neck")]


class Slots(Row):
    """Reads slots off a row of symbols."""

    def posture(self) -> WrittenPosture:
        """Slots up to what is none."""
        found = WrittenPosture()
        while (t := self.peek()).name:
            if t.name == "orirelative":
                self.reading.note("hamorirelative is left out", self.next().position)
            elif t.name == "nondominant":
                if not self.slot_follows():
                    break
                self.next()
                found = with_weak(found, self.slot(found))
            elif found.shape is not None and (t.name in symbols.BENDS or t.name in symbols.THUMBS):
                self.reading.note(f"{t.ham_name} is read as if it followed the handshape", self.next().position)
                found = replace(found, shape=_apply_shape_modifier(found.shape, t.name))
            elif t.name in symbols.KINDS["size"] and self.slot_follows():
                self.reading.note(f"{t.ham_name} within a posture is left out", self.next().position)
            elif t.name == "plus":
                if not self.slot_follows():
                    break
                self.reading.note("hamplus outside brackets joins the slots beside it", self.next().position)
                found = with_weak(found, self.slot(WrittenPosture()))
            elif is_posture(t.name) or self.is_posture_bracket() or self.is_location():
                found = _add_slot(found, self.slot(found), self.two)
            else:
                break
        return found

    def slot(self, before: WrittenPosture) -> WrittenPosture:
        """One slot, or slots in brackets."""
        t = self.peek()
        if self.is_location():
            return self.location()
        if t.name in symbols.SHAPES:
            if before.shape is not None:
                what = "is a second handshape, expected hambetween or hamplus before it"
                self.reading.refuse(what, t.ham_name, t.position)
            return WrittenPosture(shape=self.shape())
        if t.name.startswith("extfinger"):
            return WrittenPosture(fingers=self.directions("extfinger"))
        if t.name in PALMS:
            return WrittenPosture(palm=self.directions("palm"))
        return self.split()

    def split(self) -> WrittenPosture:
        """Slots of the strong hand, plus, slots of the weak one, in brackets."""
        closer = symbols.BRACKETS[self.peek().name]
        halves = self.halves(lambda _: self.inner(), closer, "a posture", "parts")
        return halves[0] if len(halves) == 1 else with_weak(halves[0], halves[1])

    def halves(
        self, read: Callable[[bool], WrittenPosture], closer: str, within: str, parts: str
    ) -> list[WrittenPosture]:
        """What stands in brackets on either side of plus, each read as the first or a later one."""
        opener, found = self.next(), [read(False)]
        while self.take("plus"):
            self.second = True
            found.append(read(True))
        self.second = False
        self.refuse_until(closer, within)
        self.take(closer)
        if len(found) > 2:
            self.reading.refuse(f"holds {len(found)} {parts}, expected two", opener.ham_name, opener.position)
        return found

    def inner(self) -> WrittenPosture:
        """Slots up to a plus or a closing bracket."""
        found = WrittenPosture()
        while (t := self.peek()).name not in ("", "plus", *CLOSERS):
            if t.name == "nondominant":
                self.next()
            elif is_posture(t.name) or self.is_location() or self.is_posture_bracket():
                found = _add_slot(found, self.slot(found), self.two)
            else:
                break
        return found

    def directions(self, kind: str) -> tuple[str, ...]:
        """Letters of one direction, or of two whose mean is meant."""
        names = PALMS if kind == "palm" else tuple(n for n in symbols.NAMES if n.startswith(kind))
        found = [self.next().name.removeprefix(kind)]
        while True:
            if self.at("between") and self.peek(1).name in names:
                self.next()
            elif not self.at(*names):
                break
            t = self.next()
            if len(found) == 2:
                self.reading.refuse("is a third direction, expected two at most", t.ham_name, t.position)
                continue
            found.append(t.name.removeprefix(kind))
        return tuple(found)

    # --- handshapes

    def shape(self) -> WrittenShape:
        """A handshape with its thumb, bends and fingers."""
        made = WrittenShape(symbols.SHAPES[self.next().name])
        while (t := self.peek()).name:
            following = self.peek(1).name
            if t.name in symbols.THUMBS or t.name in symbols.BENDS:
                made = _apply_shape_modifier(made, self.next().name)
            elif t.name in symbols.DIGITS:
                made = self.fingers(made)
            elif t.name == "between" and following in symbols.SHAPES:
                self.next()
                return replace(made, between=self.shape())
            elif t.name == "between" and (following in symbols.THUMBS or following in symbols.BENDS):
                self.next()
                plain = replace(made, bend="" if following in symbols.BENDS else made.bend)
                return replace(made, between=_apply_shape_modifier(plain, self.next().name))
            elif t.name == "between" and following in symbols.DIGITS:
                self.next()
                self.take(*symbols.DIGITS)
                made = replace(made, thumb_enclosed=True)
            else:
                break
        return made

    def fingers(self, made: WrittenShape) -> WrittenShape:
        """A handshape with a finger that bends on its own, crosses another, or is selected."""
        digit = symbols.DIGITS[self.next().name]
        meets = self.left_out_parts() and self.at(*symbols.DIGITS)
        t = self.peek()
        if meets or (t.name in ("cross", "touch") and self.peek(1).name in symbols.DIGITS):
            crossed = meets or self.next().name == "cross"  # a part of one finger at another says that they cross
            other = symbols.DIGITS[self.next().name]
            self.left_out_parts()
            if 1 in (digit, other):  # the thumb meets a finger
                return replace(made, opposed=max(digit, other))
            return replace(made, pair=(digit, other), crossed=crossed)
        if t.name in symbols.BENDS:
            return replace(made, bends=(*made.bends, (digit, symbols.BENDS[self.next().name])))
        if digit == 1 and (t.name in symbols.THUMBS or t.name == "between"):
            return made
        return replace(made, special=(*made.special, digit))

    def left_out_parts(self) -> bool:
        """Pass over parts of fingers within a handshape, if any: where fingers meet is not made as finely."""
        parts = self.take(*symbols.FINGER_PARTS)
        for part in parts:
            self.reading.note(f"{part.ham_name} within a handshape is left out", part.position)
        return bool(parts)

    # --- places

    def location(self, weak: bool = True) -> WrittenPosture:
        """A place on the body, a site of a hand (``weak`` says which), two hands together, or a contact alone."""
        if self.at("seqbegin") and self.peek(1).name == "brushing":
            return self.parse_brushing()
        found = self.hands_together() if self.at("parbegin") else self.place(weak)
        contact, own = self.contact()
        if own is not None and own.part in _ARM:
            self.reading.note(f"ham{own.part} of the arm that touches is left out", self.tokens[self._at - 1].position)
            own = None
            if found.place is None:
                return WrittenPosture()
        if found.pair is not None or found.place is None:
            pair = found.pair or Pair()
            pair = replace(pair, contact=contact or pair.contact, strong=own or pair.strong)
            return replace(found, pair=pair)
        place = replace(found.place, contact=contact or found.place.contact, hand=own or found.place.hand)
        other = found.weak
        if other is not None and other.place is not None and contact:
            other = replace(other, place=replace(other.place, contact=other.place.contact or contact))
        return replace(found, place=place, weak=other)

    def parse_brushing(self) -> WrittenPosture:
        """A place or a site in brackets that a hand brushes along."""
        self.next()
        self.next()
        found = self.place()
        self.take(*symbols.CONTACTS)
        self.refuse_until("seqend", "what is brushed")
        self.take("seqend")
        if found.place is not None:
            return WrittenPosture(place=replace(found.place, contact="brushing"))
        return WrittenPosture(pair=replace(found.pair or Pair(), contact="brushing"))

    def hands_together(self) -> WrittenPosture:
        """Brackets with two sites (the first on the weak hand), a site and a place, or a place for each hand."""

        def read(later: bool) -> WrittenPosture:
            return self.location(weak=not later) if self.is_location() else WrittenPosture()

        halves = self.halves(read, "parend", "a location", "places")
        if len(halves) == 1:
            return halves[0]
        first, second = halves[:2]
        a, b = first.pair, second.pair
        if a is not None and b is not None:
            return WrittenPosture(pair=Pair(a.weak, b.weak, a.contact or b.contact))
        if a is not None or b is not None:
            site, place = (a, second.place) if a is not None else (b, first.place)
            return WrittenPosture(pair=replace(site or Pair(), place=place))
        return with_weak(first, second)

    def place(self, weak: bool = True) -> WrittenPosture:
        """A place or a site with its side, and the other of two between which it is; empty where a contact comes."""
        before = self.take(*symbols.SIDES)
        t = self.peek()
        if t.name in symbols.PLACES:
            t = self.next()
            side = self.parse_side(before)
            crossed, own = ("right", "left") if self.second else ("left", "right")
            if self.mirrored and side.startswith(crossed) and t.name in _ON_HEAD:  # crossed arms hide the face
                this, that = ("before", "after") if before else ("after", "before")
                shown = f"ham{'lrat' if side.endswith('at') else 'lrbeside'} {this} {t.ham_name}"
                self.reading.note(f"{shown} is read as {that} it: hands would cross", t.position)
                side = side.replace(crossed, own)
            place = Place(symbols.PLACES[t.name], side)
            if self.between(symbols.PLACES):
                other = self.place().place
                place = replace(place, between=other)
            self.last = replace(place, behind=bool(self.take("behind")))
            return WrittenPosture(place=self.last)
        if t.name in SITES:
            return WrittenPosture(pair=Pair(weak=self.site(weak, before)))
        if before:
            self.reading.note(f"{before[0].ham_name} without a place is read as right_at the body", before[0].position)
            return WrittenPosture(place=Place("", "right_at"))
        if self.at("behind") and self.last is not None:
            self.next()
            return WrittenPosture(place=replace(self.last, contact="", behind=True))
        for lost in self.take("behind"):
            self.reading.refuse("says behind what no place says", lost.ham_name, lost.position)
        return WrittenPosture()

    def parse_side(self, before: Sequence[Token]) -> str:
        """The side of a place: a symbol before it says left, one after it right."""
        after = self.take(*symbols.SIDES)
        if before:
            return f"left_{symbols.SIDES[before[0].name]}"
        return f"right_{symbols.SIDES[after[0].name]}" if after else ""

    def between(self, names: Container[str]) -> bool:
        """Whether the other of two places or sites follows; hambetween is passed."""
        after = self.peek(1).name
        return self.at("between") and (after in names or after in symbols.SIDES) and bool(self.take("between"))

    def site(self, weak: bool, before: Sequence[Token] = ()) -> Site:
        """A part of a hand: fingers and their part in either order, and a side."""
        part, side, digits = "", "", list[int]()
        for t in self.take(*SITES):
            if t.name in symbols.DIGITS:
                digits.append(symbols.DIGITS[t.name])
            elif t.name in symbols.FINGER_PARTS:
                part = symbols.FINGER_PARTS[t.name]
            elif not part and not digits:
                part = t.name
            else:
                side = symbols.HAND_PARTS[t.name]
        if word := self.parse_side(before):
            side = "radial" if word.startswith("left") != weak else "ulnar"
        made = Site(part or "midjoint", tuple(digits[:2]), side)
        return replace(made, between=self.site(weak)) if self.between(SITES) else made

    def contact(self) -> tuple[str, Site | None]:
        """The contact that follows a place, and the part of the moving hand in brackets after it."""
        names = [t.name for t in self.take(*symbols.CONTACTS)]
        own: Site | None = None
        if self.at("seqbegin") and self.is_location():
            self.next()
            names += [t.name for t in self.take(*symbols.CONTACTS)]
            before = self.take(*symbols.SIDES)
            own = self.site(False, before) if self.at(*SITES) else None
            for arm in self.take(*_ARM):
                own = Site(arm.name)
            names += [t.name for t in self.take(*symbols.CONTACTS)]
            self.refuse_until("seqend", "a part of the hand")
            self.take("seqend")
        strongest = next((name for name in ("interlock", "cross", "brushing") if name in names), "")
        return strongest or (names[-1] if names else ""), own


def _apply_shape_modifier(made: WrittenShape, name: str) -> WrittenShape:
    """A handshape with a bend or a place of the thumb."""
    if name in symbols.BENDS:
        return replace(made, bend=symbols.BENDS[name])
    if name == "thumbopenmod" and made.base.startswith("cee"):
        return replace(made, opening=0.6)
    return replace(made, thumb=symbols.THUMBS[name])


def _add_slot(before: WrittenPosture, after: WrittenPosture, two: bool) -> WrittenPosture:
    """A posture with a slot more; a place beside a pair of hands says where the pair is. ``two``: a contact before a
    place is between the hands.
    """
    found = merge_postures(before, after) or before
    if found.pair is not None and found.place is not None:
        between = before.pair is not None and (two or found.weak is not None)
        if found.pair.weak is None and found.pair.place is None and not between:
            contact, hand = found.place.contact or found.pair.contact, found.place.hand or found.pair.strong
            return replace(found, pair=None, place=replace(found.place, contact=contact, hand=hand))
        return replace(found, place=None, pair=replace(found.pair, place=found.place))
    return found
