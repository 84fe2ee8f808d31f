"""Reads the folder of a lexicon: an index in SQLite, and the frames of all words, mapped into memory.

Both files are written once (``builder``) and never changed. SQLite opens the index as immutable: it takes no lock and
creates no other file, so the folder may be read-only.

Version 2 of the format has a table of extensions: named bytes that a later version of this package adds to a word. A
reader ignores unknown names, so no extension needs a new version. Version 1, without that table, is read too. Hashes
cover all extensions but cards, which follow from the frames and differ in their last digits between processors.
"""

from __future__ import annotations

import hashlib
import json
import math
import mmap
import re
import sqlite3
import threading
import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import astuple, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, get_args, get_type_hints

from signsplice.errors import InputError
from signsplice.formats import skeletons
from signsplice.formats.json_files import check_type, parse_json
from signsplice.formats.pose import unpack_points
from signsplice.formats.reading import open_file
from signsplice.lexicon.frames import FORMS, FRAMES, HEAD_BYTES, MAGIC, decode, fingerprint
from signsplice.lexicon.gloss import KINDS, Entry, fold
from signsplice.motion import Clip, Skeleton
from signsplice.motion.clip import StoredCard, stored_card
from signsplice.progress import Progress
from signsplice.rig.inspection import clip_warnings, role_warnings
from signsplice.rig.roles import CHANNELS

INDEX = "index.sqlite"
VERSION = 2
APPLICATION_ID = 0x53_50_4C_58
"""SQLite's application id in the file's header, which identifies a lexicon's index."""
OWNS = "owns"
"""The extension that holds the channels of a word's own, separated by ``;``."""
POINTS = "points"
"""The extension that holds the word's landmarks (``formats.pose.pack_points``)."""
LANGUAGE = "language"
"""The extension that holds the code of the word's signed language (``languages``)."""
CARD = "card"
"""The extension that holds what splices know of the word by itself (``splicing.cards``)."""

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
    "CREATE TABLE extension "
    "(word INTEGER NOT NULL, name TEXT NOT NULL, value BLOB NOT NULL, PRIMARY KEY (word, name))\nWITHOUT ROWID",
)
"""Tables as SQLite stores them, the last one since version 2. An index with other tables or views is rejected, since a
view can run for ever."""
SCHEMA = f"PRAGMA application_id = {APPLICATION_ID}; PRAGMA user_version = {VERSION}; {'; '.join(_TABLES)};"
COLUMNS = (
    "gloss, kind, synonyms, fps, n_frames, signer, source, checked, rest_before, rest_after, sha256, "
    "skeleton, start, n_bytes, has_translations"
)
_STEPS_PER_BYTE = 20
"""Steps of SQLite's virtual machine allowed for a query, per byte of the file: reading a whole table takes less than
one, circular pages would take endlessly many.
"""
_SHA256 = re.compile("[0-9a-f]{64}")
_MOST_FRAMES = 2**40
"""Maximum number of frames of a word, and maximum length, seconds."""
_MOST_FPS = 1e6
"""Maximum frame rate of a word, Hz."""
REBUILD = "build the lexicon again"
BUILD_HINT = "build one from a folder of clips by `signsplice lexicon build`"


@dataclass(frozen=True)
class Head:
    """Properties of a whole lexicon.

    form: how rotations are stored.
    n_words: number of words, letters included.
    n_bytes: size of the frames file.
    sha256: hash of all entries, locations and extensions of words, in the order of addition; in a lexicon written by
        signsplice 0.4 or older, of their motions' hashes.
    """

    form: str
    n_words: int
    n_bytes: int
    sha256: str


@dataclass(frozen=True)
class ClipLocation:
    """The location of a word's stored clip.

    skeleton: number of its skeleton in the index.
    start: first byte in the frames file.
    n_bytes: number of bytes.
    has_translations: whether bone lengths change.
    """

    skeleton: int
    start: int
    n_bytes: int
    has_translations: bool


