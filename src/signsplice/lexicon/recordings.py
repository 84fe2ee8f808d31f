"""Maps files of a folder to words: by name, by the table ``glosses.csv``, or by the recipe of an archive.

A recipe is a pattern of paths. Its group ``gloss`` is required; ``variant``, ``alt`` and ``spelled`` distinguish
recordings of one gloss; among the rest the newest ``date`` wins, then the highest ``take``, then the first ``kind``.
"""

from __future__ import annotations

import csv
import io
import json
import math
import os
import re
import subprocess
import sys
import unicodedata
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from signsplice.children import parent_death_hook
from signsplice.errors import FormatError, InputError
from signsplice.formats import AS_WRITTEN, READ_SUFFIXES, ReadAs, roles
from signsplice.formats.json_files import read_json
from signsplice.formats.reading import read_bytes
from signsplice.lexicon.gloss import LETTER_MARK, fold, gloss_of, kind_of
from signsplice.lexicon.languages import check_signed
from signsplice.rig.align import list_names
from signsplice.rig.roles import CHANNELS

TABLE = "glosses.csv"
INDEX = "index.csv"
"""The table of a lexicon of spoken-to-signed."""
COLUMNS = ("file", "gloss", "synonyms", "signer", "source", "checked", "kind", "start", "end", "variant",
           "face", "owns", "fps", "face_fps", "take", "rest_frame", "roles", "language")  # fmt: skip
_CHECKED = {"": False, "no": False, "unknown": False, "yes": True}


@dataclass(frozen=True)
class GlossRow:
    """A checked row of the table; missing fields are empty.

    file: path of the clip, relative to the folder.
    gloss, synonyms, signer, source, checked, kind: as in ``Entry``.
    line: line number in the table, 0 without a table.
    span: start and end of the word, seconds; None if it begins or ends with the clip.
    face: path of the clip's face, relative to the folder.
    owns: channels of the word's own, some of ``CHANNELS``; None if a rule decides.
    read: how the clip is read.
    roles: path of the clip's roles file, relative to the folder.
    language: code of the word's signed language.
    """

    file: str
    gloss: str = ""
    synonyms: tuple[str, ...] = ()
    signer: str = ""
    source: str = ""
    checked: bool = False
    kind: str = ""
    line: int = 0
    span: tuple[float | None, float | None] = (None, None)
    face: str = ""
    owns: frozenset[str] | None = None
    read: ReadAs = AS_WRITTEN
    roles: str = ""
    language: str = ""


def read_table(path: str | Path) -> tuple[list[GlossRow], list[str]]:
    """Read the rows of a table, and its faults as lines ``FILE:LINE: actual, expected``.

    The table is UTF-8 with commas and a header of ``file`` and any other of ``COLUMNS``; synonyms and channels are
    separated by ``;``; checked is yes or no; a file may have several rows with different start or end. Raises
    ``InputError`` if the file cannot be read, ``FormatError`` if its header is wrong.
    """
    file = str(path)
    reader = csv.reader(_open_table(path), strict=True)
    rows: dict[tuple[str, object], GlossRow] = {}
    faults: list[str] = []
    try:
        head = [cell.strip().lower() for cell in next(reader, [])]
        _check_head(head, file)
        for cells in reader:
            if not any(cell.strip() for cell in cells):
                continue
            try:
                row = _row(head, cells, reader.line_num)
                first = rows.setdefault((row.file, row.span), row)
                if first is not row:
                    raise InputError(f"{row.file} stands in line {first.line} too, expected one row a file")
            except InputError as error:
                faults.append(str(FormatError(str(error)[:300], file=file, line=reader.line_num)))
    except csv.Error as error:
        faults.append(str(FormatError(f"is no table ({error})", file=file, line=reader.line_num)))
    return [*rows.values()], faults


_INDEX_COLUMNS = {"path", "signed_language", "words", "glosses"}
"""Columns by which the table of spoken-to-signed is known; others: spoken_language, start, end, priority, segment_*."""


