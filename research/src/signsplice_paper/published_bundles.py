"""Trained systems published beside the tables: with 16-bit weights, how far they agree with those that were judged, and
the page that lists them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from signsplice.errors import InputError
from signsplice_paper import bundles, published
from signsplice_paper.configs import PaperConfig
from signsplice_paper.systems import PaperSystem
from signsplice_workshop.corpora.pairs import Pairs

PAGE = "README.md"
_HEAD = """# Trained systems

Systems of the tables, ready to run:

    signsplice splice A.bvh B.bvh -o out.bvh --system {folder}/{name}

`signsplice-paper publish` wrote these folders and this page. Weights have 16 bits. The rows of
[results.json](../docs/results.json) were judged with the same weights in 32, and name that bundle by the start of its
sha256 (*judged as*). *Agrees*: of so many test pairs, how many have the same two positions, and how many also the same
number of frames; then the largest difference of a number of a frame among those.

| folder | system | scale | optimiser | split | seed | steps | judged as | sha256 | MB | agrees |
| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |
"""
_TAIL = """
Each was trained by one command, `pairs` being what `signsplice synth pairs -o pairs` makes:

"""


@dataclass(frozen=True)
class Agreement:
    """How often two forms of a system choose alike.

    - pairs: how many pairs both were given
    - positions: how many have the same two positions
    - lengths: how many have the same positions and number of frames
    - largest_difference: of a number of a frame of those, 0 where there is none
    """

    pairs: int
    positions: int
    lengths: int
    largest_difference: float


def agreement(one: PaperSystem, other: PaperSystem, pairs: Pairs, numbers: Sequence[int]) -> Agreement:
    """How often two forms of a system choose alike for these pairs. Raises ``InputError`` for another corpus than that
    of the first.
    """
    if one.config.corpus != pairs.head["hash"]:
        raise InputError(f"{one.config.path}: learned from corpus {one.config.corpus}, not from {pairs.folder}")
    positions = lengths = 0
    largest = 0.0
    for number in numbers:
        p, q = pairs.index[number, :2].tolist()
        words = pairs.word(p).astype(np.float64), pairs.word(q).astype(np.float64)
        a, b = one.predict(*words), other.predict(*words)
        if (a.pre, a.post) != (b.pre, b.post):
            continue
        positions += 1
        if len(a.frames) == len(b.frames):
            lengths += 1
            largest = max(largest, float(np.abs(a.frames - b.frames).max(initial=0.0)))
    return Agreement(len(numbers), positions, lengths, largest)


def described(agrees: Agreement) -> dict[str, Any]:
    """What bundle.json says of it."""
    return asdict(agrees)


def page(folder: Path) -> str:
    """The page about the bundles in a folder. Raises ``InputError`` where there is none, or one was not published."""
    configs = bundles.read_all(folder)
    if not configs:
        raise InputError(f"{folder}: holds no bundle")
    shown = next((config for config in configs if config.system == "lpt"), configs[0])
    head = _HEAD.format(folder=_shown(folder), name=shown.path.parent.name)
    commands = "".join(f"    {' '.join(_command(config))}\n" for config in configs)
    return head + "".join(_line(config) for config in configs) + _TAIL + commands


def _command(config: PaperConfig) -> list[str]:
    """The words that train a system now; bundles of version 0.4 name `signsplice train paper`."""
    words: list[str] = config.stored.get("command", [])
    former = ["signsplice", "train", "paper"]
    return ["signsplice-paper", "train-system", *words[3:]] if words[:3] == former else words


def judged_as(config: PaperConfig) -> Mapping[str, Any]:
    """What a published bundle was made from, and how far they agree. Raises ``InputError`` for any other bundle."""
    made = config.stored.get("halved")
    if not isinstance(made, dict) or not isinstance(made.get("bundle"), str):
        raise InputError(f"{config.path}: was not written by `signsplice-paper publish`; write it by that")
    return made


def _line(config: PaperConfig) -> str:
    made = judged_as(config)
    n_bytes = sum(path.stat().st_size for path in config.path.parent.iterdir())
    agrees = f"{made['pairs']}: {made['positions']}, {made['lengths']}; {made['largest_difference']:.1g}"
    cells = (
        config.path.parent.name, published.name(config.system or ""), config.scale, config.optimiser, config.split,
        config.seed, config.steps, made["bundle"][:12], bundles.short_hash(config), f"{n_bytes / 1e6:.1f}", agrees,
    )  # fmt: skip
    return f"| {' | '.join(map(str, cells))} |\n"


def _shown(folder: Path) -> str:
    """The folder as a reader at the root of the project names it."""
    parts = folder.resolve().parts
    return "/".join(parts[-2:]) if parts[-2] == "research" else folder.name
