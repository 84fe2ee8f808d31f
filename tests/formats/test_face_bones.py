"""Eyes and jaws that are bones: a gaze turns them within an avatar's ranges, and comes back from its file."""

from __future__ import annotations

import json
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import face_avatars
import signsplice as ss
from signsplice.body.capsules import Avatar
from signsplice.formats.gltf_face import look_at_of, lost_in
from signsplice.motion import Clip, rotation
from signsplice.motion.face import LOOKS, SIDES, Face, LookAt, eye_coefficients, eye_quats, preset_of
from signsplice.rig.info import rig_info

VIEWER = Path(__file__).resolve().parents[2] / "viewer"
LEFT_UP = {"eyeLookOutLeft": 1.0, "eyeLookInRight": 0.5, "eyeLookUpLeft": 0.25, "eyeLookUpRight": 0.25, "jawOpen": 0.6}


def looking(clip: Clip, **weights: float) -> Clip:
    """The clip with a gaze or a mouth that grows from rest to ``weights``."""
    rows = np.linspace(0.0, 1.0, len(clip))[:, None] * [*weights.values()]
    return replace(clip, face=Face(tuple(weights), rows))


def signed(clip: Clip, folder: Path, kind: str) -> Clip:
    """The clip on an avatar of a kind."""
    return ss.retarget(clip, ss.read_avatar(face_avatars.write(folder, kind))).clip


def face_of(path: Path) -> Face:
    face = ss.load(path).face
    assert face is not None
    return face


@pytest.mark.parametrize("kind", face_avatars.WITH_BONES)
def test_a_gaze_turns_eyes_and_an_open_mouth_the_jaw_and_both_come_back(
    kind: str, words: dict[str, Clip], tmp_path: Path
) -> None:
    clip = looking(words["HELLO"][:8], **LEFT_UP)
    on_avatar = signed(clip, tmp_path, kind)
    ss.save(on_avatar, tmp_path / "out.glb")
    found, names = face_of(tmp_path / "out.glb"), [*LEFT_UP]
    assert np.abs(found.of(names) - looking(clip, **LEFT_UP).face.of(names)).max() < 1e-5  # type: ignore[union-attr]
    others = [name for name in found.channels if name not in LEFT_UP]
    assert found.of(others).max() < 1e-5
    assert lost_in(tmp_path / "out.glb", on_avatar) == ()
    assert np.array_equal(face_of(tmp_path / "out.glb").mirror().of(["eyeLookOutRight"]), found.of(["eyeLookOutLeft"]))


@pytest.mark.parametrize("kind", face_avatars.WITH_BONES)
def test_eyes_and_jaw_that_the_face_moves_are_no_loss(kind: str, words: dict[str, Clip], tmp_path: Path) -> None:
    avatar = ss.read_avatar(face_avatars.write(tmp_path, kind))
    assert {"leftEye", "rightEye"} <= {*rig_info(avatar).roles.joints}
    assert not [line for line in ss.retarget(words["HELLO"], avatar).warnings if "counterpart" in line]


@pytest.mark.parametrize("kind", face_avatars.WITH_BONES)
def test_eyes_turn_by_the_output_of_the_range_maps(kind: str, words: dict[str, Clip], tmp_path: Path) -> None:
    ss.save(signed(looking(words["HELLO"][:4], **LEFT_UP), tmp_path, kind), tmp_path / "out.glb")
    shown = ss.load(tmp_path / "out.glb")
    rig = rig_info(shown.skeleton)
    degrees = LookAt().eyes if kind == "bones.glb" else face_avatars.EYES_DEG
    for side, share, most in (("left", 1.0, degrees[1]), ("right", 0.5, degrees[0])):
        joint = rig.roles.joints[f"{side}Eye"]
        upright = rig.t_pose.rotations[joint]
        ahead = rotation.rotate(rotation.inverse(upright), [0.0, 0.0, 1.0])
        x, y, z = rotation.rotate(upright, rotation.rotate(shown.local_rotations[-1, joint], ahead))
        assert np.degrees(np.arctan2(x, z)) == pytest.approx(share * most, abs=0.01), "to the signer's left"
        assert np.degrees(np.arcsin(y)) == pytest.approx(0.25 * degrees[3], abs=0.01)
    jaw = rig.roles.joints["jaw"]
    upright = rig.t_pose.rotations[jaw]
    ahead = rotation.rotate(rotation.inverse(upright), [0.0, 0.0, 1.0])
    assert rotation.rotate(upright, rotation.rotate(shown.local_rotations[-1, jaw], ahead))[1] < -0.1, "down"


