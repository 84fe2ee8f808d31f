"""Faces in and out of files: CSV beside a clip, morph targets, expressions, archives."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import face_avatars
import signsplice as ss
from gltf_documents import ARM, document, load_document, rotating
from signsplice.errors import FormatError, LimitError
from signsplice.formats import ReadAs, glb, live_link, vrma
from signsplice.formats.gltf_face import lost_in, target_names, vrm_expressions
from signsplice.formats.gltf_writer import DocumentWriter
from signsplice.formats.reading import ReadLimits
from signsplice.motion import Clip, FloatArray
from signsplice.motion.face import ARKIT_CHANNELS, Face, shape_of
from signsplice_workshop.measure.faces import add_random_face, random_face

HEAD = "Timecode,BlendshapeCount," + ",".join(name[0].upper() + name[1:] for name in ARKIT_CHANNELS)
HEAD += "," + ",".join(live_link.ROTATIONS)


@pytest.fixture
def body(words: dict[str, Clip], tmp_path: Path) -> Path:
    """A clip of 30 frames, one second, without a face."""
    ss.save(words["HELLO"][:30], tmp_path / "HELLO.bvh")
    return tmp_path / "HELLO.bvh"


def live_link_csv(weights: FloatArray, first: int = 0, fps: int = 60) -> str:
    """A file as Live Link Face writes it, 61 values a row, that begins at a frame of the day."""
    lines = [HEAD]
    for k, row in enumerate(weights, first):
        code = f"{k // (3600 * fps):02d}:{k // (60 * fps) % 60:02d}:{k // fps % 60:02d}:{k % fps:02d}.123"
        lines.append(",".join((code, "61", *(f"{w:.10f}" for w in row), *["0.25"] * 9)))
    return "\n".join(lines) + "\n"


def face_of(clip: Clip) -> Face:
    assert clip.face is not None
    return clip.face


def test_a_capture_of_61_values_a_row_at_60_fps_is_joined_to_a_body_by_name_and_time(body: Path) -> None:
    weights = random_face(0, 439, 60.0).weights
    body.with_suffix(".csv").write_text(live_link_csv(weights, first=43_200 * 60 + 37))
    clip = ss.load(body)
    assert np.allclose(face_of(clip).weights, weights[0:60:2], atol=1e-9)
    assert clip.notes == ()
    later = ss.load(body, face=body.with_suffix(".csv"), face_offset=0.5)
    assert np.allclose(face_of(later).weights[15:], weights[0:30:2], atol=1e-9)
    assert np.allclose(face_of(later).weights[:15], weights[0], atol=1e-9)
    assert "a face from 0.50" in later.notes[0]


@pytest.mark.parametrize("first", [24 * 3600 * 30 - 20, 59])
def test_other_rates_and_midnight_are_told_from_the_timecodes(body: Path, first: int) -> None:
    weights = random_face(0, 90, 30.0).weights
    rows = live_link_csv(weights, first, 30).replace("\n24:", "\n00:")
    body.with_suffix(".csv").write_text(rows)
    assert np.allclose(face_of(ss.load(body)).weights, weights[:30], atol=1e-9)


SHORT = Path(__file__).parent.parent / "data/cases/livelink_short_30fps/short30.csv"
"""26 rows at 30 fps within one second; JawOpen is lowest in row 14, at 13 / 30 s."""


def lowest_jaw_s(clip: Clip) -> float:
    """Seconds from a clip's first frame to the least open jaw."""
    return float(face_of(clip).of(("jawOpen",))[:, 0].argmin() / clip.fps)


def test_a_face_of_under_a_second_is_as_long_as_its_clip(body: Path) -> None:
    ss.save(ss.load(body)[:26], body)
    clip = ss.load(body, face=SHORT)
    assert lowest_jaw_s(clip) == pytest.approx(13 / 30, abs=1e-9)
    assert clip.notes == (), "one rate fits"
    ss.save(clip, body.with_name("again.bvh"))
    again = ss.load(body.with_name("again.bvh"))
    assert again.notes == (), "nor is our own file, of 60 a second, a guess"
    np.testing.assert_allclose(face_of(again).weights, face_of(clip).weights, atol=1e-8)


def test_a_face_whose_rate_nothing_tells_is_said_to_be_a_guess_and_can_be_given(body: Path) -> None:
    guessed = ss.load(body, face=SHORT)
    assert lowest_jaw_s(guessed) < 13 / 30
    assert guessed.notes[0] == "short30.csv: timecodes of under a second do not say their rate; 60 fps is taken"
    given = ss.load(body, face=SHORT, read=ReadAs(face_fps=30.0))
    assert lowest_jaw_s(given) == pytest.approx(13 / 30, abs=1e-9)
    assert not any("rate" in note for note in given.notes)
    with pytest.raises(FormatError, match="frame 27, expected below 24, its frames a second"):
        ss.load(body, face=SHORT, read=ReadAs(face_fps=24.0))


