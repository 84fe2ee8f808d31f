"""What a hostile caller tries: each is told off in one line, nothing is written, and the next request is served."""

from __future__ import annotations

import asyncio
import gzip
import io
import json
import os
import signal
import socket
import struct
import subprocess
import sys
import time
import zipfile
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus

from broken_bvh import BROKEN, SOUND, wide
from serving import talking
from signsplice.formats import gltf
from signsplice.motion.clip import Clip
from signsplice.service import work
from signsplice.service.settings import Settings
from signsplice.service.workers import WorkerProcess


def refused(answer: httpx.Response, status: int = 422) -> str:
    """The one line that a failure is told in."""
    assert answer.status_code == status, answer.text[:300]
    told = answer.json()
    assert set(told) == {"error", "unknown"}
    assert told["error"]
    assert "\n" not in told["error"]
    assert "Traceback" not in told["error"]
    return str(told["error"])


@pytest.fixture(autouse=True)
def serves_the_next(tight: httpx.Client, tight_folder: Path) -> Iterator[None]:
    """After every attack the service answers, with the same worker, and has left no file."""
    yield
    answer = tight.post("/v1/sentence?file=bvh", json={"glosses": ["HELLO"]})
    assert answer.text.startswith("HIERARCHY")
    # onnxruntime notes its session's number among temporary files.
    assert {path.name for path in tight_folder.iterdir()} <= {".ses"}


def upload(client: httpx.Client, content: bytes | str, name: str = "a.bvh", **data: str) -> httpx.Response:
    return client.post("/v1/splice", files={"files": (name, content)}, data=data)


@pytest.mark.parametrize("name", BROKEN)
def test_broken_bvh(tight: httpx.Client, name: str) -> None:
    content, said = BROKEN[name]
    if len(content) > 200_000:
        pytest.skip("longer than this service reads")
    told = refused(upload(tight, content))
    assert told.startswith("a.bvh:")
    assert " ".join(said.split()) in told


def zipped(n_bytes: int) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("local_rotations.npy", b"\0" * n_bytes)
    return out.getvalue()


def test_zip_bombs(tight: httpx.Client) -> None:
    bomb = zipped(50_000_000)
    assert len(bomb) < 100_000
    assert "expected .bvh, .glb or .vrma" in refused(upload(tight, bomb, "bomb.npz"))
    refused(upload(tight, bomb, "bomb.bvh"))
    refused(upload(tight, gzip.compress(SOUND.encode()), "bomb.glb"))
    body = gzip.compress(b" " * 50_000_000)
    answer = tight.post("/v1/sentence", content=body, headers={"content-encoding": "gzip"})
    assert "compressed" in refused(answer, 415)


def test_a_body_that_says_it_is_long(tight: httpx.Client) -> None:
    told = raw(tight, b"POST /v1/splice HTTP/1.1\r\nHost: localhost\r\nContent-Length: 500000000\r\n\r\n")
    assert b" 413 " in told.split(b"\r\n")[0]


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
    with suppress(httpx.WriteError, httpx.RemoteProtocolError):  # where the connection is closed in our face
        refused(tight.post(route, content=parts(), headers={"content-type": kind}), 413)
    assert n_sent < 20_000_000, "more was taken than sockets hold"


def raw(client: httpx.Client, *parts: bytes, pause: float = 0.0) -> bytes:
    """What comes back when parts are written to a bare socket, until the service closes it."""
    host, port = str(client.base_url.host), client.base_url.port
    with socket.create_connection((host, port), timeout=20.0) as line:
        for part in parts:
            try:
                line.sendall(part)
            except OSError:
                break
            time.sleep(pause)
        said = b""
        try:
            while chunk := line.recv(65536):
                said += chunk
        except ConnectionResetError:
            pass
        return said


def test_clients_that_are_slow(tight: httpx.Client) -> None:
    head = b"POST /v1/sentence HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
    assert b" 408 " in raw(tight, b"GET / HT").split(b"\r\n")[0]
    assert b" 408 " in raw(tight, *(bytes([letter]) for letter in head), pause=0.08).split(b"\r\n")[0]
    assert b" 408 " in raw(tight, head + b"Content-Length: 100\r\n\r\n{").split(b"\r\n")[0]


def test_others_are_served_beside_many_slow_clients(tight: httpx.Client) -> None:
    host, port = str(tight.base_url.host), tight.base_url.port
    lines = [socket.create_connection((host, port)) for _ in range(100)]
    try:
        for line in lines:
            line.sendall(b"POST /v1/sentence HTTP/1.1\r\nHost: localhost\r\n")
        assert tight.get("/healthz").json()["status"] == "ok"
    finally:
        for line in lines:
            line.close()


