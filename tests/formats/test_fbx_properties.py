"""FBX properties: values that objects leave to the templates of their class, and settings wherever a version keeps
them; small files that were read wrongly.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import signsplice as ss
from fbx_files import TICKS, Node, Over, positions, text_6, text_7
from signsplice.formats import fbx, load
from signsplice.formats.fbx_records import FbxObjects
from signsplice.formats.fbx_scene import FbxScene
from signsplice.formats.reading import DEFAULT_LIMITS
from signsplice.motion import Clip, FloatArray, kinematics

CASES = Path(__file__).parent.parent / "data" / "cases"
TURNS = {("R", 0): ((0.0, 5.0), (1.0, 70.0)), ("R", 1): ((0.0, 10.0), (1.0, -40.0)), ("R", 2): ((0, 0.0), (1, 30.0))}
TRUNK = (
    Node("Hips", at=(0, 90, 0), moves={("T", 0): ((0, 0), (1, 20)), **TURNS}),
    Node("Spine", "Hips", (3, 20, 3), moves=TURNS),
    Node("Neck", "Spine", (1, 30, 0), moves=TURNS),
    Node("Head", "Neck", (0, 12, 2)),
)


def locate(clip: Clip) -> FloatArray:
    return 100.0 * kinematics.forward(clip)[1]


def expect(nodes: Sequence[Node], n_frames: int = 31) -> FloatArray:
    found = positions(nodes, np.arange(n_frames) / 30.0)
    return np.stack([found[node.name] for node in nodes], axis=1)


def without(text: bytes, names: Sequence[str], indent: int = 3) -> bytes:
    """The file without some properties of its objects."""
    rows = text.decode().split("\n")
    starts = tuple("\t" * indent + f'P: "{name}"' for name in names)
    assert any(row.startswith(starts) for row in rows)
    return "\n".join(row for row in rows if not row.startswith(starts)).encode()


SCALE, TURN = (1.5, 0.7, 1.1), (10.0, 20.0, -30.0)
PIVOT, OFFSET = (1.0, 2.0, 3.0), (0.0, 2.0, -1.0)
SHIFT = {("T", 0): ((0.0, 0.0), (1.0, 20.0))}
LEFT_OUT: dict[str, tuple[dict[str, Sequence[float]], dict[str, Any]]] = {
    "rotation order": ({"RotationOrder": (3,), "RotationActive": (1,)}, {"order": 3}),
    "inherit type 0": ({"InheritType": (0,), "Lcl Scaling": SCALE}, {"inherit": 0, "scale": SCALE}),
    "inherit type 2": ({"InheritType": (2,), "Lcl Scaling": SCALE}, {"inherit": 2, "scale": SCALE}),
    "translation": ({"Lcl Translation": (4.0, 17.0, 2.0)}, {"at": (4.0, 17.0, 2.0)}),
    "rotation": ({"Lcl Rotation": TURN}, {"turned": TURN, "moves": SHIFT}),
    **{
        name: ({name: row, "Lcl Scaling": SCALE}, {"more": {name: row}, "scale": SCALE})
        for name, row in {
            "PreRotation": TURN,
            "PostRotation": TURN,
            "RotationPivot": PIVOT,
            "RotationOffset": OFFSET,
            "ScalingPivot": PIVOT,
            "ScalingOffset": OFFSET,
        }.items()
    },
}
"""Properties of a template, and the same as the nodes' own."""


@pytest.mark.parametrize("what", LEFT_OUT)
@pytest.mark.parametrize("kind", ["FbxNode", "KFbxNode"])
def test_what_a_model_leaves_out_stands_in_its_template(what: str, kind: str) -> None:
    properties, fields = LEFT_OUT[what]
    nodes = [replace(node, **fields) for node in TRUNK]
    text = text_7(nodes, templates={f"Model {kind}": properties})
    clip = fbx.parse(without(text, [*properties]), "template.fbx")
    np.testing.assert_allclose(locate(clip), expect(nodes), atol=1e-9)
    assert np.abs(expect(nodes) - expect(TRUNK)).max() > 0.5
    other = text_7(nodes, templates={f"Model {kind}": dict.fromkeys(properties, (2.0, 2.0, 2.0))})
    np.testing.assert_allclose(locate(fbx.parse(other, "own.fbx")), expect(nodes), atol=1e-9)  # their own values count


def test_what_a_node_of_curves_leaves_out_stands_in_its_template() -> None:
    """As FBX2glTF 0.9.7 shows it."""
    text = text_7(TRUNK, templates={"AnimationCurveNode FbxAnimCurveNode": {"d|Y": (55.0,), "d|Z": (-7.0,)}})
    clip = fbx.parse(without(text, ["d|Y", "d|Z"]), "node.fbx")
    hips = 100.0 * clip.root_positions
    np.testing.assert_allclose(hips[[0, -1]], [[0.0, 55.0, -7.0], [20.0, 55.0, -7.0]], atol=1e-9)


def test_what_a_layer_or_a_take_leaves_out_stands_in_its_template() -> None:
    lower = replace(TRUNK[0], moves={("T", 0): ((0, 0), (2, 40))})
    over = Over((Node("Hips", moves={("T", 0): ((0, 10.0), (2, 10.0))}),))
    half = {"Weight": (50.0,), "BlendMode": (0,)}
    text = text_7((lower, *TRUNK[1:]), over=[over], span=(0.5, 1.5), templates={
        "AnimationLayer FbxAnimLayer": half,
        "AnimationStack FbxAnimStack": {"LocalStart": (0.5 * TICKS,), "LocalStop": (1.5 * TICKS,)},
    })  # fmt: skip
    clip = fbx.parse(without(text, ["LocalStart", "LocalStop"]), "layer.fbx")
    assert len(clip) == 31
    np.testing.assert_allclose(100.0 * clip.root_positions[[0, -1], 0], [10.0 + 5.0, 30.0 + 5.0], atol=1e-9)


