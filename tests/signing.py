"""Words of the procedural signer, each made once for all tests, and what is looked at in them."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from signsplice.motion import kinematics
from signsplice.motion.clip import Clip
from signsplice.synth import notation, planner
from signsplice.synth.phonology import Sign
from signsplice.synth.planner import IsolatedWord
from signsplice.synth.signer import JOINTS, STANDARD, Signer, signer

Float = NDArray[np.float64]

MIRRORED = np.array([1.0, -1.0, -1.0, 1.0])
"""A rotation seen in the mirror x -> -x."""


def sign(gloss: str) -> Sign:
    """A sign that ships, word or letter."""
    return {**notation.everyday(), **notation.alphabet()}[gloss]


def who(seed: int | None) -> Signer:
    """The standard signer for None, else the one of a seed."""
    return STANDARD if seed is None else signer(seed)


@cache
def word(gloss: str, seed: int | None = None, fps: float = 30.0) -> IsolatedWord:
    """An isolated word as ``who(seed)`` made it."""
    return planner.isolated(sign(gloss), who(seed), fps=fps)


def made(*lines: str, hands: str = "one", seed: int | None = None, fps: float = 30.0) -> IsolatedWord:
    """An isolated word written on the spot."""
    text = f"WORD hands={hands}\n" + "".join(f"  {line}\n" for line in lines)
    return planner.isolated(notation.parse(text)["WORD"], who(seed), fps=fps)


def seen_from_chest(clip: Clip, *names: str) -> tuple[Float, Float]:
    """Rotations (T, K, 3, 3) and places (T, K, 3) of joints in the chest's axes and from the chest joint."""
    turns, places = kinematics.forward(clip, [JOINTS["Spine2"], *(JOINTS[name] for name in names)])
    chest = turns[:, 0]
    return (
        np.einsum("tba,tkbc->tkac", chest, turns[:, 1:]),
        np.einsum("tba,tkb->tka", chest, places[:, 1:] - places[:, :1]),
    )


def mirror(clip: Clip) -> tuple[Float, Float]:
    """Local rotations (T, 53, 4) and root places (T, 3) of the clip seen in a mirror, left joints for right ones."""
    swap = [JOINTS[_other(name)] for name in JOINTS]
    return clip.local_rotations[:, swap] * MIRRORED, clip.root_positions * [-1.0, 1.0, 1.0]


def _other(name: str) -> str:
    for one, two in (("Left", "Right"), ("Right", "Left")):
        if name.startswith(one):
            return two + name.removeprefix(one)
    return name
