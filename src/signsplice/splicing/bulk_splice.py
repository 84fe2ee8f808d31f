"""Many sentences spliced together: the same frames as one by one, bit for bit, in less time.

The networks read a word once, whatever the number of sentences. Work done frame by frame (curves, network inputs and
outputs, poses, collisions, scores) is batched over the seams of many sentences; every frame gets the numbers that it
would get alone.

A repeated pair of words is not filled again (``TransitionCache``). The key of a gap is a digest of what a transition
sees: every number of the frames that the gap shows on either side, the skeleton, the rate, whether a word was drawn
between keys, the number of new frames, and the passes that fill it, with the file of the transition's network. Words,
cuts and options act through these frames alone, so they are not part of the key. Gaps that differ in one bit have
different keys.
"""

from __future__ import annotations

import hashlib
import struct
import time
from collections import OrderedDict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple, TypeVar

import numpy as np

from signsplice.errors import SignspliceError
from signsplice.motion import Clip, Skeleton, copy_unchecked
from signsplice.splicing.cards import add_frames, digest_skeleton
from signsplice.splicing.contracts import Gap
from signsplice.splicing.engine import joined_sentence
from signsplice.splicing.options import SpliceOptions
from signsplice.splicing.passes import Pass, fill, signature
from signsplice.splicing.result import SpliceResult
from signsplice.splicing.seam import Seam, seam_positions
from signsplice.splicing.sentence import Sentence
from signsplice.splicing.word import Word, check_list

_WORDS_AT_ONCE = 256
"""Approximate number of words per batch: larger batches need more memory and are hardly faster."""
Result = SpliceResult | SignspliceError
T = TypeVar("T")
_Asked = tuple[Sequence[Clip | Word], SpliceOptions]


def splice_many(
    sentences: Sequence[Sequence[Clip | Word]],
    options: Sequence[SpliceOptions] | SpliceOptions | None = None,
    transitions: TransitionCache | None = None,
) -> list[Result]:
    """Returns what ``splice`` returns for each sentence alone, in order, or the ``SignspliceError`` that it raises.

    options: for all sentences, or one per sentence.
    transitions: cache with the transitions of earlier calls.

    Use one clip object per word in all sentences: results for a word are kept as long as that object lives. Raises
    ``ValueError`` if the numbers of options and sentences differ.
    """
    if options is None or isinstance(options, SpliceOptions):
        options = [options or SpliceOptions()] * len(sentences)
    results: list[Result] = []
    block: list[_Asked] = []
    for asked in zip(sentences, options, strict=True):
        check_list(asked[0])
        block.append(asked)
        if sum(len(clips) for clips, _ in block) >= _WORDS_AT_ONCE:
            results += _splice_block(block, transitions)
            block = []
    return results + _splice_block(block, transitions)


def _splice_block(block: Sequence[_Asked], transitions: TransitionCache | None) -> list[Result]:
    """Splices one batch of sentences, each step for all of them."""
    done: dict[int, Result] = {}

    def each(step: Callable[[int], T], rows: Iterable[int]) -> dict[int, T]:
        """Runs a step for every sentence and returns the values of those in which it raises no error."""
        values: dict[int, T] = {}
        for row in rows:
            try:
                values[row] = step(row)
            except SignspliceError as error:
                done[row] = error
        return values

    growing = each(lambda row: Sentence(block[row][1]), range(len(block)))
    planned = each(lambda row: growing[row].plan(block[row][0]), growing)
    filled: dict[int, list[Seam]] = {}
    for rows in _with_same_passes(growing, planned):
        try:
            filled |= _fill_seams({row: (growing[row], planned[row][1]) for row in rows}, transitions)
        except SignspliceError:  # at least one sentence fails: fill each alone
            filled |= each(lambda row: _fill_seams({row: (growing[row], planned[row][1])}, transitions)[row], rows)
    finished = each(lambda row: growing[row].finish(planned[row][0], filled[row]), filled)
    began = time.perf_counter()
    positions = iter(seam_positions([seam for seams in finished.values() for seam in seams]))
    seconds = (time.perf_counter() - began) / max(1, len(finished))
    seen = {row: [next(positions) for _ in seams] for row, seams in finished.items()}

    def join_pieces(row: int) -> SpliceResult:
        growing[row].seconds["join"] += seconds
        return joined_sentence(growing[row], [*growing[row].pieces(finished[row], seen[row]), *growing[row].end()])

    done |= each(join_pieces, finished)
    return [done[row] for row in range(len(block))]


def _with_same_passes(sentences: dict[int, Sentence], rows: Iterable[int]) -> list[list[int]]:
    """Groups sentences whose gaps are filled by the same passes."""
    groups: dict[tuple[object, ...], list[int]] = {}
    for row in rows:
        groups.setdefault(signature(sentences[row].passes, id), []).append(row)
    return list(groups.values())


