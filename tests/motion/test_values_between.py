"""motion.curves: values at some frames, and in straight lines between them."""

from __future__ import annotations

import numpy as np
import pytest

from signsplice.motion.curves import between, sparse


@pytest.mark.parametrize(
    ("n_frames", "apart", "step"), [(1, 2.0, 2), (2, 2.0, 2), (4, 2.0, 2), (9, 4.0, 4), (9, 0.7, 1)]
)
def test_straight_lines_between_some_frames(n_frames: int, apart: float, step: int) -> None:
    frames = sparse(n_frames, apart)
    line = np.arange(n_frames)[:, None] * [1.0, -2.0]
    assert set(range(0, n_frames, step)) | {n_frames - 1} == set(frames.tolist())
    assert between(line[frames], frames) == pytest.approx(line)
