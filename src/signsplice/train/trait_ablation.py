"""What each trait of the synthetic signer's manner is worth: networks trained on signing with some traits alone.

Every set of traits gets signing by the same signers, with the same words and sentences, and a transition network that
is trained on it. Frames are then hidden from a captured clip, and the network's error is compared with that of the
classical transition that it corrects. What helps on the capture makes the signing truer.

First each trait alone, with one seed; then none of them, all, and the best ones together, with several seeds, whose
spread tells which differences mean something.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from signsplice.errors import FormatError, InputError
from signsplice.evaluation.hidden_frames import SHOWN, HiddenFrames, hidden_frames
from signsplice.evaluation.tables import markdown
from signsplice.formats.atomic import replacing
from signsplice.formats.json_files import check_type, read_json
from signsplice.motion.arrays import FloatArray
from signsplice.motion.clip import Clip
from signsplice.rig import metrics
from signsplice.rig.canonical_map import ROLES
from signsplice.splicing.methods.learned import LearnedTransition, open_sessions
from signsplice.splicing.methods.transition import find_transition
from signsplice.synth import training_data
from signsplice.synth.manner import TRAITS
from signsplice.synth.pool import Pool
from signsplice.synth.training_data import TrainingDataPlan
from signsplice.train import provenance, training
from signsplice.train.processes import ALONE
from signsplice.train.training import SCHEDULES, ProductTraining

LENGTHS = (8, 12, 18)
"""Hidden frames per gap."""
STRIDE = 2
"""Frames from the start of one gap to the start of the next; fewer than elsewhere, because the clip may be short."""
N_BEST = 4
"""Traits that are tried together: those that help most alone."""
SEEDS = (0, 1, 2)
"""Seeds of the networks that tell the spread."""
PLANS = {"smoke": TrainingDataPlan(2, 3, 3), "small": TrainingDataPlan(5, 40, 150)}
"""The signing of every set of traits at each scale of the network."""
GROUPS = {"all": "position_error", "hands": "hand_error", "fingers": "finger_error", "trunk": "trunk_error"}
ARMS = "arms"
"""Error of all joints where the network corrects the arms alone, as in the product."""


@dataclass(frozen=True)
class AblationRow:
    """The errors of one network, over those of the classical transition, one for each of ``LENGTHS``.

    traits: traits of the signing that it was trained on
    seed: of its weights and batches
    errors: of the network's whole answer by group (``GROUPS``), and ``ARMS``
    """

    traits: tuple[str, ...]
    seed: int
    errors: dict[str, tuple[float, ...]]

    @property
    def mean(self) -> float:
        """The error of all joints, mean over the lengths."""
        return float(np.mean(self.errors["all"]))


@dataclass(frozen=True)
class Ablation:
    """What is measured, and where.

    name: of the clip, in results
    clip: a capture at 30 frames a second, or those frames of it that may be seen
    frames: first frame and end of these in the clip, in results
    folder: for signing and networks; what is there already is used again
    scale: one of ``PLANS``
    """

    name: str
    clip: Clip
    frames: tuple[int, int]
    folder: Path
    scale: str = "small"

    @property
    def signature(self) -> str:
        """What the numbers depend on."""
        plan, (first, end) = PLANS[self.scale], self.frames
        return (
            f"trait-ablation|{self.name}|frames:{first}:{end}|context:{SHOWN}|stride:{STRIDE}|scale:{self.scale}|"
            f"signers:{plan.n_signers}x{plan.n_words}x{plan.n_seams}|signing:{training_data.VERSION}|"
            f"{metrics.POSITION_ERROR}|{metrics.GROUP_ERRORS}"
        )


class _WholeAnswer(LearnedTransition):
    """The curve with the network's answer for every joint; hands are not led around the body."""

    name, learned, corrected = "network", False, np.ones(len(ROLES), bool)


class _ArmsAlone(LearnedTransition):
    """The same with the joints that the product corrects."""

    name, learned = ARMS, False


