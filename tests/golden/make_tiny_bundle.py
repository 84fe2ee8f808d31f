"""Makes tests/golden/tiny_bundle: the product's networks at toy size with random weights, as training exports them.

    python tests/golden/make_tiny_bundle.py [FOLDER]

Needs the `train` extra. The networks' answers mean nothing; tests check that they are the same on every rig, at every
rate and for either hand.
"""

from __future__ import annotations

import json
import sys
import tempfile
from dataclasses import asdict
from pathlib import Path

import torch

from signsplice_workshop.corpora import training_data
from signsplice_workshop.train import training
from signsplice_workshop.train.export import export_product_graphs
from signsplice_workshop.train.networks import Bridge, BridgeConfig, Cutting, CuttingConfig

HERE = Path(__file__).parent
SCHEDULES = {
    "cutter": training.TrainingSchedule(CuttingConfig(16, 2, 1, 16, 2, 8, 16), 1, 2, 1e-3, 4),
    "transition": training.TrainingSchedule(BridgeConfig(16, 2, 1, 16), 1, 4, 1e-3, 4),
}


def main(target: Path) -> None:
    """Write the bundle into a folder."""
    with tempfile.TemporaryDirectory() as temporary:
        signing, parts = Path(temporary) / "signing", Path(temporary) / "parts"
        training_data.write(training_data.TrainingDataPlan(2, 4, 6, seed=4), signing, processes=1)
        train_paths, held_back = training.split(signing)
        folders = {}
        for name, schedule in SCHEDULES.items():
            training.SCHEDULES[name, "tiny"] = schedule
            config = training.ProductTraining(name, "tiny")
            torch.manual_seed(1)
            task = training.build(config, training.open_dataset(config, train_paths))
            network = task.network
            assert isinstance(network, Bridge | Cutting)
            last_layers = [network.out] if isinstance(network, Bridge) else [network.leaving.out, network.entering.out]
            for layer in last_layers:
                torch.nn.init.normal_(layer.weight, std=0.2)
            with torch.no_grad():
                for weight in network.parameters():  # equal weights would become one in a graph
                    weight.add_(0.02 * torch.randn_like(weight))
            folder = parts / name
            folder.mkdir(parents=True)
            for file, content in export_product_graphs(task, training.open_dataset(config, held_back, 4)).items():
                (folder / file).write_bytes(content)
            facts = {"network": name, "scale": "tiny", "weights": "random", "config": asdict(schedule.config)}
            (folder / "facts.json").write_text(json.dumps(facts))
            folders[name] = folder
        training.assemble(target, folders)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else HERE / "tiny_bundle")
