"""Corpora of pairs: each word stored once, each pair as an index row and its transition, all memory-mapped.

A corpus of pairs is a folder:

    corpus.json                    recipe, its hash, kind of truth, words, splits; signers and number spaces
    word_rotations.npy   (F, J, 4)  float32   local rotations of every word's frames, word after word
    word_roots.npy       (F, 3)     float32   root positions, cm
    word_positions.npy   (F, 3 K)   float32   the numbers: positions of K joints, scaled into [-0.5, 0.5]
    pairs.npy            (P, 6)     int32     word before, word after, pre, post, first transition frame, their number
    new_rotations.npy, new_roots.npy, new_positions.npy   the same of all transitions, pair after pair

The utterance of a pair is, in each of the three, before[: pre + 1], new[first : first + n], after[post:] (eq. 17).

Words are grouped by signer, equally many each, or "first_words" gives the first word of each signer. Corpora of clips
(`signsplice-paper pairs build`) store the "skeletons" and "spaces" of their signers, and whether words were "moved" to
the origin; those of synthetic signers store the "signers", from which skeletons and spaces follow, with all 53 joints
in the numbers.

``write_pairs`` writes corpora of version 3, with two synthetic signers. Earlier commits of this project (``MADE_BY``)
write version 1, whose truth is of kind partner, whose events record touches of the notation, and whose signers have no
manner; and version 2, whose signers turn their heads at random and hold still longer.
"""

from __future__ import annotations

import bisect
import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from signsplice.errors import FormatError, InputError
from signsplice.formats import skeletons
from signsplice.formats.atomic import check_folder, put_file, replacing_folder, resumable_folder
from signsplice.formats.json_files import check_type, parse_json
from signsplice.formats.reading import format_errors, open_file, read_bytes
from signsplice.motion import Clip, FloatArray, Skeleton
from signsplice.progress import Progress
from signsplice.signer import planner, pose
from signsplice.signer.folders import lexicon_signer
from signsplice.signer.phonology import Sign
from signsplice.signer.planner import IsolatedWord
from signsplice.signer.signer import Manner, Signer, draw_signer, skeleton, stream
from signsplice_workshop.corpora import truth
from signsplice_workshop.corpora.motion_version import MOTION_VERSION
from signsplice_workshop.corpora.number_space import NumberSpace, make_space, read_space
from signsplice_workshop.corpora.pool import Pool, is_whole
from signsplice_workshop.corpora.touches import SeenEvents, measure_touches, with_touches

Array = NDArray[Any]

READABLE = (1, 2, 3, 4)
"""Versions that ``Pairs`` reads."""

HEAD = "corpus.json"
KINDS = ("rotations", "roots", "positions")
FILES = (HEAD, "pairs.npy", *(f"{part}_{kind}.npy" for part in ("word", "new") for kind in KINDS))


def _open_memmap(path: Path) -> NDArray[Any]:
    """Returns the array of a ``.npy`` file, memory-mapped. Raises ``InputError`` as ``open_file`` does, or if it is no
    array.
    """
    with open_file(path), format_errors(str(path), "array"):  # a pipe is refused here: numpy would wait for a writer
        array: NDArray[Any] = np.lib.format.open_memmap(path, mode="r")
    return array


