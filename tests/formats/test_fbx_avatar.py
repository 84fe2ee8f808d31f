"""Avatars in FBX: skeleton, meshes, blend shapes, colours and textures, and motion on them."""

from __future__ import annotations

import gzip
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pygltflib import GLTF2

import avatars
import signsplice as ss
from fbx_files import Node, character, text_6, text_7
from signsplice.body.capsules import Avatar
from signsplice.errors import InputError, LimitError
from signsplice.formats import load
from signsplice.formats.avatar import parse_avatar
from signsplice.formats.fbx_avatar import as_glb
from signsplice.formats.reading import DEFAULT_LIMITS
from signsplice.motion import kinematics

FOLDER = Path(__file__).parent / "fbx"
CONTENT = gzip.decompress((FOLDER / "blender_person.fbx.gz").read_bytes())


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("fbx") / "person.fbx"
    path.write_bytes(CONTENT)
    return path


@pytest.fixture(scope="module")
def avatar(file: Path) -> Avatar:
    return ss.read_avatar(file)


@pytest.fixture(scope="module")
def document(tmp_path_factory: pytest.TempPathFactory) -> GLTF2:
    return GLTF2().load_from_bytes(as_glb(CONTENT, "person.fbx", tmp_path_factory.mktemp("none")))


def test_its_joints_are_where_blender_had_them(avatar: Avatar) -> None:
    source = load(FOLDER / "person.bvh").skeleton
    rows = [avatar.index[name] for name in source.names]
    at, expected = kinematics.rest_positions(avatar), kinematics.rest_positions(source) / 100.0
    np.testing.assert_allclose(at[rows] - at[0], expected - expected[0], atol=1e-6)


def test_its_vertices_are_around_the_bones_that_carry_them(avatar: Avatar) -> None:
    at = kinematics.rest_positions(avatar) - kinematics.rest_positions(avatar)[0]
    boxes = [part for part in avatar.mesh if len(part.vertices) > 8]
    vertices, joints = (np.concatenate([getattr(part, name) for part in boxes]) for name in ("vertices", "joints"))
    first = np.linalg.norm(vertices - at[joints[:, 0]], axis=1)
    near = np.abs(first - 0.03 * np.sqrt(2.0)) < 1e-5
    assert 0.4 < near.mean() < 0.6, "half of a box's corners are at a bone's head, half at its tail"
    tails = vertices[~near]
    others = np.linalg.norm(tails[:, None] - at[None], axis=2)
    children = np.abs(others - 0.03 * np.sqrt(2.0)).min(axis=1) < 1e-5
    assert children.mean() > 0.5, "a tail is at the next joint, but for bones that end"


def test_its_triangles_look_outwards(document: GLTF2) -> None:
    blob = document.binary_blob()
    for mesh in document.meshes:
        for part in mesh.primitives:
            at = array(document, blob, part.attributes.POSITION)
            normals = array(document, blob, part.attributes.NORMAL)
            joints = array(document, blob, part.attributes.JOINTS_0)[:, 0].astype(int)
            for joint in np.unique(joints):
                own = at[joints == joint]
                outward = own - own.mean(axis=0)
                assert np.einsum("va,va->v", outward, normals[joints == joint]).mean() > 0.0


def array(document: GLTF2, blob: bytes, number: int) -> np.ndarray[Any, Any]:
    accessor = document.accessors[number]
    view = document.bufferViews[accessor.bufferView]
    kind = {5126: np.float32, 5121: np.uint8, 5123: np.uint16}[accessor.componentType]
    width = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}[accessor.type]
    found = np.frombuffer(blob, kind, accessor.count * width, view.byteOffset or 0)
    return found.reshape(-1, width).astype(np.float64)


def test_materials_keep_their_colours_names_and_embedded_textures(document: GLTF2) -> None:
    named = {material.name: material for material in document.materials}
    assert {*named} == {"cloth", "skin"}
    np.testing.assert_allclose(named["skin"].pbrMetallicRoughness.baseColorFactor, [0.8, 0.4, 0.3, 1.0], atol=1e-6)
    assert named["skin"].pbrMetallicRoughness.baseColorTexture is None
    assert named["cloth"].pbrMetallicRoughness.baseColorTexture.index == 0
    view = document.bufferViews[document.images[0].bufferView]
    assert document.binary_blob()[view.byteOffset :].startswith(b"\x89PNG")
    cloth = next(p for m in document.meshes for p in m.primitives if document.materials[p.material].name == "cloth")
    uvs = array(document, document.binary_blob(), cloth.attributes.TEXCOORD_0)
    assert {round(7 * u) for u, _ in uvs} <= {*range(7)}
    assert {round(5 * (1.0 - v)) for _, v in uvs} <= {*range(5)}


