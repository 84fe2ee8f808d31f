"""A corpus of pairs on disk: its layout and numbers, its splits, and that an interrupted call loses no work."""

from __future__ import annotations

import errno
import json
import os
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import GOLDEN

from signing import sign
from signsplice.errors import InputError
from signsplice.formats import atomic
from signsplice.motion import kinematics
from signsplice.signer import planner
from signsplice.signer.signer import STANDARD, draw_signer, skeleton
from signsplice_workshop.corpora import pairs as corpus
from signsplice_workshop.corpora import pseudo, truth
from signsplice_workshop.corpora.pairs import Pairs, Recipe, draw_splits, write_pairs
from signsplice_workshop.corpora.touches import measure_touches

GLOSSES = ("I", "MOTHER", "BOOK", "YES", "fs-A")
RECIPE = Recipe(tuple(map(sign, GLOSSES)), seed=0, n_other=7)
SMALL = Recipe(tuple(map(sign, GLOSSES[:3])), seed=2, fps=24.0, n_other=2)
FILES = {
    *("corpus.json", "pairs.npy"),
    *(f"{source}_{kind}.npy" for source in ("word", "new") for kind in ("rotations", "roots", "positions")),
}


@pytest.fixture(scope="module")
def pairs(tmp_path_factory: pytest.TempPathFactory) -> Pairs:
    return Pairs(write_pairs(RECIPE, tmp_path_factory.mktemp("corpus") / "pairs", processes=1))


