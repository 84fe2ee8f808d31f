"""Measures the rest of the person in sentences: idle hands that drop, a head and a chest that stand still or wander, a
face that does nothing, and seams that wait for an idle hand. The same figures of captured signing show what people do.

In three captures of running NGT (85 s) a hand drops to hang while the other signs 2.8 times a minute; idle hands hang
in 37 to 53 % of their frames, else they are 0.38 to 0.65 arm lengths below the shoulders and 0.2 to 0.35 in front. The
head turns on the chest by 9 to 12 degrees rms over six seconds, at a median speed of 20 degrees/s.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from signsplice.errors import InputError
from signsplice.motion import Clip, FloatArray, kinematics, rotation
from signsplice.rig.info import Arms, arms, rig_info
from signsplice.rig.roles import CHANNELS
from signsplice.signer.phonology import owned_channels as owned_by_sign
from signsplice.signer.signer import stream
from signsplice.splicing.engine import SpliceOptions, SpliceResult, splice
from signsplice.splicing.faces import RULES
from signsplice.splicing.person import owned_channels
from signsplice.splicing.word import Word
from signsplice_workshop.corpora.rekeying import rekey_clip
from signsplice_workshop.measure.measures import (
    Measure,
    Progress,
    Row,
    aggregate,
    format_measures,
    make_row,
    percent,
    track_progress,
)
from signsplice_workshop.measure.tempo import LENGTH, make_lexicons


@dataclass(frozen=True)
class IdleLimits:
    """What counts as an idle, a hanging and a dropping hand. Distances in arm lengths, below the shoulders."""

    idle_speed: float = 0.25
    """Speed below which a hand may be idle, arm lengths a second."""
    signing_speed: float = 0.6
    """Speed of the other hand above which it is idle, arm lengths a second."""
    hanging: float = 0.85
    """Distance below the shoulders from which a hand hangs."""
    raised: float = 0.7
    """Distance below the shoulders up to which a hand is raised: it drops when it hangs after having been raised."""
    window_s: float = 6.0
    """Length of the windows in which the spread of rotations is measured, s."""
    lag_s: float = 1.0
    """Shortest period that counts as periodic motion, s."""
    mouth_speed: float = 0.3
    """Change of a coefficient of the mouth above which the mouth moves, a second."""
    gaze: float = 0.05
    """Coefficient of an eye from which on the gaze leaves the addressee."""


LIMITS = IdleLimits()
_MOUTH = ("mouth", "jaw", "tongue")
_CHEST = ("upperChest", "chest", "spine")


@dataclass(frozen=True)
class PersonMotion:
    """The rest of the person in one clip; None where a clip has nothing to measure.

    minutes: duration.
    drops: number of times that a hand drops to hang while the other is raised.
    idle: number of frames in which a hand is slow while the other moves.
    hanging: number of these in which it hangs.
    below, in_front: medians of an idle hand that does not hang: distance below the shoulders, and in front of them, arm
        lengths.
    head_spread, chest_spread: rms angle of the head on the chest, and of the chest on the hips, from their mean over
        windows of ``LIMITS.window_s``, degrees.
    head_speed: median angular speed of the head on the chest, degrees/s.
    head_peak: highest angular speed of the head on the chest, degrees/s; in a sentence, in transitions between words
        that do not own it.
    period: highest autocorrelation of the head's three angles at lags of ``LIMITS.lag_s`` and more; 1 repeats itself.
    mouth, gaze: fractions of frames in which the mouth moves, and in which the eyes leave the addressee.
    idle_seam_s, other_seam_s: mean durations of seams with and without an idle hand, s.
    """

    minutes: float
    drops: int
    idle: int
    hanging: int
    below: float | None
    in_front: float | None
    head_spread: float | None
    chest_spread: float | None
    head_speed: float | None
    head_peak: float | None
    period: float | None
    mouth: float
    gaze: float
    idle_seam_s: float | None = None
    other_seam_s: float | None = None


def measure_person(clip: Clip) -> PersonMotion:
    """Measures a clip. Raises ``InputError`` if the rig's arms are not known by name."""
    motion = arms(clip)
    below = (motion.shoulders - motion.wrists) @ motion.up / motion.length  # (T, 2)
    speeds = np.linalg.norm(np.gradient(motion.wrists - motion.shoulders, axis=0), axis=-1) * clip.fps / motion.length
    is_idle = (speeds < LIMITS.idle_speed) & (speeds[:, ::-1] > LIMITS.signing_speed)
    hangs = below > LIMITS.hanging
    is_placed = is_idle & ~hangs
    in_front = _distances_in_front(motion)
    head, chest = _relative_rotations(clip, "head", _CHEST), _relative_chest(clip)
    head_speeds = None if head is None else _angular_speeds(head, clip.fps)
    return PersonMotion(
        minutes=len(clip) / clip.fps / 60.0,
        drops=sum(_count_drops(below[:, side], below[:, 1 - side]) for side in (0, 1)),
        idle=int(is_idle.sum()),
        hanging=int((is_idle & hangs).sum()),
        below=float(np.median(below[is_placed])) if is_placed.any() else None,
        in_front=float(np.median(in_front[is_placed])) if is_placed.any() else None,
        head_spread=None if head is None else _spread(head, clip.fps),
        chest_spread=None if chest is None else _spread(chest, clip.fps),
        head_speed=None if head_speeds is None else float(np.median(head_speeds)),
        head_peak=None if head_speeds is None else float(head_speeds.max(initial=0.0)),
        period=None if head is None else _periodicity(head, clip.fps),
        mouth=_fraction_moving(clip),
        gaze=_fraction_averted(clip),
    )


