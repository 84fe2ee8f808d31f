"""Head, trunk and eyes between the signs: rotations added in the channels that no word owns.

The rotations are sums of minimum-jerk submovements (Flash and Henis 1991): one where a word begins, partly towards its
hands, others at irregular times. People's heads are not predicted by their hands (three captures of
Sign Language of the Netherlands: R2 under 0.4 on parts held out), so these are plausible, not true, and no signer has
judged them. They ease to zero while a hand is at the head, or touches the trunk. Nothing nods or shakes, since that is
grammar; only in a question whose brows are by rule does the head lean forward. The eyes undo them, so that they
stay on the addressee, and now and then look at the hands.
"""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from signsplice.body import collision
from signsplice.motion import Clip, FloatArray, Skeleton, at_frames, copy_unchecked, kinematics, rotation
from signsplice.motion.curves import between, minimum_jerk, sparse
from signsplice.rig.info import active_span, arms, hands_in_trunk_axes, rig_info
from signsplice.rig.roles import CHANNELS
from signsplice.splicing.person import REST, find_channel_joints, peak_speed
from signsplice.splicing.word import AlignedWord


@dataclass(frozen=True)
class PostureSettings:
    """Sizes and times of the motion of head and trunk. Those of people (three captures): the head on the chest turns by
    9 to 12 degrees rms over six seconds, at a median speed of 20 degrees/s, the chest on the hips by 1 to 3.6 an axis,
    at 7 to 9. The head's are smaller here: a turn that means nothing shall not be read as one that does. What is not in
    these figures was chosen by eye.
    """

    head_deg: tuple[float, float, float] = (5.2, 10.4, 5.2)
    """Standard deviations of the head's targets on the chest: forward, left, to the right shoulder, degrees."""
    trunk_deg: tuple[float, float, float] = (2.3, 3.2, 2.0)
    """The same of the trunk on the hips."""
    most_deg: tuple[float, float] = (14.0, 6.0)
    """Largest target of head and trunk, degrees."""
    towards_hands_deg: tuple[float, float] = (3.6, 2.4)
    """Rotation of head and trunk towards hands that are one arm length beside the middle, degrees."""
    move_s: tuple[float, float] = (0.6, 1.1)
    """Range of the durations of a submovement, s."""
    fastest_deg_s: float = 27.0
    """Highest speed of the head in one submovement, degrees/s; two may overlap."""
    early_s: float = 0.15
    """Largest time before a word is left at which the submovement to the next one begins, s."""
    interval_s: tuple[float, float] = (0.7, 1.9)
    """Range of the times between submovements that no word begins, s."""
    sway: float = 0.6
    """Sizes of these submovements, standard deviations."""
    raised_deg: tuple[float, float, float] = (5.0, 0.0, 0.0)
    """Rotation of the head in a question of yes or no, with raised brows: forward (Baker-Shenk 1983; Liddell 1980)."""
    furrowed_deg: tuple[float, float, float] = (3.0, 0.0, 4.0)
    """The same during one with a question word, with lowered brows: forward and tilted."""
    ease_s: float = 0.6
    """Time in which the rotations ease to zero before a touch, s."""
    return_s: float = 0.9
    """Time in which they come back after it, s: the head may come back from the hand at the same time."""
    head_m: tuple[float, float] = (0.02, 0.12)
    """Distances of a hand from the head at which its rotations are zero, and whole, m."""
    fingertip_m: float = 0.02
    """Distance of a fingertip, or of the palm's skin, from the nearest joint of the hand, m."""
    trunk_m: tuple[float, float] = (0.01, 0.05)
    """The same for the trunk and raised hands."""
    hanging: float = 0.35
    """Fraction of the trunk's rotations while an owned hand hangs beside the hips, which do not move."""
    late: float = 1.5
    """Speed, in times of that of ``ease_s``, at which rotations end before a touch that was not known in time."""
    glance: float = 0.2
    """Fraction of the words in which the eyes look at the hands."""
    glance_delay_s: float = 0.2
    """Largest time from the beginning of a word to such a look, s."""
    glance_s: tuple[float, float] = (0.35, 0.6)
    """Range of the times of such looks, s."""
    saccade_s: float = 0.07
    """Time in which the eyes move, s."""
    eye_height: float = 0.4
    """Height of the eyes above the shoulders, arm lengths."""
    eyes_deg: float = 30.0
    """Angle of an eye whose coefficient is 1, and its largest angle, degrees."""


