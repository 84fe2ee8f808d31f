"""Avatars that have the figure's body and face: a glTF with ARKit's names, VRM 1.0 and 0.x with expressions."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from signsplice.formats import glb
from signsplice.formats.avatar import pack
from signsplice.formats.gltf_document import chunks
from signsplice.lexicon import open_shipped_lexicon
from signsplice.motion import Clip
from signsplice.motion.face import ARKIT_CHANNELS, PRESETS, Face
from signsplice.rig.info import rig_info

KINDS = ("arkit.glb", "vrm1.vrm", "vrm0.vrm", "presets.vrm")
WITH_BONES = ("bones.glb", "bones1.vrm", "bones0.vrm")
"""Avatars whose lids are morph targets, but whose eyes and jaw are bones; those of VRM with ranges of look-at."""
GAZE_DEG, EYES_DEG = (60.0, 80.0, 50.0, 70.0), (9.0, 12.0, 8.0, 10.0)
"""Of those: largest input and output of the range maps, inward, outward, down and up."""
_RANGES = ("HorizontalInner", "HorizontalOuter", "VerticalDown", "VerticalUp")
_OLD = {"aa": "a", "ih": "i", "ou": "u", "ee": "e", "oh": "o", "blink": "blink"}
_OLD |= {"blinkLeft": "blink_l", "blinkRight": "blink_r"}
_OLD_BONES = {"ThumbMetacarpal": "ThumbProximal", "ThumbProximal": "ThumbIntermediate"}


def write(folder: Path, kind: str) -> Path:
    """Write the avatar of one of ``KINDS`` or ``WITH_BONES``; ``presets.vrm`` has no expression by ARKit's names."""
    skeleton = open_shipped_lexicon().clip("NAME").skeleton
    rest = np.tile([0.0, 0.0, 0.0, 1.0], (1, len(skeleton), 1))
    whole = Face(ARKIT_CHANNELS, np.full((1, len(ARKIT_CHANNELS)), 0.5))
    text, content = chunks("", glb.encode(Clip(skeleton, rest, np.zeros((1, 3)), 30.0, face=whole)))
    document: dict[str, Any] = json.loads(text)
    blob = bytearray(content)
    del document["animations"], document["extras"]
    mesh = next(k for k, fields in enumerate(document["meshes"]) if fields["name"] == "face")
    node = next(k for k, fields in enumerate(document["nodes"]) if fields.get("mesh") == mesh)
    roles: dict[str, int] = dict(rig_info(skeleton).roles.joints)
    if kind in WITH_BONES:
        roles |= _bones(document, blob, roles["head"])
    if kind == "bones.glb":
        document["meshes"][mesh]["extras"] = {"targetNames": [f"t{k}" for k in range(len(ARKIT_CHANNELS))]}
    elif kind != "arkit.glb":
        document["meshes"][mesh]["extras"] = {"targetNames": [f"t{k}" for k in range(len(ARKIT_CHANNELS))]}
        shapes = {name: PRESETS[name] for name in _OLD}
        shapes |= {name: {name: 1.0} for name in ARKIT_CHANNELS} if kind != "presets.vrm" else {}
        if kind in WITH_BONES:
            shapes = {name: PRESETS[name] for name in ("blinkLeft", "blinkRight", "lookLeft")}
        make = _vrm_0 if "0" in kind else _vrm_1
        name, extension = make(roles, shapes, mesh if "0" in kind else node)
        if kind == "bones1.vrm":
            rows = zip(_RANGES, GAZE_DEG, EYES_DEG, strict=True)
            maps = {f"rangeMap{n}": {"inputMaxValue": x, "outputScale": y} for n, x, y in rows}
            extension["lookAt"] = {"type": "bone", **maps}
        elif kind == "bones0.vrm":
            rows = zip(_RANGES, GAZE_DEG, EYES_DEG, strict=True)
            maps = {f"lookAt{n}": {"xRange": x, "yRange": y} for n, x, y in rows}
            extension["firstPerson"] = {"lookAtTypeName": "Bone", **maps}
        document |= {"extensionsUsed": [name], "extensions": {name: extension}}
    if "0" in kind:  # faces -Z
        document["nodes"].append(
            {"name": "behind", "rotation": [0, 1, 0, 0], "children": document["scenes"][0]["nodes"][:1]}
        )
        document["scenes"][0]["nodes"][0] = len(document["nodes"]) - 1
    path = folder / kind
    path.write_bytes(pack(document, bytes(blob)))
    return path


def _bones(document: dict[str, Any], blob: bytearray, head: int) -> dict[str, int]:
    """Role -> node of eyes and jaw, added below the head and to the skin."""
    skin, nodes = document["skins"][0], document["nodes"]
    accessor = document["accessors"][skin["inverseBindMatrices"]]
    view = document["bufferViews"][accessor["bufferView"]]
    start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
    n = accessor["count"]
    matrices = np.frombuffer(bytes(blob[start : start + 64 * n]), np.float32).reshape(n, 4, 4)  # column by column
    places = {"leftEye": [0.032, 0.07, 0.08], "rightEye": [-0.032, 0.07, 0.08], "jaw": [0.0, 0.02, 0.02]}
    found, added = {}, []
    for role, place in places.items():
        found[role] = len(nodes)
        nodes.append({"name": role, "translation": place})
        nodes[skin["joints"][head]].setdefault("children", []).append(found[role])
        matrix = np.array(matrices[head])
        matrix[3, :3] -= place
        added.append(matrix)
    blob += b"\0" * (-len(blob) % 4)
    content = np.concatenate([matrices, added]).astype(np.float32).tobytes()
    document["bufferViews"].append({"buffer": 0, "byteOffset": len(blob), "byteLength": len(content)})
    blob += content
    document["buffers"][0]["byteLength"] = len(blob)
    new = {"bufferView": len(document["bufferViews"]) - 1, "componentType": 5126, "count": n + 3, "type": "MAT4"}
    skin["inverseBindMatrices"] = len(document["accessors"])
    document["accessors"].append(new)
    skin["joints"] += found.values()
    return found


def _vrm_1(roles: Any, shapes: Any, node: int) -> tuple[str, dict[str, Any]]:
    rows = {
        name: {
            "morphTargetBinds": [{"node": node, "index": ARKIT_CHANNELS.index(c), "weight": w} for c, w in row.items()]
        }
        for name, row in shapes.items()
    }
    kinds = {
        kind: {n: r for n, r in rows.items() if (n in PRESETS) == (kind == "preset")} for kind in ("preset", "custom")
    }
    bones = {role: {"node": joint} for role, joint in roles.items()}
    meta = {"name": "figure", "authors": ["signsplice"], "licenseUrl": "https://vrm.dev/licenses/1.0/"}
    humanoid = {"humanBones": bones}
    return "VRMC_vrm", {"specVersion": "1.0", "meta": meta, "humanoid": humanoid, "expressions": kinds}


def _vrm_0(roles: Any, shapes: Any, mesh: int) -> tuple[str, dict[str, Any]]:
    groups = [
        {
            "name": name,
            "presetName": _OLD.get(name, name.lower() if name in PRESETS else "unknown"),
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
