"""The methods of a call: by name, learned where none is named, classical where no network can be read."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

from signsplice.errors import InputError
from signsplice.motion.cache import CACHE
from signsplice.splicing.methods import Method, find, learned
from signsplice.splicing.methods.cut import CLASSICAL_CUTTER, CUTTERS, Cutter
from signsplice.splicing.methods.duration import CLASSICAL_DURATION, DURATIONS, Duration
from signsplice.splicing.methods.learned import FLUENT, NAME, LearnedCutter, LearnedDuration, LearnedTransition
from signsplice.splicing.methods.transition import CLASSICAL_TRANSITION, TRANSITIONS, Transition
from signsplice.splicing.networks.bundle import BUNDLE_FILE, NetworkConfig, bundle_sha256
from signsplice.splicing.networks.word_reader import WordReader

WEIGHTS = Path(__file__).parents[1] / "weights"
"""The bundle that ships."""
AUTO = "auto"
"""The name of the default duration."""
_OPEN_AT_ONCE = 4
MethodT = TypeVar("MethodT", bound=Method)


@dataclass(frozen=True, eq=False)
class LearnedMethods:
    """What a bundle offers.

    cutters, transitions, durations: by name.
    sha256: of the bundle; None where there is none.
    networks: what bundle.json says of each network.
    """

    cutters: Mapping[str, LearnedCutter] = field(default_factory=dict)
    transitions: Mapping[str, LearnedTransition] = field(default_factory=dict)
    durations: Mapping[str, LearnedDuration] = field(default_factory=dict)
    sha256: str | None = None
    networks: Mapping[str, NetworkConfig] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class ChosenMethods:
    """The methods of a call.

    cutter, transition, duration: what does the work.
    bundle: sha256 of the bundle whose networks take part; None without networks.
    warnings: why the defaults are not the learned ones.
    """

    cutter: Cutter
    transition: Transition
    duration: Duration
    bundle: str | None = None
    warnings: tuple[str, ...] = ()


def open_learned(folder: str | Path | None = None) -> LearnedMethods:
    """What a bundle offers, by default the one that ships; opened once, as long as it is not written anew.

    Raises ``InputError`` where the folder holds no bundle, another system's, or one whose files are not those that it
    lists.
    """
    folder = Path(WEIGHTS if folder is None else folder).absolute()
    try:
        status = (folder / BUNDLE_FILE).stat()
    except OSError:
        return _open(folder, bundle_sha256(folder))  # raises, and says what is wrong
    written = status.st_ino, status.st_mtime_ns, status.st_size
    return CACHE.recent(_open_as_written, folder, written, most=_OPEN_AT_ONCE)


def _open_as_written(folder: Path, written: tuple[int, int, int]) -> LearnedMethods:
    """``_open`` for a bundle.json of this inode, time and size: another one is another call."""
    folder = folder.resolve()  # a link may lead elsewhere before the last network is opened
    return CACHE.recent(_open, folder, bundle_sha256(folder), most=_OPEN_AT_ONCE)


def _open(folder: Path, sha256: str) -> LearnedMethods:
    sessions = learned.open_sessions(folder)
    sessions.check()
    reader = WordReader(sessions)
    reads_words = "word.onnx" in sessions.config.files
    cutters = [LearnedCutter(reader), LearnedCutter(reader, whole=False)] if reads_words else []
    return LearnedMethods(
        {cutter.name: cutter for cutter in cutters},
        {NAME: LearnedTransition(sessions)} if "bridge.onnx" in sessions.config.files else {},
        {NAME: LearnedDuration(reader)} if reads_words else {},
        sha256,
        sessions.config.networks,
    )


def choose(
    cutter: str | Cutter | None = None,
    transition: str | Transition | None = None,
    duration: str | Duration | None = None,
    bundle: str | Path | None = None,
) -> ChosenMethods:
    """The methods of a call: objects as they are, others by name; ``learned`` and None from ``bundle``, by default the
    one that ships.

    None is the classical default, with one warning, where the bundle that ships cannot be read. Raises ``InputError``
    for an unknown name, for ``learned`` where there is no such network, and for a bundle that is named and cannot be
    read.
    """
    named = (cutter, transition, None if duration == AUTO else duration)
    where = Path(WEIGHTS if bundle is None else bundle)
    own, warnings = LearnedMethods(), tuple[str, ...]()
    called_for = any(name in (NAME, FLUENT) for name in named if isinstance(name, str))
    tables: tuple[Mapping[str, Method], ...] = (CUTTERS, TRANSITIONS, DURATIONS)
    unknown = any(isinstance(name, str) and name not in table for name, table in zip(named, tables, strict=True))
    if bundle is not None or None in named or unknown:  # the message about an unknown name lists the learned ones too
        try:
            own = open_learned(where)
        except InputError as error:
            if bundle is not None or called_for:
                raise
            warnings = (f"no learned methods, classical ones are used: {error}",)
    chosen = (
        _one("cutter", named[0], own.cutters, CUTTERS, CLASSICAL_CUTTER, where),
        _one("transition", named[1], own.transitions, TRANSITIONS, CLASSICAL_TRANSITION, where),
        _one("duration", named[2], own.durations, DURATIONS, CLASSICAL_DURATION, where),
    )
    networks = [*own.cutters.values(), *own.transitions.values(), *own.durations.values()]
    return ChosenMethods(*chosen, own.sha256 if any(method in networks for method in chosen) else None, warnings)


def _one(
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
    """Every method as (kind, method, whether it is the default), those of the bundle that ships among them."""
    defaults = choose()
    own = open_learned() if defaults.bundle is not None else LearnedMethods()
    tables: tuple[tuple[str, dict[str, Method], Method], ...] = (
        ("cutter", {**CUTTERS, **own.cutters}, defaults.cutter),
        ("transition", {**TRANSITIONS, **own.transitions}, defaults.transition),
        ("duration", {**DURATIONS, **own.durations}, defaults.duration),
    )
    return [(kind, method, method is default) for kind, table, default in tables for method in table.values()]
