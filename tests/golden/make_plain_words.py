"""Makes plain_words.npz: words of the first signer there was, before signers had a manner.

Run at commit c5abc78a, and again when hands began to keep out of the other arm, which moved TURNS and CUTS, as
``python tests/golden/make_plain_words.py``; the file shows whether a signer with a plain manner still moves in the
same way. Arrays: the first 63 numbers (T, 63) of every word's states, and its events, by the word's gloss and the
signer's seed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from signsplice.signer import notation, planner
from signsplice.signer.signer import PLAIN, Signer, draw_signer

HERE = Path(__file__).parent
SEED = 3
SIGNS = """
TAPS hands=one
  source: touches twice, then is held
  X  shape=5 at=chin by=thumb off=4 palm=in fingers=up-up-in
  M  off=0 times=2
  H
TURNS hands=alternating
  source: two revolutions and a local movement
  H  shape=index at=space-mid shift=0,6,0 palm=in fingers=fwd-up
  M  path=circle:sagittal:5:2
  M  shape=5 local=wiggle path=arc:up:4
CUTS hands=base
  source: a base hand, an arc, a zigzag
  X  shape=B at=base-palm by=ulnar off=3 palm=in fingers=fwd-up w.shape=B w.at=space-low-mid w.palm=up w.fingers=in-fwd
  M  off=0 path=arc:up:5
  M  at=space shift=0,6,0 path=zigzag:up:3:2 head=nod
  H
"""


def words(signer: Callable[[int], Signer] = draw_signer) -> dict[str, NDArray[np.float64]]:
    """Name -> array; ``signer`` makes a signer of a seed."""
    arrays = {}
    for gloss, sign in notation.parse(SIGNS).items():
        word = planner.synthesize_word(sign, signer(SEED))
        e = word.events
        arrays[f"{gloss} states"] = word.states[::4, :63].round(12)
        spans = np.array([*([e.first] if e.first else []), *e.passes], np.float64)
        arrays[f"{gloss} events"] = np.concatenate([[len(word), e.up, e.start, e.end, e.down], spans.ravel()])
    return arrays


def main() -> None:
    """Write the file."""
    plain = words(lambda seed: replace(draw_signer(seed), manner=PLAIN))
    np.savez_compressed(HERE / "plain_words.npz", allow_pickle=False, **plain)


if __name__ == "__main__":
    main()
