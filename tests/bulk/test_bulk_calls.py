"""Calls of `signsplice bulk` that a newcomer gets wrong: nothing of theirs is lost, and each is one line."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

pytest.importorskip("pyarrow")

from signsplice.bulk import recipes
from signsplice.cli.commands import app
from signsplice.formats import load
from signsplice.lexicon import building, open_shipped_lexicon
from signsplice.lexicon.lexicon import SHIPPED
from signsplice.splicing.engine import splice


def call(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["bulk", *map(str, arguments)])


def message(result: Result) -> str:
    """What a call that failed says."""
    assert result.exit_code, result.output
    return f"{result.stderr}{result.exception}"


def test_recipes_of_ones_own_are_not_taken_for_those_of_a_run(tmp_path: Path) -> None:
    mine = tmp_path / "recipes.parquet"
    assert call("recipes", "-o", mine, "--count", 3).exit_code == 0
    before = mine.read_bytes()
    assert "holds recipes.parquet and no job.json" in message(call("pairs", "--count", 2, "-o", tmp_path))
    assert mine.read_bytes() == before


def test_lines_are_spelled_only_where_that_is_wanted_and_typing_errors_are_named(tmp_path: Path) -> None:
    (tmp_path / "lines.txt").write_text("HELLO ZZQ\nTODYA HELLO\n")
    out = tmp_path / "recipes.csv"
    spelled = call("recipes", tmp_path / "lines.txt", "-o", out)
    assert "lines.txt:2: " in spelled.stderr
    assert "TODAY" in spelled.stderr
    assert [row.glosses[-1] for row in rows(out)] == ["fs-ZZQ", "HELLO"]
    plain = call("recipes", tmp_path / "lines.txt", "-o", out, "--no-spell")
    assert "lines.txt:1: " in plain.stderr
    assert [row.glosses for row in rows(out)] == [("HELLO", "ZZQ"), ("TODYA", "HELLO")]


def test_marks_stay_with_their_glosses_and_can_be_left_out_of_account(tmp_path: Path) -> None:
    (tmp_path / "lines.txt").write_text("Hello, deaf.\n")
    out = tmp_path / "recipes.csv"
    for more, pauses in ((), True), (("--no-pauses",), False):
        assert call("recipes", tmp_path / "lines.txt", "-o", out, *more).exit_code == 0
        (row,) = rows(out)
        assert (row.glosses, row.pauses, row.spell) == (("HELLO,", "DEAF."), pauses, True)


def test_function_words_are_left_out_of_lines_where_that_is_wanted(tmp_path: Path) -> None:
    (tmp_path / "lines.txt").write_text("I am deaf.\n")
    out = tmp_path / "recipes.csv"
    for more, glosses in ((), ("I", "fs-AM", "DEAF.")), (("--drop-function-words",), ("I", "DEAF.")):
        assert call("recipes", tmp_path / "lines.txt", "-o", out, *more).exit_code == 0
        assert rows(out)[0].glosses == glosses


def test_words_may_come_from_several_lexicons_and_stay_those_of_the_first(tmp_path: Path) -> None:
    own, out = tmp_path / "own", tmp_path / "out"
    with open_shipped_lexicon() as words, building(own) as builder:
        builder.add(words.clip("BOOK"), "HELLO")
    (tmp_path / "recipes.csv").write_text("glosses\nHELLO DEAF\n")
    run = ("sentences", tmp_path / "recipes.csv", "-o", out, "--workers", 1, "--store", "recipes")
    both = ("--lexicon", own, "--lexicon", "default")
    assert call(*run, *both).exit_code == 0
    assert json.loads((out / "job.json").read_text())["lexicon"] == [str(own), str(SHIPPED)]
    assert call(*run, *both).exit_code == 0
    assert "was begun with lexicon_sha256" in message(call(*run))
    assert call("make", out, 0, "-o", tmp_path / "row.bvh").exit_code == 0
    with open_shipped_lexicon() as words:
        alone = splice([replace(words.clip("BOOK"), name="HELLO"), words.clip("DEAF")]).clip
    np.testing.assert_allclose(load(tmp_path / "row.bvh").local_rotations[:20], alone.local_rotations[:20], atol=1e-4)


def test_the_person_and_the_seed_of_recipes_are_those_of_the_call(tmp_path: Path) -> None:
    (tmp_path / "lines.txt").write_text("HELLO DEAF\n")
    out, dials = tmp_path / "recipes.csv", ("-o", tmp_path / "recipes.csv", "--person", "0.5", "--seed", 3)
    for lines in ((tmp_path / "lines.txt",), ()):
        assert call("recipes", *lines, *dials).exit_code == 0
        assert {(row.person, row.seed, row.free_hand) for row in rows(out)} == {(0.5, 3, "natural")}
    assert call("recipes", "-o", out, "--person", "0.2:0.8", "--count", 50).exit_code == 0
    drawn = [row.person for row in rows(out)]
    assert 0.2 <= min(drawn) < max(drawn) <= 0.8


def rows(path: Path) -> list[recipes.SentenceRecipe]:
    return [row for batch in recipes.read(path) for row in recipes.recipes_of(batch)]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--seed", "-1"], "--seed"),
        (["--person", "much"], "--person 'much', expected a number"),
        (["--person", "0.5:2"], "person 2, expected 0 to 1"),
        (["--signer", "nobody"], "--signer 'nobody', expected one of the lexicon's: "),
    ],
)
def test_a_wrong_option_of_recipes_is_one_line(tmp_path: Path, arguments: list[str], said: str) -> None:
    assert said in message(call("recipes", "-o", tmp_path / "r.csv", *arguments))
    assert not list(tmp_path.iterdir())
