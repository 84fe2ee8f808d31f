"""signer.checks and keep=touch: what a body does not allow is said, and hands that are to stay in touch do."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from signing import made, sign
from signsplice.errors import FormatError
from signsplice.signer import checks, notation, planner
from signsplice.signer.collisions import hand_clearances
from signsplice.signer.planner import IsolatedWord
from signsplice.signer.signer import PLAIN, STANDARD, Signer, draw_signer

CHEST = "X  shape=B-open at=chest palm=back fingers=in"


@pytest.mark.parametrize(
    ("lines", "hands", "line"),
    [
        (
            ("X  shape=index at=space-far palm=down fingers=fwd", "M  shift=0,20,40"),
            "one",
            r"WORD: at=space-far is out of reach in segment 2 \(M\): the strong hand stays 1\d\.\d cm away, "
            r"its arm is too short",
        ),
        (
            ("H  shape=B-open at=shoulder by=heel palm=back fingers=up",),
            "one",
            r"WORD: at=shoulder is out of reach in segment 1 \(H\): .* its arm bends no farther",
        ),
        (
            (CHEST, "M  palm=fwd fingers=down"),
            "one",
            r"WORD: the strong wrist is contorted in segment 2 \(M\): it bends by [78]\d degrees, expected at most 75",
        ),
        (
            ("H  shape=B-open at=cheek by=fingertips shift=0,-8,0 palm=back fingers=up-in",),
            "one",
            r"WORD: by=fingertips misses at=cheek by \d\.\d cm in segment 1 \(H\), where it is written to touch",
        ),
        (
            (
                "H  shape=B-open at=base-palm by=palm palm=down fingers=in-fwd "
                "w.shape=B-open w.at=space-far w.shift=0,0,40 w.palm=up w.fingers=fwd",
            ),
            "base",
            r"WORD: at=space-far is out of reach in segment 1 \(H\): the weak hand stays",
        ),
    ],
)
def test_what_a_body_cannot_do_is_one_line_with_the_gloss(lines: tuple[str, ...], hands: str, line: str) -> None:
    found = checks.warnings(made(*lines, hands=hands))
    assert sum(re.match(line, one) is not None for one in found) == 1, found
    kinds = [("reach" in one, "contorted" in one, "misses" in one) for one in found]
    assert len(kinds) == len(set(kinds)), "one line for each kind"


@pytest.mark.parametrize("gloss", ["MOTHER", "GIVE", "FRIEND", "fs-A"])
@pytest.mark.parametrize("seed", [None, 3])
def test_signs_that_a_body_can_do_have_no_warning(gloss: str, seed: int | None) -> None:
    signer = STANDARD if seed is None else draw_signer(seed)
    assert checks.warnings(planner.synthesize_word(sign(gloss), signer)) == []


def test_a_left_handed_signer_is_warned_of_the_same() -> None:
    text = "W  hands=one\n  X  shape=index at=space-far palm=down fingers=fwd\n  M  shift=0,20,40\n"
    words = [
        planner.synthesize_word(notation.parse(text)["W"], replace(STANDARD, left_handed=left))
        for left in (False, True)
    ]
    right, left = map(checks.warnings, words)
    assert right == left != []


def test_segments_are_found_in_the_frames_of_the_word() -> None:
    word = made(CHEST, "M  at=belly times=2", "H")
    first, movement, hold = word.segments
    assert (first.begin, hold.end) == (word.events.start, word.events.end)
    assert movement.passes == word.events.passes
    assert movement.end == hold.begin


# --- keep=touch

SLIDES = {
    "down the cheek": (
        "one",
        "X  shape=index at=cheek by=index shift=0,3,0 palm=in-down fingers=up-back",
        "shift=0,-4,0",
    ),
    "along the forehead": (
        "one",
        "X  shape=index at=forehead by=index-side shift=-4,0,0 palm=down-back fingers=in",
        "shift=5,0,0",
    ),
    "round on the chest": ("one", CHEST, "path=circle:frontal:5:2"),
    "up the weak forearm": (
        "base",
        "X  shape=index at=base-wrist by=index palm=down fingers=in-down-fwd "
        "w.shape=B-open w.at=space-mid w.shift=6,0,8 w.palm=down w.fingers=fwd",
        "at=forearm-weak",
    ),
}


def clearances(hands: str, first: str, movement: str, signer: Signer = STANDARD) -> np.ndarray:
    """Distance of the strong hand's skin from the other skin in each frame of the movement, cm."""
    text = f"W  hands={hands}\n  {first}\n  M  {movement}\n"
    word = planner.synthesize_word(notation.parse(text)["W"], signer)
    one = word.segments[1]
    states = word.states[one.begin : one.end + 1]
    return np.asarray(hand_clearances(states, STANDARD)[:, 0 if hands == "one" else 2])


@pytest.mark.parametrize("slide", SLIDES)
def test_a_hand_that_keeps_in_touch_stays_on_the_skin(slide: str) -> None:
    hands, first, movement = SLIDES[slide]
    plain, kept = (clearances(hands, first, movement + more) for more in ("", " keep=touch"))
    assert np.abs(kept).mean() < 0.6 * np.abs(plain).mean()
    assert np.median(np.abs(kept)) < 0.25


def test_hands_that_alternate_and_touch_stay_together() -> None:
    first = "X  shape=B-open at=space-mid by=palm palm=in fingers=fwd"
    signer = replace(STANDARD, manner=PLAIN)  # else hands that mirror one another differ in time
    plain, kept = (
        clearances("alternating", first, f"path=zigzag:fwd:4:3{more}", signer) for more in ("", " keep=touch")
    )
    assert plain.max() > 1.2
    assert kept.max() < 0.5 * plain.max()
    assert np.abs(kept).mean() < 0.5 * np.abs(plain).mean(), "each is kept out of the other's forearm"


@pytest.mark.parametrize("first", ["X  shape=B-open at=space palm=back fingers=in", CHEST + " off=4"])
def test_only_a_touch_can_be_kept(first: str) -> None:
    with pytest.raises(FormatError, match=r"segment 2: keep=touch needs touches at both ends, at=\S+ is none"):
        made(first, "M  shift=0,-5,0 keep=touch")
    with pytest.raises(FormatError, match="unknown keep 'skin'; expected one of touch"):
        made(CHEST, "M  at=belly keep=skin")
    with pytest.raises(FormatError, match="keep= belongs to M, not to X"):
        made(CHEST + " keep=touch")


# --- neutral space


def height(word: IsolatedWord) -> float:
    return float(word.states[word.events.start, 1])


def test_two_hands_are_lower_in_neutral_space_than_one() -> None:
    for place, lower in (("space", 6.0), ("space-mid", 6.0), ("space-high", 0.0), ("face-space", 0.0)):
        line = f"H  shape=B-open at={place} palm=in-back fingers=up-fwd"
        one, two = made(line), made(line, hands="symmetric")
        assert height(one) - height(two) == pytest.approx(lower, abs=1.5), place


def test_a_fist_on_the_other_in_neutral_space_is_before_the_chest() -> None:
    """COFFEE, written as simply as can be: the upper fist was at the throat."""
    word = made(
        "H  shape=S at=base-radial by=ulnar palm=back-in fingers=fwd-in "
        "w.shape=S w.at=space-mid w.palm=back-in w.fingers=fwd-in",
        hands="base",
    )
    strong, weak = word.states[word.events.start, 1], word.states[word.events.start, 28]
    assert -18.0 < weak < strong < 9.0, "from the belly to the breast bone, cm from the chest joint"
