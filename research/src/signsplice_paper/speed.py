"""Prediction times of all systems in one run, at sizes that need no training to be timed.

Untrained networks would stop at random lengths. Each system therefore does its usual search and then makes as many
frames as the truth has (``PaperSystem.predict_fixed``), so that an untrained network costs as much as a trained one.

The paper states that LpTransformer predicts five times faster than Transformer, but neither how its Transformer decoded
nor what it put out. Plausible variants of 2023 are therefore timed too: decoding without a cache of keys and values,
and writing the whole utterance Y instead of the transition.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

import numpy as np

from signsplice.formats.atomic import replacing
from signsplice.splicing.learned import FLUENT
from signsplice.splicing.learned import NAME as LEARNED
from signsplice_paper import protocol, published
from signsplice_paper.clip_methods import ClipAnswers, ClipMethod
from signsplice_paper.environment import describe_machine, read_environment
from signsplice_paper.layout import Table
from signsplice_paper.protocol import Protocol
from signsplice_paper.systems import DECODINGS, PaperSystem, open_bundle
from signsplice_workshop.corpora.pairs import Pairs

WRITES = ("transition", "utterance")
SYSTEMS = ("lptransformer", "transformer", "lstm", "conv-s2s")
CONCURRENT = ("lptransformer", "transformer")
"""Systems that can make all frames in one pass."""
PRODUCT = "signsplice"
"""This project's networks as they ship: from the words' clips to the transition's 159 numbers per frame."""
BASE = ("lptransformer", DECODINGS[0], WRITES[0])
"""System, decoding and output that all others are compared with."""
PAGE = "speed"


@dataclass(frozen=True)
class DecodingRun:
    """A timed system.

    - system: name of the system
    - decoding: one of ``DECODINGS``
    - writes: one of ``WRITES``: the transition alone, or the utterance with both words
    """

    system: str
    decoding: str
    writes: str

    def count_frames(self, n_before: int, n_after: int, truth: tuple[int, int, int]) -> int:
        """Returns the number of frames made for a pair; ``truth`` is pre, post and the number of transition frames."""
        pre, post, count = truth
        return count if self.writes == "transition" else pre + 1 + count + n_after - post


@dataclass(frozen=True)
class Timed:
    """The times of one run.

    - run: the timed run
    - ms_median: median time per pair, milliseconds
    - ms_mean: mean time per pair, milliseconds
    - times_base: median over pairs of the time divided by that of ``BASE``
    - n_parameters: number of the system's parameters
    """

    run: DecodingRun
    ms_median: float
    ms_mean: float
    times_base: float
    n_parameters: int


def list_decoding_runs() -> Iterator[DecodingRun]:
    """Yields every timed run of the paper's systems, ``BASE`` first."""
    for system in SYSTEMS:
        attention = system in CONCURRENT
        for decoding in DECODINGS if attention else DECODINGS[:1]:
            yield DecodingRun(system, decoding, "transition")
        if system != "lptransformer":
            for decoding in DECODINGS[:2] if attention else DECODINGS[:1]:
                yield DecodingRun(system, decoding, "utterance")


def measure(
    pairs: Pairs,
    bundles: Path,
    judged: Protocol,
    progress: Callable[[int, int], None] | None = None,
    product_bundle: str | Path | None = None,
) -> list[Timed]:
    """Returns the times of every run on the pairs of a protocol. All runs take turns on each pair, so that changes of
    the machine's speed affect all alike.

    bundles: holds a folder for each system. product_bundle: this project's bundle, None for the one that ships. Raises
    ``InputError`` if a bundle is missing.
    """
    runs = list(list_decoding_runs())
    systems = {(run.system, run.decoding): open_bundle(bundles / run.system, run.decoding) for run in runs}
    product = ClipMethod(FLUENT, LEARNED, bundle=product_bundle)
    answers = ClipAnswers(pairs, product)
    answers.prepare(judged.pair_numbers)
    runs.append(DecodingRun(PRODUCT, DECODINGS[-1], WRITES[0]))
    seconds = np.zeros((len(judged.pair_numbers), len(runs)))
    for warm_up in (True, False):
        for row, number in enumerate(judged.pair_numbers[: protocol.WARM_UP] if warm_up else judged.pair_numbers):
            for column, run in enumerate(runs):
                work: Callable[[], object] = partial(answers, number)
                if run.system != PRODUCT:
                    work = _prepare_prediction(systems[run.system, run.decoding], run, pairs, number)
                start = time.perf_counter()
                work()
                seconds[row, column] = time.perf_counter() - start
            if progress is not None and not warm_up:
                progress(row + 1, len(judged.pair_numbers))
    base = runs.index(DecodingRun(*BASE))
    ratios = np.median(seconds / seconds[:, base : base + 1], axis=0)
    return [
        Timed(
            run,
            1e3 * float(np.median(seconds[:, column])),
            1e3 * float(np.mean(seconds[:, column])),
            float(ratios[column]),
            product.n_parameters if run.system == PRODUCT else systems[run.system, run.decoding].n_parameters,
        )
        for column, run in enumerate(runs)
    ]


def _prepare_prediction(system: PaperSystem, run: DecodingRun, pairs: Pairs, number: int) -> Callable[[], object]:
    """Returns the prediction of a pair with its true outcome, ready to be called."""
    p, q = pairs.index[number, :2].tolist()
    before, after = pairs.word(p).astype(np.float64), pairs.word(q).astype(np.float64)
    pre, post, frames = pairs.truth(number)
    n_frames = run.count_frames(len(before), len(after), (pre, post, len(frames)))
    return partial(system.predict_fixed, before, after, pre, post, n_frames)


def make_table(timed: Sequence[Timed], scale: str, judged: Protocol) -> Table:
    """Returns the times as a table."""
    columns = ("system", "decoding", "writes", "parameters, M", "ms, median", "ms, mean", "times LpTransformer")
    rows = tuple(
        (
            *(published.get_display_name(t.run.system), t.run.decoding, t.run.writes, f"{t.n_parameters / 1e6:.1f}"),
            *(f"{t.ms_median:.1f}", f"{t.ms_mean:.1f}", f"{t.times_base:.2f}"),
        )
        for t in timed
    )
    notes = (
        f"{len(judged.pair_numbers)} pairs, all systems on one before the next; sizes of scale {scale}, untrained, "
        "number of frames given; signsplice as it ships, given nothing. "
        "Last column: median over pairs of the time divided by that of the first row.",
        f"Timed by `{judged.signature}`.",
        f"Times: {describe_machine()}.",
    )
    return Table(f"Prediction time at the sizes of scale {scale}", f"{PAGE}-{scale}", columns, rows, notes)


def write(timed: Sequence[Timed], folder: Path, scale: str, judged: Protocol) -> list[Path]:
    """Writes the times as JSON, named by scale; returns the path."""
    rows = [{k: v for k, v in {**asdict(row), **asdict(row.run)}.items() if k != "run"} for row in timed]
    stored = {
        "scale": scale,
        "protocol": judged.signature,
        **read_environment(),
        "machine": describe_machine(),
        "rows": rows,
    }
    path = folder / f"{PAGE}-{scale}.json"
    with replacing(path) as temporary:
        temporary.write_text(json.dumps(stored, indent=1) + "\n", encoding="utf-8")
    return [path]
