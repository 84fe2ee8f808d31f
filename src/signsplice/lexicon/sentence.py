"""Parses a typed line of glosses into the words and letters that sign it.

Glosses are labels in the order of signing; a line of glosses is not a translation of a spoken sentence. A note reports
a word that is read differently from the typed text, a warning a word that is spelled because it is no gloss; no word is
replaced by a merely similar one.

English words that American Sign Language has no signs for may be left out. ASL has no state-of-being verbs
(https://www.lifeprint.com/asl101/pages-signs/a/am.htm), and no articles as English has them: traditionally it is said
to lack determiners, others read some pointing signs as such (Bahan, Kegl, MacLaughlin and Neidle, Convergent Evidence
for the Structure of Determiner Phrases in ASL, 1995).
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import count, takewhile

from signsplice.errors import InputError, UnknownGlossError
from signsplice.lexicon.gloss import LETTER_MARK, fold, letter_gloss
from signsplice.lexicon.lexicon import Lexicon

PAUSES = ".?!,"
"""Marks at which signing pauses; of several, the first in this order counts."""
_ALIKE = str.maketrans(dict.fromkeys("\u2018\u2019\u02bc`\u00b4", "'") | dict.fromkeys("\u2010\u2011_", "-"))
"""Replaces quotation marks by apostrophes, and other hyphens and the underscore by a hyphen."""
_WORD = re.compile(r"w(?:\.w)+\.?(?![wd])|#?[wd]+(?:(?:['-]|(?<=d)[.,](?=d))[wd]+)*")
"""A word by the classes of its characters (``_class``): an acronym with points, or letters and digits with apostrophes
and hyphens between them, or points and commas between digits."""
_NUMBERED = re.compile(r"((.+)#\d+)(\W*)")
"""GLOSS#2, its gloss, and punctuation."""


@dataclass(frozen=True)
class TypedWord:
    """A word of typed text.

    text: the text to look up; empty if the token cannot be signed.
    typed: the token that contains it.
    left_out: meaningful characters next to it that were left out, such as emoji.
    ends_phrase: whether punctuation other than ``/`` follows it, so that it makes no compound with the next word.
    note: how its reading differs from the typed text, or empty.
    pause: the mark after it at which signing pauses, one of ``PAUSES``, or empty.
    """

    text: str
    typed: str
    left_out: str = ""
    ends_phrase: bool = False
    note: str = ""
    pause: str = ""


def split_words(text: str, is_known: Callable[[str], bool]) -> list[TypedWord]:
    """Split a line into words at white space and punctuation; tokens that are known as typed stay whole.

    Keeps apostrophes, hyphens (``_`` counts as one), the point of a number and a ``#`` before a word; removes the
    points of an acronym and the commas of a number. Replaces full-width and other compatibility forms by plain ones.
    """
    typed_words: list[TypedWord] = []
    for token in text.split():
        if is_known(token):
            typed_words.append(TypedWord(token, token))
            continue
        numbered = _NUMBERED.fullmatch(token)
        if numbered and is_known(numbered[2]):
            typed_words.append(TypedWord(numbered[1], token, ends_phrase=bool(numbered[3]), pause=_pause(numbered[3])))
            continue
        words, before = _words(token)
        if typed_words and (before or not words):  # punctuation that stands alone, or before a word
            typed_words[-1] = replace(typed_words[-1], ends_phrase=True, pause=_pause(typed_words[-1].pause + before))
        typed_words += words
    return typed_words


_LIKE = str.maketrans("\u3002\u0964\u061f\u3001\u060c\u061b;:\u2013\u2014", "..?,,,,,,,")
"""Replaces marks of other scripts, semicolons, colons and dashes by equivalent ones of ``PAUSES``."""


def _pause(marks: str) -> str:
    """Return the mark of ``PAUSES`` that punctuation marks count as; empty if there is none."""
    return min((mark for mark in marks.translate(_LIKE) if mark in PAUSES), key=PAUSES.index, default="")


