"""The wire's dataclasses as TypeScript, so that viewer and service cannot drift apart."""

from __future__ import annotations

import sys
import types
from dataclasses import MISSING, fields, is_dataclass
from inspect import getdoc
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from signsplice.service import wire

_PLAIN = {str: "string", float: "number", int: "number", bool: "boolean", type(None): "null"}


def render() -> str:
    """The text of ``wire.ts``."""
    shapes = [thing for thing in vars(wire).values() if is_dataclass(thing) and thing.__module__ == wire.__name__]
    parts = ["// Generated from the service's wire.py; do not edit.", f"export type Format = {_type(wire.Format)};"]
    parts += [_interface(shape) for shape in shapes if isinstance(shape, type)]
    parts += [f"export type {name} = {_type(getattr(wire, name))};" for name in ("FromClient", "FromService")]
    return "\n\n".join(parts) + "\n"


def _interface(shape: type) -> str:
    hints = get_type_hints(shape, include_extras=True)
    # What a caller may leave out is optional; what the service says is always there.
    asked = issubclass(shape, (wire.Dials, wire.Say, wire.End))
    rows = []
    for told in fields(shape):
        left_out = told.default is not MISSING or told.default_factory is not MISSING
        rows.append(f"  {told.name}{'?' if asked and left_out else ''}: {_type(hints[told.name])};")
    summary = (getdoc(shape) or "").split("\n\n")[0].replace("\n", " ")
    return "\n".join([f"/** {summary} */", f"export interface {shape.__name__} {{", *rows, "}"])


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
    Path(sys.argv[1]).write_text(render(), encoding="utf-8")
