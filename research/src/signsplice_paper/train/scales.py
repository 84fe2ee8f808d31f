"""The parts of each system, their sizes, and how long they are trained, for every scale.

The parts of a system are trained separately: a splice position is a choice, so that no gradient passes from TFGN
through Culling to SPSN, and joint training would equal separate training. LpTransformer and its ablations share parts,
so that comparing them compares designs, not random initial weights.

smoke: everything in minutes, to test the pipeline. small: fewer layers than cpu and a fifth of its steps, for table 1
on ten to thirty words of one's own. cpu: small networks, some hours on two cores. paper: the sizes of the paper (512
units everywhere, 6 + 6 and 20 + 20 layers, 8 heads), which need a GPU.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

from signsplice.errors import InputError
from signsplice_paper.plan import SCALES
from signsplice_paper.published import BEST_FR
from signsplice_paper.train.networks.convs2s import ConvS2S, ConvS2SConfig
from signsplice_paper.train.networks.generator import Generator
from signsplice_paper.train.networks.layers import Normaliser
from signsplice_paper.train.networks.lstm import LstmConfig, LstmSeq2Seq
from signsplice_paper.train.networks.spsn import Spsn, SpsnConfig
from signsplice_paper.train.networks.tfgn import Transformer, TransformerConfig
from signsplice_paper.train.networks.word_spsn import WordSpsn, WordSpsnConfig
from signsplice_paper.train.tasks import FrameTask, TokenTask, WordTask
from signsplice_workshop.corpora.readable_pairs import TAUGHT
from signsplice_workshop.train.tasks import Task

FR = BEST_FR
"""Frames that Culling keeps on each side: the paper's choice after its sweep."""

SYSTEMS: dict[str, tuple[str, ...]] = {
    "lptransformer": ("spsn", "tfgn"),
    "lpt-plus": ("spsn-words", "tfgn"),
    "conv-s2s": ("conv-s2s",),
    "lstm": ("lstm",),
    "transformer": ("transformer",),
    "lptransformer-printed": ("spsn-printed", "tfgn"),
    "conv-s2s-printed": ("conv-s2s-printed",),
    "lstm-printed": ("lstm-printed",),
    "transformer-printed": ("transformer-printed",),
    "lptransformer-wa": ("spsn-wa", "tfgn"),
    "lptransformer-wc": ("spsn", "tfgn-wc"),
    "lptransformer-wac": ("spsn-wa", "tfgn-wc"),
}
"""System -> its parts: the one for positions, if it is separate, then the one for frames. The ``-printed`` ones learn
positions by plain cross-entropy, and have no bias of the tokens: both are additions of ours (``published.CONDITIONS``).
"""

CULLED = ("tfgn",)
"""Parts that see ``fr`` frames on each side of the splice instead of the whole X."""
AS_PRINTED = "-printed"
"""Suffix of the name of parts that differ from another part in the loss alone."""

Config = SpsnConfig | WordSpsnConfig | TransformerConfig | ConvS2SConfig | LstmConfig


@dataclass(frozen=True)
class SystemPart:
    """A network and its training.

    - name: name of the part
    - config: sizes of the network
    - fr: frames that it sees on each side of the splice, None for all
    - steps: training steps
    - batch: pairs per batch
    - rate: highest learning rate of AdamW; SGD has the paper's
    - plain_loss: whether positions are learned with plain cross-entropy, as printed
    """

    name: str
    config: Config
    fr: int | None
    steps: int
    batch: int
    rate: float
    plain_loss: bool = False

    def facts(self) -> dict[str, Any]:
        """Returns the part as JSON, for bundle.json and for the hash in the name of its checkpoints."""
        return {"config": asdict(self.config), **{k: v for k, v in asdict(self).items() if k not in ("name", "config")}}


def _transformer_config(scale: str) -> TransformerConfig:
    sizes = {
        "smoke": TransformerConfig(32, 2, 1, 1, 64, 0.0),
        "small": TransformerConfig(64, 4, 2, 2, 256, 0.0),
        "cpu": TransformerConfig(64, 8, 3, 3, 256, 0.0),
        "paper": TransformerConfig(),
    }
    return sizes[scale]


