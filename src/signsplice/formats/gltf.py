"""glTF 2.0 (.glb, .gltf) and VRM animation (.vrma): an animated person in, an animated person out.

A written .glb holds the mannequin of ``motion.mannequin`` bound to the clip's own joints, so that it opens as an
armature with a mesh and an action wherever glTF is read. A written .vrma holds no mesh: turns of the humanoid's bones
from a T-pose, for any VRM avatar (VRMC_vrm_animation 1.0). Lengths are metres, up is +Y; the signer stands at the
origin and faces +Z.

What is read may be any skeleton that a file animates: joints keep their hierarchy, and the pose in which the skin is
bound (the file's own rest, where there is no skin) becomes the rest pose of the clip. Keys are sampled at an even rate.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pygltflib import (
    GLTF2,
    Accessor,
    Animation,
    AnimationChannel,
    AnimationChannelTarget,
    AnimationSampler,
    Asset,
    Attributes,
    Buffer,
    BufferView,
    Material,
    Mesh,
    Node,
    PbrMetallicRoughness,
    Primitive,
    Scene,
    Skin,
)

from signsplice.body.capsules import body_capsules, capsule_ends
from signsplice.body.mesh import MeshPart, bind_pose, body_mesh
from signsplice.errors import InputError
from signsplice.formats.atomic import replacing
from signsplice.motion import kinematics, rotation
from signsplice.motion.clip import Clip, Skeleton, bone_translations
from signsplice.rig import proportions
from signsplice.rig.align import place
from signsplice.rig.proportions import Placement
from signsplice.rig.roles import find_roles
from signsplice.rig.t_pose import t_pose_positions, t_pose_rotations

Float = NDArray[np.float64]
Array = NDArray[Any]

VRM_ANIMATION = "VRMC_vrm_animation"
FPS, ROLES, HUMANOID = "fps", "roles", "humanoid"
"""What tells an animation's frame rate, among its extras; and among the file's, the roles that a user gave to joints
(role -> name), and all that are known, for those who show the file.
"""
_UNNAMED_ROLES = ("leftEye", "rightEye")
"""Roles that a VRM animation must not turn as bones."""
_HIPS = 0.53
"""Height of the hips as a share of stature (Drillis and Contini 1966)."""
_STILL = 1e-9
"""Turns and ways smaller than this are no movement."""
_FLOAT, _UBYTE, _USHORT, _UINT = 5126, 5121, 5123, 5125
_ARRAY_BUFFER, _ELEMENTS = 34962, 34963
_GENERATOR = "signsplice"


def write(clip: Clip, path: str | Path) -> None:
    """Write a clip as a skinned, animated person, whole or not at all."""
    _save(person(clip), path)


def write_vrma(clip: Clip, path: str | Path) -> None:
    """Write a clip as an animation for VRM avatars, whole or not at all.

    Raises ``InputError`` where the rig has no known hips, whose motion such a file must tell.
    """
    try:
        made = vrm_animation(clip)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    _save(made, path)


def _save(made: GLTF2, path: str | Path) -> None:
    content = b"".join(made.save_to_bytes())
    with replacing(path) as temporary:
        temporary.write_bytes(content)


def person(clip: Clip) -> GLTF2:
    """A clip as a glTF document: the mannequin, its skin, and one animation."""
    clip = in_front(clip)
    metres = proportions.sizes(clip.skeleton).unit.metres
    made = _DocumentWriter()
    joints = [made.node(name) for name in clip.skeleton.names]
    translations = bone_translations(clip) * metres
    translations[:, 0] = clip.root_positions * metres
    turns = rotation.continuous(clip.local_rotations)
    for joint, node in enumerate(joints):
        made.gltf.nodes[node].translation = translations[0, joint].tolist()
        made.gltf.nodes[node].rotation = turns[0, joint].tolist()
        children = [joints[child] for child in clip.skeleton.children[joint]]
        if children:
            made.gltf.nodes[node].children = children
    made.scene(joints[0])
    known = find_roles(clip.skeleton).joints
    made.gltf.extras = {HUMANOID: {role: clip.skeleton.names[joint] for role, joint in known.items()}}
    if clip.skeleton.roles:
        made.gltf.extras[ROLES] = dict(clip.skeleton.roles)
    made.skin(joints, _bind(clip, metres), joints[0])
    made.mesh(body_mesh(clip.skeleton), metres)
    times = made.times(clip)
    for joint, node in enumerate(joints):
        if np.abs(turns[:, joint] - turns[:1, joint]).max() > _STILL or joint == 0:
            made.channel(node, "rotation", times, turns[:, joint])
        if np.abs(translations[:, joint] - translations[:1, joint]).max() > _STILL or joint == 0:
            made.channel(node, "translation", times, translations[:, joint])
    return made.finished(clip.name, clip.fps)


def vrm_animation(clip: Clip) -> GLTF2:
    """A clip as a VRM animation: the humanoid's bones alone, at rest in a T-pose of plain axes.

    With G a joint's global rotation and C that of the common pose, a bone turns by K_above^-1 K, K = G C^-1. Raises
    ``InputError`` where the rig has no known hips.
    """
    roles = find_roles(clip.skeleton).joints
    if "hips" not in roles:
        raise InputError("no hips found among the joints, which a VRM animation needs; name them with a roles file")
    clip = in_front(clip)
    metres = proportions.sizes(clip.skeleton).unit.metres
    hips = roles["hips"]
    below = {role: joint for role, joint in roles.items()
             if role not in _UNNAMED_ROLES and hips in kinematics.path_to_root(clip.skeleton, joint)}  # fmt: skip
    globals_, positions = kinematics.forward(clip, list(below.values()))
    carried = rotation.from_matrix(globals_)
    carried = rotation.multiply(carried, rotation.inverse(t_pose_rotations(clip.skeleton)[list(below.values())]))
    rest = t_pose_positions(clip.skeleton)
    made = _DocumentWriter()
    nodes = {role: made.node(role) for role in below}
    made.scene(nodes["hips"])
    times = made.times(clip)
    row = {role: k for k, role in enumerate(below)}
    for role, joint in below.items():
        over = _above(clip, joint, below)
        own = carried[:, row[role]]
        if over is None:
            feet = [rest[below[foot], 1] for foot in ("leftFoot", "rightFoot") if foot in below]
            # Players measure an avatar by the height of its hips: a body without feet has them where others do.
            height = rest[hips, 1] - np.mean(feet) + _sole(clip.skeleton) if feet else _HIPS * _size(clip.skeleton)
            lift = 0.0 if feet else height
            made.gltf.nodes[nodes[role]].translation = [0.0, metres * float(height), 0.0]
            made.channel(nodes[role], "translation", times, metres * (positions[:, row[role]] + [0.0, lift, 0.0]))
        else:
            made.gltf.nodes[nodes[role]].translation = (metres * (rest[joint] - rest[below[over]])).tolist()
            own = rotation.multiply(rotation.inverse(carried[:, row[over]]), own)
            made.gltf.nodes[nodes[over]].children.append(nodes[role])
        made.channel(nodes[role], "rotation", times, rotation.continuous(own))
    bones = {role: {"node": node} for role, node in nodes.items()}
    made.gltf.extensionsUsed.append(VRM_ANIMATION)
    made.gltf.extensions[VRM_ANIMATION] = {"specVersion": "1.0", "humanoid": {"humanBones": bones}}
    return made.finished(clip.name, clip.fps)


def in_front(clip: Clip) -> Clip:
    """The clip moved as one rigid whole so that its signer stands at the origin, soles at 0, up +Y, and faces +Z."""
    ankles = np.array([0.0, _sole(clip.skeleton), 0.0])
    return place(clip, Placement(ankles, np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])))


def _sole(skeleton: Skeleton) -> float:
    """How far below the foot joints the mannequin's soles are, clip units; 0 where no feet are known."""
    joints = find_roles(skeleton).joints
    feet = [joints[role] for role in ("leftFoot", "rightFoot") if role in joints]
    shape = body_capsules(skeleton)
    shoes = [n for n, part in enumerate(shape.parts) if part in ("leg", "shoe")]
    if not feet or not shoes:
        return 0.0
    rotations, places = bind_pose(skeleton)
    starts, ends = capsule_ends(shape, rotation.to_matrix(rotations)[None], places[None])
    low = min((points[0, shoes, 1] - shape.radii[shoes, k]).min() for k, points in enumerate((starts, ends)))
    return float(places[feet, 1].mean() - low)


