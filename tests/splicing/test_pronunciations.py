"""Mouths guessed from a pronunciation dictionary, in words without a face of their own."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.lib.stride_tricks import sliding_window_view

import signsplice as ss
from signing import marked
from signsplice.errors import FormatError, LimitError
from signsplice.formats.reading import DEFAULT_LIMITS
from signsplice.motion import Clip, FloatArray, concatenate
from signsplice.motion.face import Face
from signsplice.splicing.contracts import Cut, Cutter
from signsplice.splicing.cutters import CUTTERS
from signsplice.splicing.faces import CHANNELS, RAISED, RULES
from signsplice.splicing.mouthing import CHANNELS as MOUTH
from signsplice.splicing.mouthing import read_pronunciations
from signsplice_workshop.measure.faces import add_random_face

DICTIONARY = """;;; a comment
HELLO  HH AH0 L OW1
HELLO(2)  HH EH0 L OW1
sign S AY1 N # a comment, as newer files have them

THANK  TH AE1 NG K
YOU  Y UW1
DÉJÀ  D EY1 ZH AA2
A  AH0
"""


@pytest.fixture(scope="module")
def dictionary(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("words") / "words.dict"
    path.write_text(DICTIONARY, encoding="latin-1", newline="\r\n")
    return path


def options(dictionary: Path, **others: Any) -> ss.SpliceOptions:
    quick = ss.SpliceOptions(cutter="pose-velocity", transition="slerp", face_rules=RULES, mouthing=dictionary)
    return replace(quick, **others)


def face_of(clip: Clip) -> Face:
    assert clip.face is not None
    return clip.face


def openness(clip: Clip) -> FloatArray:
    """How far the mouth is from closed, the largest coefficient (T,)."""
    return np.asarray(face_of(clip).of(MOUTH).max(axis=1))


def test_the_words_of_a_gloss_are_looked_up_without_digits_and_variant(dictionary: Path) -> None:
    known = read_pronunciations(dictionary, DEFAULT_LIMITS.free_bytes)
    assert known.of("hello") == known.of("HELLO#2") == known.of("2-HELLO-1") == "h @ l oU"
    assert known.of("THANK-YOU") == "T { N k j u:"
    assert known.of("DÉJÀ") == "d eI Z A"
    assert known.of("DEAF") == known.of("HELLO-DEAF") == known.of("2#HELLO") == ""


@pytest.mark.parametrize("tempo", ["citation", "natural"])
def test_known_words_are_mouthed_and_unknown_ones_are_not(
    tempo: str, dictionary: Path, sentence: list[Clip], words: dict[str, Clip]
) -> None:
    letter = replace(words["HELLO"], name="fs-A")
    marks, brows = {1: ",", 4: "?", 5: "."}, {3: RAISED, 4: RAISED}
    clips = marked([*sentence, letter], pauses=marks, brows=brows)
    result = ss.splice(clips, options(dictionary, tempo=tempo))
    mouth = openness(result.clip)
    assert {*CHANNELS, *MOUTH} <= {*face_of(result.clip).channels}
    for span in result.spans:
        if span.kind == "sign":
            assert (mouth[slice(*span.output)].max() > 0.3) == (span.name in ("HELLO", "SIGN", "THANK-YOU"))
        if span.pause is not None:  # held with a closed mouth
            assert mouth[span.pause.frames[0] - 1 : span.pause.frames[1]].max() < 1e-9
    assert max(mouth[0], mouth[-1]) < 1e-9
    is_frozen = (np.abs(np.diff(face_of(result.clip).of(MOUTH), axis=0)).max(axis=1) < 1e-3) & (mouth[1:] > 0.05)
    assert not sliding_window_view(is_frozen, 6).all(axis=1).any()  # 0.2 s; a sound takes 0.15
    streamed = concatenate([piece.clip for piece in ss.stream(clips, options(dictionary, tempo=tempo))])
    assert np.array_equal(face_of(streamed).weights, face_of(result.clip).weights)
    silent = ss.splice(clips, options(dictionary, tempo=tempo, mouthing=None)).clip
    assert np.array_equal(face_of(silent).weights, face_of(result.clip).of(face_of(silent).channels))
    assert np.array_equal(silent.local_rotations, result.clip.local_rotations)


class Early(Cutter):
    """Leaves a word in the middle of its sign, but not where it is joined to itself."""

    name, summary = "early", "early"

    def cut(self, before: Clip, after: Clip) -> Cut:
        usual = CUTTERS["pose-velocity"].cut(before, after)
        if before is after:
            return usual
        return Cut((CUTTERS["pose-velocity"].cut(before, before).post + usual.pre) // 2, usual.post)


def test_a_mouth_that_is_left_open_closes_in_the_transition(dictionary: Path, words: dict[str, Clip]) -> None:
    clips = [words["THANK-YOU"], words["DEAF"]]
    result = ss.splice(clips, options(dictionary, cutter=Early(), transition_time=0.4))
    mouth = openness(result.clip)
    cut, entry = result.spans[1].output
    assert mouth[cut - 1] > 0.1
    assert mouth[(cut + entry) // 2 :].max() < 1e-9
    assert np.all(np.diff(mouth[cut - 1 : (cut + entry) // 2]) < 0.0)


def test_a_face_of_its_own_is_not_mouthed(dictionary: Path, words: dict[str, Clip]) -> None:
    clips = [add_random_face(words["HELLO"], 0), words["DEAF"]]
    own, silent = (ss.splice(clips, options(dictionary, mouthing=path)).clip for path in (dictionary, None))
    assert np.array_equal(face_of(own).weights, face_of(silent).weights)


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        ("HELLO HH AH0\nBAD B ae1 D\n", r"words\.dict:2: 'BAD': 'ae1' is no phoneme, expected ARPAbet as in HELLO"),
        ("HELLO HH AH0\n\nBAD\n", r"words\.dict:3: 'BAD': '' is no phoneme"),
        (";;; nothing\n", r"words\.dict: holds no pronunciation, expected lines as HELLO"),
        ("\0" * 9, r"words\.dict:1: '.*: '' is no phoneme"),
    ],
)
def test_a_file_that_is_no_dictionary_is_one_line(content: str, expected: str, tmp_path: Path) -> None:
    (tmp_path / "words.dict").write_text(content)
    with pytest.raises(FormatError, match=expected) as caught:
        options(tmp_path / "words.dict")
    assert len(str(caught.value).splitlines()) == 1


def test_a_dictionary_that_cannot_be_used_is_an_error(dictionary: Path, tmp_path: Path) -> None:
    with pytest.raises(ss.InputError, match="none: no such file"):
        options(tmp_path / "none")
    with pytest.raises(LimitError, match="bytes, expected at most 9"):
        options(dictionary, limits=replace(DEFAULT_LIMITS, free_bytes=9))
    with pytest.raises(ss.InputError, match=r"mouthing moves faces by rule, expected SpliceOptions\.face_rules too"):
        options(dictionary, face_rules=())
    with pytest.raises(ss.InputError, match=r"leave out SpliceOptions\.mouthing"):
        ss.SpliceOptions(system="lpt-plus", face_rules=RULES, mouthing=dictionary)
