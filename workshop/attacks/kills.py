"""Kills everything that writes: ``python attacks/kills.py [SEED]``.

Each of five writers runs in a forked process, which is killed (SIGKILL) at a random moment of its work, 20 times each.
Its output is compared with the old and the new content, byte by byte; then the same call runs to its end. Prints a
table row for each writer. Takes up to eight minutes.
"""

from __future__ import annotations

import os
import random
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import psutil
import torch

from signsplice import cli, lexicon
from signsplice.errors import InputError
from signsplice.formats import save
from signsplice_paper.train import scales, training
from signsplice_workshop.corpora.pairs import Pairs
from signsplice_workshop.train import checkpoint, export
from signsplice_workshop.train.processes import Processes

os.environ.setdefault("OMP_NUM_THREADS", "1")


N_KILLS = 20
"""Number of kills of each writer."""
TIME_LIMIT_S = 480.0
TINY = Path(__file__).resolve().parents[2] / "tests" / "golden" / "tiny_bundle"
BROKEN = b"cannot be read"
RESULTS = {
    "lost": "lost", "broken": "neither old nor new", "failed": "next runs that failed",
    "left over": "left over after them", "survivors": "processes that outlived it by 2 s",
}  # fmt: skip
"""What is counted of the outputs and processes of a writer after kills."""
Content = dict[str, bytes]


@dataclass(frozen=True)
class Writer:
    """Something that writes.

    name: for the table.
    write: the call, in a folder.
    prepare: puts the older output into a folder.
    """

    name: str
    write: Callable[[Path], object]
    prepare: Callable[[Path], object]


# --- writers


def make_writers(inputs: Path) -> list[Writer]:
    """Makes the writers, and their inputs in a folder."""
    with lexicon.open_shipped_lexicon() as words:
        (inputs / "clips").mkdir()
        for gloss in words.glosses[:12]:
            save(words.clip(gloss), inputs / "clips" / f"{gloss}.bvh")
    first, second = sorted(map(str, (inputs / "clips").glob("*.bvh")))[:2]
    classical = ("--cutter", "pose-velocity", "--transition", "hermite", "--transition-time", "fixed")
    corpus = ("synth", "pairs", "-o", "pairs", "--words", "3", "--other-signer", "2")

    def make_old_lexicon(folder: Path) -> None:
        with lexicon.building(folder / "lex") as builder, lexicon.open_shipped_lexicon() as words:
            builder.add(words.clip(words.glosses[20]))

    def run(*call: str) -> Callable[[Path], None]:
        def write(folder: Path) -> None:
            os.chdir(folder)
            sys.argv = ["signsplice", *call]
            cli.main()

        return write

    if wait_for(fork(lambda: run(*corpus)(inputs))):
        raise SystemExit("the pairs to train with cannot be made")
    return [
        Writer(
            "splice -o", run("splice", first, second, "-o", "out.bvh", *classical),
            lambda folder: save(lexicon.open_shipped_lexicon().clip("I"), folder / "out.bvh"),
        ),
        Writer("lexicon build", run("lexicon", "build", str(inputs / "clips"), "-o", "lex"), make_old_lexicon),
        Writer("synth pairs", run(*corpus), lambda folder: None),
        Writer("checkpoints", make_training_writer(inputs / "pairs"), lambda folder: None),
        Writer(
            "export", lambda folder: export.halve_bundle(TINY, folder / "bundle"),
            lambda folder: shutil.copytree(TINY, folder / "bundle"),
        ),
    ]  # fmt: skip


def make_training_writer(pairs: Path) -> Callable[[Path], None]:
    """Returns a writer that trains the paper's smallest part, ten steps with a checkpoint after each."""

    def write(folder: Path) -> None:
        torch.set_num_threads(1)
        config = training.Training("lptransformer", "smoke", steps=10, n_judgements=10, n_judged=1)
        part = scales.make_parts("lptransformer", "smoke", None, 10)[0]
        training.train_part(part, config, Pairs(pairs), folder, Processes(0, 1, torch.device("cpu")))
        for log in [*folder.glob("*.jsonl"), *folder.glob("tensorboard")]:  # they contain times
            shutil.rmtree(log) if log.is_dir() else log.unlink()

    return write


# --- kills


def fork(call: Callable[[], object]) -> int:
    """Forks a process that makes a call without output, and returns its number."""
    child = os.fork()
    if child:
        return child
    status = 1
    try:
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, 1)
        os.dup2(null, 2)
        call()
        status = 0
    except SystemExit as stop:
        status = int(stop.code or 0) if isinstance(stop.code, int) else 1
    finally:
        os._exit(status)


def wait_for(process: int) -> int:
    """Waits for a process and returns its exit status, negative for a signal."""
    return os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])


def read_folder(folder: Path) -> dict[str, Content]:
    """Returns visible name -> relative path -> bytes, without logs; of a checkpoint the bytes of its weights."""
    return {
        top.name: {str(path.relative_to(folder)): read_file(path) for path in (top, *top.rglob("*")) if path.is_file()}
        for top in folder.iterdir()
        if not top.name.startswith(".") and not top.name.endswith(".jsonl") and top.name != "tensorboard"
    }


