"""The words that ship: all there, each with its source, and various enough to be worth splicing."""

from __future__ import annotations

import re
import string
from collections import Counter

import pytest

from signsplice.synth import notation
from signsplice.synth.handshapes import HANDSHAPES
from signsplice.synth.phonology import IN_SPACE, LOCATIONS, Posture, Sign

EVERYDAY = notation.everyday()
ALPHABET = notation.alphabet()
CITATION = re.compile(
    r"\((Stokoe, Casterline and Croneberg 1965|Sternberg 1998|Costello 1998|Tennant and Brown 1998|Valli 2005"
    r"|ASL-LEX 2\.0|Lifeprint|Handspeak)\)$"
)
MUST = "HELLO I DEAF SIGN THANK-YOU NAME MY YOU SEE TOMORROW"


def postures(sign: Sign) -> list[Posture]:
    return [p for segment in sign.segments for p in (segment.strong, segment.weak) if p is not None]


def test_the_alphabet_and_the_digits_are_whole() -> None:
    assert list(ALPHABET) == [f"fs-{c}" for c in string.ascii_uppercase + string.digits]
    for sign in ALPHABET.values():
        assert sign.kind == "letter"
        assert sign.hands == "one"
        shape = HANDSHAPES[sign.segments[0].strong.shape]
        named = HANDSHAPES[sign.gloss.removeprefix("fs-")]
        assert (shape.angles == named.angles).all(), sign.gloss
        assert (len(sign.segments) == 1) == (sign.gloss not in ("fs-J", "fs-Z")), "J and Z alone are drawn"
        assert sign.segments[-1].kind == "H"


def test_a_first_sentence_can_be_said() -> None:
    assert set(MUST.split()) <= set(EVERYDAY)
    assert len(EVERYDAY) >= 110
    assert all(sign.kind == "sign" for sign in EVERYDAY.values())


@pytest.mark.parametrize("sign", [*EVERYDAY.values(), *ALPHABET.values()], ids=lambda sign: str(sign.gloss))
def test_every_word_says_where_it_is_described(sign: Sign) -> None:
    assert CITATION.search(sign.source), sign.source
    assert len(sign.source.split()) >= 7, "a statement of how the sign is made"
    assert re.fullmatch(r"[A-Z]+(-[A-Z]+)*|fs-[A-Z0-9]", sign.gloss)


@pytest.mark.parametrize("sign", [*EVERYDAY.values(), *ALPHABET.values()], ids=lambda sign: str(sign.gloss))
def test_every_shape_and_place_is_known(sign: Sign) -> None:
    for posture in postures(sign):
        assert posture.shape in HANDSHAPES
        assert posture.place in LOCATIONS


def test_no_name_stands_for_two_words() -> None:
    names = Counter(name for sign in EVERYDAY.values() for name in (sign.gloss, *sign.synonyms))
    assert [name for name, count in names.items() if count > 1] == []


def test_no_two_words_are_made_alike() -> None:
    made = Counter(sign.segments for sign in EVERYDAY.values())
    assert max(made.values()) == 1


def test_hands_work_together_in_all_four_ways() -> None:
    share = {hands: n / len(EVERYDAY) for hands, n in Counter(sign.hands for sign in EVERYDAY.values()).items()}
    assert 0.55 < share["one"] < 0.70
    assert 0.08 < share["symmetric"] < 0.18
    assert 0.05 < share["alternating"] < 0.12
    assert 0.12 < share["base"] < 0.24


def test_words_begin_and_end_in_every_way() -> None:
    n = len(EVERYDAY)
    ends = Counter(sign.segments[-1].kind for sign in EVERYDAY.values())
    starts = Counter(sign.segments[0].kind for sign in EVERYDAY.values())
    assert 0.45 < ends["H"] / n < 0.65
    assert ends["M"] / n > 0.3
    assert min(starts["H"], starts["X"]) / n > 0.15

    def touches(posture: Posture) -> bool:
        return posture.place not in IN_SPACE and posture.off < 1.0

    contact = Counter((touches(s.segments[0].strong), touches(s.segments[-1].strong)) for s in EVERYDAY.values())
    assert min(contact.values()) >= 10, contact
    assert len(contact) == 4


def test_movements_are_of_every_kind() -> None:
    moves = [segment for sign in EVERYDAY.values() for segment in sign.segments if segment.kind == "M"]
    assert sum(move.times > 1 for move in moves) >= 30
    paths = Counter(move.path.kind for move in moves)
    assert min(paths[kind] for kind in ("straight", "arc", "circle", "zigzag")) >= 5
    locals_ = Counter(move.local.kind for move in moves if move.local is not None)
    assert set(locals_) == {"wiggle", "bend", "twist", "nod", "tremble"}
    changing = [s for s in EVERYDAY.values() if len({segment.strong.shape for segment in s.segments}) > 1]
    moving = [s for s in EVERYDAY.values() if len({segment.strong.place for segment in s.segments}) > 1]
    assert len(changing) >= 25
    assert len(moving) >= 25
    assert any(segment.head for sign in EVERYDAY.values() for segment in sign.segments)
    assert any(segment.trunk for sign in EVERYDAY.values() for segment in sign.segments)


def test_places_and_handshapes_are_many() -> None:
    all_postures = [p for sign in (*EVERYDAY.values(), *ALPHABET.values()) for p in postures(sign)]
    assert len({p.place for sign in EVERYDAY.values() for p in postures(sign)}) >= 25
    assert len({p.shape for sign in EVERYDAY.values() for p in postures(sign)}) >= 30
    assert len({p.shape for p in all_postures}) >= 50
