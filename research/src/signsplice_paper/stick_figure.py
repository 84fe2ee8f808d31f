"""How to draw the joints of a frame's numbers: bones, sides, hands and head of any rig, seen from the front.

It is made once from a word of the corpus and stored with the frames, so that pictures need no corpus.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from signsplice.motion import Clip, FloatArray, Skeleton
from signsplice.motion.kinematics import rest_positions
from signsplice.rig.align import placement
from signsplice.rig.info import rig_info
from signsplice.rig.roles import FINGERS

TRUNK, LEFT, RIGHT, HIDDEN = "trunk", "left", "right", "hidden"
SIDES = (RIGHT, LEFT)
_NEARLY = 0.98
"""Cosine of the angle, 11 degrees, within which a signer counts as facing along an axis."""
_HIDDEN_ROLES = ("UpperLeg", "LowerLeg", "Foot", "Toes", "Eye", "jaw")


@dataclass(frozen=True)
class StickFigure:
    """The joints of a frame's numbers, J of them.

    - parents: index of the joint above each, -1 for the first
    - parts: which part of the body each belongs to: trunk, left, right or hidden
    - fingers: whether each is of a finger
    - wrists: side -> the hand's joint, if the rig has one
    - knuckles: side -> the joint in the middle of the pictures of a hand
    - head: the head's joint and the top of the head, if the rig has them
    - view: the viewer's right and up, as directions of the numbers' axes
    """

    parents: tuple[int, ...]
    parts: tuple[str, ...]
    fingers: tuple[bool, ...]
    wrists: Mapping[str, int]
    knuckles: Mapping[str, int]
    head: tuple[int, int] | None
    view: tuple[tuple[float, ...], ...]

    def project_frames(self, frames: FloatArray) -> FloatArray:
        """Returns joint positions (T, J, 2) of frames (T, 3 J), as a viewer in front sees them."""
        return np.asarray(frames.reshape(len(frames), len(self.parents), 3) @ np.array(self.view).T)

    def find_bones(self, part: str, fingers: bool, side: str | None = None) -> list[tuple[int, int]]:
        """Returns the bones (upper joint, lower joint) of a part of the body; ``side``: only those of this hand."""
        return [
            (parent, joint)
            for joint, parent in enumerate(self.parents)
            if parent >= 0
            and self.parts[joint] == part
            and self.fingers[joint] == fingers
            and (side is None or (part == side and (fingers or joint == self.wrists.get(side))))
        ]

    def as_json(self) -> str:
        """Returns the figure as JSON for ``read_stick_figure``."""
        return json.dumps(asdict(self))


def read_stick_figure(text: str) -> StickFigure:
    """Returns the figure in a text of JSON. Raises ``ValueError``, ``KeyError`` or ``TypeError`` for any other."""
    row = json.loads(text)
    joints = {name: tuple(row[name]) for name in ("parents", "parts", "fingers")}
    head = None if row["head"] is None else tuple(row["head"])
    return StickFigure(**{**row, **joints, "head": head, "view": tuple(map(tuple, row["view"]))})


def make_stick_figure(clip: Clip, joints: Sequence[int], parents: Sequence[int]) -> StickFigure:
    """Returns how a signer's numbers are drawn.

    clip: any word of the signer. joints: the skeleton's joint behind each of J triples of numbers. parents: of each of
    these among them, -1 for the first.
    """
    skeleton = clip.skeleton
    roles = rig_info(skeleton).roles
    order = {joint: n for n, joint in enumerate(joints)}
    by_role = {role: order[joint] for role, joint in roles.joints.items() if joint in order}
    owners = [_find_owner(skeleton, joint, roles.role_of) for joint in joints]
    top = _find_top_of_head(skeleton, roles.joint("head"), roles.role_of)
    wrists = {side: by_role[f"{side}Hand"] for side in SIDES if f"{side}Hand" in by_role}
    body_placement = placement(clip)
    parts = ["hidden" if joint == top else _find_part(owner) for joint, owner in zip(joints, owners, strict=True)]
    of_fingers = [
        _is_finger(owner) or (owner.endswith("Hand") and n not in wrists.values()) for n, owner in enumerate(owners)
    ]
    return StickFigure(
        parents=tuple(parents),
        parts=tuple(parts),
        fingers=tuple(of_fingers),
        wrists=wrists,
        knuckles={side: by_role.get(f"{side}MiddleProximal", wrist) for side, wrist in wrists.items()},
        head=(by_role["head"], order[top]) if "head" in by_role and top in order else None,
        view=(_snap_to_axis(np.cross(body_placement.up, body_placement.forward)), _snap_to_axis(body_placement.up)),
    )


def make_synthetic_figure() -> StickFigure:
    """Returns the figure of the synthetic signer, the default for frames stored without a figure."""
    from signsplice.signer.signer import skeleton

    body = skeleton()
    rotations = np.zeros((1, len(body), 4))
    rotations[..., 3] = 1.0
    return make_stick_figure(Clip(body, rotations, np.zeros((1, 3)), 30.0), range(len(body)), body.parents.tolist())


def _snap_to_axis(direction: FloatArray) -> tuple[float, ...]:
    """Returns a unit vector, along an axis of the numbers if it nearly is."""
    nearest = np.round(direction)
    return tuple((nearest if direction @ nearest > _NEARLY else direction).round(9).tolist())


def _find_owner(skeleton: Skeleton, joint: int, role_of: Mapping[int, str]) -> str:
    """Returns the role of a joint, or of the nearest one above it that has one."""
    while joint >= 0:
        if joint in role_of:
            return role_of[joint]
        joint = int(skeleton.parents[joint])
    return ""


def _find_part(role: str) -> str:
    if role.endswith(_HIDDEN_ROLES):
        return HIDDEN
    return next((side for side in SIDES if role.startswith(side)), TRUNK)


def _is_finger(role: str) -> bool:
    return any(finger in role for finger in FINGERS)


def _find_top_of_head(skeleton: Skeleton, head: int | None, role_of: Mapping[int, str]) -> int | None:
    """Returns the child of the head that has no role and lies farthest from it, None if there is none."""
    if head is None:
        return None
    children = [k for k, parent in enumerate(skeleton.parents.tolist()) if parent == head and k not in role_of]
    rest = rest_positions(skeleton)
    return max(children, key=lambda k: float(np.linalg.norm(rest[k] - rest[head])), default=None)
