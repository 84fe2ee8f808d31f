"""The page's own fit of motion to avatars, run by Node: its hands are where Python's retargeting puts them.

``test_hands_are_where_python_puts_them`` bounds the difference of the two; the other tests say where one would begin.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import avatars
import signsplice as ss
from browsing import CHROMIUM, VIEWER
from known_rigs import RIGS, skeleton_of
from signsplice.body.capsules import build_capsules
from signsplice.body.retarget import retarget
from signsplice.formats.avatar import read_avatar
from signsplice.formats.gltf_writer import in_front
from signsplice.lexicon import open_shipped_lexicon
from signsplice.motion import Clip, FloatArray, Skeleton, kinematics, rotation
from signsplice.rig.align import copy_rotations, reference
from signsplice.rig.info import rig_info
from signsplice.service import scene
from signsplice.service.scene import fit_source

CASES = [
    ("NAME", "narrow"),
    ("MY", "broad"),
    ("MOTHER", "big head"),
    ("FAMILY", "narrow"),
    ("FAMILY", "broad"),
    ("MY", "no chest"),
]
SENTENCES = [("HELLO MY NAME", "narrow"), ("HELLO MY NAME", "big head")]
FAR = ("HAT", "too short")
MOST_M = 0.002
"""Bound of the difference, m. On 22 lines and bodies, on one machine, it was 0.46 mm at most."""
_NUMBER = re.compile(r"(?<![\w.])\d+(?:\.\d+(?:e-?\d+)?|e-?\d+)")

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        shutil.which("node") is None or not (VIEWER / "node_modules").is_dir(),
        reason="no node, or viewer/node_modules is not installed",
    ),
]


@lru_cache
def signed(line: str) -> Clip:
    """The line signed, facing +Z."""
    if " " not in line:
        return in_front(open_shipped_lexicon().clip(line))
    words = [open_shipped_lexicon().clip(gloss) for gloss in line.split()]
    return in_front(ss.splice(words, ss.SpliceOptions(cutter="ends", transition="hermite")).clip)


def made(folder: Path, name: str) -> Path:
    """The file of a body of ``avatars.BODIES``: one as VRM 0.x, one whose arms hang at rest. "too short": with arms
    that reach no face; "no chest": whose mesh hangs on a joint that has no role.
    """
    path = folder / f"{name}.vrm"
    if not path.exists():
        avatar = avatars.body("narrow" if name in ("too short", "no chest") else name)
        joints = rig_info(avatar).roles.joints
        # Joints of other names: those of one rig are matched by name, and their rest poses are taken for the same.
        names = tuple(joint.replace("mixamorig:", "J_") for joint in avatar.names)
        avatar = replace(avatar, names=names, roles={role: names[joint] for role, joint in joints.items()})
        offsets = np.array(avatar.offsets)
        if name == "too short":
            offsets[[joints[side + role] for side in ("left", "right") for role in ("LowerArm", "Hand")]] *= 0.45
        if name == "big head":
            for side, turn in (("left", -0.6), ("right", 0.6)):
                arm = kinematics.subtree(avatar, joints[f"{side}UpperArm"])[1:]
                offsets[arm] = rotation.rotate(rotation.exp([0.1, 0.0, turn]), offsets[arm])
        avatar = replace(avatar, offsets=offsets)
        if name in ("too short", "big head"):
            avatar = replace(avatar, body=build_capsules(avatar, avatars.BODIES["big head"].shape))
        named = {
            role: joint for role, joint in (avatar.roles or {}).items() if (name, role) != ("no chest", "upperChest")
        }
        avatars.write(path, avatar, avatars.tubes(avatar), "0.x" if name == "broad" else "1.0", roles=named)
    return path


def run(folder: Path, cases: list[tuple[str, str]], *flags: str) -> list[dict[str, Any]]:
    """What ``fit.mjs`` computes for lines and bodies."""
    given = [
        {"avatar": str(made(folder, body)), "scene": scene.from_clip(signed(line), None, ["vrma"])}
        for line, body in cases
    ]
    done = checked(folder, given, *flags)
    assert done.returncode == 0, done.stderr[-3000:]
    return [json.loads(line) for line in done.stdout.splitlines()]


def checked(folder: Path, given: list[dict[str, Any]], *flags: str) -> subprocess.CompletedProcess[str]:
    """What ``fit.mjs`` prints for files of avatars and scenes."""
    (folder / "cases.json").write_text(json.dumps(given))
    command = ["node", str(VIEWER / "checks" / "fit.mjs"), *flags, str(folder / "cases.json")]
    env = {**os.environ, "CHROMIUM": str(CHROMIUM)}
    return subprocess.run(command, capture_output=True, text=True, timeout=300, env=env)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("avatars")


@pytest.fixture(scope="module")
def page(folder: Path) -> Mapping[tuple[str, str], dict[str, Any]]:
    """What the page makes of each line and body, in Node, and the avatars as Python reads them."""
    cases = [*CASES, *SENTENCES, FAR]
    found = run(folder, cases)
    of = {case: read_avatar(made(folder, case[1])) for case in cases}
    return {case: {**one, "avatar": of[case]} for case, one in zip(cases, found, strict=True)}


def hands(clip: Clip, points: list[str]) -> FloatArray:
    """Wrists and fingertips (T, P, 3) of an avatar from the middle of its shoulders, m."""
    joints, offsets = rig_info(clip.skeleton).roles.joints, clip.skeleton.offsets
    global_rotations, positions = kinematics.forward(clip)
    out = positions[:, [joints[name] for name in points]]
    for k, name in enumerate(points):
        if name.endswith("Distal"):  # a fingertip lies 0.8 of the phalanx before beyond its last joint
            out[:, k] += 0.8 * global_rotations[:, joints[name]] @ offsets[joints[name]]
    return np.asarray(out - positions[:, [joints["leftUpperArm"], joints["rightUpperArm"]]].mean(axis=1, keepdims=True))


def test_hands_are_where_python_puts_them(page: Mapping[tuple[str, str], dict[str, Any]]) -> None:
    for (line, body), seen in page.items():
        clip, points = signed(line), seen["points"]
        fitted = hands(retarget(clip, seen["avatar"]).clip, points)
        away = np.linalg.norm(np.array(seen["hands"]) - fitted, axis=-1)
        assert away.max() < MOST_M, f"{line} on {body}: {1e3 * away.max():.2f} mm"
        copied = hands(copy_rotations(clip, reference(still(seen["avatar"])))[0], points)
        assert np.linalg.norm(copied - fitted, axis=-1).max() > 0.02, "the fit moves hands by centimetres"


@pytest.mark.parametrize("form", ["vrma", "glb"])
def test_a_file_alone_is_fitted_as_python_fits_it(folder: Path, form: str) -> None:
    """Without the body of the signer, which a service would send."""
    cases = [("MY", "broad"), ("HELLO MY NAME", "narrow")]
    given = [
        {"avatar": str(made(folder, body)), "scene": {**scene.from_clip(signed(line), None, [form]), "fit": None}}
        for line, body in cases
    ]
    done = checked(folder, given)
    assert done.returncode == 0, done.stderr[-3000:]
    for (line, body), printed in zip(cases, done.stdout.splitlines(), strict=True):
        seen = json.loads(printed)
        ss.save(signed(line), folder / f"alone.{form}")
        fitted = retarget(ss.load(folder / f"alone.{form}"), read_avatar(made(folder, body))).clip
        away = np.linalg.norm(np.array(seen["hands"]) - hands(fitted, seen["points"]), axis=-1)
        assert away.max() < MOST_M, f"{line} on {body}: {1e3 * away.max():.2f} mm"


def test_bones_of_avatars_without_a_vrm_part_are_known_by_name(tmp_path: Path) -> None:
    named = {"mixamo", "vrm", "unity", "vroid", "unreal", "rigify"}  # as docs/player.md says
    rigs = {
        rig: skeleton_of(*chains)
        for rig, (convention, chains) in RIGS.items()
        if convention in named and rig != "rigify in three.js"
    }
    (tmp_path / "rigs.json").write_text(json.dumps({rig: skeleton.names for rig, (skeleton, _) in rigs.items()}))
    command = ["node", str(VIEWER / "checks/roles.mjs"), str(tmp_path / "rigs.json")]
    found = json.loads(subprocess.run(command, capture_output=True, text=True, check=True, timeout=300).stdout)
    for rig, (_, roles) in rigs.items():
        body = {role: name for role, name in roles.items() if role not in ("jaw", "leftEye", "rightEye")}
        assert found[rig] == body, rig
    assert len(rigs) > 12


def test_numbers_of_the_fit_stand_in_python_alone() -> None:
    """The page's fit has them from the generated ``constants.ts``, but for halves, guards against division by zero and
    cm^2 in a m^2.
    """
    for path in (VIEWER / "src/fit").glob("*.ts"):
        if path.name != "constants.ts":
            code = re.sub(r"/\*.*?\*/|//[^\n]*", "", path.read_text(encoding="utf-8"), flags=re.S)
            assert set(_NUMBER.findall(code)) <= {"0.5", "1e-9", "1e-12", "1e4"}, path.name


def test_places_beyond_reach_are_told_as_python_tells_them(page: Mapping[tuple[str, str], dict[str, Any]]) -> None:
    (warning,) = retarget(signed(FAR[0]), page[FAR]["avatar"]).warnings
    left, right = page[FAR]["beyond"]
    assert left == 0.0
    assert f"right hand lie up to {100.0 * right:.0f} cm beyond" in warning
    assert page[CASES[0]]["beyond"] == [0.0, 0.0]


@pytest.mark.parametrize("case", CASES[:3])
def test_the_page_finds_the_same_body_in_a_mesh(
    page: Mapping[tuple[str, str], dict[str, Any]], case: tuple[str, str]
) -> None:
    ours = {one["key"]: one for one in fit_source(still(page[case]["avatar"]))["capsules"]}  # type: ignore[index]
    theirs = {one["key"]: one for one in page[case]["capsules"]}
    assert theirs.keys() == ours.keys()
    for key, one in ours.items():
        assert [theirs[key][name] for name in ("bone", "region", "side")] == [one["bone"], one["region"], one["side"]]
        for name in ("start", "end", "radii"):
            np.testing.assert_allclose(theirs[key][name], one[name], atol=1e-3, err_msg=f"{key} {name}")


@pytest.mark.parametrize("loop", [[[1], [0, "mesh"]], [[1], [0]], [["mesh"], ["mesh"]]])
def test_nodes_that_are_no_trees_are_refused(folder: Path, tmp_path: Path, loop: list[list[Any]]) -> None:
    """Nodes outside the scene, in a loop, or two above one mesh."""
    content = made(folder, "narrow").read_bytes()
    size = int.from_bytes(content[12:16], "little")
    document = json.loads(content[20 : 20 + size])
    n = len(document["nodes"])
    mesh = next(node for node, fields in enumerate(document["nodes"]) if "mesh" in fields)
    document["nodes"] += [{"children": [mesh if c == "mesh" else n + c for c in children]} for children in loop]
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    body = len(text).to_bytes(4, "little") + b"JSON" + text + content[20 + size :]
    (tmp_path / "a.vrm").write_bytes(content[:8] + (12 + len(body)).to_bytes(4, "little") + body)
    shown = scene.from_clip(signed("NAME"), None, ["vrma"])
    done = checked(tmp_path, [{"avatar": str(tmp_path / "a.vrm"), "scene": shown}])
    assert done.returncode != 0
    assert any(words in done.stderr for words in ("is its own ancestor", "is a child of node")), done.stderr[-500:]


def still(skeleton: Skeleton) -> Clip:
    return Clip(skeleton, np.tile(rotation.IDENTITY, (2, len(skeleton), 1)), np.zeros((2, 3)), 30.0)


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium")
def test_chromium_puts_hands_where_node_does(folder: Path, page: Mapping[tuple[str, str], dict[str, Any]]) -> None:
    (seen,) = run(folder, CASES[:1], "--chromium")
    np.testing.assert_allclose(seen["hands"], page[CASES[0]]["hands"], atol=1e-6)
