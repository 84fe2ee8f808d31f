"""Faces in FBX files: blend shapes that a take moves, known by their names (``motion.face_shapes``)."""

from __future__ import annotations

import numpy as np

from signsplice.formats.fbx_objects import FbxObjects, name_of, numbers_of
from signsplice.formats.fbx_takes import PERCENT, Take
from signsplice.motion.arrays import FloatArray
from signsplice.motion.face import Face, face_from, shape_of


def face_of(objects: FbxObjects, take: Take, times: FloatArray) -> tuple[Face | None, tuple[str, ...]]:
    """The face that a take shows at ``times`` (T,), None where it moves no blend shape that is known, and the blend
    shapes that it moves besides. Of meshes that share a name the first counts.
    """
    tracks, unknown = dict[str, FloatArray](), dict[str, None]()
    for key, record in objects.all("Deformer", "BlendShapeChannel"):
        name = name_of(record.values[1])
        if not any((key, PERCENT) in layer.curves for layer in take.layers) or name in tracks:
            continue
        if shape_of(name) is None:
            unknown[f"blend shape {name}"] = None
            continue
        rest = numbers_of(record).get(PERCENT, record.numbers(PERCENT))
        percent = take.values(key, PERCENT, np.append(rest, 0.0)[:1], times)
        tracks[name] = np.broadcast_to(percent[:, 0] / 100.0, len(times))
    face = face_from(list(tracks), np.stack(list(tracks.values()), axis=1)) if tracks else None
    return face, tuple(unknown)
