"""Trained systems published beside the tables, and the page that lists them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from signsplice.errors import InputError
from signsplice.formats.atomic import replacing
from signsplice.splicing.bundle import read_file
from signsplice_paper import bundles, published
from signsplice_paper.configs import PaperConfig, read_config

PAGE = "README.md"
_HEAD = """# Trained systems

Systems of the table, with 16-bit weights, ready to run:

    signsplice splice A.bvh B.bvh -o out.bvh --system {folder}/{name}

`signsplice-paper publish` wrote these folders and this page. A row of `docs/results.json` names the
bundle that was judged by the start of its sha256.

| folder | system | condition | scale | optimiser | split | seed | steps | sha256 | MB |
| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |
"""
_TAIL = """
Each was trained by one command ([the two corpora](../../workshop/docs/readable-truth.md)):

"""


def publish(sources: Sequence[Path], out: Path) -> list[Path]:
    """Write each bundle, without its log and curve, into a folder of its name in ``out``, and the page about all
    bundles there; the folders written. Raises ``InputError`` for what is no bundle of the paper's systems.
    """
    from signsplice_workshop.train.bundles import write_bundle

    written = []
    for source in sources:
        config = read_config(source)
        config.require("system", "runs", "fr", "split", "corpus", "command")
        target = out / source.resolve().name
        if target.exists() and target.samefile(source):
            raise InputError(f"{target}: is the bundle itself; name another folder")
        stored = {k: v for k, v in config.stored.items() if k not in ("version", "files")}
        write_bundle(target, stored, {name: read_file(source, config, name) for name in config.files})
        written.append(target)
    with replacing(out / PAGE) as temporary:
        temporary.write_text(page(out), encoding="utf-8")
    return written


def page(folder: Path) -> str:
    """The page about the bundles in a folder. Raises ``InputError`` where there is none."""
    configs = bundles.read_all(folder)
    if not configs:
        raise InputError(f"{folder}: holds no bundle")
    shown = next((config for config in configs if config.system == published.LPT_PLUS), configs[0])
    head = _HEAD.format(folder=_display_path(folder), name=shown.path.parent.name)
    commands = "".join(f"    {' '.join(config.stored['command'])}\n" for config in configs)
    return head + "".join(map(_line, configs)) + _TAIL + commands


def _line(config: PaperConfig) -> str:
    n_bytes = sum(path.stat().st_size for path in config.path.parent.iterdir())
    row = bundles.result_row(config)
    cells = (
        config.path.parent.name, published.name(row.system), row.condition, row.scale, row.optimiser, config.split,
        row.seed, row.steps, row.bundle, f"{n_bytes / 1e6:.1f}",
    )  # fmt: skip
    return f"| {' | '.join(map(str, cells))} |\n"


def _display_path(folder: Path) -> str:
    """The folder as a reader at the root of the project names it."""
    parts = folder.resolve().parts
    return "/".join(parts[-2:]) if parts[-2] == "research" else folder.name
