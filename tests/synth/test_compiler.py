"""Written signs compiled into the notation, and the notation's composed words."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from signsplice.errors import InputError
from signsplice.motion import rotation
from signsplice.signer import hand, locations, notation, planner, pose
from signsplice.signer.collisions import between_hands, hand_clearances
from signsplice.signer.hand import hand_part, is_part
from signsplice.signer.handshapes import BASES, THUMBS, handshape, is_handshape, thumb_depth
from signsplice.signer.locations import WeakArm, axes
from signsplice.signer.notation import notation_text
from signsplice.signer.phonology import Sign, is_location
from signsplice.signer.signer import JOINTS, STANDARD
from signsplice.written import signing
from signsplice.written.compiler import compile_sign
from signsplice.written.tree import Motion, Pair, Place, Site, WrittenManner, WrittenPosture, WrittenShape, WrittenSign
from signsplice.written.vocabulary import direction, facing, hand_axes

INDEX = WrittenPosture(WrittenShape("finger2"), ("u",), ("l",), Place("chest", "right_at", "close"))
FLAT = WrittenPosture(WrittenShape("flat"), ("o",), ("d",), Place("shoulders", contact="close"))


def sign(posture: WrittenPosture, *motions: Motion, **changes: object) -> WrittenSign:
    return replace(WrittenSign("WORD", posture=posture, motions=motions), **changes)  # type: ignore[arg-type]


def straight(letters: str, **changes: object) -> Motion:
    return replace(Motion("straight", (letters,)), **changes)  # type: ignore[arg-type]


def made(posture: WrittenPosture, *motions: Motion, **changes: object) -> Sign:
    return compile_sign(sign(posture, *motions, **changes))


TABLE = {
    "u": "o l i r", "o": "d l u r", "d": "i l o r", "l": "d i u o", "r": "d o u i", "ul": "dl i ur o",
    "dl": "dr i ul o", "ur": "dr o ul i", "dr": "dl o ur i", "ol": "d il u or", "il": "d ol u ir", "ui": "id l ou r",
    "ir": "d il u or",
}  # fmt: skip
"""Where palms d, l, u and r face by the fingers' direction."""


@pytest.mark.parametrize("fingers", TABLE)
def test_palms_face_as_the_table_of_directions_says(fingers: str) -> None:
    for palm, expected in zip("dlur", TABLE[fingers].split(), strict=True):
        assert np.allclose(facing(direction((fingers,)), (palm,)), direction((expected,)), atol=1e-6), palm


def test_a_palm_between_two_words_lies_between_them_and_across_the_fingers() -> None:
    for fingers, words in product(("uo", "ol", "u"), (("d", "l"), ("ul", "u"))):
        along = direction((fingers,))
        palm = facing(along, words)
        assert abs(np.dot(palm, along)) < 1e-6
        one, other = (facing(along, (word,)) for word in words)
        assert np.dot(palm, one) == pytest.approx(np.dot(palm, other))


def test_opposite_directions_have_no_middle_and_letters_that_cancel_are_refused() -> None:
    assert direction(("u", "d")) == direction(("u",))
    with pytest.raises(InputError, match="'oi' points nowhere"):
        direction(("oi",))


BENDS = ("", "bent", "round", "hooked", "dblbent", "dblhooked")
SHAPES = [".".join(filter(None, words)) for words in product(BASES, ("", *THUMBS), BENDS)]


def test_composed_handshapes_stay_within_limits_and_keep_thumbs_and_fingers_apart() -> None:
    angles = np.array([handshape(text).angles for text in SHAPES])
    assert (angles >= hand.LIMITS[:, 0] - 1e-9).all()
    assert (angles <= hand.LIMITS[:, 1] + 1e-9).all()
    deep = thumb_depth(angles)
    assert [(text, depth) for text, depth in zip(SHAPES, deep, strict=True) if depth > 0.45] == []


@pytest.mark.parametrize(("text", "finger"), [("pinch12", 0), ("pinch12open", 0), ("pinchall", 0), ("pinch12.s3", 1)])
def test_the_thumb_meets_the_finger_that_it_is_opposed_to(text: str, finger: int) -> None:
    points = handshape(text).points
    tips = points[16:] - points[15]
    assert np.linalg.norm(tips[finger]) < 2.1


