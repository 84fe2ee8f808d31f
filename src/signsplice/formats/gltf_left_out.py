"""What the animation of a glTF file moves besides joints, by name: a clip does not hold it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from signsplice.formats.gltf_document import VRM_ANIMATION, Fields

_POINTER = "KHR_animation_pointer"


def left_out(document: Fields, animation: Fields) -> tuple[str, ...]:
    """Expressions and look-at of a VRM animation, morph targets, and properties that a pointer animates."""
    targets = [channel["target"] for channel in animation["channels"]]
    animated = {target.get("node") for target in targets}
    names = [*_vrm(document, animated)]
    for target in targets:
        if target["path"] == "weights":
            names += _morph_targets(document, target.get("node"))
        elif target["path"] == "pointer":
            pointer = _object(_object(target.get("extensions")).get(_POINTER)).get("pointer")
            names.append(f"property {pointer}")
    return tuple(dict.fromkeys(name[:80] for name in names if name.isprintable()))


def _vrm(document: Fields, animated: set[Any]) -> Iterator[str]:
    """The expressions, and the look-at, of a VRM animation whose nodes are animated."""
    vrm = _object(_object(document.get("extensions")).get(VRM_ANIMATION))
    expressions = _object(vrm.get("expressions"))
    for kind in ("preset", "custom"):
        for name, row in _object(expressions.get(kind)).items():
            if _number(_object(row).get("node")) in animated:
                yield f"expression {name}"
    if _number(_object(vrm.get("lookAt")).get("node")) in animated:
        yield "look-at"


def _morph_targets(document: Fields, node: Any) -> list[str]:
    """The names of the morph targets of a node's mesh, or of the node where they have none."""
    nodes, meshes = document.get("nodes") or [], document.get("meshes") or []
    fields = _object(nodes[node]) if isinstance(node, int) and 0 <= node < len(nodes) else {}
    mesh = fields.get("mesh")
    extras = _object(meshes[mesh]).get("extras") if isinstance(mesh, int) and 0 <= mesh < len(meshes) else None
    names = _object(extras).get("targetNames")
    if isinstance(names, list) and names:
        return [f"morph target {name}" for name in names]
    return [f"morph targets of {fields.get('name') or f'node {node}'}"]


def _object(value: Any) -> Fields:
    return value if isinstance(value, dict) else {}


def _number(value: Any) -> Any:
    """A node's number; what is none, and cannot be looked up, is -1."""
    return value if isinstance(value, int) else -1
