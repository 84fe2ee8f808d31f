"""Corpora of pairs from clips: those of an exported corpus are the same again, and whatever else folders hold."""

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
from signsplice.motion import kinematics, rotation
from signsplice.motion.clip import Clip, Skeleton, bone_translations, resample
from signsplice.synth import training_data
from signsplice.synth.pairs import FILES, Pairs
from signsplice_paper import clip_methods, own_words, pair_export, protocol
from signsplice_paper.clip_methods import ClipAnswers, ClipMethod
from signsplice_paper.own_clips import ClipChoice
from signsplice_paper.own_words import BuiltPairs, PairsPlan
from signsplice_paper.prediction import Prediction
from toys import GLOSSES, corpus

FPS = 15.0
ASIDE = np.array([80.0, 0.0, -40.0])
METHOD = "pose-velocity+hermite"
Title = Callable[[str], AbstractContextManager[None]]


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Words and truth of the first signer of the toy corpus as files."""
    folder = tmp_path_factory.mktemp("exported") / "clips"
    assert pair_export.export(corpus(), folder) == 25
    return folder


@pytest.fixture(scope="module")
def words(exported: Path) -> dict[str, Clip]:
    return {gloss: load(exported / "words" / f"{k:03d}-{gloss}.bvh") for k, gloss in enumerate(GLOSSES)}


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


# --- clips


def test_words_are_brought_to_one_place_and_unit(words: dict[str, Clip], tmp_path: Path) -> None:
    plain, _ = build(tmp_path / "c", written(tmp_path / "plain", words))
    turn = rotation.exp(np.array([0.0, 0.9, 0.0]))
    moved = {}
    for k, (gloss, clip) in enumerate(words.items()):
        local, roots = np.array(clip.local_rotations), clip.root_positions
        if k == 2:
            local[:, 0], roots = rotation.multiply(turn, local[:, 0]), rotation.rotate(turn, roots) + ASIDE
        bones = replace(clip.skeleton, offsets=0.01 * clip.skeleton.offsets, end_sites=())
        moved[gloss] = Clip(bones, local, 0.01 * roots, clip.fps, gloss)
    metres, _ = build(tmp_path / "m", written(tmp_path / "metres", moved))
    np.testing.assert_allclose(metres.words["positions"], plain.words["positions"], atol=1e-5)
    np.testing.assert_array_equal(metres.index, plain.index)
    np.testing.assert_allclose(metres.skeletons[0].offsets, plain.skeletons[0].offsets, atol=1e-4)
    assert np.abs(plain.words["positions"]).max() <= 0.5


def test_clips_of_other_rates_are_resampled(words: dict[str, Clip], tmp_path: Path) -> None:
    faster = {gloss: resample(clip, 2 * FPS) if gloss == "YOU" else clip for gloss, clip in words.items()}
    made, _ = build(tmp_path / "c", written(tmp_path / "w", faster))
    like, _ = build(tmp_path / "l", written(tmp_path / "p", words))
    np.testing.assert_allclose(made.words["positions"], like.words["positions"], atol=1e-5)


def test_bones_that_change_are_held_still(words: dict[str, Clip], tmp_path: Path) -> None:
    def loose(clip: Clip, size: float) -> Clip:
        translations = np.array(bone_translations(clip))
        translations[::5, 9] += size
        return replace(clip, translations=translations)

    changed = {gloss: loose(clip, 2.0) if gloss == "SEE" else clip for gloss, clip in words.items()}
    made, built = build(tmp_path / "c", written(tmp_path / "w", changed))
    like, _ = build(tmp_path / "l", written(tmp_path / "p", words))
    np.testing.assert_allclose(made.words["positions"], like.words["positions"], atol=1e-5)
    assert any("SEE.bvh: its bones change by up to 2 cm; they are held" in line for line in built.warnings)


def test_only_the_joints_that_are_named_are_seen(exported: Path, tmp_path: Path) -> None:
    names = ("Hips", "LeftArm", "LeftForeArm", "LeftHand", "RightArm", "RightForeArm", "RightHand")
    made, _ = build(tmp_path / "c", exported / "words", joints=names)
    space = made.spaces[0]
    assert tuple(name.removeprefix("mixamorig:") for name in space.joints) == names
    assert space.parents == (-1, 0, 1, 2, 0, 4, 5)
    assert made.words["positions"].shape[1] == made.new["positions"].shape[1] == 21
    assert made.words["rotations"].shape[1] == 53, "clips stay whole"
    np.testing.assert_allclose(space.numbers(made.word_clip(1)), made.word(1), atol=1e-6)

    def answer(number: int) -> Prediction:
        pre, post, frames = made.truth(number)
        return Prediction(pre, post, frames.astype(np.float64))

    scores = protocol.judge(answer, made, protocol.choose(made, "random")).scores
    assert scores["mse"] == 0.0
    assert scores["motion_ratio"] == pytest.approx(1.0)
    with pytest.raises(InputError, match="--joints: no joint 'Tail'; expected names like mixamorig:Hips"):
        build(tmp_path / "d", exported / "words", joints=("Hips", "Tail"))
    with pytest.raises(InputError, match="--joints: no joint 'lefthend'; nearest: LeftHand"):
        build(tmp_path / "d", exported / "words", joints=("Hips", "lefthend"))
    with pytest.raises(InputError, match="--joints: names no joint"):
        build(tmp_path / "d", exported / "words", joints=())
    with pytest.raises(InputError, match="leftHand, rightHand not among the joints of the numbers"):
        build(tmp_path / "d", exported / "words", joints=("Hips", "LeftArm"))


def test_another_rig_is_named(words: dict[str, Clip], tmp_path: Path) -> None:
    offsets = np.array(words["YOU"].skeleton.offsets)
    offsets[8] *= 1.1
    longer = replace(words["YOU"], skeleton=replace(words["YOU"].skeleton, offsets=offsets), channels=None)
    with pytest.raises(
        InputError, match=r"YOU\.bvh: another rig than .*DEAF\.bvh \(the bone to mixamorig:LeftArm differs"
    ):
        build(tmp_path / "c", written(tmp_path / "w", words | {"YOU": longer}))
    bones = words["SEE"].skeleton
    fewer = Skeleton(bones.names[:52], bones.parents[:52], bones.offsets[:52])
    short = Clip(fewer, words["SEE"].local_rotations[:, :52], words["SEE"].root_positions, FPS)
    with pytest.raises(
        InputError, match=r"SEE\.bvh: another rig than .*DEAF\.bvh \(52 joints, not 53 .*signsplice convert"
    ):
        build(tmp_path / "c", written(tmp_path / "v", words | {"SEE": short}))
    assert not (tmp_path / "c").exists()


def test_unreadable_files_few_words_and_unknown_rigs_are_named(words: dict[str, Clip], tmp_path: Path) -> None:
    folder = written(tmp_path / "w", words)
    (folder / "SEE.bvh").write_text("HIERARCHY\nROOT")
    with pytest.raises(InputError, match=r"SEE\.bvh"):
        build(tmp_path / "c", folder)
    with pytest.raises(InputError, match=r"--words 9, but .*w has 5 words$"):
        build(tmp_path / "c", folder, n_words=9)
    with pytest.raises(InputError, match=r"^--words 2, expected at least 3: a split has three parts"):
        build(tmp_path / "c", folder, n_words=2)
    with pytest.raises(InputError, match=r"two: 2 words, expected at least 3: a split has three parts"):
        build(tmp_path / "c", written(tmp_path / "two", dict(list(words.items())[:2])))
    bones = replace(words["YOU"].skeleton, names=tuple(f"bone{k}" for k in range(53)))
    strange = {gloss: replace(clip, skeleton=bones, channels=None) for gloss, clip in words.items()}
    with pytest.raises(InputError, match=r"DEAF\.bvh: its arms and hips are not known by joint names \(bone0, "):
        build(tmp_path / "c", written(tmp_path / "s", strange))
    save(words["YOU"], folder / "you.npz")
    with pytest.raises(InputError, match="gloss 'YOU' is that of "):
        build(tmp_path / "c", folder)
    assert not [path for path in tmp_path.iterdir() if path.name.startswith((".", "c"))], "nothing half-written"


def test_words_are_drawn_by_seed(exported: Path, tmp_path: Path) -> None:
    drawn = [build(tmp_path / f"c{k}", exported / "words", "ends+slerp", n_words=3, seed=k)[0] for k in range(4)]
    glosses = [tuple(row["gloss"] for row in made.head["words"]) for made in drawn]
    assert len(set(glosses)) > 1
    assert all(sorted(words, key=GLOSSES.index) == list(words) for words in glosses)
    assert len({made.head["hash"] for made in drawn}) == 4


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
    np.testing.assert_allclose(made.spaces[0].numbers(clip), made.word(3), atol=1e-6)
    feet = kinematics.forward(clip, [clip.skeleton.index["mixamorig:LeftFoot"]])[1]
    assert np.abs(feet[..., 1]).max() < 5.0, "they stand on the ground"
    assert len(clip_methods.classical_methods()) > 0
