"""The viewer's page: one HTML file, built into the package, that holds its scripts, its styles and a scene."""

from __future__ import annotations

import gzip
import hashlib
import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from signsplice.errors import MissingExtraError
from signsplice.splicing.report import plain

if TYPE_CHECKING:
    from starlette.datastructures import Headers
    from starlette.responses import Response

BUILT = Path(__file__).parent / "page"
_INDEX = BUILT / "index.html"
_NOBODY = "'none'"
_EMPTY = '<script type="application/json" id="signsplice">null</script>'


def html(scenes: Sequence[Mapping[str, Any]], live: bool) -> str:
    """Return the page that shows ``wire.Spliced`` scenes; two appear side by side.

    ``live``: whether the page can call a service. Raises ``MissingExtraError`` if the viewer was not built.
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


class PageResponses:
    """Answers with the page of a service, which is read and compressed once, at the first request.

    ``scenes`` as in ``html``. ``embedders``: origins of pages that may show it in a frame.
    """

    def __init__(self, scenes: Sequence[Mapping[str, Any]], embedders: Sequence[str] = ()) -> None:
        self._scenes, self._digest = scenes, ""
        self._frames = {"Content-Security-Policy": f"frame-ancestors {' '.join(embedders) or _NOBODY}"}
        if not embedders:
            self._frames["X-Frame-Options"] = "DENY"
        self._contents: dict[str, bytes] = {}

    def answer(self, request: Headers) -> Response:
        """Return the page, compressed if the client accepts gzip; 304 if the client has it. Raises as ``html``."""
        from starlette.responses import Response  # a page is written without the extra too

        if not self._contents:
            page = html(self._scenes, live=True).encode()
            self._digest = hashlib.sha256(page).hexdigest()[:32]
            self._contents = {"identity": page, "gzip": gzip.compress(page, 9, mtime=0)}
        coding = "gzip" if _accepts_gzip(request.get("accept-encoding", "")) else "identity"
        tag = f'"{self._digest}-{coding}"'
        headers = {
            **self._frames,  # the page itself declares what it may load
            "Cache-Control": "no-cache",
            "Vary": "Accept-Encoding",
            "ETag": tag,
        }
        known = {entity_tag.strip().removeprefix("W/") for entity_tag in request.get("if-none-match", "").split(",")}
        if known & {tag, "*"}:
            return Response(status_code=304, headers=headers)
        if coding != "identity":
            headers["Content-Encoding"] = coding
        return Response(self._contents[coding], media_type="text/html", headers=headers)


def _accepts_gzip(accept_encoding: str) -> bool:
    """Return whether a client accepts gzip, by its Accept-Encoding header (RFC 9110)."""
    weights: dict[str, float] = {}
    for item in accept_encoding.lower().split(","):
        coding, _, parameters = item.partition(";")
        weight = re.fullmatch(r"q=([01](?:\.[0-9]{0,3})?)", parameters.strip())
        weights[coding.strip()] = float(weight[1]) if weight else 1.0
    return weights.get("gzip", weights.get("*", 0.0)) > 0.0
