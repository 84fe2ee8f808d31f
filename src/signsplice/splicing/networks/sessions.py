"""A bundle's ONNX networks as onnxruntime sessions, each opened and checked when first run, on one thread."""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from signsplice.errors import FormatError
from signsplice.formats.reading import as_format_error, format_errors
from signsplice.splicing.networks.bundle import BundleConfig, read_file
from signsplice.splicing.networks.external_data import names_other_files

Array = NDArray[Any]


class Sessions:
    """The networks of a bundle by file name without ``.onnx``.

    folder: the bundle.
    config: its bundle.json.
    seconds: time that the networks have run, in all.
    """

    def __init__(self, folder: Path, config: BundleConfig) -> None:
        self.folder, self.config = folder, config
        self.seconds = 0.0
        self._sessions: dict[str, tuple[Any, list[str], list[str]]] = {}

    def check(self) -> None:
        """Read every file once. Raises ``InputError`` where one is missing or is not the one that was written."""
        for name in self.config.files:
            read_file(self.folder, self.config, name)

    def run(self, name: str, inputs: Mapping[str, Array], **shapes: tuple[int | None, ...]) -> dict[str, Array]:
        """The outputs of a network by name; inputs that it does not have are left out.

        shapes: of outputs that the caller relies on, None for any length; their numbers must be finite. Raises
        ``FormatError`` where the network cannot be opened or run, or an output is another.
        """
        session, takes, gives = self._session(name)
        began = time.perf_counter()
        try:
            outputs = dict(zip(gives, session.run(gives, {key: inputs[key] for key in takes}), strict=True))
            for key, shape in shapes.items():
                _check_output(key, outputs[key], shape)
        except Exception as error:
            raise as_format_error(error, str(self.folder / f"{name}.onnx"), "network") from error
        self.seconds += time.perf_counter() - began
        return outputs

    def _session(self, name: str) -> tuple[Any, list[str], list[str]]:
        if name not in self._sessions:
            from signsplice.splicing.networks.runtime import onnxruntime

            file, content = str(self.folder / f"{name}.onnx"), read_file(self.folder, self.config, f"{name}.onnx")
            options = onnxruntime.SessionOptions()
            options.intra_op_num_threads = options.inter_op_num_threads = 1
            options.log_severity_level = 4  # what goes wrong is said once, by the error raised
            # 8-bit weights become 32-bit ones when the graph is opened. Otherwise onnxruntime rounds the inputs to 8
            # bits too, on each kind of processor in its own way.
            options.add_session_config_entry("session.disable_quant_qdq", "1")
            with format_errors(file, "network"):
                if multiplies_in_8_bits(content):
                    raise FormatError(
                        "multiplies in 8 bits, and so makes other sentences on other processors; "
                        "`signsplice export` writes the same weights for 32 bits",
                        file=file,
                    )
                if names_other_files(content):
                    raise FormatError(
                        "keeps weights in other files, which no hash of the bundle covers; export the system anew, "
                        "each network in one file",
                        file=file,
                    )
                session = onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
            takes = [entry.name for entry in session.get_inputs()]
            self._sessions[name] = (session, takes, [entry.name for entry in session.get_outputs()])
        return self._sessions[name]


def multiplies_in_8_bits(content: bytes) -> bool:
    """Whether a graph rounds the inputs of its products to 8 bits, as bundles of version 0.3 did."""
    return b"DynamicQuantizeLinear" in content


def _check_output(name: str, output: Any, shape: tuple[int | None, ...]) -> None:
    """Raise ``ValueError`` where an output is no array of finite numbers of this shape."""
    found = np.shape(output) if isinstance(output, np.ndarray) and output.dtype.kind == "f" else None
    if found is None or len(found) != len(shape) or any(n not in (None, m) for n, m in zip(shape, found, strict=True)):
        raise ValueError(f"output {name} has shape {found}, expected {shape}")
    if not np.isfinite(output).all():
        raise ValueError(f"output {name} is not finite")
