"""Encodes clips for the wire: a report with files in base64, or binary frames."""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping, Sequence
from pathlib import Path, PurePath
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np

from signsplice.errors import InputError
from signsplice.formats import FORMATS, WIRE_FORMATS, glb
from signsplice.formats import encode as encode_file
from signsplice.motion import Clip, resample
from signsplice.rig.info import rig_info
from signsplice.splicing import report as reports
from signsplice.splicing.engine import Span, SpliceResult

if TYPE_CHECKING:
    from signsplice.service.wire import Files, Format

Rows = Sequence[Mapping[str, Any]]
FILM_FPS = 12.5
"""Maximum frame rate of a film, Hz; a worker takes some 40 ms to draw each frame."""
_FILM_SIZE = (320, 320)
"""Width and height of a film, pixels."""


def media_type(form: Format) -> str:
    """Return the Content-Type of a format."""
    return FORMATS[f".{form}"].media_type


def encode(clip: Clip, form: Format, mesh: bool = True, whole_face: bool = False) -> bytes:
    """Encode a clip as a file; ``mesh``, ``whole_face``: options of a .glb (``glb.document``). Raises ``InputError`` if
    the format cannot hold the clip.
    """
    return glb.encode(clip, mesh, whole_face) if form == "glb" else encode_file(clip, f"clip.{form}")


def from_clip(
    clip: Clip, report: Mapping[str, Any] | None, formats: Sequence[Format], figure: bytes | None = None
) -> dict[str, Any]:
    """Return a clip from a file as ``wire.Spliced``. ``report``: of the splice that made it; None for one sign.
    ``figure``: the .glb that shows the clip, in place of one with the mannequin.
    """
    if report is None:
        all_frames = (0, len(clip))
        spans = (Span("sign", 0, clip.name, all_frames, all_frames),)
        unspliced = SpliceResult(clip, spans, (), (), cutter="", transition="", timing_ms={})
        report = {**reports.describe(unspliced), "timing_ms": {}}
    scene = splice_response(clip, report, formats)
    if figure is not None:
        scene["files"]["glb"] = base64.b64encode(figure).decode("ascii")
    return scene


def splice_response(
    clip: Clip, report: Mapping[str, Any], formats: Sequence[Format], units: Rows = (), **glb_has: bool
) -> dict[str, Any]:
    """Return a clip and the report of its splice as JSON-ready ``wire.Spliced``. ``units``: how each gloss was read.
    ``glb_has``: further arguments of ``encode``.
    """
    files: Files = dict.fromkeys(WIRE_FORMATS)
    warnings = list(report["warnings"])
    for form in formats:
        try:
            files[form] = base64.b64encode(encode(clip, form, **glb_has)).decode("ascii")
        except InputError as error:
            warnings.append(f"no .{form} file of this clip: {error}")
    return {
        "name": clip.name, "report": {**report, "warnings": warnings}, "files": files, "units": list(units),
        "spelled": [unit["token"] for unit in units if unit["spelled"]],
    }  # fmt: skip


def picture(result: SpliceResult, form: str) -> bytes:
    """Draw a splice as one of ``wire.PICTURES``. Raises ``MissingExtraError`` if Pillow is not installed."""
    from signsplice.render import film

    clip = result.clip if form == "png" else resample(result.clip, min(FILM_FPS, result.clip.fps))
    scale = (len(clip) - 1) / max(len(result.clip) - 1, 1)
    marks = [film.Mark(span.kind, span.name or "", *(round(scale * n) for n in span.output)) for span in result.spans]
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"picture.{form}"
        film.write_pictures(clip, path, marks, size=None if form == "png" else _FILM_SIZE)
        return path.read_bytes()


def to_json(message: Mapping[str, Any]) -> bytes:
    """Encode a message as compact JSON."""
    return json.dumps(message, ensure_ascii=False, allow_nan=False, separators=(",", ":")).encode()


def skeleton(clip: Clip) -> dict[str, Any]:
    """Return the skeleton of a stream's frames as ``wire.SkeletonMessage``, without nodes and names of methods."""
    return {
        "type": "skeleton",
        "fps": clip.fps,
        "names": list(clip.skeleton.names),
        "parents": clip.skeleton.parents.tolist(),
        "offsets": clip.skeleton.offsets.tolist(),
        "metres": rig_info(clip.skeleton).sizes.unit.metres,
    }


def frames(clip: Clip, first: int) -> bytes:
    """Encode a clip's frames as a binary message (``wire.FRAMES_HEADER``); ``first``: number of the first frame."""
    from signsplice.service.wire import FRAMES_HEADER, FRAMES_MAGIC  # a page is written without the extra too

    n_frames, n_joints = clip.local_rotations.shape[:2]
    rows = np.empty((n_frames, 3 + 4 * n_joints), "<f4")
    rows[:, :3] = clip.root_positions
    rows[:, 3:] = clip.local_rotations.reshape(n_frames, -1)
    return FRAMES_HEADER.pack(FRAMES_MAGIC, first, n_frames, n_joints) + rows.tobytes()


def safe_name(text: str) -> str:
    """Return a caller's name as a file name without folder: printable, at most 80 characters; "clip" if it is empty."""
    name = PurePath(text.replace("\\", "/")).name
    return "".join(c if c.isprintable() and c not in '<>:"|?*/' else "_" for c in name)[:80] or "clip"
