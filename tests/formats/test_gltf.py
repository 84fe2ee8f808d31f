"""glTF and VRM animations: what is written opens as an animated person elsewhere, what others wrote comes in."""

from __future__ import annotations

import base64
import json
import shutil
import struct
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pygltflib import GLTF2

import signsplice as ss
from clothes import in_other_clothes
from signing import word
from signsplice.errors import FormatError, InputError
from signsplice.formats import gltf
from signsplice.motion import kinematics, rotation
from signsplice.motion.clip import Clip, Skeleton
from signsplice.rig import proportions
from signsplice.rig.canonical import ROLES, canonical_motion
from signsplice.rig.roles import find_roles

VIEWER = Path(__file__).parents[2] / "viewer"
BOOK = word("BOOK").clip


def places_of(clip: Clip) -> np.ndarray:
    """Joints (T, J, 3) in metres, the signer in front."""
    placed = gltf.in_front(clip)
    return np.asarray(kinematics.forward(placed)[1] * proportions.sizes(clip.skeleton).unit.metres)


def came_back(clip: Clip, path: Path) -> float:
    """How far a written and read clip is off at most, in metres and in six-number turns."""
    ss.save(clip, path)
    back = ss.load(path)
    assert len(back) == len(clip)
    assert back.fps == pytest.approx(clip.fps)
    columns = [back.skeleton.names.index(name) for name in clip.skeleton.names]
    places = np.abs(kinematics.forward(back)[1][:, columns] - places_of(clip)).max()
    return float(
        max(
            places,
            np.abs(rotation.to_6d(canonical_motion(back).quats) - rotation.to_6d(canonical_motion(clip).quats)).max(),
        )
    )


def test_a_person_comes_back(tmp_path: Path) -> None:
    assert came_back(BOOK, tmp_path / "book.glb") < 1e-5
    assert came_back(in_other_clothes(BOOK, rotation.exp([0.4, -1.1, 2.0]), 0.01), tmp_path / "lying.glb") < 1e-5


def test_a_real_person_comes_back(tmp_path: Path, real_clips: dict[str, Clip]) -> None:
    for name in ("isl_thanks", "kateBVH"):
        assert came_back(real_clips[name][:40], tmp_path / "real.glb") < 1e-5


def test_a_vrm_animation_turns_the_bones_of_a_t_pose(tmp_path: Path) -> None:
    path = tmp_path / "book.vrma"
    ss.save(BOOK, path)
    back = ss.load(path)
    roles = find_roles(back.skeleton).joints
    assert set(roles) == set(back.skeleton.names)
    for role, row in ((role, ROLES.index(role)) for role in roles if role in ROLES):
        angles = rotation.angle_between(back.local_rotations[:, roles[role]], canonical_motion(BOOK).quats[:, row])
        np.testing.assert_allclose(angles, 0.0, atol=1e-5)
    hips = find_roles(BOOK.skeleton).joints["hips"]
    np.testing.assert_allclose(back.root_positions, places_of(BOOK)[:, hips], atol=1e-5)


def test_a_rig_without_hips_is_no_vrm_animation(tmp_path: Path) -> None:
    skeleton = Skeleton(("a", "b"), np.array([-1, 0]), np.array([[0.0, 0, 0], [0, 1, 0]]))
    clip = Clip(skeleton, np.tile([0.0, 0, 0, 1], (5, 2, 1)), np.zeros((5, 3)), 30.0)
    with pytest.raises(InputError, match=r"a.vrma: no hips found among the joints"):
        ss.save(clip, tmp_path / "a.vrma")
    assert not list(tmp_path.iterdir())
    ss.save(clip, tmp_path / "a.glb")
    assert ss.load(tmp_path / "a.glb").skeleton.names == ("a", "b")


# What others write.


