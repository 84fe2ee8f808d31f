"""Random draws that give every folder of training data the same probability, and every signer of a folder too."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from pathlib import Path
from typing import TypeVar

import numpy as np

T = TypeVar("T")


def group_by_folder(paths: Sequence[Path]) -> list[list[Path]]:
    """Paths in their order, consecutive ones of the same folder in one list."""
    return [list(folder) for _, folder in groupby(paths, key=lambda path: path.parent)]


def draw_from_folders(folders: Sequence[Sequence[T]], rng: np.random.Generator) -> T:
    """One entry of one of the folders, whatever their sizes."""
    folder = folders[int(rng.integers(len(folders))) if len(folders) > 1 else 0]
    return folder[int(rng.integers(len(folder)))]
