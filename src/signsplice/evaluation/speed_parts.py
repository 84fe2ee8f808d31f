"""Speed of every part beside its baselines, in one run.

Machines differ and share their cores, so what counts are ratios of two things timed in turns, and medians over repeats.
The skeleton has 53 joints; motions are made here, so that the bench needs no file.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
import tracemalloc
from collections.abc import Callable
from dataclasses import replace
from itertools import cycle
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from signsplice.evaluation import speed_learned
from signsplice.formats import bvh
from signsplice.lexicon import building, open_lexicon, shipped
from signsplice.motion import kinematics, rotation
from signsplice.motion.clip import Clip, concatenate, resample
from signsplice.rig.arms import active_span, arms
from signsplice.splicing.cut import CUTTERS, Cut, search_window
from signsplice.splicing.engine import SpliceOptions, splice
from signsplice.splicing.transition import TRANSITIONS

Progress = Callable[[int, int], None]

N_LONG = 3000
N_WORD = 150
N_LEXICON = 6707
"""Words of the dictionary that the paper joins."""


def measure(repeats: int = 15, progress: Progress | None = None) -> dict[str, Any]:
    """Every figure, as medians over ``repeats`` runs: {"part": {"median_ms": .., ...}, ...} with ratios to the
    baselines.
    """
    parts: list[tuple[str, Callable[[int], dict[str, Any]]]] = [
        ("read", _reading),
        ("kinematics", _kinematics),
        ("search", _search),
        ("transition", _transitions),
        ("seam", _seam),
        ("learned", speed_learned.seams),
        ("stream", speed_learned.streams),
        ("lexicon", _lexicon),
        ("memory", lambda _: _memory()),
        ("start", _start),
    ]
    figures: dict[str, Any] = {"joints": len(_demo_words()[0].skeleton), "repeats": repeats}
    for done, (name, part) in enumerate(parts):
        figures[name] = part(repeats)
        if progress is not None:
            progress(done + 1, len(parts))
    return figures


def table(figures: dict[str, Any]) -> str:
    """The figures as lines of text."""
    lines = [f"{figures['joints']} joints, medians of {figures['repeats']} runs"]
    for part, values in figures.items():
        if isinstance(values, dict):
            lines += [f"{part:11} {name:34} {_shown(value)}" for name, value in values.items()]
    return "\n".join(lines)


def _shown(value: object) -> str:
    return f"{value:10.3f}" if isinstance(value, float) else f"{value!s:>10}"


def _alternate(repeats: int, *runs: Callable[[], object]) -> list[float]:
    """Median milliseconds of each run; all take turns, so that the machine's moods fall on all alike."""
    for run in runs:
        run()
    times: list[list[float]] = [[] for _ in runs]
    for _ in range(repeats):
        for n, run in enumerate(runs):
            start = time.perf_counter()
            run()
            times[n].append(1e3 * (time.perf_counter() - start))
    return [median(row) for row in times]


def _demo_words() -> list[Clip]:
    with shipped() as words:
        return [words.clip(gloss) for gloss in ("HELLO", "I", "DEAF", "THANK-YOU", "SIGN")]


def _long_clip(n_frames: int) -> Clip:
    """The demo words again and again, resampled so that no two rounds have the same numbers."""
    rounds: list[Clip] = []
    total = 0
    while total < n_frames:
        for word in _demo_words():
            rounds.append(resample(word, word.fps, 0.9 + 0.01 * (len(rounds) % 20)))
            total += len(rounds[-1])
    return concatenate(rounds)[:n_frames]


def _word_clips() -> tuple[Clip, Clip]:
    """Two words of exactly 150 frames: the same motion, slower."""
    a, b = _demo_words()[2:4]
    clips = [resample(clip, clip.fps, (len(clip) - 1) / (N_WORD - 0.5)) for clip in (a, b)]
    return clips[0][:N_WORD], clips[1][:N_WORD]


