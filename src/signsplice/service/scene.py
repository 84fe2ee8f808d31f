"""Clips as what the wire carries: a report and files in base64, or frames in binary."""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import PurePath
from typing import Any

import numpy as np

from signsplice.errors import InputError
from signsplice.formats import bvh, gltf
from signsplice.motion.clip import Clip
from signsplice.rig import proportions
from signsplice.service.wire import FRAMES, MAGIC, Files, Format
from signsplice.splicing import report as reports
from signsplice.splicing.engine import SpliceResult

MEDIA_TYPES: dict[Format, str] = {
    "bvh": "text/plain; charset=utf-8",
    "glb": "model/gltf-binary",
    "vrma": "model/gltf-binary",
}


def encode(clip: Clip, form: Format) -> bytes:
    """The bytes of a clip's file. Raises ``InputError`` where the clip cannot be one."""
    if form == "bvh":
        return bvh.render(clip).encode()
    made = gltf.person(clip) if form == "glb" else gltf.vrm_animation(clip)
    return b"".join(made.save_to_bytes())


def spliced(result: SpliceResult, formats: Sequence[Format], units: Sequence[Mapping[str, Any]] = ()) -> dict[str, Any]:
    """A splice as ``wire.Spliced``, JSON-ready."""
    return _scene(result.clip, reports.describe(result), formats, units)


def shown(clip: Clip, report: Mapping[str, Any] | None, formats: Sequence[Format]) -> dict[str, Any]:
    """A clip from a file as ``wire.Spliced``, with the report of the splice that made it; one sign without."""
    if report is None:
        span = {"kind": "sign", "clip": 0, "name": clip.name, "source": [0, len(clip)], "output": [0, len(clip)]}
        report = {"version": reports.VERSION, "fps": clip.fps, "frames": len(clip), "cutter": "", "transition": "",
                  "bundle": None, "spans": [span], "seams": [], "warnings": [], "timing_ms": {}}  # fmt: skip
    return _scene(clip, report, formats, ())


def _scene(
    clip: Clip, report: Mapping[str, Any], formats: Sequence[Format], units: Sequence[Mapping[str, Any]]
) -> dict[str, Any]:
    files, said = asdict(Files()), []
    for form in formats:
        try:
            files[form] = base64.b64encode(encode(clip, form)).decode("ascii")
        except InputError as error:
            said.append(f"no .{form} of it: {error}")
    report = {**report, "warnings": [*report["warnings"], *said]}
    return {"name": clip.name, "report": report, "files": files, "units": list(units)}


def to_json(message: Mapping[str, Any]) -> bytes:
    """A message as it goes over the wire."""
    return json.dumps(message, ensure_ascii=False, allow_nan=False, separators=(",", ":")).encode()


def skeleton(clip: Clip) -> dict[str, Any]:
    """The skeleton of a stream's frames as ``wire.SkeletonMessage``, but for the methods' names."""
    return {
        "type": "skeleton",
        "fps": clip.fps,
        "names": list(clip.skeleton.names),
        "parents": clip.skeleton.parents.tolist(),
        "offsets": clip.skeleton.offsets.tolist(),
        "metres": proportions.sizes(clip.skeleton).unit.metres,
    }


def frames(clip: Clip, first: int) -> bytes:
    """The binary message of a clip's frames, the first of which has number ``first`` in the stream."""
    n_frames, n_joints = clip.local_rotations.shape[:2]
    numbers = np.empty((n_frames, 3 + 4 * n_joints), "<f4")
    numbers[:, :3] = clip.root_positions
    numbers[:, 3:] = clip.local_rotations.reshape(n_frames, -1)
    return FRAMES.pack(MAGIC, first, n_frames, n_joints) + numbers.tobytes()


def safe_name(text: str) -> str:
    """A name for a download or a clip out of whatever a caller sent: no folder, nothing unprintable, 80 letters."""
    name = PurePath(text.replace("\\", "/")).name
    return "".join(c if c.isprintable() and c not in '<>:"|?*/' else "_" for c in name)[:80] or "clip"
