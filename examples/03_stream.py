"""Plays words while they still arrive: finished frames come out one word behind, and never change afterwards.

Run: python examples/03_stream.py [FOLDER]     (writes FOLDER/stream.bvh; default out/examples)
"""

import sys
import time
from collections.abc import Iterator
from pathlib import Path

import signsplice as ss

GLOSSES = ("HELLO", "I", "DEAF", "I", "SIGN", "THANK-YOU")


def arriving(lexicon: ss.Lexicon) -> Iterator[ss.Clip]:
    """The words of ``GLOSSES``, as somebody might type them."""
    for gloss in GLOSSES:
        print(f"in:  {gloss}")
        yield lexicon.clip(gloss)


def main(folder: Path) -> None:
    """Stream a sentence, and compare it with the same words spliced at once."""
    folder.mkdir(parents=True, exist_ok=True)
    pieces, began = [], time.perf_counter()
    with ss.open_lexicon() as lexicon:
        # A word can be cut only when the next one is known. So the stream reads one word ahead, and no more: it holds
        # one word in memory, however long the sentence becomes.
        for piece in ss.stream(arriving(lexicon)):
            start, stop = piece.span.output
            name, after_ms = piece.span.name or "(new frames)", 1e3 * (time.perf_counter() - began)
            print(f"out: {name:12} frames {start:3d} to {stop:3d}, after {after_ms:.0f} ms")
            pieces.append(piece.clip)  # a player would show these frames now
        words = [lexicon.clip(gloss) for gloss in GLOSSES]

    # Joined, the pieces are the sentence that ss.splice makes of the same words, bit for bit.
    streamed, spliced = ss.concatenate(pieces), ss.splice(words).clip
    is_same = streamed.local_rotations.tobytes() == spliced.local_rotations.tobytes()
    print(f"{len(streamed)} frames, {'the same as' if is_same else 'other than'} those of ss.splice")

    ss.save(streamed, folder / "stream.bvh")
    print(f"wrote {folder / 'stream.bvh'}")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "out/examples"))
