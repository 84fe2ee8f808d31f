"""Checks a written sign against a signer's body: places out of reach, contorted wrists, and touches that miss the skin.
Each problem is a line for the author of the sign.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from signsplice.motion import FloatArray
from signsplice.signer import locations, pose
from signsplice.signer.figure import ARMS, PosedSigner, pose_signer
from signsplice.signer.locations import WeakArm
from signsplice.signer.phonology import Posture
from signsplice.signer.planner import IsolatedWord
from signsplice.signer.signer import JOINTS

CONTORTED_DEG = 75.0
"""A wrist that bends farther than this in any direction hurts: the joint's limits are 72 to 82 degrees."""
OFF_CM = 1.0
"""Distance from the written place at which a viewer notices the difference, cm."""
_MEANT_CM = 0.5
"""Written distance from the skin below which a posture is a touch, cm."""
_HAND_NAMES = ("strong", "weak")


@dataclass(frozen=True, eq=False)
class _Body:
    """A word of a right-handed signer.

    word: the word.
    posed: its signer.
    wrists: (T, 2, 3) actual wrists, strong first, in the chest's axes, cm; the weak one mirrored as its state is.
    shoulders: (T, 2, 3) likewise.
    bends: (T, 2) angles between forearms and hands, degrees.
    """

    word: IsolatedWord
    posed: PosedSigner
    wrists: FloatArray
    shoulders: FloatArray
    bends: FloatArray


def warnings(word: IsolatedWord) -> list[str]:
    """A line, with the gloss, for each kind of deviation from the sign, for its worst segment."""
    body = _pose_word(word)
    worst = (max(check(body), default=None) for check in (_out_of_reach, _find_contorted_wrists, _off_the_skin))
    return [f"{word.sign.gloss}: {line[1]}" for line in worst if line is not None]


def _pose_word(word: IsolatedWord) -> _Body:
    posed = pose_signer(word.states, word.signer)
    rotations, positions = posed.rotations, posed.positions
    chest = rotations[:, JOINTS["Spine2"]]
    seen = np.einsum("tba,tkb->tka", chest, positions)  # (T, J, 3)
    _, arms, forearms, hands = ARMS.T
    bone_axes = np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])  # the bones of the right arm and of the left one
    bones = [np.einsum("tkab,kb->tka", rotations[:, joints], bone_axes) for joints in (hands, forearms)]
    cosines = np.clip((bones[0] * bones[1]).sum(axis=-1), -1.0, 1.0)
    wrists, shoulders = seen[:, hands] * pose.MIRRORS, seen[:, arms] * pose.MIRRORS
    return _Body(word, posed, wrists, shoulders, np.rad2deg(np.arccos(cosines)))


def _sides(word: IsolatedWord) -> tuple[int, ...]:
    return (0, 1) if word.sign.two_handed else (0,)


def _segment_label(body: _Body, n: int) -> str:
    return f"segment {n + 1} ({body.word.segments[n].segment.kind})"


def _out_of_reach(body: _Body) -> Iterator[tuple[float, str]]:
    """Yields postures whose wrist the arm cannot bring to its place, with the distance from that place, cm."""
    meant_wrists = pose.hands(body.word.states)[..., pose.WRIST]
    for n, timed in enumerate(body.word.segments):
        for side in _sides(body.word):
            actual, meant = body.wrists[timed.end, side], meant_wrists[timed.end, side]
            miss = float(np.linalg.norm(actual - meant))
            posture = timed.segment.weak if side and timed.segment.weak else timed.segment.strong
            if miss > OFF_CM:
                actual, meant = (np.linalg.norm(place - body.shoulders[timed.end, side]) for place in (actual, meant))
                why = "its arm bends no farther" if meant < actual else "its arm is too short"
                where = f"at={posture.location} is out of reach in {_segment_label(body, n)}"
                yield miss, f"{where}: the {_HAND_NAMES[side]} hand stays {miss:.1f} cm away, {why}"


def _find_contorted_wrists(body: _Body) -> Iterator[tuple[float, str]]:
    """Yields wrists that bend too far, with the angle, degrees."""
    for n, timed in enumerate(body.word.segments):
        for side in _sides(body.word):
            bend = float(body.bends[timed.begin : timed.end + 1, side].max())
            if bend > CONTORTED_DEG:
                line = (
                    f"the {_HAND_NAMES[side]} wrist is contorted in {_segment_label(body, n)}: it bends by {bend:.0f}"
                )
                yield bend, f"{line} degrees, expected at most {CONTORTED_DEG:.0f}; turn palm= or fingers="


def _off_the_skin(body: _Body) -> Iterator[tuple[float, str]]:
    """Yields written touches at whose end the part of the strong hand is off the skin, with the distance, cm."""
    for n, timed in enumerate(body.word.segments):
        posture = timed.segment.strong
        meant = _meant(posture, body, timed.end)
        if meant is None or meant >= _MEANT_CM:
            continue
        frames = range(max(0, timed.end - 1), min(timed.end + 2, len(body.word)))
        miss = min(body.posed.distance(posture, frame)[0] for frame in frames) - max(meant, 0.0)
        if miss > OFF_CM:
            line = f"by={posture.part} misses at={posture.location} by {miss:.1f} cm in {_segment_label(body, n)}"
            yield miss, f"{line}, where it is written to touch"


def _meant(posture: Posture, body: _Body, frame: int) -> float | None:
    """Written distance of a posture from the skin, cm; None in space."""
    weak = WeakArm(replace(body.word.signer, left_handed=False), body.word.states[frame, 27:54])
    normal = locations.locate(posture.location, weak).normal
    return posture.off + float(locations.axes(posture.shift) @ normal) if normal.any() else None
