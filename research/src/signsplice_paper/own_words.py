"""Makes corpora of pairs from clips of one rig, for `signsplice-paper`, like those of the synthetic signer."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from signsplice.errors import InputError
from signsplice.formats import skeletons
from signsplice.formats.atomic import check_folder, replacing_folder, resumable_folder
from signsplice.splicing.learned import FLUENT
from signsplice.splicing.learned import NAME as LEARNED
from signsplice_paper import extra_metrics
from signsplice_paper.clip_methods import ClipMethod
from signsplice_paper.own_clips import (
    FEWEST,
    ClipChoice,
    OwnWord,
    Rig,
    find_joints,
    fit_space,
    hash_words,
    read_words,
)
from signsplice_paper.own_truth import FileTruth, MethodTruth, TrueSplice, TruthSource, read_positions
from signsplice_workshop.corpora.number_space import NumberSpace
from signsplice_workshop.corpora.pairs import (
    FILES,
    HEAD,
    KINDS,
    StoredRow,
    draw_splits,
    save_row,
    write_transitions,
    write_words,
)
from signsplice_workshop.corpora.pool import is_whole

ProgressBar = Callable[[str], AbstractContextManager[Callable[[int, int], None] | None]]
"""Title -> a context that yields a callback (done, total), or None."""

BEST = f"{FLUENT}+{LEARNED}"
"""The method of the true positions and transitions if none are given."""
VERSION = 2
"""Version of corpora of clips, whose motion is not the synthetic signer's; ``corpora.pairs`` reads it."""
LONGEST = 32
"""Frames of the longest transition that the paper's systems here make; pairs with longer ones are left out."""
JUMP_CM = 40.0
"""Largest move of a joint in one frame at a seam; a larger one means that word and transition stand at two places."""


@dataclass(frozen=True)
class PairsPlan:
    """The plan of a corpus.

    - choice: the clips
    - positions: a file of positions (.json), or CUTTER+TRANSITION
    - transition: name of the method that fills pairs without a transition, None for ``learned``; only with a file
    - joints: names of the joints in the numbers, None for all
    """

    choice: ClipChoice
    positions: str = BEST
    transition: str | None = None
    joints: tuple[str, ...] | None = None


@dataclass(frozen=True)
class BuiltPairs:
    """The result of building a corpus.

    - n_words, n_pairs: number of words and pairs
    - truth: the source of the truth
    - warnings: warnings for the user, one line each
    """

    n_words: int
    n_pairs: int
    truth: str
    warnings: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class _Corpus:
    """Everything that is known before the pairs are made."""

    plan: PairsPlan
    rig: Rig
    words: list[OwnWord]
    source: TruthSource
    space: NumberSpace
    followers: list[list[int]]
    moved: bool
    warnings: list[str] = field(default_factory=list)

    @property
    def hash(self) -> str:
        """Twelve hex digits that change with everything the corpus depends on."""
        content = {
            "version": VERSION,
            "words": hash_words(self.rig, self.words),
            "truth": self.source.describe(),
            "space": self.space.as_json(),
            "seed": self.plan.choice.seed,
            "fps": self.plan.choice.fps,
        }
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:12]


def build(plan: PairsPlan, folder: Path, progress: ProgressBar) -> BuiltPairs:
    """Makes a corpus of all ordered pairs of the words in ``folder``. Called again after an interruption, it continues.

    Raises ``InputError`` for clips or positions that cannot be used, and if the folder holds something else or cannot
    be written.
    """
    folder = Path(folder)
    check_folder(folder, HEAD, lambda _: FILES)
    corpus = _read_corpus(plan, progress)
    target = folder.resolve()  # "." has no name of its own
    part_folder = target.with_name(f".{target.name}-{corpus.hash}.part")
    hint = f"finished rows stay in {part_folder.name}, and the same call continues from there"
    try:
        with resumable_folder(part_folder):
            try:
                rows = _make_rows(corpus, part_folder, progress)
                splits = _draw_splits(corpus, rows)
            except InputError:  # another call will not do better with these rows
                shutil.rmtree(part_folder, ignore_errors=True)
                raise
            with replacing_folder(folder, hint) as temporary:
                word_ranges = write_words(
                    temporary, [(word.clip, corpus.space.to_numbers(word.clip)) for word in corpus.words]
                )
                write_transitions(temporary, rows)
                (temporary / HEAD).write_text(
                    json.dumps(_make_head(corpus, word_ranges, splits), indent=1) + "\n", encoding="utf-8"
                )
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({error.strerror or error}); {hint}") from error
    n_pairs = sum(len(row.after) for row in rows)
    return BuiltPairs(len(corpus.words), n_pairs, corpus.source.name, tuple(corpus.warnings))


