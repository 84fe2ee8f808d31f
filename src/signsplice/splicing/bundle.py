"""A trained system as a folder: ONNX files, and bundle.json with what they are and the sha256 of each.

``BundleConfig`` is bundle.json, read and checked in one place. A bundle of another system, as the paper's are, has more
in it, which ``stored`` keeps. ``Sessions`` opens the networks in onnxruntime, each checked when it is first run, on one
thread. A graph that names other files for its weights is refused: no hash of the bundle covers those files.
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
"""The bundle that ships, and in folders of it the systems that do."""
VERSION = 1


@dataclass(frozen=True)
class NetworkConfig:
    """One of this project's networks, as bundle.json describes it.

    recipe: hash of everything that its training depended on; None where it is not known.
    n_parameters: number of weights.
    trained_on: ``corpus`` and ``split`` of the corpus of pairs that it learned from; None where it never saw one.
    stored: the whole entry of bundle.json.
    """

    recipe: str | None
    n_parameters: int
    trained_on: Mapping[str, str] | None
    stored: Mapping[str, Any]


@dataclass(frozen=True)
class BundleConfig:
    """bundle.json, version 1.

    path: the file, for messages.
    system: name of the system; "signsplice" for this project's networks.
    files: ONNX file name -> sha256.
    features: version of the features that the networks see (``features.VERSION``).
    networks: this project's networks by name.
    precision: "float16" where weights are stored in 16 bits.
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
    """bundle.json of a folder. Raises ``InputError`` where it is missing, broken, or of another version."""
    path = Path(folder) / BUNDLE_FILE
    stored = read_json(path, "the description of a trained system")
    version = stored.get("version") if isinstance(stored, dict) else None
    if version != VERSION:
        raise InputError(f"{path}: version {version!r:.40}, expected {VERSION}; export the system anew")
    return config_of(stored, path)


def config_of(stored: Mapping[str, Any], path: Path) -> BundleConfig:
    """The configuration that JSON values hold. Raises ``InputError`` where one has the wrong form."""
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
    """Turn what goes wrong in the block into an ``InputError`` about the bundle.json at a path."""
    try:
        yield
    except (TypeError, AttributeError, ValueError, InputError) as error:
        reason = str(error)[:200]
        raise InputError(f"{path}: is no description of a trained system ({reason}); export the system anew") from error


def check_fields(stored: Mapping[str, Any], kind: type, *names: str) -> None:
    """Raise ``TypeError`` where one of these keys is there with another type than the field of a class has."""
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
    """sha256 of a bundle: of its bundle.json, which holds those of its files. Raises ``InputError`` where it is
    missing.
    """
    return hashlib.sha256(read_bytes(Path(folder) / BUNDLE_FILE)).hexdigest()


def read_file(folder: Path, config: BundleConfig, name: str) -> bytes:
    """A file of a bundle. Raises ``InputError`` where it is not listed, missing, or not the one that was written."""
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
"""Message of ONNX -> field number -> message in that field; "" for a number. Only what leads to a tensor's
``external_data`` (13) and ``data_location`` (14); from onnx.proto3, https://github.com/onnx/onnx.
"""
_EXTERNAL = 1
"""``data_location`` of a tensor that lies in another file."""


def names_other_files(graph: bytes) -> bool:
    """Whether a tensor of an ONNX file lies in another file, in whatever graph, node or function of it.

    Raises ``google.protobuf.message.DecodeError`` where the bytes are no such file.
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
    """The class of ONNX's ModelProto, with the fields of ``_FIELDS`` alone; protobuf passes over the others."""
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
    """Raise ``ValueError`` where an output is no array of finite numbers of this shape."""
    found = np.shape(output) if isinstance(output, np.ndarray) and output.dtype.kind == "f" else None
    if found is None or len(found) != len(shape) or any(n not in (None, m) for n, m in zip(shape, found, strict=True)):
        raise ValueError(f"output {name} has shape {found}, expected {shape}")
    if not np.isfinite(output).all():
        raise ValueError(f"output {name} is not finite")
