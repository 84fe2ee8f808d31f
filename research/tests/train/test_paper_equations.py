"""The paper's equations against slow plain arithmetic, written from the equations alone."""

from __future__ import annotations

import math

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from torch import Tensor, nn  # noqa: E402

from signsplice.errors import InputError  # noqa: E402
from signsplice.splicing.lptransformer import cull  # noqa: E402
from signsplice_paper.train.networks import layers, recurrent, spsn  # noqa: E402

RNG = np.random.default_rng(5)


def tensor(values: np.ndarray) -> Tensor:
    out: Tensor = torch.tensor(np.asarray(values, np.float32))
    return out


def sigmoid(x: np.ndarray) -> np.ndarray:
    return np.asarray(1.0 / (1.0 + np.exp(-x)))


def test_lstm_is_equations_4_and_5_with_the_previous_cell() -> None:
    cell = recurrent.Lstm(3, 4)
    x = RNG.normal(size=(6, 3))
    names = dict(cell.cells.named_parameters())
    wx, wh, bx, bh = (
        names[k].detach().double().numpy() for k in ("weight_ih_l0", "weight_hh_l0", "bias_ih_l0", "bias_hh_l0")
    )
    h, c = np.zeros(4), np.zeros(4)
    states = []
    for t in range(6):
        i, f, g, o = np.split(wx @ x[t] + bx + wh @ h + bh, 4)
        c = sigmoid(f) * c + sigmoid(i) * np.tanh(g)
        h = sigmoid(o) * np.tanh(c)
        states.append(h)
    found, (last_h, last_c) = cell(tensor(x)[None])
    np.testing.assert_allclose(found[0].detach().numpy(), states, atol=1e-5)
    np.testing.assert_allclose(last_h[0, 0].detach().numpy(), h, atol=1e-5)
    np.testing.assert_allclose(last_c[0, 0].detach().numpy(), c, atol=1e-5)


def weights(decoded: np.ndarray, encoded: np.ndarray) -> np.ndarray:
    """Eq. 6 to 8 for each pair of states, as printed."""
    out = np.zeros((len(decoded), len(encoded)))
    for t in range(len(decoded)):
        scores = []
        for k in range(len(encoded)):
            total = 0.0
            for i in range(decoded.shape[1]):
                total += (decoded[t, i] - encoded[k, i]) ** 2
            scores.append(total / decoded.shape[1])
        raised = [math.exp(s) for s in scores]
        for k in range(len(encoded)):
            out[t, k] = 1.0 - raised[k] / sum(raised)
    return out


def spsn_network(width: int, attention: bool = True) -> spsn.Spsn:
    torch.manual_seed(0)
    normaliser = layers.Normaliser(torch.zeros(159), torch.ones(159))
    return spsn.Spsn(spsn.SpsnConfig(width, attention), normaliser).eval()


def test_attention_is_equations_6_to_9() -> None:
    decoded, encoded = RNG.normal(size=(4, 5)), RNG.normal(size=(7, 5))
    found = spsn.paper_attention_weights(spsn.score(tensor(decoded)[None], tensor(encoded)[None]))
    true = weights(decoded, encoded)
    np.testing.assert_allclose(found[0].numpy(), true, atol=1e-5)
    assert true[0].sum() == pytest.approx(6.0), "N + M - 1"

    network = spsn_network(5)
    with torch.no_grad():
        together = network.attend(tensor(decoded)[None], tensor(encoded)[None], None)[0].numpy()
    w_c = network.combine.weight.detach().double().numpy()
    for t in range(4):
        context = sum(true[t, k] * encoded[k] for k in range(7))
        np.testing.assert_allclose(together[t], np.tanh(w_c @ np.concatenate([context, decoded[t]])), atol=1e-4)


def test_the_context_of_an_untrained_spsn_is_no_larger_than_its_state() -> None:
    """Its weights sum to N + M - 1, so that eq. 9 would begin where tanh is flat."""
    network = spsn_network(64)
    encoded, decoded = (tensor(RNG.uniform(-0.5, 0.5, size=(1, spsn.USUAL_FRAMES, 64)) + 0.3) for _ in range(2))
    with torch.no_grad():
        attended = network.attend(decoded, encoded, None)
        network.combine.weight[:, :64] *= spsn.USUAL_FRAMES
        undivided = network.attend(decoded, encoded, None)
    assert attended.abs().max() < 0.95
    assert undivided.abs().median() > 0.95


def test_without_attention_the_decoders_states_are_classified() -> None:
    network, decoded = spsn_network(5, attention=False), tensor(RNG.normal(size=(1, 4, 5)))
    assert network.attend(decoded, tensor(RNG.normal(size=(1, 7, 5))), None) is decoded
    assert not hasattr(network, "combine")


@pytest.mark.parametrize("attention", [True, False])
def test_padding_changes_nothing(attention: bool) -> None:
    network = spsn_network(8, attention)
    x = tensor(RNG.normal(size=(1, 9, 159)))
    padded = torch.cat([x, torch.randn(1, 4, 159)], dim=1)
    mask = torch.arange(13)[None] < 9
    n = torch.tensor([4])
    torch.testing.assert_close(network(padded, n, mask)[:, :9], network(x, n), atol=1e-5, rtol=1e-5)


