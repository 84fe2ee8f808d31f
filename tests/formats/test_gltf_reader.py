"""glTF files that others wrote: any animated skeleton is read, and what cannot be read is refused in one line."""

from __future__ import annotations

import copy
import json
import re
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import signsplice as ss
from gltf_documents import ARM, IDENTITY, QUARTER, changed, document, load_document, rotating
from signsplice.errors import FormatError, InputError
from signsplice.formats import parse
from signsplice.lexicon import open_shipped_lexicon
from signsplice.motion import Clip, Skeleton, kinematics, rotation
from signsplice.rig.inspection import inspect

BOOK = open_shipped_lexicon().clip("BOOK")


@pytest.mark.parametrize(
    ("interpolation", "values", "expected"),
    [
        ("LINEAR", [IDENTITY, QUARTER], lambda s: 90.0 * s),
        ("STEP", [IDENTITY, QUARTER], lambda s: np.where(s < 1.0, 0.0, 90.0)),
        (
            "CUBICSPLINE",
            [[0.0] * 4, IDENTITY, [0.0] * 4, [0.0] * 4, QUARTER, [0.0] * 4],
            lambda s: np.degrees(2 * np.arctan2(np.sqrt(0.5) * ease(s), 1 - ease(s) + np.sqrt(0.5) * ease(s))),
        ),
    ],
)
def test_keys_are_interpolated_as_the_file_says(tmp_path: Path, interpolation: str, values: Any, expected: Any) -> None:
    clip = load_document(tmp_path, document(ARM, [rotating(values=values, interpolation=interpolation)]))
    assert (clip.fps, len(clip), clip.name) == (30.0, 31, "wave")
    angle = np.degrees(rotation.twist_angle(clip.local_rotations[:, 0], [0.0, 0.0, 1.0]))
    np.testing.assert_allclose(angle, expected(np.arange(31) / 30.0), atol=1e-4)


def ease(s: np.ndarray) -> np.ndarray:
    return np.asarray(s**2 * (3 - 2 * s))


def test_transforms_above_the_skeleton_go_into_the_root(tmp_path: Path) -> None:
    half = np.sqrt(0.5)
    armature = {
        "name": "Armature",
        "children": [1],
        "rotation": [-half, 0, 0, half],
        "scale": [0.01] * 3,
        "translation": [0, 0, 2],
    }
    nodes = [
        armature,
        {"name": "hip", "children": [2], "translation": [0, 0, 90]},
        {"name": "knee", "translation": [0, 0, -45]},
    ]
    moves = {"node": 1, "path": "translation", "times": [0, 0.04], "values": [[0, 0, 90], [10, 0, 90]]}
    clip = load_document(tmp_path, document(nodes, [moves, rotating(node=2)]))
    assert clip.skeleton.names == ("hip", "knee")
    assert clip.fps == 25.0
    _, positions = kinematics.forward(clip)
    np.testing.assert_allclose(positions[0], [[0.0, 0.9, 2.0], [0.0, 0.45, 2.0]], atol=1e-6)
    np.testing.assert_allclose(positions[1, 0], [0.1, 0.9, 2.0], atol=1e-6)


def test_the_bind_pose_is_the_rest_pose(tmp_path: Path) -> None:
    """A file whose nodes are rotated at rest, as Blender writes bones: at rest the clip's rotations are identities."""
    first, second = rotation.exp([0.3, -0.8, 0.4]), rotation.exp([-1.2, 0.1, 0.6])
    nodes = [
        {"name": "root", "children": [1], "rotation": first.tolist()},
        {"name": "arm", "translation": [0, 1, 0], "rotation": second.tolist()},
    ]
    values = [second.tolist(), rotation.multiply(second, rotation.exp([0.0, 0.9, 0.0])).tolist()]
    stays = {"node": 0, "path": "translation", "times": [0.0], "values": [[0, 0, 0]]}
    clip = load_document(tmp_path, document(nodes, [rotating(node=1, values=values), stays]))
    np.testing.assert_allclose(rotation.angle_between(clip.local_rotations[0], [rotation.IDENTITY] * 2), 0.0, atol=1e-6)
    np.testing.assert_allclose(clip.skeleton.offsets[1], rotation.rotate(first, [0.0, 1.0, 0.0]), atol=1e-6)
    moved = rotation.multiply(clip.local_rotations[-1, 0], clip.local_rotations[-1, 1])
    bound = rotation.multiply(first, second)
    expected = rotation.multiply(first, np.array(values[1]))
    np.testing.assert_allclose(rotation.angle_between(rotation.multiply(moved, bound), expected), 0.0, atol=1e-6)


