"""The paper's systems on clips: positions become rotations again, and clips of other kinds are refused."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.typing import NDArray

import signsplice as ss
from registration import registered  # noqa: F401
from signing import word
from signsplice.cli.commands import app
from signsplice.errors import InputError
from signsplice.motion import Clip, kinematics
from signsplice.signer.signer import STANDARD, draw_signer, skeleton
from signsplice.splicing.contracts import Gap
from signsplice_paper.systems.clips import ClipSplicer, open_clip_splicer, stature
from signsplice_paper.systems.splicers import OneNetworkSystem, TwoNetworkSystem
from signsplice_workshop.corpora.pairs import scaled_positions, signer_space
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


def test_the_159_numbers_of_a_clip_survive_a_round_trip() -> None:
    for signer in (STANDARD, draw_signer(3)):
        clip = replace(word("YES").clip, skeleton=skeleton(signer))
        assert stature(clip.skeleton) == pytest.approx(signer.stature_cm)
        numbers = scaled_positions(clip, signer.stature_cm)
        back = signer_space(clip.skeleton, signer.stature_cm).positions(numbers)
        np.testing.assert_allclose(back, positions(clip), atol=1e-9)


def test_the_cut_is_the_position_of_the_network() -> None:
    cut = splicer().cut(BEFORE, AFTER)
    assert (cut.pre, cut.post) == (30, 20)
    with pytest.raises(InputError, match="lpt-plus finds no splice position"):
        splicer(pre=None).cut(BEFORE, AFTER)


@pytest.mark.parametrize("n_frames", [7, 4, 15])
def test_a_transition_follows_the_predicted_positions(n_frames: int) -> None:
    kept, follows = BEFORE[23:31], AFTER[20:28]
    made = splicer().between(Gap(kept, follows, n_frames))
    assert len(made) == n_frames
    alpha = np.arange(1, n_frames + 1)[:, None, None] / (n_frames + 1)
    line = (1 - alpha) * positions(kept)[-1] + alpha * positions(follows)[0]
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
    assert np.sum(made.local_rotations[0] * kept.local_rotations[-1], axis=-1).min() > 0.7, (
        "no bone twists by half a turn"
    )


def test_a_splice_is_equation_17_and_can_be_saved(tmp_path: Path) -> None:
    made = ss.splice([BEFORE, AFTER], ss.SpliceOptions(system=splicer())).clip
    assert len(made) == 31 + 7 + len(AFTER) - 20
    np.testing.assert_array_equal(made.local_rotations[:31], BEFORE.local_rotations[:31])
    np.testing.assert_array_equal(made.local_rotations[38:], AFTER.local_rotations[20:])
    ss.save(made, tmp_path / "spliced.bvh")
    np.testing.assert_allclose(positions(ss.load(tmp_path / "spliced.bvh")), positions(made), atol=1e-3)


def test_the_engine_splices_with_a_system() -> None:
    system = splicer()
    result = ss.splice([BEFORE, AFTER], ss.SpliceOptions(cutter=system, transition=system))
    assert (result.cutter, result.transition) == ("lpt-plus", "lpt-plus")
    assert [(seam.pre_frame, seam.post_frame) for seam in result.seams] == [(30, 20)]


def test_clips_of_other_skeletons_and_rates_are_refused() -> None:
    system = splicer()
    with pytest.raises(InputError, match="MOTHER: 60 fps, but lpt-plus knows only 30; use --fps 30"):
        system.cut(replace(BEFORE, fps=60.0), AFTER)
    point = Clip(
        ss.Skeleton(("a",), np.array([-1]), np.zeros((1, 3))), np.array([[[0, 0, 0, 1.0]]]), np.zeros((1, 3)), 30.0
    )
    with pytest.raises(InputError, match=r"has no joint .*Spine1 and 50 more.*; lpt-plus knows only the rig of its"):
        system.cut(point, AFTER)
    with pytest.raises(InputError, match="0 transition frames"):
        system.between(Gap(BEFORE, AFTER, 0))
    for other in (splicer(fr=None), splicer(kind=OneNetworkSystem)):
        with pytest.raises(InputError, match="lpt-plus makes frames only from two whole words"):
            other.between(Gap(BEFORE, AFTER, 3))


def test_the_command_line_takes_a_bundle_as_cutter(tmp_path: Path) -> None:
    write_bundle(tmp_path, {k: v for k, v in CONFIG.items() if k != "fps"}, {})
    with pytest.raises(InputError, match=r"bundle.json: has no 'fps'; export the system anew"):
        open_clip_splicer(tmp_path)
    write_bundle(tmp_path, CONFIG, {})
    assert open_clip_splicer(tmp_path).name == "lpt-plus"
    for k, clip in enumerate((BEFORE, AFTER)):
        ss.save(clip, tmp_path / f"{k}.bvh")
    call = ["splice", str(tmp_path / "0.bvh"), str(tmp_path / "1.bvh"), "-o", str(tmp_path / "out.bvh")]
    result = CliRunner().invoke(app, [*call, "--cutter", str(tmp_path)])
    assert isinstance(result.exception, InputError)
    assert "lists no file spsn.onnx" in str(result.exception), "the system in the folder is used"
