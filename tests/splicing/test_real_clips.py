"""Real clips, where they are present: spliced without a jump, and hidden frames filled."""

from __future__ import annotations

import numpy as np

from signsplice.formats import bvh
from signsplice.motion import Clip, kinematics, resample, rotation
from signsplice.motion.euler import ROTATIONS
from signsplice.splicing.curves import find_transition
from signsplice.splicing.engine import splice
from signsplice_workshop.measure.hidden_frames import score_hidden_frames


def test_real_clips_of_two_rigs_are_spliced_without_a_jump(real_clips: dict[str, Clip]) -> None:
    thanks, take = real_clips["isl_thanks"], real_clips["long_take_metres"]
    result = splice([thanks, take, thanks])
    again = bvh.parse(bvh.encode(result.clip))
    assert again.skeleton.names == thanks.skeleton.names
    assert np.allclose(kinematics.forward(again)[1], kinematics.forward(result.clip)[1], atol=1e-4)
    steps = np.rad2deg(rotation.angle_between(again.local_rotations[:-1], again.local_rotations[1:]))
    source_steps = [
        np.rad2deg(rotation.angle_between(c.local_rotations[:-1], c.local_rotations[1:])).max() for c in (thanks, take)
    ]
    assert steps.max() <= max(source_steps) + 1e-6, "no step is larger than those of the sources"
    # Euler curves do not flip by half or whole revolutions.
    assert again.channels is not None
    flat = [name for names in again.channels.names for name in names]
    curves = again.channels.values[:, [i for i, name in enumerate(flat) if name in ROTATIONS]]
    for span in result.spans:
        if span.kind == "transition":
            start, stop = span.output
            assert steps[start - 1 : stop + 1].max() < 25.0, "degrees"
            assert np.abs(np.diff(curves[start - 1 : stop + 1], axis=0)).max() < 90.0
    assert np.linalg.norm(np.diff(again.root_positions, axis=0), axis=-1).max() < 5.0, "cm, of the hips"


def test_hermite_fills_hidden_frames_better_than_slerp(real_clips: dict[str, Clip]) -> None:
    """At every length the error of hermite is below slerp's, and slerp's below hold's, as in published work. The take's
    frames from 315 on are for the last look at new motion.
    """
    clips = [resample(real_clips["long_take_metres"][:315], 24.0)[170:]]
    rows = score_hidden_frames(
        clips, [find_transition(name) for name in ("hold", "slerp", "hermite")], (5, 12, 24), stride=20
    )
    error = {(row.transition, row.n_frames): row.position_error for row in rows}
    for n in (5, 12, 24):
        assert error["hold", n] > error["slerp", n] > error["hermite", n]
    assert error["hermite", 5] < 0.6 * error["slerp", 5]
    assert all(row.motion_ratio < 1.0 for row in rows if row.transition == "slerp")