def read_file(path: Path) -> bytes:
    """Returns a file's bytes; of a checkpoint its step and weights, of a snapshot its weights: equal objects that are
    pickled may differ in bytes. Returns no bytes of an unfinished file.
    """
    if path.name.startswith("."):
        return b""
    if path.parent.name == "snapshots":
        weights = torch.load(path, weights_only=True)
        return b"".join(weights[name].numpy().tobytes() for name in sorted(weights))
    if path.name != checkpoint.NAME:
        return path.read_bytes()
    try:
        state = checkpoint.read(path.parent)
    except InputError:
        return BROKEN
    weights = [state["network"][name].numpy().tobytes() for name in sorted(state["network"])]
    return b"%d " % state["step"] + b"".join(weights)


def attack(writer: Writer, folder: Path, rng: random.Random, deadline: float) -> tuple[Counter[str], set[str], float]:
    """Returns the results of the kills of a writer (``RESULTS``), what was left over, and the time of its work, s."""
    undisturbed = folder / "whole"
    undisturbed.mkdir(parents=True)
    writer.prepare(undisturbed)
    old = read_folder(undisturbed)
    start = time.perf_counter()
    if wait_for(fork(lambda: writer.write(undisturbed))):
        raise SystemExit(f"{writer.name} fails without a kill")
    seconds = time.perf_counter() - start
    new = read_folder(undisturbed)
    counts, left_over = Counter[str](), set[str]()
    for number in range(4 * N_KILLS):
        if counts["kills"] == N_KILLS or time.monotonic() > deadline:
            break
        run_folder = folder / str(number)
        run_folder.mkdir()
        writer.prepare(run_folder)
        write = partial(writer.write, run_folder)
        process = fork(write)
        time.sleep(rng.uniform(0.0, seconds))
        children = psutil.Process(process).children(recursive=True)
        os.kill(process, signal.SIGKILL)
        if wait_for(process) != -signal.SIGKILL:
            continue  # it had already finished
        counts["kills"] += 1
        counts["survivors"] += count_survivors(children)
        counts += judge(read_folder(run_folder), old, new, has_checkpoints=writer.name == "checkpoints")
        counts["failed"] += wait_for(fork(write)) != 0
        contents = read_folder(run_folder)
        counts["broken"] += sum(contents.get(name) != new[name] for name in new)
        extras = {n for n in os.listdir(run_folder) if n not in new and not n.endswith(".jsonl")} - {"tensorboard"}
        counts["left over"] += len(extras)
        left_over |= extras
        shutil.rmtree(run_folder)
    return counts, left_over, seconds


def count_survivors(processes: list[psutil.Process]) -> int:
    """Returns how many processes still run after two seconds, and ends them."""

    def is_running(process: psutil.Process) -> bool:
        with suppress(psutil.NoSuchProcess):
            return process.is_running() and process.status() != psutil.STATUS_ZOMBIE
        return False

    deadline = time.monotonic() + 2.0
    while (running := list(filter(is_running, processes))) and time.monotonic() < deadline:
        time.sleep(0.02)
    for process in running:
        with suppress(psutil.NoSuchProcess):
            process.kill()
    return len(running)


def judge(
    state: dict[str, Content], old: dict[str, Content], new: dict[str, Content], has_checkpoints: bool
) -> Counter[str]:
    """Judges the state after a kill: the old or the new content is whole, everything else is not. A checkpoint of a
    step in between is judged by the training that continues from it.
    """
    counts = Counter[str]()
    for name in old.keys() | new.keys():
        if name not in state:
            counts["lost"] += name in old
        elif BROKEN in state[name].values() or not (has_checkpoints or state[name] in (old.get(name), new.get(name))):
            counts["broken"] += 1
    return counts


def main() -> None:
    """Kills every writer and prints the rows."""
    rng = random.Random(int(sys.argv[1]) if len(sys.argv) > 1 else 0)
    deadline = time.monotonic() + TIME_LIMIT_S
    print("| attack | seen |\n| --- | --- |", flush=True)
    totals = Counter[str]()
    with tempfile.TemporaryDirectory(prefix="signsplice-kills-", ignore_cleanup_errors=True) as top:
        folder = Path(top)
        (folder / "inputs").mkdir()
        for writer in make_writers(folder / "inputs"):
            counts, left_over, seconds = attack(writer, folder / writer.name.replace(" ", "-"), rng, deadline)
            totals += counts
            results = ", ".join(f"{text} {counts[result]}" for result, text in RESULTS.items())
            names = f" ({', '.join(sorted(left_over))})" if left_over else ""
            print(
                f"| {counts['kills']} kills within the {seconds:.2f} s of {writer.name} | {results}{names} |",
                flush=True,
            )
        print(f"| all kills | {totals['kills']} |", flush=True)
        os.chdir("/")
    sys.exit(any(totals[result] for result in RESULTS))


if __name__ == "__main__":
    main()
