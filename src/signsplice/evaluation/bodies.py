"""Words on bodies of other proportions: what is left of contacts and places, with rotations alone and fitted.

The other bodies are the source's own rig with bones stretched and skin shaped anew, so that every place of the one has
its counterpart on the other. Some bodies and a third of the words are kept aside: no choice of the fit was made on
them, and they have rows of their own.
"""

from __future__ import annotations

import hashlib
import re
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from signsplice.body.capsules import BodyShape, shaped_capsules
from signsplice.body.retarget import fit_body
from signsplice.errors import InputError
from signsplice.evaluation.body_measures import SIGNATURE as MEASURES
from signsplice.evaluation.body_measures import TOUCH_M, BodyMeasurement, LostContact, SourceClip
from signsplice.evaluation.stretched_bodies import BODIES, BodyProportions, stretched
from signsplice.evaluation.tables import Progress, counted, markdown_columns, shown
from signsplice.lexicon import shipped
from signsplice.motion.arrays import FloatArray
from signsplice.motion.cache import CACHE
from signsplice.motion.clip import Clip, Skeleton
from signsplice.rig.align import Reference, copy_rotations
from signsplice.rig.placement import placement
from signsplice.signer.signer import stream

ROTATIONS, FITTED = "rotations", "fitted"
_TIMED_FRAMES = 150


TUNED_ON = frozenset(
    (
        *("NAME", "MY", "MOTHER", "FATHER", "THINK", "THANK-YOU", "PLEASE", "EAT", "DRINK"),
        *("DEAF", "KNOW", "FAMILY", "SCHOOL", "STOP", "PAPER", "COFFEE", "HELP"),
    )
)
"""Words on which weights and thresholds of the fit were chosen."""


@dataclass(frozen=True)
class BodyRow:
    """One method on one body, over words.

    body, method: names.
    held_out: whether body and words are kept aside.
    n_words, n_touching: words, and frames of them with a touch.
    kept_frames, kept_pairs: fraction of touching frames (nearest pair) and of touching pairs that are kept.
    kept_clear, clear: fraction that is kept of the pairs that do not lie deep in the body at the source already, and
        fraction of touching pairs that do not.
    error_p95: 95th percentile of the change of touching pairs' distance, m.
    made: fraction of the signing frames with a contact that was not there.
    hand_depth, forearm_depth: greatest depth beyond the source's own, m.
    place_median, place_p95: error of the place of the anchor nearest to head or trunk, head heights.
    palm_degrees, index_degrees: median change of direction.
    peak_median, peak_worst, jerk_median, jerk_worst: ratios to the source, median and greatest word.
    peak_by_arm_median, peak_by_arm_worst, jerk_by_arm_median, jerk_by_arm_worst: the same, divided by
        the ratio of arm lengths.
    shortfall: greatest distance of a hand from its place that a warning names, m; 0 where none does.
    milliseconds: processor time for 150 frames.
    time_ratio: processor time over that of rotations alone, median over words; None where skeletons are the same.
    worst: the contact that is farthest from kept.
    """

    body: str
    method: str
    held_out: bool
    n_words: int
    n_touching: int
    kept_frames: float | None
    kept_pairs: float | None
    kept_clear: float | None
    clear: float | None
    error_p95: float | None
    made: float | None
    hand_depth: float
    forearm_depth: float
    place_median: float | None
    place_p95: float | None
    palm_degrees: float | None
    index_degrees: float | None
    peak_median: float
    peak_worst: float
    jerk_median: float
    jerk_worst: float
    peak_by_arm_median: float
    peak_by_arm_worst: float
    jerk_by_arm_median: float
    jerk_by_arm_worst: float
    shortfall: float
    milliseconds: float
    time_ratio: float | None
    worst: LostContact | None


def is_kept_aside(gloss: str) -> bool:
    """Whether a word is kept aside: a third of all, by the hash of their names, but none that choices were made on."""
    return gloss not in TUNED_ON and hashlib.sha256(gloss.encode()).digest()[0] % 3 == 0


