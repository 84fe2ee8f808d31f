"""Reads odd glTF and BVH files and compares them with ``evaluators``: ``python attacks/formats.py [N]``.

N random skeletons of each kind (50). A file must be read with every joint where the standard puts it in every frame,
or be refused, or be read with a warning that names the difference. Prints a row of a Markdown table for each kind; exit
status 1 if a file was anything else: silently wrong. Takes half a minute.
"""

from __future__ import annotations

import base64
import json
import sys
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

import evaluators
from fuzz_trees import join_glb
from signsplice import formats
from signsplice.errors import InputError
from signsplice.motion import kinematics
from signsplice.rig.inspection import left_out_warnings

METRES = 1e-5
"""Greatest error of a joint's position."""
RATE = 0.0025
"""Fraction by which a frame rate may differ from its file's without a warning."""
_NEAR, _EVEN, _OFF = 1e-3, 0.01, 0.11
"""Fractions of a frame: within the first a time is at a key; steps of even keys differ by less than the second, and
frames lie beside such keys by less than the third.
"""
Rng = np.random.Generator


@dataclass
class GltfDraft:
    """A glTF file under construction: the nodes of a random skeleton, and their animation.

    channels: node, path, key times, values, interpolation.
    further_animations: each a list of channels.
    properties: further properties of the document.
    extras: of the first animation.
    is_binary: whether it becomes a .glb file.
    """

    nodes: list[dict[str, Any]]
    channels: list[tuple[int, str, np.ndarray, np.ndarray, str]]
    further_animations: list[list[tuple[int, str, np.ndarray, np.ndarray, str]]] = field(default_factory=list)
    properties: dict[str, Any] = field(default_factory=dict)
    extras: dict[str, Any] | None = None
    is_binary: bool = False

    def encode(self) -> bytes:
        """Returns the bytes of the file."""
        blob, views, accessors = bytearray(), [], []

        def put(values: np.ndarray, kind: str) -> int:
            views.append({"buffer": 0, "byteOffset": len(blob), "byteLength": 4 * values.size})
            blob.extend(np.asarray(values, "<f4").tobytes())
            count = values.size // {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[kind]
            accessors.append({"bufferView": len(views) - 1, "componentType": 5126, "count": count, "type": kind})
            return len(accessors) - 1

        animations: list[dict[str, Any]] = []
        for number, channels in enumerate([self.channels, *self.further_animations]):
            samplers, targets = [], []
            for node, path, times, values, kind in channels:
                output = put(values, "VEC4" if path == "rotation" else "VEC3")
                samplers.append({"input": put(times, "SCALAR"), "output": output, "interpolation": kind})
                targets.append({"sampler": len(samplers) - 1, "target": {"node": node, "path": path}})
            animations.append({"name": f"motion {number}", "samplers": samplers, "channels": targets})
        if self.extras is not None:
            animations[0]["extras"] = self.extras
        buffer: dict[str, Any] = {"byteLength": len(blob)}
        if not self.is_binary:
            buffer["uri"] = "data:application/octet-stream;base64," + base64.b64encode(blob).decode()
        document = {"asset": {"version": "2.0"}, "nodes": self.nodes, "animations": animations, "buffers": [buffer],
                "bufferViews": views, "accessors": accessors, **self.properties}  # fmt: skip
        text = json.dumps(document).encode()
        return join_glb({"0.json": text, "1.bin": bytes(blob)}) if self.is_binary else text


def draw_quats(rng: Rng, *shape: int) -> np.ndarray:
    """Returns random unit quaternions (*shape, 4)."""
    quaternions = rng.normal(size=(*shape, 4))
    return np.asarray(quaternions / np.linalg.norm(quaternions, axis=-1, keepdims=True))


def draw_rotation_keys(rng: Rng, n: int, kind: str = "LINEAR") -> np.ndarray:
    """Returns keys of a rotation: quaternions (n, 4) that move by small steps, with tangents (n, 3, 4) for splines."""
    quaternions = draw_quats(rng, 1) + 0.1 * rng.normal(size=(n, 4)).cumsum(axis=0)
    quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
    if kind != "CUBICSPLINE":
        return quaternions
    return np.stack([rng.normal(size=(n, 4)), quaternions, rng.normal(size=(n, 4))], 1)


