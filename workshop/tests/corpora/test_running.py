"""Sentences: every frame has a source, and words change only where a rule changes them, and only that part."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from signing import made, seen_from_chest, word
from signsplice.errors import InputError
from signsplice.motion import rotation
from signsplice.signer import pose
from signsplice.signer.collisions import penetration
from signsplice.signer.signer import JOINTS
from signsplice_workshop.corpora import sentences
from signsplice_workshop.corpora.sentences import Utterance

WEAK_ARM = [n for name, n in JOINTS.items() if name.startswith("Left") and ("Leg" not in name and "Foot" not in name)]
WEAK_ARM = [n for n in WEAK_ARM if n != JOINTS["LeftToeBase"]]
STRONG_FINGERS = [n for name, n in JOINTS.items() if name.startswith("RightHand") and name != "RightHand"]
STAYS = ("BOOK", "MOTHER", "HOUSE")


def utter(*glosses: str, changes: bool = True) -> Utterance:
    return sentences.utter([word(gloss) for gloss in glosses], changes)


def changed_joints(sentence: Utterance, k: int) -> list[int]:
    """Joints that differ anywhere in the kept frames of word ``k``."""
    part = next(s for s in sentence.stretches if s.word == k)
    assert part.source is not None
    isolated = sentence.words[k].clip.local_rotations[part.source : part.source + part.stop - part.start]
    differs = (sentence.clip.local_rotations[part.start : part.stop] != isolated).any(axis=(0, 2))
    return [int(n) for n in np.flatnonzero(differs)]


@pytest.mark.parametrize(
    "glosses", [("I",), ("I", "LEARN"), ("YOU", "SIGN", "NAME"), (*STAYS, "I", "BOOK"), ("I", "I", "fs-A")]
)
@pytest.mark.parametrize("changes", [True, False])
def test_stretches_cover_the_clip_and_name_the_source_of_each_frame(glosses: tuple[str, ...], changes: bool) -> None:
    sentence = utter(*glosses, changes=changes)
    ends = [0, *(part.stop for part in sentence.stretches)]
    assert [part.start for part in sentence.stretches] == ends[:-1]
    assert ends[-1] == len(sentence.clip)
    assert [part.word for part in sentence.stretches[::2]] == list(range(len(glosses)))
    assert all(part.word is None and part.source is None and not part.changed for part in sentence.stretches[1::2])
    assert all(part.stop > part.start for part in sentence.stretches)
    assert sentence.stretches[0].source == 0, "from the first one's rest"
    assert sentence.clip.name == " ".join(glosses)
    last = sentence.stretches[-1]
    assert last.source is not None
    assert last.source + last.stop - last.start == len(sentence.words[-1]), "to the last one's"
    for k, (before, after) in enumerate(itertools.pairwise(sentence.stretches[::2])):
        assert before.source is not None
        assert before.source + before.stop - before.start == sentence.seams[k].pre + 1
        assert after.source == sentence.seams[k].post
    for part in sentence.stretches[::2]:
        assert part.word is not None
        assert part.source is not None
        count = part.stop - part.start
        word_clip = sentence.words[part.word].clip
        same = np.array_equal(
            sentence.clip.local_rotations[part.start : part.stop], word_clip.local_rotations[part.source :][:count]
        )
        assert same == (not part.changed)
        assert np.array_equal(
            sentence.clip.root_positions[part.start : part.stop], word_clip.root_positions[part.source :][:count]
        )
        assert changes or not part.changed


def test_a_weak_hand_stays_between_two_words_that_need_it() -> None:
    sentence, exact = utter(*STAYS), utter(*STAYS, changes=False)
    assert [part.changed for part in sentence.stretches[::2]] == [(), ("weak",), ()]
    assert set(changed_joints(sentence, 1)) <= set(WEAK_ARM)
    assert {JOINTS["LeftArm"], JOINTS["LeftForeArm"]} <= set(changed_joints(sentence, 1))
    middle = sentence.stretches[2]
    wrist, down = (seen_from_chest(clip, "LeftHand")[1][:, 0] for clip in (sentence.clip, exact.clip))
    up = wrist[middle.start : middle.stop]
    assert up[:, 1].min() > -15.0, "in front of the trunk"
    assert down[exact.stretches[2].start : exact.stretches[2].stop, 1].max() < -20.0, "else it goes down"
    left = wrist[middle.start - len(sentence.seams[0].states) - 1]
    assert np.abs(up - left).max() < 3.0, "where the word before left it, but for the trunk's motion"
    step = np.linalg.norm(np.diff(wrist, axis=0), axis=-1)
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
def test_else_the_weak_hand_goes_down(glosses: tuple[str, ...]) -> None:
    assert all("weak" not in part.changed for part in utter(*glosses).stretches)


def test_a_weak_hand_does_not_stay_where_it_would_collide() -> None:
    """The base word leaves its weak hand on the chest, where the next word's strong hand goes."""
    before = made(
        "X shape=S at=space palm=down fingers=fwd w.shape=B-open w.at=chest w.by=palm w.off=1 w.palm=back w.fingers=in",
        "M shift=0,3,0",
        hands="base",
    )
    words = [before, word("MY"), word("BOOK")]
    sentence = sentences.utter(words)
    part = sentence.stretches[2]
    assert part.changed == ()
    stays = words[1].states.copy()
    stays[:, 27:54] = before.states[sentence.seams[0].pre, 27:54]
    kept = slice(part.source, (part.source or 0) + part.stop - part.start)
    assert penetration(stays[kept], words[1].signer)[0].max() > 0.35, "it would lie in the body"


