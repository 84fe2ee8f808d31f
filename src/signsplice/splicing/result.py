"""Results of the engine: pieces of a sentence, and a whole sentence, with the origin of each frame."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from signsplice.body.contacts import Contact
from signsplice.lexicon.gloss import is_letter
from signsplice.motion import Clip
from signsplice.splicing.durations import CITATION, NATURAL, seconds_a_sign
from signsplice.splicing.seam import SeamScore

if TYPE_CHECKING:
    from signsplice.render.sheet import Mark


@dataclass(frozen=True)
class Remade:
    """Joints of a sign's span that do not show its clip: those of channels that the word does not own, the fingers of a
    spelled letter that are on their way, the arm of one that slides.

    joints: their names.
    frames: of the output, half-open; outside them these joints too are the clip's. The whole span if channels are
        planned.
    """

    joints: tuple[str, ...]
    frames: tuple[int, int]


@dataclass(frozen=True)
class Pause:
    """Frames of a transition's or a retraction's span in which the sign before it is held in its last posture.

    mark: the mark for which it is held: , . ? or !
    frames: of the output, half-open; the span begins with them.
    """

    mark: str
    frames: tuple[int, int]


@dataclass(frozen=True)
class Span:
    """Where a stretch of the output comes from; frame ranges are half-open.

    kind: "sign"; "transition"; or "retraction": the last word's frames after its sign, in which hands come down.
    clip: index of the source clip; None for a transition.
    name: name of the source clip; None for a transition.
    source: frames of that clip, counted at the output rate; None for a transition.
    output: frames of the output.
    warp: each output frame with the frame of the clip that it shows, where a tempo or a pause changed when frames come;
        else None.
    remade: joints whose frames are not those of the clip: of channels that the word does not own, or of a spelled
        letter; None where all are.
    pause: of a transition or a retraction that begins with one, else None.
    """

    kind: Literal["sign", "transition", "retraction"]
    clip: int | None
    name: str | None
    source: tuple[int, int] | None
    output: tuple[int, int]
    warp: tuple[tuple[int, float], ...] | None = None
    remade: Remade | None = None
    pause: Pause | None = None


@dataclass(frozen=True, eq=False)
class Piece:
    """A stretch of finished frames.

    clip: the frames.
    span: origin of the frames.
    seam: the seam before a sign; None for transitions and for the first sign.
    warnings: what a user should know about the sign's clip, one line each.
    """

    clip: Clip
    span: Span
    seam: SeamScore | None = None
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class FaceSources:
    """The origin of a sentence's face.

    recorded: indices of the clips with a face of their own.
    rules: the rules that animate the others (``face_rules``).
    """

    recorded: tuple[int, ...]
    rules: tuple[str, ...]


@dataclass(frozen=True)
class PlannedPerson:
    """The motion of a sentence that no word owns (``person``).

    amount, seed: ``SpliceOptions.person`` and ``seed``.
    planned: index of each clip -> its channels (``roles.CHANNELS``) with planned frames.
    """

    amount: float
    seed: int
    planned: Mapping[int, tuple[str, ...]]


@dataclass(frozen=True)
class ReachedTempo:
    """The tempo of a sentence.

    mode: "citation", "natural", or "seconds" where they were given.
    asked_seconds: seconds that a sign was to take with its transition; None for "citation".
    seconds: seconds that a sign takes with the transition to it, the mean of all signs but letters, the first and the
        last, which begin and end at rest; None where there is no other.
    """

    mode: Literal["citation", "natural", "seconds"] = "citation"
    asked_seconds: float | None = None
    seconds: float | None = None


@dataclass(frozen=True, eq=False)
class SpliceResult:
    """A spliced sentence.

    clip: the animation.
    spans: origin of each frame, in order.
    seams: score of each seam, in order.
    warnings: what a user should know, one line each.
    cutter, transition: names of the methods used.
    timing_ms: time spent in each part: "harmonize" (align), "cut", "transition", "join".
    bundle: sha256 of the bundle of the chosen methods; None if all are classical.
    contacts: contacts of the hands for each source clip that was retargeted, by its index.
    tempo: the requested tempo, and the time that signs take.
    system: name, bundle and training of the system that spliced whole words; None if none did.
    avatar: name and contacts of the avatar to which the sentence was retargeted; None without one.
    face: origin of the face; None if there is none.
    person: motion that no word owns; None in a system's sentences.
    skeleton: index of the clip whose skeleton the sentence has (None for ``SpliceOptions.onto``), name and reason
        ("clip", "name", "why"); None if it is the first clip's.
    """

    clip: Clip
    spans: tuple[Span, ...]
    seams: tuple[SeamScore, ...]
    warnings: tuple[str, ...]
    cutter: str
    transition: str
    timing_ms: dict[str, float]
    bundle: str | None = None
    contacts: Mapping[int, tuple[Contact, ...]] = field(default_factory=dict)
    tempo: ReachedTempo = field(default_factory=ReachedTempo)
    system: Mapping[str, Any] | None = None
    avatar: Mapping[str, Any] | None = None
    face: FaceSources | None = None
    person: PlannedPerson | None = None
    skeleton: Mapping[str, Any] | None = None

    @property
    def marks(self) -> list[Mark]:
        """The spans as marks for pictures (``render.film.write_pictures``)."""
        from signsplice.render.sheet import Mark

        return [Mark(span.kind, span.name or "", *span.output) for span in self.spans]


def measure_tempo(signs: Sequence[tuple[str, tuple[int, int]]], fps: float, tempo: str | float) -> ReachedTempo:
    """Measures the tempo of a sentence from the names and output frames, half-open, of its ``signs`` in order."""
    asked = None if tempo == CITATION else seconds_a_sign(tempo)
    mode: Literal["citation", "natural", "seconds"] = "seconds"
    if asked is None:
        mode = "citation"
    elif tempo == NATURAL:
        mode = "natural"
    inner = list(pairwise(signs))[:-1]
    frames = [after[1] - before[1] for (_, before), (name, after) in inner if not is_letter(name)]
    seconds = round(float(np.mean(frames)) / fps, 3) if frames else None
    return ReachedTempo(mode, asked, seconds)
