"""The symbols of HamNoSys 4: their names, code points and kinds (words/hamnosys.txt), a row of symbols read from left
to right, and the tokenizer, which repairs the defects of dictionaries with a note for each.
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
"""Code point -> name: the element of HamNoSys SiGML without ``ham``."""
PUNCTUATION = {" ": "space", "!": "exclaim", ",": "comma", ".": "fullstop", "?": "query"}
"""Marks without effect on a sign's form -> their names."""
ALTERNATIVES = {"{": "altbegin", "|": "metaalt", "}": "altend"}
MARKS = {**PUNCTUATION, **ALTERNATIVES}
NAMES = frozenset(SYMBOLS.values())
KINDS = {kind: {pair.partition("=")[0]: pair.rpartition("=")[2] for pair in row} for kind, *row in _WORDS["kinds"]}
"""Kind -> symbol -> its value in the tree; for a bracket its closing symbol, for an alias the intended symbol."""
SHAPES = KINDS["shape"]
"""Handshapes."""
THUMBS = KINDS["thumb"]
"""Thumb positions."""
BENDS = KINDS["bend"]
"""Bends of fingers."""
FINGER_PARTS = KINDS["part"]
"""Parts of a finger."""
HAND_PARTS = KINDS["hand"]
"""Parts of a hand."""
PLACES = KINDS["place"]
"""Places on the body."""
SIDES = KINDS["side"]
"""Sides of a place."""
CONTACTS = KINDS["contact"]
"""Contacts."""
REPEATS = KINDS["repeat"]
"""Repetitions."""
BRACKETS = KINDS["bracket"]
"""Opening bracket -> closing bracket."""
DIGITS = {name: int(digit) for name, digit in KINDS["digit"].items()}
"""Symbol -> digit, from 1 (thumb) to 5."""


SITES = (*DIGITS, *FINGER_PARTS, *HAND_PARTS)
LOCATION = frozenset((*SIDES, *SITES, *PLACES, *CONTACTS, "behind"))
CLOSERS = frozenset(BRACKETS.values())
_WITHIN = ("plus", "between", *BRACKETS, *CLOSERS)
PALMS = tuple(f"palm{d}" for d in ("u", "ur", "r", "dr", "d", "dl", "l", "ul"))


@dataclass(frozen=True)
class Token:
    """A symbol.

    name: name without ham
    position: its number in the text, or its line in a file
    """

    name: str
    position: int

    @property
    def ham_name(self) -> str:
        """Its name in errors."""
        return f"ham{self.name}"


def is_posture(name: str) -> bool:
    """Whether a symbol is a handshape or a direction of fingers or palm."""
    return name in SHAPES or name.startswith("extfinger") or name in PALMS


def is_action(name: str) -> bool:
    """Whether a symbol begins an action."""
    return name.startswith(("move", "circle")) or name in (*KINDS["wrist"], "fingerplay", "nomotion", "replace")


class Row:
    """Symbols with balanced brackets, and the current position in them.

    tokens: the symbols
    reading: collects errors and notes of the sign
    mirrored: the weak hand mirrors the strong one
    two: a symbol says that both hands take part
    tiers: tiers of head and shoulders so far
    last: the last place read
    second: the next symbols belong to the weak hand, after a plus in brackets
    """

    def __init__(self, tokens: Sequence[Token], reading: Reading, mirrored: bool, two: bool) -> None:
        self.tokens, self.reading, self.mirrored, self.two = tokens, reading, mirrored, two
        self.tiers = list[Tier]()
        self.last: Place | None = None
        self.second = False
        self._at = 0

    def peek(self, ahead: int = 0) -> Token:
        """Returns the next symbol, or one ``ahead`` of it; at the end a symbol without a name."""
        return self.tokens[self._at + ahead] if self._at + ahead < len(self.tokens) else Token("", 0)

    def at(self, *names: str) -> bool:
        """Whether the next symbol has one of the names."""
        return self.peek().name in names

    def next(self) -> Token:
        """Consumes and returns the next symbol."""
        self._at += 1
        return self.tokens[self._at - 1]

    def take(self, *names: str) -> list[Token]:
        """Consumes all next symbols with one of the names, or one symbol if only one name is given."""
        taken = list[Token]()
        while self.at(*names):
            taken.append(self.next())
            if len(names) == 1:
                break
        return taken

    def refuse_until(self, closer: str, place: str) -> None:
        """Refuse all symbols up to a closing bracket; ``place`` names the bracket in errors."""
        while (t := self.peek()).name not in ("", closer):
            self.reading.refuse(f"stands within {place}", t.ham_name, self.next().position)

    def where(self, token: Token) -> Where:
        """Returns the position of a symbol, for errors."""
        return self.reading.where(token.ham_name, token.position)

    def is_posture_bracket(self) -> bool:
        """Whether the next brackets hold slots, not actions."""
        names = self._bracket()
        return any(is_posture(name) or name in LOCATION for name in names) and not any(map(is_action, names))

    def is_location(self) -> bool:
        """Whether a place, a site or a contact comes next, or brackets of them."""
        if not self.at("parbegin", "seqbegin"):
            return self.at(*LOCATION)
        return all(name in LOCATION or name in _WITHIN for name in self._bracket())

    def _bracket(self) -> list[str]:
        """Returns the names of the symbols in the next brackets, with openers; [] if no bracket comes next."""
        names, depth = list[str](), 0
        for t in self.tokens[self._at :]:
            depth += (t.name in BRACKETS) - (t.name in BRACKETS.values())
            if depth < 1:
                break
            names.append(t.name)
        return names

    def slot_follows(self) -> bool:
        """Whether a slot comes after the next symbol."""
        self._at += 1
        follows = is_posture(self.peek().name) or self.is_posture_bracket() or self.is_location()
        self._at -= 1
        return follows


