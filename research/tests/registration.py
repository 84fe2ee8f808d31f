"""The entry points of research/pyproject.toml, where the distribution is not installed."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

PROJECT = Path(__file__).resolve().parents[1] / "pyproject.toml"


@pytest.fixture(scope="module", autouse=True)
def registered(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """`signsplice --system` finds the paper's systems, as after an installation."""
    project = tomllib.loads(PROJECT.read_text())["project"]
    folder = tmp_path_factory.mktemp("installed")
    metadata = folder / f"signsplice_paper-{project['version']}.dist-info"
    metadata.mkdir()
    named = {"Metadata-Version": "2.1", "Name": project["name"], "Version": project["version"]}
    (metadata / "METADATA").write_text("".join(f"{name}: {value}\n" for name, value in named.items()))
    groups = project["entry-points"].items()
    entries = [f"[{group}]\n" + "".join(f"{k} = {v}\n" for k, v in named.items()) for group, named in groups]
    (metadata / "entry_points.txt").write_text("".join(entries))
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(folder)
        yield
