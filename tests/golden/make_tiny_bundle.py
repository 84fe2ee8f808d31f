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

from signsplice.synth import endless
from signsplice.train import own
from signsplice.train.networks.bridge import Bridge, BridgeConfig
from signsplice.train.networks.cutting import Cutting, CuttingConfig

HERE = Path(__file__).parent
SIZES = {
    "cutter": own.Course(CuttingConfig(16, 2, 1, 16, 2, 8, 16), 1, 2, 1e-3, 4),
    "transition": own.Course(BridgeConfig(16, 2, 1, 16), 1, 4, 1e-3, 4),
}


def main(target: Path) -> None:
    """Write the bundle into a folder."""
    with tempfile.TemporaryDirectory() as made:
        signing, parts = Path(made) / "signing", Path(made) / "parts"
        endless.write(endless.Plan(2, 4, 6, seed=4), signing, processes=1)
        learned, held = own.split(signing)
        folders = {}
        for name, course in SIZES.items():
            own.COURSES[name, "tiny"] = course
            told = own.Own(name, "tiny")
            torch.manual_seed(1)
            task = own.build(told, own._data(told, learned, None))
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
            for file, content in own.graphs(task, own._data(told, held, 4)).items():
                (folder / file).write_bytes(content)
            facts = {"network": name, "scale": "tiny", "weights": "random", "config": asdict(course.config)}
            (folder / "facts.json").write_text(json.dumps(facts))
            folders[name] = folder
        own.assemble(target, folders)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else HERE / "tiny_bundle")