def test_each_token_is_excluded_from_the_other_word() -> None:
    logits = spsn.mask_impossible_tokens(torch.zeros(1, 6, 3), torch.tensor([2]))
    assert (logits[0, 2:, spsn.PRE] < -1e3).all()
    assert (logits[0, :2, spsn.POST] < -1e3).all()
    assert (logits[0, :2, spsn.PRE] == 0).all()
    assert (logits[0, 2:, spsn.POST] == 0).all()


@pytest.mark.parametrize(("pre", "post", "fr"), [(4, 3, 3), (1, 3, 4), (4, 5, 4), (0, 6, 2)])
def test_culling_is_equation_11_with_edges_repeated(pre: int, post: int, fr: int) -> None:
    p, q = RNG.normal(size=(6, 2)), RNG.normal(size=(7, 2))
    rows, real = [], []
    for k in range(pre - fr + 1, pre + 1):
        rows.append(p[k] if k >= 0 else p[0])
        real.append(k >= 0)
    for k in range(post, post + fr):
        rows.append(q[k] if k < len(q) else q[-1])
        real.append(k < len(q))
    found, mask = cull(p, q, pre, post, fr)
    np.testing.assert_array_equal(found, rows)
    np.testing.assert_array_equal(mask, real)


def test_culling_refuses_positions_outside_the_clips() -> None:
    p = np.zeros((5, 2))
    with pytest.raises(InputError, match="splice position 5, 0 in clips of 5 and 5 frames"):
        cull(p, p, 5, 0, 2)
    with pytest.raises(InputError, match="fr 0, expected at least 1"):
        cull(p, p, 1, 1, 0)


def test_positional_code_is_equation_12_with_cosines() -> None:
    found = layers.positional_encoding(torch.tensor([0, 1, 7, 130]), 10).numpy()
    for row, position in zip(found, (0, 1, 7, 130), strict=True):
        for i in range(5):
            angle = position / 10000 ** (2 * i / 10)
            assert row[2 * i] == pytest.approx(math.sin(angle), abs=1e-4)
            assert row[2 * i + 1] == pytest.approx(math.cos(angle), abs=1e-4)


def linear(layer: nn.Linear, x: np.ndarray) -> np.ndarray:
    return np.asarray(x @ layer.weight.detach().double().numpy().T + layer.bias.detach().double().numpy())


def test_multi_head_attention_is_equation_13() -> None:
    torch.manual_seed(1)
    attention = layers.MultiHead(6, 3)
    x, seen = RNG.normal(size=(4, 6)), RNG.normal(size=(5, 6))
    allowed = np.array([True, True, False, True, True])
    q, k, v = linear(attention.query, x), linear(attention.key, seen), linear(attention.value, seen)
    heads = []
    for head in range(3):
        part = slice(2 * head, 2 * head + 2)
        out = np.zeros((4, 2))
        for t in range(4):
            scores = [q[t, part] @ k[s, part] / math.sqrt(2) if allowed[s] else -math.inf for s in range(5)]
            raised = [math.exp(s) for s in scores]
            for s in range(5):
                out[t] += raised[s] / sum(raised) * v[s, part]
        heads.append(out)
    true = linear(attention.out, np.concatenate(heads, axis=1))
    keys_values = attention.keys_values(tensor(seen)[None])
    found = attention(tensor(x)[None], *keys_values, torch.from_numpy(allowed)[None, None, None])
    np.testing.assert_allclose(found[0].detach().numpy(), true, atol=1e-5)


def test_feed_forward_is_equation_14() -> None:
    feed = layers.FeedForward(4, 9)
    z = RNG.normal(size=(3, 4))
    true = linear(feed.second, np.maximum(linear(feed.first, z), 0.0)) + z
    np.testing.assert_allclose((tensor(z) + feed(tensor(z))).detach().numpy(), true, atol=1e-5)


def test_a_frame_attends_to_itself_and_earlier_frames() -> None:
    seen = layers.causal_mask(2, 3, torch.device("cpu")).numpy()
    np.testing.assert_array_equal(seen, [[1, 1, 1, 1, 0], [1, 1, 1, 1, 1]])


def test_the_normaliser_can_be_inverted() -> None:
    normaliser = layers.Normaliser(torch.randn(159), torch.rand(159) + 0.1)
    x = torch.randn(2, 3, 159)
    torch.testing.assert_close(normaliser.inverse(normaliser(x)), x)


def test_an_encoder_reads_frames_and_differences_within_a_word() -> None:
    x = RNG.normal(size=(2, 6, 159))
    n_before = [2, 4]
    found = layers.append_deltas(tensor(x), torch.tensor(n_before)).numpy()
    assert found.shape == (2, 6, 318)
    np.testing.assert_allclose(found[..., :159], x, atol=1e-6)
    for row in range(2):
        for t in range(6):
            delta = np.zeros(159) if t in (0, n_before[row]) else x[row, t] - x[row, t - 1]
            np.testing.assert_allclose(found[row, t, 159:], layers.DELTA_SCALE * delta, atol=1e-5)
