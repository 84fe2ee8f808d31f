"""Exports a corpus of pairs as files that other programs read: words and true transitions as BVH, positions as JSON.

    words/000-HOUSE.bvh, ..., words/glosses.csv    every word of one signer, in order
    transitions/000-HOUSE.bvh, ...                 all transitions that leave a word, one after another
    positions.json                                 the file of positions of ``own_truth``, with the space

``own_words.build`` makes the same corpus of them again.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from signsplice.errors import InputError
from signsplice.formats import save
from signsplice.formats.atomic import check_folder, replacing_folder
from signsplice.lexicon.recordings import TABLE
from signsplice.motion import concatenate
from signsplice.signer.folders import file_name
from signsplice_paper.own_truth import read_positions
from signsplice_workshop.corpora.pairs import Pairs

Progress = Callable[[int, int], None]

POSITIONS, WORDS, TRANSITIONS = "positions.json", "words", "transitions"


def export(pairs: Pairs, folder: Path, signer: int = 0, progress: Progress | None = None) -> int:
    """Writes the words and pairs of one signer of a corpus into ``folder``, all or nothing; returns the number of
    pairs.

    Raises ``InputError`` for a signer without pairs, and if the folder cannot be written or holds something else.
    """
    numbers = [k for k, (p, _) in enumerate(pairs.index[:, :2].tolist()) if pairs.signer(p) == signer]
    if not 0 <= signer < len(pairs.spaces) or not numbers:
        raise InputError(f"--signer {signer + 1}: {pairs.folder} has no pairs of that signer")
    n_words = len(pairs.head["words"]) // len(pairs.spaces)
    first = signer * n_words
    names = [f"{k:03d}-{file_name(pairs.gloss(first + k))}.bvh" for k in range(n_words)]
    check_folder(folder, POSITIONS, lambda path: _list_files(path))
    with replacing_folder(folder) as temporary:
        (temporary / WORDS).mkdir()
        (temporary / TRANSITIONS).mkdir()
        for k, name in enumerate(names):
            save(pairs.word_clip(first + k), temporary / WORDS / name)
        (temporary / WORDS / TABLE).write_text(_format_table(pairs, first, names), encoding="utf-8")
        rows: list[dict[str, Any]] = []
        for k, name in enumerate(names):
            word_pairs = [number for number in numbers if pairs.index[number, 0] == first + k]
            if word_pairs:
                save(
                    concatenate([pairs.transition_clip(number) for number in word_pairs]),
                    temporary / TRANSITIONS / name,
                )
                rows += _make_rows(pairs, word_pairs, f"{TRANSITIONS}/{name}")
            if progress is not None:
                progress(k + 1, n_words)
        stored = {"version": 1, "space": pairs.spaces[signer].as_json(), "pairs": rows}
        (temporary / POSITIONS).write_text(json.dumps(stored, indent=1) + "\n", encoding="utf-8")
    return len(numbers)


def _make_rows(pairs: Pairs, numbers: list[int], clip: str) -> list[dict[str, Any]]:
    """Returns the rows of pairs whose transitions follow one another in a clip."""
    index = pairs.index[numbers].tolist()
    stops = np.cumsum([row[5] for row in index]).tolist()
    return [
        {
            "before": pairs.gloss(p),
            "after": pairs.gloss(q),
            "pre": pre,
            "post": post,
            "clip": clip,
            "frames": [stop - count, stop],
        }
        for (p, q, pre, post, _, count), stop in zip(index, stops, strict=True)
    ]


def _format_table(pairs: Pairs, first: int, names: list[str]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("file", "gloss", "signer"))
    for k, name in enumerate(names, start=first):
        writer.writerow((name, pairs.gloss(k), pairs.head["words"][k]["signer"]))
    return text.getvalue()


def _list_files(folder: Path) -> list[str]:
    """Returns the files of an earlier export. Raises ``InputError`` for other positions than ``export`` writes."""
    positions = read_positions(folder / POSITIONS)
    clips = {pair.clip for pair in positions.pairs.values() if pair.clip is not None}
    words = {f"{WORDS}/{path.name}" for path in (folder / WORDS).glob("[0-9][0-9][0-9]*-*.bvh")}
    return [POSITIONS, f"{WORDS}/{TABLE}", *sorted(clips | words)]
