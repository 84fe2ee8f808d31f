"""The viewer's page, as it was built into the package: one HTML file that needs no other, with a scene put into it."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

from signsplice.errors import MissingExtraError
from signsplice.splicing.report import plain

BUILT = Path(__file__).parent / "page"
_INDEX = BUILT / "index.html"
_MARK = '<script type="application/json" id="signsplice">null</script>'


@lru_cache(maxsize=1)
def _read(modified_ns: int) -> str:
    return _INDEX.read_text(encoding="utf-8")


def html(scenes: Sequence[Mapping[str, Any]], live: bool) -> str:
    """The page that shows ``wire.Spliced`` scenes, side by side where there are two; ``live``: a service is there to
    ask for more. Raises ``MissingExtraError`` where this build of the package has no viewer.
    """
    try:
        page = _read(_INDEX.stat().st_mtime_ns)
    except OSError as error:
        raise MissingExtraError(
            "this build of signsplice has no viewer; `make viewer` makes it (Node 20 or newer), and wheels hold it"
        ) from error
    told = json.dumps(plain({"scenes": list(scenes), "live": live}), allow_nan=False).replace("<", "\\u003c")
    return page.replace(_MARK, _MARK.replace("null", told), 1)
