"""Broken BVH files, each with the error message that it must cause."""

from __future__ import annotations

VALID = """HIERARCHY
ROOT Hips
{
	OFFSET 0.0 90.0 0.0
	CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
	JOINT Spine
	{
		OFFSET 0.0 10.0 0.0
		CHANNELS 3 Zrotation Xrotation Yrotation
		End Site
		{
			OFFSET 0.0 5.0 0.0
		}
	}
}
MOTION
Frames: 2
Frame Time: 0.04
0 90 0 1 2 3 4 5 6
0 91 0 1 2 3 4 5 7
"""


def edited(old: str, new: str, count: int = 1) -> str:
    """The valid file with one edit."""
    assert old in VALID
    return VALID.replace(old, new, count)


def deep(levels: int) -> str:
    """A chain of ``levels`` joints."""
    head = "".join(f"{'JOINT' if n else 'ROOT'} j{n}\n{{\nOFFSET 0 1 0\nCHANNELS 1 Zrotation\n" for n in range(levels))
    return f"HIERARCHY\n{head}{'} ' * levels}\nMOTION\nFrames: 1\nFrame Time: 0.1\n{'0 ' * levels}\n"


def wide(n_joints: int) -> str:
    """A root with ``n_joints`` - 1 children."""
    joint = "JOINT j{}\n{{\nOFFSET 0 1 0\nCHANNELS 1 Zrotation\n}}\n"
    inner = "".join(joint.format(n) for n in range(n_joints - 1))
    head = f"HIERARCHY\nROOT r\n{{\nOFFSET 0 0 0\nCHANNELS 1 Zrotation\n{inner}}}\n"
    return f"{head}MOTION\nFrames: 1\nFrame Time: 0.1\n{'0 ' * n_joints}\n"


LAST = "0 91 0 1 2 3 4 5 7\n"

