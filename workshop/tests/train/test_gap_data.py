"""Training data of the network that makes transitions: what gaps hide, how they are drawn and augmented."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from signsplice.motion import Clip, rotation  # noqa: E402
from signsplice.rig.info import ROLES, canonical_motion  # noqa: E402
from signsplice.splicing import features as gap_features  # noqa: E402
from signsplice.splicing.contracts import Gap  # noqa: E402
from signsplice.splicing.curves import find_transition  # noqa: E402
from signsplice_workshop.corpora.rekeying import KEY_FRAMES, with_keys  # noqa: E402
from signsplice_workshop.train import gap_data  # noqa: E402
from signsplice_workshop.train.gap_data import GapDataset, read_signer  # noqa: E402
from training_toys import signing  # noqa: E402


@pytest.fixture(scope="module")
def signer_file() -> Path:
    """The file of one signer with four words and six seams."""
    return next(signing(1, 4, 6, 5).glob("*.npz"))


@pytest.fixture(scope="module")
def gaps(signer_file: Path) -> GapDataset:
    """Gaps of that signer, to train on."""
    return GapDataset([signer_file])


def clip_of(gaps: GapDataset, quats: np.ndarray) -> Clip:
    """Canonical rotations (T, R, 4) as a clip on the first signer's skeleton."""
    local_quats = np.concatenate([np.broadcast_to(rotation.IDENTITY, (len(quats), 1, 4)), quats], axis=1)
    return Clip(gaps.signers[0][0].skeleton, local_quats, np.zeros((len(quats), 3)), 30.0)


def test_the_canonical_skeleton_shows_the_stored_motion(signer_file: Path, gaps: GapDataset) -> None:
    signer = read_signer(signer_file)
    with np.load(signer_file) as stored:
        first, n_frames = stored["sentences"][0]
        positions = stored["places"][first : first + n_frames]
    motion = canonical_motion(clip_of(gaps, signer.sentences[0]))
    np.testing.assert_allclose(rotation.angle_between(motion.quats, signer.sentences[0]), 0, atol=1e-3)
    np.testing.assert_allclose(motion.positions, positions, atol=2e-3)


def test_a_gap_hides_the_signed_frames(gaps: GapDataset) -> None:
    signer = gaps.signers[0][0]
    sentence, start, n_gap = signer.seams[0]
    quats = signer.sentences[sentence][start - 8 : start + n_gap + 8]
    arrays = gaps.make_arrays(signer, quats, 8, n_gap)
    assert arrays["tokens"].shape == (gap_features.N_SEEN, gap_features.N_TOKEN)
    gap = Gap(clip_of(gaps, quats[:8]), clip_of(gaps, quats[8 + n_gap :]), n_gap)
    base = find_transition("hermite").between(gap)
    local_quats = np.concatenate([np.tile(rotation.IDENTITY, (n_gap, 1, 1)), arrays["base"].astype(float)], axis=1)
    found = canonical_motion(replace(base, local_rotations=local_quats))
    flipped = not np.allclose(rotation.to_6d(found.quats), rotation.to_6d(canonical_motion(base).quats), atol=1e-4)
    hidden = clip_of(gaps, quats[8 : 8 + n_gap])
    for clip, quats_found in ((base, found.quats), (hidden, arrays["true"].astype(float))):
        expected = canonical_motion(clip).mirror() if flipped else canonical_motion(clip)
        np.testing.assert_allclose(rotation.to_6d(quats_found), rotation.to_6d(expected.quats), atol=1e-5)


def test_gaps_depend_on_their_number_and_never_repeat(signer_file: Path, gaps: GapDataset) -> None:
    batch = gaps.batch([3, 9])
    assert torch.equal(batch.tokens, gaps.batch([3, 9]).tokens)
    assert not torch.equal(batch.tokens, gaps.batch([4, 10]).tokens)
    assert not set(gaps.rows(0, 8, 0).tolist()) & set(gaps.rows(1, 8, 0).tolist())
    assert len(GapDataset([signer_file], n_fixed=12)) == 12
    batches = [gaps.batch(gaps.rows(step, 12, 0)) for step in range(4)]
    seams = torch.cat([batch.seam for batch in batches])
    assert seams.any()
    assert (~seams).any()


def test_training_gaps_are_augmented_and_validation_gaps_are_not(signer_file: Path, gaps: GapDataset) -> None:
    fixed = GapDataset([signer_file], n_fixed=60)
    chest = ROLES.index("chest")
    chest_angles = []
    for dataset in (fixed, gaps):
        drawn = [dataset.draw_gap(number) for number in range(60)]
        angles = [rotation.angle_between(gap["true"][0, chest], rotation.IDENTITY) for gap in drawn]
        chest_angles.append(np.mean(angles))
        short = [gap for gap in drawn if len(gap["true"]) <= 5]
        assert len(short) > 2
        # The shown and the hidden frames are changed alike, so that they still meet.
        assert max(rotation.angle_between(gap["base"], gap["true"]).mean() for gap in short) < 0.2
    assert chest_angles[1] > 2.0 * chest_angles[0]
    np.testing.assert_array_equal(fixed.draw_gap(3)["tokens"], fixed.draw_gap(3)["tokens"])


def test_hidden_stretches_have_a_target_short_of_the_truth(signer_file: Path) -> None:
    partial, whole = GapDataset([signer_file], seed=4), GapDataset([signer_file], seed=4)
    whole.stretch_target = 1.0
    fractions: dict[bool, list[float]] = {True: [], False: []}
    for number in range(40):
        one, other = partial.draw_gap(number), whole.draw_gap(number)
        np.testing.assert_array_equal(one["tokens"], other["tokens"])
        base = other["base"].astype(float)
        distance = rotation.angle_between(base, other["true"].astype(float)).sum()
        if distance > 1e-3:  # some stand still
            target = rotation.angle_between(base, one["true"].astype(float)).sum()
            fractions[bool(one["seam"])].append(target / distance)
    np.testing.assert_allclose(fractions[True], 1.0, atol=1e-5)
    np.testing.assert_allclose(fractions[False], gap_data.STRETCH_TARGET, atol=0.01)


@pytest.mark.parametrize("seed", range(6))
def test_motion_drawn_between_keys_keeps_the_keys_and_lies_on_few_pieces(signer_file: Path, seed: int) -> None:
    quats = read_signer(signer_file).sentences[0]
    drawn = with_keys(quats, np.random.default_rng(seed))
    off = rotation.angle_between(drawn, quats).max(axis=1)
    keys = np.flatnonzero(off < 1e-5)
    assert np.diff(keys).max() <= KEY_FRAMES[1]
    assert len(keys) < 0.7 * len(quats)
    assert np.median(off) < 0.3
