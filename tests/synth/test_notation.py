"""The notation of signs: what texts mean, and one-line errors with file and line for what is wrong in them."""

from __future__ import annotations

from math import sqrt
from pathlib import Path
from textwrap import dedent

import pytest

from signsplice.errors import FormatError, InputError
from signsplice.signer import notation, phonology
from signsplice.signer.handshapes import HANDSHAPES
from signsplice.signer.phonology import DIRECTIONS, HANDS, HEAD, LOCALS, LOCATIONS, PARTS, PLANES, TRUNK, Sign, faults

START = "shape=5 at=space palm=in fingers=up"
BASE = f"{START} w.shape=B-open w.at=space-mid w.palm=up w.fingers=fwd"


def one(*lines: str, hands: str = "one") -> Sign:
    text = f"WORD hands={hands}\n" + "".join(f"  {line}\n" for line in lines)
    return notation.parse(text)["WORD"]


# --- what it means


def test_the_example_of_the_docstring_parses() -> None:
    assert notation.__doc__ is not None
    block = dedent(notation.__doc__.partition("\n")[2])
    mother = notation.parse(block)["MOTHER"]
    assert mother.synonyms == ("MOM",)
    assert [segment.kind for segment in mother.segments] == ["X", "M", "H"]
    assert [segment.strong.off for segment in mother.segments] == [3.0, 0.0, 0.0]
    assert mother.segments[1].times == 2
    assert not mother.two_handed


def test_values_carry_over_and_a_new_location_resets_off_and_shift() -> None:
    a, b, c, d = one(
        "X shape=5 at=chin by=thumb off=3 shift=1,-2,0.5 palm=in fingers=up", "M off=1", "M at=chest", "M shape=S"
    ).segments
    assert (b.strong.off, b.strong.shift, b.strong.part) == (1.0, (1.0, -2.0, 0.5), "thumb")
    assert (c.strong.location, c.strong.off, c.strong.shift, c.strong.part) == ("chest", 0.0, (0.0, 0.0, 0.0), "thumb")
    assert (d.strong.shape, d.strong.location, d.strong.palm) == ("S", "chest", a.strong.palm)


def test_directions_are_unit_and_weighted() -> None:
    (segment,) = one("H shape=5 at=space palm=back fingers=up-up-in").segments
    assert segment.strong.fingers == pytest.approx((-1 / sqrt(5), 2 / sqrt(5), 0.0))
    assert segment.strong.palm == DIRECTIONS["back"]


def test_comments_blank_lines_and_a_byte_order_mark_are_ignored(tmp_path: Path) -> None:
    path = tmp_path / "some.signs"
    path.write_bytes(
        "\ufeff# a file\n\nA-B  hands=one kind=pseudo # why\n  source: by ear (own)  # note\n\n  H shape=5 at=space "
        "palm=in fingers=up#not a comment\n".replace("up#not a comment", "up # held").encode()
    )
    signs = notation.read(path)
    assert list(signs) == ["A-B"]
    assert (signs["A-B"].kind, signs["A-B"].source) == ("pseudo", "by ear (own)")


def test_every_location_part_and_handshape_is_read() -> None:
    base = " w.shape=B-open w.at=space-mid w.palm=up w.fingers=fwd"
    for location in LOCATIONS:
        hands = "base" if location in phonology.ON_BASE else "one"
        (segment,) = one(
            f"H shape=5 at={location} palm=in fingers=up{base if hands == 'base' else ''}", hands=hands
        ).segments
        assert segment.strong.location == location
        assert (segment.weak is None) == (hands == "one")
    for part in PARTS:
        assert one(f"H {START} by={part}").segments[0].strong.part == part
    for shape in HANDSHAPES:
        assert one(f"H shape={shape} at=space palm=in fingers=up").segments[0].strong.shape == shape


@pytest.mark.parametrize("hands", HANDS)
def test_every_kind_of_hands(hands: str) -> None:
    sign = one(f"X {BASE if hands == 'base' else START}", "M shape=S", hands=hands)
    assert (sign.hands, sign.two_handed) == (hands, hands != "one")
    assert (sign.segments[1].weak is not None) == (hands == "base")


