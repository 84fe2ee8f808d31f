"""Moves elbows, forearms and wrists over time: elbows at their easy places, smoothed and turned out of the trunk and of
the other arm; wrists that yield; forearms that turn no faster than people turn them.

The easy place of an elbow depends on one pose (``pose.easy_swivels``) and can change suddenly with it. The module
smooths the direction from the line between shoulder and wrist to the elbow, in the chest's axes: an angle about that
line has no reference that is steady everywhere.

Hands of written signs yield a little in direction if a wrist or forearm would otherwise bend far. Within the easy
ranges they keep the written directions; these ranges are a little wider than the 40 degrees of flexion and of
extension, and 40 from side to side, of daily tasks (Ryu et al. 1991, Journal of Hand Surgery 16A: 409-419). Beyond
them, a hand yields by a part of the excess, at most by ``WRISTS.largest_yield``; at a joint's limit it misses the rest.

The forearm's twist that a written hand needs, and the wrist's swing, can pass half a turn and would then jump from one
limit to the other in a frame. The twist of such an arm is chosen again on one path over the whole word (Viterbi 1967),
near the written twist and turned over slowly if necessary; the swing is smoothed there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d, maximum_filter1d

from signsplice.body import swivel
from signsplice.motion import FloatArray, rotation
from signsplice.motion.curves import between, sparse
from signsplice.rig.roles import SIDES
from signsplice.signer import pose
from signsplice.signer.figure import Figure, PosedArms
from signsplice.signer.pose import LIMIT_MARGIN, swivel_costs
from signsplice.signer.signer import COLLAR, SHOULDER, UPPER_ARM, HangingElbowSigner, Signer


@dataclass(frozen=True)
class ElbowMotion:
    """Smoothing, path costs and the largest speed of elbows. Lengths without a unit are in upper arm lengths."""

    smoothing_s: float = 0.10
    """Standard deviation of the Gaussian that smooths elbow directions over time, seconds."""
    path_smoothing_s: float = 0.08
    """Standard deviation of the Gaussian that smooths the path of least cost of written signs, seconds."""
    clearing_smoothing_s: float = 0.06
    """Standard deviation of the Gaussian that smooths the turns that free forearms, seconds; they have been smoothed
    once as much before."""
    pressed_m: float = 0.003
    """Depth to which a forearm may press into the trunk or the other arm, m: both give way."""
    missed_direction: float = np.deg2rad(6.0)
    """Angle by which a hand misses its direction that costs 0.7, radians; twice the angle costs 8 times as much."""
    effort_weight: float = 0.35
    """Factor on the cost of an elbow away from its easy place."""
    crossing_distance: float = 0.35
    """Distance in front of the shoulder from which an elbow crosses the trunk at no cost."""
    crossing_area: float = 0.08
    """Distance inwards times distance behind the plane at ``crossing_distance`` that costs 1, squared upper arm
    lengths."""
    raised_height: float = 0.1
    """Height of an elbow over both shoulder and wrist that costs 1."""
    step: float = 0.075
    """Step of an elbow in a thirtieth of a second that costs 1."""
    least_distance: float = 0.15
    """Least counted distance of an elbow from the line between shoulder and wrist: a straight arm turns."""
    fastest_cm_s: float = 280.0
    """Speed of an elbow about its shoulder above which its direction is smoothed again, cm/s."""
    slowing_reach_s: float = 0.2
    """Time around a fast frame in which directions are smoothed, seconds."""
    slowing_rounds: int = 6
    """Largest number of these smoothings."""


@dataclass(frozen=True)
class ForearmAndWrist:
    """Yielding of wrists, and the largest speed of turning forearms and wrists."""

    largest_yield: float = np.deg2rad(8.0)
    """Largest angle by which a hand yields, radians."""
    yield_scale: float = np.deg2rad(18.0)
    """Excess over the easy ranges at which a hand yields by 63 % of ``largest_yield``, radians."""
    fastest_turn_rad_s: float = 18.0
    """Speed of a forearm's turn above which its twist is chosen again, radians a second."""
    swing_share: float = 0.6
    """Share of a wrist's swing that counts as such a turn: people nod with up to 12 radians a second."""
    missed_twist: float = 0.5
    """Difference from the written twist that costs 1, radians."""
    twist_speed_rad_s: float = 4.2
    """Speed at which a twist changes that costs 1 in each frame, radians a second."""
    twist_smoothing_s: float = 0.045
    """Standard deviation of the Gaussian that smooths the chosen twist, seconds."""
    twist_reach_s: float = 0.25
    """Time around a fast frame in which the chosen twist replaces the written one, seconds."""


