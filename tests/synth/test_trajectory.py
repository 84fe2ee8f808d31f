"""Trajectories: minimum jerk through knots, reaches that fit both of their ends, and small motions that stay small."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from signing import signer_of, word
from signsplice.motion import FloatArray
from signsplice.signer import hand, planner, pose, trajectory
from signsplice.signer.handshapes import HANDSHAPES
from signsplice.signer.signer import STANDARD, Manner, Signer, stream
from signsplice.signer.trajectory import Knot

PLAIN = replace(STANDARD, arch=0.0, manner=Manner())


def state(seed: int, spread: float = 5.0) -> FloatArray:
    """A state near a hand before the chest, both hands' fingers within their limits."""
    rng = np.random.default_rng(seed)
    made = np.zeros(pose.SIZE)
    low, high = hand.LIMITS.T
    for first in (0, 27):
        made[first : first + 3] = np.array([-10.0, 0.0, 25.0]) + spread * rng.normal(size=3)
        made[first + 3 : first + 6] = 0.2 * rng.normal(size=3)
        made[first + 6 : first + 27] = 0.5 * (low + high) + 0.2 * (high - low) * rng.uniform(-1, 1, 21)
    made[54:] = 0.1 * rng.normal(size=pose.SIZE - 54)
    return made


def still(one: FloatArray, n: int = 3) -> FloatArray:
    return np.repeat(one[None], n, axis=0)


# --- knots


@pytest.mark.parametrize("n_frames", [4, 9, 30])
def test_between_two_stops_it_is_the_minimum_jerk_movement(n_frames: int) -> None:
    a, b = state(1), state(2)
    made = trajectory.through([Knot(0, a, True), Knot(n_frames, b, True)])
    u = np.arange(n_frames + 1)[:, None] / n_frames
    assert made.shape == (n_frames + 1, pose.SIZE)
    assert np.allclose(made, a + (10 * u**3 - 15 * u**4 + 6 * u**5) * (b - a), atol=1e-8)


def test_a_trajectory_passes_every_knot_on_its_frame() -> None:
    frames = (0, 7, 12, 20, 33, 40)
    stops = (True, False, False, True, False, True)
    knots = [Knot(f, state(k), s) for k, (f, s) in enumerate(zip(frames, stops, strict=True))]
    made = trajectory.through(knots)
    assert len(made) == 41
    for knot in knots:
        assert np.allclose(made[int(knot.frame)], knot.state, atol=1e-8)


def test_a_trajectory_rests_at_stops_and_passes_the_other_knots() -> None:
    a, b, c = state(1), state(2), state(3)
    made = trajectory.through([Knot(0, a, True), Knot(20, b, True), Knot(40, c, True)])
    passing = trajectory.through([Knot(0, a, True), Knot(20, b, False), Knot(40, c, True)])
    speed, other = (np.linalg.norm(np.diff(x[:, :3], axis=0), axis=-1) for x in (made, passing))
    for frame in (0, 19, 20, 39):
        assert speed[frame] < 0.02 * speed.max(), "within a frame of a stop it hardly moves"
    assert other[19:21].min() > 0.3 * other.max()


def test_a_passed_knot_bends_the_path_smoothly() -> None:
    """Four times differentiable: no third difference stands out at the knot."""
    made = trajectory.through([Knot(0, state(1), True), Knot(30, state(2), False), Knot(60, state(3), True)])
    jerk = np.linalg.norm(np.diff(made[:, :3], n=3, axis=0), axis=-1)
    assert jerk[27:32].max() < 1.2 * jerk.max()
    assert np.abs(np.diff(jerk)).max() < 0.2 * jerk.max()


def test_a_hold_is_exactly_still() -> None:
    a, b = state(1), state(2)
    made = trajectory.through([Knot(0, a, True), Knot(6, a, True), Knot(14, b, True), Knot(19, b, True)])
    assert np.array_equal(made[:7], still(a, 7))
    assert np.array_equal(made[15:], still(b, 5))
    assert np.allclose(made[14], b, atol=1e-9)


def test_one_knot_is_one_frame() -> None:
    assert np.array_equal(trajectory.through([Knot(0, state(1), True)]), state(1)[None])


def test_every_bump_on_a_trajectory_makes_its_jerk_larger() -> None:
    """Bumps are zero at the knots and at rest at the ends, as the trajectory is."""
    knots = [Knot(0, state(1), True), Knot(40, state(2), False), Knot(100, state(3), True)]
    made = trajectory.through(knots)[:, :3]
    t = np.arange(101)
    least = (np.diff(made, n=3, axis=0) ** 2).sum()
    for width in (1, 2, 3):  # zero at both ends and at the knot, with two derivatives at the ends
        bump = (t * (100 - t) / 2500.0) ** 3 * np.sin(np.pi * width * (t - 40) / 100.0)
        for size in (-0.5, 0.5):
            assert (np.diff(made + size * bump[:, None], n=3, axis=0) ** 2).sum() > least


