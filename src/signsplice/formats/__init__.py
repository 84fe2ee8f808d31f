"""Files <-> clips, one module a format; ``load`` and ``save`` choose by suffix."""

from __future__ import annotations

from pathlib import Path

from signsplice.errors import InputError
from signsplice.formats import bvh, npz
from signsplice.motion.clip import Clip

_READERS = {".bvh": bvh.read, ".npz": npz.read}
_WRITERS = {".bvh": bvh.write, ".npz": npz.write}
SUFFIXES = tuple(_READERS)
"""What ``load`` reads."""
_PLANNED = {".glb": "glTF", ".gltf": "glTF", ".vrma": "VRM animation", ".pose": "landmark"}


def load(path: str | Path) -> Clip:
    """The clip in a file, by its suffix (.bvh, .npz). Raises ``InputError`` for a suffix or a file that cannot be
    read.
    """
    return _READERS[_suffix(path, "read")](path)


def save(clip: Clip, path: str | Path) -> None:
    """Write a clip to a file by its suffix (.bvh, .npz), whole or not at all. Raises ``InputError`` where that cannot
    be.
    """
    _WRITERS[_suffix(path, "written")](clip, path)


def check_suffix(path: str | Path) -> None:
    """Raise ``InputError`` where ``save`` would refuse a path for its suffix."""
    _suffix(path, "written")


def _suffix(path: str | Path, done: str) -> str:
    suffix = Path(path).suffix.lower()
    if suffix in _PLANNED:
        raise InputError(f"{path}: {_PLANNED[suffix]} files cannot be {done} yet, expected .bvh or .npz")
    if suffix not in _READERS:
        raise InputError(f"{path}: a file with suffix {suffix or '(none)'} cannot be {done}, expected .bvh or .npz")
    return suffix
