"""body.retarget: clips on other bodies keep the places and contacts of hands."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import signsplice as ss
from other_rigs import on_other_rig
from signsplice.body import arm_ik
from signsplice.body import retarget as module
from signsplice.body.capsules import body_capsules
from signsplice.body.collision import near_pairs, overlap, pair_clearances, skin_pairs
from signsplice.body.contacts import Contact, pose_body
from signsplice.body.retarget import retarget, signing
from signsplice.cli.commands import app
from signsplice.formats import load, save
from signsplice.lexicon import open_shipped_lexicon
from signsplice.motion import Clip, FloatArray, Skeleton, concatenate, kinematics, rotation
from signsplice.rig.align import copy_rotations, reference
from signsplice.rig.info import rig_info
from signsplice.splicing import report as reports

BODIES = {"narrow": (0.7, 0.85), "broad": (1.4, 0.9), "long": (1.1, 1.2)}
WORDS = ("NAME", "MY", "MOTHER", "FAMILY", "THINK")


def word(gloss: str) -> Clip:
    return open_shipped_lexicon().clip(gloss)


def stretched(skeleton: Skeleton, shoulders: float, arms: float) -> Skeleton:
    """A skeleton with wider shoulders and longer arms; its rest pose is the T-pose."""
    offsets = np.array(skeleton.offsets)
    for side in ("Left", "Right"):
        for name in ("Shoulder", "Arm"):
            offsets[skeleton.index[f"mixamorig:{side}{name}"], 0] *= shoulders
        for name in ("ForeArm", "Hand"):
            offsets[skeleton.index[f"mixamorig:{side}{name}"]] *= arms
    return replace(skeleton, offsets=offsets)


def other_body(clip: Clip, name: str) -> Clip:
    """The clip's rotations on one of ``BODIES``."""
    return replace(clip, skeleton=stretched(clip.skeleton, *BODIES[name]), channels=None, name=name)


def test_the_same_body_is_left_as_it_is() -> None:
    clip = word("NAME")
    done = retarget(clip, replace(clip, name="another"))
    assert done.clip is clip
    assert (done.warnings, done.contacts) == ((), ())
    nearly = replace(clip.skeleton, offsets=clip.skeleton.offsets * 1.0004)
    np.testing.assert_array_equal(retarget(clip, nearly).clip.local_rotations, clip.local_rotations)


@pytest.mark.parametrize("name", BODIES)
@pytest.mark.parametrize("gloss", WORDS)
def test_contacts_are_kept_where_rotations_lose_them(gloss: str, name: str) -> None:
    clip = word(gloss)
    onto = other_body(clip, name)
    done = retarget(clip, onto)
    assert done.contacts
    assert all(one.is_kept for one in done.contacts), done.contacts
    assert distances(clip, copy_rotations(clip, reference(onto))[0]).max() > 0.005, "5 mm"
    assert np.quantile(distances(clip, done.clip), 0.95) < 0.005
    assert deepest(done.clip) < deepest(clip) + 0.009


def distances(clip: Clip, other: Clip) -> FloatArray:
    """By how much (N,) the skin distance of each touching pair of capsules differs on another body, m."""
    one, two = (pose_body(each, body_capsules(each.skeleton)) for each in (clip, other))
    pairs = skin_pairs(one.body, frozenset(one.body.keys))
    frames, k = near_pairs(one.starts, one.ends, one.radii, pairs, 0.005)
    signs = signing(clip)[frames, pairs.own_side[k]] == 1.0
    frames, k = frames[signs], k[signs]
    before = pair_clearances(one.starts, one.ends, one.radii, pairs, frames, k).distance
    touching = before < 0.005
    after = pair_clearances(two.starts, two.ends, two.radii, pairs, frames, k).distance
    return np.abs(after - np.maximum(before, -0.002))[touching]


