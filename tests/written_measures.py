"""Signs in gestural SiGML against the motion that is made of them: an XML reader and a geometry of its own, which share
nothing with the compiler but the body's skin and the table of places.

    python tests/written_measures.py FOLDER [--every N] [--json FILE] [--worst N]

Of each sign: the first posture (fingers, palm, place) and the last one, each looked for in all frames of the motion, so
that no timing is taken over; each written touch; how deep hands are in the body or in one another. Letters are summed
and normalised; palms follow the table of docs/hamnosys.md; places lie at the heights and distances named there.
"""

from __future__ import annotations

import argparse
import json
import time
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

from signsplice.errors import InputError
from signsplice.motion import Clip, FloatArray, kinematics
from signsplice.signer.signer import JOINTS
from signsplice.written import signing
from signsplice_workshop.measure.collisions import hand_penetration
from written_places import Place, place_points

LETTERS = {"u": (0, 1, 0), "d": (0, -1, 0), "l": (1, 0, 0), "r": (-1, 0, 0), "o": (0, 0, 1), "i": (0, 0, -1)}
LIMITS = {"fingers": 10.0, "palm": 10.0, "place": 3.0, "deep": 0.5, "touch": 0.5}
"""Degrees and cm."""
FLAT = ("flat", "fist", "finger2345")
MOVES = ("directedmotion", "circularmotion", "tgt_motion", "changeposture", "wristmotion", "fingerplay", "par_motion",
         "seq_motion", "rpt_motion", "split_motion", "nomotion", "no_motion", "crossmotion")  # fmt: skip


@dataclass
class Asked:
    """What a posture asks of the strong hand; None where it says nothing.

    fingers, palm: unit vectors
    ends: of two finger directions each
    places: any of which will do
    touch: whether a touch is written
    """

    fingers: FloatArray | None = None
    palm: FloatArray | None = None
    ends: list[FloatArray] = field(default_factory=list)
    places: list[Place] = field(default_factory=list)
    touch: bool = False


def letters(*words: str | None) -> FloatArray | None:
    found = [np.sum([LETTERS[c] for c in word], axis=0, dtype=float) for word in words if word]
    if not found:
        return None
    total = np.sum([one / max(float(np.linalg.norm(one)), 1e-9) for one in found], axis=0)
    length = float(np.linalg.norm(total))
    return None if length < 1e-6 else np.asarray(total / length)


def palm_of(words: list[str], ends: list[FloatArray]) -> FloatArray | None:
    """The palm's normal: a roll about the fingers' direction; of two directions each with its own roll, then midway."""
    middle = np.sum(ends, axis=0) / max(float(np.linalg.norm(np.sum(ends, axis=0))), 1e-9)
    found = np.zeros(3)
    for fingers, word in zip((ends[0], ends[-1]), (words[0], words[-1]), strict=True):
        to_signer = (fingers[2] if abs(fingers[2]) > 1e-6 else middle[2]) < -1e-6
        across = np.array([fingers[2], 0.0, -fingers[0]])  # Y x F
        if float(np.linalg.norm(across)) < 1e-6:  # straight up or down counts as out, or towards the signer
            across = np.array([1.0, 0.0, 0.0])
        elif to_signer:
            across = -across
        across /= np.linalg.norm(across)
        down = np.cross(fingers, across)
        level = np.array([0.0, -1.0, 0.0])
        if abs(float(fingers[1])) > 0.999:
            level = np.array([0.0, 0.0, fingers[1] * (-1.0 if to_signer else 1.0)])
        if float(down @ level) < 0:
            down = -down
        a = np.arctan2(word.count("l") - word.count("r"), word.count("d") - word.count("u"))
        axis = np.cross(fingers, middle)
        normal = np.cos(a) * down / np.linalg.norm(down) + np.sin(a) * across
        found += normal + np.cross(axis, normal) + np.cross(axis, np.cross(axis, normal)) / (1.0 + fingers @ middle)
    length = float(np.linalg.norm(found))
    return found / length if length > 0.5 else None


