"""Another kind of processor makes the same sentences: it rounds otherwise, and no more."""

from __future__ import annotations

import hashlib
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from processor_pairs import BUNDLE, PAIRS, spliced

from signsplice.errors import FormatError
from signsplice.motion import rotation
from signsplice.splicing.bundle import multiplies_in_8_bits
from signsplice.splicing.learned import open_sessions
from signsplice.splicing.options import WEIGHTS


@pytest.mark.parametrize("n", range(len(PAIRS)), ids=["-".join(pair) for pair in PAIRS])
def test_new_frames_are_the_same_within_a_hundredth_of_a_degree(n: int) -> None:
    """They differ by 0.001 degrees at most."""
    expected = np.load(BUNDLE.with_name("other_processor.npz"))
    result = spliced(PAIRS[n])
    spans = [span.output for span in result.spans]
    assert [list(span) for span in spans] == expected[f"spans_{n}"].tolist()
    found = result.clip.local_rotations[slice(*spans[1])]
    assert np.degrees(rotation.angle_between(found, expected[f"rotations_{n}"]).max()) < 0.01


def test_networks_that_ship_multiply_in_32_bits() -> None:
    assert not any(multiplies_in_8_bits(path.read_bytes()) for path in WEIGHTS.glob("*.onnx"))


def test_a_network_that_multiplies_in_8_bits_is_refused_with_what_to_do(tmp_path: Path) -> None:
    bundle = Path(shutil.copytree(BUNDLE, tmp_path / "old"))
    stored = json.loads((bundle / "bundle.json").read_text())
    content = b"...DynamicQuantizeLinear..."
    (bundle / "bridge.onnx").write_bytes(content)
    stored["files"]["bridge.onnx"] = hashlib.sha256(content).hexdigest()
    (bundle / "bundle.json").write_text(json.dumps(stored))
    with pytest.raises(FormatError, match=r"bridge\.onnx: multiplies in 8 bits.*`signsplice export` writes"):
        open_sessions(bundle).run("bridge", {})
