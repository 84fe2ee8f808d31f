"""Faces over seams: held to the cut, eased, no half blinks, no jumps, source frames as they are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import signsplice as ss
from signing import marked
from signsplice.bulk.maker import motion_sha256
from signsplice.motion import Clip, concatenate, resample, sample_clip
from signsplice.motion.face import ARKIT_CHANNELS, Face
from signsplice.splicing import report
from signsplice.splicing.bulk_splice import splice_many
from signsplice.splicing.faces import LIDS, ease_face, largest_step
from signsplice_workshop.measure.faces import LID_COLUMNS, add_random_face, find_half_blinks, random_face

PLAIN = ss.SpliceOptions(cutter="ends", transition="slerp", duration="fixed")


def face_of(clip: Clip) -> Face:
    assert clip.face is not None
    return clip.face


@pytest.mark.parametrize("seed", range(20))
def test_random_faces_have_no_half_blink_and_no_jump_above_their_own(seed: int) -> None:
    """200 seams: frames cut at random, 0.16 to 0.5 s between them."""
    rng, fps = np.random.default_rng(seed), (30.0, 60.0)[seed % 2]
    before, after = random_face(100 + seed, 90, fps), random_face(200 + seed, 90, fps)
    limit = largest_step(before, after)
    for _ in range(10):
        last, first = rng.integers(5, 85, 2)
        n = int(rng.integers(round(0.16 * fps), round(0.5 * fps)))
        new = ease_face(before, after, int(last), int(first), n, fps)
        whole = np.concatenate([before.weights[: last + 1], new.weights, after.weights[first:]])
        steps = np.delete(np.abs(np.diff(whole[last : last + n + 2], axis=0)), LID_COLUMNS, axis=1).max(axis=0)
        unavoidable = np.delete(np.abs(before.weights[last] - after.weights[first]), LID_COLUMNS) / (n + 1)
        assert np.all(steps <= np.maximum(limit, unavoidable) + 1e-9)
        assert not find_half_blinks(whole[max(0, last - 12) : last + n + 14, LID_COLUMNS[0]])


def lids(*weights: float) -> Face:
    return Face(LIDS, np.repeat(np.array(weights)[:, None], 2, axis=1))


def test_lids_that_were_closing_close_before_they_open() -> None:
    before = lids(*[0.05] * 20, 0.4, 0.7, 1.0, 0.7, 0.4, 0.1)
    new = ease_face(before, lids(*[0.05] * 20), 20, 3, 8, 30.0).weights[:, 0]
    assert new.max() == 1.0
    assert np.all(np.diff(new[new.argmax() :]) <= 0.0)
    assert ease_face(before, lids(*[0.05] * 20), 24, 3, 8, 30.0).weights.max() < 0.4  # a blink that is nearly over


def test_lids_that_are_opening_where_a_word_is_entered_were_closed_before() -> None:
    after = lids(*[0.05] * 9, 0.5, 0.9, 0.6, 0.3, *[0.05] * 20)
    assert ease_face(lids(*[0.05] * 20), after, 19, 11, 8, 30.0).weights.max() == 0.9
    assert ease_face(lids(*[0.05] * 20), after[11:], 19, 0, 8, 30.0).weights.max() == 0.6


def test_the_mouth_closes_before_it_opens_for_the_next_word_and_brows_span_both() -> None:
    channels = ("jawOpen", "browInnerUp")
    level = Face(channels, np.tile([0.5, 0.8], (20, 1)))
    moving = Face(("tongueOut",), np.linspace(0.0, 1.0, 11)[:, None])  # lets coefficients change by 0.1 a frame
    new = ease_face(
        Face(channels, np.concatenate([level.weights, random_face(0, 40).of(channels)])), level, 19, 0, 14, 30.0
    )
    assert new.weights[6, 0] == 0.0
    assert np.all(new.weights[:, 1] == 0.8)
    assert np.all(np.diff(new.weights[:7, 0]) <= 0.0)
    assert np.all(np.diff(new.weights[6:, 0]) >= 0.0)
    slow = ease_face(level, level, 19, 0, 14, 30.0)  # faces that do not move allow no closing
    assert np.all(slow.weights[:, 0] == 0.5)
    assert len(ease_face(level, moving, 19, 0, 0, 30.0)) == 0


@pytest.mark.parametrize("options", [ss.SpliceOptions(), PLAIN], ids=["default", "plain"])
@pytest.mark.parametrize("pauses", [None, {0: "."}])
def test_source_frames_keep_their_faces_bit_for_bit(
    words: dict[str, Clip], options: ss.SpliceOptions, pauses: dict[int, str] | None
) -> None:
    clips = [add_random_face(words[gloss], k) for k, gloss in enumerate(("HELLO", "DEAF", "SIGN"))]
    result = ss.splice(marked(clips, pauses=pauses), options)
    for span in result.spans:
        if span.clip is not None and span.source is not None:
            shown, source = face_of(result.clip)[slice(*span.output)], face_of(clips[span.clip])
            assert np.array_equal(shown.weights, source.weights[slice(*span.source)])
    steps = np.abs(np.diff(np.delete(face_of(result.clip).weights, LID_COLUMNS, axis=1), axis=0)).max(axis=1)
    inside = [slice(*span.output) for span in result.spans if span.kind == "transition"]
    most = max(largest_step(face_of(clip)) for clip in clips)
    assert max(steps[part.start - 1 : part.stop].max() for part in inside) <= most
    assert report.describe(result)["face"] == {"recorded": [0, 1, 2], "rules": []}
    bodies = ss.splice(marked([replace(clip, face=None) for clip in clips], pauses=pauses), options)
    assert np.array_equal(bodies.clip.local_rotations, result.clip.local_rotations)
    assert "face" not in report.describe(bodies)


def test_a_stream_and_a_bulk_run_have_the_faces_of_a_splice(words: dict[str, Clip]) -> None:
    clips = [add_random_face(words["HELLO"], 0), words["I"], add_random_face(words["DEAF"], 1, ("jawOpen",))]
    whole = ss.splice(clips, PLAIN).clip
    streamed = concatenate([piece.clip for piece in ss.stream(iter(clips), PLAIN)])
    (bulk,) = splice_many([clips], PLAIN)
    assert isinstance(bulk, ss.SpliceResult)
    for other in (streamed, bulk.clip):
        assert face_of(other).channels == ARKIT_CHANNELS
        assert np.array_equal(face_of(other).weights, face_of(whole).weights)
    assert motion_sha256(bulk.clip) == motion_sha256(whole)
    assert motion_sha256(whole) != motion_sha256(replace(whole, face=None))
    span = next(span for span in ss.splice(clips, PLAIN).spans if span.clip == 1)
    assert not face_of(whole)[slice(*span.output)].weights.any()


def test_tempo_and_another_rate_treat_a_face_with_its_body(words: dict[str, Clip]) -> None:
    clips = [add_random_face(words[gloss], k) for k, gloss in enumerate(("HELLO", "DEAF"))]
    result = ss.splice(clips, ss.SpliceOptions(tempo="natural", fps=60.0))
    again = ss.splice([replace(clip, face=None) for clip in clips], ss.SpliceOptions(tempo="natural", fps=60.0))
    assert np.array_equal(result.clip.local_rotations, again.clip.local_rotations)
    span = next(span for span in result.spans if span.warp is not None)
    at = np.array([frame for _, frame in span.warp or ()])
    expected = face_of(sample_clip(resample(clips[span.clip or 0], 60.0), at))
    assert np.array_equal(face_of(result.clip)[slice(*span.output)].weights, expected.weights)


def test_frames_made_anew_have_a_face_from_what_surrounds_them(words: dict[str, Clip]) -> None:
    clip = add_random_face(words["HELLO"], 5)
    made = face_of(ss.inbetween(clip, [(30, 42)], "slerp").clip)
    assert np.array_equal(made.weights[:30], face_of(clip).weights[:30])
    assert np.array_equal(made.weights[42:], face_of(clip).weights[42:])
    assert not np.array_equal(made.weights[30:42], face_of(clip).weights[30:42])
    steps = np.delete(np.abs(np.diff(made.weights[29:43], axis=0)), LID_COLUMNS, axis=1)
    assert steps.max() <= largest_step(face_of(clip)[:30], face_of(clip)[42:]) + 1e-9


def test_a_face_goes_with_its_clip_onto_another_body(words: dict[str, Clip]) -> None:
    clip = add_random_face(words["DEAF"], 1)
    other = replace(words["HELLO"], skeleton=replace(clip.skeleton, offsets=1.3 * clip.skeleton.offsets))
    assert np.array_equal(face_of(ss.retarget(clip, other).clip).weights, face_of(clip).weights)
