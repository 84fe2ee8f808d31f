"""The service as its users call it: what it answers is what the engine makes."""

from __future__ import annotations

import base64
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
from pydantic import TypeAdapter
from websockets.sync.client import ClientConnection

from serving import talking
from signsplice.formats import bvh, gltf_reader, parse
from signsplice.lexicon import shipped
from signsplice.motion.clip import Clip
from signsplice.service import page, typescript, wire
from signsplice.splicing import report as reports
from signsplice.splicing.engine import SpliceOptions, splice, stream

LINE = ["HELLO", "DEAF", "FRIEND"]


def hear(socket: ClientConnection) -> list[dict[str, Any] | bytes]:
    """All that a stream says until it closes."""
    return [json.loads(said) if isinstance(said, str) else said for said in socket]


def streamed(client: httpx.Client, glosses: list[str], **opened: Any) -> list[dict[str, Any] | bytes]:
    with talking(client) as socket:
        socket.send(json.dumps({"type": "open", "paced": False, **opened}))
        for gloss in glosses:
            socket.send(json.dumps({"type": "word", "gloss": gloss}))
        socket.send(json.dumps({"type": "end"}))
        return hear(socket)


def frames(said: list[dict[str, Any] | bytes]) -> np.ndarray[Any, Any]:
    """Frames (F, 3 + 4 J) of a stream, whose numbers must follow one another."""
    rows, at = [], 0
    for part in said:
        if isinstance(part, bytes):
            magic, first, n_frames, n_joints = wire.FRAMES.unpack_from(part)
            assert magic == wire.MAGIC
            assert first == at
            numbers = np.frombuffer(part, "<f4", offset=wire.FRAMES.size)
            rows.append(numbers.reshape(n_frames, 3 + 4 * n_joints))
            at += n_frames
    return np.concatenate(rows)


def of_clip(clip: Clip) -> np.ndarray[Any, Any]:
    return np.concatenate([clip.root_positions, clip.local_rotations.reshape(len(clip), -1)], axis=1)


def clips(glosses: list[str]) -> list[Clip]:
    with shipped() as lexicon:
        return [lexicon.clip(gloss) for gloss in glosses]


def without_timing(report: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in report.items() if key != "timing_ms"}


def test_a_sentence_is_what_the_engine_makes(service: httpx.Client) -> None:
    answer = service.post("/v1/sentence", json={"glosses": LINE, "formats": ["bvh", "glb", "vrma"]}).json()
    result = splice(clips(LINE))
    assert without_timing(answer["report"]) == without_timing(json.loads(json.dumps(reports.describe(result))))
    files = {form: base64.b64decode(content) for form, content in answer["files"].items()}
    assert files["bvh"].decode() == bvh.render(result.clip)
    shown = gltf_reader.parse(files["glb"], "a.glb")
    np.testing.assert_allclose(
        np.abs(np.sum(shown.local_rotations[:, -1] * shown.local_rotations[:, -1], axis=-1)), 1.0
    )
    assert len(shown) == len(parse(files["vrma"], "a.vrma")) == len(result.clip)


@pytest.mark.parametrize(
    ("dials", "options"),
    [
        ({"transition": "hermite", "cutter": "ends"}, SpliceOptions(transition="hermite", cutter="ends")),
        ({"transition_time": 0.5, "sign_speed": 1.5}, SpliceOptions(transition_time=0.5, sign_speed=1.5)),
        ({"transition_time": "travel", "fps": 24}, SpliceOptions(duration="travel", fps=24.0)),
        ({"body_sense": False}, SpliceOptions(avoid_collisions=False)),
    ],
)
def test_dials_are_the_command_lines(service: httpx.Client, dials: dict[str, Any], options: SpliceOptions) -> None:
    answer = service.post("/v1/sentence?file=bvh", json={"glosses": LINE[:2], **dials})
    assert answer.text == bvh.render(splice(clips(LINE[:2]), options).clip)
    assert answer.headers["content-disposition"] == 'attachment; filename="HELLO-DEAF.bvh"'


def test_files_are_spliced_in_order(service: httpx.Client, words: dict[str, Clip]) -> None:
    texts = {gloss: bvh.render(words[gloss]) for gloss in ("SIGN", "DEAF")}
    files = [("files", (f"{gloss}.bvh", text)) for gloss, text in texts.items()]
    options = json.dumps({"transition": "quintic", "formats": ["bvh"]})
    answer = service.post("/v1/splice", files=files, data={"options": options}).json()
    result = splice(
        [bvh.parse(text.encode(), name=gloss) for gloss, text in texts.items()], SpliceOptions(transition="quintic")
    )
    assert without_timing(answer["report"]) == without_timing(json.loads(json.dumps(reports.describe(result))))
    assert base64.b64decode(answer["files"]["bvh"]).decode() == bvh.render(result.clip)