def test_composed_shapes_say_what_single_fingers_do() -> None:
    texts = (
        "flat",
        "fist",
        "finger2.s5",
        "flat.4:dblhooked",
        "finger2345.x3",
        "flat.bent",
        "flat~flat.bent",
        "flat.410",
    )
    flexion = {text: np.rad2deg(handshape(text).angles[:16].reshape(4, 4)[:, 1:].sum(axis=1)) for text in texts}
    assert (flexion["flat"] < 15).all()
    assert (flexion["fist"] > 240).all()
    assert np.argmin(flexion["finger2.s5"]) == 3
    assert np.argmax(flexion["flat.4:dblhooked"]) == 2
    assert np.argmax(flexion["finger2345.x3"]) == 1
    assert np.allclose(flexion["flat~flat.bent"], 0.5 * (flexion["flat"] + flexion["flat.bent"]))
    assert np.allclose(flexion["flat.410"], 117.0)


def test_slack_shapes_are_more_open_and_crossed_fingers_cross() -> None:
    assert handshape("ceeall.w0.6").angles[1] < handshape("ceeall").angles[1] < handshape("ceeall.w1.4").angles[1]
    crossed = handshape("finger23.c23").points
    assert crossed[16][2] < crossed[17][2]
    assert handshape("finger23").points[16][2] > handshape("finger23").points[17][2]


@pytest.mark.parametrize("text", ["flat.sideways", "nothing", "flat~fist~flat", "flat.6:bent", "finger2.4:wide"])
def test_what_composes_no_handshape_is_none(text: str) -> None:
    assert not is_handshape(text)


def test_composed_places_lie_on_the_skin_beside_and_between_named_ones() -> None:
    weak = WeakArm(STANDARD, np.zeros(27))
    chin, mouth, both, ear, other = (
        locations.locate(name, weak) for name in ("chin", "mouth", "chin/mouth", "ear", "ear-weak")
    )
    assert chin.point[1] < both.point[1] < mouth.point[1]
    assert np.allclose(ear.point * pose.MIRROR, other.point, atol=0.05)
    beside = locations.locate("chest:8,-3", weak).point - locations.locate("chest", weak).point
    assert np.allclose(beside[:2], (-8.0, -3.0), atol=0.8)
    assert np.allclose(locations.locate("space:1,2,30", weak).point, axes((1.0, 2.0, 30.0)))


@pytest.mark.parametrize("text", ["space:1,2", "chin/", "base-6.tip", "nowhere:1,2", "a/b/c", "space-mid/chin"])
def test_what_composes_no_place_is_none(text: str) -> None:
    assert not is_location(text)


def test_parts_of_fingers_go_with_the_fingers() -> None:
    straight_hand, fist = handshape("finger2").points, handshape("fist").points
    for points in (straight_hand, fist):
        assert np.allclose(hand_part("2.tip").centre(points), points[16])
        normals = [hand_part(f"2.mid.{side}").normal(points) for side in ("palmar", "dorsal", "radial", "ulnar")]
        assert np.allclose(normals[0], -normals[1])
        assert np.allclose(normals[2], -normals[3])
    assert np.allclose(hand_part("2.tip").normal(straight_hand), (-1.0, 0.0, 0.0), atol=0.15)
    assert hand_part("2.tip").normal(fist)[0] > 0.0
    middle = 0.5 * (hand_part("palm").centre(fist) + hand_part("heel").centre(fist))
    assert np.allclose(hand_part("palm/heel").centre(fist), middle)
    assert not is_part("2.elbow")


@pytest.mark.parametrize("read", [notation.everyday, notation.alphabet])
def test_text_of_a_sign_reads_back_as_the_sign(read: object) -> None:
    for gloss, word in read().items():  # type: ignore[operator]
        text = notation_text(word)
        again = notation.parse(text)[gloss]
        assert [s.kind for s in again.segments] == [s.kind for s in word.segments]
        for one, other in zip(again.segments, word.segments, strict=True):
            assert np.allclose(one.strong.palm, other.strong.palm, atol=2e-3)
            assert np.allclose(one.strong.shift, other.strong.shift, atol=1e-3)
            assert replace(one.strong, palm=(0, 0, 0), fingers=(0, 0, 0), shift=(0, 0, 0)) == replace(
                other.strong, palm=(0, 0, 0), fingers=(0, 0, 0), shift=(0, 0, 0)
            )


