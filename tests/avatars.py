"""Avatars of other proportions as VRM files: the mannequin of a stretched skeleton, its bones named."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from pygltflib import GLTF2

from signsplice.formats import glb, vrma
from signsplice.motion import rotation
from signsplice.motion.clip import Clip, Skeleton
from signsplice.motion.rotation import inverse, multiply
from signsplice.rig.info import rig_info


def write_avatar(clip: Clip, path: Path) -> None:
    """Write a VRM 1.0 avatar: the clip's mannequin in the T-pose, with its bones named."""
    global_quats = rig_info(clip.skeleton).t_pose.rotations  # (J, 4)
    local_quats = np.array([
        quat if parent < 0 else multiply(inverse(global_quats[parent]), quat)
        for quat, parent in zip(global_quats, clip.skeleton.parents, strict=True)
    ])  # fmt: skip
    document = glb.document(replace(clip[:2], local_rotations=np.stack([local_quats, local_quats]), channels=None))
    nodes = {node.name: number for number, node in enumerate(document.nodes)}
    joints = rig_info(clip.skeleton).roles.joints
    _save(document, {role: nodes[clip.skeleton.names[joint]] for role, joint in joints.items()}, path)


def write_bones(skeleton: Skeleton, path: Path) -> None:
    """Write a VRM 1.0 avatar that has a skeleton's bones and no mesh."""
    still = np.tile(rotation.IDENTITY, (2, len(skeleton), 1))
    document = vrma.document(Clip(skeleton, still, np.zeros((2, 3)), 30.0))
    document.extensionsUsed, document.extensions = [], {}
    _save(document, {node.name: number for number, node in enumerate(document.nodes)}, path)


def _save(document: GLTF2, bones: Mapping[str, int], path: Path) -> None:
    """Write a document with the VRM extension; ``bones``: role -> node."""
    meta = {"name": "toy", "authors": ["signsplice"], "licenseUrl": "https://vrm.dev/licenses/1.0/"}
    human = {"humanBones": {role: {"node": node} for role, node in bones.items()}}
    document.extensionsUsed.append("VRMC_vrm")
    document.extensions["VRMC_vrm"] = {"specVersion": "1.0", "meta": meta, "humanoid": human}
    path.write_bytes(b"".join(document.save_to_bytes()))
