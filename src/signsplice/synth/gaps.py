"""How far a signer's hands are from what they may touch, skin to skin."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from signsplice.body import collision
from signsplice.body.capsules import BodyCapsules, body_capsules, capsule_ends
from signsplice.motion import kinematics
from signsplice.motion.arrays import FloatArray
from signsplice.motion.clip import Clip
from signsplice.synth import pose
from signsplice.synth.signer import Signer, skeleton

TOUCH_CM = 0.5
"""Distance of the skins up to which hands count as touching."""


def hand_gaps(states: FloatArray, signer: Signer) -> FloatArray:
    """Distances (T, 4) between skins, cm, negative inside: of the strong hand and of the weak one from head and trunk,
    of the strong hand from the weak hand or arm, and from the weak hand alone.
    """
    body, starts, ends = _posed(states, signer)
    groups = body.groups
    solid = (*groups.head, *groups.trunk)
    parts = zip(body.parts, body.sides, strict=True)
    arm = tuple(n for n, (part, side) in enumerate(parts) if side == "left" and part in ("sleeve", "cuff"))
    pairs = ((groups.right, solid), (groups.left, solid), (groups.right, arm), (groups.right, groups.left))
    gaps = np.stack([_gap(body, starts, ends, *pair) for pair in pairs], axis=1)
    gaps[:, 2] = gaps[:, 2:].min(axis=1)
    return gaps


def between_hands(states: FloatArray, signer: Signer) -> FloatArray:
    """Distance (T,) between the skins of the two hands, cm, negative inside."""
    body, starts, ends = _posed(states, signer)
    return _gap(body, starts, ends, body.groups.right, body.groups.left)


def _posed(states: FloatArray, signer: Signer) -> tuple[BodyCapsules, FloatArray, FloatArray]:
    """The capsules of a right-handed signer's body, and where their axes (T, C, 3) start and end."""
    signer = replace(signer, left_handed=False)
    bones = skeleton(signer)
    body = body_capsules(bones)
    return body, *capsule_ends(body, *kinematics.forward(Clip(bones, *pose.rotations(states, signer), 30.0)))


def _gap(
    body: BodyCapsules, starts: FloatArray, ends: FloatArray, own: tuple[int, ...], other: tuple[int, ...]
) -> FloatArray:
    return np.asarray(-collision.overlap(starts, ends, body.radii, own, other)[0].max(axis=(1, 2)))
