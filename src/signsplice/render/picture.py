"""Pictures of a clip's signer: a fixed camera for the clip, and the drawing of single frames."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from signsplice.body.capsules import BodyCapsules, MeshPart, body_capsules, capsule_ends
from signsplice.body.mesh import PART_COLOURS, SKIN_COLOURS, bind_pose, body_mesh, figure_mesh
from signsplice.errors import InputError
from signsplice.motion import Clip, FloatArray, Skeleton, kinematics, rotation
from signsplice.motion.face import Face
from signsplice.render.raster import Canvas, Pixels, lit
from signsplice.rig.align import placement
from signsplice.rig.info import rig_info
from signsplice.rig.roles import FINGERS, SIDES

Image = NDArray[np.uint8]

VIEWS = {"front": 0.0, "three-quarter": 40.0, "side": 90.0}
"""View -> angle of the camera about the vertical, degrees."""

_CROPPED = ("belly", "hips", *(side + bone for side in SIDES for bone in ("UpperLeg", "LowerLeg", "Foot")))
"""Capsules that the camera may crop, as their keys begin."""
_OWN_WEIGHT = 0.8
"""Least weight of a finger's joints on the skin that is its own."""
_MARGIN = 0.02
"""Margin of a picture, statures."""


@dataclass(frozen=True, eq=False)
class Skin:
    """The mannequin as a single mesh in its bind pose: V vertices, F triangles, J joints.

    vertices: (V, 3) clip units.
    normals: (V, 3) unit vectors.
    weights: (V, J) skinning weights, sparse.
    triangles: (F, 3) indices of vertices.
    tints: (F, 3) colour of each triangle, sRGB 0 to 1.
    morphs: coefficient of the face -> vertices that it moves (N,), and their displacement at 1 (N, 3).
    groups: (F,) number of the triangle's finger, 0 for all other parts.
    hands: (F,) "left" or "right" for triangles of a hand, else "".
    rotations: (J, 3, 3) global rotations of the joints in the bind pose.
    positions: (J, 3) positions of the joints in the bind pose, clip units.
    """

    vertices: Pixels
    normals: Pixels
    weights: csr_array
    triangles: NDArray[np.intp]
    tints: Pixels
    morphs: Mapping[str, tuple[NDArray[np.intp], Pixels]]
    groups: NDArray[np.int16]
    hands: NDArray[np.str_]
    rotations: FloatArray
    positions: FloatArray


@dataclass(frozen=True, eq=False)
class Scene:
    """A clip of T frames, ready to draw. Camera axes are right, up, towards the viewer; the unit is stature.

    skin: the mannequin.
    rotations: (T, J, 3, 3) global rotations of joints.
    positions: (T, J, 3) positions of joints in the world, clip units.
    axes: (3, 3) rows are the camera axes in the world.
    origin: (3,) the point of the world at the camera's origin.
    height: stature, clip units.
    window: left, right, bottom and top of the camera's view: head and hands in every frame.
    hands: (T, 2, 3) centres of the left and right hand.
    face: the face in every frame; None if the clip has none.
    depths: median and largest coordinate towards the viewer.
    """

    skin: Skin
    rotations: FloatArray
    positions: FloatArray
    axes: FloatArray
    origin: FloatArray
    height: float
    window: tuple[float, float, float, float]
    hands: FloatArray
    face: Face | None
    depths: tuple[float, float]


def make_scene(clip: Clip, view: str = "front", body: BodyCapsules | None = None, above_deg: float = 0.0) -> Scene:
    """Sets up a clip for drawing from one of ``VIEWS`` with a fixed camera. ``body``: the signer's body, if its
    proportions are unusual; ``above_deg``: elevation of the camera.

    The view reaches from the hips to above the head, and includes the hands in every frame. Raises ``InputError`` for
    another view.
    """
    if view not in VIEWS:
        raise InputError(f"no view {view!r}, expected one of {', '.join(VIEWS)}")
    signer = placement(clip)
    skeleton = _with_shown_bones(clip)
    height = rig_info(skeleton).sizes.stature or 1.0
    angle = np.deg2rad(VIEWS[view])
    leftward = np.cross(signer.up, signer.forward)
    level = np.cos(angle) * signer.forward + np.sin(angle) * leftward
    cos, sin = np.cos(np.deg2rad(above_deg)), np.sin(np.deg2rad(above_deg))
    axes = np.stack([np.cross(signer.up, level), cos * signer.up - sin * level, cos * level + sin * signer.up])
    skin = skeleton.derived[_skin] if body is None else _skin_of(skeleton, figure_mesh(skeleton, body))
    body = body or body_capsules(skeleton)
    rotations, positions = kinematics.forward(clip)
    starts, ends = capsule_ends(body, rotations, positions)
    origin = np.median(starts.reshape(-1, 3), axis=0)
    starts, ends = ((points - origin) @ axes.T / height for points in (starts, ends))
    depths = np.concatenate([starts[..., 2], ends[..., 2]])
    return Scene(
        skin=skin,
        rotations=rotations,
        positions=positions,
        axes=axes,
        origin=origin,
        height=height,
        window=_window(body, starts, ends, body.radii / height),
        hands=_hand_centres(body, starts, ends),
        face=clip.face,
        depths=(float(np.median(depths)), float(depths.max())),
    )


