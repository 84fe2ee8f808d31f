"""What is measured of a corpus, against cases that can be counted by hand, and faults that are planted."""

from __future__ import annotations

import contextlib
import json
import shutil
from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from signing import sign, word
from signsplice.errors import InputError
from signsplice.evaluation import corpus_checks, corpus_difficulty, corpus_page, corpus_realism
from signsplice.evaluation.corpus_realism import Quantity
from signsplice.formats import bvh
from signsplice.splicing.cut import CUTTERS, find_cutter
from signsplice.splicing.transition import TRANSITIONS
from signsplice.synth import notation, planner, pose, pseudo
from signsplice.synth.corpus import Pairs, Recipe, scaled_positions, write_pairs
from signsplice.synth.handshapes import HANDSHAPES
from signsplice.synth.signer import JOINTS, STANDARD

Float = NDArray[np.float64]

GLOSSES = ("I", "MOTHER", "BOOK", "YES", "fs-A")
SIGNS = {**notation.everyday(), **notation.alphabet()}


@pytest.fixture(scope="module")
def pairs(tmp_path_factory: pytest.TempPathFactory) -> Pairs:
    recipe = Recipe(tuple(map(sign, GLOSSES)), seed=0, n_other=3)
    return Pairs(write_pairs(recipe, tmp_path_factory.mktemp("study") / "pairs", processes=1))


# --- difficulty


def test_counts_of_positions_found_by_hand() -> None:
    cuts = [(1, 2), (3, 4), (5, 9), (7, 7)]
    truth = [(0, 1, 1, 2), (0, 1, 3, 7), (1, 0, 8, 9), (1, 0, 6, 9)]
    found = corpus_difficulty._found("rule", cuts, truth)
    assert found.exact == pytest.approx(1 / 4)
    assert found.leave == pytest.approx(2 / 4)
    assert found.enter == pytest.approx(2 / 4)
    assert found.near == pytest.approx(2 / 4), "the first, and the last, which is one and two frames off"
    assert found.distance == pytest.approx((0 + 0 + 0 + 3 + 3 + 0 + 1 + 2) / 8)


def test_every_cutter_and_every_told_rule_is_counted(pairs: Pairs) -> None:
    numbers, train = [1, 7, 13, 19], list(range(25))
    told: list[tuple[int, int]] = []
    rows = {row.rule: row for row in corpus_difficulty.cutters(pairs, numbers, train, lambda a, b: told.append((a, b)))}
    assert told == [(n, len(CUTTERS)) for n in range(1, len(CUTTERS) + 1)]
    assert list(rows)[: len(CUTTERS)] == [cutter.name for cutter in CUTTERS.values()]
    truth = pairs.index[numbers, :4].tolist()
    for name in ("ends", "pose-velocity"):
        away = []
        for p, q, pre, post in truth:
            cut = find_cutter(name).cut(pairs.word_clip(p), pairs.word_clip(q))
            away.append((abs(cut.pre - pre), abs(cut.post - post)))
        assert rows[name].distance == pytest.approx(np.mean(away))
        assert rows[name].exact == np.mean([a == (0, 0) for a in away])
    ends = "told: leave as the sign ends, enter as it starts"
    away = [(abs(pairs.events(p).end - pre), abs(pairs.events(q).start - post)) for p, q, pre, post in truth]
    assert rows[ends].leave == np.mean([a == 0 for a, _ in away])
    assert rows[ends].enter == np.mean([b == 0 for _, b in away])
    assert rows[ends].distance == pytest.approx(np.mean(away))


def test_a_reader_without_error_is_always_right_and_one_with_much_is_not(pairs: Pairs) -> None:
    numbers = list(range(25))
    shares = corpus_difficulty.reading(pairs, numbers, SIGNS, (0.0, 8.0))
    assert shares[0.0] == 1.0
    assert 0.0 < shares[8.0] < 1.0
    assert corpus_difficulty.reading(pairs, numbers, SIGNS, (8.0,))[8.0] == shares[8.0]
    assert corpus_difficulty.reading(pairs, numbers, {}, (1.0,)) == {1.0: 0.0}, "no sign known: no pair"


