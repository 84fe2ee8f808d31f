"""The service's answers and streams are what the engine makes, and match the published types."""

from __future__ import annotations

import base64
import csv
import json
import struct
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
from pydantic import TypeAdapter
from websockets.sync.client import ClientConnection

import generate
import signsplice as ss
from other_rigs import on_other_rig
from reference_poses import arms_out, with_pose
from serving import PATIENCE_S, messages_and_close_code, stream_client
from signing import marked
from signsplice.cli.commands import app
from signsplice.errors import MissingExtraError
from signsplice.formats import bvh, glb, parse, pose, save
from signsplice.lexicon import open_shipped_lexicon
from signsplice.motion import Clip, rotation
from signsplice.rig.inspection import inspect
from signsplice.service import page, wire, work
from signsplice.service.wire import json_type
from signsplice.splicing import report as reports
from signsplice.splicing.engine import SpliceOptions, Stream, splice, stream
from signsplice.splicing.seam import Number
from signsplice.splicing.word import Word
from signsplice_workshop.measure.faces import add_random_face

GLOSSES = ["HELLO", "DEAF", "FRIEND"]
SCRIPT_START = '<script type="application/json" id="signsplice">'

Message = dict[str, Any] | bytes


def receive_all(socket: ClientConnection) -> list[Message]:
    """All messages of a stream until it closes."""
    return [json.loads(message) if isinstance(message, str) else message for message in socket]


def streamed(client: httpx.Client, glosses: list[str], **options: Any) -> list[Message]:
    with stream_client(client) as socket:
        socket.send(json.dumps({"type": "open", "paced": False, **options}))
        for gloss in glosses:
            socket.send(json.dumps({"type": "word", "gloss": gloss}))
        socket.send(json.dumps({"type": "end"}))
        return receive_all(socket)


def frames(messages: list[Message]) -> np.ndarray[Any, Any]:
    """Frames (F, 3 + 4 J) of a stream, whose numbers must be consecutive."""
    rows, n = [], 0
    for message in messages:
        if isinstance(message, bytes):
            magic, first, n_frames, n_joints = wire.FRAMES_HEADER.unpack_from(message)
            assert magic == wire.FRAMES_MAGIC
            assert first == n
            values = np.frombuffer(message, "<f4", offset=wire.FRAMES_HEADER.size)
            rows.append(values.reshape(n_frames, 3 + 4 * n_joints))
            n += n_frames
    return np.concatenate(rows)


def frames_of(clip: Clip) -> np.ndarray[Any, Any]:
    return np.concatenate([clip.root_positions, clip.local_rotations.reshape(len(clip), -1)], axis=1)


def clips(glosses: list[str]) -> list[Clip]:
    with open_shipped_lexicon() as lexicon:
        return [lexicon.clip(gloss) for gloss in glosses]


def owners(glosses: list[str], **marks: Mapping[int, str]) -> list[Word]:
    """Words with the channels that their lexicon says they own, and with marks as of ``marked``."""
    with open_shipped_lexicon() as lexicon:
        words = zip(marked(clips(glosses), **marks), glosses, strict=True)
        return [replace(word, owns=lexicon.owns(gloss)) for word, gloss in words]


def without_timing(report: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in report.items() if key != "timing_ms"}


# --- requests ---


def test_sentence_equals_the_engines_splice(service: httpx.Client) -> None:
    answer = service.post("/v1/sentence", json={"glosses": GLOSSES, "formats": list(wire.FORMAT_NAMES)}).json()
    result = splice(owners(GLOSSES))
    assert without_timing(answer["report"]) == without_timing(json.loads(json.dumps(reports.describe(result))))
    files = {form: base64.b64decode(content) for form, content in answer["files"].items()}
    assert files["bvh"] == bvh.encode(result.clip)
    from_glb = glb.parse(files["glb"], "a.glb")
    np.testing.assert_allclose(np.sum(from_glb.local_rotations[:, -1] ** 2, axis=-1), 1.0)
    assert {len(parse(content, f"a.{form}")) for form, content in files.items()} == {len(result.clip)}


