"""Splices random rigs as second clips: ``python attacks/rigs.py [N] [SEED]``.

A word that ships is retargeted to another rig, written by this file's own writer, read, and spliced after another word.
This file's own forward kinematics then compares wrists, elbows, knuckles, fingertips, head and nose with the true
motion: that of the same splice from the undistorted rig, which for a word on the body that ships is checked to be the
word's own, moved as one. Right is within 1 mm in every frame, on the first rig, and at least 90 % of the word's frames
are shown. On other bodies it is within 3 mm, relative to the hips, which may lie 5 mm off: the up direction of a trunk,
and the sway of hips, depend there on the assumed size of the body. Otherwise the result must have a warning that names
the fault, or the file must be refused. Anything else is silent, and the exit status is 1. Prints a row of a Markdown
table for each kind of distortion. Takes five minutes of processor time for the default of 2,000 rigs.
"""

from __future__ import annotations

import json
import re
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

import rig_distortions as distort
import signsplice as ss
from fuzz_trees import join_glb, split_glb
from rig_distortions import PREFIX, Floats, Motion, Random, compute_world, extract_motion

FIRST, WORDS = "HELLO", ("NAME", "DEAF", "SIGN", "THANK-YOU", "HOUSE", "MOTHER", "WORK", "I")
_COMPARED = ("Hips", "LeftForeArm", "LeftHand", "LeftHandMiddle1", "LeftHandIndex3",
             "RightForeArm", "RightHand", "RightHandMiddle1", "RightHandIndex3", "Head")  # fmt: skip
_OTHER_SIDE, _TIPS = [0, *range(5, 9), *range(1, 5), 9, 10], [4, 8]
_NOSE = np.array([0.0, 6.0, 11.0])
"""From the joint of the head, cm."""
_AS_RECORDED = ss.SpliceOptions(person=0.0, free_hand="transition")
"""Arms, head and trunk move as in the words."""
_MAX_CM, _MAX_OTHER_CM, _MAX_HIPS_CM, _MIN_SHOWN = 0.1, 0.3, 0.5, 0.9
"""Greatest errors of a joint, of a joint of another body relative to its hips, and of those hips, cm; smallest fraction
of the word's frames that must be shown.
"""


@dataclass(frozen=True)
class Kind:
    """A kind of distortion.

    change: distorts a motion.
    warning: regular expression of a warning that names it.
    max_cm: greatest error of joints that this warning explains, except fingertips, which a rig may lack.
    draw_above: makes the matrix (4, 4) of a glTF node above the rig; None for BVH with Euler orders at random.
    is_mirrored: whether the mirror image is expected.
    has_bodies: whether the words are on other bodies too.
    has_truth: whether any rotations show the distorted motion; a shown motion is wrong otherwise.
    """

    change: Callable[[Motion, Random], Motion]
    warning: str
    max_cm: float = 0.0
    draw_above: Callable[[Random], Floats] | None = None
    is_mirrored: bool = False
    has_bodies: bool = True
    has_truth: bool = True


def _draw_even_matrix(rng: Random) -> Floats:
    matrix = np.eye(4)
    matrix[:3, :3] = 10.0 ** rng.uniform(-3.0, 3.0) * np.linalg.det(p := _draw_axes(rng)) * p
    matrix[:3, 3] = rng.uniform(-5.0, 5.0, 3)
    return matrix


def _draw_axes(rng: Random) -> Floats:
    return np.asarray(np.eye(3)[rng.permutation(3)] * rng.choice([-1.0, 1.0], 3))


def _draw_uneven_matrix(rng: Random) -> Floats:
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
    "unit, 1e-6 to 1e3 of the first's": Kind(distort.change_unit, _UNIT, has_bodies=False),
    "world axes": Kind(distort.change_world, _REST),
    "Euler orders": Kind(distort.keep, _REST),
    "rest pose: T, A, arms down, forward, up": Kind(distort.draw_rest, _REST),
    "joint axes by up to 25 degrees, on the first's body": Kind(distort.turn_axes_slightly, _REST, has_bodies=False),
    "joint axes at random: zero is no person": Kind(distort.turn_axes_randomly, _REST, 2.0),
    "bones in one line at zero": Kind(distort.align_bones, _REST, 2.0),
    "mirror image, sides renamed": Kind(distort.mirror_and_rename, _REST, is_mirrored=True),
    "mirrored, sides not renamed": Kind(distort.mirror, r"left and right", np.inf),
    "names of known schemes": Kind(distort.rename_joints, _NAMES, 4.0),
    "all of these at once, on the first's body": Kind(
        distort.change_all, f"{_REST}|{_UNIT}|{_NAMES}", 4.0, has_bodies=False
    ),
    "glTF: a node above turns, moves and scales": Kind(
        distort.keep, _UNIT, draw_above=_draw_even_matrix, has_bodies=False
    ),
    "glTF: a node above mirrors, shears or scales unevenly": Kind(
        distort.keep, r"mirror|shear|scale|even", draw_above=_draw_uneven_matrix, has_bodies=False, has_truth=False
    ),
}


