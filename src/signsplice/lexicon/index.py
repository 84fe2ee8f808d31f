"""The index of a lexicon: one SQLite file, written once with the lexicon and never changed.

It is opened as immutable: SQLite takes no lock and creates no other file, so the folder may be read-only.
"""

from __future__ import annotations

import hashlib
import json
import re
import sqlite3
import threading
from collections.abc import Iterator
from dataclasses import astuple, dataclass
from pathlib import Path
from typing import Any, get_type_hints

from signsplice.errors import InputError
from signsplice.formats import skeletons
from signsplice.formats.json_files import check_type, parse_json
from signsplice.formats.reading import opened
from signsplice.lexicon.entry import KINDS, Entry, fold
from signsplice.motion import Skeleton

INDEX = "index.sqlite"
VERSION = 1
APPLICATION_ID = 0x53_50_4C_58
"""SQLite's application id in the file's header, by which a lexicon's index is recognised."""

_TABLES = (
    "CREATE TABLE lexicon "
    "(form TEXT NOT NULL, n_words INTEGER NOT NULL, n_bytes INTEGER NOT NULL, sha256 TEXT NOT NULL)",
    "CREATE TABLE skeleton (id INTEGER PRIMARY KEY, sha256 TEXT NOT NULL, described TEXT NOT NULL)",
    """CREATE TABLE word (
    id INTEGER PRIMARY KEY, gloss TEXT NOT NULL, kind TEXT NOT NULL, synonyms TEXT NOT NULL, fps REAL NOT NULL,
    n_frames INTEGER NOT NULL, signer TEXT NOT NULL, source TEXT NOT NULL, checked INTEGER NOT NULL,
    rest_before INTEGER, rest_after INTEGER, sha256 TEXT NOT NULL,
    skeleton INTEGER NOT NULL, start INTEGER NOT NULL, n_bytes INTEGER NOT NULL, has_translations INTEGER NOT NULL
)""",
    "CREATE TABLE name "
    "(folded TEXT PRIMARY KEY, shown TEXT NOT NULL, is_gloss INTEGER NOT NULL, word INTEGER NOT NULL)\nWITHOUT ROWID",
)
"""As SQLite keeps them: an index with other tables, or with views, is not read, since a view can run for ever."""
_SCHEMA = f"PRAGMA application_id = {APPLICATION_ID}; PRAGMA user_version = {VERSION}; {'; '.join(_TABLES)};"
_COLUMNS = (
    "gloss, kind, synonyms, fps, n_frames, signer, source, checked, rest_before, rest_after, sha256, "
    "skeleton, start, n_bytes, has_translations"
)
_STEPS_PER_BYTE = 20
"""Steps of SQLite's machine that a query may take for each byte of the file: a whole table takes less than one, pages
that lead to each other in circles take any number.
"""
_SHA256 = re.compile("[0-9a-f]{64}")
_MOST_FRAMES, _MOST_FPS = 2**40, 1e6
REBUILD = "build the lexicon again"


@dataclass(frozen=True)
class Head:
    """Properties of a whole lexicon.

    form: how rotations are stored.
    n_words: number of words, letters included.
    n_bytes: size of the frames file.
    sha256: hash of all entries and places of words, in the order in which they were added; up to version 0.4, of their
        hashes.
    """

    form: str
    n_words: int
    n_bytes: int
    sha256: str


@dataclass(frozen=True)
class ClipLocation:
    """Where a word's clip is stored.

    skeleton: number of its skeleton in the index.
    start: first byte in the frames file.
    n_bytes: number of bytes.
    has_translations: whether bone lengths change.
    """

    skeleton: int
    start: int
    n_bytes: int
    has_translations: bool


class IndexWriter:
    """An index under construction, in a new file."""

    def __init__(self, path: Path) -> None:
        self._file = sqlite3.connect(path)
        self._file.executescript("PRAGMA journal_mode = MEMORY;" + _SCHEMA)
        self._n_words = self._n_skeletons = 0

    def add_skeleton(self, description: str) -> int:
        """Add a skeleton, as ``describe`` gives it, and return its number."""
        self._n_skeletons += 1
        row = (self._n_skeletons, sha256(description), description)
        self._file.execute("INSERT INTO skeleton VALUES (?, ?, ?)", row)
        return self._n_skeletons

    def add_word(self, entry: Entry, location: ClipLocation) -> None:
        """Add a word with its gloss and synonyms."""
        self._n_words += 1
        row = list(astuple(entry))
        row[2] = json.dumps(entry.synonyms, ensure_ascii=False)
        marks = ", ".join("?" * (len(row) + 4))
        self._file.execute(
            f"INSERT INTO word ({_COLUMNS}, id) VALUES ({marks}, ?)", (*row, *astuple(location), self._n_words)
        )
        names = ((entry.gloss, True), *((synonym, False) for synonym in entry.synonyms))
        self._file.executemany(
            "INSERT INTO name VALUES (?, ?, ?, ?)",
            [(fold(name), name, is_gloss, self._n_words) for name, is_gloss in names],
        )

    def finish(self, head: Head) -> None:
        """Write the head and flush everything to disk."""
        self._file.execute("INSERT INTO lexicon VALUES (?, ?, ?, ?)", astuple(head))
        self._file.commit()

    def close(self) -> None:
        """Close the file; an unfinished index is lost."""
        self._file.close()


