"""Folders of the synthetic signer: words as BVH with a table, sentences with the ground truth that rebuilds them."""

from __future__ import annotations

import csv
import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from signsplice_workshop.corpora import sentences as running
from signsplice_workshop.corpora.pairs import Recipe

from signing import sign, word
from signsplice.errors import InputError
from signsplice.formats import load
from signsplice.motion import Clip, kinematics
from signsplice.signer import planner
from signsplice.signer.signer import STANDARD, draw_signer, read_signer
from signsplice.synth import folders

BVH_CM = 0.01
"""Error of positions by BVH's rounding, cm."""
SIGNS = tuple(sign(gloss) for gloss in ("I", "MOTHER", "BOOK", "YOU", "fs-A"))
RECIPE = Recipe(SIGNS, seed=0)


def positions_of(clip: Clip) -> Any:
    return kinematics.forward(clip)[1]


# --- lexicons


@pytest.fixture(scope="module")
def lexicon(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("folders") / "lexicon"
    folders.write_lexicon(SIGNS, STANDARD, folder)
    return folder


def test_a_lexicon_has_a_file_for_every_word_and_a_table(lexicon: Path) -> None:
    assert {path.name for path in lexicon.iterdir()} == {f"{s.gloss}.bvh" for s in SIGNS} | {"glosses.csv"}
    rows = list(csv.DictReader((lexicon / "glosses.csv").read_text(encoding="utf-8").splitlines()))
    assert [row["gloss"] for row in rows] == [s.gloss for s in SIGNS]
    assert [row["kind"] for row in rows] == ["sign"] * 4 + ["letter"]
    assert {row["signer"] for row in rows} == {"standard"}
    assert {row["checked"] for row in rows} == {"no"}
    for row, one in zip(rows, SIGNS, strict=True):
        assert row["file"] == f"{one.gloss}.bvh"
        assert row["source"] == one.source
        assert row["synonyms"].split(";") == [*one.synonyms, *([""] * (not one.synonyms))]


@pytest.mark.parametrize("gloss", ["I", "BOOK", "fs-A"])
def test_the_files_hold_the_planned_words(gloss: str, lexicon: Path) -> None:
    clip = load(lexicon / f"{gloss}.bvh")
    planned = planner.isolated(sign(gloss)).clip
    assert len(clip) == len(planned)
    assert clip.fps == pytest.approx(30.0, abs=1e-3)
    assert clip.skeleton.names == planned.skeleton.names
    assert np.abs(positions_of(clip) - positions_of(planned)).max() < BVH_CM


def test_progress_is_reported_and_the_table_names_the_signer(tmp_path: Path) -> None:
    reported: list[tuple[int, int]] = []
    folders.write_lexicon(
        SIGNS[:2], draw_signer(3), tmp_path / "l", fps=24.0, progress=lambda done, of: reported.append((done, of))
    )
    assert reported == [(1, 2), (2, 2)]
    assert "signer-3" in (tmp_path / "l" / "glosses.csv").read_text()
    assert load(tmp_path / "l" / "I.bvh").fps == pytest.approx(24.0, abs=1e-3)


def test_glosses_become_names_that_file_systems_allow() -> None:
    assert folders.file_name("THANK-YOU") == "THANK-YOU"
    assert folders.file_name("a/b:c*?\x01") == "a_b_c___"
    assert folders.file_name("日本") == "日本"


def test_two_glosses_of_one_file_name_are_refused(tmp_path: Path) -> None:
    twice = [replace(SIGNS[0], gloss=gloss) for gloss in ("A/B", "A|B")]
    with pytest.raises(InputError, match=r"A/B and A\|B would both be A_B.bvh"):
        folders.write_lexicon(twice, STANDARD, tmp_path / "l")
    with pytest.raises(InputError, match="would both be"):
        folders.write_sentences(Recipe(tuple(twice)), 1, tmp_path / "s")
    assert list(tmp_path.iterdir()) == []


def test_an_interrupted_call_leaves_no_part_of_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    old = tmp_path / "l"
    folders.write_lexicon(SIGNS[:1], STANDARD, old)
    before = {path.name: path.read_bytes() for path in old.iterdir()}
    real, calls = planner.isolated, 0

    def failing(*arguments: Any, **named: Any) -> planner.IsolatedWord:
        nonlocal calls
        calls += 1
        if calls == 2:
            raise KeyboardInterrupt
        return real(*arguments, **named)

    monkeypatch.setattr(planner, "isolated", failing)
    with pytest.raises(KeyboardInterrupt):
        folders.write_lexicon(SIGNS, STANDARD, old)
    calls = 0
    with pytest.raises(KeyboardInterrupt):
        folders.write_sentences(RECIPE, 2, tmp_path / "s")
    assert [path.name for path in tmp_path.iterdir()] == ["l"]
    assert {path.name: path.read_bytes() for path in old.iterdir()} == before


def test_a_folder_of_something_else_stays_as_it_is(tmp_path: Path) -> None:
    mine = tmp_path / "mine"
    mine.mkdir()
    (mine / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match=r"mine: is there already and has no glosses\.csv"):
        folders.write_lexicon(SIGNS[:1], STANDARD, mine)
    with pytest.raises(InputError, match=r"mine: is there already and has no truth\.json"):
        folders.write_sentences(RECIPE, 1, mine)
    assert [path.name for path in mine.iterdir()] == ["notes.txt"]


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_own_output_is_replaced(lexicon: Path, tmp_path: Path) -> None:
    for signer in (draw_signer(3), STANDARD):
        folders.write_lexicon(SIGNS[:2], signer, tmp_path / "l")
    folders.write_lexicon(SIGNS, STANDARD, tmp_path / "l")
    assert contents(tmp_path / "l") == contents(lexicon)
    for count in (2, 1):
        folders.write_sentences(RECIPE, count, tmp_path / "s")
    assert len(list((tmp_path / "s").glob("sentence-*.bvh"))) == 1


COLUMNS = "file,gloss,synonyms,signer,source,checked,kind\n"
RECORDED = {
    "only names": ("file,gloss\nHELLO.bvh,HELLO\n", "HELLO.bvh", "has other columns than a table of `synth lexicon`"),
    "empty": ("", "HELLO.bvh", "has other columns"),
    "a signer": (COLUMNS + "HELLO.bvh,HELLO,,Anna,,no,sign\n", "HELLO.bvh", "csv:2: is no word of `synth lexicon`"),
    "checked": (COLUMNS + "HELLO.bvh,HELLO,,standard,,yes,sign\n", "HELLO.bvh", "csv:2: is no word of"),
    "few cells": (COLUMNS + "HELLO.bvh,HELLO\n", "HELLO.bvh", "csv:2: is no word of"),
    "no table": (COLUMNS + '"HELLO', "HELLO.bvh", r"glosses\.csv: is no valid table of `synth lexicon`"),
    "another skeleton": (COLUMNS + "HELLO.bvh,HELLO,,standard,,no,sign\n", "HELLO.bvh", "is on another skeleton than"),
    "another file": (
        COLUMNS + "I.bvh,I,,standard,,no,sign\n",
        "notes.txt",
        r"holds notes\.txt beside its glosses\.csv",
    ),
    "a folder": (COLUMNS + "I.bvh,I,,standard,,no,sign\n", "more/HELLO.bvh", r"holds more beside its glosses\.csv"),
}


@pytest.mark.parametrize(("table", "file", "message"), RECORDED.values(), ids=RECORDED)
def test_own_recordings_beside_a_table_stay(table: str, file: str, message: str, tmp_path: Path) -> None:
    mine = tmp_path / "mine"
    (mine / file).parent.mkdir(parents=True)
    (mine / file).write_text("HIERARCHY\nROOT mixamorig:Hips\n")
    (mine / "glosses.csv").write_text(table)
    before = contents(mine)
    with pytest.raises(InputError, match=message):
        folders.write_lexicon(SIGNS[:1], STANDARD, mine)
    assert contents(mine) == before


def test_a_recording_in_the_place_of_a_synthetic_word_stays(lexicon: Path, tmp_path: Path) -> None:
    mine = tmp_path / "mine"
    shutil.copytree(lexicon, mine)
    (mine / "BOOK.bvh").write_text("HIERARCHY\nROOT Hips\n")
    before = contents(mine)
    with pytest.raises(InputError, match=r"BOOK\.bvh: is on another skeleton than signer standard"):
        folders.write_lexicon(SIGNS, STANDARD, mine)
    assert contents(mine) == before


@pytest.mark.parametrize("truth", ["[]", "{}", '{"sentences": [{"file": 1, "glosses": []}]}', '{"sentences": [3]}'])
def test_another_truth_stays(truth: str, tmp_path: Path) -> None:
    (tmp_path / "truth.json").write_text(truth)
    with pytest.raises(InputError, match=r"truth\.json: is no truth of `synth sentences`"):
        folders.write_sentences(RECIPE, 1, tmp_path)
    assert contents(tmp_path) == {"truth.json": truth.encode()}


# --- sentences


@pytest.fixture(scope="module")
def sentences(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("folders") / "sentences"
    folders.write_sentences(RECIPE, 4, folder)
    return folder


def test_notes_beside_sentences_stay(sentences: Path, tmp_path: Path) -> None:
    shutil.copytree(sentences, tmp_path / "s")
    (tmp_path / "s" / "words" / "notes.txt").write_text("mine")
    before = contents(tmp_path / "s")
    with pytest.raises(InputError, match=r"holds words.notes\.txt beside its truth\.json, which would be lost"):
        folders.write_sentences(RECIPE, 1, tmp_path / "s")
    assert contents(tmp_path / "s") == before


def truth_of(folder: Path) -> dict[str, Any]:
    return dict(json.loads((folder / "truth.json").read_text()))


def rebuild(sentence: dict[str, Any], folder: Path) -> None:
    """Check that spans cover the file, that unchanged words are their own frames, and that seams agree with spans."""
    signed = load(folder / sentence["file"])
    assert len(signed) == sentence["frames"]
    spans = sentence["spans"]
    assert [span["output"][0] for span in spans] == [0, *(span["output"][1] for span in spans[:-1])]
    assert spans[-1]["output"][1] == len(signed)
    assert [span["name"] for span in spans if span["kind"] == "sign"] == sentence["glosses"]
    positions = positions_of(signed)
    for span in spans[::2]:
        isolated = positions_of(load(folder / "words" / f"{folders.file_name(span['name'])}.bvh"))
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


def test_the_ground_truth_rebuilds_every_sentence(sentences: Path) -> None:
    truth = truth_of(sentences)
    assert [s["file"] for s in truth["sentences"]] == [f"sentence-{n:04d}.bvh" for n in range(4)]
    for sentence in truth["sentences"]:
        assert 3 <= len(sentence["glosses"]) <= 12
        assert all(a != b for a, b in zip(sentence["glosses"][:-1], sentence["glosses"][1:], strict=True))
        rebuild(sentence, sentences)
    used = {gloss for sentence in truth["sentences"] for gloss in sentence["glosses"]}
    assert {path.stem for path in (sentences / "words").iterdir()} == used
    assert any(span["changed"] for s in truth["sentences"] for span in s["spans"])
    assert read_signer(truth["signer"]) == STANDARD
    assert (truth["hash"], truth["seed"], truth["fps"]) == (RECIPE.hash, 0, 30.0)


def test_exact_sentences_change_no_word(tmp_path: Path) -> None:
    folders.write_sentences(RECIPE, 2, tmp_path / "s", changes=False)
    for sentence in truth_of(tmp_path / "s")["sentences"]:
        assert all(span["changed"] == [] for span in sentence["spans"])
        rebuild(sentence, tmp_path / "s")


def test_sentences_are_drawn_by_seed(tmp_path: Path, sentences: Path) -> None:
    folders.write_sentences(RECIPE, 4, tmp_path / "again")
    for path in sentences.rglob("*.*"):
        assert (tmp_path / "again" / path.relative_to(sentences)).read_bytes() == path.read_bytes()
    folders.write_sentences(replace(RECIPE, seed=5), 1, tmp_path / "other")
    assert truth_of(tmp_path / "other")["sentences"][0]["glosses"] != truth_of(sentences)["sentences"][0]["glosses"]


def test_a_description_names_changes_and_counts_frames() -> None:
    sentence = running.utter([word("BOOK"), word("YOU"), word("BOOK")])
    described = folders.describe(sentence, "x.bvh")
    assert described["frames"] == len(sentence.clip)
    assert described["spans"][2]["changed"] == ["weak", "fingers"]
    assert [seam["n_transition"] for seam in described["seams"]] == [len(seam.states) for seam in sentence.seams]
