"""What the readers of written signs share: how they refuse, leave out and mend by name, and how postures add up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from signsplice.errors import FormatError
from signsplice.written.tree import Site, Where, WrittenPosture


@dataclass(frozen=True)
class Reading:
    """One sign that is being read.

    file, gloss: for errors
    lenient: leave out what is not understood, with a note, and do not refuse it
    by_line: positions are lines of a file, else numbers of symbols
    notes: what was mended or left out so far
    """

    file: str
    gloss: str
    lenient: bool = False
    by_line: bool = True
    notes: list[str] = field(default_factory=list)

    def where(self, symbol: str = "", position: int = 0) -> Where:
        """The place of a symbol, for errors that come later."""
        return Where(self.file, self.gloss, symbol, position)

    def error(self, what: str, symbol: str, position: int) -> FormatError:
        """An error that names file, gloss, symbol and position."""
        return error_at(self.where(symbol, position), what, self.by_line)

    def refuse(self, what: str, symbol: str, position: int) -> None:
        """Raise ``FormatError``, or note that the symbol is left out."""
        if not self.lenient:
            raise self.error(what, symbol, position)
        self.note(f"{symbol} is left out: {what}", position)

    def note(self, what: str, position: int) -> None:
        """Keep a note of what was mended or left out."""
        at = f"{'line' if self.by_line else 'symbol'} {position}: "
        self.notes.append(at + what)


def error_at(where: Where, what: str, by_line: bool = True) -> FormatError:
    """An error that names file, gloss, symbol and position."""
    symbol = f"symbol {where.position} " if not by_line and where.position else ""
    named = f"{where.symbol[:60]}: " if where.symbol else f"{symbol.rstrip()}: " if symbol else ""
    text = f"{where.gloss[:80]}: {symbol if where.symbol else ''}{named}{what}"
    return FormatError(text[:700], file=where.file, line=where.position if by_line and where.position else None)


def merged(before: WrittenPosture | None, after: WrittenPosture | None) -> WrittenPosture | None:
    """A posture to which another adds what it says."""
    if before is None or after is None:
        return before or after
    return WrittenPosture(
        shape=after.shape or before.shape,
        fingers=after.fingers or before.fingers,
        palm=after.palm or before.palm,
        place=after.place or before.place,
        pair=after.pair or before.pair,
        weak=merged(before.weak, after.weak),
    )


def with_weak(strong: WrittenPosture, weak: WrittenPosture) -> WrittenPosture:
    """A posture of the strong hand, with the other hand's own."""
    return replace(strong, weak=merged(strong.weak, replace(weak, weak=None)))


def weak_has_own(postures: Sequence[WrittenPosture | None]) -> bool:
    """Whether any of some postures says what the weak hand does, or brings the strong hand to it."""
    pairs = [p.pair for p in postures if p is not None and p.pair is not None]
    own = any(p is not None and p.weak is not None for p in postures)
    return own or any(pair.weak is not None or pair.strong is not None for pair in pairs)


def flipped(sides: bool, heights: bool, depths: bool) -> str:
    """How hands work together that mirror one another in some directions, a word of ``WrittenSign.hands``."""
    if sides and heights and depths:
        return "point"
    words = [w for w, on in (("mirrored", sides), ("up_down", heights), ("out_in", depths)) if on]
    return "_".join(words) or "parallel"


def site(part: str, digits: Sequence[int], side: str = "") -> Site:
    """A part of a hand; the midjoint where a finger is named without its part."""
    return Site(part or "midjoint", tuple(digits), side)
