"""What has to be trained for the paper's tables and figures, and where each bundle lies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from signsplice.paper import published

SCALES = ("smoke", "cpu", "paper")
SWEEP = (2, 4, 6, 8, 10, 12, 16)
"""Values of fr; the paper prints 6 and 8 of those it tried."""
SWEEP_SMOKE = (4, 8)


@dataclass(frozen=True)
class Run:
    """One training: what `signsplice train paper` is called with."""

    system: str
    scale: str
    optimiser: str
    split: str
    fr: int | None = None
    seed: int = 0

    @property
    def name(self) -> str:
        """The bundle's folder."""
        fr = "" if self.fr is None else f"-fr{self.fr}"
        seed = "" if self.seed == 0 else f"-seed{self.seed}"
        return f"{self.system}{fr}-{self.scale}-{self.optimiser}-{self.split}{seed}"

    def arguments(self, pairs: Path, bundles: Path, steps: int | None = None) -> list[str]:
        """The arguments of `signsplice` that train it."""
        told = {"system": self.system, "scale": self.scale, "optimiser": self.optimiser, "split": self.split}
        call = ["train", "paper", "--pairs", str(pairs), "--out", str(bundles / self.name), "--seed", str(self.seed)]
        for option, value in (*told.items(), ("fr", self.fr), ("steps", steps)):
            if value is not None:
                call += [f"--{option}", str(value)]
        return call


def runs(scale: str, systems: Sequence[str] = (), seed: int = 0) -> list[Run]:
    """Every training that the tables and figures of a scale need, the most telling first; only some ``systems`` where
    they are named.

    The paper's seven systems by AdamW and by SGD, as the paper did, on the random split; the same by AdamW on unseen
    words; the systems of its related work by AdamW; LpTransformer for every fr. Unseen signers need no training of
    their own: their training part is that of the random split.
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
    """Runs whose bundle is not there."""
    return [run for run in planned if not (bundles / run.name / "bundle.json").is_file()]
