"""Bundles beside the table: each opens, is listed, and stands in the results as what it was judged as."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from signsplice.errors import InputError
from signsplice_paper import bundles, published_bundles
from signsplice_paper.configs import read_config
from signsplice_paper.systems import open_bundle
from signsplice_workshop.train.bundles import write_bundle
from test_paper_clips import CONFIG
from toys import DOCS, committed_results

BUNDLES = DOCS.parent / "bundles"
MOST_BYTES = 12_000_000
TRAINING = {"optimiser": "adamw", "split": "random", "seed": 0, "steps": 60, "command": ["signsplice-paper", "train"]}


def test_published_bundles_open_and_stand_in_the_results() -> None:
    rows = committed_results().rows
    assert (BUNDLES / published_bundles.PAGE).read_text(encoding="utf-8") == published_bundles.format_page(BUNDLES)
    for config in bundles.read_all(BUNDLES):
        system = open_bundle(config.path.parent)
        system.graphs.check()
        still = np.zeros((20, system.n_numbers))
        assert system.predict(still, still).frames.shape[1] == system.n_numbers
        found = [row for row in rows if row.bundle == bundles.compute_short_hash(config)]
        assert found, f"{config.path}: no row of results.json was judged as this"
        for name in ("system", "scale", "optimiser", "seed", "steps", "fr"):
            assert {getattr(row, name) for row in found} == {getattr(config, name)}
        assert {row.taught or row.corpus for row in found} == {config.corpus}
    assert sum(path.stat().st_size for path in BUNDLES.rglob("*") if path.is_file()) < MOST_BYTES


def trained(folder: Path, **changes: object) -> Path:
    """A bundle as training leaves it, with a log and a curve that bundle.json does not list."""
    files = {"spsn.onnx": b"x" * 200_000}
    write_bundle(folder, {**CONFIG, **TRAINING, **changes}, files, {"spsn.jsonl": b"{}", "curve.json": b"{}"})
    return folder


def test_publishing_copies_bundles_without_their_logs_and_lists_them(tmp_path: Path) -> None:
    sources = [trained(tmp_path / "bundles" / name) for name in ("lpt-plus-smoke", "other-smoke")]
    out = tmp_path / "research" / "bundles"
    assert published_bundles.publish(sources, out) == [out / "lpt-plus-smoke", out / "other-smoke"]
    for source in sources:
        assert {path.name for path in (out / source.name).iterdir()} == {"bundle.json", "spsn.onnx"}
        assert bundles.compute_short_hash(read_config(out / source.name)) == bundles.compute_short_hash(
            read_config(source)
        ), "rows that name the one name the other"
    text = (out / published_bundles.PAGE).read_text()
    assert text == published_bundles.format_page(out)
    sha = bundles.compute_short_hash(read_config(sources[0]))
    line = f"| lpt-plus-smoke | LPT+ | equal treatment | smoke | adamw | random | 0 | 60 | {sha} | 0.2 |"
    assert line in text.splitlines()
    assert "--system research/bundles/lpt-plus-smoke" in text
    assert text.count("    signsplice-paper train\n") == 2
    published_bundles.publish([trained(tmp_path / "bundles" / "lpt-plus-smoke", seed=5)], out)
    assert "| random | 5 | 60 |" in (out / published_bundles.PAGE).read_text(), "published anew"


def test_what_is_no_bundle_or_the_folder_itself_is_not_published(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="holds no bundle"):
        published_bundles.format_page(tmp_path)
    with pytest.raises(InputError, match="no such file"):
        published_bundles.publish([tmp_path / "nowhere"], tmp_path / "out")
    source = trained(tmp_path / "lpt-plus-smoke")
    with pytest.raises(InputError, match="is the bundle itself; name another folder"):
        published_bundles.publish([source], tmp_path)
    write_bundle(tmp_path / "product", {"system": "signsplice"}, {})
    with pytest.raises(InputError, match=r"product/bundle\.json: has no 'runs'"):
        published_bundles.publish([tmp_path / "product"], tmp_path / "out")
    assert not (tmp_path / "out" / "product").exists()
