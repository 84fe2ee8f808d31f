"""splicing.cut: the rules compared with a plain search, and what holds for every rule."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from conftest import random_clip

from signsplice.errors import InputError
from signsplice.motion import Clip, rotation
from signsplice.rig.info import active_span, arms
from signsplice.splicing.methods import find
from signsplice.splicing.methods.cut import CUTTERS, VELOCITY_TIME_S

NAMES = list(CUTTERS)


@pytest.mark.parametrize("name", NAMES)
def test_cuts_lie_in_their_clips_and_keep_some_of_every_word(name: str, words: dict[str, Clip]) -> None:
    for a in words.values():
        for b in words.values():
            cut = CUTTERS[name].cut(a, b)
            assert 0 <= cut.post < len(b)
            assert 0 <= cut.pre < len(a)
            assert cut.pre > CUTTERS[name].cut(b, a).post, "a word is left after it is entered"


@pytest.mark.parametrize("name", ["rest-trim", "hand-distance", "pose-velocity"])
def test_arms_do_not_hang_at_either_side_of_a_cut(name: str, words: dict[str, Clip]) -> None:
    for a in words.values():
        for b in words.values():
            cut = CUTTERS[name].cut(a, b)
            for clip, frame in ((a, cut.pre), (b, cut.post)):
                lift = arms(clip).lift.max(axis=1)
                assert lift[frame] > lift[0] + 0.3 * (lift.max() - lift[0])


def plain_search(before: Clip, after: Clip, name: str) -> tuple[int, int]:
    """The frames with the lowest cost, one pair at a time, from the definitions in the docstrings."""
    p, q = arms(before), arms(after)
    (p0, p1), (q0, q1) = active_span(p), active_span(q)
    rows = max(1, int(min(0.3 * before.fps, 0.3 * (p1 - p0))))
    columns = max(1, int(min(0.3 * after.fps, 0.3 * (q1 - q0))))
    lowest, found = np.inf, (0, 0)
    for i in range(p1 - rows, p1):
        for j in range(q0, q0 + columns):
            cost = 0.0
            for hand in range(2):
                if name == "hand-distance":
                    cost += float(np.linalg.norm(p.wrists[i, hand] - q.wrists[j, hand])) / p.shoulder_width
                    change = p.hand_rotations[i, hand].T @ q.hand_rotations[j, hand]
                    cost += float(np.linalg.norm(rotation.log(rotation.from_matrix(change)))) / np.pi
                else:
                    for points in ("elbows", "wrists"):
                        a, b = getattr(p, points)[:, hand], getattr(q, points)[:, hand]
                        va = np.gradient(a, axis=0)[i] * p.fps * VELOCITY_TIME_S
                        vb = np.gradient(b, axis=0)[j] * q.fps * VELOCITY_TIME_S
                        cost += float(np.sum((a[i] - b[j]) ** 2) / p.length**2 + np.sum((va - vb) ** 2) / p.length**2)
            if cost < lowest - 1e-12:
                lowest, found = cost, (i, j)
    return found


@pytest.mark.parametrize("name", ["hand-distance", "pose-velocity"])
@pytest.mark.parametrize(("a", "b"), [("HELLO", "SIGN"), ("SIGN", "I"), ("DEAF", "THANK-YOU")])
def test_rules_find_what_a_plain_search_finds(name: str, a: str, b: str, words: dict[str, Clip]) -> None:
    cut = CUTTERS[name].cut(words[a], words[b])
    assert (cut.pre, cut.post) == plain_search(words[a], words[b], name)


def test_the_rule_ends_keeps_every_frame() -> None:
    a, b = random_clip(0), random_clip(0, n_frames=7)
    cut = CUTTERS["ends"].cut(a, b)
    assert (cut.pre, cut.post) == (19, 0)


def test_the_active_span_without_rest_is_the_whole_clip(words: dict[str, Clip]) -> None:
    start, stop = active_span(arms(words["SIGN"]))
    assert 0 < start < stop < len(words["SIGN"])
    inner = words["SIGN"][start + 4 : stop - 4]
    assert active_span(arms(inner)) == (0, len(inner))
    still = words["SIGN"][:8]
    assert active_span(arms(still)) == (0, 8)


def test_the_active_span_ignores_units_and_reverses_with_time(words: dict[str, Clip]) -> None:
    clip = words["HELLO"]
    start, stop = active_span(arms(clip))
    in_metres = replace(
        clip,
        skeleton=replace(clip.skeleton, offsets=clip.skeleton.offsets * 0.01),
        root_positions=clip.root_positions * 0.01,
    )
    assert active_span(arms(in_metres)) == (start, stop)
    backwards = replace(clip, local_rotations=clip.local_rotations[::-1])
    assert active_span(arms(backwards)) == (len(clip) - stop, len(clip) - start)


def test_unknown_arms_and_cutters_are_refused(words: dict[str, Clip]) -> None:
    with pytest.raises(InputError, match="no leftUpperArm or leftLowerArm found among joints joint0"):
        CUTTERS["rest-trim"].cut(random_clip(0), random_clip(1))
    with pytest.raises(InputError, match="no cutter 'x', expected one of ends, rest-trim"):
        find("cutter", "x", CUTTERS)
