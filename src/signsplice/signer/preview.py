"""Pictures for authors of signs: the postures and movements of one sign, and every name of the notation."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from signsplice.motion import FloatArray
from signsplice.render.picture import Image, Scene, around_hand, draw, draw_dots, draw_hand, make_scene
from signsplice.render.sheet import write_cells
from signsplice.rig.roles import SIDES
from signsplice.signer import locations, notation, planner, pose
from signsplice.signer.hand import PARTS_OF_HAND
from signsplice.signer.handshapes import HANDSHAPES
from signsplice.signer.locations import ON_HEAD, WeakArm
from signsplice.signer.phonology import HEAD, IN_SPACE, LOCALS, LOCATIONS, ON_ARM, ON_BASE, TRUNK, Posture, Sign
from signsplice.signer.planner import IsolatedWord
from signsplice.signer.signer import JOINTS, PLAIN, STANDARD
from signsplice.signer.tables import FOLDER, Vector

_MOST_COLUMNS = 10
DOT = (204, 24, 84)
"""Colour of paths and places."""


def write_preview(word: IsolatedWord, path: Path, size: int = 230) -> None:
    """Write one sign as PNG: its postures, and each movement half way with the paths of the hands that act, from the
    front and from the side; below, these hands alone.
    """
    steps = list(_steps(word))[:_MOST_COLUMNS]
    acting = [side for side in SIDES if word.sign.two_handed or (side == "left") == word.signer.left_handed]
    scenes = [make_scene(word.clip, view) for view in ("front", "side")]
    cells: list[tuple[Image, str]] = []
    for scene in scenes:
        for frame, label, frames in steps:
            trail = scene.hands[frames, [SIDES.index(side) for side in acting]].reshape(-1, 3)
            cells.append((draw_dots(draw(scene, frame, size, size), scene, trail, DOT, 2.0), label))
    for side in acting:
        cells += [(draw_hand(scenes[0], frame, side, size), f"{side} hand") for frame, _, _ in steps]
    write_cells(cells, path, len(steps))


def _steps(word: IsolatedWord) -> Iterator[tuple[int, str, slice]]:
    """Yields frames to show, their labels, and the frames whose paths are drawn: the first posture, and the middle and
    the end of the first pass of each movement.
    """
    yield word.events.start, word.sign.gloss, slice(0)
    for n, timed in enumerate(word.segments, 1):
        if timed.segment.kind == "M":
            begin, stop = timed.passes[0] if timed.passes else (timed.begin, timed.end)
            times = f", {timed.segment.times} times" if timed.segment.times > 1 else ""
            yield (begin + stop) // 2, f"{n}: M{times}", slice(begin, stop + 1)
            yield stop, f"{n}: end of M", slice(0)


_SIGNER = replace(STANDARD, manner=PLAIN)
_CELL = 112
"""Side of the pictures of places, parts and shapes, pixels."""
_WIDE = 160
"""Side of the pictures of movements, pixels."""
_COLOURS = 128
_UPPER = 0.40
"""Height of the window that shows a movement, from the top, statures."""
_UP: Vector = (0.0, 1.0, 0.0)
_FORWARD: Vector = (0.0, 0.0, 1.0)
_BACK: Vector = (0.0, 0.0, -1.0)


def write_names(folder: Path) -> list[Path]:
    """Write a picture of every place, part of the hand, handshape and movement into a folder: the paths written."""
    shapes = [(_hand_at(Posture(name, "space", "palm", _FORWARD, _UP)), name) for name in HANDSHAPES]
    moves = [(_move(sign), sign.source) for sign in notation.read(FOLDER / "examples.signs").values()]
    swings = [(key, name) for key, names in (("local", LOCALS), ("head", HEAD), ("trunk", TRUNK)) for name in names]
    moves += [(_swing(key, name), f"{key}={name}") for key, name in swings]
    pages = {
        "places": ([(_place(name), name) for name in LOCATIONS], 9),
        "parts": ([(_part(name), name) for name in PARTS_OF_HAND], 10),
        "shapes": (shapes, 10),
        "movements": (moves, 7),
    }
    for name, (cells, columns) in pages.items():
        write_cells(cells, folder / f"notation-{name}.png", columns, _COLOURS)
    return [folder / f"notation-{name}.png" for name in pages]


def _still(strong: Posture | None = None, weak: Posture | None = None) -> tuple[FloatArray, Scene]:
    """A state (65,) of the signer with hands in postures, or at rest, and its scene."""
    state = locations.resting(_SIGNER).copy()
    if weak is not None:
        state[27:54] = locations.weak_hand(weak, _SIGNER)
    if strong is not None:
        state[:27] = locations.strong_hand(strong, WeakArm(_SIGNER, state[27:54]))
    return state, make_scene(pose.clip(state[None], _SIGNER, 30.0))


def _project_point(scene: Scene, joint: str, point: FloatArray) -> FloatArray:
    """Converts a point (3,), cm, from a joint's axes to camera axes (1, 3)."""
    world = scene.positions[0, JOINTS[joint]] + scene.rotations[0, JOINTS[joint]] @ point
    return np.asarray((world - scene.origin) @ scene.axes.T / scene.height)[None]


