"""Corpora of pairs: every word once, every pair as an index and its transition, all memory-mapped.

A corpus of pairs is a folder:

    corpus.json                    recipe, its hash, kind of truth, words, splits; who signs and in which numbers
    word_rotations.npy   (F, J, 4)  float32   local rotations of every word's frames, word after word
    word_roots.npy       (F, 3)     float32   root positions, cm
    word_positions.npy   (F, 3 K)   float32   the numbers: positions of K joints, scaled into [-0.5, 0.5]
    pairs.npy            (P, 6)     int32     word before, word after, pre, post, first transition frame, their number
    new_rotations.npy, new_roots.npy, new_positions.npy   the same of all transitions, pair after pair

The utterance of a pair is, in each of the three, before[: pre + 1], new[first : first + n], after[post:] (eq. 17).

Every signer has as many words as any other, one signer's after another's. Corpora of clips (`signsplice-paper pairs
build`) tell the "skeletons" and "spaces" of their signers, and whether words were "moved" to the origin; those of
synthetic signers (``corpus``) tell the "signers", from which skeletons and spaces follow, with all 53 joints in the
numbers.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from signsplice.errors import FormatError, InputError
from signsplice.formats import skeletons
from signsplice.formats.atomic import put_file
from signsplice.formats.json_files import check_type, parse_json
from signsplice.formats.npz import mapped_array
from signsplice.formats.reading import read_bytes
from signsplice.motion import Clip, Skeleton
from signsplice.motion.number_space import NumberSpace, read_space, space_of
from signsplice.signer.signer import Signer, read_signer, skeleton
from signsplice.signer.timing import Events
from signsplice.synth import truth

Array = NDArray[Any]

READABLE = (1, 2, 3)
"""Versions that ``Pairs`` reads."""

HEAD = "corpus.json"
KINDS = ("rotations", "roots", "positions")
FILES = (HEAD, "pairs.npy", *(f"{part}_{kind}.npy" for part in ("word", "new") for kind in KINDS))


class Pairs:
    """A corpus of pairs on disk, its arrays memory-mapped. Pairs and words go by number; ``len`` counts the pairs.

    - truth_kind: where the truth comes from: a kind of the synthetic signer's, or the file or method of other clips
    - by_partner: whether the cuts of a word depend on its partner, too; taken for true of other clips
    - signers: the synthetic signers; none where the words are clips of other origin
    - skeletons: the signers' skeletons, in cm
    - spaces: what the numbers of each signer's frames are
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
            self.index = mapped_array(self.folder / "pairs.npy")
            self.words = {k: mapped_array(self.folder / f"word_{k}.npy") for k in KINDS}
            self.new = {k: mapped_array(self.folder / f"new_{k}.npy") for k in KINDS}
            self.truth_kind = str(self.head.get("truth", "partner"))
            self.signers = tuple(read_signer(row) for row in self.head.get("signers", []))
            self.by_partner = not self.signers or truth.by_partner(self.truth_kind)
            self.skeletons, self.spaces = _bodies(self.head, self.signers)
            self._check_shapes()
            self._check_head()
        except (KeyError, OSError, TypeError, ValueError, InputError) as error:
            hint = "make one with `signsplice synth pairs` or `signsplice-paper pairs build`"
            raise FormatError(f"is no corpus of pairs ({str(error)[:300]}); {hint}", file=str(self.folder)) from error
        if self.head.get("version") not in READABLE:
            expected = f"{READABLE[0]} to {READABLE[-1]}"
            raise InputError(f"{self.folder}: version {self.head.get('version')}, expected {expected}; make it again")

    def __len__(self) -> int:
        return len(self.index)

    @property
    def version(self) -> int:
        """One of ``READABLE``."""
        return int(self.head["version"])

    def check_synthetic(self) -> None:
        """Raise ``InputError`` where the words are clips of which no more is known than their motion."""
        if not self.signers:
            raise InputError(
                f"{self.folder}: its words are clips, whose signs and events are not known; expected a corpus of the "
                "synthetic signer (`signsplice synth pairs`)"
            )

    def split(self, name: str, part: str) -> list[int]:
        """Pair numbers of a part (train, valid, test) of a split. Raises ``InputError`` for unknown names."""
        try:
            return list(self.head["splits"][name][part])
        except (KeyError, TypeError):
            raise InputError(f"no split {name} {part}, expected one of {', '.join(self.head['splits'])}") from None

    def signer(self, word: int) -> int:
        """The number of the signer of a word."""
        return word * len(self.spaces) // len(self.head["words"])

    def space(self, word: int) -> NumberSpace:
        """What the numbers of a word's frames are."""
        return self.spaces[self.signer(word)]

    def word(self, number: int, kind: str = "positions") -> Array:
        """A word's frames (N, ...): positions (3 K), rotations (J, 4) or roots (3)."""
        row = self.head["words"][number]
        return np.asarray(self.words[kind][row["first"] : row["first"] + row["frames"]])

    def events(self, number: int) -> Events:
        """A word's events; those of version 1 have no skin distances. Raises ``InputError`` as ``check_synthetic``."""
        self.check_synthetic()
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
        name = f"{self.gloss(p)} {self.gloss(q)}"
        return self._clip(self.utterance(number, "rotations"), self.utterance(number, "roots"), p, name)

    def gloss(self, word: int) -> str:
        """A word's gloss."""
        return str(self.head["words"][word]["gloss"])

    def word_clip(self, number: int) -> Clip:
        """A word as a clip."""
        return self._clip(self.word(number, "rotations"), self.word(number, "roots"), number, self.gloss(number))

    def transition_clip(self, number: int) -> Clip:
        """The frames of a pair's true transition as a clip."""
        p, q = self.index[number, :2].tolist()
        rotations, roots = (self.truth(number, kind)[2] for kind in ("rotations", "roots"))
        return self._clip(rotations, roots, p, f"{self.gloss(p)} {self.gloss(q)}")

    def _clip(self, rotations: Array, roots: Array, word: int, name: str) -> Clip:
        bones = self.skeletons[self.signer(word)]
        return Clip(bones, rotations.astype(np.float64), roots.astype(np.float64), self.head["fps"], name)

    def _check_head(self) -> None:
        """Raise ``TypeError``, ``KeyError`` or ``ValueError`` where words, pairs or splits are not in the arrays."""
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
        """Raise ``ValueError`` where the arrays are not of the signers' skeletons and numbers."""
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
    """A row of the words, as JSON holds it: its gloss, its first frame in the arrays and their number."""

    gloss: str
    first: int
    frames: int


