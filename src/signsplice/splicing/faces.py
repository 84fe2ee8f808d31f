"""Faces over a seam, and faces by rule for words without a face of their own.

**Over a seam** each face is kept up to its cut and eased into the next one over the new frames. The mouth closes in the
first half of the transition and opens for the next word in the second. A blink is never interrupted: lids that close at
the cut finish closing before they open, lids that open continue, and likewise at the entry of the next word. Brows move
directly from one word to the next, so they stay up, or down, if both words need it. The easing is minimum jerk (Flash
and Hogan 1985), flattened if a coefficient would change from one frame to the next by more than the
``EASING.step_percentile`` percentile of such changes in the two words.

**By rule** faces blink, and brows mark questions. The rules follow grammars of ASL; no signer has judged them here.
Signers blink at the ends of phrases (Baker and Padden 1978; Wilbur 1994, Sign Language Studies 84: 221-240), and people
otherwise every 3 to 6 s (Bentivoglio et al. 1997, Movement Disorders 12: 1028-1034). Brows are raised over a yes-no
question and lowered over one with a question word (Baker-Shenk 1983; Liddell 1980), else neutral. The mouth is closed,
or guessed (``mouthing``).
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


@dataclass(frozen=True)
class EasingSettings:
    """Limits of faces over a seam."""

    step_percentile: float = 95.0
    """Percentile of the changes from frame to frame in two words that limits those of the face between them."""
    longest_blink_s: float = 0.3
    """Longest blink, s (Bentivoglio et al. 1997 and others: 0.1 to 0.4 s)."""
    blinking_speed: float = 0.6
    """Change of the lids per second from which on they count as closing or opening."""
    blinking_depth: float = 0.06
    """Lids that are lower than usual by more than this blink; 1 is closed."""


@dataclass(frozen=True)
class RuleTimes:
    """Times of blinks and brows by rule."""

    brow_ramp_s: float = 0.3
    """Time that brows take at the beginning and end of the text, s; in between they move with transitions."""
    lid_closing_s: float = 0.1
    """Time in which lids close, s: they close faster than they open (VanderWerf et al. 2003)."""
    lid_opening_s: float = 0.18
    """Time in which lids open, s."""
    least_blink_interval_s: float = 3.0
    """Shortest time from one blink to the next, s."""
    added_blink_interval_s: float = 3.0
    """Range of the time added to ``least_blink_interval_s``, s."""
    last_blink_s: float = 0.4
    """Time from the last blink to the end of a text without a final mark, s: hands go down then."""


EASING = EasingSettings()
_RULE_TIMES = RuleTimes()

LIDS = ("eyeBlinkLeft", "eyeBlinkRight")
_OPENINGS = (
    "jawOpen", "mouthClose", "mouthFunnel", "mouthPucker", "mouthLowerDownLeft", "mouthLowerDownRight",
    "mouthUpperUpLeft", "mouthUpperUpRight", "tongueOut",
)  # fmt: skip
"""Coefficients that part or round the lips; smiles and the like extend over several words and are interpolated."""


@dataclass(frozen=True)
class EaseFaces(Pass):
    """Sets the faces of a seam's new frames; runs after ``HoldPauses``, which makes pauses new frames."""

    def concerns(self, seam: Seam) -> bool:
        """Whether there are new frames and a word has a face."""
        has_face = seam.before.retimed.face is not None or seam.after.retimed.face is not None
        return has_face and seam.frames is not None

    def change(self, seam: Seam) -> Seam:
        """Returns the seam with a face in its new frames."""
        before, after, cut = seam.before.retimed, seam.after.retimed, seam.retimed_cut
        last, n_frames = cut.pre + seam.n_held, len(seam.new_frames) - seam.n_held
        by_rules = seam.before.face_by_rules and seam.after.face_by_rules
        faces = before.face or _at_rest(len(before)), after.face or _at_rest(len(after))
        new = ease_face(*faces, last, cut.post, n_frames, before.fps, has_limit=not by_rules)
        pause_weights = faces[0].of(new.channels)[cut.pre + 1 : last + 1]
        face = Face(new.channels, np.concatenate([pause_weights, new.weights]))
        return replace(seam, frames=copy_unchecked(seam.new_frames, face=face))


def _at_rest(n_frames: int) -> Face:
    return Face(LIDS, np.zeros((n_frames, len(LIDS))))


