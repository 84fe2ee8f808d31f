"""Corpora of pairs from clips: those of an exported corpus are the same again, and truth by methods and files."""

from __future__ import annotations

import json
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from signsplice.cli.terminal import size
from signsplice.errors import InputError
from signsplice.formats import load, save
from signsplice.motion import Clip, kinematics
from signsplice_paper import own_words, pair_export, protocol
from signsplice_paper.clip_methods import ClipAnswers, ClipMethod
from signsplice_paper.own_clips import ClipChoice
from signsplice_paper.own_words import BuiltPairs, PairsPlan
from signsplice_workshop.corpora import training_data
from signsplice_workshop.corpora.pairs import FILES, Pairs
from toys import GLOSSES, corpus

pytest_plugins = ("own_words_toys",)
FPS = 15.0
ASIDE = np.array([80.0, 0.0, -40.0])
METHOD = "pose-velocity+hermite"
Title = Callable[[str], AbstractContextManager[None]]


def build(
    folder: Path, clips: Path, positions: str | Path = METHOD, title: Title = lambda _: nullcontext(), **changes: Any
) -> tuple[Pairs, BuiltPairs]:
    """The corpus of a folder of clips at the toys' rate, and what is said of it."""
    choice = ClipChoice(clips, **{"fps": FPS, **{k: v for k, v in changes.items() if k in ("fps", "n_words", "seed")}})
    transition = "hermite" if str(positions).endswith(".json") else None
    plan = PairsPlan(choice, str(positions), changes.get("transition", transition), changes.get("joints"))
    built = own_words.build(plan, folder, title)
    return Pairs(folder), built


def written(folder: Path, clips: dict[str, Clip]) -> Path:
    folder.mkdir()
    for name, clip in clips.items():
        save(clip, folder / f"{name}.bvh")
    return folder


def positions(folder: Path, **content: Any) -> Path:
    path = folder / "positions.json"
    path.write_text(json.dumps(content))
    return path


# --- the same corpus again


def test_an_exported_corpus_is_built_again(exported: Path, tmp_path: Path) -> None:
    made, built = build(tmp_path / "c", exported / "words", exported / "positions.json")
    assert {path.name for path in made.folder.iterdir()} == set(FILES)
    assert (built.n_words, built.n_pairs, built.truth) == (5, 25, "file positions.json")
    like = corpus()
    np.testing.assert_array_equal(made.index, like.index[:25])
    n_frames, n_new = (len(made.words["roots"]), len(made.new["roots"]))
    assert n_frames == sum(row["frames"] for row in like.head["words"][:5])
    for found, expected, count in ((made.words, like.words, n_frames), (made.new, like.new, n_new)):
        for kind in ("roots", "positions"):
            np.testing.assert_allclose(found[kind], expected[kind][:count], atol=1e-5)
        one, other = found["rotations"], expected["rotations"][:count]
        apart = np.minimum(np.abs(one - other).max(axis=-1), np.abs(one + other).max(axis=-1))
        assert apart.max() < 1e-5, "a quaternion and its negative are one rotation"
    assert made.head["splits"]["random"] == like.head["splits"]["random"]
    assert made.spaces == like.spaces[:1]
    assert made.head["moved"] is False, "true transitions fix where the words stand"
    assert [row["gloss"] for row in made.head["words"]] == list(GLOSSES)


def test_an_exported_corpus_of_clips_is_the_same_too(exported: Path, tmp_path: Path) -> None:
    one, _ = build(tmp_path / "one", exported / "words", exported / "positions.json")
    pair_export.export(one, tmp_path / "again")
    other, _ = build(tmp_path / "other", tmp_path / "again" / "words", tmp_path / "again" / "positions.json")
    np.testing.assert_array_equal(one.index, other.index)
    np.testing.assert_allclose(one.new["positions"], other.new["positions"], atol=1e-6)
    assert one.head["words"][2]["signer"] == other.head["words"][2]["signer"] == "standard"


def test_a_signer_without_pairs_is_not_exported(exported: Path, tmp_path: Path) -> None:
    made, _ = build(tmp_path / "c", exported / "words")
    with pytest.raises(InputError, match=r"--signer 2: .* has no pairs of that signer"):
        pair_export.export(made, tmp_path / "out", 1)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "diary.txt").write_text("dear diary")
    with pytest.raises(InputError, match=r"mine: is there already and has no positions\.json"):
        pair_export.export(made, tmp_path / "mine")


