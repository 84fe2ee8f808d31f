"""Draws pictures of a corpus of pairs: a page of plots, and contact sheets of words, letters and pairs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from signsplice.errors import MissingExtraError
from signsplice.formats.atomic import replacing
from signsplice.motion import FloatArray
from signsplice.render.picture import draw, draw_hand, make_scene
from signsplice.render.sheet import Strip, write_cells, write_strips
from signsplice.signer import notation, planner
from signsplice.signer.phonology import Sign
from signsplice.signer.signer import stream
from signsplice_workshop.corpora import pseudo
from signsplice_workshop.corpora.pairs import Pairs
from signsplice_workshop.measure.corpus_realism import WristMotion
from signsplice_workshop.measure.hands import strong_side, strong_wrist
from signsplice_workshop.measure.measures import Quantity

SHEET_WORDS = (
    *("HELLO", "I", "DEAF", "SIGN", "THANK-YOU", "NAME", "MY", "YOU", "SEE", "TOMORROW"),
    *("MOTHER", "BOOK", "LEARN", "HOUSE", "WATER", "PLEASE", "FRIEND", "UNDERSTAND", "TREE", "SCHOOL"),
)
N_ROWS = 10
"""Number of pseudo-signs and of pairs on a sheet."""
REVISED_WORDS = (
    *("PHONE", "I", "WE", "HE-SHE", "BIRD", "fs-P", "fs-Q", "READ", "FEEL", "TASTE", "PLEASE", "SORRY", "DAY", "STAND"),
    *("DANCE", "PROUD", "DIFFERENT", "RESPONSIBLE", "GIRAFFE", "ANGRY", "ELEPHANT", "DOG", "SIT", "ACT", "HIS-HER"),
    *("PAST", "KING", "HOSPITAL", "WALK", "CLIMB", "PURPLE", "BOSS", "FISH", "FORGET", "MORNING", "SMELL", "SWEET"),
    *("BROWN", "LAUGH", "PATIENT", "FUNNY", "LOOK", "OUR", "WORK"),
)
"""Words and letters whose form was changed after published descriptions."""
_BLUE, _AMBER = "#3f6fa8", "#de8e20"


def write_sheets(
    pairs: Pairs, signs: Mapping[str, Sign], images: Path, advance: Callable[[int, int], None] | None
) -> None:
    """Writes contact sheets of twenty words, all letters, ten pseudo-signs and ten pairs into a folder. Pseudo-signs
    and pairs have a second row, seen from the side, if the hand moves mostly forward or back.
    """
    words = [planner.synthesize_word(signs[gloss]) for gloss in SHEET_WORDS if gloss in signs]
    n_first = (len(words) + 1) // 2
    for n, sheet_words in enumerate((words[:n_first], words[n_first:]), 1):
        write_strips([_word_strip(word) for word in sheet_words], images / f"corpus-words-{n}.png", progress=advance)
    letters = [planner.synthesize_word(sign) for sign in notation.alphabet().values()]
    _write_letters(letters, images / "corpus-letters.png")
    pseudo_words = [planner.synthesize_word(pseudo.draw_sign(seed)) for seed in range(N_ROWS)]
    rows = [strip for word in pseudo_words for strip in _add_side_view(_word_strip(word))]
    write_strips(rows, images / "corpus-pseudo.png", progress=advance)
    write_front_and_side(REVISED_WORDS, images / "corpus-mended.png")
    n_words = len(pairs.head["words"]) // 2
    first = np.flatnonzero(pairs.index[:, 0] < n_words)
    chosen = stream("sheet", n_words).choice(first, min(N_ROWS, len(first)), replace=False).tolist()
    rows = [strip for k in chosen for strip in _add_side_view(_pair_strip(pairs, k))]
    write_strips(rows, images / "corpus-pairs.png", progress=advance)


def _add_side_view(strip: Strip) -> list[Strip]:
    """Returns a row from the front, and one from the side if the strong wrist moves farther forward and back than it
    does sideways or up, between the second frame shown and the last but one.
    """
    wrist = strong_wrist(strip.clip[strip.frames[1] : strip.frames[-2] + 1], strip.hand)
    sideways, up, forward = np.ptp(wrist, axis=0)
    side = replace(strip, caption=f"{strip.caption}, from the side", view="side")
    return [strip, side] if forward > max(sideways, up) else [strip]


def _word_strip(word: planner.IsolatedWord) -> Strip:
    """Returns a strip of a frame of the preparation, eight of the sign, and one of the retraction."""
    events = word.events
    inner = np.linspace(events.start, events.end, 8).round().astype(int).tolist()
    return Strip(word.clip, word.sign.gloss, [(events.up + events.start) // 2, *inner, (events.end + events.down) // 2])


def _pair_strip(pairs: Pairs, number: int) -> Strip:
    """Returns a strip of frames on either side of the transition and up to four of the transition, which are framed."""
    pre, _, _ = pairs.truth(number)
    count = int(pairs.index[number, 5])
    clip = pairs.clip(number)
    gap_frames = list(range(pre + 1, pre + 1 + count))
    inner = [gap_frames[k] for k in np.linspace(0, count - 1, min(4, count)).round().astype(int)]
    frames = [
        pre - 6,
        pre - 3,
        pre,
        *inner,
        gap_frames[-1] + 1,
        gap_frames[-1] + 4,
        gap_frames[-1] + 7,
    ]
    caption, shown = clip.name.replace(" ", " > "), [min(frame, len(clip) - 1) for frame in frames]
    return Strip(clip, caption, shown, gap_frames, hand=strong_side(pairs))


def _write_letters(letters: Sequence[planner.IsolatedWord], path: Path, columns: int = 9, size: int = 150) -> None:
    """Writes every letter's hand at the middle of its hold, large, on one page."""
    cells = []
    for letter in letters:
        frame = (letter.events.start + letter.events.end) // 2
        cells.append((draw_hand(make_scene(letter.clip), frame, "right", size), letter.sign.gloss.removeprefix("fs-")))
    write_cells(cells, path, columns, 128)