def draw_words(n_words: int) -> tuple[list[Clip], list[Clip]]:
    """``n_words`` different words that ship, letters apart: two thirds that are not kept aside, and one third that is;
    the same number always gives the same words. Raises ``InputError`` for fewer than 3 or more than there are.
    """
    words = shipped()
    names = [entry.gloss for entry in words.entries() if entry.kind == "sign"]
    aside = [name for name in names if is_kept_aside(name)]
    usual = [name for name in names if not is_kept_aside(name)]
    n_aside = n_words // 3
    if n_words < 3 or n_aside > len(aside) or n_words - n_aside > len(usual):
        raise InputError(f"{n_words} words, expected 3 to {min(3 * len(aside), 3 * len(usual) // 2)}")
    rng = stream("bodies", n_words)
    usual = rng.choice(usual, n_words - n_aside, replace=False).tolist()
    aside = rng.choice(aside, n_aside, replace=False).tolist()
    return [words.clip(name) for name in usual], [words.clip(name) for name in aside]


def signature(n_words: int | None = None) -> str:
    """The recipe of the numbers; n_words: of words drawn, None for captures."""
    drawn = "captures" if n_words is None else f"everyday,drawn:{n_words},kept-aside:sha256%3"
    return f"bodies|words:{drawn}|{MEASURES}|time:process,per-{_TIMED_FRAMES}-frames,in-turns"


def compare(
    words: Sequence[Clip],
    aside: Sequence[Clip],
    bodies: Mapping[str, BodyProportions] = BODIES,
    progress: Progress | None = None,
) -> list[BodyRow]:
    """Two rows for each body, rotations alone and fitted: bodies that are not kept aside with ``words``, the others
    with ``aside``. Raises ``InputError`` for a clip whose arms are not known by name.
    """
    sources = {False: [SourceClip(clip) for clip in words], True: [SourceClip(clip) for clip in aside]}
    rows: list[BodyRow] = []
    for name, body in counted(bodies.items(), progress):
        if sources[body.held_out]:
            rows += _rows(name, body, sources[body.held_out])
    return rows


@dataclass(frozen=True, eq=False)
class _Made:
    """A word on a body by one method: its measurement, shortfall in m, processor time in s and the frames."""

    measured: BodyMeasurement
    shortfall: float
    seconds: float
    n_frames: int


def _rows(name: str, body: BodyProportions, sources: Sequence[SourceClip]) -> list[BodyRow]:
    skeletons: dict[int, Skeleton] = {}
    made: dict[str, list[_Made]] = {ROTATIONS: [], FITTED: []}
    for source in sources:
        skeleton = source.clip.skeleton
        if id(skeleton) not in skeletons:
            skeletons[id(skeleton)] = stretched(skeleton, body)
        plain, fitted = _both(source, skeletons[id(skeleton)], body.shape)
        made[ROTATIONS].append(plain)
        made[FITTED].append(fitted)
    rows = []
    for method, words in made.items():
        pairs = zip(words, made[ROTATIONS], strict=True) if body.is_stretched else ()
        ratios = np.array([word.seconds / max(plain.seconds, 1e-9) for word, plain in pairs])
        rows.append(_row(name, method, body.held_out, words, ratios))
    return rows


def _both(source: SourceClip, skeleton: Skeleton, shape: BodyShape) -> tuple[_Made, _Made]:
    """A word with rotations alone, and fitted: each timed from the same start, with nothing kept of the clip."""
    clip, body = source.clip, shaped_capsules(skeleton, shape)
    to = Reference(skeleton, clip.fps, placement(clip), clip.local_rotations[0], "the body")
    copy_rotations(clip[:1], to)  # what is kept of both rigs belongs to neither time
    CACHE.forget(clip)
    start = time.process_time()
    carried = copy_rotations(clip, to)[0]
    plain = time.process_time() - start
    CACHE.forget(clip)
    start = time.process_time()
    again = copy_rotations(clip, to)[0]
    result = fit_body(clip, source.body, again, body)
    fitted = time.process_time() - start
    short = max([0.0, *(0.01 * float(cm) for line in result.warnings for cm in re.findall(r"(\d+) cm", line))])
    return (
        _Made(source.measure(carried, body, shape.head), 0.0, plain, len(clip)),
        _Made(source.measure(result.clip, body, shape.head), short, fitted, len(clip)),
    )


