"""Clips -> one sentence, piece by piece: the filter layer of the paper's eq. 17, for any cutter and transition.

    Y = [P_1 .. P_pre, O, Q_post .. Q_M]: frames of the first word up to pre, new frames O, the second word from post

A piece that has been put out never changes: a word is settled as soon as the next word is known. Frames of a sign are
those of its aligned clip, bit for bit, and under a tempo slerps between them; only transition frames are new, and the
arm of a hand that is idle, where it is given more time (``passes.free_hand``).
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from time import perf_counter

from signsplice.errors import InputError
from signsplice.motion import Clip, concatenate
from signsplice.splicing.methods.duration import MAX_TRANSITION_S
from signsplice.splicing.options import SpliceOptions, not_clips
from signsplice.splicing.result import FaceSources, Piece, Span, SpliceResult
from signsplice.splicing.sentence import SentenceBuilder
from signsplice.splicing.tempo import measured_tempo

__all__ = ["MAX_TRANSITION_S", "Piece", "Span", "SpliceOptions", "SpliceResult", "Stream", "splice", "stream"]


def splice(
    clips: Iterable[Clip],
    options: SpliceOptions | None = None,
    starts: Collection[int] = (),
    pauses: Mapping[int, str] | None = None,
    brows: Mapping[int, str] | None = None,
) -> SpliceResult:
    """Clips in order joined into one continuous clip.

    Neighbouring letters (clips named fs-A) are one spelled word (``joins.letters``); ``starts``: indices of letters
    with which another one begins. ``pauses``: the index of each clip that is held at the end of a phrase, with its mark
    (``passes.pauses``); not where a system splices the words whole. ``brows``: the index of each clip that is part of a
    question, "raised" or "furrowed" (``face_rules``), where the options have rules for faces.

    Raises ``InputError`` where there is no clip or an option is out of range, ``RigMismatchError`` where rigs have
    nothing in common, ``LimitError`` where a clip has too many frames at the output rate, ``TypeError`` for what is no
    clip.
    """
    if isinstance(clips, (Clip, str)):
        raise not_clips(clips)
    sentence = SentenceBuilder(options or SpliceOptions())
    return joined_sentence(sentence, [*sentence.add(clips, starts, pauses, brows), *sentence.end()])


def joined_sentence(sentence: SentenceBuilder, pieces: Sequence[Piece]) -> SpliceResult:
    """All pieces of a sentence joined. Raises ``InputError`` where there is none."""
    tempo, system = sentence.options.tempo, sentence.options.system
    if not pieces:
        raise InputError("nothing to splice, expected at least one clip")
    began = perf_counter()
    signs, n_held = list[tuple[str, tuple[int, int]]](), 0
    for span in (piece.span for piece in pieces):
        if span.kind == "sign":  # pauses are no part of the tempo
            signs.append((span.name or "", (span.output[0] - n_held, span.output[1] - n_held)))
        elif span.pause is not None:
            n_held += span.pause.frames[1] - span.pause.frames[0]
    clip = concatenate([piece.clip for piece in pieces], name=" ".join(name for name, _ in signs if name))
    seconds = sentence.seconds | {"join": sentence.seconds["join"] + perf_counter() - began}
    cutter, transition, bundle = sentence.names
    return SpliceResult(
        clip=clip,
        spans=tuple(piece.span for piece in pieces),
        seams=tuple(piece.seam for piece in pieces if piece.seam is not None),
        warnings=tuple(dict.fromkeys(line for piece in pieces for line in piece.warnings)),
        cutter=cutter,
        transition=transition,
        timing_ms={part: 1e3 * spent for part, spent in seconds.items()},
        bundle=bundle,
        contacts=sentence.contacts,
        tempo=measured_tempo(signs, clip.fps, tempo),
        face=None if clip.face is None else FaceSources(tuple(sentence.faces), sentence.face_rules),
        system=None if system is None else system.described(),
    )


def stream(
    clips: Iterable[Clip],
    options: SpliceOptions | None = None,
    starts: Collection[int] = (),
    pauses: Mapping[int, str] | None = None,
    brows: Mapping[int, str] | None = None,
) -> Iterator[Piece]:
    """Pieces of the sentence in order, each as soon as the next clip is known; joined, they are what ``splice`` gives,
    bit for bit, with one exception: a cutter that chooses all seams of a sentence together sees two words at a time
    here. It chooses otherwise where a word would be left before it was entered.

    Reads ``clips`` one ahead; without any, nothing comes. ``starts``, ``pauses``, ``brows``: as in ``splice``. Raises
    as ``splice`` does, at the clip that is wrong.
    """
    growing = Stream(options)
    if isinstance(clips, (Clip, str)):
        raise not_clips(clips)
    for index, clip in enumerate(clips):
        yield from growing.push(clip, index in starts, (pauses or {}).get(index), (brows or {}).get(index))
    yield from growing.end()


class Stream:
    """A sentence that grows a word at a time: what ``stream`` gives, pushed instead of pulled. It holds one word,
    however long the sentence.

    cutter, transition: names of the methods that are used.

    Raises ``InputError`` for an unknown method.
    """

    def __init__(self, options: SpliceOptions | None = None) -> None:
        self._sentence = SentenceBuilder(options or SpliceOptions())
        self.cutter, self.transition, _ = self._sentence.names

    def push(self, clip: Clip, starts: bool = False, pause: str | None = None, brow: str | None = None) -> list[Piece]:
        """The pieces that are final now that one more word is known: none for the first. ``starts``: whether a letter
        begins another spelled word; ``pause``: the mark after the word, if any; ``brow``: of its question, if any.
        Raises as ``splice`` does; a word that raises is not part of the sentence.
        """
        marks, brows = ({} if text is None else {0: text} for text in (pause, brow))
        return self._sentence.add([clip], (0,) if starts else (), marks, brows)

    def end(self) -> list[Piece]:
        """The rest of the last word; nothing where there was none, or where it was taken already."""
        return self._sentence.end()
