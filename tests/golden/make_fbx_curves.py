"""Makes fbx_curves.json: curves of every kind of key, and keyed arms, as independent programs show them.

    python tests/golden/make_fbx_curves.py PATH_OF_FBX2GLTF

ufbx 0.0.5 (PyPI) evaluates the curves of version 7 and the arms; FBX2glTF 0.9.7 (npm: fbx2gltf), which holds the FBX
SDK, the curves of version 6, whose automatic and TCB keys ufbx shows otherwise.
"""

from __future__ import annotations

import importlib
import json
import struct
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent))

from fbx_files import TICKS, Curve, Node, text_6, text_7  # noqa: E402

ufbx: Any = importlib.import_module("ufbx")
KEPT: list[Any] = []
"""Every object of ufbx 0.0.5: it ends the process if one is freed and asked for again."""
PLAIN = (0.0, 0.0, 0.0)
SECONDS, VALUES = (0.0, 0.42, 0.93, 1.01, 1.71, 2.0), (0.0, 30.0, 30.0, 50.0, 10.0, -5.0)
FRAMES = np.arange(61) / 30.0
RULES: dict[str, tuple[int, Sequence[float]]] = {
    "held": (0x2, PLAIN),
    "held at the next value": (0x102, PLAIN),
    "linear": (0x4, PLAIN),
    "cubic without a rule": (0x8, PLAIN),
    "automatic": (0x108, PLAIN),
    "automatic, biased": (0x108, (40.0, -25.0, 0.0)),
    "automatic, broken": (0x908, PLAIN),
    "automatic, time independent": (0x2108, PLAIN),
    "automatic, clamped": (0x1108, PLAIN),
    "automatic, clamped, time independent": (0x3108, PLAIN),
    "automatic, clamped progressively": (0x6108, PLAIN),
    "automatic, clamped progressively, broken": (0x6908, PLAIN),
    "automatic, clamped in both ways": (0x7108, PLAIN),
    "TCB": (0x208, (0.3, 0.2, -0.4)),
    "slopes": (0x408, (60.0, -90.0, 0.0)),
    "slopes, broken": (0xC08, (60.0, -90.0, 0.0)),
}
"""Name -> flags, and what the first three attributes hold."""
WEIGHTS, VELOCITIES = 2000 | 7000 << 16, 5000 | 8000 << 16
CHAIN = (
    ("Hips", "", (0, 95, 0)),
    ("Spine", "Hips", (0, 25, 0)),
    ("Shoulder", "Spine", (5, 20, 0)),
    ("Arm", "Shoulder", (12, 0, 0)),
    ("ForeArm", "Arm", (28, 0, 0)),
    ("Hand", "ForeArm", (26, 0, 0)),
    ("Index", "Hand", (9, 0, 2)),
)
OLD = ("L", "C,s", "C,n", "U,a,n", "U,s,60,-90,n", "U,b,60,-90,a,0.2,0.7", "U,s,60,-90,r,0.2", "U,s,60,-90,l,0.7",
       "U,t,0.3,0.2,-0.4", "U,p,a,20,50,n")  # fmt: skip
"""What follows the time and value of each key in version 6."""


def keep(thing: Any) -> Any:
    """Return an object of ufbx, which is never freed."""
    KEPT.append(thing)
    return thing


def bits(number: float) -> int:
    """Return the bits of a number of 32 bits, as a whole number."""
    return int(struct.unpack("<i", struct.pack("<f", number))[0])


def curve(
    rules: Sequence[tuple[int, Sequence[float]]],
    seconds: Sequence[float] = SECONDS,
    values: Sequence[float] = VALUES,
    beyond: Sequence[str] = ("C -1", "C -1"),
) -> Curve:
    """Return a curve; with weights or velocities where its flags say so."""
    numbers = []
    for flags, row in rules:
        third = WEIGHTS if flags & 0x3000000 else bits(row[2])
        numbers.append([bits(row[0]), bits(row[1]), third, VELOCITIES if flags & 0x30000000 else 0])
    return Curve(list(zip(seconds, values, strict=True)), [flags for flags, _ in rules], numbers, beyond)


def curves() -> dict[str, Curve]:
    """Return name -> curve."""
    made = {name: curve([rule] * 6) for name, rule in RULES.items()}
    for name in ("slopes", "automatic", "automatic, clamped progressively"):
        flags, numbers = RULES[name]
        for weighted, more in ((0x1000000, "right weights"), (0x2000000, "left weights"), (0x33000000, "velocities")):
            made[f"{name}, {more}"] = curve([(flags | weighted, numbers)] * 6)
    rng = np.random.default_rng(5)
    for number in range(3):
        names = [str(name) for name in rng.choice([*RULES], 6)]
        made[f"mixed {number + 1}: {'; '.join(names)}"] = curve([RULES[name] for name in names])
    for name in ("linear", "automatic", "automatic, clamped progressively", "TCB"):
        made[f"{name}, keys at equal times"] = curve([RULES[name]] * 6, (0.0, 0.42, 0.42, 1.01, 1.71, 1.71))
        made[f"{name}, two keys"] = curve([RULES[name]] * 2, (0.0, 2.0), (3.0, 40.0))
    for kind in "CKRMA":
        for count in (-1, 0, 1, 2):
            name = f"before and after: {kind} {count}"
            made[name] = curve([RULES["automatic"]] * 3, (0.805, 0.9, 1.1), (0.0, 10.0, 4.0), [f"{kind} {count}"] * 2)
    return made


