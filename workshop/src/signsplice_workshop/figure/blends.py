"""Capsules of a body in the bind pose: their distances, their smooth union, and the joints that carry points on it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from signsplice.body.capsules import N_JOINTS, BodyCapsules, capsule_ends
from signsplice.body.mesh import bind_pose
from signsplice.motion import FloatArray, Skeleton, rotation


@dataclass(frozen=True, eq=False)
class BoundCapsules:
    """Capsules in the bind pose.

    starts, ends: (C, 3) of their axes.
    radii: (C, 2) at both ends.
    joints: (C,) that carry them.
    """

    starts: FloatArray
    ends: FloatArray
    radii: FloatArray
    joints: NDArray[np.intp]


def pose_capsules(skeleton: Skeleton, shape: BodyCapsules, rows: list[int]) -> BoundCapsules:
    """Returns some capsules of a body in the bind pose."""
    rotations, positions = bind_pose(skeleton)
    starts, ends = (p[0, rows] for p in capsule_ends(shape, rotation.to_matrix(rotations)[None], positions[None]))
    return BoundCapsules(starts, ends, shape.radii[rows], shape.joints[rows])


def union(distances: FloatArray, blend: float) -> FloatArray:
    """Returns a smooth union (N,) of distances (C, N): a point close to several solids counts as slightly deeper."""
    if len(distances) == 1:
        return np.asarray(distances[0])
    nearest = distances.min(axis=0)
    closeness = np.exp((nearest - distances) / blend)
    return np.asarray(nearest - blend * np.log(closeness.T.copy().sum(axis=1)))  # copied: sums equal those of a row


def distances_from(points: FloatArray, capsules: BoundCapsules) -> FloatArray:
    """Returns signed distances (C, N) of points (N, 3) from tapered capsules, negative inside.

    A tapered capsule is the union of all balls between its two end balls.
    """
    axes, (first, second) = capsules.ends - capsules.starts, capsules.radii.T[:, :, None]  # (C, 3), (C, 1)
    squared, taper = np.einsum("cx,cx->c", axes, axes)[:, None], first - second
    slope = squared - taper**2
    cone = slope > 1e-12 * squared  # else one ball contains the other
    divisor = np.where(cone, squared, 1.0)
    middle = capsules.starts.mean(axis=0)  # small numbers keep the matrix products accurate
    points, starts = points - middle, capsules.starts - middle
    dots = axes @ points.T
    dots -= np.einsum("cx,cx->c", starts, axes)[:, None]
    far = np.einsum("nx,nx->n", points, points) + np.einsum("cx,cx->c", starts, starts)[:, None]
    far -= starts @ (2.0 * points).T
    np.maximum(far, 0.0, out=far)  # squared, from the start
    offset_squared = np.maximum(far - dots**2 / divisor, 0.0)  # squared, from the axis
    steep = np.sqrt(np.where(cone, slope, divisor) / divisor)
    offset = np.sqrt(offset_squared)
    # Centre of the ball with the nearest surface, from 0 at the start to l^2 at the end.
    centre = dots - taper * offset / steep
    distances: FloatArray = offset * steep + dots * taper / divisor - first
    start = np.sqrt(far) - first
    np.copyto(distances, np.sqrt(offset_squared + (dots - squared) ** 2 / divisor) - second, where=centre >= squared)
    np.copyto(distances, start, where=centre <= 0.0)
    if not cone.all():
        ball = np.where(first >= second, start, np.sqrt(np.maximum(far - 2.0 * dots + squared, 0.0)) - second)
        np.copyto(distances, ball, where=~cone)
    return distances


def skin_weights(
    distances: FloatArray, softness: FloatArray, joints: NDArray[np.intp]
) -> tuple[NDArray[np.int64], FloatArray]:
    """Returns skinning joints and weights (V, 4) of vertices, from distances (V, C) to the capsules of each joint.

    softness: (C,) distance over which a vertex passes from one capsule to the next; the smaller of two counts.
    """
    nearest = distances.argmin(axis=1)
    soft = np.minimum(softness, softness[nearest, None])
    falloff = np.exp(-(distances - distances.min(axis=1, keepdims=True)) / soft)
    carriers = np.unique(joints)
    joint_falloff = np.stack([falloff[:, joints == joint].max(axis=1) for joint in carriers], axis=1)
    n_missing = max(0, N_JOINTS - len(carriers))
    joint_falloff = np.pad(joint_falloff, ((0, 0), (0, n_missing)))
    carriers = np.pad(carriers, (0, n_missing))
    order = np.argsort(-joint_falloff, axis=1, kind="stable")[:, :N_JOINTS]
    weights = np.take_along_axis(joint_falloff, order, axis=1)
    weights[weights < 0.02 * weights[:, :1]] = 0.0
    weights /= weights.sum(axis=1, keepdims=True)
    return np.where(weights > 0.0, carriers[order], 0).astype(np.int64), weights
