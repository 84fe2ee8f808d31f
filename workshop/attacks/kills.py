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
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

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
Content = dict[str, bytes]


@dataclass(frozen=True)
class Writer:
    """Something that writes.

    name: for the table.
    write: the call, in a folder.
    prepare: puts the older output into a folder.
    """

    name: str
    write: Callable[[Path], None]
    prepare: Callable[[Path], None]


@dataclass
class Tally:
    """Results of the kills of a writer.

    kills: number of kills that met the writer at work.
    lost: outputs that were gone. broken: outputs that were neither old nor new.
    left_over: names present after the next run besides the outputs. survivors: processes that ran on for 2 s.
    failed: next runs that failed.
    """

    kills: int = 0
    lost: int = 0
    broken: int = 0
    left_over: int = 0
    survivors: int = 0
    failed: int = 0
    names: set[str] = field(default_factory=set)


def run_command(folder: Path, *words: str) -> int:
    """Returns the exit status of ``signsplice`` in a folder, in this process."""
    os.chdir(folder)
    sys.argv = ["signsplice", *words]
    try:
        cli.main()
    except SystemExit as stop:
        return int(stop.code or 0)
    return 0


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
            if run_command(folder, *call):
                raise SystemExit(1)

        return write

    run(*corpus)(inputs)
    return [
        Writer(
            "splice -o", run("splice", first, second, "-o", "out.bvh", *classical),
            lambda folder: save(lexicon.open_shipped_lexicon().clip("I"), folder / "out.bvh"),
        ),
        Writer("lexicon build", run("lexicon", "build", str(inputs / "clips"), "-o", "lex"), make_old_lexicon),
        Writer("synth pairs", run(*corpus), lambda folder: None),
        Writer("checkpoints", make_training_writer(inputs / "pairs"), lambda folder: None),
        Writer(
            "export", _export_bundle,
            _copy_old_bundle,
        ),
    ]  # fmt: skip


def _copy_old_bundle(folder: Path) -> None:
    shutil.copytree(TINY, folder / "bundle")


def _export_bundle(folder: Path) -> None:
    export.halve_bundle(TINY, folder / "bundle")


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


def list_descendants(process: int) -> list[int]:
    """Returns all processes below one."""
    try:
        text = Path(f"/proc/{process}/task/{process}/children").read_text()
    except OSError:
        return []
    children = [int(word) for word in text.split()]
    return children + [below for child in children for below in list_descendants(child)]


def is_running(process: int) -> bool:
    """Returns whether a process has not ended."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    except OSError:
        return False


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


def attack(writer: Writer, folder: Path, rng: random.Random, deadline: float) -> tuple[Tally, float]:
    """Returns the results of the kills of a writer, and the time that its work takes, s."""
    undisturbed = folder / "whole"
    undisturbed.mkdir(parents=True)
    writer.prepare(undisturbed)
    old = read_folder(undisturbed)
    start = time.perf_counter()
    if wait_for(fork(lambda: writer.write(undisturbed))):
        raise SystemExit(f"{writer.name} fails without a kill")
    seconds = time.perf_counter() - start
    new = read_folder(undisturbed)
    tally = Tally()
    for number in range(4 * N_KILLS):
        if tally.kills == N_KILLS or time.monotonic() > deadline:
            break
        run_folder = folder / str(number)
        run_folder.mkdir()
        writer.prepare(run_folder)
        process = fork(lambda run_folder=run_folder: writer.write(run_folder))  # type: ignore[misc]
        time.sleep(rng.uniform(0.0, seconds))
        children = list_descendants(process)
        os.kill(process, signal.SIGKILL)
        if wait_for(process) != -signal.SIGKILL:
            continue  # it had already finished
        tally.kills += 1
        tally.survivors += count_survivors(children)
        judge(tally, read_folder(run_folder), old, new, has_checkpoints=writer.name == "checkpoints")
        tally.failed += wait_for(fork(lambda run_folder=run_folder: writer.write(run_folder))) != 0  # type: ignore[misc]
        contents = read_folder(run_folder)
        tally.broken += sum(contents.get(name) != new[name] for name in new)
        extras = {n for n in os.listdir(run_folder) if n not in new and not n.endswith(".jsonl")} - {"tensorboard"}
        tally.left_over += len(extras)
        tally.names |= extras
        shutil.rmtree(run_folder)
    return tally, seconds


def count_survivors(processes: list[int]) -> int:
    """Returns how many processes still run after two seconds, and ends them."""
    deadline = time.monotonic() + 2.0
    while any(map(is_running, processes)) and time.monotonic() < deadline:
        time.sleep(0.02)
    running = [process for process in processes if is_running(process)]
    for process in running:
        with suppress(ProcessLookupError):
            os.kill(process, signal.SIGKILL)
    return len(running)


def judge(
    tally: Tally, state: dict[str, Content], old: dict[str, Content], new: dict[str, Content], has_checkpoints: bool
) -> None:
    """Adds the state after a kill: the old or the new content is whole, everything else is not. A checkpoint of a step
    in between is judged by the training that continues from it.
    """
    for name in old.keys() | new.keys():
        if name not in state:
            tally.lost += name in old
        elif BROKEN in state[name].values() or not (has_checkpoints or state[name] in (old.get(name), new.get(name))):
            tally.broken += 1


@contextmanager
def silence_output() -> Iterator[None]:
    """Silences standard output within the block, also of child processes."""
    sys.stdout.flush()
    old_output, null = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 1)
    try:
        yield
    finally:
        sys.stdout.flush()
        os.dup2(old_output, 1)
        os.close(old_output)
        os.close(null)


def main() -> None:
    """Kills every writer and prints the rows."""
    rng = random.Random(int(sys.argv[1]) if len(sys.argv) > 1 else 0)
    deadline = time.monotonic() + TIME_LIMIT_S
    print("| attack | seen |\n| --- | --- |", flush=True)
    with tempfile.TemporaryDirectory(prefix="signsplice-kills-", ignore_cleanup_errors=True) as top:
        folder = Path(top)
        (folder / "inputs").mkdir()
        with silence_output():
            writers = make_writers(folder / "inputs")
        total = n_faults = 0
        for writer in writers:
            tally, seconds = attack(writer, folder / writer.name.replace(" ", "-"), rng, deadline)
            total += tally.kills
            n_faults += tally.lost + tally.broken + tally.failed + tally.left_over + tally.survivors
            print(
                f"| {tally.kills} kills within the {seconds:.2f} s of {writer.name} | lost {tally.lost}, broken "
                f"{tally.broken}, next runs that failed {tally.failed}, left over after them {tally.left_over} "
                f"{sorted(tally.names) or ''}, processes that outlived it by 2 s {tally.survivors} |",
                flush=True,
            )
        print(f"| all kills | {total} |", flush=True)
        os.chdir("/")
    sys.exit(n_faults > 0)


if __name__ == "__main__":
    main()