def test_pages_of_other_origins(tight: httpx.Client) -> None:
    with pytest.raises(InvalidStatus) as told, talking(tight, origin="https://evil.example"):
        pass
    assert told.value.response.status_code == 403
    with pytest.raises(InvalidStatus), talking(tight, origin="null"):
        pass
    for origin in ("https://evil.example", "http://[::1", "null"):
        answer = tight.post("/v1/sentence", json={"glosses": ["HELLO"]}, headers={"origin": origin})
        assert origin in refused(answer, 403)
    with talking(tight, origin=str(tight.base_url).rstrip("/")) as own:
        own.send('{"type": "open"}')


def test_another_name_that_leads_here(tight: httpx.Client) -> None:
    assert "evil.example" in refused(tight.get("/healthz", headers={"host": "evil.example"}), 421)
    refused(tight.get("/healthz", headers={"host": "127.0.0.1.evil.example:80"}), 421)
    refused(tight.get("/healthz", headers={"host": "192.0.2.1"}), 421)
    assert tight.get("/healthz", headers={"host": "LOCALHOST:80"}).status_code == 200


@pytest.mark.parametrize(
    ("host", "allowed", "asked", "let_in"),
    [
        ("127.0.0.1", (), "evil.example", False),
        ("127.0.0.1", (), "[::1]", True),
        ("127.0.0.1", ("signs.example",), "Signs.Example", True),
        ("0.0.0.0", (), "evil.example", False),
        ("0.0.0.0", (), "192.0.2.1", True),
        ("0.0.0.0", ("signs.example",), "signs.example", True),
        ("0.0.0.0", ("*",), "evil.example", True),
    ],
)
def test_names_that_a_service_answers_to(host: str, allowed: tuple[str, ...], asked: str, let_in: bool) -> None:
    assert Settings(host=host, allowed_hosts=allowed).answers_to(asked) is let_in


def test_a_worker_that_died_while_idle_costs_nobody_anything() -> None:
    async def killed() -> tuple[int, int, int]:
        worker = WorkerProcess(Settings(), skin=False)
        try:
            before = await worker.run(work.identity)
            await worker.run(work.warm, False)
            os.kill(before, signal.SIGKILL)
            await asyncio.sleep(1.0)
            return before, await worker.run(work.identity), worker.n_lost
        finally:
            worker.close()

    before, after, n_lost = asyncio.run(killed())
    assert after != before
    assert n_lost == 1


def test_many_wrong_glosses_are_told_by_the_first(tight: httpx.Client) -> None:
    body = json.dumps({"glosses": [1] * 50_000})
    told = refused(tight.post("/v1/sentence", content=body, headers={"content-type": "application/json"}))
    assert len(told) < 200
    long = json.dumps({"glosses": ["A" * 100] * 3000})
    refused(tight.post("/v1/sentence", content=long, headers={"content-type": "application/json"}), 413)


def test_a_word_of_too_many_frames_is_no_part_of_a_stream(tight: httpx.Client) -> None:
    with talking(tight) as line:
        line.send('{"type": "open", "paced": false, "fps": 240, "sign_speed": 0.1}')
        line.send('{"type": "word", "gloss": "fs-ABC"}')
        assert "expected at most 600" in json.loads(line.recv(timeout=20))["error"]
        line.send('{"type": "end"}')
        assert json.loads(line.recv(timeout=20)) == {"type": "done", "frames": 0}


@pytest.mark.parametrize(
    "gloss",
    ["../../../etc/passwd", "..\\..\\boot.ini", "/etc/passwd\0", "C:\\x", "%2e%2e%2f", "'; DROP TABLE word; --"],
)
def test_glosses_that_are_paths(tight: httpx.Client, gloss: str) -> None:
    told = refused(tight.post("/v1/sentence", json={"glosses": [gloss], "spell": False}))
    assert "root:" not in told
    assert len(tight.get("/v1/lexicon").json()["words"]) == 100


@pytest.mark.parametrize(
    "name", ["../../x.bvh", "/etc/x.bvh", "..\\x.bvh", "x\0y.bvh", "a" * 3000 + ".bvh", "\u202ehvb.bvh"]
)
def test_file_names_that_are_paths(tight: httpx.Client, name: str) -> None:
    answer = upload(tight, SOUND, name, options='{"formats": []}')
    if answer.status_code == 200:
        assert not set(answer.json()["name"]) & set("/\\\0")
        assert len(answer.json()["name"]) <= 80
    else:
        refused(answer)


