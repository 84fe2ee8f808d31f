"""Draws words on several bodies side by side, from front and side, each at the frame in which most skin touches."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from signsplice.body.capsules import BodyCapsules, BodyShape, build_capsules
from signsplice.body.collision import near_pairs, pair_clearances, skin_pairs
from signsplice.body.contacts import pose_body
from signsplice.body.retarget import fit_body, signing
from signsplice.formats.atomic import replacing
from signsplice.motion import Clip
from signsplice.progress import Progress, track_progress
from signsplice.render.picture import Image, draw, make_scene
from signsplice.render.sheet import INK, PAPER, write_line
from signsplice.render.skin import pillow
from signsplice.rig.align import Reference, copy_rotations, placement
from signsplice_workshop.measure.bodies import BODIES, TOUCH_M, scale_bones

WORDS = ("NAME", "MOTHER", "APPLE", "FAMILY", "PLEASE", "DEAF", "FRIEND", "HAT")
SHOWN = ("narrow", "broad", "child", "chibi", "long arms")
_VIEWS = ("front", "side")
_CELL, _LABEL = 180, 20
_ASPECT = 1.4
"""Height of a drawing over its width; the lower part is cut off, since hands are above it."""


def write_pictures(words: Sequence[Clip], path: Path, progress: Progress | None = None) -> None:
    """Writes a page as PNG, a row for each word: the source, the first body of ``SHOWN`` with copied rotations alone,
    and all bodies of ``SHOWN``, fitted.
    """
    image_ = pillow("Image")
    headings = ("source", f"{SHOWN[0]}, rotations alone", *SHOWN)
    width = _CELL * len(_VIEWS)
    sheet = image_.new("RGB", (width * len(headings), _LABEL + len(words) * (_CELL + _LABEL)), PAPER)
    pen = pillow("ImageDraw").Draw(sheet)
    for k, heading in enumerate(headings):
        write_line(pen, heading, (k + 0.5) * width, 2, width, INK, 14)
    for n, word in enumerate(track_progress(words, progress)):
        top = _LABEL + n * (_CELL + _LABEL)
        write_line(pen, word.name, 0.5 * width, top + 1, width, INK, 14)
        for k, picture in enumerate(_draw_row(word)):
            sheet.paste(image_.fromarray(picture), (k * width, top + _LABEL))
    with replacing(path) as temporary:
        sheet.quantize(64, dither=image_.Dither.NONE).save(temporary, format="PNG", optimize=True)


def _draw_row(word: Clip) -> list[Image]:
    body = build_capsules(word.skeleton, BodyShape())
    frame = _find_touching_frame(word, body)
    pictures = [_draw_views(word, body, frame)]
    for name in SHOWN:
        skeleton = scale_bones(word.skeleton, BODIES[name])
        target_body = build_capsules(skeleton, BODIES[name].shape)
        reference = Reference(skeleton, word.fps, placement(word), word.local_rotations[0], name)
        copied = copy_rotations(word, reference)[0]
        if name == SHOWN[0]:
            pictures.append(_draw_views(copied, target_body, frame))
        pictures.append(_draw_views(fit_body(word, body, copied, target_body).clip, target_body, frame))
    return pictures


def _find_touching_frame(clip: Clip, body: BodyCapsules) -> int:
    """Returns the frame in which most pairs of skins touch while the clip signs."""
    posed, pairs = pose_body(clip, body), skin_pairs(body, frozenset(body.keys))
    frames, k = near_pairs(posed.starts, posed.ends, posed.radii, pairs, TOUCH_M)
    clearance = pair_clearances(posed.starts, posed.ends, posed.radii, pairs, frames, k).distance
    signs = signing(clip)[frames, pairs.own_side[k]] > 0.5
    return int(np.bincount(frames[signs & (clearance < TOUCH_M)], minlength=len(clip)).argmax())


def _draw_views(clip: Clip, body: BodyCapsules, frame: int) -> Image:
    size = _CELL, int(_ASPECT * _CELL)
    return np.concatenate([draw(make_scene(clip, view, body), frame, *size)[:_CELL] for view in _VIEWS], axis=1)
