"""Flips one bit of a lexicon, again and again: ``python attacks/flips.py [N]``.

A reader must then get each word as it was, or an error; and whatever else the index says of words must be as it was, or
`lexicon check` and the start of `serve` must find it. Anything else is a silent flip. Prints a row of a Markdown table
for each file of the words that ship. Takes a minute for 1,000 flips of each.
"""

from __future__ import annotations

import random
import shutil
import sys
import tempfile
from collections import Counter
from pathlib import Path

import numpy as np

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


def flip_bits(file: str, n: int, seed: int = 0) -> Counter[str]:
    """Returns the number of flips of a file of the shipped lexicon that were refused, were found by a check, changed
    nothing, or were silent.
    """
    counts, rng = Counter[str](), random.Random(seed)
    with tempfile.TemporaryDirectory() as folder, Lexicon(SHIPPED) as true_lexicon:
        words = Index(SHIPPED / INDEX).words()
        spans = [(frames.start, frames.start + frames.n_bytes, entry.gloss) for entry, frames in words]
        true_facts = read_facts(true_lexicon)
        path = Path(shutil.copytree(SHIPPED, Path(folder) / "words")) / file
        for _ in range(n):
            position, bit = rng.randrange(path.stat().st_size), 1 << rng.randrange(8)
            _flip_bit(path, position, bit)
            glosses = {
                *_PROBES,
                *(gloss for start, stop, gloss in spans if file == FRAMES and start <= position < stop),
            }
            try:
                with Lexicon(path.parent) as lexicon:
                    clips = {gloss: read_word(lexicon, gloss) for gloss in glosses}
                    is_index_changed = file == INDEX and read_facts(lexicon) != true_facts
                    is_detected = any(lexicon.faults()) if is_index_changed else False
            except InputError:
                counts["refused"] += 1
            else:
                changed = [g for g, c in clips.items() if c is not None and not is_same(c, true_lexicon.clip(g))]
                if changed or (is_index_changed and not is_detected):
                    counts["SILENT"] += 1
                elif None in clips.values():
                    counts["refused"] += 1
                else:
                    counts["found by a check" if is_detected else "no change"] += 1
            _flip_bit(path, position, bit)
    return counts


def read_facts(lexicon: Lexicon) -> tuple[object, ...]:
    """Returns all that a lexicon's index says of words. Raises ``InputError``."""
    return [*lexicon.entries()], lexicon.glosses, lexicon._display_names


def _flip_bit(path: Path, position: int, bit: int) -> None:
    with path.open("r+b") as file:
        file.seek(position)
        byte = file.read(1)[0]
        file.seek(position)
        file.write(bytes([byte ^ bit]))


def main() -> None:
    """Flips bits in both files; exit status 1 if a flip was silent."""
    n, n_silent = int(sys.argv[1]) if sys.argv[1:] else 1000, 0
    print(
        "| file | flips | refused | found by a check | as they were | silent |\n| --- | --- | --- | --- | --- | --- |"
    )
    for file in (FRAMES, INDEX):
        counts = flip_bits(file, n)
        row = (file, n, counts["refused"], counts["found by a check"], counts["no change"], counts["SILENT"])
        print(f"| {' | '.join(map(str, row))} |", flush=True)
        n_silent += counts["SILENT"]
    sys.exit(n_silent > 0)


if __name__ == "__main__":
    main()
