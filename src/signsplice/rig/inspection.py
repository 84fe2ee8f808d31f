"""Inspects a clip before splicing: facts, warnings, and stray frames at its ends that do not belong to its motion.

Stray frames are reference poses and frames beyond a jump. Exporters and capture systems put the bind or calibration
pose of a rig before or after a take; a word that begins so would bring that pose into the middle of a sentence. Poses
are judged by the directions of arm bones and fingers seen from the chest, independently of the rest pose. Arms are
spread in many signs: a reference pose counts only at the beginning or end of a clip, with arms, hands and fingers
straight.

"""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from signsplice.errors import InputError
from signsplice.motion import Clip, FloatArray, Skeleton, at_frames, copy_unchecked, kinematics, rotation
from signsplice.rig.align import list_names, placement
from signsplice.rig.info import LEFT, RIGHT, Arms, RigInfo, active_span, arms, canonical_motion, rig_info
from signsplice.rig.keyedness import explain_keyedness
from signsplice.rig.rest_pose import rest_frame, rests_as_person, with_rest_pose
from signsplice.rig.roles import FINGERS, SIDES, body_parts, find_lost_roles

Mask = NDArray[np.bool_]

JUMP_DEG = 60.0
"""Rotation of a joint in one frame above which it jumps, degrees. Jumps of fingers are named, but leave out no frames:
if a capture loses fingers, they flip in otherwise correct motion.
"""
JUMP_M_S = 4.0
"""Speed above which a hand or the root jumps, m/s; shipped words reach 3."""


@dataclass(frozen=True)
class StrayLimits:
    """Limits by which frames at the ends of clips are stray."""

    jump_ratio: float = 3.0
    """Least ratio of a jump to the median of the two steps before and two after it: fast motion speeds up gradually."""
    end_s: float = 0.5
    """Longest part beyond a jump that is left out, seconds."""
    end_fraction: float = 1.0 / 3.0
    """Largest part beyond a jump that is left out, as a fraction of the clip."""
    arm_deg: float = 12.0
    """Largest angle of arm bones to one direction in the frontal plane, equally low on both sides, in a reference pose
    followed by a jump, degrees; arms leave a reference pose by a larger turn.
    """
    finger_deg: float = 20.0
    """Largest angle of hand and fingers to the forearm in such a pose, degrees."""
    exact_arm_deg: float = 5.0
    """Largest angle of arm bones in a reference pose without a jump, degrees."""
    exact_finger_deg: float = 8.0
    """The same of hand and fingers: nobody holds both arms and all fingers that straight."""
    t_pose_deg: float = 15.0
    """Largest angle of straight arms above or below the horizontal in a T-pose, degrees."""
    a_pose_deg: float = 60.0
    """Largest angle of straight arms below the horizontal in an A-pose, degrees; arms beyond it hang."""
    rest_pose_deg: float = 0.5
    """Largest angle of arm joints from the file's rest pose in a frame that shows it, degrees."""
    pose_exit_s: float = 1.0
    """Longest movement out of a reference pose that is left out with it, seconds."""


_STRAY = StrayLimits()


@dataclass(frozen=True)
class WarningLimits:
    """Limits of warnings about clips."""

    jump_lines: int = 5
    """Largest number of lines about jumps."""
    names: int = 12
    """Largest number of names in a warning."""
    raised_lift: float = 0.4
    """Height of a wrist above which it signs, arm lengths above a hanging one (``Arms.lift``)."""
    distance_behind: float = 0.15
    """Median distance of signing wrists behind the shoulders above which left and right are exchanged, arm lengths."""


_WARNINGS = WarningLimits()


@dataclass(frozen=True)
class MotionSpan:
    """The frames of a clip that belong to its motion, without stray frames at its ends.

    start, stop: frames [start, stop) belong to it; splices leave the others out.
    warnings: about frames left out, and about jumps between the others; one line each, frames as in the clip.
    """

    start: int
    stop: int
    warnings: tuple[str, ...] = ()

    def resample_span(self, step: float, n_frames: int) -> slice:
        """Returns the frames that belong, in the clip resampled to ``n_frames`` at intervals of ``step`` frames."""
        first = min(math.ceil(self.start / step - 1e-9), n_frames - 1)
        return slice(first, max(first + 1, min(math.floor((self.stop - 1) / step + 1e-9) + 1, n_frames)))


def motion_span(clip: Clip) -> MotionSpan:
    """Returns the frames of a clip that belong to its motion; computed once for each clip.

    Stray frames at either end are those of a T-pose, an A-pose or the file's own rest pose with raised arms, with the
    movement out of it; and up to half a second beyond a jump (``JUMP_DEG``, ``JUMP_M_S``), unless that is a spike of a
    few wrong frames. All frames are kept if fewer than two would remain.
    """
    return clip.derived[find_motion_span]


