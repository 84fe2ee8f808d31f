"""The trainings that the paper's tables and figures need, in order of importance, and the folder of each bundle."""

from __future__ import annotations

import json
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from signsplice.splicing.bundle import BUNDLE_FILE
from signsplice_paper import published
from signsplice_workshop.corpora import readable_pairs

SCALES = ("smoke", "small", "cpu", "paper")
TAUGHT_SPLIT = readable_pairs.TAUGHT
RIVALS = tuple(reversed(published.RIVALS))  # the cheapest to train first
"""The systems that the paper compares LpTransformer with."""
TABLE_1 = (published.LPTRANSFORMER, published.LPT_PLUS, *RIVALS)
SEEDED = (*TABLE_1, *(by[published.AS_PRINTED] for by in published.CONDITIONS.values()))
"""Systems that are trained with further seeds."""
SEEDS = (1, 2)
ON_MANY = (published.LPTRANSFORMER, published.LPT_PLUS)
"""Systems that are taught on a corpus to teach on, too."""
SEARCHED = (published.LPTRANSFORMER, *RIVALS)
"""Systems whose rates and widths are searched."""


@dataclass(frozen=True)
class Run:
    """One training.

    - system: name of the system
    - scale: one of ``SCALES``
    - optimiser: adamw or sgd
    - split: the split whose training part it learns from
    - fr: frames that Culling keeps on each side, None for the default
    - seed: of weights, batches and noise
    """

    system: str
    scale: str
    optimiser: str
    split: str
    fr: int | None = None
    seed: int = 0

    @property
    def name(self) -> str:
        """The name of the bundle's folder."""
        fr = "" if self.fr is None else f"-fr{self.fr}"
        seed = "" if self.seed == 0 else f"-seed{self.seed}"
        return f"{self.system}{fr}-{self.scale}-{self.optimiser}-{self.split}{seed}"


@dataclass(frozen=True)
class Choice:
    """A choice of systems to train and judge; an empty field allows all.

    - systems, optimisers, seeds: the chosen trainings
    - splits: splits that are judged
    """

    systems: tuple[str, ...] = ()
    optimisers: tuple[str, ...] = ()
    splits: tuple[str, ...] = ()
    seeds: tuple[int, ...] = ()

    def __str__(self) -> str:
        """Returns the command line's options for this choice."""
        options = (("system", self.systems), ("optimiser", self.optimisers), ("split", self.splits),
                 ("seed", self.seeds))  # fmt: skip
        return " ".join(f"--{option} {value}" for option, values in options for value in values)

    def allows(self, run: Run) -> bool:
        """Returns whether a training is chosen."""
        filters: tuple[tuple[tuple[object, ...], object], ...] = (
            (self.systems, run.system),
            (self.optimisers, run.optimiser),
            (self.seeds, run.seed),
        )
        return all(not allowed or value in allowed for allowed, value in filters)


def plan_runs(scale: str, choice: Choice | None = None, splits: Collection[str] = ("random",)) -> list[Run]:
    """Returns every training that the tables of a scale need, the most important first; at scale ``small`` those of
    table 1.

    splits: those of the corpus. On one to teach on, the systems of ``ON_MANY``. On any other, on the random split,
    which has the training part of all: the systems of table 1; the four systems as printed; ablations; by SGD, as in
    the paper, LpTransformer as printed, or the systems that the choice names together with SGD; and further seeds, at
    scale ``smoke`` one.
    """
    filters, is_smoke = choice or Choice(), scale == "smoke"
    if TAUGHT_SPLIT in splits:
        planned = [Run(system, scale, "adamw", TAUGHT_SPLIT) for system in ON_MANY]
    else:
        systems = TABLE_1 if scale == "small" else (*SEEDED, *published.ABLATIONS)
        planned = [Run(system, scale, "adamw", "random") for system in systems]
        if scale != "small":
            by_sgd = filters.systems if "sgd" in filters.optimisers and filters.systems else (published.PRINTED,)
            planned += [Run(system, scale, "sgd", "random") for system in by_sgd]
            planned += [
                Run(system, scale, "adamw", "random", seed=seed)
                for seed in SEEDS[: 1 if is_smoke else None]
                for system in (ON_MANY if is_smoke else SEEDED)
            ]
    return [run for run in planned if filters.allows(run)]


def find_missing(planned: Sequence[Run], bundles: Path, corpus: str | None = None) -> list[Run]:
    """Returns the runs whose bundle does not exist, or is of another corpus than the one with this hash."""
    missing_runs = []
    for run in planned:
        stored = _load_bundle_config(bundles / run.name)
        if stored is None or (corpus is not None and stored.get("corpus", corpus) != corpus):
            missing_runs.append(run)
    return missing_runs


def _load_bundle_config(bundle: Path) -> dict[str, Any] | None:
    """Returns the contents of a bundle.json, None if there is none."""
    try:
        stored = json.loads((bundle / BUNDLE_FILE).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return stored if isinstance(stored, dict) else None