class Pairs:
    """A corpus of pairs on disk, its arrays memory-mapped. Pairs and words have numbers; ``len`` counts the pairs.

    - truth_kind: origin of the truth: a kind of the synthetic signer's, or the file or method of other clips
    - by_partner: whether the cuts of a word depend on its partner, too; True for other clips
    - signers: the synthetic signers; none if the words are clips of other origin
    - skeletons: the signers' skeletons, in cm
    - spaces: the number space of each signer's frames
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        head = self.folder / HEAD
        if not head.exists():
            raise InputError(
                f"{self.folder}: has no {HEAD}, expected a corpus of pairs (`signsplice synth pairs`), or one of "
                "clips (`signsplice-paper pairs build`)"
            )
        try:
            self.head: dict[str, Any] = parse_json(read_bytes(head), str(head), "a corpus of pairs")
            check_type(self.head, dict[str, Any], HEAD)
            self.index = _open_memmap(self.folder / "pairs.npy")
            self.words = {k: _open_memmap(self.folder / f"word_{k}.npy") for k in KINDS}
            self.new = {k: _open_memmap(self.folder / f"new_{k}.npy") for k in KINDS}
            self.truth_kind = str(self.head.get("truth", "partner"))
            self.signers = tuple(read_signer(row) for row in self.head.get("signers", []))
            self.by_partner = not self.signers or truth.by_partner(self.truth_kind)
            self.skeletons, self.spaces = _read_bodies(self.head, self.signers)
            self._check_shapes()
            self._check_head()
        except (KeyError, OSError, TypeError, ValueError, InputError) as error:
            hint = "make one with `signsplice synth pairs` or `signsplice-paper pairs build`"
            raise FormatError(f"is no corpus of pairs ({str(error)[:300]}); {hint}", file=str(self.folder)) from error
        if self.head.get("version") not in READABLE:
            expected = f"{READABLE[0]} to {READABLE[-1]}"
            raise InputError(
                f"{self.folder}: version {self.head.get('version')!r:.40}, expected {expected}; make it again"
            )

    def __len__(self) -> int:
        return len(self.index)

    @property
    def version(self) -> int:
        """Returns the version, one of ``READABLE``."""
        return int(self.head["version"])

    def check_synthetic(self) -> None:
        """Raises ``InputError`` if the words are clips of which only the motion is known."""
        if not self.signers:
            raise InputError(
                f"{self.folder}: its words are clips, whose signs and events are not known; expected a corpus of the "
                "synthetic signer (`signsplice synth pairs`)"
            )

    def split(self, name: str, part: str) -> list[int]:
        """Returns a split's pair numbers of a part (train, valid, test). Raises ``InputError`` for unknown names."""
        try:
            return list(self.head["splits"][name][part])
        except (KeyError, TypeError):
            raise InputError(f"no split {name} {part}, expected one of {', '.join(self.head['splits'])}") from None

    def signer(self, word: int) -> int:
        """Returns the number of a word's signer."""
        first_words = self.head.get("first_words")
        if first_words is None:  # every signer has as many words
            return word * len(self.spaces) // len(self.head["words"])
        return bisect.bisect_right(first_words, word) - 1

    def space(self, word: int) -> NumberSpace:
        """Returns the number space of a word's frames."""
        return self.spaces[self.signer(word)]

    def word(self, number: int, kind: str = "positions") -> Array:
        """Returns a word's frames (N, ...): positions (3 K), rotations (J, 4) or roots (3)."""
        row = self.head["words"][number]
        return np.asarray(self.words[kind][row["first"] : row["first"] + row["frames"]])

    def events(self, number: int) -> SeenEvents:
        """Returns a word's events; those of version 1 have no skin distances. Raises ``InputError`` as
        ``check_synthetic``.
        """
        self.check_synthetic()
        row = self.head["words"][number]["events"]
        first = tuple(row["first"]) if row["first"] else None
        return SeenEvents(**{**row, "first": first, "passes": tuple(tuple(p) for p in row["passes"])})

    def truth(self, number: int, kind: str = "positions") -> tuple[int, int, Array]:
        """Returns pre, post and the true transition (n, ...) of a pair."""
        _, _, pre, post, first, count = self.index[number].tolist()
        return pre, post, np.asarray(self.new[kind][first : first + count])

    def utterance(self, number: int, kind: str = "positions") -> Array:
        """Returns a pair's utterance (T, ...): the kept frames of both words and the transition between (eq. 17)."""
        p, q = self.index[number, :2].tolist()
        pre, post, new = self.truth(number, kind)
        return np.concatenate([self.word(p, kind)[: pre + 1], new, self.word(q, kind)[post:]])

    def clip(self, number: int) -> Clip:
        """Returns a pair's utterance as a clip."""
        p, q = self.index[number, :2].tolist()
        name = f"{self.gloss(p)} {self.gloss(q)}"
        return self._clip(self.utterance(number, "rotations"), self.utterance(number, "roots"), p, name)

    def gloss(self, word: int) -> str:
        """Returns a word's gloss."""
        return str(self.head["words"][word]["gloss"])

    def word_clip(self, number: int) -> Clip:
        """Returns a word as a clip."""
        return self._clip(self.word(number, "rotations"), self.word(number, "roots"), number, self.gloss(number))

    def transition_clip(self, number: int) -> Clip:
        """Returns the frames of a pair's true transition as a clip."""
        p, q = self.index[number, :2].tolist()
        rotations, roots = (self.truth(number, kind)[2] for kind in ("rotations", "roots"))
        return self._clip(rotations, roots, p, f"{self.gloss(p)} {self.gloss(q)}")

    def _clip(self, rotations: Array, roots: Array, word: int, name: str) -> Clip:
        bones = self.skeletons[self.signer(word)]
        return Clip(bones, rotations.astype(np.float64), roots.astype(np.float64), self.head["fps"], name)

    def _check_head(self) -> None:
        """Raises ``TypeError``, ``KeyError`` or ``ValueError`` if words, pairs or splits lie outside the arrays."""
        check_type([self.head["fps"], self.head["hash"]], tuple[float, str], "fps, hash")
        check_type(self.head["words"], list[_StoredWord], "words")
        check_type(self.head["splits"], dict[str, dict[str, list[int]]], "splits")
        rows, index = self.head["words"], np.asarray(self.index)
        if index.ndim != 2 or index.shape[1] != 6 or index.dtype.kind != "i" or not len(index):
            raise ValueError(f"pairs.npy: {index.dtype} {index.shape}, expected whole numbers (P, 6)")
        first, frames = np.array([(row["first"], row["frames"]) for row in rows], np.int64).reshape(-1, 2).T
        words, cuts, (new, n_new) = index[:, :2], index[:, 2:4], index[:, 4:].astype(np.int64).T
        splits = [number for parts in self.head["splits"].values() for part in parts.values() for number in part]
        _check_range("words", first, len(self.words["roots"]) - frames)
        _check_range("frames of words", frames - 1, len(self.words["roots"]))
        _check_range("words of pairs", words, len(rows) - 1)
        _check_range("cuts", cuts, frames[words] - 1)
        _check_range("transitions", np.array([new, n_new]), len(self.new["roots"]) - np.array([n_new, new]))
        _check_range("splits", np.array(splits, np.int64), len(index) - 1)

    def _check_shapes(self) -> None:
        """Raises ``ValueError`` if the arrays do not match the signers' skeletons and numbers."""
        bones, space = self.skeletons[0], self.spaces[0]
        shapes = {"rotations": (len(bones), 4), "roots": (3,), "positions": (space.n_numbers,)}
        for name, arrays in (("word", self.words), ("new", self.new)):
            for kind, array in arrays.items():
                if array.shape[1:] != shapes[kind]:
                    raise ValueError(f"{name}_{kind}.npy: frames {array.shape[1:]}, expected {shapes[kind]}")
                if array.ndim == 0 or len(array) != len(arrays["roots"]) or array.dtype.kind != "f":
                    raise ValueError(f"{name}_{kind}.npy: {array.dtype} {array.shape}, expected numbers for each frame")


