"""What a clip shows before it is spliced: facts, warnings, and frames at its ends that do not belong to its motion.

Those are reference poses, and what lies beyond a jump. Exporters and capture systems put the pose in which a rig was
bound or calibrated before or after a take; a word that begins so would bring that pose into the middle of a sentence.
Poses are judged by the directions of arm bones and fingers seen from the chest, so that rigs with other rest poses are
judged alike. Arms are spread in many signs: a reference pose counts only where a clip begins or ends in it, with arms,
hands and fingers straight.

"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from signsplice.errors import InputError
from signsplice.motion import Clip, FloatArray, Skeleton, at_frames, copy_unchecked, kinematics, rotation
from signsplice.rig.align import placement
from signsplice.rig.info import LEFT, RIGHT, Arms, RigInfo, active_span, arms, canonical_motion, rig_info
from signsplice.rig.keyedness import explain_keyedness
from signsplice.rig.rest_pose import rest_frame, rests_as_person, with_rest_pose
from signsplice.rig.roles import FINGERS, SIDES

Mask = NDArray[np.bool_]

JUMP_DEG, JUMP_M_S = 60.0, 4.0
"""A joint that turns by more in a frame, or a hand or root that moves faster, jumps; words that ship reach 3 m/s.
Fingers do not count: where a capture loses them, they flip in the midst of motion that is right.
"""
_ABOVE_NEIGHBOURS = 3.0
"""Times the median of two steps before and two after it that a jump is at least: fast motion gathers speed."""
_END_S, _END_FRACTION = 0.5, 1.0 / 3.0
"""What lies beyond a jump is left out where it takes no longer, and no larger fraction of the clip."""
_NEAR_DEG, _EXACT_DEG = (12.0, 20.0), (5.0, 8.0)
"""Largest angles in a reference pose, of arm bones to where they should point, and of hand and fingers to the forearm:
where a jump leads out of it, and where none does. Nobody holds both arms and all fingers as straight as the latter.
"""
_T_DEG, _A_DEG = 15.0, 60.0
"""Angles below the horizontal up to which straight arms are a T-pose and an A-pose; at more they hang."""
_REST_DEG = 0.5
"""A frame whose arm joints are all within this of the file's rest pose shows that pose."""
_WAY_S = 1.0
"""Longest way out of a reference pose that is left out with it."""
_MOST_LINES = 5


@dataclass(frozen=True)
class StrayFrames:
    """Which frames of a clip belong to its motion.

    start, stop: frames [start, stop) belong; splices leave the others out.
    warnings: about those others, and about jumps between frames that belong; one line each, frames as in the clip.
    """

    start: int
    stop: int
    warnings: tuple[str, ...] = ()

    def resample_span(self, step: float, n_frames: int) -> slice:
        """The frames that belong, of the clip at another rate: ``n_frames``, each ``step`` of its frames on."""
        first = min(math.ceil(self.start / step - 1e-9), n_frames - 1)
        return slice(first, max(first + 1, min(math.floor((self.stop - 1) / step + 1e-9) + 1, n_frames)))


def stray_frames(clip: Clip) -> StrayFrames:
    """Which frames of a clip belong to its motion, kept as long as the clip lives.

    At either end these do not: frames of a T-pose, an A-pose or the file's own rest pose with raised arms, with the way
    out of it; and up to half a second beyond a jump (``JUMP_DEG``, ``JUMP_M_S``), unless that leads to a few wrong
    frames only. All are kept where fewer than two would remain.
    """
    return clip.derived[_stray_frames]


def with_ends_held(clip: Clip) -> Clip:
    """The clip with its first and last frame that belong in place of those that do not, so that frames keep their
    numbers; the clip itself where all belong. Kept as long as the clip lives.
    """
    found = stray_frames(clip)
    is_whole = found.stop - found.start == len(clip.local_rotations)
    return clip if is_whole else clip.derived[_with_ends_held]


def _with_ends_held(clip: Clip) -> Clip:
    found = stray_frames(clip)
    frames = np.clip(np.arange(len(clip)), found.start, found.stop - 1)
    return copy_unchecked(at_frames(clip, frames), channels=clip.channels)


