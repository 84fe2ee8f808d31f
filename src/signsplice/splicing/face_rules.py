"""The face of a sentence by rule, for words without a face of their own: blinks, and the brows of questions.

Rules of ASL as its grammars state them; no signer has judged them here. Signers blink at the ends of phrases (Baker and
Padden 1978; Wilbur 1994, Sign Language Studies 84: 221-240), and people else every 3 to 6 s (Bentivoglio et al. 1997,
Movement Disorders 12: 1028-1034). Brows are raised over a question that is answered by yes or no, and lowered over one
with a question word (Baker-Shenk 1983; Liddell 1980); elsewhere they are neutral. The mouth is closed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from signsplice.errors import InputError
from signsplice.motion import Clip, unchecked_copy
from signsplice.motion.face import ARKIT_CHANNELS, Face
from signsplice.splicing.passes.face_seams import LIDS
from signsplice.splicing.result import Piece
from signsplice.splicing.words.word import SentenceWord

BLINKS, BROWS = "blinks", "brows"
RULES = (BLINKS, BROWS)
"""Names of the rules, each of which can be left out."""
RAISED, FURROWED = "raised", "furrowed"
_BROWS = {
    RAISED: {"browInnerUp": 0.7, "browOuterUpLeft": 0.8, "browOuterUpRight": 0.8},
    FURROWED: {"browDownLeft": 0.8, "browDownRight": 0.8},
}
CHANNELS = tuple(name for name in ARKIT_CHANNELS if name in (*LIDS, *_BROWS[RAISED], *_BROWS[FURROWED]))
"""The coefficients of a face by rule, the lids first; all others are at rest."""
_RAMP_S = 0.3
"""How long brows take at the beginning and at the end of the text; in between they move with transitions."""
_CLOSING_S, _OPENING_S = 0.1, 0.18
"""Lids close faster than they open (VanderWerf et al. 2003)."""
_LEAST_S, _MORE_S = 3.0, 3.0
_GOLDEN = 0.6180339887
"""Its multiples' fractions are spread evenly: blinks come at odd times, the same ones for every call."""
_BEFORE_END_S = 0.4
"""A blink at the end of a text that has no mark there is over so long before: hands go down then."""


def check_rules(rules: Sequence[str]) -> None:
    """Raise ``InputError`` for what is no tuple of ``RULES``."""
    if isinstance(rules, str) or not set(rules) <= set(RULES):
        raise InputError(f"face rules {rules!r:.60}, expected some of {', '.join(RULES)}")


def with_rules(word: SentenceWord, brow: str | None, is_first: bool) -> SentenceWord:
    """A word without a face of its own with one at rest, or with its brows as a question asks (``RAISED``,
    ``FURROWED``); the word itself where it has a face. Raises ``InputError`` for another ``brow``.
    """
    if brow is not None and brow not in _BROWS:
        raise InputError(f"brows {brow!r:.40} of {word.clip.name}, expected {RAISED} or {FURROWED}")
    if word.clip.face is not None:
        return word
    shape = _BROWS.get(brow or "", {})
    weights = np.tile([shape.get(name, 0.0) for name in CHANNELS], (len(word.retimed), 1))
    if is_first:
        weights *= _ramp(len(word.retimed), word.retimed.fps)[:, None]
    return replace(word, retimed=unchecked_copy(word.retimed, face=Face(CHANNELS, weights)))


def released(piece: Piece) -> Piece:
    """The last piece of a sentence with its brows back at rest, from the end of its pause on, or at its end."""
    weights, fps, pause = np.array(_face(piece.clip).weights), piece.clip.fps, piece.span.pause
    n_held = len(weights) - round(_RAMP_S * fps) if pause is None else pause.frames[1] - pause.frames[0]
    n_held = max(0, min(n_held, len(weights) - round(_RAMP_S * fps)))
    weights[n_held:, len(LIDS) :] *= 1.0 - _ramp(len(weights) - n_held, fps)[:, None]
    weights[-1, len(LIDS) :] = 0.0
    return replace(piece, clip=unchecked_copy(piece.clip, face=Face(CHANNELS, weights)))


def _ramp(n_frames: int, fps: float) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """From 0 to 1 within ``_RAMP_S`` (T,)."""
    u = np.minimum(np.arange(n_frames) / max(1.0, _RAMP_S * fps), 1.0)
    return np.asarray(u**3 * (10.0 - 15.0 * u + 6.0 * u**2))


@dataclass(frozen=True)
class Blinks:
    """When the next blink of a sentence comes.

    due_s: the time from which on it may come, seconds of the sentence.
    n: number of blinks so far.
    """

    due_s: float = _LEAST_S
    n: int = 0

    def on(self, piece: Piece, is_last: bool) -> tuple[Piece, Blinks]:
        """A piece whose face is by rule with a blink where one is due or a phrase ends, if it has room for a whole one,
        and what comes then; both as they are where it has none.
        """
        fps, first = piece.clip.fps, piece.span.output[0]
        lids = _lids(fps)
        room = len(piece.clip) - len(lids)
        ends_phrase = is_last or piece.span.pause is not None
        at = max(0, int(np.ceil(self.due_s * fps)) - first)
        if ends_phrase:
            at = 0 if piece.span.pause is not None else max(0, room - round(_BEFORE_END_S * fps))
        if not 0 <= at <= room:
            return piece, self
        weights = np.array(_face(piece.clip).weights)
        weights[at : at + len(lids), : len(LIDS)] = lids[:, None]
        n, blinked_s = self.n + 1, (first + at) / fps
        after = Blinks(blinked_s + _LEAST_S + _MORE_S * (n * _GOLDEN % 1.0), n)
        return replace(piece, clip=unchecked_copy(piece.clip, face=Face(CHANNELS, weights))), after


def _lids(fps: float) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """The lids of one blink, closed in one frame, without the open frames before and after it."""
    n_closing, n_opening = (max(1, round(seconds * fps)) for seconds in (_CLOSING_S, _OPENING_S))
    u = np.concatenate([np.arange(1, n_closing + 1) / n_closing, 1.0 - np.arange(1, n_opening) / n_opening])
    return np.asarray(u**3 * (10.0 - 15.0 * u + 6.0 * u**2))


def _face(clip: Clip) -> Face:
    assert clip.face is not None
    assert clip.face.channels == CHANNELS, "a face by rule"
    return clip.face
