"""Readers of SiGML and HamNoSys: one tree for all, errors with places, mended defects, hostile files refused."""

from __future__ import annotations

import csv
import json
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import pytest

import signsplice as ss
from signsplice.signer import notation, planner
from signsplice.written import files, symbols
from signsplice.written.tree import Motion, Pair, Place, Site, Where, WrittenPosture, WrittenShape, WrittenSign
from written_words import CODES, ELSEWHERE, code, constructed

HERE = Path(__file__).parent
TABLE = HERE / "hamnosys_signs.csv"
TEN = HERE / "written_signs.sigml"
NGT = Path(__file__).resolve().parents[2].parent / "shared" / "data" / "sigml" / "ngt"
POINT = "finger2 thumbacrossmod extfingeru palml "


def read(names: str, lenient: bool = False) -> WrittenSign:
    """The sign of some symbols' names."""
    return files.one(code(names), "X", lenient)


def motion(names: str) -> Motion:
    """The only motion of a pointing hand that does what is named."""
    (found,) = read(f"{POINT} shoulders close {names}").motions
    return found


def bare(value: Any) -> Any:
    """A tree without the places of its symbols, its gloss and its face."""
    if isinstance(value, tuple):
        return tuple(map(bare, value))
    if not is_dataclass(value) or isinstance(value, type):
        return value
    made = {f.name: bare(getattr(value, f.name)) for f in fields(value)}
    if "where" in made:
        made["where"] = Where()
    if isinstance(value, WrittenSign):
        made |= {"gloss": "", "tiers": (), "notes": ()}
    return replace(value, **made)


def gestural(manual: str, attributes: str = "", nonmanual: str = "") -> WrittenSign:
    """The sign of a manual part in gestural SiGML."""
    text = (
        f'<sigml><hamgestural_sign gloss="X"><sign_nonmanual>{nonmanual}</sign_nonmanual>\n'
        f"<sign_manual {attributes}>\n{manual}</sign_manual></hamgestural_sign></sigml>"
    )
    found = files.parse(text.encode(), "x.sigml")
    for error in found.refused:
        raise error
    return found.signs["X"]


def test_the_table_holds_the_constructed_signs_and_every_supported_symbol() -> None:
    with TABLE.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert {row["gloss"]: row["names"] for row in rows} == constructed()
    assert all(row["hamnosys"] == code(row["names"]) for row in rows)
    assert len(rows) >= 150
    assert {name for row in rows for name in row["names"].split()} == set(CODES) - set(ELSEWHERE)


def test_every_constructed_sign_is_read_without_a_mend() -> None:
    found = files.read(TABLE)
    assert not found.refused
    assert list(found.signs) == list(constructed())
    assert not [sign.notes for gloss, sign in found.signs.items() if sign.notes and gloss != "OTHER-4"]
    assert len({bare(sign) for sign in found.signs.values()}) > 195  # only few symbols mean the same here


@pytest.mark.parametrize(
    "name", sorted(symbols.NAMES - set(ELSEWHERE) - {"version40", "orirelative", "fingermidjoint"})
)
def test_every_symbol_says_something(name: str) -> None:
    """A sign without the symbol is another, or is mended or refused; a finger alone is its middle joint."""
    names = next(n for n in constructed().values() if name in n.split())
    words = names.split()
    words.remove(name)
    try:
        without = read(" ".join(words))
    except ss.InputError:
        return
    assert without.notes or bare(without) != bare(read(names))


def test_code_points_are_those_of_the_package_hamnosys() -> None:
    hamnosys = pytest.importorskip("hamnosys", reason="the package hamnosys is not installed")
    tags = hamnosys.HamToSigml()._tag_by_code
    for text, tag in tags.items():
        first = text.split()[0]
        if first.startswith("E"):
            assert f"ham{symbols.SYMBOLS[chr(int(first, 16))].lower()}" == tag


