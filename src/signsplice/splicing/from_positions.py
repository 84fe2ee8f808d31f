"""Converts joint positions, which the paper's systems predict, to rotations of a skeleton.

Trunk and arms follow the directions of their bones. Finger bones are as short as a network's error, so their directions
turn by more than 60 degrees in one frame of nearly every splice. Hands are therefore fitted to the words themselves
(``HandFit``), whose positions and rotations are both known.
"""

from __future__ import annotations

from collections.abc import Container, Sequence
from dataclasses import replace

import numpy as np

from signsplice.errors import InputError
from signsplice.motion import Clip, FloatArray, Skeleton, bone_translations, kinematics, rotation
from signsplice.rig.info import rig_info


def clip_of_positions(positions: FloatArray, before: Clip, after: Clip, joints: Sequence[int] | None = None) -> Clip:
    """Makes a clip on two clips' skeleton from joint positions (n, K, 3) between them: bone lengths stay constant, and
    hands are fitted to both clips. Joints without positions are interpolated from the frames on either side.

    joints: the K joints with positions, all by default; the first is above all others.
    """
    chosen = list(range(len(before.skeleton)) if joints is None else joints)
    first, last = before.local_rotations[-1], after.local_rotations[0]
    local = rotations_from_positions(before.skeleton, positions, first, last, chosen)
    local = HandFit([before, after], chosen).apply(local, positions, first, last)
    alpha = (np.arange(1, len(positions) + 1) / (len(positions) + 1))[:, None]
    translations = None
    if before.translations is not None or after.translations is not None:
        bones = bone_translations(before)[-1], bone_translations(after)[0]
        translations = (1.0 - alpha[..., None]) * bones[0] + alpha[..., None] * bones[1]
    clip = Clip(
        skeleton=before.skeleton,
        local_rotations=rotation.continuous(np.concatenate([first[None], local]))[1:],
        root_positions=(1.0 - alpha) * before.root_positions[-1] + alpha * after.root_positions[0],
        fps=before.fps,
        translations=translations,
        channels=None if before.channels is None else before.channels.forgotten(len(positions)),
    )
    if chosen[0] == 0:
        return replace(clip, root_positions=positions[:, 0])
    shift = positions[:, 0] - kinematics.forward(clip, [chosen[0]])[1][:, 0]
    return replace(clip, root_positions=clip.root_positions + shift)


def rotations_from_positions(
    skeleton: Skeleton,
    positions: FloatArray,
    before: FloatArray | None = None,
    after: FloatArray | None = None,
    joints: Sequence[int] | None = None,
) -> FloatArray:
    """Returns local rotations (T, J, 4) that bring a skeleton's joints as close to ``positions`` (T, K, 3) as its bones
    allow.

    joints: the K joints with positions, all by default.
    before, after: local rotations (J, 4) of the frames on either side, if known; else the rest pose.

    Bone lengths are the skeleton's: only directions are taken from the positions. A joint with several children that
    span a plane is fitted to all of them (Kabsch 1976). A joint with one child follows its direction; the twist about
    the bone, which positions do not show, is carried from frame to frame unchanged (parallel transport), starts from
    the frame before and drifts evenly to the one after. Joints without children or without positions follow a slerp
    between the two. The children of a joint are the nearest joints below it with positions. Raises ``InputError`` on
    wrong shapes.
    """
    positions = np.asarray(positions, np.float64)
    n_joints = len(skeleton)
    row_of = {joint: k for k, joint in enumerate(range(n_joints) if joints is None else joints)}
    if positions.ndim != 3 or positions.shape[1:] != (len(row_of), 3) or len(positions) == 0:
        raise InputError(f"positions {positions.shape}, expected (T, {len(row_of)}, 3) with T >= 1")
    start = np.broadcast_to(rotation.IDENTITY, (n_joints, 4)) if before is None else np.asarray(before, np.float64)
    end = None if after is None else np.asarray(after, np.float64)
    alpha = np.arange(1, len(positions) + 1) / (len(positions) + 1)
    local = rotation.slerp(start[None], (start if end is None else end)[None], alpha[:, None])  # (T, J, 4)
    globals_: list[FloatArray] = []
    for joint in range(n_joints):
        parent = skeleton.parents[joint]
        above = globals_[parent] if parent >= 0 else np.broadcast_to(rotation.IDENTITY, (len(positions), 4))
        bones = _bones(skeleton, local, joint, row_of) if joint in row_of else {}
        if bones:
            seen = positions[:, [row_of[child] for child in bones]] - positions[:, row_of[joint], None]
            seen = rotation.rotate(rotation.inverse(above)[:, None], seen)
            rest = np.stack(list(bones.values()), axis=1)  # (T, C, 3)
            if _spans_plane(rest[0]):
                local[:, joint] = _fit_rotations(rest, seen)
            else:
                local[:, joint] = _transport_rotations(
                    rest[:, 0], seen[:, 0], start[joint], None if end is None else end[joint]
                )
        globals_.append(rotation.multiply(above, local[:, joint]))
    return rotation.continuous(local)


