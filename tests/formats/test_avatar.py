"""Avatars: skeleton, mesh and body of .vrm and .glb files, and what is refused."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import avatars
import signsplice as ss
from signsplice.body.capsules import Avatar, BodyCapsules, BodyShape, build_capsules
from signsplice.errors import FormatError, InputError, LimitError
from signsplice.formats.reading import DEFAULT_LIMITS
from signsplice.lexicon import open_shipped_lexicon
from signsplice.motion import Skeleton, kinematics, rotation
from signsplice.rig.info import rig_info
from signsplice.rig.roles import SIDES
from signsplice.splicing.report import describe_retargeting

WAYS: dict[str, dict[str, Any]] = {
    "vrm 1.0": {"version": "1.0"},
    "vrm 0.x": {"version": "0.x", "weights": "u8"},
    "glb": {"version": "", "weights": "u16"},
    "sparse": {"version": "1.0", "sparse": True, "axes": False},
}


@pytest.fixture(scope="module")
def broad() -> Avatar:
    return avatars.body("broad")


def written(folder: Path, avatar: Avatar, **options: Any) -> Path:
    suffix = ".vrm" if options.get("version", "1.0") else ".glb"
    return avatars.write(folder / f"a{suffix}", avatar, avatars.tubes(avatar), **options)


@pytest.mark.parametrize("way", WAYS)
def test_an_avatar_is_read_as_it_stands(tmp_path: Path, broad: Avatar, way: str) -> None:
    read = ss.read_avatar(written(tmp_path, broad, **WAYS[way]))
    assert read.warnings == ()
    assert read.is_vrm == way.startswith(("vrm", "sparse"))
    assert {*broad.names} - {*read.names} == {"mixamorig:HeadTop_End"}, "without those of hair and skirt, and ends"
    order = [broad.index[name] for name in read.names]
    np.testing.assert_allclose(read.offsets, broad.offsets[order], atol=1e-6)
    assert names_of_roles(read) == names_of_roles(broad)
    parts = avatars.tubes(broad)
    for one, two in zip(read.mesh, parts, strict=False):
        np.testing.assert_allclose(one.vertices, two.vertices, atol=1e-5)
        np.testing.assert_array_equal(np.take(order, one.joints[:, 0]), two.joints[:, 0])


def names_of_roles(skeleton: Skeleton) -> dict[str, str]:
    return {role: skeleton.names[joint] for role, joint in rig_info(skeleton).roles.joints.items()}


@pytest.mark.parametrize("name", avatars.BODIES)
def test_capsules_follow_the_mesh(tmp_path: Path, name: str) -> None:
    avatar = avatars.body(name)
    read = ss.read_avatar(written(tmp_path, avatar))
    assert read.body is not None
    assert avatar.body is not None
    usual = build_capsules(avatar, BodyShape())
    assert read.body.keys == avatar.body.keys
    far, near = (surface_errors(avatar, body) for body in (usual, read.body))
    assert near.max() < 0.012, dict(zip(PLACES, near.round(3), strict=True))
    assert near.mean() < max(0.4 * far.mean(), 0.002)


PLACES = {
    "belly": ("belly1", 0.5, (0.0, 0.0, 1.0)),
    "breast": ("chest1", 0.2, (0.0, 0.0, 1.0)),
    "flank": ("chest0", 0.6, (1.0, 0.0, 0.0)),
    "chin": ("head1", 0.0, (0.0, -0.7, 0.7)),
    "cheek": ("head0", 0.0, (1.0, 0.0, 0.0)),
    "forehead": ("head0", 1.0, (0.0, 0.0, 1.0)),
    "nose": ("head2", 1.0, (0.0, 0.0, 1.0)),
    "crown": ("head3", 0.0, (0.0, 1.0, 0.0)),
    "nape": ("head3", 1.0, (0.0, 0.0, -1.0)),
    "throat": ("neck", 0.5, (0.0, 0.0, 1.0)),
    "upper arm": ("leftUpperArm", 0.5, (0.0, 1.0, 0.0)),
    "forearm": ("rightLowerArm", 0.5, (0.0, 0.0, 1.0)),
    "palm": ("rightMiddlePalm", 0.8, (0.0, -1.0, 0.0)),
    "fingertip": ("rightIndexDistal", 1.0, (-1.0, 0.0, 0.0)),
    "knuckle": ("leftIndexProximal", 0.3, (0.0, 1.0, 0.0)),
}
"""Places of a body in the T-pose: key of a capsule, share along it, direction."""


def surface_errors(avatar: Avatar, body: BodyCapsules) -> np.ndarray:
    """How far places of a body lie from those of the capsules that the mesh was made of, along their directions, m."""
    errors = []
    assert avatar.body is not None
    for key, t, direction in PLACES.values():
        at = []
        for one in (avatar.body, body):
            row = one.keys.index(key)
            axis = one.starts[row] + t * (one.ends[row] - one.starts[row])
            at.append(axis @ direction + one.radii[row] @ [1.0 - t, t])
        errors.append(abs(at[1] - at[0]))
    return np.array(errors)


def test_hair_skirts_and_accessories_are_no_skin(tmp_path: Path, broad: Avatar) -> None:
    bare, dressed = (ss.read_avatar(written(tmp_path, broad, hair=hair)).body for hair in (False, True))
    assert bare is not None
    assert dressed is not None
    np.testing.assert_array_equal(bare.radii, dressed.radii)


def test_contacts_with_an_avatar_without_skin_are_not_measured(tmp_path: Path, broad: Avatar) -> None:
    path = avatars.write(tmp_path / "b.vrm", broad, avatars.tubes(broad), hair=False)
    avatar = ss.read_avatar(avatars.edited(path, lambda document: document.update(meshes=[], nodes=[
        {key: value for key, value in node.items() if key not in ("mesh", "skin")} for node in document["nodes"]
    ])))  # fmt: skip
    (line,) = avatar.warnings
    usual = "b: holds no mesh that its bones carry; its body gets the usual proportions"
    assert line == f"{usual}; contacts on it are not measured"
    done = ss.retarget(ss.open_lexicon().clip("NAME"), avatar)
    assert done.contacts
    assert {(contact.is_kept, contact.after_mm) for contact in done.contacts} == {(None, None)}
    assert all(row["is_kept"] is None for row in describe_retargeting(done, "a.bvh", "b.vrm")["contacts"])


def test_contacts_are_measured_only_where_skin_is(tmp_path: Path, broad: Avatar) -> None:
    assert broad.body is not None
    bodies = []
    for lacking in ((), ("face", "hair", "nose", "eye", "mouth")):
        pairs = zip(avatars.tubes(broad), broad.body.parts, strict=True)
        parts = [part for part, kind in pairs if kind not in lacking]
        bodies.append(ss.read_avatar(avatars.write(tmp_path / "a.vrm", broad, parts, hair=False)).body)
    assert [body and body.guessed_regions for body in bodies] == [frozenset(), frozenset({"head"})]


NAMES = ("glassesGuy", "CapGirl", "Man_with_Hat", "BowTieMan", "HoodieKid", "WingedCoat")


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory, broad: Avatar) -> Path:
    return avatars.write(tmp_path_factory.mktemp("plain") / "plain.vrm", broad, avatars.tubes(broad))


@pytest.mark.parametrize("name", NAMES)
def test_names_of_meshes_nodes_and_rigs_decide_nothing(tmp_path: Path, plain: Path, name: str) -> None:
    def rename(document: dict[str, Any]) -> None:
        for fields in (*document["meshes"], *document["nodes"]):
            fields["name"] = f"{name}_{fields.get('name', '')}"

    (renamed := tmp_path / "named.vrm").write_bytes(plain.read_bytes())
    assert_same_skin(plain, avatars.edited(renamed, rename))


@pytest.mark.parametrize("joints", [None, ("leftHand",), ("head", "neck"), ("chest", "upperChest", "spine")])
def test_a_doubtful_material_counts_where_there_is_no_other(
    tmp_path: Path, broad: Avatar, plain: Path, joints: tuple[str, ...] | None
) -> None:
    own = {rig_info(broad).roles.joints.get(role) for role in joints or ()}
    parts = [
        replace(part, name="Man_with_Hat") if joints is None or part.joints[0, 0] in own else part
        for part in avatars.tubes(broad)
    ]
    assert_same_skin(plain, avatars.write(tmp_path / "doubtful.vrm", broad, parts))


def test_a_doubtful_material_over_other_skin_is_none(tmp_path: Path, broad: Avatar, plain: Path) -> None:
    parts = avatars.tubes(broad)
    over = [replace(part, name="Man_with_Hat", vertices=1.1 * part.vertices) for part in parts]
    assert_same_skin(plain, avatars.write(tmp_path / "over.vrm", broad, [*parts, *over]))


def test_of_joints_that_hang_apart_those_of_a_person_are_read(tmp_path: Path, broad: Avatar) -> None:
    """Targets of inverse kinematics without a parent, as Blender's exporter writes them."""
    path = avatars.write(tmp_path / "a.glb", broad, avatars.tubes(broad), "", hair=False)
    plain = ss.read_avatar(path)

    def add_targets(document: dict[str, Any]) -> None:
        for name in ("IK_hand.L", "IK_hand.R"):
            document["scenes"][0]["nodes"].append(len(document["nodes"]))
            document["skins"][0]["joints"].append(len(document["nodes"]))
            document["nodes"].append({"name": name})
        document["skins"][0].pop("inverseBindMatrices")

    beside = ss.read_avatar(avatars.edited(path, add_targets))
    assert (beside.names, beside.roles) == (plain.names, plain.roles)
    np.testing.assert_array_equal(beside.offsets, plain.offsets)


