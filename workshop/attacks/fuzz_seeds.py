"""Makes valid files of each kind that fuzzing starts from, anew in each run."""

from __future__ import annotations

import base64
import gzip
import hashlib
import io
import json
import pickle
import tempfile
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import onnx.parser
import pyarrow as pa
import pyarrow.parquet as pq
from scipy.spatial import ConvexHull

import avatars
import signsplice as ss
from fuzz_trees import join_glb, pack, split_glb
from signsplice import formats, lexicon
from signsplice.body.capsules import Avatar, BodyShape, MeshPart, build_capsules
from signsplice.bulk import recipes
from signsplice.bulk.job import BulkOptions, prepare
from signsplice.bulk.shards import make_shard
from signsplice.lexicon.lexicon import SHIPPED
from signsplice.motion import Clip, EndSite, Skeleton, kinematics, rotation
from signsplice.motion.face import ARKIT_CHANNELS, Face
from signsplice.rig.info import rig_info
from signsplice.signer import notation
from signsplice.splicing import report as reports
from signsplice.splicing.features import N_CONTEXT, N_FRAME, N_SEEN, N_TERMS, N_TOKEN
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


def read_seeds(name: str) -> list[bytes]:
    """Returns a file of the folder ``seeds``."""
    return [Path(__file__).with_name("seeds").joinpath(name).read_bytes()]


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


def make_pickle_seeds() -> list[bytes]:
    """Returns pickles of SMPL-X poses by name, in a dict of a dict, as one array, and as a dict a frame."""
    rng = np.random.default_rng(0)
    parts: dict[str, Any] = {"global_orient": (9, 3), "body_pose": (9, 63), "left_hand_pose": (9, 45)}
    arrays = {name: (0.1 * rng.normal(size=shape)).astype(np.float32) for name, shape in parts.items()}
    frames = [{name: values[n] for name, values in arrays.items()} for n in range(3)]
    values = (arrays | {"fps": 24}, {"smplx": arrays, "fps": 30.0}, {"smplx": rng.normal(size=(4, 182))}, frames)
    return [pickle.dumps(value, protocol) for value in values for protocol in (0, 2, 4)]


def make_array_seeds() -> list[bytes]:
    """Returns arrays of poses in rows of 182 and 322 numbers."""
    streams = [io.BytesIO(), io.BytesIO()]
    for stream, shape in zip(streams, ((4, 182), (3, 322)), strict=True):
        np.save(stream, np.linspace(-1.0, 1.0, np.prod(shape)).reshape(shape))
    return [stream.getvalue() for stream in streams]


def make_pose_seeds() -> list[bytes]:
    """Returns landmarks of another writer, and of a clip."""
    return [(ROOT / "tests" / "golden" / "pose_format.pose").read_bytes(), formats.encode(make_clip(), "a.pose")]


def make_landmarks_seeds() -> list[bytes]:
    """Returns a folder of landmarks with the table of spoken-to-signed."""
    head = "path,spoken_language,signed_language,start,end,words,glosses,priority"
    table = f"{head}\na.pose,de,gsg,0,0,hallo,HALLO,0\nb.pose,de,gsg,100,300,Haus,HAUS,1\n"
    clips = {f"{name}.pose": formats.encode(make_clip(n), "a.pose") for n, name in enumerate("ab")}
    return [pack({"index.csv": table.encode(), **clips})]


def make_gltf_seeds() -> list[bytes]:
    """Returns a .vrma, a .glb with a skin and one without, a .gltf with its buffer inside, and a .vrma with a face."""
    full_vrma, small_vrma = (formats.encode(make_clip(n_joints=n), "a.vrma") for n in (len(_JOINTS), 5))
    text, blob = split_glb(small_vrma).values()
    document = json.loads(text)
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
    return [
        full_vrma,
        join_glb({"0.json": bare_document, "1.bin": blob}),
        join_glb({"0.json": json.dumps(document).encode(), "1.bin": blob + matrices}),
        json.dumps(embedded).encode(),
        formats.encode(with_face(make_clip()), "a.vrma"),
    ]


def make_fbx_seeds() -> list[bytes]:
    """Returns two binary files of Blender's exporter, and text files of versions 7 and 6."""
    folder = ROOT / "tests" / "formats" / "fbx"
    binary_files = [gzip.decompress(path.read_bytes()) for path in sorted(folder.glob("*.fbx.gz"))]
    return [*binary_files, *(path.read_bytes() for path in sorted(folder.glob("*.fbx")))]