def _size(skeleton: Skeleton) -> float:
    """Body height, clip units; 1 m where a skeleton has none."""
    return proportions.stature(skeleton) or 1.0 / proportions.sizes(skeleton).unit.metres


def _above(clip: Clip, joint: int, roles: Mapping[str, int]) -> str | None:
    """The nearest role above a joint, None where there is none."""
    role_of = {number: role for role, number in roles.items()}
    return next((role_of[k] for k in kinematics.path_to_root(clip.skeleton, joint)[1:] if k in role_of), None)


def _bind(clip: Clip, metres: float) -> Float:
    """Matrices (J, 4, 4) that take the world in which the skin is bound to each joint's own axes."""
    rotations, places = bind_pose(clip.skeleton)
    turns = rotation.to_matrix(rotations)
    out = np.tile(np.eye(4), (len(turns), 1, 1))
    out[:, :3, :3] = turns.transpose(0, 2, 1)
    out[:, :3, 3] = -np.einsum("jba,jb->ja", turns, metres * places)
    return out


@dataclass
class _DocumentWriter:
    """A glTF document in the making, and the bytes of its buffer."""

    gltf: GLTF2 = field(
        default_factory=lambda: GLTF2(
            asset=Asset(version="2.0", generator=_GENERATOR),
            animations=[Animation(samplers=[], channels=[])],
            extensionsUsed=[],
            extensions={},
        )
    )
    content: bytearray = field(default_factory=bytearray)

    def node(self, name: str) -> int:
        self.gltf.nodes.append(Node(name=name, children=[]))
        return len(self.gltf.nodes) - 1

    def scene(self, root: int) -> None:
        self.gltf.scenes, self.gltf.scene = [Scene(nodes=[root])], 0

    def array(self, values: Array, kind: str, component: int, target: int | None = None, **told: Any) -> int:
        """Put an array into the buffer; the number of its accessor."""
        types = {_FLOAT: np.float32, _UBYTE: np.uint8, _USHORT: np.uint16, _UINT: np.uint32}
        values = np.ascontiguousarray(values, types[component])
        self.content += b"\0" * (-len(self.content) % 4)
        view = BufferView(buffer=0, byteOffset=len(self.content), byteLength=values.nbytes, target=target)
        self.gltf.bufferViews.append(view)
        self.content += values.tobytes()
        accessor = Accessor(bufferView=len(self.gltf.bufferViews) - 1, componentType=component, count=len(values),
                            type=kind, **told)  # fmt: skip
        self.gltf.accessors.append(accessor)
        return len(self.gltf.accessors) - 1

    def skin(self, joints: Sequence[int], bind: Float, root: int) -> None:
        matrices = self.array(bind.transpose(0, 2, 1).reshape(-1, 16), "MAT4", _FLOAT)
        self.gltf.skins = [Skin(joints=list(joints), inverseBindMatrices=matrices, skeleton=root)]

    def mesh(self, things: Sequence[MeshPart], metres: float) -> None:
        """The skin, things of one colour together."""
        primitives = []
        for colour in dict.fromkeys(thing.colour for thing in things):
            same = [thing for thing in things if thing.colour == colour]
            starts = np.cumsum([0, *(len(thing.vertices) for thing in same)])
            places = np.concatenate([thing.vertices for thing in same]).astype(np.float32) * np.float32(metres)
            joints = np.concatenate([thing.joints for thing in same])
            weights = np.concatenate([thing.weights for thing in same])
            indices = np.concatenate([thing.triangles + k for thing, k in zip(same, starts[:-1], strict=True)]).ravel()
            corners = {"min": places.min(axis=0).tolist(), "max": places.max(axis=0).tolist()}
            attributes = Attributes(
                POSITION=self.array(places, "VEC3", _FLOAT, _ARRAY_BUFFER, **corners),
                NORMAL=self.array(np.concatenate([t.normals for t in same]), "VEC3", _FLOAT, _ARRAY_BUFFER),
                JOINTS_0=self.array(joints, "VEC4", _UBYTE if joints.max() < 256 else _USHORT, _ARRAY_BUFFER),
                WEIGHTS_0=self.array(_bytes(weights), "VEC4", _UBYTE, _ARRAY_BUFFER, normalized=True),
            )
            small = len(places) < 65536
            self.gltf.materials.append(Material(
                name=same[0].name,
                pbrMetallicRoughness=PbrMetallicRoughness(
                    baseColorFactor=[*_linear(colour), 1.0], metallicFactor=0.0, roughnessFactor=0.8
                ),
            ))  # fmt: skip
            primitives.append(Primitive(
                attributes=attributes,
                indices=self.array(indices, "SCALAR", _USHORT if small else _UINT, _ELEMENTS),
                material=len(self.gltf.materials) - 1,
            ))  # fmt: skip
        self.gltf.meshes = [Mesh(name="mannequin", primitives=primitives)]
        self.gltf.nodes.append(Node(name="mannequin", mesh=0, skin=0))
        self.gltf.scenes[0].nodes.append(len(self.gltf.nodes) - 1)

    def times(self, clip: Clip) -> int:
        """The moments of a clip's frames."""
        seconds = (np.arange(len(clip)) / clip.fps).astype(np.float32)
        return self.array(seconds, "SCALAR", _FLOAT, min=[float(seconds[0])], max=[float(seconds[-1])])

    def channel(self, node: int, path: str, times: int, values: Float) -> None:
        animation = self.gltf.animations[0]
        output = self.array(values, "VEC4" if path == "rotation" else "VEC3", _FLOAT)
        animation.samplers.append(AnimationSampler(input=times, output=output, interpolation="LINEAR"))
        target = AnimationChannelTarget(node=node, path=path)
        animation.channels.append(AnimationChannel(sampler=len(animation.samplers) - 1, target=target))

    def finished(self, name: str, fps: float) -> GLTF2:
        self.gltf.animations[0].name = name or "signing"
        self.gltf.animations[0].extras = {FPS: fps}
        self.content += b"\0" * (-len(self.content) % 4)
        self.gltf.buffers = [Buffer(byteLength=len(self.content))]
        self.gltf.set_binary_blob(bytes(self.content))
        return self.gltf


def _bytes(weights: Float) -> NDArray[np.uint8]:
    """Weights (V, 4) as bytes that sum to 255."""
    out = np.floor(255.0 * weights).astype(np.int64)
    out[:, 0] += 255 - out.sum(axis=1)
    return out.astype(np.uint8)


def _linear(colour: Sequence[float]) -> list[float]:
    """An sRGB colour as the linear light that glTF asks for (IEC 61966-2-1)."""
    return [round(c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4, 6) for c in colour]
