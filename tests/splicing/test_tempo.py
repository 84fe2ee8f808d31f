"""Signs at the tempo of running signing: what is shortened, what is kept, and what the spans say."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from click.testing import CliRunner
from conftest import random_clip
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter1d
from scipy.signal import find_peaks

from reference_poses import arms_out, with_pose
from signing import word
from signsplice.body.retarget import align
from signsplice.cli.commands import app
from signsplice.errors import InputError
from signsplice.motion import Clip, resample, rotation, sample_clip
from signsplice.rig.align import reference
from signsplice.rig.info import arms
from signsplice.rig.inspection import with_ends_held
from signsplice.signer import planner
from signsplice.signer.signer import STANDARD
from signsplice.splicing import report as reports
from signsplice.splicing.contracts import Cut, Cutter
from signsplice.splicing.cutters import CUTTERS
from signsplice.splicing.durations import HUMAN, RUNNING_S, running_sign_s, seconds_a_sign
from signsplice.splicing.engine import SpliceOptions, SpliceResult, Stream, splice, stream
from signsplice.splicing.person import channel_joints, owned_channels
from signsplice.splicing.result import Span, measure_tempo
from signsplice.splicing.tempo import PEAKS, RATES, contact_frames, pace, prominent_peaks, retime_word
from signsplice.splicing.word import AlignedWord, FrameMap
from signsplice_workshop.measure.hands import wrist_positions
from signsplice_workshop.measure.tempo import add_noise, compare, draw_words, hold_longer, table

CUTTER = CUTTERS["pose-velocity"]


def held(clip: Clip, frame: int, n_frames: int) -> Clip:
    """The clip with a frame shown so many frames longer."""
    return sample_clip(clip, np.r_[: frame + 1, [frame] * n_frames, frame + 1 : len(clip)].astype(np.float64))


def at_tempo(clip: Clip, seconds: float) -> AlignedWord:
    return retime_word(AlignedWord(0, clip, clip, FrameMap()), CUTTER, seconds)


@pytest.fixture(scope="module")
def natural(sentence: list[Clip]) -> SpliceResult:
    """The demo's sentence at the tempo of running signing."""
    return splice(sentence, SpliceOptions(tempo="natural"))


def test_citation_plays_signs_as_recorded(sentence: list[Clip]) -> None:
    plain, citation = splice(sentence), splice(sentence, SpliceOptions(tempo="citation"))
    assert np.array_equal(plain.clip.local_rotations, citation.clip.local_rotations)
    assert all(span.warp is None for span in citation.spans)
    assert citation.tempo.mode == "citation"
    assert citation.tempo.asked_seconds is None


def test_natural_comes_near_running_tempo(natural: SpliceResult, sentence: list[Clip]) -> None:
    before = splice(sentence).tempo.seconds
    assert before is not None
    assert natural.tempo.seconds is not None
    assert 0.8 * RUNNING_S < natural.tempo.seconds < 1.2 * RUNNING_S < 1.3 * RUNNING_S < before
    signs = [span.output for span in natural.spans if span.kind == "sign"]
    inner = sum(b - a for a, b in [span.output for span in natural.spans[1:-3]])
    assert natural.tempo.seconds == pytest.approx(inner / natural.clip.fps / (len(signs) - 2), abs=1e-3)


def kept_joints(span: Span, clip: Clip) -> list[int]:
    """The joints of a clip that its span does not name as remade, with all that belong to the word."""
    remade = () if span.remade is None else span.remade.joints
    kept = [joint for joint, name in enumerate(clip.skeleton.names) if name not in remade]
    assert {joint for channel in owned_channels(clip) for joint in channel_joints(clip, channel)} <= {*kept}
    return kept


def test_the_frames_that_a_warp_lists_rebuild_the_sign_bit_for_bit(natural: SpliceResult, sentence: list[Clip]) -> None:
    first, n_warped = reference(sentence[0]), 0
    for span in natural.spans:
        if span.warp is None or span.clip is None or span.source is None:
            continue
        n_warped += 1
        outputs, sources = np.array(span.warp).T
        assert outputs.tolist() == list(range(*span.output))
        assert (np.diff(sources) > 0.0).all()
        assert (np.diff(sources) < 1.1 * RATES.highest_rate).all()
        assert span.source[0] <= sources[0]
        assert sources[-1] <= span.source[1] - 1
        source = align(sentence[span.clip], first).clip
        same = sample_clip(source, sources).local_rotations == natural.clip.local_rotations[slice(*span.output)]
        assert same[:, kept_joints(span, source)].all()
    assert n_warped >= 4


