"""What the face and the body do in SiGML, as items of the tree."""

from __future__ import annotations

from collections.abc import Iterable

from signsplice.written.elements import Element
from signsplice.written.gestural_values import factor
from signsplice.written.reading import Reading
from signsplice.written.tree import Tier

LANES = {
    "mouth_picture": "mouth", "mouth_gesture": "mouth", "eye_brows": "face", "eye_lids": "face", "nose": "face",
    "eye_gaze": "gaze", "head": "head", "body": "body", "shoulder": "shoulder",
}  # fmt: skip
"""Tier -> the lane in which its items follow one another where the text has no lanes of its own."""
_TIERS = {
    "mouth_picture": ("mouth_picture", "picture"), "mouth_gesture": ("mouth_gesture", "movement"),
    "eye_brows": ("eye_brows", "movement"), "eye_lids": ("eye_lids", "movement"),
    "eye_gaze": ("eye_gaze", "direction"), "nose": ("nose", "movement"), "head_movement": ("head", "movement"),
    "body_movement": ("body", "movement"), "shoulder_movement": ("shoulder", "movement"),
}  # fmt: skip
_PARALLEL = ("mouthing_par", "head_par", "body_par", "facial_expr_par", "shoulder_par", "eye_par")
_HNS = {
    "hnm_mouthpicture": "mouth_picture", "hnm_mouthgesture": "mouth_gesture", "hnm_eyebrows": "eye_brows",
    "hnm_eyelids": "eye_lids", "hnm_eyegaze": "eye_gaze", "hnm_nose": "nose", "hnm_head": "head", "hnm_body": "body",
    "hnm_shoulder": "shoulder",
}  # fmt: skip


def gestural_tiers(nonmanual: Element, reading: Reading) -> list[Tier]:
    """What is not done by the hands; items of a lane follow one another, those of a ``*_par`` run together."""
    found = list[Tier]()
    for lane in nonmanual.children:
        if lane.tag == "extra_tier":
            reading.note("<extra_tier> is left out", lane.line)
            continue
        start = 0
        for item in lane.children:
            together = item.children if item.tag in _PARALLEL else (item,)
            made = [_tier(e, lane.tag, start, reading) for e in together]
            found += [one for one in made if one is not None]
            start += any(made)
    return found


def _tier(e: Element, lane: str, start: int, reading: Reading) -> Tier | None:
    name, key = _TIERS.get(e.tag, ("", ""))
    code = e.attributes.get(key) or e.attributes.get("movement", "")
    if not name or not code:
        reading.refuse(f"is no {'item of a tier' if not name else key} that is known", f"<{e.tag}>", e.line)
        return None
    if key == "direction" and key not in e.attributes:
        reading.note("<eye_gaze> movement is read as direction", e.line)
    if name == "shoulder" and lane == "head_tier":
        reading.note("<shoulder_movement> among movements of the head is read as one", e.line)
        name = "head"
    for silent in sorted(e.attributes.keys() - {key, "movement", "direction", "amount", "speed"}):
        reading.note(f"{silent[:40]} of <{e.tag}> is left out", e.line)
    amount, speed = (factor(e, k, reading) for k in ("amount", "speed"))
    return Tier(name, code, start, amount, speed, lane.removesuffix("_tier") or LANES[name])


def hns_tiers(items: Iterable[Element], reading: Reading) -> list[Tier]:
    """What is not done by the hands in SiGML of HamNoSys; items of a lane follow one another."""
    found, starts = list[Tier](), dict[str, int]()
    for item in items:
        name, code = _HNS.get(item.tag, ""), item.attributes.get("tag") or item.attributes.get("picture", "")
        if name and code:
            lane = LANES[name]
            found.append(Tier(name, code, starts.get(lane, 0), lane=lane))
            starts[lane] = starts.get(lane, 0) + 1
        elif not name or any(item.attributes.values()):
            reading.note(f"<{item.tag[:60]}> without what is known of it is left out", item.line)
    return found
