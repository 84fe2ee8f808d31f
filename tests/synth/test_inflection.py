"""Forms of a sign: verbs between loci, plural and aspect."""

from __future__ import annotations

import numpy as np
import pytest

from signing import SIGNS, made, sign, signer_of
from signsplice.errors import InputError
from signsplice.motion import FloatArray
from signsplice.signer import inflection, notation, planner, pose
from signsplice.signer.collisions import penetration
from signsplice.signer.inflection import agree, form, inflect
from signsplice.signer.planner import IsolatedWord
from signsplice.signer.signer import STANDARD


def isolated(gloss: str) -> IsolatedWord:
    return planner.synthesize_word(form(SIGNS, gloss))


def stroke(one: IsolatedWord) -> FloatArray:
    """Displacement (3,) of the strong wrist in its last pass: out, up, forward, cm."""
    begin, stop = one.events.passes[-1]
    x, y, z = one.states[stop, pose.WRIST] - one.states[begin, pose.WRIST]
    return np.array([-x, y, z])


def test_one_sign_gives_both_i_give_you_and_you_give_me() -> None:
    to_you, to_me = stroke(isolated("1-GIVE-2")), stroke(isolated("2-GIVE-1"))
    assert to_you[2] > 7.5, "the hold after it has the rest of the path"
    assert to_me[2] < -7.5
    cited = stroke(planner.synthesize_word(sign("GIVE")))
    assert np.abs(to_you - cited).max() < 3.0, "the first is the form that is cited"


@pytest.mark.parametrize(
    ("gloss", "way"),
    [("1-GIVE-3", (1, 1)), ("3-GIVE-1", (-1, -1)), ("1-GIVE-3-WEAK", (-1, 1)), ("3-GIVE-3-WEAK", (-1, 0))],
)
def test_third_persons_are_at_the_sides(gloss: str, way: tuple[int, int]) -> None:
    out, _, forward = stroke(isolated(gloss))
    assert out * way[0] > 5.0
    assert forward * way[1] > 3.0 if way[1] else abs(forward) < 8.0


def test_palm_and_fingers_turn_with_the_line() -> None:
    """ASK: the palm faces who is asked."""
    palms = {to: agree(sign("ASK"), *to).segments[0].strong.palm for to in (("1", "2"), ("2", "1"), ("3-weak", "3"))}
    assert palms["1", "2"] == pytest.approx((0.0, 0.0, 1.0))
    assert palms["2", "1"][2] < -0.7
    assert palms["3-weak", "3"][0] > 0.6


@pytest.mark.parametrize("gloss", ["2-GIVE-1", "3-GIVE-1", "2-ASK-1", "TELL-1", "3-WEAK-GIVE-3"])
def test_forms_stay_out_of_the_body_and_within_easy_limits(gloss: str) -> None:
    one = isolated(gloss)
    assert penetration(one.states, STANDARD)[0].max() < 0.25
    at_loci = [s.strong for s in one.sign.segments if s.strong.location.startswith("locus:")]
    assert inflection.are_easy(at_loci).all()


def test_a_verb_that_begins_at_the_chin_agrees_with_its_object_alone() -> None:
    told = form(SIGNS, "TELL-3")
    assert [s.strong.location for s in told.segments] == ["chin", "locus:3", "locus:3"]
    assert told.segments[0] == sign("TELL").segments[0]
    assert stroke(planner.synthesize_word(told))[0] > 8.0


def test_loci_of_a_base_hand_are_mirrored() -> None:
    text = (
        "PASS hands=base\n  X shape=B at=subject palm=up fingers=fwd w.shape=B w.at=subject w.palm=up w.fingers=fwd\n"
        "  M at=object w.at=object\n"
    )
    passed = agree(notation.parse(text)["PASS"], "1", "3").segments[1]
    assert passed.weak is not None
    assert (passed.strong.location, passed.weak.location) == ("locus:3", "locus:3-weak")
    assert passed.strong.fingers[0] > 0.5
    assert passed.weak.fingers[0] < -0.3, "to the strong side, as the weak hand is written"


