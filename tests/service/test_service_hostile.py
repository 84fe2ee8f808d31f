"""Hostile callers: each gets an error of one line, no file is written, and the next request is served."""

from __future__ import annotations

import gzip
import io
import json
import socket
import struct
import time
import zipfile
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from shutil import rmtree
from typing import Any

import httpx
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus

from broken_bvh import BROKEN, VALID, wide
from serving import PATIENCE_S, messages_and_close_code, raw_request, stream_client
from signsplice.formats import WIRE_SUFFIXES, join_suffixes, vrma
from signsplice.motion import Clip


def error_of(answer: httpx.Response, status: int = 422) -> str:
    """The error message of an answer, which has to be one line."""
    assert answer.status_code == status, answer.text[:300]
    body = answer.json()
    assert set(body) == {"error", "unknown"}
    assert body["error"]
    assert "\n" not in body["error"]
    assert "Traceback" not in body["error"]
    return str(body["error"])


@pytest.fixture(autouse=True)
def next_request_is_served(tight: httpx.Client, tight_folder: Path) -> Iterator[None]:
    """After every attack the service answers, and has left no stream and no file."""
    yield
    answer = tight.post("/v1/sentence?file=bvh", json={"glosses": ["HELLO"]})
    assert answer.text.startswith("HIERARCHY")
    deadline = time.monotonic() + PATIENCE_S
    while n_streams(tight) and time.monotonic() < deadline:
        time.sleep(0.02)
    assert n_streams(tight) == 0, "a stream remains whose client is gone"
    assert list(tight_folder.iterdir()) == []


def n_streams(client: httpx.Client) -> int:
    return int(client.get("/healthz").json()["streams"])


def upload(client: httpx.Client, content: bytes | str, name: str = "a.bvh", **data: str) -> httpx.Response:
    return client.post("/v1/splice", files={"files": (name, content)}, data=data)


# --- bodies ---


@pytest.mark.parametrize("name", BROKEN)
def test_broken_bvh_is_refused_with_the_readers_message(tight: httpx.Client, name: str) -> None:
    content, message = BROKEN[name]
    if len(content) > 200_000:
        pytest.skip("longer than this service reads")
    error = error_of(upload(tight, content))
    assert error.startswith("a.bvh:")
    assert " ".join(message.split()) in error


def zipped(n_bytes: int) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("local_rotations.npy", b"\0" * n_bytes)
    return out.getvalue()


def test_zip_bombs_are_not_unpacked(tight: httpx.Client) -> None:
    bomb = zipped(50_000_000)
    assert len(bomb) < 100_000
    assert f"expected {join_suffixes(WIRE_SUFFIXES)}" in error_of(upload(tight, bomb, "bomb.npz"))
    error_of(upload(tight, bomb, "bomb.bvh"))
    error_of(upload(tight, gzip.compress(VALID.encode()), "bomb.glb"))
    body = gzip.compress(b" " * 50_000_000)
    answer = tight.post("/v1/sentence", content=body, headers={"content-encoding": "gzip"})
    assert "compressed" in error_of(answer, 415)


def test_a_body_declared_too_long_is_not_read(tight: httpx.Client) -> None:
    head = b"POST /v1/splice HTTP/1.1\r\nHost: localhost\r\nContent-Length: 500000000\r\n\r\n"
    assert b" 413 " in raw_request(tight, head).split(b"\r\n")[0]


@pytest.mark.parametrize("kind", ["multipart/form-data; boundary=b", "application/json"])
def test_a_long_body_is_cut_off_while_it_is_read(tight: httpx.Client, kind: str) -> None:
    n_sent = 0

    def parts() -> Iterator[bytes]:
        nonlocal n_sent
        yield b'--b\r\nContent-Disposition: form-data; name="files"; filename="a.bvh"\r\n\r\n'
        for _ in range(8000):  # 500 MB
            yield b" " * 65536
            n_sent += 65536

    route = "/v1/splice" if "form" in kind else "/v1/sentence"
    with suppress(httpx.WriteError, httpx.RemoteProtocolError):  # where the connection closes before the answer is read
        error_of(tight.post(route, content=parts(), headers={"content-type": kind}), 413)
    assert n_sent < 20_000_000, "more was read than sockets buffer"