def _fill_seams(
    sentences: dict[int, tuple[Sentence, Sequence[Seam]]], transitions: TransitionCache | None
) -> dict[int, list[Seam]]:
    """Fills the seams of sentences with the same passes; each sentence is charged its seams' share of the time."""
    passes = next(sentence.passes for sentence, _ in sentences.values())
    seams = [seam for _, sentence_seams in sentences.values() for seam in sentence_seams]
    began = time.perf_counter()
    filled = iter(fill(passes, seams) if transitions is None else transitions.fill(passes, seams))
    seconds = (time.perf_counter() - began) / max(1, len(seams))
    for sentence, sentence_seams in sentences.values():
        sentence.seconds["transition"] += seconds * len(sentence_seams)
    return {row: [next(filled) for _ in sentence_seams] for row, (_, sentence_seams) in sentences.items()}


MOST_BYTES = 64_000_000
"""Default memory limit of the cache, bytes: about 3,500 transitions of a rig with fingers."""
_ENTRY_BYTES = 1000
"""Memory of a cache entry besides its frames, bytes."""


class TransitionCache:
    """The most recently used transitions of one process, limited to ``most_bytes`` of memory.

    hits, misses: number of gaps found in the cache, and of gaps that had to be filled.
    """

    def __init__(self, most_bytes: int = MOST_BYTES) -> None:
        self.most_bytes = most_bytes
        self.hits = self.misses = self.nbytes = 0
        self._kept: OrderedDict[bytes, _FilledGap] = OrderedDict()

    def fill(self, passes: Sequence[Pass], seams: Sequence[Seam]) -> list[Seam]:
        """Returns the seams with their new frames, bit for bit those of ``passes.fill``. Seams on avatars, and of
        transitions without an identity (``Transition.identity``), are never cached.
        """
        done = {row: seam for row, seam in enumerate(seams) if not seam.is_open}
        keys = {row: gap_key(passes, seam.gap) for row, seam in enumerate(seams) if row not in done}
        known: dict[bytes, _FilledGap] = {}
        asked: dict[bytes | int, int] = {}  # the row of each gap that has to be filled
        for row, key in keys.items():
            if key is not None and key in self._kept:
                self._kept.move_to_end(key)
                known[key] = self._kept[key]
            else:
                asked.setdefault(row if key is None else key, row)
        filled = fill(passes, [seams[row] for row in asked.values()])
        self.misses += len(filled)
        self.hits += len(keys) - len(filled)
        for row, seam in zip(asked.values(), filled, strict=True):
            done[row] = seam
            if (key := keys[row]) is not None:
                known[key] = self._keep(key, seam)
        for row, key in keys.items():
            if row not in done and key is not None:
                done[row] = known[key].apply_to(seams[row])
        return [done[row] for row in range(len(seams))]

    def _keep(self, key: bytes, seam: Seam) -> _FilledGap:
        clip = seam.new_frames
        compact = copy_unchecked(
            clip,
            local_rotations=np.array(clip.local_rotations),  # it may be a view of the frames of many gaps
            root_positions=np.array(clip.root_positions),
            translations=None if clip.translations is None else np.array(clip.translations),
            channels=None,
        )
        entry = self._kept[key] = _FilledGap(compact, seam.frame_warnings, seam.depth)
        self.nbytes += compact.nbytes + _ENTRY_BYTES
        while self.nbytes > self.most_bytes:
            _, oldest = self._kept.popitem(last=False)
            self.nbytes -= oldest.clip.nbytes + _ENTRY_BYTES
        return entry


class _FilledGap(NamedTuple):
    """The seam fields that the batching passes set for a gap."""

    clip: Clip
    warnings: tuple[str, ...]
    depth: float | None

    def apply_to(self, seam: Seam) -> Seam:
        """Returns a planned seam with these frames; its gap must have the same numbers."""
        before, n_frames = seam.gap.before, len(self.clip)
        channels = None if before.channels is None else before.channels.forgotten(n_frames)
        clip = copy_unchecked(self.clip, skeleton=before.skeleton, channels=channels)
        gap = seam.gap if n_frames == seam.gap.n_frames else replace(seam.gap, n_frames=n_frames)
        return replace(seam, gap=gap, frames=clip, frame_warnings=self.warnings, depth=self.depth)


def gap_key(passes: Sequence[Pass], gap: Gap) -> bytes | None:
    """Returns a digest of all that determines the frames of a gap, or None if that is unknown."""
    described, skeleton = signature(passes, lambda transition: transition.identity), gap.before.skeleton
    if any(None in part for part in described) or type(skeleton) is not Skeleton:
        return None
    digest = hashlib.blake2b(repr(described).encode(), digest_size=32)
    digest.update(skeleton.derived[digest_skeleton])
    keyed = -1 if gap.keyed is None else int(gap.keyed)
    digest.update(struct.pack("<qdqqb", gap.n_frames, gap.before.fps, len(gap.before), len(gap.after), keyed))
    for clip in (gap.before, gap.after):
        add_frames(digest, clip)
    return digest.digest()
