"""Hands on an avatar's posed skin: the last moves of its wrists, after the fit to its capsules.

Capsules locate skin to a centimetre, its mesh to a millimetre. In every frame in which a hand
is close to head, neck, trunk or the other hand, the fit compares points of both skins, posed by linear blend skinning
as in players. Moves d of both wrists bring the least height s of the hand's points above the other skin, along its
normal n, to the clearance at the source, c*:

    E(d) = sum w (s + n . d - c*)^2 + sum h |d_left - d_right|^2 + mu sum |d|^2
         + lambda sum_t |d_(t-1) - 2 d_t + d_(t+1)|^2

w is 0 if a hand that touches nothing lies higher than c*; h holds touching hands together. Hands keep their rotations.
A few rounds (Gauss-Newton) follow each other, since other points become the lowest.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from signsplice.body.capsules import ARM
from signsplice.body.collision import Near, SkinPairs
from signsplice.body.fit import CONTACTS, Fit, solve_blocks
from signsplice.body.skin_surface import (
    HALF_THICKNESS_M,
    AvatarSkin,
    SkinSurface,
    least_height,
    squared_distances,
)
from signsplice.motion import Clip, FloatArray, kinematics


@dataclass(frozen=True)
class SkinFitSettings:
    """Distances and weights of the fit of hands to posed skin."""

    comparison_m: float = 0.045
    """Largest distance of points of two skins that are compared as hands move, m."""
    hand_layer_m: float = 0.02
    """Thickness of the layer of a hand, from its point nearest the other skin, whose points count, m."""
    free_comparison_m: float = 0.035
    """The same for a hand that touches nothing, m."""
    meeting_m: float = 0.02
    """Distance beyond such a layer up to which points of the other skin may become the nearest as hands move, m."""
    run: int = 12
    """Number of frames whose skins are posed together."""
    edge_spacings: tuple[float, float] = (1.5, 0.75)
    """Largest distance of a hand's point from the normal through the nearest point of the body and of the other hand,
    in distances between the points of that skin; farther ones are beyond its edge, as beside a finger.
    """
    lowest_fade_m: float = 0.001
    """Height above the lowest point of a hand over which a point's weight falls by a factor e, m."""
    rounds: int = 3
    """Rounds of the solution."""
    move_weight: float = 1.0
    """mu: weight of the squared moves."""
    together_weight: float = 30.0
    """h of hands that touch: weight of the squared difference of their moves."""
    together_fade_m: float = 0.01
    """Clearance of the hands over which h falls by a factor e, m."""


_SETTINGS = SkinFitSettings()

_TIE = np.kron([[1.0, -1.0], [-1.0, 1.0]], np.eye(3))
"""The square of the difference of both moves, as a block."""
_BODY = 0
"""A hand meets the body."""
_HANDS = 1
"""The left hand meets the right one."""
_KINDS = ((0, _BODY), (1, _BODY), (0, _HANDS))
"""Hand, and the skin that it meets."""


@dataclass(frozen=True, eq=False)
class _Meeting:
    """Frames in which a hand is close to other skin.

    side: 0 for the left hand, 1 for the right.
    what: ``_BODY``, or ``_HANDS``: the left hand on the right one.
    frames: (N,) of a clip.
    wanted: (N,) target height of the hand above the other skin, m.
    held: (N,) weights if the hand is higher.
    weight: (N,) weights if it is lower.
    together: (N,) degree to which hands touch, 0 to 1.
    """

    side: int
    what: int
    frames: NDArray[np.intp]
    wanted: FloatArray
    held: FloatArray
    weight: FloatArray
    together: FloatArray


@dataclass(frozen=True, eq=False)
class _Pose:
    """One frame of a meeting: ``hand`` (H, 3) points, ``points`` and ``normals`` (N, 3) of the other skin, and their
    least ``distance``, m.
    """

    hand: FloatArray
    points: FloatArray
    normals: FloatArray
    distance: float