@pytest.mark.parametrize(
    ("body", "message"),
    [
        (b"", "body"),
        (b"{", "JSON"),
        (b"[]", "body"),
        (b'{"glosses": []}', "at least 1"),
        (b'{"glosses": ["HELLO"], "sign_sped": 2}', "sign_sped"),
        (b'{"glosses": ["HELLO"], "avoid_collisions": false}', "avoid_collisions"),
        (b'{"glosses": ["HELLO"], "fps": NaN}', ""),
        (b'{"glosses": ["HELLO"], "sign_speed": 1e999}', ""),
        (b'{"glosses": ["HELLO"], "cutter": "../weights"}', "cutter"),
        (b'{"glosses": ["HELLO"], "formats": ["npz"]}', "bvh"),
        ('{"glosses": ["' + "A" * 5000 + '"]}', "200"),
        (b"\xff\xfe", ""),
    ],
)
def test_bodies_that_are_no_sentence_are_refused(tight: httpx.Client, body: bytes | str, message: str) -> None:
    answer = tight.post("/v1/sentence", content=body, headers={"content-type": "application/json"})
    assert 400 <= answer.status_code < 500
    assert message in error_of(answer, answer.status_code)


def test_words_within_a_gloss_are_counted_before_they_are_looked_up(tight: httpx.Client) -> None:
    answer = tight.post("/v1/sentence", json={"glosses": ["qq/" * 7], "spell": False})
    assert error_of(answer) == "7 words, expected at most 6"


def test_many_invalid_glosses_give_one_short_error(tight: httpx.Client) -> None:
    body = json.dumps({"glosses": [1] * 50_000})
    error = error_of(tight.post("/v1/sentence", content=body, headers={"content-type": "application/json"}))
    assert len(error) < 200
    long = json.dumps({"glosses": ["A" * 100] * 3000})
    error_of(tight.post("/v1/sentence", content=long, headers={"content-type": "application/json"}), 413)


@pytest.mark.parametrize("uri", ["../secret.bin", "secret.bin", "file:///etc/passwd", "http://127.0.0.1:1/x"])
def test_glb_files_cannot_refer_to_other_files(tight: httpx.Client, uri: str) -> None:
    document = {"asset": {"version": "2.0"}, "buffers": [{"uri": uri, "byteLength": 16}],
                "bufferViews": [{"buffer": 0, "byteLength": 16}], "nodes": [{"name": "a"}],
                "accessors": [{"bufferView": 0, "componentType": 5126, "count": 1, "type": "VEC4"},
                              {"bufferView": 0, "componentType": 5126, "count": 1, "type": "SCALAR"}],
                "animations": [{"channels": [{"sampler": 0, "target": {"node": 0, "path": "rotation"}}],
                                "samplers": [{"input": 1, "output": 0}]}]}  # fmt: skip
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    content = struct.pack("<4sIIII", b"glTF", 2, 20 + len(text), len(text), 0x4E4F534A) + text
    assert "in another file" in error_of(upload(tight, content, "a.glb"))


def test_glb_counts_beyond_the_data_are_refused(tight: httpx.Client, words: dict[str, Clip]) -> None:
    document = vrma.document(words["DEAF"][:3])
    for accessor in document.accessors:
        accessor.count, accessor.bufferView = 2_000_000_000, None
    assert error_of(upload(tight, b"".join(document.save_to_bytes()), "a.vrma")).startswith("a.vrma:")


# --- slow clients, foreign pages, paths ---


def test_others_are_served_during_many_slow_requests(tight: httpx.Client) -> None:
    host, port = str(tight.base_url.host), tight.base_url.port
    connections = [socket.create_connection((host, port)) for _ in range(100)]
    try:
        for connection in connections:
            connection.sendall(b"POST /v1/sentence HTTP/1.1\r\nHost: localhost\r\n")
        assert tight.get("/healthz").json()["status"] == "ok"
    finally:
        for connection in connections:
            connection.close()


