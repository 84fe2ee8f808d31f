"""Corpora of ground-truth splices by two synthetic signers, as folders of ``pairs``.

This is version 3. Earlier commits of this project (``MADE_BY``) make version 1, whose truth is of kind partner, whose
events tell touches of the notation, and whose signers have no manner; and version 2, whose signers turn their heads at
random and hold still longer.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from signsplice.errors import InputError
from signsplice.formats.atomic import check_folder, replacing_folder, resumable_folder
from signsplice.motion import Clip, FloatArray
from signsplice.progress import Progress
from signsplice.signer import planner, pose
from signsplice.signer.phonology import Sign
from signsplice.signer.planner import IsolatedWord
from signsplice.signer.signer import STANDARD, Signer, draw_signer, stream
from signsplice.synth import pairs as storing
from signsplice.synth import truth
from signsplice.synth.pairs import EXTENT, FILES, HEAD, Pairs, StoredRow, signer_space
from signsplice.synth.pool import Pool, is_whole

VERSION = 3
"""Raised with every change of the motion: the same recipe with another version is another corpus."""
MADE_BY = {1: "c5abc78a609a948fbc99a3267faac73027bdb4d9", 2: "282f865c197c93cc22ffe320557550ef72876836"}
"""Commits of this project that make earlier versions."""

__all__ = ["EXTENT", "VERSION", "Pairs", "Recipe", "scaled_positions", "write_pairs"]


@dataclass(frozen=True)
class Recipe:
    """What a corpus of pairs is made of.

    signs: the signs, in order
    seed: of the signers and the splits
    fps: frame rate
    n_other: how many pairs a second signer makes, for the split of unseen signers
    truth: what the cuts depend on, one of ``truth.KINDS``
    """

    signs: tuple[Sign, ...]
    seed: int = 0
    fps: float = 30.0
    n_other: int = 1000
    truth: str = "partner"

    @property
    def hash(self) -> str:
        """Twelve hex digits that change with everything the corpus depends on."""
        text = json.dumps({"version": VERSION, **asdict(self)}, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:12]

    def signers(self) -> tuple[Signer, Signer]:
        """The signer of all pairs (for seed 0 the standard signer), and the second signer."""
        first = STANDARD if self.seed == 0 else draw_signer(2 * self.seed)
        return first, draw_signer(2 * self.seed + 1)


def scaled_positions(clip: Clip, stature_cm: float) -> FloatArray:
    """The numbers (T, 3 J) of a synthetic signer's clip (``signer_space``)."""
    return signer_space(clip.skeleton, stature_cm).numbers(clip)


class _PairRow(NamedTuple):
    """All pairs of one signer (0 or 1) and one word before: the signs' indices before and after."""

    signer: int
    before: int
    after: tuple[int, ...]

    def path(self, part: Path) -> Path:
        """Where the row is stored until the corpus is complete."""
        return part / f"row-{self.signer}-{self.before:05d}.npz"

    def stored(self, part: Path, n: int) -> StoredRow:
        """The row with the numbers of its words in a corpus of ``n`` words a signer."""
        first = self.signer * n
        return StoredRow(self.path(part), first + self.before, tuple(first + q for q in self.after))


def write_pairs(recipe: Recipe, folder: Path, progress: Progress | None = None, processes: int = 2) -> Path:
    """Make a corpus of all ordered pairs in ``folder`` and return the folder. Called again after an interruption, it
    continues.

    Raises ``InputError`` where the folder holds something else or cannot be written, or another call makes the same.
    """
    folder = Path(folder)
    truth.by_partner(recipe.truth)
    check_folder(folder, HEAD, _files_of)
    target = folder.resolve()  # "." has no name of its own
    part = target.with_name(f".{target.name}-{recipe.hash}.part")
    hint = f"finished rows stay in {part.name}, and the same call continues from there"
    try:
        with resumable_folder(part):
            rows = _rows(recipe)
            words = _write_rows(recipe, rows, part, progress, processes)
            with replacing_folder(folder, hint) as made:
                every = [word for signed in words for word in signed]
                at = storing.write_words(made, [(w.clip, scaled_positions(w.clip, w.signer.stature_cm)) for w in every])
                storing.write_transitions(made, [row.stored(part, len(recipe.signs)) for row in rows])
                splits = draw_splits(
                    recipe.seed, len(recipe.signs), [(row.signer, row.before, q) for row in rows for q in row.after]
                )
                head = _head(recipe, list(zip(every, at, strict=True)), splits)
                (made / HEAD).write_text(json.dumps(head, indent=1) + "\n", encoding="utf-8")
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({error.strerror or error}); {hint}") from error
    return folder


