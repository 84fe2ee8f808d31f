"""Corpora of ground-truth splices: every word once, every pair as an index and its transition, all memory-mapped.

A corpus of pairs is a folder:

    corpus.json                    recipe, its hash, kind of truth, words with their events, signers, splits
    word_rotations.npy   (F, 53, 4) float32   local rotations of every word's frames, word after word
    word_roots.npy       (F, 3)     float32   root positions, cm
    word_positions.npy   (F, 159)   float32   joint positions, scaled into [-0.5, 0.5]
    pairs.npy            (P, 6)     int32     word before, word after, pre, post, first transition frame, their number
    new_rotations.npy, new_roots.npy, new_positions.npy   the same of all transitions, pair after pair

The utterance of a pair is, in each of the three, before[: pre + 1], new[first : first + n], after[post:] (eq. 17).

This is version 2. ``Pairs`` also reads version 1, whose truth is of kind partner, whose events tell touches of the
notation, and whose signers have no manner; the tag ``corpus-v1`` of this project makes it.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from signsplice.errors import InputError
from signsplice.formats.atomic import check_folder, put_file, replacing_folder, resumable_folder
from signsplice.formats.json_files import check_type, parse_json
from signsplice.formats.npz import mapped_array
from signsplice.formats.reading import read_bytes
from signsplice.motion import kinematics
from signsplice.motion.clip import Clip
from signsplice.synth import planner, pose, truth
from signsplice.synth.events import Events
from signsplice.synth.parts import is_whole
from signsplice.synth.phonology import Sign
from signsplice.synth.planner import IsolatedWord
from signsplice.synth.pool import Pool
from signsplice.synth.rng import stream
from signsplice.synth.signer import STANDARD, Signer, draw_signer, read_signer, skeleton
from signsplice.synth.splits import draw_splits

Float = NDArray[np.float64]
Array = NDArray[Any]
Progress = Callable[[int, int], None]

VERSION = 2
"""Raised with every change of the motion: the same recipe with another version is another corpus."""
READABLE = (1, 2)
"""Versions that ``Pairs`` reads."""

EXTENT = 1.3
"""Side of the cube, in statures, that is scaled to [-0.5, 0.5]^3: wide enough for every reach."""

HEAD = "corpus.json"
_KINDS = ("rotations", "roots", "positions")
_FILES = (HEAD, "pairs.npy", *(f"{part}_{kind}.npy" for part in ("word", "new") for kind in _KINDS))


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


def scaled_positions(clip: Clip, stature_cm: float) -> Float:
    """Joint positions (T, 3 J) of a clip in [-0.5, 0.5]: cm from the middle of the body's height, over ``EXTENT``
    statures.
    """
    positions = kinematics.forward(clip)[1]
    return np.asarray(((positions - _middle(stature_cm)) / (EXTENT * stature_cm)).reshape(len(positions), -1))


def unscaled_positions(numbers: Float, stature_cm: float) -> Float:
    """Joint positions (T, J, 3), cm, of scaled ones (T, 3 J)."""
    return np.asarray(numbers.reshape(len(numbers), -1, 3) * (EXTENT * stature_cm) + _middle(stature_cm))


def _middle(stature_cm: float) -> Float:
    return np.array([0.0, 0.5 * stature_cm, 0.0])


class _PairRow(NamedTuple):
    """All pairs of one signer (0 or 1) and one word before: the signs' indices before and after."""

    signer: int
    before: int
    after: tuple[int, ...]

    def path(self, part: Path) -> Path:
        """Where the row is stored until the corpus is complete."""
        return part / f"row-{self.signer}-{self.before:05d}.npz"


def write_pairs(recipe: Recipe, folder: Path, progress: Progress | None = None, processes: int = 2) -> Path:
    """Make a corpus of all ordered pairs in ``folder`` and return the folder. Called again after an interruption, it
    continues.

    Raises ``InputError`` where the folder holds something else or cannot be written, or another call makes the same.
    """
    folder = Path(folder)
    truth.by_partner(recipe.truth)
    check_folder(folder, HEAD, lambda _: _FILES)
    target = folder.resolve()  # "." has no name of its own
    part = target.with_name(f".{target.name}-{recipe.hash}.part")
    hint = f"finished rows stay in {part.name}, and the same call continues from there"
    try:
        with resumable_folder(part):
            rows = _rows(recipe)
            words = _write_rows(recipe, rows, part, progress, processes)
            with replacing_folder(folder, hint) as made:
                _write_words(made, words)
                _write_new(made, part, rows, len(recipe.signs))
                splits = draw_splits(
                    recipe.seed, len(recipe.signs), [(row.signer, row.before, q) for row in rows for q in row.after]
                )
                head = _head(recipe, words, splits)
                (made / HEAD).write_text(json.dumps(head, indent=1) + "\n", encoding="utf-8")
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({error.strerror or error}); {hint}") from error
    return folder


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
    temporary = path.with_name(f"_{path.name}")
    np.savez(
        temporary,
        index=np.array(index, np.int32),
        rotations=clip.local_rotations.astype(np.float32),
        roots=clip.root_positions.astype(np.float32),
        positions=scaled_positions(clip, p.signer.stature_cm).astype(np.float32),
    )
    put_file(temporary, path)
    return row


def _write_words(part: Path, words: Sequence[Sequence[IsolatedWord]]) -> None:
    every = [word for signed in words for word in signed]
    np.save(part / "word_rotations.npy", np.concatenate([w.clip.local_rotations for w in every]).astype(np.float32))
    np.save(part / "word_roots.npy", np.concatenate([w.clip.root_positions for w in every]).astype(np.float32))
    positions = [scaled_positions(w.clip, w.signer.stature_cm) for w in every]
    np.save(part / "word_positions.npy", np.concatenate(positions).astype(np.float32))


