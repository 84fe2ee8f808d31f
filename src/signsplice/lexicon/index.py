"""The index of a lexicon: one SQLite file that is written once, with the lexicon, and never again.

Since nobody ever writes to it, it is opened as immutable: it takes no lock, leaves no file beside it, and may lie in a
place that cannot be written to.
"""

from __future__ import annotations

import hashlib
import json
import sqlite3
import threading
from collections.abc import Iterator
from dataclasses import astuple, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from signsplice.errors import InputError
from signsplice.lexicon.entry import Entry, fold
from signsplice.motion.clip import EndSite, Skeleton

INDEX = "index.sqlite"
VERSION = 1
APPLICATION_ID = 0x53_50_4C_58
"""Stands in the file's head, so that a lexicon's index is told from any other SQLite file."""

_SCHEMA = f"""
PRAGMA application_id = {APPLICATION_ID};
PRAGMA user_version = {VERSION};
CREATE TABLE lexicon (form TEXT NOT NULL, n_words INTEGER NOT NULL, n_bytes INTEGER NOT NULL, sha256 TEXT NOT NULL);
CREATE TABLE skeleton (id INTEGER PRIMARY KEY, sha256 TEXT NOT NULL, described TEXT NOT NULL);
CREATE TABLE word (
    id INTEGER PRIMARY KEY, gloss TEXT NOT NULL, kind TEXT NOT NULL, synonyms TEXT NOT NULL, fps REAL NOT NULL,
    n_frames INTEGER NOT NULL, signer TEXT NOT NULL, source TEXT NOT NULL, checked INTEGER NOT NULL,
    rest_before INTEGER, rest_after INTEGER, sha256 TEXT NOT NULL,
    skeleton INTEGER NOT NULL, start INTEGER NOT NULL, n_bytes INTEGER NOT NULL, has_translations INTEGER NOT NULL
);
CREATE TABLE name (folded TEXT PRIMARY KEY, shown TEXT NOT NULL, is_gloss INTEGER NOT NULL, word INTEGER NOT NULL)
WITHOUT ROWID;
"""
_COLUMNS = (
    "gloss, kind, synonyms, fps, n_frames, signer, source, checked, rest_before, rest_after, sha256, "
    "skeleton, start, n_bytes, has_translations"
)
_MEND = "build the lexicon again"


@dataclass(frozen=True)
class Head:
    """What an index tells of the whole: how rotations are stored, how many words, the size of the frames file and the
    SHA-256 of all words' SHA-256s.
    """

    form: str
    n_words: int
    n_bytes: int
    sha256: str


@dataclass(frozen=True)
class ClipLocation:
    """Where a word's frames lie: its skeleton's number, first byte, bytes, and whether bone lengths change."""

    skeleton: int
    start: int
    n_bytes: int
    has_translations: bool


class IndexWriter:
    """An index in the making, in a new file."""

    def __init__(self, path: Path) -> None:
        self._file = sqlite3.connect(path)
        self._file.executescript("PRAGMA journal_mode = MEMORY;" + _SCHEMA)
        self._n_words = self._n_skeletons = 0

    def add_skeleton(self, described: str) -> int:
        """The number of a skeleton, which is written as ``describe`` gives it."""
        self._n_skeletons += 1
        self._file.execute("INSERT INTO skeleton VALUES (?, ?, ?)", (self._n_skeletons, sha256(described), described))
        return self._n_skeletons

    def add_word(self, entry: Entry, place: ClipLocation) -> None:
        """Write a word with all its names."""
        self._n_words += 1
        row = list(astuple(entry))
        row[2] = json.dumps(entry.synonyms, ensure_ascii=False)
        marks = ", ".join("?" * (len(row) + 4))
        self._file.execute(
            f"INSERT INTO word ({_COLUMNS}, id) VALUES ({marks}, ?)", (*row, *astuple(place), self._n_words)
        )
        names = ((entry.gloss, True), *((synonym, False) for synonym in entry.synonyms))
        self._file.executemany(
            "INSERT INTO name VALUES (?, ?, ?, ?)",
            [(fold(name), name, is_gloss, self._n_words) for name, is_gloss in names],
        )

    def finish(self, head: Head) -> None:
        """Write the head, and all to the disk."""
        self._file.execute("INSERT INTO lexicon VALUES (?, ?, ?, ?)", astuple(head))
        self._file.commit()

    def close(self) -> None:
        """Let go of the file; what was not finished is lost."""
        self._file.close()


