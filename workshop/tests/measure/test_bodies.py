"""Words on bodies of other proportions: the bodies, and what is measured on them."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image

from signing import word
from signsplice.body import arm_ik
from signsplice.body.capsules import BodyShape, build_capsules
from signsplice.cli.commands import app
from signsplice.errors import InputError
from signsplice.lexicon import open_shipped_lexicon
from signsplice.motion.kinematics import rest_positions
from signsplice.rig.info import rig_info
from signsplice_workshop.measure import bodies, body_pictures
from signsplice_workshop.measure.bodies import BODIES, BodyProportions, SourceClip, scale_bones

CLIP = word("DEAF").clip
USUAL = build_capsules(CLIP.skeleton, BodyShape())


def length(points: np.ndarray, *joints: int) -> float:
    return float(sum(np.linalg.norm(points[b] - points[a]) for a, b in pairwise(joints)))


def test_a_body_stretched_by_one_is_the_same() -> None:
    same = scale_bones(CLIP.skeleton, BodyProportions())
    assert np.array_equal(same.offsets, CLIP.skeleton.offsets)
    assert same.names == CLIP.skeleton.names
    assert [s.offset.tolist() for s in same.end_sites] == [s.offset.tolist() for s in CLIP.skeleton.end_sites]


def test_a_stretched_body_has_the_lengths_asked_for() -> None:
    body = BodyProportions(shoulders=1.4, arms=0.8, hands=1.2, trunk=0.9)
    before, after = rig_info(CLIP.skeleton), rig_info(scale_bones(CLIP.skeleton, body))
    assert after.sizes.arm_length == pytest.approx(0.8 * before.sizes.arm_length)
    p, q = before.t_pose.positions, after.t_pose.positions
    left, right = before.arm_joints[0], before.arm_joints[3]
    assert q[left, 0] - q[right, 0] == pytest.approx(1.4 * (p[left, 0] - p[right, 0]))
    joints = before.roles.joints
    finger = [joints[f"leftIndex{part}"] for part in ("Proximal", "Intermediate", "Distal")]
    assert length(q, joints["leftHand"], *finger) == pytest.approx(1.2 * length(p, joints["leftHand"], *finger))
    height = p[joints["neck"], 1] - p[joints["hips"], 1]
    assert q[joints["neck"], 1] - q[joints["hips"], 1] == pytest.approx(0.9 * height)
    rest, was = rest_positions(after.skeleton), rest_positions(CLIP.skeleton)
    legs = joints["leftUpperLeg"], joints["leftLowerLeg"], joints["leftFoot"]
    assert length(rest, *legs) == pytest.approx(length(was, *legs))


def test_a_clip_on_its_own_body_keeps_everything() -> None:
    seen = SourceClip(CLIP).measure(CLIP, USUAL)
    assert len(seen.frame_errors) > 3
    assert len(seen.pair_errors) >= len(seen.frame_errors)
    assert seen.pair_errors.max() < 1e-3
    assert (seen.n_made, seen.hand_depth, seen.forearm_depth) == (0, 0.0, 0.0)
    assert len(seen.place_errors) > 3
    assert seen.place_errors.max() < 1e-6
    assert max(seen.palm_degrees.max(), seen.index_degrees.max()) < 1e-5
    assert (seen.peak_ratio, seen.jerk_ratio, seen.arm_ratio) == pytest.approx((1.0, 1.0, 1.0))


def test_a_head_that_shrinks_or_grows_away_from_the_hand_is_seen() -> None:
    source = SourceClip(CLIP)
    small, large = (
        source.measure(CLIP, build_capsules(CLIP.skeleton, BodyShape(head=head)), head) for head in (0.5, 1.7)
    )
    assert small.pair_errors.max() > 0.01, "the finger no longer touches the cheek"
    assert (small.hand_depth, small.n_made) == (0.0, 0)
    assert large.hand_depth > 0.01, "the finger is in the cheek"
    assert large.n_made > 0
    assert small.worst is not None
    assert small.worst.word == CLIP.name
    assert small.worst.error == pytest.approx(small.pair_errors[small.clear].max())
    assert small.worst.before < 0.005 < small.worst.after
    assert np.median(small.place_errors) > 0.05


def test_what_lies_deep_at_the_source_is_told_apart() -> None:
    night = word("NIGHT").clip
    down = np.tile([0.0, -3.0, 0.0], (len(night), 2, 1)) * [[0.0], [1.0]]
    night = arm_ik.move_wrists(night, down)
    seen = SourceClip(night).measure(night, build_capsules(night.skeleton, BodyShape()))
    assert 0.0 < np.mean(seen.clear) < 1.0, "a hand of this word lies in the other forearm"
    assert seen.pair_errors[seen.clear].max() < 1e-9
    assert seen.pair_errors[~seen.clear].min() > 0.0
    assert seen.worst is not None
    assert seen.worst.error == seen.pair_errors[seen.clear].max()


def test_a_motion_that_trembles_or_hurries_is_seen() -> None:
    shake = np.zeros((len(CLIP), 3))
    shake[::2, 1] = 5.0  # cm
    seen = SourceClip(CLIP).measure(replace(CLIP, root_positions=CLIP.root_positions + shake), USUAL)
    assert seen.jerk_ratio > 2.0
    assert seen.peak_ratio > 1.0


def test_fitted_words_keep_what_rotations_lose() -> None:
    body = {"narrow": BODIES["narrow"]}
    plain, fitted = bodies.compare([CLIP], [], body)
    assert (plain.method, fitted.method) == (bodies.ROTATIONS, bodies.FITTED)
    assert plain.n_touching == fitted.n_touching > 3
    assert plain.kept_frames is not None
    assert fitted.kept_frames is not None
    assert plain.kept_frames < 0.5 < 0.9 < fitted.kept_frames
    assert plain.time_ratio == 1.0


def test_what_is_kept_aside_is_apart() -> None:
    aside = {name for name, body in BODIES.items() if body.held_out}
    assert len(BODIES) - len(aside) >= 9
    assert len(aside) == 3
    assert not aside & {"narrow", "broad", "child", "chibi", "long arms"}, "choices were made on these"
    assert not any(map(bodies.is_held_out, bodies.TUNED_ON))
    names = [entry.gloss for entry in open_shipped_lexicon().entries() if entry.kind == "sign"]
    assert set(names) >= bodies.TUNED_ON
    assert 0.2 < np.mean([bodies.is_held_out(name) for name in names]) < 0.45
    words, kept = bodies.draw_words(12)
    assert (len({clip.name for clip in words}), len({clip.name for clip in kept})) == (8, 4)
    assert [bodies.is_held_out(clip.name) for clip in (*words, *kept)] == [False] * 8 + [True] * 4
    assert [clip.name for clip in bodies.draw_words(12)[0]] == [clip.name for clip in words]


def test_rows_that_are_kept_aside_use_their_own_words() -> None:
    some = {name: BODIES[name] for name in ("narrow", "youth")}
    rows = bodies.compare([CLIP], [word("THANK-YOU").clip, CLIP], some)
    assert [(row.body, row.held_out, row.n_words) for row in rows[::2]] == [("narrow", False, 1), ("youth", True, 2)]
    assert [row.body for row in bodies.compare([CLIP], [], some)] == ["narrow", "narrow"]


def test_the_command_prints_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    some = {name: BODIES[name] for name in ("small head", "youth")}
    monkeypatch.setattr(bodies.compare, "__defaults__", (some, None))
    printed = json.loads(CliRunner().invoke(app, ["evaluate", "bodies", "3", "--json"], catch_exceptions=False).stdout)
    assert printed["signature"] == bodies.signature(3)
    assert [(r["body"], r["method"], r["n_words"]) for r in printed["rows"]] == [
        ("small head", "rotations", 2),
        ("small head", "fitted", 2),
        ("youth", "rotations", 1),
        ("youth", "fitted", 1),
    ]
    assert printed["rows"][0]["time_ratio"] is None, "rotations need no copying where skeletons are the same"
    lines = CliRunner().invoke(app, ["evaluate", "bodies", "3"], catch_exceptions=False).stdout
    assert "| youth | fitted |" in lines
    assert "Bodies kept aside: 1 clips that are kept aside too" in lines


def test_the_command_takes_captures_for_words(monkeypatch: pytest.MonkeyPatch) -> None:
    from signsplice_workshop.cli import evaluate

    monkeypatch.setattr(bodies.compare, "__defaults__", ({"small head": BODIES["small head"]}, None))
    monkeypatch.setattr(evaluate, "load", lambda file: CLIP)
    call = ["evaluate", "bodies", "--clips", "x.bvh", "--json"]
    printed = json.loads(CliRunner().invoke(app, call, catch_exceptions=False).stdout)
    assert printed["signature"] == bodies.signature()
    assert {row["n_words"] for row in printed["rows"]} == {1}


def test_the_command_refuses_too_few_words_and_other_questions() -> None:
    for call in (["bodies", "2"], ["bodies", "9999"], ["bodies", "3", "--clips", "x.bvh"]):
        with pytest.raises(InputError, match="expected"):
            CliRunner().invoke(app, ["evaluate", *call], catch_exceptions=False, standalone_mode=False)


@pytest.mark.slow
def test_a_picture_shows_words_on_bodies_and_their_shape(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(body_pictures, "SHOWN", ("chibi",))
    body_pictures.write_pictures([CLIP], tmp_path / "bodies.png")
    page = np.asarray(Image.open(tmp_path / "bodies.png").convert("L"))[40:]
    width = page.shape[1] // 3  # the source, the chibi body with rotations alone, and fitted
    dark = [(cell[:70] < 70).sum() for cell in (page[:, :width], page[:, width : 2 * width], page[:, 2 * width :])]
    assert min(dark[1:]) > 1.2 * dark[0]  # hair


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (["seams", "3", "--picture", "a.png"], "No such option '--picture'"),
        (["bodies", "--picture", "a.gif"], ".png"),
    ],
)
def test_a_picture_is_asked_for_with_bodies_as_png(call: list[str], said: str) -> None:
    result = CliRunner().invoke(app, ["evaluate", *call], standalone_mode=False)
    assert result.exit_code != 0
    assert said in str(result.exception)
