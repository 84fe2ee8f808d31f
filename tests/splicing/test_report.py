"""splicing.report and splicing.seam: what the report of a splice has, and that seam scores rank good and bad seams."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from conftest import random_clip

from signing import word
from signsplice.errors import FormatError, InputError
from signsplice.formats import load, save
from signsplice.motion import Clip
from signsplice.splicing import report
from signsplice.splicing.engine import SpliceOptions, splice
from signsplice.splicing.person import channel_joints

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
    frames = {"source": first["source"], "output": first["output"]}
    frames |= dict.fromkeys(("warp", "remade", "pause"))
    assert first == {"kind": "sign", "clip": 0, "name": "HELLO", **frames}
    assert second == {
        "kind": "transition",
        "clip": None,
        "name": None,
        "source": None,
        "output": second["output"],
        "warp": None,
        "remade": None,
        "pause": None,
    }
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


def stored() -> dict[str, Any]:
    """A report of 12 frames, as its file holds it."""
    clip = random_clip(0)
    made: dict[str, Any] = json.loads(json.dumps(report.describe(splice([clip, clip], SpliceOptions(cutter="ends")))))
    return made


def test_a_report_is_read_as_it_was_written(tmp_path: Path) -> None:
    written, path = stored(), tmp_path / "r.json"
    report.write(written, path)
    assert report.read(path, written["frames"]) == written


def test_an_arm_that_was_remade_is_reported_with_its_joints_and_frames(tmp_path: Path) -> None:
    horse, teach = word("HORSE").clip, word("TEACH").clip
    result = splice([horse, teach], SpliceOptions(person=0.0))
    report.write(report.describe(result), tmp_path / "r.json")
    row = report.read(tmp_path / "r.json", len(result.clip))["spans"][0]
    assert row["remade"]["frames"] == row["output"]
    left_arm = channel_joints(horse, "left arm")
    assert row["remade"]["joints"] == [result.clip.skeleton.names[joint] for joint in left_arm]


def test_a_report_of_an_earlier_or_later_version_of_the_program_is_read(tmp_path: Path) -> None:
    written, path = stored(), tmp_path / "r.json"
    for span in written["spans"]:
        if span["kind"] == "transition":
            del span["name"], span["remade"]
    for seam in written["seams"]:
        del seam["intrusion_mm"]
    del written["timing_ms"]
    path.write_text(json.dumps({**written, "contacts": []}))
    found = report.read(path, written["frames"])
    assert [span["name"] for span in found["spans"] if span["kind"] == "transition"] == [None]
    assert found["seams"][0]["intrusion_mm"] is None
    assert (found["timing_ms"], found["contacts"]) == ({}, [])


WRONG: dict[str, tuple[tuple[str | int, ...], Any]] = {
    "no list of spans": (("spans",), {"a": 1}),
    "a span of a number": (("spans", 0), 3),
    "a name of a number": (("spans", 0, "name"), 3),
    "a name of a list": (("spans", 0, "name"), ["a"]),
    "another kind": (("spans", 0, "kind"), "pause"),
    "frames of text": (("spans", 0, "output"), ["0", "5"]),
    "three frames": (("spans", 0, "output"), [0, 5, 9]),
    "frames backwards": (("spans", 0, "output"), [5, 2]),
    "frames before the first": (("spans", 0, "output"), [-3, 2]),
    "an arm of text": (("spans", 0, "remade"), "left"),
    "an arm without frames": (("spans", 0, "remade"), {"joints": ["a"]}),
    "half a source": (("spans", 0, "source"), [1]),
    "a seam of text": (("seams", 0), "a"),
    "a score of text": (("seams", 0, "peak_speed_m_s"), "fast"),
    "a warning of a number": (("warnings",), [1]),
    "a warning of text alone": (("warnings",), "abc"),
    "a rate of text": (("fps",), "30"),
    "a rate without end": (("fps",), 1e999),
    "frames without end": (("frames",), 10**30),
    "times of a list": (("timing_ms",), []),
    "version 2": (("version",), 2),
    "no version": (("version",), None),
}


@pytest.mark.parametrize("what", WRONG)
def test_a_report_with_a_wrong_value_is_refused(what: str, tmp_path: Path) -> None:
    written, path = stored(), tmp_path / "r.json"
    *way, last = WRONG[what][0]
    holder: Any = written
    for key in way:
        holder = holder[key]
    holder[last] = WRONG[what][1]
    path.write_text(json.dumps(written).replace("Infinity", "1e999"))
    with pytest.raises(InputError, match=r"r\.json: (is no report of a splice|describes) ") as caught:
        report.read(path, stored()["frames"])
    assert len(str(caught.value).splitlines()) == 1


def test_a_report_that_is_no_object_or_of_another_clip_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "r.json"
    for text in ("[1, 2]", '"a"', "3", "null", "{}"):
        path.write_text(text)
        with pytest.raises(InputError, match="is no report of a splice"):
            report.read(path, 5)
    path.write_text(json.dumps(stored()))
    with pytest.raises(InputError, match="but the clip has 5; is it another clip's report"):
        report.read(path, 5)


@pytest.mark.parametrize("suffix", [".glb", ".vrma", ".npz"])
def test_the_report_travels_in_files_that_can_hold_it(sentence: list[Clip], tmp_path: Path, suffix: str) -> None:
    result, path = splice(sentence), tmp_path / f"sentence{suffix}"
    save(result.clip, path)
    clip = load(path)
    assert clip.report is not None
    checked = report.check(clip.report, len(clip), str(path))
    assert checked == {**json.loads(json.dumps(report.describe(result))), "timing_ms": {}}
    assert clip[: len(clip) // 2].report is None, "the report of other frames"
    save(result.clip, tmp_path / f"again{suffix}")
    assert (tmp_path / f"again{suffix}").read_bytes() == path.read_bytes(), "no times in it"


def test_a_report_in_a_file_is_checked_before_use(sentence: list[Clip]) -> None:
    clip = splice(sentence).clip
    assert clip.report is not None
    with pytest.raises(FormatError, match="is no report of a splice"):
        report.check({**clip.report, "spans": [1]}, len(clip), "a.glb")
    with pytest.raises(InputError, match="another clip's report"):
        report.check(clip.report, len(clip) - 1, "a.glb")


def test_a_broken_report_in_a_file_leaves_its_motion(sentence: list[Clip], tmp_path: Path) -> None:
    clip, path = splice(sentence).clip, tmp_path / "sentence.glb"
    save(clip, path)
    path.write_bytes(path.read_bytes().replace(rb'"{\"version\"', rb'"[\"version\"'))
    broken = load(path)
    assert (broken.report, len(broken)) == (None, len(clip))
    assert "the report of a splice in it was left out" in broken.notes[-1]
