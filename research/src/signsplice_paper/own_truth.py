"""The truth of a corpus of clips: from a file of positions, or from a cutter and a transition.

A file of positions is JSON. Frames are counted from 0 in the files of the words, at their own rates:

    {"pairs": [{"before": "HOUSE", "after": "DOG", "pre": 41, "post": 9,
                "clip": "transitions/house-dog.bvh", "frames": [0, 8]}, ...],
     "words": [{"word": "HOUSE", "pre": 40, "post": 10}, ...],
     "space": {...}}

``pre`` is the last frame kept of the word before, ``post`` the first kept of the word after (eq. 9). ``words`` gives
one position for all partners; a pair in ``pairs`` has its own. ``clip`` is a file next to this one with the true
transition, or with several, of which ``frames`` (half-open) are this pair's; then words and transitions stay at their
recorded places. A method fills a pair without a clip. ``space`` (``NumberSpace``) fixes the cube of the numbers.
"""

from __future__ import annotations

import hashlib
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from signsplice.errors import FormatError, InputError
from signsplice.formats import load
from signsplice.formats.json_files import check_type, parse_json
from signsplice.formats.reading import DEFAULT_LIMITS, ReadLimits, read_bytes
from signsplice.motion import Clip, concatenate, rotation, same_fps, sample_clip
from signsplice.splicing.contracts import Cut, gap_at
from signsplice.splicing.learned import NAME as LEARNED
from signsplice_paper.clip_methods import TRUE_POSITIONS, ClipMethod
from signsplice_paper.own_clips import OwnWord, Rig, put_on_rig
from signsplice_workshop.corpora.number_space import NumberSpace, read_space
from signsplice_workshop.measure.collisions import fill

_SHAPE = 'an object {"pairs": [...], "words": [...]} of positions'


class TrueSplice(NamedTuple):
    """The truth of one pair: the cut, and the transition at the corpus's rate, at least one frame."""

    cut: Cut
    clip: Clip


class TruthSource(ABC):
    """The source of the truth of a corpus of clips."""

    name: str
    """The source in one line, for corpus.json and messages."""

    @abstractmethod
    def find_followers(self, words: Sequence[OwnWord], p: int) -> list[int]:
        """Returns the words that follow word ``p`` in some pair."""

    @abstractmethod
    def make_splices(self, words: Sequence[OwnWord], p: int, followers: Sequence[int]) -> list[TrueSplice]:
        """Returns the truth of the pairs of word ``p`` and each of ``followers``."""

    @abstractmethod
    def describe(self) -> dict[str, Any]:
        """Returns everything that the truth depends on, for corpus.json."""


class MethodTruth(TruthSource):
    """Positions and transitions by a cutter and a transition: scores then measure agreement with that method."""

    def __init__(self, method: ClipMethod) -> None:
        self.method = method
        self.name = f"method {method.name}"

    def find_followers(self, words: Sequence[OwnWord], p: int) -> list[int]:
        """Returns all words."""
        return list(range(len(words)))

    def make_splices(self, words: Sequence[OwnWord], p: int, followers: Sequence[int]) -> list[TrueSplice]:
        """Returns the splices that the method makes."""
        before, cutter = words[p].clip, self.method.parts.cutter
        cuts = [cutter.cut_all([before, words[q].clip])[0] for q in followers]
        return fill_transitions(self.method, before, [words[q].clip for q in followers], cuts)

    def describe(self) -> dict[str, Any]:
        """Returns the method's names, and the hash of the bundle whose networks take part."""
        return {"cutter": self.method.cutter, "transition": self.method.transition, "bundle": self.method.parts.bundle}


def fill_transitions(method: ClipMethod, before: Clip, after: Sequence[Clip], cuts: Sequence[Cut]) -> list[TrueSplice]:
    """Returns the transitions of a method at given positions, as long as its duration says."""
    parts = method.parts
    gaps = []
    for clip, cut in zip(after, cuts, strict=True):
        n_frames = max(1, round(parts.duration.seconds(before, clip, cut) * before.fps))
        gaps.append(gap_at(before, clip, cut, n_frames))
    transitions = fill(parts.transition, gaps, None) if gaps else []
    return [TrueSplice(cut, clip) for cut, clip in zip(cuts, transitions, strict=True)]


@dataclass(frozen=True)
class PairPositions:
    """The entry of one pair in a file of positions.

    - pre, post: frames of the words' files
    - clip: file of the transition, relative to the file of positions; None if a method fills it
    - frames: the transition's frames in that file (half-open), None for all
    - where: its place in the file of positions, for messages
    """

    pre: int
    post: int
    clip: str | None
    frames: tuple[int, int] | None
    where: str