@pytest.mark.parametrize(("pronoun", "following"), [("I", "LEARN"), ("YOU", "BOOK"), ("YOU", "fs-A")])
def test_a_pronoun_takes_on_part_of_the_next_handshape(pronoun: str, following: str) -> None:
    sentence = utter(pronoun, following)
    assert sentence.stretches[0].changed == ("fingers",)
    assert set(changed_joints(sentence, 0)) <= set(STRONG_FINGERS)
    assert len(changed_joints(sentence, 0)) >= 8
    frame = sentence.seams[0].pre
    isolated = word(pronoun).clip.local_rotations[frame, STRONG_FINGERS]
    changed = sentence.clip.local_rotations[frame, STRONG_FINGERS]
    q = word(following)
    goal = q.clip.local_rotations[q.events.start, STRONG_FINGERS]
    before, after = (rotation.angle_between(x, goal).mean() for x in (isolated, changed))
    assert after == pytest.approx((1.0 - sentences.ASSIMILATION) * before, rel=0.2)


@pytest.mark.parametrize("glosses", [("MOTHER", "LEARN"), ("YOU", "SIGN"), ("BOOK", "I"), ("I", "I")])
def test_other_words_and_similar_shapes_do_not_assimilate(glosses: tuple[str, ...]) -> None:
    """Not a pronoun; the same index hand after it; a pronoun that comes last."""
    assert all("fingers" not in part.changed for part in utter(*glosses).stretches)


def test_a_pronoun_between_two_handed_words_has_both_changes() -> None:
    sentence = utter("BOOK", "YOU", "HOUSE")
    assert sentence.stretches[2].changed == ("weak", "fingers")
    assert set(changed_joints(sentence, 1)) <= set(WEAK_ARM) | set(STRONG_FINGERS)


def test_changes_leave_all_cut_frames_as_they_are() -> None:
    glosses = ("BOOK", "YOU", "HOUSE", "I", "LEARN")
    changed, exact = utter(*glosses), utter(*glosses, changes=False)
    assert [(s.pre, s.post) for s in changed.seams] == [(s.pre, s.post) for s in exact.seams]
    assert all(part.changed == () for part in exact.stretches)


def test_changed_words_continue_smoothly_over_seams() -> None:
    sentence = utter("BOOK", "YOU", "HOUSE")
    positions = seen_from_chest(sentence.clip, "LeftHand", "RightHand", "RightHandIndex3")[1]
    change = np.linalg.norm(np.diff(positions, n=2, axis=0), axis=-1).max(axis=-1)
    for part in sentence.stretches[1::2]:
        for seam in (part.start - 1, part.stop):
            assert change[seam - 1] < 3.0


def test_one_word_is_its_isolated_form_and_none_is_refused() -> None:
    sentence = utter("MOTHER")
    assert np.array_equal(sentence.clip.local_rotations, word("MOTHER").clip.local_rotations)
    assert sentence.seams == ()
    with pytest.raises(InputError, match="no words, expected at least one"):
        sentences.utter([])


def test_seams_hold_the_states_of_their_transitions() -> None:
    sentence = utter("I", "LEARN", "BOOK")
    for seam, part in zip(sentence.seams, sentence.stretches[1::2], strict=True):
        assert len(seam.states) == part.stop - part.start
        rotations, _ = pose.rotations(seam.states, sentence.words[0].signer)
        assert np.array_equal(sentence.clip.local_rotations[part.start : part.stop], rotations)
