"""How far each frame of a transition lies from the true one, counted from its start: the paper's figure 6 in numbers.

The paper says of its pictures that the first two frames of all systems agree with the truth, and that LSTM and
Transformer are distorted from there on.
"""

from __future__ import annotations

from typing import Any

from signsplice_paper.extra_metrics import FIRST, FRAMES
from signsplice_paper.kept_frames import HERMITE
from signsplice_paper.layout import Table, number
from signsplice_paper.lines import OPTIMISERS, TableLine, clip_lines, line
from signsplice_paper.results import Results
from signsplice_paper.style import COMPARED, plot_options

PAGE = "frame-errors"
SPLIT = "random"
_COUNTED = range(1, FRAMES + 1)


def table(results: Results, scale: str, split: str = SPLIT) -> list[Table]:
    """The errors of the compared systems and of Hermite at the true positions, a table if any was measured."""
    found = [one for optimiser in OPTIMISERS for one in _measured(results, scale, split, optimiser).values()]
    found += [one for one in clip_lines(results, split, (HERMITE,)) if one.values("first_frames_error")]
    cells = [
        (
            one.name,
            one.origin,
            number(one.score("first_frames_error"), 1),
            *(number(one.score(f"frame_error-{n}"), 1) for n in _COUNTED),
        )
        for one in found
    ]
    if not cells:
        return []
    caption = f"Error of each frame, cm: mean distance of elbows, wrists and finger joints, scale {scale}, {split}"
    head = ("system", "from", f"frames 1 to {FIRST}", *(f"frame {n}" for n in _COUNTED))
    return [Table(caption, f"frame-errors-{scale}-{split}", head, tuple(cells), split=split)]


def _measured(results: Results, scale: str, split: str, optimiser: str) -> dict[str, TableLine]:
    """The lines of the compared systems that are trained and have these errors, of several seeds their means."""
    found = {system: line(results, system, scale, split, optimiser) for system in COMPARED}
    return {s: one for s, one in found.items() if one.is_known and one.values("first_frames_error")}


def plot(results: Results, scale: str, optimiser: str, pyplot: Any) -> Any:
    """The errors of the compared systems by frame; None if fewer than two were measured."""
    found = _measured(results, scale, SPLIT, optimiser)
    if len(found) < 2:
        return None
    figure, ax = pyplot.subplots(figsize=(5.2, 3.6), constrained_layout=True)
    for system, one in found.items():
        errors = [one.score(f"frame_error-{n}") for n in _COUNTED]
        ax.plot(_COUNTED, errors, **plot_options(system), ms=5, lw=1.6, label=one.name)
    ax.set(xlabel="frame of the transition", ylabel="mean distance of arm and finger joints, cm", ylim=(0.0, None))
    ax.set_title(f"Error by frame ({OPTIMISERS[optimiser]}, scale {scale})", fontsize=10)
    ax.grid(alpha=0.25)
    ax.legend(fontsize=8)
    return figure