def test_a_motion_travels_as_far_and_where_it_is_written() -> None:
    for letters, size, expected in (("d", "small", (0, -6, 0)), ("o", "big", (0, 0, 20)), ("l", "", (-12, 0, 0))):
        segments = made(INDEX, straight(letters, size=size)).segments
        assert [s.kind for s in segments] == ["X", "M", "H"]
        assert np.allclose(segments[1].strong.shift, expected)


def test_a_hand_leaves_skin_that_ends_before_its_way() -> None:
    at = replace(FLAT, place=Place("forehead", side="right_at", contact="touch"))
    along, off = (made(at, straight(letters, size="small")).segments[1].strong for letters in ("l", "ur"))
    assert along.touch
    assert not off.touch
    assert np.allclose(off.shift, (4.243, 4.243, 0.0), atol=0.01)


def test_curves_bulge_to_their_side_by_half_the_chord_at_most() -> None:
    path = made(INDEX, straight("r", size="small", curve="u", curve_size="big")).segments[1].path
    assert (path.kind, path.direction, path.size) == ("arc", (0.0, 1.0, 0.0), 3.0)


def test_repetition_from_the_start_is_a_movement_made_more_often() -> None:
    for repeat, times in (("fromstart", 2), ("fromstart_several", 3)):
        movement = made(INDEX, straight("d", repeat=repeat)).segments[1]
        assert movement.times == times
    turns = made(INDEX, Motion("circle", ("l",), repeat="fromstart")).segments[1].path
    assert (turns.revolutions, turns.direction) == (2.0, (-1.0, 0.0, 0.0))


def test_a_group_is_repeated_with_a_way_back_and_continues_where_it_ended() -> None:
    pair = (straight("d", size="small"), straight("r", size="small"))
    group = Motion("sequence", parts=pair, repeat="fromstart")
    shifts = [s.strong.shift for s in made(INDEX, group).segments]
    assert shifts == [(0, 0, 0), (0, -6, 0), (6, -6, 0), (0, 0, 0), (0, -6, 0), (6, -6, 0), (6, -6, 0)]
    onwards = [s.strong.shift for s in made(INDEX, replace(group, repeat="continue")).segments]
    assert onwards[-1] == (12, -12, 0)
    there_and_back = [s.strong.shift for s in made(INDEX, replace(group, repeat="reverse")).segments]
    assert there_and_back[-1] == (0, 0, 0)


def test_manner_sets_tempo_and_holds() -> None:
    for manner, tempo in ((WrittenManner(fast=True), 1.5), (WrittenManner(slow=True), 0.625)):
        assert made(INDEX, straight("d", manner=manner)).segments[1].tempo == tempo
    held = made(INDEX, straight("d", manner=WrittenManner(halt=True)), straight("u")).segments
    assert [(s.kind, s.seconds) for s in held][2] == ("H", 0.15)


def test_parallel_motions_are_one_movement_and_a_new_posture_keeps_its_palm_letters() -> None:
    opening = Motion("posture", target=WrittenPosture(WrittenShape("finger2345"), fingers=("o",)))
    parts = (straight("d", size="big"), Motion("fingerplay"), opening)
    start = replace(INDEX, palm=("d",))
    movement = made(start, Motion("parallel", parts=parts)).segments[1]
    assert movement.local is not None
    assert movement.local.kind == "wiggle"
    assert (movement.strong.fingers, movement.strong.palm) == ((0.0, 0.0, 1.0), (0.0, -1.0, 0.0))
    assert movement.strong.shape == "finger2345"


def test_mirrored_hands_are_symmetric_and_hands_by_turns_alternate() -> None:
    assert made(FLAT, straight("u"), hands="mirrored").hands == "symmetric"
    assert made(FLAT, straight("u", repeat="fromstart"), hands="mirrored", alternating=True).hands == "alternating"
    assert made(FLAT, straight("u")).hands == "one"


def test_what_is_written_for_the_weak_hand_is_read_literally() -> None:
    weak = WrittenPosture(fingers=("r",), palm=("d",))
    segments = made(replace(FLAT, weak=weak), straight("u"), hands="mirrored").segments
    assert segments[0].weak is not None
    assert segments[0].weak.fingers == (-1.0, 0.0, 0.0), "right is towards the strong side, in"
    split = Motion("split", parts=(straight("d", size="small"), straight("u", size="small")))
    last = made(FLAT, split, hands="mirrored").segments[1]
    assert last.weak is not None
    assert (last.strong.shift[1], last.weak.shift[1]) == (-6.0, 6.0)


