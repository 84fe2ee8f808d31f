"""Writes the measurements of a corpus of pairs as Markdown, also between the marks of a page, with pictures."""

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
    format_csv,
    format_measures,
    format_number,
    format_quantities,
    format_table,
    parse_tables,
    percentiles,
)

N_SHAPES = 60
"""Number of pairs whose shape of motion is measured."""

_METHODS = f"""Percentiles 5 / 25 / 50 / 75 / 95, or one figure. An agreeing median, or single figure, is at most
{100 * MEDIAN_WITHIN:.0f} % from the real one (from the nearer end of a range), agreeing 5 and 95 % at most
{100 * TAILS_WITHIN:.0f} %; "-": not known. n: values that real percentiles, or one median, are from; fewer
than {corpus_realism.FEWEST} values give a median alone. "{corpus_realism.TARGET}": what this project aims at, without a
published table behind it. A clip's own figures are measured as the
corpus's are, on frames in which a wrist is faster than {MOVING:g} arm lengths/s. Joints turn relative to their
parent. The strong side of a clip is the one whose wrist moves farther. Hands are compared with a mirror image in
the symmetric words of the corpus, and in a clip wherever both are faster than {hands.MIRRORED_SPEED:g} arm lengths/s
and move as in a mirror for {hands.MIRRORED_FRAMES} frames or more. A reach lies between two minima of the wrist's
speed."""


