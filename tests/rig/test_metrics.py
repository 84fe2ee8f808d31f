"""rig.metrics: scores compared with values computed by hand."""

from dataclasses import asdict, replace
from itertools import pairwise

import numpy as np
import pytest

from signing import word
from signsplice.motion import Clip, FloatArray, Skeleton, concatenate, rotation
from signsplice.rig import metrics
from signsplice.rig.info import rig_info
from signsplice.splicing.contracts import Gap
from signsplice.splicing.curves import find_transition
from signsplice_workshop.measure import motion_scores
from signsplice_workshop.measure.hidden_frames import score_hidden_frames, table


def points(x: list[float]) -> FloatArray:
    """One point (T, 1, 3) that moves along x."""
    out = np.zeros((len(x), 1, 3))
    out[:, 0, 0] = x
    return out


def test_velocity_jump_is_the_largest_change_at_either_end() -> None:
    path = points([0.0, 1.0, 2.0, 5.0, 8.0, 11.0, 11.5, 12.0])  # frames 3 to 5 are new: steps 1 1 | 3 3 3 | .5 .5
    assert metrics.velocity_jump(path, 3, 6, 10.0) == pytest.approx(25.0)
    assert metrics.velocity_jump(path[:6], 3, 6, 10.0) == pytest.approx(20.0)
    inside = points([0.0, 1.0, 2.0, 3.0, 4.0, 9.0, 10.0, 11.0, 12.0, 13.0])
    assert metrics.velocity_jump(inside, 2, 8, 10.0) == pytest.approx(0.0), "a jump in the middle is not at an end"


def test_peak_speed_includes_the_steps_to_the_kept_frames() -> None:
    path = points([0.0, 9.0, 10.0, 12.0, 13.0, 20.0])
    assert metrics.peak_speed(path, 2, 4, 30.0) == pytest.approx(60.0)
    assert metrics.peak_speed(path[:1], 0, 1, 30.0) == 0.0


def test_jerk_ratio_compares_the_transition_with_its_surroundings() -> None:
    t = np.arange(30.0)
    cubic = points(list(t**3))  # the third difference is 6 everywhere
    assert metrics.jerk_ratio(cubic, 12, 18) == pytest.approx(1.0)
    bent = np.array(cubic)
    bent[15:] += 100.0
    assert metrics.jerk_ratio(bent, 12, 18) > 10.0
    assert np.isnan(metrics.jerk_ratio(points([1.0] * 30), 12, 18)), "no jerk around"
    held = points([1.0] * 12 + [1.0, 1.1, 1.3, 1.6, 1.8, 1.9] + [2.0] * 12)
    assert 1.0 < metrics.jerk_ratio(held, 12, 18, least=0.01) < 100.0, "after a dead hold"
    assert metrics.jerk_ratio(bent, 12, 18, least=0.01) == metrics.jerk_ratio(bent, 12, 18)
    assert np.isnan(metrics.jerk_ratio(held[11:20], 1, 8, least=0.01)), "no frames around"


def test_position_error_and_motion_ratio_of_a_still_pose(words: dict[str, Clip]) -> None:
    clip = words["SIGN"]
    assert motion_scores.position_error(clip, clip) == 0.0
    assert motion_scores.motion_ratio(clip, clip) == pytest.approx(1.0)
    still = Clip(clip.skeleton, np.repeat(clip.local_rotations[:1], len(clip), axis=0), clip.root_positions, clip.fps)
    assert motion_scores.motion_ratio(still, clip) == pytest.approx(0.0, abs=1e-12)
    joints = motion_scores.arm_and_finger_joints(clip)
    assert len(joints) == 34
    difference = motion_scores.relative_positions(still, joints) - motion_scores.relative_positions(clip, joints)
    expected = 1000.0 * np.sqrt((difference**2).sum(-1)).mean() / 55.0  # the signer's arm is 29.5 + 25.5 cm
    assert motion_scores.position_error(still, clip) == pytest.approx(expected)


