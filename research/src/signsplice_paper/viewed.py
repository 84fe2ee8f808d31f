"""The errors that a viewer sees first: joints that jump, and fingers that change their length.

None of it is in the paper's metrics, whose numbers are joint positions without bones. Joints jump in a prediction that
follows the directions of its bones (``rotations_from_positions``); with bones kept, as in a splice, hands are fitted to
the words (``clip_of_numbers``). Methods on clips have their rotations already.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from signsplice.motion import Clip, FloatArray, rotation
from signsplice.rig.info import rig_info
from signsplice.splicing.from_positions import rotations_from_positions
from signsplice_paper.prediction import Prediction
from signsplice_paper.systems.clips import clip_of_numbers
from signsplice_workshop.corpora.pairs import Pairs
from signsplice_workshop.measure import motion_scores

JUMP_DEG = 60.0
"""A larger rotation of a joint from one frame to the next is a jump."""
N_VIEWED = 200
"""Largest number of pairs of a part whose frames are put onto a skeleton, by far the slowest step."""

SIGNATURES = {
    "joint_jumps": f"joint-jumps|pairs:{N_VIEWED}|over:{JUMP_DEG:g}deg/frame|frames:P_pre,O,Q_post|share-of:predicted",
    "bone_change": f"bone-change|pairs:{N_VIEWED}|bones:fingers|abs(length/true-1)|mean:frames,bones,pairs",
}


@dataclass(frozen=True)
class PairView:
    """The visible errors of one pair; NaN if there are no frames.

    - jumps: 1 if a joint jumps, 0 if none does
    - bone_change: mean relative error of the length of finger bones
    """

    jumps: float
    bone_change: float


class Viewer:
    """Measures the visible errors of predictions for the pairs of a corpus."""

    def __init__(self, pairs: Pairs) -> None:
        self.pairs = pairs
        self._joints: dict[int, tuple[list[int], list[tuple[int, int]]]] = {}
        self._clips: dict[int, Clip] = {}

    def view(self, number: int, prediction: Prediction) -> PairView:
        """Returns the visible errors of the prediction for a pair."""
        if not len(prediction.frames):
            return PairView(float("nan"), float("nan"))
        p, q = self.pairs.index[number, :2].tolist()
        word = np.asarray(self.pairs.word(p), np.float64)
        change = self._measure_bone_change(prediction.frames, word[:1], self._find_joints_and_finger_bones(p)[1])
        return PairView(self._measure_jumps(p, q, prediction), change)

    def fit_bones(self, number: int, prediction: Prediction) -> Prediction:
        """Returns the prediction for a pair on the skeleton of its words, as a splice makes it; unchanged without
        frames, or if a position is missing.
        """
        if prediction.pre is None or prediction.post is None or not len(prediction.frames):
            return prediction
        p, q = self.pairs.index[number, :2].tolist()
        space = self.pairs.space(p)
        before, after = self._load_clip(p)[: prediction.pre + 1], self._load_clip(q)[prediction.post :]
        clip = clip_of_numbers(space, prediction.frames, before, after)
        return replace(prediction, frames=space.to_numbers(clip), rotations=clip.local_rotations)

    def _load_clip(self, word: int) -> Clip:
        if word not in self._clips:
            self._clips[word] = self.pairs.word_clip(word)
        return self._clips[word]

    def _measure_bone_change(self, frames: FloatArray, true: FloatArray, bones: Sequence[tuple[int, int]]) -> float:
        """Returns the mean relative error of the bones' lengths in frames (n, K), against those of one true frame (1,
        K).
        """
        if not bones:
            return float("nan")
        ends = np.array(bones)
        lengths, true_lengths = (
            np.linalg.norm(joints[:, ends[:, 1]] - joints[:, ends[:, 0]], axis=-1)
            for joints in (_split_joints(frames), _split_joints(true))
        )
        return float(np.abs(lengths / true_lengths - 1.0).mean())

    def _measure_jumps(self, p: int, q: int, prediction: Prediction) -> float:
        if prediction.pre is None or prediction.post is None:
            return float("nan")
        first = self.pairs.word(p, "rotations")[prediction.pre].astype(np.float64)
        last = self.pairs.word(q, "rotations")[prediction.post].astype(np.float64)
        rotations = prediction.rotations
        if rotations is None:
            positions = self.pairs.space(p).to_positions(prediction.frames)  # (n, J, 3)
            skeleton = self.pairs.skeletons[self.pairs.signer(p)]
            rotations = rotations_from_positions(
                skeleton, positions, first, last, self._find_joints_and_finger_bones(p)[0]
            )
        sequence = np.concatenate([first[None], rotations, last[None]])
        angles = np.rad2deg(rotation.angle_between(sequence[:-1], sequence[1:]))
        return float(bool((angles > JUMP_DEG).any()))

    def _find_joints_and_finger_bones(self, word: int) -> tuple[list[int], list[tuple[int, int]]]:
        """Returns the skeleton's joints that the numbers hold, and the bones of fingers by their places among these."""
        signer = self.pairs.signer(word)
        if signer not in self._joints:
            skeleton, name = self.pairs.skeletons[signer], self.pairs.gloss(word)
            joints = list(self.pairs.spaces[signer].find_joints(skeleton, name))
            order = {joint: k for k, joint in enumerate(joints)}
            roles = rig_info(skeleton).roles.joints
            hands = {roles[role] for role in ("leftHand", "rightHand") if role in roles}
            fingers = set(motion_scores.arm_and_finger_joints(self.pairs.word_clip(word))) - hands
            fingers -= {roles[role] for role in ("leftLowerArm", "rightLowerArm") if role in roles}
            bones = [(skeleton.parents[joint], joint) for joint in fingers if skeleton.parents[joint] in fingers]
            self._joints[signer] = joints, [(order[a], order[b]) for a, b in bones if a in order and b in order]
        return self._joints[signer]


def _split_joints(frames: FloatArray) -> FloatArray:
    return np.asarray(frames, np.float64).reshape(len(frames), -1, 3)


def summarise(views: Sequence[PairView]) -> dict[str, float]:
    """Returns the scores of ``SIGNATURES`` over some pairs."""
    return {
        "joint_jumps": _compute_mean([view.jumps for view in views]),
        "bone_change": _compute_mean([view.bone_change for view in views]),
    }


def _compute_mean(values: Sequence[float]) -> float:
    known = [value for value in values if not np.isnan(value)]
    return float(np.mean(known)) if known else float("nan")
