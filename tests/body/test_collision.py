"""body.collision: depths of capsules compared with dense sampling, and of hands that are put into the body."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from other_rigs import without
from signing import mirror, word
from signsplice.body import capsules, collision
from signsplice.body.capsules import capsule_ends
from signsplice.motion import Clip, FloatArray, concatenate, kinematics, rotation
from signsplice.signer import pose
from signsplice.signer.handshapes import HANDSHAPES
from signsplice.signer.locations import resting
from signsplice.signer.signer import STANDARD, skeleton
from signsplice_workshop.measure.collisions import hand_penetration


def sampled_distance(a: FloatArray, b: FloatArray, n: int = 1201) -> tuple[float, FloatArray]:
    """Least distance of two line segments (2, 3), and the vector (3,) from b to a there, by ``n`` points on each."""
    u = np.linspace(0.0, 1.0, n)[:, None]
    p, q = a[0] + u * (a[1] - a[0]), b[0] + u * (b[1] - b[0])
    squared = (p * p).sum(-1)[:, None] + (q * q).sum(-1) - 2.0 * p @ q.T
    i, j = np.unravel_index(squared.argmin(), squared.shape)
    between = p[i] - q[j]
    return float(np.linalg.norm(between)), np.asarray(between)


def pair_overlap(a: FloatArray, b: FloatArray, radii: tuple[float, float]) -> tuple[float, FloatArray]:
    """Depth of capsule a in capsule b, and a's exit direction (3,); each of one radius, about an axis (2, 3)."""
    starts, ends = (np.stack([a[n], b[n]])[None] for n in (0, 1))
    depths, exits = collision.overlap(starts, ends, np.array([[r, r] for r in radii]), [0], [1])
    return float(depths[0, 0, 0]), exits[0, 0, 0]


def random_axes(seed: int) -> tuple[FloatArray, FloatArray]:
    """Two random line segments (2, 3)."""
    rng = np.random.default_rng(seed)
    return rng.normal(size=(2, 3)), rng.normal(size=(2, 3))


@pytest.mark.parametrize("seed", range(25))
def test_depth_and_exit_agree_with_dense_sampling(seed: int) -> None:
    a, b = random_axes(seed)
    distance, between = sampled_distance(a, b)
    depth, exit_direction = pair_overlap(a, b, (0.3, 0.2))
    assert depth == pytest.approx(0.5 - distance, abs=2e-3)
    assert np.linalg.norm(exit_direction) == pytest.approx(1.0)
    if distance > 0.1:  # at smaller distances the direction between samples is coarse
        assert exit_direction @ between / distance > 0.999


ZERO, X, Y, Z = np.zeros(3), *np.eye(3)
SPECIAL = {
    "parallel, side by side": ((ZERO, X), (0.5 * Y, 0.5 * Y + X), 0.5),
    "parallel, one after the other": ((ZERO, X), (2 * X, 3 * X), 1.0),
    "parallel, opposed": ((ZERO, X), (X + Y, Y), 1.0),
    "parallel, overlapping in part": ((ZERO, 2 * X), (X + 0.3 * Z, 4 * X + 0.3 * Z), 0.3),
    "crossing in the middle": ((-X, X), (-Y, Y), 0.0),
    "crossing at a height": ((-X, X), (-Y + 0.4 * Z, Y + 0.4 * Z), 0.4),
    "an end before a side": ((-X, X), (0.6 * Z, 2 * Z), 0.6),
    "an end before an end": ((ZERO, X), (2 * X + Y, 2 * X + 3 * Y), np.sqrt(2.0)),
    "point and axis": ((0.5 * X + 0.7 * Y, 0.5 * X + 0.7 * Y), (ZERO, X), 0.7),
    "axis and point": ((ZERO, X), (2 * X, 2 * X), 1.0),
    "point and point": ((ZERO, ZERO), (3 * Y, 3 * Y), 3.0),
    "nearest beyond both ends": ((ZERO, X), (3 * X + Y, 4 * X + 5 * Y), np.sqrt(5.0)),
}


@pytest.mark.parametrize("name", SPECIAL)
@pytest.mark.parametrize("swapped", [False, True])
def test_special_cases_have_the_depth_computed_by_hand(name: str, swapped: bool) -> None:
    one, two, distance = SPECIAL[name]
    a, b = np.array(one), np.array(two)
    if swapped:
        a, b = b, a
    depth, exit_direction = pair_overlap(a, b, (0.25, 0.5))
    assert depth == pytest.approx(0.75 - distance, abs=1e-9)
    assert sampled_distance(a, b)[0] == pytest.approx(distance, abs=2e-3), "the distance by hand is right"
    if distance > 0.0:
        assert np.linalg.norm(exit_direction) == pytest.approx(1.0)


