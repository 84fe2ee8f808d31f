"""Training by several processes, as `torchrun` starts them: the same losses as of one, and the same checkpoints."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

torch = pytest.importorskip("torch")

from click.testing import CliRunner  # noqa: E402

from signsplice.cli.commands import app  # noqa: E402
from signsplice.errors import InputError  # noqa: E402
from signsplice_workshop.train import checkpoint, processes  # noqa: E402
from signsplice_workshop.train.loop import LoopConfig, train  # noqa: E402
from signsplice_workshop.train.processes import Processes  # noqa: E402
from training_toys import product_toy, signing  # noqa: E402
from two_processes import WAIT_S, check_losses, check_writers, environment, free_port, losses, started, train_by_two  # noqa: E402

EXAMPLES = ("cutter", "transition")


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder for each process; every example was trained in them."""
    return train_by_two(tmp_path_factory.mktemp("processes"), EXAMPLES, product_toy)


@pytest.mark.parametrize("name", EXAMPLES)
def test_two_processes_have_the_losses_of_one(trained: Path, tmp_path: Path, name: str) -> None:
    check_losses(trained, tmp_path, name, product_toy)


def test_only_the_first_process_writes(trained: Path) -> None:
    check_writers(trained, EXAMPLES)


def test_batches_that_cannot_be_divided_are_refused(tmp_path: Path) -> None:
    three = Processes(0, 3, torch.device("cpu"))
    task, data, _ = product_toy()
    with pytest.raises(InputError, match="batches of 8 examples cannot be divided among 3 processes"):
        train(task, LoopConfig(6, 8, 1e-2, 1), data, data, tmp_path, "toy", three)


def test_processes_with_other_data_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Processes, "broadcast_value", lambda *_: "of-the-first")
    second = Processes(1, 2, torch.device("cpu"))
    task, data, _ = product_toy()
    with pytest.raises(InputError, match=r"process 1 has other data or options than process 0 \(mine, not of-the-fir"):
        train(task, LoopConfig(6, 8, 1e-2, 1), data, data, tmp_path, "mine", second)


def test_more_processes_than_gpus_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 2)
    for name, value in {"WORLD_SIZE": "3", "RANK": "2", "LOCAL_RANK": "2"}.items():
        monkeypatch.setenv(name, value)
    with (
        pytest.raises(InputError, match="process 2 of this machine has no GPU of its own, of 2; start one process for"),
        processes.join_process_group("cuda"),
    ):
        pass


def command(network: str, out: Path, *more: str) -> list[str]:
    """The words of `signsplice` that train a network of the product on the toy."""
    words = ["train", network, "--signing", str(signing(2, 3, 3, 8)), "--scale", "smoke", "--batch", "2"]
    return [*words, "--device", "cpu", "--out", str(out), *more]


@pytest.mark.slow
@pytest.mark.parametrize("network", ["cutter", "transition"])
def test_two_nodes_that_share_no_folder_train_as_one_process(tmp_path: Path, network: str) -> None:
    port = free_port()
    running = []
    for node in "01":
        launch = ["--nnodes", "2", "--nproc-per-node", "1", "--rdzv-backend", "c10d", "--local-addr", "127.0.0.1"]
        launch += ["--rdzv-endpoint", f"127.0.0.1:{port}", "--rdzv-id", "toy", "-m", "signsplice"]
        words = command(network, tmp_path / node / "bundle", "--steps", "20")
        call = [sys.executable, "-m", "torch.distributed.run", *launch, *words]
        running.append(subprocess.Popen(call, env=environment()))
    assert [process.wait(WAIT_S) for process in running] == [0, 0]
    called = CliRunner().invoke(app, command(network, tmp_path / "alone" / "bundle", "--steps", "20"))
    assert called.exit_code == 0, called.output
    (alone,) = (tmp_path / "alone" / "parts").iterdir()
    expected = losses(alone)
    assert len(expected) == 20
    folders = {node: tmp_path / node / "parts" / alone.name for node in "01"}
    wrote = {node for node, folder in folders.items() if (folder / checkpoint.NAME).exists()}
    assert len(wrote) == 1
    assert {node for node in "01" if (tmp_path / node / "bundle" / "bundle.json").exists()} == wrote
    assert losses(folders[wrote.pop()]) == pytest.approx(expected, rel=1e-5, abs=0.0)


@pytest.mark.slow
@pytest.mark.parametrize(("rank", "sent"), [(1, signal.SIGKILL), (0, signal.SIGKILL), (1, signal.SIGTERM)])
def test_a_process_that_ends_ends_the_others_with_one_line(tmp_path: Path, rank: int, sent: signal.Signals) -> None:
    words = command("transition", tmp_path / "bundle", "--steps", "100000")
    running = started([sys.executable, "-m", "signsplice", *words], tmp_path)
    deadline = time.monotonic() + WAIT_S
    while not any(losses(folder) for folder in (tmp_path / "parts").glob("*")):
        assert all(process.poll() is None for process in running)
        assert time.monotonic() < deadline
        time.sleep(0.2)
    running[rank].send_signal(sent)
    assert running[rank].wait(WAIT_S) == -sent
    assert running[1 - rank].wait(WAIT_S) == 1
    text = (tmp_path / str(1 - rank)).read_text()
    assert text.count("error: another process of this training has ended or cannot be reached; the same command") == 1
    assert "Traceback" not in text
