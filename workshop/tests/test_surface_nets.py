"""figure.surface_nets: the surface of a solid is closed and lies on it."""

from __future__ import annotations

import numpy as np
import pytest

from signsplice_workshop.figure.surface_nets import surface


def test_the_surface_of_a_ball_and_of_a_ring_is_closed() -> None:
    def ball(points: np.ndarray) -> np.ndarray:
        return np.asarray(np.linalg.norm(points - [0.1, 0.2, 0.3], axis=1) - 1.0)

    def ring(points: np.ndarray) -> np.ndarray:
        return np.asarray(np.hypot(np.hypot(points[:, 0], points[:, 1]) - 1.0, points[:, 2]) - 0.3)

    for field, holes, volume in ((ball, 0, 4.0 / 3.0 * np.pi), (ring, 1, 2.0 * np.pi**2 * 0.09)):
        vertices, normals, triangles = surface(field, np.full(3, -1.6), np.full(3, 1.6), 0.08)
        np.testing.assert_allclose(field(vertices), 0.0, atol=1e-4)
        np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-9)
        n_edges = count_edges(triangles)
        assert len(vertices) - n_edges + len(triangles) == 2 - 2 * holes, "Euler characteristic"
        a, b, c = (vertices[triangles[:, k]] for k in range(3))
        signed_volume = np.einsum("fa,fa->f", a, np.cross(b, c)).sum() / 6.0
        assert signed_volume == pytest.approx(volume, rel=0.02), "counter-clockwise from outside"


def count_edges(triangles: np.ndarray) -> int:
    """The number of edges of a closed mesh: every edge is passed as often in one direction as in the other."""
    a, b = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]).T.astype(np.int64)
    n = triangles.max() + 1
    np.testing.assert_array_equal(np.sort(a * n + b), np.sort(b * n + a), "not closed")
    return len(a) // 2


def test_a_field_without_an_inside_is_refused() -> None:
    with pytest.raises(ValueError, match="no surface between"):
        surface(lambda points: np.ones(len(points)), np.zeros(3), np.ones(3), 0.1)