def has_index(folder: str | Path) -> bool:
    """Return whether a folder holds a table ``index.csv`` of spoken-to-signed, and no ``glosses.csv``."""
    folder = Path(folder)
    if (folder / TABLE).exists() or not (folder / INDEX).is_file():
        return False
    head = read_bytes(folder / INDEX)[:2000].decode("utf-8-sig", "replace")
    return {cell.strip() for cell in next(csv.reader(head.splitlines()), [])} >= _INDEX_COLUMNS


def read_index(path: str | Path, language: str = "") -> list[GlossRow]:
    """Read the rows of spoken-to-signed's table: glosses by their best priority, further rows of a gloss as variants
    (HAUS-2), words as synonyms; letters if every row names a single character. A row's segment, if any, is its span.

    language: code of the signed language whose rows are read, if there are several. Raises ``FormatError`` for other
    tables, and ``InputError`` if it has rows of several languages and the given one is none of them.
    """
    file = str(path)
    reader = csv.DictReader(_open_table(path))
    every = list[tuple[int, int, dict[str, str]]]()
    try:
        for cells in reader:
            fields = {name.strip(): (cells.get(name) or "").strip() for name in reader.fieldnames or ()}
            every.append((int(fields.get("priority") or 0), reader.line_num, fields))
        languages = sorted({fields["signed_language"] for _, _, fields in every})
    except (csv.Error, KeyError, ValueError) as error:
        raise FormatError(f"is no table of a lexicon ({str(error)[:80]})", file=file, line=reader.line_num) from error
    if not every:
        raise InputError(f"{file}: has no rows, expected a sign in each")
    if len(languages) > 1 and language not in languages:
        raise InputError(f"{file}: holds signs of {', '.join(languages)}: name one of them as the language")
    wanted = languages[0] if len(languages) == 1 else language
    ranked = [row for row in every if row[2]["signed_language"] == wanted]
    rows, taken = list[GlossRow](), set[str]()
    mark = LETTER_MARK if all(len(fields["glosses"] or fields["words"]) == 1 for _, _, fields in ranked) else ""
    for _, line, fields in sorted(ranked, key=lambda row: row[:2]):
        try:
            rows.append(_index_row(fields, line, taken, mark))
        except (InputError, ValueError) as error:
            raise FormatError(str(error)[:300], file=file, line=line) from error
    return [_with_free_synonyms(row, taken) for row in rows]


def _with_free_synonyms(row: GlossRow, taken: set[str]) -> GlossRow:
    """Return the row without synonyms that are glosses, or synonyms of earlier rows; extends the ``taken`` names."""
    synonyms = tuple(name for name in row.synonyms if fold(name) not in taken)
    taken |= {fold(name) for name in synonyms}
    return replace(row, synonyms=synonyms)


def _index_row(fields: dict[str, str], line: int, taken: set[str], mark: str) -> GlossRow:
    """Return the row of a line, its words as synonyms; ``taken``: folded glosses of earlier rows, which it extends;
    ``mark``: before every gloss.
    """
    names = [gloss_of(mark + text) for text in (fields["glosses"], fields["words"]) if text]
    if not names or not fields["path"]:
        raise InputError("no gloss or no path, expected both")
    gloss, number = names[0], 1
    while fold(gloss) in taken:
        number += 1
        gloss = f"{names[0]}-{number}"
    taken.add(fold(gloss))
    synonyms = tuple(name for name in names[1:] if fold(name) != fold(gloss))
    times = [int(fields.get(name) or 0) for name in ("segment_start", "segment_end", "start", "end")]
    start, end = times[:2] if times[1] > times[0] else times[2:]
    span = (start / 1000.0 if start else None, end / 1000.0 if end else None)
    return GlossRow(
        _path(fields["path"]), gloss, synonyms, line=line, span=span, language=check_signed(fields["signed_language"])
    )


def _open_table(path: str | Path) -> io.StringIO:
    """Return the text of a table. Raises ``FormatError`` if it is not UTF-8."""
    try:
        return io.StringIO(read_bytes(path).decode("utf-8-sig"), newline="")
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b"\n") + 1
        raise FormatError("is not UTF-8, expected a table saved as UTF-8", file=str(path), line=line) from error


