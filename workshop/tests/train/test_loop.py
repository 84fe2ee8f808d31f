"""The training loop: resuming, checkpoints, ends, learning rates, refusals."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest

torch = pytest.importorskip("torch")

from torch import Tensor  # noqa: E402

from signsplice.errors import InputError, SignspliceError  # noqa: E402
from signsplice_workshop.train import checkpoint, loop, processes, records  # noqa: E402
from signsplice_workshop.train.loop import LoopConfig, train  # noqa: E402
from training_toys import ALONE, product_toy  # noqa: E402


def trained(folder: Path, untils: tuple[int | None, ...], name: str = "cutter") -> dict[str, Tensor]:
    """Weights after a training of six steps in several calls, each of which stops at one of ``untils``."""
    folder.mkdir()
    for until in untils:
        task, data, valid = product_toy(name)
        config = LoopConfig(6, 4, 1e-3, seed=1, every=4, until=until)
        train(task, config, data, valid, folder, "toy", ALONE)
    return task.state_dict()


def losses(folder: Path) -> dict[int, float]:
    """The losses in a training's log by step."""
    return {line["step"]: line["loss"] for line in records.read_lines(folder / records.LOG_FILE) if "loss" in line}


@pytest.mark.parametrize("name", ["cutter", "transition"])
def test_a_resumed_training_ends_in_the_same_weights(tmp_path: Path, name: str) -> None:
    whole, parts = trained(tmp_path / "a", (None,), name), trained(tmp_path / "b", (2, 3, None), name)
    for key, value in whole.items():
        assert torch.equal(value, parts[key]), key
    assert list(losses(tmp_path / "b")) == [1, 2, 3, 4, 5, 6]
    assert losses(tmp_path / "b") == losses(tmp_path / "a")


def test_processor_seconds_go_on_where_an_interruption_left_them(tmp_path: Path) -> None:
    seconds = []
    for until in (3, None):
        task, data, valid = product_toy()
        train(task, LoopConfig(6, 4, 1e-3, seed=1, every=2, until=until), data, valid, tmp_path, "toy", ALONE)
        seconds.append(max(line["cpu_s"] for line in records.read_lines(tmp_path / records.LOG_FILE)))
    assert seconds[1] > seconds[0] > 0.0


def test_checkpoints_are_written_between_rare_validations(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    saved: list[int] = []
    monkeypatch.setattr(checkpoint, "save", lambda folder, step, *_: saved.append(step))
    trained(tmp_path / "a", (None,))
    assert saved == [4, 6]
    saved.clear()
    monkeypatch.setattr(loop, "CHECKPOINT_S", -1.0)
    trained(tmp_path / "b", (None,))
    assert saved == [1, 2, 3, 4, 4, 5, 6]


def test_a_training_that_is_interrupted_is_kept(tmp_path: Path) -> None:
    class Interrupted(LoopConfig):
        def interruption(self, step: int, processes: processes.Processes) -> SignspliceError | None:
            return SignspliceError("stop") if step == 3 else None

    task, data, valid = product_toy()
    with pytest.raises(SignspliceError, match="stop"):
        train(task, Interrupted(6, 4, 1e-3, 1, every=4), data, valid, tmp_path, "toy", ALONE)
    assert checkpoint.read(tmp_path)["step"] == 3


@pytest.mark.parametrize(("stop", "kept"), [(3, "no step is kept yet"), (5, "step 4 of 6 is kept in ")])
def test_an_interrupt_says_what_is_kept_and_the_next_call_that_it_continues(
    tmp_path: Path, stop: int, kept: str
) -> None:
    class Interrupted(LoopConfig):
        def interruption(self, step: int, processes: processes.Processes) -> SignspliceError | None:
            if step == stop:
                raise KeyboardInterrupt
            return None

    def train_again(config: LoopConfig) -> list[tuple[int, int, dict[str, float]]]:
        task, data, valid = product_toy()
        calls: list[tuple[int, int, dict[str, float]]] = []
        train(task, config, data, valid, tmp_path, "toy", ALONE, lambda *call: calls.append(call))
        return calls

    with pytest.raises(KeyboardInterrupt, match=f"^{kept}.*; the same command continues from there$"):
        train_again(Interrupted(6, 4, 1e-3, 1, every=4))
    continues = [(step, n_steps) for step, n_steps, numbers in train_again(LoopConfig(6, 4, 1e-3, 1)) if not numbers]
    assert continues == ([(4, 6)] if stop == 5 else [])


def test_a_training_may_end_by_its_log(tmp_path: Path) -> None:
    class Short(LoopConfig):
        def has_ended(self, folder: Path, step: int, processes: processes.Processes) -> bool:
            return any("loss" in line for line in records.read_lines(folder / records.LOG_FILE) if line["step"] == 3)

    task, data, valid = product_toy()
    assert train(task, Short(6, 4, 1e-3, 1, every=4), data, valid, tmp_path, "toy", ALONE) == 3
    assert checkpoint.read(tmp_path)["step"] == 3, "validated and kept"


def test_steps_that_are_repeated_are_logged_once(tmp_path: Path) -> None:
    trained(tmp_path / "a", (2,))
    path = tmp_path / "a" / records.LOG_FILE
    with path.open("a") as file:
        file.write('{"step": 3, "loss": 9.0}\n{"step": 4, "lo')
    task, data, valid = product_toy()
    train(task, LoopConfig(6, 4, 1e-3, 1, every=4), data, valid, tmp_path / "a", "toy", ALONE)
    assert [line["step"] for line in records.read_lines(path) if "loss" in line] == [1, 2, 3, 4, 5, 6]


def test_a_checkpoint_of_another_training_or_broken_is_refused(tmp_path: Path) -> None:
    trained(tmp_path / "a", (1,))
    with pytest.raises(InputError, match="of another training \\(toy, not other\\)"):
        checkpoint.load(tmp_path / "a", product_toy()[0], None, "other")
    (tmp_path / "a" / checkpoint.NAME).write_bytes(b"no")
    with pytest.raises(InputError, match="cannot be read"):
        checkpoint.load(tmp_path / "a", product_toy()[0], None, "toy")


def test_a_checkpoint_that_is_cut_off_is_refused_with_one_line(tmp_path: Path) -> None:
    trained(tmp_path / "a", (1,))
    path = tmp_path / "a" / checkpoint.NAME
    content = path.read_bytes()
    for length in range(0, len(content), len(content) // 23):
        path.write_bytes(content[:length])
        with pytest.raises(
            InputError, match=r"checkpoint\.pt: cannot be read \(.+\); remove it to start again"
        ) as caught:
            checkpoint.load(tmp_path / "a", product_toy()[0], None, "toy")
        assert "\n" not in str(caught.value)


def test_the_rate_rises_and_falls() -> None:
    config = LoopConfig(100, 8, 2e-3, 0)
    rates = [config.rate_at(step) for step in range(100)]
    assert rates[0] < rates[4] > rates[50] > rates[99] > 0
    assert max(rates) == pytest.approx(2e-3, rel=0.01)


def test_a_folder_is_trained_by_one_call_at_a_time(tmp_path: Path) -> None:
    order: list[str] = []

    def second() -> None:
        with processes.lock_folder(tmp_path, ALONE):
            order.append("second")

    other = threading.Thread(target=second)
    with processes.lock_folder(tmp_path, ALONE):
        other.start()
        other.join(0.2)
        order.append("first")
    other.join(30.0)
    assert order == ["first", "second"]
