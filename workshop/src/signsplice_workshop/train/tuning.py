"""Tunes the transition network to a user's lexicon, on a CPU; the result is kept only if it is better.

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
from signsplice.rig.inspection import motion_span
from signsplice.rig.rest_pose import with_rest_pose
from signsplice.splicing import features
from signsplice.splicing.bundle import BUNDLE_FILE, read_file
from signsplice.splicing.curves import find_transition
from signsplice.splicing.learned import LearnedTransition, open_sessions
from signsplice_workshop.corpora.training_data import measure_canonical_bones
from signsplice_workshop.measure.hidden_frames import LENGTHS, SHOWN, score_hidden_frames
from signsplice_workshop.train import records
from signsplice_workshop.train.bundles import write_bundle
from signsplice_workshop.train.export import check_bundle_folder, export_product_graphs
from signsplice_workshop.train.gap_data import GapDataset, SignerMotion, make_signer_motion
from signsplice_workshop.train.loop import LoopConfig, ProgressCallback, train
from signsplice_workshop.train.networks import Bridge, BridgeConfig
from signsplice_workshop.train.prefetch import prefetch_batches
from signsplice_workshop.train.processes import Processes, lock_folder
from signsplice_workshop.train.tasks import BridgeTask
from signsplice_workshop.train.training import FILES
from signsplice_workshop.train.warm_start import load_graphs

HELD_BACK_EVERY = 5
"""One word of this many is held back."""
_MIN_FRAMES = LENGTHS[0] + 2 * SHOWN
(_FILE,) = FILES["transition"]


@dataclass(frozen=True)
class Tuning:
    """The settings of a tuning. The default number of steps takes two cores about a quarter of an hour.

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
        """Returns whether the tuned network is kept."""
        return self.after < self.before


