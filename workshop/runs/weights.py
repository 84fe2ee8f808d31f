#!/usr/bin/env python
"""Makes the networks that ship from nothing, in parts of at most 80 minutes of two cores.

    signing   60 signers with 250 words and 300 seams each, from their seed; its hash is compared with the recorded one
    networks  the cutter on one core, the transition on the other
    ship      both in the bundle that ships

Every part writes its results into the folder of results: bundles with 16-bit weights, the logs of their trainings, and
a record of times and hashes. A part with a record is not made again, so that the work can go on in another checkout:
commit the folder between parts. The signing is never stored; it is made again.

    python workshop/runs/weights.py                    all parts, into out/weights and workshop/weights
    python workshop/runs/weights.py networks ship      these, with the signing of the record
    python workshop/runs/weights.py --smoke -o DIR     the same script at toy size, all in DIR
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import resource
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from signsplice.splicing.bundle import WEIGHTS, read_config, read_file
from signsplice_workshop.corpora.motion_version import MOTION_VERSION
from signsplice_workshop.train.bundles import write_bundle

ROOT = Path(__file__).parents[2]
NETWORKS = ("cutter", "transition")


@dataclass(frozen=True)
class Run:
    """Folders and size of a run.

    work: folder for signing and checkpoints, which need not last.
    results: folder of the results of the parts.
    shipped: the bundle to write.
    smoke: whether everything has toy size.
    """

    work: Path
    results: Path
    shipped: Path
    smoke: bool

    @property
    def signing(self) -> Path:
        """The folder of signing."""
        return self.work / "signing"


def make_signing(run: Run) -> dict[str, Any]:
    """Makes the signing that is missing; returns the hash of all of it."""
    n_signers, n_words, n_seams = (3, 6, 6) if run.smoke else (60, 250, 300)
    signing = ["--signers", str(n_signers), "--words", str(n_words), "--seams", str(n_seams)]
    call_all(["synth", "endless", *signing, "-o", str(run.signing)])
    digest = hashlib.sha256()
    for path in sorted(run.signing.glob("signer-*.npz")):
        digest.update(path.read_bytes())
    return {"motion": MOTION_VERSION, "sha256": digest.hexdigest()}


def make_networks(run: Run) -> dict[str, Any]:
    """Trains both networks from random weights; returns their hashes."""
    scale = "smoke" if run.smoke else "ship"
    options = ("--signing", str(run.signing), "--scale", scale)
    call_all(*(["train", name, *options, "--out", str(run.work / name)] for name in NETWORKS))
    for name in NETWORKS:
        call_all(["export", str(run.work / name), "-o", str(run.results / name)])
        (recipe,) = (network["recipe"] for network in read_config(run.results / name).stored["networks"].values())
        (log,) = run.work.glob(f"parts/{name}-*-{recipe}/log.jsonl")
        shutil.copyfile(log, run.results / f"{name}.jsonl")
    return {name: hash_graphs(run.results / name) for name in NETWORKS}


def make_shipped(run: Run) -> dict[str, Any]:
    """Writes both networks into the bundle that ships; returns its hash."""
    parts = {name: read_config(run.results / name) for name in NETWORKS}
    facts = {key: value for key, value in parts["cutter"].stored.items() if key not in ("version", "files")}
    facts["networks"] = {name: config.stored["networks"][name] for name, config in parts.items()}
    facts["halved"] = {name: config.stored["halved"]["bundle"] for name, config in parts.items()}
    files = {file: read_file(run.results / name, part, file) for name, part in parts.items() for file in part.files}
    write_bundle(run.shipped, facts, files)
    return {"bundle": hash_graphs(run.shipped)}


def hash_graphs(bundle: Path) -> str:
    """Returns the hash of a bundle's graphs."""
    return hashlib.sha256("".join(read_config(bundle).files.values()).encode()).hexdigest()


PARTS: dict[str, Callable[[Run], dict[str, Any]]] = {
    "signing": make_signing, "networks": make_networks, "ship": make_shipped
}  # fmt: skip


def call_all(*commands: Sequence[str]) -> None:
    """Runs commands of signsplice side by side, each on one thread. Exits if one fails, and ends the others."""
    environment = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    running = []
    for words in commands:
        print("signsplice", *words, flush=True)
        running.append(subprocess.Popen([sys.executable, "-m", "signsplice", *words], env=environment))
    try:
        while any(process.poll() is None for process in running):
            if any(process.poll() for process in running):
                break
            time.sleep(0.2)
    finally:
        for process in running:
            process.terminate()
        codes = [process.wait() for process in running]
    if any(codes):
        raise SystemExit(f"a command failed (exit codes {codes}); the same call continues")


def make_part(run: Run, name: str) -> None:
    """Makes a part and writes its record; compares the hashes with those of an earlier record, if there is one."""
    record = run.results / f"{name}.json"
    recorded = json.loads(record.read_text(encoding="utf-8"))["made"] if record.exists() else None
    if recorded is not None and name != "signing":
        print(f"{name}: is there already ({record}); remove it to make this part again")
        return
    start, start_processor_s = time.perf_counter(), _measure_processor_seconds()
    hashes = PARTS[name](run)
    if recorded is not None and hashes != recorded:
        raise SystemExit(f"{name}: {hashes} is not what {record} says, {recorded}: the signer has changed; start anew")
    if recorded is None:
        minutes = {
            "minutes": time.perf_counter() - start,
            "processor_minutes": _measure_processor_seconds() - start_processor_s,
        }
        facts = {"made": hashes, **{key: round(seconds / 60.0, 1) for key, seconds in minutes.items()}}
        record.write_text(json.dumps(facts, indent=1) + "\n", encoding="utf-8")
    print(f"{name}: {hashes}")


def _measure_processor_seconds() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def main(arguments: Sequence[str] | None = None) -> None:
    """Makes the parts that are asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"some of {', '.join(PARTS)}  [default: all]")
    parser.add_argument("-o", "--out", type=Path, help="folder to work in  [default: out/weights]")
    parser.add_argument("--smoke", action="store_true", help="at toy size, with results and bundle in the same folder")
    options = parser.parse_args(arguments)
    unknown = [name for name in options.parts if name not in PARTS]
    if unknown:
        parser.error(f"no part {unknown[0]!r}, expected some of {', '.join(PARTS)}")
    if options.smoke and options.out is None:
        parser.error("--smoke needs -o DIR")
    os.chdir(ROOT)
    work = options.out or Path("out/weights")
    results, shipped = (work / "results", work / "bundle") if options.smoke else (Path("workshop/weights"), WEIGHTS)
    run = Run(work, results, shipped, options.smoke)
    results.mkdir(parents=True, exist_ok=True)
    for name in options.parts or PARTS:
        if name == "networks" and "signing" not in (options.parts or PARTS):
            make_part(run, "signing")
        make_part(run, name)


if __name__ == "__main__":
    main()