@pytest.mark.parametrize(
    ("dials", "options"),
    [
        ({"transition": "hermite", "cutter": "ends"}, SpliceOptions(transition="hermite", cutter="ends")),
        ({"transition_time": 0.5, "sign_speed": 1.5}, SpliceOptions(transition_time=0.5, sign_speed=1.5)),
        ({"transition_time": "fixed", "fps": 24}, SpliceOptions(duration="fixed", fps=24.0)),
        ({"body_sense": False}, SpliceOptions(avoid_collisions=False)),
        ({"tempo": "natural"}, SpliceOptions(tempo="natural")),
        ({"tempo": 1.0}, SpliceOptions(tempo=1.0)),
        ({"free_hand": "transition"}, SpliceOptions(free_hand="transition")),
        ({"person": 0.5, "seed": 3}, SpliceOptions(person=0.5, seed=3)),
        ({"system": "lpt-plus"}, SpliceOptions(system="lpt-plus")),
    ],
)
def test_dials_are_the_engines_options(service: httpx.Client, dials: dict[str, Any], options: SpliceOptions) -> None:
    answer = service.post("/v1/sentence?file=bvh", json={"glosses": GLOSSES[:2], **dials})
    assert answer.content == bvh.encode(splice(owners(GLOSSES[:2]), options).clip)
    assert answer.headers["content-disposition"] == 'attachment; filename="HELLO-DEAF.bvh"'


def test_a_sentence_is_drawn_as_a_contact_sheet(service: httpx.Client) -> None:
    answer = service.post("/v1/sentence?file=png", json={"glosses": GLOSSES[:1]})
    assert answer.headers["content-type"] == "image/png"
    assert answer.headers["content-disposition"] == 'attachment; filename="HELLO.png"'
    width, height = (int.from_bytes(answer.content[at : at + 4], "big") for at in (16, 20))
    assert min(width, height) > 200


def test_files_are_spliced_in_order(service: httpx.Client, words: dict[str, Clip]) -> None:
    contents = {gloss: bvh.encode(words[gloss]) for gloss in ("SIGN", "DEAF")}
    files = [("files", (f"{gloss}.bvh", content)) for gloss, content in contents.items()]
    options = json.dumps({"transition": "quintic", "formats": ["bvh"]})
    answer = service.post("/v1/splice", files=files, data={"options": options}).json()
    result = splice(
        [bvh.parse(content, gloss) for gloss, content in contents.items()], SpliceOptions(transition="quintic")
    )
    assert without_timing(answer["report"]) == without_timing(json.loads(json.dumps(reports.describe(result))))
    assert base64.b64decode(answer["files"]["bvh"]) == bvh.encode(result.clip)


def test_landmarks_are_spliced_as_the_engine_splices_them(service: httpx.Client, words: dict[str, Clip]) -> None:
    contents = [pose.encode(words[gloss]) for gloss in ("SIGN", "DEAF")]
    files = [("files", (f"{n}.pose", content)) for n, content in enumerate(contents)]
    answer = service.post("/v1/splice", files=files, data={"options": json.dumps({"formats": ["pose"]})})
    assert answer.status_code == 200, answer.text
    clips = [pose.parse(content, f"{n}.pose") for n, content in enumerate(contents)]
    assert base64.b64decode(answer.json()["files"]["pose"]) == pose.encode(splice(clips).clip)
    broken = service.post(
        "/v1/splice", files=[("files", ("a.pose", contents[0][:-7])), files[1]], data={"options": "{}"}
    )
    assert broken.status_code == 422
    assert "a.pose: is no valid .pose file (it ends at byte" in broken.text


def test_written_signs_are_signed_and_spliced_beside_clips(service: httpx.Client, words: dict[str, Clip]) -> None:
    sigml = (Path(__file__).parents[1] / "synth" / "written_signs.sigml").read_bytes()
    files = [("files", ("DEAF.bvh", bvh.encode(words["DEAF"]))), ("files", ("ten.sigml", sigml))]
    report = service.post("/v1/splice", files=files, data={"options": '{"formats": []}'}).json()["report"]
    signs = [span["name"] for span in report["spans"] if span["kind"] == "sign"]
    assert signs == ["DEAF", "RED", "FATHER", "THROW", "DRINK", "KING", "HOUSE", "WORK", "BICYCLE", "CAR", "RAIN"]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"<sigml>", "x.sigml:1: is no well-formed XML"),
        (b"<sigml/>", "holds no sign"),
        (b'<sigml><hamgestural_sign gloss="A"><sign_manual/></hamgestural_sign></sigml>', "A: <sign_manual>: is empty"),
        (b" " * 300_000, "expected at most 262,144 of written signs"),
        (b"<sigml>" + b'<hns_sign gloss="A"><hamfist/></hns_sign>' * 500 + b"</sigml>", "signs, expected at most"),
    ],
)
def test_written_signs_that_are_broken_or_too_many_are_refused(
    service: httpx.Client, content: bytes, message: str
) -> None:
    answer = service.post("/v1/splice", files={"files": ("x.sigml", content)})
    assert answer.status_code == 422 or answer.status_code == 400
    assert message in answer.text


