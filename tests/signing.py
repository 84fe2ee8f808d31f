"""Words of the synthetic signer, each made once for all tests, and how they are seen."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from functools import cache

import numpy as np

from signsplice.motion import Clip, FloatArray, kinematics
from signsplice.signer import notation, planner
from signsplice.signer.phonology import Sign
from signsplice.signer.planner import IsolatedWord
from signsplice.signer.signer import JOINTS, PLAIN, STANDARD, Manner, Signer, draw_signer
from signsplice.splicing.word import Word

MIRRORED = np.array([1.0, -1.0, -1.0, 1.0])
"""Factors of a quaternion seen in the mirror x -> -x."""
SIGNS = {**notation.everyday(), **notation.alphabet()}
"""Every sign of the package, words and letters, by gloss."""


def marked(
    clips: Iterable[Clip],
    starts: Collection[int] = (),
    pauses: Mapping[int, str] | None = None,
    brows: Mapping[int, str] | None = None,
) -> list[Word]:
    """Words of clips: indices of letters with which a spelled word begins, marks and brows by index."""
    held, asked = pauses or {}, brows or {}
    return [Word(clip, k in starts, held.get(k), asked.get(k)) for k, clip in enumerate(clips)]


def sign(gloss: str) -> Sign:
    """A sign of the package, word or letter."""
    return SIGNS[gloss]


def signer_of(seed: int | None, manner: Manner = PLAIN) -> Signer:
    """The standard signer for None, else the signer of a seed, with a manner, by default a plain one."""
    return replace(STANDARD if seed is None else draw_signer(seed), manner=manner)


@cache
def word(gloss: str, seed: int | None = None, fps: float = 30.0) -> IsolatedWord:
    """An isolated word made plainly by ``signer_of(seed)``."""
    return planner.synthesize_word(sign(gloss), signer_of(seed), fps=fps)


def made(*lines: str, hands: str = "one", seed: int | None = None, fps: float = 30.0) -> IsolatedWord:
    """An isolated word from lines of notation."""
    text = f"WORD hands={hands}\n" + "".join(f"  {line}\n" for line in lines)
    return planner.synthesize_word(notation.parse(text)["WORD"], signer_of(seed), fps=fps)


def seen_from_chest(clip: Clip, *names: str) -> tuple[FloatArray, FloatArray]:
    """Rotations (T, K, 3, 3) and positions (T, K, 3) of joints in the chest's axes, from the chest joint."""
    rotations, positions = kinematics.forward(clip, [JOINTS["Spine2"], *(JOINTS[name] for name in names)])
    chest = rotations[:, 0]
    return (
        np.einsum("tba,tkbc->tkac", chest, rotations[:, 1:]),
        np.einsum("tba,tkb->tka", chest, positions[:, 1:] - positions[:, :1]),
    )


def wrists(one: IsolatedWord) -> FloatArray:
    """Positions (T, 2, 3) of left and right wrist from the chest."""
    return seen_from_chest(one.clip, "LeftHand", "RightHand")[1]


def mirror(clip: Clip) -> tuple[FloatArray, FloatArray]:
    """Local rotations (T, 53, 4) and root positions (T, 3) of the clip seen in a mirror, left and right swapped."""
    swap = [JOINTS[_other(name)] for name in JOINTS]
    return clip.local_rotations[:, swap] * MIRRORED, clip.root_positions * [-1.0, 1.0, 1.0]


def _other(name: str) -> str:
    for one, two in (("Left", "Right"), ("Right", "Left")):
        if name.startswith(one):
            return two + name.removeprefix(one)
    return name
