"""What touches what: capsules beside dense sampling, and hands put into a body on purpose."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from other_rigs import without
from signing import mirror, word
from signsplice.body import capsules, collision
from signsplice.body.capsules import capsule_ends
from signsplice.motion import kinematics, rotation
from signsplice.motion.clip import Clip
from signsplice.synth import planner, pose
from signsplice.synth.handshapes import HANDSHAPES
from signsplice.synth.signer import STANDARD, skeleton

Float = NDArray[np.float64]


def sampled(a: Float, b: Float, n: int = 1201) -> tuple[float, Float]:
    """Least distance of two axes (2, 3), and the way from b to a there, by trying ``n`` points on each."""
    u = np.linspace(0.0, 1.0, n)[:, None]
    p, q = a[0] + u * (a[1] - a[0]), b[0] + u * (b[1] - b[0])
    squared = (p * p).sum(-1)[:, None] + (q * q).sum(-1) - 2.0 * p @ q.T
    i, j = np.unravel_index(squared.argmin(), squared.shape)
    way = p[i] - q[j]
    return float(np.linalg.norm(way)), np.asarray(way)


def pair(a: Float, b: Float, radii: tuple[float, float]) -> tuple[float, Float]:
    """Depth and way out of two capsules of even thickness."""
    starts, ends = (np.stack([a[n], b[n]])[None] for n in (0, 1))
    deep, out = collision.overlap(starts, ends, np.array([[r, r] for r in radii]), [0], [1])
    return float(deep[0, 0, 0]), out[0, 0, 0]


def axes(seed: int) -> tuple[Float, Float]:
    rng = np.random.default_rng(seed)
    return rng.normal(size=(2, 3)), rng.normal(size=(2, 3))


@pytest.mark.parametrize("seed", range(25))
def test_depth_and_way_out_are_those_of_dense_sampling(seed: int) -> None:
    a, b = axes(seed)
    distance, way = sampled(a, b)
    deep, out = pair(a, b, (0.3, 0.2))
    assert deep == pytest.approx(0.5 - distance, abs=2e-3)
    assert np.linalg.norm(out) == pytest.approx(1.0)
    if distance > 0.1:  # nearer, the samples' own direction is coarse
        assert out @ way / distance > 0.999


AT, X, Y, Z = np.zeros(3), *np.eye(3)
SPECIAL = {
    "parallel, side by side": ((AT, X), (0.5 * Y, 0.5 * Y + X), 0.5),
    "parallel, one after the other": ((AT, X), (2 * X, 3 * X), 1.0),
    "parallel, opposed": ((AT, X), (X + Y, Y), 1.0),
    "parallel, overlapping in part": ((AT, 2 * X), (X + 0.3 * Z, 4 * X + 0.3 * Z), 0.3),
    "crossing in the middle": ((-X, X), (-Y, Y), 0.0),
    "crossing at a height": ((-X, X), (-Y + 0.4 * Z, Y + 0.4 * Z), 0.4),
    "tee: an end before a side": ((-X, X), (0.6 * Z, 2 * Z), 0.6),
    "corner: end before end": ((AT, X), (2 * X + Y, 2 * X + 3 * Y), np.sqrt(2.0)),
    "point and axis": ((0.5 * X + 0.7 * Y, 0.5 * X + 0.7 * Y), (AT, X), 0.7),
    "axis and point": ((AT, X), (2 * X, 2 * X), 1.0),
    "point and point": ((AT, AT), (3 * Y, 3 * Y), 3.0),
    "nearest beyond both ends": ((AT, X), (3 * X + Y, 4 * X + 5 * Y), np.sqrt(5.0)),
}


@pytest.mark.parametrize("name", SPECIAL)
@pytest.mark.parametrize("swapped", [False, True])
def test_special_cases_by_hand(name: str, swapped: bool) -> None:
    one, two, distance = SPECIAL[name]
    a, b = np.array(one), np.array(two)
    if swapped:
        a, b = b, a
    deep, out = pair(a, b, (0.25, 0.5))
    assert deep == pytest.approx(0.75 - distance, abs=1e-9)
    assert sampled(a, b)[0] == pytest.approx(distance, abs=2e-3), "the sampling agrees with the hand"
    if distance > 0.0:
        assert np.linalg.norm(out) == pytest.approx(1.0)


@pytest.mark.parametrize("seed", range(12))
def test_going_the_way_out_leads_out(seed: int) -> None:
    """A capsule moved a little along its way lies so much less deep, and moved by its depth it is out."""
    a, b = axes(seed + 100)
    radii = (0.8, 0.9)
    deep, out = pair(a, b, radii)
    moved, _ = pair(a + 0.01 * out, b, radii)
    assert moved == pytest.approx(deep - 0.01, abs=5e-4)
    assert pair(a - 0.01 * out, b, radii)[0] > deep
    if deep > 0.0:
        assert pair(a + deep * out, b, radii)[0] < 0.05


@pytest.mark.parametrize("seed", range(12))
def test_who_is_asked_first_turns_the_way_round(seed: int) -> None:
    a, b = axes(seed + 200)
    (deep, out), (other, back) = pair(a, b, (0.3, 0.4)), pair(b, a, (0.4, 0.3))
    assert deep == pytest.approx(other, abs=1e-9)
    assert np.allclose(out, -back, atol=1e-6)


def test_a_tapered_capsule_is_as_thick_as_it_is_there() -> None:
    starts, ends = np.array([[[0.0, 0, 0], [5.0, 2, 0]]]), np.array([[[10.0, 0, 0], [5.0, 4, 0]]])
    radii = np.array([[1.0, 3.0], [0.5, 0.1]])
    deep, _ = collision.overlap(starts, ends, radii, [0], [1])
    assert deep[0, 0, 0] == pytest.approx(2.0 + 0.5 - 2.0)


def test_many_pairs_at_once_are_each_pair_alone() -> None:
    rng = np.random.default_rng(3)
    starts, ends, radii = rng.normal(size=(4, 5, 3)), rng.normal(size=(4, 5, 3)), rng.uniform(0.1, 0.5, (5, 2))
    rows, columns = [0, 3], [1, 2, 4]
    deep, out = collision.overlap(starts, ends, radii, rows, columns)
    assert deep.shape == (4, 2, 3)
    for t, (i, a), (j, b) in itertools.product(range(4), enumerate(rows), enumerate(columns)):
        one, way = collision.overlap(starts[t : t + 1], ends[t : t + 1], radii, [a], [b])
        assert one[0, 0, 0] == pytest.approx(deep[t, i, j], abs=1e-12)
        assert np.allclose(way[0, 0, 0], out[t, i, j], atol=1e-9)


# --- hands and a body


def standing(strong: tuple[float, float, float], weak: tuple[float, float, float] | None = None) -> Clip:
    """The standard signer with the right wrist (and the left one, mirrored) at places in the chest's axes."""
    state = np.array(planner.resting(STANDARD))
    for first, at in ((0, strong), (27, weak)):
        if at is not None:
            state[first : first + 3] = at
            state[first + 3 : first + 6] = 0.0
            state[first + 6 : first + 27] = HANDSHAPES["B"].angles
    return pose.clip(state[None], STANDARD, 30.0)


