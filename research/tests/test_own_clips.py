"""Own clips brought to one place, unit, rate and rig, and what folders of them may not hold."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from signsplice.errors import InputError
from signsplice.formats import save
from signsplice.motion import Clip, Skeleton, bone_translations, resample, rotation
from signsplice_paper import protocol
from signsplice_paper.prediction import Prediction
from test_own_words import FPS, build, written
from toys import GLOSSES

pytest_plugins = ("own_words_toys",)
ASIDE = np.array([80.0, 0.0, -40.0])


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
    np.testing.assert_allclose(space.to_numbers(made.word_clip(1)), made.word(1), atol=1e-6)

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