@dataclass(frozen=True)
class SourceWord:
    """A word of a source of a lexicon.

    gloss: its gloss.
    entry, clip, extensions: functions that return its entry, its clip, and its named bytes.
    language: code of its signed language, where no extension names it; empty if unknown.
    """

    gloss: str
    entry: Callable[[], Entry]
    clip: Callable[[], Clip]
    extensions: Callable[[], dict[str, bytes]] = dict
    language: str = ""

    def signed_language(self) -> str:
        """Return the code of its signed language; empty if unknown."""
        return language_text(self.extensions().get(LANGUAGE, b"")) or self.language


class Index:
    """An index open for reading; thread-safe. Raises ``InputError`` if it is missing, foreign, of a newer version or
    damaged, on opening or when the damage is found.
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
            application, version = self._pragma("application_id"), self._pragma("user_version")
            if application != APPLICATION_ID:
                raise InputError(f"{path}: is no index of a lexicon, expected one that signsplice wrote")
            if not 1 <= version <= VERSION:
                raise InputError(f"{path}: version {version}, expected 1 or {VERSION}; {REBUILD}, or update signsplice")
            self._has_extensions = version > 1
            tables = _TABLES if self._has_extensions else _TABLES[:-1]
            if {sql for (sql,) in self.ask("SELECT sql FROM sqlite_master")} != set(tables):
                raise InputError(f"{path}: has other tables than those of a lexicon; {REBUILD}")
            self.head = Head(*self.ask("SELECT form, n_words, n_bytes, sha256 FROM lexicon")[0])
            _check_types(self.head)
            if self.head.n_words < 1:
                raise InputError(f"{path}: {self.head.n_words} words, expected at least one; {REBUILD}")
        except BaseException as error:
            self.close()
            if isinstance(error, IndexError | TypeError):
                raise InputError(f"{path}: is damaged (no head); {REBUILD}") from error
            if isinstance(error, OSError | sqlite3.Error):
                raise InputError(f"{path}: cannot be opened ({error}); {REBUILD}") from error
            raise

    def _step(self) -> bool:
        """Return whether a query takes too long; called every thousand steps."""
        self._steps_left -= 1000
        return self._steps_left < 0

    def _pragma(self, name: str) -> int:
        return int(self.ask(f"PRAGMA {name}")[0][0])

    def ask(self, query: str, *values: object) -> list[Any]:
        """Return all rows of a query."""
        with self._lock:
            if self._file is None:
                raise InputError(f"{self.path.parent}: the lexicon is closed")
            self._steps_left = max(self._n_bytes, 1 << 14) * _STEPS_PER_BYTE
            try:
                return self._file.execute(query, values).fetchall()
            except Exception as error:  # also UnicodeDecodeError, if SQLite's message contains damaged text
                reason = " ".join(str(error).split())[:200]
                raise InputError(f"{self.path}: cannot be read ({reason}); {REBUILD}") from error

    def find(self, name: str) -> tuple[Entry, ClipLocation] | None:
        """Return the word with this gloss or synonym and its location, or None."""
        # SQLite does not accept lone surrogates, as in names of undecodable bytes; they become "?".
        folded = fold(name).encode("utf-8", "replace").decode()
        rows = self.ask(f"SELECT {COLUMNS} FROM word WHERE id = (SELECT word FROM name WHERE folded = ?)", folded)
        if not rows:
            return None
        entry, location = self._word(rows[0])
        if folded not in map(fold, (entry.gloss, *entry.synonyms)):
            raise InputError(f"{self.path}: {name[:40]!r} leads to the word {entry.gloss[:40]!r}; {REBUILD}")
        return entry, location

    def words(self) -> Iterator[tuple[Entry, ClipLocation]]:
        """Yield every word and its location, sorted by gloss."""
        for row in self.ask(f"SELECT {COLUMNS} FROM word ORDER BY gloss"):
            yield self._word(row)

    def names(self) -> list[tuple[str, str, bool]]:
        """Return (folded, shown, is a gloss) of every gloss and synonym: sorted, glosses first (``gloss.fold``)."""
        rows = self.ask("SELECT folded, shown, is_gloss FROM name ORDER BY is_gloss DESC, shown")
        return [(str(folded), str(shown), bool(is_gloss)) for folded, shown, is_gloss in rows]

    def language(self) -> str:
        """Return the signed language of the first word; empty if it names none."""
        query = "SELECT value FROM extension WHERE word = 1 AND name = ?"
        rows = self.ask(query, LANGUAGE) if self._has_extensions else []
        return language_text(rows[0][0]) if rows else ""

    def extensions(self, gloss: str) -> dict[str, bytes]:
        """Return the named bytes of a word's extensions."""
        query = "SELECT name, value FROM extension WHERE word = (SELECT word FROM name WHERE folded = ?) ORDER BY name"
        rows = dict(self.ask(query, fold(gloss))) if self._has_extensions else {}
        if not all(type(name) is str and type(value) is bytes for name, value in rows.items()):
            raise InputError(f"{self.path}: an extension of the word {gloss[:40]!r} is damaged; {REBUILD}")
        return rows

    def check(self) -> None:
        """Raise ``InputError`` if an entry or a name has changed since it was written. Lexicons of signsplice 0.4 and
        older have no hash of their entries; for them, raise it if a motion's hash or a name is another.
        """
        digest, motions, names = hashlib.sha256(), hashlib.sha256(), set()
        for row in self.ask(f"SELECT {COLUMNS} FROM word ORDER BY id"):
            entry, location = self._word(row)
            digest.update(row_digest(entry, location, self.extensions(entry.gloss)))
            motions.update(bytes.fromhex(entry.sha256))
            names |= {(fold(name), name, name == entry.gloss) for name in (entry.gloss, *entry.synonyms)}
        if self.head.sha256 not in (digest.hexdigest(), motions.hexdigest()) or names != set(self.names()):
            raise InputError(f"{self.path}: its entries are not those that were written; {REBUILD}")

    def skeleton(self, number: int) -> tuple[Skeleton, str]:
        """Return a skeleton and the SHA-256 of its description."""
        rows = self.ask("SELECT described, sha256 FROM skeleton WHERE id = ?", number)
        try:
            description, digest = rows[0]
            if sha256(description) != digest:
                raise InputError("its SHA-256 is another")
            return skeletons.from_json(parse_json(description.encode(), "", "a skeleton")), digest
        except Exception as error:  # any error that a crafted description causes
            reason = (str(error).splitlines() or [type(error).__name__])[0][:300]
            raise InputError(f"{self.path}: skeleton {number} is damaged ({reason}); {REBUILD}") from error

    def _word(self, row: tuple[Any, ...]) -> tuple[Entry, ClipLocation]:
        try:
            gloss, kind, synonyms, fps, n_frames, signer, source, checked, before, after, digest, *location = row
            if {checked, location[3]} - {0, 1}:
                raise ValueError("a mark is neither 0 nor 1")
            names = json.loads(synonyms)
            check_type(names, list[str], "synonyms")
            facts = (tuple(names), fps, n_frames, signer, source, bool(checked), before, after, digest)
            entry = Entry(gloss, kind, *facts)
            clip_location = ClipLocation(location[0], location[1], location[2], bool(location[3]))
            _check_types(entry)
            _check_types(clip_location)
            _check_entry(entry)
            if clip_location.start < 0 or clip_location.n_bytes < 0:
                raise ValueError("negative sizes")
        except (TypeError, ValueError, RecursionError) as error:
            reason = str(error).partition(";")[0][:200]
            raise InputError(f"{self.path}: word {str(row[0])[:40]!r} is damaged ({reason}); {REBUILD}") from error
        return entry, clip_location

    def close(self) -> None:
        """Close the file."""
        with self._lock:
            if self._file is not None:
                self._file.close()
            self._file = None


