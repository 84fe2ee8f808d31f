"""The drawn figure: its parts joined into one mesh, by material."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from io import BytesIO
from types import ModuleType

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from signsplice.body.capsules import MeshPart
from signsplice.body.mesh import bind_pose, body_mesh
from signsplice.errors import MissingExtraError
from signsplice.motion import FloatArray, Skeleton, kinematics, rotation
from signsplice.render.raster import Pixels
from signsplice.rig.info import rig_info
from signsplice.rig.roles import FINGERS, SIDES

_MOST_TEXELS = 1024
"""Largest width and height of a texture; larger ones are made smaller."""
_OF_FINGER = 0.9
"""Weight of a finger's joints above which skin is its own, and no web or palm: outlines separate fingers."""


def pillow(module: str) -> ModuleType:
    """Returns a module of Pillow by its name. Raises ``MissingExtraError`` if Pillow is not installed."""
    try:
        return import_module(f"PIL.{module}")
    except ImportError as error:
        raise MissingExtraError("pictures need Pillow: pip install '.[video]' in signsplice's folder") from error


@dataclass(frozen=True, eq=False)
class Surface:
    """The triangles of a skin with one material.

    triangles: their rows.
    texture: its picture, as encoded in a file; empty for none.
    cutoff: least alpha of the texture that is visible; 0 if it is opaque.
    both_sides: whether it is visible from inside.
    """

    triangles: slice
    texture: bytes
    cutoff: float
    both_sides: bool

    @cached_property
    def pixels(self) -> NDArray[np.uint8] | None:
        """The texture's pixels (H, W, 4); None without a texture, or one of a kind that Pillow does not know."""
        try:
            picture = pillow("Image").open(BytesIO(self.texture)) if self.texture else None
            if picture is None:
                return None
            picture.thumbnail((_MOST_TEXELS, _MOST_TEXELS))
            return np.asarray(picture.convert("RGBA"))
        except (OSError, ValueError, SyntaxError):  # what Pillow raises for broken pictures
            return None


@dataclass(frozen=True, eq=False)
class Skin:
    """The figure as a single mesh in its bind pose: V vertices, F triangles, J joints.

    vertices: (V, 3) clip units.
    normals: (V, 3) unit vectors.
    weights: (V, J) skinning weights, sparse.
    triangles: (F, 3) indices of vertices.
    tints: (F, 3) colour of each triangle, sRGB 0 to 1.
    uvs: (V, 2) texture coordinates, v down.
    surfaces: its triangles by material.
    morphs: control of the face -> vertices that it moves (N,), and their displacement at 1 (N, 3).
    groups: (F,) number of the triangle's finger, 0 for all other parts.
    hands: (F,) "left" or "right" for triangles of a hand, else "".
    rotations: (J, 3, 3) global rotations of the joints in the bind pose.
    positions: (J, 3) positions of the joints in the bind pose, clip units.
    """

    vertices: Pixels
    normals: Pixels
    weights: csr_array
    triangles: NDArray[np.intp]
    tints: Pixels
    uvs: Pixels
    surfaces: tuple[Surface, ...]
    morphs: Mapping[str, tuple[NDArray[np.intp], Pixels]]
    groups: NDArray[np.int16]
    hands: NDArray[np.str_]
    rotations: FloatArray
    positions: FloatArray


def skin_of(skeleton: Skeleton) -> Skin:
    """Returns the skin of a skeleton's own figure, or of the mannequin."""
    return join_parts(skeleton, body_mesh(skeleton))


