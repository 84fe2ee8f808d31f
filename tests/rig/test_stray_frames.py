"""rig.inspection: reference poses and jumps at the ends of clips, and what is none."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from other_rigs import on_other_rig, with_rest_pose
from reference_poses import arms_out, with_pose
from signing import word
from signsplice.lexicon import open_shipped_lexicon
from signsplice.motion import Clip, Skeleton, concatenate, resample, rotation
from signsplice.rig.info import arms
from signsplice.rig.inspection import JUMP_M_S, MotionSpan, inspect, motion_span, with_ends_held
from signsplice.signer import planner
from signsplice.signer.signer import RESTS, STANDARD

MOTHER = word("MOTHER").clip
T_POSE = arms_out(MOTHER.skeleton)


def with_spread_arms(n_hold: int, off_deg: float) -> Clip:
    """MOTHER, then arms that are spread within 20 frames, held, ``off_deg`` off the T-pose, and lowered again."""
    spread = arms_out(MOTHER.skeleton)
    for name in ("LeftArm", "RightForeArm"):
        joint = MOTHER.skeleton.index[f"mixamorig:{name}"]
        spread[joint] = rotation.multiply(spread[joint], rotation.exp([0.0, np.deg2rad(off_deg), 0.0]))
    last = MOTHER.local_rotations[-1]
    at = (1.0 - np.cos(np.pi * np.arange(1, 21) / 21.0)) / 2.0
    rows = [rotation.slerp(last, spread, at[:, None]), [spread] * n_hold, rotation.slerp(spread, last, at[:, None])]
    local = np.concatenate([MOTHER.local_rotations, *rows])
    return replace(
        MOTHER, local_rotations=local, root_positions=np.repeat(MOTHER.root_positions[:1], len(local), 0), channels=None
    )


@pytest.mark.parametrize("at_end", [False, True])
@pytest.mark.parametrize(("lowered", "shown"), [(0.0, "a T-pose"), (40.0, "an A-pose")])
@pytest.mark.parametrize("fps", [30.0, 120.0])
def test_a_reference_pose_and_the_way_out_of_it_are_found_at_either_end(
    lowered: float, shown: str, at_end: bool, fps: float
) -> None:
    clip = resample(MOTHER, fps)
    for n_frames, n_blend in itertools.product((1, 3, 10), (0, 1, 4, 8)):
        found = motion_span(with_pose(clip, arms_out(clip.skeleton, lowered), n_frames, n_blend, at_end))
        n_stray = n_frames + n_blend
        assert (found.start, found.stop) == ((0, len(clip)) if at_end else (n_stray, n_stray + len(clip)))
        first, last = (len(clip), len(clip) + n_stray - 1) if at_end else (0, n_stray - 1)
        frames = f"frame {first}" if first == last else f"frames {first} to {last}"
        assert found.warnings == (f"{frames}: {shown} that does not belong to the motion; left out of splices",)


@pytest.mark.parametrize("rest", RESTS)
def test_it_is_found_whatever_the_signers_rest(rest: str) -> None:
    clip = planner.synthesize_word(word("BOOK").sign, replace(STANDARD, rest=rest)).clip
    assert motion_span(clip) == MotionSpan(0, len(clip))
    found = motion_span(with_pose(with_pose(clip, T_POSE, 2, 3), T_POSE, 4, 0, at_end=True))
    assert (found.start, found.stop) == (5, 5 + len(clip))


def test_it_is_found_on_other_rigs() -> None:
    posed = with_pose(MOTHER, T_POSE, 2, 3)
    bent = with_rest_pose(posed, {"mixamorig:LeftArm": (0.0, 0.9, 0.3), "mixamorig:RightForeArm": (0.2, 0.0, 1.0)})
    for other in (on_other_rig(posed, rotation.exp([0.4, -1.1, 2.0]), 0.01), bent):
        assert motion_span(other).start == 5


def test_nothing_is_found_in_the_words_that_ship() -> None:
    with open_shipped_lexicon() as words:
        found = {gloss: motion_span(words.clip(gloss)) for gloss in words}
        assert [gloss for gloss, one in found.items() if one.warnings] == []


def test_arms_that_a_sign_spreads_belong_to_it() -> None:
    assert motion_span(with_spread_arms(15, 0.0)).warnings == (), "in the middle, reached smoothly"
    held = with_spread_arms(15, 9.0)[len(MOTHER) + 20 :]
    assert motion_span(held) == MotionSpan(0, len(held)), "from the first frame, as straight as people hold them"


def test_the_files_own_rest_pose_is_found_where_its_arms_do_not_hang() -> None:
    rest = np.tile(rotation.IDENTITY, (len(MOTHER.skeleton), 1))
    forward = {"mixamorig:LeftArm": (0.0, -1.5, 0.0), "mixamorig:RightArm": (0.0, 1.5, 0.0)}
    clip = with_rest_pose(MOTHER, forward)
    assert motion_span(with_pose(clip, rest, 2, 4)).start == 6
    hanging = {"mixamorig:LeftArm": (0.0, 0.0, -1.4), "mixamorig:RightArm": (0.0, 0.0, 1.4)}
    assert motion_span(with_pose(with_rest_pose(MOTHER, hanging), rest, 2, 4)).start == 0


def test_what_lies_beyond_a_jump_is_left_out_at_an_end_and_named_in_the_middle() -> None:
    joint = MOTHER.skeleton.index["mixamorig:RightForeArm"]
    for jump, start, line in (
        (4, 4, "frames 0 to 3: what is apart by a jump that does not belong to the motion; left out of splices"),
        (30, 0, "mixamorig:RightForeArm turns by 80 degrees from frame 29 to 30: a fault of the capture?"),
    ):
        local = np.array(MOTHER.local_rotations)
        local[:jump, joint] = rotation.multiply(local[:jump, joint], rotation.exp([np.deg2rad(80.0), 0.0, 0.0]))
        found = motion_span(replace(MOTHER, local_rotations=local, channels=None))
        assert found.start == start
        assert line.split(" turns")[0] in found.warnings[0]
        assert ("left out" in found.warnings[0]) == (start > 0)


@pytest.mark.parametrize("finger", ["RightHandIndex2", "LeftHandThumb1", "LeftHandPinky3"])
@pytest.mark.parametrize("at_end", [False, True])
def test_fingers_that_flip_while_arms_rise_or_sink_are_named_and_nothing_is_left_out(finger: str, at_end: bool) -> None:
    joint, flip = MOTHER.skeleton.index[f"mixamorig:{finger}"], rotation.exp([0.0, 0.3, 2.4])
    local = np.array(MOTHER.local_rotations)
    flipped = slice(-9, None) if at_end else slice(0, 9)
    local[flipped, joint] = rotation.multiply(local[flipped, joint], flip)
    step = len(local) - 10 if at_end else 8
    turned = np.rad2deg(rotation.angle_between(local[step, joint], local[step + 1, joint]))
    assert turned > 90.0
    found = motion_span(replace(MOTHER, local_rotations=local, channels=None))
    assert (found.start, found.stop) == (0, len(MOTHER))
    line = f"mixamorig:{finger} turns by {turned:.0f} degrees from frame {step} to {step + 1}: a fault of the capture?"
    assert found.warnings == (line,)


def test_a_jump_of_an_arm_is_found_while_a_finger_flips_back_and_forth() -> None:
    arm, finger = (MOTHER.skeleton.index[f"mixamorig:{name}"] for name in ("LeftArm", "LeftHandRing2"))
    local = np.array(MOTHER.local_rotations)
    local[:6, arm] = rotation.multiply(local[:6, arm], rotation.exp([0.0, 0.0, np.deg2rad(80.0)]))
    local[2:14:2, finger] = rotation.multiply(local[2:14:2, finger], rotation.exp([0.0, 0.0, 2.4]))
    assert motion_span(replace(MOTHER, local_rotations=local, channels=None)).start == 6


def test_a_body_that_stands_elsewhere_for_a_frame_is_left_out() -> None:
    positions = np.array(MOTHER.root_positions)
    positions[0] += 50.0
    assert motion_span(replace(MOTHER, root_positions=positions, channels=None)).start == 1
    positions[20] += 50.0
    found = motion_span(replace(MOTHER, root_positions=positions, channels=None))
    assert [line.split(" m/s ")[1] for line in found.warnings[1:]] == [
        "from frame 19 to 20: a fault of the capture?",
        "from frame 20 to 21: a fault of the capture?",
    ]


def test_behind_a_few_wrong_frames_near_an_end_the_motion_goes_on() -> None:
    for n_wrong in (1, 3):
        local = np.array(MOTHER.local_rotations)
        local[6 : 6 + n_wrong] = T_POSE
        found = motion_span(replace(MOTHER, local_rotations=local, channels=None))
        assert (found.start, found.stop) == (0, len(MOTHER))
        assert "from frame 5 to 6: a fault of the capture?" in found.warnings[0]


def test_fast_motion_is_no_jump() -> None:
    fast = resample(MOTHER, 60.0, speed=4.0)
    speed = np.linalg.norm(np.diff(arms(fast).wrists[:, 1], axis=0), axis=-1).max() * 60.0 / 100.0
    assert speed > JUMP_M_S
    assert motion_span(fast) == MotionSpan(0, len(fast))


def test_of_a_clip_that_is_all_reference_pose_everything_is_kept() -> None:
    for n_frames in (1, 2, 40):
        still = with_pose(MOTHER, T_POSE, n_frames)[:n_frames]
        found = motion_span(still)
        assert (found.start, found.stop) == (0, n_frames)
        assert found.warnings == ("hardly a frame is left without a T-pose: none is left out of splices",)
    two = with_pose(MOTHER, T_POSE, 1)[:2]
    assert (motion_span(two).start, motion_span(two).stop) == (0, 2)
    assert motion_span(MOTHER[:1]) == MotionSpan(0, 1)


def test_a_rig_without_known_arms_is_judged_by_its_jumps_alone() -> None:
    skeleton = Skeleton(("a", "b"), np.array([-1, 0]), np.array([[0.0, 0, 0], [0, 1, 0]]))
    local = np.tile(rotation.IDENTITY, (40, 2, 1))
    local[:3, 1] = rotation.exp([1.5, 0.0, 0.0])
    assert motion_span(Clip(skeleton, local, np.zeros((40, 3)), 30.0)).start == 3


def test_ends_are_held_where_frames_are_stray() -> None:
    assert with_ends_held(MOTHER) is MOTHER
    held = with_ends_held(with_pose(MOTHER, T_POSE, 3))
    np.testing.assert_array_equal(held.local_rotations[:4], MOTHER.local_rotations[[0, 0, 0, 0]])
    np.testing.assert_array_equal(held.local_rotations[3:], MOTHER.local_rotations)


@pytest.mark.parametrize("step", [0.5, 1.0, 1.2, 4.0, 60.0])
def test_at_another_rate_the_frames_within_belong(step: float) -> None:
    found, n_frames = MotionSpan(5, 50), int(59 / step + 1e-9) + 1
    kept = found.resample_span(step, n_frames)
    assert 0 <= kept.start < kept.stop <= n_frames
    if step < 40.0:
        assert [k for k in range(n_frames) if 5 <= k * step <= 49] == list(range(kept.start, kept.stop))


def test_inspect_says_the_same() -> None:
    clip = with_pose(MOTHER, T_POSE, 3)
    facts, plain = inspect(clip), inspect(MOTHER)
    assert facts["warnings"] == [*motion_span(clip).warnings, *plain["warnings"]]
    (rest_before, _), last = facts["rest"], int(plain["rest"][0].split()[-1])
    assert rest_before == f"frames 3 to {last + 3}"
    assert "turns" not in " ".join(inspect(concatenate([MOTHER, MOTHER]))["warnings"])
