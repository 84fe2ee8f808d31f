"""Compares sentences at the tempo of running signing with the same sentences at the tempo of dictionary forms: how long
signs take, and what is left of their movements, repetitions and contacts.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product
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
    aggregate,
    format_measures,
    make_row,
    percent,
    track_progress,
)

LENGTH = 7
"""Number of signs of a sentence; the first and the last are not measured, since rest is part of them."""
SLOW = 0.6
"""Tempo of a signer who shows dictionary forms slowly."""
SLOW_DICTIONARIES = ((0.6, 0.5), (0.45, 0.8))
"""Tempo, and time that the last posture is held beyond the signer's own time, s."""
NOISE_RAD = 0.004
"""Standard deviation of each joint's rotations, radians, within those of captures (0.002 to 0.008)."""
_MIN_TURN_M, _MIN_SEEN_TURN_M = 0.015, 0.01
"""Distances along the main axis of a hand's path, m, above which it turns back: in a recording, and in a sentence."""
_MIN_PATH_M = 0.05


@dataclass(frozen=True)
class _SignMeasurement:
    """Measurement of one sign of a sentence.

    seconds, transition: duration of the sign, and of the transition before it, s.
    peak, peak_ratio: highest speed of a wrist within the sign, m/s, and over the recorded sign's.
    jerk_ratio: jerk of the faster wrist over the recorded sign's, both scaled to one duration: 1 where the movement
        keeps its shape.
    whole: whether all its movements are kept.
    repeats: whether hands turn back no less often than recorded in its movements.
    passes: durations of passes that are played faster than recorded, s.
    contacts: number of recorded contacts, and number of those seen in two frames or more.
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
class _MeasuredLexicon:
    """The signs of a lexicon at one tempo, first and last of each sentence left out, and all seams."""

    signs: Sequence[_SignMeasurement]
    seams: Sequence[SeamScore]


def _aggregate_signs(
    field: str, statistic: Callable[[FloatArray], float]
) -> Callable[[_MeasuredLexicon], float | None]:
    return lambda measured: aggregate(field, statistic)(measured.signs)


def _aggregate_seams(
    field: str, statistic: Callable[[FloatArray], float]
) -> Callable[[_MeasuredLexicon], float | None]:
    return lambda measured: aggregate(field, statistic)(measured.seams)


def _percentile_95(values: FloatArray) -> float:
    return float(np.quantile(values, 0.95))


def _mean_ratio(measured: _MeasuredLexicon) -> float:
    return float(np.mean([sign.seconds + sign.transition for sign in measured.signs])) / RUNNING_S


def _shortest_pass(measured: _MeasuredLexicon) -> float | None:
    return min((seconds for sign in measured.signs for seconds in sign.passes), default=None)


def _contact_fraction(measured: _MeasuredLexicon) -> float | None:
    n_recorded, n_seen = np.sum([sign.contacts for sign in measured.signs], axis=0).tolist()
    return n_seen / n_recorded if n_recorded else None


MEASURES = (
    Measure("words", "words"),
    Measure("tempo", "tempo"),
    Measure("n_signs", "signs", function=lambda measured: len(measured.signs)),
    Measure("ratio", "of running tempo", "{:.2f}", function=_mean_ratio),
    Measure("sign_seconds", "sign, s", "{:.2f}", function=_aggregate_signs("seconds", np.nanmedian)),
    Measure("transition_seconds", "transition, s", "{:.2f}", function=_aggregate_signs("transition", np.nanmedian)),
    Measure("longest", "95 %", "{:.2f}", function=_aggregate_signs("seconds", _percentile_95)),
    Measure("peak", "peak, m/s", "{:.2f}", function=_aggregate_signs("peak", np.nanmedian)),
    Measure("fastest", "fastest", "{:.2f}", function=_aggregate_signs("peak", np.max)),
    Measure("peak_ratio", "peak ratio", "{:.2f}", function=_aggregate_signs("peak_ratio", np.nanmedian)),
    Measure("jerk_ratio", "jerk ratio", "{:.2f}", function=_aggregate_signs("jerk_ratio", np.nanmedian)),
    Measure("velocity_jump", "velocity jump, m/s", "{:.2f}", function=_aggregate_seams("velocity_jump", np.median)),
    Measure(
        "transition_peak", "transition peak", "{:.2f}", function=_aggregate_seams("peak_speed_m_s", _percentile_95)
    ),
    percent("whole", "strokes whole", 0, _aggregate_signs("whole", np.mean)),
    percent("repetitions", "turns kept", 0, _aggregate_signs("repeats", np.mean)),
    Measure("shortest_pass", "shortest pass, s", "{:.2f}", function=_shortest_pass),
    percent("contacts", "contacts kept", 0, _contact_fraction),
)
"""Measures of a lexicon at a tempo: seconds a sign takes, its transition included, over ``RUNNING_S``; values of signs
and seams; fraction of the contacts that are seen in two frames or more.
"""
_SHOWN = (*MEASURES[:5], MEASURES[6], MEASURES[5], *MEASURES[7:])
"""Measures in the order of the table, with the longest signs beside the others."""


def draw_words(n_words: int) -> dict[str, tuple[Signer, list[Sign]]]:
    """Returns words that ship, drawn by seed, by the standard signer, and as many others by each of three other
    signers: one drawn by seed, one who rests with folded hands, one who signs slowly. No word is in two of them.
    Raises ``InputError`` if there are not so many words.
    """
    signs = list(notation.everyday().values())
    order = stream("tempo", len(signs)).permutation(len(signs)).tolist()
    signers: dict[str, Signer] = {
        "words that ship": STANDARD,
        "signer 201": draw_signer(201),
        "signer 202, folded": replace(draw_signer(202), rest="folded"),
        "signer 203, slow": replace(draw_signer(203), tempo=SLOW),
    }
    max_words = len(signs) // len(signers)
    if not LENGTH <= n_words <= max_words:
        raise InputError(f"{n_words} words of each signer, expected {LENGTH} to {max_words}")
    rows = [order[n * n_words : (n + 1) * n_words] for n in range(len(signers))]
    return {name: (signer, [signs[k] for k in row]) for (name, signer), row in zip(signers.items(), rows, strict=True)}


def make_lexicons(n_words: int) -> dict[str, list[IsolatedWord]]:
    """Returns the words of ``draw_words``, signed, and the words that ship as other dictionaries show and capture them:
    slowly with long last holds, and with noise. Raises as ``draw_words`` does.
    """
    words = {
        name: [planner.synthesize_word(sign, signer) for sign in signs]
        for name, (signer, signs) in draw_words(n_words).items()
    }
    shipped = words["words that ship"]
    for tempo, hold_s in SLOW_DICTIONARIES:
        slow = [planner.synthesize_word(word.sign, replace(STANDARD, tempo=tempo)) for word in shipped]
        words[f"slowed to {tempo:g}, held {hold_s:g} s"] = [hold_longer(word, hold_s) for word in slow]
    words[f"noise of {NOISE_RAD:g} rad"] = [add_noise(word, NOISE_RAD) for word in shipped]
    return words


def hold_longer(word: IsolatedWord, seconds: float) -> IsolatedWord:
    """Returns the word with its last posture held longer by ``seconds``."""
    clip, events, n_added = word.clip, word.events, round(seconds * word.clip.fps)
    frames = np.r_[: events.end + 1, [events.end] * n_added, events.end + 1 : len(clip)].astype(np.float64)
    events = replace(events, end=events.end + n_added, down=events.down + n_added)
    return replace(word, clip=replace(sample_clip(clip, frames), name=clip.name), events=events)


def add_noise(word: IsolatedWord, radians: float) -> IsolatedWord:
    """Returns the word with every joint turned by noise of this standard deviation an axis, smooth over 1/30 s."""
    clip = word.clip
    white_noise = stream("noise", clip.name).standard_normal((*clip.local_rotations.shape[:2], 3))
    turns = gaussian_filter1d(white_noise, clip.fps / 30.0, axis=0)
    rotations = rotation.multiply(clip.local_rotations, rotation.exp(turns * radians / turns.std()))
    return replace(word, clip=replace(clip, local_rotations=rotations))


def compare(
    words: dict[str, list[IsolatedWord]],
    tempos: Sequence[str | float] = (CITATION, NATURAL),
    bundle: str | Path | None = None,
    progress: Progress | None = None,
) -> list[Row]:
    """Returns one row for each lexicon and tempo; every word is measured once."""
    return [
        make_row(
            MEASURES,
            _measure_lexicon(lexicon, SpliceOptions(tempo=tempo, bundle=bundle)),
            words=name,
            tempo=str(tempo),
        )
        for (name, lexicon), tempo in track_progress([*product(words.items(), tempos)], progress)
    ]


def _measure_lexicon(words: Sequence[IsolatedWord], options: SpliceOptions) -> _MeasuredLexicon:
    """Measures every word in sentences of a lexicon's words."""
    signs: list[_SignMeasurement] = []
    seams: list[SeamScore] = []
    for sentence in _make_sentences(words):
        result = splice([word.clip for word in sentence], options)
        signs += list(_measure_signs(result, sentence))
        seams += result.seams
    return _MeasuredLexicon(signs, seams)


