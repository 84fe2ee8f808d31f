"""Writes lexicons word by word and atomically: a hidden temporary folder replaces the target at the end."""

from __future__ import annotations

import hashlib
import json
import re
import sqlite3
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import astuple, dataclass, replace
from pathlib import Path
from typing import BinaryIO

from signsplice.errors import InputError
from signsplice.formats.atomic import check_nothing_else, check_place, replacing_folder
from signsplice.formats.pose import pack_points
from signsplice.lexicon import store
from signsplice.lexicon.frames import FRAMES, HEAD_BYTES, MAGIC, decode, encode, fingerprint
from signsplice.lexicon.gloss import Entry, fold, gloss_of, kind_of
from signsplice.motion import Clip, Skeleton, copy_unchecked
from signsplice.rig.info import active_span, arms, rig_info
from signsplice.rig.inspection import clip_warnings, motion_span
from signsplice.rig.rest_pose import with_rest_pose


@dataclass(frozen=True)
class PreparedWord:
    """A clip as a lexicon stores it.

    name, fps, n_frames, has_translations: of the clip.
    skeleton: its description in the index.
    rest_before, rest_after: as in ``Entry``.
    block: its encoded frames.
    warnings: warnings about the clip.
    card: what splices know of it by itself; empty if unknown.
    points: its landmarks (``formats.pose.pack_points``); empty without any.
    """

    name: str
    fps: float
    n_frames: int
    has_translations: bool
    skeleton: str
    rest_before: int | None
    rest_after: int | None
    block: bytes
    warnings: tuple[str, ...] = ()
    card: bytes = b""
    points: bytes = b""

    def entry(
        self, gloss: str, kind: str, synonyms: tuple[str, ...], signer: str, source: str, checked: bool = False
    ) -> Entry:
        """Return the word's entry under a gloss."""
        digest = fingerprint(self.block, store.sha256(self.skeleton), self.fps, self.n_frames)
        rests = self.rest_before, self.rest_after
        return Entry(gloss, kind, synonyms, self.fps, self.n_frames, signer, source, checked, *rests, digest)


MakeCard = Callable[[Clip, str], bytes]
"""Makes the card of a clip whose stored frames have a SHA-256."""


def prepare(clip: Clip, form: str, warns: bool = False, make_card: MakeCard | None = None) -> PreparedWord:
    """Prepare a clip, with a card if there is a function that makes it. Raises ``InputError`` if it has too many joints
    or a position exceeds float32.
    """
    lines: tuple[str, ...] = ()
    if warns:
        with suppress(InputError):  # ``splice`` reports roles that do not fit
            lines = clip_warnings(clip)
    described, has_translations = store.describe(clip.skeleton), clip.translations is not None
    rests = _rest_frames(clip)
    block = encode(clip, form)
    word = PreparedWord(clip.name, clip.fps, len(clip), has_translations, described, *rests, block, lines)
    if clip.points is not None:
        word = replace(word, points=pack_points(clip.points))
    if make_card is None or not rig_info(clip.skeleton).has_arms:
        return word
    entry = word.entry(clip.name, "sign", (), "", "")
    stored = decode(memoryview(block), form, has_translations, clip.skeleton, entry)
    stored = stored if clip.points is None else replace(stored, points=clip.points)
    return replace(word, card=make_card(stored, entry.sha256))


def _rest_frames(clip: Clip) -> tuple[int | None, int | None]:
    """Return the numbers of frames before and after the sign, which are rest or dropped by splices; None if the rig's
    arms are unknown.
    """
    try:
        clip = with_rest_pose(clip)
        motion = motion_span(clip)
        start, stop = active_span(arms(clip[motion.start : motion.stop]))
    except InputError:
        return None, None
    return motion.start + start, len(clip) - motion.start - stop


class SharedSkeletons:
    """Shares one object among equal skeletons of different files: finding roles and sizes of a rig takes longer than
    reading a clip.
    """

    def __init__(self) -> None:
        self._by_description: dict[str, Skeleton] = {}

    def of(self, clip: Clip) -> Clip:
        """Return the clip on the first skeleton equal to its own. Raises ``InputError`` if it has too many joints."""
        first = self._by_description.setdefault(store.describe(clip.skeleton), clip.skeleton)
        return clip if first is clip.skeleton else copy_unchecked(clip, skeleton=first)