def test_the_best_constants_are_the_commonest(pairs: Pairs) -> None:
    numbers = list(range(25))
    rows = corpus_difficulty.cutters(pairs, numbers, numbers)
    off: Counter[int] = Counter()
    on: Counter[int] = Counter()
    for p, q, pre, post in pairs.index[numbers, :4].tolist():
        before, after = pairs.events(p), pairs.events(q)
        off[pre - (before.passes[-1][1] if before.passes else before.end)] += 1
        on[post - (after.first[0] if after.first else after.start)] += 1
    (row,) = (row for row in rows if "best constants" in row.rule)
    assert row.leave == pytest.approx(off.most_common(1)[0][1] / 25)
    assert row.enter == pytest.approx(on.most_common(1)[0][1] / 25)
    own = rows[-1]
    assert own.rule == "told: the commonest positions of each very word"
    best = [
        Counter(int(pairs.index[k, column]) for k in numbers if pairs.index[k, 0 if column == 2 else 1] == w)
        for column in (2, 3)
        for w in range(5)
    ]
    assert own.leave == pytest.approx(sum(counts.most_common(1)[0][1] for counts in best[:5]) / 25)
    assert own.enter == pytest.approx(sum(counts.most_common(1)[0][1] for counts in best[5:]) / 25)


def test_a_rule_of_each_very_word_needs_each_word_in_training(pairs: Pairs) -> None:
    rows = corpus_difficulty.cutters(pairs, [1], [7, 8])
    assert all("very word" not in row.rule for row in rows)


def test_classical_transitions_are_filled_in_and_scored(pairs: Pairs) -> None:
    rows, true_jump = corpus_difficulty.transitions(pairs, [1, 7, 13])
    scores = {row.transition: row for row in rows}
    assert list(scores) == [transition.name for transition in TRANSITIONS.values()]
    assert scores["hold"].position_error > scores["slerp"].position_error > 0.0
    assert scores["hold"].motion_ratio < scores["slerp"].motion_ratio
    assert scores["hold"].velocity_jump > scores["hermite"].velocity_jump
    assert 0.0 < true_jump < scores["hold"].velocity_jump


# --- life


@pytest.mark.parametrize("plane", [(0, 1), (1, 2)])
def test_an_ellipse_drawn_by_the_two_thirds_law_has_its_exponent(plane: tuple[int, int]) -> None:
    t = np.arange(400) / 100.0
    path = np.zeros((400, 3))
    path[:, plane[0]], path[:, plane[1]] = 0.20 * np.cos(2 * np.pi * t), 0.08 * np.sin(2 * np.pi * t)
    assert corpus_realism.power_law([path], 100.0) == pytest.approx(-1.0 / 3.0, abs=0.01)
    assert corpus_realism.power_law([path, path[:3]], 100.0) == pytest.approx(-1.0 / 3.0, abs=0.01), (
        "short ones are left out"
    )


def test_an_ellipse_at_an_even_pace_has_exponent_zero() -> None:
    fine = np.linspace(0.0, 2.0 * np.pi, 20001)
    curve = np.stack([0.20 * np.cos(fine), 0.08 * np.sin(fine), np.zeros_like(fine)], axis=-1)
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=-1))])
    even = np.stack([np.interp(np.linspace(0.0, length[-1], 300), length, x) for x in curve.T], axis=-1)
    assert corpus_realism.power_law([even], 100.0) == pytest.approx(0.0, abs=0.01)


def test_the_jerk_of_a_cubic_is_its_third_derivative() -> None:
    t = np.arange(50) / 30.0
    path = np.stack([2.0 * t**3 / 6.0 - t**2, 3.0 * t**3 / 6.0 + t, np.full_like(t, 5.0)], axis=-1)
    assert corpus_realism.rms_jerk([path], 30.0) == pytest.approx(np.hypot(2.0, 3.0), rel=1e-9)
    still = np.zeros((50, 3))
    assert corpus_realism.rms_jerk([path, still], 30.0) == pytest.approx(np.sqrt(13.0 / 2.0), rel=1e-9)


