"""Places lie on the skin, their way leads out of it, and the part of the hand asked for is brought there."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from signing import seen_from_chest, who
from signsplice.body import capsules, collision
from signsplice.motion import kinematics
from signsplice.motion.clip import Clip
from signsplice.synth import hand, locations, planner, pose
from signsplice.synth.handshapes import HANDSHAPES
from signsplice.synth.phonology import DIRECTIONS, IN_SPACE, LOCATIONS, ON_BASE, PARTS, Posture, Vector
from signsplice.synth.signer import JOINTS, STANDARD, Signer, skeleton

Float = NDArray[np.float64]

SEEDS = (None, 1, 3, 7, 13)
SOLID = ("face", "hair", "nose", "neck", "shirt")
ON_ARM = ("upper-arm-weak", "elbow-weak", "forearm-weak")
ON_BODY = [place for place in LOCATIONS if place not in IN_SPACE and place not in ON_BASE and place not in ON_ARM]
BASE = Posture("B-open", "space-mid", "palm", (0.0, 1.0, 0.0), (-0.4, 0.0, 0.9))


def right_handed(seed: int | None) -> Signer:
    return replace(who(seed), left_handed=False)


Axes = tuple[Float, Float]
"""Points (400, K, 3) all along the axes of K capsules, and the radii (400, K) there."""


@cache
def solid(body: Signer) -> Axes:
    """Head and trunk in T-pose, from the chest joint."""
    shape, rest = capsules.body_capsules(skeleton(body)), kinematics.rest_positions(skeleton(body))
    chosen = [n for n, part in enumerate(shape.parts) if part in SOLID]
    starts, ends = (rest[shape.joints[chosen]] + x[chosen] - rest[JOINTS["Spine2"]] for x in (shape.starts, shape.ends))
    return along(starts, ends, shape.radii[chosen])


def along(starts: Float, ends: Float, radii: Float) -> Axes:
    u = np.linspace(0.0, 1.0, 400)[:, None, None]
    return starts + u * (ends - starts), radii[:, 0] + u[..., 0] * (radii[:, 1] - radii[:, 0])


def height(points: Float, axes: Axes, bulging: bool = False) -> Float:
    """Distance of points (N, 3) from the skin, by trying points of every axis: the nearest one with its radius, as
    ``motion.contact`` has it, or (bulging) every one, as tapered capsules are seen.
    """
    distance = np.linalg.norm(points[:, None, None] - axes[0], axis=-1)
    if bulging:
        return np.asarray((distance - axes[1]).min(axis=(1, 2)))
    nearest = distance.argmin(axis=1)[:, None]
    thick = np.take_along_axis(np.broadcast_to(axes[1], distance.shape), nearest, axis=1)
    return np.asarray((np.take_along_axis(distance, nearest, axis=1) - thick).min(axis=(1, 2)))


@pytest.mark.parametrize("seed", SEEDS)
def test_places_on_the_body_lie_on_its_skin_and_lead_out(seed: int | None) -> None:
    body = right_handed(seed)
    known = locations.body_locations(body)
    assert set(known) == set(ON_BODY)
    points, ways = (np.array([getattr(place, what) for place in known.values()]) for what in ("point", "out"))
    assert np.allclose(np.linalg.norm(ways, axis=-1), 1.0)
    axes = solid(body)
    assert np.abs(height(points, axes)).max() < 0.05
    for step in (0.5, 1.0):
        rise = height(points + step * ways, axes)
        assert (rise > 0.4 * step).all(), dict(zip(known, rise, strict=True))
    assert (height(points - 0.5 * ways, axes) < -0.2).all()
    assert np.abs(height(points, axes, bulging=True)).max() < 1.2, "lips and chin, which taper much, bulge over theirs"


def test_places_are_where_their_names_say() -> None:
    known = {name: place.point for name, place in locations.body_locations(STANDARD).items()}
    out, up, fwd = (
        {name: float(sign * p[axis]) for name, p in known.items()} for axis, sign in ((0, -1), (1, 1), (2, 1))
    )
    order = ("crown", "forehead", "eye", "nose", "mouth", "chin", "throat", "shoulder", "chest", "belly")
    assert [up[name] for name in order] == sorted((up[name] for name in order), reverse=True)
    for name in ("temple", "eye", "ear", "cheek", "mouth-corner", "jaw", "shoulder", "chest-strong", "waist"):
        assert out[name] > 1.0, name
    for name in ("cheek-weak", "chin-weak", "shoulder-weak", "heart", "waist-weak"):
        assert out[name] < -1.0, name
    for one, two in (("cheek", "cheek-weak"), ("waist", "waist-weak")):
        assert np.allclose(known[one] * [-1, 1, 1], known[two], atol=0.05)
    assert fwd["nose"] == max(fwd[name] for name in order)
    assert up["under-chin"] < up["chin"]


@pytest.mark.parametrize("seed", SEEDS)
def test_places_grow_with_the_body(seed: int | None) -> None:
    body = right_handed(seed)
    plain = Signer(stature_cm=body.stature_cm)
    usual = locations.body_locations(STANDARD)
    for name, place in locations.body_locations(plain).items():
        assert np.allclose(place.point, usual[name].point * plain.scale, atol=0.02), name


# --- the part at the place


def centre(clip: Clip, side: str, names: tuple[str, ...]) -> Float:
    """The mean (T, 3) of joints and tips of a hand in the chest's axes, from forward kinematics."""
    turns, at = kinematics.forward(clip)
    tips = kinematics.tip_positions(clip, turns, at)
    sites = {clip.skeleton.names[site.joint]: n for n, site in enumerate(clip.skeleton.end_sites)}
    points = []
    for name in names:
        if name == "Wrist":
            points.append(at[:, JOINTS[f"{side}Hand"]])
        elif name.endswith("Tip"):
            points.append(tips[:, sites[f"mixamorig:{side}Hand{name.removesuffix('Tip')}3"]])
        else:
            points.append(at[:, JOINTS[f"{side}Hand{name}"]])
    chest, axes = at[:, JOINTS["Spine2"]], turns[:, JOINTS["Spine2"]]
    return np.asarray(np.einsum("tba,tb->ta", axes, np.mean(points, axis=0) - chest))


