"""Measures splices of landmarks beside spoken-to-signed, and writes workshop/docs/measured/landmarks.md.

    python workshop/runs/landmarks.py FOLDER [--peer PYTHON]

FOLDER holds sentences/NAME_original.pose with NAME_metadata.json (glosses with their times, ms) and words of a
dictionary in words/*/*.pose. PYTHON has spoken-to-signed 0.4.0 installed; without it its columns stay empty.
"""

from __future__ import annotations

import argparse
import json
import platform
import subprocess
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import signsplice as ss
from signsplice.body.landmarks import measure_fit
from signsplice.formats import pose
from signsplice.motion import Clip, kinematics
from signsplice.motion.points import Points
from signsplice.rig.align import ORIGIN, place
from signsplice.rig.info import rig_info

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "workshop" / "docs" / "measured" / "landmarks.md"
LENGTHS = ((1, 2), (3, 4), (5, 8), (9, 99))
"""Groups of gaps by their number of frames."""
SENTENCE = ("kleine", "kinder", "essen", "pizza")
"""Words of the sentence that is spliced."""
REAL_S = 0.44
"""Mean time of a sign and the gap after it in the sentences, s."""

Places = NDArray[np.float64]


def rows_of(points: Points, *ends: str) -> list[int]:
    """Return the rows of points whose component or name ends with one of some texts."""
    return [k for k, (group, name) in enumerate(points.layout.names) if f"{group}/{name}".endswith(ends)]


def shoulder_width(points: Points) -> float:
    """Return the median distance of the shoulders, image units."""
    left, right = (points.values[:, rows_of(points, f"LANDMARKS/{side}_SHOULDER")[0], :2] for side in ("LEFT", "RIGHT"))
    return float(np.median(np.linalg.norm(left - right, axis=-1)))


def find_gaps(metadata: Path, n_frames: int, fps: float) -> list[tuple[int, int]]:
    """Return the frames between every two glosses of a sentence, with three frames on either side."""
    sentence = json.loads(metadata.read_text())["sentence"]
    glosses, zero = sentence["glosses"], sentence["start"]
    ends = [
        (round((stop - zero) / 1000 * fps), round((start - zero) / 1000 * fps))
        for stop, start in zip(glosses["end"], glosses["start"][1:], strict=False)
    ]
    return [(a, b) for a, b in ends if 3 <= a < b <= n_frames - 3]


def hermite(values: Places, start: int, stop: int) -> Places:
    """Return the cubic (n, P, 2) with the velocities of one frame at both ends."""
    n = stop - start + 1
    u = np.arange(1, n)[:, None, None] / n
    leaving, entering = (values[start - 1] - values[start - 2]) * n, (values[stop + 1] - values[stop]) * n
    hold = (2 * u**3 - 3 * u**2 + 1) * values[start - 1] + (3 * u**2 - 2 * u**3) * values[stop]
    return np.asarray(hold + (u**3 - 2 * u**2 + u) * leaving + (u**3 - u**2) * entering)


