"""Writes a bundle: ONNX files and the bundle.json that ``signsplice.splicing.bundle`` reads."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from signsplice.errors import InputError
from signsplice.formats.atomic import replacing_folder
from signsplice.splicing.bundle import BUNDLE_FILE, VERSION, read_config


def write_bundle(
    folder: Path, values: Mapping[str, Any], files: Mapping[str, bytes], unlisted: Mapping[str, bytes] | None = None
) -> None:
    """Writes files and bundle.json into a folder, all in one step: its whole content is prepared beside it.

    unlisted: files that bundle.json does not list. Other files in the folder stay, except those of an earlier bundle.
    Raises ``InputError`` if the folder cannot be written.
    """
    hashes = {name: hashlib.sha256(content).hexdigest() for name, content in sorted(files.items())}
    text = json.dumps({"version": VERSION, **values, "files": hashes}, indent=1) + "\n"
    written = {**files, **(unlisted or {}), BUNDLE_FILE: text.encode()}
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder.parent}: cannot be made ({error.strerror})") from error
    with replacing_folder(folder) as new_folder:
        _link_remaining_files(folder, new_folder, written)
        for name, content in written.items():
            (new_folder / name).write_bytes(content)


def _link_remaining_files(folder: Path, new_folder: Path, written: Mapping[str, bytes]) -> None:
    """Links the files of a folder, except its earlier bundle and the files to be ``written``, into another one."""
    if not folder.is_dir():
        return
    replaced = set(written)
    with suppress(InputError):  # no bundle, or none that can be read: all of its files stay
        replaced |= set(read_config(folder).files)

    def find_replaced(parent: str, names: list[str]) -> set[str]:
        return replaced & set(names) if Path(parent) == folder else set()

    shutil.copytree(folder, new_folder, symlinks=True, ignore=find_replaced, copy_function=_link, dirs_exist_ok=True)


def _link(source: str, copy: str) -> None:
    try:
        os.link(source, copy, follow_symlinks=False)
    except (OSError, NotImplementedError):  # a system, or a file system, without hard links
        shutil.copy2(source, copy, follow_symlinks=False)
