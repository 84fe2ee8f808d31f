"""The body around a skeleton: tapered capsules in human proportions, for pictures and for collision; and avatars, whose
body and mesh come from a file.

"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from signsplice.body.skin_surface import AvatarSkin
from signsplice.motion import FloatArray, Skeleton, rotation
from signsplice.motion.clip import HasDerived
from signsplice.motion.face import LookAt
from signsplice.motion.kinematics import rest_positions
from signsplice.rig.info import rig_info
from signsplice.rig.roles import FINGERS, SIDES

N_JOINTS = 4
"""Largest number of joints that carry a vertex."""


@dataclass(frozen=True)
class HandSizes:
    """Capsules of a hand in usual proportions."""

    palm_start: float = 0.12
    """Part of the way from the wrist to a knuckle at which that knuckle's capsule of the palm begins."""
    palm_radius: float = 0.0095
    """Radius of a capsule of the palm at its beginning, statures."""
    knuckle_radius: float = 1.22
    """Radius of a capsule of the palm at its knuckle, in radii of the finger."""
    thumb_knuckle_radius: float = 1.35
    """Radius of the thumb's capsule of the palm at its knuckle, in radii of the thumb."""
    mitten_length: float = 0.08
    """Length of a hand without fingers, statures."""
    mitten_start_radius: float = 0.02
    """Radius of a hand without fingers at the wrist, statures."""
    mitten_end_radius: float = 0.018
    """Radius of a hand without fingers at its end, statures."""
    phalanx_radius: float = 1.12
    """Radius of a first phalanx at its beginning, in radii of the finger."""
    phalanx_taper: float = 0.09
    """Decrease of the radius with each phalanx, in radii of the finger."""
    shortest_tip: float = 0.2
    """Least length of a last phalanx, in lengths of the one before."""
    longest_tip: float = 2.0
    """Largest length of a last phalanx, in lengths of the one before."""
    usual_tip: float = 0.8
    """Length of a last phalanx whose end is not known, in lengths of the one before."""


_HAND_SIZES = HandSizes()


@dataclass(frozen=True)
class TrunkSizes:
    """Capsules of trunk and neck in usual proportions; lengths and radii are fractions of stature."""

    columns: tuple[tuple[float, float], ...] = ((0.058, 0.053), (0.0, 0.060), (-0.058, 0.053))
    """Distance to the left and radius of the capsules side by side that form the oval of chest and belly."""
    column_drop: float = 0.045
    """Distance from the shoulders down to the top of the columns."""
    waist_width: float = 0.94
    """Distance of the columns from the middle at the waist, as a part of that above."""
    waist_thickness: float = 0.92
    """Radius of the columns at the waist, as a part of that above."""
    hem_drop: float = 0.035
    """Distance from the hips down to the hem, where the trunk ends."""
    hem_width: float = 1.08
    """Distance of the columns from the middle at the hem, as a part of that above."""
    hem_radius: float = 0.057
    """Radius of the columns at the hem."""
    hip_reach: float = 0.95
    """Part of the way to the legs' joints that the hips reach."""
    hip_radius: float = 0.057
    """Radius of the hips."""
    neck_overlap: float = 0.02
    """Length of the neck beyond either end of its bone."""
    neck_radii: tuple[float, float] = (0.030, 0.029)
    """Radii of the neck at its lower and upper end."""
    back_drop: float = 0.02
    """Distance from the neck down to the top of the back."""
    back_radii: tuple[float, float] = (0.044, 0.050)
    """Radii of the back at its upper and lower end."""
    collar_to_shoulder: float = 0.55
    """Share of the shoulder in the place of a collar's end."""
    collar_to_middle: float = 0.45
    """Share of the middle between the shoulders in the place of a collar's end."""
    collar_drop: float = 0.004
    """Distance from that place down to the collar's end."""
    collar_radii: tuple[float, float] = (0.034, 0.033)
    """Radii of a collar at the neck and at its end."""
    shoulder_span: tuple[float, float] = (0.2, 0.93)
    """Parts of the way along the collar bone at which the shoulder begins and ends."""
    shoulder_radii: tuple[float, float] = (0.035, 0.0325)
    """Radii of the shoulder at its beginning and end."""


