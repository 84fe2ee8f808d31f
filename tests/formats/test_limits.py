"""Files that ask for unbounded time or memory are refused in one line, before the work begins; limits can be lifted."""

from __future__ import annotations

import io
import json
import os
import socket
import struct
import time
import tracemalloc
import zipfile
import zlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from conftest import random_clip

from broken_bvh import VALID, deep, wide
from signsplice.cli.commands import app
from signsplice.errors import FormatError, InputError, LimitError, MissingExtraError
from signsplice.formats import encode, load, parse, save
from signsplice.formats.reading import DEFAULT_LIMITS, NO_LIMITS, format_errors, read_bytes
from signsplice.motion import resample
from signsplice.rig.info import rig_info
from signsplice.splicing.engine import SpliceOptions, splice

SECONDS = 5.0
"""Processor time that each of these may take; all take less than a tenth of it."""
BYTES = 64 << 20
"""Memory beside ten times the file's size."""


def animated(nodes: list[dict[str, Any]], times: tuple[float, float] = (0.0, 1.0), **more: Any) -> bytes:
    """A .glb file whose first node turns."""
    blob = struct.pack("<10f", *times, 0, 0, 0, 1, 0, 0, 0.6, 0.8) + np.eye(4, dtype="<f4").tobytes() * 64
    document = {
        "asset": {"version": "2.0"}, "nodes": nodes, "buffers": [{"byteLength": len(blob)}],
        "bufferViews": [{"buffer": 0, "byteLength": 8}, {"buffer": 0, "byteOffset": 8, "byteLength": 32},
                        {"buffer": 0, "byteOffset": 40, "byteLength": 4096}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 2, "type": "SCALAR"},
                      {"bufferView": 1, "componentType": 5126, "count": 2, "type": "VEC4"},
                      {"bufferView": 2, "componentType": 5126, "count": 64, "type": "MAT4"}],
        "animations": [{"samplers": [{"input": 0, "output": 1}],
                        "channels": [{"sampler": 0, "target": {"node": 0, "path": "rotation"}}]}],
    }  # fmt: skip
    text = json.dumps(document | more).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(blob), b"BIN\0") + blob
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def chain(n: int) -> list[dict[str, Any]]:
    return [{"name": "x", "children": [node + 1]} if node + 1 < n else {"name": "x"} for node in range(n)]


def archive(**members: bytes) -> bytes:
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as stored:
        for name, data in members.items():
            stored.writestr(f"{name}.npy", data)
    return content.getvalue()


def claiming(shape: tuple[int, ...]) -> bytes:
    """An array without its numbers, of which the header promises many."""
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": shape})
    return header.getvalue()


def text(content: str) -> bytes:
    stored = io.BytesIO()
    np.save(stored, np.array(content))
    return stored.getvalue()


def held_still(n_frames: int) -> bytes:
    """1,024 joints, of which one has a channel."""
    text = wide(1024).replace("CHANNELS 1 Zrotation\n}", "CHANNELS 0\n}")
    return text[: text.index("Frames:")].encode() + b"Frames: %d\nFrame Time: 0.1\n" % n_frames + b"0\n" * n_frames