class StoredWords:
    """The words of a lexicon's folder; thread-safe. Clips remain valid after it is closed. Raises ``InputError`` if the
    folder holds no valid lexicon of this version or an earlier one.

    path, where: the folder, and its name in messages.
    form: how rotations are stored: "float32" or "int16".
    n_bytes: size of the frames file.
    language: signed language of its first word, or the given one, that of words which name none.
    """

    def __init__(self, path: str | Path, where: str = "", language: str = "") -> None:
        self.path, self.where, self._default_language = Path(path), where or str(path), language
        self._lock = threading.Lock()
        self._skeletons: dict[int, tuple[Skeleton, str]] = {}
        self._frames: mmap.mmap | None
        while True:
            place = _place(self.path)
            try:
                self._index, self._frames = _files(self.path)
                break
            except InputError:
                if _place(self.path) == place:
                    raise  # otherwise another lexicon has replaced it between opening the two files
        self.form, self.n_bytes = self._index.head.form, self._index.head.n_bytes
        self.language = self._index.language() or language

    def __reduce__(self) -> tuple[type[StoredWords], tuple[Path, str, str]]:
        return type(self), (self.path, self.where, self._default_language)

    def close(self) -> None:
        """Close both files."""
        frames, self._frames = self._frames, None
        self._index.close()
        if frames is not None:
            with suppress(BufferError):  # another thread is reading a word; the file closes when it is done
                frames.close()

    def find(self, name: str) -> SourceWord | None:
        """Return the word with this gloss or synonym, or None."""
        row = self._index.find(name)
        if row is None:
            return None
        entry, location = row
        extensions, clip = partial(self._index.extensions, entry.gloss), partial(self._clip, entry, location)
        return SourceWord(entry.gloss, lambda: entry, clip, extensions, self._default_language)

    def lists(self, name: str) -> bool:
        """Return whether ``name`` is a gloss or synonym of a word."""
        return self._index.find(name) is not None

    def names(self) -> list[tuple[str, str, bool]]:
        """Return (folded, shown, is a gloss) of every gloss and synonym: sorted, glosses first (``gloss.fold``)."""
        return self._index.names()

    def entries(self) -> Iterator[Entry]:
        """Return the entries of all words, sorted by gloss."""
        return (entry for entry, _ in self._index.words())

    def faults(self, progress: Progress | None = None) -> Iterator[str]:
        """Yield faults of the words, one line each: checks bytes, hashes and names against the index. Reads all."""
        n_words = 0
        for entry, location in self._words(progress):
            n_words += 1
            try:
                card = self._clip(entry, location).derived[stored_card]
                if card is not None and card.content and not _is_whole(card.content):
                    yield f"{self.path}: word {entry.gloss[:40]!r}: its card is damaged, and computed anew; {REBUILD}"
                for name in (entry.gloss, *entry.synonyms):
                    match = self._index.find(name)
                    if match is None or match[0].gloss != entry.gloss:
                        yield f"{self.path}: word {entry.gloss[:40]!r}: is not found by {name[:40]!r}"
            except InputError as error:
                yield str(error)
        if n_words != self._index.head.n_words:
            yield f"{self.path}: {n_words} words, expected {self._index.head.n_words}"
        try:
            self._index.check()
        except InputError as error:
            yield str(error)

    def verify(self) -> None:
        """Compare every entry, and the bytes of every word, with their SHA-256. Raises ``InputError`` at the first
        mismatch.

        Faster than ``faults``, which also decodes the words: about one second per GB.
        """
        for entry, location in self._words(None):
            self._verify(entry, location)
        self._index.check()

    def warnings(self, progress: Progress | None = None) -> Iterator[str]:
        """Yield warnings about readable words, and about their rigs together, one line each."""
        skeletons: dict[str, Skeleton] = {}
        for entry, location in self._words(progress):
            with suppress(InputError):  # ``faults`` reports it
                clip = self._clip(entry, location)
                for line in clip_warnings(clip):
                    yield f"{self.path}: word {entry.gloss[:40]!r}: {line}"
                skeletons[entry.gloss] = clip.skeleton
        yield from (f"{self.path}: {line}" for line in role_warnings(skeletons))

    def _words(self, progress: Progress | None) -> Iterator[tuple[Entry, ClipLocation]]:
        """Yield every word and its location; calls ``progress`` with the number of finished words and the total."""
        for done, word in enumerate(self._index.words(), start=1):
            yield word
            if progress is not None:
                progress(done, self._index.head.n_words)

    def _clip(self, entry: Entry, location: ClipLocation) -> Clip:
        block = self._block(location)
        try:
            skeleton, _ = self._skeleton(location.skeleton)
            clip = decode(block, self.form, location.has_translations, skeleton, entry)
            extensions = self._index.extensions(entry.gloss)
            if POINTS in extensions:
                clip = replace(clip, points=unpack_points(extensions[POINTS], entry.n_frames))
        except Exception as error:  # any error that damaged bytes cause
            reason = (str(error).splitlines() or [type(error).__name__])[0][:300]
            raise InputError(f"{self.path}: word {entry.gloss[:40]!r} is damaged ({reason}); {REBUILD}") from error
        self._verify(entry, location)
        clip.derived[stored_card] = StoredCard(entry.sha256, extensions.get(CARD, b""))
        return clip

    def _verify(self, entry: Entry, location: ClipLocation) -> None:
        """Raise ``InputError`` if a word's bytes differ from the written ones: few bit flips make them unreadable."""
        digest = fingerprint(self._block(location), self._skeleton(location.skeleton)[1], entry.fps, entry.n_frames)
        if digest != entry.sha256:
            raise InputError(
                f"{self.path}: word {entry.gloss[:40]!r}: its SHA-256 is another than when it was written; {REBUILD}"
            )

    def _block(self, location: ClipLocation) -> memoryview:
        frames = self._frames  # read once, since another thread may close it
        if frames is None or frames.closed:
            raise InputError(f"{self.path}: the lexicon is closed")
        return memoryview(frames)[location.start : location.start + location.n_bytes]

    def _skeleton(self, number: int) -> tuple[Skeleton, str]:
        with self._lock:
            if number not in self._skeletons:
                self._skeletons[number] = self._index.skeleton(number)
            return self._skeletons[number]