def asked(manual: ET.Element) -> tuple[Asked, Asked]:
    """The first posture of a sign and its last; of a compound those of its parts at either end."""
    inner = [child for child in manual if child.tag == "sign_manual"]
    if inner:
        return asked(inner[0])[0], asked(inner[-1])[1]
    two = manual.get("both_hands") == "true"
    start, end = list[ET.Element](), list[ET.Element]()
    moved, seen = False, Counter[str]()
    for child in manual:
        moved = moved or child.tag in MOVES
        if not moved:
            start.append(child)
    for one in manual.iter():
        if one.tag in ("split_handconfig", "split_location", "split_motion"):
            seen["split"] += 1
        if one.tag == "tgt_motion":
            end = [child for child in one if child.tag in ("handconfig", "location_bodyarm")] or end
        if one.tag == "rpt_motion" and one.get("repetition") in ("reverse", "tofroto", "continue", "continue_several"):
            seen["back"] += 1
    first = _posture(start, two, [])
    last = Asked()
    if end and not seen["split"] and not seen["back"]:
        last = _posture(end, two, first.ends)
        last.places = []
    if seen["split"]:
        first.places = []
    return first, last


def _posture(elements: list[ET.Element], two: bool, ends: list[FloatArray]) -> Asked:
    found = Asked()
    flat = [e for e in elements if e.tag == "handconfig"]
    flat += [part for e in elements if e.tag == "split_handconfig" for part in list(e)[:1]]
    word = None
    for e in flat:
        if e.get("extfidir"):
            both = (e.get("extfidir"), e.get("second_extfidir"))
            found.fingers = letters(*both)
            found.ends = [one for one in map(letters, both) if one is not None]
        if e.get("palmor"):
            word = (e.get("palmor", ""), e.get("second_palmor"))
    about = found.ends or ends
    if word and about and not set("oi") & set(word[0] + (word[1] or "")):
        found.palm = palm_of([one for one in word if one], about)
    for e in elements:
        for one in e.iter("location_bodyarm"):
            found.touch = found.touch or one.get("contact") == "touch"
            if e.tag == "location_bodyarm":
                found.places = place_points(one, two)
        if e.tag == "handconstellation":
            found.touch = found.touch or e.get("contact") == "touch"
    return found


@dataclass(frozen=True, eq=False)
class Hand:
    """A hand in every frame, chest axes: directions (T, 3), points (T, K, 3) of which any may be at a place; and the
    head's joint: its turn (T, 3, 3) and its place (T, 3).
    """

    fingers: FloatArray
    palm: FloatArray
    sites: FloatArray
    head_turn: FloatArray
    head: FloatArray


def hand(clip: Clip, side: str = "Right") -> Hand:
    rotations, positions = kinematics.forward(clip)
    chest = rotations[:, JOINTS["Spine2"]]
    at = positions[:, JOINTS["Spine2"]]
    turn = np.einsum("tba,tbc->tac", chest, rotations[:, JOINTS[f"{side}Hand"]])
    away = -1.0 if side == "Right" else 1.0
    names = [
        f"{side}Hand",
        *(f"{side}Hand{f}{n}" for f in ("Thumb", "Index", "Middle", "Ring", "Pinky") for n in (1, 2, 3)),
    ]
    tips, sites = kinematics.tip_positions(clip, rotations, positions), clip.skeleton.end_sites
    ends = [k for k, site in enumerate(sites) if clip.skeleton.names[site.joint].split(":")[-1] in names]
    world = np.concatenate([positions[:, [JOINTS[n] for n in names]], tips[:, ends]], axis=1)
    palm = (world[:, 0] + world[:, 7]) / 2  # between wrist and middle knuckle
    sites = np.einsum("tba,tkb->tka", chest, np.concatenate([world, palm[:, None]], axis=1) - at[:, None])
    head_turn = np.einsum("tba,tbc->tac", chest, rotations[:, JOINTS["Head"]])
    head = np.einsum("tba,tb->ta", chest, positions[:, JOINTS["Head"]] - at)
    return Hand(turn @ np.array([away, 0.0, 0.0]), turn @ np.array([0.0, -1.0, 0.0]), sites, head_turn, head)


