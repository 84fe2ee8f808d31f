"""The corpus on a page: tables between two marks of a Markdown file, plots and contact sheets beside it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import numpy as np

from signsplice.errors import InputError, MissingExtraError
from signsplice.evaluation import corpus_checks, corpus_difficulty, corpus_realism
from signsplice.formats import load
from signsplice.formats.atomic import read_bytes, replacing
from signsplice.motion.clip import Clip
from signsplice.render.strips import Strip, write_strips
from signsplice.synth import notation, planner, pseudo
from signsplice.synth.corpus import Pairs
from signsplice.synth.phonology import Sign
from signsplice.synth.rng import stream

BEGIN, END = "<!-- measured: begin -->", "<!-- measured: end -->"
Advance = Callable[[str], AbstractContextManager[Callable[[int, int], None] | None]]

N_TEST = 1000
SHEET_WORDS = (
    *("HELLO", "I", "DEAF", "SIGN", "THANK-YOU", "NAME", "MY", "YOU", "SEE", "TOMORROW"),
    *("MOTHER", "BOOK", "LEARN", "HOUSE", "WATER", "PLEASE", "FRIEND", "UNDERSTAND", "TREE", "SCHOOL"),
)


def write(pairs: Pairs, page: Path, images: Path, real: Mapping[str, Clip], progress: Advance) -> None:
    """Measure a corpus and put what was found into ``page`` between its marks; pictures go to ``images``.

    real: clips of real signing by name, for the columns beside ours. progress: makes a progress bar by name. Raises
    ``InputError`` for a page without the marks, ``MissingExtraError`` without matplotlib or Pillow.
    """
    text = read_bytes(page).decode("utf-8")
    if BEGIN not in text or END not in text:
        raise InputError(f"{page}: has no lines {BEGIN} and {END}, expected both; what is measured goes between them")
    _matplotlib()
    signs = _signs(pairs)
    lines = [
        f"Corpus `{pairs.head['hash']}`: {len(pairs)} pairs, seed {pairs.head['seed']}, {pairs.head['fps']:g} fps.",
        "",
    ]
    with progress("true to life") as advance:
        lines += _realism(pairs, real, images / "corpus-life.png")
        if advance is not None:
            advance(1, 1)
    with progress("not trivial") as advance:
        lines += _difficulty(pairs, signs, advance)
    with progress("sound") as advance:
        lines += _checks(pairs, signs, advance)
    with progress("pictures") as advance:
        _sheets(pairs, signs, images, advance)
    before, after = text.split(BEGIN)[0], text.split(END, 1)[1]
    with replacing(page) as temporary:
        temporary.write_text(before + BEGIN + "\n" + "\n".join(lines).rstrip() + "\n" + END + after, encoding="utf-8")


def _signs(pairs: Pairs) -> dict[str, Sign]:
    """The signs that ship and the pseudo-signs of a corpus, by gloss."""
    known = {**notation.everyday(), **notation.alphabet()}
    glosses = (row["gloss"] for row in pairs.head["words"])
    drawn = {gloss: pseudo.sign(int(gloss.removeprefix("PSEUDO-"))) for gloss in glosses if gloss.startswith("PSEUDO-")}
    return known | drawn


def read_real(folder: Path | None) -> dict[str, Clip]:
    """The clips of real signing in a folder by name, those that move: idle ones and still ones are left out."""
    if folder is None:
        return {}
    clips = {path.stem: load(path) for path in sorted(folder.glob("*.bvh"))}
    moving = {}
    for name, clip in clips.items():
        places = np.concatenate(corpus_realism.wrists(clip), axis=-1)
        if (
            np.ptp(places, axis=0).max() > 0.2 * np.ptp(clip.skeleton.offsets, axis=0).max()
            and "idle" not in name.lower()
        ):
            moving[name] = clip
    return moving


def _row(cells: Sequence[object]) -> str:
    return "| " + " | ".join(str(cell) for cell in cells) + " |"


def _table(head: Sequence[str], rows: Sequence[Sequence[object]]) -> list[str]:
    return [_row(head), _row(["---"] * len(head)), *map(_row, rows), ""]


def _number(value: float) -> str:
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"


def _realism(pairs: Pairs, real: Mapping[str, Clip], plot: Path) -> list[str]:
    seen = corpus_realism.moving(pairs)
    quantities = corpus_realism.times(pairs) + corpus_realism.motion_quantities(pairs, seen)
    rows = []
    for q in quantities:
        told = " to ".join(map(_number, q.real)) if len(q.real) == 2 else " / ".join(map(_number, q.real))
        ours = " / ".join(map(_number, q.ours))
        rows.append((q.name, q.unit, ours, told, q.source, f"{q.ratio:.2f}", "yes" if q.agrees else "no"))
    lines = [
        "### True to life",
        "",
        "5 / 25 / 50 / 75 / 95 %, beside published figures; agrees: medians within 20 % (of a range's nearer end).",
    ]
    lines += ["", *_table(("quantity", "unit", "corpus", "real", "from", "ratio", "agrees"), rows)]
    clips = [
        pairs.clip(int(k)) for k in stream("shapes", len(pairs)).choice(len(pairs), min(60, len(pairs)), replace=False)
    ]
    columns: dict[str, Sequence[Clip]] = {"corpus": clips, **{name: [clip] for name, clip in real.items()}}
    lines += [f"Shape of motion ({len(clips)} drawn pairs; real clips whole):", ""]
    lines += _table(
        ("quantity", *columns), [(name, *(_number(f(c)) for c in columns.values())) for name, f in _SHAPES.items()]
    )
    lines += [f"Path over chord of transitions: {np.median(seen.detour):.2f} (median, those over 3 cm).", ""]
    bends = {name: _bends(part) for name, part in columns.items()}
    lines += ["Bend of the finger joints, degrees, 5 to 95 % (1 is the joint nearest to the wrist):", ""]
    lines += _table(
        ("joint", *columns),
        [(joint, *(_range(bends[name].get(joint)) for name in columns)) for joint in bends["corpus"]],
    )
    _plot(pairs, seen, bends, plot)
    return [*lines, f"![Times, speeds and finger ranges of the corpus]({plot.parent.name}/{plot.name})", ""]


def _paths(clips: Sequence[Clip]) -> list[Any]:
    from signsplice.rig import proportions

    return [corpus_realism.wrists(clip)[0] * proportions.sizes(clip.skeleton).unit.metres for clip in clips]


_SHAPES: dict[str, Callable[[Sequence[Clip]], float]] = {
    "exponent of speed over curvature (two-thirds law: -0.33)": lambda c: corpus_realism.power_law(_paths(c), c[0].fps),
    "rms jerk of the strong wrist, m/s^3": lambda c: corpus_realism.rms_jerk(_paths(c), c[0].fps),
    "mean speed of the strong wrist, m/s": lambda c: float(
        np.mean(np.concatenate([np.linalg.norm(np.diff(p, axis=0), axis=-1) * c[0].fps for p in _paths(c)]))
    ),
    "fingertip motion ratio of slerp over 18 hidden frames": lambda c: corpus_realism.slerp_motion_ratio(c),
}


def _bends(clips: Sequence[Clip]) -> dict[str, Any]:
    every = [corpus_realism.flexions(clip) for clip in clips]
    return {joint: np.concatenate([one[joint] for one in every]) for joint in every[0]}


def _range(values: Any) -> str:
    return "-" if values is None else "{:.0f} to {:.0f}".format(*np.percentile(values, (5, 95)))


def _difficulty(pairs: Pairs, signs: Mapping[str, Sign], advance: Callable[[int, int], None] | None) -> list[str]:
    test = pairs.split("random", "test")[:N_TEST]
    found = corpus_difficulty.cutters(pairs, test, pairs.split("random", "train"), advance)
    filled, true_jump = corpus_difficulty.transitions(pairs, test[:300], advance)
    lines = ["### Not trivial", "", f"Positions found, {len(test)} test pairs of the random split, shares in %:", ""]
    lines += _table(
        ("rule", "both exact", "leave exact", "enter exact", "both within 2", "mean distance, frames"),
        [
            (f.rule, *(f"{100 * share:.1f}" for share in (f.exact, f.leave, f.enter, f.near)), f"{f.distance:.2f}")
            for f in found
        ],
    )
    seen = corpus_difficulty.reading(pairs, test, signs)
    lines += [
        "How exactly a reader must see who knows the rules and all events: error of the strong wrist in every frame",
        f"(spread of a coordinate; of the finger angles {corpus_difficulty.RAD_PER_CM} rad a cm), and the share of pairs with",
        "both positions exact, in %:",
        "",
    ]
    lines += _table(
        ("error, cm", *(f"{error:g}" for error in seen)), [("exact", *(f"{100 * s:.1f}" for s in seen.values()))]
    )
    lines += [f"Transitions at the true positions and lengths, {len(test[:300])} of them:", ""]
    lines += _table(
        ("transition", "position error, arm / 1000", "motion ratio", "velocity jump, m/s"),
        [(f.transition, f"{f.position_error:.1f}", f"{f.motion_ratio:.2f}", f"{f.velocity_jump:.2f}") for f in filled]
        + [("(truth)", "0", "1", f"{true_jump:.2f}")],
    )
    return lines


def _checks(pairs: Pairs, signs: Mapping[str, Sign], advance: Callable[[int, int], None] | None) -> list[str]:
    s = corpus_checks.examine(pairs, advance)
    n_anew, n_wrong = corpus_checks.n_misplaced(pairs, signs)
    rows = [
        ("deepest a hand lies in head, trunk or the other hand: in words", f"{10 * s.deepest_word_cm:.1f} mm"),
        ("the same in transitions", f"{10 * s.deepest_new_cm:.1f} mm"),
        ("pairs deeper than 5 mm anywhere", s.n_too_deep),
        ("most over a limit of elbow, forearm, wrist or finger", f"{s.over_limit_deg:.2f} degrees"),
        ("largest change of a bone's length", f"{s.bone_change_cm:.1e} cm"),
        ("largest step of any joint at a seam, in words", f"{s.seam_step_cm:.1f}, {s.word_step_cm:.1f} cm a frame"),
        ("largest change of a wrist's step at a seam", f"{s.seam_turn:.1f} cm"),
        ("pairs whose positions lie outside the stored frames", s.n_misplaced),
        (f"of {n_anew} drawn pairs signed anew, those that differ in any bit", n_wrong),
    ]
    return ["### Sound", "", f"Over all {s.n_pairs} pairs:", "", *_table(("what", "found"), rows)]


def _sheets(pairs: Pairs, signs: Mapping[str, Sign], images: Path, advance: Callable[[int, int], None] | None) -> None:
    """Contact sheets: words, letters, pairs."""
    words = [planner.isolated(signs[g]) for g in SHEET_WORDS if g in signs]
    half = (len(words) + 1) // 2
    for n, part in enumerate((words[:half], words[half:]), 1):
        write_strips([_word_strip(word) for word in part], images / f"corpus-words-{n}.png", progress=advance)
    letters = [planner.isolated(sign) for sign in notation.alphabet().values()]
    _write_letters(letters, images / "corpus-letters.png")
    count = len(pairs.head["words"]) // 2
    chosen = stream("sheet", count).choice(np.flatnonzero(pairs.index[:, 0] < count), 10, replace=False).tolist()
    write_strips([_pair_strip(pairs, k) for k in chosen], images / "corpus-pairs.png", progress=advance)


def _word_strip(word: planner.IsolatedWord) -> Strip:
    e = word.events
    inner = np.linspace(e.start, e.end, 8).round().astype(int).tolist()
    return Strip(word.clip, word.sign.gloss, [(e.up + e.start) // 2, *inner, (e.end + e.down) // 2])


def _pair_strip(pairs: Pairs, number: int) -> Strip:
    pre, _, _ = pairs.truth(number)
    count = int(pairs.index[number, 5])
    clip = pairs.clip(number)
    new = list(range(pre + 1, pre + 1 + count))
    inner = [new[k] for k in np.linspace(0, count - 1, min(4, count)).round().astype(int)]
    frames = [pre - 6, pre - 3, pre, *inner, new[-1] + 1, new[-1] + 4, new[-1] + 7]
    return Strip(clip, clip.name.replace(" ", " > "), [min(f, len(clip) - 1) for f in frames], new)


def _write_letters(letters: Sequence[planner.IsolatedWord], path: Path, columns: int = 9, size: int = 150) -> None:
    """Every letter's hand at the middle of its hold, large, on one page."""
    from signsplice.render.page import INK, PAPER, pillow, write_line
    from signsplice.render.picture import draw_hand, scene

    image_ = pillow("Image")
    rows = -(-len(letters) // columns)
    sheet = image_.new("RGB", (columns * size, rows * (size + 22)), PAPER)
    pen = pillow("ImageDraw").Draw(sheet)
    for n, letter in enumerate(letters):
        frame = (letter.events.start + letter.events.end) // 2
        x, y = n % columns * size, n // columns * (size + 22)
        sheet.paste(image_.fromarray(draw_hand(scene(letter.clip), frame, "right", size)), (x, y))
        write_line(pen, letter.sign.gloss.removeprefix("fs-"), x + 0.5 * size, y + size + 2, size, INK, 15)
    sheet.save(path, format="PNG")


def _matplotlib() -> Any:
    try:
        import matplotlib
    except ImportError as error:
        raise MissingExtraError("plots need matplotlib: pip install 'signsplice[paper]'") from error
    matplotlib.use("Agg")
    from matplotlib import pyplot

    return pyplot


def _plot(pairs: Pairs, seen: corpus_realism.Moving, bends: Mapping[str, Mapping[str, Any]], path: Path) -> None:
    """Four plots: times, speeds over a transition, wrist speeds, finger ranges."""
    pyplot = _matplotlib()
    figure, axes = pyplot.subplots(2, 2, figsize=(10.5, 7.2), constrained_layout=True)
    blue, amber = "#3f6fa8", "#de8e20"
    rows = corpus_realism.times(pairs)
    ax = axes[0, 0]
    for n, q in enumerate(rows):
        for values, shift, colour in ((q.ours, -0.13, blue), (q.real, 0.13, amber)):
            ax.plot([values[0], values[4]], [n + shift] * 2, color=colour, lw=1)
            ax.plot([values[1], values[3]], [n + shift] * 2, color=colour, lw=6, solid_capstyle="butt")
            ax.plot(values[2], n + shift, "k|", ms=9)
    ax.set_yticks(range(len(rows)), [q.name for q in rows])
    ax.invert_yaxis()
    ax.set(title="times: corpus (blue), Czech Sign Language (amber)", xlabel="ms; 5, 25, 50, 75, 95 %")
    ax = axes[0, 1]
    bins = np.linspace(0.0, 1.15, 24)
    for shares, name, colour, real in ((seen.start, "start", blue, 0.69), (seen.end, "end", amber, 0.52)):
        ax.hist(shares, bins=bins, histtype="step", color=colour, label=name)
        ax.axvline(real, color=colour, ls=":", label=f"{name}, DGS Corpus")
    ax.set(title="speed at the ends of transitions over their peak", xlabel="share", ylabel="pairs")
    ax.legend(fontsize=8)
    ax = axes[1, 0]
    ax.hist(seen.speed, bins=60, range=(0.0, 3.0), color=blue, alpha=0.75, density=True, label="all frames")
    ax.hist(seen.peak, bins=60, range=(0.0, 3.0), histtype="step", color=amber, density=True, label="transition peaks")
    ax.set(title="strong wrist's speed in pairs", xlabel="m/s", ylabel="density")
    ax.legend(fontsize=8)
    ax = axes[1, 1]
    joints = list(bends["corpus"])
    for k, (name, table) in enumerate(bends.items()):
        shift = 0.25 * (k - 0.5 * (len(bends) - 1))
        for n, joint in enumerate(joints):
            if joint in table:
                low, high = np.percentile(table[joint], (5, 95))
                ax.plot([n + shift] * 2, [low, high], color=f"C{k}", lw=3, label=name if n == 0 else None)
    ax.set_xticks(range(len(joints)), joints, rotation=90, fontsize=7)
    ax.set(title="bend of finger joints, 5 to 95 %", ylabel="degrees")
    ax.legend(fontsize=8)
    figure.savefig(path, dpi=110)
    pyplot.close(figure)