def fill_gaps(folder: Path, peer: str) -> list[str]:
    """Return the table of hidden frames: error of hands, in thousandths of a shoulder width, by length of the gap."""
    names = ("hold", "linear", "spoken-to-signed", "Hermite", "signsplice")
    errors: list[tuple[int, dict[str, float]]] = []
    for path in sorted((folder / "sentences").glob("*_original.pose")):
        clip = ss.load(path)
        points = clip.points
        assert points is not None
        gaps = find_gaps(path.with_name(path.name.replace("original.pose", "metadata.json")), len(clip), clip.fps)
        theirs = ask_peer(peer, "fill", path, *(f"{a}:{b}" for a, b in gaps)) if peer and gaps else {}
        hands = [k for k, (group, _) in enumerate(points.layout.names) if group.endswith("_HAND_LANDMARKS")]
        size = shoulder_width(points)
        values = points.values[..., :2].astype(np.float64)
        for start, stop in gaps:
            known = [row for row in hands if (points.confidence[start - 2 : stop + 2, row] > 0.0).all()]
            if not known:
                continue
            filled = ss.inbetween(clip, [(start, stop)]).clip.points
            assert filled is not None
            u = (np.arange(1, stop - start + 1) / (stop - start + 1))[:, None, None]
            made = {
                "hold": values[start - 1 : start],
                "linear": values[start - 1] + u * (values[stop] - values[start - 1]),
                "Hermite": hermite(values, start, stop),
                "signsplice": filled.values[start:stop, :, :2],
            }
            if theirs:
                made["spoken-to-signed"] = theirs[f"{start}:{stop}"][..., :2]
            apart = {
                name: 1000.0 * np.linalg.norm((way - values[start:stop])[:, known], axis=-1).mean() / size
                for name, way in made.items()
            }
            errors.append((stop - start, apart))
    lines = ["| frames | gaps | " + " | ".join(names) + " |", "| --- | --- |" + " --- |" * len(names)]
    for low, high in (*LENGTHS, (1, 99)):
        found = [apart for n, apart in errors if low <= n <= high]
        cells = [f"{np.mean([row[name] for row in found]):.1f}" if found and name in found[0] else "" for name in names]
        shown = "all" if (low, high) == (1, 99) else f"{low} to {high}" if high < 99 else f"{low} and more"
        lines.append(f"| {shown} | {len(found)} | " + " | ".join(cells) + " |")
    return lines


def ask_peer(peer: str, command: str, *arguments: object) -> dict[str, Any]:
    """Return the arrays that ``landmarks_peer.py`` writes."""
    script = Path(__file__).with_name("landmarks_peer.py")
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out.npz"
        subprocess.run([*peer.split(), str(script), command, str(out), *map(str, arguments)], check=True)
        with np.load(out) as arrays:
            return dict(arrays)


def seam_motion(points: Points, seams: Sequence[tuple[int, int]], fps: float) -> dict[str, float]:
    """Return how the body's wrists move in seams with a frame on either side, medians over seams and hands, shoulder
    widths: mean speed, mean size of the jerk, and how far the higher hand drops below the lower end, the worst; and the
    time from one seam to the next, the mean.
    """
    rows = [rows_of(points, f"POSE_LANDMARKS/{side}_WRIST")[0] for side in ("LEFT", "RIGHT")]
    values, seen = points.values[:, rows, :2] / shoulder_width(points), points.confidence[:, rows] > 0.0
    speed = np.linalg.norm(np.diff(values, axis=0), axis=-1) * fps
    jerk = np.linalg.norm(np.diff(values, n=3, axis=0), axis=-1) * fps**3
    speeds, jerks, drops = [], [], []
    for start, stop in seams:
        for side in (0, 1):
            if seen[start - 1 : stop + 1, side].all():
                speeds.append(speed[start - 1 : stop, side].mean())
                jerks.append(jerk[max(start - 3, 0) : stop, side].mean())
        heights = -values[..., 1].min(axis=1)  # of the higher hand
        drops.append(max(0.0, float(min(heights[start - 1], heights[stop]) - heights[start:stop].min(initial=np.inf))))
    sign_s = (seams[-1][0] - seams[0][0]) / max(len(seams) - 1, 1) / fps
    medians = {"speed": float(np.median(speeds)), "jerk": float(np.median(jerks))}
    return {"sign": sign_s, **medians, "drop": max(drops, default=0.0)}


def mean_sign_s(metadata: Path) -> float:
    """Return the mean time from one gloss of a sentence to the next."""
    starts = json.loads(metadata.read_text())["sentence"]["glosses"]["start"]
    return float(np.diff(starts).mean()) / 1000


