"""Lexicons written word by word, whole or not at all: in a hidden temporary folder that takes its place at the end."""

from __future__ import annotations

import hashlib
import re
import sqlite3
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from signsplice.errors import InputError
from signsplice.formats.atomic import check_nothing_else, check_place, replacing_folder
from signsplice.lexicon import index
from signsplice.lexicon.entry import Entry, fold, gloss_of, kind_of
from signsplice.lexicon.frames import FRAMES, HEAD_BYTES, MAGIC, fingerprint
from signsplice.lexicon.preparing import PreparedWord, SharedSkeletons, prepare
from signsplice.motion import Clip


class Builder:
    """A lexicon under construction, made by ``building``. Memory does not grow with the frames added.

    form: how rotations are stored, one of ``FORMS``.
    n_words: number of words added so far.
    """

    def __init__(self, folder: Path, form: str) -> None:
        self.form = form
        self.n_words = 0
        self._frames = (folder / FRAMES).open("wb")
        try:
            self._frames.write(bytes(HEAD_BYTES))
            self._index = index.IndexWriter(folder / index.INDEX)
        except BaseException:
            self._frames.close()
            raise
        self._n_bytes = HEAD_BYTES
        self._names: dict[str, str] = {}  # folded gloss or synonym -> gloss
        self._shared = SharedSkeletons()
        self._written: dict[str, tuple[int, str]] = {}  # description of a skeleton -> number and SHA-256 in the index
        self._digest = hashlib.sha256()

    @property
    def n_bytes(self) -> int:
        """Size of the frames file so far."""
        return self._n_bytes

    def add(
        self,
        clip: Clip,
        gloss: str = "",
        *,
        kind: str = "",
        synonyms: Iterable[str] = (),
        signer: str = "",
        source: str = "",
        checked: bool = False,
    ) -> Entry:
        """Add a clip and return its entry. Defaults: gloss from the clip's name, kind from the gloss.

        Raises ``InputError`` where a gloss or synonym is taken or invalid; more words can be added after that.
        """
        word = prepare(self._shared.of(clip), self.form)
        return self.add_prepared(
            word, gloss, kind=kind, synonyms=synonyms, signer=signer, source=source, checked=checked
        )

    def add_prepared(
        self,
        word: PreparedWord,
        gloss: str = "",
        *,
        kind: str = "",
        synonyms: Iterable[str] = (),
        signer: str = "",
        source: str = "",
        checked: bool = False,
    ) -> Entry:
        """Add a clip that was made ready in the lexicon's form, as ``add`` does."""
        gloss = gloss_of(gloss or word.name)
        kind = kind_of(gloss, kind)
        other_names = tuple(dict.fromkeys(name for name in map(gloss_of, synonyms) if fold(name) != fold(gloss)))
        for name in (gloss, *other_names):
            if fold(name) in self._names:
                raise InputError(f"gloss {name!r} stands twice: for {gloss} and for {self._names[fold(name)]}")
        number, skeleton_sha256 = self._skeleton(word.skeleton)
        entry = Entry(
            gloss=gloss,
            kind=kind,
            synonyms=other_names,
            fps=word.fps,
            n_frames=word.n_frames,
            signer=signer,
            source=source,
            checked=checked,
            rest_before=word.rest_before,
            rest_after=word.rest_after,
            sha256=fingerprint(word.block, skeleton_sha256, word.fps, word.n_frames),
        )
        self._frames.write(word.block)
        location = index.ClipLocation(number, self._n_bytes, len(word.block), word.has_translations)
        self._index.add_word(entry, location)
        self._names |= {fold(name): gloss for name in (gloss, *other_names)}
        self._digest.update(index.row_digest(entry, location))
        self._n_bytes += len(word.block)
        self.n_words += 1
        return entry

    def free(self, gloss: str) -> str:
        """The gloss, or the first of GLOSS#2, GLOSS#3 and so on that no word has."""
        base, number = re.sub(r"#\d+$", "", gloss), 1
        while fold(gloss) in self._names:
            number += 1
            gloss = f"{base}#{number}"
        return gloss

    def _skeleton(self, description: str) -> tuple[int, str]:
        """Number and SHA-256 of a skeleton; a new one is written to the index."""
        if description not in self._written:
            self._written[description] = (self._index.add_skeleton(description), index.sha256(description))
        return self._written[description]

    def finish(self) -> None:
        """Write both heads."""
        if not self.n_words:
            raise InputError("no word was added, expected at least one")
        self._frames.seek(0)
        self._frames.write(MAGIC + self._digest.digest())
        self._frames.flush()
        self._index.finish(index.Head(self.form, self.n_words, self._n_bytes, self._digest.hexdigest()))

    def close(self) -> None:
        """Close both files."""
        try:
            self._index.close()
        finally:
            self._frames.close()


@contextmanager
def building(path: str | Path, *, compact: bool = False) -> Iterator[Builder]:
    """A builder whose lexicon is at ``path`` when the block succeeds; when it fails, nothing has changed there.

    An existing lexicon is replaced. compact: int16 rotations, half the size. Raises ``InputError`` where something else
    is at ``path``, or it cannot be written, e.g. because the disk is full.
    """
    check_target(path)
    with replacing_folder(path) as temporary:
        try:
            builder = Builder(temporary, "int16" if compact else "float32")
            try:
                yield builder
                builder.finish()
            finally:
                builder.close()
        except sqlite3.Error as error:
            raise OSError(str(error)) from error


def check_target(path: str | Path) -> None:
    """Raise ``InputError`` where no lexicon can be written to ``path``, as ``check_place`` does, or where something
    that is not a lexicon would be lost.
    """
    check_place(path)
    target = Path(path).resolve()
    if not target.exists():
        return
    if not target.is_dir() or index.application_id(target / index.INDEX) != index.APPLICATION_ID:
        raise InputError(f"{path}: is there already and is no lexicon, expected a new name or a lexicon to replace")
    check_nothing_else(Path(path), (index.INDEX, FRAMES), "lexicon")
