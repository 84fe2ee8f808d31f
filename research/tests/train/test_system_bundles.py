"""Bundles of LpTransformer, its ablations and LPT+: onnxruntime predicts what torch predicts."""

from __future__ import annotations

import pytest

pytest.importorskip("torch")

from exported_bundles import bundle, cached_operators, check_predictions, exports  # noqa: F401
from signsplice_paper.systems import PaperSystem
from signsplice_paper.train import scales
from signsplice_workshop.train.tasks import Task

SYSTEMS = [name for name in scales.SYSTEMS if name.startswith("lpt")]


@pytest.mark.parametrize("bundle", SYSTEMS, indirect=True)
def test_a_bundle_predicts_what_torch_predicts(bundle: tuple[PaperSystem, list[Task]]) -> None:  # noqa: F811
    check_predictions(bundle)
