"""Realism of a corpus: durations, speeds, paths and finger ranges, for comparison with published figures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from signsplice.evaluation.hidden_frames import hidden_frames
from signsplice.evaluation.wrists import right_wrist
from signsplice.motion import kinematics
from signsplice.motion.clip import Clip
from signsplice.rig.info import rig_info
from signsplice.rig.roles import FINGERS, finger_roles
from signsplice.splicing.transition import find_transition
from signsplice.synth.corpus import Pairs
from signsplice.synth.rng import stream

Float = NDArray[np.float64]

PERCENTILES = (5, 25, 50, 75, 95)
N_PAIRS = 1500
"""Pairs whose motion is measured, drawn once; durations are counted over all pairs."""
_SHORTEST_CHORD_M = 0.03
_CZECH = "Czech SL, 33 takes"
_DGS = "DGS Corpus, 32 sentences"


@dataclass(frozen=True)
class Quantity:
    """One line of the table of realism.

    name, unit: of the quantity.
    ours: ``PERCENTILES`` of the corpus (5).
    real: published percentiles (5), the ends of a published range (2), or a published median (1).
    source: where the published figures are from.
    """

    name: str
    unit: str
    ours: tuple[float, ...]
    real: tuple[float, ...]
    source: str

    @property
    def ratio(self) -> float:
        """Our median over the real one (the middle of a range)."""
        middle = self.real[len(self.real) // 2] if len(self.real) != 2 else 0.5 * (self.real[0] + self.real[1])
        return self.ours[2] / middle

    @property
    def agrees(self) -> bool:
        """Whether our median is within 20 % of the real one, or of the nearer end of a real range."""
        low, high = (self.real[0], self.real[1]) if len(self.real) == 2 else (self.real[len(self.real) // 2],) * 2
        return 0.8 * low <= self.ours[2] <= 1.2 * high


def _percentiles(values: Sequence[float] | Float) -> tuple[float, ...]:
    return tuple(float(v) for v in np.percentile(values, PERCENTILES))


def durations(pairs: Pairs) -> list[Quantity]:
    """Durations of transitions, of signs in a sentence and of signs alone, ms."""
    n_words = len(pairs.head["words"]) // 2
    index = pairs.index[pairs.index[:, 0] < n_words]
    ms = 1e3 / pairs.head["fps"]
    events = [pairs.events(k) for k in range(n_words)]
    alone = [ms * (e.end - e.start + 1) for e in events]
    return [
        Quantity("transition", "ms", _percentiles(ms * (index[:, 5] + 1)), (160, 200, 250, 320, 480), _CZECH),
        Quantity("sign in a sentence", "ms", _percentiles(ms * _kept_frames(index)), (158, 260, 400, 540, 912), _CZECH),
        Quantity("sign alone", "ms", _percentiles(alone), (440, 564, 720, 960, 1360), "Czech SL, 336 items"),
    ]


def _kept_frames(index: NDArray[np.int32]) -> Float:
    """Number of frames that a word keeps between two others, over triples of words drawn at random."""
    enters = {(p, q): post for p, q, _, post, _, _ in index.tolist()}
    leaves = {(p, q): pre for p, q, pre, _, _, _ in index.tolist()}
    words = sorted({p for p, _ in enters})
    triples = stream("triples", len(words)).choice(words, size=(20_000, 3))
    return np.array([leaves[b, c] - enters[a, b] + 1 for a, b, c in triples.tolist()], np.float64)


@dataclass(frozen=True, eq=False)
class WristMotion:
    """Motion of the right wrist in N drawn pairs, from the start of the first sign to the end of the second.

    speed: speeds from frame to frame, all pairs together, m/s.
    peak: highest speed in each transition (N,), m/s.
    start, end: speed just before and just after each transition (N,), over its peak.
    detour: path over chord of each transition with a chord of more than 3 cm.
    jump: change of velocity at each seam (2 N,), shoulder widths / s.
    exponent: see ``power_law``.
    jerk: see ``rms_jerk``, m/s^3.
    """

    speed: Float
    peak: Float
    start: Float
    end: Float
    detour: Float
    jump: Float
    exponent: float
    jerk: float


def wrist_motion(pairs: Pairs, n_pairs: int = N_PAIRS) -> WristMotion:
    """Motion of the right wrist in pairs of the first signer, drawn once."""
    numbers = np.flatnonzero(pairs.index[:, 0] < len(pairs.head["words"]) // 2)
    fps = pairs.head["fps"]
    sizes = rig_info(pairs.clip(0).skeleton).sizes
    width = sizes.shoulder_width * sizes.unit.metres
    speeds, peaks, starts, ends, detours, jumps, paths = [], [], [], [], [], [], []
    for number in stream("moving", len(numbers)).choice(numbers, min(n_pairs, len(numbers)), replace=False).tolist():
        p, q, pre, post, _, count = pairs.index[number].tolist()
        positions = right_wrist(pairs.clip(number))  # (T, 3)
        velocity = np.diff(positions, axis=0) * fps
        speed = np.linalg.norm(velocity, axis=-1)
        first, last = pairs.events(p).start, pre + 1 + count + pairs.events(q).end - post
        peak = float(speed[pre : pre + count + 1].max())
        speeds.append(speed[first:last])
        peaks.append(peak)
        starts.append(speed[pre - 1] / peak)
        ends.append(speed[pre + count + 1] / peak)
        path = positions[pre : pre + count + 2]
        chord = float(np.linalg.norm(path[-1] - path[0]))
        if chord > _SHORTEST_CHORD_M:
            detours.append(float(np.linalg.norm(np.diff(path, axis=0), axis=-1).sum()) / chord)
        change = np.linalg.norm(np.diff(velocity, axis=0), axis=-1) / width
        jumps += [float(change[pre - 1]), float(change[pre + count])]
        paths.append(positions[first : last + 1])
    return WristMotion(
        speed=np.concatenate(speeds),
        peak=np.array(peaks),
        start=np.array(starts),
        end=np.array(ends),
        detour=np.array(detours),
        jump=np.array(jumps),
        exponent=power_law(paths, fps),
        jerk=rms_jerk(paths, fps),
    )


def sentence_speeds(pairs: Pairs, n_sentences: int = 200) -> Float:
    """Mean speed (n_sentences,) of the right wrist in chains of eight words, first sign to last, m/s."""
    n_words = len(pairs.head["words"]) // 2
    number = {(p, q): k for k, (p, q) in enumerate(pairs.index[:, :2].tolist())}
    words = [right_wrist(pairs.word_clip(k)) for k in range(n_words)]  # (T, 3) each
    new: dict[tuple[int, int], Float] = {}
    means = []
    for chain in stream("chains", n_words).choice(n_words, size=(n_sentences, 8)).tolist():
        pieces = []
        enter = pairs.events(chain[0]).start
        for a, b in pairwise(chain):
            pre, post, _ = pairs.truth(number[a, b])
            if (a, b) not in new:
                clip = pairs.clip(number[a, b])
                count = int(pairs.index[number[a, b], 5])
                new[a, b] = right_wrist(clip[pre + 1 : pre + 1 + count])
            pieces += [words[a][enter : pre + 1], new[a, b]]
            enter = post
        pieces.append(words[chain[-1]][enter : pairs.events(chain[-1]).end + 1])
        means.append(speeds(np.concatenate(pieces), pairs.head["fps"]).mean())
    return np.array(means)


def word_peak_speeds(pairs: Pairs) -> Float:
    """Highest speed of the right wrist in each isolated word of the first signer, m/s."""
    clips = (pairs.word_clip(k) for k in range(len(pairs.head["words"]) // 2))
    return np.array([speeds(right_wrist(clip), clip.fps).max() for clip in clips])


def speeds(positions: Float, fps: float) -> Float:
    """Speeds (T - 1,) from frame to frame along positions (T, 3), units a second."""
    return np.asarray(np.linalg.norm(np.diff(positions, axis=0), axis=-1) * fps)


def motion_quantities(pairs: Pairs, motion: WristMotion) -> list[Quantity]:
    """Speeds of the corpus with published ones."""
    means, peaks = _percentiles(sentence_speeds(pairs)), _percentiles(word_peak_speeds(pairs))
    return [
        Quantity("wrist speed, mean of running signing", "m/s", means, (0.42, 0.47), "real continuous signing"),
        Quantity("wrist speed, peak of a sign alone", "m/s", peaks, (1.7, 2.5), "real isolated words"),
        Quantity("speed at a transition's start / peak", "", _percentiles(motion.start), (0.69,), _DGS),
        Quantity("speed at a transition's end / peak", "", _percentiles(motion.end), (0.52,), _DGS),
        Quantity("velocity jump at the seams", "sw/s", _percentiles(motion.jump), (0.28,), "real signing at 25 fps"),
    ]


def power_law(paths: Sequence[Float], fps: float) -> float:
    """The exponent b of speed ~ curvature^b over all frames that move (two-thirds power law: -1/3; Lacquaniti et al.
    1983): the slope of the regression of their logarithms. ``paths``: (T, 3) each, m.
    """
    logs = []
    for path in paths:
        if len(path) < 5:
            continue
        v = np.gradient(path, 1.0 / fps, axis=0)
        a = np.gradient(v, 1.0 / fps, axis=0)
        speed = np.linalg.norm(v, axis=-1)
        curvature = np.linalg.norm(np.cross(v, a), axis=-1) / np.maximum(speed, 1e-9) ** 3
        good = (speed > 0.15) & (curvature > 0.1)
        logs.append(np.log(np.stack([curvature[good], speed[good]], axis=-1)))
    x, y = np.concatenate(logs).T
    return float(np.polyfit(x, y, 1)[0])


def rms_jerk(paths: Sequence[Float], fps: float) -> float:
    """Root mean square of the jerk (third difference) of paths (T, 3), m: m/s^3."""
    jerks = [np.linalg.norm(np.diff(path, n=3, axis=0), axis=-1) * fps**3 for path in paths if len(path) > 3]
    return float(np.sqrt(np.mean(np.concatenate(jerks) ** 2)))


def flexions(clip: Clip) -> dict[str, Float]:
    """Finger and joint number ("Index 2") -> its bend in every frame, degrees, left hand then right (2 T,).

    The bend is the angle between the bones on either side; joint 1 is the nearest to the wrist. Fingers whose joints a
    rig lacks are left out.
    """
    roles = rig_info(clip.skeleton).roles.joints
    rotations, positions = kinematics.forward(clip)
    tip_positions = np.swapaxes(kinematics.tip_positions(clip, rotations, positions), 0, 1)
    tips = dict(zip((site.joint for site in clip.skeleton.end_sites), tip_positions, strict=True))
    out: dict[str, list[Float]] = {}
    for side in ("left", "right"):
        for finger in FINGERS:
            chain = [f"{side}Hand", *(side + role for role in finger_roles(finger))]
            if not all(role in roles for role in chain):
                continue
            points = [positions[:, roles[role]] for role in chain]  # (T, 3) each
            last = roles[chain[-1]]
            children = clip.skeleton.children[last]
            if last in tips:
                points.append(tips[last])
            elif children:
                points.append(positions[:, children[0]])
            for n, (a, b, c) in enumerate(zip(points[:-2], points[1:-1], points[2:], strict=True), 1):
                u, v = b - a, c - b
                cosine = (u * v).sum(-1) / np.maximum(np.linalg.norm(u, axis=-1) * np.linalg.norm(v, axis=-1), 1e-12)
                out.setdefault(f"{finger} {n}", []).append(np.rad2deg(np.arccos(np.clip(cosine, -1, 1))))
    return {name: np.concatenate(rows) for name, rows in out.items()}


def slerp_motion_ratio(clips: Sequence[Clip], n_frames: int = 18) -> float:
    """Path of the fingertips that slerp makes over hidden frames, over the true one."""
    return hidden_frames(clips, [find_transition("slerp")], (n_frames,))[0].motion_ratio
