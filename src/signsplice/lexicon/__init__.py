"""Lexicons: gloss -> clip. Built once from clips, opened in milliseconds; one ships with the package.

Names are imported on first use, since a splice needs only the module ``gloss``.
"""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from signsplice.lexicon.builder import Builder, building
    from signsplice.lexicon.folder import build
    from signsplice.lexicon.gloss import Entry
    from signsplice.lexicon.lexicon import Lexicon, open_lexicon, open_shipped_lexicon

    open = open_lexicon

_HOMES = {
    "builder": ("Builder", "building"),
    "folder": ("build",),
    "gloss": ("Entry",),
    "lexicon": ("Lexicon", "open_lexicon", "open_shipped_lexicon"),
}

__all__ = ["Builder", "Entry", "Lexicon", "build", "building", "open", "open_lexicon", "open_shipped_lexicon"]


def __getattr__(name: str) -> object:
    from importlib import import_module

    target = "open_lexicon" if name == "open" else name
    for home, names in _HOMES.items():
        if target in names:
            value = globals()[name] = getattr(import_module(f"{__name__}.{home}"), target)
            return value
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
