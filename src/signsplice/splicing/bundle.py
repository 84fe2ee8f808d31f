"""A trained system as a folder: ONNX files, and a bundle.json that describes them and lists the sha256 of each.

``BundleConfig`` reads and checks bundle.json. A bundle of another system, such as the paper's, has more fields, which
``stored`` keeps. ``Sessions`` opens the networks in onnxruntime on one thread and checks each at its first run. Graphs
that keep weights in other files are refused: no hash of the bundle covers those files.
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path, PurePath
from typing import Any, get_type_hints

import numpy as np
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from google.protobuf.descriptor_pb2 import FieldDescriptorProto
from numpy.typing import NDArray

from signsplice.errors import FormatError, InputError
from signsplice.formats.json_files import check_type, read_json
from signsplice.formats.reading import as_format_error, format_errors, read_bytes

BUNDLE_FILE = "bundle.json"
WEIGHTS = Path(__file__).parent / "weights"
"""The shipped bundle; its subfolders hold the shipped systems."""
VERSION = 1


@dataclass(frozen=True)
class NetworkConfig:
    """One of this project's networks, as bundle.json describes it.

    recipe: hash of everything that its training depended on; None if unknown.
    n_parameters: number of weights.
    trained_on: ``corpus`` and ``split`` of the corpus of pairs used for training, ``taught`` in bundle.json; None if
        none was used.
    stored: the whole entry of bundle.json.
    """

    recipe: str | None
    n_parameters: int
    trained_on: Mapping[str, str] | None
    stored: Mapping[str, Any]


@dataclass(frozen=True)
class BundleConfig:
    """bundle.json, version 1.

    path: path of the file, for messages.
    system: name of the system; "signsplice" for this project's networks.
    files: ONNX file name -> sha256.
    features: version of the networks' input features (``features.VERSION``).
    networks: this project's networks by name.
    precision: "float16" if weights are stored in 16 bits.
    stored: the whole file as JSON values.
    """

    path: Path
    system: str | None
    files: Mapping[str, str]
    features: int | None = None
    networks: Mapping[str, NetworkConfig] = field(default_factory=dict)
    precision: str | None = None
    stored: Mapping[str, Any] = field(default_factory=dict)


_PLAIN = ("system", "features", "precision")


def read_config(folder: Path) -> BundleConfig:
    """Reads bundle.json of a folder. Raises ``InputError`` if it is missing, broken, or of another version."""
    path = Path(folder) / BUNDLE_FILE
    stored = read_json(path, "the description of a trained system")
    version = stored.get("version") if isinstance(stored, dict) else None
    if version != VERSION:
        raise InputError(f"{path}: version {version!r:.40}, expected {VERSION}; export the system anew")
    return config_of(stored, path)


def config_of(stored: Mapping[str, Any], path: Path) -> BundleConfig:
    """Converts JSON values to a configuration. Raises ``InputError`` if a value has the wrong type."""
    with config_errors(path):
        check_fields(stored, BundleConfig, *_PLAIN, "files")
        if names := [
            name
            for name in stored.get("files", {})
            if name != PurePath(name).name or "\\" in name or not name.isprintable()
        ]:
            raise ValueError(f"files: {names[0]!r} is not the name of a file in its folder")
        return BundleConfig(
            path=path,
            files=dict(stored.get("files", {})),
            networks={name: _network(entry) for name, entry in stored.get("networks", {}).items()},
            stored=stored,
            **{name: stored.get(name) for name in _PLAIN},
        )


@contextmanager
def config_errors(path: Path) -> Iterator[None]:
    """Turns errors raised in the block into an ``InputError`` about the bundle.json at ``path``."""
    try:
        yield
    except (TypeError, AttributeError, KeyError, ValueError, InputError) as error:
        reason = (f"it has no {error}" if isinstance(error, KeyError) else str(error))[:200]
        raise InputError(f"{path}: is no description of a trained system ({reason}); export the system anew") from error


def check_fields(stored: Mapping[str, Any], kind: type, *names: str) -> None:
    """Raises ``TypeError`` if a present key has another type than the field of class ``kind``."""
    kinds = get_type_hints(kind)
    for name in names:
        if name in stored:
            check_type(stored[name], kinds[name], name)


def _network(entry: Mapping[str, Any]) -> NetworkConfig:
    recipe, n_parameters, trained_on = entry.get("recipe"), entry.get("n_parameters", 0), entry.get("taught")
    check_type(recipe, str | None, "recipe")
    check_type(n_parameters, int, "n_parameters")
    check_type(trained_on, Mapping[str, str] | None, "taught")
    return NetworkConfig(recipe, n_parameters, trained_on, entry)


def bundle_sha256(folder: Path) -> str:
    """Returns the sha256 of bundle.json, which lists those of the bundle's files. Raises ``InputError`` if it is
    missing.
    """
    return hashlib.sha256(read_bytes(Path(folder) / BUNDLE_FILE)).hexdigest()


def read_file(folder: Path, config: BundleConfig, name: str) -> bytes:
    """Reads a file of a bundle. Raises ``InputError`` if it is not listed, is missing, or has another sha256."""
    path = Path(folder) / name
    expected = config.files.get(name)
    if expected is None:
        raise InputError(f"{Path(folder) / BUNDLE_FILE}: lists no file {name}; export the system anew")
    content = read_bytes(path)
    if hashlib.sha256(content).hexdigest() != expected:
        raise InputError(
            f"{path}: is not the file that {BUNDLE_FILE} lists (its sha256 differs); export the system anew"
        )
    return content


_FIELDS = {
    "Model": {7: "Graph", 20: "Training", 25: "Function"},
    "Training": {1: "Graph", 2: "Graph"},
    "Function": {7: "Node", 11: "Attribute"},
    "Graph": {1: "Node", 5: "Tensor", 15: "SparseTensor"},
    "Node": {5: "Attribute"},
    "Attribute": {5: "Tensor", 6: "Graph", 10: "Tensor", 11: "Graph", 22: "SparseTensor", 23: "SparseTensor"},
    "SparseTensor": {1: "Tensor", 2: "Tensor"},
    "Tensor": {13: "Entry", 14: ""},
    "Entry": {},
}
"""ONNX message -> field number -> message type of that field; "" for a number. Only the fields that lead to a tensor's
``external_data`` (13) and ``data_location`` (14); from onnx.proto3, https://github.com/onnx/onnx.
"""
_EXTERNAL = 1
"""``data_location`` of a tensor stored in another file."""


def names_other_files(graph: bytes) -> bool:
    """Whether any graph, node or function of an ONNX file has a tensor stored in another file.

    Raises ``google.protobuf.message.DecodeError`` if the bytes are not an ONNX file.
    """
    model = _model_class()()
    model.ParseFromString(graph)
    return _has_external_tensor(model)


def _has_external_tensor(message: Any) -> bool:
    for known, values in message.ListFields():
        if known.message_type is None:
            if _EXTERNAL in values:
                return True
        elif known.message_type.name == "Entry" or any(map(_has_external_tensor, values)):
            return True
    return False


def _model_class() -> Any:
    """Builds the class of ONNX's ModelProto with the fields of ``_FIELDS`` only; protobuf skips the others."""
    file = descriptor_pb2.FileDescriptorProto(name="onnx_tensors.proto", package="tensors")
    for name, fields in _FIELDS.items():
        message = file.message_type.add(name=name)
        for number, kind in fields.items():
            holds = {"type": FieldDescriptorProto.TYPE_INT32}
            if kind:
                holds = {"type": FieldDescriptorProto.TYPE_MESSAGE, "type_name": f".tensors.{kind}"}
            label = FieldDescriptorProto.LABEL_REPEATED
            message.field.add(name=f"field_{number}", number=number, label=label, **holds)
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName("tensors.Model"))


