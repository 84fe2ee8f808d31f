"""Avatars that ask for unbounded time or memory are refused, and work grows with the file: calls are counted."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import pytest

import avatars
import signsplice as ss
from signsplice.body.capsules import Avatar
from signsplice.errors import FormatError, LimitError
from signsplice.formats.reading import DEFAULT_LIMITS

Document = dict[str, Any]
UNDRAWN = {"attributes": {}, "mode": 1}
"""A primitive of lines, which is not read."""


@pytest.fixture(scope="module")
def narrow() -> Avatar:
    return avatars.body("narrow")


def bare(folder: Path, avatar: Avatar, change: Callable[[Document], object], version: str = "1.0") -> Path:
    """A file of the avatar with one part of its mesh, changed."""
    path = folder / ("a.vrm" if version else "a.glb")
    return avatars.edited(avatars.write(path, avatar, avatars.tubes(avatar)[:1], version, hair=False), change)


def calls(path: Path) -> int:
    """How many functions are called to read an avatar."""
    counted = 0

    def count(frame: FrameType, event: str, what: object) -> None:
        nonlocal counted
        counted += event in ("call", "c_call")

    sys.setprofile(count)
    try:
        ss.read_avatar(path)
    finally:
        sys.setprofile(None)
    return counted


def shared_by_primitives(document: Document) -> None:
    document["meshes"][0]["primitives"] *= 6


def shared_by_nodes(document: Document) -> None:
    document["nodes"] += [{"mesh": 0, "skin": 0}] * 5


@pytest.mark.parametrize("change", [shared_by_primitives, shared_by_nodes])
def test_indices_that_parts_share_are_counted_for_each(
    tmp_path: Path, narrow: Avatar, change: Callable[[Document], None]
) -> None:
    part = avatars.tubes(narrow)[0]
    many = replace(part, triangles=np.tile(part.triangles[:1], (70_000, 1)))
    path = avatars.write(tmp_path / "a.vrm", narrow, [many], hair=False)
    assert len(ss.read_avatar(path).mesh[0].triangles) == 70_000
    with pytest.raises(
        LimitError, match=r"a\.vrm: meshes up to 210,000 indices take .* MB of memory, expected at most"
    ):
        ss.read_avatar(avatars.edited(path, change))


def test_parts_without_end_are_refused(tmp_path: Path, narrow: Avatar) -> None:
    part = avatars.tubes(narrow)[0]
    small = replace(part, triangles=part.triangles[:1])

    def change(document: Document) -> None:
        document["meshes"][0]["primitives"] *= 40
        document["nodes"] += [{"mesh": 0, "skin": 0}] * 40

    path = avatars.edited(avatars.write(tmp_path / "a.vrm", narrow, [small], hair=False), change)
    with pytest.raises(LimitError, match="meshes up to"):
        ss.read_avatar(path, limits=replace(DEFAULT_LIMITS, free_bytes=4e6))


def chain(document: Document, n: int) -> list[int]:
    """Hang a chain of nodes on the first, the nodes."""
    first = len(document["nodes"])
    document["nodes"] += [{"name": f"x{k}", "children": [first + k + 1]} for k in range(n - 1)] + [{"name": "x"}]
    document["nodes"][0].setdefault("children", []).append(first)
    return [*range(first, first + n)]


def joints_in_a_chain(document: Document, n: int) -> None:
    document["skins"].append({"joints": chain(document, n)})
    document["meshes"].append({"primitives": [UNDRAWN]})
    document["nodes"].append({"mesh": 1, "skin": 1})


def meshes_in_a_chain(document: Document, n: int) -> None:
    document["meshes"].append({"primitives": [UNDRAWN]})
    for node in chain(document, n):
        document["nodes"][node]["mesh"] = 1


def meshes_of_one_skin(document: Document, n: int) -> None:
    joints_in_a_chain(document, n)
    document["nodes"] += [{"mesh": 1, "skin": 1}] * n


def primitives_of_many_nodes(document: Document, n: int) -> None:
    document["meshes"].append({"primitives": [UNDRAWN] * n})
    document["nodes"] += [{"mesh": 1, "skin": 0}] * n


@pytest.mark.parametrize("change", [joints_in_a_chain, meshes_in_a_chain, meshes_of_one_skin, primitives_of_many_nodes])
def test_work_grows_with_the_file(tmp_path: Path, narrow: Avatar, change: Callable[[Document, int], None]) -> None:
    def made(n: int) -> Path:
        return bare(tmp_path, narrow, lambda document: change(document, n))

    none, some, twice = (calls(made(n)) for n in (1, 400, 800))
    assert twice - none < 2.2 * (some - none)


def test_a_skin_of_more_joints_than_there_are_nodes_is_refused(tmp_path: Path, narrow: Avatar) -> None:
    def change(document: Document) -> None:
        document["skins"][0] = {"joints": [0] * 1000}

    with pytest.raises(FormatError, match=r"a skin names 1000 joints, of \d+ nodes"):
        ss.read_avatar(bare(tmp_path, narrow, change))


def test_too_many_joints_are_refused_before_their_roles_are_sought(tmp_path: Path, narrow: Avatar) -> None:
    def change(document: Document) -> None:
        document["skins"][0] = {"joints": chain(document, 5000)}

    with pytest.raises(LimitError, match="5,000 joints, expected at most 1,024"):
        ss.read_avatar(bare(tmp_path, narrow, change, version=""))


@pytest.mark.parametrize("version", ["1.0", "0.x"])
def test_nodes_of_roles_are_whole_numbers(tmp_path: Path, narrow: Avatar, version: str) -> None:
    def change(document: Document) -> None:
        if version == "1.0":
            document["extensions"]["VRMC_vrm"]["humanoid"]["humanBones"]["hips"]["node"] = 0.7
        else:
            bones = document["extensions"]["VRM"]["humanoid"]["humanBones"]
            next(bone for bone in bones if bone["bone"] == "hips")["node"] = 0.7

    with pytest.raises(FormatError, match=r"joint 0\.7 is no node"):
        ss.read_avatar(bare(tmp_path, narrow, change, version))


PERSPECTIVE = [1.0, 0.0, 0.0, 0.1, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]


@pytest.mark.parametrize(
    ("fields", "expected"),
    [
        ({"rotation": [0.0, 0.0, 0.0, 0.5]}, r"a rotation has length 0\.5, expected 1"),
        ({"rotation": [False, 0.0, 0.0, 1.0]}, r"rotation is \[False, .*, expected 4 finite numbers"),
        ({"translation": ""}, "translation is '', expected 3 finite numbers"),
        ({"scale": [[1.0, 1.0, 1.0]]}, "scale is .*, expected 3 finite numbers"),
        ({"matrix": {}}, "matrix is {}, expected 16 finite numbers"),
        ({"matrix": PERSPECTIVE}, r"has the last row \[0\.1, 0\.0, 0\.0, 1\.0\], expected 0, 0, 0, 1"),
    ],
)
def test_nodes_of_avatars_hold_what_the_standard_says(
    tmp_path: Path, narrow: Avatar, fields: dict[str, object], expected: str
) -> None:
    def change(document: Document) -> None:
        document["nodes"][document["extensions"]["VRMC_vrm"]["humanoid"]["humanBones"]["hips"]["node"]].update(fields)

    with pytest.raises(FormatError, match=rf"a\.vrm: .*node .*{expected}"):
        ss.read_avatar(bare(tmp_path, narrow, change))
