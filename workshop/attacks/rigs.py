"""Random rigs as second clips of a splice: ``python attacks/rigs.py [N] [SEED]``.

A word that ships is brought to another rig, written by this file's own writer, read, and spliced after another word.
Forward kinematics of this file's own then compares wrists, elbows, knuckles, fingertips, head and nose with the true
motion: that of the same splice from the rig that was not distorted, which for a word on the body that ships is checked
to be the word's own, moved as one. Right is within 1 mm in every frame, on the first rig, and at least 90 % of the
word's frames are shown. On other bodies it is within 3 mm, seen from the hips, which may lie 5 mm off: what is up for a
trunk, and how far hips sway, depends there on what is taken for the body's size. Else the result has to have a warning
that names the fault, or the file has to be refused. Anything else is silent, and the exit status is 1. Prints a row of
a Markdown table for each kind of distortion. Takes five minutes of processor time for the default of 2,000 rigs.
"""

from __future__ import annotations

import json
import re
import struct
import sys
import tempfile
import warnings
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from itertools import permutations
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

import signsplice as ss
from rig_distortions import (
    PREFIX,
    Floats,
    Motion,
    Random,
    any_axes,
    in_world,
    mirror_image,
    mirrored,
    motion_of,
    near_axes,
    other_rest,
    other_unit,
    other_world,
    renamed,
    several,
    stacked,
    unchanged,
)  # fmt: skip

FIRST, WORDS = "HELLO", ("NAME", "DEAF", "SIGN", "THANK-YOU", "HOUSE", "MOTHER", "WORK", "I")
_COMPARED = ("Hips", "LeftForeArm", "LeftHand", "LeftHandMiddle1", "LeftHandIndex3",
             "RightForeArm", "RightHand", "RightHandMiddle1", "RightHandIndex3", "Head")  # fmt: skip
_OTHER_SIDE, _TIPS = [0, *range(5, 9), *range(1, 5), 9, 10], [4, 8]
_NOSE = np.array([0.0, 6.0, 11.0])
"""From the joint of the head, cm."""
_RIGHT_CM, _OTHER_CM, _OTHER_HIPS_CM, _LEAST_SHOWN = 0.1, 0.3, 0.5, 0.9
"""Farthest that a joint may lie off, on another body from its hips, and those; least fraction of the word's frames that
have to be shown.
"""


@dataclass(frozen=True)
class Kind:
    """A kind of distortion.

    change: makes it of a motion.
    warning: what a warning that names it has to contain, a regular expression.
    most_cm: how far off joints may be for that warning to explain it; but fingertips, which a rig may lack.
    above: makes the matrix (4, 4) of a glTF node above the rig; None for BVH with Euler orders at random.
    is_mirrored: whether what has to come out is the mirror image.
    has_bodies: whether the words are on other bodies too.
    has_truth: whether any rotations show the distorted motion; what shows it is else wrong in any case.
    """

    change: Callable[[Motion, Random], Motion]
    warning: str
    most_cm: float = 0.0
    above: Callable[[Random], Floats] | None = None
    is_mirrored: bool = False
    has_bodies: bool = True
    has_truth: bool = True


def _even(rng: Random) -> Floats:
    matrix = np.eye(4)
    matrix[:3, :3] = 10.0 ** rng.uniform(-3.0, 3.0) * np.linalg.det(p := _signed(rng)) * p
    matrix[:3, 3] = rng.uniform(-5.0, 5.0, 3)
    return matrix


def _signed(rng: Random) -> Floats:
    return np.asarray(np.eye(3)[rng.permutation(3)] * rng.choice([-1.0, 1.0], 3))


def _uneven(rng: Random) -> Floats:
    matrix = np.eye(4)
    part = rng.integers(3)
    if part == 0:
        matrix[:3, :3] = np.diag([-1.0, 1.0, 1.0]) if rng.random() < 0.5 else -np.eye(3)
    elif part == 1:
        matrix[:3, :3] = np.diag(rng.uniform(0.6, 1.6, 3))
    else:
        matrix[rng.integers(0, 2), 2] = rng.choice([-1.0, 1.0]) * rng.uniform(0.1, 0.8)
    return matrix


_REST, _UNIT, _NAMES = r"rest pose", r"unit", r"no counterpart .*: (?!mixamorig:HeadTop_End$)|no role|body parts"
KINDS = {
    "unit, 1e-6 to 1e3 of the first's": Kind(other_unit, _UNIT, has_bodies=False),
    "world axes": Kind(other_world, _REST),
    "Euler orders": Kind(unchanged, _REST),
    "rest pose: T, A, arms down, forward, up": Kind(other_rest, _REST),
    "joint axes by up to 25 degrees, on the first's body": Kind(near_axes, _REST, has_bodies=False),
    "joint axes at random: zero is no person": Kind(any_axes, _REST, 2.0),
    "bones in one line at zero": Kind(stacked, _REST, 2.0),
    "mirror image, sides renamed": Kind(mirror_image, _REST, is_mirrored=True),
    "mirrored, sides not renamed": Kind(mirrored, r"left and right", np.inf),
    "names of known schemes": Kind(renamed, _NAMES, 4.0),
    "all of these at once, on the first's body": Kind(several, f"{_REST}|{_UNIT}|{_NAMES}", 4.0, has_bodies=False),
    "glTF: a node above turns, moves and scales": Kind(unchanged, _UNIT, above=_even, has_bodies=False),
    "glTF: a node above mirrors, shears or scales unevenly": Kind(
        unchanged, r"mirror|shear|scale|even", above=_uneven, has_bodies=False, has_truth=False
    ),
}


