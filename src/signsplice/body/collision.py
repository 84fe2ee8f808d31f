"""Distances and depths within one body: from hands and forearms to head, trunk, arms and the other hand.

Two bodies of the same roles share the keys of their capsules, so a distance on one has its counterpart on the other.
A depth is positive inside and negative outside, in clip units. An exit direction is the unit vector along which a
capsule would leave the other one by the shortest path.

"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import zip_longest

import numpy as np
from numpy.typing import NDArray

from signsplice.body.capsules import ARM, BodyCapsules, body_capsules, capsule_ends
from signsplice.motion import Clip, FloatArray, Skeleton
from signsplice.motion.kinematics import forward
from signsplice.rig.info import rig_info
from signsplice.rig.roles import SIDES

Index = NDArray[np.intp]

TINY = 1e-12


@dataclass(frozen=True, eq=False)
class _Block:
    """All pairs of two sets of capsules: rows (A,) and (B,) of a body's capsules."""

    own: Index
    other: Index


@dataclass(frozen=True, eq=False)
class SkinPairs:
    """Pairs of capsules whose distance matters, as rows of a body's capsules.

    own, other: (K,) of each pair; ``own`` is of a hand or forearm.
    own_side: (K,) 0 if ``own`` is of the left arm, 1 if of the right.
    other_side: (K,) likewise for ``other``; -1 for head and trunk, which do not move with a wrist.
    blocks: the same pairs as products: one hand, or one forearm, with everything that it may meet.
    """

    own: Index
    other: Index
    own_side: Index
    other_side: Index
    blocks: tuple[_Block, ...]


@dataclass(frozen=True, eq=False)
class Near:
    """Pairs of capsules that are close to each other in some frames.

    frames: (N,) in order.
    k: (N,) the row in ``SkinPairs`` of the pair that is close in each frame.
    distance: (N,) skin distance of each pair, m; if a clip is retargeted, on its own body.
    """

    frames: Index
    k: Index
    distance: FloatArray


def skin_pairs(body: BodyCapsules, keys: frozenset[str]) -> SkinPairs:
    """Returns all pairs of a hand's capsule and one of head, neck, trunk, other arm or other hand, among these keys."""
    hands, arms, solid = _parts(body, keys)
    blocks = [(hands[side], [*solid, *arms[1 - side]]) for side in (0, 1)]
    return _make_skin_pairs(body, [*blocks, (hands[0], hands[1])])


def forearm_pairs(body: BodyCapsules, keys: frozenset[str]) -> SkinPairs:
    """Returns all pairs of a forearm and a capsule of head, neck, trunk below the arms, or the other arm, among these
    keys.
    """
    _, arms, solid = _parts(body, keys)
    free = [n for n in solid if n in body.groups.head or n in body.groups.below_arms]
    return _make_skin_pairs(
        body,
        [([n for n in arms[side] if body.parts[n] == "cuff"], [*free, *arms[1 - side]]) for side in (0, 1)],
    )


def _parts(body: BodyCapsules, keys: frozenset[str]) -> tuple[list[list[int]], list[list[int]], list[int]]:
    """Returns the rows of both hands, of both arms, and of head, neck and trunk."""
    groups = body.groups
    hands = [[n for n in group if body.keys[n] in keys] for group in (groups.left, groups.right)]
    solid = [n for n in (*groups.head, *groups.trunk) if body.keys[n] in keys]
    arms = [
        [n for n, key in enumerate(body.keys) if key in keys and body.sides[n] == side and body.parts[n] in ARM]
        for side in SIDES
    ]
    return hands, arms, solid


def _make_skin_pairs(body: BodyCapsules, blocks: list[tuple[list[int], list[int]]]) -> SkinPairs:
    side = np.array([SIDES.index(side) if side else -1 for side in body.sides], np.intp)
    rows = [_Block(np.array(own_rows, np.intp), np.array(other_rows, np.intp)) for own_rows, other_rows in blocks]
    own_rows = np.concatenate([np.repeat(block.own, len(block.other)) for block in rows])
    other_rows = np.concatenate([np.tile(block.other, len(block.own)) for block in rows])
    return SkinPairs(own_rows, other_rows, side[own_rows], side[other_rows], tuple(rows))


