"""Writes corpora of pairs of version 4, whose truth can be read from motion (``readable``).

The corpus to evaluate on (judged): all ordered pairs of the known words by one signer, and pairs of unseen words, of
unseen signers, and of both. The corpus to train on (taught): pseudo-signs, different ones by each of many signers. A
signer's words and pairs are one job and one file until the corpus is complete, so that an interrupted call continues.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from signsplice.errors import InputError
from signsplice.formats.atomic import check_folder, put_file, replacing_folder, resumable_folder
from signsplice.progress import Progress
from signsplice.signer import pose
from signsplice.signer.folders import lexicon_signer
from signsplice.signer.phonology import Sign
from signsplice.signer.planner import IsolatedWord
from signsplice.signer.signer import Signer, draw_signer, stream
from signsplice_workshop.corpora import pseudo, readable, truth
from signsplice_workshop.corpora.motion_version import MOTION_VERSION
from signsplice_workshop.corpora.pairs import EXTENT, FILES, HEAD, KINDS, normalise_positions
from signsplice_workshop.corpora.pool import Pool, is_whole
from signsplice_workshop.corpora.readable import Card
from signsplice_workshop.corpora.touches import measure_touches

VERSION = 4
"""Increase it if the constants below or ``readable`` change: a corpus's hash covers the rest of its recipe."""
TRUTH, TAUGHT = "events", "many"
"""The truth of these corpora, and the only split of one to train on."""
TAKES = 4
"""Largest number of takes of a word that are generated until one can be read."""
FIRST_SIGNER, FIRST_TAUGHT, SIGNERS_A_SEED = 500, 600, 100_000
"""Seeds of the first unseen signer and of the first signer to train on, and the distance to those of the next corpus's
seed: no corpus is evaluated on a signer that another one trains on."""
TAUGHT_MARGIN = 1.05
"""``readable.STILL_MARGIN`` of words to train on, which are never evaluated: more of them can be read."""
VALID_SIGNERS = 4
"""Number of signers of a corpus to train on whose pairs are for validation, the last ones."""


@dataclass(frozen=True)
class JudgedCorpus:
    """The corpus to evaluate on.

    signs: candidates, of which those that can be read are taken, in an order drawn by seed
    seed: seeds order, splits and the first signer (for seed 0 the standard signer)
    n_known: number of words of which all pairs are generated
    n_unseen: number of further words
    n_signers: number of unseen signers
    n_pairs: number of pairs of unseen words; as many of unseen signers, and of both
    """

    signs: tuple[Sign, ...]
    seed: int = 0
    n_known: int = 100
    n_unseen: int = 45
    n_signers: int = 5
    n_pairs: int = 1000


@dataclass(frozen=True)
class TaughtCorpus:
    """The corpus to train on: pseudo-signs of many signers.

    n_signers: number of signers, the last ``VALID_SIGNERS`` for validation
    n_words: number of words of each signer, different ones
    n_pairs: number of pairs of each signer of which transitions are generated
    seed: seeds signs and signers
    """

    n_signers: int = 64
    n_words: int = 167
    n_pairs: int = 400
    seed: int = 0


@dataclass(frozen=True)
class OwnMannerCorpus(TaughtCorpus):
    """A corpus to train shipped systems on: its signers sign in manners of their own, without holds, and events are
    where they were planned (``readable.make_word_from_plan``).

    slack: how far outside the stroke they lie, frames
    """

    slack: int = 3


Recipe = JudgedCorpus | TaughtCorpus


@dataclass(frozen=True)
class _Job:
    """One signer's words and pairs: candidates for words (signs, or seeds of pseudo-signs), how many are needed, the
    margin with which they are read, ``slack`` instead for words in the signer's own manner, and how many pairs are
    drawn for each range of words, None for all.
    """

    signer: Signer
    candidates: tuple[Sign, ...] | tuple[int, ...]
    n_words: int
    takes: int
    margin: float
    known: tuple[str, ...]
    n_pairs: tuple[int | None, int | None]
    path: Path
    slack: int | None = None


