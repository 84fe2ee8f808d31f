"""JSON counterparts of the engine's dataclasses, so that the wire's types cannot drift from them."""

from __future__ import annotations

from dataclasses import fields, make_dataclass
from functools import reduce
from operator import or_
from types import UnionType
from typing import Any, get_args, get_origin, get_type_hints

from signsplice.splicing.seam import Score


def json_type(source: type) -> type:
    """A dataclass with the name, docstring and fields of ``source``, typed as JSON carries them.

    Tuples of any length become lists, and a score may be null, since JSON has no NaN. Every field is required: the
    service writes all of them.
    """
    hints = get_type_hints(source, include_extras=True)
    typed = [(field.name, _json_hint(hints[field.name])) for field in fields(source)]
    namespace = {"__doc__": source.__doc__, "__module__": __name__}
    return make_dataclass(source.__name__, typed, frozen=True, namespace=namespace)


def _json_hint(hint: Any) -> Any:
    if hint == Score:
        return float | None
    inner = get_args(hint)
    if get_origin(hint) is UnionType:
        return reduce(or_, map(_json_hint, inner))
    return list[_json_hint(inner[0])] if get_origin(hint) is tuple and inner[-1] is Ellipsis else hint  # type: ignore[misc]