def made_of(nodes: list[dict[str, Any]], channels: list[dict[str, Any]], **more: Any) -> dict[str, Any]:
    """A glTF document: channels hold node, path, times, values, and how to go between."""
    content, views, accessors, samplers, told = bytearray(), [], [], [], []

    def put(values: Any, kind: str, dtype: str = "f4", component: int = 5126, **extra: Any) -> int:
        array = np.ascontiguousarray(values, dtype)
        views.append({"buffer": 0, "byteOffset": len(content), "byteLength": array.nbytes})
        content.extend(array.tobytes() + b"\0" * (-array.nbytes % 4))
        accessors.append(
            {"bufferView": len(views) - 1, "componentType": component, "count": len(array), "type": kind, **extra}
        )
        return len(accessors) - 1

    for channel in channels:
        kind = "VEC4" if channel["path"] == "rotation" else "VEC3"
        extra = channel.get("stored", {})
        samplers.append({
            "input": put(channel["times"], "SCALAR"),
            "output": put(channel["values"], kind, **extra),
            "interpolation": channel.get("between", "LINEAR"),
        })  # fmt: skip
        told.append({"sampler": len(samplers) - 1, "target": {"node": channel["node"], "path": channel["path"]}})
    uri = "data:application/octet-stream;base64," + base64.b64encode(bytes(content)).decode()
    return {
        "asset": {"version": "2.0"}, "nodes": nodes, "accessors": accessors, "bufferViews": views,
        "buffers": [{"byteLength": len(content), "uri": uri}],
        "animations": [{"name": "wave", "samplers": samplers, "channels": told}], **more,
    }  # fmt: skip


def load_made(folder: Path, document: dict[str, Any]) -> Clip:
    path = folder / "made.gltf"
    path.write_text(json.dumps(document))
    return ss.load(path)


ARM = [{"name": "root", "children": [1]}, {"name": "arm", "translation": [0, 1, 0]}]
QUARTER = [0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)]
STILL = [0.0, 0.0, 0.0, 1.0]


def turning(**more: Any) -> dict[str, Any]:
    return {"node": 0, "path": "rotation", "times": [0, 1], "values": [STILL, QUARTER], **more}


@pytest.mark.parametrize(
    ("between", "values", "expected"),
    [
        ("LINEAR", [STILL, QUARTER], lambda s: 90.0 * s),
        ("STEP", [STILL, QUARTER], lambda s: np.where(s < 1.0, 0.0, 90.0)),
        (
            "CUBICSPLINE",
            [[0.0] * 4, STILL, [0.0] * 4, [0.0] * 4, QUARTER, [0.0] * 4],
            lambda s: np.degrees(2 * np.arctan2(np.sqrt(0.5) * h(s), 1 - h(s) + np.sqrt(0.5) * h(s))),
        ),
    ],
)
def test_keys_are_sampled_as_the_file_says(tmp_path: Path, between: str, values: Any, expected: Any) -> None:
    clip = load_made(tmp_path, made_of(ARM, [turning(values=values, between=between)]))
    assert (clip.fps, len(clip), clip.name) == (30.0, 31, "wave")
    angle = np.degrees(rotation.twist_angle(clip.local_rotations[:, 0], [0.0, 0.0, 1.0]))
    np.testing.assert_allclose(angle, expected(np.arange(31) / 30.0), atol=1e-4)


def h(s: np.ndarray) -> np.ndarray:
    return np.asarray(s**2 * (3 - 2 * s))


def test_what_stands_above_the_skeleton_moves_it(tmp_path: Path) -> None:
    half = np.sqrt(0.5)
    above = {
        "name": "Armature",
        "children": [1],
        "rotation": [-half, 0, 0, half],
        "scale": [0.01] * 3,
        "translation": [0, 0, 2],
    }
    nodes = [
        above,
        {"name": "hip", "children": [2], "translation": [0, 0, 90]},
        {"name": "knee", "translation": [0, 0, -45]},
    ]
    moves = {"node": 1, "path": "translation", "times": [0, 0.04], "values": [[0, 0, 90], [10, 0, 90]]}
    clip = load_made(tmp_path, made_of(nodes, [moves, turning(node=2)]))
    assert clip.skeleton.names == ("hip", "knee")
    assert clip.fps == 25.0
    _, places = kinematics.forward(clip)
    np.testing.assert_allclose(places[0], [[0.0, 0.9, 2.0], [0.0, 0.45, 2.0]], atol=1e-6)
    np.testing.assert_allclose(places[1, 0], [0.1, 0.9, 2.0], atol=1e-6)


