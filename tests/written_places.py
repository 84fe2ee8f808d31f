"""Where the places of gestural SiGML are on the standard body, for ``written_measures``: heights and distances of
docs/hamnosys.md, and on the head the anatomy of adults (Farkas 1994, Anthropometry of the Head and Face).
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass

import numpy as np

from signsplice.body.capsules import body_capsules
from signsplice.motion import FloatArray
from signsplice.motion.kinematics import rest_positions
from signsplice.signer.locations import body_locations
from signsplice.signer.signer import JOINTS, STANDARD, skeleton

HEIGHT = {"head": 33.0, "neck": 21.0, "shouldertop": 19.0, "shoulders": 14.0, "chest": 5.0, "stomach": -10.0,
          "belowstomach": -22.0}  # fmt: skip
"""Heights of places before the trunk and the head above the chest's joint, cm. All are heights, shouldertop too: NGT's
files write halfway of it and its right side.
"""
DEPTH = {"close": 25.0, "": 30.0, "armextended": 42.0}
"""How far in front of the chest's joint a hand is that is not on the skin, cm."""
CLOSE_TO_HEAD = 18.0
"""The same of one close to the head."""
ASIDE = {"head": 6.0, "neck": 6.0, "shouldertop": 15.0, "shoulders": 15.0}
TRUNK_ASIDE, BESIDE = 12.0, 10.0
ON_HEAD = {
    "headtop": ("crown", 0.0, 6.0),
    "forehead": ("forehead", 0.0, 5.7),
    "eyebrows": ("eye", 3.9, None),
    "eyes": ("eye", 0.0, None),
    "nose": ("nose", 0.0, 1.7),
    "nostrils": ("nose", -0.8, 1.7),
    "ear": ("ear", 0.0, None),
    "earlobe": ("ear", -2.2, None),
    "cheek": ("cheek", 0.0, None),
    "lips": ("mouth", 0.0, 2.6),
    "tongue": ("mouth", 0.0, 2.6),
    "teeth": ("mouth", 0.0, 2.6),
    "chin": ("chin", 0.0, 2.5),
    "underchin": ("under-chin", 0.0, 2.5),
}
"""Place of the table; how much higher than it, cm; how far to a side its side is, None for one of a pair.

Half of ft-ft (11.5, 11.1 cm, men and women), al-al (3.5, 3.1), ch-ch (5.4, 5.0); the chin is taken to be as wide as the
mouth. The lobe's middle is taken .9 above subaurale, so 2.2 below the middle of sa-sba (6.3, 5.9). Nostrils are at
subnasale, which by n-prn 5.0, n-sn 5.5 and sn-prn 2.0 lies .8 below the nose's tip. Brows are half of or-sci (4.0) over
the eyeball, which is 1.9 over the table's place below the eye.
"""
HEAD_GAP = {"touch": 0.0, "": 0.0, "close": 4.0, "armextended": 25.0}
_POINTS = body_locations(STANDARD)


@dataclass(frozen=True, eq=False)
class Place:
    """Where a place is.

    point: (3,) with an upright head, chest axes, cm
    head: share of it that goes with the head
    """

    point: FloatArray
    head: float

    def at(self, turn: FloatArray, head: FloatArray) -> FloatArray:
        """Where it is (T, 3) when the head's joint, with ``turn`` (T, 3, 3), is at ``head`` (T, 3)."""
        moved = head + turn @ (self.point - _HEAD)
        return np.asarray(self.point + self.head * (moved - self.point))


def place_points(element: ET.Element, two: bool) -> list[Place]:
    """Where a place is; several where the notation leaves a choice (of a pair of organs, with two hands)."""
    contact = element.get("contact", "")
    found = []
    for name, side in (
        (element.get("location", ""), element.get("side", "")),
        (element.get("second_location", ""), element.get("second_side", "")),
    ):
        if name:
            options = _one_place(name, side, contact, two)
            if not options:
                return []
            found.append(options)
    if len(found) < 2:
        return found[0] if found else []
    return [Place((a.point + b.point) / 2, (a.head + b.head) / 2) for a in found[0] for b in found[1]]


def _one_place(name: str, side: str, contact: str, two: bool) -> list[Place]:
    sign = 1.0 if side.startswith("left") else -1.0
    beside = BESIDE * side.endswith("beside")
    if name in ON_HEAD:
        table, higher, aside = ON_HEAD[name]
        (x, y, z), (nx, ny, nz) = _POINTS[table].point, _POINTS[table].normal
        at = abs(x) if aside is None else aside
        xs = [at + beside] if side or aside is None else [0.0, at] if two else [0.0]
        points = [np.array([sign * one, y + higher, z]) for one in xs]
        if contact == "touch" or not beside:  # what touches beside an organ is at the side of the head
            points = [_on_skin(point) for point in points]
        away = HEAD_GAP.get(contact, 0.0) * np.array([sign * abs(nx), ny, nz])
        return [Place(point + away, 1.0) for point in points]
    if name not in HEIGHT or contact == "touch":
        return []  # on the skin: the touch is measured, and where along the body it may slide is not
    near_head = name == "head" and contact == "close"
    depth = CLOSE_TO_HEAD if near_head else DEPTH.get(contact, 30.0)
    at = ASIDE.get(name, TRUNK_ASIDE)
    x = at + beside if side else 0.0
    xs = [x, at] if two and not side else [x]
    return [Place(np.array([sign * one, HEIGHT[name], depth]), float(near_head)) for one in xs]


def _rest() -> tuple[FloatArray, tuple[FloatArray, FloatArray, FloatArray]]:
    """The head's joint (3,), and the capsules of the head: starts and spans (K, 3) and radii (K, 2), chest axes, cm."""
    body, rest = body_capsules(skeleton(STANDARD)), rest_positions(skeleton(STANDARD))
    head = [n for n, part in enumerate(body.parts) if part in ("face", "hair", "nose")]
    starts = (rest[body.joints] + body.starts)[head] - rest[JOINTS["Spine2"]]
    ends = (rest[body.joints] + body.ends)[head] - rest[JOINTS["Spine2"]]
    return rest[JOINTS["Head"]] - rest[JOINTS["Spine2"]], (starts, ends - starts, body.radii[head])


_HEAD, _SOLID = _rest()


def _on_skin(point: FloatArray) -> FloatArray:
    """The point (3,) of the head's skin that is nearest to a point."""
    starts, spans, radii = _SOLID
    for _ in range(8):
        along = np.einsum("kc,kc->k", point - starts, spans) / (np.einsum("kc,kc->k", spans, spans) + 1e-12)
        along = np.clip(along, 0.0, 1.0)
        out = point - starts - along[:, None] * spans
        gaps = np.linalg.norm(out, axis=1) - radii[:, 0] - along * (radii[:, 1] - radii[:, 0])
        nearest = int(gaps.argmin())
        point = point - gaps[nearest] * out[nearest] / np.linalg.norm(out[nearest])
    return np.asarray(point)
