"""Folders of sentences: complete or absent, and a ground truth that rebuilds every sentence."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from signing import sign, word
from signsplice.errors import InputError
from signsplice.formats import load
from signsplice.motion import Clip, kinematics
from signsplice.signer import planner
from signsplice.signer.folders import file_name
from signsplice.signer.signer import STANDARD
from signsplice_workshop.corpora import sentences
from signsplice_workshop.corpora.pairs import Recipe, read_signer

BVH_CM = 0.01
"""Error of positions by BVH's rounding, cm."""
SIGNS = tuple(sign(gloss) for gloss in ("I", "MOTHER", "BOOK", "YOU", "fs-A"))
RECIPE = Recipe(SIGNS, seed=0)


def positions_of(clip: Clip) -> Any:
    return kinematics.forward(clip)[1]


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_two_glosses_of_one_file_name_are_refused(tmp_path: Path) -> None:
    twice = tuple(replace(SIGNS[0], gloss=gloss) for gloss in ("A/B", "A|B"))
    with pytest.raises(InputError, match="would both be"):
        sentences.write_sentences(Recipe(twice), 1, tmp_path / "s")
    assert list(tmp_path.iterdir()) == []


def test_an_interrupted_call_leaves_no_part_of_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real, calls = planner.synthesize_word, 0

    def failing(*arguments: Any, **named: Any) -> planner.IsolatedWord:
        nonlocal calls
        calls += 1
        if calls == 2:
            raise KeyboardInterrupt
        return real(*arguments, **named)

    monkeypatch.setattr(planner, "synthesize_word", failing)
    with pytest.raises(KeyboardInterrupt):
        sentences.write_sentences(RECIPE, 2, tmp_path / "s")
    assert list(tmp_path.iterdir()) == []


def test_a_folder_of_something_else_stays_as_it_is(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match=r"is there already and has no truth\.json"):
        sentences.write_sentences(RECIPE, 1, tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]


def test_own_output_is_replaced(tmp_path: Path) -> None:
    for count in (2, 1):
        sentences.write_sentences(RECIPE, count, tmp_path / "s")
    assert len(list((tmp_path / "s").glob("sentence-*.bvh"))) == 1


@pytest.mark.parametrize("truth", ["[]", "{}", '{"sentences": [{"file": 1, "glosses": []}]}', '{"sentences": [3]}'])
def test_another_truth_stays(truth: str, tmp_path: Path) -> None:
    (tmp_path / "truth.json").write_text(truth)
    with pytest.raises(InputError, match=r"truth\.json: is no truth of `synth sentences`"):
        sentences.write_sentences(RECIPE, 1, tmp_path)
    assert contents(tmp_path) == {"truth.json": truth.encode()}


@pytest.fixture(scope="module")
def signed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("folders") / "sentences"
    sentences.write_sentences(RECIPE, 4, folder)
    return folder


def test_notes_beside_sentences_stay(signed: Path, tmp_path: Path) -> None:
    shutil.copytree(signed, tmp_path / "s")
    (tmp_path / "s" / "words" / "notes.txt").write_text("mine")
    before = contents(tmp_path / "s")
    with pytest.raises(InputError, match=r"holds words.notes\.txt beside its truth\.json, which would be lost"):
        sentences.write_sentences(RECIPE, 1, tmp_path / "s")
    assert contents(tmp_path / "s") == before


def truth_of(folder: Path) -> dict[str, Any]:
    return dict(json.loads((folder / "truth.json").read_text()))


def rebuild(sentence: dict[str, Any], folder: Path) -> None:
    """Check that spans cover the file, that unchanged words are their own frames, and that seams agree with spans."""
    clip = load(folder / sentence["file"])
    assert len(clip) == sentence["frames"]
    spans = sentence["spans"]
    assert [span["output"][0] for span in spans] == [0, *(span["output"][1] for span in spans[:-1])]
    assert spans[-1]["output"][1] == len(clip)
    assert [span["name"] for span in spans if span["kind"] == "sign"] == sentence["glosses"]
    positions = positions_of(clip)
    for span in spans[::2]:
        isolated = positions_of(load(folder / "words" / f"{file_name(span['name'])}.bvh"))
        part, source = positions[slice(*span["output"])], isolated[slice(*span["source"])]
        assert part.shape == source.shape
        if not span["changed"]:
            assert np.abs(part - source).max() < BVH_CM
        else:
            assert np.abs(part - source).max() > 0.1
    for seam, before, between, after in zip(sentence["seams"], spans[:-2:2], spans[1::2], spans[2::2], strict=True):
        assert (seam["before"], seam["after"]) == (before["name"], after["name"])
        assert seam["pre_frame"] == before["source"][1] - 1
        assert seam["post_frame"] == after["source"][0]
        assert seam["n_transition"] == between["output"][1] - between["output"][0]
        assert (between["kind"], between["name"], between["source"]) == ("transition", None, None)


def test_the_ground_truth_rebuilds_every_sentence(signed: Path) -> None:
    truth = truth_of(signed)
    assert [s["file"] for s in truth["sentences"]] == [f"sentence-{n:04d}.bvh" for n in range(4)]
    for sentence in truth["sentences"]:
        assert 3 <= len(sentence["glosses"]) <= 12
        assert all(a != b for a, b in zip(sentence["glosses"][:-1], sentence["glosses"][1:], strict=True))
        rebuild(sentence, signed)
    used = {gloss for sentence in truth["sentences"] for gloss in sentence["glosses"]}
    assert {path.stem for path in (signed / "words").iterdir()} == used
    assert any(span["changed"] for s in truth["sentences"] for span in s["spans"])
    assert read_signer(truth["signer"]) == STANDARD
    assert (truth["hash"], truth["seed"], truth["fps"]) == (RECIPE.hash, 0, 30.0)


def test_exact_sentences_change_no_word(tmp_path: Path) -> None:
    sentences.write_sentences(RECIPE, 2, tmp_path / "s", changes=False)
    for sentence in truth_of(tmp_path / "s")["sentences"]:
        assert all(span["changed"] == [] for span in sentence["spans"])
        rebuild(sentence, tmp_path / "s")


def test_sentences_are_drawn_by_seed(tmp_path: Path, signed: Path) -> None:
    sentences.write_sentences(RECIPE, 4, tmp_path / "again")
    for path in signed.rglob("*.*"):
        assert (tmp_path / "again" / path.relative_to(signed)).read_bytes() == path.read_bytes()
    sentences.write_sentences(replace(RECIPE, seed=5), 1, tmp_path / "other")
    assert truth_of(tmp_path / "other")["sentences"][0]["glosses"] != truth_of(signed)["sentences"][0]["glosses"]


def test_a_description_names_changes_and_counts_frames() -> None:
    sentence = sentences.utter([word("BOOK"), word("YOU"), word("BOOK")])
    described = sentences.describe(sentence, "x.bvh")
    assert described["frames"] == len(sentence.clip)
    assert described["spans"][2]["changed"] == ["weak", "fingers"]
    assert [seam["n_transition"] for seam in described["seams"]] == [len(seam.states) for seam in sentence.seams]
