"""Another kind of processor makes the same sentences: it rounds otherwise, and no more."""

from __future__ import annotations

import numpy as np
import pytest

from golden.make_other_processor import HERE, PAIRS, spliced
from signsplice.motion import rotation
from signsplice.splicing.methods import WEIGHTS


@pytest.mark.parametrize("n", range(len(PAIRS)), ids=["-".join(pair) for pair in PAIRS])
def test_new_frames_are_within_a_twentieth_of_a_degree(n: int) -> None:
    expected = np.load(HERE / "other_processor.npz")
    result = spliced(PAIRS[n])
    spans = [span.output for span in result.spans]
    assert [list(span) for span in spans] == expected[f"spans_{n}"].tolist()
    found = result.clip.local_rotations[slice(*spans[1])]
    assert np.degrees(rotation.angle_between(found, expected[f"rotations_{n}"]).max()) < 0.05


def test_networks_that_ship_multiply_in_32_bits() -> None:
    for path in WEIGHTS.glob("*.onnx"):
        content = path.read_bytes()
        assert b"MatMulInteger" not in content, path.name
        assert b"DynamicQuantizeLinear" not in content, path.name
