"""English words that American Sign Language has no signs for, so that they may be left out of a line of glosses.

ASL has no state-of-being verbs (https://www.lifeprint.com/asl101/pages-signs/a/am.htm), and no articles as English has
them: traditionally it is said to lack determiners, others read some pointing signs as such (Bahan, Kegl, MacLaughlin
and Neidle, Convergent Evidence for the Structure of Determiner Phrases in ASL, 1995). Nothing is translated: the other
words stay in their order.
"""

from __future__ import annotations

import re

_ARTICLES = frozenset(("a", "an", "the"))
_COPULAS = frozenset(("am", "is", "are", "was", "were", "be", "been", "being"))
_AUXILIARIES = frozenset(("do", "does", "did"))
_SUBJECTS = frozenset(("i", "you", "he", "she", "it", "we", "they"))
_CONTRACTION = re.compile(
    r"(i(?='?m$)|(?:you|they)(?='?re$)|we(?='re$)|(?:he|she|it|that|what|where|when|who|how)(?='s$))'?(?:m|re|s)",
    re.IGNORECASE,
)


def is_function_word(word: str, after: str) -> bool:
    """Whether a word is an article or a form of *be*; or a form of *do* with which a question begins, which is told by
    the pronoun ``after`` it: "do you like dogs", but not "I do".
    """
    folded = word.casefold()
    return folded in _ARTICLES | _COPULAS or (folded in _AUXILIARIES and after.casefold() in _SUBJECTS)


def without_copula(word: str) -> str:
    """The first part of a contraction with *am*, *are* or *is* (I'm, youre, what's); empty for any other word."""
    found = _CONTRACTION.fullmatch(word)
    return found[1] if found else ""
