"""What a bundle says of its origin: commands without this machine's folders, and hashes of the data."""

from __future__ import annotations

import hashlib
from pathlib import Path

import pytest

pytest.importorskip("torch")

from signsplice.errors import InputError
from signsplice_workshop.train import records


def test_a_command_has_no_folders_of_this_machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    options: dict[str, records.Option] = {
        "signing": [Path("out/a"), tmp_path / "out" / "b", Path("/somewhere/else/c")],
        "steps": None,
        "seed": 3,
        "scale": "ship",
        "bare": True,
        "bf16": False,
        "out": Path("../x"),
    }
    assert records.format_command(["train", "cutter"], options) == [
        *("signsplice", "train", "cutter", "--signing", "out/a", "--signing", "out/b", "--signing", "c"),
        *("--seed", "3", "--scale", "ship", "--bare", "--no-bf16", "--out", "../x"),
    ]


def test_hashes_are_those_of_sha256sum(tmp_path: Path) -> None:
    (tmp_path / "a.npy").write_bytes(b"one" * 10**6)
    (tmp_path / "b.txt").write_bytes(b"two")
    (tmp_path / "c.npy").mkdir()
    expected = {"a.npy": hashlib.sha256(b"one" * 10**6).hexdigest()}
    assert records.hash_folder(tmp_path, "*.npy") == expected
    with pytest.raises(InputError, match="none: cannot be read"):
        records.hash_file(tmp_path / "none")