@dataclass(frozen=True)
class PositionsFile:
    """A file of positions, read but not yet matched with words.

    - path: the file
    - sha256: of its content
    - pairs: by glosses
    - words: pre and post of words, for all partners
    - space: the space of the corpus's numbers, None for the cube around its words
    """

    path: Path
    sha256: str
    pairs: dict[tuple[str, str], PairPositions]
    words: dict[str, tuple[int, int]]
    space: NumberSpace | None = None

    @property
    def glosses(self) -> set[str]:
        """All words that the file names."""
        return {gloss for pair in self.pairs for gloss in pair} | set(self.words)

    @property
    def has_clips(self) -> bool:
        """Whether it names true transitions, so that words stay at their recorded places."""
        return any(pair.clip is not None for pair in self.pairs.values())

    def find_pair(self, before: str, after: str) -> PairPositions | None:
        """Returns the positions of a pair; None if the file has none."""
        pair = self.pairs.get((before, after))
        if pair is None and before in self.words and after in self.words:
            pair = PairPositions(self.words[before][0], self.words[after][1], None, None, f"words {before}, {after}")
        return pair


def read_positions(path: Path) -> PositionsFile:
    """Returns a file of positions. Raises ``InputError`` for anything else."""
    content = read_bytes(path)
    values = parse_json(content, str(path), _SHAPE)
    try:
        check_type(values, dict[str, Any], "positions")
        unknown = sorted(set(values) - {"pairs", "words", "space", "version"})
        if unknown or not (values.get("pairs") or values.get("words")):
            raise TypeError(f"{f'unknown {unknown[0]}' if unknown else 'neither pairs nor words'}, expected {_SHAPE}")
        pairs = {}
        kinds = {"before": str, "after": str, "pre": int, "post": int}
        for n, row in enumerate(_parse_rows(values, "pairs", kinds, ("clip", "frames"))):
            pair = (row["before"], row["after"])
            if pair in pairs:
                raise TypeError(f"pairs[{n}]: {' '.join(pair)} stands twice, expected once")
            pairs[pair] = _parse_pair(row, f"pairs[{n}]")
        words: dict[str, tuple[int, int]] = {}
        for n, row in enumerate(_parse_rows(values, "words", {"word": str, "pre": int, "post": int})):
            if row["word"] in words:
                raise TypeError(f"words[{n}]: {row['word']} stands twice, expected once")
            words[row["word"]] = (row["pre"], row["post"])
        for name in dict.fromkeys(pair.clip for pair in pairs.values() if pair.clip is not None):
            if not (path.parent / name).is_file():
                where = next(pair.where for pair in pairs.values() if pair.clip == name)
                raise TypeError(f"{where}: clip {name} is not there, expected a file beside this one")
        space = read_space(values["space"]) if "space" in values else None
    except (TypeError, InputError) as error:
        raise FormatError(str(error), file=str(path)) from error
    return PositionsFile(path, hashlib.sha256(content).hexdigest(), pairs, words, space)


def _parse_rows(
    values: dict[str, Any], name: str, kinds: dict[str, type], optional_keys: Sequence[str] = ()
) -> list[dict[str, Any]]:
    rows = values.get(name, [])
    check_type(rows, list[dict[str, Any]], name)
    for n, row in enumerate(rows):
        for key, kind in kinds.items():
            if key not in row:
                raise TypeError(f"{name}[{n}]: has no {key}, expected {', '.join(kinds)}")
            check_type(row[key], kind, f"{name}[{n}].{key}")
            if kind is int and row[key] < 0:
                raise TypeError(f"{name}[{n}]: {key} {row[key]}, expected a frame, counted from 0")
        unknown = sorted(set(row) - {*kinds, *optional_keys})
        if unknown:
            raise TypeError(f"{name}[{n}]: unknown {unknown[0]}, expected {', '.join((*kinds, *optional_keys))}")
    return list(rows)


def _parse_pair(row: dict[str, Any], where: str) -> PairPositions:
    check_type(row.get("clip"), str | None, f"{where}.clip")
    check_type(row.get("frames"), tuple[int, int] | None, f"{where}.frames")
    frames = row.get("frames")
    if frames is not None and (row.get("clip") is None or not 0 <= frames[0] < frames[1]):
        raise TypeError(f"{where}.frames: {frames}, expected first and stop of a clip, first below stop")
    return PairPositions(row["pre"], row["post"], row.get("clip"), None if frames is None else tuple(frames), where)