def _row(name: str, method: str, held_out: bool, words: Sequence[_Made], ratios: FloatArray) -> BodyRow:
    seen = [word.measured for word in words]
    pairs, frames = (np.concatenate([getattr(m, f"{part}_errors") for m in seen]) for part in ("pair", "frame"))
    clear = np.concatenate([m.clear for m in seen])
    places = np.concatenate([m.place_errors for m in seen])
    peak, jerk, arm = (np.array([getattr(m, f"{part}_ratio") for m in seen]) for part in ("peak", "jerk", "arm"))
    lost = [m.worst for m in seen if m.worst is not None]
    n_signing = sum(m.n_signing for m in seen)
    return BodyRow(
        body=name,
        method=method,
        held_out=held_out,
        n_words=len(seen),
        n_touching=len(frames),
        kept_frames=_mean(frames < TOUCH_M),
        kept_pairs=_mean(pairs < TOUCH_M),
        kept_clear=_mean(pairs[clear] < TOUCH_M),
        clear=_mean(clear),
        error_p95=_quantile(pairs, 0.95),
        made=sum(m.n_made for m in seen) / n_signing if n_signing else None,
        hand_depth=max(m.hand_depth for m in seen),
        forearm_depth=max(m.forearm_depth for m in seen),
        place_median=_quantile(places, 0.5),
        place_p95=_quantile(places, 0.95),
        palm_degrees=_quantile(np.concatenate([m.palm_degrees for m in seen]), 0.5),
        index_degrees=_quantile(np.concatenate([m.index_degrees for m in seen]), 0.5),
        peak_median=float(np.median(peak)),
        peak_worst=float(peak.max()),
        jerk_median=float(np.median(jerk)),
        jerk_worst=float(jerk.max()),
        peak_by_arm_median=float(np.median(peak / arm)),
        peak_by_arm_worst=float((peak / arm).max()),
        jerk_by_arm_median=float(np.median(jerk / arm)),
        jerk_by_arm_worst=float((jerk / arm).max()),
        shortfall=max(word.shortfall for word in words),
        milliseconds=1e3 * _TIMED_FRAMES * sum(w.seconds for w in words) / sum(w.n_frames for w in words),
        time_ratio=_quantile(ratios, 0.5),
        worst=max(lost, key=lambda one: one.error, default=None),
    )


def _mean(values: NDArray[np.bool_]) -> float | None:
    return float(np.mean(values)) if len(values) else None


def _quantile(values: FloatArray, fraction: float) -> float | None:
    return float(np.quantile(values, fraction)) if len(values) else None


_COLUMNS: dict[str, Callable[[BodyRow], str]] = {
    "body": lambda row: row.body,
    "method": lambda row: row.method,
    "frames kept": lambda row: shown(row.kept_frames, ".1f", 100.0),
    "pairs kept": lambda row: shown(row.kept_pairs, ".1f", 100.0),
    "clear pairs kept": lambda row: shown(row.kept_clear, ".1f", 100.0),
    "p95, mm": lambda row: shown(row.error_p95, ".1f", 1e3),
    "made": lambda row: shown(row.made, ".1f", 100.0),
    "hand deeper, mm": lambda row: shown(row.hand_depth, ".1f", 1e3),
    "forearm deeper, mm": lambda row: shown(row.forearm_depth, ".1f", 1e3),
    "place, % of head": lambda row: f"{shown(row.place_median, '.1f', 100.0)} ({shown(row.place_p95, '.0f', 100.0)})",
    "palm, °": lambda row: shown(row.palm_degrees, ".1f"),
    "index, °": lambda row: shown(row.index_degrees, ".1f"),
    "peak": lambda row: f"{row.peak_by_arm_median:.2f} ({row.peak_by_arm_worst:.2f})",
    "jerk": lambda row: f"{row.jerk_by_arm_median:.2f} ({row.jerk_by_arm_worst:.2f})",
    "short, cm": lambda row: shown(row.shortfall, ".0f", 100.0),
    "ms": lambda row: shown(row.milliseconds, ".1f"),
    "times": lambda row: shown(row.time_ratio, ".1f"),
}


def table(rows: Sequence[BodyRow], n_words: int | None = None) -> list[str]:
    """The rows as Markdown, those kept aside in a table of their own, with their signature."""
    out = [f"`{signature(n_words)}`"]
    for held_out in (False, True):
        part = [row for row in rows if row.held_out == held_out]
        if part:
            what = "Bodies kept aside" if held_out else "Other bodies"
            which = "" if n_words is None else " that are kept aside too" if held_out else " that are not kept aside"
            counted = f"{what}: {part[0].n_words} clips{which}, {part[0].n_touching} touching frames."
            out += ["", *markdown_columns(_COLUMNS, part), "", counted]
    return out
