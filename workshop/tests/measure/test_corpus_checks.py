"""Checks of a corpus: faults that are put into it are found."""

from __future__ import annotations

import json
import shutil
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from signing import sign
from signsplice.motion import FloatArray, rotation
from signsplice.signer import notation, planner, pose
from signsplice.signer.locations import resting
from signsplice.signer.signer import JOINTS, STANDARD
from signsplice_workshop.corpora.pairs import Pairs, normalise_positions
from signsplice_workshop.corpora.touches import measure_touches
from signsplice_workshop.measure import corpus_checks

SIGNS = {**notation.everyday(), **notation.alphabet()}


def test_a_valid_corpus_passes_all_checks(pairs: Pairs) -> None:
    found = corpus_checks.examine(pairs)
    assert found.n_pairs == 28
    assert found.n_misplaced == 0
    assert found.n_too_deep == 0
    assert max(found.deepest_word_cm, found.deepest_transition_cm) < corpus_checks.LIMIT_CM
    assert found.over_limit_deg == 0.0
    assert found.bone_change_cm < 1e-4
    assert found.transition_step_cm <= found.word_step_cm * 1.4
    assert corpus_checks.replan(pairs, SIGNS) == (25, 0)


def with_arrays(corpus: Pairs, folder: Path, **changes: NDArray[Any]) -> Pairs:
    """A copy of the corpus with some arrays replaced."""
    shutil.copytree(corpus.folder, folder)
    for name, array in changes.items():
        np.save(folder / f"{name}.npy", array)
    return Pairs(folder)


def in_the_chest(n: int) -> FloatArray:
    """States (n, 65) with the strong hand in the breast bone."""
    state = np.array(resting(STANDARD))
    state[:3] = (-6.0, 4.0, 9.0)
    state[3:6] = 0.0
    return np.repeat(state[None], n, axis=0)


def test_a_hand_in_the_chest_is_found(pairs: Pairs, tmp_path: Path) -> None:
    row = pairs.head["words"][1]
    frames = slice(row["first"] + 30, row["first"] + 33)
    rotations = np.array(pairs.words["rotations"])
    rotations[frames] = pose.rotations(in_the_chest(3), STANDARD)[0]
    changed = with_arrays(pairs, tmp_path / "word", word_rotations=rotations)
    found = corpus_checks.examine(changed)
    assert found.deepest_word_cm > 1.0
    assert found.deepest_transition_cm < corpus_checks.LIMIT_CM
    assert found.n_too_deep >= 5, "every pair that keeps those frames"
    assert found.word_step_cm > 10.0
    n_replanned, n_different = corpus_checks.replan(changed, SIGNS)
    assert n_replanned == 25
    assert n_different == found.n_too_deep


def test_a_transition_through_the_chest_is_found(pairs: Pairs, tmp_path: Path) -> None:
    first, count = pairs.index[7, 4:6].tolist()
    new = np.array(pairs.new["rotations"])
    new[first : first + count] = pose.rotations(in_the_chest(count), STANDARD)[0]
    made = with_arrays(pairs, tmp_path / "new", new_rotations=new)
    found = corpus_checks.examine(made)
    assert found.deepest_transition_cm > 1.0
    assert found.deepest_word_cm < corpus_checks.LIMIT_CM
    assert found.n_too_deep == 1
    assert found.transition_step_cm > 5.0
    assert found.seam_wrist_change_cm > 5.0
    assert corpus_checks.replan(made, SIGNS) == (25, 1)


def test_a_broken_joint_is_found(pairs: Pairs, tmp_path: Path) -> None:
    rotations = np.array(pairs.words["rotations"])
    frame = pairs.head["words"][3]["first"] + 20
    rotations[frame, JOINTS["LeftHandMiddle2"]] = rotation.exp([0.0, 0.0, 2.2]) * [1.0, -1.0, -1.0, 1.0]
    found = corpus_checks.examine(with_arrays(pairs, tmp_path / "joint", word_rotations=rotations))
    assert found.over_limit_deg == pytest.approx(np.rad2deg(2.2) - 105.0, abs=0.2)


def test_misplaced_transitions_are_found(pairs: Pairs, tmp_path: Path) -> None:
    index = np.array(pairs.index)
    index[3, 2] = 1
    index[4, 4] += 1
    found = corpus_checks.examine(with_arrays(pairs, tmp_path / "index", pairs=index.astype(np.int32)))
    assert found.n_misplaced >= 2


def test_pairs_of_unknown_signs_are_not_planned_anew(pairs: Pairs) -> None:
    some = {gloss: SIGNS[gloss] for gloss in ("I", "MOTHER")}
    assert corpus_checks.replan(pairs, some) == (4, 0)
    assert corpus_checks.replan(pairs, {}) == (0, 0)


def test_positions_are_scaled_alike_everywhere(pairs: Pairs) -> None:
    one = planner.synthesize_word(sign("MOTHER"), STANDARD)
    scaled = normalise_positions(one.clip, STANDARD.stature_cm)
    assert np.abs(pairs.word(1) - scaled).max() < 1e-6
    head: dict[str, Any] = json.loads((pairs.folder / "corpus.json").read_text())
    assert head["words"][1]["events"] == json.loads(json.dumps(asdict(measure_touches(one))))
