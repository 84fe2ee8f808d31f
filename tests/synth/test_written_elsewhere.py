"""HamNoSys as others write it: files, names and constructions that lexicons have. All signs here are constructed."""

from __future__ import annotations

import json

import pytest

import signsplice as ss
from signsplice.written import files
from signsplice.written.tree import Motion, Pair, Place, Site, Tier, WrittenPosture, WrittenSign
from written_words import code

NAMES = "flathand extfingeru palml chest touch moveo"
TEXT, LISTED = code(NAMES), ",".join(f"ham{name}" for name in NAMES.split())
TAGS = "".join(f"<ham{name}/>" for name in NAMES.split())


def hns(manual: str, gloss: str = "A", face: str = "") -> str:
    face = f"<hamnosys_nonmanual>{face}</hamnosys_nonmanual>"
    return f'<hns_sign gloss="{gloss}">{face}<hamnosys_manual>{manual}</hamnosys_manual></hns_sign>'


SIGN = f"<sigml>{hns(TAGS)}</sigml>"
GESTURAL = '<sign_manual><handconfig handshape="flat" extfidir="u" palmor="l"/></sign_manual>'


@pytest.mark.parametrize(
    ("name", "content", "glosses"),
    [
        ("a.sigml", SIGN.encode("utf-16"), "A"),
        ("a.sigml", b"\xef\xbb\xbf" + SIGN.encode(), "A"),
        ("a.sigml", f"\n<?xml version='1.0'?>{SIGN}\n<?xml version='1.0'?>{SIGN}".encode(), "A A#2"),
        ("a.sigml", (hns(TAGS) + hns(TAGS, "B")).encode(), "A B"),
        ("a.sigml", hns(TAGS, "R&D").encode(), "R&D"),
        ("a.sigml", hns(TAGS, "ÜBEN").encode("latin-1"), "ÜBEN"),
        ("a.sigml", hns(TAGS.replace("hamext", "HamExt")).encode(), "A"),
        ("a.sigml", SIGN.replace("hns", "x:hns").replace("<sigml", '<sigml xmlns:x="x"').encode(), "A"),
        ("a.sigml", hns(TEXT).encode(), "A"),
        ("a.sigml", hns(LISTED).encode(), "A"),
        ("a.sigml", f'<hamgestural_sign gloss="A"><sign_manual>{TAGS}</sign_manual></hamgestural_sign>'.encode(), "A"),
        ("a.sigml", f'<hns_sign gloss="A">{GESTURAL}</hns_sign>'.encode(), "A"),
        ("a.csv", f"Glosse;HamNoSys\nA;{TEXT}\n".encode(), "A"),
        ("a.csv", f"A,{TEXT}\nB,{TEXT}\n".encode(), "A B"),
        ("a.csv", f'7;A;"{LISTED}"\n8;B;"{LISTED}"\n'.encode(), "A B"),
        ("a.csv", f'word,sigml\nA,"{TAGS}"\nB,"{SIGN.replace(chr(34), chr(39))}"\n'.encode(), "A B"),
        ("a.tsv", f"Gloss\tHamNoSys\nA\t{TEXT}\n".encode("utf-16"), "A"),
        ("a.txt", f"HamNoSys\t00:00:01\t{TEXT}\tA\nHamNoSys\t00:00:02\t{TEXT}\tB\n".encode(), "A B"),
        ("a.txt", f"1 0 117 A {TEXT}\n2 0 83 B {TEXT}\n".encode(), "A B"),
        (
            "a.json",
            json.dumps({"7": {"hamnosys": TEXT, "type_name": "A"}, "x_8": {"hamnosys": TEXT}}).encode(),
            "A x_8",
        ),
        ("a.json", json.dumps([{"w": "A", "s": SIGN}]).encode(), "A"),
        ("a.json", json.dumps({"signs": [{"Gloss": "A", "HamNoSys": LISTED.split(",")}]}).encode(), "A"),
        ("a.txt", f"A\t{NAMES}\n".encode(), "A"),
    ],
)
def test_a_file_of_another_form_is_read(name: str, content: bytes, glosses: str) -> None:
    found = files.parse(content, name)
    assert not found.refused
    assert " ".join(found.signs) == glosses
    for sign in found.signs.values():
        assert sign.posture.fingers == ("u",)


def test_a_row_without_notation_refuses_no_other() -> None:
    found = files.parse(json.dumps({"A": {"hamnosys": None}, "B": {"hamnosys": TEXT}}).encode(), "a.json")
    assert list(found.signs) == ["B"]
    assert [str(error) for error in found.refused] == ["a.json: A: has no symbol of HamNoSys"]


def test_tiers_that_say_nothing_or_are_not_known_refuse_no_hands() -> None:
    face = '<hnm_body tag=""/><hnm_head tag="TR"/><hnm_odd tag="X"/>'
    sign = files.parse(hns(TAGS, face=face).encode(), "a.sigml").signs["A"]
    assert sign.tiers == (Tier("head", "TR", lane="head"),)
    assert sign.notes == ("line 1: <hnm_odd> without what is known of it is left out",)