def _network_config(name: str, scale: str) -> Config:
    width = {"smoke": 32, "small": 64, "cpu": 64, "paper": 512}[scale]
    dropout = 0.0 if scale == "smoke" else 0.1
    transformer = _transformer_config(scale)
    full_input = replace(transformer, inner=transformer.inner // 2) if scale in ("small", "cpu") else transformer
    configs: dict[str, Config] = {
        "spsn": SpsnConfig(width, dropout=dropout),
        "spsn-words": WordSpsnConfig(width, width, dropout),
        "spsn-wa": SpsnConfig(width, attention=False, dropout=dropout),
        "tfgn": transformer,
        "tfgn-wc": replace(full_input, marks=True),
        "transformer": replace(full_input, tokens=True, steps=True),
        "conv-s2s": _convs2s_config(scale),
        "lstm": LstmConfig(width),
    }
    return configs[name.removesuffix(AS_PRINTED)]


def _convs2s_config(scale: str) -> ConvS2SConfig:
    sizes = {
        "smoke": ConvS2SConfig(16, 3, 3, 0.0),
        "small": ConvS2SConfig(32, 10, 10, 0.0),
        "cpu": ConvS2SConfig(32, 20, 20, 0.0),
        "paper": ConvS2SConfig(),
    }
    return sizes[scale]


@dataclass(frozen=True)
class _PartSchedule:
    """The training of a part.

    - steps: at smoke, cpu and paper scale
    - batch: pairs per batch at cpu scale
    - rate: AdamW's rate at cpu scale
    """

    steps: tuple[int, int, int]
    batch: int = 64
    rate: float = 1e-3


_SCHEDULES = {
    "spsn": _PartSchedule((60, 10_000, 60_000), 16, 3e-3),
    "spsn-words": _PartSchedule((60, 4000, 60_000), 24, 3e-3),
    "spsn-wa": _PartSchedule((60, 10_000, 60_000), 16, 3e-3),
    "tfgn": _PartSchedule((60, 3000, 60_000), rate=2e-3),
    "tfgn-wc": _PartSchedule((60, 1200, 60_000), 32, 2e-3),
    "transformer": _PartSchedule((60, 3000, 60_000), 32, 3e-3),
    "conv-s2s": _PartSchedule((60, 1000, 60_000), 32, 2.1e-3),
    "conv-s2s-printed": _PartSchedule((60, 1000, 60_000), 32, 7e-4),  # by 2.1e-3 it diverged
    "lstm": _PartSchedule((60, 10_000, 60_000), 32, 3e-3),
}
"""At cpu scale every system is trained for about 10 minutes of one core, two thirds of them for SPSN. Their
steps differ in cost several times over.
"""

SMALL = 0.2
"""Ratio of scale small's steps to scale cpu's. Batches and rates are those of scale cpu."""
STEP_FRACTIONS = {("small", "adamw"): SMALL, ("cpu", "sgd"): 5.0, ("paper", "sgd"): 5.0, ("cpu", TAUGHT): 3.0}
"""Multiples of the steps. SGD is trained until validation stops improving, which takes many times AdamW's steps; for it
these are a limit. A corpus to teach on has a hundred times as many words.
"""
SGD_PATIENCE = 4
"""Validations in a row, a fortieth of the limit apart, that have to improve the loss for SGD to go on."""
MOST_SGD_CPU_S = {"cpu": 400.0}
"""Processor seconds of a part's training by SGD, about as many as by AdamW."""


def make_parts(
    system: str,
    scale: str,
    fr: int | None = None,
    steps: int | None = None,
    optimiser: str = "adamw",
    split: str = "random",
) -> tuple[SystemPart, ...]:
    """Returns a system's parts at a scale. With 0 ``steps`` they stay untrained, which is enough to measure their size
    and time.

    Raises ``InputError`` for an unknown name, numbers out of range, and an ``fr`` for a system without Culling.
    """
    if system not in SYSTEMS:
        raise InputError(f"no system {system!r}, expected all or one of {', '.join(SYSTEMS)}")
    if scale not in SCALES:
        raise InputError(f"no scale {scale!r}, expected one of {', '.join(SCALES)}")
    names = SYSTEMS[system]
    if fr is not None and not any(name in CULLED for name in names):
        raise InputError(f"--fr {fr}, but {system} has no Culling layer; leave it out")
    for option, value, least in (("--fr", fr, 1), ("--steps", steps, 0)):
        if value is not None and value < least:
            raise InputError(f"{option} {value}, expected at least {least}")
    frames_per_side = FR if fr is None else fr
    column = ("smoke", "cpu", "paper").index("cpu" if scale == "small" else scale)
    fraction = STEP_FRACTIONS.get((scale, optimiser), 1.0) * STEP_FRACTIONS.get((scale, split), 1.0)
    return tuple(
        SystemPart(
            name,
            _network_config(name, scale),
            frames_per_side if name in CULLED else None,
            round(fraction * schedule.steps[column]) if steps is None else steps,
            (16, schedule.batch, 64)[column],
            (1e-2, schedule.rate, 3e-4)[column],
            name.endswith(AS_PRINTED),
        )
        for name, schedule in (
            (name, _SCHEDULES.get(name) or _SCHEDULES[name.removesuffix(AS_PRINTED)]) for name in names
        )
    )


def make_task(part: SystemPart, normaliser: Normaliser, seed: int) -> Task:
    """Returns a part's network with its loss."""
    network = make_network(part.config, normaliser)
    if isinstance(network, Spsn):
        return TokenTask(network, part.plain_loss)
    if isinstance(network, WordSpsn):
        return WordTask(network)
    return FrameTask(network, normaliser, seed, part.plain_loss)


def make_network(config: Config, normaliser: Normaliser) -> Spsn | WordSpsn | Generator:
    """Returns the network with these sizes."""
    if isinstance(config, SpsnConfig):
        return Spsn(config, normaliser)
    if isinstance(config, WordSpsnConfig):
        return WordSpsn(config, normaliser)
    if isinstance(config, TransformerConfig):
        return Transformer(config, normaliser)
    if isinstance(config, ConvS2SConfig):
        return ConvS2S(config, normaliser)
    return LstmSeq2Seq(config, normaliser)
