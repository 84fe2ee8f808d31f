"""Words of two or three parts, made of postures and strokes of words that ship and joined by splines: where they are
signed is known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from signsplice.motion import Clip, FloatArray
from signsplice.motion.curves import minimum_jerk
from signsplice.signer import planner, pose
from signsplice.signer.handshapes import HANDSHAPES
from signsplice.signer.locations import resting
from signsplice.signer.phonology import Sign
from signsplice.signer.planner import IsolatedWord
from signsplice.signer.signer import RESTS, Signer, stream
from signsplice.signer.trajectory import travel_seconds

FPS = 30.0
KINDS = ("parts", "zigzag", "hands", "shapes", "fast exit")
"""parts: strokes of two or three words, after the first by one hand where another word is signed so. zigzag: the hand
goes down before the belly, to and fro. hands: one hand signs, then the other. shapes: one stroke, then another shape in
the same place. fast exit: one stroke whose end is no stop, and hands that fall to rest at 2.5 m/s or more.
"""


@dataclass(frozen=True, eq=False)
class MadeWord:
    """A word with the frames of its first and its last stroke.

    kind: of ``KINDS``.
    clip: rest, the strokes, rest.
    first, last: the frame at which the first stroke begins, and that at which the last one ends.
    """

    kind: str
    clip: Clip
    first: int
    last: int

    def loses_stroke(self, first: int, last: int) -> bool:
        """Whether frames ``first`` to ``last`` leave out more than a frame of the strokes."""
        return first > self.first + 1 or last < self.last - 1


def made_words(n_words: int, signs: Sequence[Sign]) -> list[MadeWord]:
    """So many words from the strokes of ``signs``, all kinds and all rests in turn."""
    moving, out = [sign for sign in signs if len(sign.segments) > 1], []
    for number in range(n_words):
        rng = stream("made words", number)
        signer = Signer(rest=RESTS[number // len(KINDS) % len(RESTS)])
        kind = KINDS[number % len(KINDS)]
        n_strokes = {"parts": int(rng.integers(2, 4)), "hands": 2}.get(kind, 1)
        drawn = [moving[k] for k in rng.choice(len(moving), n_strokes, replace=False)]
        out.append(_made(kind, [planner.synthesize_word(sign, signer) for sign in drawn], signer, rng))
    return out


def _made(kind: str, words: Sequence[IsolatedWord], signer: Signer, rng: np.random.Generator) -> MadeWord:
    rest = resting(signer, kind, int(rng.integers(1000)))
    stroke = _stroke(words[0])
    if kind == "zigzag":
        parts = [_zigzag(stroke[0], rest, rng)]
    elif kind == "hands":
        parts = [_with_weak_at(stroke, rest), _swapped(_with_weak_at(_stroke(words[1]), rest))]
    elif kind == "shapes":
        parts = [stroke, _other_shape(stroke[-1], rng)]
    elif kind == "parts":
        later = map(_stroke, words[1:])
        parts = [stroke, *(_with_weak_at(one, rest) if rng.random() < 0.6 else one for one in later)]
    else:
        parts = [stroke]
    frames = [np.repeat(rest[None], int(rng.integers(6, 16)), axis=0)]
    for k, part in enumerate(parts):
        frames.append(_reach(frames[-1][-1], part[0], signer, 1.1 if k == 0 else 0.9))
        frames.append(part)
        if k == 0:
            first = sum(map(len, frames[:-1]))
    last = sum(map(len, frames)) - 1
    fast = kind == "fast exit" or rng.random() < 0.25
    if not fast and rng.random() < 0.5:
        frames.append(np.repeat(frames[-1][-1:], int(rng.integers(3, 9)), axis=0))
    down = _reach(frames[-1][-1], rest, signer, 1.2)
    frames += [_fall(frames[-1], rest) if fast else down, np.repeat(rest[None], int(rng.integers(6, 16)), axis=0)]
    states = np.concatenate(frames)
    return MadeWord(
        kind,
        pose.clip(_alive(states, rng), signer, FPS, "-".join([kind, *(one.sign.gloss for one in words)])),
        first,
        last,
    )


def _stroke(word: IsolatedWord) -> FloatArray:
    """The states of a word from its first movement to the end of its last."""
    events = word.events
    assert events.first is not None
    return word.states[events.first[0] : events.passes[-1][1] + 1]


def _with_weak_at(part: FloatArray, rest: FloatArray) -> FloatArray:
    """A part whose weak hand rests."""
    part = np.array(part)
    part[:, 27:54] = rest[27:54]
    return part


def _swapped(part: FloatArray) -> FloatArray:
    """A part signed by the other hand."""
    part = np.array(part)
    part[:, :54] = np.concatenate([part[:, 27:54], part[:, :27]], axis=1)
    return part


def _other_shape(last: FloatArray, rng: np.random.Generator) -> FloatArray:
    """The strong hand takes another shape in 0.2 s, after its own was held for 0.13 s."""
    drawn = rng.choice(len(HANDSHAPES), 3, replace=False)
    to = np.array(last)
    shapes = [shape.angles for shape in HANDSHAPES.values()]
    to[6:27] = max((shapes[k] for k in drawn), key=lambda angles: np.abs(angles - last[6:27]).sum())
    alpha = minimum_jerk(np.linspace(0.0, 1.0, 7))[:, None]
    return np.concatenate([np.repeat(last[None], 4, axis=0), last + alpha * (to - last)])


def _zigzag(state: FloatArray, rest: FloatArray, rng: np.random.Generator) -> FloatArray:
    """The strong hand goes down to and fro before the belly in three to five legs, on a cubic spline."""
    n_legs = int(rng.integers(3, 6))
    knots = np.repeat(state[None], n_legs + 1, axis=0)
    knots[:, 27:54] = rest[27:54]
    side = np.where(np.arange(n_legs + 1) % 2, 1.0, -1.0) * rng.uniform(4.0, 8.0)
    top, step = rng.uniform(-14.0, -4.0), rng.uniform(2.0, 4.0)
    knots[:, :3] = np.column_stack([-6.0 + side, top - step * np.arange(n_legs + 1), np.full(n_legs + 1, 26.0)])
    n = int(rng.integers(5, 9))
    spline = CubicSpline(np.arange(n_legs + 1) * n, knots, bc_type="clamped")
    return np.asarray(spline(np.arange(n_legs * n + 1)))


def _reach(start: FloatArray, end: FloatArray, signer: Signer, pace: float) -> FloatArray:
    """States strictly between two, by minimum jerk."""
    travel = np.linalg.norm(pose.hands(end)[:, pose.WRIST] - pose.hands(start)[:, pose.WRIST], axis=-1).max()
    n = max(3, round(pace * travel_seconds(float(travel), signer) * FPS))
    alpha = minimum_jerk(np.arange(1, n) / n)[:, None]
    return np.asarray(start + alpha * (end - start))


def _fall(before: FloatArray, rest: FloatArray) -> FloatArray:
    """States from the last of ``before``, with its velocity, to rest, so that a wrist reaches 2.5 m/s or more."""
    start, velocity = before[-1], before[-1] - before[-2]
    travel = np.linalg.norm(pose.hands(rest - start)[:, pose.WRIST], axis=-1).max()
    n = max(4, round(1.6 * travel / 250.0 * FPS))
    spline = CubicSpline([0.0, n], np.stack([start, rest]), bc_type=((1, velocity), (1, np.zeros_like(rest))))
    return np.asarray(spline(np.arange(1, n)))


def _alive(states: FloatArray, rng: np.random.Generator) -> FloatArray:
    """States with hands that drift by some millimetres, as hands do that are captured."""
    t = np.arange(len(states))[:, None] / FPS
    out = np.array(states)
    for first in (0, 27):
        waves = [rng.normal(0.0, 0.12, 3) * np.sin(2 * np.pi * (f * t + rng.random(3))) for f in (0.4, 1.1, 2.3)]
        out[:, first : first + 3] += sum(waves)
    return out
