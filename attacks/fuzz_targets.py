"""What is fuzzed: for each kind of file valid ones to start from, a mutation, the reader, and the next step that a user
of what was read takes.
"""

from __future__ import annotations

import base64
import hashlib
import itertools
import json
import random
import shutil
import struct
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import fuzz_clips
import fuzz_folders
import fuzz_mutators
import fuzz_networks
import signsplice as ss
from fuzz_clips import joined_chunks, packed, unpacked
from signsplice import formats, lexicon
from signsplice.formats import roles as roles_files
from signsplice.lexicon import glosses, sentence
from signsplice.motion import kinematics, rotation
from signsplice.motion.clip import Clip, EndSite, Skeleton
from signsplice.rig.info import rig_info
from signsplice.service import scene
from signsplice.splicing import report as reports
from signsplice.splicing.methods.choice import open_learned
from signsplice.synth import notation, planner

ROOT = Path(__file__).resolve().parents[1]
CORPUS = ROOT / "tests" / "fuzz_corpus"
CLASSICAL = ss.SpliceOptions("pose-velocity", "hermite", "tempo")
N_REPORTED = 12
"""Frames of the clip that a fuzzed report is read for."""


@dataclass(frozen=True)
class Target:
    """A kind of file that is fuzzed.

    name: of the kind.
    seeds: valid files.
    mutate: another file from the bytes of one.
    put: writes the bytes into an empty folder and returns the path that is read.
    load: what the program reads at that path; raises ``InputError``, which names the path.
    use: the next step with what was read; raises ``InputError``.
    unpacked: the size of a file's content once unpacked.
    """

    name: str
    seeds: Callable[[], list[bytes]]
    mutate: fuzz_mutators.Mutator
    put: Callable[[bytes, Path], Path]
    load: Callable[[Path], Any]
    use: Callable[[Any], None]
    unpacked: Callable[[bytes], int] = len

    def mutated(self, seeds: Sequence[bytes], rng: random.Random) -> bytes:
        """One of the seeds, mutated once or some times."""
        content = rng.choice(seeds)
        for _ in range(1 + min(int(rng.expovariate(0.9)), 6)):
            try:
                content = self.mutate(content, rng)
            except Exception:  # of a file that is broken already, which has no structure left
                break
        return content

    def exercise(self, content: bytes, folder: Path) -> bool:
        """Put, load and use a file; False where it was refused. Raises ``AssertionError`` for a refusal that is not
        one line with the file's name, and whatever else the reader lets through.
        """
        path = self.put(content, folder)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                loaded = self.load(path)
            except ss.InputError as error:
                check_message(str(error), path.name)
                return False
            try:
                self.use(loaded)
            except ss.InputError as error:
                check_message(str(error), "")
                return False
        return True


def check_message(text: str, name: str) -> None:
    """Raise ``AssertionError`` for an error that is not one line of fair length, or does not name the file."""
    assert 0 < len(text) < 1500, f"a message of {len(text)} characters"
    assert len(text.splitlines()) == 1, f"a message of several lines: {text!r}"
    assert name in text, f"a message without the file's name: {text!r}"


_JOINTS = (
    ("Hips", -1, (0.0, 95.0, 0.0)), ("Spine", 0, (0.0, 20.0, 0.0)), ("Neck", 1, (0.0, 30.0, 0.0)),
    ("Head", 2, (0.0, 10.0, 0.0)), ("LeftArm", 1, (18.0, 26.0, 0.0)), ("LeftForeArm", 4, (28.0, 0.0, 0.0)),
    ("LeftHand", 5, (25.0, 0.0, 0.0)), ("RightArm", 1, (-18.0, 26.0, 0.0)), ("RightForeArm", 7, (-28.0, 0.0, 0.0)),
    ("RightHand", 8, (-25.0, 0.0, 0.0)), ("LeftUpLeg", 0, (10.0, -5.0, 0.0)), ("LeftLeg", 10, (0.0, -42.0, 0.0)),
    ("LeftFoot", 11, (0.0, -42.0, 0.0)), ("RightUpLeg", 0, (-10.0, -5.0, 0.0)), ("RightLeg", 13, (0.0, -42.0, 0.0)),
    ("RightFoot", 14, (0.0, -42.0, 0.0)),
)  # fmt: skip


