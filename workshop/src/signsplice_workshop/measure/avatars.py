"""Measures words on avatars: distance of a hand's vertices from the skin that it touches, skinned as players do it
(linear blend).

The fit of motion to an avatar looks at some points of hands and skin; here every vertex of a hand is measured, in every
frame in which the hand signs, against points 3 mm apart on the posed triangles of head, neck and trunk. Where both
hands sign, each is measured against the other too. A vertex deeper
than ``HALF_THICKNESS_M`` (30 mm in the body, 15 mm in a hand) sees the nearest skin from behind and does not count.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from signsplice.body.capsules import Avatar, body_capsules
from signsplice.body.collision import near_pairs, pair_clearances, skin_pairs
from signsplice.body.contacts import KEPT_M, PRESS_M, TOUCH_M, pose_body
from signsplice.body.retarget import retarget, signing
from signsplice.body.skin import BODY
from signsplice.body.skin_surface import HALF_THICKNESS_M, least_height
from signsplice.errors import InputError
from signsplice.motion import Clip, FloatArray, kinematics
from signsplice.rig.info import rig_info
from signsplice.rig.roles import SIDES
from signsplice_workshop.measure.measures import (
    Measure,
    Progress,
    Row,
    format_measures,
    make_row,
    percent,
    track_progress,
)

WORDS = ("MOTHER", "THANK-YOU", "NAME", "BOOK", "FRIEND", "PLEASE")
_POINT_SPACING_M, _SEARCH_M, _MAX_LATERAL_M = 0.003, 0.06, 0.006
"""Distance between points on triangles; distance from a hand within which triangles count; and largest distance of a
vertex from the normal through the nearest point; all m.
"""
_MIN_SIGNING = 0.99
"""Activity of an arm (``retarget.signing``) above which its hand signs."""


@dataclass(frozen=True, eq=False)
class _TouchHeights:
    """In frames where a hand touches: heights (N,) of the hand's lowest vertex on the avatar, and the hand's skin
    distances (N,) at the source (-2 mm at least, ``PRESS_M``); greatest depth in any frame in which the hand signs, at
    most ``HALF_THICKNESS_M``; m.
    """

    heights: FloatArray
    source_heights: FloatArray
    deepest: float


def _fraction_near(heights: FloatArray) -> float | None:
    return float((np.abs(heights) < KEPT_M).mean()) if len(heights) else None


def _median_height(touches: _TouchHeights) -> float | None:
    return float(np.median(touches.heights)) if len(touches.heights) else None


MEASURES = (
    Measure("avatar", "avatar"),
    Measure("word", "word"),
    Measure("skin", "on"),
    Measure("n_touching", "touches", function=lambda touches: len(touches.heights)),
    percent("near", "within 5 mm of skin", 0, lambda touches: _fraction_near(touches.heights)),
    percent(
        "kept",
        "within 5 mm of source height",
        0,
        lambda touches: _fraction_near(touches.heights - touches.source_heights),
    ),
    Measure("median", "median, mm", "{:.1f}", 1e3, _median_height),
    Measure("deepest", "deepest, mm", "{:.1f}", 1e3, lambda touches: touches.deepest),
)
"""Measures of a word on an avatar, for a skin that a hand touches ("body" or "hand"): number of touches, which are
pairs of hand and frame in contact, with the source nearer than 5 mm; fraction of these whose lowest vertex lies within
5 mm of the skin, and of the hand's skin distance at the source (-2 mm at least); median height of the lowest vertex, m;
greatest depth of a vertex in any frame in which the hand signs, m, up to ``HALF_THICKNESS_M``.
"""


def signature(words: Sequence[Clip]) -> str:
    """Returns the recipe of the figures: words, and how heights are measured."""
    return f"words:{','.join(word.name for word in words)}|touch:{TOUCH_M}|within:{KEPT_M}|points:{_POINT_SPACING_M}"


def measure_words(avatars: Sequence[Avatar], words: Sequence[Clip], progress: Progress | None = None) -> list[Row]:
    """Returns a row for each avatar, word and kind of skin. Raises ``InputError`` for an avatar without skin."""
    for avatar in avatars:
        if body_capsules(avatar).skin is None:
            raise InputError(f"{avatar.label}: holds no skin of head, trunk and both hands, expected a skinned mesh")
    cases = [(avatar, word) for avatar in avatars for word in words]
    return [row for avatar, word in track_progress(cases, progress) for row in _measure_word(avatar, word)]


def table(rows: Sequence[Row]) -> list[str]:
    """Returns the rows as lines of Markdown, and the fractions of all touches."""
    lines = format_measures(MEASURES, rows)
    for skin in ("body", "hand"):
        touching_rows = [row for row in rows if row.skin == skin and row.n_touching]
        count = sum(row.n_touching for row in touching_rows)
        n_near, n_kept = (
            sum(row.n_touching * (getattr(row, field) or 0.0) for row in touching_rows) for field in ("near", "kept")
        )
        deepest = max((row.deepest for row in rows if row.skin == skin), default=0.0)
        if count:
            lines += ["", f"On the {skin}: {count} touches, {100.0 * (n_near / count):.1f} % within 5 mm of skin, "
                      f"{100.0 * (n_kept / count):.1f} % within 5 mm of source height; deepest "
                      f"{1e3 * deepest:.1f} mm."]  # fmt: skip
    return lines


def _measure_word(avatar: Avatar, word: Clip) -> Iterator[Row]:
    retargeted = retarget(word, avatar)
    active = signing(word)
    source_distances = _source_distances(word)
    for skin, heights in zip(
        ("body", "hand"), _lowest_vertex_heights(retargeted.clip, avatar, active > _MIN_SIGNING), strict=True
    ):
        touching = np.zeros((len(word), 2), bool)
        for contact in retargeted.contacts:
            if (contact.region == "hand") == (skin == "hand") and contact.region != "arm":
                touching[slice(*contact.frames), 0 if skin == "hand" else SIDES.index(contact.hand)] = True
        touching &= np.isfinite(heights) & (source_distances[skin] < TOUCH_M)
        touch_heights, source_heights = heights[touching], np.maximum(source_distances[skin][touching], -PRESS_M)
        touches = _TouchHeights(touch_heights, source_heights, max(0.0, -float(heights.min(initial=0.0))))
        yield make_row(MEASURES, touches, avatar=avatar.label, word=word.name, skin=skin)


def _source_distances(word: Clip) -> dict[str, FloatArray]:
    """Returns the least skin distances (T, 2) of both hands at the source, m, by skin: "body", from head and trunk;
    "hand", from the other hand, in the first column. Infinite beyond the distance of a touch.
    """
    body = body_capsules(word.skeleton)
    posed, pairs = pose_body(word, body), skin_pairs(body, frozenset(body.keys))
    frames, k = near_pairs(posed.starts, posed.ends, posed.radii, pairs, TOUCH_M)
    distance = pair_clearances(posed.starts, posed.ends, posed.radii, pairs, frames, k).distance
    distances = {skin: np.full((len(word), 2), np.inf) for skin in ("body", "hand")}
    is_hand = np.isin(pairs.other[k], [*body.groups.left, *body.groups.right])
    for skin, selected in (("body", pairs.other_side[k] < 0), ("hand", is_hand)):
        side = np.where(is_hand, 0, pairs.own_side[k])
        np.minimum.at(distances[skin], (frames[selected], side[selected]), distance[selected])
    return distances


def _lowest_vertex_heights(clip: Clip, avatar: Avatar, is_signing: NDArray[np.bool_]) -> tuple[FloatArray, FloatArray]:
    """Returns the heights (T, 2) of each hand's lowest vertex above head and trunk, and, in the first column, of
    either hand's above the other, m; infinite if far, or if the hand does not sign.
    """
    skin = body_capsules(avatar).skin
    assert skin is not None
    mesh, roles, rest = skin.mesh, rig_info(avatar).roles.joints, kinematics.rest_positions(avatar)
    hands = [kinematics.subtree(avatar, roles[f"{side}Hand"]) for side in SIDES]
    hand_vertices = [np.flatnonzero(mesh.is_of(joints, bare=True)) for joints in hands]
    body = [roles[role] for role in BODY if role in roles]
    surface = mesh.samples(body, _POINT_SPACING_M)
    left, right = (mesh.samples(joints, _POINT_SPACING_M, bare=True) for joints in hands)
    rotations, positions = kinematics.forward(clip)
    heights = np.full((2, len(clip), 2), np.inf)
    for frame in np.flatnonzero(is_signing.any(axis=1)).tolist():
        turns, offsets = rotations[frame], positions[frame] - np.einsum("jab,jb->ja", rotations[frame], rest)
        vertices = np.zeros_like(mesh.positions)
        for k in range(mesh.joints.shape[1]):
            joints = mesh.joints[:, k]
            vertices += mesh.weights[:, k, None] * (
                np.einsum("vab,vb->va", turns[joints], mesh.positions) + offsets[joints]
            )
        for side in (0, 1):
            if is_signing[frame, side]:
                heights[0, frame, side] = _lowest_height(vertices, hand_vertices[side], surface, HALF_THICKNESS_M[0])
        if is_signing[frame].all():
            heights[1, frame, 0] = min(
                _lowest_height(vertices, own, other, HALF_THICKNESS_M[1])
                for own, other in zip(hand_vertices, (right, left), strict=True)
            )
    return heights[0], heights[1]


def _lowest_height(
    vertices: FloatArray,
    hand_vertices: NDArray[np.intp],
    surface: tuple[NDArray[np.int64], FloatArray, FloatArray],
    half_thickness: float,
) -> float:
    """Returns the least height, m, of the vertices ``hand_vertices`` above a surface, given by the corners and weights
    of its points and half its thickness, m; infinite if far.
    """
    corners, weights, _ = surface
    hand = vertices[hand_vertices]
    low, high = hand.min(axis=0) - _SEARCH_M, hand.max(axis=0) + _SEARCH_M
    first_corners = vertices[corners[:, 0]]
    near_points = np.flatnonzero(((first_corners > low) & (first_corners < high)).all(axis=1))
    if not len(near_points):
        return np.inf
    triangles = vertices[corners[near_points]]
    points = np.einsum("sc,scx->sx", weights[near_points], triangles)
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True) + 1e-12
    middle = hand.mean(axis=0)
    return least_height(hand - middle, points - middle, normals, _MAX_LATERAL_M, half_thickness)[0]
