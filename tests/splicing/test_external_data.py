"""Networks whose weights lie in other files are refused, wherever in the graph those weights are."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper

from signsplice.errors import InputError
from signsplice.splicing.bundle import WEIGHTS, names_other_files
from signsplice.splicing.learned import open_sessions


def external(name: str = "w") -> TensorProto:
    """Four floats that lie in the file "other.bin"."""
    tensor = TensorProto(name=name, data_type=TensorProto.FLOAT, dims=[4], data_location=TensorProto.EXTERNAL)
    tensor.external_data.add(key="location", value="other.bin")
    return tensor


def inside(tensor: TensorProto) -> onnx.GraphProto:
    """A graph that holds the tensor among its weights."""
    return helper.make_graph([], "inner", [], [], [tensor])


def in_an_attribute() -> onnx.GraphProto:
    return helper.make_graph([helper.make_node("Constant", [], ["c"], value=external())], "g", [], [])


def in_a_branch() -> onnx.GraphProto:
    branches = {"then_branch": inside(external()), "else_branch": inside(external("v"))}
    return helper.make_graph([helper.make_node("If", ["condition"], ["y"], **branches)], "g", [], [])


def in_a_sparse_tensor() -> onnx.GraphProto:
    graph = onnx.GraphProto(name="g")
    graph.sparse_initializer.add(values=external())
    return graph


@pytest.mark.parametrize("make", [lambda: inside(external()), in_an_attribute, in_a_branch, in_a_sparse_tensor])
def test_weights_in_other_files_are_found_anywhere(make: Callable[[], onnx.GraphProto]) -> None:
    assert names_other_files(helper.make_model(make()).SerializeToString())


def test_weights_in_a_function_are_found() -> None:
    function = helper.make_function(
        "own", "f", [], ["c"], [helper.make_node("Constant", [], ["c"], value=external())], []
    )
    model = helper.make_model(onnx.GraphProto(name="g"), functions=[function])
    assert names_other_files(model.SerializeToString())


@pytest.mark.parametrize("path", sorted(WEIGHTS.glob("*.onnx")), ids=lambda path: path.stem)
def test_the_shipped_networks_are_whole(path: Path) -> None:
    assert not names_other_files(path.read_bytes())


def test_a_bundle_with_weights_in_another_file_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Before, they were read from the current folder: one hash, two animations."""
    bundle = tmp_path / "bundle"
    shutil.copytree(WEIGHTS, bundle)
    model = onnx.load(bundle / "cut.onnx")
    weight = max(model.graph.initializer, key=lambda one: len(one.raw_data))
    content, weight.raw_data = weight.raw_data, b""
    weight.data_location = TensorProto.EXTERNAL
    weight.external_data.add(key="location", value="other.bin")
    (bundle / "cut.onnx").write_bytes(model.SerializeToString())
    config = json.loads((bundle / "bundle.json").read_text())
    config["files"]["cut.onnx"] = hashlib.sha256((bundle / "cut.onnx").read_bytes()).hexdigest()
    (bundle / "bundle.json").write_text(json.dumps(config))
    (tmp_path / "other.bin").write_bytes(content)
    monkeypatch.chdir(tmp_path)
    inputs = {name: np.zeros((1, 2, 2), np.float32) for name in ("before", "leave", "after", "enter")}
    with pytest.raises(InputError, match=r"^[^ ]*cut\.onnx: keeps weights in other files"):
        open_sessions(bundle).run("cut", inputs)