def clip_of(strong: Float, weak: Float, body: Signer) -> Clip:
    return pose.clip(np.concatenate([strong, weak, np.zeros(9)])[None], body, 30.0)


def unlimited(numbers: Float, body: Signer) -> bool:
    """Whether no limit of wrist, forearm or reach is near, so that the hand is where and as its numbers say."""
    arm = pose.reach(numbers[pose.WRIST], body)
    wrist = pose.wrist_angles(arm, numbers[pose.TURN], body)
    (low_side, high_side), (low_bent, high_bent) = pose.WRIST_LIMITS
    return bool(
        0.64 < arm.bend < 2.45
        and low_side + 0.15 < wrist.deviation < high_side - 0.15
        and low_bent + 0.15 < wrist.flexion < high_bent - 0.15
        and abs(wrist.turn) < pose.FOREARM_LIMIT - 0.15
    )


@cache
def easy_ways(place: str, part: str, shape: str) -> tuple[Vector, Vector]:
    """Which way palm and fingers can face, so that every signer's limits leave a part at a place as it was asked."""
    for palm in DIRECTIONS.values():
        for fingers in (*DIRECTIONS.values(), *MORE):
            if abs(sum(x * y for x, y in zip(palm, fingers, strict=True))) > 0.8:
                continue
            for seed, off in ((None, 0.0), (None, 5.0), *((seed, 0.0) for seed in SEEDS[1:])):
                body = right_handed(seed)
                numbers = locations.strong(Posture(shape, place, part, palm, fingers, off), body, np.zeros(27))
                if not unlimited(numbers, body):
                    break
            else:
                return palm, fingers
    raise AssertionError(f"{part} at {place}: no easy way")


_S = float(np.sqrt(0.5))
MORE = ((-_S, _S, 0.0), (-_S, 0.0, -_S), (-_S, 0.0, _S), (0.0, _S, _S), (0.0, _S, -_S))
PART_AT = {
    "palm": ("Wrist", "Index1", "Middle1", "Middle1", "Ring1"),
    "thumb": ("ThumbTip",),
    "index": ("IndexTip",),
    "pinky": ("PinkyTip",),
    "tips": ("IndexTip", "MiddleTip"),
    "radial": ("Index1",),
    "pinch": ("IndexTip", "ThumbTip"),
}
"""Of which joints and tips a part is the middle, written once more."""
HALF_THICK = {"palm": 1.45, "thumb": 0.95, "index": 0.82, "pinky": 0.7, "tips": 0.82, "radial": 1.2, "pinch": 0.88}
"""How far its skin is from there, cm of the standard hand."""


HOLLOW = ("mouth", "mouth-corner", "chin-weak", "throat", "under-chin", "eye")
CRAMPED = ("shoulder", "chest-strong")
"""So near to the arm's own shoulder that elbow and wrist are at their limits."""


