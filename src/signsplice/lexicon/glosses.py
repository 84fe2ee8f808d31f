"""``glosses.csv``: metadata of the clips of a folder that file names do not hold."""

from __future__ import annotations

import csv
import io
import math
from dataclasses import dataclass
from pathlib import Path

from signsplice.errors import FormatError, InputError
from signsplice.formats.reading import read_bytes
from signsplice.lexicon.entry import gloss_of, kind_of

TABLE = "glosses.csv"
COLUMNS = ("file", "gloss", "synonyms", "signer", "source", "checked", "kind", "start", "end", "variant",
           "face")  # fmt: skip
_CHECKED = {"": False, "no": False, "unknown": False, "yes": True}


@dataclass(frozen=True)
class GlossRow:
    """A row of the table, checked; fields that the table leaves out are empty.

    file: path of the clip, relative to the folder.
    gloss, synonyms, signer, source, checked, kind: as in ``Entry``.
    line: number of the row in the table, 0 without one.
    span: start and end of the word in seconds; None where it begins or ends with the clip.
    face: path of the clip's face, relative to the folder.
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


def read(path: str | Path) -> tuple[list[GlossRow], list[str]]:
    """The rows, and every fault of the table as a line ``FILE:LINE: what, expected what``.

    The table is UTF-8 with commas and a header of ``file`` and any other of ``COLUMNS``; synonyms are separated by
    ``;``; checked is yes or no; a file has several rows where start or end tells its
    words apart. Raises ``InputError`` where the file cannot be read, ``FormatError`` where its header is wrong.
    """
    file = str(path)
    try:
        text = read_bytes(path).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b"\n") + 1
        raise FormatError("is not UTF-8, expected a table saved as UTF-8", file=file, line=line) from error
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
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
        span=(_seconds(fields["start"]), _seconds(fields["end"])),
        face=_path(fields["face"]),
    )


def _path(cell: str) -> str:
    """A path relative to the folder, as it is named everywhere."""
    return cell.replace("\\", "/").removeprefix("./")


def _seconds(cell: str) -> float | None:
    """A time in seconds; None where the cell is empty."""
    try:
        time = float(cell) if cell else None
    except ValueError:
        time = math.nan
    if time is not None and not 0.0 <= time < math.inf:
        raise InputError(f"time {cell[:40]!r}, expected seconds")
    return time
