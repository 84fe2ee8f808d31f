"""The package's words are complete, name their sources, and vary enough to be worth splicing."""

from __future__ import annotations

import re
import string
from collections import Counter

from signsplice.signer import notation
from signsplice.signer.handshapes import HANDSHAPES
from signsplice.signer.phonology import IN_SPACE, LOCATIONS, Posture, Sign

EVERYDAY = notation.everyday()
ALPHABET = notation.alphabet()
EVERY = (*EVERYDAY.values(), *ALPHABET.values())
CITATION = re.compile(
    r"\((Stokoe, Casterline and Croneberg 1965|Sternberg 1998|Costello 1998|Tennant and Brown 1998|Valli 2005"
    r"|ASL-LEX 2\.0|Lifeprint|Handspeak|Long 1918|PocketSign|Wiktionary|Wikipedia|Schneider 2001"
    r"|Costello 1998; pointing: Long 1918)\)$"
)
FIRST_SENTENCE = "HELLO I DEAF SIGN THANK-YOU NAME MY YOU SEE TOMORROW"


def postures(sign: Sign) -> list[Posture]:
    return [p for segment in sign.segments for p in (segment.strong, segment.weak) if p is not None]


def test_the_alphabet_and_the_digits_are_complete() -> None:
    assert list(ALPHABET) == [f"fs-{c}" for c in string.ascii_uppercase + string.digits]
    for sign in ALPHABET.values():
        assert sign.kind == "letter"
        assert sign.hands == "one"
        shape = HANDSHAPES[sign.segments[0].strong.shape]
        named = HANDSHAPES[sign.gloss.removeprefix("fs-")]
        assert (shape.angles == named.angles).all(), sign.gloss
        assert (len(sign.segments) == 1) == (sign.gloss not in ("fs-J", "fs-Z")), "J and Z alone are drawn"
        assert sign.segments[-1].kind == "H"


def test_a_first_sentence_can_be_signed() -> None:
    assert set(FIRST_SENTENCE.split()) <= set(EVERYDAY)
    assert len(EVERYDAY) >= 110
    assert all(sign.kind == "sign" for sign in EVERYDAY.values())


def test_every_word_has_a_description_and_its_source() -> None:
    wrong = [
        (sign.gloss, sign.source)
        for sign in EVERY
        if not CITATION.search(sign.source)
        or len(sign.source.split()) < 7  # a statement of how the sign is made
        or not re.fullmatch(r"[A-Z]+(-[A-Z]+)*|fs-[A-Z0-9]", sign.gloss)
    ]
    assert wrong == []


def test_every_handshape_and_location_is_known() -> None:
    unknown = [
        (sign.gloss, posture.shape, posture.location)
        for sign in EVERY
        for posture in postures(sign)
        if posture.shape not in HANDSHAPES or posture.location not in LOCATIONS
    ]
    assert unknown == []


def test_no_name_stands_for_two_words() -> None:
    names = Counter(name for sign in EVERYDAY.values() for name in (sign.gloss, *sign.synonyms))
    assert [name for name, count in names.items() if count > 1] == []


def test_no_two_words_are_made_alike() -> None:
    made = Counter(sign.segments for sign in EVERYDAY.values())
    assert max(made.values()) == 1


def test_all_four_kinds_of_hands_are_common() -> None:
    counts = Counter(sign.hands for sign in EVERYDAY.values())
    fraction = {hands: n / len(EVERYDAY) for hands, n in counts.items()}
    assert 0.55 < fraction["one"] < 0.70
    assert 0.08 < fraction["symmetric"] < 0.18
    assert 0.05 < fraction["alternating"] < 0.12
    assert 0.12 < fraction["base"] < 0.24


def test_words_begin_and_end_with_and_without_holds_and_touches() -> None:
    n = len(EVERYDAY)
    ends = Counter(sign.segments[-1].kind for sign in EVERYDAY.values())
    starts = Counter(sign.segments[0].kind for sign in EVERYDAY.values())
    assert 0.45 < ends["H"] / n < 0.65
    assert ends["M"] / n > 0.3
    assert min(starts["H"], starts["X"]) / n > 0.15

    def touches(posture: Posture) -> bool:
        return posture.location not in IN_SPACE and posture.off < 1.0

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
    moving = [s for s in EVERYDAY.values() if len({segment.strong.location for segment in s.segments}) > 1]
    assert len(changing) >= 25
    assert len(moving) >= 25
    assert any(segment.head for sign in EVERYDAY.values() for segment in sign.segments)
    assert any(segment.trunk for sign in EVERYDAY.values() for segment in sign.segments)


def test_locations_and_handshapes_are_many() -> None:
    all_postures = [p for sign in EVERY for p in postures(sign)]
    assert len({p.location for sign in EVERYDAY.values() for p in postures(sign)}) >= 25
    assert len({p.shape for sign in EVERYDAY.values() for p in postures(sign)}) >= 30
    assert len({p.shape for p in all_postures}) >= 50