# --- files ------------------------------------------------------------------------------------------------------------


def bvh(motion: Motion, rng: Random | None = None) -> str:
    """A BVH file of the motion: ZXY, or an order at random for each joint."""
    lines, columns = ["HIERARCHY"], [motion.roots]
    orders = ["".join(order) for order in permutations("XYZ")]

    def joint(k: int, indent: str) -> None:
        order: Any = "ZXY" if rng is None else orders[rng.integers(len(orders))]
        rotation = " ".join(f"{axis}rotation" for axis in order)
        position = "Xposition Yposition Zposition "
        lines.append(f"{indent}{'JOINT' if k else 'ROOT'} {motion.names[k]}\n{indent}{{")
        lines.append(f"{indent} OFFSET {_numbers(motion.offsets[k] if k else np.zeros(3))}")
        lines.append(f"{indent} CHANNELS {3 if k else 6} {'' if k else position}{rotation}")
        columns.append(Rotation.from_matrix(motion.rotations[:, k]).as_euler(order, degrees=True))
        children = [child for child, parent in enumerate(motion.parents) if parent == k]
        for child in children:
            joint(child, indent + " ")
        if not children:
            tip = _numbers(motion.sites.get(k, np.zeros(3)))
            lines.append(f"{indent} End Site\n{indent} {{\n{indent}  OFFSET {tip}\n{indent} }}")
        lines.append(f"{indent}}}")

    joint(0, "")
    rows = np.concatenate(columns, axis=1)
    lines += ["MOTION", f"Frames: {len(rows)}", f"Frame Time: {1 / 30:.6f}", *map(_numbers, rows)]
    return "\n".join(lines) + "\n"


def _numbers(row: Floats) -> str:
    return " ".join(f"{number:.12g}" for number in row)


def with_node_above(glb: bytes, matrix: Floats) -> bytes:
    """A GLB file with everything below one more node, which has a matrix."""
    (length,) = struct.unpack_from("<I", glb, 12)
    fields, rest = json.loads(glb[20 : 20 + length]), glb[20 + length :]
    scene = fields["scenes"][fields.get("scene", 0)]
    fields["nodes"].append({"name": "above", "matrix": matrix.T.ravel().tolist(), "children": scene["nodes"]})
    scene["nodes"] = [len(fields["nodes"]) - 1]
    text = json.dumps(fields).encode()
    text += b" " * (-len(text) % 4)
    return struct.pack("<4sIIII", b"glTF", 2, 20 + len(text) + len(rest), len(text), 0x4E4F534A) + text + rest


# --- what comes of them -----------------------------------------------------------------------------------------------


@cache
def word(gloss: str) -> ss.Clip:
    """A word that ships."""
    with ss.open_lexicon() as words:
        return words.clip(gloss)


@cache
def undistorted(gloss: str, body: int) -> Motion:
    """A word on the body that ships, or on one of three others with the same joints and pose at zero."""
    motion = motion_of(word(gloss))
    if not body:
        return motion
    rng = np.random.default_rng(body)
    factors = {part: rng.uniform(0.85, 1.15) for part in ("ForeArm", "Hand", "Arm", "Spine", "Leg", "Neck")}
    sizes = [next((f for part, f in factors.items() if name.endswith(part)), 1.0) for name in motion.names]
    return replace(motion, offsets=motion.offsets * np.array(sizes)[:, None])


def points_of(motion: Motion) -> Floats:
    """Positions (T, P, 3) of what is compared."""
    positions, rotations = in_world(motion)
    rows = [motion.names.index(PREFIX + name) for name in _COMPARED]
    nose = positions[:, rows[-1]] + rotations[:, rows[-1]] @ _NOSE
    return np.concatenate([positions[:, rows], nose[:, None]], axis=1)


def spliced(path: Path) -> tuple[dict[int, Floats], tuple[str, ...]]:
    """Positions (P, 3) of what is compared for each frame of a file that a splice shows after ``FIRST``; warnings."""
    result = ss.splice([word(FIRST), ss.load(path)])
    points, shown = points_of(motion_of(result.clip)), dict[int, Floats]()
    for span in result.spans:
        if span.clip == 1 and span.source is not None:
            frames = zip(range(*span.source), range(*span.output), strict=True)
            remade = range(*span.remade.frames) if span.remade else ()
            shown |= {source: points[output] for source, output in frames if output not in remade}
    return shown, (*result.warnings, *(line for seam in result.seams for line in seam.warnings))


