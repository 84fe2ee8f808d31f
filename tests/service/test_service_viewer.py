"""The viewer in a headless Chromium, used as a person would, and watched for errors and requests to other hosts."""

from __future__ import annotations

import itertools
import json
import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import avatars
from serving import PATIENCE_S, serving
from signsplice.formats import load, save
from signsplice.motion import kinematics
from signsplice.motion.clip import Clip
from signsplice.service import page

VIEWER = Path(__file__).resolve().parents[2] / "viewer"
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        CHROMIUM is None or not (VIEWER / "node_modules").is_dir() or not page.BUILT.is_dir(),
        reason="no Chromium, or the viewer is not built (make viewer)",
    ),
]


def drive(script: str, *arguments: str | Path) -> dict[str, Any]:
    """What a script of ``viewer/checks`` prints."""
    done = subprocess.run(
        ["node", str(VIEWER / "checks" / script), *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=12 * PATIENCE_S,
        env={**os.environ, "CHROMIUM": str(CHROMIUM)},
    )
    assert done.returncode == 0, done.stderr[-3000:]
    result: dict[str, Any] = json.loads(done.stdout)
    return result


@pytest.fixture(scope="module")
def seen(tmp_path_factory: pytest.TempPathFactory, words: dict[str, Clip]) -> dict[str, Any]:
    """What ``page.mjs`` saw in the page."""
    out = tmp_path_factory.mktemp("viewer")
    for gloss in ("DEAF", "SIGN"):
        save(words[gloss], out / f"{gloss}.bvh")
    narrow = avatars.body("narrow")
    avatars.write(out / "toy.vrm", narrow, avatars.mannequin_parts(narrow), axes=False, hair=False)
    save(words["DEAF"][30:33], out / "short.bvh")
    with serving("serve") as address:
        return drive(
            "page.mjs", address, out, *(out / name for name in ("DEAF.bvh", "SIGN.bvh", "toy.vrm", "short.bvh"))
        )


def test_the_page_opens_and_signs(seen: dict[str, Any]) -> None:
    assert seen["firstSigns"] == ["HELLO", "MY", "NAME"]
    assert seen["playButton"] == "❚❚"
    assert seen["running"][1] > seen["running"][0]
    assert min(seen["drawn"]) > 0.1


def test_there_are_no_errors_and_no_requests_to_other_hosts(seen: dict[str, Any]) -> None:
    assert seen["faults"] == []
    assert len(seen["hosts"]) == 1
    assert seen["hosts"][0].startswith("127.0.0.1:")


def test_a_typed_sentence_is_completed_and_plays(seen: dict[str, Any]) -> None:
    assert seen["suggestions"][0].startswith("THANK-YOU")
    assert seen["activeSuggestion"] == "suggestion-0"
    assert seen["typed"] == "fs-AB THANK-YOU "
    assert seen["typedSigns"] == ["A", "B", "THANK-YOU"]
    assert seen["typedPlayButton"] == "❚❚"
    assert seen["caption"] == "AB"
    assert seen["letter"] == ["A"]


def test_an_unknown_gloss_is_reported_and_the_scene_stays(seen: dict[str, Any]) -> None:
    assert "ÅÄÖ§" in seen["unknown"]
    assert seen["keptSigns"] == seen["typedSigns"]
    assert all("422" in line for line in seen["expectedFaults"])


def test_dropped_files_are_spliced_and_shown(seen: dict[str, Any]) -> None:
    assert seen["droppedSigns"] == ["DEAF", "SIGN"]
    assert seen["alertIsHidden"] is True


def test_a_seam_is_looped(seen: dict[str, Any]) -> None:
    start, end = seen["loop"]["ends"]
    frames = seen["loop"]["seen"]
    assert seen["loop"]["chosen"] == "0"
    assert seen["everything"] == "all"
    assert seen["unlooped"] == ""
    assert min(frames) >= start - 16
    assert max(frames) <= end + 16
    assert any(a > b for a, b in itertools.pairwise(frames)), "did not start again"
    assert any(start <= frame < end for frame in frames)


def test_keys_dials_and_a_compared_method(seen: dict[str, Any]) -> None:
    assert (seen["forward"], seen["back"]) == (11, 9)
    assert seen["isMirrored"] == seen["handsView"] == "true"
    assert seen["lastFrames"][1] < 0.75 * seen["lastFrames"][0]
    assert seen["compared"]["methods"] == ["learned", "slerp"]
    assert min(seen["compared"]["drawn"]) > 0.1


def test_downloads_hold_the_animation(seen: dict[str, Any]) -> None:
    report = json.loads(Path(seen["saved"]["report"]).read_text())
    as_bvh, as_glb, as_vrma = (load(seen["saved"][form]) for form in ("bvh", "glb", "vrma"))
    assert report["frames"] == len(as_bvh) == len(as_glb) == len(as_vrma)
    assert [span["name"] for span in report["spans"] if span["kind"] == "sign"] == ["HELLO", "DEAF"]
    heights = [
        np.ptp(kinematics.forward(clip)[1][:, :, 1], axis=1).mean() * unit
        for clip, unit in ((as_bvh, 0.01), (as_glb, 1.0))
    ]
    assert heights[0] == pytest.approx(heights[1], rel=1e-4)


def test_an_avatar_replaces_the_mannequin(seen: dict[str, Any]) -> None:
    assert seen["junkAlert"].startswith("junk.vrm is not a VRM avatar")
    assert seen["avatar"]["alert"] == ""
    assert min(seen["avatar"]["drawn"]) > 0.1


def test_a_film_has_every_frame(seen: dict[str, Any]) -> None:
    film = Path(seen["film"])
    assert film.suffix in (".mp4", ".webm")
    assert film.stat().st_size > 10_000
    if shutil.which("ffprobe") is None:
        pytest.skip("ffprobe is not installed")
    entries = "stream=width,height,nb_read_frames"
    call = ["ffprobe", "-v", "error", "-count_frames", "-show_entries", entries, "-of", "csv=p=0", str(film)]
    output = subprocess.run(call, capture_output=True, text=True, check=True).stdout
    assert output.strip() == "1920,1080,3"


def test_axe_finds_no_accessibility_violations(seen: dict[str, Any]) -> None:
    assert seen["axe"] == []


def test_the_page_fits_a_phone_in_chinese(seen: dict[str, Any]) -> None:
    phone = seen["phone"]
    assert phone["language"] == "zh-CN"
    assert phone["sign"] == "打手语"
    assert phone["overflow"] <= 0, "the page is wider than the phone"
    assert phone["smallButtons"] == [], "too small for a finger"
    assert phone["signs"] == ["DEAF", "FRIEND"]
    assert min(phone["drawn"]) > 0.1
    assert phone["faults"] == []


def test_a_saved_page_opens_from_disk_without_network(seen: dict[str, Any]) -> None:
    disk = seen["fromDisk"]
    assert disk["signs"] == ["HELLO", "DEAF"]
    assert disk["sides"] == ["learned", "slerp"]
    assert disk["running"][1] > disk["running"][0]
    assert min(disk["drawn"]) > 0.1
    assert disk["hasSentenceBox"] is False
    assert disk["faults"] == []
    assert disk["hosts"] == []


def test_the_docs_page_needs_no_other_host(seen: dict[str, Any]) -> None:
    assert seen["docs"]["routes"] == 6
    assert seen["docs"]["hosts"] == seen["hosts"]
    assert seen["docs"]["faults"] == []
