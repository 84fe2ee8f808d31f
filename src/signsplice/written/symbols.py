"""The symbols of HamNoSys 4: their names, code points and kinds (words/hamnosys.txt), a row of them that is read from
left to right, and a text as such a row, with the defects of dictionaries mended, each with a note.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import accumulate, takewhile

from signsplice.signer.tables import sections
from signsplice.written.reading import Reading
from signsplice.written.tree import Place, Tier, Where

_WORDS = sections(__file__, "hamnosys")
SYMBOLS = {chr(int(first, 16) + n): name for first, *row in _WORDS["symbols"] for n, name in enumerate(row)}
"""Code point -> name, that of the element of HamNoSys SiGML without its ``ham``."""
PUNCTUATION = {" ": "space", "!": "exclaim", ",": "comma", ".": "fullstop", "?": "query"}
"""Marks that say nothing of a sign's form -> their names."""
ALTERNATIVES = {"{": "altbegin", "|": "metaalt", "}": "altend"}
MARKS = {**PUNCTUATION, **ALTERNATIVES}
NAMES = frozenset(SYMBOLS.values())
KINDS = {kind: {pair.partition("=")[0]: pair.rpartition("=")[2] for pair in row} for kind, *row in _WORDS["kinds"]}
"""Kind -> symbol -> what it is in the tree; for a bracket what closes it, for an alias the symbol that is meant."""
SHAPES, THUMBS, BENDS, FINGER_PARTS, HAND_PARTS = (KINDS[kind] for kind in ("shape", "thumb", "bend", "part", "hand"))
PLACES, SIDES, CONTACTS, REPEATS, BRACKETS = (KINDS[kind] for kind in ("place", "side", "contact", "repeat", "bracket"))
DIGITS = {name: int(digit) for name, digit in KINDS["digit"].items()}


SITES = (*DIGITS, *FINGER_PARTS, *HAND_PARTS)
LOCATION = frozenset((*SIDES, *SITES, *PLACES, *CONTACTS, "behind"))
CLOSERS = frozenset(BRACKETS.values())
_WITHIN = ("plus", "between", *BRACKETS, *CLOSERS)
PALMS = tuple(f"palm{d}" for d in ("u", "ur", "r", "dr", "d", "dl", "l", "ul"))


@dataclass(frozen=True)
class Token:
    """A symbol.

    name: without ham
    position: its number in the text, or its line in a file
    """

    name: str
    position: int

    @property
    def ham_name(self) -> str:
        """How errors call it."""
        return f"ham{self.name}"


def is_posture(name: str) -> bool:
    """Whether a symbol is a handshape or a direction of fingers or palm."""
    return name in SHAPES or name.startswith("extfinger") or name in PALMS


def is_action(name: str) -> bool:
    """Whether a symbol begins an action."""
    return name.startswith(("move", "circle")) or name in (*KINDS["wrist"], "fingerplay", "nomotion", "replace")


