"""body.mesh and body.surface_nets: closed meshes that follow the body's capsules when the joints move them."""

from __future__ import annotations

import numpy as np
import pytest

from signing import word
from signsplice.body import capsules, collision
from signsplice.body.mesh import bind_pose, body_mesh
from signsplice.body.mesh_part import MeshPart
from signsplice.body.surface_nets import surface
from signsplice.motion import kinematics, rotation
from signsplice.motion.clip import Clip, Skeleton
from signsplice.rig.roles import FINGERS

CLIP = word("BOOK").clip


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
    assert {"shirt", "face", "hair", "eye", "mouth", "left hand", "right hand", "left leg", "right leg"} <= names
    assert sum(name.endswith("Tip") for name in names) == 10
    assert parts["left hand"].colour != parts["right hand"].colour


def test_every_part_is_closed_and_bound_to_joints() -> None:
    for part in mesh_parts().values():
        assert count_edges(part.triangles) > 0
        np.testing.assert_array_equal(np.unique(part.triangles), np.arange(len(part.vertices)), "every vertex is used")
        np.testing.assert_allclose(part.weights.sum(axis=1), 1.0, atol=1e-12)
        assert (part.weights[:, 0] > 0.0).all()
        assert (part.joints[part.weights == 0.0] == 0).all()
        assert part.joints.max() < len(CLIP.skeleton)


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
    posed = collision.posed_capsules(CLIP.skeleton, rotations, positions)
    bind = bind_pose(CLIP.skeleton)
    wrist = CLIP.skeleton.index["mixamorig:RightHand"]
    for name, side, parts in (
        ("right hand", "right", {"palm", *FINGERS}),
        ("right IndexTip", "right", {"IndexTip"}),
        ("face", "", {"face", "nose", "neck"}),
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