def test_a_single_file_is_returned_unchanged(service: httpx.Client, words: dict[str, Clip]) -> None:
    content = bvh.encode(words["DEAF"])
    assert service.post("/v1/splice?file=bvh", files={"files": ("DEAF.bvh", content)}).content == content


def test_units_list_letters_and_warnings(service: httpx.Client) -> None:
    answer = service.post("/v1/sentence", json={"glosses": ["fs-AB", "Xyx"], "formats": []}).json()
    assert [unit["glosses"] for unit in answer["units"]] == [["fs-A", "fs-B"], ["fs-X", "fs-Y", "fs-X"]]
    assert "spelled" in answer["units"][1]["warning"]
    assert answer["files"] == dict.fromkeys(wire.FORMAT_NAMES)


def test_compounds_and_suggestions_are_in_the_units(service: httpx.Client) -> None:
    typed = {"glosses": ["i", "love", "you,", "frend!"], "formats": []}
    compound, typo = service.post("/v1/sentence", json=typed).json()["units"]
    assert (compound["glosses"], compound["note"]) == (
        ["I-LOVE-YOU"],
        "'i love you' is read as one gloss, I-LOVE-YOU",
    )
    assert typo["spelled"]
    assert typo["suggestions"][0] == "FRIEND"
    apart = service.post("/v1/sentence", json={**typed, "compounds": False}).json()["units"]
    assert [unit["token"] for unit in apart] == ["i", "love", "you", "frend"]


def test_spelled_words_that_follow_one_another_are_parted(service: httpx.Client) -> None:
    answer = service.post("/v1/sentence", json={"glosses": ["fs-AN", "fs-NA"], "formats": []}).json()
    spelled = [seam["seconds"] for seam in answer["report"]["seams"]]
    assert spelled[1] >= 0.25 > max(spelled[0], spelled[2])
    messages = streamed(service, ["fs-AN", "fs-NA"])
    assert [m["seam"]["seconds"] for m in messages if isinstance(m, dict) and m["type"] == "seam"] == spelled


def test_unknown_glosses_are_answered_with_the_nearest(service: httpx.Client) -> None:
    answer = service.post("/v1/sentence", json={"glosses": ["HELO", "FREIND"], "spell": False})
    assert answer.status_code == 422
    assert answer.json()["unknown"]["HELO"][0] == "HELLO"
    assert answer.json()["unknown"]["FREIND"][0] == "FRIEND"
    assert "lexicon/words" not in answer.text, "reveals the lexicon's folder"


def test_a_line_of_two_languages_is_warned_of_or_refused(service: httpx.Client) -> None:
    asked: dict[str, Any] = {"text": "hello Straße schön", "language": "gsg"}
    mixed, spelled = "signs of other languages than gsg: ase (hello)", "2 of 3 words are spelled, letter by letter"
    answer = service.post("/v1/sentence", json={**asked, "formats": []}).json()
    assert [unit["language"] for unit in answer["units"]] == ["ase", "gsg", "gsg"]
    assert answer["report"]["warnings"][0] == mixed
    assert answer["report"]["warnings"][1].startswith(spelled)
    refused = service.post("/v1/sentence", json={**asked, "one_language": True})
    assert (refused.status_code, refused.json()["error"]) == (422, f"{mixed}, expected one language")
    for one_language, kind in {False: "warning", True: "error"}.items():
        with stream_client(service) as socket:
            socket.send(json.dumps({"type": "open", "paced": False, "language": "gsg", "one_language": one_language}))
            socket.send(json.dumps({"type": "text", "text": asked["text"]}))
            socket.send(json.dumps({"type": "end"}))
            messages, _ = messages_and_close_code(socket)
        lines = [message[kind] for message in messages if message["type"] == kind]
        assert [line for line in lines if line.startswith(mixed)], messages


def test_lexicon_pages_hold_every_word_once(service: httpx.Client) -> None:
    first = service.get("/v1/lexicon", params={"limit": 2}).json()
    rest = service.get("/v1/lexicon", params={"start": 2, "limit": 1000}).json()
    with open_shipped_lexicon() as lexicon:
        assert [word["gloss"] for word in first["words"] + rest["words"]] == list(lexicon.glosses)
        languages = [lexicon.language_of(gloss) for gloss in lexicon.glosses]
        assert [word["language"] for word in first["words"] + rest["words"]] == languages
        assert first["total"] == len(lexicon)


