"""A trained system as a folder: ONNX files, and bundle.json with what they are and the sha256 of each.

``BundleConfig`` is bundle.json, read and checked in one place. A bundle of another system, as the paper's are, has more
in it, which ``stored`` keeps.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path, PurePath
from typing import Any, get_type_hints

from signsplice.errors import InputError
from signsplice.formats.atomic import replacing_folder
from signsplice.formats.json_files import check_type, read_json
from signsplice.formats.reading import read_bytes

BUNDLE_FILE = "bundle.json"
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
    precision: "int8" where weights are stored in 8 bits.
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


def write_bundle(
    folder: Path, values: Mapping[str, Any], files: Mapping[str, bytes], unlisted: Mapping[str, bytes] | None = None
) -> None:
    """Write files and bundle.json into a folder, all in one step: its whole content is made beside it.

    unlisted: files that bundle.json does not list. Other files in the folder stay, except those of an earlier bundle.
    Raises ``InputError`` where the folder cannot be written.
    """
    hashes = {name: hashlib.sha256(content).hexdigest() for name, content in sorted(files.items())}
    text = json.dumps({"version": VERSION, **values, "files": hashes}, indent=1) + "\n"
    written = {**files, **(unlisted or {}), BUNDLE_FILE: text.encode()}
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder.parent}: cannot be made ({error.strerror})") from error
    with replacing_folder(folder) as made:
        _keep_others(folder, made, written)
        for name, content in written.items():
            (made / name).write_bytes(content)


def _keep_others(folder: Path, made: Path, written: Mapping[str, bytes]) -> None:
    """Link what is in a folder, its earlier bundle and the files that will be ``written`` apart, into another one."""
    if not folder.is_dir():
        return
    replaced = set(written)
    with suppress(InputError):  # no bundle, or none that can be read: all of its files stay
        replaced |= set(read_config(folder).files)

    def at_top(parent: str, names: list[str]) -> set[str]:
        return replaced & set(names) if Path(parent) == folder else set()

    shutil.copytree(folder, made, symlinks=True, ignore=at_top, copy_function=_link, dirs_exist_ok=True)


def _link(source: str, copy: str) -> None:
    try:
        os.link(source, copy, follow_symlinks=False)
    except (OSError, NotImplementedError):  # a system, or a file system, without hard links
        shutil.copy2(source, copy, follow_symlinks=False)


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
    with described(path):
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
def described(path: Path) -> Iterator[None]:
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
