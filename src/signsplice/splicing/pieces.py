"""The last stage of a sentence: words and new frames put out in order, with edits applied."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from signsplice.motion import Clip, FloatArray
from signsplice.splicing.gap import Cut
from signsplice.splicing.joins.join import SYSTEM, PlannedSeam
from signsplice.splicing.passes.pauses import last_kept
from signsplice.splicing.result import Pause, Piece, Remade, Span
from signsplice.splicing.seam import Seam, score
from signsplice.splicing.words.word import Edit, HeldEnd, SentenceWord, edited


@dataclass(frozen=True, eq=False)
class OpenWord:
    """The last word of a sentence, which is put out when it is known where it is left.

    word: as it is entered.
    entered_by: how good the seam is by which it is entered; None for the first word.
    edits: those at that seam.
    """

    word: SentenceWord
    entered_by: Seam | None = None
    edits: tuple[Edit, ...] = ()


def sign_piece(open_word: OpenWord, edits: Sequence[Edit], stop: int, output: int) -> Piece:
    """A word from where it is entered to its retimed frame ``stop``, with its ``edits``; ``output``: frame of the
    sentence at which it begins.
    """
    word, start = open_word.word, open_word.word.first_frame
    span = Span(
        kind="sign",
        clip=word.index,
        name=word.clip.name,
        source=word.frames.source(start, stop),
        output=(output, output + stop - start),
        warp=word.frames.warp(start, stop, output),
        remade=edited_part(edits, word.clip.skeleton.names, (start, stop), output) if edits else None,
    )
    return Piece(edited(word.retimed, edits)[start:stop], span, open_word.entered_by, word.warnings)


def transition_piece(new: Clip, output: int, n_held: int = 0, held: HeldEnd | None = None) -> Piece:
    """New frames, the first of which is frame ``output`` of the sentence, and of which ``n_held`` are the pause of a
    word that is ``held``.
    """
    pause = Pause(held.mark, (output, output + n_held)) if held is not None and n_held else None
    return Piece(new, Span("transition", None, None, None, (output, output + len(new)), pause=pause))


def last_pieces(last: OpenWord, output: int) -> list[Piece]:
    """The rest of a sentence's last word: a sign, and where it is held, the pause with what comes after it."""
    word, n_frames = last.word, len(last.word.retimed)
    stop = n_frames if word.held is None else min(word.frames.last(last_kept(word)) + 1, n_frames)
    sign = sign_piece(last, last.edits, stop, output)
    if word.held is None or stop == n_frames:
        return [sign]
    new = edited(word.retimed, last.edits)[stop:]
    n_held = max(0, word.frames.last(word.held.leave) + 1 - stop)
    return [sign, transition_piece(new, sign.span.output[1], n_held, word.held)]


def edited_part(edits: Sequence[Edit], names: Sequence[str], frames: tuple[int, int], output: int) -> Remade | None:
    """What a span of a word's retimed ``frames``, the first of which is frame ``output`` of the sentence, says of edits
    in it; None where it holds none. Several edits are one part, from the first frame to the last.
    """
    start, stop = frames
    inside = [edit for edit in edits if edit.first_frame < stop and edit.stop > start]
    if not inside:
        return None
    joints = sorted({joint for edit in inside for joint in edit.joints})
    first = max(start, min(edit.first_frame for edit in inside))
    last = min(stop, max(edit.stop for edit in inside))
    return Remade(tuple(names[joint] for joint in joints), (first - start + output, last - start + output))


def scored(seam: PlannedSeam, positions: FloatArray) -> Seam:
    """How good a seam is; ``positions``: of ``seam.seam_positions``."""
    left_out = seam.before.frames.n_left_out, seam.after.frames.n_left_out
    whole = Cut(seam.cut.pre + left_out[0], seam.cut.post + left_out[1])
    names = seam.before.clip.name, seam.after.clip.name
    return score(
        seam.gap, seam.filled, *names, whole, seam.warnings, by_system=seam.kind == SYSTEM, positions=positions
    )
