"""Data of a word: as a caller passes it, and as it stands in the sentence.

``Word`` is the caller's input: a clip, and how the line was typed. ``AlignedWord`` is its clip aligned to the first
one, with the mapping of its frames. Adjacent seams change it by an ``Edit``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from signsplice.body.contacts import Contact
from signsplice.errors import InputError
from signsplice.motion import Clip, FloatArray, bone_translations, copy_unchecked
from signsplice.rig.roles import CHANNELS
from signsplice.splicing.contracts import Cut, Cutter, cut_clips

if TYPE_CHECKING:
    from signsplice.lexicon.sentence import SentenceToken


@dataclass(frozen=True, eq=False)
class Word:
    """A word or letter of a sentence as a caller passes it.

    clip: its motion; the clip's name is its gloss, for a letter fs- and the letter.
    starts: whether a letter begins another spelled word; other letters continue the one before.
    pause: the mark after it at which it is held, one of ``pauses.PAUSES_S``; None if it is not held.
    brow: brows of the question that contains it, "raised" or "furrowed" (``faces``); None outside questions.
    owns: the channels that belong to the word (some of ``roles.CHANNELS``), which are never replaced; None: those that
        move in its clip (``person``). Raises ``InputError`` for others.
    """

    clip: Clip
    starts: bool = False
    pause: str | None = None
    brow: str | None = None
    owns: frozenset[str] | None = None

    def __post_init__(self) -> None:
        owns = {self.owns} if isinstance(self.owns, str) else {*(self.owns or ())}
        if unknown := sorted(map(str, owns - {*CHANNELS})):
            raise InputError(f"word owns {unknown[0]!r:.40}, expected some of {', '.join(CHANNELS)}")
        if self.owns is not None:
            object.__setattr__(self, "owns", frozenset(owns))


def words_of(
    tokens: Sequence[SentenceToken],
    clip_of: Callable[[str], Clip],
    has_pauses: bool = True,
    owns_of: Callable[[str], frozenset[str] | None] | None = None,
) -> list[Word]:
    """Returns the words for the tokens of a line (``lexicon.sentence.parse``); ``clip_of``: gloss -> clip, such as
    ``Lexicon.clip``. ``has_pauses``: whether words are held at the marks of the line. ``owns_of``: gloss -> ``owns``,
    such as ``Lexicon.owns``.
    """
    from signsplice.lexicon.sentence import line_glosses

    return [
        Word(
            clip_of(entry.gloss),
            entry.starts,
            entry.pause if has_pauses else None,
            entry.brow,
            owns_of(entry.gloss) if owns_of is not None else None,
        )
        for entry in line_glosses(tokens)
    ]


def check_list(clips: object) -> None:
    """Raises ``TypeError`` for a single clip, or a text, instead of the clips of a sentence."""
    if isinstance(clips, (Clip, Word)):
        raise TypeError(f"clips is one {type(clips).__name__}, expected a list of them: splice([a, b])")
    if isinstance(clips, str):
        raise TypeError(f"clips is the text {clips[:60]!r}, expected a list of Clips; {_SOURCES}")


def as_word(clip: object, index: int) -> Word:
    """Returns a word as it is, and a clip as a word. Raises ``TypeError`` for anything else."""
    if isinstance(clip, Clip):
        return Word(clip)
    if isinstance(clip, Word) and isinstance(clip.clip, Clip):
        return clip
    what = repr(clip)[:60] if isinstance(clip, str) else f"a {type(clip).__name__}"
    raise TypeError(f"clip {index} is {what}, expected a Clip; {_SOURCES}")


_SOURCES = "a file's is load(path), a gloss's open_lexicon(path).clip(gloss)"


@dataclass(frozen=True, eq=False)
class Edit:
    """Replaces the motion of some joints of a word in some frames, after planning.

    joints: K indices.
    first_frame: the first of n frames of the retimed word.
    rotations: (n, K, 4) the joints' local rotations in those frames.
    translations: (n, K, 3) their translations from their parents, clip units; None if no bone length is animated.
    """

    joints: tuple[int, ...]
    first_frame: int
    rotations: FloatArray
    translations: FloatArray | None = None

    @property
    def stop(self) -> int:
        """The frame after the last edited one."""
        return self.first_frame + len(self.rotations)


def edit_of(clip: Clip, new: Clip, first_frame: int, joints: Sequence[int]) -> Edit:
    """Returns the edit that sets some joints of ``clip`` as in ``new``, whose frames begin at ``first_frame``."""
    columns = list(joints)
    moves_bones = clip.translations is not None or new.translations is not None
    bones = bone_translations(new)[:, columns] if moves_bones else None
    return Edit(tuple(columns), first_frame, new.local_rotations[:, columns], bones)


def apply_edits(clip: Clip, edits: Sequence[Edit]) -> Clip:
    """Applies edits to the retimed clip of a word, later ones over earlier ones; without edits returns the clip."""
    if not edits:
        return clip
    local, bones = np.array(clip.local_rotations), None
    if any(edit.translations is not None for edit in edits):
        bones = np.array(bone_translations(clip))
    for edit in edits:
        columns = list(edit.joints)
        local[edit.first_frame : edit.stop, columns] = edit.rotations
        if bones is not None and edit.translations is not None:
            bones[edit.first_frame : edit.stop, columns] = edit.translations
    return copy_unchecked(clip, local_rotations=local, translations=clip.translations if bones is None else bones)


@dataclass(frozen=True, eq=False)
class FrameMap:
    """Maps frames of the retimed word to frames of its clip.

    A word's frames have three numberings: in its whole clip at the output rate, in the recorded clip without the stray
    frames at its ends (``AlignedWord.clip``), and in the retimed clip.

    sources: (T,) the recorded frame that each retimed frame shows, rising from 0; fractions are slerps of two frames.
        None if every frame shows the recorded frame of the same number.
    n_left_out: number of frames of the whole clip before the recorded one.
    """

    sources: FloatArray | None = None
    n_left_out: int = 0

    def first(self, recorded: int) -> int:
        """Returns the retimed frame from which on a recorded frame and all after it are shown."""
        return recorded if self.sources is None else int(np.searchsorted(self.sources, recorded, side="right")) - 1

    def last(self, recorded: int) -> int:
        """Returns the retimed frame up to which a recorded frame and all before it are shown."""
        return recorded if self.sources is None else int(np.searchsorted(self.sources, recorded, side="left"))

    def source(self, start: int, stop: int) -> tuple[int, int]:
        """Returns the frames of the whole clip from which retimed frames [start, stop) are made, half-open."""
        if self.sources is None:
            return self.n_left_out + start, self.n_left_out + stop
        first, last = int(np.floor(self.sources[start])), int(np.ceil(self.sources[stop - 1]))
        return self.n_left_out + first, self.n_left_out + last + 1

    def warp(self, start: int, stop: int, output: int) -> tuple[tuple[int, float], ...] | None:
        """Returns for each retimed frame in [start, stop), the first of which is frame ``output`` of a sentence, its
        frame in the sentence and in the whole clip; None if the frames are not retimed.
        """
        if self.sources is None or np.all(self.sources[start:stop] == np.arange(start, stop)):
            return None
        clip_frames = self.sources[start:stop] + self.n_left_out  # exact, see ``retimed``
        return tuple((output + n, float(source)) for n, source in enumerate(clip_frames))


@dataclass(frozen=True)
class HeldEnd:
    """The end of a word that is held before a mark (``pauses``).

    mark: the mark.
    kept: the last recorded frame that the pause does not change.
    leave: the recorded frame that the last frame of the pause shows, at which the word is left.
    """

    mark: str
    kept: int
    leave: int


@dataclass(frozen=True, eq=False)
class ChannelPath:
    """The path of a channel from where the last word that owned it left it (``person``). Times count from the entry of
    the word that follows it, s.

    start: (K, 4) local rotations of its joints there.
    left_s: time at which the word left it.
    begin_s: time at which it begins to move to its place.
    seconds: time that this takes.
    """

    start: FloatArray
    left_s: float
    begin_s: float
    seconds: float

    def later(self, seconds: float) -> ChannelPath:
        """The same path for a word that is entered ``seconds`` later."""
        return replace(self, left_s=self.left_s - seconds, begin_s=self.begin_s - seconds)


@dataclass(frozen=True, eq=False)
class AlignedWord:
    """A word of a sentence, aligned to the first one. Changes after planning are ``Edit``s at its seams, and as it is
    emitted the turns of head and trunk (``carriage``).

    index: its number in the sentence.
    clip: its aligned clip at the output rate, without stray frames at its ends: input of durations.
    retimed: the same at the chosen tempo: output, except edits.
    frames: the recorded frame that each retimed frame shows.
    warnings: about the clip, one line each.
    contacts: contacts of its hands if it was retargeted.
    is_letter: whether it is a letter by its name (fs-A), in any case.
    starts: False for a letter that continues the spelled word before it.
    entry: the recorded frame at which the seam before enters it; 0 for a first word.
    arrival_s: seconds from the letter before to this one; 0 if there is none.
    slide_m: distance by which it slides to the side as a doubled letter, m.
    held: hold at the end of a phrase; None elsewhere.
    own: the aligned clip at its recorded rate and speed, without stray frames: input of cutters; None if equal to
        ``clip``.
    own_step: number of frames of ``own`` per frame of ``clip``.
    own_first: the frame of ``own`` that the first frame of ``clip`` shows, a fraction.
    keyed: whether its recording was drawn between keys (``rig.keyedness``).
    measured: the clip of which channels are measured: the caller's, so that it is done once, or ``clip``.
    brow: as in ``Word``.
    owns: the channels (``roles.CHANNELS``) that belong to it.
    paths: how the channels that it does not own come from the words before (``person``).
    planned: its channels with planned frames.
    recorded: ``retimed`` without these; None if it has none.
    """

    index: int
    clip: Clip
    retimed: Clip
    frames: FrameMap
    warnings: tuple[str, ...] = ()
    contacts: tuple[Contact, ...] = ()
    is_letter: bool = False
    starts: bool = False
    entry: int = 0
    arrival_s: float = 0.0
    slide_m: float = 0.0
    held: HeldEnd | None = None
    own: Clip | None = None
    own_step: float = 1.0
    own_first: float = 0.0
    keyed: bool = False
    measured: Clip | None = None
    brow: str | None = None
    owns: frozenset[str] = frozenset(CHANNELS)
    paths: Mapping[str, ChannelPath] = field(default_factory=dict)
    planned: tuple[str, ...] = ()
    recorded: Clip | None = None

    @property
    def first_frame(self) -> int:
        """The retimed frame at which the word is entered."""
        return self.frames.first(self.entry)

    @property
    def face_by_rules(self) -> bool:
        """Whether the word has a face by rule instead of its own (``face_rules``)."""
        return self.clip.face is None and self.retimed.face is not None

    def nearest_frame(self, own_frame: int) -> int:
        """Returns the frame of ``clip`` nearest in time to a frame of ``own``."""
        if self.own is None:
            return own_frame
        return int(np.clip(round((own_frame - self.own_first) / self.own_step), 0, len(self.clip) - 1))


def cut_words(cutter: Cutter, words: Sequence[AlignedWord]) -> list[Cut]:
    """Returns a cutter's choice for words in order, in frames of ``AlignedWord.clip``. Raises as ``cut_clips`` does."""
    if not cutter.own_rate:
        return cut_clips(cutter, [word.clip for word in words])
    cuts = cut_clips(cutter, [word.own or word.clip for word in words])
    return [
        Cut(before.nearest_frame(cut.pre), after.nearest_frame(cut.post))
        for cut, (before, after) in zip(cuts, pairwise(words), strict=True)
    ]