def test_code_points_are_those_of_the_published_table() -> None:
    """Some of each row of the font's table, as they are printed in it."""
    for number, name in {
        0xE000: "fist", 0xE00B: "ceeopen", 0xE00C: "thumboutmod", 0xE011: "fingerbendmod", 0xE031: "extfingeruo",
        0xE03F: "palmul", 0xE054: "belowstomach", 0xE059: "lrat", 0xE06A: "pinkyside", 0xE07A: "fingerside",
        0xE080: "moveu", 0xE091: "moveuo", 0xE092: "circleo", 0xE0A3: "circledi", 0xE0A4: "fingerplay",
        0xE0AA: "replace", 0xE0B8: "clockfull", 0xE0BE: "zigzag", 0xE0C7: "largemod", 0xE0CC: "halt",
        0xE0D6: "brushing", 0xE0DD: "alternatingmotion", 0xE0E7: "plus", 0xE0ED: "orirelative", 0xE0F1: "version40",
    }.items():  # fmt: skip
        assert symbols.SYMBOLS[chr(number)] == name
    assert len(symbols.SYMBOLS) == len(symbols.NAMES) == 201


HAM = {
    "RED": "finger2 between fingerstraightmod extfingeru extfingerui palmd nostrils between lips touch "
    "seqbegin touch indexfinger fingertip seqend replace finger2 fingerstraightmod fast repeatfromstartseveral",
    "FATHER": "finger2 extfingeru palml lips lrat touch seqbegin touch indexfinger fingermidjoint thumbside seqend "
    "moved smallmod",
    "THROW": "fist extfingeru between extfingerui palmu neck lrbeside between ear close "
    "parbegin moveo largemod fast replace finger2 extfingeru extfingeruo palmd fast parend",
    "DRINK": "ceeall thumbopenmod extfingerol palml chin close "
    "parbegin moveui smallmod arcu replace extfingerul palmd parend close",
    "KING": "symmlr finger2345 extfingerul palmd forehead lrbeside touch "
    "seqbegin touch middlefinger fingernail palm seqend moveur smallmod fast",
    "HOUSE": "symmlr flathand extfingerul palmd palmdr parbegin indexfinger fingertip plus indexfinger fingertip "
    "parend touch shouldertop parbegin movedr smallmod arcu replace extfingero palml parend",
    "WORK": "symmlr fist extfingerol palml parbegin thumbside plus pinkyside parend close chest close "
    "parbegin moved fast plus nomotion parend touch repeatfromstart",
    "BICYCLE": "symmlr alternatingmotion fist thumbacrossmod extfingero palmd shoulders lrat between chest lrat close "
    "circlel smallmod repeatfromstart",
    "CAR": "symmlr fist thumbacrossmod parbegin extfingeruo palml plus extfingeruo palmr parend "
    "parbegin chest lrat plus lrat chest parend close "
    "parbegin movedl moveur movedl plus moveul movedr moveul parend",
    "RAIN": "symmlr flathand between finger2345 extfingeru extfingeruo palmu head close "
    "parbegin moved largemod fingerplay replace extfingero parend",
}


@pytest.mark.parametrize("gloss", HAM)
def test_a_sign_is_one_tree_in_gestural_sigml_hamnosys_sigml_and_hamnosys_text(gloss: str) -> None:
    written = files.read(TEN)
    assert not written.refused
    text = read(HAM[gloss])
    elements = "".join(f"<ham{name}/>" for name in HAM[gloss].split())
    sigml = f'<sigml><hns_sign gloss="X"><hamnosys_manual>{elements}</hamnosys_manual></hns_sign></sigml>'
    assert bare(files.parse(sigml.encode(), "x.sigml").signs["X"]) == bare(text)
    assert bare(written.signs[gloss]) == bare(text)


