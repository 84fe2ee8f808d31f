"""Typed text as words: punctuation, emoji, look-alike characters and hyphens are taken as people type them."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Callable
from dataclasses import dataclass, replace

PAUSES = ".?!,"
"""Marks at which signing pauses; of several the first one counts."""
_ALIKE = str.maketrans(dict.fromkeys("\u2018\u2019\u02bc`\u00b4", "'") | dict.fromkeys("\u2010\u2011_", "-"))
"""Quotation marks that stand for an apostrophe; hyphens."""
_WORD = re.compile(r"w(?:\.w)+\.?(?![wd])|#?[wd]+(?:(?:['-]|(?<=d)[.,](?=d))[wd]+)*")
"""A word by the classes of its characters (``_class``): an acronym with points, or letters and digits with apostrophes
and hyphens between them, or points and commas between digits."""
_NUMBERED = re.compile(r"((.+)#\d+)(\W*)")
"""GLOSS#2, its gloss, and punctuation."""


@dataclass(frozen=True)
class TypedWord:
    """A word of typed text.

    text: what is looked up; empty where nothing that can be signed was typed.
    typed: the token that it stands in.
    left_out: characters beside it that stand for something and were left out, such as emoji.
    ends_phrase: whether punctuation other than ``/`` follows it, so that it makes no compound with the next word.
    note: how it is read otherwise than typed, or empty.
    pause: the mark after it at which signing pauses, one of ``PAUSES``, or empty.
    """

    text: str
    typed: str
    left_out: str = ""
    ends_phrase: bool = False
    note: str = ""
    pause: str = ""


def typed_words(text: str, is_known: Callable[[str], bool]) -> list[TypedWord]:
    """The words of a line, split at white space and punctuation; tokens that are known as typed stay whole.

    Apostrophes, hyphens (``_`` is one), the point of a number and a ``#`` before a word stay; the points of an acronym
    and the commas of a number go. Full-width and other compatibility forms become the plain ones.
    """
    found: list[TypedWord] = []
    for token in text.split():
        if is_known(token):
            found.append(TypedWord(token, token))
            continue
        numbered = _NUMBERED.fullmatch(token)
        if numbered and is_known(numbered[2]):
            found.append(TypedWord(numbered[1], token, ends_phrase=bool(numbered[3]), pause=_pause(numbered[3])))
            continue
        words, before = _words(token)
        if found and (before or not words):  # punctuation that stands alone, or before a word
            found[-1] = replace(found[-1], ends_phrase=True, pause=_pause(found[-1].pause + before))
        found += words
    return found


_LIKE = str.maketrans("\u3002\u0964\u061f\u3001\u060c\u061b;:\u2013\u2014", "..?,,,,,,,")
"""Marks at which signing pauses as at one of ``PAUSES``: those of other scripts, semicolons, colons and dashes."""


def _pause(marks: str) -> str:
    """The one of ``PAUSES`` that marks of punctuation count as; empty where they are none."""
    return min((mark for mark in marks.translate(_LIKE) if mark in PAUSES), key=PAUSES.index, default="")


def _words(token: str) -> tuple[list[TypedWord], str]:
    """The words of a token, one without text where only symbols were typed, none where only punctuation was; and the
    mark before them at which signing pauses, or where there is no word.
    """
    plain = unicodedata.normalize("NFKC", token).translate(_ALIKE)
    plain = "".join(c for c in plain if _class(c))
    classes = "".join(map(_class, plain))
    matches = list(_WORD.finditer(classes))
    ends, starts = [0, *(match.end() for match in matches)], [*(match.start() for match in matches), len(plain)]
    between = [slice(*gap) for gap in zip(ends, starts, strict=True)]  # one more than words
    left_out = "".join(c for gap in between for c in plain[gap] if _class(c) in "s#")
    before = _pause(plain[between[0]])
    if not matches:
        return ([TypedWord("", token, left_out, pause=before)], "") if left_out else ([], before)
    words = []
    for k, (match, gap) in enumerate(zip(matches, between[1:], strict=True)):
        text = plain[match.start() : match.end()].replace(",", "")
        if text.lower() == "fs" and plain[match.end() : match.end() + 1] == "-":  # a mark that nothing follows
            words.append(TypedWord("", token, f"{text}-"))
            continue
        text = text if "d." in match[0] else text.replace(".", "")
        ends_phrase = not set("p.,").isdisjoint(classes[gap])
        is_between = k + 1 < len(matches) and plain[gap] in ":\u2013"  # 10:30, 1990-95
        pause = "" if is_between else _pause(plain[gap])
        words.append(TypedWord(text, token, "" if k else left_out, ends_phrase, pause=pause))
    return words, before


def _class(character: str) -> str:
    """What a character does: ``w`` and ``d`` make words, ``' - . , #`` may, ``/`` parts them, ``p`` is punctuation,
    ``s`` a symbol; empty for what is not seen.
    """
    category = unicodedata.category(character)
    if category in ("Cf", "Me") or "\ufe00" <= character <= "\ufe0f":  # joiners and variants of emoji
        return ""
    if character in "'-.,#/":
        return character
    if category[0] in "LM" or category == "Nl":
        return "w"
    if category[0] == "N":
        return "d"
    return "p" if category[0] == "P" and character not in "&%@*\u00a7\\" else "s"