def test_normalized_integers_and_strided_rows_are_read(tmp_path: Path) -> None:
    short = np.round(np.array([IDENTITY, QUARTER]) * 32767)
    plain = load_document(tmp_path, document(ARM, [rotating()]))
    stored = {"dtype": "<i2", "component": 5122, "normalized": True}
    packed = load_document(tmp_path, document(ARM, [rotating(values=short, stored=stored)]))
    np.testing.assert_allclose(rotation.angle_between(plain.local_rotations, packed.local_rotations), 0.0, atol=1e-4)
    content = document(ARM, [rotating(values=[[*IDENTITY, 9.0], [*QUARTER, 9.0]])])
    content["bufferViews"][1] |= {"byteStride": 20}
    assert load_document(tmp_path, content).fps == 30.0


def test_a_constant_translation_replaces_the_rest_translation(tmp_path: Path) -> None:
    held = {"node": 1, "path": "translation", "times": [0, 1], "values": [[0, 2, 0], [0, 2, 0]]}
    clip = load_document(tmp_path, document(ARM, [rotating(), held]))
    np.testing.assert_allclose(kinematics.forward(clip)[1][0, 1], [0.0, 2.0, 0.0], atol=1e-6)
    assert clip.translations is None


@pytest.mark.parametrize("fps", [12.0, 24000 / 1001, 25.0, 29.97, 30.0, 1 / 0.033333, 59.94, 1 / 0.008333])
def test_frame_rates_come_back(tmp_path: Path, fps: float) -> None:
    """Our own files store their rate; that of others is found from the keys, whose times are in 32 bits."""
    offsets = np.array([[0.0, 0.0, 0.0], [0.0, 0.1, 0.0]])
    skeleton = Skeleton(("a", "b"), np.array([-1, 0]), offsets, roles={"hips": "a"})
    for n_frames in (1, 10, 1000):
        clip = Clip(skeleton, np.tile(rotation.IDENTITY, (n_frames, 2, 1)), np.zeros((n_frames, 3)), fps)
        ss.save(clip, tmp_path / "a.vrma")
        back = ss.load(tmp_path / "a.vrma")
        assert (back.fps, len(back)) == (fps, n_frames)
        if n_frames > 1:
            times = (np.arange(n_frames) / fps).astype("f4")
            other = load_document(tmp_path, document(ARM, [rotating(times=times, values=[IDENTITY] * n_frames)]))
            assert len(other) == n_frames
            assert other.fps == pytest.approx(fps, rel=1e-4)


def test_a_clip_ends_on_the_last_key(tmp_path: Path) -> None:
    times = np.array([0.0, 0.04, 0.07, 0.12, 0.155])
    values = rotation.exp(np.linspace(0.0, 1.0, 5)[:, None] * [0.0, 0.0, 1.0])
    clip = load_document(tmp_path, document(ARM, [rotating(times=times, values=values)]))
    np.testing.assert_allclose(rotation.angle_between(clip.local_rotations[-1, 0], values[-1]), 0.0, atol=1e-6)
    assert 0.155 * clip.fps <= len(clip) - 1 < 0.155 * clip.fps + 1.0


@pytest.mark.parametrize(
    ("fps", "generator", "expected"),
    [(7, "", 25.0), (1000, "", 25.0), (50, "", 50.0), (25, "", 25.0), ("25", "", 25.0), (7, "signsplice", 7.0)],
)
def test_a_frame_rate_in_extras_is_believed_where_keys_confirm_it(
    tmp_path: Path, fps: Any, generator: str, expected: float
) -> None:
    content = document(ARM, [rotating(times=np.arange(9) / 25.0, values=[IDENTITY, *[QUARTER] * 8])])
    content["animations"][0]["extras"] = {"fps": fps}
    content["asset"]["generator"] = generator
    assert load_document(tmp_path, content).fps == expected


def test_steps_fall_on_their_own_frames(tmp_path: Path) -> None:
    values = rotation.exp(np.linspace(0.0, 3.0, 200)[:, None] * [0.0, 0.0, 1.0])
    channel = rotating(times=np.arange(200) / 30.0, values=values, interpolation="STEP")
    clip = load_document(tmp_path, document(ARM, [channel]))
    np.testing.assert_allclose(rotation.angle_between(clip.local_rotations[:, 0], values), 0.0, atol=1e-6)


