"""A part of a body's mesh: triangles in one colour that joints carry."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from signsplice.motion.arrays import FloatArray

N_JOINTS = 4
"""Joints, at most, that carry a vertex."""


@dataclass(frozen=True, eq=False)
class MeshPart:
    """A part of the mesh in one colour.

    name: what it is, with its side.
    colour: sRGB, 0 to 1.
    vertices, normals: (V, 3) in the bind pose, clip units, the root at the origin.
    triangles: (F, 3) indices of vertices.
    joints, weights: (V, 4) which joints carry each vertex, and how much; unused ones have weight 0.
    morphs: coefficient of a face -> vertices that it moves (N,), and how far at 1 (N, 3).
    uvs: (V, 2) texture coordinates, v down; None for none.
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
