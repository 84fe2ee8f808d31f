"""HamNoSys 4 as a tree: the symbols of a text, or the elements of HamNoSys SiGML, by one grammar.

    sign    = {symmetry | "alternatingmotion" | "nonipsi"}, posture, {action}
    posture = {slot | "parbegin", {slot}, "plus", {slot}, "parend"}        slot: handshape, F, palm, location
    action  = core, {modifier | location | contact | repetition}
    core    = move | circle | wrist | "replace", {slot} | bracket, {action}, ["plus", {action}], end

The order of the slots is that of Hamburg's overview of HamNoSys; other orders are read too. Notations with the defects
that dictionaries have are mended, and each mend is noted.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

from signsplice.synth.written import symbols
from signsplice.synth.written.hamnosys_row import Token, is_posture
from signsplice.synth.written.hamnosys_slots import Slots
from signsplice.synth.written.reading import Reading, merged, weak_has_own
from signsplice.synth.written.tree import Motion, Pair, WrittenManner, WrittenPosture, WrittenSign

_MOST_SYMBOLS, _MOST_DEPTH = 1000, 12
_SYMMETRY = {"symmpar": "parallel", "symmlr": "mirrored"}
_KINDS = {"parbegin": "parallel", "seqbegin": "sequence", "fusionbegin": "fusion"}
_CLOSERS = frozenset(symbols.BRACKETS.values())
_UNSUPPORTED = {
    "coreftag": "coreference", "corefref": "coreference", "wristtopulse": "a bent wrist", "wristtoback": "a bent wrist",
    "wristtothumb": "a bent wrist", "wristtopinky": "a bent wrist", "mime": "a mimed action", "etc": "and so on",
}  # fmt: skip


def tokens(text: str, reading: Reading) -> list[Token]:
    """The symbols of a text, numbered from 1: characters of the font, or names such as hamflathand between blanks."""
    if "ham" in text.lower():
        words = text.replace(",", " ").split()
    else:
        words = [c for c in text if not c.isspace()]
        if len(words) < len(text.strip()):
            reading.note("blanks are left out", 0)
    if len(words) > _MOST_SYMBOLS:
        raise reading.error(f"has {len(words):,} symbols, expected at most {_MOST_SYMBOLS:,}", "", 0)
    found = list[Token]()
    for position, word in enumerate(words, 1):
        name = symbols.SYMBOLS.get(word)
        if name is None and word[:3].lower() == "ham":
            name = word[3:]
        found += named(name or "", word if word.isprintable() else f"U+{ord(word[0]):04X}", position, reading)
    return found


def named(name: str, shown: str, position: int, reading: Reading) -> list[Token]:
    """One symbol by its name without ham; none where it is left out. ``shown``: how errors call it."""
    if name in symbols.ALIASES:
        reading.note(f"ham{name} is read as ham{symbols.ALIASES[name]}", position)
        name = symbols.ALIASES[name]
    if name not in symbols.NAMES:
        reading.refuse("is no symbol of HamNoSys 4", shown, position)
        return []
    if name in _UNSUPPORTED:
        reading.refuse(f"stands for {_UNSUPPORTED[name]}, which is not made", f"ham{name}", position)
        return []
    return [] if name == "version40" else [Token(name, position)]


def sign(found: Sequence[Token], reading: Reading) -> WrittenSign:
    """The tree of a notation's symbols. Raises ``FormatError`` for what is not understood, or notes it where the
    reading is lenient.
    """
    where = reading.where("", found[0].position if found else 0)
    if not found:
        raise reading.error("has no symbol of HamNoSys", "", 0)
    balanced = _balanced(found, reading)
    kinds = [_SYMMETRY[t.name] for t in balanced if t.name in _SYMMETRY]
    if len(set(kinds)) > 1:
        reading.refuse("has two kinds of symmetry, expected one", "hamsymmlr", where.position)
    front = next((n for n, t in enumerate(balanced) if t.name not in (*_SYMMETRY, "alternatingmotion", "nonipsi")), 0)
    alternating = any(t.name == "alternatingmotion" for t in balanced[:front])
    crossed = any(t.name == "nonipsi" for t in balanced)
    rest = list[Token]()
    for t in balanced[front:]:
        if t.name in (*_SYMMETRY, "nonipsi"):
            reading.note(f"{t.shown} is read as if it stood first", t.position)
        else:
            rest.append(t)
    weak = bool(rest) and rest[0].name == "nondominant" and not kinds and all(t.name != "plus" for t in rest)
    parser = _Parser(rest[1:] if weak else rest, reading, kinds[:1] == ["mirrored"])
    posture = parser.posture()
    motions = parser.actions(top=True)
    if posture == WrittenPosture():
        raise reading.error("has no handshape, direction or place before its movement", "", where.position)
    if crossed and posture.place is not None and not posture.place.side:
        posture = replace(posture, place=replace(posture.place, side="left_at"))
    two = weak_has_own([posture, *(m.target for m in _all(motions))]) or any(m.kind == "split" for m in _all(motions))
    hands = "weak" if weak else kinds[0] if kinds else "two" if two else "one"
    return WrittenSign(
        reading.gloss, hands, alternating, posture=posture, motions=tuple(motions), notes=tuple(reading.notes),
        where=where,
    )  # fmt: skip


def _balanced(found: Sequence[Token], reading: Reading) -> list[Token]:
    """Symbols whose brackets are closed where they are open at the end, without closers of nothing."""
    kept, stack = list[Token](), list[str]()
    for t in found:
        if t.name in symbols.BRACKETS:
            stack.append(symbols.BRACKETS[t.name])
            if len(stack) > _MOST_DEPTH:
                raise reading.error(f"expected at most {_MOST_DEPTH} brackets within one another", t.shown, t.position)
        elif t.name in _CLOSERS:
            if t.name not in stack:
                reading.note(f"{t.shown} closes no bracket and is left out", t.position)
                continue
            while stack[-1] != t.name:
                reading.note(f"ham{stack[-1]} is added before {t.shown}", t.position)
                kept.append(Token(stack.pop(), t.position))
            stack.pop()
        kept.append(t)
    for closer in reversed(stack):
        reading.note(f"ham{closer} is added at the end", found[-1].position)
        kept.append(Token(closer, found[-1].position))
    return kept


def _all(motions: Iterable[Motion]) -> list[Motion]:
    return [one for m in motions for one in (m, *_all(m.parts))]


class _Parser(Slots):
    """Reads actions; postures and places are read by ``Slots``."""

    def actions(self, top: bool = False) -> list[Motion]:
        """Actions up to a plus, a closing bracket or the end."""
        found = list[Motion]()
        while (t := self.peek()) is not None and t.name not in _CLOSERS:
            if t.name == "plus":
                if not top or not found:
                    break
                self.next()
                self.reading.note("hamplus outside brackets joins the actions beside it", t.position)
                other = self.action()
                found[-1] = Motion("split", parts=(found[-1], other), where=self.where(t))
                continue
            found.append(self.action())
        if top:
            for t in self.rest():
                self.reading.refuse("stands where no symbol of its kind is expected", t.shown, t.position)
            last = self.tokens[-1].name if self.tokens else ""
            earlier = any(m.repeat for m in found[:-1])
            if len(found) > 1 and last in symbols.REPEATS and found[-1].repeat and not earlier:
                repeat, parts = found[-1].repeat, (*found[:-1], replace(found[-1], repeat=""))
                found = [Motion("sequence", parts=parts, repeat=repeat, where=found[0].where)]
        return found

    def action(self) -> Motion:
        """One action with all that belongs to it."""
        t = self.peek()
        assert t is not None
        if t.name == "nondominant":
            self.next()
            rest = Motion("hold", where=self.where(t))
            inner = self.action() if self.peek() is not None and not self.at(*_CLOSERS, "plus") else rest
            return Motion("split", parts=(rest, inner), where=self.where(t))
        return self.modified(replace(self.core(t), where=self.where(t)))

    def core(self, t: Token) -> Motion:
        """An action without what modifies it."""
        name = t.name
        if is_posture(name) or (name in symbols.BRACKETS and self.is_posture_bracket()):
            self.reading.note(f"{t.shown} after the first action is read as hamreplace", t.position)
            return self.posture_change(t)
        self.next()
        if name == "replace":
            return self.posture_change(t)
        if name in symbols.BRACKETS:
            return self.bracket(t)
        if name in ("movecross", "moveX"):
            return Motion("crossing")
        if name.startswith("move"):
            return Motion("straight", (name.removeprefix("move"),))
        if name.startswith("circle"):
            return Motion("circle", (name.removeprefix("circle"),))
        if name in symbols.WRISTS:
            return Motion(name)
        if name == "fingerplay":
            digits = [symbols.DIGITS[d.name] for d in self.take(*symbols.DIGITS)]
            return Motion("fingerplay", digits=tuple(digits))
        if name != "nomotion":
            self.reading.refuse("modifies no action", t.shown, t.position)
        return Motion("hold")

    def posture_change(self, t: Token) -> Motion:
        """A change of posture with no path."""
        posture = self.posture()
        if posture == WrittenPosture():
            self.reading.refuse("changes nothing", t.shown, t.position)
            return Motion("hold")
        return Motion("posture", target=posture)

    def bracket(self, t: Token) -> Motion:
        """What brackets hold; a plus within them splits it between the hands."""
        halves = [self.actions()]
        while self.take("plus"):
            halves.append(self.actions())
        self.take(symbols.BRACKETS[t.name])
        if len(halves) > 2:
            self.reading.refuse(f"holds {len(halves)} parts, expected two at most", t.shown, t.position)
        made = [self.joined(_KINDS[t.name] if len(halves) == 1 else "sequence", half, t) for half in halves[:2]]
        return made[0] if len(made) == 1 else Motion("split", parts=tuple(made))

    def joined(self, kind: str, parts: list[Motion], t: Token) -> Motion:
        """Some motions as one."""
        if len(parts) == 1:
            return parts[0]
        if not parts:
            return Motion("hold", where=self.where(t))
        fused = WrittenManner(fused=kind == "fusion")
        return Motion(kind, parts=tuple(parts), manner=fused, where=self.where(t))

    def modified(self, m: Motion) -> Motion:
        """An action with its sizes, curves, manner, target and repetitions."""
        sized = "size"
        while (t := self.peek()) is not None:
            name = t.name
            if name in symbols.ARCS or name in ("wavy", "zigzag") or name in symbols.ELLIPSES:
                m, sized = self.shaped(m, t)
            elif name in ("smallmod", "largemod"):
                m = _sized(m, sized, "small" if name == "smallmod" else "big")
            elif name in ("increasing", "decreasing"):
                m = _sized(m, "size_end", "big" if name == "increasing" else "small")
            elif name.startswith("clock"):
                m = self.clocked(m, t)
            elif name in symbols.MANNERS:
                m = replace(m, manner=replace(m.manner, **{name: True}))
            elif name in symbols.REPEATS:
                outer = replace(m, repeat="") if not m.repeat else Motion("sequence", parts=(m,), where=m.where)
                m = replace(outer, repeat=symbols.REPEATS[name])
            elif name == "alternatingmotion":
                m = replace(m, alternating=True)
            elif self.is_location():
                m = self.aimed(m)
                continue
            else:
                break
            self.next()
        return m

    def shaped(self, m: Motion, t: Token) -> tuple[Motion, str]:
        """A motion with a curve, a zigzag or a long axis, and what a size after it is the size of."""
        if t.name in symbols.ARCS:
            fits, key, value = m.kind == "straight", "curve", symbols.ARCS[t.name]
        elif t.name in symbols.ELLIPSES:
            fits, key, value = m.kind == "circle", "ellipse", symbols.ELLIPSES[t.name]
        else:
            fits, key, value = m.kind in ("straight", "circle"), "zigzag", t.name
        if not fits:
            if m.parts:
                parts = list(m.parts)
                parts[-1], _ = self.shaped(parts[-1], t)
                return replace(m, parts=tuple(parts)), f"{key}_size"
            self.reading.refuse(f"does not go with a motion of the kind {m.kind}", t.shown, t.position)
            return m, "size"
        changed: dict[str, Any] = {key: value}
        return replace(m, **changed), f"{key}_size"

    def clocked(self, m: Motion, t: Token) -> Motion:
        """A circle with its start, then its end; each whole circle is a turn more."""
        at = t.name.removeprefix("clock")
        if m.kind != "circle":
            self.reading.refuse(f"does not go with a motion of the kind {m.kind}", t.shown, t.position)
            return m
        if at == "full":
            return replace(m, turns=m.turns + 1.0)
        if not m.start:
            return replace(m, start=at)
        return replace(m, end=at, turns=m.turns - 1.0 if not m.end else m.turns)

    def aimed(self, m: Motion) -> Motion:
        """A motion with the place, the site or the contact that it ends at, or that it brushes along."""
        found = self.location()
        if found.place is not None and found.place.contact == "brushing":
            return replace(m, brushing=found.place)
        if found.pair is not None and found.pair.contact == "brushing":
            return replace(m, brushing_pair=found.pair)
        target = m.target
        if target is not None and found.pair is not None and found.pair == Pair(contact=found.pair.contact):
            if target.pair is not None:
                return replace(m, target=replace(target, pair=replace(target.pair, contact=found.pair.contact)))
            if target.place is not None:
                return replace(m, target=replace(target, place=replace(target.place, contact=found.pair.contact)))
        return replace(m, target=merged(target, found))


def _sized(m: Motion, key: str, size: str) -> Motion:
    """A motion of a size, or the motions within brackets that have none of their own."""
    if m.parts and key == "size":
        return replace(m, parts=tuple(part if part.size else _sized(part, key, size) for part in m.parts))
    changed: dict[str, Any] = {key: size}
    return replace(m, **changed)
