"""Everything that the service sends and receives, as dataclasses, messages of streams and the binary message of
their frames too.

The OpenAPI document is made of them, and the viewer's TypeScript is generated from them (``viewer/generate.py``).
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field, fields, make_dataclass
from functools import reduce
from operator import or_
from types import UnionType
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args, get_origin, get_type_hints

from pydantic import ConfigDict, Field

from signsplice.formats import WIRE_FORMATS
from signsplice.lexicon import sentence
from signsplice.splicing import engine, result, seam
from signsplice.splicing.durations import DURATIONS, FASTEST_S, SLOWEST_S
from signsplice.splicing.lptransformer import SHIPPED
from signsplice.splicing.options import AUTO
from signsplice.splicing.person import FREE_HANDS, NATURAL

FORMAT_NAMES = WIRE_FORMATS
"""Names of the file formats that the service accepts and sends."""
PICTURES = ("png", "gif")
"""A contact sheet and a film, which it draws."""


def json_type(source: type, name: str = "") -> type:
    """A dataclass with the name (or another ``name``), docstring and fields of ``source``, typed as JSON has them: so
    the wire cannot drift from the engine.

    Tuples of any length become lists, and a score may be null, since JSON has no NaN. Every field is required: the
    service writes all of them.
    """
    hints = get_type_hints(source, include_extras=True)
    typed = [(field.name, _json_hint(hints[field.name])) for field in fields(source)]
    namespace = {"__doc__": source.__doc__, "__module__": __name__}
    return make_dataclass(name or source.__name__, typed, frozen=True, namespace=namespace)


def _json_hint(hint: Any) -> Any:
    if hint == seam.Number:
        return float | None
    inner = get_args(hint)
    if get_origin(hint) is UnionType:
        return reduce(or_, map(_json_hint, inner))
    return list[_json_hint(inner[0])] if get_origin(hint) is tuple and inner[-1] is Ellipsis else hint  # type: ignore[misc]


if TYPE_CHECKING:
    from signsplice.lexicon.sentence import SentenceToken
    from signsplice.splicing.engine import Span
    from signsplice.splicing.result import Pause, ReachedTempo, Remade
    from signsplice.splicing.seam import SeamScore

    Format = str
    AnswerFile = str
    DurationRule = str
    SystemName = str
    FreeHand = str
    Files = dict[str, str | None]
else:
    SentenceToken = json_type(sentence.SentenceToken)
    Remade = json_type(result.Remade)
    Pause = json_type(result.Pause)
    Span = json_type(engine.Span)
    SeamScore = json_type(seam.SeamScore, "Seam")
    ReachedTempo = json_type(result.ReachedTempo)
    Format = Literal[FORMAT_NAMES]
    AnswerFile = Literal[(*FORMAT_NAMES, *PICTURES)]
    DurationRule = Literal[(AUTO, *DURATIONS)]
    FreeHand = Literal[FREE_HANDS]
    SystemName = Literal[(*SHIPPED,)]
    Files = make_dataclass(
        "Files",
        [(form, str | None, None) for form in FORMAT_NAMES],
        frozen=True,
        namespace={
            "__doc__": "Files in base64; null for a format that was not requested or cannot hold the clip.",
            "__module__": __name__,
        },
    )

Formats = Annotated[list[Format], Field(max_length=len(FORMAT_NAMES), fail_fast=True)]
Seconds = Annotated[float, Field(ge=0.0, le=10.0, allow_inf_nan=False)]
SecondsASign = Annotated[float, Field(ge=FASTEST_S, le=SLOWEST_S, allow_inf_nan=False)]
Gloss = Annotated[str, Field(min_length=1, max_length=200)]
Glosses = Annotated[list[Gloss], Field(min_length=1, max_length=1000, fail_fast=True)]
Text = Annotated[str, Field(min_length=1, max_length=10_000)]
Language = Annotated[str, Field(max_length=10)]
MethodName = Annotated[str, Field(min_length=1, max_length=60)]

STRICT = ConfigDict(extra="forbid")
"""Refuses unknown keys, which are mistakes of the caller."""


@dataclass(frozen=True, kw_only=True)
class Dials:
    """Options of a splice. What is left out has the default of the command line.

    cutter: name of a cutter, see /v1/methods.
    transition: name of a transition, see /v1/methods.
    transition_time: duration of every transition in seconds, or the name of a duration rule.
    sign_speed: playback speed of the signs; 1 is as recorded.
    tempo: signs as recorded, at the tempo of running signing, or the seconds that a sign takes with its transition.
    fps: frame rate of the output; null for that of the first clip.
    avoid_collisions (in JSON: body_sense): lead hands around the body; null: if the transition is learned.
    free_hand: what an arm without a sign does: stay up and sink late and slowly, or fall and rise within transitions.
    person: how much head, trunk and gaze move where no sign moves them: 0, not at all, to 1, nearly as people's do.
    seed: another one gives other movements of arms, head and trunk without a sign.
    system: a system that joins whole words, in place of cutter, transition and what goes with them.
    """

    __pydantic_config__ = STRICT

    cutter: MethodName | None = None
    transition: MethodName | None = None
    transition_time: DurationRule | Seconds = "auto"
    sign_speed: Annotated[float, Field(ge=0.1, le=10.0, allow_inf_nan=False)] = 1.0
    tempo: Literal["citation", "natural"] | SecondsASign = "citation"
    fps: Annotated[float, Field(ge=1.0, le=240.0, allow_inf_nan=False)] | None = None
    avoid_collisions: Annotated[bool | None, Field(alias="body_sense")] = None
    free_hand: FreeHand = NATURAL
    person: Annotated[float, Field(ge=0.0, le=1.0, allow_inf_nan=False)] = 1.0
    seed: Annotated[int, Field(ge=0, lt=2**53)] = 0
    system: SystemName | None = None


@dataclass(frozen=True, kw_only=True)
class SentenceRequest(Dials):
    """What to sign, ``glosses`` or ``text``, and how.

    glosses: words in the order of signing.
    text: the same as one line, as it is typed; it is not translated.
    spell: whether words that the lexicon lacks are fingerspelled or left out; else they are refused.
    compounds: whether words that are one gloss together are that gloss: I LOVE YOU is I-LOVE-YOU.
    drop_function_words: whether articles, forms of be and auxiliary do, which ASL has no signs for, are left out.
    language: of the words, a code such as en, for inflections and numbers; of the signs and letters, such as gsg; or
        both, en-gsg; empty: no inflections.
    one_language: whether signs of several signed languages, or of another than the named one, are refused.
    pauses: whether signs are held at commas, full stops, question and exclamation marks.
    face_rules: whether the face blinks, and its brows ask, by rule, where a word has no face of its own.
    formats: of the files to answer with.
    mesh: whether a glb file shows its signer; else it holds joints and motion alone.
    whole_face: whether that signer can show all coefficients of a face, of a stream that follows, or those used here.
    avatar: that signs: name of one of the service's, or id of an upload; null for the lexicon's signer.
    """

    glosses: Glosses | None = None
    text: Text | None = None
    spell: bool = True
    compounds: bool = True
    drop_function_words: bool = False
    language: Language = "en"
    one_language: bool = False
    pauses: bool = True
    face_rules: bool = False
    formats: Formats = field(default_factory=lambda: ["bvh"])
    mesh: bool = True
    whole_face: bool = False
    avatar: MethodName | None = None


@dataclass(frozen=True, kw_only=True)
class SpliceRequest(Dials):
    """The form field ``options`` of a splice of files.

    formats: of the files to answer with.
    mesh: whether a glb file shows its signer; else it holds joints and motion alone.
    avatar: that signs, as in a sentence; null for the signer of the first file.
    """

    formats: Formats = field(default_factory=lambda: ["bvh"])
    mesh: bool = True
    avatar: MethodName | None = None


@dataclass(frozen=True)
class Report:
    """The report of a splice, version 1.

    fps, frames: of the output.
    cutter, transition: names of the methods used.
    bundle: SHA-256 of the networks used, null where none was.
    tempo: the tempo asked for, and how long signs take.
    timing_ms: time spent, by step.
    """

    version: int
    fps: float
    frames: int
    cutter: str
    transition: str
    bundle: str | None
    spans: list[Span]
    seams: list[SeamScore]
    warnings: list[str]
    tempo: ReachedTempo
    timing_ms: dict[str, float]


@dataclass(frozen=True)
class Spliced:
    """A spliced sentence.

    name: of the clip.
    units: how each gloss was read; empty for a splice of files.
    spelled: words, as typed, that are fingerspelled.
    """

    name: str
    report: Report
    files: Files
    units: list[SentenceToken] = field(default_factory=list)
    spelled: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class UploadedAvatar:
    """An avatar that the service keeps until no request has named it for an hour, by default.

    avatar: its id.
    """

    avatar: str


@dataclass(frozen=True)
class LexiconWord:
    """A word of the lexicon.

    synonyms: other glosses that find it.
    seconds: length of the clip, rest included.
    signer: name of the signer.
    checked: whether a signer has confirmed that the clip shows this sign.
    language: code of the signed language, such as ase; empty if unknown.
    """

    gloss: str
    kind: Literal["sign", "letter"]
    synonyms: list[str]
    seconds: float
    signer: str
    checked: bool
    language: str


@dataclass(frozen=True)
class WordList:
    """One page of the lexicon's words, in order.

    total: number of words that match the search, on all pages.
    """

    words: list[LexiconWord]
    total: int


@dataclass(frozen=True)
class MethodInfo:
    """A cutter, transition, duration rule, or system that joins whole words.

    learned: whether it is a network.
    default: whether it is used where none is named.
    """

    kind: Literal["cutter", "transition", "duration", "system"]
    name: str
    summary: str
    learned: bool
    default: bool


@dataclass(frozen=True)
class Health:
    """The state of the service.

    status: starting, with status 503, until every worker process has made its first splice.
    version: of the package.
    words: number of words in the lexicon.
    waiting: requests that run or wait for a worker.
    streams: open streams.
    """

    status: Literal["ok", "starting"]
    version: str
    words: int
    waiting: int
    streams: int


@dataclass(frozen=True)
class Failure:
    """Why a request failed.

    error: one line: what is wrong, where, and what to do.
    unknown: each gloss that the lexicon lacks, with the nearest glosses that it has.
    """

    error: str
    unknown: dict[str, list[str]] = field(default_factory=dict)


FRAMES_HEADER = struct.Struct("<4sIII")
"""Header of a binary message of frames: FRAMES_MAGIC, number of the first frame, of frames F, of joints J.

