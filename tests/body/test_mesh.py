"""body.mesh: the figure has the proportions of any rig, and lies on the body's capsules when the joints move it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from signing import word
from signsplice.body import capsules, collision
from signsplice.body.capsules import BodyShape, MeshPart, build_capsules
from signsplice.body.mesh import bind_pose, body_mesh, figure_mesh
from signsplice.motion import Clip, Skeleton, kinematics, rotation
from signsplice.motion.face import ARKIT_CHANNELS
from signsplice.rig.info import rig_info
from signsplice.rig.roles import FINGERS
from signsplice.rig.t_pose import positions_from_rotations
from signsplice_workshop.figure.blends import distances_from, pose_capsules, union

CLIP = word("BOOK").clip
STATURE = rig_info(CLIP.skeleton).sizes.stature


def count_edges(triangles: np.ndarray) -> int:
    """The number of edges of a closed mesh: every edge is passed as often in one direction as in the other."""
    a, b = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]).T.astype(np.int64)
    n = triangles.max() + 1
    np.testing.assert_array_equal(np.sort(a * n + b), np.sort(b * n + a), "not closed")
    return len(a) // 2


def mesh_parts() -> dict[str, MeshPart]:
    """The parts of the mannequin by name."""
    return {part.name: part for part in body_mesh(CLIP.skeleton)}


def test_the_figure_is_made_once_and_has_clothes_hands_and_a_face() -> None:
    assert body_mesh(CLIP.skeleton) is body_mesh(CLIP.skeleton)
    parts = mesh_parts()
    assert {"shirt", "trim", "trousers", "left shoe", "face", "hair", "eye", "teeth", "left hand"} <= set(parts)
    assert parts["left hand"].colour != parts["right hand"].colour
    assert sum(len(part.triangles) for part in parts.values()) < 41_000


def test_every_vertex_is_used_and_bound_to_joints() -> None:
    for part in mesh_parts().values():
        np.testing.assert_array_equal(np.unique(part.triangles), np.arange(len(part.vertices)), "every vertex is used")
        np.testing.assert_allclose(part.weights.sum(axis=1), 1.0, atol=1e-12)
        np.testing.assert_allclose(np.linalg.norm(part.normals, axis=1), 1.0, atol=1e-12)
        assert (part.weights[:, 0] > 0.0).all()
        assert (part.joints[part.weights == 0.0] == 0).all()
        assert part.joints.max() < len(CLIP.skeleton)


def merge(parts: list[MeshPart]) -> np.ndarray:
    """The triangles (F, 3) of parts as one, vertices at one place being one."""
    starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    triangles = np.concatenate([part.triangles + k for part, k in zip(parts, starts[:-1], strict=True)])
    _, same = np.unique(np.concatenate([part.vertices for part in parts]).round(6), axis=0, return_inverse=True)
    merged = same.ravel()[triangles]
    return np.asarray(merged[(merged != np.roll(merged, 1, axis=1)).all(axis=1)])


def test_a_hand_is_closed_with_its_nails() -> None:
    for side in ("left", "right"):
        hand, nails = (mesh_parts()[f"{side} {kind}"] for kind in ("hand", "nails"))
        assert count_edges(merge([hand, nails])) > 0
        assert 0.005 < len(nails.triangles) / len(hand.triangles) < 0.1


def test_the_shirt_has_holes_only_at_hem_collar_and_cuffs() -> None:
    """Where the collar and a cuff begin, their walls hide the rims: four lines at the hem, collar and both cuffs."""
    shirt = mesh_parts()["shirt"]
    triangles = merge([shirt])
    edges = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
    pairs, counts = np.unique(edges, axis=0, return_counts=True)
    assert counts.max() <= 2
    rim = pairs[counts == 1]
    graph = coo_array((np.ones(len(rim)), rim.T), (triangles.max() + 1,) * 2)
    assert connected_components(graph, directed=False)[0] - (triangles.max() + 1 - len(np.unique(rim))) == 4


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
    name, side, parts = "right hand", "right", {"palm", *FINGERS, *(f"{finger}Tip" for finger in FINGERS)}
    mesh = mesh_parts()[name]
    capsule_rows = [
        n
        for n, (part, of_side) in enumerate(zip(body.parts, body.sides, strict=True))
        if part in parts and of_side == side
    ]
    has_capsule = mesh.joints[:, 0] >= wrist  # the end of the forearm has none here
    for frame in (0, len(CLIP) // 2):
        points = skinned(mesh, rotations[frame], positions[frame], *bind)[has_capsule]
        starts, ends = (np.concatenate([at[frame, capsule_rows], points])[None] for at in (posed.starts, posed.ends))
        radii = np.concatenate([body.radii[capsule_rows], np.zeros((len(points), 2))])
        rows = range(len(capsule_rows), len(capsule_rows) + len(points))
        depths = collision.overlap(starts, ends, radii, rows, range(len(capsule_rows)))[0][0].max(axis=1)
        # In a palm the mesh lies higher between the bones, since their capsules are blended.
        assert np.median(np.abs(depths)) < 0.25, f"{name} at {frame}, cm"
        assert np.quantile(np.abs(depths), 0.95) < 1.0, f"{name} at {frame}, cm"


def test_clothes_lie_on_the_capsules_that_hands_touch() -> None:
    body = capsules.body_capsules(CLIP.skeleton)
    rows = [n for n, part in enumerate(body.parts) if part in ("shirt", "sleeve", "cuff")]
    shirt = mesh_parts()["shirt"].vertices
    joints = rig_info(CLIP.skeleton).roles.joints
    elbows = bind_pose(CLIP.skeleton)[1][[joints[f"{side}LowerArm"] for side in ("left", "right")]]
    shirt = shirt[(np.linalg.norm(shirt[:, None] - elbows, axis=2) > 3.01).all(axis=1)]  # without the balls within
    away = union(distances_from(shirt, pose_capsules(CLIP.skeleton, body, rows)), 0.0085 * STATURE)
    across, height, in_front = np.abs(shirt[:, 0]), shirt[:, 1], shirt[:, 2] > 0.0
    for name, chosen in {
        "chest": (across < 14.0) & (height > 22.0) & (height < 40.0) & in_front,
        "belly": (across < 14.0) & (height > -8.0) & (height < 14.0) & in_front,
        "upper arms": (across > 22.0) & (across < 46.0) & (height > 35.0),
        "forearms": (across > 50.0) & (height > 35.0),
    }.items():
        assert chosen.sum() > 50, name
        assert np.median(np.abs(away[chosen])) < 0.7, f"{name}, cm"
        assert np.quantile(np.abs(away[chosen]), 0.95) < 1.5, f"{name}, cm"


def turned(skeleton: Skeleton, turns: list[tuple[str, list[float], float]]) -> tuple[np.ndarray, np.ndarray]:
    """Global rotations (J, 3, 3) and positions (J, 3) of a T-pose in which roles turn, with all below them, by degrees
    about an axis of the world.
    """
    info = rig_info(skeleton)
    quats = info.t_pose.rotations.copy()
    for role, axis, degrees in turns:
        for joint in kinematics.subtree(skeleton, info.roles.joints[role]):
            quats[joint] = rotation.multiply(rotation.exp(np.deg2rad(degrees) * np.array(axis)), quats[joint])
    return rotation.to_matrix(quats), positions_from_rotations(skeleton, quats)


@pytest.mark.parametrize("degrees", [30.0, 60.0, 90.0, 120.0, 140.0])
def test_a_bent_elbow_neither_collapses_nor_balloons(degrees: float) -> None:
    """The skin at the elbow stays around its joint, and the arm keeps its volume."""
    joint = rig_info(CLIP.skeleton).roles.joints["leftLowerArm"]
    shirt, bind = mesh_parts()["shirt"], bind_pose(CLIP.skeleton)
    straight = skinned(shirt, *turned(CLIP.skeleton, []), *bind)
    rotations, positions = turned(CLIP.skeleton, [("leftLowerArm", [0.0, -1.0, 0.0], degrees)])
    bent = skinned(shirt, rotations, positions, *bind)
    near = np.linalg.norm(straight - positions[joint], axis=1) < 5.0
    assert near.sum() > 30
    away = np.linalg.norm(bent - positions[joint], axis=1)[near]
    assert away.max() < 6.5, "cm"
    bisector = np.array([np.cos(np.deg2rad(90.0 - 0.5 * degrees)), 0.0, -np.sin(np.deg2rad(90.0 - 0.5 * degrees))])
    assert ((bent - positions[joint]) @ bisector)[near].max() > 2.4, "the point of the elbow, cm"
    up = (bent - positions[joint])[near, 1]
    assert up.max() - up.min() > 5.5, "thickness across the bend, cm"


@pytest.fixture(scope="module")
def tall() -> Skeleton:
    """The words' skeleton with arms longer by a quarter and in metres."""
    joints, offsets = rig_info(CLIP.skeleton).roles.joints, 0.01 * CLIP.skeleton.offsets
    for role in ("leftLowerArm", "leftHand", "rightLowerArm", "rightHand"):
        offsets[joints[role]] *= 1.25
    sites = tuple(replace(site, offset=0.01 * site.offset) for site in CLIP.skeleton.end_sites)
    return replace(CLIP.skeleton, offsets=offsets, end_sites=sites)


