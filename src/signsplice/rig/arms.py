"""The two arms of a clip over time: what splice points, durations and seam scores are told from."""

from __future__ import annotations

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from signsplice.errors import InputError
from signsplice.motion import kinematics
from signsplice.motion.clip import Clip, Skeleton
from signsplice.rig import proportions
from signsplice.rig.roles import find_roles

Float = NDArray[np.float64]

SIDES = ("left", "right")
_ROLES = ("UpperArm", "LowerArm", "Hand")
_RAISED_FRACTION = 0.4
"""An arm has left its rest when it has risen this share of the way from rest to its highest; less than half, so that a
sign that begins low and ends high keeps its beginning.
"""
_NO_REST_LIFT = 0.1
"""A clip whose arms rise by less than this share of an arm's length has no rest to trim."""


@dataclass(frozen=True, eq=False)
class Arms:
    """Shoulders, elbows and wrists (T, 2, 3), left then right, in clip units; hand rotations (T, 2, 3, 3), global.

    up: (3,) the world's vertical. length: shoulder to wrist. shoulder_width: between the shoulder joints. metres: of
    one unit.
    """

    shoulders: Float
    elbows: Float
    wrists: Float
    hand_rotations: Float
    up: Float
    length: float
    shoulder_width: float
    metres: float
    fps: float

    @property
    def lift(self) -> Float:
        """How high each wrist is (T, 2): 0 where the arm hangs straight down, 1 at shoulder height."""
        return np.asarray(1.0 + (self.wrists - self.shoulders) @ self.up / self.length)


_KNOWN: WeakKeyDictionary[Clip, Arms] = WeakKeyDictionary()


def arms(clip: Clip) -> Arms:
    """The arms of a clip, remembered as long as the clip lives: a word has two seams, and each asks for its cut and its
    duration.

    Raises ``InputError`` where the rig's arms are not known by name.
    """
    found = _KNOWN.get(clip)
    if found is None:
        found = _KNOWN[clip] = _arms(clip)
    return found


def _arms(clip: Clip) -> Arms:
    joints = arm_joints(clip.skeleton)
    rotations, positions = kinematics.forward(clip, joints)
    shoulders, elbows, wrists = (positions[:, n : n + 4 : 3] for n in range(3))
    body = proportions.sizes(clip.skeleton)
    trunk = shoulders.mean(axis=(0, 1)) - positions[:, 6].mean(axis=0)
    axis = int(np.argmax(np.abs(trunk)))
    up = np.zeros(3)
    up[axis] = np.sign(trunk[axis]) or 1.0
    return Arms(
        shoulders=shoulders,
        elbows=elbows,
        wrists=wrists,
        hand_rotations=rotations[:, 2:6:3],
        up=up,
        length=body.arm_length,
        shoulder_width=body.shoulder_width,
        metres=body.unit.metres,
        fps=clip.fps,
    )


def arm_joints(skeleton: Skeleton) -> list[int]:
    """Indices of left then right upper arm, lower arm and hand, then the hips."""
    joints = find_roles(skeleton).joints
    names = [side + part for side in SIDES for part in _ROLES]
    missing = [name for name in names if name not in joints]
    if missing:
        raise InputError(
            f"no {' or '.join(missing[:2])} found among joints {', '.join(skeleton.names[:4])}, ...; "
            "expected both arms by name; name them with a roles file, or use a cutter that needs no arms (ends)"
        )
    return [*(joints[name] for name in names), joints.get("hips", 0)]


def has_arms(skeleton: Skeleton) -> bool:
    """Whether both arms are known by name."""
    try:
        arm_joints(skeleton)
    except InputError:
        return False
    return True


def active_span(arms: Arms) -> tuple[int, int]:
    """Frames [start, stop) between the arms' leaving rest and their reaching it again; the whole clip where there is no
    rest.

    A clip rests at an end where both wrists are below their elbows there. From it, the span begins with the first frame
    (ends with the last) at which the higher hand has risen 40 % of the way from rest to the highest it comes.
    """
    return span_between_rests(arms.lift, (arms.elbows - arms.shoulders) @ arms.up / arms.length + 1.0)


def span_between_rests(wrists: Float, elbows: Float) -> tuple[int, int]:
    """``active_span`` by the heights (T, 2) of both wrists and elbows, arm lengths."""
    reach = wrists.max(axis=1)
    peak = float(reach.max())
    below = np.all(wrists < elbows, axis=1)
    start, stop = 0, len(reach)
    if below[0] and peak - reach[0] > _NO_REST_LIFT:
        start = int(np.argmax(reach >= reach[0] + _RAISED_FRACTION * (peak - reach[0])))
    if below[-1] and peak - reach[-1] > _NO_REST_LIFT:
        stop -= int(np.argmax(reach[::-1] >= reach[-1] + _RAISED_FRACTION * (peak - reach[-1])))
    return start, stop
