"""Gaps filled by a transition: its frames counted, and hands led around the body."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from signsplice.errors import InputError
from signsplice.motion.clip import Clip
from signsplice.splicing.collision_avoidance import avoid_collisions
from signsplice.splicing.gap import Gap
from signsplice.splicing.transition import Transition


@dataclass(frozen=True, eq=False)
class FilledGap:
    """The new frames of a gap.

    clip: the new frames.
    depth: how deep a hand is in the body in them, m; None where that was not measured.
    warnings: what a user should know, one line each.
    """

    clip: Clip
    depth: float | None = None
    warnings: tuple[str, ...] = ()


def fill(transition: Transition, gaps: Sequence[Gap], avoids: bool | None) -> list[FilledGap]:
    """The frames that a transition makes for every gap, with hands led around the body where ``avoids`` is true;
    None: where the transition is learned.

    Raises ``InputError`` where a transition does not make as many frames as a gap asks for.
    """
    made = transition.fill(gaps)
    for new, gap in zip(made, gaps, strict=True):
        if len(new) != gap.n_frames:
            raise InputError(f"transition {transition.name} made {len(new)} frames, expected {gap.n_frames}")
    warnings = [transition.warnings(gap) for gap in gaps]
    if not (transition.learned if avoids is None else avoids):
        return [FilledGap(new, None, lines) for new, lines in zip(made, warnings, strict=True)]
    return [led_around(FilledGap(new, None, lines), gap) for new, lines, gap in zip(made, warnings, gaps, strict=True)]


def led_around(filled: FilledGap, gap: Gap) -> FilledGap:
    """The new frames of a gap with hands led around the body, and how deep a hand still is in it."""
    cleared = avoid_collisions(filled.clip, gap.before, gap.after)
    return replace(filled, clip=cleared.clip, depth=cleared.depth)