def test_the_pose_of_the_skin_is_the_rest_pose(tmp_path: Path) -> None:
    """A file whose nodes lie turned at rest, as Blender writes bones: at rest the clip's rotations are identities."""
    first, second = rotation.exp([0.3, -0.8, 0.4]), rotation.exp([-1.2, 0.1, 0.6])
    nodes = [
        {"name": "root", "children": [1], "rotation": first.tolist()},
        {"name": "arm", "translation": [0, 1, 0], "rotation": second.tolist()},
    ]
    values = [second.tolist(), rotation.multiply(second, rotation.exp([0.0, 0.9, 0.0])).tolist()]
    stays = {"node": 0, "path": "translation", "times": [0.0], "values": [[0, 0, 0]]}
    clip = load_made(tmp_path, made_of(nodes, [turning(node=1, values=values), stays]))
    np.testing.assert_allclose(rotation.angle_between(clip.local_rotations[0], [rotation.IDENTITY] * 2), 0.0, atol=1e-6)
    np.testing.assert_allclose(clip.skeleton.offsets[1], rotation.rotate(first, [0.0, 1.0, 0.0]), atol=1e-6)
    turned = rotation.multiply(clip.local_rotations[-1, 0], clip.local_rotations[-1, 1])
    bound = rotation.multiply(first, second)
    expected = rotation.multiply(first, np.array(values[1]))
    np.testing.assert_allclose(rotation.angle_between(rotation.multiply(turned, bound), expected), 0.0, atol=1e-6)


def test_numbers_of_two_bytes_and_rows_with_gaps(tmp_path: Path) -> None:
    short = np.round(np.array([STILL, QUARTER]) * 32767)
    plain = load_made(tmp_path, made_of(ARM, [turning()]))
    stored = {"dtype": "<i2", "component": 5122, "normalized": True}
    packed = load_made(tmp_path, made_of(ARM, [turning(values=short, stored=stored)]))
    np.testing.assert_allclose(rotation.angle_between(plain.local_rotations, packed.local_rotations), 0.0, atol=1e-4)
    document = made_of(ARM, [turning(values=[[*STILL, 9.0], [*QUARTER, 9.0]])])
    document["bufferViews"][1] |= {"byteStride": 20}
    assert load_made(tmp_path, document).fps == 30.0


def test_a_place_that_is_held_elsewhere_than_at_rest_is_the_bones(tmp_path: Path) -> None:
    held = {"node": 1, "path": "translation", "times": [0, 1], "values": [[0, 2, 0], [0, 2, 0]]}
    clip = load_made(tmp_path, made_of(ARM, [turning(), held]))
    np.testing.assert_allclose(kinematics.forward(clip)[1][0, 1], [0.0, 2.0, 0.0], atol=1e-6)
    assert clip.translations is None


@pytest.mark.parametrize("fps", [12.0, 24000 / 1001, 25.0, 29.97, 30.0, 1 / 0.033333, 59.94, 1 / 0.008333])
def test_rates_come_back(tmp_path: Path, fps: float) -> None:
    """Our own files tell their rate; of others' it is read off the keys, which are in 32 bits."""
    for n_frames in (1, 10, 1000):
        clip = Clip(BOOK.skeleton, np.repeat(BOOK.local_rotations[:1], n_frames, axis=0), np.zeros((n_frames, 3)), fps)
        ss.save(clip, tmp_path / "a.vrma")
        back = ss.load(tmp_path / "a.vrma")
        assert (back.fps, len(back)) == (fps, n_frames)
        if n_frames > 1:
            times = (np.arange(n_frames) / fps).astype("f4")
            other = load_made(tmp_path, made_of(ARM, [turning(times=times, values=[STILL] * n_frames)]))
            assert len(other) == n_frames
            assert other.fps == pytest.approx(fps, rel=1e-4)


