"""Clips of other rigs, units, rates and places brought onto one ground."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from conftest import rooted
from other_rigs import on_other_rig, with_rest_pose
from signsplice.errors import RigMismatchError
from signsplice.motion import kinematics, rotation
from signsplice.motion.clip import Clip, Skeleton
from signsplice.rig import proportions
from signsplice.rig.align import align, reference
from signsplice.rig.info import rig_info
from signsplice.rig.placement import Placement, place, placement

Float = rotation.Float


def positions(clip: Clip) -> Float:
    return kinematics.forward(clip)[1]


def test_a_clip_on_its_own_ground_is_untouched(words: dict[str, Clip]) -> None:
    clip = words["SIGN"]
    out = align(clip, reference(clip))
    assert out.clip is clip
    assert out.warnings == ()


def test_place_facing_and_height_are_undone(words: dict[str, Clip]) -> None:
    clip = words["HELLO"]
    turn = rotation.exp([0.0, 2.1, 0.0])
    local = np.array(clip.local_rotations)
    local[:, 0] = rotation.multiply(turn, local[:, 0])
    moved = replace(
        clip,
        local_rotations=local,
        root_positions=rotation.rotate(turn, clip.root_positions) + np.array([120.0, 30.0, -44.0]),
        name="moved",
    )
    out = align(moved, reference(clip)).clip
    assert np.allclose(positions(out), positions(clip), atol=2e-3), "the signer sways, and medians depend on the axes"
    assert np.array_equal(out.local_rotations[:, 1:], clip.local_rotations[:, 1:]), "only the root is moved"


def test_a_moved_clip_knows_what_it_was_moved_from(words: dict[str, Clip]) -> None:
    onto, word = reference(words["HELLO"]), words["DEAF"]
    moved = align(word, onto).clip
    again = place(moved, placement(words["SIGN"]))
    assert moved is not word
    assert moved.source_clip is again.source_clip is word
    faster = align(word, onto, speed=2.0).clip
    assert faster.source_clip is None, "another motion is another clip"


@pytest.mark.parametrize("unit", ["m", "inch", "mm"])
def test_units_are_told_from_the_body(unit: str, words: dict[str, Clip]) -> None:
    clip = words["DEAF"]
    scale = 0.01 / proportions.UNITS[unit]
    other = replace(
        clip,
        skeleton=replace(clip.skeleton, offsets=clip.skeleton.offsets * scale),
        root_positions=clip.root_positions * scale,
    )
    assert rig_info(other.skeleton).sizes.unit.name == unit
    assert rig_info(clip.skeleton).sizes.unit.name == "cm"
    out = align(other, reference(clip)).clip
    assert np.allclose(positions(out), positions(clip), atol=1e-6)


@pytest.mark.parametrize(
    ("turn", "scale"), [((-1.5707963, 0.0, 0.0), 0.01), ((0.0, 1.2, 0.0), 1.0), ((0.0, 0.0, 1.5707963), 0.3937)]
)
def test_a_rig_with_another_rest_pose_points_its_bones_the_same_way(
    turn: tuple[float, float, float], scale: float, words: dict[str, Clip]
) -> None:
    clip = words["SIGN"]
    lying = on_other_rig(clip, rotation.exp(turn), scale)
    out = align(lying, reference(clip)).clip
    assert np.allclose(positions(out), positions(clip), atol=0.05), "half a millimetre"


def test_a_rig_that_rests_with_its_arms_forward_keeps_its_shoulders(words: dict[str, Clip]) -> None:
    """Some exporters write a rest pose whose collars and arms point forward; they must not fold the signer."""
    clip = words["SIGN"]
    pose = {
        "mixamorig:LeftShoulder": (0.0, -1.4, 0.1),
        "mixamorig:RightShoulder": (0.1, 1.4, 0.0),
        "mixamorig:LeftHand": (0.3, 0, 0),
    }
    other = with_rest_pose(clip, pose)
    assert np.allclose(positions(other), positions(clip), atol=1e-6), "the same motion"
    assert np.allclose(positions(align(other, reference(clip)).clip), positions(clip), atol=0.3), "3 mm"
    assert np.allclose(positions(align(clip, reference(other)).clip), positions(clip), atol=0.3)
    assert rig_info(other.skeleton).sizes.shoulder_width == pytest.approx(
        rig_info(clip.skeleton).sizes.shoulder_width, rel=0.02
    )


def test_by_roles_between_naming_conventions(words: dict[str, Clip]) -> None:
    clip = words["THANK-YOU"]
    roles = rig_info(clip.skeleton).roles
    vrm = {clip.skeleton.names[joint]: role for role, joint in roles.joints.items()}
    other = on_other_rig(clip, rotation.exp([0.0, 0.0, 0.0]), 0.01, vrm)
    out = align(other, reference(clip))
    assert np.allclose(positions(out.clip), positions(clip), atol=0.05)
    assert len(out.warnings) == 1
    assert "HeadTop_End" in out.warnings[0]
    back = align(clip, reference(other)).clip
    assert np.allclose(positions(back), positions(other), atol=0.0005)


def test_a_joint_above_the_hips_makes_no_difference(words: dict[str, Clip]) -> None:
    """Some rigs hang the hips, with the signer's sway, from a root on the floor that stands still."""
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
    hung = Clip(skeleton, local, np.zeros((len(clip), 3)), clip.fps, "hung", translations)
    assert np.allclose(positions(hung)[:, 1:], positions(swaying), atol=1e-9), "the same motion"
    assert np.allclose(positions(align(hung, reference(swaying)).clip), positions(swaying), atol=0.05)
    assert np.allclose(positions(align(swaying, reference(hung)).clip)[:, 1:], positions(swaying), atol=0.05)


