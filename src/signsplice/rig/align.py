"""Aligns clips of different rigs, units, rates and positions to the first clip of a sentence.

On rigs with the same names, local rotations are copied joint by joint. Rigs with the same bones and other axes use the
axes that follow from the bones (``rest_pose.axes_on_one_body``). Other rigs use the roles of the canonical humanoid,
through global rotations relative to the T-pose. So every bone keeps its direction. Then each clip is moved and turned
about the vertical as a rigid whole, so that its signer stands in the place of the first one.

"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from signsplice.errors import RigMismatchError
from signsplice.motion import Clip, FloatArray, Skeleton, at_frames, copy_unchecked, kinematics, resample, rotation
from signsplice.motion.kinematics import forward, global_quats, path_to_root, rest_positions
from signsplice.motion.points import Framing, PointLayout
from signsplice.rig.info import rig_info
from signsplice.rig.rest_pose import IDENTICAL, axes_on_one_body, bones_apart, size_ratio
from signsplice.rig.roles import ARM, SIDES, body_parts, find_lost_roles

_SAMPLES = 24
"""Number of evenly spread frames that determine a placement."""
_BODY = (
    "hips",
    "head",
    "neck",
    "leftUpperArm",
    "rightUpperArm",
    "leftUpperLeg",
    "rightUpperLeg",
    "leftFoot",
    "rightFoot",
)
"""Roles of the joints that determine a placement, besides the root."""


@dataclass(frozen=True, eq=False)
class Placement:
    """The place and orientation of a signer, in world coordinates.

    position: (3,) the middle between the joints of the feet (the root without feet), clip units.
    up: (3,) unit vector.
    forward: (3,) unit vector, the facing, at right angles to ``up``.
    """

    position: FloatArray
    up: FloatArray
    forward: FloatArray


ORIGIN = Placement(np.zeros(3), np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0]))
"""The feet at the origin, up +Y, facing +Z: the placement of words of a corpus without given places."""


def placement(clip: Clip) -> Placement:
    """Returns the placement of the clip's signer: median position and mean facing of a few frames. Cached.

    Up is the world axis nearest to the direction from the hips to the head. Forward is at right angles to it and to
    the line of hips and shoulders. Skeletons without those roles stand at their root, up +Y, facing +Z (the usual axes
    of BVH).
    """
    return clip.derived[find_placement]


def place(clip: Clip, target: Placement) -> Clip:
    """Moves and turns the clip as a rigid whole, so that its signer stands at ``target``.

    Returns the clip itself if its signer already stands there. Otherwise ``Clip.source_clip`` of the result is the
    original clip: values that do not depend on the placement can be computed once for all placements.
    """
    current = placement(clip)
    if current is target:
        return clip
    is_upright = np.array_equal(current.up, target.up)  # as it is in one set of clips
    tilt = rotation.IDENTITY if is_upright else rotation.between_vectors(current.up, target.up)
    forward = current.forward if is_upright else rotation.rotate(tilt, current.forward)
    yaw = np.arctan2(rotation.cross(forward, target.forward) @ target.up, forward @ target.forward)
    turn = rotation.exp(yaw * target.up)
    if not is_upright:
        turn = rotation.multiply(turn, tilt)
    shift = target.position - rotation.rotate(turn, current.position)
    size = float(np.abs(clip.skeleton.offsets).max())
    if np.linalg.norm(rotation.log(turn)) < 1e-9 and np.linalg.norm(shift) < 1e-9 * size:
        return clip
    local = np.array(clip.local_rotations)
    local[:, 0] = rotation.normalize(rotation.multiply(turn, local[:, 0]))
    return copy_unchecked(
        clip,
        local_rotations=local,
        root_positions=rotation.rotate(turn, clip.root_positions) + shift,
        channels=None if clip.channels is None else clip.channels.without_root(),
        source_clip=clip.source_clip or clip,
    )


def find_placement(clip: Clip) -> Placement:
    """Finds where the clip's signer stands, for ``placement``."""
    joints = rig_info(clip.skeleton).roles.joints
    known = [role for role in _BODY if role in joints]
    n_frames = len(clip.local_rotations)
    n = min(_SAMPLES, n_frames)
    frames = np.round(np.arange(n) * ((n_frames - 1) / max(n - 1, 1))).astype(np.intp)
    _, positions = kinematics.forward(at_frames(clip, frames), [0, *(joints[role] for role in known)])  # (n, K, 3)
    points = {role: positions[:, k + 1] for k, role in enumerate(known)}
    root = positions[:, 0]
    up = _up_axis(points, root)
    forward = _forward(points, up)
    feet = [points[role] for role in ("leftFoot", "rightFoot") if role in points]
    return Placement(_median(np.sum(feet, axis=0) / len(feet) if feet else root), up, forward)


