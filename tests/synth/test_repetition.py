"""Repeated movements: one way with a lifted return, side by side, faster; and paths of a base hand."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from signing import made
from signsplice.motion import FloatArray
from signsplice.signer import pose
from signsplice.signer.collisions import penetration
from signsplice.signer.planner import IsolatedWord
from signsplice.signer.signer import STANDARD

CHEST = "X shape=B-open at=chest by=palm off=0.5 shift=0,3,0 palm=back fingers=in"
PALM = (
    "X shape=B-open at=base-palm by=palm off=0.9 shift=-3,0,-3 palm=down fingers=in-fwd "
    "w.shape=B-open w.at=space-mid w.shift=0,-7,2 w.palm=up w.fingers=fwd-in"
)


def strong(one: IsolatedWord) -> FloatArray:
    """The strong wrist (T, 3): X to the weak side, Y up, Z forward, cm."""
    return one.states[:, pose.WRIST]


def weak(one: IsolatedWord) -> FloatArray:
    """The weak wrist (T, 3), mirrored."""
    return one.states[:, 27:30]


@pytest.mark.parametrize("cm", [3.0, 5.0])
def test_a_lifted_return_leaves_the_chest_and_the_next_pass_touches_again(cm: float) -> None:
    one = made(CHEST, f"M shift=0,-9,0 times=3 return=lifted:{cm:g}")
    passes, forward = one.events.passes, strong(one)[:, 2]
    assert len(passes) == 3
    for begin, stop in passes:
        assert strong(one)[begin, 1] - strong(one)[stop, 1] > 7.0, "every pass goes down"
        assert np.ptp(forward[begin : stop + 1]) < 1.0, "along the chest"
    for (_, stop), (begin, _) in itertools.pairwise(passes):
        back = forward[stop : begin + 1]
        assert back.max() - back[[0, -1]].max() == pytest.approx(cm, abs=0.8)
    assert penetration(one.states, STANDARD)[0].max() < 0.25


def test_a_return_through_the_same_path_stays_at_the_chest() -> None:
    one = made(CHEST, "M shift=0,-9,0 times=3")
    assert np.ptp(strong(one)[one.events.start : one.events.end + 1, 2]) < 1.0


def test_a_lifted_return_at_the_base_hand_leaves_the_palm() -> None:
    one = made(PALM, "M shift=8,0,8 times=2 return=lifted", hands="base")
    (_, stop), (begin, _) = one.events.passes
    height = strong(one)[:, 1] - weak(one)[:, 1]
    back = height[stop : begin + 1]
    assert back.max() - back[[0, -1]].max() == pytest.approx(3.0, abs=0.8)
    assert height[begin] == pytest.approx(height[one.events.passes[0][0]], abs=0.4)


def test_both_hands_of_a_symmetric_sign_are_lifted() -> None:
    one = made("X shape=B at=space palm=down fingers=fwd", "M shift=0,0,8 times=2 return=lifted", hands="symmetric")
    (_, stop), (begin, _) = one.events.passes
    for wrist in (strong(one), weak(one)):
        assert wrist[stop : begin + 1, 1].max() - wrist[stop, 1] > 1.5


@pytest.mark.parametrize("hands", ["one", "symmetric"])
def test_steps_lie_side_by_side(hands: str) -> None:
    one = made("X shape=B at=space palm=in fingers=fwd", "M shift=0,-5,0 times=3 step=6,0,0 return=lifted", hands=hands)
    out = -strong(one)[[begin for begin, _ in one.events.passes], 0]
    assert np.diff(out) == pytest.approx([6.0, 6.0], abs=1.0)
    moved = np.ptp(weak(one)[one.events.start : one.events.end + 1, 0])
    assert moved == pytest.approx(12.0, abs=1.5) if hands == "symmetric" else moved < 1.5
    hold = made("X shape=B at=space palm=in fingers=fwd", "M shift=0,-5,0 times=3 step=6,0,0", "H", hands=hands)
    end = hold.events.end
    assert np.abs(np.diff(strong(hold)[end - 6 : end + 1], axis=0)).max() < 0.2, "it is held at the last place"


def test_the_tempo_of_a_movement() -> None:
    usual, fast, slow = (
        made("X shape=B at=space palm=in fingers=fwd", f"M shift=0,-20,0{text}").events.passes[0]
        for text in ("", " tempo=1.5", " tempo=0.5")
    )
    n = usual[1] - usual[0]
    assert fast[1] - fast[0] == pytest.approx(n / 1.5, abs=1.0)
    assert slow[1] - slow[0] == pytest.approx(n / 0.5, abs=1.0)


# --- a base hand's own path


def test_a_base_hand_follows_its_own_arc_and_carries_the_hand_on_it() -> None:
    straight, arc = (made(PALM, f"M w.shift=-8,-7,2{text}", hands="base") for text in ("", " w.path=arc:up:8"))
    for one, rise in ((straight, 0.0), (arc, 8.0)):
        begin, stop = one.events.passes[0]
        for wrist in (strong(one), weak(one)):
            assert wrist[begin : stop + 1, 1].max() - wrist[begin, 1] == pytest.approx(rise, abs=0.8)
        apart = (strong(one)[:, 1] - weak(one)[:, 1])[begin : stop + 1]
        assert np.ptp(apart) < 1.0, "the strong hand stays on the palm"


def test_hands_of_a_base_sign_circle_in_opposite_directions() -> None:
    one = made(
        PALM.replace("off=0.9", "off=9"),
        "M at=space path=circle:horizontal:5:2 w.path=circle:horizontal:5:-2",
        hands="base",
    )
    assert len(one.events.passes) == 2
    begin, stop = one.events.passes[0]
    assert np.ptp(weak(one)[begin : stop + 1, 2]) > 8.0
    assert np.ptp(weak(one)[begin : stop + 1, 1]) < 1.5, "in its plane"


def test_revolutions_of_a_base_hand_that_circles_alone_are_passes() -> None:
    one = made(PALM.replace("off=0.9", "off=9"), "M w.path=circle:horizontal:4:2", hands="base")
    assert len(one.events.passes) == 2
    begin, stop = one.events.passes[1]
    assert np.ptp(weak(one)[begin : stop + 1, 2]) > 6.0
