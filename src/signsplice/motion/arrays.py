"""The array types that all rooms share."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
"""An array of 64-bit numbers; its docstring or comment gives the shape."""
