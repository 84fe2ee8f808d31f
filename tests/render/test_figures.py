"""Pictures of figures in files: their colours, textures and faces, alike on EGL and in numpy, by every command."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from signsplice.body.capsules import Avatar
from signsplice.cli import main
from signsplice.errors import MissingExtraError
from signsplice.formats import glb, load, save
from signsplice.formats.avatar import pack, read_avatar, with_figure
from signsplice.formats.gltf_document import chunks
from signsplice.motion import Clip
from signsplice.motion.face import Face
from signsplice.render import film, gpu, picture
from signsplice.render.picture import draw, make_scene

RED, PAPER = (200, 30, 20), (244, 241, 236)


@pytest.fixture(params=["egl", "numpy"])
def renderer(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    if request.param == "numpy":
        monkeypatch.setattr(gpu, "renderer", lambda: None)
    elif gpu.renderer() is None:
        pytest.skip("no EGL here: install libegl1 and libgl1-mesa-dri")
    return str(request.param)


def open_mouthed(clip: Clip) -> Clip:
    """The clip with a mouth that opens in its second half."""
    return replace(
        clip, face=Face(("jawOpen",), np.repeat([[0.0], [1.0]], [len(clip) // 2, -(-len(clip) // 2)], axis=0))
    )


def textured(content: bytes, kind: str = "PNG", alpha: int = 255, **material: object) -> bytes:
    """A file of ours whose every surface has a red picture."""
    text, blob = chunks("made", content)
    document, image = json.loads(text), BytesIO()
    Image.new("RGBA" if alpha < 255 else "RGB", (8, 8), (*RED, alpha)[: 3 + (alpha < 255)]).save(
        image, kind, **({"lossless": True} if kind == "WEBP" else {})
    )
    for bytes_ in (image.getvalue(), bytes(8 * 70_000)):
        document["bufferViews"].append({"buffer": 0, "byteOffset": len(blob), "byteLength": len(bytes_)})
        blob += bytes_ + b"\0" * (-len(bytes_) % 4)
    n_views, n_accessors = len(document["bufferViews"]), len(document["accessors"])
    document["accessors"].append({"bufferView": n_views - 1, "componentType": 5126, "count": 70_000, "type": "VEC2"})
    document["buffers"][0]["byteLength"] = len(blob)
    document["images"] = [{"bufferView": n_views - 2, "mimeType": f"image/{kind.lower()}"}]
    source = {"extensions": {"EXT_texture_webp": {"source": 0}}} if kind == "WEBP" else {"source": 0}
    document["textures"] = [source]
    for row in document["materials"]:
        row |= {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}, **material}
    for mesh in document["meshes"]:
        for primitive in mesh["primitives"]:
            primitive["attributes"]["TEXCOORD_0"] = n_accessors
    return pack(document, blob)


def figure_of(content: bytes, folder: Path) -> Clip:
    path = folder / "figure.glb"
    path.write_bytes(content)
    return with_figure(load(path), path)


def shown(image: picture.Image) -> np.ndarray:
    return np.asarray(np.abs(image.astype(int) - PAPER).max(axis=-1) > 12)


@pytest.mark.parametrize("kind", ["PNG", "JPEG", "WEBP"])
def test_a_texture_in_a_file_colours_its_figure(
    renderer: str, kind: str, words: dict[str, Clip], tmp_path: Path
) -> None:
    clip = figure_of(textured(glb.encode(words["I"]), kind), tmp_path)
    assert isinstance(clip.skeleton, Avatar)
    image = draw(make_scene(clip), 20, 160, 160).astype(float)
    body = shown(image.astype(np.uint8))
    red, green, blue = np.median(image[body], axis=0)
    assert body.mean() > 0.1
    assert red > 110
    assert abs(green / red - RED[1] / RED[0]) < 0.05
    assert abs(blue / red - RED[2] / RED[0]) < 0.05


def test_what_alpha_hides_is_not_drawn(renderer: str, words: dict[str, Clip], tmp_path: Path) -> None:
    content = glb.encode(words["I"])
    for alpha, mode, is_shown in (
        (100, "OPAQUE", True),
        (100, "MASK", False),
        (100, "BLEND", False),
        (200, "MASK", True),
    ):
        clip = figure_of(textured(content, alpha=alpha, alphaMode=mode), tmp_path)
        assert shown(draw(make_scene(clip), 20, 80, 80)).any() == is_shown


def test_both_renderers_show_the_same(words: dict[str, Clip], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if gpu.renderer() is None:
        pytest.skip("no EGL here: install libegl1 and libgl1-mesa-dri")
    for clip in (words["SIGN"], figure_of(textured(glb.encode(words["SIGN"])), tmp_path)):
        for view in ("front", "side"):
            scene = make_scene(clip, view)
            on_egl = draw(scene, 30, 240, 200)
            with monkeypatch.context() as patch:
                patch.setattr(gpu, "renderer", lambda: None)
                in_numpy = draw(scene, 30, 240, 200)
            a, b = shown(on_egl), shown(in_numpy)
            assert (a & b).sum() > 0.96 * (a | b).sum()
            assert np.abs(on_egl.astype(int) - in_numpy)[a & b].mean() < 14.0, "but for shadows"


def test_our_own_file_is_drawn_as_the_clip_is(renderer: str, words: dict[str, Clip], tmp_path: Path) -> None:
    clip = words["SIGN"]
    written = figure_of(glb.encode(clip), tmp_path)
    assert isinstance(written.skeleton, Avatar)
    a, b = (draw(make_scene(one), 30, 200, 200).astype(int) for one in (clip, written))
    assert np.mean(np.abs(a - b).max(axis=-1) > 24) < 0.01


def test_a_face_in_a_file_opens_its_mouth(renderer: str, words: dict[str, Clip], tmp_path: Path) -> None:
    clip = figure_of(glb.encode(open_mouthed(words["I"][:2])), tmp_path)
    scene = make_scene(
        replace(clip, local_rotations=clip.local_rotations[[0, 0]], root_positions=clip.root_positions[[0, 0]])
    )
    still, opened = (draw(scene, frame, 240, 240).astype(int) for frame in (0, 1))
    moved = np.argwhere(np.abs(still - opened).max(axis=-1) > 20)
    assert 10 < len(moved) < 700
    assert moved[:, 0].max() < 80, "only in the face"


def test_an_avatars_own_joints_carry_its_figure(words: dict[str, Clip], tmp_path: Path) -> None:
    """Every vertex lies where the file's own skins put it: here those of the mannequin."""
    clip = words["HELLO"]
    scene, written = make_scene(clip), make_scene(figure_of(glb.encode(clip), tmp_path))
    a, b = (
        picture.deform_skin(one, 25)[0] - one.axes @ (one.positions[25, 0] - one.origin) / one.height
        for one in (scene, written)
    )
    assert len(a) == len(b)
    assert max(np.abs(b - point).sum(axis=1).min() for point in a[::97]) < 3e-3


