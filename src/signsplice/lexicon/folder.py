"""Lexicons built from folders of clips, and the faults of such folders."""

from __future__ import annotations

import os
import unicodedata
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from shlex import quote

from signsplice.errors import InputError
from signsplice.formats import READ_SUFFIXES, load
from signsplice.formats.limits import DEFAULT_LIMITS, ReadLimits
from signsplice.formats.roles import with_roles
from signsplice.lexicon import glosses
from signsplice.lexicon.builder import Builder, SharedSkeletons, building, check_target
from signsplice.lexicon.entry import Entry, fold, gloss_of
from signsplice.lexicon.frames import encode
from signsplice.lexicon.glosses import COLUMNS, TABLE, GlossRow
from signsplice.motion.clip import Clip
from signsplice.progress import Progress, counted
from signsplice.rig.inspection import clip_warnings


@dataclass(frozen=True)
class Source:
    """A clip's file and the metadata of its word.

    path: the file.
    where: where its gloss comes from, for messages.
    row: gloss, synonyms and the rest, whether the table has them or not; kind is empty where it follows from the gloss.
    """

    path: Path
    where: str
    row: GlossRow

    @property
    def names(self) -> tuple[str, ...]:
        """Gloss and synonyms."""
        return self.row.gloss, *self.row.synonyms


@dataclass(frozen=True)
class Built:
    """The result of a build.

    n_words: number of words, letters included.
    n_letters: number of letters.
    n_bytes: size of the frames file.
    form: how rotations are stored.
    warnings: what a user should know, one line each.
    """

    n_words: int
    n_letters: int
    n_bytes: int
    form: str
    warnings: tuple[str, ...]


@dataclass(frozen=True)
class Checked:
    """What is found in the clips of a folder.

    n_clips: number of clips.
    faults: everything that prevents a build, one line each.
    warnings: what a user should know besides, one line each.
    """

    n_clips: int
    faults: list[str]
    warnings: list[str]


def find_sources(folder: str | Path, signer: str = "") -> tuple[list[Source], list[str]]:
    """Every clip below a folder, sorted by name, and the faults of file names and table, one line each.

    Subfolders are searched, except hidden ones and links. Raises ``InputError`` where there is no clip or a folder
    cannot be read.
    """
    folder = Path(folder)
    files = _files(folder)
    rows: dict[str, GlossRow] = {}
    faults: list[str] = []
    if (folder / TABLE).exists():
        try:
            rows, faults = glosses.read(folder / TABLE)
        except InputError as error:
            faults = [str(error)]
    unused = {unicodedata.normalize("NFC", name): row for name, row in rows.items()}
    sources: list[Source] = []
    for path in files:
        name = path.relative_to(folder).as_posix()
        row = unused.pop(unicodedata.normalize("NFC", name), None)
        try:
            sources.append(_source(path, name, row, folder, signer))
        except InputError as error:
            faults.append(f"{path}: {error}; rename the file, or name its gloss in {TABLE}")
    faults += [f"{folder / TABLE}:{row.line}: no clip {row.file} in {folder}" for row in unused.values()]
    return sources, faults + _duplicates(sources)


def build(
    folder: str | Path,
    output: str | Path,
    *,
    compact: bool = False,
    signer: str = "",
    roles: Mapping[str, str] | None = None,
    skip_broken: bool = False,
    progress: Progress | None = None,
    limits: ReadLimits = DEFAULT_LIMITS,
) -> Built:
    """Build a lexicon at ``output`` from every clip below ``folder``, with one clip in memory at a time.

    compact: int16 rotations, half the size. signer: of clips for which the table names none. roles: role -> joint name,
    for rigs that are not recognised by joint names. skip_broken: leave out broken clips, with a warning each, rather
    than stop at the first. limits: of each clip. Raises ``InputError``, also where one of the folders lies in the
    other; then nothing has changed at ``output``.
    """
    check_target(output)
    read, made = Path(folder).resolve(), Path(output).resolve()
    if made.is_relative_to(read) or read.is_relative_to(made):
        raise InputError(f"{output}: lies in {folder}, which is read, or contains it; name another folder")
    sources, faults = find_sources(folder, signer)
    if faults:
        more = (
            f" (and {len(faults) - 1} more: `signsplice lexicon check {quote(str(folder))}`)" if len(faults) > 1 else ""
        )
        raise InputError(faults[0] + more)
    warnings: list[str] = []
    n_letters = 0
    with building(output, compact=compact) as builder:
        for source in counted(sources, progress):
            try:
                entry = _add(builder, source, roles, limits, warnings)
                n_letters += entry.kind == "letter"
            except InputError as error:
                if not skip_broken:
                    raise InputError(
                        f"{error}; nothing was built: `signsplice lexicon check {quote(str(folder))}` shows every "
                        "fault, skip_broken leaves such clips out"
                    ) from error
                warnings.append(f"{error}; left out")
        if not builder.n_words:
            raise InputError(f"{folder}: every clip is broken, the first one: {warnings[0]}")
    return Built(builder.n_words, n_letters, builder.n_bytes, builder.form, tuple(warnings))


