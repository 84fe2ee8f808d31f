"""Writing lexicons: whole or not at all, whatever fails."""

from __future__ import annotations

import errno
import os
import sqlite3
import subprocess
import sys
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import ROOT, random_clip

from signsplice import lexicon
from signsplice.errors import InputError
from signsplice.formats import save
from signsplice.lexicon.index import IndexWriter
from signsplice.motion import Clip


def tree(folder: Path) -> dict[str, bytes]:
    """Relative path -> content of every file below a folder."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def write(path: Path, *glosses: str, compact: bool = False) -> None:
    """Write a lexicon of random clips."""
    with lexicon.building(path, compact=compact) as builder:
        for seed, gloss in enumerate(glosses):
            builder.add(random_clip(seed), gloss)


@pytest.fixture(params=["new", "replaced"])
def target(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """Where a lexicon is to be written: an empty path, or one with an older lexicon."""
    if request.param == "replaced":
        write(tmp_path / "lex", "OLD")
    return tmp_path / "lex"


def test_a_new_lexicon_replaces_an_old_one(target: Path) -> None:
    write(target, "NEW", "WORDS")
    with lexicon.open(target) as lex:
        assert lex.glosses == ("NEW", "WORDS")
    assert sorted(path.name for path in target.parent.iterdir()) == ["lex"]


def test_the_same_words_make_the_same_bytes(tmp_path: Path) -> None:
    write(tmp_path / "a", "ONE", "TWO")
    write(tmp_path / "b", "ONE", "TWO")
    assert tree(tmp_path / "a") == tree(tmp_path / "b")


def test_an_open_lexicon_outlives_its_replacement(tmp_path: Path) -> None:
    write(tmp_path / "lex", "OLD")
    with lexicon.open(tmp_path / "lex") as old:
        write(tmp_path / "lex", "NEW")
        assert len(old.clip("OLD")) == 20
    with lexicon.open(tmp_path / "lex") as new:
        assert "OLD" not in new


@pytest.mark.parametrize("error", [KeyboardInterrupt(), RuntimeError("a bug"), InputError("a broken clip")])
def test_an_interrupted_build_changes_nothing(target: Path, error: BaseException) -> None:
    before = tree(target.parent)

    def interrupted() -> None:
        with lexicon.building(target) as builder:
            builder.add(random_clip(0), "A")
            raise error

    with pytest.raises(type(error)):
        interrupted()
    assert tree(target.parent) == before
    assert [path.name for path in target.parent.iterdir() if path.name.startswith(".")] == []


@pytest.mark.parametrize("where", ["frames", "index"])
def test_a_full_disk_changes_nothing(target: Path, where: str, monkeypatch: pytest.MonkeyPatch) -> None:
    full = OSError(errno.ENOSPC, "No space left on device")

    class FullFile:
        def __init__(self, path: Path, mode: str) -> None:
            self._file = open_file(path, mode)
            self._room = 2000

        def write(self, block: bytes) -> None:
            self._room -= len(block)
            self._file.write(block)
            if self._room < 0:
                raise full

        def close(self) -> None:
            self._file.close()

    def fail_in_sqlite(*_: object) -> None:
        raise sqlite3.OperationalError("database or disk is full")

    open_file = Path.open
    before = tree(target.parent)
    if where == "frames":
        monkeypatch.setattr(Path, "open", lambda path, mode: (FullFile if mode == "wb" else open_file)(path, mode))
    else:
        monkeypatch.setattr(IndexWriter, "finish", fail_in_sqlite)
    with pytest.raises(InputError, match=r"lex: cannot be written \(.*(No space|disk is full).*\)"):
        write(target, *(f"WORD{n}" for n in range(20)))
    monkeypatch.undo()
    assert tree(target.parent) == before
    assert [path.name for path in target.parent.iterdir() if path.name.startswith(".")] == []
    if before:
        with lexicon.open(target) as lex:
            assert lex.glosses == ("OLD",)


def test_a_file_size_limit_changes_nothing(tmp_path: Path) -> None:
    """A real limit on the size of files, in a process of its own."""
    resource = pytest.importorskip("resource")
    code = (
        "import resource, sys; from conftest import random_clip; from signsplice import lexicon\n"
        f"resource.setrlimit({resource.RLIMIT_FSIZE}, (60000, 60000))\n"
        "with lexicon.building(sys.argv[1]) as builder:\n"
        "    for n in range(40): builder.add(random_clip(n), f'W{n}')\n"
    )
    run = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path / "lex")],
        capture_output=True,
        text=True,
        env={"PYTHONPATH": os.pathsep.join(map(str, (ROOT, ROOT / "tests")))},
        check=False,
    )
    assert run.returncode == 1
    assert "lex: cannot be written (" in run.stderr.splitlines()[-1]
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with names")
def test_a_pipe_in_the_place_of_an_index_is_no_lexicon(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "index.sqlite")
    with pytest.raises(InputError, match="is there already and is no lexicon"):
        write(tmp_path, "A")


def test_paths_with_other_files_are_refused(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "letter.txt").write_text("dear")
    (tmp_path / "file").write_text("x")
    (tmp_path / "database").mkdir()
    other = sqlite3.connect(tmp_path / "database" / "index.sqlite")
    other.execute("CREATE TABLE addresses (name TEXT)")
    other.close()
    write(tmp_path / "notes", "A")
    (tmp_path / "notes" / "README.txt").write_text("mine")
    before = tree(tmp_path)
    for name, message in (
        ("folder", "is there already and is no lexicon"),
        ("file", "is there already and is no lexicon"),
        ("database", "is there already and is no lexicon"),
        ("notes", "holds README.txt beside its lexicon"),
        ("none/lex", "folder .*none does not exist"),
    ):
        with pytest.raises(InputError, match=message):
            write(tmp_path / name, "A")
    assert tree(tmp_path) == before


def test_a_link_is_not_replaced(tmp_path: Path) -> None:
    write(tmp_path / "real", "OLD")
    (tmp_path / "link").symlink_to("real")
    with pytest.raises(InputError, match="link: is a link, which would be replaced; name the folder that it leads to"):
        write(tmp_path / "link", "NEW")
    with lexicon.open(tmp_path / "link") as lex:
        assert lex.glosses == ("OLD",)


def test_a_lexicon_and_its_clips_do_not_lie_in_one_another(tmp_path: Path) -> None:
    write(tmp_path / "lex", "OLD")
    save(random_clip(0), tmp_path / "A.bvh")
    (tmp_path / "spelled").symlink_to(tmp_path)
    for folder in (tmp_path, tmp_path / "spelled", tmp_path / "lex"):
        before = tree(tmp_path)
        with pytest.raises(InputError, match="which is read, or contains it; name another folder"):
            lexicon.build(folder, tmp_path / "lex")
        assert tree(tmp_path) == before


def test_a_word_that_is_refused_leaves_the_others_intact(tmp_path: Path) -> None:
    clip = random_clip(0)
    with lexicon.building(tmp_path / "lex") as builder:
        builder.add(clip, "BYE", synonyms=["SEE-YOU", "bye", "see you"])
        bad: tuple[tuple[str, dict[str, Any], str], ...] = (
            ("bye", {}, "gloss 'BYE' stands twice: for BYE and for BYE"),
            ("see you", {}, "'SEE-YOU' stands twice: for SEE-YOU and for BYE"),
            ("LATER", {"synonyms": ["Bye"]}, "'BYE' stands twice: for LATER and for BYE"),
            ("A\x07", {}, "expected printable characters"),
            ("A", {"kind": "word"}, "kind 'word', expected sign or letter"),
            ("A", {"kind": "letter"}, "such as fs-A"),
            ("fs-AB", {"kind": "letter"}, "such as fs-A"),
        )
        for gloss, options, message in bad:
            with pytest.raises(InputError, match=message):
                builder.add(clip, gloss, **options)
        assert builder.add(clip, "LATER").gloss == "LATER"
    with lexicon.open(tmp_path / "lex") as lex:
        assert lex.glosses == ("BYE", "LATER")
        assert lex.entry("BYE").synonyms == ("SEE-YOU",)
        assert list(lex.faults()) == []


def test_a_lexicon_without_words_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no word was added"):
        write(tmp_path / "lex")
    assert list(tmp_path.iterdir()) == []


def test_equal_skeletons_are_stored_once(tmp_path: Path, words: dict[str, Clip]) -> None:
    with lexicon.building(tmp_path / "lex", compact=True) as builder:
        for n, clip in enumerate([*words.values(), *words.values(), random_clip(1), random_clip(1)]):
            builder.add(clip, f"W{n}")
    file = sqlite3.connect(tmp_path / "lex" / "index.sqlite")
    assert file.execute("SELECT count(*) FROM skeleton").fetchone() == (2,)
    file.close()


def test_memory_does_not_grow_with_the_number_of_words(tmp_path: Path) -> None:
    peaks = []
    for n_words in (5, 60):
        tracemalloc.start()
        with lexicon.building(tmp_path / "lex") as builder:
            for n in range(n_words):
                builder.add(random_clip(0, n_frames=400, n_joints=30), f"W{n}")
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert np.ptp(peaks) < 0.2 * max(peaks)