def test_one_file_is_shown_as_it_is(service: httpx.Client, words: dict[str, Clip]) -> None:
    text = bvh.render(words["DEAF"])
    assert service.post("/v1/splice?file=bvh", files={"files": ("DEAF.bvh", text)}).text == text


def test_spelled_names_and_warnings_come_along(service: httpx.Client) -> None:
    answer = service.post("/v1/sentence", json={"glosses": ["fs-AB", "Xyx"], "formats": []}).json()
    assert [unit["glosses"] for unit in answer["units"]] == [["fs-A", "fs-B"], ["fs-X", "fs-Y", "fs-X"]]
    assert "spelled" in answer["units"][1]["warning"]
    assert answer["files"] == {"bvh": None, "glb": None, "vrma": None}


def test_an_unknown_gloss_names_the_nearest(service: httpx.Client) -> None:
    answer = service.post("/v1/sentence", json={"glosses": ["HELO", "FREIND"], "spell": False})
    assert answer.status_code == 422
    assert answer.json()["unknown"]["HELO"][0] == "HELLO"
    assert answer.json()["unknown"]["FREIND"][0] == "FRIEND"
    assert "lexicon/words" not in answer.text, "tells where the lexicon lies"


def test_the_lexicon_in_pages(service: httpx.Client) -> None:
    first = service.get("/v1/lexicon", params={"limit": 2}).json()
    rest = service.get("/v1/lexicon", params={"start": 2, "limit": 1000}).json()
    with shipped() as lexicon:
        assert [word["gloss"] for word in first["words"] + rest["words"]] == list(lexicon.glosses)
        assert first["total"] == len(lexicon)
    found = service.get("/v1/lexicon", params={"search": "the"}).json()["words"]
    begins = [any(n.lower().startswith("the") for n in (w["gloss"], *w["synonyms"])) for w in found]
    assert begins == sorted(begins, reverse=True)
    assert any(begins)
    assert not all(begins)


def test_methods_health_and_metrics(service: httpx.Client) -> None:
    told = {(part["kind"], part["name"]) for part in service.get("/v1/methods").json()}
    assert {("cutter", "learned"), ("transition", "hermite"), ("duration", "travel")} <= told
    assert service.get("/healthz").json()["status"] == "ok"
    before = service.get("/metrics").text
    service.get("/v1/methods")
    after = service.get("/metrics").text
    line = 'signsplice_requests_total{method="GET",route="/v1/methods",status="200"} '
    count = [float(text[text.index(line) + len(line) :].split()[0]) for text in (before, after)]
    assert count[1] == count[0] + 1


def test_a_stream_is_what_the_engine_streams(service: httpx.Client) -> None:
    said = streamed(service, LINE)
    pieces = list(stream(clips(LINE)))
    np.testing.assert_array_equal(frames(said), np.concatenate([of_clip(p.clip) for p in pieces]).astype("<f4"))
    told = [part for part in said if isinstance(part, dict)]
    assert told[0]["type"] == "skeleton"
    assert told[0]["names"] == list(pieces[0].clip.skeleton.names)
    assert (told[0]["cutter"], told[0]["transition"]) == ("learned", "learned")
    spans = [part["span"] for part in told if part["type"] == "span"]
    assert [tuple(span["output"]) for span in spans] == [piece.span.output for piece in pieces]
    seams = [part["seam"] for part in told if part["type"] == "seam"]
    assert [(seam["before"], seam["after"]) for seam in seams] == [("HELLO", "DEAF"), ("DEAF", "FRIEND")]
    assert told[-1] == {"type": "done", "frames": len(frames(said))}


def test_frames_come_before_the_sentence_is_over(service: httpx.Client) -> None:
    with talking(service) as socket:
        socket.send(json.dumps({"type": "open", "paced": False}))
        for gloss in LINE[:2]:
            socket.send(json.dumps({"type": "word", "gloss": gloss}))
        said = [socket.recv(timeout=30)]
        while not isinstance(said[-1], bytes):
            said.append(socket.recv(timeout=30))
        assert json.loads(said[0])["type"] == "skeleton"
        socket.send(json.dumps({"type": "end"}))
        assert any(isinstance(part, dict) and part["type"] == "done" for part in hear(socket))


