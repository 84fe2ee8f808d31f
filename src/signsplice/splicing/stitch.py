"""``stitch``: sentences from poses of the package pose-format, in the place of spoken-to-signed's concatenate_poses."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from signsplice.errors import InputError
from signsplice.formats.pose import clip_of
from signsplice.motion import Clip
from signsplice.motion.points import Component, PointLayout
from signsplice.splicing.durations import NATURAL
from signsplice.splicing.engine import splice
from signsplice.splicing.options import SpliceOptions


def stitch(
    poses: Sequence[Any],
    signing_spans: Sequence[tuple[int, int] | None] | None = None,
    options: SpliceOptions | None = None,
) -> Any:
    """Joins the landmarks of words into a sentence: a drop-in for ``concatenate_poses`` of spoken-to-signed.

    poses: ``pose_format.Pose`` objects, one person each. signing_spans: frames of each pose between which it signs,
    half-open; None where unknown. options: of the splice; by default signs get the tempo of running signing.

    Returns a new pose with the header and the framing of the first. Raises ``InputError`` if there is none, or one
    shows no signer.
    """
    if not poses:
        raise InputError("no poses, expected at least one")
    spans = signing_spans or [None] * len(poses)
    clips = [_clip(pose, span, number) for number, (pose, span) in enumerate(zip(poses, spans, strict=True))]
    joined = splice(clips, options or SpliceOptions(tempo=NATURAL)).clip
    points = joined.points
    if points is None:
        raise InputError("options: on another skeleton a sentence has no landmarks, expected none in onto")
    first, unseen = poses[0], np.repeat(points.confidence[..., None] <= 0.0, points.values.shape[2], axis=2)
    data = np.ma.masked_array(points.values[:, None], unseen[:, None])
    body = type(first.body)(joined.fps, data, points.confidence[:, None])
    return type(first)(first.header, body)


def _clip(pose: Any, span: tuple[int, int] | None, number: int) -> Clip:
    header, body = pose.header, pose.body
    size = header.dimensions
    layout = PointLayout(
        tuple(
            Component(group.name, tuple(group.points), tuple(map(tuple, group.limbs)), (), group.format)
            for group in header.components
        ),
        (size.width, size.height, size.depth),
    )
    values, confidence = np.ma.getdata(body.data), np.asarray(body.confidence)
    if not len(values) or values.shape[1] != 1:
        raise InputError(f"pose {number}: {len(values)} frames of {values.shape[1]} people, expected frames of one")
    start, stop = span or (0, len(values))
    return clip_of(layout, values[start:stop, 0].astype(np.float32), confidence[start:stop, 0], body.fps, str(number))