def test_clips_that_are_too_long_are_refused(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match=r"900,000,000 frames, expected at most 86,400 seconds"):
        load_document(tmp_path, document(ARM, [rotating(times=[0, 3e7])]))


def test_nodes_that_are_not_joints_are_ignored(tmp_path: Path) -> None:
    """A prop that changes its size and a camera that moves for minutes, in a file with a skin."""
    nodes: list[dict[str, Any]] = [*ARM, {"name": "prop"}, {"name": "camera"}]
    grows = {"node": 2, "path": "scale", "times": [0, 1], "values": [[1, 1, 1], [1, 2, 1]]}
    films = {"node": 3, "path": "translation", "times": [0, 300], "values": [[0, 0, 0], [1, 0, 0]]}
    content = document(nodes, [rotating(), grows, films], skins=[{"joints": [0, 1]}])
    assert len(load_document(tmp_path, content)) == 31
    larger = {"node": 0, "path": "scale", "times": [0, 1], "values": [[2, 2, 2], [2, 2, 2]]}
    clip = load_document(tmp_path, document(ARM, [rotating(), larger]))
    np.testing.assert_allclose(kinematics.forward(clip)[1][0, 1], [0.0, 2.0, 0.0], atol=1e-6)


def test_duplicate_joint_names_get_numbers(tmp_path: Path) -> None:
    nodes: list[dict[str, Any]] = [{"name": "bone", "children": [1, 2]}, {"name": "bone"}, {"name": "bone 2"}]
    channels = [rotating(node=node) for node in range(3)]
    assert load_document(tmp_path, document(nodes, channels)).skeleton.names == ("bone", "bone 3", "bone 2")


INVALID: dict[str, tuple[Any, str]] = {
    "no animation": (lambda d: d.pop("animations"), "holds no animation, expected an animated skeleton"),
    "only morph targets": (
        lambda d: d["animations"][0]["channels"][0]["target"].update(path="weights"),
        "animates no node's rotation or position",
    ),
    "two roots": (
        lambda d: (d["nodes"][0].pop("children"), d["animations"][0]["channels"].append(
            {"sampler": 0, "target": {"node": 1, "path": "rotation"}})),
        "several roots",
    ),
    "a cycle of nodes": (lambda d: d["nodes"][1].update(children=[0]), "is its own ancestor"),
    "uneven scale": (lambda d: d["nodes"][1].update(scale=[1, 2, 1]), "is scaled by"),
    "no such buffer": (lambda d: d["bufferViews"][0].update(byteLength=3), "reaches beyond"),
    "beyond the buffer": (lambda d: d["accessors"][0].update(count=10**6), "reaches beyond"),
    "falling times": (lambda d: d["accessors"][0].update(bufferView=1, count=2), "rising times"),
    "a file elsewhere": (lambda d: d["buffers"][0].update(uri="../secret.bin"), "expected a file in the same folder"),
    "a missing file": (lambda d: d["buffers"][0].update(uri="gone.bin"), "no such file"),
    "no base64": (lambda d: d["buffers"][0].update(uri="data:x;base64,$$"), "is no base64"),
    "sparse beyond": (lambda d: d["accessors"][1].update(sparse={
        "count": 1, "indices": {"bufferView": 0, "componentType": 5125, "byteOffset": 4}, "values": {"bufferView": 1}}),
        "the sparse part of accessor 1 names rows beyond"),
    "empty": (lambda d: d["accessors"][1].pop("bufferView"), "accessor 1 is empty"),
    "more than memory": (lambda d: d["accessors"][0].update(count=10**9), "reaches beyond"),
    "glTF 1": (lambda d: d["asset"].update(version="1.0"), "is glTF 1.0, expected 2.0"),
    "an unknown extension": (lambda d: d.update(extensionsRequired=["VRM", "A\n_b"]), r"extension 'A\\n_b', which is"),
    "for newer readers": (lambda d: d["asset"].update(minVersion="2.1"), "needs a reader of glTF 2.1, expected 2.0"),
    "an unknown interpolation": (lambda d: d["animations"][0]["samplers"][0].update(interpolation="BEZIER"),
        "rotation of node 0 is interpolated by 'BEZIER', expected LINEAR, STEP, CUBICSPLINE"),
    "mirrored": (lambda d: d["nodes"][1].update(matrix=[1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1, 0, 0, 1, 0, 1]),
        "the matrix of node 'arm' mirrors or shears"),
    "sheared": (lambda d: d["nodes"][1].update(matrix=[1, 0, 0, 0, 0.6, 0.8, 0, 0, 0, 0, 1, 0, 0, 1, 0, 1]),
        "the matrix of node 'arm' mirrors or shears"),
    "a perspective": (lambda d: d["nodes"][1].update(matrix=[1, 0, 0, 0.1, 0, 1, 0, 0, 0, 0, 1, 0, 0, 1, 0, 1]),
        r"the matrix of node 'arm' has the last row \[0.1, 0.0, 0.0, 1.0\]"),
    "a negative number": (lambda d: d["animations"][0]["samplers"][0].update(input=-2), "accessor -2 is no such"),
    "lines for a number": (lambda d: d["bufferViews"][0].update(buffer="a\u2028b\n"), "buffer 'a.* is no such"),
    "lines for a version": (lambda d: d["asset"].update(version="1\n2\u2028"), "is glTF 1 2 , expected 2.0"),
    "a long version": (lambda d: d["asset"].update(version={"1": "9" * 1000}), "is glTF {'1': '9{33}, expected 2.0"),
    "no such node": (lambda d: d["animations"][0]["channels"][0]["target"].update(node=7), "is no node"),
}  # fmt: skip


