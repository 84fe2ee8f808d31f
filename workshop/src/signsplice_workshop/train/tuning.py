"""Tuning the transition network to a user's lexicon, on a CPU; the result is kept only where it is better.

Every fifth word is held back. Stretches of the other words are hidden and filled, as in the first training. The words
held back decide: the exported graphs are compared by the product's own measure (``evaluation.hidden_frames``) with the
network before tuning and with the classical transition.
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
from signsplice.lexicon.lexicon import open_lexicon
from signsplice.motion import Clip, resample, rotation
from signsplice.rig.info import FEATURE_FPS, canonical_motion
from signsplice.rig.inspection import stray_frames
from signsplice.rig.rest_pose import with_rest_pose
from signsplice.splicing import features
from signsplice.splicing.bundle import BUNDLE_FILE, read_file
from signsplice.splicing.curves import find_transition
from signsplice.splicing.learned import LearnedTransition, open_sessions
from signsplice_workshop.corpora.training_data import canonical_bones
from signsplice_workshop.measure.hidden_frames import LENGTHS, SHOWN, hidden_frames
from signsplice_workshop.train import records
from signsplice_workshop.train.bundles import write_bundle
from signsplice_workshop.train.export import check_bundle_folder, product_graphs
from signsplice_workshop.train.gap_data import GapDataset, SignerMotion, signer_motion
from signsplice_workshop.train.loop import LoopConfig, ProgressCallback, train
from signsplice_workshop.train.networks import Bridge, BridgeConfig
from signsplice_workshop.train.prefetch import prefetch_batches
from signsplice_workshop.train.processes import Processes, only_one
from signsplice_workshop.train.tasks import BridgeTask
from signsplice_workshop.train.training import FILES
from signsplice_workshop.train.warm_start import load_graphs

HELD_BACK_EVERY = 5
"""One word of this many is held back."""
_MIN_FRAMES = LENGTHS[0] + 2 * SHOWN
(_FILE,) = FILES["transition"]


@dataclass(frozen=True)
class Tuning:
    """How to tune. The default number of steps takes two cores about a quarter of an hour.

    - steps: number of steps
    - batch: gaps in a batch
    - rate: highest learning rate
    - seed: of gaps and dropout
    """

    steps: int = 1500
    batch: int = 16
    rate: float = 2e-4
    seed: int = 0


@dataclass(frozen=True)
class TuningResult:
    """Mean position errors on the words held back, arm length / 1000, over all lengths of gaps.

    - classical: of the classical transition
    - before, after: of the network before and after tuning
    - n_train, n_held: number of words trained on, and held back
    """

    classical: float
    before: float
    after: float
    n_train: int
    n_held: int

    @property
    def better(self) -> bool:
        """Whether the tuned network is kept."""
        return self.after < self.before


def make(
    tuning: Tuning,
    lexicon: Path,
    source: Path,
    out: Path,
    processes: Processes,
    report_progress: ProgressCallback | None = None,
) -> TuningResult:
    """Tune the transition network of the bundle ``source`` to a lexicon; write the bundle ``out`` if it is better.

    The same call after an interruption continues from the last checkpoint, in a folder beside ``out``. Raises
    ``InputError`` where the lexicon has too few words, or the bundle no such network or no weights to start from.
    """
    if processes.count > 1:
        raise InputError(f"tuning with {processes.count} processes, expected one: it takes minutes")
    check_bundle_folder(out)
    clips, held = split(lexicon)
    config = open_sessions(source).config
    facts = {k: v for k, v in config.stored.items() if k != "precision"}
    network = network_from_bundle(facts, read_file(source, config, _FILE), source)
    settings: dict[str, Any] = {**asdict(tuning), "from": config.files[_FILE]}
    made_of = settings | {"words": [_fingerprint(clip) for clip in clips]}
    recipe = hashlib.sha256(json.dumps(made_of, sort_keys=True).encode()).hexdigest()[:12]
    folder = out.parent / "parts" / f"transition-tuned-{recipe}"
    folder.mkdir(parents=True, exist_ok=True)
    data, valid = ClipGapDataset(clips, tuning.seed), ClipGapDataset(held, tuning.seed, 128)
    torch.manual_seed(tuning.seed)
    task = BridgeTask(network, data.role_parents.tolist())
    loop = LoopConfig(
        tuning.steps, tuning.batch, tuning.rate, tuning.seed, max(1, tuning.steps // 5), 128,
        bf16=processes.device.type == "cuda",
    )  # fmt: skip
    with only_one(folder, processes), prefetch_batches(data) as batches:
        train(task, loop, batches, valid, folder, recipe, processes, report_progress)
    tuned = settings | {
        "words": len(clips),
        "command": _command(tuning, lexicon, source, processes),
        "data": records.folder_sha256(lexicon, "*"),
        "signsplice": records.software(),
    }
    files = {name: read_file(source, config, name) for name in config.files} | product_graphs(task, valid)
    trial = folder / "bundle"
    _write(trial, facts, files, tuned)
    result = compare(held, source, trial, len(clips))
    if result.better:
        scores = {"error": result.after, "error_before": result.before, "error_classical": result.classical}
        _write(out, facts, files, tuned | {"scores": scores})
    return result


def _command(tuning: Tuning, lexicon: Path, source: Path, processes: Processes) -> list[str]:
    options: dict[str, records.Option] = {
        "lexicon": lexicon, "from": source, "steps": tuning.steps, "seed": tuning.seed,
        "device": processes.device.type,
    }  # fmt: skip
    return records.command(["train", "transition"], options)


def _write(folder: Path, facts: Mapping[str, Any], files: Mapping[str, bytes], tuned: Mapping[str, Any]) -> None:
    """Write a bundle whose transition network says how it was tuned."""
    networks = facts["networks"]
    networks = networks | {"transition": networks["transition"] | {"tuned": tuned}}
    write_bundle(folder, {k: v for k, v in facts.items() if k != "files"} | {"networks": networks}, files)


def split(lexicon: Path) -> tuple[list[Clip], list[Clip]]:
    """Words to train on and words to hold back, at the networks' frame rate.

    Words without arms that the retargeting knows are left out, and those of fewer than 21 frames: the shortest gap with
    what the network sees on either side. Raises ``InputError`` where fewer than ten are left.
    """
    with open_lexicon(lexicon) as words:
        clips = [_without_stray_frames(words.clip(gloss)) for gloss in words]
    usable = [resample(clip, FEATURE_FPS) for clip in clips if _is_usable(clip)]
    if len(usable) < 2 * HELD_BACK_EVERY:
        raise InputError(
            f"{lexicon}: {len(usable)} of {len(clips)} words can be trained on (known arms, {_MIN_FRAMES} frames at "
            f"{FEATURE_FPS:g} a second), expected at least {2 * HELD_BACK_EVERY}"
        )
    return [clip for k, clip in enumerate(usable) if k % HELD_BACK_EVERY], usable[::HELD_BACK_EVERY]


def _without_stray_frames(clip: Clip) -> Clip:
    clip = with_rest_pose(clip)
    found = stray_frames(clip)
    return clip[found.start : found.stop]


def _is_usable(clip: Clip) -> bool:
    if clip.seconds * FEATURE_FPS < _MIN_FRAMES + 1:
        return False
    try:
        canonical_motion(clip[:1])
    except InputError:
        return False
    return True


def _fingerprint(clip: Clip) -> str:
    """A hash of all that training uses of a clip: its rotations and its skeleton, at the networks' frame rate."""
    skeleton = clip.skeleton
    parts = (repr(skeleton.names).encode(), skeleton.parents, skeleton.offsets, clip.local_rotations)
    whole = hashlib.sha256()
    for part in parts:
        whole.update(part if isinstance(part, bytes) else np.ascontiguousarray(part).tobytes())
    return whole.hexdigest()


