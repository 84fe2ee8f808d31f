"""The makers of transition frames that the paper cites: their likelihoods, graphs and offsets, on few joints."""

from __future__ import annotations

import math

import pytest

torch = pytest.importorskip("torch")

from torch import Tensor, distributions  # noqa: E402

from signsplice_paper.train.losses import counter_loss, mixture_loss  # noqa: E402
from signsplice_paper.train.networks.cam_stitch import CamStitch, CamStitchConfig  # noqa: E402
from signsplice_paper.train.networks.generator import FRAME, START, Generator, generate  # noqa: E402
from signsplice_paper.train.networks.layers import Normaliser, bones  # noqa: E402
from signsplice_paper.train.networks.mixture_density import (  # noqa: E402
    WIDTH_FLOOR,
    Mixture,
    MixtureConfig,
    MixtureHead,
    MixtureTransformer,
)
from signsplice_paper.train.networks.skeletal_attention import (  # noqa: E402
    SkeletalAttention,
    SkeletalConfig,
    SkeletalTransformer,
    time_edges,
)

PARENTS = (-1, 0, 1, 1, 0)
FR = 3
MAKERS = ("mixture", "skeletal", "cam-stitch")


def maker(name: str) -> Generator:
    """A network for five joints."""
    torch.manual_seed(2)
    normaliser = Normaliser(torch.randn(15) * 0.1, torch.rand(15) + 0.5)
    if name == "mixture":
        return MixtureTransformer(MixtureConfig(16, 2, 1, 2, 24, 0.0, n_components=3), normaliser).eval()
    if name == "skeletal":
        return SkeletalTransformer(SkeletalConfig(8, 2, 1, 2, 16, dropout=0.0), normaliser, PARENTS).eval()
    return CamStitch(CamStitchConfig(FR, 16), normaliser).eval()


def culled(n_batch: int = 2) -> tuple[Tensor, Tensor, Tensor]:
    """Kept frames, their mask, and the number of frames of the first word."""
    mask = torch.ones(n_batch, 2 * FR, dtype=torch.bool)
    mask[0, 0] = False
    return torch.randn(n_batch, 2 * FR, 15), mask, torch.full((n_batch,), FR)


def mixture(*shape: int) -> Mixture:
    return Mixture(torch.randn(*shape, 3), torch.randn(*shape, 3, 4), torch.rand(*shape, 3) + 0.2)


def test_the_likelihood_of_a_mixture_is_that_of_torch_distributions() -> None:
    torch.manual_seed(0)
    made, frames = mixture(2, 5), torch.randn(2, 5, 4)
    parts = distributions.Independent(distributions.Normal(made.centres, made.widths[..., None]), 1)
    true = distributions.MixtureSameFamily(distributions.Categorical(logits=made.logits), parts)
    torch.testing.assert_close(made.log_likelihood(frames), true.log_prob(frames))  # type: ignore[no-untyped-call]


def test_a_mixture_head_has_softmax_linear_and_exponential_outputs() -> None:
    torch.manual_seed(0)
    head, states = MixtureHead(6, 4, 3), torch.randn(2, 5, 6)
    made = head.mixture(states)
    assert made.centres.shape == (2, 5, 3, 4)
    torch.testing.assert_close(made.widths, head.width(states).exp() + WIDTH_FLOOR)
    best = made.logits.argmax(-1)
    for row in range(2):
        for t in range(5):
            torch.testing.assert_close(head(states)[row, t], made.centres[row, t, best[row, t]])


def test_a_mixture_is_float32_where_the_network_computes_in_bfloat16() -> None:
    made = MixtureHead(6, 4, 3).bfloat16().mixture(torch.randn(5, 6, dtype=torch.bfloat16))
    assert {part.dtype for part in made} == {torch.float32}


def test_frames_of_a_mixture_are_fed_back_as_its_likeliest_centres() -> None:
    network = maker("mixture")
    assert isinstance(network, MixtureTransformer)
    encoded = network.encode(*culled())
    fed, kinds = torch.randn(2, 4, 16), torch.full((2, 4), FRAME)
    mixtures, counters = network.mixtures(encoded, fed, kinds)
    made, _, _ = network.decode(fed, kinds, torch.tensor(0), encoded.memory, encoded.state)
    torch.testing.assert_close(network.normaliser(made[..., :15]), mixtures.likeliest(), atol=1e-5, rtol=1e-4)
    torch.testing.assert_close(made[..., 15], counters)


def test_losses_of_mixtures_and_counters_leave_out_padding() -> None:
    real = torch.tensor([[True, True, False], [True, True, True]])
    likelihood = torch.tensor([[-2.0, -4.0, -100.0], [-3.0, -6.0, -9.0]])
    assert float(mixture_loss(likelihood, real, 2)) == pytest.approx((3.0 + 6.0) / 2 / 2)
    counter = torch.tensor([[0.5, 0.9, 7.0], [1 / 3, 2 / 3, 1.0]])
    assert float(counter_loss(counter, real, 3.0)) == pytest.approx(3.0 * 0.1**2 / 2 / 2)


def test_bones_join_parents_and_children() -> None:
    joined = {(a, b) for a, b in bones(PARENTS).nonzero().tolist() if a < b}
    assert joined == {(0, 1), (1, 2), (1, 3), (0, 4)}
    assert torch.equal(bones(PARENTS), bones(PARENTS).T)
    assert bones(PARENTS).diagonal().all()


