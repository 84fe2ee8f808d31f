"""What a page needs to fit a clip to an avatar by itself: the signer's body, and when each arm signs.

The motion is in the clip's ``.vrma``. Both use the humanoid at rest in the T-pose, with axes parallel to the world's.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from signsplice.body.capsules import BodyCapsules, body_capsules
from signsplice.body.retarget import signing
from signsplice.motion import kinematics, rotation
from signsplice.motion.clip import Clip, Skeleton
from signsplice.rig.info import rig_info

_ARM_REGIONS = {"sleeve": "upperArm", "cuff": "lowerArm"}


def fit_source(clip: Clip) -> dict[str, Any] | None:
    """The clip's signer as ``wire.FitSource``, JSON-ready; None where both arms are not known by name."""
    if not rig_info(clip.skeleton).has_arms:
        return None
    return {"capsules": _capsules(clip.skeleton), "signing": np.round(signing(clip), 3).tolist()}


def _capsules(skeleton: Skeleton) -> list[dict[str, Any]]:
    """The capsules of head, trunk, arms and hands as ``wire.FitCapsule``."""
    info, body = rig_info(skeleton), body_capsules(skeleton)
    metres, rest, role_of = info.sizes.unit.metres, info.t_pose, info.roles.role_of
    regions, found = _regions(body), []
    for row, region in sorted(regions.items()):
        joint = int(body.joints[row])
        bone = next((k for k in kinematics.path_to_root(skeleton, joint) if k in role_of), info.roles.joints["hips"])
        ends = rotation.rotate(rest.rotations[joint], np.stack([body.starts[row], body.ends[row]]))
        start, end = np.round(metres * (ends + rest.positions[joint] - rest.positions[bone]), 6).tolist()
        found.append({
            "key": body.keys[row], "bone": role_of[bone], "region": region, "side": body.sides[row],
            "start": start, "end": end, "radii": np.round(metres * body.radii[row], 6).tolist(),
        })  # fmt: skip
    return found


def _regions(body: BodyCapsules) -> dict[int, str]:
    """Row of a capsule -> the part of the body that it is of, for those that hands may touch."""
    groups = body.groups
    regions = dict.fromkeys(groups.head, "head") | dict.fromkeys(groups.trunk, "trunk")
    regions |= dict.fromkeys((*groups.left, *groups.right), "hand")
    arms = {row: _ARM_REGIONS[part] for row, part in enumerate(body.parts) if part in _ARM_REGIONS}
    return regions | arms