@pytest.mark.parametrize(
    ("text", "kind", "size", "revolutions"),
    [
        ("straight", "straight", 0.0, 0.0),
        ("none", "none", 0.0, 0.0),
        ("arc:up:3", "arc", 3.0, 0.0),
        ("arc:up-fwd:4.5", "arc", 4.5, 0.0),
        *((f"circle:{plane}:4:-2", "circle", 4.0, -2.0) for plane in PLANES),
        ("zigzag:out:3:2", "zigzag", 3.0, 2.0),
    ],
)
def test_every_path(text: str, kind: str, size: float, revolutions: float) -> None:
    path = one(f"X {START}", f"M shape=S path={text}").segments[1].path
    assert (path.kind, path.size, path.revolutions) == (kind, size, revolutions)


@pytest.mark.parametrize("kind", LOCALS)
def test_every_local_movement(kind: str) -> None:
    for text, amplitude, cycles in (
        (kind, *LOCALS[kind]),
        (f"{kind}:5", 5.0, LOCALS[kind][1]),
        (f"{kind}:5:4", 5.0, 4.0),
    ):
        local = one(f"X {START}", f"M local={text}").segments[1].local
        assert local == phonology.Local(kind, amplitude, cycles)


def test_head_trunk_and_seconds() -> None:
    for head in HEAD:
        assert one(f"H {START} head={head}").segments[0].head == head
    for trunk in TRUNK:
        assert one(f"H {START} trunk={trunk}").segments[0].trunk == trunk
    assert one(f"H {START} for=0.25").segments[0].seconds == 0.25


def test_repetition() -> None:
    for text, lift in (("return=lifted", 3.0), ("return=lifted:5.5", 5.5), ("return=same", 0.0)):
        segment = one(f"X {START}", f"M shift=0,-4,0 times=3 {text} step=4,0,-1 tempo=1.5").segments[1]
        assert (segment.times, segment.lift, segment.step, segment.tempo) == (3, lift, (4.0, 0.0, -1.0), 1.5)


def test_a_base_hand_has_a_path_of_its_own() -> None:
    segment = one(f"X {BASE}", "M path=arc:up:3 w.shift=0,4,0 w.path=circle:sagittal:4:-2", hands="base").segments[1]
    assert segment.path == phonology.Path("arc", (0.0, 1.0, 0.0), size=3.0)
    assert segment.weak_path == phonology.Path("circle", plane="sagittal", size=4.0, revolutions=-2.0)
    alone = one(f"X {BASE}", "M w.path=circle:sagittal:4:1", hands="base")
    assert faults(alone) == []


def test_a_base_may_move_with_the_strong_hand() -> None:
    first, second = one(
        "H shape=A at=base-palm by=ulnar palm=in fingers=fwd w.shape=B w.at=space-mid w.palm=up w.fingers=fwd",
        "M w.shift=0,6,0",
        hands="base",
    ).segments
    assert first.strong == second.strong
    assert second.weak is not None
    assert second.weak.shift == (0.0, 0.0, 0.0), "two hands are 6 cm lower there"


# --- errors