class SkinFit:
    """Moves of the wrists of ``fit`` by the skin of its body.

    moves: (T, 2, 3) of the wrists from their places under copied rotations, m.
    """

    def __init__(self, fit: Fit, skin: AvatarSkin, carried: Clip, metres: float, moves: FloatArray) -> None:
        self._fit, self.moves = fit, moves
        self._spacing = metres * skin.body.spacing, metres * skin.hands[1].spacing
        self._meetings = [meeting for side, what in _KINDS if len((meeting := _meeting(fit, side, what)).frames)]
        posed = kinematics.forward(carried)
        self._poses = [_poses(meeting, skin, posed, metres, moves) for meeting in self._meetings]
        extra = np.zeros_like(moves)
        for _ in range(_SETTINGS.rounds if self._meetings else 0):
            extra = self._round(extra)
        self.moves = moves + extra
        self._heights = [self._lowest(k, extra)[0] for k in range(len(self._meetings))]

    def distances(self, pairs: SkinPairs, near: Near, distance: FloatArray) -> FloatArray:
        """Returns ``distance`` (N,) of near pairs, shifted so that the least in each meeting's frame is the skin's."""
        corrected = distance.copy()
        for meeting, heights in zip(self._meetings, self._heights, strict=True):
            rows = np.flatnonzero(_is_of(self._fit, pairs, near, meeting.side, meeting.what))
            least = np.full(self._fit.n_frames, np.inf)
            np.minimum.at(least, near.frames[rows], distance[rows])
            change = np.zeros(self._fit.n_frames)
            known = np.isfinite(heights) & np.isfinite(least[meeting.frames])
            change[meeting.frames[known]] = heights[known] - least[meeting.frames[known]]
            corrected[rows] += change[near.frames[rows]]
        return corrected

    def _round(self, extra: FloatArray) -> FloatArray:
        """Returns better moves than ``extra`` (T, 2, 3)."""
        n = len(extra)
        block, rhs = np.tile(_SETTINGS.move_weight * np.eye(6), (n, 1, 1)), np.zeros((n, 6))
        for k, meeting in enumerate(self._meetings):
            heights, normals = self._lowest(k, extra)
            off = meeting.wanted - heights
            weight = np.where(off > 0.0, meeting.weight, meeting.held)
            rows = np.flatnonzero(np.isfinite(heights) & (weight > 0.0))
            both = np.zeros((len(rows), 2, 3))
            both[:, meeting.side] = normals[rows]
            if meeting.what == _HANDS:
                both[:, 1] = -normals[rows]
                block[meeting.frames] += _SETTINGS.together_weight * meeting.together[:, None, None] * _TIE
            jacobian, frames = both.reshape(-1, 6), meeting.frames[rows]
            goal = off[rows] + np.einsum("ni,ni->n", jacobian, extra[frames].reshape(-1, 6))
            block[frames] += weight[rows, None, None] * jacobian[:, :, None] * jacobian[:, None]
            rhs[frames] += (weight[rows] * goal)[:, None] * jacobian
        return solve_blocks(block, rhs, self._fit.smoothness)

    def _lowest(self, k: int, extra: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Returns the least heights (N,) of a meeting's hand above the other skin, m, infinite if it is far, and the
        normals (N, 3) there.
        """
        meeting = self._meetings[k]
        moved = extra[meeting.frames, meeting.side] - (extra[meeting.frames, 1] if meeting.what == _HANDS else 0.0)
        lowest, directions = np.full(len(moved), np.inf), np.zeros((len(moved), 3))
        most_across = _SETTINGS.edge_spacings[meeting.what] * self._spacing[meeting.what]
        thick = HALF_THICKNESS_M[meeting.what]
        reach = np.where(meeting.held > 0.0, np.inf, np.hypot(most_across, CONTACTS.clearance_m))  # no more has weight
        reach += np.linalg.norm(moved, axis=1)
        for n, (pose, by) in enumerate(zip(self._poses[k], moved, strict=True)):
            if pose is None or pose.distance > reach[n]:
                continue
            lowest[n], heights, normals = least_height(pose.hand + by, pose.points, pose.normals, most_across, thick)
            direction = np.exp((lowest[n] - heights) / _SETTINGS.lowest_fade_m) @ normals
            directions[n] = direction / (np.linalg.norm(direction) + 1e-12)
        return lowest, directions


def _is_of(fit: Fit, pairs: SkinPairs, near: Near, side: int, what: int) -> NDArray[np.bool_]:
    """Tells which near pairs (N,) are of a hand and the body, or of both hands."""
    is_hand = np.array([part not in ARM for part in fit.source.body.parts])[fit.pairs[0].other[near.k]]
    other_side = pairs.other_side[near.k]
    is_other = other_side < 0 if what == _BODY else (other_side >= 0) & is_hand
    return np.asarray((pairs.own_side[near.k] == side) & is_other)


def _meeting(fit: Fit, side: int, what: int) -> _Meeting:
    """Returns the frames in which a hand is close to the body, or the left hand to the right one, while it signs."""
    rows = np.flatnonzero(_is_of(fit, fit.pairs[0], fit.near, side, what))
    least = np.full(fit.n_frames, np.inf)
    np.minimum.at(least, fit.near.frames[rows], fit.near.distance[rows])
    active = fit.active[:, side] if what == _BODY else fit.active.min(axis=1)
    frames = np.flatnonzero(np.isfinite(least) & (active > 0.0))
    distance, weight = least[frames], CONTACTS.weight * active[frames]
    deep = np.maximum(np.abs(distance + 0.5 * CONTACTS.press_depth_m) - 0.5 * CONTACTS.press_depth_m, 0.0)
    hold = np.where(distance < CONTACTS.touch_distance_m, np.exp(-deep / CONTACTS.fade_m), 0.0)
    together = np.exp(-np.maximum(distance, 0.0) / _SETTINGS.together_fade_m)
    wanted = np.clip(distance, -CONTACTS.press_depth_m, CONTACTS.clearance_m)
    return _Meeting(side, what, frames, wanted, hold * weight, weight, together)


def _poses(
    meeting: _Meeting, skin: AvatarSkin, posed: tuple[FloatArray, FloatArray], metres: float, moves: FloatArray
) -> list[_Pose | None]:
    """Returns both skins in the frames of a meeting, m, with wrists moved by ``moves``; None if they are far apart.
    posed: global rotations and positions of the clip's joints.
    """
    skins, poses = (skin.hands[meeting.side], skin.hands[1] if meeting.what == _HANDS else skin.body), []
    for start in range(0, len(meeting.frames), _SETTINGS.run):
        part = slice(start, start + _SETTINGS.run)
        frames = meeting.frames[part]
        by = moves[frames, meeting.side] - (moves[frames, 1] if meeting.what == _HANDS else 0.0)
        limits = np.where(meeting.held[part] > 0.0, _SETTINGS.comparison_m, _SETTINGS.free_comparison_m)
        poses += _run_poses(skins, (posed[0][frames], posed[1][frames]), metres, by[:, None], limits)
    return poses


def _run_poses(
    skins: tuple[SkinSurface, SkinSurface],
    posed: tuple[FloatArray, FloatArray],
    metres: float,
    by: FloatArray,
    limits: FloatArray,
) -> list[_Pose | None]:
    """Returns a hand moved by ``by`` (T, 1, 3) and another skin in T successive frames; None if they are farther apart
    than ``limits`` (T,). Compares one point of each patch first, then the points of patches that may be near.
    """
    (hand_skin, other_skin), poses = skins, list[_Pose | None]([None] * len(limits))
    (own, radii), (other, other_radii) = ((skin.patches, metres * skin.patches.radii) for skin in skins)
    n, firsts = len(limits) // 2, metres * hand_skin.deform(*posed, own.firsts) + by
    middle = firsts[n].mean(axis=0)
    around = float(np.linalg.norm(firsts - middle, axis=2).max()) + radii.max() + _SETTINGS.comparison_m
    near = other_skin.near(posed[0][n], posed[1][n], middle / metres, around / metres)
    if not len(near):
        return poses
    firsts -= middle
    others = metres * other_skin.deform(*posed, other.firsts[near]) - middle
    gaps = np.sqrt(np.abs(squared_distances(firsts, others)))
    most = np.minimum(gaps.min(axis=(1, 2)) + _SETTINGS.hand_layer_m, limits)
    is_near = gaps - other_radii[near].astype(np.float32) < (most[:, None] + radii).astype(np.float32)[..., None]
    is_own, is_other = is_near.any(axis=2), np.zeros((len(limits), len(other_radii)), bool)
    is_other[:, near] = is_near.any(axis=1)
    rows, other_rows = (
        np.flatnonzero(np.logical_or.reduce(chosen)[patches.of_points])
        for chosen, patches in ((is_own, own), (is_other, other))
    )
    hands = metres * hand_skin.deform(*posed, rows) + by - middle
    others = metres * other_skin.deform(*posed, other_rows) - middle
    of_hand, of_other = own.of_points[rows], other.of_points[other_rows]
    from_firsts = np.linalg.norm(hands - firsts.take(of_hand, axis=1), axis=2)
    for n in np.flatnonzero(is_own.any(axis=1)).tolist():
        seen = np.flatnonzero(is_other[n][of_other])
        squared = squared_distances(firsts[n], others[n].take(seen, axis=0))
        distances = np.sqrt(np.abs(squared.min(axis=1, initial=np.inf)))
        most = min(limits[n], float(distances.min()) + _SETTINGS.hand_layer_m)
        is_low = distances[of_hand] - from_firsts[n] < most
        above = squared[np.unique(of_hand[is_low])].min(axis=0, initial=np.inf)
        seen = seen[above < (most + _SETTINGS.meeting_m) ** 2]
        if not len(seen):
            continue
        hand, points = hands[n][is_low], others[n].take(seen, axis=0)
        distances = np.sqrt(np.abs(squared_distances(hand, points).min(axis=1)))
        distance = float(distances.min())
        hand = hand[distances < min(limits[n], distance + _SETTINGS.hand_layer_m)]
        if len(hand):
            poses[n] = _Pose(hand, points, other_skin.turn_normals(posed[0][n], other_rows[seen]), distance)
    return poses
