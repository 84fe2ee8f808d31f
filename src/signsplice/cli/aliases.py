"""Former names of options: they still work and are not shown in the help."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def former_names(names: Mapping[str, str]) -> dict[str, Any]:
    """Context settings of a command whose options have former names: former -> present, without dashes."""
    return {"token_normalize_func": lambda name: names.get(name, name)}
