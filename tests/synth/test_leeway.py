"""Places in open space that give way where a wrist would bend too far."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from signsplice.signer import location_targets
from signsplice.signer.phonology import Posture, Segment, Sign
from signsplice.signer.signer import STANDARD

AHEAD = Posture("B", "space:12,14,22", "palm", (0.0, -1.0, 0.0), (0.0, 0.0, 1.0))
EASY = replace(AHEAD, location="space:12,0,30", palm=(-1.0, 0.0, 0.0), fingers=(-0.2, 0.6, 0.77))


def _sign(*postures: Posture) -> Sign:
    kinds = ("X", *("M",) * (len(postures) - 1))
    segments = tuple(Segment(kind, one) for kind, one in zip(kinds, postures, strict=True))
    return Sign("TEST", "one", segments, kind="written")


def _shifts(sign: Sign) -> np.ndarray:
    return np.array([one.strong.shift for one in sign.segments])


def test_high_hand_that_points_forward_goes_forward_with_its_movement() -> None:
    moved = _shifts(location_targets.ease_places(_sign(AHEAD, replace(AHEAD, shift=(0.0, -9.0, 0.0))), STANDARD))
    assert moved[0, 2] > 0.0
    assert abs(moved[0, 1]) <= 2.6
    np.testing.assert_allclose(moved[1] - moved[0], (0.0, -9.0, 0.0))


def test_comfortable_hand_stays() -> None:
    sign = _sign(EASY, replace(EASY, shift=(0.0, 3.0, 0.0)))
    assert location_targets.ease_places(sign, STANDARD) is sign


def test_sign_that_touches_the_body_stays() -> None:
    sign = _sign(AHEAD, replace(AHEAD, location="chest", touch=True, palm=(0.0, 0.0, -1.0), fingers=(-1.0, 0.0, 0.0)))
    assert location_targets.ease_places(sign, STANDARD) is sign


def test_weak_hand_moves_with_the_strong_one_that_is_at_it() -> None:
    at_it = replace(AHEAD, location="base-radial")
    sign = Sign("TEST", "base", (Segment("H", at_it, AHEAD),), kind="written")
    segment = location_targets.ease_places(sign, STANDARD).segments[0]
    assert segment.strong == at_it
    assert segment.weak is not None
    assert segment.weak.shift != AHEAD.shift
