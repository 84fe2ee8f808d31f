"""Words on avatars: how far every vertex of a hand lies from the skin that it touches, as a player poses both.

The fit of motion to an avatar looks at some points of hands and skin; here every vertex of a hand is measured in every
frame, against points 3 mm apart on the posed triangles of head, neck and trunk, or of the other hand.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from signsplice.body.capsules import Avatar, body_capsules
from signsplice.body.collision import near_pairs, pair_clearances, skin_pairs
from signsplice.body.contacts import KEPT_M, PRESS_M, TOUCH_M, pose_body
from signsplice.body.retarget import retarget, signing
from signsplice.body.skin import BODY
from signsplice.body.skin_surface import THICK_M, least_height
from signsplice.errors import InputError
from signsplice.motion import Clip, FloatArray, kinematics
from signsplice.rig.info import rig_info
from signsplice.rig.roles import SIDES
from signsplice_workshop.measure.measures import Measure, Progress, Row, markdown_rows, percent, row_of, track_progress

WORDS = ("MOTHER", "THANK-YOU", "NAME", "BOOK", "FRIEND", "PLEASE")
_STEP, _AROUND, _MOST_ACROSS = 0.003, 0.06, 0.006
"""Distance of points on triangles; of triangles from a hand that are looked at; and how far a vertex may lie from the
normal through the nearest point; all m.
"""
_SIGNS = 0.99


@dataclass(frozen=True, eq=False)
class _Touches:
    """Heights (N,) of the lowest vertex where a hand touches, and at the source; greatest depth in any frame, m."""

    heights: FloatArray
    source: FloatArray
    deepest: float


def _fraction(heights: FloatArray) -> float | None:
    return float((np.abs(heights) < KEPT_M).mean()) if len(heights) else None


def _median(of: _Touches) -> float | None:
    return float(np.median(of.heights)) if len(of.heights) else None


MEASURES = (
    Measure("avatar", "avatar"),
    Measure("word", "word"),
    Measure("skin", "on"),
    Measure("n_touching", "frames", function=lambda of: len(of.heights)),
    percent("near", "within 5 mm of skin", 0, lambda of: _fraction(of.heights)),
    percent("kept", "of the source", 0, lambda of: _fraction(of.heights - of.source)),
    Measure("median", "median, mm", "{:.1f}", 1e3, _median),
    Measure("deepest", "deepest, mm", "{:.1f}", 1e3, lambda of: of.deepest),
)
"""Of a word on an avatar, and a skin that a hand touches, "body" or "hand": hands and frames of contacts in which the
source is nearer than 5 mm; fraction of these whose lowest vertex lies within 5 mm of the skin, and of where it was at
the source; median height of the lowest vertex, m; greatest depth of a vertex in any frame in which the hand signs, m.
"""


def signature(words: Sequence[Clip]) -> str:
    """What decides the figures: words, and how heights are measured."""
    return f"words:{','.join(word.name for word in words)}|touch:{TOUCH_M}|within:{KEPT_M}|points:{_STEP}"


def compare(avatars: Sequence[Avatar], words: Sequence[Clip], progress: Progress | None = None) -> list[Row]:
    """A row for each avatar, word and kind of skin. Raises ``InputError`` for an avatar without skin."""
    for avatar in avatars:
        if body_capsules(avatar).skin is None:
            raise InputError(f"{avatar.label}: holds no skin of head, trunk and both hands, expected a skinned mesh")
    cases = [(avatar, word) for avatar in avatars for word in words]
    return [row for avatar, word in track_progress(cases, progress) for row in _rows(avatar, word)]


def table(rows: Sequence[Row]) -> list[str]:
    """Lines of Markdown: the rows, and the fractions of all frames."""
    lines = markdown_rows(MEASURES, rows)
    for skin in ("body", "hand"):
        some = [row for row in rows if row.skin == skin and row.n_touching]
        n = sum(row.n_touching for row in some)
        near, kept = (sum(row.n_touching * (getattr(row, what) or 0.0) for row in some) for what in ("near", "kept"))
        deepest = max((row.deepest for row in rows if row.skin == skin), default=0.0)
        if n:
            lines += ["", f"On the {skin}: {n} frames, {100.0 * (near / n):.1f} % within 5 mm of skin, "
                      f"{100.0 * (kept / n):.1f} % of the source; deepest {1e3 * deepest:.1f} mm."]  # fmt: skip
    return lines


def _rows(avatar: Avatar, word: Clip) -> Iterator[Row]:
    done = retarget(word, avatar)
    active = signing(word)
    then = _source_distances(word)
    for skin, heights in zip(("body", "hand"), _heights(done.clip, avatar, active > _SIGNS), strict=True):
        touching = np.zeros((len(word), 2), bool)
        for contact in done.contacts:
            if (contact.region == "hand") == (skin == "hand") and contact.region != "arm":
                touching[slice(*contact.frames), 0 if skin == "hand" else SIDES.index(contact.hand)] = True
        touching &= np.isfinite(heights) & (then[skin] < TOUCH_M)
        found, source = heights[touching], np.maximum(then[skin][touching], -PRESS_M)
        touches = _Touches(found, source, max(0.0, -float(heights.min(initial=0.0))))
        yield row_of(MEASURES, touches, avatar=avatar.label, word=word.name, skin=skin)


def _source_distances(word: Clip) -> dict[str, FloatArray]:
    """Least skin distances (T, 2) of both hands at the source: from head and trunk, and, in the first column, from one
    another; infinite where farther than a touch.
    """
    body = body_capsules(word.skeleton)
    posed, pairs = pose_body(word, body), skin_pairs(body, frozenset(body.keys))
    frames, k = near_pairs(posed.starts, posed.ends, posed.radii, pairs, TOUCH_M)
    distance = pair_clearances(posed.starts, posed.ends, posed.radii, pairs, frames, k).distance
    out = {skin: np.full((len(word), 2), np.inf) for skin in ("body", "hand")}
    is_hand = np.isin(pairs.other[k], [*body.groups.left, *body.groups.right])
    for skin, rows in (("body", pairs.other_side[k] < 0), ("hand", is_hand)):
        side = np.where(is_hand, 0, pairs.own_side[k])
        np.minimum.at(out[skin], (frames[rows], side[rows]), distance[rows])
    return out


def _heights(clip: Clip, avatar: Avatar, signs: NDArray[np.bool_]) -> tuple[FloatArray, FloatArray]:
    """Heights (T, 2) of each hand's lowest vertex above head and trunk, and, in the first column, of the left hand's
    above the right one, m; infinite where far, or where the hand does not sign.
    """
    skin = body_capsules(avatar).skin
    assert skin is not None
    mesh, roles, rest = skin.mesh, rig_info(avatar).roles.joints, kinematics.rest_positions(avatar)
    hands = [kinematics.subtree(avatar, roles[f"{side}Hand"]) for side in SIDES]
    own = [np.flatnonzero(mesh.is_of(joints, bare=True)) for joints in hands]
    body = [roles[role] for role in BODY if role in roles]
    surfaces = mesh.samples(body, _STEP), mesh.samples(hands[1], _STEP, bare=True)
    rotations, positions = kinematics.forward(clip)
    out = np.full((2, len(clip), 2), np.inf)
    for frame in np.flatnonzero(signs.any(axis=1)).tolist():
        turn, move = rotations[frame], positions[frame] - np.einsum("jab,jb->ja", rotations[frame], rest)
        vertices = np.zeros_like(mesh.positions)
        for k in range(mesh.joints.shape[1]):
            joints = mesh.joints[:, k]
            vertices += mesh.weights[:, k, None] * (
                np.einsum("vab,vb->va", turn[joints], mesh.positions) + move[joints]
            )
        for side in (0, 1):
            if signs[frame, side]:
                out[0, frame, side] = _lowest(vertices, own[side], surfaces[0], THICK_M[0])
        if signs[frame].all():
            out[1, frame, 0] = _lowest(vertices, own[0], surfaces[1], THICK_M[1])
    return out[0], out[1]


def _lowest(
    vertices: FloatArray,
    own: NDArray[np.intp],
    surface: tuple[NDArray[np.int64], FloatArray, FloatArray],
    thick: float,
) -> float:
    """The least height of the vertices ``own`` above a surface: corners and shares of its points, half thickness."""
    corners, shares, _ = surface
    hand = vertices[own]
    low, high = hand.min(axis=0) - _AROUND, hand.max(axis=0) + _AROUND
    first = vertices[corners[:, 0]]
    near = np.flatnonzero(((first > low) & (first < high)).all(axis=1))
    if not len(near):
        return np.inf
    of = vertices[corners[near]]
    points = np.einsum("sc,scx->sx", shares[near], of)
    normals = np.cross(of[:, 1] - of[:, 0], of[:, 2] - of[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True) + 1e-12
    return least_height(hand, cKDTree(points), normals, _MOST_ACROSS, thick)[0]
