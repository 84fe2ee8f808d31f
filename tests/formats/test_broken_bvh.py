"""Broken BVH files are refused with a clear message; unusual ones with one meaning are read, with a note."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from broken_bvh import BROKEN, VALID, deep, wide
from signsplice.errors import FormatError
from signsplice.formats import bvh, load
from signsplice.motion import Clip, concatenate, kinematics


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
    "white space before the colon": VALID.replace("Frames:", "Frames :")
    .replace("Frame Time:", "Frame\tTime :")
    .encode(),
    "no colon": VALID.replace("Frames:", "Frames").encode(),
    "frame time in one word": VALID.replace("Frame Time:", "FrameTime:").encode(),
    "lower case": VALID.lower().replace("hips", "Hips").replace("spine", "Spine").encode(),
    "upper case": VALID.upper().replace("HIPS", "Hips").replace("SPINE", "Spine").encode(),
    "end site in one word": VALID.replace("End Site", "EndSite").encode(),
    "end alone": VALID.replace("End Site", "END").encode(),
    "brace after a name": VALID.replace("Hips\n{", "Hips{").replace("Site\n\t\t{", "Site{").encode(),
    "frames after MOTION": VALID.replace("MOTION\n", "motion ").encode(),
    "MOTION after a brace": VALID.replace("}\nMOTION", "} MOTION").encode(),
    "utf-16": VALID.encode("utf-16"),
    "utf-16, big end first": b"\xfe\xff" + VALID.encode("utf-16-be"),
}


@pytest.mark.parametrize("case", UNUSUAL)
def test_unusual_spellings_give_the_same_clip(case: str) -> None:
    clip, plain = bvh.parse(UNUSUAL[case]), bvh.parse(VALID.encode())
    assert clip.skeleton.names == plain.skeleton.names
    assert clip.notes == ()
    assert_same_motion(clip, plain)


def assert_same_motion(clip: Clip, plain: Clip) -> None:
    assert clip.fps == plain.fps
    assert np.array_equal(clip.local_rotations, plain.local_rotations)
    assert np.array_equal(clip.root_positions, plain.root_positions)
    assert np.array_equal(clip.skeleton.offsets, plain.skeleton.offsets)
    assert clip.skeleton.parents.tolist() == plain.skeleton.parents.tolist()
    assert [site.offset.tolist() for site in clip.skeleton.end_sites] == [[0.0, 5.0, 0.0]]


SITE = "CHANNELS 2 Zrotation Yrotation"
NOTED: dict[str, tuple[str, str]] = {
    "fewer frames than it says": (VALID.replace("Frames: 2", "Frames: 5"), "Frames: says 5, but 2 frames follow"),
    "more frames than it says": (VALID.replace("Frames: 2", "Frames: 1"), "Frames: says 1, but 2 frames follow"),
    "no frames": (VALID.replace("Frames: 2", "Frames: 0"), "Frames: says 0, but 2 frames follow"),
    "huge claim": (VALID.replace("Frames: 2", "Frames: 999999999999"), "Frames: says 999999999999, but 2 frames"),
    "text after the frames": (VALID + "made with, 1 license\nthe end\n", "the text after its 2 frames is not read"),
    "a cut frame after the frames": (VALID + "0 91 0 1 2\n", "the text after its 2 frames is not read"),
    "name stands twice": (
        VALID.replace("JOINT Spine", "JOINT Hips"),
        "joint names that stand twice get a number: 'Hips_2'",
    ),
    "no name": (VALID.replace("JOINT Spine", "JOINT"), "joints without a name are numbered"),
    "no name, brace": (VALID.replace("JOINT Spine\n\t{", "JOINT {"), "joints without a name are numbered"),
    "end site with a name": (VALID.replace("End Site", "End Site Head_end"), "names of End Sites are not kept"),
    "end with a name": (VALID.replace("End Site", "End Head end {").replace("{\n\t\t{", "{"), "names of End Sites"),
    "end site with no channels": (VALID.replace("5.0 0.0\n", "5.0 0.0\nCHANNELS 0\n"), "channels of End Sites are"),
    "end site with channels, no numbers": (VALID.replace("5.0 0.0\n", f"5.0 0.0\n{SITE}\n"), "channels of End Sites"),
    "end site with channels and numbers": (
        VALID.replace("5.0 0.0\n", f"5.0 0.0\n{SITE}\n").replace("4 5 6", "4 5 6 8 9").replace("4 5 7", "4 5 7 8 9"),
        "channels of End Sites are not read",
    ),
    "scales of 1": (
        VALID.replace("CHANNELS 3", "CHANNELS 6 Xscale Yscale ZSCALE").replace(" 4 5 ", " 1 1.0 0.99999 4 5 "),
        "scale channels are left out: all their numbers are 1",
    ),
}


@pytest.mark.parametrize("case", NOTED)
def test_content_with_one_meaning_is_read_with_one_note(case: str) -> None:
    content, note = NOTED[case]
    clip, plain = bvh.parse(content.encode()), bvh.parse(VALID.encode())
    assert_same_motion(clip, plain)
    assert len(clip.notes) == 1
    assert note in clip.notes[0]
    assert clip.channels is not None
    assert plain.channels is not None
    assert clip.channels.names == plain.channels.names
    again = bvh.parse(bvh.encode(clip))
    assert again.skeleton.names == clip.skeleton.names
    assert again.notes == ()
    assert_same_motion(again, plain)


CASES = Path(__file__).parents[1] / "data" / "cases"


@pytest.mark.parametrize(
    ("file", "note"),
    [
        ("bvh_blender_accepts/dup_names.bvh", "joint names that stand twice get a number: 'Spine_2'"),
        ("bvh_blender_accepts/end_site_channels.bvh", "channels of End Sites are not read: they turn no joint"),
        ("bvh_blender_accepts/end_site_named.bvh", "names of End Sites are not kept"),
        ("bvh_blender_accepts/frame_time_oneword.bvh", ""),
        ("bvh_blender_accepts/scale_channels.bvh", "scale channels are left out: all their numbers are 1"),
        ("bvh_frame_count/fewer_rows_than_frames.bvh", "Frames: says 5, but 4 frames follow, which are read"),
        ("bvh_frame_count/more_rows_than_frames.bvh", "Frames: says 3, but 4 frames follow, which are read"),
        ("bvh_names_with_spaces/names_with_spaces.bvh", ""),
    ],
)
def test_files_are_read_as_blender_reads_them(file: str, note: str) -> None:
    """Blender 5.0.1, which has Z up, puts the tail of LeftArm at 32.112 13.77 153.827 in the second frame."""
    clip = load(CASES / file)
    assert clip.notes == ((note,) if note else ())
    rotations, positions = kinematics.forward(clip)
    tip = positions[1, 2] + rotations[1, 2] @ clip.skeleton.end_sites[0].offset
    assert np.allclose(tip, [32.112, 153.827, -13.77], atol=1e-3)
    assert len(clip) == 4
    again = bvh.parse(bvh.encode(clip))
    assert again.skeleton.names == clip.skeleton.names
    assert np.array_equal(again.local_rotations, clip.local_rotations)


def test_names_with_spaces_are_kept_and_spliced() -> None:
    clip = load(CASES / "bvh_names_with_spaces" / "names_with_spaces.bvh")
    assert clip.skeleton.names == ("Bip01", "Bip01 Spine", "Bip01 L UpperArm")
    joined = bvh.parse(bvh.encode(concatenate([clip, clip[1:]])))
    assert joined.skeleton.names == clip.skeleton.names
    assert joined.channels is not None
    assert clip.channels is not None
    assert np.array_equal(joined.channels.values[:4], clip.channels.values)


def test_files_at_the_limits_are_read() -> None:
    assert len(bvh.parse(deep(256).encode()).skeleton) == 256
    assert len(bvh.parse(wide(1024).encode()).skeleton) == 1024


@pytest.mark.parametrize(
    "name", ["左手", "hand:L.001", "a{b}", "a-b", "Bip01'L", "é", "Bip01 L Hand", "b }", "JOINT a"]
)
def test_joint_names_may_have_any_character(name: str) -> None:
    clip = bvh.parse(VALID.replace("Spine", name).encode())
    assert clip.skeleton.names[1] == name


def test_a_file_truncated_anywhere_is_refused_or_read_with_a_note() -> None:
    """Truncation never hangs. Whole frames are read, as many as there are; within a frame, the file is refused, since
    its last number may lack digits too. Only the last line's end may be missing.
    """
    content = VALID.encode()
    first_frame = content[: content.index(b"0 91 0")]
    for stop in range(len(content) - 9):
        if content[:stop].rstrip() == first_frame.rstrip():
            assert bvh.parse(content[:stop]).notes == ("Frames: says 2, but 1 frames follow, which are read",)
        else:
            with pytest.raises(FormatError):
                bvh.parse(content[:stop])
    assert len(bvh.parse(content[:-1])) == 2
