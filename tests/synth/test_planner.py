"""Isolated words: from rest to rest, events on frames, holds still, hands where the notation says, no wild joint."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from signing import made, mirror, seen_from_chest, sign, signer_of, word
from signsplice.body import capsules, collision
from signsplice.body.capsules import capsule_ends
from signsplice.evaluation.corpus_checks import over_limit
from signsplice.motion import kinematics, rotation
from signsplice.synth import planner, pose
from signsplice.synth.avoidance import TOLERANCE_CM, clear_collisions, penetration
from signsplice.synth.handshapes import HANDSHAPES
from signsplice.synth.notation import alphabet
from signsplice.synth.phonology import Posture, Segment, Sign
from signsplice.synth.planner import IsolatedWord, touches
from signsplice.synth.signer import JOINTS, RESTS, STANDARD, draw_signer

Float = NDArray[np.float64]

ONE = ("MOTHER", "HELLO", "YES", "NO", "PLEASE", "YOU")
KINDS = (*ONE, "BOOK", "HOUSE", "SIGN", "CAR", "LEARN", "NAME", "TREE")
LETTERS = ("fs-A", "fs-J")
WORDS = (*KINDS, *LETTERS)
STRONG, WEAK = 1, 0


def wrists(one: IsolatedWord) -> Float:
    """Left and right wrist (T, 2, 3) from the chest."""
    return seen_from_chest(one.clip, "LeftHand", "RightHand")[1]


def speeds(one: IsolatedWord) -> Float:
    """Of left and right wrist, cm a frame (T - 1, 2)."""
    return np.asarray(np.linalg.norm(np.diff(wrists(one), axis=0), axis=-1))


# --- the course of a word


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
def test_it_begins_and_ends_at_rest_with_hanging_hands(gloss: str) -> None:
    one = word(gloss)
    e = one.events
    at = seen_from_chest(one.clip, "LeftHand", "RightHand", "Hips", "LeftForeArm", "RightForeArm")[1]
    for frames in (slice(0, e.up + 1), slice(e.down, None)):
        assert (at[frames, :2, 1] < at[frames, 2:3, 1] - 2.0).all(), "below the hip joints"
        assert (at[frames, :2, 1] < at[frames, 3:, 1] - 15.0).all(), "below the elbows, arms nearly straight"
        assert (np.linalg.norm(np.diff(at[frames, :2], axis=0), axis=-1) < 0.08).all(), "still but for small motions"
    assert np.abs(at[0] - at[-1]).max() < 0.5, "it comes back to where it began"
    shape = HANDSHAPES["rest"].angles
    assert np.abs(one.states[0, pose.FINGERS] - shape).max() < 0.2 * np.abs(shape).max()


@pytest.mark.parametrize("gloss", WORDS)
def test_the_hands_are_at_rest_again_when_the_events_say_so(gloss: str) -> None:
    """The first frame of rest and the last one: the frames within them move, those outside do not."""
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
    assert speed[begin : e.end, STRONG].max() < 0.25
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
        assert off[begin] - off[stop] > 3.0, "each goes there"
    for (_, stop), (begin, _) in itertools.pairwise(passes):
        assert off[begin] - off[stop] > 3.0, "and back between"
        assert begin - stop == passes[0][1] - passes[0][0]


@pytest.mark.parametrize("turns", [1, 2, -2])
def test_turns_of_a_circle_are_passes(turns: int) -> None:
    one = made("X shape=index at=space palm=in fingers=fwd-up", f"M path=circle:sagittal:5:{turns}")
    assert len(one.events.passes) == abs(turns)
    begin, stop = one.events.passes[0]
    way = one.states[begin : stop + 1, 1:3]
    assert np.abs(way[0] - way[-1]).max() < 0.6, "it closes"
    middle = way.mean(axis=0)
    radius = np.linalg.norm(way - middle, axis=-1)
    assert radius.mean() == pytest.approx(5.0, abs=0.8)
    angle = np.unwrap(np.arctan2(way[:, 0] - middle[0], way[:, 1] - middle[1]))
    assert abs(angle[-1] - angle[0]) == pytest.approx(2.0 * np.pi, abs=0.4)
    assert (angle[-1] < angle[0]) == (turns > 0), "forward at the top"


def test_an_arc_bulges_and_a_zigzag_swings() -> None:
    start = "X shape=B at=space-out palm=down fingers=fwd"
    straight = made(start, "M at=space-in")
    bowed = made(start, "M at=space-in path=arc:up:8")
    swung = made(start, "M at=space-in path=zigzag:up:4:2")

    def rise(one: IsolatedWord) -> Float:
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
def test_local_movements_move_only_what_is_theirs(local: str, column: int) -> None:
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
    one = made("X shape=S at=space palm=in fingers=fwd", "M shift=0,4,0 head=tilt trunk=out")
    at = kinematics.forward(one.clip, [JOINTS[n] for n in ("Spine2", "Head", "HeadTop_End", "Hips")])[1]
    middle = (one.events.start + one.events.end) // 2
    tilted, upright = at[middle], at[0]
    assert (tilted[2] - tilted[1])[0] < (upright[2] - upright[1])[0] - 1.0, "the top goes to the signer's right, -x"
    assert (tilted[0] - tilted[3])[0] < (upright[0] - upright[3])[0] - 1.0


def test_a_shake_of_the_head_is_a_turn_about_the_upright() -> None:
    one = word("NO")
    turns, _ = kinematics.forward(one.clip, [JOINTS["Spine2"], JOINTS["Head"]])
    nose = np.einsum("tba,tb->ta", turns[:, 0], turns[:, 1, :, 2])
    assert np.ptp(nose[:, 0]) > 0.25, "to both sides"
    assert np.ptp(nose[:, 1]) < 0.1


# --- the same again, and another


def test_the_same_arguments_make_the_same_bits() -> None:
    one, two = (planner.isolated(sign("MOTHER"), signer_of(3)) for _ in range(2))
    assert np.array_equal(one.states, two.states)
    assert np.array_equal(one.clip.local_rotations, two.clip.local_rotations)
    assert np.array_equal(one.clip.root_positions, two.clip.root_positions)
    assert one.events == two.events


def test_takes_differ_a_little_and_signers_more() -> None:
    takes = [planner.isolated(sign("HELLO"), take=take) for take in range(4)]
    assert len({one.states.tobytes() for one in takes}) == 4
    starts = np.array([one.states[one.events.start, :3] for one in takes])
    assert np.ptp(starts, axis=0).max() < 4.0, "the same word"
    ends = np.array([one.states[one.events.end, :3] for one in takes])
    assert np.ptp(ends, axis=0).max() > 0.2
    assert len({len(word("HELLO", seed)) for seed in (None, 0, 3, 7)}) > 1


def test_drawing_one_word_moves_no_other() -> None:
    fresh = planner.isolated(sign("YOU"), STANDARD)
    planner.isolated(sign("HELLO"), STANDARD)
    assert np.array_equal(planner.isolated(sign("YOU"), STANDARD).states, fresh.states)


@pytest.mark.parametrize("gloss", ["HELLO", "LEARN", "CAR"])
def test_a_faster_signer_takes_less_time(gloss: str) -> None:
    lengths = []
    for tempo in (0.7, 1.0, 1.4):
        one = planner.isolated(sign(gloss), replace(STANDARD, tempo=tempo))
        lengths.append((one.events.end - one.events.start, one.events.down - one.events.up))
    for k in (0, 1):
        assert lengths[0][k] > lengths[1][k] > lengths[2][k]
        assert lengths[0][k] / lengths[2][k] == pytest.approx(2.0, rel=0.25)


@pytest.mark.parametrize("gloss", ["HELLO", "LEARN", "SIGN", "MOTHER"])
@pytest.mark.parametrize("fps", [24.0, 60.0])
def test_another_rate_is_the_same_motion_in_time(gloss: str, fps: float) -> None:
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
            at = e.up + phase * (e.down - e.up)
            low = int(at)
            poses.append(one.states[low, :3] + (at - low) * (one.states[low + 1, :3] - one.states[low, :3]))
        assert np.linalg.norm(poses[0] - poses[1]) < 9.0, f"within two frames of a hand's quick way at phase {phase}"


def test_a_greater_amplitude_is_a_greater_movement_in_space() -> None:
    small, large = (planner.isolated(sign("CAR"), replace(STANDARD, amplitude=a)) for a in (0.8, 1.2))
    sizes = [np.ptp(one.states[one.events.start : one.events.end + 1, 1]) for one in (small, large)]
    assert sizes[1] / sizes[0] == pytest.approx(1.5, rel=0.1)


# --- two hands


@pytest.mark.parametrize("gloss", ["BOOK", "HOUSE"])
@pytest.mark.parametrize("seed", [None, 3])
def test_symmetric_hands_are_mirror_images(gloss: str, seed: int | None) -> None:
    one = word(gloss, seed)
    e = one.events
    at = wrists(one)[e.start : e.end + 1]
    assert np.abs(at[:, 0] * [-1.0, 1.0, 1.0] - at[:, 1]).max() < 2.0, "but for small motions and what keeps them apart"
    strong, weak = np.moveaxis(pose.hands(one.states)[e.start : e.end + 1], 1, 0)
    assert np.allclose(strong[:, pose.FINGERS], weak[:, pose.FINGERS])


def test_alternating_circles_are_half_a_turn_apart() -> None:
    one = word("BICYCLE")
    begin, stop = one.events.passes[0]
    half = (stop - begin) // 2
    strong, weak = np.moveaxis(pose.hands(one.states)[..., pose.WRIST], 1, 0)
    apart = np.linalg.norm(strong[begin:stop] - weak[begin:stop], axis=-1)
    assert apart.min() > 7.0, "never side by side"
    assert np.abs(strong[begin + half] - weak[begin]).max() < 1.5
    assert np.abs(weak[begin + half] - strong[begin]).max() < 1.5


def test_alternating_hands_change_places_along_a_way() -> None:
    one = word("CAR")
    begin, stop = one.events.passes[0]
    strong, weak = np.moveaxis(pose.hands(one.states)[..., pose.WRIST], 1, 0)
    assert np.abs(strong[begin] - weak[stop]).max() < 0.7
    assert np.abs(strong[stop] - weak[begin]).max() < 0.7
    assert np.abs(strong[stop] - strong[begin]).max() > 4.0


@pytest.mark.parametrize("gloss", ONE)
def test_of_a_one_handed_word_the_weak_hand_hangs(gloss: str) -> None:
    one = word(gloss)
    at = wrists(one)
    assert np.abs(at[:, WEAK] - at[0, WEAK]).max() < 2.5
    assert np.abs(at[:, STRONG] - at[0, STRONG]).max() > 30.0


@pytest.mark.parametrize("gloss", ["LEARN", "NAME"])
def test_a_base_hand_keeps_its_own_shape_and_place(gloss: str) -> None:
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
    one, two = planner.isolated(sign(gloss), right), planner.isolated(sign(gloss), draw_signer(13))
    assert draw_signer(13).left_handed
    assert one.events == two.events
    rotations, roots = mirror(one.clip)
    assert np.abs(np.sum(rotations * two.clip.local_rotations, axis=-1)).min() > 1.0 - 1e-9
    assert np.allclose(roots, two.clip.root_positions, atol=1e-9)


# --- touching


PART_TIPS = {"thumb": ("Thumb",), "index": ("Index",), "tips": ("Index", "Middle"), "fingertips": ("Index", "Middle")}


def gap(one: IsolatedWord, frame: int, part: str) -> float:
    """From the skin of a part of the strong hand to head and trunk, cm, as capsules have it; negative inside."""
    clip = one.clip[frame : frame + 1]
    shape = capsules.body_capsules(clip.skeleton)
    starts, ends = capsule_ends(shape, *kinematics.forward(clip))
    known = shape.groups
    fingers = PART_TIPS.get(part)
    own = [
        n
        for n in known.right
        if (fingers is None and shape.parts[n] == "palm")
        or (fingers is not None and shape.parts[n].removesuffix("Tip") in fingers)
    ]
    deep, _ = collision.overlap(starts, ends, shape.radii, own, [*known.head, *known.trunk])
    return -float(deep.max())


@pytest.mark.parametrize("gloss", ["MOTHER", "FATHER", "I", "MY", "THINK", "KNOW"])
@pytest.mark.parametrize("seed", [None, 3, 7])
def test_a_word_that_touches_touches(gloss: str, seed: int | None) -> None:
    one = word(gloss, seed)
    assert one.events.touches_last
    assert not one.events.touches_first
    part = one.sign.segments[-1].strong.part
    touching = gap(one, one.events.passes[-1][1], part)
    assert -0.25 < touching < 0.5, "at the end of its last movement"
    assert gap(one, one.events.start, part) > touching + 1.0, "before, it does not"


@pytest.mark.parametrize("seed", [None, 3])
def test_a_base_hand_is_touched(seed: int | None) -> None:
    one = word("LEARN", seed)
    assert one.events.touches_first
    depth, _ = collision.hand_penetration(one.clip.skeleton, *kinematics.forward(one.clip))
    assert abs(depth[one.events.start, STRONG]) < 0.5
    assert depth[one.events.end, STRONG] < 0.25


def test_what_touching_means() -> None:
    def touching(capsule_ends: str, hands: str, off: float = 0.0, up: float = 0.0) -> bool:
        segment = Segment(
            "H", Posture("B", capsule_ends, "palm", (0.0, 0.0, 1.0), (0.0, 1.0, 0.0), off, (0.0, up, 0.0))
        )
        return touches(segment, Sign("WORD", hands, (segment,)))

    assert touching("chin", "one")
    assert not touching("chin", "one", off=1.0)
    assert touching("chin", "one", off=-0.9)
    assert not touching("chin", "one", up=1.5)
    assert touching("base-palm", "base")
    assert not touching("space", "one")
    assert not touching("space-mid", "one")
    assert touching("space-mid", "symmetric")
    assert not touching("space", "symmetric")
    assert not touching("above-head", "symmetric")


def test_words_keep_clear_of_the_body_as_a_whole() -> None:
    for gloss in ("MOTHER", "BOOK", "HAT", "SICK", "FRIEND"):
        for seed in (None, 3):
            one = word(gloss, seed)
            assert penetration(one.states, one.signer)[0].max() < 0.35, (gloss, seed)
            assert over_limit(one.clip.local_rotations) == 0.0


def test_clearing_pushes_out_what_lay_within_and_nothing_else() -> None:
    states = word("MY").states.copy()
    e = word("MY").events
    assert np.array_equal(clear_collisions(states, STANDARD), states), "clear already"
    pushed = states.copy()
    pushed[e.start : e.end + 1, 2] -= 3.0
    depth = penetration(pushed, STANDARD)[0].max()
    assert depth > 1.5
    freed = clear_collisions(pushed, STANDARD)
    assert penetration(freed, STANDARD)[0].max() < TOLERANCE_CM + 0.1
    near = slice(max(e.start - 5, 0), e.end + 6)
    untouched = np.ones(len(states), bool)
    untouched[near] = False
    assert np.abs((freed - pushed)[untouched]).max() < 1e-9
    assert np.abs((freed - pushed)[:, 3:]).max() == 0.0, "wrists alone, of the hand that lay within"
    change = np.linalg.norm(np.diff(freed[:, :3], n=2, axis=0), axis=-1).max()
    assert change < 1.5 * np.linalg.norm(np.diff(pushed[:, :3], n=2, axis=0), axis=-1).max(), "smoothly in time"


def test_clearing_between_two_seams_leaves_their_neighbours() -> None:
    states = np.repeat(word("MY").states[word("MY").events.end][None], 12, axis=0)
    states[:, 2] -= 2.0 * np.sin(np.pi * np.arange(1, 13) / 13)
    freed = clear_collisions(states, STANDARD, ends=True)
    moved = np.linalg.norm(freed - states, axis=-1)
    assert moved[[0, -1]].max() < 0.25 * moved.max()
    assert moved.max() > 0.5


# --- no wild joint

MANY = (
    *("I", "YOU", "MY", "MOTHER", "FAMILY", "FRIEND", "HELLO", "THANK-YOU", "PLEASE", "SORRY", "WHAT", "WHERE"),
    *("YESTERDAY", "EAT", "COOK", "LEARN", "BOOK", "KNOW", "SIGN", "DEAF", "HAPPY", "HELP", "WALK", "HOUSE", "HAT"),
)
ARM = [JOINTS[side + name] for side in ("Left", "Right") for name in ("Shoulder", "Arm", "ForeArm", "Hand")]


@pytest.mark.parametrize("seed", [0, 3, 7])
def test_no_wrist_swings_behind_the_chest_and_no_joint_flips(seed: int) -> None:
    assert len(MANY) == 25
    for gloss in MANY:
        one = word(gloss, seed)
        e = one.events
        at = wrists(one)
        assert at[e.up : e.down + 1, :, 2].min() > 0.0, f"{gloss}: a wrist goes behind the chest joint"
        turned = one.clip.local_rotations[:, ARM]
        step = np.rad2deg(rotation.angle_between(turned[:-1], turned[1:]))
        assert step.max() < 60.0, f"{gloss}: a joint of the arm turns {step.max():.0f} degrees in a frame"
        assert over_limit(one.clip.local_rotations) == 0.0, gloss


@pytest.mark.parametrize("seed", [None, 7])
def test_letters_are_held_and_formed(seed: int | None) -> None:
    for gloss in ("fs-A", "fs-L", "fs-V"):
        one = word(gloss, seed)
        e = one.events
        middle = (e.start + e.end) // 2
        shape = HANDSHAPES[alphabet()[gloss].segments[0].strong.shape].angles
        assert np.allclose(one.states[middle, pose.FINGERS], shape)
        _, at = seen_from_chest(one.clip[middle : middle + 1], "RightHand")
        assert -10.0 < at[0, 0, 1] < 25.0, "before the chest or beside the face"


@pytest.mark.parametrize("rest", RESTS)
@pytest.mark.parametrize("number", [0, 5])
def test_however_a_signer_rests_no_hand_is_in_the_body_and_the_sign_is_the_same(rest: str, number: int) -> None:
    body = STANDARD if number == 0 else draw_signer(number)
    one, usual = (planner.isolated(sign("THANK-YOU"), replace(body, rest=kind)) for kind in (rest, "hanging"))
    assert penetration(one.states, one.signer)[0].max() < TOLERANCE_CM + 0.25
    lengths = [word.events.end - word.events.start for word in (one, usual)]
    assert lengths[0] == lengths[1], "a rest is no part of the sign"
    heights = wrists(one)[:, :, 1]
    assert np.ptp(heights[: one.events.up + 1], axis=0).max() < 2.0, "it stands still at first"
    lowest = [wrists(word)[0, :, 1].max() for word in (one, usual)]
    assert (lowest[0] > lowest[1] + 5.0) == (rest != "hanging"), "hands that rest before the body do not hang"
    if rest != "hanging":
        weak = wrists(one)[one.events.start : one.events.end + 1, STRONG if body.left_handed else WEAK]
        assert np.ptp(weak, axis=0).max() < 4.0, "the hand that does not sign stays where it rests"