_MOST_SYMBOLS = 1000
"""Largest number of symbols in a sign."""
_MOST_DEPTH = 12
"""Largest number of nested brackets."""


def tokens(text: str, reading: Reading) -> list[Token]:
    """Returns the symbols of a text, numbered from 1: font characters, or names such as hamflathand between blanks."""
    spread = re.sub(r"([{|}])", r" \1 ", re.sub(r"[,;/<>\\]", " ", text)).split()
    if "ham" in text.lower() or (spread and all(word in NAMES for word in spread)):
        words = spread
    else:
        words = [c for c in text if not c.isspace()]
        if len(words) < len(text.strip()):
            reading.note("blanks are left out", 0)
    check_length(len(words), reading)
    result = list[Token]()
    for position, word in enumerate(words, 1):
        name = SYMBOLS.get(word) or MARKS.get(word)
        if name is None and len(word) > 1:
            name = word.lower().removeprefix("ham")
        result += resolve_symbol(name or "", word if word.isprintable() else f"U+{ord(word[0]):04X}", position, reading)
    return result


def check_length(n_symbols: int, reading: Reading) -> None:
    """Raise ``FormatError`` if a sign has more than 1,000 symbols."""
    if n_symbols > _MOST_SYMBOLS:
        raise reading.error(f"has {n_symbols:,} symbols, expected at most {_MOST_SYMBOLS:,}", "", 0)


def resolve_symbol(name: str, shown: str, position: int, reading: Reading) -> list[Token]:
    """Returns the symbol with a name without ham, or [] if it is left out. ``shown``: its name in errors."""
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
    """Resolves alternatives, balances brackets, and removes each replace that precedes a movement."""
    balanced = _balance_brackets(_chosen(found, reading), reading)
    if not balanced:
        raise reading.error("has no symbol of HamNoSys", "", 0)
    return _in_turn(balanced, reading)


def _chosen(symbols: Sequence[Token], reading: Reading) -> list[Token]:
    """Keeps the first of each set of alternatives, {first|other}."""
    chosen, depth, passed = list[Token](), 0, -1
    for t in symbols:
        if t.name == "metaalt" and passed < 0:
            passed = depth
            reading.note("of alternatives the first is read", t.position)
        depth += (t.name == "altbegin") - (t.name == "altend")
        if passed > depth:
            passed = -1
        if passed < 0 and t.name not in ALTERNATIVES.values():
            chosen.append(t)
    return chosen


def _balance_brackets(symbols: Sequence[Token], reading: Reading) -> list[Token]:
    """Closes open brackets, and removes closers without an opener."""
    balanced, stack = list[Token](), list[str]()
    for t in symbols:
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
                balanced.append(Token(stack.pop(), t.position))
            stack.pop()
        balanced.append(t)
    for closer in reversed(stack):
        reading.note(f"ham{closer} is added at the end", symbols[-1].position)
        balanced.append(Token(closer, symbols[-1].position))
    return balanced


def _in_turn(balanced: Sequence[Token], reading: Reading) -> list[Token]:
    """Removes each replace directly before a movement: the movements around it form a sequence, even if their brackets
    say that they are parallel.
    """
    ordered, opened = list[Token](), list[int]()
    for t, after in zip(balanced, (*balanced[1:], None), strict=True):
        if t.name == "replace" and after is not None and is_action(after.name) and after.name != "replace":
            reading.note(f"{t.ham_name} before a movement is left out: it comes after the one before", t.position)
            if opened and ordered[opened[-1]].name == "parbegin":
                ordered[opened[-1]] = replace(ordered[opened[-1]], name="seqbegin")
            continue
        ordered.append(t)
        if t.name in BRACKETS:
            opened.append(len(ordered) - 1)
        elif t.name in CLOSERS:
            ordered[-1] = replace(t, name=BRACKETS[ordered[opened.pop()].name])
    return ordered


def compound(balanced: Sequence[Token]) -> list[list[Token]]:
    """Splits a compound into parts, or returns all symbols as one part. A plus outside brackets separates parts if
    every piece has a handshape and a finger direction, and if each piece but the last also has a place or an action, or
    there are more than two pieces, or a later piece has its own symmetry. Otherwise it joins two hands.
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
