"""How often a stream, which sees two words at a time, cuts otherwise than a splice of the whole sentence, and whether
transitions are the same to the last bit where it cuts alike.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

import signsplice as ss
from signsplice.lexicon import open_shipped_lexicon
from signsplice.motion import Clip
from signsplice.splicing.engine import Piece

N_SENTENCES = 200
SEED = 18


@dataclass
class Count:
    """What was seen so far.

    sentences, seams: how many there were.
    sentences_otherwise, seams_otherwise: how many of them the stream cut at other frames.
    transitions: how many were between the same frames of the same words.
    different: how many of those differ in any bit.
    largest_shift: frames between the two choices of a cut, at most.
    """

    sentences: int = 0
    seams: int = 0
    sentences_otherwise: int = 0
    seams_otherwise: int = 0
    transitions: int = 0
    different: int = 0
    largest_shift: int = 0

    def add(self, words: list[Clip], options: ss.SpliceOptions) -> None:
        """Splice and stream a sentence, and compare."""
        whole = ss.splice(words, options)
        pieces = list(ss.stream(words, options))
        frames = [whole.clip[slice(*span.output)] for span in whole.spans]
        together = [Piece(clip, span) for clip, span in zip(frames, whole.spans, strict=True)]
        signs = list(zip(_kept(together), _kept(pieces), strict=True))
        shifts = [max(abs(a[1] - b[1]), abs(c[0] - d[0])) for (a, b), (c, d) in pairwise(signs)]
        self.sentences += 1
        self.seams += len(shifts)
        self.sentences_otherwise += any(shifts)
        self.seams_otherwise += sum(shift > 0 for shift in shifts)
        self.largest_shift = max(self.largest_shift, *shifts)
        for k, shift in enumerate(shifts):
            same_words = signs[k][0] == signs[k][1]
            if shift == 0 and same_words:
                self.transitions += 1
                pair = (_transition(together, k), _transition(pieces, k))
                self.different += not np.array_equal(*pair)


def _kept(pieces: list[Piece]) -> list[tuple[int, int]]:
    """The frames [start, stop) that are kept of each word."""
    return [piece.span.source for piece in pieces if piece.span.source is not None]


def _transition(pieces: list[Piece], seam: int) -> NDArray[np.float64]:
    """Rotations of the frames after sign number ``seam`` and before the next."""
    at = [k for k, piece in enumerate(pieces) if piece.span.source is not None]
    made = [piece.clip.local_rotations for piece in pieces[at[seam] + 1 : at[seam + 1]]]
    return np.concatenate(made) if made else np.empty(0)


def main() -> None:
    """Print the table's rows."""
    lexicon = open_shipped_lexicon()
    glosses = [gloss for gloss in lexicon.glosses if not gloss.startswith("fs-")]
    for cutter in ("learned", "learned-fluent"):
        rng = np.random.default_rng(SEED)
        count, options = Count(), ss.SpliceOptions(cutter=cutter)
        for _ in range(N_SENTENCES):
            chosen = rng.choice(len(glosses), int(rng.integers(3, 13)), replace=False)
            count.add([lexicon.clip(glosses[k]) for k in chosen], options)
        print(
            f"| {count.sentences} sentences of 3 to 12 words, streamed and spliced, cutter {cutter} | "
            f"{count.different} of {count.transitions} transitions between the same frames differ in any bit; "
            f"{count.sentences_otherwise} sentences and {count.seams_otherwise} of {count.seams} seams are cut "
            f"otherwise, by {count.largest_shift} frames at most |",
            flush=True,
        )


if __name__ == "__main__":
    main()
