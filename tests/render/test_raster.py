"""The rasterizer: silhouettes, depth, shading and outlines of triangles."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from signsplice.render.raster import Canvas, Pixels, lit
from signsplice_workshop.figure.surface_nets import surface

LIGHT = np.array([0.6, 0.0, 0.8], np.float32)
RED, BLUE = (0.9, 0.1, 0.1), (0.1, 0.1, 0.9)


def ball(centre: tuple[float, float, float], radius: float) -> tuple[Pixels, Pixels, NDArray[np.intp]]:
    """A ball's vertices, normals and triangles; pixels right, up, towards the viewer."""
    middle = np.array(centre)
    low, high = middle - radius - 1.0, middle + radius + 1.0
    made = surface(lambda at: np.linalg.norm(at - middle, axis=-1) - radius, low, high, 0.15 * radius)
    return made[0].astype(np.float32), made[1].astype(np.float32), made[2].astype(np.intp)


def canvas_with(*balls: tuple[tuple[float, float, float], float, tuple[float, float, float]]) -> Canvas:
    """A canvas with balls of a centre, a radius and a tint, each a group."""
    canvas = Canvas(100, 80)
    for group, (centre, radius, tint) in enumerate(balls):
        points, normals, triangles = ball(centre, radius)
        tints = np.tile(np.array(tint, np.float32), (len(triangles), 1))
        light = np.stack([lit(normals, LIGHT), lit(-normals, LIGHT)])
        canvas.mesh(points, light, triangles, tints, np.full(len(triangles), group, np.int16))
    return canvas


def test_a_ball_has_the_right_silhouette_and_depth() -> None:
    canvas = canvas_with(((30.0, 30.0, 5.0), 20.0, RED))
    rows, columns = np.mgrid[0:80, 0:100]
    away = np.hypot(columns - 30.0, (80.0 - rows) - 30.0)
    assert (canvas.group[away < 19.4] == 0).all(), "a hole in it"
    assert (canvas.group[away > 20.6] == -1).all()
    inner = away < 17.0
    assert np.abs(canvas.depth[inner] - (5.0 + np.sqrt(400.0 - away[inner] ** 2))).max() < 0.5


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_the_nearer_surface_is_visible(order: tuple[int, int]) -> None:
    near, far = ((50.0, 40.0, 30.0), 8.0, RED), ((50.0, 40.0, 0.0), 20.0, BLUE)
    canvas = canvas_with(*[(near, far)[i] for i in order])
    assert canvas.colour[40, 50, 0] > 2.0 * canvas.colour[40, 50, 2]
    assert canvas.colour[40, 66, 2] > 2.0 * canvas.colour[40, 66, 0]


def test_triangles_of_every_size_agree_with_a_plain_rasterizer() -> None:
    rng = np.random.default_rng(0)
    centres = rng.uniform(-10.0, 110.0, (60, 1, 3))
    points = (centres + rng.normal(size=(60, 3, 3)) * 10.0 ** rng.uniform(-0.5, 1.4, (60, 1, 1))).astype(np.float32)
    light = rng.uniform(0.2, 1.0, 180).astype(np.float32)
    triangles, groups = np.arange(180).reshape(60, 3), np.arange(60).astype(np.int16)
    canvas = Canvas(100, 80)
    canvas.mesh(points.reshape(-1, 3), np.stack([light, light]), triangles, np.ones((60, 3), np.float32), groups)
    depth, group, shade = np.full((80, 100), -np.inf), np.full((80, 100), -1), np.zeros((80, 100))
    rows, columns = np.mgrid[0:80, 0:100]
    for n, corners in enumerate(points.astype(float)):
        edges = np.stack([corners[1] - corners[0], corners[2] - corners[0]], axis=1)[:2]
        if np.linalg.det(edges) <= 0.0:  # seen from inside
            continue
        pixels = np.stack([columns - corners[0, 0], 80.0 - rows - corners[0, 1]], axis=-1)
        second, third = np.moveaxis(pixels @ np.linalg.inv(edges).T, -1, 0)
        barycentric = np.stack([1.0 - second - third, second, third], axis=-1)
        height = barycentric @ corners[:, 2]
        nearest = (barycentric >= 0.0).all(axis=-1) & (height > depth)
        depth[nearest], group[nearest] = height[nearest], n
        shade[nearest] = barycentric[nearest] @ light[3 * n : 3 * n + 3]
    same = canvas.group == group
    assert len(np.unique(group)) > 10
    assert same.mean() > 0.998, "but for pixels on an edge"
    seen = same & (group >= 0)
    assert np.abs(canvas.depth[seen] - depth[seen]).max() < 0.05
    assert np.abs(canvas.colour[seen][:, 0] - shade[seen]).max() < 0.01


def test_a_surface_outside_the_picture_draws_nothing() -> None:
    canvas = canvas_with(((500.0, 40.0, 0.0), 8.0, RED))
    assert (canvas.group == -1).all()
    assert (canvas.finish(step=5.0, near=1.0, far=0.0) == canvas.finish(step=5.0, near=1.0, far=0.0)[0, 0]).all()


def test_outlines_are_drawn_only_behind_edges() -> None:
    near, far = ((50.0, 40.0, 40.0), 6.0, RED), ((50.0, 40.0, 0.0), 30.0, BLUE)
    both = canvas_with(near, far).finish(step=5.0, near=40.0, far=0.0).astype(int)
    alone = canvas_with(far).finish(step=5.0, near=40.0, far=0.0).astype(int)
    assert both[20, 28, 2] < 0.7 * alone[20, 28, 2]
    assert abs(both[20, 33, 2] - alone[20, 33, 2]) <= 2
