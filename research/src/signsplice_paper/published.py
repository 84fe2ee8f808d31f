"""The paper's results as printed: tables 1 and 3, the accuracy, error and time stated in its text, and the names and
conditions of all systems.
"""

from __future__ import annotations

METRICS = ("BLEU-1", "BLEU-2", "BLEU-3", "BLEU-4", "PTA", "PAA")
SCORES = {
    "BLEU-1": "bleu-1",
    "BLEU-2": "bleu-2",
    "BLEU-3": "bleu-3",
    "BLEU-4": "bleu-4",
    "PTA": "pta",
    "PAA": "paa",
}
"""The paper's metrics -> names of scores here. BLEU is the paper's own. PAA is over pairs with both tokens, the only
reading that allows ConvS2S's 0.999.
"""

PRINTED = "lptransformer-printed"
"""LpTransformer by its equations and its loss."""
LPTRANSFORMER = "lptransformer"
"""The same networks in the same treatment as their rivals."""
LPT_PLUS = "lpt-plus"
"""SPSN word by word, with the paper's TFGN."""

AS_PRINTED, EQUAL = "as printed", "equal treatment"
"""Conditions: plain cross-entropy of the tokens, and no token if "none" wins; or the weighted loss, and a bias of the
tokens that is chosen on validation pairs."""
CONDITIONS = {
    "conv-s2s": {AS_PRINTED: "conv-s2s-printed", EQUAL: "conv-s2s"},
    "lstm": {AS_PRINTED: "lstm-printed", EQUAL: "lstm"},
    "transformer": {AS_PRINTED: "transformer-printed", EQUAL: "transformer"},
    PRINTED: {AS_PRINTED: PRINTED, EQUAL: LPTRANSFORMER},
}
"""The paper's four systems, by condition."""

TABLE_1 = {
    "conv-s2s": ("0.744", "0.649", "0.599", "0.563", "0.251", "0.999"),
    "lstm": ("0.881", "0.771", "0.677", "0.610", "0.999", "0.784"),
    "transformer": ("0.735", "0.652", "0.615", "0.615", "0.996", "0.601"),
    PRINTED: ("0.894", "0.869", "0.848", "0.824", "0.999", "0.999"),
}
TABLE_3 = {
    "lptransformer-wa": ("0.854", "0.785", "0.731", "0.704", "0.999", "0.829"),
    "lptransformer-wc": ("0.823", "0.774", "0.697", "0.642", "0.999", "0.999"),
    "lptransformer-wac": ("0.844", "0.733", "0.688", "0.621", "0.984", "0.801"),
}

NAMES = {
    "conv-s2s": "ConvS2S",
    "lstm": "LSTM",
    "transformer": "Transformer",
    PRINTED: "LpTransformer",
    "lptransformer-wa": "LPT-WA",
    "lptransformer-wc": "LPT-WC",
    "lptransformer-wac": "LPT-WAC",
    LPTRANSFORMER: "LpTransformer",
    LPT_PLUS: "LPT+",
    "conv-s2s-printed": "ConvS2S",
    "lstm-printed": "LSTM",
    "transformer-printed": "Transformer",
    "mean-transition": "mean transition",
}
RIVALS = ("conv-s2s", "lstm", "transformer")
ABLATIONS = ("lptransformer-wa", "lptransformer-wc", "lptransformer-wac")

ACCURACY = 0.99
MSE = 0.0015
BEST_FR = 8


def get_display_name(system: str) -> str:
    """Returns a system's name in tables and figures."""
    return NAMES.get(system, system)