def make_avatar_seeds() -> list[bytes]:
    """Returns avatars as VRM 1.0, VRM 0.x and plain .glb: mostly a small one, and a body with fingers, which takes
    longer to read.
    """
    rest = make_clip().skeleton
    roles = {role: rest.names[joint] for role, joint in rig_info(rest).roles.joints.items()}
    plain = Avatar(rest.names, rest.parents, 0.01 * rest.offsets, roles=roles, label="small")
    small = replace(plain, body=build_capsules(plain, BodyShape()))
    with tempfile.TemporaryDirectory() as folder:
        return [
            avatars.write(Path(folder) / "a", avatar, [_make_mesh(avatar)], version, **options).read_bytes()
            for avatar, version, options in (
                (small, "1.0", {"hair": False}),
                (small, "0.x", {"hair": False, "weights": "u8"}),
                (small, "", {"sparse": True, "axes": False}),
                (avatars.body("broad"), "1.0", {"weights": "u16"}),
            )
        ]


def _make_mesh(avatar: Avatar) -> MeshPart:
    """Returns a coarse ball around every capsule, its halves at the capsule's ends, all as one part."""
    body, rest = avatar.body, kinematics.rest_positions(avatar)
    assert body is not None
    grid = np.stack(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3), -1).reshape(-1, 3)
    ball = grid[np.abs(grid).any(axis=1)]  # (26, 3)
    ball /= np.linalg.norm(ball, axis=1, keepdims=True)
    faces = ConvexHull(ball).simplices
    is_inward = np.linalg.det(ball[faces]) < 0.0
    faces[is_inward] = faces[is_inward][:, ::-1]
    halves = ball @ (body.ends - body.starts)[..., None] > 0.0  # (capsules, 26, 1)
    centres = np.where(halves, body.ends[:, None], body.starts[:, None]) + rest[body.joints][:, None]
    vertices = (centres + np.where(halves, body.radii[:, None, 1:], body.radii[:, None, :1]) * ball).reshape(-1, 3)
    triangles = np.concatenate([faces + n * len(ball) for n in range(len(body.joints))])
    joints, weights = np.zeros((len(vertices), 4), np.int64), np.tile([1.0, 0.0, 0.0, 0.0], (len(vertices), 1))
    joints[:, 0] = np.repeat(body.joints, len(ball))
    return MeshPart("Body_SKIN", (1.0, 0.8, 0.7), vertices, vertices, triangles, joints, weights)


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


_OPSET = '<ir_version: 8, opset_import: ["" : 17]>'
_NETWORKS = {
    "word.onnx": f"""{_OPSET} graph (float[1,t,{N_FRAME + 2}] tokens)
        => (float[1,t,4] states, float[1,4] leave, float[1,4] enter, float[1,t,5] phases)
        <int64[2] w = {{{N_FRAME + 2}, 4}}, int64[2] v = {{{N_FRAME + 2}, 5}}> {{
        w_all = ConstantOfShape <value: tensor = float[1] {{0.01}}> (w)
        v_all = ConstantOfShape <value: tensor = float[1] {{0.02}}> (v)
        states = MatMul (tokens, w_all)
        phases = MatMul (tokens, v_all)
        leave = ReduceMean <axes = [1], keepdims = 0> (states)
        enter = ReduceMax <axes = [1], keepdims = 0> (states) }}""",
    "cut.onnx": f"""{_OPSET} graph (float[1,t,4] before, float[1,4] leave, float[1,s,4] after, float[1,4] enter)
        => (float[1,t] left, float[1,s] entered) {{
        a = Mul (before, leave)
        b = Mul (after, enter)
        left = ReduceMean <axes = [2], keepdims = 0> (a)
        entered = ReduceMean <axes = [2], keepdims = 0> (b) }}""",
    "bridge.onnx": f"""{_OPSET} graph (float[b,{N_SEEN},{N_TOKEN}] tokens) => (float[b,{N_TERMS},8,3] turns)
        <int64[1] first = {{{N_CONTEXT}}}, int64[1] last = {{{N_CONTEXT + N_TERMS}}}, int64[1] axis = {{1}},
        int64[2] w = {{{N_TOKEN}, 24}}, int64[4] shape = {{0, 0, 8, 3}}> {{
        a = Slice (tokens, first, last, axis)
        w_all = ConstantOfShape <value: tensor = float[1] {{0.001}}> (w)
        c = MatMul (a, w_all)
        turns = Reshape (c, shape) }}""",
}
"""The smallest networks that a bundle can have."""


