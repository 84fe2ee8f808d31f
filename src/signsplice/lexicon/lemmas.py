"""Dictionary forms of typed words: by ``simplemma`` where it is installed (extra ``words``), and by English endings.

An English word in -er is taken for who does the verb (teacher: TEACH). With the words that ship that is right of
teacher, player, worker, writer, reader, dancer, helper, learner, signer, maker, swimmer and manager; of common words it
would be wrong of cower, liver, manner, muster, shower and wither, which are left alone.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from signsplice.errors import InputError

_LONGEST = 40
"""Maximum number of letters of a word that is looked up."""
_NOT_INFLECTED = frozenset((
    "best", "better", "cower", "goods", "later", "liver", "manner", "muster", "shower", "stranger", "wither", "worse",
    "worst",
))  # fmt: skip
"""English words whose sign is not that of the word that their ending leaves."""
_CONTRACTION = re.compile(
    r"(i(?='?m$)|(?:you|they)(?='?re$)|we(?='re$)|(?:he|she|it|that|what|where|when|who|how)(?='s$))'?(?:m|re|s)",
    re.IGNORECASE,
)
_SIBILANT = re.compile(r".*(?:[sxzo]|[cs]h)")
"""An English word that takes -es."""
_SHUT = re.compile(r"[^aeiou]*[aeiou][^aeiouwxy]")
"""An English syllable that doubles its last letter before -ed, -ing and -er: stop, but not caring: car."""


def without_copula(word: str) -> str:
    """Return the first part of a contraction with *am*, *are* or *is* (I'm, youre, what's); empty for other words."""
    match = _CONTRACTION.fullmatch(word)
    return match[1] if match else ""


def lemmas(word: str, language: str) -> Iterator[str]:
    """Yield dictionary forms that a word may be a form of, best first; none without a language.

    language: of the word, a code of ISO 639-1. Raises ``InputError`` for one that ``simplemma`` does not know.
    """
    is_english = language == "en"
    if not language or len(word) > _LONGEST or (is_english and word.casefold() in _NOT_INFLECTED):
        return
    base = re.sub("'s?$", "", word) if is_english else word.rpartition("'")[2]  # mother's, l'école
    found = [_lemma(form, language) for form in dict.fromkeys((base, base.lower(), base.capitalize()))]
    yield from (without_copula(word) * is_english, base, *found)
    for form in dict.fromkeys((base.lower(), *found)) if is_english else ():
        yield from () if form in _NOT_INFLECTED else _without_ending(form)


def _lemma(word: str, language: str) -> str:
    try:
        from simplemma import lemmatize  # a dictionary takes 0.1 s and 26 MB
    except ImportError:
        return word
    try:
        return lemmatize(word, lang=language)
    except ValueError as error:
        raise InputError(f"language {language!r:.20}: no dictionary, expected a code such as en, de or fr") from error


def _without_ending(word: str) -> Iterator[str]:
    """Yield what an English word may be without its ending: making, stopped, studies: make, stop, study."""
    for ending in ("ies", "s", "es", "ed", "ing", "er"):
        stem = word.removesuffix(ending)
        if stem == word or len(stem) < 3:
            continue
        if ending in ("ies", "s") or (ending == "es" and _SIBILANT.fullmatch(stem)):
            yield f"{stem}y" if ending == "ies" else stem
        elif ending != "es":
            yield from (f"{stem}e", "" if _SHUT.fullmatch(stem) else stem, stem[:-1] * (stem[-1] == stem[-2]))
