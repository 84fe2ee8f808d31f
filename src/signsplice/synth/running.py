"""Sentences as they are signed: a row of isolated words joined by true transitions, with what running signing changes.

Where nothing changes, a word's kept frames are its isolated frames, bit for bit. Two rules change some, and say so: a
weak hand that the words on both sides need stays up through a one-handed word between them, and a pointing pronoun
takes on part of the next word's handshape (Bayley, Lucas and Rose 2002 found it to vary more than any other sign).
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from signsplice.errors import InputError
from signsplice.motion.clip import Clip
from signsplice.synth import pose, truth
from signsplice.synth.avoidance import intrusion
from signsplice.synth.planner import IsolatedWord, resting
from signsplice.synth.signer import skeleton

Float = NDArray[np.float64]

PRONOUNS = frozenset({"I", "YOU", "HE-SHE", "THEY", "THIS", "THAT", "THERE"})
"""Pointing signs, which assimilate; only with the pointing hand's own shape."""
ASSIMILATION = 0.4
"""Share of the way to the next word's handshape that a pronoun's fingers go."""


@dataclass(frozen=True)
class Stretch:
    """A run of frames [start, stop) of a sentence: a ``word``'s frames from ``source`` on, or a transition (None).
    changed: "weak" where the weak hand stays, "fingers" where the handshape assimilates; "" for the very frames.
    """

    start: int
    stop: int
    word: int | None
    source: int | None
    changed: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Utterance:
    """A signed sentence: its words, the truth of every seam, its clip, and where each frame comes from."""

    words: tuple[IsolatedWord, ...]
    seams: tuple[truth.Splice, ...]
    clip: Clip
    stretches: tuple[Stretch, ...]


def utter(words: Sequence[IsolatedWord], changes: bool = True) -> Utterance:
    """The sentence of words of one signer and rate, from the first one's rest to the last one's.

    changes: let weak hands stay and pronouns assimilate; without, every kept frame is an isolated one. Raises
    ``InputError`` for no words, or words of two signers.
    """
    if not words:
        raise InputError("no words, expected at least one")
    for word in words[1:]:
        truth.check_alike(words[0], word)
    relations = [truth.relation(p, q) for p, q in itertools.pairwise(words)]
    leaves = [truth.leave(p, seen) for p, seen in zip(words[:-1], relations, strict=True)]
    enters = [0, *(truth.enter(q, seen) for q, seen in zip(words[1:], relations, strict=True))]
    said: list[tuple[Float, tuple[str, ...]]] = [(word.states, ()) for word in words]
    if changes:
        for k in range(len(words) - 1):
            said[k] = _changed(words, said, k, leaves, enters)
    pieces: list[tuple[Float, Float]] = []
    stretches: list[Stretch] = []
    seams = []
    at = 0
    for k, word in enumerate(words):
        stop = leaves[k] + 1 if k < len(leaves) else len(word)
        kept = slice(enters[k], stop)
        states, changed = said[k]
        if changed:
            pieces.append(pose.rotations(states[kept], word.who))
        else:
            pieces.append((word.clip.local_rotations[kept], word.clip.root_positions[kept]))
        stretches.append(Stretch(at, at + stop - enters[k], k, enters[k], changed))
        at += stop - enters[k]
        if k < len(leaves):
            before, after = states[leaves[k] - 2 : leaves[k] + 1], said[k + 1][0][enters[k + 1] : enters[k + 1] + 3]
            between = truth.between(before, after, word)
            pieces.append(pose.rotations(between, word.who))
            seams.append(truth.Splice(leaves[k], enters[k + 1], between))
            stretches.append(Stretch(at, at + len(between), None, None))
            at += len(between)
    clip = Clip(
        skeleton(words[0].who),
        np.concatenate([rotations for rotations, _ in pieces]),
        np.concatenate([roots for _, roots in pieces]),
        words[0].clip.fps,
        " ".join(word.sign.gloss for word in words),
    )
    return Utterance(tuple(words), tuple(seams), clip, tuple(stretches))


def _changed(
    words: Sequence[IsolatedWord],
    said: Sequence[tuple[Float, tuple[str, ...]]],
    k: int,
    leaves: Sequence[int],
    enters: Sequence[int],
) -> tuple[Float, tuple[str, ...]]:
    """What running signing makes of the states of word ``k``, and the names of the changes."""
    word, states, changed = words[k], words[k].states, []
    following = words[k + 1]
    if k > 0 and not word.sign.two_handed and words[k - 1].sign.two_handed and following.sign.two_handed:
        stays = states.copy()
        small = states[:, 27:54] - resting(word.who, word.sign.gloss)[27:54]
        stays[:, 27:54] = said[k - 1][0][leaves[k - 1], 27:54] + small
        if intrusion(stays[enters[k] : leaves[k] + 1], word.who)[0].max() < truth.TOO_DEEP_CM:
            states, changed = stays, ["weak"]
    points = word.sign.gloss in PRONOUNS and word.sign.segments[0].strong.shape in ("1", "index")
    other = following.states[following.events.start, pose.FINGERS]
    if points and np.abs(other - states[leaves[k], pose.FINGERS]).mean() > 0.1:
        states = states.copy()
        states[:, pose.FINGERS] += ASSIMILATION * (other - states[:, pose.FINGERS])
        changed.append("fingers")
    return states, tuple(changed)
