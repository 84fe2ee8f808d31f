r"""Trains the network for positions of a system alone, and puts it into a bundle whose frames come from a trained one.

LpTransformer's two networks are trained apart, so a system that differs from a trained one in the positions' loss alone
needs half of a training. Called again after an interruption, it continues.

    python research/runs/positions_anew.py --system lpt-printed-equal \
        --frames research/bundles/lpt-printed-cpu-adamw-random
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

from signsplice.splicing.networks.bundle import bundle_sha256, read_file, write_bundle
from signsplice.synth.corpus import Pairs
from signsplice.train import provenance
from signsplice.train.processes import joined
from signsplice_paper.configs import read_config
from signsplice_paper.train import stopping
from signsplice_paper.train.graphs import paper_graphs
from signsplice_paper.train.half_weights import halved
from signsplice_paper.train.pairs_data import PairsData
from signsplice_paper.train.scales import UNBIASED, parts
from signsplice_paper.train.tasks import token_bias
from signsplice_paper.train.training import Training, part_folder, trained


def main() -> None:
    """Train, then write OUT/SYSTEM-cpu-adamw-random with weights of 16 bits."""
    ask = argparse.ArgumentParser(description=__doc__)
    ask.add_argument("--system", required=True)
    ask.add_argument("--frames", type=Path, required=True, help="bundle that has the network for frames")
    ask.add_argument("--pairs", type=Path, default=Path("out/pairs"))
    ask.add_argument("--out", type=Path, default=Path("out/bundles"))
    ask.add_argument("--seed", type=int, default=0)
    ask.add_argument("--steps", type=int, help="in place of the scale's")
    ask.add_argument("--minutes", type=float, help="stop after so many; the same call continues")
    given = ask.parse_args()
    source, pairs = read_config(given.frames), Pairs(given.pairs)
    deadline = None if given.minutes is None else time.monotonic() + 60.0 * given.minutes
    training = Training(given.system, str(source.scale), seed=given.seed, steps=given.steps, deadline=deadline)
    part = parts(training.system, training.scale, steps=training.steps)[0]
    folder = part_folder(given.out / "parts", part, training, pairs)
    folder.mkdir(parents=True, exist_ok=True)
    with joined("cpu") as process:
        made = trained(part, training, pairs, folder, process)
    step, why = stopping.reason(folder, part.steps, training.patience)
    kept = {name: entry for name, entry in source.stored["parts"].items() if not name.startswith("spsn")}
    runs = dict(source.stored["runs"])
    if training.system not in UNBIASED:
        runs["token_bias"] = token_bias(made, PairsData(pairs, training.split, "valid"))
    command = ["python", "research/runs/positions_anew.py", "--system", training.system, "--frames", str(given.frames)]
    command += ["--pairs", "pairs", "--seed", str(given.seed)]
    command += [] if given.steps is None else ["--steps", str(given.steps)]
    facts = {k: v for k, v in part.facts().items() if k != "config"} | {"steps": step, "stopped": why}
    stored = {k: v for k, v in source.stored.items() if k not in ("version", "files", "halved", "data")} | {
        "system": training.system,
        "seed": training.seed,
        "steps": step + sum(entry["steps"] for entry in kept.values()),
        "config": {part.name: part.facts()["config"]} | {name: source.stored["config"][name] for name in kept},
        "parts": {part.name: facts, **kept},
        "runs": runs,
        "frames_from": bundle_sha256(given.frames),
        "command": command,
        "signsplice": provenance.software(),
    }
    files = {name: read_file(given.frames, source, name) for name in source.files if name != "spsn.onnx"}
    files["spsn.onnx"] = halved(paper_graphs(made.network, part.fr)["spsn.onnx"])
    write_bundle(given.out / f"{training.system}-{training.scale}-{training.optimiser}-{training.split}", stored, files)


if __name__ == "__main__":
    main()
