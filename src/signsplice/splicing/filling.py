"""Gaps filled: what a transition is shown of both signs, its frames counted, hands led around the body."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from signsplice.errors import InputError
from signsplice.motion.clip import Clip
from signsplice.splicing.collision_avoidance import avoid_all_collisions
from signsplice.splicing.transition import Gap, Transition, fills_together, has_limits

CONTEXT = 8
"""Frames of each sign that a seam's scores see, and the least that a transition is shown."""
_SHOWN_S = 7.0 / 30.0
"""Time of each sign that a transition is shown: eight frames at 30 a second, at other rates as much time."""


def n_shown_frames(fps: float) -> int:
    """Frames of each sign that a transition is shown."""
    return max(CONTEXT, math.ceil(_SHOWN_S * fps - 1e-6) + 1)


@dataclass(frozen=True, eq=False)
class FilledGap:
    """New frames of a gap; ``depth``: how deep a hand is in the body in them, m, None where nobody looked."""

    clip: Clip
    depth: float | None = None
    warnings: tuple[str, ...] = ()


def fill(transition: Transition, gaps: Sequence[Gap], body_sense: bool | None) -> list[FilledGap]:
    """The frames that a transition makes for every gap.

    Raises ``InputError`` where they are not as many as were asked for.
    """
    made = transition.between_all(gaps) if fills_together(transition) else [transition.between(*gap) for gap in gaps]
    for filled, (_, _, n_frames) in zip(made, gaps, strict=True):
        if len(filled) != n_frames:
            raise InputError(f"transition {transition.name} made {len(filled)} frames, expected {n_frames}")
    said = [transition.limits(gap) if has_limits(transition) else () for gap in gaps]
    if not (transition.learned if body_sense is None else body_sense):
        return [FilledGap(filled, None, lines) for filled, lines in zip(made, said, strict=True)]
    led = avoid_all_collisions([(filled, before, after) for filled, (before, after, _) in zip(made, gaps, strict=True)])
    return [FilledGap(one.clip, one.depth, lines) for one, lines in zip(led, said, strict=True)]