def test_pages_of_other_origins_are_refused(tight: httpx.Client) -> None:
    with pytest.raises(InvalidStatus) as refusal, stream_client(tight, origin="https://evil.example"):
        pass
    assert refusal.value.response.status_code == 403
    with pytest.raises(InvalidStatus), stream_client(tight, origin="null"):
        pass
    for origin in ("https://evil.example", "http://[::1", "null"):
        answer = tight.post("/v1/sentence", json={"glosses": ["HELLO"]}, headers={"origin": origin})
        assert origin in error_of(answer, 403)
    with stream_client(tight, origin=str(tight.base_url).rstrip("/")) as same_origin:
        same_origin.send('{"type": "open"}')


def test_foreign_host_names_are_refused(tight: httpx.Client) -> None:
    assert "evil.example" in error_of(tight.get("/healthz", headers={"host": "evil.example"}), 421)
    error_of(tight.get("/healthz", headers={"host": "127.0.0.1.evil.example:80"}), 421)
    error_of(tight.get("/healthz", headers={"host": "192.0.2.1"}), 421)
    assert tight.get("/healthz", headers={"host": "LOCALHOST:80"}).status_code == 200


@pytest.mark.parametrize(
    "gloss",
    ["../../../etc/passwd", "..\\..\\boot.ini", "/etc/passwd\0", "C:\\x", "%2e%2e%2f", "'; DROP TABLE word; --"],
)
def test_glosses_that_are_paths_open_no_file(tight: httpx.Client, gloss: str) -> None:
    error = error_of(tight.post("/v1/sentence", json={"glosses": [gloss], "spell": False}))
    assert "root:" not in error
    assert len(tight.get("/v1/lexicon").json()["words"]) == 100


@pytest.mark.parametrize(
    "name", ["../../x.bvh", "/etc/x.bvh", "..\\x.bvh", "x\0y.bvh", "a" * 3000 + ".bvh", "\u202ehvb.bvh"]
)
def test_file_names_that_are_paths_open_no_file(tight: httpx.Client, name: str) -> None:
    answer = upload(tight, VALID, name, options='{"formats": []}')
    if answer.status_code == 200:
        assert not set(answer.json()["name"]) & set("/\\\0")
        assert len(answer.json()["name"]) <= 80
    else:
        error_of(answer)


# --- too much work ---


def many_frames(n_frames: int, frame_seconds: float) -> str:
    """A BVH file of one joint."""
    head = "HIERARCHY\nROOT r\n{\nOFFSET 0 0 0\nCHANNELS 1 Zrotation\n}\nMOTION\n"
    return f"{head}Frames: {n_frames}\nFrame Time: {frame_seconds}\n" + "0\n" * n_frames


def test_more_frames_than_allowed_are_refused(tight: httpx.Client) -> None:
    assert "expected at most 600" in error_of(upload(tight, many_frames(601, 0.1)))
    assert "expected at most 600" in error_of(upload(tight, many_frames(20, 2000.0), options='{"fps": 240}'))
    two = [("files", (f"{k}.bvh", many_frames(400, 0.1))) for k in range(2)]
    assert "expected at most 600" in error_of(tight.post("/v1/splice", files=two))
    glosses = ["THANK-YOU"] * 6
    assert "expected at most 600" in error_of(tight.post("/v1/sentence", json={"glosses": glosses, "sign_speed": 0.2}))


def test_more_words_and_files_than_allowed_are_refused(tight: httpx.Client) -> None:
    assert "at most 6" in error_of(tight.post("/v1/sentence", json={"glosses": ["HELLO"] * 7}))
    assert "at most 6" in error_of(tight.post("/v1/sentence", json={"glosses": ["fs-ABCDEFGH"]}))
    files = [("files", (f"{k}.bvh", VALID)) for k in range(4)]
    assert "at most 3" in error_of(tight.post("/v1/splice", files=files))