def test_frames_interpolated_between_keys_rotate_evenly() -> None:
    signed = word("MOTHER").clip
    keys = [signed[k : k + 1] for k in range(20, len(signed) - 10, 12)]
    slerp = find_transition("slerp")
    parts = [part for a, b in pairwise(keys) for part in (a, slerp.between(Gap(a, b, 11)))]
    even = motion_scores.even_rotation_frames(concatenate(parts))
    at_keys = np.arange(len(even)) % 12 == 11
    assert (even[~at_keys & ~np.isnan(even)] == 1.0).all()
    assert (even[at_keys & ~np.isnan(even)] == 0.0).all()
    assert np.nanmean(motion_scores.even_rotation_frames(signed)) < 0.1, "a signer's speed changes all the time"
    assert np.isnan(motion_scores.even_rotation_frames(concatenate([signed[:1]] * 5))).all(), "nothing moves"
    trunk = Skeleton(("Hips", "Spine"), np.array([-1, 0]), np.zeros((2, 3)))
    still = Clip(trunk, np.tile(rotation.IDENTITY, (6, 2, 1)), np.zeros((6, 3)), 30.0)
    assert np.isnan(motion_scores.even_rotation_frames(still)).all(), "no arms are known"


def test_a_clip_is_keyed_where_most_moving_frames_repeat_the_step_before() -> None:
    signed = word("MOTHER").clip
    still = concatenate([signed[:1]] * 200)
    interpolated = find_transition("slerp").between(Gap(signed[:1], signed[30:31], 30))
    assert motion_scores.even_rotation_fraction(interpolated) == 1.0
    assert motion_scores.even_rotation_fraction(concatenate([interpolated, still])) > 0.9, "still frames do not count"
    assert motion_scores.even_rotation_fraction(still) == 0.0
    mark = motion_scores.format_keyedness(interpolated)
    assert mark.startswith("keyed: 100 % of the arms' motion")
    assert mark.endswith("100 % of its moving frames repeat the step before")


def test_the_table_of_hidden_frames_names_keyed_clips() -> None:
    signed = word("MOTHER").clip
    interpolated = replace(find_transition("slerp").between(Gap(signed[:1], signed[30:31], 30)), name="DRAWN")
    clips = [interpolated, signed]
    lines = table(score_hidden_frames(clips, [find_transition("hermite")], [5]), clips)
    named = [line.strip() for line in lines if "no measure of real motion" in line]
    assert named == [f"DRAWN is no measure of real motion ({motion_scores.format_keyedness(interpolated)})."]


def test_hidden_frames_counts_gaps_interpolated_between_keys() -> None:
    signed = word("MOTHER").clip
    interpolated = find_transition("slerp").between(Gap(signed[:1], signed[30:31], 30))
    rows = [score_hidden_frames([clip], [find_transition("hermite")], [5])[0] for clip in (interpolated, signed)]
    assert [row.drawn for row in rows] == [1.0, 0.0]
    assert ["100 % of 5 frames" in "\n".join(table([row])) for row in rows] == [True, False]


def test_errors_by_group_tell_which_joints_are_wrong() -> None:
    """A finger, the wrist and the neck bent by 10 degrees: each is an error of its own group alone."""
    clip = word("MOTHER").clip
    joints = rig_info(clip.skeleton).roles.joints
    wrong = {}
    for role in ("leftIndexProximal", "rightHand", "rightLowerArm", "neck"):
        local = np.array(clip.local_rotations)
        local[:, joints[role]] = rotation.multiply(local[:, joints[role]], rotation.exp([0.0, 0.0, np.deg2rad(10.0)]))
        errors = motion_scores.group_errors(replace(clip, local_rotations=local), clip)
        wrong[role] = {name for name, error in asdict(errors).items() if error > 0.1}
    assert wrong == {
        "leftIndexProximal": {"fingers"},
        "rightHand": set(),
        "rightLowerArm": {"hands"},
        "neck": {"trunk"},
    }
    rows = score_hidden_frames([clip], [find_transition("hermite")], [5])
    assert rows[0].hand_error > rows[0].trunk_error > 0.0
    assert "error of the fingers" in "\n".join(table(rows))