BROKEN: dict[str, tuple[str | bytes, str]] = {
    # numbers
    "nan": (edited("4 5 7", "4 nan 7"), ":20: 'nan' is not a finite number, expected one"),
    "inf": (edited("4 5 7", "4 -Inf 7"), ":20: '-Inf' is not a finite number"),
    "overflow": (edited("4 5 7", "4 1e999 7"), ":20: '1e999' is too large"),
    "word in a frame": (edited("4 5 6", "4 five 6"), ":19: 'five' is not a number"),
    "underscore": (edited("4 5 6", "4 5_0 6"), ":19: '5_0' is not a number"),
    "hexadecimal": (edited("4 5 6", "4 0x10 6"), ":19: '0x10' is not a number"),
    "glued numbers": (edited("3 4 5 7", "3 4-5 7 8"), ":20: '4-5' is not a number"),
    "decimal comma": (edited("4 5 7", "4 5,5 7"), ":20: '5,5' has a decimal comma, expected a point"),
    "comma separated": (
        edited("0 91 0 1 2 3 4 5 7", "0,91,0,1,2,3,4,5,7"),
        ":20: 1 numbers in a frame, expected 9; it has commas",
    ),
    "offset nan": (edited("OFFSET 0.0 10.0 0.0", "OFFSET 0.0 nan 0.0"), ":8: 'nan' is not a finite number"),
    "offset comma": (edited("OFFSET 0.0 10.0 0.0", "OFFSET 0,0 10.0 0.0"), ":8: '0,0' has a decimal comma"),
    "offset short": (edited("OFFSET 0.0 10.0 0.0", "OFFSET 0.0 10.0"), ":8: OFFSET with 2 values, expected 3 numbers"),
    "offset long": (edited("OFFSET 0.0 10.0 0.0", "OFFSET 0 1 2 3"), ":8: OFFSET with 4 values, expected 3 numbers"),
    # frames
    "too few columns": (edited("4 5 6\n", "4 5\n"), ":19: 8 numbers in a frame, expected 9"),
    "too many columns": (edited("4 5 6\n", "4 5 6 7\n"), ":19: 10 numbers in a frame, expected 9"),
    "truncated line": (VALID[:-8], ":20: 5 numbers in a frame, expected 9; the file seems to be cut off here"),
    "absurd claim": (
        edited("Frames: 2", "Frames: " + "9" * 30),
        ":17: Frames: '999999999999999999999999999999', expected a whole",
    ),
    "no frames": (VALID[: VALID.index("0 90 0 1")], ":19: no frame follows, expected at least one line of numbers"),
    "one cut frame": (
        edited("Frames: 2", "Frames: 0").replace(LAST, "")[:-6],
        ":19: no frame follows, expected at least one line of numbers",
    ),
    "negative frames": (edited("Frames: 2", "Frames: -2"), ":17: Frames: '-2', expected a whole number"),
    "fractional frames": (edited("Frames: 2", "Frames: 2.5"), ":17: Frames: '2.5', expected a whole number"),
    "frames missing": (edited("Frames: 2\n", ""), ":17: found 'Frame Time: 0.04', expected Frames: and a number"),
    "frames empty": (edited("Frames: 2", "Frames:"), ":17: found 'Frames:', expected Frames: and a number"),
    "frames in two words": (edited("Frames: 2", "Frames: 2 x"), ":17: found 'x', expected Frame Time: and seconds"),
    "text before the last frame": (
        edited(LAST, "the end\n" + LAST),
        ":20: 2 numbers in a frame, expected 9",
    ),
    "frame time missing": (edited("Frame Time: 0.04\n", ""), ":18: found '0 90 0 1 2 3 4 5 6', expected Frame Time:"),
    "frame time zero": (edited("0.04", "0.0"), ":18: Frame Time: 0.0, expected more than 0 seconds"),
    "frame time negative": (edited("0.04", "-0.04"), ":18: Frame Time: -0.04, expected more than 0"),
    "frame time comma": (edited("0.04", "0,04"), ":18: '0,04' has a decimal comma"),
    "frame time word": (edited("0.04", "fast"), ":18: 'fast' is not a number"),
    "motion only": (VALID[VALID.index("MOTION") :], ":1: found MOTION, expected HIERARCHY"),
    "hierarchy only": (VALID[: VALID.index("MOTION")], "ends without MOTION"),
    "ends after MOTION": (VALID[: VALID.index("Frames")], "the file ends here, expected Frames:"),
    "frames before MOTION": (edited("MOTION\n", ""), ":16: found 'Frames:' without MOTION before it"),
    "no channels": (
        "HIERARCHY\nROOT a\n{\nOFFSET 0 0 0\n}\nMOTION\nFrames: 1\nFrame Time: 0.1\n",
        ":8: the skeleton has no channels",
    ),
    # hierarchy
    "brace never closed": (edited("}\nMOTION", "MOTION"), "joint 'Hips' (line 2) is never closed, expected }"),
    "brace too many": (edited("}\nMOTION", "}\n}\nMOTION"), ":16: found } with no open brace"),
    "brace missing": (edited("ROOT Hips\n{", "ROOT Hips"), ":3: found 'OFFSET', expected { after joint 'Hips'"),
    "brace from nowhere": (edited("HIERARCHY\n", "HIERARCHY\n{\n"), ":2: found {, expected ROOT"),
    "second root": (edited("MOTION", "ROOT Other\n{\nOFFSET 0 0 0\n}\nMOTION"), ":16: a second ROOT 'Other'"),
    "joint before root": (edited("ROOT Hips", "JOINT Hips"), ":2: JOINT 'Hips' comes first, expected ROOT"),
    "scaled": (
        edited("CHANNELS 3 Zrotation", "CHANNELS 4 Xscale Zrotation")
        .replace("4 5 6", "1 4 5 6")
        .replace("4 5 7", "2 4 5 7"),
        ":20: Xscale of joint 'Spine' is 2, expected 1; export the file without scales",
    ),
    "channels of an end site, and neither length": (
        edited("OFFSET 0.0 5.0 0.0", "OFFSET 0.0 5.0 0.0 CHANNELS 2 Zrotation Yrotation").replace("4 5 6", "4 5 6 7"),
        ":19: 10 numbers in a frame, expected 11",
    ),
    "unknown channel": (edited("Zposition", "Wposition"), ":5: unknown channel 'Wposition', expected one of Xposition"),
    "channel twice": (edited("Zrotation Xrotation", "Zrotation Zrotation"), ":5: joint 'Hips' has a channel twice"),
    "channels too few": (
        edited("CHANNELS 3 Zrotation Xrotation", "CHANNELS 3 Zrotation"),
        ":9: CHANNELS 3 with 2 names",
    ),
    "channels too many": (edited("CHANNELS 3", "CHANNELS 2"), ":9: CHANNELS 2 with 3 names, expected 2"),
    "channels no count": (edited("CHANNELS 3", "CHANNELS"), ":9: CHANNELS 'Zrotation', expected a number"),
    "channels twice": (edited("\t\tEnd Site", "\t\tCHANNELS 1 Zrotation\n\t\tEnd Site"), ":10: a second CHANNELS"),
    "offset missing": (edited("\t\tOFFSET 0.0 10.0 0.0\n", ""), ":6: joint 'Spine' without OFFSET"),
    "offset twice": (edited("\tOFFSET 0.0 90.0 0.0\n", "\tOFFSET 0 90 0\n\tOFFSET 0 90 0\n"), ":5: a second OFFSET"),
    "end site without offset": (edited("\t\t\tOFFSET 0.0 5.0 0.0\n", ""), ":10: End Site without OFFSET"),
    "joint in end site": (edited("\t\t\tOFFSET 0.0 5.0 0.0", "JOINT x"), ":12: JOINT x inside an End Site"),
    "unknown word": (edited("\tJOINT Spine", "\tLIMB Spine"), ":6: found 'LIMB', expected JOINT"),
    "empty hierarchy": ("HIERARCHY\nMOTION\nFrames: 1\nFrame Time: 0.1\n0\n", ":2: no ROOT"),
    "too deep": (deep(257), "joints nest deeper than 256"),
    "too many joints": (wide(1025), "more than 1024 joints"),
    # not BVH at all
    "empty": ("", ":1: the file is empty"),
    "white space": (" \n\t\r\n", ":1: the file is empty"),
    "binary": (b"HIERARCHY\n\x00\x01\x02", ":2: the file is binary"),
    "png": (b"\x89PNG\r\n\x1a\n" + bytes(40), "the file is binary"),
    "other text": ("<html><body>404</body></html>\n", ":1: found '<html><body>404</body></html>', expected HIERARCHY"),
    "one long line": ("x" * 100_000, ":1: found 'xxx"),
}
