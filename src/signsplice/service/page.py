"""The viewer's page: one HTML file, built into the package, that holds its scripts, its styles and a scene."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from signsplice.errors import MissingExtraError
from signsplice.splicing.report import plain

BUILT = Path(__file__).parent / "page"
_INDEX = BUILT / "index.html"
_EMPTY = '<script type="application/json" id="signsplice">null</script>'


def html(scenes: Sequence[Mapping[str, Any]], live: bool) -> str:
    """The page that shows ``wire.Spliced`` scenes; two are shown side by side.

    ``live``: whether the page can call a service. Raises ``MissingExtraError`` where the viewer was not built.
    """
    try:
        page = _INDEX.read_text(encoding="utf-8")
    except OSError as error:
        raise MissingExtraError(
            "this installation of signsplice has no viewer; run `make viewer` in a checkout (needs Node 20 or newer), "
            "or install a wheel, which contains it"
        ) from error
    content = json.dumps(plain({"scenes": list(scenes), "live": live}), allow_nan=False).replace("<", "\\u003c")
    return page.replace(_EMPTY, _EMPTY.replace("null", content), 1)