@pytest.mark.parametrize("kind", ["", "bones1.vrm", "bones0.vrm"])
def test_a_vrm_animation_has_the_gaze_as_its_look_at(kind: str, words: dict[str, Clip], tmp_path: Path) -> None:
    """For any avatar the coefficients stand beside it, and count when it is read."""
    both = {"eyeLookOutLeft": 0.8, "eyeLookInRight": 0.4, "eyeLookDownLeft": 0.5, "eyeLookDownRight": 0.5}
    clip = looking(words["HELLO"][:5], **both, jawOpen=0.7)
    clip = signed(clip, tmp_path, kind) if kind else clip
    ss.save(clip, tmp_path / "out.vrma")
    found = face_of(tmp_path / "out.vrma")
    # One gaze for both eyes: half of .8 * 80 + .4 * 60 is 44 degrees.
    expected = both if not kind else {"eyeLookOutLeft": 44 / 80, "eyeLookInRight": 44 / 60, "eyeLookDownLeft": 0.5}
    for name, weight in (*expected.items(), ("jawOpen", 0.7)):
        assert found.of([name])[-1, 0] == pytest.approx(weight, abs=1e-4)
    assert len([name for name in found.channels if name.startswith(LOOKS)]) == (8 if kind else 4)


@pytest.mark.skipif(
    shutil.which("node") is None or not (VIEWER / "node_modules").is_dir(),
    reason="no node, or viewer/node_modules is not installed",
)
def test_a_player_turns_eyes_and_jaw_as_far_as_the_ranges_say(words: dict[str, Clip], tmp_path: Path) -> None:
    """Up and down are left out: three-vrm 3.5 takes the one's range for the other's."""
    clip = looking(words["HELLO"][:4], eyeLookOutLeft=0.6, eyeLookInRight=0.8, jawOpen=0.5)
    files: list[str] = []
    for kind in face_avatars.WITH_BONES[1:]:
        ss.save(signed(clip, tmp_path, kind), tmp_path / f"{kind}.vrma")
        files += [str(tmp_path / kind), str(tmp_path / f"{kind}.vrma")]
    command = ["node", str(VIEWER / "checks" / "look.mjs"), *files]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    for rows in json.loads(done.stdout.splitlines()[-1]):  # .6 of 80 and .8 of 60 are 48 degrees, .6 of 12 and .8 of 9
        assert rows["leftEye"] == pytest.approx([7.2, 0.0], abs=0.01)
        assert rows["rightEye"] == pytest.approx([7.2, 0.0], abs=0.01)
        assert rows["jaw"] == pytest.approx([0.0, 10.0], abs=0.01)


@pytest.mark.parametrize("kind", face_avatars.KINDS)
def test_an_avatar_whose_face_has_targets_for_them_keeps_its_bones_at_rest(kind: str, tmp_path: Path) -> None:
    avatar = ss.read_avatar(face_avatars.write(tmp_path, kind))
    assert avatar.file is not None
    assert avatar.file.look_at is None
    assert not avatar.file.opens_jaw


@pytest.mark.parametrize("kind", ["bones1.vrm", "bones0.vrm"])
def test_the_presets_of_a_look_at_by_bones_are_no_expressions(kind: str, tmp_path: Path) -> None:
    avatar = ss.read_avatar(face_avatars.write(tmp_path, kind))
    assert isinstance(avatar, Avatar)
    assert avatar.file is not None
    assert [preset_of(control.name) for control in avatar.file.face] == ["blinkLeft", "blinkRight"]
    assert avatar.file.look_at == LookAt(face_avatars.GAZE_DEG, face_avatars.EYES_DEG)


@pytest.mark.parametrize("broken", [None, 3, {}, {"type": "bone"}, {"type": "bone", "rangeMapHorizontalInner": []}])
def test_a_broken_look_at_has_the_usual_ranges(broken: object) -> None:
    assert look_at_of({"extensions": {"VRMC_vrm": {"lookAt": broken}}})[0] == LookAt()
    worse = {"type": "bone", "rangeMapHorizontalInner": {"inputMaxValue": float("nan"), "outputScale": 1e9}}
    assert look_at_of({"extensions": {"VRMC_vrm": {"lookAt": worse}}})[0] == LookAt()


@given(st.lists(st.floats(0.0, 1.0), min_size=2, max_size=2), st.lists(st.booleans(), min_size=2, max_size=2))
def test_a_gaze_to_one_side_comes_back_from_an_eye(weights: list[float], turned: list[bool]) -> None:
    names = [LOOKS[turned[0]], LOOKS[2 + turned[1]]]
    for side in SIDES:
        face = Face((names[0] + side, names[1] + side), np.array([weights]))
        found = eye_coefficients(eye_quats(face, side, (30.0, 40.0, 20.0, 25.0)), side, (30.0, 40.0, 20.0, 25.0))
        assert [found[name + side][0] for name in names] == pytest.approx(weights, abs=1e-6)
        assert sum(values[0] for values in found.values()) == pytest.approx(sum(weights), abs=1e-5)