@dataclass(frozen=True)
class _StoredWord:
    """A row of the words in JSON: gloss, first frame in the arrays and number of frames."""

    gloss: str
    first: int
    frames: int


def _check_range(name: str, values: Array, highest: Array | int) -> None:
    """Raises ``ValueError`` if one of ``values`` is outside 0 to ``highest``."""
    if np.any((values < 0) | (values > highest)):
        raise ValueError(f"{name}: a number lies beyond the arrays")


def _read_bodies(
    head: Mapping[str, Any], signers: Sequence[Signer]
) -> tuple[tuple[Skeleton, ...], tuple[NumberSpace, ...]]:
    """Returns the skeletons and spaces of a corpus's signers."""
    if signers:
        bodies = tuple(skeleton(signer) for signer in signers)
        spaces = [make_signer_space(body, signer.stature_cm) for body, signer in zip(bodies, signers, strict=True)]
        return bodies, tuple(spaces)
    check_type([head["skeletons"], head["spaces"]], list[list[Any]], "skeletons, spaces")
    bodies = tuple(skeletons.from_json(row) for row in head["skeletons"])
    stored_spaces = tuple(read_space(row) for row in head["spaces"])
    if not bodies or len(bodies) != len(stored_spaces) or len({space.n_numbers for space in stored_spaces}) > 1:
        raise ValueError(
            f"{len(bodies)} skeletons and {len(stored_spaces)} spaces, expected one of each for every signer"
        )
    return bodies, stored_spaces


