"""inbetween: gaps of a clip are filled from the frames around them, and no other frame changes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from signsplice.errors import InputError
from signsplice.motion import Clip, rotation
from signsplice.splicing.contracts import Gap
from signsplice.splicing.curves import TRANSITIONS, find_transition
from signsplice.splicing.engine import inbetween


@pytest.mark.parametrize("transition", list(TRANSITIONS))
def test_inbetween_changes_only_the_frames_of_gaps(transition: str, words: dict[str, Clip]) -> None:
    clip = words["SIGN"]
    result = inbetween(clip, [(50, 58), (20, 25)], transition)
    changed = np.zeros(len(clip), bool)
    changed[20:25] = changed[50:58] = True
    assert np.array_equal(result.clip.local_rotations[~changed], clip.local_rotations[~changed])
    assert len(result.clip) == len(clip)
    assert not np.array_equal(result.clip.local_rotations[changed], clip.local_rotations[changed])
    method = find_transition(transition)
    assert np.array_equal(
        result.clip.local_rotations[50:58], method.between(Gap(clip[42:50], clip[58:66], 8)).local_rotations
    )


def test_the_frames_to_be_replaced_have_no_influence(words: dict[str, Clip]) -> None:
    clip = words["SIGN"]
    disturbed = np.array(clip.local_rotations)
    disturbed[33:38] = rotation.multiply(disturbed[33:38], rotation.exp([1.0, 0.4, 0.2]))
    other = replace(clip, local_rotations=disturbed)
    gaps = [(20, 32), (33, 38)]
    for transition in TRANSITIONS:
        a, b = (inbetween(c, gaps, transition).clip.local_rotations for c in (clip, other))
        assert np.array_equal(a, b), transition


@pytest.mark.parametrize(
    "gaps", [[(0, 5)], [(5, 5)], [(8, 5)], [(70, None)], [(70, 999)], [(5, 10), (8, 12)], [(5, 10), (10, 12)]]
)
def test_gaps_without_a_frame_before_or_after_are_refused(
    gaps: list[tuple[int, int | None]], words: dict[str, Clip]
) -> None:
    """None is the clip's end."""
    with pytest.raises(InputError, match=r"gap \d+:\d+ in \d+ frames, expected"):
        inbetween(words["SIGN"], [(a, len(words["SIGN"]) if b is None else b) for a, b in gaps])


def test_feet_and_speed_of_one_clip_are_not_those_of_two(words: dict[str, Clip]) -> None:
    clip = words["SIGN"]
    roots = np.array(clip.root_positions)
    roots[40:] += np.array([0.0, 0.0, 50.0])
    (seam,) = inbetween(replace(clip, root_positions=roots, channels=None), [(38, 42)], "slerp").seams
    assert [line for line in seam.warnings if "foot slides" in line] == [
        "a foot slides by 50 cm: it stands elsewhere after the gap"
    ]
    assert any("a longer gap would help" in line for line in seam.warnings)
    assert "two clips" not in " ".join(seam.warnings)