def test_lexicon_search_lists_prefix_matches_first(service: httpx.Client) -> None:
    found = service.get("/v1/lexicon", params={"search": "the"}).json()["words"]
    begins = [any(n.lower().startswith("the") for n in (w["gloss"], *w["synonyms"])) for w in found]
    assert begins == sorted(begins, reverse=True)
    assert any(begins)
    assert not all(begins)


def test_methods_health_and_metrics(service: httpx.Client) -> None:
    methods = {(method["kind"], method["name"]) for method in service.get("/v1/methods").json()}
    assert {
        ("cutter", "learned"),
        ("transition", "hermite"),
        ("duration", "tempo"),
        ("system", "lptransformer"),
    } <= methods
    assert service.get("/healthz").json()["status"] == "ok"
    before = service.get("/metrics").text
    service.get("/v1/methods")
    after = service.get("/metrics").text
    line = 'signsplice_requests_total{method="GET",route="/v1/methods",status="200"} '
    count = [float(text[text.index(line) + len(line) :].split()[0]) for text in (before, after)]
    assert count[1] == count[0] + 1


def test_schemathesis_finds_no_fault(service: httpx.Client, tmp_path: Path) -> None:
    """Requests generated from the service's own OpenAPI, and beyond it (https://schemathesis.readthedocs.io)."""
    (tmp_path / "schemathesis.toml").write_text(
        # 422 is also the answer to a word that the lexicon lacks, which no schema can express.
        '[checks.positive_data_acceptance]\nexpected-statuses = ["2xx", "422"]\n'
    )
    call = [str(Path(sys.executable).with_name("schemathesis")), "run", f"{service.base_url}openapi.json",
            "--checks", "all", "--max-examples", "12", "--seed", "1",
            "--request-timeout", f"{PATIENCE_S:g}", "--max-response-time", f"{PATIENCE_S:g}"]  # fmt: skip
    done = subprocess.run(call, capture_output=True, text=True, cwd=tmp_path, timeout=2 * PATIENCE_S)
    assert done.returncode == 0, done.stdout[-4000:]
    assert "Tested: 9" in done.stdout


# --- streams ---


def test_a_stream_equals_the_engines_stream(service: httpx.Client) -> None:
    messages = streamed(service, GLOSSES)
    pieces = list(stream(owners(GLOSSES)))
    np.testing.assert_array_equal(
        frames(messages), np.concatenate([frames_of(piece.clip) for piece in pieces]).astype("<f4")
    )
    texts = [message for message in messages if isinstance(message, dict)]
    units = [text for text in texts if text["type"] == "unit"]
    assert [unit["unit"]["glosses"] for unit in units] == [[gloss] for gloss in GLOSSES]
    texts = [text for text in texts if text["type"] != "unit"]
    rig = texts[0]
    assert rig["type"] == "skeleton"
    assert rig["names"] == list(pieces[0].clip.skeleton.names)
    assert (rig["cutter"], rig["transition"]) == ("learned", "learned")
    spans = [message["span"] for message in texts if message["type"] == "span"]
    assert [tuple(span["output"]) for span in spans] == [piece.span.output for piece in pieces]
    seams = [message["seam"] for message in texts if message["type"] == "seam"]
    assert [(seam["before"], seam["after"]) for seam in seams] == [("HELLO", "DEAF"), ("DEAF", "FRIEND")]
    assert texts[-1] == {"type": "done", "frames": len(frames(messages))}


def test_punctuation_pauses_a_sentence_and_a_stream_alike(service: httpx.Client) -> None:
    glosses = ["Hello,", "deaf?", "friend."]
    result = splice(owners(GLOSSES, pauses={0: ",", 1: "?", 2: "."}, brows={1: "raised"}))
    answer = service.post("/v1/sentence", json={"glosses": glosses}).json()
    assert without_timing(answer["report"]) == without_timing(json.loads(json.dumps(reports.describe(result))))
    assert [unit["pause"] for unit in answer["units"]] == [",", "?", "."]
    messages = streamed(service, glosses)
    np.testing.assert_array_equal(frames(messages), frames_of(result.clip).astype("<f4"))
    spans = [message["span"] for message in messages if isinstance(message, dict) and message["type"] == "span"]
    assert [span["pause"]["mark"] for span in spans if span["pause"]] == [",", "?", "."]
    plain = frames_of(splice(owners(GLOSSES, brows={1: "raised"})).clip).astype("<f4")
    np.testing.assert_array_equal(frames(streamed(service, glosses, pauses=False)), plain)
    asked = service.post("/v1/sentence", json={"glosses": glosses, "pauses": False}).json()
    assert asked["report"]["frames"] == len(plain)