# --- files ------------------------------------------------------------------------------------------------------------


def encode_bvh(motion: Motion, rng: Random | None = None) -> str:
    """Returns a BVH file of the motion: ZXY, or an order at random for each joint."""
    lines, columns = ["HIERARCHY"], [motion.roots]
    orders = ["".join(order) for order in permutations("XYZ")]

    def joint(k: int, indent: str) -> None:
        order: Any = "ZXY" if rng is None else orders[rng.integers(len(orders))]
        rotation = " ".join(f"{axis}rotation" for axis in order)
        position = "Xposition Yposition Zposition "
        lines.append(f"{indent}{'JOINT' if k else 'ROOT'} {motion.names[k]}\n{indent}{{")
        lines.append(f"{indent} OFFSET {_format_numbers(motion.offsets[k] if k else np.zeros(3))}")
        lines.append(f"{indent} CHANNELS {3 if k else 6} {'' if k else position}{rotation}")
        columns.append(Rotation.from_matrix(motion.rotations[:, k]).as_euler(order, degrees=True))
        children = [child for child, parent in enumerate(motion.parents) if parent == k]
        for child in children:
            joint(child, indent + " ")
        if not children:
            site_offset = _format_numbers(motion.sites.get(k, np.zeros(3)))
            lines.append(f"{indent} End Site\n{indent} {{\n{indent}  OFFSET {site_offset}\n{indent} }}")
        lines.append(f"{indent}}}")

    joint(0, "")
    rows = np.concatenate(columns, axis=1)
    lines += ["MOTION", f"Frames: {len(rows)}", f"Frame Time: {1 / 30:.6f}", *map(_format_numbers, rows)]
    return "\n".join(lines) + "\n"


def _format_numbers(row: Floats) -> str:
    return " ".join(f"{number:.12g}" for number in row)


def add_node_above(glb: bytes, matrix: Floats) -> bytes:
    """Returns a GLB file with everything below one more node, which has a matrix."""
    chunks = split_glb(glb)
    fields = json.loads(chunks["0.json"])
    scene = fields["scenes"][fields.get("scene", 0)]
    fields["nodes"].append({"name": "above", "matrix": matrix.T.ravel().tolist(), "children": scene["nodes"]})
    scene["nodes"] = [len(fields["nodes"]) - 1]
    return join_glb(chunks | {"0.json": json.dumps(fields).encode()})


# --- outcomes -----------------------------------------------------------------------------------------------


@cache
def read_word(gloss: str) -> ss.Clip:
    """Returns a word that ships."""
    with ss.open_lexicon() as words:
        return words.clip(gloss)


@cache
def make_undistorted(gloss: str, body: int) -> Motion:
    """Returns a word on the body that ships, or on one of three others with the same joints and pose at zero."""
    motion = extract_motion(read_word(gloss))
    if not body:
        return motion
    rng = np.random.default_rng(body)
    factors = {part: rng.uniform(0.85, 1.15) for part in ("ForeArm", "Hand", "Arm", "Spine", "Leg", "Neck")}
    sizes = [next((f for part, f in factors.items() if name.endswith(part)), 1.0) for name in motion.names]
    return replace(motion, offsets=motion.offsets * np.array(sizes)[:, None])


def compute_points(motion: Motion) -> Floats:
    """Returns the positions (T, P, 3) that are compared."""
    positions, rotations = compute_world(motion)
    rows = [motion.names.index(PREFIX + name) for name in _COMPARED]
    nose = positions[:, rows[-1]] + rotations[:, rows[-1]] @ _NOSE
    return np.concatenate([positions[:, rows], nose[:, None]], axis=1)


def splice_file(path: Path) -> tuple[dict[int, Floats], tuple[str, ...]]:
    """Returns the compared positions (P, 3) for each frame of a file that a splice shows after ``FIRST``, and
    warnings. Nothing is added to the frames, so that they can be compared with the word's own.
    """
    result = ss.splice([read_word(FIRST), ss.load(path)], _AS_RECORDED)
    points, shown = compute_points(extract_motion(result.clip)), dict[int, Floats]()
    for span in result.spans:
        if span.clip == 1 and span.source is not None:
            frames = zip(range(*span.source), range(*span.output), strict=True)
            remade = range(*span.remade.frames) if span.remade else ()
            shown |= {source: points[output] for source, output in frames if output not in remade}
    return shown, (*result.warnings, *(line for seam in result.seams for line in seam.warnings))