def _files(path: Path) -> tuple[Index, mmap.mmap]:
    """Open the two files of a lexicon. Raises ``InputError`` if they are invalid or do not belong together."""
    _check_path(path)
    index = Index(path / INDEX)
    try:
        if index.head.form not in FORMS:
            raise InputError(f"{index.path}: form {index.head.form[:40]!r}, expected one of {', '.join(FORMS)}")
        return index, _mmap_frames(path / FRAMES, index.head)
    except BaseException:
        index.close()
        raise


def _mmap_frames(path: Path, head: Head) -> mmap.mmap:
    """Map the frames that belong to an index into memory."""
    try:
        with open_file(path) as (file, size):
            if size != head.n_bytes or size < HEAD_BYTES:
                raise InputError(f"{path}: {size} bytes, expected {head.n_bytes}; {REBUILD}")
            frames = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from error
    if frames[:HEAD_BYTES].hex() != MAGIC.hex() + str(head.sha256):
        frames.close()
        raise InputError(f"{path}: belongs to another index than the one beside it; {REBUILD}")
    return frames


def _place(path: Path) -> tuple[int, int, int] | None:
    """Return an identity that distinguishes a folder from its replacement; None if there is no folder."""
    try:
        status = path.stat()
    except (OSError, ValueError):  # a zero byte in the name
        return None
    return status.st_dev, status.st_ino, status.st_ctime_ns