def test_names_of_symbols_are_read_like_their_characters() -> None:
    names = " ".join(f"ham{name}" for name in HAM["WORK"].split())
    assert bare(files.one(names)) == bare(read(HAM["WORK"]))


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        ("movedo", Motion("straight", ("do",))),
        ("mover arcu smallmod", Motion("straight", ("r",), curve="u", curve_size="small")),
        ("mover largemod arcu", Motion("straight", ("r",), size="big", curve="u")),
        ("moveo zigzag largemod", Motion("straight", ("o",), zigzag="zigzag", zigzag_size="big")),
        ("moveo smallmod increasing", Motion("straight", ("o",), size="small", size_end="big")),
        ("circleil ellipseul smallmod", Motion("circle", ("il",), ellipse="ul", ellipse_size="small")),
        ("circleo clockl", Motion("circle", ("o",), start="l")),
        ("circleo clockl clockr", Motion("circle", ("o",), start="l", end="r", turns=0.0)),
        ("circleo clockl clockr clockfull", Motion("circle", ("o",), start="l", end="r", turns=1.0)),
        ("circleo clockfull repeatcontinue", Motion("circle", ("o",), turns=2.0, repeat="continue")),
        ("fingerplay indexfinger", Motion("fingerplay", digits=(2,))),
        ("moveX", Motion("crossing")),
        ("moved touch", Motion("straight", ("d",), target=WrittenPosture(pair=Pair(contact="touch")))),
        ("moved chest touch", Motion("straight", ("d",), target=WrittenPosture(place=Place("chest", contact="touch")))),
        ("moved chest brushing", Motion("straight", ("d",), brushing=Place("chest", contact="brushing"))),
        (
            "moved handback brushing",
            Motion("straight", ("d",), brushing_pair=Pair(weak=Site("handback"), contact="brushing")),
        ),
        (
            "parbegin chest touch moveo parend",
            Motion(
                "parallel",
                parts=(
                    Motion("posture", target=WrittenPosture(place=Place("chest", contact="touch"))),
                    Motion("straight", ("o",)),
                ),
            ),
        ),
        ("replace fist", Motion("posture", target=WrittenPosture(shape=WrittenShape("fist")))),
        (
            "parbegin moveu plus moved parend smallmod",
            Motion("split", parts=(Motion("straight", ("u",), size="small"), Motion("straight", ("d",), size="small"))),
        ),
        ("moveil between moveu", Motion("straight", ("il", "u"))),
        (
            "parbegin moveu smallmod replace moved parend",
            Motion("sequence", parts=(Motion("straight", ("u",), size="small"), Motion("straight", ("d",)))),
        ),
        ("nondominant moveu", Motion("split", parts=(Motion("hold"), Motion("straight", ("u",))))),
        (
            "moveu moved repeatfromstart",
            Motion("sequence", parts=(Motion("straight", ("u",)), Motion("straight", ("d",))), repeat="fromstart"),
        ),
    ],
)
def test_a_notation_of_a_motion_is_its_tree(names: str, expected: Motion) -> None:
    assert bare(motion(names)) == bare(expected)


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        ("finger2 pinky", WrittenShape("finger2", special=(5,))),
        ("pinch12 thumboutmod", WrittenShape("pinch12", "out")),
        (
            "flathand ringfinger doublebent pinky doublebent",
            WrittenShape("flat", bends=((4, "dblbent"), (5, "dblbent"))),
        ),
        ("cee12 thumbopenmod", WrittenShape("cee12", opening=0.6)),
        ("pinch12 thumb touch middlefinger", WrittenShape("pinch12", opposed=3)),
        ("finger23 middlefinger cross indexfinger", WrittenShape("finger23", pair=(3, 2), crossed=True)),
        ("ceeopen fingerhookmod", WrittenShape("cee12open", bend="hooked")),
    ],
)
def test_a_notation_of_a_handshape_is_its_tree(names: str, expected: WrittenShape) -> None:
    assert read(f"{names} extfingeru palml chest moveu").posture.shape == expected


@pytest.mark.parametrize(
    ("names", "hands"),
    [
        ("moveu", "one"),
        ("moveu touch", "one"),
        ("parbegin moveu plus moved parend", "two"),
        ("handback touch moveu", "two"),
    ],
)
def test_a_notation_without_symmetry_has_one_hand_unless_it_names_the_other(names: str, hands: str) -> None:
    assert read(POINT + names).hands == hands


