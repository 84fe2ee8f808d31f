"""Broken and odd BVH files: what the reader says of them, or must read."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from broken_bvh import BROKEN, SOUND, deep, wide
from signsplice.errors import FormatError
from signsplice.formats import bvh


@pytest.mark.parametrize("case", BROKEN)
def test_broken_files_are_refused_with_their_line(case: str, tmp_path: Path) -> None:
    content, message = BROKEN[case]
    path = tmp_path / "bad.bvh"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(FormatError) as caught:
        bvh.read(path)
    said = str(caught.value)
    assert message in said
    assert re.match(r".*bad\.bvh:\d+: \S", said), "the file and the line come first"
    assert "\n" not in said
    assert len(said) < 400


ODD: dict[str, bytes] = {
    "crlf": SOUND.replace("\n", "\r\n").encode(),
    "cr": SOUND.replace("\n", "\r").encode(),
    "bom": b"\xef\xbb\xbf" + SOUND.encode(),
    "blank lines": SOUND.replace("\n", "\n\n \t\n").encode(),
    "tabs between numbers": SOUND.replace("4 5 6", "4\t5\t\t 6 ").encode(),
    "no newline at the end": SOUND.rstrip("\n").encode(),
    "no white space after the colon": SOUND.replace("Frames: 2", "Frames:2").encode(),
    "exponents": SOUND.replace("0 90 0 1 2", "0 9.0E+01 0 1e0 +.2E1").encode(),
    "braces on the same line": SOUND.replace("ROOT Hips\n{", "ROOT Hips {").encode(),
    "lower case channels": SOUND.replace("Zrotation", "zrotation").encode(),
    "no indentation": SOUND.replace("\t", "").encode(),
    "one line hierarchy": SOUND[: SOUND.index("MOTION")].replace("\n", " ").encode()
    + b"\n"
    + SOUND[SOUND.index("MOTION") :].encode(),
    "blank lines at the end": SOUND.encode() + b"\n\n\n",
}


@pytest.mark.parametrize("case", ODD)
def test_odd_files_mean_the_same(case: str) -> None:
    clip, plain = bvh.parse(ODD[case]), bvh.parse(SOUND.encode())
    assert clip.skeleton.names == plain.skeleton.names
    assert clip.fps == plain.fps == 25.0
    assert np.array_equal(clip.local_rotations, plain.local_rotations)
    assert np.array_equal(clip.root_positions, plain.root_positions)


def test_limits_themselves_are_read() -> None:
    assert len(bvh.parse(deep(256).encode()).skeleton) == 256
    assert len(bvh.parse(wide(1024).encode()).skeleton) == 1024


@pytest.mark.parametrize("name", ["左手", "hand:L.001", "a{b}", "a-b", "Bip01'L", "é"])
def test_names_hold_any_characters_but_white_space(name: str) -> None:
    clip = bvh.parse(SOUND.replace("Spine", name).encode())
    assert clip.skeleton.names[1] == name


def test_every_prefix_of_a_file_is_refused_or_read() -> None:
    """Truncation at any byte never hangs and never fails but with a FormatError."""
    sound = SOUND.encode()
    for stop in range(len(sound) - 9):
        with pytest.raises(FormatError):
            bvh.parse(sound[:stop])
    assert len(bvh.parse(sound[:-1])) == 2
