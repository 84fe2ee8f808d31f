"""True to life: times, speeds, shapes of paths and fingers of the corpus, beside published figures and real clips."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from signsplice.evaluation.hidden_frames import hidden_frames
from signsplice.motion import kinematics
from signsplice.motion.clip import Clip
from signsplice.rig import proportions
from signsplice.rig.roles import find_roles
from signsplice.splicing.transition import find_transition
from signsplice.synth.corpus import Pairs
from signsplice.synth.rng import stream

Float = NDArray[np.float64]

PERCENTILES = (5, 25, 50, 75, 95)
FINGERS = ("Thumb", "Index", "Middle", "Ring", "Little")
_CHAINS = {"Thumb": ("Metacarpal", "Proximal", "Distal")}
_CHAIN = ("Proximal", "Intermediate", "Distal")
N_PAIRS = 1500
"""Pairs of which motion is looked at, drawn by name; times are counted over all."""


@dataclass(frozen=True)
class Quantity:
    """One line of the table: its name and unit, the corpus' percentiles (5), the real ones or their median alone, where
    those are from, and whether the medians agree within a fifth.
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
        """Whether the median lies within a fifth of the real one, or of the nearer end of a real range."""
        low, high = (self.real[0], self.real[1]) if len(self.real) == 2 else (self.real[len(self.real) // 2],) * 2
        return 0.8 * low <= self.ours[2] <= 1.2 * high


_CZECH = "Czech SL, 33 takes"
_DGS = "DGS Corpus, 32 sentences"


def times(pairs: Pairs) -> list[Quantity]:
    """Times of transitions, of signs in a sentence and alone, in milliseconds."""
    n_words = len(pairs.head["words"]) // 2
    own = pairs.index[pairs.index[:, 0] < n_words]
    ms = 1e3 / pairs.head["fps"]
    events = [pairs.events(k) for k in range(n_words)]
    alone = [ms * (e.end - e.start + 1) for e in events]
    return [
        Quantity("transition", "ms", _five(ms * (own[:, 5] + 1)), (160, 200, 250, 320, 480), _CZECH),
        Quantity("sign in a sentence", "ms", _five(ms * _kept(own)), (158, 260, 400, 540, 912), _CZECH),
        Quantity("sign alone", "ms", _five(alone), (440, 564, 720, 960, 1360), "Czech SL, 336 items"),
    ]


def _kept(own: NDArray[np.int32]) -> Float:
    """Frames that a word keeps between two others, over all triples of words drawn at random."""
    enters = {(p, q): post for p, q, _, post, _, _ in own.tolist()}
    leaves = {(p, q): pre for p, q, pre, _, _, _ in own.tolist()}
    words = sorted({p for p, _ in enters})
    triples = stream("triples", len(words)).choice(words, size=(20_000, 3))
    return np.array([leaves[b, c] - enters[a, b] + 1 for a, b, c in triples.tolist()], np.float64)


@dataclass(frozen=True, eq=False)
class Moving:
    """Motion of the strong wrist in drawn pairs: one-frame speeds (m/s) of kept frames and transitions, peaks, speeds
    at a transition's start and end over its peak, path over chord, velocity jumps at the seams (shoulder widths / s),
    exponents of the power law, and rms jerk (m/s^3).
    """

    speed: Float
    peak: Float
    start: Float
    end: Float
    detour: Float
    jump: Float
    exponent: float
    jerk: float


def moving(pairs: Pairs, n_pairs: int = N_PAIRS) -> Moving:
    """The motion of drawn pairs from the first frame of the first sign to the last of the second."""
    n_words = len(pairs.head["words"]) // 2
    own = np.flatnonzero(pairs.index[:, 0] < n_words)
    fps = pairs.head["fps"]
    width = proportions.sizes(pairs.clip(0).skeleton).shoulder_width / 100.0
    speeds, peaks, starts, ends, detours, jumps, paths = [], [], [], [], [], [], []
    for number in stream("moving", len(own)).choice(own, min(n_pairs, len(own)), replace=False).tolist():
        p, q, pre, post, _, count = pairs.index[number].tolist()
        places = wrists(pairs.clip(number))[0] / 100.0
        velocity = np.diff(places, axis=0) * fps
        speed = np.linalg.norm(velocity, axis=-1)
        first, last = pairs.events(p).start, pre + 1 + count + pairs.events(q).end - post
        crossing = speed[pre : pre + count + 1]
        peak = float(crossing.max())
        speeds.append(speed[first:last])
        peaks.append(peak)
        starts.append(speed[pre - 1] / peak)
        ends.append(speed[pre + count + 1] / peak)
        path = places[pre : pre + count + 2]
        chord = float(np.linalg.norm(path[-1] - path[0]))
        if chord > 0.03:
            detours.append(float(np.linalg.norm(np.diff(path, axis=0), axis=-1).sum()) / chord)
        change = np.linalg.norm(np.diff(velocity, axis=0), axis=-1) / width
        jumps += [float(change[pre - 1]), float(change[pre + count])]
        paths.append(places[first : last + 1])
    return Moving(
        *(
            np.concatenate(speeds),
            np.array(peaks),
            np.array(starts),
            np.array(ends),
            np.array(detours),
            np.array(jumps),
        ),
        exponent=power_law(paths, fps),
        jerk=rms_jerk(paths, fps),
    )


def running(pairs: Pairs, count: int = 200) -> tuple[Float, Float]:
    """Mean wrist speed (m/s) of chains of eight words, first sign to last, and of whole isolated words their peak."""
    n_words = len(pairs.head["words"]) // 2
    number = {(p, q): k for k, (p, q) in enumerate(pairs.index[:, :2].tolist())}
    fps = pairs.head["fps"]
    at = [wrists(pairs.word_clip(k))[0] / 100.0 for k in range(n_words)]
    peaks = np.array([_speeds(places, fps).max() for places in at])
    new = {}
    means = []
    for words in stream("chains", n_words).choice(n_words, size=(count, 8)).tolist():
        pieces = []
        enter = pairs.events(words[0]).start
        for a, b in pairwise(words):
            pre, post, _ = pairs.truth(number[a, b])
            if (a, b) not in new:
                clip = pairs.clip(number[a, b])
                count_new = int(pairs.index[number[a, b], 5])
                new[a, b] = wrists(clip[pre + 1 : pre + 1 + count_new])[0] / 100.0
            pieces += [at[a][enter : pre + 1], new[a, b]]
            enter = post
        pieces.append(at[words[-1]][enter : pairs.events(words[-1]).end + 1])
        means.append(_speeds(np.concatenate(pieces), fps).mean())
    return np.array(means), peaks


def wrists(clip: Clip) -> tuple[Float, Float]:
    """Places (T, 3) of the right and the left wrist, clip units."""
    joints = find_roles(clip.skeleton).joints
    _, places = kinematics.forward(clip, [joints["rightHand"], joints["leftHand"]])
    return places[:, 0], places[:, 1]


def _speeds(places: Float, fps: float) -> Float:
    return np.asarray(np.linalg.norm(np.diff(places, axis=0), axis=-1) * fps)


def power_law(paths: Sequence[Float], fps: float) -> float:
    """The exponent b of speed ~ curvature^b over all frames that move (two-thirds power law: -1/3; Lacquaniti et al.
    1983): the slope of the regression of their logarithms.
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
    """Root mean square of the third difference of paths (m), m/s^3."""
    jerks = [np.linalg.norm(np.diff(path, n=3, axis=0), axis=-1) * fps**3 for path in paths if len(path) > 3]
    return float(np.sqrt(np.mean(np.concatenate(jerks) ** 2)))


def flexions(clip: Clip) -> dict[str, Float]:
    """The bend (T,) in degrees of every finger joint of both hands (both in one row), by finger and number: the angle
    between the bones on either side. Joints whose neighbours a rig has not are left out.
    """
    roles = find_roles(clip.skeleton).joints
    rotations, places = kinematics.forward(clip)
    tips = dict(
        zip(
            (s.joint for s in clip.skeleton.end_sites),
            np.swapaxes(kinematics.tip_positions(clip, rotations, places), 0, 1),
            strict=True,
        )
    )
    out: dict[str, list[Float]] = {}
    for side in ("left", "right"):
        for finger in FINGERS:
            chain = [roles.get(f"{side}{finger}{part}") for part in _CHAINS.get(finger, _CHAIN)]
            if side + "Hand" not in roles or any(joint is None for joint in chain):
                continue
            joints = [joint for joint in chain if joint is not None]
            points = [places[:, roles[side + "Hand"]], *(places[:, joint] for joint in joints)]
            children = clip.skeleton.children[joints[-1]]
            if joints[-1] in tips:
                points.append(tips[joints[-1]])
            elif children:
                points.append(places[:, children[0]])
            for n, (a, b, c) in enumerate(zip(points[:-2], points[1:-1], points[2:], strict=True), 1):
                u, v = b - a, c - b
                cosine = (u * v).sum(-1) / np.maximum(np.linalg.norm(u, axis=-1) * np.linalg.norm(v, axis=-1), 1e-12)
                out.setdefault(f"{finger} {n}", []).append(np.rad2deg(np.arccos(np.clip(cosine, -1, 1))))
    return {name: np.concatenate(rows) for name, rows in out.items()}


def slerp_motion_ratio(clips: Sequence[Clip], n_frames: int = 18) -> float:
    """Path of the fingertips that slerp makes over hidden frames, over the true one."""
    return hidden_frames(clips, [find_transition("slerp")], (n_frames,))[0].motion_ratio


def _five(values: Sequence[float] | Float) -> tuple[float, ...]:
    return tuple(float(v) for v in np.percentile(values, PERCENTILES))


def motion_quantities(pairs: Pairs, seen: Moving) -> list[Quantity]:
    """Speeds of the corpus beside published ones."""
    means, peaks = running(pairs)
    return [
        Quantity("wrist speed, mean of running signing", "m/s", _five(means), (0.42, 0.47), "real continuous signing"),
        Quantity("wrist speed, peak of a sign alone", "m/s", _five(peaks), (1.7, 2.5), "real isolated words"),
        Quantity("speed at a transition's start / peak", "", _five(seen.start), (0.69,), _DGS),
        Quantity("speed at a transition's end / peak", "", _five(seen.end), (0.52,), _DGS),
        Quantity("velocity jump at the seams", "sw/s", _five(seen.jump), (0.28,), "real signing at 25 fps"),
    ]