BOMBS: dict[str, tuple[str, Callable[[], bytes], str]] = {
    "a chain of nodes": ("a.glb", lambda: animated(chain(6_000)), "6,000 joints, expected at most 1,024"),
    "nodes side by side": (
        "a.glb",
        lambda: animated([{"children": [*range(1, 5_000)]}, *({"name": "x"} for _ in range(4_999))]),
        "5,000 joints, expected at most 1,024",
    ),
    "nodes": ("a.gltf", lambda: b'{"asset":{"version":"2.0"},"nodes":[' + b"{}," * 50_000 + b"{}]}", "50,001 nodes"),
    "JSON": ("a.gltf", lambda: b"[" + b"{}," * 1_000_000 + b"{}]", "2,000,002 values of JSON take 100 MB"),
    "skins": (
        "a.glb",
        lambda: animated([{}], skins=[{"joints": [0] * 9, "inverseBindMatrices": 2}] * 2_000),
        "",
    ),
    "nodes of one name": (
        "a.glb",
        lambda: animated([{"name": "x", "children": [*range(1, 1024)]}, *[{"name": "x"}] * 1023]),
        "",
    ),
    "JSON in JSON": ("a.gltf", lambda: b"[" * 1_000_000, "nested too deeply"),
    "keys far apart": ("a.glb", lambda: animated([{}], (0.0, 160_000.0)), "expected at most 86,400 seconds"),
    "keys apart": ("a.glb", lambda: animated(chain(500), (0.0, 2_000.0)), "MB of memory, expected at most 5"),
    "a chain of joints": ("a.bvh", lambda: deep(20_000).encode(), "joints nest deeper than 256"),
    "many joints": ("a.bvh", lambda: wide(20_000).encode(), "more than 1024 joints"),
    "words in a line": ("a.bvh", lambda: wide(9000).replace("\n", " ").encode(), "more than 50000 words in one line"),
    "frames of joints that do not move": ("a.bvh", lambda: held_still(50_000), "MB of memory, expected at most 5"),
    "seconds": ("a.bvh", lambda: VALID.replace("0.04", "1e6").encode(), "expected at most 86,400 seconds"),
    "a frame rate": ("a.bvh", lambda: VALID.replace("0.04", "1e-9").encode(), "expected at most 1,000 fps"),
    "numbers in a line": (
        "a.bvh",
        lambda: VALID.replace("0 91 0 1", "10 " * 1_500_000 + "0 91 0 1").encode(),
        "1500009 numbers in a frame, expected 9",
    ),
    "numbers after the frames": ("a.bvh", lambda: (VALID + "10 " * 1_500_000).encode(), ""),
    "digits": ("a.bvh", lambda: VALID.replace("0.04", "1" * 100_000 + "x").encode(), "is not a number"),
    "blank lines": ("a.bvh", lambda: b"\n" * 2_000_000 + VALID.encode() + b" \t\n" * 2_000_000, ""),
    "members": (
        "a.npz",
        lambda: archive(**{f"x{n}": b"" for n in range(5_000)}),
        "5,000 members, expected at most 100",
    ),
    "an archive": ("a.npz", lambda: archive(head=bytes(65 << 20)), "unpacks to 65 MiB"),
    "a claim": (
        "a.npz",
        lambda: archive(head=text("{}"), local_rotations=claiming((10**8, 53, 4))),
        r"local_rotations has shape",
    ),
}  # name -> file, content, message; none where it is read


@pytest.mark.parametrize("what", BOMBS)
def test_small_files_never_cost_much(what: str, tmp_path: Path) -> None:
    file, make, message = BOMBS[what]
    (tmp_path / file).write_bytes(make())
    size = (tmp_path / file).stat().st_size
    tracemalloc.start()
    try:
        began = time.process_time()
        if message:
            with pytest.raises(FormatError, match=message) as caught:
                load(tmp_path / file)
            assert str(caught.value).startswith(str(tmp_path / file))
            assert "\n" not in str(caught.value)
        else:
            load(tmp_path / file)
        seconds = time.process_time() - began
        n_bytes = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert seconds < SECONDS
    assert n_bytes < BYTES + 10 * size


def test_limits_can_be_lifted(tmp_path: Path) -> None:
    (tmp_path / "a.bvh").write_text(deep(1500))
    (tmp_path / "a.glb").write_bytes(animated(chain(1500)))
    save(random_clip(0, n_joints=3), tmp_path / "a.npz")
    for name, n_joints in (("a.bvh", 1500), ("a.glb", 1500), ("a.npz", 3)):
        with pytest.raises(LimitError):
            load(tmp_path / name, replace(DEFAULT_LIMITS, joints=2))
        assert len(load(tmp_path / name, NO_LIMITS).skeleton) == n_joints
    with pytest.raises(LimitError, match=r"a\.bvh: 76,\d+ bytes, expected at most 1,000"):
        load(tmp_path / "a.bvh", replace(DEFAULT_LIMITS, file_bytes=1000))
    with pytest.raises(LimitError, match="expected at most 1,000"):
        parse(deep(1500).encode(), "a.bvh", replace(DEFAULT_LIMITS, file_bytes=1000))
    with pytest.raises(LimitError, match="20 frames, expected at most 19 frames"):
        load(tmp_path / "a.npz", replace(DEFAULT_LIMITS, frames=19))