@cache
def clip(seed: int = 0, names: str = "known", stretched: bool = False, n_joints: int = len(_JOINTS)) -> Clip:
    """A small clip of a person; ``names``: "known" joint names, or "other" ones that no rig has."""
    rng = np.random.default_rng(seed)
    rows = _JOINTS[:n_joints]
    skeleton = Skeleton(
        tuple(name if names == "known" else f"j{n:02}" for n, (name, _, _) in enumerate(rows)),
        np.array([parent for _, parent, _ in rows]),
        np.array([offset for _, _, offset in rows]),
        (EndSite(3, np.array([0.0, 18.0, 0.0])),),
    )
    waves = 0.4 * rng.normal(size=(1, n_joints, 3)) * np.sin(np.linspace(0.0, 3.0, N_REPORTED))[:, None, None]
    roots = np.array([0.0, 95.0, 0.0]) + 0.1 * rng.normal(size=(N_REPORTED, 3))
    lengths = skeleton.offsets * (1.0 + 0.05 * rng.random((N_REPORTED, 1, 1))) if stretched else None
    return Clip(skeleton, rotation.exp(waves), roots, 30.0, f"CLIP{seed}", lengths)


def use_clip(read: Clip) -> None:
    """A splice of a clip with a known one, and what is asked of its rig before."""
    rig = rig_info(read.skeleton)
    kinematics.forward(read)
    _ = rig.roles, rig.sizes
    if rig.has_arms:
        ss.splice([clip(), read], CLASSICAL)
    else:
        ss.splice([read, read], ss.SpliceOptions("ends", "hermite", "tempo"))


def _put_as(name: str) -> Callable[[bytes, Path], Path]:
    def put(content: bytes, folder: Path) -> Path:
        path = folder / name
        path.write_bytes(content)
        return path

    return put


def _put_gltf(content: bytes, folder: Path) -> Path:
    suffix = ".gltf" if content[:4] != b"glTF" else ".vrma" if b"VRMC_vrm_animation" in content else ".glb"
    return _put_as(f"case{suffix}")(content, folder)


def _put_folder(content: bytes, folder: Path) -> Path:
    path = folder / "case"
    shutil.rmtree(path, ignore_errors=True)
    path.mkdir()
    try:
        files = unpacked(content)
    except Exception:  # bytes that libFuzzer has cut: not what is tested here
        files = {}
    for name, inner in files.items():
        (path / Path(name).name).write_bytes(inner)
    return path


def _clip_seeds(suffix: str) -> list[bytes]:
    clips = [clip(), clip(1, stretched=True), clip(2, "other")]
    if suffix == ".npz":  # with channels, as of a file that was read
        clips.append(formats.parse(formats.encode(clip(), "a.bvh"), "a.bvh"))
    return [formats.encode(one, f"a{suffix}") for one in clips]


def _unpacked_npz(content: bytes) -> int:
    try:
        return len(content) + sum(map(len, unpacked(content).values()))
    except Exception:  # whatever zipfile says of a damaged archive, nothing was unpacked
        return len(content)