def hash_recipe(recipe: Recipe) -> str:
    """Returns twelve hex digits that change with the recipe, the signer's motion and the numbers of ``readable``.
    Increase ``VERSION`` for any other change of the rules.
    """
    rules = {k: v for k, v in vars(readable).items() if k.isupper() and isinstance(v, int | float | tuple)}
    stored = {"version": VERSION, "motion": MOTION_VERSION, "rules": rules, type(recipe).__name__: asdict(recipe)}
    return hashlib.sha256(json.dumps(stored, sort_keys=True).encode()).hexdigest()[:12]


def write_readable(recipe: Recipe, folder: Path, progress: Progress | None = None, processes: int = 2) -> Path:
    """Writes a corpus into ``folder`` and returns the folder. Called again after an interruption, it continues.

    Raises ``InputError`` if the folder holds something else or cannot be written, another call writes the same corpus,
    or too few of the signs can be read.
    """
    folder = Path(folder)
    check_folder(folder, HEAD, lambda _: FILES)
    target = folder.resolve()
    part_folder = target.with_name(f".{target.name}-{hash_recipe(recipe)}.part")
    hint = f"finished signers stay in {part_folder.name}, and the same call continues from there"
    try:
        with resumable_folder(part_folder):
            jobs = _plan_jobs(recipe, part_folder)
            pending_jobs = [job for job in jobs if not is_whole(job.path)]
            with Pool(processes) as run:
                for n_done, _ in enumerate(run(_write_signer, pending_jobs), len(jobs) - len(pending_jobs) + 1):
                    if progress is not None:
                        progress(n_done, len(jobs))
            with replacing_folder(folder, hint) as new_folder:
                _merge(recipe, jobs, new_folder)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({error.strerror or error}); {hint}") from error
    return folder


def _plan_jobs(recipe: Recipe, part_folder: Path) -> list[_Job]:
    """Returns the jobs of a recipe. The words of a judged corpus are those that can be read in its first signer's
    motion.
    """
    if isinstance(recipe, TaughtCorpus):
        slack = recipe.slack if isinstance(recipe, OwnMannerCorpus) else None
        signers = [draw_signer(FIRST_TAUGHT + SIGNERS_A_SEED * recipe.seed + k) for k in range(recipe.n_signers)]
        return [
            _Job(
                signer=readable.make_careful(signer) if slack is None else signer,
                candidates=tuple(range((1000 * recipe.seed + k) * 100_000, (1000 * recipe.seed + k + 1) * 100_000)),
                n_words=recipe.n_words,
                takes=1,
                margin=TAUGHT_MARGIN,
                known=(),
                n_pairs=(0, recipe.n_pairs),
                path=part_folder / f"signer-{k:04d}.npz",
                slack=slack,
            )
            for k, signer in enumerate(signers)
        ]
    order = stream("readable-words", recipe.seed).permutation(len(recipe.signs))
    signs = tuple(recipe.signs[k] for k in order)
    n_words = recipe.n_known + recipe.n_unseen
    first_signer = readable.make_careful(lexicon_signer(recipe.seed))
    glosses = _find_readable_glosses(signs, first_signer, n_words)
    chosen_signs = tuple(sign for sign in signs if sign.gloss in glosses)
    known = tuple(glosses[: recipe.n_known])
    n_signer_pairs = recipe.n_pairs // max(recipe.n_signers, 1)
    seeds = [FIRST_SIGNER + SIGNERS_A_SEED * recipe.seed + k for k in range(recipe.n_signers)]
    signers = [first_signer, *(readable.make_careful(draw_signer(seed)) for seed in seeds)]
    return [
        _Job(
            signer=signer,
            candidates=chosen_signs,
            n_words=n_words,
            takes=TAKES,
            margin=readable.STILL_MARGIN,
            known=known,
            n_pairs=(n_signer_pairs, n_signer_pairs) if k else (None, recipe.n_pairs),
            path=part_folder / f"signer-{k:04d}.npz",
        )
        for k, signer in enumerate(signers)
    ]