def _median(rows: FloatArray) -> FloatArray:
    """Returns the median (3,) of rows (T, 3); several times as fast as numpy's for few rows."""
    ordered, half = np.sort(rows, axis=0), len(rows) // 2
    return np.asarray(ordered[half] if len(rows) % 2 else 0.5 * (ordered[half - 1] + ordered[half]))


def _up_axis(at: dict[str, FloatArray], root: FloatArray) -> FloatArray:
    top = at.get("head", at.get("neck"))
    up = np.array([0.0, 1.0, 0.0])
    if top is None:
        return up
    trunk = np.mean(top - at.get("hips", root), axis=0)
    axis = int(np.argmax(np.abs(trunk)))
    return np.sign(trunk[axis]) * np.eye(3)[axis] if trunk[axis] != 0.0 else up


def _forward(at: dict[str, FloatArray], up: FloatArray) -> FloatArray:
    to_left = np.zeros(3)
    for pair in (("leftUpperArm", "rightUpperArm"), ("leftUpperLeg", "rightUpperLeg")):
        if pair[0] in at and pair[1] in at:
            line = at[pair[0]] - at[pair[1]]
            to_left += np.mean(line / np.maximum(np.linalg.norm(line, axis=-1, keepdims=True), 1e-12), axis=0)
    forward = rotation.cross(to_left, up)
    length = np.linalg.norm(forward)
    if length > 1e-6:
        return np.asarray(forward / length)
    return np.array([0.0, 0.0, 1.0]) if abs(up[2]) < 0.5 else np.array([0.0, -1.0, 0.0])


SAME_DIRECTION_DEG = 20.0
"""Largest angle between rest bones of the same rig, degrees; local rotations are then comparable."""
SAME_ARM_DEG = 6.0
"""The same for rest bones of arms, hands and fingers: 6 degrees at the shoulder are 5 cm at the wrist."""

MIN_COMMON_ROLES = 5
"""Least number of common roles of two rigs that can be aligned."""
_STILL_DEG = 1.0
"""Largest rotation of a joint that shows nothing, degrees: the rounding and trembling of a joint that nobody moved."""


@dataclass(frozen=True, eq=False)
class Reference:
    """The properties of the first clip to which every clip of a sentence is aligned.

    skeleton: its skeleton.
    fps: the output frame rate.
    placement: placement of its signer.
    held_pose: (J, 4) local rotations that joints without a counterpart hold.
    name: its name, for messages.
    face_roles: roles of joints that a face moves, not a clip's joints: that they hold their pose is no loss.
    landmarks: their layout and framing; None without any.
    """

    skeleton: Skeleton
    fps: float
    placement: Placement
    held_pose: FloatArray
    name: str
    face_roles: tuple[str, ...] = ()
    landmarks: tuple[PointLayout, Framing] | None = None


def reference(first: Clip, fps: float | None = None) -> Reference:
    """Returns the reference set by the first clip of a sentence; ``fps``: output rate, by default that of the clip."""
    landmarks = None if first.points is None else (first.points.layout, first.points.framing)
    pose = first.local_rotations[0]
    return Reference(first.skeleton, fps or first.fps, placement(first), pose, first.name, landmarks=landmarks)


def settle(carried: Clip, to: Reference) -> Clip:
    """Brings a clip that is on the skeleton of a reference to that reference's position, facing, framing and rate."""
    placed = place(carried, to.placement)
    points = placed.points
    if points is not None and to.landmarks is not None and (points.layout, points.framing) != to.landmarks:
        source_clip = placed.source_clip or placed
        placed = copy_unchecked(placed, points=points.reframe(*to.landmarks), source_clip=source_clip)
    return resample(placed, to.fps)


