"""Avatars that have the figure's body and face: a glTF with ARKit's names, VRM 1.0 and 0.x with expressions."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from signsplice.formats import glb
from signsplice.formats.avatar_writer import pack
from signsplice.formats.gltf_document import chunks
from signsplice.lexicon import shipped
from signsplice.motion.clip import Clip
from signsplice.motion.face import ARKIT_CHANNELS, Face
from signsplice.motion.face_shapes import PRESETS
from signsplice.rig.info import rig_info

KINDS = ("arkit.glb", "vrm1.vrm", "vrm0.vrm", "presets.vrm")
_OLD = {"aa": "a", "ih": "i", "ou": "u", "ee": "e", "oh": "o", "blink": "blink"}
_OLD |= {"blinkLeft": "blink_l", "blinkRight": "blink_r"}
_OLD_BONES = {"ThumbMetacarpal": "ThumbProximal", "ThumbProximal": "ThumbIntermediate"}


def write(folder: Path, kind: str) -> Path:
    """Write the avatar of one of ``KINDS``; ``presets.vrm`` has no expression by ARKit's names."""
    skeleton = shipped().clip("NAME").skeleton
    rest = np.tile([0.0, 0.0, 0.0, 1.0], (1, len(skeleton), 1))
    whole = Face(ARKIT_CHANNELS, np.full((1, len(ARKIT_CHANNELS)), 0.5))
    text, blob = chunks("", glb.encode(Clip(skeleton, rest, np.zeros((1, 3)), 30.0, face=whole)))
    document: dict[str, Any] = json.loads(text)
    del document["animations"], document["extras"]
    mesh = next(k for k, fields in enumerate(document["meshes"]) if fields["name"] == "face")
    node = next(k for k, fields in enumerate(document["nodes"]) if fields.get("mesh") == mesh)
    if kind != "arkit.glb":
        document["meshes"][mesh]["extras"] = {"targetNames": [f"t{k}" for k in range(len(ARKIT_CHANNELS))]}
        shapes = {name: PRESETS[name] for name in _OLD}
        shapes |= {name: {name: 1.0} for name in ARKIT_CHANNELS} if kind != "presets.vrm" else {}
        make = _vrm_0 if kind == "vrm0.vrm" else _vrm_1
        name, extension = make(rig_info(skeleton).roles.joints, shapes, mesh if kind == "vrm0.vrm" else node)
        document |= {"extensionsUsed": [name], "extensions": {name: extension}}
    if kind == "vrm0.vrm":  # faces -Z
        document["nodes"].append(
            {"name": "behind", "rotation": [0, 1, 0, 0], "children": document["scenes"][0]["nodes"][:1]}
        )
        document["scenes"][0]["nodes"][0] = len(document["nodes"]) - 1
    path = folder / kind
    path.write_bytes(pack(document, bytes(blob)))
    return path


def _vrm_1(roles: Any, shapes: Any, node: int) -> tuple[str, dict[str, Any]]:
    rows = {
        name: {
            "morphTargetBinds": [{"node": node, "index": ARKIT_CHANNELS.index(c), "weight": w} for c, w in row.items()]
        }
        for name, row in shapes.items()
    }
    kinds = {
        kind: {n: r for n, r in rows.items() if (n in _OLD) == (kind == "preset")} for kind in ("preset", "custom")
    }
    bones = {role: {"node": joint} for role, joint in roles.items()}
    meta = {"name": "figure", "authors": ["signsplice"], "licenseUrl": "https://vrm.dev/licenses/1.0/"}
    humanoid = {"humanBones": bones}
    return "VRMC_vrm", {"specVersion": "1.0", "meta": meta, "humanoid": humanoid, "expressions": kinds}


def _vrm_0(roles: Any, shapes: Any, mesh: int) -> tuple[str, dict[str, Any]]:
    groups = [
        {
            "name": name,
            "presetName": _OLD.get(name, "unknown"),
            "binds": [{"mesh": mesh, "index": ARKIT_CHANNELS.index(c), "weight": 100.0 * w} for c, w in row.items()],
        }
        for name, row in shapes.items()
    ]
    bones = []
    for role, joint in roles.items():
        other = next((role.replace(new, old) for new, old in _OLD_BONES.items() if role.endswith(new)), role)
        bones.append({"bone": other, "node": joint})
    humanoid = {"humanBones": bones}
    return "VRM", {"meta": {"title": "figure"}, "humanoid": humanoid, "blendShapeMaster": {"blendShapeGroups": groups}}
