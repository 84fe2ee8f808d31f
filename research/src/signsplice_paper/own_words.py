"""Corpora of pairs from clips of one rig, for `signsplice-paper`, like those of the synthetic signer."""

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
    chosen_joints,
    fingerprint,
    read_words,
    space_around,
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
"""Whose positions and transitions are the truth where none are given."""
VERSION = 2
"""Of corpora of clips, whose motion is not the synthetic signer's; ``synth.pairs`` reads it."""
LONGEST = 32
"""Frames of the longest transition that the paper's systems here make; pairs with longer ones are left out."""
JUMP_CM = 40.0
"""A joint that moves farther in one frame, where a word meets its transition, stands elsewhere in the two."""


@dataclass(frozen=True)
class PairsPlan:
    """What to make a corpus of.

    - choice: the clips
    - positions: a file of positions (.json), or CUTTER+TRANSITION
    - transition: name of what fills pairs for which a file gives no transition, None for ``learned``; only with a file
    - joints: names of the joints in the numbers, None for all
    """

    choice: ClipChoice
    positions: str = BEST
    transition: str | None = None
    joints: tuple[str, ...] | None = None


@dataclass(frozen=True)
class BuiltPairs:
    """What came of it.

    - n_words, n_pairs: number of words and pairs
    - truth: where the truth comes from
    - warnings: what a user should know, one line each
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
    after: list[list[int]]
    moved: bool
    warnings: list[str] = field(default_factory=list)

    @property
    def hash(self) -> str:
        """Twelve hex digits that change with everything the corpus depends on."""
        given = {
            "version": VERSION,
            "words": fingerprint(self.rig, self.words),
            "truth": self.source.facts(),
            "space": self.space.as_json(),
            "seed": self.plan.choice.seed,
            "fps": self.plan.choice.fps,
        }
        return hashlib.sha256(json.dumps(given, sort_keys=True).encode()).hexdigest()[:12]


def build(plan: PairsPlan, folder: Path, progress: ProgressBar) -> BuiltPairs:
    """Make a corpus of all ordered pairs of the words in ``folder``. Called again after an interruption, it continues.

    Raises ``InputError`` for clips or positions that cannot be used, and where the folder holds something else or
    cannot be written.
    """
    folder = Path(folder)
    check_folder(folder, HEAD, lambda _: FILES)
    corpus = _read(plan, progress)
    target = folder.resolve()  # "." has no name of its own
    part = target.with_name(f".{target.name}-{corpus.hash}.part")
    hint = f"finished rows stay in {part.name}, and the same call continues from there"
    try:
        with resumable_folder(part):
            try:
                rows = _make_rows(corpus, part, progress)
                splits = _splits(corpus, rows)
            except InputError:  # another call will not do better with these rows
                shutil.rmtree(part, ignore_errors=True)
                raise
            with replacing_folder(folder, hint) as made:
                at = write_words(made, [(word.clip, corpus.space.numbers(word.clip)) for word in corpus.words])
                write_transitions(made, rows)
                (made / HEAD).write_text(json.dumps(_head(corpus, at, splits), indent=1) + "\n", encoding="utf-8")
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({error.strerror or error}); {hint}") from error
    n_pairs = sum(len(row.after) for row in rows)
    return BuiltPairs(len(corpus.words), n_pairs, corpus.source.name, tuple(corpus.warnings))


def _read(plan: PairsPlan, progress: ProgressBar) -> _Corpus:
    """The words, and where their truth comes from."""
    choice = plan.choice
    is_file = plan.positions.lower().endswith(".json")
    given = read_positions(Path(plan.positions)) if is_file else None
    method = None if is_file else _method(plan.positions)
    if method is not None and plan.transition is not None:
        raise InputError(
            f"--transition {plan.transition} goes with --positions FILE.json; --positions {plan.positions} names one"
        )
    with progress(f"reading {choice.folder}") as advance:
        named = None if given is None else given.glosses
        moved = given is None or not given.has_clips
        rig, words, warnings = read_words(choice, named, moved, advance)
    if method is not None:
        source: TruthSource = MethodTruth(method)
    else:
        assert given is not None
        source = FileTruth(given, rig, choice.fps, plan.transition or LEARNED, choice.limits, warnings)
        source.check(words)
        if len(words) < FEWEST:
            raise InputError(
                f"{given.path}: names {len(words)} words, expected at least {FEWEST}: a split has three parts"
            )
    joints = None if plan.joints is None else chosen_joints(rig.skeleton, plan.joints)
    space = space_around(rig, words, joints)
    if given is not None and given.space is not None:
        if joints is not None:
            raise InputError(f"{given.path}: its space names the joints; give no --joints, or take the space out")
        space = given.space
    extra_metrics.number_layout(words[0].clip, space)  # raises where hips or wrists are left out
    after = [source.after(words, p) for p in range(len(words))]
    missing = len(words) ** 2 - sum(map(len, after))
    if missing:
        warnings.append(f"{plan.positions}: gives no positions for {missing} of {len(words) ** 2} pairs; left out")
    return _Corpus(plan, rig, words, source, space, after, moved, warnings)


def _method(name: str) -> ClipMethod:
    cutter, plus, transition = name.partition("+")
    if not plus:
        raise InputError(
            f"--positions {name}, expected a file of positions (.json), or CUTTER+TRANSITION of `signsplice methods`, "
            f"such as {BEST}"
        )
    return ClipMethod(cutter, transition)


def _make_rows(corpus: _Corpus, part: Path, progress: ProgressBar) -> list[StoredRow]:
    """Make the rows' files, as far as they are not there whole; a row for every word that is left."""
    paths = [part / f"row-{p:05d}.npz" for p in range(len(corpus.words))]
    total, done = sum(map(len, corpus.after)), 0
    jumps, rows = 0, []
    with progress(f"splicing {total} pairs") as advance:
        for p, (path, after) in enumerate(zip(paths, corpus.after, strict=True)):
            if not is_whole(path):
                _make_row(corpus, path, p, after)
            with np.load(path) as arrays:
                kept = tuple(arrays["after"].tolist())
                jumps += int(arrays["jumps"])
            if kept:
                rows.append(StoredRow(path, p, kept))
            done += len(after)
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


