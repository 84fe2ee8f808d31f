"""Makes valid files of each kind that fuzzing starts from, anew in each run."""

from __future__ import annotations

import base64
import gzip
import hashlib
import io
import json
import struct
import tempfile
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

import fuzz_networks
import signsplice as ss
from fuzz_clips import join_chunks, pack
from signsplice import formats, lexicon
from signsplice.bulk import recipes
from signsplice.bulk.job import BulkOptions, prepare
from signsplice.bulk.shards import make_shard
from signsplice.lexicon.lexicon import SHIPPED
from signsplice.motion import Clip, EndSite, Skeleton, rotation
from signsplice.motion.face import ARKIT_CHANNELS, Face
from signsplice.signer import notation
from signsplice.splicing import report as reports
from signsplice_workshop.corpora.pairs import Recipe, write_pairs

ROOT = Path(__file__).resolve().parents[2]
CLASSICAL = ss.SpliceOptions("pose-velocity", "hermite", "tempo")
N_REPORTED = 12
"""Frames of the clip to which a fuzzed report belongs."""

_JOINTS = (
    ("Hips", -1, (0.0, 95.0, 0.0)), ("Spine", 0, (0.0, 20.0, 0.0)), ("Neck", 1, (0.0, 30.0, 0.0)),
    ("Head", 2, (0.0, 10.0, 0.0)), ("LeftArm", 1, (18.0, 26.0, 0.0)), ("LeftForeArm", 4, (28.0, 0.0, 0.0)),
    ("LeftHand", 5, (25.0, 0.0, 0.0)), ("RightArm", 1, (-18.0, 26.0, 0.0)), ("RightForeArm", 7, (-28.0, 0.0, 0.0)),
    ("RightHand", 8, (-25.0, 0.0, 0.0)), ("LeftUpLeg", 0, (10.0, -5.0, 0.0)), ("LeftLeg", 10, (0.0, -42.0, 0.0)),
    ("LeftFoot", 11, (0.0, -42.0, 0.0)), ("RightUpLeg", 0, (-10.0, -5.0, 0.0)), ("RightLeg", 13, (0.0, -42.0, 0.0)),
    ("RightFoot", 14, (0.0, -42.0, 0.0)),
)  # fmt: skip


@cache
def make_clip(seed: int = 0, names: str = "known", is_stretched: bool = False, n_joints: int = len(_JOINTS)) -> Clip:
    """Returns a small clip of a person; ``names``: "known" joint names, or "other" ones that no rig has."""
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
    lengths = skeleton.offsets * (1.0 + 0.05 * rng.random((N_REPORTED, 1, 1))) if is_stretched else None
    return Clip(skeleton, rotation.exp(waves), roots, 30.0, f"CLIP{seed}", lengths)


def with_face(plain: Clip) -> Clip:
    """Returns a clip with all of ARKit's coefficients."""
    return replace(plain, face=Face(ARKIT_CHANNELS, np.linspace(0.0, 1.0, 52 * len(plain)).reshape(-1, 52)))


def make_clip_seeds(suffix: str) -> list[bytes]:
    """Returns clips with known and other joint names, with bone lengths that change, with a face, and as of a file that
    was read.
    """
    clips = [make_clip(), make_clip(1, is_stretched=True), make_clip(2, "other")]
    if suffix == ".npz":  # with channels, as of a file that was read
        clips.append(with_face(make_clip(3)))
        clips.append(formats.parse(formats.encode(make_clip(), "a.bvh"), "a.bvh"))
    return [formats.encode(seed, f"a{suffix}") for seed in clips]


def make_smplx_seeds() -> list[bytes]:
    """Returns poses of SMPL-X as they are written, and in parts as others name them."""
    file_bytes = formats.encode(make_clip(), "a.smplx.npz")
    with np.load(io.BytesIO(file_bytes)) as stored:
        poses = stored["poses"].astype(np.float32)
    parts = io.BytesIO()
    np.savez(parts, global_orient=poses[:, :3], body_pose=poses[:, 3:66], left_hand_pose=poses[:, 75:120], fps=24)
    return [file_bytes, parts.getvalue()]


def make_gltf_seeds() -> list[bytes]:
    """Returns a .vrma, a .glb with a skin and one without, a .gltf with its buffer inside, and a .vrma with a face."""
    full_vrma, small_vrma = (formats.encode(make_clip(n_joints=n), "a.vrma") for n in (len(_JOINTS), 5))
    size = struct.unpack_from("<I", small_vrma, 12)[0]
    document, blob = json.loads(small_vrma[20 : 20 + size]), small_vrma[28 + size :]
    for key in ("extensions", "extensionsUsed"):
        document.pop(key, None)
    bare_document = json.dumps(document).encode()
    embedded = json.loads(bare_document)
    embedded["buffers"][0]["uri"] = "data:application/octet-stream;base64," + base64.b64encode(blob).decode()
    n_nodes = len(document["nodes"])
    matrices = np.tile(np.eye(4, dtype="<f4").ravel(), n_nodes).tobytes()
    views, accessors = document["bufferViews"], document["accessors"]
    views.append({"buffer": 0, "byteOffset": len(blob), "byteLength": len(matrices)})
    accessors.append({"bufferView": len(views) - 1, "componentType": 5126, "count": n_nodes, "type": "MAT4"})
    document["buffers"][0]["byteLength"] = len(blob) + len(matrices)
    document["skins"] = [{"joints": list(range(n_nodes)), "inverseBindMatrices": len(accessors) - 1, "skeleton": 0}]
    skinned = [(b"JSON", json.dumps(document).encode()), (b"BIN\0", blob + matrices)]
    return [
        full_vrma,
        join_chunks([(b"JSON", bare_document), (b"BIN\0", blob)]),
        join_chunks(skinned),
        json.dumps(embedded).encode(),
        formats.encode(with_face(make_clip()), "a.vrma"),
    ]