def with_ends_held(clip: Clip) -> Clip:
    """Replaces stray frames by the first or last frame that belongs, so that frames keep their numbers; returns the
    clip itself if all belong. Computed once for each clip.
    """
    motion = motion_span(clip)
    is_whole = motion.stop - motion.start == len(clip.local_rotations)
    return clip if is_whole else clip.derived[_with_ends_held]


def _with_ends_held(clip: Clip) -> Clip:
    motion = motion_span(clip)
    frames = np.clip(np.arange(len(clip)), motion.start, motion.stop - 1)
    return copy_unchecked(at_frames(clip, frames), channels=clip.channels)


def find_motion_span(clip: Clip) -> MotionSpan:
    """Finds the frames that belong to a clip's motion, for ``motion_span``."""
    info = rig_info(clip.skeleton)
    angles, speeds = _steps(clip, info)
    n_frames = len(angles) + 1
    jumps = _jumps(angles[:, clip.skeleton.derived[_body_joints]].max(axis=1), JUMP_DEG) | _jumps(speeds, JUMP_M_S)
    first, last = _reference_poses(clip, info)
    if not (first[0] or last[0] or jumps.any() or (angles > JUMP_DEG).any()):
        return MotionSpan(0, n_frames)
    before, shown_before = _stray_at_start(clip, jumps, *first)
    after, shown_after = _stray_at_start(at_frames(clip, slice(None, None, -1)), jumps[::-1], *last)
    start, stop = before, n_frames - after
    if before + after and stop - start < 2:
        shown = shown_before or shown_after
        return MotionSpan(0, n_frames, (f"hardly a frame is left without {shown}: none is left out of splices",))
    lines = [
        f"{_numbers(*frames)}: {shown} that does not belong to the motion; left out of splices"
        for frames, shown in (((0, start), shown_before), ((stop, n_frames), shown_after))
        if shown
    ]
    return MotionSpan(start, stop, (*lines, *_jump_warnings(clip, jumps, angles, speeds, start, stop)))


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
    return np.asarray((steps > least) & (steps > _STRAY.jump_ratio * np.median(windows[:, [0, 1, 3, 4]], axis=1)))


def _stray_at_start(clip: Clip, jumps: Mask, shown: str, is_exact: bool) -> tuple[int, str]:
    """Returns the number of stray frames at the beginning, and a description of them; 0 and "" if all belong. The first
    frame shows the reference pose ``shown``, empty for none.
    """
    n_stray = _n_until_out(clip) if shown else 0
    if not is_exact and not jumps[:n_stray].any():
        n_stray, shown = 0, ""
    reach = n_stray + int(min(_STRAY.end_s * clip.fps, _STRAY.end_fraction * (len(clip) - n_stray)))
    steps = [n_stray + int(step) for step in np.flatnonzero(jumps[n_stray:reach])]
    breaks = [step for step in steps if not _is_spike(clip, jumps, step)]
    if breaks:
        n_stray, shown = breaks[-1] + 1, shown or "what is apart by a jump"
    return n_stray, shown


def _is_spike(clip: Clip, jumps: Mask, step: int) -> bool:
    """Whether the motion continues after a few wrong frames: the jump at ``step`` and another within half a second lead
    away and back.
    """
    fps, metres = clip.fps, rig_info(clip.skeleton).sizes.unit.metres
    close_steps = np.flatnonzero(jumps[: step + int(_STRAY.end_s * fps) + 1])
    for other_step in close_steps[(close_steps != step) & (close_steps >= step - int(_STRAY.end_s * fps))]:
        first, last = min(step, other_step), max(step, other_step) + 1  # the frames around the wrong ones
        body = clip.skeleton.derived[_body_joints]
        turned = rotation.angle_between(clip.local_rotations[first, body], clip.local_rotations[last, body]).max()
        moved = metres * np.linalg.norm(clip.root_positions[last] - clip.root_positions[first])
        if np.rad2deg(turned) < JUMP_DEG and moved < JUMP_M_S / fps:
            return True
    return False


# --- reference poses ---


