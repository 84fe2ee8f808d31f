"""Faces over a seam: each is held to its cut and eased into the next one over the new frames.

The mouth closes first: it does so in the first half of the transition and opens for the next word in the second. A
blink is never cut in half: lids that were closing at the cut close before they open, and lids that are opening where
the next word is entered were closed before. Brows go straight from one word to the next, so that they stay up, or down,
where both words ask for it. The easing is minimum jerk (Flash and Hogan 1985), evened out where a coefficient would
change from one frame to the next by more than ``LIMIT_PERCENTILE`` of such changes in the two words.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from signsplice.motion.arrays import FloatArray
from signsplice.motion.clip import unchecked_copy
from signsplice.motion.face import ARKIT_CHANNELS, Face
from signsplice.splicing.joins.join import PlannedSeam
from signsplice.splicing.passes.seam_pass import SeamPass

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
class EaseFaces(SeamPass):
    """Gives the new frames of a seam their faces; after the pass that counts pauses."""

    def concerns(self, seam: PlannedSeam) -> bool:
        """Whether there are new frames and a word has a face."""
        has_face = seam.before.retimed.face is not None or seam.after.retimed.face is not None
        return has_face and seam.filled is not None

    def change(self, seam: PlannedSeam) -> PlannedSeam:
        """The seam with a face in its new frames."""
        before, after, cut = seam.before.retimed, seam.after.retimed, seam.retimed_cut
        last, n_frames = cut.pre + seam.n_held, len(seam.made.clip) - seam.n_held
        by_rules = seam.before.face_by_rules and seam.after.face_by_rules
        faces = before.face or _at_rest(len(before)), after.face or _at_rest(len(after))
        new = eased(*faces, last, cut.post, n_frames, before.fps, has_limit=not by_rules)
        held = faces[0].of(new.channels)[cut.pre + 1 : last + 1]
        face = Face(new.channels, np.concatenate([held, new.weights]))
        return replace(seam, filled=replace(seam.made, clip=unchecked_copy(seam.made.clip, face=face)))


def _at_rest(n_frames: int) -> Face:
    return Face(LIDS, np.zeros((n_frames, len(LIDS))))


def eased(before: Face, after: Face, last: int, first: int, n_frames: int, fps: float, has_limit: bool = True) -> Face:
    """The face in ``n_frames`` new frames between frame ``last`` of one face and ``first`` of another, whose frames
    beyond say how a blink goes on. ``has_limit``: whether changes are kept below those of the two faces.
    """
    channels = tuple(name for name in ARKIT_CHANNELS if name in {*before.channels, *after.channels})
    a, b = before.of(channels), after.of(channels)  # (T, C)
    limit = largest_step(before, after) if has_limit else np.inf
    out = _eased(a[last], b[first], n_frames, limit)
    middle = (n_frames + 1) // 2
    for k, name in enumerate(channels):
        closes = max(a[last, k] / max(middle, 1), b[first, k] / (n_frames + 1 - middle)) <= limit
        if name in _OPENINGS and n_frames > 2 and closes:
            out[:, k] = _through(a[last, k], 0.0, b[first, k], n_frames, middle, limit)
    lids = [k for k, name in enumerate(channels) if name in LIDS]
    if lids and n_frames:
        x, y = a[:, lids], b[:, lids]
        via = _turning_point(x, y, last, first, fps)
        steps = [np.abs(np.diff(track, axis=0)).max(initial=0.0) for track in (x, y)]
        if via is not None:
            to, back = np.abs(via - x[last]).max(), np.abs(via - y[first]).max()
            at = int(np.clip(round((n_frames + 1) * to / max(to + back, 1e-9)), 1, n_frames))
            for column, k in enumerate(lids):
                out[:, k] = _through(x[last, column], via[column], y[first, column], n_frames, at, max(limit, *steps))
    return Face(channels, np.clip(out, 0.0, 1.0))


def largest_step(*faces: Face) -> float:
    """The change of a coefficient from one frame to the next that ``LIMIT_PERCENTILE`` of the frames of all faces stay
    below.
    """
    steps = [np.abs(np.diff(face.weights, axis=0)).max(axis=1) for face in faces if len(face) > 1]
    return float(np.percentile(np.concatenate(steps), LIMIT_PERCENTILE)) if steps else 0.0


def _eased(start: FloatArray, stop: FloatArray, n_frames: int, limit: float) -> FloatArray:
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


def _through(start: float, via: float, stop: float, n_frames: int, at: int, limit: float) -> FloatArray:
    """A coefficient (n_frames,) that is eased to ``via`` at step ``at`` of n_frames + 1, and from there."""
    legs = (start, via, at - 1), (via, stop, n_frames - at)
    there, back = (_eased(np.array([a]), np.array([b]), n, limit)[:, 0] for a, b, n in legs)
    return np.concatenate([there, [via], back])


def _turning_point(x: FloatArray, y: FloatArray, last: int, first: int, fps: float) -> FloatArray | None:
    """Where lids (2,) have to be between frame ``last`` of one word and ``first`` of the next, given both words' lids
    (T, 2): closed where a blink would be cut in half, open between two blinks; None where they go straight on.
    """
    n_blink, change = max(1, round(_BLINK_S * fps)), _SPEED / fps
    left, entered = x.mean(axis=1), y.mean(axis=1)
    usual = np.percentile(left, 25.0), np.percentile(entered, 25.0)
    leaves_low, enters_low = left[last] > usual[0] + _LOWERED, entered[first] > usual[1] + _LOWERED
    closes = bool(leaves_low and last > 0 and left[last] - left[last - 1] > change)
    opens = bool(enters_low and first + 1 < len(y) and entered[first] - entered[first + 1] > change)
    if closes or opens:
        there, back = left[last : last + n_blink], entered[max(0, first + 1 - n_blink) : first + 1]
        after_cut = x[last + int(there.argmax())] if len(there) > 1 else x.max(axis=0)
        before_entry = y[first + 1 - len(back) + int(back.argmax())] if len(back) > 1 else y.max(axis=0)
        ends = ([after_cut] if closes else []) + ([before_entry] if opens else [])
        return np.asarray(np.max([*ends, x[last], y[first]], axis=0))
    if leaves_low and enters_low and first + 1 < len(y) and entered[first + 1] - entered[first] > change:
        return np.minimum(np.percentile(x, 25.0, axis=0), np.percentile(y, 25.0, axis=0))
    return None
