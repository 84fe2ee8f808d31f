"""Systems of untrained toys as bundles, and what is expected of each: onnxruntime predicts what torch predicts."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import torch

from signsplice_paper.systems import DECODINGS, PaperSystem, TwoNetworkSystem, open_bundle
from signsplice_paper.train import graphs, scales, training
from signsplice_paper.train.networks.generator import Generator, generate
from signsplice_paper.train.pairs_data import Batch
from signsplice_paper.train.scales import SystemPart
from signsplice_paper.train.tasks import MOST_FRAMES, TokenTask, WordTask, find_positions
from signsplice_workshop.train.bundles import write_bundle
from signsplice_workshop.train.tasks import Task
from system_toys import CONFIGS, data, toy
from training_toys import corpus


@pytest.fixture(scope="module", autouse=True)
def cached_operators() -> Iterator[None]:
    """Parse the source of the exporter's 500 operators once, not in every export, which takes two seconds."""
    with pytest.MonkeyPatch.context() as patch:
        apis = pytest.importorskip("onnxscript._framework_apis.torch_2_5")
        patch.setattr(apis, "get_torchlib_ops", cache(apis.get_torchlib_ops))
        yield


@pytest.fixture(scope="module")
def exports() -> dict[str, dict[str, bytes]]:
    """ONNX graphs by part, exported once; exporting compares torch with onnxruntime."""
    return {}


@pytest.fixture
def bundle(
    request: pytest.FixtureRequest, tmp_path: Path, exports: dict[str, dict[str, bytes]]
) -> tuple[PaperSystem, list[Task]]:
    """A system of untrained toys as a bundle, and its tasks."""
    system: str = request.param
    tasks, chosen = [], []
    files: dict[str, bytes] = {}
    for name in scales.SYSTEMS[system]:
        made = toy(name)
        _randomise_heads(made)
        network = name.removesuffix(scales.AS_PRINTED)  # another loss, which an untrained toy knows nothing of
        if network not in exports:
            exports[network] = graphs.export_paper_graphs(made.network, CONFIGS[name][1])
        files |= exports[network]
        tasks.append(made.eval())
        chosen.append(SystemPart(name, CONFIGS[name][0], CONFIGS[name][1], 10, 8, 1e-2))
    config = training.Training(system, "smoke")
    write_bundle(tmp_path, training.facts(config, corpus(), tuple(chosen), tasks, [tmp_path] * len(chosen)), files)
    return open_bundle(tmp_path), tasks


def _randomise_heads(made: Task) -> None:
    """Set the weights of the heads, so that an untrained network emits tokens and different frames."""
    for name, parameter in made.named_parameters():
        if name.endswith(("token.bias", "out.bias")) and parameter.shape == (3,):
            torch.nn.init.zeros_(parameter)
        if name.endswith(("token.weight", "out.weight")):
            torch.nn.init.normal_(parameter, std=1.0)


def torch_frames(made: Task, batch: Batch, parallel: bool) -> np.ndarray:
    network = made.network
    with torch.no_grad():
        assert isinstance(network, Generator)
        encoded = network.encode(batch.x, batch.mask, batch.n_before, batch.marks)
        return np.asarray(generate(network, encoded, 1, MOST_FRAMES, parallel)[0])


def torch_positions(made: Task, batch: Batch) -> tuple[int | None, int | None]:
    with torch.no_grad():
        if isinstance(made, TokenTask | WordTask):
            logits = made.network(batch.x, batch.n_before, batch.mask)
        else:
            network = made.network
            assert isinstance(network, Generator)
            logits = network.encode(batch.x, batch.mask, batch.n_before).tokens
    at, emitted = find_positions(logits, batch.mask)
    pre, post = (int(k) if found else None for k, found in zip(at[0], emitted[0], strict=True))
    return pre, None if post is None else post - int(batch.n_before)


def check_predictions(bundle: tuple[PaperSystem, list[Task]]) -> None:
    """A bundle has the positions and the frames of its networks in torch, in every decoding."""
    system, tasks = bundle
    pairs = corpus()
    concurrent = system.config.runs is not None and system.config.runs.concurrent
    for row in range(3):
        batch = data().batch([row])
        p, q = pairs.index[int(batch.numbers[0]), :2].tolist()
        before, after = pairs.word(p).astype(float), pairs.word(q).astype(float)
        found = system.predict(before, after)
        pre, post = torch_positions(tasks[0], batch)
        assert (found.pre, found.post) == (pre, post)
        for decoding in DECODINGS if concurrent else DECODINGS[:2]:
            now = open_bundle(system.graphs.folder, decoding)
            seen = batch
            if isinstance(now, TwoNetworkSystem):
                seen = data(fr=system.fr).batch([row])
                true_pre, true_post, _ = pairs.truth(int(batch.numbers[0]))
                frames = now.fill(before, after, true_pre, true_post)
            else:
                frames = now.predict(before, after).frames
            expected = torch_frames(tasks[-1], seen, decoding == "parallel")
            assert frames.shape == expected.shape
            np.testing.assert_allclose(frames, expected, atol=1e-4)
    assert system.n_parameters == sum(p.numel() for t in tasks for p in t.network.parameters())