TRUNK_SIZES = TrunkSizes()


@dataclass(frozen=True, eq=False)
class MeshPart:
    """A part of the mesh of one material.

    name: of the part, with its side.
    colour: sRGB, 0 to 1; its texture is multiplied by it.
    vertices, normals: (V, 3) in the bind pose, clip units, the root at the origin.
    triangles: (F, 3) indices of vertices.
    joints, weights: (V, 4) joints that carry each vertex, and their weights; unused ones have weight 0.
    morphs: control of the face, known to ``motion.face`` -> vertices that it moves (N,), and their moves at 1 (N, 3).
    uvs: (V, 2) texture coordinates, v down; None without texture.
    texture: its picture, as encoded in a file (PNG, JPEG, WebP); empty for none.
    cutoff: least alpha of the texture that is visible; 0 if it is opaque.
    both_sides: whether it is visible from inside.
    """

    name: str
    colour: tuple[float, float, float]
    vertices: FloatArray
    normals: FloatArray
    triangles: NDArray[np.int64]
    joints: NDArray[np.int64]
    weights: FloatArray
    morphs: Mapping[str, tuple[NDArray[np.int64], FloatArray]] = field(default_factory=dict)
    uvs: FloatArray | None = None
    texture: bytes = b""
    cutoff: float = 0.0
    both_sides: bool = False


@dataclass(frozen=True)
class FaceControl:
    """A control of an avatar's face: an expression of VRM, or one morph target.

    name: its name in the file.
    binds: node, number of the morph target, and its weight when the control is at 1.
    """

    name: str
    binds: tuple[tuple[int, int, float], ...]


@dataclass(frozen=True, eq=False)
class AvatarFile:
    """The file of an avatar, and the places of its J joints in it.

    content: a whole .glb file, which refers to no other.
    nodes: (J,) the node of each joint.
    turn: (3, 3) from the file's world to the avatar's axes: VRM 0.x avatars face -Z, ours +Z.
    worlds: (J, 4, 4) the joints at rest in the file's world.
    above: (4, 4) transform above the root.
    face: controls of the face.
    n_targets: node that the face moves -> number of its morph targets.
    expressions: names of the VRM expressions that move a target, presets under their VRM 1.0 names.
    look_at: rotation of eyes that are bones; None if the gaze moves no bones.
    opens_jaw: whether the jaw is a bone and no morph target opens the mouth.
    """

    content: bytes
    nodes: tuple[int, ...]
    turn: FloatArray
    worlds: FloatArray
    above: FloatArray
    face: tuple[FaceControl, ...] = ()
    n_targets: Mapping[int, int] = field(default_factory=dict)
    expressions: tuple[str, ...] = ()
    look_at: LookAt | None = None
    opens_jaw: bool = False


_SEGMENTS = ("Metacarpal", "Proximal", "Intermediate", "Distal")
_FINGER_RADII = {"Thumb": 0.0068, "Index": 0.0058, "Middle": 0.0059, "Ring": 0.0056, "Little": 0.0049}
"""Half a finger's breadth as a fraction of stature, about 10 mm on 1.70 m."""


@dataclass(frozen=True, eq=False)
class Capsule:
    """One capsule: key, joint, both ends (3,) in the joint's frame, the radii there, part and side."""

    key: str
    joint: int
    start: FloatArray
    end: FloatArray
    start_radius: float
    end_radius: float
    part: str
    side: str = ""


