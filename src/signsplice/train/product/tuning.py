"""The transition network tuned to a user's own lexicon, on a CPU, and kept only where it is better.

Every fifth word is held back. The others teach by what they are: stretches of them are hidden and filled, as in the
first training. Whether the tuned network is better is told on the words held back, by the product's own measure
(``splicing.evaluate.hidden_frames``) of the exported graphs, beside the network it began from and the classical
transition.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from signsplice.errors import InputError
from signsplice.evaluation.hidden_frames import CONTEXT, LENGTHS, HiddenFrames, hidden_frames
from signsplice.lexicon.reader import open_lexicon
from signsplice.motion import rotation
from signsplice.motion.clip import Clip, resample
from signsplice.rig.canonical import FEATURE_FPS, canonical_bones, canonical_motion
from signsplice.splicing import features
from signsplice.splicing.bundle import BUNDLE_FILE, read_facts, read_file, write_bundle
from signsplice.splicing.learned import LearnedTransition, open_sessions
from signsplice.splicing.transition import find_transition
from signsplice.train.export import check_bundle_folder
from signsplice.train.loop import LoopConfig, ProgressCallback, train
from signsplice.train.prefetch import prefetched
from signsplice.train.processes import Processes, only_one
from signsplice.train.product.bridge_task import BridgeTask
from signsplice.train.product.gap_data import GapDataset, SignerData, signer_data
from signsplice.train.product.networks.bridge import Bridge, BridgeConfig
from signsplice.train.product.training import FILES, product_graphs
from signsplice.train.product.warm_start import load

EVERY = 5
"""One word of so many is held back."""
_SHORTEST = LENGTHS[0] + 2 * CONTEXT
(_FILE,) = FILES["transition"]


@dataclass(frozen=True)
class Tuning:
    """How to tune: steps, gaps a batch, rate, seed. As many steps as two cores make in about a quarter of an hour."""

    steps: int = 1500
    batch: int = 16
    rate: float = 2e-4
    seed: int = 0


@dataclass(frozen=True)
class Tuned:
    """What came of it: mean position error (arm / 1000) on the words held back of the classical transition, the network
    as it was and as it is, over lengths of gaps; how many words taught and judged.
    """

    classical: float
    before: float
    after: float
    n_learned: int
    n_held: int

    @property
    def better(self) -> bool:
        """Whether the tuned network is kept."""
        return self.after < self.before


def make(
    tuning: Tuning, lexicon: Path, source: Path, out: Path, processes: Processes, tell: ProgressCallback | None = None
) -> Tuned:
    """Tune the transition network of the bundle ``source`` to a lexicon; write the bundle ``out`` where it is better.

    Called again after an interruption it goes on from its last checkpoint, in a folder beside ``out``. Raises
    ``InputError`` where the lexicon has too few words, or the bundle no such network or no weights to go on from.
    """
    if processes.count > 1:
        raise InputError(f"tuning by {processes.count} processes, expected one: it takes minutes")
    check_bundle_folder(out)
    learned, held = split(lexicon)
    facts = {k: v for k, v in open_sessions(source).facts.items() if k != "precision"}
    content = read_file(source, facts, _FILE)
    network = begun(facts, content, source)
    told = {**asdict(tuning), "from": facts["files"][_FILE], "words": [_fingerprint(clip) for clip in learned]}
    recipe = hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()[:12]
    folder = out.parent / "parts" / f"transition-tuned-{recipe}"
    folder.mkdir(parents=True, exist_ok=True)
    data, valid = ClipGapDataset(learned, tuning.seed), ClipGapDataset(held, tuning.seed, 128)
    torch.manual_seed(tuning.seed)
    task = BridgeTask(network, data.above.tolist())
    loop = LoopConfig(
        tuning.steps, tuning.batch, "adamw", tuning.rate, tuning.seed, max(1, tuning.steps // 5), 128,
        bf16=processes.device.type == "cuda",
    )  # fmt: skip
    with only_one(folder), prefetched(data) as following:
        train(task, loop, following, valid, folder, recipe, lambda *_: float("nan"), processes, tell)
    trial = folder / "bundle"
    trial.mkdir(exist_ok=True)
    files = {name: read_file(source, facts, name) for name in facts["files"]} | product_graphs(task, valid)
    networks = facts["networks"] | {
        "transition": facts["networks"]["transition"] | {"tuned": told | {"words": len(learned)}}
    }
    write_bundle(trial, {k: v for k, v in facts.items() if k != "files"} | {"networks": networks}, files)
    outcome = judged(held, source, trial, len(learned))
    if outcome.better:
        out.mkdir(parents=True, exist_ok=True)
        trial_facts = read_facts(trial)
        scores = {"error": outcome.after, "error_before": outcome.before, "error_classical": outcome.classical}
        trial_facts["networks"]["transition"]["tuned"]["scores"] = scores
        write_bundle(out, {k: v for k, v in trial_facts.items() if k != "files"}, files)
    return outcome


def split(lexicon: Path) -> tuple[list[Clip], list[Clip]]:
    """Words to learn from and to judge on, at the networks' rate, those without known arms or of fewer than 21 frames
    left out: a gap with what is shown on either side. Raises ``InputError`` for fewer than ten.
    """
    with open_lexicon(lexicon) as words:
        clips = [words.clip(gloss) for gloss in words]
    usable = [resample(clip, FEATURE_FPS) for clip in clips if _usable(clip)]
    if len(usable) < 2 * EVERY:
        raise InputError(
            f"{lexicon}: {len(usable)} of {len(clips)} words can teach (known arms, {_SHORTEST} frames at "
            f"{FEATURE_FPS:g} a second), expected at least {2 * EVERY}"
        )
    return [c for k, c in enumerate(usable) if k % EVERY], usable[::EVERY]


def _usable(clip: Clip) -> bool:
    if clip.seconds * FEATURE_FPS < _SHORTEST + 1:
        return False
    try:
        canonical_motion(clip[:1])
    except InputError:
        return False
    return True


def _fingerprint(clip: Clip) -> str:
    return hashlib.sha256(np.ascontiguousarray(clip.local_rotations).tobytes()).hexdigest()[:16]


class ClipGapDataset(GapDataset):
    """Gaps drawn from clips of any rigs, as they are seen at the networks' rate; what people did is taught whole, and
    nothing else.
    """

    sure, idle = 1.0, False

    def __init__(self, clips: Sequence[Clip], seed: int = 0, fixed: int | None = None) -> None:
        super().__init__((), seed, fixed)
        self.parts = [[_part(clip) for clip in clips]]

    def __len__(self) -> int:
        return self.fixed if self.fixed is not None else sum(len(part.sentences[0]) for part in self.parts[0])


def _part(clip: Clip) -> SignerData:
    own = features.trajectory(canonical_motion(clip))
    turns = rotation.from_matrix(rotation.matrix_from_6d(own.rotations_6d))
    return signer_data(canonical_bones(clip.skeleton).astype(np.float32), own.has_role, (rotation.continuous(turns),))


def begun(facts: Mapping[str, Any], content: bytes, folder: Path) -> Bridge:
    """The network of a bundle with its weights, which its graph holds by name. Raises ``InputError`` where it does
    not.
    """
    told = facts.get("networks", {}).get("transition", {})
    if "config" not in told:
        raise InputError(
            f"{folder / BUNDLE_FILE}: says no sizes of its transition network, so that it cannot be trained on"
        )
    network = Bridge(BridgeConfig(**told["config"]))
    load(network, [content], folder / _FILE)
    return network


def judged(held: Sequence[Clip], before: Path, after: Path, n_learned: int) -> Tuned:
    """Both bundles' transitions and the classical one on hidden frames of words that taught neither."""
    lengths = [n for n in LENGTHS if any(len(clip) >= n + 2 * CONTEXT for clip in held)]
    methods = (find_transition("hermite"), *(LearnedTransition(open_sessions(folder)) for folder in (before, after)))
    classical, was, now = (_mean_error(hidden_frames(held, [method], lengths)) for method in methods)
    return Tuned(classical, was, now, n_learned, len(held))


def _mean_error(rows: Sequence[HiddenFrames]) -> float:
    return float(np.mean([row.position_error for row in rows]))
