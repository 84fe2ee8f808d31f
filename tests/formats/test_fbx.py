"""FBX: files of Blender's exporter, and files written by hand for what exporters do not show.

Blender 5.0.1 (bpy) imported ``exported.bvh`` in cm at scale 0.01 and exported two files: one with its defaults, one
with Z up, bones along X and the file's unit in the scene's settings. ``blender_person`` is ``person.bvh`` with Z up, a
box around each bone in turn of a textured and of a plain material, and a box with shape keys on the head's bone.
"""

from __future__ import annotations

import gzip
import struct
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import signsplice as ss
from fbx_files import Node, positions, text_6, text_7
from signsplice.formats import fbx, load
from signsplice.formats.fbx_curves import KeyCurve, Tangents
from signsplice.motion import Clip, FloatArray, kinematics
from signsplice.rig.rest_pose import rests_as_person, with_rest_pose

FOLDER = Path(__file__).parent / "fbx"
RNG = np.random.default_rng(38)


def vector(size: float = 30.0) -> tuple[float, ...]:
    return tuple(RNG.uniform(-size, size, 3).round(3).tolist())


def swing(axis: int) -> dict[tuple[str, int], Sequence[tuple[float, float]]]:
    return {("R", axis): ((0.0, 0.0), (0.5, 40.0), (1.0, -20.0))}


TRUNK = (
    Node("Hips", at=(0, 90, 0), moves={("T", 0): ((0, 0), (1, 20)), **swing(1)}),
    Node("Spine", "Hips", (0, 20, 3), turned=vector(), moves=swing(0)),
    Node("Neck", "Spine", (1, 30, 0), moves=swing(2)),
    Node("Head", "Neck", (0, 12, 2)),
)
ALL_AXES = {**swing(0), ("R", 1): ((0, 10), (1, 70)), ("R", 2): ((0, -20), (1, 35))}


def many(**changes: object) -> tuple[Node, ...]:
    return tuple(replace(node, **changes) for node in TRUNK)  # type: ignore[arg-type]


UNIT_ABOVE = (
    Node("Armature", kind="Null", turned=(-90, 0, 0), scale=(100, 100, 100)),
    *(
        replace(
            node,
            parent=node.parent or "Armature",
            at=tuple(value / 100 for value in node.at),
            moves={k: [(t, v / 100 if k[0] == "T" else v) for t, v in keys] for k, keys in node.moves.items()},
        )
        for node in TRUNK
    ),
)
TRAPS = {
    "plain": TRUNK,
    "pre- and post-rotation": many(more={"PreRotation": vector(), "PostRotation": vector()}),
    "pivots and offsets": many(
        scale=(1.2, 0.8, 1.1),
        more={
            name: vector(5)
            for name in ("PreRotation", "RotationPivot", "RotationOffset", "ScalingPivot", "ScalingOffset")
        },
    ),
    "a unit above the joints": UNIT_ABOVE,
    "a scale that moves": tuple(replace(n, moves={**n.moves, ("S", 0): ((0, 1), (1, 1.4))}) for n in TRUNK),
    **{
        f"rotation order {order}": many(order=order, turned=vector(), more={"PreRotation": vector()}, moves=ALL_AXES)
        for order in range(6)
    },
    **{
        f"uneven scale inherited as {inherit}": tuple(
            replace(node, inherit=inherit, scale=(1.5, 0.7, 1.1) if k < 2 else (1, 1, 1))
            for k, node in enumerate(TRUNK)
        )
        for inherit in range(3)
    },
}


def where(clip: Clip) -> FloatArray:
    return kinematics.forward(clip)[1]


def expected(clip: Clip, nodes: Sequence[Node]) -> FloatArray:
    """Positions (T, J, 3) of a clip's joints in the file's axes and unit."""
    times = np.arange(len(clip)) / clip.fps
    found = positions(nodes, times)
    return np.stack([found[name] for name in clip.skeleton.names], axis=1)


@pytest.mark.parametrize("name", ["blender_defaults", "blender_z_up"])
def test_blenders_files_show_the_clip_that_was_exported_in_metres(name: str) -> None:
    clip = fbx.parse(gzip.decompress((FOLDER / f"{name}.fbx.gz").read_bytes()), f"{name}.fbx")
    source = load(FOLDER / "exported.bvh")
    rows = [clip.skeleton.index[joint] for joint in source.skeleton.names]
    assert clip.fps == source.fps
    np.testing.assert_allclose(where(clip)[:, rows], where(source) / 100.0, atol=1e-6)
    assert clip.translations is None


