"""Gaps filled by a transition: its frames counted, and hands led around the body."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from signsplice.errors import InputError
from signsplice.motion.clip import Clip
from signsplice.splicing.gap import Gap
from signsplice.splicing.methods.transition import Transition
from signsplice.splicing.passes.collision_avoidance import avoid_all_collisions


@dataclass(frozen=True, eq=False)
class FilledGap:
    """The new frames of a gap.

    clip: the new frames.
    depth: how deep a hand is in the body in them, m; None where that was not measured.
    warnings: what a user should know, one line each.
    peak_m_s: highest speed of a wrist in and beside them, m/s; None where that was not measured.
    """

    clip: Clip
    depth: float | None = None
    warnings: tuple[str, ...] = ()
    peak_m_s: float | None = None


def fill(transition: Transition, gaps: Sequence[Gap], avoids: bool | None) -> list[FilledGap]:
    """The frames that a transition makes for every gap, with hands led around the body where ``avoids`` is true;
    None: where the transition is learned.

    Raises ``InputError`` where a transition does not make as many frames as a gap asks for.
    """
    made = transition.fill(gaps)
    for new, gap in zip(made, gaps, strict=True):
        if len(new) != gap.n_frames:
            raise InputError(f"transition {transition.name} made {len(new)} frames, expected {gap.n_frames}")
    filled = [FilledGap(new, None, transition.warnings(gap)) for new, gap in zip(made, gaps, strict=True)]
    return all_led_around(filled, gaps) if (transition.learned if avoids is None else avoids) else filled


def led_around(filled: FilledGap, gap: Gap) -> FilledGap:
    """The new frames of a gap with hands led around the body, and how deep a hand still is in it."""
    return all_led_around([filled], [gap])[0]


def all_led_around(filled: Sequence[FilledGap], gaps: Sequence[Gap]) -> list[FilledGap]:
    """``led_around`` of several gaps."""
    cleared = avoid_all_collisions([(one.clip, gap.before, gap.after) for one, gap in zip(filled, gaps, strict=True)])
    return [
        replace(one, clip=new.clip, depth=new.depth, peak_m_s=None) for one, new in zip(filled, cleared, strict=True)
    ]
