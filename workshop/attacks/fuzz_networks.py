"""Makes the smallest networks that a bundle can have, with the inputs and outputs that the program knows."""

from __future__ import annotations

from typing import Any

import numpy as np
from onnx import TensorProto, helper, numpy_helper

from signsplice.splicing.features import N_CONTEXT, N_FRAME, N_SEEN, N_TERMS, N_TOKEN

_OPSET, _IR = 17, 8
_WIDTH, _N_PHASES, _N_ARM = 4, 5, 8
_N_WORD_TOKEN = N_FRAME + 2


def make_network(name: str) -> bytes:
    """Returns a network by its file's name."""
    rng = np.random.default_rng(0)
    inputs, outputs, nodes, sizes = _GRAPHS[name]
    weights = [
        numpy_helper.from_array(
            0.01 * rng.normal(size=size).astype(np.float32) if isinstance(size, tuple) else np.array(size, np.int64),
            key,
        )
        for key, size in sizes.items()
    ]
    kinds = {"mask": TensorProto.BOOL}
    graph = helper.make_graph(
        [
            helper.make_node(operator, input_names.split(), output_names.split(), **attributes)
            for operator, input_names, output_names, attributes in nodes
        ],
        "graph",
        [helper.make_tensor_value_info(key, kinds.get(key, TensorProto.FLOAT), shape) for key, shape in inputs.items()],
        [helper.make_tensor_value_info(key, TensorProto.FLOAT, shape) for key, shape in outputs.items()],
        weights,
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", _OPSET)], ir_version=_IR)
    return bytes(model.SerializeToString())


_GRAPHS: dict[
    str, tuple[dict[str, Any], dict[str, Any], list[tuple[str, str, str, dict[str, Any]]], dict[str, Any]]
] = {
    "word.onnx": (
        {"tokens": [1, "t", _N_WORD_TOKEN]},
        {"states": [1, "t", _WIDTH], "leave": [1, _WIDTH], "enter": [1, _WIDTH], "phases": [1, "t", _N_PHASES]},
        [
            ("MatMul", "tokens w", "states", {}),
            ("MatMul", "tokens v", "phases", {}),
            ("ReduceMean", "states", "leave", {"axes": [1], "keepdims": 0}),
            ("ReduceMax", "states", "enter", {"axes": [1], "keepdims": 0}),
        ],
        {"w": (_N_WORD_TOKEN, _WIDTH), "v": (_N_WORD_TOKEN, _N_PHASES)},
    ),
    "cut.onnx": (
        {"before": [1, "t", _WIDTH], "leave": [1, _WIDTH], "after": [1, "s", _WIDTH], "enter": [1, _WIDTH]},
        {"left": [1, "t"], "entered": [1, "s"]},
        [
            ("Mul", "before leave", "a", {}),
            ("ReduceMean", "a", "left", {"axes": [2], "keepdims": 0}),
            ("Mul", "after enter", "b", {}),
            ("ReduceMean", "b", "entered", {"axes": [2], "keepdims": 0}),
        ],
        {},
    ),
    "bridge.onnx": (
        {"tokens": ["b", N_SEEN, N_TOKEN]},
        {"turns": ["b", N_TERMS, _N_ARM, 3]},
        [
            ("Slice", "tokens first last axis", "a", {}),
            ("MatMul", "a w", "c", {}),
            ("MatMul", "c v", "d", {}),
            ("Reshape", "d shape", "turns", {}),
        ],
        {
            "w": (N_TOKEN, 2),
            "v": (2, 3 * _N_ARM),
            "first": [N_CONTEXT],
            "last": [N_CONTEXT + N_TERMS],
            "axis": [1],
            "shape": [0, 0, _N_ARM, 3],
        },
    ),
}
"""File -> its inputs and outputs with their shapes, its nodes (operator, inputs, outputs, attributes), and its
constants: shapes of random weights, or lists of whole numbers.
"""
