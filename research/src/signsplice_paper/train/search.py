"""Search of learning rates and widths: short trainings of the systems' parts with each, scored on validation pairs.

Rates and widths are chosen on validation pairs with one seed; test pairs are not read. Every variant has the same
processor time, as many steps as fit into it, and the whole schedule of these steps, with warm-up and decay.
"""

from __future__ import annotations

import json
import os
import shutil
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import torch

from signsplice.errors import InputError
from signsplice.formats.atomic import replacing
from signsplice.formats.json_files import read_json
from signsplice_paper.train import training
from signsplice_paper.train.scales import Config, SystemPart, make_parts, make_task
from signsplice_paper.train.stopping import SNAPSHOTS, DeadlineError
from signsplice_paper.train.training import Training
from signsplice_workshop.corpora.pairs import Pairs
from signsplice_workshop.corpora.pool import Pool
from signsplice_workshop.train import checkpoint, processes, records

FILE = "search.json"
VERSION = 2
RATES = (1 / 3, 1.0, 3.0)
"""Learning rates that are tried, as multiples of the scale's."""
WIDTHS = (0.5, 1.0)
"""Widths that are tried, as multiples of the scale's."""
MINUTES = 2.0
_TIMED_STEPS = 10
JUDGED = ("accuracy", "paa")
"""Scores whose mean decides; a part may have only some of them."""
_N_JUDGEMENTS = 4


@dataclass(frozen=True)
class SearchPlan:
    """A search.

    - pairs: folder of the corpus
    - folder: for checkpoints
    - scale: the scale whose rates and widths are varied
    - minutes: processor minutes of every training
    - seed: of every training
    """

    pairs: Path
    folder: Path
    scale: str
    minutes: float = MINUTES
    seed: int = 0


@dataclass(frozen=True)
class SearchRow:
    """One training.

    - part: name of the part
    - rate, width: multiples of the scale's
    - learning_rate, units: the values themselves
    - scores: last scores on validation pairs
    - n_parameters: of the network
    - steps: number of steps that fitted into the time
    - cpu_s: processor seconds
    """

    part: str
    rate: float
    width: float
    learning_rate: float
    units: int
    scores: dict[str, float]
    n_parameters: int
    steps: int
    cpu_s: float

    @property
    def score(self) -> float:
        """The score that decides."""
        values = [self.scores[name] for name in JUDGED if name in self.scores]
        return sum(values) / len(values) if values else float("-inf")


def get_width(config: Config) -> int:
    """Returns the width of a network."""
    return config.width


def widen_config(config: Config, factor: float) -> Config:
    """Returns sizes with ``factor`` times as many units, rounded to a multiple of the heads if there are any."""
    heads = getattr(config, "n_heads", 1)
    sizes: dict[str, Any] = {"width": max(1, round(get_width(config) * factor / heads)) * heads}
    if hasattr(config, "inner"):
        sizes["inner"] = round(config.inner * factor)
    return replace(config, **sizes)


def make_variants(part: SystemPart) -> list[tuple[float, float, SystemPart]]:
    """Returns multiples of rate and width, and the part with these."""
    return [
        (rate, width, replace(part, rate=part.rate * rate, config=widen_config(part.config, width)))
        for width in WIDTHS
        for rate in RATES
    ]


def run(
    plan: SearchPlan, systems: Sequence[str], output_folder: Path, workers: int, report: Callable[[str], None],
    deadline: float | None = None,
) -> list[SearchRow]:  # fmt: skip
    """Trains the variants that ``output_folder``/search.json lacks, and writes the file after every training. Returns
    its rows.

    Trainings that ``deadline`` (of ``time.monotonic``) interrupts are begun anew by the next call.
    Raises ``InputError`` if the file holds a search of another corpus, scale or length.
    """
    signature = {
        "corpus": Pairs(plan.pairs).head["hash"], "scale": plan.scale, "split": "random", "minutes": plan.minutes,
        "seed": plan.seed,
    }  # fmt: skip
    rows = read(output_folder / FILE, signature)
    done = {(row.part, row.rate, row.width) for row in rows}
    owners: dict[str, str] = {}  # part -> the first system that has it
    for system in systems:
        for part in make_parts(system, plan.scale):
            owners.setdefault(part.name, system)
    jobs = [
        (plan, owners[part.name], part.name, rate, width, workers, deadline)
        for system in systems
        for part in make_parts(system, plan.scale)
        if owners[part.name] == system
        for rate, width, _ in make_variants(part)
        if (part.name, rate, width) not in done
    ]
    with Pool(workers) as map_jobs:
        for row in map_jobs(_train_variant, jobs):
            if row is None:
                continue
            rows.append(row)
            _write(output_folder, signature, rows)
            report(f"{row.part}, rate {row.learning_rate:.2g}, width {row.units}: {row.score:.3f}")
    n_left = len(jobs) + len(done) - len(rows)
    if n_left:
        report(f"time is up: {n_left} trainings are left; the same call continues")
    elif rows:
        _write(output_folder, signature, rows)
    return rows