def test_the_figure_takes_the_proportions_of_a_rig(tall: Skeleton) -> None:
    """Sleeves end at the same part of a longer forearm, hands keep their size, and units do not matter."""
    parts, usual = {part.name: part for part in body_mesh(tall)}, mesh_parts()
    assert set(parts) == set(usual)
    height, usual_height = rig_info(tall).sizes.stature, rig_info(CLIP.skeleton).sizes.stature
    _, positions = bind_pose(tall)
    _, usual_positions = bind_pose(CLIP.skeleton)
    joints = rig_info(tall).roles.joints
    ends = []
    for mesh, places in ((parts, positions), (usual, usual_positions)):
        elbow, wrist = (places[joints[f"left{role}"]][0] for role in ("LowerArm", "Hand"))
        ends.append((mesh["trim"].vertices[:, 0].max() - elbow) / (wrist - elbow))
    assert ends[0] == pytest.approx(ends[1], abs=0.02)
    hands = [
        mesh["left hand"].vertices[:, 0].max() - places[joints["leftHand"]][0]
        for mesh, places in ((parts, positions), (usual, usual_positions))
    ]
    assert hands[0] == pytest.approx(0.01 * hands[1], rel=0.02)
    face, usual_face = (np.ptp(mesh["hair"].vertices, axis=0) for mesh in (parts, usual))
    np.testing.assert_allclose(face / height, usual_face / usual_height, rtol=0.02)