def test_motion_and_face_are_written_into_its_glb(tmp_path: Path, file: Path, avatar: Avatar) -> None:
    clip = ss.load(file)
    done = ss.retarget(clip, avatar).clip
    ss.save(done, tmp_path / "out.glb")
    read = ss.load(tmp_path / "out.glb")
    assert read.face is not None
    assert clip.face is not None
    np.testing.assert_allclose(read.face.of(("jawOpen",)), clip.face.of(("jawOpen",)), atol=1e-6)
    rows = [read.skeleton.index[name] for name in clip.skeleton.names]
    here, there = kinematics.forward(clip)[1], kinematics.forward(read)[1][:, rows]
    apart = np.abs(there - there[:, :1] - here + here[:, :1]).max(axis=(0, 2))
    in_arms = np.array(["Arm" in name or "Hand" in name for name in clip.skeleton.names])
    assert apart[~in_arms].max() < 1e-4
    assert apart[in_arms].max() < 0.06, "arms are led around the other body"


def test_textures_that_are_files_are_read_from_its_folder_alone(tmp_path: Path) -> None:
    start = CONTENT.index(b"\x89PNG")
    content = CONTENT[:start] + b"\0" * 8 + CONTENT[start + 8 :]  # no picture any more
    (tmp_path / "cloth.png").write_bytes(b"\x89PNG of a folder")
    assert not GLTF2().load_from_bytes(as_glb(content, "person.fbx", tmp_path)).images
    without = CONTENT.replace(b"Content", b"Kontent")
    images = GLTF2().load_from_bytes(as_glb(without, "person.fbx", tmp_path)).images
    assert len(images) == 1
    assert not GLTF2().load_from_bytes(as_glb(without, "person.fbx", tmp_path / "other")).images


def test_meshes_that_take_far_more_memory_than_their_file_are_refused(tmp_path: Path) -> None:
    few = replace(DEFAULT_LIMITS, free_bytes=500_000.0, growth=0.0)
    assert as_glb(CONTENT, "person.fbx", tmp_path, replace(few, free_bytes=5e6))
    with pytest.raises(LimitError, match="of memory, expected at most"):
        as_glb(CONTENT, "person.fbx", tmp_path, few)


@pytest.fixture(scope="module")
def narrow() -> Avatar:
    return avatars.body("narrow")


def test_a_character_of_100_000_vertices_and_packed_arrays_is_read(tmp_path: Path, narrow: Avatar) -> None:
    parts = avatars.tubes(narrow)
    many = [part for part in parts for _ in range(100_000 // sum(len(part.vertices) for part in parts) + 1)]
    content = character(narrow, many, n_shapes=52)
    assert sum(len(part.vertices) for part in many) > 100_000
    assert len(content) < 5e6
    avatar = parse_avatar(content, "many.fbx")
    assert avatar.warnings == ()
    assert sum(len(part.vertices) for part in avatar.mesh) > 100_000
    with pytest.raises(LimitError, match=r"records take .* MB of memory, expected at most"):
        parse_avatar(character(narrow, many, n_shapes=200), "bomb.fbx")


def test_targets_of_inverse_kinematics_hang_beside_a_body(narrow: Avatar) -> None:
    targets = [Node(f"IK_{what}.{side}", "", (50, 90, 0)) for what in ("hand", "foot") for side in "LR"]
    plain, beside = (parse_avatar(character(narrow, avatars.tubes(narrow), more), "a.fbx") for more in ((), targets))
    assert beside.names == plain.names
    assert beside.roles == plain.roles


TRUNK = (Node("Hips", moves={("R", 0): ((0, 0), (1, 9))}), Node("Spine", "Hips", (0, 20, 0)))


@pytest.mark.parametrize("above", ["", "Rig"])
def test_bones_that_hang_apart_get_one_root(above: str) -> None:
    rig = (Node(above, kind="Null"),) if above else ()
    bones = (*(replace(bone, parent=bone.parent or above) for bone in TRUNK), Node("Target", above, (50, 9, 0)))
    document = GLTF2().load_from_bytes(as_glb(text_7((*rig, *bones)), "apart.fbx", None))
    (root,) = (document.nodes[number] for number in document.scenes[0].nodes)
    assert root.name == (above or "Root")
    assert [document.nodes[number].name for number in root.children] == ["Hips", "Target"]
    np.testing.assert_allclose(document.nodes[root.children[1]].translation, [0.5, 0.09, 0.0], atol=1e-9)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (text_6(TRUNK), r"is of version 6, whose meshes are not read; FBX2glTF \(npm: fbx2gltf, free\) makes a .glb"),
        (text_7((Node("Box", kind="Mesh"),)), "is no avatar: it holds no bones"),
        (text_7(TRUNK), "no leftUpperArm"),
        (CONTENT[:40_000], "is cut off or damaged"),
        (b"FBX", "is no FBX file"),
    ],
)
def test_what_is_no_avatar_is_one_line(tmp_path: Path, content: bytes, message: str) -> None:
    file = tmp_path / "wrong.fbx"
    file.write_bytes(content)
    with pytest.raises(InputError, match=message) as caught:
        ss.read_avatar(file)
    assert str(caught.value).startswith(f"{file}: ")
    assert "\n" not in str(caught.value)
