"""Letters that run into one another, and doubled letters that slide."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from signsplice.lexicon import Lexicon, open_shipped_lexicon
from signsplice.motion import Clip, FloatArray, rotation
from signsplice.rig.info import arms, hands_in_trunk_axes
from signsplice.splicing.engine import SpliceOptions, SpliceResult, splice, stream
from signsplice.splicing.letters import FREE_FINGERS, spelling_side
from signsplice.splicing.person import channel_joints


@pytest.fixture(scope="module")
def lexicon() -> Iterator[Lexicon]:
    with open_shipped_lexicon() as opened:
        yield opened


def letters(word: str, lexicon: Lexicon) -> list[Clip]:
    return [lexicon.clip(f"fs-{letter}") for letter in word]


def off(result: SpliceResult, index: int, clip: Clip, joints: list[str]) -> FloatArray:
    """How far joints of a letter's span are from its recording, radians, (T,)."""
    span = result.spans[2 * index]
    assert span.source is not None
    columns = [clip.skeleton.names.index(name) for name in joints]
    shown = result.clip.local_rotations[slice(*span.output)][:, columns]
    return np.asarray(rotation.angle_between(shown, clip.local_rotations[slice(*span.source)][:, columns]).max(axis=1))


def finger(name: str) -> list[str]:
    return [f"mixamorig:RightHand{name}{k}" for k in (1, 2, 3)]


def planned_joints(result: SpliceResult, index: int) -> set[str]:
    """Names of a letter's joints that are not its own but planned over the word."""
    assert result.person is not None
    clip = result.clip
    channels = result.person.planned.get(index, ())
    return {clip.skeleton.names[joint] for channel in channels for joint in channel_joints(clip, channel)}


def test_a_finger_that_plays_no_part_moves_to_the_next_letter_early(lexicon: Lexicon) -> None:
    clips = letters("ANYA", lexicon)
    result = splice(clips)
    little = off(result, 1, clips[1], finger("Pinky"))
    assert 0.03 < little[-1] < 0.5, "on its way when N is left"
    assert (np.diff(little[-3:]) > 0.0).all()
    assert little[: len(little) // 2].max() < 1e-3, "but in its place while N is held"
    for name in ("Thumb", "Index", "Middle"):
        assert off(result, 1, clips[1], finger(name)).max() < 1e-9, "those that N selects do not move"


def test_a_finger_that_plays_no_part_arrives_late(lexicon: Lexicon) -> None:
    clips = letters("AFDA", lexicon)
    ring = off(splice(clips), 2, clips[2], finger("Ring"))
    assert ring[0] > 0.05
    assert ring[2] < 1e-3 < ring[1] < ring[0]


@pytest.mark.parametrize("word", ["QUICKLY", "BROWNFOX", "JUMPVW", "AZTECS", "DIGHT"])
def test_selected_fingers_and_the_thumb_keep_every_recorded_frame(word: str, lexicon: Lexicon) -> None:
    clips = letters(word, lexicon)
    result = splice(clips)
    spelled = {"Index": "Index", "Middle": "Middle", "Ring": "Ring", "Little": "Pinky"}
    for k, clip in enumerate(clips):
        free = [spelled[name] for name in FREE_FINGERS.get(word[k], ())]
        planned = planned_joints(result, k)
        assert planned.isdisjoint(finger("Thumb")), "the arm that spells is the letter's own"
        kept = [name for name in clip.skeleton.names[1:] if name not in planned]
        kept = [name for name in kept if not any(part in name for part in free)]
        assert off(result, k, clip, kept).max() < 1e-9, word[k]
        if free:
            n_frames = len(off(result, k, clip, kept))
            fingers = off(result, k, clip, [name for part in free for name in finger(part)])
            assert fingers[n_frames // 2] < 0.02, f"{word[k]} is whole in the middle of its hold"


@pytest.mark.parametrize("person", [0.0, 1.0])
def test_what_is_on_its_way_is_reported_and_the_rest_is_copied(person: float, lexicon: Lexicon) -> None:
    clips = letters("ANYLA", lexicon)
    result = splice(clips, SpliceOptions(person=person))
    assert any(span.remade for span in result.spans)
    for span in result.spans:
        if span.clip is None or span.source is None:
            continue
        shown = result.clip.local_rotations[slice(*span.output)]
        alone = splice([clips[span.clip]]).clip.local_rotations[slice(*span.source)]
        same = np.abs(shown - alone).max(axis=-1) == 0.0
        same[:, 0] = True  # the root is placed where the sentence stands
        if span.remade is not None:
            names = result.clip.skeleton.names
            start, stop = (frame - span.output[0] for frame in span.remade.frames)
            joints = [names.index(name) for name in span.remade.joints]
            assert not same[start:stop, joints].all()
            same[start:stop, joints] = True
        assert same.all()


def test_streamed_letters_blend_as_spliced_ones_do(lexicon: Lexicon) -> None:
    clips = letters("NYLLA", lexicon)
    whole = splice(clips)
    pieces = list(stream(clips))
    assert [piece.span for piece in pieces] == list(whole.spans)
    for piece in pieces:
        assert (piece.clip.local_rotations == whole.clip.local_rotations[slice(*piece.span.output)]).all()


def test_two_handed_letters_are_not_blended(lexicon: Lexicon) -> None:
    both = arms(lexicon.clip("BOOK"))
    frame = int(both.lift.min(axis=1).argmax())
    assert spelling_side(both, frame, both, frame) is None
    clips = [replace(lexicon.clip("BOOK"), name="fs-N"), replace(lexicon.clip("BOOK"), name="fs-Y")]
    assert all(span.remade is None for span in splice(clips, SpliceOptions(transition="slerp", person=0.0)).spans)


# --- doubled letters


@pytest.mark.parametrize("word", ["LL", "BB", "22"])
def test_open_letters_slide_to_the_side(word: str, lexicon: Lexicon) -> None:
    clips = letters(word, lexicon)
    result = splice(clips)
    own, (_, second) = arms(result.clip), (result.spans[0].output, result.spans[2].output)
    places = hands_in_trunk_axes(own)[0][:, 1] * own.metres
    step = places[second[0] + 3] - places[result.spans[0].output[1] - 1]
    assert -step[0] == pytest.approx(0.045, abs=0.005)
    assert np.linalg.norm(step) < 0.05
    assert result.spans[2].remade is not None
    arm = {f"mixamorig:Right{name}" for name in ("Arm", "ForeArm", "Hand")}
    assert set(result.spans[2].remade.joints) == arm | planned_joints(result, 1)
    assert arm.isdisjoint(planned_joints(result, 1))
    alone = splice(clips[1:]).clip
    assert np.abs(arms(alone).wrists[-1] - own.wrists[-1]).max() * own.metres < 0.002, "it sinks to the same rest"


def test_the_hand_slides_on_for_a_third_and_goes_back_for_another_letter(lexicon: Lexicon) -> None:
    clips = letters("LLLA", lexicon)
    result = splice(clips)
    own = arms(result.clip)
    spans = [span.output for span in result.spans if span.kind == "sign"]
    frames = [spans[0][1] - 1, *(start + 2 for start, _ in spans[1:])]
    at = hands_in_trunk_axes(own)[0][frames, 1] * own.metres
    out = at[0, 0] - at[:, 0]
    assert out[1:3] == pytest.approx([0.045, 0.09], abs=0.006)
    assert abs(out[3]) < 0.02


def test_a_slide_is_smooth(lexicon: Lexicon) -> None:
    seam = splice(letters("LL", lexicon)).seams[0]
    assert seam.peak_speed_m_s < 0.8
    assert seam.velocity_jump < 0.5