POSTURE = PostureSettings()
_STEP_S = 0.1
"""Time between the frames in which distances of hands are measured, s."""


def measure_freedom(clip: Clip) -> FloatArray:
    """Returns how far head and trunk may turn in the frames of a clip, 0 while a hand is at them, to 1, and how far the
    left and the right hand are raised, 0 to 1: (T, 4).
    """
    return clip.derived[find_freedom]


def find_freedom(clip: Clip) -> FloatArray:
    """Measures how far head and trunk may turn, and hands are raised, for ``measure_freedom``."""
    frames, lift = sparse(len(clip), _STEP_S * clip.fps), arms(clip).lift
    is_raised = lift[frames] > REST.hanging_height
    raised = is_raised.any(axis=1)
    global_rotations, positions = kinematics.forward(at_frames(clip, frames[raised]))
    posed = collision.pose_capsules(clip.skeleton, global_rotations, positions)
    metres = rig_info(clip.skeleton).sizes.unit.metres
    groups, radii = posed.body.groups, posed.body.radii.max(axis=1)
    free = np.ones((len(frames), 2))
    for part, (solid, (near, far)) in enumerate(((groups.head, POSTURE.head_m), (groups.trunk, POSTURE.trunk_m))):
        rows = list(solid)
        starts, axes = posed.starts[:, None, rows], (posed.ends - posed.starts)[:, None, rows]
        for side in (0, 1):
            hand = positions[:, clip.skeleton.derived[_hand_joints][side], None]  # (F, K, 1, 3)
            squared = collision.segment_distance_squared(hand, starts, axes, collision.dot(axes, axes))
            gaps = (np.sqrt(squared) - radii[rows]).min(axis=(1, 2), initial=np.inf)
            distances = metres * gaps - POSTURE.fingertip_m
            touched = np.where(is_raised[raised, side], np.clip((distances - near) / (far - near), 0.0, 1.0), 1.0)
            free[raised, part] = np.minimum(free[raised, part], touched)
    # The least of half a second: hands that tremble near the head do not shake it.
    free = between(minimum_jerk(scipy.ndimage.minimum_filter1d(free, 5, axis=0, mode="nearest")), frames)
    return np.hstack([free, minimum_jerk(np.clip(lift / REST.hanging_height, 0.0, 1.0))])


def _hand_joints(skeleton: Skeleton) -> tuple[list[int], list[int]]:
    joints = rig_info(skeleton).arm_joints
    return kinematics.subtree(skeleton, joints[2]), kinematics.subtree(skeleton, joints[5])


@dataclass(frozen=True, eq=False)
class Submovement:
    """A minimum-jerk submovement of head and trunk.

    begin_s: its time in the sentence, s.
    seconds: its duration.
    angles: (6,) rotation vector of the head on the chest, then of the trunk on the hips, degrees: forward, left, to the
        right shoulder.
    """

    begin_s: float
    seconds: float
    angles: FloatArray

    @property
    def end_s(self) -> float:
        """The time at which it ends, s."""
        return self.begin_s + self.seconds


def _sum_submovements(submovements: Sequence[Submovement], times: FloatArray, n_axes: int) -> FloatArray:
    """Returns the sum (T, n_axes) of the angles that submovements have reached at ``times`` (T,)."""
    if not submovements:
        return np.zeros((len(times), n_axes))
    begins, seconds = np.array([(step.begin_s, step.seconds) for step in submovements]).T
    progress = minimum_jerk(np.clip((times[:, None] - begins) / seconds, 0.0, 1.0))  # (T, N)
    return np.asarray(progress @ np.array([step.angles for step in submovements]))


def _draw(seed: int, text: str) -> np.random.Generator:
    """Returns the random numbers that belong to a text, such as a word's name."""
    return np.random.default_rng(zlib.crc32(f"{seed} {text}".encode()))


