"""Handshapes keep the joint limits, touch where they should and only there, and differ from one another."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from numpy.typing import NDArray

from signsplice.body import capsules as body
from signsplice.motion import Clip, EndSite, FloatArray, Skeleton, kinematics, rotation
from signsplice.rig.roles import FINGERS
from signsplice.signer import hand, signer
from signsplice.signer.handshapes import HANDSHAPES

CONTACT = 0.3
"""Greatest distance of surfaces that should touch, cm."""
INSIDE_FINGER, INSIDE_PALM = 0.35, 0.2
"""How deep, cm, a finger may be pressed into another (webs and pulps are soft) and into the palm."""
UNLIKE = 1.5
"""Least distance, cm, of some joint or fingertip between two different shapes."""

MEET = {
    "F": ("Thumb", "Index"),
    "8": ("Thumb", "Middle"),
    "7": ("Thumb", "Ring"),
    "W": ("Thumb", "Pinky"),
    "D": ("Thumb", "Middle"),
    "O": ("Thumb", "Index"),
    "O-flat": ("Thumb", "Middle"),
    "O-small": ("Thumb", "Index"),
    "G-closed": ("Thumb", "Index"),
}
"""Fingers whose last bones touch."""
REST_ON = {
    "S": ("Thumb3", "Middle2"),
    "A": ("Thumb3", "Index1"),
    "K": ("Thumb3", "Middle1"),
    "U": ("Thumb3", "Ring2"),
    "V": ("Thumb3", "Ring2"),
    "index": ("Thumb3", "Middle2"),
    "X": ("Thumb3", "Middle2"),
    "I": ("Thumb3", "Middle2"),
    "E": ("Thumb3", "Middle3"),
    "M": ("Thumb3", "Ring2"),
    "N": ("Thumb3", "Middle2"),
    "T": ("Thumb3", "Index2"),
    "B": ("Thumb3", "Ring0"),
    "R": ("Index2", "Middle2"),
}
"""Other contacts: bones by finger and number, 0 in the palm."""
DISTINCT = {shape.angles.tobytes(): shape for shape in reversed(HANDSHAPES.values())}


def skeleton_with_hand() -> Skeleton:
    """The standard signer's skeleton, its right hand built again from ``hand``."""
    skeleton = signer.skeleton()
    offsets, tips = np.array(skeleton.offsets), list(skeleton.end_sites)
    for finger in hand.FINGERS:
        direction = hand.THUMB_DIRECTION if finger == "Thumb" else np.array([-1.0, 0.0, 0.0])
        first = skeleton.index[f"mixamorig:RightHand{finger}1"]
        lengths = hand.PHALANGES[finger]
        offsets[first : first + 3] = [hand.KNUCKLES[finger], direction * lengths[0], direction * lengths[1]]
        tips = [EndSite(first + 2, direction * lengths[2]) if tip.joint == first + 2 else tip for tip in tips]
    return replace(skeleton, offsets=offsets, end_sites=tuple(tips))


def posed(angles: FloatArray) -> tuple[Clip, NDArray[np.intp]]:
    """A clip of the signer whose right hand takes ``angles`` (T, 21), and the indices of the hand's joints."""
    skeleton = skeleton_with_hand()
    joints = np.array([skeleton.index[f"mixamorig:RightHand{joint}"] for joint in hand.JOINTS])
    local = np.tile(rotation.IDENTITY, (len(angles), len(skeleton), 1))
    local[:, joints] = hand.rotations(angles)
    return Clip(skeleton, local, np.zeros((len(angles), 3)), 30.0), joints