def _check_range(what: str, values: Array, most: Array | int) -> None:
    """Raise ``ValueError`` where one of ``values`` is not 0 to ``most``."""
    if np.any((values < 0) | (values > most)):
        raise ValueError(f"{what}: a number lies beyond the arrays")


def _bodies(head: Mapping[str, Any], signers: Sequence[Signer]) -> tuple[tuple[Skeleton, ...], tuple[NumberSpace, ...]]:
    """The skeletons and spaces of a corpus's signers."""
    if signers:
        bodies = tuple(skeleton(signer) for signer in signers)
        spaces = [signer_space(b, signer.stature_cm) for b, signer in zip(bodies, signers, strict=True)]
        return bodies, tuple(spaces)
    check_type([head["skeletons"], head["spaces"]], list[list[Any]], "skeletons, spaces")
    bodies = tuple(skeletons.from_json(row) for row in head["skeletons"])
    found = tuple(read_space(row) for row in head["spaces"])
    if not bodies or len(bodies) != len(found) or len({space.n_numbers for space in found}) > 1:
        raise ValueError(f"{len(bodies)} skeletons and {len(found)} spaces, expected one of each for every signer")
    return bodies, found


# --- writing


class StoredRow(NamedTuple):
    """All pairs of one word before: where they are stored until the corpus is complete, and the words' numbers."""

    path: Path
    before: int
    after: tuple[int, ...]


def save_row(path: Path, index: Sequence[tuple[int, int, int]], arrays: Mapping[str, Array], **besides: Array) -> None:
    """Store the pairs of a row: ``index`` is pre, post and the number of transition frames of each; ``arrays`` (by
    ``KINDS``) are those frames, pair after pair. ``besides``: what else the maker of the row wants to find again.
    """
    temporary = path.with_name(f"_{path.name}")
    singles = {kind: arrays[kind].astype(np.float32) for kind in KINDS}
    np.savez(temporary, index=np.array(index, np.int32).reshape(-1, 3), **singles, **besides)  # type: ignore[arg-type]
    put_file(temporary, path)


def write_words(made: Path, words: Iterable[tuple[Clip, Array]]) -> list[tuple[int, int]]:
    """Write the three arrays of all words, given as clips with their numbers (T, 3 K); returns the first frame and the
    number of frames of each.
    """
    clips, numbers = zip(*words, strict=True)
    np.save(made / "word_rotations.npy", np.concatenate([clip.local_rotations for clip in clips]).astype(np.float32))
    np.save(made / "word_roots.npy", np.concatenate([clip.root_positions for clip in clips]).astype(np.float32))
    np.save(made / "word_positions.npy", np.concatenate(numbers).astype(np.float32))
    lengths = [len(clip) for clip in clips]
    return list(zip([0, *np.cumsum(lengths[:-1]).tolist()], lengths, strict=True))


def write_transitions(made: Path, rows: Sequence[StoredRow]) -> None:
    """Concatenate the rows' files into one array each, reading one row at a time."""
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
    np.save(made / "pairs.npy", np.array(table, np.int32))
    for kind in KINDS:
        with (made / f"new_{kind}.npy").open("wb") as out:  # not memory-mapped: a full disk would end the process
            header = {"descr": np.lib.format.dtype_to_descr(np.dtype(np.float32)), "fortran_order": False}
            np.lib.format.write_array_header_1_0(out, {**header, "shape": (first, *shapes[kind])})
            for row in rows:
                with np.load(row.path) as arrays:
                    out.write(arrays[kind].tobytes())


EXTENT = 1.3
"""Side of the cube, in statures, that is scaled to [-0.5, 0.5]^3: wide enough for every reach."""


def signer_space(bones: Skeleton, stature_cm: float) -> NumberSpace:
    """The numbers of all joints of a synthetic signer: cm from the middle of the body's height, over ``EXTENT``
    statures.
    """
    return space_of(bones, (0.0, 0.5 * stature_cm, 0.0), EXTENT * stature_cm)