def test_steps_come_at_their_own_frames(tmp_path: Path) -> None:
    values = rotation.exp(np.linspace(0.0, 3.0, 200)[:, None] * [0.0, 0.0, 1.0])
    channel = turning(times=np.arange(200) / 30.0, values=values, between="STEP")
    clip = load_made(tmp_path, made_of(ARM, [channel]))
    np.testing.assert_allclose(rotation.angle_between(clip.local_rotations[:, 0], values), 0.0, atol=1e-6)


def test_a_year_of_signing_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match="at 30 a second are more than a clip may hold"):
        load_made(tmp_path, made_of(ARM, [turning(times=[0, 3e7])]))


def test_what_is_no_joint_does_not_count(tmp_path: Path) -> None:
    """A prop that grows and a camera that goes on for minutes, beside a skin."""
    nodes: list[dict[str, Any]] = [*ARM, {"name": "prop"}, {"name": "camera"}]
    grows = {"node": 2, "path": "scale", "times": [0, 1], "values": [[1, 1, 1], [1, 2, 1]]}
    films = {"node": 3, "path": "translation", "times": [0, 300], "values": [[0, 0, 0], [1, 0, 0]]}
    document = made_of(nodes, [turning(), grows, films], skins=[{"joints": [0, 1]}])
    assert len(load_made(tmp_path, document)) == 31
    larger = {"node": 0, "path": "scale", "times": [0, 1], "values": [[2, 2, 2], [2, 2, 2]]}
    clip = load_made(tmp_path, made_of(ARM, [turning(), larger]))
    np.testing.assert_allclose(kinematics.forward(clip)[1][0, 1], [0.0, 2.0, 0.0], atol=1e-6)


def test_roles_of_a_roles_file_come_back(tmp_path: Path) -> None:
    joints = find_roles(BOOK.skeleton).joints
    names = tuple(f"j{n}" for n in range(len(BOOK.skeleton)))
    told = {role: names[joint] for role, joint in joints.items()}
    skeleton = Skeleton(names, BOOK.skeleton.parents, BOOK.skeleton.offsets, roles=told)
    ss.save(Clip(skeleton, BOOK.local_rotations, BOOK.root_positions, BOOK.fps), tmp_path / "a.glb")
    assert ss.load(tmp_path / "a.glb").skeleton.roles == told


def test_soles_are_on_the_floor_and_hips_as_high_as_at_rest(tmp_path: Path) -> None:
    made = gltf.person(BOOK)
    lowest = min(made.accessors[p.attributes.POSITION].min[1] for p in made.meshes[0].primitives)
    assert lowest < -0.5, "bound with the root at the origin"
    hips = BOOK.skeleton.index["mixamorig:Hips"]
    soles = places_of(BOOK)[0, hips, 1] + lowest
    assert abs(soles) < 0.02, "the mannequin's lowest point, with the hips where they are"
    told = gltf.vrm_animation(BOOK)
    assert told.nodes[0].name == "hips"
    assert told.nodes[0].translation[1] == pytest.approx(places_of(BOOK)[0, hips, 1], abs=0.02)


def test_a_body_without_legs_has_hips_where_others_have_them() -> None:
    keep = [n for n, name in enumerate(BOOK.skeleton.names) if not any(p in name for p in ("Leg", "Foot", "Toe"))]
    parents = np.array([keep.index(int(p)) if p >= 0 else -1 for p in BOOK.skeleton.parents[keep]])
    names = tuple(BOOK.skeleton.names[n] for n in keep)
    skeleton = Skeleton(names, parents, BOOK.skeleton.offsets[keep])
    told = gltf.vrm_animation(Clip(skeleton, BOOK.local_rotations[:, keep], BOOK.root_positions, 30.0))
    assert 0.7 < told.nodes[0].translation[1] < 1.2


def test_eyes_are_not_told(tmp_path: Path) -> None:
    head = BOOK.skeleton.index["mixamorig:Head"]
    skeleton = Skeleton(
        (*BOOK.skeleton.names, "LeftEye"),
        np.append(BOOK.skeleton.parents, head),
        np.concatenate([BOOK.skeleton.offsets, [[3.0, 8.0, 8.0]]]),
    )
    local = np.concatenate([BOOK.local_rotations, np.tile(rotation.IDENTITY, (len(BOOK), 1, 1))], axis=1)
    clip = Clip(skeleton, local, BOOK.root_positions, BOOK.fps)
    assert "leftEye" in find_roles(skeleton).joints
    assert "leftEye" not in {node.name for node in gltf.vrm_animation(clip).nodes}