def _make_sentences(words: Sequence[IsolatedWord]) -> Iterator[list[IsolatedWord]]:
    """Yields sentences of ``LENGTH`` in which every word stands once between two others."""
    inner = LENGTH - 2
    for start in range(0, len(words), inner):
        inner_words = list(words[start : start + inner])
        yield [words[start - 1], *inner_words, words[(start + len(inner_words)) % len(words)]]


def _measure_signs(result: SpliceResult, words: Sequence[IsolatedWord]) -> Iterator[_SignMeasurement]:
    """Yields the measurement of each sign but the first and the last."""
    fps, wrists = result.clip.fps, wrist_positions(result.clip)
    touching = contact_frames(result.clip)
    for before, span in pairwise(result.spans):
        if span.kind != "sign" or span.source is None or span.clip is None or span.clip == len(words) - 1:
            continue
        word, played = words[span.clip], wrists[slice(*span.output)]
        recorded = wrist_positions(word.clip)[slice(*span.source)]
        peaks = [_peak_speed(path, fps) for path in (played, recorded)]
        jerks = [_relative_jerk(path) for path in (played, recorded)]
        yield _SignMeasurement(
            seconds=len(played) / fps,
            transition=(before.output[1] - before.output[0]) / fps if before.kind == "transition" else 0.0,
            peak=peaks[0],
            peak_ratio=peaks[0] / peaks[1] if peaks[1] > 0.0 else float("nan"),
            jerk_ratio=jerks[0] / jerks[1] if jerks[1] > 0.0 else float("nan"),
            whole=keeps_stroke(word, *span.source),
            repeats=_repeats_turns(span, word, wrists),
            passes=tuple(_shortened_passes(span, word, fps)),
            contacts=_count_contacts(span, word.clip, touching),
        )


