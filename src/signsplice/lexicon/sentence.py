"""Parses a typed line of glosses into the words and letters that sign it.

Glosses are labels in the order of signing; a line of glosses is not a translation of a spoken sentence. A note reports
a word that is read differently from the typed text, a warning a word that is spelled or left out because it is none; no
word is replaced by a merely similar one. What cannot be said is left out and never silences the rest of the line.

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
from itertools import chain, count, takewhile

from signsplice.errors import InputError, UnknownGlossError
from signsplice.lexicon.gloss import JOINED_LETTERS, LETTER_MARK, fold, letter_gloss, letter_of, plain
from signsplice.lexicon.languages import ALPHABETS, read_languages
from signsplice.lexicon.lemmas import lemmas, without_copula
from signsplice.lexicon.lexicon import Lexicon
from signsplice.rig.align import list_names

PAUSES = ".?!,"
"""Marks at which signing pauses; of several, the first in this order counts."""
_ALIKE = str.maketrans(dict.fromkeys("\u2018\u2019\u02bc`\u00b4", "'") | dict.fromkeys("\u2010\u2011_", "-"))
"""Replaces quotation marks by apostrophes, and other hyphens and the underscore by a hyphen."""
_WORD = re.compile(r"w(?:\.w)+\.?(?![wd])|#?[wd]+(?:(?:['-]|(?<=d)[.,](?=d))[wd]+)*")
"""A word by the classes of its characters (``_class``): an acronym with points, or letters and digits with apostrophes
and hyphens between them, or points and commas between digits."""
_NUMBERED = re.compile(rf"((.+)#\d+|fs-.+@(?:{'|'.join(ALPHABETS)}))(\W*)", re.IGNORECASE)
"""GLOSS#2, its gloss, and punctuation; or fs-A@GSG, letters of an alphabet that ships, and punctuation."""
_ORDINAL = re.compile(r"(\d+)(?:st|nd|rd|th|er?|[eè]me|[sd]e|os?|η)", re.IGNORECASE)
_SYMBOLS = {"$": "dollar", "€": "euro", "£": "pound", "¥": "yen", "%": "percent"}
"""Symbols beside numbers, and the words that they are read as."""
_POINTS = {"en": "point", "de": "Komma", "nl": "komma", "fr": "virgule", "el": "κόμμα"}
"""Language -> the word for the mark between a number and its decimals."""


@dataclass(frozen=True)
class TypedWord:
    """A word of typed text.

    text: the text to look up; empty if the token cannot be signed.
    typed: the token that contains it.
    left_out: meaningful characters next to it that were left out, such as emoji.
    ends_phrase: whether punctuation other than ``/`` follows it, so that it makes no compound with the next word.
    note: how its reading differs from the typed text, or empty.
    pause: the mark after it at which signing pauses, one of ``PAUSES``, or empty.
    meant: the word to look up in its place, for symbols and ordinals; empty for the text.
    """

    text: str
    typed: str
    left_out: str = ""
    ends_phrase: bool = False
    note: str = ""
    pause: str = ""
    meant: str = ""


def split_words(text: str, is_known: Callable[[str], bool], language: str = "en") -> list[TypedWord]:
    """Split a line into words at white space and punctuation; tokens that are known as typed stay whole.

    Keeps apostrophes, hyphens (``_`` counts as one) and a ``#`` before a word; removes the points of an acronym and the
    marks between the thousands of a number; the mark before its decimals is a word of its own, and so are signs of
    money and per cent. Replaces full-width and other compatibility forms by plain ones.
    """
    typed_words: list[TypedWord] = []
    for token in text.split():
        if is_known(token):
            typed_words.append(TypedWord(token, token))
            continue
        numbered = _NUMBERED.fullmatch(token)
        if numbered and (not numbered[2] or is_known(numbered[2])):
            typed_words.append(TypedWord(numbered[1], token, ends_phrase=bool(numbered[3]), pause=_pause(numbered[3])))
            continue
        words, before = _words(token, language)
        if typed_words and (before or not words):  # punctuation that stands alone, or before a word
            typed_words[-1] = replace(typed_words[-1], ends_phrase=True, pause=_pause(typed_words[-1].pause + before))
        typed_words += words
    return typed_words


_LIKE = str.maketrans("\u3002\u0964\u061f\u3001\u060c\u061b;:\u2013\u2014", "..?,,,,,,,")
"""Replaces marks of other scripts, semicolons, colons and dashes by equivalent ones of ``PAUSES``."""


def _pause(marks: str) -> str:
    """Return the mark of ``PAUSES`` that punctuation marks count as; empty if there is none."""
    return min((mark for mark in marks.translate(_LIKE) if mark in PAUSES), key=PAUSES.index, default="")