def _stray_frames(clip: Clip) -> StrayFrames:
    info = rig_info(clip.skeleton)
    angles, speeds = _steps(clip, info)
    n_frames = len(angles) + 1
    jumps = _jumps(angles[:, clip.skeleton.derived[_body_joints]].max(axis=1), JUMP_DEG) | _jumps(speeds, JUMP_M_S)
    first, last = _reference_poses(clip, info)
    if not (first[0] or last[0] or jumps.any() or (angles > JUMP_DEG).any()):
        return StrayFrames(0, n_frames)
    before, shown_before = _stray_at_start(clip, jumps, *first)
    after, shown_after = _stray_at_start(at_frames(clip, slice(None, None, -1)), jumps[::-1], *last)
    start, stop = before, n_frames - after
    if before + after and stop - start < 2:
        shown = shown_before or shown_after
        return StrayFrames(0, n_frames, (f"hardly a frame is left without {shown}: none is left out of splices",))
    lines = [
        f"{_numbers(*frames)}: {shown} that does not belong to the motion; left out of splices"
        for frames, shown in (((0, start), shown_before), ((stop, n_frames), shown_after))
        if shown
    ]
    return StrayFrames(start, stop, (*lines, *_jump_warnings(clip, jumps, angles, speeds, start, stop)))


def _numbers(start: int, stop: int) -> str:
    return f"frame {start}" if stop - start == 1 else f"frames {start} to {stop - 1}"


def _steps(clip: Clip, info: RigInfo) -> tuple[FloatArray, FloatArray]:
    """From frame to frame, how far each joint turns (T - 1, J), degrees, and how fast the fastest of hands and root
    moves (T - 1,), m/s.
    """
    cosines = np.abs(np.einsum("tjc,tjc->tj", clip.local_rotations[:-1], clip.local_rotations[1:]))
    angles = 2.0 * np.rad2deg(np.arccos(np.minimum(cosines, 1.0)))
    hands = [info.roles.joints[role] for role in ("leftHand", "rightHand") if role in info.roles.joints]
    positions = kinematics.forward(clip, [0, *hands])[1]
    speeds = np.linalg.norm(np.diff(positions, axis=0), axis=-1).max(axis=1, initial=0.0)
    return angles, speeds * info.sizes.unit.metres * clip.fps


def _body_joints(skeleton: Skeleton) -> list[int]:
    """All joints but those below a hand."""
    roles = rig_info(skeleton).roles.joints
    hands = {roles.get(f"{side}Hand") for side in SIDES}
    below: set[int] = set()
    for joint, parent in enumerate(skeleton.parents.tolist()):
        if parent in hands or parent in below:
            below.add(joint)
    return [joint for joint in range(len(skeleton)) if joint not in below]


def _jumps(steps: FloatArray, least: float) -> Mask:
    """Which steps (T - 1,) are jumps."""
    if len(steps) < 3 or not (steps > least).any():
        return np.zeros(len(steps), bool)
    windows = sliding_window_view(np.pad(steps, 2, "reflect"), 5)
    return np.asarray((steps > least) & (steps > _ABOVE_NEIGHBOURS * np.median(windows[:, [0, 1, 3, 4]], axis=1)))


def _stray_at_start(clip: Clip, jumps: Mask, shown: str, is_exact: bool) -> tuple[int, str]:
    """How many frames at the beginning do not belong, and what they show; 0 and nothing where all belong. The first
    frame shows the reference pose ``shown``, empty for none.
    """
    n_stray = _n_until_out(clip) if shown else 0
    if not is_exact and not jumps[:n_stray].any():
        n_stray, shown = 0, ""
    reach = n_stray + int(min(_END_S * clip.fps, _END_FRACTION * (len(clip) - n_stray)))
    steps = [n_stray + int(step) for step in np.flatnonzero(jumps[n_stray:reach])]
    apart = [step for step in steps if not _is_spike(clip, jumps, step)]
    if apart:
        n_stray, shown = apart[-1] + 1, shown or "what is apart by a jump"
    return n_stray, shown