F times 3 + 4 J little-endian float32 follow it: the root's position in the skeleton's unit, and every joint's local
rotation as a unit quaternion x y z w.
"""
FRAMES_MAGIC = b"SSF1"


@dataclass(frozen=True, kw_only=True)
class OpenMessage(Dials):
    """The first message of a stream's client.

    paced: whether frames are sent one by one when they are due; else as soon as they are made.
    spell: whether words that the lexicon lacks are fingerspelled or left out; else they are refused.
    compounds, drop_function_words, language: as in a sentence; compounds only within a text.
    one_language: as in a sentence, for each text.
    pauses: whether a sign is held at the punctuation after its word, in the same message.
    face_rules: as in a sentence; brows ask within a text.
    avatar: as in a sentence; every word is fitted to its body before words are joined on it.
    """

    type: Literal["open"]
    paced: bool = True
    spell: bool = True
    compounds: bool = True
    drop_function_words: bool = False
    language: Language = "en"
    one_language: bool = False
    pauses: bool = True
    face_rules: bool = False
    avatar: MethodName | None = None


@dataclass(frozen=True)
class WordMessage:
    """One more word, or a token to spell."""

    __pydantic_config__ = STRICT

    type: Literal["word"]
    gloss: Gloss


@dataclass(frozen=True)
class TextMessage:
    """A line as it is typed, read as that of a sentence."""

    __pydantic_config__ = STRICT

    type: Literal["text"]
    text: Text


@dataclass(frozen=True)
class EndMessage:
    """The last message of a stream's client: no more words follow."""

    __pydantic_config__ = STRICT

    type: Literal["end"]