def hand_capsules(
    skeleton: Skeleton, joints: Mapping[str, int], rest: FloatArray, side: str, height: float, thickness: float
) -> list[Capsule]:
    """Returns capsules from the wrist to each knuckle, and of every phalanx of one hand; none without a wrist.

    joints: of roles. rest: (J, 3) joints at rest. height: stature, clip units. thickness: of fingers, 1 as usual.
    """
    wrist, sizes = joints.get(f"{side}Hand"), _HAND_SIZES
    if wrist is None:
        return []
    rows: list[Capsule] = []
    for finger in FINGERS:
        chain = [(r, joints[r]) for s in _SEGMENTS if (r := f"{side}{finger}{s}") in joints]
        if not chain:
            continue
        thick, palm = _FINGER_RADII[finger] * height * thickness, sizes.palm_radius * height * thickness
        knuckle = rest[chain[0][1]] - rest[wrist]
        wider = sizes.thumb_knuckle_radius if finger == "Thumb" else sizes.knuckle_radius
        ends, radii = (sizes.palm_start * knuckle, knuckle), (palm, thick * wider)
        rows.append(Capsule(f"{side}{finger}Palm", wrist, *ends, *radii, "palm", side))
        for n, (role, joint) in enumerate(chain):
            is_last, taper = n + 1 == len(chain), sizes.phalanx_radius - sizes.phalanx_taper * n
            after = chain[min(n + 1, len(chain) - 1)][1]
            bone = _tip(skeleton, joint, [j for _, j in chain], rest) if is_last else rest[after] - rest[joint]
            part = finger + "Tip" if is_last else finger
            radii = thick * taper, thick * (taper - sizes.phalanx_taper)
            rows.append(Capsule(role, joint, np.zeros(3), bone, *radii, part, side))
    if not rows:  # no fingers: a mitten as long as a hand
        elbow = joints.get(f"{side}LowerArm")
        bone = rest[wrist] - rest[elbow] if elbow is not None else np.array([0.0, -1.0, 0.0])
        bone = bone / np.linalg.norm(bone) * sizes.mitten_length * height
        thick = height * thickness
        radii = sizes.mitten_start_radius * thick, sizes.mitten_end_radius * thick
        rows.append(Capsule(f"{side}Mitten", wrist, np.zeros(3), bone, *radii, "palm", side))
    return rows


def _tip(skeleton: Skeleton, joint: int, chain: list[int], rest: FloatArray) -> FloatArray:
    """Returns the end of a finger beyond its last joint: its end site or tip joint, else 0.8 of the phalanx before,
    straight on.
    """
    sites = [site.offset for site in skeleton.end_sites if site.joint == joint]
    sites += [skeleton.offsets[child] for child in skeleton.children[joint]]
    before = rest[joint] - rest[chain[-2]] if len(chain) > 1 else rest[joint] - rest[skeleton.parents[joint]]
    usual = float(np.linalg.norm(before))
    for bone in sites:
        if _HAND_SIZES.shortest_tip * usual < np.linalg.norm(bone) < _HAND_SIZES.longest_tip * usual:
            return bone
    return np.asarray(_HAND_SIZES.usual_tip * before)


ARM = ("sleeve", "cuff")
"""Parts of an arm: upper arm and forearm."""
# Limbs: role of the bone, role at its end, radii at both ends as fractions of stature, part.
_LIMBS = (
    ("UpperArm", "LowerArm", 0.031, 0.024, "sleeve"),
    ("LowerArm", "Hand", 0.024, 0.0165, "cuff"),
    ("UpperLeg", "LowerLeg", 0.052, 0.036, "leg"),
    ("LowerLeg", "Foot", 0.036, 0.024, "leg"),
    ("Foot", "Toes", 0.024, 0.020, "shoe"),
)

