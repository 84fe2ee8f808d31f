"""Lexicons of written signs, alone or beside clips, and lexicons that fall back on them.

It stands here because it joins two rooms, ``lexicon`` and ``synth``, that do not know each other.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from signsplice.children import cores, in_order
from signsplice.errors import InputError
from signsplice.formats import READ_SUFFIXES
from signsplice.lexicon import folder as folders
from signsplice.lexicon.entry import Entry, fold, gloss_of
from signsplice.lexicon.folder import Built
from signsplice.lexicon.frames import encode, fingerprint
from signsplice.lexicon.glosses import GlossRow
from signsplice.lexicon.index import describe, sha256
from signsplice.lexicon.joined import JoinedLexicon
from signsplice.lexicon.preparing import PreparedWord, prepare, rest_frames
from signsplice.lexicon.reader import SHIPPED, Lexicon, shipped
from signsplice.motion.clip import Clip
from signsplice.progress import Progress
from signsplice.splicing.forms import WordsWithForms, lexicon_folder, open_lexicon
from signsplice.written import files, signing
from signsplice.written.files import SUFFIXES

if TYPE_CHECKING:
    from signsplice.signer.phonology import Sign
    from signsplice.written.tree import WrittenSign

_SIGNS_A_PROCESS = 40
"""A process takes as long to start as so many signs to sign."""


@dataclass(frozen=True)
class _Words:
    """Signs to be signed for a lexicon.

    signs: them
    refused: a line for each that was refused
    form: how rotations are stored
    lenient: what is not written of a posture is as usual
    jobs: number of processes, None for one a core
    progress: is called with how many are done and how many there are
    """

    signs: tuple[WrittenSign, ...]
    refused: tuple[str, ...]
    form: str
    lenient: bool
    jobs: int | None
    progress: Progress | None

    def __iter__(self) -> Iterator[tuple[PreparedWord | str, GlossRow]]:
        for line in self.refused:
            yield line, GlossRow("")
        workers = min(cores(), len(self.signs) // _SIGNS_A_PROCESS) if self.jobs is None else self.jobs
        words = in_order(partial(_prepared, form=self.form, lenient=self.lenient), self.signs, max(workers, 1))
        for n, (sign, word) in enumerate(zip(self.signs, words, strict=True), 1):
            yield word, GlossRow(sign.where.file, gloss_of(sign.gloss), source=Path(sign.where.file).name)
            if self.progress is not None:
                self.progress(n, len(self.signs))


def _prepared(sign: WrittenSign, form: str, lenient: bool) -> PreparedWord | str:
    """A word made ready for a lexicon, or a line that refuses it."""
    try:
        clip = signing.signed(sign, lenient=lenient)
        lines = (*signing.warnings(sign), *(f"{sign.where.file}: {sign.gloss}: {line}" for line in clip.notes))
        return replace(prepare(clip, form), warnings=lines)
    except InputError as error:
        return str(error)


def build(
    inputs: Sequence[str | Path],
    output: str | Path,
    *,
    lenient: bool = False,
    compact: bool = False,
    jobs: int | None = 1,
    progress: Progress | None = None,
    **others: object,
) -> Built:
    """A lexicon of folders of clips, and of files or folders of written signs, as ``lexicon.build`` makes it.

    A sign that is refused is left out, with a line; a gloss that is taken gets the next number, GLOSS#2. lenient: leave
    out what is not understood of a sign, with a warning. others: as in ``lexicon.build``. Raises ``InputError`` where
    there is nothing to build.
    """
    written = [path for path in inputs if is_written(path)]
    clips = [path for path in inputs if path not in written or _has_clips(Path(path))]
    words: _Words | tuple[()] = ()
    if written:
        read = files.read(written, lenient)
        form = "int16" if compact else "float32"
        words = _Words(tuple(read.signs.values()), tuple(map(str, read.refused)), form, lenient, jobs, progress)
    return folders.build(clips, output, compact=compact, jobs=jobs, progress=progress, more=words, **others)  # type: ignore[arg-type]


def is_written(path: str | Path) -> bool:
    """Whether a path is that of a file of written signs, or of a folder of SiGML."""
    path = Path(path)
    if path.is_dir():
        return any(path.rglob("*.sigml"))
    return path.suffix.lower() in SUFFIXES


def _has_clips(path: Path) -> bool:
    return path.is_dir() and any(file.suffix.lower() in READ_SUFFIXES for file in path.rglob("*"))


class WordsWithFallback(WordsWithForms):
    """A lexicon that also has written signs for the glosses that it lacks: in ``in``, ``entry`` and ``clip``, and in no
    list.

    fallback: file or folder of the signs
    """

    def __init__(self, path: str | Path, fallback: str | Path) -> None:
        super().__init__(path)
        self._fallback = fallback
        self._written = {fold(gloss_of(gloss)): sign for gloss, sign in files.read(fallback).signs.items()}

    def __reduce__(self) -> tuple[type[WordsWithFallback], tuple[Path, str | Path]]:  # type: ignore[override]
        return type(self), (self.path, self._fallback)

    def _find_form(self, gloss: str) -> Sign | WrittenSign | None:  # type: ignore[override]
        form = super()._find_form(gloss) if self.path.resolve() == SHIPPED.resolve() else None
        return form or self._written.get(fold(gloss))

    def _sign(self, form: Sign | WrittenSign) -> tuple[Entry, Clip]:
        if form not in self._written.values():
            return super()._sign(form)  # type: ignore[arg-type]
        clip = signing.signed(form)  # type: ignore[arg-type]
        found = fingerprint(encode(clip, "float32"), sha256(describe(clip.skeleton)), clip.fps, len(clip))
        before, after = rest_frames(clip)
        source = str(self._fallback)
        entry = Entry(gloss_of(form.gloss), "sign", (), clip.fps, len(clip), "", source, False, before, after, found)
        return entry, clip


def with_fallback(paths: Sequence[str | Path | None], fallback: str | Path) -> Lexicon:
    """The lexicons in folders as one, by default the one that ships, with written signs for the glosses that they lack.
    Raises ``InputError`` where there is none of either.
    """
    *first, last = [lexicon_folder(path) for path in paths or (None,)]
    if last.resolve() == SHIPPED.resolve():
        words: Lexicon = shipped(lambda path: WordsWithFallback(path, fallback))
    else:
        words = WordsWithFallback(last, fallback)
    return JoinedLexicon([*map(open_lexicon, first), words]) if first else words
