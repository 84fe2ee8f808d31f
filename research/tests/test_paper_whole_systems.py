"""A system of the paper run whole: what it chooses is what comes out, and where it has no splice it is said."""

from __future__ import annotations

import json
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
from signsplice.cli.terminal import with_option_names
from signsplice.errors import InputError, SignspliceError
from signsplice.motion import Clip, Skeleton, resample, rotation
from signsplice.rig.align import ORIGIN, Placement, place, placement
from signsplice.splicing import report
from signsplice.splicing.bundle import BUNDLE_FILE
from signsplice.splicing.seam import Seam
from signsplice.splicing.word import AlignedWord, FrameMap
from signsplice_paper.configs import parse_config
from signsplice_paper.systems.clips import ClipSplicer
from signsplice_paper.systems.splicers import OneNetworkSystem, TwoNetworkSystem
from signsplice_workshop.corpora.number_space import NumberSpace, make_space
from signsplice_workshop.train.bundles import write_bundle
from test_paper_clips import AFTER, BEFORE, CONFIG, inner, positions, splicer, straight
from test_paper_systems import Fakes, counting, encoder, fake_system, tokens

Array = NDArray[Any]
THIRD = word("YES").clip
WORDS = [BEFORE, AFTER, THIRD]


def aligned(clip: Clip) -> AlignedWord:
    return AlignedWord(0, clip, clip, FrameMap())


def spliced(clips: list[Clip], system: ClipSplicer, **options: Any) -> ss.SpliceResult:
    return ss.splice(clips, ss.SpliceOptions(system=system, **options))


def by_words(cuts: Mapping[int, tuple[int | None, int | None]]) -> ClipSplicer:
    """A system whose positions depend on how many frames the word before has."""

    def spsn(inputs: Mapping[str, Array]) -> dict[str, Array]:
        n_before = int(inputs["n_before"][0])
        pre, post = cuts[n_before]
        return tokens(inputs["x"].shape[1], pre, None if post is None else n_before + post)

    graphs = Fakes({"spsn": spsn, "encoder": inner, "decoder": straight})
    return ClipSplicer(fake_system(TwoNetworkSystem, graphs, **CONFIG))


def test_spans_rebuild_the_output_from_the_words_as_recorded() -> None:
    result = spliced(WORDS, splicer(40, 20))
    described = report.describe(result)
    parts = []
    for span in described["spans"]:
        if span["kind"] == "sign":
            parts.append(WORDS[span["clip"]].local_rotations[slice(*span["source"])])
        else:
            parts.append(result.clip.local_rotations[slice(*span["output"])])
    np.testing.assert_array_equal(np.concatenate(parts)[:, 1:], result.clip.local_rotations[:, 1:])
    assert [span["source"] for span in described["spans"][::2]] == [[0, 41], [20, 41], [20, len(THIRD)]]
    assert [(s["pre_frame"], s["post_frame"], s["n_transition"]) for s in described["seams"]] == [(40, 20, 7)] * 2
    assert all(seam["velocity_jump"] > 0.0 and seam["peak_speed_m_s"] > 0.0 for seam in described["seams"])
    assert described["system"]["name"] == described["cutter"] == described["transition"] == "lpt-plus"
    assert (described["system"]["corpus"], described["system"]["token_bias"]) == ("c0ffee", 0.0)
    assert "system" not in report.describe(ss.splice([BEFORE, AFTER]))


def test_a_splice_is_equation_17() -> None:
    system = splicer(40, 20)
    made = system.splice_words(aligned(BEFORE), aligned(AFTER)).frames
    assert made is not None
    y = spliced([BEFORE, AFTER], system).clip
    p, o, q = (clip.local_rotations[:, 1:] for clip in (BEFORE, made, AFTER))
    np.testing.assert_array_equal(y.local_rotations[:, 1:], np.concatenate([p[: 40 + 1], o, q[20:]]))


def test_a_stream_gives_the_same_pieces() -> None:
    options = ss.SpliceOptions(system=splicer(40, 20))
    pieces = list(ss.stream(WORDS, options))
    whole = ss.splice(WORDS, options)
    np.testing.assert_array_equal(
        np.concatenate([piece.clip.local_rotations for piece in pieces]), whole.clip.local_rotations
    )


