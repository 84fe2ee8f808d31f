"""The canonical humanoid: one motion, one set of numbers, whatever the rig; and small turns go back exactly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from other_rigs import mirror, on_other_rig, with_rest_pose
from signing import word
from signsplice.errors import InputError
from signsplice.motion import kinematics, rotation
from signsplice.motion.clip import Clip, Skeleton
from signsplice.rig import canonical
from signsplice.rig.arms import active_span, arms
from signsplice.rig.canonical import apply_deltas, canonical_motion
from signsplice.rig.canonical_map import LEFT, RIGHT, ROLES, TIPS
from signsplice.rig.info import rig_info
from signsplice.rig.roles import FINGERS

RNG = np.random.default_rng(3)


def test_the_common_pose_is_all_identities(words: dict[str, Clip]) -> None:
    skeleton = words["SIGN"].skeleton
    common = rig_info(skeleton).t_pose.rotations
    above = np.where((skeleton.parents >= 0)[:, None], common[np.maximum(skeleton.parents, 0)], rotation.IDENTITY)
    local = rotation.multiply(rotation.inverse(above), common)
    posed = canonical_motion(Clip(skeleton, local[None], np.zeros((1, 3)), 30.0))
    np.testing.assert_allclose(
        rotation.to_matrix(posed.quats[0]), np.broadcast_to(np.eye(3), (len(ROLES), 3, 3)), atol=1e-9
    )
    assert posed.has_role.all()
    wrists = posed.positions[0, [0, len(TIPS) // 2]]
    assert wrists[0, 0] > 0.9, "the left wrist is at the left, an arm away"
    np.testing.assert_allclose(wrists[0] * [-1.0, 1.0, 1.0], wrists[1], atol=1e-9)


def test_other_axes_units_names_and_rest_poses_give_the_same_numbers() -> None:
    clip = word("BOOK").clip
    own = canonical_motion(clip)
    turn = rotation.exp([0.4, -1.1, 2.0])
    bent = {"mixamorig:LeftArm": (0.0, 0.0, -0.9), "mixamorig:RightForeArm": (0.0, 0.5, 0.0)}
    # A swing to the common pose says nothing of the twist about a bone: two degrees, where arms rest at other angles.
    for other, tolerance in ((on_other_rig(clip, turn, 0.01), 1e-6), (with_rest_pose(clip, bent), 0.04)):
        seen = canonical_motion(other)
        np.testing.assert_allclose(rotation.to_6d(seen.quats), rotation.to_6d(own.quats), atol=tolerance)
        np.testing.assert_allclose(seen.positions, own.positions, atol=1e-6)


def test_turns_and_places_are_those_of_the_whole_kinematics() -> None:
    clip = word("BOOK").clip
    for moving in (clip, with_a_joint_between(clip)):
        skeleton = moving.skeleton
        known, seen = rig_info(skeleton).canonical, canonical_motion(moving)
        turns, places = kinematics.forward(moving)
        carried = turns @ rotation.to_matrix(rotation.inverse(known.t_pose_rotations))
        hips = rig_info(skeleton).roles.joints["hips"]
        for row, joint in enumerate(known.joints):
            over = known.joints[known.parent_rows[row]] if known.parent_rows[row] >= 0 else hips
            expected = np.swapaxes(carried[:, over], 1, 2) @ carried[:, joint]
            np.testing.assert_allclose(rotation.to_matrix(seen.quats[:, row]), expected, atol=1e-9)
        shoulders = places[:, [rig_info(skeleton).roles.joints[f"{side}UpperArm"] for side in ("left", "right")]]
        way = places[:, list(known.arms[:-2])] - shoulders.mean(axis=1)[:, None]
        expected = way @ carried[:, known.chest] / known.arm_length
        np.testing.assert_allclose(np.concatenate([seen.positions, seen.elbow_positions], axis=1), expected, atol=1e-9)


def with_a_joint_between(clip: Clip) -> Clip:
    """The same motion on a rig whose left forearm is cut in two, its turn shared by both halves."""
    old = clip.skeleton
    arm = old.names.index("mixamorig:LeftForeArm")
    order = [*range(arm + 1), arm, *range(arm + 1, len(old))]  # the forearm twice
    moved = np.array([k + (k > arm) for k in range(len(old))])
    parents = np.array([-1 if old.parents[k] < 0 else moved[old.parents[k]] for k in order])
    parents[arm + 1] = arm
    parents[[n for n, k in enumerate(order) if old.parents[k] == arm and k != arm]] = arm + 1
    offsets, names = old.offsets[order].copy(), [old.names[k] for k in order]
    offsets[arm + 1], names[arm + 1] = 0.0, "LeftForeArmTwist"
    local = clip.local_rotations[:, order].copy()
    turn = rotation.log(local[:, arm])
    local[:, arm], local[:, arm + 1] = rotation.exp(0.3 * turn), rotation.exp(0.7 * turn)
    return Clip(Skeleton(tuple(names), parents, offsets), local, clip.root_positions, clip.fps)


def test_a_mirrored_clip_gives_mirrored_numbers() -> None:
    clip = word("MOTHER").clip
    own, other = canonical_motion(clip).mirrored(), canonical_motion(mirror(clip))
    np.testing.assert_allclose(rotation.to_6d(other.quats), rotation.to_6d(own.quats), atol=1e-9)
    np.testing.assert_allclose(other.positions, own.positions, atol=1e-9)
    again = own.mirrored()
    np.testing.assert_array_equal(again.quats, canonical_motion(clip).quats)


def test_turns_come_back_exactly_and_others_stay() -> None:
    clip = with_rest_pose(word("YES").clip, {"mixamorig:LeftArm": (0.0, 0.0, -0.9)})
    deltas = RNG.normal(0.0, 0.3, (len(clip), len(ROLES), 3))
    moved = replace(clip, local_rotations=apply_deltas(clip.skeleton, clip.local_rotations, deltas))
    expected = rotation.to_6d(rotation.multiply(canonical_motion(clip).quats, rotation.exp(deltas)))
    np.testing.assert_allclose(rotation.to_6d(canonical_motion(moved).quats), expected, atol=1e-8)
    nothing = apply_deltas(clip.skeleton, clip.local_rotations, np.zeros_like(deltas))
    np.testing.assert_array_equal(nothing, clip.local_rotations)
    legs = [joint for role, joint in rig_info(clip.skeleton).roles.joints.items() if "Leg" in role or role == "hips"]
    np.testing.assert_array_equal(moved.local_rotations[:, legs], clip.local_rotations[:, legs])


def test_deltas_in_the_mirror() -> None:
    clip = word("YES").clip
    deltas = RNG.normal(0.0, 0.3, (len(clip), len(ROLES), 3))
    one = mirror(replace(clip, local_rotations=apply_deltas(clip.skeleton, clip.local_rotations, deltas)))
    flipped = mirror(clip)
    other = apply_deltas(flipped.skeleton, flipped.local_rotations, canonical.mirrored_deltas(deltas))
    np.testing.assert_allclose(rotation.angle_between(one.local_rotations, other), 0.0, atol=1e-6)


def test_a_rig_without_fingers_or_arms() -> None:
    clip = word("YES").clip
    skeleton = clip.skeleton
    kept = [k for k, name in enumerate(skeleton.names) if not any(f in name for f in (*FINGERS, "Pinky"))]
    index = {joint: n for n, joint in enumerate(kept)}
    bare = Skeleton(
        tuple(skeleton.names[k] for k in kept),
        np.array([index.get(int(skeleton.parents[k]), -1) for k in kept]),
        skeleton.offsets[kept],
    )
    seen, own = (
        canonical_motion(Clip(bare, clip.local_rotations[:, kept], clip.root_positions, clip.fps)),
        canonical_motion(clip),
    )
    assert not seen.has_role[LEFT.start + 4 : LEFT.stop].any()
    assert not seen.has_role[RIGHT.start + 4 : RIGHT.stop].any()
    arms = [*range(LEFT.start + 4), *range(RIGHT.start, RIGHT.start + 3)]
    np.testing.assert_allclose(seen.quats[:, arms], own.quats[:, arms], atol=0.2)
    np.testing.assert_array_equal(seen.positions[:, 0], seen.positions[:, 3])
    with pytest.raises(InputError, match="no leftUpperArm"):
        canonical_motion(
            Clip(Skeleton(("a",), np.array([-1]), np.zeros((1, 3))), np.array([[[0, 0, 0, 1.0]]]), np.zeros((1, 3)), 1)
        )


def test_arms_are_away_from_rest_when_the_world_says_so() -> None:
    for gloss in ("MOTHER", "BOOK", "SEE"):
        clip = word(gloss).clip
        told, seen = active_span(arms(clip)), canonical_motion(clip).active_span
        assert np.abs(np.subtract(told, seen)).max() <= 1, "up is the trunk's and not the world's"
        assert canonical_motion(mirror(clip)).active_span == seen
        up = clip[seen[0] + 6 : seen[1] - 6]
        assert canonical_motion(up).active_span == (0, len(up)), "where nobody rests, all of it"
