"""signsplice: joins mocap clips of sign-language words into fluent sentences.

Most users need only the names below. Each is imported on first use, so that ``import signsplice`` is cheap.
"""

from signsplice.hooks import html_renderers

TYPE_CHECKING = False  # typing.TYPE_CHECKING needs an import, in which an interrupt would show a traceback
if TYPE_CHECKING:
    from signsplice.body.retarget import retarget
    from signsplice.errors import FormatError, InputError, RigMismatchError, SignspliceError
    from signsplice.formats import load, save
    from signsplice.formats.avatar import read_avatar
    from signsplice.lexicon.lexicon import Lexicon, open_lexicon
    from signsplice.lexicon.sentence import parse
    from signsplice.motion import Clip, Skeleton, concatenate
    from signsplice.render.film import write_pictures
    from signsplice.splicing.contracts import Cut, Cutter, Transition
    from signsplice.splicing.curves import CurveProblem, CurveTransition
    from signsplice.splicing.engine import Piece, SpliceOptions, SpliceResult, Stream, inbetween, splice, stream
    from signsplice.splicing.report import write_report
    from signsplice.splicing.stitch import stitch
    from signsplice.splicing.word import Word, words_of
    from signsplice.written.signing import sign

_HOMES = {
    "body.retarget": ("retarget",),
    "errors": ("FormatError", "InputError", "RigMismatchError", "SignspliceError"),
    "formats": ("load", "save"),
    "formats.avatar": ("read_avatar",),
    "lexicon.lexicon": ("Lexicon", "open_lexicon"),
    "lexicon.sentence": ("parse",),
    "motion.clip": ("Clip", "Skeleton", "concatenate"),
    "render.film": ("write_pictures",),
    "splicing.contracts": ("Cut", "Cutter", "Transition"),
    "splicing.curves": ("CurveProblem", "CurveTransition"),
    "splicing.engine": ("Piece", "SpliceOptions", "SpliceResult", "Stream", "inbetween", "splice", "stream"),
    "splicing.report": ("write_report",),
    "splicing.stitch": ("stitch",),
    "splicing.word": ("Word", "words_of"),
    "written.signing": ("sign",),
}

__all__ = [
    "Clip",
    "CurveProblem",
    "CurveTransition",
    "Cut",
    "Cutter",
    "FormatError",
    "InputError",
    "Lexicon",
    "Piece",
    "RigMismatchError",
    "SignspliceError",
    "Skeleton",
    "SpliceOptions",
    "SpliceResult",
    "Stream",
    "Transition",
    "Word",
    "concatenate",
    "inbetween",
    "load",
    "open_lexicon",
    "parse",
    "read_avatar",
    "retarget",
    "save",
    "sign",
    "splice",
    "stitch",
    "stream",
    "words_of",
    "write_pictures",
    "write_report",
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
