"""One bit of a lexicon flipped, again and again: ``python attacks/flips.py [N]``.

Whoever reads a word then has to get the word as it was, or an error; and what else the index says of words has to be as
it was, or `lexicon check` and the start of `serve` find it. Anything else is a silent flip. Prints a row of a Markdown
table for each file of the words that ship. Takes a minute for 1,000 flips of each.
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
"""Words that are read after every flip, besides those whose bytes hold it."""


def read(lexicon: Lexicon, gloss: str) -> Clip | None:
    """A word, None where it is refused."""
    try:
        return lexicon.clip(gloss)
    except InputError:
        return None


def is_same(one: Clip, other: Clip) -> bool:
    """Whether two words are the same frame by frame."""
    return (
        one.fps == other.fps
        and one.skeleton.names == other.skeleton.names
        and np.array_equal(one.skeleton.offsets, other.skeleton.offsets)
        and np.array_equal(one.local_rotations, other.local_rotations)
        and np.array_equal(one.root_positions, other.root_positions)
    )


def flips(file: str, n: int, seed: int = 0) -> Counter[str]:
    """How many flips of a file of the shipped lexicon were refused, were found by a check, changed nothing, or were
    silent.
    """
    counts, rng = Counter[str](), random.Random(seed)
    with tempfile.TemporaryDirectory() as folder, Lexicon(SHIPPED) as true:
        words = Index(SHIPPED / INDEX).words()
        spans = [(at.start, at.start + at.n_bytes, entry.gloss) for entry, at in words]
        said = facts(true)
        path = Path(shutil.copytree(SHIPPED, Path(folder) / "words")) / file
        for _ in range(n):
            at, bit = rng.randrange(path.stat().st_size), 1 << rng.randrange(8)
            _flip(path, at, bit)
            glosses = {*_PROBES, *(gloss for start, stop, gloss in spans if file == FRAMES and start <= at < stop)}
            try:
                with Lexicon(path.parent) as lexicon:
                    found = {gloss: read(lexicon, gloss) for gloss in glosses}
                    is_other = file == INDEX and facts(lexicon) != said
                    is_checked = any(lexicon.faults()) if is_other else False
            except InputError:
                counts["refused"] += 1
            else:
                changed = [g for g, clip in found.items() if clip is not None and not is_same(clip, true.clip(g))]
                if changed or (is_other and not is_checked):
                    counts["SILENT"] += 1
                elif None in found.values():
                    counts["refused"] += 1
                else:
                    counts["found by a check" if is_checked else "no change"] += 1
            _flip(path, at, bit)
    return counts


def facts(lexicon: Lexicon) -> tuple[object, ...]:
    """All that a lexicon's index says of words. Raises ``InputError``."""
    return [*lexicon.entries()], lexicon.glosses, lexicon._display_names


def _flip(path: Path, at: int, bit: int) -> None:
    with path.open("r+b") as file:
        file.seek(at)
        byte = file.read(1)[0]
        file.seek(at)
        file.write(bytes([byte ^ bit]))


def main() -> None:
    """Flip bits in both files; exit status 1 where one was silent."""
    n, n_silent = int(sys.argv[1]) if sys.argv[1:] else 1000, 0
    print(
        "| file | flips | refused | found by a check | as they were | silent |\n| --- | --- | --- | --- | --- | --- |"
    )
    for file in (FRAMES, INDEX):
        seen = flips(file, n)
        row = (file, n, seen["refused"], seen["found by a check"], seen["no change"], seen["SILENT"])
        print(f"| {' | '.join(map(str, row))} |", flush=True)
        n_silent += seen["SILENT"]
    sys.exit(n_silent > 0)


if __name__ == "__main__":
    main()
