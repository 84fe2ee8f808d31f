"""How figures show each system: one colour and one marker in all of them.

The colours are those of Okabe and Ito (2008), which colour-blind people tell apart; markers and dashes differ as well.
An ablation of LPT+ looks like the same ablation of LpTransformer, with a hollow marker and a dashed line.
"""

from __future__ import annotations

from dataclasses import dataclass

COMPARED = ("conv-s2s", "lstm", "transformer", "lpt-printed", "lpt")
"""The systems of the paper's comparison, and LPT+."""
ABLATIONS = {
    "LpTransformer": ("lpt-printed-wa", "lpt-printed-wc", "lpt-printed-wac", "lpt-printed"),
    "LPT+": ("lpt-wa", "lpt-wc", "lpt-wac", "lpt"),
}
"""The two families of the paper's second experiment: as printed, and improved."""
SEEN = ("lstm", "transformer", "lpt-printed", "lpt")
"""The systems of the pictures; the paper leaves ConvS2S out because of its low scores."""


@dataclass(frozen=True)
class Style:
    """How a system is drawn.

    - colour: of line and marker
    - marker: of points
    - dashed: whether its line is dashed and its marker hollow
    """

    colour: str
    marker: str
    dashed: bool = False


_SKY, _OLIVE, _GREY = "#56b4e9", "#8a7a00", "#6b6b6b"
STYLES = {
    "conv-s2s": Style("#e69f00", "v"),
    "lstm": Style("#cc79a7", "^"),
    "transformer": Style("#009e73", "s"),
    "lpt-printed": Style("#0072b2", "o"),
    "lpt": Style("#d55e00", "D"),
    "lpt-printed-wa": Style(_SKY, "P"),
    "lpt-printed-wc": Style(_OLIVE, "X"),
    "lpt-printed-wac": Style(_GREY, "p"),
    "lpt-wa": Style(_SKY, "P", True),
    "lpt-wc": Style(_OLIVE, "X", True),
    "lpt-wac": Style(_GREY, "p", True),
}
ON_CLIPS = Style("#000000", "*")
CLASSICAL = Style("#000000", "x")


def style(system: str) -> Style:
    """A system's style; one of no figure is black."""
    return STYLES.get(system, Style("#000000", "."))


def plot_options(system: str) -> dict[str, object]:
    """The options of a system's line."""
    of = style(system)
    return {
        "color": of.colour,
        "marker": of.marker,
        "ls": "--" if of.dashed else "-",
        "mfc": "white" if of.dashed else of.colour,
    }
