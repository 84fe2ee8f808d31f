"""glTF and VRM animations that we write: they come back unchanged, and other programs read them correctly."""

from __future__ import annotations

import json
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pygltflib import GLTF2

import signsplice as ss
from other_rigs import on_other_rig
from signsplice.body.capsules import MeshPart
from signsplice.errors import InputError
from signsplice.formats import glb, vrma
from signsplice.formats.gltf_writer import in_front
from signsplice.lexicon import open_shipped_lexicon
from signsplice.motion import Clip, Skeleton, kinematics, rotation
from signsplice.motion.face import ARKIT_CHANNELS, Face
from signsplice.rig.info import ROLES, canonical_motion, rig_info

VIEWER = Path(__file__).parents[2] / "viewer"
BOOK = open_shipped_lexicon().clip("BOOK")


@pytest.fixture
def tiny_mesh(monkeypatch: pytest.MonkeyPatch) -> None:
    """One triangle instead of the mannequin, whose skin takes longer to make than all else."""
    weights = np.tile([1.0, 0.0, 0.0, 0.0], (3, 1))
    triangle = MeshPart(
        "triangle", (1.0, 1.0, 1.0), np.eye(3), np.eye(3), np.array([[0, 1, 2]]), np.zeros((3, 4), np.int64), weights
    )
    monkeypatch.setattr(glb, "body_mesh", lambda skeleton: (triangle,))


def positions_in_front(clip: Clip) -> np.ndarray:
    """Joint positions (T, J, 3) in metres, with the signer in front."""
    placed = in_front(clip)
    return np.asarray(kinematics.forward(placed)[1] * rig_info(clip.skeleton).sizes.unit.metres)


def round_trip_error(clip: Clip, path: Path) -> float:
    """The largest error of a clip that was written and read: joint positions in metres, canonical rotations in 6D."""
    ss.save(clip, path)
    back = ss.load(path)
    assert len(back) == len(clip)
    assert back.fps == pytest.approx(clip.fps)
    columns = [back.skeleton.names.index(name) for name in clip.skeleton.names]
    position_error = np.abs(kinematics.forward(back)[1][:, columns] - positions_in_front(clip)).max()
    rotations_6d = [rotation.to_6d(canonical_motion(one).quats) for one in (back, clip)]
    return float(max(position_error, np.abs(rotations_6d[0] - rotations_6d[1]).max()))


def test_a_glb_file_comes_back(tmp_path: Path) -> None:
    assert round_trip_error(BOOK, tmp_path / "book.glb") < 1e-5


@pytest.mark.usefixtures("tiny_mesh")
def test_a_glb_file_of_a_lying_rig_in_metres_comes_back(tmp_path: Path) -> None:
    lying = on_other_rig(BOOK, rotation.exp([0.4, -1.1, 2.0]), 0.01)
    assert round_trip_error(lying, tmp_path / "lying.glb") < 1e-5


@pytest.mark.usefixtures("tiny_mesh")
def test_glb_files_of_real_clips_come_back(tmp_path: Path, real_clips: dict[str, Clip]) -> None:
    for name in ("isl_thanks", "kateBVH"):
        assert round_trip_error(real_clips[name][:40], tmp_path / "real.glb") < 1e-5


def test_a_vrm_animation_rotates_bones_from_the_t_pose(tmp_path: Path) -> None:
    path = tmp_path / "book.vrma"
    ss.save(BOOK, path)
    back = ss.load(path)
    roles = rig_info(back.skeleton).roles.joints
    assert set(roles) == set(back.skeleton.names)
    for role, row in ((role, ROLES.index(role)) for role in roles if role in ROLES):
        angles = rotation.angle_between(back.local_rotations[:, roles[role]], canonical_motion(BOOK).quats[:, row])
        np.testing.assert_allclose(angles, 0.0, atol=1e-5)
    hips = rig_info(BOOK.skeleton).roles.joints["hips"]
    np.testing.assert_allclose(back.root_positions, positions_in_front(BOOK)[:, hips], atol=1e-5)