def _words(token: str) -> tuple[list[TypedWord], str]:
    """Return the words of a token and the pause mark before them, or in a token without words. A token of symbols only
    gives one word without text, a token of punctuation only gives none.
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
        if text.lower() == "fs" and plain[match.end() : match.end() + 1] == "-":  # a prefix without a word
            words.append(TypedWord("", token, f"{text}-"))
            continue
        text = text if "d." in match[0] else text.replace(".", "")
        ends_phrase = not set("p.,").isdisjoint(classes[gap])
        is_between = k + 1 < len(matches) and plain[gap] in ":\u2013"  # 10:30, 1990-95
        pause = "" if is_between else _pause(plain[gap])
        words.append(TypedWord(text, token, "" if k else left_out, ends_phrase, pause=pause))
    return words, before


def _class(character: str) -> str:
    """Return the class of a character: ``w`` and ``d`` form words, ``' - . , #`` may be part of words, ``/`` separates
    them, ``p`` is punctuation, ``s`` a symbol; empty for invisible characters.
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


_ARTICLES = frozenset(("a", "an", "the"))
_COPULAS = frozenset(("am", "is", "are", "was", "were", "be", "been", "being"))
_AUXILIARIES = frozenset(("do", "does", "did"))
_SUBJECTS = frozenset(("i", "you", "he", "she", "it", "we", "they"))
_CONTRACTION = re.compile(
    r"(i(?='?m$)|(?:you|they)(?='?re$)|we(?='re$)|(?:he|she|it|that|what|where|when|who|how)(?='s$))'?(?:m|re|s)",
    re.IGNORECASE,
)


def is_function_word(word: str, after: str) -> bool:
    """Return whether a word is an article or a form of *be*; or a form of *do* that begins a question, recognised by
    the pronoun ``after`` it: "do you like dogs", but not "I do".
    """
    folded = word.casefold()
    return folded in _ARTICLES | _COPULAS or (folded in _AUXILIARIES and after.casefold() in _SUBJECTS)


def without_copula(word: str) -> str:
    """Return the first part of a contraction with *am*, *are* or *is* (I'm, youre, what's); empty for other words."""
    match = _CONTRACTION.fullmatch(word)
    return match[1] if match else ""


SPELLED_MARKS = (LETTER_MARK, "#")
"""Prefixes of tokens to fingerspell."""
QUESTION_WORDS = ("WHO", "WHAT", "WHERE", "WHEN", "WHY", "HOW", "WHICH")
_HYPHEN = "-"
_APOSTROPHE = "'"
_TYPO = 0.75
"""Minimum similarity (``Lexicon.nearest``) of glosses suggested for a word that can be spelled."""
_SHORT = 3
"""Up to this number of letters, a word counts as English rather than as a longer gloss with a missing letter."""
_LONGEST_COMPOUND = 6
"""Maximum number of words of a compound that is looked up."""


@dataclass(frozen=True)
class SentenceToken:
    """A token of a line of glosses, and how it is signed.

    token: the words as they were looked up: several where they are one gloss.
    glosses: of the entries that sign it: the word's, or one for each letter; none where it was left out.
    spelled: whether it is fingerspelled.
    warning: what a user should know about it, or empty.
    note: how it was read, where it is not read as typed, or empty.
    suggestions: glosses that may have been meant, where it is no gloss.
    pause: the mark typed after it at which signing pauses, one of ``PAUSES``; empty where there is none.
    """

    token: str
    glosses: tuple[str, ...]
    spelled: bool = False
    warning: str = ""
    note: str = ""
    suggestions: tuple[str, ...] = ()
    pause: str = ""