def _reading(repeats: int) -> dict[str, Any]:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "long.bvh"
        clip = _long_clip(N_LONG)
        values = bvh.parse(bvh.render(clip).encode())
        text = bvh.render(values).splitlines()
        first = text.index("MOTION") + 3
        rows = [" ".join(f"{float(x):.6f}" for x in row.split()) for row in text[first:]]  # as exporters write them
        path.write_text("\n".join([*text[:first], *rows]) + "\n")
        try:
            import pybvh
        except ImportError:
            (own,) = _alternate(repeats, lambda: bvh.read(path))
            return {"3000 frames, ms": own, "pybvh": "not installed"}
        own, other = _alternate(repeats, lambda: bvh.read(path), lambda: pybvh.read_bvh_file(path, world_up="+y"))
    return {"3000 frames, ms": own, "pybvh 0.9.0, ms": other, "ratio to pybvh": own / other}


def _kinematics(repeats: int) -> dict[str, Any]:
    clip = _long_clip(N_LONG)
    few = clip[:60]
    own, loop = _alternate(repeats, lambda: kinematics.forward(clip), lambda: _forward_by_frame(few))
    scaled = loop * N_LONG / len(few)
    return {"3000 frames, ms": own, "frame by frame, ms": scaled, "times faster": scaled / own}


def _forward_by_frame(clip: Clip) -> None:
    """Forward kinematics the plain way, a frame and a joint at a time: the baseline."""
    for frame in range(len(clip)):
        rotations = list(rotation.to_matrix(clip.local_rotations[frame]))
        positions = [clip.root_positions[frame]] * len(rotations)
        for joint in range(1, len(rotations)):
            parent = clip.skeleton.parents[joint]
            positions[joint] = positions[parent] + rotations[parent] @ clip.skeleton.offsets[joint]
            rotations[joint] = rotations[parent] @ rotations[joint]


def _search(repeats: int) -> dict[str, Any]:
    before, after = _word_clips()
    # Fresh views of the clips every time: what is remembered of a clip must not count.
    runs = [lambda cutter=cutter: cutter.cut(before[:], after[:]) for cutter in CUTTERS.values()]
    plain = CUTTERS["hand-distance"].cut(before, after), _plain_search(before, after)
    if plain[0] != plain[1]:
        raise AssertionError(f"the plain search finds {plain[1]}, the cutter {plain[0]}")
    times = _alternate(10 * repeats, *runs)
    (pairwise,) = _alternate(repeats, lambda: _plain_search(before[:], after[:]))
    out = {f"{name}, ms": ms for name, ms in zip(CUTTERS, times, strict=True)}
    own = out["hand-distance, ms"]
    return out | {"hand-distance pair by pair, ms": pairwise, "times faster": pairwise / own}


def _plain_search(before: Clip, after: Clip) -> Cut:
    """The hand-distance search one pair of frames at a time: the baseline."""
    p, q = arms(before), arms(after)
    (p_start, p_stop), (q_start, q_stop) = active_span(p), active_span(q)
    best, found = float("inf"), Cut(0, 0)
    for i in range(p_stop - search_window(p_stop - p_start, p.fps), p_stop):
        for j in range(q_start, q_start + search_window(q_stop - q_start, q.fps)):
            cost = 0.0
            for hand in range(2):
                way = p.wrists[i, hand] - q.wrists[j, hand]
                turn = rotation.from_matrix(p.hand_rotations[i, hand].T @ q.hand_rotations[j, hand])
                cost += (
                    float(np.linalg.norm(way)) / p.shoulder_width + float(np.linalg.norm(rotation.log(turn))) / np.pi
                )
            if cost < best:
                best, found = cost, Cut(i, j)
    return found


def _transitions(repeats: int) -> dict[str, Any]:
    before, after = _word_clips()
    before, after = before[:90], after[40:]
    runs = [lambda method=method: method.between(before, after, 10) for method in TRANSITIONS.values()]
    times = _alternate(10 * repeats, *runs)
    return {f"{name}, 10 frames, ms": ms for name, ms in zip(TRANSITIONS, times, strict=True)}


