"""Reading lexicons: words by any of their names, from any thread, and clear errors where one is damaged."""

from __future__ import annotations

import hashlib
import json
import pickle
import re
import sqlite3
import stat
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import random_clip

import signsplice
from signsplice import lexicon
from signsplice.errors import InputError, UnknownGlossError
from signsplice.lexicon import Lexicon
from signsplice.lexicon import lexicon as room
from signsplice.lexicon.frames import HEAD_BYTES, MAGIC
from signsplice.lexicon.gloss import fold, gloss_of
from signsplice.lexicon.store import INDEX, Index
from signsplice.motion import Clip, rotation
from signsplice.progress import Progress
from signsplice.rig.info import active_span, arms


@pytest.fixture
def path(tmp_path: Path, words: dict[str, Clip]) -> Path:
    with lexicon.building(tmp_path / "lex") as builder:
        for gloss, clip in words.items():
            synonyms = ("Hi", "good day") if gloss == "HELLO" else ()
            builder.add(clip, synonyms=synonyms, signer="Kim", source="a book, p. 3", checked=gloss == "DEAF")
        builder.add(replace(random_clip(3), name="你好"))
        for letter in "ABCÉß7":
            builder.add(words["I"], f"FS-{letter}")
    return tmp_path / "lex"


def test_a_word_comes_back_with_its_metadata(path: Path, words: dict[str, Clip]) -> None:
    with lexicon.open(path) as lex:
        for gloss, clip in words.items():
            found, entry = lex.clip(gloss), lex.entry(gloss)
            assert found.name == entry.gloss == gloss
            assert np.max(rotation.angle_between(found.local_rotations, clip.local_rotations)) < 1e-6
            assert np.allclose(found.root_positions, clip.root_positions, rtol=1e-7)
            assert found.skeleton.names == clip.skeleton.names
            assert np.array_equal(found.skeleton.offsets, clip.skeleton.offsets)
            assert [site.joint for site in found.skeleton.end_sites] == [s.joint for s in clip.skeleton.end_sites]
            start, stop = active_span(arms(clip))
            assert (entry.rest_before, entry.rest_after) == (start, len(clip) - stop)
            assert (entry.fps, entry.n_frames, entry.seconds) == (clip.fps, len(clip), clip.seconds)
            assert (entry.signer, entry.source, entry.kind) == ("Kim", "a book, p. 3", "sign")
            assert entry.checked == (gloss == "DEAF")
        assert lex.entry("你好").rest_before is None, "a rig without known arms"
        assert lex.clip("DEAF").skeleton is lex.clip("SIGN").skeleton
        assert list(lex.faults()) == []


def test_glosses_and_synonyms_are_found_in_any_case(path: Path) -> None:
    with lexicon.open(path) as lex:
        for name in ("HELLO", "hello", " Hello ", "HI", "hi", "Good-Day", "good day"):
            assert name in lex
            assert lex.entry(name).gloss == "HELLO"
        assert lex.entry("hello").synonyms == ("HI", "GOOD-DAY")
        for other in ("HELLO2", "", " ", "%", "HELLO'--", "\ud800", 7, None):
            assert other not in lex
        for name in ("fs-é", "FS-É", "fs-e\u0301", "fs-ß", "fs-7"):
            assert lex.entry(name).kind == "letter", name


def test_a_lexicon_is_a_collection_of_glosses(path: Path, words: dict[str, Clip]) -> None:
    with lexicon.open(path) as lex:
        assert len(lex) == len(words) + 7
        assert tuple(lex) == lex.glosses == tuple(entry.gloss for entry in lex.entries())
        assert set(words) | {"你好", "fs-A"} < set(lex)
        assert list(lex.glosses) == sorted(lex.glosses)