def copy_rotations(clip: Clip, to: Reference, by_role: bool = False) -> tuple[Clip, tuple[str, ...], bool]:
    """Transfers the clip to the reference's skeleton. Returns the clip; warnings about joints of either that have no
    counterpart (the clip's lose their motion, the reference's hold their pose), and about joint axes that its rest pose
    does not show; and whether both skeletons are one body.

    Bones keep their directions, the clip its place, and rotations that need no change their exact numbers. On another
    body hands lose places and contacts, which ``body.retarget`` keeps. Raises ``RigMismatchError`` if joints match
    neither by name nor by role: fewer than ``MIN_COMMON_ROLES`` roles, or no upper arm, in common.

    by_role: whether to match joints by role even if names match: otherwise rest poses of one rig on two bodies that
        differ by some degrees count as equal.
    """
    source, target = clip.skeleton, to.skeleton
    if source is target or is_same_skeleton(source, target):
        return (clip if source is target else replace(clip, skeleton=target)), (), True
    named, body_match = None if by_role else _by_name(source, target), None
    is_copied = named is not None and _rest_alike(source, target, named)
    is_one_body = named is not None and is_copied and bones_apart(source, target, named) < IDENTICAL
    if named is not None and not is_one_body:
        body_match = axes_on_one_body(clip, target, to.name, named)
    counterpart = named if named is not None and (is_copied or body_match) else _by_role(clip, to)
    if named is None and not by_role:
        body_match = axes_on_one_body(clip, target, to.name, counterpart)
    t_poses: tuple[FloatArray, FloatArray] | tuple[()] = ()
    if body_match is not None:
        t_poses = body_match.poses
    elif not is_copied:
        t_poses = rig_info(source).t_pose.rotations, rig_info(target).t_pose.rotations
    local = _transfer(clip, target, counterpart, to.held_pose, *t_poses)
    scale = size_ratio(source, target, counterpart)
    if body_match is None and not is_copied and (theirs := rig_info(source).sizes.stature) > 0.0:
        scale = rig_info(target).sizes.stature / theirs
    warnings = (*(() if body_match is None else body_match.warnings), *_counterpart_warnings(clip, to, counterpart))
    # The file's Euler angles describe another rig's rotations: they are not carried over.
    carried = Clip(target, local, clip.root_positions * scale, clip.fps, clip.name, face=clip.face)
    hips = rig_info(target).roles.joints.get("hips", 0)
    if hips in counterpart and (hips > 0 or counterpart[hips] > 0):
        # Where a rig has a joint above the hips, match the path of the hips, not of the root.
        hips_path = scale * forward(clip, [counterpart[hips]])[1][:, 0]
        shift = hips_path - forward(carried, [hips])[1][:, 0]
        carried = replace(carried, root_positions=carried.root_positions + shift)
    return carried, warnings, is_one_body or body_match is not None


def _counterpart_warnings(clip: Clip, to: Reference, counterpart: Mapping[int, int]) -> list[str]:
    """Returns lines about joints of a clip, and of the reference, without a counterpart; ``counterpart``: joint of the
    reference -> joint of the clip. Without a role, joints of the clip count if they move, and no joint that is carried.
    """
    source, target, moving = (
        rig_info(clip.skeleton).roles,
        rig_info(to.skeleton).roles,
        clip.derived[find_moving_joints],
    )
    kept = {source.role_of.get(joint, "") for joint in counterpart.values()}
    carried = {*source.role_of}.union(*(path_to_root(clip.skeleton, joint) for joint in counterpart.values()))
    lost = [source.joints[role] for role in find_lost_roles(source.joints, kept, moving)] + sorted(moving - carried)
    carried_roles = {target.role_of.get(joint, "") for joint in counterpart}
    without = {*find_lost_roles(target.joints, carried_roles, range(len(to.skeleton)))}.difference(to.face_roles)
    held = [
        joint
        for joint in range(len(to.skeleton))
        if joint not in counterpart  # a joint without role and children moves nothing
        and (target.role_of[joint] in without if joint in target.role_of else to.skeleton.children[joint])
    ]
    lines = (
        (clip.skeleton, lost, f"{len(lost)} joints have no counterpart on {to.name}, their motion is lost"),
        (to.skeleton, held, f"no counterpart for {len(held)} joints of {to.name}, which hold their pose"),
    )
    return [f"{clip.name}: {line}: {_describe_joints(rig, joints)}" for rig, joints, line in lines if joints]


