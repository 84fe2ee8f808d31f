"""Counts how often a stream, which sees two words at a time, cuts differently from a splice of the whole sentence, and
checks that transitions are the same to the last bit if the cuts are the same.
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
    """Counts so far.

    sentences, seams: number of each.
    sentences_otherwise, seams_otherwise: number of those that the stream cut at other frames.
    transitions: number between the same frames of the same words.
    different: number of those that differ in any bit.
    largest_shift: greatest distance between the two choices of a cut, frames.
    """

    sentences: int = 0
    seams: int = 0
    sentences_otherwise: int = 0
    seams_otherwise: int = 0
    transitions: int = 0
    different: int = 0
    largest_shift: int = 0

    def add(self, words: list[Clip], options: ss.SpliceOptions) -> None:
        """Splices and streams a sentence, and compares."""
        spliced = ss.splice(words, options)
        stream_pieces = list(ss.stream(words, options))
        clips = [spliced.clip[slice(*span.output)] for span in spliced.spans]
        splice_pieces = [Piece(clip, span) for clip, span in zip(clips, spliced.spans, strict=True)]
        signs = list(zip(_list_kept_spans(splice_pieces), _list_kept_spans(stream_pieces), strict=True))
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
                pair = (_extract_transition(splice_pieces, k), _extract_transition(stream_pieces, k))
                self.different += not np.array_equal(*pair)


def _list_kept_spans(pieces: list[Piece]) -> list[tuple[int, int]]:
    """Returns the frames [start, stop) that are kept of each word."""
    return [piece.span.source for piece in pieces if piece.span.kind == "sign" and piece.span.source is not None]


def _extract_transition(pieces: list[Piece], seam: int) -> NDArray[np.float64]:
    """Returns the rotations of the frames after sign number ``seam`` and before the next."""
    signs = [k for k, piece in enumerate(pieces) if piece.span.kind == "sign"]
    rotations = [piece.clip.local_rotations for piece in pieces[signs[seam] + 1 : signs[seam + 1]]]
    return np.concatenate(rotations) if rotations else np.empty(0)


def main() -> None:
    """Prints the table's rows."""
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
