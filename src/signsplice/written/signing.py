"""Turns written signs into clips: the standard signer performs the compiled sign, with its face."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from signsplice.body import collision
from signsplice.errors import InputError
from signsplice.motion import Clip, kinematics, rotation
from signsplice.signer import phonology, planner
from signsplice.signer.planner import FPS
from signsplice.signer.signer import JOINTS
from signsplice.written import files, nonmanual
from signsplice.written.compiler import compile_sign
from signsplice.written.nonmanual import with_shoulders
from signsplice.written.tree import WrittenSign

_FASTEST_CM_S = 350.0
"""Speed of an elbow about its shoulder above which it jumps, cm/s; the words that ship stay below 275."""

_DEEPEST_CM = 0.5
"""Allowed depth of a hand in the body, cm."""
_FASTEST_TURN = 30.0
"""Angular speed above which a joint turns over, from one limit to the other in a frame, rad/s."""


def animate_sign(sign: WrittenSign, fps: float = FPS, lenient: bool = False) -> Clip:
    """Returns the clip of a written sign, named by its gloss, from rest to rest. Raises ``InputError`` with gloss,
    symbol and place if the sign cannot be compiled. ``lenient``: missing parts of a posture get defaults.
    """
    word = planner.synthesize_word(replace(compile_sign(sign, lenient), gloss=sign.gloss), fps=fps)
    hands = word.events.start, word.events.end + 1
    clip = nonmanual.with_face(with_shoulders(word.clip, sign, hands), sign, hands)
    return replace(clip, notes=(*clip.notes, *deep_hands(clip), *jumps(clip)))


def owned_channels(sign: WrittenSign, lenient: bool = False) -> frozenset[str]:
    """Returns the channels (some of ``roles.CHANNELS``) that are a written sign's own; shoulders are parts of arms.
    Raises and ``lenient`` as in ``animate_sign``.
    """
    moved = {track.part for track in nonmanual.body_tracks(sign, ("shoulder",))}
    arms = {f"{side.lower()} arm" for side in ("Left", "Right") if moved & {side, "both"}}
    return phonology.owned_channels(compile_sign(sign, lenient)) | arms


def deep_hands(clip: Clip) -> Iterator[str]:
    """Yields a line if a hand lies too deep in the body."""
    depth = collision.hand_depths(clip)
    if depth.max() > _DEEPEST_CM:
        yield f"a hand lies {10.0 * depth.max():.0f} mm deep in the body at frame {depth.argmax()}; look at the sign"


def jumps(clip: Clip) -> Iterator[str]:
    """Yields a line for an elbow, and for each arm part, that moves more in a frame than an arm can."""
    chest, *arms = (JOINTS[name] for name in ("Spine2", "LeftArm", "LeftForeArm", "RightArm", "RightForeArm"))
    rotations, positions = kinematics.forward(clip, [chest, *arms])
    seen = np.einsum("tba,tkb->tka", rotations[:, 0], positions[:, 1:] - positions[:, :1])
    steps = np.linalg.norm(np.diff(seen[:, 1::2] - seen[:, ::2], axis=0), axis=-1).max(axis=1) * clip.fps
    jumped = bool(steps.size) and bool(steps.max() > _FASTEST_CM_S)
    if jumped:
        yield f"an elbow jumps at frame {int(steps.argmax()) + 1}: the arm cannot do what is written; look at the sign"
    for part, name in (("Arm", "an upper arm"), ("ForeArm", "a forearm"), ("Hand", "a hand"))[jumped:]:
        arms = [JOINTS[side + part] for side in ("Left", "Right")]
        turns = rotation.angle_between(clip.local_rotations[1:, arms], clip.local_rotations[:-1, arms]).max(axis=1)
        if turns.size and turns.max() * clip.fps > _FASTEST_TURN:
            frame = int(turns.argmax()) + 1
            yield f"{name} turns over at frame {frame}: it cannot turn as is written; look at the sign"


def warnings(sign: WrittenSign) -> tuple[str, ...]:
    """Lists a reader's repairs and omissions, and unsupported items of face and body, one line each."""
    return tuple(f"{sign.where.file}: {sign.gloss}: {line}" for line in (*sign.notes, *nonmanual.left_out(sign)))


def find(path: str | Path, gloss: str = "", lenient: bool = False) -> WrittenSign:
    """Returns the sign of a file with a gloss (case is ignored), or its only sign. Raises ``InputError`` if the sign is
    missing or was rejected.
    """
    read = files.read(path, lenient)
    matches = [sign for name, sign in read.signs.items() if not gloss or name.casefold() == gloss.casefold()]
    if len(matches) == 1:
        return matches[0]
    refused = [error for error in read.refused if not gloss or f" {gloss.casefold()}: " in str(error).casefold()]
    if refused and not matches:
        raise refused[0]
    base = gloss.partition("#")[0].casefold()
    names = sorted(read.signs, key=lambda name: name.partition("#")[0].casefold() != base)
    shown = ", ".join(names[:5]) + (", ..." if len(names) > 5 else "")
    what = f"no sign {gloss[:60]!r}" if gloss else f"{len(read.signs)} signs"
    raise InputError(f"{path}: {what}, expected the gloss of one of its signs: {shown}")


def sign(path: str | Path, gloss: str = "", *, fps: float = FPS, lenient: bool = False) -> Clip:
    """Returns a sign of a SiGML or HamNoSys file (``.sigml``, ``.csv``, ``.json``, ``.txt``) as a clip with its face.

    gloss: gloss of the sign, GLOSS#2 for the second with that gloss; optional if the file has one sign. lenient: leave
    out unknown parts. No signer has checked such signs. Raises ``InputError`` if the sign is missing, or cannot be read
    or compiled.
    """
    return animate_sign(find(path, gloss, lenient), fps, lenient)


def clips(content: bytes, name: str, most: int, fps: float = FPS) -> Iterator[Clip]:
    """Yields the clips of all signs of a file's content, in file order. Raises ``InputError`` if a sign is rejected or
    there are more than ``most``.
    """
    read = files.parse(content, name)
    if read.refused:
        raise read.refused[0]
    if len(read.signs) > most:
        raise InputError(f"{name}: {len(read.signs)} signs, expected at most {most}")
    for written in read.signs.values():
        yield animate_sign(written, fps)
