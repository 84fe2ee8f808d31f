"""What a motion is: numpy and scipy only; knows no file, no gloss, no network.

How a notebook shows a clip is registered here by the public face, since pages and pictures lie above clips.
"""

TYPE_CHECKING = False  # the public face imports this: typing and __future__ cost imports
if TYPE_CHECKING:
    from collections.abc import Callable

    from signsplice.motion.clip import Clip

html_renderers: "list[Callable[[Clip], str]]" = []
"""What shows a clip as HTML; the last one is used."""