def _reference_poses(clip: Clip, info: RigInfo) -> list[tuple[str, bool]]:
    """Which reference poses the first and the last frame show, and whether exactly; empty if one shows none or the
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
    if not -_STRAY.t_pose_deg <= lowered <= _STRAY.a_pose_deg:
        return "", False
    if _is_straight(bones, _STRAY.arm_deg, _STRAY.finger_deg):
        is_exact = _is_straight(bones, _STRAY.exact_arm_deg, _STRAY.exact_finger_deg)
        return "a T-pose" if lowered <= _STRAY.t_pose_deg else "an A-pose", is_exact
    return ("the file's rest pose", True) if _is_rest_pose(skeleton, local_rotations) else ("", False)


def _is_rest_pose(skeleton: Skeleton, local_rotations: FloatArray) -> bool:
    """Whether all arm joints are as in the file's rest pose, by their local rotations (J, 4)."""
    canonical = rig_info(skeleton).canonical
    joints = np.r_[canonical.joints[LEFT], canonical.joints[RIGHT]]  # -1 for those that the rig lacks
    local = local_rotations[joints[joints >= 0]]
    return bool(np.rad2deg(rotation.angle_between(local, rotation.IDENTITY)).max() <= _STRAY.rest_pose_deg)


def _bone_directions(clip: Clip) -> FloatArray:
    """Directions (T, 2, 15, 3) of upper arm, forearm and hand and of the twelve bones of four fingers, left then right,
    in the axes of the chest; those of the right arm in the mirror.
    """
    quats = canonical_motion(clip).quats  # identity in the T-pose, in which all these bones point to the side
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
    """Returns the number of frames until the arms have left the reference pose of the first frame: the frames in the
    pose, and the movement until it ends or slows down. All frames if the arms stay.
    """
    bones = _bone_directions(clip)
    arm_bones = bones[:, :, :2]
    cosines = np.einsum("tskc,skc->tsk", arm_bones, arm_bones[0])
    angles = np.rad2deg(np.arccos(np.clip(cosines, -1.0, 1.0))).max(axis=(1, 2))
    outside = np.flatnonzero(angles > _STRAY.arm_deg)
    if not len(outside):
        return len(clip)
    last = int(outside[0]) - 1  # the last frame in the pose
    rates = np.diff(angles)[last : last + max(1, math.ceil(_STRAY.pose_exit_s * clip.fps))]
    fastest = np.maximum.accumulate(rates)
    slow = np.flatnonzero(rates < 0.5 * fastest)
    end = int(slow[0]) if len(slow) else len(rates)
    while end < len(rates) and 0.1 * fastest[end] < rates[end] < rates[end - 1]:  # the movement slows down gently
        end += 1
    return last + end


# --- warnings ---


def _jump_warnings(clip: Clip, jumps: Mask, angles: FloatArray, speeds: FloatArray, start: int, stop: int) -> list[str]:
    """A line about each of the first jumps between frames that belong."""
    lines = []
    steps = [step for step in np.flatnonzero(jumps | (angles.max(axis=1) > JUMP_DEG)) if start <= step < stop - 1]
    for step in steps[: _WARNINGS.jump_lines]:
        joint = int(angles[step].argmax())
        turned = angles[step, joint] > JUMP_DEG
        what = (
            f"{clip.skeleton.names[joint]} turns by {angles[step, joint]:.0f} degrees"
            if turned
            else f"a hand or the root moves at {speeds[step]:.1f} m/s"
        )
        lines.append(f"{what} from frame {step} to {step + 1}: a fault of the capture?")
    if len(steps) > _WARNINGS.jump_lines:
        lines.append(f"{len(steps) - _WARNINGS.jump_lines} more such jumps")
    return lines


def inspect(clip: Clip, file: str = "") -> dict[str, Any]:
    """Returns a clip's facts, ready for JSON: rig, roles, rate, frames, unit, axes, keyedness, rest, what is assumed of
    its file, and warnings.
    """
    skeleton = clip.skeleton
    info = rig_info(skeleton)
    humanoid, unit = info.roles, info.sizes.unit
    stands = placement(clip)
    try:
        rest = [f"frames {a} to {b - 1}" for a, b in _rest_spans(clip, motion_span(clip), arms(clip)) if b > a]
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
        "assumed": _assumptions(clip),
        "roles": {role: skeleton.names[joint] for role, joint in humanoid.joints.items()},
        "warnings": list(clip_warnings(clip)),
    }


def _assumptions(clip: Clip) -> list[str]:
    """Returns what is taken for true of a clip though files say it wrongly or not at all, and how to say it."""
    info, skeleton = rig_info(clip.skeleton), clip.skeleton
    unit, rig = info.sizes.unit, info.roles.rig
    frame = rest_frame(clip) if skeleton.rest_pose is not None else None
    if skeleton.rest_pose is None:
        rest = "all rotations zero"
    else:
        rest = "given" if frame is None else f"frame {frame}, the first that shows a person (--rest-frame)"
    return [
        f"recorded at {clip.fps:.6g} frames a second (--input-fps)",
        f"lengths in {unit.name}: the person is {unit.stature_m:.2f} m tall",
        f"rest pose: {rest}",
        "roles as given" if skeleton.roles is not None else f"roles by the joint names of rigs of kind {rig} (--roles)",
        "up and forward by hips, head and shoulders",
    ]


