"""body.mesh and body.surface_nets: closed meshes that follow the body's capsules when the joints move them."""

from __future__ import annotations

import numpy as np
import pytest

from signing import word
from signsplice.body import capsules, collision
from signsplice.body.capsules import MeshPart
from signsplice.body.mesh import _distances, _MeshCapsules, _union, bind_pose, body_mesh
from signsplice.body.surface_nets import surface
from signsplice.motion import Clip, Skeleton, kinematics, rotation
from signsplice.motion.face import ARKIT_CHANNELS
from signsplice.rig.info import rig_info
from signsplice.rig.roles import FINGERS

CLIP = word("BOOK").clip
HEAD = {"face", "lips", "eye", "iris", "pupil", "lash", "brow", "teeth", "tongue", "hair"}


def test_the_surface_of_a_ball_and_of_a_ring_is_closed() -> None:
    def ball(points: np.ndarray) -> np.ndarray:
        return np.asarray(np.linalg.norm(points - [0.1, 0.2, 0.3], axis=1) - 1.0)

    def ring(points: np.ndarray) -> np.ndarray:
        return np.asarray(np.hypot(np.hypot(points[:, 0], points[:, 1]) - 1.0, points[:, 2]) - 0.3)

    for field, holes, volume in ((ball, 0, 4.0 / 3.0 * np.pi), (ring, 1, 2.0 * np.pi**2 * 0.09)):
        vertices, normals, triangles = surface(field, np.full(3, -1.6), np.full(3, 1.6), 0.08)
        np.testing.assert_allclose(field(vertices), 0.0, atol=1e-4)
        np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-9)
        n_edges = count_edges(triangles)
        assert len(vertices) - n_edges + len(triangles) == 2 - 2 * holes, "Euler characteristic"
        a, b, c = (vertices[triangles[:, k]] for k in range(3))
        signed_volume = np.einsum("fa,fa->f", a, np.cross(b, c)).sum() / 6.0
        assert signed_volume == pytest.approx(volume, rel=0.02), "counter-clockwise from outside"


def count_edges(triangles: np.ndarray) -> int:
    """The number of edges of a closed mesh: every edge is passed as often in one direction as in the other."""
    a, b = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]).T.astype(np.int64)
    n = triangles.max() + 1
    np.testing.assert_array_equal(np.sort(a * n + b), np.sort(b * n + a), "not closed")
    return len(a) // 2


def test_a_field_without_an_inside_is_refused() -> None:
    with pytest.raises(ValueError, match="no surface between"):
        surface(lambda points: np.ones(len(points)), np.zeros(3), np.ones(3), 0.1)


def mesh_parts() -> dict[str, MeshPart]:
    """The parts of the mannequin by name."""
    return {part.name: part for part in body_mesh(CLIP.skeleton)}


def test_the_mannequin_is_made_once_and_has_hands_and_a_face() -> None:
    assert body_mesh(CLIP.skeleton) is body_mesh(CLIP.skeleton)
    parts = mesh_parts()
    names = set(parts)
    assert {"shirt", "face", "hair", "eye", "lips", "left hand", "right hand", "left leg", "right leg"} <= names
    assert sum(name.endswith("Tip") for name in names) == 10
    assert parts["left hand"].colour != parts["right hand"].colour


def test_every_part_is_closed_and_bound_to_joints() -> None:
    for part in mesh_parts().values():
        if part.name not in HEAD and not part.name.endswith(("hand", "creases")):  # skin is open at mouth, eyes, neck
            assert count_edges(part.triangles) > 0
        np.testing.assert_array_equal(np.unique(part.triangles), np.arange(len(part.vertices)), "every vertex is used")
        np.testing.assert_allclose(part.weights.sum(axis=1), 1.0, atol=1e-12)
        assert (part.weights[:, 0] > 0.0).all()
        assert (part.joints[part.weights == 0.0] == 0).all()
        assert part.joints.max() < len(CLIP.skeleton)


def test_a_hand_is_closed_with_its_creases() -> None:
    for side in ("left", "right"):
        hand, creases = (mesh_parts()[f"{side} {kind}"] for kind in ("hand", "creases"))
        triangles = np.concatenate([hand.triangles, creases.triangles + len(hand.vertices)])
        _, same = np.unique(np.concatenate([hand.vertices, creases.vertices]), axis=0, return_inverse=True)
        assert count_edges(same.ravel()[triangles]) > 0
        assert 0.005 < len(creases.triangles) / len(triangles) < 0.1


def test_the_fingers_of_a_hand_are_separate() -> None:
    """A plane across the fingers, away from the thumb, cuts a hand into four rings."""
    _, positions = bind_pose(CLIP.skeleton)
    for side, sign in (("left", 1.0), ("right", -1.0)):
        hand = mesh_parts()[f"{side} hand"]
        knuckle, joint = (
            positions[CLIP.skeleton.index[f"mixamorig:{side.title()}HandMiddle{number}"]] for number in (1, 2)
        )
        plane = knuckle[0] + 0.75 * (joint[0] - knuckle[0])
        near_plane = np.abs(hand.vertices[:, 0] - plane) < 0.3
        gaps = np.diff(np.sort(hand.vertices[near_plane, 2]))
        assert sign * plane > 0.0
        assert (gaps > 0.15).sum() >= 3, "between four fingers"


