"""Measures the difficulty of a corpus: how often cutters and simple rules find the true cuts, how precisely a reader
who knows the rules has to measure, and how near classical transitions come to the true ones.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from signsplice.motion import Clip, FloatArray
from signsplice.rig import metrics
from signsplice.rig.info import active_span, arms
from signsplice.signer import planner, pose
from signsplice.signer.phonology import Sign
from signsplice.signer.signer import stream
from signsplice.signer.timing import Events
from signsplice.splicing.contracts import Gap
from signsplice.splicing.curves import TRANSITIONS
from signsplice.splicing.cutters import CUTTERS
from signsplice_workshop.corpora import truth
from signsplice_workshop.corpora.pairs import Pairs
from signsplice_workshop.corpora.touches import measure_touches, with_touches
from signsplice_workshop.measure import corpus_checks, motion_scores
from signsplice_workshop.measure.hands import strong_side, strong_wrist
from signsplice_workshop.measure.measures import Measure, Progress, Row, make_row, track_progress

BY_WORD = "words known: the most frequent cut of each word"
Rule = Callable[[int, int], tuple[int, int]]
"""Maps (word before, word after) to (last frame of the first that is used, first frame of the second that is used)."""


CUT_MEASURES = (
    Measure("rule", "rule"),
    Measure("exact", "both exact", "{:.1f}", 100.0, lambda distances: float((distances == 0).all(axis=1).mean())),
    Measure("leave", "leave exact", "{:.1f}", 100.0, lambda distances: float((distances[:, 0] == 0).mean())),
    Measure("enter", "enter exact", "{:.1f}", 100.0, lambda distances: float((distances[:, 1] == 0).mean())),
    Measure("near", "both within 2", "{:.1f}", 100.0, lambda distances: float((distances <= 2).all(axis=1).mean())),
    Measure("distance", "mean distance, frames", "{:.2f}", None, lambda distances: float(distances.mean())),
)
"""Measures of a cutter or rule, from distances (N, 2) of the frames left and entered from the true ones: fractions of
the pairs whose frames are exact or within two, and the mean distance, frames.
"""


def score_cutters(
    pairs: Pairs, numbers: Sequence[int], train: Sequence[int], progress: Progress | None = None
) -> list[Row]:
    """Returns the accuracy of every classical cutter, and of simple rules.

    The rules use the events of both words, which no cutter knows. Two of them are fitted to the pairs ``train``: the
    most frequent offset from the end of the last movement and from the start of the first, and the most frequent cut of
    each word.
    """
    true = pairs.index[list(numbers), :4].tolist()
    clips = {k: pairs.word_clip(k) for k in dict.fromkeys(k for p, q, _, _ in true for k in (p, q))}
    rows = []
    for cutter in track_progress(CUTTERS.values(), progress):
        cuts = [cutter.cut(clips[p], clips[q]) for p, q, _, _ in true]
        rows.append(_score_cuts(cutter.name, [(cut.pre, cut.post) for cut in cuts], true))
    rules = _make_rules(pairs, clips) | _fit_rules(pairs, train, true)
    return rows + [_score_cuts(name, [rule(p, q) for p, q, _, _ in true], true) for name, rule in rules.items()]


def _make_rules(pairs: Pairs, clips: Mapping[int, Clip]) -> dict[str, Rule]:
    """Returns the rules that have nothing to fit."""
    spans = {k: active_span(arms(clip)) for k, clip in clips.items()}
    events = {k: pairs.events(k) for k in clips}
    return {
        "trim the rest (arms at 40 % of their rise)": lambda p, q: (spans[p][1] - 1, spans[q][0]),
        "events known: leave at the end of the sign, enter at its start": lambda p, q: (events[p].end, events[q].start),
        "events known: leave at the end of the last movement, enter at the start of the first": lambda p, q: (
            _last_movement(events[p])[1],
            _first_movement(events[q])[0],
        ),
    }


def _fit_rules(pairs: Pairs, train: Sequence[int], true: Sequence[Sequence[int]]) -> dict[str, Rule]:
    """Returns the rules of the best constant offsets and, if every word of ``true`` occurs in ``train``, of the best
    cut of each word.
    """
    events = [pairs.events(k) for k in range(len(pairs.head["words"]))]
    train_cuts = pairs.index[list(train), :4].tolist()
    leave = Counter(pre - _last_movement(events[p])[1] for p, _, pre, _ in train_cuts).most_common(1)[0][0]
    enter = Counter(post - _first_movement(events[q])[0] for _, q, _, post in train_cuts).most_common(1)[0][0]
    rules: dict[str, Rule] = {
        f"events known: {leave:+d} and {enter:+d} frames from there (best constants)": lambda p, q: (
            _last_movement(events[p])[1] + leave,
            _first_movement(events[q])[0] + enter,
        )
    }
    leaves: dict[int, Counter[int]] = {}
    enters: dict[int, Counter[int]] = {}
    for p, q, pre, post in train_cuts:
        leaves.setdefault(p, Counter())[pre] += 1
        enters.setdefault(q, Counter())[post] += 1
    if all(p in leaves and q in enters for p, q, _, _ in true):
        rules[BY_WORD] = lambda p, q: (
            leaves[p].most_common(1)[0][0],
            enters[q].most_common(1)[0][0],
        )
    return rules


def _last_movement(events: Events) -> tuple[int, int]:
    return events.passes[-1] if events.passes else (events.start, events.end)


def _first_movement(events: Events) -> tuple[int, int]:
    return events.first or (events.start, events.end)


def _score_cuts(rule: str, cuts: Sequence[tuple[int, int]], true: Sequence[Sequence[int]]) -> Row:
    """Returns the accuracy of cuts against rows (word before, word after, pre, post)."""
    distances = np.array([(abs(pre - row[2]), abs(post - row[3])) for (pre, post), row in zip(cuts, true, strict=True)])
    return make_row(CUT_MEASURES, distances, rule=rule)


READING_ERRORS_CM = (0.05, 0.1, 0.2, 0.5, 1.0, 2.0)
RAD_PER_CM = 0.02
"""Error of every finger angle for each cm of error of the wrist, radians."""


@dataclass(frozen=True)
class ReadingAccuracy:
    """How often a reader with an error finds the cut.

    error_cm: standard deviation of the reader's measurements, cm.
    exact: fraction with both frames exact.
    near: fraction with both within one frame.
    """

    error_cm: float
    exact: float
    near: float


def score_reading(
    pairs: Pairs, numbers: Sequence[int], signs: Mapping[str, Sign], errors: Sequence[float] = READING_ERRORS_CM
) -> list[ReadingAccuracy]:
    """Measures how often a reader finds the cut who knows the rules and the frames of all events, but measures with an
    error.

    errors: standard deviation of each coordinate of the wrist in every frame, and of the skin distances at the events,
    cm; finger angles have the error that goes with it. Shares are rounded to frames, and an error moves pairs near a
    half to the other side. Pairs with a word that ``signs`` lacks are left out. Raises ``InputError`` for a corpus of
    version 1, whose rules are gone.
    """
    words = _plan_words(pairs, numbers, signs)
    rows = [row for row in pairs.index[list(numbers), :4].tolist() if {row[0], row[1]} <= words.keys()]
    accuracies = []
    for error in errors:
        distances = []
        for n, (p, q, pre, post) in enumerate(rows):
            rng = stream("reading", round(1e4 * error), n)
            noisy_words = _add_noise(words[p], error, rng), _add_noise(words[q], error, rng)
            cut = truth.find_cut(*noisy_words, partner=pairs.by_partner)
            distances.append(max(abs(cut[0] - pre), abs(cut[1] - post)))
        frame_errors = np.array(distances or [np.inf])
        accuracies.append(ReadingAccuracy(error, float((frame_errors == 0).mean()), float((frame_errors <= 1).mean())))
    return accuracies


def _plan_words(pairs: Pairs, numbers: Sequence[int], signs: Mapping[str, Sign]) -> dict[int, planner.IsolatedWord]:
    """Returns the words of these pairs, planned anew from their signs."""
    corpus_checks.check_version(pairs)
    n_per_signer = len(pairs.head["words"]) // 2
    used = sorted(set(pairs.index[list(numbers), :2].ravel().tolist()))
    glosses = {k: pairs.head["words"][k]["gloss"] for k in used}
    return {
        k: with_touches(planner.synthesize_word(signs[gloss], pairs.signers[k // n_per_signer], fps=pairs.head["fps"]))
        for k, gloss in glosses.items()
        if gloss in signs
    }


def _add_noise(word: planner.IsolatedWord, error: float, rng: np.random.Generator) -> planner.IsolatedWord:
    events, states = measure_touches(word), word.states.copy()
    states[:, pose.WRIST] += rng.normal(0.0, error, states[:, pose.WRIST].shape)
    states[:, pose.FINGERS] += rng.normal(0.0, RAD_PER_CM * error, states[:, pose.FINGERS].shape)
    gaps = [
        None if gap is None else gap + float(rng.normal(0.0, error))
        for gap in (events.gap_first_cm, events.gap_last_cm)
    ]
    return replace(word, states=states, events=replace(events, gap_first_cm=gaps[0], gap_last_cm=gaps[1]))


def _mean_of(column: int) -> Callable[[FloatArray], float]:
    return lambda scores: float(np.nanmean(scores, axis=0)[column])


TRANSITION_MEASURES = (
    Measure("transition", "transition"),
    Measure("position_error", "position error, arm / 1000", "{:.1f}", None, _mean_of(0)),
    Measure("motion_ratio", "motion ratio", "{:.2f}", None, _mean_of(1)),
    Measure("velocity_jump", "velocity jump, m/s", "{:.2f}", None, lambda scores: float(np.median(scores[:, 2]))),
)
"""Measures of a transition at the true cuts and lengths, from scores (N, 3): mean joint position error, mean path of
the fingertips over that of the true transition, and median of the largest velocity jump at a seam.
"""


def score_transitions(
    pairs: Pairs, numbers: Sequence[int], progress: Progress | None = None
) -> tuple[list[Row], float]:
    """Returns the scores of every classical transition at the true cuts, and the true median velocity jump, m/s."""
    rows: list[Row] = []
    true_jumps: list[float] = []
    for transition in track_progress(TRANSITIONS.values(), progress):
        scores = []
        for number in numbers:
            pre, post, _ = pairs.truth(number, "roots")
            p, q = pairs.index[number, :2].tolist()
            count = int(pairs.index[number, 5])
            true, strong = pairs.clip(number), strong_side(pairs, p)
            generated = transition.between(Gap(pairs.word_clip(p)[: pre + 1], pairs.word_clip(q)[post:], count))
            true_frames = true[pre + 1 : pre + 1 + count]
            jump = _velocity_jump(true, generated, pre, count, strong)
            scores.append(
                (
                    motion_scores.position_error(generated, true_frames),
                    motion_scores.motion_ratio(generated, true_frames),
                    jump,
                )
            )
            if not rows:
                true_jumps.append(_velocity_jump(true, true_frames, pre, count, strong))
        rows.append(make_row(TRANSITION_MEASURES, np.array(scores), transition=transition.name))
    return rows, float(np.median(true_jumps))


def _velocity_jump(true: Clip, generated: Clip, pre: int, count: int, strong: str) -> float:
    """Returns the largest velocity jump (m/s) of the strong wrist at the seams of a transition put in place of the true
    one.
    """
    first, stop = max(pre - 2, 0), pre + 1 + count
    wrist = np.concatenate(
        [strong_wrist(clip, strong) for clip in (true[first : pre + 1], generated, true[stop : stop + 3])]
    )  # (T, 3)
    start = pre + 1 - first
    return metrics.velocity_jump(wrist[:, None], start, start + count, true.fps)
