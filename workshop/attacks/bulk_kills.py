"""Kills of runs in bulk: ``python attacks/bulk_kills.py [--kills N] [--recipes N] [--seed N] [--ray]``.

A run makes sentences in shards while its processes are killed (SIGKILL) at random moments: workers or the driver; with
``--ray`` actors, a node of a Ray cluster of two, or the driver. A driver that was killed is called again. What is made
in the end is compared with what an undisturbed run made, byte by byte. A table goes to standard output.
"""

from __future__ import annotations

import argparse
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import psutil

from signsplice.bulk.cluster import LOOPBACK

N_RECIPES, SHARD_SIZE = 240, 6
TIME_LIMIT_S = 1500.0
_STARTS = 5
Content = dict[str, bytes]
Kill = Callable[[psutil.Process], bool]


def signsplice(*arguments: str | Path) -> list[str]:
    """The command line of a call."""
    return [sys.executable, "-m", "signsplice", *map(str, arguments)]


def content(out: Path) -> Content:
    """All files of a folder of shards."""
    return {str(path.relative_to(out)): path.read_bytes() for path in sorted(out.rglob("*")) if path.is_file()}


def undisturbed(folder: Path, n_recipes: int) -> tuple[list[str | Path], Content]:
    """The call without its folder and workers, and what it makes in one go by one worker."""
    table, out = folder / "recipes.csv", folder / "undisturbed"
    subprocess.run(signsplice("bulk", "recipes", "-o", table, "--count", str(n_recipes), "--words", "2:4"), check=True)
    call: list[str | Path] = ["bulk", "sentences", table, "--shard-size", str(SHARD_SIZE)]
    subprocess.run(signsplice(*call, "--workers", "1", "-o", out), check=True)
    return call, content(out)


def kill_worker(driver: psutil.Process, rng: random.Random, marks: tuple[str, ...] = ("spawn_main",)) -> bool:
    """Kill one of the processes that make shards; False where there is none yet."""
    found = []
    for process in driver.children(recursive=True) if marks == ("spawn_main",) else psutil.process_iter():
        with suppress(psutil.Error):
            line = " ".join(process.cmdline())
            if any(mark in line for mark in marks) and "resource_tracker" not in line:
                found.append(process)
    if found:
        rng.choice(found).kill()
    return bool(found)


def disturbed(
    call: list[str | Path], out: Path, where: list[str], kills: dict[str, Kill], n_kills: int, rng: random.Random
) -> Counter[str]:
    """Run ``call`` into ``out`` until it ends, with up to ``n_kills`` kills of kinds drawn at random: how many of each.

    Raises ``TimeoutError`` where it takes longer than ``TIME_LIMIT_S``.
    """
    done: Counter[str] = Counter()
    until = time.monotonic() + TIME_LIMIT_S
    while True:
        driver = psutil.Popen(signsplice(*call, *where, "-o", out), stdout=subprocess.DEVNULL)
        try:
            n_whole = len(list(out.glob("index/*.parquet")))
            while driver.poll() is None:
                if time.monotonic() > until:
                    raise TimeoutError(f"{out}: not finished after {TIME_LIMIT_S:.0f} s and {done.total()} kills")
                time.sleep(rng.uniform(0.05, 0.5))
                n_now = len(list(out.glob("index/*.parquet")))
                if done.total() == n_kills or (n_now == n_whole and rng.random() < 0.97):  # a few before any progress
                    continue
                kind = rng.choice(sorted(kills))
                time.sleep(rng.uniform(0.0, 0.3))
                with suppress(psutil.NoSuchProcess):
                    if kills[kind](driver):
                        done[kind] += 1
                        n_whole = len(list(out.glob("index/*.parquet")))
        finally:
            with suppress(psutil.NoSuchProcess):
                driver.kill()
        if driver.wait() == 0:
            return done
        if driver.returncode != -9:
            raise RuntimeError(f"{out}: the call ended with status {driver.returncode}")


def kill_driver(driver: psutil.Process) -> bool:
    """Kill the process that was called."""
    driver.kill()
    return True


@contextmanager
def two_nodes(rng: random.Random) -> Iterator[tuple[str, dict[str, Kill]]]:
    """The address of a Ray cluster of two nodes on this machine, a processor each, and how to kill what is in it."""
    os.environ |= {"RAY_USAGE_STATS_ENABLED": "0", LOOPBACK: "0"}
    from ray.cluster_utils import Cluster

    node: dict[str, Any] = {"num_cpus": 1, "node_ip_address": "127.0.0.1", "object_store_memory": 100 << 20}
    cluster = Cluster(initialize_head=True, head_node_args={**node, "include_dashboard": False})

    def start() -> Any:
        for _ in range(_STARTS - 1):
            with suppress(Exception):  # Ray waits half a minute for a node, which a busy machine may need
                return cluster.add_node(**node)
        return cluster.add_node(**node)

    nodes = [start()]

    def kill_node(_: psutil.Process) -> bool:
        cluster.remove_node(nodes.pop(), allow_graceful=False)
        nodes.append(start())
        return True

    kills: dict[str, Kill] = {
        "actor": lambda driver: kill_worker(driver, rng, ("ray::MapWorker", "ray::ShardActor")),
        "node": kill_node,
        "driver": kill_driver,
    }
    try:
        yield cluster.address, kills
    finally:
        cluster.shutdown()


def attack(folder: Path, n_kills: int, on_ray: bool, seed: int = 0, n_recipes: int = N_RECIPES) -> Counter[str]:
    """Kill runs until there were ``n_kills`` kills; each run must make what an undisturbed one makes. Raises
    ``AssertionError`` where one does not.
    """
    rng = random.Random(seed)
    call, expected = undisturbed(folder, n_recipes)
    done: Counter[str] = Counter()

    def run(where: list[str], kills: dict[str, Kill]) -> None:
        while done.total() < n_kills:
            out = folder / "disturbed"
            made = disturbed(call, out, where, kills, n_kills - done.total(), rng)
            found = content(out)
            assert found == expected, sorted(set(found) ^ set(expected)) or "bytes differ"
            print(f"{'Ray' if on_ray else 'processes'}: {dict(made)}, {len(found)} files equal", flush=True)
            done.update(made)
            shutil.rmtree(out)

    if on_ray:
        with two_nodes(rng) as (address, kills):
            run(["--ray", address], kills)
    else:
        run(["--workers", "2"], {"worker": lambda driver: kill_worker(driver, rng), "driver": kill_driver})
    return done


def main() -> None:
    """Run the attack and print its table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--recipes", type=int, default=N_RECIPES)
    parser.add_argument("--ray", action="store_true")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        done = attack(Path(folder), options.kills, options.ray, options.seed, options.recipes)
    print("| killed | times | what was made in the end |\n| --- | --- | --- |")
    for kind, n in sorted(done.items()):
        print(f"| {kind} | {n} | equal to the undisturbed run, byte by byte |")


if __name__ == "__main__":
    main()