def test_a_warp_rebuilds_a_sign_whose_first_frames_are_left_out_bit_for_bit(sentence: list[Clip]) -> None:
    posed = with_pose(sentence[1], arms_out(sentence[1].skeleton), 40)
    span = (result := splice([sentence[0], posed], SpliceOptions(tempo="natural"))).spans[2]
    assert span.warp is not None
    assert span.source is not None
    assert span.source[0] >= 40
    source = align(with_ends_held(posed), reference(sentence[0])).clip
    part = sample_clip(source, np.array(span.warp)[:, 1]).local_rotations
    kept = kept_joints(span, sentence[1])
    assert np.array_equal(part[:, kept], result.clip.local_rotations[slice(*span.output), kept])


class NoCuts(Cutter):
    """Chooses nothing; fails once on a word that is named BAD."""

    name, summary = "no-cuts", "for tests"

    def cut_all(self, clips: Sequence[Clip]) -> list[Cut]:
        return [] if clips[0].name == "BAD" else CUTTER.cut_all(clips)


def test_a_first_word_that_the_cutter_fails_on_is_refused_and_leaves_no_trace(sentence: list[Clip]) -> None:
    growing = Stream(SpliceOptions(NoCuts(), "hermite", tempo="natural"))
    with pytest.raises(InputError, match="cutter no-cuts chose 0 cuts for 2 clips"):
        growing.push(replace(resample(sentence[0], 25.0), name="BAD"))
    growing.push(sentence[1])
    assert growing.end()[0].clip.fps == 30.0


def test_naming_a_default_is_choosing_nothing(sentence: list[Clip]) -> None:
    options = SpliceOptions(tempo="natural")
    plain, named = (
        splice(sentence[:3], replace(options, cutter=name, transition=name, duration=duration)).seams
        for name, duration in ((None, None), ("learned", "tempo"))
    )
    assert named == plain


def test_no_frame_of_what_citation_keeps_is_lost(natural: SpliceResult, sentence: list[Clip]) -> None:
    for ours, theirs in zip(natural.spans, splice(sentence).spans, strict=True):
        if ours.kind == "sign" and ours.source is not None and theirs.source is not None:
            assert ours.source[0] <= theirs.source[0]
            assert theirs.source[1] <= ours.source[1]


@pytest.mark.parametrize("tempo", ["natural", 0.5])
def test_a_stream_sends_the_same_frames(tempo: str | float, sentence: list[Clip]) -> None:
    options = SpliceOptions("pose-velocity", "hermite", tempo=tempo)
    whole, pieces = splice(sentence, options), list(stream(sentence, options))
    assert tuple(piece.span for piece in pieces) == whole.spans
    rotations = np.concatenate([piece.clip.local_rotations for piece in pieces])
    assert np.array_equal(rotations, whole.clip.local_rotations)


def test_holds_are_shortened_more_than_movements() -> None:
    sign = word("MY")
    first, last, n_held = sign.events.start, sign.events.end, 24
    clip = held(sign.clip, last, n_held)
    rates = pace(clip).rates(first, last + n_held, 0.4)
    assert np.median(rates[last + 3 : last + n_held - 3]) > 2.0 * np.median(rates[first:last])
    assert (rates >= 1.0 - 1e-9).all()


def test_noise_of_a_capture_keeps_no_hold_long() -> None:
    sign = word("MY")
    clip = held(sign.clip, sign.events.end, 24)
    white = np.random.default_rng(0).standard_normal((*clip.local_rotations.shape[:2], 3))
    turns = gaussian_filter1d(white, 1.0, axis=0)
    turns *= 0.004 / turns.std()
    noisy = replace(clip, local_rotations=rotation.multiply(clip.local_rotations, rotation.exp(turns)))
    seconds = [at_tempo(one, RUNNING_S).retimed.seconds for one in (clip, noisy)]
    assert seconds[1] < 1.15 * seconds[0]


def test_signs_aim_at_what_people_make_of_their_length() -> None:
    assert running_sign_s(0.5) == pytest.approx(0.31)
    assert running_sign_s(2.5) == pytest.approx(0.44)
    assert running_sign_s(0.5, 1.4) == pytest.approx(0.62)
    lengths = [len(at_tempo(word(gloss).clip, RUNNING_S).retimed) for gloss in ("MY", "UNDERSTAND", "COFFEE")]
    assert lengths == sorted(lengths)