def _is_spike(clip: Clip, jumps: Mask, step: int) -> bool:
    """Whether the motion goes on behind a few wrong frames: of the jump at ``step`` and one of those within half a
    second, one leads away and the other back.
    """
    fps, metres = clip.fps, rig_info(clip.skeleton).sizes.unit.metres
    near = np.flatnonzero(jumps[: step + int(_END_S * fps) + 1])
    for other in near[(near != step) & (near >= step - int(_END_S * fps))]:
        first, last = min(step, other), max(step, other) + 1  # the frames around the wrong ones
        body = clip.skeleton.derived[_body_joints]
        turned = rotation.angle_between(clip.local_rotations[first, body], clip.local_rotations[last, body]).max()
        moved = metres * np.linalg.norm(clip.root_positions[last] - clip.root_positions[first])
        if np.rad2deg(turned) < JUMP_DEG and moved < JUMP_M_S / fps:
            return True
    return False


# --- reference poses ---


def _reference_poses(clip: Clip, info: RigInfo) -> list[tuple[str, bool]]:
    """Which reference poses the first and the last frame show, and whether exactly; empty where one shows none or the
    rig's arms are not known.
    """
    if not info.has_arms:
        return [("", False)] * 2
    ends = at_frames(clip, np.array([0, -1]))
    frames = zip(_bone_directions(ends), ends.local_rotations, strict=True)
    return [_reference_pose(clip.skeleton, bones, local) for bones, local in frames]


def _reference_pose(skeleton: Skeleton, bones: FloatArray, local_rotations: FloatArray) -> tuple[str, bool]:
    """The reference pose of one frame with these bones (2, 15, 3) and local rotations (J, 4), and whether exactly."""
    lowered = _arm_depression_deg(bones)
    if not -_T_DEG <= lowered <= _A_DEG:
        return "", False
    if _is_straight(bones, *_NEAR_DEG):
        return "a T-pose" if lowered <= _T_DEG else "an A-pose", _is_straight(bones, *_EXACT_DEG)
    return ("the file's rest pose", True) if _is_rest_pose(skeleton, local_rotations) else ("", False)


def _is_rest_pose(skeleton: Skeleton, local_rotations: FloatArray) -> bool:
    """Whether all arm joints are as in the file's rest pose, by their local rotations (J, 4)."""
    canonical = rig_info(skeleton).canonical
    sides = np.r_[canonical.joints[LEFT], canonical.joints[RIGHT]]
    local = local_rotations[sides[sides >= 0]]
    return bool(np.rad2deg(rotation.angle_between(local, rotation.IDENTITY)).max() <= _REST_DEG)


def _bone_directions(clip: Clip) -> FloatArray:
    """Directions (T, 2, 15, 3) of upper arm, forearm and hand and of the twelve bones of four fingers, left then right,
    in the axes of the chest; those of the right arm in the mirror.
    """
    quats = canonical_motion(clip).quats  # identity in the T-pose, where all these bones point to the side
    sides = np.stack([quats[:, LEFT], quats[:, RIGHT]], axis=1)  # (T, 2, 19, 4): collar bone, arm, fingers by threes
    chain = sides[:, :, 0]
    rotations = []
    for joint in (1, 2, 3):
        chain = rotation.multiply(chain, sides[:, :, joint])
        rotations.append(chain[:, :, None])
    fingers = sides[:, :, 4:].reshape(len(quats), 2, len(FINGERS), 3, 4)[:, :, 1:]  # all but the thumb
    chain = chain[:, :, None]
    for segment in range(3):
        chain = rotation.multiply(chain, fingers[:, :, :, segment])
        rotations.append(chain)
    outwards = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])[:, None]
    return np.asarray(rotation.rotate(np.concatenate(rotations, axis=2), outwards) * [[[1.0, 1, 1]], [[-1.0, 1, 1]]])


def _arm_depression_deg(bones: FloatArray) -> float:
    """How far below the horizontal the arms of bones (2, 15, 3) point, degrees: the mean of both."""
    return float(np.rad2deg(np.arcsin(np.clip(-bones[:, :2, 1].mean(), -1.0, 1.0))))


def _is_straight(bones: FloatArray, arm_deg: float, finger_deg: float) -> bool:
    """Whether both arms of bones (2, 15, 3) are straight, in the frontal plane, equally low, and fingers straight."""
    lowered = np.deg2rad(_arm_depression_deg(bones))
    mean = np.array([np.cos(lowered), -np.sin(lowered), 0.0])
    cosines = bones @ mean
    fingers = np.einsum("skc,sc->sk", bones[:, 2:], bones[:, 1])
    return bool(cosines[:, :2].min() > np.cos(np.deg2rad(arm_deg)) and fingers.min() > np.cos(np.deg2rad(finger_deg)))


