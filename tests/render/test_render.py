"""Pictures: what is drawn is where it is, what is nearer is before, films keep time, files are whole."""

from __future__ import annotations

import shutil
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image, ImageSequence

from conftest import random_clip
from signsplice.body.capsules import body_capsules, capsule_ends
from signsplice.body.mesh import CLOTHES, bind_pose, body_mesh
from signsplice.body.surface_nets import surface
from signsplice.errors import InputError, MissingExtraError
from signsplice.motion import kinematics, rotation
from signsplice.motion.clip import Clip
from signsplice.render import film, sheet
from signsplice.render import page as page_
from signsplice.render.film import Mark, gif_timing, write
from signsplice.render.page import _lettering, caption
from signsplice.render.picture import draw, draw_hand, posed, scene
from signsplice.render.raster import Canvas, Pixels, lit
from signsplice.render.sheet import sheet_frames

RED, BLUE = (0.9, 0.1, 0.1), (0.1, 0.1, 0.9)


def ball(centre: tuple[float, float, float], radius: float) -> tuple[Pixels, Pixels, NDArray[np.intp]]:
    """A ball's vertices, normals and triangles; pixels right, up, towards the viewer."""
    middle = np.array(centre)
    low, high = middle - radius - 1.0, middle + radius + 1.0
    made = surface(lambda at: np.linalg.norm(at - middle, axis=-1) - radius, low, high, 0.15 * radius)
    return made[0].astype(np.float32), made[1].astype(np.float32), made[2].astype(np.intp)


def canvas_with(*balls: tuple[tuple[float, float, float], float, tuple[float, float, float]]) -> Canvas:
    canvas = Canvas(100, 80)
    for group, (centre, radius, tint) in enumerate(balls):
        points, normals, triangles = ball(centre, radius)
        tints = np.tile(np.array(tint, np.float32), (len(triangles), 1))
        canvas.mesh(points, lit(normals), triangles, tints, np.full(len(triangles), group, np.int16))
    return canvas


def test_a_ball_covers_its_silhouette_and_is_as_deep_as_it_is() -> None:
    canvas = canvas_with(((30.0, 30.0, 5.0), 20.0, RED))
    rows, columns = np.mgrid[0:80, 0:100]
    away = np.hypot(columns - 30.0, (80.0 - rows) - 30.0)
    assert (canvas.group[away < 19.4] == 0).all(), "a hole in it"
    assert (canvas.group[away > 20.6] == -1).all()
    inner = away < 17.0
    assert np.abs(canvas.depth[inner] - (5.0 + np.sqrt(400.0 - away[inner] ** 2))).max() < 0.5


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_the_nearer_thing_is_seen(order: tuple[int, int]) -> None:
    near, far = ((50.0, 40.0, 30.0), 8.0, RED), ((50.0, 40.0, 0.0), 20.0, BLUE)
    canvas = canvas_with(*[(near, far)[i] for i in order])
    assert canvas.colour[40, 50, 0] > 2.0 * canvas.colour[40, 50, 2]
    assert canvas.colour[40, 66, 2] > 2.0 * canvas.colour[40, 66, 0]


def test_triangles_of_every_size_are_drawn_as_pixel_by_pixel() -> None:
    rng = np.random.default_rng(0)
    centres = rng.uniform(-10.0, 110.0, (60, 1, 3))
    points = (centres + rng.normal(size=(60, 3, 3)) * 10.0 ** rng.uniform(-0.5, 1.4, (60, 1, 1))).astype(np.float32)
    light = rng.uniform(0.2, 1.0, 180).astype(np.float32)
    triangles, groups = np.arange(180).reshape(60, 3), np.arange(60).astype(np.int16)
    canvas = Canvas(100, 80)
    canvas.mesh(points.reshape(-1, 3), light, triangles, np.ones((60, 3), np.float32), groups)
    depth, group, shade = np.full((80, 100), -np.inf), np.full((80, 100), -1), np.zeros((80, 100))
    for n, corners in enumerate(points.astype(float)):
        edges = np.stack([corners[1] - corners[0], corners[2] - corners[0]], axis=1)[:2]
        if np.linalg.det(edges) <= 0.0:  # seen from inside
            continue
        for row, column in product(range(80), range(100)):
            second, third = np.linalg.solve(edges, np.array([column, 80.0 - row]) - corners[0, :2])
            shares = np.array([1.0 - second - third, second, third])
            if (shares >= 0.0).all() and shares @ corners[:, 2] > depth[row, column]:
                depth[row, column], group[row, column] = shares @ corners[:, 2], n
                shade[row, column] = shares @ light[3 * n : 3 * n + 3]
    same = canvas.group == group
    assert len(np.unique(group)) > 10
    assert same.mean() > 0.998, "but for pixels on an edge"
    seen = same & (group >= 0)
    assert np.abs(canvas.depth[seen] - depth[seen]).max() < 0.05
    assert np.abs(canvas.colour[seen][:, 0] - shade[seen]).max() < 0.01