@pytest.mark.parametrize("place", [place for place in ON_BODY if place not in CRAMPED])
@pytest.mark.parametrize("part", ["index", "palm", "thumb"])
def test_the_part_is_brought_to_the_place_and_so_far_off_it(place: str, part: str) -> None:
    ways = easy_ways(place, part, "B-open")
    weak = planner.resting(STANDARD)[27:54]
    for off in (0.0, 2.0, 5.0):
        strong = locations.strong(Posture("B-open", place, part, *ways, off=off), STANDARD, weak)
        at = centre(clip_of(strong, weak, STANDARD), "Right", PART_AT[part])[0]
        known = locations.body_locations(STANDARD)[place]
        assert np.allclose(at, known.point + (HALF_THICK[part] + off) * known.out, atol=0.02)
        skin = height(at[None], solid(STANDARD))[0] - HALF_THICK[part]
        if place in HOLLOW:
            assert -1.0 < skin < off + 0.15, "the nose over the mouth, the chin over the throat are nearer"
        else:
            assert skin == pytest.approx(off, abs=0.4 + 0.1 * off)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("part", list(PART_AT))
def test_every_signer_touches_the_same_place_with_the_same_part(seed: int | None, part: str) -> None:
    body = right_handed(seed)
    weak = planner.resting(body)[27:54]
    for place in ("chin", "chest", "temple"):
        strong = locations.strong(Posture("5", place, part, *easy_ways(place, part, "5")), body, weak)
        at = centre(clip_of(strong, weak, body), "Right", PART_AT[part])
        thick = HALF_THICK[part] * body.hands * body.scale
        assert height(at, solid(body))[0] == pytest.approx(thick, abs=0.5), place
        strong = locations.strong(Posture("5", place, part, *easy_ways(place, part, "5"), off=1.5), body, weak)
        known = locations.body_locations(body)[place]
        off = centre(clip_of(strong, weak, body), "Right", PART_AT[part])[0] - known.point
        assert np.allclose(off, (thick + 1.5 * body.scale) * known.out, atol=0.02), "off grows with the body"


@pytest.mark.parametrize("place", [p for p in sorted(ON_BASE) if p != "forearm-weak"])
@pytest.mark.parametrize("seed", [None, 3])
def test_places_on_the_base_hand_touch_it(place: str, seed: int | None) -> None:
    body = right_handed(seed)
    weak = locations.weak(BASE, body)
    clip = clip_of(weak, weak, body)
    shape = collision.known_capsules(clip.skeleton)
    starts, ends = capsules.capsule_ends(shape, *kinematics.forward(clip))
    left = [n for n, (part, side) in enumerate(zip(shape.parts, shape.sides, strict=True)) if side == "left"]
    left = [n for n in left if shape.parts[n] not in ("sleeve", "leg", "shoe", "Thumb", "ThumbTip")]
    chest = kinematics.forward(clip)[1][0, JOINTS["Spine2"]]
    axes = along(starts[0, left] - chest, ends[0, left] - chest, shape.radii[left])
    found = locations._place(replace(BASE, place=place), body, weak)
    bent = place in ("base-wrist", "base-heel")
    assert abs(height(found.point[None], axes)[0]) < (1.6 if bent else 0.7), "on the skin; a bent wrist is thicker"
    inner, outer = height(found.point + np.outer([0.5, 3.0], found.out), axes)
    assert inner - 0.5 < height(found.point[None], axes)[0] + 1e-6
    assert outer > inner + 0.8, "and out of it"
    assert outer > (0.5 if bent else 1.2)


def test_a_base_hand_that_moves_takes_its_places_with_it() -> None:
    posture = Posture("5-claw", "base-palm", "fingertips", DIRECTIONS["down"], (-_S, 0.0, _S))
    here = locations.weak(BASE, STANDARD)
    there = locations.weak(replace(BASE, shift=(0.0, 4.0, 3.0)), STANDARD)
    ends = [f"{finger}Tip" for finger in hand.FINGERS[1:]]
    one, two = (
        centre(clip_of(locations.strong(posture, STANDARD, w), w, STANDARD), "Right", tuple(ends))[0]
        for w in (here, there)
    )
    assert np.allclose(two - one, [0.0, 4.0, 3.0], atol=0.4), "but for the strong wrist's limits"


