"""formats.gltf_unpack: avatars whose meshes are packed by meshopt or Draco."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import avatars
import signsplice as ss
from signsplice.errors import FormatError, LimitError, MissingExtraError
from signsplice.formats import gltf_unpack
from signsplice.formats.avatar import pack
from signsplice.formats.gltf_document import chunks
from signsplice.formats.reading import DEFAULT_LIMITS

meshopt = pytest.importorskip("meshopt")
DracoPy = pytest.importorskip("DracoPy")

MESHOPT, DRACO = "EXT_meshopt_compression", "KHR_draco_mesh_compression"
_NAMES = {"POSITION": 0, "NORMAL": 1, "JOINTS_0": 2, "WEIGHTS_0": 3}


def pack_views(document: dict[str, Any], blob: bytes) -> bytes:
    """Packs every buffer view as gltfpack does: their places are those in a second buffer without content."""
    content = bytearray()
    for number, view in enumerate(document["bufferViews"]):
        rows = [row for row in document["accessors"] if row.get("bufferView") == number]
        size = view["byteLength"] // rows[0]["count"]
        data = np.frombuffer(blob, np.uint8, view["byteLength"], view["byteOffset"]).reshape(-1, size)
        packed = meshopt.encode_gltf_buffer(data, "ATTRIBUTES")
        view |= {"buffer": 1, "byteStride": size}
        place = {"buffer": 0, "byteOffset": len(content), "byteLength": len(packed)}
        view["extensions"] = {MESHOPT: place | {"byteStride": size, "count": rows[0]["count"], "mode": "ATTRIBUTES"}}
        content += packed + b"\0" * (-len(packed) % 4)
    document["buffers"] = [
        {"byteLength": len(content)},
        {"byteLength": len(blob), "extensions": {MESHOPT: {"fallback": True}}},
    ]
    document |= {name: [MESHOPT] for name in ("extensionsUsed", "extensionsRequired")}
    return bytes(content)


def pack_meshes(document: dict[str, Any], blob: bytes) -> bytes:
    """Packs every mesh by Draco, without rounding but of positions."""
    kinds = {5121: np.uint8, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
    content = bytearray(blob)

    def rows(number: int) -> Any:
        accessor = document["accessors"][number]
        view = document["bufferViews"][accessor.pop("bufferView")]
        data = np.frombuffer(blob, kinds[accessor["componentType"]], offset=view["byteOffset"])
        width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[accessor["type"]]
        return data[: accessor["count"] * width].reshape(-1, width)

    for mesh in document["meshes"]:
        for primitive in mesh["primitives"]:
            parts = {name: rows(primitive["attributes"][name]) for name in _NAMES}
            packed = DracoPy.encode(
                parts["POSITION"], rows(primitive["indices"]).reshape(-1, 3), quantization_bits=20, preserve_order=True,
                generic_attributes={number: parts[name] for name, number in _NAMES.items() if number},
            )  # fmt: skip
            place = {"buffer": 0, "byteOffset": len(content), "byteLength": len(packed)}
            kind = {row["unique_id"]: row["attribute_type"] for row in DracoPy.decode(packed).attributes}
            numbers = _NAMES | {"POSITION": next(number for number, row in kind.items() if row == 0)}
            primitive["extensions"] = {DRACO: {"bufferView": len(document["bufferViews"]), "attributes": numbers}}
            document["bufferViews"].append(place)
            content += packed + b"\0" * (-len(packed) % 4)
    document["buffers"] = [{"byteLength": len(content)}]
    document |= {name: [DRACO] for name in ("extensionsUsed", "extensionsRequired")}
    return bytes(content)


Packer = Callable[[dict[str, Any], bytes], bytes]
PACKERS = pytest.mark.parametrize("packer", [pack_views, pack_meshes])


def write_both(folder: Path, packer: Packer) -> tuple[Path, Path]:
    """Writes an avatar as it is, and packed."""
    plain = avatars.write(folder / "plain.glb", body := avatars.body("broad"), avatars.tubes(body), "", hair=False)
    text, blob = chunks("plain.glb", plain.read_bytes())
    document = json.loads(text)
    content = packer(document, blob)
    (folder / "packed.glb").write_bytes(pack(document, content))
    return plain, folder / "packed.glb"


@PACKERS
def test_a_packed_avatar_is_read_as_the_plain_one(tmp_path: Path, packer: Packer) -> None:
    plain, packed = map(ss.read_avatar, write_both(tmp_path, packer))
    for part, other in zip(plain.mesh, packed.mesh, strict=True):
        assert np.array_equal(part.triangles, other.triangles)
        assert np.abs(part.vertices - other.vertices).max() < 1e-5
        assert np.array_equal(part.joints, other.joints)
    assert plain.body is not None
    assert packed.body is not None
    assert np.median(np.abs(plain.body.radii - packed.body.radii)) < 1e-6  # a vertex may fall beyond a measure's edge


@PACKERS
def test_what_is_written_is_no_longer_packed(tmp_path: Path, packer: Packer, words: dict[str, ss.Clip]) -> None:
    _, packed = write_both(tmp_path, packer)
    ss.save(ss.retarget(words["HELLO"], ss.read_avatar(packed)).clip, tmp_path / "out.glb")
    document = json.loads(chunks("out.glb", (tmp_path / "out.glb").read_bytes())[0])
    assert not {"extensionsUsed", "extensionsRequired"} & {*document}
    assert len(document["buffers"]) == 1
    again = ss.read_avatar(tmp_path / "out.glb")
    assert [len(part.vertices) for part in again.mesh] == [len(part.vertices) for part in ss.read_avatar(packed).mesh]


@PACKERS
def test_broken_packed_content_is_refused_in_a_line(tmp_path: Path, packer: Packer) -> None:
    _, packed = write_both(tmp_path, packer)
    content = packed.read_bytes()
    (size,) = struct.unpack_from("<I", content, 12)
    start = 28 + size if packer is pack_views else len(content) - 4000
    packed.write_bytes(content[:start] + bytes(len(content) - start))
    with pytest.raises(FormatError) as caught:
        ss.read_avatar(packed)
    assert len(str(caught.value).splitlines()) == 1


def test_a_bomb_is_refused_before_it_is_unpacked(tmp_path: Path) -> None:
    _, packed = write_both(tmp_path, pack_views)
    text, blob = chunks("packed.glb", packed.read_bytes())
    document = json.loads(text)
    document["bufferViews"][0]["extensions"][MESHOPT]["count"] = 10**9
    packed.write_bytes(pack(document, blob))
    with pytest.raises(LimitError, match="rows of a packed buffer view"):
        ss.read_avatar(packed, limits=replace(DEFAULT_LIMITS))


@PACKERS
def test_without_the_extra_a_line_says_what_to_install(
    tmp_path: Path, packer: Packer, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, packed = write_both(tmp_path, packer)

    def fail(name: str) -> None:
        raise ImportError(name)

    monkeypatch.setattr(gltf_unpack, "import_module", fail)
    with pytest.raises(MissingExtraError, match=r"pip install 'signsplice\[compressed\]'"):
        ss.read_avatar(packed)
