"""glTF binary files (``.glb``): writes a skinned, animated person, reads any animated skeleton.

The clip's own joints carry the mannequin of ``body.mesh``, so that any glTF reader opens the file as an armature with a
mesh and an action. ``gltf_reader`` describes reading.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from pygltflib import GLTF2

from signsplice.body.capsules import Avatar
from signsplice.body.mesh import bind_pose, body_mesh
from signsplice.formats.gltf_document import HUMANOID_EXTRA, ROLES_EXTRA, chunks
from signsplice.formats.gltf_face import write_face
from signsplice.formats.gltf_reader import parse
from signsplice.formats.gltf_unpack import DRACO
from signsplice.formats.gltf_writer import DocumentWriter, in_front
from signsplice.formats.json_files import parse_json
from signsplice.formats.reading import DEFAULT_LIMITS, ReadLimits, read_bytes
from signsplice.motion import Clip, bone_translations, rotation
from signsplice.motion.face import ARKIT_CHANNELS
from signsplice.rig.info import rig_info

__all__ = ["document", "encode", "figure", "parse"]

_STILL = 1e-9
"""A joint whose rotations or translations differ by less than this over the clip gets no animation channel."""


def encode(clip: Clip, mesh: bool = True, whole_face: bool = False) -> bytes:
    """Encode a clip as a .glb file; for an avatar that was read from a file, as that file with the motion. Without
    ``mesh``, only the joints and their motion. ``whole_face`` as in ``document``.
    """
    if mesh and isinstance(clip.skeleton, Avatar) and clip.skeleton.file is not None:
        from signsplice.formats import avatar

        return avatar.encode(clip, clip.skeleton.file)
    return b"".join(document(clip, mesh, whole_face).save_to_bytes())


def figure(path: str | Path, limits: ReadLimits = DEFAULT_LIMITS) -> bytes | None:
    """Return the bytes of a .glb file that holds a clip and a mesh with a skin, which the page can show; else None."""
    if Path(path).suffix.lower() != ".glb":
        return None
    content = read_bytes(path, limits.file_bytes)
    document = parse_json(chunks(str(path), content)[0], str(path), "a glTF document")
    is_packed = DRACO in (document.get("extensionsRequired") or ())
    is_shown = any(node.get("mesh") is not None and node.get("skin") is not None for node in document["nodes"])
    return content if is_shown and not is_packed else None


def document(clip: Clip, mesh: bool = True, whole_face: bool = False) -> GLTF2:
    """Build a glTF document of a clip: the mannequin, its skin, and one animation. Without ``mesh``, it has no
    mannequin, skin or face. With ``whole_face``, the mannequin has morph targets for all coefficients, not only for
    the moving ones.
    """
    clip = in_front(clip)
    rig = rig_info(clip.skeleton)
    metres = rig.sizes.unit.metres
    writer = DocumentWriter()
    joints = [writer.node(name) for name in clip.skeleton.names]
    translations = bone_translations(clip) * metres
    translations[:, 0] = clip.root_positions * metres
    quats = rotation.continuous(clip.local_rotations)
    for joint, node in enumerate(joints):
        writer.gltf.nodes[node].translation = translations[0, joint].tolist()
        writer.gltf.nodes[node].rotation = quats[0, joint].tolist()
        children = [joints[child] for child in clip.skeleton.children[joint]]
        if children:
            writer.gltf.nodes[node].children = children
    writer.scene(joints[0])
    names_of_roles = {role: clip.skeleton.names[joint] for role, joint in rig.roles.joints.items()}
    writer.gltf.extras = {HUMANOID_EXTRA: names_of_roles}
    if clip.skeleton.roles:
        writer.gltf.extras[ROLES_EXTRA] = dict(clip.skeleton.roles)
    if mesh:
        bind_quats, positions = bind_pose(clip.skeleton)
        writer.skin(joints, rotation.to_matrix(bind_quats).transpose(0, 2, 1), metres * positions, joints[0])
        moving = () if clip.face is None else clip.face.moving
        writer.mesh(body_mesh(clip.skeleton), metres, ARKIT_CHANNELS if whole_face else moving)
    times = writer.times(clip)
    for joint, node in enumerate(joints):
        if np.abs(quats[:, joint] - quats[:1, joint]).max() > _STILL or joint == 0:
            writer.channel(node, "rotation", times, quats[:, joint])
        if np.abs(translations[:, joint] - translations[:1, joint]).max() > _STILL or joint == 0:
            writer.channel(node, "translation", times, translations[:, joint])
    if mesh and clip.face is not None:
        write_face(writer, clip.face, times)
    return writer.finish(clip.name, clip.fps, clip.report)
