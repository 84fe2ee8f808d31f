"""Checks rules of glTF 2.0 that concern the motion of joints: a program cannot rely on a file that breaks one.

Khronos' validator reports each as an error, except unknown paths, which are a warning. Rules that move no joint (names,
bounds, scenes, alignment, unused rows) are left out.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

import evaluators
from evaluators import Fields, MustRefuseError

UNIT = 0.05
"""Greatest error of a rotation's length. Rotations in bytes err by less than 0.02."""
ROW = 1e-5
"""Greatest error of a matrix's last row, as inversion in 32 bits leaves it."""
_NODE_LENGTHS = {"translation": 3, "rotation": 4, "scale": 3, "matrix": 16}
_PATHS = ("translation", "rotation", "scale", "weights", "pointer")
_LEFT_OUT = "a channel of no known path or node"


def check(content: bytes, joints: Iterable[int], is_warned: bool = False, has_animation: bool = True) -> None:
    """Raises ``MustRefuseError`` if a file breaks a rule on nodes ``joints``, those above them, or their channels in
    the first animation, if one is read. is_warned: whether the reader named the channels that it left out.
    """
    file = evaluators.GltfFile(content)
    _expect(_is_strict(content), "NaN or infinity in the JSON")
    nodes = file.json["nodes"]
    parents = {child: node for node, fields in enumerate(nodes) for child in fields.get("children") or ()}
    checked_nodes = set(joints)
    for node in list(checked_nodes):
        while (node := parents.get(node, -1)) >= 0:
            checked_nodes.add(node)
    for node in checked_nodes:
        for name, length in _NODE_LENGTHS.items():
            if nodes[node].get(name) is not None:
                _expect(_are_numbers(nodes[node][name], length), f"{name} of a node")
        _expect(_is_unit([nodes[node].get("rotation") or [0.0, 0.0, 0.0, 1.0]]), "a node's rotation of no unit length")
    for skin in file.json.get("skins") or ():
        if skin.get("inverseBindMatrices") is not None and checked_nodes.intersection(skin["joints"]):
            _check_accessor(file.json, skin["inverseBindMatrices"])
            rows = file.accessor(skin["inverseBindMatrices"])[:, 3::4]
            _expect(bool((np.abs(rows - [0.0, 0.0, 0.0, 1.0]) <= ROW).all()), "an inverse bind matrix")
    targets: set[tuple[int, str]] = set()
    for target, sampler in _list_channels(file.json, is_warned) if has_animation else ():
        if target[0] not in checked_nodes:
            continue
        _expect(target not in targets, "two channels for one target")
        targets.add(target)
        kind = sampler.get("interpolation")
        _expect(kind is None or kind in ("LINEAR", "STEP", "CUBICSPLINE"), "an interpolation of no known name")
        for name in ("input", "output"):
            _check_accessor(file.json, sampler[name])
        if target[1] == "rotation":
            values = file.accessor(sampler["output"])
            _expect(_is_unit(values[1::3] if kind == "CUBICSPLINE" else values), "a key's rotation of no unit length")


def _list_channels(document: Fields, is_warned: bool) -> Iterator[tuple[tuple[int, str], Fields]]:
    """Yields ((node, path), sampler) of the first animation's channels that move nodes."""
    animation = document["animations"][0]
    for channel in animation["channels"]:
        node, path = channel["target"].get("node"), channel["target"].get("path")
        is_known = path in _PATHS and (_is_index(node) or (node is None and path == "pointer"))
        _expect(is_known or is_warned, _LEFT_OUT)
        if is_known and path in evaluators.PATHS:
            _expect(_is_index(channel["sampler"]), "a sampler's number")
            yield (node, path), animation["samplers"][channel["sampler"]]


def _check_accessor(document: Fields, number: Any) -> None:
    _expect(_is_index(number), "an accessor's number")
    accessor = document["accessors"][number]
    normalized = accessor.get("normalized")
    is_small = accessor["componentType"] in (5120, 5121, 5122, 5123)
    _expect(normalized is None or normalized is False or (normalized is True and is_small), "normalized")
    sparse = accessor.get("sparse")
    _expect(sparse is None or bool(sparse), "sparse")
    for location in (accessor, *((sparse["indices"], sparse["values"]) if sparse else ())):
        _expect(location.get("byteOffset") is None or _is_index(location["byteOffset"]), "byteOffset")
        if location.get("bufferView") is not None:
            _expect(_is_index(location["bufferView"]), "a view's number")
            view = document["bufferViews"][location["bufferView"]]
            stride = view.get("byteStride")
            _expect(stride is None or (_is_index(stride) and 4 <= stride <= 252), "byteStride")
            _expect(view.get("byteOffset") is None or _is_index(view["byteOffset"]), "byteOffset of a view")
            _expect(_is_index(view["buffer"]), "a buffer's number")


def _expect(holds: bool, rule: str) -> None:
    if not holds:
        raise MustRefuseError(rule)


def _is_index(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and value >= 0 and value == int(value)


def _are_numbers(values: Any, length: int) -> bool:
    return isinstance(values, list) and len(values) == length and all(
        isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value) for value in values
    )  # fmt: skip


def _is_unit(quats: Any) -> bool:
    with np.errstate(all="ignore"):
        return bool((np.abs(np.linalg.norm(np.asarray(quats, np.float64), axis=-1) - 1.0) <= UNIT).all())


def _is_strict(content: bytes) -> bool:
    """Returns whether a document's JSON has only constants that JSON allows."""
    constants: list[str] = []
    text = content[20 : 20 + int.from_bytes(content[12:16], "little")] if content[:4] == b"glTF" else content
    json.loads(text.decode("utf-8-sig"), parse_constant=constants.append)
    return not constants
