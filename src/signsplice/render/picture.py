"""A clip's signer as pictures: how the camera is set for a whole clip, and what is drawn."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from signsplice.errors import InputError
from signsplice.motion import kinematics, stance
from signsplice.motion.body import Body, body, place
from signsplice.motion.clip import Clip, Skeleton
from signsplice.motion.humanoid import find_roles
from signsplice.motion.mannequin import CLOTHES, SKIN, TIPS, colour
from signsplice.render.raster import Canvas

Float = NDArray[np.float64]
Image = NDArray[np.uint8]

VIEWS = {"front": 0.0, "three-quarter": 40.0, "side": 90.0}

_BLEND = {"shirt": 0.032, "face": 0.020, "sleeve": 0.012}
"""Depth, in statures, within which capsules of one thing flow together; hands keep the creases of their joints."""


@dataclass(frozen=True, eq=False)
class Scene:
    """A clip ready to be drawn: capsules' ends (T, C, 3) in camera axes (right, up, towards the viewer), in statures.

    window: (left, right, bottom, top) that holds head and hands of every frame. hands: (T, 2, 3) centres of left and
    right hand.
    """

    body: Body
    starts: Float
    ends: Float
    radii: Float
    window: tuple[float, float, float, float]
    hands: Float


def scene(clip: Clip, view: str = "front") -> Scene:
    """Set the camera for a whole clip: straight on, framed from mid-thigh to above the head, wide enough for every
    hand.

    Raises ``InputError`` for a view that is not in ``VIEWS``.
    """
    if view not in VIEWS:
        raise InputError(f"no view {view!r}, expected one of {', '.join(VIEWS)}")
    standing = stance.stand(clip)
    skeleton = _as_moved(clip)
    height = stance.stature(skeleton) or 1.0
    angle = np.deg2rad(VIEWS[view])
    left = np.cross(standing.up, standing.forward)
    towards = np.cos(angle) * standing.forward + np.sin(angle) * left
    axes = np.stack([np.cross(standing.up, towards), standing.up, towards])
    shape = body(skeleton)
    starts, ends = place(shape, *kinematics.forward(clip))
    origin = np.median(starts.reshape(-1, 3), axis=0)
    starts, ends = ((points - origin) @ axes.T / height for points in (starts, ends))
    radii = shape.radii / height
    return Scene(shape, starts, ends, radii, _window(shape, starts, ends, radii), _hand_centres(shape, starts, ends))


def _as_moved(clip: Clip) -> Skeleton:
    """The skeleton with the bones that the clip shows: a file's frames may give other lengths than its rest pose."""
    if clip.translations is None:
        return clip.skeleton
    offsets = np.median(clip.translations, axis=0)
    offsets[0] = clip.skeleton.offsets[0]
    return replace(clip.skeleton, offsets=offsets)


def _window(shape: Body, starts: Float, ends: Float, radii: Float) -> tuple[float, float, float, float]:
    """The frame of the camera: everything but the legs, from a little below the hips."""
    upper = np.array([part not in ("leg", "shoe") for part in shape.parts])
    points = np.concatenate([starts[:, upper] - radii[upper, :1], ends[:, upper] + radii[upper, :1]], axis=1)
    wide = np.concatenate([starts[:, upper] + radii[upper, :1], ends[:, upper] - radii[upper, :1]], axis=1)
    low = np.minimum(points, wide).min(axis=(0, 1))
    high = np.maximum(points, wide).max(axis=(0, 1))
    margin = 0.025
    return float(low[0] - margin), float(high[0] + margin), float(low[1] - margin), float(high[1] + margin)


def _hand_centres(shape: Body, starts: Float, ends: Float) -> Float:
    """Centres (T, 2, 3) of the left and right hand: the middle of the palm's far ends; the origin where there is no
    hand.
    """
    centres = np.zeros((len(starts), 2, 3))
    for n, side in enumerate(("left", "right")):
        palm = [
            c for c, (part, s) in enumerate(zip(shape.parts, shape.sides, strict=True)) if part == "palm" and s == side
        ]
        if palm:
            centres[:, n] = ends[:, palm].mean(axis=1)
    return centres


def draw(scene: Scene, frame: int, width: int, height: int) -> Image:
    """One frame (H, W, 3), 0..255: the signing space, as large as it fits."""
    left, right, bottom, top = scene.window
    scale = min(width / (right - left), height / (top - bottom))
    return _drawn(scene, frame, width, height, (0.5 * (left + right), 0.5 * (bottom + top)), scale, None)


def draw_hand(scene: Scene, frame: int, side: str, size: int) -> Image:
    """One hand enlarged (size, size, 3), without what stands before it."""
    centre = scene.hands[frame, 0 if side == "left" else 1]
    return _drawn(scene, frame, size, size, (float(centre[0]), float(centre[1])), size / 0.20, side)


def _drawn(
    scene: Scene, frame: int, width: int, height: int, centre: tuple[float, float], scale: float, only: str | None
) -> Image:
    canvas = Canvas(2 * width, 2 * height)
    zoom = 2.0 * scale
    middle = np.array([width, height, 0.0])

    def pixels(points: Float) -> Float:
        return np.asarray(middle + (points - np.array([*centre, 0.0])) * np.array([zoom, -zoom, zoom]))

    starts, ends = pixels(scene.starts[frame]), pixels(scene.ends[frame])
    radii = scene.radii * zoom
    groups: dict[tuple[str, str], int] = {}
    for c, (part, side) in enumerate(zip(scene.body.parts, scene.body.sides, strict=True)):
        if only is not None and (side != only or part in ("sleeve", "leg", "shoe")):
            continue
        thing = "sleeve" if part == "cuff" else part.removesuffix("Tip")
        group = groups.setdefault((thing, side), len(groups))
        size = float(radii[c, 0]), float(radii[c, 1])
        canvas.capsule(starts[c], ends[c], size, colour(part, side), group, _BLEND.get(thing, 0.0) * zoom)
    depths = np.concatenate([scene.starts[..., 2], scene.ends[..., 2]])
    return canvas.finish(
        step=0.010 * zoom, near=float(depths.max()) * zoom, far=float(np.median(depths)) * zoom - 0.1 * zoom
    )


def small_colours() -> list[tuple[int, int, int]]:
    """Colours 0..255 of small things that tell much, hands, fingertips and mouth, from bright to shaded."""
    tints = [*TIPS.values(), *SKIN.values(), CLOTHES["mouth"]]
    shades = np.linspace(1.0, 0.5, 6)[:, None] * 255.0
    return [(int(r), int(g), int(b)) for tint in tints for r, g, b in shades * np.array(tint)]


def has_hands(clip: Clip) -> bool:
    """Whether the clip's rig has hands that can be enlarged."""
    joints = find_roles(clip.skeleton).joints
    return "leftHand" in joints and "rightHand" in joints
