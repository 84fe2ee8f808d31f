"""What a signer's body does not allow of a sign as it is written: places out of reach, contorted wrists, and touches
that miss the skin. Each is a line for who wrote the sign.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from signsplice.body.capsules import BodyCapsules, body_capsules, capsule_ends
from signsplice.motion import kinematics
from signsplice.motion.arrays import FloatArray
from signsplice.synth import hand, locations, pose
from signsplice.synth.locations import MIRROR, PARTS_OF_HAND, WeakArm
from signsplice.synth.phonology import ON_ARM, ON_BASE, Posture
from signsplice.synth.planner import IsolatedWord
from signsplice.synth.rng import stream
from signsplice.synth.segment_plan import SegmentPlan, TimedSegment
from signsplice.synth.signer import JOINTS

CONTORTED_DEG = 75.0
"""A wrist that bends farther than this, any way, hurts: limits of the joint are 72 to 82 degrees."""
OFF_CM = 1.0
"""From here on a hand is seen to be elsewhere than it is written."""
_MEANT_CM = 0.5
"""Distance from the skin up to which a posture is written as a touch."""
_HAND_NAMES = ("strong", "weak")


@dataclass(frozen=True, eq=False)
class _Body:
    """A word as a right-handed signer makes it, all in the chest's axes, cm.

    word: the word.
    timed: its segments in time, frames of the word.
    wrists: (T, 2, 3) the wrists, strong first, as they are; the weak one mirrored as its state is.
    shoulders: (T, 2, 3) likewise.
    bends: (T, 2) angles between forearms and hands, degrees.
    part_frames: (T, 3, 3) and (T, 3): rotation and position of the strong hand.
    capsules: of the body, with where their axes (T, C, 3) start and end.
    """

    word: IsolatedWord
    timed: tuple[TimedSegment, ...]
    wrists: FloatArray
    shoulders: FloatArray
    bends: FloatArray
    part_frames: tuple[FloatArray, FloatArray]
    capsules: tuple[BodyCapsules, FloatArray, FloatArray]


def warnings(word: IsolatedWord) -> list[str]:
    """A line, with the gloss, for each kind of thing that is not as the sign says, of the worst of its segments."""
    body = _posed(word)
    worst = (max(found(body), default=None) for found in (_out_of_reach, _contorted, _off_the_skin))
    return [f"{word.sign.gloss}: {line[1]}" for line in worst if line is not None]


def in_time(word: IsolatedWord) -> tuple[TimedSegment, ...]:
    """The segments of a first take, as ``planner.isolated`` makes it, with [begin, end] frames of the word."""
    rng = stream("take", word.signer.name, word.sign.gloss, 0)
    plan, start = SegmentPlan(word.sign, word.signer, word.clip.fps, rng, 0), word.events.start
    return tuple(
        replace(
            one,
            begin=one.begin + start,
            end=one.end + start,
            passes=tuple((begin + start, stop + start) for begin, stop in one.passes),
        )
        for one in plan.timed
    )


def _posed(word: IsolatedWord) -> _Body:
    signer = replace(word.signer, left_handed=False)
    clip = pose.clip(word.states, signer, word.clip.fps)
    rotations, positions = kinematics.forward(clip)
    chest = rotations[:, JOINTS["Spine2"]]
    seen = np.einsum("tba,tkb->tka", chest, positions - positions[:, JOINTS["Spine2"], None])  # (T, J, 3)
    hands, forearms, arms = ([JOINTS[side + part] for side in ("Right", "Left")] for part in ("Hand", "ForeArm", "Arm"))
    along = np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])  # the bones of the right arm and of the left one
    bones = [np.einsum("tkab,kb->tka", rotations[:, joints], along) for joints in (hands, forearms)]
    cosines = np.clip((bones[0] * bones[1]).sum(axis=-1), -1.0, 1.0)
    wrists, shoulders = seen[:, hands], seen[:, arms]
    wrists[:, 1] *= MIRROR
    shoulders[:, 1] *= MIRROR
    capsules = body_capsules(clip.skeleton)
    ends = capsule_ends(capsules, rotations, positions)
    frames = rotations[:, hands[0]], positions[:, hands[0]]
    return _Body(word, in_time(word), wrists, shoulders, np.rad2deg(np.arccos(cosines)), frames, (capsules, *ends))


def _sides(word: IsolatedWord) -> tuple[int, ...]:
    return (0, 1) if word.sign.two_handed else (0,)


def _named(body: _Body, n: int) -> str:
    return f"segment {n + 1} ({body.timed[n].segment.kind})"


def _out_of_reach(body: _Body) -> Iterator[tuple[float, str]]:
    """Postures whose wrist the arm cannot bring where it is meant to be, with how far it is from there, cm."""
    wanted = pose.hands(body.word.states)[..., pose.WRIST]
    for n, one in enumerate(body.timed):
        for side in _sides(body.word):
            made, meant = body.wrists[one.end, side], wanted[one.end, side]
            miss = float(np.linalg.norm(made - meant))
            posture = one.segment.weak if side and one.segment.weak else one.segment.strong
            if miss > OFF_CM:
                made, meant = (np.linalg.norm(place - body.shoulders[one.end, side]) for place in (made, meant))
                why = "its arm bends no farther" if meant < made else "its arm is too short"
                where = f"at={posture.location} is out of reach in {_named(body, n)}"
                yield miss, f"{where}: the {_HAND_NAMES[side]} hand stays {miss:.1f} cm away, {why}"


def _contorted(body: _Body) -> Iterator[tuple[float, str]]:
    """Wrists that bend too far, with the angle, degrees."""
    for n, one in enumerate(body.timed):
        for side in _sides(body.word):
            bend = float(body.bends[one.begin : one.end + 1, side].max())
            if bend > CONTORTED_DEG:
                line = (
                    f"the {_HAND_NAMES[side]} wrist is contorted in {_named(body, n)}: it bends by {bend:.0f} degrees"
                )
                yield bend, f"{line}, expected at most {CONTORTED_DEG:.0f}; turn palm= or fingers="


def _off_the_skin(body: _Body) -> Iterator[tuple[float, str]]:
    """Touches as written at whose end the part of the strong hand is off the skin, with how far, cm."""
    for n, one in enumerate(body.timed):
        posture = one.segment.strong
        meant = _meant(posture, body, one.end)
        if meant is None or meant >= _MEANT_CM:
            continue
        frames = range(max(0, one.end - 1), min(one.end + 2, len(body.word)))
        miss = min(_distance(posture, body, frame) for frame in frames) - max(meant, 0.0)
        if miss > OFF_CM:
            line = f"by={posture.part} misses at={posture.location} by {miss:.1f} cm in {_named(body, n)}"
            yield miss, f"{line}, where it is written to touch"


def _meant(posture: Posture, body: _Body, frame: int) -> float | None:
    """How far from the skin a posture is written, cm; None in space."""
    weak = WeakArm(replace(body.word.signer, left_handed=False), body.word.states[frame, 27:54])
    normal = locations.locate(posture.location, weak).normal
    return posture.off + float(locations.axes(posture.shift) @ normal) if normal.any() else None


def _distance(posture: Posture, body: _Body, frame: int) -> float:
    """From the skin of a part of the strong hand to that of the part of the body that it is written at, cm."""
    capsules, starts, ends = body.capsules
    names, skin, _ = PARTS_OF_HAND[posture.part]
    unit = body.word.signer.hands * body.word.signer.scale
    rotations, positions = body.part_frames
    part = locations.part_of(hand.points(body.word.states[frame, pose.FINGERS]), names) * unit
    point = positions[frame] + rotations[frame] @ part
    rows = list(_surface(posture.location, capsules))
    start, span = starts[frame, rows], ends[frame, rows] - starts[frame, rows]
    along = np.clip(((point - start) * span).sum(axis=1) / ((span * span).sum(axis=1) + 1e-12), 0.0, 1.0)
    radii = capsules.radii[rows, 0] + along * (capsules.radii[rows, 1] - capsules.radii[rows, 0])
    return float((np.linalg.norm(point - start - along[:, None] * span, axis=1) - radii).min()) - skin * unit


def _surface(location: str, body: BodyCapsules) -> Sequence[int]:
    """The capsules of the part of the body that a location is on."""
    if location in ON_ARM:
        parts = zip(body.parts, body.sides, strict=True)
        return [n for n, (part, side) in enumerate(parts) if side == "left" and part in ("sleeve", "cuff")]
    return body.groups.left if location in ON_BASE else (*body.groups.head, *body.groups.trunk)
