"""How deep transitions lead hands into the body."""

from __future__ import annotations

import json

import numpy as np
import pytest
from click.testing import CliRunner

from signsplice.cli.commands import app
from signsplice.splicing.collisions import avoid_collisions, depths
from signsplice.splicing.contracts import Gap
from signsplice.splicing.curves import TRANSITIONS
from signsplice_workshop.corpora.pairs import Pairs
from signsplice_workshop.measure import collisions


def test_rows_count_gaps_and_frames(pairs: Pairs) -> None:
    numbers = range(len(pairs.index))
    hold, slerp, cleared = collisions.compare(
        pairs, numbers, [(TRANSITIONS["hold"], False), (TRANSITIONS["slerp"], False), (TRANSITIONS["slerp"], True)]
    )
    assert hold.n_gaps == slerp.n_gaps == len(numbers)
    assert hold.n_frames == int(pairs.index[:, 5].sum())
    assert hold.deepest <= 0.003, "the last pose of a sign is as deep as its end allows"
    assert cleared.deep_gaps == 0.0
    assert cleared.deepest <= 0.005
    assert slerp.deep_frames <= slerp.deep_gaps or slerp.deep_gaps == 0.0


def test_depths_are_those_that_collision_avoidance_removes(pairs: Pairs) -> None:
    deepest = 0.0
    for number in range(len(pairs.index)):
        p, q, pre, post, _, count = pairs.index[number].tolist()
        before, after = pairs.word_clip(p)[: pre + 1], pairs.word_clip(q)[post:]
        made = TRANSITIONS["slerp"].between(Gap(before, after, count))
        found = depths(made, before, after)
        assert found.shape == (count,)
        assert found.max() == pytest.approx(avoid_collisions(made, before, after).depth_before)
        deepest = max(deepest, float(found.max()))
    assert deepest > 0.0, "some transition passes through the body"


def test_the_command_prints_rows_with_the_stored_keys(pairs: Pairs) -> None:
    run = CliRunner().invoke(app, ["evaluate", "pairs", str(pairs.folder), "--limit", "3", "--json"])
    assert run.exit_code == 0, run.output
    printed = json.loads(run.stdout)
    assert {row["n_gaps"] for row in printed["rows"]} == {3}
    assert printed["signature"] == collisions.SIGNATURE
    assert np.isfinite([row["deepest"] for row in printed["rows"]]).all()
    keys = ("transition", "body_sense", "n_gaps", "n_frames", "deep_gaps", "deep_frames", "deepest")
    assert all(tuple(row) == keys for row in printed["rows"])