@pytest.mark.parametrize("trap", TRAPS)
@pytest.mark.parametrize("write", [text_7, text_6])
def test_joints_are_where_products_of_matrices_put_them(trap: str, write: object) -> None:
    nodes = TRAPS[trap]
    clip = fbx.parse(write(nodes), "trap.fbx")  # type: ignore[operator]
    np.testing.assert_allclose(where(clip), expected(clip, nodes) / 100.0, atol=1e-12)
    assert len(clip) == 31


def test_axes_and_unit_of_the_file_become_metres_with_y_up() -> None:
    z_up = fbx.parse(text_7(TRUNK, {"UpAxis": 2, "FrontAxis": 1, "FrontAxisSign": -1}), "a.fbx")
    np.testing.assert_allclose(where(z_up), expected(z_up, TRUNK)[..., [0, 2, 1]] * [0.01, 0.01, -0.01], atol=1e-12)
    mirrored = fbx.parse(text_7(TRUNK, {"CoordAxisSign": -1}), "a.fbx")
    np.testing.assert_allclose(where(mirrored), expected(mirrored, TRUNK) * [-0.01, 0.01, 0.01], atol=1e-12)
    inches = fbx.parse(text_7(TRUNK, {"UnitScaleFactor": 2.54}), "a.fbx")
    np.testing.assert_allclose(where(inches), expected(inches, TRUNK) * 0.0254, atol=1e-12)


def test_a_rotation_that_is_not_active_leaves_out_pre_rotation_and_order_as_the_sdk_does() -> None:
    nodes = many(more={"PreRotation": vector()}, order=3, moves=ALL_AXES)
    text = text_7(nodes).replace(b'"RotationActive", "bool", "", "A",1', b'"RotationActive", "bool", "", "A",0')
    clip = fbx.parse(text, "a.fbx")
    np.testing.assert_allclose(where(clip), expected(clip, many(moves=ALL_AXES)) / 100.0, atol=1e-12)


@pytest.mark.parametrize(("flags", "at_quarter"), [(2, 0.0), (2 | 0x100, 40.0), (4, 10.0)])
def test_keys_are_held_or_joined_by_straight_lines(flags: int, at_quarter: float) -> None:
    clip = fbx.parse(text_7(TRUNK, {"TimeMode": 14, "CustomFrameRate": 32}, flags=flags), "a.fbx")
    hips = clip.local_rotations[:, 0]
    angles = np.rad2deg(2.0 * np.arctan2(hips[:, 1], hips[:, 3]))
    assert clip.fps == 32.0
    assert angles[4] == pytest.approx(at_quarter, abs=1e-9)
    assert angles[16] == pytest.approx(40.0, abs=1e-9)


def curve(flags: int, slopes: Sequence[float], weights: Sequence[float]) -> KeyCurve:
    tangents = Tangents(np.array([8 | flags] * 2), np.array([(*slopes, 0.0)] * 2), np.array([weights] * 2))
    return KeyCurve(np.array([0.0, 2.0]), np.array([1.0, 5.0]), lambda: tangents)


def test_cubic_keys_pass_through_their_values_with_their_slopes() -> None:
    times = np.array([0.0, 1e-6, 2.0 - 1e-6, 2.0])
    values = curve(0x400, (3.0, -2.0), (1 / 3, 1 / 3)).at(times)
    assert values[[0, 3]] == pytest.approx([1.0, 5.0])
    assert np.diff(values)[[0, 2]] / 1e-6 == pytest.approx([3.0, -2.0], abs=1e-4)


def test_a_weighted_tangent_is_the_bezier_curve_with_these_inner_points() -> None:
    s = np.linspace(0.0, 1.0, 9)[:, None]
    points = np.array([(0.0, 1.0), (1.0, 1.0 + 3.0), (1.6, 5.0 + 2.0 * 0.4), (2.0, 5.0)])
    basis = np.hstack([(1 - s) ** 3, 3 * (1 - s) ** 2 * s, 3 * (1 - s) * s**2, s**3])
    at, value = (basis @ points).T
    np.testing.assert_allclose(curve(0x400, (3.0, -2.0), (0.5, 0.2)).at(at), value, atol=1e-9)