def near_pairs(
    starts: FloatArray, ends: FloatArray, radii: FloatArray, pairs: SkinPairs, margin: float
) -> tuple[Index, Index]:
    """Returns frames (N,), in order, and rows (N,) of the pairs that may be nearer than ``margin`` in them, from
    capsule starts and ends (T, C, 3) and radii (C, 2). Tests a ball around each hand or forearm first, then a ball
    around each of its capsules.
    """
    axes = ends - starts
    squared_lengths, thick, middles = dot(axes, axes), radii.max(axis=1), starts + 0.5 * axes
    reach = 0.5 * np.sqrt(squared_lengths.max(axis=0)) + thick
    hits, offset = [], 0
    for block in pairs.blocks:
        n_own, n_other = len(block.own), len(block.other)
        if n_own and n_other:
            ball = middles[:, block.own].mean(axis=1, keepdims=True)
            from_middle = middles[:, block.own] - ball
            radius = (np.sqrt(dot(from_middle, from_middle)) + reach[block.own]).max(axis=1, keepdims=True)
            b = block.other
            squared = segment_distance_squared(ball, starts[:, b], axes[:, b], squared_lengths[:, b])
            frames, columns = np.nonzero(squared < (radius + thick[b] + margin) ** 2)
            rows = frames * len(radii)
            b_rows, own_rows = rows[:, None] + b[columns, None], rows[:, None] + block.own
            squared = segment_distance_squared(
                _take(middles, own_rows),
                _take(starts, b_rows),
                _take(axes, b_rows),
                squared_lengths.reshape(-1).take(b_rows),
            )
            limit = reach[block.own] + thick[b[columns], None] + margin
            close, a = np.nonzero(squared < limit * limit)
            hits.append((frames[close], offset + a * n_other + columns[close]))
        offset += n_own * n_other
    frames, k = (np.concatenate([hit[part] for hit in hits] or [np.empty(0, np.intp)]) for part in (0, 1))
    order = np.argsort(frames, kind="stable")
    return frames[order], k[order]


def _take(points: FloatArray, at: Index) -> FloatArray:
    """Returns rows (..., 3) of points (T, C, 3) by their flat index."""
    return points.reshape(-1, 3).take(at, axis=0)


def segment_distance_squared(
    point: FloatArray, start: FloatArray, axis: FloatArray, squared_length: FloatArray
) -> FloatArray:
    """Returns squared distances (...) of points from line segments (..., 3) with axes of ``squared_length`` (...)."""
    offset = point - start
    share = np.clip(dot(offset, axis) / (squared_length + TINY), 0.0, 1.0)
    offset = offset - share[..., None] * axis
    return dot(offset, offset)


@dataclass(frozen=True, eq=False)
class Clearances:
    """Skin distances of pairs of capsules.

    distance: (...) from skin to skin; negative inside.
    normals: (..., 3) unit vectors from the other capsule to the own one.
    own_at, other_at: (...) places of the nearest points along each axis, 0 to 1.
    """

    distance: FloatArray
    normals: FloatArray
    own_at: FloatArray
    other_at: FloatArray


def clearances(
    r: FloatArray, u: FloatArray, v: FloatArray, own_radii: FloatArray, other_radii: FloatArray
) -> Clearances:
    """Returns skin distances of capsules with axes u from capsules with axes v (..., 3); r (..., 3) leads from the
    starts of v to those of u; radii (..., 2). Uses the nearest points of the two axes (Ericson 2005, 5.1.9) with the
    radii there: exact for capsules of constant thickness, otherwise within the taper's slope.
    """
    uu, vv, uv = dot(u, u) + TINY, dot(v, v) + TINY, dot(u, v)
    ur, vr = dot(u, r), dot(v, r)
    s = np.clip((uv * vr - ur * vv) / np.maximum(uu * vv - uv * uv, TINY), 0.0, 1.0)
    t = np.clip((uv * s + vr) / vv, 0.0, 1.0)
    s = np.clip((uv * t - ur) / uu, 0.0, 1.0)
    line = r + s[..., None] * u - t[..., None] * v
    axis_distance = np.sqrt(dot(line, line)) + TINY
    thick = own_radii[..., 0] + s * (own_radii[..., 1] - own_radii[..., 0])
    thick = thick + other_radii[..., 0] + t * (other_radii[..., 1] - other_radii[..., 0])
    return Clearances(axis_distance - thick, line / axis_distance[..., None], s, t)


