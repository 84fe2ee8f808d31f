"""Avatars of a service: named when it starts, asked for by name."""

from __future__ import annotations

import base64
from pathlib import Path

import pytest

import avatars
from serving import http_client
from signsplice.cli.commands import app
from signsplice.errors import InputError
from signsplice.service.settings import Settings


def test_a_service_signs_on_its_avatars_and_names_them_where_another_is_asked_for(tmp_path: Path) -> None:
    narrow = avatars.body("narrow")
    path = avatars.write(tmp_path / "Ann.vrm", narrow, avatars.tubes(narrow))
    with http_client("serve", "--workers", "1", "--avatar", str(path)) as client:
        asked = {"glosses": ["MY", "NAME"], "formats": ["glb"], "avatar": "Ann"}
        answer = client.post("/v1/sentence", json=asked).json()
        refused = client.post("/v1/sentence", json={**asked, "avatar": "Bob"})
    assert answer["report"]["avatar"]["name"] == "Ann"
    assert answer["report"]["avatar"]["contacts"]
    assert b"VRMC_vrm" in base64.b64decode(answer["files"]["glb"])
    assert refused.status_code == 422
    assert refused.json()["error"] == "avatar 'Bob': expected one of Ann"


def test_avatars_have_different_names() -> None:
    with pytest.raises(InputError, match="two avatars have one name"):
        Settings(avatars=(Path("a/Ann.vrm"), Path("b/Ann.glb")))


def test_an_avatar_that_cannot_be_read_stops_the_service_at_once() -> None:
    from click.testing import CliRunner

    assert "nothing.vrm" in str(CliRunner().invoke(app, ["serve", "--avatar", "nothing.vrm"]).exception)