def test_a_system_of_one_network_chooses_everything() -> None:
    def encode(inputs: Mapping[str, Array]) -> dict[str, Array]:
        n_before = int(inputs["n_before"][0])
        return {**tokens(inputs["x"].shape[1], 30, n_before + 20), **encoder(inputs)}

    def decode(inputs: Mapping[str, Array]) -> dict[str, Array]:
        made = counting(inputs)
        spread = np.linspace(0.0, 0.01, 159, dtype=np.float32)  # no two joints at one place
        return made | {"made": made["made"] * spread}

    runs = {**CONFIG["runs"], "positions": "encoder"}
    graphs = Fakes({"encoder": encode, "decoder": decode})
    result = spliced([BEFORE, AFTER], ClipSplicer(fake_system(OneNetworkSystem, graphs, **{**CONFIG, "runs": runs})))
    assert [(s.pre_frame, s.post_frame, s.n_transition) for s in result.seams] == [(30, 20, 4)]
    endless = ClipSplicer(fake_system(OneNetworkSystem, graphs, **{**CONFIG, "runs": {**runs, "most_frames": 3}}))
    assert "lpt-plus stopped after 3 frames" in spliced([BEFORE, AFTER], endless).seams[0].warnings[0]


def test_all_words_without_a_splice_are_named_at_once() -> None:
    cuts = {len(BEFORE): (None, 20), len(AFTER): (40, None)}
    with pytest.raises(SignspliceError) as caught:
        spliced(WORDS, by_words(cuts), fill_misses=False)
    assert not isinstance(caught.value, InputError), "the work failed, the call was right"
    for text in (
        "2 of 2 seams",
        "MOTHER -> BOOK: lpt-plus finds no prePosition;",
        "BOOK -> YES: lpt-plus finds no postPosition;",
    ):
        assert text in str(caught.value)


def test_a_word_left_before_it_is_entered_is_no_splice() -> None:
    cuts = {len(BEFORE): (40, 30), len(AFTER): (29, 20)}
    with pytest.raises(SignspliceError, match=r"1 of 2 seams: BOOK -> YES: lpt-plus leaves .* frame 29, .* frame 30;"):
        spliced(WORDS, by_words(cuts), fill_misses=False)
    touching = spliced(WORDS, by_words({**cuts, len(AFTER): (30, 20)}))
    assert touching.spans[2].source == (30, 31), "one frame is enough"


def test_misses_are_filled_by_the_defaults_and_reported() -> None:
    system = by_words({len(BEFORE): (40, 30), len(AFTER): (29, 20)})
    result = spliced(WORDS, system)
    (first, second), plain = result.seams, ss.splice([AFTER, THIRD])
    assert (first.pre_frame, first.post_frame, first.n_transition) == (40, 30, 7)
    assert "lpt-plus leaves the first word at frame 29" in second.warnings[0]
    assert second.warnings[0].endswith("joined by cutter learned, transition learned"), "the seam names the words"
    assert (second.pre_frame, second.post_frame) == (max(plain.seams[0].pre_frame, 30), plain.seams[0].post_frame)
    assert result.bundle is None, "of the system, which is no file here"


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ({"cutter": "ends", "tempo": "natural"}, "leave out SpliceOptions.cutter, SpliceOptions.tempo"),
        ({"transition": "slerp", "duration": "fixed"}, "leave out SpliceOptions.transition, SpliceOptions.duration"),
        (
            {"transition_time": 0.3, "avoid_collisions": False},
            "leave out SpliceOptions.transition_time, SpliceOptions.avoid_collisions",
        ),
        ({"free_hand": "transition", "bundle": "x"}, "leave out SpliceOptions.bundle, SpliceOptions.free_hand"),
        ({"fps": 60.0}, "SpliceOptions.fps 60, but lpt-plus knows only 30; leave out SpliceOptions.fps"),
    ],
)
def test_what_the_system_decides_cannot_be_asked_for(options: dict[str, Any], named: str) -> None:
    with pytest.raises(InputError, match=named):
        ss.SpliceOptions(system=splicer(), **options)
    with pytest.raises(TypeError, match="system is a int, expected a name or what open_system"):
        ss.SpliceOptions(system=3)  # type: ignore[arg-type]


def test_clips_are_brought_to_the_rate_that_the_system_knows() -> None:
    fast = [resample(clip, 60.0) for clip in (BEFORE, AFTER)]
    result = spliced(fast, splicer())
    assert result.clip.fps == 30.0
    assert "MOTHER: 60 fps, brought to the 30 that lpt-plus knows" in result.warnings
    np.testing.assert_allclose(positions(result.clip)[:31], positions(BEFORE)[:31], atol=1e-6)