def splice_words(folder: Path, peer: str) -> list[str]:
    """Return the table of a sentence of dictionary words beside the real gaps of running signing."""
    paths = [next((folder / "words").rglob(f"{word}.pose")) for word in SENTENCE]
    clips = [ss.load(path) for path in paths]
    head = "| | seconds | a sign, s | speed at seams | jerk | worst drop | stray points of hands |"
    lines = [head, "| --- |" + " --- |" * 6]
    real: list[dict[str, float]] = []
    for path in sorted((folder / "sentences").glob("*_original.pose")):
        clip = ss.load(path)
        assert clip.points is not None
        metadata = path.with_name(path.name.replace("original.pose", "metadata.json"))
        gaps = find_gaps(metadata, len(clip), clip.fps)
        if gaps:
            real.append(seam_motion(clip.points, gaps, clip.fps) | {"sign": mean_sign_s(metadata)})
    medians = {name: float(np.median([row[name] for row in real])) for name in real[0]}
    lines.append(_motion_row("gaps of real sentences", None, medians, None))
    tempos: dict[str, str | float] = {"": "citation", ", natural tempo": "natural", f", {REAL_S} s a sign": REAL_S}
    for label, tempo in tempos.items():
        result = ss.splice(clips, ss.SpliceOptions(tempo=tempo))
        points = result.clip.points
        assert points is not None
        seams = [span.output for span in result.spans if span.kind == "transition"]
        motion = seam_motion(points, seams, result.clip.fps)
        lines.append(_motion_row(f"signsplice{label}", result.clip.seconds, motion, count_stray(points)))
    if peer:
        theirs = ask_peer(peer, "stitch", *paths)
        first = clips[0].points
        assert first is not None
        points = first.changed(*(theirs[name].astype(np.float32) for name in ("values", "confidence")))
        seams = [(int(start), int(stop)) for start, stop in theirs["seams"]]
        motion = seam_motion(points, seams, float(theirs["fps"]))
        lines.append(_motion_row("spoken-to-signed 0.4.0", len(points) / theirs["fps"], motion, count_stray(points)))
    return [*lines, "", "Asked for real signing's tempo, signs stop at people's highest speeds and accelerations."]


def count_stray(points: Points) -> int:
    """Return how many points of hands are shown over a shoulder width from the body's wrist, over all frames."""
    size, stray = shoulder_width(points), 0
    for side in ("LEFT", "RIGHT"):
        wrist = rows_of(points, f"POSE_LANDMARKS/{side}_WRIST")[0]
        hand = [k for k, (group, _) in enumerate(points.layout.names) if group == f"{side}_HAND_LANDMARKS"]
        apart = np.linalg.norm(points.values[:, hand, :2] - points.values[:, wrist, None, :2], axis=-1)
        shown = (points.confidence[:, hand] > 0.0) & (points.confidence[:, wrist, None] > 0.0)
        stray += int((shown & (apart > size)).sum())
    return stray


def _motion_row(label: str, seconds: float | None, motion: dict[str, float], stray: int | None) -> str:
    cells = ("" if seconds is None else f"{seconds:.2f}", f"{motion['sign']:.2f}", f"{motion['speed']:.2f}",
             f"{motion['jerk']:.0f}", f"{motion['drop']:.2f}", "" if stray is None else str(stray))  # fmt: skip
    return f"| {label} | " + " | ".join(cells) + " |"


def time_seams(folder: Path, peer: str) -> list[str]:
    """Return processor times of a seam, ms."""
    paths = [next((folder / "words").rglob(f"{word}.pose")) for word in SENTENCE]
    contents = [path.read_bytes() for path in paths]
    n_seams, lines = len(paths) - 1, []
    clips = [pose.parse(content, path.name) for content, path in zip(contents, paths, strict=True)]
    ways: dict[str, Callable[[], object]] = {
        "fit of a word, at load or once in a lexicon": lambda: [pose.parse(c, "word.pose") for c in contents[:3]],
        "seam, words known": lambda: ss.splice(clips),
        "seam at natural tempo, words known": lambda: ss.splice(clips, ss.SpliceOptions(tempo="natural")),
    }
    for label, work in ways.items():
        work()
        lines.append(f"| {label} | {_milliseconds(work) / n_seams:.1f} |")
    if peer:
        seconds = float(ask_peer(peer, "stitch", *paths)["seconds"])
        lines.append(f"| spoken-to-signed 0.4.0, seam | {1000.0 * seconds / n_seams:.1f} |")
    return ["| | ms |", "| --- | --- |", *lines]


def _milliseconds(work: Callable[[], object]) -> float:
    times = []
    for _ in range(7):
        began = time.process_time()
        work()
        times.append(time.process_time() - began)
    return 1000.0 * float(np.median(times))