_ELBOWS = ElbowMotion()
WRISTS = ForearmAndWrist()

CLEARING_TURNS = np.deg2rad(np.arange(-60.0, 61.0, 5.0))
"""Candidate turns of a led elbow that free its forearm, radians; coarser steps would turn it too far."""


def smooth_elbows(
    states: FloatArray, signer: Signer, fps: float, led: bool = False, figure: Figure | None = None
) -> FloatArray:
    """Smooths the elbows of a word's states (T, 65) and keeps forearms out of the trunk and of the other arm; returns
    plain motion unchanged. ``led``: elbows go where wrists can turn hands as written; ``figure``: of these states,
    apart from their arms.
    """
    if not signer.manner.low_elbows:
        return states
    directions = _easiest_directions(states, signer, fps) if led else directions_of(states, signer)
    width = (_ELBOWS.path_smoothing_s if led else _ELBOWS.smoothing_s) * fps
    states = turn_elbows(states, gaussian_filter1d(directions, width, axis=0, mode="nearest"), signer)
    figure = figure or Figure(states, signer)
    posed = figure.pose_arms(states)
    for which in (0, 1):
        turns = _clearing(posed, which, fps, CLEARING_TURNS) if led else _clearing(posed, which, fps)
        if turns.any():
            states = states.copy()
            clearing_width = _ELBOWS.clearing_smoothing_s * fps
            states[:, pose.TURNS.start + which] += gaussian_filter1d(turns, clearing_width, mode="nearest")
            posed = figure.pose_arms(states) if not which else posed
    return states


CANDIDATE_SWIVELS = np.deg2rad(np.linspace(-105.0, 65.0, 26))
"""Candidate turns of hanging elbows for written hands, radians; negative turns lift elbows outwards."""


def _easiest_directions(states: FloatArray, signer: Signer, fps: float) -> FloatArray:
    """Directions (T, 2, 3) to elbows on the path of least cost over a whole word (Viterbi 1967), solved 15 times a
    second: hands miss their directions little, arms are easy, and elbows move little.
    """
    frames = sparse(len(states), fps / 15.0)
    both = pose.hands(states[frames])
    arm = pose.solve_arm(both[..., pose.WRIST], signer)
    hard, effort = hardship(arm, both[..., pose.ROTVEC], signer, CANDIDATE_SWIVELS)
    hang_axis, side_axis = (x[..., None, :] for x in pose.elbow_axes(arm))
    cos, sin = np.cos(CANDIDATE_SWIVELS)[:, None], np.sin(CANDIDATE_SWIVELS)[:, None]
    directions = cos * hang_axis + sin * side_axis  # (T, 2, K, 3)
    bone = rotation.rotate(arm.upper, [-1.0, 0.0, 0.0])[..., None, :]
    projection = np.sum(bone * arm.direction[..., None, :], axis=-1, keepdims=True) * arm.direction[..., None, :]
    off_line = np.linalg.norm(bone - projection, axis=-1, keepdims=True)
    elbow = projection + np.maximum(off_line, _ELBOWS.least_distance) * directions
    across_trunk = np.maximum(0.0, elbow[..., 0]) * np.maximum(0.0, _ELBOWS.crossing_distance - elbow[..., 2])
    wrist = (both[..., 1] / signer.scale - (COLLAR + SHOULDER)[1]) / (UPPER_ARM * signer.arms)
    raised = np.maximum(0.0, elbow[..., 1] - np.maximum(0.0, wrist)[..., None])
    costs = hard + effort + np.square(across_trunk / _ELBOWS.crossing_area) + np.square(raised / _ELBOWS.raised_height)
    rows, apart_s = np.arange(len(frames)), (frames[-1] / max(1, len(frames) - 1)) / fps
    led = np.empty((len(frames), 2, 3))
    for which in (0, 1):
        elbows, scale = elbow[:, which], 1.0 / (30.0 * apart_s * _ELBOWS.step) ** 2
        squares = scale * np.square(elbows).sum(axis=-1)
        changes = squares[:-1, :, None] + squares[1:, None] - 2.0 * scale * elbows[:-1] @ elbows[1:].transpose(0, 2, 1)
        led[:, which] = directions[rows, which, swivel.least_cost_choices(costs[:, which], changes)]
    return between(led, frames)