def join_parts(skeleton: Skeleton, parts: Sequence[MeshPart]) -> Skin:
    """Joins parts into one mesh, ordered by material. Each finger is a group, so that outlines separate fingers."""
    materials: dict[tuple[bytes, float, bool], list[MeshPart]] = {}
    for part in [part for part in parts if part.cutoff <= 1.0] or parts:  # above 1, their material hides them
        materials.setdefault((part.texture, part.cutoff if part.texture else 0.0, part.both_sides), []).append(part)
    parts = [part for same in materials.values() for part in same]
    ends = np.cumsum([0, *(sum(len(part.triangles) for part in same) for same in materials.values())]).tolist()
    surfaces = [
        Surface(slice(first, end), *material) for material, first, end in zip(materials, ends, ends[1:], strict=False)
    ]
    finger_of = {
        joint: FINGERS.index(finger) + 1
        for role, joint in rig_info(skeleton).roles.joints.items()
        for finger in FINGERS
        if finger in role
    }
    fingers = np.array([finger_of.get(joint, 0) for joint in range(len(skeleton))])
    joint_sides = np.full(len(skeleton), "", "<U5")
    for side in SIDES:
        if (wrist := rig_info(skeleton).roles.joints.get(f"{side}Hand")) is not None:
            joint_sides[kinematics.subtree(skeleton, wrist)] = side
    starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    joints = np.concatenate([part.joints for part in parts])  # (V, 4)
    weights = np.concatenate([part.weights for part in parts])  # (V, 4)
    n_vertices, width = joints.shape
    sparse_weights = csr_array(
        (weights.ravel().astype(np.float32), joints.ravel(), np.arange(0, n_vertices * width + 1, width)),
        (n_vertices, len(skeleton)),
    )
    main_joint = np.take_along_axis(joints, weights.argmax(axis=1)[:, None], axis=1)[:, 0]  # (V,)
    counts = [len(part.triangles) for part in parts]
    triangles = np.concatenate([part.triangles + k for part, k in zip(parts, starts[:-1], strict=True)])
    shares = np.stack([(weights * (fingers[joints] == n)).sum(axis=1) for n in range(1, len(FINGERS) + 1)])  # (5, V)
    finger = np.where(shares.max(axis=0) > _OF_FINGER, shares.argmax(axis=0) + 1, 0)[triangles[:, 0]]
    part_of = np.repeat(np.arange(len(parts)), counts)
    n_finger = np.bincount(part_of, finger > 0, len(parts))
    has_hand = (n_finger >= 0.1 * n_finger.max())[part_of]  # of others, such as sleeves, a hand carries the edge
    named = np.repeat(np.array([_hand_of(part) for part in parts]), counts)
    hands = np.where((named == "") & has_hand, joint_sides[main_joint[triangles[:, 0]]], named)
    global_quats, positions = bind_pose(skeleton)
    return Skin(
        vertices=np.concatenate([part.vertices for part in parts]).astype(np.float32),
        normals=np.concatenate([part.normals for part in parts]).astype(np.float32),
        weights=sparse_weights,
        triangles=triangles,
        tints=np.repeat(np.array([part.colour for part in parts], np.float32), counts, axis=0),
        uvs=np.concatenate(
            [np.zeros((len(part.vertices), 2)) if part.uvs is None else part.uvs for part in parts]
        ).astype(np.float32),
        surfaces=tuple(surfaces),
        morphs=_morphs(parts, starts),
        groups=np.where(finger > 0, finger + len(FINGERS) * (hands == "left"), 0).astype(np.int16),
        hands=hands,
        rotations=rotation.to_matrix(global_quats),
        positions=positions,
    )


def _morphs(parts: Sequence[MeshPart], starts: NDArray[np.intp]) -> dict[str, tuple[NDArray[np.intp], Pixels]]:
    """Returns control of the face -> moved vertices of the whole mesh, and their displacement; ``starts``: first vertex
    of each part.
    """
    moved: dict[str, list[tuple[NDArray[np.intp], Pixels]]] = {}
    for part, start in zip(parts, starts[:-1].tolist(), strict=True):
        for name, (rows, moves) in part.morphs.items():
            moved.setdefault(name, []).append((rows + start, moves.astype(np.float32)))
    return {
        name: (np.concatenate([r for r, _ in rows]), np.concatenate([m for _, m in rows]))
        for name, rows in moved.items()
    }


def _hand_of(part: MeshPart) -> str:
    """Returns the side of a hand or fingertip part, or "" for other parts."""
    side, _, kind = part.name.partition(" ")
    return side if kind in ("hand", "nails") else ""
