"""A clip in a notebook: an animated drawing without other packages."""

from __future__ import annotations

import re
import subprocess
import sys
from html import unescape
from xml.etree import ElementTree

import numpy as np
from conftest import random_clip

from signsplice.motion import Clip, concatenate
from signsplice.render import notebook
from signsplice.render.picture import make_scene


def test_a_clip_moves_in_a_frame_that_reaches_nothing(words: dict[str, Clip]) -> None:
    clip = words["HELLO"]
    shown = clip._repr_html_()
    (inside,) = re.findall(r'<iframe srcdoc="([^"]*)" sandbox="allow-scripts" title="HELLO"', shown)
    assert notebook.drawing(clip) in unescape(inside)
    assert "//" not in unescape(inside), "it asks no host"
    assert f"&lt;Clip &#x27;HELLO&#x27;: {len(clip)} frames" in shown


def test_the_drawing_shows_the_hands_where_pictures_have_them(words: dict[str, Clip]) -> None:
    clip, scene = words["HELLO"], make_scene(words["HELLO"])
    quoted = re.sub(r"=([^\s'>]+)", r"='\1'", notebook.drawing(clip))
    paths = ElementTree.fromstring(quoted).iter("animate")
    moves = np.array(
        [[re.findall(r"-?\d+", path) for path in element.attrib["values"].split(";")] for element in paths], dtype=float
    )  # (C, N, 4)
    left, _, bottom, top = scene.window
    frames = np.linspace(0, len(clip) - 1, moves.shape[1]).round().astype(int)
    hands = (scene.hands[frames, :, :2] - (left, top)) * np.array([1, -1]) * 400 / (top - bottom)  # (N, 2, 2)
    distances = np.linalg.norm(hands[:, :, None] - moves.transpose(1, 0, 2)[:, None, :, 2:], axis=-1)
    assert distances.min(axis=-1).max() < 12.0, "an end of a palm is near the middle of the hand"
    assert np.ptp(moves, axis=1).max() > 60.0


def test_a_long_sentence_stays_small(words: dict[str, Clip]) -> None:
    long = concatenate([words["HELLO"]] * 40)
    assert len(notebook.html(long)) < 300_000


def test_it_needs_no_extra() -> None:
    code = (
        "import sys\nfor name in ('PIL', 'starlette', 'uvicorn', 'rich', 'matplotlib'):\n    sys.modules[name] = None\n"
        "import signsplice as ss\nprint(ss.open_lexicon().clip('I')._repr_html_()[:7])"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout == "<iframe\n"


def test_a_rig_without_a_person_is_drawn_by_its_bones() -> None:
    assert notebook.drawing(random_clip(0)).count("<animate ") >= len(random_clip(0).skeleton) - 1