def test_a_deformer_takes_only_the_template_of_its_own_class() -> None:
    templates = {
        "Deformer FbxSkin": {"DeformPercent": (11.0,)},
        "Deformer FbxBlendShapeChannel": {"FullWeights": (7.0,)},
    }
    text = text_7(TRUNK, templates=templates).decode()
    channel = '\tDeformer: 9100, "SubDeformer::jawOpen", "BlendShapeChannel" {\n\t}\n'
    objects = FbxObjects(text.replace("Objects:  {\n", "Objects:  {\n" + channel).encode(), "a.fbx", DEFAULT_LIMITS)
    assert objects.numbers_of(objects.records[9100]) == {"FullWeights": [7.0]}


def old_settings(*rows: str) -> bytes:
    """A file of version 6 with more settings among its objects."""
    unit = '\t\t\tProperty: "UnitScaleFactor", "double", "",1'
    text = text_6(TRUNK).decode()
    assert unit in text
    return text.replace(unit, "\n".join(f"\t\t\tProperty: {row}" for row in rows)).encode()


@pytest.mark.parametrize(("mode", "fps"), [(1, 120), (6, 30), (10, 25), (11, 24), (9, 30 / 1.001), (14, 27.5), (0, 30)])
def test_version_6_keeps_the_frame_rate_among_its_objects(mode: int, fps: float) -> None:
    content = old_settings(f'"TimeMode", "enum", "",{mode}', '"CustomFrameRate", "double", "",27.5')
    assert fbx.parse(content, "old.fbx").fps == pytest.approx(fps)


@pytest.mark.parametrize(("rate", "fps"), [('"24"', 24.0), ("25.5", 25.5), ('"as ever"', 30.0), ('""', 30.0)])
def test_version_6_keeps_the_frame_rate_in_settings_of_version_5_besides(rate: str, fps: float) -> None:
    old = f"Version5:  {{\n\tSettings:  {{\n\t\tFrameRate: {rate}\n\t}}\n}}\n".encode()
    assert fbx.parse(old_settings() + old, "old.fbx").fps == fps
    assert fbx.parse(old_settings('"TimeMode", "enum", "",3') + old, "old.fbx").fps == 60.0


def test_version_6_keeps_axes_and_unit_among_its_objects_where_later_ones_count() -> None:
    axes = {"UpAxis": 2, "FrontAxis": 1, "FrontAxisSign": -1}
    content = old_settings(*(f'"{name}", "int", "",{value}' for name, value in axes.items()))
    inches = (
        b'\tGlobalSettings: {\n\t\tProperties60:  {\n\t\t\tProperty: "UnitScaleFactor", "double", "",2.54\n\t\t}\n\t}\n'
    )
    content = content.replace(b"}\nConnections:", inches + b"}\nConnections:")
    scene = FbxScene(content, "old.fbx", DEFAULT_LIMITS)
    assert scene.metres == pytest.approx(0.0254)
    np.testing.assert_allclose(
        locate(fbx.parse(content, "old.fbx")), expect(TRUNK)[..., [0, 2, 1]] * [2.54, 2.54, -2.54], atol=1e-9
    )


def test_keys_with_the_tangents_of_maya_and_3ds_max_hold_still_and_come_to_rest() -> None:
    clip = load(CASES / "fbx_auto_tangents" / "auto_clamped.fbx")
    hand = kinematics.forward(clip)[1][:, clip.skeleton.index["LeftHand"]]
    speed = np.linalg.norm(np.diff(hand, axis=0), axis=1) * clip.fps  # m/s
    between = slice(round(0.4 * clip.fps), round(0.9 * clip.fps) + 1)
    assert np.ptp(hand[between], axis=0).max() < 1e-9
    assert speed.max() > 1.0
    assert max(speed[0], speed[-1]) < 0.35 * speed.max()


def test_a_person_of_version_6_stands_upright_in_metres() -> None:
    clip = load(CASES / "fbx6_settings_in_objects" / "person.fbx")
    at = kinematics.forward(clip)[1][0]
    np.testing.assert_allclose(at[clip.skeleton.index["Hips"]], [0.0, 0.95, 0.0], atol=1e-6)
    assert at[clip.skeleton.index["Head"], 1] == pytest.approx(1.57, abs=0.1)


def test_an_avatar_with_bones_that_hang_apart_signs() -> None:
    """Four targets of inverse kinematics that have no parent, beside the skeleton."""
    file = CASES / "fbx_avatar_ik_bones" / "ikrig.fbx"
    avatar, clip = ss.read_avatar(file), load(file)
    done = ss.retarget(clip, avatar).clip
    names = [name for name in clip.skeleton.names if name in done.skeleton.index]
    assert {"LeftHand", "RightHand", "LeftFoot", "Head"} <= {*names}
    here, there = (
        kinematics.forward(motion)[1][:, [motion.skeleton.index[name] for name in names]] for motion in (clip, done)
    )
    assert np.ptp(here, axis=0).max() > 0.05
    np.testing.assert_allclose(there - there[:, :1], here - here[:, :1], atol=1e-3)
