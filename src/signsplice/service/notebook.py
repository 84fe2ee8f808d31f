"""A clip shown in a notebook: the viewer's page in a frame, else a picture, else a line of text."""

from __future__ import annotations

import base64
import io
from html import escape

from signsplice.errors import MissingExtraError, SignspliceError
from signsplice.motion.clip import Clip

LARGEST_BYTES = 12_000_000
"""Size of a page from which on a picture is shown: each is kept in the notebook's file."""
_N_PICTURES, _SIDE = 6, 200


def html(clip: Clip) -> str:
    """The offline viewer with a clip, about 3 MB and more for long ones; a row of pictures where the viewer was not
    built, its extra is not installed or the page would be larger than ``LARGEST_BYTES``; text where Pillow is missing
    too. The frame may run its scripts and save files, and reaches nothing of the notebook.
    """
    page = _page(clip)
    if page and len(page) <= LARGEST_BYTES:
        return (
            f'<iframe srcdoc="{escape(page)}" sandbox="allow-scripts allow-downloads" title="{escape(clip.name)}" '
            'style="width: 100%; height: 640px; border: 1px solid #ccc"></iframe>'
        )
    picture = _pictures(clip)
    line = f"<code>{escape(repr(clip))}</code>"
    return f'<img src="data:image/png;base64,{picture}" alt=""><br>{line}' if picture else line


def _page(clip: Clip) -> str:
    """The viewer's page with a clip, empty where there is none."""
    try:
        from signsplice.service import page, scene

        page.html([], live=False)  # a missing viewer is found before any file is made
        return page.html([scene.from_clip(clip, None, ("glb",))], live=False)
    except (ImportError, MissingExtraError):
        return ""


def _pictures(clip: Clip) -> str:
    """Frames of a clip in a row, PNG in base64; empty where they cannot be drawn."""
    try:
        import numpy as np

        from signsplice.render.page import pillow
        from signsplice.render.picture import draw, make_scene

        frames = np.unique(np.linspace(0, len(clip) - 1, _N_PICTURES + 2).astype(int)[1:-1])
        scene = make_scene(clip)
        row = np.concatenate([draw(scene, int(frame), _SIDE, _SIDE) for frame in frames], axis=1)
        file = io.BytesIO()
        pillow("Image").fromarray(row).save(file, format="PNG")
    except (ImportError, SignspliceError):
        return ""
    return base64.b64encode(file.getvalue()).decode("ascii")
