"""A corpus to teach on and one to judge on, whose truth can be read: from both to one table."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner

pytest.importorskip("torch")

from signsplice.signer import notation
from signsplice_paper import plan, results, tables
from signsplice_paper.cli.commands import app
from signsplice_paper.protocol import SPLITS
from signsplice_workshop.corpora.readable_pairs import JudgedCorpus, TaughtCorpus, write_readable


@pytest.mark.slow
def test_the_table_has_systems_trained_on_either_corpus(tmp_path: Path) -> None:
    signs = tuple(notation.everyday().values())
    write_readable(JudgedCorpus(signs, n_known=6, n_unseen=2, n_signers=1, n_pairs=4), tmp_path / "judged", processes=1)
    write_readable(TaughtCorpus(n_signers=2, n_words=4, n_pairs=6), tmp_path / "taught", processes=1)
    shared = ["--scale", "smoke", "--bundles", str(tmp_path / "bundles"), "--steps", "2"]
    teach = ["train", *shared, "--pairs", str(tmp_path / "taught")]
    here = ["all", *shared, "--pairs", str(tmp_path / "judged"), "--out", str(tmp_path / "out"), "--limit", "2"]
    for call in (teach, [*here, "--system", plan.ON_MANY[0], "--system", plan.ON_MANY[1], "--seed", "0"], teach):
        result = CliRunner().invoke(app, call, catch_exceptions=False)
        assert result.exit_code == 0, result.output
    known = results.load(tmp_path / "out" / results.FILE)
    for system in plan.ON_MANY:
        rows = known.find(system=system)
        assert sorted((bool(row.taught), row.split) for row in rows) == sorted(
            (taught, split) for taught in (False, True) for split in SPLITS
        )
        assert len({row.corpus for row in rows}) == 1, "all were judged on one"
        assert {curve.split for curve in known.curves if curve.system == system} == {"random"}
    shown = [(one.system, one.taught) for one in tables.list_lines(known, "smoke", "unseen-both")]
    assert {("LPT+", tables.ON_SPLIT), ("LPT+", tables.ON_MANY), ("LpTransformer", tables.ON_MANY)} <= set(shown)