def test_names_that_come_twice_are_told_apart(tmp_path: Path) -> None:
    nodes: list[dict[str, Any]] = [{"name": "bone", "children": [1, 2]}, {"name": "bone"}, {"name": "bone 2"}]
    channels = [turning(node=node) for node in range(3)]
    assert load_made(tmp_path, made_of(nodes, channels)).skeleton.names == ("bone", "bone 3", "bone 2")


def wrong(change: Any) -> dict[str, Any]:
    document = made_of([dict(node) for node in ARM], [turning()])
    change(document)
    return document


WRONG: dict[str, tuple[Any, str]] = {
    "no animation": (lambda d: d.pop("animations"), "holds no animation, expected an animated skeleton"),
    "only sizes": (
        lambda d: d["animations"][0]["channels"][0]["target"].update(path="weights"),
        "animates no node's rotation or place",
    ),
    "two roots": (
        lambda d: (d["nodes"][0].pop("children"), d["animations"][0]["channels"].append(
            {"sampler": 0, "target": {"node": 1, "path": "rotation"}})),
        "several roots",
    ),
    "a node above itself": (lambda d: d["nodes"][1].update(children=[0]), "lies above itself"),
    "uneven scale": (lambda d: d["nodes"][1].update(scale=[1, 2, 1]), "is scaled by"),
    "no such buffer": (lambda d: d["bufferViews"][0].update(byteLength=3), "reaches beyond"),
    "beyond the buffer": (lambda d: d["accessors"][0].update(count=10**6), "reaches beyond"),
    "times that fall": (lambda d: d["accessors"][0].update(bufferView=1, count=2), "rising times"),
    "a file elsewhere": (lambda d: d["buffers"][0].update(uri="../secret.bin"), "expected a file beside this one"),
    "a file that is not there": (lambda d: d["buffers"][0].update(uri="gone.bin"), "no such file"),
    "no base64": (lambda d: d["buffers"][0].update(uri="data:x;base64,$$"), "is no base64"),
    "sparse": (lambda d: d["accessors"][1].update(sparse={
        "count": 1, "indices": {"bufferView": 0, "componentType": 5125}, "values": {"bufferView": 0}}), "is sparse"),
    "more than memory": (lambda d: d["accessors"][0].update(count=10**9), "more than a clip may"),
    "glTF 1": (lambda d: d["asset"].update(version="1.0"), "is glTF 1.0, expected 2.0"),
    "packed": (lambda d: d.update(extensionsRequired=["EXT_meshopt_compression"]), "which is not read"),
    "numbers below 0": (lambda d: d["animations"][0]["samplers"][0].update(input=-2), "accessor -2 is no such"),
    "no such node": (lambda d: d["animations"][0]["channels"][0]["target"].update(node=7), "is no node"),
}  # fmt: skip


@pytest.mark.parametrize("what", WRONG)
def test_what_cannot_be_read_is_refused_in_a_line(tmp_path: Path, what: str) -> None:
    change, expected = WRONG[what]
    with pytest.raises(InputError, match=expected) as caught:
        load_made(tmp_path, wrong(change))
    assert "\n" not in str(caught.value)
    assert "made.gltf" in str(caught.value) or "gone.bin" in str(caught.value)


def test_broken_binary_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.glb"
    ss.save(BOOK[:3], path)
    whole = path.read_bytes()
    for content, expected in (
        (b"", "are no glTF file|no sound glTF"),
        (b"glTF", "4 bytes are no glTF file"),
        (whole[:1000], "it is cut short"),
        (whole[:4] + struct.pack("<I", 1) + whole[8:], "is glTF 1, expected 2"),
        (whole[:12] + struct.pack("<I", 2**31) + whole[16:], "reaches beyond the file's end"),
        (whole[:16] + b"NOSJ" + whole[20:], "has no JSON chunk"),
        (b"HIERARCHY\nROOT hips", "no sound glTF"),
        (b"[]", "no sound glTF"),
    ):
        path.write_bytes(content)
        with pytest.raises(FormatError, match=expected):
            ss.load(path)


