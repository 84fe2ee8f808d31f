"""Distorts a rig and keeps its motion: axes, rest poses, units, worlds, names, mirrors; for ``rigs.py``."""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import signsplice as ss

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))
from known_rigs import RIGS, skeleton_of

Floats = NDArray[np.float64]
Random = np.random.Generator

_MIRROR = np.diag([-1.0, 1.0, 1.0])
PREFIX = "mixamorig:"


@dataclass(frozen=True, eq=False)
class Motion:
    """A rig and its motion: J joints, T frames.

    names: of the joints, parents before children.
    parents: (J,) -1 for the root.
    offsets: (J, 3) from the parent, in its axes.
    sites: joint -> offset of its end site.
    rotations: (T, J, 3, 3) local.
    roots: (T, 3) positions of the root.
    """

    names: tuple[str, ...]
    parents: tuple[int, ...]
    offsets: Floats
    sites: dict[int, Floats]
    rotations: Floats
    roots: Floats


def extract_motion(clip: ss.Clip) -> Motion:
    """Returns the motion of a clip."""
    bones, quats = clip.skeleton, clip.local_rotations
    matrices = Rotation.from_quat(quats.reshape(-1, 4)).as_matrix().reshape(*quats.shape[:2], 3, 3)
    sites = {site.joint: site.offset for site in bones.end_sites}
    return Motion(bones.names, tuple(bones.parents.tolist()), bones.offsets, sites, matrices, clip.root_positions)


def compute_world(motion: Motion) -> tuple[Floats, Floats]:
    """Returns positions (T, J, 3) and rotations (T, J, 3, 3) of every joint in the world."""
    positions, rotations = np.empty(motion.rotations.shape[:3]), np.empty_like(motion.rotations)
    for joint, parent in enumerate(motion.parents):
        if parent < 0:
            positions[:, joint], rotations[:, joint] = motion.roots, motion.rotations[:, joint]
        else:
            positions[:, joint] = positions[:, parent] + rotations[:, parent] @ motion.offsets[joint]
            rotations[:, joint] = rotations[:, parent] @ motion.rotations[:, joint]
    return positions, rotations


# --- distortions: each keeps the motion -------------------------------------------------------------------------------


def turn_axes(motion: Motion, axes: Floats) -> Motion:
    """Returns the motion with the axes of each joint turned by ``axes`` (J, 3, 3), and with them the pose at zero."""
    above = np.stack([axes[parent] if parent >= 0 else np.eye(3) for parent in motion.parents])
    return replace(
        motion,
        offsets=np.einsum("jba,jb->ja", above, motion.offsets),
        sites={joint: axes[joint].T @ site for joint, site in motion.sites.items()},
        rotations=above.transpose(0, 2, 1) @ motion.rotations @ axes,
    )


def change_rest_pose(motion: Motion, pose: dict[str, Floats]) -> Motion:
    """Returns the motion on a rig with another pose at zero: joint -> rotation from the present pose at zero."""
    turns: list[Floats] = []
    for name, parent in zip(motion.names, motion.parents, strict=True):
        turns.append((turns[parent] if parent >= 0 else np.eye(3)) @ pose.get(name.removeprefix(PREFIX), np.eye(3)))
    return turn_axes(motion, np.stack(turns).transpose(0, 2, 1))


def change_unit(motion: Motion, rng: Random) -> Motion:
    """Returns the motion in another unit, 1e-6 to 1e3 of the present one."""
    factor = 10.0 ** rng.uniform(-6.0, 3.0)
    sites = {joint: factor * site for joint, site in motion.sites.items()}
    return replace(motion, offsets=factor * motion.offsets, sites=sites, roots=factor * motion.roots)


def change_world(motion: Motion, rng: Random) -> Motion:
    """Returns the motion in a world with other axes, those of every joint included."""
    turn = np.eye(3)[rng.permutation(3)] * rng.choice([-1.0, 1.0], 3)
    turn *= np.linalg.det(turn)
    turned = turn_axes(motion, np.broadcast_to(turn.T, (len(motion.names), 3, 3)))
    rotations = np.array(turned.rotations)
    rotations[:, 0] = turn @ rotations[:, 0]
    return replace(turned, rotations=rotations, roots=motion.roots @ turn.T)


def mirror(motion: Motion, rng: Random) -> Motion:
    """Returns the motion in the mirror; joints keep their names."""
    sites = {joint: _MIRROR @ site for joint, site in motion.sites.items()}
    rotations = _MIRROR @ motion.rotations @ _MIRROR
    offsets, roots = motion.offsets @ _MIRROR, motion.roots @ _MIRROR
    return replace(motion, offsets=offsets, sites=sites, rotations=rotations, roots=roots)