def test_nothing_in_sight_draws_nothing() -> None:
    canvas = canvas_with(((500.0, 40.0, 0.0), 8.0, RED))
    assert (canvas.group == -1).all()
    assert (canvas.finish(step=5.0, near=1.0, far=0.0) == canvas.finish(step=5.0, near=1.0, far=0.0)[0, 0]).all()


def test_outlines_stand_behind_edges_only() -> None:
    near, far = ((50.0, 40.0, 40.0), 6.0, RED), ((50.0, 40.0, 0.0), 30.0, BLUE)
    both = canvas_with(near, far).finish(step=5.0, near=40.0, far=0.0).astype(int)
    alone = canvas_with(far).finish(step=5.0, near=40.0, far=0.0).astype(int)
    assert both[20, 28, 2] < 0.7 * alone[20, 28, 2]
    assert abs(both[20, 33, 2] - alone[20, 33, 2]) <= 2


def test_the_skin_is_carried_by_its_joints(words: dict[str, Clip]) -> None:
    """Against linear blend skinning written out for single vertices."""
    clip = words["SIGN"]
    ready = scene(clip)
    points, normals = posed(ready, 30)
    turns, places = kinematics.forward(clip)
    bound_turns, bound_places = bind_pose(clip.skeleton)
    bound_turns = rotation.to_matrix(bound_turns)
    vertices = np.concatenate([thing.vertices for thing in body_mesh(clip.skeleton)])
    joints = np.concatenate([thing.joints for thing in body_mesh(clip.skeleton)])
    weights = np.concatenate([thing.weights for thing in body_mesh(clip.skeleton)])
    for n in np.random.default_rng(0).integers(len(vertices), size=200):
        world = np.zeros(3)
        for joint, weight in zip(joints[n], weights[n], strict=True):
            local = bound_turns[joint].T @ (vertices[n] - bound_places[joint])
            world += weight * (turns[30, joint] @ local + places[30, joint])
        expected = ready.axes @ (world - ready.origin) / ready.height
        assert np.abs(points[n] - expected).max() < 1e-5
    assert np.abs(np.linalg.norm(normals, axis=1) - 1.0).max() < 1e-5


def test_the_body_follows_the_joints(words: dict[str, Clip]) -> None:
    clip = words["HELLO"]
    shape = body_capsules(clip.skeleton)
    rotations, positions = kinematics.forward(clip)
    starts, ends = capsule_ends(shape, rotations, positions)
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
        hands = np.unique(ready.skin.triangles[ready.skin.hands != ""])
        for frame in range(0, len(clip), 4):
            at = posed(ready, frame)[0][hands]
            assert (at[:, 0] > left).all()
            assert (at[:, 0] < right).all()
            assert (at[:, 1] > bottom).all()
            assert (at[:, 1] < top).all()


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
    with Image.open(tmp_path / "a.png") as page:
        pixels = np.asarray(page.convert("RGB"))
    amber = np.all(pixels == (222, 142, 32), axis=-1)
    cell = sheet.cell_size(hands=True)[0]
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


def test_a_transitions_caption_names_the_words_it_joins() -> None:
    marks = [Mark("sign", "I", 0, 20), Mark("transition", "", 20, 28), Mark("sign", "DEAF", 28, 51)]
    assert caption(marks, 3) == ("I", False)
    assert caption(marks, 20) == ("I > DEAF", True)
    assert caption(marks[1:], 20) == ("transition", True)
    assert caption(marks, 99) == ("", False)


def test_limbs_hang_together_where_frames_give_other_bone_lengths(words: dict[str, Clip]) -> None:
    """A file's positions win over its OFFSETs, which may even be zero; the picture is that of the bones as moved."""
    clip = words["HELLO"]
    size = (len(clip), len(clip.skeleton), 3)
    moved = np.broadcast_to(clip.skeleton.offsets, size)
    plain = draw(scene(clip), 30, 160, 160).astype(int)
    for share in (0.0, 0.8):
        skeleton = replace(clip.skeleton, offsets=clip.skeleton.offsets * share)
        other = draw(scene(replace(clip, skeleton=skeleton, translations=moved)), 30, 160, 160)
        assert np.mean(np.abs(plain - other) > 8) < 0.002


