"""How the service sends its page, and answers to HEAD."""

from __future__ import annotations

import base64
import gzip
import json
import re
from pathlib import Path

import httpx
import pytest
from click.testing import CliRunner
from starlette.datastructures import Headers
from starlette.responses import Response

import avatars
from signsplice.body.retarget import retarget
from signsplice.cli.commands import app
from signsplice.formats import gltf_document, load, save
from signsplice.formats.avatar import read_avatar
from signsplice.motion import Clip
from signsplice.service import page, scene

TEXT = '<html><script type="application/json" id="signsplice">null</script>' + "hello " * 1000


@pytest.fixture
def pages(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> page.PageResponses:
    """The answers of a service whose built page is a short one."""
    (tmp_path / "index.html").write_text(TEXT)
    monkeypatch.setattr(page, "_INDEX", tmp_path / "index.html")
    return page.PageResponses([{"name": "HELLO"}])


def answer(pages: page.PageResponses, **headers: str) -> Response:
    return pages.answer(Headers({name.replace("_", "-"): value for name, value in headers.items()}))


@pytest.mark.parametrize("accepted", ["gzip", "br, GZIP;q=0.5", "deflate,  gzip ; q=1.0", "*"])
def test_the_page_is_compressed_where_the_client_accepts_that(pages: page.PageResponses, accepted: str) -> None:
    got = answer(pages, accept_encoding=accepted)
    assert got.headers["content-encoding"] == "gzip"
    assert got.headers["content-length"] == str(len(got.body))
    assert len(got.body) < len(TEXT) / 10
    assert gzip.decompress(got.body) == answer(pages).body


@pytest.mark.parametrize("accepted", ["", "br", "identity", "gzip;q=0", "gzip; q=0.000, *", "*;q=0", "xgzip"])
def test_the_page_is_sent_as_it_is_to_other_clients(pages: page.PageResponses, accepted: str) -> None:
    got = answer(pages, accept_encoding=accepted)
    assert "content-encoding" not in got.headers
    assert bytes(got.body).decode() == TEXT.replace("null", '{"scenes": [{"name": "HELLO"}], "live": true}')


def test_a_client_that_has_the_page_gets_it_once_for_each_encoding(pages: page.PageResponses) -> None:
    first, packed = answer(pages), answer(pages, accept_encoding="gzip")
    assert first.headers["vary"] == packed.headers["vary"] == "Accept-Encoding"
    assert first.headers["etag"] != packed.headers["etag"]
    for tag in (packed.headers["etag"], f'"other", W/{packed.headers["etag"]}', "*"):
        again = answer(pages, accept_encoding="gzip", if_none_match=tag)
        assert (again.status_code, again.body) == (304, b"")
        assert again.headers["etag"] == packed.headers["etag"]
        assert again.headers["content-security-policy"] == "frame-ancestors 'none'"
    assert answer(pages, if_none_match=packed.headers["etag"]).status_code == 200


def test_pages_that_are_allowed_to_may_show_it_in_a_frame(pages: page.PageResponses) -> None:
    assert answer(pages).headers["x-frame-options"] == "DENY"
    framed = answer(page.PageResponses([], ["https://a.example", "http://b.example:8080"]))
    assert framed.headers["content-security-policy"] == "frame-ancestors https://a.example http://b.example:8080"
    assert "x-frame-options" not in framed.headers


def test_another_scene_has_another_tag(pages: page.PageResponses) -> None:
    assert answer(page.PageResponses([])).headers["etag"] != answer(pages).headers["etag"]


@pytest.mark.parametrize("path", ["/healthz", "/v1/methods", "/v1/lexicon?limit=3", "/openapi.json"])
def test_head_is_answered_as_get_without_a_body(service: httpx.Client, path: str) -> None:
    head, get = service.head(path), service.get(path)
    assert (head.status_code, head.content) == (200, b"")
    for name in ("content-length", "content-type", "content-security-policy"):
        assert head.headers[name] == get.headers[name]


def test_head_is_answered_for_the_page_its_files_and_the_counters(service: httpx.Client) -> None:
    assert service.head("/metrics").status_code == 200
    if not page.BUILT.is_dir():
        assert service.head("/").status_code == 404
        pytest.skip("the viewer is not built (make viewer)")
    for path in ("/", "/docs", "/docs/files/swagger-ui.css"):
        head = service.head(path)
        assert (head.status_code, head.content) == (200, b"")
        assert int(head.headers["content-length"]) > 500


def test_head_has_no_place_in_the_document_of_the_routes(service: httpx.Client) -> None:
    assert all("head" not in methods for methods in service.get("/openapi.json").json()["paths"].values())


def figure_in(call: list[str], output: Path) -> bytes:
    """The .glb in the page that a call of ``view`` writes."""
    done = CliRunner().invoke(app, ["view", *call, "-o", str(output)])
    assert done.exit_code == 0, done.output
    found = re.search('id="signsplice">(.*?)</script>', output.read_text(encoding="utf-8"))
    assert found
    (scene,) = json.loads(found[1])["scenes"]
    return base64.b64decode(scene["files"]["glb"])


def meshes(glb: bytes) -> list[str]:
    return [mesh["name"] for mesh in json.loads(gltf_document.chunks("it", glb)[0])["meshes"]]


def test_a_page_shows_the_figure_of_its_file_or_an_avatar(
    tmp_path: Path, words: dict[str, Clip], pages: page.PageResponses
) -> None:
    broad = avatars.body("broad")
    avatar = avatars.write(tmp_path / "avatar.glb", broad, avatars.tubes(broad), "", hair=False)
    clip = words["HELLO"][:40]
    save(clip, tmp_path / "clip.bvh")
    save(retarget(clip, read_avatar(avatar)).clip, tmp_path / "own.glb")
    (tmp_path / "bones.glb").write_bytes(scene.encode(clip, "glb", mesh=False))
    out, own = tmp_path / "page.html", tmp_path / "own.glb"
    assert figure_in([str(own)], out) == own.read_bytes()
    assert meshes(figure_in([str(tmp_path / "clip.bvh"), "--avatar", str(avatar)], out)) == meshes(own.read_bytes())
    mannequin = meshes(figure_in([str(tmp_path / "bones.glb")], out))
    assert mannequin != meshes(own.read_bytes())
    # At another rate than the file's own, the file does not show what the report says.
    assert meshes(figure_in([str(own), "--input-fps", "10"], out)) == mannequin
    assert len(load(own)) == 40