def _format_realism(pairs: Pairs, signs: Mapping[str, Sign], real: Mapping[str, Clip], plot: Path | None) -> list[str]:
    """Returns lines of Markdown. ``real``: clips of real signing by name. The plot is written to ``plot``; None draws
    none.

    Clips that were drawn between keys (``rig.keyedness``) are marked, and no figure is compared with them.
    """
    motion = corpus_realism.wrist_motion(pairs)
    durations = corpus_realism.durations(pairs)
    captured = {name: clip for name, clip in real.items() if not judge_keyedness(clip).is_keyed}
    quantities = [
        *durations,
        *corpus_realism.motion_quantities(pairs, motion),
        *corpus_realism.compare_with_captures(pairs, captured),
        *corpus_realism.compare_hands(pairs, signs, captured),
        *corpus_realism.measure_second_passes(pairs),
        *corpus_realism.compare_sign_kinds(),
    ]
    n_first = int((pairs.index[:, 0] < len(pairs.head["words"]) // 2).sum())
    drawn_pairs = stream("shapes", n_first).choice(n_first, min(N_SHAPES, n_first), replace=False)
    columns = {"corpus": [pairs.clip(int(k)) for k in drawn_pairs]}
    columns |= {name if name in captured else f"{name} (keyed)": [clip] for name, clip in real.items()}
    strong = {
        name: hands.strong_side(pairs) if name == "corpus" else hands.busier_side(clips[0])
        for name, clips in columns.items()
    }
    shapes = [
        (name, *(format_number(shape(clips, strong[column])) for column, clips in columns.items()))
        for name, shape in _SHAPES.items()
    ]
    bends = {name: _finger_bends(clips) for name, clips in columns.items()}
    joints = [(joint, *(_format_range(bends[name].get(joint)) for name in columns)) for joint in bends["corpus"]]
    forming = corpus_realism.measure_forming(pairs)
    forming_text = " / ".join(map(format_number, percentiles(forming))) if len(forming) else "-"
    keyed = [name for name in real if name not in captured]
    plot_lines = []
    if plot is not None:
        corpus_pictures.write_plot(durations, motion, bends, plot)
        link = f"{plot.parent.name}/{plot.name}"
        plot_lines = ["", f"![Durations, speeds and finger ranges of the corpus]({link})"]
    return [
        "### Realism",
        "",
        *textwrap.wrap(_METHODS, 120),
        "",
        *format_quantities(quantities),
        "",
        f"Shape of motion ({len(drawn_pairs)} drawn pairs; real clips whole):",
        "",
        *format_table(("quantity", *columns), shapes),
        "",
        f"Path over chord of transitions: {np.median(motion.detour):.2f} (median, those over 3 cm). "
        f"Fingers half formed at {forming_text} of them (5 / 25 / 50 / 75 / 95 %).",
        *(f"\n{name} is no measure of real motion ({motion_scores.format_keyedness(real[name])})." for name in keyed),
        "",
        "Bend of the finger joints, degrees, 5 to 95 % (1 is the joint nearest to the wrist):",
        "",
        *format_table(("joint", *columns), joints),
        *plot_lines,
    ]


def _mean_speed(clips: Sequence[Clip], strong: str) -> float:
    return float(np.mean(np.concatenate([speeds(path, clips[0].fps) for path in _wrist_paths(clips, strong)])))


def _wrist_paths(clips: Sequence[Clip], strong: str) -> list[FloatArray]:
    return [hands.strong_wrist(clip, strong) for clip in clips]


_SHAPES: dict[str, Callable[[Sequence[Clip], str], float]] = {
    "exponent of speed over curvature (two-thirds law: -0.33)": lambda clips, strong: corpus_realism.power_law(
        _wrist_paths(clips, strong), clips[0].fps
    ),
    "rms jerk of the strong wrist, m/s^3": lambda clips, strong: rms_jerk(_wrist_paths(clips, strong), clips[0].fps),
    "mean speed of the strong wrist, m/s": _mean_speed,
    "fingertip motion ratio of slerp over 18 hidden frames": lambda clips, _: corpus_realism.slerp_motion_ratio(clips),
}
"""Measures of the shape of motion, each over clips of one frame rate, with the strong side."""


def _finger_bends(clips: Sequence[Clip]) -> dict[str, FloatArray]:
    clip_bends = [hands.flexions(clip) for clip in clips]
    return {joint: np.concatenate([bends[joint] for bends in clip_bends]) for joint in clip_bends[0]}


def _format_range(values: FloatArray | None) -> str:
    return "-" if values is None else "{:.0f} to {:.0f}".format(*np.percentile(values, (5, 95)))


BEGIN, END = "<!-- measured: begin -->", "<!-- measured: end -->"
_AGREES = HEAD[-1]
_DEEP = "pairs with a hand deeper"
Bars = Callable[[str], AbstractContextManager[Progress | None]]
"""Makes a progress bar by name."""

N_TEST = 1000
"""Number of test pairs whose cuts are scored."""
N_TRANSITIONS = 300
"""Number of test pairs whose transitions are scored."""
FEWEST_FRAMES = 18 + 2 * SHOWN
"""Frames that a real clip needs: the longest gap that is measured, and the context of a transition on both sides."""
IDLE_EXTENT = 0.2
"""A clip in which no wrist moves farther than this fraction of the longest offset of its skeleton is no signing."""


def write(pairs: Pairs, page: Path, images: Path, real: Mapping[str, Clip], progress: Bars) -> list[str]:
    """Measures a corpus and puts a short form of the result into ``page`` between its marks, and every cell of the
    tables into a CSV file beside it; pictures go to the folder ``images``.

    Arguments, result and errors as of ``measure_corpus``; raises ``InputError`` for a page without the marks too.
    """
    _check_measurable(pairs)
    text = read_bytes(page).decode("utf-8")
    if BEGIN not in text or END not in text:
        raise InputError(f"{page}: has no lines {BEGIN} and {END}, expected both; the tables go between them")
    lines = measure_corpus(pairs, images, real, progress)
    link_folder = os.path.relpath(images, page.parent).replace(os.sep, "/")
    page_lines = [
        line.replace(f"]({images.name}/", f"]({link_folder}/") for line in shorten(lines, page.with_suffix(".csv").name)
    ]
    before, after = text.split(BEGIN)[0], text.split(END, 1)[1]
    atomic.write(page.with_suffix(".csv"), format_csv(_CSV, _table_cells(lines)))
    atomic.write(page, "\n".join([before + BEGIN, *page_lines, END + after]))
    return lines


def shorten(lines: Sequence[str], csv_name: str) -> list[str]:
    """Returns the lines of ``measure_corpus`` as the page shows them: findings first, of realism the misses, no finger
    joints.
    """
    tables = parse_tables(lines)
    realism, difficulty, validity = (
        [parsed["rows"] for parsed in tables if parsed["section"] == section]
        for section in ("Realism", "Difficulty", "Validity")
    )
    n_figures = len(realism[0])
    missing = [
        {**row, "corpus": _median_of_cell(row["corpus"]), "real": _median_of_cell(row["real"])}
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
    methods = " ".join(lines[4 : lines.index("", 4)])
    head = ("quantity", "unit", "corpus", "real", "from", "ratio", _AGREES)
    return [
        *findings,
        "",
        lines[0],
        "",
        f"Every cell, with all percentiles and the bend of every finger joint: [{csv_name}]({csv_name}).",
        *lines[1:4],
        *textwrap.wrap(
            "Figures that do not agree, as medians or one figure. " + methods.partition(", or one figure. ")[2], 120
        ),
        "",
        *format_table(head, [[row[name] for name in head] for row in missing]),
        "",
        *lines[first:bends],
        *lines[rest:],
    ]


def _median_of_cell(cell: str) -> str:
    """Returns the median of a cell of percentiles; any other cell as it is."""
    parts = cell.split(" / ")
    return parts[2] if len(parts) == 5 else cell


_CSV = ("section", "line", "row", "column", "value")


def _table_cells(lines: Sequence[str]) -> list[tuple[str, int, str, str, str]]:
    return [
        (parsed["section"], n, next(iter(row.values())), column, value)
        for parsed in parse_tables(lines)
        for n, row in enumerate(parsed["rows"], 1)
        for column, value in list(row.items())[1:]
    ]


def _check_measurable(pairs: Pairs) -> None:
    """Raises ``InputError`` for a corpus of clips that no synthetic signer made, and for a truth made to be read."""
    pairs.check_synthetic()
    if pairs.truth_kind == "events":
        raise InputError(
            f"{pairs.folder}: its truth is of kind events, expected partner or word: it was made to be read"
        )


def measure_corpus(pairs: Pairs, images: Path | None, real: Mapping[str, Clip], progress: Bars) -> list[str]:
    """Measures a corpus and returns lines of Markdown, of which the first names the corpus.

    images: folder for pictures; None draws none. real: clips of real signing by name, for columns next to the corpus's.
    progress: makes a progress bar by name. Raises ``InputError`` for a corpus of other clips than the synthetic
    signers', ``MissingExtraError`` for pictures without matplotlib or Pillow.
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
        lines += ["", *_format_realism(pairs, signs, real, plot)]
        if advance is not None:
            advance(1, 1)
    with progress("difficulty") as advance:
        lines += ["", *_format_difficulty(pairs, signs, advance)]
    with progress("validity") as advance:
        lines += ["", *_format_validity(pairs, signs, advance)]
    if images is not None:
        with progress("pictures") as advance:
            corpus_pictures.write_sheets(pairs, signs, images, advance)
    return lines


def signs_by_gloss(pairs: Pairs) -> dict[str, Sign]:
    """Returns gloss -> sign: the signs that ship and the pseudo-signs of a corpus."""
    signs = {**notation.everyday(), **notation.alphabet()}
    glosses = [row["gloss"] for row in pairs.head["words"]]
    pseudo_signs = (gloss for gloss in glosses if gloss.startswith("PSEUDO-"))
    return signs | {gloss: pseudo.draw_sign(int(gloss.removeprefix("PSEUDO-"))) for gloss in pseudo_signs}


def load_real_clips(folder: Path | None, frames: tuple[int, int] | None = None) -> dict[str, Clip]:
    """Returns name -> clip of the BVH files in a folder that hold signing: files named idle and clips that hardly move
    are not read. ``frames``: the half-open range of each clip that is used, and added to its name.

    Raises ``InputError`` for a clip with too few frames in it.
    """
    clips: dict[str, Clip] = {}
    for path in sorted(folder.glob("*.bvh")) if folder is not None else ():
        clip = load(path)
        if "idle" in path.stem.lower() or not _moves(clip):
            continue
        first, stop = (0, len(clip)) if frames is None else (frames[0], min(frames[1], len(clip)))
        if stop - first < FEWEST_FRAMES:
            range_text = "" if frames is None else f" in {frames[0]}:{frames[1]}"
            n = max(0, stop - first)
            raise InputError(f"{path}: has {n} frames{range_text}, expected at least {FEWEST_FRAMES} to measure")
        clips[path.stem if frames is None else f"{path.stem}, frames {first} to {stop - 1}"] = clip[first:stop]
    return clips


def _moves(clip: Clip) -> bool:
    extent = np.ptp(clip.skeleton.offsets, axis=0).max() * rig_info(clip.skeleton).sizes.unit.metres
    return bool(np.ptp(wrist_positions(clip), axis=0).max() > IDLE_EXTENT * extent)


def _format_percents(*fractions: float) -> list[str]:
    return [f"{100 * fraction:.1f}" for fraction in fractions]


def _format_difficulty(pairs: Pairs, signs: Mapping[str, Sign], advance: Progress | None) -> list[str]:
    test = pairs.split("random", "test")[:N_TEST]
    cuts = corpus_difficulty.score_cutters(pairs, test, pairs.split("random", "train"), advance)
    transitions, true_jump = corpus_difficulty.score_transitions(pairs, test[:N_TRANSITIONS], advance)
    return [
        "### Difficulty",
        "",
        f"True cuts found in {len(test)} test pairs of the random split, % of the pairs:",
        "",
        *format_measures(CUT_MEASURES, cuts),
        "",
        *_format_precision(pairs, test, signs),
        "",
        f"Transitions at the true cuts and lengths, {len(test[:N_TRANSITIONS])} of them:",
        "",
        *format_measures(TRANSITION_MEASURES, transitions),
        f"| (truth) | 0 | 1 | {true_jump:.2f} |",
    ]


def _describe_version(pairs: Pairs) -> str:
    commit = MADE_BY.get(pairs.version, "an earlier one")
    return f"Its words and cuts are not planned anew: commit {commit} makes version {pairs.version}."


def _format_precision(pairs: Pairs, test: Sequence[int], signs: Mapping[str, Sign]) -> list[str]:
    if pairs.version != VERSION:
        return [_describe_version(pairs)]
    reading = corpus_difficulty.score_reading(pairs, test, signs)
    return [
        "Precision that a reader needs who knows the rules and the frames of all events. Error: standard deviation of",
        "each coordinate of the strong wrist in every frame, and of the skin distances at the events (finger angles:",
        f"{RAD_PER_CM} rad per cm). Pairs with both frames right, %:",
        "",
        *format_table(
            ("error, cm", *(f"{r.error_cm:g}" for r in reading)),
            [
                ("exact", *_format_percents(*(r.exact for r in reading))),
                ("within one frame", *_format_percents(*(r.near for r in reading))),
            ],
        ),
    ]


def _format_validity(pairs: Pairs, signs: Mapping[str, Sign], advance: Progress | None) -> list[str]:
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
    version_lines = []
    if pairs.version == VERSION:
        n_replanned, n_different = corpus_checks.replan(pairs, signs)
        rows.append((f"pairs that differ in any bit, of {n_replanned} drawn and planned anew", n_different))
    else:
        version_lines = ["", _describe_version(pairs)]
    return [
        "### Validity",
        "",
        f"Over all {worst.n_pairs} pairs:",
        "",
        *format_table(("check", "worst"), rows),
        *version_lines,
    ]