def assert_same_skin(plain: Path, other: Path) -> None:
    """The two files hold the same skin, and the same contacts with it are measured."""
    clip = ss.open_lexicon().clip("NAME")
    first, second = ss.read_avatar(plain), ss.read_avatar(other)
    assert first.body is not None
    assert second.body is not None
    assert first.body.skin is not None
    assert second.body.skin is not None
    np.testing.assert_array_equal(first.body.radii, second.body.radii)
    np.testing.assert_array_equal(first.body.skin.mesh.positions, second.body.skin.mesh.positions)
    assert [*map(len, (first.warnings, second.warnings))] == [0, 0]
    assert ss.retarget(clip, first).contacts == ss.retarget(clip, second).contacts


def test_a_mesh_part_without_indices_is_told(tmp_path: Path, broad: Avatar) -> None:
    path = written(tmp_path, broad)
    path.write_bytes(b'"unknown"'.join(path.read_bytes().rsplit(b'"indices"', 1)))  # of the skirt
    (line,) = ss.read_avatar(path).warnings
    assert line == f"{path.stem}: holds 1 mesh part without indexed triangles, not read"


def test_a_part_with_few_vertices_keeps_the_usual_proportions(tmp_path: Path, broad: Avatar) -> None:
    assert broad.body is not None
    parts = [p for p, part in zip(avatars.tubes(broad), broad.body.parts, strict=True) if part in ("sleeve", "shirt")]
    (line,) = ss.read_avatar(avatars.write(tmp_path / "a.vrm", broad, parts, hair=False)).warnings
    assert re_words(line) >= {"neck", "fingers", "palm"}


