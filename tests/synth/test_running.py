"""Sentences: every stretch told, words untouched but where a rule says so, and then only what it says."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from signing import made, seen_from_chest, word
from signsplice.errors import InputError
from signsplice.motion import rotation
from signsplice.synth import pose, running
from signsplice.synth.avoidance import penetration
from signsplice.synth.running import Utterance
from signsplice.synth.signer import JOINTS

WEAK_ARM = [n for name, n in JOINTS.items() if name.startswith("Left") and ("Leg" not in name and "Foot" not in name)]
WEAK_ARM = [n for n in WEAK_ARM if n != JOINTS["LeftToeBase"]]
STRONG_FINGERS = [n for name, n in JOINTS.items() if name.startswith("RightHand") and name != "RightHand"]
STAYS = ("BOOK", "MOTHER", "HOUSE")


def utter(*glosses: str, changes: bool = True) -> Utterance:
    return running.utter([word(gloss) for gloss in glosses], changes)


def changed_joints(said: Utterance, k: int) -> list[int]:
    """Joints that differ anywhere in the kept frames of word ``k``."""
    part = next(s for s in said.stretches if s.word == k)
    assert part.source is not None
    own = said.words[k].clip.local_rotations[part.source : part.source + part.stop - part.start]
    differs = (said.clip.local_rotations[part.start : part.stop] != own).any(axis=(0, 2))
    return [int(n) for n in np.flatnonzero(differs)]


@pytest.mark.parametrize(
    "glosses", [("I",), ("I", "LEARN"), ("YOU", "SIGN", "NAME"), (*STAYS, "I", "BOOK"), ("I", "I", "fs-A")]
)
@pytest.mark.parametrize("changes", [True, False])
def test_stretches_cover_the_clip_and_say_where_each_frame_is_from(glosses: tuple[str, ...], changes: bool) -> None:
    said = utter(*glosses, changes=changes)
    ends = [0, *(part.stop for part in said.stretches)]
    assert [part.start for part in said.stretches] == ends[:-1]
    assert ends[-1] == len(said.clip)
    assert [part.word for part in said.stretches[::2]] == list(range(len(glosses)))
    assert all(part.word is None and part.source is None and not part.changed for part in said.stretches[1::2])
    assert all(part.stop > part.start for part in said.stretches)
    assert said.stretches[0].source == 0, "from the first one's rest"
    assert said.clip.name == " ".join(glosses)
    last = said.stretches[-1]
    assert last.source is not None
    assert last.source + last.stop - last.start == len(said.words[-1]), "to the last one's"
    for k, (before, after) in enumerate(itertools.pairwise(said.stretches[::2])):
        assert before.source is not None
        assert before.source + before.stop - before.start == said.seams[k].pre + 1
        assert after.source == said.seams[k].post
    for part in said.stretches[::2]:
        assert part.word is not None
        assert part.source is not None
        count = part.stop - part.start
        own = said.words[part.word].clip
        same = np.array_equal(
            said.clip.local_rotations[part.start : part.stop], own.local_rotations[part.source :][:count]
        )
        assert same == (not part.changed)
        assert np.array_equal(
            said.clip.root_positions[part.start : part.stop], own.root_positions[part.source :][:count]
        )
        assert changes or not part.changed


def test_a_weak_hand_stays_between_two_words_that_need_it() -> None:
    said, exact = utter(*STAYS), utter(*STAYS, changes=False)
    assert [part.changed for part in said.stretches[::2]] == [(), ("weak",), ()]
    assert set(changed_joints(said, 1)) <= set(WEAK_ARM)
    assert {JOINTS["LeftArm"], JOINTS["LeftForeArm"]} <= set(changed_joints(said, 1))
    middle = said.stretches[2]
    at = seen_from_chest(said.clip, "LeftHand", "LeftForeArm")[1]
    up, down = at[middle.start : middle.stop], seen_from_chest(exact.clip, "LeftHand")[1]
    assert up[:, 0, 1].min() > -15.0, "before the trunk"
    assert down[exact.stretches[2].start : exact.stretches[2].stop, 0, 1].max() < -20.0, "else it goes down"
    left = at[middle.start - len(said.seams[0].states) - 1, 0]
    assert np.abs(at[middle.start : middle.stop, 0] - left).max() < 1.0, "where the word before left it"
    step = np.linalg.norm(np.diff(at[:, 0], axis=0), axis=-1)
    assert step[middle.start - 1 : middle.stop].max() < 6.0


@pytest.mark.parametrize(
    "glosses",
    [
        ("I", "MOTHER", "BOOK"),  # the word before needs no weak hand
        ("BOOK", "MOTHER", "YES"),  # nor does the one after
        ("BOOK", "MOTHER"),
        ("MOTHER", "BOOK"),
        ("BOOK", "MOTHER", "YES", "BOOK"),  # two one-handed words: it goes down
        ("BOOK", "HOUSE", "BOOK"),  # every one needs it
    ],
)
def test_else_it_goes_down(glosses: tuple[str, ...]) -> None:
    assert all("weak" not in part.changed for part in utter(*glosses).stretches)


def test_a_weak_hand_that_would_be_in_the_way_does_not_stay() -> None:
    """The base word leaves its weak hand on the chest, where the next word's strong hand goes."""
    before = made(
        "X shape=S at=space palm=down fingers=fwd w.shape=B-open w.at=chest w.by=palm w.off=1 w.palm=back w.fingers=in",
        "M shift=0,3,0",
        hands="base",
    )
    words = [before, word("MY"), word("BOOK")]
    said = running.utter(words)
    part = said.stretches[2]
    assert part.changed == ()
    stays = words[1].states.copy()
    stays[:, 27:54] = before.states[said.seams[0].pre, 27:54]
    kept = slice(part.source, (part.source or 0) + part.stop - part.start)
    assert penetration(stays[kept], words[1].signer)[0].max() > 0.35, "for a reason"


