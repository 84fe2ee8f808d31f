"""motion.clip: clips are checked when made, sliced and concatenated bit for bit, and resampled by time."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import random_clip

from signsplice.errors import InputError
from signsplice.motion import Clip, Skeleton, concatenate, resample, rotation


def test_the_arrays_of_a_clip_are_read_only() -> None:
    clip = random_clip(0)
    with pytest.raises(ValueError, match="read-only"):
        clip.local_rotations[0, 0, 0] = 1.0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"local_rotations": np.zeros((20, 12, 3))}, "expected \\(T, 12, 4\\)"),
        ({"local_rotations": np.full((20, 12, 4), np.nan)}, "unit quaternions"),
        ({"local_rotations": np.full((20, 12, 4), 0.7)}, "length 1.4"),
        ({"local_rotations": np.zeros((0, 12, 4)), "root_positions": np.zeros((0, 3))}, "no frames"),
        ({"root_positions": np.zeros((19, 3))}, "do not fit"),
        ({"root_positions": np.full((20, 3), np.inf)}, "not a finite"),
        ({"fps": 0.0}, "frame rate 0.0"),
        ({"fps": float("nan")}, "frame rate nan"),
        ({"translations": np.zeros((20, 11, 3))}, "translations"),
    ],
)
def test_invalid_clips_are_refused(change: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        replace(random_clip(0), **change)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("names", "parents", "message"),
    [
        (("a", "a"), [-1, 0], "appears twice"),
        (("a", "b"), [-1, 1], "after its parent"),
        (("a", "b"), [0, -1], "root first"),
        (("a",), [-1, 0], "do not fit"),
    ],
)
def test_invalid_skeletons_are_refused(names: tuple[str, ...], parents: list[int], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Skeleton(names, np.array(parents), np.zeros((len(parents), 3)))


@pytest.mark.parametrize("at", [1, 7, 19])
def test_concatenated_slices_are_the_clip_bit_for_bit(at: int) -> None:
    clip = random_clip(4)
    joined = concatenate([clip[:at], clip[at:]])
    assert np.array_equal(joined.local_rotations, clip.local_rotations)
    assert np.array_equal(joined.root_positions, clip.root_positions)
    assert joined.name == clip.name


def test_clips_that_do_not_fit_are_not_concatenated() -> None:
    with pytest.raises(InputError, match="other joints"):
        concatenate([random_clip(0), random_clip(0, n_joints=11)])
    with pytest.raises(InputError, match="resample"):
        concatenate([random_clip(0), random_clip(0, fps=25.0)])
    with pytest.raises(InputError, match="step 1"):
        random_clip(0)[::2]


def test_resampled_frames_show_the_same_moments() -> None:
    clip = random_clip(6, n_frames=49, fps=24.0)
    for fps in (12.0, 25.0, 30.0, 120.0, 29.97):
        other = resample(clip, fps)
        assert abs((len(other) - 1) / fps - (len(clip) - 1) / 24.0) < 1.0 / fps
        for k in range(0, len(other), 5):  # by the definition, one frame at a time
            at = k / fps * 24.0
            low = min(int(at), len(clip) - 2)
            expected = rotation.slerp(clip.local_rotations[low], clip.local_rotations[low + 1], np.array(at - low))
            assert np.all(rotation.angle_between(other.local_rotations[k], expected) < 1e-7)


def test_resampling_up_and_down_returns_the_frames() -> None:
    clip = random_clip(7, fps=25.0)
    back = resample(resample(clip, 100.0), 25.0)
    assert len(back) == len(clip)
    assert np.all(rotation.angle_between(back.local_rotations, clip.local_rotations) < 1e-7)
    assert resample(clip, 25.0) is clip


def test_speed_shortens_the_clip() -> None:
    clip = random_clip(8, n_frames=41)
    fast = resample(clip, 30.0, speed=2.0)
    assert len(fast) == 21
    assert np.all(rotation.angle_between(fast.local_rotations, clip.local_rotations[::2]) < 1e-7)
    with pytest.raises(InputError, match="speed"):
        resample(clip, 30.0, speed=0.0)


def test_a_clip_may_have_one_frame() -> None:
    clip = random_clip(9, n_frames=1)
    assert len(resample(clip, 60.0)) == 1
    assert isinstance(clip[:1], Clip)


def test_a_clip_is_shown_in_one_line() -> None:
    clip = random_clip(3, n_frames=41, fps=25.0, n_joints=7)
    assert repr(clip) == f"<Clip {clip.name!r}: 41 frames, 1.64 s at 25 fps, 7 joints>"
    assert repr(clip[:1]).startswith(f"<Clip {clip.name!r}: 1 frame, 0.04 s")
    assert repr(clip.skeleton) == "<Skeleton: 7 joints below joint0>"


def test_a_clip_is_cut_with_slices_alone(words: dict[str, Clip]) -> None:
    with pytest.raises(TypeError, match=r"cut with a slice: clip\[3:4\], not clip\[3\]"):
        words["HELLO"][3]  # type: ignore[index]
