"""Shards made by actors of a Ray cluster, by Ray Data."""

from __future__ import annotations

import logging
import os
import secrets
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import asdict
from tempfile import TemporaryDirectory
from typing import Any

from signsplice.bulk.shards import ShardResult, make_shard
from signsplice.children import ONE_THREAD
from signsplice.errors import InputError, MissingExtraError, SignspliceError

LOCAL = "local"
"""The address of a cluster that is started here, of this machine alone, and ends with the call."""

LOOPBACK = "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER"
"""Set to 0, nodes of Ray are at 127.0.0.1, on every system. Else they are at the machine's own address, and open."""


_UNREACHABLE = "http://127.0.0.1:9"
"""A proxy that does not exist. Ray asks the metadata hosts of three clouds by HTTP which of them it runs in, also where
its usage reports are off; its own processes speak gRPC, which heeds no proxy here.
"""


class ShardActor:
    """A worker of the cluster: it keeps words and networks between shards."""

    def __init__(self, out: str, n_kept: int) -> None:
        self._out, self._n_kept = out, n_kept

    def __call__(self, batch: dict[str, Any]) -> dict[str, Any]:
        """The results of the shards whose numbers are in ``batch``. What is wrong with an input is a result too: Ray
        would make a page of its traceback.
        """
        rows = []
        for shard in batch["shard"].tolist():
            try:
                rows.append(asdict(make_shard(self._out, shard, self._n_kept)) | {"error": ""})
            except SignspliceError as error:
                rows.append(asdict(ShardResult(shard, 0, 0, 0, 0, 0, 0.0)) | {"error": str(error)})
        return {name: [row[name] for row in rows] for name in rows[0]}


def make_all(
    out: str, shards: Sequence[int], address: str, n_kept: int, workers: int | None = None
) -> Iterator[ShardResult]:
    """Make these shards on the Ray cluster at ``address``, each as soon as it is whole, by an actor for every
    processor, or by ``workers`` of them.

    The cluster's machines see the folder, the lexicon and the networks under the same paths. Ray starts actors and
    shards again that ended with a process or a machine. Raises ``InputError`` where there is no cluster, and where a
    worker finds another folder, lexicon, bundle or version; ``MissingExtraError`` without Ray.
    """
    with _cluster_of_its_own() if address == LOCAL else nullcontext("") as folder:
        yield from _make_all(connect(address, folder), out, shards, n_kept, workers)


def _make_all(ray: Any, out: str, shards: Sequence[int], n_kept: int, workers: int | None) -> Iterator[ShardResult]:
    try:
        context = ray.data.DataContext.get_current()
        context.enable_progress_bars = context.enable_auto_log_stats = False
        logging.getLogger("ray.data").setLevel(logging.ERROR)
        n_workers = workers or max(1, int(ray.cluster_resources().get("CPU", 1)))
        rows = ray.data.from_items([{"shard": shard} for shard in shards], override_num_blocks=len(shards)).map_batches(
            ShardActor,
            fn_constructor_args=(out, n_kept),
            batch_size=1,
            num_cpus=1,
            compute=ray.data.ActorPoolStrategy(min_size=1, max_size=n_workers),
        )
        for row in rows.iter_rows():
            error = row.pop("error")
            if error:
                raise InputError(error)
            yield ShardResult(**row)
    finally:
        ray.shutdown()


@contextmanager
def _cluster_of_its_own() -> Iterator[str]:
    """A temporary folder for a cluster that is started here, and an environment in which it writes nothing elsewhere
    and calls no other host.
    """
    values = {
        "RAY_AUTH_TOKEN": secrets.token_hex(32),  # else Ray writes one to the user's home
        "http_proxy": _UNREACHABLE,
        "HTTP_PROXY": _UNREACHABLE,
        "no_proxy": "localhost,127.0.0.1",
        "NO_PROXY": "localhost,127.0.0.1",
    }
    before = {name: os.environ.get(name) for name in values}
    # macOS has a folder of temporary files whose name is too long for Ray's sockets.
    with TemporaryDirectory(
        prefix="ray-", dir="/tmp" if sys.platform == "darwin" else None, ignore_cleanup_errors=True
    ) as folder:
        os.environ.update(values)
        try:
            yield folder
        finally:
            for name, value in before.items():
                if value is None:
                    del os.environ[name]
                else:
                    os.environ[name] = value


def connect(address: str, folder: str = "") -> Any:
    """Ray, connected to the cluster at ``address``; one that is started here keeps its files in ``folder``. It sends
    nothing about its use anywhere. Raises as ``make_all``.
    """
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    os.environ.setdefault("RAY_BACKEND_LOG_LEVEL", "fatal")
    if address == LOCAL:
        os.environ.setdefault(LOOPBACK, "0")
    try:
        import ray
        import ray.data
    except ImportError as error:
        raise MissingExtraError(
            f"a Ray cluster needs {error.name}; install it with: pip install '.[bulk]' in signsplice's folder"
        ) from error
    runtime = {"env_vars": dict(ONE_THREAD)}
    try:
        ray.init(
            None if address == LOCAL else address,
            runtime_env=runtime,
            log_to_driver=False,
            logging_level="ERROR",
            **({"include_dashboard": False, "_node_ip_address": "127.0.0.1"} if address == LOCAL else {}),
            **({"_temp_dir": folder} if folder else {}),
        )
    except (ConnectionError, ValueError, RuntimeError, OSError) as error:
        what = (str(error).splitlines() or [type(error).__name__])[0][:200]
        raise InputError(f"ray {address}: no cluster there ({what}); start one by `ray start --head`") from error
    return ray
