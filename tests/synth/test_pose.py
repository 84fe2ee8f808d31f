"""Poses: arms reach their wrists, joints keep their limits, motion is smooth, left-handed signers are mirrored."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from signing import mirror, seen_from_chest, signer_of, word
from signsplice.motion import FloatArray, kinematics, rotation
from signsplice.signer import hand, locations, pose
from signsplice.signer.handshapes import HANDSHAPES
from signsplice.signer.locations import resting
from signsplice.signer.signer import FOREARM, JOINTS, STANDARD, UPPER_ARM, Signer, draw_signer, skeleton
from signsplice_workshop.measure.corpus_checks import over_limit

SEEDS = (None, 0, 3, 7)
HANDS = ("RightHand", "LeftHand")
LEFT_TO_RIGHT = np.array([-1.0, 1.0, 1.0])


def easy_states(n: int, signer: Signer, seed: int = 0) -> FloatArray:
    """Random states (n, 65) in the signing space with small rotations of hands, trunk and head."""
    rng = np.random.default_rng(seed)
    states = np.zeros((n, pose.SIZE))
    for first in (0, 27):
        wrists = rng.uniform([-30.0, -15.0, 15.0], [-5.0, 20.0, 34.0], (n, 3))
        states[:, first : first + 3] = wrists * signer.scale
        states[:, first + 3 : first + 6] = 0.3 * rng.normal(size=(n, 3))
        low, high = hand.LIMITS.T
        states[:, first + 6 : first + 27] = low + (high - low) * rng.random((n, 21))
    states[:, pose.TRUNK] = 0.1 * rng.normal(size=(n, 3))
    states[:, pose.HEAD] = 0.2 * rng.normal(size=(n, 3))
    states[:, pose.ROOT] = rng.normal(size=(n, 3))
    return states


def wild_states(n: int, signer: Signer, seed: int = 0) -> FloatArray:
    """Random states far beyond what a signer does: hands anywhere, with any rotation."""
    states = easy_states(n, signer, seed)
    rng = np.random.default_rng(seed + 1)
    for first in (0, 27):
        states[:, first : first + 3] = rng.uniform(-90.0, 90.0, (n, 3))
        states[:, first + 3 : first + 6] = rng.uniform(-2.0, 2.0, (n, 3))
    return states


@pytest.mark.parametrize("seed", SEEDS)
def test_a_wrist_in_reach_is_exactly_where_its_state_puts_it(seed: int | None) -> None:
    signer = replace(signer_of(seed), left_handed=False)
    states = easy_states(300, signer)
    wanted = pose.hands(states)[..., pose.WRIST] * [[[1.0, 1.0, 1.0], [-1.0, 1.0, 1.0]]]
    arms = (UPPER_ARM + FOREARM) * signer.arms * signer.scale
    for n, side in enumerate(("Right", "Left")):
        shoulders, found = np.moveaxis(
            seen_from_chest(pose.clip(states, signer, 30.0), f"{side}Arm", f"{side}Hand")[1], 1, 0
        )
        fraction = np.linalg.norm(wanted[:, n] - shoulders, axis=-1) / arms
        reachable = (fraction > 0.34) & (fraction < 0.95)
        assert reachable.mean() > 0.7
        assert np.abs(found - wanted[:, n])[reachable].max() < 1e-6
        assert np.abs(found - wanted[:, n])[~reachable].max() > 1e-3, "what is out of reach is not reached"


@pytest.mark.parametrize("seed", SEEDS)
def test_a_hand_away_from_limits_has_exactly_its_rotation_of_its_state(seed: int | None) -> None:
    signer = replace(signer_of(seed), left_handed=False)
    states = easy_states(300, signer, seed=5)
    hands = pose.hands(states)
    angles = pose.arm_angles(pose.solve_arm(hands[..., pose.WRIST], signer), hands[..., pose.ROTVEC], signer)
    (low_side, high_side), (low_bent, high_bent) = pose.WRIST_LIMITS
    free = np.abs(angles.twist) < pose.FOREARM_LIMIT - 0.15
    free &= (angles.deviation > low_side + 0.15) & (angles.deviation < high_side - 0.15)
    free &= (angles.flexion > low_bent + 0.15) & (angles.flexion < high_bent - 0.15)
    assert 0.3 < free.mean() < 1.0
    found, _ = seen_from_chest(pose.clip(states, signer, 30.0), *HANDS)
    wanted = rotation.to_matrix(pose.hand_rotations(states, signer))
    wanted[:, 1] = wanted[:, 1] * np.outer(LEFT_TO_RIGHT, LEFT_TO_RIGHT)
    error = np.abs(found - wanted).max(axis=(-1, -2))
    assert error[free].max() < 1e-9
    assert error[~free].max() > 0.01, "a limit is kept where one is met"


@pytest.mark.parametrize("seed", SEEDS)
def test_hand_rotvecs_is_the_inverse_of_hand_rotations(seed: int | None) -> None:
    rng = np.random.default_rng(2)
    states = easy_states(50, signer_of(seed))
    quats = rotation.exp(rng.uniform(-1.0, 1.0, (50, 2, 3)))
    rotvecs = pose.hand_rotvecs(pose.hands(states)[..., pose.WRIST], quats, signer_of(seed))
    assert np.abs(rotvecs).max() < np.pi
    pose.hands(states)[..., pose.ROTVEC] = rotvecs
    assert rotation.angle_between(pose.hand_rotations(states, signer_of(seed)), quats).max() < 1e-7


def test_a_wrist_out_of_reach_moves_in_along_the_line_to_the_shoulder() -> None:
    """The farther the wanted position, the farther the wrist, never beyond the arm's length, in the same direction."""
    states = np.zeros((40, pose.SIZE))
    direction = np.array([-0.2, 0.1, 0.97])
    shoulder = np.array([-18.0, 12.0, 0.5])
    states[:, :3] = shoulder + np.linspace(40.0, 140.0, 40)[:, None] * direction
    states[:, 27:30] = states[0, :3]
    _, joints = seen_from_chest(pose.clip(states, STANDARD, 30.0), "RightArm", "RightHand")
    wanted, found = states[:, :3] - joints[:, 0], joints[:, 1] - joints[:, 0]
    reached = np.linalg.norm(found, axis=-1)
    assert reached.max() < 0.993 * (UPPER_ARM + FOREARM)
    far = reached > 0.9 * (UPPER_ARM + FOREARM)
    assert (np.diff(reached[far]) > -1e-9).all()
    cosine = (wanted * found).sum(-1) / np.linalg.norm(wanted, axis=-1) / reached
    assert cosine.min() > 1.0 - 1e-9


