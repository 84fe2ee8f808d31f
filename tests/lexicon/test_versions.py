"""Versions of the format: version 1 is read, version 2 keeps what later versions add to a word."""

from __future__ import annotations

import shutil
import sqlite3
from collections.abc import Callable
from dataclasses import astuple
from pathlib import Path

import numpy as np
import pytest
from conftest import random_clip

from signsplice import lexicon
from signsplice.errors import InputError, UnknownGlossError
from signsplice.motion import Clip

VERSION_1 = Path(__file__).parent / "version-1"
"""Three words, written by version 0.5: I (ME), YOU and fs-A, in 16 bits."""
EXTRA = {"tags": b"\0\1" * 40, "language": b"ase", "owned": b"[]"}


def sql(path: Path, line: str) -> None:
    file = sqlite3.connect(path / "index.sqlite")
    file.execute(line)
    file.commit()
    file.close()


@pytest.fixture
def path(tmp_path: Path) -> Path:
    with lexicon.building(tmp_path / "lex") as builder:
        builder.add(random_clip(0), "TREE", synonyms=["WOOD"], extensions=EXTRA)
        builder.add(random_clip(1), "HOUSE")
    return tmp_path / "lex"


def test_a_lexicon_of_version_1_is_read(words: dict[str, Clip], tmp_path: Path) -> None:
    with lexicon.open(VERSION_1) as old:
        assert old.glosses == ("I", "YOU", "fs-A")
        assert list(old.faults()) == []
        old.verify()
        assert old.form == "int16"
        entry = old.entry("me")
        assert (entry.gloss, entry.signer, entry.source, entry.checked) == ("I", "Kim", "a book, p. 3", True)
        assert np.abs(old.clip("I").local_rotations - words["I"].local_rotations).max() < 1e-4
        assert old.extensions("I") == {}
        with lexicon.building(tmp_path / "new", compact=True) as builder:
            for entry in old.entries():
                facts = {name: getattr(entry, name) for name in ("synonyms", "signer", "source", "checked")}
                builder.add(old.clip(entry.gloss), entry.gloss, **facts)
        with lexicon.open(tmp_path / "new") as new:
            for gloss in old:
                assert np.array_equal(new.clip(gloss).local_rotations, old.clip(gloss).local_rotations)
                assert np.array_equal(new.clip(gloss).root_positions, old.clip(gloss).root_positions)
                assert astuple(new.entry(gloss)) == astuple(old.entry(gloss))


def test_what_is_added_to_a_word_is_kept_by_name(path: Path) -> None:
    with lexicon.open(path) as lex:
        assert lex.extensions("wood") == EXTRA
        assert lex.extensions("HOUSE") == {}
        assert list(lex.faults()) == []
        with pytest.raises(UnknownGlossError):
            lex.extensions("NOTHING")
        with lexicon.building(path.with_name("copy")) as builder:
            for gloss in lex:
                builder.add(lex.clip(gloss), gloss, extensions=lex.extensions(gloss))
    with lexicon.open(path.with_name("copy")) as copy:
        assert copy.extensions("TREE") == EXTRA


def test_channels_of_a_newer_version_are_ignored_and_damaged_ones_are_an_error(tmp_path: Path) -> None:
    with lexicon.building(tmp_path / "lex") as builder:
        builder.add(random_clip(0), "TREE", extensions={"owns": b"head;left leg"})
        builder.add(random_clip(1), "HOUSE", extensions={"owns": b"he\xe4d"})
    with lexicon.open(tmp_path / "lex") as lex:
        assert lex.owns("TREE") == frozenset({"head"})
        with pytest.raises(InputError, match="lex: the channels of the word 'HOUSE' are damaged; build"):
            lex.owns("HOUSE")
        with pytest.raises(UnknownGlossError):
            lex.owns("NOTHING")
    with lexicon.open(VERSION_1) as old:
        assert old.owns("I") is None


@pytest.mark.parametrize(
    "line",
    [
        "UPDATE extension SET value = x'00' WHERE name = 'tags'",
        "UPDATE extension SET name = 'tag' WHERE name = 'tags'",
        "UPDATE extension SET word = 2 WHERE name = 'tags'",
        "DELETE FROM extension",
        "UPDATE extension SET value = 'text' WHERE name = 'tags'",
    ],
)
def test_another_extension_than_was_written_is_found(line: str, path: Path) -> None:
    sql(path, line)
    with lexicon.open(path) as lex:
        assert any(lex.faults())
        with pytest.raises(InputError):
            lex.verify()


@pytest.mark.parametrize(
    "change", [lambda p: sql(p, "PRAGMA user_version = 1"), lambda p: sql(p, "DROP TABLE extension")]
)
def test_a_version_has_its_own_tables(change: Callable[[Path], None], path: Path) -> None:
    change(path)
    with pytest.raises(InputError, match="has other tables"):
        lexicon.open(path)
    shutil.copytree(VERSION_1, path.with_name("old"))
    sql(path.with_name("old"), "PRAGMA user_version = 2")
    with pytest.raises(InputError, match="has other tables"):
        lexicon.open(path.with_name("old"))


def test_an_extension_is_bytes_by_a_printable_name(tmp_path: Path) -> None:
    with lexicon.building(tmp_path / "lex") as builder:
        for extensions in ({"a\n": b""}, {"tags": "text"}):
            with pytest.raises(InputError, match="expected bytes by printable names"):
                builder.add(random_clip(0), "TREE", extensions=extensions)  # type: ignore[arg-type]
        builder.add(random_clip(0), "TREE")