def file_of(one: Curve) -> bytes:
    """Return a file whose hips move by a curve."""
    spine, neck = Node("Spine", "Hips", (0, 20, 0)), Node("Neck", "Spine", (0, 30, 0))
    return text_7((Node("Hips", curves={("T", 0): one}), spine, neck), span=(0.0, 2.0))


def show(one: Curve) -> list[float]:
    """Return what ufbx shows in each frame."""
    scene = keep(ufbx.load_memory(file_of(one)))
    track = keep(keep(scene.anim_curves)[0])
    return [round(ufbx.evaluate_curve(track, float(second), 0.0), 5) for second in FRAMES]


def show_old(converter: str, rule: str) -> list[float]:
    """Return what FBX2glTF shows in each frame of keys of version 6, without holes."""
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "a.fbx").write_bytes(old_file(rule))
        command = [converter, "-b", "-i", f"{folder}/a.fbx", "-o", f"{folder}/o.glb", "--anim-framerate", "bake30"]
        subprocess.run(command, check=True, capture_output=True)
        content = (Path(folder) / "o.glb").read_bytes()
    n_bytes = struct.unpack_from("<I", content, 12)[0]
    document, binary = json.loads(content[20 : 20 + n_bytes]), content[28 + n_bytes :]
    animation = document["animations"][0]
    moved = next(channel for channel in animation["channels"] if channel["target"]["path"] == "translation")
    accessor = document["accessors"][animation["samplers"][moved["sampler"]]["output"]]
    at = document["bufferViews"][accessor["bufferView"]].get("byteOffset", 0)
    numbers = np.frombuffer(binary, "<f4", 3 * accessor["count"], at).reshape(-1, 3)
    return [round(100.0 * float(number), 4) for number in numbers[:, 0]]


def old_file(rule: str) -> bytes:
    """Return a file of version 6 whose hips move by keys of a rule."""
    keys = list(zip(SECONDS, VALUES, strict=True))
    return text_6((Node("Hips", moves={("T", 0): keys}),), (0.0, 2.0), rule)


def arm(rng: np.random.Generator) -> tuple[Node, ...]:
    """Return an arm whose keys have rules at random."""
    nodes = []
    for name, parent, at in CHAIN:
        moved = [("R", axis) for axis in range(3) if name in ("Hips", "Arm", "ForeArm", "Hand") and rng.random() < 0.8]
        tracks = {}
        for key in moved:
            n_keys = int(rng.integers(2, 7))
            seconds = np.sort(np.append(rng.uniform(0.05, 1.95, n_keys - 2).round(2) + 0.003, (0.0, 2.0)))
            values = rng.uniform(-50, 50, n_keys).round(1)
            values[1:] = np.where(rng.random(n_keys - 1) < 0.25, values[:-1], values[1:])
            names = rng.choice([*RULES], n_keys if rng.random() < 0.6 else 1)
            rules = [RULES[str(rule)] for rule in np.resize(names, n_keys)]
            weighted = [(flags | 0x3000000 * int(rng.random() < 0.4 and flags != 0x208), row) for flags, row in rules]
            tracks[key] = curve(weighted, seconds.tolist(), values.tolist())
        nodes.append(Node(name, parent, at, order=int(rng.integers(6)), curves=tracks))
    return tuple(nodes)


def locate(nodes: Sequence[Node]) -> list[list[list[float]]]:
    """Return where ufbx has the joints in every sixth frame."""
    scene = keep(ufbx.load_memory(text_7(nodes, span=(0.0, 2.0))))
    motion, positions = keep(scene.anim), []
    for second in FRAMES[::6]:
        models = keep(keep(ufbx.evaluate_scene(scene, motion, float(second))).nodes)
        row = {}
        for number in range(len(models)):
            model = keep(models[number])
            origin = keep(keep(model.node_to_world).c3)
            row[str(model.name)] = [round(float(x), 4) for x in (origin.x, origin.y, origin.z)]
        positions.append([row[node.name] for node in nodes])
    return positions


def encode(one: Curve) -> dict[str, Any]:
    """Return a curve as JSON has it."""
    return {
        "ticks": [round(second * TICKS) for second, _ in one.keys],
        "values": [value for _, value in one.keys],
        "flags": [*one.flags],
        "numbers": [*one.numbers],
        "beyond": [*one.beyond],
    }


def main(converter: str) -> None:
    """Write the file."""
    arms = []
    for number in range(6):
        nodes = arm(np.random.default_rng(100 + number))
        tracks = [
            {"joint": node.name, "axis": axis} | encode(one) for node in nodes for (_, axis), one in node.curves.items()
        ]
        arms.append({"orders": [node.order for node in nodes], "tracks": tracks, "positions": locate(nodes)})
    golden = {
        "programs": "ufbx 0.0.5 (curves, arms) and FBX2glTF 0.9.7 (version 6), 30 frames a second, arms every 6th",
        "curves": {name: encode(one) | {"shown": show(one)} for name, one in curves().items()},
        "version 6": {rule: show_old(converter, rule) for rule in OLD},
        "arms": arms,
    }
    (HERE / "fbx_curves.json").write_text(json.dumps(golden, separators=(",", ":")).replace('},"', '},\n"') + "\n")


if __name__ == "__main__":
    main(sys.argv[1])
