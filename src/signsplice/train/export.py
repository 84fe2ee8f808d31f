"""Trained networks as ONNX graphs, compared with torch before they are kept.

A generator becomes two graphs: ``encoder`` (input -> tokens, memory, state) and ``decoder``, one step or many at once,
whose state, key-value caches of any length among them, goes in and out. A filler becomes ``length`` and ``fill``.
Batches are of one but for the network that makes transitions; numbers of frames are free, those of culled frames fixed.
"""

from __future__ import annotations

import logging
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from onnx import numpy_helper
from torch import Tensor, nn

from signsplice.errors import InputError, SignspliceError
from signsplice.splicing.bundle import BUNDLE_FILE
from signsplice.train.paper.networks.filling import Filler
from signsplice.train.paper.networks.generator import FRAME, START, Generator
from signsplice.train.paper.networks.spsn import Spsn

TOLERANCE = 1e-4
"""Largest difference of torch and onnxruntime, relative to numbers beyond 1."""
_FREE = torch.export.Dim.DYNAMIC
TRANSPOSED = ".T"
"""Ending of the name of a weight that a graph holds transposed."""


def check_bundle_folder(out: Path) -> None:
    """Raise ``InputError`` where ``out`` holds files and is no bundle, so that nothing else is overwritten."""
    if out.is_dir() and any(out.iterdir()) and not (out / BUNDLE_FILE).exists() and not any(out.glob("*.onnx")):
        raise InputError(f"{out}: is there already and is no bundle; choose a new name")


@dataclass(frozen=True)
class ExportGraph:
    """A module with flat inputs and outputs, example inputs with free dimensions, and other inputs to compare on."""

    module: nn.Module
    inputs: dict[str, Tensor]
    outputs: tuple[str, ...]
    free: dict[str, tuple[int, ...]]
    checks: tuple[dict[str, Tensor], ...]


class _SpsnGraph(nn.Module):
    def __init__(self, network: Spsn) -> None:
        super().__init__()
        self.network = network

    def forward(self, x: Tensor, n_before: Tensor) -> Tensor:
        tokens: Tensor = self.network(x, n_before)
        return tokens


class _EncoderGraph(nn.Module):
    def __init__(self, network: Generator) -> None:
        super().__init__()
        self.network = network

    def forward(self, x: Tensor, mask: Tensor, n_before: Tensor) -> tuple[Tensor, ...]:
        encoded = self.network.encode(x, mask, n_before)
        tokens = () if encoded.tokens is None else (encoded.tokens,)
        # A mask that is handed on as it came would be no output of the graph.
        memory = tuple(part & True if part.dtype == torch.bool else part for part in encoded.memory)
        return (*tokens, *memory, *encoded.state)


class _DecoderGraph(nn.Module):
    def __init__(self, network: Generator, n_memory: int) -> None:
        super().__init__()
        self.network, self.n_memory = network, n_memory

    def forward(self, fed: Tensor, kinds: Tensor, start: Tensor, *given: Tensor) -> tuple[Tensor, ...]:
        memory, state = given[: self.n_memory], given[self.n_memory :]
        made, last, after = self.network.decode(fed, kinds, start, memory, state)
        return (made, last, *after)


class _LengthGraph(nn.Module):
    def __init__(self, network: Filler) -> None:
        super().__init__()
        self.network = network

    def forward(self, x: Tensor, mask: Tensor) -> Tensor:
        return self.network.length(x, mask)


class _FillGraph(nn.Module):
    def __init__(self, network: Filler) -> None:
        super().__init__()
        self.network = network

    def forward(self, x: Tensor, mask: Tensor, real: Tensor) -> Tensor:
        return self.network.fill(x, mask, real)


def paper_graphs(network: nn.Module, fr: int | None) -> dict[str, bytes]:
    """File name -> ONNX, of a network; ``fr`` of a network that sees culled frames. Raises ``SignspliceError`` where
    onnxruntime and torch differ.
    """
    network = network.eval().cpu()
    told: dict[str, ExportGraph]
    if isinstance(network, Spsn):
        told = {"spsn": _spsn_graph(network)}
    elif isinstance(network, Generator):
        told = _generator_graphs(network, fr)
    elif isinstance(network, Filler):
        told = _filler_graphs(network, fr or 1)
    else:
        raise SignspliceError(f"no way known to export a {type(network).__name__}")
    return {f"{name}.onnx": exported(name, graph) for name, graph in told.items()}


