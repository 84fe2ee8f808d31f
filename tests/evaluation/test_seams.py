"""Words joined where they truly meet: what is counted there, and the stitcher beside it."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from signing import sign, word
from signsplice.cli import app
from signsplice.errors import InputError
from signsplice.evaluation import seams
from signsplice.evaluation.stitcher import EMPTY_S, LONGEST_S, stitch
from signsplice.motion.clip import Clip
from signsplice.rig.arms import arm_joints, arms
from signsplice.splicing.cut import Cut
from signsplice.splicing.engine import SpliceOptions
from signsplice.synth.signer import RESTS

PAIRS = seams.pairs(12, [sign(gloss) for gloss in ("HELLO", "DEAF", "MOTHER", "BOOK", "SEE", "THANK-YOU")])


def row(options: SpliceOptions) -> seams.SeamRow:
    return seams.compare(PAIRS, {"this": options})[0]


def test_pairs_are_drawn_once_and_for_all() -> None:
    again = seams.pairs(12, [sign(gloss) for gloss in ("HELLO", "DEAF", "MOTHER", "BOOK", "SEE", "THANK-YOU")])
    assert [(p.sign.gloss, q.sign.gloss) for p, q in again] == [(p.sign.gloss, q.sign.gloss) for p, q in PAIRS]
    assert all(p.sign.gloss != q.sign.gloss for p, q in PAIRS)


def test_whole_clips_drop_the_arms_and_keep_the_strokes() -> None:
    ends, trimmed = row(SpliceOptions(cutter="ends")), row(SpliceOptions(cutter="rest-trim"))
    assert ends.arms_down > 10.0
    assert trimmed.arms_down == 0.0
    assert ends.whole == trimmed.whole == 1.0


class IntoTheStroke:
    """Leaves every word two frames before its last movement ends."""

    name, summary, learned = "into-the-stroke", "", False

    def cut(self, before: Clip, after: Clip) -> Cut:
        p, q = next((p, q) for p, q in PAIRS if (p.clip.name, q.clip.name) == (before.name, after.name))
        return Cut(p.events.passes[-1][1] - 2, q.events.start)


@pytest.mark.parametrize("rest", RESTS)
def test_nobody_goes_back_to_rest_between_two_words(rest: str) -> None:
    signs = [sign(gloss) for gloss in ("HELLO", "DEAF", "MOTHER", "BOOK", "SEE", "THANK-YOU")]
    words = seams.pairs(6, signs, rest)
    assert all(p.who.rest == q.who.rest == rest for p, q in words)
    ways = {
        name: way for name, way in seams.compared_methods().items() if name in ("ends + hermite", "learned + learned")
    }
    whole, learned, _ = seams.compare(words, ways)
    assert whole.arms_down > 15.0, "played as they are, words come from rest and go there"
    assert learned.arms_down < 1.0
    assert learned.whole > 0.8
    assert (rest in seams.signature(rest)) == (rest != "hanging")


def test_a_cut_into_the_stroke_is_counted() -> None:
    assert row(SpliceOptions(cutter=IntoTheStroke())).whole == 0.0


def test_a_held_pose_jumps_and_slow_ways_do_not() -> None:
    held, curved = row(SpliceOptions(transition="hold")), row(SpliceOptions(transition="hermite"))
    assert held.velocity_jump > 2.0 * curved.velocity_jump
    assert held.peak_speed > curved.peak_speed


def test_body_sense_leaves_no_hand_in_the_body() -> None:
    clear = row(SpliceOptions(avoid_collisions=True))
    assert clear.deep == 0.0
    assert clear.deepest is not None
    assert clear.deepest <= 0.0031


def test_the_stitcher_does_what_is_told_of_it() -> None:
    before, after = word("HELLO").clip, word("BOOK").clip
    made = stitch(before, after)
    assert made.stop - made.first == int(EMPTY_S * 30.0) == 2
    assert len(made.positions) <= 2 * round(LONGEST_S * 30.0) + 2
    for clip, (first, stop) in ((before, made.kept_before), (after, made.kept_after)):
        assert 0 <= first < stop <= len(clip)
        seen = arms(clip)
        up = np.any((seen.wrists - seen.elbows) @ seen.up > 0.0, axis=1)
        assert np.mean(up[first:stop]) > 0.5, "trimmed to the raised arms"
    elbow, wrist = arm_joints(before.skeleton)[1:3]
    bone = np.linalg.norm(made.positions[:, wrist] - made.positions[:, elbow], axis=-1)
    assert np.ptp(bone) > 1e-3, "points know nothing of bones"


def test_the_stitchers_filter_goes_over_the_signs_too() -> None:
    """A tremor of 10 Hz in a word is gone, and the word's own slow motion is not."""
    clip = word("HELLO").clip[20:42]  # raised and short: its tempo stays
    at = np.arange(len(clip))
    trembling = replace(
        clip, root_positions=clip.root_positions + [0.0, 1.0, 0.0] * np.cos(at / 3 * 2 * np.pi)[:, None]
    )
    still, shaken = (stitch(one, one).positions[5:13, 0, 1] for one in (clip, trembling))
    assert np.abs(shaken - still).max() < 0.1
    assert np.abs(trembling.root_positions - clip.root_positions).max() == pytest.approx(1.0)


def test_the_stitcher_leaves_a_short_raised_clip_its_tempo() -> None:
    clip = word("HELLO").clip[25:37]
    made = stitch(clip, clip)
    assert made.kept_before[0] == 0
    assert made.kept_after[1] == len(clip)


def test_the_command_prints_a_table_or_json() -> None:
    called = CliRunner().invoke(app, ["evaluate", "--joins", "2", "--json"], catch_exceptions=False)
    told = json.loads(called.stdout)
    assert told["signature"] == seams.signature()
    assert {r["method"] for r in told["rows"]} == {*seams.compared_methods(), seams.STITCHER}
    assert next(r for r in told["rows"] if r["method"] == seams.STITCHER)["deepest"] is None
    table = CliRunner().invoke(app, ["evaluate", "--joins", "1"], catch_exceptions=False).stdout
    assert "| stitcher |" in table
    for call in (
        [],
        ["--joins", "1", "--clips", "x.bvh"],
        ["--joins", "0"],
        ["--joins", "1", "--rest", "standing"],
    ):
        with pytest.raises(InputError, match="expected"):
            CliRunner().invoke(app, ["evaluate", *call], catch_exceptions=False, standalone_mode=False)
    with pytest.raises(InputError, match="--rest tells how the signer of --joins rests"):
        CliRunner().invoke(
            app, ["evaluate", "--clips", "x.bvh", "--rest", "low"], catch_exceptions=False, standalone_mode=False
        )