@pytest.mark.parametrize(
    ("names", "note"),
    [
        ("finger2 extfingeru palml moveu parend", "symbol 5: hamparend closes no bracket"),
        ("finger2 extfingeru palml parbegin moveu fingerplay", "symbol 6: hamparend is added at the end"),
        ("finger2 extfingeru palml parbegin seqbegin moveu parend", "hamseqend is added before hamparend"),
        ("flathand symmlr extfingero palmd moveu", "symbol 2: hamsymmlr is read as if it stood first"),
        ("flathand plus fist extfingero palmd moveu", "symbol 2: hamplus outside brackets"),
        ("flathand extfingero palmd moveu plus", "symbol 5: hamplus outside brackets"),
        ("flathand extfingero palmd moveu extfingeru", "symbol 5: hamextfingeru after the first action"),
        (
            "finger2 thumb fingertip touch middlefinger extfingeru palml moveu",
            "symbol 3: hamfingertip within a handshape",
        ),
        ("finger2 extfingeru palml parbegin extfingero moveu parend", "symbol 5: hamextfingero after the first action"),
        ("flathand extfingero palmd lrat moveu", "symbol 4: hamlrat without a place"),
        ("symmlr flathand extfingeru palml lrat lips", "symbol 6: hamlrat before hamlips is read as after it"),
        ("nomotion flathand extfingero palmd moveu", "symbol 1: hamnomotion before the posture is left out"),
        ("flathand extfingero palmd replace moveu", "symbol 4: hamreplace before a movement is left out"),
    ],
)
def test_a_defect_of_a_notation_is_mended_with_a_note(names: str, note: str) -> None:
    (found,) = read(names).notes
    assert note in found


def test_a_tag_that_is_written_for_another_is_mended_with_a_note() -> None:
    tags = "<hampinchopen/><hamextfingeru/><hampalml/><hammoveu/>"
    sign = files.parse(
        f'<sigml><hns_sign gloss="A"><hamnosys_manual>{tags}</hamnosys_manual></hns_sign></sigml>'.encode(), "a"
    ).signs["A"]
    assert sign.posture.shape == WrittenShape("pinch12open")
    assert sign.notes == ("line 1: hampinchopen is read as hampinch12open",)


@pytest.mark.parametrize(
    ("names", "where"),
    [
        ("finger2 extfingeru palml moveu mime", "X: symbol 5 hammime: stands for a mimed action"),
        ("finger2 extfingeru palml moveu wavy clocku", "X: symbol 6 hamclocku: does not go with"),
        ("finger2 extfingeru palml smallmod", "X: symbol 4 hamsmallmod: modifies no action"),
        ("finger2 fist extfingeru palml moveu", "X: symbol 2 hamfist: is a second handshape"),
        ("moveu", "X: symbol 1: has no handshape"),
        ("symmlr symmpar finger2 moveu", "two kinds of symmetry"),
    ],
)
def test_what_is_not_understood_is_refused_with_gloss_symbol_and_number(names: str, where: str) -> None:
    with pytest.raises(ss.InputError, match="X: ") as caught:
        read(names)
    assert where in str(caught.value)


def test_a_character_that_is_no_symbol_is_refused_or_left_out_on_request() -> None:
    text = code("finger2 extfingeru palml") + "é" + code("moveu")
    with pytest.raises(ss.InputError, match="symbol 4 é: is no symbol of HamNoSys 4"):
        files.one(text)
    sign = files.one(text, lenient=True)
    assert sign.notes == ("symbol 4: é is left out: is no symbol of HamNoSys 4",)
    assert bare(sign) == bare(read("finger2 extfingeru palml moveu"))


def test_marks_are_left_out_with_a_note() -> None:
    sign = files.one(code("finger2 extfingeru palml") + "?" + code("moveu"))
    assert sign.notes == ("symbol 4: ? is left out",)
    assert bare(sign) == bare(read("finger2 extfingeru palml moveu"))


def test_gestural_errors_name_file_line_gloss_and_element() -> None:
    with pytest.raises(
        ss.InputError, match=r"x\.sigml:3: X: <handconfig>: handshape='claw', expected one of fist flat"
    ):
        gestural('<handconfig handshape="claw"/>')
    with pytest.raises(ss.InputError, match=r"x\.sigml:4: X: <directedmotion>: attribute colour is not known"):
        gestural('<handconfig handshape="flat"/>\n<directedmotion direction="u" colour="red"/>')


@pytest.mark.parametrize(
    ("manual", "note"),
    [
        ('<handconfig handshape="flat" mainbend="0.50.50.5"/>', "read as three numbers, 222 quarters"),
        ('<handconfig handshape="flat"/><directedmotion direction="u" second_direction="oi"/>', "o and i cancel"),
        ('<handconfig handshape="flat" rel_palmor="true"/>', "rel_palmor of <handconfig> is left out"),
        ('<handconfig handshape="flat"/><nomotion/><handconfig extfidir="u"/>', "after the first motion is left out"),
        ('<handconfig handshape="flat"/><split_motion><nomotion/><no_motion/></split_motion>', "read as <nomotion>"),
    ],
)
def test_a_defect_of_gestural_sigml_is_mended_with_a_note(manual: str, note: str) -> None:
    (found,) = gestural(manual).notes
    assert note in found