def _check_path(path: Path) -> None:
    """Raise ``InputError`` if a path is clearly not a lexicon."""
    try:
        if not path.exists():
            raise InputError(f"{path}: no such folder, expected a lexicon; {BUILD_HINT}")
        if not path.is_dir():
            raise InputError(f"{path}: is a file, expected a lexicon's folder")
        for name in (INDEX, FRAMES):
            if not (path / name).is_file():
                raise InputError(f"{path}: is no lexicon, it has no {name}; {BUILD_HINT}")
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from error


def application_id(path: Path) -> int | None:
    """Return the application id in a SQLite file's header; None for other or unreadable files."""
    try:
        with open_file(path) as (file, _):
            head = file.read(72)
    except InputError:
        return None
    return int.from_bytes(head[68:72], "big") if head.startswith(b"SQLite format 3\0") and len(head) == 72 else None


def _check_types(stored: Head | Entry | ClipLocation) -> None:
    """Raise ``TypeError`` if a field has a different type than declared: SQLite stores any type in any column."""
    for name, kind in _FIELD_TYPES[type(stored)].items():
        value = getattr(stored, name)
        is_plain = type(value) is kind or type(value) in get_args(kind)
        if name != "synonyms" and not (is_plain and (kind is not float or math.isfinite(value))):
            check_type(value, kind, name)  # synonyms are checked as JSON


