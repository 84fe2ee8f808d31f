"""bundle.json of the paper's systems: how each was trained, and how it is run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, get_type_hints

from signsplice.errors import InputError
from signsplice.formats.json_files import check_type
from signsplice.splicing import bundle
from signsplice.splicing.bundle import BundleConfig, check_fields, config_errors
from signsplice_workshop.corpora.number_space import NumberSpace, read_space


@dataclass(frozen=True)
class RunConfig:
    """How the networks of a system are run.

    positions: the graph that finds the splice positions, "spsn" or "encoder".
    frames: the part that generates the frames, "generator".
    concurrent: whether the generator can make all frames in one pass.
    n_fed: numbers of a frame that the decoder is fed: all.
    most_frames: largest number of generated frames.
    token_bias: added to the logits of both tokens.
    marked: whether the encoder is given the splice positions as marks on the whole X.
    """

    positions: str
    frames: str
    concurrent: bool
    n_fed: int
    most_frames: int
    token_bias: float = 0.0
    marked: bool = False


@dataclass(frozen=True)
class PaperConfig(BundleConfig):
    """bundle.json of a system.

    scale, optimiser, split, corpus, seed, steps: how it was trained.
    fps: frame rate that it knows.
    fr: frames that Culling keeps on each side; None without Culling.
    n_parameters: number of weights.
    runs: how it is run.
    space: its joints and its cube; None for those of the synthetic signer.
    """

    scale: str | None = None
    optimiser: str | None = None
    split: str | None = None
    corpus: str | None = None
    seed: int | None = None
    steps: int | None = None
    fps: float | None = None
    fr: int | None = None
    n_parameters: int | None = None
    runs: RunConfig | None = None
    space: NumberSpace | None = None

    def require(self, *names: str) -> None:
        """Raises ``InputError`` if bundle.json lacks one of these keys."""
        for name in names:
            if name not in self.stored:
                raise InputError(f"{self.path}: has no {name!r}; export the system anew")


_PLAIN = ("scale", "optimiser", "split", "corpus", "seed", "steps", "fps", "fr", "n_parameters")


def read_config(folder: Path) -> PaperConfig:
    """Returns bundle.json of a folder. Raises ``InputError`` if it is missing, broken, or of another version."""
    config = bundle.read_config(folder)
    return parse_config(config.stored, config.path)


def parse_config(stored: Mapping[str, Any], path: Path) -> PaperConfig:
    """Returns the configuration in JSON values. Raises ``InputError`` if a value has the wrong form."""
    base = bundle.config_of(stored, path)
    runs, space = stored.get("runs"), stored.get("space")
    with config_errors(path):
        check_fields(stored, PaperConfig, *_PLAIN)
        values: dict[str, Any] = {field.name: getattr(base, field.name) for field in fields(base)}
        return PaperConfig(
            **(values | {name: stored.get(name) for name in _PLAIN}),
            runs=None if runs is None else _parse_run(runs),
            space=None if space is None else read_space(space),
        )


def _parse_run(runs: Mapping[str, Any]) -> RunConfig:
    kinds = get_type_hints(RunConfig)
    for name, value in runs.items():
        check_type(value, kinds.get(name, Any), f"runs: {name}")
    return RunConfig(**runs)
