"""rig.keyedness: clips drawn between keys, in every way of the workshop's ``rekeying``, and captured ones."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from signing import word
from signsplice.cli.files import inspect
from signsplice.formats import save
from signsplice.lexicon import open_shipped_lexicon
from signsplice.motion import Clip, concatenate, resample
from signsplice.rig.align import place, placement
from signsplice.rig.info import rig_info
from signsplice.rig.keyedness import explain_keyedness, judge_keyedness
from signsplice.rig.roles import ARM
from signsplice_workshop.corpora.rekeying import DRAWINGS, add_noise, low_pass, rekey_clip

KINDS = [kind for kind in DRAWINGS if kind != "blender-old"]
"""Curves that are cubics of time; Blender's without continuous acceleration are not, and pass as captured."""


def is_keyed(clip: Clip) -> bool:
    return judge_keyedness(clip).is_keyed


def signed(gloss: str = "MOTHER", seed: int | None = None, fps: float = 30.0) -> Clip:
    return word(gloss, seed, fps).clip


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("every", [3, 4, 6, 12, (3, 12)])
def test_curves_between_keys_are_keyed(kind: str, every: int | tuple[int, int]) -> None:
    rng = np.random.default_rng(1)
    seen = [is_keyed(rekey_clip(signed(gloss), every, kind, rng)) for gloss in ("MOTHER", "BOOK", "WORK")]
    assert sum(seen) >= 2, "a cubic of Euler angles or quaternion components is none of rotations where joints are fast"


@pytest.mark.parametrize("kind", KINDS)
def test_keyed_clips_stay_keyed_at_other_rates(kind: str) -> None:
    slow = signed("BOOK", fps=24.0)
    for fps in (30.0, 60.0):
        assert is_keyed(rekey_clip(slow, 5, kind, fps=fps)), "played at that rate"
        assert is_keyed(resample(rekey_clip(slow, 5, kind), fps)), "slerped"


@pytest.mark.parametrize("seed", [None, 3, 7])
def test_signed_and_captured_motion_is_captured(seed: int | None) -> None:
    rng = np.random.default_rng(2)
    clip = signed("WORK", seed)
    changed = [add_noise(clip, rad, rng, width) for rad in (0.001, 0.01) for width in (0.0, 2.0)]
    changed += [resample(clip, fps) for fps in (24.0, 25.0, 60.0)]
    changed += [low_pass(clip, hertz) for hertz in (4.0, 8.0)]
    for other in (clip, *changed):
        assert not is_keyed(other)


def test_words_that_ship_are_captured() -> None:
    with open_shipped_lexicon() as lexicon:
        for gloss in list(lexicon)[::8]:
            assert not is_keyed(lexicon.clip(gloss)), gloss


def test_a_capture_and_what_is_made_of_it_is_captured(real_clips: dict[str, Clip]) -> None:
    take, rng = real_clips["long_take_metres"], np.random.default_rng(3)
    parts = [take, *(take[k : k + 30] for k in range(0, 440, 60))]
    for clip in (*parts, add_noise(take, 0.003, rng), resample(take, 24.0), resample(take, 60.0), low_pass(take, 5.0)):
        assert not is_keyed(clip)
    assert is_keyed(real_clips["isl_thanks"])
    assert is_keyed(rekey_clip(take[:105], 3, "unity"))


def test_the_arms_decide_and_the_reason_names_the_other_joints() -> None:
    clip = signed("WORK")
    arms = [joint for role, joint in rig_info(clip.skeleton).roles.joints.items() if role.endswith(ARM)]
    others = [joint for joint in range(len(clip.skeleton)) if joint not in arms]
    for joints, expected in ((arms, True), (others, False)):
        found = explain_keyedness(rekey_clip(clip, 4, "blender", joints=joints))
        assert found.is_keyed == expected
        assert found.reason.startswith("keyed: " if expected else "captured: ")
        assert "of the other joints'" in found.reason
        assert (found.every is not None) == expected


def test_a_clip_half_of_whose_frames_are_keyed_says_so() -> None:
    clip = signed("WORK")
    middle = len(clip) // 2
    half = judge_keyedness(concatenate([rekey_clip(clip, 5, "unity")[:middle], clip[middle:]]))
    assert half.is_keyed
    assert 0.2 < half.fraction < 0.9
    assert f"{100.0 * half.fraction:.0f} % of the arms' motion" in half.reason


def test_the_step_between_keys_is_named() -> None:
    for every in (3, 4):
        drawn = judge_keyedness(rekey_clip(signed("WORK"), every, "blender"))
        assert drawn.every == pytest.approx(every, abs=1.5)
        assert f"keys about every {drawn.every:.0f} frames" in drawn.reason


def test_a_still_clip_and_one_of_few_frames_are_captured() -> None:
    still = concatenate([signed()[:1]] * 60)
    for clip in (still, still[:1], signed()[:4], resample(signed()[:3], 60.0)):
        found = judge_keyedness(clip)
        assert (found.is_keyed, found.every, found.reason) == (False, None, "captured: hardly anything moves")


def test_a_clip_is_judged_once_also_where_it_was_placed() -> None:
    clip = rekey_clip(signed("BOOK"), 4, "unity")
    moved = place(clip, replace(placement(clip), position=np.array([100.0, 0.0, 0.0])))
    assert moved is not clip
    assert judge_keyedness(moved) is judge_keyedness(clip)


def test_inspect_says_whether_a_clip_is_keyed(tmp_path: Path) -> None:
    for clip, start in ((signed("BOOK"), "captured: "), (rekey_clip(signed("BOOK"), 4, "maya-auto"), "keyed: ")):
        save(clip, tmp_path / "clip.bvh")
        shown = CliRunner().invoke(inspect, [str(tmp_path / "clip.bvh")])
        assert f"motion     {start}" in shown.output
