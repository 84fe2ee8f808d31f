"""Bundles beside the tables: each opens, is listed, and stands in the results as what it was judged as."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from signsplice.errors import InputError
from signsplice_paper import bundles, published_bundles, results
from signsplice_paper.configs import config_of
from signsplice_paper.prediction import Prediction
from signsplice_paper.systems import open_bundle
from signsplice_workshop.train.bundles import write_bundle
from test_paper_clips import CONFIG
from toys import corpus

RESEARCH = Path(__file__).resolve().parents[1]
BUNDLES, DOCS = RESEARCH / "bundles", RESEARCH / "docs"
MOST_BYTES = 25_000_000


def test_published_bundles_open_and_stand_in_the_results() -> None:
    assert "(../bundles/README.md)" in (DOCS / "README.md").read_text(encoding="utf-8")
    assert (BUNDLES / published_bundles.PAGE).read_text(encoding="utf-8") == published_bundles.page(BUNDLES)
    rows = results.load(DOCS / results.FILE).rows
    configs = bundles.read_all(BUNDLES)
    assert len(configs) == 8
    for config in configs:
        system = open_bundle(config.path.parent)
        system.graphs.check()
        still = np.zeros((20, system.n_numbers))
        assert system.predict(still, still).frames.shape[1] == system.n_numbers
        judged = published_bundles.judged_as(config)["bundle"][:12]
        found = [row for row in rows if row.bundle == judged]
        assert found, f"{config.path}: no row of results.json was judged as {judged}"
        for name in ("scale", "optimiser", "seed", "corpus"):
            assert {getattr(row, name) for row in found} == {getattr(config, name)}
    assert sum(path.stat().st_size for path in BUNDLES.rglob("*") if path.is_file()) < MOST_BYTES


class Chooser:
    """A system that splices alike but for some pairs."""

    def __init__(self, late: int = 0, longer: int = 0, off: float = 0.0, corpus_hash: str | None = None) -> None:
        self.late, self.longer, self.off, self.n = late, longer, off, 0
        self.config = config_of({**CONFIG, "corpus": corpus_hash or corpus().head["hash"]}, Path("bundle.json"))

    def predict(self, before: Any, after: Any) -> Prediction:
        self.n += 1
        shift = self.n <= self.late
        return Prediction(3 + shift, 2, np.full((4 + (self.n == 3) * self.longer, 159), self.off))


def test_agreement_counts_positions_then_lengths_then_frames() -> None:
    one: Any = Chooser()
    other: Any = Chooser(late=2, longer=1, off=0.25)
    found = published_bundles.agreement(one, other, corpus(), range(6))
    assert (found.pairs, found.positions, found.lengths, found.largest_difference) == (6, 4, 3, 0.25)
    stranger: Any = Chooser(corpus_hash="c0ffee")
    with pytest.raises(InputError, match="learned from corpus c0ffee"):
        published_bundles.agreement(stranger, other, corpus(), [0])


def test_the_page_lists_what_was_published_and_nothing_else(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="holds no bundle"):
        published_bundles.page(tmp_path)
    training = {"optimiser": "adamw", "split": "random", "seed": 0, "steps": 60, "command": ["signsplice", "train"]}
    write_bundle(tmp_path / "lpt-smoke", {**CONFIG, **training}, {"spsn.onnx": b"x"})
    with pytest.raises(InputError, match=r"was not written by `signsplice-paper publish`"):
        published_bundles.page(tmp_path)
    agrees = {"bundle": "0123456789abcdef", "pairs": 200, "positions": 199, "lengths": 198, "largest_difference": 2e-5}
    write_bundle(tmp_path / "lpt-smoke", {**CONFIG, **training, "halved": agrees}, {"spsn.onnx": b"x"})
    page = published_bundles.page(tmp_path)
    sha = bundles.short_hash(bundles.read_all(tmp_path)[0])
    assert f"| random | 0 | 60 | 0123456789ab | {sha} | 0.0 | 200: 199, 198; 2e-05 |" in page
    assert "    signsplice train\n" in page