def test_a_chain_of_nodes_is_read_in_linear_time(tmp_path: Path) -> None:
    """Three joints above 20,000 nodes, then 4,000 joints of one name: quadratic work would take minutes."""
    began = time.process_time()
    (tmp_path / "a.glb").write_bytes(animated(chain(20_000), skins=[{"joints": [0, 1, 2]}]))
    assert load(tmp_path / "a.glb").skeleton.names == ("x", "x 2", "x 3")
    (tmp_path / "a.glb").write_bytes(animated(chain(4000), skins=[{"joints": [3998, 3999]}]))
    lifted = load(tmp_path / "a.glb", NO_LIMITS)
    assert len(lifted.skeleton) == 4000
    tracemalloc.start()
    assert rig_info(lifted.skeleton).roles.rig == "unknown"
    assert tracemalloc.get_traced_memory()[1] < 16 << 20
    tracemalloc.stop()
    assert time.process_time() - began < 4 * SECONDS


def test_commands_say_how_to_lift_limits(tmp_path: Path) -> None:
    path = tmp_path / "a.bvh"
    path.write_text(deep(300))
    refused = CliRunner().invoke(app, ["inspect", str(path)])
    assert isinstance(refused.exception, InputError)
    assert str(refused.exception).endswith(
        "expected a skeleton; --no-limits lifts the limits, for files that you trust"
    )
    assert "joints     300" in CliRunner().invoke(app, ["inspect", str(path), "--no-limits"]).output


def test_a_slow_clip_is_not_resampled_without_bound() -> None:
    clip = random_clip(0, n_frames=3)
    slow = replace(clip, fps=1e-3)
    options = SpliceOptions(cutter="ends", transition="slerp", duration="fixed")
    for fps, message in ((1e-6, "expected at most 86,400 seconds"), (1e-3, "MB of memory, expected at most 50 MB")):
        with pytest.raises(LimitError, match=message):
            splice([clip, replace(clip, fps=fps)], options)
    small = replace(options, limits=replace(NO_LIMITS, frames=1000))
    with pytest.raises(LimitError, match="90,000 frames, expected at most 1,000 frames"):
        splice([clip, slow], small)
    whole = splice([clip, replace(clip, fps=0.5)], options).clip  # as slow as a file may be, and short
    assert len(whole) > len(resample(replace(clip, fps=0.5), 30.0)) > 100


def test_a_stretched_clip_of_any_length_is_resampled() -> None:
    """Ten times as many frames are lawful for a long clip too: 24 fps to 240."""
    clip = random_clip(0, n_frames=20_000, n_joints=4, fps=24.0)
    DEFAULT_LIMITS.check_resampling(clip, 240.0)
    with pytest.raises(LimitError):
        DEFAULT_LIMITS.check_resampling(replace(clip, fps=0.6), 240.0)


