"""How figures show each system: one colour and one marker in all of them.

The colours are those of Okabe and Ito (2008), which colour-blind people tell apart; markers differ as well.
"""

from __future__ import annotations

from dataclasses import dataclass

COMPARED = ("conv-s2s", "lstm", "transformer", "lptransformer", "lpt-plus")
"""The systems of the paper's comparison, and LPT+."""
ABLATIONS = ("lptransformer-wa", "lptransformer-wc", "lptransformer-wac", "lptransformer")
"""The systems of the paper's second experiment."""
SEEN = ("lstm", "transformer", "lptransformer", "lpt-plus")
"""The systems of the pictures; the paper leaves ConvS2S out because of its low scores."""


@dataclass(frozen=True)
class Style:
    """How a system is drawn.

    - colour: of line and marker
    - marker: of points
    """

    colour: str
    marker: str


STYLES = {
    "conv-s2s": Style("#e69f00", "v"),
    "lstm": Style("#cc79a7", "^"),
    "transformer": Style("#009e73", "s"),
    "lptransformer": Style("#0072b2", "o"),
    "lpt-plus": Style("#d55e00", "D"),
    "lptransformer-wa": Style("#56b4e9", "P"),
    "lptransformer-wc": Style("#8a7a00", "X"),
    "lptransformer-wac": Style("#6b6b6b", "p"),
}


def get_style(system: str) -> Style:
    """Returns a system's style; black for a system of no figure."""
    return STYLES.get(system, Style("#000000", "."))


def make_plot_options(system: str) -> dict[str, object]:
    """Returns the options of a system's line."""
    system_style = get_style(system)
    return {"color": system_style.colour, "marker": system_style.marker, "ls": "-", "mfc": system_style.colour}
