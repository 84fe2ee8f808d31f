"""FBX: layers of a take over one another, and blend shapes as faces."""

from __future__ import annotations

import gzip
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fbx_files import TICKS, Node, Over, positions, text_6, text_7
from signsplice.formats import fbx
from signsplice.motion import FloatArray, kinematics

FOLDER = Path(__file__).parent / "fbx"
TIMES = np.linspace(0.0, 1.0, 31)
LOWER = Node(
    "Hips",
    at=(0, 90, 0),
    moves={
        **{("T", axis): ((0, 3 * axis), (1, 20)) for axis in range(3)},
        **{("R", axis): ((0, 10.0 * axis), (1, 40.0 - 30.0 * axis)) for axis in range(3)},
        **{("S", axis): ((0, 1), (1, 1.5)) for axis in range(3)},
    },
)
UPPER = Node(
    "Hips",
    moves={
        **{("T", axis): ((0, 5), (1, 9 - axis)) for axis in range(3)},
        **{("R", axis): ((0, 25.0), (1, 10.0 * axis)) for axis in range(3)},
        **{("S", axis): ((0, 2), (1, 3)) for axis in range(3)},
    },
)
ABOVE = (Node("Spine", "Hips", (0, 20, 3)), Node("Neck", "Spine", (1, 30, 0)), Node("Head", "Neck", (0, 12, 2)))


def where(content: bytes) -> FloatArray:
    clip = fbx.parse(content, "layers.fbx")
    assert clip.skeleton.names == ("Hips", "Spine", "Neck", "Head")
    return 100.0 * kinematics.forward(clip)[1]


def at(hips: Node) -> FloatArray:
    found = positions((hips, *ABOVE), TIMES)
    return np.stack([found[name] for name in ("Hips", "Spine", "Neck", "Head")], axis=1)


def keyed(translation: FloatArray, angles: FloatArray, scale: FloatArray) -> Node:
    """Hips with a key in each frame."""
    moves = {
        (move, axis): list(zip(TIMES, values[:, axis], strict=True))
        for move, values in zip("TRS", (translation, angles, scale), strict=True)
        for axis in range(3)
    }
    return replace(LOWER, moves=moves)


def turned(angles: FloatArray) -> Rotation:
    return Rotation.from_euler("xyz", angles, degrees=True)


@pytest.mark.parametrize("weight", [1.0, 0.4])
@pytest.mark.parametrize("mode", ["adds", "goes over", "mixes"])
@pytest.mark.parametrize("composed", [True, False])
def test_a_layer_adds_to_the_one_below_or_goes_over_it_by_its_weight(mode: str, weight: float, composed: bool) -> None:
    below, own = ([node.value(move, TIMES) for move in "TRS"] for node in (LOWER, UPPER))
    stays = {"adds": 1.0, "goes over": 0.0, "mixes": 1.0 - weight}[mode]
    made = [stays * one + weight * two for one, two in zip(below, own, strict=True)]
    if composed:
        under, over = turned(below[1]), turned(own[1])
        if mode == "adds":
            rotations = under * Rotation.from_rotvec(weight * over.as_rotvec())
        elif mode == "goes over":
            rotations = over
        else:
            rotations = under * Rotation.from_rotvec(weight * (under.inv() * over).as_rotvec())
        made[1] = rotations.as_euler("xyz", degrees=True)
        made[2] = below[2] ** stays * own[2] ** weight
    number = ("adds", "goes over", "mixes").index(mode)
    more = {"Weight": 100 * weight, "BlendMode": number, "RotationAccumulationMode": int(not composed),
            "ScaleAccumulationMode": int(not composed)}  # fmt: skip
    content = text_7((LOWER, *ABOVE), over=[Over((UPPER,), more)])
    np.testing.assert_allclose(where(content), at(keyed(*made)), atol=1e-9)


def test_a_weight_may_change_and_a_muted_layer_does_nothing() -> None:
    fading = Over((UPPER,), {"RotationAccumulationMode": 1, "ScaleAccumulationMode": 1}, ((0, 0), (1, 100)))
    made = (LOWER.value(move, TIMES) + TIMES[:, None] * UPPER.value(move, TIMES) for move in "TRS")
    np.testing.assert_allclose(where(text_7((LOWER, *ABOVE), over=[fading])), at(keyed(*made)), atol=1e-9)
    muted = text_7((LOWER, *ABOVE), over=[Over((UPPER,), {"Mute": 1})])
    np.testing.assert_allclose(where(muted), at(LOWER), atol=1e-9)


