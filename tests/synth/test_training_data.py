"""Signing without end: parts by seed alone, true to the signer that made them, and gone on with."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from signsplice.errors import InputError
from signsplice.motion import rotation
from signsplice.rig.canonical import canonical_motion
from signsplice.rig.canonical_map import LEFT, ROLES, TIPS
from signsplice.synth import planner, pseudo, training_data, truth
from signsplice.synth.rng import stream
from signsplice.synth.signer import RESTS, draw_signer
from signsplice.synth.training_data import TrainingDataPlan

PLAN = TrainingDataPlan(n_signers=2, n_words=4, n_seams=5, seed=3, fps=20.0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made: Path = tmp_path_factory.mktemp("endless") / "parts"
    told: list[tuple[int, int]] = []
    assert training_data.write(PLAN, made, lambda a, b: told.append((a, b)), processes=1) == 2
    assert told == [(1, 2), (2, 2)]
    return made


def test_words_pairs_and_events_are_the_signers(folder: Path) -> None:
    part = np.load(training_data.path_of(folder, PLAN, 1))
    who = draw_signer(training_data.FIRST_SIGNER + 30_001)
    seeds = stream("endless", 3, 1).integers(2**40, size=4).tolist()
    words = [planner.isolated(pseudo.sign(int(k)), who, fps=20.0) for k in seeds]
    assert part["words"][:, 1].tolist() == [len(word) for word in words]
    for k, word in enumerate(words):
        first, n = part["words"][k]
        seen = canonical_motion(word.clip)
        turns = rotation.normalize(part["turns"][first : first + n] / 32767.0)
        np.testing.assert_allclose(rotation.angle_between(turns, seen.quats), 0.0, atol=1e-3)
        np.testing.assert_allclose(part["places"][first : first + n], seen.positions, atol=1e-5)
        moves = [word.events.first, word.events.passes[-1]] if word.events.first else [(-1, -1)] * 2
        assert part["events"][k, 4:].tolist() == [frame for move in moves for frame in move]
        assert part["events"][k, :4].tolist() == [getattr(word.events, e) for e in ("up", "start", "end", "down")]
    for p in range(4):
        for q in range(4):
            seen_both = truth.relate(words[p], words[q])
            expected = [truth.leave(words[p], seen_both), truth.enter(words[q], seen_both)]
            assert part["pairs"][p, q, :2].tolist() == expected
            assert part["pairs"][p, q, 2] <= len(truth.splice(words[p], words[q]).states)
            pre, post, n = part["asides"][p, q]
            assert n == truth.transition_frames(words[p].states[pre], words[q].states[post], words[p])
    asides, cuts = part["asides"][..., :2], part["pairs"][..., :2]
    assert np.abs(asides - cuts).max() < 20, "near the true cut"
    assert (asides != cuts).mean() > 0.5, "and seldom at it"


def test_signers_rest_in_all_ways() -> None:
    ways = Counter(training_data.with_rest(draw_signer(number)).rest for number in range(200))
    assert set(ways) == set(RESTS)
    assert 70 < ways["hanging"] < 130, "half of them let their arms hang"
    assert training_data.with_rest(draw_signer(3)) == training_data.with_rest(draw_signer(3))


def test_bones_and_turns_put_the_hands_where_they_are(folder: Path) -> None:
    part = np.load(training_data.path_of(folder, PLAN, 0))
    who = draw_signer(training_data.FIRST_SIGNER + 30_000)
    clip = planner.isolated(pseudo.sign(int(stream("endless", 3, 0).integers(2**40, size=4)[0])), who, fps=20.0).clip
    seen = canonical_motion(clip)
    turns = rotation.to_matrix(seen.quats)
    trunk = np.eye(3)
    place = np.zeros((len(clip), 3))
    places = {}
    for role in ("Shoulder", "UpperArm", "LowerArm", "Hand"):
        row = ROLES.index(f"left{role}")
        place = place + trunk @ part["bones"][row]
        trunk = trunk @ turns[:, row]
        places[role] = place
    right = (
        part["bones"][ROLES.index("rightShoulder")]
        + turns[:, ROLES.index("rightShoulder")] @ part["bones"][ROLES.index("rightUpperArm")]
    )
    middle = 0.5 * (places["UpperArm"] + right)
    np.testing.assert_allclose(places["Hand"] - middle, seen.positions[:, TIPS.index("leftHand")], atol=1e-6)
    assert LEFT.start == ROLES.index("leftShoulder")


def test_seams_lie_in_their_sentences(folder: Path) -> None:
    part = np.load(training_data.path_of(folder, PLAN, 0))
    assert len(part["seams"]) >= 5
    n_words = part["words"][:, 1].sum()
    assert part["sentences"][0, 0] == n_words
    assert part["sentences"][-1].sum() == len(part["turns"]) == len(part["places"])
    for sentence, start, n in part["seams"]:
        assert 0 < start < start + n < part["sentences"][sentence, 1]
        assert n >= 2


def test_what_is_there_is_kept_and_the_rest_made_alike(folder: Path, tmp_path: Path) -> None:
    first = training_data.path_of(folder, PLAN, 0)
    before = first.stat().st_mtime_ns
    told: list[tuple[int, int]] = []
    again = training_data.path_of(folder, PLAN, 1).read_bytes()
    training_data.path_of(folder, PLAN, 1).unlink()
    training_data.write(PLAN, folder, lambda a, b: told.append((a, b)), processes=1)
    assert told == [(2, 2)]
    assert first.stat().st_mtime_ns == before
    other = np.load(training_data.path_of(folder, PLAN, 1))
    (tmp_path / "again.npz").write_bytes(again)
    for name, values in np.load(tmp_path / "again.npz").items():
        np.testing.assert_array_equal(values, other[name])
    with pytest.raises(InputError, match="expected at least 1 signer"):
        training_data.write(TrainingDataPlan(n_signers=0), tmp_path)
