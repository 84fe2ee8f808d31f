"""The network that cuts: padding, gradients, pairs from single words, and learning one batch by heart."""

from __future__ import annotations

from pathlib import Path

import pytest

torch = pytest.importorskip("torch")

from signsplice_workshop.train import tasks  # noqa: E402
from signsplice_workshop.train.cut_data import CutDataset  # noqa: E402
from signsplice_workshop.train.networks import Cutting, CuttingConfig  # noqa: E402
from signsplice_workshop.train.tasks import CuttingTask  # noqa: E402
from training_toys import signing  # noqa: E402

TOY = CuttingConfig(32, 2, 2, 48, 2, 12, 24)


@pytest.fixture(scope="module")
def paths() -> list[Path]:
    """The file of one signer with five words."""
    return sorted(signing(1, 5, 0, 6).glob("*.npz"))


def test_only_frames_of_the_word_are_chosen(paths: list[Path]) -> None:
    batch = CutDataset(paths).batch([0, 1])
    found = CuttingTask(Cutting(TOY)).predict(batch)
    lengths = batch.mask.sum(-1)
    assert (found.leave_scores.argmax(-1) < lengths[:, :, None]).all()
    assert (found.enter_scores.argmax(-1) < lengths[:, None]).all()
    assert (batch.pre < lengths[:, :, None]).all()
    assert (batch.post < lengths[:, None]).all()


def test_padding_does_not_change_how_a_word_is_read(paths: list[Path]) -> None:
    torch.manual_seed(0)
    network = Cutting(TOY)
    batch = CutDataset(paths).batch([2])
    tokens, mask = batch.tokens[0], batch.mask[0]
    row = int(mask.sum(1).argmin())
    n_frames = int(mask[row].sum())
    padded, alone = network.read(tokens, mask), network.read(tokens[row : row + 1, :n_frames])
    torch.testing.assert_close(padded[0][row, :n_frames], alone[0][0], atol=1e-4, rtol=1e-4)
    for k in (1, 2):
        torch.testing.assert_close(padded[k][row], alone[k][0], atol=1e-4, rtol=1e-4)


def test_the_loss_of_a_batch_is_the_mean_of_its_unequal_parts(
    paths: list[Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    torch.manual_seed(0)
    task, dataset = CuttingTask(Cutting(TOY)), CutDataset(paths)
    batch, parts = dataset.batch([0, 1]), [dataset.batch([row]) for row in (0, 1)]
    for one in (batch, parts[0]):
        one.has_truth[0, 1:] = False
    whole = task(batch)
    assert whole.item() != pytest.approx(sum(task(part).item() for part in parts) / 2, rel=1e-3)
    shared = torch.stack([batch.has_truth.sum(), batch.mask.sum()]) / 2
    monkeypatch.setattr(tasks, "average_counts", lambda _: shared)
    assert whole.item() == pytest.approx(sum(task(part).item() for part in parts) / 2, rel=1e-6)


def test_every_weight_of_the_cutter_has_a_gradient(paths: list[Path]) -> None:
    torch.manual_seed(0)
    network = Cutting(TOY)
    CuttingTask(network)(CutDataset(paths).batch([2])).backward()
    still = {name for name, p in network.named_parameters() if p.grad is None or not p.grad.abs().sum() > 0}
    assert still <= {"leaving.out.bias", "entering.out.bias"}, "a softmax ignores what is added to all scores"


def test_a_pair_is_predicted_from_the_readings_of_its_words(paths: list[Path]) -> None:
    torch.manual_seed(0)
    network = Cutting(TOY).eval()
    batch = CutDataset(paths, n_fixed=1).batch([0])
    with torch.no_grad():
        found = CuttingTask(network).predict(batch)
        words = [batch.tokens[:, k][batch.mask[:, k]][None] for k in (1, 3)]
        (states_before, leave, _, _), (states_after, _, enter, _) = (network.read(word) for word in words)
        condition = network.condition(leave, enter)
        before, after = network.leaving(states_before, condition), network.entering(states_after, condition)
    torch.testing.assert_close(found.leave_scores[0, 1, 3, : before.shape[1]], before[0], atol=1e-4, rtol=1e-4)
    torch.testing.assert_close(found.enter_scores[0, 1, 3, : after.shape[1]], after[0], atol=1e-4, rtol=1e-4)


def test_the_cutter_can_learn_one_batch_by_heart(paths: list[Path]) -> None:
    torch.manual_seed(0)
    batch = CutDataset(paths, n_fixed=1).batch([0])
    tokens = batch.tokens[batch.mask]
    task = CuttingTask(Cutting(TOY, tokens.mean(0), tokens.std(0).clamp(min=0.05)))
    optimiser = torch.optim.AdamW(task.parameters(), 3e-3)
    for _ in range(150):
        loss = task(batch)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
    scores = task.eval().judge(batch)
    # Over eight seeds at least 0.92. A network that ignores the other word reaches 0.36, one whose states are lost 0.0,
    # an untrained one 0.12.
    assert scores["both"] > 0.7