def test_a_turned_joint_above_the_hips_turns_nothing(words: dict[str, Clip]) -> None:
    clip = rooted(words["DEAF"])
    skeleton = Skeleton(
        ("Reference", *clip.skeleton.names),
        np.concatenate([[-1], clip.skeleton.parents + 1]),
        np.concatenate([np.zeros((1, 3)), clip.skeleton.offsets]),
    )
    turn = rotation.exp([0.5, 0.0, 0.0])
    local = np.concatenate([np.tile(turn, (len(clip), 1, 1)), clip.local_rotations], axis=1)
    local[:, 1] = rotation.multiply(rotation.inverse(turn), local[:, 1])
    offsets = np.array(skeleton.offsets)
    offsets[1] = rotation.rotate(rotation.inverse(turn), offsets[1])
    hung = Clip(replace(skeleton, offsets=offsets), local, np.zeros((len(clip), 3)), clip.fps, "hung")
    assert np.allclose(positions(hung)[:, 1:], positions(clip), atol=1e-9), "the same motion"
    assert np.allclose(positions(align(clip, reference(hung)).clip)[:, 1:], positions(clip), atol=0.05)
    assert np.allclose(positions(align(hung, reference(clip)).clip), positions(clip), atol=0.05)


@pytest.mark.parametrize("degrees", [4.0, 10.0, 19.0, 40.0])
def test_arms_that_rest_at_another_angle_do_not_miss(degrees: float, words: dict[str, Clip]) -> None:
    clip = words["SIGN"]
    angle = np.deg2rad(degrees)
    other = with_rest_pose(clip, {"mixamorig:LeftArm": (0.0, 0.0, -angle), "mixamorig:RightArm": (0.0, 0.0, angle)})
    error = np.linalg.norm(positions(align(other, reference(clip)).clip) - positions(clip), axis=-1).max()
    assert error < (5.0 if degrees < 6.0 else 0.1), "cm"


def test_joint_order_and_extra_joints_do_not_matter(words: dict[str, Clip]) -> None:
    clip = words["I"]
    names = clip.skeleton.names
    # The same tree with the children of every joint in reverse order, and an extra joint in the spine.
    order: list[int] = []

    def visit(joint: int) -> None:
        order.append(joint)
        for child in reversed(clip.skeleton.children[joint]):
            visit(child)

    visit(0)
    place = {joint: n for n, joint in enumerate(order)}
    parents = np.array([place.get(int(clip.skeleton.parents[j]), -1) for j in order])
    skeleton = Skeleton(
        tuple(names[j].replace("mixamorig:", "mixamorig_") for j in order), parents, clip.skeleton.offsets[order]
    )
    shuffled = Clip(skeleton, clip.local_rotations[:, order], clip.root_positions, clip.fps, "shuffled")
    out = align(shuffled, reference(clip))
    assert np.array_equal(out.clip.local_rotations, clip.local_rotations)
    assert out.warnings == ()


def test_joints_without_a_counterpart_hold_their_pose(words: dict[str, Clip]) -> None:
    clip = words["I"]
    keep = [j for j, name in enumerate(clip.skeleton.names) if "Pinky" not in name]
    place = {joint: n for n, joint in enumerate(keep)}
    skeleton = Skeleton(
        tuple(clip.skeleton.names[j] for j in keep),
        np.array([place.get(int(clip.skeleton.parents[j]), -1) for j in keep]),
        clip.skeleton.offsets[keep],
    )
    fewer = Clip(skeleton, clip.local_rotations[:, keep], clip.root_positions, clip.fps, "fewer")
    out = align(fewer, reference(clip))
    held = [j for j in range(len(clip.skeleton)) if j not in place]
    assert np.array_equal(out.clip.local_rotations[:, keep], clip.local_rotations[:, keep])
    assert np.array_equal(
        out.clip.local_rotations[:, held], np.repeat(clip.local_rotations[:1, held], len(clip), axis=0)
    )
    assert len(out.warnings) == 1
    assert "6 joints of I" in out.warnings[0]


def test_rates_are_brought_together_by_time(words: dict[str, Clip]) -> None:
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


def test_real_clips_of_other_rigs_keep_their_signing(real_clips: dict[str, Clip]) -> None:
    """The long take (metres, 65 joints, rest pose along -Z) on THANKS (cm, 52 joints): arm bones point the same way."""
    thanks, take = real_clips["isl_thanks"], real_clips["long_take_metres"]
    out = align(take, reference(thanks)).clip
    ours, theirs = rig_info(out.skeleton).roles.joints, rig_info(take.skeleton).roles.joints
    stand_ours, stand_theirs = placement(out), placement(take)

    def directions(clip: Clip, joints: dict[str, int], stand: Placement) -> Float:
        left = np.cross(stand.up, stand.forward)
        axes = np.stack([left, stand.up, stand.forward])
        places = kinematics.forward(clip)[1] @ axes.T
        bones = [
            ("Shoulder", "UpperArm"),
            ("UpperArm", "LowerArm"),
            ("LowerArm", "Hand"),
            ("IndexProximal", "IndexIntermediate"),
        ]
        pairs = [(joints[side + a], joints[side + b]) for side in ("left", "right") for a, b in bones]
        ways = np.stack([places[:, b] - places[:, a] for a, b in pairs], axis=1)
        return np.asarray(ways / np.linalg.norm(ways, axis=-1, keepdims=True))

    a, b = directions(out, dict(ours), stand_ours), directions(take, dict(theirs), stand_theirs)
    angle = np.rad2deg(np.arccos(np.clip(np.sum(a * b, axis=-1), -1.0, 1.0)))
    assert angle.max() < 10.0
