"""What does the work of a call: parts by name, the networks that ship where none is named, and the classical methods
where the networks cannot be read.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

from signsplice.errors import InputError
from signsplice.splicing import networks
from signsplice.splicing.bundle import digest
from signsplice.splicing.cut import CUTTERS, DEFAULT_CUTTER, Cutter
from signsplice.splicing.duration import DEFAULT_DURATION, DURATIONS, Duration
from signsplice.splicing.method import Method, find
from signsplice.splicing.networks import NAME, LearnedCutter, LearnedDuration, LearnedTransition, Reader
from signsplice.splicing.transition import DEFAULT_TRANSITION, TRANSITIONS, Transition

WEIGHTS = Path(__file__).parent / "weights"
"""The bundle that ships."""
AUTO = "auto"
"""The name that stands for the default duration."""
_OPEN_AT_ONCE = 4
Part = TypeVar("Part", bound=Method)


@dataclass(frozen=True, eq=False)
class Learned:
    """A bundle's parts, each None where it holds no such network; its sha256; ``networks``: what it tells of each."""

    cutter: LearnedCutter | None
    transition: LearnedTransition | None
    duration: LearnedDuration | None
    sha256: str
    networks: Mapping[str, Any] = field(default_factory=dict)


_NOTHING_LEARNED = Learned(None, None, None, "")


@dataclass(frozen=True, eq=False)
class Methods:
    """What does the work of a call.

    bundle: sha256 of the networks' bundle, None where no network works. warnings: why the defaults are not the learned
    ones.
    """

    cutter: Cutter
    transition: Transition
    duration: Duration
    bundle: str | None = None
    warnings: tuple[str, ...] = ()


def open_learned(folder: str | Path = WEIGHTS) -> Learned:
    """A bundle's parts; opened once, as long as it is not written anew.

    Raises ``InputError`` where the folder holds no bundle, another system's, or one whose files are not those that it
    lists.
    """
    folder = Path(folder).resolve()
    return _opened(folder, digest(folder))


@lru_cache(maxsize=_OPEN_AT_ONCE)
def _opened(folder: Path, sha256: str) -> Learned:
    graphs = networks.open_graphs(folder)
    graphs.check()
    has = graphs.facts["files"].keys()
    reader = Reader(graphs) if "word.onnx" in has else None
    return Learned(
        LearnedCutter(reader) if reader else None,
        LearnedTransition(graphs) if "bridge.onnx" in has else None,
        LearnedDuration(reader) if reader else None,
        sha256,
        graphs.facts.get("networks", {}),
    )


def choose(
    cutter: str | Cutter | None = None,
    transition: str | Transition | None = None,
    duration: str | Duration | None = None,
    bundle: str | Path | None = None,
) -> Methods:
    """The parts of a call: objects as they are, others by name, ``learned`` and None from ``bundle``, which by default
    is the one that ships.

    What is None is classical, with one warning, where the bundle that ships cannot be read. Raises ``InputError`` for
    an unknown name, for ``learned`` where there is no such network, and for a bundle that is named and cannot be read.
    """
    named = (cutter, transition, None if duration == AUTO else duration)
    where = Path(WEIGHTS if bundle is None else bundle)
    own, warnings = _NOTHING_LEARNED, tuple[str, ...]()
    if bundle is not None or None in named or NAME in named:
        try:
            own = open_learned(where)
        except InputError as error:
            if bundle is not None or NAME in named:
                raise
            warnings = (f"no learned methods, classical ones serve: {error}",)
    chosen = (
        _part("cutter", named[0], own.cutter, CUTTERS, DEFAULT_CUTTER, where),
        _part("transition", named[1], own.transition, TRANSITIONS, DEFAULT_TRANSITION, where),
        _part("duration", named[2], own.duration, DURATIONS, DEFAULT_DURATION, where),
    )
    works = any(one is part for one, part in zip(chosen, (own.cutter, own.transition, own.duration), strict=True))
    return Methods(*chosen, own.sha256 if works else None, warnings)


def _part(
    kind: str, named: str | Part | None, own: Part | None, table: Mapping[str, Part], classical: str, where: Path
) -> Part:
    if named is None:
        return table[classical] if own is None else own
    if not isinstance(named, str):
        return named
    if own is not None:
        return find(kind, named, {**table, NAME: own})
    if named == NAME:
        raise InputError(f"{where}: holds no network for the {kind}; name another bundle, or a classical {kind}")
    return find(kind, named, table)


def every() -> list[tuple[str, Method, bool]]:
    """Every part as (kind, part, whether it is the default), learned ones of the bundle that ships among them."""
    now = choose()
    tables: tuple[tuple[str, dict[str, Method], Method], ...] = (
        ("cutter", dict(CUTTERS), now.cutter),
        ("transition", dict(TRANSITIONS), now.transition),
        ("duration", dict(DURATIONS), now.duration),
    )
    return [
        (kind, part, part is default)
        for kind, table, default in tables
        for part in dict.fromkeys((*table.values(), default))
    ]