def _check_head(head: list[str], file: str) -> None:
    expected = f"expected {', '.join(COLUMNS)} parted by commas, of which only file must be there"
    unknown = [name for name in head if name not in COLUMNS]
    if unknown or "file" not in head:
        what = f"column {unknown[0][:40]!r}" if unknown else "no column 'file'"
        raise FormatError(f"{what}, {expected}", file=file, line=1)
    twice = [name for name in head if head.count(name) > 1]
    if twice:
        raise FormatError(f"column {twice[0]!r} stands twice, expected once", file=file, line=1)


def _row(head: list[str], cells: list[str], line: int) -> GlossRow:
    if len(cells) != len(head):
        raise InputError(f"{len(cells)} cells, expected {len(head)} as in the head; quote cells that hold commas")
    fields = dict.fromkeys(COLUMNS, "") | {name: cell.strip() for name, cell in zip(head, cells, strict=True)}
    if not fields["file"]:
        raise InputError("no file named, expected a clip's name")
    if fields["checked"].lower() not in _CHECKED:
        raise InputError(f"checked {fields['checked']!r}, expected yes, no or nothing")
    gloss = gloss_of(fields["gloss"]) if fields["gloss"] else ""
    kind = fields["kind"].lower()
    if fields["variant"]:
        gloss = gloss_of(f"{gloss or gloss_of(Path(fields['file']).stem)}-{fields['variant']}")
    kind_of(gloss or gloss_of(Path(fields["file"]).stem), kind)
    return GlossRow(
        file=_path(fields["file"]),
        gloss=gloss,
        synonyms=tuple(gloss_of(name) for name in fields["synonyms"].split(";") if name.strip()),
        signer=fields["signer"],
        source=fields["source"],
        checked=_CHECKED[fields["checked"].lower()],
        kind=kind,
        line=line,
        span=(_number(fields["start"], "time", "seconds"), _number(fields["end"], "time", "seconds")),
        face=_path(fields["face"]),
        owns=_channels(fields["owns"]),
        read=_read_as(fields),
        roles=_path(fields["roles"]),
        language=check_signed(fields["language"].lower()),
    )


def _path(cell: str) -> str:
    """Return a path relative to the folder, with forward slashes. Raises ``InputError`` for one that no file has."""
    if "\0" in cell:
        raise InputError(f"the path {cell[:40]!r} holds a zero byte")
    return cell.replace("\\", "/").removeprefix("./")


def _channels(cell: str) -> frozenset[str] | None:
    """Return the channels in a cell; None if it is empty."""
    names = {name.strip() for name in cell.lower().split(";")} - {""}
    if names - {*CHANNELS} and names != {"none"}:
        raise InputError(f"owns {cell[:40]!r}, expected none or some of {', '.join(CHANNELS)}, separated by ;")
    return frozenset(names - {"none"}) if names else None


def _number(cell: str, what: str, expected: str) -> float | None:
    """Return a number of at least 0; None if the cell is empty."""
    try:
        value = float(cell) if cell else None
    except ValueError:
        value = math.nan
    if value is not None and not 0.0 <= value < math.inf:
        raise InputError(f"{what} {cell[:40]!r}, expected {expected}")
    return value


def _read_as(fields: dict[str, str]) -> ReadAs:
    """Return how the clip of a row is read, apart from its roles."""
    fps, face_fps = (_number(fields[name], name, "frames a second") for name in ("fps", "face_fps"))
    frame = fields["rest_frame"]
    if frame and not frame.isdecimal():
        raise InputError(f"rest_frame {frame[:40]!r}, expected a frame's number")
    return ReadAs(fps, face_fps, fields["take"], int(frame) if frame else None)


