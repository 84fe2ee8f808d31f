"""A row of HamNoSys symbols that is read from left to right."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from signsplice.written import symbols
from signsplice.written.reading import Reading
from signsplice.written.tree import Place, Tier, Where

SITES = (*symbols.DIGITS, *symbols.FINGER_PARTS, *symbols.HAND_PARTS)
LOCATION = frozenset((*symbols.SIDES, *SITES, *symbols.PLACES, *symbols.CONTACTS, "behind"))
CLOSERS = frozenset(symbols.BRACKETS.values())
_WITHIN = ("plus", "between", *symbols.BRACKETS, *CLOSERS)
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
    def shown(self) -> str:
        """How errors call it."""
        return f"ham{self.name}"


def is_posture(name: str) -> bool:
    """Whether a symbol is a handshape or a direction of fingers or palm."""
    return name in symbols.SHAPES or name.startswith("extfinger") or name in PALMS


def is_action(name: str) -> bool:
    """Whether a symbol begins an action."""
    return name.startswith(("move", "circle")) or name in (*symbols.KINDS["wrist"], "fingerplay", "nomotion", "replace")


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

    def peek(self, ahead: int = 0) -> Token | None:
        """The next symbol, or one after it; None at the end."""
        return self.tokens[self._at + ahead] if self._at + ahead < len(self.tokens) else None

    def at(self, *names: str) -> bool:
        """Whether the next symbol is one of some."""
        token = self.peek()
        return token is not None and token.name in names

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

    def rest(self) -> Iterator[Token]:
        """All that is left."""
        while self.peek() is not None:
            yield self.next()

    def where(self, token: Token) -> Where:
        """The place of a symbol, for errors."""
        return self.reading.where(token.shown, token.position)

    def is_posture_bracket(self) -> bool:
        """Whether brackets that come next hold slots, not actions."""
        names = self._bracket()
        return any(is_posture(name) or name in LOCATION for name in names) and not any(map(is_action, names))

    def is_location(self) -> bool:
        """Whether a place, a site or a contact comes next, or brackets of them."""
        t = self.peek()
        if t is None or t.name not in ("parbegin", "seqbegin"):
            return t is not None and t.name in LOCATION
        return all(name in LOCATION or name in _WITHIN for name in self._bracket())

    def _bracket(self) -> list[str]:
        """The names of the symbols within the brackets that come next, openers among them; none where none comes."""
        found, depth = list[str](), 0
        for t in self.tokens[self._at :]:
            depth += (t.name in symbols.BRACKETS) - (t.name in symbols.BRACKETS.values())
            if depth < 1:
                break
            found.append(t.name)
        return found

    def slot_follows(self) -> bool:
        """Whether a slot comes after the next symbol."""
        self._at += 1
        t = self.peek()
        found = t is not None and (is_posture(t.name) or self.is_posture_bracket() or self.is_location())
        self._at -= 1
        return found