class Index:
    """An index that is there, for any number of threads. Raises ``InputError`` where it is missing, foreign, of a newer
    version or damaged, when opened or whenever that shows.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._lock = threading.Lock()
        self._file: sqlite3.Connection | None = None
        try:
            self._file = sqlite3.connect(
                path.absolute().as_uri() + "?mode=ro&immutable=1", uri=True, check_same_thread=False
            )
            application, version = self._numbers("application_id"), self._numbers("user_version")
            if application != APPLICATION_ID:
                raise InputError(f"{path}: is no index of a lexicon, expected one that signsplice wrote")
            if version != VERSION:
                raise InputError(f"{path}: version {version}, expected {VERSION}; {_MEND}, or update signsplice")
            self.head = Head(*self.ask("SELECT form, n_words, n_bytes, sha256 FROM lexicon")[0])
        except (IndexError, TypeError) as error:
            self.close()
            raise InputError(f"{path}: is damaged (no head); {_MEND}") from error
        except sqlite3.Error as error:
            self.close()
            raise InputError(f"{path}: cannot be opened ({error}); {_MEND}") from error
        except BaseException:
            self.close()
            raise

    def _numbers(self, pragma: str) -> int:
        return int(self.ask(f"PRAGMA {pragma}")[0][0])

    def ask(self, query: str, *values: object) -> list[Any]:
        """All rows that answer a query."""
        with self._lock:
            if self._file is None:
                raise InputError(f"{self.path.parent}: the lexicon is closed")
            try:
                return self._file.execute(query, values).fetchall()
            except sqlite3.Error as error:
                raise InputError(f"{self.path}: cannot be read ({error}); {_MEND}") from error

    def find(self, name: str) -> tuple[Entry, ClipLocation] | None:
        """The word that has a gloss or synonym, and where it lies."""
        rows = self.ask(
            f"SELECT {_COLUMNS} FROM word WHERE id = (SELECT word FROM name WHERE folded = ?)", _printable(fold(name))
        )
        return self._word(rows[0]) if rows else None

    def words(self) -> Iterator[tuple[Entry, ClipLocation]]:
        """Every word in the order of glosses."""
        for row in self.ask(f"SELECT {_COLUMNS} FROM word ORDER BY gloss"):
            yield self._word(row)

    def names(self) -> list[tuple[str, str, bool]]:
        """Every gloss and synonym: folded, as shown, whether it is a gloss; glosses in order first."""
        rows = self.ask("SELECT folded, shown, is_gloss FROM name ORDER BY is_gloss DESC, shown")
        return [(str(folded), str(shown), bool(is_gloss)) for folded, shown, is_gloss in rows]

    def skeleton(self, number: int) -> tuple[Skeleton, str]:
        """A skeleton and the SHA-256 of its description."""
        rows = self.ask("SELECT described, sha256 FROM skeleton WHERE id = ?", number)
        try:
            described, digest = rows[0]
            if sha256(described) != digest:
                raise InputError("its SHA-256 is another")
            return _skeleton(described), digest
        except (InputError, IndexError, KeyError, TypeError, ValueError, AttributeError) as error:
            raise InputError(f"{self.path}: skeleton {number} is damaged ({error}); {_MEND}") from error

    def _word(self, row: tuple[Any, ...]) -> tuple[Entry, ClipLocation]:
        try:
            gloss, kind, synonyms, fps, n_frames, signer, source, checked, before, after, digest, *place = row
            entry = Entry(
                gloss=gloss,
                kind=kind,
                synonyms=tuple(json.loads(synonyms)),
                fps=float(fps),
                n_frames=int(n_frames),
                signer=signer,
                source=source,
                checked=bool(checked),
                rest_before=before,
                rest_after=after,
                sha256=digest,
            )
            skeleton, start, n_bytes, has_translations = map(int, place)
            if entry.n_frames < 1 or start < 0 or n_bytes < 0:
                raise ValueError("negative sizes")
        except (TypeError, ValueError) as error:
            raise InputError(f"{self.path}: word {row[0]!r} is damaged ({error}); {_MEND}") from error
        return entry, ClipLocation(skeleton, start, n_bytes, bool(has_translations))

    def close(self) -> None:
        """Let go of the file."""
        with self._lock:
            if self._file is not None:
                self._file.close()
            self._file = None


def application_id(path: Path) -> int | None:
    """The application number in a SQLite file's head, None where it is no SQLite file or cannot be read."""
    try:
        with path.open("rb") as file:
            head = file.read(72)
    except OSError:
        return None
    return int.from_bytes(head[68:72], "big") if head.startswith(b"SQLite format 3\0") and len(head) == 72 else None


def describe(skeleton: Skeleton) -> str:
    """A skeleton as JSON; numbers read back equal."""
    return json.dumps(
        {
            "names": skeleton.names,
            "parents": skeleton.parents.tolist(),
            "offsets": skeleton.offsets.tolist(),
            "end_sites": [[site.joint, site.offset.tolist()] for site in skeleton.end_sites],
            "roles": None if skeleton.roles is None else dict(skeleton.roles),
        }
    )


def _skeleton(described: str) -> Skeleton:
    told = json.loads(described)
    return Skeleton(
        names=tuple(told["names"]),
        parents=np.array(told["parents"], np.intp),
        offsets=np.array(told["offsets"], np.float64).reshape(-1, 3),
        end_sites=tuple(EndSite(int(joint), np.array(offset)) for joint, offset in told["end_sites"]),
        roles=told["roles"],
    )


def sha256(text: str | bytes) -> str:
    """The SHA-256 of text or bytes, in hex."""
    return hashlib.sha256(text.encode() if isinstance(text, str) else text).hexdigest()


def _printable(text: str) -> str:
    """Text that SQLite takes: half a surrogate pair, as in names of undecodable bytes, finds nothing."""
    return text.encode("utf-8", "replace").decode()