@pytest.mark.parametrize("what", INVALID)
def test_invalid_documents_are_refused_in_one_line(tmp_path: Path, what: str) -> None:
    change, expected = INVALID[what]
    with pytest.raises(InputError, match=expected) as caught:
        load_document(tmp_path, changed(change))
    assert len(str(caught.value).splitlines()) == 1
    assert "made.gltf" in str(caught.value) or "gone.bin" in str(caught.value)


def test_broken_binary_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.vrma"
    ss.save(BOOK[:3], path)
    whole = path.read_bytes()
    for content, expected in (
        (b"", r"a\.vrma:1: is no JSON \(Expecting value\), expected a glTF document"),
        (b"glTF", "4 bytes are no glTF file"),
        (whole[:1000], "it is cut short"),
        (whole[:4] + struct.pack("<I", 1) + whole[8:], "is glTF 1, expected 2"),
        (whole[:12] + struct.pack("<I", 2**31) + whole[16:], "reaches beyond the file's end"),
        (whole[:16] + b"NOSJ" + whole[20:], "has no JSON chunk"),
        (b"HIERARCHY\nROOT hips", r"a\.vrma:1: is no JSON"),
        (b"[]", "its JSON is no object"),
    ):
        path.write_bytes(content)
        with pytest.raises(FormatError, match=expected):
            ss.load(path)


def test_randomly_changed_files_are_read_or_refused(tmp_path: Path) -> None:
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


def test_what_is_animated_besides_joints_is_named(tmp_path: Path) -> None:
    nodes: list[dict[str, Any]] = [
        *ARM,
        {"name": "happy"},
        {"name": "my wink"},
        {"name": "still"},
        {"name": "gaze"},
        {"mesh": 0},
    ]
    moved = {"path": "translation", "times": [0, 1], "values": [[0.0, 0, 0], [1.0, 0, 0]]}
    channels = [rotating(), {**moved, "node": 2}, {**moved, "node": 3}, {**rotating(), "node": 5}]
    channels.append({**moved, "node": 6, "path": "weights", "values": [[0.0, 0, 0], [1.0, 1.0, 0]]})
    vrm = {
        "specVersion": "1.0",
        "humanoid": {"humanBones": {"hips": {"node": 0}, "spine": {"node": 1}}},
        "expressions": {"preset": {"happy": {"node": 2}, "sad": {"node": 4}}, "custom": {"wink": {"node": 3}}},
        "lookAt": {"node": 5},
    }
    content = document(
        nodes,
        channels,
        extensions={"VRMC_vrm_animation": vrm},
        meshes=[{"primitives": [], "extras": {"targetNames": ["smile", "frown"]}}],
    )
    clip = load_document(tmp_path, content)
    names = ("expression wink", "morph target smile", "morph target frown")
    assert clip.face is not None
    assert clip.face.of(["mouthSmileLeft"])[-1] == pytest.approx(0.8)
    assert {"eyeLookOutLeft", "eyeLookInRight"} <= {*clip.face.channels}
    assert clip.left_out == names
    assert any("expression wink" in text for text in inspect(clip)["warnings"])
    result = ss.splice([clip, clip], ss.SpliceOptions(cutter="ends", transition="slerp"))
    assert [text for text in result.warnings if "left out" in text] == [
        f"{clip.name}: {', '.join(names)} left out: a clip holds the motion of joints and faces"
    ]
    assert ss.inbetween(clip, [(1, len(clip) - 1)], "slerp").warnings == result.warnings
    assert load_document(tmp_path, document(ARM, [rotating()])).left_out == ()