@pytest.mark.parametrize("place", ON_ARM)
def test_places_on_the_weak_arm_lie_on_its_sleeve(place: str) -> None:
    weak = locations.weak(BASE, STANDARD)
    clip = clip_of(weak, weak, STANDARD)
    shape = collision.known_capsules(clip.skeleton)
    starts, ends = capsules.capsule_ends(shape, *kinematics.forward(clip))
    arm = [n for n, part in enumerate(shape.parts) if part in ("sleeve", "cuff") and shape.sides[n] == "left"]
    chest = kinematics.forward(clip)[1][0, JOINTS["Spine2"]]
    axes = along(starts[0, arm] - chest, ends[0, arm] - chest, shape.radii[arm])
    found = locations._place(replace(BASE, place=place), STANDARD, weak)
    assert abs(height(found.point[None], axes)[0]) < 0.3
    assert height((found.point + 2.0 * found.out)[None], axes)[0] > 1.5
    assert found.point[0] > 5.0, "the left arm's"


def test_mirrored_hands_meet_on_the_midline() -> None:
    """At a place on the midline, the part of each hand is half the gap from it; a hand alone is right on it."""
    gaps = []
    for off in (0.0, 3.0):
        posture = Posture("B-open", "space-mid", "palm", DIRECTIONS["in"], (0.0, _S, _S), off=off)
        both = locations.strong(posture, STANDARD, np.zeros(27), meets=True)
        clip = clip_of(both, both, STANDARD)
        starts, ends = capsules.capsule_ends(collision.known_capsules(clip.skeleton), *kinematics.forward(clip))
        known = collision.capsule_groups(collision.known_capsules(clip.skeleton))
        radii = collision.known_capsules(clip.skeleton).radii
        gaps.append(-collision.overlap(starts, ends, radii, known.left, known.right)[0].max())
        assert centre(clip, "Right", PART_AT["palm"])[0, 0] == pytest.approx(-HALF_THICK["palm"] - off, abs=1e-6)
        alone = locations.strong(posture, STANDARD, np.zeros(27), meets=False)
        assert centre(clip_of(alone, alone, STANDARD), "Right", PART_AT["palm"])[0, 0] == pytest.approx(0.0, abs=0.05)
    assert gaps[1] - gaps[0] == pytest.approx(6.0, abs=1e-6)


def test_shifts_are_out_up_and_forward_and_grow_with_body_and_manner() -> None:
    posture = Posture("B", "space", "palm", DIRECTIONS["in"], (0.0, _S, _S))
    body = Signer(stature_cm=187.0)

    def palm(p: Posture, who_: Signer, size: float = 1.0) -> Float:
        numbers = locations.strong(p, who_, np.zeros(27), size=size)
        return np.asarray(centre(clip_of(numbers, numbers, who_), "Right", PART_AT["palm"])[0])

    shifted = replace(posture, shift=(2.0, 3.0, 4.0))
    assert np.allclose(palm(shifted, STANDARD) - palm(posture, STANDARD), [-2.0, 3.0, 4.0], atol=1e-6)
    assert np.allclose(palm(shifted, body, 1.3) - palm(posture, body, 1.3), np.array([-2.0, 3.0, 4.0]) * 1.1 * 1.3)
    assert np.allclose(palm(posture, body), palm(posture, STANDARD) * 1.1)


def test_the_hand_faces_as_the_posture_says() -> None:
    posture = Posture("B", "space", "palm", DIRECTIONS["in"], (0.0, _S, _S))
    numbers = locations.strong(posture, STANDARD, np.zeros(27))
    turns, _ = seen_from_chest(clip_of(numbers, numbers, STANDARD), "RightHand")
    assert np.allclose(turns[0, 0] @ [-1.0, 0.0, 0.0], [0.0, _S, _S], atol=1e-6), "fingers up and forward"
    assert np.allclose(turns[0, 0] @ [0.0, -1.0, 0.0], [1.0, 0.0, 0.0], atol=1e-6), "palm to the left"


@pytest.mark.parametrize("place", list(LOCATIONS))
def test_every_place_and_every_part_is_served(place: str) -> None:
    weak = locations.weak(BASE, STANDARD)
    seen = set()
    for part in PARTS:
        posture = Posture("V", place, part, (0.0, 0.0, 1.0), (0.0, 1.0, 0.0))
        numbers = locations.strong(posture, STANDARD, weak)
        assert numbers.shape == (27,)
        assert np.isfinite(numbers).all()
        assert np.array_equal(numbers[pose.FINGERS], HANDSHAPES["V"].angles)
        seen.add(numbers[:3].tobytes())
    assert len(seen) > len(PARTS) - 3, "each part brings the hand elsewhere, but for the two sides of a palm"


def test_parts_of_a_hand_are_points_of_it() -> None:
    points = hand.points(HANDSHAPES["5"].angles)
    assert np.allclose(locations.part_of(points, ("IndexTip",)), points[hand.POINTS.index("IndexTip")])
    assert np.allclose(locations.part_of(points, ("Wrist", "Middle1")), 0.5 * points[hand.POINTS.index("Middle1")])
