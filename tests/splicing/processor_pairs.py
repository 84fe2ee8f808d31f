"""Pairs of words whose splices are compared between processors."""

from __future__ import annotations

from pathlib import Path

import signsplice as ss
from signsplice.lexicon import shipped

BUNDLE = Path(__file__).parents[1] / "golden" / "tiny_int8"
"""tiny_bundle after `signsplice export --int8`."""
PAIRS = (("HELLO", "DEAF"), ("BOOK", "MOTHER"), ("THANK-YOU", "I"), ("SIGN", "YES"))


def spliced(pair: tuple[str, str]) -> ss.SpliceResult:
    """Two words that ship, joined by the networks of ``BUNDLE``."""
    with shipped() as words:
        return ss.splice([words.clip(gloss) for gloss in pair], ss.SpliceOptions(bundle=BUNDLE))