def test_bends_of_fingers_are_the_angles_that_were_set() -> None:
    state = np.array(planner.resting(STANDARD))
    degrees = np.zeros(21)
    for n in range(4):
        degrees[4 * n + 2], degrees[4 * n + 3] = 20.0 + 10.0 * n, 5.0 + 6.0 * n
    degrees[19], degrees[20] = 33.0, 44.0
    state[pose.FINGERS], state[33:54] = np.deg2rad(degrees), 0.0
    bends = corpus_realism.flexions(pose.clip(state[None], STANDARD, 30.0))
    assert set(bends) == {f"{finger} {n}" for finger in corpus_realism.FINGERS for n in (1, 2, 3)}
    for n, finger in enumerate(("Index", "Middle", "Ring", "Little")):
        left, right = bends[f"{finger} 2"], bends[f"{finger} 3"]
        assert np.allclose(left, [0.0, 20.0 + 10.0 * n], atol=1e-4)
        assert np.allclose(right, [0.0, 5.0 + 6.0 * n], atol=1e-4)
    assert np.allclose(bends["Thumb 2"], [0.0, 33.0], atol=1e-4)
    assert np.allclose(bends["Thumb 3"], [0.0, 44.0], atol=1e-4)
    knuckle = np.rad2deg(np.arctan2(2.9, 8.5))
    assert np.allclose(bends["Index 1"], knuckle, atol=1e-4), "the palm's own angle, straight fingers"
    fist = state.copy()
    fist[pose.FINGERS] = HANDSHAPES["S"].angles
    assert corpus_realism.flexions(pose.clip(fist[None], STANDARD, 30.0))["Middle 2"][1] == pytest.approx(
        104.0, abs=0.01
    )


def test_quantities_agree_within_a_fifth() -> None:
    def quantity(median: float, *real: float) -> Quantity:
        return Quantity("q", "ms", (1.0, 2.0, median, 4.0, 5.0), real, "nobody")

    five = (160.0, 200.0, 250.0, 320.0, 480.0)
    assert quantity(300.0, *five).agrees
    assert not quantity(301.0, *five).agrees
    assert not quantity(199.0, *five).agrees
    assert quantity(275.0, *five).ratio == pytest.approx(1.1)
    assert quantity(0.50, 0.42, 0.47).agrees
    assert not quantity(0.33, 0.42, 0.47).agrees
    assert quantity(0.5, 0.4, 0.6).ratio == pytest.approx(1.0)
    assert quantity(0.7, 0.69).agrees
    assert not quantity(0.5, 0.69).agrees


def test_times_are_counted_over_all_pairs(pairs: Pairs) -> None:
    transition, kept, alone = corpus_realism.times(pairs)
    own = pairs.index[:25]
    assert transition.ours[2] == pytest.approx(np.median((own[:, 5] + 1) / 30.0 * 1e3))
    spans = [pairs.events(k).end - pairs.events(k).start + 1 for k in range(5)]
    assert alone.ours[2] == pytest.approx(np.median(spans) / 30.0 * 1e3)
    every = [
        own[5 * b + c, 2] - own[5 * a + b, 3] + 1 for a in range(5) for b in range(5) for c in range(5)
    ]  # words a b c: what b keeps
    assert kept.ours[2] == pytest.approx(np.median(every) / 30.0 * 1e3, abs=1e3 / 30.0)
    assert kept.ours[0] < alone.ours[2]


def test_motion_of_pairs_is_measured_where_it_is(pairs: Pairs) -> None:
    seen = corpus_realism.moving(pairs)
    again = corpus_realism.moving(pairs)
    assert np.array_equal(seen.speed, again.speed)
    assert len(seen.peak) == len(seen.start) == len(seen.end) == 25
    assert len(seen.jump) == 50
    assert 0.5 < np.median(seen.peak) < 3.0
    assert (seen.detour >= 1.0 - 1e-6).all()
    means, peaks = corpus_realism.running(pairs, 10)
    assert (means.shape, peaks.shape) == ((10,), (5,))
    assert peaks.min() > means.max(), "a way up from rest is quicker than signing on the whole"
    names = [quantity.name for quantity in corpus_realism.motion_quantities(pairs, seen)]
    assert len(names) == len(set(names)) == 5


# --- soundness


def test_a_sound_corpus_is_found_sound(pairs: Pairs) -> None:
    found = corpus_checks.examine(pairs)
    assert found.n_pairs == 28
    assert found.n_misplaced == 0
    assert found.n_too_deep == 0
    assert max(found.deepest_word_cm, found.deepest_new_cm) < corpus_checks.LIMIT_CM
    assert found.over_limit_deg == 0.0
    assert found.bone_change_cm < 1e-4
    assert found.seam_step_cm <= found.word_step_cm * 1.2
    assert corpus_checks.n_misplaced(pairs, SIGNS) == (25, 0)