def pair_clearances(
    starts: FloatArray, ends: FloatArray, radii: FloatArray, pairs: SkinPairs, frames: Index, k: Index
) -> Clearances:
    """Returns skin distances of pairs ``k`` (N,) at ``frames`` (N,), from capsule ends (T, C, 3), radii (C, 2)."""
    own_rows, other_rows, rows = pairs.own[k], pairs.other[k], frames * len(radii)
    p, q = _take(starts, rows + own_rows), _take(starts, rows + other_rows)
    u, v = _take(ends, rows + own_rows) - p, _take(ends, rows + other_rows) - q
    return clearances(p - q, u, v, radii[own_rows], radii[other_rows])


def dot(a: FloatArray, b: FloatArray) -> FloatArray:
    """Returns dot products (...) of vectors (..., 3)."""
    return np.asarray(np.einsum("...c,...c->...", a, b))


WARN_M = 0.01
"""Depth of a hand in the body from which a clip gets a warning, m."""
WARN_FOREARM_M = 0.03
"""The same for a forearm in the trunk, whose width is a guess, m."""
_MOST_DISTANCES = 12_000
"""Most distances computed at once: arrays of over 128 kB cost page faults."""
_WHOLE_HAND_WEIGHT = 1.2
"""Weight of the direction from hand to hand, relative to the exit direction of two capsules of the hands."""


def forearm_penetration(skeleton: Skeleton, global_rotations: FloatArray, global_positions: FloatArray) -> FloatArray:
    """Returns the depth (T, 2) of the left and right forearm, elbow included, in the trunk below the arms, clip units
    (negative: the distance), from the globals of ``kinematics.forward`` for all joints; minus infinity without one.
    """
    body = body_capsules(skeleton)
    starts, ends = capsule_ends(body, global_rotations, global_positions)
    depth = np.full((len(starts), 2), -np.inf)
    for side, arm in enumerate((body.groups.left_arm, body.groups.right_arm)):
        forearm = [n for n in arm if body.parts[n] == "cuff"]
        if forearm and body.groups.below_arms:
            depth[:, side] = overlap(starts, ends, body.radii, forearm, body.groups.below_arms)[0].max(axis=(1, 2))
    return depth


def depth_warnings(clip: Clip) -> list[str]:
    """Returns a line for each hand and forearm of a clip that lies too deep in the body in some frame."""
    info = rig_info(clip.skeleton)
    if not info.has_arms:
        return []
    posed = forward(clip)
    hands, _ = pose_capsules(clip.skeleton, *posed).penetration()
    lines = []
    for name, where, limit, depth in (
        ("hand", "head, trunk, the other arm or its hand", WARN_M, hands),
        ("forearm", "the trunk", WARN_FOREARM_M, forearm_penetration(clip.skeleton, *posed)),
    ):
        for side, depths in zip(SIDES, info.sizes.unit.metres * depth.T, strict=True):
            if depths.max() > limit:
                frame = int(depths.argmax())
                lines.append(f"the {side} {name} lies {100 * depths[frame]:.1f} cm in {where} at frame {frame}")
    return lines