def test_the_mesh_follows_the_capsules() -> None:
    """Moved by its joints, the mesh of a hand lies on the capsules of the hand in every frame."""
    rotations, positions = kinematics.forward(CLIP)
    body = capsules.body_capsules(CLIP.skeleton)
    posed = collision.pose_capsules(CLIP.skeleton, rotations, positions)
    bind = bind_pose(CLIP.skeleton)
    wrist = CLIP.skeleton.index["mixamorig:RightHand"]
    for name, side, parts in (
        ("right hand", "right", {"palm", *FINGERS}),
        ("right IndexTip", "right", {"IndexTip"}),
    ):
        mesh = mesh_parts()[name]
        capsule_rows = [
            n
            for n, (part, of_side) in enumerate(zip(body.parts, body.sides, strict=True))
            if part in parts and of_side == side
        ]
        has_capsule = (mesh.joints[:, 0] >= wrist) | (side == "")  # the end of the forearm has none here
        for frame in (0, len(CLIP) // 2):
            points = skinned(mesh, rotations[frame], positions[frame], *bind)[has_capsule]
            starts, ends = (
                np.concatenate([at[frame, capsule_rows], points])[None] for at in (posed.starts, posed.ends)
            )
            radii = np.concatenate([body.radii[capsule_rows], np.zeros((len(points), 2))])
            rows = range(len(capsule_rows), len(capsule_rows) + len(points))
            depths = collision.overlap(starts, ends, radii, rows, range(len(capsule_rows)))[0][0].max(axis=1)
            # In a palm the mesh lies higher between the bones, since their capsules are blended.
            assert np.median(np.abs(depths)) < 0.25, f"{name} at {frame}, cm"
            assert np.quantile(np.abs(depths), 0.95) < 1.0, f"{name} at {frame}, cm"


def test_the_figures_head_lies_on_the_capsules_that_hands_touch() -> None:
    """From 48 sides, the outermost skin or hair is within 3 mm of the capsules, save at eyes and ears."""
    body, joint = capsules.body_capsules(CLIP.skeleton), CLIP.skeleton.index["mixamorig:Head"]
    rotations, positions = bind_pose(CLIP.skeleton)
    starts, ends = (p[0] for p in capsules.capsule_ends(body, rotation.to_matrix(rotations)[None], positions[None]))
    rows = [n for n, part in enumerate(body.parts) if part in ("face", "nose", "hair", "neck")]
    own = _MeshCapsules(starts[rows], ends[rows], body.radii[rows], body.joints[rows], np.arange(len(rows)))
    points = np.concatenate([mesh_parts()[name].vertices for name in ("face", "hair")])
    since = points - positions[joint] - [0.0, 8.0, 1.0]
    far = np.linalg.norm(since, axis=1)
    steps = np.arange(48)
    up, around = 1.0 - 2.0 * (steps + 0.5) / 48.0, np.pi * (3.0 - np.sqrt(5.0)) * steps
    sides = np.stack([np.sqrt(1 - up**2) * np.cos(around), up, np.sqrt(1 - up**2) * np.sin(around)], axis=1)
    near = sides @ (since / far[:, None]).T > np.cos(np.deg2rad(12.0))
    outer = [int(np.argmax(np.where(row, far, 0.0))) for row in near[up > -0.6]]
    off = np.abs(_union(_distances(points[outer], own), 0.0035 * rig_info(CLIP.skeleton).sizes.stature))
    assert np.quantile(off, 0.85) < 0.3, "cm"
    assert off.max() < 1.5, "an ear"


def test_the_figures_face_has_all_coefficients_and_each_moves_its_side() -> None:
    moved: dict[str, np.ndarray] = {}
    for part in mesh_parts().values():
        for name, (rows, moves) in part.morphs.items():
            at = part.vertices[rows] * np.abs(moves).sum(axis=1, keepdims=True)
            moved[name] = moved.get(name, np.zeros(3)) + at.sum(axis=0)
    assert {*moved} == {*ARKIT_CHANNELS}
    for name, at in moved.items():
        if name.startswith(("eye", "brow", "cheekSquint", "noseSneer")) and name.endswith(("Left", "Right")):
            assert (at[0] > 0.0) == name.endswith("Left"), name
    lids = next(part for part in mesh_parts().values() if part.name == "face").morphs["eyeBlinkLeft"][1]
    assert 0.5 < -lids[:, 1].min() < 1.6, "an upper lid comes down by its eye's height, cm"


def skinned(
    mesh: MeshPart, rotations: np.ndarray, positions: np.ndarray, bind_quats: np.ndarray, bind_positions: np.ndarray
) -> np.ndarray:
    """The vertices (V, 3) by linear blend skinning, from globals (J, 3, 3) and (J, 3), and those of the bind pose."""
    out = np.zeros_like(mesh.vertices)
    bind_rotations = rotation.to_matrix(bind_quats)
    for k in range(mesh.joints.shape[1]):
        joint = mesh.joints[:, k]
        local = np.einsum("vba,vb->va", bind_rotations[joint], mesh.vertices - bind_positions[joint])
        out += mesh.weights[:, k, None] * (positions[joint] + np.einsum("vab,vb->va", rotations[joint], local))
    return out


def test_rigs_without_known_joints_or_with_one_joint_have_a_mesh() -> None:
    chain = Skeleton(("a", "b", "c"), np.array([-1, 0, 1]), np.array([[0.0, 0, 0], [0, 1, 0], [0, 1, 0]]))
    for skeleton in (chain, Skeleton(("a",), np.array([-1]), np.zeros((1, 3)))):
        (part,) = body_mesh(skeleton)
        assert count_edges(part.triangles) > 0
        clip = Clip(skeleton, np.tile(rotation.IDENTITY, (2, len(skeleton), 1)), np.zeros((2, 3)), 30.0)
        rotations, positions = kinematics.forward(clip)
        assert np.isfinite(skinned(part, rotations[0], positions[0], *bind_pose(skeleton))).all()