def _count_drops(below: FloatArray, other_below: FloatArray) -> int:
    """Counts the times that a hand comes to hang after having been raised, while the other hand is raised."""
    n_drops, was_raised = 0, False
    for distance, other in zip(below, other_below, strict=True):
        if distance < LIMITS.raised:
            was_raised = True
        elif distance > LIMITS.hanging:
            n_drops += was_raised and other < LIMITS.raised
            was_raised = False
    return n_drops


def _distances_in_front(motion: Arms) -> FloatArray:
    """Returns how far each wrist is in front of the shoulders (T, 2), arm lengths."""
    lateral = motion.shoulders[:, 0] - motion.shoulders[:, 1]  # (T, 3), to the left
    forward = np.cross(lateral, motion.up)
    forward /= np.maximum(np.linalg.norm(forward, axis=-1, keepdims=True), 1e-9)
    offsets = motion.wrists - motion.shoulders.mean(axis=1, keepdims=True)
    return np.asarray(np.einsum("tkc,tc->tk", offsets, forward) / motion.length)


def _relative_rotations(clip: Clip, role: str, parents: Sequence[str]) -> FloatArray | None:
    """Returns the rotations (T, 4) of a role's joint relative to the first of the parent roles that the rig has."""
    joints = rig_info(clip.skeleton).roles.joints
    parent = next((joints[name] for name in parents if name in joints), None)
    if role not in joints or parent is None:
        return None
    rotations, _ = kinematics.forward(clip, [joints[role], parent])
    quats = rotation.from_matrix(rotations)  # (T, 2, 4)
    return rotation.multiply(rotation.inverse(quats[:, 1]), quats[:, 0])


def _relative_chest(clip: Clip) -> FloatArray | None:
    joints = rig_info(clip.skeleton).roles.joints
    role = next((name for name in _CHEST if name in joints), None)
    return None if role is None else _relative_rotations(clip, role, ("hips",))


def _angular_speeds(quats: FloatArray, fps: float) -> FloatArray:
    """Returns the angular speed between frames (T - 1,), degrees/s."""
    steps = rotation.multiply(rotation.inverse(quats[:-1]), quats[1:])
    return np.asarray(np.rad2deg(np.linalg.norm(rotation.log(steps), axis=-1)) * fps)


def _angles(quats: FloatArray) -> FloatArray:
    """Returns rotation vectors (T, 3) from the mean rotation, degrees."""
    signs = np.where(quats @ quats[0] < 0.0, -1.0, 1.0)[:, None]
    mean = (quats * signs).mean(axis=0)
    mean /= np.linalg.norm(mean)
    return np.asarray(np.rad2deg(rotation.log(rotation.multiply(rotation.inverse(mean[None]), quats))))