def test_a_hold_below_the_height_of_rest_is_shortened_too() -> None:
    """KING ends at the hip."""
    sign = word("KING")
    clips = (sign.clip, held(sign.clip, sign.events.end, 24))
    options = SpliceOptions(tempo="natural")
    plain, longer = (splice([clip, word("MOTHER").clip], options).spans[0].output[1] for clip in clips)
    assert longer < plain + 9, "frames"


def test_hands_stay_below_human_peaks(natural: SpliceResult, sentence: list[Clip]) -> None:
    recorded = max(_peak(clip) for clip in sentence)
    assert _peak(natural.clip) < max(1.05 * PEAKS["Hand"][0], recorded)


def test_even_the_fastest_tempo_stops_at_human_peaks() -> None:
    clip = word("TOILET").clip
    played = at_tempo(clip, 0.4)
    assert _peak(played.retimed) < 1.05 * PEAKS["Hand"][0]
    assert played.retimed.seconds > clip.seconds - 1.2


def test_a_contact_is_seen_in_two_frames_at_least() -> None:
    for gloss in ("FATHER", "HAT", "PRIVATE", "APPLE"):
        clip = word(gloss).clip
        played = at_tempo(clip, 0.4)
        assert played.frames.sources is not None
        for start, stop in contact_frames(clip):
            shown = (played.frames.sources >= start) & (played.frames.sources <= stop - 1)
            if stop - 1 - start >= RATES.least_contact_s * clip.fps:
                assert shown.sum() >= 2, gloss


def test_movements_are_neither_lost_nor_passed_over() -> None:
    (row,) = compare({"these": [word(g) for g in ("BIRD", "WRITE", "DOG", "BOY", "LAZY")]}, ["natural"])
    assert row.whole == row.repetitions == 1.0
    assert row.shortest_pass is not None
    assert row.shortest_pass > 0.07
    assert "| these | natural | 5 |" in table([row], 5)[-1]


def test_speed_does_not_step_where_a_transition_begins_and_ends(natural: SpliceResult) -> None:
    """No more than where a sign as fast as these accelerates."""
    assert np.median([seam.velocity_jump for seam in natural.seams]) < 0.62


def test_a_sign_that_is_short_enough_is_played_as_recorded() -> None:
    clip = word("fs-A").clip
    assert at_tempo(clip, 3.0).frames.sources is None
    assert at_tempo(clip, 3.0).retimed is clip


def test_seconds_a_sign_are_a_tempo_between(sentence: list[Clip]) -> None:
    fast, slow, recorded = (splice(sentence, SpliceOptions(tempo=x)).tempo for x in ("natural", 1.1, "citation"))
    assert fast.seconds is not None
    assert slow.seconds is not None
    assert recorded.seconds is not None
    assert fast.seconds < slow.seconds < recorded.seconds
    assert (slow.mode, slow.asked_seconds) == ("seconds", 1.1)
    assert seconds_a_sign("1.1") == 1.1


def test_transitions_take_a_quarter_of_a_second_or_more_and_a_named_rule_stays(
    natural: SpliceResult, sentence: list[Clip]
) -> None:
    seconds = [seam.seconds for seam in natural.seams]
    assert min(seconds) >= 0.25 - 0.5 / 30.0
    slow = splice(sentence, SpliceOptions(tempo=1.4))
    for seam, before, after in zip(slow.seams, sentence, sentence[1:], strict=False):
        travel = arms(after).wrists[seam.post_frame, 1] - arms(before).wrists[seam.pre_frame, 1]
        people_s = HUMAN.still_transition_s + HUMAN.doubling_s * np.log2(
            1.0 + np.linalg.norm(travel) / arms(before).shoulder_width
        )
        assert seam.seconds == pytest.approx(2.0 * people_s, abs=0.5 / 30.0), "of the right hand: the left one is idle"
    fixed = splice(sentence, SpliceOptions(tempo="natural", transition_time=0.5))
    assert {seam.n_transition for seam in fixed.seams} == {15}
    named = splice(sentence, SpliceOptions("ends", "hermite", "fixed", tempo=1.5))
    assert {seam.seconds for seam in named.seams} == {8 / 30.0}