def test_a_plainer_table_has_a_row_a_frame_or_sixty_a_second(body: Path) -> None:
    weights, names = random_face(0, 60, 60.0).weights[:, :3], ",".join(ARKIT_CHANNELS[:3])
    for rows in (weights[:30], weights):
        table = "\n".join([names, *(",".join(map(str, row)) for row in rows)])
        body.with_name("face.csv").write_text(table)
        clip = ss.load(body, face=body.with_name("face.csv"))
        assert face_of(clip).channels == ARKIT_CHANNELS[:3]
        assert np.allclose(face_of(clip).weights, rows[:: len(rows) // 30], atol=1e-12)
        assert clip.notes == ()


def test_a_missing_column_is_named_and_a_column_of_something_else_is_not_read(body: Path) -> None:
    rows = [line.split(",") for line in live_link_csv(np.full((60, 52), 0.5)).splitlines()]
    k = rows[0].index("TongueOut")
    rows[0][k - 1] = "Mood"
    body.with_suffix(".csv").write_text("\n".join(",".join(row[:k] + row[k + 1 :]) for row in rows))
    clip = ss.load(body)
    assert face_of(clip).channels == ARKIT_CHANNELS[:-2]
    assert clip.notes == (
        "HELLO.csv lacks 2 of 52 coefficients: noseSneerRight, tongueOut",
        "HELLO.csv: columns that are no coefficients are not read: mood",
    )


def test_rows_without_a_face_are_filled_and_weights_a_little_outside_are_brought_in(body: Path) -> None:
    lines = live_link_csv(np.full((60, 52), 0.5)).splitlines()
    lines[5] = lines[5][:15].split(",")[0] + ",0"
    lines[9] = lines[8][:15] + lines[9][15:]
    lines[7] = lines[7].replace("0.5000000000", "1.0200000000", 1)
    body.with_suffix(".csv").write_text("\n".join(lines))
    clip = ss.load(body)
    assert face_of(clip).weights.max() == 1.0
    assert face_of(clip).weights.min() == 0.5
    assert [note.split(": ")[1][:24] for note in clip.notes] == [
        "1 weights outside 0 to 1",
        "2 rows have no face, or n"[:24],
    ]


GOOD = live_link_csv(np.full((40, 52), 0.25))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "its first line names no coefficient"),
        ("a,b\n1,2\n", "its first line names no coefficient"),
        (HEAD + "\n", "has no row of a face"),
        (GOOD.replace(",0.25\n", "\n", 1), "csv:2: 62 columns, expected 63"),
        (GOOD.replace("0.2500000000", "nan", 1), "csv:2: a weight of nan"),
        (GOOD.replace("0.2500000000", "71", 1), "csv:2: a weight of 71, expected 0 to 1"),
        (GOOD.replace("0.2500000000", "x", 1), "csv:2: could not convert"),
        (GOOD.replace("00:00:00:00.123", "0 s", 1), "csv:2: timecode '0 s', expected HH:MM:SS:FF"),
        (
            GOOD.replace("00:00:00:03.123", "00:00:00:01.000"),
            "the timecode of row 4 is no later than that of one before",
        ),
        (GOOD.replace("00:00:00:03.123", "00:00:00:240.00"), "has frame 240, expected below 120"),
        (GOOD.replace("JawOpen", "JawLeft"), "csv:1: two columns have one name"),
    ],
)
def test_a_broken_face_is_one_line_that_says_where(text: str, expected: str, body: Path) -> None:
    file = body.with_name("face.csv")
    file.write_text(text)
    with pytest.raises(FormatError, match=expected) as error:
        ss.load(body, face=file)
    assert len(str(error.value).splitlines()) == 1
    assert str(file) in str(error.value)


def test_a_million_rows_are_refused_before_they_are_read(body: Path) -> None:
    file = body.with_name("face.csv")
    file.write_text(HEAD + "\n" * 1_000_000)
    with pytest.raises(LimitError, match="about 1,000,000 rows, expected at most 200,000"):
        ss.load(body, face=file)
    file.write_text(GOOD)
    with pytest.raises(LimitError, match="expected at most 30"):
        live_link.with_face(ss.load(body), file, limits=ReadLimits(frames=300.0))