def test_a_layer_that_moves_what_the_lowest_does_not_starts_from_the_files_own_pose() -> None:
    content = text_7((LOWER, *ABOVE), over=[Over((Node("Head", moves={("T", 0): ((0, 0), (1, 6))}),))])
    moving = replace(ABOVE[2], moves={("T", 0): ((0, 0), (1, 6))})
    found = positions((LOWER, *ABOVE[:2], moving), TIMES)
    np.testing.assert_allclose(where(content)[:, 3], found["Head"], atol=1e-9)


def test_blenders_shape_keys_are_a_face_by_their_names() -> None:
    clip = fbx.parse(gzip.decompress((FOLDER / "blender_person.fbx.gz").read_bytes()), "person.fbx")
    assert clip.face is not None
    frames = np.arange(1, 9)[:, None]  # Blender counts from 1
    jaw, lid, happy = (0.5 + 0.5 * np.sin(0.3 * frames * np.array([[1, 2, 4]]))).T
    assert {*clip.face.channels} == {"jawOpen", "eyeBlinkLeft", "cheekSquintLeft", "cheekSquintRight"}, "no other mouth"
    np.testing.assert_allclose(clip.face.of(("jawOpen", "eyeBlinkLeft")), np.stack([jaw, lid], axis=1), atol=1e-6)
    np.testing.assert_allclose(clip.face.of(("cheekSquintRight",))[:, 0], 0.4 * happy, atol=1e-6)
    assert clip.left_out == ("blend shape Smirk",)


PERCENT = ((0.0, 0.0), (0.5, 150.0), (1.0, 50.0))


def shaped(names: Sequence[str]) -> bytes:
    """A file whose take moves blend shapes of these names by ``PERCENT``."""
    cells: dict[str, Sequence[float]] = {
        "KeyTime": [round(TICKS * time) for time, _ in PERCENT],
        "KeyValueFloat": [value for _, value in PERCENT],
        "KeyAttrFlags": [4],
        "KeyAttrDataFloat": [0] * 4,
        "KeyAttrRefCount": [len(PERCENT)],
    }
    keys = "".join(
        f"\t\t{name}: *{len(row)} {{\n\t\t\ta: {','.join(map(str, row))}\n\t\t}}\n" for name, row in cells.items()
    )
    objects, links = [], []
    for number, name in enumerate(names):
        channel, node = 9100 + 10 * number, 9105 + 10 * number
        objects += [
            f'\tDeformer: {channel}, "SubDeformer::{name}", "BlendShapeChannel" {{\n\t}}',
            f'\tAnimationCurveNode: {node}, "AnimCurveNode::DeformPercent", "" {{\n\t}}',
            f'\tAnimationCurve: {node + 1}, "AnimCurve::", "" {{\n{keys}\t}}',
        ]
        links += [
            f'\tC: "OO",{node},30',
            f'\tC: "OP",{node},{channel}, "DeformPercent"',
            f'\tC: "OP",{node + 1},{node}, "d|DeformPercent"',
        ]
    text = text_7((LOWER, *ABOVE)).decode().replace("Objects:  {\n", "Objects:  {\n" + "\n".join(objects) + "\n", 1)
    return text.replace("Connections:  {\n", "Connections:  {\n" + "\n".join(links) + "\n", 1).encode()


@pytest.mark.parametrize("name", ["jawOpen", "head.jawOpen", "blendShape1.jawOpen", "rig:JawOpen", "a|b|jaw_open"])
def test_blend_shapes_are_known_with_what_maya_and_others_write_before_their_names(name: str) -> None:
    clip = fbx.parse(shaped([name, "Smirk"]), "face.fbx")
    assert clip.face is not None
    expected = np.interp(TIMES, [0.0, 0.5, 1.0], [0.0, 1.5, 0.5]).clip(0.0, 1.0)
    np.testing.assert_allclose(clip.face.of(("jawOpen",))[:, 0], expected, atol=1e-9)
    assert clip.left_out == ("blend shape Smirk",)


def test_a_file_without_known_blend_shapes_has_no_face() -> None:
    clip = fbx.parse(shaped(["Smirk", "Grin"]), "face.fbx")
    assert clip.face is None
    assert clip.left_out == ("blend shape Smirk", "blend shape Grin")


def test_version_6_names_the_blend_shapes_that_are_left_out() -> None:
    text = text_6((LOWER, *ABOVE)).decode()
    jaw = '\t\t\tChannel: "jawOpen" {\n\t\t\t\tKey: 0,0,L,46186158000,90,L\n\t\t\t}\n'
    view = jaw.replace("jawOpen", "FieldOfView")
    at = text.index('\t\t\tChannel: "Transform"')
    clip = fbx.parse((text[:at] + jaw + view + text[at:]).encode(), "old.fbx")
    assert clip.left_out == ("blend shape jawOpen",)
    assert clip.face is None
