"""rig.align: clips of other rigs, units, frame rates and placements aligned to one reference."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from conftest import rooted

from known_rigs import reverse_depth_first, with_joints
from other_rigs import on_other_rig, with_rest_pose, without
from signsplice.body.retarget import Retargeted, align
from signsplice.errors import RigMismatchError
from signsplice.motion import Clip, FloatArray, Skeleton, kinematics, rotation
from signsplice.rig import t_pose
from signsplice.rig.align import Reference, copy_rotations, placement, reference, settle
from signsplice.rig.info import rig_info


def copied(clip: Clip, to: Reference) -> Retargeted:
    """As ``align``, with the rotations alone: bodies that differ in a bone or an end site are not fitted."""
    carried, warnings, _ = copy_rotations(clip, to)
    return Retargeted(settle(carried, to), warnings)


def positions(clip: Clip) -> FloatArray:
    """Global positions (T, J, 3) of all joints."""
    return kinematics.forward(clip)[1]


def test_a_clip_aligned_to_itself_is_unchanged(words: dict[str, Clip]) -> None:
    clip = words["SIGN"]
    out = align(clip, reference(clip))
    assert out.clip is clip
    assert out.warnings == ()


def test_position_facing_and_height_are_undone(words: dict[str, Clip]) -> None:
    clip = words["HELLO"]
    yaw = rotation.exp([0.0, 2.1, 0.0])
    local = np.array(clip.local_rotations)
    local[:, 0] = rotation.multiply(yaw, local[:, 0])
    moved = replace(
        clip,
        local_rotations=local,
        root_positions=rotation.rotate(yaw, clip.root_positions) + np.array([120.0, 30.0, -44.0]),
        name="moved",
    )
    out = align(moved, reference(clip)).clip
    assert np.allclose(positions(out), positions(clip), atol=2e-3), "a median depends on the axes"
    assert np.array_equal(out.local_rotations[:, 1:], clip.local_rotations[:, 1:]), "only the root changes"


@pytest.mark.parametrize("unit", ["m", "inch", "mm"])
def test_units_are_found_by_the_size_of_the_body(unit: str, words: dict[str, Clip]) -> None:
    clip = words["DEAF"]
    scale = 0.01 / t_pose.UNITS[unit]
    other = replace(
        clip,
        skeleton=replace(clip.skeleton, offsets=clip.skeleton.offsets * scale),
        root_positions=clip.root_positions * scale,
    )
    assert rig_info(other.skeleton).sizes.unit.name == unit
    assert rig_info(clip.skeleton).sizes.unit.name == "cm"
    out = copied(other, reference(clip)).clip
    assert np.allclose(positions(out), positions(clip), atol=1e-6)


@pytest.mark.parametrize(
    ("rotvec", "scale"), [((-1.5707963, 0.0, 0.0), 0.01), ((0.0, 1.2, 0.0), 1.0), ((0.0, 0.0, 1.5707963), 0.3937)]
)
def test_a_rig_with_other_axes_and_units_shows_the_same_motion(
    rotvec: tuple[float, float, float], scale: float, words: dict[str, Clip]
) -> None:
    clip = words["SIGN"]
    other = on_other_rig(clip, rotation.exp(rotvec), scale)
    out = align(other, reference(clip)).clip
    assert np.allclose(positions(out), positions(clip), atol=0.05), "half a millimetre"


def test_a_rig_with_a_rest_pose_of_arms_forward_keeps_its_shoulders(words: dict[str, Clip]) -> None:
    """Some exporters write a rest pose whose collar bones and arms point forward."""
    clip = words["SIGN"]
    pose = {
        "mixamorig:LeftShoulder": (0.0, -1.4, 0.1),
        "mixamorig:RightShoulder": (0.1, 1.4, 0.0),
        "mixamorig:LeftHand": (0.3, 0, 0),
    }
    other = with_rest_pose(clip, pose)
    assert np.allclose(positions(other), positions(clip), atol=1e-6), "the same motion"
    assert np.allclose(positions(copied(other, reference(clip)).clip), positions(clip), atol=0.3), "3 mm"
    assert np.allclose(positions(copied(clip, reference(other)).clip), positions(clip), atol=0.3)
    assert rig_info(other.skeleton).sizes.shoulder_width == pytest.approx(
        rig_info(clip.skeleton).sizes.shoulder_width, rel=0.02
    )


def test_rigs_with_other_joint_names_are_matched_by_roles(words: dict[str, Clip]) -> None:
    clip = words["THANK-YOU"]
    roles = rig_info(clip.skeleton).roles
    vrm = {clip.skeleton.names[joint]: role for role, joint in roles.joints.items()}
    other = on_other_rig(clip, rotation.exp([0.0, 0.0, 0.0]), 0.01, vrm)
    out = align(other, reference(clip))
    assert np.allclose(positions(out.clip), positions(clip), atol=0.05)
    assert out.warnings == (), "HeadTop_End has no counterpart, but carries nothing that moves"
    back = align(clip, reference(other)).clip
    assert np.allclose(positions(back), positions(other), atol=0.0005)


def test_names_that_mean_other_joints_of_the_arm_make_no_one_rig(words: dict[str, Clip]) -> None:
    """Names of legs and fingers agree. LeftShoulder is the collar bone of one, the upper arm of the other."""
    clip = words["SIGN"]
    classic = {"Shoulder": "Collar", "Arm": "Shoulder", "ForeArm": "Elbow", "Hand": "Wrist"}
    rename = {f"mixamorig:{side}{a}": f"{side}{b}" for side in ("Left", "Right") for a, b in classic.items()}
    out = align(on_other_rig(clip, np.asarray(rotation.IDENTITY), 1.0, rename), reference(clip))
    assert np.allclose(positions(out.clip), positions(clip), atol=1e-6)
    assert out.warnings == ()


def test_fingers_named_unlike_the_body_are_carried_over(words: dict[str, Clip]) -> None:
    clip = words["SIGN"]
    rename = {
        f"mixamorig:{side}Hand{finger}{n}": f"{word}.0{n}.{side[0]}" if n < 3 else f"{word}0{n}.{side[0]}"
        for side in ("Left", "Right")
        for finger, word in (
            ("Thumb", "thumb"),
            ("Index", "fore"),
            ("Middle", "mid"),
            ("Ring", "ring"),
            ("Pinky", "little"),
        )
        for n in (1, 2, 3)
    }
    assert rename.keys() <= set(clip.skeleton.names)
    other = on_other_rig(clip, rotation.exp([0.0, 1.2, 0.0]), 1.0, rename)
    out = align(clip, reference(other))
    assert np.allclose(positions(out.clip), positions(other), atol=1e-3)


def test_a_joint_above_the_hips_changes_nothing(words: dict[str, Clip]) -> None:
    """In some rigs the root stays on the floor, and the hips below it carry the signer's sway."""
    clip = words["DEAF"]
    sway = clip.root_positions + 3.0 * np.sin(np.arange(len(clip)) / 9.0)[:, None] * np.array([1.0, 0.1, 0.5])
    swaying = replace(clip, root_positions=sway)
    skeleton = Skeleton(
        ("Reference", *clip.skeleton.names),
        np.concatenate([[-1], clip.skeleton.parents + 1]),
        np.concatenate([np.zeros((1, 3)), clip.skeleton.offsets]),
    )
    local = np.concatenate([np.tile(rotation.IDENTITY, (len(clip), 1, 1)), clip.local_rotations], axis=1)
    translations = np.tile(skeleton.offsets, (len(clip), 1, 1))
    translations[:, 1] = sway
    on_floor = Clip(skeleton, local, np.zeros((len(clip), 3)), clip.fps, "on floor", translations)
    assert np.allclose(positions(on_floor)[:, 1:], positions(swaying), atol=1e-9), "the same motion"
    assert np.allclose(positions(copied(on_floor, reference(swaying)).clip), positions(swaying), atol=0.05)
    assert np.allclose(positions(copied(swaying, reference(on_floor)).clip)[:, 1:], positions(swaying), atol=0.05)


