"""Mouthing: phonemes in SAMPA -> visemes -> a mouth over time. Phonemes are given; none is guessed from spelling.

A table of our own, from the places of articulation in the IPA and what SAMPA (Wells 1997; X-SAMPA for the rest) names
by them: sounds that look alike share a viseme (Fisher 1968, "Confusions among visually perceived consonants"). A
mouthing goes with its sign in time (Boyes Braem and Sutton-Spence 2001, "The Hands are the Head of the Mouth"): the
sounds are stretched over it.
"""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np

from signsplice.errors import InputError
from signsplice.motion.arrays import FloatArray
from signsplice.motion.clip import Clip
from signsplice.motion.face import ARKIT_CHANNELS, Face
from signsplice.motion.face_shapes import MOUTH, VISEMES

_ONE = {
    "PP": "p b m", "FF": "f v", "TH": "T D", "DD": "t d l 5 L", "kk": "k g N x h C G ? c X q",
    "CH": "S Z tS dZ", "SS": "s z", "nn": "n J", "RR": "r R 4", "aa": "a A { V a: A:", "E": "e E @ 3 e: E: 3:",
    "I": "i I j i:",
    "O": "o O Q 9 2 o: O: 2: 9:", "U": "u U y Y w H u: y:",
}  # fmt: skip
SOUNDS = {
    **{sound: (viseme,) for viseme, sounds in _ONE.items() for sound in sounds.split()},
    "ts": ("DD", "SS"), "dz": ("DD", "SS"), "aI": ("aa", "I"), "eI": ("E", "I"), "OI": ("O", "I"), "OY": ("O", "I"),
    "aU": ("aa", "U"), "@U": ("E", "U"), "oU": ("O", "U"), "I@": ("I", "E"), "e@": ("E", "E"), "U@": ("U", "E"),
}  # fmt: skip
"""SAMPA -> its visemes in order."""
A_SECOND = 6.7
"""Phonemes a second where there is no sign to go with."""
_SIGNS = re.compile("|".join(re.escape(sound) for sound in sorted(SOUNDS, key=len, reverse=True)))
_NO_SOUND = re.compile(r"[\s.\"%'_|:~-]+")
"""What parts syllables and words, marks of stress, of length and of nasal sounds."""
_LENGTHS = {1: 1.0, 2: 0.75}
"""Length of each shape of a sound that has one, or two."""
_WIDTH = 0.5
"""Fraction of a sound's time in which its shape goes over into the next one's, on either side of their border: what
is said next shows before it is heard (Cohen and Massaro 1993).
"""


def visemes(sampa: str) -> list[list[str]]:
    """The visemes of each sound of a text in SAMPA. Raises ``InputError`` for what is no sound, or where none is."""
    found, at = list[list[str]](), 0
    while at < len(sampa):
        if between := _NO_SOUND.match(sampa, at):
            at = between.end()
            continue
        sound = _SIGNS.match(sampa, at)
        if sound is None:
            raise InputError(
                f"mouth {sampa[:60]!r}: {sampa[at]!r} is no sound of SAMPA that is known: {' '.join(SOUNDS)}"
            )
        found.append(list(SOUNDS[sound[0]]))
        at = sound.end()
    if not found:
        raise InputError(f"mouth {sampa[:60]!r} has no sound, expected phonemes in SAMPA such as h @ l @U")
    return found


def shapes(sampa: str) -> list[tuple[str, float]]:
    """Each viseme of a text in SAMPA with its length in sounds. Raises as ``visemes`` does."""
    return [(name, _LENGTHS[len(sound)]) for sound in visemes(sampa) for name in sound]


def mouthing(sampa: str, fps: float, seconds: float | None = None) -> Face:
    """The mouth that says the sounds of a text in SAMPA, from closed to closed; by default at ``A_SECOND``."""
    said = [("sil", 0.5), *shapes(sampa), ("sil", 0.5)]
    lengths = np.array([length for _, length in said])  # sounds
    channels = tuple(name for name in ARKIT_CHANNELS if any(name in VISEMES[shape] for shape, _ in said))
    targets = np.array([[VISEMES[shape].get(name, 0.0) for name in channels] for shape, _ in said])  # (S, C)
    seconds = lengths.sum() / A_SECOND if seconds is None else seconds
    n_frames = max(2, round(seconds * fps))
    at = np.linspace(0.0, lengths.sum(), n_frames)  # (T,)
    return Face(channels, np.clip(blended(at, lengths, targets), 0.0, 1.0))


def blended(at: FloatArray, lengths: FloatArray, targets: FloatArray) -> FloatArray:
    """Targets (S, C) one after another at places (T,) in the unit of their lengths (S,), each eased into the next."""
    borders = np.cumsum(lengths)[:-1]
    out = np.tile(targets[0], (len(at), 1))
    for border, before, after, step in zip(borders, lengths[:-1], lengths[1:], np.diff(targets, axis=0), strict=True):
        half = _WIDTH * min(before, after)
        u = np.clip((at - border + half) / (2.0 * half), 0.0, 1.0)
        out += (u**3 * (10.0 - 15.0 * u + 6.0 * u**2))[:, None] * step
    return out


def with_mouthing(clip: Clip, sampa: str, frames: tuple[int, int]) -> Clip:
    """A clip whose mouth says sounds during its sign, half-open ``frames``, and is closed else; the rest of its face is
    kept. Raises ``InputError`` as ``visemes`` does.
    """
    start, stop = frames
    mouth = mouthing(sampa, clip.fps, (stop - start) / clip.fps)
    kept = () if clip.face is None else tuple(name for name in clip.face.channels if not name.startswith(MOUTH))
    channels = tuple(name for name in ARKIT_CHANNELS if name in (*mouth.channels, *kept))
    weights = np.zeros((len(clip), len(channels)))
    if clip.face is not None:
        weights += np.where([name in kept for name in channels], clip.face.of(channels), 0.0)
    stop = min(start + len(mouth), len(clip))
    weights[start:stop] += mouth.of(channels)[: stop - start]
    return replace(clip, face=Face(channels, weights))
