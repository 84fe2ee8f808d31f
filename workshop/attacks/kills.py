"""Kills of everything that writes: ``python attacks/kills.py [SEED]``.

Each of five writers runs in a forked process, which is killed (SIGKILL) at a random moment of its work, 20 times each.
What it left is compared with the old and the new content, byte by byte; then the same call runs to its end. A table row
for each writer goes to standard output. Takes up to eight minutes.
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
"""Kills of each writer."""
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
    """What the kills of a writer did.

    kills: number that met the writer at work.
    lost: outputs that were gone. broken: that were neither the old nor the new ones.
    left: names that were there after the next run, beside the outputs. survivors: processes that ran on for 2 s.
    failed: next runs that failed.
    """

    kills: int = 0
    lost: int = 0
    broken: int = 0
    left: int = 0
    survivors: int = 0
    failed: int = 0
    names: set[str] = field(default_factory=set)


def command(folder: Path, *words: str) -> int:
    """The exit status of ``signsplice`` in a folder, in this process."""
    os.chdir(folder)
    sys.argv = ["signsplice", *words]
    try:
        cli.main()
    except SystemExit as stop:
        return int(stop.code or 0)
    return 0


# --- writers


def commands(inputs: Path) -> list[Writer]:
    """The writers; their inputs are made in a folder."""
    with lexicon.open_shipped_lexicon() as words:
        (inputs / "clips").mkdir()
        for gloss in words.glosses[:12]:
            save(words.clip(gloss), inputs / "clips" / f"{gloss}.bvh")
    one, two = sorted(map(str, (inputs / "clips").glob("*.bvh")))[:2]
    classical = ("--cutter", "pose-velocity", "--transition", "hermite", "--transition-time", "fixed")
    corpus = ("synth", "pairs", "-o", "pairs", "--words", "3", "--other-signer", "2")

    def make_old_lexicon(folder: Path) -> None:
        with lexicon.building(folder / "lex") as builder, lexicon.open_shipped_lexicon() as words:
            builder.add(words.clip(words.glosses[20]))

    def run(*call: str) -> Callable[[Path], None]:
        def write(folder: Path) -> None:
            if command(folder, *call):
                raise SystemExit(1)

        return write

    run(*corpus)(inputs)
    return [
        Writer(
            "splice -o", run("splice", one, two, "-o", "out.bvh", *classical),
            lambda folder: save(lexicon.open_shipped_lexicon().clip("I"), folder / "out.bvh"),
        ),
        Writer("lexicon build", run("lexicon", "build", str(inputs / "clips"), "-o", "lex"), make_old_lexicon),
        Writer("synth pairs", run(*corpus), lambda folder: None),
        Writer("checkpoints", train_parts(inputs / "pairs"), lambda folder: None),
        Writer(
            "export", _export,
            _old_bundle,
        ),
    ]  # fmt: skip


def _old_bundle(folder: Path) -> None:
    shutil.copytree(TINY, folder / "bundle")


def _export(folder: Path) -> None:
    export.halve_bundle(TINY, folder / "bundle")


def train_parts(pairs: Path) -> Callable[[Path], None]:
    """A training of the paper's smallest part, ten steps with a checkpoint after each."""

    def write(folder: Path) -> None:
        torch.set_num_threads(1)
        config = training.Training("lptransformer", "smoke", steps=10, n_judgements=10, n_judged=1)
        part = scales.parts("lptransformer", "smoke", None, 10)[0]
        training.train_part(part, config, Pairs(pairs), folder, Processes(0, 1, torch.device("cpu")))
        for log in [*folder.glob("*.jsonl"), *folder.glob("tensorboard")]:  # with times
            shutil.rmtree(log) if log.is_dir() else log.unlink()

    return write


# --- kills


def forked(call: Callable[[], object]) -> int:
    """The number of a new process that makes a call, without output."""
    child = os.fork()
    if child:
        return child
    status = 1
    try:
        nothing = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nothing, 1)
        os.dup2(nothing, 2)
        call()
        status = 0
    except SystemExit as stop:
        status = int(stop.code or 0) if isinstance(stop.code, int) else 1
    finally:
        os._exit(status)


def ended(process: int) -> int:
    """The exit status of a process, negative for a signal."""
    return os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])


def descendants(process: int) -> list[int]:
    """All processes below one."""
    try:
        text = Path(f"/proc/{process}/task/{process}/children").read_text()
    except OSError:
        return []
    children = [int(word) for word in text.split()]
    return children + [below for child in children for below in descendants(child)]