@dataclass(frozen=True)
class WordFile:
    """A clip's file and the metadata of its word.

    paths: the file, and others of the same recording, which are read if it is broken.
    where: source of its gloss, for messages.
    row: gloss, synonyms and the rest, from the table or by default; kind is empty if it follows from the gloss.
    face: the file with its face that the table names.
    """

    paths: tuple[Path, ...]
    where: str
    row: GlossRow
    face: Path | None = None

    @property
    def path(self) -> Path:
        """The preferred file."""
        return self.paths[0]

    @property
    def names(self) -> tuple[str, ...]:
        """Gloss and synonyms."""
        return self.row.gloss, *self.row.synonyms


_GROUPS = ("gloss", "variant", "alt", "spelled", "date", "take", "kind")
_SHAPE = 'an object such as {"pattern": "(?P<gloss>[^/]+)_v(?P<variant>[0-9]+)", "kinds": ["Full", "Mini"]}'


@dataclass(frozen=True)
class ArchiveRecipe:
    """Naming scheme of the files of an archive.

    pattern: matches the end of a file's path in the archive, without its suffix; has some of ``_GROUPS``.
    kinds: values of the group ``kind``, best first: forms of one recording.
    unread: suffix of the names of further files of a word that are not read, and the reason.
    in_folders: whether a recording is a folder whose files are frames; then the pattern matches the folder's path.
    file: the file that it was read from; empty for a shipped one.
    """

    pattern: re.Pattern[str]
    kinds: tuple[str, ...] = ()
    unread: tuple[str, str] = ("", "")
    in_folders: bool = False
    file: str = ""


def _recipe(pattern: str, *kinds: str, unread: tuple[str, str] = ("", "")) -> ArchiveRecipe:
    return ArchiveRecipe(re.compile(f"(?:^|.*/){pattern}$", re.DOTALL), kinds, unread)


RECIPES = {
    "flat": _recipe(r"(?P<gloss>[^/]+)"),
    "frames": replace(_recipe(r"(?P<gloss>[^/]+)"), in_folders=True),
    "dated": _recipe(r"(?P<gloss>[^/]+?)(?:-(?P<variant>[A-Z]))?_(?P<date>\d{6})_(?P<take>\d+)"),
    "studiogalt": _recipe(
        r"SG \w+ (?P<gloss>[^/]+?)(?: (?:(?P<variant>\d+)|(?P<alt>\(Alt\))|(?P<spelled>Fingerspelling)))*"
        r" (?P<date>\d{4}-\d{1,2}-\d{1,2})(?: Upload)?/[^/]* No Mesh (?P<kind>[^/ ]+)",
        "Full", "Mini", "Mixamo",
        unread=("ShapeKeys.txt", "no source names their numbers; they stay beside the recordings"),
    ),
}  # fmt: skip
"""Shipped recipes: NAME; folders NAME with a file a frame; NAME-A_241127_1; and folders such as ``SG ASL Abhor 2
2023-2-4 Upload``.
"""


def find_recipe(name: str) -> ArchiveRecipe:
    """Return the recipe with a name in ``RECIPES``, or from a file. Raises ``InputError`` if there is none."""
    if name in RECIPES:
        return RECIPES[name]
    if Path(name).suffix.lower() != ".json":
        expected = f"expected {', '.join(RECIPES)}, a .csv table or a .json file"
        raise InputError(f"recipe {name!r:.80}, {expected}")
    loaded = read_json(name, _SHAPE)
    kinds = loaded.get("kinds", []) if isinstance(loaded, dict) else None
    pattern = loaded.get("pattern") if isinstance(loaded, dict) else None
    if not isinstance(pattern, str) or not isinstance(kinds, list) or not all(isinstance(kind, str) for kind in kinds):
        raise FormatError(f"is no recipe, expected {_SHAPE}", file=name)
    try:
        recipe = replace(_recipe(pattern, *kinds), file=name)
    except (re.error, OverflowError, RecursionError) as error:
        raise FormatError(f"pattern: {error}", file=name) from error
    groups = recipe.pattern.groupindex
    if "gloss" not in groups or not {*groups} <= {*_GROUPS}:
        raise FormatError(
            f"pattern names {', '.join(groups) or 'no groups'}, expected gloss and {', '.join(_GROUPS[1:])}", file=name
        )
    return recipe