def test_a_signer_who_stands_elsewhere_is_spliced_alike() -> None:
    away = Placement(np.array([300.0, 20.0, -100.0]), np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0]))
    here, there = spliced([BEFORE, AFTER], splicer()), spliced([place(c, away) for c in (BEFORE, AFTER)], splicer())
    np.testing.assert_allclose(there.clip.local_rotations[:, 1:], here.clip.local_rotations[:, 1:], atol=1e-6)


RIG = Skeleton(
    ("Base", "Hips", "Chest", "LeftArm", "LeftHand", "RightArm", "RightHand"),
    np.array([-1, 0, 1, 2, 3, 2, 5]),
    0.01 * np.array([[0, 0, 0], [0, 90, 0], [0, 40, 0], [20, 0, 0], [30, 0, 5], [-20, 0, 0], [-30, 0, 5]]),
)
"""Another rig, in metres, with a joint above the hips."""
GIVEN = ("Hips", "LeftArm", "LeftHand", "RightHand")


def own_word(seed: int, skeleton: Skeleton = RIG) -> Clip:
    rng = np.random.default_rng(seed)
    turns = np.cumsum(rng.normal(0.0, 0.03, (40, len(skeleton), 3)), axis=0)
    return Clip(skeleton, rotation.exp(turns), np.cumsum(rng.normal(0.0, 0.002, (40, 3)), axis=0), 30.0, f"W{seed}")


def own_system(space: NumberSpace) -> ClipSplicer:
    stored = {**CONFIG, "space": space.as_json()}
    system = splicer().system
    runs = system.config.runs
    assert runs is not None
    return ClipSplicer(TwoNetworkSystem(parse_config(stored, Path(BUNDLE_FILE)), runs, system.graphs, "parallel"))


def test_a_system_of_another_rig_moves_its_joints_and_carries_the_others() -> None:
    joints = [RIG.index[name] for name in GIVEN]
    space = make_space(RIG, (0.0, 90.0, 0.0), 220.0, joints)
    space = NumberSpace(GIVEN, (-1, 0, 1, 0), space.middle, space.side)
    system, before, after = own_system(space), own_word(1), own_word(2)
    found = system.splice_words(aligned(before), aligned(after))
    assert (found.cut.pre, found.cut.post) == (30, 20)
    assert found.frames is not None
    ends = [positions(clip)[frame] for clip, frame in ((before, 30), (after, 20))]
    alpha = np.arange(1, 8)[:, None, None] / 8.0
    line = (1.0 - alpha) * ends[0] + alpha * ends[1]
    made = positions(found.frames)
    np.testing.assert_allclose(made[:, 1], line[:, 1], atol=1e-6, err_msg="hips, below the root")
    hand = [RIG.index[name] for name in ("LeftArm", "LeftHand")]
    bone, wanted = (np.diff(at[:, hand], axis=1)[:, 0] for at in (made, line))
    cosine = np.sum(bone * wanted, axis=-1) / np.linalg.norm(bone, axis=-1) / np.linalg.norm(wanted, axis=-1)
    np.testing.assert_allclose(cosine, 1.0, atol=1e-6)
    chest = RIG.index["Chest"]
    carried = rotation.slerp(before.local_rotations[30, chest], after.local_rotations[20, chest], alpha[:, 0, 0])
    np.testing.assert_allclose(np.abs(np.sum(found.frames.local_rotations[:, chest] * carried, axis=-1)), 1.0)


def test_own_words_stand_where_the_system_learned_them_wherever_they_were_recorded() -> None:
    system = own_system(make_space(BEFORE.skeleton, (0.0, 80.0, 0.0), 220.0))
    away = Placement(np.array([300.0, 20.0, -100.0]), np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0]))
    here, there = spliced([BEFORE, AFTER], system), spliced([BEFORE, place(AFTER, away)], system)
    np.testing.assert_allclose(positions(there.clip), positions(here.clip), atol=1e-6)
    for span, clip in zip(here.spans[::2], (BEFORE, AFTER), strict=True):
        at = placement(place(clip, ORIGIN))
        np.testing.assert_allclose(at.position, 0.0, atol=1e-6)
        stood = place(clip, ORIGIN).root_positions[slice(*(span.source or (0, 0)))]
        np.testing.assert_array_equal(here.clip.root_positions[slice(*span.output)], stood)