@dataclass(frozen=True)
class SkeletonMessage:
    """The skeleton of the stream's frames; sent once, before them.

    names: of the joints.
    parents: index of each joint's parent, -1 for the root.
    nodes: numbers of the joints' nodes in an avatar's file as glb, whose rotations are those of the frames, but for the
        root; null without avatar.
    offsets: position of each joint relative to its parent at rest, in the skeleton's unit.
    metres: length of that unit.
    cutter, transition: names of the methods used.
    """

    type: Literal["skeleton"]
    fps: float
    names: list[str]
    parents: list[int]
    nodes: list[int] | None
    offsets: list[tuple[float, float, float]]
    metres: float
    cutter: str
    transition: str


@dataclass(frozen=True)
class SpanMessage:
    """The span of the frames that follow."""

    type: Literal["span"]
    span: Span


@dataclass(frozen=True)
class SeamMessage:
    """The seam before the span that follows."""

    type: Literal["seam"]
    seam: SeamScore


@dataclass(frozen=True)
class FaceMessage:
    """The face in the frames that follow; none is sent where they have none.

    first: number of the first of its frames.
    channels: names of ARKit's coefficients, or NODE/NUMBER of morph targets in an avatar's file; others are 0.
    weights: of each frame, in the order of ``channels``.
    """

    type: Literal["face"]
    first: int
    channels: list[str]
    weights: list[list[float]]


@dataclass(frozen=True)
class UnitMessage:
    """How a word of the client's was read, before its frames; it has no glosses where it was left out."""

    type: Literal["unit"]
    unit: SentenceToken


@dataclass(frozen=True)
class WarningMessage:
    """A warning to show to the user."""

    type: Literal["warning"]
    warning: str


@dataclass(frozen=True)
class DoneMessage:
    """The last message of a stream: all frames have been sent, and the socket closes.

    frames: number of frames sent.
    """

    type: Literal["done"]
    frames: int


@dataclass(frozen=True)
class ErrorMessage:
    """A message of the client was wrong.

    A message of which nothing can be signed is left out, and the stream goes on; after most other errors the socket
    closes.

    error: one line: what is wrong, and what to do.
    unknown: each gloss that the lexicon lacks, with the nearest glosses that it has.
    """

    type: Literal["error"]
    error: str
    unknown: dict[str, list[str]] = field(default_factory=dict)


ClientMessage = OpenMessage | WordMessage | TextMessage | EndMessage
ServiceMessage = (
    SkeletonMessage
    | UnitMessage
    | SpanMessage
    | SeamMessage
    | FaceMessage
    | WarningMessage
    | DoneMessage
    | ErrorMessage
)
