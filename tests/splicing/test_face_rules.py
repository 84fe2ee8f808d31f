"""The face by rule: blinks, and the brows of questions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import signsplice as ss
from signing import marked
from signsplice.lexicon import sentence as lines
from signsplice.lexicon.lexicon import open_shipped_lexicon
from signsplice.motion import Clip, concatenate
from signsplice.motion.face import ARKIT_CHANNELS, Face
from signsplice.splicing import report
from signsplice.splicing.faces import BLINKS, BROWS, CHANNELS, FURROWED, GAZE, LIDS, RAISED, RULES
from signsplice_workshop.measure.faces import add_random_face

OPTIONS = ss.SpliceOptions(cutter="ends", transition="slerp", duration="fixed", face_rules=RULES)
BROW_CHANNELS = tuple(name for name in CHANNELS if name.startswith("brow"))


def face_of(clip: Clip) -> Face:
    assert clip.face is not None
    return clip.face


def blinks(face: Face) -> list[int]:
    """Frames at which lids are closed."""
    lids = face.of(["eyeBlinkLeft"])[:, 0]
    return [k for k in range(1, len(lids) - 1) if lids[k] > 0.5 and lids[k - 1] < lids[k] >= lids[k + 1]]


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("YOU DEAF?", {0: RAISED, 1: RAISED}),
        ("YOUR NAME WHAT?", {0: FURROWED, 1: FURROWED, 2: FURROWED}),
        ("HELLO. YOU DEAF? I DEAF.", {1: RAISED, 2: RAISED}),
        ("COFFEE, YOU WANT?", {0: RAISED, 1: RAISED, 2: RAISED}),
        ("WHAT YOU WANT", {}),
        ("I WANT WHAT. YOU?", {3: RAISED}),
    ],
)
def test_brows_follow_the_marks_of_a_line(line: str, expected: dict[int, str]) -> None:
    with open_shipped_lexicon() as lexicon:
        glosses = lines.line_glosses(lines.parse(line, lexicon))
    assert {k: gloss.brow for k, gloss in enumerate(glosses) if gloss.brow is not None} == expected


def test_brows_are_up_through_a_question_and_back_at_its_end(sentence: list[Clip]) -> None:
    brows = {1: RAISED, 2: RAISED, 3: RAISED, 4: FURROWED}
    result = ss.splice(marked(sentence, pauses={3: "?"}, brows=brows), OPTIONS)
    face = face_of(result.clip)
    assert face.channels == tuple(name for name in ARKIT_CHANNELS if name in CHANNELS or name.startswith("eyeLook"))
    up, down = face.of(["browInnerUp", "browDownLeft"]).T
    signs = {span.clip: slice(*span.output) for span in result.spans if span.kind == "sign"}
    first, last = signs[1].start, signs[3].stop
    assert np.all(up[first:last] == 0.7)
    assert np.all(down[first:last] == 0.0)
    assert np.all(down[signs[4]] == 0.8)
    assert up[0] == up[-1] == down[0] == down[-1] == 0.0
    assert np.abs(np.diff(face.of(BROW_CHANNELS), axis=0)).max() < 0.35  # a transition of 0.2 s


def test_brows_of_a_first_and_a_last_word_move_with_it(words: dict[str, Clip]) -> None:
    face = face_of(ss.splice(marked([words["HELLO"]], brows={0: RAISED}), OPTIONS).clip)
    up = face.of(["browInnerUp"])[:, 0]
    assert up[0] == up[-1] == 0.0
    assert up.max() == pytest.approx(0.7)
    assert np.abs(np.diff(up)).max() < 0.2


def test_people_blink_at_the_ends_of_phrases_and_every_few_seconds(sentence: list[Clip]) -> None:
    result = ss.splice(marked([*sentence, *sentence], pauses={2: ".", 5: "?"}), OPTIONS)
    face, fps = face_of(result.clip), result.clip.fps
    closed = blinks(face)
    for span in result.spans:
        if span.pause is not None:
            assert any(span.pause.frames[0] <= frame < span.output[1] for frame in closed)
    times = np.array([0, *closed, len(result.clip)]) / fps
    assert np.diff(times).max() < 6.0 + max(clip.seconds for clip in sentence)
    assert np.all(face.of(LIDS)[closed] == 1.0)
    lids = face.of(LIDS)[:, 0]
    assert len(closed) == int(((lids[1:] > 0.0) & (lids[:-1] == 0.0)).sum())  # none is cut


def test_a_clip_with_a_face_of_its_own_keeps_it(words: dict[str, Clip]) -> None:
    clips = [words["HELLO"], add_random_face(words["DEAF"], 0), words["SIGN"]]
    result = ss.splice(marked(clips, pauses={1: "?"}, brows=dict.fromkeys(range(3), RAISED)), OPTIONS)
    own = next(span for span in result.spans if span.clip == 1)
    assert own.source is not None
    shown = face_of(result.clip)[slice(*own.output)]
    assert np.array_equal(shown.weights, face_of(clips[1]).weights[slice(*own.source)])
    assert report.describe(result)["face"] == {"recorded": [1], "rules": ["blinks", "brows", "gaze"]}


def test_each_rule_can_be_left_out_and_without_any_there_is_no_face(sentence: list[Clip]) -> None:
    brows = dict.fromkeys(range(6), RAISED)

    def face(*rules: str, person: float = 1.0) -> Face | None:
        options = replace(OPTIONS, face_rules=rules, person=person)
        return ss.splice(marked(sentence, pauses={5: "?"}, brows=brows), options).clip.face

    assert face() is None
    only_blinks, only_brows, only_gaze, still = face(BLINKS), face(BROWS), face(GAZE), face(GAZE, person=0.0)
    assert only_blinks is not None
    assert only_brows is not None
    assert only_gaze is not None
    assert still is not None
    assert blinks(only_blinks)
    assert not only_blinks.of(BROW_CHANNELS).any()
    assert not only_brows.of(LIDS).any()
    assert only_brows.of(["browInnerUp"]).max() == 0.7
    assert only_blinks.channels == only_brows.channels == still.channels == CHANNELS
    assert not only_gaze.of(CHANNELS).any()
    assert only_gaze.weights.max() > 0.1, "eyes turn against the head"
    with pytest.raises(ss.InputError, match="face rules"):
        face("smile")
    with pytest.raises(ss.InputError, match="expected raised or furrowed"):
        ss.splice(marked(sentence, brows={0: "up"}), OPTIONS)


def test_a_stream_has_the_same_face(sentence: list[Clip]) -> None:
    marks, brows = {2: "?", 5: "."}, {1: RAISED, 2: RAISED}
    pieces = list(ss.stream(marked(iter(sentence), pauses=marks, brows=brows), OPTIONS))
    whole = ss.splice(marked(sentence, pauses=marks, brows=brows), OPTIONS).clip
    assert np.array_equal(face_of(concatenate([piece.clip for piece in pieces])).weights, face_of(whole).weights)