# The head about its joint in the T-pose: left, up, forward of both ends, radii; all fractions of stature.
_HEAD = (
    ("face", (0.0, 0.030, 0.018), (0.0, 0.070, 0.016), 0.040, 0.051),
    ("face", (0.0, 0.006, 0.032), (0.0, 0.030, 0.026), 0.024, 0.040),
    ("nose", (0.0, 0.052, 0.068), (0.0, 0.038, 0.073), 0.0055, 0.0085),
    ("hair", (0.0, 0.080, -0.004), (0.0, 0.048, -0.016), 0.054, 0.051),
    ("eye", (0.0195, 0.061, 0.0585), (0.0195, 0.061, 0.0585), 0.0065, 0.0065),
    ("eye", (-0.0195, 0.061, 0.0585), (-0.0195, 0.061, 0.0585), 0.0065, 0.0065),
    ("mouth", (0.0125, 0.0178, 0.0570), (0.0, 0.0170, 0.0600), 0.0036, 0.0046),
    ("mouth", (-0.0125, 0.0178, 0.0570), (0.0, 0.0170, 0.0600), 0.0036, 0.0046),
)


@dataclass(frozen=True)
class BodyShape:
    """Factors on the usual proportions of a body of its stature; 1 is usual.

    head: size of head and neck.
    trunk_width: width of chest, waist and hips.
    trunk_depth: thickness of chest, belly and hips.
    limbs: thickness of arms and legs.
    hands: thickness of palms and fingers.
    """

    head: float = 1.0
    trunk_width: float = 1.0
    trunk_depth: float = 1.0
    limbs: float = 1.0
    hands: float = 1.0


@dataclass(frozen=True)
class CapsuleGroups:
    """Indices of a body's capsules by region.

    left, right: the hands.
    head: head and neck.
    trunk: trunk and shoulders.
    left_arm, right_arm: upper arms and forearms.
    below_arms: the trunk without shoulders and collar.
    """

    left: tuple[int, ...]
    right: tuple[int, ...]
    head: tuple[int, ...]
    trunk: tuple[int, ...]
    left_arm: tuple[int, ...]
    right_arm: tuple[int, ...]
    below_arms: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class BodyCapsules(HasDerived):
    """C tapered capsules, each fixed to a joint.

    joints: (C,) joint that carries each.
    starts, ends: (C, 3) the axis in that joint's frame, clip units.
    radii: (C, 2) at start and end, clip units.
    parts: kind of each ("face", "sleeve", "Index", ...).
    sides: "left", "right" or "".
    keys: name of each, the same on every body ("leftIndexProximal", "chest1", ...).
    skin: points of skin that follow the joints; None without a mesh.
    guessed_regions: regions that hands touch (``contacts.REGIONS``) of an avatar whose skin there cannot be read.
    """

    joints: NDArray[np.intp]
    starts: FloatArray
    ends: FloatArray
    radii: FloatArray
    parts: tuple[str, ...]
    sides: tuple[str, ...]
    keys: tuple[str, ...]
    skin: AvatarSkin | None = None
    guessed_regions: frozenset[str] = frozenset()

    @cached_property
    def groups(self) -> CapsuleGroups:
        """The hands, and the regions that they must not enter."""
        parts = list(enumerate(zip(self.parts, self.sides, strict=True)))
        left_hand, right_hand = (
            tuple(n for n, (part, s) in parts if s == side and part not in (*ARM, "leg", "shoe")) for side in SIDES
        )
        left_arm, right_arm = (tuple(n for n, (part, s) in parts if s == side and part in ARM) for side in SIDES)
        return CapsuleGroups(
            left_hand,
            right_hand,
            head=tuple(n for n, (part, _) in parts if part in ("face", "hair", "nose", "neck")),
            trunk=(trunk := tuple(n for n, (part, _) in parts if part == "shirt")),
            left_arm=left_arm,
            right_arm=right_arm,
            below_arms=tuple(
                n for n in trunk if not self.keys[n].endswith("Shoulder") and "collar" not in self.keys[n]
            ),
        )


@dataclass(frozen=True, eq=False)
class Avatar(Skeleton):
    """The skeleton of an avatar, in metres, with its own skin, in the rest pose of its file.

    label: the file's name without folder and suffix.
    body: its capsules, fitted to its mesh; None: capsules of usual proportions.
    mesh: its mesh in the rest pose; empty if the file holds none.
    is_vrm: whether its rest pose is the T-pose from which VRM animations rotate its bones.
    warnings: facts that a user should know about it, one line each.
    file: its file, into which exports write its motion; None without a file.
    """

    label: str = "the avatar"
    body: BodyCapsules | None = None
    mesh: tuple[MeshPart, ...] = ()
    is_vrm: bool = False
    warnings: tuple[str, ...] = ()
    file: AvatarFile | None = None


