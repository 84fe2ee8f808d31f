"""Motion that another rig has no joints for is never lost in silence, and a sentence takes the rig that loses least."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import signsplice as ss
from other_rigs import without
from signsplice import lexicon
from signsplice.body.capsules import Avatar
from signsplice.body.retarget import retarget
from signsplice.bulk.maker import MadeSentence, SentenceMaker
from signsplice.bulk.recipes import SentenceRecipe
from signsplice.lexicon import folder
from signsplice.motion import Clip, Skeleton, rotation
from signsplice.rig.align import choose_skeleton, placement
from signsplice.rig.info import rig_info
from signsplice.rig.roles import ROLES, body_parts
from signsplice.splicing.bulk_splice import splice_many
from signsplice.splicing.engine import SpliceOptions, SpliceResult, onto_avatar, splice, stream
from signsplice.splicing.report import describe

CASES = Path(__file__).parent.parent / "data/cases/fingers_lost"
QUICK = SpliceOptions("pose-velocity", "hermite", "tempo")
DIALS: dict[str, Any] = {"cutter": "pose-velocity", "transition": "hermite", "transition_time": "0.3"}
NAMES = ("nofingers", "onehand", "nohead", "fingers")


@pytest.fixture(scope="module")
def clips() -> dict[str, Clip]:
    return {name: ss.load(CASES / f"{name}.bvh") for name in NAMES}


def lost(name: str, onto: str, n_joints: int, parts: str) -> str:
    return f"{name}: {n_joints} joints have no counterpart on {onto}, their motion is lost: {parts}"


def held(name: str, onto: str, n_joints: int, parts: str) -> str:
    return f"{name}: no counterpart for {n_joints} joints of {onto}, which hold their pose: {parts}"


LOSSES = {
    "nofingers": (30, "fingers of both hands"),
    "onehand": (15, "fingers of the right hand"),
    "nohead": (2, "neck, head"),
}


@pytest.mark.parametrize("onto", LOSSES)
def test_a_clip_on_a_body_with_fewer_parts_says_what_is_lost(clips: dict[str, Clip], onto: str) -> None:
    n_joints, parts = LOSSES[onto]
    assert lost("fingers", onto, n_joints, parts) in retarget(clips["fingers"], clips[onto]).warnings
    assert held(onto, "fingers", n_joints, parts) in retarget(clips[onto], clips["fingers"]).warnings
    pieces = list(stream([clips[onto], clips["fingers"]], QUICK))
    assert lost("fingers", onto, n_joints, parts) in {line for piece in pieces for line in piece.warnings}


@pytest.mark.parametrize("first", LOSSES)
def test_a_sentence_takes_the_skeleton_that_loses_least_and_says_which(clips: dict[str, Clip], first: str) -> None:
    n_joints, parts = LOSSES[first]
    result = splice([clips[first], clips["fingers"]], QUICK)
    assert result.clip.skeleton is clips["fingers"].skeleton
    why = f"on that of {first} {parts} would lose their motion, on this one nothing"
    assert result.warnings[:2] == (
        f"the sentence is on the skeleton of fingers: {why}",
        held(first, "fingers", n_joints, parts),
    )
    assert describe(result)["skeleton"] == {"clip": 1, "name": "fingers", "why": why}
    sign = result.spans[-1] if result.spans[-1].kind == "sign" else result.spans[-2]
    assert sign.source is not None
    shown = result.clip.local_rotations[slice(*sign.output)][:, fingers_of(clips["fingers"])]
    assert np.array_equal(shown, clips["fingers"].local_rotations[slice(*sign.source)][:, fingers_of(clips["fingers"])])


def fingers_of(clip: Clip) -> list[int]:
    joints = [joint for role, joint in rig_info(clip.skeleton).roles.joints.items() if role.endswith("Proximal")]
    assert len(joints) == 10
    return joints


def test_neither_of_two_rigs_may_have_all_and_both_losses_are_told(clips: dict[str, Clip]) -> None:
    result = splice([clips["onehand"], clips["nohead"]], QUICK)
    assert result.skeleton is None, "a hand's fingers count less than neck and head"
    assert lost("nohead", "onehand", 15, "fingers of the right hand") in result.warnings
    assert held("nohead", "onehand", 2, "neck, head") in result.warnings


def test_the_place_of_the_first_clip_stays_in_any_unit(clips: dict[str, Clip]) -> None:
    first, big = clips["nofingers"], clips["fingers"]
    in_metres = replace(big, skeleton=replace(big.skeleton, offsets=0.01 * big.skeleton.offsets))
    in_metres = replace(in_metres, root_positions=0.01 * big.root_positions + [3.0, 0.0, 0.0])
    result = splice([first, in_metres], QUICK)
    assert result.clip.skeleton is in_metres.skeleton
    there, here = placement(first), placement(result.clip[: result.spans[0].output[1]])
    metres = rig_info(first.skeleton).sizes.unit.metres
    assert np.allclose(here.position, metres * there.position, atol=0.02), "2 cm, of 3 m"
    assert np.allclose(here.forward, there.forward, atol=0.05)


def test_equals_and_one_rig_keep_the_first_skeleton(clips: dict[str, Clip]) -> None:
    again = replace(clips["fingers"], skeleton=replace(clips["fingers"].skeleton))
    assert choose_skeleton([clips["fingers"], again, clips["nofingers"]]) == (0, "")
    result = splice([clips["fingers"], again], QUICK)
    assert result.skeleton is None
    assert "skeleton" not in describe(result)
    assert not any("skeleton" in line for line in result.warnings)


def test_many_sentences_at_once_take_the_same_skeletons(clips: dict[str, Clip]) -> None:
    sentences = [[clips["nofingers"], clips["fingers"]], [clips["nofingers"]], [clips["onehand"], clips["nohead"]]]
    for at_once, clips_of_one in zip(splice_many(sentences, QUICK), sentences, strict=True):
        alone = splice(clips_of_one, QUICK)
        assert isinstance(at_once, SpliceResult)
        assert (at_once.skeleton, at_once.warnings) == (alone.skeleton, alone.warnings)
        assert np.array_equal(at_once.clip.local_rotations, alone.clip.local_rotations)


def test_a_bulk_signer_says_what_its_body_loses(tmp_path: Path) -> None:
    with lexicon.building(tmp_path / "lex") as builder:
        for name, signer in (("nofingers", "kim"), ("fingers", "lee")):
            builder.add(ss.load(CASES / f"{name}.bvh"), name.upper(), signer=signer)
    with ss.open_lexicon(tmp_path / "lex") as words:
        (made,) = SentenceMaker(words).make([SentenceRecipe(("FINGERS", "NOFINGERS"), signer="kim", **DIALS)])
    assert isinstance(made, MadeSentence)
    assert lost("FINGERS", "NOFINGERS", 30, "fingers of both hands") in made.report()["warnings"]


def test_a_stream_has_the_skeleton_of_its_first_clip(clips: dict[str, Clip]) -> None:
    pieces = list(stream([clips["nofingers"], clips["fingers"]], QUICK))
    assert {id(piece.clip.skeleton) for piece in pieces} == {id(clips["nofingers"].skeleton)}


def test_the_body_that_the_user_names_overrules(clips: dict[str, Clip]) -> None:
    both = [clips["fingers"], clips["nofingers"]]
    result = splice(both, replace(QUICK, onto=clips["nohead"]))
    assert result.clip.skeleton is clips["nohead"].skeleton
    assert result.skeleton == {"clip": None, "name": "nohead", "why": "given by the user"}
    assert lost("fingers", "nohead", 2, "neck, head") in result.warnings
    assert lost("nofingers", "nohead", 2, "neck, head") in result.warnings
    onto_skeleton = splice(both, replace(QUICK, onto=clips["nohead"].skeleton)).clip
    assert onto_skeleton.skeleton is clips["nohead"].skeleton
    pieces = list(stream(both, replace(QUICK, onto=clips["nohead"])))
    assert np.array_equal(np.concatenate([piece.clip.local_rotations for piece in pieces]), result.clip.local_rotations)
    with pytest.raises(TypeError, match=r"onto is 'rig\.bvh', expected a clip"):
        splice(both, replace(QUICK, onto="rig.bvh"))  # type: ignore[arg-type]


def test_an_avatar_without_fingers_says_so_whatever_the_skeleton_of_the_sentence(clips: dict[str, Clip]) -> None:
    bare = clips["nofingers"].skeleton
    avatar = Avatar(bare.names, bare.parents, 0.01 * bare.offsets, label="A")
    result = onto_avatar(splice([clips["nofingers"], clips["fingers"]], QUICK), avatar)
    assert result.clip.skeleton is avatar
    assert lost("nofingers fingers", "A", 30, "fingers of both hands") in result.warnings


def test_a_rig_that_a_clip_cannot_be_brought_to_by_its_roles_is_not_chosen(clips: dict[str, Clip]) -> None:
    legs = without(clips["fingers"], "Arm", "Hand", "Shoulder")
    assert len(rig_info(legs.skeleton).roles.joints) > 10
    assert choose_skeleton([legs, clips["fingers"]]) == (0, "")
    assert choose_skeleton([clips["nofingers"], clips["fingers"], legs]) == (0, "")


def spoken(path: Path, glosses: str) -> SpliceResult:
    with ss.open_lexicon(path) as words:
        return splice([words.clip(gloss) for gloss in glosses.split()], QUICK)


def test_a_lexicon_or_folder_of_rigs_with_other_parts_is_warned_of(tmp_path: Path) -> None:
    lexicon.build(CASES, tmp_path / "lex")
    end = "; in a sentence with others, that motion is lost or held"
    lines = [
        "no fingers of both hands in 1 of 4 words: {}" + end,
        "no fingers of the right hand in 1 of 4 words: {}" + end,
        "no neck, head in 1 of 4 words: {}" + end,
    ]
    words = ("nofingers", "onehand", "nohead")
    checked = folder.check(CASES)
    expected = {f"{CASES}: {line.format(name)}" for line, name in zip(lines, words, strict=True)}
    assert expected == {line for line in checked.warnings if " in 1 of 4 words" in line}
    with ss.open_lexicon(tmp_path / "lex") as words_of_lexicon:
        stored = {line for line in words_of_lexicon.warnings() if " in 1 of 4 words" in line}
        first = words_of_lexicon.clip("NOFINGERS")
    assert {line.partition(": ")[2] for line in stored} == {
        line.format(name.upper()) for line, name in zip(lines, words, strict=True)
    }
    result = spoken(tmp_path / "lex", "NOFINGERS ONEHAND FINGERS")
    assert result.skeleton is not None
    assert (result.skeleton["clip"], result.skeleton["name"]) == (2, "FINGERS")
    assert len(result.clip.skeleton) > len(first.skeleton)


def test_one_rig_has_no_line_about_parts(clips: dict[str, Clip], tmp_path: Path) -> None:
    for name in ("a", "b"):
        ss.save(clips["nofingers"], tmp_path / f"{name}.bvh")
    assert folder.check(tmp_path).n_clips == 2
    assert not [line for line in folder.check(tmp_path).warnings if " words: " in line]


# --- what counts as lost ---


def with_chain(clip: Clip, parent: str, *names: str, turn: float = 0.0) -> Clip:
    """The clip with a chain of further joints below one of its own, which turn by ``turn``, radians, in the clip."""
    skeleton, n = clip.skeleton, len(clip.skeleton)
    parents = [*skeleton.parents.tolist(), skeleton.index[parent], *range(n, n + len(names) - 1)]
    offsets = np.vstack([skeleton.offsets, np.tile([0.0, 3.0, 0.0], (len(names), 1))])
    angles = np.linspace(0.0, turn, len(clip))
    added = np.tile(rotation.exp(angles[:, None] * [1.0, 0.0, 0.0])[:, None], (1, len(names), 1))
    return Clip(
        Skeleton((*skeleton.names, *names), np.array(parents), offsets),
        np.concatenate([clip.local_rotations, added], axis=1),
        clip.root_positions,
        clip.fps,
        "more",
    )


def losses(clip: Clip, onto: Clip) -> list[str]:
    return [line for line in retarget(clip, onto).warnings if "motion is lost" in line]


def test_joints_without_a_role_are_lost_if_they_move(clips: dict[str, Clip]) -> None:
    full = clips["fingers"]
    hand = full.skeleton.names[rig_info(full.skeleton).roles.joints["leftHand"]]
    assert losses(with_chain(full, hand, "Fan1", "Fan2"), full) == [], "they are still"
    assert losses(with_chain(full, hand, "Fan1", "Fan2", turn=0.5), full) == [lost("more", "fingers", 2, "Fan1, Fan2")]


def test_eyes_jaw_and_toes_are_lost_only_if_they_move(clips: dict[str, Clip]) -> None:
    full = clips["fingers"]
    head = full.skeleton.names[rig_info(full.skeleton).roles.joints["head"]]
    assert losses(with_chain(full, head, "LeftEye"), full) == []
    assert losses(with_chain(full, head, "LeftEye", turn=0.2), full) == [lost("more", "fingers", 1, "the left eye")]
    assert choose_skeleton([full, with_chain(full, head, "LeftEye")]) == (0, "")
    assert choose_skeleton([full, with_chain(full, head, "LeftEye", turn=0.2)])[0] == 1


def test_a_spine_of_fewer_joints_loses_nothing_that_shows(clips: dict[str, Clip]) -> None:
    full = clips["fingers"]
    short = without(full, "Spine2")
    assert set(rig_info(full.skeleton).roles.joints) - set(rig_info(short.skeleton).roles.joints) == {"upperChest"}
    assert losses(full, short) == []
    assert losses(full, without(full, "Neck")) == []


def test_fingers_of_other_names_on_a_body_of_the_same_names_keep_their_motion(clips: dict[str, Clip]) -> None:
    full = clips["fingers"]
    names = [name.replace("LeftHandIndex", "f_index.L.0") for name in full.skeleton.names]
    names = [name.replace("RightHandIndex", "f_index.R.0") for name in names]
    renamed = replace(full, skeleton=replace(full.skeleton, names=tuple(names)), name="renamed")
    assert sum("f_index" in name for name in names) == 6
    done = retarget(renamed, full)
    assert done.warnings == retarget(full, full).warnings == ()
    assert np.allclose(done.clip.local_rotations, full.local_rotations, atol=1e-9)


@pytest.mark.parametrize(
    ("roles", "parts"),
    [
        (["jaw", "neck"], ["jaw", "neck"]),
        (["hips", "spine", "chest"], ["trunk"]),
        (["leftShoulder"], ["the left shoulder"]),
        (["leftHand", "rightLowerArm"], ["both arms"]),
        (["rightUpperLeg", "leftToes", "rightToes"], ["the right leg", "both toes"]),
        (["leftThumbDistal"], ["fingers of the left hand"]),
        (["leftThumbDistal", "rightIndexProximal"], ["fingers of both hands"]),
        ([], []),
    ],
)
def test_roles_are_named_by_the_part_of_the_body(roles: Sequence[str], parts: list[str]) -> None:
    assert set(roles) <= set(ROLES)
    assert body_parts(roles) == parts
