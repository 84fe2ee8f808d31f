"""Writes a system's predictions as a folder of arrays, in the form that ``research/benchmark/score.py`` reads."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from signsplice.formats.atomic import replacing_folder
from signsplice_paper.protocol import Answer, Protocol


def write(answer: Answer, protocol: Protocol, folder: Path, progress: Callable[[int, int], None] | None = None) -> None:
    """Writes the predictions for every pair of a protocol: splices.npy (n, 5) with pair, pre, post, first frame and
    number of frames, -1 for a missing position; and frames.npy (F, K).
    """
    splices, frames, first = [], [], 0
    for done, number in enumerate(protocol.pair_numbers, 1):
        prediction = answer(number)
        ends = (-1 if position is None else position for position in (prediction.pre, prediction.post))
        splices.append((number, *ends, first, len(prediction.frames)))
        frames.append(prediction.frames)
        first += len(prediction.frames)
        if progress is not None:
            progress(done, len(protocol.pair_numbers))
    with replacing_folder(folder) as temporary:
        np.save(temporary / "splices.npy", np.array(splices, np.int64))
        np.save(temporary / "frames.npy", np.concatenate(frames).astype(np.float32))
