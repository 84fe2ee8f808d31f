"""Writes folders of BVH files: a lexicon of isolated words, and sentences with the ground truth of every seam."""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from signsplice.errors import InputError
from signsplice.formats import save
from signsplice.formats.atomic import check_folder, replacing_folder
from signsplice.formats.bvh import encode
from signsplice.formats.json_files import check_type, parse_json
from signsplice.formats.reading import format_errors, opened, read_bytes
from signsplice.motion import Clip
from signsplice.progress import Progress, counted
from signsplice.signer import planner
from signsplice.signer.phonology import Sign
from signsplice.signer.planner import FPS, IsolatedWord
from signsplice.signer.signer import STANDARD, Signer, draw_signer, skeleton, stream
from signsplice.synth import running
from signsplice.synth.corpus import VERSION, Recipe

TRUTH, GLOSSES = "truth.json", "glosses.csv"
_COLUMNS = ("file", "gloss", "synonyms", "signer", "source", "checked", "kind")
_NOT_OURS = "the folder is not replaced, choose a new name"
SHORTEST, LONGEST = 3, 12
"""Number of words of a sentence."""


def write_lexicon(
    signs: Sequence[Sign],
    signer: Signer,
    folder: Path,
    fps: float = FPS,
    progress: Progress | None = None,
    seen: Callable[[IsolatedWord], None] | None = None,
) -> None:
    """Write every sign's isolated word as BVH, and ``glosses.csv`` with source, synonyms and kind; all or nothing.
    ``seen`` is shown each word.

    Raises ``InputError`` where the folder cannot be written or holds something else, or two glosses share a file name.
    """
    _check_names(signs)
    table = io.StringIO()
    rows = csv.writer(table, lineterminator="\n")
    rows.writerow(_COLUMNS)
    check_folder(folder, GLOSSES, _lexicon_files)
    with replacing_folder(folder) as made:
        for sign in counted(signs, progress):
            name = f"{file_name(sign.gloss)}.bvh"
            word = planner.isolated(sign, signer, fps=fps)
            save(word.clip, made / name)
            if seen is not None:
                seen(word)
            kind = "letter" if sign.kind == "letter" else "sign"
            rows.writerow((name, sign.gloss, ";".join(sign.synonyms), signer.name, sign.source, "no", kind))
        (made / GLOSSES).write_text(table.getvalue(), encoding="utf-8")


def _lexicon_files(folder: Path) -> list[str]:
    """The files of a lexicon that ``write_lexicon`` has written: every word unchecked, by a synthetic signer, and on
    that signer's skeleton. Raises ``InputError`` for others, which are recordings of the user.
    """
    table = folder / GLOSSES
    with format_errors(str(table), f"table of `synth lexicon`; {_NOT_OURS}"):
        rows = list(csv.reader(io.StringIO(read_bytes(table).decode("utf-8"), newline=""), strict=True))
    if tuple(rows[0] if rows else ()) != _COLUMNS:
        raise InputError(f"{table}: has other columns than a table of `synth lexicon`; {_NOT_OURS}")
    hierarchies: dict[str, bytes | None] = {}
    for line, row in enumerate(rows[1:], 2):
        words = dict(zip(_COLUMNS, row, strict=False))
        signer = words.get("signer", "")
        if signer not in hierarchies:
            hierarchies[signer] = _hierarchy(signer)
        hierarchy = hierarchies[signer]
        if len(row) != len(_COLUMNS) or words["checked"] != "no" or hierarchy is None or "/" in words["file"]:
            raise InputError(f"{table}:{line}: is no word of `synth lexicon`; {_NOT_OURS}")
        path = folder / words["file"]
        if path.exists():
            with opened(path) as (file, _):
                if file.read(len(hierarchy)) != hierarchy:
                    raise InputError(f"{path}: is on another skeleton than signer {signer}; {_NOT_OURS}")
    return [GLOSSES, *(row[0] for row in rows[1:])]


def _hierarchy(signer: str) -> bytes | None:
    """The head of the BVH files of the standard signer or a drawn one, by name; None for other names."""
    seed = re.fullmatch(r"signer-(\d{1,18})", signer)
    if seed is None and signer != STANDARD.name:
        return None
    joints = skeleton(STANDARD if seed is None else draw_signer(int(seed[1])))
    still = np.tile([1.0, 0.0, 0.0, 0.0], (1, len(joints), 1))
    return encode(Clip(joints, still, np.zeros((1, 3)), FPS)).partition(b"MOTION")[0]