def _train_variant(job: tuple[SearchPlan, str, str, float, float, int, float | None]) -> SearchRow | None:
    """Trains one variant and returns its row; None if time is up."""
    plan, system, name, rate, width, workers, deadline = job
    if deadline is not None and time.monotonic() >= deadline:
        return None
    if workers > 1:
        torch.set_num_threads(max(1, (os.cpu_count() or 1) // workers))
    part = next(part for part in make_parts(system, plan.scale) if part.name == name)
    part = next(variant for r, w, variant in make_variants(part) if (r, w) == (rate, width))
    pairs = Pairs(plan.pairs)
    part = training.fit_to_skeleton(part, pairs)
    config = Training(system, plan.scale, seed=plan.seed, n_judgements=_N_JUDGEMENTS, deadline=deadline)
    part = replace(part, steps=_count_steps(part, config, pairs, 60.0 * plan.minutes))
    folder = training.part_folder(plan.folder, part, config, pairs)
    folder.mkdir(parents=True, exist_ok=True)
    try:
        with processes.join_process_group() as process, processes.lock_folder(folder, process):
            trained = training.train_part(part, config, pairs, folder, process)
    except DeadlineError:
        return None
    lines = records.read_lines(folder / records.LOG_FILE)
    score_lines = [line for line in lines if set(JUDGED) & set(line)]
    scores = {k: v for k, v in score_lines[-1].items() if k not in ("step", "cpu_s")} if score_lines else {}
    cpu_s = max((line.get("cpu_s", 0.0) for line in lines), default=0.0)
    (folder / checkpoint.NAME).unlink(missing_ok=True)
    shutil.rmtree(folder / SNAPSHOTS, ignore_errors=True)
    n_parameters = sum(p.numel() for p in trained.network.parameters())
    units = get_width(part.config)
    return SearchRow(name, rate, width, part.rate, units, scores, n_parameters, part.steps, round(cpu_s, 1))


def _count_steps(part: SystemPart, config: Training, pairs: Pairs, cpu_s: float) -> int:
    """Returns how many steps of a part fit into this processor time, measured on a few of them."""
    data = training.load_data(part, pairs, config.split, "train")
    part_task = make_task(part, data.normaliser(), config.seed)
    for step in range(_TIMED_STEPS + 1):
        if step == 1:  # the first allocates
            start = time.process_time()
        part_task(data.batch(data.rows(step, part.batch, config.seed), step)).backward()
    return max(1, round(cpu_s * _TIMED_STEPS / (time.process_time() - start)))


def read(path: Path, signature: dict[str, Any] | None = None) -> list[SearchRow]:
    """Returns the rows of a file, none if there is no file. Raises ``InputError`` if it holds another search."""
    if not path.exists():
        return []
    stored = read_json(path, "a search")
    try:
        if signature is not None and stored["search"] != signature:
            raise InputError(f"{path}: a search of {stored['search']}, expected {signature}; name another folder")
        return [SearchRow(**row) for row in stored["rows"]]
    except (KeyError, TypeError) as error:
        raise InputError(f"{path}: holds no search ({error}); remove it to begin anew") from error


def _write(output_folder: Path, signature: dict[str, Any], rows: Sequence[SearchRow]) -> None:
    lines = ",\n".join("  " + json.dumps(asdict(row)) for row in rows)
    content = f'{{\n "version": {VERSION},\n "search": {json.dumps(signature)},\n "rows": [\n{lines}\n ]\n}}\n'
    with replacing(output_folder / FILE) as temporary:
        temporary.write_text(content, encoding="utf-8")
