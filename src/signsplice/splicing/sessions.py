"""A bundle's ONNX graphs, each opened and checked when first run, on one thread."""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from signsplice.splicing.bundle import read_file

Array = NDArray[Any]


class Sessions:
    """The graphs of a folder by name, without ``.onnx``; ``seconds`` is the time that they have run in all."""

    def __init__(self, folder: Path, facts: Mapping[str, Any]) -> None:
        self.folder, self.facts = folder, facts
        self.seconds = 0.0
        self._sessions: dict[str, tuple[Any, list[str], list[str]]] = {}

    def check(self) -> None:
        """Read every file once. Raises ``InputError`` where one is missing, or not the one that was written."""
        for name in self.facts["files"]:
            read_file(self.folder, self.facts, name)

    def run(self, name: str, inputs: Mapping[str, Array]) -> dict[str, Array]:
        """A graph's outputs by name; inputs that it does not have are left out."""
        session, takes, gives = self._session(name)
        begun = time.perf_counter()
        made = session.run(gives, {key: inputs[key] for key in takes})
        self.seconds += time.perf_counter() - begun
        return dict(zip(gives, made, strict=True))

    def _session(self, name: str) -> tuple[Any, list[str], list[str]]:
        if name not in self._sessions:
            import onnxruntime

            content = read_file(self.folder, self.facts, f"{name}.onnx")
            onnxruntime.disable_telemetry_events()
            options = onnxruntime.SessionOptions()
            options.intra_op_num_threads = options.inter_op_num_threads = 1
            options.log_severity_level = 3
            session = onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
            takes = [entry.name for entry in session.get_inputs()]
            self._sessions[name] = (session, takes, [entry.name for entry in session.get_outputs()])
        return self._sessions[name]


def single(x: Array) -> Array:
    """Frames (N, 159) as a batch of one, in float32."""
    return np.ascontiguousarray(x[None], dtype=np.float32)
