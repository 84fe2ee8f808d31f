"""Cards of words: what a splice knows of a word by itself is read, not computed, and changes nothing."""

from __future__ import annotations

import json
import shutil
import sqlite3
import zlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import signsplice as ss
from signsplice import lexicon
from signsplice.lexicon.store import CARD, INDEX
from signsplice.motion import Clip, FloatArray, Skeleton
from signsplice.motion.cache import Cache
from signsplice.motion.clip import StoredCard, stored_card
from signsplice.splicing import bundle, cards
from signsplice.splicing.cards import CARD_VALUES, digest_clip, make_card, recall
from signsplice.splicing.learned import LearnedCutter
from signsplice.splicing.options import choose, open_learned

GLOSSES = ("HELLO", "MY", "NAME", "DEAF", "THANK-YOU", "WHAT")
SHIPPED = Path(lexicon.__file__).parent / "words"
CUTTER = open_learned().cutters["learned"]
_HUGE = zlib.compress(bytes(1 << 22))


@pytest.fixture(autouse=True)
def known(monkeypatch: pytest.MonkeyPatch) -> Cache:
    """What is kept of words in memory: nothing at first."""
    empty = Cache()
    monkeypatch.setattr(cards, "CACHE", empty)
    return empty


def stored(glosses: tuple[str, ...] = GLOSSES, folder: Path = SHIPPED) -> list[Clip]:
    with lexicon.open(folder) as words:
        return [words.clip(gloss) for gloss in glosses]


def fresh(clip: Clip) -> Clip:
    """The same clip, of which nothing is known."""
    return Clip(clip.skeleton, clip.local_rotations, clip.root_positions, clip.fps, clip.name, clip.translations)


def shown(result: ss.SpliceResult) -> tuple[Any, ...]:
    return result.clip.local_rotations.tobytes(), result.clip.root_positions.tobytes(), result.spans, result.warnings


def assert_same(value: Any, other: Any) -> None:
    """Equal, and numbers within what networks differ by between processors."""
    if isinstance(value, np.ndarray):
        np.testing.assert_allclose(value, other, atol=1e-5)
    elif isinstance(value, tuple):
        assert len(value) == len(other)
        for part, other_part in zip(value, other, strict=True):
            assert_same(part, other_part)
    elif hasattr(value, "__dataclass_fields__"):
        assert_same(tuple(vars(value).values()), tuple(vars(other).values()))
    else:
        assert value == pytest.approx(other, abs=1e-5) if isinstance(value, float) else value == other


def test_every_word_that_ships_has_a_card_of_what_its_frames_give() -> None:
    with lexicon.open(SHIPPED) as words:
        for entry in words.entries():
            clip = words.clip(entry.gloss)
            again = fresh(clip)
            recall(clip, CUTTER)
            assert all(clip.derived.shared[value] is not None for value in (*CARD_VALUES, CUTTER.ends)), entry.gloss
            for value in (*CARD_VALUES, CUTTER.ends):
                assert_same(clip.derived[value], again.derived[value])


def test_a_splice_of_stored_words_opens_no_word_network(monkeypatch: pytest.MonkeyPatch) -> None:
    names = list[str]()
    run = bundle.Sessions.run

    def spied(self: bundle.Sessions, name: str, *args: Any, **keywords: Any) -> dict[str, FloatArray]:
        names.append(name)
        return run(self, name, *args, **keywords)

    monkeypatch.setattr(bundle.Sessions, "run", spied)
    ss.splice(stored())
    assert names
    assert set(names) == {"bridge"}
    ss.splice([fresh(clip) for clip in stored()])
    assert "word" in names


@pytest.mark.parametrize("fps", [None, 24.0])
def test_a_splice_is_the_same_with_cards_without_and_from_memory(
    fps: float | None, tmp_path: Path, known: Cache
) -> None:
    options = ss.SpliceOptions(fps=fps)
    ss.lexicon.build(_clips(tmp_path), tmp_path / "lex", make_card=make_card)
    ss.lexicon.build(tmp_path / "clips", tmp_path / "bare")
    of_cards = shown(ss.splice(stored(folder=tmp_path / "lex"), options))
    known.clear()
    computed = shown(ss.splice(stored(folder=tmp_path / "bare"), options))
    from_memory = shown(ss.splice(stored(folder=tmp_path / "bare"), options))
    files = shown(ss.splice([fresh(clip) for clip in stored(folder=tmp_path / "bare")], options))
    assert of_cards == computed == from_memory == files


def _clips(tmp_path: Path) -> Path:
    (tmp_path / "clips").mkdir()
    for clip in stored():
        ss.save(clip, tmp_path / "clips" / f"{clip.name}.npz")
    return tmp_path / "clips"


