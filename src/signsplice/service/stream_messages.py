"""The messages of a stream, as dataclasses, and the binary message of its frames."""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from signsplice.service.wire import STRICT, Dials, Gloss, Text

if TYPE_CHECKING:
    from signsplice.lexicon.sentence import SentenceToken
    from signsplice.splicing.result import Span
    from signsplice.splicing.seam import SeamScore as Seam
else:
    from signsplice.service.wire import SentenceToken, Span

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
    spell: whether words that the lexicon lacks are fingerspelled.
    compounds, drop_function_words: as in a sentence; compounds only within a text.
    pauses: whether a sign is held at the punctuation after its word, in the same message.
    face_rules: as in a sentence; brows ask within a text.
    """

    type: Literal["open"]
    paced: bool = True
    spell: bool = True
    compounds: bool = True
    drop_function_words: bool = False
    pauses: bool = True
    face_rules: bool = False


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
    offsets: position of each joint relative to its parent at rest, in the skeleton's unit.
    metres: length of that unit.
    cutter, transition: names of the methods used.
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
class SpanMessage:
    """The span of the frames that follow."""

    type: Literal["span"]
    span: Span


@dataclass(frozen=True)
class SeamMessage:
    """The seam before the span that follows."""

    type: Literal["seam"]
    seam: Seam


@dataclass(frozen=True)
class FaceMessage:
    """The face in the frames that follow; none is sent where they have none.

    first: number of the first of its frames.
    channels: names of ARKit's coefficients; those that are not named are 0.
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

    A word that the lexicon lacks is left out, and the stream goes on; after any other error the socket closes.

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