def _place(name: str) -> Image:
    """A dot at a location on the body, on the weak arm or hand, or in space from the front and from the side."""
    posture = None
    if name in ON_BASE | ON_ARM:
        turned = locations.locate(
            name, WeakArm(_SIGNER, locations.weak_hand(_weak_hand_posture(_FORWARD, _UP), _SIGNER))
        ).normal
        posture = _weak_hand_posture(_FORWARD if turned[2] > -0.1 else _BACK, _UP)
        if name in ON_ARM:
            posture = _weak_hand_posture((0.0, -1.0, 0.0), (-1.0, 0.0, 0.0))
    state, scene = _still(weak=posture)
    dot = _project_point(scene, "Spine2", locations.locate(name, WeakArm(_SIGNER, state[27:54])).point)
    if name in IN_SPACE:
        state, side = _still()
        side = make_scene(pose.clip(state[None], _SIGNER, 30.0), "side")
        aside = _project_point(side, "Spine2", locations.locate(name, WeakArm(_SIGNER, state[27:54])).point)
        return np.hstack(
            [_dot(_narrow_window(view, point), point, _CELL // 2) for view, point in ((scene, dot), (side, aside))]
        )
    if name in ON_HEAD or name == "throat":
        scene = _around(scene, _project_point(scene, "Spine2", np.array([0.0, 31.0, 0.0])), 0.11)
    elif name in ON_BASE - ON_ARM:
        scene = around_hand(scene, 0, "left")
    return _dot(scene, dot, _CELL)


def _weak_hand_posture(palm: Vector, fingers: Vector) -> Posture:
    """An open weak hand before the chest."""
    return Posture("B-open", "space-mid", "palm", palm, fingers, shift=(0.0, -5.0, 0.0))


def _around(scene: Scene, centre: FloatArray, reach: float) -> Scene:
    x, y, _ = centre[0].tolist()
    return replace(scene, window=(x - reach, x + reach, y - reach, y + reach))


def _narrow_window(scene: Scene, at: FloatArray) -> Scene:
    """The scene with a window half as wide as high, which shows the signer and a point."""
    _, _, bottom, top = scene.window
    middle, reach = 0.55 * float(at[0, 0]), 0.25 * (top - bottom)
    return replace(scene, window=(middle - reach, middle + reach, bottom, top))


def _dot(scene: Scene, at: FloatArray, width: int) -> Image:
    return draw_dots(draw(scene, 0, width, _CELL), scene, at, DOT, 4.0)


def _hand_at(posture: Posture) -> Image:
    """The strong hand alone, in a posture."""
    _, scene = _still(posture)
    return draw(around_hand(scene, 0, "right"), 0, _CELL, _CELL, "right")


def _part(name: str) -> Image:
    """A dot at a part of the open hand, seen from the palm or from the back."""
    part = PARTS_OF_HAND[name]
    shape = HANDSHAPES["B-open" if name != "pinch" else "F"]
    normal = part.normal(shape.points)
    palm = _FORWARD if normal[1] <= 0.0 else _BACK
    _, scene = _still(Posture(shape.name, "space", "palm", palm, _UP))
    point = part.centre(shape.points) + part.skin * normal
    scene = around_hand(scene, 0, "right")
    image = draw(scene, 0, _CELL, _CELL, "right")
    return draw_dots(image, scene, _project_point(scene, "RightHand", point * _SIGNER.hands * _SIGNER.scale), DOT, 4.0)


def _move(sign: Sign) -> Image:
    """The middle of a movement, with the paths of the acting hands, from the front, from the side or from above."""
    word = planner.synthesize_word(sign, _SIGNER)
    start, stop = word.events.start, word.events.end
    sides = [0, 1] if sign.two_handed else [1]
    scene = make_scene(word.clip)
    width, up, forward = np.ptp(scene.hands[start : stop + 1, 1], axis=0)
    if forward > 0.5 * max(width, up):
        is_level = width > 2.0 * up
        scene = make_scene(word.clip, "front" if is_level else "side", above_deg=50.0 * is_level)
    scene = _upper(scene)
    trail = scene.hands[start : stop + 1, sides].reshape(-1, 3)
    return draw_dots(draw(scene, (start + stop) // 2, _WIDE, _WIDE), scene, trail, DOT, 2.2)


def _upper(scene: Scene) -> Scene:
    """The scene with a window from the head to the belly."""
    left_edge, right, _, top = scene.window
    return replace(scene, window=(left_edge, right, top - max(_UPPER, 0.9 * (right - left_edge)), top))


def _swing(key: str, name: str) -> Image:
    """The two frames of a local movement, or of one of head or trunk, that differ most, one over the other."""
    filler = "" if key == "local" else " local=tremble:0.1:1"
    lines = ("X  hands=one", "  X  shape=B-open at=space palm=in fingers=fwd-up", f"  M  {key}={name} for=1{filler}")
    word = planner.synthesize_word(notation.parse("\n".join(lines))["X"], _SIGNER)
    start, stop = word.events.start, word.events.end
    scene = _upper(make_scene(word.clip, "side" if name in ("fwd", "back") else "front"))
    if key == "local":
        scene = around_hand(scene, start, "right")
    elif key == "head":
        scene = _around(scene, _project_point(scene, "Spine2", np.array([0.0, 31.0, 0.0])), 0.11)
    images = np.stack([draw(scene, frame, _WIDE, _WIDE) for frame in range(start - 4, stop + 5, 2)]).astype(np.float32)
    first = images[int(np.abs(images - images.mean(axis=0)).sum(axis=(1, 2, 3)).argmax())]
    second = images[int(np.abs(images - first).sum(axis=(1, 2, 3)).argmax())]
    return np.asarray(0.5 * (first + second), np.uint8)