def _n_until_out(clip: Clip) -> int:
    """How many frames pass until the arms are out of the reference pose that the first frame shows: those that show it
    too, and the way until it ends or slows down. All where they stay.
    """
    bones = _bone_directions(clip)
    arms = bones[:, :, :2]
    away = np.rad2deg(np.arccos(np.clip(np.einsum("tskc,skc->tsk", arms, arms[0]), -1.0, 1.0))).max(axis=(1, 2))
    out = np.flatnonzero(away > _NEAR_DEG[0])
    if not len(out):
        return len(clip)
    last = int(out[0]) - 1  # the last frame in the pose
    rates = np.diff(away)[last : last + max(1, math.ceil(_WAY_S * clip.fps))]
    fastest = np.maximum.accumulate(rates)
    slow = np.flatnonzero(rates < 0.5 * fastest)
    at = int(slow[0]) if len(slow) else len(rates)
    while at < len(rates) and 0.1 * fastest[at] < rates[at] < rates[at - 1]:  # a way that slows down gently
        at += 1
    return last + at


# --- warnings ---


def _jump_warnings(clip: Clip, jumps: Mask, angles: FloatArray, speeds: FloatArray, start: int, stop: int) -> list[str]:
    """A line about each of the first jumps between frames that belong."""
    lines = []
    steps = [step for step in np.flatnonzero(jumps | (angles.max(axis=1) > JUMP_DEG)) if start <= step < stop - 1]
    for step in steps[:_MOST_LINES]:
        joint = int(angles[step].argmax())
        turned = angles[step, joint] > JUMP_DEG
        what = (
            f"{clip.skeleton.names[joint]} turns by {angles[step, joint]:.0f} degrees"
            if turned
            else f"a hand or the root moves at {speeds[step]:.1f} m/s"
        )
        lines.append(f"{what} from frame {step} to {step + 1}: a fault of the capture?")
    if len(steps) > _MOST_LINES:
        lines.append(f"{len(steps) - _MOST_LINES} more such jumps")
    return lines


_RAISED, _BEHIND = 0.4, 0.15
"""Height of a wrist (``Arms.lift``) from which on it signs, and how far behind the shoulders, in arm lengths, it is in
half of such frames where left and right are exchanged: no sign is made at one's back.
"""
_NAMED = 12
"""Most names in a warning."""


def inspect(clip: Clip, file: str = "") -> dict[str, Any]:
    """Facts about a clip, ready for JSON: rig, roles, rate, frames, unit, axes, keyedness, rest and warnings."""
    skeleton = clip.skeleton
    info = rig_info(skeleton)
    humanoid, unit = info.roles, info.sizes.unit
    stands = placement(clip)
    try:
        rest = [f"frames {a} to {b - 1}" for a, b in _rest_spans(clip, stray_frames(clip), arms(clip)) if b > a]
    except InputError:
        rest = []
    return {
        "file": file or clip.name,
        "rig": humanoid.rig,
        "joints": len(skeleton),
        "end sites": len(skeleton.end_sites),
        "frames": len(clip),
        "fps": clip.fps,
        "seconds": round(clip.seconds, 3),
        "unit": unit.name,
        "stature m": round(unit.stature_m, 3),
        "up": _axis(stands.up),
        "forward": _axis(stands.forward),
        "face": "none" if clip.face is None else f"{len(clip.face.channels)} coefficients",
        "motion": explain_keyedness(with_ends_held(clip)).reason,
        "memory kB": clip.nbytes // 1024,
        "rest": rest,
        "roles": {role: skeleton.names[joint] for role, joint in humanoid.joints.items()},
        "warnings": list(clip_warnings(clip)),
    }


def clip_warnings(clip: Clip) -> tuple[str, ...]:
    """What a user should know about a clip before it is spliced, one line each, without its name; kept as long as the
    clip lives. Raises ``InputError`` where the skeleton's own roles do not fit it.
    """
    return clip.derived[_clip_warnings]