def test_weights_of_tangents_are_9999ths_of_the_time_between_keys() -> None:
    moving = (replace(TRUNK[0], moves={("T", 0): ((0, 0), (1, 20))}), *TRUNK[1:])
    flat = f"0,0,{9999 | 3333 << 16},0"  # to the next key, and a third of the way back
    clip = fbx.parse(text_7(moving, flags=0x3000408, attributes=flat), "a.fbx")
    s = np.linspace(0.0, 1.0, 20_001)
    times, values = 3 * (1 - s) ** 2 * s + 2 * (1 - s) * s**2 + s**3, 20.0 * (3 * s**2 - 2 * s**3)
    at = np.arange(len(clip)) / clip.fps
    np.testing.assert_allclose(100.0 * clip.root_positions[:, 0], np.interp(at, times, values), atol=1e-6)


def test_a_take_is_chosen_by_name_and_the_others_are_noted(tmp_path: Path) -> None:
    file = tmp_path / "two.fbx"
    file.write_bytes(text_7(TRUNK, takes={"Empty": (), "First": TRUNK, "Second": many(moves=ALL_AXES)}))
    first, second = load(file), load(file, take="Second")
    assert first.notes == ("the take 'First' is read, not 'Second'",)
    np.testing.assert_allclose(where(first), expected(first, TRUNK) / 100.0, atol=1e-12)
    assert not np.allclose(where(second), where(first))
    with pytest.raises(ss.InputError, match=r"two.fbx: no take 'Third', expected one of 'Empty', 'First', 'Second'"):
        load(file, take="Third")
    with pytest.raises(ss.InputError, match=r"its take 'Empty' moves no joint"):
        load(file, take="Empty")


def test_a_file_of_another_format_has_no_takes() -> None:
    with pytest.raises(ss.InputError, match=r"take 'First', expected none: .bvh files have one motion"):
        load(FOLDER / "exported.bvh", take="First")


def test_of_several_skeletons_the_one_of_a_body_is_read_whatever_controls_move() -> None:
    control = Node("root_control", kind="Null", moves=swing(0))
    prop = tuple(Node(f"Sword{k}", f"Sword{k - 1}" if k else "", (0, 5, 0), moves=swing(0)) for k in range(6))
    body = tuple(
        replace(node, name=f"mixamorig:{node.name}", parent=node.parent and f"mixamorig:{node.parent}")
        for node in TRUNK
    )
    clip = fbx.parse(text_7((control, *prop, *body)), "a.fbx")
    assert clip.skeleton.names == tuple(node.name for node in body)
    assert clip.notes == ("the skeleton below 'mixamorig:Hips' is read, not 'Sword0'",)


def test_models_that_move_are_joints_where_a_file_has_no_bones() -> None:
    clip = fbx.parse(text_7(many(kind="Null")), "a.fbx")
    np.testing.assert_allclose(where(clip), expected(clip, TRUNK) / 100.0, atol=1e-12)


@pytest.mark.parametrize("mode", [3, 11, 0])
def test_the_frame_rate_is_the_files_unless_keys_lie_closer(mode: int) -> None:
    dense = [(k / 60.0, float(k)) for k in range(61)]
    moving = tuple(replace(node, moves={("R", 0): dense}) for node in TRUNK)
    assert fbx.parse(text_7(moving, {"TimeMode": mode}), "a.fbx").fps == 60.0
    assert fbx.parse(text_7(TRUNK, {"TimeMode": mode}), "a.fbx").fps == {3: 60.0, 11: 24.0, 0: 30.0}[mode]


def test_the_rest_pose_is_the_pose_with_all_angles_0_or_a_frame_where_that_is_no_person() -> None:
    clip = fbx.parse(text_7(_body()), "a.fbx")
    assert rests_as_person(clip.skeleton)
    assert clip.skeleton.offsets[clip.skeleton.index["LeftForeArm"]] == pytest.approx([0.3, 0.0, 0.0])
    lying = tuple(  # as Blender's bones: where they are follows from the file's own angles
        replace(node, turned=(180, 0, 0))
        if node.name == "Spine"
        else replace(node, at=np.multiply(node.at, (1, -1, 1)).tolist())
        if node.parent in ("Spine", "Spine1", "Neck")
        else node
        for node in _body()
    )
    clip = fbx.parse(text_7(lying), "a.fbx")
    assert not rests_as_person(clip.skeleton)
    assert with_rest_pose(clip).skeleton.rest_pose is not None


