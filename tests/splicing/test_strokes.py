"""methods.strokes: what of a word lies outside its strokes, and which of that is left out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from made_words import KINDS, made_words
from signing import SIGNS, sign, word
from signsplice.motion import Clip, concatenate, resample
from signsplice.rig.info import arms
from signsplice.signer import planner
from signsplice.signer.signer import RESTS, STANDARD
from signsplice.splicing.engine import SpliceOptions, splice
from signsplice.splicing.options import open_learned
from signsplice_workshop.measure.hands import keeps_stroke, stroke

CUTTER = open_learned().cutters["learned"]


@pytest.mark.parametrize("rest", RESTS)
@pytest.mark.parametrize("left_handed", [False, True])
def test_no_way_from_or_to_rest_is_kept_below_a_stroke(rest: str, left_handed: bool) -> None:
    """Hands are as high where a word is left and entered as where its stroke ends and begins, within 2 cm."""
    signer = replace(STANDARD, rest=rest, left_handed=left_handed)
    for gloss in ("TELL", "GREEN", "TREE", "COFFEE", "DEAF"):
        made = planner.synthesize_word(sign(gloss), signer)
        (cut,) = CUTTER.cut_all([made.clip, made.clip])
        own = arms(made.clip)
        heights = own.wrists[:, 0 if left_handed else 1] @ own.up * own.metres
        first, last = stroke(made)
        assert keeps_stroke(made, cut.post, cut.pre + 1)
        for kept in (heights[cut.post : first + 1], heights[last : cut.pre + 1][::-1]):
            assert kept[-1] - kept.min() < 0.02, gloss


@pytest.mark.parametrize("cutter", [None, "pose-velocity"])
@pytest.mark.parametrize("recorded_fps", [24.0, 30.0, 60.0])
def test_a_word_is_cut_at_the_same_moment_whatever_the_rate_and_speed_of_the_output(
    cutter: str | None, recorded_fps: float
) -> None:
    """Within half a frame of the output. Frames that do not belong to the first word are left out of it."""
    clips = [resample(word(gloss).clip, recorded_fps) for gloss in ("MOTHER", "BOOK", "HELLO")]
    clips[0] = concatenate([jumped(clips[0][:2]), clips[0]])
    moments = []
    for fps, speed in ((recorded_fps, 1.0), (24.0, 1.0), (25.0, 1.0), (30.0, 1.0), (50.0, 1.0), (60.0, 1.3)):
        seams = splice(clips, SpliceOptions(cutter, fps=fps, sign_speed=speed)).seams
        frames = np.array([[seam.pre_frame, seam.post_frame] for seam in seams])
        moments.append(frames / fps * speed)
        assert np.abs(moments[-1] - moments[0]).max() <= (0.5 / fps + 1e-9) * speed
    assert moments[0].min() > 0.1


def jumped(clip: Clip) -> Clip:
    """Frames that lie beyond a jump of the root."""
    return replace(clip, root_positions=clip.root_positions + 50.0)


@pytest.mark.parametrize("n_words", [10, pytest.param(300, marks=pytest.mark.slow)])
def test_words_of_several_parts_are_kept_whole(n_words: int) -> None:
    """By strokes at their own height alone, a word in four had lost one."""
    lost = dict.fromkeys(KINDS, 0)
    for made in made_words(n_words, [one for one in SIGNS.values() if one.kind != "letter"]):
        (cut,) = CUTTER.cut_all([made.clip, made.clip])
        lost[made.kind] += made.loses_stroke(cut.post, cut.pre)
    assert sum(lost.values()) <= max(1, 0.05 * n_words), lost
    assert max(lost.values()) <= max(1, 0.1 * n_words / len(KINDS)), lost
