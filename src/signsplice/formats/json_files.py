"""Reading of foreign JSON, with one kind of error for anything wrong with it."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import is_dataclass
from itertools import repeat
from pathlib import Path
from reprlib import repr as abridged
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from signsplice.errors import FormatError
from signsplice.formats.reading import read_bytes

MOST_BYTES = 16 << 20
"""Largest JSON file that is read, bytes: small values take up to 24 times their text in memory."""


def read_json(path: str | Path, expected: str) -> Any:
    """Read the values of a JSON file; ``expected`` describes its content in messages.

    Raises ``InputError`` if it cannot be read or is too large, otherwise as ``parse_json`` does.
    """
    return parse_json(read_bytes(path, MOST_BYTES), str(path), expected)


def parse_json(content: bytes, file: str, expected: str) -> Any:
    """Parse JSON text in UTF-8. Raises ``FormatError`` if it is not JSON, nests too deeply, or holds values that no
    other program could read: the words NaN and Infinity, whole numbers of thousands of digits, lone surrogates.
    """
    try:
        values = json.loads(content.decode("utf-8-sig"), parse_constant=_reject_constant)
        if b"\\ud" in content.lower():  # a lone surrogate can be neither printed nor written
            json.dumps(values, ensure_ascii=False).encode()
    except json.JSONDecodeError as error:
        raise FormatError(f"is no JSON ({error.msg}), expected {expected}", file=file, line=error.lineno) from error
    except RecursionError as error:
        raise FormatError(f"is no JSON that can be read (nested too deeply), expected {expected}", file=file) from error
    except UnicodeError as error:
        raise FormatError(f"is no JSON (its text is no valid UTF-8), expected {expected}", file=file) from error
    except ValueError as error:
        reason = str(error).partition(";")[0]
        raise FormatError(f"is no JSON that can be read ({reason}), expected {expected}", file=file) from error
    return values


def _reject_constant(constant: str) -> None:
    raise ValueError(f"{constant} is no number of JSON")


def as_object(value: Any) -> dict[str, Any]:
    """Return a JSON value if it is an object, else an empty one."""
    return value if isinstance(value, dict) else {}


def shorten_json(value: Any) -> str:
    """Shorten a JSON value to at most 120 characters, for a message."""
    text = abridged(value)
    return text if len(text) <= 120 else f"{text[:117]}..."


def check_type(value: Any, kind: Any, where: str) -> None:
    """Raise ``TypeError`` if a JSON value is not of type ``kind``: a plain one, a union, a ``Literal``, a list, a
    mapping with names as keys, a tuple (in JSON a list), or a dataclass (in JSON an object with all its fields).
    ``where``: the value's name in the message.

    Numbers must be finite, and whole numbers fit into 64 bits; true is no number. ``Annotated[float, ...]``
    also takes null, for NaN.
    """
    origin, inner = get_origin(kind), get_args(kind)
    if origin is Annotated:
        return check_type(value, inner[0] | None, where)
    if origin in (UnionType, Union):
        fits = any(_is_of(value, option, where) for option in inner)
    elif origin is Literal:
        fits = isinstance(value, str) and value in inner
    elif origin is tuple and inner[-1] is not Ellipsis:
        fits = isinstance(value, list) and len(value) == len(inner) and all(map(_is_of, value, inner, repeat(where)))
    elif origin in (list, tuple):
        fits = isinstance(value, list) and all(_is_of(item, inner[0], where) for item in value)
    elif origin in (dict, Mapping):
        fits = isinstance(value, dict) and all(_is_of(item, inner[1], where) for item in value.values())
    elif isinstance(kind, type) and is_dataclass(kind):
        hints = get_type_hints(kind, include_extras=True)
        fits = isinstance(value, dict) and all(
            name in value and _is_of(value[name], hints[name], name) for name in hints
        )
    elif kind in (int, float):
        fits = isinstance(value, int if kind is int else (int, float)) and not isinstance(value, bool)
        fits = fits and -(2**63) <= value < 2**63 if isinstance(value, int) else fits and math.isfinite(value)
    else:
        fits = (
            kind is Any
            or (value is None and kind in (None, NoneType))
            or (isinstance(kind, type) and isinstance(value, kind))
        )
    if not fits:
        name = kind.__name__ if isinstance(kind, type) and origin is None else str(kind).replace("typing.", "")
        raise TypeError(f"{where}: found {json.dumps(value)[:40]}, expected {name}")
    return None


def _is_of(value: Any, kind: Any, where: str) -> bool:
    try:
        check_type(value, kind, where)
    except TypeError:
        return False
    return True