@pytest.mark.parametrize("harm", ["cut short", "of another word", "no card", "not a card", "huge"])
def test_a_card_that_does_not_belong_is_not_used(harm: str, tmp_path: Path, known: Cache) -> None:
    expected = shown(ss.splice(stored()))
    shutil.copytree(SHIPPED, tmp_path / "lex")
    with sqlite3.connect(tmp_path / "lex" / INDEX) as index:
        rows = index.execute("SELECT word, value FROM extension WHERE name = ?", (CARD,)).fetchall()
        of_others = [*rows[1:], rows[0]]
        for (word, card), (_, other) in zip(rows, of_others, strict=True):
            harmed = {
                "cut short": card[:-9], "of another word": other, "no card": b"", "not a card": b"{}", "huge": _HUGE,
            }[harm]  # fmt: skip
            index.execute("UPDATE extension SET value = ? WHERE word = ? AND name = ?", (harmed, word, CARD))
    known.clear()
    with lexicon.open(tmp_path / "lex") as words:
        words.verify()
    assert shown(ss.splice(stored(folder=tmp_path / "lex"))) == expected


@pytest.mark.parametrize(
    "change",
    [
        {"motion": ["a", None, ""]}, {"motion": [5, 4, []]}, {"owns": ["tail"]}, {"placement": [[1e300] * 3] * 3},
        {"ends": [[0, [0, 10**6], None, 10, 10**6]] * 2}, {"ends": [[0, [0, 5], [0, 900], 10, 5]] * 2},
        {"ends": [[0, [0, 5], None, 10**30, 5]] * 2}, {"low": [[[9.0] * 4] * 2, None]}, {"keyed": [1]}, {"hands": "x"},
        {"ends": []},
    ],
)  # fmt: skip
def test_a_card_that_holds_what_no_word_has_is_not_used(change: dict[str, Any]) -> None:
    (clip,) = stored(("HELLO",))
    line, _, numbers = zlib.decompress(make_card(clip, "0" * 64)).partition(b"\n")
    head = json.loads(line) | change
    fake = fresh(clip)
    fake.derived[stored_card] = StoredCard("0" * 64, zlib.compress(json.dumps(head).encode() + b"\n" + numbers))
    recall(fake, CUTTER)
    assert set(fake.derived.shared.values()) == {None}
    nested = fresh(clip)
    nested.derived[stored_card] = StoredCard("1" * 64, zlib.compress(b"[" * 200_000))
    recall(nested, CUTTER)
    assert set(nested.derived.shared.values()) == {None}


def test_what_is_kept_names_no_other_cutter() -> None:
    (clip,) = stored(("HELLO",))
    recall(clip, CUTTER)
    other = LearnedCutter(CUTTER.reader)
    again = stored(("HELLO",))[0]
    recall(again, other)
    assert set(again.derived.shared) == {*CARD_VALUES, other.ends}, "networks of other bundles can close"
    recall(again, CUTTER)
    assert CUTTER.ends in again.derived.shared, "the same clip serves both"


def test_a_damaged_card_is_a_fault_of_its_lexicon(tmp_path: Path) -> None:
    shutil.copytree(SHIPPED, tmp_path / "lex")
    with sqlite3.connect(tmp_path / "lex" / INDEX) as index:
        index.execute("UPDATE extension SET value = substr(value, 1, 900) WHERE name = ? AND word = 1", (CARD,))
    with lexicon.open(tmp_path / "lex") as words:
        (fault,) = words.faults()
    assert "its card is damaged, and computed anew" in fault


def test_ends_of_another_cutter_are_not_used() -> None:
    clip, other = stored(("HELLO",))[0], choose("pose-velocity").cutter
    recall(clip, other)
    assert set(clip.derived.shared) == set(CARD_VALUES)
    again = stored(("HELLO",))[0]
    recall(again, CUTTER)
    assert again.derived.shared[CUTTER.ends] is not None, "they are read when they are wanted"


def test_clips_with_other_frames_skeletons_or_notes_share_nothing() -> None:
    (clip,) = stored(("HELLO",))
    larger = Skeleton(clip.skeleton.names, clip.skeleton.parents, 2.0 * clip.skeleton.offsets)
    others = (
        clip[:-1], replace(fresh(clip), fps=25.0), replace(fresh(clip), notes=("a note",)),
        replace(fresh(clip), skeleton=larger),
    )  # fmt: skip
    assert digest_clip(clip) == digest_clip(fresh(clip))
    assert len({digest_clip(other) for other in (clip, *others)}) == 5


def test_a_card_is_a_few_kilobytes() -> None:
    (clip,) = stored(("HELLO",))
    card = make_card(clip, "0" * 64)
    assert 200 < len(card) < 12_000
    clip.derived[stored_card] = StoredCard("1" * 64, card)
    recall(clip, CUTTER)
    assert set(clip.derived.shared.values()) == {None}, "of other frames"
