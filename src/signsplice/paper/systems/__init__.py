"""The paper's systems as they run: exported graphs, numpy and onnxruntime, no torch."""

from __future__ import annotations

from pathlib import Path

from signsplice.errors import InputError
from signsplice.paper.systems.splicers import DECODINGS, OneNetworkSystem, PaperSystem, TwoNetworkSystem
from signsplice.splicing.bundle import read_facts
from signsplice.splicing.sessions import Sessions

__all__ = ["DECODINGS", "OneNetworkSystem", "TwoNetworkSystem", "PaperSystem", "open_bundle"]


def open_bundle(folder: str | Path, decoding: str = "one-by-one") -> PaperSystem:
    """The trained system in a folder; its graphs are read and checked when first used.

    decoding: "one-by-one" feeds every frame back, with a cache; "without-cache" reads all frames so far for each new
    one, to the same end; "parallel" makes all frames in one pass, where the network can.

    Raises ``InputError`` for a folder that holds no bundle, or a decoding that its network does not have.
    """
    folder = Path(folder)
    facts = read_facts(folder)
    try:
        runs = facts["runs"]
        if decoding not in DECODINGS:
            raise InputError(f"decoding {decoding!r}, expected one of {', '.join(DECODINGS)}")
        if decoding == "parallel" and not runs["concurrent"]:
            raise InputError(f"{folder}: {facts['system']} makes its frames one by one; it has no parallel decoding")
        kind = OneNetworkSystem if runs["positions"] == "encoder" else TwoNetworkSystem
        return kind(facts["system"], facts, Sessions(folder, facts), decoding)
    except KeyError as error:
        raise InputError(f"{folder}: bundle.json has no {error.args[0]!r}; export the system anew") from None
