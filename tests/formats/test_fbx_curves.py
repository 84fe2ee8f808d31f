"""FBX curves against ``golden/fbx_curves.json``: ufbx 0.0.5 shows the curves of version 7 and the arms, FBX2glTF 0.9.7
those of version 6; ``golden/make_fbx_curves.py`` made it.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np
import pytest
from conftest import GOLDEN

from fbx_files import TICKS, Curve, Node, as_binary, text_6, text_7
from signsplice.formats import fbx
from signsplice.motion import Clip, kinematics

ABOVE = (Node("Spine", "Hips", (0, 20, 0)), Node("Neck", "Spine", (0, 30, 0)))
KEYS = ((0.0, 0.0), (0.42, 30.0), (0.93, 30.0), (1.01, 50.0), (1.71, 10.0), (2.0, -5.0))
CHAIN = {"Hips": ("", (0, 95, 0)), "Spine": ("Hips", (0, 25, 0)), "Shoulder": ("Spine", (5, 20, 0)),
         "Arm": ("Shoulder", (12, 0, 0)), "ForeArm": ("Arm", (28, 0, 0)), "Hand": ("ForeArm", (26, 0, 0)),
         "Index": ("Hand", (9, 0, 2))}  # fmt: skip


@cache
def golden() -> dict[str, Any]:
    content: dict[str, Any] = json.loads((GOLDEN / "fbx_curves.json").read_text())
    return content


def decode(stored: Mapping[str, Any]) -> Curve:
    seconds = [tick / TICKS for tick in stored["ticks"]]
    keys = list(zip(seconds, stored["values"], strict=True))
    return Curve(keys, stored["flags"], stored["numbers"], stored["beyond"])


def parse_hips(curve: Curve) -> Clip:
    return fbx.parse(text_7((Node("Hips", curves={("T", 0): curve}), *ABOVE), span=(0.0, 2.0)), "curve.fbx")


@pytest.mark.parametrize("name", golden()["curves"])
def test_a_curve_runs_between_and_beyond_its_keys_as_another_program_shows_it(name: str) -> None:
    stored = golden()["curves"][name]
    clip = parse_hips(decode(stored))
    assert len(clip) == 61
    assert clip.notes == ()
    assert np.ptp(stored["shown"]) > 1.0 or name.startswith("before and after: C")
    # The other program takes weights as 10,000ths, the SDK as 9999ths.
    np.testing.assert_allclose(100.0 * clip.root_positions[:, 0], stored["shown"], atol=0.01)


@pytest.mark.parametrize("rule", golden()["version 6"])
def test_keys_of_version_6_are_shown_as_the_sdk_shows_them(rule: str) -> None:
    shown = golden()["version 6"][rule]
    clip = fbx.parse(text_6((Node("Hips", moves={("T", 0): KEYS}), *ABOVE), (0.0, 2.0), rule), "old.fbx")
    assert len(clip) == len(shown) == 61
    np.testing.assert_allclose(100.0 * clip.root_positions[:, 0], shown, atol=0.003)


def arm_file(number: int) -> bytes:
    arm = golden()["arms"][number]
    nodes = [
        Node(name, parent, at, order=order, curves={
            ("R", track["axis"]): decode(track) for track in arm["tracks"] if track["joint"] == name
        })
        for (name, (parent, at)), order in zip(CHAIN.items(), arm["orders"], strict=True)
    ]  # fmt: skip
    return text_7(nodes, span=(0.0, 2.0))


@pytest.mark.parametrize("number", range(6))
@pytest.mark.parametrize("version", [7300, 7400, 7500, 7700])
@pytest.mark.parametrize("form", ["text", "binary"])
def test_arms_with_keys_of_all_kinds_are_within_a_millimetre_of_another_program(
    number: int, version: int, form: str
) -> None:
    text = arm_file(number).replace(b"FBXVersion: 7400", f"FBXVersion: {version}".encode())
    clip = fbx.parse(text if form == "text" else as_binary(text, version), "arm.fbx")
    assert clip.skeleton.names == tuple(CHAIN)
    positions, expected = 100.0 * kinematics.forward(clip)[1][::6], np.array(golden()["arms"][number]["positions"])
    assert np.ptp(expected[:, -1], axis=0).max() > 10.0, "the hand moves"
    assert np.linalg.norm(positions - expected, axis=-1).max() < 0.1


def test_a_key_that_a_frame_misses_by_rounding_counts_as_its() -> None:
    """0.7 s and 21 frames of 1/30 s differ in the last bit."""
    third = 1.0 / 3.0
    for offset in (0.0, 1e-10, -1e-10):
        keys = ((0.0, 0.0), (0.7 + offset, 10.0), (1.0 + third + offset, 20.0), (2.0, 30.0))
        clip = parse_hips(Curve(keys, [2], [[0] * 4]))
        frames = 100.0 * clip.root_positions[:, 0]
        np.testing.assert_allclose(frames[[20, 21, 39, 40, 59, 60]], [0.0, 10.0, 10.0, 20.0, 20.0, 30.0], atol=1e-9)


@pytest.mark.parametrize(
    ("flags", "beyond", "note"),
    [
        (0x8000 | 0x108, "C -1", "curves with key flags 0x8000, read as if unset: 1"),
        (0x0, "C -1", "curves with keys without interpolation, read as linear: 1"),
        (0x4, "X -1", "curves with Post-Extrapolation 'X', read as constant: 1"),
    ],
)
def test_what_has_no_rule_is_a_note_of_the_clip(flags: int, beyond: str, note: str) -> None:
    plain = Curve(KEYS, [flags & ~0x8000 or 4], [[0] * 4])
    clip = parse_hips(Curve(KEYS, [flags], [[0] * 4], ("C -1", beyond)))
    assert clip.notes == (note,)
    np.testing.assert_allclose(clip.root_positions, parse_hips(plain).root_positions)


def test_tangents_that_only_editors_show_and_velocities_are_no_note() -> None:
    clip = parse_hips(Curve(KEYS, [0x30300408], [[0, 0, 0, 5000]]))
    assert clip.notes == ()
