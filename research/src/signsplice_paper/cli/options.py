"""Options that several commands share, each written once, and the values of a call."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from signsplice.errors import InputError

if TYPE_CHECKING:
    from signsplice_paper.plan import Choice

Command = TypeVar("Command", bound=Callable[..., Any])

option = partial(click.option, show_default=True)
_repeatable = partial(option, multiple=True)
_folder = partial(option, metavar="DIR", type=click.Path(path_type=Path))

SCALES = click.Choice(("smoke", "small", "cpu", "paper"))
SPLITS = click.Choice(("random", "unseen-words", "unseen-signer", "unseen-both"))
OPTIMISERS = click.Choice(("adamw", "sgd"))

SCALE = option("--scale", type=SCALES, default="cpu", help="How large the systems are and how long they are trained.")
PAIRS = _folder("--pairs", default="out/pairs", help="Corpus of pairs.")
BUNDLES = _folder("--bundles", default="out/bundles", help="Folder of trained systems.")
OUT = _folder("--out", default="research/docs", help="Folder of results.json, tables and figures.")
SYSTEM = _repeatable("--system", "systems", metavar="NAME", help="Only these systems.")
CHOICE = (
    SYSTEM,
    _repeatable("--optimiser", "optimisers", type=OPTIMISERS, help="Only these."),
    _repeatable("--split", "splits", type=SPLITS, help="Only these."),
    _repeatable("--seed", "seeds", type=int, metavar="N", help="Only these."),
)
TRAINING = (
    option("--minutes", type=float, metavar="M", help="Stop training after M minutes; the same call continues."),
    option("--steps", type=int, metavar="N", help="Training steps, in place of the scale's."),
    option("--workers", type=int, default=1, metavar="N", help="Systems trained at once; they share the cores."),
)
LIMIT = option("--limit", type=int, metavar="N", help="Judge at most N pairs of a split.  [default: all]")
AGAIN = option("--again", is_flag=True, help="Judge again what is judged already.")


def add_options(*options: Callable[[Command], Command]) -> Callable[[Command], Command]:
    """Returns a decorator that adds options to a command in this order."""

    def decorate(command: Command) -> Command:
        for decorator in reversed(options):
            command = decorator(command)
        return command

    return decorate


@dataclass(frozen=True)
class PaperCall:
    """The values of a command's options. Raises ``InputError`` for an unknown system or a number that is too small.

    - scale: smoke, small, cpu or paper
    - pairs, bundles, out: folders of the corpus, of the trained systems and of the results
    - systems, optimisers, splits, seeds: what to train or judge, empty for all
    - minutes: time limit of trainings, None for no limit
    - steps: training steps of every part, None for those of the scale
    - workers: number of trainings that run at once
    - limit: largest number of pairs of a split that are judged, None for all
    - again: whether to repeat judgements that exist
    """

    scale: str = "cpu"
    pairs: Path = Path()
    bundles: Path = Path()
    out: Path = Path()
    systems: tuple[str, ...] = ()
    optimisers: tuple[str, ...] = ()
    splits: tuple[str, ...] = ()
    seeds: tuple[int, ...] = ()
    minutes: float | None = None
    steps: int | None = None
    workers: int = 1
    limit: int | None = None
    again: bool = False
    deadline: float | None = field(init=False)

    def __post_init__(self) -> None:
        from signsplice_paper import published

        unknown = [system for system in self.systems if system not in published.NAMES]
        if unknown:
            raise InputError(f"no system {unknown[0]!r}, expected one of {', '.join(published.NAMES)}")
        for name in ("limit", "steps", "workers"):
            value = getattr(self, name)
            if value is not None and value < 1:
                raise InputError(f"--{name} {value}, expected at least 1")
        object.__setattr__(self, "deadline", compute_deadline(self.minutes))

    @property
    def choice(self) -> Choice:
        """The systems, optimisers, splits and seeds to train or judge."""
        from signsplice_paper.plan import Choice

        return Choice(self.systems, self.optimisers, self.splits, self.seeds)

    @property
    def time_is_up(self) -> bool:
        """Whether the time limit of trainings has passed."""
        return self.deadline is not None and time.monotonic() >= self.deadline

    def make_folder(self) -> Path:
        """Returns the folder of the results, made if missing. Raises ``InputError`` if it cannot be made."""
        try:
            self.out.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"{self.out}: cannot be made ({error.strerror})") from error
        return self.out


def compute_deadline(minutes: float | None) -> float | None:
    """Returns the value of ``time.monotonic`` after this number of minutes, None for None. Raises ``InputError`` for a
    negative number.
    """
    if minutes is None:
        return None
    if not minutes >= 0.0:
        raise InputError(f"--minutes {minutes:g}, expected at least 0")
    return time.monotonic() + 60.0 * minutes
