"""Skeletons in JSON; numbers are read back unchanged."""

from __future__ import annotations

from typing import Any

import numpy as np

from signsplice.errors import InputError
from signsplice.formats.json_files import check_type
from signsplice.formats.reading import DEFAULT_LIMITS
from signsplice.motion import EndSite, Skeleton

_KINDS = {
    "names": list[str],
    "parents": list[int],
    "offsets": list[tuple[float, float, float]],
    "end_sites": list[tuple[int, tuple[float, float, float]]],
    "roles": dict[str, str] | None,
}


def as_json(skeleton: Skeleton) -> dict[str, Any]:
    """Return JSON that ``from_json`` reads. Raises ``InputError`` for more joints than ``from_json`` accepts."""
    if len(skeleton) > DEFAULT_LIMITS.joints:
        raise InputError(f"skeleton: {len(skeleton)} joints, expected at most {DEFAULT_LIMITS.joints:g}")
    return {
        "names": list(skeleton.names),
        "parents": skeleton.parents.tolist(),
        "offsets": skeleton.offsets.tolist(),
        "end_sites": [[site.joint, site.offset.tolist()] for site in skeleton.end_sites],
        "roles": None if skeleton.roles is None else dict(skeleton.roles),
    }


def from_json(fields: Any) -> Skeleton:
    """Build the skeleton from JSON of ``as_json``. Raises ``InputError``, ``KeyError``, ``TypeError`` or ``ValueError``
    for anything else.
    """
    check_type(fields, dict[str, Any], "description")
    for name, kind in _KINDS.items():
        check_type(fields[name], kind, name)
    if len(fields["names"]) > DEFAULT_LIMITS.joints:
        raise ValueError(f"{len(fields['names'])} joints, expected at most {DEFAULT_LIMITS.joints:g}")
    parents, offsets = np.array(fields["parents"], np.intp), np.array(fields["offsets"], np.float64).reshape(-1, 3)
    sites = tuple(EndSite(joint, np.array(offset, np.float64)) for joint, offset in fields["end_sites"])
    return Skeleton(tuple(fields["names"]), parents, offsets, sites, fields["roles"])