def check(
    folder: str | Path,
    roles: Mapping[str, str] | None = None,
    progress: Progress | None = None,
    limits: ReadLimits = DEFAULT_LIMITS,
) -> Checked:
    """What is found in the clips below a folder. Raises ``InputError`` where there is no clip."""
    sources, faults = find_sources(folder)
    skeletons = SharedSkeletons()
    warnings: list[str] = []
    for source in counted(sources, progress):
        try:
            clip = _read(source, roles, limits)
            with _prefixed_errors(source):
                clip = skeletons.of(clip)
                encode(clip, "float32")
                warnings += _warnings(clip, source)
        except InputError as error:
            faults.append(str(error))
    return Checked(len(sources), faults, warnings)


def _add(
    builder: Builder, source: Source, roles: Mapping[str, str] | None, limits: ReadLimits, warnings: list[str]
) -> Entry:
    """Read a source, add it and return its entry; add to ``warnings``. Raises ``InputError`` that names its file."""
    clip = _read(source, roles, limits)
    with _prefixed_errors(source):
        clip = builder.with_shared_skeleton(clip)
        warnings += _warnings(clip, source)
        return builder.add(clip, **{name: getattr(source.row, name) for name in COLUMNS[1:]})


def _warnings(clip: Clip, source: Source) -> list[str]:
    """What a user should know about a clip; nothing where its roles do not fit, which ``splice`` says."""
    with suppress(InputError):
        return [f"{source.path}: {line}" for line in clip_warnings(clip)]
    return []


def _read(source: Source, roles: Mapping[str, str] | None, limits: ReadLimits) -> Clip:
    clip = load(source.path, limits)
    with _prefixed_errors(source):
        return clip if roles is None else with_roles(clip, roles)


@contextmanager
def _prefixed_errors(source: Source) -> Iterator[None]:
    """Prefix errors within the block with the source's file."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{source.path}: {error}") from error


def _files(folder: Path) -> list[Path]:
    if not folder.is_dir():
        what = "is a file" if folder.exists() else "no such folder"
        raise InputError(f"{folder}: {what}, expected a folder of clips ({', '.join(READ_SUFFIXES)})")

    def fail(error: OSError) -> None:
        raise InputError(f"{error.filename}: cannot be read ({error.strerror})") from error

    found = []
    for parent, subfolders, names in os.walk(folder, onerror=fail):
        subfolders[:] = [name for name in subfolders if not name.startswith(".")]
        visible = [Path(parent, name) for name in names if not name.startswith(".")]
        found += [path for path in visible if path.suffix.lower() in READ_SUFFIXES]
    if not found:
        raise InputError(f"{folder}: no clips in it, expected files that end in {' or '.join(READ_SUFFIXES)}")
    return sorted(found, key=lambda path: path.relative_to(folder).as_posix())


def _source(path: Path, name: str, row: GlossRow | None, folder: Path, signer: str) -> Source:
    if row is None:
        row = GlossRow(name, "", (), "", "", False, "", 0)
    where = f"{path} ({folder / TABLE}:{row.line})" if row.line else str(path)
    gloss = row.gloss or gloss_of(path.stem)
    return Source(path, where, replace(row, gloss=gloss, signer=row.signer or signer, source=row.source or name))


def _duplicates(sources: list[Source]) -> list[str]:
    """A fault for each gloss or synonym that two files would have."""
    owners: dict[str, Source] = {}
    faults = []
    for source in sources:
        for name in dict.fromkeys(map(fold, source.names)):
            owner = owners.setdefault(name, source)
            if owner is not source:
                shown = next(n for n in source.names if fold(n) == name)
                faults.append(
                    f"{source.where}: gloss {shown!r} is that of {owner.where} too, expected different glosses; "
                    f"name them in {TABLE}"
                )
    return faults
