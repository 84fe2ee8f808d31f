"""Faces and gestures of written signs: what codes show, when, and what is left out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from signsplice.motion.face import Face
from signsplice.motion.kinematics import forward
from signsplice.signer import notation, planner, pose
from signsplice.signer.phonology import Gesture
from signsplice.signer.signer import JOINTS
from signsplice.signer.tables import sections
from signsplice.written import nonmanual
from signsplice.written.nonmanual import with_shoulders
from signsplice.written.tree import Tier, WrittenSign

FPS, HANDS, FRAMES = 30.0, (30, 60), 90
CODES = {
    (table, code): words
    for table, rows in sections(nonmanual.__file__, "faces").items()
    if table != "shapes"
    for code, *words in rows
}


def face(*tiers: Tier) -> Face:
    """The face of a sign of one second in three."""
    made = nonmanual.face_of(WrittenSign("X", tiers=tiers), HANDS, FRAMES, FPS)
    assert made is not None
    return made


def level(made: Face) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """The largest weight of each frame (T,)."""
    return np.asarray(made.weights.max(axis=1))


@pytest.mark.parametrize(("table", "code"), [key for key in CODES if key[0] not in ("head", "body", "shoulder")])
def test_every_code_of_the_face_shows_during_the_hands_and_is_at_rest_around_them(table: str, code: str) -> None:
    made = nonmanual.face_of(WrittenSign("X", tiers=(Tier(table, code, lane="a"),)), HANDS, FRAMES, FPS)
    if CODES[table, code] == ["ahead"]:
        assert made is None
        return
    assert made is not None
    assert len(made) == FRAMES
    shown = level(made)
    assert shown[30:60].max() >= 0.15
    assert shown[:19].max() == shown[71:].max() == 0.0
    assert np.abs(np.diff(made.weights, axis=0)).max() < 0.55


@pytest.mark.parametrize(("table", "code"), [key for key in CODES if key[0] in ("head", "body")])
def test_every_gesture_moves_its_part_during_the_hands_and_brings_it_back(table: str, code: str) -> None:
    tracks = nonmanual.body_tracks(WrittenSign("X", tiers=(Tier(table, code, lane=table),)))
    sign = notation.everyday()["MOTHER"]
    plain = planner.synthesize_word(sign)
    moved = planner.synthesize_word(replace(sign, gestures=tracks))
    assert nonmanual.left_out(WrittenSign("X", tiers=(Tier(table, code),))) == ()
    angles = np.rad2deg(np.abs((moved.states - plain.states)[:, pose.TRUNK.start : pose.HEAD.stop])).max(axis=1)
    if not CODES[table, code]:
        assert tracks == ()
        return
    assert angles[plain.events.start : plain.events.end].max() > 2.0
    assert angles[0] == angles[-1] == 0.0


def test_brows_are_held_as_long_as_the_hands_sign() -> None:
    made = face(Tier("eye_brows", "RB", lane="face")).of(["browOuterUpLeft"])[:, 0]
    np.testing.assert_allclose(made[32:58], 0.8, atol=1e-6)


@pytest.mark.parametrize(
    ("table", "code", "axis", "towards"),
    [
        ("head", "SL", 2, (1, 0, 0)),
        ("head", "SR", 2, (-1, 0, 0)),
        ("head", "TL", 1, (1, 0, 0)),
        ("head", "TR", 1, (-1, 0, 0)),
        ("head", "NF", 2, (0, -1, 0)),
        ("head", "NB", 2, (0, 1, 0)),
        ("body", "RL", 2, (1, 0, 0)),
        ("body", "TR", 1, (-1, 0, 0)),
        ("body", "TF", 1, (0, 0, 1)),
    ],
)
def test_left_and_right_are_the_signers_own(
    table: str, code: str, axis: int, towards: tuple[float, float, float]
) -> None:
    """The axis of the head (1 up, 2 to the front) goes towards a direction; the left arm is at +X."""
    sign = notation.everyday()["MOTHER"]
    plain = planner.synthesize_word(sign)
    tracks = nonmanual.body_tracks(WrittenSign("X", tiers=(Tier(table, code, lane=table),)))
    moved = planner.synthesize_word(replace(sign, gestures=tracks))
    head = plain.clip.skeleton.names.index("mixamorig:Head")
    before, after = (forward(word.clip, [head])[0][:, 0, :, axis] for word in (plain, moved))
    frame = (plain.events.start + plain.events.end) // 2
    assert (after - before)[frame] @ towards > 0.05


def test_a_look_to_the_left_turns_both_eyes_there() -> None:
    assert set(face(Tier("eye_gaze", "LE", lane="gaze")).channels) == {"eyeLookOutLeft", "eyeLookInRight"}


def test_items_of_a_lane_follow_one_another_and_share_the_time() -> None:
    made = face(Tier("eye_lids", "WB", 0, lane="face"), Tier("eye_lids", "SB", 1, lane="face"))
    wide, narrow = made.of(["eyeWideLeft", "eyeSquintLeft"]).T
    assert wide[38] > 0.7
    assert narrow[38] < 0.05
    assert wide[52] < 0.05
    assert narrow[52] > 0.6
    together = face(Tier("eye_lids", "WB", 0, lane="face"), Tier("eye_brows", "RB", 0, lane="face"))
    assert (together.of(["eyeWideLeft", "browInnerUp"])[45] > 0.6).all()


def test_a_mouthing_takes_the_time_of_the_hands_unless_it_would_be_too_fast_to_say() -> None:
    word = level(face(Tier("mouth_picture", "ro:d", lane="mouthing")))
    assert word[33:57].min() > 0.05
    assert word[64:].max() == 0.0
    long = level(face(Tier("mouth_picture", "dIsuIsEnlANv@rhal", lane="mouthing")))
    assert long[66] > 0.05


def test_a_gesture_written_as_a_mouthing_is_the_gesture() -> None:
    assert (
        face(Tier("mouth_picture", "C01", lane="m")).channels == face(Tier("mouth_gesture", "C01", lane="m")).channels
    )


def test_amounts_scale_what_is_shown() -> None:
    half = face(Tier("eye_brows", "RB", amount=0.5, lane="face"))
    np.testing.assert_allclose(half.weights, 0.5 * face(Tier("eye_brows", "RB", lane="face")).weights, atol=1e-6)
    (track,) = nonmanual.body_tracks(WrittenSign("X", tiers=(Tier("head", "ND", amount=0.5, lane="head"),)))
    assert track == Gesture("head", (6.0, 0.0, 0.0), 1.0)


def test_what_is_not_made_is_named_and_the_rest_is_made() -> None:
    tiers = (
        Tier("mouth_picture", "w0w", lane="mouth"), Tier("eye_brows", "XX", lane="face"),
        Tier("shoulder", "PB", lane="shoulder"), Tier("eye_lids", "WB", lane="face"),
    )  # fmt: skip
    assert [line.split(" is left out")[0] for line in nonmanual.left_out(WrittenSign("X", tiers=tiers))] == [
        "mouth_picture w0w", "eye_brows XX", "shoulder PB",
    ]  # fmt: skip
    assert face(*tiers).channels == ("eyeWideLeft", "eyeWideRight")


@pytest.mark.parametrize("code", [code for table, code in CODES if table == "shoulder"])
def test_shoulders_move_while_hands_keep_place_and_direction(code: str) -> None:
    word = planner.synthesize_word(notation.everyday()["MOTHER"])
    hands = word.events.start, word.events.end + 1
    moved = with_shoulders(word.clip, WrittenSign("X", tiers=(Tier("shoulder", code, lane="a"),)), hands)
    (turns, before), (turned, after) = forward(word.clip), forward(moved)
    wrists, arms = ([JOINTS[side + name] for side in ("Left", "Right")] for name in ("Hand", "Arm"))
    assert np.linalg.norm(after - before, axis=-1)[:, wrists].max() < 0.2
    assert np.abs(turned - turns)[:, wrists].max() < 1e-9
    went = np.linalg.norm(after - before, axis=-1)[:, arms].max(axis=0)
    assert [bool(way > 2.0) for way in went] == [
        CODES["shoulder", code][0] in ("both", side) for side in ("Left", "Right")
    ]


def test_shoulders_stay_and_say_so_where_a_hand_is_in_their_way() -> None:
    text = "X  hands=one kind=written\n  X shape=flat at=shoulder by=palm palm=down fingers=in touch=yes\n  H\n"
    (sign,) = notation.parse(text).values()
    word = planner.synthesize_word(sign)
    tier = Tier("shoulder", "UB", lane="a", amount=2.0)
    made = with_shoulders(word.clip, WrittenSign("X", tiers=(tier,)), (word.events.start, word.events.end + 1))
    assert made.notes == ("the shoulders stay: the hands are in their way",)
    assert np.array_equal(made.local_rotations, word.clip.local_rotations)
