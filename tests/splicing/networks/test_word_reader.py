"""splicing.word_reader: the movements of a word by its phases, and words that are read once."""

from __future__ import annotations

import gc
import weakref

import numpy as np
from conftest import GOLDEN

from signing import word
from signsplice.body.retarget import align
from signsplice.rig.align import reference
from signsplice.splicing.methods.learned import open_sessions
from signsplice.splicing.networks.word_reader import WordReader, stroke_span

TINY = GOLDEN / "tiny_bundle"


def certain(*phases: int) -> np.ndarray:
    """Scores (T, 5) of frames whose phases are certain."""
    return 20.0 * np.eye(5)[list(phases)]


def test_a_stroke_is_all_movements_and_a_frame_at_either_end() -> None:
    assert stroke_span(certain(0, 1, 2, 2, 3, 3, 2, 3, 2, 4, 0)) == (3, 8)
    assert stroke_span(certain(3, 3)) == (0, 1)
    doubtful = certain(0, 1, 2, 2, 3, 3, 2, 2, 4)
    doubtful[6] = np.log([0.01, 0.01, 0.89, 0.08, 0.01])
    assert stroke_span(doubtful) == (3, 7)


def test_the_stroke_of_a_sign_that_is_all_hold_is_its_middle() -> None:
    assert stroke_span(certain(0, 1, 2, 2, 2, 2, 2, 4, 0)) == (4, 4)
    assert stroke_span(certain(0, 0, 1, 1, 1, 4, 4, 0, 0)) is None


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
