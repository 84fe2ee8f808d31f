"""Files of every odd kind are read as an independent evaluator of the standards reads them, or refused, or named."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from conftest import GOLDEN

import evaluators
import formats


@pytest.mark.parametrize("kind", formats.KINDS)
def test_no_file_is_read_otherwise_than_the_standard_says(kind: str) -> None:
    assert formats.count_verdicts(kind, 6) == {formats.KINDS[kind][0]: 6}


def test_the_evaluator_of_bvh_agrees_with_pybvh() -> None:
    names, world = evaluators.evaluate_bvh((GOLDEN / "pybvh_chain.bvh").read_bytes())
    with np.load(GOLDEN / "pybvh_chain.npz") as golden:
        np.testing.assert_allclose(world[..., :3, 3], golden["positions"], atol=1e-9)
    assert len(names) == world.shape[1]


def test_the_evaluator_of_gltf_multiplies_matrices() -> None:
    """Below a node that mirrors, shears and lifts: (x, y, z) lies at (x + y / 2, 1 - y, z), worked out by hand."""
    matrix = [1, 0, 0, 0, 0.5, -1, 0, 0, 0, 0, 1, 0, 0, 1, 0, 1]
    nodes: list[dict[str, Any]] = [{"name": "arm", "matrix": matrix, "children": [1]}, {"name": "tip"}]
    moves = (1, "translation", np.array([0.0, 1.0]), np.array([[0.0, 0.0, 0.0], [2.0, 4.0, 6.0]]), "LINEAR")
    names, world = evaluators.evaluate_gltf(formats.GltfDraft(nodes, [moves]).encode(), [-1.0, 0.5, 1.5])
    assert names == ["arm", "tip"]
    np.testing.assert_allclose(world[:, 1, :3, 3], [[0.0, 1.0, 0.0], [2.0, -1.0, 3.0], [4.0, -3.0, 6.0]])