# --- writing


class StoredRow(NamedTuple):
    """All pairs with one word before: their file until the corpus is complete, and the words' numbers."""

    path: Path
    before: int
    after: tuple[int, ...]


def save_row(
    path: Path, index: Sequence[tuple[int, int, int]], arrays: Mapping[str, Array], **extra_arrays: Array
) -> None:
    """Stores the pairs of a row: ``index`` is pre, post and the number of transition frames of each; ``arrays`` (by
    ``KINDS``) are those frames, pair after pair. ``extra_arrays`` are stored with them.
    """
    temporary = path.with_name(f"_{path.name}")
    float32_arrays = {kind: arrays[kind].astype(np.float32) for kind in KINDS}
    np.savez(temporary, index=np.array(index, np.int32).reshape(-1, 3), **float32_arrays, **extra_arrays)  # type: ignore[arg-type]
    put_file(temporary, path)


def write_words(folder: Path, words: Iterable[tuple[Clip, Array]]) -> list[tuple[int, int]]:
    """Writes the three arrays of all words, given as clips with their numbers (T, 3 K); returns the first frame and the
    number of frames of each.
    """
    clips, numbers = zip(*words, strict=True)
    np.save(folder / "word_rotations.npy", np.concatenate([clip.local_rotations for clip in clips]).astype(np.float32))
    np.save(folder / "word_roots.npy", np.concatenate([clip.root_positions for clip in clips]).astype(np.float32))
    np.save(folder / "word_positions.npy", np.concatenate(numbers).astype(np.float32))
    lengths = [len(clip) for clip in clips]
    return list(zip([0, *np.cumsum(lengths[:-1]).tolist()], lengths, strict=True))


def write_transitions(folder: Path, rows: Sequence[StoredRow]) -> None:
    """Concatenates the rows' files into one array each, reading one row at a time."""
    table = []
    first = 0
    shapes: dict[str, tuple[int, ...]] = {}
    for row in rows:
        with np.load(row.path) as arrays:
            index = arrays["index"]
            shapes = shapes or {kind: arrays[kind].shape[1:] for kind in KINDS}
        for after, (pre, post, count) in zip(row.after, index.tolist(), strict=True):
            table.append((row.before, after, pre, post, first, count))
            first += count
    np.save(folder / "pairs.npy", np.array(table, np.int32))
    for kind in KINDS:
        with (folder / f"new_{kind}.npy").open("wb") as file:  # not memory-mapped: a full disk would end the process
            header = {"descr": np.lib.format.dtype_to_descr(np.dtype(np.float32)), "fortran_order": False}
            np.lib.format.write_array_header_1_0(file, {**header, "shape": (first, *shapes[kind])})
            for row in rows:
                with np.load(row.path) as arrays:
                    file.write(arrays[kind].tobytes())


EXTENT = 1.3
"""Side of the cube that is scaled to [-0.5, 0.5]^3, in statures: wide enough for every reach."""


def make_signer_space(bones: Skeleton, stature_cm: float) -> NumberSpace:
    """Returns the number space of all joints of a synthetic signer: cm from the middle of the body's height, over
    ``EXTENT`` statures.
    """
    return make_space(bones, (0.0, 0.5 * stature_cm, 0.0), EXTENT * stature_cm)


VERSION = 3
"""Increased with every change of the motion: the same recipe with another version is another corpus."""
MADE_BY = {1: "c5abc78a609a948fbc99a3267faac73027bdb4d9", 2: "282f865c197c93cc22ffe320557550ef72876836"}
"""Commits of this project that write earlier versions."""