def deepest(clip: Clip) -> float:
    """How deep a hand lies in head, trunk, arm or the other hand while it signs, m."""
    posed = pose_body(clip, body_capsules(clip.skeleton))
    pairs = skin_pairs(posed.body, frozenset(posed.body.keys))
    frames, k = near_pairs(posed.starts, posed.ends, posed.radii, pairs, 0.0)
    signs = signing(clip)[frames, pairs.own_side[k]] == 1.0
    gap = pair_clearances(posed.starts, posed.ends, posed.radii, pairs, frames[signs], k[signs]).distance
    return float(max(-gap.min(initial=0.0), 0.0))


def test_skin_distances_are_those_of_collisions() -> None:
    clip = word("FAMILY")
    posed = pose_body(clip, body_capsules(clip.skeleton))
    pairs = skin_pairs(posed.body, frozenset(posed.body.keys))
    starts, ends = posed.starts[40:41], posed.ends[40:41]
    rows = range(len(posed.radii))
    depth = overlap(starts, ends, posed.radii, rows, rows)[0][0][pairs.own, pairs.other]
    _, k = near_pairs(starts, ends, posed.radii, pairs, 0.01)
    assert set(np.flatnonzero(-depth < 0.01)) <= set(k), "no near pair is passed over"
    found = pair_clearances(starts, ends, posed.radii, pairs, np.zeros_like(k), k).distance
    np.testing.assert_allclose(found, -depth[k], atol=1e-9)
    assert (found < 0.005).any()


def test_hands_keep_their_rotation_and_bones_their_length() -> None:
    clip = word("FAMILY")
    onto = other_body(clip, "narrow")
    carried, done = copy_rotations(clip, reference(onto))[0], retarget(clip, onto)
    joints = rig_info(onto.skeleton).arm_joints
    for hand in (joints[2], joints[5]):
        below = kinematics.subtree(onto.skeleton, hand)
        one, two = (kinematics.forward(each, below)[0] for each in (carried, done.clip))
        np.testing.assert_allclose(two, one, atol=1e-9)
    assert done.clip.translations is None
    np.testing.assert_array_equal(done.clip.skeleton.offsets, onto.skeleton.offsets)


def test_axes_and_unit_of_a_rig_do_not_matter() -> None:
    clip = word("NAME")
    onto = other_body(clip, "narrow")
    by_role = {clip.skeleton.names[joint]: role for role, joint in rig_info(clip.skeleton).roles.joints.items()}
    expected = retarget(clip, on_other_rig(onto, rotation.IDENTITY, 1.0, by_role))
    done = retarget(clip, on_other_rig(onto, rotation.exp([0.3, -1.1, 0.7]), 0.01, by_role))
    joints = rig_info(onto.skeleton).arm_joints[:6]
    one, two = (kinematics.forward(each.clip, joints)[1] for each in (expected, done))
    middle = [each[:, :4:3].mean(axis=1, keepdims=True) for each in (one, two)]
    np.testing.assert_allclose(100.0 * (two - middle[1]), one - middle[0], atol=0.2)
    assert [each.is_kept for each in done.contacts] == [each.is_kept for each in expected.contacts]


def test_an_arm_that_is_too_short_is_named() -> None:
    clip = word("HAT")
    short = replace(clip, skeleton=stretched(clip.skeleton, 1.4, 0.5), channels=None)
    (warning,) = retarget(clip, short).warnings
    assert re.fullmatch(r"HAT: places of the right hand lie up to \d+ cm beyond the reach of this body's arm", warning)


@pytest.mark.parametrize("n_frames", [1, 2, 3])
def test_a_few_frames_are_enough(n_frames: int) -> None:
    clip = word("NAME")[40 : 40 + n_frames]
    assert len(retarget(clip, other_body(clip, "narrow")).clip) == n_frames