def _words(token: str, language: str) -> tuple[list[TypedWord], str]:
    """Return the words of a token and the pause mark before them, or in a token without words. A token of symbols only
    gives one word without text, a token of punctuation only gives none.
    """
    plain = unicodedata.normalize("NFKC", token).translate(_ALIKE)
    plain = "".join(c for c in plain if _class(c))
    classes = "".join(map(_class, plain))
    matches = list(_WORD.finditer(classes))
    ends, starts = [0, *(match.end() for match in matches)], [*(match.start() for match in matches), len(plain)]
    between = [slice(*gap) for gap in zip(ends, starts, strict=True)]  # one more than words
    left_out = "".join(c for gap in between for c in plain[gap] if _class(c) in "s#" and c not in _SYMBOLS)
    before, symbols = _pause(plain[between[0]]), _symbols(plain[between[0]], token)
    if not matches:
        words = [TypedWord("", token, left_out)] * bool(left_out) + symbols
        return ([*words[:-1], replace(words[-1], pause=before)], "") if words else ([], before)
    words = []
    for k, (match, gap) in enumerate(zip(matches, between[1:], strict=True)):
        text = plain[match.start() : match.end()]
        if text.lower() == "fs" and plain[match.end() : match.end() + 1] == "-":  # a prefix without a word
            words.append(TypedWord("", f"{text}-", f"{text}-"))
            continue
        is_between = k + 1 < len(matches) and plain[gap] in ":\u2013"  # 10:30, 1990-95
        parts = [*_number_parts(text, token, language), *symbols, *_symbols(plain[gap], token)]
        parts[0], symbols = replace(parts[0], left_out="" if k else left_out), []
        ends_phrase, pause = not set("p.,").isdisjoint(classes[gap]), "" if is_between else _pause(plain[gap])
        words += [*parts[:-1], replace(parts[-1], ends_phrase=ends_phrase, pause=pause)]
    return words, before


def _symbols(text: str, typed: str) -> list[TypedWord]:
    """Return the signs of money and per cent in a text."""
    return [TypedWord(c, typed, meant=_SYMBOLS[c]) for c in text if c in _SYMBOLS]


def _number_parts(text: str, typed: str, language: str) -> list[TypedWord]:
    """Return a number without marks between thousands, and its mark and decimals; or an ordinal, or another word."""
    mark = "," if language == "en" else "[.]"
    thousands = rf"\b[1-9]\d{{0,2}}(?:(?:{mark}\d{{3}})+|(?:,\d{{3}}){{2,}}|(?:[.]\d{{3}}){{2,}})(?!\d)"
    number = re.sub(thousands, lambda match: re.sub("[.,]", "", match[0]), text)
    if not re.search(r"\d[.,]", number):
        ordinal = _ORDINAL.fullmatch(number)
        return [TypedWord(number.replace(".", ""), typed, meant=ordinal[1] if ordinal else "")]
    parts = [part for part in re.split("([.,])", number) if part]
    return [TypedWord(part, typed, meant=_POINTS.get(language, "") if part in ".," else "") for part in parts]


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


def is_function_word(word: str, after: str) -> bool:
    """Return whether a word is an article or a form of *be*; or a form of *do* that begins a question, recognised by
    the pronoun ``after`` it: "do you like dogs", but not "I do".
    """
    folded = word.casefold()
    return folded in _ARTICLES | _COPULAS or (folded in _AUXILIARIES and after.casefold() in _SUBJECTS)