_FIELD_TYPES = {kind: get_type_hints(kind) for kind in (Head, Entry, ClipLocation)}


def _check_entry(entry: Entry) -> None:
    """Raise ``ValueError`` for an entry that no builder writes."""
    if not all(name and name.isprintable() for name in (entry.gloss, *entry.synonyms)) or entry.kind not in KINDS:
        raise ValueError("its gloss, a synonym or its kind is not valid")
    if not (1 <= entry.n_frames <= _MOST_FRAMES and 0.0 < entry.fps <= _MOST_FPS and entry.seconds < _MOST_FRAMES):
        raise ValueError(f"{entry.n_frames} frames, frame rate {entry.fps:g}")
    if not all(rest is None or 0 <= rest <= entry.n_frames for rest in (entry.rest_before, entry.rest_after)):
        raise ValueError("its frames of rest are not within it")
    if not _SHA256.fullmatch(entry.sha256):
        raise ValueError("its SHA-256 is not valid")


def describe(skeleton: Skeleton) -> str:
    """Return a skeleton as JSON; numbers are read back unchanged. Raises ``InputError`` if it has too many joints."""
    return json.dumps(skeletons.as_json(skeleton))


def _is_whole(card: bytes) -> bool:
    """Return whether a card can be unpacked."""
    try:
        zlib.decompress(card)
    except zlib.error:
        return False
    return True


def owns_extension(owns: frozenset[str] | None, language: str = "") -> dict[str, bytes]:
    """Return the extensions of a word whose own channels are ``owns``, some of ``CHANNELS``, none if a rule decides;
    and of its signed ``language``, if that is known.
    """
    named = {LANGUAGE: language.encode()} if language else {}
    return named if owns is None else {OWNS: ";".join(sorted(owns, key=CHANNELS.index)).encode(), **named}


def language_text(value: bytes) -> str:
    """Return the code of a signed language in an extension; empty for bytes that hold none."""
    code = str(value, "ascii", "replace") if isinstance(value, bytes) else ""
    return code if re.fullmatch("[a-z]{3}", code) else ""


def row_digest(entry: Entry, location: ClipLocation, extensions: Mapping[str, bytes]) -> bytes:
    """Return the SHA-256 of a word's entry, location and extensions, without its card, which follows from them."""
    row = [*astuple(entry), *astuple(location)]
    hashes = {name: sha256(extensions[name]) for name in sorted(extensions) if name != CARD}
    if hashes:
        row.append(hashes)
    return hashlib.sha256(json.dumps(row).encode()).digest()


def sha256(text: str | bytes) -> str:
    """Return the SHA-256 of text or bytes, in hex."""
    return hashlib.sha256(text.encode() if isinstance(text, str) else text).hexdigest()
