"""glTF and BVH files of odd kinds, read and compared with ``evaluators``: ``python attacks/formats.py [N]``.

N random skeletons of each kind (50). A file has to be read with every joint where the standard puts it in every frame,
to be refused, or to be read with a warning that names what is otherwise. Prints a row of a Markdown table for each
kind; exit status 1 where a file was anything else: silently wrong. Takes half a minute.
"""

from __future__ import annotations

import base64
import json
import struct
import sys
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

import evaluators
from signsplice import formats
from signsplice.errors import InputError
from signsplice.motion import kinematics
from signsplice.rig.inspection import left_out_warnings

METRES = 1e-5
"""A joint that is farther off than this is wrong."""
RATE = 0.0025
"""By which fraction a frame rate may differ from its file's without a word."""
_NEAR, _EVEN, _OFF = 1e-3, 0.01, 0.11
"""Fractions of a frame: within the first a time is at a key; steps of even keys differ by less than the second, and
frames lie beside such keys by less than the third.
"""
Rng = np.random.Generator


@dataclass
class Made:
    """A glTF file under construction: the nodes of a random skeleton in its document, and what animates them.

    channels: node, path, key times, values, interpolation.
    more: further animations, each a list of channels.
    top: further properties of the document.
    extras: of the first animation.
    is_binary: whether it becomes a .glb file.
    """

    nodes: list[dict[str, Any]]
    channels: list[tuple[int, str, np.ndarray, np.ndarray, str]]
    more: list[list[tuple[int, str, np.ndarray, np.ndarray, str]]] = field(default_factory=list)
    top: dict[str, Any] = field(default_factory=dict)
    extras: dict[str, Any] | None = None
    is_binary: bool = False

    def content(self) -> bytes:
        """The bytes of the file."""
        blob, views, accessors = bytearray(), [], []

        def put(values: np.ndarray, kind: str) -> int:
            views.append({"buffer": 0, "byteOffset": len(blob), "byteLength": 4 * values.size})
            blob.extend(np.asarray(values, "<f4").tobytes())
            count = values.size // {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[kind]
            accessors.append({"bufferView": len(views) - 1, "componentType": 5126, "count": count, "type": kind})
            return len(accessors) - 1

        animations: list[dict[str, Any]] = []
        for number, channels in enumerate([self.channels, *self.more]):
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
        made = {"asset": {"version": "2.0"}, "nodes": self.nodes, "animations": animations, "buffers": [buffer],
                "bufferViews": views, "accessors": accessors, **self.top}  # fmt: skip
        text = json.dumps(made).encode()
        if not self.is_binary:
            return text
        text += b" " * (-len(text) % 4)
        chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(blob), b"BIN\0") + blob
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def quats(rng: Rng, *shape: int) -> np.ndarray:
    """Random unit quaternions."""
    out = rng.normal(size=(*shape, 4))
    return np.asarray(out / np.linalg.norm(out, axis=-1, keepdims=True))


def wave(rng: Rng, n: int, kind: str = "LINEAR") -> np.ndarray:
    """Keys of a rotation: quaternions (n, 4) that move by small steps, with tangents (n, 3, 4) for splines."""
    out = quats(rng, 1) + 0.1 * rng.normal(size=(n, 4)).cumsum(axis=0)
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    return out if kind != "CUBICSPLINE" else np.stack([rng.normal(size=out.shape), out, rng.normal(size=out.shape)], 1)


