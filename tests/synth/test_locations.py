"""Locations on the body lie on its skin, and a posture brings the right part of the hand to them."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from signing import seen_from_chest, signer_of
from signsplice.body import capsules, collision
from signsplice.motion import Clip, FloatArray, kinematics
from signsplice.signer import hand, locations, pose
from signsplice.signer.hand import HandPart, hand_part
from signsplice.signer.handshapes import HANDSHAPES
from signsplice.signer.locations import WeakArm, resting
from signsplice.signer.phonology import DIRECTIONS, IN_SPACE, LOCATIONS, ON_BASE, PARTS, Posture
from signsplice.signer.signer import JOINTS, STANDARD, Signer, skeleton
from signsplice.signer.tables import Vector

SEEDS = (None, 1, 3, 7, 13)
SOLID = ("face", "hair", "nose", "neck", "shirt")
ON_ARM = ("upper-arm-weak", "elbow-weak", "forearm-weak")
ON_BODY = [name for name in LOCATIONS if name not in IN_SPACE and name not in ON_BASE and name not in ON_ARM]
BASE = Posture("B-open", "space-mid", "palm", (0.0, 1.0, 0.0), (-0.4, 0.0, 0.9))
S = float(np.sqrt(0.5))


def right_handed(seed: int | None) -> Signer:
    return replace(signer_of(seed), left_handed=False)


def no_arm(signer: Signer = STANDARD) -> WeakArm:
    """A weak arm for postures that do not depend on it."""
    return WeakArm(signer, np.zeros(27))


Axes = tuple[FloatArray, FloatArray]
"""Points (400, K, 3) all along the axes of K capsules, and the radii (400, K) there."""


@cache
def solid(signer: Signer) -> Axes:
    """Head and trunk in the T-pose, from the chest joint."""
    shape, rest = capsules.body_capsules(skeleton(signer)), kinematics.rest_positions(skeleton(signer))
    chosen = [n for n, part in enumerate(shape.parts) if part in SOLID]
    starts, ends = (rest[shape.joints[chosen]] + x[chosen] - rest[JOINTS["Spine2"]] for x in (shape.starts, shape.ends))
    return along(starts, ends, shape.radii[chosen])


def along(starts: FloatArray, ends: FloatArray, radii: FloatArray) -> Axes:
    u = np.linspace(0.0, 1.0, 400)[:, None, None]
    return starts + u * (ends - starts), radii[:, 0] + u[..., 0] * (radii[:, 1] - radii[:, 0])


def height(points: FloatArray, axes: Axes, bulging: bool = False) -> FloatArray:
    """Distance of points (N, 3) from the skin, by trying points of every axis: the nearest one with its radius, as
    ``body.collision`` has it, or (bulging) every one, as tapered capsules are drawn.
    """
    distance = np.linalg.norm(points[:, None, None] - axes[0], axis=-1)
    if bulging:
        return np.asarray((distance - axes[1]).min(axis=(1, 2)))
    nearest = distance.argmin(axis=1)[:, None]
    thick = np.take_along_axis(np.broadcast_to(axes[1], distance.shape), nearest, axis=1)
    return np.asarray((np.take_along_axis(distance, nearest, axis=1) - thick).min(axis=(1, 2)))


@pytest.mark.parametrize("seed", SEEDS)
def test_body_locations_lie_on_the_skin_with_outward_normals(seed: int | None) -> None:
    signer = right_handed(seed)
    found = locations.body_locations(signer)
    assert set(found) == set(ON_BODY)
    points = np.array([location.point for location in found.values()])
    normals = np.array([location.normal for location in found.values()])
    assert np.allclose(np.linalg.norm(normals, axis=-1), 1.0)
    axes = solid(signer)
    assert np.abs(height(points, axes)).max() < 0.05
    for step in (0.5, 1.0):
        rise = height(points + step * normals, axes)
        assert (rise > 0.4 * step).all(), dict(zip(found, rise, strict=True))
    assert (height(points - 0.5 * normals, axes) < -0.2).all()
    assert np.abs(height(points, axes, bulging=True)).max() < 1.2, "lips and chin, which taper much, bulge over theirs"


def test_locations_are_where_their_names_put_them() -> None:
    points = {name: location.point for name, location in locations.body_locations(STANDARD).items()}
    out, up, fwd = (
        {name: float(sign * p[axis]) for name, p in points.items()} for axis, sign in ((0, -1), (1, 1), (2, 1))
    )
    order = ("crown", "forehead", "eye", "nose", "mouth", "chin", "throat", "shoulder", "chest", "belly")
    assert [up[name] for name in order] == sorted((up[name] for name in order), reverse=True)
    for name in ("temple", "eye", "ear", "cheek", "mouth-corner", "jaw", "shoulder", "chest-strong", "waist"):
        assert out[name] > 1.0, name
    for name in ("cheek-weak", "chin-weak", "shoulder-weak", "heart", "waist-weak"):
        assert out[name] < -1.0, name
    for one, two in (("cheek", "cheek-weak"), ("waist", "waist-weak")):
        assert np.allclose(points[one] * [-1, 1, 1], points[two], atol=0.05)
    assert fwd["nose"] == max(fwd[name] for name in order)
    assert up["under-chin"] < up["chin"]


@pytest.mark.parametrize("seed", SEEDS)
def test_locations_scale_with_the_body(seed: int | None) -> None:
    plain = Signer(stature_cm=right_handed(seed).stature_cm)
    usual = locations.body_locations(STANDARD)
    for name, location in locations.body_locations(plain).items():
        assert np.allclose(location.point, usual[name].point * plain.scale, atol=0.02), name


# --- the part at the location


def centre(clip: Clip, side: str, names: tuple[str, ...]) -> FloatArray:
    """The mean (T, 3) of joints and tips of a hand in the chest's axes, from forward kinematics."""
    rotations, positions = kinematics.forward(clip)
    tips = kinematics.tip_positions(clip, rotations, positions)
    sites = {clip.skeleton.names[site.joint]: n for n, site in enumerate(clip.skeleton.end_sites)}
    points = []
    for name in names:
        if name == "Wrist":
            points.append(positions[:, JOINTS[f"{side}Hand"]])
        elif name.endswith("Tip"):
            points.append(tips[:, sites[f"mixamorig:{side}Hand{name.removesuffix('Tip')}3"]])
        else:
            points.append(positions[:, JOINTS[f"{side}Hand{name}"]])
    chest, axes = positions[:, JOINTS["Spine2"]], rotations[:, JOINTS["Spine2"]]
    return np.asarray(np.einsum("tba,tb->ta", axes, np.mean(points, axis=0) - chest))