def test_a_face_by_rule_is_in_the_files_of_a_sentence_that_asks_for_it(service: httpx.Client) -> None:
    asked = {"glosses": ["HELLO,", "DEAF?"], "face_rules": True, "formats": ["vrma"]}
    answer = service.post("/v1/sentence", json=asked).json()
    assert answer["report"]["face"] == {"recorded": [], "rules": ["blinks", "brows", "gaze"]}
    face = parse(base64.b64decode(answer["files"]["vrma"]), "a.vrma").face
    assert face is not None
    assert face.of(["browInnerUp"]).max() == pytest.approx(0.7)
    assert face.of(["eyeBlinkLeft"]).max() == 1.0


def test_a_stream_sends_a_face_before_its_frames() -> None:
    """Of the words that ship none has a face: what a worker makes of pieces is looked at here."""
    pieces = list(stream([add_random_face(clip, k) for k, clip in enumerate(clips(GLOSSES))]))
    opened = work._OpenStream(Stream(), SpliceOptions(), wire.OpenMessage(type="open"))
    messages = work._messages(opened, pieces)
    faces = [message for message in messages if isinstance(message, dict) and message["type"] == "face"]
    assert [face["first"] for face in faces] == [piece.span.output[0] for piece in pieces]
    for face, piece in zip(faces, pieces, strict=True):
        assert piece.clip.face is not None
        assert tuple(face["channels"]) == piece.clip.face.channels
        assert np.abs(np.array(face["weights"]) - piece.clip.face.weights).max() < 1e-4
        after = messages[messages.index(face) + 1]
        assert isinstance(after, bytes)
        assert struct.unpack_from("<II", after, 4) == (face["first"], len(face["weights"]))
        TypeAdapter(wire.FaceMessage).validate_python(face)


def test_forms_of_signs_are_signed(service: httpx.Client) -> None:
    answer = service.post("/v1/sentence", json={"glosses": ["I-GIVE-YOU", "BOOK-PLURAL"]}).json()
    assert [unit["glosses"] for unit in answer["units"]] == [["1-GIVE-2"], ["BOOK-PLURAL"]]
    messages = streamed(service, ["I-GIVE-YOU", "BOOK-PLURAL"])
    assert len(frames(messages)) == answer["report"]["frames"]


def test_streamed_quaternions_have_unit_length(service: httpx.Client) -> None:
    message = next(message for message in streamed(service, ["DEAF"]) if isinstance(message, bytes))
    values = np.frombuffer(message, "<f4", offset=16).reshape(struct.unpack_from("<I", message, 8)[0], -1)
    np.testing.assert_allclose(np.linalg.norm(values[:, 3:].reshape(len(values), -1, 4), axis=-1), 1.0, atol=1e-5)


def test_frames_come_before_the_sentence_ends(service: httpx.Client) -> None:
    with stream_client(service) as socket:
        socket.send(json.dumps({"type": "open", "paced": False}))
        for gloss in GLOSSES[:2]:
            socket.send(json.dumps({"type": "word", "gloss": gloss}))
        messages = [socket.recv(timeout=PATIENCE_S)]
        while not isinstance(messages[-1], bytes):
            messages.append(socket.recv(timeout=PATIENCE_S))
        types = [json.loads(text)["type"] for text in messages if isinstance(text, str)]
        assert types == ["unit", "unit", "skeleton", "span"]
        socket.send(json.dumps({"type": "end"}))
        assert any(isinstance(message, dict) and message["type"] == "done" for message in receive_all(socket))


def test_a_paced_stream_sends_the_same_frames_one_by_one(service: httpx.Client) -> None:
    paced = streamed(service, ["fs-A", "fs-B"], paced=True, sign_speed=4.0)
    unpaced = streamed(service, ["fs-A", "fs-B"], sign_speed=4.0)
    np.testing.assert_array_equal(frames(paced), frames(unpaced))
    counts = [wire.FRAMES_HEADER.unpack_from(message)[2] for message in paced if isinstance(message, bytes)]
    assert set(counts) == {1}


