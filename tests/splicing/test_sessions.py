"""splicing.sessions: a network that is damaged, or another than the program expects, is refused with its file."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
from conftest import GOLDEN

from signsplice.errors import FormatError
from signsplice.lexicon import open_shipped_lexicon
from signsplice.splicing.engine import SpliceOptions, splice
from signsplice.splicing.learned import open_sessions

Change = Callable[[Any], None]


def broken_bundle(folder: Path, name: str, change: Change | bytes) -> Path:
    """The tiny bundle with a network changed, which its bundle.json lists as it is."""
    bundle = Path(shutil.copytree(GOLDEN / "tiny_bundle", folder / "bundle"))
    if isinstance(change, bytes):
        content = change
    else:
        model = onnx.load_model_from_string((bundle / name).read_bytes())
        change(model.graph)
        content = model.SerializeToString()
    (bundle / name).write_bytes(content)
    described = json.loads((bundle / "bundle.json").read_text())
    described["files"][name] = hashlib.sha256(content).hexdigest()
    (bundle / "bundle.json").write_text(json.dumps(described))
    return bundle


def renamed_output(graph: Any) -> None:
    old, graph.output[0].name = graph.output[0].name, "other"
    for node in graph.node:
        node.output[:] = ["other" if name == old else name for name in node.output]
        node.input[:] = ["other" if name == old else name for name in node.input]


def not_a_number(graph: Any) -> None:
    for weight in graph.initializer:
        if weight.data_type == onnx.TensorProto.FLOAT:
            weight.CopyFrom(onnx.numpy_helper.from_array(onnx.numpy_helper.to_array(weight) * np.nan, weight.name))


def another_input(graph: Any) -> None:
    graph.input.append(onnx.helper.make_tensor_value_info("more", onnx.TensorProto.FLOAT, [1]))


def without_a_node(graph: Any) -> None:
    del graph.node[3]


DAMAGE: dict[str, tuple[str, Change | bytes]] = {
    "no network": ("word.onnx", b"words"),
    "empty": ("cut.onnx", b""),
    "a node is lost": ("word.onnx", without_a_node),
    "another input": ("cut.onnx", another_input),
    "another output": ("cut.onnx", renamed_output),
    "no number": ("cut.onnx", not_a_number),
    "no number in a gap": ("bridge.onnx", not_a_number),
}


@pytest.mark.parametrize("what", DAMAGE)
def test_a_damaged_network_is_refused_with_its_file(what: str, tmp_path: Path) -> None:
    name, change = DAMAGE[what]
    bundle = broken_bundle(tmp_path, name, change)
    with open_shipped_lexicon() as words:
        clips = [words.clip("I"), words.clip("SIGN")]
    options = SpliceOptions("learned", "learned", bundle=bundle, avoid_collisions=False)
    with pytest.raises(FormatError, match=name.replace(".", r"\.")) as caught:
        splice(clips, options)
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize(
    ("shape", "message"), [((1, 7, 4), "shape"), ((1, 6, None, 1), "shape"), ((1, 6, 17), "shape"), ((1, 6, None), "")]
)
def test_an_output_of_another_shape_is_refused(shape: tuple[int | None, ...], message: str) -> None:
    sessions = open_sessions(GOLDEN / "tiny_bundle")
    tokens = {"tokens": np.zeros((1, 6, 590), np.float32)}
    if message:
        with pytest.raises(FormatError, match=rf"word\.onnx: .*states has {message}"):
            sessions.run("word", tokens, states=shape)
    else:
        assert sessions.run("word", tokens, states=shape)["states"].shape == (1, 6, 16)
