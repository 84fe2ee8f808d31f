"""Faces: over a seam, and by rule for words without a face of their own.

**Over a seam** each face is held to its cut and eased into the next one over the new frames. The mouth closes first: it
does so in the first half of the transition and opens for the next word in the second. A blink is never cut in half:
lids that were closing at the cut close before they open, lids that were opening open at once, and likewise where the
next word is entered. Brows go straight from one word to the next, so that they stay up, or down, where both words ask
for it. The easing is minimum jerk (Flash and Hogan 1985), evened out where a coefficient would change from one frame to
the next by more than ``LIMIT_PERCENTILE`` of such changes in the two words.

**By rule** faces blink, and their brows ask. These are rules of ASL as its grammars state them; no signer has judged
them here. Signers blink at the ends of phrases (Baker and Padden 1978; Wilbur 1994, Sign Language Studies 84: 221-240),
and people else every 3 to 6 s (Bentivoglio et al. 1997, Movement Disorders 12: 1028-1034). Brows are raised over a
question that is answered by yes or no, and lowered over one with a question word (Baker-Shenk 1983; Liddell 1980);
elsewhere they are neutral. The mouth is closed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from signsplice.errors import InputError
from signsplice.motion import Clip, FloatArray, copy_unchecked
from signsplice.motion.face import ARKIT_CHANNELS, Face
from signsplice.splicing.passes import Pass
from signsplice.splicing.result import Piece
from signsplice.splicing.seam import Seam
from signsplice.splicing.word import AlignedWord

LIMIT_PERCENTILE = 95.0
LIDS = ("eyeBlinkLeft", "eyeBlinkRight")
_OPENINGS = (
    "jawOpen", "mouthClose", "mouthFunnel", "mouthPucker", "mouthLowerDownLeft", "mouthLowerDownRight",
    "mouthUpperUpLeft", "mouthUpperUpRight", "tongueOut",
)  # fmt: skip
"""Coefficients that part or round the lips; smiles and the like belong to more than a word and go straight on."""
_BLINK_S = 0.3
"""A blink is over within this time (Bentivoglio et al. 1997 and others: 0.1 to 0.4 s)."""
_SPEED, _LOWERED = 0.6, 0.06
"""Lids close or open where they change by so much a second, and blink where they are by so much lower than usual."""


@dataclass(frozen=True)
class EaseFaces(Pass):
    """Gives the new frames of a seam their faces; after the pass that counts pauses."""

    def concerns(self, seam: Seam) -> bool:
        """Whether there are new frames and a word has a face."""
        has_face = seam.before.retimed.face is not None or seam.after.retimed.face is not None
        return has_face and seam.frames is not None

    def change(self, seam: Seam) -> Seam:
        """The seam with a face in its new frames."""
        before, after, cut = seam.before.retimed, seam.after.retimed, seam.retimed_cut
        last, n_frames = cut.pre + seam.n_held, len(seam.new_frames) - seam.n_held
        by_rules = seam.before.face_by_rules and seam.after.face_by_rules
        faces = before.face or _at_rest(len(before)), after.face or _at_rest(len(after))
        new = ease_face(*faces, last, cut.post, n_frames, before.fps, has_limit=not by_rules)
        held = faces[0].of(new.channels)[cut.pre + 1 : last + 1]
        face = Face(new.channels, np.concatenate([held, new.weights]))
        return replace(seam, frames=copy_unchecked(seam.new_frames, face=face))


def _at_rest(n_frames: int) -> Face:
    return Face(LIDS, np.zeros((n_frames, len(LIDS))))


def ease_face(
    before: Face, after: Face, last: int, first: int, n_frames: int, fps: float, has_limit: bool = True
) -> Face:
    """The face in ``n_frames`` new frames between frame ``last`` of one face and ``first`` of another, whose frames
    beyond say how a blink goes on. ``has_limit``: whether changes are kept below those of the two faces.
    """
    channels = tuple(name for name in ARKIT_CHANNELS if name in {*before.channels, *after.channels})
    a, b = before.of(channels), after.of(channels)  # (T, C)
    limit = largest_step(before, after) if has_limit else np.inf
    out = _ease_weights(a[last], b[first], n_frames, limit)
    middle = (n_frames + 1) // 2
    slowest = np.maximum(a[last] / max(middle, 1), b[first] / (n_frames + 1 - middle))  # even steps through 0
    close = [k for k, name in enumerate(channels) if name in _OPENINGS and slowest[k] <= limit] if n_frames > 2 else []
    if close:
        shut = np.zeros(len(close))
        there = _ease_weights(a[last, close], shut, middle - 1, limit)
        back = _ease_weights(shut, b[first, close], n_frames - middle, limit)
        out[:, close] = np.concatenate([there, shut[None], back])
    lids = [k for k, name in enumerate(channels) if name in LIDS]
    if lids and n_frames and (path := _lid_path(a[:, lids], b[:, lids], last, first, fps)):
        speeds = [np.abs(np.diff(track[:, lids], axis=0)).max(initial=limit) for track in (a, b)]
        out[:, lids] = _along(path, n_frames, (limit, max(speeds)))
    return Face(channels, np.clip(out, 0.0, 1.0))


def largest_step(*faces: Face) -> float:
    """The change of a coefficient from one frame to the next that ``LIMIT_PERCENTILE`` of the frames of all faces stay
    below.
    """
    steps = [np.abs(np.diff(face.weights, axis=0)).max(axis=1) for face in faces if len(face) > 1]
    return float(np.percentile(np.concatenate(steps), LIMIT_PERCENTILE)) if steps else 0.0


def _ease_weights(start: FloatArray, stop: FloatArray, n_frames: int, limit: float) -> FloatArray:
    """Minimum jerk (n_frames, C) between two frames, so far evened out that no step is larger than ``limit``, or than
    even ones are.
    """
    u = np.arange(n_frames + 2) / (n_frames + 1)
    smooth = u**3 * (10.0 - 15.0 * u + 6.0 * u**2)
    most, even = np.diff(smooth).max(), 1.0 / (n_frames + 1)
    change = np.maximum(np.abs(stop - start), 1e-12)
    evenness = np.clip((change * most - limit) / np.maximum(change * (most - even), 1e-12), 0.0, 1.0)  # (C,)
    alpha = smooth[1:-1, None] + evenness * (u - smooth)[1:-1, None]
    return np.asarray(start + alpha * (stop - start))


@dataclass(frozen=True)
class _LidPath:
    """The path of lids (2,) over a seam.

    ends: where they are at its two ends.
    leaving, entering: where they turn after the one and before the other, in order; next to what lies between, open.
    """

    ends: tuple[FloatArray, FloatArray]
    leaving: list[FloatArray]
    entering: list[FloatArray]


def _lid_path(x: FloatArray, y: FloatArray, last: int, first: int, fps: float) -> _LidPath | None:
    """The path of lids between frame ``last`` of one word and ``first`` of the next, from both words' lids (T, 2), so
    that a blink that is under way at the cut, or where the next word is entered, is a whole one; None where none is.
    """
    n_blink, change = max(1, round(_BLINK_S * fps)), _SPEED / fps
    left, entered = x.mean(axis=1), y.mean(axis=1)
    leaves_low = last > 0 and left[last] > np.percentile(left, 25.0) + _LOWERED
    enters_low = first + 1 < len(y) and entered[first] > np.percentile(entered, 25.0) + _LOWERED
    before = left[last] - left[last - 1] if leaves_low else 0.0  # a frame; lids close where it is above 0
    after = entered[first + 1] - entered[first] if enters_low else 0.0
    is_open = np.minimum(np.percentile(x, 25.0, axis=0), np.percentile(y, 25.0, axis=0))
    leaving, entering = [is_open] if abs(before) > change else [], [is_open] if abs(after) > change else []
    if before > change:
        there = left[last : last + n_blink]
        leaving.insert(0, np.maximum(x[last], x[last + int(there.argmax())] if len(there) > 1 else x.max(axis=0)))
    if after < -change:
        back = entered[max(0, first + 1 - n_blink) : first + 1]
        shut = y[first + 1 - len(back) + int(back.argmax())] if len(back) > 1 else y.max(axis=0)
        entering.append(np.maximum(y[first], shut))
    return _LidPath((x[last], y[first]), leaving, entering) if leaving or entering else None


def _along(path: _LidPath, n_frames: int, speeds: tuple[float, float]) -> FloatArray:
    """Lids (n_frames, 2): blinks at one of ``speeds`` a frame, the slower one if there is time for it, and open between
    them. Where there is time for neither, two blinks are one.
    """
    start, stop = path.ends
    points, free = [start, *path.leaving, *path.entering, stop], len(path.leaving)
    for speed in speeds:
        legs = [max(1, int(np.ceil(np.abs(b - a).max() / max(speed, 1e-9) - 1e-9))) for a, b in pairwise(points)]
        spare = n_frames + 1 - sum(legs)
        if spare >= 0:
            legs[free] += spare
            break
    else:
        shut = np.max(points, axis=0)
        to, back = np.abs(shut - start).max(), np.abs(shut - stop).max()
        at = int(np.clip(round((n_frames + 1) * to / max(to + back, 1e-9)), 1, n_frames))
        points, legs, free = [start, shut, stop], [at, n_frames + 1 - at], -1
    out = [start[None]]
    for k, (a, b, n) in enumerate(zip(points[:-1], points[1:], legs, strict=True)):
        out += [_ease_weights(a, b, n - 1, speed if k == free else 0.0), b[None]]  # blinks at an even speed
    return np.concatenate(out)[1:-1]


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


def with_rules(word: AlignedWord, brow: str | None, is_first: bool) -> AlignedWord:
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
    return replace(word, retimed=copy_unchecked(word.retimed, face=Face(CHANNELS, weights)))


def relax_brows(piece: Piece) -> Piece:
    """The last piece of a sentence with its brows back at rest, from the end of its pause on, or at its end."""
    weights, fps, pause = np.array(_face(piece.clip).weights), piece.clip.fps, piece.span.pause
    n_held = len(weights) - round(_RAMP_S * fps) if pause is None else pause.frames[1] - pause.frames[0]
    n_held = max(0, min(n_held, len(weights) - round(_RAMP_S * fps)))
    weights[n_held:, len(LIDS) :] *= 1.0 - _ramp(len(weights) - n_held, fps)[:, None]
    weights[-1, len(LIDS) :] = 0.0
    return replace(piece, clip=copy_unchecked(piece.clip, face=Face(CHANNELS, weights)))


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
        return replace(piece, clip=copy_unchecked(piece.clip, face=Face(CHANNELS, weights))), after


def _lids(fps: float) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """The lids of one blink, closed in one frame, without the open frames before and after it."""
    n_closing, n_opening = (max(1, round(seconds * fps)) for seconds in (_CLOSING_S, _OPENING_S))
    u = np.concatenate([np.arange(1, n_closing + 1) / n_closing, 1.0 - np.arange(1, n_opening) / n_opening])
    return np.asarray(u**3 * (10.0 - 15.0 * u + 6.0 * u**2))


def _face(clip: Clip) -> Face:
    assert clip.face is not None
    assert clip.face.channels == CHANNELS, "a face by rule"
    return clip.face