def test_another_table_beside_a_clip_is_no_face_and_a_missing_one_is_an_error(body: Path) -> None:
    body.with_suffix(".csv").write_text("frame,marker\n0,1\n")
    assert ss.load(body).face is None
    with pytest.raises(ss.InputError, match="no such file"):
        ss.load(body, face=body.with_name("none.csv"))


@pytest.mark.parametrize("suffix", [".bvh", ".npz", ".vrma"])
@pytest.mark.parametrize("channels", [ARKIT_CHANNELS, ("eyeBlinkLeft", "jawOpen", "browInnerUp")])
def test_a_face_comes_back_from_its_file(
    suffix: str, channels: tuple[str, ...], words: dict[str, Clip], tmp_path: Path
) -> None:
    clip = add_random_face(words["DEAF"], 4, channels)
    ss.save(clip, tmp_path / f"clip{suffix}")
    assert (tmp_path / "clip.csv").exists() == (suffix == ".bvh")
    face = face_of(ss.load(tmp_path / f"clip{suffix}"))
    assert np.abs(face.of(ARKIT_CHANNELS) - face_of(clip).of(ARKIT_CHANNELS)).max() < 1e-7
    assert face.channels == channels


def test_no_two_expressions_of_an_animation_move_the_same(words: dict[str, Clip]) -> None:
    clip = add_random_face(words["HELLO"], 4)
    shapes = [shape_of(name) for name, _ in vrm_expressions(vrma.document(clip).to_dict())]
    moved = [channel for shape in shapes if shape is not None for channel in shape]
    assert sorted(moved) == sorted(ARKIT_CHANNELS)


def test_a_figure_has_only_the_targets_that_move_and_a_coefficient_at_rest_comes_back(
    words: dict[str, Clip], tmp_path: Path
) -> None:
    weights = np.zeros((len(words["HELLO"]), 3))
    weights[5:9, 1] = 0.5
    clip = replace(words["HELLO"], face=Face(("eyeBlinkLeft", "jawOpen", "browInnerUp"), weights))
    ss.save(clip, tmp_path / "clip.glb")
    made = glb.document(clip)
    assert [mesh.extras["targetNames"] for mesh in made.meshes if mesh.name == "face"] == [("jawOpen",)]
    face = face_of(ss.load(tmp_path / "clip.glb"))
    assert face.channels == face_of(clip).channels
    assert np.abs(face.weights - weights).max() < 1e-7


def test_presets_of_an_animation_are_a_face_where_it_has_no_other(tmp_path: Path) -> None:
    nodes: list[dict[str, Any]] = [*ARM, {"name": "aa"}, {"name": "blinkLeft"}]
    moved = {"path": "translation", "times": [0, 1], "values": [[0.0, 0, 0], [1.0, 0, 0]]}
    bones = {"humanBones": {"hips": {"node": 0}, "spine": {"node": 1}}}
    vrm = {"humanoid": bones, "expressions": {"preset": {"aa": {"node": 2}, "blinkLeft": {"node": 3}}}}
    channels = [rotating(), {**moved, "node": 2}, {**moved, "node": 3}]
    clip = load_document(tmp_path, document(nodes, channels, extensions={"VRMC_vrm_animation": vrm}))
    last = face_of(clip)[len(clip) - 1 :].of(["jawOpen", "eyeBlinkLeft", "eyeBlinkRight"])[0]
    assert last == pytest.approx([0.6, 1.0, 0.0])
    assert clip.left_out == ()


def morphing(
    names: list[str] | None, interpolation: str = "LINEAR", n_targets: int = 2, **more: object
) -> dict[str, object]:
    """A document whose mesh has targets, the first of which goes from 0 to 1 within a second."""
    first = np.zeros((2, n_targets))
    first[1, 0] = 1.0
    nodes: list[dict[str, Any]] = [*ARM, {"mesh": 0}]
    content = document(nodes, [rotating()], meshes=[{"primitives": []}], **more)
    made = document(
        [*ARM], [rotating(), {"node": 1, "path": "translation", "times": [0, 1], "values": first.reshape(-1, 1)}]
    )
    accessors = made["accessors"]
    accessors[3] |= {"type": "SCALAR", "count": first.size}
    content |= {key: made[key] for key in ("accessors", "bufferViews", "buffers", "animations")}
    content["animations"][0]["channels"][1]["target"] = {"node": 2, "path": "weights"}
    content["animations"][0]["samplers"][1]["interpolation"] = interpolation
    if names is not None:
        content["meshes"][0]["extras"] = {"targetNames": names}
    return content