@cache
def compute_truth(gloss: str, body: int, is_mirrored: bool) -> tuple[dict[int, Floats], tuple[str, ...]]:
    """Returns the same as ``splice_file``, for a word that is not distorted."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "word.bvh"
        path.write_text(encode_bvh(make_undistorted(gloss, body)))
        shown, lines = splice_file(path)
    if not body:
        actual = np.concatenate([*shown.values()])
        expected = np.concatenate(compute_points(make_undistorted(gloss, 0))[[*shown]])
        turn = Rotation.align_vectors(actual - actual.mean(axis=0), expected - expected.mean(axis=0))[0]
        errors = turn.apply(expected - expected.mean(axis=0)) + actual.mean(axis=0) - actual
        assert np.abs(errors).max() < 1e-3, f"{gloss} itself is not spliced as it is"
    if is_mirrored:
        origin, normal = compute_first_plane()
        reflection = np.eye(3) - 2.0 * np.outer(normal, normal)
        shown = {frame: origin + (points[_OTHER_SIDE] - origin) @ reflection for frame, points in shown.items()}
    return shown, lines


@cache
def compute_first_plane() -> tuple[Floats, Floats]:
    """Returns the median plane of the first signer: a point of it, and its normal."""
    motion = extract_motion(read_word(FIRST))
    positions = dict(zip(motion.names, compute_world(motion)[0].transpose(1, 0, 2), strict=True))
    normal = np.zeros(3)
    for part in ("Arm", "UpLeg"):
        line = positions[f"{PREFIX}Left{part}"] - positions[f"{PREFIX}Right{part}"]
        normal += (line / np.linalg.norm(line, axis=1, keepdims=True)).mean(axis=0)
    normal *= [1.0, 0.0, 1.0]
    feet = np.median(positions[f"{PREFIX}LeftFoot"] + positions[f"{PREFIX}RightFoot"], axis=0) / 2.0
    return feet, normal / np.linalg.norm(normal)


def judge_rig(kind: Kind, rng: Random, folder: Path) -> tuple[str, float]:
    """Splices one rig of a kind; returns the verdict, right, warned, refused or SILENT, and the error, cm."""
    gloss, body = WORDS[rng.integers(len(WORDS))], int(rng.choice([0, 0, 0, 0, 1, 2, 3])) * kind.has_bodies
    motion = kind.change(make_undistorted(gloss, body), rng)
    path = folder / ("word.bvh" if kind.draw_above is None else "word.glb")
    with warnings.catch_warnings(action="ignore"):  # Euler angles at their poles
        text = encode_bvh(motion, None if kind.draw_above else rng)
    (folder / "word.bvh").write_text(text)
    true_points, usual_warnings = compute_truth(gloss, body, kind.is_mirrored)
    if kind.draw_above is not None:
        ss.save(ss.load(folder / "word.bvh"), path)
        path.write_bytes(add_node_above(path.read_bytes(), kind.draw_above(rng)))
    try:
        shown, lines = splice_file(path)
    except ss.InputError:
        return "refused", 0.0
    frames = sorted(true_points.keys() & shown.keys())
    error = error_but_tips = np.inf
    if len(frames) >= _MIN_SHOWN * len(true_points):
        errors = np.stack([shown[frame] - true_points[frame] for frame in frames])
        hips_error = float(np.linalg.norm(errors[:, 0], axis=-1).max())
        joint_errors = np.linalg.norm(errors - errors[:, :1] * (body > 0), axis=-1).max(axis=0)
        error, error_but_tips = float(joint_errors.max()), float(np.delete(joint_errors, _TIPS).max())
        if kind.has_truth and error <= (_MAX_OTHER_CM if body else _MAX_CM) and hips_error <= _MAX_HIPS_CM:
            return "right", error
    is_named = any(re.search(kind.warning, line) for line in lines if line not in usual_warnings)
    return "warned" if is_named and error_but_tips <= kind.max_cm else "SILENT", error


def attack(n: int, seed: int = 0, kinds: Mapping[str, Kind] = KINDS) -> dict[str, list[tuple[str, float]]]:
    """Returns for each kind the outcomes of its rigs, ``n`` in all; prints each silent one."""
    outcomes: dict[str, list[tuple[str, float]]] = {name: [] for name in kinds}
    with tempfile.TemporaryDirectory() as folder:
        for number in range(n):
            name = list(kinds)[number % len(kinds)]
            outcomes[name].append(judge_rig(kinds[name], np.random.default_rng([seed, number]), Path(folder)))
            if outcomes[name][-1][0] == "SILENT":
                print(f"{name}, number {number}: {outcomes[name][-1][1]:.2f} cm off", file=sys.stderr, flush=True)
    return outcomes


def main() -> None:
    """Tries the rigs and prints the table; exit status 1 if one was silent."""
    n, seed = (int(text) for text in (*sys.argv[1:], *("2000", "0")[len(sys.argv) - 1 :]))
    print("| distortion | rigs | right | warned of (off by, median and most, cm) | refused | SILENT |")
    print("| --- | --- | --- | --- | --- | --- |")
    n_silent = 0
    for name, outcomes in attack(n, seed).items():
        counts = Counter(verdict for verdict, _ in outcomes)
        errors = [error for verdict, error in outcomes if verdict == "warned"]
        warned = f"{len(errors)} ({np.median(errors):.1f}, {max(errors):.1f})" if errors else "0"
        print(f"| {name} | {len(outcomes)} | {counts['right']} | {warned} | {counts['refused']} | {counts['SILENT']} |")
        n_silent += counts["SILENT"]
    sys.exit(n_silent > 0)


if __name__ == "__main__":
    main()