def test_edges_in_time_reach_back_and_in_encoders_forward() -> None:
    back = time_edges(2, 3, 2, False, torch.device("cpu"))
    assert back.tolist() == [[False, True, True, False, False], [False, False, True, True, False]]
    both = time_edges(3, 0, 1, True, torch.device("cpu"))
    assert both.tolist() == [[False, True, False], [True, False, True], [False, True, False]]


@pytest.mark.parametrize("both_sides", [False, True])
def test_skeletal_attention_is_attention_masked_by_the_adjacency_matrix_of_all_nodes(both_sides: bool) -> None:
    torch.manual_seed(4)
    n_frames, n_joints, n_heads, reach = 4, len(PARENTS), 2, 2
    layer, x = SkeletalAttention(PARENTS, 6, n_heads), torch.randn(1, n_frames, n_joints, 6)
    nodes = [(t, j) for t in range(n_frames) for j in range(n_joints)]
    adjacency = torch.zeros(len(nodes), len(nodes), dtype=torch.bool)
    for a, (t, j) in enumerate(nodes):
        for b, (s, k) in enumerate(nodes):
            is_bone = t == s and (j == k or PARENTS[j] == k or PARENTS[k] == j)
            adjacency[a, b] = is_bone or (j == k and t != s and abs(t - s) <= reach and (both_sides or s < t))
    queries, keys, values = (
        part(x).reshape(len(nodes), n_heads, 3).transpose(0, 1) for part in (layer.query, layer.key, layer.value)
    )
    scores = (queries @ keys.mT / math.sqrt(3)).masked_fill(~adjacency, -math.inf)
    true = layer.out((scores.softmax(-1) @ values).transpose(0, 1).reshape(1, n_frames, n_joints, 6))
    near = time_edges(n_frames, 0, reach, both_sides, x.device)
    empty = torch.zeros(1, n_heads, n_joints, 0, 3)
    found, _ = layer(x, (empty, empty), near)
    torch.testing.assert_close(found, true)


def test_without_edges_a_joint_attends_to_itself_alone() -> None:
    torch.manual_seed(4)
    layer, x = SkeletalAttention((-1, -1, -1), 4, 2), torch.randn(2, 3, 3, 4)
    empty = torch.zeros(2, 2, 3, 0, 2)
    found, _ = layer(x, (empty, empty), time_edges(3, 0, 0, True, x.device))
    torch.testing.assert_close(found, layer.out(layer.value(x)))


def test_one_layer_of_a_skeleton_moves_a_joint_and_its_neighbours_only() -> None:
    torch.manual_seed(2)
    config = SkeletalConfig(8, 2, 0, 1, 16, dropout=0.0)
    network = SkeletalTransformer(config, Normaliser(torch.zeros(15), torch.ones(15)), PARENTS).eval()
    encoded = network.encode(*culled(1))
    fed, kinds = torch.randn(1, 3, 15), torch.full((1, 3), FRAME)
    made, _, _ = network.decode(fed, kinds, torch.tensor(0), encoded.memory, encoded.state)
    fed[0, 0, 6:9] += 1.0  # joint 2, whose only neighbour is joint 1
    other, _, _ = network.decode(fed, kinds, torch.tensor(0), encoded.memory, encoded.state)
    moved = (made - other).abs().reshape(3, 5, 3).amax(-1) > 1e-6
    assert moved.tolist() == [[False, True, True, False, False], [False, False, True, False, False], [False] * 5]


def test_cam_stitch_without_offsets_stays_at_the_last_frame_before_the_gap() -> None:
    network = maker("cam-stitch")
    assert isinstance(network, CamStitch)
    x, mask, n_before = culled()
    for parameter in network.frame.parameters():
        torch.nn.init.zeros_(parameter)
    for frames, kept in zip(generate(network, network.encode(x, mask, n_before), 2, 4), x, strict=True):
        torch.testing.assert_close(frames, kept[FR - 1 : FR].expand(len(frames), -1))


def test_cam_stitch_reads_the_second_word_backwards() -> None:
    network = maker("cam-stitch")
    assert isinstance(network, CamStitch)
    network.after.load_state_dict(network.before.state_dict())
    width = network.config.width
    with torch.no_grad():
        network.bridge.weight[:, width:] = -network.bridge.weight[:, :width]
        network.bridge.bias.zero_()
    half = torch.randn(1, FR, 15)
    encoded = network.encode(torch.cat([half, half.flip(1)], dim=1), culled(1)[1], torch.tensor([FR]))
    torch.testing.assert_close(encoded.state[1], torch.zeros(1, 1, width), msg="both sides were read alike")
    encoded = network.encode(torch.cat([half, half], dim=1), culled(1)[1], torch.tensor([FR]))
    assert encoded.state[1].abs().max() > 1e-3


@pytest.mark.parametrize("name", MAKERS)
def test_makers_take_any_number_of_joints_and_ignore_what_is_fed_at_the_start(name: str) -> None:
    network, kept = maker(name), culled()
    encoded = network.encode(*kept)
    assert encoded.tokens is None
    kinds = torch.full((2, 1), START)
    fed = torch.randn(2, 1, network.n_fed)
    fed[..., 15:] = 0.0  # the counter is no frame
    made, _, _ = network.decode(fed, kinds, torch.tensor(0), encoded.memory, encoded.state)
    zero, _, _ = network.decode(torch.zeros_like(fed), kinds, torch.tensor(0), encoded.memory, encoded.state)
    assert made.shape == (2, 1, network.n_fed)
    torch.testing.assert_close(made, zero)
    assert all(frames.shape[1] == 15 for frames in generate(network, encoded, 2, 4))