def ease_face(
    before: Face, after: Face, last: int, first: int, n_frames: int, fps: float, has_limit: bool = True
) -> Face:
    """Returns the face in ``n_frames`` new frames between frame ``last`` of one face and ``first`` of another; frames
    beyond these show how a blink continues. ``has_limit``: whether changes are limited to those of the two faces.
    """
    channels = tuple(name for name in ARKIT_CHANNELS if name in {*before.channels, *after.channels})
    a, b = before.of(channels), after.of(channels)  # (T, C)
    limit = largest_step(before, after) if has_limit else np.inf
    weights = _ease_weights(a[last], b[first], n_frames, limit)
    middle = (n_frames + 1) // 2
    even_steps = np.maximum(a[last] / max(middle, 1), b[first] / (n_frames + 1 - middle))  # to 0 and back, evenly
    closing = [k for k, name in enumerate(channels) if name in _OPENINGS and even_steps[k] <= limit]
    if closing and n_frames > 2:
        shut = np.zeros(len(closing))
        there = _ease_weights(a[last, closing], shut, middle - 1, limit)
        back = _ease_weights(shut, b[first, closing], n_frames - middle, limit)
        weights[:, closing] = np.concatenate([there, shut[None], back])
    lids = [k for k, name in enumerate(channels) if name in LIDS]
    if lids and n_frames and (path := _lid_path(a[:, lids], b[:, lids], last, first, fps)):
        speeds = [np.abs(np.diff(track[:, lids], axis=0)).max(initial=limit) for track in (a, b)]
        weights[:, lids] = _along(path, n_frames, (limit, max(speeds)))
    return Face(channels, np.clip(weights, 0.0, 1.0))


def largest_step(*faces: Face) -> float:
    """Returns the ``EASING.step_percentile`` percentile, over the frames of all faces, of the largest change of a
    coefficient from one frame to the next.
    """
    steps = [np.abs(np.diff(face.weights, axis=0)).max(axis=1) for face in faces if len(face) > 1]
    return float(np.percentile(np.concatenate(steps), EASING.step_percentile)) if steps else 0.0


def _ease_weights(start: FloatArray, stop: FloatArray, n_frames: int, limit: float) -> FloatArray:
    """Returns a minimum-jerk path (n_frames, C) between two frames, flattened until no step is larger than ``limit``,
    or than that of an even path.
    """
    u = np.arange(n_frames + 2) / (n_frames + 1)
    smooth = u**3 * (10.0 - 15.0 * u + 6.0 * u**2)
    peak, even = np.diff(smooth).max(), 1.0 / (n_frames + 1)
    change = np.maximum(np.abs(stop - start), 1e-12)
    evenness = np.clip((change * peak - limit) / np.maximum(change * (peak - even), 1e-12), 0.0, 1.0)  # (C,)
    alpha = smooth[1:-1, None] + evenness * (u - smooth)[1:-1, None]
    return np.asarray(start + alpha * (stop - start))


@dataclass(frozen=True)
class _LidPath:
    """The path of lids (2,) over a seam.

    ends: their values at its two ends.
    leaving, entering: turning points after the first end and before the second, in order; the inner ones are open.
    """

    ends: tuple[FloatArray, FloatArray]
    leaving: list[FloatArray]
    entering: list[FloatArray]


def _lid_path(x: FloatArray, y: FloatArray, last: int, first: int, fps: float) -> _LidPath | None:
    """Returns the path of lids between frame ``last`` of one word and ``first`` of the next, from both words' lids
    (T, 2), which completes a blink that is under way at the cut or at the entry of the next word; None if none is.
    """
    n_blink, change = max(1, round(EASING.longest_blink_s * fps)), EASING.blinking_speed / fps
    lids_before, lids_after = x.mean(axis=1), y.mean(axis=1)
    leaves_low = last > 0 and lids_before[last] > np.percentile(lids_before, 25.0) + EASING.blinking_depth
    enters_low = first + 1 < len(y) and lids_after[first] > np.percentile(lids_after, 25.0) + EASING.blinking_depth
    before = lids_before[last] - lids_before[last - 1] if leaves_low else 0.0  # per frame; positive if lids close
    after = lids_after[first + 1] - lids_after[first] if enters_low else 0.0
    open_lids = np.minimum(np.percentile(x, 25.0, axis=0), np.percentile(y, 25.0, axis=0))
    leaving, entering = [open_lids] if abs(before) > change else [], [open_lids] if abs(after) > change else []
    if before > change:
        there = lids_before[last : last + n_blink]
        leaving.insert(0, np.maximum(x[last], x[last + int(there.argmax())] if len(there) > 1 else x.max(axis=0)))
    if after < -change:
        back = lids_after[max(0, first + 1 - n_blink) : first + 1]
        shut = y[first + 1 - len(back) + int(back.argmax())] if len(back) > 1 else y.max(axis=0)
        entering.append(np.maximum(y[first], shut))
    return _LidPath((x[last], y[first]), leaving, entering) if leaving or entering else None


