"""bundle.json of the paper's systems is read and checked in one place."""

from __future__ import annotations

from pathlib import Path

import pytest

from signsplice.errors import InputError
from signsplice.splicing.bundle import BUNDLE_FILE
from signsplice_paper.configs import RunConfig, parse_config, read_config


def test_the_configuration_of_a_papers_system_has_how_it_is_run() -> None:
    runs = {"positions": "spsn", "frames": "generator", "concurrent": True, "n_fed": 159, "most_frames": 40}
    stored = {"version": 1, "system": "lpt-plus", "fr": 8, "n_parameters": 5, "runs": runs}
    config = parse_config(stored, Path("bundle.json"))
    assert config.runs == RunConfig("spsn", "generator", True, 159, 40, token_bias=0.0)
    assert (config.fr, config.n_parameters, config.networks, config.stored) == (8, 5, {}, stored)


@pytest.mark.parametrize("entry", ['"runs": {"speed": 1}', '"space": {"joints": 3}', '"seed": "one"'])
def test_a_broken_configuration_is_refused(entry: str, tmp_path: Path) -> None:
    (tmp_path / BUNDLE_FILE).write_text(f'{{"version": 1, {entry}}}')
    with pytest.raises(InputError, match=r"bundle\.json: is no description of a trained system"):
        read_config(tmp_path)


def test_keys_that_a_caller_needs_are_required() -> None:
    config = parse_config({"version": 1, "system": "lpt-plus", "fr": None}, Path("somewhere/bundle.json"))
    config.require("system", "fr")
    with pytest.raises(InputError, match=r"somewhere/bundle\.json: has no 'runs'; export the system anew"):
        config.require("system", "runs")
