"""Training a system of the paper from a corpus of pairs to a bundle: its parts are trained, exported and combined."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import onnx
import torch

from signsplice.errors import InputError
from signsplice.formats.atomic import replacing_folder
from signsplice.formats.reading import read_bytes
from signsplice.rig.info import rig_info
from signsplice.splicing.runtime import onnxruntime
from signsplice_paper.train import stopping
from signsplice_paper.train.graphs import export_paper_graphs
from signsplice_paper.train.networks.generator import Generator
from signsplice_paper.train.networks.word_spsn import WordSpsn, WordSpsnConfig
from signsplice_paper.train.pairs_data import PairsData
from signsplice_paper.train.scales import MOST_SGD_CPU_S, SGD_PATIENCE, SystemPart, make_parts, make_task
from signsplice_paper.train.stopping import PaperLoop, highest_rate
from signsplice_paper.train.tasks import MOST_FRAMES, fit_token_bias
from signsplice_paper.train.words_data import WordsData, load_split_words
from signsplice_workshop.corpora.pairs import Pairs
from signsplice_workshop.train import checkpoint, records
from signsplice_workshop.train.bundles import write_bundle
from signsplice_workshop.train.export import FLOAT16, cast_weights_to_float16, check_bundle_folder
from signsplice_workshop.train.loop import ProgressCallback, train
from signsplice_workshop.train.prefetch import prefetch_batches
from signsplice_workshop.train.processes import Processes, lock_folder
from signsplice_workshop.train.tasks import Task

GRAPHS = "graphs"
"""Folder of a part's graphs, next to its checkpoint."""
DATA_FILE = "data.json"
"""The sha256 of the data that a part of a system of the paper is trained on, in the part's folder."""


@dataclass(frozen=True)
class Training:
    """A training of a system.

    - system: one of ``scales.SYSTEMS``
    - scale: one of ``scales.SCALES``
    - optimiser: adamw or sgd
    - split: the split whose training part is learned from
    - seed: of weights, batches and noise
    - fr: frames that Culling keeps on each side, None for the default
    - steps: steps of every part, None for those of the scale
    - bf16: whether to compute in bfloat16, None for GPUs only
    - n_judgements: number of validations of a part, None for 4 at smoke scale, else 20, by SGD 40
    - n_judged: number of validation pairs
    - deadline: value of ``time.monotonic`` at which this call is interrupted, None for never
    """

    system: str
    scale: str
    optimiser: str = "adamw"
    split: str = "random"
    seed: int = 0
    fr: int | None = None
    steps: int | None = None
    bf16: bool | None = None
    n_judgements: int | None = None
    n_judged: int = 256
    deadline: float | None = None

    @property
    def patience(self) -> int | None:
        """Number of validations without improvement that ends the training of a part; None: it ends after all steps."""
        return SGD_PATIENCE if self.optimiser == "sgd" else None


def make(
    training: Training,
    pairs: Pairs,
    bundle_folder: Path,
    shared: Path,
    processes: Processes,
    progress: Callable[[str], ProgressCallback] | None = None,
) -> None:
    """Trains a system's parts that are not trained yet, and writes the bundle into ``bundle_folder``.

    ``shared`` holds a folder of checkpoints for each part, where other systems with the same parts find them. The same
    call after an interruption continues from the last checkpoint. ``progress``: name of a part -> callback.
    Raises ``DeadlineError``, and writes no bundle, if the deadline interrupts a part.
    """
    system_parts = make_parts(
        training.system, training.scale, training.fr, training.steps, training.optimiser, training.split
    )
    system_parts = tuple(fit_to_skeleton(part, pairs) for part in system_parts)
    check_bundle_folder(bundle_folder)
    bundle_folder.parent.mkdir(parents=True, exist_ok=True)
    tasks = []
    for part in system_parts:
        folder = part_folder(shared, part, training, pairs)
        folder.mkdir(parents=True, exist_ok=True)
        with lock_folder(folder, processes):
            if processes.first:
                record_corpus_data(pairs.folder, folder)
            callback = None if progress is None else progress(part.name)
            tasks.append(train_part(part, training, pairs, folder, processes, callback))
    if processes.first:
        _write(
            training,
            pairs,
            system_parts,
            tasks,
            bundle_folder,
            [part_folder(shared, part, training, pairs) for part in system_parts],
        )


def fit_to_skeleton(part: SystemPart, pairs: Pairs) -> SystemPart:
    """Returns the part for the joints of a corpus. Raises ``InputError`` if the numbers lack a wrist that it needs."""
    if not isinstance(part.config, WordSpsnConfig):
        return part
    space, skeleton = pairs.spaces[0], pairs.skeletons[0]
    role_joints, index_by_name = rig_info(skeleton).roles.joints, {name: k for k, name in enumerate(space.joints)}
    hands = []
    for side in ("left", "right"):
        hand_roles = (f"{side}Hand", *(f"{side}{finger}Distal" for finger in ("Index", "Middle", "Ring", "Little")))
        joint_names = [skeleton.names[role_joints[role]] for role in hand_roles if role in role_joints]
        hands.append(tuple(index_by_name[name] for name in joint_names if name in index_by_name))
        if not hands[-1]:
            raise InputError(f"{pairs.folder}: its numbers hold no {side} wrist, which {part.name} needs")
    return replace(part, config=replace(part.config, parents=space.parents, hands=tuple(hands)))