def inside(clip: Clip) -> tuple[Float, Float]:
    """Depths (2,) and ways (2, 3), left then right, of the first frame."""
    depth, way = collision.hand_penetration(clip.skeleton, *kinematics.forward(clip))
    return depth[0], way[0]


LEFT, RIGHT = 0, 1


def test_hanging_hands_are_free() -> None:
    depth, _ = inside(standing((-26.0, -39.5, 4.0)))
    assert (depth < -1.0).all()


def test_a_hand_far_before_the_body_is_as_far_as_it_is() -> None:
    depth, _ = inside(standing((-10.0, 5.0, 40.0)))
    assert -40.0 < depth[RIGHT] < -10.0


@pytest.mark.parametrize(
    ("where", "at"), [("chest", (-6.0, 4.0, 9.0)), ("belly", (-4.0, -18.0, 9.0)), ("face", (-4.0, 22.0, 10.0))]
)
def test_a_hand_in_the_body_is_found_and_pointed_out(where: str, at: tuple[float, float, float]) -> None:
    clip = standing(at)
    depth, way = inside(clip)
    assert depth[RIGHT] > 1.0, where
    assert depth[LEFT] < 0.0
    assert np.linalg.norm(way[RIGHT]) == pytest.approx(1.0)
    turns, places = kinematics.forward(clip)
    shape = capsules.body_capsules(clip.skeleton)
    for _ in range(25):  # carried out by its own ways, the hand comes free
        depth, way = collision.hand_penetration(clip.skeleton, turns, places)
        if depth[0, RIGHT] <= 0.0:
            break
        hand = sorted({int(shape.joints[n]) for n in shape.groups.right})
        places = places.copy()
        places[:, hand] += depth[0, RIGHT] * way[0, RIGHT]
    assert depth[0, RIGHT] <= 1e-6