def _describe_joints(skeleton: Skeleton, joints: Collection[int]) -> str:
    """Returns the parts of the body that joints belong to, and the names of those without a role, for a message."""
    role_of = rig_info(skeleton).roles.role_of
    others = list_names([skeleton.names[joint] for joint in joints if joint not in role_of])
    return ", ".join(filter(None, [*body_parts(role_of[j] for j in joints if j in role_of), others]))


def list_names(names: Sequence[str], most: int = 6) -> str:
    """Returns names for a message, the first ``most`` of them and the number of others."""
    n_more = len(names) - most
    return ", ".join(names[:most]) + (f" and {n_more} more" if n_more > 0 else "")


def find_moving_joints(clip: Clip) -> frozenset[int]:
    """Returns the joints that turn away from their rotation in the first frame."""
    angles = rotation.angle_between(clip.local_rotations, clip.local_rotations[0]).max(axis=0)
    return frozenset(np.flatnonzero(angles > np.deg2rad(_STILL_DEG)).tolist())


def choose_skeleton(clips: Sequence[Clip]) -> tuple[int, str]:
    """Returns the index of the clip on whose skeleton fewest parts of the body, and of these fewest joints, of all
    clips lose their motion, the first of equals, and the reason, empty for the first clip. A skeleton that clips cannot
    be aligned to by their roles is passed over.
    """
    roles = [frozenset(rig_info(clip.skeleton).roles.joints) for clip in clips]
    if len({*roles}) == 1:
        return 0, ""
    lost_on: dict[int, list[str]] = {}
    for k, kept in enumerate(roles):
        if kept not in roles[:k] and (k == 0 or all(_is_enough(kept & own) for own in roles)):
            rigs = [(rig_info(clip.skeleton).roles.joints, clip.derived[find_moving_joints]) for clip in clips]
            lost_on[k] = [role for joints, moving in rigs for role in find_lost_roles(joints, kept, moving)]
    best = min(
        lost_on, key=lambda k: (len({part for role in lost_on[k] for part in body_parts([role])}), len(lost_on[k]))
    )
    why = f"on that of {clips[0].name} {', '.join(body_parts(lost_on[0]))} would lose their motion"
    why += f", on this one {', '.join(body_parts(lost_on[best])) or 'nothing'}"
    return best, why if best else ""


def _is_enough(common: Collection[str]) -> bool:
    """Whether two rigs can be aligned by the roles that both have."""
    return len(common) >= MIN_COMMON_ROLES and any(role.endswith("UpperArm") for role in common)


def is_same_skeleton(a: Skeleton, b: Skeleton) -> bool:
    """Whether two skeletons differ by no more than the rounding of their files."""
    if a.names != b.names or not np.array_equal(a.parents, b.parents):
        return False
    if np.array_equal(a.offsets[1:], b.offsets[1:]):  # as it is within one lexicon
        return True
    return np.allclose(a.offsets[1:], b.offsets[1:], rtol=1e-6, atol=1e-9 * max(1.0, float(np.abs(b.offsets).max())))


def _by_name(source: Skeleton, target: Skeleton) -> dict[int, int] | None:
    """Maps target joints to source joints by name; None if under half of the smaller one's names are common, or if
    the names of arms differ in meaning: a shoulder is the collar bone of one rig, the upper arm of another. Joints of
    other names, such as fingers, are matched by role.
    """
    ours, theirs = rig_info(target), rig_info(source)
    index = {name: j for j, name in enumerate(theirs.simple_names)}
    pairs = {j: index[name] for j, name in enumerate(ours.simple_names) if name in index}
    arms = [side + part for side in SIDES for part in ARM if side + part in theirs.roles.joints]
    if any(
        pairs.get(joint) != theirs.roles.joints[role] for role in arms if (joint := ours.roles.joint(role)) is not None
    ):
        return None
    if len(pairs) < 0.5 * min(len(source), len(target)):
        return None
    named = {*pairs.values()}
    others = {j: theirs.roles.joints.get(role, -1) for role, j in ours.roles.joints.items() if j not in pairs}
    return pairs | {joint: other for joint, other in others.items() if other >= 0 and other not in named}


