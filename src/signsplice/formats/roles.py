"""Roles files: JSON that maps body roles to joint names, for rigs whose joint names are not recognised."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from signsplice.errors import FormatError
from signsplice.formats.json_files import read_json
from signsplice.motion import Clip
from signsplice.rig.info import rig_info
from signsplice.rig.roles import ROLES, unknown_role

_SHAPE = 'an object {"role": "joint name", ...}'


def read(path: str | Path) -> dict[str, str]:
    """Read role -> joint name from a JSON file, such as ``{"hips": "Root", "leftHand": "wrist_l"}``.

    Raises ``InputError`` if the file cannot be read, ``FormatError`` if it is no JSON object, or has an unknown role or
    a joint name that is not a string.
    """
    file = str(path)
    loaded = read_json(path, _SHAPE)
    if not isinstance(loaded, dict):
        raise FormatError(f"found {json.dumps(loaded)[:40]}, expected {_SHAPE}", file=file)
    for role, name in loaded.items():
        if role not in ROLES:
            raise FormatError(unknown_role(role[:40]), file=file)
        if not isinstance(name, str):
            raise FormatError(f"{role}: found {json.dumps(name)[:40]}, expected a joint's name in quotes", file=file)
    return loaded


def with_roles(clip: Clip, roles: Mapping[str, str]) -> Clip:
    """Return the clip with ``roles`` (role -> joint name) on its skeleton.

    A clip without any of those joints, whose rig is recognised by its joint names, is returned unchanged: one roles
    file may serve clips of several rigs. Raises ``InputError`` if only some of the joints are missing.
    """
    if not set(roles.values()) & set(clip.skeleton.names) and rig_info(clip.skeleton).roles.rig != "unknown":
        return clip
    clip = replace(clip, skeleton=replace(clip.skeleton, roles=roles))
    _ = rig_info(clip.skeleton).roles  # raises if a role's joint is missing
    return clip