def test_a_stream_goes_on_without_an_unknown_word(service: httpx.Client) -> None:
    messages = streamed(service, ["HELLO", "NO-SUCH-WORD", "DEAF"], spell=False)
    errors = [message for message in messages if isinstance(message, dict) and message["type"] == "error"]
    assert list(errors[0]["unknown"]) == ["NO-SUCH-WORD"]
    np.testing.assert_array_equal(frames(messages), frames(streamed(service, ["HELLO", "DEAF"])))


def test_a_word_message_may_hold_several_glosses(service: httpx.Client) -> None:
    messages = streamed(service, ["HELLO", "MY  NAME\n", "DEAF"])
    np.testing.assert_array_equal(frames(messages), frames(streamed(service, ["HELLO", "MY", "NAME", "DEAF"])))


# --- lines of text ---

LINE = "Hi! I love you, do you like the dog? I'm Anna"


def test_a_text_is_signed_as_the_command_line_signs_it(service: httpx.Client, tmp_path: Path) -> None:
    out, report = tmp_path / "line.bvh", tmp_path / "line.json"
    app(["sentence", LINE, "-o", str(out), "--report", str(report)], standalone_mode=False)
    written = json.loads(report.read_text())
    answer = service.post("/v1/sentence", json={"text": LINE}).json()
    assert base64.b64decode(answer["files"]["bvh"]) == out.read_bytes()
    assert (answer["units"], answer["spelled"]) == (written["units"], written["spelled"])
    assert answer["spelled"] == ["do", "the", "Anna"]
    assert answer["units"] == service.post("/v1/sentence", json={"glosses": LINE.split()}).json()["units"]


def test_what_is_spelled_of_newcomers_sentences_is_said(service: httpx.Client) -> None:
    with (Path(__file__).parents[1] / "lexicon" / "newcomer_sentences.csv").open(encoding="utf-8", newline="") as file:
        table = list(csv.DictReader(file))
    for row in table:
        asked: dict[str, Any] = {"text": row["typed"], "formats": [], "drop_function_words": True}
        answer = service.post("/v1/sentence", json=asked).json()
        assert answer["spelled"] == row["spelled_without_function_words"].split()


def test_a_streams_text_is_read_as_a_sentence(service: httpx.Client) -> None:
    for dropped in (False, True):
        asked = {"text": LINE, "drop_function_words": dropped}
        answer = service.post("/v1/sentence", json=asked).json()
        with stream_client(service) as socket:
            socket.send(json.dumps({"type": "open", "paced": False, "drop_function_words": dropped}))
            for message in ({"type": "text", "text": LINE}, {"type": "end"}):
                socket.send(json.dumps(message))
            messages = receive_all(socket)
        units = [message["unit"] for message in messages if isinstance(message, dict) and message["type"] == "unit"]
        assert units == answer["units"]
        assert len(frames(messages)) == answer["report"]["frames"]
    assert answer["spelled"] == ["Anna"]
    assert [unit["token"] for unit in units if not unit["glosses"]] == ["do", "the"]


@pytest.mark.parametrize(
    ("typed", "language"),
    [
        ("Hello, my teachers' name is Zoë, $3.5! 你好 (how are you) HELLO#9 👋", "en"),
        ("Grüße aus Köln, 1.000,5!", "de"),
    ],
)
def test_a_line_is_read_alike_everywhere(service: httpx.Client, typed: str, language: str, tmp_path: Path) -> None:
    with ss.open_lexicon() as words:
        units = json.loads(json.dumps([asdict(token) for token in ss.parse(typed, words, language=language)]))
    report = tmp_path / "line.json"
    call = ["sentence", typed, "-o", str(tmp_path / "line.bvh"), "--language", language, "--report", str(report)]
    app(call, standalone_mode=False)
    assert json.loads(report.read_text())["units"] == units
    answer = service.post("/v1/sentence", json={"text": typed, "language": language})
    assert (answer.status_code, answer.json()["units"]) == (200, units)
    with stream_client(service) as socket:
        socket.send(json.dumps({"type": "open", "paced": False, "language": language}))
        for message in ({"type": "text", "text": typed}, {"type": "end"}):
            socket.send(json.dumps(message))
        messages = [message for message in receive_all(socket) if isinstance(message, dict)]
    assert [message["unit"] for message in messages if message["type"] == "unit"] == units
    assert not [message for message in messages if message["type"] == "error"]


def test_a_line_of_which_nothing_can_be_said_is_refused(service: httpx.Client) -> None:
    answer = service.post("/v1/sentence", json={"text": "你好 👋"})
    assert (answer.status_code, list(answer.json()["unknown"])) == (422, ["你好"])


