"""The symbols of a HamNoSys text, with the defects of dictionaries mended, and the parts of a compound.

Each mend is noted.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from itertools import accumulate, takewhile

from signsplice.written import symbols
from signsplice.written.hamnosys_row import CLOSERS, LOCATION, Token, is_action
from signsplice.written.reading import Reading

_MOST_SYMBOLS, _MOST_DEPTH = 1000, 12


def tokens(text: str, reading: Reading) -> list[Token]:
    """The symbols of a text, numbered from 1: characters of the font, or names such as hamflathand between blanks."""
    spread = re.sub(r"([{|}])", r" \1 ", re.sub(r"[,;/<>\\]", " ", text)).split()
    if "ham" in text.lower() or (spread and all(word in symbols.NAMES for word in spread)):
        words = spread
    else:
        words = [c for c in text if not c.isspace()]
        if len(words) < len(text.strip()):
            reading.note("blanks are left out", 0)
    check_length(len(words), reading)
    found = list[Token]()
    for position, word in enumerate(words, 1):
        name = symbols.SYMBOLS.get(word) or symbols.MARKS.get(word)
        if name is None and len(word) > 1:
            name = word.lower().removeprefix("ham")
        found += named(name or "", word if word.isprintable() else f"U+{ord(word[0]):04X}", position, reading)
    return found


def check_length(n_symbols: int, reading: Reading) -> None:
    """Raise ``FormatError`` for a sign of more than 1,000 symbols."""
    if n_symbols > _MOST_SYMBOLS:
        raise reading.error(f"has {n_symbols:,} symbols, expected at most {_MOST_SYMBOLS:,}", "", 0)


def named(name: str, shown: str, position: int, reading: Reading) -> list[Token]:
    """One symbol by its name without ham; none where it is left out. ``shown``: how errors call it."""
    if meant := symbols.KINDS["alias"].get(name):
        reading.note(f"ham{name} is read as ham{meant}", position)
        name = meant
    if name in symbols.PUNCTUATION.values():
        reading.note(f"{shown} is left out", position)
        return []
    if name in symbols.ALTERNATIVES.values():
        return [Token(name, position)]
    if name not in symbols.NAMES:
        reading.refuse("is no symbol of HamNoSys 4", shown, position)
        return []
    if meaning := symbols.KINDS["unmade"].get(name, "").replace("-", " "):
        reading.refuse(f"stands for {meaning}, which is not made", f"ham{name}", position)
        return []
    return [] if name == "version40" else [Token(name, position)]


def mended(found: Sequence[Token], reading: Reading) -> list[Token]:
    """Symbols whose brackets are balanced, and whose movements all belong to something."""
    balanced = _balanced(_chosen(found, reading), reading)
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
        if passed < 0 and t.name not in symbols.ALTERNATIVES.values():
            kept.append(t)
    return kept


def _balanced(found: Sequence[Token], reading: Reading) -> list[Token]:
    """Symbols whose brackets are closed where they are open at the end, without closers of nothing."""
    kept, stack = list[Token](), list[str]()
    for t in found:
        if t.name in symbols.BRACKETS:
            stack.append(symbols.BRACKETS[t.name])
            if len(stack) > _MOST_DEPTH:
                raise reading.error(f"expected at most {_MOST_DEPTH} brackets within one another", t.shown, t.position)
        elif t.name in CLOSERS:
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


def _in_turn(balanced: Sequence[Token], reading: Reading) -> list[Token]:
    """Symbols without each replace that a movement follows at once: the movements beside it come in turn, also where
    brackets say that they are made together.
    """
    kept, opened = list[Token](), list[int]()
    for t, after in zip(balanced, (*balanced[1:], None), strict=True):
        if t.name == "replace" and after is not None and is_action(after.name) and after.name != "replace":
            reading.note(f"{t.shown} before a movement is left out: it comes after the one before", t.position)
            if opened and kept[opened[-1]].name == "parbegin":
                kept[opened[-1]] = replace(kept[opened[-1]], name="seqbegin")
            continue
        kept.append(t)
        if t.name in symbols.BRACKETS:
            opened.append(len(kept) - 1)
        elif t.name in CLOSERS:
            kept[-1] = replace(t, name=symbols.BRACKETS[kept[opened.pop()].name])
    return kept


def compound(balanced: Sequence[Token]) -> list[list[Token]]:
    """The parts of a compound, or all symbols as one: a plus outside brackets begins a part where whole postures (a
    handshape and a finger direction, before it a place or an action too) stand on both sides, or there are more than
    two of them, or a later one has its own symmetry; else it joins two hands.
    """
    depths = accumulate((t.name in symbols.BRACKETS) - (t.name in CLOSERS) for t in balanced)
    cuts = [n for n, (t, depth) in enumerate(zip(balanced, depths, strict=True)) if t.name == "plus" and not depth]
    pieces = [list(balanced[a:b]) for a, b in zip([0, *(n + 1 for n in cuts)], [*cuts, len(balanced)], strict=True)]
    names = [[t.name for t in piece] for piece in pieces]
    directed = all(any(name.startswith("extfinger") for name in piece) for piece in names)
    shaped = all(any(n in symbols.SHAPES for n in takewhile(lambda n: not is_action(n), piece)) for piece in names)
    placed = all(any(name in LOCATION or is_action(name) for name in piece) for piece in names[:-1])
    many = len(pieces) > 2 or any(name in symbols.KINDS["symmetry"] for piece in names[1:] for name in piece)
    return pieces if directed and shaped and (placed or many) else [list(balanced)]
