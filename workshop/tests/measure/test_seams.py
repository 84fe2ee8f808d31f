"""Seams of words that were recorded apart: what is measured, and the stitcher as a baseline."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from signing import sign, word
from signsplice.cli.commands import app
from signsplice.errors import InputError
from signsplice.motion import Clip
from signsplice.rig.info import arms, rig_info
from signsplice.signer.signer import RESTS
from signsplice.splicing.contracts import Cut, Cutter
from signsplice.splicing.engine import SpliceOptions
from signsplice.splicing.person import PLAN
from signsplice_workshop.measure import seams
from signsplice_workshop.measure.measures import Row
from signsplice_workshop.measure.seams import GAP_S, LONGEST_S, stitch

SIGNS = [sign(gloss) for gloss in ("HELLO", "DEAF", "MOTHER", "BOOK", "SEE", "THANK-YOU")]
PAIRS = seams.word_pairs(12, SIGNS)
WORDS = {one.clip.name: one for pair in PAIRS for one in pair}


def row(options: SpliceOptions) -> Row:
    return seams.compare(PAIRS, {"this": options})[0]


def test_the_same_call_draws_the_same_pairs() -> None:
    again = seams.word_pairs(12, SIGNS)
    assert [(p.sign.gloss, q.sign.gloss) for p, q in again] == [(p.sign.gloss, q.sign.gloss) for p, q in PAIRS]
    assert all(p.sign.gloss != q.sign.gloss for p, q in PAIRS)


def test_whole_clips_lower_the_arms_and_keep_the_strokes() -> None:
    ends, trimmed = row(SpliceOptions(cutter="ends")), row(SpliceOptions(cutter="rest-trim"))
    assert ends.arms_down > 10.0
    assert trimmed.arms_down == 0.0
    assert ends.whole == trimmed.whole == 1.0


def test_an_idle_hand_that_is_planned_is_slower_and_no_seam_is_longer_for_it() -> None:
    recorded, planned = (row(SpliceOptions(free_hand=choice)) for choice in ("transition", "natural"))
    assert recorded.idle_peak is not None
    assert planned.idle_peak is not None
    assert planned.idle_fastest is not None
    assert planned.idle_peak < 0.75 * recorded.idle_peak
    assert planned.idle_fastest < 1.25 * PLAN.rising_m_s, "it rises in an arc, and is timed by the straight line"
    assert planned.seconds < recorded.seconds
    assert (planned.whole, planned.arms_down) == (recorded.whole, recorded.arms_down)


class IntoTheStroke(Cutter):
    """Leaves every word two frames before its last movement ends."""

    name, summary = "into-the-stroke", ""

    def cut(self, before: Clip, after: Clip) -> Cut:
        p, q = WORDS[before.name], WORDS[after.name]
        return Cut(p.events.passes[-1][1] - 2, q.events.start)


@pytest.mark.parametrize("rest", RESTS)
def test_arms_stay_up_between_two_words_from_any_rest(rest: str) -> None:
    words = seams.word_pairs(6, SIGNS, rest)
    assert all(p.signer.rest == q.signer.rest == rest for p, q in words)
    methods = seams.methods_to_compare()
    names = ("ends + hermite", "learned + learned")
    whole, learned, _ = seams.compare(words, {name: methods[name] for name in names})
    assert whole.arms_down > 15.0, "whole words come from rest and go back to it"
    assert learned.arms_down < 0.4 * whole.arms_down, "a sign at the hip is as low as folded hands"
    assert learned.whole > 0.8
    assert (rest in seams.signature(rest)) == (rest != "hanging")


def test_a_cut_into_the_stroke_is_counted() -> None:
    assert row(SpliceOptions(cutter=IntoTheStroke())).whole == 0.0


class RestKept(Cutter):
    """Keeps some frames of the way to rest and from it."""

    name, summary = "rest-kept", ""

    def cut(self, before: Clip, after: Clip) -> Cut:
        p, q = WORDS[before.name], WORDS[after.name]
        return Cut(p.events.end + 8, q.events.start - 8)


def test_a_hand_that_sinks_between_two_strokes_is_a_dip() -> None:
    kept, whole, default = (row(SpliceOptions(cutter=one)) for one in (RestKept(), "ends", None))
    assert (whole.dips, whole.stroke_dips) == (0.0, 1.0), "the transition lies at rest, the dip before and after it"
    assert kept.deep_stroke_dips == 1.0
    assert kept.deepest_dip is not None
    assert default.deepest_dip is not None
    assert 0.0 < default.deepest_dip < 0.06 < kept.deepest_dip
    assert default.dips == default.deep_stroke_dips == 0.0


def test_a_held_pose_jumps_and_a_curve_does_not() -> None:
    hold, hermite = row(SpliceOptions(transition="hold")), row(SpliceOptions(transition="hermite"))
    assert hold.velocity_jump > 2.0 * hermite.velocity_jump
    assert hold.peak_speed > hermite.peak_speed


def test_collision_avoidance_leaves_no_hand_in_the_body() -> None:
    cleared = row(SpliceOptions(avoid_collisions=True))
    assert cleared.deep == 0.0
    assert cleared.deepest is not None
    assert cleared.deepest <= 0.0031


def test_the_stitcher_trims_shortens_and_fills_as_published() -> None:
    before, after = word("HELLO").clip, word("BOOK").clip
    made = stitch(before, after)
    assert made.stop - made.first == int(GAP_S * 30.0) == 2
    assert len(made.positions) <= 2 * round(LONGEST_S * 30.0) + 2
    for clip, (first, stop) in ((before, made.kept_before), (after, made.kept_after)):
        assert 0 <= first < stop <= len(clip)
        motion = arms(clip)
        raised = np.any((motion.wrists - motion.elbows) @ motion.up > 0.0, axis=1)
        assert np.mean(raised[first:stop]) > 0.5, "trimmed to the raised arms"
    elbow, wrist = rig_info(before.skeleton).arm_joints[1:3]
    bone = np.linalg.norm(made.positions[:, wrist] - made.positions[:, elbow], axis=-1)
    assert np.ptp(bone) > 1e-3, "points do not keep the length of bones"


def test_the_filter_of_the_stitcher_also_changes_the_signs() -> None:
    """A tremor of 10 Hz in a word is removed, its slow motion is not."""
    clip = word("HELLO").clip[20:42]  # raised and short: its tempo stays
    tremor = [0.0, 1.0, 0.0] * np.cos(np.arange(len(clip)) / 3 * 2 * np.pi)[:, None]
    trembling = replace(clip, root_positions=clip.root_positions + tremor)
    still, shaken = (stitch(one, one).positions[5:13, 0, 1] for one in (clip, trembling))
    assert np.abs(shaken - still).max() < 0.1
    assert np.abs(trembling.root_positions - clip.root_positions).max() == pytest.approx(1.0)


def test_the_stitcher_does_not_shorten_short_clips() -> None:
    clip = word("HELLO").clip[25:37]
    made = stitch(clip, clip)
    assert made.kept_before[0] == 0
    assert made.kept_after[1] == len(clip)


def test_the_command_prints_a_table_or_json() -> None:
    run = CliRunner().invoke(app, ["evaluate", "seams", "2", "--json"], catch_exceptions=False)
    printed = json.loads(run.stdout)
    assert printed["signature"] == seams.signature()
    assert {r["method"] for r in printed["rows"]} == {*seams.methods_to_compare(), seams.STITCHER}
    stitched = next(r for r in printed["rows"] if r["method"] == seams.STITCHER)
    assert stitched["deepest"] is stitched["stroke_dips"] is None
    assert 0.0 <= stitched["dips"] <= 1.0, "of the transition itself"
    assert {r["n_joins"] for r in printed["rows"]} == {2}


def test_evaluate_refuses_calls_that_it_cannot_measure() -> None:
    with pytest.raises(InputError, match="no rest 'standing', expected"):
        CliRunner().invoke(app, ["evaluate", "seams", "1", "--rest", "standing"], catch_exceptions=False)
    for call, error in (([], "Usage:"), (["seams", "0"], "0 is not in the range x>=1"), (["x"], "No such command 'x'")):
        run = CliRunner().invoke(app, ["evaluate", *call])
        assert run.exit_code == 2
        assert error in run.output


def test_faces_are_measured_and_a_straight_line_cuts_blinks_in_half() -> None:
    pairs = seams.word_pairs(40, SIGNS)
    ours, straight = seams.compare(pairs, {"ours": SpliceOptions(cutter="pose-velocity", transition="slerp")})
    assert (ours.face_jumps, ours.half_blinks) == (0.0, 0.0)
    assert straight.half_blinks > 0.0
