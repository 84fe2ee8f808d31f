"""The judges of fuzzing name motion that is read otherwise than a file holds it, and files that break the rules."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fuzz_gltf_rules
import fuzz_oracles
import fuzz_seeds
from evaluators import MustRefuseError
from fuzz_oracles import WrongMotionError
from fuzz_targets import TARGETS
from signsplice.motion import Clip, rotation


def _turned(clip: Clip) -> Clip:
    local = np.array(clip.local_rotations)
    local[2, -1] = rotation.multiply(local[2, -1], rotation.exp(np.array([0.01, 0.0, 0.0])))
    return replace(clip, local_rotations=local)


def _longer(clip: Clip) -> Clip:
    offsets = np.array(clip.skeleton.offsets)
    offsets[5] *= 1.01
    return replace(clip, skeleton=replace(clip.skeleton, offsets=offsets))


CHANGES: dict[str, Callable[[Clip], Clip]] = {
    "a joint at the end of a chain": _turned,
    "another rate": lambda clip: replace(clip, fps=1.05 * clip.fps),
    "a frame less": lambda clip: clip[: len(clip) - 2],
    "a longer bone": _longer,
}


@pytest.mark.parametrize("change", CHANGES)
@pytest.mark.parametrize("name", ["bvh", "npz", "gltf"])
def test_motion_that_is_not_the_file_s_is_named(name: str, change: str, tmp_path: Path) -> None:
    target = TARGETS[name]
    content = target.seeds()[0]
    clip, _ = target.exercise(content, tmp_path)
    assert target.judge(content, clip)
    with pytest.raises(WrongMotionError):
        target.judge(content, replace(CHANGES[change](clip), channels=None))


def test_a_word_of_another_motion_is_named(tmp_path: Path) -> None:
    target = TARGETS["lexicon"]
    content = target.seeds()[0]
    words, _ = target.exercise(content, tmp_path)
    assert target.judge(content, words)
    with pytest.raises(WrongMotionError, match="word HELLO has another motion"):
        fuzz_oracles.judge_lexicon({"HELLO": [fuzz_seeds.make_clip(1)]}, words)


def test_another_rest_pose_of_an_avatar_is_named(tmp_path: Path) -> None:
    target = TARGETS["avatar"]
    content = target.seeds()[0]
    avatar, _ = target.exercise(content, tmp_path)
    assert target.judge(content, avatar)
    with pytest.raises(WrongMotionError, match="at rest is"):
        target.judge(content, replace(avatar, offsets=1.001 * avatar.offsets))


RULES: dict[str, tuple[Callable[[dict[str, Any]], object], str]] = {
    "true for a node": (lambda d: d["animations"][0]["channels"][0]["target"].update(node=True), "no known path"),
    "no path": (lambda d: d["animations"][0]["channels"][0]["target"].update(path="rotations"), "no known path"),
    "twice": (lambda d: d["animations"][0]["channels"].append(d["animations"][0]["channels"][0]), "two channels"),
    "no name": (lambda d: d["animations"][0]["samplers"][0].update(interpolation=[]), "interpolation"),
    "a word": (lambda d: d["nodes"][1].update(translation=""), "translation of a node"),
    "a length": (lambda d: d["nodes"][1].update(rotation=[0, 0, 0, 2]), "no unit length"),
    "a stride": (lambda d: d["bufferViews"][0].update(byteStride=0), "byteStride"),
    "an offset": (lambda d: d["bufferViews"][0].update(byteOffset=""), "byteOffset of a view"),
    "a buffer": (lambda d: d["bufferViews"][0].update(buffer=False), "a buffer's number"),
    "normalized": (lambda d: d["accessors"][0].update(normalized=True), "normalized"),
    "NaN": (lambda d: d.update(extras=float("nan")), "NaN or infinity"),
}  # fmt: skip


@pytest.mark.parametrize("rule", RULES)
def test_a_file_that_breaks_a_rule_must_be_refused(rule: str) -> None:
    content = fuzz_seeds.make_gltf_seeds()[3]
    fuzz_gltf_rules.check(content, range(5))
    document = json.loads(content)
    RULES[rule][0](document)
    with pytest.raises(MustRefuseError, match=RULES[rule][1]):
        fuzz_gltf_rules.check(json.dumps(document).encode(), range(5))
