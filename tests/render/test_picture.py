"""Pictures of a signer: the mesh follows the joints, the camera shows both hands, and units do not matter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from conftest import random_clip

from signsplice.body.capsules import body_capsules, capsule_ends
from signsplice.body.mesh import PART_COLOURS, bind_pose, body_mesh
from signsplice.errors import InputError
from signsplice.motion import Clip, Skeleton, kinematics, rotation
from signsplice.render.picture import deform_skin, draw, draw_hand, make_scene


def test_the_skin_follows_its_joints(words: dict[str, Clip]) -> None:
    """Against linear blend skinning computed vertex by vertex."""
    clip = words["SIGN"]
    scene = make_scene(clip)
    points, normals = deform_skin(scene, 30)
    rotations, positions = kinematics.forward(clip)
    bound_quats, bound_positions = bind_pose(clip.skeleton)
    bound_rotations = rotation.to_matrix(bound_quats)
    parts = body_mesh(clip.skeleton)
    vertices = np.concatenate([part.vertices for part in parts])
    joints = np.concatenate([part.joints for part in parts])
    weights = np.concatenate([part.weights for part in parts])
    for n in np.random.default_rng(0).integers(len(vertices), size=200):
        world = np.zeros(3)
        for joint, weight in zip(joints[n], weights[n], strict=True):
            local = bound_rotations[joint].T @ (vertices[n] - bound_positions[joint])
            world += weight * (rotations[30, joint] @ local + positions[30, joint])
        expected = scene.axes @ (world - scene.origin) / scene.height
        assert np.abs(points[n] - expected).max() < 1e-5
    assert np.abs(np.linalg.norm(normals, axis=1) - 1.0).max() < 1e-5


def test_the_capsules_follow_the_joints(words: dict[str, Clip]) -> None:
    clip = words["HELLO"]
    body = body_capsules(clip.skeleton)
    rotations, positions = kinematics.forward(clip)
    starts, ends = capsule_ends(body, rotations, positions)
    index = clip.skeleton.index
    for c, (part, side) in enumerate(zip(body.parts, body.sides, strict=True)):
        if part == "Index" and side == "right" and body.joints[c] == index["mixamorig:RightHandIndex1"]:
            assert np.allclose(starts[:, c], positions[:, index["mixamorig:RightHandIndex1"]])
            assert np.allclose(ends[:, c], positions[:, index["mixamorig:RightHandIndex2"]])
            break
    else:
        pytest.fail("no index finger")
    fingers = {(part.removesuffix("Tip"), side) for part, side in zip(body.parts, body.sides, strict=True)}
    assert {
        (finger, side) for finger in ("Thumb", "Index", "Middle", "Ring", "Little") for side in ("left", "right")
    } <= fingers
    assert (body.radii > 0.0).all()


def test_both_hands_are_in_the_window_in_every_frame(words: dict[str, Clip]) -> None:
    for clip in words.values():
        scene = make_scene(clip)
        left, right, bottom, top = scene.window
        hands = np.unique(scene.skin.triangles[scene.skin.hands != ""])
        for frame in range(0, len(clip), 4):
            at = deform_skin(scene, frame)[0][hands]
            assert (at[:, 0] > left).all()
            assert (at[:, 0] < right).all()
            assert (at[:, 1] > bottom).all()
            assert (at[:, 1] < top).all()


def test_the_signers_right_hand_is_on_the_viewers_left(words: dict[str, Clip]) -> None:
    scene = make_scene(words["HELLO"])
    assert scene.hands[30, 1, 0] < scene.hands[30, 0, 0]
    assert scene.hands[30, 1, 1] > scene.hands[30, 0, 1] + 0.3, "and it is the one that is raised"


def test_a_hand_in_front_of_the_chest_is_so_from_the_side(words: dict[str, Clip]) -> None:
    """Seen from the signer's left, forward is to the left: a signing hand is there, in front of the trunk."""
    side, front = make_scene(words["SIGN"], "side"), make_scene(words["SIGN"])
    shirt = np.unique(side.skin.triangles[(side.skin.tints == np.array(PART_COLOURS["shirt"], np.float32)).all(axis=1)])
    trunk = shirt[np.isin(side.skin.weights[shirt].toarray().argmax(axis=1), range(4))]  # hips and spine
    assert len(trunk) > 1000
    assert side.hands[30, :, 0].max() < deform_skin(side, 30)[0][trunk, 0].min()
    assert front.hands[30, :, 2].min() > deform_skin(front, 30)[0][trunk, 2].max()


@pytest.fixture(scope="module")
def metric_skeleton(words: dict[str, Clip]) -> Skeleton:
    """The words' skeleton in metres instead of centimetres."""
    skeleton = words["SIGN"].skeleton
    sites = tuple(replace(site, offset=site.offset * 0.01) for site in skeleton.end_sites)
    return replace(skeleton, offsets=skeleton.offsets * 0.01, end_sites=sites)


def test_position_and_facing_do_not_change_the_picture(words: dict[str, Clip], metric_skeleton: Skeleton) -> None:
    clip = words["SIGN"]
    turn = rotation.exp([0.0, 2.0, 0.0])
    local = np.array(clip.local_rotations)
    local[:, 0] = rotation.multiply(turn, local[:, 0])
    roots = (rotation.rotate(turn, clip.root_positions) + 55.0) * 0.01
    other = replace(clip, skeleton=metric_skeleton, local_rotations=local, root_positions=roots)
    a, b = (draw(make_scene(c), 30, 160, 160).astype(int) for c in (clip, other))
    assert np.mean(np.abs(a - b) > 8) < 0.002


def test_metres_and_centimetres_give_the_same_picture(words: dict[str, Clip], metric_skeleton: Skeleton) -> None:
    clip = words["SIGN"]
    other = replace(clip, skeleton=metric_skeleton, root_positions=clip.root_positions * 0.01)
    a, b = (draw(make_scene(c), 30, 120, 120).astype(int) for c in (clip, other))
    assert np.abs(a - b).max() <= 1, "rounding"


def test_bone_lengths_of_the_frames_are_drawn_not_the_offsets(words: dict[str, Clip]) -> None:
    """A file's position channels replace its OFFSETs, which may even be zero."""
    clip = words["HELLO"]
    shown = np.broadcast_to(clip.skeleton.offsets, (len(clip), len(clip.skeleton), 3))
    skeleton = replace(clip.skeleton, offsets=clip.skeleton.offsets * 0.0)
    plain = draw(make_scene(clip), 30, 160, 160).astype(int)
    other = draw(make_scene(replace(clip, skeleton=skeleton, translations=shown)), 30, 160, 160)
    assert np.mean(np.abs(plain - other) > 8) < 0.002


def test_enlarged_hands_are_large_and_differ_by_handshape(words: dict[str, Clip]) -> None:
    """A flat hand and a pointing one are plainly different pictures of a plainly visible hand."""
    flat, index = (draw_hand(make_scene(words[w]), f, "right", 76).astype(int) for w, f in (("HELLO", 28), ("I", 24)))
    paper = np.array([244, 241, 236])
    for image in (flat, index):
        assert np.mean(np.abs(image - paper).max(axis=-1) > 20) > 0.08
    assert np.mean(np.abs(flat - index).max(axis=-1) > 20) > 0.05


def test_any_skeleton_can_be_drawn() -> None:
    clip = random_clip(0)
    image = draw(make_scene(clip), 3, 120, 120)
    assert image.shape == (120, 120, 3)
    assert len(np.unique(image.reshape(-1, 3), axis=0)) > 10
    with pytest.raises(InputError, match="no view 'top', expected one of front"):
        make_scene(clip, "top")