def test_mutated_files_are_read_or_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.vrma"
    ss.save(BOOK[:4], path)
    whole = bytearray(path.read_bytes())
    rng = np.random.default_rng(0)
    refused = 0
    for _ in range(150):
        broken = bytearray(whole)
        for at in rng.integers(20, len(whole) if rng.random() < 0.3 else 6000, rng.integers(1, 4)):
            broken[at] = rng.integers(256)
        path.write_bytes(bytes(broken))
        try:
            clip = ss.load(path)
        except FormatError:
            refused += 1
        else:
            assert np.isfinite(kinematics.forward(clip)[1]).all()
    assert 10 < refused < 150


# What others make of what we write.


@pytest.fixture(scope="module")
def seen_elsewhere(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What the Khronos validator, three.js and three-vrm-animation say of a written .glb and .vrma."""
    if shutil.which("node") is None or not (VIEWER / "node_modules").is_dir():
        pytest.skip("no node, or viewer/node_modules is not installed")
    folder = tmp_path_factory.mktemp("gltf")
    files = [folder / "book.glb", folder / "book.vrma"]
    for path in files:
        ss.save(BOOK, path)
    command = ["node", str(VIEWER / "checks" / "gltf.mjs"), "--times", "0,0.5,1.1", *map(str, files)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return {Path(line["file"]).suffix: line for line in map(json.loads, done.stdout.splitlines())}


def test_the_validator_finds_nothing(seen_elsewhere: dict[str, Any]) -> None:
    person, animation = seen_elsewhere[".glb"], seen_elsewhere[".vrma"]
    assert (person["errors"], person["warnings"], person["messages"]) == (0, 0, [])
    assert (animation["errors"], animation["warnings"]) == (0, 0)
    assert {message.split()[0] for message in animation["messages"]} <= {"UNSUPPORTED_EXTENSION", "NODE_EMPTY"}


def test_joints_are_where_three_js_puts_them(seen_elsewhere: dict[str, Any]) -> None:
    clip = BOOK
    expected = places_of(clip)
    for time, places in zip((0.0, 0.5, 1.1), seen_elsewhere[".glb"]["places"], strict=True):
        frame = time * clip.fps
        assert frame == pytest.approx(round(frame))
        for joint, name in enumerate(clip.skeleton.names):
            np.testing.assert_allclose(places[name], expected[round(frame), joint], atol=1e-4)


def test_three_vrm_reads_the_turns_of_every_bone(seen_elsewhere: dict[str, Any]) -> None:
    bones = seen_elsewhere[".vrma"]["bones"]
    own = canonical_motion(BOOK)
    for role, values in bones["turns"].items():
        if role in ROLES:
            angles = rotation.angle_between(np.array(values).reshape(-1, 4), own.quats[:, ROLES.index(role)])
            np.testing.assert_allclose(angles, 0.0, atol=1e-5)
    assert set(bones["turns"]) == set(find_roles(BOOK.skeleton).joints)


def test_the_file_says_who_made_it_and_holds_one_skin(tmp_path: Path) -> None:
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
    (armature,) = (thing for thing in bpy.data.objects if thing.type == "ARMATURE")
    mesh = bpy.data.objects["mannequin"]
    assert [modifier.type for modifier in mesh.modifiers] == ["ARMATURE"]
    assert {bone.name for bone in armature.data.bones} == set(BOOK.skeleton.names)
    assert armature.animation_data.action is not None
    expected = places_of(BOOK)
    for frame in (0, 30):
        bpy.context.scene.frame_set(frame)
        bpy.context.view_layer.update()
        for name in ("mixamorig:RightHand", "mixamorig:LeftHandIndex3", "mixamorig:Head"):
            x, y, z = armature.matrix_world @ armature.pose.bones[name].head
            np.testing.assert_allclose([x, z, -y], expected[frame, BOOK.skeleton.index[name]], atol=1e-4)