_MATCH_S = 10.0, 1e-3
"""Time in which the pattern of a file must match all names, seconds, and further ones for each name: a loaded machine
needs a second to start the process, and patterns that ship need some microseconds for a name.
"""
_MATCH_IN_PROCESS = (
    "import json, re, sys; pattern, names = json.load(sys.stdin)\n"
    "for match in map(re.compile(pattern, re.DOTALL).match, names):\n"
    "  print(json.dumps(match and match.groupdict()), flush=True)"
)


def _match(recipe: ArchiveRecipe, names: Sequence[str]) -> list[dict[str, str | None] | None]:
    """Return the groups of each name, None where the pattern does not match. The pattern of a file is matched in a
    process with a time limit: some patterns need longer than a life for a short name, and nothing else stops ``re`` on
    every system. Raises ``FormatError`` if it takes too long.
    """
    if not recipe.file:
        return [match and match.groupdict() for match in map(recipe.pattern.match, names)]
    limit_s, call = _MATCH_S[0] + _MATCH_S[1] * len(names), [sys.executable, "-I", "-S", "-c", _MATCH_IN_PROCESS]
    asked = json.dumps([recipe.pattern.pattern, names]).encode()
    try:
        run = subprocess.run(
            call, input=asked, capture_output=True, timeout=limit_s, check=True, preexec_fn=parent_death_hook()
        )
    except (subprocess.TimeoutExpired, subprocess.CalledProcessError) as error:
        name = names[min((error.output or b"").count(b"\n"), len(names) - 1)]
        what = f"pattern takes over {limit_s:.0f} s, or all memory, at the name {name[-200:]!r}; simplify it: no (a+)+"
        raise FormatError(what, file=recipe.file) from None
    return [json.loads(line) for line in run.stdout.splitlines()]


def _recordings(
    folder: Path, files: Sequence[Path], recipe: ArchiveRecipe, signer: str
) -> tuple[list[WordFile], list[str]]:
    """Return the words of an archive by gloss, and a line for each file and folder without a word."""
    ranked: defaultdict[tuple[str, str], list[tuple[Any, Path]]] = defaultdict(list)
    used, left_out = set(), []
    if recipe.in_folders:
        files, used = sorted({path.parent for path in files} - {folder}), {path.parent for path in files}
    names = [path.relative_to(folder).as_posix().removesuffix(path.suffix * path.is_file()) for path in files]
    for path, groups in zip(files, _match(recipe, names), strict=True):
        used.add(path.parent)
        if groups is None:
            left_out.append(f"{path}: its path does not fit the recipe")
            continue
        try:
            gloss = gloss_of((groups["gloss"] or "").replace("_", " "))
        except InputError as error:
            left_out.append(f"{path}: {error}")
            continue
        parts = [groups.get("variant"), groups.get("alt") and "ALT", groups.get("spelled") and "SPELLED"]
        ranked[gloss, "-".join(filter(None, parts))].append((_preference(groups, recipe.kinds), path))
    empty = {path.parent for path in _visible(folder)} - used - {folder}
    left_out += [f"{place}: holds no clip" for place in sorted(empty)]
    glosses = {gloss for gloss, variant in ranked if not variant}
    words = []
    for gloss, variant in sorted(ranked, key=lambda key: (key[0], len(key[1]), key[1])):
        paths = [path for _, path in sorted(ranked[gloss, variant], key=lambda row: row[0], reverse=True)]
        synonyms = (gloss,) if gloss not in glosses else ()
        glosses.add(gloss)  # the gloss alone names its first variant
        source = paths[0].relative_to(folder).as_posix()
        row = GlossRow(source, f"{gloss}-{variant}" if variant else gloss, synonyms, signer, source)
        words.append(WordFile(tuple(paths), str(paths[0]), row))
    return words, left_out


