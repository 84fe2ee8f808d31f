"""What a viewer sees first: joints that jump, fingers that change their length, and velocity where two words differ.

None of it is in the paper's metrics, whose numbers are joint positions without bones. Each prediction is put back onto
the skeleton as a splice does it (``systems.from_positions``); methods on clips have their rotations already.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from signsplice.motion import FloatArray, rotation
from signsplice.rig.info import rig_info
from signsplice_paper.extra_metrics import NumberLayout, velocity_error
from signsplice_paper.prediction import Prediction
from signsplice_paper.systems.from_positions import rotations_from_positions
from signsplice_workshop.corpora.pairs import Pairs
from signsplice_workshop.measure import motion_scores

JUMP_DEG = 60.0
"""A larger rotation of a joint from one frame to the next is a jump."""
UNLIKE = 0.75
"""Quantile of the distance between the true cut frames from which on two words are unlike."""

SIGNATURES = {
    "joint_jumps": f"joint-jumps|over:{JUMP_DEG:g}deg/frame|frames:P_pre,O,Q_post|share-of:predicted",
    "bone_change": "bone-change|bones:fingers|abs(length/true-1)|mean:frames,bones,pairs",
    "velocity_error_unlike": f"velocity-error|pairs:cut-frames-apart-from-quantile-{UNLIKE:g}|as-velocity_error",
}


@dataclass(frozen=True)
class PairView:
    """What is seen of one pair; NaN where there is nothing to see.

    - jumps: 1 if a joint jumps, 0 if none does
    - bone_change: mean relative error of the length of finger bones
    - velocity_error: m/s
    - apart: mean distance of arm and finger joints between the true cut frames, in the numbers' unit
    """

    jumps: float
    bone_change: float
    velocity_error: float
    apart: float


class Viewer:
    """Looks at predictions for the pairs of a corpus."""

    def __init__(self, pairs: Pairs) -> None:
        self.pairs = pairs
        self._joints: dict[int, tuple[list[int], list[tuple[int, int]]]] = {}

    def view(self, number: int, prediction: Prediction, layout: NumberLayout) -> PairView:
        """What is seen of the prediction for a pair."""
        p, q = self.pairs.index[number, :2].tolist()
        pre, post, true = self.pairs.truth(number)
        frames, nan = prediction.frames, float("nan")
        arms = list(layout.arms)
        ends = [_joints_of(self.pairs.word(word)[[at]])[0, arms] for word, at in ((p, pre), (q, post))]
        apart = float(np.linalg.norm(ends[1] - ends[0], axis=-1).mean())
        if not len(frames):
            return PairView(nan, nan, nan, apart)
        word = np.asarray(self.pairs.word(p), np.float64)
        change = self._bone_change(frames, word[:1], self._seen(p)[1])
        error = velocity_error(frames, np.asarray(true, np.float64), layout)
        return PairView(self._jumps(p, q, prediction), change, error, apart)

    def _bone_change(self, frames: FloatArray, true: FloatArray, bones: Sequence[tuple[int, int]]) -> float:
        """The mean relative error of the bones' lengths in frames (n, K), beside those of one true frame (1, K)."""
        if not bones:
            return float("nan")
        ends = np.array(bones)
        made, wanted = (
            np.linalg.norm(joints[:, ends[:, 1]] - joints[:, ends[:, 0]], axis=-1)
            for joints in (_joints_of(frames), _joints_of(true))
        )
        return float(np.abs(made / wanted - 1.0).mean())

    def _jumps(self, p: int, q: int, prediction: Prediction) -> float:
        if prediction.pre is None or prediction.post is None:
            return float("nan")
        first = self.pairs.word(p, "rotations")[prediction.pre].astype(np.float64)
        last = self.pairs.word(q, "rotations")[prediction.post].astype(np.float64)
        made = prediction.rotations
        if made is None:
            positions = self.pairs.space(p).positions(prediction.frames)  # (n, J, 3)
            skeleton = self.pairs.skeletons[self.pairs.signer(p)]
            made = rotations_from_positions(skeleton, positions, first, last, self._seen(p)[0])
        shown = np.concatenate([first[None], made, last[None]])
        turned = np.rad2deg(rotation.angle_between(shown[:-1], shown[1:]))
        return float(bool((turned > JUMP_DEG).any()))

    def _seen(self, word: int) -> tuple[list[int], list[tuple[int, int]]]:
        """The skeleton's joints that the numbers hold, and the bones of fingers by their places among these."""
        signer = self.pairs.signer(word)
        if signer not in self._joints:
            skeleton, name = self.pairs.skeletons[signer], self.pairs.gloss(word)
            joints = list(self.pairs.spaces[signer].indices(skeleton, name))
            place = {joint: k for k, joint in enumerate(joints)}
            roles = rig_info(skeleton).roles.joints
            hands = {roles[role] for role in ("leftHand", "rightHand") if role in roles}
            fingers = set(motion_scores.arm_and_finger_joints(self.pairs.word_clip(word))) - hands
            fingers -= {roles[role] for role in ("leftLowerArm", "rightLowerArm") if role in roles}
            bones = [(skeleton.parents[joint], joint) for joint in fingers if skeleton.parents[joint] in fingers]
            self._joints[signer] = joints, [(place[a], place[b]) for a, b in bones if a in place and b in place]
        return self._joints[signer]


def _joints_of(frames: FloatArray) -> FloatArray:
    return np.asarray(frames, np.float64).reshape(len(frames), -1, 3)


def summary(views: Sequence[PairView]) -> dict[str, float]:
    """The scores of ``SIGNATURES`` over some pairs, and ``n_unlike``, the number of pairs of unlike words."""
    limit = float(np.quantile([view.apart for view in views], UNLIKE)) if views else 0.0
    unlike = [view.velocity_error for view in views if view.apart >= limit]
    return {
        "joint_jumps": _mean([view.jumps for view in views]),
        "bone_change": _mean([view.bone_change for view in views]),
        "velocity_error_unlike": _mean(unlike),
        "n_unlike": float(len(unlike)),
    }


def _mean(values: Sequence[float]) -> float:
    known = [value for value in values if not np.isnan(value)]
    return float(np.mean(known)) if known else float("nan")
