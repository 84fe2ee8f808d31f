"""Which signer a draw is of: folders of signing are drawn from as often, whatever they hold, and so are signers of a
folder.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from pathlib import Path
from typing import TypeVar

import numpy as np

One = TypeVar("One")


def by_folder(paths: Sequence[Path]) -> list[list[Path]]:
    """Paths in order, those of a folder together."""
    return [list(folder) for _, folder in groupby(paths, key=lambda path: path.parent)]


def drawn(folders: Sequence[Sequence[One]], rng: np.random.Generator) -> One:
    """One of one of the folders."""
    folder = folders[int(rng.integers(len(folders))) if len(folders) > 1 else 0]
    return folder[int(rng.integers(len(folder)))]
