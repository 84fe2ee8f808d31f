"""Mouthing: sounds in SAMPA to visemes to a mouth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from signsplice.errors import InputError
from signsplice.motion import Clip
from signsplice.motion.face import VISEMES
from signsplice.written.nonmanual import SOUNDS, TIMING, mouthing, visemes, with_mouthing
from signsplice_workshop.measure.faces import random_face


def test_sounds_are_read_with_the_longest_symbol_first() -> None:
    assert visemes("tSIp") == [["CH"], ["I"], ["PP"]]
    assert visemes('"ma.D@r') == [["PP"], ["aa"], ["TH"], ["E"], ["RR"]]
    assert visemes("b aU m") == visemes("baUm") == [["PP"], ["aa", "U"], ["PP"]]
    assert len(SOUNDS) >= 45
    assert {name for shapes in SOUNDS.values() for name in shapes} == set(VISEMES) - {"sil"}


@pytest.mark.parametrize(
    ("text", "expected"), [("", "has no sound"), (" . ", "has no sound"), ("heWlo", "'W' is no sound")]
)
def test_spelling_and_silence_are_no_sounds(text: str, expected: str) -> None:
    with pytest.raises(InputError, match=expected):
        visemes(text)


def test_a_mouth_opens_from_rest_reaches_every_shape_and_closes() -> None:
    face = mouthing("mama", 120.0)
    assert not face.weights[[0, -1]].any()
    assert len(face) == round(5 / TIMING.sounds_per_s * 120.0)
    jaw, press = face.of(["jawOpen", "mouthPressLeft"]).T
    opened = [k for k in range(1, len(jaw) - 1) if jaw[k - 1] < jaw[k] >= jaw[k + 1]]
    assert len(opened) == 2
    assert jaw[opened] == pytest.approx([0.6, 0.6], abs=0.02)
    assert press[: opened[0]].max() == pytest.approx(0.5, abs=0.02)
    assert jaw[opened[0] : opened[1]].min() < 0.02
    assert np.abs(np.diff(face.weights, axis=0)).max() < 0.15


def test_a_mouthing_takes_as_long_as_the_sign_and_leaves_the_rest_of_the_face(words: dict[str, Clip]) -> None:
    clip = words["DEAF"]
    clip = replace(clip, face=random_face(0, len(clip), channels=("eyeBlinkLeft", "mouthSmileLeft", "browInnerUp")))
    start, stop = 20, 44
    said = with_mouthing(clip, "dEf", (start, stop)).face
    assert said is not None
    assert clip.face is not None
    mouth = [name for name in said.channels if name.startswith(("jaw", "mouth"))]
    moves = said.of(mouth).sum(axis=1) > 0.0
    assert not moves[:start].any()
    assert not moves[stop:].any()
    assert moves[start + 2 : stop - 2].all()
    kept = ["eyeBlinkLeft", "browInnerUp"]
    assert np.array_equal(said.of(kept), clip.face.of(kept))