def body_capsules(skeleton: Skeleton) -> BodyCapsules:
    """Returns the body of a skeleton, cached for its lifetime: an avatar's own, else one from roles and size; a thin
    capsule for every bone if no arm is known.
    """
    if isinstance(skeleton, Avatar) and skeleton.body is not None:
        return skeleton.body
    return skeleton.derived[_build]


def capsule_ends(
    body: BodyCapsules, global_rotations: FloatArray, global_positions: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Returns both ends (T, C, 3) of each capsule in the world, from the globals (T, J, 3, 3) and (T, J, 3) of forward
    kinematics.
    """
    rotations, positions = global_rotations[:, body.joints], global_positions[:, body.joints]
    starts = positions + np.einsum("tcab,cb->tca", rotations, body.starts)
    return starts, positions + np.einsum("tcab,cb->tca", rotations, body.ends)


def build_capsules(skeleton: Skeleton, shape: BodyShape) -> BodyCapsules:
    """Returns the body of a skeleton with known arms, in a given shape."""
    info = rig_info(skeleton)
    joints, rest, height = info.roles.joints, rest_positions(skeleton), info.sizes.stature
    rows = _trunk(skeleton, height, shape)
    for side in SIDES:
        for start, end, r0, r1, part in _LIMBS:
            if side + start in joints and side + end in joints:
                a, b = joints[side + start], joints[side + end]
                thick = height * shape.limbs
                rows.append(
                    Capsule(side + start, a, np.zeros(3), rest[b] - rest[a], r0 * thick, r1 * thick, part, side)
                )
        rows += hand_capsules(skeleton, joints, rest, side, height, shape.hands)
    return _body(rows)


def _build(skeleton: Skeleton) -> BodyCapsules:
    if not any(role.endswith("UpperArm") for role in rig_info(skeleton).roles.joints):
        return _sticks(skeleton)
    return build_capsules(skeleton, BodyShape())


def _body(rows: list[Capsule]) -> BodyCapsules:
    return BodyCapsules(
        joints=np.array([row.joint for row in rows], np.intp),
        starts=np.array([row.start for row in rows]),
        ends=np.array([row.end for row in rows]),
        radii=np.array([(row.start_radius, row.end_radius) for row in rows]),
        parts=tuple(row.part for row in rows),
        sides=tuple(row.side for row in rows),
        keys=tuple(row.key for row in rows),
    )


def _sticks(skeleton: Skeleton) -> BodyCapsules:
    """Returns a capsule for every bone, a tenth of its length in radius; a ball for a skeleton of one joint."""
    rows: list[Capsule] = []
    for joint in range(1, len(skeleton)):
        length = float(np.linalg.norm(skeleton.offsets[joint]))
        if length > 0.0:
            parent = int(skeleton.parents[joint])
            name, bone = skeleton.names[joint], skeleton.offsets[joint]
            rows.append(Capsule(name, parent, np.zeros(3), bone, 0.1 * length, 0.07 * length, "sleeve"))
    return _body(rows or [Capsule(skeleton.names[0], 0, np.zeros(3), np.zeros(3), 1.0, 1.0, "sleeve")])


def _trunk(skeleton: Skeleton, height: float, shape: BodyShape) -> list[Capsule]:
    """Returns chest, belly, pelvis, shoulders, neck and head, measured in the T-pose (left +X, up +Y, forward +Z)."""
    info = rig_info(skeleton)
    joints, positions = info.roles.joints, info.t_pose.positions
    left, up, _ = np.eye(3) * height
    rows: list[Capsule] = []
    big, wide, deep = shape.head, shape.trunk_width, shape.trunk_depth
    sizes = TRUNK_SIZES

    def add(key: str, joint: int, start: FloatArray, end: FloatArray, r0: float, r1: float, part: str) -> None:
        """Adds a capsule with both ends relative to the joint, in the axes of the T-pose."""
        start, end = rotation.rotate(rotation.inverse(info.t_pose.rotations[joint]), np.stack([start, end]))
        rows.append(Capsule(key, joint, start, end, r0 * height, r1 * height, part))

    chest = next((joints[r] for r in ("upperChest", "chest", "spine", "hips") if r in joints), 0)
    low = next((joints[r] for r in ("spine", "chest", "hips") if r in joints), 0)
    hips = joints.get("hips", 0)
    if "head" in joints:
        for n, (part, a, b, r0, r1) in enumerate(_HEAD):
            ends = big * height * np.array(a), big * height * np.array(b)
            add(f"head{n}", joints["head"], *ends, big * r0, big * r1, part)
    if "head" in joints and "neck" in joints:
        neck = joints["neck"]
        nape = positions[joints["head"]] - positions[neck] + sizes.neck_overlap * up
        low_radius, high_radius = sizes.neck_radii
        add("neck", neck, -sizes.neck_overlap * up, nape, low_radius * big, high_radius * big, "neck")
    rows += _shoulders(skeleton, height, shape)
    girdle = [positions[joints[s + "UpperArm"]] - positions[chest] for s in SIDES if s + "UpperArm" in joints]
    if len(girdle) == 2:
        middle, waist = np.mean(girdle, axis=0), positions[low] - positions[chest]
        for n, (x, r) in enumerate(sizes.columns):
            start = middle - sizes.column_drop * up + wide * x * left
            end = waist + sizes.waist_width * wide * x * left
            add(f"chest{n}", chest, start, end, r * deep, sizes.waist_thickness * r * deep, "shirt")
        if "neck" in joints:
            nape = positions[joints["neck"]] - positions[chest]
            high_radius, low_radius = sizes.back_radii
            add("back", chest, nape - sizes.back_drop * up, waist, high_radius * deep, low_radius * deep, "shirt")
            for n, shoulder in enumerate(girdle):
                end = sizes.collar_to_shoulder * shoulder + sizes.collar_to_middle * middle - sizes.collar_drop * up
                add(f"collar{n}", chest, nape, end, *sizes.collar_radii, "shirt")
    hem = -sizes.hem_drop * up
    for n, (x, r) in enumerate(sizes.columns):
        start = positions[low] - positions[hips] + sizes.waist_width * wide * x * left
        end = hem + sizes.hem_width * wide * x * left
        add(f"belly{n}", hips, start, end, sizes.waist_thickness * r * deep, sizes.hem_radius * deep, "shirt")
    sides = [positions[joints[s + "UpperLeg"]] - positions[hips] for s in SIDES if s + "UpperLeg" in joints]
    if len(sides) == 2:
        start, end = (hem + sizes.hip_reach * side for side in sides)
        add("hips", hips, start, end, sizes.hip_radius * deep, sizes.hip_radius * deep, "shirt")
    return rows


def _shoulders(skeleton: Skeleton, height: float, shape: BodyShape) -> list[Capsule]:
    """Returns capsules from chest to arms: along the collar bones, which move, or straight across without these."""
    joints, rest = rig_info(skeleton).roles.joints, rest_positions(skeleton)
    rows: list[Capsule] = []
    for side in SIDES:
        if f"{side}UpperArm" not in joints:
            continue
        arm = joints[f"{side}UpperArm"]
        collar = joints.get(f"{side}Shoulder", int(skeleton.parents[arm]))
        bone, thick = rest[arm] - rest[collar], height * shape.limbs
        (low, high), (r0, r1) = TRUNK_SIZES.shoulder_span, TRUNK_SIZES.shoulder_radii
        rows.append(Capsule(f"{side}Shoulder", collar, low * bone, high * bone, r0 * thick, r1 * thick, "shirt"))
    return rows