def test_a_paced_stream_says_the_same_one_frame_at_a_time(service: httpx.Client) -> None:
    paced = streamed(service, ["fs-A", "fs-B"], paced=True, sign_speed=4.0)
    at_once = streamed(service, ["fs-A", "fs-B"], sign_speed=4.0)
    np.testing.assert_array_equal(frames(paced), frames(at_once))
    counts = [wire.FRAMES.unpack_from(part)[2] for part in paced if isinstance(part, bytes)]
    assert set(counts) == {1}


def test_a_word_that_is_not_known_is_left_out_and_the_stream_goes_on(service: httpx.Client) -> None:
    said = streamed(service, ["HELLO", "NO-SUCH-WORD", "DEAF"], spell=False)
    errors = [part for part in said if isinstance(part, dict) and part["type"] == "error"]
    assert list(errors[0]["unknown"]) == ["NO-SUCH-WORD"]
    np.testing.assert_array_equal(frames(said), frames(streamed(service, ["HELLO", "DEAF"])))


def test_a_message_of_several_words_is_each_of_them(service: httpx.Client) -> None:
    said = streamed(service, ["HELLO", "MY  NAME\n", "DEAF"])
    np.testing.assert_array_equal(frames(said), frames(streamed(service, ["HELLO", "MY", "NAME", "DEAF"])))


def test_what_a_page_is_told_is_json_whatever_it_is_called(words: dict[str, Clip]) -> None:
    if not page.BUILT.is_dir():
        pytest.skip("the viewer is not built (make viewer)")
    told = {"name": "\udcff</script><b>", "report": {"seams": [float("nan")]}}
    text = page.html([told], live=False)
    text.encode()
    mark = '<script type="application/json" id="signsplice">'
    inside = text[text.index(mark) + len(mark) :].split("</script>")[0]
    assert "<" not in inside
    assert json.loads(inside)["scenes"] == [{"name": told["name"], "report": {"seams": [None]}}]


def test_what_is_said_is_what_the_wire_tells(service: httpx.Client) -> None:
    """Answers are written by workers, past the checks of the framework: nothing in them is more or less than told."""
    spliced = TypeAdapter(wire.Spliced)
    answer = service.post("/v1/sentence", json={"glosses": ["HELLO", "fs-AB"]}).json()
    assert json.loads(spliced.dump_json(spliced.validate_python(answer))) == answer
    message = TypeAdapter(wire.FromService)
    said = [part for part in streamed(service, ["HELLO", "HELO9", "NO SUCH", "DEAF"]) if isinstance(part, dict)]
    assert {part["type"] for part in said} >= {"skeleton", "span", "seam", "warning", "done"}
    for part in said:
        assert json.loads(message.dump_json(message.validate_python(part))) == part


def test_the_pages_types_are_the_services(tmp_path: Path) -> None:
    written = Path(__file__).resolve().parents[2] / "viewer" / "src" / "wire.ts"
    assert written.read_text() == typescript.render(), "python -m signsplice.service.typescript viewer/src/wire.ts"


def test_types_are_told_as_typescript_has_them() -> None:
    text = typescript.render()
    assert '  transition_time?: "auto" | "tempo" | "fixed" | "travel" | "speed" | number;' in text
    assert '  formats?: ("bvh" | "glb" | "vrma")[];' in text
    assert "export type FromClient = Open | Say | End;" in text
    with pytest.raises(TypeError, match="no counterpart"):
        typescript._type(complex)


def test_view_writes_a_page_that_holds_the_clip(tmp_path: Path, words: dict[str, Clip]) -> None:
    bvh.write(words["DEAF"], tmp_path / "DEAF.bvh")
    call = [sys.executable, "-m", "signsplice", "view", "DEAF.bvh", "-o", "deaf.html"]
    done = subprocess.run(call, cwd=tmp_path, capture_output=True, text=True)
    if "has no viewer" in done.stderr:
        pytest.skip("the viewer is not built (make viewer)")
    assert done.returncode == 0, done.stderr
    text = (tmp_path / "deaf.html").read_text()
    mark = '<script type="application/json" id="signsplice">'
    told = json.loads(text[text.index(mark) + len(mark) :].split("</script>")[0])
    assert told["live"] is False
    assert base64.b64decode(told["scenes"][0]["files"]["bvh"]).decode() == bvh.render(words["DEAF"])
    assert told["scenes"][0]["report"]["spans"][0]["output"] == [0, len(words["DEAF"])]