# --- reaches


def moving(one: FloatArray, velocity: FloatArray, ends: bool, n: int = 6) -> FloatArray:
    """Frames of even motion that end (or begin) at a state."""
    steps = np.arange(1 - n, 1) if ends else np.arange(n)
    return np.asarray(one + steps[:, None] * velocity)


def seeded_ends(seed: int) -> tuple[FloatArray, FloatArray]:
    rng = np.random.default_rng(seed)
    v, w = 0.25 * rng.normal(size=(2, pose.SIZE))
    v[pose.FINGERS] = w[pose.FINGERS] = v[33:54] = w[33:54] = 0.0
    return moving(state(seed), v, True), moving(state(seed + 50), w, False)


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize(
    "signer", [PLAIN, STANDARD, replace(STANDARD, arch=0.15, lag=-0.05)], ids=["flat", "arch", "early"]
)
def test_a_reach_takes_state_and_velocity_from_both_ends(seed: int, signer: Signer) -> None:
    before, after = seeded_ends(seed)
    n = 60
    made = trajectory.reach(before, after, n, signer)
    assert made.shape == (n, pose.SIZE)
    whole = np.concatenate([before, made, after])
    velocity = np.diff(whole, axis=0)
    first, last = len(before) - 1, len(before) + n
    change = np.abs(np.diff(velocity, axis=0))
    typical = change[first + 5 : last - 5].max()
    for frame in (first, last):
        assert change[frame - 1].max() < 0.35 * typical, "velocity continues over the seam"
    assert np.abs(whole[first + 1] - whole[first] - velocity[first - 1]).max() < 0.35 * typical


@pytest.mark.parametrize("seed", range(4))
def test_numbers_without_a_lead_are_the_quintic_of_their_ends(seed: int) -> None:
    """Trunk, head and root against the polynomial solved from its six conditions."""
    before, after = seeded_ends(seed)
    n = 21
    made = trajectory.reach(before, after, n, PLAIN)
    steps = n + 1
    t = np.array([0.0, 1.0])
    powers = np.arange(6)
    value = t[:, None] ** powers
    slope = np.where(powers > 0, powers * t[:, None] ** np.maximum(powers - 1, 0), 0.0)
    bend = np.where(powers > 1, powers * (powers - 1) * t[:, None] ** np.maximum(powers - 2, 0), 0.0)
    rows = np.concatenate([value, slope, bend])
    v, w = (before[-1] - before[-2]) * steps, (after[1] - after[0]) * steps
    wanted = np.stack([before[-1], after[0], v, w, np.zeros_like(v), np.zeros_like(v)])
    factors = np.linalg.solve(rows, wanted)
    u = np.arange(1, steps)[:, None] / steps
    assert np.allclose(made[:, 54:], (u**powers @ factors)[:, 54:], atol=1e-9)


def test_a_reach_takes_the_last_velocity_of_a_slowing_hand() -> None:
    """One-sided differences are exact for a parabola: its velocity at the last frame, not that of the last step."""
    a, b = state(1), state(2)
    velocity, slowing, n = 0.5, -0.1, 90
    t = np.arange(-5, 1)[:, None]
    before = np.repeat(a[None], 6, axis=0)
    before[:, 60:63] += velocity * t + 0.5 * slowing * t**2
    made = trajectory.reach(before, still(b), n, PLAIN)[:, 60]
    steps = np.diff(np.concatenate([before[-1:, 60], made]))
    at_end = 1.5 * steps[0] - 0.5 * steps[1]  # half a step back from the middle of the first one
    assert at_end == pytest.approx(velocity, abs=0.01)
    assert steps[1] < steps[0], "and it continues to slow down"


def test_fingers_lead_the_wrist_and_the_index_finger_the_little_one() -> None:
    a, b = state(1), state(2)
    made = trajectory.reach(still(a), still(b), 39, PLAIN)
    progress = (made[19] - a) / (b - a)
    assert np.allclose(progress[:3], 0.5, atol=1e-6), "the wrist is half way at half time"
    assert (progress[pose.ROTVEC] > 0.53).all()
    fingers = progress[pose.FINGERS]
    assert (fingers > 0.58).all()
    assert fingers[:4].mean() > fingers[4:8].mean() > fingers[12:16].mean()
    late = trajectory.reach(still(a), still(b), 39, replace(PLAIN, lag=0.06))
    early = trajectory.reach(still(a), still(b), 39, replace(PLAIN, lag=-0.06))
    progresses = [((x[19] - a) / (b - a))[pose.FINGERS].mean() for x in (late, made, early)]
    assert progresses == sorted(progresses)
    assert progresses[2] <= 0.65 + 1e-9


