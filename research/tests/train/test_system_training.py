"""Training the systems of the paper: resuming, what they learn from, their sizes and steps."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch")

import onnx  # noqa: E402
from onnx import helper, numpy_helper  # noqa: E402
from torch import Tensor  # noqa: E402

from signsplice.errors import InputError  # noqa: E402
from signsplice.splicing.lptransformer import cull  # noqa: E402
from signsplice_paper import plan, published  # noqa: E402
from signsplice_paper.configs import read_config  # noqa: E402
from signsplice_paper.train import scales, training  # noqa: E402
from signsplice_paper.train.networks.convs2s import ConvS2SConfig  # noqa: E402
from signsplice_paper.train.networks.spsn import SpsnConfig  # noqa: E402
from signsplice_paper.train.networks.tfgn import TransformerConfig  # noqa: E402
from signsplice_paper.train.networks.word_spsn import WordSpsn, WordSpsnConfig  # noqa: E402
from signsplice_paper.train.pairs_data import PairsData  # noqa: E402
from signsplice_paper.train.stopping import PaperLoop  # noqa: E402
from signsplice_paper.train.words_data import load_split_words  # noqa: E402
from signsplice_workshop.corpora.pairs import Pairs  # noqa: E402
from signsplice_workshop.train import records  # noqa: E402
from signsplice_workshop.train.export import FLOAT16  # noqa: E402
from signsplice_workshop.train.loop import train  # noqa: E402
from system_toys import CONFIGS, FR, SPACE, data, toy  # noqa: E402
from training_toys import ALONE, corpus  # noqa: E402


def trained(name: str, folder: Path, untils: tuple[int | None, ...], optimiser: str = "adamw") -> dict[str, Tensor]:
    """Weights after a training of six steps in several calls, each of which stops at one of ``untils``."""
    folder.mkdir()
    fr = CONFIGS[name][1]
    for until in untils:
        task = toy(name)
        config = PaperLoop(6, 8, 1e-2, seed=1, every=4, until=until, method=optimiser)
        train(task, config, data("train", fr), data("valid", fr), folder, "toy", ALONE)
    return task.state_dict()


def losses(folder: Path) -> dict[int, float]:
    """The losses in a training's log by step."""
    return {line["step"]: line["loss"] for line in records.read_lines(folder / records.LOG_FILE) if "loss" in line}


@pytest.mark.parametrize(("name", "optimiser"), [("spsn", "adamw"), ("tfgn", "sgd"), ("lstm", "adamw")])
def test_a_resumed_training_ends_in_the_same_weights(tmp_path: Path, name: str, optimiser: str) -> None:
    whole = trained(name, tmp_path / "a", (None,), optimiser)
    parts = trained(name, tmp_path / "b", (2, 3, None), optimiser)
    for key, value in whole.items():
        assert torch.equal(value, parts[key]), key
    assert list(losses(tmp_path / "b")) == [1, 2, 3, 4, 5, 6]
    assert losses(tmp_path / "b") == losses(tmp_path / "a")


@pytest.mark.parametrize("system", list(published.CONDITIONS))
def test_a_system_as_printed_differs_from_equal_treatment_in_the_loss_of_its_tokens_alone(system: str) -> None:
    by = published.CONDITIONS[system]
    plain, weighted = (
        scales.make_parts(by[condition], "smoke") for condition in (published.AS_PRINTED, published.EQUAL)
    )
    assert replace(plain[0], name=weighted[0].name, plain_loss=False) == weighted[0]
    assert plain[1:] == weighted[1:], "the same network for the frames"
    pairs = data("train", None)
    found = {}
    for part in (plain[0], weighted[0]):
        torch.manual_seed(0)
        task = scales.make_task(part, pairs.normaliser(), 0).eval()
        found[part.plain_loss] = task(pairs.batch([0, 1, 2])).item()
    assert found[True] < found[False], "no weight of tokens, no pointer term"