def _body() -> tuple[Node, ...]:
    """A person in the T-pose, whose arms hang in the file's own pose."""
    places = {
        "Hips": ("", (0, 90, 0)),
        "Spine": ("Hips", (0, 10, 0)),
        "Spine1": ("Spine", (0, 20, 0)),
        "Neck": ("Spine1", (0, 20, 0)),
        "Head": ("Neck", (0, 10, 0)),
        **{
            f"{side}{part}": (over if over in ("Spine1", "Hips") else f"{side}{over}", (sign * x, y, 0))
            for side, sign in (("Left", 1), ("Right", -1))
            for part, over, x, y in (
                ("Shoulder", "Spine1", 5, 15),
                ("Arm", "Shoulder", 12, 0),
                ("ForeArm", "Arm", 30, 0),
                ("Hand", "ForeArm", 25, 0),
                ("UpLeg", "Hips", 9, -5),
                ("Leg", "UpLeg", 0, -40),
                ("Foot", "Leg", 0, -40),
            )
        },
    }
    return tuple(
        Node(
            name,
            over,
            at,
            turned=(0, 0, {"LeftArm": -80, "RightArm": 80}.get(name, 0)),
            moves=swing(0) if name == "Head" else {},
        )
        for name, (over, at) in places.items()
    )


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is no FBX file"),
        (b"Kaydara FBX Binary  \x00\x1a\x00", "is no valid .fbx file"),
        (text_7(()), "holds neither bones nor models that move"),
        (text_7(TRUNK, takes={"Empty": ()}), "holds no take that moves a joint"),
        (text_7(TRUNK).replace(b"a: 0,23093079000", b"a: 46186158000,23093079000"), "a curve's keys go back in time"),
        (text_7(TRUNK).replace(b"KeyValueFloat: *3", b"KeyValueFlaut: *3"), "has 3 times and 0 values"),
        (
            text_7(TRUNK, flags=8).replace(b"KeyAttrRefCount: *1 {\n\t\t\ta: 3", b"KeyAttrRefCount: *1 {\n\t\t\ta: 9"),
            "attributes for 9 keys",
        ),
        (text_7(many(order=9)), "rotation order 9"),
        (text_7(TRUNK, span=(0.0, 1e9)), "seconds"),
    ],
)
def test_a_wrong_file_is_one_line_that_names_it(content: bytes, message: str, tmp_path: Path) -> None:
    file = tmp_path / "wrong.fbx"
    file.write_bytes(content)
    with pytest.raises(ss.InputError, match=message) as caught:
        load(file)
    assert str(caught.value).startswith(f"{file}: ")
    assert "\n" not in str(caught.value)


def test_a_binary_array_that_unpacks_to_far_more_than_its_file_is_refused() -> None:
    content = gzip.decompress((FOLDER / "blender_defaults.fbx.gz").read_bytes())
    at = content.index(b"KeyTime") + len(b"KeyTime")
    assert content[at : at + 1] == b"l"
    with pytest.raises(ss.InputError):
        fbx.parse(content[: at + 1] + struct.pack("<I", 1 << 29) + content[at + 5 :], "bomb.fbx")


def test_models_that_hang_below_themselves_are_no_joints() -> None:
    looped = text_7(TRUNK).replace(b'C: "OO",1000,0\n', b'C: "OO",1000,1001\n')
    with pytest.raises(ss.InputError, match="holds neither bones"):
        fbx.parse(looped, "loop.fbx")


def test_the_pose_in_which_a_skin_is_bound_is_the_rest_pose() -> None:
    spine = Rotation.from_euler("xyz", [0.0, *TRUNK[1].turned[1:]], degrees=True).as_matrix()  # in frame 0
    objects, links = [], []
    for number, turned in enumerate((np.eye(3), spine, spine, spine)):
        matrix = np.eye(4)
        matrix[:3, :3] = turned.T  # rows are the axes
        cells = ",".join(map(str, matrix.ravel()))
        objects.append(f'\tDeformer: {9000 + number}, "SubDeformer::", "Cluster" {{')
        objects.append(f"\t\tTransformLink: *16 {{\n\t\t\ta: {cells}\n\t\t}}\n\t}}")
        links.append(f'\tC: "OO",{1000 + number},{9000 + number}')
    text = text_7(TRUNK).decode().replace("Objects:  {\n", "Objects:  {\n" + "\n".join(objects) + "\n", 1)
    text = text.replace("Connections:  {\n", "Connections:  {\n" + "\n".join(links) + "\n", 1)
    clip = fbx.parse(text.encode(), "bound.fbx")
    np.testing.assert_allclose(np.abs(clip.local_rotations[0, :, 3]), 1.0, atol=1e-12)
    np.testing.assert_allclose(where(clip), expected(clip, TRUNK) / 100.0, atol=1e-12)
