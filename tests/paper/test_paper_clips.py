"""The paper's systems on clips: positions become rotations again, and what they cannot know is refused."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.typing import NDArray
from test_paper_systems import Fakes, tokens

import signsplice as ss
from signing import word
from signsplice.cli import app
from signsplice.errors import InputError
from signsplice.motion import kinematics
from signsplice.motion.clip import Clip
from signsplice.paper.systems.clips import ClipSplicer, open_clip_splicer
from signsplice.paper.systems.splicers import OneNetworkSystem, TwoNetworkSystem
from signsplice.splicing.bundle import write_bundle
from signsplice.synth.corpus import from_numbers, to_numbers
from signsplice.synth.signer import STANDARD, signer, skeleton, stature

Array = NDArray[Any]
FR = 3
FACTS = {
    "system": "lpt",
    "corpus": "c0ffee",
    "scale": "smoke",
    "fps": 30.0,
    "fr": FR,
    "runs": {"positions": "spsn", "frames": "filler", "concurrent": False, "n_fed": 159, "most_frames": 32},
}


def straight(inputs: Mapping[str, Array]) -> dict[str, Array]:
    """Seven frames on the line between the two inner culled frames."""
    x, n = inputs["x"][0], inputs["real"].shape[1]
    share = np.arange(1, n + 1)[:, None] / (n + 1)
    return {"made": ((1 - share) * x[FR - 1] + share * x[FR])[None]}


def seven(inputs: Mapping[str, Array]) -> dict[str, Array]:
    return {"numbers": np.eye(12)[None, 6]}


def splicer(pre: int | None = 30, post: int | None = 20, kind: type = TwoNetworkSystem, **facts: Any) -> ClipSplicer:
    graphs = Fakes(
        {
            "spsn": lambda inputs: tokens(inputs["x"].shape[1], pre, None if post is None else len(BEFORE) + post),
            "length": seven,
            "fill": straight,
        }
    )
    told = {**FACTS, **facts}
    return ClipSplicer(kind("lpt", told, graphs, "one-by-one"))


BEFORE, AFTER = word("MOTHER").clip, word("BOOK").clip


def places(clip: Clip) -> Array:
    return kinematics.forward(clip)[1]


def test_numbers_of_a_clip_come_back_whatever_the_signer() -> None:
    for who in (STANDARD, signer(3)):
        clip = replace(word("YES").clip, skeleton=skeleton(who))
        assert stature(clip.skeleton) == pytest.approx(who.stature_cm)
        back = from_numbers(to_numbers(clip, who.stature_cm), who.stature_cm)
        np.testing.assert_allclose(back, places(clip), atol=1e-9)


def test_it_cuts_where_the_network_says() -> None:
    cut = splicer().cut(BEFORE, AFTER)
    assert (cut.pre, cut.post) == (30, 20)
    with pytest.raises(InputError, match="lpt finds no splice position"):
        splicer(pre=None).cut(BEFORE, AFTER)


@pytest.mark.parametrize("n_frames", [7, 4, 15])
def test_a_transition_goes_where_the_positions_went(n_frames: int) -> None:
    kept, follows = BEFORE[23:31], AFTER[20:28]
    made = splicer().between(kept, follows, n_frames)
    assert len(made) == n_frames
    share = np.arange(1, n_frames + 1)[:, None, None] / (n_frames + 1)
    line = (1 - share) * places(kept)[-1] + share * places(follows)[0]
    np.testing.assert_allclose(made.root_positions, line[:, 0], atol=1e-4)
    # Bones keep their lengths, which a straight line of positions does not.
    found = places(made)
    parents = made.skeleton.parents[1:]
    lengths = np.linalg.norm(found[:, 1:] - found[:, parents], axis=-1)
    np.testing.assert_allclose(
        lengths, np.broadcast_to(np.linalg.norm(made.skeleton.offsets[1:], axis=-1), lengths.shape)
    )
    upper = found[:, 1:] - found[:, parents]
    wanted = line[:, 1:] - line[:, parents]
    cosines = np.sum(upper * wanted, axis=-1) / np.linalg.norm(upper, axis=-1) / np.linalg.norm(wanted, axis=-1)
    assert cosines.min() > 0.95, "bones point where the positions pointed"
    assert np.sum(made.local_rotations[0] * kept.local_rotations[-1], axis=-1).min() > 0.7, "no twist turns over"


def test_a_splice_is_equation_17_and_becomes_a_file(tmp_path: Path) -> None:
    made = splicer().splice(BEFORE, AFTER)
    assert len(made) == 31 + 7 + len(AFTER) - 20
    np.testing.assert_array_equal(made.local_rotations[:31], BEFORE.local_rotations[:31])
    np.testing.assert_array_equal(made.local_rotations[38:], AFTER.local_rotations[20:])
    ss.save(made, tmp_path / "said.bvh")
    np.testing.assert_allclose(places(ss.load(tmp_path / "said.bvh")), places(made), atol=1e-3)


def test_the_engine_splices_with_it() -> None:
    own = splicer()
    result = ss.splice([BEFORE, AFTER], ss.SpliceOptions(cutter=own, transition=own))
    assert (result.cutter, result.transition) == ("lpt", "lpt")
    assert [(seam.pre_frame, seam.post_frame) for seam in result.seams] == [(30, 20)]


def test_what_it_did_not_learn_from_is_refused() -> None:
    own = splicer()
    with pytest.raises(InputError, match="MOTHER: 60 fps, and lpt knows 30 alone; --fps 30"):
        own.cut(replace(BEFORE, fps=60.0), AFTER)
    point = Clip(
        ss.Skeleton(("a",), np.array([-1]), np.zeros((1, 3))), np.array([[[0, 0, 0, 1.0]]]), np.zeros((1, 3)), 30.0
    )
    with pytest.raises(InputError, match="1 joints of another skeleton, and lpt knows the 53"):
        own.cut(point, AFTER)
    with pytest.raises(InputError, match="0 transition frames"):
        own.between(BEFORE, AFTER, 0)
    for other in (splicer(fr=None), splicer(kind=OneNetworkSystem)):
        with pytest.raises(InputError, match="lpt makes frames of two whole words alone"):
            other.between(BEFORE, AFTER, 3)


def test_a_folder_takes_the_place_of_a_name(tmp_path: Path) -> None:
    facts = {k: v for k, v in FACTS.items() if k != "fps"}
    write_bundle(tmp_path, facts, {})
    with pytest.raises(InputError, match=r"bundle.json: has no 'fps'; export the system anew"):
        open_clip_splicer(tmp_path)
    write_bundle(tmp_path, FACTS, {})
    assert open_clip_splicer(tmp_path).name == "lpt"
    for k, clip in enumerate((BEFORE, AFTER)):
        ss.save(clip, tmp_path / f"{k}.bvh")
    call = ["splice", str(tmp_path / "0.bvh"), str(tmp_path / "1.bvh"), "-o", str(tmp_path / "out.bvh")]
    said = CliRunner().invoke(app, [*call, "--cutter", str(tmp_path)])
    assert isinstance(said.exception, InputError)
    assert "lists no file spsn.onnx" in str(said.exception), "the system in the folder was asked"