def test_two_hours_of_capture_are_within_the_limits() -> None:
    n_frames, n_joints = 2 * 3600 * 120, 75
    DEFAULT_LIMITS.check_clip(n_frames, n_joints, 120.0, n_frames * 80 * n_joints, n_frames * 228 * 9)
    assert n_frames * 228 * 9 < DEFAULT_LIMITS.file_bytes


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with names")
def test_only_regular_files_are_read(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.bvh")
    (tmp_path / "zero.bvh").symlink_to("/dev/zero")
    (tmp_path / "real.bvh").write_text(VALID)
    (tmp_path / "link.bvh").symlink_to(tmp_path / "real.bvh")
    (tmp_path / "round.bvh").symlink_to(tmp_path / "round.bvh")
    with socket.socket(socket.AF_UNIX) as listener:
        os.chdir(tmp_path)  # a socket's path must be short
        listener.bind("socket.bvh")
        for name, message in (
            ("pipe.bvh", "pipe.bvh: is a pipe, expected a regular file"),
            ("zero.bvh", "zero.bvh: is a device, expected a regular file"),
            ("socket.bvh", "socket.bvh: cannot be read"),
            ("round.bvh", "round.bvh: cannot be read"),
            ("a\0.bvh", "cannot be read"),
        ):
            with pytest.raises(InputError, match=message):
                load(tmp_path / name)
    assert len(load(tmp_path / "link.bvh")) == 2
    with pytest.raises(LimitError, match=r"real\.bvh: \d+ bytes, expected at most 10"):
        read_bytes(tmp_path / "real.bvh", 10)


def test_buffer_files_lie_in_the_folder_itself(tmp_path: Path) -> None:
    folder = tmp_path / "inner"
    folder.mkdir()
    content = animated([{"name": "a"}])
    size = struct.unpack_from("<I", content, 12)[0]
    document = json.loads(content[20 : 20 + size])
    blob = content[28 + size :]
    (tmp_path / "secret.bin").write_bytes(blob)
    (folder / "real.bin").write_bytes(blob)
    (folder / "out.bin").symlink_to(tmp_path / "secret.bin")
    (folder / "in.bin").symlink_to(folder / "real.bin")
    os.mkfifo(folder / "pipe.bin")

    def load_with(uri: str) -> int:
        document["buffers"][0]["uri"] = uri
        (folder / "a.gltf").write_text(json.dumps(document))
        return len(load(folder / "a.gltf"))

    assert load_with("real.bin") == load_with("in.bin") == 31
    for uri, message in (
        ("out.bin", "a link out of the folder"),
        ("pipe.bin", "is a pipe"),
        ("%2e%2e/x", "same folder"),
    ):
        with pytest.raises(FormatError, match=message):
            load_with(uri)
    whole = (folder / "a.gltf").stat().st_size + len(blob)
    document["buffers"][0]["uri"] = "real.bin"
    (folder / "a.gltf").write_text(json.dumps(document))
    with pytest.raises(FormatError, match="expected at most"):
        load(folder / "a.gltf", replace(DEFAULT_LIMITS, file_bytes=whole - 100))


PLAIN: list[tuple[Exception, str]] = [
    (KeyError("channels"), "it has no 'channels'"),
    (IndexError("list index out of range"), "a number in it names what is not there"),
    (ValueError("cannot reshape array of size 3 into shape (63,newaxis)"), "its content does not fit together"),
    (TypeError("'int' object is not iterable"), "its content does not fit together"),
    (RecursionError(), "it nests too deeply"),
    (struct.error("two\nlines"), "it is damaged or cut short"),
    (zlib.error("Error -3 while decompressing data"), "it is damaged or cut short"),
    (UnicodeDecodeError("utf-8", b"\xff", 0, 1, "invalid start byte"), "a text in it is not utf-8"),
    (KeyError(), "it has no "),
    (OSError(), "its content does not fit together"),
    (zipfile.BadZipFile("File is not a zip file"), "File is not a zip file"),
    (InputError("no joint 'tail'"), "no joint 'tail'"),
]


@pytest.mark.parametrize(("error", "reason"), PLAIN)
def test_whatever_a_parser_raises_names_the_file_and_no_exception(error: Exception, reason: str) -> None:
    with pytest.raises(FormatError, match=r"^a\.x: is no valid file \(") as caught, format_errors("a.x", "file"):
        raise error
    assert caught.value.__cause__ is error
    assert f"({reason}" in str(caught.value)
    assert "\n" not in str(caught.value)
    assert type(error).__name__ not in str(caught.value)


@pytest.mark.parametrize(
    "fault", [KeyboardInterrupt(), MemoryError(), AttributeError("x"), ImportError("x"), MissingExtraError("x")]
)
def test_faults_of_the_program_or_the_machine_are_not_blamed_on_a_file(fault: BaseException) -> None:
    with pytest.raises(type(fault)) as caught, format_errors("a.x", "file"):
        raise fault
    assert caught.value is fault


def test_errors_of_writing_are_not_taken_for_errors_of_a_file() -> None:
    with pytest.raises(InputError, match="written"):
        encode(random_clip(0), "a.gltf")
