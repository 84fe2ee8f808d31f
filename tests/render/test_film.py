"""Films and contact sheets: frames, timing, marks and captions, written whole or not at all."""

from __future__ import annotations

import shutil
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageSequence

from signsplice.errors import InputError, MissingExtraError, SignspliceError
from signsplice.motion import Clip
from signsplice.render import film, sheet
from signsplice.render.film import Mark, gif_timing, write_pictures
from signsplice.render.picture import draw, make_scene
from signsplice.render.sheet import _text_and_font, caption, sheet_frames


@pytest.mark.parametrize(
    ("n_frames", "fps"), [(1, 30.0), (47, 30.0), (100, 24.0), (313, 120.0), (50, 29.97), (90, 25.0)]
)
def test_a_gifs_delays_add_up_to_the_clips_duration(n_frames: int, fps: float) -> None:
    frames, delays = gif_timing(n_frames, fps)
    assert len(frames) == len(delays)
    assert frames[0] == 0
    assert frames == sorted(set(frames))
    assert frames[-1] < n_frames
    assert abs(sum(delays) / 100.0 - n_frames / fps) <= 0.01
    assert min(delays) >= 1


def test_a_gif_has_the_right_frames_and_duration(
    words: dict[str, Clip], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(film, "GIF_SIZE", (96, 96))
    clip = words["I"][10:40]
    steps: list[tuple[int, int]] = []
    write_pictures(
        clip, tmp_path / "a.gif", [Mark("sign", "I", 0, 30)], progress=lambda done, total: steps.append((done, total))
    )
    with Image.open(tmp_path / "a.gif") as gif:
        durations = [frame.info["duration"] for frame in ImageSequence.Iterator(gif)]
    assert len(durations) == 25
    assert abs(sum(durations) - 1000) <= 10
    assert steps[-1] == (25, 25)


def test_a_gif_keeps_the_tint_of_skin(words: dict[str, Clip], tmp_path: Path) -> None:
    """Frames keep nearly their own colours, though all share the palette of the first."""
    clip, ends = words["HELLO"], [0, 29]
    clip = replace(clip, local_rotations=clip.local_rotations[ends], root_positions=clip.root_positions[ends], fps=10.0)
    write_pictures(clip, tmp_path / "a.gif", size=(240, 240))
    frames, _ = gif_timing(len(clip), clip.fps)
    with Image.open(tmp_path / "a.gif") as gif:
        gif.seek(len(frames) - 1)
        shown = np.asarray(gif.convert("RGB")).astype(int)[:204]
    drawn = draw(make_scene(clip), frames[-1], 240, 204).astype(int)
    skin = drawn[..., 0] - drawn[..., 2] > 60
    assert skin.sum() > 300
    assert np.abs(shown - drawn)[skin].mean() < 8.0


def test_the_timeline_is_visible_in_signs_and_transitions(words: dict[str, Clip]) -> None:
    """Spans are drawn at the bottom in order, and the playhead at the frame shown."""
    clip, size = words["I"][:20], (320, 240)
    marks = [Mark("sign", "I", 0, 10), Mark("transition", "", 10, 14), Mark("sign", "I", 14, 18)]
    marks.append(Mark("retraction", "I", 18, 20))
    for frame, picture in zip((2, 12), film._pictures(clip, make_scene(clip), size, (2, 12), marks), strict=True):
        pixels = np.asarray(picture)
        row = pixels[size[1] - 2]
        spans = [tuple(row[x]) for x in (150, 170, 215, 235, 300)]
        assert spans == [sheet.SIGN, sheet.TRANSITION, sheet.TRANSITION, sheet.SIGN, sheet.RETRACTION]
        assert tuple(row[16 * frame + 8]) == sheet.INK
        assert (tuple(pixels[0, 100]) == sheet.TRANSITION) == (frame == 12)


def test_a_sheet_shows_and_marks_every_seam(words: dict[str, Clip], tmp_path: Path) -> None:
    marks = [Mark("sign", "I", 0, 20), Mark("transition", "", 20, 28), Mark("sign", "I", 28, 51)]
    frames = sheet_frames(51, marks)
    assert {0, 19, 20, 27, 28, 50} <= set(frames)
    assert frames == sorted(set(frames))
    assert sheet_frames(3, [Mark("transition", "", 0, 3)]) == [0, 1, 2]
    write_pictures(
        words["I"][:12],
        tmp_path / "a.png",
        [Mark("sign", "I", 0, 5), Mark("transition", "", 5, 7), Mark("sign", "I", 7, 12)],
    )
    with Image.open(tmp_path / "a.png") as image:
        pixels = np.asarray(image.convert("RGB"))
    amber = np.all(pixels == (222, 142, 32), axis=-1)
    cell = sheet.cell_size(hands=True)[0]
    marked = [bool(amber[2, n * cell + 20]) for n in range(8)]
    marks = [Mark("transition", "", 5, 7)]
    assert marked == [5 <= frame < 7 for frame in sheet_frames(12, marks)[:8]]
    assert any(marked)
    assert not all(marked)


def test_mp4_films_need_ffmpeg(words: dict[str, Clip], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(MissingExtraError, match="need an ffmpeg"):
        write_pictures(words["I"][:3], tmp_path / "a.mp4")
    assert list(tmp_path.iterdir()) == []


def test_ffmpeg_gets_every_frame(words: dict[str, Clip], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A stand-in for ffmpeg that writes the number of bytes it gets."""
    fake = tmp_path / "bin" / "ffmpeg"
    fake.parent.mkdir()
    fake.write_text(
        f"#!{sys.executable}\nimport sys\nopen(sys.argv[-1], 'w').write(str(len(sys.stdin.buffer.read())))\n"
    )
    fake.chmod(0o755)
    monkeypatch.setenv("PATH", str(fake.parent))
    monkeypatch.setattr(film, "MP4_SIZE", (96, 64))
    write_pictures(words["I"][:5], tmp_path / "a.mp4")
    assert int((tmp_path / "a.mp4").read_text()) == 5 * 96 * 64 * 3
    fake.write_text(f"#!{sys.executable}\nimport sys\nsys.stderr.write('no such codec')\nsys.exit(3)\n")
    with pytest.raises(SignspliceError, match="ffmpeg failed: no such codec"):
        write_pictures(words["I"][:5], tmp_path / "b.mp4")
    assert not (tmp_path / "b.mp4").exists()


@pytest.mark.parametrize("name", ["a.png", "a.gif", "a.mp4"])
def test_an_interrupted_film_leaves_the_old_file(words: dict[str, Clip], tmp_path: Path, name: str) -> None:
    if name.endswith("mp4") and shutil.which("ffmpeg") is None:
        pytest.skip("no ffmpeg here")
    (tmp_path / name).write_text("old")

    def interrupt(done: int, total: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_pictures(words["I"][:4], tmp_path / name, progress=interrupt, size=None if name == "a.png" else (96, 96))
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert (tmp_path / name).read_text() == "old"


def test_other_suffixes_are_refused(words: dict[str, Clip], tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"pictures end in \.png, \.gif, \.mp4, not \.jpg"):
        write_pictures(words["I"], tmp_path / "a.jpg")


def test_invalid_sizes_and_qualities_are_refused(words: dict[str, Clip], tmp_path: Path) -> None:
    for name, size in (("a.mp4", (97, 96)), ("a.gif", (0, 96)), ("a.png", (96, 96))):
        with pytest.raises(InputError, match="expected even width and height"):
            write_pictures(words["I"][:3], tmp_path / name, size=size)
    with pytest.raises(InputError, match="crf 99"):
        write_pictures(words["I"][:3], tmp_path / "a.mp4", crf=99)
    assert list(tmp_path.iterdir()) == []


def test_the_caption_of_a_transition_names_both_words_and_that_of_a_retraction_its_sign() -> None:
    marks = [Mark("sign", "I", 0, 20), Mark("transition", "", 20, 28), Mark("sign", "DEAF", 28, 51)]
    marks.append(Mark("retraction", "DEAF", 51, 60))
    assert caption(marks, 3) == ("I", sheet.INK)
    assert caption(marks, 20) == ("I > DEAF", sheet.TRANSITION)
    assert caption(marks[1:], 20) == ("transition", sheet.TRANSITION)
    assert caption(marks, 55) == ("DEAF", sheet.SIGN)
    assert caption(marks, 99) == ("", sheet.INK)


def test_letters_without_a_font_lose_their_accents(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("signsplice.render.sheet._FONTS", ("no such font.ttf",))
    assert _text_and_font("D\N{LATIN CAPITAL LETTER E WITH CARON}KOVAT", 15)[0] == "DEKOVAT"
    assert _text_and_font("\N{CJK UNIFIED IDEOGRAPH-4F60}-1", 15)[0] == "?-1"
    assert _text_and_font("THANK-YOU", 15)[0] == "THANK-YOU"