def is_running(process: int) -> bool:
    """Whether a process has not ended."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    except OSError:
        return False


def content(folder: Path) -> dict[str, Content]:
    """Visible name -> relative path -> bytes, logs apart; of a checkpoint those of its weights."""
    return {
        top.name: {str(path.relative_to(folder)): in_bytes(path) for path in (top, *top.rglob("*")) if path.is_file()}
        for top in folder.iterdir()
        if not top.name.startswith(".") and not top.name.endswith(".jsonl") and top.name != "tensorboard"
    }


def in_bytes(path: Path) -> bytes:
    """A file's bytes; of a checkpoint its step and weights, of a snapshot its weights: equal objects that are pickled
    may differ in bytes. None of an unfinished file.
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


def attack(writer: Writer, folder: Path, rng: random.Random, until: float) -> tuple[Tally, float]:
    """What the kills of a writer did, and how long its work takes, s."""
    whole = folder / "whole"
    whole.mkdir(parents=True)
    writer.prepare(whole)
    old = content(whole)
    began = time.perf_counter()
    if ended(forked(lambda: writer.write(whole))):
        raise SystemExit(f"{writer.name} fails without a kill")
    seconds = time.perf_counter() - began
    new = content(whole)
    tally = Tally()
    for number in range(4 * N_KILLS):
        if tally.kills == N_KILLS or time.monotonic() > until:
            break
        place = folder / str(number)
        place.mkdir()
        writer.prepare(place)
        process = forked(lambda place=place: writer.write(place))  # type: ignore[misc]
        time.sleep(rng.uniform(0.0, seconds))
        below = descendants(process)
        os.kill(process, signal.SIGKILL)
        if ended(process) != -signal.SIGKILL:
            continue  # it had finished
        tally.kills += 1
        tally.survivors += survivors(below)
        judge(tally, content(place), old, new, checkpointed=writer.name == "checkpoints")
        tally.failed += ended(forked(lambda place=place: writer.write(place))) != 0  # type: ignore[misc]
        found = content(place)
        tally.broken += sum(found.get(name) != new[name] for name in new)
        over = {name for name in os.listdir(place) if name not in new and not name.endswith(".jsonl")} - {"tensorboard"}
        tally.left += len(over)
        tally.names |= over
        shutil.rmtree(place)
    return tally, seconds


def survivors(processes: list[int]) -> int:
    """How many of some processes still run after two seconds; they are ended then."""
    until = time.monotonic() + 2.0
    while any(map(is_running, processes)) and time.monotonic() < until:
        time.sleep(0.02)
    running = [process for process in processes if is_running(process)]
    for process in running:
        with suppress(ProcessLookupError):
            os.kill(process, signal.SIGKILL)
    return len(running)


def judge(
    tally: Tally, found: dict[str, Content], old: dict[str, Content], new: dict[str, Content], checkpointed: bool
) -> None:
    """Add what a kill left: the old or the new content is whole, everything else is not. A checkpoint of a step in
    between is judged by the training that continues from it.
    """
    for name in old.keys() | new.keys():
        if name not in found:
            tally.lost += name in old
        elif BROKEN in found[name].values() or not (checkpointed or found[name] in (old.get(name), new.get(name))):
            tally.broken += 1


@contextmanager
def silenced() -> Iterator[None]:
    """Nothing goes to standard output within the block, nor from child processes."""
    sys.stdout.flush()
    standard, nothing = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nothing, 1)
    try:
        yield
    finally:
        sys.stdout.flush()
        os.dup2(standard, 1)
        os.close(standard)
        os.close(nothing)


def main() -> None:
    """Kill every writer and print the rows."""
    rng = random.Random(int(sys.argv[1]) if len(sys.argv) > 1 else 0)
    until = time.monotonic() + TIME_LIMIT_S
    print("| attack | seen |\n| --- | --- |", flush=True)
    with tempfile.TemporaryDirectory(prefix="signsplice-kills-", ignore_cleanup_errors=True) as top:
        folder = Path(top)
        (folder / "inputs").mkdir()
        with silenced():
            writers = commands(folder / "inputs")
        total = n_faults = 0
        for writer in writers:
            tally, seconds = attack(writer, folder / writer.name.replace(" ", "-"), rng, until)
            total += tally.kills
            n_faults += tally.lost + tally.broken + tally.failed + tally.left + tally.survivors
            print(
                f"| {tally.kills} kills within the {seconds:.2f} s of {writer.name} | lost {tally.lost}, broken "
                f"{tally.broken}, next runs that failed {tally.failed}, left over after them {tally.left} "
                f"{sorted(tally.names) or ''}, processes that outlived it by 2 s {tally.survivors} |",
                flush=True,
            )
        print(f"| all kills | {total} |", flush=True)
        os.chdir("/")
    sys.exit(n_faults > 0)


if __name__ == "__main__":
    main()
