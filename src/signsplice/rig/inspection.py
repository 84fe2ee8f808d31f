"""Facts about a clip before it is spliced: rig, unit, rest spans, and warnings."""

from __future__ import annotations

from typing import Any

import numpy as np

from signsplice.errors import InputError
from signsplice.motion import rotation
from signsplice.motion.clip import Clip, left_out_warnings
from signsplice.rig.arms import active_span, arms
from signsplice.rig.info import rig_info
from signsplice.rig.placement import placement
from signsplice.rig.proportions import LengthUnit
from signsplice.rig.stray_frames import stray_frames


def inspect(clip: Clip, file: str = "") -> dict[str, Any]:
    """Facts about a clip, ready for JSON: rig, roles, rate, frames, unit, axes, rest spans and warnings."""
    skeleton = clip.skeleton
    info = rig_info(skeleton)
    humanoid, unit = info.roles, info.sizes.unit
    stands = placement(clip)
    warnings: list[str] = []
    facts: dict[str, Any] = {
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
        "memory kB": clip.nbytes // 1024,
    }
    try:
        stray = stray_frames(clip)
        start, stop = (stray.start + frame for frame in active_span(arms(clip[stray.start : stray.stop])))
        spans = [(stray.start, start), (stop, stray.stop)]
        facts["rest"] = [f"frames {a} to {b - 1}" for a, b in spans if b > a]
        if all(a == b for a, b in spans):
            warnings.append("no rest found at either end: the arms neither rise at the start nor sink at the end")
    except InputError as error:
        facts["rest"] = []
        warnings.append(str(error))
    facts["roles"] = {role: skeleton.names[joint] for role, joint in humanoid.joints.items()}
    warnings += left_out_warnings(clip)
    facts["warnings"] = warnings + _motion_warnings(clip) + _rig_warnings(clip, len(humanoid.joints), unit)
    return facts


def _axis(direction: np.ndarray[Any, np.dtype[np.float64]]) -> str:
    axis = int(np.argmax(np.abs(direction)))
    return ("-" if direction[axis] < 0 else "+") + "XYZ"[axis]


def _motion_warnings(clip: Clip) -> list[str]:
    """Clips that do not move, frames that do not belong, and steps too wide for a body."""
    if len(clip) < 2:
        single = "a single frame: it has no velocity, so transitions into and out of it start from rest"
        return [single, *stray_frames(clip).warnings]
    steps = np.rad2deg(rotation.angle_between(clip.local_rotations[:-1], clip.local_rotations[1:]))
    still = ["nothing turns: every frame is the same pose"] if steps.max() < 0.01 else []
    return [*still, *stray_frames(clip).warnings]


def _rig_warnings(clip: Clip, n_roles: int, unit: LengthUnit) -> list[str]:
    warnings = []
    if n_roles == 0:
        warnings.append("no role was found by the joints' names; a roles file names them")
    if not 1.2 <= unit.stature_m <= 2.3:
        warnings.append(f"the body would be {unit.stature_m:.2f} m tall in {unit.name}: the unit may be another")
    if clip.translations is not None:
        warnings.append("bone lengths change over time; transitions interpolate them")
    return warnings