def test_of_alternatives_the_first_is_read() -> None:
    for text in (f"{TEXT[0]}{{{TEXT[1]}|{code('extfingero')}}}{TEXT[2:]}", f"{TEXT}|{code('fist')}"):
        sign = files.one(text)
        assert (sign.posture.fingers, len(sign.motions)) == (("u",), 1)
        assert "of alternatives the first is read" in sign.notes[0]


@pytest.mark.parametrize("text", ["|", "|" + TEXT, "{", code("seqend"), code("seqend") + "|" + TEXT])
def test_what_holds_no_symbol_is_refused(text: str) -> None:
    with pytest.raises(ss.InputError, match="has no symbol of HamNoSys"):
        files.one(text)


def read(names: str) -> WrittenSign:
    return files.one(code(names))


@pytest.mark.parametrize(
    ("symmetry", "hands"),
    [
        ("symmlr", "mirrored"),
        ("symmlr largemod", "mirrored_up_down"),
        ("symmlr fingerstraightmod", "mirrored_out_in"),
        ("symmlr fingerstraightmod largemod", "point"),
        ("symmpar largemod alternatingmotion", "up_down"),
        ("symmpar fingerstraightmod", "out_in"),
        ("symmpar fingerstraightmod largemod", "up_down_out_in"),
    ],
)
def test_symbols_after_symmetry_say_in_which_directions_hands_mirror(symmetry: str, hands: str) -> None:
    assert read(f"{symmetry} fist extfingerl palml moveu").hands == hands


def test_brackets_say_what_is_brushed_how_passes_shift_and_what_the_head_does() -> None:
    (motion,) = read("flathand extfingero palmd movel seqbegin brushing chest lrat touch seqend").motions
    assert motion.brushing == Place("chest", "right_at", "brushing")
    (motion,) = read("flathand extfingero palmd movel seqbegin brushing palm touch seqend").motions
    assert motion.brushing_pair == Pair(weak=Site("palm"), contact="brushing")
    (motion,) = read("flathand extfingero palmd moved seqbegin repeatfromstart mover smallmod seqend").motions
    assert (motion.repeat, motion.shift) == ("fromstart", "r")
    sign = read("flathand extfingero palmd moved seqbegin head twisting seqend")
    assert [motion.kind for motion in sign.motions] == ["straight", "hold"]
    assert sign.tiers == (Tier("head", "SH", lane="head"),)
    (motion,) = read("finger2 extfingero palmd mover zigzag ellipsev largemod").motions
    assert (motion.ellipse, motion.zigzag_size) == ("u", "big")


def test_a_contact_before_a_place_is_between_two_hands() -> None:
    assert read("symmlr flathand extfingeru palml touch chin").posture.pair == Pair(
        contact="touch", place=Place("chin")
    )
    assert read("flathand extfingeru palml touch chin").posture.place == Place("chin", contact="touch")


def test_hands_that_meet_at_a_place_and_places_of_two_hands_at_the_head() -> None:
    tip = "fingertip indexfinger"
    pair = read(
        f"symmlr finger2 extfingeru palml parbegin neck plus {tip} seqbegin touch {tip} seqend parend"
    ).posture.pair
    assert pair == Pair(Site("tip", (2,)), Site("tip", (2,)), "touch", Place("neck"))
    for weak in ("lrat ear", "ear lrat"):
        posture = read(f"symmlr fist extfingeru palml parbegin ear lrat plus {weak} parend").posture
        assert posture.place == Place("ear", "right_at")
        assert posture.weak == WrittenPosture(place=Place("ear", "left_at"))


def test_a_part_of_one_finger_at_another_says_that_they_cross() -> None:
    shape = read("finger23 indexfinger fingernail middlefinger extfingeru palmd moveo").posture.shape
    assert shape is not None
    assert (shape.pair, shape.crossed) == ((2, 3), True)


def test_straight_movements_at_one_time_come_in_turn() -> None:
    (motion,) = read("flathand extfingero palmd parbegin moved mover replace palmu parend").motions
    assert [part.kind for part in motion.parts] == ["sequence", "posture"]
    assert [part.direction for part in motion.parts[0].parts] == [("d",), ("r",)]


def test_behind_after_a_movement_is_behind_the_last_place() -> None:
    (motion,) = read("flathand extfingerul palmd ear close movei behind").motions
    assert motion.target == WrittenPosture(place=Place("ear", behind=True))


def test_an_arm_that_touches_is_left_out_and_one_that_moves_moves_the_hand() -> None:
    sign = read("fist extfingeru palml handback seqbegin touch elbow seqend twisting")
    assert sign.posture.pair is None
    assert sign.motions == (Motion("twisting", where=sign.motions[0].where),)
    sign = read("fist extfingeru palml seqbegin elbow moved seqend")
    assert [motion.direction for motion in sign.motions] == [("d",)]
    assert all("elbow" in note for note in sign.notes)