def _preference(groups: dict[str, str | None], kinds: Sequence[str]) -> tuple[list[int], list[int], int]:
    """Return a sort key, greater for better recordings of a word: later date, higher take, earlier kind."""
    date, take = ([int(n) for n in re.findall(r"\d+", groups.get(name) or "0")] for name in ("date", "take"))
    kind = groups.get("kind")
    return date, take, -kinds.index(kind) if kind in kinds else -len(kinds)


def find_word_files(
    folder: str | Path, signer: str = "", table: str | Path = "", language: str = ""
) -> tuple[list[WordFile], list[str]]:
    """Return every clip below a folder, sorted by name, and the faults of file names and table, one line each.

    table: restricts the clips to those that it names; ``glosses.csv``, read otherwise, need not name all. Of a folder
    with an ``index.csv`` of spoken-to-signed its rows of a signed ``language`` are read. Searches subfolders, except
    hidden ones and links. Raises ``InputError`` if there is no clip or a folder cannot be read.
    """
    folder = Path(folder)
    files = {unicodedata.normalize("NFC", path.relative_to(folder).as_posix()): path for path in _files(folder)}
    path_of_table = Path(table or folder / TABLE)
    rows: list[GlossRow] = []
    faults: list[str] = []
    is_indexed = not table and has_index(folder)
    if is_indexed:
        path_of_table = folder / INDEX
    if table or path_of_table.exists():
        try:
            rows, faults = (read_index(path_of_table, language), []) if is_indexed else read_table(path_of_table)
        except InputError as error:
            faults = [str(error)]
    by_file: defaultdict[str, list[GlossRow]] = defaultdict(list)
    for row in rows:
        by_file[unicodedata.normalize("NFC", row.file)].append(row)
    words: list[WordFile] = []
    roles_of: dict[str, dict[str, str]] = {}
    for name, path in files.items():
        for row in by_file.pop(name, [] if table or is_indexed else [GlossRow(name)]):
            try:
                gloss = row.gloss or gloss_of(path.stem)
                named = replace(row, gloss=gloss, signer=row.signer or signer, source=row.source or row.file)
            except InputError as error:
                faults.append(f"{path}: {error}; rename the file, or name its gloss in {TABLE}")
                continue
            try:
                if row.roles and not (folder / row.roles).resolve().is_relative_to(folder.resolve()):
                    raise InputError(f"roles {row.roles[:80]!r} lie outside the folder, expected a file in it")
                if row.roles and row.roles not in roles_of:
                    roles_of[row.roles] = roles.read(folder / row.roles)
            except InputError as error:
                faults.append(f"{path_of_table}:{row.line}: {error}")
                continue
            named = replace(named, read=replace(row.read, roles=roles_of.get(row.roles)))
            where = f"{path} ({path_of_table}:{row.line})" if row.line else str(path)
            words.append(WordFile((path,), where, named, folder / row.face if row.face else None))
    lost = [row for rows in by_file.values() for row in rows]
    faults += [f"{path_of_table}:{row.line}: no clip {row.file} in {folder}" for row in lost]
    return words, faults + [fault for _, fault in _duplicates(words)]


def gather(
    folders: Sequence[str | Path], output: str | Path, recipe: str, signer: str, language: str = ""
) -> tuple[list[WordFile], list[str]]:
    """Return the words of all folders, each gloss once, and a line for each fault or, with a recipe, for each file left
    out. ``language``: as in ``find_word_files``. Raises ``InputError`` if a folder contains the output or lies in it.
    """
    words, lines, target = list[WordFile](), list[str](), Path(output).resolve()
    for folder in folders:
        read = Path(folder).resolve()
        if target.is_relative_to(read) or read.is_relative_to(target):
            raise InputError(f"{output}: lies in {folder}, which is read, or contains it; name another folder")
        if _is_archive(recipe):
            folder_words, faults = _recordings(Path(folder), _files(Path(folder)), find_recipe(recipe), signer)
        else:
            folder_words, faults = find_word_files(folder, signer, recipe, language)
        hidden = {word for word, _ in _duplicates(folder_words)} if recipe else set()
        words += (word for word in folder_words if word not in hidden)
        lines += faults
    twice = _duplicates(words) if len(folders) > 1 else []
    hidden = {word for word, _ in twice}
    lines = list(dict.fromkeys([*lines, *(line for _, line in twice)]))
    return [word for word in words if word not in hidden], lines


