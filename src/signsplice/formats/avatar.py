"""Avatars: the skeleton of a ``.vrm`` (0.x or 1.0) or ``.glb`` file in its rest pose, with its mesh. No animation is
needed.

The skeleton holds the joints that have a role, and those between them. All others (hair, skirts, twisted forearms) are
carried by the nearest of these above them. A VRM avatar of version 0.x, which faces -Z, is turned to face +Z, as those
of version 1.0 do. VRM's players take its rest pose as the T-pose.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from signsplice.body.capsules import Avatar
from signsplice.body.skin import fit_skin
from signsplice.errors import InputError
from signsplice.formats.gltf_mesh import MeshReader
from signsplice.formats.gltf_skeleton import VRM_0, VRM_1, printable, unique
from signsplice.formats.limits import DEFAULT_LIMITS, ReadLimits
from signsplice.formats.reading import format_errors, read_bytes, stem
from signsplice.motion.arrays import FloatArray
from signsplice.motion.clip import EndSite, Skeleton
from signsplice.rig.info import rig_info

AVATAR_SUFFIXES = (".vrm", ".glb", ".gltf")
"""Suffixes that ``read_avatar`` reads."""
_BEHIND = np.diag([-1.0, 1.0, -1.0])
_MOST_MISSED = 4


def read_avatar(
    path: str | Path, roles: Mapping[str, str] | None = None, limits: ReadLimits = DEFAULT_LIMITS
) -> Avatar:
    """The avatar in a ``.vrm``, ``.glb`` or ``.gltf`` file: its skeleton at rest and its body, fitted to its mesh.

    roles: role -> joint name, where the file is no VRM avatar and its joints are not known by name. Raises
    ``InputError`` for another suffix, a file that cannot be read, or arms that are not found, ``FormatError`` for
    whatever is wrong with its content, and ``LimitError`` where that asks for more than ``limits``.
    """
    file = str(path)
    if Path(path).suffix.lower() not in AVATAR_SUFFIXES:
        suffix = Path(path).suffix.lower() or "(none)"
        raise InputError(f"{file}: a file with suffix {suffix} is no avatar, expected .vrm, .glb or .gltf")
    content = read_bytes(path, limits.file_bytes)
    with format_errors(file, "avatar"), np.errstate(all="ignore"):
        return AvatarReader(file, content, limits, Path(path).parent).avatar(roles or {})


class AvatarReader(MeshReader):
    """A document whose avatar is being read."""

    def avatar(self, roles: Mapping[str, str]) -> Avatar:
        """The avatar; ``roles``: role -> joint name, which win over the file's own."""
        nodes = self._roles(roles)
        order = self._joint_order(set(nodes.values()))
        names = unique([printable(self.nodes[node].get("name"), f"node {node}") for node in order])
        named = {role: names[order.index(node)] for role, node in nodes.items()}
        extensions = self.json.get("extensions") or {}
        turn = _BEHIND if VRM_0 in extensions and VRM_1 not in extensions else np.eye(3)
        avatar = self._skeleton(order, names, named, turn)
        _ = rig_info(avatar).arm_joints  # raises where there are no arms
        origin = self.world(order[0])[:3, 3]
        avatar = replace(avatar, is_vrm=bool({VRM_0, VRM_1} & {*extensions}))
        rows = {node: k for k, node in enumerate(order)}
        parts, points = self.skin(rows, turn, origin)
        if points is None:
            line = f"{avatar.label}: holds no mesh that its bones carry; its body gets the usual proportions"
            return replace(avatar, mesh=parts, warnings=(line,))
        body, missed = fit_skin(avatar, points)
        return replace(avatar, mesh=parts, body=body, warnings=_warnings(avatar.label, missed))

    def _skeleton(self, order: list[int], names: list[str], roles: Mapping[str, str], turn: FloatArray) -> Avatar:
        """The skeleton of nodes ``order`` at rest, turned, with the ends of fingers."""
        rows = {node: k for k, node in enumerate(order)}
        parents = np.array([rows.get(self.parents.get(node, -1), -1) for node in order])
        at = np.array([self.world(node)[:3, 3] for node in order]) @ turn.T
        offsets = np.where((parents >= 0)[:, None], at - at[parents], 0.0)
        tips = [order[names.index(name)] for role, name in roles.items() if role.endswith("Distal")]
        sites = [
            EndSite(rows[node], turn @ self.world(child)[:3, 3] - at[rows[node]])
            for node in tips
            for child in self.nodes[node].get("children") or ()
            if child not in rows
        ]
        return Avatar(tuple(names), parents, offsets, tuple(sites), dict(roles), label=stem(self.file))

    def _roles(self, given: Mapping[str, str]) -> dict[str, int]:
        """Role -> node: those given by name, else those of a VRM humanoid, else those known by name."""
        humanoid = self._humanoid()
        joints = {node for skin in self.skins for node in skin["joints"]} | {*humanoid.values()}
        if not joints:
            raise self._error("is no avatar: it holds neither a VRM humanoid nor a mesh with a skin")
        if humanoid and not given:
            return humanoid
        order = self._joint_order(joints)
        names = unique([printable(self.nodes[node].get("name"), f"node {node}") for node in order])
        rows = {node: k for k, node in enumerate(order)}
        parents = np.array([rows.get(self.parents.get(node, -1), -1) for node in order])
        at = np.array([self.world(node)[:3, 3] for node in order])
        skeleton = Skeleton(tuple(names), parents, np.where((parents >= 0)[:, None], at - at[parents], 0.0))
        known = {role: names[rows[node]] for role, node in humanoid.items()}
        if set(given.values()) & {*names} or not (humanoid or rig_info(skeleton).roles.rig != "unknown"):
            known = {role: name for role, name in known.items() if name not in given.values()} | dict(given)
        info = rig_info(replace(skeleton, roles=known or None))
        _ = info.arm_joints  # raises where there are no arms
        joints_of_roles = info.roles.joints
        return {role: order[joint] for role, joint in joints_of_roles.items()}


def _warnings(label: str, missed: tuple[str, ...]) -> tuple[str, ...]:
    """A line about the parts of the body that could not be fitted."""
    if not missed:
        return ()
    shown = ", ".join(missed[:_MOST_MISSED]) + (
        f" and {len(missed) - _MOST_MISSED} more" if len(missed) > _MOST_MISSED else ""
    )
    return (f"{label}: too few vertices of skin for {shown}, which get the usual proportions",)
