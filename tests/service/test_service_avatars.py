"""Avatars of a service: named when it starts and asked for by name, or uploaded."""

from __future__ import annotations

import asyncio
import base64
import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import httpx
import numpy as np
import pytest

import avatars
from serving import http_client, messages_and_close_code, stream_client
from signsplice.cli.commands import app
from signsplice.errors import InputError, LimitError
from signsplice.formats import glb, vrma
from signsplice.formats.avatar import avatars_in, in_file_axes, parse_avatar, read_avatar
from signsplice.formats.gltf_document import chunks
from signsplice.formats.reading import DEFAULT_LIMITS
from signsplice.lexicon import open_shipped_lexicon
from signsplice.motion import Clip, Skeleton, concatenate, kinematics, rotation
from signsplice.rig.info import rig_info
from signsplice.service import work
from signsplice.service.avatars import UploadedAvatars
from signsplice.service.settings import Settings
from signsplice.splicing import engine
from signsplice.splicing.engine import SpliceOptions, onto_avatar, splice
from signsplice.splicing.faces import RULES


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with an avatar, beside one with another."""
    made = tmp_path_factory.mktemp("avatars")
    for place, name in (("Ann.vrm", "narrow"), ("Eve.vrm", "broad")):
        avatars.write(made / place, avatars.body(name), avatars.tubes(avatars.body(name)))
    (made / "named").mkdir()
    (made / "Ann.vrm").rename(made / "named" / "Ann.vrm")
    (made / "named" / "notes.txt").write_text("no avatar")
    return made


@pytest.fixture(scope="module")
def client(folder: Path) -> Iterator[httpx.Client]:
    with http_client("serve", "--workers", "1", "--avatar", str(folder / "named")) as opened:
        yield opened


def test_a_service_signs_on_its_avatars_and_names_them_where_another_is_asked_for(client: httpx.Client) -> None:
    asked = {"glosses": ["MY", "NAME"], "formats": ["glb"], "avatar": "Ann"}
    answer = client.post("/v1/sentence", json=asked).json()
    assert answer["report"]["avatar"]["name"] == "Ann"
    assert answer["report"]["avatar"]["contacts"]
    assert b"VRMC_vrm" in base64.b64decode(answer["files"]["glb"])
    assert client.get("/v1/avatars").json() == ["Ann"]


@pytest.mark.parametrize("name", ["Bob", "Eve", "../Eve", "Ann.vrm", "named/Ann", "/etc/passwd", "notes"])
def test_names_of_avatars_are_no_paths(client: httpx.Client, name: str) -> None:
    refused = client.post("/v1/sentence", json={"glosses": ["MY"], "avatar": name})
    assert refused.status_code == 422
    expected = "expected Ann or the id of an upload that is kept; upload it again"
    assert refused.json()["error"] == f"avatar {name!r}: {expected}"


def fitted(client: httpx.Client, file: Path, /, query: str = "", **asked: object) -> httpx.Response:
    upload = {"avatar": (file.name, file.read_bytes())}
    return client.post(f"/v1/fit{query}", files=upload, data={"options": json.dumps(asked)})


def test_motion_is_fitted_to_an_avatar_that_is_uploaded(client: httpx.Client, folder: Path) -> None:
    answer = fitted(client, folder / "Eve.vrm", text="my name", formats=["vrma", "glb"]).json()
    with open_shipped_lexicon() as words:
        spliced = splice([words.clip("MY"), words.clip("NAME")])
    expected = onto_avatar(spliced, read_avatar(folder / "Eve.vrm"))
    assert base64.b64decode(answer["files"]["vrma"]) == vrma.encode(expected.clip)
    assert base64.b64decode(answer["files"]["glb"]) == glb.encode(expected.clip)
    assert answer["report"]["avatar"]["name"] == "Eve"
    assert [unit["glosses"] for unit in answer["units"]] == [["MY"], ["NAME"]]


def upload(client: httpx.Client, file: Path) -> str:
    """The id of an avatar that is uploaded."""
    answer = client.post("/v1/avatar", files={"avatar": (file.name, file.read_bytes())})
    assert answer.status_code == 200, answer.text
    name: str = answer.json()["avatar"]
    return name


def test_an_avatar_that_is_uploaded_once_signs_whatever_names_its_id(client: httpx.Client, folder: Path) -> None:
    name, glosses, formats = upload(client, folder / "Eve.vrm"), ["MY", "NAME"], ["vrma"]
    at_once = fitted(client, folder / "Eve.vrm", glosses=glosses, formats=formats).json()
    answer = client.post("/v1/sentence", json={"glosses": glosses, "formats": formats, "avatar": name}).json()
    assert answer["files"] == at_once["files"]
    assert answer["report"]["avatar"] == at_once["report"]["avatar"]
    with open_shipped_lexicon() as words:
        clip = words.clip("MY")
    options = json.dumps({"avatar": name, "formats": ["vrma"]})
    spliced = client.post("/v1/splice", files={"files": ("a.glb", glb.encode(clip))}, data={"options": options}).json()
    assert spliced["report"]["avatar"]["name"] == "Eve"
    assert spliced["report"]["frames"] == len(clip)


@pytest.mark.parametrize("name", ["Ann", "Eve"])
def test_a_stream_sends_frames_that_are_fitted_to_its_avatar(client: httpx.Client, folder: Path, name: str) -> None:
    file = folder / ("named/Ann.vrm" if name == "Ann" else "Eve.vrm")
    opening = {
        "type": "open",
        "paced": False,
        "face_rules": True,
        "avatar": name if name == "Ann" else upload(client, file),
    }
    with stream_client(client) as stream:
        for message in (opening, {"type": "text", "text": "MY NAME"}, {"type": "end"}):
            stream.send(json.dumps(message))
        received = [*stream]
    told = [json.loads(message) for message in received if isinstance(message, str)]
    rig = next(message for message in told if message["type"] == "skeleton")
    parts = [message for message in received if isinstance(message, bytes)]
    n_joints = len(rig["names"])
    values = np.concatenate([np.frombuffer(part, "<f4", offset=16).reshape(-1, 3 + 4 * n_joints) for part in parts])
    avatar = read_avatar(file)
    assert avatar.file is not None
    assert (rig["nodes"], rig["metres"]) == (list(avatar.file.nodes), 1.0)
    with open_shipped_lexicon() as words:
        pieces = [*engine.stream([words.clip("MY"), words.clip("NAME")], SpliceOptions(onto=avatar, face_rules=RULES))]
    clip = concatenate([piece.clip for piece in pieces])
    shown = Skeleton(tuple(rig["names"]), np.array(rig["parents"]), np.array(rig["offsets"]))
    sent = Clip(
        shown, rotation.normalize(values[:, 3:].reshape(-1, n_joints, 4).astype(float)), values[:, :3], rig["fps"]
    )
    np.testing.assert_allclose(kinematics.forward(sent)[1], kinematics.forward(clip)[1], atol=1e-5)
    document = json.loads(chunks("avatar", avatar.file.content)[0])
    at_rest = in_file_axes(
        Clip(avatar, np.tile(rotation.IDENTITY, (1, n_joints, 1)), np.zeros((1, 3)), 30.0), avatar.file
    )
    nodes = [document["nodes"][node].get("rotation", rotation.IDENTITY) for node in rig["nodes"]]
    assert rotation.angle_between(at_rest.local_rotations[0], np.array(nodes))[1:].max() < 1e-6


def test_a_stream_names_an_avatar_that_is_there(client: httpx.Client) -> None:
    with stream_client(client) as stream:
        stream.send(json.dumps({"type": "open", "avatar": "Bob"}))
        messages, code = messages_and_close_code(stream)
    assert code == 1008
    assert messages[-1]["error"].startswith("avatar 'Bob': expected Ann or the id of an upload")


def test_uploaded_avatars_are_few_small_and_kept_for_a_while() -> None:
    async def keep() -> None:
        limits = {"max_client_avatars": 2, "max_avatar_bytes": 40, "avatar_seconds": 0.3}
        avatars = UploadedAvatars(Settings(**limits))  # type: ignore[arg-type]
        first, second = (avatars.add("a", bytes([k])) for k in (1, 2))
        assert avatars.content(None) is None
        assert avatars.content(first) == b"\1"
        third = avatars.add("a", b"\3")
        with pytest.raises(InputError, match="upload it again"):
            avatars.content(second)  # named least recently
        assert avatars.content(third) == b"\3"
        others = [avatars.add("b", bytes(k)) for k in (19, 20)]
        with pytest.raises(InputError, match="upload it again"):
            avatars.content(others[0])  # of the client who fills the memory
        assert [len(avatars.content(name) or b"") for name in (first, third, others[1])] == [1, 1, 20]
        await asyncio.sleep(0.5)
        assert not avatars._uploads

    asyncio.run(keep())


def test_an_upload_that_takes_too_much_memory_is_refused(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(work, "_worker", work._WorkerState(Settings(max_avatar_bytes=400_000)), raising=False)
    with pytest.raises(InputError, match=r"Eve.vrm: takes .* MiB in memory, expected at most 0.1 MiB"):
        work.pickle_avatar("Eve.vrm", (folder / "Eve.vrm").read_bytes())


def test_motion_without_a_mesh_is_the_same_motion(client: httpx.Client, folder: Path) -> None:
    for avatar in (None, folder / "Eve.vrm"):
        asked = {"glosses": ["MY", "NAME"]}
        answers = [
            client.post("/v1/sentence?file=glb", json={**asked, "mesh": mesh}) if avatar is None
            else fitted(client, avatar, "?file=glb", mesh=mesh, **asked)
            for mesh in (True, False)
        ]  # fmt: skip
        whole, bare = (glb.parse(answer.content, "a.glb") for answer in answers)
        assert len(answers[1].content) < len(answers[0].content) / 8
        assert len(bare) == len(whole)
        assert rig_info(bare.skeleton).roles.joints.keys() == rig_info(whole.skeleton).roles.joints.keys()
        hands = [
            kinematics.forward(clip, [rig_info(clip.skeleton).roles.joints["leftHand"]])[1] for clip in (whole, bare)
        ]
        np.testing.assert_allclose(hands[0] - hands[0][0], hands[1] - hands[1][0], atol=1e-4)


@pytest.mark.parametrize(
    ("name", "content", "options", "error"),
    [
        ("a.vrm", b"no avatar", {"text": "hi"}, "a.vrm:1: is no JSON"),
        ("a.bvh", b"", {"text": "hi"}, "a.bvh: a file with suffix .bvh is no avatar, expected .vrm"),
        ("../../a", b"", {"text": "hi"}, "a: a file with suffix (none) is no avatar"),
        ("a.vrm", b"", {}, "no glosses and text, expected one of them"),
        ("a.vrm", b"", {"text": "hi", "avatar": "Ann"}, "options: an avatar is named"),
        ("a.vrm", b"", {"text": "hi", "files": 1}, "options: files: "),
        (
            "a.gltf",
            b'{"asset": {"version": "2.0"}, "buffers": [{"byteLength": 4, "uri": "named/notes.txt"}], "bufferViews": '
            b'[{"buffer": 0, "byteLength": 4}], "accessors": [{"bufferView": 0, "componentType": 5121, "count": 4, '
            b'"type": "SCALAR"}], "nodes": [{"name": "hips"}], "skins": [{"joints": [0], "inverseBindMatrices": 0}]}',
            {"text": "hi"},
            "a.gltf: ",
        ),
    ],
)
def test_what_is_no_avatar_is_refused(
    client: httpx.Client, name: str, content: bytes, options: dict[str, object], error: str
) -> None:
    answer = client.post("/v1/fit", files={"avatar": (name, content)}, data={"options": json.dumps(options)})
    assert answer.status_code == 422
    assert answer.json()["error"].startswith(error)
    assert len(answer.json()["error"].splitlines()) == 1


def test_an_uploaded_document_reads_no_other_file(tmp_path: Path, folder: Path) -> None:
    """The same document is read where its folder is known, so that it is the upload that refuses it."""
    text, blob = chunks("Eve", (folder / "Eve.vrm").read_bytes())
    document = json.loads(text)
    document["buffers"][0]["uri"] = "Eve.bin"
    (tmp_path / "Eve.bin").write_bytes(blob)
    (tmp_path / "Eve.gltf").write_text(json.dumps(document))
    assert len(read_avatar(tmp_path / "Eve.gltf"))
    with pytest.raises(InputError, match="Eve"):
        parse_avatar((tmp_path / "Eve.gltf").read_bytes(), str(tmp_path / "Eve.gltf"))


def test_an_uploaded_avatar_has_the_limits_of_clips(folder: Path) -> None:
    content = (folder / "Eve.vrm").read_bytes()
    with pytest.raises(LimitError, match="bytes, expected at most 1,000"):
        parse_avatar(content, "Eve.vrm", replace(DEFAULT_LIMITS, file_bytes=1000))
    with pytest.raises(LimitError, match="joints"):
        parse_avatar(content, "Eve.vrm", replace(DEFAULT_LIMITS, joints=3))


def test_a_folder_without_avatars_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="a folder without avatars"):
        avatars_in(tmp_path)


def test_avatars_have_different_names() -> None:
    with pytest.raises(InputError, match="two avatars have one name"):
        Settings(avatars=(Path("a/Ann.vrm"), Path("b/Ann.glb")))


def test_an_avatar_that_cannot_be_read_stops_the_service_at_once() -> None:
    from click.testing import CliRunner

    assert "nothing.vrm" in str(CliRunner().invoke(app, ["serve", "--avatar", "nothing.vrm"]).exception)
