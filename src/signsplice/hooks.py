"""What higher rooms plug into lower ones when the package is imported; free of imports, as the public face needs it."""

TYPE_CHECKING = False  # typing's own costs an import
if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import Any

html_renderers: "list[Callable[[Any], str]]" = []
"""What shows a clip as HTML; the last one is used."""