# --- truth by a method


def test_truth_by_a_method_is_what_the_method_makes(exported: Path, tmp_path: Path) -> None:
    made, built = build(tmp_path / "c", exported / "words")
    assert built.truth == made.truth_kind == f"method {METHOD}"
    assert made.head["truth_from"] == {"cutter": "pose-velocity", "transition": "hermite", "bundle": None}
    assert (len(made), made.signers, made.head["moved"]) == (25, (), True)
    cutter, _, transition = METHOD.partition("+")
    judged = protocol.choose(made, "random")
    scores = protocol.judge(ClipAnswers(made, ClipMethod(cutter, transition)), made, judged).scores
    assert scores["paa"] == scores["bleu-4"] == 1.0
    assert scores["accuracy"] == pytest.approx(1.0, abs=1e-5)
    assert scores["position_error"] < 0.01
    other = protocol.judge(ClipAnswers(made, ClipMethod("ends", transition)), made, judged).scores
    assert other["paa"] < 1.0


def test_methods_are_checked_by_name(exported: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"--positions hermite, expected a file of positions .* CUTTER\+TRANSITION"):
        build(tmp_path / "c", exported / "words", "hermite")
    with pytest.raises(InputError, match="no cutter 'guess', expected one of"):
        build(tmp_path / "c", exported / "words", "guess+hermite")
    with pytest.raises(InputError, match=r"expected one of .*, learned, learned-fluent$"):
        build(tmp_path / "c", exported / "words", "guess+hermite")
    with pytest.raises(InputError, match=r"--transition nope goes with --positions FILE\.json"):
        build(tmp_path / "c", exported / "words", transition="nope")
    with pytest.raises(InputError, match="no transition 'nope', expected one of"):
        build(tmp_path / "c", exported / "words", exported / "positions.json", transition="nope")


