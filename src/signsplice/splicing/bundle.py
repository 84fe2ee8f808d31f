"""A trained system as a folder: ONNX files, and bundle.json with what they are and the sha256 of each.

bundle.json, version 1: ``version``, ``system``, ``config`` (sizes by part), ``scale``, ``optimiser``, ``split``,
``corpus`` (hash), ``fps``, ``seed``, ``steps`` (all parts together), ``parts`` (steps, batch, learning rate and scores
by part), ``fr`` (null without Culling), ``normaliser`` (mean and deviation of the 159 numbers, which the graphs
contain), ``n_parameters``, ``versions``, ``runs`` (how the graphs are to be run) and ``files`` (name -> sha256).
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from signsplice.errors import InputError
from signsplice.formats.atomic import read_bytes, replacing

BUNDLE_FILE = "bundle.json"
VERSION = 1


def write_bundle(folder: Path, facts: Mapping[str, Any], files: Mapping[str, bytes]) -> None:
    """Write files and bundle.json into a folder that exists; bundle.json comes last, so that a half-written bundle is
    none.
    """
    (folder / BUNDLE_FILE).unlink(missing_ok=True)
    for name, content in files.items():
        with replacing(folder / name) as temporary:
            temporary.write_bytes(content)
    hashes = {name: hashlib.sha256(content).hexdigest() for name, content in sorted(files.items())}
    text = json.dumps({"version": VERSION, **facts, "files": hashes}, indent=1)
    with replacing(folder / BUNDLE_FILE) as temporary:
        temporary.write_text(text + "\n", encoding="utf-8")


def read_facts(folder: Path) -> dict[str, Any]:
    """bundle.json of a folder. Raises ``InputError`` where it is missing, broken, or of another version."""
    path = Path(folder) / BUNDLE_FILE
    try:
        facts = json.loads(read_bytes(path))
    except ValueError as error:
        raise InputError(f"{path}: is no JSON ({error}), expected a trained system's facts") from error
    version = facts.get("version") if isinstance(facts, dict) else None
    if version != VERSION:
        raise InputError(f"{path}: version {version}, expected {VERSION}; export the system anew")
    return dict(facts)


def bundle_sha256(folder: Path) -> str:
    """sha256 of a bundle: of its bundle.json, which holds those of its files. Raises ``InputError`` where it is
    missing.
    """
    return hashlib.sha256(read_bytes(Path(folder) / BUNDLE_FILE)).hexdigest()


def read_file(folder: Path, facts: Mapping[str, Any], name: str) -> bytes:
    """A bundle's file. Raises ``InputError`` where it is not listed, missing, or not the one that was written."""
    path = Path(folder) / name
    expected = facts.get("files", {}).get(name)
    if expected is None:
        raise InputError(f"{Path(folder) / BUNDLE_FILE}: lists no file {name}; export the system anew")
    content = read_bytes(path)
    if hashlib.sha256(content).hexdigest() != expected:
        raise InputError(
            f"{path}: is not the file that {BUNDLE_FILE} lists (its sha256 differs); export the system anew"
        )
    return content
