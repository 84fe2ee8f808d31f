"""Every network: shapes, gradients, overfitting one batch, and agreement between its forms of decoding."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

torch = pytest.importorskip("torch")

from torch import Tensor  # noqa: E402

from signsplice_paper.train import scales  # noqa: E402
from signsplice_paper.train.losses import token_loss  # noqa: E402
from signsplice_paper.train.networks.convs2s import ConvS2S  # noqa: E402
from signsplice_paper.train.networks.generator import FRAME, HIDDEN, START, Generator, generate  # noqa: E402
from signsplice_paper.train.networks.layers import append_deltas  # noqa: E402
from signsplice_paper.train.networks.spsn import POST, PRE, Spsn  # noqa: E402
from signsplice_paper.train.pairs_data import Batch, mark_splice  # noqa: E402
from signsplice_paper.train.tasks import (  # noqa: E402
    MOST_FRAMES,
    feed_own_frames,
    find_positions,
    fit_token_bias,
    make_decoder_input,
)
from system_toys import CONFIGS, FR, GENERATORS, data, part_toy, toy  # noqa: E402


def batch(name: str, n: int = 4) -> Batch:
    return data("train", CONFIGS[name][1]).batch(range(n))


def taught_batch(name: str, step: int = 0) -> Any:
    """A batch of what a part learns from."""
    return part_toy(name)[1].batch(range(4), step)


def token_logits(network: Any, one: Batch) -> Tensor:
    with torch.no_grad():
        if isinstance(network, Spsn):
            found: Tensor = network(one.x, one.n_before, one.mask)
            return found
        assert isinstance(network, Generator)
        logits = network.encode(one.x, one.mask, one.n_before).tokens
        assert logits is not None
        return logits


@pytest.mark.parametrize("name", CONFIGS)
def test_every_weight_gets_a_gradient(name: str) -> None:
    made = toy(name)
    made.network.train()
    for parameter in made.parameters():
        torch.nn.init.normal_(parameter, std=0.2)  # some start at zero, which stops gradients before them
    loss = made(taught_batch(name)) + made(taught_batch(name, 1))
    loss.backward()
    for label, parameter in made.named_parameters():
        if parameter.requires_grad:
            assert parameter.grad is not None, label
            assert torch.isfinite(parameter.grad).all(), label
            key_bias = label.endswith("key.bias")  # a shift of all keys does not change the softmax
            assert parameter.grad.abs().max() > 0 or key_bias, label


def test_states_of_deep_convolutions_start_at_one_size() -> None:
    """At cpu scale, with 20 + 20 layers: no layer's states are much larger than the first's, and gradients do not
    explode. A toy of three layers would not show either.
    """
    part = scales.make_parts("conv-s2s", "cpu")[0]
    torch.manual_seed(0)
    made = scales.make_task(part, data().normaliser(), 0)
    sizes: list[float] = []
    network: Any = made.network
    for layer in network.encoder:
        layer.register_forward_hook(lambda _, __, out: sizes.append(float(out.detach().std())))
    loss = made(data().batch(range(4)))
    loss.backward()
    assert len(sizes) == 20
    assert max(sizes) < 2.0 * min(sizes)
    assert float(torch.nn.utils.get_total_norm([p.grad for p in made.parameters() if p.grad is not None])) < 1e3


def test_ten_steps_of_adamw_enlarge_the_inputs_of_convs2s_less_than_twofold() -> None:
    """At cpu scale, whatever the gradients: each step moves each weight by the rate."""
    part = scales.make_parts("conv-s2s", "cpu")[0]
    torch.manual_seed(0)
    network: Any = scales.make_task(part, data().normaliser(), 0).network.eval()
    one = data().batch(range(1))

    def largest_input() -> float:
        with torch.no_grad():
            _, states, values = network.encode(one.x, one.mask, one.n_before).memory
        return float((values * 2.0**0.5 - states).abs().max())  # values are the sum of states and inputs over sqrt(2)

    before = largest_input()
    numbers = append_deltas(network.normaliser(one.x), one.n_before)[0]
    length, direction = (weight for name, weight in network.embedding.named_parameters() if "weight" in name)
    with torch.no_grad():
        direction += 10 * part.rate * numbers[numbers.abs().sum(1).argmax()].sign()
        length += 10 * part.rate
    assert largest_input() < 2.0 * before


def test_a_step_changes_the_length_of_an_output_s_weights_in_convs2s_by_no_more_than_the_rate() -> None:
    """Each weight of its own could move by the rate, and the length of all 48 of an output seven times as far."""
    made, rate = toy("conv-s2s"), 1e-2

    def lengths() -> list[Tensor]:
        layers: list[Any] = [layer for layer in made.modules() if hasattr(layer, "parametrizations")]
        return [layer.weight.detach().flatten(1).norm(dim=1) for layer in layers]

    optimiser, before = torch.optim.AdamW(made.parameters(), lr=rate, weight_decay=0.0), lengths()
    assert len(before) > 10
    for step in range(3):
        optimiser.zero_grad()
        made(data("train").batch(range(4), step)).backward()
        optimiser.step()
        after = lengths()
        assert all(float((a - b).abs().max()) < 1.5 * rate for a, b in zip(after, before, strict=True))
        before = after


@pytest.mark.parametrize("name", GENERATORS)
def test_generators_return_frames_tokens_and_end_logits(name: str) -> None:
    network = toy(name).network
    assert isinstance(network, Generator)
    one = batch(name)
    kinds = torch.full(one.real.shape, FRAME)
    kinds[:, 0] = START
    tokens, made, last = network(one.x, one.mask, one.n_before, torch.zeros_like(one.new), kinds, one.marks)
    assert made.shape == one.new.shape
    assert last.shape == one.real.shape
    assert (tokens is not None) == (name in ("transformer", "conv-s2s", "lstm"))
    if tokens is not None:
        assert tokens.shape == (*one.x.shape[:2], 3)


@pytest.mark.parametrize("name", GENERATORS)
def test_cached_decoding_equals_uncached_decoding(name: str) -> None:
    torch.manual_seed(3)
    network = toy(name).network.eval()
    assert isinstance(network, Generator)
    one = batch(name, 3)
    frames = torch.randn(3, 6, 159) * 0.2
    kinds = torch.full((3, 6), FRAME)
    kinds[:, 0] = START
    with torch.no_grad():
        _, whole, ends = network(one.x, one.mask, one.n_before, frames, kinds, one.marks)
        encoded = network.encode(one.x, one.mask, one.n_before, one.marks)
        state = encoded.state
        for first, stop in ((0, 1), (1, 3), (3, 6)):
            made, last, state = network.decode(
                frames[:, first:stop], kinds[:, first:stop], torch.tensor(first), encoded.memory, state
            )
            torch.testing.assert_close(made, whole[:, first:stop], atol=1e-5, rtol=1e-4)
            torch.testing.assert_close(last, ends[:, first:stop], atol=1e-4, rtol=1e-4)


@pytest.mark.parametrize("name", [name for name in GENERATORS if name not in ("lstm",)])
def test_padding_of_the_input_changes_nothing(name: str) -> None:
    network = toy(name).network.eval()
    assert isinstance(network, Generator)
    rows = data("train", CONFIGS[name][1])
    alone, both = rows.batch([0]), rows.batch([0, 1, 2, 3])
    with torch.no_grad():
        one = generate(network, network.encode(alone.x, alone.mask, alone.n_before, alone.marks), 1, 5)
        many = generate(network, network.encode(both.x, both.mask, both.n_before, both.marks), 4, 5)
    count = min(len(one[0]), len(many[0]))
    torch.testing.assert_close(one[0][:count], many[0][:count], atol=1e-4, rtol=1e-3)


@pytest.mark.parametrize("name", ["tfgn", "transformer"])
def test_frames_of_one_pass_do_not_depend_on_later_frames(name: str) -> None:
    network = toy(name).network.eval()
    assert isinstance(network, Generator)
    one = batch(name, 2)
    encoded = network.encode(one.x, one.mask, one.n_before)
    for parameter in network.last.parameters():  # type: ignore[union-attr]
        torch.nn.init.constant_(parameter, -1.0 if parameter.ndim == 1 else 0.0)
    few, many = (generate(network, encoded, 2, most, parallel=True) for most in (4, MOST_FRAMES))
    assert [len(frames) for frames in few] == [4, 4], "no frame is classified as the last one"
    torch.testing.assert_close(few[0], many[0][:4], atol=1e-5, rtol=1e-4)


@pytest.mark.parametrize("name", CONFIGS)
def test_every_network_can_overfit_one_batch(name: str) -> None:
    steps, rate = 120, 1e-2
    made = toy(name)
    one = taught_batch(name)
    weights = [p for p in made.parameters() if p.requires_grad]
    optimiser = torch.optim.Adam(weights, lr=rate)
    first = float(made(one).detach())
    for step in range(steps):
        for group in optimiser.param_groups:
            group["lr"] = rate * (1.0 - step / steps)
        loss = made(replace(one, step=step) if isinstance(one, Batch) else one)
        optimiser.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(weights, 1.0)
        optimiser.step()
    assert float(loss.detach()) < 0.25 * first, f"{first} -> {float(loss.detach())}"
    made.eval()
    with torch.no_grad():
        scores = made.judge(one)
    if "paa" in scores and not name.endswith(scales.AS_PRINTED):  # plain cross-entropy favours "none"
        assert scores["paa"] == 1.0, scores
    if "accuracy" in scores:
        assert scores["length"] == 1.0, scores
        assert scores["accuracy"] > 0.97, scores


@pytest.mark.parametrize("name", ["conv-s2s", "lstm", "transformer", "spsn", "spsn-printed"])
def test_every_token_depends_on_both_words_to_their_ends(name: str) -> None:
    """A system whose tokens see only some frames to either side could do no better than a table of words."""
    torch.manual_seed(0)
    network = toy(name).network.eval()
    one = batch(name, 1)

    changed = replace(one, x=one.x.clone())
    changed.x[:, -1] += 0.1
    assert (token_logits(network, changed) - token_logits(network, one))[0, 0, :2].abs().max() > 1e-7, (
        "the first frame's token, the last frame's pose"
    )


def test_without_culling_frames_depend_on_the_marked_positions() -> None:
    torch.manual_seed(0)
    network = toy("tfgn-wc").network.eval()
    assert isinstance(network, Generator)
    one = batch("tfgn-wc", 2)
    with torch.no_grad():
        frames = [
            generate(network, network.encode(one.x, one.mask, one.n_before, marks), 2, 5)[0][0]
            for marks in (one.marks, mark_splice(one.pre - 1, one.post, one.x.shape[1]))
        ]
    assert one.marks.sum((1, 2)).tolist() == [2.0, 2.0]
    assert not torch.allclose(frames[0], frames[1])
    assert mark_splice(torch.tensor([-1]), torch.tensor([-1]), 5).sum() == 0, "positions that were not found"


def test_the_plain_token_loss_is_cross_entropy() -> None:
    torch.manual_seed(0)
    logits = torch.randn(2, 7, 3)
    pre, post = torch.tensor([1, 2]), torch.tensor([4, 6])
    labels = torch.zeros(2, 7, dtype=torch.long)
    labels[[0, 1], pre], labels[[0, 1], post] = PRE, POST
    expected = torch.nn.functional.cross_entropy(logits.flatten(0, 1), labels.flatten())
    torch.testing.assert_close(token_loss(logits, pre, post, plain=True), expected)
    assert token_loss(logits, pre, post) > 2.0 * expected


def test_positions_are_the_likeliest_frames_of_winning_tokens() -> None:
    logits = torch.full((1, 5, 3), -5.0)
    logits[..., 0] = 0.0
    logits[0, 1, 1], logits[0, 3, 2], logits[0, 4, 2] = -1.0, 2.0, 3.0
    at, emitted = find_positions(logits, torch.ones(1, 5, dtype=torch.bool))
    assert at.tolist() == [[1, 4]]
    assert emitted.tolist() == [[False, True]]
    _, emitted = find_positions(logits, torch.tensor([[True, True, True, False, False]]))
    assert emitted.tolist() == [[False, False]], "padding emits nothing"


def test_fed_frames_are_delayed_and_depend_only_on_the_pair() -> None:
    made, one = toy("tfgn"), batch("tfgn", 4)
    network = made.network
    assert isinstance(network, Generator)
    normaliser = data().normaliser()
    whole = make_decoder_input(one, network, normaliser, 0)
    part = make_decoder_input(data("train", FR).batch([2, 3]), network, normaliser, 0)
    n = min(whole.frames.shape[1], part.frames.shape[1])
    torch.testing.assert_close(whole.frames[2:, :n], part.frames[:, :n])
    assert (whole.kinds[:, 0] == START).all()
    assert set(whole.kinds.flatten().tolist()) <= {START, FRAME, HIDDEN}
    spread = (whole.frames[:, 1:] - one.new[:, :-1]) / normaliser.deviation
    assert spread.std() == pytest.approx(0.1, rel=0.05)


@pytest.mark.parametrize("name", ["lstm", "conv-s2s"])
def test_untaught_pairs_are_fed_what_the_network_generates(name: str) -> None:
    made, one = toy(name), batch(name, 4)
    network = made.network.eval()
    assert isinstance(network, Generator)
    for parameter in network.last.parameters():  # type: ignore[union-attr]
        torch.nn.init.constant_(parameter, -1.0 if parameter.ndim == 1 else 0.0)  # it never ends
    inputs = make_decoder_input(one, network, data().normaliser(), 0)
    shown = replace(inputs, kinds=torch.where(inputs.kinds == HIDDEN, FRAME, inputs.kinds))
    assert 0 < int(inputs.untaught.sum()) < len(inputs.untaught)
    encoded = network.encode(one.x, one.mask, one.n_before)
    fed = feed_own_frames(network, encoded, shown).frames
    made_alone = torch.stack(generate(network, encoded, 4, fed.shape[1]))
    torch.testing.assert_close(fed[shown.untaught, 1:], made_alone[shown.untaught, :-1])
    torch.testing.assert_close(fed[~shown.untaught], shown.frames[~shown.untaught])


def test_attention_gives_the_encoder_of_convs2s_a_fraction_of_its_gradient() -> None:
    network, one = toy("conv-s2s").network, batch("conv-s2s", 2)
    assert isinstance(network, ConvS2S)
    weights = next(network.encoder.parameters())

    def gradient() -> Tensor:
        keys = network.eval().encode(one.x, one.mask, one.n_before).memory[1]
        (found,) = torch.autograd.grad(keys.sum(), weights)
        assert isinstance(found, Tensor)
        return found

    scaled = gradient()
    network._scale_gradient = lambda gradient: gradient  # type: ignore[method-assign]
    torch.testing.assert_close(scaled * 2 * len(network.decoder), gradient())


@pytest.mark.parametrize("name", ["spsn", "transformer"])
def test_the_token_bias_emits_all_tokens_and_moves_none(name: str) -> None:
    torch.manual_seed(3)
    task = toy(name)
    rows = data("train")
    batch = rows.batch(range(len(rows)))
    network = task.network.eval()
    logits = token_logits(network, batch) - torch.tensor([0.0, 5.0, 5.0])
    at, emitted = find_positions(logits, batch.mask)
    assert not emitted.all()
    last: Any = network.out if isinstance(network, Spsn) else network.token
    last.bias.data -= torch.tensor([0.0, 5.0, 5.0])
    bias = fit_token_bias(task, rows)
    assert bias > 0.0
    biased, all_emitted = find_positions(
        token_logits(network, batch) + bias * torch.tensor([0.0, 1.0, 1.0]), batch.mask
    )
    assert all_emitted.all()
    assert torch.equal(biased, at)
    last.bias.data += torch.tensor([0.0, 50.0, 50.0])
    assert fit_token_bias(task, rows) == 0.0