def test_hands_in_one_another_are_both_told_and_pushed_apart() -> None:
    clip = standing((-2.0, 2.0, 28.0), (-2.0, 2.0, 28.0))
    depth, way = inside(clip)
    assert depth[LEFT] == pytest.approx(depth[RIGHT], abs=1e-9)
    assert depth[LEFT] > 0.5
    assert np.allclose(way[LEFT], -way[RIGHT], atol=1e-9)
    shape = capsules.body_capsules(clip.skeleton)
    starts, _ = capsule_ends(shape, *kinematics.forward(clip))
    known = shape.groups
    apart = starts[0, known.left].mean(axis=0) - starts[0, known.right].mean(axis=0)
    assert way[LEFT] @ apart > 0.5 * np.linalg.norm(apart), "each goes to the side on which most of it lies"


def test_a_mirrored_pose_has_mirrored_answers() -> None:
    clip = word("LEARN").clip
    rotations, roots = mirror(clip)
    other = replace(clip, local_rotations=rotations, root_positions=roots)
    depth, way = collision.hand_penetration(clip.skeleton, *kinematics.forward(clip))
    mirrored, back = collision.hand_penetration(clip.skeleton, *kinematics.forward(other))
    assert np.allclose(depth, mirrored[:, ::-1], atol=1e-6)
    clear = np.abs(depth) > 1e-3
    same = np.einsum("thc,thc->th", way, back[:, ::-1] * [-1.0, 1.0, 1.0])
    assert np.quantile(same[clear], 0.05) > 0.999, "ways are mirrored but where two things are equally near"


def test_groups_are_the_hands_the_head_and_the_trunk() -> None:
    shape = capsules.body_capsules(skeleton(STANDARD))
    known = shape.groups
    assert len(known.left) == len(known.right) == 5 + 15
    every = [*known.left, *known.right, *known.head, *known.trunk]
    assert len(every) == len(set(every))
    assert {shape.sides[n] for n in known.left} == {"left"}
    assert {shape.parts[n] for n in known.head} == {"face", "nose", "hair", "neck"}
    assert {shape.parts[n] for n in range(len(shape.parts))} - {shape.parts[n] for n in every} == {
        *("sleeve", "cuff", "leg", "shoe", "eye", "mouth")
    }


@pytest.mark.parametrize("gloss", ["HELLO", "LEARN", "MOTHER", "BOOK", "SORRY", "HOUSE"])
def test_looking_only_where_it_may_touch_finds_the_same(gloss: str) -> None:
    clip = word(gloss).clip
    rng = np.random.default_rng(len(gloss))
    shaken = replace(clip, local_rotations=rotation.multiply(
        clip.local_rotations, rotation.exp(rng.normal(0.0, 0.15, (1, len(clip.skeleton), 3))))
    )  # fmt: skip
    for one in (clip, shaken, clip[:1], without(clip, "LeftHand")):
        globals_ = kinematics.forward(one)
        depth, way = collision.hand_penetration(one.skeleton, *globals_)
        pressed, out = collision.posed_capsules(one.skeleton, *globals_).penetration()
        inside = depth > 0.0
        np.testing.assert_array_equal(pressed > 0.0, inside)
        np.testing.assert_allclose(pressed[inside], depth[inside], rtol=1e-9)
        np.testing.assert_allclose(out[inside], way[inside], atol=1e-9)
