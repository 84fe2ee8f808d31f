"""Words touch the body where the notation has it, keep out of it elsewhere, and move no joint too fast or too far."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from signing import seen_from_chest, sign, word, wrists
from signsplice.body import capsules, collision
from signsplice.motion import kinematics, rotation
from signsplice.signer import planner, pose
from signsplice.signer.collisions import TOLERANCE_CM, clear_collisions, penetration
from signsplice.signer.handshapes import HANDSHAPES
from signsplice.signer.phonology import Posture, Segment, Sign
from signsplice.signer.planner import IsolatedWord, touches
from signsplice.signer.signer import JOINTS, RESTS, STANDARD, draw_signer
from signsplice_workshop.corpora.touches import measure_touches
from signsplice_workshop.measure.collisions import hand_penetration
from signsplice_workshop.measure.corpus_checks import over_limit

STRONG, WEAK = 1, 0
"""Columns of left and right hand for a right-handed signer."""

# --- touching

PART_TIPS = {"thumb": ("Thumb",), "index": ("Index",), "tips": ("Index", "Middle"), "fingertips": ("Index", "Middle")}


def gap(one: IsolatedWord, frame: int, part: str) -> float:
    """Distance from the skin of a part of the strong hand to head and trunk, cm, by capsules; negative inside."""
    clip = one.clip[frame : frame + 1]
    shape = capsules.body_capsules(clip.skeleton)
    starts, ends = capsules.capsule_ends(shape, *kinematics.forward(clip))
    fingers = PART_TIPS.get(part)
    chosen = [
        n
        for n in shape.groups.right
        if (fingers is None and shape.parts[n] == "palm")
        or (fingers is not None and shape.parts[n].removesuffix("Tip") in fingers)
    ]
    depth, _ = collision.overlap(starts, ends, shape.radii, chosen, [*shape.groups.head, *shape.groups.trunk])
    return -float(depth.max())


@pytest.mark.parametrize("gloss", ["MOTHER", "FATHER", "I", "MY", "THINK", "KNOW"])
@pytest.mark.parametrize("seed", [None, 3, 7])
def test_a_touch_in_notation_is_a_touch_in_motion(gloss: str, seed: int | None) -> None:
    one = word(gloss, seed)
    assert measure_touches(one).touches_last
    assert not measure_touches(one).touches_first
    part = one.sign.segments[-1].strong.part
    touching = gap(one, one.events.passes[-1][1], part)
    assert -0.25 < touching < 0.5, "at the end of its last movement"
    assert gap(one, one.events.start, part) > touching + 1.0, "before, it does not"


@pytest.mark.parametrize("seed", [None, 3])
def test_the_strong_hand_touches_a_base_hand(seed: int | None) -> None:
    one = word("LEARN", seed)
    assert measure_touches(one).touches_first
    depth, _ = hand_penetration(one.clip.skeleton, *kinematics.forward(one.clip))
    assert abs(depth[one.events.start, STRONG]) < 0.5
    assert depth[one.events.end, STRONG] < 0.25


def test_which_postures_count_as_touches() -> None:
    def touching(location: str, hands: str, off: float = 0.0, up: float = 0.0) -> bool:
        posture = Posture("B", location, "palm", (0.0, 0.0, 1.0), (0.0, 1.0, 0.0), off, (0.0, up, 0.0))
        segment = Segment("H", posture)
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


# --- collision avoidance


def test_words_keep_hands_out_of_the_body() -> None:
    for gloss in ("MOTHER", "BOOK", "HAT", "SICK", "FRIEND"):
        for seed in (None, 3):
            one = word(gloss, seed)
            assert penetration(one.states, one.signer)[0].max() < 0.35, (gloss, seed)
            assert over_limit(one.clip.local_rotations) == 0.0


def test_clearing_pushes_a_hand_out_and_changes_nothing_else() -> None:
    states = word("MY").states.copy()
    e = word("MY").events
    assert np.array_equal(clear_collisions(states, STANDARD), states), "clear already"
    pressed = states.copy()
    pressed[e.start : e.end + 1, 2] -= 3.0
    assert penetration(pressed, STANDARD)[0].max() > 1.5
    freed = clear_collisions(pressed, STANDARD)
    assert penetration(freed, STANDARD)[0].max() < TOLERANCE_CM + 0.1
    far = np.ones(len(states), bool)
    far[max(e.start - 5, 0) : e.end + 6] = False
    assert np.abs((freed - pressed)[far]).max() < 1e-9
    assert np.abs((freed - pressed)[:, 3:]).max() == 0.0, "the wrist alone, of the hand that lay within"
    change = np.linalg.norm(np.diff(freed[:, :3], n=2, axis=0), axis=-1).max()
    assert change < 1.5 * np.linalg.norm(np.diff(pressed[:, :3], n=2, axis=0), axis=-1).max(), "smoothly in time"


def test_clearing_between_two_seams_fades_out_at_both() -> None:
    states = np.repeat(word("MY").states[word("MY").events.end][None], 12, axis=0)
    states[:, 2] -= 2.0 * np.sin(np.pi * np.arange(1, 13) / 13)
    freed = clear_collisions(states, STANDARD, ends=True)
    moved = np.linalg.norm(freed - states, axis=-1)
    assert moved[[0, -1]].max() < 0.25 * moved.max()
    assert moved.max() > 0.5


# --- joints of whole words

MANY = (
    *("I", "YOU", "MY", "MOTHER", "FAMILY", "FRIEND", "HELLO", "THANK-YOU", "PLEASE", "SORRY", "WHAT", "WHERE"),
    *("YESTERDAY", "EAT", "COOK", "LEARN", "BOOK", "KNOW", "SIGN", "DEAF", "HAPPY", "HELP", "WALK", "HOUSE", "HAT"),
)
ARM = [JOINTS[side + name] for side in ("Left", "Right") for name in ("Shoulder", "Arm", "ForeArm", "Hand")]


@pytest.mark.parametrize("seed", [0, 3, 7])
def test_no_wrist_swings_behind_the_chest_and_no_joint_flips(seed: int) -> None:
    for gloss in MANY:
        one = word(gloss, seed)
        e = one.events
        away = wrists(one)[e.up : e.down + 1]
        raised = away[..., 1] > -30.0 * one.signer.scale  # a hanging hand does not go with the trunk
        assert away[raised][:, 2].min() > 0.0, f"{gloss}: a wrist goes behind the chest joint"
        local_quats = one.clip.local_rotations[:, ARM]
        step = np.rad2deg(rotation.angle_between(local_quats[:-1], local_quats[1:]))
        assert step.max() < 60.0, f"{gloss}: a joint of the arm rotates by {step.max():.0f} degrees in a frame"
        assert over_limit(one.clip.local_rotations) == 0.0, gloss


@pytest.mark.parametrize("seed", [None, 7])
def test_letters_are_held_with_their_handshape(seed: int | None) -> None:
    for gloss in ("fs-A", "fs-L", "fs-V"):
        one = word(gloss, seed)
        middle = (one.events.start + one.events.end) // 2
        shape = HANDSHAPES[sign(gloss).segments[0].strong.shape].angles
        assert np.allclose(one.states[middle, pose.FINGERS], shape)
        height = seen_from_chest(one.clip[middle : middle + 1], "RightHand")[1][0, 0, 1]
        assert -10.0 < height < 25.0, "in front of the chest or next to the face"


@pytest.mark.parametrize("rest", RESTS)
@pytest.mark.parametrize("number", [0, 5])
def test_every_rest_pose_is_free_and_leaves_the_sign_as_it_is(rest: str, number: int) -> None:
    signer = STANDARD if number == 0 else draw_signer(number)
    one, usual = (planner.synthesize_word(sign("THANK-YOU"), replace(signer, rest=kind)) for kind in (rest, "hanging"))
    assert penetration(one.states, one.signer)[0].max() < TOLERANCE_CM + 0.25
    lengths = [made.events.end - made.events.start for made in (one, usual)]
    assert lengths[0] == lengths[1], "the rest is no part of the sign"
    heights = wrists(one)[:, :, 1]
    assert np.ptp(heights[: one.events.up + 1], axis=0).max() < 2.0, "still at first"
    lowest = [wrists(made)[0, :, 1].max() for made in (one, usual)]
    assert (lowest[0] > lowest[1] + 5.0) == (rest != "hanging"), "hands that rest in front of the body do not hang"
    if rest != "hanging":
        weak = wrists(one)[one.events.start : one.events.end + 1, STRONG if signer.left_handed else WEAK]
        assert np.ptp(weak, axis=0).max() < 6.0, (
            "but for the trunk's motion, the hand that does not sign stays where it rests"
        )
