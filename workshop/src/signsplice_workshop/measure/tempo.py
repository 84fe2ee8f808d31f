"""Sentences at the tempo of running signing beside the same at that of dictionary forms: how long signs take, and what
is left of their movements, repetitions and contacts.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter1d

from signsplice.errors import InputError
from signsplice.motion import Clip, FloatArray, rotation, sample_clip
from signsplice.signer import notation, planner
from signsplice.signer.phonology import Sign
from signsplice.signer.planner import IsolatedWord
from signsplice.signer.signer import STANDARD, Signer, draw_signer, stream
from signsplice.splicing.durations import CITATION, NATURAL, RUNNING_S
from signsplice.splicing.engine import Span, SpliceOptions, SpliceResult, splice
from signsplice.splicing.seam import SeamScore
from signsplice.splicing.tempo import contact_frames
from signsplice_workshop.measure.hands import keeps_stroke, output_frame, stroke, wrist_positions
from signsplice_workshop.measure.measures import (
    Measure,
    Progress,
    Row,
    markdown_rows,
    over,
    percent,
    row_of,
    track_progress,
)

LENGTH = 7
"""Signs of a sentence; the first and the last are not measured, since rest is part of them."""
SLOW = 0.6
"""Tempo of a signer who shows dictionary forms slowly."""
SLOW_DICTIONARIES = ((0.6, 0.5), (0.45, 0.8))
"""Tempo, and seconds that the last posture is held beyond the signer's own time."""
NOISE_RAD = 0.004
"""Deviation of each joint's rotations, within those of captures (0.002 to 0.008)."""
_TURN_M, _SEEN_TURN_M = 0.015, 0.01
"""A recorded hand turns back where it has gone this far, m, along the main axis of its path; a played one is seen to
from the second on.
"""
_STILL_M = 0.05


@dataclass(frozen=True)
class _SignMeasurement:
    """One sign of a sentence.

    seconds, transition: how long it takes, and the transition before it, s.
    peak, peak_ratio: highest speed of a wrist within the sign, m/s, and over the recorded sign's.
    jerk_ratio: jerk of the faster wrist over the recorded sign's, both scaled to one duration: 1 where the movement
        keeps its shape.
    whole: whether all its movements are kept.
    repeats: whether hands turn back no less often than recorded in its movements.
    passes: seconds of passes of movements that were not as short as recorded.
    contacts: how many were recorded, and how many are seen in two frames or more.
    """

    seconds: float
    transition: float
    peak: float
    peak_ratio: float
    jerk_ratio: float
    whole: bool
    repeats: bool
    passes: tuple[float, ...]
    contacts: tuple[int, int]


@dataclass(frozen=True)
class _Measured:
    """The signs of a lexicon at one tempo, first and last of each sentence left out, and all seams."""

    signs: Sequence[_SignMeasurement]
    seams: Sequence[SeamScore]


def _sign(field: str, statistic: Callable[[FloatArray], float]) -> Callable[[_Measured], float | None]:
    return lambda of: over(field, statistic)(of.signs)


def _seam(field: str, statistic: Callable[[FloatArray], float]) -> Callable[[_Measured], float | None]:
    return lambda of: over(field, statistic)(of.seams)


def _percentile_95(values: FloatArray) -> float:
    return float(np.quantile(values, 0.95))


def _mean_ratio(of: _Measured) -> float:
    return float(np.mean([sign.seconds + sign.transition for sign in of.signs])) / RUNNING_S


def _shortest_pass(of: _Measured) -> float | None:
    return min((seconds for sign in of.signs for seconds in sign.passes), default=None)


def _contact_fraction(of: _Measured) -> float | None:
    there, seen = np.sum([sign.contacts for sign in of.signs], axis=0).tolist()
    return seen / there if there else None


MEASURES = (
    Measure("words", "words"),
    Measure("tempo", "tempo"),
    Measure("n_signs", "signs", function=lambda of: len(of.signs)),
    Measure("ratio", "of running tempo", "{:.2f}", function=_mean_ratio),
    Measure("sign_seconds", "sign, s", "{:.2f}", function=_sign("seconds", np.nanmedian)),
    Measure("transition_seconds", "transition, s", "{:.2f}", function=_sign("transition", np.nanmedian)),
    Measure("longest", "95 %", "{:.2f}", function=_sign("seconds", _percentile_95)),
    Measure("peak", "peak, m/s", "{:.2f}", function=_sign("peak", np.nanmedian)),
    Measure("fastest", "fastest", "{:.2f}", function=_sign("peak", np.max)),
    Measure("peak_ratio", "peak ratio", "{:.2f}", function=_sign("peak_ratio", np.nanmedian)),
    Measure("jerk_ratio", "jerk ratio", "{:.2f}", function=_sign("jerk_ratio", np.nanmedian)),
    Measure("velocity_jump", "velocity jump, m/s", "{:.2f}", function=_seam("velocity_jump", np.median)),
    Measure("transition_peak", "transition peak", "{:.2f}", function=_seam("peak_speed_m_s", _percentile_95)),
    percent("whole", "strokes whole", 0, _sign("whole", np.mean)),
    percent("repetitions", "turns kept", 0, _sign("repeats", np.mean)),
    Measure("shortest_pass", "shortest pass, s", "{:.2f}", function=_shortest_pass),
    percent("contacts", "contacts kept", 0, _contact_fraction),
)
"""Of a lexicon at a tempo: seconds a sign takes, its transition included, over ``RUNNING_S``; what signs and seams are;
fraction of the contacts that are seen in two frames or more.
"""
_SHOWN = (*MEASURES[:5], MEASURES[6], MEASURES[5], *MEASURES[7:])
"""In a table the longest signs stand beside the others."""