class Row:
    """Symbols with balanced brackets, and how far they are read.

    tokens: the symbols
    reading: of the sign
    mirrored: the weak hand mirrors the strong one
    two: a symbol says that both hands take part
    tiers: what head and shoulders do, so far
    last: the place that was read last
    second: what comes next is of the weak hand, after a plus in brackets
    """

    def __init__(self, tokens: Sequence[Token], reading: Reading, mirrored: bool, two: bool) -> None:
        self.tokens, self.reading, self.mirrored, self.two = tokens, reading, mirrored, two
        self.tiers = list[Tier]()
        self.last: Place | None = None
        self.second = False
        self._at = 0

    def peek(self, ahead: int = 0) -> Token:
        """The next symbol, or one after it; one without a name at the end."""
        return self.tokens[self._at + ahead] if self._at + ahead < len(self.tokens) else Token("", 0)

    def at(self, *names: str) -> bool:
        """Whether the next symbol is one of some."""
        return self.peek().name in names

    def next(self) -> Token:
        """The next symbol, which is passed."""
        self._at += 1
        return self.tokens[self._at - 1]

    def take(self, *names: str) -> list[Token]:
        """All next symbols that are of some names; brackets and plus one at a time."""
        found = list[Token]()
        while self.at(*names):
            found.append(self.next())
            if len(names) == 1:
                break
        return found

    def refuse_until(self, closer: str, place: str) -> None:
        """Refuse all up to a closing bracket, as what stands within a ``place``."""
        while (t := self.peek()).name not in ("", closer):
            self.reading.refuse(f"stands within {place}", t.ham_name, self.next().position)

    def where(self, token: Token) -> Where:
        """The place of a symbol, for errors."""
        return self.reading.where(token.ham_name, token.position)

    def is_posture_bracket(self) -> bool:
        """Whether brackets that come next hold slots, not actions."""
        names = self._bracket()
        return any(is_posture(name) or name in LOCATION for name in names) and not any(map(is_action, names))

    def is_location(self) -> bool:
        """Whether a place, a site or a contact comes next, or brackets of them."""
        if not self.at("parbegin", "seqbegin"):
            return self.at(*LOCATION)
        return all(name in LOCATION or name in _WITHIN for name in self._bracket())

    def _bracket(self) -> list[str]:
        """The names of the symbols within the brackets that come next, openers among them; none where none comes."""
        found, depth = list[str](), 0
        for t in self.tokens[self._at :]:
            depth += (t.name in BRACKETS) - (t.name in BRACKETS.values())
            if depth < 1:
                break
            found.append(t.name)
        return found

    def slot_follows(self) -> bool:
        """Whether a slot comes after the next symbol."""
        self._at += 1
        found = is_posture(self.peek().name) or self.is_posture_bracket() or self.is_location()
        self._at -= 1
        return found


_MOST_SYMBOLS, _MOST_DEPTH = 1000, 12


def tokens(text: str, reading: Reading) -> list[Token]:
    """The symbols of a text, numbered from 1: characters of the font, or names such as hamflathand between blanks."""
    spread = re.sub(r"([{|}])", r" \1 ", re.sub(r"[,;/<>\\]", " ", text)).split()
    if "ham" in text.lower() or (spread and all(word in NAMES for word in spread)):
        words = spread
    else:
        words = [c for c in text if not c.isspace()]
        if len(words) < len(text.strip()):
            reading.note("blanks are left out", 0)
    check_length(len(words), reading)
    found = list[Token]()
    for position, word in enumerate(words, 1):
        name = SYMBOLS.get(word) or MARKS.get(word)
        if name is None and len(word) > 1:
            name = word.lower().removeprefix("ham")
        found += resolve_symbol(name or "", word if word.isprintable() else f"U+{ord(word[0]):04X}", position, reading)
    return found


def check_length(n_symbols: int, reading: Reading) -> None:
    """Raise ``FormatError`` for a sign of more than 1,000 symbols."""
    if n_symbols > _MOST_SYMBOLS:
        raise reading.error(f"has {n_symbols:,} symbols, expected at most {_MOST_SYMBOLS:,}", "", 0)


def resolve_symbol(name: str, shown: str, position: int, reading: Reading) -> list[Token]:
    """One symbol by its name without ham; none where it is left out. ``shown``: how errors call it."""
    if meant := KINDS["alias"].get(name):
        reading.note(f"ham{name} is read as ham{meant}", position)
        name = meant
    if name in PUNCTUATION.values():
        reading.note(f"{shown} is left out", position)
        return []
    if name in ALTERNATIVES.values():
        return [Token(name, position)]
    if name not in NAMES:
        reading.refuse("is no symbol of HamNoSys 4", shown, position)
        return []
    if meaning := KINDS["unmade"].get(name, "").replace("-", " "):
        reading.refuse(f"stands for {meaning}, which is not made", f"ham{name}", position)
        return []
    return [] if name == "version40" else [Token(name, position)]