def parse(
    text: str, lexicon: Lexicon, spell: bool = True, compounds: bool = True, drop_function_words: bool = False
) -> list[SentenceToken]:
    """Split a line of glosses into tokens at white space and punctuation, and find how each is signed.

    A token that the lexicon has, in any case, is that word. With ``compounds`` the longest run of words that is one
    gloss becomes that gloss (I LOVE YOU: I-LOVE-YOU), unless punctuation separates them; so does a word written without
    the gloss's hyphens. ``fs-ANNA`` and ``#ANNA`` are fingerspelled; hyphens between letters are ignored. A hyphenated
    token whose parts are all glosses becomes those glosses. Any other token is fingerspelled if the lexicon has all its
    letters and ``spell`` is True, with a warning and ``suggestions``. Emoji and other symbols are left out with a
    warning. With ``drop_function_words`` English words without a sign in ASL are left out with a note, unless they are
    part of a compound.

    Raises ``UnknownGlossError``, which names every remaining token and similar glosses; ``InputError`` for a line
    without glosses, or a letter that the lexicon lacks.
    """
    words = [part for word in split_words(text, lexicon.__contains__) for part in _parts(word, lexicon)]
    if not any(word.text for word in words):
        left_out = "".join(word.left_out for word in words)
        left_out_note = f"; {left_out[:40]!r} stands for none" if left_out else ""
        raise InputError(f"no gloss in the sentence, expected at least one{left_out_note}")
    for word in words:
        gloss, mark, _ = word.text.rpartition("#")
        if mark and gloss and word.text not in lexicon:
            forms = [gloss, *takewhile(lexicon.__contains__, (f"{gloss}#{k}" for k in count(2)))]
            raise InputError(f"{lexicon.where}: has no {word.text!r}, expected {' or '.join(forms[:5])}")
    readings: list[SentenceToken] = []
    unknown: dict[str, tuple[str, ...]] = {}
    index = 0
    while index < len(words):
        token = _compound(words[index : index + _LONGEST_COMPOUND], lexicon) if compounds else None
        kept_text = _drop_function_word(words, index) if drop_function_words else words[index].text
        token = token or _token(words[index], kept_text, lexicon, spell, compounds)
        if token is None:
            unknown[words[index].text] = lexicon.nearest(words[index].text)
        else:
            readings.append(token)
        n_read = 1 if token is None else max(1, len(token.token.split()))
        index += n_read
        if token is not None:
            readings[-1] = replace(token, pause=words[index - 1].pause)
    if unknown:
        raise UnknownGlossError(unknown, lexicon.where)
    return readings


def token_glosses(tokens: Sequence[SentenceToken]) -> list[str]:
    """Return the glosses of all tokens, in order. Raises ``InputError`` if every word was left out."""
    glosses = [gloss for token in tokens for gloss in token.glosses]
    if not glosses:
        raise InputError("ASL has no signs for these words, expected another; keep function words to spell them")
    return glosses


def list_spelled_words(tokens: Sequence[SentenceToken]) -> list[str]:
    """Return the fingerspelled words, as typed."""
    return [token.token for token in tokens if token.spelled]


@dataclass(frozen=True)
class LineGloss:
    """A gloss of a line, with its pause and question.

    gloss: of its entry.
    starts: whether a word, spelled or not, begins with it.
    pause: the mark after it at which signing pauses, one of ``PAUSES``; None without a mark.
    brow: the brows of its question in ASL: "raised" in a phrase that ends in ``?``, "furrowed" if the phrase also has
        one of ``QUESTION_WORDS``; None outside questions. A phrase ends at a mark other than a comma.
    """

    gloss: str
    starts: bool
    pause: str | None = None
    brow: str | None = None