@dataclass(frozen=True, eq=False)
class PosedCapsules:
    """A body's capsules over time.

    body: the capsules.
    starts, ends: (T, C, 3) of their axes in the world.
    """

    body: BodyCapsules
    starts: FloatArray
    ends: FloatArray

    def __getitem__(self, frames: slice | NDArray[np.bool_]) -> PosedCapsules:
        """Returns the capsules of some frames."""
        return PosedCapsules(self.body, self.starts[frames], self.ends[frames])

    def near_pairs(
        self,
        slack: float = 0.0,
        firsts: Sequence[int] = (0,),
        forearms: bool = False,
        moves: FloatArray | None = None,
        fixed: int | None = None,
    ) -> NearPairs:
        """Returns pairs of capsules that may overlap once they come nearer by up to ``slack``, clip units: one of a
        hand, taken as a ball about its middle, and one of head, trunk, the other arm or its hand.

        slack: the largest sum of both hands' moves in a frame.
        firsts: first frames of the clips, if several lie end to end.
        forearms: adds pairs of a forearm and the other arm.
        moves: (T, 2, 3) of the hands, from which they move by ``slack``; forearms do not follow them.
        fixed: side of a hand that does not move, 0 left or 1 right: only the other one is led out of what it meets.

        Tests whole hands first, as balls too: most of the time they are close to nothing.
        """
        hands, rows, obstacles, n_solid, may_meet, thick = self.body.derived[_meeting_parts]
        if not forearms:
            hands, may_meet = hands[:2], may_meet[:2]
        radii = self.body.radii
        clip_lengths = np.diff([*firsts, len(self.starts)])
        origins = np.repeat(self.starts[list(firsts)].mean(axis=1), clip_lengths, axis=0)
        starts, axes = self.starts - origins[:, None], self.ends - self.starts
        unmoved, starts = starts, starts if moves is None else _move_hands(starts, hands, moves)
        middles = starts + 0.5 * axes
        reach = 0.5 * np.sqrt(dot(axes, axes)) + thick
        hand_balls = [_ball(middles[:, hand], reach[:, hand]) for hand in hands]
        balls, radius = (np.hstack([ball[k] for ball in hand_balls]) for k in (0, 1))
        met = _meet(balls, radius, starts[:, obstacles], axes[:, obstacles], thick[obstacles] + slack)
        met &= may_meet
        if fixed is not None:
            met[:, fixed, :n_solid] = False
        frames, part, column = np.nonzero(met)
        movers, other_rows = rows[part], obstacles[column]
        t, axis = frames[:, None], axes[frames, other_rows]
        squared = segment_distance_squared(
            middles[t, movers], starts[frames, other_rows][:, None], axis[:, None], dot(axis, axis)[:, None]
        )
        least = np.maximum(reach[t, movers] + thick[other_rows, None] + slack, 0.0)
        n, k = np.nonzero((squared < least * least) & (movers >= 0))
        frames, i, j, is_left, meeting = frames[n], movers[n, k], other_rows[n], part[n] % 2 == 0, column[n] >= n_solid
        follows = np.column_stack([is_left, np.where(meeting, -1.0, ~is_left)])
        if fixed is not None:
            follows[:, fixed] = 0.0
        between_hands = np.zeros((len(i), 3))
        if meeting.any():
            between_hands = (unmoved[:, hands[0]].mean(axis=1) - unmoved[:, hands[1]].mean(axis=1))[frames]
        return NearPairs(
            n_frames=len(starts),
            frames=frames,
            pairs=i * len(radii) + j,
            hands=follows,
            meeting=meeting,
            offsets=unmoved[frames, i] - unmoved[frames, j],
            axes=(axes[frames, i], axes[frames, j]),
            radii=(radii[i], radii[j]),
            apart=between_hands,
        )

    def nearest(
        self, own: Sequence[int], parts: Sequence[Sequence[int]], most: float = np.inf
    ) -> tuple[FloatArray, FloatArray]:
        """Returns the skin distance (T, P) of some capsules from each of some parts, clip units, negative inside, and
        the unit vector (T, P, 3) away from it; ``most`` and 0 in frames in which all are farther.
        """
        rows, columns = np.asarray(own, np.intp), np.concatenate([np.asarray(part, np.intp) for part in parts])
        step = max(1, _MOST_DISTANCES // (len(rows) * len(columns)))
        if len(self.starts) > step:
            blocks = [self[n : n + step].nearest(own, parts, most) for n in range(0, len(self.starts), step)]
            return np.concatenate([block[0] for block in blocks]), np.concatenate([block[1] for block in blocks])
        bounds = np.cumsum([0, *map(len, parts)])
        radii, starts, axes = self.body.radii, self.starts, self.ends - self.starts
        distance, normals = np.full((len(starts), len(parts)), most), np.zeros((len(starts), len(parts), 3))
        middles, half = starts[:, rows] + 0.5 * axes[:, rows], 0.5 * np.sqrt(dot(axes[:, rows], axes[:, rows]))
        thick, thin = radii.max(axis=1), radii.min(axis=1)
        t = np.arange(len(starts))
        if np.isfinite(most):
            balls, radius = _ball(middles, half + thick[rows])
            t = np.flatnonzero(
                _meet(balls, radius, starts[:, columns], axes[:, columns], thick[columns] + most).any(axis=(1, 2))
            )
        if not len(t):
            return distance, normals
        box = np.ix_(t, columns)
        distances = np.sqrt(
            np.maximum(_segment_distances_squared(middles[t], starts[box], axes[box]), 0.0)
        )  # (F, A, B)
        greatest = (distances - thin[rows, None] - thin[columns]).min(axis=1)
        greatest = np.minimum.reduceat(greatest, bounds[:-1], axis=1)  # (F, P)
        part = np.repeat(np.arange(len(parts)), np.diff(bounds))
        least = distances - (half[t] + thick[rows])[..., None] - thick[columns]
        frames, i, j = np.nonzero(least <= greatest[:, part][:, None] + TINY)
        frames, i, part, j = t[frames], rows[i], part[j], columns[j]
        start, to = starts[frames, i], starts[frames, j]
        gaps = clearances(start - to, axes[frames, i], axes[frames, j], radii[i], radii[j])
        order = np.argsort(gaps.distance, kind="stable")[::-1]  # the last pair of a part, the nearest, stays
        distance[frames[order], part[order]] = gaps.distance[order]
        normals[frames[order], part[order]] = gaps.normals[order]
        return distance, normals

    def penetration(self, firsts: Sequence[int] = (0,), fixed: int | None = None) -> tuple[FloatArray, FloatArray]:
        """Returns the depth (T, 2) of each hand in head, trunk, the other arm or its hand, clip units, and the exit
        direction (T, 2, 3), both from ``near_pairs``. If a hand lies in nothing, or is ``fixed``, its depth is some
        number not above 0, and its exit direction is meaningless. ``firsts``, ``fixed``: as there.
        """
        return self.near_pairs(firsts=firsts, fixed=fixed).penetration()


def _move_hands(starts: FloatArray, hands: Sequence[Index], moves: FloatArray) -> FloatArray:
    """Returns starts (T, C, 3) of capsules with those of the left and right hand moved by ``moves`` (T, 2, 3)."""
    moved = starts.copy()
    for side in (0, 1):
        moved[:, hands[side]] += moves[:, side, None]
    return moved


def _meeting_parts(
    body: BodyCapsules,
) -> tuple[list[Index], Index, Index, int, NDArray[np.bool_], FloatArray]:
    """Returns the capsules of both hands and both forearms; these (4, M), each filled up by -1; the (B,) obstacles,
    which they must not enter; how many of these are not of the right hand; which of them (4, B) to test for each hand
    and forearm; and radii (C,).
    """
    groups, arms = body.groups, (body.groups.left_arm, body.groups.right_arm)
    movers = [groups.left, groups.right, *([n for n in arm if body.parts[n] == "cuff"] for arm in arms)]
    obstacles = np.array([*groups.head, *groups.trunk, *arms[0], *arms[1], *groups.right], np.intp)
    n_solid = len(obstacles) - len(groups.right)
    meet = np.ones((4, len(obstacles)), bool)
    meet[1, n_solid:] = False  # the right hand and itself
    for side, arm in enumerate(arms):
        meet[side::2, np.isin(obstacles, arm)] = False
    meet[2:, ~np.isin(obstacles, arms[0] + arms[1])] = False
    filled = np.array([*zip_longest(*movers, fillvalue=-1)], np.intp).reshape(-1, 4).T
    return [np.array(rows, np.intp) for rows in movers], filled, obstacles, n_solid, meet, body.radii.max(axis=1)


def _ball(middles: FloatArray, reach: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Returns middles (T, 1, 3) and radii (T, 1) of balls about balls (T, K, 3), (T, K); radius -inf if K is 0."""
    if not middles.shape[1]:
        return np.zeros((len(middles), 1, 3)), np.full((len(middles), 1), -np.inf)
    middle = middles.mean(axis=1, keepdims=True)
    offsets = middles - middle
    return middle, (np.sqrt(dot(offsets, offsets)) + reach).max(axis=1, keepdims=True)


def _meet(
    middles: FloatArray, reach: FloatArray, starts: FloatArray, axes: FloatArray, thick: FloatArray
) -> NDArray[np.bool_]:
    """Tells whether (T, A, B) balls, middles (T, A, 3) and radii (T, A), meet capsules, starts and axes (T, B, 3) and
    radii (B,).
    """
    step = max(1, _MOST_DISTANCES // max(1, middles.shape[1] * starts.shape[1]))
    met = np.empty((len(middles), middles.shape[1], starts.shape[1]), bool)
    for n in range(0, len(middles), step):
        block = slice(n, n + step)
        distances = _segment_distances_squared(middles[block], starts[block], axes[block])
        met[block] = distances < np.maximum(reach[block, :, None] + thick, 0.0) ** 2
    return met


def _segment_distances_squared(points: FloatArray, starts: FloatArray, axes: FloatArray) -> FloatArray:
    """Returns squared distances (T, A, B) of points (T, A, 3) from line segments, starts and axes (T, B, 3)."""
    # By matrix products: few temporary arrays.
    squares = dot(axes, axes)[:, None] + TINY
    projection = points @ axes.transpose(0, 2, 1) - dot(starts, axes)[:, None]  # (T, A, B)
    fraction = np.clip(projection / squares, 0.0, 1.0)
    squared = dot(points, points)[:, :, None] + dot(starts, starts)[:, None] - 2.0 * points @ starts.transpose(0, 2, 1)
    return np.asarray(squared - fraction * (2.0 * projection - fraction * squares))


@dataclass(frozen=True, eq=False)
class NearPairs:
    """K pairs of capsules close to each other: one of a hand or forearm, and one that it must not enter.

    n_frames: T, of the clip.
    frames: (K,) the frame of each pair.
    pairs: (K,) a number for the two capsules of each.
    hands: (K, 2) factors with which a pair's offset follows the left and right hand or forearm; 1 and -1 if both hands
        meet.
    meeting: (K,) whether both capsules are of hands.
    offsets: (K, 3) from the start of the other capsule to the start of the hand's.
    axes: (K, 3) of the hand's capsule and of the other.
    radii: (K, 2) of both, likewise.
    apart: (K, 3) from the right to the left hand; 0 if no pair is of both.
    """

    n_frames: int
    frames: NDArray[np.intp]
    pairs: NDArray[np.intp]
    hands: FloatArray
    meeting: NDArray[np.bool_]
    offsets: FloatArray
    axes: tuple[FloatArray, FloatArray]
    radii: tuple[FloatArray, FloatArray]
    apart: FloatArray

    def penetration(self, moves: FloatArray | None = None) -> tuple[FloatArray, FloatArray]:
        """Returns the depth (T, 2) of each hand, and the exit direction (T, 2, 3), with the hands moved by ``moves``
        (T, 2, 3); as ``PosedCapsules.penetration``.
        """
        depth, exits = np.full((self.n_frames, 2), -np.inf), np.zeros((self.n_frames, 2, 3))
        if not len(self.frames):
            return depth, exits
        offsets, apart = self.offsets, self.apart
        if moves is not None:
            left, right = moves[self.frames].swapaxes(0, 1)
            moved = self.hands[:, :1] * left + self.hands[:, 1:] * right
            offsets, apart = offsets + moved, apart + moved
        depths, directions = _penetration(offsets, *self.axes, *self.radii)
        rows, sides = np.nonzero(self.hands)
        at, of_pairs = 2 * self.frames[rows] + sides, depths[rows]
        np.maximum.at(depth.reshape(-1), at, of_pairs)
        deepest = of_pairs == depth.reshape(-1)[at]
        rows, sides, at = rows[deepest], sides[deepest], at[deepest]
        between_hands, normals = apart[rows], directions[rows]
        out = normals + _WHOLE_HAND_WEIGHT * between_hands / (
            np.linalg.norm(between_hands, axis=-1, keepdims=True) + TINY
        )
        out /= np.linalg.norm(out, axis=-1, keepdims=True) + TINY
        out = np.where(self.meeting[rows, None], out, normals)
        exits.reshape(-1, 3)[at] = out * self.hands[rows, sides, None]  # of equal depths, the last
        return depth, exits

    def persistent_contact_distance(self) -> float:
        """Returns the least skin distance that one pair of both hands does not exceed at either end of the clip, clip
        units, negative inside; infinite if no pair is close at both.
        """
        ends = [np.flatnonzero(self.meeting & (self.frames == frame)) for frame in (0, self.n_frames - 1)]
        _, *matches = np.intersect1d(self.pairs[ends[0]], self.pairs[ends[1]], assume_unique=True, return_indices=True)
        depths = []
        for end, both in zip(ends, matches, strict=True):
            pair_rows = end[both]
            axes, radii = ([part[pair_rows] for part in parts] for parts in (self.axes, self.radii))
            depths.append(_penetration(self.offsets[pair_rows], *axes, *radii)[0])
        return float(-np.minimum(*depths).max(initial=-np.inf))


def pose_capsules(skeleton: Skeleton, global_rotations: FloatArray, global_positions: FloatArray) -> PosedCapsules:
    """Returns a skeleton's capsules, from the globals of ``kinematics.forward`` for all joints."""
    body = body_capsules(skeleton)
    return PosedCapsules(body, *capsule_ends(body, global_rotations, global_positions))


def hand_depths(clip: Clip) -> FloatArray:
    """Returns the depth (T,) of a hand in head, trunk, the other arm or its hand, clip units; not above 0 if no hand
    lies in them.
    """
    return np.asarray(pose_capsules(clip.skeleton, *forward(clip)).penetration()[0].max(axis=1))


def overlap(
    starts: FloatArray, ends: FloatArray, radii: FloatArray, a: Sequence[int], b: Sequence[int]
) -> tuple[FloatArray, FloatArray]:
    """Returns the depth (T, A, B) of capsules ``a`` in capsules ``b`` (negative: the distance), and the exit direction
    (T, A, B, 3) of each of ``a``.

    starts, ends: (T, C, 3) from ``capsules.capsule_ends``; radii (C, 2). Accuracy as in ``clearances``.
    """
    rows, columns = np.asarray(a, np.intp), np.asarray(b, np.intp)
    p, q = starts[:, rows, None], starts[:, None, columns]
    u, v = ends[:, rows, None] - p, ends[:, None, columns] - q
    return _penetration(p - q, u, v, radii[rows, None], radii[columns])


def _penetration(
    r: FloatArray, u: FloatArray, v: FloatArray, own_radii: FloatArray, other_radii: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Returns the depth (...) of capsules with axes u in capsules with axes v (..., 3), and the exit directions
    (..., 3); r (..., 3) leads from the starts of v to those of u; radii (..., 2).
    """
    gaps = clearances(r, u, v, own_radii, other_radii)
    return -gaps.distance, gaps.normals
