"""A word of a sentence as data: as a caller gives it, and as it stands in the sentence.

``Word`` is what a caller knows: a clip, and how the line was typed. ``AlignedWord`` is its clip aligned to the first
one, with which of its frames are shown when. What the seams beside it change is an ``Edit``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from signsplice.body.contacts import Contact
from signsplice.motion import Clip, FloatArray, bone_translations, copy_unchecked
from signsplice.splicing.contracts import Cut, Cutter, cut_clips

if TYPE_CHECKING:
    from signsplice.lexicon.sentence import SentenceToken


@dataclass(frozen=True, eq=False)
class Word:
    """A word or letter of a sentence as a caller gives it.

    clip: its motion; the clip's name is its gloss, that of a letter fs- and the letter.
    starts: whether a letter begins another spelled word; letters that do not go on with the one before.
    pause: the mark after it at which it is held, one of ``pauses.PAUSES_S``; None: it is not held.
    brow: the brows of the question that it is part of, "raised" or "furrowed" (``faces``); None: it is in none.
    """

    clip: Clip
    starts: bool = False
    pause: str | None = None
    brow: str | None = None


def words_of(tokens: Sequence[SentenceToken], clip_of: Callable[[str], Clip], has_pauses: bool = True) -> list[Word]:
    """The words that sign the tokens of a line (``lexicon.sentence.parse``); ``clip_of``: gloss -> clip, such as
    ``Lexicon.clip``. ``has_pauses``: whether words are held at the marks of the line.
    """
    from signsplice.lexicon.sentence import line_glosses

    return [
        Word(clip_of(one.gloss), one.starts, one.pause if has_pauses else None, one.brow)
        for one in line_glosses(tokens)
    ]


def check_list(clips: object) -> None:
    """Raise ``TypeError`` for one clip, or a text, in place of the clips of a sentence."""
    if isinstance(clips, (Clip, Word)):
        raise TypeError(f"clips is one {type(clips).__name__}, expected a list of them: splice([a, b])")
    if isinstance(clips, str):
        raise TypeError(f"clips is the text {clips[:60]!r}, expected a list of Clips; {_SOURCES}")


def as_word(clip: object, index: int) -> Word:
    """The word that is given as such, or as its clip alone. Raises ``TypeError`` for anything else."""
    if isinstance(clip, Clip):
        return Word(clip)
    if isinstance(clip, Word) and isinstance(clip.clip, Clip):
        return clip
    what = repr(clip)[:60] if isinstance(clip, str) else f"a {type(clip).__name__}"
    raise TypeError(f"clip {index} is {what}, expected a Clip; {_SOURCES}")


_SOURCES = "a file's is load(path), a gloss's open_lexicon(path).clip(gloss)"


@dataclass(frozen=True, eq=False)
class Edit:
    """Joints of a word that do not show its clip for some frames. Edits are the only way to change a word.

    joints: K indices.
    first_frame: the first of n frames of the retimed word.
    rotations: (n, K, 4) the joints' local rotations in those frames.
    translations: (n, K, 3) their translations from their parents, clip units; None where no bone's length is animated.
    """

    joints: tuple[int, ...]
    first_frame: int
    rotations: FloatArray
    translations: FloatArray | None = None

    @property
    def stop(self) -> int:
        """The frame after the last one that is edited."""
        return self.first_frame + len(self.rotations)


def edit_of(clip: Clip, new: Clip, first_frame: int, joints: Sequence[int]) -> Edit:
    """The edit by which some joints of ``clip`` are as in ``new``, whose frames begin at ``first_frame``."""
    columns = list(joints)
    moves_bones = clip.translations is not None or new.translations is not None
    bones = bone_translations(new)[:, columns] if moves_bones else None
    return Edit(tuple(columns), first_frame, new.local_rotations[:, columns], bones)


def apply_edits(clip: Clip, edits: Sequence[Edit]) -> Clip:
    """The retimed clip of a word with its edits, each over those before it; the clip itself without any."""
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
    """Which frame of a word's clip each frame of the retimed word shows.

    A word's frames are counted three times: in its whole clip at the output rate, in the recorded one without the
    stray frames at its ends (``AlignedWord.clip``), and in the retimed one.

    sources: (T,) the recorded frame that each retimed frame shows, rising from 0; between two frames it is their
        slerp. None where every frame shows the recorded frame of its own number.
    n_left_out: how many frames of the whole clip come before the recorded one.
    """

    sources: FloatArray | None = None
    n_left_out: int = 0

    def first(self, recorded: int) -> int:
        """The retimed frame with which to begin so that a recorded frame and all after it are shown."""
        return recorded if self.sources is None else int(np.searchsorted(self.sources, recorded, side="right")) - 1

    def last(self, recorded: int) -> int:
        """The retimed frame with which to end so that a recorded frame and all before it are shown."""
        return recorded if self.sources is None else int(np.searchsorted(self.sources, recorded, side="left"))

    def source(self, start: int, stop: int) -> tuple[int, int]:
        """The frames of the whole clip from which retimed frames [start, stop) are made, half-open."""
        if self.sources is None:
            return self.n_left_out + start, self.n_left_out + stop
        first, last = int(np.floor(self.sources[start])), int(np.ceil(self.sources[stop - 1]))
        return self.n_left_out + first, self.n_left_out + last + 1

    def warp(self, start: int, stop: int, output: int) -> tuple[tuple[int, float], ...] | None:
        """For each of the retimed frames [start, stop), the first of which is frame ``output`` of a sentence, that
        frame and the one of the whole clip that it shows; None where no frame lies between two.
        """
        if self.sources is None or np.all(self.sources[start:stop] == np.arange(start, stop)):
            return None
        whole = self.sources[start:stop] + self.n_left_out  # exact, see ``retimed``
        return tuple((output + n, float(source)) for n, source in enumerate(whole))


@dataclass(frozen=True)
class HeldEnd:
    """How a word ends that is held before a mark (``pauses``).

    mark: the mark.
    kept: the recorded frame up to which it is as without the pause.
    leave: the recorded frame that the last frame of the pause shows, where the word is left.
    """

    mark: str
    kept: int
    leave: int


@dataclass(frozen=True, eq=False)
class AlignedWord:
    """A word of a sentence, aligned to the first one. What comes after planning is an ``Edit`` at one of its seams.

    index: its number in the sentence.
    clip: its aligned clip at the output rate, without stray frames at its ends: what durations see.
    retimed: the same at the tempo asked for: what is put out, but for edits.
    frames: which recorded frame each retimed frame shows.
    warnings: about the clip, one line each.
    contacts: what its hands touch, where it was brought to another body.
    is_letter: whether it is a letter by its name (fs-A), in any case.
    starts: whether it is no letter that goes on with the spelled word before it.
    entry: the recorded frame at which the seam before enters it; 0 for a first word.
    arrival_s: seconds from the letter before to this one; 0 where there is none.
    slide_m: how far it is slid to the side as a doubled letter, m.
    held: how it is held at the end of a phrase; None elsewhere.
    own: the aligned clip at the rate and speed at which it was recorded, without stray frames: what cutters see; None
        where that is ``clip``.
    own_step: how many frames of ``own`` pass in a frame of ``clip``.
    own_first: the frame of ``own`` that the first frame of ``clip`` shows, a fraction.
    keyed: whether its recording was drawn between keys (``rig.keyedness``).
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

    @property
    def first_frame(self) -> int:
        """The retimed frame at which it is entered."""
        return self.frames.first(self.entry)

    @property
    def face_by_rules(self) -> bool:
        """Whether it has no face of its own, and one by rule (``face_rules``)."""
        return self.clip.face is None and self.retimed.face is not None

    def nearest_frame(self, own_frame: int) -> int:
        """The frame of ``clip`` nearest in time to one of ``own``."""
        if self.own is None:
            return own_frame
        return int(np.clip(round((own_frame - self.own_first) / self.own_step), 0, len(self.clip) - 1))


def cut_words(cutter: Cutter, words: Sequence[AlignedWord]) -> list[Cut]:
    """A cutter's choice for words in order, in frames of ``AlignedWord.clip``. Raises as ``cut_clips`` does."""
    if not cutter.own_rate:
        return cut_clips(cutter, [word.clip for word in words])
    cuts = cut_clips(cutter, [word.own or word.clip for word in words])
    return [
        Cut(before.nearest_frame(cut.pre), after.nearest_frame(cut.post))
        for cut, (before, after) in zip(cuts, pairwise(words), strict=True)
    ]