def line_glosses(tokens: Sequence[SentenceToken]) -> list[LineGloss]:
    """Return the glosses of all tokens, in order, with the pauses and questions of the line."""
    glosses: list[LineGloss] = []
    first, asks = 0, False  # of the phrase
    for token in tokens:
        glosses += [LineGloss(gloss, k == 0) for k, gloss in enumerate(token.glosses)]
        asks |= len(token.glosses) == 1 and token.glosses[0].partition(_HYPHEN)[0] in QUESTION_WORDS
        if token.pause and glosses:
            mark = min(token.pause, glosses[-1].pause or token.pause, key=PAUSES.index)
            glosses[-1] = replace(glosses[-1], pause=mark)
        if token.pause not in ("", ","):
            if token.pause == "?":
                brow = "furrowed" if asks else "raised"
                glosses[first:] = [replace(gloss, brow=brow) for gloss in glosses[first:]]
            first, asks = len(glosses), False
    return glosses


def _parts(word: TypedWord, lexicon: Lexicon) -> Iterator[TypedWord]:
    """Yield the word, or the glosses that it joins by hyphens if it is no gloss itself."""
    parts = word.text.split(_HYPHEN)
    if len(parts) < 2 or word.text in lexicon or _mark(word.text) or not all(part in lexicon for part in parts):
        yield word
        return
    note = f"{word.text!r} is no gloss, and read as {' '.join(parts)}"
    yield TypedWord(parts[0], word.typed, word.left_out, True, note)
    yield from (TypedWord(part, word.typed, "", True) for part in parts[1:-1])
    yield TypedWord(parts[-1], word.typed, "", word.ends_phrase, pause=word.pause)


def _compound(words: Sequence[TypedWord], lexicon: Lexicon) -> SentenceToken | None:
    """Return the longest gloss formed by the first two or more of up to ``_LONGEST_COMPOUND`` words, or None."""
    n_words = next((k + 1 for k, word in enumerate(words) if word.ends_phrase or word.left_out), len(words))
    for n in range(n_words, 1, -1):
        texts = [word.text for word in words[:n]]
        joined = _HYPHEN.join(texts)
        compound = next((name for name in (joined, joined.replace(_APOSTROPHE, "")) if lexicon.lists(name)), None)
        if compound is not None:
            return _compound_token(" ".join(texts), lexicon.entry(compound).gloss)
    return None


def _drop_function_word(words: Sequence[TypedWord], at: int) -> str:
    """Return the text of a word without function words: empty, the first part of a contraction, or the whole text."""
    text, after = words[at].text, "" if words[at].ends_phrase else "".join(word.text for word in words[at + 1 : at + 2])
    return "" if is_function_word(text, after) else without_copula(text) or text


def _token(word: TypedWord, kept: str, lexicon: Lexicon, spell: bool, compounds: bool) -> SentenceToken | None:
    """Return how a word is signed, whose text ``kept`` remains; None if that is unknown."""
    read = _resolve_text(kept, lexicon, spell, compounds) if kept else SentenceToken(word.text or word.typed, ())
    if read is None:
        return None
    if kept != word.text:
        note = f"{word.text!r} is read as {kept!r}" if kept else f"{word.text!r} has no sign in ASL, and is left out"
        read = replace(read, token=word.text, note=note)
    where = "" if word.left_out == word.typed else f" in {word.typed!r}"
    left_out = f"{word.left_out!r}{where} is no gloss and no letter, and is left out" if word.left_out else ""
    return replace(read, warning="; ".join(filter(None, (read.warning, left_out))), note=read.note or word.note)


def _resolve_text(text: str, lexicon: Lexicon, spell: bool, compounds: bool) -> SentenceToken | None:
    if text in lexicon:
        return SentenceToken(text, (lexicon.entry(text).gloss,))
    if _mark(text):
        return _fingerspell_token(text, lexicon)
    hyphenated = lexicon.find_hyphenated_gloss(text) if compounds else None
    if hyphenated is not None:
        return _compound_token(text, hyphenated)
    bare = text.replace(_HYPHEN, "").replace(_APOSTROPHE, "")
    letters = _letters(bare, lexicon) if spell else ()
    if not letters or None in letters:
        return None
    meant = tuple(gloss for gloss in lexicon.nearest(text, similarity=_TYPO) if _may_be_meant(gloss, bare))
    so = f": did you mean {' or '.join(meant)}? It" if meant else ", so it"
    so += f" is spelled{_by_other_letters(bare, letters)}"
    or_drop = ", or drop function words" * is_function_word(text, "")
    warning = f"no gloss {text!r}{so}; write {LETTER_MARK}{bare} to mean that{or_drop}"
    return SentenceToken(text, tuple(filter(None, letters)), True, warning, suggestions=meant)