@pytest.mark.parametrize("uri", ["../secret.bin", "secret.bin", "file:///etc/passwd", "http://127.0.0.1:1/x"])
def test_glb_that_asks_for_other_files(tight: httpx.Client, uri: str) -> None:
    told = {"asset": {"version": "2.0"}, "buffers": [{"uri": uri, "byteLength": 16}],
            "bufferViews": [{"buffer": 0, "byteLength": 16}], "nodes": [{"name": "a"}],
            "accessors": [{"bufferView": 0, "componentType": 5126, "count": 1, "type": "VEC4"},
                          {"bufferView": 0, "componentType": 5126, "count": 1, "type": "SCALAR"}],
            "animations": [{"channels": [{"sampler": 0, "target": {"node": 0, "path": "rotation"}}],
                            "samplers": [{"input": 1, "output": 0}]}]}  # fmt: skip
    text = json.dumps(told).encode()
    text += b" " * (-len(text) % 4)
    glb = struct.pack("<4sIIII", b"glTF", 2, 20 + len(text), len(text), 0x4E4F534A) + text
    assert "in another file" in refused(upload(tight, glb, "a.glb"))


def test_glb_of_more_numbers_than_there_are(tight: httpx.Client, words: dict[str, Clip]) -> None:
    made = gltf.vrm_animation(words["DEAF"][:3])
    for accessor in made.accessors:
        accessor.count, accessor.bufferView = 2_000_000_000, None
    assert refused(upload(tight, b"".join(made.save_to_bytes()), "a.vrma")).startswith("a.vrma:")


def many(n_frames: int, seconds: float) -> str:
    """A root that turns, ``n_frames`` in all."""
    head = "HIERARCHY\nROOT r\n{\nOFFSET 0 0 0\nCHANNELS 1 Zrotation\n}\nMOTION\n"
    return f"{head}Frames: {n_frames}\nFrame Time: {seconds}\n" + "0\n" * n_frames


def test_more_frames_than_are_allowed(tight: httpx.Client) -> None:
    assert "expected at most 600" in refused(upload(tight, many(601, 0.1)))
    assert "expected at most 600" in refused(upload(tight, many(20, 1000.0), options='{"fps": 240}'))
    two = [("files", (f"{k}.bvh", many(400, 0.1))) for k in range(2)]
    assert "expected at most 600" in refused(tight.post("/v1/splice", files=two))
    glosses = ["THANK-YOU"] * 6
    assert "expected at most 600" in refused(tight.post("/v1/sentence", json={"glosses": glosses, "sign_speed": 0.2}))


def test_more_words_and_files_than_are_allowed(tight: httpx.Client) -> None:
    assert "at most 6" in refused(tight.post("/v1/sentence", json={"glosses": ["HELLO"] * 7}))
    assert "at most 6" in refused(tight.post("/v1/sentence", json={"glosses": ["fs-ABCDEFGH"]}))
    files = [("files", (f"{k}.bvh", SOUND)) for k in range(4)]
    assert "at most 3" in refused(tight.post("/v1/splice", files=files))


def test_work_without_end_is_ended_and_its_worker_replaced(tight: httpx.Client) -> None:
    def n_lost() -> float:
        return float(tight.get("/metrics").text.split("\nsignsplice_workers_lost ")[1].split()[0])

    before = n_lost()
    answer = upload(tight, wide(900), options='{"formats": ["glb"]}')
    assert "took more than 12 s" in refused(answer)
    assert n_lost() == before + 1


@pytest.mark.parametrize(
    ("body", "said"),
    [
        (b"", "body"),
        (b"{", "JSON"),
        (b"[]", "body"),
        (b'{"glosses": []}', "at least 1"),
        (b'{"glosses": ["HELLO"], "sign_sped": 2}', "sign_sped"),
        (b'{"glosses": ["HELLO"], "fps": NaN}', ""),
        (b'{"glosses": ["HELLO"], "sign_speed": 1e999}', ""),
        (b'{"glosses": ["HELLO"], "cutter": "../weights"}', "cutter"),
        (b'{"glosses": ["HELLO"], "formats": ["npz"]}', "bvh"),
        ('{"glosses": ["' + "A" * 5000 + '"]}', "200"),
        (b"\xff\xfe", ""),
    ],
)
def test_bodies_that_are_no_sentence(tight: httpx.Client, body: bytes | str, said: str) -> None:
    answer = tight.post("/v1/sentence", content=body, headers={"content-type": "application/json"})
    assert 400 <= answer.status_code < 500
    assert said in refused(answer, answer.status_code)


GARBAGE: dict[str, tuple[list[Any], str]] = {
    "binary": ([b"\0\1\2"], "binary"),
    "no JSON": (["{"], "no message"),
    "an array": (["[]"], "no message"),
    "an unknown type": (['{"type": "shout"}'], "no message"),
    "a word first": (['{"type": "word", "gloss": "HELLO"}'], "expected open"),
    "open twice": (['{"type": "open"}', '{"type": "open"}'], "twice"),
    "a word after the end": (
        ['{"type": "open"}', '{"type": "end"}', '{"type": "word", "gloss": "HELLO"}'],
        "after the end",
    ),
    "a dial out of range": (['{"type": "open", "sign_speed": -1}'], "sign_speed"),
    "a method that is not": (['{"type": "open", "cutter": "no-such"}'], "no-such"),
    "nothing at all": ([], "within 1 s"),
    "silence": (['{"type": "open"}'], "nothing came for 2 s"),
}


