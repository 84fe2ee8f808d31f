"""Hands in touch: how far a part of a hand is from the skin that it is written at, and hands that stay there while they
move.

All positions are in the chest's axes of a right-handed signer, cm, with trunk and head at rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from signsplice.body.capsules import BodyCapsules
from signsplice.body.collision import PosedCapsules
from signsplice.motion.arrays import FloatArray
from signsplice.signer import hand, pose
from signsplice.signer.avoidance import between_hands, hand_clearances
from signsplice.signer.figure import ARMS, Figure, Frames, PosedArms
from signsplice.signer.hand_parts import hand_part
from signsplice.signer.phonology import ON_ARM, Posture, on_arm, on_base
from signsplice.signer.signer import JOINTS, Signer

_NEAR_CM = 1.0


@dataclass(frozen=True, eq=False)
class PosedSigner:
    """A right-handed signer in T states.

    states: (T, 65).
    rotations, positions: (T, J, 3, 3) and (T, J, 3) of the joints but fingers, in the chest's axes.
    arms: both arms.
    """

    signer: Signer
    states: FloatArray
    rotations: FloatArray
    positions: FloatArray
    arms: PosedArms

    @property
    def capsules(self) -> PosedCapsules:
        """The capsules of the body."""
        return self.arms.capsules

    def distance(self, posture: Posture, frame: int) -> tuple[float, FloatArray]:
        """From the skin of the part of the strong hand that a posture names to that of the body where it is written,
        cm, and the unit vector (3,) from there to the part, in the chest's axes.
        """
        rows = surface(posture.location, self.capsules.body, 0)
        gaps, out = self.nearest(self.part(posture, frame, 0), frame, rows)
        site = hand_part(posture.part).skin * self.signer.hands * self.signer.scale
        return float(gaps[0]) - site, out[0] @ self.rotations[frame, JOINTS["Spine2"]]

    def part(self, posture: Posture, frame: int, which: int) -> FloatArray:
        """The middle (1, 3) of the part of the strong (0) or the weak hand (1) that a posture names."""
        unit, wrist = self.signer.hands * self.signer.scale, JOINTS["LeftHand" if which else "RightHand"]
        fingers = pose.hands(self.states[frame])[which, pose.FINGERS]
        part = hand_part(posture.part).centre(hand.points(fingers)) * unit * ([-1.0, 1.0, 1.0] if which else 1.0)
        return np.asarray(self.positions[frame, wrist] + self.rotations[frame, wrist] @ part)[None]

    def nearest(self, points: FloatArray, frame: int, rows: Sequence[int]) -> tuple[FloatArray, FloatArray]:
        """Distances (N,) of points (N, 3) from the skin of some capsules, and unit vectors (N, 3) away from it."""
        starts, radii = self.capsules.starts[frame, rows], self.capsules.body.radii[list(rows)]
        span = self.capsules.ends[frame, rows] - starts
        apart = points[:, None] - starts
        along = np.clip((apart * span).sum(axis=-1) / ((span * span).sum(axis=-1) + 1e-12), 0.0, 1.0)
        out = apart - along[..., None] * span
        lengths = np.linalg.norm(out, axis=-1)
        gaps = lengths - radii[:, 0] - along * (radii[:, 1] - radii[:, 0])
        n, each = gaps.argmin(axis=1), np.arange(len(points))
        return gaps[each, n], out[each, n] / np.maximum(lengths[each, n], 1e-9)[:, None]


def posed_signer(states: FloatArray, signer: Signer) -> PosedSigner:
    """A signer, as if right-handed, in states (T, 65)."""
    return posed_figure(Figure(states, signer), states)


def posed_figure(
    figure: Figure, states: FloatArray, at: Frames = slice(None), arms: tuple[pose.Arm, pose.Wrist] | None = None
) -> PosedSigner:
    """A figure's signer in states (F, 65), those of the figure ``at`` some frames but for their ``arms``, which are
    those of the states or others (``Figure.posed``).
    """
    posed = figure.posed(states, at, arms)
    rotations, positions = figure.rotations[at].copy(), figure.positions[at].copy()
    rotations[:, ARMS], positions[:, ARMS] = posed.rotations, posed.positions
    return PosedSigner(figure.signer, states, rotations, positions, posed)


def surface(location: str, body: BodyCapsules, which: int) -> Sequence[int]:
    """The capsules of the part of the body at which the strong (0) or the weak hand (1) is, by its location."""
    groups = body.groups
    if location in ON_ARM:
        return groups.right_arm if which else groups.left_arm
    return (groups.right if which else groups.left) if on_base(location) else (*groups.head, *groups.trunk)


def into_touch(state: FloatArray, posture: Posture, hands: str, signer: Signer) -> FloatArray:
    """Displacements (2, 3) of the strong and the weak hand of a state (65,) that bring the skin of the strong one to
    that at which a posture is written; of hands that mirror one another both: to the body, or before it on the midline,
    to one another.
    """
    moves = np.zeros((2, 3))
    meets = hands in ("symmetric", "alternating")
    if meets and posture.location.endswith("-mid"):
        moves[:, 0] = 0.5 * min(float(between_hands(state[None], signer)[0]), _NEAR_CM)  # hands apart do not cross
        return moves
    turned = np.concatenate([state[27:54], state[:27], state[54:]])  # the weak hand in the strong one's place
    for which, one in enumerate((state, turned) if meets else (state,)):
        _, out = posed_signer(one[None], signer).distance(posture, 0)
        gap = hand_clearances(one[None], signer)[0, 2 if on_arm(posture.location) else 0]
        moves[which] = (max(posture.off, 0.0) * signer.scale - gap) * out
    return moves