@pytest.mark.parametrize("seed", SEEDS)
def test_no_state_breaks_a_joint(seed: int | None) -> None:
    states = np.concatenate([easy_states(400, signer_of(seed), 1), wild_states(1500, signer_of(seed), 2)])
    rotations, roots = pose.rotations(states, signer_of(seed))
    assert np.isfinite(rotations).all()
    assert np.isfinite(roots).all()
    assert np.abs(np.linalg.norm(rotations, axis=-1) - 1.0).max() < 1e-12
    assert over_limit(rotations) == 0.0


def test_over_limit_sees_each_kind_of_broken_joint() -> None:
    rotations, _ = pose.rotations(easy_states(1, STANDARD), STANDARD)
    assert over_limit(rotations) == 0.0
    x, y, z = np.eye(3)
    for joint, axis, angle, most in (
        ("RightForeArm", y, 2.8, pose.ELBOW_LIMIT),
        ("RightForeArm", x, 1.9, pose.FOREARM_LIMIT),
        ("RightHand", y, 0.6, pose.WRIST_LIMITS[0, 1]),
        ("RightHand", y, -0.9, -pose.WRIST_LIMITS[0, 0]),
        ("RightHand", z, 1.6, pose.WRIST_LIMITS[1, 1]),
        ("RightHand", z, -1.4, -pose.WRIST_LIMITS[1, 0]),
        ("RightHandIndex2", z, 2.0, hand.LIMITS[2, 1]),
        ("RightHandRing3", z, -0.2, -hand.LIMITS[11, 0]),
    ):
        for side, mirrored in (("Right", 1.0), ("Left", np.array([1.0, -1.0, -1.0, 1.0]))):
            broken = rotations.copy()
            for name in ("ForeArm", "Hand"):
                broken[0, JOINTS[side + name]] = rotation.IDENTITY
            broken[0, JOINTS[joint.replace("Right", side)]] = rotation.exp(angle * axis) * mirrored
            assert over_limit(broken) == pytest.approx(abs(angle) - most, abs=np.deg2rad(0.1)), (side, joint)


