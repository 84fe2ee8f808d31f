"""Files <-> clips, one module a format; ``load`` and ``save`` choose by suffix."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from signsplice.errors import InputError
from signsplice.formats import bvh, npz
from signsplice.motion.clip import Clip


def _read_gltf(path: str | Path) -> Clip:
    from signsplice.formats import gltf_reader

    return gltf_reader.read(path)


def _parse_gltf(content: bytes, file: str) -> Clip:
    from signsplice.formats import gltf_reader

    return gltf_reader.parse(content, file)


def _parse_bvh(content: bytes, file: str) -> Clip:
    return bvh.parse(content, file, Path(file).stem)


def _write_glb(clip: Clip, path: str | Path) -> None:
    from signsplice.formats import gltf

    gltf.write(clip, path)


def _write_vrma(clip: Clip, path: str | Path) -> None:
    from signsplice.formats import gltf

    gltf.write_vrma(clip, path)


_READERS: dict[str, Callable[[str | Path], Clip]] = {
    ".bvh": bvh.read,
    ".npz": npz.read,
    **dict.fromkeys((".glb", ".gltf", ".vrma"), _read_gltf),
}
_WRITERS: dict[str, Callable[[Clip, str | Path], None]] = {
    ".bvh": bvh.write,
    ".npz": npz.write,
    ".glb": _write_glb,
    ".vrma": _write_vrma,
}
SUFFIXES = tuple(_READERS)
"""What ``load`` reads."""
_PARSERS: dict[str, Callable[[bytes, str], Clip]] = {
    ".bvh": _parse_bvh,
    **dict.fromkeys((".glb", ".vrma"), _parse_gltf),
}
_PLANNED = {".pose": "landmark"}


def load(path: str | Path) -> Clip:
    """The clip in a file, by its suffix (.bvh, .npz, .glb, .gltf, .vrma). Raises ``InputError`` for a suffix or a
    file that cannot be read.
    """
    return _READERS[_suffix(path, "read", _READERS)](path)


def parse(content: bytes, file: str) -> Clip:
    """The clip that the bytes of a file hold, by the suffix of its name (.bvh, .glb, .vrma), named after it; for what
    comes over a wire: no file is opened, whatever the bytes ask for. Raises as ``load`` does.
    """
    return _PARSERS[_suffix(file, "taken", _PARSERS)](content, file)


def save(clip: Clip, path: str | Path) -> None:
    """Write a clip to a file by its suffix (.bvh, .npz, .glb, .vrma), whole or not at all. Raises ``InputError`` where
    that cannot be.
    """
    _WRITERS[_suffix(path, "written", _WRITERS)](clip, path)


def check_suffix(path: str | Path) -> None:
    """Raise ``InputError`` where ``save`` would refuse a path for its suffix."""
    _suffix(path, "written", _WRITERS)


def _suffix(path: str | Path, done: str, known: Mapping[str, object]) -> str:
    suffix = Path(path).suffix.lower()
    expected = f"expected {', '.join(list(known)[:-1])} or {list(known)[-1]}"
    if suffix in _PLANNED:
        raise InputError(f"{path}: {_PLANNED[suffix]} files cannot be {done} yet, {expected}")
    if suffix not in known:
        raise InputError(f"{path}: a file with suffix {suffix or '(none)'} cannot be {done}, {expected}")
    return suffix
