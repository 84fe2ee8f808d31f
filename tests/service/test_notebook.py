"""A clip in a notebook: the viewer in a frame, a picture, or a line of text."""

from __future__ import annotations

import base64
import re
import sys
from html import unescape
from pathlib import Path

import numpy as np
import pytest
from conftest import random_clip

from signsplice.motion.clip import Clip
from signsplice.render import picture
from signsplice.service import notebook, page, scene


@pytest.fixture
def _built(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A viewer's page that holds nothing but its content, and files that are made in no time."""
    (tmp_path / "index.html").write_text('<p>"viewer"</p><script type="application/json" id="signsplice">null</script>')
    monkeypatch.setattr(page, "_INDEX", tmp_path / "index.html")
    monkeypatch.setattr(scene, "encode", lambda clip, form, mesh: bytes(300))


@pytest.mark.usefixtures("_built")
def test_a_clip_shows_the_viewer_in_a_frame(words: dict[str, Clip]) -> None:
    shown = words["HELLO"]._repr_html_()
    (inside,) = re.findall(r'<iframe srcdoc="([^"]*)" sandbox="allow-scripts allow-downloads"', shown)
    assert unescape(inside).startswith('<p>"viewer"</p>')
    assert '"name": "HELLO"' in unescape(inside)
    assert '"bvh": null' in unescape(inside), "only the file that is shown"


@pytest.mark.usefixtures("_built")
def test_a_page_too_large_becomes_a_picture(words: dict[str, Clip], monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("PIL")
    monkeypatch.setattr(notebook, "LARGEST_BYTES", 100)
    monkeypatch.setattr(picture, "make_scene", lambda clip: None)
    monkeypatch.setattr(picture, "draw", lambda scene, frame, w, h: np.full((h, w, 3), frame, np.uint8))
    shown = words["HELLO"]._repr_html_()
    (image,) = re.findall(r'src="data:image/png;base64,([^"]*)"', shown)
    assert base64.b64decode(image).startswith(b"\x89PNG")
    assert f"&lt;Clip &#x27;HELLO&#x27;: {len(words['HELLO'])} frames" in shown


def test_without_viewer_and_pillow_there_is_a_line(
    tmp_path: Path, words: dict[str, Clip], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(page, "_INDEX", tmp_path / "missing.html")
    monkeypatch.setitem(sys.modules, "PIL", None)
    monkeypatch.setitem(sys.modules, "PIL.Image", None)
    assert words["HELLO"]._repr_html_().startswith("<code>&lt;Clip &#x27;HELLO&#x27;")


def test_a_clip_that_cannot_be_drawn_is_a_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(page, "_INDEX", tmp_path / "missing.html")
    assert "<code>&lt;Clip" in random_clip(0)._repr_html_()
