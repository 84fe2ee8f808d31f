"""The network that cuts and times: draws are a signer's words with their truth, one batch is learned by heart."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from signsplice.rig.canonical import FEATURE_FPS

torch = pytest.importorskip("torch")

from signsplice.splicing import features  # noqa: E402
from signsplice.splicing.features import PHASES  # noqa: E402
from signsplice.synth import training_data  # noqa: E402
from signsplice.train.product import cut_data  # noqa: E402
from signsplice.train.product.cut_data import CutDataset, CuttingTask, phases_of, read_words  # noqa: E402
from signsplice.train.product.networks.cutting import Cutting, CuttingConfig  # noqa: E402

TOY = CuttingConfig(32, 2, 2, 48, 2, 12, 24)


@pytest.fixture(scope="module")
def paths(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("endless")
    training_data.write(training_data.TrainingDataPlan(1, 5, 0, seed=6), folder, processes=1)
    return sorted(folder.glob("*.npz"))


def test_a_draw_is_words_of_one_signer_and_their_truth(paths: list[Path]) -> None:
    words = read_words(paths[0])
    clean = CutDataset(paths, fixed=3)
    assert clean.n_words == 5
    one = clean.draw(1)
    flipped = features.left_hand_busier(*words.trajectories)
    known = [features.word_tokens(features.mirrored(c) if flipped else c) for c in words.trajectories]
    which = [next(k for k, own in enumerate(known) if np.array_equal(own, tokens)) for tokens, _ in one["words"]]
    assert sorted(which) == [0, 1, 2, 3, 4]
    for row, p in enumerate(which):
        tokens, phases = one["words"][row]
        assert len(tokens) == len(phases)
        np.testing.assert_array_equal(phases[: len(words.phases[p])], words.phases[p])
        for column, q in enumerate(which):
            pre, post, n = words.pairs[p, q]
            assert (one["pre"][row, column], one["post"][row, column]) == (pre, post)
            assert one["seconds"][row, column] == pytest.approx((n + 1) / 30.0)


def test_what_teaches_is_noisy_or_between_frames_and_the_truth_moves_along(paths: list[Path]) -> None:
    words, seen = read_words(paths[0]), CutDataset(paths)
    clean = {len(c) for c in words.trajectories}
    # The last frame's seconds since the first tell how many there are, but for the one that is there twice.
    lengths = {
        round(float(tokens[-1, -2]) * FEATURE_FPS) + 1
        for number in range(6)
        for tokens, _ in seen.draw(number)["words"]
    }
    assert lengths & {n - 1 for n in clean}, "between two frames there is one fewer"
    assert lengths & clean
    for number in range(6):
        one = seen.draw(number)
        for k, (tokens, phases) in enumerate(one["words"]):
            assert len(tokens) == len(phases)
            assert one["pre"][k].max() < len(tokens)
            assert one["post"][:, k].max() < len(tokens)
            sign = np.flatnonzero(np.isin(phases, [PHASES.index("hold"), PHASES.index("stroke")]))
            assert (one["pre"][k] > sign[0] - 3).all(), "no word is left before its sign"


def test_half_of_the_pairs_teach_the_time_between_other_frames(
    paths: list[Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cut_data, "BETWEEN", 0.0)  # frames are those that the part tells
    words, seen = read_words(paths[0]), CutDataset(paths)
    told = {tuple(row) for row in (*words.pairs.reshape(-1, 3).tolist(), *words.asides.reshape(-1, 3).tolist())}
    aside = []
    for number in range(20):
        one = seen.draw(number)
        frames = np.rint(30.0 * one["seconds"]) - 1.0
        rows = np.stack([one["leaving"], one["entering"], frames], axis=-1).astype(int)
        assert {tuple(row) for row in rows.reshape(-1, 3).tolist()} <= told, "a time goes with its own two frames"
        aside.append((one["leaving"] != one["pre"]) | (one["entering"] != one["post"]))
    assert 0.3 < np.mean(aside) < 0.6
    clean = CutDataset(paths, fixed=1).draw(0)
    assert (clean["leaving"] == clean["pre"]).all()
    assert (clean["entering"] == clean["post"]).all()


def test_phases_follow_one_another(paths: list[Path]) -> None:
    signs = set()
    for phases in read_words(paths[0]).phases:
        order = [PHASES[k] for k in (int(phases[0]), *(int(b) for a, b in pairwise(phases) if a != b))]
        assert (order[:2], order[-2:]) == (["rest", "preparation"], ["retraction", "rest"])
        signs.add(tuple(order[2:-2]))
    assert signs <= {("hold",), ("stroke",), ("hold", "stroke"), ("stroke", "hold"), ("hold", "stroke", "hold")}


def test_a_posture_is_a_hold_and_movements_a_stroke() -> None:
    at = np.arange(9)
    still = phases_of(at, (1, 3, 6, 8, -1, -1, -1, -1))
    assert [PHASES[k] for k in still] == ["rest"] * 2 + ["preparation"] + ["hold"] * 4 + ["retraction", "rest"]
    moving = phases_of(at, (1, 3, 6, 8, 3, 4, 4, 5))
    assert [PHASES[k] for k in moving[3:7]] == ["stroke"] * 3 + ["hold"]


def test_only_frames_of_the_word_are_chosen(paths: list[Path]) -> None:
    batch = CutDataset(paths).batch([0, 1])
    left, entered, seconds, _ = CuttingTask(Cutting(TOY))._said(batch)
    lengths = batch.mask.sum(-1)
    assert (left.argmax(-1) < lengths[:, :, None]).all()
    assert (entered.argmax(-1) < lengths[:, None]).all()
    assert (seconds > 0.0).all()
    assert (batch.pre < lengths[:, :, None]).all()
    assert (batch.post < lengths[:, None]).all()


def test_a_word_reads_alike_alone_and_padded_and_every_weight_learns(paths: list[Path]) -> None:
    torch.manual_seed(0)
    network = Cutting(TOY)
    batch = CutDataset(paths).batch([2])
    tokens, mask = batch.tokens[0], batch.mask[0]
    row = int(mask.sum(1).argmin())
    n = int(mask[row].sum())
    together, alone = network.read(tokens, mask), network.read(tokens[row : row + 1, :n])
    torch.testing.assert_close(together[0][row, :n], alone[0][0], atol=1e-4, rtol=1e-4)
    for k in (1, 2):
        torch.testing.assert_close(together[k][row], alone[k][0], atol=1e-4, rtol=1e-4)
    CuttingTask(network)(batch).backward()
    still = {name for name, p in network.named_parameters() if p.grad is None or not p.grad.abs().sum() > 0}
    assert still <= {"leaving.out.bias", "entering.out.bias"}, "a softmax does not see what is added to all"


def test_what_a_pair_says_is_what_its_two_words_say_alone(paths: list[Path]) -> None:
    torch.manual_seed(0)
    network = Cutting(TOY).eval()
    batch = CutDataset(paths, fixed=1).batch([0])
    with torch.no_grad():
        left, entered, seconds, _ = CuttingTask(network)._said(batch)
        words = [batch.tokens[:, k][batch.mask[:, k]][None] for k in (1, 3)]
        (states, leave, _, _), (others, _, enter, _) = (network.read(word) for word in words)
        condition = network.condition(leave, enter)
        pre, post = int(batch.pre[0, 1, 3]), int(batch.post[0, 1, 3])
        ends = words[0][:, pre, : features.N_FRAME], words[1][:, post, : features.N_FRAME]
        own, other = network.leaving(states, condition), network.entering(others, condition)
        timed = network.seconds(*ends, leave, enter)
    torch.testing.assert_close(left[0, 1, 3, : own.shape[1]], own[0], atol=1e-4, rtol=1e-4)
    torch.testing.assert_close(entered[0, 1, 3, : other.shape[1]], other[0], atol=1e-4, rtol=1e-4)
    torch.testing.assert_close(seconds[0, 1, 3], timed[0], atol=1e-4, rtol=1e-4)


def test_one_batch_is_learned_by_heart(paths: list[Path]) -> None:
    torch.manual_seed(0)
    batch = CutDataset(paths, fixed=1).batch([0])
    flat = batch.tokens[batch.mask]
    task = CuttingTask(Cutting(TOY, flat.mean(0), flat.std(0).clamp(min=0.05)))
    optimiser = torch.optim.AdamW(task.parameters(), 3e-3)
    for _ in range(400):
        loss = task(batch)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
    scores = task.eval().judge(batch)
    assert scores["both"] == 1.0
    assert scores["length"] > 0.9