def _files_of(folder: Path) -> Sequence[str]:
    """The files of a corpus. Raises ``InputError`` for one of another version, which other code has made."""
    version = Pairs(folder).version
    if version != VERSION:
        raise InputError(
            f"{folder}: holds a corpus of version {version}, and version {VERSION} is made; choose a new name"
        )
    return FILES


def _write_rows(
    recipe: Recipe, rows: Sequence[_PairRow], part: Path, progress: Progress | None, processes: int
) -> list[list[IsolatedWord]]:
    """Write the rows' files, as far as they are not there whole; returns the words of both signers."""
    todo = [row for row in rows if not is_whole(row.path(part))]
    total, done = sum(len(row.after) for row in rows), sum(len(row.after) for row in rows if row not in todo)
    with Pool(processes) as run:
        words = [list(run(_word, [(sign, signer, recipe.fps) for sign in recipe.signs])) for signer in recipe.signers()]
        jobs = ((row.path(part), words[row.signer], row, truth.by_partner(recipe.truth)) for row in todo)
        for row in run(_write_row, jobs):
            done += len(row.after)
            if progress is not None:
                progress(done, total)
    return words


def _rows(recipe: Recipe) -> list[_PairRow]:
    """All pairs of the first signer, and ``n_other`` pairs of the second, drawn by seed."""
    n = len(recipe.signs)
    rows = [_PairRow(0, p, tuple(range(n))) for p in range(n)]
    chosen = np.sort(stream("other-signer", recipe.seed, n).permutation(n * n)[: recipe.n_other])
    rows += [_PairRow(1, p, tuple(int(c % n) for c in chosen if c // n == p)) for p in range(n)]
    return [row for row in rows if row.after]


def _word(job: tuple[Sign, Signer, float]) -> IsolatedWord:
    sign, signer, fps = job
    return planner.isolated(sign, signer, fps=fps)


def _write_row(job: tuple[Path, list[IsolatedWord], _PairRow, bool]) -> _PairRow:
    """Write a row's transitions into a file of its own."""
    path, words, row, partner = job
    p = words[row.before]
    states, index = [], []
    for q in row.after:
        splice = truth.splice(p, words[q], partner=partner)
        states.append(splice.states)
        index.append((splice.pre, splice.post, len(splice.states)))
    clip = pose.clip(np.concatenate(states), p.signer, p.clip.fps)
    positions = scaled_positions(clip, p.signer.stature_cm)
    frames = {"rotations": clip.local_rotations, "roots": clip.root_positions, "positions": positions}
    storing.save_row(path, index, frames)
    return row


def _head(
    recipe: Recipe,
    words: Sequence[tuple[IsolatedWord, tuple[int, int]]],
    splits: dict[str, dict[str, list[int]]],
) -> dict[str, Any]:
    rows = [
        {
            "gloss": word.sign.gloss,
            "signer": word.signer.name,
            "first": first,
            "frames": n_frames,
            "hands": word.sign.hands,
            "events": asdict(word.events),
        }
        for word, (first, n_frames) in words
    ]
    return {
        "version": VERSION,
        "hash": recipe.hash,
        "seed": recipe.seed,
        "fps": recipe.fps,
        "truth": recipe.truth,
        "extent": EXTENT,
        "signers": [asdict(signer) for signer in recipe.signers()],
        "words": rows,
        "splits": splits,
    }


def draw_splits(seed: int, n_words: int, pairs: Sequence[tuple[int, int, int]]) -> dict[str, dict[str, list[int]]]:
    """Numbers of the pairs (signer, word before, word after) for training, validation and test, by seed.

    random: pairs drawn 80 : 10 : 10 (the paper's protocol; the paper does not print its ratio). unseen-words: words
    drawn 70 : 10 : 20; a pair belongs where both of its words do, and other pairs are left out. unseen-signer: training
    and validation of random, tested on the second signer.
    """
    rng = stream("splits", seed, n_words)
    first = [k for k, (signer, _, _) in enumerate(pairs) if signer == 0]
    order = rng.permutation(first).tolist()
    a, b = round(0.8 * len(order)), round(0.9 * len(order))
    random = {"train": sorted(order[:a]), "valid": sorted(order[a:b]), "test": sorted(order[b:])}
    words = rng.permutation(n_words).tolist()
    a, b = round(0.7 * n_words), round(0.8 * n_words)
    groups = {"train": set(words[:a]), "valid": set(words[a:b]), "test": set(words[b:])}
    unseen = {
        name: [k for k in first if pairs[k][1] in group and pairs[k][2] in group] for name, group in groups.items()
    }
    others = [k for k, (signer, _, _) in enumerate(pairs) if signer == 1]
    return {
        "random": random,
        "unseen-words": unseen,
        "unseen-signer": {"train": random["train"], "valid": random["valid"], "test": others},
    }
