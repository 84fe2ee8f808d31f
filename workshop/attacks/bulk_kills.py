"""Kills runs in bulk: ``python attacks/bulk_kills.py [--kills N] [--recipes N] [--seed N] [--ray]``.

A run makes sentences in shards while its processes are killed (SIGKILL) at random moments: workers or the driver; with
``--ray`` actors, a node of a Ray cluster of two, or the driver. A killed driver is called again. The final output is
compared with that of an undisturbed run, byte by byte. Prints a table.
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
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from typing import Any

import psutil

from signsplice.bulk.cluster import LOOPBACK

N_RECIPES, SHARD_SIZE = 240, 6
TIME_LIMIT_S = 1500.0
_STARTS = 5
Content = dict[str, bytes]
Kill = Callable[[psutil.Process], object]
"""Kills something of a driver's run; returns False if there is nothing yet."""
_BULK = (sys.executable, "-m", "signsplice", "bulk")


def read_folder(folder: Path) -> Content:
    """Returns relative path -> bytes of all files of a folder of shards."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def kill_worker(driver: psutil.Process, rng: random.Random, marks: tuple[str, ...] = ("spawn_main",)) -> bool:
    """Kills one of the processes that make shards; returns False if there is none yet."""
    workers = []
    for process in driver.children(recursive=True) if marks == ("spawn_main",) else psutil.process_iter():
        with suppress(psutil.Error):
            line = " ".join(process.cmdline())
            if any(mark in line for mark in marks) and "resource_tracker" not in line:
                workers.append(process)
    if workers:
        rng.choice(workers).kill()
    return bool(workers)


def run_disturbed(
    command: list[str], folder: Path, kills: dict[str, Kill], n_kills: int, rng: random.Random
) -> Counter[str]:
    """Runs a command into ``folder`` until it ends, with up to ``n_kills`` kills of kinds drawn at random; returns the
    number of kills of each kind. Raises ``TimeoutError`` if it takes longer than ``TIME_LIMIT_S``.
    """
    kill_counts: Counter[str] = Counter()
    deadline = time.monotonic() + TIME_LIMIT_S

    def count_shards() -> int:
        return len(list(folder.glob("index/*.parquet")))

    while True:
        driver = psutil.Popen([*command, "-o", str(folder)], stdout=subprocess.DEVNULL)
        try:
            n_before = count_shards()
            while driver.poll() is None:
                if time.monotonic() > deadline:
                    raise TimeoutError(f"{folder}: not done after {TIME_LIMIT_S:.0f} s, {kill_counts.total()} kills")
                time.sleep(rng.uniform(0.05, 0.5))
                # few kills before any progress
                if kill_counts.total() == n_kills or (count_shards() == n_before and rng.random() < 0.97):
                    continue
                kind = rng.choice(sorted(kills))
                time.sleep(rng.uniform(0.0, 0.3))
                with suppress(psutil.NoSuchProcess):
                    if kills[kind](driver) is not False:
                        kill_counts[kind] += 1
                        n_before = count_shards()
        finally:
            with suppress(psutil.NoSuchProcess):
                driver.kill()
        if driver.wait() == 0:
            return kill_counts
        if driver.returncode != -9:
            raise RuntimeError(f"{folder}: the call ended with status {driver.returncode}")


@contextmanager
def start_two_nodes(rng: random.Random) -> Iterator[tuple[list[str], dict[str, Kill]]]:
    """Starts a Ray cluster of two nodes with a processor each; yields options for it, and how to kill its parts."""
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

    def kill_node(_: psutil.Process) -> None:
        cluster.remove_node(nodes.pop(), allow_graceful=False)
        nodes.append(start())

    kills: dict[str, Kill] = {
        "actor": lambda driver: kill_worker(driver, rng, ("ray::MapWorker", "ray::ShardActor")),
        "node": kill_node,
        "driver": psutil.Process.kill,
    }
    try:
        yield ["--ray", cluster.address], kills
    finally:
        cluster.shutdown()


def attack(folder: Path, n_kills: int, on_ray: bool, seed: int = 0, n_recipes: int = N_RECIPES) -> Counter[str]:
    """Kills runs until there were ``n_kills`` kills, and returns the number of each kind. Raises ``AssertionError`` if
    a run makes other files than an undisturbed one with one worker.
    """
    rng, (table, undisturbed, disturbed) = random.Random(seed), (folder / n for n in ("recipes.csv", "whole", "new"))
    recipes = [*_BULK, "recipes", "-o", str(table), "--count", str(n_recipes), "--words", "2:4"]
    subprocess.run(recipes, check=True)
    call = [*_BULK, "sentences", str(table), "--shard-size", str(SHARD_SIZE)]
    subprocess.run([*call, "--workers", "1", "-o", str(undisturbed)], check=True)
    expected, kill_counts = read_folder(undisturbed), Counter[str]()
    on_processes: dict[str, Kill] = {"worker": lambda driver: kill_worker(driver, rng), "driver": psutil.Process.kill}
    with start_two_nodes(rng) if on_ray else nullcontext((["--workers", "2"], on_processes)) as (placement, kills):
        while kill_counts.total() < n_kills:
            run_counts = run_disturbed([*call, *placement], disturbed, kills, n_kills - kill_counts.total(), rng)
            files = read_folder(disturbed)
            assert files == expected, sorted(set(files) ^ set(expected)) or "bytes differ"
            print(f"{'Ray' if on_ray else 'processes'}: {dict(run_counts)}, {len(files)} files equal", flush=True)
            kill_counts.update(run_counts)
            shutil.rmtree(disturbed)
    return kill_counts


def main() -> None:
    """Runs the attack and prints its table."""
    parser = argparse.ArgumentParser(description=__doc__)
    for name, default in (("--kills", 20), ("--seed", 0), ("--recipes", N_RECIPES)):
        parser.add_argument(name, type=int, default=default)
    parser.add_argument("--ray", action="store_true")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        kill_counts = attack(Path(folder), options.kills, options.ray, options.seed, options.recipes)
    print("| killed | times | what was made in the end |\n| --- | --- | --- |")
    for kind, n in sorted(kill_counts.items()):
        print(f"| {kind} | {n} | equal to the undisturbed run, byte by byte |")


if __name__ == "__main__":
    main()