class Carriage:
    """Head, trunk and eyes of a growing sentence in the channels that no word owns.

    amount: factor of all rotations, 0 to 1.
    """

    def __init__(self, amount: float, seed: int) -> None:
        self.amount, self._seed = amount, seed
        self._n_words = self._n_frames = 0
        self._settled, self._target = np.zeros(6), np.zeros(6)
        self._submovements: list[Submovement] = []
        self._free = np.zeros(3)
        self._sways_s = 0.0
        self._glances: list[tuple[Submovement, Submovement]] = []

    def move(
        self, n_frames: int, before: AlignedWord, kept: slice, after: AlignedWord | None
    ) -> tuple[FloatArray, FloatArray]:
        """Returns the rotation vectors (T, 2, 3) of head and trunk in the next T frames, those of a word and of the
        transition after it, and the angles (T, 2) of the eyes down and to the left from straight ahead, degrees.

        n_frames: their number T.
        kept: the retimed frames of the word that they begin with.
        after: the next word; None at the end, where head and trunk come to rest.
        """
        fps, first = before.clip.fps, self._n_frames
        self._n_frames += n_frames
        free = self._ease(before, kept, n_frames, after)
        times = (first + np.arange(n_frames)) / fps
        stop_s = (first + kept.stop - kept.start) / fps
        self._add_submovements(first / fps, stop_s, (first + n_frames) / fps, before, after)
        angles = self._settled + _sum_submovements(self._submovements, times, 6)
        angles = self.amount * free[:, :2, None] * angles.reshape(n_frames, 2, 3)
        looks = self.amount * _sum_submovements([step for pair in self._glances for step in pair], times, 2)
        looks = free[:, 2:] * (looks - angles.sum(axis=1)[:, :2])
        for submovement in [step for step in self._submovements if step.end_s <= times[-1]]:
            self._settled = self._settled + submovement.angles
            self._submovements.remove(submovement)
        self._glances = [pair for pair in self._glances if pair[1].end_s > times[-1]]
        return angles, looks

    def _ease(self, before: AlignedWord, kept: slice, n_frames: int, after: AlignedWord | None) -> FloatArray:
        """Returns factors (n_frames, 3) of the rotations of head, trunk and eyes; they change in ``POSTURE.ease_s``."""
        here = _word_freedom(before)[kept]
        coming = np.zeros((1, 3)) if after is None else _word_freedom(after)[after.first_frame :]
        n_new = n_frames - len(here)
        weights = np.linspace(0.0, 1.0, n_new + 2)[1:-1, None]
        limits = np.concatenate([here, (1.0 - weights) * here[-1:] + weights * coming[:1], coming])
        step = 1.0 / (POSTURE.ease_s * before.clip.fps)
        rise = step * np.arange(len(limits) + 1)[:, None]
        limits = np.minimum.accumulate((limits + rise[1:])[::-1])[::-1] - rise[1:]
        back = rise * POSTURE.ease_s / POSTURE.return_s
        eased = np.minimum.accumulate(np.concatenate([self._free[None], limits]) - back) + back
        eased = np.clip(np.maximum(eased, self._free - POSTURE.late * rise)[1 : n_frames + 1], 0.0, 1.0)
        eased[: len(here), _is_fixed(before)] = 0.0
        self._free = eased[-1]
        return minimum_jerk(eased)

    def _add_submovements(
        self, start_s: float, cut_s: float, stop_s: float, before: AlignedWord, after: AlignedWord | None
    ) -> None:
        """Adds the submovements of a stretch: one with the next word, others at irregular times."""
        random = _draw(self._seed, f"{before.clip.name} {self._n_words}")
        self._n_words += 1
        deviations = np.array([*POSTURE.head_deg, *POSTURE.trunk_deg])
        if after is not None:
            target = deviations * random.normal(size=6) + _towards_hands(after)
            self._move_to(target, max(start_s, cut_s - random.uniform(0.0, POSTURE.early_s)), random)
            if random.random() < POSTURE.glance:
                there, back = stop_s + random.uniform(0.0, POSTURE.glance_delay_s), random.uniform(*POSTURE.glance_s)
                angles = _towards_eyes(after)
                glance = (
                    Submovement(there, POSTURE.saccade_s, angles),
                    Submovement(there + back, POSTURE.saccade_s, -angles),
                )
                self._glances.append(glance)
        while self._sways_s < stop_s:
            self._move_to(self._target + POSTURE.sway * deviations * random.normal(size=6), self._sways_s, random)
            self._sways_s += random.uniform(*POSTURE.interval_s)

    def _move_to(self, target: FloatArray, begin_s: float, random: np.random.Generator) -> None:
        """Adds a submovement to a target (6,), or towards it as far as ``POSTURE.most_deg``."""
        sizes = np.linalg.norm(target.reshape(2, 3), axis=1, keepdims=True)
        most = np.array(POSTURE.most_deg)[:, None]
        target = (target.reshape(2, 3) * most / np.maximum(sizes, most)).ravel()
        angles = target - self._target
        least_s = peak_speed(float(np.linalg.norm(angles[:3]))) / POSTURE.fastest_deg_s
        self._submovements.append(Submovement(begin_s, max(random.uniform(*POSTURE.move_s), least_s), angles))
        self._target = target