def nearest(p: FloatArray, u: FloatArray, q: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Fractions s, t (...) along the segments p + s u and q + t v where they come nearest (Ericson 2005, 5.1.9)."""
    r = p - q
    a, e, f = (np.sum(x * y, axis=-1) for x, y in ((u, u), (v, v), (v, r)))
    b, c = np.sum(u * v, axis=-1), np.sum(u * r, axis=-1)
    s = np.clip((b * f - c * e) / np.maximum(a * e - b * b, 1e-9), 0.0, 1.0)
    t = np.clip((b * s + f) / e, 0.0, 1.0)
    s = np.clip((b * t - c) / a, 0.0, 1.0)
    return s, np.clip((b * s + f) / e, 0.0, 1.0)


@pytest.fixture(scope="module")
def gaps() -> dict[str, dict[tuple[str, str], float]]:
    """Shape -> pair of the right hand's capsules -> distance between their surfaces, cm."""
    clip, _ = posed(np.array([shape.angles for shape in DISTINCT.values()]))
    shape = body.body_capsules(clip.skeleton)
    starts, ends = body.capsule_ends(shape, *kinematics.forward(clip))
    right = [
        c
        for c, (part, side) in enumerate(zip(shape.parts, shape.sides, strict=True))
        if side == "right" and part.removesuffix("Tip") in ("palm", *FINGERS)
    ]
    assert [shape.parts[c] for c in right[::4]] == ["palm"] * 5  # then the finger's three bones
    names = dict(zip(right, (f"{finger}{n}" for finger in hand.FINGERS for n in range(4)), strict=True))
    first, second = np.array(list(combinations(right, 2))).T
    u, v = ends - starts, ends - starts
    s, t = nearest(starts[:, first], u[:, first], starts[:, second], v[:, second])
    apart = starts[:, first] + s[..., None] * u[:, first] - starts[:, second] - t[..., None] * v[:, second]
    radii, taper = shape.radii[:, 0], np.diff(shape.radii, axis=1)[:, 0]
    gap = np.linalg.norm(apart, axis=-1) - radii[first] - s * taper[first] - radii[second] - t * taper[second]
    pairs = [(names[a], names[b]) for a, b in zip(first, second, strict=True)]
    return {
        shape.name: dict(zip(pairs, row.tolist(), strict=True))
        for shape, row in zip(DISTINCT.values(), gap, strict=True)
    }


def between(found: dict[tuple[str, str], float], a: str, b: str) -> float:
    return found[(a, b)] if (a, b) in found else found[(b, a)]


def attached(a: str, b: str) -> bool:
    """Whether two capsules share a joint or the thumb, so that they overlap at every angle."""
    (finger_a, bone_a), (finger_b, bone_b) = ((name[:-1], int(name[-1])) for name in (a, b))
    if 0 in (bone_a, bone_b) and bone_a + bone_b < 2:
        return True
    return finger_a == finger_b and (abs(bone_a - bone_b) == 1 or finger_a == "Thumb")


def test_all_letters_digits_and_variants_are_there() -> None:
    letters_and_digits = [*"ABCDEFGHIJKLMNOPQRSTUVWXYZ", *"0123456789", "10"]
    variants = ["B-open", "B-bent", "5-claw", "C-small", "C-flat", "O-flat", "O-small", "V-bent", "L-bent"]
    others = ["ILY", "horns", "8-open", "3-claw", "E-open", "G-closed", "X-open", "hook", "rest", "index", "thumb"]
    assert {*letters_and_digits, *variants, *others} <= set(HANDSHAPES)
    assert len(DISTINCT) >= 48
    assert all(name == shape.name for name, shape in HANDSHAPES.items())
    assert len({name.casefold() for name in HANDSHAPES}) == len(HANDSHAPES)


def test_all_angles_are_within_their_limits() -> None:
    outside = [
        (name, joint)
        for name, shape in HANDSHAPES.items()
        for joint, angle, (low, high) in zip(hand.ANGLES, shape.angles, hand.LIMITS, strict=True)
        if not low - 1e-9 <= angle <= high + 1e-9
    ]
    assert outside == []
    assert not any(shape.angles.flags.writeable for shape in HANDSHAPES.values())


@pytest.mark.parametrize(("name", "fingers"), MEET.items())
def test_fingertips_meet(gaps: dict[str, dict[tuple[str, str], float]], name: str, fingers: tuple[str, str]) -> None:
    assert abs(between(gaps[name], *(f"{finger}3" for finger in fingers))) < CONTACT


@pytest.mark.parametrize(("name", "capsules"), REST_ON.items())
def test_bones_touch(gaps: dict[str, dict[tuple[str, str], float]], name: str, capsules: tuple[str, str]) -> None:
    assert abs(between(gaps[name], *capsules)) < CONTACT


@pytest.mark.parametrize("name", ["C", "C-small", "C-flat", "F-open", "E-open", "X-open", "5", "L", "G"])
def test_open_shapes_stay_open(gaps: dict[str, dict[tuple[str, str], float]], name: str) -> None:
    assert between(gaps[name], "Thumb3", "Index3") > 0.5


def test_no_finger_passes_through_another(gaps: dict[str, dict[tuple[str, str], float]]) -> None:
    inside = {
        (shape, *pair): f"{10.0 * gap:.1f} mm"
        for shape, found in gaps.items()
        for pair, gap in found.items()
        if not attached(*pair) and gap < -(INSIDE_PALM if any(bone.endswith("0") for bone in pair) else INSIDE_FINGER)
    }
    assert inside == {}


def test_every_two_shapes_differ() -> None:
    for a, b in combinations(DISTINCT.values(), 2):
        apart = np.linalg.norm(a.points - b.points, axis=-1)
        assert apart.max() > UNLIKE, f"{a.name} and {b.name}"


def any_angles(seed: int, *size: int) -> FloatArray:
    """Angles (*size, 21) anywhere within the limits."""
    low, high = hand.LIMITS.T
    return np.asarray(low + (high - low) * np.random.default_rng(seed).random((*size, len(hand.ANGLES))))


def test_points_are_those_of_forward_kinematics() -> None:
    angles = any_angles(1, 20)
    clip, joints = posed(angles)
    rotations, positions = kinematics.forward(clip)
    wrist = positions[:, clip.skeleton.index["mixamorig:RightHand"], None]
    tips = kinematics.tip_positions(clip, rotations, positions)
    order = [[site.joint for site in clip.skeleton.end_sites].index(joint) for joint in joints[2::3]]
    expected = np.concatenate([positions[:, joints], tips[:, order]], axis=1) - wrist
    np.testing.assert_allclose(hand.points(angles), expected, atol=1e-9)


def test_rotations_are_unit_and_smooth_and_batches_equal_single_calls() -> None:
    angles = any_angles(2, 6, 5)
    q, points = hand.rotations(angles), hand.points(angles)
    assert q.shape == (6, 5, 15, 4)
    assert points.shape == (6, 5, len(hand.POINTS), 3)
    np.testing.assert_allclose(np.linalg.norm(q, axis=-1), 1.0, atol=1e-12)
    for n in np.ndindex(6, 5):
        np.testing.assert_array_equal(hand.rotations(angles[n]), q[n])
        np.testing.assert_allclose(hand.points(angles[n]), points[n], atol=1e-12)
    direction, h = np.random.default_rng(3).normal(size=21), 1e-3
    bend = (hand.rotations(angles + h * direction) - 2.0 * q + hand.rotations(angles - h * direction)) / h**2
    assert np.abs(bend).max() < direction @ direction  # a second derivative, not a jump


def test_angles_move_the_hand_as_their_names_promise() -> None:
    assert np.array_equal(hand.rotations(np.zeros(21)), np.tile(rotation.IDENTITY, (15, 1)))
    rest = hand.points(np.zeros(21))

    def moved(angle: str, point: str) -> FloatArray:
        angles = np.zeros(21)
        angles[hand.ANGLES.index(angle)] = 0.2
        n = hand.POINTS.index(point)
        return np.asarray(hand.points(angles)[n] - rest[n])

    for finger, side in (("Index", 1.0), ("Middle", 1.0), ("Ring", -1.0), ("Pinky", -1.0)):
        for joint in ("mcp", "pip", "dip"):
            assert moved(f"{finger}-{joint}", f"{finger}Tip")[1] < -0.1  # to the palm
        assert side * moved(f"{finger}-spread", f"{finger}Tip")[2] > 0.5
    assert moved("Thumb-flexion", "ThumbTip")[2] < -0.5  # to the little finger's side
    assert moved("Thumb-abduction", "ThumbTip")[1] < -0.5  # out of the palm
    for joint in ("mcp", "ip"):
        assert moved(f"Thumb-{joint}", "ThumbTip")[2] < -0.1
    np.testing.assert_allclose(moved("Thumb-opposition", "ThumbTip"), 0.0, atol=1e-12)  # rotates about its own bone