def test_no_number_of_a_reach_between_holds_reverses() -> None:
    """Every number changes in one direction, with the greatest lead of the fingers too; hands do not bow here."""
    a, b = state(3), state(4)
    for signer in (PLAIN, replace(PLAIN, lag=-0.075)):
        made = np.concatenate([a[None], trajectory.reach(still(a), still(b), 39, signer), b[None]])
        progress = np.diff((made - a) / (b - a), axis=0)
        assert progress.min() > -1e-9


def test_wrists_return_along_their_path_and_fingers_do_not() -> None:
    """Under time reversal wrists keep their bow; fingers differ, since they lead in both directions."""
    a, b = state(5), state(6)
    forth = trajectory.reach(still(a), still(b), 24, STANDARD)
    back = trajectory.reach(still(b), still(a), 24, STANDARD)[::-1]
    assert np.allclose(forth[:, :3], back[:, :3], atol=1e-9)
    assert np.allclose(forth[:, 54:], back[:, 54:], atol=1e-9)
    assert not np.allclose(forth[:, pose.FINGERS], back[:, pose.FINGERS], atol=0.01)


def test_reaches_bow_away_from_the_body() -> None:
    a, b = state(5), state(6)
    a[:3], b[:3] = (-20.0, -10.0, 25.0), (-5.0, 10.0, 25.0)
    flat, bowed = (
        trajectory.reach(still(a), still(b), 24, signer)[:, :3] for signer in (PLAIN, replace(PLAIN, arch=0.2))
    )
    off = bowed - flat
    assert off[12, 2] > 0.5, "forward"
    assert off[12, 0] < 0.0, "outward"
    along = (b - a)[:3]
    assert np.abs(off @ along).max() < 1e-9, "perpendicular to the straight line"
    assert np.linalg.norm(off, axis=-1).argmax() in (11, 12)


def test_a_wrist_passes_in_front_of_its_shoulder_at_a_distance() -> None:
    """Between two positions on either side of the shoulder, the path goes round in front of it, not through it."""
    a, b = state(5), state(6)
    shoulder = np.array([-18.0, 12.0, 0.5])
    a[:3], b[:3] = shoulder + np.array([[-14.0, -22.0, 4.0], [12.0, 22.0, 6.0]])
    made = trajectory.reach(still(a), still(b), 30, PLAIN)
    distance = np.linalg.norm(made[:, :3] - shoulder, axis=-1)
    u = np.linspace(0.0, 1.0, 32)[:, None]
    straight = np.linalg.norm(a[:3] + u * (b - a)[:3] - shoulder, axis=-1)
    assert straight.min() < 10.0
    assert distance.min() > 20.0


def test_a_weak_hand_that_goes_down_lags() -> None:
    a, b = state(7), state(8)
    b[27:30] = (-26.0, -39.0, 4.0)
    down = trajectory.reach(still(a), still(b), 39, PLAIN)
    up = trajectory.reach(still(b), still(a), 39, PLAIN)
    assert ((down[19, 28] - a[28]) / (b[28] - a[28])) == pytest.approx(0.42, abs=0.005)
    assert ((up[19, 28] - b[28]) / (a[28] - b[28])) == pytest.approx(0.5, abs=0.005)


def test_fast_fingers_stay_within_their_limits() -> None:
    a, b = state(9), state(10)
    a[pose.FINGERS], b[pose.FINGERS] = HANDSHAPES["S"].angles, HANDSHAPES["5"].angles
    rush = np.zeros(pose.SIZE)
    rush[pose.FINGERS] = 0.3
    made = trajectory.reach(moving(a, rush, True), moving(b, -rush, False), 12, STANDARD)
    low, high = hand.LIMITS.T
    assert (made[:, pose.FINGERS] >= low).all()
    assert (made[:, pose.FINGERS] <= high).all()
    assert (made[:, pose.FINGERS] == high).any(), "the rush would have gone beyond"


def test_a_reach_changes_none_of_its_arguments() -> None:
    before, after = seeded_ends(1)
    copies = before.copy(), after.copy()
    trajectory.reach(before, after, 12, STANDARD)
    assert np.array_equal(before, copies[0])
    assert np.array_equal(after, copies[1])