def _make_row(corpus: _Corpus, path: Path, p: int, after: Sequence[int]) -> None:
    """Make the pairs of word ``p``, and store those that are not too long."""
    splices = dict(zip(after, corpus.source.splices(corpus.words, p, after), strict=True))
    kept = [q for q in after if len(splices[q].clip) <= LONGEST]
    numbers = {q: corpus.space.numbers(splices[q].clip) for q in kept}
    empty = corpus.words[p].clip
    clips = [splices[q].clip for q in kept]
    jumps = sum(_jumps(corpus, p, q, splices[q], numbers[q]) for q in kept)
    arrays = {
        "rotations": np.concatenate([empty.local_rotations[:0], *(clip.local_rotations for clip in clips)]),
        "roots": np.concatenate([empty.root_positions[:0], *(clip.root_positions for clip in clips)]),
        "positions": np.concatenate([np.zeros((0, corpus.space.n_numbers)), *numbers.values()]),
    }
    assert set(arrays) == set(KINDS)
    index = [(splices[q].cut.pre, splices[q].cut.post, len(splices[q].clip)) for q in kept]
    save_row(path, index, arrays, after=np.array(kept, np.int32), jumps=np.array(jumps))


def _jumps(corpus: _Corpus, p: int, q: int, splice: TrueSplice, numbers: Any) -> bool:
    """Whether a joint is far from its place in the words' frames beside a transition."""
    pre, post = splice.cut.pre, splice.cut.post
    ends = [corpus.words[p].clip[pre : pre + 1], corpus.words[q].clip[post : post + 1]]
    steps = [corpus.space.numbers(end)[0] - numbers[k] for end, k in zip(ends, (0, -1), strict=True)]
    return bool(np.linalg.norm(np.reshape(steps, (2, -1, 3)), axis=-1).max() * corpus.space.side > JUMP_CM)


def _splits(corpus: _Corpus, rows: Sequence[StoredRow]) -> dict[str, dict[str, list[int]]]:
    """The splits; a split that would lack a part is left empty. Raises ``InputError`` where that is the random one."""
    pairs = [(0, row.before, after) for row in rows for after in row.after]
    splits = draw_splits(corpus.plan.choice.seed, len(corpus.words), pairs)
    if not all(splits["random"].values()):
        raise InputError(f"{len(pairs)} pairs are too few to train, validate and test on; give more words or positions")
    if not all(splits["unseen-words"].values()):
        splits["unseen-words"] = {part: [] for part in splits["unseen-words"]}
        corpus.warnings.append(f"{len(corpus.words)} words are too few to keep some aside: split unseen-words is empty")
    return splits


def _head(corpus: _Corpus, at: Sequence[tuple[int, int]], splits: dict[str, dict[str, list[int]]]) -> dict[str, Any]:
    choice = corpus.plan.choice
    rows = [
        {
            "gloss": word.gloss,
            "signer": word.signer,
            "first": first,
            "frames": n_frames,
            "file": word.file.relative_to(choice.folder).as_posix(),
        }
        for word, (first, n_frames) in zip(corpus.words, at, strict=True)
    ]
    return {
        "version": VERSION,
        "hash": corpus.hash,
        "seed": choice.seed,
        "fps": choice.fps,
        "truth": corpus.source.name,
        "truth_from": corpus.source.facts(),
        "moved": corpus.moved,
        "skeletons": [skeletons.as_json(corpus.rig.skeleton)],
        "spaces": [corpus.space.as_json()],
        "words": rows,
        "splits": splits,
    }
