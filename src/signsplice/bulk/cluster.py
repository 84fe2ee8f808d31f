"""Makes shards in actors of a Ray cluster, with Ray Data."""

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
"""Address of a temporary cluster of this machine alone, which ends with the call."""

LOOPBACK = "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER"
"""If set to 0, Ray's nodes use 127.0.0.1 on every system. Otherwise they use the machine's public address, openly."""

_UNREACHABLE = "http://127.0.0.1:9"
"""Proxy that does not exist. Ray queries the metadata hosts of three clouds by HTTP to find out where it runs, even if
usage reports are off; its own processes use gRPC, which ignores this proxy.
"""


class ShardActor:
    """A worker of the cluster, which keeps words and networks between shards."""

    def __init__(self, out: str, n_words_kept: int) -> None:
        self._out, self._n_words_kept = out, n_words_kept

    def __call__(self, batch: dict[str, Any]) -> dict[str, Any]:
        """Make the shards whose numbers are in ``batch`` and return their results. An input error is a result too: Ray
        would print a page of traceback.
        """
        rows = []
        for shard in batch["shard"].tolist():
            try:
                rows.append(asdict(make_shard(self._out, shard, self._n_words_kept)) | {"error": ""})
            except SignspliceError as error:
                rows.append(asdict(ShardResult(shard, 0, 0, 0, 0, 0, 0.0)) | {"error": str(error)})
        return {name: [row[name] for row in rows] for name in rows[0]}


def make_all(
    out: str, shards: Sequence[int], address: str, n_words_kept: int, workers: int | None = None
) -> Iterator[ShardResult]:
    """Make these shards on the Ray cluster at ``address``, by one actor per processor or by ``workers`` actors; yields
    each shard when it is complete.

    The cluster's machines must see the folder, the lexicon and the networks under the same paths. Ray restarts actors
    and shards that ended with a process or a machine. Raises ``InputError`` if there is no cluster, or if a worker
    finds another folder, lexicon, bundle or version; ``MissingExtraError`` without Ray.
    """
    with _cluster_of_its_own() if address == LOCAL else nullcontext("") as folder:
        yield from _make_all(connect(address, folder), out, shards, n_words_kept, workers)


def _make_all(
    ray: Any, out: str, shards: Sequence[int], n_words_kept: int, workers: int | None
) -> Iterator[ShardResult]:
    try:
        context = ray.data.DataContext.get_current()
        context.enable_progress_bars = context.enable_auto_log_stats = False
        logging.getLogger("ray.data").setLevel(logging.ERROR)
        n_workers = workers or max(1, int(ray.cluster_resources().get("CPU", 1)))
        rows = ray.data.from_items([{"shard": shard} for shard in shards], override_num_blocks=len(shards)).map_batches(
            ShardActor,
            fn_constructor_args=(out, n_words_kept),
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
    """Yield a temporary folder for a local cluster, in an environment in which it writes nothing elsewhere and contacts
    no other host.
    """
    values = {
        "RAY_AUTH_TOKEN": secrets.token_hex(32),  # otherwise Ray writes one to the user's home
        "http_proxy": _UNREACHABLE,
        "HTTP_PROXY": _UNREACHABLE,
        "no_proxy": "localhost,127.0.0.1",
        "NO_PROXY": "localhost,127.0.0.1",
    }
    before = {name: os.environ.get(name) for name in values}
    # The name of macOS' temporary folder is too long for Ray's sockets.
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
    """Return Ray, connected to the cluster at ``address``; a local cluster keeps its files in ``folder``. Disables
    usage reports. Raises as ``make_all``.
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