def test_ablations_share_the_parts_of_lptransformer_but_those_that_lack_something() -> None:
    whole, wa, wc, wac = (scales.make_parts(name, "cpu") for name in (published.LPTRANSFORMER, *published.ABLATIONS))
    assert (wa[1], wc[0], wac) == (whole[1], whole[0], (wa[0], wc[1]))
    assert isinstance(whole[0].config, SpsnConfig)
    assert replace(wa[0], name="spsn", config=replace(whole[0].config, attention=False)) == replace(
        whole[0], config=replace(whole[0].config, attention=False)
    )
    assert (whole[1].fr, wc[1].fr) == (8, None), "without Culling the whole of both words is read"
    assert scales.make_parts(published.LPT_PLUS, "cpu")[1] == whole[1]


@pytest.mark.parametrize("split", ["random", "unseen-words", "unseen-signer"])
def test_parts_of_a_split_share_no_pair(split: str) -> None:
    train_part, valid, test = (set(corpus().split(split, part)) for part in ("train", "valid", "test"))
    assert not train_part & valid
    assert not train_part & test
    assert not valid & test


@pytest.mark.parametrize("fr", [None, FR])
def test_training_reads_no_test_pair(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, fr: int | None) -> None:
    pairs = corpus()
    read: set[int] = set()
    words: set[int] = set()
    truth, word = Pairs.truth, Pairs.word

    def spied_truth(self: Pairs, number: int, kind: str = "positions") -> object:
        read.add(number)
        return truth(self, number, kind)

    def spied_word(self: Pairs, number: int, kind: str = "positions") -> object:
        words.add(number)
        return word(self, number, kind)

    monkeypatch.setattr(Pairs, "truth", spied_truth)
    monkeypatch.setattr(Pairs, "word", spied_word)
    for split in ("random", "unseen-words"):
        read.clear()
        words.clear()
        dataset = PairsData(pairs, split, "train", fr)
        train_pairs = set(pairs.split(split, "train"))
        for step in range(5):
            assert set(dataset.batch(dataset.rows(step, 8, 0), step).numbers.tolist()) <= train_pairs
        assert read == train_pairs
        assert words == set(np.asarray(pairs.index)[sorted(train_pairs), :2].ravel().tolist())


def test_a_pass_over_the_data_holds_every_pair_once() -> None:
    dataset = data()
    assert len(dataset) == 20
    first = [dataset.rows(step, 4, 0).tolist() for step in range(5)]
    assert sorted(row for rows in first for row in rows) == list(range(20))
    assert [dataset.rows(step, 4, 0).tolist() for step in range(5)] == first
    assert [dataset.rows(step + 5, 4, 0).tolist() for step in range(5)] != first
    assert [dataset.rows(step, 4, 1).tolist() for step in range(5)] != first


def test_a_batch_holds_the_pairs_of_the_corpus() -> None:
    dataset, pairs = data(), corpus()
    batch = dataset.batch([0, 5, 11])
    for k, number in enumerate(batch.numbers.tolist()):
        p, q = pairs.index[number, :2].tolist()
        pre, post, new = pairs.truth(number)
        x = np.concatenate([pairs.word(p), pairs.word(q)])
        np.testing.assert_array_equal(batch.x[k, : len(x)], x)
        assert batch.mask[k].sum() == len(x)
        assert (int(batch.pre[k]), int(batch.post[k])) == (pre, len(pairs.word(p)) + post)
        np.testing.assert_array_equal(batch.new[k, : len(new)], new)
        assert batch.real[k].sum() == len(new)


def test_a_culled_batch_follows_equation_11() -> None:
    batch, pairs = data(fr=FR).batch([0, 7]), corpus()
    for k, number in enumerate(batch.numbers.tolist()):
        p, q = pairs.index[number, :2].tolist()
        pre, post, _ = pairs.truth(number)
        rows, real = cull(pairs.word(p), pairs.word(q), pre, post, FR)
        np.testing.assert_array_equal(batch.x[k], rows)
        np.testing.assert_array_equal(batch.mask[k], real)
        assert (int(batch.n_before[k]), int(batch.pre[k]), int(batch.post[k])) == (FR, FR - 1, FR)