def hardship(arm: pose.Arm, rotvecs: FloatArray, signer: Signer, swivels: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Costs (..., S) of hands with rotation vectors ``rotvecs`` (..., 3) that miss their directions or reach them with
    uncomfortable wrists, with elbows at ``swivels`` (S,); and the additional costs of these elbows.
    """
    missed, effort, strain = swivel_costs(arm, rotvecs, signer, swivels)
    missed = np.square(missed / _ELBOWS.missed_direction)
    costs = np.square(missed) / (1.0 + 0.45 * missed)  # small misses cost little
    return costs + _ELBOWS.effort_weight * strain, _ELBOWS.effort_weight * effort


def from_hanging(states: FloatArray, signer: Signer) -> tuple[FloatArray, HangingElbowSigner]:
    """The same motion (T, 65) with elbow turns relative to hanging elbows, and the signer for it: repeated changes need
    no easy places then.
    """
    new_states = states.copy()
    new_states[:, pose.TURNS] = solve_arms(states, signer)[1]
    return new_states, HangingElbowSigner(**vars(signer))


def from_easy(states: FloatArray, signer: Signer) -> FloatArray:
    """The same motion (T, 65) with elbow turns relative to easy places again."""
    both, new_states = pose.hands(states), states.copy()
    easy = pose.easy_swivels(pose.solve_arm(both[..., pose.WRIST], signer), both[..., pose.ROTVEC], signer)
    new_states[:, pose.TURNS] = _short(states[:, pose.TURNS] - easy)
    return new_states


def keep_elbows(states: FloatArray, before: FloatArray, signer: Signer) -> FloatArray:
    """Gives states (T, 65) the elbow directions of the states ``before`` (T, 65) a small move of the hands: easy places
    of similar poses can be far apart.
    """
    return turn_elbows(states, directions_of(before, signer), signer)


def turn_arms(states: FloatArray, arm: pose.Arm, quats: FloatArray, swivels: FloatArray, signer: Signer) -> FloatArray:
    """Turns hands of states (T, 65) to ``quats`` (T, 2, 4), relative to the forearms of an ``arm`` with hanging elbows,
    and elbows to ``swivels`` (T, 2).
    """
    new_states = states.copy()
    both = pose.hands(new_states)
    both[..., pose.ROTVEC] = rotation.log(quats)
    easy = pose.easy_swivels(arm, both[..., pose.ROTVEC], signer)
    new_states[:, pose.TURNS] += _short(swivels - easy - new_states[:, pose.TURNS])
    return new_states


def limit_elbow_speed(states: FloatArray, signer: Signer, fps: float) -> FloatArray:
    """Slows elbows that swing faster than people's in states (T, 65); returns other states unchanged."""
    for _ in range(_ELBOWS.slowing_rounds):
        speed = np.linalg.norm(np.diff(elbow_positions(states, signer), axis=0), axis=-1) * fps
        fast = np.concatenate([np.zeros((1, 2)), speed > _ELBOWS.fastest_cm_s])
        if not fast.any():
            break
        weight = maximum_filter1d(fast, 2 * round(_ELBOWS.slowing_reach_s * fps) + 1, axis=0)
        weight = gaussian_filter1d(weight, 0.4 * _ELBOWS.slowing_reach_s * fps, axis=0)[..., None]
        directions = directions_of(states, signer)
        smooth = gaussian_filter1d(directions, _ELBOWS.smoothing_s * fps, axis=0, mode="nearest")
        states = turn_elbows(states, directions + weight * (smooth - directions), signer)
    return states


def elbow_positions(states: FloatArray, signer: Signer) -> FloatArray:
    """Elbows (T, 2, 3) of states (T, 65) from their shoulders, cm on the standard body, in the chest's axes."""
    arm, swivels = solve_arms(states, signer)
    upper = rotation.multiply(rotation.exp(swivels[..., None] * arm.direction), arm.upper)
    return np.asarray(rotation.rotate(upper, [-UPPER_ARM * signer.arms, 0.0, 0.0]))


def solve_arms(states: FloatArray, signer: Signer) -> tuple[pose.Arm, FloatArray]:
    """Both arms of states (T, 65) with hanging elbows, and their swivels (T, 2)."""
    both = pose.hands(states)
    arm = pose.solve_arm(both[..., pose.WRIST], signer)
    return arm, pose.easy_swivels(arm, both[..., pose.ROTVEC], signer) + states[..., pose.TURNS]


def directions_of(states: FloatArray, signer: Signer) -> FloatArray:
    """Unit vectors (T, 2, 3) from the lines between shoulders and wrists to the elbows of states (T, 65)."""
    return directions_at(*solve_arms(states, signer))


def directions_at(arm: pose.Arm, swivels: FloatArray) -> FloatArray:
    """``directions_of`` for arms with elbows at ``swivels`` (T, 2)."""
    hang_axis, side_axis = pose.elbow_axes(arm)
    return np.asarray(np.cos(swivels)[..., None] * hang_axis + np.sin(swivels)[..., None] * side_axis)


def swivels_to(arm: pose.Arm, directions: FloatArray) -> FloatArray:
    """The swivels (...) of elbows in these directions (..., 3) from the lines between shoulders and wrists."""
    hang_axis, side_axis = pose.elbow_axes(arm)
    sin, cos = (np.einsum("...c,...c->...", directions, axis) for axis in (side_axis, hang_axis))
    return np.asarray(np.arctan2(sin, cos))


def turn_elbows(states: FloatArray, directions: FloatArray, signer: Signer) -> FloatArray:
    """Turns elbows of states (T, 65) to these directions (T, 2, 3), as far as the wrists allow."""
    arm, swivels = solve_arms(states, signer)
    new_states = states.copy()
    new_states[:, pose.TURNS] += _short(swivels_to(arm, directions) - swivels)
    return new_states


def _short(angles: FloatArray) -> FloatArray:
    """Wraps angles to -pi to pi."""
    return np.asarray(np.angle(np.exp(1j * angles)))


def _clearing(posed: PosedArms, which: int, fps: float, *grid: FloatArray) -> FloatArray:
    """Changes (T,) of the swivels of the strong (0) or the weak arm (1) that free its forearm, radians."""
    body, groups = posed.capsules.body, posed.capsules.body.groups
    solid = [*groups.below_arms, *(groups.right_arm if which else groups.left_arm)]
    radii, forearm = 0.01 * body.radii, body.keys.index(f"{SIDES[1 - which]}LowerArm")
    starts, ends = (0.01 * x[:, solid] for x in (posed.capsules.starts, posed.capsules.ends))
    shoulder, elbow, wrist = (0.01 * posed.positions[:, which, n] for n in (1, 2, 3))
    arm = swivel.BentArm(shoulder, elbow, wrist, radii[forearm])
    obstacles = swivel.Obstacles(starts, ends, radii[solid])
    turns = swivel.choose(arm, obstacles, np.full((len(elbow), len(solid)), _ELBOWS.pressed_m), fps, *grid)
    return turns if which == 0 else -turns


_EASY_RANGES = np.deg2rad([[-78.0, 78.0], [-28.0, 18.0], [-48.0, 52.0]])
"""Ranges of the forearm's twist and the wrist's deviation and flexion beyond which it yields, radians."""
_ANGLE_LIMITS = np.array([[-pose.FOREARM_LIMIT, pose.FOREARM_LIMIT], *pose.WRIST_LIMITS])
"""Limits of the forearm's twist and the wrist's deviation and flexion, radians."""


def turn_hands(states: FloatArray, written: FloatArray, signer: Signer) -> FloatArray:
    """Turns hands of states (T, 65) to rotations ``written`` (T, 2, 4) in the chest's axes; elbows stay in place."""
    arm, swivels = solve_arms(states, signer)
    return turn_arms(states, arm, rotation.multiply(rotation.inverse(arm.fore), written), swivels, signer)


def beyond_easy(angles: FloatArray) -> FloatArray:
    """How far twist, deviation and flexion (..., 3) are beyond the easy ranges."""
    return np.asarray(angles - np.clip(angles, *_EASY_RANGES.T))


def ease_wrists(
    states: FloatArray, written: FloatArray, signer: Signer, added: FloatArray, room: FloatArray
) -> FloatArray:
    """``turn_hands`` within easy ranges, with the angles (T, 2, 3) ``added`` by movements of forearm and wrist, which
    keep ``room`` (T, 2, 3) to either side before a joint's limit.
    """
    arm, swivels = solve_arms(states, signer)
    quats = rotation.multiply(rotation.inverse(arm.fore), written)
    angles = pose.arm_angles_at(arm, quats, swivels).stacked  # (T, 2, 3)
    off = beyond_easy(angles)
    size = np.linalg.norm(off, axis=-1, keepdims=True)
    missed = np.linalg.norm(angles - np.clip(angles, *_ANGLE_LIMITS.T), axis=-1, keepdims=True)
    share = (1.0 - np.exp(-size / WRISTS.yield_scale)) * np.maximum(0.0, 1.0 - missed / WRISTS.largest_yield)
    angles = angles - WRISTS.largest_yield * share * off / np.maximum(size, 1e-9)
    # Angles approach limits softly from LIMIT_MARGIN before them; a movement needs that range free. Without a movement,
    # nothing changes.
    inner = room + LIMIT_MARGIN * (2.0 * np.minimum(room / LIMIT_MARGIN, 1.0) - 1.0)
    low, high = _ANGLE_LIMITS.T
    angles = np.where(room > 0.0, np.clip(angles, low + inner, high - inner), angles) + added
    return turn_arms(states, arm, pose.hand_quats_at(arm, angles, swivels), swivels, signer)


_CANDIDATE_TWISTS = np.deg2rad(np.linspace(-92.0, 92.0, 25))
"""Candidate twists of a forearm whose twist is chosen again, radians."""


def limit_forearm_speed(states: FloatArray, signer: Signer, fps: float) -> FloatArray:
    """Keeps forearms and wrists of states (T, 65) from turning over in a frame; returns other states unchanged."""
    arm, wanted = pose.solve_arms_and_angles(states, signer)
    within = np.clip(wanted.stacked, *_ANGLE_LIMITS.T)  # (T, 2, 3)
    steps = np.diff(within, axis=0)
    turns = np.maximum(np.abs(steps[..., 0]), WRISTS.swing_share * np.linalg.norm(steps[..., 1:], axis=-1))
    fast = turns * fps > WRISTS.fastest_turn_rad_s  # (T - 1, 2)
    if not fast.any():
        return states
    angles = within.copy()
    for which in np.flatnonzero(fast.any(axis=0)):
        path = _twist_path(wanted.twist[:, which], fps)
        odd = np.abs(path - within[:, which, 0]) > WRISTS.missed_twist
        odd[1:] |= fast[:, which]
        weight = maximum_filter1d(odd.astype(np.float64), 2 * round(WRISTS.twist_reach_s * fps) + 1)
        weight = gaussian_filter1d(weight, 0.4 * WRISTS.twist_reach_s * fps)
        path = gaussian_filter1d(path, WRISTS.twist_smoothing_s * fps, mode="nearest")
        swing = gaussian_filter1d(within[:, which, 1:], WRISTS.twist_smoothing_s * fps, axis=0, mode="nearest")
        angles[:, which] += weight[:, None] * (np.column_stack([path, swing]) - within[:, which])
    quats = pose.hand_quats_at(arm, angles, wanted.swivel)
    new_states = states.copy()
    fast = fast.any(axis=0)
    pose.hands(new_states)[:, fast, pose.ROTVEC] = rotation.log(quats)[:, fast]
    return keep_elbows(new_states, states, signer)


def _twist_path(twist: FloatArray, fps: float) -> FloatArray:
    """The twist (T,) of least cost for a wanted one (T,), compared modulo a full turn."""
    missed = np.angle(np.exp(1j * (twist[:, None] - _CANDIDATE_TWISTS)))
    change = np.square((_CANDIDATE_TWISTS[:, None] - _CANDIDATE_TWISTS) * fps / WRISTS.twist_speed_rad_s)
    chosen = swivel.least_cost_choices(np.square(missed / WRISTS.missed_twist), [change] * (len(twist) - 1))
    return np.asarray(_CANDIDATE_TWISTS[chosen])