def _gltf_seeds() -> list[bytes]:
    """A .vrma, a .glb with a skin and one without, and a .gltf with its buffer inside."""
    whole, vrma = (formats.encode(clip(n_joints=n), "a.vrma") for n in (len(_JOINTS), 5))
    size = struct.unpack_from("<I", vrma, 12)[0]
    document, blob = json.loads(vrma[20 : 20 + size]), vrma[28 + size :]
    for key in ("extensions", "extensionsUsed"):
        document.pop(key, None)
    bare = json.dumps(document).encode()
    inside = json.loads(bare)
    inside["buffers"][0]["uri"] = "data:application/octet-stream;base64," + base64.b64encode(blob).decode()
    n_nodes = len(document["nodes"])
    matrices = np.tile(np.eye(4, dtype="<f4").ravel(), n_nodes).tobytes()
    views, accessors = document["bufferViews"], document["accessors"]
    views.append({"buffer": 0, "byteOffset": len(blob), "byteLength": len(matrices)})
    accessors.append({"bufferView": len(views) - 1, "componentType": 5126, "count": n_nodes, "type": "MAT4"})
    document["buffers"][0]["byteLength"] = len(blob) + len(matrices)
    document["skins"] = [{"joints": list(range(n_nodes)), "inverseBindMatrices": len(accessors) - 1, "skeleton": 0}]
    skinned = [(b"JSON", json.dumps(document).encode()), (b"BIN\0", blob + matrices)]
    return [
        whole,
        joined_chunks([(b"JSON", bare), (b"BIN\0", blob)]),
        joined_chunks(skinned),
        json.dumps(inside).encode(),
    ]


def _mutate_gltf(content: bytes, rng: random.Random) -> bytes:
    mutate = fuzz_clips.of_glb if content[:4] == b"glTF" else fuzz_clips.of_gltf
    return mutate(content, rng)


@cache
def _lexicon_seeds() -> list[bytes]:
    import tempfile

    seeds = []
    with tempfile.TemporaryDirectory() as folder:
        for compact in (False, True):
            path = Path(folder) / f"words-{compact}"
            with lexicon.building(path, compact=compact) as builder:
                builder.add(clip(0), "HELLO", synonyms=["HI"], signer="A", source="book", checked=True)
                builder.add(clip(1, stretched=True), "HOUSE")
                builder.add(clip(2), "fs-A")
                builder.add(clip(3, "other"), "TREE")
            seeds.append(packed({name: (path / name).read_bytes() for name in ("index.sqlite", "frames.bin")}))
    return seeds


def _use_lexicon(words: lexicon.Lexicon) -> None:
    """What `lexicon list`, `lexicon check` and `sentence` do."""
    with words:
        from signsplice.cli.lexicon import _facts, _line

        for entry in words.entries():
            json.dumps(_facts(entry), ensure_ascii=False).encode()
            _line(entry).encode()
        for fault in words.faults():
            check_message(" ".join(fault.splitlines()), "")
        words.search("h")
        for gloss in itertools.islice(words, 100):
            use_clip(words.clip(gloss))
        sentence.parse("HELLO fs-A HI", words)


@cache
def _bundle_seeds() -> list[bytes]:
    """The bundle of the tests once, and often one of four small networks, which opens faster."""
    tiny = ROOT / "tests" / "golden" / "tiny_bundle"
    files = {path.name: path.read_bytes() for path in sorted(tiny.iterdir())}
    described = json.loads(files["bundle.json"])
    small = {name: fuzz_networks.small(name) for name in ("word.onnx", "cut.onnx", "duration.onnx", "bridge.onnx")}
    described["files"] = {name: hashlib.sha256(content).hexdigest() for name, content in small.items()}
    small["bundle.json"] = json.dumps(described).encode()
    return [packed(files, compress=False), *[packed(small, compress=False)] * 15]


def _use_bundle(methods: Any) -> None:
    """A splice of two small clips by whatever networks there are."""
    chosen: dict[str, Any] = {"cutter": "pose-velocity", "transition": "hermite", "duration": "tempo"}
    for kind, table in (
        ("cutter", methods.cutters),
        ("transition", methods.transitions),
        ("duration", methods.durations),
    ):
        if table:
            chosen[kind] = next(iter(table.values()))
    ss.splice([clip(), clip(1)], ss.SpliceOptions(**chosen, avoid_collisions=False))


_SIGNS = b"""# two signs
MOTHER  hands=one
  source: thumb of the open hand taps the chin (Costello 1994)
  synonyms: MOM, MAMA
  X  shape=5 at=chin by=thumb off=3 palm=in fingers=up
  M  off=0 times=2
  H

BOOK  hands=symmetric kind=sign
  X  shape=B at=space-mid palm=in fingers=fwd shift=1,0,-2.5
  M  palm=up path=arc:up:4 for=0.4 head=nod trunk=fwd
  M  at=space-in path=circle:frontal:5:1.5 local=wiggle:20:2
  H

TABLE  hands=base
  X  shape=B at=base-back palm=down fingers=fwd w.shape=B w.at=space-low-mid w.palm=down w.fingers=in
  M  off=5 path=zigzag:up:3:2
  H
"""


