"""The page's own fit of motion to avatars, run by Node: its hands are where Python's retargeting puts them."""

from __future__ import annotations

import json
import shutil
import subprocess
from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import signsplice as ss
from avatars import write_bones
from signsplice.body.retarget import retarget
from signsplice.evaluation.stretched_bodies import BODIES, stretched
from signsplice.formats.gltf_writer import in_front
from signsplice.lexicon import shipped
from signsplice.motion import kinematics, rotation
from signsplice.motion.clip import Clip, Skeleton
from signsplice.rig.align import copy_rotations, reference
from signsplice.rig.info import rig_info
from signsplice.service import scene
from signsplice.service.fitting import fit_source

VIEWER = Path(__file__).resolve().parents[2] / "viewer"
CASES = [(gloss, body) for body in ("narrow", "child", "broad") for gloss in ("NAME", "MOTHER")]
SENTENCE = ("HELLO MY NAME", "chibi")
FAR = ("HAT", "far too short")

pytestmark = pytest.mark.skipif(
    shutil.which("node") is None or not (VIEWER / "node_modules").is_dir(),
    reason="no node, or viewer/node_modules is not installed",
)


@lru_cache
def signed(line: str) -> Clip:
    """The line signed, facing +Z."""
    if " " not in line:
        return in_front(shipped().clip(line))
    words = [shipped().clip(gloss) for gloss in line.split()]
    return in_front(ss.splice(words, ss.SpliceOptions(cutter="ends", transition="hermite")).clip)


def other_body(skeleton: Skeleton, name: str) -> Skeleton:
    """A body of ``BODIES``, fingers without end sites, which avatars do not have."""
    if name == "far too short":
        offsets = np.array(skeleton.offsets)
        for role in ("LowerArm", "Hand"):
            offsets[[rig_info(skeleton).roles.joints[side + role] for side in ("left", "right")]] *= 0.45
        return replace(skeleton, offsets=offsets, end_sites=())
    return replace(stretched(skeleton, BODIES[name]), end_sites=())


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Mapping[tuple[str, str], dict[str, Any]]:
    """What ``fit.mjs`` computes for each line and body."""
    out = tmp_path_factory.mktemp("avatars")
    cases = []
    for line, body in (*CASES, SENTENCE, FAR):
        clip = signed(line)
        avatar = out / f"{body}.vrm"
        if not avatar.exists():
            write_bones(other_body(clip.skeleton, body), avatar)
        cases.append({"avatar": str(avatar), "scene": scene.from_clip(clip, None, ["vrma"])})
    (out / "cases.json").write_text(json.dumps(cases))
    command = ["node", str(VIEWER / "checks" / "fit.mjs"), str(out / "cases.json")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr[-3000:]
    found = map(json.loads, done.stdout.splitlines())
    return dict(zip((*CASES, SENTENCE, FAR), found, strict=True))


def hands(clip: Clip, points: list[str]) -> rotation.Float:
    """Wrists and fingertips (T, P, 3) from the middle of the shoulders, m."""
    info, parents = rig_info(clip.skeleton), clip.skeleton.parents
    joints, rest = info.roles.joints, info.t_pose
    global_rotations, positions = kinematics.forward(clip)
    out = positions[:, [joints[name] for name in points]]
    for k, name in enumerate(points):
        if name.endswith("Distal"):  # a fingertip lies 0.8 of the phalanx before beyond its last joint
            joint = joints[name]
            bone = rotation.rotate(rotation.inverse(rest.rotations[joint]), rest.positions[joint] - rest.positions[parents[joint]])
            out[:, k] += 0.8 * global_rotations[:, joint] @ bone
    middle = positions[:, [joints["leftUpperArm"], joints["rightUpperArm"]]].mean(axis=1, keepdims=True)
    return np.asarray(info.sizes.unit.metres * (out - middle))


@pytest.mark.parametrize(("line", "body"), [*CASES, SENTENCE])
def test_hands_are_where_python_puts_them(
    page: Mapping[tuple[str, str], dict[str, Any]], line: str, body: str
) -> None:
    clip, seen = signed(line), page[line, body]
    onto = other_body(clip.skeleton, body)
    fitted = hands(retarget(clip, onto).clip, seen["points"])
    away = np.linalg.norm(np.array(seen["fitted"]) - fitted, axis=-1)
    assert away.max() < 0.005, "5 mm"
    copied = copy_rotations(clip, reference(replace(clip, skeleton=onto, channels=None)))[0]
    alone = np.array(seen["rotations"])
    np.testing.assert_allclose(alone, hands(copied, seen["points"]), atol=1e-4)
    assert np.linalg.norm(alone - fitted, axis=-1).max() > 0.02, "the fit moves hands by centimetres"


def test_places_beyond_reach_are_told_as_python_tells_them(page: Mapping[tuple[str, str], dict[str, Any]]) -> None:
    clip = signed(FAR[0])
    (warning,) = retarget(clip, other_body(clip.skeleton, FAR[1])).warnings
    left, right = page[FAR]["beyond"]
    assert left == 0.0
    assert f"right hand lie up to {100.0 * right:.0f} cm beyond" in warning
    assert page[CASES[0]]["beyond"] == [0.0, 0.0]


def test_the_page_builds_the_usual_body(page: Mapping[tuple[str, str], dict[str, Any]]) -> None:
    skeleton = other_body(signed("NAME").skeleton, "narrow")
    still = replace(signed("NAME")[:2], skeleton=skeleton, channels=None)
    ours = {one["key"]: one for one in fit_source(still)["capsules"]}  # type: ignore[index]
    theirs = {one["key"]: one for one in page["NAME", "narrow"]["capsules"]}
    assert theirs.keys() == ours.keys()
    for key, one in ours.items():
        assert [theirs[key][name] for name in ("bone", "region", "side")] == [one["bone"], one["region"], one["side"]]
        for name in ("start", "end", "radii"):
            np.testing.assert_allclose(theirs[key][name], one[name], atol=1e-5, err_msg=f"{key} {name}")