@dataclass(frozen=True)
class Recipe:
    """The recipe of a corpus of pairs.

    signs: the signs, in order
    seed: seeds the signers and the splits
    fps: frame rate
    n_other: number of pairs by a second signer, for the split of unseen signers
    truth: on what the cuts depend, one of ``truth.KINDS``
    """

    signs: tuple[Sign, ...]
    seed: int = 0
    fps: float = 30.0
    n_other: int = 1000
    truth: str = "partner"

    @property
    def hash(self) -> str:
        """Returns twelve hex digits that change with everything the corpus depends on."""
        text = json.dumps({"version": VERSION, "motion": MOTION_VERSION, **asdict(self)}, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:12]

    def signers(self) -> tuple[Signer, Signer]:
        """Returns the signer of all pairs (for seed 0 the standard signer), and the second signer."""
        return lexicon_signer(self.seed), draw_signer(2 * self.seed + 1)


def normalise_positions(clip: Clip, stature_cm: float) -> FloatArray:
    """Returns the numbers (T, 3 J) of a synthetic signer's clip (``make_signer_space``)."""
    return make_signer_space(clip.skeleton, stature_cm).to_numbers(clip)


class _PairRow(NamedTuple):
    """All pairs of one signer (0 or 1) with one word before: the signs' indices before and after."""

    signer: int
    before: int
    after: tuple[int, ...]

    def locate(self, part_folder: Path) -> Path:
        """Returns the file that stores the row until the corpus is complete."""
        return part_folder / f"row-{self.signer}-{self.before:05d}.npz"

    def to_stored_row(self, part_folder: Path, n_words: int) -> StoredRow:
        """Returns the row with the numbers of its words in a corpus of ``n_words`` words per signer."""
        first = self.signer * n_words
        return StoredRow(self.locate(part_folder), first + self.before, tuple(first + q for q in self.after))


def write_pairs(recipe: Recipe, folder: Path, progress: Progress | None = None, processes: int = 2) -> Path:
    """Writes a corpus of all ordered pairs into ``folder`` and returns the folder. Called again after an interruption,
    it continues.

    Raises ``InputError`` if the folder holds something else or cannot be written, or another call writes the same
    corpus.
    """
    folder = Path(folder)
    truth.by_partner(recipe.truth)
    if recipe.truth == "events":
        raise InputError("truth events: made by readable_pairs.write_readable, expected partner or word")
    check_folder(folder, HEAD, _list_files)
    target = folder.resolve()  # "." has no name
    part_folder = target.with_name(f".{target.name}-{recipe.hash}.part")
    hint = f"finished rows stay in {part_folder.name}, and the same call continues from there"
    try:
        with resumable_folder(part_folder):
            rows = _list_rows(recipe)
            words = _write_rows(recipe, rows, part_folder, progress, processes)
            with replacing_folder(folder, hint) as new_folder:
                all_words = [word for signer_words in words for word in signer_words]
                spans = write_words(
                    new_folder, [(w.clip, normalise_positions(w.clip, w.signer.stature_cm)) for w in all_words]
                )
                write_transitions(new_folder, [row.to_stored_row(part_folder, len(recipe.signs)) for row in rows])
                splits = draw_splits(
                    recipe.seed, len(recipe.signs), [(row.signer, row.before, q) for row in rows for q in row.after]
                )
                head = _make_head(recipe, list(zip(all_words, spans, strict=True)), splits)
                (new_folder / HEAD).write_text(json.dumps(head, indent=1) + "\n", encoding="utf-8")
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({error.strerror or error}); {hint}") from error
    return folder


def _list_files(folder: Path) -> Sequence[str]:
    """Returns the files of a corpus. Raises ``InputError`` for one of another version, which other code has written."""
    version = Pairs(folder).version
    if version != VERSION:
        raise InputError(
            f"{folder}: holds a corpus of version {version}, and version {VERSION} is made; choose a new name"
        )
    return FILES


