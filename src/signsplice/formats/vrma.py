"""VRM animations (``.vrma``, VRMC_vrm_animation 1.0): rotations of the humanoid's bones from a T-pose, for any avatar.

The file holds no mesh and no eye bones, which the format replaces by look-at; a face is stored as expressions and
look-at. ``gltf_reader`` describes reading.
"""

from __future__ import annotations

import numpy as np
from pygltflib import GLTF2

from signsplice.body.capsules import Avatar
from signsplice.errors import InputError
from signsplice.formats.avatar import with_bones
from signsplice.formats.gltf_document import VRM_ANIMATION
from signsplice.formats.gltf_face import write_expressions, write_look_at
from signsplice.formats.gltf_reader import parse
from signsplice.formats.gltf_writer import DocumentWriter, in_front, sole_depth
from signsplice.motion import Clip, kinematics, rotation
from signsplice.motion.face import LookAt, has_gaze
from signsplice.rig.info import rig_info

__all__ = ["document", "encode", "parse"]

_EYES = ("leftEye", "rightEye")
"""Roles that a VRM animation must not animate as bones."""
_HIPS_HEIGHT = 0.53
"""Height of the hips as a fraction of stature (Drillis and Contini 1966)."""


def encode(clip: Clip) -> bytes:
    """Encode a clip as a .vrma file. Raises ``InputError`` if the rig has no known hips."""
    return b"".join(document(clip).save_to_bytes())


def document(clip: Clip) -> GLTF2:
    """Build a VRM animation of a clip: the humanoid's bones alone, at rest in a T-pose with the world's axes.

    With G a joint's global rotation and C that of the T-pose, K = G C^-1, and a bone's rotation is K_parent^-1 K. A VRM
    avatar's T-pose is the rest pose of its file, since players rotate its bones from there. Raises ``InputError`` if
    the rig has no known hips.
    """
    rig = rig_info(clip.skeleton)
    if "hips" not in rig.roles.joints:
        raise InputError("no hips found among the joints, which a VRM animation needs; name them with a roles file")
    file = clip.skeleton.file if isinstance(clip.skeleton, Avatar) else None
    clip = in_front(clip if file is None else with_bones(clip, file))
    metres = rig.sizes.unit.metres
    hips = rig.roles.joints["hips"]
    bones = {role: joint for role, joint in rig.roles.joints.items()
             if role not in _EYES and hips in kinematics.path_to_root(clip.skeleton, joint)}  # fmt: skip
    joints = list(bones.values())
    global_rotations, positions = kinematics.forward(clip, joints)  # (T, K, 3, 3), (T, K, 3)
    t_pose, rest = rig.t_pose.rotations, rig.t_pose.positions
    if isinstance(clip.skeleton, Avatar) and clip.skeleton.is_vrm:
        t_pose, rest = np.tile(rotation.IDENTITY, (len(rest), 1)), kinematics.rest_positions(clip.skeleton)
    from_t_pose = rotation.multiply(
        rotation.from_matrix(global_rotations), rotation.inverse(t_pose[joints])
    )  # (T, K, 4)
    writer = DocumentWriter()
    nodes = {role: writer.node(role) for role in bones}
    writer.scene(nodes["hips"])
    times = writer.times(clip)
    column, role_of = {role: k for k, role in enumerate(bones)}, {joint: role for role, joint in bones.items()}
    for role, joint in bones.items():
        above = kinematics.path_to_root(clip.skeleton, joint)[1:]
        parent = next((role_of[k] for k in above if k in role_of), None)
        local = from_t_pose[:, column[role]]
        node = writer.gltf.nodes[nodes[role]]
        if parent is None:
            feet = [rest[bones[foot], 1] for foot in ("leftFoot", "rightFoot") if foot in bones]
            # Players measure an avatar by the height of its hips: a body without feet gets them at the usual height.
            height = (
                rest[hips, 1] - np.mean(feet) + sole_depth(clip.skeleton)
                if feet
                else _HIPS_HEIGHT * (rig.sizes.stature or 1.0 / metres)
            )
            lift = 0.0 if feet else height
            node.translation = [0.0, metres * float(height), 0.0]
            writer.channel(nodes[role], "translation", times, metres * (positions[:, column[role]] + [0.0, lift, 0.0]))
        else:
            node.translation = (metres * (rest[joint] - rest[bones[parent]])).tolist()
            local = rotation.multiply(rotation.inverse(from_t_pose[:, column[parent]]), local)
            writer.gltf.nodes[nodes[parent]].children.append(nodes[role])
        writer.channel(nodes[role], "rotation", times, rotation.continuous(local))
    human_bones = {role: {"node": node} for role, node in nodes.items()}
    extension: dict[str, object] = {"specVersion": "1.0", "humanoid": {"humanBones": human_bones}}
    if clip.face is not None:
        expressions = () if file is None else file.expressions
        extension["expressions"] = write_expressions(writer, clip.face, times, expressions)
        look_at = LookAt() if file is None else file.look_at
        if look_at is not None and has_gaze(clip.face):
            extension["lookAt"] = write_look_at(writer, clip.face, times, look_at)
    writer.gltf.extensionsUsed.append(VRM_ANIMATION)
    writer.gltf.extensions[VRM_ANIMATION] = extension
    return writer.finish(clip.name, clip.fps, clip.report)
