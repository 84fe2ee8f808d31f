"""The figure's head: a face with eyes, lids, brows, lips, teeth and tongue, and ARKit's 52 coefficients as its morphs.

``figure.npz`` is made by ``workshop/runs/figure.py`` from MakeHuman's base mesh (CC0), in steps of ``_STEP`` statures
about the head's joint in the T-pose (left +X, up +Y, forward +Z). Its skin follows that of the capsules of head and
neck, which hands touch.
"""

from __future__ import annotations

from importlib.resources import files

import numpy as np
from numpy.typing import NDArray

from signsplice.body.capsules import BodyCapsules
from signsplice.body.mesh_part import MeshPart
from signsplice.motion.arrays import FloatArray
from signsplice.motion.clip import Skeleton
from signsplice.motion.face import ARKIT_CHANNELS
from signsplice.rig.info import rig_info

_STEP = 1e-5
_CHIN_RADIUS = 0.024
"""Radius of the usual head's chin (``capsules``), statures: what a larger head is measured by."""
_COLOURS = {
    "face": (0.90, 0.69, 0.56),
    "lips": (0.76, 0.45, 0.41),
    "eye": (0.95, 0.94, 0.92),
    "iris": (0.33, 0.24, 0.17),
    "pupil": (0.07, 0.06, 0.06),
    "lash": (0.16, 0.11, 0.09),
    "brow": (0.24, 0.17, 0.13),
    "teeth": (0.95, 0.93, 0.88),
    "tongue": (0.56, 0.26, 0.28),
    "hair": (0.27, 0.20, 0.17),
}
"""Parts in the order of their numbers in the file, and their colours, sRGB 0 to 1."""


def has_head(skeleton: Skeleton, shape: BodyCapsules) -> bool:
    """Whether a body has the head that the figure's stands for."""
    return "head1" in shape.keys and "head" in rig_info(skeleton).roles.joints


def head_parts(skeleton: Skeleton, shape: BodyCapsules, positions: FloatArray) -> tuple[MeshPart, ...]:
    """The figure's head on a body that has one, part by part; ``positions`` (J, 3): of the joints in the bind pose."""
    info = rig_info(skeleton)
    head, size = info.roles.joints["head"], _size(shape)
    neck = info.roles.joints.get("neck", head)
    with files("signsplice.body").joinpath("figure.npz").open("rb") as file:
        stored = {name: np.asarray(array) for name, array in np.load(file).items()}
    points, normals = stored["vertices"] * size, stored["normals"].astype(np.float64)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-9)
    weight = stored["head_weights"] / 255.0
    ends = np.cumsum(stored["unit_counts"])
    units = {
        name: (stored["unit_vertices"][end - n : end].astype(np.int64), stored["unit_moves"][end - n : end] * size)
        for name, n, end in zip(ARKIT_CHANNELS, stored["unit_counts"].tolist(), ends.tolist(), strict=True)
    }
    is_neck, is_one = weight < 0.5, (weight == 0.0) | (weight == 1.0)
    first, second = np.where(is_neck, neck, head), np.where(is_one, 0, np.where(is_neck, head, neck))
    most = np.maximum(weight, 1.0 - weight)
    weights = np.stack([most, 1.0 - most, 0.0 * most, 0.0 * most], axis=1)
    joints = np.stack([first, second, 0 * first, 0 * first], axis=1)
    triangles = stored["triangles"].astype(np.int64)
    out = []
    for number, (name, colour) in enumerate(_COLOURS.items()):
        used, own = np.unique(triangles[stored["parts"] == number], return_inverse=True)
        moved = {unit: _of_part(used, *rows) for unit, rows in units.items()}
        morphs = {unit: rows for unit, rows in moved.items() if len(rows[0])}
        at, own = positions[head] + points[used], own.reshape(-1, 3)
        out.append(MeshPart(name, colour, at, normals[used], own, joints[used], weights[used], morphs))
    return tuple(out)


def _size(shape: BodyCapsules) -> float:
    """Clip units of a step of the file: by the thickness of the chin."""
    return _STEP * float(shape.radii[shape.keys.index("head1"), 0]) / _CHIN_RADIUS


def _of_part(
    used: NDArray[np.int64], rows: NDArray[np.int64], moves: FloatArray
) -> tuple[NDArray[np.int64], FloatArray]:
    """The vertices of a part that a unit moves, by their numbers there, and their moves (N, 3)."""
    at = np.minimum(np.searchsorted(used, rows), len(used) - 1)
    own = used[at] == rows
    return at[own], moves[own]
