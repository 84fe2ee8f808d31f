"""What a bundle says of its origin: commands without this machine's folders, and hashes of the data."""

from __future__ import annotations

import hashlib
import shutil
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch")

from signsplice.errors import InputError
from signsplice.train import checkpoint, provenance
from training_toys import corpus


def test_a_command_has_no_folders_of_this_machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    options: dict[str, provenance.Option] = {
        "signing": [Path("out/a"), tmp_path / "out" / "b", Path("/somewhere/else/c")],
        "steps": None,
        "seed": 3,
        "scale": "ship",
        "int8": True,
        "bf16": False,
        "out": Path("../x"),
    }
    assert provenance.command(["train", "cutter"], options) == [
        *("signsplice", "train", "cutter", "--signing", "out/a", "--signing", "out/b", "--signing", "c"),
        *("--seed", "3", "--scale", "ship", "--int8", "--no-bf16", "--out", "../x"),
    ]


def test_hashes_are_those_of_sha256sum(tmp_path: Path) -> None:
    (tmp_path / "a.npy").write_bytes(b"one" * 10**6)
    (tmp_path / "b.txt").write_bytes(b"two")
    (tmp_path / "c.npy").mkdir()
    expected = {"a.npy": hashlib.sha256(b"one" * 10**6).hexdigest()}
    assert provenance.folder_sha256(tmp_path, "*.npy") == expected
    with pytest.raises(InputError, match="none: cannot be read"):
        provenance.sha256(tmp_path / "none")


def test_a_corpus_of_equal_recipe_and_other_bytes_is_refused(tmp_path: Path) -> None:
    changed, part = tmp_path / "pairs", tmp_path / "part"
    part.mkdir()
    shutil.copytree(corpus().folder, changed)
    assert provenance.corpus_data(corpus().folder, part) == provenance.corpus_data(changed, part)
    positions = np.load(changed / "new_positions.npy")
    np.save(changed / "new_positions.npy", positions + np.float32(0.001))
    with pytest.raises(InputError, match=r"part: was trained on data in which new_positions.npy differed"):
        provenance.corpus_data(changed, part)


def test_data_of_an_older_training_are_unknown(tmp_path: Path) -> None:
    (tmp_path / checkpoint.NAME).write_bytes(b"")
    assert provenance.corpus_data(corpus().folder, tmp_path) is None
    assert not (tmp_path / provenance.DATA_FILE).exists()