def test_the_animation_that_is_read_is_named_where_there_are_several(tmp_path: Path) -> None:
    content = document(ARM, [rotating()])
    content["animations"] += [{"name": "walk"}, {}, *({"name": f"take {n}"} for n in range(4))]
    clip = load_document(tmp_path, content)
    others = "'walk', 'animation 2', 'take 0', 'take 1', 'take 2', nor 1 more"
    line = f"the file's first animation, 'wave', is read, not {others}"
    assert clip.notes == (line,)
    assert line in inspect(clip)["warnings"]
    assert f"wave: {line}" in ss.splice([clip, clip], ss.SpliceOptions(cutter="ends", transition="slerp")).warnings


@pytest.mark.parametrize(
    "broken", [3, [], {"preset": 3}, {"preset": {"happy": 7}}, {"preset": {"happy": {"node": []}}}]
)
def test_broken_expressions_keep_no_clip_from_being_read(broken: Any, tmp_path: Path) -> None:
    extension = {"VRMC_vrm_animation": {"expressions": broken, "lookAt": broken}}
    assert load_document(tmp_path, document(ARM, [rotating()], extensions=extension)).left_out == ()


def test_a_figure_without_animation_is_told_from_a_clip(tmp_path: Path) -> None:
    content = document(ARM, [rotating()])
    del content["animations"]
    with pytest.raises(
        FormatError, match=r"holds no animation, expected an animated skeleton; .*`signsplice convert` puts"
    ):
        load_document(tmp_path, content)


def test_names_that_stand_twice_get_a_number_and_names_with_spaces_become_bvh(tmp_path: Path) -> None:
    nodes = [
        {"name": "Bip01", "children": [1]},
        {"name": "Bip01 L Hand", "translation": [0, 1, 0], "children": [2]},
        {"name": "Bip01", "translation": [0, 1, 0]},
    ]
    clip = load_document(tmp_path, document(nodes, [rotating()]))
    assert clip.skeleton.names == ("Bip01", "Bip01 L Hand", "Bip01 2")
    assert clip.notes == ("joint names that stand twice get a number: 'Bip01 2'",)
    ss.save(clip, tmp_path / "made.bvh")
    again = ss.load(tmp_path / "made.bvh")
    assert again.skeleton.names == ("Bip01", "Bip01_L_Hand", "Bip01_2")
    np.testing.assert_allclose(kinematics.forward(again)[1], kinematics.forward(clip)[1], atol=1e-6)


ODD: tuple[Any, ...] = (None, [], {}, 5, "x", True, -1, 0.5, [5], {"x": 1}, [[]], [{}], 10**30)
"""JSON values of all kinds, put in the place of every other."""


def test_a_property_of_any_other_type_is_read_or_refused_in_one_line_of_words() -> None:
    """No odd content looks like a fault of the program, such as an AttributeError, which would pass through."""
    vrm = {"humanoid": {"humanBones": {"hips": {"node": 0}}}, "expressions": {"preset": {"aa": {"node": 1}}}}
    whole = document(
        ARM, [rotating(), rotating(node=1)], extensions={"VRMC_vrm_animation": vrm}, skins=[{"joints": [0, 1]}]
    )
    messages = []
    for path in list(paths(whole)):
        for value in ODD:
            content = copy.deepcopy(whole)
            place: Any = content
            for key in path[:-1]:
                place = place[key]
            place[path[-1]] = value
            try:
                parse(json.dumps(content).encode(), "a.gltf")
            except InputError as error:
                messages.append(str(error))
    assert len(messages) > 500
    assert [text for text in messages if re.search(r"\n|Error|Exception|object is|has no len", text)] == []


def paths(value: Any, above: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """The way to every value in a document."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, inner in items:
        yield (*above, key)
        yield from paths(inner, (*above, key))


def test_a_file_without_channels_is_refused_by_what_it_lacks() -> None:
    file = Path(__file__).parents[1] / "data" / "cases" / "raw_python_errors" / "animation_without_channels.gltf"
    with pytest.raises(FormatError, match=r"animation_without_channels\.gltf: animation 0 has no channels, expected a"):
        ss.load(file)