def _shortened_passes(span: Span, word: IsolatedWord, fps: float) -> Iterator[float]:
    """Yields the duration, s, of each pass that is played faster than recorded."""
    for begin, end in word.events.passes:
        seconds = (output_frame(span, end) - output_frame(span, begin)) / fps
        if seconds < (end - begin) / fps - 1e-3:
            yield seconds


def _repeats_turns(span: Span, word: IsolatedWord, wrists: FloatArray) -> bool:
    """Whether the hands (T, W, 3) of a sentence turn back no less often than recorded in a sign's movements."""
    events = word.events
    if events.first is None or not events.passes:
        return True
    first, last = stroke(word)
    recorded = wrist_positions(word.clip)[first : last + 1]
    start, stop = int(np.floor(output_frame(span, first))), int(np.ceil(output_frame(span, last))) + 1
    for path, played in zip(recorded.swapaxes(0, 1), wrists[start:stop].swapaxes(0, 1), strict=True):
        axis = np.linalg.svd(path - path.mean(axis=0), full_matrices=False)[2][0]
        if _count_direction_changes(played, axis, _MIN_SEEN_TURN_M) < _count_direction_changes(path, axis, _MIN_TURN_M):
            return False
    return True


def _count_contacts(span: Span, clip: Clip, touching: Sequence[tuple[int, int]]) -> tuple[int, int]:
    """Returns the number of contacts recorded wholly within a span, and of those that the sentence shows in two frames
    or more.
    """
    start, stop = span.source or (0, 0)
    recorded = [(a, b) for a, b in contact_frames(clip) if start <= a and b <= stop]
    is_shown = [
        any(max(first, output_frame(span, a) - 1) < min(end, output_frame(span, b - 1) + 2) for first, end in touching)
        for a, b in recorded
    ]
    return len(recorded), sum(is_shown)


def _peak_speed(wrists: FloatArray, fps: float) -> float:
    return float(np.linalg.norm(np.diff(wrists, axis=0), axis=-1).max(initial=0.0) * fps)


def _relative_jerk(wrists: FloatArray) -> float:
    """Returns the root mean square jerk of the wrist (T, W, 3) that goes farther, over its path's length, in durations;
    NaN if it stands still.
    """
    lengths = np.linalg.norm(np.diff(wrists, axis=0), axis=-1).sum(axis=0)
    hand = int(np.argmax(lengths))
    if len(wrists) < 5 or lengths[hand] < _MIN_PATH_M:
        return float("nan")
    jerk = np.diff(wrists[:, hand], n=3, axis=0)
    return float(np.sqrt((jerk**2).sum(axis=-1).mean()) * (len(wrists) - 1) ** 3 / lengths[hand])


def _count_direction_changes(path: FloatArray, axis: FloatArray, minimum_m: float) -> int:
    """Returns how often a wrist (T, 3) turns back along the main axis of its recorded path, by more than ``minimum_m``,
    m.
    """
    coordinates = path @ axis
    turns, direction, extreme = 0, 0.0, coordinates[0]
    for value in coordinates.tolist():
        if direction == 0.0 and abs(value - extreme) > minimum_m:
            direction, extreme = np.sign(value - extreme), value
        elif direction != 0.0 and (value - extreme) * direction >= 0.0:
            extreme = value
        elif direction != 0.0 and abs(value - extreme) > minimum_m:
            turns, direction, extreme = turns + 1, -direction, value
    return turns


def signature(n_words: int) -> str:
    """Returns the recipe of the numbers."""
    return (
        f"tempo|words:everyday,{n_words},drawn:once|signs:inner-of-{LENGTH}|running:{RUNNING_S:g}s"
        f"|jerk:third-difference,rms,duration^3/path|turns:{1e3 * _MIN_TURN_M:g}mm"
        f"|slow:{','.join(f'{tempo:g}+{hold_s:g}s' for tempo, hold_s in SLOW_DICTIONARIES)}|noise:{NOISE_RAD:g}rad"
    )


def table(rows: Sequence[Row], n_words: int) -> list[str]:
    """Returns the rows as Markdown, with their signature."""
    return [f"`{signature(n_words)}`", "", *format_measures(_SHOWN, rows)]