def test_a_body_of_another_build_has_a_figure_of_that_build() -> None:
    slim, stout = (
        {part.name: part for part in figure_mesh(CLIP.skeleton, build_capsules(CLIP.skeleton, shape))}
        for shape in (BodyShape(limbs=0.8), BodyShape(limbs=1.25, head=1.1))
    )
    wrists = [np.ptp(mesh["trim"].vertices[mesh["trim"].vertices[:, 0] > 55.0], axis=0)[1] for mesh in (slim, stout)]
    assert wrists[1] > 1.15 * wrists[0]
    assert np.ptp(stout["hair"].vertices, axis=0)[0] > 1.05 * np.ptp(slim["hair"].vertices, axis=0)[0]


def without(skeleton: Skeleton, *words: str) -> Skeleton:
    """The skeleton without the joints in whose names one of the words is."""
    kept = [n for n, name in enumerate(skeleton.names) if not any(word in name for word in words)]
    number = {joint: n for n, joint in enumerate(kept)}
    parents = np.array([-1, *(number[int(skeleton.parents[joint])] for joint in kept[1:])])
    names = tuple(skeleton.names[joint] for joint in kept)
    return Skeleton(names, parents, skeleton.offsets[kept])


def test_rigs_without_fingers_legs_or_a_head_have_the_rest_of_the_figure() -> None:
    bare = {part.name: part for part in body_mesh(without(CLIP.skeleton, "LeftHandIndex", "LeftHandRing"))}
    assert count_edges(bare["left hand"].triangles) > 0, "closed capsules for a hand that lacks fingers"
    assert "left nails" not in bare
    assert "right nails" in bare
    half = {part.name for part in body_mesh(without(CLIP.skeleton, "UpLeg", "Leg", "Foot", "Toe"))}
    assert {"shirt", "face", "left hand"} <= half
    assert half.isdisjoint({"trousers", "left shoe", "right shoe"})
    headless = {part.name for part in body_mesh(without(CLIP.skeleton, "Head", "Neck", "Eye"))}
    assert "shirt" in headless
    assert headless.isdisjoint({"face", "hair", "eye"})


def test_the_figures_head_lies_on_the_capsules_that_hands_touch() -> None:
    """From 48 sides, the outermost skin is within 6 mm of the capsules, save at eyes and ears, and hair lies above."""
    body, joint = capsules.body_capsules(CLIP.skeleton), CLIP.skeleton.index["mixamorig:Head"]
    _, positions = bind_pose(CLIP.skeleton)
    rows = [n for n, part in enumerate(body.parts) if part in ("face", "nose", "hair", "neck")]
    own = pose_capsules(CLIP.skeleton, body, rows)
    points = np.concatenate([mesh_parts()[name].vertices for name in ("face", "hair")])
    since = points - positions[joint] - [0.0, 8.0, 1.0]
    far = np.linalg.norm(since, axis=1)
    steps = np.arange(48)
    up, around = 1.0 - 2.0 * (steps + 0.5) / 48.0, np.pi * (3.0 - np.sqrt(5.0)) * steps
    sides = np.stack([np.sqrt(1 - up**2) * np.cos(around), up, np.sqrt(1 - up**2) * np.sin(around)], axis=1)
    near = sides @ (since / far[:, None]).T > np.cos(np.deg2rad(12.0))
    outer = [int(np.argmax(np.where(row, far, 0.0))) for row in near[up > -0.6]]
    off = union(distances_from(points[outer], own), 0.0035 * STATURE)
    is_hair = np.array(outer) >= len(mesh_parts()["face"].vertices)
    assert np.quantile(np.abs(off[~is_hair]), 0.85) < 0.6, "cm"
    assert np.abs(off[~is_hair]).max() < 1.8, "an ear"
    assert off[is_hair].min() > -0.3, "cm"
    assert np.median(off[is_hair]) < 1.0, "cm"
    assert off[is_hair].max() < 1.5, "cm"


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
