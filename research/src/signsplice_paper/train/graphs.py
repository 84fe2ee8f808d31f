"""The networks of the paper's systems as ONNX graphs.

A generator becomes two graphs: ``encoder`` (input -> tokens, memory, state) and ``decoder``, which makes one or many
frames per call and takes and returns its state, including key-value caches of any length. Batches have one pair. The
numbers of frames are variable, except those of culled frames.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from signsplice.errors import SignspliceError
from signsplice_paper.train.networks.generator import FRAME, START, Encoded, Generator
from signsplice_paper.train.networks.spsn import Spsn
from signsplice_paper.train.networks.word_spsn import WordSpsn
from signsplice_paper.train.pairs_data import mark_splice
from signsplice_workshop.train.export import ExportGraph, export_onnx


def export_paper_graphs(network: nn.Module, fr: int | None) -> dict[str, bytes]:
    """Returns ONNX graphs of a network by file name; ``fr`` for a network that sees culled frames.

    Raises ``SignspliceError`` if onnxruntime and torch differ.
    """
    network = network.eval().cpu()
    if isinstance(network, Spsn | WordSpsn):
        graphs = {"spsn": build_spsn_graph(network)}
    elif isinstance(network, Generator):
        graphs = _build_generator_graphs(network, fr)
    else:
        raise SignspliceError(f"cannot export a {type(network).__name__}, expected a network of the paper's systems")
    return {f"{name}.onnx": export_onnx(name, graph) for name, graph in graphs.items()}


def _random_frames(n_frames: int, network: Any) -> Tensor:
    """Returns random frames (1, n, K) that vary about as much as those of the training pairs."""
    n_numbers = network.normaliser.n_numbers
    rng = np.random.default_rng(n_frames)
    values = rng.normal(0.0, 1.0, (1, 1, n_numbers)) + rng.normal(0.0, 0.1, (1, n_frames, n_numbers)).cumsum(axis=1)
    frames: Tensor = network.normaliser.inverse(torch.from_numpy(values.astype(np.float32)))
    return frames


def build_spsn_graph(network: Spsn | WordSpsn) -> ExportGraph:
    """Returns the graph of SPSN, or of SPSN word by word."""
    inputs = [{"x": _random_frames(n, network), "n_before": torch.tensor([n // 2])} for n in (11, 24, 7)]
    return ExportGraph(_SpsnGraph(network), inputs[0], ("tokens",), {"x": (1,)}, tuple(inputs[1:]))


def _build_generator_graphs(network: Generator, fr: int | None) -> dict[str, ExportGraph]:
    def encoder_inputs(n: int) -> dict[str, Tensor]:
        mask = torch.ones(1, n, dtype=torch.bool)
        inputs = {"x": _random_frames(n, network), "mask": mask, "n_before": torch.tensor([n // 2])}
        if network.marked:
            inputs["marks"] = mark_splice(torch.tensor([n // 2 - 2]), torch.tensor([n // 2 + 1]), n)
        return inputs

    sizes = (11, 24, 7) if fr is None else (2 * fr,)
    inputs = [encoder_inputs(n) for n in sizes]
    if fr is not None:
        padded = dict(inputs[0])
        padded["mask"] = torch.arange(2 * fr)[None] > 0
        inputs.append(padded)
    with torch.no_grad():
        encoded = [network.encode(**entry) for entry in inputs]
    tokens, memory, state = encoded[0]
    memory_names = tuple(f"memory_{k}" for k in range(len(memory)))
    state_names = tuple(f"state_{k}" for k in range(len(state)))
    outputs = (*(() if tokens is None else ("tokens",)), *memory_names, *state_names)
    variable_axes: dict[str, tuple[int, ...]] = {"x": (1,), "mask": (1,)} if fr is None else {}
    if network.marked:
        variable_axes["marks"] = (1,)
    encoder = ExportGraph(_EncoderGraph(network), inputs[0], outputs, variable_axes, tuple(inputs[1:]))
    return {"encoder": encoder, "decoder": _build_decoder_graph(network, encoded, memory_names, state_names, fr)}


def _build_decoder_graph(
    network: Generator,
    encoded: Sequence[Encoded],
    memory_names: Sequence[str],
    state_names: Sequence[str],
    fr: int | None,
) -> ExportGraph:
    """Returns the decoder. Its example continues after earlier frames; it is also compared on the first step, of one
    frame and of many.
    """

    def make_inputs(entry: Encoded, state: Sequence[Tensor], n_past: int, n_new: int) -> dict[str, Tensor]:
        kinds = torch.full((1, n_new), FRAME)
        kinds[0, 0] = START if n_past == 0 else FRAME
        return {"fed": _random_frames(n_new, network), "kinds": kinds, "start": torch.tensor(n_past)} | dict(
            zip((*memory_names, *state_names), (*entry.memory, *state), strict=True)
        )

    checks = [make_inputs(entry, entry.state, 0, n_new) for entry in encoded for n_new in (1, 6)]
    with torch.no_grad():
        first = checks[1]
        _, _, state = network.decode(first["fed"], first["kinds"], first["start"], encoded[0].memory, encoded[0].state)
    inputs = make_inputs(encoded[0], state, 6, 3)
    variable_axes: dict[str, tuple[int, ...]] = {"fed": (1,), "kinds": (1,)}
    if fr is None:
        n_input = encoded[0].memory[0].shape[1] if encoded[0].memory else -1
        for name, part in zip(memory_names, encoded[0].memory, strict=True):
            variable_axes[name] = tuple(k for k, size in enumerate(part.shape) if size == n_input)[-1:]
    for name, part, old_part in zip(state_names, state, encoded[0].state, strict=True):
        variable_axes[name] = tuple(k for k, size in enumerate(part.shape) if size != old_part.shape[k])
    outputs = ("made", "last", *(f"next_{name}" for name in state_names))
    return ExportGraph(
        _DecoderGraph(network, len(memory_names)), inputs, outputs, variable_axes, tuple(checks), n_named=3
    )


class _SpsnGraph(nn.Module):
    def __init__(self, network: Spsn | WordSpsn) -> None:
        super().__init__()
        self.network = network

    def forward(self, x: Tensor, n_before: Tensor) -> Tensor:
        tokens: Tensor = self.network(x, n_before)
        return tokens


class _EncoderGraph(nn.Module):
    def __init__(self, network: Generator) -> None:
        super().__init__()
        self.network = network

    def forward(self, x: Tensor, mask: Tensor, n_before: Tensor, marks: Tensor | None = None) -> tuple[Tensor, ...]:
        encoded = self.network.encode(x, mask, n_before, marks)
        tokens = () if encoded.tokens is None else (encoded.tokens,)
        # A mask that is returned unchanged would not become an output of the graph.
        memory = tuple(part & True if part.dtype == torch.bool else part for part in encoded.memory)
        return (*tokens, *memory, *encoded.state)


class _DecoderGraph(nn.Module):
    def __init__(self, network: Generator, n_memory: int) -> None:
        super().__init__()
        self.network, self.n_memory = network, n_memory

    def forward(self, fed: Tensor, kinds: Tensor, start: Tensor, *memory_and_state: Tensor) -> tuple[Tensor, ...]:
        memory, state = memory_and_state[: self.n_memory], memory_and_state[self.n_memory :]
        frames, last, new_state = self.network.decode(fed, kinds, start, memory, state)
        return (frames, last, *new_state)