def re_words(line: str) -> set[str]:
    return set(line.replace(",", " ").split())


def test_joints_without_known_names_are_given_roles(tmp_path: Path, broad: Avatar) -> None:
    names = tuple(f"Bone.{n:03}" for n in range(len(broad)))
    unnamed = Avatar(names, broad.parents, broad.offsets, body=broad.body)
    roles = {role: names[joint] for role, joint in rig_info(broad).roles.joints.items()}
    path = avatars.write(tmp_path / "a.glb", unnamed, avatars.tubes(broad), "", roles=roles, hair=False)
    with pytest.raises(InputError, match=r"a\.glb: .*no leftUpperArm or leftLowerArm found among joints"):
        ss.read_avatar(path)
    read = ss.read_avatar(path, roles)
    assert names_of_roles(read) == roles
    assert read.body is not None


def test_what_is_no_avatar_is_refused_in_one_line(tmp_path: Path, broad: Avatar) -> None:
    clip = open_shipped_lexicon().clip("NAME")
    ss.save(clip, tmp_path / "NAME.bvh")
    (tmp_path / "broken.vrm").write_bytes(b"glTF" + b"\0" * 40)
    (tmp_path / "empty.vrm").write_text(json.dumps({"asset": {"version": "2.0"}}))
    unnamed = replace(broad, names=tuple(f"Bone.{n:03}" for n in range(len(broad))), roles=None)
    legs = {role: unnamed.names[joint] for role, joint in rig_info(broad).roles.joints.items() if "Leg" in role}
    avatars.write(tmp_path / "legs.vrm", unnamed, avatars.tubes(broad), roles=legs, hair=False)
    for name, expected in {
        "NAME.bvh": "a file with suffix .bvh is no avatar, expected .vrm, .glb, .gltf or .fbx",
        "broken.vrm": "broken.vrm: is glTF 0, expected 2",
        "empty.vrm": "is no avatar: it holds neither a VRM humanoid nor a mesh with a skin",
        "legs.vrm": "no leftUpperArm or leftLowerArm found",
    }.items():
        with pytest.raises(InputError) as caught:
            ss.read_avatar(tmp_path / name)
        assert expected in str(caught.value)
        assert len(str(caught.value).splitlines()) == 1
    path, few = written(tmp_path, broad), replace(DEFAULT_LIMITS, free_bytes=2e6, growth=0.5)
    with pytest.raises(LimitError, match="expected at most"):
        ss.read_avatar(path, limits=few)
    with pytest.raises(InputError, match=r"is an avatar, no clip, .*; `signsplice convert` puts clips onto"):
        ss.load(tmp_path / "a.vrm")
    with pytest.raises(FormatError, match="`signsplice convert` puts clips onto avatars"):
        ss.load(written(tmp_path, broad, version=""))