def clip_warnings(clip: Clip) -> tuple[str, ...]:
    """Returns warnings about a clip before splicing, one line each, without its name; computed once for each clip.
    Raises ``InputError`` if the skeleton's own roles do not fit it.
    """
    return clip.derived[list_clip_warnings]


def list_clip_warnings(clip: Clip) -> tuple[str, ...]:
    """Lists what is doubtful in a clip, for ``clip_warnings``."""
    rested = with_rest_pose(clip)
    left_out = [line.removeprefix(f"{clip.name}: ") for line in left_out_warnings(clip)]
    motion = motion_span(rested)
    lines = [
        *_arm_warnings(rested, motion),
        *left_out,
        *_motion_warnings(rested),
        *motion.warnings,
        *_rig_warnings(rested),
    ]
    return tuple(dict.fromkeys(lines))


def _axis(direction: np.ndarray[Any, np.dtype[np.float64]]) -> str:
    axis = int(np.argmax(np.abs(direction)))
    return ("-" if direction[axis] < 0 else "+") + "XYZ"[axis]


def _rest_spans(clip: Clip, motion: MotionSpan, seen: Arms) -> list[tuple[int, int]]:
    """The frames [start, stop) of rest before and after the sign, within those of the motion; empty without rest."""
    if motion.stop - motion.start < len(seen.wrists):
        seen = arms(clip[motion.start : motion.stop])
    start, stop = (motion.start + frame for frame in active_span(seen))
    return [(motion.start, start), (stop, motion.stop)]


def _arm_warnings(clip: Clip, motion: MotionSpan) -> list[str]:
    """Warnings of arms that are not known, that rest at neither end, or that sign behind the body."""
    try:
        seen = arms(clip)
    except InputError as error:
        return [str(error)]
    is_raised, lines = seen.lift > _WARNINGS.raised_lift, []
    spans = _rest_spans(clip, motion, seen)
    if all(a == b for a, b in spans):
        lines.append("no rest found at either end: the arms neither rise at the start nor sink at the end")
    ahead = (seen.wrists - seen.shoulders.mean(axis=1, keepdims=True)) @ placement(clip).forward / seen.length
    signing = ahead[is_raised]
    if len(signing) and np.median(signing) < -_WARNINGS.distance_behind:
        lines.append("the hands sign behind the body: left and right are exchanged, or the rig is mirrored")
    return lines


def _motion_warnings(clip: Clip) -> list[str]:
    """A warning of a clip that does not move."""
    before, after = clip.local_rotations[:-1], clip.local_rotations[1:]
    if not len(after):
        return ["a single frame: it has no velocity, so transitions into and out of it start from rest"]
    turns = np.abs(np.einsum("tjc,tjc->tj", before, after)).min() < 0.999  # quicker than the angles of them all
    is_still = not turns and np.rad2deg(rotation.angle_between(before, after)).max() < 0.01
    return ["nothing turns: every frame is the same pose"] if is_still else []


def _rig_warnings(clip: Clip) -> list[str]:
    """Warnings of roles, sizes, rest poses and bones that may not be what they are taken for."""
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


def role_warnings(skeletons: Mapping[str, Skeleton]) -> list[str]:
    """Returns lines about the words of a collection that lack parts of the body which others of it have; ``skeletons``:
    of each word by its name. Words without any role have a warning of their own, those whose roles do not fit an error.
    """
    if len({id(skeleton) for skeleton in skeletons.values()}) < 2:
        return []
    roles: dict[str, Mapping[str, int]] = {}
    for name, skeleton in skeletons.items():
        with suppress(InputError):
            roles[name] = rig_info(skeleton).roles.joints
    known = {role: joint for joints in roles.values() for role, joint in joints.items()}
    words: dict[str, list[str]] = {}
    for name in (name for name in roles if roles[name]):
        words.setdefault(", ".join(body_parts(find_lost_roles(known, roles[name], ()))), []).append(name)
    so = "in a sentence with others, that motion is lost or held"
    lines = ((parts, len(names), list_names(names, _WARNINGS.names)) for parts, names in words.items() if parts)
    return [f"no {parts} in {n} of {len(roles)} words: {shown}; {so}" for parts, n, shown in lines]


def left_out_warnings(clip: Clip) -> tuple[str, ...]:
    """Returns lines about content of a clip's file that the clip lacks or holds in another form."""
    lines = list(clip.notes)
    if clip.left_out:
        lines.insert(
            0, f"{list_names(clip.left_out, _WARNINGS.names)} left out: a clip holds the motion of joints and faces"
        )
    return tuple(f"{clip.name}: {line}" for line in lines)