def _find_readable_glosses(signs: Sequence[Sign], signer: Signer, n_words: int) -> list[str]:
    """Returns the glosses of the first signs that can be read in the signer's motion. Raises ``InputError`` for too
    few.
    """
    glosses = []
    for sign in signs:
        if _make_readable_word(sign, signer, TAKES, readable.STILL_MARGIN) is not None:
            glosses.append(sign.gloss)
        if len(glosses) == n_words:
            return glosses
    raise InputError(f"{len(glosses)} of {len(signs)} signs can be read, expected {n_words}; ask for fewer words")


def _make_readable_word(sign: Sign, signer: Signer, takes: int, margin: float) -> tuple[IsolatedWord, Card] | None:
    """Returns the first take of a word that can be read, with its card."""
    for take in range(takes):
        word = readable.make_word(sign, signer, take, margin)
        if word is not None:
            return word
    return None


def _write_signer(job: _Job) -> None:
    """Writes a signer's words, cards and pairs."""
    words: list[tuple[IsolatedWord, Card]] = []
    for candidate in job.candidates:
        sign = pseudo.draw_sign(candidate) if isinstance(candidate, int) else candidate
        if job.slack is None:
            word = _make_readable_word(sign, job.signer, job.takes, job.margin)
        else:
            word = readable.make_word_from_plan(sign, job.signer, job.slack)
        if word is not None:
            words.append(word)
        if len(words) == job.n_words:
            break
    known = np.array([word.sign.gloss in job.known for word, _ in words])
    index, states = [], []
    rng = stream("readable-pairs", job.signer.name)
    for group, n_pairs in zip((np.flatnonzero(known), np.flatnonzero(~known)), job.n_pairs, strict=True):
        pairs = [(int(p), int(q)) for p in group for q in group]
        n_written = 0
        for k in rng.permutation(len(pairs)) if n_pairs is not None else range(len(pairs)):
            if n_pairs is not None and n_written >= n_pairs:
                break
            splice = _splice(words[pairs[k][0]], words[pairs[k][1]])
            if splice is not None:
                index.append((*pairs[k], splice.pre, splice.post, len(splice.states)))
                states.append(splice.states)
                n_written += 1
    arrays = {
        f"word_{kind}": rows for kind, rows in _make_arrays([word.states for word, _ in words], job.signer).items()
    }
    arrays |= {f"new_{kind}": rows for kind, rows in _make_arrays(states, job.signer).items()}
    rows = [
        {
            "gloss": word.sign.gloss,
            "signer": word.signer.name,
            "frames": len(word),
            "hands": word.sign.hands,
            "known": bool(is_known),
            "events": asdict(measure_touches(word)),
            "card": asdict(card),
        }
        for (word, card), is_known in zip(words, known, strict=True)
    ]
    temporary = job.path.with_name(f"_{job.path.name}")
    np.savez(temporary, index=np.array(index, np.int32).reshape(-1, 5), rows=np.array(json.dumps(rows)), **arrays)  # type: ignore[arg-type]
    put_file(temporary, job.path)


def _splice(p: tuple[IsolatedWord, Card], q: tuple[IsolatedWord, Card]) -> truth.Splice | None:
    """Returns the truth of a pair; None if its length lies within the margin or its transition is not valid."""
    pre, post = readable.find_leave_frame(p[1], q[1]), readable.find_enter_frame(p[1], q[1])
    before, after = p[0].states[pre - 2 : pre + 1], q[0].states[post : post + 3]
    n_frames = readable.count_transition_frames(before[-1], after[0], p[0].signer)
    if n_frames is None:
        return None
    states, valid = truth.synthesize_transition(n_frames, before, after, p[0])
    return truth.Splice(pre, post, states) if valid else None