def _spread(quats: FloatArray, fps: float) -> float:
    """Returns the rms angle from the mean, the mean over windows of equal length, degrees."""
    n_windows = max(1, round(len(quats) / (LIMITS.window_s * fps)))
    windows = np.array_split(quats, n_windows)
    return float(np.mean([np.sqrt(np.square(_angles(window)).sum(axis=-1).mean()) for window in windows]))


def _periodicity(quats: FloatArray, fps: float) -> float | None:
    """Returns the highest autocorrelation of the angles at lags of a second to half the clip; None for short clips."""
    first, last = round(LIMITS.lag_s * fps), len(quats) // 2
    if last <= first:
        return None
    angles = _angles(quats)
    angles -= angles.mean(axis=0)
    power = np.square(angles).sum()
    if power < 1e-9:
        return None
    n = len(angles)
    scores = [(angles[:-lag] * angles[lag:]).sum() / power * n / (n - lag) for lag in range(first, last)]
    return float(max(scores))


def _fraction_moving(clip: Clip) -> float:
    """Returns the fraction of frames in which the mouth moves."""
    if clip.face is None or len(clip) < 2:
        return 0.0
    columns = [k for k, name in enumerate(clip.face.channels) if name.startswith(_MOUTH)]
    speeds = np.abs(np.diff(clip.face.weights[:, columns], axis=0)).max(axis=1, initial=0.0) * clip.fps
    return float(np.mean(speeds > LIMITS.mouth_speed))


def _fraction_averted(clip: Clip) -> float:
    """Returns the fraction of frames in which the eyes do not look straight ahead."""
    if clip.face is None:
        return 0.0
    columns = [k for k, name in enumerate(clip.face.channels) if name.startswith("eyeLook")]
    return float(np.mean(clip.face.weights[:, columns].max(axis=1, initial=0.0) > LIMITS.gaze))


def measure_sentence(words: Sequence[Word], options: SpliceOptions) -> PersonMotion:
    """Joins words of one rig and rate, and measures the sentence with the durations of its seams."""
    result: SpliceResult = splice(words, options)
    with_idle: list[float] = []
    others: list[float] = []
    owned = [owned_channels(word.clip) if word.owns is None else word.owns for word in words]
    arms_of = [channels & {*CHANNELS[:2]} for channels in owned]
    for before, after, seam in zip(arms_of[:-1], arms_of[1:], result.seams, strict=True):
        (others if before == after else with_idle).append(seam.seconds)
    person = measure_person(result.clip)
    head = _relative_rotations(result.clip, "head", _CHEST)
    gaps = [span.output for span in result.spans if span.kind == "transition"]
    peaks = [
        _angular_speeds(head[max(0, start - 1) : stop + 1], result.clip.fps).max()
        for (start, stop), before, after in zip(gaps, owned[:-1], owned[1:], strict=True)
        if head is not None and "head" not in before | after
    ]
    return PersonMotion(
        **{
            **vars(person),
            "head_peak": float(max(peaks)) if peaks else None,
            "idle_seam_s": float(np.mean(with_idle)) if with_idle else None,
            "other_seam_s": float(np.mean(others)) if others else None,
        }
    )


def _rate(field: str) -> Callable[[Sequence[PersonMotion]], float]:
    return lambda people: sum(getattr(person, field) for person in people) / sum(person.minutes for person in people)


def _hanging_fraction(people: Sequence[PersonMotion]) -> float | None:
    n_idle = sum(person.idle for person in people)
    return sum(person.hanging for person in people) / n_idle if n_idle else None