def angle(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(np.rad2deg(np.arccos(np.clip(a @ b, -1.0, 1.0))))


def missed(what: Asked, seen: Hand) -> dict[str, float]:
    """Errors at the frame where they are least together: degrees, degrees, cm."""
    errors = {}
    if what.fingers is not None:
        errors["fingers"] = angle(seen.fingers, what.fingers)
    if what.palm is not None:
        errors["palm"] = angle(seen.palm, what.palm)
    if what.places:
        points = [place.at(seen.head_turn, seen.head)[:, None] for place in what.places]
        errors["place"] = np.min([np.linalg.norm(seen.sites - p, axis=-1).min(axis=1) for p in points], axis=0)
    if not errors:
        return {}
    best = int(np.argmin(np.max([error / LIMITS[name] for name, error in errors.items()], axis=0)))
    return {name: float(error[best]) for name, error in errors.items()}


def skins(clip: Clip) -> tuple[float, float]:
    """How deep a hand is at worst in head, trunk, the other arm or its hand; the least distance to any of them; cm."""
    deepest = float(hand_penetration(clip.skeleton, *kinematics.forward(clip))[0].max())
    return max(deepest, 0.0), max(-deepest, 0.0)


@dataclass
class Row:
    """What was measured of a sign.

    gloss: its gloss
    refused: why there is no motion, or ""
    ms, seconds: processor time, and length of the clip
    errors: by posture and parameter ("first palm"), and "deep"; "touch" where one is written
    """

    gloss: str
    refused: str = ""
    ms: float = 0.0
    seconds: float = 0.0
    errors: dict[str, float] = field(default_factory=dict)


def rows(path: Path) -> Iterator[Row]:
    """The rows of a file's signs."""
    for sign in ET.parse(path).getroot().iter("hamgestural_sign"):
        row, manual = Row(sign.get("gloss", "")), sign.find("sign_manual")
        began = time.process_time()
        try:
            clip = signing.sign(path, row.gloss)
        except InputError as error:
            row.refused = str(error)
        else:
            row.ms, row.seconds = 1e3 * (time.process_time() - began), len(clip) / clip.fps
            if manual is not None:
                row.errors = errors_of(manual, clip)
        yield row


def errors_of(manual: ET.Element, clip: Clip) -> dict[str, float]:
    """Errors of a sign's motion: degrees and cm."""
    seen = hand(clip, "Left" if manual.get("nondominant") == "true" else "Right")
    found = {
        f"{posture} {name}": error
        for posture, what in zip(("first", "last"), asked(manual), strict=True)
        for name, error in missed(what, seen).items()
    }
    found["deep"], near = skins(clip)
    if any(one.get("contact") == "touch" for one in manual.iter()):
        found["touch"] = near
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--every", type=int, default=1, help="only every N-th file")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--worst", type=int, default=8)
    options = parser.parse_args()
    every = [row for path in sorted(options.folder.glob("*.sigml"))[:: options.every] for row in rows(path)]
    if options.json:
        options.json.write_text(json.dumps([asdict(row) for row in every], indent=1))
    made = [row for row in every if not row.refused]
    print(f"{len(every)} signs, {len(made)} made ({len(made) / len(every):.1%})")
    for reason, n in Counter(row.refused[:110] for row in every if row.refused).most_common(12):
        print(f"  refused {n}: {reason}")
    for what, numbers in (("ms of processor time", [r.ms for r in made]), ("s a clip", [r.seconds for r in made])):
        low, middle, high = np.percentile(numbers, (5, 50, 95))
        print(f"{what}: median {middle:.2f}, 5 to 95 %: {low:.2f} to {high:.2f}")
    for name in dict.fromkeys(name for row in made for name in row.errors):
        found = sorted((row.errors[name], row.gloss) for row in made if name in row.errors)
        values = np.array([error for error, _ in found])
        limit = LIMITS[name.split()[-1]]
        print(
            f"{name}: {len(found)}, within {limit:g}: {np.mean(values <= limit):.1%}, median {np.median(values):.1f}",
            end="",
        )
        worst = ", ".join(f"{gloss} {error:.1f}" for error, gloss in found[: -options.worst - 1 : -1])
        print(f", p95 {np.percentile(values, 95):.1f}; worst {worst}")


if __name__ == "__main__":
    main()
