"""The mannequin: closed skins, carried by the joints, that follow the body's capsules."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from signing import word
from signsplice.body import capsules, collision
from signsplice.body.mesh import MeshPart, bind_pose, body_mesh
from signsplice.body.surface_nets import surface
from signsplice.motion import kinematics, rotation
from signsplice.motion.clip import Clip, Skeleton
from signsplice.rig.roles import FINGERS

CLIP = word("BOOK").clip


def test_a_ball_and_a_ring_are_closed_and_smooth() -> None:
    def ball(points: np.ndarray) -> np.ndarray:
        return np.asarray(np.linalg.norm(points - [0.1, 0.2, 0.3], axis=1) - 1.0)

    def ring(points: np.ndarray) -> np.ndarray:
        return np.asarray(np.hypot(np.hypot(points[:, 0], points[:, 1]) - 1.0, points[:, 2]) - 0.3)

    for field, holes, volume in ((ball, 0, 4.0 / 3.0 * np.pi), (ring, 1, 2.0 * np.pi**2 * 0.09)):
        vertices, normals, triangles = surface(field, np.full(3, -1.6), np.full(3, 1.6), 0.08)
        np.testing.assert_allclose(field(vertices), 0.0, atol=1e-4)
        np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-9)
        edges = closed(triangles)
        assert len(vertices) - edges + len(triangles) == 2 - 2 * holes, "Euler's number"
        a, b, c = (vertices[triangles[:, k]] for k in range(3))
        inside = np.einsum("fa,fa->f", a, np.cross(b, c)).sum() / 6.0
        assert inside == pytest.approx(volume, rel=0.02), "counter-clockwise from outside"


def closed(triangles: np.ndarray) -> int:
    """The number of edges, each of which has one triangle on either side."""
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    there = Counter(map(tuple, edges.tolist()))
    assert all(there[b, a] == n for (a, b), n in there.items())
    return len(edges) // 2


def test_nothing_to_see_is_an_error() -> None:
    with pytest.raises(ValueError, match="no surface between"):
        surface(lambda points: np.ones(len(points)), np.zeros(3), np.ones(3), 0.1)


def things() -> dict[str, MeshPart]:
    return {thing.name: thing for thing in body_mesh(CLIP.skeleton)}


def test_it_is_made_once_and_has_two_hands_a_face_and_ten_fingertips() -> None:
    assert body_mesh(CLIP.skeleton) is body_mesh(CLIP.skeleton)
    names = set(things())
    assert {"shirt", "face", "hair", "eye", "mouth", "left hand", "right hand", "left leg", "right leg"} <= names
    assert sum(name.endswith("Tip") for name in names) == 10
    assert things()["left hand"].colour != things()["right hand"].colour


def test_every_skin_is_closed_and_carried_whole() -> None:
    for thing in things().values():
        closed(thing.triangles)
        assert set(range(len(thing.vertices))) == set(thing.triangles.ravel().tolist())
        np.testing.assert_allclose(thing.weights.sum(axis=1), 1.0, atol=1e-12)
        assert (thing.weights[:, 0] > 0.0).all()
        assert (thing.joints[thing.weights == 0.0] == 0).all()
        assert thing.joints.max() < len(CLIP.skeleton)


def test_a_hand_has_five_fingers_that_part() -> None:
    """Cut across the fingers, a hand is five rings, or four with the thumb aside."""
    for side, sign in (("left", 1.0), ("right", -1.0)):
        hand = things()[f"{side} hand"]
        _, places = bind_pose(CLIP.skeleton)
        knuckle = places[CLIP.skeleton.index[f"mixamorig:{side.title()}HandMiddle1"]]
        joint = places[CLIP.skeleton.index[f"mixamorig:{side.title()}HandMiddle2"]]
        cut = knuckle[0] + 0.75 * (joint[0] - knuckle[0])
        band = np.abs(hand.vertices[:, 0] - cut) < 0.3
        across = np.sort(hand.vertices[band, 2])
        gaps = np.diff(across)
        assert sign * cut > 0.0
        assert (gaps > 0.15).sum() >= 3, "between four fingers"


def test_the_skin_goes_where_the_capsules_go() -> None:
    """Bent by its joints, the skin of a hand lies on the capsules of the hand in every frame."""
    turns, positions = kinematics.forward(CLIP)
    shape = capsules.body_capsules(CLIP.skeleton)
    posed = collision.posed_capsules(CLIP.skeleton, turns, positions)
    rotations, places = bind_pose(CLIP.skeleton)
    wrist = CLIP.skeleton.index["mixamorig:RightHand"]
    for name, side, parts in (
        ("right hand", "right", {"palm", *FINGERS}),
        ("right IndexTip", "right", {"IndexTip"}),
        ("face", "", {"face", "nose", "neck"}),
    ):
        thing = things()[name]
        own = [
            n
            for n, known in enumerate(zip(shape.parts, shape.sides, strict=True))
            if known in {(p, side) for p in parts}
        ]
        on_it = (thing.joints[:, 0] >= wrist) | (side == "")  # the forearm's end has no capsule of its own
        for frame in (0, len(CLIP) // 2):
            skin = skinned(thing, turns[frame], positions[frame], rotations, places)[on_it]
            starts, ends = (np.concatenate([at[frame, own], skin])[None] for at in (posed.starts, posed.ends))
            radii = np.concatenate([shape.radii[own], np.zeros((len(skin), 2))])
            points = range(len(own), len(own) + len(skin))
            off = collision.overlap(starts, ends, radii, points, range(len(own)))[0][0].max(axis=1)
            # Between the bones of a palm the skin lies higher, since they flow together.
            assert np.median(np.abs(off)) < 0.25, f"{name} at {frame}, cm"
            assert np.quantile(np.abs(off), 0.95) < 1.0, f"{name} at {frame}, cm"


def skinned(
    thing: MeshPart, turns: np.ndarray, positions: np.ndarray, rotations: np.ndarray, places: np.ndarray
) -> np.ndarray:
    """Linear blend skinning, vertex by vertex and joint by joint."""
    out = np.zeros_like(thing.vertices)
    own = rotation.to_matrix(rotations)
    for k in range(thing.joints.shape[1]):
        joint = thing.joints[:, k]
        local = np.einsum("vba,vb->va", own[joint], thing.vertices - places[joint])
        out += thing.weights[:, k, None] * (positions[joint] + np.einsum("vab,vb->va", turns[joint], local))
    return out


def test_rigs_without_names_and_of_one_joint_have_a_skin_too() -> None:
    chain = Skeleton(("a", "b", "c"), np.array([-1, 0, 1]), np.array([[0.0, 0, 0], [0, 1, 0], [0, 1, 0]]))
    for skeleton in (chain, Skeleton(("a",), np.array([-1]), np.zeros((1, 3)))):
        (thing,) = body_mesh(skeleton)
        closed(thing.triangles)
        clip = Clip(skeleton, np.tile(rotation.IDENTITY, (2, len(skeleton), 1)), np.zeros((2, 3)), 30.0)
        turns, positions = kinematics.forward(clip)
        assert np.isfinite(skinned(thing, turns[0], positions[0], *bind_pose(skeleton))).all()