def test_what_is_refused_while_pairs_are_made_leaves_nothing(
    exported: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(own_words, "LONGEST", 0)
    with pytest.raises(InputError, match="0 pairs are too few"):
        build(tmp_path / "c", exported / "words")
    assert not list(tmp_path.iterdir())


# --- positions from a file


def test_positions_by_word_are_filled_by_a_method(exported: Path, words: dict[str, Clip], tmp_path: Path) -> None:
    given = [{"word": gloss, "pre": len(clip) - 9, "post": 6 + k} for k, (gloss, clip) in enumerate(words.items())]
    own = {"before": "SIGN", "after": "DEAF", "pre": 8, "post": 9}
    made, built = build(tmp_path / "c", exported / "words", positions(tmp_path, words=given, pairs=[own]))
    assert built.n_pairs == 25
    for p, q, pre, post, _, count in made.index.tolist():
        before, after = GLOSSES[p], GLOSSES[q]
        expected = (8, 9) if (before, after) == ("SIGN", "DEAF") else (given[p]["pre"], given[q]["post"])
        assert (pre, post) == expected
        assert count >= 1
    assert made.head["truth_from"]["filled_by"]["transition"] == "hermite"


def test_frames_are_counted_at_the_rate_of_the_files(exported: Path, tmp_path: Path) -> None:
    made, _ = build(tmp_path / "c", exported / "words", exported / "positions.json", fps=2.0 * FPS)
    index, like = np.array(made.index), np.array(corpus().index[:25])
    np.testing.assert_array_equal(index[:, 2:4], 2 * like[:, 2:4])
    np.testing.assert_array_equal(index[:, 5], 2 * like[:, 5] + 1)
    number = 7
    np.testing.assert_allclose(made.truth(number)[2][1::2], corpus().truth(number)[2], atol=1e-5)
    assert (
        np.abs(np.diff(made.utterance(number), axis=0)).max()
        < np.abs(np.diff(corpus().utterance(number), axis=0)).max()
    )


def test_pairs_without_positions_are_left_out(exported: Path, tmp_path: Path) -> None:
    rows = json.loads((exported / "positions.json").read_text())["pairs"]
    kept = [row | {"clip": str(exported / row["clip"])} for row in rows if row["before"] != "YOU"]
    made, built = build(tmp_path / "c", exported / "words", positions(tmp_path, pairs=kept))
    assert len(made) == 20
    assert any("gives no positions for 5 of 25 pairs; left out" in line for line in built.warnings)
    assert made.truth(15)[0] == corpus().truth(20)[0]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"pairs": [{"before": "SIGN", "after": "CAT", "pre": 1, "post": 2}]}, "has no clip of the word 'CAT', for"),
        ({"words": [{"word": g, "pre": 5, "post": 900} for g in GLOSSES]}, "post 900, but .* has .* frames, counted"),
        ({"words": [{"word": g, "pre": -1, "post": 9} for g in GLOSSES]}, r"words\[0\]: pre -1, expected a frame"),
        ({"words": [{"word": "SIGN", "pre": 5}]}, r"words\[0\]: has no post, expected word, pre, post"),
        ({"pairs": [{"before": "SIGN", "after": "YOU", "pre": 1.5, "post": 2}]}, r"pairs\[0\]\.pre: found 1\.5"),
        ({"pairs": 2 * [{"before": "YOU", "after": "YOU", "pre": 1, "post": 2}]}, r"pairs\[1\]: YOU YOU stands twice"),
        ({"words": 2 * [{"word": "YOU", "pre": 1, "post": 2}]}, r"words\[1\]: YOU stands twice"),
        ({"words": [{"word": "SIGN", "pre": 5, "post": 900}]}, r"positions\.json: words\[0\]: post 900, but "),
        ({"words": [{"word": "SIGN", "pre": 5, "post": 9}]}, r"positions\.json: names 1 words, expected at least 3"),
        (
            {"words": [{"word": "SIGN", "pre": 5, "post": 9, "past": 1}]},
            r"words\[0\]: unknown past, expected word, pre",
        ),
        (
            {"pairs": [{"before": "SIGN", "after": "YOU", "pre": 1, "post": 2, "clips": "a.bvh"}]},
            "unknown clips, expec",
        ),
        (
            {"pairs": [{"before": "SIGN", "after": "YOU", "pre": 1, "post": 2, "clip": "a.bvh"}]},
            r"\[0\]: clip a.bvh is n",
        ),
        ({"pear": []}, "unknown pear, expected an object"),
        ({}, "neither pairs nor words"),
        ({"words": [{"word": "SIGN", "pre": 5, "post": 3}], "space": {"side": 3}}, "space: 'middle'; expected joints"),
    ],
)
def test_wrong_positions_are_named(content: dict[str, Any], message: str, exported: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=message) as caught:
        build(tmp_path / "c", exported / "words", positions(tmp_path, **content))
    assert "\n" not in str(caught.value)
    assert [path.name for path in tmp_path.iterdir()] == ["positions.json"], "nothing hidden is left"


def test_frames_that_a_transition_lacks_are_named(exported: Path, tmp_path: Path) -> None:
    rows = json.loads((exported / "positions.json").read_text())["pairs"]
    broken = [row | {"clip": str(exported / row["clip"])} for row in rows]
    broken[3]["frames"] = [0, 9999]
    with pytest.raises(InputError, match=r"positions\.json: pairs\[3\]: frames 0:9999, but .*HELLO\.bvh has"):
        build(tmp_path / "c", exported / "words", positions(tmp_path, pairs=broken))


def test_commands_that_are_suggested_quote_paths(words: dict[str, Clip], tmp_path: Path) -> None:
    offsets = np.array(words["YOU"].skeleton.offsets)
    offsets[8] *= 1.1
    longer = replace(words["YOU"], skeleton=replace(words["YOU"].skeleton, offsets=offsets), channels=None)
    with pytest.raises(InputError, match=r"`signsplice convert '.*my words/YOU\.bvh' OUT --onto '.*my words/DEAF"):
        build(tmp_path / "c", written(tmp_path / "my words", words | {"YOU": longer}))


def test_sizes_below_a_megabyte_are_given_in_kilobytes() -> None:
    assert [size(n) for n in (12_345, 999_999, 1_000_000, 25_400_000)] == ["12 kB", "1000 kB", "1 MB", "25 MB"]


