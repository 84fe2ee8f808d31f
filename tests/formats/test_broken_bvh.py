"""Broken BVH files are refused with a clear message; unusual but valid ones are read."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from broken_bvh import BROKEN, VALID, deep, wide
from signsplice.errors import FormatError
from signsplice.formats import bvh, load


@pytest.mark.parametrize("case", BROKEN)
def test_broken_files_are_refused_with_file_and_line(case: str, tmp_path: Path) -> None:
    content, message = BROKEN[case]
    path = tmp_path / "bad.bvh"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(FormatError) as caught:
        load(path)
    text = str(caught.value)
    assert message in text
    assert re.match(r".*bad\.bvh:\d+: \S", text), "the file and the line come first"
    assert "\n" not in text
    assert len(text) < 400


UNUSUAL: dict[str, bytes] = {
    "crlf": VALID.replace("\n", "\r\n").encode(),
    "cr": VALID.replace("\n", "\r").encode(),
    "bom": b"\xef\xbb\xbf" + VALID.encode(),
    "blank lines": VALID.replace("\n", "\n\n \t\n").encode(),
    "tabs between numbers": VALID.replace("4 5 6", "4\t5\t\t 6 ").encode(),
    "no newline at the end": VALID.rstrip("\n").encode(),
    "no white space after the colon": VALID.replace("Frames: 2", "Frames:2").encode(),
    "exponents": VALID.replace("0 90 0 1 2", "0 9.0E+01 0 1e0 +.2E1").encode(),
    "braces on the same line": VALID.replace("ROOT Hips\n{", "ROOT Hips {").encode(),
    "lower case channels": VALID.replace("Zrotation", "zrotation").encode(),
    "no indentation": VALID.replace("\t", "").encode(),
    "one line hierarchy": VALID[: VALID.index("MOTION")].replace("\n", " ").encode()
    + b"\n"
    + VALID[VALID.index("MOTION") :].encode(),
    "blank lines at the end": VALID.encode() + b"\n\n\n",
}


@pytest.mark.parametrize("case", UNUSUAL)
def test_unusual_spellings_give_the_same_clip(case: str) -> None:
    clip, plain = bvh.parse(UNUSUAL[case]), bvh.parse(VALID.encode())
    assert clip.skeleton.names == plain.skeleton.names
    assert clip.fps == plain.fps == 25.0
    assert np.array_equal(clip.local_rotations, plain.local_rotations)
    assert np.array_equal(clip.root_positions, plain.root_positions)


def test_files_at_the_limits_are_read() -> None:
    assert len(bvh.parse(deep(256).encode()).skeleton) == 256
    assert len(bvh.parse(wide(1024).encode()).skeleton) == 1024


@pytest.mark.parametrize("name", ["左手", "hand:L.001", "a{b}", "a-b", "Bip01'L", "é"])
def test_joint_names_may_have_any_character_but_white_space(name: str) -> None:
    clip = bvh.parse(VALID.replace("Spine", name).encode())
    assert clip.skeleton.names[1] == name


def test_a_file_truncated_anywhere_is_refused() -> None:
    """Truncation at any byte raises a FormatError and never hangs; only the last line's end may be missing."""
    content = VALID.encode()
    for stop in range(len(content) - 9):
        with pytest.raises(FormatError):
            bvh.parse(content[:stop])
    assert len(bvh.parse(content[:-1])) == 2
