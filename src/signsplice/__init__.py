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
    from signsplice.written.signing import sign

_HOMES = {
    "body.retarget": ("retarget",),
    "errors": ("FormatError", "InputError", "RigMismatchError", "SignspliceError"),
    "formats": ("load", "save"),
    "formats.avatar": ("read_avatar",),
    "lexicon.reader": ("Lexicon",),
    "motion.clip": ("Clip", "Skeleton"),
    "splicing.engine": ("Piece", "SpliceOptions", "SpliceResult", "splice", "stream"),
    "splicing.forms": ("open_lexicon",),
    "splicing.inbetween": ("inbetween",),
    "written.signing": ("sign",),
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
    "sign",
    "splice",
    "stream",
]


def __getattr__(name: str) -> object:
    from importlib import import_module

    for home, names in _HOMES.items():
        if name in names:
            value = globals()[name] = getattr(import_module(f"{__name__}.{home}"), name)
            return value
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)


def _notebook_html(clip: "Clip") -> str:
    from signsplice.render.notebook import html

    return html(clip)


html_renderers.append(_notebook_html)
