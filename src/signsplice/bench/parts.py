"""Speed of every part and of its baselines, and of the shipped networks: seams, sentences and streams.

Machines differ and share their cores, so most figures are medians over repeats and ratios of alternating calls. The
skeleton has 53 joints; the motions are shipped words, so that the benchmark needs no other file.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
import tracemalloc
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import partial
from itertools import count, cycle, islice
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from signsplice.formats import bvh, load, save
from signsplice.lexicon import building, open_lexicon, open_shipped_lexicon
from signsplice.motion import Clip, FloatArray, concatenate, kinematics, resample, rotation
from signsplice.progress import Progress, track_progress
from signsplice.rig.info import active_span, arms
from signsplice.splicing import cards
from signsplice.splicing.bulk_splice import splice_many
from signsplice.splicing.contracts import Cut, Cutter, Gap
from signsplice.splicing.curves import TRANSITIONS
from signsplice.splicing.cutters import CUTTERS, search_window
from signsplice.splicing.engine import SpliceOptions, Stream, splice, stream
from signsplice.splicing.learned import LearnedCutter
from signsplice.splicing.options import choose


def milliseconds(run: Callable[[], object]) -> float:
    """Measure the processor time of one call, with that of processes that it waits for, ms."""
    start, start_of_others = time.process_time(), _others_seconds()
    run()
    return 1e3 * (time.process_time() - start + _others_seconds() - start_of_others)


def _others_seconds() -> float:
    """Return the processor time of processes that this one has waited for, seconds; 0 where no system tells."""
    try:
        import resource
    except ImportError:  # Windows
        return 0.0
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def median_milliseconds(repeats: int, *runs: Callable[[], object]) -> list[float]:
    """Measure the median time of each call, ms. The calls alternate, so that changes of speed affect all alike."""
    for run in runs:
        run()
    times = [[milliseconds(run) for run in runs] for _ in range(repeats)]
    return [median(column) for column in zip(*times, strict=True)]


def forget(clips: Iterable[Clip]) -> None:
    """Clear derived values of clips, so that the next call computes them again."""
    for clip in clips:
        clip.derived.clear()


N_STREAM = 1000
"""Maximum number of words of a long stream; fewer with few repeats."""
N_WARM_UP = 20
"""Number of seams before the first timed one."""


def _sentences(n_words: int, count: int, warm: int = N_WARM_UP) -> Iterator[list[Clip]]:
    """Yield sentences of shipped words as a caller gets them from the lexicon: new clips, with cards. The first
    ``warm`` ones are spliced, and not yielded.
    """
    rng = np.random.default_rng(n_words)
    cards.forget()
    with open_shipped_lexicon() as words:
        glosses = list(words)
        for n in range(count + warm):
            clips = [words.clip(glosses[k]) for k in rng.choice(len(glosses), n_words, replace=False)]
            if n < warm:
                splice(clips)
            else:
                cards.forget()  # they are read from the lexicon
                yield clips


def _without_card(clip: Clip, number: int) -> Clip:
    """Return a clip of which nothing is known: it stands some nanometres aside."""
    roots = clip.root_positions + 1e-9 * (number + 1)
    return Clip(clip.skeleton, clip.local_rotations, roots, clip.fps, clip.name)


def _learned_seams(repeats: int) -> dict[str, Any]:
    """Measure the time of whole seams as a caller pays for them (features, cut, duration, transition, collision
    avoidance, join, scores): of words of a lexicon, with cards; of clips of which nothing is known; of ten words; of
    many sentences at once; and of the networks in them. The baseline joins two words by slerp at constant speed.
    """
    cutter = choose().cutter
    if not isinstance(cutter, LearnedCutter):
        return {"networks": "none to be read"}
    sessions, number = cutter.reader.sessions, count(1)
    known, inside, unknown, classical, plain = [], [], [], [], []
    for pair in _sentences(2, 20 * repeats):
        seconds = sessions.seconds
        known.append(milliseconds(partial(splice, pair)))
        inside.append(1e3 * (sessions.seconds - seconds))
        new = [_without_card(clip, next(number)) for clip in pair]
        unknown.append(milliseconds(partial(splice, new)))
        classical.append(milliseconds(partial(splice, pair, SpliceOptions("pose-velocity", "hermite", "fixed"))))
        plain.append(milliseconds(partial(_join_by_slerp, *pair)))
    ten = [milliseconds(partial(splice, clips)) / 9.0 for clips in _sentences(10, 2 * repeats)]
    many = list(_sentences(10, 12))
    batches = [milliseconds(partial(splice_many, many)) / (9.0 * len(many)) for _ in range(max(3, repeats // 3))]
    return {
        "seam, p50, ms": float(np.percentile(known, 50)),
        "seam, p99, ms": float(np.percentile(known, 99)),
        "of it networks, ms": median(inside),
        "seam of clips without cards, p50, ms": median(unknown),
        "seam of ten words, ms": median(ten),
        "seam of splice_many, ms": median(batches),
        "classical seam, ms": median(classical),
        "two words by slerp alone, ms": median(plain),
    }


def _join_by_slerp(before: Clip, after: Clip) -> FloatArray:
    """Return rotations (T, J, 4) of two whole words with eight frames at constant speed between them, the baseline."""
    alpha = np.linspace(0.0, 1.0, 10)[1:-1, None]
    between = rotation.slerp(before.local_rotations[-1], after.local_rotations[0], alpha)
    return np.concatenate([before.local_rotations, between, after.local_rotations])


def streams(repeats: int) -> dict[str, Any]:
    """Measure the time from the arrival of the second word to the first piece; and, of a long stream, the time per word
    and the ratios of its second half to its first, in time and in peak memory ("second half by first").
    """
    firsts = []
    for before, after in _sentences(2, 4 * repeats):
        growing = Stream()
        growing.push(before)
        firsts.append(milliseconds(partial(growing.push, after)))
    n_words = min(N_STREAM, 40 * repeats)
    peaks, seconds = [], []
    for traced in (False, True):
        pieces = stream(clip for (clip,) in _sentences(1, n_words, warm=0))
        for _ in range(2):
            if traced:
                tracemalloc.start()
            half = islice(pieces, n_words)  # a word makes two pieces
            seconds.append(1e-3 * milliseconds(partial(deque, half, maxlen=0)))
            if traced:
                peaks.append(tracemalloc.get_traced_memory()[1])
                tracemalloc.stop()
    return {
        "first piece, ms": median(firsts),
        f"{n_words} words, a word, ms": 1e3 * (seconds[0] + seconds[1]) / n_words,
        "second half by first, time": seconds[1] / seconds[0],
        "second half by first, memory": peaks[1] / peaks[0],
    }


N_LONG_FRAMES = 3000
N_WORD_FRAMES = 150
N_LEXICON = 6707
"""Number of words of the dictionary in the paper."""


def measure(repeats: int = 15, progress: Progress | None = None) -> dict[str, Any]:
    """Return part -> figure with its unit -> value, with ratios to the baselines. Most values are medians over runs:
    ``repeats``, or a multiple of it for short parts.
    """
    parts: list[tuple[str, Callable[[int], dict[str, Any]]]] = [
        ("read", _reading),
        ("kinematics", _kinematics),
        ("search", _search),
        ("transition", _transitions),
        ("learned", _learned_seams),
        ("stream", streams),
        ("lexicon", _lexicon),
        ("memory", lambda _: _memory()),
        ("start", _start),
    ]
    figures: dict[str, Any] = {"joints": len(_demo_words()[0].skeleton), "repeats": repeats}
    for name, part in track_progress(parts, progress):
        figures[name] = part(repeats)
    return figures


def table(figures: dict[str, Any]) -> str:
    """Format the figures as lines of text."""
    lines = [f"{figures['joints']} joints, medians of {figures['repeats']} runs"]
    for part, values in figures.items():
        if isinstance(values, dict):
            lines += [f"{part:11} {name:34} {_format_value(value)}" for name, value in values.items()]
    return "\n".join(lines)


def _format_value(value: object) -> str:
    return f"{value:10.3f}" if isinstance(value, float) else f"{value!s:>10}"


def _demo_words() -> list[Clip]:
    with open_shipped_lexicon() as words:
        return [words.clip(gloss) for gloss in ("HELLO", "I", "DEAF", "THANK-YOU", "SIGN")]


def _long_clip(n_frames: int) -> Clip:
    """Repeat the demo words, resampled each time so that no two frames are equal."""
    parts: list[Clip] = []
    for word in cycle(_demo_words()):
        if sum(map(len, parts)) >= n_frames:
            break
        parts.append(resample(word, word.fps, 0.9 + 0.01 * (len(parts) % 20)))
    return concatenate(parts)[:n_frames]


def _word_clips() -> tuple[Clip, Clip]:
    """Return two words slowed down to exactly 150 frames."""
    a, b = _demo_words()[2:4]
    clips = [resample(clip, clip.fps, (len(clip) - 1) / (N_WORD_FRAMES - 0.5)) for clip in (a, b)]
    return clips[0][:N_WORD_FRAMES], clips[1][:N_WORD_FRAMES]


def _reading(repeats: int) -> dict[str, Any]:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "long.bvh"
        clip = _long_clip(N_LONG_FRAMES)
        parsed = bvh.parse(bvh.encode(clip))
        lines = bvh.encode(parsed).decode().splitlines()
        first = lines.index("MOTION") + 3
        rows = [" ".join(f"{float(x):.6f}" for x in row.split()) for row in lines[first:]]  # as exporters write them
        path.write_text("\n".join([*lines[:first], *rows]) + "\n")
        try:
            import pybvh
        except ImportError:
            (ours,) = median_milliseconds(repeats, lambda: load(path))
            return {"3000 frames, ms": ours, "pybvh": "not installed"}
        ours, theirs = median_milliseconds(
            repeats, lambda: load(path), lambda: pybvh.read_bvh_file(path, world_up="+y")
        )
    return {"3000 frames, ms": ours, "pybvh 0.9.0, ms": theirs, "ratio to pybvh": ours / theirs}


def _kinematics(repeats: int) -> dict[str, Any]:
    clip = _long_clip(N_LONG_FRAMES)
    few = clip[:60]
    ours, loop = median_milliseconds(repeats, lambda: kinematics.forward(clip), lambda: _forward_by_frame(few))
    scaled = loop * N_LONG_FRAMES / len(few)
    return {"3000 frames, ms": ours, "frame by frame, ms": scaled, "times faster": scaled / ours}


def _forward_by_frame(clip: Clip) -> None:
    """Compute forward kinematics one frame and one joint at a time, as the baseline."""
    for frame in range(len(clip)):
        rotations = list(rotation.to_matrix(clip.local_rotations[frame]))
        positions = [clip.root_positions[frame]] * len(rotations)
        for joint in range(1, len(rotations)):
            parent = clip.skeleton.parents[joint]
            positions[joint] = positions[parent] + rotations[parent] @ clip.skeleton.offsets[joint]
            rotations[joint] = rotations[parent] @ rotations[joint]


def _search(repeats: int) -> dict[str, Any]:
    before, after = _word_clips()

    def cut_anew(cutter: Cutter) -> Cut:
        forget([before, after])
        return cutter.cut(before, after)

    def search_anew() -> Cut:
        forget([before, after])
        return _plain_search(before, after)

    runs = [partial(cut_anew, cutter) for cutter in CUTTERS.values()]
    cut, plain_cut = CUTTERS["hand-distance"].cut(before, after), _plain_search(before, after)
    if cut != plain_cut:
        raise AssertionError(f"the plain search found {plain_cut}, the cutter {cut}, expected the same")
    times = median_milliseconds(10 * repeats, *runs)
    (pairwise,) = median_milliseconds(repeats, search_anew)
    figures = {f"{name}, ms": ms for name, ms in zip(CUTTERS, times, strict=True)}
    ours = figures["hand-distance, ms"]
    return figures | {"hand-distance pair by pair, ms": pairwise, "times faster": pairwise / ours}


def _plain_search(before: Clip, after: Clip) -> Cut:
    """Search by hand distance one pair of frames at a time, as the baseline."""
    p, q = arms(before), arms(after)
    (p_start, p_stop), (q_start, q_stop) = active_span(p), active_span(q)
    best, best_cut = float("inf"), Cut(0, 0)
    for i in range(p_stop - search_window(p_stop - p_start, p.fps), p_stop):
        for j in range(q_start, q_start + search_window(q_stop - q_start, q.fps)):
            cost = 0.0
            for hand in range(2):
                distance = float(np.linalg.norm(p.wrists[i, hand] - q.wrists[j, hand]))
                delta_quat = rotation.from_matrix(p.hand_rotations[i, hand].T @ q.hand_rotations[j, hand])
                cost += distance / p.shoulder_width + float(np.linalg.norm(rotation.log(delta_quat))) / np.pi
            if cost < best:
                best, best_cut = cost, Cut(i, j)
    return best_cut


def _transitions(repeats: int) -> dict[str, Any]:
    before, after = _word_clips()
    before, after = before[:90], after[40:]
    runs = [lambda method=method: method.between(Gap(before, after, 10)) for method in TRANSITIONS.values()]
    times = median_milliseconds(10 * repeats, *runs)
    return {f"{name}, 10 frames, ms": ms for name, ms in zip(TRANSITIONS, times, strict=True)}


def _lexicon(repeats: int) -> dict[str, Any]:
    """Measure opening and closing a lexicon of 6,707 words, reading a different word of 150 frames from it each time,
    and reading a BVH file of as many frames. All other words are short, so that the benchmark writes little.
    """
    clips = _word_clips()
    short = [clip[start : start + 10] for clip in clips for start in range(0, 140, 20)]
    with tempfile.TemporaryDirectory() as folder:
        path, file = Path(folder) / "lexicon", Path(folder) / "word.bvh"
        save(clips[0], file)
        with building(path) as builder:
            for n in range(N_LEXICON):
                builder.add(short[n % len(short)] if n % 67 else clips[n // 67 % 2], f"WORD-{n}")
        with open_lexicon(path) as lexicon:
            glosses = cycle(f"WORD-{n}" for n in range(0, N_LEXICON, 67))
            opened, read, file_read = median_milliseconds(
                repeats, lambda: open_lexicon(path).close(), lambda: lexicon.clip(next(glosses)), lambda: load(file)
            )
            (nearest,) = median_milliseconds(repeats, lambda: lexicon.nearest("WROD-4711"))
    return {
        "6707 words opened, ms": opened,
        "one word of 150 frames, ms": read,
        "the same from a BVH file, ms": file_read,
        "times faster": file_read / read,
        "nearest glosses, ms": nearest,
    }


def _memory() -> dict[str, Any]:
    """Measure the ratio of a splice's peak allocation, including its result, to the size of its clips, as read from
    files.

    Splices eight clips with the same placement and, as the worst case, eight with different placements that are kept
    whole.
    """
    together = [_from_file(clip) for clip in _word_clips() * 4]
    displaced = [
        _from_file(replace(clip, root_positions=clip.root_positions + 7.0 * n, channels=None))
        for n, clip in enumerate(together)
    ]
    figures: dict[str, Any] = {"clips, MB": sum(clip.nbytes for clip in together) / 1e6}
    for name, clips, cutter in (("ratio", together, "pose-velocity"), ("ratio at worst", displaced, "ends")):
        options = SpliceOptions(cutter, "hermite", "tempo")
        splice(clips, options)
        tracemalloc.start()
        splice(clips, options)
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        figures[name] = peak / sum(clip.nbytes for clip in clips)
    return figures


def _from_file(clip: Clip) -> Clip:
    return bvh.parse(bvh.encode(clip), clip.name)


def _start(repeats: int) -> dict[str, Any]:
    """Measure whole processes: the help, a sentence of three words as BVH and as GLB, and as baselines a bare
    interpreter and one that imports numpy and onnxruntime.
    """
    signsplice = (sys.executable, "-m", "signsplice")
    with tempfile.TemporaryDirectory() as folder:
        calls = {
            "bare python": (sys.executable, "-c", "pass"),
            "numpy and onnxruntime": (sys.executable, "-c", "import numpy, onnxruntime"),
            "signsplice --help": (*signsplice, "--help"),
            **{f"sentence to {suffix}": (*signsplice, "sentence", "HELLO MY NAME", "-o", f"{folder}/out.{suffix}")
               for suffix in ("bvh", "glb")},
        }  # fmt: skip
        runs = [partial(subprocess.run, call, capture_output=True, check=True) for call in calls.values()]
        times = median_milliseconds(min(repeats, 9), *runs)
    return {f"{name}, ms": took for name, took in zip(calls, times, strict=True)}