def _word_freedom(word: AlignedWord) -> FloatArray:
    """Returns how far (T, 3) head, trunk and eyes may turn in the retimed frames of a word: 0 if it owns them, or while
    a hand is at them, to 1.
    """
    measured = word.measured or word.clip
    free = measure_freedom(measured)
    recorded = np.ones((len(free), 3))
    recorded[:, :2] = free[:, :2]
    for side, channel in enumerate(CHANNELS[:2]):
        if channel not in word.paths:  # else it hangs in its clip, but not in the sentence
            least = POSTURE.hanging + (1.0 - POSTURE.hanging) * free[:, 2 + side]
            recorded[:, 1] = np.minimum(recorded[:, 1], least)
    recorded[:, _is_fixed(word)] = 0.0
    shown = np.arange(len(word.retimed)) if word.frames.sources is None else word.frames.sources
    rows = shown if measured is word.clip else shown * word.own_step  # frames of the caller's clip
    return np.stack([np.interp(rows, np.arange(len(recorded)), column) for column in recorded.T], axis=1)


def _is_fixed(word: AlignedWord) -> list[bool]:
    """Returns whether head, trunk and eyes (3) of a word are its own, or missing."""
    return ["head" not in word.planned, "trunk" not in word.planned, not word.face_by_rules]


def _towards_hands(word: AlignedWord) -> FloatArray:
    """Returns the rotations (6,) of head and trunk towards the hands of a word, and for its question, degrees."""
    owned = [side for side in (0, 1) if CHANNELS[side] in word.owns]
    angles = np.zeros(6)
    if owned:
        x = (word.measured or word.clip).derived[find_hand_offsets][owned, 0].mean()
        angles[[1, 4]] = x * np.array(POSTURE.towards_hands_deg)
    if word.brow is not None:
        angles[:3] += POSTURE.raised_deg if word.brow == "raised" else POSTURE.furrowed_deg
    return angles


def _towards_eyes(word: AlignedWord) -> FloatArray:
    """Returns the angles (2,) of the eyes to the hands of a word, down and to the left, degrees."""
    owned = [side for side in (0, 1) if CHANNELS[side] in word.owns] or [0, 1]
    x, y, z = (word.measured or word.clip).derived[find_hand_offsets][owned].mean(axis=0)
    angles = np.rad2deg([np.arctan2(POSTURE.eye_height - y, np.hypot(x, z)), np.arctan2(x, z)])
    return np.clip(angles, -POSTURE.eyes_deg, POSTURE.eyes_deg)


def find_hand_offsets(clip: Clip) -> FloatArray:
    """Returns mean offsets (2, 3) of the hands from between the shoulders, left, up and forward, arm lengths."""
    motion, (start, stop) = arms(clip), active_span(arms(clip))
    wrists, _ = hands_in_trunk_axes(motion)
    return np.asarray(wrists[start:stop].mean(axis=0) / motion.length)


def rotate_person(clip: Clip, angles: FloatArray) -> Clip:
    """Returns a clip with head and trunk rotated by vectors ``angles`` (T, 2, 3), degrees, each shared by the joints
    that the rig has.
    """
    local = np.array(clip.local_rotations)
    for part, (joints, axes) in enumerate(clip.skeleton.derived[_rotated_joints]):
        if joints and angles[:, part].any():
            rotvecs = np.einsum("kab,tb->tka", axes, np.deg2rad(angles[:, part] / len(joints)))
            local[:, joints] = rotation.multiply(local[:, joints], rotation.exp(rotvecs))
    return copy_unchecked(clip, local_rotations=local)


def _rotated_joints(skeleton: Skeleton) -> list[tuple[list[int], FloatArray]]:
    """Returns the joints (K) of head and trunk, and matrices (K, 3, 3) that bring a rotation vector into their axes."""
    canonical, channels = rig_info(skeleton).canonical, skeleton.derived[find_channel_joints]
    matrices = dict(zip(canonical.joints[canonical.has_role].tolist(), canonical.from_canonical, strict=True))
    return [(channels[part], np.array([matrices[joint] for joint in channels[part]])) for part in ("head", "trunk")]
