"""The engine: eq. 17 bit for bit, append-only pieces, spans, seams and reports that rebuild the output."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

import signsplice as ss
from conftest import random_clip, rooted
from signsplice import demo
from signsplice.errors import InputError
from signsplice.motion import kinematics, rotation
from signsplice.motion.clip import Clip, resample
from signsplice.rig.align import align, reference
from signsplice.splicing import report
from signsplice.splicing.cut import CUTTERS, Cut, Cutter, PairCutter
from signsplice.splicing.engine import SpliceOptions, SpliceResult, Stream, splice, stream
from signsplice.splicing.gap import Gap
from signsplice.splicing.inbetween import inbetween
from signsplice.splicing.transition import TRANSITIONS, GapTransition, find_transition

CLASSICAL = SpliceOptions("pose-velocity", "hermite", "tempo")


@pytest.fixture(scope="module")
def sentence(words: dict[str, Clip]) -> list[Clip]:
    return [words[gloss] for gloss in demo.SENTENCE]


def rebuilt(result: SpliceResult, clips: list[Clip]) -> rotation.Float:
    """Eq. 17 by the report: sign spans copied from their harmonized sources, transitions from the output."""
    onto = reference(clips[0], result.clip.fps)
    out = np.full_like(result.clip.local_rotations, np.nan)
    for span in result.spans:
        a, b = span.output
        if span.kind == "sign":
            assert span.clip is not None
            assert span.source is not None
            source = align(clips[span.clip], onto).clip
            out[a:b] = source.local_rotations[slice(*span.source)]
        else:
            out[a:b] = result.clip.local_rotations[a:b]
    return out


@pytest.mark.parametrize("cutter", list(CUTTERS))
@pytest.mark.parametrize("transition", ["hold", "hermite", "quintic"])
def test_spans_rebuild_the_output_bit_for_bit(cutter: str, transition: str, sentence: list[Clip]) -> None:
    result = splice(sentence, SpliceOptions(cutter=cutter, transition=transition))
    assert np.array_equal(rebuilt(result, sentence), result.clip.local_rotations)
    assert [span.kind for span in result.spans] == ["sign", "transition"] * (len(sentence) - 1) + ["sign"]
    at = 0
    for span in result.spans:
        assert span.output[0] == at
        at = span.output[1]
    assert at == len(result.clip)
    assert len(result.seams) == len(sentence) - 1


def test_source_frames_of_one_rig_are_the_very_frames(sentence: list[Clip]) -> None:
    result = splice(sentence)
    for span in result.spans:
        if span.clip is not None and span.source is not None:
            source = sentence[span.clip].local_rotations[slice(*span.source), 1:]
            assert np.array_equal(result.clip.local_rotations[slice(*span.output), 1:], source)


def test_the_sentence_is_shorter_and_its_arms_stay_up(sentence: list[Clip]) -> None:
    from signsplice.rig.arms import active_span, arms

    result = splice(sentence)
    assert len(result.clip) < 0.75 * sum(map(len, sentence))
    lift = arms(result.clip).lift.max(axis=1)
    start, stop = active_span(arms(result.clip))
    assert lift[start:stop].min() > 0.25
    assert lift[0] < 0.1
    assert lift[-1] < 0.1


@pytest.mark.parametrize("options", [CLASSICAL, SpliceOptions()], ids=["classical", "learned"])
def test_pieces_that_are_out_never_change(options: SpliceOptions, sentence: list[Clip]) -> None:
    """A longer sentence begins with the very pieces of a shorter one, save the last sign, which ran to its end."""
    whole = list(stream(sentence, options))
    for n in range(1, len(sentence)):
        part = list(stream(sentence[:n], options))
        for a, b in zip(part[:-1], whole, strict=False):
            assert np.array_equal(a.clip.local_rotations, b.clip.local_rotations)
            assert np.array_equal(a.clip.root_positions, b.clip.root_positions)
            assert a.span == b.span
    joined = np.concatenate([piece.clip.local_rotations for piece in whole])
    at_once = splice(sentence, options).clip.local_rotations
    if options is CLASSICAL:
        assert np.array_equal(joined, at_once)
    # 8-bit weights round by all that is in a batch: by a third of a degree here.
    assert rotation.angle_between(joined, at_once).max() < 0.02


def test_pieces_come_as_soon_as_the_next_word_is_known(sentence: list[Clip]) -> None:
    asked: list[int] = []

    def words_one_by_one() -> object:
        for n, clip in enumerate(sentence):
            asked.append(n)
            yield clip

    pieces = stream(words_one_by_one())  # type: ignore[arg-type]
    next(pieces)
    assert asked == [0, 1]
    next(pieces)
    assert asked == [0, 1]
    next(pieces)
    assert asked == [0, 1, 2]


def test_words_that_are_pushed_come_out_as_words_that_are_pulled(sentence: list[Clip]) -> None:
    pulled = list(stream(sentence, CLASSICAL))
    growing = Stream(CLASSICAL)
    pushed = [growing.push(clip) for clip in sentence]
    assert [len(pieces) for pieces in pushed] == [0, *[2] * (len(sentence) - 1)]
    rest = growing.end()
    assert growing.end() == []
    for a, b in zip([*(piece for pieces in pushed for piece in pieces), *rest], pulled, strict=True):
        assert np.array_equal(a.clip.local_rotations, b.clip.local_rotations)
        assert (a.span, a.warnings, a.seam is None) == (b.span, b.warnings, b.seam is None)


def test_a_word_that_cannot_be_joined_is_not_part_of_the_sentence(sentence: list[Clip]) -> None:
    growing = Stream(CLASSICAL)
    growing.push(sentence[0])
    with pytest.raises(ss.SignspliceError):
        growing.push(random_clip(0))
    pieces = [*growing.push(sentence[1]), *growing.end()]
    for a, b in zip(pieces, stream(sentence[:2], CLASSICAL), strict=True):
        assert np.array_equal(a.clip.local_rotations, b.clip.local_rotations)
        assert a.span == b.span


def test_the_transition_time_is_the_users(sentence: list[Clip]) -> None:
    for seconds, n_frames in ((0.5, 15), (0.1, 3), (0.0, 0)):
        result = splice(sentence[:3], SpliceOptions(transition_time=seconds))
        assert [seam.n_transition for seam in result.seams] == [n_frames] * 2
        assert result.seams[0].seconds == pytest.approx(n_frames / 30)
    automatic = [seam.seconds for seam in splice(sentence).seams]
    assert min(automatic) >= 0.25 - 0.5 / 30
    assert max(automatic) < 0.8


def test_durations_follow_their_laws(sentence: list[Clip]) -> None:
    from signsplice.rig.arms import arms
    from signsplice.splicing.duration import find_duration, travel_widths

    p, q = sentence[0], sentence[4]
    a, b = arms(p), arms(q)
    pre, post = 43, 12  # both hands in full motion
    cut = Cut(pre, post)
    width = travel_widths(a, b, pre, post)
    assert find_duration("travel").seconds(p, q, cut) == pytest.approx(0.051 + 0.149 * np.log2(1 + width / 0.15))
    assert find_duration("fixed").seconds(p, q, cut) == 0.25
    assert find_duration("tempo").seconds(p, p, Cut(40, 40)) == 0.25
    way = np.linalg.norm(b.wrists[post] - a.wrists[pre], axis=-1)
    hand = int(np.argmax(way))
    steps = (a.wrists[pre, hand] - a.wrists[pre - 1, hand], b.wrists[post + 1, hand] - b.wrists[post, hand])
    speed = np.mean([np.linalg.norm(step) * 30.0 for step in steps])
    assert find_duration("speed").seconds(p, q, cut) == pytest.approx(way[hand] / speed)
    with pytest.raises(InputError, match="no duration 'x', expected one of tempo"):
        find_duration("x")


def test_sign_speed_and_rate(sentence: list[Clip]) -> None:
    slow, fast = (splice(sentence[:2], replace(CLASSICAL, sign_speed=x, transition_time=0.3)) for x in (0.5, 2.0))
    assert len(slow.clip) > 3 * len(fast.clip)
    doubled = splice(sentence[:2], replace(CLASSICAL, fps=60.0))
    assert doubled.clip.fps == 60.0
    assert doubled.clip.seconds == pytest.approx(splice(sentence[:2], CLASSICAL).clip.seconds, abs=0.15)


def test_mixed_rates_come_out_at_the_first_ones(words: dict[str, Clip]) -> None:
    from signsplice.motion.clip import resample

    other = resample(words["SIGN"], 24.0)
    mixed, plain = splice([words["I"], other]), splice([words["I"], words["SIGN"]])
    assert mixed.clip.fps == 30.0
    assert mixed.clip.seconds == pytest.approx(plain.clip.seconds, abs=0.1)


def test_euler_orders_and_joint_names_do_not_change_the_motion(words: dict[str, Clip]) -> None:
    """The second clip from a file with other channel orders and prefixes: the same splice, written in the first's
    orders.
    """
    from signsplice.formats import bvh
    from signsplice.motion.euler_channels import Channels

    plain = [bvh.parse(bvh.encode(words[gloss]), gloss) for gloss in ("I", "SIGN")]
    n_joints = len(words["SIGN"].skeleton)
    names = [("Yrotation", "Zrotation", "Xrotation"), ("Xrotation", "Yrotation", "Zrotation")]
    layout = tuple(
        (names[j % 2] + ("Zposition", "Xposition", "Yposition")) if j == 0 else names[j % 2] for j in range(n_joints)
    )
    empty = Channels(layout, np.full((len(plain[1]), 3 * n_joints + 3), np.nan), plain[1].skeleton.offsets, 1 / 30)
    other = replace(plain[1], channels=empty)
    content = bvh.encode(other).replace(b"mixamorig:", b"mixamorig_")
    mixed = splice([plain[0], bvh.parse(content, "SIGN")])
    wanted = splice(plain)
    assert [seam.pre_frame for seam in mixed.seams] == [seam.pre_frame for seam in wanted.seams]
    assert np.all(rotation.angle_between(mixed.clip.local_rotations, wanted.clip.local_rotations) < 1e-6)
    written = bvh.parse(bvh.encode(mixed.clip))
    assert written.channels is not None
    assert plain[0].channels is not None
    assert written.channels.names == plain[0].channels.names
    assert np.all(rotation.angle_between(written.local_rotations, wanted.clip.local_rotations) < 1e-6)


def test_one_clip_is_itself(words: dict[str, Clip]) -> None:
    result = splice([words["I"]])
    assert np.array_equal(result.clip.local_rotations, words["I"].local_rotations)
    assert result.seams == ()
    with pytest.raises(InputError, match="nothing to splice"):
        splice([])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"transition_time": -1.0}, "transition time -1s, expected 0 to 10s"),
        ({"transition_time": float("nan")}, "transition time nan"),
        ({"sign_speed": 0.0}, "sign speed 0, expected 0.1 to 10"),
        ({"fps": 1e9}, "fps 1e\\+09, expected 1 to 1000"),
    ],
)
def test_dials_have_limits(options: dict[str, float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        SpliceOptions(**options)  # type: ignore[arg-type]


def test_clips_without_known_arms_can_be_joined_at_their_ends() -> None:
    clip = random_clip(0)
    result = splice([clip, clip], SpliceOptions(cutter="ends"))
    assert len(result.clip) == 2 * len(clip) + 8
    assert any("no arms known" in line for line in result.seams[0].warnings)
    assert report.describe(result)["seams"][0]["velocity_jump"] is None


def test_the_report_says_what_the_result_is(sentence: list[Clip]) -> None:
    result = splice(sentence)
    told = json.loads(json.dumps(report.describe(result, {"load": 1.5})))
    assert told["version"] == 1
    assert told["frames"] == len(result.clip)
    assert told["fps"] == 30.0
    assert told["bundle"] == result.bundle
    assert told["timing_ms"]["load"] == 1.5
    assert set(told["timing_ms"]) >= {"load", "cut", "transition", "join", "save"}
    first, second = told["spans"][:2]
    assert first == {"kind": "sign", "clip": 0, "name": "HELLO", "source": first["source"], "output": first["output"]}
    assert second == {"kind": "transition", "clip": None, "name": None, "source": None, "output": second["output"]}
    seam = told["seams"][0]
    assert seam["pre_frame"] == first["source"][1] - 1
    assert seam["post_frame"] == told["spans"][2]["source"][0]
    assert seam["n_transition"] == second["output"][1] - second["output"][0]
    assert list(seam) == [
        "before", "after", "pre_frame", "post_frame", "n_transition", "seconds",
        "velocity_jump", "peak_speed_m_s", "jerk_ratio", "warnings", "intrusion_mm",
    ]  # fmt: skip


def test_seam_scores_tell_good_from_bad(sentence: list[Clip]) -> None:
    good, bad = splice(sentence, CLASSICAL), splice(sentence, replace(CLASSICAL, transition="hold"))
    for a, b in zip(good.seams, bad.seams, strict=True):
        assert a.velocity_jump < b.velocity_jump
        assert a.peak_speed_m_s < b.peak_speed_m_s
        assert a.jerk_ratio < b.jerk_ratio
        assert a.warnings == ()
    assert any("faster than signs do" in line for seam in bad.seams for line in seam.warnings)


@pytest.mark.parametrize("transition", list(TRANSITIONS))
def test_inbetween_changes_nothing_but_the_gaps(transition: str, words: dict[str, Clip]) -> None:
    clip = words["SIGN"]
    result = inbetween(clip, [(50, 58), (20, 25)], transition)
    changed = np.zeros(len(clip), bool)
    changed[20:25] = changed[50:58] = True
    assert np.array_equal(result.clip.local_rotations[~changed], clip.local_rotations[~changed])
    assert len(result.clip) == len(clip)
    assert not np.array_equal(result.clip.local_rotations[changed], clip.local_rotations[changed])
    method = find_transition(transition)
    assert np.array_equal(
        result.clip.local_rotations[50:58], method.between(Gap(clip[42:50], clip[58:66], 8)).local_rotations
    )


def test_frames_that_are_to_be_replaced_are_never_looked_at(words: dict[str, Clip]) -> None:
    clip = words["SIGN"]
    spoilt = np.array(clip.local_rotations)
    spoilt[33:38] = rotation.multiply(spoilt[33:38], rotation.exp([1.0, 0.4, 0.2]))
    other = replace(clip, local_rotations=spoilt)
    gaps = [(20, 32), (33, 38)]
    for transition in TRANSITIONS:
        a, b = (inbetween(c, gaps, transition).clip.local_rotations for c in (clip, other))
        assert np.array_equal(a, b), transition


class Near(PairCutter, GapTransition):
    """A cutter that leaves a sign a few frames after it entered it, and a transition that counts what it is shown."""

    name, summary = "near", "for tests"

    def __init__(self) -> None:
        self.seen: list[int] = []

    def cut(self, before: Clip, after: Clip) -> Cut:
        return Cut(22, 20)

    def between(self, gap: Gap) -> Clip:
        self.seen.append(len(gap.before))
        return find_transition("slerp").between(gap)


def test_frames_that_were_cut_away_are_never_shown(sentence: list[Clip]) -> None:
    near = Near()
    splice(sentence[:4], SpliceOptions(cutter=near, transition=near))
    assert near.seen == [8, 3, 3]


def test_a_transition_of_the_wrong_length_is_refused(sentence: list[Clip]) -> None:
    class Short(Near):
        def between(self, gap: Gap) -> Clip:
            return gap.after[:1]

    with pytest.raises(InputError, match="transition near made 1 frames, expected 15"):
        splice(sentence[:2], SpliceOptions(transition=Short(), transition_time=0.5))


@pytest.mark.parametrize(
    "gaps", [[(0, 5)], [(5, 5)], [(8, 5)], [(70, 78)], [(70, 99)], [(5, 10), (8, 12)], [(5, 10), (10, 12)]]
)
def test_gaps_that_cannot_be_are_refused(gaps: list[tuple[int, int]], words: dict[str, Clip]) -> None:
    with pytest.raises(InputError, match=r"gap \d+:\d+ in \d+ frames, expected"):
        inbetween(words["SIGN"], gaps)


def test_hips_and_feet_neither_jump_nor_slide(words: dict[str, Clip]) -> None:
    """Clips of one signer, each recorded elsewhere in the room, facing another way."""
    rng = np.random.default_rng(4)
    clips = []
    for gloss in ("HELLO", "SIGN", "DEAF"):
        turn, word = rotation.exp([0.0, rng.uniform(-3.0, 3.0), 0.0]), rooted(words[gloss])
        local = np.array(word.local_rotations)
        local[:, 0] = rotation.multiply(turn, local[:, 0])
        roots = rotation.rotate(turn, word.root_positions) + rng.normal(size=3) * 80.0
        clips.append(replace(word, local_rotations=local, root_positions=roots))
    result = splice(clips)
    index = result.clip.skeleton.index
    joints = [index[f"mixamorig:{name}"] for name in ("Hips", "LeftFoot", "RightFoot", "LeftLeg")]
    positions = kinematics.forward(result.clip, joints)[1]
    assert np.abs(positions - positions[0]).max() < 0.01
    assert not any("foot" in line for seam in result.seams for line in seam.warnings)


def test_no_public_function_edits_its_input(words: dict[str, Clip]) -> None:
    """Every array of a clip is read-only, and the clips come out of all verbs as they went in."""
    clip = ss.Clip(
        words["SIGN"].skeleton,
        np.array(words["SIGN"].local_rotations),
        np.array(words["SIGN"].root_positions),
        30.0,
        "w",
    )
    before = (clip.local_rotations.copy(), clip.root_positions.copy(), clip.skeleton.offsets.copy())
    splice([clip, words["I"], clip], SpliceOptions(fps=25.0))
    for transition in TRANSITIONS:
        inbetween(clip, [(20, 30)], transition)
    for cutter in CUTTERS.values():
        cutter.cut(clip, clip)
    kinematics.forward(clip)
    after = (clip.local_rotations, clip.root_positions, clip.skeleton.offsets)
    assert all(np.array_equal(a, b) for a, b in zip(before, after, strict=True))
    assert not any(array.flags.writeable for array in after)


@pytest.mark.parametrize(("fps", "expected"), [(24.0, 8), (30.0, 8), (60.0, 15), (120.0, 29)])
def test_transitions_see_as_much_time_at_any_rate(sentence: list[Clip], fps: float, expected: int) -> None:
    class Watching(GapTransition):
        name = "watching"

        def between(self, gap: Gap) -> Clip:
            seen.append((len(gap.before), len(gap.after)))
            return find_transition("hermite").between(gap)

    seen: list[tuple[int, int]] = []
    splice(sentence, replace(CLASSICAL, transition=Watching(), fps=fps))
    whole = resample(sentence[0], fps)
    inbetween(whole, [(len(whole) // 2, len(whole) // 2 + 4)], Watching())
    assert set(seen) == {(expected, expected)}


def test_a_cutter_of_sentences_is_asked_once_and_checked(sentence: list[Clip]) -> None:
    class Whole(Cutter):
        name = "whole"

        def __init__(self, n_cuts: int) -> None:
            self.n_cuts = n_cuts

        def cut_all(self, clips: Sequence[Clip]) -> list[Cut]:
            return [Cut(len(clip) // 2 + 5, 7) for clip in clips[: self.n_cuts]]

    n_seams = len(sentence) - 1
    result = splice(sentence, SpliceOptions(cutter=Whole(n_seams)))
    assert [seam.post_frame for seam in result.seams] == [7] * n_seams
    streamed = list(stream(sentence, SpliceOptions(cutter=Whole(1))))
    assert [piece.seam.post_frame for piece in streamed if piece.seam] == [7] * n_seams
    assert len(splice(sentence[:1], SpliceOptions(cutter=Whole(0))).clip) == len(sentence[0])
    for wrong in (n_seams - 1, n_seams + 1):
        with pytest.raises(InputError, match=f"cutter whole chose {wrong} cuts for {len(sentence)} clips"):
            splice(sentence, SpliceOptions(cutter=Whole(wrong)))
