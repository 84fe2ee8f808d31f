"""Faces as three.js and three-vrm play our files: the same weights on every kind of avatar."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import face_avatars
import signsplice as ss
from signsplice.motion import Clip
from signsplice_workshop.measure.faces import random_face

VIEWER = Path(__file__).resolve().parents[2] / "viewer"
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
N_FRAMES = 3

pytestmark = pytest.mark.skipif(
    shutil.which("node") is None or CHROMIUM is None or not (VIEWER / "node_modules").is_dir(),
    reason="no node, no Chromium, or viewer/node_modules is not installed",
)


def test_players_show_the_same_weights_on_every_kind_of_avatar(words: dict[str, Clip], tmp_path: Path) -> None:
    clip = words["HELLO"][:N_FRAMES]
    clip = replace(clip, face=random_face(9, 90)[30 : 30 + N_FRAMES])
    ss.save(clip, tmp_path / "any.vrma")  # for no avatar in particular
    pairs: list[str] = []
    for kind in face_avatars.KINDS[:3]:
        path = face_avatars.write(tmp_path, kind)
        signed = ss.retarget(clip, ss.read_avatar(path)).clip
        made = tmp_path / f"{path.stem}-out.glb"
        ss.save(signed, made)
        pairs += [str(made), "-"]
        if kind != "arkit.glb":
            ss.save(signed, made.with_suffix(".vrma"))
            pairs += [str(path), str(made.with_suffix(".vrma")), str(path), str(tmp_path / "any.vrma")]
    command = ["node", str(VIEWER / "checks" / "faces.mjs"), str(tmp_path), "30", str(N_FRAMES), *pairs]
    environment = {**os.environ, "CHROMIUM": str(CHROMIUM)}
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, env=environment)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["faults"] == []
    assert clip.face is not None
    for shown in found["weights"]:
        assert np.abs(np.array(shown) - clip.face.weights).max() < 1e-5