def _write_new(made: Path, part: Path, rows: Sequence[_PairRow], n: int) -> None:
    """Concatenate the rows' files into one array each, reading one row at a time."""
    table = []
    first = 0
    for row in rows:
        with np.load(row.path(part)) as arrays:
            index = arrays["index"]
        for q, (pre, post, count) in zip(row.after, index.tolist(), strict=True):
            table.append((row.signer * n + row.before, row.signer * n + q, pre, post, first, count))
            first += count
    np.save(made / "pairs.npy", np.array(table, np.int32))
    shapes = {"rotations": (first, 53, 4), "roots": (first, 3), "positions": (first, 159)}
    for kind in _KINDS:
        with (made / f"new_{kind}.npy").open("wb") as out:  # not memory-mapped: a full disk would end the process
            header = {"descr": np.lib.format.dtype_to_descr(np.dtype(np.float32)), "fortran_order": False}
            np.lib.format.write_array_header_1_0(out, {**header, "shape": shapes[kind]})
            for row in rows:
                with np.load(row.path(part)) as arrays:
                    out.write(arrays[kind].tobytes())


def _head(
    recipe: Recipe, words: Sequence[Sequence[IsolatedWord]], splits: dict[str, dict[str, list[int]]]
) -> dict[str, Any]:
    rows = []
    first = 0
    for word in (word for signed in words for word in signed):
        rows.append(
            {
                "gloss": word.sign.gloss,
                "signer": word.signer.name,
                "first": first,
                "frames": len(word),
                "hands": word.sign.hands,
                "events": asdict(word.events),
            }
        )
        first += len(word)
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


class Pairs:
    """A corpus of pairs on disk, its arrays memory-mapped. Pairs and words go by number; ``len`` counts the pairs.

    by_partner: whether the cuts of a word depend on its partner, too
    signers: the two signers of the recipe
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        head = self.folder / HEAD
        if not head.exists():
            raise InputError(f"{self.folder}: has no {HEAD}, expected a corpus of pairs (`signsplice synth pairs`)")
        try:
            self.head: dict[str, Any] = parse_json(read_bytes(head), str(head), "a corpus of pairs")
            check_type(self.head, dict[str, Any], HEAD)
            self.index = mapped_array(self.folder / "pairs.npy")
            self.words = {k: mapped_array(self.folder / f"word_{k}.npy") for k in _KINDS}
            self.new = {k: mapped_array(self.folder / f"new_{k}.npy") for k in _KINDS}
            self.by_partner = truth.by_partner(self.head.get("truth", "partner"))
            self.signers = tuple(read_signer(row) for row in self.head.get("signers", []))
        except (OSError, TypeError, ValueError, InputError) as error:
            hint = "make one with `signsplice synth pairs`"
            raise InputError(f"{self.folder}: is no corpus of pairs ({error}); {hint}") from error
        if self.head.get("version") not in READABLE:
            expected = " or ".join(map(str, READABLE))
            raise InputError(f"{self.folder}: version {self.head.get('version')}, expected {expected}; make it again")

    def __len__(self) -> int:
        return len(self.index)

    @property
    def version(self) -> int:
        """1 or 2."""
        return int(self.head["version"])

    def split(self, name: str, part: str) -> list[int]:
        """Pair numbers of a part (train, valid, test) of a split. Raises ``InputError`` for unknown names."""
        try:
            return list(self.head["splits"][name][part])
        except KeyError:
            raise InputError(f"no split {name} {part}, expected one of {', '.join(self.head['splits'])}") from None

    def word(self, number: int, kind: str = "positions") -> Array:
        """A word's frames (N, ...): positions (159), rotations (53, 4) or roots (3)."""
        row = self.head["words"][number]
        return np.asarray(self.words[kind][row["first"] : row["first"] + row["frames"]])

    def events(self, number: int) -> Events:
        """A word's events; those of version 1 have no skin distances."""
        row = self.head["words"][number]["events"]
        first = tuple(row["first"]) if row["first"] else None
        return Events(**{**row, "first": first, "passes": tuple(tuple(p) for p in row["passes"])})

    def truth(self, number: int, kind: str = "positions") -> tuple[int, int, Array]:
        """pre, post and the true transition (n, ...) of a pair."""
        _, _, pre, post, first, count = self.index[number].tolist()
        return pre, post, np.asarray(self.new[kind][first : first + count])

    def utterance(self, number: int, kind: str = "positions") -> Array:
        """A pair's utterance (T, ...): the frames kept and the transition between (eq. 17)."""
        p, q = self.index[number, :2].tolist()
        pre, post, new = self.truth(number, kind)
        return np.concatenate([self.word(p, kind)[: pre + 1], new, self.word(q, kind)[post:]])

    def clip(self, number: int) -> Clip:
        """A pair's utterance as a clip."""
        p, q = self.index[number, :2].tolist()
        name = f"{self.head['words'][p]['gloss']} {self.head['words'][q]['gloss']}"
        return self._clip(self.utterance(number, "rotations"), self.utterance(number, "roots"), p, name)

    def word_clip(self, number: int) -> Clip:
        """A word as a clip."""
        return self._clip(
            self.word(number, "rotations"), self.word(number, "roots"), number, self.head["words"][number]["gloss"]
        )

    def _clip(self, rotations: Array, roots: Array, word: int, name: str) -> Clip:
        signer = self.signers[0 if word < len(self.head["words"]) // 2 else 1]
        return Clip(skeleton(signer), rotations.astype(np.float64), roots.astype(np.float64), self.head["fps"], name)
