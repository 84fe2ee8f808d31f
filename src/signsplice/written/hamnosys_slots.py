"""Parses the slots of HamNoSys postures: handshapes, directions of fingers and palm, places, sites and contacts."""

from __future__ import annotations

from collections.abc import Callable, Container, Sequence
from dataclasses import replace

from signsplice.written import symbols
from signsplice.written.symbols import CLOSERS, PALMS, SITES, Row, Token, is_posture
from signsplice.written.tree import Pair, Place, Site, WrittenPosture, WrittenShape, merge_postures, with_weak

_ARM = ("elbow", "elbowinside", "lowerarm", "upperarm")
_ON_HEAD = tuple(symbols.PLACES)[: tuple(symbols.PLACES).index("neck")]


class Slots(Row):
    """Parses slots from a row of symbols."""

    def posture(self) -> WrittenPosture:
        """Parses slots up to the first symbol that begins no slot."""
        posture = WrittenPosture()
        while (t := self.peek()).name:
            if t.name == "orirelative":
                self.reading.note("hamorirelative is left out", self.next().position)
            elif t.name == "nondominant":
                if not self.slot_follows():
                    break
                self.next()
                posture = with_weak(posture, self.slot(posture))
            elif posture.shape is not None and (t.name in symbols.BENDS or t.name in symbols.THUMBS):
                self.reading.note(f"{t.ham_name} is read as if it followed the handshape", self.next().position)
                posture = replace(posture, shape=_apply_shape_modifier(posture.shape, t.name))
            elif t.name in symbols.KINDS["size"] and self.slot_follows():
                self.reading.note(f"{t.ham_name} within a posture is left out", self.next().position)
            elif t.name == "plus":
                if not self.slot_follows():
                    break
                self.reading.note("hamplus outside brackets joins the slots beside it", self.next().position)
                posture = with_weak(posture, self.slot(WrittenPosture()))
            elif is_posture(t.name) or self.is_posture_bracket() or self.is_location():
                posture = _add_slot(posture, self.slot(posture), self.two)
            else:
                break
        return posture

    def slot(self, before: WrittenPosture) -> WrittenPosture:
        """Parses one slot, or slots in brackets."""
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
        """Parses bracketed slots: those of the strong hand, plus, those of the weak hand."""
        closer = symbols.BRACKETS[self.peek().name]
        halves = self.halves(lambda _: self.inner(), closer, "a posture", "parts")
        return halves[0] if len(halves) == 1 else with_weak(halves[0], halves[1])

    def halves(
        self, read: Callable[[bool], WrittenPosture], closer: str, within: str, parts: str
    ) -> list[WrittenPosture]:
        """Parses the bracketed content on each side of plus; ``read`` gets False for the first side, then True."""
        opener, postures = self.next(), [read(False)]
        while self.take("plus"):
            self.second = True
            postures.append(read(True))
        self.second = False
        self.refuse_until(closer, within)
        self.take(closer)
        if len(postures) > 2:
            self.reading.refuse(f"holds {len(postures)} {parts}, expected two", opener.ham_name, opener.position)
        return postures

    def inner(self) -> WrittenPosture:
        """Parses slots up to a plus or a closing bracket."""
        posture = WrittenPosture()
        while (t := self.peek()).name not in ("", "plus", *CLOSERS):
            if t.name == "nondominant":
                self.next()
            elif is_posture(t.name) or self.is_location() or self.is_posture_bracket():
                posture = _add_slot(posture, self.slot(posture), self.two)
            else:
                break
        return posture

    def directions(self, kind: str) -> tuple[str, ...]:
        """Parses one direction, or two whose mean is meant."""
        names = PALMS if kind == "palm" else tuple(n for n in symbols.NAMES if n.startswith(kind))
        letters = [self.next().name.removeprefix(kind)]
        while True:
            if self.at("between") and self.peek(1).name in names:
                self.next()
            elif not self.at(*names):
                break
            t = self.next()
            if len(letters) == 2:
                self.reading.refuse("is a third direction, expected two at most", t.ham_name, t.position)
                continue
            letters.append(t.name.removeprefix(kind))
        return tuple(letters)

    # --- handshapes

    def shape(self) -> WrittenShape:
        """Parses a handshape with its thumb, bends and fingers."""
        shape = WrittenShape(symbols.SHAPES[self.next().name])
        while (t := self.peek()).name:
            following = self.peek(1).name
            if t.name in symbols.THUMBS or t.name in symbols.BENDS:
                shape = _apply_shape_modifier(shape, self.next().name)
            elif t.name in symbols.DIGITS:
                shape = self.fingers(shape)
            elif t.name == "between" and following in symbols.SHAPES:
                self.next()
                return replace(shape, between=self.shape())
            elif t.name == "between" and (following in symbols.THUMBS or following in symbols.BENDS):
                self.next()
                plain = replace(shape, bend="" if following in symbols.BENDS else shape.bend)
                return replace(shape, between=_apply_shape_modifier(plain, self.next().name))
            elif t.name == "between" and following in symbols.DIGITS:
                self.next()
                self.take(*symbols.DIGITS)
                shape = replace(shape, thumb_enclosed=True)
            else:
                break
        return shape

    def fingers(self, made: WrittenShape) -> WrittenShape:
        """Adds a finger that bends alone, crosses another, or is selected."""
        digit = symbols.DIGITS[self.next().name]
        meets = self.left_out_parts() and self.at(*symbols.DIGITS)
        t = self.peek()
        if meets or (t.name in ("cross", "touch") and self.peek(1).name in symbols.DIGITS):
            crossed = meets or self.next().name == "cross"  # a part of one finger at another says that they cross
            other_digit = symbols.DIGITS[self.next().name]
            self.left_out_parts()
            if 1 in (digit, other_digit):  # the thumb meets a finger
                return replace(made, opposed=max(digit, other_digit))
            return replace(made, pair=(digit, other_digit), crossed=crossed)
        if t.name in symbols.BENDS:
            return replace(made, bends=(*made.bends, (digit, symbols.BENDS[self.next().name])))
        if digit == 1 and (t.name in symbols.THUMBS or t.name == "between"):
            return made
        return replace(made, special=(*made.special, digit))

    def left_out_parts(self) -> bool:
        """Skip parts of fingers within a handshape: the notation does not say where fingers meet in such detail."""
        parts = self.take(*symbols.FINGER_PARTS)
        for part in parts:
            self.reading.note(f"{part.ham_name} within a handshape is left out", part.position)
        return bool(parts)

    # --- places

    def location(self, weak: bool = True) -> WrittenPosture:
        """Parses a place on the body, a site of a hand (``weak`` says which), two hands together, or a contact."""
        if self.at("seqbegin") and self.peek(1).name == "brushing":
            return self.parse_brushing()
        posture = self.hands_together() if self.at("parbegin") else self.place(weak)
        contact, strong_site = self.contact()
        if strong_site is not None and strong_site.part in _ARM:
            self.reading.note(
                f"ham{strong_site.part} of the arm that touches is left out", self.tokens[self._at - 1].position
            )
            strong_site = None
            if posture.place is None:
                return WrittenPosture()
        if posture.pair is not None or posture.place is None:
            pair = posture.pair or Pair()
            pair = replace(pair, contact=contact or pair.contact, strong=strong_site or pair.strong)
            return replace(posture, pair=pair)
        place = replace(posture.place, contact=contact or posture.place.contact, hand=strong_site or posture.place.hand)
        weak_posture = posture.weak
        if weak_posture is not None and weak_posture.place is not None and contact:
            weak_posture = replace(
                weak_posture, place=replace(weak_posture.place, contact=weak_posture.place.contact or contact)
            )
        return replace(posture, place=place, weak=weak_posture)

    def parse_brushing(self) -> WrittenPosture:
        """Parses a bracketed place or site along which a hand brushes."""
        self.next()
        self.next()
        posture = self.place()
        self.take(*symbols.CONTACTS)
        self.refuse_until("seqend", "what is brushed")
        self.take("seqend")
        if posture.place is not None:
            return WrittenPosture(place=replace(posture.place, contact="brushing"))
        return WrittenPosture(pair=replace(posture.pair or Pair(), contact="brushing"))

    def hands_together(self) -> WrittenPosture:
        """Parses bracketed sites (the first on the weak hand), a site and a place, or one place for each hand."""

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
        """Parses a place or a site with its side, or two that it lies between; empty if a contact comes next."""
        before = self.take(*symbols.SIDES)
        t = self.peek()
        if t.name in symbols.PLACES:
            t = self.next()
            side = self.parse_side(before)
            crossed_side, own_side = ("right", "left") if self.second else ("left", "right")
            if self.mirrored and side.startswith(crossed_side) and t.name in _ON_HEAD:  # crossed arms hide the face
                this, that = ("before", "after") if before else ("after", "before")
                shown = f"ham{'lrat' if side.endswith('at') else 'lrbeside'} {this} {t.ham_name}"
                self.reading.note(f"{shown} is read as {that} it: hands would cross", t.position)
                side = side.replace(crossed_side, own_side)
            place = Place(symbols.PLACES[t.name], side)
            if self.between(symbols.PLACES):
                second_place = self.place().place
                place = replace(place, between=second_place)
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
        """Parses the side of a place: a symbol before the place means left, after it right."""
        after = self.take(*symbols.SIDES)
        if before:
            return f"left_{symbols.SIDES[before[0].name]}"
        return f"right_{symbols.SIDES[after[0].name]}" if after else ""

    def between(self, names: Container[str]) -> bool:
        """Whether a second place or site follows hambetween, which is then consumed."""
        after = self.peek(1).name
        return self.at("between") and (after in names or after in symbols.SIDES) and bool(self.take("between"))

    def site(self, weak: bool, before: Sequence[Token] = ()) -> Site:
        """Parses a part of a hand: fingers and their part in either order, and a side."""
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
        site = Site(part or "midjoint", tuple(digits[:2]), side)
        return replace(site, between=self.site(weak)) if self.between(SITES) else site

    def contact(self) -> tuple[str, Site | None]:
        """Parses the contact after a place, and the bracketed part of the moving hand after it."""
        names = [t.name for t in self.take(*symbols.CONTACTS)]
        site: Site | None = None
        if self.at("seqbegin") and self.is_location():
            self.next()
            names += [t.name for t in self.take(*symbols.CONTACTS)]
            before = self.take(*symbols.SIDES)
            site = self.site(False, before) if self.at(*SITES) else None
            for arm in self.take(*_ARM):
                site = Site(arm.name)
            names += [t.name for t in self.take(*symbols.CONTACTS)]
            self.refuse_until("seqend", "a part of the hand")
            self.take("seqend")
        strongest = next((name for name in ("interlock", "cross", "brushing") if name in names), "")
        return strongest or (names[-1] if names else ""), site


def _apply_shape_modifier(shape: WrittenShape, name: str) -> WrittenShape:
    """Sets a bend or a thumb position of a handshape."""
    if name in symbols.BENDS:
        return replace(shape, bend=symbols.BENDS[name])
    if name == "thumbopenmod" and shape.base.startswith("cee"):
        return replace(shape, opening=0.6)
    return replace(shape, thumb=symbols.THUMBS[name])


def _add_slot(before: WrittenPosture, after: WrittenPosture, two: bool) -> WrittenPosture:
    """Adds a slot to a posture; a place next to a pair locates the pair. ``two``: a contact before a place is between
    the hands.
    """
    posture = merge_postures(before, after) or before
    if posture.pair is not None and posture.place is not None:
        between = before.pair is not None and (two or posture.weak is not None)
        if posture.pair.weak is None and posture.pair.place is None and not between:
            contact, hand = posture.place.contact or posture.pair.contact, posture.place.hand or posture.pair.strong
            return replace(posture, pair=None, place=replace(posture.place, contact=contact, hand=hand))
        return replace(posture, place=None, pair=replace(posture.pair, place=posture.place))
    return posture