NOISE = 0.5
"""Assumed standard deviation of position errors over the distance from the wrist to the joints of the hand: a network's
error is 3 to 5 cm. Chosen on validation pairs."""


class HandFit:
    """Linear maps from the positions of a hand's joints to its rotations, fitted to clips with both.

    One map gives the rotation of the hand from positions in the forearm's axes, the other those of its fingers from
    positions in the hand's axes. Ridge regression minimises the error for positions with errors of deviation ``NOISE``,
    so that errors of short bones flip no finger. Quaternions are fitted as four numbers each and normalised.

    - joints: the joints with positions, in their order
    """

    def __init__(self, clips: Sequence[Clip], joints: Sequence[int]) -> None:
        self.skeleton, self.joints = clips[0].skeleton, {joint: k for k, joint in enumerate(joints)}
        roles = rig_info(self.skeleton).roles.joints
        local = np.concatenate([clip.local_rotations for clip in clips])
        positions = np.concatenate([kinematics.forward(clip, joints)[1] for clip in clips])
        self._maps: list[tuple[int, list[int], bool, _LinearMap]] = []
        for hand in (roles[role] for role in ("leftHand", "rightHand") if role in roles):
            below = [joint for joint in kinematics.subtree(self.skeleton, hand) if joint != hand]
            if hand in self.joints and any(joint in self.joints for joint in below):
                for turned, fingers in (([hand], False), (below, True)):
                    seen = self._wrist_local_positions(hand, fingers, local, positions)
                    self._maps.append((hand, turned, fingers, _LinearMap(seen, local[:, turned])))

    def apply(self, local: FloatArray, positions: FloatArray, before: FloatArray, after: FloatArray) -> FloatArray:
        """Returns rotations (T, J, 4) with the hands fitted to ``positions`` (T, K, 3).

        before, after: true rotations (J, 4) of the frames on either side. The residuals of the fit there are
        interpolated and added to all frames between.
        """
        rows = np.concatenate([before[None], local, after[None]])
        ends = kinematics.forward(Clip(self.skeleton, rows[[0, -1]], np.zeros((2, 3)), 30.0), list(self.joints))[1]
        places = np.concatenate([ends[:1], positions, ends[1:]])
        alpha = np.linspace(0.0, 1.0, len(rows))[:, None, None]
        for hand, turned, fingers, rotations_at in self._maps:
            fitted = rotations_at(self._wrist_local_positions(hand, fingers, rows, places))
            missed = [rotation.log(rotation.multiply(rotation.inverse(fitted[k]), rows[k, turned])) for k in (0, -1)]
            rows[:, turned] = rotation.multiply(fitted, rotation.exp((1.0 - alpha) * missed[0] + alpha * missed[1]))
        return np.asarray(rotation.continuous(rows)[1:-1])

    def _wrist_local_positions(self, hand: int, fingers: bool, local: FloatArray, positions: FloatArray) -> FloatArray:
        """Returns positions (T, 3 K) of a hand's joints from the wrist, in the axes of the hand (``fingers``) or of the
        forearm.
        """
        axes = kinematics.global_quats(self.skeleton, local)[:, hand if fingers else self.skeleton.parents[hand]]
        below = [self.joints[joint] for joint in kinematics.subtree(self.skeleton, hand) if joint in self.joints]
        offsets = positions[:, below] - positions[:, [self.joints[hand]]]
        return np.asarray(rotation.rotate(rotation.inverse(axes)[:, None], offsets).reshape(len(offsets), -1))