MEASURES = (
    Measure("motion", "motion"),
    Measure("tempo", "tempo"),
    Measure("drops", "drops a minute", "{:.1f}", function=_rate("drops")),
    percent("hanging", "idle hands that hang", 0, _hanging_fraction),
    Measure("below", "else below the shoulders, arms", "{:.2f}", function=aggregate("below", np.median)),
    Measure("in_front", "in front, arms", "{:.2f}", function=aggregate("in_front", np.median)),
    Measure("head_spread", "head, degrees rms", "{:.1f}", function=aggregate("head_spread", np.mean)),
    Measure("head_speed", "degrees/s", "{:.1f}", function=aggregate("head_speed", np.median)),
    Measure("head_peak", "fastest", "{:.0f}", function=aggregate("head_peak", np.max)),
    Measure("period", "autocorrelation", "{:.2f}", function=aggregate("period", np.mean)),
    Measure("chest_spread", "chest, degrees rms", "{:.1f}", function=aggregate("chest_spread", np.mean)),
    percent("mouth", "mouth moves", 0, aggregate("mouth", np.mean)),
    percent("gaze", "eyes averted", 0, aggregate("gaze", np.mean)),
    Measure("idle_seam_s", "seam with an idle hand, s", "{:.2f}", function=aggregate("idle_seam_s", np.mean)),
    Measure("other_seam_s", "other seams, s", "{:.2f}", function=aggregate("other_seam_s", np.mean)),
)
"""Measures of sentences, or of clips: drops a minute; idle hands; rotations; the face; durations of seams."""


def draw_sentences(n_sentences: int) -> dict[str, list[list[Word]]]:
    """Returns sentences of ``tempo.LENGTH`` words: words that ship; those redrawn between keys, and with the noise of
    captures; and words of a signer who rests with folded hands. Redrawn words own what they move, others what their
    notation moves. Raises ``InputError`` for too many.
    """
    lexicons = make_lexicons(n_sentences * LENGTH)
    rng = stream("person", n_sentences)
    (noisy,) = (name for name in lexicons if name.startswith("noise"))
    words = {
        name: [Word(word.clip, owns=owned_by_sign(word.sign, word.signer)) for word in lexicons[lexicon]]
        for name, lexicon in (
            ("words that ship", "words that ship"),
            ("with noise", noisy),
            ("folded rest", "signer 202, folded"),
        )
    }
    shipped = [word.clip for word in words["words that ship"]]
    words["redrawn between keys"] = [Word(rekey_clip(clip, 6, "blender", rng)) for clip in shipped]
    return {name: [given[k : k + LENGTH] for k in range(0, len(given), LENGTH)] for name, given in words.items()}


def compare(n_sentences: int, tempos: Sequence[str], progress: Progress | None = None) -> list[Row]:
    """Returns one row for each kind of words and tempo."""
    if n_sentences < 1:
        raise InputError(f"{n_sentences} sentences of each kind, expected at least 1")
    sentences = draw_sentences(n_sentences)
    jobs = [(name, tempo, words) for name, lines in sentences.items() for tempo in tempos for words in lines]
    measured: dict[tuple[str, str], list[PersonMotion]] = {}
    for name, tempo, words in track_progress(jobs, progress):
        person = measure_sentence(words, SpliceOptions(tempo=tempo, face_rules=RULES))
        measured.setdefault((name, tempo), []).append(person)
    return [make_row(MEASURES, people, motion=name, tempo=tempo) for (name, tempo), people in measured.items()]


def measure_clips(clips: Sequence[Clip], progress: Progress | None = None) -> list[Row]:
    """Returns one row for each clip of signing, such as a capture."""
    return [
        make_row(MEASURES, [measure_person(clip)], motion=clip.name, tempo="-")
        for clip in track_progress(clips, progress)
    ]


SIGNATURE = (
    f"person|sentences:{LENGTH}-words,drawn:once|idle:under-{LIMITS.idle_speed:g}-while-over-{LIMITS.signing_speed:g}"
    f"-arms/s|hang:{LIMITS.hanging:g}-arms-below-shoulders|drop:from-{LIMITS.raised:g}|rms:{LIMITS.window_s:g}s-windows"
    f"|autocorrelation:from-{LIMITS.lag_s:g}s|mouth:{LIMITS.mouth_speed:g}/s|gaze:{LIMITS.gaze:g}"
)


def table(rows: Sequence[Row]) -> list[str]:
    """Returns the rows as Markdown, with their signature."""
    return [f"`{SIGNATURE}`", "", *format_measures(MEASURES, rows)]
