"""splicing.engine: sign frames are kept bit for bit (eq. 17), pieces never change, and spans rebuild the output."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from conftest import random_clip, rooted

import signsplice as ss
from other_rigs import without
from reference_poses import arms_out, with_pose
from signsplice.body.retarget import align
from signsplice.errors import InputError
from signsplice.formats import bvh
from signsplice.motion import Channels, Clip, FloatArray, kinematics, resample, rotation
from signsplice.rig.align import reference
from signsplice.rig.info import active_span, arms
from signsplice.splicing.contracts import Cut, Cutter
from signsplice.splicing.curves import TRANSITIONS
from signsplice.splicing.cutters import CUTTERS
from signsplice.splicing.engine import SpliceOptions, SpliceResult, Stream, inbetween, splice, stream
from signsplice.splicing.person import channel_joints, owned_channels
from signsplice.splicing.result import Span

CLASSICAL = SpliceOptions("pose-velocity", "hermite", "tempo")


class FixedCutter(Cutter):
    """Cuts every pair at the same frames."""

    name, summary = "fixed", "the same frames"

    def __init__(self, pre: int, post: int) -> None:
        self.at = Cut(pre, post)

    def cut(self, before: Clip, after: Clip) -> Cut:
        return self.at


def remade_joints(span: Span, clip: Clip) -> list[int]:
    """The joints that a span of a clip names as remade, none of which belongs to the word."""
    if span.remade is None:
        return []
    joints = [clip.skeleton.index[name] for name in span.remade.joints]
    assert not {*joints} & {joint for channel in owned_channels(clip) for joint in channel_joints(clip, channel)}
    return joints


def rebuilt(result: SpliceResult, clips: list[Clip]) -> FloatArray:
    """Rotations (T, J, 4) by the spans: of transitions and remade joints from the output, of others from their aligned
    clips.
    """
    first = reference(clips[0], result.clip.fps)
    out = np.full_like(result.clip.local_rotations, np.nan)
    for span in result.spans:
        a, b = span.output
        if span.kind != "transition":
            assert span.clip is not None
            assert span.source is not None
            source = align(clips[span.clip], first).clip
            out[a:b] = source.local_rotations[slice(*span.source)]
            if span.remade is not None:
                remade = slice(*span.remade.frames), remade_joints(span, clips[span.clip])
                out[remade] = result.clip.local_rotations[remade]
        else:
            out[a:b] = result.clip.local_rotations[a:b]
    return out


@pytest.mark.parametrize("cutter", list(CUTTERS))
@pytest.mark.parametrize("transition", ["hold", "hermite", "quintic"])
def test_spans_rebuild_the_output_bit_for_bit(cutter: str, transition: str, sentence: list[Clip]) -> None:
    result = splice(sentence, SpliceOptions(cutter=cutter, transition=transition))
    assert np.array_equal(rebuilt(result, sentence), result.clip.local_rotations)
    retraction = ["retraction"] if cutter != "ends" else []
    assert [span.kind for span in result.spans] == ["sign", "transition"] * (len(sentence) - 1) + ["sign", *retraction]
    stops = [span.output[1] for span in result.spans]
    assert [span.output[0] for span in result.spans] == [0, *stops[:-1]]
    assert stops[-1] == len(result.clip)
    assert len(result.seams) == len(sentence) - 1


def test_sign_frames_of_the_same_rig_are_copied_bit_for_bit(sentence: list[Clip]) -> None:
    result = splice(sentence)
    for span in result.spans:
        if span.clip is not None and span.source is not None:
            clip = sentence[span.clip]
            same = result.clip.local_rotations[slice(*span.output)] == clip.local_rotations[slice(*span.source)]
            same[:, [0, *remade_joints(span, clip)]] = True
            assert same.all()


def test_the_last_word_is_all_there_and_its_retraction_begins_where_it_would_be_left(sentence: list[Clip]) -> None:
    clip = sentence[1]
    result, twice = splice([clip]), splice([clip, clip])
    sign, retraction = result.spans
    assert (sign.kind, retraction.kind) == ("sign", "retraction")
    assert (retraction.clip, retraction.name, retraction.pause) == (0, clip.name, None)
    assert sign.source == twice.spans[0].source
    assert retraction.source == retraction.output == (sign.output[1], len(clip))
    assert np.array_equal(result.clip.local_rotations, clip.local_rotations)
    assert result.tempo == splice([clip], SpliceOptions("ends")).tempo
    loaded = bvh.parse(bvh.encode(clip), clip.name)
    assert bvh.encode(splice([loaded]).clip) == bvh.encode(loaded), "the numbers of a file go on in the retraction"


def test_a_word_that_its_cutter_refuses_is_a_sign_to_its_end(sentence: list[Clip]) -> None:
    options = replace(CLASSICAL, cutter=FixedCutter(len(sentence[0]), 0))
    assert [span.kind for span in splice(sentence[:1], options).spans] == ["sign"]


def test_a_sentence_is_shorter_and_its_arms_stay_up(sentence: list[Clip]) -> None:
    result = splice(sentence)
    assert len(result.clip) < 0.75 * sum(map(len, sentence))
    lift = arms(result.clip).lift.max(axis=1)
    start, stop = active_span(arms(result.clip))
    assert lift[start:stop].min() > 0.25
    assert lift[0] < 0.1
    assert lift[-1] < 0.1


@pytest.mark.parametrize("options", [CLASSICAL, SpliceOptions()], ids=["classical", "learned"])
def test_pieces_never_change_once_they_are_out(options: SpliceOptions, sentence: list[Clip]) -> None:
    """A longer sentence begins with the pieces of a shorter one, except its last word, which goes on to its end."""
    whole = list(stream(sentence, options))
    for n in range(1, len(sentence)):
        part = list(stream(sentence[:n], options))
        for a, b in zip(part[: 2 * n - 2], whole, strict=False):
            assert np.array_equal(a.clip.local_rotations, b.clip.local_rotations)
            assert np.array_equal(a.clip.root_positions, b.clip.root_positions)
            assert a.span == b.span
    joined = np.concatenate([piece.clip.local_rotations for piece in whole])
    at_once = splice(sentence, options).clip.local_rotations
    assert np.array_equal(joined, at_once)


def test_pieces_come_as_soon_as_the_next_word_is_known(sentence: list[Clip]) -> None:
    read: list[Clip] = []

    def words_one_by_one() -> Iterator[Clip]:
        for clip in sentence:
            read.append(clip)
            yield clip

    pieces = stream(words_one_by_one())
    for expected in (2, 2, 3):
        next(pieces)
        assert len(read) == expected


def test_pushed_words_give_the_same_pieces_as_pulled_ones(sentence: list[Clip]) -> None:
    pulled = list(stream(sentence, CLASSICAL))
    growing = Stream(CLASSICAL)
    pushed = [growing.push(clip) for clip in sentence]
    assert [len(pieces) for pieces in pushed] == [0, *[2] * (len(sentence) - 1)]
    rest = growing.end()
    assert growing.end() == []
    for a, b in zip([*(piece for pieces in pushed for piece in pieces), *rest], pulled, strict=True):
        assert np.array_equal(a.clip.local_rotations, b.clip.local_rotations)
        assert (a.span, a.warnings, a.seam is None) == (b.span, b.warnings, b.seam is None)


def test_a_word_that_raises_is_not_part_of_the_sentence(sentence: list[Clip]) -> None:
    growing = Stream(CLASSICAL)
    growing.push(sentence[0])
    with pytest.raises(ss.SignspliceError):
        growing.push(random_clip(0))
    pieces = [*growing.push(sentence[1]), *growing.end()]
    for a, b in zip(pieces, stream(sentence[:2], CLASSICAL), strict=True):
        assert np.array_equal(a.clip.local_rotations, b.clip.local_rotations)
        assert a.span == b.span


def test_a_given_transition_time_replaces_the_duration(sentence: list[Clip]) -> None:
    for seconds, n_frames in ((0.5, 15), (0.1, 3), (0.0, 0)):
        result = splice(sentence[:3], SpliceOptions(transition_time=seconds))
        assert [seam.n_transition for seam in result.seams] == [n_frames] * 2
        assert result.seams[0].seconds == pytest.approx(n_frames / 30)
    durations = [seam.seconds for seam in splice(sentence).seams]
    assert min(durations) >= 0.25 - 0.5 / 30
    assert max(durations) < 0.8


def test_sign_speed_and_frame_rate_can_be_chosen(sentence: list[Clip]) -> None:
    slow, fast = (splice(sentence[:2], replace(CLASSICAL, sign_speed=x, transition_time=0.3)) for x in (0.5, 2.0))
    assert len(slow.clip) > 3 * len(fast.clip)
    doubled = splice(sentence[:2], replace(CLASSICAL, fps=60.0))
    assert doubled.clip.fps == 60.0
    assert doubled.clip.seconds == pytest.approx(splice(sentence[:2], CLASSICAL).clip.seconds, abs=0.15)


def test_clips_of_mixed_rates_come_out_at_the_first_rate(words: dict[str, Clip]) -> None:
    other = resample(words["SIGN"], 24.0)
    mixed, plain = splice([words["I"], other]), splice([words["I"], words["SIGN"]])
    assert mixed.clip.fps == 30.0
    assert mixed.clip.seconds == pytest.approx(plain.clip.seconds, abs=0.1)


def test_euler_orders_and_joint_names_do_not_change_the_motion(words: dict[str, Clip]) -> None:
    """The second clip comes from a file with other channel orders and prefixes. The splice is the same, and is written
    in the channel orders of the first.
    """
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
    expected = splice(plain)
    assert [seam.pre_frame for seam in mixed.seams] == [seam.pre_frame for seam in expected.seams]
    assert np.all(rotation.angle_between(mixed.clip.local_rotations, expected.clip.local_rotations) < 1e-6)
    written = bvh.parse(bvh.encode(mixed.clip))
    assert written.channels is not None
    assert plain[0].channels is not None
    assert written.channels.names == plain[0].channels.names
    assert np.all(rotation.angle_between(written.local_rotations, expected.clip.local_rotations) < 1e-6)


def test_a_sentence_of_one_clip_is_that_clip(words: dict[str, Clip]) -> None:
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
def test_options_out_of_range_are_refused(options: dict[str, float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        SpliceOptions(**options)  # type: ignore[arg-type]


def test_clips_without_known_arms_can_be_spliced_at_their_ends() -> None:
    clip = random_clip(0)
    result = splice([clip, clip], SpliceOptions(cutter="ends"))
    assert len(result.clip) == 2 * len(clip) + 8
    assert any("no arms known" in line for line in result.seams[0].warnings)


def test_hips_and_feet_neither_jump_nor_slide(words: dict[str, Clip]) -> None:
    """Clips of one signer, each recorded at another position and facing."""
    rng = np.random.default_rng(4)
    clips = []
    for gloss in ("HELLO", "SIGN", "DEAF"):
        yaw, word = rotation.exp([0.0, rng.uniform(-3.0, 3.0), 0.0]), rooted(words[gloss])
        local = np.array(word.local_rotations)
        local[:, 0] = rotation.multiply(yaw, local[:, 0])
        roots = rotation.rotate(yaw, word.root_positions) + rng.normal(size=3) * 80.0
        clips.append(replace(word, local_rotations=local, root_positions=roots))
    result = splice(clips)
    index = result.clip.skeleton.index
    joints = [index[f"mixamorig:{name}"] for name in ("Hips", "LeftFoot", "RightFoot", "LeftLeg")]
    positions = kinematics.forward(result.clip, joints)[1]
    assert np.abs(positions - positions[0]).max() < 0.3, "cm: facing is read from shoulders, too, and the trunk turns"
    assert not any("foot" in line for seam in result.seams for line in seam.warnings)


def test_no_public_function_edits_its_input(words: dict[str, Clip]) -> None:
    """Every array of a clip is read-only, and no function changes one."""
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


def streamed(clips: Any) -> list[Any]:
    return list(stream(clips))


@pytest.mark.parametrize(
    ("function", "given", "message"),
    [
        (splice, lambda a, b: (a, b), r"expected a list of them: splice\(\[a, b\]\)"),
        (splice, lambda a, b: (a,), "clips is one Clip, expected a list of them"),
        (splice, lambda a, b: ("a.bvh", "b.bvh"), r"clips is the text 'a.bvh', .* load\(path\)"),
        (splice, lambda a, b: ("HELLO I",), r"clips is the text 'HELLO I', .* open_lexicon\(path\)\.clip\(gloss\)"),
        (splice, lambda a, b: ([a, "HELLO"],), "clip 1 is 'HELLO', expected a Clip"),
        (streamed, lambda a, b: ([a, None],), "clip 1 is a NoneType, expected a Clip"),
        (streamed, lambda a, b: (a,), "clips is one Clip"),
        (splice, lambda a, b: ([a, b], "learned"), "options is a str, expected SpliceOptions"),
        (Stream, lambda a, b: (a,), "options is a Clip"),
    ],
)
def test_what_is_no_clip_is_said(
    function: Callable[..., object], given: Callable[..., tuple[Any, ...]], message: str, sentence: list[Clip]
) -> None:
    with pytest.raises(TypeError, match=message):
        function(*given(*sentence[:2]))


@pytest.mark.parametrize("options", [CLASSICAL, SpliceOptions()], ids=["classical", "learned"])
@pytest.mark.parametrize("fps", [None, 25.0])
def test_reference_poses_at_the_ends_of_words_are_left_out(
    options: SpliceOptions, fps: float | None, sentence: list[Clip]
) -> None:
    """The first word begins in a T-pose, the second is between two, with a blend of three frames each."""
    options = replace(options, fps=fps)
    pose = arms_out(sentence[0].skeleton)
    first, second, *others = sentence
    posed = [
        with_pose(first, pose, 6),
        with_pose(with_pose(second, pose, 3, 3), pose, 2, 3, at_end=True),
        *others,
    ]
    clean, result = splice([first, second, *others], options), splice(posed, options)
    # Six frames before a word are five at 25 a second.
    shift = 6 if fps is None else 5
    # Facing is a mean over frames, others where a pose is left out, of a trunk that turns.
    np.testing.assert_allclose(result.clip.local_rotations, clean.clip.local_rotations, atol=4e-3)
    assert [span.source for span in result.spans if span.clip in (0, 1)] == [
        (span.source[0] + shift, span.source[1] + shift) for span in clean.spans if span.clip in (0, 1) and span.source
    ]
    assert [(seam.pre_frame, seam.post_frame) for seam in result.seams[:1]] == [
        (seam.pre_frame + shift, seam.post_frame + shift) for seam in clean.seams[:1]
    ]
    n = len(second)
    assert [line for line in result.warnings if "left out" in line] == [
        f"{first.name}: frames 0 to 5: a T-pose that does not belong to the motion; left out of splices",
        f"{second.name}: frames 0 to 5: a T-pose that does not belong to the motion; left out of splices",
        f"{second.name}: frames {n + 6} to {n + 10}: a T-pose that does not belong to the motion; left out of splices",
    ]
    pieces = list(stream(posed, options))
    assert [line for piece in pieces for line in piece.warnings] == list(result.warnings)


def test_joints_without_a_counterpart_do_not_hold_a_t_pose(sentence: list[Clip]) -> None:
    first, second = sentence[:2]
    fingers = tuple(f"{side}Hand{finger}" for side in ("Left", "Right") for finger in ("Index", "Middle", "Ring"))
    posed = with_pose(first, arms_out(first.skeleton), 4)
    plain, made = (splice([clip, without(second, *fingers)], CLASSICAL).clip for clip in (first, posed))
    np.testing.assert_allclose(made.local_rotations, plain.local_rotations, atol=4e-3)


def test_a_longer_transition_is_no_remedy_for_a_jump_within_a_sign(sentence: list[Clip]) -> None:
    first, second = sentence[:2]
    options = replace(CLASSICAL, cutter=FixedCutter(40, 12), transition_time=0.04)
    local = np.array(second.local_rotations)
    local[12] = arms_out(second.skeleton)
    jumping = replace(second, local_rotations=local, channels=None)
    (seam,) = splice([first, jumping], options).seams
    (line,) = [line for line in seam.warnings if "faster than signs do" in line]
    assert "longer" not in line
    assert "a hand jumps in the signs beside it" in line
    (seam,) = splice([first, second], options).seams
    assert "a longer transition time would help" in seam.warnings[0]


# --- the rate of a sentence ---


def at_rate(clip: Clip, fps: float) -> Clip:
    return replace(resample(clip, fps), name=f"{clip.name}-{fps:g}")


def test_a_first_clip_of_few_frames_a_second_takes_the_highest_rate_of_all(sentence: list[Clip]) -> None:
    slow, word = at_rate(sentence[0], 1.0), sentence[1]
    result = splice([slow, word, at_rate(word, 12.0)], CLASSICAL)
    assert result.clip.fps == word.fps == 30.0
    line = f"{slow.name}: 1 fps are too few for signing; the sentence has 30, the highest of its clips"
    assert result.warnings[0] == line
    span = result.spans[2]
    assert span.source is not None
    own = (*channel_joints(word, "left arm"), *channel_joints(word, "right arm"))
    own = tuple(joint for joint in own if joint not in remade_joints(span, word))
    assert own
    shown = result.clip.local_rotations[slice(*span.output), own]
    assert np.array_equal(shown, word.local_rotations[slice(*span.source), own]), "the second word keeps its frames"


@pytest.mark.parametrize(("fps", "expected"), [(20.0, 20.0), (24.0, 24.0), (19.0, 30.0)])
def test_the_first_clip_sets_the_rate_from_20_on(fps: float, expected: float, sentence: list[Clip]) -> None:
    result = splice([at_rate(sentence[0], fps), sentence[1]], CLASSICAL)
    assert result.clip.fps == expected
    assert any("too few for signing" in line for line in result.warnings) is (expected != fps)


def test_clips_of_one_low_rate_and_the_rate_of_the_user_stay(sentence: list[Clip]) -> None:
    slow = [at_rate(clip, 10.0) for clip in sentence[:2]]
    for clips, options in ((slow, CLASSICAL), ([slow[0], sentence[1]], replace(CLASSICAL, fps=10.0))):
        result = splice(clips, options)
        assert result.clip.fps == 10.0
        assert not any("fps" in line for line in result.warnings)


def test_a_stream_that_begins_with_a_low_rate_has_that_of_the_networks(sentence: list[Clip]) -> None:
    pieces = list(stream([at_rate(sentence[0], 5.0), at_rate(sentence[1], 60.0)], CLASSICAL))
    assert {piece.clip.fps for piece in pieces} == {30.0}
    assert "5 fps are too few for signing; the sentence has 30, a stream's" in pieces[0].warnings[0]
    (usual, *_) = stream([at_rate(sentence[0], 25.0), sentence[1]], CLASSICAL)
    assert usual.clip.fps == 25.0