def test_metres_and_centimetres_give_the_same_pixels(words: dict[str, Clip]) -> None:
    clip = words["SIGN"]
    sites = tuple(replace(site, offset=site.offset * 0.01) for site in clip.skeleton.end_sites)
    skeleton = replace(clip.skeleton, offsets=clip.skeleton.offsets * 0.01, end_sites=sites)
    other = replace(clip, skeleton=skeleton, root_positions=clip.root_positions * 0.01)
    assert np.array_equal(draw(scene(clip), 30, 120, 120), draw(scene(other), 30, 120, 120))


def test_a_hand_before_the_chest_is_before_it_from_the_side(words: dict[str, Clip]) -> None:
    """From the signer's left, forward is at the viewer's left: a signing hand stands there, before the trunk."""
    side, front = scene(words["SIGN"], "side"), scene(words["SIGN"])
    shirt = np.unique(side.skin.triangles[(side.skin.tints == np.array(CLOTHES["shirt"], np.float32)).all(axis=1)])
    trunk = shirt[np.isin(side.skin.weights[shirt].toarray().argmax(axis=1), range(4))]  # hips and spine
    assert len(trunk) > 1000
    assert side.hands[30, :, 0].max() < posed(side, 30)[0][trunk, 0].min()
    assert front.hands[30, :, 2].min() > posed(front, 30)[0][trunk, 2].max()


@pytest.mark.parametrize("name", ["a.png", "a.gif", "a.mp4"])
def test_an_interrupted_film_leaves_what_was_there(words: dict[str, Clip], tmp_path: Path, name: str) -> None:
    if name.endswith("mp4") and shutil.which("ffmpeg") is None:
        pytest.skip("no ffmpeg here")
    (tmp_path / name).write_text("old")

    def stop(done: int, total: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write(words["I"][:4], tmp_path / name, progress=stop, size=None if name == "a.png" else (96, 96))
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert (tmp_path / name).read_text() == "old"


def test_sizes_and_qualities_that_no_film_has_are_refused(words: dict[str, Clip], tmp_path: Path) -> None:
    for name, size in (("a.mp4", (97, 96)), ("a.gif", (0, 96)), ("a.png", (96, 96))):
        with pytest.raises(InputError, match="expected even width and height"):
            write(words["I"][:3], tmp_path / name, size=size)
    with pytest.raises(InputError, match="crf 99"):
        write(words["I"][:3], tmp_path / "a.mp4", crf=99)
    assert list(tmp_path.iterdir()) == []


def test_letters_that_no_font_has_lose_their_accents(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("signsplice.render.page._FONTS", ("no such font.ttf",))
    assert _lettering("D\N{LATIN CAPITAL LETTER E WITH CARON}KOVAT", 15)[0] == "DEKOVAT"
    assert _lettering("\N{CJK UNIFIED IDEOGRAPH-4F60}-1", 15)[0] == "?-1"
    assert _lettering("THANK-YOU", 15)[0] == "THANK-YOU"


def test_the_timeline_is_in_sight_in_signs_and_transitions(words: dict[str, Clip]) -> None:
    """Spans stand at the bottom in their order, and the playhead where playing is, whatever the frame is."""
    clip, size = words["I"][:20], (320, 240)
    marks = [Mark("sign", "I", 0, 10), Mark("transition", "", 10, 14), Mark("sign", "I", 14, 20)]
    for frame, page in zip((2, 12), film._pictures(clip, scene(clip), size, (2, 12), marks), strict=True):
        pixels = np.asarray(page)
        row = pixels[size[1] - 2]
        spans = [tuple(row[x]) for x in (150, 170, 215, 235)]
        assert spans == [page_.SIGN, page_.TRANSITION, page_.TRANSITION, page_.SIGN]
        assert tuple(row[16 * frame + 8]) == page_.INK
        assert (tuple(pixels[0, 100]) == page_.TRANSITION) == (frame == 12)


def test_a_gif_keeps_the_tint_of_fingertips(words: dict[str, Clip], tmp_path: Path) -> None:
    """Every frame comes out in nearly its own colours, though all share one palette."""
    clip = words["HELLO"][:30]
    write(clip, tmp_path / "a.gif", size=(240, 240))
    frames, _ = gif_timing(len(clip), clip.fps)
    with Image.open(tmp_path / "a.gif") as gif:
        gif.seek(len(frames) - 1)
        shown = np.asarray(gif.convert("RGB")).astype(int)[:204]
    drawn = draw(scene(clip), frames[-1], 240, 204).astype(int)
    pink = drawn[..., 0] - drawn[..., 1] > 60
    assert pink.sum() > 30
    assert np.abs(shown - drawn)[pink].mean() < 8.0