@pytest.fixture
def signsplice(
    words: dict[str, Clip], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[..., str]:
    """Runs the command line in a folder with red.glb, a figure in red; returns standard error."""
    monkeypatch.chdir(tmp_path)
    save(words["I"], "I.bvh")
    save(words["I"], "J.bvh")
    Path("red.glb").write_bytes(textured(glb.encode(words["I"][:3])))

    def call(*arguments: str) -> str:
        monkeypatch.setattr(sys, "argv", ["signsplice", *arguments])
        with suppress(SystemExit):
            main()
        return capsys.readouterr().err

    return call


def is_red(path: str) -> bool:
    with Image.open(path) as image:
        pixels = np.asarray(image.convert("RGB")).astype(int)
    return bool(np.mean((pixels[..., 0] > 90) & (pixels[..., 0] > 3 * pixels[..., 1])) > 0.05)


def test_render_shows_the_files_own_figure(signsplice: Callable[..., str]) -> None:
    signsplice("render", "red.glb", "red.png")
    signsplice("convert", "red.glb", "converted.png")
    signsplice("render", "I.bvh", "house.png")
    assert [is_red(name) for name in ("red.png", "converted.png", "house.png")] == [True, True, False]


def test_a_figure_that_cannot_be_read_is_named_and_the_mannequin_drawn(signsplice: Callable[..., str]) -> None:
    text, blob = chunks("red", Path("red.glb").read_bytes())
    document = json.loads(text)
    for mesh in document["meshes"]:
        for primitive in mesh["primitives"]:
            primitive["indices"] = 1000
    Path("broken.glb").write_bytes(pack(document, blob))
    err = signsplice("render", "broken.glb", "broken.png")
    assert "accessor 1000 is no such" in err
    assert "the mannequin is drawn instead" in err
    assert not is_red("broken.png")


@pytest.mark.parametrize(
    "call",
    [
        ("render", "I.bvh", "a.gif"),
        ("splice", "I.bvh", "J.bvh", "-o", "a.gif"),
        ("sentence", "I", "-o", "a.gif"),
        ("inbetween", "I.bvh", "--gap", "20:24", "-o", "a.gif"),
    ],
    ids=lambda call: call[0],
)
def test_every_command_that_draws_has_an_avatar_a_view_and_a_size(
    call: tuple[str, ...], signsplice: Callable[..., str], monkeypatch: pytest.MonkeyPatch
) -> None:
    views: list[str] = []

    def first_frames(clip: Clip, view: str = "front") -> picture.Scene:
        views.append(view)
        return make_scene(clip, view)

    monkeypatch.setattr(film, "make_scene", first_frames)
    monkeypatch.setattr(film, "gif_timing", lambda n_frames, fps: ([0, 1], [4, 4]))
    assert "error" not in signsplice(*call, "--avatar", "red.glb", "--view", "three-quarter", "--size", "160x144")
    with Image.open("a.gif") as image:
        assert image.size == (160, 144)
    assert is_red("a.gif")
    assert views == ["three-quarter"]
    assert "expected WIDTHxHEIGHT" in signsplice(*call, "--size", "big")
    other = [part.replace("a.gif", "a.bvh") for part in call]
    assert "error: a.bvh" in signsplice(*other, "--size", "96x80")
    assert not Path("a.bvh").exists()


def test_a_machine_without_egl_is_told_once_what_would_be_faster(
    signsplice: Callable[..., str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gpu, "_OF_THREAD", type("Fresh", (), {})())
    monkeypatch.setattr(gpu.Renderer, "__init__", lambda self: (_ for _ in ()).throw(Exception("no display")))
    err = signsplice("render", "red.glb", "a.png")
    assert err.count("signsplice[video]") == 1
    assert err.count("\n") == 1
    assert is_red("a.png")


def test_textures_need_pillow(words: dict[str, Clip], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = make_scene(figure_of(textured(glb.encode(words["I"][:3])), tmp_path))
    for name in [name for name in sys.modules if name.partition(".")[0] == "PIL"]:
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(MissingExtraError, match=r"pictures need Pillow: pip install '\.\[video\]'"):
        draw(scene, 0, 64, 64)


def test_an_avatar_that_was_read_has_its_textures(tmp_path: Path, words: dict[str, Clip]) -> None:
    (tmp_path / "red.glb").write_bytes(textured(glb.encode(open_mouthed(words["I"][:4])), doubleSided=True))
    avatar = read_avatar(tmp_path / "red.glb")
    assert all(part.texture[:4] == b"\x89PNG" and part.uvs is not None and part.both_sides for part in avatar.mesh)
    assert {name for part in avatar.mesh for name in part.morphs} == {"jawOpen"}
