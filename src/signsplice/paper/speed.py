"""How long systems take for a pair, side by side in one run, at sizes that need no training to be timed.

The work is told its outcome (``Splicer.rehearse``): every system searches as it does, and then makes as many frames as
the truth has, so that a network that has not learned anything costs what a trained one costs. The paper says that
LpTransformer predicts five times faster than Transformer, and neither how its Transformer decoded nor what it wrote;
what was plausible in 2023 is timed beside what this project does: without a cache of keys and values, and writing the
whole utterance Y in place of the transition.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from signsplice.formats.atomic import replacing
from signsplice.paper import layout, protocol, published, results
from signsplice.paper.clip_methods import ClipAnswers, ClipMethod
from signsplice.paper.layout import Table
from signsplice.paper.protocol import Protocol
from signsplice.paper.systems import DECODINGS, open_bundle
from signsplice.splicing.learned import FLUENT
from signsplice.splicing.learned import NAME as LEARNED
from signsplice.synth.corpus import Pairs

WRITES = ("transition", "utterance")
SYSTEMS = ("lpt", "transformer", "lstm", "conv-s2s")
OWN = "signsplice"
"""This project's networks, as they ship: words' clips in, whole seam, and the 159 numbers of its frames out."""
BASE = ("lpt", DECODINGS[0], WRITES[0])
"""What all others are compared with."""
PAGE = "speed"


@dataclass(frozen=True)
class DecodingRun:
    """A system, how it decodes, and what it writes: the transition frames alone, or the utterance, both words too."""

    system: str
    decoding: str
    writes: str

    def n_frames(self, n_before: int, n_after: int, truth: tuple[int, int, int]) -> int:
        """Frames that it makes for a pair; ``truth`` is pre, post and the number of transition frames."""
        pre, post, count = truth
        return count if self.writes == "transition" else pre + 1 + count + n_after - post


@dataclass(frozen=True)
class Timed:
    """A way's milliseconds for a pair, median and mean; the median over pairs of its time by that of ``BASE``."""

    run: DecodingRun
    ms_median: float
    ms_mean: float
    times_base: float
    n_parameters: int


def decoding_runs() -> Iterator[DecodingRun]:
    """All that are timed, the base first."""
    for system in SYSTEMS:
        several = system in published.IN_ONE_PASS
        for decoding in DECODINGS if several else DECODINGS[:1]:
            yield DecodingRun(system, decoding, "transition")
        if system != "lpt":
            for decoding in DECODINGS[:2] if several else DECODINGS[:1]:
                yield DecodingRun(system, decoding, "utterance")


def measure(
    pairs: Pairs,
    bundles: Path,
    judged: Protocol,
    progress: Callable[[int, int], None] | None = None,
    own: str | Path | None = None,
) -> list[Timed]:
    """Time every way on the pairs of a protocol: all ways on one pair, then on the next, so that a machine's moods fall
    on all alike. ``bundles`` has a folder for each system; ``own`` is this project's bundle, by default that which
    ships. Raises ``InputError`` where one is missing.
    """
    told = list(decoding_runs())
    opened = {(w.system, w.decoding): open_bundle(bundles / w.system, w.decoding) for w in told}
    ours = ClipMethod(FLUENT, LEARNED, bundle=own)
    answers = ClipAnswers(pairs, ours)
    answers.prepare(judged.numbers)
    told.append(DecodingRun(OWN, DECODINGS[-1], WRITES[0]))
    seconds = np.zeros((len(judged.numbers), len(told)))
    for warm_up in (True, False):
        for at, number in enumerate(judged.numbers[: protocol.WARM_UP] if warm_up else judged.numbers):
            p, q = pairs.index[number, :2].tolist()
            before, after = pairs.word(p).astype(np.float64), pairs.word(q).astype(np.float64)
            pre, post, frames = pairs.truth(number)
            for column, way in enumerate(told):
                run: Callable[[], object] = partial(answers, number)
                if way.system != OWN:
                    n_frames = way.n_frames(len(before), len(after), (pre, post, len(frames)))
                    run = partial(opened[way.system, way.decoding].rehearse, before, after, pre, post, n_frames)
                begun = time.perf_counter()
                run()
                seconds[at, column] = time.perf_counter() - begun
            if progress is not None and not warm_up:
                progress(at + 1, len(judged.numbers))
    base = told.index(DecodingRun(*BASE))
    ratios = np.median(seconds / seconds[:, base : base + 1], axis=0)
    return [
        Timed(
            way,
            1e3 * float(np.median(seconds[:, column])),
            1e3 * float(np.mean(seconds[:, column])),
            float(ratios[column]),
            ours.n_parameters if way.system == OWN else int(opened[way.system, way.decoding].facts["n_parameters"]),
        )
        for column, way in enumerate(told)
    ]


def table(timed: Sequence[Timed], scale: str, judged: Protocol) -> Table:
    """The times as a table, and in its notes what they say of the paper's claim."""
    columns = ("system", "decoding", "writes", "parameters, M", "ms, median", "ms, mean", "by LpTransformer")
    rows = tuple(
        (
            *(published.name(t.run.system), t.run.decoding, t.run.writes, f"{t.n_parameters / 1e6:.1f}"),
            *(f"{t.ms_median:.1f}", f"{t.ms_mean:.1f}", f"{t.times_base:.2f}"),
        )
        for t in timed
    )
    notes = (
        f"{len(judged.numbers)} pairs, all systems on one before the next; sizes of scale {scale}, weights as drawn, "
        "the number of frames told; signsplice as it ships, told nothing. "
        "Last column: median over pairs of the time by that of the first row.",
        f"Timed by `{judged.signature}`.",
        f"Times: {results.machine()}.",
    )
    return Table(f"Prediction time at the sizes of scale {scale}", f"{PAGE}-{scale}", columns, rows, notes)


def write(timed: Sequence[Timed], folder: Path, scale: str, judged: Protocol) -> list[Path]:
    """Write the times as JSON, Markdown and LaTeX, named by scale; the paths written."""
    told: dict[str, Any] = {
        "scale": scale,
        "protocol": judged.signature,
        **{k: v for k, v in results.surroundings().items() if k != "measures"},
        "rows": [{**asdict(row), **asdict(row.run)} for row in timed],
    }
    for row in told["rows"]:
        del row["run"]
    made = table(timed, scale, judged)
    texts = {
        ".json": json.dumps(told, indent=1),
        ".md": layout.markdown(made).rstrip(),
        ".tex": layout.latex(made).rstrip(),
    }
    paths = []
    for suffix, text in texts.items():
        path = folder / f"{PAGE}-{scale}{suffix}"
        with replacing(path) as temporary:
            temporary.write_text(text + "\n", encoding="utf-8")
        paths.append(path)
    return paths