@pytest.mark.parametrize("name", GARBAGE)
def test_garbage_on_a_stream(tight: httpx.Client, name: str) -> None:
    messages, said = GARBAGE[name]
    with talking(tight) as line:
        for message in messages:
            line.send(message)
        told = json.loads(line.recv(timeout=20))
        assert told["type"] == "error"
        assert said in told["error"]
        with pytest.raises(ConnectionClosed):
            line.recv(timeout=20)


def test_a_message_without_end(tight: httpx.Client) -> None:
    with talking(tight) as line:
        line.send('{"type": "open", "cutter": "' + "A" * 100_000 + '"}')
        with pytest.raises(ConnectionClosed):
            line.recv(timeout=20)


def test_more_streams_than_are_allowed(tight: httpx.Client) -> None:
    with talking(tight) as one, talking(tight) as two:
        for line in (one, two):
            line.send('{"type": "open"}')
        with talking(tight) as three:
            assert "too many streams" in json.loads(three.recv(timeout=20))["error"]
            with pytest.raises(ConnectionClosed):
                three.recv(timeout=20)
        one.send('{"type": "end"}')
        assert json.loads(one.recv(timeout=20))["type"] == "done"


def test_a_stream_that_nobody_takes_holds_no_one_up(tight: httpx.Client) -> None:
    with talking(tight, max_queue=1) as line:
        line.send('{"type": "open", "paced": false}')
        for _ in range(40):
            line.send('{"type": "word", "gloss": "HELLO"}')
        assert tight.get("/healthz").json()["streams"] >= 1
        answer = tight.post("/v1/sentence?file=bvh", json={"glosses": ["DEAF"]})
        assert answer.status_code == 200
    late = time.monotonic() + 20.0
    while tight.get("/healthz").json()["streams"] and time.monotonic() < late:
        time.sleep(0.1)
    assert tight.get("/healthz").json()["streams"] == 0, "a stream whose client went is still there"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--limit", "max_body_bytes=0"], "positive"),
        (["--limit", "no_such=1"], "no limit"),
        (["--limit", "max_files=many"], "no number"),
        (["--port", "70000"], "0 to 65535"),
        (["--lexicon", "no/such/folder"], "no such folder"),
        (["--host", "203.0.113.7"], "cannot listen"),
    ],
)
def test_a_service_that_cannot_be(arguments: list[str], said: str, tmp_path: Path) -> None:
    call = [sys.executable, "-m", "signsplice", "serve", *arguments]
    done = subprocess.run(call, capture_output=True, text=True, cwd=tmp_path, timeout=60)
    assert done.returncode == 2
    assert done.stderr.startswith("error: ")
    assert said in done.stderr


def test_schemathesis_finds_nothing(service: httpx.Client, tmp_path: Path) -> None:
    """Requests drawn from the service's own OpenAPI, and beyond it (https://schemathesis.readthedocs.io)."""
    (tmp_path / "schemathesis.toml").write_text(
        # 422 is also what is said of a word that the lexicon has not, which no schema can tell.
        '[checks.positive_data_acceptance]\nexpected-statuses = ["2xx", "422"]\n'
    )
    call = [str(Path(sys.executable).with_name("schemathesis")), "run", f"{service.base_url}openapi.json",
            "--checks", "all", "--max-examples", "12", "--seed", "1", "--request-timeout", "60"]  # fmt: skip
    done = subprocess.run(call, capture_output=True, text=True, cwd=tmp_path, timeout=300)
    assert done.returncode == 0, done.stdout[-4000:]
    assert "Tested: 6" in done.stdout


def test_numbers_of_a_stream_are_whole(service: httpx.Client) -> None:
    """A quaternion of every joint of every frame has length one, so no byte is lost or moved."""
    with talking(service) as line:
        line.send('{"type": "open", "paced": false}')
        line.send('{"type": "word", "gloss": "DEAF"}')
        line.send('{"type": "end"}')
        (part,) = [said for said in line if isinstance(said, bytes)]
    numbers = np.frombuffer(part, "<f4", offset=16).reshape(struct.unpack_from("<I", part, 8)[0], -1)
    np.testing.assert_allclose(np.linalg.norm(numbers[:, 3:].reshape(len(numbers), -1, 4), axis=-1), 1.0, atol=1e-5)