def make_fbx_seeds() -> list[bytes]:
    """Returns two binary files of Blender's exporter, and text files of versions 7 and 6."""
    folder = ROOT / "tests" / "formats" / "fbx"
    binary_files = [gzip.decompress(path.read_bytes()) for path in sorted(folder.glob("*.fbx.gz"))]
    return [*binary_files, *(path.read_bytes() for path in sorted(folder.glob("*.fbx")))]


@cache
def make_lexicon_seeds() -> list[bytes]:
    """Returns a lexicon in each form."""
    seeds = []
    with tempfile.TemporaryDirectory() as folder:
        for compact in (False, True):
            path = Path(folder) / f"words-{compact}"
            with lexicon.building(path, compact=compact) as builder:
                builder.add(make_clip(0), "HELLO", synonyms=["HI"], signer="A", source="book", checked=True)
                builder.add(make_clip(1, is_stretched=True), "HOUSE")
                builder.add(make_clip(2), "fs-A")
                builder.add(with_face(make_clip(3, "other")), "TREE")
            seeds.append(pack({name: (path / name).read_bytes() for name in ("index.sqlite", "frames.bin")}))
    return seeds


@cache
def make_bundle_seeds() -> list[bytes]:
    """Returns the bundle of the tests once, and often one of four small networks, which opens faster."""
    tiny = ROOT / "tests" / "golden" / "tiny_bundle"
    files = {path.name: path.read_bytes() for path in sorted(tiny.iterdir())}
    config = json.loads(files["bundle.json"])
    small_files = {name: fuzz_networks.make_network(name) for name in ("word.onnx", "cut.onnx", "bridge.onnx")}
    config["files"] = {name: hashlib.sha256(content).hexdigest() for name, content in small_files.items()}
    small_files["bundle.json"] = json.dumps(config).encode()
    return [pack(files, compress=False), *[pack(small_files, compress=False)] * 15]


SIGNS = b"""# two signs
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


def make_roles_seeds() -> list[bytes]:
    """Returns a roles file."""
    roles = {"hips": 0, "spine": 1, "neck": 2, "head": 3, "leftUpperArm": 4, "leftLowerArm": 5, "leftHand": 6,
             "rightUpperArm": 7, "rightLowerArm": 8, "rightHand": 9}  # fmt: skip
    return [json.dumps({role: f"j{n:02}" for role, n in roles.items()}, indent=1).encode()]


def make_report_seeds() -> list[bytes]:
    """Returns a report of two words."""
    result = ss.splice([make_clip()[:7], make_clip()[2:7]], CLASSICAL)
    spans = [{"kind": "sign", "clip": 0, "name": "A", "source": [0, 5], "output": [0, 5]},
             {"kind": "transition", "clip": None, "name": None, "source": None, "output": [5, 8]},
             {"kind": "sign", "clip": 1, "name": "B", "source": [2, 6], "output": [8, N_REPORTED]}]  # fmt: skip
    report = {**reports.describe(result), "frames": N_REPORTED, "spans": spans, "warnings": ["a word is long"]}
    return [json.dumps(report, indent=2).encode()]


GLOSSES = b"""file,gloss,synonyms,signer,source,checked,kind,owns
hello.bvh,HELLO,HI;GOOD-DAY,A,"book, page 3",yes,sign,right arm;head
a.bvh,fs-A,,,,no,letter,none
sub/tree.bvh,TREE,,B,,,,
"""


@cache
def make_shards_seeds() -> list[bytes]:
    """Returns folders of shards, with clips and without."""
    rows = [recipes.SentenceRecipe((gloss, "I"), cutter="ends", transition="hermite") for gloss in ("HELLO", "YES")]
    seeds = []
    with tempfile.TemporaryDirectory() as folder:
        for store in ("frames", "recipes"):
            output_folder = Path(folder) / store
            options = BulkOptions(str(SHIPPED), store=store, poses=False, shard_size=2)
            prepare(output_folder, options, lambda: [recipes.batch_of(rows)])
            (output_folder / "index").mkdir()
            make_shard(str(output_folder), 0, 8)
            files = {
                str(path.relative_to(output_folder)): path.read_bytes()
                for path in sorted(output_folder.rglob("*"))
                if path.is_file()
            }
            seeds.append(pack(files))
    return seeds


@cache
def make_pairs_seeds() -> list[bytes]:
    """Returns a corpus of the pairs of two short signs, with few frames."""
    signs = notation.parse(
        "".join(
            f"{gloss}  hands=one\n  source: none\n  X  shape={gloss} at=chin palm=in fingers=up\n  H\n\n"
            for gloss in "AB"
        )
    )
    with tempfile.TemporaryDirectory() as folder:
        output_folder = write_pairs(
            Recipe(tuple(signs.values()), fps=10.0, n_other=1), Path(folder) / "pairs", processes=1
        )
        return [pack({path.name: path.read_bytes() for path in sorted(output_folder.iterdir())})]


LINES = b"""hello, I deaf

thank you fs-anna
+ HELLO|YES  no?
"""