def _x(n_frames: int, network: Any) -> Tensor:
    """Frames (1, n, 159) that wander as those do which a network has learned from."""
    rng = np.random.default_rng(n_frames)
    values = rng.normal(0.0, 1.0, (1, 1, 159)) + rng.normal(0.0, 0.1, (1, n_frames, 159)).cumsum(axis=1)
    frames: Tensor = network.normaliser.inverse(torch.from_numpy(values.astype(np.float32)))
    return frames


def _spsn_graph(network: Spsn) -> ExportGraph:
    inputs = [{"x": _x(n, network), "n_before": torch.tensor([n // 2])} for n in (11, 24, 7)]
    return ExportGraph(_SpsnGraph(network), inputs[0], ("tokens",), {"x": (1,)}, tuple(inputs[1:]))


def _generator_graphs(network: Generator, fr: int | None) -> dict[str, ExportGraph]:
    def encoder_inputs(n: int) -> dict[str, Tensor]:
        return {"x": _x(n, network), "mask": torch.ones(1, n, dtype=torch.bool), "n_before": torch.tensor([n // 2])}

    sizes = (11, 24, 7) if fr is None else (2 * fr,)
    inputs = [encoder_inputs(n) for n in sizes]
    if fr is not None:
        edge = dict(inputs[0])
        edge["mask"] = torch.arange(2 * fr)[None] > 0
        inputs.append(edge)
    with torch.no_grad():
        encoded = [network.encode(**entry) for entry in inputs]
    tokens, memory, state = encoded[0]
    names = tuple(f"memory_{k}" for k in range(len(memory))), tuple(f"state_{k}" for k in range(len(state)))
    outputs = (*(() if tokens is None else ("tokens",)), *names[0], *names[1])
    free: dict[str, tuple[int, ...]] = {"x": (1,), "mask": (1,)} if fr is None else {}
    graph = ExportGraph(_EncoderGraph(network), inputs[0], outputs, free, tuple(inputs[1:]))
    return {"encoder": graph, "decoder": _decoder_graph(network, encoded, names, fr)}


def _decoder_graph(
    network: Generator, encoded: Sequence[Any], names: tuple[tuple[str, ...], tuple[str, ...]], fr: int | None
) -> ExportGraph:
    """The decoder, its example with frames before; compared also on the first step, alone and many at once."""

    def step(entry: Any, state: Sequence[Tensor], at: int, n_new: int) -> dict[str, Tensor]:
        kinds = torch.full((1, n_new), FRAME)
        kinds[0, 0] = START if at == 0 else FRAME
        fed = torch.zeros(1, n_new, network.n_fed)
        fed[..., :159] = _x(n_new, network)
        return {"fed": fed, "kinds": kinds, "start": torch.tensor(at)} | dict(
            zip((*names[0], *names[1]), (*entry.memory, *state), strict=True)
        )

    checks = [step(entry, entry.state, 0, n_new) for entry in encoded for n_new in (1, 6)]
    with torch.no_grad():
        first = checks[1]
        _, _, state = network.decode(first["fed"], first["kinds"], first["start"], encoded[0].memory, encoded[0].state)
    inputs = step(encoded[0], state, 6, 3)
    free: dict[str, tuple[int, ...]] = {"fed": (1,), "kinds": (1,)}
    if fr is None:
        n_input = encoded[0].memory[0].shape[1] if encoded[0].memory else -1
        for name, part in zip(names[0], encoded[0].memory, strict=True):
            free[name] = tuple(k for k, size in enumerate(part.shape) if size == n_input)[-1:]
    for name, part, old in zip(names[1], state, encoded[0].state, strict=True):
        free[name] = tuple(k for k, size in enumerate(part.shape) if size != old.shape[k])
    outputs = ("made", "last", *(f"next_{name}" for name in names[1]))
    return ExportGraph(_DecoderGraph(network, len(names[0])), inputs, outputs, free, tuple(checks))


def _filler_graphs(network: Filler, fr: int) -> dict[str, ExportGraph]:
    x, mask = _x(2 * fr, network), torch.ones(1, 2 * fr, dtype=torch.bool)
    edge = torch.arange(2 * fr)[None] > 0
    both = {"x": x, "mask": mask}
    length = ExportGraph(_LengthGraph(network), both, ("numbers",), {}, ({"x": x, "mask": edge},))
    reals = [torch.ones(1, n, dtype=torch.bool) for n in (5, 1, 12)]
    checks = tuple({"x": x, "mask": edge, "real": real} for real in reals)
    return {
        "length": length,
        "fill": ExportGraph(_FillGraph(network), {**both, "real": reals[0]}, ("made",), {"real": (1,)}, checks),
    }


@contextmanager
def _quiet() -> Iterator[None]:
    """Without the exporter's own remarks, which concern its authors."""
    loggers = [
        logging.getLogger(name) for name in ("torch.__trace", "torch.onnx", "torch.export", "onnxscript", "onnx_ir")
    ]
    levels = [logger.level for logger in loggers]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for logger in loggers:
            logger.setLevel(logging.CRITICAL)
        try:
            yield
        finally:
            for logger, level in zip(loggers, levels, strict=True):
                logger.setLevel(level)


def exported(name: str, graph: ExportGraph) -> bytes:
    """A graph as ONNX. Raises ``SignspliceError`` where onnxruntime answers otherwise than torch."""
    shapes: list[Any] = [dict.fromkeys(graph.free.get(key, ()), _FREE) or None for key in graph.inputs]
    n_named = 3 if isinstance(graph.module, _DecoderGraph) else len(shapes)
    given = tuple(shapes[n_named:])
    dynamic = (*shapes[:n_named], given) if isinstance(graph.module, _DecoderGraph) else tuple(shapes)
    with _quiet():
        program = torch.onnx.export(
            graph.module,
            tuple(graph.inputs.values()),
            dynamo=True,
            dynamic_shapes=dynamic,
            input_names=list(graph.inputs),
            output_names=list(graph.outputs),
            verbose=False,
        )
    if program is None:
        raise SignspliceError(f"{name}: torch gave no ONNX program")
    model = _named(_bare(program.model_proto), graph.module)
    content: bytes = model.SerializeToString()
    compare(name, graph, content)
    return content


def _bare(model: Any) -> Any:
    """A model without what the exporter notes on the way: source lines with the maker's own folders, which are a third
    of a small file and differ from machine to machine.
    """

    def strip(message: Any) -> None:
        for field, value in message.ListFields():
            if field.name in ("metadata_props", "doc_string"):
                message.ClearField(field.name)
            elif field.message_type is not None:
                for inner in (value,) if hasattr(value, "ListFields") else value:
                    strip(inner)

    strip(model)
    return model


def _named(model: Any, module: nn.Module) -> Any:
    """A model whose transposed weights are called by their names again, so that training can go on from the graph."""
    waiting = [entry for entry in model.graph.initializer if entry.name.startswith("val_")]
    renamed: dict[str, str] = {}
    for name, weight in module.state_dict().items():
        if weight.dim() != 2:
            continue
        turned = np.ascontiguousarray(weight.numpy().T)
        for entry in waiting:
            if tuple(entry.dims) == turned.shape and np.array_equal(numpy_helper.to_array(entry), turned):
                renamed[entry.name] = name + TRANSPOSED
                entry.name = name + TRANSPOSED
                waiting.remove(entry)
                break
    for node in model.graph.node:
        for k, given in enumerate(node.input):
            if given in renamed:
                node.input[k] = renamed[given]
    return model


def compare(name: str, graph: ExportGraph, content: bytes) -> None:
    """Raise ``SignspliceError`` where onnxruntime and torch differ on the example or the other inputs."""
    import onnxruntime

    session = onnxruntime.InferenceSession(content, providers=["CPUExecutionProvider"])
    takes = {entry.name for entry in session.get_inputs()}
    for inputs in (graph.inputs, *graph.checks):
        with torch.no_grad():
            answer = graph.module(*inputs.values())
        expected = (answer,) if isinstance(answer, Tensor) else answer
        found = session.run(list(graph.outputs), {key: v.numpy() for key, v in inputs.items() if key in takes})
        for output, a, b in zip(graph.outputs, found, expected, strict=True):
            true = b.numpy()
            if a.shape != true.shape or (
                a.size and np.max(np.abs(a - 1.0 * true) / np.maximum(1, np.abs(true))) > TOLERANCE
            ):
                raise SignspliceError(
                    f"{name}: onnxruntime and torch differ in {output} ({a.shape}, {true.shape}); nothing was exported"
                )
