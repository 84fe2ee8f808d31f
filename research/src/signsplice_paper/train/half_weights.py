"""A bundle of half the size: weights stored as 16-bit numbers, which the graph widens to 32 bits when it is opened.

All arithmetic stays in 32 bits. A weight loses up to one part in 2,000 of itself, so that a system may choose otherwise
where two frames are nearly as good; ``publish`` counts how often it does.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from signsplice.errors import InputError
from signsplice.splicing.bundle import bundle_sha256, read_file
from signsplice_paper.configs import PaperConfig, read_config
from signsplice_workshop.train.bundles import write_bundle
from signsplice_workshop.train.export import check_bundle_folder

FLOAT16 = "float16"
_LEAST = 1024
"""Smaller arrays (biases, the numbers' mean and deviation) keep 32 bits."""
_SUFFIX = "_float16"


def halved(content: bytes) -> bytes:
    """A graph with its larger weights stored in 16 bits."""
    model = onnx.load_model_from_string(content)
    casts = []
    for entry in model.graph.initializer:
        weights = numpy_helper.to_array(entry)
        if weights.dtype != np.float32 or weights.size < _LEAST or np.abs(weights).max() > np.finfo(np.float16).max:
            continue
        name = entry.name
        entry.CopyFrom(numpy_helper.from_array(weights.astype(np.float16), name + _SUFFIX))
        casts.append(helper.make_node("Cast", [name + _SUFFIX], [name], to=TensorProto.FLOAT))
    nodes = [*casts, *model.graph.node]
    del model.graph.node[:]
    model.graph.node.extend(nodes)
    made: bytes = model.SerializeToString()
    return made


def halve_bundle(source: Path, out: Path, facts: Mapping[str, Any]) -> PaperConfig:
    """Write a bundle whose weights have 16 bits into another folder.

    bundle.json has ``precision`` and, in ``halved``, the sha256 of the bundle that it was made from with ``facts``.
    Raises ``InputError`` where the source is no bundle, has other than 32-bit weights, or is the folder to write.
    """
    config = read_config(source)
    if config.precision is not None:
        raise InputError(f"{source}: has {config.precision} weights; name the bundle that it was made from")
    if out.exists() and out.samefile(source):
        raise InputError(f"{out}: is the bundle itself; name another folder")
    check_bundle_folder(out)
    files = {name: halved(read_file(source, config, name)) for name in config.files}
    stored = {k: v for k, v in config.stored.items() if k not in ("version", "files")}
    stored |= {"precision": FLOAT16, "halved": {"bundle": bundle_sha256(source), **facts}}
    write_bundle(out, stored, files)
    return read_config(out)
