"""How the joints of any rig's numbers are drawn."""

from __future__ import annotations

import numpy as np

from signsplice.motion import Clip, Skeleton
from signsplice_paper.stick_figure import StickFigure, make_stick_figure, make_synthetic_figure, read_stick_figure
from toys import corpus

NAMES = (
    "Root", "pelvis", "spine_01", "neck_01", "head", "head_end", "upperarm_l", "lowerarm_l", "hand_l", "index_01_l",
    "index_02_l", "upperarm_r", "lowerarm_r", "hand_r", "middle_01_r", "middle_02_r", "thigh_l", "calf_l", "foot_l",
    "thigh_r", "calf_r", "foot_r",
)  # fmt: skip
PARENTS = (-1, 0, 1, 2, 3, 4, 2, 6, 7, 8, 9, 2, 11, 12, 13, 14, 1, 16, 17, 1, 19, 20)


def unreal_clip() -> Clip:
    """A person of another rig who stands on +Z and faces +X, arms out: left is +Y."""
    place = {
        "pelvis": (0, 0, 100), "spine_01": (0, 0, 30), "neck_01": (0, 0, 20), "head": (0, 0, 10),
        "head_end": (0, 0, 20),
        "upperarm_l": (0, 20, 15), "upperarm_r": (0, -20, 15), "thigh_l": (0, 10, -5), "thigh_r": (0, -10, -5),
        "calf_l": (0, 0, -45), "calf_r": (0, 0, -45), "foot_l": (0, 0, -45), "foot_r": (0, 0, -45),
    }  # fmt: skip
    offsets = [place.get(name, (0, 25 if name.endswith("_l") else -25, 0)) for name in NAMES]
    offsets[0] = (0, 0, 0)
    skeleton = Skeleton(NAMES, np.array(PARENTS), np.array(offsets, float))
    still = np.zeros((2, len(NAMES), 4))
    still[..., 3] = 1.0
    return Clip(skeleton, still, np.zeros((2, 3)), 30.0)


def test_parts_and_hands_are_found_in_another_rig() -> None:
    joints = [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16]
    parents = [-1, *(joints.index(PARENTS[joint]) for joint in joints[1:])]
    figure = make_stick_figure(unreal_clip(), joints, parents)
    by_name = {
        NAMES[joint]: (part, finger) for joint, part, finger in zip(joints, figure.parts, figure.fingers, strict=True)
    }
    assert by_name["spine_01"] == ("trunk", False)
    assert by_name["lowerarm_l"] == ("left", False)
    assert by_name["index_02_l"] == ("left", True)
    assert by_name["hand_r"] == ("right", False)
    assert by_name["middle_01_r"] == ("right", True)
    assert by_name["thigh_l"] == ("hidden", False)
    assert figure.wrists == {"right": joints.index(13), "left": joints.index(8)}
    assert figure.knuckles == {"right": joints.index(14), "left": joints.index(8)}, "the hand where no middle finger is"
    assert figure.head == (joints.index(4), joints.index(5))
    assert sorted(figure.find_bones("right", True, "right")) == [(joints.index(13), joints.index(14)), (13, 14)]
    assert np.allclose(figure.view, [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]), "the signer's left is the viewer's right"
    frame = np.arange(48.0)[None]
    assert np.allclose(figure.project_frames(frame)[0, 1], [4.0, 5.0])
    assert read_stick_figure(figure.as_json()) == figure


def test_a_rig_without_known_names_is_all_trunk() -> None:
    clip = corpus().word_clip(0)
    bare = Skeleton(tuple(f"j{k}" for k in range(53)), clip.skeleton.parents, clip.skeleton.offsets)
    unknown = Clip(bare, clip.local_rotations, clip.root_positions, clip.fps)
    figure: StickFigure = make_stick_figure(unknown, range(53), bare.parents.tolist())
    assert set(figure.parts) == {"trunk"}
    assert (figure.wrists, figure.head) == ({}, None)


def test_frames_without_a_figure_are_drawn_as_the_synthetic_signer() -> None:
    clip = corpus().word_clip(0)
    assert make_stick_figure(clip, range(53), clip.skeleton.parents.tolist()) == make_synthetic_figure()