@pytest.mark.parametrize("seed", range(12))
def test_moving_along_the_exit_direction_leads_out(seed: int) -> None:
    """Moved a little along its exit direction, a capsule lies that much less deep; moved by its depth, it is out."""
    a, b = random_axes(seed + 100)
    radii = (0.8, 0.9)
    depth, exit_direction = pair_overlap(a, b, radii)
    moved, _ = pair_overlap(a + 0.01 * exit_direction, b, radii)
    assert moved == pytest.approx(depth - 0.01, abs=5e-4)
    assert pair_overlap(a - 0.01 * exit_direction, b, radii)[0] > depth
    if depth > 0.0:
        assert pair_overlap(a + depth * exit_direction, b, radii)[0] < 0.05


@pytest.mark.parametrize("seed", range(12))
def test_two_capsules_have_one_depth_and_opposite_exits(seed: int) -> None:
    a, b = random_axes(seed + 200)
    (depth, exit_direction), (other, opposite) = pair_overlap(a, b, (0.3, 0.4)), pair_overlap(b, a, (0.4, 0.3))
    assert depth == pytest.approx(other, abs=1e-9)
    assert np.allclose(exit_direction, -opposite, atol=1e-6)


def test_a_tapered_capsule_has_its_radius_at_the_nearest_point() -> None:
    starts, ends = np.array([[[0.0, 0, 0], [5.0, 2, 0]]]), np.array([[[10.0, 0, 0], [5.0, 4, 0]]])
    radii = np.array([[1.0, 3.0], [0.5, 0.1]])
    depths, _ = collision.overlap(starts, ends, radii, [0], [1])
    assert depths[0, 0, 0] == pytest.approx(2.0 + 0.5 - 2.0)


def test_many_pairs_at_once_agree_with_each_pair_alone() -> None:
    rng = np.random.default_rng(3)
    starts, ends, radii = rng.normal(size=(4, 5, 3)), rng.normal(size=(4, 5, 3)), rng.uniform(0.1, 0.5, (5, 2))
    rows, columns = [0, 3], [1, 2, 4]
    depths, exits = collision.overlap(starts, ends, radii, rows, columns)
    assert depths.shape == (4, 2, 3)
    for t, (i, a), (j, b) in itertools.product(range(4), enumerate(rows), enumerate(columns)):
        depth, exit_direction = collision.overlap(starts[t : t + 1], ends[t : t + 1], radii, [a], [b])
        assert depth[0, 0, 0] == pytest.approx(depths[t, i, j], abs=1e-12)
        assert np.allclose(exit_direction[0, 0, 0], exits[t, i, j], atol=1e-9)


# --- hands and the body


def posed(right: tuple[float, float, float], left: tuple[float, float, float] | None = None) -> Clip:
    """One frame of the standard signer with the right wrist (and the left one, in the mirror) at a position in the
    chest's axes, cm, and flat hands.
    """
    state = np.array(resting(STANDARD))
    for first, at in ((0, right), (27, left)):
        if at is not None:
            state[first : first + 3] = at
            state[first + 3 : first + 6] = 0.0
            state[first + 6 : first + 27] = HANDSHAPES["B"].angles
    return pose.clip(state[None], STANDARD, 30.0)


def first_penetration(clip: Clip) -> tuple[FloatArray, FloatArray]:
    """Depths (2,) and exit directions (2, 3) of the left and the right hand in the first frame."""
    depths, exits = hand_penetration(clip.skeleton, *kinematics.forward(clip))
    return depths[0], exits[0]


LEFT, RIGHT = 0, 1


def test_hanging_hands_collide_with_nothing() -> None:
    depths, _ = first_penetration(posed((-26.0, -39.5, 4.0)))
    assert (depths < -1.0).all()


def test_a_hand_outside_the_body_has_its_distance_as_depth() -> None:
    depths, _ = first_penetration(posed((-10.0, 5.0, 40.0)))
    assert -40.0 < depths[RIGHT] < -10.0


@pytest.mark.parametrize(
    ("part", "at"), [("chest", (-6.0, 4.0, 9.0)), ("belly", (-4.0, -18.0, 9.0)), ("face", (-4.0, 22.0, 10.0))]
)
def test_a_hand_in_the_body_is_found_and_its_exits_lead_out(part: str, at: tuple[float, float, float]) -> None:
    clip = posed(at)
    depths, exits = first_penetration(clip)
    assert depths[RIGHT] > 1.0, part
    assert depths[LEFT] < 0.0
    assert np.linalg.norm(exits[RIGHT]) == pytest.approx(1.0)
    rotations, positions = kinematics.forward(clip)
    body = capsules.body_capsules(clip.skeleton)
    hand = sorted({int(body.joints[n]) for n in body.groups.right})
    for _ in range(25):
        depth, exit_directions = hand_penetration(clip.skeleton, rotations, positions)
        if depth[0, RIGHT] <= 0.0:
            break
        positions = positions.copy()
        positions[:, hand] += depth[0, RIGHT] * exit_directions[0, RIGHT]
    assert depth[0, RIGHT] <= 1e-6