class _LinearMap:
    """Ridge regression of rotations (T, J, 4) on numbers (T, I), for errors of ``NOISE`` in the numbers."""

    def __init__(self, seen: FloatArray, rotations: FloatArray) -> None:
        self.reference = rotations[0]
        values = rotations * np.where((rotations * self.reference).sum(-1, keepdims=True) < 0.0, -1.0, 1.0)
        outputs = values.reshape(len(values), -1)
        self.mean, self.offset = seen.mean(axis=0), outputs.mean(axis=0)
        inputs = seen - self.mean
        size = float(np.sqrt((seen**2).mean() * 3.0))
        square = inputs.T @ inputs + (NOISE * size) ** 2 * len(seen) * np.eye(seen.shape[1])
        self.weights = np.linalg.solve(square, inputs.T @ (outputs - self.offset))

    def __call__(self, seen: FloatArray) -> FloatArray:
        """Returns rotations (T, J, 4) for numbers (T, I)."""
        values = ((seen - self.mean) @ self.weights + self.offset).reshape(len(seen), *self.reference.shape)
        return np.asarray(values / np.linalg.norm(values, axis=-1, keepdims=True))


def _bones(skeleton: Skeleton, local: FloatArray, joint: int, given: Container[int]) -> dict[int, FloatArray]:
    """Returns the nearest joints below ``joint`` that are in ``given``, with their offsets (T, 3) from it in its axes;
    ``local`` (T, J, 4) holds the rotations of the joints between. Joints at the same place are skipped.
    """
    bones = {}
    for child in skeleton.children[joint]:
        offset = np.broadcast_to(skeleton.offsets[child], (len(local), 3))
        if child in given:
            bones[child] = offset
        else:
            turn = local[:, child]
            bones |= {
                below: offset + rotation.rotate(turn, lower_offset)
                for below, lower_offset in _bones(skeleton, local, child, given).items()
            }
    return {child: offset for child, offset in bones.items() if np.linalg.norm(offset[0]) > 1e-9}


def _spans_plane(offsets: FloatArray) -> bool:
    directions = offsets / np.linalg.norm(offsets, axis=-1, keepdims=True)
    return bool(np.linalg.matrix_rank(directions, tol=0.05) >= 2)


def _fit_rotations(rest: FloatArray, seen: FloatArray) -> FloatArray:
    """Returns rotations (T, 4) that best fit bones ``rest`` (T, C, 3) to ``seen`` (T, C, 3) (Kabsch 1976, by SVD)."""
    u, _, vt = np.linalg.svd(np.einsum("tca,tcb->tab", seen, rest))
    u[..., -1] *= np.sign(np.linalg.det(u) * np.linalg.det(vt))[:, None]
    return rotation.from_matrix(u @ vt)


def _transport_rotations(rest: FloatArray, seen: FloatArray, start: FloatArray, end: FloatArray | None) -> FloatArray:
    """Returns rotations (T, 4) that point the bone ``rest`` (T, 3) along ``seen`` (T, 3) without needless twist,
    starting from ``start`` (4,).
    """
    rotations = np.empty((len(seen), 4))
    q = start
    for frame, (bone, direction) in enumerate(zip(rest, seen, strict=True)):
        q = rotation.multiply(rotation.between_vectors(rotation.rotate(q, bone), direction), q)
        rotations[frame] = q
    if end is not None:
        axis = rest / np.linalg.norm(rest, axis=-1, keepdims=True)
        last = rest[-1]
        landing = rotation.multiply(rotation.between_vectors(rotation.rotate(q, last), rotation.rotate(end, last)), q)
        twist = rotation.twist_angle(rotation.multiply(rotation.inverse(landing), end), axis[-1])
        alpha = np.arange(1, len(seen) + 1) / (len(seen) + 1)
        rotations = rotation.multiply(rotations, rotation.exp(axis * (twist * alpha)[:, None]))
    return rotations
