"""The networks that cut and time: pairs are the signer's, choices are made together, one batch is learned by heart."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from signsplice.motion import features  # noqa: E402
from signsplice.synth import endless  # noqa: E402
from signsplice.train.cuts import CutPairs, CuttingTask, DurationTask, read_words  # noqa: E402
from signsplice.train.networks.cutting import PHASES, Cutting, CuttingConfig, Duration  # noqa: E402

TOY = CuttingConfig(32, 2, 2, 48, 4)


@pytest.fixture(scope="module")
def paths(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("endless")
    endless.write(endless.Plan(1, 4, 0, seed=6), folder, processes=1)
    return sorted(folder.glob("*.npz"))


@pytest.fixture(scope="module")
def pairs(paths: list[Path]) -> CutPairs:
    return CutPairs(paths)


def test_a_pair_is_two_words_and_their_truth(paths: list[Path], pairs: CutPairs) -> None:
    words = read_words(paths[0])
    seen = set()
    for number in range(12):
        one = pairs.pair(number)
        own = one["tokens"][:, : features.N_FRAME]
        for p in range(4):
            for q in range(4):
                window = features.cut_window(words.courses[p], words.courses[q])
                if window.tokens.shape[0] == len(own) and np.array_equal(window.tokens[:, : features.N_FRAME], own):
                    pre, post, n = words.pairs[p, q]
                    assert (one["pre"] + window.first, one["post"] - one["n_before"]) == (pre, post)
                    assert one["seconds"] == pytest.approx((n + 1) / 30.0)
                    np.testing.assert_array_equal(one["leaving"], own[one["pre"]])
                    np.testing.assert_array_equal(one["entering"], own[one["post"]])
                    seen.add((p, q))
    assert len(seen) > 4


def test_phases_follow_one_another(paths: list[Path]) -> None:
    for phases in read_words(paths[0]).phases:
        order = [int(phases[0]), *(int(b) for a, b in pairwise(phases) if a != b)]
        assert [PHASES[k] for k in order] == ["rest", "preparation", "sign", "retraction", "rest"]


def test_long_words_are_seen_at_their_inner_ends(paths: list[Path]) -> None:
    course = read_words(paths[0]).courses[0]
    n = len(course)
    long = features.Course(np.tile(course.turns, (3, 1, 1)), np.tile(course.places, (3, 1, 1)), course.there)
    seen = features.cut_window(long, long)
    assert (seen.n_before, seen.first) == (60, 3 * n - 60)
    assert seen.tokens.shape == (120, features.N_CUT)
    assert seen.tokens[0, features.N_FRAME :].tolist() == pytest.approx([0.0, 1.0, (3 * n - 60) / 30, 59 / 30])
    assert seen.tokens[60, features.N_FRAME :].tolist() == pytest.approx([1.0, 0.0, 0.0, (3 * n - 1) / 30])
    flipped = features.cut_window(features.mirrored(course), features.mirrored(course))
    np.testing.assert_allclose(flipped.tokens, features.cut_window(course, course).tokens, atol=1e-6)


def test_only_frames_of_the_right_word_are_chosen(pairs: CutPairs) -> None:
    batch = pairs.batch(pairs.rows(0, 5, 0))
    scores, _ = CuttingTask(Cutting(TOY))._scores(batch)
    size = batch.mask.shape[1]
    best = scores.argmax(1)
    assert batch.before[torch.arange(5), best // size].all()
    assert batch.after[torch.arange(5), best % size].all()
    assert batch.before[torch.arange(5), batch.pre].all()
    assert batch.after[torch.arange(5), batch.post].all()


def test_padding_changes_nothing_and_every_weight_learns(pairs: CutPairs) -> None:
    torch.manual_seed(0)
    network = Cutting(TOY)
    batch = pairs.batch(pairs.rows(1, 6, 0))
    row = int(batch.mask.sum(1).argmin())
    n = int(batch.mask[row].sum())
    whole, phases = network(batch.tokens, batch.mask)
    alone, own = network(batch.tokens[row : row + 1, :n])
    torch.testing.assert_close(whole[row, :n, :n], alone[0], atol=1e-4, rtol=1e-4)
    torch.testing.assert_close(phases[row, :n], own[0], atol=1e-4, rtol=1e-4)
    CuttingTask(network)(batch).backward()
    assert all(p.grad is not None and p.grad.abs().sum() > 0 for p in network.parameters())


@pytest.mark.parametrize("kind", ["cut", "duration"])
def test_one_batch_is_learned_by_heart(pairs: CutPairs, kind: str) -> None:
    torch.manual_seed(0)
    batch = pairs.batch(pairs.rows(0, 4, 0))
    flat = batch.tokens[batch.mask]
    mean, deviation = flat.mean(0), flat.std(0).clamp(min=0.05)
    n = features.N_FRAME
    task = (
        CuttingTask(Cutting(TOY, mean, deviation))
        if kind == "cut"
        else DurationTask(Duration(32, mean[:n], deviation[:n]))
    )
    optimiser = torch.optim.AdamW(task.parameters(), 3e-3)
    for _ in range(150):
        loss = task(batch)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
    scores = task.eval().judge(batch, None)
    assert scores["both" if kind == "cut" else "exact"] == 1.0