BROKEN = [
    # header
    ("WORD\n  H {start}\n", 1, "'WORD', expected GLOSS hands="),
    ("WORD hands=one kind=sign more\n  H {start}\n", 1, "expected GLOSS hands="),
    ("WORD hands=both\n  H {start}\n", 1, "unknown hands 'both'; expected one of one, symmetric, alternating, base"),
    ("WORD hands=symetric\n  H {start}\n", 1, "unknown hands 'symetric'; did you mean symmetric?"),
    ("WORD hands=one kind=word\n  H {start}\n", 1, "unknown kind 'word'"),
    ("  H {start}\n", 1, "belongs to no sign, expected GLOSS hands=... at the margin first"),
    ("WORD hands=one\n", 1, "WORD: has no segment, expected at least one H or X line"),
    ("A hands=one\n  H {start}\n\nA hands=one\n  H {start}\n", 4, "A is written twice, expected one block a gloss"),
    # segments and keys
    ("WORD hands=one\n  Q {start}\n", 2, "'Q', expected a segment H, X or M, or source: synonyms: or gesture:"),
    ("WORD hands=one\n  sauce: me\n  H {start}\n", 2, "'sauce:', expected a segment H, X or M, or source:"),
    ("WORD hands=one\n  H {start} off\n", 2, "'off', expected key=value"),
    ("WORD hands=one\n  H {start} off=\n", 2, "'off=', expected key=value"),
    ("WORD hands=one\n  H {start} finger=up\n", 2, "unknown key 'finger'; did you mean fingers"),
    ("WORD hands=one\n  H {start} at=chin\n", 2, "at is given twice"),
    ("WORD hands=one\n  H {start} times=2\n", 2, "times= belongs to M, not to H"),
    ("WORD hands=one\n  X {start} path=none\n", 2, "path= belongs to M, not to X"),
    ("WORD hands=one\n  X {start} local=twist\n", 2, "local= belongs to M, not to X"),
    ("WORD hands=one\n  H {start} w.palm=up\n", 2, "w.palm= needs hands=base, not hands=one"),
    ("WORD hands=base\n  H {start}\n", 2, "first segment lacks w.shape="),
    ("WORD hands=one\n  H shape=5 at=chin palm=in\n", 2, "first segment lacks fingers="),
    # values
    ("WORD hands=one\n  H shape=B-opn at=chin palm=in fingers=up\n", 2, "unknown shape 'B-opn'; did you mean B-open"),
    ("WORD hands=one\n  H shape=5 at=chinn palm=in fingers=up\n", 2, "unknown at 'chinn'; did you mean chin"),
    ("WORD hands=one\n  H {start} by=thump\n", 2, "unknown by 'thump'; did you mean thumb"),
    ("WORD hands=base\n  H {base} w.by=palms\n", 2, "unknown w.by 'palms'; did you mean palm"),
    ("WORD hands=one\n  H shape=5 at=chin palm=left fingers=up\n", 2, "unknown direction 'left'"),
    ("WORD hands=one\n  H shape=5 at=chin palm=in fingers=up-down\n", 2, "direction 'up-down' points nowhere"),
    ("WORD hands=one\n  H shape=5 at=chin palm=in fingers=up-\n", 2, "unknown direction ''"),
    ("WORD hands=one\n  H {start} off=near\n", 2, "off=near, expected a number from -5 to 60"),
    ("WORD hands=one\n  H {start} off=nan\n", 2, "off=nan, expected a number from -5 to 60"),
    ("WORD hands=one\n  H {start} off=inf\n", 2, "off=inf, expected a number from -5 to 60"),
    ("WORD hands=base\n  H {base} w.off=99\n", 2, "w.off=99, expected a number from -5 to 60"),
    ("WORD hands=one\n  H {start} shift=1,2\n", 2, "shift=1,2, expected three numbers in cm: out,up,fwd"),
    ("WORD hands=one\n  H {start} shift=1,2,x\n", 2, "shift=x, expected a number from -60 to 60"),
    ("WORD hands=base\n  H {base} w.shift=1\n", 2, "w.shift=1, expected three numbers"),
    ("WORD hands=one\n  H {start} for=9\n", 2, "for=9, expected a number from 0 to 5"),
    ("WORD hands=one\n  H {start} head=yes\n", 2, "unknown head 'yes'"),
    ("WORD hands=one\n  H {start} trunk=left\n", 2, "unknown trunk 'left'"),
    ("WORD hands=one\n  X {start}\n  M off=1 times=0\n", 3, "times=0, expected a whole number from 1 to 8"),
    ("WORD hands=one\n  X {start}\n  M off=1 times=1.5\n", 3, "times=1.5, expected a whole number from 1 to 8"),
    ("WORD hands=one\n  X {start}\n  M path=spiral\n", 3, "unknown path 'spiral'"),
    ("WORD hands=one\n  X {start}\n  M path=arc:up\n", 3, "path=arc:up, expected path=arc:DIRECTION:CM"),
    ("WORD hands=one\n  X {start}\n  M path=arc:up:0\n", 3, "path=0, expected a number from 0.5 to 40"),
    ("WORD hands=one\n  X {start}\n  M path=straight:2\n", 3, "path=straight:2, expected path=straight"),
    ("WORD hands=one\n  X {start}\n  M path=circle:frontal:4\n", 3, "expected path=circle:PLANE:CM:TURNS"),
    ("WORD hands=one\n  X {start}\n  M path=circle:flat:4:1\n", 3, "unknown plane 'flat'"),
    ("WORD hands=one\n  X {start}\n  M path=circle:frontal:4:0\n", 3, "expected a quarter of a turn or more"),
    ("WORD hands=one\n  X {start}\n  M path=zigzag:out:3:0\n", 3, "path=0, expected a number from 0.5 to 8"),
    ("WORD hands=one\n  X {start}\n  M local=shake\n", 3, "unknown local 'shake'"),
    ("WORD hands=one\n  X {start}\n  M local=twist:1:2:3\n", 3, "expected local=twist[:AMPLITUDE[:CYCLES]]"),
    ("WORD hands=one\n  X {start}\n  M local=twist:-3\n", 3, "local=-3, expected a number from 0.1 to 120"),
    (
        "WORD hands=one\n  X {start}\n  M off=1 times=2 return=high\n",
        3,
        "unknown return 'high'; expected one of lifted",
    ),
    ("WORD hands=one\n  X {start}\n  M off=1 times=2 return=lifted:0\n", 3, "return=0, expected a number from 1 to 15"),
    ("WORD hands=one\n  X {start}\n  M off=1 times=2 return=same:2\n", 3, "expected return=same or return=lifted[:CM]"),
    ("WORD hands=one\n  X {start} return=lifted\n", 2, "return= belongs to M, not to X"),
    ("WORD hands=one\n  X {start}\n  M off=1 times=2 step=4\n", 3, "step=4, expected three numbers in cm"),
    ("WORD hands=one\n  X {start}\n  M off=1 tempo=0\n", 3, "tempo=0, expected a number from 0.25 to 3"),
    ("WORD hands=one\n  X {start}\n  M off=1 tempo=2 for=1\n", 3, "tempo= and for= both say how long it takes"),
    ("WORD hands=one\n  X {start}\n  M shape=S w.path=arc:up:3\n", 3, "w.path= needs hands=base, not hands=one"),
    ("WORD hands=base\n  X {base}\n  M shape=S w.path=arc:up\n", 3, "w.path=arc:up, expected w.path=arc:DIRECTION:CM"),
    ("WORD hands=base\n  X {base}\n  M shape=S w.path=loop\n", 3, "unknown w.path 'loop'"),
    ("WORD hands=one\n  H shape=5 at=locus:4 palm=in fingers=up\n", 2, "unknown at 'locus:4'; did you mean locus:"),
    # faults of a sign
    ("WORD hands=one\n  X {start}\n  M shape=S return=lifted\n", 1, "segment 2: return=lifted needs times=2 or more"),
    ("WORD hands=one\n  X {start}\n  M shape=S step=4,0,0\n", 1, "segment 2: step= needs times=2 or more"),
    (
        "WORD hands=one\n  X {start}\n  M path=circle:frontal:3:1 times=2 return=lifted\n",
        1,
        "return=lifted needs a movement to another posture",
    ),
    ("WORD hands=alternating\n  X {start}\n  M shift=0,4,0 times=2 return=lifted\n", 1, "not hands=alternating"),
    (
        "WORD hands=one\n  X shape=5 at=chin off=3 palm=in fingers=up\n  M off=0 times=2 step=4,0,0\n",
        1,
        "segment 2: step= would leave at=chin, expected places in space or at the base hand",
    ),
    (
        "WORD hands=one\n  X {start}\n  M shift=0,4,0 times=2 step=4,0,0\n  M shape=S\n",
        1,
        "segment 2: step= belongs to the sign's last movement",
    ),
    (
        "WORD hands=symmetric\n  H shape=5 at=object palm=in fingers=up\n",
        1,
        "at=object needs hands=one or hands=base; mirrored hands have no common locus",
    ),
    ("WORD hands=one\n  M {start}\n", 1, "WORD: begins with M, expected H or X first"),
    ("WORD hands=one\n  X {start}\n  M\n", 1, "segment 2: M moves nothing, expected another posture, a path or"),
    ("WORD hands=one\n  X {start}\n  M path=arc:up:3\n", 1, "segment 2: M moves nothing"),
    ("WORD hands=one\n  H {start}\n  H off=3\n", 1, "segment 2: H changes the posture, expected M to move there first"),
    ("WORD hands=one\n  H {start}\n  H\n", 1, "has holds only, expected an M between two"),
    ("WORD hands=one\n  X {start}\n", 1, "has X alone, expected M or H after it"),
    (
        "WORD hands=one\n  H shape=5 at=base-palm palm=in fingers=up\n",
        1,
        "at=base-palm needs hands=base, not hands=one",
    ),
    (
        "WORD hands=one\n  H shape=5 at=chin palm=up fingers=up\n",
        1,
        "palm and fingers must be at least 25 degrees from parallel",
    ),
    (
        "WORD hands=one\n  H shape=5 at=chin palm=down fingers=up\n",
        1,
        "palm and fingers must be at least 25 degrees from parallel",
    ),
]


