"""splicing.bundle: bundle.json is read and checked in one place, and so is every file that it lists."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from conftest import GOLDEN

from signsplice.errors import InputError
from signsplice.splicing.bundle import BUNDLE_FILE, bundle_sha256, read_config, read_file
from signsplice_workshop.train.bundles import write_bundle

TINY = GOLDEN / "tiny_bundle"
VALUES: Mapping[str, Any] = {"system": "signsplice", "features": 5, "networks": {"cutter": {"n_parameters": 12}}}


def test_a_bundle_is_read_as_it_was_written(tmp_path: Path) -> None:
    files = {"a.onnx": b"first", "b.onnx": b"second"}
    write_bundle(tmp_path, VALUES, files)
    config = read_config(tmp_path)
    assert (config.system, config.features, config.precision) == ("signsplice", 5, None)
    assert config.networks["cutter"].n_parameters == 12
    assert config.networks["cutter"].trained_on is None
    assert config.files == {name: hashlib.sha256(content).hexdigest() for name, content in files.items()}
    assert {name: read_file(tmp_path, config, name) for name in files} == files
    assert bundle_sha256(tmp_path) == hashlib.sha256((tmp_path / BUNDLE_FILE).read_bytes()).hexdigest()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("{", "bundle.json:1: is no JSON"),
        ("[]", "bundle.json: version None, expected 1; export the system anew"),
        ("{}", "version None, expected 1"),
        ('{"version": 2}', "version 2, expected 1"),
        ('{"version": 1, "system": 1}', "bundle.json: is no description of a trained system"),
        ('{"version": 1, "networks": [3]}', "is no description of a trained system"),
        ('{"version": 1, "networks": {"cutter": {"n_parameters": "many"}}}', "is no description of a trained system"),
    ],
)
def test_a_broken_or_old_bundle_is_refused(content: str, message: str, tmp_path: Path) -> None:
    (tmp_path / BUNDLE_FILE).write_text(content)
    with pytest.raises(InputError, match=message):
        read_config(tmp_path)


def test_a_missing_bundle_is_refused(tmp_path: Path) -> None:
    for read in (read_config, bundle_sha256):
        with pytest.raises(InputError, match=r"bundle\.json: no such file"):
            read(tmp_path)


def test_a_file_that_is_changed_missing_or_not_listed_is_refused(tmp_path: Path) -> None:
    write_bundle(tmp_path, VALUES, {"a.onnx": b"first", "b.onnx": b"second"})
    config = read_config(tmp_path)
    (tmp_path / "a.onnx").write_bytes(b"other")
    (tmp_path / "b.onnx").unlink()
    (tmp_path / "c.onnx").write_bytes(b"third")
    for name, message in (
        ("a.onnx", r"a\.onnx: is not the file that bundle\.json lists \(its sha256 differs\)"),
        ("b.onnx", r"b\.onnx: no such file"),
        ("c.onnx", r"bundle\.json: lists no file c\.onnx"),
    ):
        with pytest.raises(InputError, match=message):
            read_file(tmp_path, config, name)


@pytest.mark.parametrize("refusal", [OSError("no hard links here"), NotImplementedError("follow_symlinks")])
def test_where_there_are_no_hard_links_other_files_stay_too(
    refusal: Exception, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise refusal

    write_bundle(tmp_path / "bundle", VALUES, {"a.onnx": b"first"})
    (tmp_path / "bundle" / "notes.txt").write_text("mine")
    monkeypatch.setattr("os.link", refuse)
    write_bundle(tmp_path / "bundle", VALUES, {"a.onnx": b"second"})
    assert (tmp_path / "bundle" / "notes.txt").read_text() == "mine"
    assert (tmp_path / "bundle" / "a.onnx").read_bytes() == b"second"


def test_a_bundle_is_replaced_as_a_whole_and_other_files_stay(tmp_path: Path) -> None:
    folder = tmp_path / "made" / "bundle"
    write_bundle(folder, VALUES, {"a.onnx": b"first", "stale.onnx": b"first"}, {"a.jsonl": b"log"})
    (folder / "mine").mkdir()
    (folder / "mine" / "notes.txt").write_text("mine")
    (folder / "a.onnx.bak").write_bytes(b"older")
    before = sorted(path.name for path in folder.iterdir())
    with pytest.raises(TypeError):
        write_bundle(folder, VALUES, {"a.onnx": b"second", "b.onnx": None})  # type: ignore[dict-item]
    assert sorted(path.name for path in folder.iterdir()) == before
    assert read_file(folder, read_config(folder), "a.onnx") == b"first"
    write_bundle(folder, VALUES, {"a.onnx": b"second"})
    assert read_file(folder, read_config(folder), "a.onnx") == b"second"
    kept = sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*"))
    assert kept == ["a.jsonl", "a.onnx", "a.onnx.bak", "bundle.json", "mine", "mine/notes.txt"]
    assert [path.name for path in folder.parent.iterdir()] == ["bundle"]


def test_the_tiny_bundle_lists_its_networks_and_files() -> None:
    config = read_config(TINY)
    assert set(config.networks) == {"cutter", "transition"}
    for name in config.files:
        read_file(TINY, config, name)
    assert json.loads((TINY / BUNDLE_FILE).read_text()) == config.stored