def write_front_and_side(glosses: Sequence[str], path: Path, columns: int = 3, size: int = 140) -> None:
    """Writes a page of words and letters of this package, with two frames of each from the front, then from the side:
    the first posture, and the last posture or the end of the first of several passes.
    """
    signs = {**notation.everyday(), **notation.alphabet()}
    cells = []
    for gloss in glosses:
        word = planner.synthesize_word(signs[gloss])
        events = word.events
        frames = (events.start, events.passes[0][1] if len(events.passes) > 1 else events.end)
        scenes = [make_scene(word.clip, view) for view in ("front", "side")]
        cells.append((np.hstack([draw(scene, frame, size, size) for scene in scenes for frame in frames]), gloss))
    write_cells(cells, path, columns, 64)


def check_matplotlib() -> None:
    """Raises ``MissingExtraError`` without matplotlib."""
    try:
        import matplotlib
    except ImportError as error:
        raise MissingExtraError(
            "plots need matplotlib: pip install './workshop[plots]' in signsplice's folder"
        ) from error
    matplotlib.use("Agg")


def write_plot(
    durations: Sequence[Quantity], motion: WristMotion, bends: Mapping[str, Mapping[str, FloatArray]], path: Path
) -> None:
    """Writes four plots: durations, speeds at the ends of transitions, wrist speeds, finger ranges.

    bends: column -> finger joint -> its bend, degrees, of the corpus and of real clips.
    """
    check_matplotlib()
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(2, 2, figsize=(10.5, 7.2), constrained_layout=True)
    _plot_durations(axes[0, 0], durations)
    _plot_ends(axes[0, 1], motion)
    _plot_speeds(axes[1, 0], motion)
    _plot_bends(axes[1, 1], bends)
    with replacing(path) as temporary:
        figure.savefig(temporary, dpi=110)
    pyplot.close(figure)


def _plot_durations(ax: Any, durations: Sequence[Quantity]) -> None:
    for n, quantity in enumerate(durations):
        for values, shift, colour in ((quantity.ours, -0.13, _BLUE), (quantity.real, 0.13, _AMBER)):
            ax.plot([values[0], values[4]], [n + shift] * 2, color=colour, lw=1)
            ax.plot([values[1], values[3]], [n + shift] * 2, color=colour, lw=6, solid_capstyle="butt")
            ax.plot(values[2], n + shift, "k|", ms=9)
    ax.set_yticks(range(len(durations)), [f"{quantity.name}\n{quantity.source}" for quantity in durations], fontsize=8)
    ax.invert_yaxis()
    ax.set(title="durations: corpus (blue), real (amber)", xlabel="ms; 5, 25, 50, 75, 95 %")


def _plot_ends(ax: Any, motion: WristMotion) -> None:
    bins = np.linspace(0.0, 1.15, 24)
    for fractions, name, colour, real in ((motion.start, "start", _BLUE, 0.69), (motion.end, "end", _AMBER, 0.52)):
        ax.hist(fractions, bins=bins, histtype="step", color=colour, label=name)
        ax.axvline(real, color=colour, ls=":", label=f"{name}, DGS Corpus")
    ax.set(title="speed at the ends of transitions", xlabel="speed / peak", ylabel="pairs")
    ax.legend(fontsize=8)


def _plot_speeds(ax: Any, motion: WristMotion) -> None:
    style: dict[str, Any] = {"bins": 60, "range": (0.0, 3.0), "density": True}
    ax.hist(motion.speed, color=_BLUE, alpha=0.75, label="all frames", **style)
    ax.hist(motion.peak, histtype="step", color=_AMBER, label="transition peaks", **style)
    ax.set(title="strong wrist's speed in pairs", xlabel="m/s", ylabel="density")
    ax.legend(fontsize=8)


def _plot_bends(ax: Any, bends: Mapping[str, Mapping[str, FloatArray]]) -> None:
    joints = list(bends["corpus"])
    for k, (name, column) in enumerate(bends.items()):
        shift = 0.25 * (k - 0.5 * (len(bends) - 1))
        for n, joint in enumerate(joints):
            if joint in column:
                low, high = np.percentile(column[joint], (5, 95))
                ax.plot([n + shift] * 2, [low, high], color=f"C{k}", lw=3, label=name if n == 0 else None)
    ax.set_xticks(range(len(joints)), joints, rotation=90, fontsize=7)
    ax.set(title="bend of finger joints, 5 to 95 %", ylabel="degrees", ylim=(-5.0, 180.0))
    ax.legend(fontsize=8, loc="upper left")
