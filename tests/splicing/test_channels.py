"""splicing.person and splicing.carriage: a word keeps what is its own, and a person moves between the signs."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from conftest import random_clip

import signsplice as ss
from other_rigs import mirror
from reference_poses import arms_out, with_pose
from signing import sign, word
from signsplice.body.arm_ik import move_wrists
from signsplice.body.retarget import align
from signsplice.errors import InputError
from signsplice.motion import Clip, concatenate, kinematics, rotation
from signsplice.rig.align import reference
from signsplice.rig.info import arms, canonical_motion, rig_info
from signsplice.rig.roles import CHANNELS
from signsplice.signer import planner
from signsplice.signer.signer import RESTS, STANDARD
from signsplice.splicing.carriage import POSTURE, measure_freedom
from signsplice.splicing.collisions import TOLERANCE_M
from signsplice.splicing.faces import RULES
from signsplice.splicing.person import NATURAL, channel_joints, find_channel_joints, owned_channels
from signsplice.splicing.report import describe
from signsplice.splicing.word import Word
from signsplice_workshop.measure.collisions import hand_penetration
from signsplice_workshop.measure.person import measure_person

LINES = ("HORSE TEACH I", "BOOK I HELP YOU", "CRY COLOR HOUSE TOMORROW", "RAIN SEE HAT LANGUAGE")
LEFT, RIGHT = 0, 1


def clips(line: str) -> list[Clip]:
    return [word(gloss).clip for gloss in line.split()]


@cache
def spliced(line: str, tempo: str = "citation") -> ss.SpliceResult:
    return ss.splice(clips(line), ss.SpliceOptions(tempo=tempo))


def heads(clip: Clip) -> np.ndarray:
    """Rotations (T, 4) of the head on the chest."""
    quats = canonical_motion(clip).quats
    return rotation.multiply(quats[:, 3], quats[:, 4])


def shown_head(line: str, person: float = 1.0, seed: int = 0) -> np.ndarray:
    return heads(ss.splice(clips(line), ss.SpliceOptions(person=person, seed=seed)).clip)


def test_a_word_owns_the_channels_that_it_moves() -> None:
    assert {"left arm", "right arm"} <= owned_channels(word("TEACH").clip)
    assert "left arm" not in owned_channels(word("I").clip)
    assert "head" in owned_channels(word("NO").clip), "it shakes"
    flipped = owned_channels(mirror(word("I").clip))
    assert ("right arm" in flipped, "left arm" in flipped) == (False, True)
    still = concatenate([word("I").clip[:1]] * 20)
    assert owned_channels(still) == frozenset()
    held = concatenate([word("BOOK").clip[word("BOOK").events.start :][:1]] * 20)
    assert {"left arm", "right arm"} <= owned_channels(held), "held away from rest"


@pytest.mark.parametrize("rest", RESTS)
def test_an_arm_rests_in_the_way_of_its_signer(rest: str) -> None:
    signer = replace(STANDARD, rest=rest)
    teach, i = (planner.synthesize_word(sign(gloss), signer).clip for gloss in ("TEACH", "I"))
    assert "left arm" in owned_channels(teach)
    assert "left arm" not in owned_channels(i)


def test_an_arm_that_the_other_hand_comes_near_is_owned() -> None:
    clip = word("I").clip
    joints = rig_info(clip.skeleton).arm_joints
    wrists = kinematics.forward(clip, [joints[2], joints[5], joints[1]])[1]  # (T, 3, 3)
    moves = np.zeros((len(clip), 2, 3))
    moves[30:45, RIGHT] = (0.5 * (wrists[:, 0] + wrists[:, 2]) - wrists[:, 1])[30:45]
    assert "left arm" in owned_channels(move_wrists(clip, moves))


@pytest.mark.parametrize("tempo", ["citation", "natural"])
@pytest.mark.parametrize("line", LINES)
def test_owned_channels_keep_the_rotations_of_their_word(line: str, tempo: str) -> None:
    result, words = spliced(line, tempo), clips(line)
    plain = ss.splice(words, ss.SpliceOptions(tempo=tempo, person=0.0, free_hand="transition"))
    names, n_planned = result.clip.skeleton.index, 0
    signs = [[span for span in made.spans if span.clip is not None] for made in (result, plain)]
    for span, recorded in zip(*signs, strict=True):
        assert (span.clip, span.source, span.warp and [frame for _, frame in span.warp]) == (
            recorded.clip, recorded.source, recorded.warp and [frame for _, frame in recorded.warp],
        )  # fmt: skip
        same = result.clip.local_rotations[slice(*span.output)] == plain.clip.local_rotations[slice(*recorded.output)]
        assert span.clip is not None
        owned = [joint for channel in owned_channels(words[span.clip]) for joint in channel_joints(words[0], channel)]
        assert same[:, owned].all()
        if span.remade is not None:
            n_planned += 1
            assert span.remade.frames == span.output
            same[:, [names[name] for name in span.remade.joints]] = True
        assert same.all(), "frames of joints that are not said to be remade"
    assert n_planned >= 2


@pytest.mark.parametrize("tempo", ["citation", "natural"])
@pytest.mark.parametrize("line", LINES)
def test_a_stream_gives_what_a_splice_gives(line: str, tempo: str) -> None:
    options = ss.SpliceOptions(tempo=tempo, face_rules=RULES)
    result, pieces = ss.splice(clips(line), options), list(ss.stream(clips(line), options))
    assert [piece.span for piece in pieces] == list(result.spans)
    streamed = ss.concatenate([piece.clip for piece in pieces])
    np.testing.assert_array_equal(streamed.local_rotations, result.clip.local_rotations)
    assert streamed.face is not None
    assert result.clip.face is not None
    np.testing.assert_array_equal(streamed.face.weights, result.clip.face.weights)


def test_an_idle_hand_does_not_fall_between_two_signs_that_need_it() -> None:
    line = "TEACH I SEE YOU BOOK"
    clip, plain = spliced(line).clip, ss.splice(clips(line), ss.SpliceOptions(free_hand="transition")).clip
    assert measure_person(clip).drops == 0
    assert measure_person(plain).drops >= 1


def test_an_idle_hand_goes_low_before_the_body_and_stays_there() -> None:
    result = spliced("TEACH I SEE YOU I YOU")
    motion = arms(result.clip)
    (you,) = (span for span in result.spans if span.kind == "sign" and span.clip == 3)
    below = 1.0 - motion.lift[slice(*you.output), LEFT]
    assert 0.38 <= below.min() <= below.max() <= 0.65, "where idle hands of people are, arm lengths below the shoulders"
    speeds = np.linalg.norm(np.diff(motion.wrists[:, LEFT], axis=0), axis=-1) * result.clip.fps * motion.metres
    assert speeds[slice(*you.output)].max() < 0.3


def test_an_idle_hand_sinks_to_rest_in_a_pause_and_in_a_long_run_without_it() -> None:
    for words in (
        [Word(clip, pause="." if k == 1 else None) for k, clip in enumerate(clips("TEACH I SEE YOU"))],
        clips("TEACH" + " I SEE YOU" * 3),
    ):
        result = ss.splice(words)
        last = [span for span in result.spans if span.kind == "sign"][-1]
        assert arms(result.clip).lift[last.output[0], LEFT] < 0.1


def test_an_idle_hand_is_up_before_the_sign_that_needs_it() -> None:
    result, i, teach = spliced("I TEACH"), *clips("I TEACH")
    sign_i, _, sign_teach, *_ = result.spans
    lift = arms(result.clip).lift[:, LEFT]
    assert lift[sign_i.output[1] - 1] > lift[0] + 0.02, "it leaves rest while I is still signed"
    joints = channel_joints(i, "left arm")
    assert sign_teach.source is not None
    first = align(teach, reference(i, result.clip.fps)).clip.local_rotations[sign_teach.source[0], joints]
    np.testing.assert_array_equal(result.clip.local_rotations[sign_teach.output[0], joints], first)


@pytest.mark.parametrize("line", LINES)
def test_no_seam_waits_for_an_idle_hand(line: str) -> None:
    planned = spliced(line).seams
    recorded = ss.splice(clips(line), ss.SpliceOptions(free_hand="transition")).seams
    assert all(a.n_transition <= b.n_transition for a, b in zip(planned, recorded, strict=True))


def test_the_left_hand_is_as_free_as_the_right() -> None:
    options = ss.SpliceOptions("ends", "hermite", person=0.0)
    plain = ss.splice(clips("BOOK I YOU"), options)
    flipped = ss.splice([mirror(clip) for clip in clips("BOOK I YOU")], options)
    assert [span.output for span in flipped.spans] == [span.output for span in plain.spans]
    np.testing.assert_allclose(arms(flipped.clip).lift[:, ::-1], arms(plain.clip).lift, atol=0.02)


@pytest.mark.parametrize("line", LINES)
def test_no_planned_hand_goes_through_the_body(line: str) -> None:
    result = spliced(line)
    metres = rig_info(result.clip.skeleton).sizes.unit.metres
    plain = ss.splice(clips(line), ss.SpliceOptions(person=0.0, free_hand="transition"))
    depth, *allowed = (
        metres * hand_penetration(made.skeleton, *kinematics.forward(made))[0].max()
        for made in (result.clip, plain.clip, *clips(line))
    )
    assert depth <= max(TOLERANCE_M, *allowed) + 0.002


@pytest.mark.parametrize("rest", RESTS)
def test_planned_arms_end_at_rest(rest: str) -> None:
    signer = replace(STANDARD, rest=rest)
    words = [planner.synthesize_word(sign(gloss), signer).clip for gloss in ("TEACH", "I", "YOU")]
    result = ss.splice(words, ss.SpliceOptions(person=0.0))
    joints = channel_joints(result.clip, "left arm")
    last = align(words[-1], reference(words[0], result.clip.fps)).clip
    angles = rotation.angle_between(result.clip.local_rotations[-1, joints], last.local_rotations[-1, joints])
    assert angles.max() < 1e-6


def test_a_dial_sets_how_much_head_and_trunk_move_and_a_seed_repeats_it() -> None:
    line = "TEACH I SEE YOU BOOK"
    recorded, half, whole = (shown_head(line, person=amount) for amount in (0.0, 0.5, 1.0))
    moved = [np.rad2deg(rotation.angle_between(recorded, shown)).max() for shown in (half, whole)]
    assert 3.0 < moved[0] < moved[1] < 25.0
    np.testing.assert_array_equal(whole, shown_head(line, seed=0))
    assert np.rad2deg(rotation.angle_between(whole, shown_head(line, seed=1))).max() > 3.0
    with pytest.raises(InputError, match="person 2, expected 0 to 1"):
        ss.SpliceOptions(person=2.0)


def test_head_and_trunk_do_not_turn_while_a_hand_is_at_the_head() -> None:
    line = "TEACH EAT BOOK"
    result, recorded = spliced(line), ss.splice(clips(line), ss.SpliceOptions(person=0.0))
    (eat,) = (span for span in result.spans if span.kind == "sign" and span.clip == 1)
    assert eat.source is not None
    at_mouth = measure_freedom(clips(line)[1])[slice(*eat.source), 0] == 0.0
    assert at_mouth.any()
    turned = np.rad2deg(rotation.angle_between(heads(result.clip), heads(recorded.clip)))
    assert turned[slice(*eat.output)][at_mouth].max() < 0.01
    assert turned.max() > 3.0


@pytest.mark.parametrize("fps", [24.0, 60.0])
def test_a_head_turns_no_faster_than_a_person_at_any_rate(fps: float) -> None:
    line = "TEACH I SEE YOU BOOK HELP HOUSE"
    turned, recorded = (
        heads(ss.splice(clips(line), ss.SpliceOptions(fps=fps, person=amount)).clip) for amount in (1.0, 0.0)
    )
    added = rotation.multiply(rotation.inverse(recorded), turned)
    assert np.rad2deg(rotation.angle_between(added[1:], added[:-1])).max() * fps < 60.0


def test_eyes_stay_on_the_addressee_while_the_head_turns() -> None:
    result = ss.splice(clips("TEACH I BOOK"), ss.SpliceOptions(face_rules=RULES, seed=3))
    face = result.clip.face
    assert face is not None
    left = face.of(["eyeLookOutLeft"])[:, 0] - face.of(["eyeLookInLeft"])[:, 0]  # fractions of the eyes' largest turn
    recorded = ss.splice(clips("TEACH I BOOK"), ss.SpliceOptions(person=0.0))
    front = np.array([0.0, 0.0, 1.0])
    turns = [rotation.rotate(global_heads(made.clip), front) for made in (result, recorded)]
    yaw = np.rad2deg(np.arctan2(turns[0][:, 0], turns[0][:, 2]) - np.arctan2(turns[1][:, 0], turns[1][:, 2]))
    watched = np.abs(yaw + left * POSTURE.eyes_deg) < 2.0
    assert np.abs(yaw).max() > 3.0
    assert watched.mean() > 0.6, "else they look at the hands"


def global_heads(clip: Clip) -> np.ndarray:
    """Rotations (T, 4) of the head in the world from its T-pose."""
    info = rig_info(clip.skeleton)
    joint = info.roles.joints["head"]
    rotations, _ = kinematics.forward(clip, [joint])
    return rotation.multiply(rotation.from_matrix(rotations[:, 0]), rotation.inverse(info.t_pose.rotations[joint]))


def test_the_report_names_the_planned_channels() -> None:
    result = spliced("TEACH I BOOK")
    assert result.person is not None
    assert "left arm" in result.person.planned[1]
    assert not {"left arm", "right arm"} & {*result.person.planned.get(0, ())}
    described = describe(result)["person"]
    assert [row["clip"] for row in described["planned"]] == [*result.person.planned]


def test_a_head_that_a_word_owns_is_not_turned_however_fast_the_words() -> None:
    with ss.open_lexicon() as lexicon:
        given = [Word(lexicon.clip(gloss), owns=lexicon.owns(gloss)) for gloss in ("HELLO", "BOOK", "fs-I", "YES")]
    moved, plain = (
        ss.splice(given, ss.SpliceOptions(person=amount, transition_time=0.0, sign_speed=3.0)).clip
        for amount in (1.0, 0.0)
    )
    n_last = len(ss.splice(given[-1:], ss.SpliceOptions(sign_speed=3.0)).clip)
    head = channel_joints(moved, "head")
    changes = np.abs(moved.local_rotations - plain.local_rotations)[:, head].max(axis=(1, 2))
    assert changes.max() > 0.01
    assert changes[-n_last // 2 :].max() == 0.0


def test_a_neck_that_carries_the_arms_is_not_turned() -> None:
    clip = word("BOOK").clip
    skeleton = clip.skeleton
    names, parents = skeleton.index, skeleton.parents.copy()
    for side in ("Left", "Right"):
        parents[names[f"mixamorig:{side}Shoulder"]] = names["mixamorig:Neck"]
    joints = find_channel_joints(replace(skeleton, parents=parents))
    assert names["mixamorig:Neck"] not in joints["head"]
    assert joints["head"] == [names["mixamorig:Head"]]


@pytest.mark.parametrize("fps", [30.0, 24.0])
def test_a_t_pose_at_the_end_of_a_clip_is_no_motion_of_its_word(fps: float) -> None:
    teach, i, book = clips("TEACH I BOOK")
    with_stray = with_pose(i, arms_out(i.skeleton), 3, 4, at_end=True)
    plain, stray = (
        ss.splice(given, ss.SpliceOptions(fps=fps)) for given in ([teach, i, book], [teach, with_stray, book])
    )
    assert plain.person is not None
    assert stray.person is not None
    assert stray.person.planned == plain.person.planned
    np.testing.assert_allclose(stray.clip.local_rotations, plain.clip.local_rotations, atol=2e-3)


def test_letters_move_their_free_fingers_after_a_sign_of_two_hands() -> None:
    line = "fs-K fs-I fs-M fs-L"
    with ss.open_lexicon() as lexicon:
        after_one, after_two = (
            ss.splice([lexicon.clip(gloss) for gloss in (first, *line.split())], ss.SpliceOptions(person=0.0)).spans
            for first in ("I", "BOOK")
        )
    fingers = [
        [{*(span.remade.joints if span.remade else ())} & {"mixamorig:RightHandRing1"} for span in spans if span.clip]
        for spans in (after_one, after_two)
    ]
    assert fingers[0] == fingers[1]
    assert any(fingers[0])


def test_a_lexicon_may_say_what_a_word_owns() -> None:
    teach, i, book = clips("TEACH I BOOK")
    everything = ss.splice([Word(clip, owns=frozenset(CHANNELS)) for clip in (teach, i, book)])
    assert all(span.remade is None for span in everything.spans)
    nothing = ss.splice([teach, Word(i, owns=frozenset()), book])
    assert nothing.person is not None
    assert {*nothing.person.planned[1]} == {*CHANNELS}
    with pytest.raises(InputError, match="word owns 'tail', expected some of left arm, right arm, trunk, head"):
        Word(i, owns=frozenset({"tail"}))
    unnamed = random_clip(0)
    assert len(ss.splice([Word(unnamed, owns=frozenset())] * 2, ss.SpliceOptions("ends")).clip) > len(unnamed)


def test_an_unknown_choice_is_refused_and_a_rig_without_arms_is_left_alone() -> None:
    with pytest.raises(InputError, match="free hand 'slow', expected one of transition, natural"):
        ss.SpliceOptions(free_hand="slow")
    clip = random_clip(0)
    plain, planned = (
        ss.splice([clip, clip], ss.SpliceOptions("ends", free_hand=mode, person=amount)).clip
        for mode, amount in (("transition", 0.0), (NATURAL, 1.0))
    )
    np.testing.assert_array_equal(plain.local_rotations, planned.local_rotations)