# --- durations, windows and small motions


def test_the_travel_law_gives_its_published_durations() -> None:
    """T = 51 + 149 log2(1 + D / 0.15) ms, D in shoulder widths of 36 cm."""
    assert trajectory.travel_seconds(0.0, STANDARD) == pytest.approx(0.051)
    assert trajectory.travel_seconds(0.15 * 36.0, STANDARD) == pytest.approx(0.200)
    assert trajectory.travel_seconds(0.45 * 36.0, STANDARD) == pytest.approx(0.349)
    assert trajectory.travel_seconds(36.0, STANDARD) == pytest.approx(0.051 + 0.149 * np.log2(1 + 1 / 0.15))
    quick, tall = Signer(tempo=2.0), Signer(stature_cm=204.0)
    assert trajectory.travel_seconds(20.0, quick) == pytest.approx(0.5 * trajectory.travel_seconds(20.0, STANDARD))
    assert trajectory.travel_seconds(24.0, tall) == pytest.approx(trajectory.travel_seconds(20.0, STANDARD))


def test_a_bump_and_a_window_fade_out_smoothly() -> None:
    u = np.linspace(0.0, 1.0, 2001)
    hill = trajectory.bump(u)
    assert hill.max() == pytest.approx(1.0)
    assert hill[1000] == pytest.approx(1.0)
    assert np.allclose(hill, hill[::-1])
    for n in (1, 2):
        slope = np.gradient(hill, u, edge_order=2)
        assert abs(slope[0]) < 1e-2 * np.abs(slope).max(), f"derivative {n}"
        hill = slope
    level = trajectory.window(30, 6)
    assert level[0] == level[-1] == 0.0
    assert (level[6:-6] == 1.0).all()
    assert (np.diff(level[:7]) > 0.0).all()
    assert np.allclose(level, level[::-1])


@pytest.mark.parametrize("seed", [None, 0, 3, 7])
def test_small_motions_are_small_and_have_a_mean_of_zero(seed: int | None) -> None:
    signer = signer_of(seed)
    made = trajectory.small_motions(3000, 30.0, signer, stream("test", 1))
    hands = pose.hands(made)
    assert np.abs(hands[..., pose.WRIST]).max() < 0.2, "cm"
    assert (made[:, 3:27] == 0.0).all(), "fingers and hand rotations do not shake"
    assert np.abs(made[:, pose.TRUNK]).max() < np.deg2rad(1.5)
    assert np.abs(made[:, pose.HEAD]).max() < np.deg2rad(3.0)
    assert np.abs(made[:, pose.ROOT]).max() < 1.1
    used = made.std(axis=0) > 0.0
    assert used[[0, 1, 2, 27, 28, 29, 54, 57, 60, 62]].all()
    assert (np.abs(made[:, used].mean(axis=0)) < 0.15 * made[:, used].std(axis=0)).all()
    assert not np.allclose(made[:, 0], made[:, 27]), "the hands are independent"


def test_breath_and_tremor_have_the_signers_frequencies() -> None:
    fps, n = 100.0, 6000
    made = trajectory.small_motions(n, fps, STANDARD, stream("test", 2))
    hz = np.fft.rfftfreq(n, 1.0 / fps)

    def peak(x: FloatArray, above: float = 0.0) -> float:
        power = np.abs(np.fft.rfft(x - x.mean())) * (hz > above)
        return float(hz[power.argmax()])

    assert peak(made[:, pose.TRUNK.start]) == pytest.approx(STANDARD.breath_hz, abs=0.03)
    assert peak(made[:, 0], above=4.0) == pytest.approx(STANDARD.tremor_hz, abs=0.1)


def test_small_motions_are_the_same_at_another_frame_rate() -> None:
    slow = trajectory.small_motions(60, 30.0, STANDARD, stream("test", 3))
    fast = trajectory.small_motions(120, 60.0, STANDARD, stream("test", 3))
    assert np.allclose(slow, fast[::2], atol=1e-12)


def test_an_isolated_word_leaves_rest_and_returns_by_reaches() -> None:
    made = word("HELLO")
    speed = np.linalg.norm(np.diff(made.states[:, :3], axis=0), axis=-1)
    e = made.events
    assert speed[: e.up].max() < 0.1
    assert speed[e.up : e.start].argmax() == pytest.approx(0.5 * (e.start - e.up), abs=3), (
        "one peak of speed, in the middle"
    )
    assert planner.DURATIONS.preparation_pace < planner.DURATIONS.retraction_pace
