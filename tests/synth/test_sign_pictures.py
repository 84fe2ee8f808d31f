"""Pictures for who writes signs: one sign, and every name of the notation."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from signing import SIGNS, made
from signsplice.render.picture import draw, draw_dots, make_scene
from signsplice.render.sheet import write_cells
from signsplice.signer import notation, phonology, planner, preview
from signsplice.signer.handshapes import HANDSHAPES
from signsplice.signer.preview import DOT, write_preview
from signsplice.signer.signer import STANDARD, draw_signer
from signsplice.signer.tables import FOLDER

Image = pytest.importorskip("PIL.Image")
DOCS = Path(__file__).resolve().parents[2] / "docs"


def pixels(path: Path) -> np.ndarray:
    with Image.open(path) as image:
        return np.asarray(image.convert("RGB")).astype(int)


def dots(picture: np.ndarray) -> np.ndarray:
    """Mask of the pixels in the colour of dots, within the precision of a palette."""
    return np.asarray((np.abs(picture - DOT) <= 12).all(axis=-1))


@pytest.mark.parametrize(("gloss", "hands"), [("MOTHER", 1), ("BOOK", 2), ("LEARN", 2)])
def test_a_preview_has_a_column_a_posture_and_rows_of_the_hands_that_act(
    gloss: str, hands: int, tmp_path: Path
) -> None:
    word = planner.synthesize_word(SIGNS[gloss])
    movements = sum(segment.kind == "M" for segment in word.sign.segments)
    write_preview(word, tmp_path / "a.png", size=60)
    picture = pixels(tmp_path / "a.png")
    assert picture.shape == ((2 + hands) * (60 + 18), (1 + 2 * movements) * 60, 3)
    seen = dots(picture)[: 2 * 78]
    by_column = [seen[:, 60 * n : 60 * (n + 1)].any() for n in range(1 + 2 * movements)]
    assert by_column == [n % 2 == 1 for n in range(1 + 2 * movements)], "paths are in the middle of movements"


def test_a_left_handed_signer_shows_the_left_hand(tmp_path: Path) -> None:
    signer = next(one for one in map(draw_signer, range(100)) if one.left_handed)
    write_preview(planner.synthesize_word(SIGNS["MOTHER"], signer), tmp_path / "left.png", size=60)
    write_preview(planner.synthesize_word(SIGNS["MOTHER"], STANDARD), tmp_path / "right.png", size=60)
    left, right = (pixels(tmp_path / name)[2 * 78 :, :60] for name in ("left.png", "right.png"))
    assert np.abs(left - right).max() > 50


def test_dots_are_where_the_camera_sees_their_points() -> None:
    word = made("H  shape=B-open at=space palm=fwd fingers=up")
    scene = make_scene(word.clip)
    frame = word.events.start
    image = draw_dots(draw(scene, frame, 200, 100), scene, scene.hands[frame], DOT, 3.0)
    rows, columns = np.nonzero((image == DOT).all(axis=-1))
    left, right, bottom, top = scene.window
    scale = 100 / (top - bottom)
    for x, y, _ in scene.hands[frame]:
        column, row = 100 + (x - 0.5 * (left + right)) * scale, 50 - (y - 0.5 * (bottom + top)) * scale
        assert np.hypot(columns - column, rows - row).min() < 1.5
    assert len(rows) < 2 * 40


def test_cells_are_laid_out_in_rows(tmp_path: Path) -> None:
    cell = np.zeros((30, 40, 3), np.uint8)
    write_cells([(cell, str(n)) for n in range(5)], tmp_path / "a.png", columns=3)
    assert pixels(tmp_path / "a.png").shape == (2 * 48, 3 * 40, 3)


def test_every_name_is_drawn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pages: dict[str, list[str]] = {}

    def keep(cells: list[tuple[np.ndarray, str]], path: Path, columns: int, colours: int) -> None:
        pages[path.stem] = [label for _, label in cells]
        assert len({picture.shape for picture, _ in cells}) == 1

    monkeypatch.setattr(preview, "write_cells", keep)
    for name in ("_place", "_part", "_hand_at"):
        monkeypatch.setattr(preview, name, _once(getattr(preview, name)))
    written = preview.write_names(tmp_path)
    assert [path.stem for path in written] == list(pages)
    assert tuple(pages["notation-places"]) == phonology.LOCATIONS
    assert tuple(pages["notation-parts"]) == phonology.PARTS
    assert pages["notation-shapes"] == list(HANDSHAPES)
    shown = " ".join(pages["notation-movements"])
    kinds = [f"path={kind}" for kind in phonology.PATHS if kind != "none"] + [f":{plane}" for plane in phonology.PLANES]
    kinds += [f"hands={kind}" for kind in phonology.HANDS if kind != "one"] + [
        f"local={kind}" for kind in phonology.LOCALS
    ]
    kinds += [f"head={kind}" for kind in phonology.HEAD] + [f"trunk={kind}" for kind in phonology.TRUNK]
    kinds += ["times=", "return=", "step=", "keep=touch", "w.path="]
    assert [kind for kind in kinds if kind not in shown] == []


def _once(draw_one: Callable[..., np.ndarray]) -> Callable[..., np.ndarray]:
    """The same picture for every name: each is drawn by the same code, which takes a while."""
    made: list[np.ndarray] = []

    def first(*arguments: object) -> np.ndarray:
        if not made:
            made.append(draw_one(*arguments))
        return made[0]

    return first


@pytest.mark.parametrize("name", ["chin", "base-palm", "elbow-weak", "space-far", "locus:2"])
def test_a_place_is_a_dot_in_its_picture(name: str) -> None:
    found = dots(preview._place(name).astype(int))
    halves = np.array_split(found, 2, axis=1) if name.startswith(("space", "locus")) else [found]
    assert all(10 < half.sum() < 120 for half in halves)


def test_the_examples_show_what_they_say() -> None:
    for sign in notation.read(FOLDER / "examples.signs").values():
        key = sign.source.partition("=")[0]
        assert key in ("path", "times", "hands", "w.path", "keep")
        if key == "hands":
            assert sign.hands == sign.source.partition("=")[2]


def test_the_page_names_everything_and_its_pictures_are_small() -> None:
    page = (DOCS / "notation.md").read_text(encoding="utf-8")
    words = set(page.replace("`", " ").replace(":", " : ").split()) | set(page.replace("`", " ").split())
    names = [*phonology.LOCATIONS, *phonology.PARTS, *HANDSHAPES, *phonology.LOCALS, *phonology.HEAD, *phonology.TRUNK]
    names += [*phonology.PLANES, *phonology.HANDS, *phonology.DIRECTIONS]
    assert [name for name in names if name not in words] == []
    assert all(f"`{kind}" in page for kind in phonology.PATHS)
    assert all(f"{key}=" in page for key in notation._KEYS)
    assert len(page.split()) <= 1650
    pictures = list((DOCS / "images").glob("notation-*.png"))
    assert len(pictures) == 4
    assert sum(path.stat().st_size for path in pictures) < 600_000


def test_preview_columns_are_limited(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(preview, "_MOST_COLUMNS", 2)
    write_preview(planner.synthesize_word(SIGNS["BOOK"]), tmp_path / "a.png", size=40)
    assert pixels(tmp_path / "a.png").shape[1] == 80
