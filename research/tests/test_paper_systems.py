"""Running bundles without torch: refusals, and what a system does with the outputs of its graphs."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from signsplice.errors import InputError
from signsplice.splicing.bundle import BUNDLE_FILE, Sessions, read_file
from signsplice.splicing.lptransformer import HIDDEN, START, splice_positions
from signsplice_paper.configs import parse_config, read_config
from signsplice_paper.systems import OneNetworkSystem, TwoNetworkSystem, open_bundle
from signsplice_paper.systems.splicers import DECODINGS, PaperSystem
from signsplice_workshop.train.bundles import write_bundle

Array = NDArray[Any]
RUNS = {"positions": "spsn", "frames": "generator", "concurrent": True, "n_fed": 159, "most_frames": 6}
CONFIG: dict[str, Any] = {"system": "lpt-plus", "fr": 2, "runs": RUNS}


class Fakes(Sessions):
    """Functions in place of graphs.

    - fakes: graph name -> function of its inputs
    - seen: graph name and inputs of every call
    """

    def __init__(self, graphs: Mapping[str, Callable[[Mapping[str, Array]], dict[str, Array]]]) -> None:
        super().__init__(Path(), parse_config({}, Path()))
        self.fakes = graphs
        self.seen: list[tuple[str, dict[str, Array]]] = []

    def run(self, name: str, inputs: Mapping[str, Array], **shapes: tuple[int | None, ...]) -> dict[str, Array]:
        self.seen.append((name, dict(inputs)))
        return self.fakes[name](inputs)


def fake_system(kind: type[PaperSystem], graphs: Fakes, decoding: str = "one-by-one", **changes: Any) -> Any:
    """A system of fake graphs, with changes of its bundle.json."""
    config = parse_config({**CONFIG, **changes}, Path(BUNDLE_FILE))
    assert config.runs is not None
    return kind(config, config.runs, graphs, decoding)


def tokens(n: int, pre: int | None, post: int | None) -> dict[str, Array]:
    logits = np.tile([1.0, 0.0, 0.0], (n, 1)).astype(np.float32)
    if pre is not None:
        logits[pre, 1] = 3.0
    if post is not None:
        logits[post, 2] = 3.0
    return {"tokens": logits[None]}


def counting(inputs: Mapping[str, Array]) -> dict[str, Array]:
    """A decoder whose k-th frame is all k, and whose fourth frame is the last; its state counts the frames."""
    n_new, first = inputs["fed"].shape[1], int(inputs["start"])
    at = first + 1 + np.arange(n_new)
    assert int(inputs["state_0"]) == first
    return {
        "made": np.repeat(at[None, :, None], 159, axis=2).astype(np.float32),
        "last": np.where(at >= 4, 1.0, -1.0)[None].astype(np.float32),
        "next_state_0": np.array(first + n_new),
    }


def encoder(inputs: Mapping[str, Array]) -> dict[str, Array]:
    return {"memory_0": inputs["mask"], "state_0": np.array(0)}


@pytest.mark.parametrize("decoding", DECODINGS)
def test_frames_end_with_the_first_last_frame(decoding: str) -> None:
    graphs = Fakes({"spsn": lambda _: tokens(12, 3, 8), "encoder": encoder, "decoder": counting})
    system = fake_system(TwoNetworkSystem, graphs, decoding)
    before, after = np.arange(6)[:, None] * np.ones(159), 10 + np.arange(6)[:, None] * np.ones(159)
    found = system.predict(before, after)
    assert (found.pre, found.post) == (3, 2)
    np.testing.assert_array_equal(found.frames[:, 0], [1, 2, 3, 4])
    assert found.frames.dtype == np.float64
    encoded = dict(graphs.seen)["encoder"]
    np.testing.assert_array_equal(encoded["x"][0, :, 0], [2, 3, 12, 13], "culled to two frames on each side")
    steps = [inputs for name, inputs in graphs.seen if name == "decoder"]
    assert len(steps) == (1 if decoding == "parallel" else 4)
    if decoding == "one-by-one":
        assert [int(step["kinds"][0, 0]) for step in steps] == [START, 1, 1, 1]
        assert [float(step["fed"][0, 0, 0]) for step in steps] == [0, 1, 2, 3]
    elif decoding == "without-cache":
        assert [int(step["start"]) for step in steps] == [0, 0, 0, 0]
        assert steps[3]["kinds"].tolist() == [[START, 1, 1, 1]]
        assert steps[3]["fed"][0, :, 0].tolist() == [0, 1, 2, 3]
    else:
        assert steps[0]["kinds"].tolist() == [[START, *[HIDDEN] * 5]]


@pytest.mark.parametrize("decoding", DECODINGS)
@pytest.mark.parametrize("kind", [TwoNetworkSystem, OneNetworkSystem])
def test_a_fixed_prediction_searches_and_makes_n_frames(
    decoding: str, kind: type[TwoNetworkSystem | OneNetworkSystem]
) -> None:
    both = {"encoder": lambda inputs: {**tokens(12, None, None), **encoder(inputs)}, "decoder": counting}
    graphs = Fakes({"spsn": lambda _: tokens(12, None, None), **both})
    before, after = np.zeros((6, 159)), np.zeros((6, 159))
    for n_frames in (2, 6):
        made = fake_system(kind, graphs, decoding).predict_fixed(before, after, 3, 2, n_frames)
        np.testing.assert_array_equal(made[:, 0], 1 + np.arange(n_frames))
    searched = "spsn" in dict(graphs.seen)
    assert searched == (kind is TwoNetworkSystem), "positions are searched for, though they are given"


def test_a_decoder_that_never_ends_is_stopped() -> None:
    def never_last(inputs: Mapping[str, Array]) -> dict[str, Array]:
        return counting(inputs) | {"last": np.full(inputs["kinds"].shape, -1.0, np.float32)}

    for decoding in ("one-by-one", "parallel"):
        graphs = Fakes({"spsn": lambda _: tokens(12, 3, 8), "encoder": encoder, "decoder": never_last})
        found = fake_system(TwoNetworkSystem, graphs, decoding).predict(np.zeros((6, 159)), np.zeros((6, 159)))
        assert len(found.frames) == RUNS["most_frames"]


def test_culling_makes_no_frames_if_a_token_is_missing() -> None:
    graphs = Fakes({"spsn": lambda _: tokens(12, None, 8), "encoder": encoder, "decoder": counting})
    found = fake_system(TwoNetworkSystem, graphs).predict(np.zeros((6, 159)), np.zeros((6, 159)))
    assert (found.pre, found.post) == (None, 2)
    assert found.frames.shape == (0, 159)
    whole = fake_system(TwoNetworkSystem, graphs, fr=None).predict(np.zeros((6, 159)), np.zeros((6, 159)))
    assert (whole.pre, len(whole.frames)) == (None, 4), "without Culling, frames need no position"


def test_one_network_gives_positions_and_frames() -> None:
    graphs = Fakes({"encoder": lambda inputs: {**tokens(12, 3, 8), **encoder(inputs)}, "decoder": counting})
    system = fake_system(OneNetworkSystem, graphs, fr=None, runs={**RUNS, "positions": "encoder"})
    found = system.predict(np.zeros((6, 159)), np.zeros((6, 159)))
    assert (found.pre, found.post, len(found.frames)) == (3, 2, 4)
    assert "tokens" not in graphs.seen[-1][1]


def test_frames_are_made_at_positions_that_are_given() -> None:
    system = fake_system(TwoNetworkSystem, Fakes({"encoder": encoder, "decoder": counting}))
    assert system.fill(np.zeros((6, 159)), np.zeros((6, 159)), 3, 2).shape == (4, 159)
    with pytest.raises(InputError, match="splice position 6, 2"):
        system.fill(np.zeros((6, 159)), np.zeros((6, 159)), 6, 2)


def test_positions_follow_equation_10() -> None:
    assert splice_positions(tokens(9, 2, 7)["tokens"][0], 5) == (2, 2)
    assert splice_positions(tokens(9, None, None)["tokens"][0], 5) == (None, None)
    assert splice_positions(tokens(9, 2, 7)["tokens"][0] - [0, 3, 3], 5) == (None, None)
    assert splice_positions(tokens(9, 2, 7)["tokens"][0] - [0, 3, 3], 5, bias=1.1) == (2, 2), "the frame is the same"


def written(folder: Path, **changes: Any) -> Path:
    write_bundle(folder, {**CONFIG, **changes}, {"spsn.onnx": b"abc"})
    return folder


def test_invalid_bundles_and_decodings_are_refused(tmp_path: Path) -> None:
    config = read_config(written(tmp_path))
    assert read_file(tmp_path, config, "spsn.onnx") == b"abc"
    assert (open_bundle(tmp_path).name, open_bundle(tmp_path).decoding) == ("lpt-plus", "parallel")
    (tmp_path / "spsn.onnx").write_bytes(b"abd")
    with pytest.raises(InputError, match=r"is not the file that bundle\.json lists"):
        open_bundle(tmp_path).predict(np.zeros((6, 159)), np.zeros((6, 159)))
    with pytest.raises(InputError, match=r"lists no file decoder\.onnx"):
        read_file(tmp_path, config, "decoder.onnx")
    with pytest.raises(InputError, match="no such file"):
        open_bundle(tmp_path / "nowhere")
    with pytest.raises(InputError, match="decoding 'beam', expected one of one-by-one, without-cache, parallel"):
        open_bundle(tmp_path, "beam")
    written(tmp_path, runs={**RUNS, "frames": "filler"})
    with pytest.raises(InputError, match="lpt-plus makes its frames by 'filler', expected 'generator'"):
        open_bundle(tmp_path)
    written(tmp_path, runs={**RUNS, "concurrent": False})
    with pytest.raises(InputError, match="it has no parallel decoding"):
        open_bundle(tmp_path, "parallel")
    assert open_bundle(tmp_path).decoding == "one-by-one", "one pass is taken where the network can"
    (tmp_path / BUNDLE_FILE).write_text(json.dumps({"version": 7}))
    with pytest.raises(InputError, match="version 7, expected 1"):
        open_bundle(tmp_path)
    (tmp_path / BUNDLE_FILE).write_text(json.dumps({"version": 1, "system": "lpt-plus"}))
    with pytest.raises(InputError, match="has no 'runs'"):
        open_bundle(tmp_path)
    (tmp_path / BUNDLE_FILE).write_text("{")
    with pytest.raises(InputError, match="is no JSON"):
        open_bundle(tmp_path)
