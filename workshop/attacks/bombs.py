"""Reads small or odd files that ask for unbounded time or memory, each in a fresh process of the command line.

``python attacks/bombs.py`` prints a row of Markdown for each: the command's message, its processor time, and its peak
memory beside that of a command that reads a small valid file.
"""

from __future__ import annotations

import io
import json
import os
import resource
import struct
import subprocess
import sys
import tempfile
import threading
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

SECONDS = 120
"""Wall-clock time after which a command is killed, s."""
BYTES = 6 << 30
"""Memory limit of a command."""

VALID = """HIERARCHY
ROOT Hips
{
	OFFSET 0.0 90.0 0.0
	CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
	End Site
	{
		OFFSET 0.0 5.0 0.0
	}
}
MOTION
Frames: 2
Frame Time: 0.04
0 90 0 1 2 3
0 91 0 1 2 4
"""
JOINT = "JOINT j{}\n{{\nOFFSET 0 1 0\nCHANNELS 0\n"
ENDS = ["--cutter", "ends", "--transition", "slerp", "--transition-time", "0.2"]
HEAD = "HIERARCHY\nROOT r\n{\nOFFSET 0 0 0\nCHANNELS 1 Zrotation\n"


@dataclass(frozen=True)
class CommandOutcome:
    """Outcome of a command: its last line of output, its processor time, and its peak memory."""

    line: str
    seconds: float
    megabytes: float


CODE = f"""
import resource, sys
resource.setrlimit(resource.RLIMIT_DATA, ({BYTES}, {BYTES}))
from signsplice.cli import main
try:
    main()
finally:  # the peak of this program alone; what the system adds up counts that of the one which started it too
    with open("/proc/self/status") as status:
        print(next(line for line in status if line.startswith("VmHWM")))
"""


def run_command(*arguments: str) -> CommandOutcome:
    """Runs ``signsplice`` with these arguments in its own process and returns the outcome."""
    with tempfile.TemporaryFile() as output:
        process = subprocess.Popen([sys.executable, "-c", CODE, *arguments], stdout=output, stderr=output)
        timer = threading.Timer(SECONDS, process.kill)
        timer.start()
        _, status, usage = os.wait4(process.pid, 0)
        timer.cancel()
        process.returncode = os.waitstatus_to_exitcode(status)
        output.seek(0)
        lines = output.read().decode("utf-8", "replace").splitlines()
    peak = next((int(line.split()[1]) for line in lines if line.startswith("VmHWM")), usage.ru_maxrss)
    lines = [line.strip() for line in lines if line.strip() and not line.startswith("VmHWM")]
    message = (
        f"killed after {SECONDS} s" if process.returncode == -9 else "read" if process.returncode == 0 else lines[-1]
    )
    return CommandOutcome(f"exit {process.returncode}: {message}", usage.ru_utime + usage.ru_stime, peak / 1024)


def encode_glb(document: dict[str, Any], blob: bytes = b"") -> bytes:
    """Returns the bytes of a .glb file."""
    text = json.dumps({"asset": {"version": "2.0"}, **document}).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    if blob:
        chunks += struct.pack("<I4s", len(blob), b"BIN\0") + blob
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def encode_animated_glb(
    nodes: list[dict[str, Any]], seconds: float = 1.0, n_matrices: int = 0, **properties: Any
) -> bytes:
    """Returns a .glb file whose first node turns, with keys at 0 and ``seconds``, and ``n_matrices`` unit matrices.

    properties: further properties of the document.
    """
    blob = struct.pack("<2f8f", 0.0, seconds, 0, 0, 0, 1, 0, 0, 0.6, 0.8)
    accessors = [
        {"bufferView": 0, "componentType": 5126, "count": 2, "type": "SCALAR"},
        {"bufferView": 1, "componentType": 5126, "count": 2, "type": "VEC4"},
        {"bufferView": 2, "componentType": 5126, "count": n_matrices, "type": "MAT4"},
    ]
    views = [
        {"buffer": 0, "byteLength": 8},
        {"buffer": 0, "byteOffset": 8, "byteLength": 32},
        {"buffer": 0, "byteOffset": 40, "byteLength": 64 * n_matrices},
    ]
    blob += struct.pack("<16f", 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1) * n_matrices
    channels = [{"sampler": 0, "target": {"node": 0, "path": "rotation"}}]
    animations = [{"samplers": [{"input": 0, "output": 1}], "channels": channels}]
    buffers = [{"byteLength": len(blob)}]
    document = {
        "nodes": nodes,
        "accessors": accessors,
        "bufferViews": views,
        "buffers": buffers,
        "animations": animations,
    }
    return encode_glb(document | properties, b"" if "buffers" in properties else blob)