def test_the_face_of_a_streams_text_is_that_of_the_sentence(service: httpx.Client) -> None:
    line, channels = "Hello my friend. What name?", ["eyeBlinkLeft", "browInnerUp", "browDownLeft"]
    sentence = {"text": line, "face_rules": True, "formats": ["vrma"]}
    whole = parse(base64.b64decode(service.post("/v1/sentence", json=sentence).json()["files"]["vrma"]), "a.vrma").face
    assert whole is not None
    for asked in (True, False):
        with stream_client(service) as socket:
            for message in (
                {"type": "open", "paced": False, "face_rules": asked},
                {"type": "text", "text": line},
                {"type": "end"},
            ):
                socket.send(json.dumps(message))
            faces = [one for one in receive_all(socket) if isinstance(one, dict) and one["type"] == "face"]
        assert bool(faces) == asked
        if asked:
            rows = [[row[one["channels"].index(name)] for name in channels] for one in faces for row in one["weights"]]
            np.testing.assert_allclose(rows, whole.of(channels), atol=1e-3)
            assert np.max(rows, axis=0)[0] == 1.0
            assert np.max(rows) > 0.7


def test_a_figure_can_show_a_whole_face(service: httpx.Client) -> None:
    asked = {"glosses": ["HELLO"], "formats": ["glb"], "whole_face": True}
    content = base64.b64decode(service.post("/v1/sentence", json=asked).json()["files"]["glb"])
    document = json.loads(content[20 : 20 + int.from_bytes(content[12:16], "little")])
    (names,) = (mesh["extras"]["targetNames"] for mesh in document["meshes"] if "extras" in mesh)
    assert {"jawOpen", "browDownLeft", "eyeBlinkLeft"} <= set(names)


def test_a_sentence_is_drawn_as_a_film(service: httpx.Client) -> None:
    answer = service.post("/v1/sentence?file=gif", json={"glosses": ["I"]})
    assert answer.headers["content-type"] == "image/gif"
    assert answer.content.startswith(b"GIF89a")


def test_glosses_and_text_are_alternatives(service: httpx.Client) -> None:
    refused: tuple[tuple[dict[str, object], str], ...] = (
        ({"text": "hello", "glosses": ["HELLO"]}, "both glosses and text, expected one of them"),
        ({}, "no glosses and text, expected one of them"),
        ({"text": "the a", "drop_function_words": True}, "ASL has no signs for these words"),
        ({"text": " "}, "no gloss in the sentence"),
        ({"text": "hello " * 201}, "201 words, expected at most 200"),
        ({"text": ""}, "body.text: String should have at least 1 character"),
    )
    for asked, error in refused:
        answer = service.post("/v1/sentence", json=asked)
        assert answer.status_code == 422
        assert answer.json()["error"].startswith(error)


def test_a_stream_goes_on_after_a_text_that_is_too_long_or_empty(service: httpx.Client) -> None:
    with stream_client(service) as socket:
        socket.send(json.dumps({"type": "open", "paced": False, "drop_function_words": True}))
        for text in ("hello " * 201, "the", "...", "hello"):
            socket.send(json.dumps({"type": "text", "text": text}))
        socket.send(json.dumps({"type": "end"}))
        texts = [message for message in receive_all(socket) if isinstance(message, dict)]
    assert [text["error"] for text in texts if text["type"] == "error"] == [
        "201 words, expected at most 200",
        "no gloss in the sentence, expected at least one",
    ]
    spans = [text["span"] for text in texts if text["type"] == "span"]
    assert [(span["kind"], span["name"]) for span in spans] == [("sign", "HELLO"), ("retraction", "HELLO")]


# --- types ---


def test_answers_and_messages_match_their_types(service: httpx.Client) -> None:
    """Workers write answers without FastAPI's checks, so all fields of the types are compared here."""
    spliced = TypeAdapter(wire.Spliced)
    answer = service.post("/v1/sentence", json={"glosses": ["HELLO", "fs-AB"]}).json()
    assert set(answer["report"].pop("person")) == {"amount", "seed", "planned"}, "not of every report, nor of its type"
    assert json.loads(spliced.dump_json(spliced.validate_python(answer))) == answer
    adapter: TypeAdapter[wire.ServiceMessage] = TypeAdapter(wire.ServiceMessage)
    messages = streamed(service, ["HELLO", "HELO9", "NO SUCH", "DEAF"])
    texts = [message for message in messages if isinstance(message, dict)]
    assert {message["type"] for message in texts} >= {"skeleton", "span", "seam", "warning", "done"}
    for message in texts:
        assert json.loads(adapter.dump_json(adapter.validate_python(message))) == message


