"""What glTF 2.0 says of the properties and numbers that move joints holds, or a file is refused in one line."""

from __future__ import annotations

import base64
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gltf_documents import ARM, IDENTITY, QUARTER, changed, document, load_document, rotating
from signsplice.errors import FormatError


def at_node(**fields: Any) -> Any:
    return lambda d: d["nodes"][1].update(fields)


def at_accessor(number: int, **fields: Any) -> Any:
    return lambda d: d["accessors"][number].update(fields)


def at_view(**fields: Any) -> Any:
    return lambda d: d["bufferViews"][1].update(fields)


def at_sampler(**fields: Any) -> Any:
    return lambda d: d["animations"][0]["samplers"][0].update(fields)


def at_channel(**fields: Any) -> Any:
    return lambda d: d["animations"][0]["channels"][0].update(fields)


def at_target(**fields: Any) -> Any:
    return lambda d: d["animations"][0]["channels"][0]["target"].update(fields)


def bound_by(*rows: Any) -> Any:
    """A change that adds a skin whose inverse bind matrices have these last rows."""

    def change(d: dict[str, Any]) -> None:
        matrices = np.tile(np.eye(4, dtype="f4"), (len(rows), 1, 1))
        matrices[:, 3] = rows
        stored = base64.b64encode(matrices.transpose(0, 2, 1).tobytes()).decode()
        d["buffers"].append({"byteLength": 64 * len(rows), "uri": "data:x;base64," + stored})
        d["bufferViews"].append({"buffer": 1, "byteLength": 64 * len(rows)})
        d["accessors"].append({"bufferView": 2, "componentType": 5126, "count": len(rows), "type": "MAT4"})
        d["skins"] = [{"joints": [*range(len(rows))], "inverseBindMatrices": 2}]

    return change


def any_of(*values: Any) -> tuple[Any, ...]:
    return values


KEYS = {"times": [0, 1], "path": "rotation", "node": 0}
TANGENT = [9.0, 9.0, 9.0, 9.0]
NO_NUMBER: tuple[Any, ...] = ("", False, 0, [], {})
"""Values that Python takes for false, none of which stands for a property that is absent."""
STRICT: list[tuple[Any, str]] = [
    *[(at_node(**{name: value}), rf"node 'arm': {name} is .*, expected {n} finite numbers")
      for name, n in (("translation", 3), ("rotation", 4), ("scale", 3), ("matrix", 16)) for value in NO_NUMBER],
    *[(at_node(translation=value), "node 'arm': translation is .*, expected 3 finite numbers")
      for value in any_of([True, 2, 3], [[0, 1, 2]], ["1.0", 0, 0], [1, 2], [1, 2, 3, 4], [0, None, 0])],
    *[(at_node(rotation=[0, 0, 0, w]), f"node 'arm': a rotation has length {w:g}, expected 1")
      for w in (0, 0.94, 1.06)],
    (at_node(children=False), "node 1: children is False, expected a list"),
    (lambda d: d["nodes"][0].update(children=[True]), "node True is a child of node 0"),
    *[(at_sampler(interpolation=value), "rotation of node 0: interpolation is .*, expected a text")
      for value in any_of(False, 0, 0.0, [])],
    *[(at_accessor(1, byteOffset=value), "accessor 1: byteOffset is .*, expected a whole number from 0")
      for value in any_of("", {}, False, -4, 0.5)],
    *[(at_view(byteOffset=value), "bufferView 1: byteOffset is") for value in any_of("", {}, False, -4)],
    *[(at_view(byteStride=value), "bufferView 1: byteStride is .*, expected")
      for value in any_of(0, 2, 256, "", False)],
    (at_view(byteLength=True), "bufferView 1: byteLength is True, expected a whole number from 0"),
    *[(at_view(buffer=value), f"buffer {value} is no such") for value in any_of(False, 0.0)],
    *[(at_accessor(1, bufferView=value), f"bufferView {value} is no such") for value in any_of(True, 1.0)],
    (at_accessor(1, count=True), "accessor 1: count is True"),
    *[(at_accessor(1, sparse=value), "the sparse part of accessor 1 is .*, expected an object")
      for value in any_of("", 0, [])],
    (at_accessor(1, sparse={}), "the sparse part of accessor 1 has no indices, expected an object"),
    (at_accessor(1, sparse={"count": 1, "indices": {"bufferView": 0}}), "has no componentType, expected one of 5120"),
    *[(at_accessor(1, componentType=value), "accessor 1: componentType is .*, expected one of 5120, 5121")
      for value in any_of(5130, True, [5126], "5126")],
    (at_accessor(1, type="VEC5"), "accessor 1: type is 'VEC5', expected one of SCALAR, VEC2"),
    (at_accessor(1, bufferView=0, type=None), "accessor 1 has no type, expected one of SCALAR"),
    (at_view(buffer=None), "buffer None is no such"),
    *[(lambda d, v=value: d.update(animations=v), message) for value, message in (
        ({}, "the document: animations is .*, expected a list"), ([7], "animation 0 is 7, expected an object"),
        ([{}], "animation 0 has no channels, expected a list"),
        ([{"channels": [3]}], "channel 0 is 3, expected an object"),
        ([{"channels": [{"sampler": 0}]}], "channel 0 has no target, expected an object"),
        ([{"channels": [{"target": {"node": 0}}]}], r"channel 0: target\.path is None, expected one of translation"),
        ([{"channels": [{"target": {"node": 0, "path": "rotation"}}]}], "sampler None is no such, of 0"),
        ([{"channels": [{"sampler": 0, "target": {"node": 0, "path": "rotation"}}], "samplers": [4]}],
         "sampler 0 is 4, expected an object"),
        ([{"channels": [{"sampler": 0, "target": {"node": 0, "path": "rotation"}}], "samplers": [{}]}],
         "accessor None is no such, of 2"))],
    (lambda d: d.update(nodes=[3]), "node 0 is 3, expected an object"),
    (lambda d: d.update(asset=[]), r"the document: asset is \[\], expected an object"),
    (lambda d: d.update(buffers=[5]), "buffer 0 is 5, expected an object"),
    (lambda d: d["buffers"][0].update(uri=5), "buffer 0: uri is 5, expected a text"),
    (lambda d: d.update(skins=[{}]), "skin 0 has no joints, expected a list"),
    (lambda d: d.update(skins=["x"]), "skin 0 is 'x', expected an object"),
    *[(lambda d, v=value: d.update(extensions={"VRMC_vrm": {"humanoid": {"humanBones": v}}}), message)
      for value, message in (({"hips": 1}, "the humanoid: hips is 1, expected an object"),
                             ({"hips": {}}, "joint None is no node"))],
    (lambda d: d.update(extensions={"VRM": {"humanoid": {"humanBones": [{"node": 0}]}}}),
     "a bone of the humanoid has no bone, expected a text"),
    *[(at_accessor(1, normalized=value), "accessor 1: normalized is .*, expected true or false")
      for value in any_of("", "a", 1)],
    (at_accessor(1, normalized=True), "accessor 1 is normalized, but not of numbers of 8 or 16 bits"),
    (at_sampler(output=True), "accessor True is no such"),
    (at_channel(sampler=False), "sampler False is no such"),
    *[(at_target(node=value), f"joint {value} is no node") for value in any_of(True, 0.0)],
    *[(at_target(path=value), r"channel 0: target\.path is .*, expected one of translation, rotation")
      for value in any_of("rotatio", "rotationx", 1, None, ["rotation"])],
    (lambda d: d["animations"][0]["channels"].append(d["animations"][0]["channels"][0]),
     "channel 1: rotation of node 0 is animated twice"),
    (lambda d: d.update(skins=False), "the document: skins is False, expected a list"),
    (lambda d: d.update(skins=[{"joints": ""}]), "skin 0: joints is '', expected a list"),
    (lambda d: d.update(skins=[{"joints": [0, True]}]), "joint True is no node"),
    (bound_by([0, 0, 0, 1], [0.1, 0, 0, 1]), "an inverse bind matrix has the last row"),
    (bound_by([0, 0, 0, 2]), r"an inverse bind matrix has the last row \[0.0, 0.0, 0.0, 2.0\], expected 0, 0, 0, 1"),
    (lambda d: d.update(extensions={"VRMC_vrm": False}), "extensions: VRMC_vrm is False, expected an object"),
    (lambda d: d.update(extras={"any": float("nan")}), "is no JSON that can be read .NaN is no number of JSON"),
]  # fmt: skip


