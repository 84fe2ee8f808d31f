"""Writes a lexicon of isolated words as a folder of BVH files."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from signsplice.errors import InputError
from signsplice.formats import save
from signsplice.formats.atomic import check_folder, replacing_folder
from signsplice.formats.bvh import encode
from signsplice.formats.reading import format_errors, open_file, read_bytes
from signsplice.motion import Clip
from signsplice.progress import Progress, track_progress
from signsplice.signer import planner
from signsplice.signer.phonology import Sign, owned_channels
from signsplice.signer.planner import FPS, IsolatedWord
from signsplice.signer.signer import STANDARD, Signer, draw_signer, skeleton

GLOSSES = "glosses.csv"
_COLUMNS = ("file", "gloss", "synonyms", "signer", "source", "checked", "kind", "owns")
NOT_OURS = "the folder is not replaced, choose a new name"


def write_lexicon(
    signs: Sequence[Sign],
    signer: Signer,
    folder: Path,
    fps: float = FPS,
    progress: Progress | None = None,
    seen: Callable[[IsolatedWord], None] | None = None,
) -> None:
    """Write every sign's isolated word as BVH, and ``glosses.csv`` with source, synonyms, kind and owned channels; all
    or nothing. ``seen`` is called with each word.

    Raises ``InputError`` if the folder cannot be written or holds something else, or two glosses share a file name.
    """
    check_names(signs)
    table = io.StringIO()
    rows = csv.writer(table, lineterminator="\n")
    rows.writerow(_COLUMNS)
    check_folder(folder, GLOSSES, _lexicon_files)
    with replacing_folder(folder) as new_folder:
        for sign in track_progress(signs, progress):
            name = f"{file_name(sign.gloss)}.bvh"
            word = planner.synthesize_word(sign, signer, fps=fps)
            save(word.clip, new_folder / name)
            if seen is not None:
                seen(word)
            kind = "letter" if sign.kind == "letter" else "sign"
            owned = ";".join(sorted(owned_channels(sign, signer)))
            rows.writerow((name, sign.gloss, ";".join(sign.synonyms), signer.name, sign.source, "no", kind, owned))
        (new_folder / GLOSSES).write_text(table.getvalue(), encoding="utf-8")


def _lexicon_files(folder: Path) -> list[str]:
    """The files of a lexicon of ``write_lexicon``: every word unchecked, by a synthetic signer, and on that signer's
    skeleton. Raises ``InputError`` for other folders, which hold recordings of the user.
    """
    table = folder / GLOSSES
    with format_errors(str(table), f"table of `synth lexicon`; {NOT_OURS}"):
        rows = list(csv.reader(io.StringIO(read_bytes(table).decode("utf-8"), newline=""), strict=True))
    columns = tuple(rows[0] if rows else ())
    if columns not in (_COLUMNS, _COLUMNS[:-1]):  # older folders lack the last one
        raise InputError(f"{table}: has other columns than a table of `synth lexicon`; {NOT_OURS}")
    hierarchies: dict[str, bytes | None] = {}
    for line, row in enumerate(rows[1:], 2):
        words = dict(zip(columns, row, strict=False))
        signer = words.get("signer", "")
        if signer not in hierarchies:
            hierarchies[signer] = _hierarchy(signer)
        hierarchy = hierarchies[signer]
        if len(row) != len(columns) or words["checked"] != "no" or hierarchy is None or "/" in words["file"]:
            raise InputError(f"{table}:{line}: is no word of `synth lexicon`; {NOT_OURS}")
        path = folder / words["file"]
        if path.exists():
            with open_file(path) as (file, _):
                if file.read(len(hierarchy)) != hierarchy:
                    raise InputError(f"{path}: is on another skeleton than signer {signer}; {NOT_OURS}")
    return [GLOSSES, *(row[0] for row in rows[1:])]


def lexicon_signer(seed: int) -> Signer:
    """The signer of a lexicon, and of a corpus's first words: for seed 0 the standard signer."""
    return STANDARD if seed == 0 else draw_signer(2 * seed)


def _hierarchy(signer: str) -> bytes | None:
    """The head of the BVH files of the standard signer or a drawn one, by name; None for other names."""
    seed = re.fullmatch(r"signer-(\d{1,18})", signer)
    if seed is None and signer != STANDARD.name:
        return None
    joints = skeleton(STANDARD if seed is None else draw_signer(int(seed[1])))
    still = np.tile([1.0, 0.0, 0.0, 0.0], (1, len(joints), 1))
    return encode(Clip(joints, still, np.zeros((1, 3)), FPS)).partition(b"MOTION")[0]


def file_name(gloss: str) -> str:
    """The file name of a gloss: characters that file systems do not allow become ``_``."""
    return "".join("_" if c in '<>:"/\\|?*' or ord(c) < 32 else c for c in gloss)


def check_names(signs: Sequence[Sign]) -> None:
    """Raise ``InputError`` if two glosses share a file name, also on case-insensitive disks."""
    taken: dict[str, str] = {}
    for sign in signs:
        name = file_name(sign.gloss)
        first_gloss = taken.setdefault(name.casefold(), sign.gloss)
        if first_gloss != sign.gloss:
            raise InputError(f"{first_gloss} and {sign.gloss} would both be {name}.bvh; give one another gloss")