class Index:
    """An index open for reading, for any number of threads. Raises ``InputError`` where it is missing, not ours, of a
    newer version or damaged, when it is opened or when the damage is found.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._lock = threading.Lock()
        self._file: sqlite3.Connection | None = None
        try:
            self._file = sqlite3.connect(
                path.absolute().as_uri() + "?mode=ro&immutable=1", uri=True, check_same_thread=False
            )
            self._n_bytes = path.stat().st_size
            self._file.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, max(self._n_bytes, 1 << 20))
            self._file.set_progress_handler(self._step, 1000)
            application, version = self._numbers("application_id"), self._numbers("user_version")
            if application != APPLICATION_ID:
                raise InputError(f"{path}: is no index of a lexicon, expected one that signsplice wrote")
            if version != VERSION:
                raise InputError(f"{path}: version {version}, expected {VERSION}; {REBUILD}, or update signsplice")
            if {sql for (sql,) in self.ask("SELECT sql FROM sqlite_master")} != set(_TABLES):
                raise InputError(f"{path}: has other tables than those of a lexicon; {REBUILD}")
            self.head = Head(*self.ask("SELECT form, n_words, n_bytes, sha256 FROM lexicon")[0])
            _check_types(self.head)
            if self.head.n_words < 1:
                raise InputError(f"{path}: {self.head.n_words} words, expected at least one; {REBUILD}")
        except (IndexError, TypeError) as error:
            self.close()
            raise InputError(f"{path}: is damaged (no head); {REBUILD}") from error
        except (OSError, sqlite3.Error) as error:
            self.close()
            raise InputError(f"{path}: cannot be opened ({error}); {REBUILD}") from error
        except BaseException:
            self.close()
            raise

    def _step(self) -> bool:
        """Whether a query has gone on for too long; called every thousand steps."""
        self._steps_left -= 1000
        return self._steps_left < 0

    def _numbers(self, pragma: str) -> int:
        return int(self.ask(f"PRAGMA {pragma}")[0][0])

    def ask(self, query: str, *values: object) -> list[Any]:
        """All rows of a query."""
        with self._lock:
            if self._file is None:
                raise InputError(f"{self.path.parent}: the lexicon is closed")
            self._steps_left = max(self._n_bytes, 1 << 14) * _STEPS_PER_BYTE
            try:
                return self._file.execute(query, values).fetchall()
            except Exception as error:  # UnicodeDecodeError too, where damage is in what SQLite wants to say
                reason = " ".join(str(error).split())[:200]
                raise InputError(f"{self.path}: cannot be read ({reason}); {REBUILD}") from error

    def find(self, name: str) -> tuple[Entry, ClipLocation] | None:
        """The word with this gloss or synonym and its location, None where there is none."""
        # Lone surrogates, as in names of undecodable bytes, become "?", since SQLite does not accept them.
        folded = fold(name).encode("utf-8", "replace").decode()
        rows = self.ask(f"SELECT {_COLUMNS} FROM word WHERE id = (SELECT word FROM name WHERE folded = ?)", folded)
        if not rows:
            return None
        entry, location = self._word(rows[0])
        if folded not in map(fold, (entry.gloss, *entry.synonyms)):
            raise InputError(f"{self.path}: {name[:40]!r} leads to the word {entry.gloss[:40]!r}; {REBUILD}")
        return entry, location

    def words(self) -> Iterator[tuple[Entry, ClipLocation]]:
        """Every word and its location, sorted by gloss."""
        for row in self.ask(f"SELECT {_COLUMNS} FROM word ORDER BY gloss"):
            yield self._word(row)

    def names(self) -> list[tuple[str, str, bool]]:
        """(folded, shown, is a gloss) of every gloss and synonym: sorted, glosses first."""
        rows = self.ask("SELECT folded, shown, is_gloss FROM name ORDER BY is_gloss DESC, shown")
        return [(str(folded), str(shown), bool(is_gloss)) for folded, shown, is_gloss in rows]

    def check(self) -> None:
        """Raise ``InputError`` where an entry or a name is not as it was written. Of lexicons of versions up to 0.4,
        which have no hash of their entries: where a name is no entry's.
        """
        whole, motions, names = hashlib.sha256(), hashlib.sha256(), set()
        for row in self.ask(f"SELECT {_COLUMNS} FROM word ORDER BY id"):
            entry, location = self._word(row)
            whole.update(row_digest(entry, location))
            motions.update(bytes.fromhex(entry.sha256))
            names |= {(fold(name), name, name == entry.gloss) for name in (entry.gloss, *entry.synonyms)}
        if self.head.sha256 not in (whole.hexdigest(), motions.hexdigest()) or names != set(self.names()):
            raise InputError(f"{self.path}: its entries are not those that were written; {REBUILD}")

    def skeleton(self, number: int) -> tuple[Skeleton, str]:
        """A skeleton and the SHA-256 of its description."""
        rows = self.ask("SELECT described, sha256 FROM skeleton WHERE id = ?", number)
        try:
            description, digest = rows[0]
            if sha256(description) != digest:
                raise InputError("its SHA-256 is another")
            return skeletons.from_json(parse_json(description.encode(), "", "a skeleton")), digest
        except Exception as error:  # of whatever a crafted description makes of a skeleton
            reason = (str(error).splitlines() or [type(error).__name__])[0][:300]
            raise InputError(f"{self.path}: skeleton {number} is damaged ({reason}); {REBUILD}") from error

    def _word(self, row: tuple[Any, ...]) -> tuple[Entry, ClipLocation]:
        try:
            gloss, kind, synonyms, fps, n_frames, signer, source, checked, before, after, digest, *location = row
            if {checked, location[3]} - {0, 1}:
                raise ValueError("a mark is neither 0 nor 1")
            names = json.loads(synonyms)
            check_type(names, list[str], "synonyms")
            given = (gloss, kind, tuple(names), fps, n_frames, signer, source, bool(checked), before, after, digest)
            entry, at = Entry(*given), ClipLocation(location[0], location[1], location[2], bool(location[3]))
            _check_types(entry)
            _check_types(at)
            _check_entry(entry)
            if at.start < 0 or at.n_bytes < 0:
                raise ValueError("negative sizes")
        except (TypeError, ValueError, RecursionError) as error:
            reason = str(error).partition(";")[0][:200]
            raise InputError(f"{self.path}: word {str(row[0])[:40]!r} is damaged ({reason}); {REBUILD}") from error
        return entry, at

    def close(self) -> None:
        """Close the file."""
        with self._lock:
            if self._file is not None:
                self._file.close()
            self._file = None


def application_id(path: Path) -> int | None:
    """The application id in a SQLite file's header, None for other files and files that cannot be read."""
    try:
        with opened(path) as (file, _):
            head = file.read(72)
    except InputError:
        return None
    return int.from_bytes(head[68:72], "big") if head.startswith(b"SQLite format 3\0") and len(head) == 72 else None