def fit_recordings(folder: Path) -> list[str]:
    """Return how far landmarks lie from the fitted pose, cm on the standard person, median over files."""
    apart: dict[str, list[float]] = {}
    n_files = 0
    for path in sorted(folder.rglob("*.pose")):
        clip = ss.load(path)
        assert clip.points is not None
        n_files += 1
        for fit in measure_fit(clip):
            if fit.pixels is not None and fit.seen > 0.2:
                apart.setdefault(fit.name, []).append(100.0 * fit.pixels / clip.points.framing.scale)
    rows = [f"| {name} | {len(found)} | {np.median(found):.1f} | {max(found):.1f} |" for name, found in apart.items()]
    return [f"{n_files} files:", "", "| group | files | median, cm | worst |", "| --- | --- | --- | --- |", *rows]


def fit_known_depths() -> list[str]:
    """Return errors of wrists of shipped words that a camera sees, without words that settings were chosen on."""
    errors, depths = [], []
    with ss.open_lexicon() as lexicon:
        signs = [gloss for gloss in lexicon.glosses if not gloss.startswith("fs-")]
        chosen_on = {*signs[::6][:24]}
        for gloss in [gloss for gloss in signs[1::5] if gloss not in chosen_on]:
            clip = lexicon.clip(gloss)
            apart = _wrists(pose.parse(pose.encode(clip), "word.pose")) - _wrists(clip)
            raised = _wrists(clip)[..., 1] > -0.35
            errors.append(np.linalg.norm(apart[..., :2], axis=-1)[raised])
            depths.append(apart[..., 2][raised])
    place_m, depth_m = np.concatenate(errors), np.concatenate(depths)
    return [
        f"{len(errors)} words; raised wrists are {100 * np.median(place_m):.1f} cm off in the image (median; 95 %: "
        f"{100 * np.percentile(place_m, 95):.1f}), and {100 * np.median(np.abs(depth_m)):.1f} cm in depth (95 %: "
        f"{100 * np.percentile(np.abs(depth_m), 95):.1f}; mean {100 * depth_m.mean():+.1f}, ahead is positive)."
    ]


def _wrists(clip: Clip) -> Places:
    info = rig_info(clip.skeleton)
    roles = [info.roles.joints[role] for role in ("leftHand", "rightHand", "leftUpperArm", "rightUpperArm")]
    at = kinematics.forward(place(clip, ORIGIN))[1][:, roles] * info.sizes.unit.metres
    return np.asarray(at[:, :2] - at[:, 2:].mean(axis=1, keepdims=True))


def main() -> None:
    """Measure, and write the page."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--peer", default="", help="Python with spoken-to-signed 0.4.0")
    asked = parser.parse_args()
    commit = subprocess.run(["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True, check=True).stdout
    parts = [
        "# Landmarks",
        TEXT.format(commit=commit.strip(), machine=platform.processor() or platform.machine()),
        "## Hidden frames between the signs of real sentences\n\nErrors of hands, thousandths of a shoulder width.",
        "\n".join(fill_gaps(asked.folder, asked.peer)),
        "## A sentence of four dictionary words\n\nKleine Kinder essen Pizza; shoulder widths and seconds.",
        "\n".join(splice_words(asked.folder, asked.peer)),
        "## Time\n\nProcessor time in one run.",
        "\n".join(time_seams(asked.folder, asked.peer)),
        "## The fitted pose\n\nDistance of landmarks from the pose, on " + "\n".join(fit_recordings(asked.folder)),
        "Shipped words, of which depths are known, as a camera sees them: " + "\n".join(fit_known_depths()),
    ]
    PAGE.write_text("\n\n".join(parts) + "\n")


TEXT = """Made by `workshop/runs/landmarks.py` at {commit} on {machine}. Recordings: 16 sentences of German Sign
Language (DGS Corpus, from fluent-pose-synthesis), four words of Swiss-German Sign Language and two alphabets
(spoken-to-signed-translation); none is part of this project."""


if __name__ == "__main__":
    main()
