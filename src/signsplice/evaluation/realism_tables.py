"""The tables of realism of a corpus of pairs, as Markdown, with their plot."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from signsplice.evaluation import corpus_pictures, corpus_realism, hands, sign_kinds
from signsplice.evaluation.corpus_realism import rms_jerk, speeds
from signsplice.evaluation.signer_motion import MOVING
from signsplice.evaluation.tables import MEDIAN_WITHIN, TAILS_WITHIN, markdown, number, percentiles, table
from signsplice.motion.arrays import FloatArray
from signsplice.motion.clip import Clip
from signsplice.rig import metrics
from signsplice.signer.phonology import Sign
from signsplice.signer.signer import stream
from signsplice.synth.corpus import Pairs

N_SHAPES = 60
"""Pairs whose shape of motion is measured."""

_HOW = f"""Percentiles 5 / 25 / 50 / 75 / 95, or one figure. An agreeing median, or single figure, is at most
{100 * MEDIAN_WITHIN:.0f} % from the real one (from the nearer end of a range), agreeing 5 and 95 % at most
{100 * TAILS_WITHIN:.0f} %; "-": not known. n: values that real percentiles, or one median, are from; fewer
than {corpus_realism.FEWEST} values give a median alone. "{sign_kinds.AIMED}": what this project aims at, without a
published table behind it. A clip's own figures are measured as the
corpus's are, on frames in which a wrist is faster than {MOVING:g} arm lengths/s. Joints turn relative to their
parent. The strong side of a clip is the one whose wrist moves farther. Hands are compared with a mirror image in
the symmetric words of the corpus, and in a clip wherever both are faster than {hands.MIRRORED_SPEED:g} arm lengths/s
and move as in a mirror for {hands.MIRRORED_FRAMES} frames or more. A reach lies between two minima of the wrist's
speed."""


def tables(pairs: Pairs, signs: Mapping[str, Sign], real: Mapping[str, Clip], plot: Path | None) -> list[str]:
    """Lines of Markdown; ``real``: clips of real signing by name. The plot is written to ``plot``; None draws none.

    Clips that were drawn between keys (``rig.metrics.is_keyed``) are marked, and no figure is held against them.
    """
    motion = corpus_realism.wrist_motion(pairs)
    durations = corpus_realism.durations(pairs)
    captured = {name: clip for name, clip in real.items() if not metrics.is_keyed(clip)}
    quantities = [
        *durations,
        *corpus_realism.motion_quantities(pairs, motion),
        *corpus_realism.compared_with_captures(pairs, captured),
        *corpus_realism.likeness_of_hands(pairs, signs, captured),
        *sign_kinds.second_passes(pairs),
        *sign_kinds.known_kinds(),
    ]
    n_first = int((pairs.index[:, 0] < len(pairs.head["words"]) // 2).sum())
    drawn = stream("shapes", n_first).choice(n_first, min(N_SHAPES, n_first), replace=False)
    columns = {"corpus": [pairs.clip(int(k)) for k in drawn]}
    columns |= {name if name in captured else f"{name} (keyed)": [clip] for name, clip in real.items()}
    strong = {
        name: hands.strong_side(pairs) if name == "corpus" else hands.busier_side(clips[0])
        for name, clips in columns.items()
    }
    shapes = [
        (name, *(number(shape(clips, strong[column])) for column, clips in columns.items()))
        for name, shape in _SHAPES.items()
    ]
    bends = {name: _bends(clips) for name, clips in columns.items()}
    joints = [(joint, *(_range(bends[name].get(joint)) for name in columns)) for joint in bends["corpus"]]
    forming = corpus_realism.forming(pairs)
    formed = " / ".join(map(number, percentiles(forming))) if len(forming) else "-"
    keyed = [name for name in real if name not in captured]
    drawn_there = []
    if plot is not None:
        corpus_pictures.write_plot(durations, motion, bends, plot)
        shown = f"{plot.parent.name}/{plot.name}"
        drawn_there = ["", f"![Durations, speeds and finger ranges of the corpus]({shown})"]
    return [
        "### Realism",
        "",
        *textwrap.wrap(_HOW, 120),
        "",
        *table(quantities),
        "",
        f"Shape of motion ({len(drawn)} drawn pairs; real clips whole):",
        "",
        *markdown(("quantity", *columns), shapes),
        "",
        f"Path over chord of transitions: {np.median(motion.detour):.2f} (median, those over 3 cm). "
        f"Fingers half formed at {formed} of them (5 / 25 / 50 / 75 / 95 %).",
        *(f"\n{name} is no measure of real motion ({metrics.keyed_mark(real[name])})." for name in keyed),
        "",
        "Bend of the finger joints, degrees, 5 to 95 % (1 is the joint nearest to the wrist):",
        "",
        *markdown(("joint", *columns), joints),
        *drawn_there,
    ]


def _mean_speed(clips: Sequence[Clip], strong: str) -> float:
    return float(np.mean(np.concatenate([speeds(path, clips[0].fps) for path in _paths(clips, strong)])))


def _paths(clips: Sequence[Clip], strong: str) -> list[FloatArray]:
    return [hands.strong_wrist(clip, strong) for clip in clips]


_SHAPES: dict[str, Callable[[Sequence[Clip], str], float]] = {
    "exponent of speed over curvature (two-thirds law: -0.33)": lambda clips, strong: corpus_realism.power_law(
        _paths(clips, strong), clips[0].fps
    ),
    "rms jerk of the strong wrist, m/s^3": lambda clips, strong: rms_jerk(_paths(clips, strong), clips[0].fps),
    "mean speed of the strong wrist, m/s": _mean_speed,
    "fingertip motion ratio of slerp over 18 hidden frames": lambda clips, _: corpus_realism.slerp_motion_ratio(clips),
}
"""Measures of the shape of motion, each over clips of one frame rate, with the strong side."""


def _bends(clips: Sequence[Clip]) -> dict[str, FloatArray]:
    every = [hands.flexions(clip) for clip in clips]
    return {joint: np.concatenate([one[joint] for one in every]) for joint in every[0]}


def _range(values: FloatArray | None) -> str:
    return "-" if values is None else "{:.0f} to {:.0f}".format(*np.percentile(values, (5, 95)))
