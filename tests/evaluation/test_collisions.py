"""How deep transitions lead hands into the body."""

from __future__ import annotations

import json

import numpy as np
import pytest
from click.testing import CliRunner

from signing import sign
from signsplice.cli import app
from signsplice.evaluation import collisions
from signsplice.splicing.collision_avoidance import avoid_collisions, depths
from signsplice.splicing.transition import TRANSITIONS
from signsplice.synth.corpus import Pairs, Recipe, write_pairs


@pytest.fixture(scope="module")
def pairs(tmp_path_factory: pytest.TempPathFactory) -> Pairs:
    folder = tmp_path_factory.mktemp("pairs")
    write_pairs(Recipe(tuple(sign(gloss) for gloss in ("MOTHER", "BOOK", "DEAF", "HELLO"))), folder)
    return Pairs(folder)


def test_rows_count_gaps_and_frames(pairs: Pairs) -> None:
    numbers = range(len(pairs.index))
    held, slerp, led = collisions.compare(
        pairs, numbers, [(TRANSITIONS["hold"], False), (TRANSITIONS["slerp"], False), (TRANSITIONS["slerp"], True)]
    )
    assert held.n_gaps == slerp.n_gaps == len(numbers)
    assert held.n_frames == int(pairs.index[:, 5].sum())
    assert held.deepest <= 0.003, "the last pose of a sign is as deep as its end allows"
    assert led.deep_gaps == 0.0
    assert led.deepest <= 0.005
    assert slerp.deep_frames <= slerp.deep_gaps or slerp.deep_gaps == 0.0


def test_depths_are_what_body_sense_leads_around(pairs: Pairs) -> None:
    deepest = 0.0
    for number in range(len(pairs.index)):
        p, q, pre, post, _, count = pairs.index[number].tolist()
        before, after = pairs.word_clip(p)[: pre + 1], pairs.word_clip(q)[post:]
        made = TRANSITIONS["slerp"].between(before, after, count)
        found = depths(made, before, after)
        assert found.shape == (count,)
        assert found.max() == pytest.approx(avoid_collisions(made, before, after).depth_before)
        deepest = max(deepest, float(found.max()))
    assert deepest > 0.0, "some way leads through the body"


def test_the_command_prints_rows(pairs: Pairs) -> None:
    run = CliRunner().invoke(app, ["evaluate", "--pairs", str(pairs.folder), "--limit", "3", "--json"])
    assert run.exit_code == 0, run.output
    told = json.loads(run.stdout)
    assert {row["n_gaps"] for row in told["rows"]} == {3}
    assert told["signature"] == collisions.SIGNATURE
    assert np.isfinite([row["deepest"] for row in told["rows"]]).all()