def skeleton(rng: Rng, kind: str = "LINEAR", times: np.ndarray | None = None) -> Made:
    """A chain with a branch: every joint rotates, the root moves, at 24, 30, 60 or 100 frames a second."""
    n, fps = int(rng.integers(4, 12)), int(rng.choice([24, 30, 60, 100]))
    times = np.arange(int(rng.integers(5, 30))) / fps if times is None else times
    nodes: list[dict[str, Any]] = [
        {"name": f"joint {k}", "translation": rng.normal(size=3).tolist(), "rotation": quats(rng).tolist(),
         "children": [k + 1] if k + 1 < n else []} for k in range(n)
    ]  # fmt: skip
    nodes[n // 2]["children"].append(n)
    nodes.append({"name": "branch", "translation": rng.normal(size=3).tolist()})
    channels = [(k, "rotation", times, wave(rng, len(times), kind), kind) for k in range(n)]
    moved = rng.normal(size=(len(times), *([3] if kind == "CUBICSPLINE" else []), 3))
    return Made(nodes, [*channels, (0, "translation", times, moved, kind)], is_binary=bool(rng.integers(2)))


def with_matrix(change: Callable[[Rng], np.ndarray], above: bool = False) -> Callable[[Rng], Made]:
    """Files in which a node, the branch or one ``above`` the skeleton, has a matrix: a rotation times ``change``."""

    def make(rng: Rng) -> Made:
        made = skeleton(rng)
        matrix = np.eye(4)
        matrix[:3, :3] = evaluators.matrices(quats(rng, 1))[0] @ change(rng)
        matrix[:3, 3] = rng.normal(size=3)
        stored = {"matrix": matrix.T.ravel().tolist()}
        if above:
            made.nodes.append({"name": "armature", "children": [0], **stored})
        else:
            made.nodes[-1] = {"name": "branch", "children": [len(made.nodes)], **stored}
            made.nodes.append({"name": "tip", "translation": rng.normal(size=3).tolist()})
        return made

    return make


def with_node(**fields: Any) -> Callable[[Rng], Made]:
    """Files whose branch has a tip, and fields of its own."""

    def make(rng: Rng) -> Made:
        made = skeleton(rng)
        made.nodes[-1].update(fields, children=[len(made.nodes)])
        made.nodes.append({"name": "tip", "translation": rng.normal(size=3).tolist()})
        return made

    return make


def with_top(**top: Any) -> Callable[[Rng], Made]:
    """Files with further properties of the document."""
    return lambda rng: replace(skeleton(rng), top=top)


def interpolated(kind: str) -> Callable[[Rng], Made]:
    """Files whose keys are interpolated so."""
    return lambda rng: skeleton(rng, kind)


def uneven(kind: str) -> Callable[[Rng], Made]:
    """Files whose keys lie at random times, other ones for each joint."""

    def make(rng: Rng) -> Made:
        def times() -> np.ndarray:
            return rng.uniform(0.01, 0.09, int(rng.integers(4, 20))).cumsum()

        made = skeleton(rng, kind, times())
        for k, (node, path, keys, values, _) in enumerate(made.channels):
            if path == "rotation" and rng.random() < 0.5:
                keys = times()
                values = wave(rng, len(keys), kind)
            made.channels[k] = node, path, keys, values, kind
        return made

    return make


def with_fps(fps: float | None) -> Callable[[Rng], Made]:
    """Files whose extras name a frame rate; None: that of their keys."""

    def make(rng: Rng) -> Made:
        made = skeleton(rng)
        return replace(made, extras={"fps": fps or 1.0 / np.diff(made.channels[0][2]).mean()})

    return make


def of_two(rng: Rng) -> Made:
    """A file of two animations."""
    return replace(skeleton(rng), more=[skeleton(rng).channels[:4]])


def scaled(last: float) -> Callable[[Rng], Made]:
    """Files in which keys scale a joint by 1.5, and in the end by ``last``."""

    def make(rng: Rng) -> Made:
        made = skeleton(rng)
        times = made.channels[0][2]
        sizes = np.linspace(1.5, last, len(times))[:, None].repeat(3, axis=1)
        return replace(made, channels=[*made.channels, (1, "scale", times, sizes, "LINEAR")])

    return make


def skinned(rng: Rng) -> Made:
    """A file whose skin has some of the joints, below an armature that is scaled and moves."""
    made = skeleton(rng)
    n, times = len(made.nodes), made.channels[0][2]
    made.nodes += [{"name": "armature", "scale": [0.01] * 3, "children": [0]}]
    made.channels.append((n, "rotation", times, wave(rng, len(times)), "LINEAR"))
    return replace(made, top={"skins": [{"joints": sorted({1, n - 2, n - 1})}]})


def bvh(*frame_times: str) -> Callable[[Rng], bytes]:
    """BVH files of a random skeleton with one of these Frame Times."""

    def make(rng: Rng) -> bytes:
        n, n_frames = int(rng.integers(3, 9)), int(rng.integers(2, 12))
        lines, width = ["HIERARCHY"], 0
        for k in range(n):
            channels = [f"{'XYZ'[axis]}rotation" for axis in rng.permutation(3)]
            if k == 0 or rng.random() < 0.3:
                places = [f"{'XYZ'[axis]}position" for axis in rng.permutation(3)]
                channels = channels + places if rng.random() < 0.5 else places + channels
            width += len(channels)
            lines += [f"{'JOINT' if k else 'ROOT'} j{k} {{", f"OFFSET {' '.join(map(str, rng.normal(size=3)))}"]
            lines.append(f"CHANNELS {len(channels)} {' '.join(channels)}")
        lines += ["End Site {", "OFFSET 0 1 0", "}", *"}" * n, "MOTION", f"Frames: {n_frames}"]
        lines.append(f"Frame Time: {rng.choice(frame_times)}")
        rows = rng.uniform(-180, 180, (n_frames, width))
        return "\n".join([*lines, *(" ".join(map(str, row)) for row in rows), ""]).encode()

    return make


def _shear(rng: Rng) -> np.ndarray:
    out = np.eye(3)
    out[0, 1] = rng.uniform(0.1, 1.0)
    return np.asarray(out / np.linalg.norm(out, axis=0))  # as if of one scale


def _size(rng: Rng) -> np.ndarray:
    return np.asarray(np.eye(3) * rng.uniform(0.01, 3.0))


KINDS: dict[str, tuple[str, Callable[[Rng], Made | bytes]]] = {
    "linear keys": ("exact", interpolated("LINEAR")),
    "step keys": ("exact", interpolated("STEP")),
    "spline keys": ("exact", interpolated("CUBICSPLINE")),
    "keys at uneven times, linear": ("exact", uneven("LINEAR")),
    "keys at uneven times, step": ("exact", uneven("STEP")),
    "keys at uneven times, spline": ("exact", uneven("CUBICSPLINE")),
    "interpolation BEZIER": ("refused", interpolated("BEZIER")),
    "`matrix` of rotation and one scale": ("exact", with_matrix(_size)),
    "the same above the skeleton": ("exact", with_matrix(_size, above=True)),
    "`matrix` with a mirror": ("refused", with_matrix(lambda rng: np.diag(rng.permutation([-1.0, 1.0, 1.0])))),
    "`matrix` with a point mirror": ("refused", with_matrix(lambda rng: -_size(rng))),
    "`matrix` with shear": ("refused", with_matrix(_shear)),
    "`matrix` with uneven scale": ("refused", with_matrix(lambda rng: np.diag(rng.uniform(0.1, 2.0, 3)))),
    "shear above the skeleton": ("refused", with_matrix(_shear, above=True)),
    "`scale` of one size": ("exact", with_node(scale=[1.7, 1.7, 1.7])),
    "`scale`, uneven": ("refused", with_node(scale=[1.0, 1.3, 1.0])),
    "`scale`, mirrored": ("refused", with_node(scale=[-1.0, 1.0, 1.0])),
    "`scale` by keys, one size": ("exact", scaled(1.5)),
    "`scale` by keys, growing": ("refused", scaled(2.0)),
    "a skin below an armature that moves": ("exact", skinned),
    "a required extension of nobody": ("refused", with_top(extensionsRequired=["ACME_bones"])),
    "a required extension of materials": ("exact", with_top(extensionsRequired=["KHR_materials_unlit"])),
    "`minVersion` 2.9": ("refused", with_top(asset={"version": "2.9", "minVersion": "2.9"})),
    "version 2.9 for readers of 2.0": ("exact", with_top(asset={"version": "2.9", "minVersion": "2.0"})),
    "two animations": ("warned", of_two),
    "`extras.fps` 7 of strangers": ("exact", with_fps(7)),
    "`extras.fps` 1000 of strangers": ("exact", with_fps(1000)),
    "`extras.fps` that keys confirm": ("exact", with_fps(None)),
    "Frame Time of a usual rate": ("exact", bvh("0.0333333", "0.041667", ".008333", "0.04", "0.0333667", "0.0167")),
    "Frame Time .07, .3, .06, .017": ("exact", bvh(".07", ".3", ".06", ".017")),
    "Frame Time .033, .0083, .042": ("warned", bvh(".033", ".0083", ".042")),
}
"""Kind -> what is expected of its files, and how one is made."""


def verdict(content: bytes) -> str:
    """What becomes of a file: "exact", "warned" (that something is otherwise), "refused", or "SILENT": wrong, or read
    although it must be refused.
    """
    is_bvh = content.startswith(b"HIERARCHY")
    name = "made.bvh" if is_bvh else "made.glb" if content.startswith(b"glTF") else "made.vrma"
    try:
        clip = formats.parse(content, name)
    except InputError:
        return "refused"
    found = kinematics.forward(clip)[1]
    try:
        names, expected, is_complete = _bvh(content, clip.fps) if is_bvh else _gltf(content, len(clip), clip.fps)
    except evaluators.MustRefuseError:
        return "SILENT"
    expected = expected[:, [names.index(joint) for joint in clip.skeleton.names]]
    fits = expected.shape == found.shape and np.abs(expected - found).max() < METRES
    if not fits or not (is_complete or left_out_warnings(clip)):
        return "SILENT"
    return "warned" if left_out_warnings(clip) else "exact"


def _gltf(content: bytes, n_frames: int, fps: float) -> tuple[list[str], np.ndarray, bool]:
    """Names and positions of all nodes at the times of frames, and whether those show all that the file holds: its only
    animation, to the last key, and every key where keys are even.
    """
    keys = evaluators.gltf_keys(content)
    times = evaluators.frame_times(keys, n_frames, fps)
    steps, off = np.diff(keys), np.abs(keys[:, None] - times).min(axis=1) * fps
    is_even = np.ptp(steps) < _EVEN * steps.mean()
    joints = evaluators.gltf_joints(content, times, near_s=_NEAR / fps)
    return *joints, bool(
        evaluators.n_animations(content) == 1 and off[-1] < _NEAR and (not is_even or off.max() < _OFF)
    )


def _bvh(content: bytes, fps: float) -> tuple[list[str], np.ndarray, bool]:
    return *evaluators.bvh_joints(content), abs(evaluators.bvh_frame_time(content) * fps - 1.0) <= RATE


def seen(kind: str, n: int) -> Counter[str]:
    """How many of ``n`` files of a kind came to which verdict."""
    out, make = Counter[str](), KINDS[kind][1]
    for seed in range(n):
        made = make(np.random.default_rng([seed, *kind.encode()]))
        out[verdict(made if isinstance(made, bytes) else made.content())] += 1
    return out


def main() -> None:
    """Print a row for each kind; exit status 1 where a file was silently wrong."""
    n, n_silent = int(sys.argv[1]) if sys.argv[1:] else 50, 0
    print("| kind | files | exact | warned | refused | SILENT |\n| --- | --- | --- | --- | --- | --- |")
    for kind in KINDS:
        counts = seen(kind, n)
        columns = (counts[verdict] for verdict in ("exact", "warned", "refused", "SILENT"))
        print(f"| {kind} | {n} | {' | '.join(map(str, columns))} |", flush=True)
        n_silent += counts["SILENT"]
    sys.exit(n_silent > 0)


if __name__ == "__main__":
    main()
