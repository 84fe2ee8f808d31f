"""Folders of BVH: a lexicon of isolated words, and sentences with the truth of every seam."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from signsplice.errors import InputError
from signsplice.formats import bvh
from signsplice.formats.atomic import replacing_folder
from signsplice.synth import planner, running
from signsplice.synth.corpus import VERSION, Recipe
from signsplice.synth.phonology import Sign
from signsplice.synth.planner import IsolatedWord
from signsplice.synth.rng import stream
from signsplice.synth.signer import Signer

Progress = Callable[[int, int], None]

TRUTH, GLOSSES = "truth.json", "glosses.csv"
SHORTEST, LONGEST = 3, 12
"""Words of a sentence."""


def write_lexicon(
    signs: Sequence[Sign], who: Signer, folder: Path, fps: float = planner.FPS, progress: Progress | None = None
) -> None:
    """Write every sign's isolated word as BVH, and ``glosses.csv`` with source, synonyms and kind; whole or not at all.

    Raises ``InputError`` where the folder cannot be written or holds something else, or two glosses make one file name.
    """
    _check_names(signs)
    table = io.StringIO()
    rows = csv.writer(table, lineterminator="\n")
    rows.writerow(("file", "gloss", "synonyms", "signer", "source", "checked", "kind"))
    with replacing_folder(folder, GLOSSES) as made:
        for n, sign in enumerate(signs, 1):
            name = f"{file_name(sign.gloss)}.bvh"
            bvh.write(planner.isolated(sign, who, fps=fps).clip, made / name)
            kind = "letter" if sign.kind == "letter" else "sign"
            rows.writerow((name, sign.gloss, ";".join(sign.synonyms), who.name, sign.source, "no", kind))
            if progress is not None:
                progress(n, len(signs))
        (made / GLOSSES).write_text(table.getvalue(), encoding="utf-8")


def file_name(gloss: str) -> str:
    """A gloss as a file's name: what file systems take amiss becomes ``_``."""
    return "".join("_" if c in '<>:"/\\|?*' or ord(c) < 32 else c for c in gloss)


def _check_names(signs: Sequence[Sign]) -> None:
    """Raise ``InputError`` where two glosses would be one file, also on disks that do not tell capitals."""
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

    changes: let weak hands stay and pronouns assimilate (``running``). Raises ``InputError`` as ``write_lexicon`` does.
    """
    _check_names(recipe.signs)
    who = recipe.signers()[0]
    rng = stream("sentences", recipe.seed, count)
    with replacing_folder(folder, TRUTH) as made:
        (made / "words").mkdir()
        words: dict[int, IsolatedWord] = {}
        sentences = []
        for n in range(count):
            chosen: list[int] = []
            for _ in range(int(rng.integers(SHORTEST, LONGEST + 1))):
                others = [k for k in range(len(recipe.signs)) if not chosen or k != chosen[-1]]
                chosen.append(others[int(rng.integers(len(others)))])
            for k in chosen:
                if k not in words:
                    words[k] = planner.isolated(recipe.signs[k], who, fps=recipe.fps)
                    bvh.write(words[k].clip, made / "words" / f"{file_name(recipe.signs[k].gloss)}.bvh")
            said = running.utter([words[k] for k in chosen], changes)
            bvh.write(said.clip, made / f"sentence-{n:04d}.bvh")
            sentences.append(describe(said, f"sentence-{n:04d}.bvh"))
            if progress is not None:
                progress(n + 1, count)
        head = {"version": VERSION, "hash": recipe.hash, "seed": recipe.seed, "fps": recipe.fps, "signer": asdict(who)}
        text = json.dumps(head | {"sentences": sentences}, indent=1) + "\n"
        (made / TRUTH).write_text(text, encoding="utf-8")


def describe(said: running.Utterance, file: str) -> dict[str, Any]:
    """The truth of a sentence for JSON: glosses, spans (half-open) and seams, named as in a splice's report."""
    glosses = [word.sign.gloss for word in said.words]
    spans = []
    for part in said.stretches:
        count = part.stop - part.start
        spans.append(
            {
                "kind": "transition" if part.word is None else "sign",
                "name": None if part.word is None else glosses[part.word],
                "source": None if part.source is None else [part.source, part.source + count],
                "output": [part.start, part.stop],
                "changed": list(part.changed),
            }
        )
    seams = [
        {"before": a, "after": b, "pre_frame": seam.pre, "post_frame": seam.post, "n_transition": len(seam.states)}
        for a, b, seam in zip(glosses[:-1], glosses[1:], said.seams, strict=True)
    ]
    return {"file": file, "glosses": glosses, "frames": len(said.clip), "spans": spans, "seams": seams}
