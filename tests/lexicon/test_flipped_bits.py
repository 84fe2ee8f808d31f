"""One flipped bit of a lexicon is found, or changes nothing.

A reader gets each word as it was, or an error; and whatever else the index says of words is as it was, or `lexicon
check` and the start of `serve` find it. Anything else is a silent flip.
"""

from __future__ import annotations

import random
import shutil
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from signsplice.errors import InputError
from signsplice.lexicon.frames import FRAMES
from signsplice.lexicon.lexicon import SHIPPED, Lexicon
from signsplice.lexicon.store import INDEX, Index
from signsplice.motion import Clip

_PROBES = ("HELLO", "SIGN", "I")
"""Words that are read after every flip, besides those whose bytes hold the flipped bit."""


def read_word(lexicon: Lexicon, gloss: str) -> Clip | None:
    """Returns a word, None if it is refused."""
    try:
        return lexicon.clip(gloss)
    except InputError:
        return None


def is_same(first: Clip, second: Clip) -> bool:
    """Returns whether two words are the same frame by frame."""
    return (
        first.fps == second.fps
        and first.skeleton.names == second.skeleton.names
        and np.array_equal(first.skeleton.offsets, second.skeleton.offsets)
        and np.array_equal(first.local_rotations, second.local_rotations)
        and np.array_equal(first.root_positions, second.root_positions)
    )


@pytest.mark.parametrize("n", [150, pytest.param(1000, marks=pytest.mark.slow)])
@pytest.mark.parametrize("file", [FRAMES, INDEX])
def test_no_flipped_bit_is_silent(file: str, n: int, tmp_path: Path) -> None:
    """In the shipped lexicon; a bit that is flipped again is as it was."""
    counts, rng = Counter[str](), random.Random(0)
    with Lexicon(SHIPPED) as true_lexicon:
        words = Index(SHIPPED / INDEX).words()
        spans = [(frames.start, frames.start + frames.n_bytes, entry.gloss) for entry, frames in words]
        true_facts = read_facts(true_lexicon)
        path = Path(shutil.copytree(SHIPPED, tmp_path / "words")) / file
        for _ in range(n):
            position, bit = rng.randrange(path.stat().st_size), 1 << rng.randrange(8)
            flip_bit(path, position, bit)
            glosses = {
                *_PROBES,
                *(gloss for start, stop, gloss in spans if file == FRAMES and start <= position < stop),
            }
            try:
                with Lexicon(path.parent) as lexicon:
                    clips = {gloss: read_word(lexicon, gloss) for gloss in glosses}
                    is_index_changed = file == INDEX and read_facts(lexicon) != true_facts
                    is_detected = is_index_changed and any(lexicon.faults())
            except InputError:
                counts["refused"] += 1
            else:
                changed = [g for g, c in clips.items() if c is not None and not is_same(c, true_lexicon.clip(g))]
                assert not changed, f"bit {bit} of byte {position} changes {changed} in silence"
                assert is_detected or not is_index_changed, f"bit {bit} of byte {position} is silent"
                counts["refused" if None in clips.values() else "found" if is_detected else "no change"] += 1
            flip_bit(path, position, bit)
    print(dict(counts))


def read_facts(lexicon: Lexicon) -> tuple[object, ...]:
    """Returns all that a lexicon's index says of words. Raises ``InputError``."""
    return [*lexicon.entries()], lexicon.glosses, lexicon._display_names


def flip_bit(path: Path, position: int, bit: int) -> None:
    with path.open("r+b") as file:
        file.seek(position)
        byte = file.read(1)[0]
        file.seek(position)
        file.write(bytes([byte ^ bit]))
