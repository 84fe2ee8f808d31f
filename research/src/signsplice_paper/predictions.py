"""A system's predictions as a folder of arrays, in the form that ``research/benchmark/score.py`` reads."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from signsplice.formats.atomic import replacing_folder
from signsplice_paper.protocol import Answer, Protocol


def write(answer: Answer, protocol: Protocol, folder: Path, progress: Callable[[int, int], None] | None = None) -> None:
    """Write splices.npy (n, 5), pair, pre, post, first frame and number of frames, -1 for a position that is missing,
    and frames.npy (F, K), of every pair of a protocol.
    """
    splices, frames, first = [], [], 0
    for done, number in enumerate(protocol.numbers, 1):
        made = answer(number)
        ends = (-1 if position is None else position for position in (made.pre, made.post))
        splices.append((number, *ends, first, len(made.frames)))
        frames.append(made.frames)
        first += len(made.frames)
        if progress is not None:
            progress(done, len(protocol.numbers))
    with replacing_folder(folder) as part:
        np.save(part / "splices.npy", np.array(splices, np.int64))
        np.save(part / "frames.npy", np.concatenate(frames).astype(np.float32))
