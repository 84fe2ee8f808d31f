"""No command reaches another host, asks for a name, or leaves a file outside the folders that it was given."""

from __future__ import annotations

import importlib.util
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip("fcntl")

import watching

SLOW = ("train", "bulk on Ray")
NEEDS = {"train": "torch", "bulk on Ray": "ray"}
COMMANDS = [
    pytest.param(name, marks=[pytest.mark.slow] if name in SLOW else [])
    for name in watching.COMMANDS
    if name != "control"
]


@pytest.fixture
def folder() -> Iterator[Path]:
    """An empty folder with a short name: Ray's sockets lie in it."""
    with tempfile.TemporaryDirectory(prefix="ss-", ignore_cleanup_errors=True) as path:
        yield Path(path)


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_sends_nothing_and_leaves_nothing(name: str, folder: Path) -> None:
    if name in NEEDS and importlib.util.find_spec(NEEDS[name]) is None:
        pytest.skip(f"needs {NEEDS[name]}")
    seen = watching.watch_command(name, folder)
    assert seen.status == 0, seen.errors
    assert (seen.sockets, seen.names, seen.files) == (0, [], [])


@pytest.mark.slow
def test_the_watch_finds_what_onnxruntime_sends_without_the_switch(folder: Path) -> None:
    seen = watching.watch_command("control", folder)
    assert seen.status == 0, seen.errors
    if seen.how.startswith("network"):  # an audit hook sees no native code
        assert seen.names
        assert seen.sockets
    assert seen.files


def test_the_watch_finds_what_a_program_sends_and_leaves(folder: Path) -> None:
    """Native code and Python's, in the home, the temporary folder and elsewhere."""
    code = """
import ctypes, os, pathlib, socket, tempfile
pathlib.Path.home().joinpath("left").write_text("x")
tempfile.mkstemp(suffix=".left")
libc = ctypes.CDLL(None)
libc.getaddrinfo(b"native.example", b"443", None, ctypes.byref(ctypes.c_void_p()))
try:
    socket.getaddrinfo("python.example", 443)
except OSError:
    pass
try:
    socket.socket(socket.AF_INET, socket.SOCK_DGRAM).connect(("198.51.100.7", 443))
except OSError:
    pass
if os.environ["SIGNSPLICE_WATCHED_BY"].endswith("disk"):
    os.close(libc.open(b"/etc/signsplice-left", os.O_CREAT | os.O_WRONLY, 0o600))
"""
    seen = watching.watch_calls([watching.make_python_call(code)], folder)
    assert seen.status == 0, seen.errors
    assert "python.example" in seen.names
    assert seen.sockets
    assert {name[0] for name in seen.files} >= {"~", "$"}
    if seen.how.startswith("network"):
        assert "native.example" in seen.names
    if seen.how == "network, disk":
        assert "/etc/signsplice-left" in seen.files
