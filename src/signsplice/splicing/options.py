"""Options and methods of one call of the engine. Methods are chosen by name; the default is learned, or classical if no
network can be read. Errors about wrong options state the given and the expected values.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from signsplice.errors import InputError
from signsplice.formats.reading import DEFAULT_LIMITS, ReadLimits
from signsplice.motion import Clip, Skeleton
from signsplice.motion.cache import CACHE
from signsplice.splicing.bundle import BUNDLE_FILE, WEIGHTS, NetworkConfig, bundle_sha256
from signsplice.splicing.contracts import Cutter, Duration, Method, Transition, find
from signsplice.splicing.curves import CLASSICAL_TRANSITION, TRANSITIONS
from signsplice.splicing.cutters import CLASSICAL_CUTTER, CUTTERS
from signsplice.splicing.durations import (
    CITATION,
    DEFAULT_DURATION,
    DURATIONS,
    MAX_TRANSITION_S,
    TravelDuration,
    seconds_a_sign,
)
from signsplice.splicing.faces import check_rules
from signsplice.splicing.learned import (
    FLUENT,
    NAME,
    LearnedCutter,
    LearnedTransition,
    WordReader,
    open_sessions,
)
from signsplice.splicing.lptransformer import SHIPPED, open_system
from signsplice.splicing.person import FREE_HANDS, NATURAL
from signsplice.splicing.systems import WholeSystem, check_alone

if TYPE_CHECKING:
    from signsplice.splicing.mouthing import Pronunciations

AUTO = "auto"
"""The name of the default duration."""
_OPEN_AT_ONCE = 4
"""Largest number of bundles kept open."""
MethodT = TypeVar("MethodT", bound=Method)


@dataclass(frozen=True, eq=False)
class LearnedMethods:
    """The methods of a bundle.

    cutters, transitions: methods by name.
    sha256: sha256 of the bundle; None if there is none.
    networks: entry of each network in bundle.json.
    """

    cutters: Mapping[str, LearnedCutter] = field(default_factory=dict)
    transitions: Mapping[str, LearnedTransition] = field(default_factory=dict)
    sha256: str | None = None
    networks: Mapping[str, NetworkConfig] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Methods:
    """The methods of a call.

    cutter, transition, duration: the chosen methods.
    bundle: sha256 of the bundle whose networks are used; None without networks.
    warnings: the reason if the defaults are not learned.
    """

    cutter: Cutter
    transition: Transition
    duration: Duration
    bundle: str | None = None
    warnings: tuple[str, ...] = ()


def open_learned(folder: str | Path | None = None) -> LearnedMethods:
    """Opens a bundle, by default the shipped one, and returns its methods; it is opened again only if it changes.

    Raises ``InputError`` if the folder holds no bundle, another system's bundle, or files other than listed.
    """
    folder = Path(WEIGHTS if folder is None else folder).absolute()
    try:
        status = (folder / BUNDLE_FILE).stat()
    except OSError:
        return _open(folder, bundle_sha256(folder))  # raises an error that names the problem
    written = status.st_ino, status.st_mtime_ns, status.st_size
    return CACHE.recent(_open_as_written, folder, written, most=_OPEN_AT_ONCE)


def _open_as_written(folder: Path, written: tuple[int, int, int]) -> LearnedMethods:
    """``_open`` for a bundle.json with this inode, time and size; these are part of the cache key."""
    folder = folder.resolve()  # a link may lead elsewhere before the last network is opened
    return CACHE.recent(_open, folder, bundle_sha256(folder), most=_OPEN_AT_ONCE)


def _open(folder: Path, sha256: str) -> LearnedMethods:
    sessions = open_sessions(folder)
    sessions.check()
    reader = WordReader(sessions)
    reads_words = "word.onnx" in sessions.config.files
    cutters = [LearnedCutter(reader), LearnedCutter(reader, whole=False)] if reads_words else []
    return LearnedMethods(
        {cutter.name: cutter for cutter in cutters},
        {NAME: LearnedTransition(sessions)} if "bridge.onnx" in sessions.config.files else {},
        sha256,
        sessions.config.networks,
    )


def choose(
    cutter: str | Cutter | None = None,
    transition: str | Transition | None = None,
    duration: str | Duration | None = None,
    bundle: str | Path | None = None,
) -> Methods:
    """Returns the methods of a call. Objects are used as they are, others found by name; ``learned`` and None stand for
    the cutter and transition of ``bundle``, by default the shipped one.

    If the shipped bundle cannot be read, None stands for the classical default, with one warning. Raises ``InputError``
    for an unknown name, for ``learned`` without such a network, and for a named bundle that cannot be read.
    """
    named = (cutter, transition)
    where = Path(WEIGHTS if bundle is None else bundle)
    learned, warnings = LearnedMethods(), tuple[str, ...]()
    called_for = any(name in (NAME, FLUENT) for name in named if isinstance(name, str))
    tables: tuple[Mapping[str, Method], ...] = (CUTTERS, TRANSITIONS)
    unknown = any(isinstance(name, str) and name not in table for name, table in zip(named, tables, strict=True))
    if bundle is not None or None in named or unknown:  # the message about an unknown name lists the learned ones too
        try:
            learned = open_learned(where)
        except InputError as error:
            if bundle is not None or called_for:
                raise
            warnings = (f"no learned methods, classical ones are used: {error}",)
    duration = DEFAULT_DURATION if duration in (None, AUTO) else duration
    chosen = (
        _one("cutter", cutter, learned.cutters, CUTTERS, CLASSICAL_CUTTER, where),
        _one("transition", transition, learned.transitions, TRANSITIONS, CLASSICAL_TRANSITION, where),
        find("duration", duration, DURATIONS) if isinstance(duration, str) else duration,
    )
    networks = [*learned.cutters.values(), *learned.transitions.values()]
    return Methods(*chosen, learned.sha256 if any(method in networks for method in chosen) else None, warnings)


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
    """Returns every method, including those of the shipped bundle, as (kind, method, whether it is the default)."""
    defaults = choose()
    learned = open_learned() if defaults.bundle is not None else LearnedMethods()
    tables: tuple[tuple[str, Mapping[str, Method], Method | None], ...] = (
        ("cutter", {**CUTTERS, **learned.cutters}, defaults.cutter),
        ("transition", {**TRANSITIONS, **learned.transitions}, defaults.transition),
        ("duration", {**DURATIONS}, defaults.duration),
        ("system", {name: open_system(name) for name in SHIPPED}, None),
    )
    return [(kind, method, method is default) for kind, table, default in tables for method in table.values()]


_DECIDED_BY_SYSTEM = (
    "cutter", "transition", "duration", "bundle", "transition_time", "tempo", "avoid_collisions", "free_hand",
    "person", "mouthing",
)  # fmt: skip


@dataclass(frozen=True)
class SpliceOptions:
    """Options of one call.

    cutter, transition, duration: a name, or an object of that class; None: the default, which is learned for cutter and
        transition, or classical if the networks cannot be read (``choose``).
    bundle: folder of the networks; None: the shipped ones.
    transition_time: duration of every transition, seconds, instead of the duration method.
    sign_speed: playback speed of the signs; 1 is as recorded.
    tempo: "citation": as recorded; "natural": as in running signing; or the seconds that a sign takes with its
        transition. Holds and slow parts are shortened to reach it, as far as human speeds allow.
    fps: output rate; None: the first clip's, or if that is under ``stages.LOW_FPS`` the highest of all clips.
    onto: a clip or skeleton with the body that signs; None: the first clip's, or that of the clip whose body loses
        fewest joints of all clips (``SpliceResult.skeleton``).
    avoid_collisions: whether hands are led around head, trunk and each other; None: if the transition is learned.
    free_hand: what an arm does that no word owns (``person``). "natural": it stays where a sign left it, sinks late and
        slowly, and is up before it is needed; "transition": it goes to rest, and leaves it, within a transition.
    person: how much head, trunk and gaze move where no word owns them; 0: not at all, 1: nearly as people's do.
    seed: of these movements.
    face_rules: rules that animate faces of words without one, some of ``faces.RULES``.
    mouthing: a pronunciation dictionary in CMUdict's format, from which mouths of faces by rule are guessed; None: they
        are closed.
    limits: limit of the number of frames of a clip at the output rate; its ``free_bytes`` limit ``mouthing``.
    system: a system that splices whole words, instead of cutter, transition, duration and related options: a name of
        ``lptransformer.SHIPPED``, a trained system's folder, or an object of that class.
    fill_misses: whether pairs for which the system has no splice are joined by the defaults, with a warning; else they
        raise an error.

    Raises ``InputError`` for a number out of range, options that cannot be combined with a system, and ``mouthing``
    that cannot be read or comes without face rules.
    """

    cutter: str | Cutter | None = None
    transition: str | Transition | None = None
    duration: str | Duration | None = None
    bundle: str | Path | None = None
    transition_time: float | None = None
    sign_speed: float = 1.0
    tempo: str | float = CITATION
    fps: float | None = None
    avoid_collisions: bool | None = None
    free_hand: str = NATURAL
    person: float = 1.0
    seed: int = 0
    face_rules: tuple[str, ...] = ()
    mouthing: str | Path | None = None
    limits: ReadLimits = DEFAULT_LIMITS
    system: str | WholeSystem | None = None
    fill_misses: bool = True
    onto: Clip | Skeleton | None = None

    def __post_init__(self) -> None:
        limits = (
            ("transition time", self.transition_time, 0.0, MAX_TRANSITION_S, "s"),
            ("sign speed", self.sign_speed, 0.1, 10.0, ""),
            ("fps", self.fps, 1.0, 1000.0, ""),
            ("person", self.person, 0.0, 1.0, ""),
            ("seed", self.seed, 0, 2**53, ""),
        )
        for label, value, lower, upper, unit in limits:
            if value is not None and not lower <= value <= upper:
                raise InputError(f"{label} {value:g}{unit}, expected {lower:g} to {upper:g}{unit}")
        self.seconds_a_sign  # noqa: B018  # raises for another tempo
        if self.free_hand not in FREE_HANDS:
            raise InputError(f"free hand {self.free_hand!r}, expected one of {', '.join(FREE_HANDS)}")
        check_rules(self.face_rules)
        if self.whole_system is not None:
            decided = {field.name: field.default for field in fields(self) if field.name in _DECIDED_BY_SYSTEM}
            if not self.person:
                decided.pop("person")  # a system moves no person
            named = [name for name, default in decided.items() if getattr(self, name) not in (default, AUTO)]
            check_alone(self.whole_system, named, self.fps)
        if self.pronunciations is not None and not self.face_rules:
            raise InputError("SpliceOptions.mouthing moves faces by rule, expected SpliceOptions.face_rules too")

    @cached_property
    def whole_system(self) -> WholeSystem | None:
        """The system that splices whole words; None if cutter, duration and transition are used."""
        return open_system(self.system) if isinstance(self.system, str) else self.system

    @cached_property
    def pronunciations(self) -> Pronunciations | None:
        """The dictionary that ``mouthing`` names; None if it names none."""
        if self.mouthing is None:
            return None
        from signsplice.splicing.mouthing import read_pronunciations  # loads the written signs

        return read_pronunciations(self.mouthing, self.limits.free_bytes)

    @property
    def seconds_a_sign(self) -> float | None:
        """Seconds that a sign takes with its transition at the chosen tempo; None: as recorded."""
        return None if self.tempo == CITATION else seconds_a_sign(self.tempo)

    @property
    def leads_arms(self) -> bool:
        """Whether planned arms are led around the body."""
        return self.avoid_collisions is not False

    @property
    def moves_person(self) -> bool:
        """Whether head and trunk move where no word owns them: not in a system's sentences."""
        return self.person > 0.0 and self.whole_system is None

    def choose_methods(self) -> Methods:
        """Returns the methods of the call. A tempo determines the duration of transitions, unless the call names a
        duration. A system whose misses are not filled needs no network, so none is read.
        """
        if self.system is not None and not self.fill_misses:
            return choose(CLASSICAL_CUTTER, CLASSICAL_TRANSITION, DEFAULT_DURATION)
        methods, seconds = choose(self.cutter, self.transition, self.duration, self.bundle), self.seconds_a_sign
        if seconds is None or self.has_own("duration"):
            return methods
        return replace(methods, duration=TravelDuration(seconds))

    def has_own(self, kind: str) -> bool:
        """Whether the call names a cutter, transition or duration (``kind``) other than the default."""
        return getattr(self, kind) not in (None, AUTO, NAME, DEFAULT_DURATION)


def not_options(options: object) -> TypeError:
    """Returns the error for an argument that is not ``SpliceOptions``: often the second of two clips."""
    hint = "; clips go into one list: splice([a, b])" if isinstance(options, Clip) else ""
    return TypeError(f"options is a {type(options).__name__}, expected SpliceOptions{hint}")