def tampered(corpus: Pairs, folder: Path, **changes: NDArray[Any]) -> Pairs:
    """A copy of the corpus with some arrays in place of its own."""
    shutil.copytree(corpus.folder, folder)
    for name, array in changes.items():
        np.save(folder / f"{name}.npy", array)
    return Pairs(folder)


def in_the_chest(n: int) -> Float:
    """States (n, 63) with the strong hand in the breast bone."""
    state = np.array(planner.resting(STANDARD))
    state[:3] = (-6.0, 4.0, 9.0)
    state[3:6] = 0.0
    return np.repeat(state[None], n, axis=0)


def test_a_hand_in_the_chest_is_found(pairs: Pairs, tmp_path: Path) -> None:
    row = pairs.head["words"][1]
    at = slice(row["first"] + 30, row["first"] + 33)
    rotations = np.array(pairs.words["rotations"])
    rotations[at] = pose.rotations(in_the_chest(3), STANDARD)[0]
    found = corpus_checks.examine(tampered(pairs, tmp_path / "word", word_rotations=rotations))
    assert found.deepest_word_cm > 1.0
    assert found.deepest_new_cm < corpus_checks.LIMIT_CM
    assert found.n_too_deep >= 5, "every pair that keeps those frames"
    assert found.word_step_cm > 10.0
    anew, wrong = corpus_checks.n_misplaced(tampered(pairs, tmp_path / "again", word_rotations=rotations), SIGNS)
    assert anew == 25
    assert wrong == found.n_too_deep


def test_a_transition_through_the_chest_is_found(pairs: Pairs, tmp_path: Path) -> None:
    first, count = pairs.index[7, 4:6].tolist()
    new = np.array(pairs.new["rotations"])
    new[first : first + count] = pose.rotations(in_the_chest(count), STANDARD)[0]
    made = tampered(pairs, tmp_path / "new", new_rotations=new)
    found = corpus_checks.examine(made)
    assert found.deepest_new_cm > 1.0
    assert found.deepest_word_cm < corpus_checks.LIMIT_CM
    assert found.n_too_deep == 1
    assert found.seam_step_cm > 5.0
    assert found.seam_turn > 5.0
    assert corpus_checks.n_misplaced(made, SIGNS) == (25, 1)


def test_a_broken_joint_is_found(pairs: Pairs, tmp_path: Path) -> None:
    from signsplice.motion import rotation

    rotations = np.array(pairs.words["rotations"])
    frame = pairs.head["words"][3]["first"] + 20
    rotations[frame, JOINTS["LeftHandMiddle2"]] = rotation.exp([0.0, 0.0, 2.2]) * [1.0, -1.0, -1.0, 1.0]
    found = corpus_checks.examine(tampered(pairs, tmp_path / "joint", word_rotations=rotations))
    assert found.over_limit_deg == pytest.approx(np.rad2deg(2.2) - 105.0, abs=0.2)


def test_misplaced_transitions_are_found(pairs: Pairs, tmp_path: Path) -> None:
    index = np.array(pairs.index)
    index[3, 2] = 1
    index[4, 4] += 1
    found = corpus_checks.examine(tampered(pairs, tmp_path / "index", pairs=index.astype(np.int32)))
    assert found.n_misplaced >= 2


def test_words_that_are_not_known_are_not_signed_anew(pairs: Pairs) -> None:
    some = {gloss: SIGNS[gloss] for gloss in GLOSSES[:2]}
    assert corpus_checks.n_misplaced(pairs, some) == (4, 0)
    assert corpus_checks.n_misplaced(pairs, {}) == (0, 0)


# --- pages


@contextlib.contextmanager
def quiet(what: str) -> Iterator[None]:
    yield None