def recipe(part: SystemPart, training: Training, pairs: Pairs) -> str:
    """Returns twelve hex digits that depend on everything that a part's training is given, but not on the code."""
    inputs = {
        "part": part.name,
        **part.facts(),
        "optimiser": training.optimiser,
        "split": training.split,
        "seed": training.seed,
        "corpus": pairs.head["hash"],
    }
    return hashlib.sha256(json.dumps(inputs, sort_keys=True).encode()).hexdigest()[:12]


def part_folder(shared: Path, part: SystemPart, training: Training, pairs: Pairs) -> Path:
    """Returns the folder of a part's checkpoint and log."""
    fr = "" if part.fr is None else f"-fr{part.fr}"
    name = f"{part.name}{fr}-{training.scale}-{training.optimiser}-{training.split}-seed{training.seed}"
    return shared / f"{name}-{recipe(part, training, pairs)}"


def train_part(
    part: SystemPart,
    training: Training,
    pairs: Pairs,
    folder: Path,
    processes: Processes,
    progress: ProgressCallback | None = None,
    until: int | None = None,
) -> Task:
    """Trains a part and returns its task; ``until``: the step to stop at."""
    data, valid = (load_data(part, pairs, training.split, name) for name in ("train", "valid"))
    if not len(data):
        raise InputError(f"{pairs.folder}: no pair in {training.split} train; make a corpus of more words")
    by_sgd = training.optimiser == "sgd"
    n_judgements = training.n_judgements or (4 if training.scale == "smoke" else 40 if by_sgd else 20)
    most_cpu_s = MOST_SGD_CPU_S.get(training.scale) if by_sgd and training.steps is None else None
    torch.manual_seed(training.seed)
    part_task = make_task(part, data.normaliser(), training.seed)
    if isinstance(part_task.network, WordSpsn):
        assert isinstance(data, WordsData)
        part_task.network.fit_measures(data.words)
    loop = PaperLoop(
        steps=part.steps,
        batch=part.batch,
        method=training.optimiser,
        rate=highest_rate(training.optimiser, part.rate),
        seed=training.seed,
        every=max(1, part.steps // n_judgements),
        n_judged=training.n_judged,
        bf16=processes.device.type == "cuda" if training.bf16 is None else training.bf16,
        until=until,
        snapshots=training.scale != "paper",  # each is 0.2 GB there
        patience=training.patience,
        most_cpu_s=most_cpu_s,
        deadline=training.deadline,
    )
    on_gpu = processes.device.type == "cuda"  # a GPU would wait for batches; on a processor both share the cores
    with prefetch_batches(data, processes.rank, processes.count) if on_gpu else nullcontext(data) as batches:
        train(part_task, loop, batches, valid, folder, recipe(part, training, pairs), processes, progress)
    return part_task


def load_data(part: SystemPart, pairs: Pairs, split: str, name: str) -> PairsData | WordsData:
    """Returns the data that a part learns from: pairs, or words of which all pairs are taught at once."""
    if isinstance(part.config, WordSpsnConfig):
        return load_split_words(pairs, split, name)
    return PairsData(pairs, split, name, part.fr)


def _write(
    training: Training,
    pairs: Pairs,
    system_parts: tuple[SystemPart, ...],
    tasks: list[Task],
    bundle_folder: Path,
    folders: list[Path],
) -> None:
    files: dict[str, bytes] = {}
    for part, part_task, folder in zip(system_parts, tasks, folders, strict=True):
        files |= _export_graphs(part, part_task, folder)
    contents = facts(training, pairs, system_parts, tasks, folders) | _provenance(training, pairs, folders)
    if (
        training.steps != 0
        and not system_parts[0].plain_loss
        and not isinstance(system_parts[0].config, WordSpsnConfig)
    ):
        contents["runs"]["token_bias"] = fit_token_bias(tasks[0], PairsData(pairs, training.split, "valid"))
    logs = {
        f"{part.name}.jsonl": read_bytes(folder / records.LOG_FILE)
        for part, folder in zip(system_parts, folders, strict=True)
    }
    write_bundle(bundle_folder, contents, files, logs)


def record_corpus_data(corpus: Path, folder: Path) -> dict[str, str] | None:
    """Returns the sha256 of every file of a corpus of pairs, by name, and records them in the ``folder`` of a training
    on it.

    Returns None if the folder's checkpoint is older than such records, so that its data are unknown.
    Raises ``InputError`` if the folder records other data.
    """
    data = records.hash_folder(corpus, "corpus.json", "*.npy")
    path = folder / DATA_FILE
    if path.exists():
        recorded: dict[str, str] = json.loads(path.read_text(encoding="utf-8"))
        changed = sorted(name for name in recorded.keys() | data.keys() if recorded.get(name) != data.get(name))
        if changed:
            raise InputError(
                f"{folder}: was trained on data in which {', '.join(changed)} differed; name another folder for the "
                "checkpoints, or remove this one"
            )
        return data
    if (folder / checkpoint.NAME).exists():
        return None
    records.write_json(path, data)
    return data


def _provenance(training: Training, pairs: Pairs, folders: list[Path]) -> dict[str, Any]:
    """Returns the command that makes a bundle, and the sha256 of its data; None if a part's data are unknown."""
    options: dict[str, records.Option] = {
        "pairs": pairs.folder, "system": training.system, "scale": training.scale, "optimiser": training.optimiser,
        "split": training.split, "fr": training.fr, "steps": training.steps, "seed": training.seed,
        "bf16": training.bf16,
    }  # fmt: skip
    data = [record_corpus_data(pairs.folder, folder) for folder in folders]
    return {
        "command": records.format_command(["train-system"], options, "signsplice-paper"),
        "data": None if None in data else data[0],
        "signsplice": records.find_version(),
    }


def _export_graphs(part: SystemPart, part_task: Task, folder: Path) -> dict[str, bytes]:
    """Returns a part's graphs, with 16-bit weights; graphs next to its checkpoint are reused if they are newer."""
    graphs_folder = folder / GRAPHS
    if graphs_folder.is_dir() and graphs_folder.stat().st_mtime_ns > (folder / checkpoint.NAME).stat().st_mtime_ns:
        return {path.name: read_bytes(path) for path in sorted(graphs_folder.iterdir())}
    files = {
        name: cast_weights_to_float16(content)
        for name, content in export_paper_graphs(part_task.network, part.fr).items()
    }
    with replacing_folder(graphs_folder) as temporary_folder:
        for name, content in files.items():
            (temporary_folder / name).write_bytes(content)
    return files


def combine_reasons(reasons: Sequence[str]) -> str:
    """Returns why a system's training ended: time if any part's did, else steps if any part's did, else plateau."""
    return next((reason for reason in (stopping.TIME, stopping.STEPS) if reason in reasons), stopping.PLATEAU)


def facts(
    training: Training, pairs: Pairs, system_parts: tuple[SystemPart, ...], tasks: list[Task], folders: list[Path]
) -> dict[str, Any]:
    """Returns the contents of bundle.json without its files; ``folders`` hold the parts' logs."""
    generator = tasks[-1].network
    assert isinstance(generator, Generator)
    normaliser = generator.normaliser
    endings = [
        stopping.find_reason(folder, part.steps, training.patience)
        for part, folder in zip(system_parts, folders, strict=True)
    ]
    return {
        "system": training.system,
        "precision": FLOAT16,
        "config": {part.name: part.facts()["config"] for part in system_parts},
        "scale": training.scale,
        "optimiser": training.optimiser,
        "split": training.split,
        "corpus": pairs.head["hash"],
        "fps": pairs.head["fps"],
        "seed": training.seed,
        "steps": sum(step for step, _ in endings),
        "stopped": combine_reasons([reason for _, reason in endings]),
        "fr": system_parts[-1].fr,
        "parts": {
            part.name: {
                **{k: v for k, v in part.facts().items() if k != "config"},
                "rate": highest_rate(training.optimiser, part.rate),
                "steps": step,
                "stopped": reason,
                "scores": _read_last_scores(folder),
            }
            for part, folder, (step, reason) in zip(system_parts, folders, endings, strict=True)
        },
        "normaliser": {"mean": normaliser.mean.tolist(), "deviation": normaliser.deviation.tolist()},
        "n_parameters": sum(parameter.numel() for part_task in tasks for parameter in part_task.network.parameters()),
        "versions": {"torch": torch.__version__, "onnx": onnx.__version__, "onnxruntime": onnxruntime.__version__},
        "runs": {
            "positions": "encoder" if len(system_parts) == 1 else "spsn",
            "frames": "generator",
            "concurrent": generator.concurrent,
            "n_fed": normaliser.n_numbers,
            "marked": generator.marked,
            "most_frames": MOST_FRAMES,
        },
        **_rig_facts(pairs),
    }


def _rig_facts(pairs: Pairs) -> dict[str, Any]:
    """Returns the joints and cube of the numbers, and whether all words were moved to one place, for a corpus of clips;
    nothing for one of the synthetic signer.
    """
    head = pairs.head
    return {"space": head["spaces"][0], "moved": head.get("moved", True)} if "spaces" in head else {}


def _read_last_scores(folder: Path) -> dict[str, float]:
    """Returns the last scores of a part on validation pairs."""
    score_lines = [line for line in records.read_lines(folder / records.LOG_FILE) if {"accuracy", "pta"} & set(line)]
    return {k: v for k, v in score_lines[-1].items() if k != "step"} if score_lines else {}