def _along(path: _LidPath, n_frames: int, speeds: tuple[float, float]) -> FloatArray:
    """Returns lids (n_frames, 2): blinks at one of ``speeds`` per frame, the slower one if there is time for it, and
    open lids between them. If there is time for neither, two blinks become one.
    """
    start, stop = path.ends
    points, open_leg = [start, *path.leaving, *path.entering, stop], len(path.leaving)
    for speed in speeds:
        legs = [max(1, int(np.ceil(np.abs(b - a).max() / max(speed, 1e-9) - 1e-9))) for a, b in pairwise(points)]
        spare = n_frames + 1 - sum(legs)
        if spare >= 0:
            legs[open_leg] += spare
            break
    else:
        shut = np.max(points, axis=0)
        to, back = np.abs(shut - start).max(), np.abs(shut - stop).max()
        shut_frame = int(np.clip(round((n_frames + 1) * to / max(to + back, 1e-9)), 1, n_frames))
        points, legs, open_leg = [start, shut, stop], [shut_frame, n_frames + 1 - shut_frame], -1
    parts = [start[None]]
    for k, (a, b, n) in enumerate(zip(points[:-1], points[1:], legs, strict=True)):
        parts += [_ease_weights(a, b, n - 1, speed if k == open_leg else 0.0), b[None]]  # blinks at an even speed
    return np.concatenate(parts)[1:-1]


BLINKS = "blinks"
"""Rule: faces blink."""
BROWS = "brows"
"""Rule: brows mark questions."""
GAZE = "gaze"
"""Rule: eyes stay on the addressee, and now and then look at the hands (``carriage``)."""
RULES = (BLINKS, BROWS, GAZE)
"""Names of the rules; each is optional."""
RAISED = "raised"
"""Brows of a yes-no question."""
FURROWED = "furrowed"
"""Brows of a question with a question word."""
_BROWS = {
    RAISED: {"browInnerUp": 0.7, "browOuterUpLeft": 0.8, "browOuterUpRight": 0.8},
    FURROWED: {"browDownLeft": 0.8, "browDownRight": 0.8},
}
_BROW_CHANNELS = (*_BROWS[RAISED], *_BROWS[FURROWED])
_EYE_TURNS = {
    "eyeLookDown": (0, 1.0), "eyeLookUp": (0, -1.0), "eyeLookOutLeft": (1, 1.0), "eyeLookInRight": (1, 1.0),
    "eyeLookInLeft": (1, -1.0), "eyeLookOutRight": (1, -1.0),
}  # fmt: skip
"""Coefficient of an eye (or of both, without the side) -> its axis of ``turn_eyes``, and sign."""
CHANNELS = tuple(name for name in ARKIT_CHANNELS if name in (*LIDS, *_BROW_CHANNELS))
"""The coefficients of every face by rule; all others are at rest, unless ``with_rules`` is given them."""
_GOLDEN_RATIO = 0.6180339887
"""Fractions of its multiples are spread evenly: blinks come at irregular times, the same in every call."""


def check_rules(rules: Sequence[str]) -> None:
    """Raises ``InputError`` unless all ``rules`` are in ``RULES``."""
    if isinstance(rules, str) or not set(rules) <= set(RULES):
        raise InputError(f"face rules {rules!r:.60}, expected some of {', '.join(RULES)}")


def with_rules(word: AlignedWord, brow: str | None, is_first: bool, *others: Face) -> AlignedWord:
    """Returns the word with a face at rest, or with the brows of a question (``RAISED``, ``FURROWED``), which move
    there from rest in the first word of a sentence; unchanged if it has a face. ``others``: faces over the frames of
    ``word.retimed`` that add coefficients, the same in all words of a sentence. Raises ``InputError`` for another
    ``brow``.
    """
    if brow is not None and brow not in _BROWS:
        raise InputError(f"brows {brow!r:.40} of {word.clip.name}, expected {RAISED} or {FURROWED}")
    if word.clip.face is not None:
        return word
    shape = _BROWS.get(brow or "", {})
    known = set(CHANNELS).union(*(face.channels for face in others))
    channels = tuple(name for name in ARKIT_CHANNELS if name in known)
    weights = np.tile([shape.get(name, 0.0) for name in channels], (len(word.retimed), 1))
    if is_first:
        weights *= _ramp(len(word.retimed), word.retimed.fps)[:, None]
    for face in others:
        weights += face.of(channels)
    return replace(word, retimed=copy_unchecked(word.retimed, face=Face(channels, weights)))


