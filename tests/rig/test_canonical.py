"""rig.info: one motion has the same canonical rotations on every rig, and small changes go back exactly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from other_rigs import mirror, on_other_rig, with_rest_pose, without
from signing import word
from signsplice.errors import InputError
from signsplice.motion import Clip, Skeleton, kinematics, rotation
from signsplice.rig.info import (
    LEFT,
    RIGHT,
    ROLES,
    TIPS,
    active_span,
    apply_deltas,
    arms,
    canonical_motion,
    mirror_deltas,
    rig_info,
)
from signsplice.rig.roles import FINGERS

RNG = np.random.default_rng(3)


def test_the_t_pose_is_all_identities(words: dict[str, Clip]) -> None:
    skeleton = words["SIGN"].skeleton
    t_pose = rig_info(skeleton).t_pose.rotations  # (J, 4), global
    parents = np.where((skeleton.parents >= 0)[:, None], t_pose[np.maximum(skeleton.parents, 0)], rotation.IDENTITY)
    local = rotation.multiply(rotation.inverse(parents), t_pose)
    posed = canonical_motion(Clip(skeleton, local[None], np.zeros((1, 3)), 30.0))
    np.testing.assert_allclose(
        rotation.to_matrix(posed.quats[0]), np.broadcast_to(np.eye(3), (len(ROLES), 3, 3)), atol=1e-9
    )
    assert posed.has_role.all()
    wrists = posed.positions[0, [0, len(TIPS) // 2]]
    assert wrists[0, 0] > 0.9, "the left wrist lies an arm's length to the left"
    np.testing.assert_allclose(wrists[0] * [-1.0, 1.0, 1.0], wrists[1], atol=1e-9)


def test_every_rig_gives_the_same_canonical_motion() -> None:
    clip = word("BOOK").clip
    expected = canonical_motion(clip)
    axes = rotation.exp([0.4, -1.1, 2.0])
    bent = {"mixamorig:LeftArm": (0.0, 0.0, -0.9), "mixamorig:RightForeArm": (0.0, 0.5, 0.0)}
    # The swing that brings a bone into the T-pose does not fix its twist: two degrees where arms rest at other angles.
    for other, tolerance in ((on_other_rig(clip, axes, 0.01), 1e-6), (with_rest_pose(clip, bent), 0.04)):
        seen = canonical_motion(other)
        np.testing.assert_allclose(rotation.to_6d(seen.quats), rotation.to_6d(expected.quats), atol=tolerance)
        np.testing.assert_allclose(seen.positions, expected.positions, atol=1e-6)


def test_canonical_motion_agrees_with_full_forward_kinematics() -> None:
    clip = word("BOOK").clip
    for moving in (clip, with_split_forearm(clip)):
        skeleton = moving.skeleton
        canonical_map, seen = rig_info(skeleton).canonical, canonical_motion(moving)
        global_rotations, global_positions = kinematics.forward(moving)
        from_t_pose = global_rotations @ rotation.to_matrix(rotation.inverse(canonical_map.t_pose_rotations))
        hips = rig_info(skeleton).roles.joints["hips"]
        for row, joint in enumerate(canonical_map.joints):
            parent_row = canonical_map.parent_rows[row]
            parent = canonical_map.joints[parent_row] if parent_row >= 0 else hips
            expected = np.swapaxes(from_t_pose[:, parent], 1, 2) @ from_t_pose[:, joint]
            np.testing.assert_allclose(rotation.to_matrix(seen.quats[:, row]), expected, atol=1e-9)
        shoulders = [rig_info(skeleton).roles.joints[f"{side}UpperArm"] for side in ("left", "right")]
        middle = global_positions[:, shoulders].mean(axis=1)
        from_middle = global_positions[:, list(canonical_map.arms[:-2])] - middle[:, None]
        expected = from_middle @ from_t_pose[:, canonical_map.chest] / canonical_map.arm_length
        np.testing.assert_allclose(np.concatenate([seen.positions, seen.elbow_positions], axis=1), expected, atol=1e-9)


def with_split_forearm(clip: Clip) -> Clip:
    """The same motion on a rig whose left forearm is two joints in one place, which share its rotation."""
    old = clip.skeleton
    arm = old.names.index("mixamorig:LeftForeArm")
    order = [*range(arm + 1), arm, *range(arm + 1, len(old))]  # the forearm twice
    new_index = np.array([k + (k > arm) for k in range(len(old))])
    parents = np.array([-1 if old.parents[k] < 0 else new_index[old.parents[k]] for k in order])
    parents[arm + 1] = arm
    parents[[n for n, k in enumerate(order) if old.parents[k] == arm and k != arm]] = arm + 1
    offsets, names = old.offsets[order].copy(), [old.names[k] for k in order]
    offsets[arm + 1], names[arm + 1] = 0.0, "LeftForeArmTwist"
    local = clip.local_rotations[:, order].copy()
    rotvecs = rotation.log(local[:, arm])
    local[:, arm], local[:, arm + 1] = rotation.exp(0.3 * rotvecs), rotation.exp(0.7 * rotvecs)
    return Clip(Skeleton(tuple(names), parents, offsets), local, clip.root_positions, clip.fps)


def test_a_mirrored_clip_has_the_mirrored_canonical_motion() -> None:
    clip = word("MOTHER").clip
    expected, other = canonical_motion(clip).mirror(), canonical_motion(mirror(clip))
    np.testing.assert_allclose(rotation.to_6d(other.quats), rotation.to_6d(expected.quats), atol=1e-9)
    np.testing.assert_allclose(other.positions, expected.positions, atol=1e-9)
    again = expected.mirror()
    np.testing.assert_array_equal(again.quats, canonical_motion(clip).quats)


def test_deltas_are_applied_exactly_and_other_joints_stay() -> None:
    clip = with_rest_pose(word("YES").clip, {"mixamorig:LeftArm": (0.0, 0.0, -0.9)})
    deltas = RNG.normal(0.0, 0.3, (len(clip), len(ROLES), 3))
    moved = replace(clip, local_rotations=apply_deltas(clip.skeleton, clip.local_rotations, deltas))
    expected = rotation.to_6d(rotation.multiply(canonical_motion(clip).quats, rotation.exp(deltas)))
    np.testing.assert_allclose(rotation.to_6d(canonical_motion(moved).quats), expected, atol=1e-8)
    unchanged = apply_deltas(clip.skeleton, clip.local_rotations, np.zeros_like(deltas))
    np.testing.assert_array_equal(unchanged, clip.local_rotations)
    legs = [joint for role, joint in rig_info(clip.skeleton).roles.joints.items() if "Leg" in role or role == "hips"]
    np.testing.assert_array_equal(moved.local_rotations[:, legs], clip.local_rotations[:, legs])


def test_mirrored_deltas_move_a_mirrored_clip_alike() -> None:
    clip = word("YES").clip
    deltas = RNG.normal(0.0, 0.3, (len(clip), len(ROLES), 3))
    one = mirror(replace(clip, local_rotations=apply_deltas(clip.skeleton, clip.local_rotations, deltas)))
    flipped = mirror(clip)
    other = apply_deltas(flipped.skeleton, flipped.local_rotations, mirror_deltas(deltas))
    np.testing.assert_allclose(rotation.angle_between(one.local_rotations, other), 0.0, atol=1e-6)


def test_a_rig_without_fingers_has_no_finger_roles() -> None:
    clip = word("YES").clip
    whole, seen = canonical_motion(clip), canonical_motion(without(clip, *FINGERS, "Pinky"))
    assert not seen.has_role[LEFT.start + 4 : LEFT.stop].any()
    assert not seen.has_role[RIGHT.start + 4 : RIGHT.stop].any()
    arms_and_trunk = [*range(LEFT.start + 4), *range(RIGHT.start, RIGHT.start + 3)]
    np.testing.assert_allclose(seen.quats[:, arms_and_trunk], whole.quats[:, arms_and_trunk], atol=0.2)
    np.testing.assert_array_equal(seen.positions[:, 0], seen.positions[:, 3], "the wrist's where a finger is missing")


def test_a_rig_without_arms_is_refused() -> None:
    skeleton = Skeleton(("a",), np.array([-1]), np.zeros((1, 3)))
    with pytest.raises(InputError, match="no leftUpperArm"):
        canonical_motion(Clip(skeleton, np.array([[[0, 0, 0, 1.0]]]), np.zeros((1, 3)), 30.0))


def test_the_active_span_agrees_with_that_of_the_arms() -> None:
    for gloss in ("MOTHER", "BOOK", "SEE"):
        clip = word(gloss).clip
        expected, seen = active_span(arms(clip)), canonical_motion(clip).active_span
        assert np.abs(np.subtract(expected, seen)).max() <= 1, "one measures heights along the trunk, one in the world"
        assert canonical_motion(mirror(clip)).active_span == seen
        up = clip[seen[0] + 6 : seen[1] - 6]
        assert canonical_motion(up).active_span == (0, len(up)), "the whole clip where there is no rest"
