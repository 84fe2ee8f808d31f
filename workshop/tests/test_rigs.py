"""A short run of ``workshop/attacks/rigs.py``: no distortion of a rig comes out as other motion without a word."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rigs import KINDS, attack, judge_rig


def test_no_random_rig_is_spliced_wrongly_in_silence() -> None:
    """But for files that show no motion at all, which their reader refuses."""
    kinds = {name: kind for name, kind in KINDS.items() if kind.has_truth}
    seen = attack(2 * len(kinds), seed=3, kinds=kinds)
    assert {
        name: [what for what, _ in outcomes if what in ("SILENT", "refused")] for name, outcomes in seen.items()
    } == {name: [] for name in kinds}
    for name in (
        "Euler orders",
        "unit, 1e-6 to 1e3 of the first's",
        "joint axes by up to 25 degrees, on the first's body",
    ):
        assert [what for what, _ in seen[name]] == ["right"] * 2, name


def test_hips_without_legs_face_as_the_body_does(tmp_path: Path) -> None:
    """Names of an upper body alone, joint axes and the world's axes at random: the hips have one bone."""
    kind = KINDS["all of these at once, on the first's body"]
    for number in (335, 478):
        verdict, error_cm = judge_rig(kind, np.random.default_rng([0, number]), tmp_path)
        assert verdict == "warned", "legs hold their pose"
        assert error_cm < 1.0