def test_a_hand_deep_in_the_body_is_warned_about_with_its_frame() -> None:
    assert collision.depth_warnings(word("MOTHER").clip) == []
    deep = concatenate([posed((-10.0, 5.0, 40.0)), posed((-6.0, 4.0, 9.0))])
    line, *_ = collision.depth_warnings(deep)
    assert line.startswith("the right hand lies ")
    assert line.endswith(" cm in head, trunk, the other arm or its hand at frame 1")


def test_a_hand_in_the_other_forearm_is_found() -> None:
    clip = posed((-2.0, 2.0, 28.0), (-2.0, 2.0, 28.0))
    rotations, positions = kinematics.forward(clip)
    body = capsules.body_capsules(clip.skeleton)
    starts, ends = capsule_ends(body, rotations, positions)
    arms = collision.overlap(starts, ends, body.radii, body.groups.right, body.groups.left_arm)[0].max()
    assert hand_penetration(clip.skeleton, rotations, positions)[0][0, RIGHT] >= arms


def test_two_hands_in_one_another_are_pushed_apart() -> None:
    clip = posed((-2.0, 2.0, 28.0), (-2.0, 2.0, 28.0))
    depths, exits = first_penetration(clip)
    assert depths[LEFT] == pytest.approx(depths[RIGHT], abs=1e-9)
    assert depths[LEFT] > 0.5
    assert np.allclose(exits[LEFT], -exits[RIGHT], atol=1e-9)
    body = capsules.body_capsules(clip.skeleton)
    starts, _ = capsule_ends(body, *kinematics.forward(clip))
    apart = starts[0, body.groups.left].mean(axis=0) - starts[0, body.groups.right].mean(axis=0)
    assert exits[LEFT] @ apart > 0.5 * np.linalg.norm(apart), "each goes to the side on which most of it lies"


def test_a_mirrored_clip_has_mirrored_depths_and_exits() -> None:
    clip = word("LEARN").clip
    rotations, roots = mirror(clip)
    other = replace(clip, local_rotations=rotations, root_positions=roots)
    depths, exits = hand_penetration(clip.skeleton, *kinematics.forward(clip))
    other_depths, other_exits = hand_penetration(clip.skeleton, *kinematics.forward(other))
    assert np.allclose(depths, other_depths[:, ::-1], atol=1e-6)
    clear = np.abs(depths) > 1e-3
    cosine = np.einsum("thc,thc->th", exits, other_exits[:, ::-1] * [-1.0, 1.0, 1.0])
    assert np.quantile(cosine[clear], 0.05) > 0.999, "except where two parts are equally near"


def test_capsule_groups_are_the_hands_the_head_and_the_trunk() -> None:
    body = capsules.body_capsules(skeleton(STANDARD))
    groups = body.groups
    assert len(groups.left) == len(groups.right) == 5 + 15
    grouped = [*groups.left, *groups.right, *groups.head, *groups.trunk]
    assert len(grouped) == len(set(grouped))
    assert {body.sides[n] for n in groups.left} == {"left"}
    assert {body.parts[n] for n in groups.head} == {"face", "nose", "hair", "neck"}
    others = set(body.parts) - {body.parts[n] for n in grouped}
    assert others == {"sleeve", "cuff", "leg", "shoe", "eye", "mouth"}


@pytest.mark.parametrize("gloss", ["HELLO", "LEARN", "MOTHER", "BOOK", "SORRY", "HOUSE"])
def test_testing_only_near_pairs_finds_the_same_collisions(gloss: str) -> None:
    clip = word(gloss).clip
    rng = np.random.default_rng(len(gloss))
    noise = rotation.exp(rng.normal(0.0, 0.15, (1, len(clip.skeleton), 3)))
    shaken = replace(clip, local_rotations=rotation.multiply(clip.local_rotations, noise))
    for one in (clip, shaken, clip[:1], without(clip, "LeftHand")):
        globals_ = kinematics.forward(one)
        expected_depths, expected_exits = hand_penetration(one.skeleton, *globals_)
        depths, exits = collision.pose_capsules(one.skeleton, *globals_).penetration()
        deep, free = expected_depths > 1e-9, expected_depths < -1e-9
        assert (depths[free] <= 0.0).all()
        np.testing.assert_allclose(depths[deep], expected_depths[deep], atol=1e-9)
        np.testing.assert_allclose(exits[deep], expected_exits[deep], atol=1e-9)
