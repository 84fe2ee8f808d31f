"""A folder of clips -> a lexicon, and what is wrong with such a folder."""

from __future__ import annotations

import os
import unicodedata
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from signsplice.errors import InputError
from signsplice.formats import SUFFIXES, load
from signsplice.formats.roles import give
from signsplice.lexicon import glosses
from signsplice.lexicon.builder import Builder, building, check_target
from signsplice.lexicon.entry import Entry, fold, gloss_of
from signsplice.lexicon.frames import encode
from signsplice.lexicon.glosses import TABLE, GlossRow
from signsplice.motion.clip import Clip

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Source:
    """A clip's file and what is told of its word; ``where`` says in messages where its gloss stands."""

    path: Path
    where: str
    gloss: str
    kind: str
    synonyms: tuple[str, ...]
    signer: str
    source: str
    checked: bool


@dataclass(frozen=True)
class Built:
    """What a build made, and what has to be said of it."""

    n_words: int
    n_letters: int
    n_bytes: int
    form: str
    warnings: tuple[str, ...]


def survey(folder: str | Path, signer: str = "") -> tuple[list[Source], list[str]]:
    """Every clip below a folder in the order of names, and the faults of names and table, one line each.

    Folders within are searched, hidden ones and links to folders are not. Raises ``InputError`` where there is no clip
    or a folder cannot be read.
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
    named = {unicodedata.normalize("NFC", name): row for name, row in rows.items()}
    sources: list[Source] = []
    for path in files:
        name = path.relative_to(folder).as_posix()
        row = named.pop(unicodedata.normalize("NFC", name), None)
        try:
            sources.append(_source(path, name, row, folder, signer))
        except InputError as error:
            faults.append(f"{path}: {error}; rename the file, or name its gloss in {TABLE}")
    faults += [f"{folder / TABLE}:{row.line}: no clip {row.file} in {folder}" for row in named.values()]
    return sources, faults + _clashes(sources)


def build(
    folder: str | Path,
    output: str | Path,
    *,
    compact: bool = False,
    signer: str = "",
    roles: Mapping[str, str] | None = None,
    skip_broken: bool = False,
    progress: Progress | None = None,
) -> Built:
    """What was built: a lexicon at ``output`` of every clip below ``folder``, one clip in memory at a time.

    signer: of the clips for which the table names none. roles: role -> joint name, for rigs not known by name.
    skip_broken: leave broken clips out, each with a warning, rather than stop at the first. Raises ``InputError``; then
    nothing has changed at ``output``.
    """
    check_target(output)
    sources, faults = survey(folder, signer)
    if faults:
        more = f" (and {len(faults) - 1} more: `signsplice lexicon check {folder}`)" if len(faults) > 1 else ""
        raise InputError(faults[0] + more)
    warnings: list[str] = []
    n_letters = n_armless = 0
    with building(output, compact=compact) as builder:
        for done, source in enumerate(sources, start=1):
            try:
                entry = _add(builder, source, roles)
                n_letters += entry.kind == "letter"
                n_armless += entry.rest_before is None
            except InputError as error:
                if not skip_broken:
                    raise InputError(
                        f"{error}; nothing was built: `signsplice lexicon check {folder}` shows every fault, "
                        "--skip-broken leaves such clips out"
                    ) from error
                warnings.append(f"{error}; left out")
            if progress is not None:
                progress(done, len(sources))
        if not builder.n_words:
            raise InputError(f"{folder}: every clip is broken, the first one: {warnings[0]}")
    if n_armless:
        warnings.append(
            f"{n_armless} clips have arms that are not known by name: name them with a roles file (--roles)"
        )
    return Built(builder.n_words, n_letters, builder.n_bytes, builder.form, tuple(warnings))


def check(
    folder: str | Path, roles: Mapping[str, str] | None = None, progress: Progress | None = None
) -> tuple[int, list[str]]:
    """Number of clips below a folder, and everything that would keep it from being built, one line each. Raises
    ``InputError`` where there is no clip.
    """
    sources, faults = survey(folder)
    for done, source in enumerate(sources, start=1):
        try:
            clip = _read(source, roles)
            with _naming(source):
                encode(clip, "float32")
        except InputError as error:
            faults.append(str(error))
        if progress is not None:
            progress(done, len(sources))
    return len(sources), faults


def _add(builder: Builder, source: Source, roles: Mapping[str, str] | None) -> Entry:
    """The entry of a source that was read and added. Raises ``InputError`` that names its file."""
    clip = _read(source, roles)
    with _naming(source):
        return builder.add(
            clip,
            source.gloss,
            kind=source.kind,
            synonyms=source.synonyms,
            signer=source.signer,
            source=source.source,
            checked=source.checked,
        )


def _read(source: Source, roles: Mapping[str, str] | None) -> Clip:
    clip = load(source.path)
    with _naming(source):
        return clip if roles is None else give(clip, roles)


@contextmanager
def _naming(source: Source) -> Iterator[None]:
    """Errors within name the source's file."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{source.path}: {error}") from error


def _files(folder: Path) -> list[Path]:
    if not folder.is_dir():
        what = "is a file" if folder.exists() else "no such folder"
        raise InputError(f"{folder}: {what}, expected a folder of clips ({', '.join(SUFFIXES)})")

    def refuse(error: OSError) -> None:
        raise InputError(f"{error.filename}: cannot be read ({error.strerror})") from error

    found = []
    for parent, inner, names in os.walk(folder, onerror=refuse):
        inner[:] = [name for name in inner if not name.startswith(".")]
        found += [
            Path(parent, name) for name in names if Path(name).suffix.lower() in SUFFIXES and not name.startswith(".")
        ]
    if not found:
        raise InputError(f"{folder}: no clips in it, expected files that end in {' or '.join(SUFFIXES)}")
    return sorted(found, key=lambda path: path.relative_to(folder).as_posix())


def _source(path: Path, name: str, row: GlossRow | None, folder: Path, signer: str) -> Source:
    if row is None:
        row = GlossRow(name, "", (), "", "", False, "", 0)
    return Source(
        path=path,
        where=f"{path} ({folder / TABLE}:{row.line})" if row.line else str(path),
        gloss=row.gloss or gloss_of(path.stem),
        kind=row.kind,
        synonyms=row.synonyms,
        signer=row.signer or signer,
        source=row.source or name,
        checked=row.checked,
    )


def _clashes(sources: list[Source]) -> list[str]:
    """A line for each name that two files would have."""
    owners: dict[str, Source] = {}
    faults = []
    for source in sources:
        for name in dict.fromkeys(map(fold, (source.gloss, *source.synonyms))):
            owner = owners.setdefault(name, source)
            if owner is not source:
                shown = next(n for n in (source.gloss, *source.synonyms) if fold(n) == name)
                faults.append(
                    f"{source.where}: gloss {shown!r} is that of {owner.where} too, expected different glosses; "
                    f"name them in {TABLE}"
                )
    return faults