@pytest.mark.parametrize("version", ["1.0", "0.x"])
def test_players_of_vrm_animations_put_every_bone_where_the_clip_has_it(
    tmp_path: Path, broad: Avatar, version: str
) -> None:
    """Bone by bone as three-vrm does it, on the file's own nodes."""
    path = written(tmp_path, broad, version=version, hair=False)
    done = ss.retarget(open_shipped_lexicon().clip("NAME")[40:44], ss.read_avatar(path))
    ss.save(done.clip, tmp_path / "a.vrma")
    animation = ss.load(tmp_path / "a.vrma")
    nodes, roles = document(path)["nodes"], rig_info(broad).roles.joints
    turns = np.tile(rotation.IDENTITY, (len(broad), 4, 1))  # of each bone in the world, beyond its rest pose
    clip_joints = rig_info(animation.skeleton).roles.joints
    local = animation.local_rotations
    flip = np.array([-1.0, 1.0, -1.0, 1.0]) if version == "0.x" else 1.0
    at, parent_of = np.zeros((len(broad), 4, 3)), broad.parents.tolist()
    role_of = {joint: role for role, joint in roles.items()}
    rest = rest_quats(nodes, parent_of)
    for joint in range(len(broad)):
        over, role = parent_of[joint], role_of.get(joint, "")
        above = np.tile(rotation.IDENTITY, (4, 1)) if over < 0 else turns[over]
        turns[joint] = rotation.multiply(above, local[:, clip_joints[role]] * flip) if role in clip_joints else above
        if over >= 0:
            bone = rotation.rotate(rest[over], nodes[joint]["translation"])
            at[joint] = at[over] + rotation.rotate(turns[over], bone)
    expected = kinematics.forward(done.clip)[1][:, [done.clip.skeleton.index.get(name, 0) for name in broad.names]]
    expected = expected - expected[:, :1]
    behind = np.diag([-1.0, 1.0, -1.0]) if version == "0.x" else np.eye(3)
    placed = rotation.inverse(animation.local_rotations[:1, 0]), rotation.inverse(done.clip.local_rotations[:1, 0])
    found = at.transpose(1, 0, 2) @ behind
    one, two = (rotation.rotate(turn[:, None], points) for turn, points in zip(placed, (found, expected), strict=True))
    arms = rig_info(broad).arm_joints[:6]
    np.testing.assert_allclose(one[:, arms], two[:, arms], atol=1e-4)


def document(path: Path) -> dict[str, Any]:
    content = path.read_bytes()
    size = int.from_bytes(content[12:16], "little")
    loaded: dict[str, Any] = json.loads(content[20 : 20 + size])
    return loaded


def rest_quats(nodes: list[dict[str, Any]], parents: list[int]) -> list[np.ndarray]:
    out: list[np.ndarray] = []
    for node, parent in zip(nodes, parents, strict=False):
        own = np.array(node["rotation"])
        out.append(own if parent < 0 else rotation.multiply(out[parent], own))
    return out


def sleeved(avatar: Avatar, name: str, has_arms: bool) -> list[Any]:
    """The tubes of an avatar with sleeves around its forearms that are four times as thick, of a material ``name``, and
    the arms within them where they are modelled.
    """
    assert avatar.body is not None
    parts = list(avatars.tubes(avatar))
    rest = kinematics.rest_positions(avatar)
    for n, part in enumerate(avatar.body.parts):
        if part == "cuff":
            start, axis = rest[avatar.body.joints[n]], avatar.body.ends[n] / np.linalg.norm(avatar.body.ends[n])
            along = (parts[n].vertices - start) @ axis
            across = parts[n].vertices - start - along[:, None] * axis
            wide = replace(parts[n], name=name, vertices=parts[n].vertices + 3.0 * across)
            parts[n : n + 1] = [wide]
            if has_arms:
                parts.append(avatars.tubes(avatar)[n])
    return parts