def _read_corpus(plan: PairsPlan, progress: ProgressBar) -> _Corpus:
    """Returns the words, and the source of their truth."""
    choice = plan.choice
    is_file = plan.positions.lower().endswith(".json")
    positions = read_positions(Path(plan.positions)) if is_file else None
    method = None if is_file else _parse_method(plan.positions)
    if method is not None and plan.transition is not None:
        raise InputError(
            f"--transition {plan.transition} goes with --positions FILE.json; --positions {plan.positions} names one"
        )
    with progress(f"reading {choice.folder}") as advance:
        glosses = None if positions is None else positions.glosses
        moves_words = positions is None or not positions.has_clips
        rig, words, warnings = read_words(choice, glosses, moves_words, advance)
    if method is not None:
        source: TruthSource = MethodTruth(method)
    else:
        assert positions is not None
        source = FileTruth(positions, rig, choice.fps, plan.transition or LEARNED, choice.limits, warnings)
        source.check(words)
        if len(words) < FEWEST:
            raise InputError(
                f"{positions.path}: names {len(words)} words, expected at least {FEWEST}: a split has three parts"
            )
    joints = None if plan.joints is None else find_joints(rig.skeleton, plan.joints)
    space = fit_space(rig, words, joints)
    if positions is not None and positions.space is not None:
        if joints is not None:
            raise InputError(f"{positions.path}: its space names the joints; give no --joints, or take the space out")
        space = positions.space
    extra_metrics.make_number_layout(words[0].clip, space)  # raises if hips or wrists are left out
    followers = [source.find_followers(words, p) for p in range(len(words))]
    missing = len(words) ** 2 - sum(map(len, followers))
    if missing:
        warnings.append(f"{plan.positions}: gives no positions for {missing} of {len(words) ** 2} pairs; left out")
    return _Corpus(plan, rig, words, source, space, followers, moves_words, warnings)


def _parse_method(name: str) -> ClipMethod:
    cutter, plus, transition = name.partition("+")
    if not plus:
        raise InputError(
            f"--positions {name}, expected a file of positions (.json), or CUTTER+TRANSITION of `signsplice methods`, "
            f"such as {BEST}"
        )
    return ClipMethod(cutter, transition)


def _make_rows(corpus: _Corpus, part_folder: Path, progress: ProgressBar) -> list[StoredRow]:
    """Makes the rows' files, unless they are there whole; returns a row for every word that has pairs."""
    paths = [part_folder / f"row-{p:05d}.npz" for p in range(len(corpus.words))]
    total, done = sum(map(len, corpus.followers)), 0
    jumps, rows = 0, []
    with progress(f"splicing {total} pairs") as advance:
        for p, (path, followers) in enumerate(zip(paths, corpus.followers, strict=True)):
            if not is_whole(path):
                _make_row(corpus, path, p, followers)
            with np.load(path) as arrays:
                stored = tuple(arrays["after"].tolist())
                jumps += int(arrays["jumps"])
            if stored:
                rows.append(StoredRow(path, p, stored))
            done += len(followers)
            if advance is not None:
                advance(done, total)
    n_long = total - sum(len(row.after) for row in rows)
    if n_long:
        corpus.warnings.append(f"{n_long} of {total} pairs have transitions of more than {LONGEST} frames; left out")
    if jumps:
        corpus.warnings.append(
            f"{jumps} of {total} transitions begin or end more than {JUMP_CM:g} cm from their words: do they stand in "
            "one place?"
        )
    return rows


