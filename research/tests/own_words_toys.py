"""Clips of the toy corpus as files: fixtures of the tests of own words."""

from __future__ import annotations

from pathlib import Path

import pytest

from signsplice.formats import load
from signsplice.motion import Clip
from signsplice_paper import pair_export
from toys import GLOSSES, corpus


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Words and truth of the first signer of the toy corpus as files."""
    folder = tmp_path_factory.mktemp("exported") / "clips"
    assert pair_export.export(corpus(), folder) == 25
    return folder


@pytest.fixture(scope="module")
def words(exported: Path) -> dict[str, Clip]:
    return {gloss: load(exported / "words" / f"{k:03d}-{gloss}.bvh") for k, gloss in enumerate(GLOSSES)}
