"""The paper's systems on clips: positions become rotations again, and clips of other kinds are refused."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import signsplice as ss
from registration import registered  # noqa: F401
from signing import word
from signsplice.errors import InputError
from signsplice.motion import Clip, kinematics
from signsplice.splicing.word import AlignedWord, FrameMap
from signsplice_paper.systems.clips import ClipSplicer, open_clip_splicer
from signsplice_paper.systems.splicers import TwoNetworkSystem
from signsplice_workshop.train.bundles import write_bundle
from test_paper_systems import Fakes, fake_system, tokens

Array = NDArray[Any]
FR = 3
CONFIG: dict[str, Any] = {
    "system": "lpt-plus",
    "corpus": "c0ffee",
    "scale": "smoke",
    "fps": 30.0,
    "fr": FR,
    "runs": {"positions": "spsn", "frames": "generator", "concurrent": False, "n_fed": 159, "most_frames": 32},
}


def inner(inputs: Mapping[str, Array]) -> dict[str, Array]:
    """An encoder whose memory is the two inner culled frames."""
    return {"memory_0": inputs["x"][:, FR - 1 : FR + 1]}


def straight(inputs: Mapping[str, Array]) -> dict[str, Array]:
    """A decoder of seven frames on the line between the two."""
    start, end = inputs["memory_0"][0]
    at = int(inputs["start"]) + 1 + np.arange(inputs["fed"].shape[1])
    alpha = at[:, None] / 8
    return {"made": ((1 - alpha) * start + alpha * end)[None], "last": np.where(at >= 7, 1.0, -1.0)[None]}


def splicer(pre: int | None = 30, post: int | None = 20, kind: type = TwoNetworkSystem, **changes: Any) -> ClipSplicer:
    graphs = Fakes(
        {
            "spsn": lambda inputs: tokens(
                inputs["x"].shape[1], pre, None if post is None else int(inputs["n_before"][0]) + post
            ),
            "encoder": inner,
            "decoder": straight,
        }
    )
    return ClipSplicer(fake_system(kind, graphs, **{**CONFIG, **changes}))


BEFORE, AFTER = word("MOTHER").clip, word("BOOK").clip


def positions(clip: Clip) -> Array:
    return kinematics.forward(clip)[1]


def test_a_transition_follows_the_predicted_positions() -> None:
    kept, follows = (AlignedWord(0, clip, clip, FrameMap()) for clip in (BEFORE, AFTER))
    made = splicer().splice_words(kept, follows).new_frames
    assert len(made) == 7
    alpha = np.arange(1, 8)[:, None, None] / 8
    line = (1 - alpha) * positions(BEFORE)[30] + alpha * positions(AFTER)[20]
    np.testing.assert_allclose(made.root_positions, line[:, 0], atol=1e-4)
    # Bones keep their lengths, which a straight line of positions does not.
    found = positions(made)
    parents = made.skeleton.parents[1:]
    lengths = np.linalg.norm(found[:, 1:] - found[:, parents], axis=-1)
    np.testing.assert_allclose(
        lengths, np.broadcast_to(np.linalg.norm(made.skeleton.offsets[1:], axis=-1), lengths.shape)
    )
    upper = found[:, 1:] - found[:, parents]
    wanted = line[:, 1:] - line[:, parents]
    cosines = np.sum(upper * wanted, axis=-1) / np.linalg.norm(upper, axis=-1) / np.linalg.norm(wanted, axis=-1)
    assert cosines.min() > 0.95, "bones point as the predicted positions do"
    assert np.sum(made.local_rotations[0] * BEFORE.local_rotations[30], axis=-1).min() > 0.7, (
        "no bone twists by half a turn"
    )


def test_a_splice_is_equation_17_and_can_be_saved(tmp_path: Path) -> None:
    made = ss.splice([BEFORE, AFTER], ss.SpliceOptions(system=splicer())).clip
    assert len(made) == 31 + 7 + len(AFTER) - 20
    np.testing.assert_array_equal(made.local_rotations[:31], BEFORE.local_rotations[:31])
    np.testing.assert_array_equal(made.local_rotations[38:, 1:], AFTER.local_rotations[20:, 1:])
    ss.save(made, tmp_path / "spliced.bvh")
    np.testing.assert_allclose(positions(ss.load(tmp_path / "spliced.bvh")), positions(made), atol=1e-3)


def test_a_bundle_without_a_rate_is_refused(tmp_path: Path) -> None:
    write_bundle(tmp_path, {k: v for k, v in CONFIG.items() if k != "fps"}, {})
    with pytest.raises(InputError, match=r"bundle.json: has no 'fps'; export the system anew"):
        open_clip_splicer(tmp_path)
    write_bundle(tmp_path, CONFIG, {})
    assert open_clip_splicer(tmp_path).name == "lpt-plus"
