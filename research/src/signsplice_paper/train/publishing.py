"""Trained systems made small and put beside the tables, with a page that lists them."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path

from signsplice.errors import InputError
from signsplice.formats.atomic import replacing
from signsplice_paper import protocol, published_bundles
from signsplice_paper.configs import read_config
from signsplice_paper.systems import open_bundle
from signsplice_workshop.corpora.pairs import Pairs
from signsplice_workshop.train.export import halve_bundle


def publish(sources: Sequence[Path], out: Path, pairs: Pairs, n_pairs: int) -> list[str]:
    """Write each bundle, its weights in 16 bits, into a folder of its name in ``out``, and the page about all bundles
    there; a line about each.

    Both forms are given ``n_pairs`` test pairs, and bundle.json tells how far they agree. Raises ``InputError`` for
    what is no bundle of the paper's systems, or learned from another corpus.
    """
    lines = []
    for source in sources:
        config = read_config(source)
        config.require("system", "runs", "fr", "split", "corpus")
        if not config.path.parent.name:
            raise InputError(f"{source}: has no name of its own; name the folder")
        judged = protocol.choose(pairs, str(config.split), limit=n_pairs)
        with tempfile.TemporaryDirectory(prefix="signsplice-publish-") as folder:
            halve_bundle(source, Path(folder) / "halved")
            half = open_bundle(Path(folder) / "halved")
            agrees = published_bundles.agreement(open_bundle(source), half, pairs, judged.numbers)
        target = out / config.path.parent.resolve().name
        halve_bundle(source, target, published_bundles.described(agrees))
        lines.append(
            f"{target}: of {agrees.pairs} pairs {agrees.positions} have the same positions, {agrees.lengths} also the "
            f"same length, numbers within {agrees.largest_difference:.1g}"
        )
    text = published_bundles.page(out)
    with replacing(out / published_bundles.PAGE) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return lines
