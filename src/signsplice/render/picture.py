"""A clip's signer as pictures: how the camera is set for a whole clip, and what is drawn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from signsplice.body.capsules import FINGERS, BodyCapsules, body_capsules, capsule_ends
from signsplice.body.mesh import CLOTHES, SKIN, TIPS, MeshPart, bind_pose, body_mesh
from signsplice.errors import InputError
from signsplice.motion import kinematics, rotation
from signsplice.motion.clip import Clip, Skeleton
from signsplice.render.raster import Canvas, Pixels, lit
from signsplice.rig import proportions
from signsplice.rig.roles import find_roles

Float = NDArray[np.float64]
Image = NDArray[np.uint8]

VIEWS = {"front": 0.0, "three-quarter": 40.0, "side": 90.0}

_PLAIN = ("leg", "shoe")
"""Parts that nothing is said with: a picture may leave them out of its frame."""


@dataclass(frozen=True, eq=False)
class Skin:
    """A mannequin in one piece: vertices and normals (V, 3) in the pose it is bound in, the joints' shares of each
    vertex (V, J), triangles (F, 3), and of each triangle its tint (F, 3), its group (F,), a number for each finger and
    0 for all else, and its hand (F,): "left", "right" or "".

    rotations (J, 3, 3), places (J, 3): of the joints in that pose.
    """

    vertices: Pixels
    normals: Pixels
    weights: csr_array
    triangles: NDArray[np.intp]
    tints: Pixels
    groups: NDArray[np.int16]
    hands: NDArray[np.str_]
    rotations: Float
    places: Float


@dataclass(frozen=True, eq=False)
class Scene:
    """A clip ready to be drawn in camera axes (right, up, towards the viewer), in statures.

    rotations (T, J, 3, 3) and places (T, J, 3) of joints in the world; axes (3, 3), origin (3,) and height: what takes
    the world into the camera's view. window: (left, right, bottom, top) that holds head and hands of every frame.
    hands: (T, 2, 3) centres of left and right hand. depths: (median, largest) distance towards the viewer.
    """

    skin: Skin
    rotations: Float
    places: Float
    axes: Float
    origin: Float
    height: float
    window: tuple[float, float, float, float]
    hands: Float
    depths: tuple[float, float]


def scene(clip: Clip, view: str = "front") -> Scene:
    """Set the camera for a whole clip: straight on, framed from mid-thigh to above the head, wide enough for every
    hand.

    Raises ``InputError`` for a view that is not in ``VIEWS``.
    """
    if view not in VIEWS:
        raise InputError(f"no view {view!r}, expected one of {', '.join(VIEWS)}")
    standing = proportions.stand(clip)
    skeleton = _as_moved(clip)
    height = proportions.stature(skeleton) or 1.0
    angle = np.deg2rad(VIEWS[view])
    left = np.cross(standing.up, standing.forward)
    towards = np.cos(angle) * standing.forward + np.sin(angle) * left
    axes = np.stack([np.cross(standing.up, towards), standing.up, towards])
    shape = body_capsules(skeleton)
    rotations, places = kinematics.forward(clip)
    starts, ends = capsule_ends(shape, rotations, places)
    origin = np.median(starts.reshape(-1, 3), axis=0)
    starts, ends = ((points - origin) @ axes.T / height for points in (starts, ends))
    towards_viewer = np.concatenate([starts[..., 2], ends[..., 2]])
    return Scene(
        skin=_skin(skeleton),
        rotations=rotations,
        places=places,
        axes=axes,
        origin=origin,
        height=height,
        window=_window(shape, starts, ends, shape.radii / height),
        hands=_hand_centres(shape, starts, ends),
        depths=(float(np.median(towards_viewer)), float(towards_viewer.max())),
    )


_SKINS: WeakKeyDictionary[Skeleton, Skin] = WeakKeyDictionary()


def _skin(skeleton: Skeleton) -> Skin:
    found = _SKINS.get(skeleton)
    if found is None:
        found = _SKINS[skeleton] = _whole(skeleton, body_mesh(skeleton))
    return found


def _whole(skeleton: Skeleton, things: Sequence[MeshPart]) -> Skin:
    """Things in one piece. Every finger is a group of its own, so that fingers are told from one another."""
    finger_of = {
        joint: FINGERS.index(finger) + 1
        for role, joint in find_roles(skeleton).joints.items()
        for finger in FINGERS
        if finger in role
    }
    fingers = np.array([finger_of.get(joint, 0) for joint in range(len(skeleton))])
    starts = np.cumsum([0, *(len(thing.vertices) for thing in things)])
    joints = np.concatenate([thing.joints for thing in things])
    weights = np.concatenate([thing.weights for thing in things])
    n_vertices, width = joints.shape
    shares = csr_array(
        (weights.ravel().astype(np.float32), joints.ravel(), np.arange(0, n_vertices * width + 1, width)),
        (n_vertices, len(skeleton)),
    )
    mostly = fingers[np.take_along_axis(joints, weights.argmax(axis=1)[:, None], axis=1)[:, 0]]
    counts = [len(thing.triangles) for thing in things]
    triangles = np.concatenate([thing.triangles + k for thing, k in zip(things, starts[:-1], strict=True)])
    sides = np.repeat(np.array([_hand_of(thing) for thing in things]), counts)
    finger = mostly[triangles[:, 0]]
    turns, places = bind_pose(skeleton)
    return Skin(
        vertices=np.concatenate([thing.vertices for thing in things]).astype(np.float32),
        normals=np.concatenate([thing.normals for thing in things]).astype(np.float32),
        weights=shares,
        triangles=triangles,
        tints=np.repeat(np.array([thing.colour for thing in things], np.float32), counts, axis=0),
        groups=np.where(finger > 0, finger + len(FINGERS) * (sides == "left"), 0).astype(np.int16),
        hands=sides,
        rotations=rotation.to_matrix(turns),
        places=places,
    )


def _hand_of(thing: MeshPart) -> str:
    """Which hand a thing is, or is a fingertip of: "left", "right" or ""."""
    side, _, kind = thing.name.partition(" ")
    return side if kind == "hand" or kind.endswith("Tip") else ""


def _as_moved(clip: Clip) -> Skeleton:
    """The skeleton with the bones that the clip shows: a file's frames may give other lengths than its rest pose."""
    if clip.translations is None:
        return clip.skeleton
    offsets = np.median(clip.translations, axis=0)
    offsets[0] = clip.skeleton.offsets[0]
    return replace(clip.skeleton, offsets=offsets)


