"""The trainings that the paper's tables and figures need, in order of importance, and the folder of each bundle.

One plan serves a corpus of either truth: the trainings of the other truth are the same, with another corpus, another
folder of bundles and another folder of results.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from signsplice.splicing.bundle import BUNDLE_FILE
from signsplice_paper import published

SCALES = ("smoke", "small", "cpu", "paper")
SHARED_TRAINING = {"unseen-signer": "random"}
"""Splits that have the training part of another split."""
SWEEP = (2, 4, 6, 8, 10, 12, 16)
"""Values of fr; the paper prints only the results for 6 and 8."""
SWEEP_SMOKE = (4, 8)

RIVALS = tuple(reversed(published.RIVALS))  # the cheapest to train first
"""The systems that the paper compares LpTransformer with."""
TABLE_1 = (published.PRINTED, published.IMPROVED, *RIVALS)
PAPER = (*TABLE_1, *published.ABLATIONS)
"""Tables 1 and 3: the paper's systems as printed, its ablations, and the improved system."""
TREATED = ("lpt-printed-equal", "lstm-plain", "transformer-plain", "conv-s2s-plain")
"""The four systems in the treatment that they lack in ``PAPER`` (``published.TREATED``)."""
SEEDED = (published.PRINTED, published.IMPROVED)
"""Systems that are trained with further seeds, beside the best rival, and for every fr: there they share their parts
that see fr frames.
"""
SEEDS = (1, 2)
BY_SGD = {
    "smoke": ("lpt-printed",),
    "small": (),
    "cpu": ("lpt-printed",),
    "paper": ("lpt-printed", "lpt", *RIVALS),
}
"""Systems that are trained by SGD too, as in the paper. It needs many times the steps of AdamW."""


@dataclass(frozen=True)
class Run:
    """One training.

    - system: name of the system
    - scale: one of ``SCALES``
    - optimiser: adamw, sgd or sgd-momentum
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
    """Which systems are trained and judged; an empty field allows all.

    - systems, optimisers, seeds: those of the trainings
    - splits: splits that are judged, and trained on
    - frs: frames that Culling keeps, ``published.BEST_FR`` for the default and for systems without Culling
    """

    systems: tuple[str, ...] = ()
    optimisers: tuple[str, ...] = ()
    splits: tuple[str, ...] = ()
    seeds: tuple[int, ...] = ()
    frs: tuple[int, ...] = ()

    def __str__(self) -> str:
        """The options that make this choice."""
        named = (("system", self.systems), ("optimiser", self.optimisers), ("split", self.splits),
                 ("seed", self.seeds), ("fr", self.frs))  # fmt: skip
        return " ".join(f"--{option} {value}" for option, values in named for value in values)

    def allows(self, run: Run) -> bool:
        """Whether a run is wanted: what it trains is judged on one of the splits."""
        feeding = tuple(_trained_on(split) for split in self.splits)
        asked: tuple[tuple[tuple[object, ...], object], ...] = (
            (self.systems, run.system),
            (self.optimisers, run.optimiser),
            (feeding, _trained_on(run.split)),
            (self.seeds, run.seed),
            (self.frs, published.BEST_FR if run.fr is None else run.fr),
        )
        return all(not allowed or value in allowed for allowed, value in asked)


def _trained_on(split: str) -> str:
    return SHARED_TRAINING.get(split, split)


def runs(scale: str, choice: Choice | None = None, rival: str | None = None) -> list[Run]:
    """Every training that the tables and figures of a scale need, the most important first; at scale ``small`` those of
    table 1 on the random split alone.

    1. On the random split by AdamW: the systems of tables 1 and 3. At scale ``paper`` those of ``BY_SGD`` after them.
    2. The same systems on unseen words; at scale ``smoke`` only those of table 1.
    3. Seeds 1 and 2 of the systems in ``SEEDED`` and of ``rival``, the best rival, or of those that the choice names
       together with seeds; at scale ``smoke`` seed 1. While the best rival is not known (None), and all rivals are
       wanted, the list ends before them.
    4. LpTransformer for every fr with seed 0, and with seeds 1 and 2 where the choice names them, values of fr and
       systems; the four systems in the treatment that they lack; LpTransformer by SGD with momentum; and SGD: of the
       systems in ``BY_SGD``, or of those that the choice names together with SGD.
    """
    wanted, smoke = choice or Choice(), scale == "smoke"
    if scale == "small":
        return [run for run in (Run(system, scale, "adamw", "random") for system in TABLE_1) if wanted.allows(run)]
    by_sgd = wanted.systems if "sgd" in wanted.optimisers and wanted.systems else BY_SGD[scale]
    sgd = [Run(system, scale, "sgd", "random") for system in by_sgd]
    first = [Run(system, scale, "adamw", "random") for system in PAPER]
    first += sgd if scale == "paper" else []
    first += [Run(system, scale, "adamw", "unseen-words") for system in (TABLE_1 if smoke else PAPER)]
    chosen = [run for run in first if wanted.allows(run)]
    if rival is None and {Run(system, scale, "adamw", "random") for system in RIVALS} <= set(chosen):
        return chosen
    seeded = (*SEEDED, *(() if rival is None else (rival,)))
    if wanted.seeds and wanted.systems:
        seeded = wanted.systems
    last = [
        Run(system, scale, "adamw", "random", seed=seed) for seed in SEEDS[: 1 if smoke else None] for system in seeded
    ]
    sweep = [fr for fr in (SWEEP_SMOKE if smoke else SWEEP) if fr != published.BEST_FR]
    again = [seed for seed in SEEDS if wanted.systems and wanted.frs and seed in wanted.seeds]
    last += [
        Run(system, scale, "adamw", "random", fr, seed) for seed in (0, *again) for fr in sweep for system in SEEDED
    ]
    last += [] if smoke else [Run(system, scale, "adamw", "random") for system in TREATED]
    last += [] if smoke else [Run(published.PRINTED, scale, "sgd-momentum", "random")]
    last += sgd if scale != "paper" else []
    return chosen + [run for run in last if wanted.allows(run)]


def best_rival(bundles: Path, scale: str) -> str | None:
    """The rival with the best Accuracy on validation pairs of the random split, with seed 0; None as long as one of
    them is not trained. Test pairs do not decide what is trained further.
    """
    scores = {}
    for system in RIVALS:
        stored = _stored(bundles / Run(system, scale, "adamw", "random").name)
        if stored is None:
            return None
        parts = stored.get("parts", {}).values()
        scores[system] = max((part.get("scores", {}).get("accuracy", 0.0) for part in parts), default=0.0)
    return max(scores, key=lambda system: scores[system])


def missing(planned: Sequence[Run], bundles: Path, corpus: str | None = None) -> list[Run]:
    """The runs whose bundle does not exist, or is of another corpus than the one with this hash."""
    out = []
    for run in planned:
        stored = _stored(bundles / run.name)
        if stored is None or (corpus is not None and stored.get("corpus", corpus) != corpus):
            out.append(run)
    return out


def _stored(bundle: Path) -> dict[str, Any] | None:
    """The contents of a bundle.json, None where there is none."""
    try:
        stored = json.loads((bundle / BUNDLE_FILE).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return stored if isinstance(stored, dict) else None
