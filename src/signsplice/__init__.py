"""signsplice: joins mocap clips of sign-language words into fluent sentences.

The names below are all that most users need; each is imported when first used, so that ``import signsplice`` costs
nothing.
"""

from signsplice.motion import html_renderers

TYPE_CHECKING = False  # typing's own costs an import, in which an interrupt would show a traceback
if TYPE_CHECKING:
    from signsplice.body.retarget import retarget
    from signsplice.errors import FormatError, InputError, RigMismatchError, SignspliceError
    from signsplice.formats import load, save
    from signsplice.formats.avatar import read_avatar
    from signsplice.lexicon.reader import Lexicon
    from signsplice.motion.clip import Clip, Skeleton
    from signsplice.splicing.engine import Piece, SpliceOptions, SpliceResult, splice, stream
    from signsplice.splicing.forms import open_lexicon
    from signsplice.splicing.inbetween import inbetween

_HOMES = {
    "Clip": "motion.clip",
    "FormatError": "errors",
    "InputError": "errors",
    "Lexicon": "lexicon.reader",
    "Piece": "splicing.engine",
    "RigMismatchError": "errors",
    "SignspliceError": "errors",
    "Skeleton": "motion.clip",
    "SpliceOptions": "splicing.engine",
    "SpliceResult": "splicing.engine",
    "inbetween": "splicing.inbetween",
    "load": "formats",
    "open_lexicon": "splicing.forms",
    "read_avatar": "formats.avatar",
    "retarget": "body.retarget",
    "save": "formats",
    "splice": "splicing.engine",
    "stream": "splicing.engine",
}

__all__ = [
    "Clip",
    "FormatError",
    "InputError",
    "Lexicon",
    "Piece",
    "RigMismatchError",
    "SignspliceError",
    "Skeleton",
    "SpliceOptions",
    "SpliceResult",
    "inbetween",
    "load",
    "open_lexicon",
    "read_avatar",
    "retarget",
    "save",
    "splice",
    "stream",
]


def __getattr__(name: str) -> object:
    from importlib import import_module

    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)


def _notebook_html(clip: "Clip") -> str:
    from signsplice.service.notebook import html

    return html(clip)


html_renderers.append(_notebook_html)