def _skin(skeleton: Skeleton) -> Skin:
    return _skin_of(skeleton, body_mesh(skeleton))


def _skin_of(skeleton: Skeleton, parts: Sequence[MeshPart]) -> Skin:
    """Joins parts into one mesh. Each finger is a group, so that outlines separate fingers."""
    finger_of = {
        joint: FINGERS.index(finger) + 1
        for role, joint in rig_info(skeleton).roles.joints.items()
        for finger in FINGERS
        if finger in role
    }
    fingers = np.array([finger_of.get(joint, 0) for joint in range(len(skeleton))])
    starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    joints = np.concatenate([part.joints for part in parts])  # (V, 4)
    weights = np.concatenate([part.weights for part in parts])  # (V, 4)
    n_vertices, width = joints.shape
    sparse_weights = csr_array(
        (weights.ravel().astype(np.float32), joints.ravel(), np.arange(0, n_vertices * width + 1, width)),
        (n_vertices, len(skeleton)),
    )
    main_finger = fingers[np.take_along_axis(joints, weights.argmax(axis=1)[:, None], axis=1)[:, 0]]  # (V,)
    own_weight = np.where(fingers[joints] == main_finger[:, None], weights, 0.0).sum(axis=1)
    main_finger = np.where(own_weight > _OWN_WEIGHT, main_finger, 0)  # the skin between fingers belongs to none
    counts = [len(part.triangles) for part in parts]
    triangles = np.concatenate([part.triangles + k for part, k in zip(parts, starts[:-1], strict=True)])
    hands = np.repeat(np.array([_hand_of(part) for part in parts]), counts)
    finger = main_finger[triangles[:, 0]]
    global_quats, positions = bind_pose(skeleton)
    return Skin(
        vertices=np.concatenate([part.vertices for part in parts]).astype(np.float32),
        normals=np.concatenate([part.normals for part in parts]).astype(np.float32),
        weights=sparse_weights,
        triangles=triangles,
        tints=np.repeat(np.array([part.colour for part in parts], np.float32), counts, axis=0),
        morphs=_morphs(parts, starts),
        groups=np.where(finger > 0, finger + len(FINGERS) * (hands == "left"), 0).astype(np.int16),
        hands=hands,
        rotations=rotation.to_matrix(global_quats),
        positions=positions,
    )


def _morphs(parts: Sequence[MeshPart], starts: NDArray[np.intp]) -> dict[str, tuple[NDArray[np.intp], Pixels]]:
    """Returns coefficient -> moved vertices of the whole mesh, and their displacement; ``starts``: first vertex of each
    part.
    """
    moved: dict[str, list[tuple[NDArray[np.intp], Pixels]]] = {}
    for part, start in zip(parts, starts[:-1].tolist(), strict=True):
        for name, (rows, moves) in part.morphs.items():
            moved.setdefault(name, []).append((rows + start, moves.astype(np.float32)))
    return {
        name: (np.concatenate([r for r, _ in rows]), np.concatenate([m for _, m in rows]))
        for name, rows in moved.items()
    }


def _hand_of(part: MeshPart) -> str:
    """Returns the side of a hand or fingertip part, or "" for other parts."""
    side, _, kind = part.name.partition(" ")
    return side if kind in ("hand", "nails") else ""


def _with_shown_bones(clip: Clip) -> Skeleton:
    """Returns the skeleton with the median bone lengths of the frames, which may differ from the rest pose."""
    if clip.translations is None:
        return clip.skeleton
    offsets = np.median(clip.translations, axis=0)
    offsets[0] = clip.skeleton.offsets[0]
    return replace(clip.skeleton, offsets=offsets)


def _window(
    body: BodyCapsules, starts: FloatArray, ends: FloatArray, radii: FloatArray
) -> tuple[float, float, float, float]:
    """Returns left, right, bottom and top of the box around head, chest, arms and hands, over all frames."""
    shown = np.array([not key.startswith(_CROPPED) for key in body.keys])
    shown |= not shown.any()
    points = np.concatenate([starts[:, shown], ends[:, shown]], axis=1)  # (T, 2 C, 3)
    margins = np.concatenate([radii[shown, :1], radii[shown, :1]])  # (2 C, 1)
    low, high = (points - margins).min(axis=(0, 1)), (points + margins).max(axis=(0, 1))
    return tuple(np.array([low[0], high[0], low[1], high[1]]) + _MARGIN * np.array([-1.0, 1.0, -1.0, 1.0]))


def _hand_centres(body: BodyCapsules, starts: FloatArray, ends: FloatArray) -> FloatArray:
    """Returns centres (T, 2, 3) of the left and right hand: mean of the far ends of palm capsules; 0 without a hand."""
    centres = np.zeros((len(starts), 2, 3))
    for n, side in enumerate(SIDES):
        palm = [
            c for c, (part, s) in enumerate(zip(body.parts, body.sides, strict=True)) if part == "palm" and s == side
        ]
        if palm:
            centres[:, n] = ends[:, palm].mean(axis=1)
    return centres