def clip_of(strong: FloatArray, weak: FloatArray, signer: Signer) -> Clip:
    return pose.clip(pose.of_hands(strong, weak)[None], signer, 30.0)


def unlimited(hand_state: FloatArray, signer: Signer) -> bool:
    """Whether no limit of wrist, forearm or reach is near, so that the hand is exactly as its state has it."""
    arm = pose.solve_arm(hand_state[pose.WRIST], signer)
    angles = pose.arm_angles(arm, hand_state[pose.ROTVEC], signer)
    (low_side, high_side), (low_bent, high_bent) = pose.WRIST_LIMITS
    return bool(
        0.64 < arm.bend < 2.45
        and low_side + 0.15 < angles.deviation < high_side - 0.15
        and low_bent + 0.15 < angles.flexion < high_bent - 0.15
        and abs(angles.twist) < pose.FOREARM_LIMIT - 0.15
    )


@cache
def easy_directions(location: str, part: str, shape: str) -> tuple[Vector, Vector]:
    """Directions of palm and fingers for which no signer's limits move a part away from a location."""
    for palm in DIRECTIONS.values():
        for fingers in (*DIRECTIONS.values(), *MORE):
            if abs(sum(x * y for x, y in zip(palm, fingers, strict=True))) > 0.8:
                continue
            for seed, off in ((None, 0.0), (None, 5.0), *((seed, 0.0) for seed in SEEDS[1:])):
                signer = right_handed(seed)
                posture = Posture(shape, location, part, palm, fingers, off)
                if not unlimited(locations.strong_hand(posture, no_arm(signer)), signer):
                    break
            else:
                return palm, fingers
    raise AssertionError(f"{part} at {location}: no easy directions")


MORE = ((-S, S, 0.0), (-S, 0.0, -S), (-S, 0.0, S), (0.0, S, S), (0.0, S, -S))
PART_JOINTS = {
    "palm": ("Wrist", "Index1", "Middle1", "Middle1", "Ring1"),
    "thumb": ("ThumbTip",),
    "index": ("IndexTip",),
    "pinky": ("PinkyTip",),
    "tips": ("IndexTip", "MiddleTip"),
    "radial": ("Index1",),
    "pinch": ("IndexTip", "ThumbTip"),
}
"""The joints and tips whose mean a part is, written once more."""
HALF_THICK = {"palm": 1.45, "thumb": 0.95, "index": 0.82, "pinky": 0.7, "tips": 0.82, "radial": 1.2, "pinch": 0.88}
"""Distance of the part's skin from there, cm of the standard hand."""


HOLLOW = ("mouth", "mouth-corner", "chin-weak", "throat", "under-chin", "eye")
CRAMPED = ("shoulder", "chest-strong")
"""So near to the arm's own shoulder that elbow and wrist are at their limits."""