def test_a_rig_without_hips_cannot_be_a_vrm_animation(tmp_path: Path) -> None:
    skeleton = Skeleton(("a", "b"), np.array([-1, 0]), np.array([[0.0, 0, 0], [0, 1, 0]]))
    clip = Clip(skeleton, np.tile([0.0, 0, 0, 1], (5, 2, 1)), np.zeros((5, 3)), 30.0)
    with pytest.raises(InputError, match=r"a.vrma: no hips found among the joints"):
        ss.save(clip, tmp_path / "a.vrma")
    assert not list(tmp_path.iterdir())
    ss.save(clip, tmp_path / "a.glb")
    assert ss.load(tmp_path / "a.glb").skeleton.names == ("a", "b")


@pytest.mark.usefixtures("tiny_mesh")
def test_roles_of_a_roles_file_come_back(tmp_path: Path) -> None:
    joints = rig_info(BOOK.skeleton).roles.joints
    names = tuple(f"j{n}" for n in range(len(BOOK.skeleton)))
    roles = {role: names[joint] for role, joint in joints.items()}
    skeleton = Skeleton(names, BOOK.skeleton.parents, BOOK.skeleton.offsets, roles=roles)
    ss.save(Clip(skeleton, BOOK.local_rotations, BOOK.root_positions, BOOK.fps), tmp_path / "a.glb")
    assert ss.load(tmp_path / "a.glb").skeleton.roles == roles


def test_soles_are_on_the_floor_and_hips_at_their_rest_height() -> None:
    made = glb.document(BOOK)
    lowest = min(made.accessors[p.attributes.POSITION].min[1] for p in made.meshes[0].primitives)
    assert lowest < -0.5, "bound with the root at the origin"
    hips = BOOK.skeleton.index["mixamorig:Hips"]
    soles = positions_in_front(BOOK)[0, hips, 1] + lowest
    assert abs(soles) < 0.02, "the mannequin's lowest point in the first frame"
    made = vrma.document(BOOK)
    assert made.nodes[0].name == "hips"
    assert made.nodes[0].translation[1] == pytest.approx(positions_in_front(BOOK)[0, hips, 1], abs=0.02)


def test_a_body_without_legs_has_hips_at_the_usual_height() -> None:
    keep = [n for n, name in enumerate(BOOK.skeleton.names) if not any(p in name for p in ("Leg", "Foot", "Toe"))]
    parents = np.array([keep.index(int(p)) if p >= 0 else -1 for p in BOOK.skeleton.parents[keep]])
    names = tuple(BOOK.skeleton.names[n] for n in keep)
    skeleton = Skeleton(names, parents, BOOK.skeleton.offsets[keep])
    made = vrma.document(Clip(skeleton, BOOK.local_rotations[:, keep], BOOK.root_positions, 30.0))
    assert 0.7 < made.nodes[0].translation[1] < 1.2


def test_eyes_are_left_out_of_vrm_animations() -> None:
    head = BOOK.skeleton.index["mixamorig:Head"]
    skeleton = Skeleton(
        (*BOOK.skeleton.names, "LeftEye"),
        np.append(BOOK.skeleton.parents, head),
        np.concatenate([BOOK.skeleton.offsets, [[3.0, 8.0, 8.0]]]),
    )
    local = np.concatenate([BOOK.local_rotations, np.tile(rotation.IDENTITY, (len(BOOK), 1, 1))], axis=1)
    clip = Clip(skeleton, local, BOOK.root_positions, BOOK.fps)
    assert "leftEye" in rig_info(skeleton).roles.joints
    assert "leftEye" not in {node.name for node in vrma.document(clip).nodes}


