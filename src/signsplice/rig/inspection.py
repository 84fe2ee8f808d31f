"""Facts about a clip before it is spliced: rig, unit, rest spans, and warnings."""

from __future__ import annotations

from typing import Any

import numpy as np

from signsplice.errors import InputError
from signsplice.motion import rotation
from signsplice.motion.cache import CACHE
from signsplice.motion.clip import Clip
from signsplice.rig.arms import Arms, active_span, arms
from signsplice.rig.info import rig_info
from signsplice.rig.placement import placement
from signsplice.rig.rest_pose import rest_frame, rests_as_person, with_rest_pose
from signsplice.rig.stray_frames import StrayFrames, stray_frames

_RAISED, _BEHIND = 0.4, 0.15
"""Height of a wrist (``Arms.lift``) from which on it signs, and how far behind the shoulders, in arm lengths, it is in
half of such frames where left and right are exchanged: no sign is made at one's back.
"""
_NAMED = 12
"""Most names in a warning."""


def inspect(clip: Clip, file: str = "") -> dict[str, Any]:
    """Facts about a clip, ready for JSON: rig, roles, rate, frames, unit, axes, rest spans and warnings."""
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
        "memory kB": clip.nbytes // 1024,
        "rest": rest,
        "roles": {role: skeleton.names[joint] for role, joint in humanoid.joints.items()},
        "warnings": list(clip_warnings(clip)),
    }


def clip_warnings(clip: Clip) -> tuple[str, ...]:
    """What a user should know about a clip before it is spliced, one line each, without its name; kept as long as the
    clip lives. Raises ``InputError`` where the skeleton's own roles do not fit it.
    """
    return CACHE.of(clip, _clip_warnings)


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
    if stray.stop - stray.start < len(clip):
        seen = arms(clip[stray.start : stray.stop])
    start, stop = (stray.start + frame for frame in active_span(seen))
    return [(stray.start, start), (stop, stray.stop)]


def _arm_warnings(clip: Clip, stray: StrayFrames) -> list[str]:
    """Arms that are not known, that never rest, or that sign behind the body."""
    try:
        seen = arms(clip)
    except InputError as error:
        return [str(error)]
    spans = _rest_spans(clip, stray, seen)
    lines = []
    if all(a == b for a, b in spans):
        lines.append("no rest found at either end: the arms neither rise at the start nor sink at the end")
    ahead = (seen.wrists - seen.shoulders.mean(axis=1, keepdims=True)) @ placement(clip).forward / seen.length
    signing = ahead[seen.lift > _RAISED]
    if len(signing) and np.median(signing) < -_BEHIND:
        lines.append("the hands sign behind the body: left and right are exchanged, or the rig is mirrored")
    return lines


def _motion_warnings(clip: Clip) -> list[str]:
    """Clips that do not move."""
    if len(clip) < 2:
        return ["a single frame: it has no velocity, so transitions into and out of it start from rest"]
    before, after = clip.local_rotations[:-1], clip.local_rotations[1:]
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
