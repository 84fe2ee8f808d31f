"""The paper's systems as exported graphs: numpy and onnxruntime, no torch."""

from __future__ import annotations

from pathlib import Path

from signsplice.errors import InputError
from signsplice.splicing.bundle import Sessions
from signsplice_paper.configs import read_config
from signsplice_paper.systems.splicers import DECODINGS, OneNetworkSystem, PaperSystem, TwoNetworkSystem

__all__ = ["DECODINGS", "OneNetworkSystem", "PaperSystem", "TwoNetworkSystem", "open_bundle"]


def open_bundle(folder: str | Path, decoding: str | None = None) -> PaperSystem:
    """Returns the trained system in a folder. Its graphs are read and checked on first use.

    decoding: "parallel" makes all frames in one pass, if the network can; "one-by-one" feeds every frame back, with a
    cache; "without-cache" reads all earlier frames again for each new one, with the same result. None: one pass if the
    network can, else one by one.

    Raises ``InputError`` for a folder without a bundle, for a bundle whose frames are made by no generator, and for a
    decoding that the network does not have.
    """
    folder = Path(folder)
    config = read_config(folder)
    config.require("system", "runs", "fr")
    if decoding not in (None, *DECODINGS):
        raise InputError(f"decoding {decoding!r}, expected one of {', '.join(DECODINGS)}")
    if config.runs is not None and config.runs.frames != "generator":
        raise InputError(f"{folder}: {config.system} makes its frames by {config.runs.frames!r}, expected 'generator'")
    if config.runs is None or (decoding == "parallel" and not config.runs.concurrent):
        raise InputError(f"{folder}: {config.system} makes its frames one by one; it has no parallel decoding")
    if decoding is None:
        decoding = "parallel" if config.runs.concurrent else "one-by-one"
    system_class = OneNetworkSystem if config.runs.positions == "encoder" else TwoNetworkSystem
    return system_class(config, config.runs, Sessions(folder, config), decoding)
