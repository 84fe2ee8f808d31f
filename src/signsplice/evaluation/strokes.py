"""The strokes of synthetic words, which are known, and where a sentence shows them."""

from __future__ import annotations

import numpy as np

from signsplice.signer.planner import IsolatedWord
from signsplice.splicing.engine import Span


def stroke(word: IsolatedWord) -> tuple[int, int]:
    """First and last frame of the movements of a sign, or of its only posture."""
    events = word.events
    if events.first is None or not events.passes:
        return events.start, events.end
    return events.first[0], events.passes[-1][1]


def keeps_stroke(word: IsolatedWord, first: int, stop: int) -> bool:
    """Whether frames [first, stop) hold all movements of the sign, or a frame of its only posture."""
    begin, end = stroke(word)
    if word.events.first is None or not word.events.passes:
        return max(first, begin) < min(stop, end + 1)
    return first <= begin and end < stop


def output_frame(span: Span, frame: int) -> float:
    """The output frame at which a sign's span shows a recorded frame, or would if it went on."""
    if span.warp is None or span.source is None:
        return frame - (span.source or (0, 0))[0] + span.output[0]
    outputs, sources = np.array(span.warp).T
    return float(np.interp(frame, sources, outputs))