def _window(shape: BodyCapsules, starts: Float, ends: Float, radii: Float) -> tuple[float, float, float, float]:
    """The frame of the camera: everything but the legs, from a little below the hips."""
    upper = np.array([part not in _PLAIN for part in shape.parts])
    points = np.concatenate([starts[:, upper] - radii[upper, :1], ends[:, upper] + radii[upper, :1]], axis=1)
    wide = np.concatenate([starts[:, upper] + radii[upper, :1], ends[:, upper] - radii[upper, :1]], axis=1)
    low = np.minimum(points, wide).min(axis=(0, 1))
    high = np.maximum(points, wide).max(axis=(0, 1))
    margin = 0.025
    return float(low[0] - margin), float(high[0] + margin), float(low[1] - margin), float(high[1] + margin)


def _hand_centres(shape: BodyCapsules, starts: Float, ends: Float) -> Float:
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
    skin = scene.skin
    points, normals = posed(scene, frame)
    points = (points - np.array([*centre, 0.0], np.float32)) * np.float32(zoom)
    points += np.array([width, height, 0.0], np.float32)
    shown = slice(None) if only is None else np.flatnonzero(skin.hands == only)
    canvas.mesh(points, lit(normals), skin.triangles[shown], skin.tints[shown], skin.groups[shown])
    middle, near = scene.depths
    return canvas.finish(step=0.010 * zoom, near=near * zoom, far=(middle - 0.1) * zoom)


def posed(scene: Scene, frame: int) -> tuple[Pixels, Pixels]:
    """Vertices and normals (V, 3) of the skin in a frame, in camera axes, statures (linear blend skinning)."""
    skin = scene.skin
    turns = scene.rotations[frame] @ skin.rotations.transpose(0, 2, 1)
    moves = scene.places[frame] - np.einsum("jab,jb->ja", turns, skin.places) - scene.origin
    turns, moves = scene.axes @ turns, moves @ scene.axes.T / scene.height
    carried = np.concatenate([turns.reshape(len(turns), 9), moves], axis=1).astype(np.float32)
    each = skin.weights @ carried
    turn = each[:, :9].reshape(-1, 3, 3)
    points = np.einsum("vab,vb->va", turn, skin.vertices / np.float32(scene.height)) + each[:, 9:]
    normals = np.einsum("vab,vb->va", turn, skin.normals)
    return points, normals / np.linalg.norm(normals, axis=1, keepdims=True)


def small_colours() -> list[tuple[int, int, int]]:
    """Colours 0..255 of small things that tell much, hands, fingertips and mouth, from bright to shaded."""
    tints = [*TIPS.values(), *SKIN.values(), CLOTHES["mouth"]]
    shades = np.linspace(1.0, 0.5, 6)[:, None] * 255.0
    return [(int(r), int(g), int(b)) for tint in tints for r, g, b in shades * np.array(tint)]


def has_hands(clip: Clip) -> bool:
    """Whether the clip's rig has hands that can be enlarged."""
    joints = find_roles(clip.skeleton).joints
    return "leftHand" in joints and "rightHand" in joints
