"""Everything that goes over the wire, as dataclasses: the service answers with them, its OpenAPI is made of them, and
the viewer's TypeScript is generated from them (``typescript``).
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from typing import Annotated, Literal

from pydantic import ConfigDict, Field

Format = Literal["bvh", "glb", "vrma"]
FORMATS: tuple[Format, ...] = ("bvh", "glb", "vrma")
Seconds = Annotated[float, Field(ge=0.0, le=10.0, allow_inf_nan=False)]
Gloss = Annotated[str, Field(min_length=1, max_length=200)]
Name = Annotated[str, Field(min_length=1, max_length=60)]
Rule = Literal["auto", "tempo", "fixed", "travel", "speed"]

FRAMES = struct.Struct("<4sIII")
"""Head of a binary message of frames: MAGIC, number of the first frame, of frames F and of joints J. There follow F
times 3 + 4 J little-endian float32: the root's place in the skeleton's own unit, and every joint's local rotation as a
unit quaternion x y z w.
"""
MAGIC = b"SSF1"
_STRICT = ConfigDict(extra="forbid")
"""A name that is not known is a mistake, and is said."""


@dataclass(frozen=True, kw_only=True)
class Dials:
    """What a caller may turn; what is left out is the default of the command line.

    transition_time: a rule's name, or seconds. sign_speed: how many times as fast signs play. fps: of the output, by
    default the first clip's.
    """

    __pydantic_config__ = _STRICT

    cutter: Name | None = None
    transition: Name | None = None
    transition_time: Rule | Seconds = "auto"
    sign_speed: Annotated[float, Field(ge=0.1, le=10.0, allow_inf_nan=False)] = 1.0
    fps: Annotated[float, Field(ge=1.0, le=240.0, allow_inf_nan=False)] | None = None
    body_sense: bool | None = None


@dataclass(frozen=True, kw_only=True)
class SentenceRequest(Dials):
    """A line of glosses to sign. spell: letters sign what is no word. formats: of the files that are wanted."""

    glosses: Annotated[list[Gloss], Field(min_length=1, max_length=1000, fail_fast=True)]
    spell: bool = True
    formats: Annotated[list[Format], Field(max_length=3, fail_fast=True)] = field(default_factory=lambda: ["bvh"])


@dataclass(frozen=True, kw_only=True)
class SpliceRequest(Dials):
    """What is told beside the files of a splice, in its field ``options``."""

    formats: Annotated[list[Format], Field(max_length=3, fail_fast=True)] = field(default_factory=lambda: ["bvh"])


@dataclass(frozen=True)
class Span:
    """Where a stretch of the output comes from; frame ranges are half-open."""

    kind: Literal["sign", "transition"]
    clip: int | None
    name: str | None
    source: tuple[int, int] | None
    output: tuple[int, int]


@dataclass(frozen=True)
class Seam:
    """How two signs are joined, and how well; null where a score cannot be told."""

    before: str
    after: str
    pre_frame: int
    post_frame: int
    n_transition: int
    seconds: float
    velocity_jump: float | None
    peak_speed_m_s: float | None
    jerk_ratio: float | None
    warnings: list[str]
    intrusion_mm: float | None


@dataclass(frozen=True)
class Report:
    """The report of a splice, version 1."""

    version: int
    fps: float
    frames: int
    cutter: str
    transition: str
    bundle: str | None
    spans: list[Span]
    seams: list[Seam]
    warnings: list[str]
    timing_ms: dict[str, float]


@dataclass(frozen=True)
class TokenReading:
    """A token of a sentence, and the words or letters that sign it."""

    token: str
    glosses: list[str]
    spelled: bool
    warning: str


@dataclass(frozen=True)
class Files:
    """Files in base64, those that were asked for and could be made."""

    bvh: str | None = None
    glb: str | None = None
    vrma: str | None = None


@dataclass(frozen=True)
class Spliced:
    """A spliced sentence: its name, its report and its files; units: how its glosses were read, none for files."""

    name: str
    report: Report
    files: Files
    units: list[TokenReading] = field(default_factory=list)


@dataclass(frozen=True)
class LexiconWord:
    """A word of the lexicon. checked: a signer has said that the clip shows this sign."""

    gloss: str
    kind: Literal["sign", "letter"]
    synonyms: list[str]
    seconds: float
    signer: str
    checked: bool


@dataclass(frozen=True)
class WordList:
    """Words of the lexicon in order, from the one that was asked for on; total: how many fit the search."""

    words: list[LexiconWord]
    total: int


@dataclass(frozen=True)
class MethodInfo:
    """A cutter, transition or duration by name."""

    kind: Literal["cutter", "transition", "duration"]
    name: str
    summary: str
    learned: bool
    default: bool


@dataclass(frozen=True)
class Health:
    """That the service is there. waiting: requests that wait for a worker; streams: those that are open."""

    status: Literal["ok"]
    version: str
    words: int
    waiting: int
    streams: int


@dataclass(frozen=True)
class Failure:
    """What went wrong, in one line. unknown: every gloss that the lexicon has not, and the nearest ones that it has."""

    error: str
    unknown: dict[str, list[str]] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Open(Dials):
    """First message of a stream's client. paced: frames come when they are due, else as fast as they are made."""

    type: Literal["open"]
    paced: bool = True
    spell: bool = True


@dataclass(frozen=True)
class Say:
    """One more word, or a token to spell."""

    __pydantic_config__ = _STRICT

    type: Literal["word"]
    gloss: Gloss


@dataclass(frozen=True)
class End:
    """There are no more words."""

    __pydantic_config__ = _STRICT

    type: Literal["end"]


@dataclass(frozen=True)
class SkeletonMessage:
    """What frames are of; comes before the first of them. offsets: places of joints from their parents', own unit;
    metres: how long that unit is. parents: joints' numbers, -1 for the root.
    """

    type: Literal["skeleton"]
    fps: float
    names: list[str]
    parents: list[int]
    offsets: list[tuple[float, float, float]]
    metres: float
    cutter: str
    transition: str


@dataclass(frozen=True)
class SpanBegins:
    """Frames of this span are next."""

    type: Literal["span"]
    span: Span


@dataclass(frozen=True)
class SeamJoined:
    """The seam by which the span that follows is entered."""

    type: Literal["seam"]
    seam: Seam


@dataclass(frozen=True)
class Warned:
    """Something that a user should know."""

    type: Literal["warning"]
    warning: str


@dataclass(frozen=True)
class Done:
    """All frames have come; the socket closes."""

    type: Literal["done"]
    frames: int


@dataclass(frozen=True)
class Failed:
    """A message was wrong. A word that is not known is left out, and the stream goes on; else the socket closes."""

    type: Literal["error"]
    error: str
    unknown: dict[str, list[str]] = field(default_factory=dict)


FromClient = Open | Say | End
FromService = SkeletonMessage | SpanBegins | SeamJoined | Warned | Done | Failed