@pytest.mark.parametrize(("pronoun", "following"), [("I", "LEARN"), ("YOU", "BOOK"), ("YOU", "fs-A")])
def test_a_pronoun_takes_on_part_of_the_next_handshape(pronoun: str, following: str) -> None:
    said = utter(pronoun, following)
    assert said.stretches[0].changed == ("fingers",)
    assert set(changed_joints(said, 0)) <= set(STRONG_FINGERS)
    assert len(changed_joints(said, 0)) >= 8
    frame = said.seams[0].pre
    own = word(pronoun).clip.local_rotations[frame, STRONG_FINGERS]
    new = said.clip.local_rotations[frame, STRONG_FINGERS]
    q = word(following)
    goal = q.clip.local_rotations[q.events.start, STRONG_FINGERS]
    before, after = (rotation.angle_between(x, goal).mean() for x in (own, new))
    assert after == pytest.approx((1.0 - running.ASSIMILATION) * before, rel=0.2)


@pytest.mark.parametrize("glosses", [("MOTHER", "LEARN"), ("YOU", "SIGN"), ("BOOK", "I"), ("I", "I")])
def test_other_words_and_alike_shapes_do_not_assimilate(glosses: tuple[str, ...]) -> None:
    """Not a pronoun; the same index hand after it; a pronoun that comes last."""
    assert all("fingers" not in part.changed for part in utter(*glosses).stretches)


def test_a_pronoun_between_two_handed_words_is_changed_both_ways() -> None:
    said = utter("BOOK", "YOU", "HOUSE")
    assert said.stretches[2].changed == ("weak", "fingers")
    assert set(changed_joints(said, 1)) <= set(WEAK_ARM) | set(STRONG_FINGERS)


def test_changes_move_no_seam() -> None:
    glosses = ("BOOK", "YOU", "HOUSE", "I", "LEARN")
    one, two = utter(*glosses), utter(*glosses, changes=False)
    assert [(s.pre, s.post) for s in one.seams] == [(s.pre, s.post) for s in two.seams]
    assert all(part.changed == () for part in two.stretches)


def test_changed_words_go_on_smoothly() -> None:
    said = utter("BOOK", "YOU", "HOUSE")
    at = seen_from_chest(said.clip, "LeftHand", "RightHand", "RightHandIndex3")[1]
    change = np.linalg.norm(np.diff(at, n=2, axis=0), axis=-1).max(axis=-1)
    for part in said.stretches[1::2]:
        for seam in (part.start - 1, part.stop):
            assert change[seam - 1] < 3.0


def test_one_word_is_itself_and_none_is_refused() -> None:
    said = utter("MOTHER")
    assert np.array_equal(said.clip.local_rotations, word("MOTHER").clip.local_rotations)
    assert said.seams == ()
    with pytest.raises(InputError, match="no words, expected at least one"):
        running.utter([])


def test_seams_hold_the_states_between() -> None:
    said = utter("I", "LEARN", "BOOK")
    for seam, part in zip(said.seams, said.stretches[1::2], strict=True):
        assert len(seam.states) == part.stop - part.start
        rotations, _ = pose.rotations(seam.states, said.words[0].signer)
        assert np.array_equal(said.clip.local_rotations[part.start : part.stop], rotations)
