"""Pairs of words whose splices are compared between processors."""

from __future__ import annotations

from pathlib import Path

import signsplice as ss
from signsplice.lexicon import Lexicon

BUNDLE = Path(__file__).parents[1] / "golden" / "tiny_int8"
"""tiny_bundle after `signsplice export --int8`."""
WORDS = BUNDLE.with_name("processor_words")
"""Four words as commit 282f865 signs them: those that ship are signed anew now and then, on one kind of processor."""
PAIRS = (("HELLO", "DEAF"), ("THANK-YOU", "I"))
SECONDS = {PAIRS[0]: 77 / 30.0, PAIRS[1]: 28 / 30.0}
"""Of the transitions that another processor made."""


def spliced(pair: tuple[str, str]) -> ss.SpliceResult:
    """Two words of ``WORDS``, joined by the networks of ``BUNDLE``."""
    with Lexicon(WORDS) as words:
        clips = [words.clip(gloss) for gloss in pair]
    return ss.splice(clips, ss.SpliceOptions(bundle=BUNDLE, transition_time=SECONDS[pair]))