def test_a_locus_is_a_place_like_any_other() -> None:
    out = {
        person: -made(f"H shape=5 at=locus:{person} palm=up fingers=fwd").states[30, 0]
        for person in ("2", "3", "3-weak")
    }
    assert out["3"] > out["2"] + 10.0
    assert out["3-weak"] < out["2"] - 10.0


# --- plural and aspect


def test_aspects_repeat_faster_or_slower() -> None:
    once, habitual, continuative = (
        planner.synthesize_word(form(SIGNS, gloss), signer_of(None))
        for gloss in ("LOOK", "LOOK-HABITUAL", "LOOK-CONTINUATIVE")
    )
    assert [len(one.events.passes) for one in (once, habitual, continuative)] == [1, 3, 3]
    n_frames = [one.events.passes[0][1] - one.events.passes[0][0] for one in (once, habitual, continuative)]
    assert n_frames[1] < n_frames[0] < n_frames[2]


def test_the_continuative_goes_round() -> None:
    one = planner.synthesize_word(form(SIGNS, "LOOK-CONTINUATIVE"), signer_of(None))
    (_, stop), (begin, _), *_ = one.events.passes
    heights = one.states[stop : begin + 1, 1]
    assert heights.max() - heights[[0, -1]].max() > 2.0


def test_the_plural_is_made_at_three_places() -> None:
    one = isolated("BOOK-PLURAL")
    out = -one.states[[stop for _, stop in one.events.passes], 0]
    assert np.diff(out).min() > 6.0
    trees = isolated("TREE-PLURAL")
    travel = trees.states[trees.events.end, [0, 27]] - trees.states[trees.events.start, [0, 27]]
    assert travel == pytest.approx([-16.0, 16.0], abs=2.3), "both hands, the weak one mirrored"


def test_a_local_movement_goes_on_for_longer() -> None:
    local = inflect(sign("TREE"), "habitual").segments[1].local
    usual = sign("TREE").segments[1].local
    assert local is not None
    assert usual is not None
    assert local.cycles == 3 * usual.cycles


def test_forms_combine() -> None:
    both = form(SIGNS, "1-GIVE-3-CONTINUATIVE")
    assert both.gloss == "1-GIVE-3-CONTINUATIVE"
    assert (both.segments[1].times, both.segments[1].strong.location) == (3, "locus:3")
    assert form(SIGNS, "MOTHER") == sign("MOTHER")


@pytest.mark.parametrize(
    ("gloss", "message"),
    [
        ("GIVE-2", "GIVE agrees with subject and object; object was given"),
        ("2-TELL-1", "TELL agrees with object; subject and object was given"),
        ("1-LOOK-2", "LOOK agrees with nobody, as it names no place at=subject or at=object"),
        ("2-GIVE-2", "GIVE from 2 to 2, expected two persons"),
        ("NOWORD-HABITUAL", "form 'NOWORD-HABITUAL': no sign 'NOWORD', expected a sign's gloss as in 2-GIVE-1"),
        ("MOTHER-PLURAL", "MOTHER-PLURAL cannot be made: segment 2: step= would leave at=chin"),
        ("fs-A-HABITUAL", "fs-A has no movement to repeat"),
        ("CAR-PLURAL", "hands that go the same way at a time, not hands=alternating"),
    ],
)
def test_forms_that_there_are_not(gloss: str, message: str) -> None:
    with pytest.raises(InputError, match=message.replace("(", r"\(")) as caught:
        form(SIGNS, gloss)
    assert "\n" not in str(caught.value)


def test_persons_kinds_and_signs_without_movement_are_checked() -> None:
    with pytest.raises(InputError, match="person '4', expected one of 1, 2, 3, 3-weak"):
        agree(sign("GIVE"), "1", "4")
    with pytest.raises(InputError, match="form 'often', expected one of plural, habitual, continuative"):
        inflect(sign("GIVE"), "often")
    with pytest.raises(InputError, match="fs-A has no movement to repeat"):
        inflect(sign("fs-A"), "habitual")