def open_eyes(n_frames: int) -> Face:
    """Returns a face whose eyes look straight ahead."""
    channels = tuple(name for name in ARKIT_CHANNELS if name.startswith("eyeLook"))
    return Face(channels, np.zeros((n_frames, len(channels))))


def turn_eyes(clip: Clip, looks: FloatArray) -> Clip:
    """Returns a clip whose eyes look farther down and to the left by ``looks`` (T, 2), fractions of their largest
    turns; unchanged without a face.
    """
    face = clip.face
    if face is None:
        return clip
    weights = np.array(face.weights)
    for name, (axis, sign) in _EYE_TURNS.items():
        columns = [k for k, channel in enumerate(face.channels) if channel.startswith(name)]
        weights[:, columns] = np.clip(weights[:, columns] + sign * looks[:, axis, None], 0.0, 1.0)
    return copy_unchecked(clip, face=Face(face.channels, weights))


def relax_brows(piece: Piece) -> Piece:
    """Returns the last piece of a sentence with its brows relaxed after its pause, or at its end."""
    face, fps, pause = _face(piece.clip), piece.clip.fps, piece.span.pause
    weights, brows = np.array(face.weights), _columns(face, _BROW_CHANNELS)
    most_held = len(weights) - round(_RULE_TIMES.brow_ramp_s * fps)
    n_held = most_held if pause is None else pause.frames[1] - pause.frames[0]
    n_held = max(0, min(n_held, most_held))
    weights[n_held:, brows] *= 1.0 - _ramp(len(weights) - n_held, fps)[:, None]
    weights[-1, brows] = 0.0
    return replace(piece, clip=copy_unchecked(piece.clip, face=Face(face.channels, weights)))


def _ramp(n_frames: int, fps: float) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Returns a smooth ramp (T,) from 0 to 1 within ``_RULE_TIMES.brow_ramp_s``."""
    u = np.minimum(np.arange(n_frames) / max(1.0, _RULE_TIMES.brow_ramp_s * fps), 1.0)
    return np.asarray(u**3 * (10.0 - 15.0 * u + 6.0 * u**2))


@dataclass(frozen=True)
class Blinks:
    """The time of a sentence's next blink.

    due_s: earliest time of the blink, seconds of the sentence.
    n: number of blinks so far.
    """

    due_s: float = _RULE_TIMES.least_blink_interval_s
    n: int = 0

    def on(self, piece: Piece, is_last: bool) -> tuple[Piece, Blinks]:
        """Adds a blink to a piece whose face is by rule if one is due or a phrase ends, and returns the piece and the
        time of the next blink; returns both unchanged if the piece has no room for a whole blink.
        """
        fps, first = piece.clip.fps, piece.span.output[0]
        lids = _lids(fps)
        room = len(piece.clip) - len(lids)
        ends_phrase = is_last or piece.span.pause is not None
        start = max(0, int(np.ceil(self.due_s * fps)) - first)
        if ends_phrase:
            start = 0 if piece.span.pause is not None else max(0, room - round(_RULE_TIMES.last_blink_s * fps))
        if not 0 <= start <= room:
            return piece, self
        face = _face(piece.clip)
        weights = np.array(face.weights)
        weights[start : start + len(lids), _columns(face, LIDS)] = lids[:, None]
        n, blinked_s = self.n + 1, (first + start) / fps
        added_s = _RULE_TIMES.added_blink_interval_s * (n * _GOLDEN_RATIO % 1.0)
        after = Blinks(blinked_s + _RULE_TIMES.least_blink_interval_s + added_s, n)
        return replace(piece, clip=copy_unchecked(piece.clip, face=Face(face.channels, weights))), after


def _lids(fps: float) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Returns the lids (T,) of one blink, 1 (closed) in one frame, without the open frames before and after it."""
    times = _RULE_TIMES.lid_closing_s, _RULE_TIMES.lid_opening_s
    n_closing, n_opening = (max(1, round(seconds * fps)) for seconds in times)
    u = np.concatenate([np.arange(1, n_closing + 1) / n_closing, 1.0 - np.arange(1, n_opening) / n_opening])
    return np.asarray(u**3 * (10.0 - 15.0 * u + 6.0 * u**2))


def _face(clip: Clip) -> Face:
    assert clip.face is not None
    assert set(CHANNELS) <= set(clip.face.channels), "a face by rule"
    return clip.face


def _columns(face: Face, names: Sequence[str]) -> list[int]:
    return [face.channels.index(name) for name in names]
