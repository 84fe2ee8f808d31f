"""NumPy arrays (``.npy``): a row of numbers a frame, as Motion-X and other data sets store SMPL-X poses."""

from __future__ import annotations

from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray

from signsplice.formats import smplx
from signsplice.formats.npz import check_array
from signsplice.formats.reading import ReadLimits
from signsplice.motion import Clip


def parse(content: bytes, file: str, limits: ReadLimits) -> Clip:
    """Parse an array of one of the layouts of ``smplx.unpack`` into a clip. Raises ``InputError`` for any other."""
    return smplx.build_clip(parse_arrays(content, file, limits), file, limits, len(content))


def parse_arrays(content: bytes, file: str, limits: ReadLimits) -> dict[str, NDArray[Any]]:
    """Parse an array of floats, by the name ``smplx.PACKED``. Raises ``InputError`` for any other."""
    check_array(BytesIO(content), len(content), "the array")
    return {smplx.PACKED: np.load(BytesIO(content), allow_pickle=False)}
