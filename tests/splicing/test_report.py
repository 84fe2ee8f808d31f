"""splicing.report and splicing.seam: what the report of a splice has, and that seam scores rank good and bad seams."""

from __future__ import annotations

import json
from dataclasses import replace

from conftest import random_clip
from signsplice.motion.clip import Clip
from signsplice.splicing import report
from signsplice.splicing.engine import SpliceOptions, splice

CLASSICAL = SpliceOptions("pose-velocity", "hermite", "tempo")


def test_the_report_describes_the_result(sentence: list[Clip]) -> None:
    result = splice(sentence)
    described = json.loads(json.dumps(report.describe(result, {"load": 1.5})))
    assert described["version"] == 1
    assert described["frames"] == len(result.clip)
    assert described["fps"] == 30.0
    assert described["bundle"] == result.bundle
    assert described["timing_ms"]["load"] == 1.5
    assert set(described["timing_ms"]) >= {"load", "cut", "transition", "join", "save"}
    first, second = described["spans"][:2]
    assert first == {"kind": "sign", "clip": 0, "name": "HELLO", "source": first["source"], "output": first["output"]}
    assert second == {"kind": "transition", "clip": None, "name": None, "source": None, "output": second["output"]}
    seam = described["seams"][0]
    assert seam["pre_frame"] == first["source"][1] - 1
    assert seam["post_frame"] == described["spans"][2]["source"][0]
    assert seam["n_transition"] == second["output"][1] - second["output"][0]
    assert " ".join(seam) == (
        "before after pre_frame post_frame n_transition seconds "
        "velocity_jump peak_speed_m_s jerk_ratio warnings intrusion_mm"
    )


def test_seam_scores_rank_a_smooth_seam_above_a_jump(sentence: list[Clip]) -> None:
    smooth, jumping = splice(sentence, CLASSICAL), splice(sentence, replace(CLASSICAL, transition="hold"))
    for a, b in zip(smooth.seams, jumping.seams, strict=True):
        assert a.velocity_jump < b.velocity_jump
        assert a.peak_speed_m_s < b.peak_speed_m_s
        assert a.jerk_ratio < b.jerk_ratio
        assert a.warnings == ()
    assert any("faster than signs do" in line for seam in jumping.seams for line in seam.warnings)


def test_unknown_scores_are_null_in_the_report() -> None:
    clip = random_clip(0)
    result = splice([clip, clip], SpliceOptions(cutter="ends"))
    assert report.describe(result)["seams"][0]["velocity_jump"] is None
