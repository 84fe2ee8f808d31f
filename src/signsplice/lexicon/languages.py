"""Languages of a line: the spoken one of its words, and the signed one of its signs and letters.

Signed languages have codes of ISO 639-3, which are also tags of BCP 47: ``ase`` American, ``gsg`` German, ``dse`` Dutch
Sign Language.
"""

from __future__ import annotations

import re

from signsplice.errors import InputError

ALPHABETS = ("ase", "dse", "gsg")
"""Signed languages whose manual alphabets ship."""
_SPOKEN = {
    **dict.fromkeys(("asq", "gsg", "sgg"), "de"),
    **dict.fromkeys(("dse", "vgt"), "nl"),
    **dict.fromkeys(("fcs", "fsl", "sfb", "ssr"), "fr"),
    "gss": "el",
}
"""Signed language -> the spoken language in which its glosses are commonly written; English for others."""


def read_languages(code: str) -> tuple[str, str]:
    """Return the spoken and the signed language of a code: ``de`` names the first, ``gsg`` both, ``en-gsg`` each; the
    second is empty if it does not name one, both if it is empty. Raises ``InputError`` for other codes.
    """
    match = re.fullmatch(r"(?:sgn-)?(?P<only>[a-z]{3})|(?P<spoken>[a-z]{2,3})(?:-(?P<signed>[a-z]{3}))?|", code.lower())
    if match is None:
        expected = "expected that of the words (en, de, fr), of the signs (ase, gsg, dse), or both (en-gsg)"
        raise InputError(f"language {code[:20]!r}, {expected}")
    if match["only"]:
        return _SPOKEN.get(match["only"], "en"), match["only"]
    return match["spoken"] or "", match["signed"] or ""


def check_signed(code: str) -> str:
    """Return the code of a signed language, or an empty text. Raises ``InputError`` for another text."""
    if not re.fullmatch("(?:[a-z]{3})?", code):
        raise InputError(f"language {code[:20]!r}, expected three letters, such as ase, gsg or dse")
    return code
