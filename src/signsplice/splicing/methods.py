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
from signsplice.splicing import learned
from signsplice.splicing.bundle import BUNDLE_FILE, bundle_sha256
from signsplice.splicing.cut import CUTTERS, DEFAULT_CUTTER, Cutter
from signsplice.splicing.duration import DEFAULT_DURATION, DURATIONS, Duration
from signsplice.splicing.learned import FLUENT, NAME, LearnedCutter, LearnedDuration, LearnedTransition, WordReader
from signsplice.splicing.method import Method, find
from signsplice.splicing.transition import DEFAULT_TRANSITION, TRANSITIONS, Transition

WEIGHTS = Path(__file__).parent / "weights"
"""The bundle that ships."""
AUTO = "auto"
"""The name that stands for the default duration."""
_OPEN_AT_ONCE = 4
MethodT = TypeVar("MethodT", bound=Method)


@dataclass(frozen=True, eq=False)
class LearnedMethods:
    """A bundle's parts by name; its sha256; ``networks``: what it tells of each."""

    cutters: Mapping[str, LearnedCutter] = field(default_factory=dict)
    transitions: Mapping[str, LearnedTransition] = field(default_factory=dict)
    durations: Mapping[str, LearnedDuration] = field(default_factory=dict)
    sha256: str | None = None
    networks: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class ChosenMethods:
    """What does the work of a call.

    bundle: sha256 of the networks' bundle, None where no network works. warnings: why the defaults are not the learned
    ones.
    """

    cutter: Cutter
    transition: Transition
    duration: Duration
    bundle: str | None = None
    warnings: tuple[str, ...] = ()


def open_learned(folder: str | Path | None = None) -> LearnedMethods:
    """A bundle's parts, by default that which ships; opened once, as long as it is not written anew.

    Raises ``InputError`` where the folder holds no bundle, another system's, or one whose files are not those that it
    lists.
    """
    folder = Path(WEIGHTS if folder is None else folder).absolute()
    try:
        told = (folder / BUNDLE_FILE).stat()
    except OSError:
        return _read(folder, bundle_sha256(folder))  # which says what is wrong
    return _opened(folder, (told.st_ino, told.st_mtime_ns, told.st_size))


@lru_cache(maxsize=_OPEN_AT_ONCE)
def _opened(folder: Path, as_written: tuple[int, int, int]) -> LearnedMethods:
    folder = folder.resolve()  # a link may lead elsewhere before the last graph is opened
    return _read(folder, bundle_sha256(folder))


@lru_cache(maxsize=_OPEN_AT_ONCE)
def _read(folder: Path, sha256: str) -> LearnedMethods:
    graphs = learned.open_sessions(folder)
    graphs.check()
    has = graphs.facts["files"].keys()
    reader = WordReader(graphs)
    cutters = [LearnedCutter(reader), LearnedCutter(reader, whole=False)] if "word.onnx" in has else []
    return LearnedMethods(
        {cutter.name: cutter for cutter in cutters},
        {NAME: LearnedTransition(graphs)} if "bridge.onnx" in has else {},
        {NAME: LearnedDuration(reader)} if "word.onnx" in has else {},
        sha256,
        graphs.facts.get("networks", {}),
    )


def choose(
    cutter: str | Cutter | None = None,
    transition: str | Transition | None = None,
    duration: str | Duration | None = None,
    bundle: str | Path | None = None,
) -> ChosenMethods:
    """The parts of a call: objects as they are, others by name, ``learned`` and None from ``bundle``, which by default
    is the one that ships.

    What is None is classical, with one warning, where the bundle that ships cannot be read. Raises ``InputError`` for
    an unknown name, for ``learned`` where there is no such network, and for a bundle that is named and cannot be read.
    """
    named = (cutter, transition, None if duration == AUTO else duration)
    where = Path(WEIGHTS if bundle is None else bundle)
    own, warnings = LearnedMethods(), tuple[str, ...]()
    called_for = any(name in (NAME, FLUENT) for name in named)
    if bundle is not None or None in named or called_for:
        try:
            own = open_learned(where)
        except InputError as error:
            if bundle is not None or called_for:
                raise
            warnings = (f"no learned methods, classical ones serve: {error}",)
    chosen = (
        _part("cutter", named[0], own.cutters, CUTTERS, DEFAULT_CUTTER, where),
        _part("transition", named[1], own.transitions, TRANSITIONS, DEFAULT_TRANSITION, where),
        _part("duration", named[2], own.durations, DURATIONS, DEFAULT_DURATION, where),
    )
    theirs = [*own.cutters.values(), *own.transitions.values(), *own.durations.values()]
    return ChosenMethods(*chosen, own.sha256 if any(part in theirs for part in chosen) else None, warnings)


def _part(
    kind: str,
    named: str | MethodT | None,
    own: Mapping[str, MethodT],
    table: Mapping[str, MethodT],
    classical: str,
    where: Path,
) -> MethodT:
    if named is None:
        return own.get(NAME, table[classical])
    if not isinstance(named, str):
        return named
    if named in (NAME, FLUENT) and not own:
        raise InputError(f"{where}: holds no network for the {kind}; name another bundle, or a classical {kind}")
    return find(kind, named, {**table, **own})


def all_methods() -> list[tuple[str, Method, bool]]:
    """Every part as (kind, part, whether it is the default), those of the bundle that ships among them."""
    now = choose()
    own = open_learned() if now.bundle is not None else LearnedMethods()
    tables: tuple[tuple[str, dict[str, Method], Method], ...] = (
        ("cutter", {**CUTTERS, **own.cutters}, now.cutter),
        ("transition", {**TRANSITIONS, **own.transitions}, now.transition),
        ("duration", {**DURATIONS, **own.durations}, now.duration),
    )
    return [(kind, part, part is default) for kind, table, default in tables for part in table.values()]
