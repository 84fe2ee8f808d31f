"""Places in open space that give way a little, where hands at them would bend a wrist farther than is comfortable.

Space before the body has no marks: a hand that is 4 cm lower or farther out still is where it is written. All of a sign
moves alike, so that its movements stay as they are; whatever touches the body or is at it stays where it is.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from signsplice.motion import rotation
from signsplice.motion.arrays import FloatArray
from signsplice.signer import locations, pose
from signsplice.signer.elbows import GRID, hardship
from signsplice.signer.locations import WeakArm
from signsplice.signer.phonology import REST, Posture, Sign, in_space, on_base
from signsplice.signer.signer import Signer

_MOVES = np.array([(0.0, up, fwd) for up in (0.0, -2.0, -4.0, 2.0) for fwd in (0.0, 2.0, 4.0, 6.0)])
"""Displacements that are tried, chest axes, cm."""
_OFF_CM, _ALONG_CM = 16.0, 32.0
"""How far a hand goes off its place, and along itself, where another part of it is there then, for a cost of 1."""
_FIRST_CM, _MOST_CM = 2.6, 4.5
"""How far it goes off at most in its first posture, whose place is written, and later on."""


def taken(sign: Sign, signer: Signer) -> Sign:
    """A written sign at places where its arms are comfortable; the sign itself where something is not in open space."""
    pairs = list(dict.fromkeys((one.strong, one.weak) for one in sign.segments))
    if not all(_is_open(strong, sign) and (weak is None or _is_open(weak, sign)) for strong, weak in pairs):
        return sign
    nothing = np.zeros(27)
    found = []
    for strong, weak in pairs:
        arm = WeakArm(signer, locations.weak_hand(weak, signer) if weak and on_base(strong.location) else nothing)
        made = ((strong, arm), *(((weak, WeakArm(signer, nothing)),) if weak else ()))
        found += [locations.strong_wrist(one, its, sign.hands != "base")[:2] for one, its in made
                  if one.location != REST]  # fmt: skip
    if not found:
        return sign
    wrists, quats = (np.array(x) for x in zip(*found, strict=True))
    arms = pose.solve_arm(wrists + signer.scale * _MOVES[:, None], signer)  # (M, N)
    rotvecs = rotation.log(rotation.multiply(rotation.inverse(arms.fore), quats))
    hard, effort = hardship(arms, rotvecs, signer, GRID[::3])  # (M, N, S)
    easiest = (hard + effort).argmin(axis=-1)[..., None]
    along = _MOVES @ rotation.to_matrix(quats)[..., 0].T  # (M, N)
    off = np.sqrt(np.maximum(np.square(_MOVES).sum(axis=-1)[:, None] - np.square(along), 0.0))
    costs = np.take_along_axis(hard, easiest, axis=-1)[..., 0] + np.square(off / _OFF_CM) + np.square(along / _ALONG_CM)
    costs[(off[:, :1] > _FIRST_CM) | (off > _MOST_CM)] = np.inf
    move = _MOVES[costs.sum(axis=-1).argmin()]
    if not move.any():
        return sign
    segments = (replace(one, strong=_moved(one.strong, move), weak=one.weak and _moved(one.weak, move))
                for one in sign.segments)  # fmt: skip
    return replace(sign, segments=tuple(segments))


def _is_open(posture: Posture, sign: Sign) -> bool:
    """Whether a hand is in open space, or at the other one, which is."""
    return on_base(posture.location) or (in_space(posture.location) and not (posture.touch and sign.hands == "one"))


def _moved(posture: Posture, move: FloatArray) -> Posture:
    """A posture in open space moved (3,)."""
    if posture.location == REST or on_base(posture.location):
        return posture
    out, up, fwd = np.add(posture.shift, move).tolist()
    return replace(posture, shift=(out, up, fwd))