@pytest.mark.parametrize("location", [name for name in ON_BODY if name not in CRAMPED])
@pytest.mark.parametrize("part", ["index", "palm", "thumb"])
def test_a_part_of_the_hand_is_at_its_distance_from_the_location(location: str, part: str) -> None:
    directions = easy_directions(location, part, "B-open")
    signer = right_handed(None)  # low elbows bend wrists more
    weak = WeakArm(signer, resting(signer)[27:54])
    for off in (0.0, 2.0, 5.0):
        strong = locations.strong_hand(Posture("B-open", location, part, *directions, off=off), weak)
        point = centre(clip_of(strong, weak.hand, signer), "Right", PART_JOINTS[part])[0]
        found = locations.body_locations(signer)[location]
        assert np.allclose(point, found.point + (HALF_THICK[part] + off) * found.normal, atol=0.02)
        skin = height(point[None], solid(signer))[0] - HALF_THICK[part]
        if location in HOLLOW:
            assert -1.0 < skin < off + 0.15, "the nose over the mouth, the chin over the throat are nearer"
        else:
            assert skin == pytest.approx(off, abs=0.4 + 0.1 * off)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("part", list(PART_JOINTS))
def test_every_signer_touches_the_location_with_the_same_part(seed: int | None, part: str) -> None:
    signer = right_handed(seed)
    weak = WeakArm(signer, resting(signer)[27:54])
    for location in ("chin", "chest", "temple"):
        directions = easy_directions(location, part, "5")
        strong = locations.strong_hand(Posture("5", location, part, *directions), weak)
        point = centre(clip_of(strong, weak.hand, signer), "Right", PART_JOINTS[part])
        thick = HALF_THICK[part] * signer.hands * signer.scale
        assert height(point, solid(signer))[0] == pytest.approx(thick, abs=0.5), location
        strong = locations.strong_hand(Posture("5", location, part, *directions, off=1.5), weak)
        found = locations.body_locations(signer)[location]
        off = centre(clip_of(strong, weak.hand, signer), "Right", PART_JOINTS[part])[0] - found.point
        assert np.allclose(off, (thick + 1.5 * signer.scale) * found.normal, atol=0.02), "off scales with the body"


def left_axes(clip: Clip, chosen: list[int]) -> Axes:
    """Axes of some capsules of a clip of one frame, from the chest joint."""
    shape = capsules.body_capsules(clip.skeleton)
    globals_ = kinematics.forward(clip)
    starts, ends = capsules.capsule_ends(shape, *globals_)
    chest = globals_[1][0, JOINTS["Spine2"]]
    return along(starts[0, chosen] - chest, ends[0, chosen] - chest, shape.radii[chosen])


@pytest.mark.parametrize("location", [name for name in sorted(ON_BASE) if name != "forearm-weak"])
@pytest.mark.parametrize("seed", [None, 3])
def test_locations_on_the_base_hand_lie_on_its_skin(location: str, seed: int | None) -> None:
    signer = right_handed(seed)
    weak = locations.weak_hand(BASE, signer)
    clip = clip_of(weak, weak, signer)
    shape = capsules.body_capsules(clip.skeleton)
    other = ("sleeve", "leg", "shoe", "Thumb", "ThumbTip")
    axes = left_axes(clip, [n for n, side in enumerate(shape.sides) if side == "left" and shape.parts[n] not in other])
    found = locations.locate(location, WeakArm(signer, weak))
    bent = location in ("base-wrist", "base-heel")
    assert abs(height(found.point[None], axes)[0]) < (1.6 if bent else 0.7), "on the skin; a bent wrist is thicker"
    inner, outer = height(found.point + np.outer([0.5, 3.0], found.normal), axes)
    assert inner - 0.5 < height(found.point[None], axes)[0] + 1e-6
    assert outer > inner + 0.8, "and the normal leads out of it"
    assert outer > (0.4 if bent else 1.2)


def test_a_base_hand_that_moves_takes_its_locations_with_it() -> None:
    posture = Posture("5-claw", "base-palm", "fingertips", DIRECTIONS["down"], (-S, 0.0, S))
    ends = tuple(f"{finger}Tip" for finger in hand.FINGERS[1:])
    one, two = (
        centre(clip_of(locations.strong_hand(posture, WeakArm(STANDARD, weak)), weak, STANDARD), "Right", ends)[0]
        for weak in (locations.weak_hand(replace(BASE, shift=s), STANDARD) for s in ((0.0, 0.0, 0.0), (0.0, 4.0, 3.0)))
    )
    assert np.allclose(two - one, [0.0, 4.0, 3.0], atol=0.4), "but for the strong wrist's limits"


