"""Touches of a corpus: whether the events of its words say of every posture what its stored motion shows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from signsplice.body import collision
from signsplice.body.capsules import BodyCapsules, body_capsules, capsule_ends
from signsplice.motion import kinematics
from signsplice.motion.clip import Clip
from signsplice.rig.naming import SIDES
from signsplice.synth.corpus import Pairs

TOUCH_CM = 0.5
"""Skin distance up to which a hand is seen to touch."""
_MIRRORED = ("symmetric", "alternating")
_ARM = ("sleeve", "cuff")


@dataclass(frozen=True)
class TouchAgreement:
    """First and last postures of words, by what their events say and what is seen.

    n_postures: postures compared.
    n_touching: those that are seen to touch.
    n_missed: those that are seen to touch, but not flagged.
    n_false: those that are flagged, but not seen to touch.
    """

    n_postures: int
    n_touching: int
    n_missed: int
    n_false: int

    @property
    def agreeing(self) -> float:
        """Fraction of the postures on which both agree."""
        return 1.0 - (self.n_missed + self.n_false) / max(1, self.n_postures)


def score_touches(pairs: Pairs) -> TouchAgreement:
    """Agreement of flagged and seen touches in all words of a corpus. Distances are measured anew, on the stored
    rotations, with the capsules that tell collisions. Version 1 does not say which hands a sign has: there the strong
    hand alone counts.
    """
    flags, distances = [], []
    for k, row in enumerate(pairs.head["words"]):
        events = pairs.events(k)
        signer = pairs.signers[0 if k < len(pairs.head["words"]) // 2 else 1]
        sides = SIDES if row.get("hands") in _MIRRORED else ("left" if signer.left_handed else "right",)
        flags += [events.touches_first, events.touches_last]
        distances += [skin_distance(pairs.word_clip(k), frame, sides) for frame in (events.start, events.end)]
    flagged, seen = np.array(flags, bool), np.array(distances) <= TOUCH_CM
    return TouchAgreement(
        len(seen), int(seen.sum()), n_missed=int((seen & ~flagged).sum()), n_false=int((flagged & ~seen).sum())
    )


def skin_distance(clip: Clip, frame: int, sides: tuple[str, ...]) -> float:
    """Least distance, clip units, from the skin of some hands to head, neck, trunk, other hand and other arm."""
    body = body_capsules(clip.skeleton)
    starts, ends = capsule_ends(body, *kinematics.forward(clip[frame : frame + 1]))
    return -max(float(collision.overlap(starts, ends, body.radii, *_meeting(body, side))[0].max()) for side in sides)


def _meeting(body: BodyCapsules, side: str) -> tuple[list[int], list[int]]:
    """The capsules of a hand and those that it can meet."""
    groups = body.groups
    own, other, across = (groups.left, groups.right, "right") if side == "left" else (groups.right, groups.left, "left")
    arm = [n for n, part in enumerate(body.parts) if part in _ARM and body.sides[n] == across]
    return list(own), [*groups.head, *groups.trunk, *other, *arm]
