"""Publishes trained systems next to the tables, and writes the page that lists them."""

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


def publish(sources: Sequence[Path], output_folder: Path) -> list[Path]:
    """Writes each bundle, without its log and curve, into a folder of its name in ``output_folder``, and the page about
    all bundles there; returns the folders. Raises ``InputError`` for a folder that is no bundle of the paper's systems.
    """
    from signsplice_workshop.train.bundles import write_bundle

    written = []
    for source in sources:
        config = read_config(source)
        config.require("system", "runs", "fr", "split", "corpus", "command")
        target = output_folder / source.resolve().name
        if target.exists() and target.samefile(source):
            raise InputError(f"{target}: is the bundle itself; name another folder")
        stored = {k: v for k, v in config.stored.items() if k not in ("version", "files")}
        write_bundle(target, stored, {name: read_file(source, config, name) for name in config.files})
        written.append(target)
    with replacing(output_folder / PAGE) as temporary:
        temporary.write_text(format_page(output_folder), encoding="utf-8")
    return written


def format_page(folder: Path) -> str:
    """Returns the page about the bundles in a folder. Raises ``InputError`` if there is none."""
    configs = bundles.read_all(folder)
    if not configs:
        raise InputError(f"{folder}: holds no bundle")
    example = next((config for config in configs if config.system == published.LPT_PLUS), configs[0])
    head = _HEAD.format(folder=_format_path(folder), name=example.path.parent.name)
    commands = "".join(f"    {' '.join(config.stored['command'])}\n" for config in configs)
    return head + "".join(map(_format_line, configs)) + _TAIL + commands


def _format_line(config: PaperConfig) -> str:
    n_bytes = sum(path.stat().st_size for path in config.path.parent.iterdir())
    row = bundles.make_result_row(config)
    cells = (
        config.path.parent.name, published.get_display_name(row.system), row.condition, row.scale, row.optimiser,
        config.split, row.seed, row.steps, row.bundle, f"{n_bytes / 1e6:.1f}",
    )  # fmt: skip
    return f"| {' | '.join(map(str, cells))} |\n"


def _format_path(folder: Path) -> str:
    """Returns the folder's path relative to the root of the project."""
    parts = folder.resolve().parts
    return "/".join(parts[-2:]) if parts[-2] == "research" else folder.name
