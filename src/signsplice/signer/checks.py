"""What a signer's body does not allow of a sign as it is written: places out of reach, contorted wrists, and touches
that miss the skin. Each is a line for who wrote the sign.
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
"""A wrist that bends farther than this, any way, hurts: limits of the joint are 72 to 82 degrees."""
OFF_CM = 1.0
"""From here on a hand is seen to be elsewhere than it is written."""
_MEANT_CM = 0.5
"""Distance from the skin up to which a posture is written as a touch."""
_HAND_NAMES = ("strong", "weak")


@dataclass(frozen=True, eq=False)
class _Body:
    """A word as a right-handed signer makes it.

    word: the word.
    posed: its signer.
    wrists: (T, 2, 3) the wrists, strong first, as they are, in the chest's axes, cm; the weak one mirrored as its state
        is.
    shoulders: (T, 2, 3) likewise.
    bends: (T, 2) angles between forearms and hands, degrees.
    """

    word: IsolatedWord
    posed: PosedSigner
    wrists: FloatArray
    shoulders: FloatArray
    bends: FloatArray


def warnings(word: IsolatedWord) -> list[str]:
    """A line, with the gloss, for each kind of thing that is not as the sign says, of the worst of its segments."""
    body = _pose_word(word)
    worst = (max(found(body), default=None) for found in (_out_of_reach, _find_contorted_wrists, _off_the_skin))
    return [f"{word.sign.gloss}: {line[1]}" for line in worst if line is not None]


def _pose_word(word: IsolatedWord) -> _Body:
    posed = pose_signer(word.states, word.signer)
    rotations, positions = posed.rotations, posed.positions
    chest = rotations[:, JOINTS["Spine2"]]
    seen = np.einsum("tba,tkb->tka", chest, positions)  # (T, J, 3)
    _, arms, forearms, hands = ARMS.T
    along = np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])  # the bones of the right arm and of the left one
    bones = [np.einsum("tkab,kb->tka", rotations[:, joints], along) for joints in (hands, forearms)]
    cosines = np.clip((bones[0] * bones[1]).sum(axis=-1), -1.0, 1.0)
    wrists, shoulders = seen[:, hands] * pose.MIRRORS, seen[:, arms] * pose.MIRRORS
    return _Body(word, posed, wrists, shoulders, np.rad2deg(np.arccos(cosines)))


def _sides(word: IsolatedWord) -> tuple[int, ...]:
    return (0, 1) if word.sign.two_handed else (0,)


def _segment_label(body: _Body, n: int) -> str:
    return f"segment {n + 1} ({body.word.segments[n].segment.kind})"


def _out_of_reach(body: _Body) -> Iterator[tuple[float, str]]:
    """Postures whose wrist the arm cannot bring where it is meant to be, with how far it is from there, cm."""
    wanted = pose.hands(body.word.states)[..., pose.WRIST]
    for n, one in enumerate(body.word.segments):
        for side in _sides(body.word):
            made, meant = body.wrists[one.end, side], wanted[one.end, side]
            miss = float(np.linalg.norm(made - meant))
            posture = one.segment.weak if side and one.segment.weak else one.segment.strong
            if miss > OFF_CM:
                made, meant = (np.linalg.norm(place - body.shoulders[one.end, side]) for place in (made, meant))
                why = "its arm bends no farther" if meant < made else "its arm is too short"
                where = f"at={posture.location} is out of reach in {_segment_label(body, n)}"
                yield miss, f"{where}: the {_HAND_NAMES[side]} hand stays {miss:.1f} cm away, {why}"


def _find_contorted_wrists(body: _Body) -> Iterator[tuple[float, str]]:
    """Wrists that bend too far, with the angle, degrees."""
    for n, one in enumerate(body.word.segments):
        for side in _sides(body.word):
            bend = float(body.bends[one.begin : one.end + 1, side].max())
            if bend > CONTORTED_DEG:
                line = (
                    f"the {_HAND_NAMES[side]} wrist is contorted in {_segment_label(body, n)}: it bends by {bend:.0f}"
                )
                yield bend, f"{line} degrees, expected at most {CONTORTED_DEG:.0f}; turn palm= or fingers="


def _off_the_skin(body: _Body) -> Iterator[tuple[float, str]]:
    """Touches as written at whose end the part of the strong hand is off the skin, with how far, cm."""
    for n, one in enumerate(body.word.segments):
        posture = one.segment.strong
        meant = _meant(posture, body, one.end)
        if meant is None or meant >= _MEANT_CM:
            continue
        frames = range(max(0, one.end - 1), min(one.end + 2, len(body.word)))
        miss = min(body.posed.distance(posture, frame)[0] for frame in frames) - max(meant, 0.0)
        if miss > OFF_CM:
            line = f"by={posture.part} misses at={posture.location} by {miss:.1f} cm in {_segment_label(body, n)}"
            yield miss, f"{line}, where it is written to touch"


def _meant(posture: Posture, body: _Body, frame: int) -> float | None:
    """How far from the skin a posture is written, cm; None in space."""
    weak = WeakArm(replace(body.word.signer, left_handed=False), body.word.states[frame, 27:54])
    normal = locations.locate(posture.location, weak).normal
    return posture.off + float(locations.axes(posture.shift) @ normal) if normal.any() else None