def test_endless_work_is_ended_and_its_worker_replaced(tight: httpx.Client, tight_folder: Path) -> None:
    def n_lost() -> float:
        return float(tight.get("/metrics").text.split("\nsignsplice_workers_lost ")[1].split()[0])

    before = n_lost()
    many = wide(900).replace("Frames: 1\n", "Frames: 5\n") + 4 * f"{'0 ' * 900}\n"  # each joint fills the picture
    answer = tight.post("/v1/splice?file=gif", files={"files": ("a.bvh", many)})
    assert "took more than 3 s of work" in error_of(answer)
    assert n_lost() == before + 1
    for folder in tight_folder.iterdir():  # a process that is killed cannot remove its picture's folder
        rmtree(folder)


# --- streams ---

WRONG_MESSAGES: dict[str, tuple[list[Any], str]] = {
    "binary": ([b"\0\1\2"], "binary"),
    "no JSON": (["{"], "no message"),
    "an array": (["[]"], "no message"),
    "an unknown type": (['{"type": "shout"}'], "no message"),
    "a word first": (['{"type": "word", "gloss": "HELLO"}'], "expected open"),
    "open twice": (['{"type": "open"}', '{"type": "open"}'], "twice"),
    "a word after the end": (
        [  # paced, so that the stream is not done when the last one comes
            '{"type": "open"}',
            '{"type": "word", "gloss": "HELLO"}',
            '{"type": "end"}',
            '{"type": "word", "gloss": "HELLO"}',
        ],
        "after the end",
    ),
    "a dial out of range": (['{"type": "open", "sign_speed": -1}'], "sign_speed"),
    "a person over 1": (['{"type": "open", "person": 1.5}'], "person"),
    "a seed below 0": (['{"type": "open", "seed": -1}'], "seed"),
    "an unknown method": (['{"type": "open", "cutter": "no-such"}'], "no-such"),
}


@pytest.mark.parametrize("name", WRONG_MESSAGES)
def test_wrong_messages_close_the_stream(tight: httpx.Client, name: str) -> None:
    messages, error = WRONG_MESSAGES[name]
    with stream_client(tight) as stream:
        for message in messages:
            stream.send(message)
        received, close_code = messages_and_close_code(stream)
        assert error in received[-1]["error"]
        assert close_code == 1008


def test_a_too_long_message_closes_the_stream(tight: httpx.Client) -> None:
    with stream_client(tight) as stream:
        stream.send('{"type": "open", "cutter": "' + "A" * 100_000 + '"}')
        with pytest.raises(ConnectionClosed):
            stream.recv(timeout=PATIENCE_S)


def test_a_word_of_too_many_frames_is_left_out(tight: httpx.Client) -> None:
    with stream_client(tight) as stream:
        stream.send('{"type": "open", "paced": false, "fps": 240, "sign_speed": 0.1}')
        stream.send('{"type": "word", "gloss": "fs-ABC"}')
        assert json.loads(stream.recv(timeout=PATIENCE_S))["unit"]["spelled"]
        assert "expected at most 600" in json.loads(stream.recv(timeout=PATIENCE_S))["error"]
        stream.send('{"type": "end"}')
        assert json.loads(stream.recv(timeout=PATIENCE_S)) == {"type": "done", "frames": 0}


def test_more_streams_than_allowed_are_refused(tight: httpx.Client) -> None:
    with stream_client(tight) as one, stream_client(tight) as two:
        for stream in (one, two):
            stream.send('{"type": "open"}')
        with stream_client(tight) as three:
            assert "too many streams" in json.loads(three.recv(timeout=PATIENCE_S))["error"]
            with pytest.raises(ConnectionClosed):
                three.recv(timeout=PATIENCE_S)
        one.send('{"type": "end"}')
        assert json.loads(one.recv(timeout=PATIENCE_S))["type"] == "done"


def test_a_stream_that_is_not_read_blocks_nobody(tight: httpx.Client) -> None:
    with stream_client(tight, max_queue=1, close_timeout=0.1) as stream:
        stream.send('{"type": "open", "paced": false}')
        for _ in range(40):
            stream.send('{"type": "word", "gloss": "HELLO"}')
        assert n_streams(tight) == 1
        answer = tight.post("/v1/sentence?file=bvh", json={"glosses": ["DEAF"]})
        assert answer.status_code == 200