def make_chain(n: int) -> list[dict[str, Any]]:
    """Returns ``n`` nodes, each the parent of the next."""
    return [{"children": [node + 1]} if node + 1 < n else {} for node in range(n)]


def encode_npz(change: Any = None, n_members: int = 0) -> bytes:
    """Returns an .npz file of a small clip, whose description and arrays ``change`` alters, with ``n_members`` empty
    members.
    """
    import numpy as np

    head: dict[str, Any] = {"version": 1, "name": "a", "fps": 30.0, "names": ["hips"], "end_joints": [], "roles": None}
    arrays: dict[str, Any] = {
        "parents": np.array([-1]),
        "offsets": np.zeros((1, 3)),
        "end_offsets": np.zeros((0, 3)),
        "local_rotations": np.tile([0.0, 0.0, 0.0, 1.0], (4, 1, 1)),
        "root_positions": np.zeros((4, 3)),
    }
    if change is not None:
        change(head, arrays)
    content = io.BytesIO()
    np.savez(content, head=np.array(json.dumps(head)), **arrays)
    with zipfile.ZipFile(content, "a") as members:
        for n in range(n_members):
            members.writestr(f"x{n}", b"")
    return content.getvalue()


def make_attacks(folder: Path) -> Iterator[tuple[str, list[str]]]:
    """Yields name and arguments of each attack; makes its files just before."""
    output = ["-o", str(folder / "out.bvh")]

    def inspect(name: str, file: str, content: bytes) -> tuple[str, list[str]]:
        path = folder / file
        path.write_bytes(content)
        return f"{name} ({path.stat().st_size:,} bytes)", ["inspect", str(path)]

    (folder / "valid.bvh").write_text(VALID)
    yield "a small valid file", ["inspect", str(folder / "valid.bvh")]
    # processing time that grows with the square of the number of nodes
    yield inspect("chain of 3,000 nodes", "a.glb", encode_animated_glb(make_chain(3000)))
    yield inspect("chain of 20,000 nodes", "a.glb", encode_animated_glb(make_chain(20_000)))
    yield "the same with --no-limits", ["inspect", str(folder / "a.glb"), "--no-limits"]
    skins = [{"joints": [0, 1, 2]}]
    yield inspect(
        "chain of 20,000 nodes, 3 of them joints", "a.glb", encode_animated_glb(make_chain(20_000), skins=skins)
    )
    namesakes: list[dict[str, Any]] = [
        {"name": "x", "children": [*range(1, 1024)]},
        *({"name": "x"} for _ in range(1023)),
    ]
    yield inspect("1,024 nodes of one name", "a.glb", encode_animated_glb(namesakes))
    chain_hierarchy = HEAD + "".join(JOINT.format(n) for n in range(20_000)) + "}\n" * 20_001
    flat_hierarchy = HEAD + "".join(JOINT.format(n) + "}\n" for n in range(20_000)) + "}\n"
    motion = "MOTION\nFrames: 1\nFrame Time: 0.1\n0\n"
    yield inspect("BVH of 20,000 joints in a chain", "a.bvh", (chain_hierarchy + motion).encode())
    yield inspect("BVH of 20,000 joints side by side", "a.bvh", (flat_hierarchy + motion).encode())
    line = HEAD.replace("\n", " ") + "OFFSET " * 40_000
    yield inspect("BVH of 40,000 words in a line", "a.bvh", (line + "\n" + motion).encode())
    # small files, much work
    yield inspect("two keys 160,000 s apart", "a.glb", encode_animated_glb([{}], 160_000.0))
    yield inspect("two keys 80,000 s apart", "a.glb", encode_animated_glb([{}], 80_000.0))
    for rate in ("1000000", "2000"):
        (folder / "slow.bvh").write_text(VALID.replace("0.04", rate))
        arguments = ["splice", str(folder / "valid.bvh"), str(folder / "slow.bvh"), *ENDS, *output]
        yield f"second of two clips with {rate} s a frame", arguments
    (folder / "fast.bvh").write_text(VALID.replace("0.04", "1e-9"))
    yield "1e9 frames a second", ["splice", str(folder / "fast.bvh"), str(folder / "valid.bvh"), *output]
    yield inspect("20,000,000 blank lines", "a.bvh", VALID.encode() + b"\n" * 20_000_000)
    yield inspect("20,000,000 lines of white space", "a.bvh", b" \t\n" * 20_000_000 + VALID.encode())
    yield inspect("10,000,000 numbers in a line", "a.bvh", (VALID + "10 " * 10_000_000).encode())
    yield inspect("Frames: 999,999,999", "a.bvh", VALID.replace("Frames: 2", "Frames: 999999999").encode())
    joints = HEAD + "".join(JOINT.format(n) + "}\n" for n in range(1023)) + "}\n"
    still_motion = f"MOTION\nFrames: 100000\nFrame Time: 0.1\n{'0' + chr(10)}"
    frames = (joints + still_motion).encode() + b"0\n" * 99_999
    yield inspect("100,000 frames of 1,024 joints, one of which moves", "a.bvh", frames)
    yield inspect("a number of 20,000,000 digits", "a.bvh", VALID.replace("0.04", "1" * 20_000_000 + "x").encode())
    yield inspect("npz of 30,000 members", "a.npz", encode_npz(n_members=30_000))
    zero_archive = io.BytesIO()
    with zipfile.ZipFile(zero_archive, "w", zipfile.ZIP_DEFLATED) as members:
        members.writestr("head.npy", bytes(900 << 20))
    yield inspect("npz that unpacks to 900 MiB", "a.npz", zero_archive.getvalue())
    yield inspect("JSON of 3,000,000 empty objects", "a.gltf", b"[" + b"{}," * 3_000_000 + b"{}]")
    yield inspect("JSON nested 1,000,000 deep", "a.gltf", b"[" * 1_000_000)
    many_skins = [{"joints": [0], "inverseBindMatrices": 2}] * 50_000
    yield inspect("50,000 skins", "a.glb", encode_animated_glb([{}], n_matrices=1000, skins=many_skins))
    # links, pipes and devices
    os.mkfifo(folder / "pipe.bvh")
    yield "a pipe", ["inspect", str(folder / "pipe.bvh")]
    (folder / "zero.bvh").symlink_to("/dev/zero")
    yield "a link to /dev/zero", ["inspect", str(folder / "zero.bvh")]
    (folder / "link.bvh").symlink_to(folder / "valid.bvh")
    yield "a link to a regular file", ["inspect", str(folder / "link.bvh")]
    (folder / "inner").mkdir()
    (folder / "secret.bin").write_bytes(bytes(40))
    (folder / "inner" / "out.bin").symlink_to(folder / "secret.bin")
    os.mkfifo(folder / "inner" / "pipe.bin")
    for name, file in (("link out of the folder", "out.bin"), ("pipe", "pipe.bin")):
        document = json.dumps(
            json.loads(encode_animated_glb([{}])[20:].split(b"BIN\0")[0][:-4].decode("utf-8", "ignore"))
        )
        path = folder / "inner" / "a.gltf"
        path.write_text(document.replace('"buffers": [{', f'"buffers": [{{"uri": "{file}", '))
        yield f"buffer that is a {name}", ["inspect", str(path)]
    # archives whose parts have a wrong type or shape
    changes = {
        "names that are numbers": lambda head, arrays: head.update(names=[7]),
        "a rate that is text": lambda head, arrays: head.update(fps="30"),
        "complex rotations": lambda head, arrays: arrays.update(local_rotations=arrays["local_rotations"] + 0j),
        "a role of a joint that is not there": lambda head, arrays: head.update(roles={"hips": "gone"}),
        "an end site of joint 9": lambda head, arrays: (
            head.update(end_joints=[9]),
            arrays.update(end_offsets=arrays["offsets"]),
        ),
    }
    for name, change in changes.items():
        (folder / "a.npz").write_bytes(encode_npz(change))
        yield f"npz with {name}", ["splice", str(folder / "a.npz"), str(folder / "a.npz"), *output]


def main() -> None:
    """Prints a row of Markdown for each attack."""
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    base_megabytes = 0.0
    print("| attack | seen |\n| --- | --- |")
    with tempfile.TemporaryDirectory() as folder:
        for name, arguments in make_attacks(Path(folder)):
            outcome = run_command(*arguments)
            base_megabytes = base_megabytes or outcome.megabytes
            line = outcome.line.replace(folder + "/", "").replace("inner/", "").replace("|", "\\|")
            figures = f"{outcome.seconds:.1f} s of processor time, {outcome.megabytes - base_megabytes:+.0f} MB"
            print(f"| {name} | {line[:200]}; {figures} |", flush=True)


if __name__ == "__main__":
    main()