def read_all(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


# --- contents


def test_layout_shapes_and_types(pairs: Pairs) -> None:
    assert {path.name for path in pairs.folder.iterdir()} == FILES
    assert len(pairs) == 25 + 7
    assert pairs.index.shape == (32, 6)
    assert pairs.index.dtype == np.int32
    rows = pairs.head["words"]
    assert [row["gloss"] for row in rows] == [*GLOSSES, *GLOSSES]
    assert [row["signer"] for row in rows] == ["standard"] * 5 + ["signer-1"] * 5
    n_frames, n_new = sum(row["frames"] for row in rows), int(pairs.index[:, 5].sum())
    for arrays, count in ((pairs.words, n_frames), (pairs.new, n_new)):
        assert arrays["rotations"].shape == (count, 53, 4)
        assert arrays["roots"].shape == (count, 3)
        assert arrays["positions"].shape == (count, 159)
        assert all(array.dtype == np.float32 for array in arrays.values())
        assert all(isinstance(array, np.memmap) for array in arrays.values())
    firsts = [row["first"] for row in rows]
    assert firsts == [0, *np.cumsum([row["frames"] for row in rows])[:-1].tolist()]
    assert pairs.index[:, 4].tolist() == [0, *np.cumsum(pairs.index[:, 5])[:-1].tolist()]


def test_all_ordered_pairs_of_one_signer_and_some_of_another(pairs: Pairs) -> None:
    both = [tuple(row) for row in pairs.index[:, :2].tolist()]
    assert both[:25] == list(product(range(5), repeat=2))
    assert len(set(both[25:])) == 7
    assert set(both[25:]) <= set(product(range(5, 10), repeat=2))
    assert pairs.signers == (STANDARD, draw_signer(1))


def test_words_and_transitions_are_those_of_planner_and_truth(pairs: Pairs) -> None:
    for number in (1, 7, 13, 22, 28):
        p, q = pairs.index[number, :2].tolist()
        signer = pairs.signers[p // 5]
        one, two = (planner.synthesize_word(RECIPE.signs[k % 5], signer) for k in (p, q))
        assert np.array_equal(pairs.word(p, "rotations"), one.clip.local_rotations.astype(np.float32))
        assert pairs.events(p) == measure_touches(one)
        assert pairs.events(q) == measure_touches(two)
        true = truth.splice(one, two)
        pre, post, new = pairs.truth(number, "rotations")
        assert (pre, post, len(new)) == (true.pre, true.post, len(true.states))
        whole = pairs.utterance(number, "rotations")
        assert np.array_equal(whole[: pre + 1], pairs.word(p, "rotations")[: pre + 1])
        assert np.array_equal(whole[pre + 1 : pre + 1 + len(new)], new)
        assert np.array_equal(whole[pre + 1 + len(new) :], pairs.word(q, "rotations")[post:])
        assert len(pairs.clip(number)) == len(whole)
        assert pairs.clip(number).name == f"{one.sign.gloss} {two.sign.gloss}"


def test_positions_are_scaled_forward_kinematics_of_the_rotations(pairs: Pairs) -> None:
    assert np.abs(pairs.words["positions"]).max() <= 0.5
    assert np.abs(pairs.new["positions"]).max() <= 0.5
    for number in (3, 17, 30):
        clip = pairs.clip(number)
        positions = kinematics.forward(clip)[1]
        height = pairs.signers[int(pairs.index[number, 0]) // 5].stature_cm
        scaled = (positions - [0.0, 0.5 * height, 0.0]) / (1.3 * height)
        assert np.abs(pairs.utterance(number) - scaled.reshape(len(clip), -1)).max() < 2e-6
        assert clip.skeleton is skeleton(pairs.signers[int(pairs.index[number, 0]) // 5])
    word = pairs.word_clip(6)
    assert word.name == "MOTHER"
    assert word.fps == 30.0
    assert len(word) == len(pairs.word(6))


# --- splits


def test_the_random_split_has_every_pair_once(pairs: Pairs) -> None:
    parts = [pairs.split("random", part) for part in ("train", "valid", "test")]
    assert sorted([*parts[0], *parts[1], *parts[2]]) == list(range(25))
    assert [len(part) for part in parts] == [20, 2, 3]


def test_unseen_words_are_in_no_pair_of_another_part() -> None:
    n = 30
    recipe = replace(RECIPE, signs=tuple(pseudo_like(k) for k in range(n)))
    all_pairs = [(0, p, q) for p in range(n) for q in range(n)] + [(1, 0, 1), (1, 2, 2)]
    made = draw_splits(recipe.seed, n, all_pairs)["unseen-words"]
    words = {part: {w for k in numbers for w in all_pairs[k][1:]} for part, numbers in made.items()}
    assert [len(words[part]) for part in ("train", "valid", "test")] == [21, 3, 6]
    assert set.union(*words.values()) == set(range(n))
    assert not words["train"] & words["test"]
    assert not words["train"] & words["valid"]
    assert not words["valid"] & words["test"]
    for part, numbers in made.items():
        assert len(numbers) == len(words[part]) ** 2, "every pair of its words"
        assert all(all_pairs[k][0] == 0 for k in numbers)


def pseudo_like(k: int) -> Any:
    return replace(sign("I"), gloss=f"W{k}")


def test_the_unseen_signer_is_in_the_test_part_alone(pairs: Pairs) -> None:
    assert pairs.split("unseen-signer", "test") == list(range(25, 32))
    assert pairs.split("unseen-signer", "train") == pairs.split("random", "train")
    assert pairs.split("unseen-signer", "valid") == pairs.split("random", "valid")


def test_splits_are_drawn_by_seed() -> None:
    every = [(0, p, q) for p in range(12) for q in range(12)]
    one, two, three = (draw_splits(seed, 12, every) for seed in (0, 0, 1))
    assert one == two
    assert one["random"] != three["random"]
    assert one["unseen-words"] != three["unseen-words"]


def test_names_of_splits_are_checked(pairs: Pairs) -> None:
    for name, part in (("nothing", "train"), ("random", "dev")):
        with pytest.raises(InputError, match=f"no split {name} {part}, expected one of random, unseen-words"):
            pairs.split(name, part)


# --- the recipe


def test_the_hash_depends_on_every_field_of_the_recipe() -> None:
    other_sign = replace(RECIPE.signs[0], segments=RECIPE.signs[0].segments[:-1])
    hashes = [
        recipe.hash
        for recipe in (
            RECIPE,
            replace(RECIPE, seed=1),
            replace(RECIPE, fps=25.0),
            replace(RECIPE, n_other=8),
            replace(RECIPE, truth="word"),
            replace(RECIPE, signs=RECIPE.signs[:4]),
            replace(RECIPE, signs=RECIPE.signs[::-1]),
            replace(RECIPE, signs=(other_sign, *RECIPE.signs[1:])),
        )
    ]
    assert len(set(hashes)) == len(hashes)
    assert Recipe(tuple(map(sign, GLOSSES)), seed=0, n_other=7).hash == hashes[0]
    assert all(len(h) == 12 and set(h) <= set("0123456789abcdef") for h in hashes)


def test_the_head_names_version_hash_seed_and_rate(pairs: Pairs) -> None:
    head = json.loads((pairs.folder / "corpus.json").read_text())
    assert (head["version"], head["hash"], head["seed"], head["fps"]) == (corpus.VERSION, RECIPE.hash, 0, 30.0)
    assert head["truth"] == "partner"
    assert head["extent"] == 1.3


def test_every_seed_has_its_own_two_signers() -> None:
    assert RECIPE.signers() == (STANDARD, draw_signer(1))
    assert SMALL.signers() == (draw_signer(4), draw_signer(5))
    names = [signer.name for seed in range(10) for signer in replace(RECIPE, seed=seed).signers()]
    assert len(set(names)) == 20


def test_the_golden_splice_is_still_signed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Positions to 1e-6 cm, frames exactly: the same seeds make the same motion on every machine."""
    monkeypatch.syspath_prepend(str(GOLDEN))
    from make_true_splice import signed

    found, golden = signed(), json.loads((GOLDEN / "true_splice.json").read_text())
    positions, expected = found.pop("places"), golden.pop("places")
    assert found == golden
    assert positions.keys() == expected.keys()
    for frame in expected:
        assert np.abs(np.array(positions[frame]) - expected[frame]).max() < 1e-6


# --- writing: again, interrupted, refused


class StopHereError(Exception):
    pass


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    return read_all(write_pairs(SMALL, tmp_path_factory.mktemp("whole") / "c", processes=1))


@pytest.mark.parametrize("after", [3, 9, 11])
def test_an_interrupted_call_continues_to_the_same_corpus(after: int, whole: dict[str, bytes], tmp_path: Path) -> None:
    reported: list[tuple[int, int]] = []

    def stop(done: int, total: int) -> None:
        reported.append((done, total))
        if done >= after:
            raise StopHereError

    with pytest.raises(StopHereError):
        write_pairs(SMALL, tmp_path / "c", stop, processes=1)
    assert not (tmp_path / "c").exists()
    assert [path.name for path in tmp_path.iterdir()] == [f".c-{SMALL.hash}.part"]
    first = len(reported)
    write_pairs(SMALL, tmp_path / "c", lambda done, total: reported.append((done, total)), processes=1)
    assert read_all(tmp_path / "c") == whole
    assert [path.name for path in tmp_path.iterdir()] == ["c"]
    later = reported[first:]
    if later:
        assert later[0][0] > reported[first - 1][0], "it continues from where it was"
        assert later[-1] == (11, 11)
    assert len(reported) == 4, "three rows of one signer, one of the other, each made once"


def test_a_second_call_replaces_a_corpus_with_the_same_bytes(whole: dict[str, bytes], tmp_path: Path) -> None:
    write_pairs(replace(SMALL, signs=SMALL.signs[:2], n_other=0), tmp_path / "c", processes=1)
    assert read_all(tmp_path / "c") != whole
    write_pairs(SMALL, tmp_path / "c", processes=1)
    assert read_all(tmp_path / "c") == whole
    assert [path.name for path in tmp_path.iterdir()] == ["c"]


@pytest.mark.parametrize(("function", "call"), [("savez", 2), ("savez", 4), ("save", 4)])
def test_a_full_disk_leaves_the_old_corpus_and_finished_rows(
    function: str, call: int, whole: dict[str, bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    old = read_all(write_pairs(replace(SMALL, signs=SMALL.signs[:1], n_other=0), tmp_path / "c", processes=1))
    real = getattr(np, function)
    calls = 0

    def full(*arguments: Any, **arrays: Any) -> None:
        nonlocal calls
        calls += 1
        if calls == call:
            raise OSError(errno.ENOSPC, "No space left on device")
        real(*arguments, **arrays)

    with monkeypatch.context() as patch:
        patch.setattr(np, function, full)
        with pytest.raises(InputError, match=r"cannot be written .No space left on device") as caught:
            write_pairs(SMALL, tmp_path / "c", processes=1)
    assert str(caught.value).startswith(f"{tmp_path / 'c'}: ")
    assert "the same call continues from there" in str(caught.value)
    assert "\n" not in str(caught.value)
    assert read_all(tmp_path / "c") == old
    write_pairs(SMALL, tmp_path / "c", processes=1)
    assert read_all(tmp_path / "c") == whole


def test_a_folder_of_something_else_is_not_replaced(tmp_path: Path) -> None:
    mine = tmp_path / "mine"
    mine.mkdir()
    (mine / "diary.txt").write_text("dear diary")
    with pytest.raises(InputError, match=r"mine: is there already and has no corpus\.json; choose a new name"):
        write_pairs(SMALL, mine, processes=1)
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]
    with pytest.raises(InputError, match=r"folder .* does not exist; make it first"):
        write_pairs(SMALL, tmp_path / "no" / "c", processes=1)
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="file: is there already"):
        write_pairs(SMALL, tmp_path / "file", processes=1)
    with pytest.raises(InputError, match="is a mount point, which cannot be replaced; name a folder within it"):
        write_pairs(SMALL, Path("/"), processes=1)


def test_a_file_beside_a_corpus_is_not_lost(whole: dict[str, bytes], tmp_path: Path) -> None:
    for name, content in (whole | {"notes.txt": b"mine"}).items():
        (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=r"holds notes\.txt beside its corpus\.json, which would be lost"):
        write_pairs(SMALL, tmp_path, processes=1)
    assert read_all(tmp_path) == whole | {"notes.txt": b"mine"}


def test_an_empty_folder_becomes_the_corpus(whole: dict[str, bytes], tmp_path: Path) -> None:
    (tmp_path / "c").mkdir()
    write_pairs(SMALL, tmp_path / "c", processes=1)
    assert read_all(tmp_path / "c") == whole


def test_reading_refuses_what_is_no_corpus(pairs: Pairs, tmp_path: Path) -> None:
    with pytest.raises(
        InputError, match=r"has no corpus\.json, expected a corpus of pairs \(`signsplice synth pairs`\)"
    ):
        Pairs(tmp_path)
    copy = tmp_path / "copy"
    copy.mkdir()
    for path in pairs.folder.iterdir():
        (copy / path.name).write_bytes(path.read_bytes())
    assert len(Pairs(copy)) == 32
    head = json.loads((copy / "corpus.json").read_text())
    (copy / "corpus.json").write_text(json.dumps(head | {"version": 99}))
    with pytest.raises(InputError, match="version 99, expected 1 to 4; make it again"):
        Pairs(copy)
    for damaged in ("{", "[]"):
        (copy / "corpus.json").write_text(damaged)
        with pytest.raises(InputError, match=r"is no corpus of pairs .*make one with `signsplice synth pairs`"):
            Pairs(copy)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with names")
def _broken(head: dict[str, Any], index: np.ndarray, what: str) -> tuple[dict[str, Any], np.ndarray]:
    index = index.copy()
    if what == "a word beyond":
        index[0, 1] = len(head["words"])
    elif what == "a cut beyond":
        index[0, 2] = head["words"][index[0, 0]]["frames"]
    elif what == "a transition beyond":
        index[-1, 4] += 1
    elif what == "a pair beyond":
        head["splits"]["random"]["test"].append(len(index))
    elif what == "five columns":
        index = index[:, :5]
    elif what == "no gloss":
        head["words"][1]["gloss"] = None
    else:
        head["words"][0]["first"] = -1
    return head, index


@pytest.mark.parametrize(
    ("what", "message"),
    [
        ("a word beyond", "words of pairs: a number lies beyond"),
        ("a cut beyond", "cuts: a number lies beyond"),
        ("a transition beyond", "transitions: a number lies beyond"),
        ("a pair beyond", "splits: a number lies beyond"),
        ("five columns", r"pairs\.npy: int32 \(11, 5\), expected whole numbers \(P, 6\)"),
        ("no gloss", "words: .*expected"),
        ("a frame before", "words: a number lies beyond"),
    ],
)
def test_numbers_that_lead_out_of_the_arrays_are_refused(
    what: str, message: str, whole: dict[str, bytes], tmp_path: Path
) -> None:
    for name, content in whole.items():
        (tmp_path / name).write_bytes(content)
    head, index = _broken(json.loads(whole["corpus.json"]), np.load(tmp_path / "pairs.npy"), what)
    (tmp_path / "corpus.json").write_text(json.dumps(head))
    np.save(tmp_path / "pairs.npy", index)
    with pytest.raises(InputError, match=message):
        Pairs(tmp_path)


@pytest.mark.parametrize("name", ["corpus.json", "pairs.npy", "word_roots.npy", "new_roots.npy"])
def test_a_pipe_in_a_corpus_is_refused_at_once(name: str, pairs: Pairs, tmp_path: Path) -> None:
    for path in pairs.folder.iterdir():
        (tmp_path / path.name).symlink_to(path)
    (tmp_path / name).unlink()
    os.mkfifo(tmp_path / name)
    with pytest.raises(InputError, match=f"{name}: is a pipe, expected a regular file"):
        Pairs(tmp_path)


def test_pseudo_signs_make_a_corpus_too(tmp_path: Path) -> None:
    recipe = Recipe(tuple(pseudo.draw_sign(k) for k in range(2)), seed=1, n_other=0)
    made = Pairs(write_pairs(recipe, tmp_path / "c", processes=1))
    assert len(made) == 4
    assert made.split("unseen-signer", "test") == []
    assert np.isfinite(made.new["rotations"]).all()


@pytest.mark.parametrize("left", [0.0, 0.5, 0.99, "zeros"])
def test_a_damaged_row_is_made_anew(left: float | str, whole: dict[str, bytes], tmp_path: Path) -> None:
    class Done(Exception):  # noqa: N818
        pass

    def stop(done: int, total: int) -> None:
        if done == total:
            raise Done

    with pytest.raises(Done):
        write_pairs(SMALL, tmp_path / "c", stop, processes=1)
    row = sorted((tmp_path / f".c-{SMALL.hash}.part").glob("row-*.npz"))[1]
    content = row.read_bytes()
    if isinstance(left, float):
        row.write_bytes(content[: int(left * len(content))])
    else:  # a block that never reached the disk
        row.write_bytes(content[:200] + bytes(512) + content[712:])
    reported: list[tuple[int, int]] = []
    write_pairs(SMALL, tmp_path / "c", lambda done, total: reported.append((done, total)), processes=1)
    assert read_all(tmp_path / "c") == whole
    assert reported == [(11, 11)], "one row was made"
    assert [path.name for path in tmp_path.iterdir()] == ["c"]


def test_two_calls_do_not_make_one_corpus_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(atomic, "_WAIT_S", 0.0)
    part = tmp_path / f".c-{SMALL.hash}.part"
    with atomic.resumable_folder(part), pytest.raises(InputError, match=r"\.part: another process is writing there"):
        write_pairs(SMALL, tmp_path / "c", processes=1)
    write_pairs(SMALL, tmp_path / "c", processes=1)
    assert [path.name for path in tmp_path.iterdir()] == ["c"]
