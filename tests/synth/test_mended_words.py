"""Words and letters whose hands, seen on the signer, are where dictionaries describe them: place, contact, direction.

Positions are (out, up, forward) from the chest joint, cm, of the standard signer in plain motion.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest

from signing import seen_from_chest, sign
from signsplice.motion import FloatArray
from signsplice.signer import hand, planner, pose
from signsplice.signer.locations import body_locations
from signsplice.signer.planner import FPS
from signsplice.signer.signer import PLAIN, STANDARD
from signsplice.signer.timing import Events

SIGNER = replace(STANDARD, manner=PLAIN)
OUT_UP_FORWARD = np.array([-1.0, 1.0, 1.0])
BODY = {name: place.point * OUT_UP_FORWARD for name, place in body_locations(SIGNER).items()}
UP, FORWARD = np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Hands:
    """A word's hands and the weak elbow (T, 3): points (T, 21, 3) of the strong and the weak hand, ``hand.POINTS`` and
    then the wrist.
    """

    strong: FloatArray
    weak: FloatArray
    weak_elbow: FloatArray
    events: Events

    def at(self, frame: int, name: str, weak: bool = False) -> FloatArray:
        points = self.weak if weak else self.strong
        return np.asarray(points[frame, hand.POINTS.index(name) if name in hand.POINTS else -1])


@cache
def hands(gloss: str) -> Hands:
    one = planner.synthesize_word(sign(gloss), SIGNER)
    rotations, positions = seen_from_chest(one.clip, "RightHand", "LeftHand", "LeftForeArm")
    strong, weak = (
        np.einsum("tab,tnb->tna", rotations[:, k], hand.points(pose.hands(one.states)[:, k, pose.FINGERS]) * mirror)
        for k, mirror in ((0, np.ones(3)), (1, np.array([-1.0, 1.0, 1.0])))
    )
    strong, weak = (np.pad(p, ((0, 0), (0, 1), (0, 0))) + positions[:, k, None] for k, p in enumerate((strong, weak)))
    return Hands(strong * OUT_UP_FORWARD, weak * OUT_UP_FORWARD, positions[:, 2] * OUT_UP_FORWARD, one.events)


def off(h: Hands, frame: int, bone: str, direction: FloatArray, weak: bool = False) -> float:
    """Angle of a finger, from its named joint to its tip, off a direction, degrees."""
    v = h.at(frame, f"{bone[:-1]}Tip", weak) - h.at(frame, bone, weak)
    return float(np.rad2deg(np.arccos(np.clip(v @ direction / np.linalg.norm(v) / np.linalg.norm(direction), -1, 1))))


def from_place(h: Hands, frame: int, tip: str, place: str, weak: bool = False) -> float:
    """Distance of a fingertip from a place of the body."""
    return float(np.linalg.norm(h.at(frame, tip, weak) - BODY[place]))


def off_back(h: Hands, frame: int, place: str) -> float:
    """The index finger's angle off backwards; 180 where its tip does not touch the place."""
    return off(h, frame, "Index2", -FORWARD) if from_place(h, frame, "IndexTip", place) < 1.5 else 180.0


def crossing(h: Hands) -> float:
    """How far both index fingers reach beyond the point where they touch in the first posture; -1 where they do not."""
    share = np.linspace(0.0, 1.0, 50)[:, None]
    roots, tips = (np.array([h.at(h.events.start, name, w) for w in (False, True)]) for name in ("Index1", "IndexTip"))
    one, two = (roots[k] + share * (tips[k] - roots[k]) for k in (0, 1))
    distance = np.linalg.norm(one[:, None] - two[None], axis=-1)
    i, j = np.unravel_index(distance.argmin(), distance.shape)
    beyond = min(np.linalg.norm(one[i] - tips[0]), np.linalg.norm(two[j] - tips[1]))
    return float(beyond) if distance.min() < 2.3 else -1.0


def legs(h: Hands) -> float:
    """The larger angle of the last bones of index and middle finger off the vertical, last posture."""
    return max(off(h, h.events.end, f"{finger}2", -UP) for finger in ("Index", "Middle"))


def above_weak_arm(h: Hands) -> float:
    """How far above the weak forearm the strong wrist is in the last posture."""
    e = h.events.end
    elbow, wrist, strong = h.weak_elbow[e], h.at(e, "Wrist", True), h.at(e, "Wrist")
    share = np.clip((strong - elbow)[0] / (wrist - elbow)[0], 0.0, 1.0)
    return float(strong[1] - (elbow + share * (wrist - elbow))[1])


def repeated(h: Hands) -> float:
    """Seconds from the first pass to the last one; 0 where there is but one."""
    passes = h.events.passes
    return (passes[-1][1] - passes[0][0]) / FPS if len(passes) > 1 else 0.0


