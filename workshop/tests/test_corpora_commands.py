"""The commands `synth sentences` and `synth pairs`: complete folders and one-line errors."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from signing import sign
from signsplice import cli
from signsplice.formats import load
from signsplice.motion import kinematics
from signsplice.signer.signer import draw_signer
from signsplice_workshop.corpora import pseudo
from signsplice_workshop.corpora.pairs import Pairs, Recipe, write_pairs
from test_cli_synth import NOTATION, signsplice


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with what two commands make of the package's words."""
    folder = tmp_path_factory.mktemp("corpora")
    drawn = ("--words", "2", "--pseudo", "1", "--seed", "4")
    for call, output in (
        (("sentences", "-o", "signed", "--count", "2", "--words", "4", "--seed", "1"), "signed: 2 sentences of 4"),
        (("pairs", "-o", "pairs", *drawn, "--other-signer", "2", "--truth", "word"), "pairs: 11 pairs of 3"),
    ):
        run = signsplice("synth", *call, cwd=folder)
        assert (run.returncode, run.stderr) == (0, "")
        assert run.stdout.startswith(output)
        assert run.stdout.count("\n") == 1
    return folder


def test_sentences_are_rebuilt_from_words_and_transitions(folder: Path) -> None:
    truth = json.loads((folder / "signed" / "truth.json").read_text())
    assert truth["signer"]["name"] == draw_signer(2).name
    assert len(truth["sentences"]) == 2
    for sentence in truth["sentences"]:
        clip = load(folder / "signed" / sentence["file"])
        positions = kinematics.forward(clip)[1]
        covered = 0
        for span in sentence["spans"]:
            assert span["output"][0] == covered
            covered = span["output"][1]
            if span["kind"] == "sign" and not span["changed"]:
                word = kinematics.forward(load(folder / "signed" / "words" / f"{span['name']}.bvh"))[1]
                assert np.abs(positions[slice(*span["output"])] - word[slice(*span["source"])]).max() < 0.01
        assert covered == len(clip) == sentence["frames"]


def test_pairs_are_those_of_the_library_and_of_one_process(folder: Path, tmp_path: Path) -> None:
    """The command works with two processes; one makes the same bytes."""
    made = Pairs(folder / "pairs")
    assert len(made) == 9 + 2
    glosses = [row["gloss"] for row in made.head["words"]][:3]
    assert glosses[2] == "PSEUDO-400000"
    signs = (*(sign(gloss) for gloss in glosses[:2]), pseudo.draw_sign(400_000))
    recipe = Recipe(signs, seed=4, n_other=2, truth="word")
    assert made.head["hash"] == recipe.hash
    write_pairs(recipe, tmp_path / "pairs", processes=1)
    for path in (folder / "pairs").iterdir():
        assert (tmp_path / "pairs" / path.name).read_bytes() == path.read_bytes(), path.name


BAD_CALLS = [
    (("pairs", "-o", "out", "--truth", "both"), "'both' is not one of 'partner', 'word', 'events'"),
    (("pairs", "-o", "out", "--truth", "events", "--fps", "24"), "--fps 24, expected 30 with --truth events"),
    (("pairs", "-o", "out", "--truth", "events", "--other-signer", "5"), "--truth events takes no --other-signer"),
    (("pairs", "-o", "out", "--teach", "2"), "--teach 2 --truth partner, expected at least 0, and --truth events"),
    (("sentences", "-o", "out", "--count", "0"), "--count 0, expected at least 1"),
    (("sentences", "-o", "out", "--words", "1"), "1 words chosen, expected at least 2"),
    (("sentences", "-o", "own.signs", "--words", "2"), "own.signs: is there already and has no truth.json"),
    (("sentences", "-o", "out", "--words", "2", "--fps", "1000"), "--fps 1000, expected 10 to 240"),
    (("pairs", "-o", "out", "--words", "1"), "1 words chosen, expected at least 2"),
    (("pairs", "-o", "out", "--other-signer", "-1"), "--other-signer -1 --processes 2, expected at least 0 and 1"),
    (("pairs", "-o", "out", "--processes", "0"), "--processes 0, expected at least 0 and 1"),
    (("pairs", "-o", "own.signs", "--words", "2"), "own.signs: is there already and has no corpus.json"),
    (("pairs", "-o", ".", "--words", "2"), "is there already and has no corpus.json"),
    (("pairs", "-o", "out", "--seed", "x"), "'x' is not a valid integer"),
]


@pytest.mark.parametrize(("call", "message"), BAD_CALLS, ids=[" ".join(call) for call, _ in BAD_CALLS])
def test_a_bad_call_gives_one_line_and_writes_nothing(
    call: tuple[str, ...],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (tmp_path / "own.signs").write_text(NOTATION, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["signsplice", "synth", *call])
    with pytest.raises(SystemExit) as left:
        cli.main()
    out, err = capsys.readouterr()
    assert (left.value.code, out) == (2, "")
    assert err.startswith("error: ")
    assert err.count("\n") == 1
    assert message in err
    assert [path.name for path in tmp_path.iterdir()] == ["own.signs"]
