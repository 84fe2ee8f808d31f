"""The viewer in a real, headless Chromium: used as a person uses it, watched for errors and foreign requests."""

from __future__ import annotations

import itertools
import json
import os
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from serving import serving
from signsplice.formats import bvh, gltf, load
from signsplice.motion import kinematics
from signsplice.motion.clip import Clip
from signsplice.motion.rotation import inverse, multiply
from signsplice.rig.roles import find_roles
from signsplice.rig.t_pose import t_pose_rotations
from signsplice.service import page

VIEWER = Path(__file__).resolve().parents[2] / "viewer"
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)

pytestmark = pytest.mark.skipif(
    CHROMIUM is None or not (VIEWER / "node_modules").is_dir() or not page.BUILT.is_dir(),
    reason="no Chromium, or the viewer is not built (make viewer)",
)


def drive(script: str, *arguments: str | Path) -> dict[str, Any]:
    done = subprocess.run(
        ["node", str(VIEWER / "checks" / script), *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=300,
        env={**os.environ, "CHROMIUM": str(CHROMIUM)},
    )
    assert done.returncode == 0, done.stderr[-3000:]
    told: dict[str, Any] = json.loads(done.stdout)
    return told


def write_avatar(clip: Clip, path: Path) -> None:
    """A VRM 1.0 avatar: the clip's mannequin in a T-pose, its bones named."""
    turns = t_pose_rotations(clip.skeleton)
    local = np.array([
        turn if parent < 0 else multiply(inverse(turns[parent]), turn)
        for turn, parent in zip(turns, clip.skeleton.parents, strict=True)
    ])  # fmt: skip
    made = gltf.person(replace(clip[:2], local_rotations=np.stack([local, local]), channels=None))
    nodes = {node.name: number for number, node in enumerate(made.nodes)}
    joints = find_roles(clip.skeleton).joints
    bones = {role: {"node": nodes[clip.skeleton.names[joint]]} for role, joint in joints.items()}
    meta = {"name": "toy", "authors": ["signsplice"], "licenseUrl": "https://vrm.dev/licenses/1.0/"}
    made.extensionsUsed.append("VRMC_vrm")
    made.extensions["VRMC_vrm"] = {"specVersion": "1.0", "meta": meta, "humanoid": {"humanBones": bones}}
    path.write_bytes(b"".join(made.save_to_bytes()))


@pytest.fixture(scope="module")
def told(tmp_path_factory: pytest.TempPathFactory, words: dict[str, Clip]) -> dict[str, Any]:
    out = tmp_path_factory.mktemp("viewer")
    for gloss in ("DEAF", "SIGN"):
        bvh.write(words[gloss], out / f"{gloss}.bvh")
    write_avatar(words["DEAF"], out / "toy.vrm")
    bvh.write(words["DEAF"][30:36], out / "short.bvh")
    with serving("serve") as address:
        return drive(
            "page.mjs", address, out, *(out / name for name in ("DEAF.bvh", "SIGN.bvh", "toy.vrm", "short.bvh"))
        )


def test_the_page_comes_up_and_signs(told: dict[str, Any]) -> None:
    assert told["greeted"] == ["HELLO", "MY", "NAME"]
    assert told["plays"] == "❚❚"
    assert told["runs"][1] > told["runs"][0]
    assert min(told["drawn"]) > 0.1


def test_nothing_goes_wrong_and_no_other_host_is_asked(told: dict[str, Any]) -> None:
    assert told["faults"] == []
    assert len(told["hosts"]) == 1
    assert told["hosts"][0].startswith("127.0.0.1:")


def test_a_typed_sentence_is_completed_and_plays(told: dict[str, Any]) -> None:
    assert told["suggested"][0].startswith("THANK-YOU")
    assert told["active"] == "suggestion-0"
    assert told["typed"] == "fs-AB THANK-YOU "
    assert told["typedSigns"] == ["fs-A", "fs-B", "THANK-YOU"]
    assert told["typedPlays"] == "❚❚"
    assert told["caption"] == "AB"
    assert told["letter"] == ["A"]


def test_an_unknown_gloss_is_said_and_nothing_is_lost(told: dict[str, Any]) -> None:
    assert "ÅÄÖ§" in told["unknown"]
    assert told["kept"] == told["typedSigns"]
    assert all("422" in line for line in told["expected"])


def test_dropped_files_are_spliced_and_shown(told: dict[str, Any]) -> None:
    assert told["dropped"] == ["DEAF", "SIGN"]
    assert told["alert"] is True


def test_a_seam_is_looped(told: dict[str, Any]) -> None:
    start, end = told["loop"]["ends"]
    seen = told["loop"]["seen"]
    assert told["loop"]["chosen"] == "0"
    assert told["everything"] == "all"
    assert told["unlooped"] == ""
    assert min(seen) >= start - 16
    assert max(seen) <= end + 16
    assert any(a > b for a, b in itertools.pairwise(seen)), "never came back"
    assert any(start <= frame < end for frame in seen)


def test_keys_dials_and_a_second_method(told: dict[str, Any]) -> None:
    assert (told["on"], told["back"]) == (11, 9)
    assert told["mirrored"] == told["view"] == "true"
    assert told["faster"][1] < 0.75 * told["faster"][0]
    assert told["beside"]["methods"] == ["learned", "slerp"]
    assert min(told["beside"]["drawn"]) > 0.1


def test_what_is_taken_away_is_the_animation(told: dict[str, Any]) -> None:
    report = json.loads(Path(told["saved"]["report"]).read_text())
    as_bvh, as_glb, as_vrma = (load(told["saved"][form]) for form in ("bvh", "glb", "vrma"))
    assert report["frames"] == len(as_bvh) == len(as_glb) == len(as_vrma)
    assert [span["name"] for span in report["spans"] if span["kind"] == "sign"] == ["HELLO", "DEAF"]
    heights = [
        np.ptp(kinematics.forward(clip)[1][:, :, 1], axis=1).mean() * unit
        for clip, unit in ((as_bvh, 0.01), (as_glb, 1.0))
    ]
    assert heights[0] == pytest.approx(heights[1], rel=1e-4)


def test_an_avatar_takes_the_mannequins_place(told: dict[str, Any]) -> None:
    assert told["junk"].startswith("junk.vrm is no VRM avatar")
    assert told["avatar"]["alert"] == ""
    assert min(told["avatar"]["drawn"]) > 0.1


def test_a_film_has_every_frame(told: dict[str, Any]) -> None:
    film = Path(told["film"])
    assert film.suffix in (".mp4", ".webm")
    assert film.stat().st_size > 10_000
    if shutil.which("ffprobe") is None:
        pytest.skip("no ffprobe to look into it")
    shown = "stream=width,height,nb_read_frames"
    call = ["ffprobe", "-v", "error", "-count_frames", "-show_entries", shown, "-of", "csv=p=0", str(film)]
    said = subprocess.run(call, capture_output=True, text=True, check=True).stdout
    assert said.strip() == "1920,1080,6"


def test_rules_of_accessibility_are_kept(told: dict[str, Any]) -> None:
    assert told["axe"] == []


def test_a_phone_in_chinese(told: dict[str, Any]) -> None:
    phone = told["phone"]
    assert phone["language"] == "zh-CN"
    assert phone["sign"] == "打手语"
    assert phone["wide"] <= 0, "the page is wider than the phone"
    assert phone["small"] == [], "too small for a finger"
    assert phone["signs"] == ["DEAF", "FRIEND"]
    assert min(phone["drawn"]) > 0.1
    assert phone["faults"] == []


def test_a_saved_page_opens_from_disk_without_a_network(told: dict[str, Any]) -> None:
    disk = told["fromDisk"]
    assert disk["signs"] == ["HELLO", "DEAF"]
    assert disk["sides"] == ["learned", "slerp"]
    assert disk["run"][1] > disk["run"][0]
    assert min(disk["drawn"]) > 0.1
    assert disk["live"] is False
    assert disk["faults"] == []
    assert disk["hosts"] == []


def test_the_page_of_routes_needs_no_other_host(told: dict[str, Any]) -> None:
    assert told["docs"]["routes"] == 6
    assert told["docs"]["hosts"] == told["hosts"]
    assert told["docs"]["faults"] == []