def test_parallel_hands_go_the_same_way() -> None:
    last = made(FLAT, straight("l"), hands="parallel").segments[1]
    assert last.weak is not None
    assert (last.strong.shift, last.weak.shift) == ((-12, 0, 0), (12, 0, 0))


def test_a_compound_lets_the_weak_hand_come_for_its_part() -> None:
    parts = (sign(INDEX, straight("d")), sign(FLAT, straight("u"), hands="mirrored"))
    whole = compile_sign(WrittenSign("WORD", parts=parts))
    assert whole.hands == "base"
    assert [s.weak.location == "rest" for s in whole.segments if s.weak] == [True, True, False, False, False]


def test_the_weak_hand_alone_signs_while_the_strong_one_rests() -> None:
    segments = made(INDEX, straight("d"), hands="weak").segments
    assert {s.strong.location for s in segments} == {"rest"}
    assert segments[1].weak is not None
    assert segments[1].weak.shift == (0, -12, 0)


@pytest.mark.parametrize(
    ("posture", "message"),
    [
        (replace(INDEX, shape=None), "WORD: has no handshape"),
        (replace(INDEX, palm=None), "WORD: has no palm direction"),
        (replace(INDEX, place=Place("knee")), "WORD: place 'knee' is not known"),
    ],
)
def test_what_is_missing_or_unknown_is_refused_by_name(posture: WrittenPosture, message: str) -> None:
    with pytest.raises(InputError, match=message):
        made(posture)


def test_a_lenient_compiler_takes_the_usual_for_what_is_not_written() -> None:
    assert compile_sign(sign(replace(INDEX, shape=None, palm=None)), lenient=True).segments[0].strong.shape == "flat"


def test_a_compiled_sign_can_be_mended_as_text() -> None:
    one = made(INDEX, straight("d"))
    text = notation_text(one).replace("shape=finger2 ", "shape=finger23 ")
    assert notation.parse(text)["WORD"].segments[0].strong.shape == "finger23"
    assert notation.parse(notation_text(one))["WORD"] == one


def test_a_place_between_the_middle_and_a_side_is_half_way_to_the_side() -> None:
    between = Place("shoulders", contact="close", between=Place("chest", "right_at"))
    location = made(replace(INDEX, place=between)).segments[0].strong.location
    assert location == "space:6,9.5,25"


def test_frames_of_postures_are_where_the_hands_have_come_to_them() -> None:
    word = planner.synthesize_word(made(INDEX, straight("d", size="big"), straight("r", size="small")))
    frames = [word.events.start, *(one.end for one in word.segments if one.segment.kind == "M")]
    assert len(frames) == 3
    heights = word.states[frames, 1]
    assert heights[0] - heights[1] == pytest.approx(20.0, abs=3.0)


TOUCHES = [
    ("finger2", "u", "l", Place("chin", contact="touch"), "2.tip"),
    ("finger2", "ul", "d", Place("forehead", "right_beside", "touch", hand=Site("nail", (2,))), "2.nail"),
    ("flat", "l", "d", Place("chest", contact="touch"), "palm"),
    ("flat", "ul", "d", Place("cheek", "right_at", "touch", hand=Site("tip", (3,))), "3.tip"),
    ("fist", "u", "l", Place("lips", contact="touch", between=Place("chin"), hand=Site("thumbside")), "radial"),
]


@pytest.mark.parametrize(("shape", "fingers", "palm", "place", "part"), TOUCHES)
def test_a_written_contact_is_a_touch_in_the_motion(
    shape: str, fingers: str, palm: str, place: Place, part: str
) -> None:
    one = made(WrittenPosture(WrittenShape(shape), (fingers,), (palm,), place), straight("o"))
    assert one.segments[0].strong.part == part
    word = planner.synthesize_word(one)
    frame = word.segments[0].end
    assert hand_clearances(word.states[frame : frame + 1], STANDARD)[0, 0] < 0.5


@pytest.mark.parametrize(("side", "sign_of"), [("left_at", 1.0), ("right_at", -1.0)])
def test_a_pair_of_hands_is_on_the_side_that_is_written(side: str, sign_of: float) -> None:
    posture = replace(FLAT, place=None, pair=Pair(contact="close", place=Place("shoulders", side, "close")))
    word = planner.synthesize_word(made(posture, straight("d", size="small"), hands="parallel"))
    strong, weak = pose.hands(word.states[word.segments[0].end : word.segments[0].end + 1])[0, :, 0]
    assert sign_of * (strong - weak) / 2.0 > 3.0, "a weak hand's state is mirrored"