def _rest_alike(source: Skeleton, target: Skeleton, pairs: Mapping[int, int]) -> bool:
    """Whether two skeletons share a rig: with all rotations at identity their bones have the same directions."""
    rest_source, rest_target = rest_positions(source), rest_positions(target)
    role_of = rig_info(target).roles.role_of
    agree = total = 0
    for joint, source_joint in pairs.items():
        parent = int(target.parents[joint])
        if parent not in pairs:
            continue
        a, b = rest_target[joint] - rest_target[parent], rest_source[source_joint] - rest_source[pairs[parent]]
        length = float(np.linalg.norm(a) * np.linalg.norm(b))
        if length > 0.0:
            total += 1
            agree += bool(a @ b >= np.cos(np.deg2rad(SAME_DIRECTION_DEG)) * length)
            if _is_of_arm(role_of.get(parent, "")) and a @ b < np.cos(np.deg2rad(SAME_ARM_DEG)) * length:
                return False
    return bool(total and agree >= 0.9 * total)


def _is_of_arm(role: str) -> bool:
    return role.endswith(("UpperArm", "LowerArm", "Hand", "Metacarpal", "Proximal", "Intermediate"))


def _by_role(clip: Clip, to: Reference) -> dict[int, int]:
    """Maps target joints to source joints by the roles that both rigs have."""
    ours, theirs = rig_info(to.skeleton).roles, rig_info(clip.skeleton).roles
    common = [role for role in ours.joints if role in theirs.joints]
    if not _is_enough(common):
        raise RigMismatchError(
            f"{clip.name} (rig {theirs.rig}: {_first_names(clip.skeleton)}) and "
            f"{to.name} (rig {ours.rig}: {_first_names(to.skeleton)}) have "
            f"{len(common)} body parts in common, expected arms and trunk; name the joints' roles in a roles file"
        )
    return {ours.joints[role]: theirs.joints[role] for role in common}


def _first_names(skeleton: Skeleton) -> str:
    return ", ".join(skeleton.names[:3]) + (", ..." if len(skeleton) > 3 else "")


def _transfer(
    clip: Clip,
    target: Skeleton,
    counterpart: Mapping[int, int],
    held_pose: FloatArray,
    source_t_pose: FloatArray | None = None,
    target_t_pose: FloatArray | None = None,
) -> FloatArray:
    """Returns local rotations (T, J, 4) on ``target`` that give each joint the global rotation of its counterpart.

    ``*_t_pose``: (J, 4) global rotations that bring each rest skeleton into the T-pose; identity by default. Without
    T-poses, a joint whose parent's counterpart is its counterpart's parent keeps its local rotations bit for bit.
    """
    source = clip.skeleton
    plain = source_t_pose is None or target_t_pose is None
    source_globals = global_quats(source, clip.local_rotations)
    local = np.empty((len(clip), len(target), 4))
    globals_: list[FloatArray] = []
    for joint in range(len(target)):
        parent = int(target.parents[joint])
        parent_rotations = globals_[parent] if parent >= 0 else np.broadcast_to(rotation.IDENTITY, (len(clip), 4))
        source_joint = counterpart.get(joint)
        if source_joint is None:
            local[:, joint] = held_pose[joint]
            globals_.append(rotation.multiply(parent_rotations, held_pose[joint]))
            continue
        goal = source_globals[:, source_joint]
        if source_t_pose is not None and target_t_pose is not None:
            change = rotation.multiply(rotation.inverse(source_t_pose[source_joint]), target_t_pose[joint])
            goal = rotation.multiply(goal, change)
        source_parent = int(source.parents[source_joint])
        if plain and (parent < 0) == (source_parent < 0) and counterpart.get(parent, -1) == source_parent:
            local[:, joint] = clip.local_rotations[:, source_joint]
        else:
            local[:, joint] = rotation.normalize(rotation.multiply(rotation.inverse(parent_rotations), goal))
        globals_.append(goal)
    return local
