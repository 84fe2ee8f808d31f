"""Makes tests/golden/tiny_bundle: the product's networks at toy size with random weights, as training exports them.

    python tests/golden/make_tiny_bundle.py

Needs the `train` extra. Its answers mean nothing; that they come out the same on every rig, rate and hand is the point.
"""

from __future__ import annotations

import json
import sys
import tempfile
from dataclasses import asdict
from pathlib import Path

import torch

from signsplice.synth import training_data
from signsplice.train.product import training
from signsplice.train.product.networks.bridge import Bridge, BridgeConfig
from signsplice.train.product.networks.cutting import Cutting, CuttingConfig

HERE = Path(__file__).parent
SIZES = {
    "cutter": training.TrainingSchedule(CuttingConfig(16, 2, 1, 16, 2, 8, 16), 1, 2, 1e-3, 4),
    "transition": training.TrainingSchedule(BridgeConfig(16, 2, 1, 16), 1, 4, 1e-3, 4),
}


def main(target: Path) -> None:
    """Write the bundle into a folder."""
    with tempfile.TemporaryDirectory() as made:
        signing, parts = Path(made) / "signing", Path(made) / "parts"
        training_data.write(training_data.TrainingDataPlan(2, 4, 6, seed=4), signing, processes=1)
        learned, held = training.split(signing)
        folders = {}
        for name, course in SIZES.items():
            training.SCHEDULES[name, "tiny"] = course
            told = training.ProductTraining(name, "tiny")
            torch.manual_seed(1)
            task = training.build(told, training._data(told, learned, None))
            network = task.network
            assert isinstance(network, Bridge | Cutting)
            outs = [network.out] if isinstance(network, Bridge) else [network.leaving.out, network.entering.out]
            for layer in outs:
                torch.nn.init.normal_(layer.weight, std=0.2)
            with torch.no_grad():
                for weight in network.parameters():  # equal ones would become one in a graph
                    weight.add_(0.02 * torch.randn_like(weight))
            folder = parts / name
            folder.mkdir(parents=True)
            for file, content in training.product_graphs(task, training._data(told, held, 4)).items():
                (folder / file).write_bytes(content)
            facts = {"network": name, "scale": "tiny", "weights": "random", "config": asdict(course.config)}
            (folder / "facts.json").write_text(json.dumps(facts))
            folders[name] = folder
        training.assemble(target, folders)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else HERE / "tiny_bundle")
