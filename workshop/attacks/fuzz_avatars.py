"""Makes small avatars to start from: a body with fingers and one without, as VRM 1.0, VRM 0.x and plain .glb."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

import avatars
from signsplice.body.capsules import Avatar, BodyShape, MeshPart, build_capsules
from signsplice.motion import Skeleton, kinematics, rotation
from signsplice.rig.info import rig_info

_CORNERS = 8
_STAGES = ((0.0, 0.0, -1.0), (0.0, 1.0, 0.0), (0.5, 1.0, 0.0), (1.0, 1.0, 0.0), (1.0, 0.0, 1.0))
"""Rings of a capsule: fraction of its bone, radius over the capsule's, and distance beyond the end in radii."""


def make_seeds(small: Skeleton) -> list[bytes]:
    """Returns the bytes of avatars: mostly ``small``, in cm, and a body with fingers, which takes longer to read."""
    small_avatar = _make_avatar(small)
    with tempfile.TemporaryDirectory() as folder:
        return [
            avatars.write(Path(folder) / "a", avatar, [_make_mesh(avatar)], version, **options).read_bytes()
            for avatar, version, options in (
                (small_avatar, "1.0", {"hair": False}),
                (small_avatar, "0.x", {"hair": False, "weights": "u8"}),
                (small_avatar, "", {"sparse": True, "axes": False}),
                (avatars.body("broad"), "1.0", {"weights": "u16"}),
            )
        ]


def _make_avatar(small: Skeleton) -> Avatar:
    roles = {role: small.names[joint] for role, joint in rig_info(small).roles.joints.items()}
    avatar = Avatar(small.names, small.parents, 0.01 * small.offsets, roles=roles, label="small")
    return replace(avatar, body=build_capsules(avatar, BodyShape()))


def _make_mesh(avatar: Avatar) -> MeshPart:
    """Returns a coarse tube around every capsule, all as one part."""
    body, rest = avatar.body, kinematics.rest_positions(avatar)
    assert body is not None
    angle = np.linspace(0.0, 2.0 * np.pi, _CORNERS, endpoint=False)
    corner = np.arange((len(_STAGES) - 1) * _CORNERS)
    next_corner = corner - corner % _CORNERS + (corner + 1) % _CORNERS
    faces = np.concatenate([
        np.stack([corner, next_corner, next_corner + _CORNERS], 1),
        np.stack([corner, next_corner + _CORNERS, corner + _CORNERS], 1)
    ])  # fmt: skip
    n_each, vertices, triangles = len(_STAGES) * _CORNERS, [], []
    for n, joint in enumerate(body.joints.tolist()):
        start, end = body.starts[n], body.ends[n]
        bone = end - start if np.linalg.norm(end - start) > 0.0 else np.array([0.0, 1e-6, 0.0])
        turn = rotation.between_vectors(np.array([0.0, 0.0, 1.0]), bone)
        for fraction, wide, beyond in _STAGES:
            radius = body.radii[n] @ [1.0 - fraction, fraction]
            ring = radius * np.stack([wide * np.cos(angle), wide * np.sin(angle), np.full(_CORNERS, beyond)], 1)
            vertices.append(rest[joint] + start + fraction * (end - start) + rotation.rotate(turn, ring))
        triangles.append(n * n_each + faces)
    positions = np.concatenate(vertices)
    joints, weights = np.zeros((len(positions), 4), np.int64), np.tile([1.0, 0.0, 0.0, 0.0], (len(positions), 1))
    joints[:, 0] = np.repeat(body.joints, n_each)
    return MeshPart("Body_SKIN", (1.0, 0.8, 0.7), positions, positions, np.concatenate(triangles), joints, weights)