@cache
def make_bundle_seeds() -> list[bytes]:
    """Returns the bundle of the tests once, and often one of four small networks, which opens faster."""
    tiny = ROOT / "tests" / "golden" / "tiny_bundle"
    files = {path.name: path.read_bytes() for path in sorted(tiny.iterdir())}
    config = json.loads(files["bundle.json"])
    small_files = {name: onnx.parser.parse_model(text).SerializeToString() for name, text in _NETWORKS.items()}
    config["files"] = {name: hashlib.sha256(content).hexdigest() for name, content in small_files.items()}
    small_files["bundle.json"] = json.dumps(config).encode()
    return [pack(files, compress=False), *[pack(small_files, compress=False)] * 15]


def make_report_seeds() -> list[bytes]:
    """Returns a report of two words."""
    result = ss.splice([make_clip()[:7], make_clip()[2:7]], CLASSICAL)
    spans = [{"kind": "sign", "clip": 0, "name": "A", "source": [0, 5], "output": [0, 5]},
             {"kind": "transition", "clip": None, "name": None, "source": None, "output": [5, 8]},
             {"kind": "sign", "clip": 1, "name": "B", "source": [2, 6], "output": [8, N_REPORTED]}]  # fmt: skip
    report = {**reports.describe(result), "frames": N_REPORTED, "spans": spans, "warnings": ["a word is long"]}
    return [json.dumps(report, indent=2).encode()]


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
            paths = [path for path in sorted(output_folder.rglob("*")) if path.is_file()]
            seeds.append(pack({str(path.relative_to(output_folder)): path.read_bytes() for path in paths}))
    return seeds


@cache
def make_pairs_seeds() -> list[bytes]:
    """Returns a corpus of the pairs of two short signs, with few frames."""
    text = "{0}  hands=one\n  source: none\n  X  shape={0} at=chin palm=in fingers=up\n  H\n\n"
    recipe = Recipe(tuple(notation.parse(text.format("A") + text.format("B")).values()), fps=10.0, n_other=1)
    with tempfile.TemporaryDirectory() as folder:
        output_folder = write_pairs(recipe, Path(folder) / "pairs", processes=1)
        return [pack({path.name: path.read_bytes() for path in sorted(output_folder.iterdir())})]


_ROWS = (
    recipes.SentenceRecipe(("HELLO", "I"), sign_speed=1.25, transition_time="0.3", seed=7, cutter="pose-velocity"),
    recipes.SentenceRecipe(("fs-AB", "SIGN"), fps=60.0, tempo="natural", cutter="ends", transition="hermite",
                           spell=False),
    recipes.SentenceRecipe(("YES", "NO", "YES"), "standard", cutter="ends", transition="linear",
                           avoid_collisions=False),
)  # fmt: skip


def make_recipes_seeds() -> list[bytes]:
    """Returns a CSV table, and Parquet tables of our columns, of other types of them, and of glosses alone."""
    batch = recipes.batch_of(_ROWS)
    other_columns = {
        "glosses": [" HELLO  I", "YES"],
        "sign_speed": pa.array([1, 2], pa.int8()),
        "cutter": ["ends", "ends"],
        "tempo": pa.array([0.8, None], pa.float32()),
        "signer": pa.array(["", ""]).dictionary_encode(),
    }
    return [
        *read_seeds("recipes.csv"),
        _encode_table(pa.Table.from_batches([batch])),
        _encode_table(pa.table(other_columns), compression="zstd"),
        _encode_table(pa.table({"glosses": [["HELLO", "NO"]], "cutter": ["ends"]}), row_group_size=1),
    ]


def _encode_table(table: pa.Table, **options: Any) -> bytes:
    stream = io.BytesIO()
    pq.write_table(table, stream, **options)
    return stream.getvalue()


_SYNTH_TESTS = ROOT / "tests" / "synth"


def make_written_seeds() -> list[bytes]:
    """Returns gestural SiGML, a table of HamNoSys, and SiGML of HamNoSys with a face."""
    table = (_SYNTH_TESTS / "hamnosys_signs.csv").read_text(encoding="utf-8")
    names = table.splitlines()[100].split(",")[2].split()
    face = '<hnm_mouthpicture picture="ro:d"/><hnm_head tag="NO"/>'
    hns = "".join(f"<ham{name}/>\n" for name in names)
    parts = f"<hamnosys_nonmanual>{face}</hamnosys_nonmanual><hamnosys_manual>\n{hns}</hamnosys_manual>"
    sigml = f'<sigml><hns_sign gloss="A">{parts}</hns_sign></sigml>'
    return [(_SYNTH_TESTS / "written_signs.sigml").read_bytes(), table.encode(), sigml.encode()]
