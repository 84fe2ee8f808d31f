"""Small glTF documents whose numbers a test chooses."""

from __future__ import annotations

import base64
import json
from pathlib import Path
from typing import Any

import numpy as np

import signsplice as ss
from signsplice.motion import Clip


def document(nodes: list[dict[str, Any]], channels: list[dict[str, Any]], **more: Any) -> dict[str, Any]:
    """A glTF document: channels hold node, path, times, values and interpolation."""
    content, views, accessors, samplers, targets = bytearray(), [], [], [], []

    def put(values: Any, kind: str, dtype: str = "f4", component: int = 5126, **extra: Any) -> int:
        array = np.ascontiguousarray(values, dtype)
        views.append({"buffer": 0, "byteOffset": len(content), "byteLength": array.nbytes})
        content.extend(array.tobytes() + b"\0" * (-array.nbytes % 4))
        accessors.append(
            {"bufferView": len(views) - 1, "componentType": component, "count": len(array), "type": kind, **extra}
        )
        return len(accessors) - 1

    for channel in channels:
        kind = "VEC4" if channel["path"] == "rotation" else "VEC3"
        extra = channel.get("stored", {})
        samplers.append({
            "input": put(channel["times"], "SCALAR"),
            "output": put(channel["values"], kind, **extra),
            "interpolation": channel.get("interpolation", "LINEAR"),
        })  # fmt: skip
        targets.append({"sampler": len(samplers) - 1, "target": {"node": channel["node"], "path": channel["path"]}})
    uri = "data:application/octet-stream;base64," + base64.b64encode(bytes(content)).decode()
    return {
        "asset": {"version": "2.0"}, "nodes": nodes, "accessors": accessors, "bufferViews": views,
        "buffers": [{"byteLength": len(content), "uri": uri}],
        "animations": [{"name": "wave", "samplers": samplers, "channels": targets}], **more,
    }  # fmt: skip


def load_document(folder: Path, content: dict[str, Any]) -> Clip:
    path = folder / "made.gltf"
    path.write_text(json.dumps(content))
    return ss.load(path)


ARM = [{"name": "root", "children": [1]}, {"name": "arm", "translation": [0, 1, 0]}]
QUARTER = [0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)]
IDENTITY = [0.0, 0.0, 0.0, 1.0]


def rotating(**more: Any) -> dict[str, Any]:
    """A channel that rotates the root by a quarter revolution within a second."""
    return {"node": 0, "path": "rotation", "times": [0, 1], "values": [IDENTITY, QUARTER], **more}


def changed(change: Any) -> dict[str, Any]:
    """A valid document after a change."""
    content = document([dict(node) for node in ARM], [rotating()])
    change(content)
    return content
