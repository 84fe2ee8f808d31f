"""motion.curves: values at some frames, and in straight lines between them."""

from __future__ import annotations

import numpy as np
import pytest

from signsplice.motion.curves import between, every_other


@pytest.mark.parametrize("n_frames", [1, 2, 3, 4, 9])
def test_straight_lines_between_every_other_frame(n_frames: int) -> None:
    frames = every_other(n_frames)
    line = np.arange(n_frames)[:, None] * [1.0, -2.0]
    assert set(range(0, n_frames, 2)) | {n_frames - 1} == set(frames.tolist())
    assert between(line[frames], frames) == pytest.approx(line)