def draw_words(n_words: int) -> dict[str, tuple[Signer, list[Sign]]]:
    """Words that ship, drawn by seed, by the standard signer, and as many others by each of three other signers: one
    drawn by seed, one who rests with folded hands, one who signs slowly. No word is in two of them. Raises
    ``InputError`` where there are not so many words.
    """
    signs = list(notation.everyday().values())
    order = stream("tempo", len(signs)).permutation(len(signs)).tolist()
    signers: dict[str, Signer] = {
        "words that ship": STANDARD,
        "signer 201": draw_signer(201),
        "signer 202, folded": replace(draw_signer(202), rest="folded"),
        "signer 203, slow": replace(draw_signer(203), tempo=SLOW),
    }
    most = len(signs) // len(signers)
    if not LENGTH <= n_words <= most:
        raise InputError(f"{n_words} words of each signer, expected {LENGTH} to {most}")
    rows = [order[n * n_words : (n + 1) * n_words] for n in range(len(signers))]
    return {name: (signer, [signs[k] for k in row]) for (name, signer), row in zip(signers.items(), rows, strict=True)}


def lexicons(n_words: int) -> dict[str, list[IsolatedWord]]:
    """The words of ``draw_words``, signed, and those that ship as other dictionaries show and capture them: slowly with
    long last holds, and with noise. Raises as ``draw_words`` does.
    """
    words = {
        name: [planner.synthesize_word(one, signer) for one in signs]
        for name, (signer, signs) in draw_words(n_words).items()
    }
    shipped = words["words that ship"]
    for tempo, hold_s in SLOW_DICTIONARIES:
        slow = [planner.synthesize_word(word.sign, replace(STANDARD, tempo=tempo)) for word in shipped]
        words[f"slowed to {tempo:g}, held {hold_s:g} s"] = [hold_longer(word, hold_s) for word in slow]
    words[f"noise of {NOISE_RAD:g} rad"] = [add_noise(word, NOISE_RAD) for word in shipped]
    return words


def hold_longer(word: IsolatedWord, seconds: float) -> IsolatedWord:
    """The word with its last posture held so much longer."""
    clip, events, n_more = word.clip, word.events, round(seconds * word.clip.fps)
    frames = np.r_[: events.end + 1, [events.end] * n_more, events.end + 1 : len(clip)].astype(np.float64)
    events = replace(events, end=events.end + n_more, down=events.down + n_more)
    return replace(word, clip=replace(sample_clip(clip, frames), name=clip.name), events=events)


def add_noise(word: IsolatedWord, radians: float) -> IsolatedWord:
    """The word with every joint turned by noise of this standard deviation an axis, smooth over 1/30 s."""
    clip = word.clip
    white = stream("noise", clip.name).standard_normal((*clip.local_rotations.shape[:2], 3))
    turns = gaussian_filter1d(white, clip.fps / 30.0, axis=0)
    rotations = rotation.multiply(clip.local_rotations, rotation.exp(turns * radians / turns.std()))
    return replace(word, clip=replace(clip, local_rotations=rotations))


def compare(
    words: dict[str, list[IsolatedWord]],
    tempos: Sequence[str | float] = (CITATION, NATURAL),
    bundle: str | Path | None = None,
    progress: Progress | None = None,
) -> list[Row]:
    """One row for each lexicon and tempo; every word is measured once."""
    return [
        row_of(
            MEASURES,
            _measure_lexicon(lexicon, SpliceOptions(tempo=tempo, bundle=bundle)),
            words=name,
            tempo=str(tempo),
        )
        for (name, lexicon), tempo in track_progress([*product(words.items(), tempos)], progress)
    ]


def _measure_lexicon(words: Sequence[IsolatedWord], options: SpliceOptions) -> _Measured:
    """What became of every word in sentences of a lexicon's words."""
    signs: list[_SignMeasurement] = []
    seams: list[SeamScore] = []
    for part in _sentences(words):
        result = splice([word.clip for word in part], options)
        signs += list(_signs(result, part))
        seams += result.seams
    return _Measured(signs, seams)


def _sentences(words: Sequence[IsolatedWord]) -> Iterator[list[IsolatedWord]]:
    """Sentences of ``LENGTH`` in which every word stands once between two others."""
    inner = LENGTH - 2
    for start in range(0, len(words), inner):
        part = list(words[start : start + inner])
        yield [words[start - 1], *part, words[(start + len(part)) % len(words)]]


