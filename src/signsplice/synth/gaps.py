"""How far a signer's hands are from what they may touch, skin to skin."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from signsplice.body import collision
from signsplice.body.capsules import body_capsules, capsule_ends
from signsplice.motion import kinematics
from signsplice.motion.clip import Clip
from signsplice.synth import pose
from signsplice.synth.signer import Signer, skeleton

Float = NDArray[np.float64]

TOUCH_CM = 0.5
"""Distance of the skins up to which hands count as touching."""


def skin_gaps(states: Float, signer: Signer) -> Float:
    """Distances (T, 4) between skins, cm, negative inside: of the strong hand and of the weak one from head and trunk,
    of the strong hand from the weak hand or arm, and from the weak hand alone.
    """
    signer = replace(signer, left_handed=False)
    bones = skeleton(signer)
    body = body_capsules(bones)
    starts, ends = capsule_ends(body, *kinematics.forward(Clip(bones, *pose.rotations(states, signer), 30.0)))
    groups = body.groups
    solid = [*groups.head, *groups.trunk]
    parts = zip(body.parts, body.sides, strict=True)
    sleeves = [n for n, (part, side) in enumerate(parts) if side == "left" and part in ("sleeve", "cuff")]

    def gap(own: tuple[int, ...], other: list[int]) -> Float:
        return np.asarray(-collision.overlap(starts, ends, body.radii, own, other)[0].max(axis=(1, 2)))

    between = gap(groups.right, list(groups.left))
    on_arm = np.minimum(between, gap(groups.right, sleeves))
    return np.stack([gap(groups.right, solid), gap(groups.left, solid), on_arm, between], axis=1)
