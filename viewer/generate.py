"""Writes the page's generated files: the wire's dataclasses, and the constants of bodies and fits, as TypeScript.

python viewer/generate.py          # after a change of service/wire.py or of those constants
"""

from __future__ import annotations

import json
import types
from dataclasses import MISSING, Field, fields, is_dataclass
from inspect import getdoc
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np
from pydantic.fields import FieldInfo

from signsplice.body import arm_ik, capsules, fit, retarget, skin, skin_contacts, skin_surface, swivel, thumb_contacts
from signsplice.formats import FORMATS, gltf_mesh
from signsplice.rig import info, t_pose
from signsplice.service import wire

SOURCES = Path(__file__).resolve().parent / "src"
_BODIES = (
    *(t_pose, info, capsules, gltf_mesh, skin_surface, skin, fit, skin_contacts, swivel, arm_ik, thumb_contacts),
    retarget,
)
_CONSTANTS = (int, float, tuple, dict, set, np.ndarray)
_PLAIN = {str: "string", float: "number", int: "number", bool: "boolean", type(None): "null"}


def files() -> dict[str, str]:
    """The texts of the generated files by their names in ``viewer/src``."""
    return {"wire.ts": render(), "fit/constants.ts": constants()}


def constants() -> str:
    """The text of ``fit/constants.ts``: the constants of the modules that know bodies and fit motion to them."""
    parts = ["// Generated from the Python modules of the same names; do not edit."]
    for module in _BODIES:
        found = {
            name.lstrip("_"): _literal(value)
            for name, value in vars(module).items()
            if name.lstrip("_").isupper() and (type(value) in _CONSTANTS or is_dataclass(value))
        }
        rows = [f"  {name}: {value}," for name, value in found.items()]
        name = module.__name__.rpartition(".")[2]
        parts.append("\n".join([f"export const {name} = {{", *rows, "} as const;"]))
    return "\n\n".join(parts) + "\n"


def _literal(value: Any) -> str:
    """The TypeScript of a constant: of a dataclass, a field a line."""
    if is_dataclass(value):
        rows = [f"    {field.name}: {_literal(getattr(value, field.name))}," for field in fields(value)]
        return "\n".join(["{", *rows, "  }"])
    return json.dumps(value, ensure_ascii=False, default=_plain)


def _plain(value: np.ndarray | set[str]) -> Any:
    return value.tolist() if isinstance(value, np.ndarray) else sorted(value)


def render() -> str:
    """The text of ``wire.ts``."""
    values = vars(wire).values()
    shapes = [value for value in values if isinstance(value, type) and is_dataclass(value)]
    parts = ["// Generated from the service's wire.py; do not edit.", f"export type Format = {_type(wire.Format)};"]
    media_types = [f"  {name}: '{FORMATS[f'.{name}'].media_type}'," for name in wire.FORMAT_NAMES]
    parts.append("\n".join(["export const MEDIA_TYPES: Record<Format, string> = {", *media_types, "};"]))
    parts += [_interface(shape) for shape in shapes]
    parts += [f"export type {name} = {_type(getattr(wire, name))};" for name in ("ClientMessage", "ServiceMessage")]
    return "\n\n".join(parts) + "\n"


def _interface(shape: type) -> str:
    hints = get_type_hints(shape, include_extras=True)
    is_request = issubclass(shape, wire.Dials)  # a caller may leave out what has a default; the service never does
    rows = []
    for field in fields(shape):
        mark = "?" if is_request and _has_default(field) else ""
        rows.append(f"  {_key(field.name, hints[field.name])}{mark}: {_type(hints[field.name])};")
    summary = (getdoc(shape) or "").split("\n\n")[0].replace("\n", " ")
    return "\n".join([f"/** {summary} */", f"export interface {shape.__name__} {{", *rows, "}"])


def _has_default(field: Field[Any]) -> bool:
    return field.default is not MISSING or field.default_factory is not MISSING


def _key(name: str, hint: Any) -> str:
    """The JSON key of a field."""
    aliases = (extra.alias for extra in get_args(hint)[1:] if isinstance(extra, FieldInfo))
    return next(filter(None, aliases), name)


def _type(hint: Any) -> str:
    origin, inner = get_origin(hint), get_args(hint)
    if hint in _PLAIN:
        return _PLAIN[hint]
    if is_dataclass(hint) and isinstance(hint, type):
        return hint.__name__
    if origin is Annotated:
        return _type(inner[0])
    if origin is Literal:
        return " | ".join(f'"{value}"' for value in inner)
    if origin in (Union, types.UnionType):
        return " | ".join(_type(part) for part in inner)
    if origin is list:
        item = _type(inner[0])
        return f"({item})[]" if " | " in item else f"{item}[]"
    if origin is tuple:
        return f"[{', '.join(map(_type, inner))}]"
    if origin is dict:
        return f"Record<{_type(inner[0])}, {_type(inner[1])}>"
    raise TypeError(f"{hint} has no counterpart in TypeScript")


if __name__ == "__main__":
    for name, text in files().items():
        (SOURCES / name).write_text(text, encoding="utf-8")