def draw(scene: Scene, frame: int, width: int, height: int, hand: str | None = None) -> Image:
    """Draws one frame as an image (H, W, 3), 0..255, with the scene's window fitted into it. ``hand``: "left" or
    "right", to draw only that hand.
    """
    centre, scale = _fit_window(scene, width, height)
    canvas, zoom, skin = Canvas(2 * width, 2 * height), 2.0 * scale, scene.skin
    points, normals = deform_skin(scene, frame)
    points = (points - np.array([*centre, 0.0], np.float32)) * np.float32(zoom)
    points += np.array([width, height, 0.0], np.float32)
    shown = slice(None) if hand is None else np.flatnonzero(skin.hands == hand)
    canvas.mesh(points, lit(normals), skin.triangles[shown], skin.tints[shown], skin.groups[shown])
    middle, nearest = scene.depths
    return canvas.finish(step=0.010 * zoom, near=nearest * zoom, far=(middle - 0.1) * zoom)


def _fit_window(scene: Scene, width: int, height: int) -> tuple[tuple[float, float], float]:
    """Returns the centre of the scene's window, and the pixels per stature that fit it into an image."""
    left, right, bottom, top = scene.window
    return (0.5 * (left + right), 0.5 * (bottom + top)), min(width / (right - left), height / (top - bottom))


def around_hand(scene: Scene, frame: int, side: str) -> Scene:
    """Returns the scene with a window around one hand."""
    x, y, _ = scene.hands[frame, 0 if side == "left" else 1].tolist()
    return replace(scene, window=(x - 0.1, x + 0.1, y - 0.1, y + 0.1))


def draw_hand(scene: Scene, frame: int, side: str, size: int) -> Image:
    """Draws one hand enlarged, as an image (size, size, 3), without the parts in front of it."""
    return draw(around_hand(scene, frame, side), frame, size, size, side)


def draw_dots(image: Image, scene: Scene, points: FloatArray, colour: tuple[int, int, int], radius: float) -> Image:
    """Draws dots on an image from ``draw``, at points (N, 3) in camera axes, statures; ``radius`` in pixels."""
    height, width = image.shape[:2]
    centre, scale = _fit_window(scene, width, height)
    x, y = ((points[:, :2] - centre) * scale * (1.0, -1.0) + (0.5 * width, 0.5 * height)).T[..., None, None]
    rows, columns = np.mgrid[:height, :width] + 0.5
    dotted = image.copy()
    dotted[(np.hypot(columns - x, rows - y) <= radius).any(axis=0)] = colour
    return dotted


def deform_skin(scene: Scene, frame: int) -> tuple[Pixels, Pixels]:
    """Returns vertices and normals (V, 3) of the skin in a frame, camera axes, statures (linear blend skinning)."""
    skin = scene.skin
    rotations = scene.rotations[frame] @ skin.rotations.transpose(0, 2, 1)  # (J, 3, 3), from the bind pose
    shifts = scene.positions[frame] - np.einsum("jab,jb->ja", rotations, skin.positions) - scene.origin
    rotations, shifts = scene.axes @ rotations, shifts @ scene.axes.T / scene.height
    transforms = np.concatenate([rotations.reshape(len(rotations), 9), shifts], axis=1).astype(np.float32)  # (J, 12)
    blended = skin.weights @ transforms  # (V, 12)
    linear = blended[:, :9].reshape(-1, 3, 3)
    vertices = _with_face(skin, scene.face, frame) / np.float32(scene.height)
    points = np.einsum("vab,vb->va", linear, vertices) + blended[:, 9:]
    normals = np.einsum("vab,vb->va", linear, skin.normals)
    return points, normals / np.linalg.norm(normals, axis=1, keepdims=True)


def _with_face(skin: Skin, face: Face | None, frame: int) -> Pixels:
    """Returns vertices (V, 3) in the bind pose with the face of a frame."""
    if face is None:
        return skin.vertices
    vertices = skin.vertices.copy()
    for name, weight in zip(face.channels, face.weights[frame].tolist(), strict=True):
        if weight > 0.0 and name in skin.morphs:
            rows, moves = skin.morphs[name]
            vertices[rows] += np.float32(weight) * moves
    return vertices


def detail_colours() -> list[tuple[int, int, int]]:
    """Returns colours 0..255 of the small details hands, fingertips and mouth, each from bright to shaded."""
    tints = [*SKIN_COLOURS.values(), PART_COLOURS["lips"]]
    shades = np.linspace(1.0, 0.5, 6)[:, None] * 255.0
    return [(int(r), int(g), int(b)) for tint in tints for r, g, b in shades * np.array(tint)]


def has_hands(clip: Clip) -> bool:
    """Whether the clip's rig has both hands, so that they can be enlarged."""
    joints = rig_info(clip.skeleton).roles.joints
    return "leftHand" in joints and "rightHand" in joints
