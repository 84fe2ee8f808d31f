"""The learned cutter, duration and transition behind the classical ones' protocols: a bundle's graphs, on any rig.

Two words are seen on the canonical humanoid at 30 frames a second (``motion.features``); what the networks say goes
back to the clips' own joints and rate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from signsplice.errors import InputError
from signsplice.motion import features
from signsplice.motion.canonical import signing, turned
from signsplice.motion.clip import Clip, concatenate
from signsplice.motion.features import CONTEXT, LEAST, MOST, RATE, Course
from signsplice.splicing.bundle import read_facts
from signsplice.splicing.cut import Cut
from signsplice.splicing.graphs import Graphs
from signsplice.splicing.joint import Choices, best
from signsplice.splicing.transition import find_transition

Float = NDArray[np.float64]

SYSTEM = "signsplice"
NAME = "learned"
_COURSES: WeakKeyDictionary[Clip, Course] = WeakKeyDictionary()


def open_graphs(folder: str | Path) -> Graphs:
    """The graphs of a bundle; each is read and checked when first run.

    Raises ``InputError`` where the folder holds no bundle, another system's, or one that was made for other features.
    """
    folder = Path(folder)
    facts = read_facts(folder)
    if facts.get("system") != SYSTEM:
        raise InputError(f"{folder}: is a bundle of {facts.get('system')!r}, expected one of {SYSTEM!r}")
    if facts.get("features") != features.VERSION:
        raise InputError(
            f"{folder}: was made for features {facts.get('features')}, and these are {features.VERSION}; train it anew"
        )
    return Graphs(folder, facts)


def seen(clip: Clip) -> Course:
    """A word as networks see it, remembered as long as the clip lives: it stands on both sides of two seams."""
    found = _COURSES.get(clip)
    if found is None:
        found = _COURSES[clip] = features.course(signing(clip))
    return found


class LearnedCutter:
    """Chooses both frames together, by a network over the two words, and all seams of a sentence together."""

    name, learned = NAME, True
    summary = "a network over both words, on the canonical humanoid; weighs both frames together"

    def __init__(self, graphs: Graphs) -> None:
        self.graphs = graphs

    def choices(self, before: Clip, after: Clip) -> Choices:
        """Scores of leaving the one at a frame and entering the other at another, both at 30 a second."""
        window = features.cut_window(seen(before), seen(after))
        made = self.graphs.run("cut", {"tokens": window.tokens[None]})["scores"][0]
        return Choices(np.asarray(made[: window.n_before, window.n_before :], np.float64), window.first)

    def cut(self, before: Clip, after: Clip) -> Cut:
        """The splice position of two harmonized clips."""
        return self.cuts([before, after])[0]

    def cuts(self, clips: Sequence[Clip]) -> list[Cut]:
        """The splice positions of a sentence, chosen together (``joint``)."""
        pairs = list(pairwise(clips))
        chosen = best([self.choices(before, after) for before, after in pairs])
        return [Cut(_frame(pre, p), _frame(post, q)) for (pre, post), (p, q) in zip(chosen, pairs, strict=True)]


def _frame(at: int, clip: Clip) -> int:
    """The clip's own frame nearest to one at 30 a second."""
    return min(round(at / RATE * clip.fps), len(clip) - 1)


class LearnedDuration:
    """How long a transition takes, by a network over the two frames that it joins."""

    name, learned = NAME, True
    summary = "a network over the two frames that are joined"

    def __init__(self, graphs: Graphs) -> None:
        self.graphs = graphs

    def seconds(self, before: Clip, after: Clip, cut: Cut) -> float:
        """Seconds between the last frame kept of the one and the first frame kept of the other."""
        window = features.cut_window(seen(before), seen(after))
        pre = round(cut.pre / before.fps * RATE) - window.first
        post = round(cut.post / after.fps * RATE)
        rows = np.clip(pre, 0, window.n_before - 1), np.clip(window.n_before + post, 0, len(window.tokens) - 1)
        leaving, entering = (window.tokens[None, int(row), : features.N_FRAME] for row in rows)
        return float(self.graphs.run("duration", {"leaving": leaving, "entering": entering})["seconds"][0])


class LearnedTransition:
    """The limited Hermite curve, bent by a network over the gap and eight frames on either side.

    End poses and end velocities stay those of the curve; joints without a role, and gaps of fewer than 2 or more than
    45 frames at 30 a second, follow the curve alone.
    """

    name, learned = NAME, True
    summary = "limited Hermite curve, bent by a network that sees eight frames on either side"

    def __init__(self, graphs: Graphs) -> None:
        self.graphs = graphs
        self.base = find_transition("hermite")

    def between(self, before: Clip, after: Clip, n_frames: int) -> Clip:
        """``n_frames`` >= 1 new frames that lead from the last frame of ``before`` to the first of ``after``."""
        base = self.base.between(before, after, n_frames)
        if not LEAST <= features.gap_frames((n_frames + 1) / before.fps) <= MOST:
            return base
        n_context = int(np.ceil((CONTEXT + 1) / RATE * before.fps)) + 1
        kept, follows = before[-n_context:], after[:n_context]
        window = features.seam_window(concatenate([kept, base, follows]), len(kept), n_frames)
        answer = self.graphs.run("bridge", {"tokens": window.tokens[None]})["turns"][0]
        turns = features.deltas(answer, window, n_frames)
        return replace(base, local_rotations=turned(base.skeleton, base.local_rotations, turns))