def repair_symbols(found: Sequence[Token], reading: Reading) -> list[Token]:
    """Symbols whose brackets are balanced, and whose movements all belong to something."""
    balanced = _balance_brackets(_chosen(found, reading), reading)
    if not balanced:
        raise reading.error("has no symbol of HamNoSys", "", 0)
    return _in_turn(balanced, reading)


def _chosen(found: Sequence[Token], reading: Reading) -> list[Token]:
    """Symbols with the first of each of some alternatives, {first|other}."""
    kept, depth, passed = list[Token](), 0, -1
    for t in found:
        if t.name == "metaalt" and passed < 0:
            passed = depth
            reading.note("of alternatives the first is read", t.position)
        depth += (t.name == "altbegin") - (t.name == "altend")
        if passed > depth:
            passed = -1
        if passed < 0 and t.name not in ALTERNATIVES.values():
            kept.append(t)
    return kept


def _balance_brackets(found: Sequence[Token], reading: Reading) -> list[Token]:
    """Symbols whose brackets are closed where they are open at the end, without closers of nothing."""
    kept, stack = list[Token](), list[str]()
    for t in found:
        if t.name in BRACKETS:
            stack.append(BRACKETS[t.name])
            if len(stack) > _MOST_DEPTH:
                raise reading.error(
                    f"expected at most {_MOST_DEPTH} brackets within one another", t.ham_name, t.position
                )
        elif t.name in CLOSERS:
            if t.name not in stack:
                reading.note(f"{t.ham_name} closes no bracket and is left out", t.position)
                continue
            while stack[-1] != t.name:
                reading.note(f"ham{stack[-1]} is added before {t.ham_name}", t.position)
                kept.append(Token(stack.pop(), t.position))
            stack.pop()
        kept.append(t)
    for closer in reversed(stack):
        reading.note(f"ham{closer} is added at the end", found[-1].position)
        kept.append(Token(closer, found[-1].position))
    return kept


def _in_turn(balanced: Sequence[Token], reading: Reading) -> list[Token]:
    """Symbols without each replace that a movement follows at once: the movements beside it come in turn, also where
    brackets say that they are made together.
    """
    kept, opened = list[Token](), list[int]()
    for t, after in zip(balanced, (*balanced[1:], None), strict=True):
        if t.name == "replace" and after is not None and is_action(after.name) and after.name != "replace":
            reading.note(f"{t.ham_name} before a movement is left out: it comes after the one before", t.position)
            if opened and kept[opened[-1]].name == "parbegin":
                kept[opened[-1]] = replace(kept[opened[-1]], name="seqbegin")
            continue
        kept.append(t)
        if t.name in BRACKETS:
            opened.append(len(kept) - 1)
        elif t.name in CLOSERS:
            kept[-1] = replace(t, name=BRACKETS[kept[opened.pop()].name])
    return kept


def compound(balanced: Sequence[Token]) -> list[list[Token]]:
    """The parts of a compound, or all symbols as one: a plus outside brackets begins a part where whole postures (a
    handshape and a finger direction, before it a place or an action too) stand on both sides, or there are more than
    two of them, or a later one has its own symmetry; else it joins two hands.
    """
    depths = accumulate((t.name in BRACKETS) - (t.name in CLOSERS) for t in balanced)
    cuts = [n for n, (t, depth) in enumerate(zip(balanced, depths, strict=True)) if t.name == "plus" and not depth]
    pieces = [list(balanced[a:b]) for a, b in zip([0, *(n + 1 for n in cuts)], [*cuts, len(balanced)], strict=True)]
    names = [[t.name for t in piece] for piece in pieces]
    directed = all(any(name.startswith("extfinger") for name in piece) for piece in names)
    shaped = all(any(n in SHAPES for n in takewhile(lambda n: not is_action(n), piece)) for piece in names)
    placed = all(any(name in LOCATION or is_action(name) for name in piece) for piece in names[:-1])
    many = len(pieces) > 2 or any(name in KINDS["symmetry"] for piece in names[1:] for name in piece)
    return pieces if directed and shaped and (placed or many) else [list(balanced)]
