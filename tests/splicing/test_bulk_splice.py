"""splicing.bulk_splice: the same results as one by one, whatever a sentence is spliced with."""

from __future__ import annotations

from dataclasses import fields, replace
from functools import cache
from typing import Any

import numpy as np
import pytest

import signsplice as ss
from signing import marked
from signsplice.errors import SignspliceError
from signsplice.lexicon import open_shipped_lexicon
from signsplice.motion import Clip
from signsplice.motion.cache import Cache
from signsplice.splicing import cards
from signsplice.splicing.bulk_splice import splice_many
from signsplice.splicing.bundle import Sessions
from signsplice.splicing.contracts import Gap, Transition
from signsplice.splicing.curves import find_transition


@cache
def clips(*glosses: str) -> tuple[Clip, ...]:
    """Words that ship, each one object however often it is asked for."""
    with open_shipped_lexicon() as words:
        return tuple(words.clip(gloss) for gloss in glosses)


WORDS = ("HELLO", "I", "DEAF", "THANK-YOU", "SIGN", "BOOK", "MOTHER", "YES")


def sentence(*numbers: int) -> list[Clip]:
    return [clips(*WORDS)[n] for n in numbers]


def facts(result: Any) -> tuple[Any, ...]:
    """Everything that a result says, but times."""
    assert isinstance(result, ss.SpliceResult), result
    described = (getattr(result, field.name) for field in fields(result) if field.name not in ("clip", "timing_ms"))
    return repr(tuple(described)), result.clip.local_rotations.tobytes(), result.clip.root_positions.tobytes()


OPTIONS = (
    ss.SpliceOptions(),
    ss.SpliceOptions(tempo="natural"),
    ss.SpliceOptions(tempo=0.6, fps=50.0),
    ss.SpliceOptions(fps=24.0, free_hand="natural"),
    ss.SpliceOptions(transition="quintic", cutter="pose-velocity", duration="tempo"),
    ss.SpliceOptions(cutter="learned-fluent", sign_speed=1.3),
    ss.SpliceOptions(transition_time=0.0),
    ss.SpliceOptions(transition="linear", avoid_collisions=True),
)


@pytest.mark.parametrize("options", OPTIONS, ids=lambda options: f"{options.tempo}-{options.transition}-{options.fps}")
def test_sentences_are_those_of_splice_bit_for_bit(options: ss.SpliceOptions) -> None:
    sentences = [sentence(0, 1, 2), sentence(3, 5), sentence(6), sentence(5, 6, 7, 4)]
    assert [facts(r) for r in splice_many(sentences, options)] == [facts(ss.splice(s, options)) for s in sentences]


def test_letters_are_those_of_splice_bit_for_bit() -> None:
    spelled = [sentence(1)[0], *clips("fs-A", "fs-N", "fs-N", "fs-E"), sentence(4)[0]]
    assert facts(splice_many([spelled, spelled[1:3]])[0]) == facts(ss.splice(spelled))
    sentences = [marked(spelled, starts) for starts in ((3,), ())]
    found = splice_many(sentences)
    assert [facts(one) for one in found] == [facts(ss.splice(words)) for words in sentences]
    assert facts(found[0]) != facts(found[1])


def test_words_of_another_place_and_with_bones_that_move_are_those_of_splice() -> None:
    first, second = sentence(2, 5)
    apart = replace(second, root_positions=second.root_positions + np.array([1.0, 0.0, 0.5]))
    lengths = np.tile(second.skeleton.offsets, (len(second), 1, 1)) * np.linspace(1.0, 1.02, len(second))[:, None, None]
    moving = replace(second, translations=lengths)
    sentences = [[first, apart], [first, moving], [moving, apart, first]]
    for many, one in zip(splice_many(sentences), map(ss.splice, sentences), strict=True):
        assert facts(many) == facts(one)
        assert isinstance(many, ss.SpliceResult)
        np.testing.assert_array_equal(many.clip.translations, one.clip.translations)


def test_a_sentence_does_not_depend_on_its_companions() -> None:
    sentences = [sentence(*numbers) for numbers in ((0, 3, 5), (1, 2), (6, 7), (4, 1, 0, 2), (5, 2))]
    options = [OPTIONS[k] for k in (0, 1, 0, 3, 2)]
    together = [facts(result) for result in splice_many(sentences, options)]
    assert [facts(result) for result in splice_many(sentences[::-1], options[::-1])][::-1] == together
    assert [facts(splice_many([s], o)[0]) for s, o in zip(sentences, options, strict=True)] == together


def test_sentences_in_several_blocks_are_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    sentences = [sentence(0, 3), sentence(1, 2), sentence(6, 7)]
    together = [facts(result) for result in splice_many(sentences)]
    monkeypatch.setattr("signsplice.splicing.bulk_splice._WORDS_AT_ONCE", 3)
    assert [facts(result) for result in splice_many(sentences)] == together


class FailsAt(Transition):
    """Hermite, but no frames of a gap after one word."""

    name, summary = "fails-at", "raises after one word"

    def __init__(self, name: str) -> None:
        self.fails = name

    def between(self, gap: Gap) -> Clip:
        if gap.before.name == self.fails:
            raise SignspliceError(f"no frames after {self.fails}")
        return find_transition("hermite").between(gap)


def test_what_cannot_be_spliced_is_an_error_of_its_sentence_alone() -> None:
    good, bad = sentence(0, 3), sentence(1, 2)
    stick = ss.Skeleton(("a", "b"), np.array([-1, 0]), np.array([[0.0, 0, 0], [0, 1, 0]]))
    alien = Clip(stick, np.tile([0.0, 0, 0, 1], (9, 2, 1)), np.zeros((9, 3)), 30.0, "alien")
    found = splice_many([good, [*good, alien], [], bad, good], ss.SpliceOptions(transition=FailsAt("I")))
    assert isinstance(found[1], ss.RigMismatchError)
    assert "nothing to splice" in str(found[2])
    assert str(found[3]) == "no frames after I"
    alone = facts(ss.splice(good, ss.SpliceOptions(transition=FailsAt("I"))))
    assert facts(found[0]) == facts(found[4]) == alone


def test_options_are_one_or_one_of_each() -> None:
    assert splice_many([]) == []
    with pytest.raises(ValueError, match="zip"):
        splice_many([sentence(0, 1)], [ss.SpliceOptions()] * 2)


def test_a_word_is_read_once_for_all_sentences(monkeypatch: pytest.MonkeyPatch) -> None:
    runs: list[str] = []
    run = Sessions.run

    def counted(self: Sessions, name: str, inputs: Any, **shapes: Any) -> Any:
        runs.append(name)
        return run(self, name, inputs, **shapes)

    monkeypatch.setattr(Sessions, "run", counted)
    monkeypatch.setattr(cards, "CACHE", Cache())  # of which no word is known
    words = [clip[:] for clip in sentence(0, 3, 5)]
    splice_many([[words[0], words[1]], [words[1], words[2]], [words[2], words[0]], [words[1], words[0]]])
    assert runs.count("cut") == 3
    assert runs.count("word") <= 6, "a word, and its mirror image where one hand moves while the other rests"
    assert 1 <= runs.count("bridge") <= 4, "gaps of one length together"
