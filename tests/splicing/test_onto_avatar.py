"""Splices and sentences on an avatar, from the command line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

import avatars
import signsplice as ss
from signsplice.cli.commands import app
from signsplice.errors import InputError
from signsplice.lexicon import open_shipped_lexicon


@pytest.fixture(scope="module")
def avatar(tmp_path_factory: pytest.TempPathFactory) -> Path:
    narrow = avatars.body("narrow")
    return avatars.write(tmp_path_factory.mktemp("avatar") / "A.vrm", narrow, avatars.tubes(narrow))


def run(*words: object) -> str:
    result = CliRunner().invoke(app, [str(word) for word in words])
    assert result.exit_code == 0, result.output
    return result.output


def test_a_sentence_is_signed_by_an_avatar_in_its_own_file(tmp_path: Path, avatar: Path) -> None:
    out, report = tmp_path / "out.glb", tmp_path / "R.json"
    run("sentence", "MY NAME", "-o", out, "--avatar", avatar, "--report", report)
    described = json.loads(report.read_text())
    assert described["avatar"]["name"] == "A"
    assert {contact["hand"] for contact in described["avatar"]["contacts"]}
    assert b"VRMC_vrm" in out.read_bytes()
    clip = ss.load(out)
    assert len(clip) == described["frames"]
    assert {*ss.read_avatar(avatar).names} <= {*clip.skeleton.names}


def test_files_are_spliced_on_an_avatar_as_the_splice_is_converted_to_it(tmp_path: Path, avatar: Path) -> None:
    for gloss in ("MY", "NAME"):
        ss.save(open_shipped_lexicon().clip(gloss), tmp_path / f"{gloss}.bvh")
    words = [tmp_path / "MY.bvh", tmp_path / "NAME.bvh"]
    run("splice", *words, "-o", tmp_path / "one.bvh", "--avatar", avatar)
    run("splice", *words, "-o", tmp_path / "plain.npz")
    run("convert", tmp_path / "plain.npz", tmp_path / "two.bvh", "--avatar", avatar)
    assert (tmp_path / "one.bvh").read_text() == (tmp_path / "two.bvh").read_text()


@pytest.mark.parametrize(
    ("options", "line"),
    [
        (("--skin", "Body"), "--skin names meshes of an avatar, expected --avatar too"),
        (("--avatar", "nothing.vrm"), "nothing.vrm"),
        (("--avatar", "{avatar}", "--skin", "Bodi"), "'Bodi' is no mesh, node or material that joints carry: Body"),
    ],
)
def test_what_is_wrong_with_an_avatar_is_said_in_one_line(
    tmp_path: Path, avatar: Path, options: tuple[str, ...], line: str
) -> None:
    words = [word.format(avatar=avatar) for word in options]
    result = CliRunner().invoke(app, ["sentence", "MY", "-o", str(tmp_path / "a.glb"), *words])
    assert isinstance(result.exception, InputError)
    assert line in str(result.exception)
    assert "\n" not in str(result.exception)
    assert not (tmp_path / "a.glb").exists()


def test_an_avatar_that_lacks_fingers_cannot_spell(tmp_path: Path) -> None:
    broad = avatars.body("broad")
    roles = {role: joint for role, joint in (broad.roles or {}).items() if "Ring" not in role and "Little" not in role}
    path = avatars.write(tmp_path / "three.vrm", broad, avatars.tubes(broad), roles=roles)
    assert "three: has no ring or little finger to move, so it cannot spell" in " ".join(ss.read_avatar(path).warnings)
    roles = {role: joint for role, joint in roles.items() if not any(x in role for x in ("Thumb", "Index", "Middle"))}
    path = avatars.write(tmp_path / "none.vrm", broad, avatars.tubes(broad), roles=roles)
    assert "none: has no fingers to move, so it cannot spell" in " ".join(ss.read_avatar(path).warnings)
