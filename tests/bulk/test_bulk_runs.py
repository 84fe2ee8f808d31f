"""Whole runs by command: resumed after kills, on a Ray cluster of two nodes, equal whatever made them."""

from __future__ import annotations

from pathlib import Path

import pytest

import bulk_kills


@pytest.mark.slow
def test_killed_workers_and_drivers_change_nothing(tmp_path: Path) -> None:
    assert bulk_kills.attack(tmp_path, n_kills=3, on_ray=False, seed=1, n_recipes=60).total() == 3


@pytest.mark.slow
def test_killed_actors_nodes_and_drivers_of_two_ray_nodes_change_nothing(tmp_path: Path) -> None:
    assert bulk_kills.attack(tmp_path, n_kills=2, on_ray=True, seed=2, n_recipes=60).total() == 2