def test_a_rig_without_known_arms_gets_rotations_alone() -> None:
    clip = word("NAME")
    names = tuple(name.replace("ForeArm", "Tentacle") for name in clip.skeleton.names)
    onto = Skeleton(names, clip.skeleton.parents, clip.skeleton.offsets * 1.2, clip.skeleton.end_sites)
    done = retarget(clip, onto)
    assert done.contacts == ()


def test_a_long_take_in_windows_is_fitted_as_in_one(monkeypatch: pytest.MonkeyPatch) -> None:
    clip = concatenate([word(gloss) for gloss in ("NAME", "MY", "NAME")])
    onto = other_body(clip, "narrow")
    whole = retarget(clip, onto)
    monkeypatch.setattr(module, "_WINDOW", 130)
    parts = retarget(clip, onto)
    joints = rig_info(onto.skeleton).arm_joints[:6]
    one, two = (kinematics.forward(each.clip, joints)[1][:, 2::3] for each in (whole, parts))
    assert np.abs(one - two).max() < 1.0, "wrists, 1 cm"
    assert [(each.hand, each.region) for each in parts.contacts] == [
        (each.hand, each.region) for each in whole.contacts
    ]


def test_an_elbow_turns_about_the_line_from_shoulder_to_wrist() -> None:
    clip = word("NAME")
    joints = rig_info(clip.skeleton).arm_joints[:6]
    before = kinematics.forward(clip, joints)[1]
    turned = arm_ik.move_wrists(clip, np.zeros((len(clip), 2, 3)), np.tile([0.0, 0.5], (len(clip), 1)))
    after = kinematics.forward(turned, joints)[1]
    np.testing.assert_allclose(after[:, [0, 1, 2, 3, 5]], before[:, [0, 1, 2, 3, 5]], atol=1e-6)
    assert np.linalg.norm(after[40, 4] - before[40, 4]) > 2.0


def test_a_splice_of_two_bodies_keeps_contacts_and_says_so(tmp_path: Path) -> None:
    first, second = word("HELLO"), other_body(word("NAME"), "narrow")
    second = replace(second, name="NAME")
    done = ss.splice([first, second])
    assert list(done.contacts) == [1]
    assert all(isinstance(one, Contact) for one in done.contacts[1])
    described = reports.describe(done)
    assert {one["clip"] for one in described["contacts"]} == {1}
    reports.write(described, tmp_path / "r.json")
    assert reports.read(tmp_path / "r.json", len(done.clip))["frames"] == len(done.clip)
    assert "contacts" not in reports.describe(ss.splice([first, word("NAME")])), "one body, nothing to say"


def test_convert_brings_a_file_to_another_body(tmp_path: Path) -> None:
    clip = word("NAME")
    save(clip, tmp_path / "NAME.bvh")
    save(other_body(clip, "narrow"), tmp_path / "rig.bvh")
    names = [str(tmp_path / name) for name in ("NAME.bvh", "out.bvh", "rig.bvh", "r.json")]
    run = CliRunner().invoke(app, ["convert", names[0], names[1], "--onto", names[2], "--report", names[3]])
    assert run.exit_code == 0, run.output
    report = json.loads(Path(names[3]).read_text())
    n_kept = sum(one["is_kept"] for one in report["contacts"])
    assert f"{n_kept} of {len(report['contacts'])} contacts kept" in run.output
    assert n_kept == len(report["contacts"]) > 0
    np.testing.assert_allclose(load(names[1]).skeleton.offsets[1:], load(names[2]).skeleton.offsets[1:])
    alone = CliRunner().invoke(app, ["convert", names[0], names[1], "--report", names[3]])
    assert "--report describes what --onto does" in str(alone.exception)


def test_a_path_is_no_body(words: dict[str, Clip]) -> None:
    with pytest.raises(TypeError, match=r"onto is 'a.vrm', expected a clip or an avatar; .* read_avatar\(path\)"):
        retarget(words["HELLO"], "a.vrm")  # type: ignore[arg-type]