class Builder:
    """A lexicon under construction, made by ``building``. Its memory does not grow with the number of frames.

    form: how rotations are stored, one of ``FORMS``.
    n_words: number of words added so far.
    n_bytes: size of the frames file so far.
    """

    def __init__(self, frames: BinaryIO, index: sqlite3.Connection, form: str) -> None:
        self.form, self.n_words, self.n_bytes = form, 0, HEAD_BYTES
        self._frames, self._index = frames, index
        self._frames.write(bytes(HEAD_BYTES))
        self._index.executescript("PRAGMA journal_mode = MEMORY;" + store.SCHEMA)
        self._names: dict[str, str] = {}  # folded gloss or synonym -> gloss
        self._shared = SharedSkeletons()
        self._skeletons: dict[str, int] = {}  # description -> number in the index
        self._digest = hashlib.sha256()

    def add(
        self,
        clip: Clip | PreparedWord,
        gloss: str = "",
        *,
        kind: str = "",
        synonyms: Iterable[str] = (),
        signer: str = "",
        source: str = "",
        checked: bool = False,
        extensions: Mapping[str, bytes] | None = None,
    ) -> Entry:
        """Add a clip, or one prepared in the lexicon's form, and return its entry. By default the gloss follows from
        the clip's name and the kind from the gloss.

        extensions: named bytes stored with the word. Raises ``InputError`` if a gloss or synonym is taken or invalid;
        more words can be added afterwards.
        """
        word = clip if isinstance(clip, PreparedWord) else prepare(self._shared.of(clip), self.form)
        gloss = gloss_of(gloss or word.name)
        kind = kind_of(gloss, kind)
        names = {fold(gloss): gloss}
        for name in map(gloss_of, synonyms):
            names.setdefault(fold(name), name)
        for folded, name in names.items():
            if folded in self._names:
                raise InputError(f"gloss {name!r} stands twice: for {gloss} and for {self._names[folded]}")
        parts = {name: part for name, part in ((store.CARD, word.card), (store.POINTS, word.points)) if part}
        added = dict(sorted((parts | dict(extensions or {})).items()))
        if not all(name.isprintable() and isinstance(value, bytes) for name, value in added.items()):
            raise InputError(f"extensions {', '.join(added)[:80]!r} of {gloss}, expected bytes by printable names")
        entry = word.entry(gloss, kind, tuple(names.values())[1:], signer, source, checked)
        number = self._skeleton(word.skeleton)
        location = store.ClipLocation(number, self.n_bytes, len(word.block), word.has_translations)
        self._frames.write(word.block)
        self.n_words, self.n_bytes = self.n_words + 1, self.n_bytes + len(word.block)
        self._names |= dict.fromkeys(names, gloss)
        row: list[object] = [self.n_words, *astuple(entry), *astuple(location)]
        row[3] = json.dumps(entry.synonyms, ensure_ascii=False)
        self._insert("word", row)
        for folded, name in names.items():
            self._insert("name", (folded, name, name == gloss, self.n_words))
        for name, value in added.items():
            self._insert("extension", (self.n_words, name, value))
        self._digest.update(store.row_digest(entry, location, added))
        return entry

    def free(self, gloss: str) -> str:
        """Return the gloss, or the first free one of GLOSS#2, GLOSS#3 and so on."""
        base, number = re.sub(r"#\d+$", "", gloss), 1
        while fold(gloss) in self._names:
            number += 1
            gloss = f"{base}#{number}"
        return gloss

    def finish(self) -> None:
        """Write the heads of both files."""
        if not self.n_words:
            raise InputError("no word was added, expected at least one")
        self._frames.seek(0)
        self._frames.write(MAGIC + self._digest.digest())
        self._frames.flush()
        self._insert("lexicon", (self.form, self.n_words, self.n_bytes, self._digest.hexdigest()))
        self._index.commit()

    def _skeleton(self, description: str) -> int:
        """Return the number of a skeleton; writes a new one to the index."""
        if description not in self._skeletons:
            self._skeletons[description] = len(self._skeletons) + 1
            row = self._skeletons[description], store.sha256(description), description
            self._insert("skeleton", row)
        return self._skeletons[description]

    def _insert(self, table: str, row: Sequence[object]) -> None:
        self._index.execute(f"INSERT INTO {table} VALUES ({', '.join('?' * len(row))})", row)


@contextmanager
def building(path: str | Path, *, compact: bool = False) -> Iterator[Builder]:
    """Yield a builder whose lexicon is put at ``path`` if the block succeeds; if it fails, nothing changes there.

    An existing lexicon is replaced. compact: int16 rotations, half the size. Raises ``InputError`` if something else
    is at ``path`` or it cannot be written, e.g. because the disk is full.
    """
    check_target(path)
    with replacing_folder(path) as folder:
        try:
            frames, index = (folder / FRAMES).open("wb"), sqlite3.connect(folder / store.INDEX)
            with closing(frames), closing(index):
                builder = Builder(frames, index, "int16" if compact else "float32")
                yield builder
                builder.finish()
        except sqlite3.Error as error:
            raise OSError(str(error)) from error


def check_target(path: str | Path) -> None:
    """Raise ``InputError`` if no lexicon can be written to ``path``, as ``check_place`` does, or if the lexicon would
    overwrite something else.
    """
    check_place(path)
    target = Path(path).resolve()
    if not target.exists():
        return
    if not target.is_dir() or store.application_id(target / store.INDEX) != store.APPLICATION_ID:
        raise InputError(f"{path}: is there already and is no lexicon, expected a new name or a lexicon to replace")
    check_nothing_else(Path(path), (store.INDEX, FRAMES), "lexicon")