def _write_rows(
    recipe: Recipe, rows: Sequence[_PairRow], part_folder: Path, progress: Progress | None, processes: int
) -> list[list[IsolatedWord]]:
    """Writes the files of all rows that are missing or damaged; returns the words of both signers."""
    pending_rows = [row for row in rows if not is_whole(row.locate(part_folder))]
    n_total, n_done = (
        sum(len(row.after) for row in rows),
        sum(len(row.after) for row in rows if row not in pending_rows),
    )
    with Pool(processes) as run:
        words = [
            list(run(_synthesize_word, [(sign, signer, recipe.fps) for sign in recipe.signs]))
            for signer in recipe.signers()
        ]
        jobs = (
            (row.locate(part_folder), words[row.signer], row, truth.by_partner(recipe.truth)) for row in pending_rows
        )
        for row in run(_write_row, jobs):
            n_done += len(row.after)
            if progress is not None:
                progress(n_done, n_total)
    return words


def _list_rows(recipe: Recipe) -> list[_PairRow]:
    """Returns all pairs of the first signer, and ``n_other`` pairs of the second, drawn by seed."""
    n_signs = len(recipe.signs)
    rows = [_PairRow(0, p, tuple(range(n_signs))) for p in range(n_signs)]
    chosen_pairs = np.sort(
        stream("other-signer", recipe.seed, n_signs).permutation(n_signs * n_signs)[: recipe.n_other]
    )
    rows += [
        _PairRow(1, p, tuple(int(pair % n_signs) for pair in chosen_pairs if pair // n_signs == p))
        for p in range(n_signs)
    ]
    return [row for row in rows if row.after]


def _synthesize_word(job: tuple[Sign, Signer, float]) -> IsolatedWord:
    sign, signer, fps = job
    return with_touches(planner.synthesize_word(sign, signer, fps=fps))


def _write_row(job: tuple[Path, list[IsolatedWord], _PairRow, bool]) -> _PairRow:
    """Writes a row's transitions into a file of its own."""
    path, words, row, partner = job
    p = words[row.before]
    states, index = [], []
    for q in row.after:
        splice = truth.splice(p, words[q], partner=partner)
        states.append(splice.states)
        index.append((splice.pre, splice.post, len(splice.states)))
    clip = pose.clip(np.concatenate(states), p.signer, p.clip.fps)
    positions = normalise_positions(clip, p.signer.stature_cm)
    frames = {"rotations": clip.local_rotations, "roots": clip.root_positions, "positions": positions}
    save_row(path, index, frames)
    return row


def _make_head(
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
            "events": asdict(measure_touches(word)),
        }
        for word, (first, n_frames) in words
    ]
    return {
        "version": VERSION,
        "motion": MOTION_VERSION,
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
    """Returns the numbers of the pairs (signer, word before, word after) for training, validation and test, by seed.

    random: pairs drawn 80 : 10 : 10 (the paper's protocol; the paper does not print its ratio). unseen-words: words
    drawn 70 : 10 : 20; a pair belongs where both of its words do, and other pairs are left out. unseen-signer: training
    and validation of random, tested on the second signer.
    """
    rng = stream("splits", seed, n_words)
    first_signer_pairs = [k for k, (signer, _, _) in enumerate(pairs) if signer == 0]
    order = rng.permutation(first_signer_pairs).tolist()
    a, b = round(0.8 * len(order)), round(0.9 * len(order))
    random = {"train": sorted(order[:a]), "valid": sorted(order[a:b]), "test": sorted(order[b:])}
    words = rng.permutation(n_words).tolist()
    a, b = round(0.7 * n_words), round(0.8 * n_words)
    groups = {"train": set(words[:a]), "valid": set(words[a:b]), "test": set(words[b:])}
    unseen_words = {
        name: [k for k in first_signer_pairs if pairs[k][1] in group and pairs[k][2] in group]
        for name, group in groups.items()
    }
    second_signer_pairs = [k for k, (signer, _, _) in enumerate(pairs) if signer == 1]
    return {
        "random": random,
        "unseen-words": unseen_words,
        "unseen-signer": {"train": random["train"], "valid": random["valid"], "test": second_signer_pairs},
    }


def read_signer(row: Mapping[str, Any]) -> Signer:
    """Returns the signer whose fields are in a JSON object; its motion is plain if there is no manner."""
    return Signer(**{**row, "manner": Manner(**row.get("manner", {}))})
