"""Pictures of a clip's signer: a fixed camera for the clip, and the drawing of single frames."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from signsplice.body.capsules import Avatar, BodyCapsules, body_capsules, capsule_ends
from signsplice.body.mesh import PART_COLOURS, SKIN_COLOURS, figure_mesh
from signsplice.errors import InputError
from signsplice.motion import Clip, FloatArray, Skeleton, kinematics
from signsplice.motion.face import target_weights
from signsplice.render import gpu
from signsplice.render.raster import OUTLINE_STEP, Camera, Canvas, Pixels, Texture, lit
from signsplice.render.skin import Skin, join_parts, skin_of
from signsplice.rig.align import placement
from signsplice.rig.info import rig_info
from signsplice.rig.roles import SIDES

Image = NDArray[np.uint8]

VIEWS = {"front": 0.0, "three-quarter": 40.0, "side": 90.0}
"""View -> angle of the camera about the vertical, degrees."""

_LIGHT = (0.45, 0.62, 0.78)
"""Towards the key light, at the signer's front left: left, up and forward."""
_CROPPED = ("belly", "hips", *(side + bone for side in SIDES for bone in ("UpperLeg", "LowerLeg", "Foot")))
"""Capsules that the camera may crop, as their keys begin."""
_MARGIN = 0.02
"""Margin of a picture, statures."""


@dataclass(frozen=True, eq=False)
class Scene:
    """A clip of T frames, ready to draw. Camera axes are right, up, towards the viewer; the unit is stature.

    skin: the figure.
    rotations: (T, J, 3, 3) global rotations of joints.
    positions: (T, J, 3) positions of joints in the world, clip units.
    axes: (3, 3) rows are the camera axes in the world.
    origin: (3,) the point of the world at the camera's origin.
    height: stature, clip units.
    window: left, right, bottom and top of the camera's view: head and hands in every frame.
    hands: (T, 2, 3) centres of the left and right hand.
    face: (T, N) weights of the skin's morphs, in their order; None if the clip has no face.
    depths: median and largest coordinate towards the viewer.
    light: (3,) unit vector towards the key light, in camera axes.
    ball: centre (3,) and radius of a ball around the signer's upper body, in camera axes.
    """

    skin: Skin
    rotations: FloatArray
    positions: FloatArray
    axes: FloatArray
    origin: FloatArray
    height: float
    window: tuple[float, float, float, float]
    hands: FloatArray
    face: FloatArray | None
    depths: tuple[float, float]
    light: Pixels
    ball: tuple[Pixels, float]


def make_scene(clip: Clip, view: str = "front", body: BodyCapsules | None = None, above_deg: float = 0.0) -> Scene:
    """Sets up a clip for drawing from one of ``VIEWS`` with a fixed camera. ``body``: the signer's body, if its
    proportions are unusual; ``above_deg``: elevation of the camera.

    The view reaches from the hips to above the head, and includes the hands in every frame. Raises ``InputError`` for
    another view.
    """
    if view not in VIEWS:
        raise InputError(f"no view {view!r}, expected one of {', '.join(VIEWS)}")
    if isinstance(clip.skeleton, Avatar) and clip.skeleton.file is not None:
        from signsplice.formats.avatar import with_bones  # a notebook's drawing does without formats

        clip = with_bones(clip, clip.skeleton.file)
    signer = placement(clip)
    skeleton = _with_shown_bones(clip)
    height = rig_info(skeleton).sizes.stature or 1.0
    angle = np.deg2rad(VIEWS[view])
    leftward = np.cross(signer.up, signer.forward)
    level = np.cos(angle) * signer.forward + np.sin(angle) * leftward
    cos, sin = np.cos(np.deg2rad(above_deg)), np.sin(np.deg2rad(above_deg))
    axes = np.stack([np.cross(signer.up, level), cos * signer.up - sin * level, cos * level + sin * signer.up])
    skin = skeleton.derived[skin_of] if body is None else join_parts(skeleton, figure_mesh(skeleton, body))
    body = body or body_capsules(skeleton)
    rotations, positions = kinematics.forward(clip)
    starts, ends = capsule_ends(body, rotations, positions)
    origin = np.median(starts.reshape(-1, 3), axis=0)
    starts, ends = ((points - origin) @ axes.T / height for points in (starts, ends))
    depths = np.concatenate([starts[..., 2], ends[..., 2]])
    crown = (_head_points(skin, skeleton, rotations, positions) - origin) @ axes.T / height
    window = left, right, bottom, top = _window(body, starts, ends, body.radii / height, crown)
    middle, nearest = float(np.median(depths)), float(depths.max())
    light = axes @ (_LIGHT[0] * leftward + _LIGHT[1] * signer.up + _LIGHT[2] * signer.forward)
    centre = 0.5 * np.array([left + right, bottom + top, 2.0 * middle])
    reach = float(np.linalg.norm([0.5 * (right - left), 0.5 * (top - bottom), nearest - middle]))
    return Scene(
        skin=skin,
        rotations=rotations,
        positions=positions,
        axes=axes,
        origin=origin,
        height=height,
        window=window,
        hands=_hand_centres(body, starts, ends),
        face=None if clip.face is None or not skin.morphs else target_weights(clip.face, [*skin.morphs])[0],
        depths=(middle, nearest),
        light=(light / np.linalg.norm(light)).astype(np.float32),
        ball=(centre.astype(np.float32), reach),
    )