@pytest.fixture(scope="module")
def read_by_others(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What the Khronos validator, three.js and three-vrm-animation report of a .glb and a .vrma, by suffix."""
    if shutil.which("node") is None or not (VIEWER / "node_modules").is_dir():
        pytest.skip("no node, or viewer/node_modules is not installed")
    folder = tmp_path_factory.mktemp("gltf")
    files = [folder / "book.glb", folder / "book.vrma"]
    face = Face(ARKIT_CHANNELS, np.random.default_rng(3).random((len(BOOK), len(ARKIT_CHANNELS))))
    for path in files:
        ss.save(replace(BOOK, face=face) if path.suffix == ".glb" else BOOK, path)
    command = ["node", str(VIEWER / "checks" / "gltf.mjs"), "--times", "0,0.5,1.1", *map(str, files)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return {Path(line["file"]).suffix: line for line in map(json.loads, done.stdout.splitlines())}


def test_the_khronos_validator_finds_no_fault(read_by_others: dict[str, Any]) -> None:
    person, animation = read_by_others[".glb"], read_by_others[".vrma"]
    assert (person["errors"], person["warnings"], person["messages"]) == (0, 0, [])
    assert (animation["errors"], animation["warnings"]) == (0, 0)
    assert {message.split()[0] for message in animation["messages"]} <= {"UNSUPPORTED_EXTENSION", "NODE_EMPTY"}


def test_three_js_puts_joints_at_the_same_positions(read_by_others: dict[str, Any]) -> None:
    clip = BOOK
    expected = positions_in_front(clip)
    for time, positions in zip((0.0, 0.5, 1.1), read_by_others[".glb"]["positions"], strict=True):
        frame = time * clip.fps
        assert frame == pytest.approx(round(frame))
        for joint, name in enumerate(clip.skeleton.names):
            np.testing.assert_allclose(positions[name], expected[round(frame), joint], atol=1e-4)


def test_three_vrm_reads_the_rotations_of_every_bone(read_by_others: dict[str, Any]) -> None:
    bones = read_by_others[".vrma"]["bones"]
    expected = canonical_motion(BOOK)
    for role, values in bones["rotations"].items():
        if role in ROLES:
            angles = rotation.angle_between(np.array(values).reshape(-1, 4), expected.quats[:, ROLES.index(role)])
            np.testing.assert_allclose(angles, 0.0, atol=1e-5)
    assert set(bones["rotations"]) == set(rig_info(BOOK.skeleton).roles.joints)


def test_a_glb_file_names_its_generator_and_has_one_skin(tmp_path: Path) -> None:
    path = tmp_path / "book.glb"
    ss.save(BOOK, path)
    made = GLTF2.load_binary(str(path))
    assert made.asset.generator == "signsplice"
    assert [len(skin.joints) for skin in made.skins] == [len(BOOK.skeleton)]
    assert made.animations[0].name == BOOK.name
    assert len(made.meshes) == 1


def test_blender_shows_an_armature_with_a_mesh_and_an_action(tmp_path: Path) -> None:
    bpy = pytest.importorskip("bpy", reason="Blender's module is not installed (500 MB: pip install bpy==4.2.0)")
    path = tmp_path / "book.glb"
    ss.save(BOOK, path)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.context.scene.render.fps = round(BOOK.fps)
    bpy.ops.import_scene.gltf(filepath=str(path))
    (armature,) = (item for item in bpy.data.objects if item.type == "ARMATURE")
    mesh = bpy.data.objects["mannequin"]
    assert [modifier.type for modifier in mesh.modifiers] == ["ARMATURE"]
    assert {bone.name for bone in armature.data.bones} == set(BOOK.skeleton.names)
    assert armature.animation_data.action is not None
    expected = positions_in_front(BOOK)
    for frame in (0, 30):
        bpy.context.scene.frame_set(frame)
        bpy.context.view_layer.update()
        for name in ("mixamorig:RightHand", "mixamorig:LeftHandIndex3", "mixamorig:Head"):
            x, y, z = armature.matrix_world @ armature.pose.bones[name].head
            np.testing.assert_allclose([x, z, -y], expected[frame, BOOK.skeleton.index[name]], atol=1e-4)


def test_the_face_of_a_clip_moves_the_figure_and_comes_back(tmp_path: Path) -> None:
    weights = np.random.default_rng(3).random((6, len(ARKIT_CHANNELS)))
    clip = replace(BOOK[:6], face=Face(ARKIT_CHANNELS, weights))
    ss.save(clip, tmp_path / "a.glb")
    back = ss.load(tmp_path / "a.glb")
    assert back.face is not None
    np.testing.assert_allclose(back.face.of(ARKIT_CHANNELS), weights, atol=1e-6)
    made, plain = glb.document(clip), glb.document(BOOK[:6])
    assert [mesh.name for mesh in made.meshes] == ["mannequin", "face"]
    assert [mesh.name for mesh in plain.meshes] == ["mannequin"]
    assert tuple(made.meshes[1].extras["targetNames"]) == ARKIT_CHANNELS
    assert {len(primitive.targets) for primitive in made.meshes[1].primitives} == {len(ARKIT_CHANNELS)}