def test_unknown_glosses_raise_an_error_with_similar_ones(path: Path) -> None:
    with lexicon.open(path) as lex:
        assert lex.nearest("HALLO") == ("HELLO",)
        assert lex.nearest("thank")[0] == "THANK-YOU"
        assert lex.nearest("good-dya", n=1) == ("GOOD-DAY",)
        assert lex.nearest("QQQQQQ") == ()
        with pytest.raises(UnknownGlossError, match=r"no gloss 'hallo' \(nearest: HELLO\); `signsplice") as caught:
            lex.clip("hallo")
        assert caught.value.unknown == {"hallo": ("HELLO",)}
        again = pickle.loads(pickle.dumps(caught.value))
        assert (str(again), again.unknown) == (str(caught.value), caught.value.unknown)
        with pytest.raises(InputError, match="nothing is near it"):
            lex.entry("QQQQQQ")


def test_an_error_quotes_no_control_characters_and_no_long_gloss_whole() -> None:
    error = UnknownGlossError({"\x1dA": ("\x1dA\n", "B-" * 500), "C" * 2000: ()}, "lex")
    assert r"no gloss '\x1dA' (nearest: \x1dA\n, B-B-" in str(error)
    assert str(error).isprintable()
    assert len(str(error)) < 400
    assert error.unknown["\x1dA"] == ("\x1dA\n", "B-" * 500)


@pytest.mark.parametrize(
    ("typed", "similarity", "nearest"),
    [
        ("wirte", 0.75, ("WRITE", "WHITE")),  # equally like; neighbours that change places are one edit
        ("frend", 0.75, ("FRIEND", "RED")),
        ("recieve", 0.55, ()),
        ("fs-y", 0.7, ("fs-X",)),
        ("fx", 0.4, ()),  # no letter
        ("know", 0.9, ("DONT-KNOW", "I-KNOW")),
        ("dont'know", 0.75, ("DONT-KNOW",)),
        (200 * "ab", 0.75, (199 * "AB",)),
    ],
)
def test_the_names_nearest_to_a_word(typed: str, similarity: float, nearest: tuple[str, ...], tmp_path: Path) -> None:
    clip = random_clip(0, n_frames=2, n_joints=2)
    with lexicon.building(tmp_path / "lex") as builder:
        for gloss in ["WHITE", "WRITE", "FRIEND", "RED", "DONT-KNOW", "I-KNOW", "fs-X"]:
            builder.add(clip, gloss)
        builder.add(clip, 199 * "AB")
    with lexicon.open(tmp_path / "lex") as lex:
        assert lex.nearest(typed, 2, similarity) == nearest


@pytest.mark.parametrize(
    ("text", "gloss"),
    [
        ("hello", "HELLO"),
        ("  thank \t you ", "THANK-YOU"),
        ("ix-1", "IX-1"),
        ("straße", "STRAßE"),
        ("e\u0301te\u0301", "ÉTÉ"),
        ("你好", "你好"),
        ("FS-a", "fs-A"),
        ("fs-anna", "fs-ANNA"),
        ("FS-ß", "fs-ß"),
        ("fs-", "FS-"),
    ],
)
def test_a_gloss_has_one_spelling(text: str, gloss: str) -> None:
    assert gloss_of(text) == gloss == gloss_of(gloss)
    assert fold(text) == fold(gloss)


