"""The measurements of a corpus of pairs as Markdown, also between the marks of a page, with pictures in a folder."""

from __future__ import annotations

import os
import textwrap
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from pathlib import Path

import numpy as np

from signsplice.errors import InputError
from signsplice.formats import atomic, load
from signsplice.formats.reading import read_bytes
from signsplice.motion import Clip, FloatArray
from signsplice.progress import Progress
from signsplice.rig.info import rig_info
from signsplice.rig.keyedness import judge_keyedness
from signsplice.signer import notation
from signsplice.signer.phonology import Sign
from signsplice.signer.signer import stream
from signsplice.splicing.cutters import CUTTERS
from signsplice_workshop.corpora import pseudo
from signsplice_workshop.corpora.pairs import MADE_BY, VERSION, Pairs
from signsplice_workshop.measure import (
    corpus_checks,
    corpus_difficulty,
    corpus_pictures,
    corpus_realism,
    hands,
    motion_scores,
)
from signsplice_workshop.measure.corpus_checks import score_touches
from signsplice_workshop.measure.corpus_difficulty import BY_WORD, CUT_MEASURES, RAD_PER_CM, TRANSITION_MEASURES
from signsplice_workshop.measure.corpus_realism import MOVING, rms_jerk, speeds
from signsplice_workshop.measure.hands import wrist_positions
from signsplice_workshop.measure.hidden_frames import SHOWN
from signsplice_workshop.measure.measures import (
    HEAD,
    MEDIAN_WITHIN,
    TAILS_WITHIN,
    csv_text,
    markdown,
    markdown_rows,
    number,
    percentiles,
    table,
    tables_in,
)

N_SHAPES = 60
"""Pairs whose shape of motion is measured."""

_HOW = f"""Percentiles 5 / 25 / 50 / 75 / 95, or one figure. An agreeing median, or single figure, is at most
{100 * MEDIAN_WITHIN:.0f} % from the real one (from the nearer end of a range), agreeing 5 and 95 % at most
{100 * TAILS_WITHIN:.0f} %; "-": not known. n: values that real percentiles, or one median, are from; fewer
than {corpus_realism.FEWEST} values give a median alone. "{corpus_realism.AIMED}": what this project aims at, without a
published table behind it. A clip's own figures are measured as the
corpus's are, on frames in which a wrist is faster than {MOVING:g} arm lengths/s. Joints turn relative to their
parent. The strong side of a clip is the one whose wrist moves farther. Hands are compared with a mirror image in
the symmetric words of the corpus, and in a clip wherever both are faster than {hands.MIRRORED_SPEED:g} arm lengths/s
and move as in a mirror for {hands.MIRRORED_FRAMES} frames or more. A reach lies between two minima of the wrist's
speed."""


