"""The rest of the person is measured: made-up heads, hands and faces have the figures that they were made with."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import signsplice as ss
from signsplice.errors import InputError
from signsplice.motion import Clip, FloatArray, copy_unchecked, rotation
from signsplice.motion.face import ARKIT_CHANNELS, Face
from signsplice.rig.info import rig_info
from signsplice_workshop.measure import person

FPS = 30.0


def still(n_frames: int) -> Clip:
    """Returns a signer who stands still."""
    first = ss.open_lexicon().clip("HELLO")[:1]
    return replace(
        first,
        local_rotations=first.local_rotations.repeat(n_frames, axis=0),
        root_positions=first.root_positions.repeat(n_frames, axis=0),
        fps=FPS,
    )


def turning_head(yaw_deg: FloatArray) -> Clip:
    """Returns a signer whose head turns by angles (T,), degrees, and who does nothing else."""
    clip = still(len(yaw_deg))
    turns = np.zeros((len(yaw_deg), 3))
    turns[:, 1] = np.deg2rad(yaw_deg)
    rotations, head = clip.local_rotations.copy(), rig_info(clip.skeleton).roles.joints["head"]
    rotations[:, head] = rotation.multiply(rotation.exp(turns), rotations[:, head])
    return replace(clip, local_rotations=rotations)


def test_a_person_who_stands_still_has_no_motion() -> None:
    measured = person.measure_person(still(300))
    assert (measured.drops, measured.idle, measured.mouth, measured.gaze) == (0, 0, 0.0, 0.0)
    assert measured.head_spread == pytest.approx(0.0, abs=1e-6)
    assert measured.head_peak == pytest.approx(0.0, abs=1e-4)
    assert measured.chest_spread == pytest.approx(0.0, abs=1e-6)
    assert measured.period is None


def test_a_head_that_swings_has_its_spread_and_speed_and_repeats_itself() -> None:
    time = np.arange(720) / FPS
    measured = person.measure_person(turning_head(10.0 * np.sin(2.0 * np.pi * time / 2.0)))
    assert measured.head_spread == pytest.approx(10.0 / np.sqrt(2.0), rel=0.01)
    assert measured.head_peak == pytest.approx(10.0 * np.pi, rel=0.01)
    assert measured.head_speed == pytest.approx(10.0 * np.pi / np.sqrt(2.0), rel=0.02)
    assert measured.period == pytest.approx(1.0, abs=0.02)
    assert measured.chest_spread == pytest.approx(0.0, abs=1e-6)


def test_a_head_that_wanders_does_not_repeat_itself() -> None:
    wander = np.cumsum(np.random.default_rng(1).standard_normal(900)) * 0.3
    measured = person.measure_person(turning_head(wander - wander.mean()))
    assert measured.period is not None
    assert measured.period < 0.9


def test_a_hand_drops_only_while_the_other_is_raised() -> None:
    falling = np.array([0.5, 0.6, 0.75, 0.9, 1.0, 0.9, 1.0])
    assert person._count_drops(falling, np.full(7, 0.4)) == 1, "hanging on is no second drop"
    assert person._count_drops(falling, falling) == 0, "both go to rest at a sentence's end"
    assert person._count_drops(np.array([0.8, 0.9, 0.8, 0.9]), np.full(4, 0.4)) == 0, "it was not raised"


def test_a_mouth_counts_while_it_moves_and_eyes_while_they_are_averted() -> None:
    weights = np.zeros((100, len(ARKIT_CHANNELS)))
    weights[:50, ARKIT_CHANNELS.index("jawOpen")] = 0.5 + 0.5 * np.sin(np.arange(50))
    weights[75:, ARKIT_CHANNELS.index("eyeLookOutLeft")] = 0.4
    measured = person.measure_person(copy_unchecked(still(100), face=Face(ARKIT_CHANNELS, weights)))
    assert measured.mouth == pytest.approx(0.5, abs=0.05)
    assert measured.gaze == pytest.approx(0.25)


def test_sentences_are_measured_by_kind_and_tempo() -> None:
    rows = person.compare(1, ["citation"])
    assert [row.motion for row in rows] == ["words that ship", "with noise", "folded rest", "redrawn between keys"]
    assert all(row.head_spread > 0.1 and row.other_seam_s > 0.2 for row in rows)
    assert len(person.table(rows)) == 4 + len(rows)
    with pytest.raises(InputError, match="expected at least 1"):
        person.compare(0, ["citation"])
