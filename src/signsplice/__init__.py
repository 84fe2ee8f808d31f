"""signsplice: joins mocap clips of sign-language words into fluent sentences.

The names below are all that most users need; each is imported when first used, so that ``import signsplice`` costs
nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from signsplice.errors import FormatError, InputError, RigMismatchError, SignspliceError
    from signsplice.formats import load, save
    from signsplice.motion.clip import Clip, Skeleton
    from signsplice.splicing.engine import Piece, SpliceOptions, SpliceResult, inbetween, splice, stream

_HOMES = {
    "Clip": "motion.clip",
    "FormatError": "errors",
    "InputError": "errors",
    "Piece": "splicing.engine",
    "RigMismatchError": "errors",
    "SignspliceError": "errors",
    "Skeleton": "motion.clip",
    "SpliceOptions": "splicing.engine",
    "SpliceResult": "splicing.engine",
    "inbetween": "splicing.engine",
    "load": "formats",
    "save": "formats",
    "splice": "splicing.engine",
    "stream": "splicing.engine",
}

__all__ = [
    "Clip",
    "FormatError",
    "InputError",
    "Piece",
    "RigMismatchError",
    "SignspliceError",
    "Skeleton",
    "SpliceOptions",
    "SpliceResult",
    "inbetween",
    "load",
    "save",
    "splice",
    "stream",
]


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