def _realism(pairs: Pairs, signs: Mapping[str, Sign], real: Mapping[str, Clip], plot: Path | None) -> list[str]:
    """Lines of Markdown; ``real``: clips of real signing by name. The plot is written to ``plot``; None draws none.

    Clips that were drawn between keys (``rig.keyedness``) are marked, and no figure is held against them.
    """
    motion = corpus_realism.wrist_motion(pairs)
    durations = corpus_realism.durations(pairs)
    captured = {name: clip for name, clip in real.items() if not judge_keyedness(clip).is_keyed}
    quantities = [
        *durations,
        *corpus_realism.motion_quantities(pairs, motion),
        *corpus_realism.compare_with_captures(pairs, captured),
        *corpus_realism.likeness_of_hands(pairs, signs, captured),
        *corpus_realism.second_passes(pairs),
        *corpus_realism.sign_kind_shares(),
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
        *(f"\n{name} is no measure of real motion ({motion_scores.format_keyedness(real[name])})." for name in keyed),
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


BEGIN, END = "<!-- measured: begin -->", "<!-- measured: end -->"
_AGREES = HEAD[-1]
_DEEP = "pairs with a hand deeper"
Bars = Callable[[str], AbstractContextManager[Progress | None]]
"""Makes a progress bar by name."""

N_TEST = 1000
"""Test pairs whose cuts are scored."""
N_TRANSITIONS = 300
"""Test pairs whose transitions are scored."""
FEWEST_FRAMES = 18 + 2 * SHOWN
"""Frames that a real clip needs: the longest gap that is measured, and what a transition is shown around it."""
IDLE_EXTENT = 0.2
"""A clip in which no wrist moves farther than this fraction of the longest offset of its skeleton is no signing."""


def write(pairs: Pairs, page: Path, images: Path, real: Mapping[str, Clip], progress: Bars) -> list[str]:
    """Measure a corpus and put a short form of the result into ``page`` between its marks, and every cell of the tables
    into a CSV file beside it; pictures go to the folder ``images``.

    Arguments, result and errors as of ``measure_corpus``; raises ``InputError`` for a page without the marks too.
    """
    _check_measurable(pairs)
    text = read_bytes(page).decode("utf-8")
    if BEGIN not in text or END not in text:
        raise InputError(f"{page}: has no lines {BEGIN} and {END}, expected both; the tables go between them")
    lines = measure_corpus(pairs, images, real, progress)
    here = os.path.relpath(images, page.parent).replace(os.sep, "/")
    shown = [line.replace(f"]({images.name}/", f"]({here}/") for line in short(lines, page.with_suffix(".csv").name)]
    before, after = text.split(BEGIN)[0], text.split(END, 1)[1]
    atomic.write(page.with_suffix(".csv"), csv_text(_CSV, _cells(lines)))
    atomic.write(page, "\n".join([before + BEGIN, *shown, END + after]))
    return lines


def short(lines: Sequence[str], csv_name: str) -> list[str]:
    """Lines of ``measure_corpus`` as the page shows them: findings first, of realism what misses, no finger joints."""
    tables = tables_in(lines)
    realism, difficulty, validity = (
        [table["rows"] for table in tables if table["section"] == section]
        for section in ("Realism", "Difficulty", "Validity")
    )
    n_figures = len(realism[0])
    missing = [
        {**row, "corpus": _median(row["corpus"]), "real": _median(row["real"])}
        for row in realism[0]
        if "no" in row[_AGREES]
    ]
    exact = {row["rule"]: row["both exact"] for row in difficulty[0]}
    best = max((name for name in exact if name in CUTTERS), key=lambda name: float(exact[name]))
    findings = [
        f"- {n_figures - len(missing)} of {n_figures} figures agree with real signing in all that can be compared.",
        f"- The best classical cutter, `{best}`, finds both frames of a cut in {exact[best]} % of the pairs"
        + (f", the most frequent cut of each word in {exact[BY_WORD]} %." if BY_WORD in exact else "."),
        *(
            f"- A reader who knows the rules and sees to 5 mm gets both frames right in {rows[0]['0.5']} %."
            for rows in difficulty[1:-1]
        ),
        *(f"- {row['check'].capitalize()}: {row['worst']}." for row in validity[0] if row["check"].startswith(_DEEP)),
    ]
    first = next(n for n, line in enumerate(lines) if line.startswith("Shape of motion"))
    bends = next(n for n, line in enumerate(lines) if line.startswith("Bend of the finger joints"))
    rest = next(n for n, line in enumerate(lines) if n > bends and line and not line.startswith("|"))
    how = " ".join(lines[4 : lines.index("", 4)])
    head = ("quantity", "unit", "corpus", "real", "from", "ratio", _AGREES)
    return [
        *findings,
        "",
        lines[0],
        "",
        f"Every cell, with all percentiles and the bend of every finger joint: [{csv_name}]({csv_name}).",
        *lines[1:4],
        *textwrap.wrap(
            "Figures that do not agree, as medians or one figure. " + how.partition(", or one figure. ")[2], 120
        ),
        "",
        *markdown(head, [[row[name] for name in head] for row in missing]),
        "",
        *lines[first:bends],
        *lines[rest:],
    ]


def _median(cell: str) -> str:
    """The median of a cell of percentiles; any other cell as it is."""
    parts = cell.split(" / ")
    return parts[2] if len(parts) == 5 else cell


_CSV = ("section", "line", "row", "column", "value")


def _cells(lines: Sequence[str]) -> list[tuple[str, int, str, str, str]]:
    return [
        (table["section"], n, next(iter(row.values())), column, value)
        for table in tables_in(lines)
        for n, row in enumerate(table["rows"], 1)
        for column, value in list(row.items())[1:]
    ]


def _check_measurable(pairs: Pairs) -> None:
    """Raise ``InputError`` for a corpus of clips that no synthetic signer made, and for a truth made to be read."""
    pairs.check_synthetic()
    if pairs.truth_kind == "events":
        raise InputError(
            f"{pairs.folder}: its truth is of kind events, expected partner or word: it was made to be read"
        )


def measure_corpus(pairs: Pairs, images: Path | None, real: Mapping[str, Clip], progress: Bars) -> list[str]:
    """What is measured of a corpus, as lines of Markdown; the first names the corpus.

    images: folder for pictures; None draws none. real: clips of real signing by name, for columns next to the
    corpus's. progress: makes a progress bar by name. Raises ``InputError`` for a corpus of other clips than the
    synthetic signers', ``MissingExtraError`` where pictures are wanted without matplotlib or Pillow.
    """
    _check_measurable(pairs)
    if images is not None:
        corpus_pictures.check_matplotlib()
    signs = signs_by_gloss(pairs)
    lines = [
        f"Corpus `{pairs.head['hash']}`, version {pairs.version}: {len(pairs)} pairs, "
        f"truth by {'partner' if pairs.by_partner else 'word'}, seed {pairs.head['seed']}, {pairs.head['fps']:g} fps."
    ]
    with progress("realism") as advance:
        plot = None if images is None else images / "corpus-realism.png"
        lines += ["", *_realism(pairs, signs, real, plot)]
        if advance is not None:
            advance(1, 1)
    with progress("difficulty") as advance:
        lines += ["", *_difficulty(pairs, signs, advance)]
    with progress("validity") as advance:
        lines += ["", *_validity(pairs, signs, advance)]
    if images is not None:
        with progress("pictures") as advance:
            corpus_pictures.write_sheets(pairs, signs, images, advance)
    return lines


def signs_by_gloss(pairs: Pairs) -> dict[str, Sign]:
    """Gloss -> sign: the signs that ship and the pseudo-signs of a corpus."""
    signs = {**notation.everyday(), **notation.alphabet()}
    glosses = [row["gloss"] for row in pairs.head["words"]]
    pseudo_signs = (gloss for gloss in glosses if gloss.startswith("PSEUDO-"))
    return signs | {gloss: pseudo.sign(int(gloss.removeprefix("PSEUDO-"))) for gloss in pseudo_signs}


def load_real_clips(folder: Path | None, frames: tuple[int, int] | None = None) -> dict[str, Clip]:
    """Name -> clip of the BVH files in a folder that hold signing: those named idle and those that hardly move are not
    read. ``frames``: the half-open range of each clip that is taken, which the name tells then.

    Raises ``InputError`` where too few frames are left of a clip.
    """
    clips: dict[str, Clip] = {}
    for path in sorted(folder.glob("*.bvh")) if folder is not None else ():
        clip = load(path)
        if "idle" in path.stem.lower() or not _moves(clip):
            continue
        first, stop = (0, len(clip)) if frames is None else (frames[0], min(frames[1], len(clip)))
        if stop - first < FEWEST_FRAMES:
            where = "" if frames is None else f" in {frames[0]}:{frames[1]}"
            n = max(0, stop - first)
            raise InputError(f"{path}: has {n} frames{where}, expected at least {FEWEST_FRAMES} to measure")
        clips[path.stem if frames is None else f"{path.stem}, frames {first} to {stop - 1}"] = clip[first:stop]
    return clips


def _moves(clip: Clip) -> bool:
    extent = np.ptp(clip.skeleton.offsets, axis=0).max() * rig_info(clip.skeleton).sizes.unit.metres
    return bool(np.ptp(wrist_positions(clip), axis=0).max() > IDLE_EXTENT * extent)


def _percents(*fractions: float) -> list[str]:
    return [f"{100 * fraction:.1f}" for fraction in fractions]


def _difficulty(pairs: Pairs, signs: Mapping[str, Sign], advance: Progress | None) -> list[str]:
    test = pairs.split("random", "test")[:N_TEST]
    cuts = corpus_difficulty.score_cutters(pairs, test, pairs.split("random", "train"), advance)
    transitions, true_jump = corpus_difficulty.score_transitions(pairs, test[:N_TRANSITIONS], advance)
    return [
        "### Difficulty",
        "",
        f"True cuts found in {len(test)} test pairs of the random split, % of the pairs:",
        "",
        *markdown_rows(CUT_MEASURES, cuts),
        "",
        *_precision(pairs, test, signs),
        "",
        f"Transitions at the true cuts and lengths, {len(test[:N_TRANSITIONS])} of them:",
        "",
        *markdown_rows(TRANSITION_MEASURES, transitions),
        f"| (truth) | 0 | 1 | {true_jump:.2f} |",
    ]


def _older(pairs: Pairs) -> str:
    commit = MADE_BY.get(pairs.version, "an earlier one")
    return f"Its words and cuts are not planned anew: commit {commit} makes version {pairs.version}."


def _precision(pairs: Pairs, test: Sequence[int], signs: Mapping[str, Sign]) -> list[str]:
    if pairs.version != VERSION:
        return [_older(pairs)]
    reading = corpus_difficulty.score_reading(pairs, test, signs)
    return [
        "Precision that a reader needs who knows the rules and the frames of all events. Error: standard deviation of",
        "each coordinate of the strong wrist in every frame, and of the skin distances at the events (finger angles:",
        f"{RAD_PER_CM} rad per cm). Pairs with both frames right, %:",
        "",
        *markdown(
            ("error, cm", *(f"{r.error_cm:g}" for r in reading)),
            [
                ("exact", *_percents(*(r.exact for r in reading))),
                ("within one frame", *_percents(*(r.near for r in reading))),
            ],
        ),
    ]


def _validity(pairs: Pairs, signs: Mapping[str, Sign], advance: Progress | None) -> list[str]:
    worst = corpus_checks.examine(pairs, advance)
    touches = score_touches(pairs)
    steps = f"{worst.transition_step_cm:.1f}, {worst.word_step_cm:.1f} cm a frame"
    rows = [
        (
            "deepest a hand lies in head, trunk, the other arm or its hand, in words",
            f"{10 * worst.deepest_word_cm:.1f} mm",
        ),
        ("the same in transitions", f"{10 * worst.deepest_transition_cm:.1f} mm"),
        (
            "deepest a forearm lies in the trunk, in words, in transitions",
            f"{10 * worst.forearm_word_cm:.1f}, {10 * worst.forearm_transition_cm:.1f} mm",
        ),
        ("pairs with a hand deeper than 5 mm", worst.n_too_deep),
        ("most over a limit of elbow, forearm, wrist or finger", f"{worst.over_limit_deg:.2f} degrees"),
        ("largest change of a bone's length", f"{worst.bone_change_cm:.1e} cm"),
        ("largest step of any joint: in a transition and at its seams, in words", steps),
        ("largest change of a wrist's step at a seam", f"{worst.seam_wrist_change_cm:.1f} cm"),
        ("pairs whose cut or transition lies outside the stored frames", worst.n_misplaced),
        (
            f"first and last postures, of {touches.n_postures}, whose touch is not flagged, or flagged and not seen",
            f"{touches.n_missed}, {touches.n_false}",
        ),
    ]
    anew = []
    if pairs.version == VERSION:
        n_replanned, n_different = corpus_checks.replan(pairs, signs)
        rows.append((f"pairs that differ in any bit, of {n_replanned} drawn and planned anew", n_different))
    else:
        anew = ["", _older(pairs)]
    return ["### Validity", "", f"Over all {worst.n_pairs} pairs:", "", *markdown(("check", "worst"), rows), *anew]