def _may_be_meant(gloss: str, bare: str) -> bool:
    """Return whether a word of these letters may be a mistyped gloss; a function word is none. A longer gloss is
    possible only if it does not contain the word, which has four letters or more or no vowel ("frend", "wht": FRIEND,
    WHAT; not "how", "other": SHOW, MOTHER), or if the word is a part of it between hyphens.
    """
    typed, meant = fold(bare), fold(gloss)
    if is_function_word(typed, "you"):
        return False
    may_be_longer = typed not in meant and (len(typed) > _SHORT or not set(typed) & set("aeiouy"))
    return may_be_longer or len(meant) <= len(typed) or typed in meant.split(_HYPHEN)


def _compound_token(token: str, gloss: str) -> SentenceToken:
    return SentenceToken(token, (gloss,), note=f"{token!r} is read as one gloss, {gloss}")


def _mark(text: str) -> str:
    """Return the prefix of ``SPELLED_MARKS`` that a text begins with; empty if it has none or nothing follows."""
    return next((mark for mark in SPELLED_MARKS if text.lower().startswith(mark) and len(text) > len(mark)), "")


def _fingerspell_token(token: str, lexicon: Lexicon) -> SentenceToken:
    """Fingerspell a token that begins with one of ``SPELLED_MARKS``."""
    word = token[len(_mark(token)) :].replace(_HYPHEN, "").replace(_APOSTROPHE, "")
    letters = _letters(word, lexicon)
    missing = [c for c, letter in zip(unicodedata.normalize("NFC", word), letters, strict=True) if letter is None]
    if missing or not letters:
        letter = missing[0] if missing else _HYPHEN
        raise InputError(
            f"{lexicon.where}: {token!r} cannot be spelled, there is no letter {letter!r}; "
            f"its letters are the glosses that begin with {LETTER_MARK}"
        )
    spelled_as = _by_other_letters(word, letters)
    return SentenceToken(
        token, tuple(filter(None, letters)), True, f"{token!r} is spelled{spelled_as}" if spelled_as else ""
    )


def _letters(word: str, lexicon: Lexicon) -> tuple[str | None, ...]:
    """Return for each character of a word the gloss of its letter, or of the letter without its accent; None if the
    lexicon has neither.
    """
    characters = unicodedata.normalize("NFC", word)
    letter_of: dict[str, str | None] = {}
    for character in set(characters):
        glosses = [letter_gloss(c) for c in (character, _without_accent(character)) if c.isprintable()]
        entries = [lexicon.entry(gloss) for gloss in glosses if gloss in lexicon]
        letter_of[character] = next((entry.gloss for entry in entries if entry.kind == "letter"), None)
    return tuple(letter_of[character] for character in characters)


_STROKES = str.maketrans("ŁłØøĐđĦħŦŧı", "LlOoDdHhTti")
"""Letters with a stroke, or without a dot, -> plain letters: Unicode does not decompose them."""


def _without_accent(letter: str) -> str:
    return unicodedata.normalize("NFD", letter)[0].translate(_STROKES)


def _by_other_letters(word: str, letters: Sequence[str | None]) -> str:
    """Return a remark if a word is spelled without its accents (JOSE), else an empty text."""
    characters = unicodedata.normalize("NFC", word)
    if all(letter in (letter_gloss(c), None) for c, letter in zip(characters, letters, strict=True)):
        return ""
    return f" as {''.join((letter or '')[len(LETTER_MARK) :] for letter in letters)}, without accents"
