"""rig.rest_pose: rigs whose zero pose shows no person, or another than that of the first clip."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import signsplice as ss
from known_rigs import RIGS, skeleton_of
from other_rigs import on_other_rig, with_rest_pose
from signsplice.body.retarget import align
from signsplice.errors import InputError
from signsplice.motion import Clip, FloatArray, kinematics, rotation
from signsplice.rig import rest_pose
from signsplice.rig.align import reference
from signsplice.rig.info import rig_info
from signsplice.rig.inspection import clip_warnings
from signsplice.rig.rest_pose import rest_frame, rests_as_person


def with_random_axes(clip: Clip, seed: int = 0, most: float = np.pi) -> Clip:
    """The same motion with the axes of each joint turned at random by ``most`` radians at most."""
    rng = np.random.default_rng(seed)
    turns = {name: rng.normal(size=3) for name in clip.skeleton.names}
    turned = {name: tuple(most * rng.uniform() * v / np.linalg.norm(v)) for name, v in turns.items()}
    return replace(with_rest_pose(clip, turned), name="turned")


def positions(clip: Clip) -> FloatArray:
    """Global positions (T, J, 3) of all joints."""
    return kinematics.forward(clip)[1]


def without_sizes(clip: Clip) -> Clip:
    """The clip on a body whose arms are a tenth longer."""
    offsets = np.array(clip.skeleton.offsets)
    for joint, name in enumerate(clip.skeleton.names):
        offsets[joint] *= 1.1 if name.endswith(("ForeArm", "Hand")) else 1.0
    return replace(clip, skeleton=replace(clip.skeleton, offsets=offsets), name="longer arms")


@pytest.mark.parametrize("pose", ["T", "arms down", "arms forward", "arms up", "legs apart", "on its back"])
def test_usual_rest_poses_are_a_persons_and_nothing_changes(pose: str, words: dict[str, Clip]) -> None:
    clip = words["SIGN"]
    turn = {
        "T": {},
        "arms down": {"mixamorig:LeftArm": (0.0, 0.0, -1.4), "mixamorig:RightArm": (0.0, 0.0, 1.4)},
        "arms forward": {"mixamorig:LeftArm": (0.0, -1.5, 0.0), "mixamorig:RightArm": (0.0, 1.5, 0.0)},
        "arms up": {"mixamorig:LeftArm": (0.0, 0.0, 1.4), "mixamorig:RightArm": (0.0, 0.0, -1.4)},
        "legs apart": {"mixamorig:LeftUpLeg": (0.0, 0.0, 0.4), "mixamorig:RightUpLeg": (0.0, 0.0, -0.4)},
        "on its back": {"mixamorig:Hips": (-1.57, 0.0, 0.0)},
    }[pose]
    other = with_rest_pose(clip, turn)
    assert rests_as_person(other.skeleton)
    assert rest_pose.with_rest_pose(other) is other
    assert clip_warnings(other) == ()


@pytest.mark.parametrize("rig", sorted(RIGS))
def test_a_rig_without_sizes_is_taken_for_a_person(rig: str) -> None:
    assert rests_as_person(skeleton_of(*RIGS[rig][1])[0])


@pytest.mark.parametrize("seed", range(4))
def test_the_first_frame_that_shows_a_person_is_the_rest_pose(seed: int, words: dict[str, Clip]) -> None:
    other = with_random_axes(words["SIGN"], seed)
    assert not rests_as_person(other.skeleton)
    local = np.concatenate([np.tile(rotation.IDENTITY, (2, len(other.skeleton), 1)), other.local_rotations])
    late = replace(
        other, local_rotations=local, root_positions=np.concatenate([other.root_positions[:2], other.root_positions])
    )
    rested = rest_pose.with_rest_pose(late)
    assert rest_frame(late) == rest_frame(rested) == 2
    assert rested.skeleton.rest_pose is not None
    assert np.array_equal(rested.skeleton.rest_pose, late.local_rotations[2])
    assert np.array_equal(rested.local_rotations, late.local_rotations), "the file's own numbers do not change"
    line = "the zero pose shows no person: frame 2 is taken as rest pose; rest_frame names another"
    assert line in clip_warnings(late)
    assert rest_frame(rest_pose.with_rest_pose(late, 9)) == 9
    with pytest.raises(InputError, match=f"turned: no frame 900 to be its rest pose, expected 0 to {len(late) - 1}"):
        rest_pose.with_rest_pose(late, 900)


def test_a_clip_that_never_shows_a_person_is_named(words: dict[str, Clip]) -> None:
    other = with_random_axes(words["SIGN"])[:3]
    heap = replace(other, local_rotations=np.tile(rotation.IDENTITY, (3, len(other.skeleton), 1)))
    assert rest_pose.with_rest_pose(heap) is heap
    assert "neither its zero pose nor any frame shows a person: its rest pose is not known" in clip_warnings(heap)


@pytest.mark.parametrize("most", [0.1, 0.4, np.pi])
@pytest.mark.parametrize("names", ["the same", "others"])
def test_on_one_body_every_joint_lies_where_it_lay_whatever_the_axes(
    most: float, names: str, words: dict[str, Clip]
) -> None:
    clip = words["SIGN"]
    roles = rig_info(clip.skeleton).roles.joints
    vrm = {clip.skeleton.names[joint]: role for role, joint in roles.items()} if names == "others" else None
    other = on_other_rig(with_random_axes(clip, most=most), rotation.exp([-np.pi / 2, 0.0, 0.0]), 0.0123, vrm)
    out = align(rest_pose.with_rest_pose(other), reference(clip))
    known = sorted(roles.values())
    assert np.abs(positions(out.clip)[:, known] - positions(clip)[:, known]).max() < 0.02, "a fifth of a millimetre"
    assert out.contacts == (), "nothing was fitted"
    back = align(clip, reference(rest_pose.with_rest_pose(other))).clip
    assert np.abs(positions(back)[:, known] - positions(other)[:, known]).max() < 0.0003


def test_axes_of_a_trunk_that_bones_do_not_show_are_named(words: dict[str, Clip]) -> None:
    first, clip = words["HELLO"], words["SIGN"]
    line = "turned: joints have other axes than those of HELLO: frame 0 is taken as its rest pose"
    assert align(with_random_axes(clip, most=0.3), reference(first)).warnings == (line,)
    lowered = with_rest_pose(clip, {"mixamorig:LeftArm": (0.0, 0.0, -0.7), "mixamorig:RightArm": (0.0, 0.0, 0.7)})
    assert align(lowered, reference(first)).warnings == (), "arms that rest lower are no other axes"


def test_on_another_body_a_heap_at_zero_signs_as_it_does_with_usual_axes(words: dict[str, Clip]) -> None:
    clip = without_sizes(words["SIGN"])
    to = reference(words["HELLO"])
    usual, turned = (align(other, to).clip for other in (clip, rest_pose.with_rest_pose(with_random_axes(clip))))
    arms = rig_info(usual.skeleton).arm_joints[:6]
    apart = np.linalg.norm(positions(usual)[:, arms] - positions(turned)[:, arms], axis=-1)
    assert apart.max() < 3.0, "cm; the trunk of frame 0 leans a little"


@pytest.mark.parametrize("first", ["turned", "usual"])
def test_a_first_clip_of_any_axes_keeps_its_numbers(first: str, words: dict[str, Clip]) -> None:
    turned = with_random_axes(words["HELLO"])
    clips = [turned, words["SIGN"]] if first == "turned" else [words["SIGN"], turned]
    result = ss.splice(clips, ss.SpliceOptions(person=0.0, free_hand="transition"))
    begin = result.spans[0]
    assert np.array_equal(result.clip.local_rotations[: begin.output[1]], clips[0].local_rotations[: begin.output[1]])
    assert max(seam.seconds for seam in result.seams) < 0.8, "both are taken for one person"


@pytest.mark.parametrize("factor", [1e-6, 1e-3, 0.02, 0.39, 3.0, 7.0, 1e3])
def test_units_without_a_name_change_nothing(factor: float, words: dict[str, Clip]) -> None:
    clip = words["DEAF"]
    other = replace(on_other_rig(clip, np.asarray(rotation.IDENTITY), factor), name=clip.name)
    result, usual = (ss.splice([words["HELLO"], second]) for second in (other, clip))
    assert len(result.clip) == len(usual.clip)
    assert np.abs(positions(result.clip) - positions(usual.clip)).max() < 1e-3, "cm"
    unit = rig_info(other.skeleton).sizes.unit
    assert 0.5 <= unit.stature_m <= 2.8
    assert any("unit" in line for line in result.warnings) == (
        not 1.2 <= unit.stature_m <= 2.3 or unit.name == "unknown"
    )


def test_sides_that_are_exchanged_are_named(words: dict[str, Clip]) -> None:
    clip = words["SIGN"]
    flip = np.array([-1.0, 1.0, 1.0])
    mirrored = replace(
        clip,
        skeleton=replace(clip.skeleton, offsets=clip.skeleton.offsets * flip),
        local_rotations=clip.local_rotations * [1.0, -1.0, -1.0, 1.0],
        root_positions=clip.root_positions * flip,
    )
    line = "the hands sign behind the body: left and right are exchanged, or the rig is mirrored"
    assert clip_warnings(mirrored) == (line,)
    assert f"SIGN: {line}" in ss.splice([words["HELLO"], mirrored]).warnings


def test_no_word_that_ships_has_a_warning() -> None:
    with ss.open_lexicon() as lexicon:
        assert {line for gloss in lexicon for line in clip_warnings(lexicon.clip(gloss))} == set()
