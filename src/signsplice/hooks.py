"""Hooks that higher packages register in lower ones; without imports, since ``signsplice/__init__.py`` uses them."""

TYPE_CHECKING = False  # typing.TYPE_CHECKING needs an import
if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import Any

html_renderers: "list[Callable[[Any], str]]" = []
"""Functions that render a clip as HTML; the last one is used."""