def test_a_rotated_joint_above_the_hips_changes_nothing(words: dict[str, Clip]) -> None:
    clip = rooted(words["DEAF"])
    skeleton = Skeleton(
        ("Reference", *clip.skeleton.names),
        np.concatenate([[-1], clip.skeleton.parents + 1]),
        np.concatenate([np.zeros((1, 3)), clip.skeleton.offsets]),
    )
    tilt = rotation.exp([0.5, 0.0, 0.0])
    local = np.concatenate([np.tile(tilt, (len(clip), 1, 1)), clip.local_rotations], axis=1)
    local[:, 1] = rotation.multiply(rotation.inverse(tilt), local[:, 1])
    offsets = np.array(skeleton.offsets)
    offsets[1] = rotation.rotate(rotation.inverse(tilt), offsets[1])
    on_floor = Clip(replace(skeleton, offsets=offsets), local, np.zeros((len(clip), 3)), clip.fps, "on floor")
    assert np.allclose(positions(on_floor)[:, 1:], positions(clip), atol=1e-9), "the same motion"
    assert np.allclose(positions(copied(clip, reference(on_floor)).clip)[:, 1:], positions(clip), atol=0.05)
    assert np.allclose(positions(copied(on_floor, reference(clip)).clip), positions(clip), atol=0.05)


@pytest.mark.parametrize("degrees", [4.0, 10.0, 19.0, 40.0])
def test_arms_that_rest_at_another_angle_reach_the_same_point(degrees: float, words: dict[str, Clip]) -> None:
    clip = words["SIGN"]
    angle = np.deg2rad(degrees)
    other = with_rest_pose(clip, {"mixamorig:LeftArm": (0.0, 0.0, -angle), "mixamorig:RightArm": (0.0, 0.0, angle)})
    error = np.linalg.norm(positions(copied(other, reference(clip)).clip) - positions(clip), axis=-1).max()
    assert error < 1e-6, "cm"