def test_morph_targets_are_a_face_by_their_names(tmp_path: Path) -> None:
    clip = load_document(tmp_path, morphing(["jawOpen", "hair"]))
    assert face_of(clip).channels == ("jawOpen",)
    assert face_of(clip).weights[:, 0] == pytest.approx(np.linspace(0.0, 1.0, len(clip)), abs=1e-6)
    assert clip.left_out == (), "hair does not move"
    assert load_document(tmp_path, morphing(["hair", "jawOpen"])).left_out == ("morph target hair",)
    in_a_part: dict[str, Any] = morphing(None)
    in_a_part["meshes"][0]["primitives"] = [{"attributes": {}, "extras": {"targetNames": ["hair", "jawOpen"]}}]
    assert target_names(in_a_part, 2) == ["hair", "jawOpen"]
    assert face_of(load_document(tmp_path, morphing(["jawOpen"]))).channels == ("jawOpen",)
    with pytest.raises(FormatError, match="a face has 4 weights for 2 rising times"):
        load_document(tmp_path, morphing(["jawOpen", "hair"], "CUBICSPLINE"))


@pytest.mark.parametrize(
    "extensions",
    [
        {"VRM": {"blendShapeMaster": {"blendShapeGroups": [
            {"presetName": "blink_l", "binds": [{"mesh": 0, "index": 0, "weight": 100}]},
            {"presetName": "unknown", "name": "Whole", "binds": [{"mesh": 0, "index": k} for k in (0, 1)]}]}}},
        {"VRMC_vrm": {"expressions": {"preset": {
            "blinkLeft": {"morphTargetBinds": [{"node": 2, "index": 0, "weight": 1.0}]}}}}},
    ],
)  # fmt: skip
def test_targets_of_any_name_are_known_by_the_expression_that_moves_them_alone(
    extensions: dict[str, object], tmp_path: Path
) -> None:
    for names in (["Cls_L", "Cls_R"], None):
        content = morphing(names)
        content["extensions"] = extensions
        assert target_names(content, 2)[0].lower().replace("_", "")[:6] == "blinkl"
    clip = load_document(tmp_path, {**morphing(["Cls_L", "Cls_R"]), "extensions": extensions})
    assert face_of(clip)[len(clip) - 1 :].of(["eyeBlinkLeft"])[0, 0] == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("broken", [3, [], {"blendShapeGroups": 3}, {"blendShapeGroups": [{"binds": [3]}, 4]}])
def test_broken_expressions_of_an_avatar_name_no_target(broken: object) -> None:
    content = morphing(["Cls_L", "Cls_R"])
    content["extensions"] = {"VRM": {"blendShapeMaster": broken}, "VRMC_vrm": {"expressions": broken}}
    assert target_names(content, 2) == ["Cls_L", "Cls_R"]


def test_a_figure_with_targets_shows_the_face_and_what_it_cannot_show_is_known(
    words: dict[str, Clip], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clip = add_random_face(words["DEAF"], 4)
    plain, names = DocumentWriter.mesh, list[str]()

    def with_targets(writer: DocumentWriter, *given: Any, **more: Any) -> None:
        plain(writer, *given, **more)
        for mesh in writer.gltf.meshes:
            mesh.extras = {"targetNames": names}

    monkeypatch.setattr(DocumentWriter, "mesh", with_targets)
    assert len(lost_in_file(clip, tmp_path)) > 30
    names += ARKIT_CHANNELS[:-1]
    assert lost_in_file(clip, tmp_path) in ((), ("tongueOut",))
    face = face_of(ss.load(tmp_path / "clip.glb"))
    assert np.abs(face.weights - face_of(clip).weights[:, :-1]).max() < 1e-7
    assert glb.document(replace(clip, face=None)).animations[0].channels[-1].target.path != "weights"


def lost_in_file(clip: Clip, folder: Path) -> tuple[str, ...]:
    ss.save(clip, folder / "clip.glb")
    return lost_in(folder / "clip.glb", clip)


@pytest.mark.parametrize("kind", face_avatars.KINDS[:3])
def test_the_same_face_comes_back_from_every_kind_of_avatar(kind: str, words: dict[str, Clip], tmp_path: Path) -> None:
    clip = add_random_face(words["HELLO"][:12], 3)
    ss.save(clip, tmp_path / "HELLO.bvh")  # and HELLO.csv
    avatar = ss.read_avatar(face_avatars.write(tmp_path, kind))
    signed = ss.retarget(ss.load(tmp_path / "HELLO.bvh"), avatar).clip
    for suffix in (".glb", ".vrma"):
        ss.save(signed, tmp_path / f"out{suffix}")
        face = face_of(ss.load(tmp_path / f"out{suffix}"))
        assert np.abs(face.of(ARKIT_CHANNELS) - face_of(clip).of(ARKIT_CHANNELS)).max() < 1e-6
