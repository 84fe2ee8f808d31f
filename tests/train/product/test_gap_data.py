"""The network that makes transitions: its gaps are the signer's, its loss is the measure, untrained it is Hermite."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from signsplice.motion import kinematics, rotation  # noqa: E402
from signsplice.motion.clip import Clip  # noqa: E402
from signsplice.rig import metrics  # noqa: E402
from signsplice.rig.canonical import LEFT, ROLES, TIPS, canonical_motion  # noqa: E402
from signsplice.splicing import features  # noqa: E402
from signsplice.splicing.transition import find_transition  # noqa: E402
from signsplice.synth import training_data  # noqa: E402
from signsplice.train.product import (
    bridge_task,
    gap_data,
)
from signsplice.train.product.augmentation import exchanged  # noqa: E402
from signsplice.train.product.bridge_task import BridgeTask  # noqa: E402
from signsplice.train.product.gap_data import GapBatch, GapDataset, read_signer  # noqa: E402
from signsplice.train.product.networks.bridge import Bridge, BridgeConfig, rope_angles, rotary, standard  # noqa: E402

RNG = np.random.default_rng(11)
TOY = BridgeConfig(32, 2, 2, 48)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made: Path = tmp_path_factory.mktemp("endless")
    training_data.write(training_data.TrainingDataPlan(1, 4, 6, seed=5), made, processes=1)
    return made


@pytest.fixture(scope="module")
def windows(folder: Path) -> GapDataset:
    return GapDataset(sorted(folder.glob("*.npz")))


def clip_of(windows: GapDataset, turns: np.ndarray) -> Clip:
    local = np.concatenate([np.broadcast_to(rotation.IDENTITY, (len(turns), 1, 4)), turns], axis=1)
    return Clip(windows.parts[0][0].skeleton, local, np.zeros((len(turns), 3)), 30.0)


def test_the_canonical_skeleton_carries_what_the_signer_showed(folder: Path, windows: GapDataset) -> None:
    part = read_signer(next(folder.glob("*.npz")))
    first, n = np.load(next(folder.glob("*.npz")))["sentences"][0]
    places = np.load(next(folder.glob("*.npz")))["places"][first : first + n]
    seen = canonical_motion(clip_of(windows, part.sentences[0]))
    np.testing.assert_allclose(rotation.angle_between(seen.quats, part.sentences[0]), 0, atol=1e-3)
    np.testing.assert_allclose(seen.positions, places, atol=2e-3)


def test_a_gap_hides_what_was_signed(windows: GapDataset) -> None:
    part = windows.parts[0][0]
    sentence, start, n = part.seams[0]
    turns = part.sentences[sentence][start - 8 : start + n + 8]
    one = windows._seen(part, turns, 8, n)
    base = find_transition("hermite").between(clip_of(windows, turns[:8]), clip_of(windows, turns[8 + n :]), n)
    own = np.concatenate([np.zeros((n, 1, 4)) + rotation.IDENTITY, one["base"].astype(float)], axis=1)
    moved = canonical_motion(replace(base, local_rotations=own))
    other = canonical_motion(base)
    flipped = not np.allclose(rotation.to_6d(moved.quats), rotation.to_6d(other.quats), atol=1e-4)
    expected = other.mirrored() if flipped else other
    np.testing.assert_allclose(rotation.to_6d(moved.quats), rotation.to_6d(expected.quats), atol=1e-5)
    assert one["tokens"].shape == (16 + n, features.N_TOKEN)
    true = rotation.to_6d(one["true"].astype(float))
    hidden = canonical_motion(clip_of(windows, turns[8 : 8 + n]))
    np.testing.assert_allclose(true, rotation.to_6d((hidden.mirrored() if flipped else hidden).quats), atol=1e-5)


def test_batches_follow_seed_and_number_and_gaps_never_repeat(windows: GapDataset, folder: Path) -> None:
    one, again = windows.batch([3, 9]), windows.batch([3, 9])
    assert torch.equal(one.tokens, again.tokens)
    assert not torch.equal(one.tokens[:, :16], windows.batch([4, 10]).tokens[:, :16])
    assert not set(windows.rows(0, 8, 0).tolist()) & set(windows.rows(1, 8, 0).tolist())
    fixed = GapDataset(sorted(folder.glob("*.npz")), fixed=12)
    assert len(fixed) == 12
    several = [windows.batch(windows.rows(step, 12, 0)) for step in range(4)]
    seams = torch.cat([batch.seam for batch in several])
    assert seams.any()
    assert (~seams).any()
    whole = several[0]
    assert whole.mask.sum(1).tolist() == (whole.real.sum(1) + 16).tolist()


def test_an_untrained_network_is_the_classical_method(windows: GapDataset) -> None:
    batch = windows.batch(windows.rows(0, 8, 0))
    task = BridgeTask(Bridge(TOY), windows.above.tolist())
    with torch.no_grad():
        np.testing.assert_allclose(task._made(batch).numpy(), batch.base.numpy(), atol=1e-6)
        scores = task.judge(batch)
    assert scores["seam_error"] == pytest.approx(scores["seam_base"])


def test_the_loss_is_the_measure(windows: GapDataset) -> None:
    batch = windows.batch([1])
    n = int(batch.real.sum())
    error = BridgeTask(Bridge(TOY), windows.above.tolist())._errors(batch, batch.base)[0]
    skeleton = windows.parts[0][0].skeleton
    skeleton = replace(skeleton, offsets=np.concatenate([np.zeros((1, 3)), batch.bones[0].numpy()]).astype(float))
    clips = [
        Clip(skeleton, np.insert(q[0, :n].numpy().astype(float), 0, rotation.IDENTITY, axis=1), np.zeros((n, 3)), 30.0)
        for q in (batch.base, batch.true)
    ]
    assert 1000.0 * error.item() == pytest.approx(metrics.position_error(*clips), rel=1e-3)


def test_turns_and_places_are_those_of_the_motion_room() -> None:
    q = rotation.normalize(RNG.normal(size=(3, len(ROLES), 4)))
    d = RNG.normal(0.0, 0.6, (3, len(ROLES), 3))
    found = bridge_task.turned(torch.tensor(q), torch.tensor(d))
    np.testing.assert_allclose(found.numpy(), rotation.multiply(q, rotation.exp(d)), atol=1e-9)
    np.testing.assert_allclose(bridge_task.to_matrices(torch.tensor(q)).numpy(), rotation.to_matrix(q), atol=1e-9)


def test_places_are_forward_kinematics(windows: GapDataset) -> None:
    part = windows.parts[0][0]
    clip = clip_of(windows, part.sentences[0][:5])
    positions = kinematics.forward(clip)[1][:, 1:]
    turns = torch.tensor(rotation.to_matrix(part.sentences[0][:5]))
    bones = torch.tensor(part.bones.astype(float)).expand(5, -1, -1)
    found = bridge_task.places(turns, bones, windows.above.tolist())
    np.testing.assert_allclose(found.numpy(), positions, atol=1e-7)
    assert ROLES.index(TIPS[0]) in bridge_task.JUDGED


def test_padding_changes_nothing_and_every_weight_learns(windows: GapDataset) -> None:
    torch.manual_seed(0)
    network = Bridge(TOY)
    torch.nn.init.normal_(network.out.weight, std=0.1)
    batch: GapBatch = windows.batch(windows.rows(2, 6, 0))
    row = int(batch.real.sum(1).argmin())
    n = int(batch.real[row].sum())
    whole, alone = network(batch.tokens, batch.mask)[row, :n], network(batch.tokens[row : row + 1, : n + 16])[0]
    torch.testing.assert_close(whole, alone, atol=1e-5, rtol=1e-4)
    BridgeTask(network, windows.above.tolist())(batch).backward()
    assert all(p.grad is not None and p.grad.abs().sum() > 0 for p in network.parameters())


def test_rotary_scores_depend_on_distance_alone() -> None:
    q, k = torch.randn(1, 1, 1, 8).expand(-1, -1, 9, -1), torch.randn(1, 1, 1, 8).expand(-1, -1, 9, -1)
    turns = rope_angles(9, 8, q)
    scores = rotary(q, turns) @ rotary(k, turns).transpose(-1, -2)
    for offset in range(-4, 5):
        diagonal = torch.diagonal(scores[0, 0], offset)
        torch.testing.assert_close(diagonal, diagonal[:1].expand_as(diagonal), atol=1e-5, rtol=1e-5)


def test_one_batch_is_learned_by_heart(windows: GapDataset) -> None:
    torch.manual_seed(0)
    task = BridgeTask(Bridge(TOY), windows.above.tolist())
    batch = windows.batch([5, 6])
    optimiser = torch.optim.AdamW(task.parameters(), 3e-3)
    first = task(batch).item()
    for _ in range(120):
        loss = task(batch)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
    assert loss.item() < 0.6 * first


def test_captures_are_feigned_and_judging_is_clean(folder: Path, windows: GapDataset) -> None:
    clean = GapDataset(sorted(folder.glob("*.npz")), fixed=60)
    chest = ROLES.index("chest")
    spread = []
    for drawn in (clean, windows):
        gaps = [drawn.gap(k) for k in range(60)]
        spread.append(np.mean([rotation.angle_between(gap["true"][0, chest], rotation.IDENTITY) for gap in gaps]))
        short = [gap for gap in gaps if len(gap["true"]) <= 5]
        assert len(short) > 2
        # Whatever is done to the motion is done to what is shown and to what is hidden alike: they meet.
        assert max(rotation.angle_between(gap["base"], gap["true"]).mean() for gap in short) < 0.2
    assert spread[1] > 2.0 * spread[0]
    np.testing.assert_array_equal(clean.gap(3)["tokens"], clean.gap(3)["tokens"])


def test_hidden_stretches_teach_some_of_the_way_and_transitions_all_of_it(folder: Path) -> None:
    paths = sorted(folder.glob("*.npz"))
    taught, whole = GapDataset(paths, seed=4), GapDataset(paths, seed=4)
    whole.sure = 1.0
    shares: dict[bool, list[float]] = {True: [], False: []}
    for number in range(40):
        one, other = taught.gap(number), whole.gap(number)
        np.testing.assert_array_equal(one["tokens"], other["tokens"])
        way = rotation.angle_between(other["base"].astype(float), other["true"].astype(float))
        gone = rotation.angle_between(other["base"].astype(float), one["true"].astype(float))
        if way.sum() > 1e-3:  # some stand still
            shares[bool(one["seam"])].append(gone.sum() / way.sum())
    np.testing.assert_allclose(shares[True], 1.0, atol=1e-5)
    np.testing.assert_allclose(shares[False], gap_data.SURE, atol=0.01)


def test_the_left_arm_of_another_sentence() -> None:
    rng = np.random.default_rng(0)
    one, other = (rotation.normalize(rng.normal(size=(n, len(ROLES), 4))) for n in (12, 9))
    mixed = exchanged(one, other)
    assert len(mixed) == 9
    np.testing.assert_array_equal(mixed[:, LEFT], other[:, LEFT])
    np.testing.assert_array_equal(mixed[:, : LEFT.start], one[:9, : LEFT.start])
    np.testing.assert_array_equal(mixed[:, LEFT.stop :], one[:9, LEFT.stop :])


def test_numbers_beyond_what_was_learned_are_cut() -> None:
    x = torch.tensor([[0.0, 1.0, 100.0, -100.0]])
    torch.testing.assert_close(
        standard(x, torch.ones(4), torch.full((4,), 2.0)), torch.tensor([[-0.5, 0.0, 5.0, -5.0]])
    )
