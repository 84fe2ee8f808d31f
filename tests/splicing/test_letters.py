"""Letters of one spelled word: holds, ways, and doubled letters."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from signing import marked
from signsplice.body.arm_ik import move_wrists
from signsplice.lexicon import Lexicon, open_shipped_lexicon
from signsplice.lexicon.gloss import is_letter
from signsplice.lexicon.sentence import parse
from signsplice.motion import Clip, concatenate, resample, rotation
from signsplice.rig.info import arms, hands_in_trunk_axes
from signsplice.splicing import letters as doubled_letters
from signsplice.splicing.collisions import depths
from signsplice.splicing.engine import SpliceOptions, SpliceResult, Stream, splice, stream
from signsplice.splicing.letters import cut_letters
from signsplice.splicing.word import words_of


@pytest.fixture(scope="module")
def lexicon() -> Iterator[Lexicon]:
    with open_shipped_lexicon() as opened:
        yield opened


def letters(word: str, lexicon: Lexicon) -> list[Clip]:
    return [lexicon.clip(f"fs-{letter}") for letter in word]


def ways_and_holds(result: SpliceResult) -> list[tuple[float, float]]:
    """For every way to a letter: seconds of it, and for how long the letter is kept after it."""
    n_frames = [stop - start for start, stop in (span.output for span in result.spans if span.kind != "retraction")]
    fps = result.clip.fps
    return [((way + 1) / fps, (kept - 1) / fps) for way, kept in zip(n_frames[1::2], n_frames[2::2], strict=True)]


@pytest.mark.parametrize("word", ["ANNA", "LETTER", "JAZZ", "QUEBEC", "2024"])
@pytest.mark.parametrize("fps", [None, 25.0, 60.0])
def test_a_letter_is_held_at_least_as_long_as_the_way_to_it(word: str, fps: float | None, lexicon: Lexicon) -> None:
    result = splice(letters(word, lexicon), SpliceOptions(fps=fps))
    assert all(hold >= way - 1e-9 for way, hold in ways_and_holds(result))


def test_words_are_spelled_at_a_human_rate(lexicon: Lexicon) -> None:
    """2 to 6 letters a second (Reed et al. 1990), and no hand that leaves its place on the way."""
    for word in ("MARIA", "SMITH", "BERND"):
        result = splice(letters(word, lexicon))
        signs = [span.output[0] for span in result.spans if span.kind == "sign"]
        assert 2.0 <= (len(word) - 2) * result.clip.fps / (signs[-1] - signs[1]) <= 6.0
        assert min(way for way, _ in ways_and_holds(result)) < 0.2
        own = arms(result.clip)
        wrists = hands_in_trunk_axes(own)[0][signs[1] - 4 : signs[-1] + 1, 1] * own.metres
        assert np.linalg.norm(np.diff(wrists, axis=0), axis=-1).max() * result.clip.fps < 0.7


def moved(result: SpliceResult, span: int) -> tuple[float, float]:
    """How far the right wrist, m, and its fingers, radians, leave where a span begins."""
    own, (start, stop) = arms(result.clip), result.spans[span].output
    fingers = [k for k, name in enumerate(result.clip.skeleton.names) if "RightHand" in name]
    local = result.clip.local_rotations[start:stop, fingers]
    travel = np.linalg.norm(own.wrists[start:stop, 1] - own.wrists[start - 1, 1], axis=-1).max() * own.metres
    return float(travel), float(rotation.angle_between(local, result.clip.local_rotations[start - 1, fingers]).max())


def test_closed_letters_are_formed_anew(lexicon: Lexicon) -> None:
    result = splice(letters("ANNA", lexicon), SpliceOptions(transition="hold", person=0.0))
    travel, turn = moved(result, 3)
    assert 0.005 < travel < 0.0127 + 1e-3, "half an inch"
    assert 0.5 < turn < 0.9
    hand = [k for k, name in enumerate(result.clip.skeleton.names) if "RightHand" in name]
    first, second = (result.clip.local_rotations[slice(*result.spans[k].output)][:, hand] for k in (2, 4))
    assert rotation.angle_between(second[0], first).max() < 0.05, "the letters themselves stay as they were recorded"


def test_a_letter_with_a_movement_is_kept_whole_and_not_bounced(lexicon: Lexicon) -> None:
    twice = splice(letters("ZZ", lexicon), SpliceOptions(transition="hold"))
    assert moved(twice, 1)[1] == pytest.approx(0.0, abs=1e-6), "the way from the end of Z to its beginning"
    first, _, second, _ = twice.spans
    assert first.source is not None
    assert second.source is not None
    assert first.source[1] - second.source[0] >= 25


def test_the_speed_of_signs_is_that_of_letters_too(lexicon: Lexicon) -> None:
    frames = [len(splice(letters("MARIA", lexicon), SpliceOptions(sign_speed=speed)).clip) for speed in (1.0, 0.5)]
    assert frames[1] == pytest.approx(2 * frames[0], abs=8)


@pytest.mark.parametrize(("speed", "fps"), [(5.0, 30.0), (1.0, 5.0)])
def test_letters_that_play_fast_or_at_few_frames_are_letters_still(speed: float, fps: float, lexicon: Lexicon) -> None:
    clips = [resample(clip, fps, speed) for clip in letters("ABCDEFGHIKLMNOPQRSTUVWXYZ", lexicon)]
    assert all(cut_letters(before, after, 0, 0.0, speed) for before, after in pairwise(clips))
    seam = splice(letters("MA", lexicon), SpliceOptions(fps=fps, sign_speed=speed)).seams[0]
    assert "cut as signs" not in " ".join(seam.warnings)


def test_letters_that_are_never_seen_still_are_named(lexicon: Lexicon) -> None:
    seam = splice(letters("MA", lexicon), SpliceOptions(fps=2.0)).seams[0]
    assert "no still hand is found in fs-M and fs-A: they are cut as signs are" in seam.warnings


def test_spelled_words_are_parted(lexicon: Lexicon) -> None:
    tokens = parse("fs-AN fs-NA HELLO", lexicon)
    words = words_of(tokens, lexicon.clip)
    assert [word.starts for word in words] == [True, False, True, False, True]
    parted, joined = splice(words), splice([word.clip for word in words])
    assert parted.seams[1].seconds >= 0.25
    assert joined.seams[1].seconds < 0.2
    assert parted.seams[0].seconds == joined.seams[0].seconds < 0.2


def test_streams_spell_as_splices_do(lexicon: Lexicon) -> None:
    clips = [lexicon.clip("HELLO"), *letters("ANNB", lexicon)]
    whole = splice(marked(clips, starts=[3]), SpliceOptions(cutter="ends"))
    growing = Stream(SpliceOptions(cutter="ends"))
    pieces = [piece for one in marked(clips, starts=[3]) for piece in growing.push(one)] + growing.end()
    assert tuple(piece.span for piece in pieces) == whole.spans
    pulled = stream(marked(clips, starts=[3]), SpliceOptions(cutter="ends"))
    assert tuple(piece.span for piece in pulled) == whole.spans
    spelled = [piece.span.output for piece in stream(letters("ANNA", lexicon))]
    assert spelled == [span.output for span in splice(letters("ANNA", lexicon)).spans]


def test_what_a_user_chooses_is_obeyed(lexicon: Lexicon) -> None:
    clips = letters("AB", lexicon)
    assert splice(clips, SpliceOptions(transition_time=0.5)).seams[0].n_transition == 15
    assert splice(clips, SpliceOptions(duration="fixed")).seams[0].seconds == pytest.approx(0.25, abs=0.02)
    assert splice(clips, SpliceOptions(cutter="ends")).seams[0].pre_frame == len(clips[0]) - 1


def test_a_network_that_is_named_cuts_letters_too(lexicon: Lexicon) -> None:
    clips = letters("AB", lexicon)
    fluent, default, named = (
        splice(clips, SpliceOptions(cutter=name)).spans for name in ("learned-fluent", None, "learned")
    )
    assert default == named != fluent


def test_letters_are_letters_by_names_in_any_case() -> None:
    assert all(map(is_letter, ("fs-A", "FS-a", "Fs-1")))
    assert not any(map(is_letter, ("fs-", "fs-OK", "A")))


def test_a_letter_formed_anew_is_led_around_the_body(lexicon: Lexicon, monkeypatch: pytest.MonkeyPatch) -> None:
    """The depth that a seam reports is that of the frames that are put out."""

    def deep(new: Clip, before: Clip) -> Clip:
        own = arms(new)
        moves = np.zeros((len(new), 2, 3))
        moves[:, 1] = own.shoulders.mean(axis=1) - own.wrists[:, 1] - 0.2 / own.metres * own.up  # into the chest
        return move_wrists(new, moves)

    monkeypatch.setattr(doubled_letters, "reform_letter", deep)
    clips = letters("NN", lexicon)
    result = splice(clips)
    start, stop = result.spans[1].output
    seen = depths(result.clip[start:stop], result.clip[start - 8 : start], result.clip[stop : stop + 8])
    assert result.seams[0].intrusion_mm == pytest.approx(1e3 * seen.max(), abs=1e-6)


def test_a_letter_that_is_hardly_still_is_named(lexicon: Lexicon) -> None:
    first, second = letters("AB", lexicon)
    brief = concatenate([second[:24], second[29:]], name="fs-B")  # still from 21 to 28
    result = splice([first, brief, first])
    assert "fs-B is still for 0.07 s only" in " ".join(result.seams[0].warnings)
    assert result.seams[0].seconds < 0.15


def test_the_hand_that_spells_is_the_one_that_forms_its_letter_anew(lexicon: Lexicon) -> None:
    clips = letters("NN", lexicon)
    result = splice(clips)
    own, (start, stop) = arms(result.clip), result.spans[1].output
    travel = np.linalg.norm(own.wrists[start:stop] - own.wrists[start - 1], axis=-1).max(axis=0) * own.metres
    assert travel[1] > 0.005
    assert travel[0] < 0.003


def test_a_body_that_sways_moves_no_hand_away_from_its_letter(lexicon: Lexicon) -> None:
    still = letters("AB", lexicon)
    swaying = []
    for clip in still:
        local = np.array(clip.local_rotations)
        sway = 0.12 * np.sin(7.0 * np.arange(len(clip)) / clip.fps)[:, None] * [0.4, 1.0, 0.3]
        local[:, 0] = rotation.multiply(rotation.exp(sway), local[:, 0])
        swaying.append(replace(clip, local_rotations=local))
    assert cut_letters(swaying[0], swaying[1], 0, 0.0) == cut_letters(still[0], still[1], 0, 0.0)
