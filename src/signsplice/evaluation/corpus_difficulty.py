"""Not trivial: how often cutters and simple rules find the true positions, how exactly a reader who knows the rules has
to see, and how near classical transitions come.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from signsplice.motion.clip import Clip
from signsplice.rig import metrics
from signsplice.rig.arms import active_span, arms
from signsplice.splicing.cut import CUTTERS
from signsplice.splicing.transition import TRANSITIONS
from signsplice.synth import planner, pose, truth
from signsplice.synth.corpus import Pairs
from signsplice.synth.phonology import Sign
from signsplice.synth.planner import Events
from signsplice.synth.rng import stream

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class RuleAccuracy:
    """How often a rule is right, shares of pairs: both positions exact, leaving exact, entering exact, both within two
    frames; and its mean distance in frames.
    """

    rule: str
    exact: float
    leave: float
    enter: float
    near: float
    distance: float


def cutters(
    pairs: Pairs, numbers: Sequence[int], train: Sequence[int], progress: Progress | None = None
) -> list[RuleAccuracy]:
    """Every classical cutter, and rules that are told what no cutter knows: a word's events.

    The last of them are the best constant of each kind that the pairs ``train`` allow: the commonest distance from the
    end of the last movement and from the start of the first, and the commonest share of them.
    """
    n_words = len(pairs.head["words"])
    clips: dict[int, Clip] = {}
    events = [pairs.events(k) for k in range(n_words)]
    true = pairs.index[list(numbers), :4].tolist()
    for p, q, _, _ in true:
        for k in (p, q):
            if k not in clips:
                clips[k] = pairs.word_clip(k)
    rows = []
    for done, cutter in enumerate(CUTTERS.values()):
        cuts = [cutter.cut(clips[p], clips[q]) for p, q, _, _ in true]
        rows.append(_found(cutter.name, [(cut.pre, cut.post) for cut in cuts], true))
        if progress is not None:
            progress(done + 1, len(CUTTERS))
    spans = {k: active_span(arms(clip)) for k, clip in clips.items()}
    rules: dict[str, Callable[[int, int], tuple[int, int]]] = {
        "trim the rest (arms at 40 % of their rise)": lambda p, q: (spans[p][1] - 1, spans[q][0]),
        "told: leave as the sign ends, enter as it starts": lambda p, q: (events[p].end, events[q].start),
        "told: leave as the last movement ends, enter as the first begins": lambda p, q: (
            _last(events[p])[1],
            _first(events[q])[0],
        ),
    }
    past = pairs.index[list(train), :4].tolist()
    off = Counter(pre - _last(events[p])[1] for p, _, pre, _ in past).most_common(1)[0][0]
    on = Counter(post - _first(events[q])[0] for _, q, _, post in past).most_common(1)[0][0]
    rules[f"told: {off:+d} frames from there, {on:+d} frames from there (best constants)"] = lambda p, q: (
        _last(events[p])[1] + off,
        _first(events[q])[0] + on,
    )
    by_word: dict[tuple[str, int], Counter[int]] = {}
    for p, q, pre, post in past:
        by_word.setdefault(("leave", p), Counter())[pre] += 1
        by_word.setdefault(("enter", q), Counter())[post] += 1
    if all(("leave", p) in by_word and ("enter", q) in by_word for p, q, _, _ in true):
        rules["told: the commonest positions of each very word"] = lambda p, q: (
            by_word["leave", p].most_common(1)[0][0],
            by_word["enter", q].most_common(1)[0][0],
        )
    rows += [_found(name, [rule(p, q) for p, q, _, _ in true], true) for name, rule in rules.items()]
    return rows


def _last(events: Events) -> tuple[int, int]:
    return events.passes[-1] if events.passes else (events.start, events.end)


def _first(events: Events) -> tuple[int, int]:
    return events.first or (events.start, events.end)


def _found(rule: str, cuts: Sequence[tuple[int, int]], true: Sequence[Sequence[int]]) -> RuleAccuracy:
    away = np.array([(abs(pre - t[2]), abs(post - t[3])) for (pre, post), t in zip(cuts, true, strict=True)])
    return RuleAccuracy(
        rule,
        exact=float((away == 0).all(axis=1).mean()),
        leave=float((away[:, 0] == 0).mean()),
        enter=float((away[:, 1] == 0).mean()),
        near=float((away <= 2).all(axis=1).mean()),
        distance=float(away.mean()),
    )


READING_ERRORS_CM = (0.05, 0.1, 0.25, 0.5, 1.0, 2.0)
RAD_PER_CM = 0.02
"""Error of every finger angle that goes with one of the wrist."""


def reading(
    pairs: Pairs, numbers: Sequence[int], signs: Mapping[str, Sign], errors: Sequence[float] = READING_ERRORS_CM
) -> dict[float, float]:
    """How exactly positions must be read: the error (cm, spread of each coordinate of the wrist in every frame; the
    fingers' angles with it) -> share of pairs whose two positions a reader who knows the rules and all events gets
    right.

    The rules have thresholds, and a pair that lies near one falls to either side. Pairs of words that ``signs`` has not
    are passed.
    """
    words = _signed(pairs, numbers, signs)
    rows = [row for row in pairs.index[list(numbers), :4].tolist() if {row[0], row[1]} <= words.keys()]
    out = {}
    for error in errors:
        right = 0
        for n, (p, q, pre, post) in enumerate(rows):
            rng = stream("reading", round(1e4 * error), n)
            before, after = _misread(words[p], error, rng), _misread(words[q], error, rng)
            seen = truth.relation(before, after)
            right += (truth.leave(words[p], seen), truth.enter(words[q], seen)) == (pre, post)
        out[error] = right / max(1, len(rows))
    return out


def _signed(pairs: Pairs, numbers: Sequence[int], signs: Mapping[str, Sign]) -> dict[int, planner.IsolatedWord]:
    """The words of some pairs, planned anew from their signs."""
    half = len(pairs.head["words"]) // 2
    used = sorted(set(pairs.index[list(numbers), :2].ravel().tolist()))
    glosses = {k: pairs.head["words"][k]["gloss"] for k in used}
    return {
        k: planner.isolated(signs[gloss], pairs.signers[k // half], fps=pairs.head["fps"])
        for k, gloss in glosses.items()
        if gloss in signs
    }


def _misread(word: planner.IsolatedWord, error: float, rng: np.random.Generator) -> planner.IsolatedWord:
    states = word.states.copy()
    states[:, pose.WRIST] += rng.normal(0.0, error, states[:, pose.WRIST].shape)
    states[:, pose.FINGERS] += rng.normal(0.0, RAD_PER_CM * error, states[:, pose.FINGERS].shape)
    return replace(word, states=states)


@dataclass(frozen=True)
class TransitionScores:
    """How near a transition comes at true positions and length: position error (arm / 1000), motion ratio of the
    fingertips, velocity jump at the seams (m/s, median).
    """

    transition: str
    position_error: float
    motion_ratio: float
    velocity_jump: float


def transitions(
    pairs: Pairs, numbers: Sequence[int], progress: Progress | None = None
) -> tuple[list[TransitionScores], float]:
    """Every classical transition at the true positions, and the true velocity jump (m/s, median)."""
    rows = []
    true_jumps: list[float] = []
    for done, transition in enumerate(TRANSITIONS.values()):
        scores = []
        for number in numbers:
            pre, post, _ = pairs.truth(number, "roots")
            p, q = pairs.index[number, :2].tolist()
            count = int(pairs.index[number, 5])
            true = pairs.clip(number)
            made = transition.between(pairs.word_clip(p)[: pre + 1], pairs.word_clip(q)[post:], count)
            part = true[pre + 1 : pre + 1 + count]
            scores.append(
                (metrics.position_error(made, part), metrics.motion_ratio(made, part), _jump(true, made, pre, count))
            )
            if done == 0:
                true_jumps.append(_jump(true, part, pre, count))
        error, ratio = np.nanmean(scores, axis=0)[:2]
        rows.append(
            TransitionScores(transition.name, float(error), float(ratio), float(np.median([s[2] for s in scores])))
        )
        if progress is not None:
            progress(done + 1, len(TRANSITIONS))
    return rows, float(np.median(true_jumps))


def _jump(true: Clip, made: Clip, pre: int, count: int) -> float:
    """Largest velocity jump (m/s) of the right wrist at the seams of a transition put in place of the true one."""
    from signsplice.evaluation.corpus_realism import wrists

    first, stop = max(pre - 2, 0), pre + 1 + count
    places = np.concatenate([wrists(true[first : pre + 1])[0], wrists(made)[0], wrists(true[stop : stop + 3])[0]])
    start = pre + 1 - first
    return metrics.velocity_jump(places[:, None] / 100.0, start, start + count, true.fps)
