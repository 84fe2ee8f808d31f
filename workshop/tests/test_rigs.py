"""A short run of ``workshop/attacks/rigs.py``: no distortion of a rig comes out as other motion without a word."""

from __future__ import annotations

from rigs import KINDS, attack


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
