"""Pictures: what is drawn is where it is, what is nearer is before, films keep time, files are whole."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageSequence

from conftest import random_clip
from signsplice.errors import InputError, MissingExtraError
from signsplice.motion import kinematics
from signsplice.motion.body import body, place
from signsplice.motion.clip import Clip
from signsplice.render import film
from signsplice.render.film import Mark, gif_timing, sheet_frames, write
from signsplice.render.picture import draw, draw_hand, scene
from signsplice.render.raster import Canvas

RED, BLUE = (0.9, 0.1, 0.1), (0.1, 0.1, 0.9)


def canvas_with(*capsules: tuple[list[float], list[float], tuple[float, float], tuple[float, float, float]]) -> Canvas:
    canvas = Canvas(100, 80)
    for group, (start, end, radii, colour) in enumerate(capsules):
        canvas.capsule(np.array(start), np.array(end), radii, colour, group)
    return canvas


def test_a_capsule_covers_its_silhouette() -> None:
    canvas = canvas_with(([30.0, 40.0, 0.0], [70.0, 40.0, 0.0], (10.0, 5.0), RED))
    rows, columns = np.nonzero(canvas.group == 0)
    assert abs(columns.min() - 20) <= 1
    assert abs(columns.max() - 75) <= 1
    assert abs(rows.min() - 30) <= 1
    assert abs(rows.max() - 50) <= 1
    assert canvas.depth[40, 30] == pytest.approx(10.0, abs=0.1), "its front is a radius before its axis"


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_the_nearer_capsule_is_seen(order: tuple[int, int]) -> None:
    near = ([50.0, 20.0, 30.0], [50.0, 60.0, 30.0], (6.0, 6.0), RED)
    far = ([20.0, 40.0, 0.0], [80.0, 40.0, 0.0], (6.0, 6.0), BLUE)
    canvas = canvas_with(*[(near, far)[i] for i in order])
    pixel = canvas.colour[40, 50]
    assert pixel[0] > 2.0 * pixel[2]


def test_a_capsule_seen_end_on_shows_its_near_end() -> None:
    canvas = canvas_with(([50.0, 40.0, 0.0], [50.0, 40.0, 40.0], (10.0, 4.0), RED))
    assert canvas.depth[40, 50] == pytest.approx(44.0, abs=1.0)
    assert canvas.group[40, 59] == 0, "its thick far end still shows around"


def test_outlines_stand_behind_edges_only() -> None:
    near = ([50.0, 20.0, 30.0], [50.0, 60.0, 30.0], (6.0, 6.0), RED)
    far = ([0.0, 40.0, 0.0], [100.0, 40.0, 0.0], (20.0, 20.0), BLUE)
    both = canvas_with(near, far).finish(step=5.0, near=40.0, far=0.0).astype(int)
    alone = canvas_with(far).finish(step=5.0, near=40.0, far=0.0).astype(int)
    assert both[20, 28, 2] < 0.7 * alone[20, 28, 2]
    assert abs(both[20, 10, 2] - alone[20, 10, 2]) <= 2


def test_the_body_follows_the_joints(words: dict[str, Clip]) -> None:
    clip = words["HELLO"]
    shape = body(clip.skeleton)
    rotations, positions = kinematics.forward(clip)
    starts, ends = place(shape, rotations, positions)
    index = clip.skeleton.index
    for c, (part, side) in enumerate(zip(shape.parts, shape.sides, strict=True)):
        if part == "Index" and side == "right" and shape.joints[c] == index["mixamorig:RightHandIndex1"]:
            assert np.allclose(starts[:, c], positions[:, index["mixamorig:RightHandIndex1"]])
            assert np.allclose(ends[:, c], positions[:, index["mixamorig:RightHandIndex2"]])
            break
    else:
        pytest.fail("no index finger")
    fingers = {(part.removesuffix("Tip"), side) for part, side in zip(shape.parts, shape.sides, strict=True)}
    assert {
        (finger, side) for finger in ("Thumb", "Index", "Middle", "Ring", "Little") for side in ("left", "right")
    } <= fingers
    assert (shape.radii > 0.0).all()


def test_every_hand_of_every_frame_is_in_the_picture(words: dict[str, Clip]) -> None:
    for clip in words.values():
        ready = scene(clip)
        left, right, bottom, top = ready.window
        hands = np.array(
            [
                side != "" and part not in ("sleeve", "leg", "shoe")
                for part, side in zip(ready.body.parts, ready.body.sides, strict=True)
            ]
        )
        for ends in (ready.starts[:, hands], ready.ends[:, hands]):
            assert (ends[..., 0] > left).all()
            assert (ends[..., 0] < right).all()
            assert (ends[..., 1] > bottom).all()
            assert (ends[..., 1] < top).all()


def test_the_signers_right_hand_is_at_the_viewers_left(words: dict[str, Clip]) -> None:
    ready = scene(words["HELLO"])
    assert ready.hands[30, 1, 0] < ready.hands[30, 0, 0]
    assert ready.hands[30, 1, 1] > ready.hands[30, 0, 1] + 0.3, "and it is the one that is raised"


def test_unit_place_and_facing_do_not_change_the_picture(words: dict[str, Clip]) -> None:
    from signsplice.motion import rotation

    clip = words["SIGN"]
    turn = rotation.exp([0.0, 2.0, 0.0])
    local = np.array(clip.local_rotations)
    local[:, 0] = rotation.multiply(turn, local[:, 0])
    skeleton = replace(
        clip.skeleton,
        offsets=clip.skeleton.offsets * 0.01,
        end_sites=tuple(replace(site, offset=site.offset * 0.01) for site in clip.skeleton.end_sites),
    )
    roots = (rotation.rotate(turn, clip.root_positions) + 55.0) * 0.01
    other = replace(clip, skeleton=skeleton, local_rotations=local, root_positions=roots)
    a, b = (draw(scene(c), 30, 160, 160).astype(int) for c in (clip, other))
    assert np.mean(np.abs(a - b) > 8) < 0.002


def test_hands_are_large_enough_and_differ_by_handshape(words: dict[str, Clip]) -> None:
    """A flat hand and a pointing one are plainly different pictures of a plainly visible hand."""
    flat, index = (draw_hand(scene(words[w]), f, "right", 76).astype(int) for w, f in (("HELLO", 28), ("I", 24)))
    paper = np.array([244, 241, 236])
    for image in (flat, index):
        assert np.mean(np.abs(image - paper).max(axis=-1) > 20) > 0.08
    assert np.mean(np.abs(flat - index).max(axis=-1) > 20) > 0.05


def test_any_skeleton_can_be_drawn() -> None:
    clip = random_clip(0)
    image = draw(scene(clip), 3, 120, 120)
    assert image.shape == (120, 120, 3)
    assert len(np.unique(image.reshape(-1, 3), axis=0)) > 10
    with pytest.raises(InputError, match="no view 'top', expected one of front"):
        scene(clip, "top")


@pytest.mark.parametrize(
    ("n_frames", "fps"), [(1, 30.0), (47, 30.0), (100, 24.0), (313, 120.0), (50, 29.97), (90, 25.0)]
)
def test_films_keep_the_clips_own_time(n_frames: int, fps: float) -> None:
    frames, delays = gif_timing(n_frames, fps)
    assert len(frames) == len(delays)
    assert frames[0] == 0
    assert frames == sorted(set(frames))
    assert frames[-1] < n_frames
    assert abs(sum(delays) / 100.0 - n_frames / fps) <= 0.01
    assert min(delays) >= 1


def test_a_gif_has_the_frames_and_the_time(
    words: dict[str, Clip], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(film, "GIF_SIZE", (96, 96))
    clip = words["I"][10:40]
    steps: list[tuple[int, int]] = []
    write(
        clip, tmp_path / "a.gif", [Mark("sign", "I", 0, 30)], progress=lambda done, total: steps.append((done, total))
    )
    with Image.open(tmp_path / "a.gif") as gif:
        durations = [page.info["duration"] for page in ImageSequence.Iterator(gif)]
    assert len(durations) == 25
    assert abs(sum(durations) - 1000) <= 10
    assert steps[-1] == (25, 25)


def test_a_sheet_shows_every_seam_and_marks_it(words: dict[str, Clip], tmp_path: Path) -> None:
    marks = [Mark("sign", "I", 0, 20), Mark("transition", "", 20, 28), Mark("sign", "I", 28, 51)]
    frames = sheet_frames(51, marks)
    assert {0, 19, 20, 27, 28, 50} <= set(frames)
    assert frames == sorted(set(frames))
    assert sheet_frames(3, [Mark("transition", "", 0, 3)]) == [0, 1, 2]
    write(
        words["I"][:12],
        tmp_path / "a.png",
        [Mark("sign", "I", 0, 5), Mark("transition", "", 5, 7), Mark("sign", "I", 7, 12)],
    )
    with Image.open(tmp_path / "a.png") as sheet:
        pixels = np.asarray(sheet.convert("RGB"))
    amber = np.all(pixels == (222, 142, 32), axis=-1)
    cell = film._CELL[0] + 8
    marked = [bool(amber[2, n * cell + 20]) for n in range(8)]
    marks = [Mark("transition", "", 5, 7)]
    assert marked == [5 <= frame < 7 for frame in sheet_frames(12, marks)[:8]]
    assert any(marked)
    assert not all(marked)


def test_films_in_mp4_need_an_ffmpeg(words: dict[str, Clip], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setitem(__import__("sys").modules, "imageio_ffmpeg", None)
    with pytest.raises(MissingExtraError, match="need an ffmpeg"):
        write(words["I"][:3], tmp_path / "a.mp4")
    assert list(tmp_path.iterdir()) == []


def test_an_ffmpeg_is_fed_every_frame(words: dict[str, Clip], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A stand-in ffmpeg that counts the bytes it gets; the real one is used where it is found."""
    import sys

    fake = tmp_path / "bin" / "ffmpeg"
    fake.parent.mkdir()
    fake.write_text(
        f"#!{sys.executable}\nimport sys\nopen(sys.argv[-1], 'w').write(str(len(sys.stdin.buffer.read())))\n"
    )
    fake.chmod(0o755)
    monkeypatch.setenv("PATH", str(fake.parent))
    monkeypatch.setattr(film, "MP4_SIZE", (96, 64))
    write(words["I"][:5], tmp_path / "a.mp4")
    assert int((tmp_path / "a.mp4").read_text()) == 5 * 96 * 64 * 3
    fake.write_text(f"#!{sys.executable}\nimport sys\nsys.stderr.write('no such codec')\nsys.exit(3)\n")
    with pytest.raises(Exception, match="ffmpeg failed: no such codec"):
        write(words["I"][:5], tmp_path / "b.mp4")
    assert not (tmp_path / "b.mp4").exists()


def test_other_suffixes_are_refused(words: dict[str, Clip], tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"pictures end in \.png, \.gif, \.mp4, not \.jpg"):
        write(words["I"], tmp_path / "a.jpg")