def test_the_rate_of_frames_does_not_change_the_tempo() -> None:
    clips = [word(gloss).clip for gloss in ("HELLO", "DEAF", "MOTHER", "BOOK")]
    at_60 = [resample(clip, 60.0) for clip in clips]
    seconds = [splice(row, SpliceOptions(tempo="natural")).tempo.seconds for row in (clips, at_60)]
    assert seconds[0] is not None
    assert seconds[1] == pytest.approx(seconds[0], rel=0.15)


@pytest.mark.parametrize("tempo", ["fast", "", 0.1, 4.0, float("nan"), True])
def test_other_tempos_are_refused(tempo: str | float) -> None:
    with pytest.raises(InputError, match=r"tempo .*, expected citation, natural or 0.4 to 1.5 seconds a sign"):
        SpliceOptions(tempo=tempo)


def test_a_rig_without_known_arms_is_played_as_recorded() -> None:
    clips = [random_clip(1), random_clip(1)]
    result = splice(clips, SpliceOptions("ends", "hermite", tempo="natural"))
    assert any("it is played as recorded, whatever the tempo" in line for line in result.warnings)
    assert result.spans[0].source == (0, len(clips[0]))


def test_the_report_says_what_was_asked_and_reached(natural: SpliceResult, tmp_path: pytest.TempPathFactory) -> None:
    described = json.loads(json.dumps(reports.describe(natural)))
    assert described["tempo"] == {"mode": "natural", "asked_seconds": RUNNING_S, "seconds": natural.tempo.seconds}
    warped = next(span for span in described["spans"] if span["warp"])
    assert warped["warp"][0][0] == warped["output"][0]
    path = f"{tmp_path}/r.json"
    reports.write(described, path)
    assert reports.read(path, len(natural.clip))["spans"] == described["spans"]


def test_lexicons_share_no_word_and_have_enough() -> None:
    drawn = draw_words(7)
    glosses = [one.gloss for _, signs in drawn.values() for one in signs]
    assert len(set(glosses)) == len(glosses) == 7 * len(drawn)
    assert all(p[0] != q[0] for p, q in pairwise(drawn.values()))
    with pytest.raises(InputError, match="500 words of each signer, expected 7 to"):
        draw_words(500)


def test_slow_and_noisy_words_come_near_running_tempo_too() -> None:
    words = [
        planner.synthesize_word(word(gloss).sign, replace(STANDARD, tempo=0.6))
        for gloss in ("BIRD", "DOG", "BOY", "MY")
    ]
    slow = [add_noise(hold_longer(slow, 0.5), 0.004) for slow in words]
    assert [one.events.end - plain.events.end for one, plain in zip(slow, words, strict=True)] == [15] * len(words)
    rows = compare({"slow": slow})
    assert rows[0].ratio > 2.0
    assert rows[1].ratio < 1.4
    assert rows[1].whole >= rows[0].whole


def test_evaluate_refuses_more_words_than_there_are() -> None:
    run = CliRunner().invoke(app, ["evaluate", "tempo", "500"])
    assert isinstance(run.exception, InputError)
    assert "500 words of each signer, expected 7 to 55" in str(run.exception)


def _peak(clip: Clip) -> float:
    return float(np.linalg.norm(np.diff(wrist_positions(clip), axis=0), axis=-1).max() * clip.fps)


def test_the_tempo_reached_is_that_of_signs_not_of_letters() -> None:
    signs = [
        ("A", (0, 30)),
        ("B", (40, 60)),
        ("fs-X", (65, 70)),
        ("fs-Y", (72, 78)),
        ("C", (85, 99)),
        ("D", (110, 150)),
    ]
    assert measure_tempo(signs, 30.0, "citation").seconds == pytest.approx((30 + 21) / 2 / 30.0, abs=1e-3)
    assert measure_tempo(signs[:2], 30.0, "natural").seconds is None
    assert measure_tempo([signs[0], *signs[2:4], signs[5]], 30.0, "natural").seconds is None


@given(st.lists(st.integers(0, 6) | st.floats(0.0, 6.0), min_size=1, max_size=60), st.floats(0.0, 3.0))
def test_prominent_peaks_are_those_of_scipy(values: list[float], prominence: float) -> None:
    array = np.array(values, dtype=float)
    assert prominent_peaks(array, prominence) == find_peaks(array, prominence=prominence)[0].tolist()