def _clip_warnings(clip: Clip) -> tuple[str, ...]:
    rested = with_rest_pose(clip)
    left_out = [line.removeprefix(f"{clip.name}: ") for line in left_out_warnings(clip)]
    stray = stray_frames(rested)
    lines = [
        *_arm_warnings(rested, stray),
        *left_out,
        *_motion_warnings(rested),
        *stray.warnings,
        *_rig_warnings(rested),
    ]
    return tuple(dict.fromkeys(lines))


def _axis(direction: np.ndarray[Any, np.dtype[np.float64]]) -> str:
    axis = int(np.argmax(np.abs(direction)))
    return ("-" if direction[axis] < 0 else "+") + "XYZ"[axis]


def _rest_spans(clip: Clip, stray: StrayFrames, seen: Arms) -> list[tuple[int, int]]:
    """The frames [start, stop) of rest before and after the sign, by what belongs to the motion and the arms."""
    if stray.stop - stray.start < len(seen.wrists):
        seen = arms(clip[stray.start : stray.stop])
    start, stop = (stray.start + frame for frame in active_span(seen))
    return [(stray.start, start), (stop, stray.stop)]


def _arm_warnings(clip: Clip, stray: StrayFrames) -> list[str]:
    """Arms that are not known, that never rest, or that sign behind the body."""
    try:
        seen = arms(clip)
    except InputError as error:
        return [str(error)]
    is_raised, lines = seen.lift > _RAISED, []
    spans = _rest_spans(clip, stray, seen)
    if all(a == b for a, b in spans):
        lines.append("no rest found at either end: the arms neither rise at the start nor sink at the end")
    ahead = (seen.wrists - seen.shoulders.mean(axis=1, keepdims=True)) @ placement(clip).forward / seen.length
    signing = ahead[is_raised]
    if len(signing) and np.median(signing) < -_BEHIND:
        lines.append("the hands sign behind the body: left and right are exchanged, or the rig is mirrored")
    return lines


def _motion_warnings(clip: Clip) -> list[str]:
    """Clips that do not move."""
    before, after = clip.local_rotations[:-1], clip.local_rotations[1:]
    if not len(after):
        return ["a single frame: it has no velocity, so transitions into and out of it start from rest"]
    turns = np.abs(np.einsum("tjc,tjc->tj", before, after)).min() < 0.999  # quicker than the angles of them all
    is_still = not turns and np.rad2deg(rotation.angle_between(before, after)).max() < 0.01
    return ["nothing turns: every frame is the same pose"] if is_still else []


def _rig_warnings(clip: Clip) -> list[str]:
    """Roles, sizes, rest poses and bones that may not be what they are taken for."""
    info, lines = rig_info(clip.skeleton), []
    unit = info.sizes.unit
    if not info.roles.joints:
        lines.append("no role was found by the joints' names; a roles file names them")
    if unit.name == "unknown":
        lines.append(f"no unit makes the body a person's: it is taken for one of {unit.stature_m:.2f} m")
    elif not 1.2 <= unit.stature_m <= 2.3:
        lines.append(f"the body would be {unit.stature_m:.2f} m tall in {unit.name}: the unit may be another")
    if not rests_as_person(clip.skeleton):
        if clip.skeleton.rest_pose is None:
            lines.append("neither its zero pose nor any frame shows a person: its rest pose is not known")
        else:
            frame = rest_frame(clip)
            shown = "a frame of another clip" if frame is None else f"frame {frame}"
            lines.append(f"the zero pose shows no person: {shown} is taken as rest pose; rest_frame names another")
    if clip.translations is not None:
        lines.append("bone lengths change over time; transitions interpolate them")
    return lines


def left_out_warnings(clip: Clip) -> tuple[str, ...]:
    """Lines about what a clip's file holds and the clip does not, or otherwise; none where there is nothing."""
    lines = list(clip.notes)
    if clip.left_out:
        some, n_more = clip.left_out[:_NAMED], len(clip.left_out) - _NAMED
        more = f" and {n_more} more" if n_more > 0 else ""
        lines.insert(0, f"{', '.join(some)}{more} left out: a clip holds the motion of joints and faces")
    return tuple(f"{clip.name}: {line}" for line in lines)
