"""The paper's results as printed: tables 1 to 3, the accuracy, error and time stated in its text, and the names of all
systems.
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

PRINTED = "lpt-printed"
"""The system that follows the print; it alone bears the paper's name."""
IMPROVED = "lpt"

TABLE_1 = {
    "conv-s2s": ("0.744", "0.649", "0.599", "0.563", "0.251", "0.999"),
    "lstm": ("0.881", "0.771", "0.677", "0.610", "0.999", "0.784"),
    "transformer": ("0.735", "0.652", "0.615", "0.615", "0.996", "0.601"),
    PRINTED: ("0.894", "0.869", "0.848", "0.824", "0.999", "0.999"),
}
TABLE_2 = {
    "lpt-printed-wa": (False, True),
    "lpt-printed-wc": (True, False),
    "lpt-printed-wac": (False, False),
    PRINTED: (True, True),
}
"""Whether SPSN has attention, and TFGN Culling."""
TABLE_3 = {
    "lpt-printed-wa": ("0.854", "0.785", "0.731", "0.704", "0.999", "0.829"),
    "lpt-printed-wc": ("0.823", "0.774", "0.697", "0.642", "0.999", "0.999"),
    "lpt-printed-wac": ("0.844", "0.733", "0.688", "0.621", "0.984", "0.801"),
    PRINTED: ("0.894", "0.869", "0.848", "0.824", "0.999", "0.999"),
}

NAMES = {
    "conv-s2s": "ConvS2S",
    "lstm": "LSTM",
    "transformer": "Transformer",
    PRINTED: "LpTransformer",
    "lpt-printed-wa": "LPT-WA",
    "lpt-printed-wc": "LPT-WC",
    "lpt-printed-wac": "LPT-WAC",
    IMPROVED: "LPT+",
    "lpt-words": "LPT+ word by word",
    "lpt-wa": "LPT+-WA",
    "lpt-wc": "LPT+-WC",
    "lpt-wac": "LPT+-WAC",
    "lpt-eq7": "LPT+, eq. 7 as printed",
    "lpt-frames": "LPT+, frames alone as input",
    "lpt-no-summary": "LPT+, no summary",
    "lpt-plain-loss": "LPT+, plain cross-entropy",
    "lpt-printed-one-pass": "LpTransformer in one pass",
    "lpt-one-pass": "LPT+ in one pass",
    "transformer-one-pass": "Transformer in one pass",
    "progressive-transformer": "Progressive Transformer",
    "mixture-density": "Mixture density",
    "skeletal-attention": "Skeletal attention",
    "cam-stitch": "CAM-STITCH LSTM",
    "nat": "NAT",
    "conv-interp": "Convolutional interpolation",
    "lpt-printed-equal": "LpTransformer, equal treatment",
    "conv-s2s-plain": "ConvS2S as printed",
    "lstm-plain": "LSTM as printed",
    "transformer-plain": "Transformer as printed",
    "mean-transition": "mean transition",
}
RIVALS = ("conv-s2s", "lstm", "transformer")
ABLATIONS = ("lpt-printed-wa", "lpt-printed-wc", "lpt-printed-wac")
IMPROVED_ABLATIONS = ("lpt-wa", "lpt-wc", "lpt-wac")
TAKEN_AWAY = ("lpt-eq7", "lpt-frames", "lpt-no-summary", "lpt-plain-loss")
"""LPT+ with one addition taken away."""
RELATED = ("progressive-transformer", "mixture-density", "skeletal-attention", "nat", "conv-interp", "cam-stitch")
"""Systems of the paper's related work, behind the same positions. These, ``IMPROVED_ABLATIONS`` and ``TAKEN_AWAY`` are
known by their rows alone: nothing trains them.
"""
IN_ONE_PASS = {PRINTED: "lpt-printed-one-pass", IMPROVED: "lpt-one-pass", "transformer": "transformer-one-pass"}
"""Systems that are judged a second time, with all frames made in one pass."""

ACCURACY = 0.99
MSE = 0.0015
VISIBLE = 0.002
BEST_FR = 8

AS_PRINTED, BIAS_ALONE, EQUAL = "as printed", "bias alone", "equal treatment"
"""What a system's tokens are given: plain loss and no bias; plain loss and the bias; weighted loss and the bias."""
TREATED = {
    "conv-s2s": {AS_PRINTED: "conv-s2s-plain", BIAS_ALONE: "conv-s2s-plain-bias", EQUAL: "conv-s2s"},
    "lstm": {AS_PRINTED: "lstm-plain", BIAS_ALONE: "lstm-plain-bias", EQUAL: "lstm"},
    "transformer": {AS_PRINTED: "transformer-plain", BIAS_ALONE: "transformer-plain-bias", EQUAL: "transformer"},
    PRINTED: {AS_PRINTED: PRINTED, BIAS_ALONE: "lpt-printed-bias", EQUAL: "lpt-printed-equal"},
}
"""The paper's four systems, by treatment."""
WITH_BIAS = {
    system: f"{system}-bias" for system in (PRINTED, *ABLATIONS, "conv-s2s-plain", "lstm-plain", "transformer-plain")
}
"""Systems without a bias, which are judged a second time with one."""
NAMES |= {biased: f"{NAMES[system]}, with a bias" for system, biased in WITH_BIAS.items()}


def name(system: str) -> str:
    """A system's name in tables and figures."""
    return NAMES.get(system, system)