@cache
def truth(gloss: str, body: int, is_mirrored: bool) -> tuple[dict[int, Floats], tuple[str, ...]]:
    """What ``spliced`` gives for a word that is not distorted."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "word.bvh"
        path.write_text(bvh(undistorted(gloss, body)))
        shown, lines = spliced(path)
    if not body:
        seen, own = np.concatenate([*shown.values()]), np.concatenate(points_of(undistorted(gloss, 0))[[*shown]])
        turn = Rotation.align_vectors(seen - seen.mean(axis=0), own - own.mean(axis=0))[0]
        apart = turn.apply(own - own.mean(axis=0)) + seen.mean(axis=0) - seen
        assert np.abs(apart).max() < 1e-3, f"{gloss} itself is not spliced as it is"
    if is_mirrored:
        place, across = first_plane()
        mirror = np.eye(3) - 2.0 * np.outer(across, across)
        shown = {frame: place + (points[_OTHER_SIDE] - place) @ mirror for frame, points in shown.items()}
    return shown, lines


@cache
def first_plane() -> tuple[Floats, Floats]:
    """The plane in the middle of the first signer: a point of it, and the direction at right angles to it."""
    motion = motion_of(word(FIRST))
    at = dict(zip(motion.names, in_world(motion)[0].transpose(1, 0, 2), strict=True))
    across = np.zeros(3)
    for part in ("Arm", "UpLeg"):
        line = at[f"{PREFIX}Left{part}"] - at[f"{PREFIX}Right{part}"]
        across += (line / np.linalg.norm(line, axis=1, keepdims=True)).mean(axis=0)
    across *= [1.0, 0.0, 1.0]
    feet = np.median(at[f"{PREFIX}LeftFoot"] + at[f"{PREFIX}RightFoot"], axis=0) / 2.0
    return feet, across / np.linalg.norm(across)


def outcome(kind: Kind, rng: Random, folder: Path) -> tuple[str, float]:
    """What a splice makes of one rig of a kind: right, warned, refused or SILENT; and how far it is off, cm."""
    gloss, body = WORDS[rng.integers(len(WORDS))], int(rng.choice([0, 0, 0, 0, 1, 2, 3])) * kind.has_bodies
    motion = kind.change(undistorted(gloss, body), rng)
    path = folder / ("word.bvh" if kind.above is None else "word.glb")
    with warnings.catch_warnings(action="ignore"):  # Euler angles at their poles
        text = bvh(motion, None if kind.above else rng)
    (folder / "word.bvh").write_text(text)
    wanted, usual = truth(gloss, body, kind.is_mirrored)
    if kind.above is not None:
        ss.save(ss.load(folder / "word.bvh"), path)
        path.write_bytes(with_node_above(path.read_bytes(), kind.above(rng)))
    try:
        shown, lines = spliced(path)
    except ss.InputError:
        return "refused", 0.0
    frames = sorted(wanted.keys() & shown.keys())
    off = off_but_tips = np.inf
    if len(frames) >= _LEAST_SHOWN * len(wanted):
        apart = np.stack([shown[frame] - wanted[frame] for frame in frames])
        hips = float(np.linalg.norm(apart[:, 0], axis=-1).max())
        each = np.linalg.norm(apart - apart[:, :1] * (body > 0), axis=-1).max(axis=0)
        off, off_but_tips = float(each.max()), float(np.delete(each, _TIPS).max())
        if kind.has_truth and off <= (_OTHER_CM if body else _RIGHT_CM) and hips <= _OTHER_HIPS_CM:
            return "right", off
    is_named = any(re.search(kind.warning, line) for line in lines if line not in usual)
    return "warned" if is_named and off_but_tips <= kind.most_cm else "SILENT", off


def attack(n: int, seed: int = 0, kinds: Mapping[str, Kind] = KINDS) -> dict[str, list[tuple[str, float]]]:
    """For each kind the outcomes of its rigs, of ``n`` in all; prints each silent one."""
    seen: dict[str, list[tuple[str, float]]] = {name: [] for name in kinds}
    with tempfile.TemporaryDirectory() as folder:
        for number in range(n):
            name = list(kinds)[number % len(kinds)]
            seen[name].append(outcome(kinds[name], np.random.default_rng([seed, number]), Path(folder)))
            if seen[name][-1][0] == "SILENT":
                print(f"{name}, number {number}: {seen[name][-1][1]:.2f} cm off", file=sys.stderr, flush=True)
    return seen


def main() -> None:
    """Try the rigs, print the table; exit status 1 where one was silent."""
    n, seed = (int(text) for text in (*sys.argv[1:], *("2000", "0")[len(sys.argv) - 1 :]))
    print("| distortion | rigs | right | warned of (off by, median and most, cm) | refused | SILENT |")
    print("| --- | --- | --- | --- | --- | --- |")
    n_silent = 0
    for name, seen in attack(n, seed).items():
        counts = Counter(what for what, _ in seen)
        off = [cm for what, cm in seen if what == "warned"]
        warned = f"{len(off)} ({np.median(off):.1f}, {max(off):.1f})" if off else "0"
        print(f"| {name} | {len(seen)} | {counts['right']} | {warned} | {counts['refused']} | {counts['SILENT']} |")
        n_silent += counts["SILENT"]
    sys.exit(n_silent > 0)


if __name__ == "__main__":
    main()