def _sentence_files(folder: Path) -> list[str]:
    """The files of a folder that ``write_sentences`` has written. Raises ``InputError`` where ``truth.json`` is another
    file of this name.
    """
    truth = parse_json(read_bytes(folder / TRUTH), str(folder / TRUTH), "the truth of sentences")
    try:
        check_type(truth, dict[str, Any], TRUTH)
        check_type(truth["sentences"], list[dict[str, Any]], "sentences")
        files = [sentence["file"] for sentence in truth["sentences"]]
        words = {gloss for sentence in truth["sentences"] for gloss in sentence["glosses"]}
        check_type([*files, *words], list[str], "files and glosses")
    except (KeyError, TypeError) as error:
        raise InputError(f"{folder / TRUTH}: is no truth of `synth sentences`; {_NOT_OURS}") from error
    return [TRUTH, *files, *(f"words/{file_name(word)}.bvh" for word in words)]


def file_name(gloss: str) -> str:
    """The file name of a gloss: characters that file systems do not allow become ``_``."""
    return "".join("_" if c in '<>:"/\\|?*' or ord(c) < 32 else c for c in gloss)


def _check_names(signs: Sequence[Sign]) -> None:
    """Raise ``InputError`` where two glosses share a file name, on case-insensitive disks too."""
    taken: dict[str, str] = {}
    for sign in signs:
        name = file_name(sign.gloss)
        other = taken.setdefault(name.casefold(), sign.gloss)
        if other != sign.gloss:
            raise InputError(f"{other} and {sign.gloss} would both be {name}.bvh; give one another gloss")


def write_sentences(
    recipe: Recipe, count: int, folder: Path, changes: bool = True, progress: Progress | None = None
) -> None:
    """Write ``count`` random sentences of 3 to 12 words as BVH, the isolated words, and ``truth.json``.

    changes: let weak hands stay up and pronouns assimilate (``running``). Raises ``InputError`` as ``write_lexicon``.
    """
    _check_names(recipe.signs)
    signer = recipe.signers()[0]
    rng = stream("sentences", recipe.seed, count)
    check_folder(folder, TRUTH, _sentence_files)
    with replacing_folder(folder) as made:
        (made / "words").mkdir()
        words: dict[int, IsolatedWord] = {}
        sentences = []
        for n in counted(range(count), progress):
            chosen: list[int] = []
            for _ in range(int(rng.integers(SHORTEST, LONGEST + 1))):
                others = [k for k in range(len(recipe.signs)) if not chosen or k != chosen[-1]]
                chosen.append(others[int(rng.integers(len(others)))])
            for k in chosen:
                if k not in words:
                    words[k] = planner.isolated(recipe.signs[k], signer, fps=recipe.fps)
                    save(words[k].clip, made / "words" / f"{file_name(recipe.signs[k].gloss)}.bvh")
            sentence = running.utter([words[k] for k in chosen], changes)
            save(sentence.clip, made / f"sentence-{n:04d}.bvh")
            sentences.append(describe(sentence, f"sentence-{n:04d}.bvh"))
        head = {
            "version": VERSION,
            "hash": recipe.hash,
            "seed": recipe.seed,
            "fps": recipe.fps,
            "signer": asdict(signer),
        }
        text = json.dumps(head | {"sentences": sentences}, indent=1) + "\n"
        (made / TRUTH).write_text(text, encoding="utf-8")


def describe(sentence: running.Utterance, file: str) -> dict[str, Any]:
    """The ground truth of a sentence for JSON: glosses, spans (half-open) and seams, with the keys of a report."""
    names = [word.sign.gloss for word in sentence.words]
    spans = []
    for part in sentence.stretches:
        count = part.stop - part.start
        spans.append(
            {
                "kind": "transition" if part.word is None else "sign",
                "name": None if part.word is None else names[part.word],
                "source": None if part.source is None else [part.source, part.source + count],
                "output": [part.start, part.stop],
                "changed": list(part.changed),
            }
        )
    seams = [
        {"before": a, "after": b, "pre_frame": seam.pre, "post_frame": seam.post, "n_transition": len(seam.states)}
        for a, b, seam in zip(names[:-1], names[1:], sentence.seams, strict=True)
    ]
    return {"file": file, "glosses": names, "frames": len(sentence.clip), "spans": spans, "seams": seams}