@pytest.mark.parametrize("seed", SEEDS)
def test_small_changes_of_a_state_are_small_rotations_of_joints(seed: int | None) -> None:
    """Along smooth random paths through the signing space, small steps rotate no joint far: no flips."""
    signer = signer_of(seed)
    rng = np.random.default_rng(9)
    for _ in range(6):
        ends = easy_states(2, signer, int(rng.integers(1 << 30)))
        for first in (0, 27):  # anywhere a hand signs, well turned
            ends[:, first + 3 : first + 6] = rng.uniform(-0.9, 0.9, (2, 3))
        u = np.linspace(0.0, 1.0, 200)[:, None]
        wave = 0.1 * np.sin(2.0 * np.pi * u) * (ends[1] - ends[0])[::-1]
        states = ends[0] + u * (ends[1] - ends[0]) + wave
        states[:, pose.TURNS] = 0.3 * np.sin(2.0 * np.pi * u)
        rotations, _ = pose.rotations(states, signer)
        step = rotation.angle_between(rotations[:-1], rotations[1:])
        size = np.abs(np.diff(states, axis=0)).max()
        assert size < 1.0
        assert step.max() < 0.12
        assert np.abs(np.diff(step, axis=0)).max() < 0.03, "nor is there a kink"


def test_rotations_shrink_with_the_change_of_the_state() -> None:
    """Continuous and, limits apart, differentiable: a tenth of the change makes a tenth of the rotation."""
    states = easy_states(80, STANDARD, 4)
    rng = np.random.default_rng(1)
    change = rng.normal(size=states.shape)
    base, _ = pose.rotations(states, STANDARD)
    large, small = (
        rotation.angle_between(base, pose.rotations(states + size * change, STANDARD)[0]) for size in (1e-4, 1e-5)
    )
    moved = large > 1e-6
    assert moved.mean() > 0.5
    ratio = large[moved] / small[moved]
    assert np.abs(ratio - 10.0).max() < 0.5


@pytest.mark.parametrize("seed", SEEDS)
def test_a_left_handed_signer_is_the_mirror_image(seed: int | None) -> None:
    right = replace(signer_of(seed), left_handed=False)
    left = replace(right, left_handed=True)
    states = np.concatenate([easy_states(20, right), wild_states(20, right)])
    rotations, roots = mirror(pose.clip(states, right, 30.0))
    other, other_roots = pose.rotations(states, left)
    assert np.abs(np.sum(rotations * other, axis=-1)).min() > 1.0 - 1e-12
    assert np.allclose(roots, other_roots, atol=1e-12)


def test_equal_hand_states_are_mirror_images() -> None:
    states = easy_states(30, STANDARD)
    states[:, 27:54] = states[:, :27]
    states[:, 54:] = 0.0
    clip = pose.clip(states, STANDARD, 30.0)
    rotations, roots = mirror(clip)
    assert np.abs(np.sum(rotations * clip.local_rotations, axis=-1)).min() > 1.0 - 1e-12
    assert np.allclose(roots, clip.root_positions)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("left_handed", [False, True])
def test_feet_stay_while_the_hips_sway(seed: int | None, left_handed: bool) -> None:
    signer = replace(signer_of(seed), left_handed=left_handed)
    states = np.repeat(resting(signer)[None], 60, axis=0)
    t = np.linspace(0.0, 2.0 * np.pi, 60)
    states[:, pose.ROOT] = np.stack([2.0 * np.sin(t), np.zeros(60), 1.5 * np.cos(t)], axis=-1)
    rotations, positions = kinematics.forward(
        pose.clip(states, signer, 30.0), [JOINTS[n] for n in ("Hips", "LeftFoot", "RightFoot")]
    )
    assert np.ptp(positions[:, 0, 0]) > 3.9 * signer.scale
    assert np.ptp(positions[:, 1:], axis=0).max() < 0.12, "millimetres, of centimetres of sway"
    assert np.abs(rotations[:, 1:] - rotations[:1, 1:]).max() < 1e-3, "and soles stay flat"