def _check_types(stored: Head | Entry | ClipLocation) -> None:
    """Raise ``TypeError`` where a field has another type than its class says: SQLite keeps any in any column."""
    for name, kind in _KINDS[type(stored)].items():
        value = getattr(stored, name)
        if name != "synonyms" and (type(value) is not kind or kind is float):  # synonyms are checked as JSON
            check_type(value, kind, name)


_KINDS = {kind: get_type_hints(kind) for kind in (Head, Entry, ClipLocation)}


def _check_entry(entry: Entry) -> None:
    """Raise ``ValueError`` for an entry that no builder writes."""
    if not all(name and name.isprintable() for name in (entry.gloss, *entry.synonyms)) or entry.kind not in KINDS:
        raise ValueError("its gloss, a synonym or its kind is none")
    if not (1 <= entry.n_frames <= _MOST_FRAMES and 0.0 < entry.fps <= _MOST_FPS and entry.seconds < _MOST_FRAMES):
        raise ValueError(f"{entry.n_frames} frames, frame rate {entry.fps:g}")
    if not all(rest is None or 0 <= rest <= entry.n_frames for rest in (entry.rest_before, entry.rest_after)):
        raise ValueError("its frames of rest are not within it")
    if not _SHA256.fullmatch(entry.sha256):
        raise ValueError("its SHA-256 is none")


def describe(skeleton: Skeleton) -> str:
    """A skeleton as JSON; numbers are read back unchanged. Raises ``InputError`` for more joints than are read."""
    return json.dumps(skeletons.as_json(skeleton))


def row_digest(entry: Entry, location: ClipLocation) -> bytes:
    """The SHA-256 of a word's entry and place."""
    return hashlib.sha256(json.dumps([*astuple(entry), *astuple(location)]).encode()).digest()


def sha256(text: str | bytes) -> str:
    """The SHA-256 of text or bytes, in hex."""
    return hashlib.sha256(text.encode() if isinstance(text, str) else text).hexdigest()