def _seam(repeats: int) -> dict[str, Any]:
    """A whole seam of two 150-frame clips on one ground: search, transition, join with its scores."""
    clips = _word_clips()
    out: dict[str, Any] = {}
    for name in CUTTERS:
        parts: dict[str, list[float]] = {"cut": [], "transition": [], "join": []}
        for _ in range(10 * repeats):
            timing = splice([clip[:] for clip in clips], SpliceOptions(name, "hermite", "tempo")).timing_ms
            for part, rows in parts.items():
                rows.append(timing[part])
        out[f"{name} + hermite, ms"] = median(sum(row) for row in zip(*parts.values(), strict=True))
        if name == "rest-trim":
            out |= {f"of it {part}, ms": median(rows) for part, rows in parts.items()}
    return out


def _lexicon(repeats: int) -> dict[str, Any]:
    """A lexicon of 6,707 words opened and closed, and words of 150 frames read from it, each another one, beside one
    BVH file of as many frames. All other words are short, so that the bench writes little.
    """
    clips = _word_clips()
    short = [clip[start : start + 10] for clip in clips for start in range(0, 140, 20)]
    with tempfile.TemporaryDirectory() as folder:
        path, file = Path(folder) / "lexicon", Path(folder) / "word.bvh"
        bvh.write(clips[0], file)
        with building(path) as builder:
            for n in range(N_LEXICON):
                builder.add(short[n % len(short)] if n % 67 else clips[n // 67 % 2], f"WORD-{n}")
        with open_lexicon(path) as lexicon:
            glosses = cycle(f"WORD-{n}" for n in range(0, N_LEXICON, 67))
            opened, read, file_read = _alternate(
                repeats,
                lambda: open_lexicon(path).close(),
                lambda: lexicon.clip(next(glosses)),
                lambda: bvh.read(file),
            )
            (nearest,) = _alternate(3, lambda: lexicon.nearest("WROD-4711"))
    return {
        "6707 words opened, ms": opened,
        "one word of 150 frames, ms": read,
        "the same from a BVH file, ms": file_read,
        "times faster": file_read / read,
        "nearest glosses, ms": nearest,
    }


def _memory() -> dict[str, Any]:
    """Peak of a splice's allocations, what it returns included, over the size of its clips, as read from files.

    Eight clips that all stand in one place; and, the worst of cases, eight that stand each elsewhere and are kept
    whole.
    """
    together = [_from_file(clip) for clip in _word_clips() * 4]
    apart = [
        _from_file(replace(clip, root_positions=clip.root_positions + 7.0 * n, channels=None))
        for n, clip in enumerate(together)
    ]
    out: dict[str, Any] = {"clips, MB": sum(clip.nbytes for clip in together) / 1e6}
    for name, clips, cutter in (("ratio", together, "pose-velocity"), ("ratio at worst", apart, "ends")):
        options = SpliceOptions(cutter, "hermite", "tempo")
        splice(clips, options)
        tracemalloc.start()
        splice(clips, options)
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        out[name] = peak / sum(clip.nbytes for clip in clips)
    return out


def _from_file(clip: Clip) -> Clip:
    return bvh.parse(bvh.render(clip).encode(), name=clip.name)


def _start(repeats: int) -> dict[str, Any]:
    """Whole processes: the help, beside a bare interpreter."""
    help_run = [sys.executable, "-m", "signsplice", "--help"]
    bare_run = [sys.executable, "-c", "pass"]
    own, bare = _alternate(
        min(repeats, 9),
        lambda: subprocess.run(help_run, capture_output=True, check=True),
        lambda: subprocess.run(bare_run, capture_output=True, check=True),
    )
    return {"signsplice --help, ms": own, "bare python, ms": bare, "ratio": own / bare}