Array = NDArray[Any]


class Sessions:
    """The networks of a bundle, by file name without ``.onnx``.

    folder: the bundle's folder.
    config: its bundle.json.
    seconds: total run time of the networks, s.
    """

    def __init__(self, folder: Path, config: BundleConfig) -> None:
        self.folder, self.config = folder, config
        self.seconds = 0.0
        self._sessions: dict[str, tuple[Any, list[str], list[str]]] = {}

    def check(self) -> None:
        """Reads every file once. Raises ``InputError`` if one is missing or has another sha256."""
        for name in self.config.files:
            read_file(self.folder, self.config, name)

    def run(self, name: str, inputs: Mapping[str, Array], **shapes: tuple[int | None, ...]) -> dict[str, Array]:
        """Runs a network and returns its outputs by name; inputs that it does not have are ignored.

        shapes: expected shapes of the outputs that the caller uses, None for any length; their numbers must be finite.
        Raises ``FormatError`` if the network cannot be opened or run, or if an output is not as expected.
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
            from signsplice.splicing.runtime import onnxruntime

            file, content = str(self.folder / f"{name}.onnx"), read_file(self.folder, self.config, f"{name}.onnx")
            options = onnxruntime.SessionOptions()
            options.intra_op_num_threads = options.inter_op_num_threads = 1
            options.log_severity_level = 4  # what goes wrong is said once, by the error raised
            with format_errors(file, "network"):
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


def _check_output(name: str, output: Any, shape: tuple[int | None, ...]) -> None:
    """Raises ``InputError`` if an output is not an array of finite numbers of this shape."""
    actual = np.shape(output) if isinstance(output, np.ndarray) and output.dtype.kind == "f" else None
    if (
        actual is None
        or len(actual) != len(shape)
        or any(n not in (None, m) for n, m in zip(shape, actual, strict=True))
    ):
        raise InputError(f"output {name} has shape {actual}, expected {shape}")
    if not np.isfinite(output).all():
        raise InputError(f"output {name} is not finite")