def make(
    tuning: Tuning,
    lexicon: Path,
    source: Path,
    output_folder: Path,
    processes: Processes,
    report_progress: ProgressCallback | None = None,
) -> TuningResult:
    """Tunes the transition network of the bundle ``source`` to a lexicon; writes the bundle ``output_folder`` if it is
    better.

    The same call after an interruption continues from the last checkpoint, in a folder beside ``output_folder``. Raises
    ``InputError`` if the lexicon has too few words, or the bundle no such network or no weights to start from.
    """
    if processes.count > 1:
        raise InputError(f"tuning with {processes.count} processes, expected one: it takes minutes")
    check_bundle_folder(output_folder)
    clips, held_out = split(lexicon)
    config = open_sessions(source).config
    facts = {k: v for k, v in config.stored.items() if k != "precision"}
    network = read_network(facts, read_file(source, config, _FILE), source)
    settings: dict[str, Any] = {**asdict(tuning), "from": config.files[_FILE]}
    recipe_fields = settings | {"words": [_hash_clip(clip) for clip in clips]}
    recipe = hashlib.sha256(json.dumps(recipe_fields, sort_keys=True).encode()).hexdigest()[:12]
    folder = output_folder.parent / "parts" / f"transition-tuned-{recipe}"
    folder.mkdir(parents=True, exist_ok=True)
    data, valid = ClipGapDataset(clips, tuning.seed), ClipGapDataset(held_out, tuning.seed, 128)
    torch.manual_seed(tuning.seed)
    task = BridgeTask(network, data.role_parents.tolist())
    loop = LoopConfig(
        tuning.steps, tuning.batch, tuning.rate, tuning.seed, max(1, tuning.steps // 5), 128,
        bf16=processes.device.type == "cuda",
    )  # fmt: skip
    with lock_folder(folder, processes), prefetch_batches(data) as batches:
        train(task, loop, batches, valid, folder, recipe, processes, report_progress)
    tuned = settings | {
        "words": len(clips),
        "command": _format_command(tuning, lexicon, source, processes),
        "data": records.hash_folder(lexicon, "*"),
        "signsplice": records.find_version(),
    }
    files = {name: read_file(source, config, name) for name in config.files} | export_product_graphs(task, valid)
    trial = folder / "bundle"
    _write(trial, facts, files, tuned)
    result = compare(held_out, source, trial, len(clips))
    if result.better:
        scores = {"error": result.after, "error_before": result.before, "error_classical": result.classical}
        _write(output_folder, facts, files, tuned | {"scores": scores})
    return result


def _format_command(tuning: Tuning, lexicon: Path, source: Path, processes: Processes) -> list[str]:
    options: dict[str, records.Option] = {
        "lexicon": lexicon, "from": source, "steps": tuning.steps, "seed": tuning.seed,
        "device": processes.device.type,
    }  # fmt: skip
    return records.format_command(["train", "transition"], options)


def _write(folder: Path, facts: Mapping[str, Any], files: Mapping[str, bytes], tuned: Mapping[str, Any]) -> None:
    """Writes a bundle whose transition network says how it was tuned."""
    networks = facts["networks"]
    networks = networks | {"transition": networks["transition"] | {"tuned": tuned}}
    write_bundle(folder, {k: v for k, v in facts.items() if k != "files"} | {"networks": networks}, files)


def split(lexicon: Path) -> tuple[list[Clip], list[Clip]]:
    """Returns words to train on and words to hold back, at the networks' frame rate.

    Words without arms that the retargeting knows are left out, and those of fewer than 21 frames: the shortest gap with
    what the network sees on either side. Raises ``InputError`` if fewer than ten remain.
    """
    with open_lexicon(lexicon) as words:
        clips = [_cut_stray_frames(words.clip(gloss)) for gloss in words]
    usable = [resample(clip, FEATURE_FPS) for clip in clips if _is_usable(clip)]
    if len(usable) < 2 * HELD_BACK_EVERY:
        raise InputError(
            f"{lexicon}: {len(usable)} of {len(clips)} words can be trained on (known arms, {_MIN_FRAMES} frames at "
            f"{FEATURE_FPS:g} a second), expected at least {2 * HELD_BACK_EVERY}"
        )
    return [clip for k, clip in enumerate(usable) if k % HELD_BACK_EVERY], usable[::HELD_BACK_EVERY]


def _cut_stray_frames(clip: Clip) -> Clip:
    clip = with_rest_pose(clip)
    signing = motion_span(clip)
    return clip[signing.start : signing.stop]


def _is_usable(clip: Clip) -> bool:
    if clip.seconds * FEATURE_FPS < _MIN_FRAMES + 1:
        return False
    try:
        canonical_motion(clip[:1])
    except InputError:
        return False
    return True


def _hash_clip(clip: Clip) -> str:
    """Returns a hash of all that training uses of a clip: its rotations and its skeleton, at the networks' frame
    rate.
    """
    skeleton = clip.skeleton
    contents = (repr(skeleton.names).encode(), skeleton.parents, skeleton.offsets, clip.local_rotations)
    digest = hashlib.sha256()
    for content in contents:
        digest.update(content if isinstance(content, bytes) else np.ascontiguousarray(content).tobytes())
    return digest.hexdigest()


class ClipGapDataset(GapDataset):
    """Gaps hidden in clips of any rigs. People's motion is the target in full, and there are no idle stretches."""

    stretch_target, idle = 1.0, False

    def __init__(self, clips: Sequence[Clip], seed: int = 0, n_fixed: int | None = None) -> None:
        super().__init__((), seed, n_fixed)
        self.signers = [[_make_signer_motion(clip) for clip in clips]]

    def __len__(self) -> int:
        return self.n_fixed if self.n_fixed is not None else sum(len(signer.sentences[0]) for signer in self.signers[0])


def _make_signer_motion(clip: Clip) -> SignerMotion:
    trajectory = features.trajectory(canonical_motion(clip))
    quats = rotation.from_matrix(rotation.matrix_from_6d(trajectory.rotations_6d))
    bones = measure_canonical_bones(clip.skeleton).astype(np.float32)
    return make_signer_motion(bones, trajectory.has_role, (rotation.continuous(quats),))


def read_network(facts: Mapping[str, Any], content: bytes, folder: Path) -> Bridge:
    """Returns the transition network of a bundle, from its facts and its graph. Raises ``InputError`` if the facts name
    no sizes, or the graph lacks weights.
    """
    network_facts = facts.get("networks", {}).get("transition", {})
    if "config" not in network_facts:
        raise InputError(
            f"{folder / BUNDLE_FILE}: names no sizes of its transition network, so training cannot continue from it"
        )
    network = Bridge(BridgeConfig(**network_facts["config"]))
    load_graphs(network, [content], folder / _FILE)
    return network


def compare(held_out: Sequence[Clip], bundle_before: Path, bundle_after: Path, n_train: int) -> TuningResult:
    """Returns the errors of two bundles' transitions and of the classical one on hidden frames of words held back."""
    lengths = [length for length in LENGTHS if any(len(clip) >= length + 2 * SHOWN for clip in held_out)]
    methods = (
        find_transition("hermite"),
        *(LearnedTransition(open_sessions(folder)) for folder in (bundle_before, bundle_after)),
    )
    errors = [[row.position_error for row in score_hidden_frames(held_out, [method], lengths)] for method in methods]
    classical, error_before, error_after = (float(np.mean(method_errors)) for method_errors in errors)
    return TuningResult(classical, error_before, error_after, n_train, len(held_out))
