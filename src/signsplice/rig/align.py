"""Clips of different rigs, units, rates and places brought onto the first one's ground.

Same rig by names: rotations are carried over joint by joint. Different rigs: by the roles of the canonical humanoid,
through global rotations relative to a common pose, so that bones point the way they pointed before. Then each clip is
moved and turned about the vertical as one rigid whole, so that its signer stands where the first one stands.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from signsplice.errors import RigMismatchError
from signsplice.motion import rotation
from signsplice.motion.clip import Clip, Skeleton, resample, unchecked_copy
from signsplice.motion.kinematics import forward, rest_positions
from signsplice.rig.proportions import Placement, stand, stature
from signsplice.rig.roles import find_roles, simplify
from signsplice.rig.t_pose import t_pose_rotations

Float = NDArray[np.float64]

SAME_DIRECTION_DEG = 20.0
"""Rest bones that point within this angle of one another count as one rig's; local rotations then mean the same."""
SAME_ARM_DEG = 6.0
"""So near the rest bones of arms, hands and fingers must be: 6 degrees at the shoulder are 5 cm at the wrist."""

MIN_COMMON_ROLES = 5


@dataclass(frozen=True, eq=False)
class Reference:
    """What every clip of a sentence is brought onto: the first clip's skeleton, rate, place and facing, and the pose
    that joints without a counterpart hold (J, 4). name: the first clip's, for messages.
    """

    skeleton: Skeleton
    fps: float
    placement: Placement
    held_pose: Float
    name: str


@dataclass(frozen=True, eq=False)
class AlignedClip:
    """A clip on the ground of another, and what had to be said about it, a line each."""

    clip: Clip
    warnings: tuple[str, ...]


def reference(first: Clip, fps: float | None = None) -> Reference:
    """The ground that ``first`` lays for the clips that follow it; ``fps`` where another rate than its own is
    wanted.
    """
    return Reference(first.skeleton, fps or first.fps, stand(first), first.local_rotations[0], first.name)


def align(clip: Clip, onto: Reference, speed: float = 1.0) -> AlignedClip:
    """``clip`` on another clip's ground: its skeleton, rate, place and facing; played ``speed`` times as fast.

    What needs no change keeps its very numbers. Joints of the ground's skeleton that have no counterpart hold their
    pose, which one warning says. Raises ``RigMismatchError`` where the two rigs have nothing in common.
    """
    carried, warnings = _retarget_rotations(clip, onto)
    moved = place(carried, onto.placement)
    return AlignedClip(resample(moved, onto.fps, speed), warnings)


def _retarget_rotations(clip: Clip, onto: Reference) -> tuple[Clip, tuple[str, ...]]:
    """The clip on the ground's skeleton, and the warning about joints that hold their pose."""
    source, target = clip.skeleton, onto.skeleton
    if source is target or _identical(source, target):
        return (clip if source is target else replace(clip, skeleton=target)), ()
    counterpart = _by_name(source, target)
    if counterpart is not None:
        local = _transfer(clip, target, counterpart, onto.held_pose)
        scale = _size_ratio(source, target, counterpart)
    else:
        counterpart = _by_role(clip, onto)
        local = _transfer(clip, target, counterpart, onto.held_pose, t_pose_rotations(source), t_pose_rotations(target))
        scale = stature(target) / stature(source) if stature(source) > 0.0 else 1.0
    held = [target.names[j] for j in range(len(target)) if j not in counterpart]
    warnings: tuple[str, ...] = ()
    if held:
        shown = ", ".join(held[:6]) + (f" and {len(held) - 6} more" if len(held) > 6 else "")
        warnings = (
            f"{clip.name}: no counterpart for {len(held)} joints of {onto.name}, which hold their pose: {shown}",
        )
    # Euler numbers meant another rig's rotations: they are not carried.
    carried = Clip(target, local, clip.root_positions * scale, clip.fps, clip.name)
    hips = find_roles(target).joints.get("hips", 0)
    if hips in counterpart and (hips > 0 or counterpart[hips] > 0):
        # A joint above the hips, in either rig: what has to go the same way is the hips, not the root.
        wanted = scale * forward(clip, [counterpart[hips]])[1][:, 0]
        shift = wanted - forward(carried, [hips])[1][:, 0]
        carried = replace(carried, root_positions=carried.root_positions + shift)
    return carried, warnings


def _identical(a: Skeleton, b: Skeleton) -> bool:
    return (
        a.names == b.names
        and np.array_equal(a.parents, b.parents)
        and np.allclose(a.offsets[1:], b.offsets[1:], rtol=1e-6, atol=1e-9 * max(1.0, float(np.abs(b.offsets).max())))
    )


def _by_name(source: Skeleton, target: Skeleton) -> dict[int, int] | None:
    """Target joint -> source joint for two skeletons of one rig, None where they are not."""
    index = {simplify(name): j for j, name in enumerate(source.names)}
    pairs = {j: index[simplify(name)] for j, name in enumerate(target.names) if simplify(name) in index}
    if len(pairs) < 0.5 * min(len(source), len(target)):
        return None
    rest_source, rest_target = rest_positions(source), rest_positions(target)
    role_of = find_roles(target).role_of
    agree = total = 0
    for joint, other in pairs.items():
        parent = int(target.parents[joint])
        if parent not in pairs:
            continue
        a, b = rest_target[joint] - rest_target[parent], rest_source[other] - rest_source[pairs[parent]]
        length = float(np.linalg.norm(a) * np.linalg.norm(b))
        if length > 0.0:
            total += 1
            agree += bool(a @ b >= np.cos(np.deg2rad(SAME_DIRECTION_DEG)) * length)
            if _carries_a_hand(role_of.get(parent, "")) and a @ b < np.cos(np.deg2rad(SAME_ARM_DEG)) * length:
                return None
    return pairs if total and agree >= 0.9 * total else None


