"""The trainings that the paper's tables and figures need, and the folder of each bundle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from signsplice.paper import published
from signsplice.splicing.bundle import BUNDLE_FILE

SCALES = ("smoke", "cpu", "paper")
SWEEP = (2, 4, 6, 8, 10, 12, 16)
"""Values of fr; the paper prints only the results for 6 and 8."""
SWEEP_SMOKE = (4, 8)


@dataclass(frozen=True)
class Run:
    """One training.

    - system: name of the system
    - scale: smoke, cpu or paper
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


def runs(scale: str, systems: Sequence[str] = (), seed: int = 0) -> list[Run]:
    """Every training that the tables and figures of a scale need, the most important first; only those of ``systems``
    if any are named.

    On the random split: the paper's seven systems by AdamW and, as in the paper, by SGD; the systems of its related
    work by AdamW; LpTransformer by AdamW for every fr. On unseen words: all systems but ``lpt-printed`` by AdamW.
    Unseen signers need no training, because they share the training part of the random split.
    """
    seven = tuple(dict.fromkeys((*reversed(published.TABLE_1), *published.TABLE_3)))
    every = [Run(system, scale, "adamw", "random", seed=seed) for system in (*seven, *published.OTHERS)]
    every += [Run(system, scale, "sgd", "random", seed=seed) for system in seven]
    sweep = SWEEP_SMOKE if scale == "smoke" else SWEEP
    every += [Run("lpt", scale, "adamw", "random", fr, seed) for fr in sweep if fr != published.BEST_FR]
    unseen = (*seven, *(system for system in published.OTHERS if system != "lpt-printed"))
    every += [Run(system, scale, "adamw", "unseen-words", seed=seed) for system in unseen]
    return [run for run in every if not systems or run.system in systems]


def missing(planned: Sequence[Run], bundles: Path) -> list[Run]:
    """The runs whose bundle does not exist."""
    return [run for run in planned if not (bundles / run.name / BUNDLE_FILE).is_file()]
