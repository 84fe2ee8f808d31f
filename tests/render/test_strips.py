"""Strips: one row for each clip, one picture for each frame, a border around frames of a transition."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from signsplice.errors import InputError
from signsplice.motion import Clip
from signsplice.render.sheet import PAPER, TRANSITION, Strip, write_strips

Image = pytest.importorskip("PIL.Image")
LABEL, GAP = 20, 6


def page(path: Path) -> np.ndarray:
    with Image.open(path) as image:
        assert image.format == "PNG"
        return np.asarray(image.convert("RGB")).astype(int)


def coloured(pixels: np.ndarray, colour: tuple[int, int, int]) -> np.ndarray:
    """Mask (H, W) of the pixels with a colour, within the precision of the palette."""
    return np.asarray((np.abs(pixels - colour) <= 6).all(axis=-1))


def test_a_page_has_a_row_per_strip_and_a_column_per_frame(words: dict[str, Clip], tmp_path: Path) -> None:
    calls: list[tuple[int, int]] = []
    strips = [
        Strip(words["I"], "I", [5, 20, 30]),
        Strip(words["SIGN"], "SIGN", [25, 30], view="side", hand="left"),
    ]
    write_strips(strips, tmp_path / "page.png", picture_px=60, hand_px=40, progress=lambda *call: calls.append(call))
    pixels = page(tmp_path / "page.png")
    assert pixels.shape == (2 * (LABEL + 60 + 40 + GAP), 3 * (60 + GAP) + GAP, 3)
    assert calls == [(1, 2), (2, 2)]
    for row, count in ((0, 3), (1, 2)):
        top = row * (LABEL + 60 + 40 + GAP)
        for column in range(3):
            left = GAP + column * (60 + GAP)
            for at, height in ((top + LABEL, 60), (top + LABEL + 60, 40)):
                part = pixels[at : at + height, left : left + 60]
                assert (~coloured(part, PAPER)).any() == (column < count)
        assert (~coloured(pixels[top : top + LABEL], PAPER)).any(), "a caption"
    assert not coloured(pixels, TRANSITION).any()


def test_only_marked_frames_have_a_border(words: dict[str, Clip], tmp_path: Path) -> None:
    strip = Strip(words["I"], "I", [5, 20, 30], marked=[20, 21])
    write_strips([strip], tmp_path / "page.png", picture_px=60, hand_px=40)
    amber = coloured(page(tmp_path / "page.png"), TRANSITION)
    rows, columns = np.nonzero(amber)
    left = GAP + 1 * (60 + GAP)
    assert (columns.min(), columns.max()) == (left - 1, left + 60)
    assert (rows.min(), rows.max()) == (LABEL - 1, LABEL + 60 + 40)
    inside = amber[LABEL + 4 : LABEL + 90, left + 4 : left + 54]
    assert not inside.any(), "a border, not a block"


def test_hands_can_be_left_out(words: dict[str, Clip], tmp_path: Path) -> None:
    strip = Strip(words["I"], "I", [20])
    write_strips([strip], tmp_path / "none.png", picture_px=60, hand_px=0)
    assert page(tmp_path / "none.png").shape[0] == LABEL + 60 + GAP
    write_strips([Strip(words["I"], "I", [20], hand="")], tmp_path / "empty.png", picture_px=60, hand_px=40)
    pixels = page(tmp_path / "empty.png")
    assert coloured(pixels[LABEL + 60 :], PAPER).all()


def test_the_requested_hand_is_enlarged(words: dict[str, Clip], tmp_path: Path) -> None:
    """In a one-handed word the two hands look different."""
    for hand in ("left", "right"):
        write_strips([Strip(words["I"], "I", [28], hand=hand)], tmp_path / f"{hand}.png", picture_px=60, hand_px=40)
    left, right = (page(tmp_path / f"{hand}.png") for hand in ("left", "right"))
    other = np.abs(left - right).max(axis=-1)
    assert (other[: LABEL + 60] < 32).mean() > 0.998, "but for the palette, the picture above is the same"
    assert (other[LABEL + 60 :] > 64).mean() > 0.05


def test_unknown_views_are_refused(words: dict[str, Clip], tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no view 'top'"):
        write_strips([Strip(words["I"], "I", [20], view="top")], tmp_path / "page.png")
    assert not (tmp_path / "page.png").exists()