def test_the_order_of_joints_does_not_matter(words: dict[str, Clip]) -> None:
    clip = words["I"]
    order = reverse_depth_first(clip.skeleton)
    reordered = with_joints(clip.skeleton, order)
    names = tuple(name.replace("mixamorig:", "mixamorig_") for name in reordered.names)
    shuffled = Clip(
        replace(reordered, names=names), clip.local_rotations[:, order], clip.root_positions, clip.fps, "shuffled"
    )
    out = copied(shuffled, reference(clip))
    assert np.array_equal(out.clip.local_rotations, clip.local_rotations)
    assert out.warnings == ()


def test_joints_without_a_counterpart_hold_their_pose(words: dict[str, Clip]) -> None:
    clip = words["I"]
    out = copied(replace(without(clip, "Pinky"), name="fewer"), reference(clip))
    held = np.array(["Pinky" in name for name in clip.skeleton.names])
    assert np.array_equal(out.clip.local_rotations[:, ~held], clip.local_rotations[:, ~held])
    assert (out.clip.local_rotations[:, held] == clip.local_rotations[0, held]).all()
    assert len(out.warnings) == 1
    assert "6 joints of I" in out.warnings[0]


def test_clips_of_another_rate_are_resampled_by_time(words: dict[str, Clip]) -> None:
    clip = words["HELLO"]
    out = align(clip, reference(clip, fps=60.0))
    assert out.clip.fps == 60.0
    assert abs(out.clip.seconds - clip.seconds) < 1 / 30
    assert np.all(rotation.angle_between(out.clip.local_rotations[::2], clip.local_rotations) < 1e-7)


def test_rigs_with_nothing_in_common_are_refused(words: dict[str, Clip]) -> None:
    clip = words["I"]
    table = Skeleton(("Table", "LegA", "LegB"), np.array([-1, 0, 0]), np.array([[0.0, 0, 0], [1, 0, 0], [-1, 0, 0]]))
    other = Clip(table, np.tile(rotation.IDENTITY, (5, 3, 1)), np.zeros((5, 3)), 30.0, "table")
    with pytest.raises(RigMismatchError, match=r"table .*Table, LegA, LegB.* and I .*mixamorig:Hips"):
        align(other, reference(clip))


def arm_directions(clip: Clip) -> FloatArray:
    """Unit vectors (T, 8, 3) along the bones of arms and index fingers, in the signer's left, up and forward axes."""
    joints, placed = rig_info(clip.skeleton).roles.joints, placement(clip)
    axes = np.stack([np.cross(placed.up, placed.forward), placed.up, placed.forward])
    chain = ("Shoulder", "UpperArm", "LowerArm", "Hand", "IndexProximal", "IndexIntermediate")
    pairs = [(side + a, side + b) for side in ("left", "right") for a, b in pairwise(chain) if a != "Hand"]
    at = positions(clip) @ axes.T
    bones = np.stack([at[:, joints[b]] - at[:, joints[a]] for a, b in pairs], axis=1)
    return np.asarray(bones / np.linalg.norm(bones, axis=-1, keepdims=True))


def test_real_clips_of_other_rigs_keep_their_arm_directions(real_clips: dict[str, Clip]) -> None:
    """A clip in metres, with 65 joints and a rest pose along -Z, on a rig in cm with 52 joints."""
    take = real_clips["long_take_metres"]
    out = copied(take, reference(real_clips["isl_thanks"])).clip
    cosine = np.sum(arm_directions(out) * arm_directions(take), axis=-1)
    assert np.rad2deg(np.arccos(np.clip(cosine, -1.0, 1.0))).max() < 10.0


def test_arms_that_rest_five_degrees_apart_point_where_they_pointed_by_name_and_by_role(words: dict[str, Clip]) -> None:
    clip = words["HELLO"]
    arm = clip.skeleton.names[rig_info(clip.skeleton).arm_joints[0]]
    lowered = with_rest_pose(clip, {arm: (0.0, 0.0, np.deg2rad(-5.0))}).skeleton
    to = Reference(lowered, clip.fps, placement(clip), clip.local_rotations[0], "other")
    joints = rig_info(clip.skeleton).arm_joints
    was, by_name, by_role = (
        np.diff(positions(c)[:, joints[:3]], axis=1)
        for c in (clip, copy_rotations(clip, to)[0], copy_rotations(clip, to, by_role=True)[0])
    )
    size = np.abs(was).max()
    np.testing.assert_allclose(by_name, was, atol=1e-9 * size)
    np.testing.assert_allclose(by_role, was, atol=1e-6 * size)