class ClipGapDataset(GapDataset):
    """Gaps hidden in clips of any rigs. What people did is the target in full, and there are no idle stretches."""

    stretch_target, idle = 1.0, False

    def __init__(self, clips: Sequence[Clip], seed: int = 0, n_fixed: int | None = None) -> None:
        super().__init__((), seed, n_fixed)
        self.signers = [[_signer_motion(clip) for clip in clips]]

    def __len__(self) -> int:
        return self.n_fixed if self.n_fixed is not None else sum(len(one.sentences[0]) for one in self.signers[0])


def _signer_motion(clip: Clip) -> SignerMotion:
    trajectory = features.trajectory(canonical_motion(clip))
    quats = rotation.from_matrix(rotation.matrix_from_6d(trajectory.rotations_6d))
    bones = canonical_bones(clip.skeleton).astype(np.float32)
    return signer_motion(bones, trajectory.has_role, (rotation.continuous(quats),))


def network_from_bundle(facts: Mapping[str, Any], content: bytes, folder: Path) -> Bridge:
    """The transition network of a bundle, from its facts and its graph. Raises ``InputError`` where the facts name no
    sizes, or the graph lacks weights.
    """
    network_facts = facts.get("networks", {}).get("transition", {})
    if "config" not in network_facts:
        raise InputError(
            f"{folder / BUNDLE_FILE}: names no sizes of its transition network, so training cannot continue from it"
        )
    network = Bridge(BridgeConfig(**network_facts["config"]))
    load_graphs(network, [content], folder / _FILE)
    return network


def compare(held: Sequence[Clip], before: Path, after: Path, n_train: int) -> TuningResult:
    """Errors of two bundles' transitions and of the classical one on hidden frames of words held back."""
    lengths = [n for n in LENGTHS if any(len(clip) >= n + 2 * SHOWN for clip in held)]
    methods = (find_transition("hermite"), *(LearnedTransition(open_sessions(folder)) for folder in (before, after)))
    errors = [[row.position_error for row in hidden_frames(held, [method], lengths)] for method in methods]
    classical, was, now = (float(np.mean(one)) for one in errors)
    return TuningResult(classical, was, now, n_train, len(held))