def test_a_manner_is_an_attribute_of_its_name_or_a_value_of_manner() -> None:
    shape = '<handconfig handshape="flat"/>'
    (named,) = gestural(f'{shape}<directedmotion direction="u" manner="fast"/>').motions
    (flag,) = gestural(f'{shape}<directedmotion direction="u" fast="true"/>').motions
    assert named.manner == flag.manner
    assert named.manner.fast


def test_elements_beside_signs_are_named_and_older_ones_are_read(tmp_path: Path) -> None:
    file = tmp_path / "old.sigml"
    manual = '<sign_manual><handconfig handshape="flat" extfidir="u" palmor="l"/></sign_manual>'
    file.write_text(f"<sigml><sigmlsign>{manual}</sigmlsign><frame/></sigml>", encoding="utf-8")
    read = files.read(file)
    assert list(read.signs) == ["old"]
    assert [str(error).partition(":")[2] for error in read.refused] == [
        "1: <frame> is no sign that is read, and is left out"
    ]


def test_sides_of_fingers_follow_the_hand_that_they_are_on() -> None:
    sites = (
        '<location_hand location="midjoint" digits="2" side="left_beside"/>'
        '<location_hand location="midjoint" digits="2" side="left_beside"/>'
    )
    pair = gestural(f'<handconstellation contact="touch">{sites}</handconstellation>').posture.pair
    assert pair is not None
    assert pair.weak is not None
    assert pair.strong is not None
    assert (pair.weak.side, pair.strong.side) == ("ulnar", "radial")
    pair = gestural(f"<handconstellation>{sites}</handconstellation>", 'both_hands="true" lr_symm="true"').posture.pair
    assert pair is not None
    assert pair.weak is not None
    assert pair.weak.side == "ulnar"


def test_compounds_are_parts_in_order_and_the_weak_hand_may_hold_over() -> None:
    part = '<sign_manual {}><handconfig handshape="{}"/></sign_manual>'
    sign = gestural(part.format('both_hands="true"', "flat") + part.format('holdover="true"', "fist"))
    assert [p.hands for p in sign.parts] == ["parallel", "one"]
    assert [p.holdover for p in sign.parts] == [False, True]
    assert sign.motions == ()
    assert sign.posture == WrittenPosture()


def test_whole_postures_joined_by_plus_are_a_compound() -> None:
    spelled = read(
        "fist extfingeru palmd shoulders plus finger23 extfingerdo palmd shoulders plus symmlr fist extfingero"
    )
    assert [part.posture.shape.base for part in spelled.parts if part.posture.shape] == ["fist", "finger23", "fist"]
    assert [part.hands for part in spelled.parts] == ["one", "one", "mirrored"]
    assert read("parbegin fist extfingeru plus flathand extfingero parend palmd chest").parts == ()


def test_faces_keep_their_lanes_and_what_runs_together() -> None:
    face = (
        '<facialexpr_tier><eye_brows movement="RB"/><facial_expr_par><eye_lids movement="SB" amount="0.5"/>'
        '<eye_gaze movement="DN"/></facial_expr_par></facialexpr_tier>'
        '<head_tier><head_movement movement="NO"/></head_tier>'
    )
    sign = gestural('<handconfig handshape="flat"/>', nonmanual=face)
    assert [(t.tier, t.code, t.start, t.amount, t.lane) for t in sign.tiers] == [
        ("eye_brows", "RB", 0, 1.0, "facialexpr"),
        ("eye_lids", "SB", 1, 0.5, "facialexpr"),
        ("eye_gaze", "DN", 1, 1.0, "facialexpr"),
        ("head", "NO", 0, 1.0, "head"),
    ]
    assert sign.notes == ("line 1: <eye_gaze> movement is read as direction",)


