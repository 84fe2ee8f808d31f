"""Motion written into an avatar's own file: what stays, where the joints go, and what its face shows."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import avatars
import signsplice as ss
from signsplice.errors import InputError
from signsplice.formats import encode, vrma
from signsplice.formats.avatar import pack
from signsplice.formats.gltf_document import chunks
from signsplice.lexicon import open_shipped_lexicon
from signsplice.motion import Clip, kinematics
from signsplice.motion.face import Face
from signsplice.rig.align import ORIGIN, place

BOOK = open_shipped_lexicon().clip("BOOK")


def written(folder: Path, version: str = "1.0", **options: Any) -> Path:
    avatar = avatars.body("broad")
    return avatars.write(folder / "a.glb", avatar, avatars.tubes(avatar), version, **options)


def parts(content: bytes) -> tuple[dict[str, Any], bytes]:
    text, blob = chunks("", content)
    return json.loads(text), blob


def signed(path: Path, clip: Clip = BOOK) -> tuple[Clip, bytes]:
    done = ss.retarget(clip, ss.read_avatar(path)).clip
    return done, encode(done, "out.glb")


@pytest.mark.parametrize("version", ["1.0", "0.x", ""])
def test_an_avatars_file_stays_and_gets_an_animation(tmp_path: Path, version: str) -> None:
    path = written(tmp_path, version)
    (before, old), (after, new) = parts(path.read_bytes()), parts(signed(path)[1])
    assert new.startswith(old)
    changed = {"animations", "accessors", "bufferViews", "buffers", "extras"}
    assert {key: value for key, value in after.items() if key not in changed} == {
        key: value for key, value in before.items() if key not in changed
    }
    for name in ("accessors", "bufferViews"):
        assert after[name][: len(before[name])] == before[name]
    assert [animation["name"] for animation in after["animations"]] == ["BOOK"]


@pytest.mark.parametrize("version", ["1.0", "0.x", ""])
def test_the_joints_in_an_avatars_file_are_where_the_clip_has_them(tmp_path: Path, version: str) -> None:
    done, content = signed(written(tmp_path, version))
    (tmp_path / "out.glb").write_bytes(content)
    back = ss.load(tmp_path / "out.glb")
    order = [back.skeleton.index[name] for name in done.skeleton.names]
    wanted, found = (kinematics.forward(place(clip, ORIGIN))[1] for clip in (done, back))
    np.testing.assert_allclose(found[:, order], wanted, atol=2e-4)
    assert back.fps == done.fps


def test_the_signer_stands_where_the_avatar_stands_and_faces_as_it_does(tmp_path: Path) -> None:
    path = written(tmp_path, "0.x")
    (tmp_path / "out.glb").write_bytes(signed(path)[1])
    back = ss.load(tmp_path / "out.glb")
    left, right = (back.skeleton.index[name] for name in ("mixamorig:LeftUpLeg", "mixamorig:RightUpLeg"))
    at = kinematics.forward(back)[1].mean(axis=0)
    assert at[left, 0] < at[right, 0], "VRM 0.x faces -Z"
    height = ss.read_avatar(path).file.worlds[0, 1, 3]  # type: ignore[union-attr]
    assert abs(at[0, 1] - height) < 0.02


def test_earlier_animations_follow_the_new_one_and_matrices_become_rotations(tmp_path: Path) -> None:
    path = written(tmp_path, "")
    once = signed(path)[1]
    document, blob = parts(once)
    node = document["nodes"][5]
    matrix = np.eye(4)
    matrix[:3, 3] = node.pop("translation")
    del node["rotation"]
    node["matrix"] = matrix.T.ravel().tolist()
    path.write_bytes(pack(document, blob))
    after = parts(signed(path, open_shipped_lexicon().clip("NAME"))[1])[0]
    assert [animation["name"] for animation in after["animations"]] == ["NAME", "BOOK"]
    assert "matrix" not in after["nodes"][5]
    np.testing.assert_allclose(after["nodes"][5]["translation"], matrix[:3, 3], atol=1e-9)


def test_buffers_and_images_of_a_gltf_come_into_one_file(tmp_path: Path) -> None:
    document, blob = parts(written(tmp_path, "").read_bytes())
    document["buffers"][0]["uri"] = "a.bin"
    document["images"] = [{"uri": "textures/skin%20one.png"}, {"uri": "lost.png"}, {"uri": "../outside.png"}]
    (tmp_path / "a.bin").write_bytes(blob)
    (tmp_path / "textures").mkdir()
    (tmp_path / "textures" / "skin one.png").write_bytes(b"a picture")
    (tmp_path.parent / "outside.png").write_bytes(b"no")
    (tmp_path / "a.gltf").write_text(json.dumps(document))
    after, content = parts(signed(tmp_path / "a.gltf")[1])
    first = after["images"][0]
    view = after["bufferViews"][first["bufferView"]]
    assert content[view["byteOffset"] :][: view["byteLength"]] == b"a picture"
    assert first["mimeType"] == "image/png"
    assert after["images"][1:] == document["images"][1:]
    assert content.startswith(blob)
    assert "uri" not in after["buffers"][0]


def test_a_file_whose_unread_parts_are_broken_is_an_error_in_one_line(tmp_path: Path) -> None:
    path = written(tmp_path, "")
    document, blob = parts(path.read_bytes())
    document["animations"] = 7
    path.write_bytes(pack(document, blob))
    with pytest.raises(InputError, match="the avatar's file: is no valid avatar") as caught:
        signed(path)
    assert "\n" not in str(caught.value)


FACE = {"jawOpen": 0.5, "eyeBlinkLeft": 1.0, "cheekPuff": 0.7}
EXPRESSIONS = {"blinkLeft": {0: 0.5}, "aa": {1: 1.0}}
OLD_EXPRESSIONS = {"blink_l": {0: 0.5}, "a": {1: 1.0}}


@pytest.mark.parametrize(
    ("version", "targets", "expressions", "expected"),
    [
        ("", ("JawOpen", "eyeBlink_L", "nothing"), {}, [0.5, 1.0, 0.0]),
        ("1.0", ("Fcl_A", "Fcl_B"), EXPRESSIONS, [0.5, None]),
        ("0.x", ("Fcl_A", "Fcl_B"), OLD_EXPRESSIONS, [0.5, None]),
        ("1.0", ("jawOpen", "eyeBlinkLeft"), EXPRESSIONS, [0.5, 1.0]),
    ],
)
def test_a_face_moves_the_targets_that_the_avatar_has(
    tmp_path: Path, version: str, targets: tuple[str, ...], expressions: Any, expected: list[float | None]
) -> None:
    path = avatars.with_face(written(tmp_path, version), targets, expressions)
    face = Face(tuple(FACE), np.tile(list(FACE.values()), (len(BOOK), 1)))
    done = ss.retarget(replace(BOOK, face=face), ss.read_avatar(path))
    after, content = parts(encode(done.clip, "out.glb"))
    animation = after["animations"][0]
    (channel,) = (row for row in animation["channels"] if row["target"]["path"] == "weights")
    accessor = after["accessors"][animation["samplers"][channel["sampler"]]["output"]]
    assert accessor["count"] == len(BOOK) * len(targets)
    values = np.frombuffer(
        content, "<f4", accessor["count"], after["bufferViews"][accessor["bufferView"]]["byteOffset"]
    )
    for found, wanted in zip(values.reshape(len(BOOK), -1)[7].tolist(), expected, strict=True):
        assert 0.2 < found <= 1.0 if wanted is None else abs(found - wanted) < 0.05
    assert any("its face does not show cheekPuff" in line for line in done.warnings)


@pytest.mark.parametrize(
    ("version", "expressions"), [("1.0", EXPRESSIONS), ("0.x", OLD_EXPRESSIONS), ("1.0", {"jawOpen": {0: 1.0}})]
)
def test_an_animation_for_an_avatar_has_the_expressions_of_that_avatar(
    tmp_path: Path, version: str, expressions: Any
) -> None:
    path = avatars.with_face(written(tmp_path, version), ("a", "b"), expressions)
    face = Face(tuple(FACE), np.tile(list(FACE.values()), (len(BOOK), 1)))
    clip = ss.retarget(replace(BOOK, face=face), ss.read_avatar(path)).clip
    found = vrma.document(clip).extensions["VRMC_vrm_animation"]["expressions"]
    names = {kind: set(rows) for kind, rows in found.items()}
    own = {"preset": set(), "custom": {"jawOpen"}} if "jawOpen" in expressions else None
    assert names == (own or {"preset": {"blinkLeft", "aa"}, "custom": set()})


def test_a_face_with_a_target_that_does_not_exist_is_refused(tmp_path: Path) -> None:
    path = avatars.with_face(written(tmp_path), ("a",), {"aa": {7: 1.0}})
    with pytest.raises(InputError, match="names a morph target that does not exist"):
        ss.read_avatar(path)