def test_many_threads_can_read_at_once(path: Path, words: dict[str, Clip]) -> None:
    wrong: list[object] = []
    with lexicon.open(path) as lex:
        expected = {gloss: lex.clip(gloss).local_rotations for gloss in words}

        def read(seed: int) -> None:
            for n in np.random.default_rng(seed).permutation(100):
                gloss = list(words)[n % len(words)]
                try:
                    if not np.array_equal(lex.clip(gloss.lower()).local_rotations, expected[gloss]):
                        wrong.append(gloss)
                    if seed == 0 and not lex.nearest(gloss + "X"):
                        wrong.append("nearest")
                except Exception as error:
                    wrong.append(error)

        threads = [threading.Thread(target=read, args=(seed,)) for seed in range(8)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    assert wrong == []


def test_clips_remain_valid_after_the_lexicon_is_closed(path: Path) -> None:
    lex = lexicon.open(path)
    clip = lex.clip("SIGN")
    lex.close()
    lex.close()
    assert np.isfinite(clip.local_rotations).all()
    for use in (lambda: lex.clip("SIGN"), lambda: lex.glosses, lambda: "SIGN" in lex, lambda: lex.nearest("S")):
        with pytest.raises(InputError, match="is closed"):
            use()


def test_a_lexicon_can_be_pickled(path: Path) -> None:
    with lexicon.open(path) as lex, pickle.loads(pickle.dumps(lex)) as other:
        assert other.glosses == lex.glosses


def test_reading_writes_nothing_and_takes_no_lock(path: Path) -> None:
    for part in (*path.iterdir(), path):
        part.chmod(part.stat().st_mode & ~(stat.S_IWUSR | stat.S_IWGRP | stat.S_IWOTH))
    before = {part.name: (part.stat().st_mtime_ns, part.read_bytes()) for part in path.iterdir()}
    try:
        with lexicon.open(path) as lex:
            lex.clip("SIGN")
        # A lock that another program holds on the index does not matter.
        path.chmod(0o755)
        (path / "index.sqlite").chmod(0o644)
        other = sqlite3.connect(path / "index.sqlite", isolation_level=None)
        other.execute("BEGIN EXCLUSIVE")
        with lexicon.open(path) as lex:
            assert "SIGN" in lex
        other.execute("ROLLBACK")
        other.close()
        assert {part.name: (part.stat().st_mtime_ns, part.read_bytes()) for part in path.iterdir()} == before
    finally:
        path.chmod(0o755)


def sql(*lines: str) -> Callable[[Path], None]:
    """A change of a lexicon's index by SQL."""

    def run(path: Path) -> None:
        file = sqlite3.connect(path / "index.sqlite")
        for line in lines:
            file.execute(line)
        file.commit()
        file.close()

    return run


def rewrite(name: str, change: Callable[[bytes], bytes]) -> Callable[[Path], None]:
    """A change of the bytes of one of a lexicon's files."""

    def run(path: Path) -> None:
        (path / name).write_bytes(change((path / name).read_bytes()))

    return run


BROKEN: dict[str, tuple[Callable[[Path], None], str]] = {
    "no index": (lambda p: (p / "index.sqlite").unlink(), "has no index.sqlite"),
    "no frames": (lambda p: (p / "frames.bin").unlink(), "has no frames.bin"),
    "empty index": (rewrite("index.sqlite", lambda b: b""), "no index of a lexicon"),
    "index of text": (rewrite("index.sqlite", lambda b: b"words\n" * 200), "cannot be read"),
    "index cut short": (rewrite("index.sqlite", lambda b: b[:5000]), "index.sqlite"),
    "foreign index": (sql("PRAGMA application_id = 7"), "no index of a lexicon"),
    "newer": (sql("PRAGMA user_version = 3"), "version 3, expected 1 or 2; .* update signsplice"),
    "no head": (sql("DELETE FROM lexicon"), "no head"),
    "no table": (sql("DROP TABLE lexicon"), "has other tables"),
    "no words": (sql("UPDATE lexicon SET n_words = -1"), "-1 words, expected at least one"),
    "head of another type": (sql("UPDATE lexicon SET form = x'00'"), "damaged"),
    "another table": (sql("CREATE TABLE more (a)"), "has other tables"),
    "a view without end": (
        sql(
            "ALTER TABLE lexicon RENAME TO old",
            "CREATE VIEW lexicon AS WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) "
            "SELECT old.* FROM old, n",
        ),
        "has other tables",
    ),
    "a table that is no UTF-8": (
        rewrite("index.sqlite", lambda b: b.replace(b"CREATE TABLE skeleton", b"CREATE\xa0TABLE skeleton")),
        "cannot be read",
    ),
    "other form": (sql("UPDATE lexicon SET form = 'float8'"), "form 'float8', expected one of float32, int16"),
    "frames cut short": (rewrite("frames.bin", lambda b: b[:-10]), "bytes, expected"),
    "frames empty": (rewrite("frames.bin", lambda b: b""), "0 bytes, expected"),
    "other frames": (rewrite("frames.bin", lambda b: b[:40] + b"????" + b[44:]), "belongs to another index"),
    "head of no hash": (sql("UPDATE lexicon SET sha256 = 'xyz'"), "belongs to another index"),
}


@pytest.mark.parametrize("what", BROKEN)
def test_broken_lexicons_are_refused_when_opened(what: str, path: Path) -> None:
    damage, message = BROKEN[what]
    damage(path)
    with pytest.raises(InputError, match=message) as caught:
        lexicon.open(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_paths_without_a_lexicon_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("")
    for name, message in (("nowhere", "no such folder"), ("file", "is a file"), (".", "is no lexicon")):
        with pytest.raises(InputError, match=message):
            lexicon.open(tmp_path / name)

    def refuse(*_: object, **__: object) -> bool:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "exists", refuse)
    with pytest.raises(InputError, match=r"lex: cannot be read \(Permission denied\)"):
        lexicon.open(tmp_path / "lex")


DAMAGED: dict[str, tuple[Callable[[Path], None], str]] = {
    "bytes changed": (
        rewrite("frames.bin", lambda b: b[:-3000] + bytes(x ^ 64 for x in b[-3000:-2000]) + b[-2000:]),
        "SHA-256 is another|damaged",
    ),
    "bytes lost": (rewrite("frames.bin", lambda b: b[:5000] + bytes(len(b) - 5000)), "damaged"),
    "frames miscounted": (sql("UPDATE word SET n_frames = n_frames + 1 WHERE gloss = 'SIGN'"), "'SIGN' is damaged"),
    "no frames": (sql("UPDATE word SET n_frames = 0 WHERE gloss = 'SIGN'"), "'SIGN' is damaged"),
    "far too many": (sql("UPDATE word SET n_frames = 1000000000000 WHERE gloss = 'SIGN'"), "'SIGN' is damaged"),
    "past the end": (sql("UPDATE word SET start = 100000000 WHERE gloss = 'SIGN'"), "'SIGN' is damaged"),
    "rate of zero": (sql("UPDATE word SET fps = 0 WHERE gloss = 'SIGN'"), "'SIGN' is damaged.*frame rate 0"),
    "rate changed": (sql("UPDATE word SET fps = 29 WHERE gloss = 'SIGN'"), "'SIGN': its SHA-256 is another"),
    "rate without end": (sql("UPDATE word SET fps = 9e999 WHERE gloss = 'SIGN'"), "'SIGN' is damaged"),
    "rate of text": (sql("UPDATE word SET fps = 'fast' WHERE gloss = 'SIGN'"), "'SIGN' is damaged"),
    "gloss of bytes": (sql("UPDATE word SET gloss = x'00ff' WHERE gloss = 'SIGN'"), "is damaged"),
    "gloss of two lines": (sql("UPDATE word SET gloss = 'A' || char(10) || 'B' WHERE gloss = 'SIGN'"), "is damaged"),
    "unknown kind": (sql("UPDATE word SET kind = 'pause' WHERE gloss = 'SIGN'"), "'SIGN' is damaged"),
    "signer of a blob": (sql("UPDATE word SET signer = x'41' WHERE gloss = 'SIGN'"), "'SIGN' is damaged"),
    "half a start": (sql("UPDATE word SET start = 0.5 WHERE gloss = 'SIGN'"), "'SIGN' is damaged"),
    "mark of 7": (sql("UPDATE word SET has_translations = 7 WHERE gloss = 'SIGN'"), "'SIGN' is damaged"),
    "rest of text": (sql("UPDATE word SET rest_before = 'long' WHERE gloss = 'SIGN'"), "'SIGN' is damaged"),
    "hash of no hash": (sql("UPDATE word SET sha256 = 'xyz' WHERE gloss = 'SIGN'"), "'SIGN' is damaged"),
    "synonyms of an object": (
        sql("""UPDATE word SET synonyms = '{"a": 1}' WHERE gloss = 'SIGN'"""),
        "'SIGN' is damaged",
    ),
    "synonyms of numbers": (sql("UPDATE word SET synonyms = '[1]' WHERE gloss = 'SIGN'"), "'SIGN' is damaged"),
    "synonyms too deep": (
        sql(f"UPDATE word SET synonyms = '{'[' * 100_000}' WHERE gloss = 'SIGN'"),
        "'SIGN' is damaged",
    ),
    "synonyms of no list": (sql("UPDATE word SET synonyms = '[' WHERE gloss = 'SIGN'"), "'SIGN' is damaged"),
    "text of no UTF-8": (sql("UPDATE word SET signer = CAST(x'ff' AS TEXT) WHERE gloss = 'SIGN'"), "cannot be read"),
    "skeleton changed": (sql("UPDATE skeleton SET described = replace(described, 'Arm', 'Ram')"), "skeleton 1 is"),
    "skeleton lost": (sql("DELETE FROM skeleton"), "skeleton 1 is damaged"),
    "name lost": (sql("DELETE FROM name WHERE shown = 'HI'"), "'HELLO': is not found by 'HI'"),
    "signer changed": (
        sql("UPDATE word SET signer = 'Kin' WHERE gloss = 'SIGN'"),
        "its entries are not those",
    ),
    "confirmed by nobody": (
        sql("UPDATE word SET checked = 1 WHERE gloss = 'SIGN'"),
        "its entries are not those",
    ),
    "name in another case": (sql("UPDATE name SET shown = 'sIGN' WHERE shown = 'SIGN'"), "its entries are not those"),
    "word lost": (sql("DELETE FROM word WHERE gloss = 'SIGN'"), "11 words, expected 12"),
}


@pytest.mark.parametrize("what", DAMAGED)
def test_damaged_words_are_reported(what: str, path: Path) -> None:
    damage, message = DAMAGED[what]
    damage(path)
    with lexicon.open(path) as lex:
        try:
            faults = " / ".join(lex.faults())
        except InputError as error:  # the index itself cannot be read any further
            faults = str(error)
    assert re.search(message, faults), faults
    assert "\n" not in faults


def test_a_word_is_compared_with_its_hash_when_it_is_read(path: Path) -> None:
    DAMAGED["rate changed"][0](path)
    with lexicon.open(path) as lex:
        assert lex.clip("HELLO").name == "HELLO"
        with pytest.raises(InputError, match="'SIGN': its SHA-256 is another than when it was written; build"):
            lex.clip("SIGN")
        with pytest.raises(InputError, match="'SIGN': its SHA-256"):
            lex.verify()


def test_a_lexicon_whose_head_has_the_hashes_of_words_alone_is_sound(path: Path) -> None:
    """As versions up to 0.4 wrote it."""
    rows = Index(path / INDEX).ask("SELECT sha256 FROM word ORDER BY id")
    digest = hashlib.sha256(b"".join(bytes.fromhex(row) for (row,) in rows))
    sql(f"UPDATE lexicon SET sha256 = '{digest.hexdigest()}'")(path)
    rewrite("frames.bin", lambda b: MAGIC + digest.digest() + b[HEAD_BYTES:])(path)
    with lexicon.open(path) as lex:
        lex.verify()
        assert list(lex.faults()) == []


def test_a_name_that_leads_to_another_word_is_refused(path: Path) -> None:
    sql("UPDATE name SET word = (SELECT id FROM word WHERE gloss = 'I') WHERE shown = 'SIGN'")(path)
    with lexicon.open(path) as lex, pytest.raises(InputError, match="'SIGN' leads to the word 'I'"):
        lex.clip("SIGN")


SKELETONS: dict[str, tuple[str, Any]] = {
    "names of numbers": ("names", [1]),
    "parents of text": ("parents", "abc"),
    "half offsets": ("offsets", [[0.0, 1.0]]),
    "an end site of no joint": ("end_sites", [[99, [0.0, 1.0, 0.0]]]),
    "an end site of two numbers": ("end_sites", [[0, [0.0, 1.0]]]),
    "roles of a list": ("roles", ["hips"]),
    "roles of numbers": ("roles", {"hips": 1}),
    "too many joints": ("names", [f"j{n}" for n in range(5000)]),
}


@pytest.mark.parametrize("what", SKELETONS)
def test_a_skeleton_of_other_types_is_damage(what: str, path: Path) -> None:
    file = sqlite3.connect(path / "index.sqlite")
    (text,) = file.execute("SELECT described FROM skeleton WHERE id = 1").fetchone()
    name, value = SKELETONS[what]
    text = json.dumps({**json.loads(text), name: value})
    file.execute("UPDATE skeleton SET described = ?, sha256 = ?", (text, hashlib.sha256(text.encode()).hexdigest()))
    file.commit()
    file.close()
    with lexicon.open(path) as lex, pytest.raises(InputError, match="skeleton 1 is damaged") as caught:
        lex.clip("SIGN")
    assert "\n" not in str(caught.value)


def test_pages_of_an_index_that_lead_to_each_other_are_no_endless_table(path: Path) -> None:
    """A table of three levels of pages, each of which leads 500 times to the next: 125 million leaves."""
    size = 4096

    def interior(child: int) -> bytes:
        cells = (child.to_bytes(4, "big") + b"\1") * 500
        first = size - len(cells)
        starts = b"".join((first + 5 * n).to_bytes(2, "big") for n in range(500))
        head = b"\5\0\0" + (500).to_bytes(2, "big") + first.to_bytes(2, "big") + b"\0" + child.to_bytes(4, "big")
        return (head + starts).ljust(first, b"\0") + cells

    index = path / "index.sqlite"
    file = sqlite3.connect(index)
    assert file.execute("PRAGMA page_size").fetchone() == (size,)
    (root,) = file.execute("SELECT rootpage FROM sqlite_master WHERE name = 'word'").fetchone()
    file.close()
    content = bytearray(index.read_bytes())
    n_pages = len(content) // size
    content += content[(root - 1) * size : root * size] + interior(n_pages + 1) + interior(n_pages + 2)
    content[(root - 1) * size : root * size] = interior(n_pages + 3)
    content[28:32] = (n_pages + 3).to_bytes(4, "big")
    index.write_bytes(content)
    with lexicon.open(path) as lex, pytest.raises(InputError, match=r"index\.sqlite: cannot be read \(interrupted\)"):
        list(lex.entries())


def test_frames_that_stand_still_take_no_unbounded_memory(tmp_path: Path, words: dict[str, Clip]) -> None:
    clip = words["I"][:1]
    with lexicon.building(tmp_path / "lex") as builder:
        builder.add(clip, "STILL")
    sql("UPDATE word SET n_frames = 100000000")(tmp_path / "lex")
    with lexicon.open(tmp_path / "lex") as lex, pytest.raises(InputError, match=r"'STILL' is damaged.*MiB of memory"):
        lex.clip("STILL")


def test_the_shipped_lexicon_may_be_missing_from_a_build(
    path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(room, "SHIPPED", path)
    with lexicon.open_shipped_lexicon() as lex:
        assert "HELLO" in lex
    monkeypatch.setattr(room, "SHIPPED", tmp_path / "none")
    with pytest.raises(InputError, match="no words ship with this build"):
        lexicon.open_shipped_lexicon()


def test_the_package_exports_open_lexicon(path: Path) -> None:
    with signsplice.open_lexicon(path) as lex:
        assert isinstance(lex, signsplice.Lexicon)
    with signsplice.open_lexicon() as words:
        assert len(words) == len(lexicon.open_shipped_lexicon())


def test_a_search_reads_the_index_once(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with lexicon.open(path) as lex:
        found = lex.search("h")
        assert found[0].gloss == "HELLO"
        monkeypatch.setattr(Index, "ask", lambda *_: pytest.fail("the index is read anew"))
        assert lex.search("h") == found
        assert lex.search("good") == [entry for entry in lex.entries() if entry.gloss == "HELLO"]


@pytest.mark.parametrize("check", [Lexicon.faults, Lexicon.warnings])
def test_checks_report_their_progress(path: Path, check: Callable[[Lexicon, Progress], Iterator[str]]) -> None:
    calls: list[tuple[int, int]] = []
    with lexicon.open(path) as lex:
        list(check(lex, lambda done, total: calls.append((done, total))))
        assert calls == [(done, len(lex)) for done in range(1, len(lex) + 1)]
