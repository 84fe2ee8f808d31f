"""Training data: parts depend on the seed alone, hold what the signer made, and continue after an interruption."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from signsplice.errors import InputError
from signsplice.motion import rotation
from signsplice.rig.info import LEFT, ROLES, TIPS, canonical_motion
from signsplice.signer import planner
from signsplice.signer.phonology import Sign
from signsplice.signer.signer import RESTS, TRAITS, draw_signer, stream
from signsplice_workshop.corpora import pseudo, training_data, truth
from signsplice_workshop.corpora.training_data import TrainingDataPlan

PLAN = TrainingDataPlan(n_signers=2, n_words=4, n_seams=5, seed=3, fps=20.0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made: Path = tmp_path_factory.mktemp("endless") / "parts"
    reported: list[tuple[int, int]] = []
    assert training_data.write(PLAN, made, lambda a, b: reported.append((a, b)), processes=1) == 2
    assert reported == [(1, 2), (2, 2)]
    return made


def test_words_pairs_and_events_are_the_signers(folder: Path) -> None:
    part = np.load(training_data.locate_part(folder, PLAN, 1))
    signer = draw_signer(training_data.FIRST_SIGNER + 30_001)
    seeds = stream("endless", 3, 1).integers(2**40, size=4).tolist()
    words = [planner.synthesize_word(pseudo.draw_sign(int(k)), signer, fps=20.0) for k in seeds]
    assert part["words"][:, 1].tolist() == [len(word) for word in words]
    for k, word in enumerate(words):
        first, n = part["words"][k]
        motion = canonical_motion(word.clip)
        quats = rotation.normalize(part["turns"][first : first + n] / 32767.0)
        np.testing.assert_allclose(rotation.angle_between(quats, motion.quats), 0.0, atol=1e-3)
        np.testing.assert_allclose(part["places"][first : first + n], motion.positions, atol=1e-5)
        moves = [word.events.first, word.events.passes[-1]] if word.events.first else [(-1, -1)] * 2
        assert part["events"][k, 4:].tolist() == [frame for move in moves for frame in move]
        assert part["events"][k, :4].tolist() == [getattr(word.events, e) for e in ("up", "start", "end", "down")]
    for p in range(4):
        for q in range(4):
            assert tuple(part["pairs"][p, q, :2].tolist()) == truth.find_cut(words[p], words[q])
            assert part["pairs"][p, q, 2] <= len(truth.splice(words[p], words[q]).states)


def test_signers_rest_in_every_rest_pose() -> None:
    counts = Counter(training_data.with_rest(draw_signer(number)).rest for number in range(200))
    assert set(counts) == set(RESTS)
    assert 70 < counts["hanging"] < 130, "half of them let their arms hang"
    assert training_data.with_rest(draw_signer(3)) == training_data.with_rest(draw_signer(3))


def test_bones_and_quaternions_put_the_hands_at_their_positions(folder: Path) -> None:
    part = np.load(training_data.locate_part(folder, PLAN, 0))
    signer = draw_signer(training_data.FIRST_SIGNER + 30_000)
    clip = planner.synthesize_word(
        pseudo.draw_sign(int(stream("endless", 3, 0).integers(2**40, size=4)[0])), signer, fps=20.0
    ).clip
    motion = canonical_motion(clip)
    local = rotation.to_matrix(motion.quats)
    rotations, position, positions = np.eye(3), np.zeros((len(clip), 3)), {}
    for role in ("Shoulder", "UpperArm", "LowerArm", "Hand"):
        row = ROLES.index(f"left{role}")
        position = position + rotations @ part["bones"][row]
        rotations = rotations @ local[:, row]
        positions[role] = position
    shoulder, upper_arm = ROLES.index("rightShoulder"), ROLES.index("rightUpperArm")
    right = part["bones"][shoulder] + local[:, shoulder] @ part["bones"][upper_arm]
    middle = 0.5 * (positions["UpperArm"] + right)
    np.testing.assert_allclose(positions["Hand"] - middle, motion.positions[:, TIPS.index("leftHand")], atol=1e-6)
    assert LEFT.start == ROLES.index("leftShoulder")


def test_seams_lie_in_their_sentences(folder: Path) -> None:
    part = np.load(training_data.locate_part(folder, PLAN, 0))
    assert len(part["seams"]) >= 5
    n_words = part["words"][:, 1].sum()
    assert part["sentences"][0, 0] == n_words
    assert part["sentences"][-1].sum() == len(part["turns"]) == len(part["places"])
    for sentence, start, n in part["seams"]:
        assert 0 < start < start + n < part["sentences"][sentence, 1]
        assert n >= 2


def test_existing_parts_are_kept_and_a_missing_one_is_made_alike(folder: Path, tmp_path: Path) -> None:
    first, second = (training_data.locate_part(folder, PLAN, number) for number in (0, 1))
    before = first.stat().st_mtime_ns
    reported: list[tuple[int, int]] = []
    second.rename(tmp_path / "second.npz")
    training_data.write(PLAN, folder, lambda a, b: reported.append((a, b)), processes=1)
    assert reported == [(2, 2)]
    assert first.stat().st_mtime_ns == before
    made_again = np.load(second)
    for name, values in np.load(tmp_path / "second.npz").items():
        np.testing.assert_array_equal(values, made_again[name])
    with pytest.raises(InputError, match="expected at least 1 signer"):
        training_data.write(TrainingDataPlan(n_signers=0), tmp_path)


@pytest.mark.parametrize("left", [0.0, 0.5, 0.99])
def test_a_part_that_is_cut_off_is_made_again(left: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(training_data, "make_part", lambda plan, number: {"turns": np.full(99, number)})
    training_data.write(PLAN, tmp_path, processes=1)
    path = training_data.locate_part(tmp_path, PLAN, 1)
    content = path.read_bytes()
    path.write_bytes(content[: int(left * len(content))])
    reported: list[tuple[int, int]] = []
    training_data.write(PLAN, tmp_path, lambda a, b: reported.append((a, b)), processes=1)
    assert reported == [(2, 2)]
    assert path.read_bytes() == content


def test_names_of_parts_tell_the_traits() -> None:
    names = {
        traits: training_data.locate_part(Path(), replace(PLAN, traits=traits), 1).name
        for traits in (None, (), ("undershoot",), ("undershoot", "low_elbows"), ("low_elbows", "undershoot"), TRAITS)
    }
    assert names[None] == names[TRAITS] == training_data.locate_part(Path(), PLAN, 1).name
    assert "-plain-" in names[()]
    assert "-undershoot-" in names[("undershoot",)]
    assert "-low_elbows+undershoot-" in names[("undershoot", "low_elbows")]
    assert len(set(names.values())) == 4
    assert names[("undershoot", "low_elbows")] == names[("low_elbows", "undershoot")], "the order does not matter"
    everything = training_data.locate_part(Path(), replace(PLAN, traits=TRAITS[1:]), 1).name
    assert len(everything) < 255, "a file system takes the name"
    with pytest.raises(InputError, match="no trait 'speed', expected some of low_pass_frames,"):
        training_data.write(replace(PLAN, traits=("speed",)), Path("nowhere"))


def test_plans_that_differ_in_traits_share_bodies_and_words(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: list[int] = []
    draw = pseudo.draw_sign

    def sign(seed: int) -> Sign:
        drawn.append(seed)
        return draw(seed)

    monkeypatch.setattr(pseudo, "draw_sign", sign)
    plan = TrainingDataPlan(n_signers=1, n_words=2, n_seams=1, seed=4, fps=12.0)
    plans = [(replace(plan, traits=traits), tmp_path / name) for name, traits in (("none", ()), ("one", TRAITS[:1]))]
    reported: list[tuple[int, int]] = []
    training_data.write_all(plans, lambda a, b: reported.append((a, b)), processes=1)
    assert reported == [(1, 2), (2, 2)]
    assert len(drawn) == 2, "each pseudo-sign is drawn once"
    one, other = (np.load(training_data.locate_part(folder, plan, 0)) for plan, folder in plans)
    np.testing.assert_array_equal(one["bones"], other["bones"])
