"""Lexicons of spoken-to-signed as they are: a folder of landmarks with a table ``index.csv``."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path

from signsplice.formats import load
from signsplice.lexicon.builder import prepare
from signsplice.lexicon.folder import trim_clip
from signsplice.lexicon.gloss import Entry, fold, kind_of
from signsplice.lexicon.lexicon import Source
from signsplice.lexicon.recordings import INDEX, GlossRow, read_index
from signsplice.lexicon.store import SourceWord, owns_extension
from signsplice.motion import Clip, copy_unchecked

_N_KEPT = 64
"""Words kept in memory: fitting a pose to one takes some milliseconds."""


class IndexedWords(Source):
    """The words of such a folder, each read from its file when it is asked for; thread-safe.

    path, where, form, n_bytes, language: as in ``Source``.

    Raises ``InputError`` as ``recordings.read_index`` does.
    """

    form, n_bytes = "", 0

    def __init__(self, path: Path, language: str = "") -> None:
        self.path, self.where, self._asked = path, str(path), language
        rows = read_index(path / INDEX, language)
        self.language = rows[0].language
        self._rows = {fold(name): row for row in rows for name in (row.gloss, *row.synonyms)}
        self._clip, self._entry = lru_cache(_N_KEPT)(self._read_clip), lru_cache(None)(self._read_entry)

    def __reduce__(self) -> tuple[type[IndexedWords], tuple[Path, str]]:
        return type(self), (self.path, self._asked)

    def find(self, name: str) -> SourceWord | None:
        """Return the word with this gloss or synonym, or None."""
        row = self._rows.get(fold(name))
        if row is None:
            return None
        owns = owns_extension(None, row.language)
        return SourceWord(row.gloss, lambda: self._entry(row), lambda: self._clip(row), lambda: owns, row.language)

    def lists(self, name: str) -> bool:
        """Return whether ``name`` is a gloss or synonym of a word."""
        return fold(name) in self._rows

    def names(self) -> list[tuple[str, str, bool]]:
        """Return (folded, shown, is a gloss) for every gloss and synonym."""
        rows = dict.fromkeys(self._rows.values())
        return [(fold(name), name, name == row.gloss) for row in rows for name in (row.gloss, *row.synonyms)]

    def entries(self) -> Iterator[Entry]:
        """Return the entries of all words, sorted by gloss. Reads every file."""
        return (self._entry(row) for row in sorted(dict.fromkeys(self._rows.values()), key=lambda row: row.gloss))

    def _read_clip(self, row: GlossRow) -> Clip:
        return copy_unchecked(trim_clip(load(self.path / row.file), row.span), name=row.gloss)

    def _read_entry(self, row: GlossRow) -> Entry:
        return prepare(self._clip(row), "float32").entry(row.gloss, kind_of(row.gloss), row.synonyms, "", row.file)