def test_the_paper_scale_has_the_paper_sizes() -> None:
    spsn, tfgn = scales.make_parts("lptransformer", "paper")
    assert spsn.config == SpsnConfig(512, attention=True)
    words = scales.make_parts("lpt-plus", "paper")[0].config
    assert isinstance(words, WordSpsnConfig)
    assert words.width == 512
    config = tfgn.config
    assert isinstance(config, TransformerConfig)
    assert (config.width, config.n_heads, config.n_encoder_layers, config.n_decoder_layers) == (512, 8, 6, 6)
    assert tfgn.fr == 8
    convolutions = scales.make_parts("conv-s2s", "paper")[0].config
    assert isinstance(convolutions, ConvS2SConfig)
    assert (convolutions.width, convolutions.n_encoder_layers, convolutions.n_decoder_layers) == (512, 20, 20)
    for system in scales.SYSTEMS:
        for scale in plan.SCALES:
            for part in scales.make_parts(system, scale):
                json.dumps(part.facts())


def test_unknown_systems_and_scales_are_refused() -> None:
    with pytest.raises(InputError, match="no system 'gpt', expected all or one of lptransformer, lpt-plus"):
        scales.make_parts("gpt", "cpu")
    with pytest.raises(InputError, match="--fr 4, but lstm has no Culling layer"):
        scales.make_parts("lstm", "cpu", 4)
    with pytest.raises(InputError, match="no scale 'huge'"):
        scales.make_parts("lpt-plus", "huge")


def test_sgd_gets_more_steps_at_cpu_scale() -> None:
    adamw, sgd = (scales.make_parts("lpt-plus", "cpu", optimiser=optimiser)[1].steps for optimiser in ("adamw", "sgd"))
    assert sgd == 5 * adamw
    assert scales.make_parts("lpt-plus", "cpu", steps=7, optimiser="sgd")[1].steps == 7


def test_the_measures_of_lpt_plus_are_of_the_corpus_s_skeleton_and_fitted_to_its_words(tmp_path: Path) -> None:
    config = training.Training("lpt-plus", "smoke", steps=1, n_judgements=1)
    part = training.fit_to_skeleton(scales.make_parts("lpt-plus", "smoke", steps=1)[0], corpus())
    assert isinstance(part.config, WordSpsnConfig)
    named = [[SPACE.joints[joint].rpartition(":")[2] for joint in hand] for hand in part.config.hands]
    fingers = [f"{side}Hand{finger}3" for side in ("Left", "Right") for finger in ("Index", "Middle", "Ring", "Pinky")]
    assert named == [["LeftHand", *fingers[:4]], ["RightHand", *fingers[4:]]]
    made = training.train_part(part, config, corpus(), tmp_path, ALONE).network
    assert isinstance(made, WordSpsn)
    fitted = WordSpsn(part.config, made.normaliser)
    fitted.fit_measures(load_split_words(corpus(), "random", "train").words)
    torch.testing.assert_close((made.mean, made.deviation), (fitted.mean, fitted.deviation))
    json.dumps(part.facts())


def test_an_exported_bundle_has_16_bit_weights_and_a_bias_only_in_equal_treatment(tmp_path: Path) -> None:
    graph = helper.make_graph([], "g", [], [], [numpy_helper.from_array(np.ones((64, 64), np.float32), "weight")])
    content = helper.make_model(graph).SerializeToString()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(training, "export_paper_graphs", lambda *_: {"spsn.onnx": content})
        for system in ("lptransformer", "lptransformer-printed", "lpt-plus"):
            config = training.Training(system, "smoke", steps=1, n_judgements=1)
            training.make(config, corpus(), tmp_path / system, tmp_path / "parts", ALONE)
    stored = {path.name: read_config(path) for path in tmp_path.iterdir() if path.name != "parts"}
    for path, made in stored.items():
        assert made.precision == FLOAT16
        (weights,) = onnx.load(tmp_path / path / "spsn.onnx").graph.initializer
        assert numpy_helper.to_array(weights).dtype == np.float16
    assert "token_bias" in stored["lptransformer"].stored["runs"]
    for name in ("lptransformer-printed", "lpt-plus"):
        assert "token_bias" not in stored[name].stored["runs"], "as printed it has none, word by word it needs none"