def without_measuring(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(corpus_page, "_matplotlib", lambda: None)
    monkeypatch.setattr(corpus_page, "_life", lambda *a: ["### True to life", "", "| a | b |", ""])
    monkeypatch.setattr(corpus_page, "_difficulty", lambda *a: ["### Not trivial", ""])
    monkeypatch.setattr(corpus_page, "_soundness", lambda *a: ["### Sound", ""])
    monkeypatch.setattr(corpus_page, "_sheets", lambda *a: None)


def test_a_page_is_filled_between_its_marks_alone(
    pairs: Pairs, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    without_measuring(monkeypatch)
    page = tmp_path / "page.md"
    before, after = "# Corpus\n\nText — with ümlauts.\n\n", "\n\n## More\n"
    page.write_text(f"{before}{corpus_page.BEGIN}\nold, old\n{corpus_page.END}{after}", encoding="utf-8")
    corpus_page.write(pairs, page, tmp_path, {}, quiet)
    text = page.read_text(encoding="utf-8")
    assert text.startswith(before + corpus_page.BEGIN)
    assert text.endswith(corpus_page.END + after)
    assert "old, old" not in text
    middle = text[text.index(corpus_page.BEGIN) : text.index(corpus_page.END)]
    assert f"Corpus `{pairs.head['hash']}`: 28 pairs, seed 0, 30 fps." in middle
    assert [line for line in middle.splitlines() if line.startswith("###")] == [
        *("### True to life", "### Not trivial", "### Sound")
    ]
    corpus_page.write(pairs, page, tmp_path, {}, quiet)
    assert page.read_text(encoding="utf-8") == text, "written again it is the same"


@pytest.mark.parametrize("text", ["# Nothing\n", "only <!-- measured: begin -->\n", "only <!-- measured: end -->\n"])
def test_a_page_without_marks_is_refused_and_kept(
    text: str, pairs: Pairs, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    without_measuring(monkeypatch)
    page = tmp_path / "page.md"
    page.write_text(text)
    with pytest.raises(InputError, match=r"page\.md: has no lines .* expected both") as caught:
        corpus_page.write(pairs, page, tmp_path, {}, quiet)
    assert "\n" not in str(caught.value)
    assert page.read_text() == text
    with pytest.raises(InputError, match="no such file"):
        corpus_page.write(pairs, tmp_path / "none.md", tmp_path, {}, quiet)


def test_a_whole_page_of_a_small_corpus(pairs: Pairs, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("matplotlib")
    pytest.importorskip("PIL")
    monkeypatch.setattr(corpus_page, "SHEET_WORDS", ("I", "BOOK"))
    monkeypatch.setattr(corpus_page, "_write_letters", lambda letters, path: path.write_bytes(b"letters"))
    monkeypatch.setattr(corpus_page, "write_strips", lambda strips, path, **more: path.write_bytes(b"%d" % len(strips)))
    page, images = tmp_path / "page.md", tmp_path / "images"
    images.mkdir()
    page.write_text(f"# Corpus\n{corpus_page.BEGIN}\n{corpus_page.END}\n")
    real = {"a-clip": word("LEARN", 3).clip}
    corpus_page.write(pairs, page, images, real, quiet)
    text = page.read_text()
    for told in (
        "### True to life",
        "### Not trivial",
        "### Sound",
        "a-clip",
        "pose-velocity",
        "hermite",
        "Over all 28 pairs",
    ):
        assert told in text
    assert "| of 25 drawn pairs signed anew, those that differ in any bit | 0 |" in text
    assert (images / "corpus-life.png").stat().st_size > 10_000
    for line in text.splitlines():
        if line.startswith("!["):
            name = line.partition("](")[2].rstrip(")")
            assert (tmp_path / name).exists(), line
    tables = [line for line in text.splitlines() if line.startswith("|")]
    assert all(line.endswith("|") for line in tables)


def test_a_page_of_pseudo_signs(tmp_path: Path) -> None:
    recipe = Recipe((pseudo.sign(0), sign("I")), seed=1, n_other=0)
    made = Pairs(write_pairs(recipe, tmp_path / "pairs", processes=1))
    known = corpus_page._signs(made)
    assert known["PSEUDO-0"] == pseudo.sign(0)
    assert corpus_checks.n_misplaced(made, known) == (4, 0)


def test_real_clips_are_those_that_move(tmp_path: Path) -> None:
    still = word("I").clip[:5]
    for name, clip in (("signing", word("I").clip), ("Idle-1", word("BOOK").clip), ("still", still)):
        bvh.write(clip, tmp_path / f"{name}.bvh")
    (tmp_path / "notes.txt").write_text("no clip")
    assert list(corpus_page.read_real(tmp_path)) == ["signing"]
    assert corpus_page.read_real(None) == {}


def test_positions_are_scaled_alike_everywhere(pairs: Pairs) -> None:
    one = word("MOTHER")
    scaled = scaled_positions(one.clip.local_rotations, one.clip.root_positions, STANDARD)
    assert np.abs(pairs.word(1) - scaled).max() < 1e-6
    head: dict[str, Any] = json.loads((pairs.folder / "corpus.json").read_text())
    assert head["words"][1]["events"] == json.loads(json.dumps(asdict(replace(one.events))))
