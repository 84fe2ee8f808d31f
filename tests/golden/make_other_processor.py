"""Writes other_processor.npz: the frames of spliced pairs of words, made on another kind of processor than the tests'.

    python tests/golden/make_other_processor.py

It was run by Python 3.11 for aarch64 on an emulated Neoverse N1 (qemu-aarch64): numpy 2.4.6, onnxruntime 1.32.0.
The networks are those of tiny_int8, which is tiny_bundle after `signsplice export --int8`, so that the file outlives
the networks that ship.
"""

from __future__ import annotations

import platform
from pathlib import Path

import numpy as np

import signsplice as ss
from signsplice.lexicon import shipped

HERE = Path(__file__).parent
PAIRS = (("HELLO", "DEAF"), ("BOOK", "MOTHER"), ("THANK-YOU", "I"), ("SIGN", "YES"))


def spliced(pair: tuple[str, str]) -> ss.SpliceResult:
    """Two words that ship, joined by the networks of tiny_int8."""
    with shipped() as words:
        options = ss.SpliceOptions(bundle=HERE / "tiny_int8")
        return ss.splice([words.clip(gloss) for gloss in pair], options)


def main() -> None:
    """Write the file."""
    stored: dict[str, np.ndarray] = {"machine": np.array(platform.machine())}
    for n, pair in enumerate(PAIRS):
        result = spliced(pair)
        spans = np.array([span.output for span in result.spans])
        stored[f"spans_{n}"] = spans
        stored[f"rotations_{n}"] = result.clip.local_rotations[slice(*spans[1])].astype(np.float32)
    np.savez_compressed(HERE / "other_processor.npz", **stored)


if __name__ == "__main__":
    main()