def _use_signs(signs: Any) -> None:
    """The motion of the first sign that is read: each takes some 20 ms."""
    for sign in itertools.islice(signs.values(), 1):
        planner.isolated(sign)


def _roles_seeds() -> list[bytes]:
    roles = {"hips": 0, "spine": 1, "neck": 2, "head": 3, "leftUpperArm": 4, "leftLowerArm": 5, "leftHand": 6,
             "rightUpperArm": 7, "rightLowerArm": 8, "rightHand": 9}  # fmt: skip
    return [json.dumps({role: f"j{n:02}" for role, n in roles.items()}, indent=1).encode()]


def _report_seeds() -> list[bytes]:
    result = ss.splice([clip()[:7], clip()[2:7]], CLASSICAL)
    spans = [{"kind": "sign", "clip": 0, "name": "A", "source": [0, 5], "output": [0, 5]},
             {"kind": "transition", "clip": None, "name": None, "source": None, "output": [5, 8]},
             {"kind": "sign", "clip": 1, "name": "B", "source": [2, 6], "output": [8, N_REPORTED]}]  # fmt: skip
    made = {**reports.describe(result), "frames": N_REPORTED, "spans": spans, "warnings": ["a word is long"]}
    return [json.dumps(made, indent=2).encode()]


def _use_report(read: Any) -> None:
    """What `view` and `render` make of a report."""
    from signsplice.cli.files import _spans_of
    from signsplice.render.page import Mark, caption
    from signsplice.render.sheet import sheet_frames

    shown = scene.from_clip(clip(), read, ())
    json.dumps(reports.plain({"scenes": [shown], "live": False}), allow_nan=False).encode()
    marks = [Mark(*span) for span in _spans_of(read)]
    for frame in sheet_frames(N_REPORTED, marks):
        caption(marks, frame)[0].encode()


_GLOSSES = b"""file,gloss,synonyms,signer,source,checked,kind
hello.bvh,HELLO,HI;GOOD-DAY,A,"book, page 3",yes,sign
a.bvh,fs-A,,,,no,letter
sub/tree.bvh,TREE,,B,,,
"""


TARGETS = {
    target.name: target
    for target in (
        Target("bvh", lambda: _clip_seeds(".bvh"), fuzz_mutators.of_text, _put_as("case.bvh"), formats.load, use_clip),
        Target("npz", lambda: _clip_seeds(".npz"), fuzz_clips.of_npz, _put_as("case.npz"), formats.load, use_clip,
               _unpacked_npz),
        Target("gltf", _gltf_seeds, _mutate_gltf, _put_gltf, formats.load, use_clip),
        Target("lexicon", _lexicon_seeds, fuzz_folders.of_lexicon, _put_folder, lexicon.open, _use_lexicon,
               _unpacked_npz),
        Target("bundle", _bundle_seeds, fuzz_folders.of_bundle, _put_folder, open_learned, _use_bundle, _unpacked_npz),
        Target("signs", lambda: [_SIGNS], fuzz_mutators.of_text, _put_as("case.signs"), notation.read, _use_signs),
        Target("roles", _roles_seeds, fuzz_mutators.of_json, _put_as("case.json"), roles_files.read,
               lambda read: use_clip(roles_files.with_roles(clip(4, "other"), read))),
        Target("report", _report_seeds, fuzz_mutators.of_json, _put_as("case.json"),
               lambda path: reports.read(path, N_REPORTED), _use_report),
        Target("glosses", lambda: [_GLOSSES], fuzz_mutators.of_text, _put_as("glosses.csv"), glosses.read,
               lambda _: None),
    )
}  # fmt: skip
"""Name -> what is fuzzed."""