def test_a_clip_without_a_joint_of_the_system_is_refused() -> None:
    space = replace(make_space(RIG, (0.0, 90.0, 0.0), 220.0), joints=(*RIG.names[:-1], "Tail"))
    with pytest.raises(InputError, match=r"W1: has no joint Tail; .* bring clips to it with `signsplice convert"):
        own_system(space).splice_words(aligned(own_word(1)), aligned(own_word(2)))
    with pytest.raises(InputError, match=r"bundle\.json: .*space: .*side"):
        parse_config({**CONFIG, "space": {"joints": ["a"], "parents": [-1], "middle": [0, 0, 0]}}, Path(BUNDLE_FILE))


@pytest.mark.parametrize(("turned", "n_frames"), [((), 5), ((2,), 5), ((0, 1, 2, 3, 4), 5), ((), 0)])
def test_a_joint_that_jumps_is_named(turned: tuple[int, ...], n_frames: int) -> None:
    finger = BEFORE.skeleton.index["mixamorig:RightHandMiddle2"]
    about = rotation.exp(np.array([0.0, 0.0, 2.0]))
    local = np.array(AFTER.local_rotations)
    if not n_frames:
        local[:, finger] = rotation.multiply(about, BEFORE.local_rotations[40, finger])
    after = replace(AFTER, local_rotations=local)
    made = None
    if n_frames:
        alpha = np.arange(1, n_frames + 1)[:, None] / (n_frames + 1)
        frames = rotation.slerp(BEFORE.local_rotations[40], local[20], alpha)
        frames[list(turned), finger] = rotation.multiply(about, frames[list(turned), finger])
        made = Clip(BEFORE.skeleton, frames, np.tile(BEFORE.root_positions[40], (n_frames, 1)), BEFORE.fps)
    system = splicer()

    def splice_words(before: AlignedWord, after: AlignedWord) -> Seam:
        return system.filled_seam(before, after, 40, 20, made)

    system.splice_words = splice_words  # type: ignore[method-assign]
    (seam,) = spliced([BEFORE, after], system).seams
    lines = [line for line in seam.warnings if "degrees in one frame" in line]
    assert seam.n_transition == n_frames
    if n_frames and not turned:
        assert not lines
    else:
        assert lines
        assert lines[0].startswith("RightHandMiddle2 turns 1")


def test_a_folder_without_a_system_is_named_in_a_line(tmp_path: Path) -> None:
    write_bundle(tmp_path / "bundles" / "lpt-plus", CONFIG, {})
    (tmp_path / "empty").mkdir()
    (tmp_path / "file").write_text("text")
    for name, said in {
        "bundles": "name one of those in it: lpt-plus",
        "empty": "those that ship: lptransformer, lpt-plus",
        "file": "lpt-plus",
        "nosuch": "lpt-plus",
    }.items():
        call = ["sentence", "HELLO I", "-o", str(tmp_path / "out.bvh"), "--system", str(tmp_path / name)]
        result = CliRunner().invoke(app, call)
        assert isinstance(result.exception, InputError)
        assert str(result.exception).startswith(f"{tmp_path / name}: is no trained system; ")
        assert str(result.exception).endswith(said)


def test_the_command_line_runs_a_system_whole(tmp_path: Path) -> None:
    write_bundle(tmp_path / "lpt-plus", CONFIG, {})
    for clip in (BEFORE, AFTER):
        ss.save(clip, tmp_path / f"{clip.name}.bvh")
    files = [str(tmp_path / f"{clip.name}.bvh") for clip in (BEFORE, AFTER)]

    def error(*call: str) -> str:
        places = ["-o", str(tmp_path / "out.bvh"), "--system", str(tmp_path / "lpt-plus")]
        result = CliRunner().invoke(app, [*call, *places])
        assert isinstance(result.exception, InputError)
        return with_option_names(str(result.exception))

    assert "lists no file spsn.onnx" in error("splice", *files), "the system in the folder is used"
    assert "lists no file spsn.onnx" in error("sentence", "MOTHER BOOK")
    assert "leave out --cutter" in error("splice", *files, "--cutter", "ends")
    assert "leave out --transition-time" in error("sentence", "MOTHER BOOK", "--transition-time", "travel")
    (tmp_path / "lpt-plus/bundle.json").write_text(json.dumps({"version": 1, "system": "signsplice"}))
    assert "give it as --bundle" in error("splice", *files)
    assert not (tmp_path / "out.bvh").exists()
