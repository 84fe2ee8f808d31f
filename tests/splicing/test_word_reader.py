"""splicing.word_reader: words that are read once, and those whose hands sign one after the other."""

from __future__ import annotations

import gc
import weakref

from conftest import GOLDEN

from signing import word
from signsplice.body.retarget import align
from signsplice.rig.align import reference
from signsplice.splicing.learned import WordReader, open_sessions

TINY = GOLDEN / "tiny_bundle"


def test_a_word_is_read_once_wherever_it_is_placed() -> None:
    reader, first, clip = WordReader(open_sessions(TINY)), word("BOOK").clip, word("MOTHER").clip
    placed = align(clip, reference(word("SEE").clip)).clip
    assert placed.source_clip is clip
    reading = reader.pair(first, clip)[1]
    assert reader.pair(first, placed)[1] is reading
    reader.forget(placed)
    assert reader.pair(first, placed)[1] is not reading


def test_a_reading_is_forgotten_with_its_clip() -> None:
    reader, clip = WordReader(open_sessions(TINY)), word("MOTHER").clip[:]
    reading = weakref.ref(reader.pair(clip, word("BOOK").clip)[0])
    gc.collect()
    assert reading() is reader.pair(clip, word("BOOK").clip)[0]
    del clip
    gc.collect()
    assert reading() is None
