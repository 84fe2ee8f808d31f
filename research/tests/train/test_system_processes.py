"""A part of a system of the paper trained by several processes: the same losses as by one."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("torch")

from system_toys import part_toy
from two_processes import check_losses, check_writers, train_by_two


def test_two_processes_have_the_losses_of_one(tmp_path: Path) -> None:
    trained = train_by_two(tmp_path / "processes", ["tfgn"], part_toy)
    check_losses(trained, tmp_path / "alone", "tfgn", part_toy)
    check_writers(trained, ["tfgn"])