@pytest.mark.parametrize(
    "pair",
    [
        Pair(Site("thumbside"), Site("pinkyside"), "touch", Place("chest", contact="close")),
        Pair(Site("tip", (2,)), Site("tip", (2,)), "touch", Place("chest", contact="close")),
        Pair(None, None, "touch", Place("chest", contact="close")),
    ],
)
def test_hands_that_are_written_to_meet_touch(pair: Pair) -> None:
    posture = WrittenPosture(WrittenShape("fist"), ("ol",), ("l",), pair=pair)
    word = planner.synthesize_word(made(posture, straight("d", size="small"), hands="mirrored"))
    frame = word.segments[0].end
    assert abs(between_hands(word.states[frame : frame + 1], STANDARD)[0]) < 0.5


def test_a_circle_about_an_oblique_axis_comes_back_and_half_a_turn_ends_across() -> None:
    half = made(INDEX, Motion("circle", ("ol",), turns=0.0, start="u", end="d")).segments[1]
    assert half.path.revolutions == pytest.approx(0.5, abs=1e-3)
    assert np.allclose(half.strong.shift, (0, -10, 0), atol=1e-2)
    word = planner.synthesize_word(made(INDEX, Motion("circle", ("ol",))))
    one = word.segments[1]
    wrists = word.states[one.begin : one.end + 1, :3] - word.states[one.begin, :3]
    assert np.linalg.norm(wrists[-1]) < 4.0
    assert 7.0 < np.ptp(wrists[:, 1]) < 12.0
    assert np.abs(wrists @ axes(direction(("ol",)))).max() < 2.5, "it stays in the plane across the axis"


def test_a_swing_moves_the_wrist_sideways_and_a_stir_both_ways() -> None:
    for kind, moved in (("swinging", (1,)), ("nodding", (2,)), ("stircw", (1, 2))):
        word = planner.synthesize_word(made(INDEX, Motion(kind)))
        one = word.segments[1]
        span = np.ptp(word.states[one.begin : one.end + 1, pose.ROTVEC], axis=0)
        assert {k for k in (1, 2) if span[k] > 0.25} == set(moved), kind


def test_a_hand_deep_in_the_body_is_named_with_its_frame() -> None:
    states = planner.synthesize_word(made(INDEX)).states.copy()
    states[12, pose.WRIST] = (-4.0, -4.0, 8.0)  # in the chest
    (line,) = signing.deep_hands(pose.clip(states, STANDARD, 30.0))
    assert line.startswith("a hand lies ")
    assert "mm deep in the body at frame 12;" in line


@pytest.mark.parametrize(
    ("fingers", "palm", "faces"),
    [
        (("u",), ("d", "dl"), (-0.38, 0.0, 0.92)),
        (("u", "ur"), ("l", "ul"), (-0.85, 0.35, 0.38)),  # left, and left, up and forward
        (("u", "ul"), ("l",), (-0.65, -0.27, -0.71)),  # left, and to the signer
        (("u", "ui"), ("d",), (0.0, -0.38, -0.92)),  # upright fingers beside such that point to the signer
        (("u", "uo"), ("d",), (0.0, -0.38, 0.92)),
        (("l", "il"), ("r",), (0.38, 0.0, -0.92)),
        (("o", "i"), ("d",), (0.0, -1.0, 0.0)),
    ],
)
def test_each_of_two_directions_has_a_palm_of_its_own(
    fingers: tuple[str, ...], palm: tuple[str, ...], faces: tuple[float, float, float]
) -> None:
    along, found = hand_axes(fingers, palm)
    assert np.allclose(along, direction(fingers))
    assert np.allclose(found, faces, atol=0.01)
    assert abs(np.dot(along, found)) < 1e-9


def test_an_elbow_that_jumps_is_named_with_its_frame() -> None:
    clip = signing.animate_sign(sign(INDEX, straight("u")))
    assert not clip.notes
    arm = JOINTS["RightArm"]
    local_quats = clip.local_rotations.copy()
    local_quats[20:, arm] = rotation.multiply(local_quats[20:, arm], rotation.from_euler([1.5], "Z"))
    (line,) = signing.jumps(replace(clip, local_rotations=local_quats))
    assert "jumps at frame 20" in line