def _is_archive(recipe: str) -> bool:
    """Return whether a recipe is a pattern of file names, not a table."""
    return bool(recipe) and not recipe.lower().endswith(".csv")


_READ_WITH = (".bin", ".sigml")
"""Suffixes of files that are read with others, or as words: buffers of glTF, and written signs."""
_MOST_KINDS = 8
"""Most kinds of files that are counted apart."""


def unread(folders: Iterable[str | Path], words: Iterable[WordFile], recipe: str = "") -> tuple[str, ...]:
    """Return lines about files that are not read: those of an archive that hold further data of words, and files of
    other kinds, which are neither clips nor faces, roles or tables of the words.
    """
    end, reason = find_recipe(recipe).unread if _is_archive(recipe) else ("", "")
    named = {
        TABLE,
        INDEX,
        Path(recipe).name,
        *(Path(name).name for word in words for name in (word.row.face, word.row.roles)),
    }
    searched = [folder for folder in map(Path, folders) if folder.is_dir()]
    paths = {path for folder in searched for path in _visible(folder) if path.name not in named}
    read = {path for path in paths if path.suffix.lower() in (*READ_SUFFIXES, *_READ_WITH)}
    stems = {path.with_suffix("") for path in read}
    faces = {path for path in paths if path.suffix.lower() == ".csv" and path.with_suffix("") in stems}
    further = {path for path in paths if end and path.name.endswith(end)}
    lines = [f"{len(further)} files ...{end} not read: {reason}"] if further else []
    kinds = Counter(path.suffix.lower() or "no suffix" for path in paths - read - faces - further)
    if kinds:
        ranked = sorted(kinds.items(), key=lambda row: (-row[1], row[0]))
        shown = list_names([f"{kind} {count}" for kind, count in ranked], _MOST_KINDS)
        lines.append(f"{kinds.total()} file{'s' * (kinds.total() != 1)} of other kinds left: {shown}")
    return tuple(lines)


def _visible(folder: Path, fail: Callable[[OSError], None] | None = None) -> Iterator[Path]:
    """Yield every file below a folder, except hidden ones; ``fail`` gets the error of a folder that cannot be read."""
    for parent, subfolders, names in os.walk(folder, onerror=fail):
        subfolders[:] = [name for name in subfolders if not name.startswith(".")]
        yield from (Path(parent, name) for name in names if not name.startswith("."))


def _files(folder: Path) -> list[Path]:
    if not folder.is_dir():
        what = "is a file" if folder.exists() else "no such folder"
        raise InputError(f"{folder}: {what}, expected a folder of clips ({', '.join(READ_SUFFIXES)})")

    def fail(error: OSError) -> None:
        raise InputError(f"{error.filename}: cannot be read ({error.strerror})") from error

    paths = [path for path in _visible(folder, fail) if path.suffix.lower() in READ_SUFFIXES]
    if not paths:
        raise InputError(f"{folder}: no clips in it, expected files that end in {' or '.join(READ_SUFFIXES)}")
    return sorted(paths, key=lambda path: path.relative_to(folder).as_posix())


def _duplicates(words: Sequence[WordFile]) -> list[tuple[WordFile, str]]:
    """Return the words that repeat a gloss or synonym of an earlier word, each with an error line."""
    owners: dict[str, WordFile] = {}
    twice = []
    for word in words:
        for name in dict.fromkeys(map(fold, word.names)):
            owner = owners.setdefault(name, word)
            if owner is not word:
                shown = next(shown for shown in word.names if fold(shown) == name)
                line = f"{word.where}: gloss {shown!r} is that of {owner.where} too, expected different glosses"
                twice.append((word, f"{line}; name them in {TABLE}"))
    return twice