def draw_skeleton(rng: Rng, kind: str = "LINEAR", times: np.ndarray | None = None) -> GltfDraft:
    """Returns a chain with a branch: every joint rotates, the root moves, at 24, 30, 60 or 100 frames a second."""
    n, fps = int(rng.integers(4, 12)), int(rng.choice([24, 30, 60, 100]))
    times = np.arange(int(rng.integers(5, 30))) / fps if times is None else times
    nodes: list[dict[str, Any]] = [
        {"name": f"joint {k}", "translation": rng.normal(size=3).tolist(), "rotation": draw_quats(rng).tolist(),
         "children": [k + 1] if k + 1 < n else []} for k in range(n)
    ]  # fmt: skip
    nodes[n // 2]["children"].append(n)
    nodes.append({"name": "branch", "translation": rng.normal(size=3).tolist()})
    channels = [(k, "rotation", times, draw_rotation_keys(rng, len(times), kind), kind) for k in range(n)]
    translations = rng.normal(size=(len(times), *([3] if kind == "CUBICSPLINE" else []), 3))
    return GltfDraft(nodes, [*channels, (0, "translation", times, translations, kind)], is_binary=bool(rng.integers(2)))


def with_matrix(change: Callable[[Rng], np.ndarray], is_above: bool, rng: Rng) -> GltfDraft:
    """Makes files in which a node has a matrix, a rotation times ``change``: the branch, or with ``is_above`` one above
    the skeleton.
    """
    draft = draw_skeleton(rng)
    matrix = np.eye(4)
    matrix[:3, :3] = evaluators.to_matrices(draw_quats(rng, 1))[0] @ change(rng)
    matrix[:3, 3] = rng.normal(size=3)
    fields = {"matrix": matrix.T.ravel().tolist()}
    if is_above:
        draft.nodes.append({"name": "armature", "children": [0], **fields})
    else:
        draft.nodes[-1] = {"name": "branch", "children": [len(draft.nodes)], **fields}
        draft.nodes.append({"name": "tip", "translation": rng.normal(size=3).tolist()})
    return draft


def with_node(fields: dict[str, Any], rng: Rng) -> GltfDraft:
    """Makes files whose branch has a tip and these fields."""
    draft = draw_skeleton(rng)
    draft.nodes[-1].update(fields, children=[len(draft.nodes)])
    draft.nodes.append({"name": "tip", "translation": rng.normal(size=3).tolist()})
    return draft


def with_properties(properties: dict[str, Any], rng: Rng) -> GltfDraft:
    """Makes files with further properties of the document."""
    return replace(draw_skeleton(rng), properties=properties)


def with_uneven_keys(kind: str, rng: Rng) -> GltfDraft:
    """Makes files whose keys lie at random times, different for each joint."""

    def times() -> np.ndarray:
        return rng.uniform(0.01, 0.09, int(rng.integers(4, 20))).cumsum()

    draft = draw_skeleton(rng, kind, times())
    for k, (node, path, keys, values, _) in enumerate(draft.channels):
        if path == "rotation" and rng.random() < 0.5:
            keys = times()
            values = draw_rotation_keys(rng, len(keys), kind)
        draft.channels[k] = node, path, keys, values, kind
    return draft


def with_fps(fps: float | None, rng: Rng) -> GltfDraft:
    """Makes files whose extras name a frame rate; None: that of their keys."""
    draft = draw_skeleton(rng)
    return replace(draft, extras={"fps": fps or 1.0 / np.diff(draft.channels[0][2]).mean()})


def with_scale_keys(last: float, rng: Rng) -> GltfDraft:
    """Makes files in which keys scale a joint by 1.5, and in the end by ``last``."""
    draft = draw_skeleton(rng)
    times = draft.channels[0][2]
    sizes = np.linspace(1.5, last, len(times))[:, None].repeat(3, axis=1)
    return replace(draft, channels=[*draft.channels, (1, "scale", times, sizes, "LINEAR")])


def with_skin(rng: Rng) -> GltfDraft:
    """Makes a file whose skin has some of the joints, below an armature that is scaled and moves."""
    draft = draw_skeleton(rng)
    n, times = len(draft.nodes), draft.channels[0][2]
    draft.nodes += [{"name": "armature", "scale": [0.01] * 3, "children": [0]}]
    draft.channels.append((n, "rotation", times, draw_rotation_keys(rng, len(times)), "LINEAR"))
    return replace(draft, properties={"skins": [{"joints": sorted({1, n - 2, n - 1})}]})


def with_frame_times(frame_times: Sequence[str], rng: Rng) -> bytes:
    """Makes BVH files of a random skeleton with one of these Frame Times."""
    n, n_frames = int(rng.integers(3, 9)), int(rng.integers(2, 12))
    lines, width = ["HIERARCHY"], 0
    for k in range(n):
        channels = [f"{'XYZ'[axis]}rotation" for axis in rng.permutation(3)]
        if k == 0 or rng.random() < 0.3:
            position_channels = [f"{'XYZ'[axis]}position" for axis in rng.permutation(3)]
            channels = channels + position_channels if rng.random() < 0.5 else position_channels + channels
        width += len(channels)
        lines += [f"{'JOINT' if k else 'ROOT'} j{k} {{", f"OFFSET {' '.join(map(str, rng.normal(size=3)))}"]
        lines.append(f"CHANNELS {len(channels)} {' '.join(channels)}")
    lines += ["End Site {", "OFFSET 0 1 0", "}", *"}" * n, "MOTION", f"Frames: {n_frames}"]
    lines.append(f"Frame Time: {rng.choice(frame_times)}")
    rows = rng.uniform(-180, 180, (n_frames, width))
    return "\n".join([*lines, *(" ".join(map(str, row)) for row in rows), ""]).encode()


def _draw_shear(rng: Rng) -> np.ndarray:
    matrix = np.eye(3)
    matrix[0, 1] = rng.uniform(0.1, 1.0)
    return np.asarray(matrix / np.linalg.norm(matrix, axis=0))  # as if of one scale


def _draw_scale(rng: Rng) -> np.ndarray:
    return np.asarray(np.eye(3) * rng.uniform(0.01, 3.0))


KINDS: dict[str, tuple[str, Callable[[Rng], GltfDraft | bytes]]] = {
    "linear keys": ("exact", partial(draw_skeleton, kind="LINEAR")),
    "step keys": ("exact", partial(draw_skeleton, kind="STEP")),
    "spline keys": ("exact", partial(draw_skeleton, kind="CUBICSPLINE")),
    "keys at uneven times, linear": ("exact", partial(with_uneven_keys, "LINEAR")),
    "keys at uneven times, step": ("exact", partial(with_uneven_keys, "STEP")),
    "keys at uneven times, spline": ("exact", partial(with_uneven_keys, "CUBICSPLINE")),
    "interpolation BEZIER": ("refused", partial(draw_skeleton, kind="BEZIER")),
    "`matrix` of rotation and one scale": ("exact", partial(with_matrix, _draw_scale, False)),
    "the same above the skeleton": ("exact", partial(with_matrix, _draw_scale, True)),
    "`matrix` with a mirror":
        ("refused", partial(with_matrix, lambda rng: np.diag(rng.permutation([-1.0, 1.0, 1.0])), False)),
    "`matrix` with a point mirror": ("refused", partial(with_matrix, lambda rng: -_draw_scale(rng), False)),
    "`matrix` with shear": ("refused", partial(with_matrix, _draw_shear, False)),
    "`matrix` with uneven scale":
        ("refused", partial(with_matrix, lambda rng: np.diag(rng.uniform(0.1, 2.0, 3)), False)),
    "shear above the skeleton": ("refused", partial(with_matrix, _draw_shear, True)),
    "`scale` of one size": ("exact", partial(with_node, {"scale": [1.7, 1.7, 1.7]})),
    "`scale`, uneven": ("refused", partial(with_node, {"scale": [1.0, 1.3, 1.0]})),
    "`scale`, mirrored": ("refused", partial(with_node, {"scale": [-1.0, 1.0, 1.0]})),
    "`scale` by keys, one size": ("exact", partial(with_scale_keys, 1.5)),
    "`scale` by keys, growing": ("refused", partial(with_scale_keys, 2.0)),
    "a skin below an armature that moves": ("exact", with_skin),
    "a required extension of nobody": ("refused", partial(with_properties, {"extensionsRequired": ["ACME_bones"]})),
    "a required extension of materials":
        ("exact", partial(with_properties, {"extensionsRequired": ["KHR_materials_unlit"]})),
    "`minVersion` 2.9": ("refused", partial(with_properties, {"asset": {"version": "2.9", "minVersion": "2.9"}})),
    "version 2.9 for readers of 2.0":
        ("exact", partial(with_properties, {"asset": {"version": "2.9", "minVersion": "2.0"}})),
    "two animations": (
        "warned",
        lambda rng: replace(draw_skeleton(rng), further_animations=[draw_skeleton(rng).channels[:4]]),
    ),
    "`extras.fps` 7 of strangers": ("exact", partial(with_fps, 7)),
    "`extras.fps` 1000 of strangers": ("exact", partial(with_fps, 1000)),
    "`extras.fps` that keys confirm": ("exact", partial(with_fps, None)),
    "Frame Time of a usual rate":
        ("exact", partial(with_frame_times, ("0.0333333", "0.041667", ".008333", "0.04", "0.0333667", "0.0167"))),
    "Frame Time .07, .3, .06, .017": ("exact", partial(with_frame_times, (".07", ".3", ".06", ".017"))),
    "Frame Time .033, .0083, .042": ("warned", partial(with_frame_times, (".033", ".0083", ".042"))),
}  # fmt: skip
"""Kind -> expected verdict, and the function that makes a file."""


def judge_file(content: bytes) -> str:
    """Returns the verdict on a file: "exact", "warned" (that something differs), "refused", or "SILENT": wrong, or read
    although it must be refused.
    """
    is_bvh = content.startswith(b"HIERARCHY")
    name = "made.bvh" if is_bvh else "made.glb" if content.startswith(b"glTF") else "made.vrma"
    try:
        clip = formats.parse(content, name)
    except InputError:
        return "refused"
    try:
        names, world, is_complete = (_evaluate_bvh if is_bvh else _evaluate_gltf)(content, len(clip), clip.fps)
    except evaluators.MustRefuseError:
        return "SILENT"
    expected = world[..., :3, 3][:, [names.index(joint) for joint in clip.skeleton.names]]
    positions, is_warned = kinematics.forward(clip)[1], bool(left_out_warnings(clip))
    fits = expected.shape == positions.shape and np.abs(expected - positions).max() < METRES
    return "SILENT" if not (fits and (is_complete or is_warned)) else "warned" if is_warned else "exact"


def _evaluate_gltf(content: bytes, n_frames: int, fps: float) -> tuple[list[str], np.ndarray, bool]:
    """Returns names and matrices of all nodes at the times of frames, and whether these show all that the file holds:
    its only animation, to the last key, and every key if keys are even.
    """
    file = evaluators.GltfFile(content)
    keys = np.unique(np.concatenate([keys for (_, path), (keys, *_) in file.channels(0).items() if path != "scale"]))
    times = evaluators.compute_frame_times(keys, n_frames, fps)
    steps, off = np.diff(keys), np.abs(keys[:, None] - times).min(axis=1) * fps
    is_even = np.ptp(steps) < _EVEN * steps.mean()
    is_complete = len(file.json["animations"]) == 1 and off[-1] < _NEAR and (not is_even or off.max() < _OFF)
    return *evaluators.evaluate_gltf(content, times, near_s=_NEAR / fps), bool(is_complete)


def _evaluate_bvh(content: bytes, n_frames: int, fps: float) -> tuple[list[str], np.ndarray, bool]:
    return *evaluators.evaluate_bvh(content), abs(evaluators.read_frame_time(content) * fps - 1.0) <= RATE


def count_verdicts(kind: str, n: int) -> Counter[str]:
    """Returns how many of ``n`` files of a kind had which verdict."""
    counts, make = Counter[str](), KINDS[kind][1]
    for seed in range(n):
        draft = make(np.random.default_rng([seed, *kind.encode()]))
        counts[judge_file(draft if isinstance(draft, bytes) else draft.encode())] += 1
    return counts


def main() -> None:
    """Prints a row for each kind; exit status 1 if a file was silently wrong."""
    n, n_silent = int(sys.argv[1]) if sys.argv[1:] else 50, 0
    print("| kind | files | exact | warned | refused | SILENT |\n| --- | --- | --- | --- | --- | --- |")
    for kind in KINDS:
        counts = count_verdicts(kind, n)
        columns = (counts[key] for key in ("exact", "warned", "refused", "SILENT"))
        print(f"| {kind} | {n} | {' | '.join(map(str, columns))} |", flush=True)
        n_silent += counts["SILENT"]
    sys.exit(n_silent > 0)


if __name__ == "__main__":
    main()