# --- writing


class StopHereError(Exception):
    pass


def test_an_interrupted_call_continues_to_the_same_corpus(
    exported: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole, _ = build(tmp_path / "whole", exported / "words")
    made: list[int] = []
    make_row = own_words._make_row

    def stop(*arguments: Any) -> None:
        if len(made) == 2:
            raise StopHereError
        made.append(arguments[2])
        make_row(*arguments)

    monkeypatch.setattr(own_words, "_make_row", stop)
    with pytest.raises(StopHereError):
        build(tmp_path / "c", exported / "words")
    assert not (tmp_path / "c").exists()
    assert (tmp_path / f".c-{whole.head['hash']}.part").is_dir()
    made[:] = []

    def go_on(*arguments: Any) -> None:
        made.append(arguments[2])
        make_row(*arguments)

    monkeypatch.setattr(own_words, "_make_row", go_on)
    build(tmp_path / "c", exported / "words")
    assert made == [2, 3, 4], "two rows were there"
    assert {path.name: path.read_bytes() for path in (tmp_path / "c").iterdir()} == {
        path.name: path.read_bytes() for path in whole.folder.iterdir()
    }
    assert sorted(path.name for path in tmp_path.iterdir()) == ["c", "whole"]


def test_transitions_that_are_too_long_are_left_out(
    exported: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    counts = np.array(corpus().index[:25, 5])
    longest = int(np.sort(counts)[-3])
    monkeypatch.setattr(own_words, "LONGEST", longest)
    made, built = build(tmp_path / "c", exported / "words", exported / "positions.json")
    n_long = int((counts > longest).sum())
    assert 0 < n_long <= 2
    assert len(made) == 25 - n_long
    assert any(f"{n_long} of 25 pairs have transitions of more than {longest} frames" in w for w in built.warnings)
    for k, number in enumerate(np.flatnonzero(counts <= longest).tolist()):
        assert made.index[k, :2].tolist() == corpus().index[number, :2].tolist()
        np.testing.assert_allclose(made.truth(k)[2], corpus().truth(number)[2], atol=1e-5)


def test_transitions_in_another_place_are_noticed(exported: Path, tmp_path: Path) -> None:
    clips = written(tmp_path / "w", {path.stem: load(path) for path in (exported / "transitions").iterdir()})
    first = clips / "000-HELLO.bvh"
    clip = load(first)
    save(replace(clip, root_positions=clip.root_positions + ASIDE, channels=None), first)
    content = json.loads((exported / "positions.json").read_text())
    for row in content["pairs"]:
        row["clip"] = f"w/{Path(row['clip']).name}"
    _, built = build(tmp_path / "c", exported / "words", positions(tmp_path, **content))
    assert any(line.startswith("5 of 25 transitions begin or end more than 40 cm") for line in built.warnings)


# --- what needs the synthetic signer


def test_a_corpus_of_clips_is_refused_where_events_are_needed(exported: Path, tmp_path: Path) -> None:
    made, _ = build(tmp_path / "c", exported / "words")
    with pytest.raises(InputError, match="its words are clips, whose signs and events are not known"):
        made.events(0)
    with pytest.raises(InputError, match="its words are clips"):
        training_data.write_split(made, "random", tmp_path / "s")
    assert not (tmp_path / "s").exists()


def test_numbers_that_are_not_the_spaces_are_refused(exported: Path, tmp_path: Path) -> None:
    made, _ = build(tmp_path / "c", exported / "words")
    np.save(made.folder / "new_positions.npy", np.zeros((3, 7), np.float32))
    with pytest.raises(InputError, match=r"new_positions\.npy: frames \(7,\), expected \(159,\)"):
        Pairs(made.folder)


def test_clip_methods_see_the_words_as_they_are(exported: Path, tmp_path: Path) -> None:
    made, _ = build(tmp_path / "c", exported / "words")
    clip = made.word_clip(3)
    np.testing.assert_allclose(made.spaces[0].to_numbers(clip), made.word(3), atol=1e-6)
    feet = kinematics.forward(clip, [clip.skeleton.index["mixamorig:LeftFoot"]])[1]
    assert np.abs(feet[..., 1]).max() < 5.0, "they stand on the ground"