def test_tables_lists_and_json_hold_the_same_signs(tmp_path: Path) -> None:
    signs = {"KING": code(HAM["KING"]), "CAR": code(HAM["CAR"])}
    (tmp_path / "a.csv").write_text("gloss,hamnosys\n" + "".join(f"{g},{n}\n" for g, n in signs.items()))
    (tmp_path / "b.txt").write_text("".join(f"{g}\t{n}\n" for g, n in signs.items()))
    (tmp_path / "c.json").write_text(json.dumps(signs))
    (tmp_path / "d.json").write_text(json.dumps([{"gloss": g, "hamnosys": n} for g, n in signs.items()]))
    for name in ("a.csv", "b.txt", "c.json", "d.json"):
        found = files.read(tmp_path / name)
        assert {g: bare(s) for g, s in found.signs.items()} == {g: bare(read(HAM[g])) for g in signs}
    found = files.read([tmp_path / name for name in ("a.csv", "b.txt", "c.json", "d.json")])
    assert list(found.signs)[:4] == ["KING", "CAR", "KING#2", "CAR#2"]
    assert len(found.signs) == 8
    assert [s.gloss for s in found.signs.values()] == list(found.signs)


def test_a_refused_sign_does_not_lose_the_others(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(f"gloss,hamnosys\nA,{code(HAM['KING'])}\nB,{code('moveu')}\nC,{code(HAM['CAR'])}\n")
    (tmp_path / "b.sigml").write_text("<sigml>")
    found = files.read([tmp_path / "a.csv", tmp_path])
    assert list(found.signs) == ["A", "C"]
    assert [str(error).removeprefix(f"{tmp_path}/")[:12] for error in found.refused] == ["a.csv: B: sy", "b.sigml:1: i"]


@pytest.mark.parametrize(
    "head",
    [
        '<!DOCTYPE a [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;&a;">]>',
        '<!DOCTYPE a [<!ENTITY % p SYSTEM "file:///etc/passwd">%p;]>',
        '<!DOCTYPE a [<!ENTITY x SYSTEM "file:///etc/passwd">]>',
    ],
)
def test_entities_are_refused_where_they_are_declared(head: str) -> None:
    with pytest.raises(ss.InputError, match="declares an entity"):
        files.parse(f"{head}<sigml/>".encode(), "x.sigml")


def test_a_doctype_that_names_a_file_reads_none() -> None:
    text = TEN.read_text().replace("<sigml>", '<!DOCTYPE sigml SYSTEM "file:///nowhere/sigml.dtd"><sigml>')
    assert len(files.parse(text.encode(), "x.sigml").signs) == 10


@pytest.mark.parametrize("bracket", ["seq", "par", "fusion"])
@pytest.mark.parametrize(
    "slots", ["fist", "extfingero palmd", "chest touch", "between", "", "plus", "fist plus flathand"]
)
def test_brackets_of_slots_after_an_action_end(bracket: str, slots: str) -> None:
    for lenient in (True, False):
        try:
            read(f"{POINT} moveu {bracket}begin {slots} {bracket}end moved", lenient)
        except ss.InputError:
            assert not lenient


def test_deep_elements_brackets_and_long_signs_are_refused() -> None:
    with pytest.raises(ss.InputError, match="40 levels"):
        files.parse(b"<sigml>" + b"<a>" * 100_000, "x.sigml")
    with pytest.raises(ss.InputError, match="12 brackets"):
        read(POINT + "parbegin " * 500 + "moveu")
    with pytest.raises(ss.InputError, match="at most 1,000"):
        read(POINT + "moveu " * 5000)


@pytest.mark.skipif(not NGT.is_dir(), reason="real signs are not present")
def test_all_signs_of_ngt_become_trees() -> None:
    found = files.read(NGT)
    assert not found.refused
    assert len(found.signs) == 2203
    assert sum("#" in gloss for gloss in found.signs) == 2203 - 2025
    assert sum(len(sign.parts) > 0 for sign in found.signs.values()) == 221


def test_a_sign_that_is_at_the_other_arm_all_along_is_signed() -> None:
    sign = notation.everyday()["HOSPITAL"]
    assert all(segment.strong.location == "upper-arm-weak" for segment in sign.segments)
    assert len(planner.synthesize_word(replace(sign, kind="written"))) > 30