def _signs(result: SpliceResult, words: Sequence[IsolatedWord]) -> Iterator[_SignMeasurement]:
    """What each sign but the first and the last became."""
    fps, wrists = result.clip.fps, wrist_positions(result.clip)
    touching = contact_frames(result.clip)
    for before, span in zip(result.spans, result.spans[1:-1], strict=False):
        if span.kind != "sign" or span.source is None or span.clip is None:
            continue
        word, played = words[span.clip], wrists[slice(*span.output)]
        recorded = wrist_positions(word.clip)[slice(*span.source)]
        peaks = [_peak(path, fps) for path in (played, recorded)]
        jerks = [_shape(path) for path in (played, recorded)]
        yield _SignMeasurement(
            seconds=len(played) / fps,
            transition=(before.output[1] - before.output[0]) / fps if before.kind == "transition" else 0.0,
            peak=peaks[0],
            peak_ratio=peaks[0] / peaks[1] if peaks[1] > 0.0 else float("nan"),
            jerk_ratio=jerks[0] / jerks[1] if jerks[1] > 0.0 else float("nan"),
            whole=keeps_stroke(word, *span.source),
            repeats=_repeats(span, word, wrists),
            passes=tuple(_passes(span, word, fps)),
            contacts=_contacts(span, word.clip, touching),
        )


def _passes(span: Span, word: IsolatedWord, fps: float) -> Iterator[float]:
    """Seconds of each pass that is played faster than recorded."""
    for begin, end in word.events.passes:
        seconds = (output_frame(span, end) - output_frame(span, begin)) / fps
        if seconds < (end - begin) / fps - 1e-3:
            yield seconds


def _repeats(span: Span, word: IsolatedWord, wrists: FloatArray) -> bool:
    """Whether the hands (T, W, 3) of a sentence turn back no less often than recorded in a sign's movements."""
    events = word.events
    if events.first is None or not events.passes:
        return True
    first, last = stroke(word)
    recorded = wrist_positions(word.clip)[first : last + 1]
    start, stop = int(np.floor(output_frame(span, first))), int(np.ceil(output_frame(span, last))) + 1
    for path, played in zip(recorded.swapaxes(0, 1), wrists[start:stop].swapaxes(0, 1), strict=True):
        axis = np.linalg.svd(path - path.mean(axis=0), full_matrices=False)[2][0]
        if _direction_changes(played, axis, _SEEN_TURN_M) < _direction_changes(path, axis, _TURN_M):
            return False
    return True


def _contacts(span: Span, clip: Clip, touching: Sequence[tuple[int, int]]) -> tuple[int, int]:
    """Contacts recorded wholly within a span, and those of them that the sentence shows, in two frames or more."""
    start, stop = span.source or (0, 0)
    there = [(a, b) for a, b in contact_frames(clip) if start <= a and b <= stop]
    seen = [
        any(max(first, output_frame(span, a) - 1) < min(end, output_frame(span, b - 1) + 2) for first, end in touching)
        for a, b in there
    ]
    return len(there), sum(seen)


def _peak(wrists: FloatArray, fps: float) -> float:
    return float(np.linalg.norm(np.diff(wrists, axis=0), axis=-1).max(initial=0.0) * fps)


def _shape(wrists: FloatArray) -> float:
    """Root mean square jerk of the wrist (T, W, 3) that goes farther, over its path's length, in durations; NaN for one
    that stands still.
    """
    lengths = np.linalg.norm(np.diff(wrists, axis=0), axis=-1).sum(axis=0)
    hand = int(np.argmax(lengths))
    if len(wrists) < 5 or lengths[hand] < _STILL_M:
        return float("nan")
    jerk = np.diff(wrists[:, hand], n=3, axis=0)
    return float(np.sqrt((jerk**2).sum(axis=-1).mean()) * (len(wrists) - 1) ** 3 / lengths[hand])


def _direction_changes(path: FloatArray, axis: FloatArray, least: float) -> int:
    """How often a wrist (T, 3) turns back along the main axis of its recorded path, by more than ``least`` m."""
    along = path @ axis
    turns, direction, extreme = 0, 0.0, along[0]
    for value in along.tolist():
        if direction == 0.0 and abs(value - extreme) > least:
            direction, extreme = np.sign(value - extreme), value
        elif direction != 0.0 and (value - extreme) * direction >= 0.0:
            extreme = value
        elif direction != 0.0 and abs(value - extreme) > least:
            turns, direction, extreme = turns + 1, -direction, value
    return turns


def signature(n_words: int) -> str:
    """The recipe of the numbers."""
    return (
        f"tempo|words:everyday,{n_words},drawn:once|signs:inner-of-{LENGTH}|running:{RUNNING_S:g}s"
        f"|jerk:third-difference,rms,duration^3/path|turns:{1e3 * _TURN_M:g}mm"
        f"|slow:{','.join(f'{tempo:g}+{hold_s:g}s' for tempo, hold_s in SLOW_DICTIONARIES)}|noise:{NOISE_RAD:g}rad"
    )


def table(rows: Sequence[Row], n_words: int) -> list[str]:
    """The rows as Markdown, with their signature."""
    return [f"`{signature(n_words)}`", "", *markdown_rows(_SHOWN, rows)]