def _make_arrays(states: Sequence[np.ndarray], signer: Signer) -> dict[str, np.ndarray]:
    """Returns rotations, roots and numbers of many arrays of states, one after another."""
    clip = pose.clip(np.concatenate(states), signer, readable.FPS)
    arrays = (clip.local_rotations, clip.root_positions, normalise_positions(clip, signer.stature_cm))
    return {kind: array.astype(np.float32) for kind, array in zip(KINDS, arrays, strict=True)}


def _merge(recipe: Recipe, jobs: Sequence[_Job], folder: Path) -> None:
    """Writes the corpus from all signers' files."""
    rows: list[dict[str, Any]] = []
    first_words, table = [], []
    n_frames = n_new = 0
    for job in jobs:
        with np.load(job.path) as arrays:
            index, words = arrays["index"], json.loads(str(arrays["rows"]))
        first_words.append(len(rows))
        for p, q, pre, post, count in index.tolist():
            table.append((p + len(rows), q + len(rows), pre, post, n_new, count))
            n_new += count
        for word in words:
            rows.append({**word, "first": n_frames})
            n_frames += word["frames"]
    np.save(folder / "pairs.npy", np.array(table, np.int32))
    for name in (f"{part}_{kind}" for part in ("word", "new") for kind in KINDS):
        total = n_frames if name.startswith("word") else n_new
        with (folder / f"{name}.npy").open("wb") as file:
            for number, job in enumerate(jobs):
                with np.load(job.path) as arrays:
                    array = arrays[name]
                if number == 0:
                    header = {"descr": np.lib.format.dtype_to_descr(array.dtype), "fortran_order": False}
                    np.lib.format.write_array_header_1_0(file, {**header, "shape": (total, *array.shape[1:])})
                file.write(array.tobytes())
    head = {
        "version": VERSION,
        "motion": MOTION_VERSION,
        "hash": hash_recipe(recipe),
        "seed": recipe.seed,
        "fps": readable.FPS,
        "truth": TRUTH,
        "extent": EXTENT,
        "signers": [asdict(job.signer) for job in jobs],
        "first_words": first_words,
        "words": rows,
        "splits": _divide_pairs(recipe, rows, np.array(table), first_words),
    }
    (folder / HEAD).write_text(json.dumps(head, indent=1) + "\n", encoding="utf-8")


def _divide_pairs(
    recipe: Recipe, rows: Sequence[dict[str, Any]], table: np.ndarray, first_words: Sequence[int]
) -> dict[str, dict[str, list[int]]]:
    """Returns the numbers of the pairs for training, validation and test. A corpus to train on has one split, validated
    on other signers. One to evaluate on divides the pairs of known words 80 : 10 : 10 by seed, and has three more
    tests.
    """
    signer = np.searchsorted(first_words, table[:, 0], side="right") - 1
    if isinstance(recipe, TaughtCorpus):
        first_valid_signer = recipe.n_signers - min(VALID_SIGNERS, recipe.n_signers - 1)
        parts = {
            "train": np.flatnonzero(signer < first_valid_signer),
            "valid": np.flatnonzero(signer >= first_valid_signer),
        }
        return {TAUGHT: {**{part: numbers.tolist() for part, numbers in parts.items()}, "test": []}}
    known = np.array([row["known"] for row in rows])[table[:, 0]]
    order = stream("splits", recipe.seed, recipe.n_known).permutation(np.flatnonzero((signer == 0) & known)).tolist()
    a, b = round(0.8 * len(order)), round(0.9 * len(order))
    train_and_valid = {"train": sorted(order[:a]), "valid": sorted(order[a:b])}
    tests = {
        "random": sorted(order[b:]),
        "unseen-words": np.flatnonzero((signer == 0) & ~known).tolist(),
        "unseen-signer": np.flatnonzero((signer > 0) & known).tolist(),
        "unseen-both": np.flatnonzero((signer > 0) & ~known).tolist(),
    }
    return {name: {**train_and_valid, "test": numbers} for name, numbers in tests.items()}
