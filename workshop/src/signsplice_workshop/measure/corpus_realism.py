"""Measures the realism of a corpus against published figures: durations, speeds, paths, finger ranges, kinds of signs.

All of it is measured on clips alone, in the same way on synthetic and on captured motion.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from signsplice.motion import Clip, FloatArray, kinematics, rotation
from signsplice.rig.info import rig_info
from signsplice.rig.roles import FINGERS
from signsplice.signer import notation
from signsplice.signer.phonology import ON_BASE, Sign
from signsplice.signer.signer import stream
from signsplice.splicing.curves import find_transition
from signsplice_workshop.corpora import pseudo
from signsplice_workshop.corpora.pairs import Pairs
from signsplice_workshop.measure.hands import busier_side, flexions, hand_likeness, strong_side, strong_wrist
from signsplice_workshop.measure.hidden_frames import score_hidden_frames
from signsplice_workshop.measure.measures import Quantity, percentiles

N_PSEUDO = 300
"""Number of pseudo-signs that are counted: the first ones by seed."""
ASL_LEX = "ASL-LEX 2.0, 2,723 signs"
TARGET = "range aimed at"
"""Source of ranges without a published table."""
_SHORTEST_PASS_M = 0.015


_KINDS: dict[str, tuple[Callable[[Sign], bool], float]] = {
    "one-handed": (lambda sign: sign.hands == "one", 0.39),
    "symmetric or alternating": (lambda sign: sign.hands in ("symmetric", "alternating"), 0.35),
    "first place at the other hand": (lambda sign: sign.segments[0].strong.location in ON_BASE, 0.25),
    "first place in neutral space": (lambda sign: sign.segments[0].strong.location.startswith("space"), 0.36),
}
"""Kind -> whether a sign is of this kind, and its share in ASL-LEX 2.0. Space next to or before the face belongs to the
face, as in ASL-LEX.
"""


def compare_kinds(signs: Sequence[Sign], suffix: str) -> list[Quantity]:
    """Returns shares of kinds of signs beside those of ASL-LEX 2.0 (Sehyr et al. 2021). ``suffix``: text behind the
    kind's name.
    """
    return [
        Quantity(f"{kind}, {suffix}", "", (float(np.mean([is_kind(sign) for sign in signs])),), (share,), ASL_LEX)
        for kind, (is_kind, share) in _KINDS.items()
    ]


def compare_sign_kinds() -> list[Quantity]:
    """Returns shares of kinds among the words that ship (without letters and digits) and among pseudo-signs."""
    pseudo_signs = [pseudo.draw_sign(seed) for seed in range(N_PSEUDO)]
    return compare_kinds(list(notation.everyday().values()), "words that ship") + compare_kinds(
        pseudo_signs, "pseudo-signs"
    )


def measure_second_passes(pairs: Pairs) -> list[Quantity]:
    """Returns size and time of the second pass of a word's last movement over those of the first, words of the first
    signer.

    Size: the largest distance of the strong wrist, seen from the chest, from the start of the pass. Movements whose
    first pass is smaller than 1.5 cm are left out. Empty if no word has two passes.
    """
    strong = strong_side(pairs)
    sizes, times = [], []
    for k in range(len(pairs.head["words"]) // 2):
        passes = pairs.events(k).passes
        if len(passes) < 2:
            continue
        wrist = _from_chest(pairs.word_clip(k), strong)
        paths = [wrist[begin : end + 1] - wrist[begin] for begin, end in passes[:2]]
        first, second = (float(np.linalg.norm(path, axis=-1).max()) for path in paths)
        if first >= _SHORTEST_PASS_M:
            sizes.append(second / first)
            times.append((passes[1][1] - passes[1][0]) / (passes[0][1] - passes[0][0]))
    if not sizes:
        return []
    return [
        Quantity("second pass over the first, size", "", percentiles(sizes), (0.6, 1.0), TARGET, spread=True),
        Quantity("second pass over the first, time", "", percentiles(times), (0.85, 1.15), TARGET, spread=True),
    ]


def _from_chest(clip: Clip, strong: str) -> FloatArray:
    """Returns positions (T, 3) of the strong wrist in the axes of the joint that carries the shoulders, m."""
    info = rig_info(clip.skeleton)
    joints = info.roles.joints
    chest = int(clip.skeleton.parents[joints[f"{strong}Shoulder"]])
    rotations, positions = kinematics.forward(clip, [chest, joints[f"{strong}Hand"]])
    return (
        np.asarray(np.einsum("tba,tb->ta", rotations[:, 0], positions[:, 1] - positions[:, 0])) * info.sizes.unit.metres
    )


def find_symmetric_words(pairs: Pairs, signs: Mapping[str, Sign]) -> list[int]:
    """Returns the numbers of the first signer's words whose signs are symmetric."""
    glosses = [row["gloss"] for row in pairs.head["words"]][: len(pairs.head["words"]) // 2]
    return [k for k, gloss in enumerate(glosses) if gloss in signs and signs[gloss].hands == "symmetric"]


MOVING = 0.1
"""Speed of the faster wrist, arm lengths a second, above which a frame counts as moving."""
_REACH_SPEED = 0.5
_REACH_FRAMES = 4
_FORMING_DEG = 20.0


@dataclass(frozen=True, eq=False)
class MeasuredMotion:
    """Motion of one signer in some clips. Frames in which no wrist moves (``MOVING``) do not count.

    angular_deg: angular speed of a joint of the strong side relative to its parent, degrees/s (N,), by role
        ("UpperArm", "Hand"); roles the rig lacks are left out.
    speed: speed of the strong wrist in space, arm lengths (shoulder to wrist) a second (N,).
    abduction_deg: angle between the strong upper arm and the line from the middle of the shoulders to the hips (N,).
    wrist_bend_deg: angle between the strong forearm and the line from its wrist to its middle knuckle (N,); empty if
        the rig has no fingers.
    forming: time at which a finger has made half of its change of bend on a reach, as a fraction of the reach's time
        (R,). A reach lies between two minima of the strong wrist's speed, and its peak is faster than half an arm
        length a second; fingers that change by less than 20 degrees are left out.
    """

    angular_deg: dict[str, FloatArray]
    speed: FloatArray
    abduction_deg: FloatArray
    wrist_bend_deg: FloatArray
    forming: FloatArray


def signer_motion(clips: Sequence[Clip], strong: str) -> MeasuredMotion:
    """Returns the motion of the signer of clips of one rig. ``strong``: the strong side, "left" or "right"."""
    motions = [_clip_motion(clip, strong) for clip in clips]

    def concatenate_field(name: str) -> FloatArray:
        return np.concatenate([np.empty(0), *(getattr(motion, name) for motion in motions)])

    roles = dict.fromkeys(role for motion in motions for role in motion.angular_deg)
    angular = {role: np.concatenate([motion.angular_deg[role] for motion in motions]) for role in roles}
    return MeasuredMotion(angular, *(concatenate_field(field.name) for field in fields(MeasuredMotion)[1:]))


def _clip_motion(clip: Clip, strong: str) -> MeasuredMotion:
    info = rig_info(clip.skeleton)
    joints = info.roles.joints
    arm = info.sizes.arm_length
    _, positions = kinematics.forward(clip)
    joint_positions = {role: positions[:, joint] for role, joint in joints.items()}  # (T, 3) each
    steps = np.diff(
        np.stack([joint_positions[f"{strong}Hand"], joint_positions[f"{_opposite_side(strong)}Hand"]]), axis=1
    )
    speeds = np.linalg.norm(steps, axis=-1) * clip.fps / arm  # (2, T - 1)
    speed, moving = speeds[0], speeds.max(axis=0) > MOVING
    upper_arm = joint_positions[f"{strong}LowerArm"] - joint_positions[f"{strong}UpperArm"]
    forearm = joint_positions[f"{strong}Hand"] - joint_positions[f"{strong}LowerArm"]
    shoulder_middle = 0.5 * (joint_positions["leftUpperArm"] + joint_positions["rightUpperArm"])
    knuckle = joint_positions.get(f"{strong}MiddleProximal")
    bend = (
        np.empty(0) if knuckle is None else _angle_deg(forearm, knuckle - joint_positions[f"{strong}Hand"])[1:][moving]
    )
    angular = {}
    for role in ("UpperArm", "Hand"):
        joint = joints.get(strong + role)
        if joint is not None:
            q = clip.local_rotations[:, joint]
            turns = np.linalg.norm(rotation.difference(q[:-1], q[1:]), axis=-1)
            angular[role] = np.rad2deg(turns * clip.fps)[moving]
    return MeasuredMotion(
        angular,
        speed[moving],
        _angle_deg(upper_arm, joint_positions["hips"] - shoulder_middle)[1:][moving],
        bend,
        np.array(list(find_half_formed_times(clip, strong, find_reaches(speed)))),
    )


def _opposite_side(side: str) -> str:
    return "right" if side == "left" else "left"


def _angle_deg(a: FloatArray, b: FloatArray) -> FloatArray:
    """Returns the angles (T,) between vectors (T, 3), degrees."""
    cosine = (a * b).sum(-1) / np.maximum(np.linalg.norm(a, axis=-1) * np.linalg.norm(b, axis=-1), 1e-12)
    return np.asarray(np.rad2deg(np.arccos(np.clip(cosine, -1.0, 1.0))))


def find_reaches(speed: FloatArray) -> list[tuple[int, int]]:
    """Returns [begin, end] frames of the reaches in speeds (T - 1,) from frame to frame: between two minima, at least
    four steps long, with a peak of more than half an arm length a second.
    """
    inner = np.flatnonzero((speed[1:-1] <= speed[:-2]) & (speed[1:-1] < speed[2:])) + 1
    return [(int(a), int(b)) for a, b in pairwise(inner) if b - a >= _REACH_FRAMES and speed[a:b].max() > _REACH_SPEED]


def find_half_formed_times(clip: Clip, strong: str, spans: Sequence[tuple[int, int]]) -> Iterator[float]:
    """Yields the times at which the fingers of the strong hand have made half of their change of bend, as fractions of
    the time of spans [begin, end] of frames (``find_half_change``).
    """
    bends = flexions(clip)
    n = len(clip)
    half = slice(0, n) if strong == "left" else slice(n, 2 * n)
    fingers = [
        np.stack([bends[f"{finger} {k}"][half] for k in (1, 2, 3)], axis=-1)
        for finger in FINGERS
        if f"{finger} 3" in bends
    ]  # (T, 3) each
    for first, last in spans:
        for bend in fingers:
            fraction = find_half_change(bend[first : last + 1])
            if fraction is not None:
                yield fraction


def find_half_change(values: FloatArray) -> float | None:
    """Returns the time at which values (T, K), degrees, have first made half of their way from first to last, as a
    fraction of the whole time; None if they change by less than 20.
    """
    change = values[-1] - values[0]
    if np.linalg.norm(change) < _FORMING_DEG:
        return None
    progress = (values - values[0]) @ change / (change @ change)
    after = int(np.argmax(progress >= 0.5))
    before = progress[after - 1]
    return float((after - 1 + (0.5 - before) / (progress[after] - before)) / (len(values) - 1))


N_PAIRS = 1500
"""Number of pairs whose motion is measured, drawn once; durations are counted over all pairs."""
N_SIGNING = 300
"""Number of pairs in which the signer's motion is measured, drawn once."""
FEWEST = 20
"""Least number of values of a real clip whose percentiles count."""
_SHORTEST_CHORD_M = 0.03
_CZECH = "Czech SL, 33 takes"
_DGS = "DGS Corpus, 32 sentences"
_JOINTS = {
    "UpperArm": "strong upper arm",
    "Hand": "strong wrist joint",
}
"""Roles in ``MeasuredMotion.angular_deg``, with their names in tables. Head and trunk are no target: in signing they
move for grammar, role and glances, which words alone do not have; a signer with random moves of their speed would look
away and nod without a reason.
"""
_MEASURES = {
    "speed": ("wrist speed while moving", "arms/s"),
    "abduction_deg": ("strong upper arm from the trunk", "degrees"),
    "wrist_bend_deg": ("bend of the strong wrist", "degrees"),
    "forming": ("finger half formed, of the reach's time", ""),
}
"""Fields of ``MeasuredMotion`` with their name and unit."""
_LIKENESS = {
    "cm": ("symmetric hands from a mirror image", "cm", (1.0, 3.0)),
    "lag": ("time between symmetric hands", "frames", (1.0, 2.0)),
}
"""Fields of ``HandLikeness`` with their name, unit and target range."""


def durations(pairs: Pairs) -> list[Quantity]:
    """Returns the durations of transitions, of signs in a sentence and of signs alone, ms."""
    n_words = len(pairs.head["words"]) // 2
    index = pairs.index[pairs.index[:, 0] < n_words]
    ms = 1e3 / pairs.head["fps"]
    events = [pairs.events(k) for k in range(n_words)]
    alone = [ms * (event.end - event.start + 1) for event in events]
    return [
        Quantity("transition", "ms", percentiles(ms * (index[:, 5] + 1)), (160, 200, 250, 320, 480), _CZECH),
        Quantity(
            "sign in a sentence", "ms", percentiles(ms * _draw_sign_lengths(index)), (158, 260, 400, 540, 912), _CZECH
        ),
        Quantity("sign alone", "ms", percentiles(alone), (440, 564, 720, 960, 1360), "Czech SL, 336 items"),
        Quantity("sign alone", "ms", percentiles(alone), (400, 630, 830, 1030, 1370), ASL_LEX),
    ]


def _draw_sign_lengths(index: NDArray[np.int32]) -> FloatArray:
    """Returns the number of frames that a word keeps between two others, over triples of words drawn at random."""
    enters = {(p, q): post for p, q, _, post, _, _ in index.tolist()}
    leaves = {(p, q): pre for p, q, pre, _, _, _ in index.tolist()}
    words = sorted({p for p, _ in enters})
    triples = stream("triples", len(words)).choice(words, size=(20_000, 3))
    return np.array([leaves[b, c] - enters[a, b] + 1 for a, b, c in triples.tolist()], np.float64)


@dataclass(frozen=True, eq=False)
class WristMotion:
    """Motion of the strong wrist in N drawn pairs, from the start of the first sign to the end of the second.

    speed: speeds from frame to frame, all pairs together, m/s.
    peak: highest speed in each transition (N,), m/s.
    start, end: speed just before and just after each transition (N,), over its peak.
    detour: path length over chord of each transition with a chord of more than 3 cm.
    jump: change of velocity at each seam (2 N,), shoulder widths / s.
    exponent: see ``power_law``.
    jerk: see ``rms_jerk``, m/s^3.
    """

    speed: FloatArray
    peak: FloatArray
    start: FloatArray
    end: FloatArray
    detour: FloatArray
    jump: FloatArray
    exponent: float
    jerk: float


def wrist_motion(pairs: Pairs, n_pairs: int = N_PAIRS) -> WristMotion:
    """Returns the motion of the strong wrist in pairs of the first signer, drawn once."""
    numbers = np.flatnonzero(pairs.index[:, 0] < len(pairs.head["words"]) // 2)
    fps, strong = pairs.head["fps"], strong_side(pairs)
    sizes = rig_info(pairs.clip(0).skeleton).sizes
    width = sizes.shoulder_width * sizes.unit.metres
    speeds, peaks, starts, ends, detours, jumps, paths = [], [], [], [], [], [], []
    for number in stream("moving", len(numbers)).choice(numbers, min(n_pairs, len(numbers)), replace=False).tolist():
        p, q, pre, post, _, count = pairs.index[number].tolist()
        positions = strong_wrist(pairs.clip(number), strong)  # (T, 3)
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


def sentence_speeds(pairs: Pairs, n_sentences: int = 200) -> FloatArray:
    """Returns the mean speed (n_sentences,) of the strong wrist in chains of eight words, first sign to last, m/s."""
    n_words = len(pairs.head["words"]) // 2
    number = {(p, q): k for k, (p, q) in enumerate(pairs.index[:, :2].tolist())}
    strong = strong_side(pairs)
    words = [strong_wrist(pairs.word_clip(k), strong) for k in range(n_words)]  # (T, 3) each
    transition_paths: dict[tuple[int, int], FloatArray] = {}
    means = []
    for chain in stream("chains", n_words).choice(n_words, size=(n_sentences, 8)).tolist():
        pieces = []
        enter = pairs.events(chain[0]).start
        for a, b in pairwise(chain):
            pre, post, _ = pairs.truth(number[a, b])
            if (a, b) not in transition_paths:
                clip = pairs.clip(number[a, b])
                count = int(pairs.index[number[a, b], 5])
                transition_paths[a, b] = strong_wrist(clip[pre + 1 : pre + 1 + count], strong)
            pieces += [words[a][enter : pre + 1], transition_paths[a, b]]
            enter = post
        pieces.append(words[chain[-1]][enter : pairs.events(chain[-1]).end + 1])
        means.append(speeds(np.concatenate(pieces), pairs.head["fps"]).mean())
    return np.array(means)


def word_peak_speeds(pairs: Pairs) -> FloatArray:
    """Returns the highest speed of the strong wrist in each isolated word of the first signer, m/s."""
    clips = (pairs.word_clip(k) for k in range(len(pairs.head["words"]) // 2))
    strong = strong_side(pairs)
    return np.array([speeds(strong_wrist(clip, strong), clip.fps).max() for clip in clips])


def speeds(positions: FloatArray, fps: float) -> FloatArray:
    """Returns the speeds (T - 1,) from frame to frame along positions (T, 3), units a second."""
    return np.asarray(np.linalg.norm(np.diff(positions, axis=0), axis=-1) * fps)


def motion_quantities(pairs: Pairs, motion: WristMotion) -> list[Quantity]:
    """Returns the speeds of the corpus with published ones."""
    means, peaks = percentiles(sentence_speeds(pairs)), percentiles(word_peak_speeds(pairs))
    return [
        Quantity("wrist speed, mean of running signing", "m/s", means, (0.42, 0.47), "real continuous signing"),
        Quantity("wrist speed, peak of a sign alone", "m/s", peaks, (1.7, 2.5), "real isolated words"),
        Quantity("speed at a transition's start / peak", "", percentiles(motion.start), (0.69,), _DGS),
        Quantity("speed at a transition's end / peak", "", percentiles(motion.end), (0.52,), _DGS),
        Quantity("velocity jump at the seams", "sw/s", percentiles(motion.jump), (0.28,), "real signing at 25 fps"),
    ]


def power_law(paths: Sequence[FloatArray], fps: float) -> float:
    """Returns the exponent b of speed ~ curvature^b over all frames that move (two-thirds power law: -1/3; Lacquaniti
    et al. 1983): the slope of the regression of their logarithms. ``paths``: (T, 3) each, m.
    """
    logs = []
    for path in paths:
        if len(path) < 5:
            continue
        velocity = np.gradient(path, 1.0 / fps, axis=0)
        acceleration = np.gradient(velocity, 1.0 / fps, axis=0)
        speed = np.linalg.norm(velocity, axis=-1)
        curvature = np.linalg.norm(np.cross(velocity, acceleration), axis=-1) / np.maximum(speed, 1e-9) ** 3
        valid = (speed > 0.15) & (curvature > 0.1)
        logs.append(np.log(np.stack([curvature[valid], speed[valid]], axis=-1)))
    x, y = np.concatenate(logs).T
    return float(np.polyfit(x, y, 1)[0])


def rms_jerk(paths: Sequence[FloatArray], fps: float) -> float:
    """Returns the root mean square of the jerk (third difference) of paths (T, 3), m: m/s^3."""
    jerks = [np.linalg.norm(np.diff(path, n=3, axis=0), axis=-1) * fps**3 for path in paths if len(path) > 3]
    return float(np.sqrt(np.mean(np.concatenate(jerks) ** 2)))


def slerp_motion_ratio(clips: Sequence[Clip], n_frames: int = 18) -> float:
    """Returns the path of the fingertips that slerp makes over hidden frames, over the true one."""
    return float(score_hidden_frames(clips, [find_transition("slerp")], (n_frames,))[0].motion_ratio)


def measure_forming(pairs: Pairs) -> FloatArray:
    """Returns the times at which fingers of the first signer's strong hand have made half of their change of bend in
    true transitions, as fractions of the transition (``find_half_formed_times``); pairs are drawn once.
    """
    strong = strong_side(pairs)
    fractions: list[float] = []
    for number in _draw_pairs(pairs):
        pre, count = int(pairs.index[number, 2]), int(pairs.index[number, 5])
        fractions += find_half_formed_times(pairs.clip(number)[pre : pre + count + 2], strong, [(0, count + 1)])
    return np.array(fractions)


def _draw_pairs(pairs: Pairs) -> list[int]:
    """Returns the numbers of the first signer's pairs in which the motion of the signer is measured."""
    numbers = np.flatnonzero(pairs.index[:, 0] < len(pairs.head["words"]) // 2)
    drawn = stream("signing", len(numbers)).choice(numbers, min(N_SIGNING, len(numbers)), replace=False)
    return [int(number) for number in drawn]


def signing_motion(pairs: Pairs) -> MeasuredMotion:
    """Returns the motion of the first signer in pairs drawn once, from the start of the first sign to the end of the
    second.
    """
    clips = []
    for number in _draw_pairs(pairs):
        p, q, pre, post, _, count = pairs.index[number].tolist()
        clips.append(pairs.clip(number)[pairs.events(p).start : pre + 2 + count + pairs.events(q).end - post])
    return signer_motion(clips, strong_side(pairs))


def compare_with_captures(pairs: Pairs, captured: Mapping[str, Clip]) -> list[Quantity]:
    """Returns the motion of the first signer beside captured clips by name, one line for each measure and clip."""
    ours = signing_motion(pairs)
    lines = []
    for name, clip in captured.items():
        real = signer_motion([clip], busier_side(clip))
        for role, text in _JOINTS.items():
            if role in ours.angular_deg and role in real.angular_deg:
                our_rms, real_rms = (float(np.sqrt(np.mean(motion.angular_deg[role] ** 2))) for motion in (ours, real))
                lines.append(
                    Quantity(f"{text}, rms", "degrees/s", (our_rms,), (real_rms,), f"{name}; n = {len(real.speed)}")
                )
        for field, (text, unit) in _MEASURES.items():
            lines += _compare_values(text, unit, getattr(ours, field), getattr(real, field), name)
    return lines


def compare_hands(pairs: Pairs, signs: Mapping[str, Sign], captured: Mapping[str, Clip]) -> list[Quantity]:
    """Returns how far the hands of symmetric words differ, from the first posture to the last, beside captured clips by
    name whose hands mirror each other, and beside the target ranges.
    """
    words = find_symmetric_words(pairs, signs)
    stretches = [[(pairs.events(k).start, pairs.events(k).end)] for k in words]
    ours = hand_likeness([pairs.word_clip(k) for k in words], stretches)
    lines = []
    for field, (text, unit, target) in _LIKENESS.items():
        values = getattr(ours, field)
        for name, clip in captured.items():
            lines += _compare_values(text, unit, values, getattr(hand_likeness([clip]), field), name)
        if len(values):
            lines.append(Quantity(text, unit, percentiles(values), target, TARGET))
    return lines


def _compare_values(text: str, unit: str, ours: FloatArray, real: FloatArray, name: str) -> list[Quantity]:
    """Returns values of the corpus beside those of a captured clip, a median alone if these are few; nothing without
    values.
    """
    if not (len(ours) and len(real)):
        return []
    figures = percentiles(real) if len(real) >= FEWEST else (float(np.median(real)),)
    return [Quantity(text, unit, percentiles(ours), figures, f"{name}; n = {len(real)}")]
