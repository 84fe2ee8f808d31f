"""What a browser is told that asks for the page of another origin."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

import httpx
import pytest

from signsplice.service.app import create
from signsplice.service.settings import Settings

Ask = Callable[..., httpx.Response]

ASKS = {"Access-Control-Request-Method": "POST", "Access-Control-Request-Headers": "content-type"}
ALLOWED, OTHER = {"Origin": "https://signs.example"}, {"Origin": "https://other.example"}


@pytest.fixture(scope="module")
def pages() -> Ask:
    """Asks a service that pages of one origin may call; it has no worker processes."""
    app = create(Settings(allowed_origins=("https://signs.example",)))

    async def asked(method: str, path: str, **options: Any) -> httpx.Response:
        async with httpx.AsyncClient(transport=httpx.ASGITransport(app), base_url="http://localhost") as client:
            return await client.request(method, path, **options)

    return lambda method, path, **options: asyncio.run(asked(method, path, **options))


@pytest.mark.parametrize("origin", [ALLOWED, OTHER])
@pytest.mark.parametrize("path", ["/v1/sentence", "/v1/splice", "/v1/fit", "/v1/avatar", "/nothing"])
def test_every_preflight_passes(pages: Ask, path: str, origin: dict[str, str]) -> None:
    answer = pages("OPTIONS", path, headers={**ASKS, **origin})
    assert (answer.status_code, answer.content) == (204, b"")
    assert answer.headers["access-control-allow-origin"] == origin["Origin"]
    assert answer.headers["access-control-allow-headers"] == "*"
    assert "access-control-allow-credentials" not in answer.headers


def test_a_page_that_may_not_call_can_read_why(pages: Ask) -> None:
    refused = pages("POST", "/v1/sentence", json={"text": "hello"}, headers=OTHER)
    assert refused.status_code == 403
    assert refused.headers["access-control-allow-origin"] == OTHER["Origin"]
    assert refused.headers["vary"] == "Origin"
    assert "may not call this service (`signsplice serve --allow-origin` allows one)" in refused.json()["error"]


def test_a_page_that_may_not_call_reads_nothing_else(pages: Ask) -> None:
    for path in ("/v1/methods", "/v1/lexicon", "/v1/avatars", "/openapi.json", "/nothing"):
        assert "access-control-allow-origin" not in pages("GET", path, headers=OTHER).headers
    assert "access-control-allow-origin" not in pages("OPTIONS", "/v1/methods", headers=OTHER).headers


def test_a_page_that_may_call_reads_answers_and_failures(pages: Ask) -> None:
    for status, answer in (
        (200, pages("GET", "/v1/methods", headers=ALLOWED)),
        (422, pages("POST", "/v1/sentence", json={"glosses": []}, headers=ALLOWED)),
        (404, pages("GET", "/nothing", headers=ALLOWED)),
        (415, pages("POST", "/v1/sentence", content=b"x", headers={**ALLOWED, "Content-Encoding": "gzip"})),
        (413, pages("POST", "/v1/sentence", content=b"x" * 300_000, headers=ALLOWED)),
    ):
        assert answer.status_code == status
        assert answer.headers["access-control-allow-origin"] == ALLOWED["Origin"]


def test_a_running_service_says_so_too(service: httpx.Client) -> None:
    assert service.options("/v1/sentence", headers={**ASKS, **OTHER}).status_code == 204
    assert service.post("/v1/sentence", json={"text": "hello"}, headers=OTHER).status_code == 403