def _with_shown_bones(clip: Clip) -> Skeleton:
    """Returns the skeleton with the median bone lengths of the frames, which may differ from the rest pose."""
    if clip.translations is None:
        return clip.skeleton
    offsets = np.median(clip.translations, axis=0)
    offsets[0] = clip.skeleton.offsets[0]
    return replace(clip.skeleton, offsets=offsets)


def _head_points(skin: Skin, skeleton: Skeleton, rotations: FloatArray, positions: FloatArray) -> FloatArray:
    """Returns the outermost points (T, N, 3) of the head and its hair in the world; none without a head."""
    head = rig_info(skeleton).roles.joints.get("head")
    if head is None:
        return np.zeros((len(positions), 0, 3))
    carriers = skin.weights.indices.reshape(len(skin.vertices), -1)
    main = np.take_along_axis(carriers, skin.weights.data.reshape(carriers.shape).argmax(axis=1)[:, None], axis=1)[:, 0]
    vertices = skin.vertices[np.isin(main, kinematics.subtree(skeleton, head))]
    ways = np.indices((3, 3, 3)).reshape(3, -1) - 1
    points = vertices[np.unique((vertices @ ways).argmax(axis=0))] if len(vertices) else vertices
    turns = rotations[:, head] @ skin.rotations[head].T
    return np.asarray(positions[:, None, head] + np.einsum("tab,nb->tna", turns, points - skin.positions[head]))


def _window(
    body: BodyCapsules, starts: FloatArray, ends: FloatArray, radii: FloatArray, more: FloatArray
) -> tuple[float, float, float, float]:
    """Returns left, right, bottom and top of the box around head, chest, arms and hands and ``more`` points (T, N, 3),
    over all frames.
    """
    shown = np.array([not key.startswith(_CROPPED) for key in body.keys])
    shown |= not shown.any()
    points = np.concatenate([starts[:, shown], ends[:, shown], more], axis=1)  # (T, 2 C + N, 3)
    margins = np.concatenate([radii[shown, :1], radii[shown, :1], np.zeros((more.shape[1], 1))])
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
    middle, nearest = scene.depths
    view = Camera(width, height, centre, scale, scene.light, nearest, middle - 0.1, scene.ball)
    renderer = gpu.renderer()
    if renderer is None:
        return _draw_in_numpy(scene, frame, view, hand)
    return renderer.draw(scene.skin, _with_face(scene, frame), _bones(scene, frame), view, hand)


def _draw_in_numpy(scene: Scene, frame: int, view: Camera, hand: str | None) -> Image:
    """Draws one frame as ``draw`` does, without OpenGL: without shadows, and slower."""
    canvas, zoom, skin = Canvas(2 * view.width, 2 * view.height), 2.0 * view.scale, scene.skin
    points, normals = deform_skin(scene, frame)
    points = (points - np.array([*view.centre, 0.0], np.float32)) * np.float32(zoom)
    points += np.array([view.width, view.height, 0.0], np.float32)
    light = np.stack([lit(normals, view.light), lit(-normals, view.light)])
    for surface in skin.surfaces:
        rows = np.arange(len(skin.triangles))[surface.triangles]
        rows = rows if hand is None else rows[skin.hands[rows] == hand]
        texture = None if surface.pixels is None else Texture(surface.pixels, skin.uvs, surface.cutoff)
        canvas.mesh(
            points, light, skin.triangles[rows], skin.tints[rows], skin.groups[rows], texture, surface.both_sides
        )
    return canvas.finish(step=OUTLINE_STEP * zoom, near=view.near * zoom, far=view.far * zoom)


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
    skin, bones = scene.skin, _bones(scene, frame)
    blended = (skin.weights @ bones.reshape(len(bones), 12)).reshape(-1, 3, 4)
    points = np.einsum("vab,vb->va", blended[..., :3], _with_face(scene, frame)) + blended[..., 3]
    normals = np.einsum("vab,vb->va", blended[..., :3], skin.normals)
    return points, normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.float32(1e-12))


def _bones(scene: Scene, frame: int) -> Pixels:
    """Returns the transforms (J, 3, 4) of the joints in a frame, from the bind pose to camera axes, statures."""
    skin = scene.skin
    rotations = scene.rotations[frame] @ skin.rotations.transpose(0, 2, 1)  # (J, 3, 3), from the bind pose
    shifts = scene.positions[frame] - np.einsum("jab,jb->ja", rotations, skin.positions) - scene.origin
    transforms = scene.axes @ np.concatenate([rotations, shifts[..., None]], axis=2) / scene.height
    return np.ascontiguousarray(transforms, np.float32)


def _with_face(scene: Scene, frame: int) -> Pixels:
    """Returns vertices (V, 3) in the bind pose with the face of a frame."""
    if scene.face is None or not scene.face[frame].any():
        return scene.skin.vertices
    vertices = scene.skin.vertices.copy()
    for (rows, moves), weight in zip(scene.skin.morphs.values(), scene.face[frame].tolist(), strict=True):
        if weight > 0.0:
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