def mirror_and_rename(motion: Motion, rng: Random) -> Motion:
    """Returns the motion in the mirror; joints are named by their new side."""
    mirror_motion = mirror(motion, rng)
    names = (name.replace("Left", "?").replace("Right", "Left").replace("?", "Right") for name in mirror_motion.names)
    return replace(mirror_motion, names=tuple(names))


def rename_joints(motion: Motion, rng: Random) -> Motion:
    """Returns the motion with the joint names of a known scheme; joints without a role in it get a meaningless name."""
    scheme = sorted(RIGS)[rng.integers(len(RIGS))]
    roles = {name: role for role, name in skeleton_of(*RIGS["mixamo colon"][1])[1].items()}
    names = skeleton_of(*RIGS[scheme][1])[1]
    new_names = (names.get(roles.get(name, ""), f"x{k}") for k, name in enumerate(motion.names))
    return replace(motion, names=tuple(name.replace(" ", "_") for name in new_names))  # BVH allows no spaces in names


def align_bones(motion: Motion, rng: Random) -> Motion:
    """Returns the motion with the axes of every joint such that its bone points up: at zero all bones lie in a line."""
    axes = np.empty((len(motion.names), 3, 3))
    for joint in range(len(motion.names)):
        bone = next((motion.offsets[k] for k, p in enumerate(motion.parents) if p == joint), motion.sites.get(joint))
        axes[joint] = np.eye(3)
        if bone is not None and np.linalg.norm(bone) > 0.0:
            axes[joint] = Rotation.align_vectors([bone / np.linalg.norm(bone)], [[0.0, 1.0, 0.0]])[0].as_matrix()
    return turn_axes(motion, axes)


def _make_pose(lowered_deg: float, forward_deg: float, bent_deg: float, spread_deg: float) -> dict[str, Floats]:
    """Returns a pose at zero: arms from the T-pose down and forward, fingers bent, legs spread, degrees."""
    pose = {}
    for side, sign in (("Left", 1.0), ("Right", -1.0)):
        lowered = Rotation.from_euler("z", -sign * lowered_deg, degrees=True)
        pose[f"{side}Arm"] = (Rotation.from_euler("y", -sign * forward_deg, degrees=True) * lowered).as_matrix()
        pose[f"{side}UpLeg"] = Rotation.from_euler("z", sign * spread_deg, degrees=True).as_matrix()
        for finger in ("Index", "Middle", "Ring", "Pinky"):
            for n in (1, 2, 3):
                pose[f"{side}Hand{finger}{n}"] = Rotation.from_euler("z", -sign * bent_deg, degrees=True).as_matrix()
    return pose


_RESTS = ((0.0, 0.0), (45.0, 0.0), (80.0, 0.0), (0.0, 85.0), (-80.0, 0.0), (30.0, 30.0))
"""T, A, arms down, forward, up, and between: angles by which arms are lowered and turned forward, degrees."""


def draw_rest(motion: Motion, rng: Random, spread_deg: float = 0.0) -> Motion:
    """Returns the motion on a rig that shows one of these poses at zero, with fingers straight or bent."""
    pose = _make_pose(*_RESTS[rng.integers(len(_RESTS))], rng.choice([0.0, 30.0, 60.0]), spread_deg)
    return change_rest_pose(motion, pose)


def draw_straddling_rest(motion: Motion, rng: Random) -> Motion:
    """Returns the same with legs spread."""
    return draw_rest(motion, rng, spread_deg=15.0)


def turn_axes_slightly(motion: Motion, rng: Random) -> Motion:
    """Returns the motion with the axes of every joint turned by up to 25 degrees."""
    axis = rng.normal(size=(len(motion.names), 3))
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    angles = np.deg2rad(rng.uniform(2.0, 25.0)) * rng.uniform(0.3, 1.0, len(axis))
    return turn_axes(motion, Rotation.from_rotvec(angles[:, None] * axis).as_matrix())


def turn_axes_randomly(motion: Motion, rng: Random) -> Motion:
    """Returns the motion with the axes of every joint turned at random."""
    return turn_axes(motion, Rotation.random(len(motion.names), random_state=rng).as_matrix())


def change_all(motion: Motion, rng: Random) -> Motion:
    """Returns the motion with another pose at zero, unit, world and names."""
    new_rest = (draw_rest, draw_straddling_rest, turn_axes_slightly, turn_axes_randomly, align_bones)[rng.integers(5)]
    for change in (new_rest, change_unit, change_world, rename_joints):
        motion = change(motion, rng)
    return motion


def keep(motion: Motion, rng: Random) -> Motion:
    """Returns the motion itself."""
    return motion
