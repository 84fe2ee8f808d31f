"""Isolated words go from rest to rest, their events are frames, holds are still, and hands follow the notation."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from signing import made, mirror, seen_from_chest, sign, signer_of, word, wrists
from signsplice.motion import FloatArray, kinematics
from signsplice.signer import planner, pose
from signsplice.signer.handshapes import HANDSHAPES
from signsplice.signer.planner import IsolatedWord
from signsplice.signer.signer import JOINTS, PLAIN, STANDARD, draw_signer

ONE = ("MOTHER", "HELLO", "YES", "NO", "PLEASE", "YOU")
KINDS = (*ONE, "BOOK", "HOUSE", "SIGN", "CAR", "LEARN", "NAME", "TREE")
LETTERS = ("fs-A", "fs-J")
WORDS = (*KINDS, *LETTERS)
STRONG, WEAK = 1, 0


def plainly(one: IsolatedWord) -> IsolatedWord:
    """A word as its signer makes it without any trait of manner."""
    return planner.synthesize_word(one.sign, replace(one.signer, manner=PLAIN), fps=one.clip.fps)


def speeds(one: IsolatedWord) -> FloatArray:
    """Speed of left and right wrist, cm per frame, (T - 1, 2)."""
    return np.asarray(np.linalg.norm(np.diff(wrists(one), axis=0), axis=-1))


# --- from rest to rest


@pytest.mark.parametrize("gloss", WORDS)
def test_events_are_frames_in_order(gloss: str) -> None:
    one = word(gloss)
    e = one.events
    assert 0 < e.up < e.start < e.end < e.down < len(one) - 1
    assert e.up + 4 <= e.start
    for value in (e.up, e.start, e.end, e.down):
        assert isinstance(value, int)
    if any(segment.kind == "M" for segment in one.sign.segments):
        assert e.first is not None
        assert e.start <= e.first[0] < e.first[1] <= e.passes[-1][1] <= e.end
        assert all(begin < stop for begin, stop in e.passes)
        assert all(a[1] <= b[0] for a, b in itertools.pairwise(e.passes))
    else:
        assert e.first is None
        assert e.passes == ()
    kinds = [segment.kind for segment in one.sign.segments]
    if e.passes:
        assert (e.end > e.passes[-1][1]) == (kinds[-1] == "H"), "a last hold, and nothing else, follows the movement"
        assert e.first is not None
        assert (e.first[0] > e.start) == (kinds[0] == "H")
    assert len(one.states) == len(one.clip) == len(one)


@pytest.mark.parametrize("gloss", WORDS)
def test_a_word_begins_and_ends_at_rest_with_hanging_hands(gloss: str) -> None:
    one = word(gloss)
    e = one.events
    joints = seen_from_chest(one.clip, "LeftHand", "RightHand", "Hips", "LeftForeArm", "RightForeArm")[1]
    for frames in (slice(0, e.up + 1), slice(e.down, None)):
        hands = joints[frames, :2]
        assert (hands[..., 1] < joints[frames, 2:3, 1] - 2.0).all(), "below the hip joints"
        assert (hands[..., 1] < joints[frames, 3:, 1] - 15.0).all(), "below the elbows, arms nearly straight"
        assert (np.linalg.norm(np.diff(hands, axis=0), axis=-1) < 0.08).all(), "still but for small motions"
    assert np.abs(joints[0] - joints[-1]).max() < 0.5, "it comes back to where it began"
    shape = HANDSHAPES["rest"].angles
    assert np.abs(one.states[0, pose.FINGERS] - shape).max() < 0.2 * np.abs(shape).max()


@pytest.mark.parametrize("gloss", WORDS)
def test_hands_move_between_the_frames_of_rest(gloss: str) -> None:
    """Between ``up`` and ``down``, the last frame of rest and the first one after the word."""
    one = word(gloss)
    e, speed = one.events, speeds(word(gloss)).max(axis=-1)
    assert speed[e.up + 2 : e.up + 6].max() > 0.1
    assert speed[e.down - 6 : e.down - 2].max() > 0.1
    assert speed[e.up + 1 : e.start - 1].max() > 2.0
    assert speed[e.end + 1 : e.down - 1].max() > 2.0


@pytest.mark.parametrize("gloss", ["MOTHER", "HELLO", "NO", "BOOK", "HOUSE", "LEARN", "NAME", "fs-A"])
def test_holds_are_still(gloss: str) -> None:
    one = word(gloss)
    e = one.events
    speed = speeds(one)
    begin = e.passes[-1][1] if e.passes else e.start
    assert e.end - begin >= 2
    assert speed[begin : e.end, STRONG].max() < 0.4, "but for small motions, of the head that it is at, too"
    peak = speed[e.start : begin + 1].max(initial=0.0)
    if e.passes and gloss != "NO":  # which moves its fingers alone
        assert peak > 4.0 * speed[begin : e.end, STRONG].max()
    fingers = one.states[begin : e.end + 1, pose.FINGERS]
    assert np.ptp(fingers, axis=0).max() < 1e-9


@pytest.mark.parametrize("times", [1, 2, 3])
def test_repeats_are_counted(times: int) -> None:
    one = made("X shape=5 at=chin by=thumb off=6 palm=in fingers=up-up-in", f"M off=1 times={times}", "H")
    passes = one.events.passes
    assert len(passes) == times
    off = one.states[:, 2]
    for begin, stop in passes:
        assert off[begin] - off[stop] > 3.0, "each goes to the chin"
    for (_, stop), (begin, _) in itertools.pairwise(passes):
        assert off[begin] - off[stop] > 3.0, "and returns between"
        assert begin - stop == passes[0][1] - passes[0][0]


@pytest.mark.parametrize("revolutions", [1, 2, -2])
def test_every_revolution_of_a_circle_is_a_pass(revolutions: int) -> None:
    one = made("X shape=index at=space palm=in fingers=fwd-up", f"M path=circle:sagittal:5:{revolutions}")
    assert len(one.events.passes) == abs(revolutions)
    begin, stop = one.events.passes[0]
    path = one.states[begin : stop + 1, 1:3]
    assert np.abs(path[0] - path[-1]).max() < 0.6, "it closes"
    middle = path.mean(axis=0)
    radius = np.linalg.norm(path - middle, axis=-1)
    assert radius.mean() == pytest.approx(5.0, abs=0.8)
    angle = np.unwrap(np.arctan2(path[:, 0] - middle[0], path[:, 1] - middle[1]))
    assert abs(angle[-1] - angle[0]) == pytest.approx(2.0 * np.pi, abs=0.4)
    assert (angle[-1] < angle[0]) == (revolutions > 0), "forward at the top"


def test_an_arc_bulges_and_a_zigzag_swings() -> None:
    start = "X shape=B at=space-out palm=down fingers=fwd"
    straight = made(start, "M at=space-in")
    bowed = made(start, "M at=space-in path=arc:up:8")
    swung = made(start, "M at=space-in path=zigzag:up:4:2")

    def rise(one: IsolatedWord) -> FloatArray:
        assert one.events.first is not None
        begin, stop = one.events.first
        return np.asarray(
            one.states[begin : stop + 1, 1] - np.linspace(one.states[begin, 1], one.states[stop, 1], stop - begin + 1)
        )

    assert np.abs(rise(straight)).max() < 1.0
    assert rise(bowed).max() == pytest.approx(8.0, rel=0.25)
    assert rise(bowed).min() > -0.5
    assert (np.diff(np.sign(rise(swung)[np.abs(rise(swung)) > 1.0])) != 0).sum() == 3, "two swings up and two down"


@pytest.mark.parametrize(
    ("local", "column"), [("twist:30:2", 3), ("nod:28:2", 5), ("wiggle:25:2", 6 + 1), ("bend:45:2", 6 + 5)]
)
def test_local_movements_change_only_their_own_numbers(local: str, column: int) -> None:
    kind, degrees, _ = local.split(":")
    one = made("X shape=5 at=space palm=in fingers=up-fwd", f"M local={local}", "H")
    assert one.events.first is not None
    begin, stop = one.events.first
    part = one.states[begin : stop + 1]
    swing = np.rad2deg(np.ptp(part[:, column]))
    full = float(degrees) if kind == "bend" else 2.0 * float(degrees)
    assert 0.75 * full < swing < 1.05 * full
    others = [c for c in range(6, 27) if c != column] if kind in ("twist", "nod") else [3, 4, 5]
    assert np.ptp(part[:, others], axis=0).max() < 0.02
    assert np.ptp(part[:, :3], axis=0).max() < 0.3
    assert np.abs(part[0, 3:27] - part[-1, 3:27]).max() < 0.05, "it ends as it began"


def test_fingers_wiggle_one_after_another() -> None:
    one = made("X shape=5 at=space palm=down fingers=fwd", "M local=wiggle:22:3")
    assert one.events.first is not None
    begin, stop = one.events.first
    bend = one.states[begin : stop + 1, pose.FINGERS][:, 1:16:4]
    bend = bend - bend.mean(axis=0)
    lags = [np.correlate(bend[:, k], bend[:, k + 1], "full").argmax() - (stop - begin) for k in range(3)]
    assert all(lag < 0 for lag in lags), "the index first"


def test_head_and_trunk_follow_the_notation() -> None:
    plain = made("X shape=S at=space palm=in fingers=fwd", "M shift=0,4,0")
    for text, part, axis in (
        ("head=nod", pose.HEAD, 0),
        ("head=shake", pose.HEAD, 1),
        ("head=tilt", pose.HEAD, 2),
        ("trunk=fwd", pose.TRUNK, 0),
        ("trunk=out", pose.TRUNK, 2),
    ):
        one = made("X shape=S at=space palm=in fingers=fwd", f"M shift=0,4,0 {text}")
        change = np.rad2deg(one.states - plain.states)[:, part]
        assert 4.0 < np.abs(change[:, axis]).max() < 12.0, text
        assert np.abs(np.delete(change, axis, axis=1)).max() < 1e-6
        assert np.abs(np.diff(change, axis=0)).max() < 4.5, "degrees a frame: it comes and goes smoothly"
        assert np.abs(change[0]).max() < 1e-6
        assert np.abs(change[-1]).max() < 1e-6
    left, right = (
        made("X shape=S at=space palm=in fingers=fwd", f"M shift=0,4,0 head={tilt}") for tilt in ("tilt", "tilt-weak")
    )
    assert np.allclose(
        (left.states - plain.states)[:, pose.HEAD], -(right.states - plain.states)[:, pose.HEAD], atol=1e-9
    )


def test_a_tilt_to_the_strong_side_leans_the_head_to_the_right() -> None:
    one = plainly(made("X shape=S at=space palm=in fingers=fwd", "M shift=0,4,0 head=tilt trunk=out"))
    positions = kinematics.forward(one.clip, [JOINTS[n] for n in ("Spine2", "Head", "HeadTop_End", "Hips")])[1]
    tilted, upright = positions[(one.events.start + one.events.end) // 2], positions[0]
    assert (tilted[2] - tilted[1])[0] < (upright[2] - upright[1])[0] - 1.0, "the top goes to the signer's right, -x"
    assert (tilted[0] - tilted[3])[0] < (upright[0] - upright[3])[0] - 1.0


def test_a_shake_of_the_head_rotates_it_about_the_vertical() -> None:
    one = plainly(word("NO"))
    rotations, _ = kinematics.forward(one.clip, [JOINTS["Spine2"], JOINTS["Head"]])
    nose = np.einsum("tba,tb->ta", rotations[:, 0], rotations[:, 1, :, 2])
    assert np.ptp(nose[:, 0]) > 0.25, "to both sides"
    assert np.ptp(nose[:, 1]) < 0.1


# --- repeats, takes, tempo and frame rate


def test_the_same_arguments_make_the_same_bits() -> None:
    one, two = (planner.synthesize_word(sign("MOTHER"), signer_of(3)) for _ in range(2))
    assert np.array_equal(one.states, two.states)
    assert np.array_equal(one.clip.local_rotations, two.clip.local_rotations)
    assert np.array_equal(one.clip.root_positions, two.clip.root_positions)
    assert one.events == two.events


def test_takes_differ_a_little_and_signers_more() -> None:
    takes = [planner.synthesize_word(sign("HELLO"), take=take) for take in range(4)]
    assert len({one.states.tobytes() for one in takes}) == 4
    starts = np.array([one.states[one.events.start, :3] for one in takes])
    assert np.ptp(starts, axis=0).max() < 4.0, "the same word"
    ends = np.array([one.states[one.events.end, :3] for one in takes])
    assert np.ptp(ends, axis=0).max() > 0.2
    assert len({len(word("HELLO", seed)) for seed in (None, 0, 3, 7)}) > 1


def test_making_one_word_changes_no_other() -> None:
    fresh = planner.synthesize_word(sign("YOU"), STANDARD)
    planner.synthesize_word(sign("HELLO"), STANDARD)
    assert np.array_equal(planner.synthesize_word(sign("YOU"), STANDARD).states, fresh.states)


@pytest.mark.parametrize("gloss", ["HELLO", "LEARN", "CAR"])
def test_a_faster_signer_takes_less_time(gloss: str) -> None:
    lengths = []
    for tempo in (0.7, 1.0, 1.4):
        one = planner.synthesize_word(sign(gloss), replace(STANDARD, tempo=tempo))
        lengths.append((one.events.end - one.events.start, one.events.down - one.events.up))
    for k in (0, 1):
        assert lengths[0][k] > lengths[1][k] > lengths[2][k]
        assert lengths[0][k] / lengths[2][k] == pytest.approx(2.0, rel=0.25)


@pytest.mark.parametrize("gloss", ["HELLO", "LEARN", "SIGN", "MOTHER"])
@pytest.mark.parametrize("fps", [24.0, 60.0])
def test_another_frame_rate_gives_the_same_motion_in_time(gloss: str, fps: float) -> None:
    usual, other = word(gloss), word(gloss, fps=fps)
    assert other.clip.fps == fps
    slack = 2.5 / min(fps, 30.0)
    for a, b in (
        (usual.events.start - usual.events.up, other.events.start - other.events.up),
        (usual.events.end - usual.events.start, other.events.end - other.events.start),
        (usual.events.down - usual.events.end, other.events.down - other.events.end),
        (len(usual), len(other)),
    ):
        assert b / fps == pytest.approx(a / 30.0, abs=2.0 * slack)
    assert len(usual.events.passes) == len(other.events.passes)
    for a, b in ((usual.events.start, other.events.start), (usual.events.end, other.events.end)):
        assert np.abs(usual.states[a, :3] - other.states[b, :3]).max() < 1.0
    for phase in (0.25, 0.5, 0.75):
        poses = []
        for one in (usual, other):
            e = one.events
            time = e.up + phase * (e.down - e.up)
            low = int(time)
            poses.append(one.states[low, :3] + (time - low) * (one.states[low + 1, :3] - one.states[low, :3]))
        assert np.linalg.norm(poses[0] - poses[1]) < 9.0, f"within two frames of a fast hand's path, at phase {phase}"


def test_a_greater_amplitude_makes_larger_movements_in_space() -> None:
    small, large = (planner.synthesize_word(sign("CAR"), replace(STANDARD, amplitude=a)) for a in (0.8, 1.2))
    sizes = [np.ptp(one.states[one.events.start : one.events.end + 1, 1]) for one in (small, large)]
    assert sizes[1] / sizes[0] == pytest.approx(1.5, rel=0.1)


# --- two hands


@pytest.mark.parametrize("gloss", ["BOOK", "HOUSE"])
@pytest.mark.parametrize("seed", [None, 3])
def test_symmetric_hands_are_mirror_images(gloss: str, seed: int | None) -> None:
    one = word(gloss, seed)
    e = one.events
    left, right = np.moveaxis(wrists(one)[e.start : e.end + 1], 1, 0)
    assert np.abs(left * [-1.0, 1.0, 1.0] - right).max() < 2.0, "but for small motions and collision avoidance"
    strong, weak = np.moveaxis(pose.hands(one.states)[e.start : e.end + 1], 1, 0)
    assert np.allclose(strong[:, pose.FINGERS], weak[:, pose.FINGERS])


def test_alternating_circles_are_half_a_revolution_apart() -> None:
    one = word("BICYCLE")
    begin, stop = one.events.passes[0]
    half = (stop - begin) // 2
    strong, weak = np.moveaxis(pose.hands(one.states)[..., pose.WRIST], 1, 0)
    apart = np.linalg.norm(strong[begin:stop] - weak[begin:stop], axis=-1)
    assert apart.min() > 7.0, "never next to one another"
    assert np.abs(strong[begin + half] - weak[begin]).max() < 1.5
    assert np.abs(weak[begin + half] - strong[begin]).max() < 1.5


def test_alternating_hands_swap_their_positions_along_a_path() -> None:
    one = word("CAR")
    begin, stop = one.events.passes[0]
    strong, weak = np.moveaxis(pose.hands(one.states)[..., pose.WRIST], 1, 0)
    assert np.abs(strong[begin] - weak[stop]).max() < 0.7
    assert np.abs(strong[stop] - weak[begin]).max() < 0.7
    assert np.abs(strong[stop] - strong[begin]).max() > 4.0


@pytest.mark.parametrize("gloss", ONE)
def test_the_weak_hand_hangs_during_a_one_handed_word(gloss: str) -> None:
    one = word(gloss)
    positions = kinematics.forward(one.clip, [JOINTS["LeftHand"], JOINTS["RightHand"]])[1]
    travel = np.abs(positions - positions[0]).max(axis=(0, 2))
    assert travel[WEAK] < 2.5, "wherever the trunk goes"
    assert travel[STRONG] > 30.0


@pytest.mark.parametrize("gloss", ["LEARN", "NAME"])
def test_a_base_hand_keeps_its_own_handshape_and_position(gloss: str) -> None:
    one = word(gloss)
    e = one.events
    assert one.sign.segments[0].weak is not None
    shape = HANDSHAPES[one.sign.segments[0].weak.shape].angles
    weak = pose.hands(one.states)[e.start : e.end + 1, 1]
    assert np.allclose(weak[:, pose.FINGERS], shape)
    assert np.ptp(weak[:, pose.WRIST], axis=0).max() < 2.5


@pytest.mark.parametrize("gloss", ["HELLO", "LEARN", "SIGN", "NO"])
def test_a_left_handed_signer_signs_the_mirror_image(gloss: str) -> None:
    right = replace(draw_signer(13), left_handed=False)
    one, two = planner.synthesize_word(sign(gloss), right), planner.synthesize_word(sign(gloss), draw_signer(13))
    assert draw_signer(13).left_handed
    assert one.events == two.events
    rotations, roots = mirror(one.clip)
    assert np.abs(np.sum(rotations * two.clip.local_rotations, axis=-1)).min() > 1.0 - 1e-9
    assert np.allclose(roots, two.clip.root_positions, atol=1e-9)