@pytest.mark.parametrize("location", ON_ARM)
def test_locations_on_the_weak_arm_lie_on_its_sleeve(location: str) -> None:
    weak = locations.weak_hand(BASE, STANDARD)
    clip = clip_of(weak, weak, STANDARD)
    shape = capsules.body_capsules(clip.skeleton)
    sleeve = [n for n, part in enumerate(shape.parts) if part in ("sleeve", "cuff") and shape.sides[n] == "left"]
    axes = left_axes(clip, sleeve)
    found = locations.locate(location, WeakArm(STANDARD, weak))
    assert abs(height(found.point[None], axes)[0]) < 0.3
    assert height((found.point + 2.0 * found.normal)[None], axes)[0] > 1.5
    assert found.point[0] > 5.0, "the left arm's"


def test_mirrored_hands_meet_on_the_midline() -> None:
    """At a location on the midline, each hand is half the gap from it; one hand alone is exactly there."""
    gaps = []
    for off in (0.0, 3.0):
        posture = Posture("B-open", "space-mid", "palm", DIRECTIONS["in"], (0.0, S, S), off=off)
        both = locations.strong_hand(posture, no_arm(), meets=True)
        clip = clip_of(both, both, STANDARD)
        shape = capsules.body_capsules(clip.skeleton)
        starts, ends = capsules.capsule_ends(shape, *kinematics.forward(clip))
        depth = collision.overlap(starts, ends, shape.radii, shape.groups.left, shape.groups.right)[0]
        gaps.append(-depth.max())
        palm = centre(clip, "Right", PART_JOINTS["palm"])[0, 0]
        assert palm == pytest.approx(-HALF_THICK["palm"] - off, abs=1e-6)
        alone = locations.strong_hand(posture, no_arm(), meets=False)
        palm = centre(clip_of(alone, alone, STANDARD), "Right", PART_JOINTS["palm"])[0, 0]
        assert palm == pytest.approx(0.0, abs=0.05)
    assert gaps[1] - gaps[0] == pytest.approx(6.0, abs=1e-6)


def test_shifts_are_out_up_and_forward_and_scale_with_the_body() -> None:
    posture = Posture("B", "space", "palm", DIRECTIONS["in"], (0.0, S, S))
    tall = Signer(stature_cm=187.0)

    def palm(p: Posture, signer: Signer, size: float = 1.0) -> FloatArray:
        hand_state = locations.strong_hand(p, no_arm(signer), size=size)
        return np.asarray(centre(clip_of(hand_state, hand_state, signer), "Right", PART_JOINTS["palm"])[0])

    shifted = replace(posture, shift=(2.0, 3.0, 4.0))
    assert np.allclose(palm(shifted, STANDARD) - palm(posture, STANDARD), [-2.0, 3.0, 4.0], atol=1e-6)
    assert np.allclose(palm(shifted, tall, 1.3) - palm(posture, tall, 1.3), np.array([-2.0, 3.0, 4.0]) * 1.1 * 1.3)
    assert np.allclose(palm(posture, tall), palm(posture, STANDARD) * 1.1)


def test_palm_and_fingers_face_as_the_posture_has_them() -> None:
    posture = Posture("B", "space", "palm", DIRECTIONS["in"], (0.0, S, S))
    hand_state = locations.strong_hand(posture, no_arm())
    rotations, _ = seen_from_chest(clip_of(hand_state, hand_state, STANDARD), "RightHand")
    assert np.allclose(rotations[0, 0] @ [-1.0, 0.0, 0.0], [0.0, S, S], atol=1e-6), "fingers up and forward"
    assert np.allclose(rotations[0, 0] @ [0.0, -1.0, 0.0], [1.0, 0.0, 0.0], atol=1e-6), "palm to the left"


def test_every_part_can_be_at_every_location() -> None:
    weak = WeakArm(STANDARD, locations.weak_hand(BASE, STANDARD))
    for location in LOCATIONS:
        wrists = set()
        for part in PARTS:
            posture = Posture("V", location, part, (0.0, 0.0, 1.0), (0.0, 1.0, 0.0))
            hand_state = locations.strong_hand(posture, weak)
            assert hand_state.shape == (27,)
            assert np.isfinite(hand_state).all(), (location, part)
            assert np.array_equal(hand_state[pose.FINGERS], HANDSHAPES["V"].angles)
            wrists.add(hand_state[:3].tobytes())
        assert len(wrists) > len(PARTS) - 3, f"{location}: parts differ, but for the two sides of a palm"


def test_parts_of_a_hand_are_points_of_it() -> None:
    points = HANDSHAPES["5"].points
    assert np.array_equal(points, hand.points(HANDSHAPES["5"].angles))
    assert np.allclose(hand_part("index").centre(points), points[hand.POINTS.index("IndexTip")])
    assert np.allclose(
        HandPart(("Wrist", "Middle1"), 1.0, None).centre(points), 0.5 * points[hand.POINTS.index("Middle1")]
    )