SPELLED_MARKS = (LETTER_MARK, "#")
"""Prefixes of tokens to fingerspell."""
QUESTION_WORDS = ("WHO", "WHAT", "WHERE", "WHEN", "WHY", "HOW", "WHICH")
_HYPHEN = "-"
_APOSTROPHE = "'"
_LEFT_OUT = "; it is left out"
"""The end of warnings about letters and numbered glosses that the lexicon lacks."""
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
    language: code of the signed language of its glosses; empty if unknown, and without glosses.
    """

    token: str
    glosses: tuple[str, ...]
    spelled: bool = False
    warning: str = ""
    note: str = ""
    suggestions: tuple[str, ...] = ()
    pause: str = ""
    language: str = ""


def parse(
    text: str,
    lexicon: Lexicon,
    spell: bool = True,
    compounds: bool = True,
    drop_function_words: bool = False,
    language: str = "en",
    one_language: bool = False,
) -> list[SentenceToken]:
    """Split a line of glosses into tokens at white space and punctuation, and find how each is signed.

    A token that the lexicon has, in any case, is that word; else a gloss that differs only in accents, marks, variant
    or hyphens (``Lexicon.match``), or that it is a form of (``lemmas`` of ``language``; none if that is empty), with a
    note. ``language`` names the spoken language of the words, the signed one of the sentence, or both
    (``read_languages``); without the latter it is the lexicon's. Letters of another signed language spell nothing;
    those of ``ALPHABETS`` ship. With ``compounds`` the longest run of words that is one gloss becomes that gloss (I
    LOVE YOU: I-LOVE-YOU), unless punctuation separates them. ``fs-ANNA`` and ``#ANNA`` are fingerspelled; hyphens
    between letters are ignored. A hyphenated token whose parts are all glosses becomes those glosses. A number is
    NUMBER-12, or its digits. Any other token is fingerspelled if the lexicon has all its letters, else left out, with a
    warning and ``suggestions``. Emoji and other symbols are left out with a warning. With ``drop_function_words``
    English words without a sign in ASL are left out with a note, unless they are part of a compound.

    Raises ``InputError`` if nothing of the line can be said: ``UnknownGlossError``, which names every unknown token and
    similar glosses, if one was typed. Without ``spell`` it raises for the first faults instead of spelling and leaving
    words out; with ``one_language`` for signs of several languages, or of another than the named one.
    """
    language, signed = read_languages(language)
    letters = _Letters(lexicon, signed or lexicon.language)
    words = [part for word in split_words(text, lexicon.__contains__, language) for part in _parts(word, lexicon)]
    if not any(word.text for word in words):
        left_out = "".join(word.left_out for word in words)
        left_out_note = f"; {left_out[:40]!r} stands for none" if left_out else ""
        raise InputError(f"no gloss in the sentence, expected at least one{left_out_note}")
    readings: list[SentenceToken] = []
    index = 0
    while index < len(words):
        token = _compound(words[index : index + _LONGEST_COMPOUND], lexicon, language) if compounds else None
        token = token or _token(words, index, letters, spell, drop_function_words, language)
        index += max(1, len(token.token.split()))
        code = lexicon.language_of(token.glosses[0]) or signed if token.glosses else ""
        readings.append(replace(token, pause=words[index - 1].pause, language=code))
    texts = {word.text for word in words}
    missing = [token for token in readings if token.warning and not token.glosses and token.token in texts]
    if missing and not (spell and any(token.glosses for token in readings)):
        unknown = {token.token: token.suggestions for token in missing if _LEFT_OUT not in token.warning}
        fault = InputError(f"{lexicon.where}: {missing[0].warning.partition(_LEFT_OUT)[0]}")
        where = lexicon.where + f", without letters{letters.of_language}" * bool(letters.of_language)
        raise UnknownGlossError(unknown, where) if unknown else fault
    if one_language and (mixed := mixed_languages(readings, signed)):
        raise InputError(f"{lexicon.where}: {mixed}, expected one language")
    return readings


def mixed_languages(tokens: Sequence[SentenceToken], signed: str = "") -> str:
    """Return which words are of which signed language if a line has several, or another than ``signed`` if that names
    one; else an empty text.
    """
    words: dict[str, list[str]] = {}
    for token in tokens:
        if token.glosses and (not signed or token.language != signed):
            words.setdefault(token.language, []).append(token.token)
    if len(words) < 1 + (not signed):
        return ""
    parts = [f"{code or 'unnamed'} ({list_names(names)})" for code, names in words.items()]
    what = f"other languages than {signed}" if signed else "several languages"
    return f"signs of {what}: {'; '.join(parts)}"


def line_warnings(tokens: Sequence[SentenceToken], language: str = "") -> list[str]:
    """Return warnings about a whole line, one line each: that it mixes signed languages, or that more than half of its
    words, and at least two, are spelled. ``language``: as in ``parse``.
    """
    mixed = mixed_languages(tokens, read_languages(language)[1])
    n_spelled, (n_words, n_letters) = len(list_spelled_words(tokens)), _count_words(tokens)
    spelled = f"{n_spelled} of {n_words} words are spelled, letter by letter ({n_letters} letters)"
    return [*filter(None, (mixed, spelled * (n_spelled > max(1, n_words / 2))))]


def _count_words(tokens: Sequence[SentenceToken]) -> tuple[int, int]:
    """Return the number of words of tokens, and of letters that spell them."""
    n_letters = sum(len(token.glosses) for token in tokens if token.spelled)
    return sum(len(token.token.split()) for token in tokens), n_letters


def token_glosses(tokens: Sequence[SentenceToken]) -> list[str]:
    """Return the glosses of all tokens, in order. Raises ``InputError`` if every word was left out."""
    glosses = [gloss for token in tokens for gloss in token.glosses]
    if not glosses:
        raise InputError("ASL has no signs for these words, expected another; keep function words to spell them")
    return glosses


def list_spelled_words(tokens: Sequence[SentenceToken]) -> list[str]:
    """Return the fingerspelled words, as typed."""
    return [token.token for token in tokens if token.spelled]


def count_words(tokens: Sequence[SentenceToken]) -> str:
    """Return how many words are signed, spelled and left out; empty if all are signed."""
    spelled, left_out = len(list_spelled_words(tokens)), sum(not token.glosses for token in tokens)
    n_words, n_letters = _count_words(tokens)
    counts = f"{n_words - spelled - left_out} of {n_words} words signed"
    counts += f", {spelled} spelled ({n_letters} letter{'s' * (n_letters != 1)})" * bool(spelled)
    return counts + f", {left_out} left out" * bool(left_out) if spelled or left_out else ""


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


def _compound(words: Sequence[TypedWord], lexicon: Lexicon, language: str) -> SentenceToken | None:
    """Return the longest gloss formed by the first two or more of up to ``_LONGEST_COMPOUND`` words, or None; in
    English, function words between them may be left out (how are you: HOW-YOU).
    """
    n_words = next((k + 1 for k, word in enumerate(words) if word.ends_phrase or word.left_out), len(words))
    for n in range(n_words, 1, -1):
        texts = [word.text for word in words[:n]]
        joined = _HYPHEN.join(texts)
        kept = [text for text in texts[1:-1] if language != "en" or not is_function_word(text, "")]
        names = (joined, joined.replace(_APOSTROPHE, ""), _HYPHEN.join([texts[0], *kept, texts[-1]]))
        gloss = next(filter(None, map(lexicon.match, names)), None)
        if gloss is not None:
            token = " ".join(texts)
            return SentenceToken(token, (gloss,), note=f"{token!r} is read as one gloss, {gloss}")
    return None


def _drop_function_word(words: Sequence[TypedWord], at: int) -> str:
    """Return the text of a word without function words: empty, the first part of a contraction, or the whole text."""
    text, after = words[at].text, "" if words[at].ends_phrase else "".join(word.text for word in words[at + 1 : at + 2])
    return "" if is_function_word(text, after) else without_copula(text) or text


def _token(
    words: Sequence[TypedWord], at: int, letters: _Letters, spell: bool, drops: bool, language: str
) -> SentenceToken:
    """Return how a word is signed; with a warning and without glosses if the lexicon has neither sign nor letters."""
    word = words[at]
    kept = word.meant or (_drop_function_word(words, at) if drops else word.text)
    read = _resolve_text(kept, letters, spell, language) if kept else SentenceToken(word.text or word.typed, ())
    if kept != word.text:
        note = f"{word.text!r} is read as {kept!r}" if kept else f"{word.text!r} has no sign in ASL, and is left out"
        read = replace(read, token=word.text, note=note)
    where = "" if word.left_out == word.typed else f" in {word.typed!r}"
    left_out = f"{word.left_out!r}{where} is no gloss and no letter, and is left out" if word.left_out else ""
    return replace(read, warning="; ".join(filter(None, (read.warning, left_out))), note=read.note or word.note)


def _resolve_text(text: str, alphabet: _Letters, spell: bool, language: str) -> SentenceToken:
    lexicon = alphabet.lexicon
    if text in lexicon:
        return SentenceToken(text, (lexicon.entry(text).gloss,))
    if _mark(text):
        return _fingerspell_token(text, alphabet)
    first, mark, _ = text.rpartition("#")
    if mark:
        forms = [first, *takewhile(lexicon.__contains__, (f"{first}#{k}" for k in count(2)))]
        return SentenceToken(text, (), warning=f"has no {text!r}, expected {' or '.join(forms[:5])}{_LEFT_OUT}")
    number = "".join(str(unicodedata.decimal(c)) for c in text) if text.isdecimal() else ""
    names = [text, *((f"NUMBER-{number}", f"NUM-{number}") if number else lemmas(text, language))]
    gloss = next(filter(None, map(lexicon.match, names)), None)
    if gloss is not None:
        return SentenceToken(text, (gloss,), note=f"{text!r} is read as {gloss}")
    bare = text.replace(_HYPHEN, "").replace(_APOSTROPHE, "")
    letters = alphabet.spell(bare) if spell else ()
    if not letters or () in letters:
        near = lexicon.nearest(text)
        warning = f"no gloss {text!r}, and no letters{alphabet.of_language} for it{_hint(near)} is left out"
        return SentenceToken(text, (), warning=warning, suggestions=near)
    if number:
        return SentenceToken(text, tuple(chain(*letters)), True)
    meant = tuple(gloss for gloss in lexicon.nearest(text, similarity=_TYPO) if _may_be_meant(gloss, bare))
    or_drop = ", or drop function words" * is_function_word(text, "")
    warning = f"no gloss {text!r}{_hint(meant)} is spelled{alphabet.without_accents(bare, letters)}"
    warning += f"; write {LETTER_MARK}{bare} to mean that{or_drop}"
    return SentenceToken(text, tuple(chain(*letters)), True, warning, suggestions=meant)


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


def _hint(near: Sequence[str]) -> str:
    return f": did you mean {' or '.join(near)}? It" if near else ", so it"


def _mark(text: str) -> str:
    """Return the prefix of ``SPELLED_MARKS`` that a text begins with; empty if it has none or nothing follows."""
    return next((mark for mark in SPELLED_MARKS if text.lower().startswith(mark) and len(text) > len(mark)), "")


def _fingerspell_token(token: str, alphabet: _Letters) -> SentenceToken:
    """Fingerspell a token that begins with one of ``SPELLED_MARKS``, and may end with @ and one of ``ALPHABETS``."""
    marked, _, code = token.rpartition("@")
    is_named = code.lower() in ALPHABETS and bool(marked)
    alphabet = replace(alphabet, language=code.lower()) if is_named else alphabet
    word = (marked if is_named else token)[len(_mark(token)) :].replace(_HYPHEN, "").replace(_APOSTROPHE, "")
    letters = alphabet.spell(word)
    if not letters or () in letters:
        letter = alphabet.split(word)[letters.index(())] if letters else _HYPHEN
        warning = f"{token!r} cannot be spelled, there is no letter {letter!r}{alphabet.of_language}; its letters are "
        return SentenceToken(token, (), warning=f"{warning}the glosses that begin with {LETTER_MARK}{_LEFT_OUT}")
    spelled_as = alphabet.without_accents(word, letters)
    return SentenceToken(token, tuple(chain(*letters)), True, f"{token!r} is spelled{spelled_as}" if spelled_as else "")


@dataclass(frozen=True)
class _Letters:
    """The letters that spell words in a signed language: the lexicon's, else those that ship.

    language: code of the signed language; empty if unknown, which every letter of the lexicon is taken for.
    """

    lexicon: Lexicon
    language: str

    @property
    def of_language(self) -> str:
        """The name of an alphabet that is not here, for warnings; else an empty text."""
        return f" of {self.language}" * (self.language not in ("", *ALPHABETS))

    def split(self, word: str) -> list[str]:
        """Return the letters of a word, composed; accents that no letter takes are left out."""
        joined = "".join(f"{letters}|" for letters in JOINED_LETTERS if self._letter(letters))
        composed = "".join(c for c in unicodedata.normalize("NFC", word) if plain(c))
        return re.findall(f"{joined}.", composed, re.IGNORECASE | re.DOTALL)

    def spell(self, word: str) -> tuple[tuple[str, ...], ...]:
        """Return for each letter of a word the glosses that spell it: its own, or those of plain letters (Ü: U, ß: S
        S); none if they are lacking.
        """

        def glosses(characters: Sequence[str]) -> tuple[str, ...]:
            found = [self._letter(c) for c in characters if c.isprintable()]
            return tuple(filter(None, found)) if all(found) else ()

        split = self.split(word)
        letters = {c: glosses([c]) or glosses(plain(c)) for c in {*split}}
        return tuple(letters[c] for c in split)

    def _letter(self, character: str) -> str | None:
        """Return the gloss of a letter or digit, or None."""
        character = str(unicodedata.decimal(character, character)) if len(character) == 1 else character
        languages, lexicon = ("", self.language), self.lexicon
        for letter in (letter_gloss(character, language) for language in languages):
            is_letter = letter in lexicon and lexicon.entry(letter).kind == "letter"
            if is_letter and (not self.language or lexicon.language_of(letter) in languages):
                return lexicon.entry(letter).gloss
        return self.lexicon.match(f"NUMBER-{character}") if character.isdecimal() else None

    def without_accents(self, word: str, letters: Sequence[Sequence[str]]) -> str:
        """Return a remark if a word is spelled without its accents (JOSE), else an empty text."""
        pairs = zip(self.split(word), letters, strict=True)
        if all(letter_of(glosses[0]) == letter_of(letter_gloss(c)) or c.isdecimal() for c, glosses in pairs):
            return ""
        return f" as {''.join(map(letter_of, chain(*letters)))}, without accents"
