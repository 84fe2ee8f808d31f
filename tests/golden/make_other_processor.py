"""Writes other_processor.npz: the frames of spliced pairs of words, made on another kind of processor than the tests'.

    python tests/golden/make_other_processor.py

It was run by Python 3.11 for aarch64 on an emulated Neoverse N1 (qemu-aarch64): numpy 2.4.6, onnxruntime 1.32.0.
Debian's arm64 packages of Python and its libraries, unpacked into one folder, are qemu's root (-L); onnxruntime needs a
file proc/cpuinfo of such a processor in it. The networks are those of tiny_int8, so that the file outlives the networks
that ship.
"""

from __future__ import annotations

import platform
import sys
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent / "splicing"))

from processor_pairs import PAIRS, spliced  # noqa: E402


def main() -> None:
    """Write the file."""
    stored: dict[str, np.ndarray] = {"machine": np.array(platform.machine())}
    for n, pair in enumerate(PAIRS):
        result = spliced(pair)
        spans = np.array([span.output for span in result.spans])
        stored[f"spans_{n}"] = spans
        stored[f"rotations_{n}"] = result.clip.local_rotations[slice(*spans[1])].astype(np.float32)
    np.savez_compressed(HERE / "other_processor.npz", **stored)  # type: ignore[arg-type]


if __name__ == "__main__":
    main()