def _make_row(corpus: _Corpus, path: Path, p: int, followers: Sequence[int]) -> None:
    """Makes the pairs of word ``p``, and stores those that are not too long."""
    splices = dict(zip(followers, corpus.source.make_splices(corpus.words, p, followers), strict=True))
    stored = [q for q in followers if len(splices[q].clip) <= LONGEST]
    numbers = {q: corpus.space.to_numbers(splices[q].clip) for q in stored}
    word_clip = corpus.words[p].clip
    clips = [splices[q].clip for q in stored]
    jumps = sum(_has_jump(corpus, p, q, splices[q], numbers[q]) for q in stored)
    arrays = {
        "rotations": np.concatenate([word_clip.local_rotations[:0], *(clip.local_rotations for clip in clips)]),
        "roots": np.concatenate([word_clip.root_positions[:0], *(clip.root_positions for clip in clips)]),
        "positions": np.concatenate([np.zeros((0, corpus.space.n_numbers)), *numbers.values()]),
    }
    assert set(arrays) == set(KINDS)
    index = [(splices[q].cut.pre, splices[q].cut.post, len(splices[q].clip)) for q in stored]
    save_row(path, index, arrays, after=np.array(stored, np.int32), jumps=np.array(jumps))


def _has_jump(corpus: _Corpus, p: int, q: int, splice: TrueSplice, numbers: Any) -> bool:
    """Returns whether a joint at an end of a transition is far from its place in the neighbouring word's frame."""
    pre, post = splice.cut.pre, splice.cut.post
    ends = [corpus.words[p].clip[pre : pre + 1], corpus.words[q].clip[post : post + 1]]
    steps = [corpus.space.to_numbers(end)[0] - numbers[k] for end, k in zip(ends, (0, -1), strict=True)]
    return bool(np.linalg.norm(np.reshape(steps, (2, -1, 3)), axis=-1).max() * corpus.space.side > JUMP_CM)


def _draw_splits(corpus: _Corpus, rows: Sequence[StoredRow]) -> dict[str, dict[str, list[int]]]:
    """Returns the splits; a split that would lack a part is left empty. Raises ``InputError`` if the random split would
    lack one.
    """
    pairs = [(0, row.before, after) for row in rows for after in row.after]
    splits = draw_splits(corpus.plan.choice.seed, len(corpus.words), pairs)
    if not all(splits["random"].values()):
        raise InputError(f"{len(pairs)} pairs are too few to train, validate and test on; give more words or positions")
    if not all(splits["unseen-words"].values()):
        splits["unseen-words"] = {part: [] for part in splits["unseen-words"]}
        corpus.warnings.append(f"{len(corpus.words)} words are too few to keep some aside: split unseen-words is empty")
    return splits


def _make_head(
    corpus: _Corpus, word_ranges: Sequence[tuple[int, int]], splits: dict[str, dict[str, list[int]]]
) -> dict[str, Any]:
    choice = corpus.plan.choice
    rows = [
        {
            "gloss": word.gloss,
            "signer": word.signer,
            "first": first,
            "frames": n_frames,
            "file": word.file.relative_to(choice.folder).as_posix(),
        }
        for word, (first, n_frames) in zip(corpus.words, word_ranges, strict=True)
    ]
    return {
        "version": VERSION,
        "hash": corpus.hash,
        "seed": choice.seed,
        "fps": choice.fps,
        "truth": corpus.source.name,
        "truth_from": corpus.source.describe(),
        "moved": corpus.moved,
        "skeletons": [skeletons.as_json(corpus.rig.skeleton)],
        "spaces": [corpus.space.as_json()],
        "words": rows,
        "splits": splits,
    }