def cuffs(body: BodyCapsules | None) -> np.ndarray:
    """Radii (2, 2) of both forearms, m."""
    assert body is not None
    return body.radii[[body.keys.index(f"{side}LowerArm") for side in ("left", "right")]]


@pytest.mark.parametrize(
    ("name", "has_arms", "skin"),
    [
        ("Tops_CLOTH", True, ()),
        ("Tops_CLOTH", False, ()),
        ("M_7", True, ("Body_SKIN", "Scalp_SKIN")),
        ("M_7", False, ()),
    ],
)
def test_wide_sleeves_are_no_arms(
    tmp_path: Path, broad: Avatar, name: str, has_arms: bool, skin: tuple[str, ...]
) -> None:
    path = avatars.write(tmp_path / "a.vrm", broad, sleeved(broad, name, has_arms))
    read = cuffs(ss.read_avatar(path, skin=skin).body)
    assert cuffs(broad.body).max() < 0.05
    np.testing.assert_allclose(read, cuffs(broad.body), rtol=0.05 if has_arms else 0.35)


def test_a_cuff_over_the_hand_is_no_hand(tmp_path: Path, broad: Avatar) -> None:
    parts = sleeved(broad, "Tops_CLOTH", has_arms=True)
    roles = rig_info(broad).roles.joints
    for n, part in enumerate(parts):
        if part.name == "Tops_CLOTH":
            side = "left" if part.vertices[:, 0].mean() > 0.0 else "right"
            parts[n] = replace(part, joints=np.where(part.weights > 0.0, roles[f"{side}Hand"], part.joints))
    read = [
        ss.read_avatar(avatars.write(tmp_path / "a.vrm", broad, some)).body for some in (parts, avatars.tubes(broad))
    ]
    spans = []
    for body in read:
        assert body is not None
        assert body.skin is not None
        spans.append([np.ptp(hand.points, axis=0) for hand in body.skin.hands])
    np.testing.assert_allclose(spans[0], spans[1], atol=0.005)


def test_what_bones_between_those_with_a_role_carry_is_measured(tmp_path: Path, broad: Avatar) -> None:
    """Metacarpals carry the palm, and half an upper arm or a bone of the spine what is around it, in many rigs."""
    named, parents, offsets = list(broad.names), list(broad.parents), list(broad.offsets)
    moved: dict[str, int] = {}
    fingers = ("Index", "Middle", "Ring", "Little")
    between = {f"{side}{finger}Proximal": [f"{side}{finger}Palm"] for side in SIDES for finger in fingers}
    between |= {f"{side}LowerArm": [f"{side}UpperArm"] for side in SIDES}
    between |= {"chest": [key for key in broad.body.keys if key.startswith(("belly", "chest"))]} if broad.body else {}
    for role, keys in between.items():
        joint = rig_info(broad).roles.joints[role]
        named.append(f"over {role}")
        parents.append(int(broad.parents[joint]))
        offsets.append(0.2 * np.asarray(broad.offsets[joint]))
        parents[joint], offsets[joint] = len(named) - 1, 0.8 * np.asarray(broad.offsets[joint])
        moved |= dict.fromkeys(keys, len(named) - 1)
    order = sorted(range(len(named)), key=lambda joint: depth(parents, joint))
    row = {joint: n for n, joint in enumerate(order)}
    assert broad.body is not None
    parts = [
        replace(part, joints=np.vectorize(row.get)(np.where(part.weights > 0.0, moved.get(key, part.joints), 0)))
        for part, key in zip(avatars.tubes(broad), broad.body.keys, strict=True)
    ]
    rig = Skeleton(
        tuple(named[joint] for joint in order),
        np.array([row.get(parents[joint], -1) for joint in order]),
        np.array([offsets[joint] for joint in order]),
        roles=broad.roles,
    )
    read = ss.read_avatar(avatars.write(tmp_path / "m.vrm", rig, parts, hair=False))
    assert not read.warnings
    assert read.body is not None
    for key in (*(f"{side}{part}" for side in SIDES for part in ("MiddlePalm", "UpperArm")), "belly1", "chest1"):
        ours, true = (body.radii[body.keys.index(key)] for body in (read.body, broad.body))
        np.testing.assert_allclose(ours, true, rtol=0.1)


def depth(parents: list[int], joint: int) -> int:
    """How many joints lie above one."""
    return 0 if parents[joint] < 0 else 1 + depth(parents, parents[joint])