def first_outward(h: Hands) -> float:
    """How far outward the strong wrist goes in the first two frames."""
    return float(np.diff(h.strong[[h.events.start, h.events.start + 2], -1, 0])[0])


def rise(h: Hands) -> float:
    """How far both wrists rise; the lesser of the two."""
    return min(float(h.at(h.events.end, "Wrist", w)[1] - h.at(h.events.start, "Wrist", w)[1]) for w in (False, True))


def curl(h: Hands) -> float:
    """How far the middle fingertip ends above its lowest place."""
    heights = h.strong[h.events.start : h.events.end + 1, hand.POINTS.index("MiddleTip"), 1]
    return float(heights[-1] - heights.min())


def thumb_off_index(h: Hands) -> float:
    """Angle between thumb and index finger at the end of the first pass."""
    frame = h.events.passes[0][1]
    return off(h, frame, "Thumb2", h.at(frame, "IndexTip") - h.at(frame, "Index1"))


def hanging(h: Hands) -> float:
    """How far below the weak index fingertip the strong one is in the last posture."""
    return float((h.at(h.events.end, "IndexTip", True) - h.at(h.events.end, "IndexTip"))[1])


MENDED: list[tuple[str, str, Callable[[Hands], float], float, float]] = [
    ("PHONE", "thumb from ear", lambda h: from_place(h, h.events.end, "ThumbTip", "ear"), 0.0, 5.0),
    ("PHONE", "little finger from mouth", lambda h: from_place(h, h.events.end, "PinkyTip", "mouth"), 0.0, 10.0),
    ("I", "off back", lambda h: off_back(h, h.events.end, "chest"), 0.0, 15.0),
    ("WE", "off back first", lambda h: off_back(h, h.events.start, "chest-strong"), 0.0, 15.0),
    ("WE", "off back last", lambda h: off_back(h, h.events.end, "heart"), 0.0, 15.0),
    ("HE-SHE", "off forward", lambda h: off(h, h.events.end, "Index1", FORWARD), 50.0, 90.0),
    ("BIRD", "off forward", lambda h: off(h, h.events.passes[0][1], "Index1", FORWARD), 0.0, 40.0),
    ("fs-P", "middle finger off down", lambda h: off(h, h.events.end, "Middle1", -UP), 0.0, 20.0),
    ("fs-Q", "index finger off down", lambda h: off(h, h.events.end, "Index2", -UP), 0.0, 20.0),
    ("fs-Q", "thumb off down", lambda h: off(h, h.events.end, "Thumb2", -UP), 0.0, 30.0),
    ("READ", "seconds", repeated, 0.35, 1.5),
    ("FEEL", "seconds", repeated, 0.35, 1.5),
    ("TASTE", "seconds", repeated, 0.35, 1.5),
    ("PLEASE", "first outward", first_outward, -9.0, -0.3),
    ("SORRY", "first outward", first_outward, -9.0, -0.3),
    ("DAY", "above the weak arm", above_weak_arm, 2.0, 9.0),
    ("STAND", "legs off vertical", legs, 0.0, 15.0),
    ("DANCE", "legs off vertical", legs, 0.0, 15.0),
    ("PROUD", "thumb off down first", lambda h: off(h, h.events.start, "Thumb2", -UP), 0.0, 25.0),
    ("PROUD", "thumb off down last", lambda h: off(h, h.events.end, "Thumb2", -UP), 0.0, 25.0),
    ("DIFFERENT", "beyond the crossing", crossing, 1.5, 8.0),
    ("RESPONSIBLE", "strong hand", lambda h: from_place(h, h.events.end, "IndexTip", "shoulder"), 0.0, 6.0),
    ("RESPONSIBLE", "weak hand", lambda h: from_place(h, h.events.end, "IndexTip", "shoulder", True), 0.0, 8.0),
    ("GIRAFFE", "above the head", lambda h: h.strong[h.events.end, :20, 1].min() - BODY["crown"][1], 0.0, 20.0),
    ("ANGRY", "rise of both", rise, 10.0, 40.0),
    ("ANGRY", "from", lambda h: h.strong[h.events.start, :, 1].max() - BODY["chest"][1], -40.0, 0.0),
    ("ELEPHANT", "the end curls up", curl, 5.0, 30.0),
    ("DOG", "thumb off index finger", thumb_off_index, 0.0, 45.0),
    ("SIT", "fingers hang", hanging, 0.5, 8.0),
]


@pytest.mark.parametrize(
    ("gloss", "measure", "low", "high"), [(g, *row) for g, _, *row in MENDED], ids=[f"{g}: {w}" for g, w, *_ in MENDED]
)
def test_a_word_looks_as_it_is_described(
    gloss: str, measure: Callable[[Hands], float], low: float, high: float
) -> None:
    assert low <= measure(hands(gloss)) <= high
