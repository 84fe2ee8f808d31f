"""Lexicons built from folders of clips, and the faults of such folders."""

from __future__ import annotations

import os
import re
import unicodedata
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import nullcontext
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path
from shlex import quote

from signsplice.children import cores, in_order
from signsplice.errors import InputError, SignspliceError
from signsplice.formats import READ_SUFFIXES
from signsplice.formats.atomic import resumable_folder
from signsplice.formats.reading import DEFAULT_LIMITS, ReadLimits
from signsplice.lexicon import archives, glosses
from signsplice.lexicon.builder import building, check_target
from signsplice.lexicon.entry import fold, gloss_of
from signsplice.lexicon.glosses import TABLE, GlossRow
from signsplice.lexicon.preparing import FileTask, PreparedWord, prepare_file
from signsplice.progress import Progress

_FILES_A_PROCESS = 50
"""A process takes as long to start as so many files to read."""


@dataclass(frozen=True)
class Source:
    """A clip's file and the metadata of its word.

    paths: the file, and others of the same recording that are read where it is broken.
    where: where its gloss comes from, for messages.
    row: gloss, synonyms and the rest, whether the table has them or not; kind is empty where it follows from the gloss.
    face: the file with its face that the table names.
    """

    paths: tuple[Path, ...]
    where: str
    row: GlossRow
    face: Path | None = None

    @property
    def path(self) -> Path:
        """The file."""
        return self.paths[0]

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
    left_out: words and files that are not in it, one line each, which are among the warnings.
    unread: what else an archive holds of its words, a line for each kind of file.
    """

    n_words: int
    n_letters: int
    n_bytes: int
    form: str
    warnings: tuple[str, ...]
    left_out: tuple[str, ...] = ()
    unread: tuple[str, ...] = ()


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


def find_sources(folder: str | Path, signer: str = "", table: str | Path = "") -> tuple[list[Source], list[str]]:
    """Every clip below a folder, sorted by name, and the faults of file names and table, one line each.

    table: names the clips that are meant, in place of ``glosses.csv``, which names some. Subfolders are searched,
    except hidden ones and links. Raises ``InputError`` where there is no clip or a folder cannot be read.
    """
    folder = Path(folder)
    files = {unicodedata.normalize("NFC", path.relative_to(folder).as_posix()): path for path in _files(folder)}
    path_of_table = Path(table or folder / TABLE)
    rows: list[GlossRow] = []
    faults: list[str] = []
    if table or path_of_table.exists():
        try:
            rows, faults = glosses.read(path_of_table)
        except InputError as error:
            faults = [str(error)]
    by_file: dict[str, list[GlossRow]] = {}
    for row in rows:
        by_file.setdefault(unicodedata.normalize("NFC", row.file), []).append(row)
    sources: list[Source] = []
    for name, path in files.items():
        for row in by_file.pop(name, [] if table else [GlossRow(name)]):
            try:
                source = _source(path, path_of_table, row, signer)
                sources.append(replace(source, face=folder / row.face) if row.face else source)
            except InputError as error:
                faults.append(f"{path}: {error}; rename the file, or name its gloss in {TABLE}")
    lost = [row for rows in by_file.values() for row in rows]
    faults += [f"{path_of_table}:{row.line}: no clip {row.file} in {folder}" for row in lost]
    return sources, faults + [fault for _, fault in _duplicates(sources)]


def build(
    folder: str | Path | Sequence[str | Path],
    output: str | Path,
    *,
    compact: bool = False,
    signer: str = "",
    roles: Mapping[str, str] | None = None,
    skip_broken: bool = False,
    recipe: str = "",
    jobs: int | None = 1,
    progress: Progress | None = None,
    limits: ReadLimits = DEFAULT_LIMITS,
    more: Iterable[tuple[PreparedWord | str, GlossRow]] = (),
) -> Built:
    """Build a lexicon at ``output`` from every clip below ``folder``, or several, with few clips in memory at a time.

    compact: int16 rotations, half the size. signer: of clips for which the table names none. roles: role -> joint name,
    for rigs that are not recognised by joint names. skip_broken: leave out broken clips, with a line each. recipe: of
    an archive, a name in ``RECIPES``, a ``.json`` file or a ``.csv`` table: what does not fit is left out, and a build
    that was stopped goes on. jobs: processes; None: one a core. limits: of each clip. more: words that are ready.
    Raises ``InputError``, also where one of the folders lies in the other; then nothing has changed at ``output``.
    """
    check_target(output)
    given, made = [folder] if isinstance(folder, (str, Path)) else [*folder], Path(output).resolve()
    sources, left_out = _gathered(given, output, recipe, signer)
    checks = " and ".join(f"`signsplice lexicon check {quote(str(one))}`" for one in given)
    if left_out and not recipe:
        raise InputError(left_out[0] + (f" (and {len(left_out) - 1} more: {checks})" if left_out[1:] else ""))
    store = made.with_name(f".{made.name}.prepared") if recipe else None
    task = FileTask((), (), "int16" if compact else "float32", roles, limits, store)
    warnings, n_letters = [*left_out], 0
    with resumable_folder(store) if store else nullcontext(), building(output, compact=compact) as builder:
        for source, word in _prepared(sources, task, jobs, progress):
            if isinstance(word, str):
                if not (skip_broken or recipe):
                    raise InputError(
                        f"{word}; nothing was built: {checks} shows every fault, skip_broken leaves such clips out"
                    )
                left_out.append(f"{word}; left out")
                warnings.append(left_out[-1])
                continue
            warnings += word.warnings
            row = source.row
            entry = builder.add_prepared(
                word, row.gloss, kind=row.kind, synonyms=row.synonyms, signer=row.signer, source=row.source,
                checked=row.checked,
            )  # fmt: skip
            n_letters += entry.kind == "letter"
        for word, row in more:
            if isinstance(word, str):
                left_out.append(f"{word}; left out")
                warnings.append(left_out[-1])
                continue
            warnings += word.warnings
            builder.add_prepared(word, builder.free(row.gloss), signer=row.signer or signer, source=row.source)
        if not builder.n_words:
            what = "clip" if given else "sign"
            raise InputError(f"{given[0] if given else output}: every {what} is broken, the first one: {left_out[0]}")
    lines = tuple(warnings), tuple(left_out), _unread(given, recipe)
    return Built(builder.n_words, n_letters, builder.n_bytes, builder.form, *lines)


def _unread(given: Sequence[str | Path], recipe: str) -> tuple[str, ...]:
    """Lines about files of archives that nothing reads."""
    if not _is_archive(recipe):
        return ()
    return tuple(line for one in given for line in archives.unread(Path(one), archives.find_recipe(recipe)))


def check(
    folder: str | Path,
    roles: Mapping[str, str] | None = None,
    progress: Progress | None = None,
    limits: ReadLimits = DEFAULT_LIMITS,
) -> Checked:
    """What is found in the clips below a folder. Raises ``InputError`` where there is no clip."""
    sources, faults = find_sources(folder)
    warnings: list[str] = []
    for _, word in _prepared(sources, FileTask((), (), "float32", roles, limits), None, progress):
        if isinstance(word, str):
            faults.append(word)
        else:
            warnings += word.warnings
    return Checked(len(sources), faults, warnings)


def reasons(lines: Iterable[str]) -> list[tuple[int, str, str]]:
    """How many of the lines that begin with a file, and perhaps a gloss, give a reason, the reason, and the first file;
    the most frequent first.
    """
    seen: dict[str, list[str]] = {}
    for line in lines:
        file, _, rest = line.partition(": ")
        reason = re.sub(r"^\S+: ", "", rest)
        seen.setdefault(re.sub(r"'[^']*'|\b\d[\d,.]*", "...", reason), []).append(file)
    return sorted(((len(files), reason, files[0]) for reason, files in seen.items()), key=lambda one: -one[0])


def _gathered(
    given: Sequence[str | Path], output: str | Path, recipe: str, signer: str
) -> tuple[list[Source], list[str]]:
    """What ``_wanted`` finds in all folders, each gloss once. Raises ``InputError`` where one holds the output, or
    lies in it.
    """
    sources, lines, made = list[Source](), list[str](), Path(output).resolve()
    for one in given:
        read = Path(one).resolve()
        if made.is_relative_to(read) or read.is_relative_to(made):
            raise InputError(f"{output}: lies in {one}, which is read, or contains it; name another folder")
        found, faults = _wanted(Path(one), recipe, signer)
        sources, lines = sources + found, lines + faults
    twice = _duplicates(sources) if len(given) > 1 else []
    taken = {source for source, _ in twice}
    return [source for source in sources if source not in taken], [
        *dict.fromkeys([*lines, *(line for _, line in twice)])
    ]


def _wanted(folder: Path, recipe: str, signer: str) -> tuple[list[Source], list[str]]:
    """The sources that are built, and a line for each fault or, by a recipe, for each file that is left out."""
    if not _is_archive(recipe):
        sources, lines = find_sources(folder, signer, recipe)
    else:
        words, lines = archives.recordings(folder, _files(folder), archives.find_recipe(recipe))
        sources = [Source(word.paths, str(word.paths[0]), replace(word.row, signer=signer)) for word in words]
    if not recipe:
        return sources, lines
    twice = _duplicates(sources)
    return [source for source in sources if source not in {source for source, _ in twice}], lines


def _is_archive(recipe: str) -> bool:
    """Whether a recipe goes by the names of files, not by a table."""
    return bool(recipe) and not recipe.lower().endswith(".csv")


def _prepared(
    sources: Sequence[Source], task: FileTask, jobs: int | None, progress: Progress | None
) -> Iterator[tuple[Source, PreparedWord | str]]:
    """Each source with its word ready, or what is wrong with it; each file is read once for all of its words."""
    groups = [list(words) for _, words in groupby(sources, key=lambda source: (source.paths, source.face))]
    tasks = [
        replace(task, paths=words[0].paths, spans=tuple(one.row.span for one in words), face=words[0].face)
        for words in groups
    ]
    workers = min(cores(), len(tasks) // _FILES_A_PROCESS) if jobs is None else min(jobs, len(tasks))
    done = 0
    try:
        for words, ready in zip(groups, in_order(prepare_file, tasks, max(workers, 1)), strict=True):
            yield from zip(words, ready, strict=True)
            done += len(words)
            if progress is not None:
                progress(done, len(sources))
    except BrokenProcessPool as error:
        raise SignspliceError(
            "a process that reads clips has ended, out of memory or by a fault; call again with fewer processes"
        ) from error


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


def _source(path: Path, table: Path, row: GlossRow, signer: str) -> Source:
    where = f"{path} ({table}:{row.line})" if row.line else str(path)
    gloss = row.gloss or gloss_of(path.stem)
    return Source((path,), where, replace(row, gloss=gloss, signer=row.signer or signer, source=row.source or row.file))


def _duplicates(sources: Sequence[Source]) -> list[tuple[Source, str]]:
    """The sources whose gloss or synonym another has before them, each with a line that says so."""
    owners: dict[str, Source] = {}
    found = []
    for source in sources:
        for name in dict.fromkeys(map(fold, source.names)):
            owner = owners.setdefault(name, source)
            if owner is not source:
                shown = next(n for n in source.names if fold(n) == name)
                line = (
                    f"{source.where}: gloss {shown!r} is that of {owner.where} too, expected different glosses; "
                    f"name them in {TABLE}"
                )
                found.append((source, line))
    return found