def test_dials_are_named_as_the_engines_options() -> None:
    assert {field.name for field in fields(wire.Dials)} <= {field.name for field in fields(SpliceOptions)}


def test_a_json_type_has_lists_and_null_scores() -> None:
    @dataclass
    class Engine:
        """What the engine makes."""

        names: tuple[str, ...]
        frames: tuple[int, int] | None
        score: Number = float("nan")

    Json = json_type(Engine)
    types = {field.name: field.type for field in fields(Json)}
    assert types == {"names": list[str], "frames": tuple[int, int] | None, "score": float | None}
    assert (Json.__name__, Json.__doc__) == ("Engine", "What the engine makes.")
    with pytest.raises(TypeError, match="score"):
        Json(["a"], None)


def test_the_viewers_types_are_up_to_date() -> None:
    assert generate.FILE.read_text() == generate.render(), "run python viewer/generate.py"


def test_typescript_has_a_counterpart_for_every_type() -> None:
    text = generate.render()
    assert '  transition_time?: "auto" | "tempo" | "fixed" | number;' in text
    names = " | ".join(f'"{name}"' for name in wire.FORMAT_NAMES)
    assert f"  formats?: ({names})[];" in text
    assert "  body_sense?: boolean | null;" in text
    assert "export type ClientMessage = OpenMessage | WordMessage | TextMessage | EndMessage;" in text
    with pytest.raises(TypeError, match="no counterpart"):
        generate._type(complex)


# --- pages ---


def test_a_page_embeds_any_name_as_valid_json() -> None:
    if not page.BUILT.is_dir():
        pytest.skip("the viewer is not built (make viewer)")
    scene = {"name": "\udcff</script><b>", "report": {"seams": [float("nan")]}}
    text = page.html([scene], live=False)
    text.encode()
    inside = text[text.index(SCRIPT_START) + len(SCRIPT_START) :].split("</script>")[0]
    assert "<" not in inside
    assert json.loads(inside)["scenes"] == [{"name": scene["name"], "report": {"seams": [None]}}]


def test_view_writes_a_page_that_holds_the_clip(tmp_path: Path, words: dict[str, Clip]) -> None:
    save(words["DEAF"], tmp_path / "DEAF.bvh")
    try:
        app(["view", str(tmp_path / "DEAF.bvh"), "-o", str(tmp_path / "deaf.html")], standalone_mode=False)
    except MissingExtraError:
        pytest.skip("the viewer is not built (make viewer)")
    text = (tmp_path / "deaf.html").read_text()
    content = json.loads(text[text.index(SCRIPT_START) + len(SCRIPT_START) :].split("</script>")[0])
    assert content["live"] is False
    assert base64.b64decode(content["scenes"][0]["files"]["bvh"]) == bvh.encode(words["DEAF"])
    assert content["scenes"][0]["report"]["spans"][0]["output"] == [0, len(words["DEAF"])]


def test_the_service_names_whatever_inspect_names(service: httpx.Client, words: dict[str, Clip]) -> None:
    odd = replace(on_other_rig(words["SIGN"], np.asarray(rotation.IDENTITY), 1e-3)[30:45], name="odd")
    files = [("files", (f"{clip.name}.bvh", bvh.encode(clip))) for clip in (words["DEAF"], odd)]
    warnings = service.post("/v1/splice", files=files).json()["report"]["warnings"]
    named = inspect(bvh.parse(bvh.encode(odd), "odd.bvh"))["warnings"]
    assert len(named) == 2
    assert set(warnings) == {f"odd: {line}" for line in named}


def test_the_service_names_frames_that_do_not_belong(service: httpx.Client, words: dict[str, Clip]) -> None:
    posed = with_pose(words["SIGN"], arms_out(words["SIGN"].skeleton), 4)
    files = [("files", ("DEAF.bvh", bvh.encode(words["DEAF"]))), ("files", ("SIGN.bvh", bvh.encode(posed)))]
    report = service.post("/v1/splice", files=files).json()["report"]
    assert report["warnings"] == [
        "SIGN: frames 0 to 3: a T-pose that does not belong to the motion; left out of splices"
    ]
    assert report["spans"][-1]["source"][0] > 4
