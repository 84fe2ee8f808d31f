"""Writes the wire's dataclasses as TypeScript: ``python viewer/generate.py`` after a change of service/wire.py."""

from __future__ import annotations

import types
from dataclasses import MISSING, Field, fields, is_dataclass
from inspect import getdoc
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from pydantic.fields import FieldInfo

from signsplice.formats import FORMATS
from signsplice.service import wire

FILE = Path(__file__).resolve().parent / "src" / "wire.ts"
_PLAIN = {str: "string", float: "number", int: "number", bool: "boolean", type(None): "null"}


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
    FILE.write_text(render(), encoding="utf-8")