@pytest.mark.parametrize(("change", "expected"), STRICT, ids=range(len(STRICT)))
def test_only_an_absent_property_has_its_default(tmp_path: Path, change: Any, expected: str) -> None:
    with pytest.raises(FormatError, match=expected) as caught:
        load_document(tmp_path, changed(change))
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize(
    "change",
    [
        at_node(translation=[0, 1, 0], rotation=None, scale=None, matrix=None, children=None),
        at_accessor(1, byteOffset=None, normalized=False, sparse=None),
        at_view(byteStride=16),
        at_sampler(interpolation=None),
        bound_by([0, 0, 0, 1], [1e-8, 0, 0, 1.0000001]),
    ],
)
def test_null_and_what_the_standard_allows_are_read_alike(tmp_path: Path, change: Any) -> None:
    read, plain = load_document(tmp_path, changed(change)), load_document(tmp_path, changed(dict))
    assert np.allclose(read.local_rotations, plain.local_rotations, atol=1e-6)
    assert np.array_equal(read.skeleton.offsets, plain.skeleton.offsets)


@pytest.mark.parametrize("length", [0.0, 0.94, 1.06, 8e37])
@pytest.mark.parametrize("interpolation", ["LINEAR", "STEP", "CUBICSPLINE"])
def test_keys_that_are_no_rotation_are_refused(tmp_path: Path, length: float, interpolation: str) -> None:
    values = np.array([IDENTITY, QUARTER])
    values[1] *= length
    if interpolation == "CUBICSPLINE":
        values = np.stack([[TANGENT] * 2, values, [TANGENT] * 2], axis=1).reshape(-1, 4)
    with pytest.raises(FormatError, match=r"keys of node 'root': a rotation has length .*, expected 1; export"):
        load_document(tmp_path, document(ARM, [KEYS | {"values": values, "interpolation": interpolation}]))


@pytest.mark.parametrize("stored", [("i1", 5120, 127), ("i2", 5122, 32767)])
def test_rotations_that_were_rounded_to_bytes_are_read(tmp_path: Path, stored: tuple[str, int, int]) -> None:
    dtype, component, most = stored
    quats = np.random.default_rng(3).normal(size=(400, 4))
    quats /= np.linalg.norm(quats, axis=1, keepdims=True)
    extra = {"dtype": dtype, "component": component, "normalized": True}
    keys = KEYS | {"times": np.arange(400) / 30.0, "values": np.rint(quats * most), "stored": extra}
    assert len(load_document(tmp_path, document(ARM, [keys]))) == 400


def test_a_channel_of_no_node_is_named(tmp_path: Path) -> None:
    content = document(ARM, [rotating(), rotating() | {"node": None}])
    assert load_document(tmp_path, content).left_out == ("rotation of no node",)
