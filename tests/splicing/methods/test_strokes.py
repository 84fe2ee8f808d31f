"""methods.strokes: what of a word lies outside its strokes, and which of that is left out."""

from __future__ import annotations

from dataclasses import replace

import pytest

from signing import sign
from signsplice.evaluation.strokes import keeps_stroke, stroke
from signsplice.rig.arms import arms
from signsplice.splicing.methods.choice import open_learned
from signsplice.synth import planner
from signsplice.synth.signer import RESTS, STANDARD

CUTTER = open_learned().cutters["learned"]


@pytest.mark.parametrize("rest", RESTS)
@pytest.mark.parametrize("left_handed", [False, True])
def test_no_way_from_or_to_rest_is_kept_below_a_stroke(rest: str, left_handed: bool) -> None:
    """Hands are as high where a word is left and entered as where its stroke ends and begins, within 2 cm."""
    signer = replace(STANDARD, rest=rest, left_handed=left_handed)
    for gloss in ("TELL", "GREEN", "TREE", "COFFEE", "DEAF"):
        word = planner.isolated(sign(gloss), signer)
        (cut,) = CUTTER.cut_all([word.clip, word.clip])
        own = arms(word.clip)
        heights = own.wrists[:, 0 if left_handed else 1] @ own.up * own.metres
        first, last = stroke(word)
        assert keeps_stroke(word, cut.post, cut.pre + 1)
        for kept in (heights[cut.post : first + 1], heights[last : cut.pre + 1][::-1]):
            assert kept[-1] - kept.min() < 0.02, gloss