def run(
    ablation: Ablation,
    out: Path,
    processes: int = 2,
    report: Callable[[str], None] | None = None,
    same_as: Path | None = None,
) -> list[AblationRow]:
    """Train and measure all networks; rows are added to the JSON file ``out`` as they come, those there are kept.

    report: called with a line about every step. same_as: file of an ablation whose networks are measured, so that no
    trait is chosen by what this one finds. Raises ``InputError`` where the clip is too short, or ``out`` holds rows of
    another ablation.
    """
    report = report or (lambda _: None)
    hermite = hidden_frames([ablation.clip], [find_transition("hermite")], LENGTHS, STRIDE)
    rows = read(out, ablation.signature) if out.exists() else []

    def finish(wanted: Sequence[tuple[tuple[str, ...], int]]) -> None:
        done = {(row.traits, row.seed) for row in rows}
        todo = [one for one in dict.fromkeys(wanted) if one not in done]
        _make_signing(ablation, [traits for traits, _ in todo], processes, report)
        with Pool(processes) as each:
            for row in each(_measured, [(ablation, *one) for one in todo]):
                rows.append(row)
                _write(out, ablation, hermite, rows)
                report(f"{label(row.traits)}, seed {row.seed}: {row.mean:.3f} of {hermite[0].transition}")

    if same_as is not None:
        finish([(row.traits, row.seed) for row in read(same_as)])
        return rows
    finish([((), 0), (TRAITS, 0), *(((name,), 0) for name in TRAITS)])
    best = best_together(rows)
    finish([(traits, seed) for seed in SEEDS for traits in ((), TRAITS, best)])
    return rows


def best_together(rows: Sequence[AblationRow]) -> tuple[str, ...]:
    """The ``N_BEST`` traits that help most alone, in the order of ``TRAITS``."""
    alone = sorted((row for row in rows if len(row.traits) == 1 and row.seed == 0), key=lambda row: row.mean)
    chosen = {row.traits[0] for row in alone[:N_BEST]}
    return tuple(name for name in TRAITS if name in chosen)


def label(traits: tuple[str, ...]) -> str:
    """Traits as a line says them."""
    return {(): "none", TRAITS: "all"}.get(traits, ", ".join(traits))


def _work(ablation: Ablation) -> Path:
    """The folder of what is made at a scale from a version of the signing."""
    return ablation.folder / f"{ablation.scale}-v{training_data.VERSION}"


def _signing(ablation: Ablation, traits: tuple[str, ...]) -> tuple[TrainingDataPlan, Path]:
    """The signing of a set of traits, and its folder."""
    plan = PLANS[ablation.scale]
    plan = TrainingDataPlan(plan.n_signers, plan.n_words, plan.n_seams, traits=traits)
    return plan, _work(ablation) / "signing" / (label(traits).replace(", ", "+"))


def _make_signing(
    ablation: Ablation, sets: Sequence[tuple[str, ...]], processes: int, report: Callable[[str], None]
) -> None:
    plans = [_signing(ablation, traits) for traits in dict.fromkeys(sets)]
    if not plans:
        return

    def progress(done: int, total: int) -> None:
        if done % len(plans) == 0 or done == total:
            report(f"signing: {done} of {total} parts")

    training_data.write_all(plans, progress, processes)


def _measured(job: tuple[Ablation, tuple[str, ...], int]) -> AblationRow:
    """Train the network of a set of traits and a seed, and measure it."""
    ablation, traits, seed = job
    signing = _signing(ablation, traits)[1]
    bundle = _work(ablation) / "networks" / f"{signing.name}-seed{seed}"
    training.make(ProductTraining("transition", ablation.scale, seed), [signing], bundle, ALONE)
    return AblationRow(traits, seed, errors(ablation.clip, bundle))


def errors(clip: Clip, bundle: Path) -> dict[str, tuple[float, ...]]:
    """The errors of a bundle's transition network on frames hidden from a clip, as ``AblationRow`` holds them."""
    sessions = open_sessions(bundle)
    base, whole, arms = (
        hidden_frames([clip], [transition], LENGTHS, STRIDE)
        for transition in (find_transition("hermite"), _WholeAnswer(sessions), _ArmsAlone(sessions))
    )
    by_group = {group: _ratios(whole, base, field) for group, field in GROUPS.items()}
    return by_group | {ARMS: _ratios(arms, base, GROUPS["all"])}


def _ratios(rows: Sequence[HiddenFrames], base: Sequence[HiddenFrames], field: str) -> tuple[float, ...]:
    return tuple(getattr(row, field) / getattr(of, field) for row, of in zip(rows, base, strict=True))


