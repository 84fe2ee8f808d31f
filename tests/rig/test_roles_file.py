"""formats.roles: files in which a user names the joints that play each role."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from conftest import random_clip

from signsplice.errors import FormatError, InputError
from signsplice.formats import roles
from signsplice.motion import Clip
from signsplice.rig.info import rig_info


def test_a_roles_file_is_read(tmp_path: Path) -> None:
    file = tmp_path / "roles.json"
    file.write_text('\ufeff{"hips": "Root", "leftHand": "poignée"}', encoding="utf-8")
    assert roles.read(file) == roles.read(str(file)) == {"hips": "Root", "leftHand": "poignée"}


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b'{\n"hips": "Root",\n}', ":3: is no JSON"),
        (b"", ":1: is no JSON"),
        (b'{"hips": "\xff"}', ": is no JSON"),
        (b"[" * 100_000, ": is no JSON"),
        (b'["hips"]', r': found \["hips"\], expected an object'),
        (b'{"hip": "Root"}', r": unknown role 'hip' \(did you mean 'hips'\?\)"),
        (b'{"hips": 3}', ": hips: found 3, expected a joint's name"),
        (b'{"hips": ["Root"]}', r': hips: found \["Root"\]'),
    ],
)
def test_a_broken_roles_file_is_refused_in_one_line(tmp_path: Path, content: bytes, message: str) -> None:
    file = tmp_path / "roles.json"
    file.write_bytes(content)
    with pytest.raises(FormatError, match=re.escape(str(file)) + message) as caught:
        roles.read(file)
    assert "\n" not in str(caught.value)


def test_a_missing_roles_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no\.json: no such file"):
        roles.read(tmp_path / "no.json")


def test_a_roles_file_names_the_joints_of_an_unknown_rig(words: dict[str, Clip]) -> None:
    clip = random_clip(0)
    named = roles.with_roles(clip, {"hips": "joint0", "spine": "joint1"})
    assert rig_info(named.skeleton).roles.joints == {"hips": 0, "spine": 1}
    assert roles.with_roles(words["I"], {"hips": "joint0"}) is words["I"], "a known rig without any of those joints"
    with pytest.raises(InputError, match="no joint 'elsewhere'"):
        roles.with_roles(clip, {"hips": "joint0", "spine": "elsewhere"})