@pytest.mark.parametrize("seed", range(12))
def test_a_skeleton_has_the_proportions_of_its_signer(seed: int) -> None:
    signer, drawn, usual = draw_signer(seed), skeleton(draw_signer(seed)), skeleton(STANDARD)
    ratio = np.linalg.norm(drawn.offsets, axis=-1) / np.linalg.norm(usual.offsets, axis=-1)
    scale = signer.stature_cm / 170.0
    for name, factor in (
        ("Spine", 1.0),
        ("Head", 1.0),
        ("RightForeArm", signer.arms),
        ("LeftHand", signer.arms),
        ("RightHandIndex1", signer.hands),
        ("LeftHandThumb3", signer.hands),
        ("RightLeg", 1.0),
    ):
        assert ratio[JOINTS[name]] == pytest.approx(scale * factor), name
    assert drawn.offsets[JOINTS["LeftArm"], 0] == pytest.approx(
        usual.offsets[JOINTS["LeftArm"], 0] * scale * signer.shoulders
    )
    assert 145.0 < signer.stature_cm < 191.0
    assert drawn.offsets[JOINTS["RightHand"], 0] < 0.0 < drawn.offsets[JOINTS["LeftHand"], 0]


def test_a_seed_draws_one_signer_and_seeds_differ() -> None:
    assert draw_signer(4) == draw_signer(4)
    many = [draw_signer(seed) for seed in range(200)]
    assert len({signer.stature_cm for signer in many}) > 195, "only the smallest and the tallest are clipped"
    assert 0.03 < np.mean([signer.left_handed for signer in many]) < 0.2
    assert abs(np.mean([signer.stature_cm for signer in many]) - 168.0) < 2.0
    assert abs(np.std([signer.stature_cm for signer in many]) - 9.0) < 1.5


def test_the_skeleton_has_53_joints_in_t_pose_on_the_ground() -> None:
    made = skeleton(STANDARD)
    assert len(made) == 53
    rest = kinematics.rest_positions(made) + made.offsets[0]
    for side, sign in (("Left", 1.0), ("Right", -1.0)):
        arm = rest[[JOINTS[side + name] for name in ("Arm", "ForeArm", "Hand")]]
        assert np.allclose(arm[:, 1:], arm[0, 1:]), "arms level, along x"
        assert (np.diff(sign * arm[:, 0]) > 20.0).all()
        assert abs(rest[JOINTS[f"{side}ToeBase"], 1]) < 2.0
    top = rest[JOINTS["HeadTop_End"], 1]
    assert 165.0 < top < 175.0


def test_words_of_the_package_keep_the_wrist_limits() -> None:
    for gloss in ("LEARN", "HELLO", "BICYCLE"):
        assert over_limit(word(gloss, 3).clip.local_rotations) == 0.0


def test_finger_angles_become_finger_rotations() -> None:
    states = easy_states(1, STANDARD)
    states[0, pose.FINGERS] = HANDSHAPES["V"].angles
    rotations, _ = pose.rotations(states, STANDARD)
    first = JOINTS["RightHandThumb1"]
    assert np.allclose(rotations[0, first : first + 15], hand.rotations(HANDSHAPES["V"].angles))
    facing = locations.facing((0.0, 0.0, 1.0), (0.0, 1.0, 0.0))
    assert np.allclose(rotation.rotate(facing, [-1.0, 0.0, 0.0]), [0.0, 1.0, 0.0])
    assert np.allclose(rotation.rotate(facing, [0.0, -1.0, 0.0]), [0.0, 0.0, 1.0])


def test_a_turn_has_whole_turns_added_until_it_is_nearest_to_another() -> None:
    before, after = np.array([-3.08, 0.1, 0.2]), np.array([3.06, -0.12, -0.2])
    found = pose.nearest_turn(after, before)
    assert np.linalg.norm(found - before) < 0.2
    assert rotation.angle_between(rotation.exp(found), rotation.exp(after)) < 1e-9
    assert pose.nearest_turn(before, before) is before
    assert not pose.nearest_turn(np.zeros(3), before).any()