def read(path: Path, signature: str | None = None) -> list[AblationRow]:
    """The rows of a file. Raises ``InputError`` where it holds none, or not those of a signature that is expected."""
    stored = read_json(path, "the rows of an ablation")
    try:
        check_type(stored, Mapping, "the file")
        if signature is not None and stored.get("signature") != signature:
            raise InputError(
                f"{path}: holds rows of {stored.get('signature')}, expected {signature}; name another file"
            )
        check_type(stored.get("rows"), list[AblationRow], "rows")
        return [
            AblationRow(tuple(row["traits"]), row["seed"], {name: tuple(of) for name, of in row["errors"].items()})
            for row in stored["rows"]
        ]
    except TypeError as error:
        raise FormatError(f"{error}; remove it to begin anew", file=str(path)) from error


def _write(path: Path, ablation: Ablation, hermite: Sequence[HiddenFrames], rows: Sequence[AblationRow]) -> None:
    base = {group: [getattr(row, field) for row in hermite] for group, field in GROUPS.items()}
    provenance.write_json(
        path,
        {
            "signature": ablation.signature,
            "lengths": LENGTHS,
            "gaps": [row.n_gaps for row in hermite],
            "hermite": base,
            "rows": [asdict(row) for row in rows],
        },
    )


def write_page(path: Path, ablation: Ablation, rows: Sequence[AblationRow]) -> None:
    """Write the tables with what a reader needs to know of them, whole or not at all."""
    plan, (first, end) = PLANS[ablation.scale], ablation.frames
    schedule = SCHEDULES["transition", ablation.scale]
    lines = [
        "# What each trait of the synthetic signer is worth",
        "",
        f"Frames {first} to {end - 1} of `{ablation.name}`; other frames were not looked at. Transition networks",
        f"(width {schedule.config.width}, {schedule.steps} steps of {schedule.batch} gaps) were trained on signing by",
        f"{plan.n_signers} synthetic signers with {plan.n_words} words and {plan.n_seams} seams each, which differ in",
        "the traits of their manner alone. Each filled frames hidden from the clip.",
        "",
        "All columns: the network's error over that of the Hermite transition that it corrects, 1 where it is no",
        f"better. Those without a length are means over {', '.join(map(str, LENGTHS))} hidden frames at 30 a second.",
        "*All joints*: elbows, wrists and fingers, seen from the root. *Hands*: wrists. *Fingers*: seen from their",
        "wrist. *Arms alone*: all joints, with the network's answer for arms only, as the product uses it.",
        "",
        *table(rows),
        "",
        f"`{ablation.signature}`",
    ]
    with replacing(path) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")


def table(rows: Sequence[AblationRow]) -> list[str]:
    """The rows as Markdown: single traits ranked, then what was tried with several seeds, mean and spread."""
    head = ("traits", "all joints", *(f"at {n}" for n in LENGTHS), "hands", "fingers", "trunk and head", "arms alone")
    alone = [row for row in rows if row.seed == 0 and len(row.traits) in (0, 1, len(TRAITS))]
    first = sorted(alone, key=lambda row: row.mean)
    several = dict.fromkeys(row.traits for row in rows if row.seed != 0)
    groups = [[row for row in rows if row.traits == traits] for traits in several]
    lines = ["Seed 0, the best first:", "", *markdown(head, [_cells([row]) for row in first])]
    if groups:
        seeds = len(groups[0])
        lines += ["", f"Mean of {seeds} seeds ± standard deviation:", "", *markdown(head, map(_cells, groups))]
    return lines


def _cells(rows: Sequence[AblationRow]) -> list[str]:
    """A line of the table for one set of traits, of one seed or several."""
    errors = {name: np.array([row.errors[name] for row in rows]) for name in rows[0].errors}  # (seeds, lengths)
    columns = [
        errors["all"].mean(1),
        *errors["all"].T,
        *(errors[name].mean(1) for name in ("hands", "fingers", "trunk", ARMS)),
    ]
    return [label(rows[0].traits), *map(_mean_and_spread, columns)]


def _mean_and_spread(values: FloatArray) -> str:
    if len(values) == 1:
        return f"{values[0]:.3f}"
    return f"{values.mean():.3f} ± {values.std(ddof=1):.3f}"