@pytest.mark.parametrize(("text", "line", "message"), BROKEN, ids=[row[2] for row in BROKEN])
def test_a_broken_text_gives_one_line_that_names_the_line(text: str, line: int, message: str, tmp_path: Path) -> None:
    path = tmp_path / "broken.signs"
    path.write_text(text.format(start=START, base=BASE))
    with pytest.raises(FormatError) as caught:
        notation.read(path)
    found = str(caught.value)
    assert found.startswith(f"{path}:{line}: "), found
    assert message in found
    assert "\n" not in found


@pytest.mark.parametrize("text", ["{} hands=one", "A hands={}", "A hands=one\n  {}", "A hands=one\n  H at={}", "  {}"])
def test_long_words_are_cut_in_messages(text: str) -> None:
    with pytest.raises(FormatError) as caught:
        notation.parse(text.format("a" * 70_000))
    assert len(str(caught.value)) < 700


def test_line_numbers_count_comments_and_blank_lines() -> None:
    text = f"# one\n\nA hands=one\n  H {START}\n\n# six\nB hands=one\n  H {START} at2=x\n"
    with pytest.raises(FormatError, match=r"^words\.signs:8: B: unknown key 'at2'"):
        notation.parse(text, "words.signs")


def test_an_error_names_a_file_that_is_no_text(tmp_path: Path) -> None:
    path = tmp_path / "latin.signs"
    path.write_bytes("CAFÉ hands=one\n".encode("latin-1"))
    with pytest.raises(FormatError, match="is no UTF-8 text") as caught:
        notation.read(path)
    assert str(caught.value).startswith(str(path))
    with pytest.raises(InputError, match="no such file"):
        notation.read(tmp_path / "none.signs")


def test_an_empty_text_has_no_signs() -> None:
    assert notation.parse("") == {}
    assert notation.parse("# nothing yet\n") == {}


def test_faults_of_signs_built_in_code() -> None:
    posture = one(f"H {START}").segments[0].strong
    strange = phonology.Posture("no-shape", posture.location, posture.part, posture.palm, posture.fingers)
    sign = Sign("WORD", "one", (phonology.Segment("H", strange),))
    assert faults(sign) == ["segment 1: unknown handshape 'no-shape'"]
    assert faults(Sign("WORD", "one", ())) == ["has no segment, expected at least one H or X line"]