def _carries_a_hand(role: str) -> bool:
    return role.endswith(("UpperArm", "LowerArm", "Hand", "Metacarpal", "Proximal", "Intermediate"))


def _by_role(clip: Clip, onto: Reference) -> dict[int, int]:
    """Target joint -> source joint through the roles that both rigs have."""
    ours, theirs = find_roles(onto.skeleton), find_roles(clip.skeleton)
    common = [role for role in ours.joints if role in theirs.joints]
    if len(common) < MIN_COMMON_ROLES or not any(role.endswith("UpperArm") for role in common):
        raise RigMismatchError(
            f"{clip.name} (rig {theirs.rig}: {_some(clip.skeleton)}) and "
            f"{onto.name} (rig {ours.rig}: {_some(onto.skeleton)}) have "
            f"{len(common)} body parts in common, expected arms and trunk; name the joints' roles in a roles file"
        )
    return {ours.joints[role]: theirs.joints[role] for role in common}


def _some(skeleton: Skeleton) -> str:
    return ", ".join(skeleton.names[:3]) + (", ..." if len(skeleton) > 3 else "")


def _size_ratio(source: Skeleton, target: Skeleton, pairs: Mapping[int, int]) -> float:
    """Median ratio of bone lengths target / source."""
    lengths = np.array(
        [
            (np.linalg.norm(target.offsets[j]), np.linalg.norm(source.offsets[k]))
            for j, k in pairs.items()
            if target.parents[j] >= 0 and pairs.get(int(target.parents[j])) == source.parents[k]
        ]
    )
    lengths = lengths[(lengths > 1e-9).all(axis=1)] if len(lengths) else lengths.reshape(0, 2)
    return float(np.median(lengths[:, 0] / lengths[:, 1])) if len(lengths) else 1.0


def _transfer(
    clip: Clip,
    target: Skeleton,
    counterpart: Mapping[int, int],
    held: Float,
    source_common: Float | None = None,
    target_common: Float | None = None,
) -> Float:
    """Local rotations (T, J, 4) on ``target`` that give each joint the global rotation of its counterpart.

    ``*_common``: (J, 4) global rotations that pose each rest skeleton in the common pose; identity by default. A joint
    whose parent's counterpart is its counterpart's parent keeps its local rotations bit for bit where no pose comes
    between.
    """
    source = clip.skeleton
    plain = source_common is None or target_common is None
    above_source = _global_rotations(clip)
    out = np.empty((len(clip), len(target), 4))
    above: list[Float] = []
    for joint in range(len(target)):
        parent = int(target.parents[joint])
        over = above[parent] if parent >= 0 else np.broadcast_to(rotation.IDENTITY, (len(clip), 4))
        other = counterpart.get(joint)
        if other is None:
            out[:, joint] = held[joint]
            above.append(rotation.multiply(over, held[joint]))
            continue
        wanted = above_source[other]
        if source_common is not None and target_common is not None:
            change = rotation.multiply(rotation.inverse(source_common[other]), target_common[joint])
            wanted = rotation.multiply(wanted, change)
        other_parent = int(source.parents[other])
        if plain and (parent < 0) == (other_parent < 0) and counterpart.get(parent, -1) == other_parent:
            out[:, joint] = clip.local_rotations[:, other]
        else:
            out[:, joint] = rotation.normalize(rotation.multiply(rotation.inverse(over), wanted))
        above.append(wanted)
    return out


def _global_rotations(clip: Clip) -> list[Float]:
    rotations: list[Float] = []
    for joint in range(len(clip.skeleton)):
        local = clip.local_rotations[:, joint]
        parent = clip.skeleton.parents[joint]
        rotations.append(local if parent < 0 else rotation.multiply(rotations[parent], local))
    return rotations


_SOURCES: WeakKeyDictionary[Clip, Clip] = WeakKeyDictionary()


def source_of(clip: Clip) -> Clip:
    """The clip that this one is moved from as one rigid whole, or itself: what does not ask where a signer stands need
    be told of it only once, wherever the word is signed.
    """
    return _SOURCES.get(clip, clip)


def place(clip: Clip, onto: Placement) -> Clip:
    """The clip moved and turned as one rigid whole, so that its signer stands as ``onto`` says."""
    own = stand(clip)
    if own is onto:
        return clip
    turn = rotation.between_vectors(own.up, onto.up)
    forward = rotation.rotate(turn, own.forward)
    yaw = np.arctan2(rotation.cross(forward, onto.forward) @ onto.up, forward @ onto.forward)
    turn = rotation.multiply(rotation.exp(yaw * onto.up), turn)
    shift = onto.position - rotation.rotate(turn, own.position)
    size = float(np.abs(clip.skeleton.offsets).max())
    if np.linalg.norm(rotation.log(turn)) < 1e-9 and np.linalg.norm(shift) < 1e-9 * size:
        return clip
    local = np.array(clip.local_rotations)
    local[:, 0] = rotation.normalize(rotation.multiply(turn, local[:, 0]))
    moved = unchecked_copy(
        clip,
        local_rotations=local,
        root_positions=rotation.rotate(turn, clip.root_positions) + shift,
        channels=None if clip.channels is None else clip.channels.without_root(),
    )
    _SOURCES[moved] = source_of(clip)
    return moved
