"""The paper's systems on a user's own words: any rig, from a folder of clips to tables."""

from __future__ import annotations

import json
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest
import torch
from click.testing import CliRunner

from signing import word
from signsplice.formats import save
from signsplice.motion import Clip, Skeleton
from signsplice_paper import own_words
from signsplice_paper.cli.commands import app
from signsplice_paper.own_clips import ClipChoice
from signsplice_paper.train import scales, training
from signsplice_paper.train.tasks import MOST_FRAMES
from signsplice_workshop.corpora.pairs import Pairs
from signsplice_workshop.train.processes import Processes

ONE = Processes(0, 1, torch.device("cpu"))
GLOSSES = ("HELLO", "DEAF", "SIGN", "YOU", "SEE", "MOTHER", "BOOK", "YES", "I", "NO")


def armed(clip: Clip) -> Clip:
    """The clip without its legs: 45 joints."""
    bones = clip.skeleton
    kept = [k for k, name in enumerate(bones.names) if not any(part in name for part in ("Leg", "Foot", "Toe"))]
    order = {joint: k for k, joint in enumerate(kept)}
    parents = np.array([order.get(int(bones.parents[joint]), -1) for joint in kept])
    fewer = Skeleton(tuple(bones.names[joint] for joint in kept), parents, bones.offsets[kept])
    return Clip(fewer, clip.local_rotations[:, kept], clip.root_positions, clip.fps, clip.name)


def clips(folder: Path, glosses: tuple[str, ...], fps: float) -> Path:
    folder.mkdir()
    for gloss in glosses:
        save(armed(word(gloss, seed=6, fps=fps).clip), folder / f"{gloss}.bvh")
    return folder


def test_the_longest_transition_is_the_networks() -> None:
    assert own_words.LONGEST == MOST_FRAMES


@pytest.mark.slow
def test_a_system_learns_from_clips_of_another_rig(tmp_path: Path) -> None:
    folder = clips(tmp_path / "clips", GLOSSES[:3], 12.0)
    plan = own_words.PairsPlan(ClipChoice(folder, fps=12.0), "pose-velocity+hermite")
    own_words.build(plan, tmp_path / "pairs", lambda _: nullcontext())
    pairs = Pairs(tmp_path / "pairs")
    assert pairs.spaces[0].n_numbers == 135
    config = training.Training("lpt-plus", "smoke", steps=1, n_judgements=1)
    part = training.fit_to_skeleton(scales.make_parts("lpt-plus", "smoke", steps=1)[0], pairs)
    (tmp_path / "part").mkdir()
    made = training.train_part(part, config, pairs, tmp_path / "part", ONE)
    tokens = made.network(torch.from_numpy(np.array(pairs.word(0)))[None], torch.tensor([9]))
    assert tokens.shape == (1, len(pairs.word(0)), 3)


@pytest.mark.slow
def test_from_ten_clips_to_tables(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    clips(tmp_path / "clips", GLOSSES, 30.0)
    monkeypatch.chdir(tmp_path)
    folders = ["--scale", "smoke", "--pairs", "pairs", "--bundles", "bundles", "--out", "out", "--limit", "3"]
    for call in (
        ["pairs", "build", "clips", "-o", "pairs"],
        ["all", *folders, "--system", "lpt-plus", "--system", "transformer", "--steps", "2"],
        ["evaluate", *folders],
    ):
        result = CliRunner().invoke(app, call, catch_exceptions=False)
        assert result.exit_code == 0, result.output
    rows = json.loads((tmp_path / "out" / "results.json").read_text())["rows"]
    assert {"lpt-plus", "transformer", "learned-fluent+learned"} <= {row["system"] for row in rows}
    assert {row["split"] for row in rows} == {"random", "unseen-words"}
    assert (tmp_path / "out" / "tables.md").read_text().count("|") > 50