@dataclass(eq=False)
class FileTruth(TruthSource):
    """Positions from a file; transitions from the clips that it names, else by a method.

    - positions: the file
    - rig: of the words
    - fps: rate of the corpus
    - transition: name of the method that fills pairs without a clip
    - limits: of the clips
    """

    positions: PositionsFile
    rig: Rig
    fps: float
    transition: str
    limits: ReadLimits = DEFAULT_LIMITS
    warnings: list[str] = field(default_factory=list)
    _open: tuple[str, Clip] | None = None

    def __post_init__(self) -> None:
        self.name = f"file {self.positions.path.name}"
        self._method: ClipMethod | None = None
        self._fills = bool(self.positions.words or any(pair.clip is None for pair in self.positions.pairs.values()))
        if self._fills or self.transition != LEARNED:  # an unknown name is an error, needed or not
            self._method = ClipMethod(TRUE_POSITIONS, self.transition, "positions")

    def find_followers(self, words: Sequence[OwnWord], p: int) -> list[int]:
        """Returns the words that follow word ``p`` in the file."""
        return [q for q in range(len(words)) if self.positions.find_pair(words[p].gloss, words[q].gloss) is not None]

    def check(self, words: Sequence[OwnWord]) -> None:
        """Raises ``InputError`` for frames that a word or a clip does not have."""
        by_gloss = {word.gloss: word for word in words}
        for (before, after), pair in self.positions.pairs.items():
            for key, frame, gloss in (("pre", pair.pre, before), ("post", pair.post, after)):
                if gloss in by_gloss:
                    self._check_frame(pair.where, key, frame, by_gloss[gloss])
            if pair.frames is not None and before in by_gloss and after in by_gloss:
                self._cut_frames(pair)
        for n, (gloss, frames) in enumerate(self.positions.words.items()):
            for key, frame in zip(("pre", "post"), frames, strict=True):
                if gloss in by_gloss:
                    self._check_frame(f"words[{n}]", key, frame, by_gloss[gloss])

    def make_splices(self, words: Sequence[OwnWord], p: int, followers: Sequence[int]) -> list[TrueSplice]:
        """Returns the truth in the file; ``check`` must have been called before."""
        before = words[p]
        splices: dict[int, TrueSplice] = {}
        to_fill: list[tuple[int, Cut]] = []
        for q in followers:
            pair = self.positions.find_pair(before.gloss, words[q].gloss)
            assert pair is not None
            cut = Cut(before.find_frame(pair.pre), words[q].find_frame(pair.post))
            if pair.clip is None:
                to_fill.append((q, cut))
            else:
                splices[q] = TrueSplice(cut, self._load_transition(pair, cut, before.clip, words[q].clip))
        if to_fill and self._method is not None:
            clips = [words[q].clip for q, _ in to_fill]
            filled = fill_transitions(self._method, before.clip, clips, [cut for _, cut in to_fill])
            splices |= {q: splice for (q, _), splice in zip(to_fill, filled, strict=True)}
        return [splices[q] for q in followers]

    def describe(self) -> dict[str, Any]:
        """Returns the file, its hash, and the method that fills pairs without a clip."""
        method = self._method if self._fills else None
        filled_by = None if method is None else {"transition": method.transition, "bundle": method.parts.bundle}
        return {"file": self.positions.path.name, "sha256": self.positions.sha256, "filled_by": filled_by}

    def _check_frame(self, where: str, key: str, frame: int, word: OwnWord) -> None:
        if frame >= word.n_read:
            raise InputError(
                f"{self.positions.path}: {where}: {key} {frame}, but {word.file} has {word.n_read} frames, "
                "counted from 0"
            )

    def _cut_frames(self, pair: PairPositions) -> Clip:
        """Returns the frames of a pair's transition from its file."""
        assert pair.clip is not None
        clip = self._load_clip(pair.clip)
        first, stop = pair.frames or (0, len(clip))
        if stop > len(clip):
            raise InputError(
                f"{self.positions.path}: {pair.where}: frames {first}:{stop}, but {pair.clip} has {len(clip)} frames"
            )
        return clip[first:stop]

    def _load_transition(self, pair: PairPositions, cut: Cut, before: Clip, after: Clip) -> Clip:
        """Returns the true transition of a pair at the corpus's rate, with rotations that continue those of the word
        before.
        """
        transition, frame_before = self._cut_frames(pair), before[cut.pre : cut.pre + 1]
        if not same_fps(transition.fps, self.fps):
            transition = _resample_transition(transition, frame_before, after[cut.post : cut.post + 1], self.fps)
        local = rotation.continuous(np.concatenate([frame_before.local_rotations, transition.local_rotations]))[1:]
        return Clip(self.rig.skeleton, local, transition.root_positions, self.fps, transition.name)

    def _load_clip(self, name: str) -> Clip:
        if self._open is None or self._open[0] != name:
            path = self.positions.path.parent / name
            self._open = name, put_on_rig(load(path, self.limits), self.rig, path, self.warnings)
        return self._open[1]


def _resample_transition(transition: Clip, frame_before: Clip, frame_after: Clip, fps: float) -> Clip:
    """Returns a transition at another rate, of the same duration and evenly between the frames kept of both words."""
    parts = [replace(part, fps=transition.fps) for part in (frame_before, transition, frame_after)]
    joined = concatenate(parts)
    n_frames = max(1, round((len(transition) + 1) * fps / transition.fps) - 1)
    return replace(sample_clip(joined, np.linspace(0.0, len(joined) - 1.0, n_frames + 2)[1:-1]), fps=fps)
