"""How the service sends its page, and answers to HEAD."""

from __future__ import annotations

import gzip
from pathlib import Path

import httpx
import pytest
from starlette.datastructures import Headers
from starlette.responses import Response

from signsplice.service import page

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
