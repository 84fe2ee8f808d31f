"""Landmark files: their bytes, the pose fitted to them, and what a splice leaves of them."""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import signsplice as ss
from signsplice.body.landmarks import HOLISTIC, find_anchors, measure_fit, project
from signsplice.errors import FormatError, InputError, LimitError
from signsplice.formats import pose
from signsplice.motion import Clip, kinematics, resample, rotation
from signsplice.motion.points import Component, Framing, PointLayout, Points
from signsplice.rig.align import ORIGIN, place
from signsplice.rig.info import rig_info
from signsplice.splicing.landmarks import carry_points

GOLDEN = Path(__file__).parents[1] / "golden"
WORDS = ("HELLO", "DEAF", "NAME", "MOTHER", "SCHOOL", "THANK-YOU", "YES", "WHERE")


@pytest.fixture(scope="module")
def words() -> dict[str, Clip]:
    """Shipped words: motion whose depths are known."""
    with ss.open_lexicon() as lexicon:
        return {word: lexicon.clip(word) for word in WORDS}


def seen_again(clip: Clip, name: str = "") -> Clip:
    """The clip as read from the landmarks that a camera sees of it."""
    return pose.parse(pose.encode(clip), f"{name or clip.name}.pose")


@pytest.fixture(scope="module")
def seen(words: dict[str, Clip]) -> dict[str, Clip]:
    return {word: seen_again(clip) for word, clip in words.items()}


def test_a_file_is_written_again_byte_for_byte(seen: dict[str, Clip]) -> None:
    content = pose.encode(seen["HELLO"])
    assert pose.encode(pose.parse(content, "HELLO.pose")) == content


def test_a_file_of_another_program_is_read_and_written_again() -> None:
    """``golden/pose_format.pose`` was written by the package pose-format."""
    content = (GOLDEN / "pose_format.pose").read_bytes()
    expected = json.loads((GOLDEN / "pose_format.json").read_text())
    clip = pose.parse(content, "pose_format.pose")
    assert clip.points is not None
    assert clip.fps == expected["fps"]
    assert list(clip.points.layout.size) == expected["size"]
    assert [name for _, name in clip.points.layout.names] == expected["points"]
    assert np.array_equal(clip.points.values, np.array(expected["values"], np.float32))
    assert np.array_equal(clip.points.confidence, np.array(expected["confidence"], np.float32))
    assert pose.encode(clip) == content
    at = len(content) - clip.points.values.nbytes - clip.points.confidence.nbytes - 10
    old = np.float32(0.1).tobytes() + content[4:at] + np.array([25, 3, 1], "<u2").tobytes() + content[at + 10 :]
    assert pose.encode(pose.parse(old, "old.pose")) == content, "version 0.1"


def wrists(clip: Clip) -> np.ndarray[tuple[int, int, int], np.dtype[np.float64]]:
    """Both wrists (T, 2, 3) from the middle of the shoulders, in the axes of the trunk at the origin, m."""
    info = rig_info(clip.skeleton)
    roles = [info.roles.joints[role] for role in ("leftHand", "rightHand", "leftUpperArm", "rightUpperArm")]
    at = kinematics.forward(place(clip, ORIGIN))[1][:, roles] * info.sizes.unit.metres
    return np.asarray(at[:, :2] - at[:, 2:].mean(axis=1, keepdims=True))


@pytest.mark.parametrize("word", WORDS)
def test_the_fitted_wrists_are_where_they_were(word: str, words: dict[str, Clip], seen: dict[str, Clip]) -> None:
    apart = wrists(seen[word]) - wrists(words[word])
    assert np.median(np.linalg.norm(apart[..., :2], axis=-1)) < 0.03, "in the image"
    assert np.median(np.abs(apart[..., 2])) < 0.12, "in depth, which is guessed"
    fits = measure_fit(seen[word])
    assert [fit.name for fit in fits] == [group.name for group in HOLISTIC.components]
    assert all(fit.pixels is not None and fit.pixels < 25.0 for fit in fits)


def test_no_wrist_is_behind_the_skin(seen: dict[str, Clip]) -> None:
    for clip in seen.values():
        assert wrists(clip)[..., 2].min() > 0.0


def test_seen_points_of_equal_framing_stay_bit_for_bit(seen: dict[str, Clip]) -> None:
    clips = [seen[word] for word in WORDS[:4]]
    result = ss.splice(clips)
    points = result.clip.points
    assert points is not None
    assert points.layout == HOLISTIC
    for span in result.spans:
        if span.clip is None or span.source is None:
            continue
        source = clips[span.clip].points
        assert source is not None
        is_moved = not source.framing.is_like(points.framing)
        kept = points[slice(*span.output)]
        assert is_moved or np.array_equal(kept.values, source.values[slice(*span.source)])
        assert np.array_equal(kept.confidence, source.confidence[slice(*span.source)])
        assert span.remade is None, "nothing is planned over what was seen"
    assert any(not pair[0].span.clip for pair in pairwise(ss.stream(clips)))


def test_a_stream_makes_the_points_of_the_sentence(seen: dict[str, Clip]) -> None:
    clips = [seen[word] for word in WORDS[:3]]
    whole, pieces = ss.splice(clips).clip.points, [piece.clip.points for piece in ss.stream(clips)]
    assert whole is not None
    assert np.array_equal(np.concatenate([part.values for part in pieces if part is not None]), whole.values)


def test_new_points_leave_and_enter_without_a_step(seen: dict[str, Clip]) -> None:
    result = ss.splice([seen["HELLO"], seen["MOTHER"]])
    points = result.clip.points
    assert points is not None
    steps = np.linalg.norm(np.diff(points.values[..., :2], axis=0), axis=-1)
    (start, stop) = next(span.output for span in result.spans if span.kind == "transition")
    inside = np.delete(steps, np.arange(start - 1, stop), axis=0)
    assert steps[start - 1 : stop].max() < 2.0 * inside.max()


def test_a_hand_that_one_word_shows_arrives_with_its_arm(seen: dict[str, Clip]) -> None:
    first, second = seen["HELLO"], seen["NAME"]
    assert first.points is not None
    confidence = np.array(first.points.confidence)
    hand = [k for k, (group, _) in enumerate(HOLISTIC.names) if group == "RIGHT_HAND_LANDMARKS"]
    confidence[:, hand] = 0.0
    first = replace(first, points=replace(first.points, confidence=confidence))
    result = ss.splice([first, second])
    points = result.clip.points
    assert points is not None
    start, stop = next(span.output for span in result.spans if span.kind == "transition")
    assert (points.confidence[start:stop, hand] > 0.0).all()
    assert (np.diff(points.confidence[start - 1 : stop + 1, hand], axis=0) > 0.0).all(), "it fades in"
    wrist = HOLISTIC.names.index(("POSE_LANDMARKS", "RIGHT_WRIST"))
    apart = np.linalg.norm(points.values[start:stop, hand[0], :2] - points.values[start:stop, wrist, :2], axis=-1)
    assert apart.max() < 0.05 * points.framing.scale, "within 5 cm of the arm's own wrist"
    assert (points.confidence[: result.spans[0].output[1], hand] == 0.0).all(), "where it was not seen it is not shown"


def test_words_of_another_framing_and_rate_are_moved_scaled_and_resampled(seen: dict[str, Clip]) -> None:
    first, second = seen["HELLO"], seen["NAME"]
    assert second.points is not None
    values = np.array(second.points.values)
    values[..., :2] = 0.5 * values[..., :2] + 40.0
    layout = replace(HOLISTIC, size=(640, 480, 0))
    small = pose.clip_of(layout, values, second.points.confidence, 24.0, "NAME")
    result = ss.splice([first, small])
    points = result.clip.points
    assert points is not None
    assert points.layout == HOLISTIC, "the first word's header"
    assert any("NAME: landmarks scaled by 2.0" in line for line in result.warnings)
    span = result.spans[-1]
    assert span.source is not None
    expected = resample(second, 30.0)
    shoulder = HOLISTIC.names.index(("POSE_LANDMARKS", "LEFT_SHOULDER"))
    apart = points.values[-1, shoulder] - second.points.values[-1, shoulder]
    assert np.abs(apart[:2]).max() < 0.03 * points.framing.scale, "both signers stand in one place"
    assert expected.points is not None


def test_hidden_frames_are_filled_and_all_others_stay(seen: dict[str, Clip]) -> None:
    clip = seen["SCHOOL"]
    assert clip.points is not None
    filled = ss.inbetween(clip, [(30, 36)]).clip.points
    assert filled is not None
    kept = np.r_[0:30, 36 : len(clip)]
    assert np.array_equal(filled.values[kept], clip.points.values[kept])
    error = np.linalg.norm((filled.values - clip.points.values)[30:36, :, :2], axis=-1).mean()
    held = np.linalg.norm((clip.points.values[29] - clip.points.values[30:36])[..., :2], axis=-1).mean()
    assert error < 0.8 * held


def test_a_sentence_without_landmarks_in_one_word_says_so(seen: dict[str, Clip], words: dict[str, Clip]) -> None:
    for clips in ([seen["HELLO"], words["NAME"]], [words["HELLO"], seen["NAME"]]):
        result = ss.splice(clips)
        assert result.clip.points is None
        assert any("the sentence is made without any" in line for line in result.warnings)


def test_points_survive_an_archive_and_are_left_out_of_motion(seen: dict[str, Clip], tmp_path: Path) -> None:
    clip = seen["YES"]
    ss.save(clip, tmp_path / "yes.npz")
    again = ss.load(tmp_path / "yes.npz").points
    assert again is not None
    assert clip.points is not None
    assert np.array_equal(again.values, clip.points.values)
    assert (again.layout, again.framing) == (clip.points.layout, clip.points.framing)
    ss.save(clip, tmp_path / "yes.bvh")
    assert ss.load(tmp_path / "yes.bvh").points is None


def layout_of(names: Sequence[str], group: str = "BODY_135", form: str = "XYC") -> PointLayout:
    return PointLayout((Component(group, tuple(names), (), (), form),), (100, 100, 0))


def test_points_of_other_detectors_belong_to_the_same_joints(seen: dict[str, Clip]) -> None:
    skeleton = seen["HELLO"].skeleton
    names = [skeleton.names[joint] for joint in find_anchors(
        layout_of(["LShoulder", "RElbow", "LWrist", "LThumb1CMC", "RPinky4FingerTip", "RPupil", "LHip"]), skeleton
    ).joints]  # fmt: skip
    assert names == ["left_shoulder", "right_elbow", "left_wrist", "left_thumb1", "right_pinky3", "head", "left_hip"]
    openpose = find_anchors(layout_of([f"P{n}" for n in range(21)], "hand_right_keypoints_2d"), skeleton)
    assert [skeleton.names[j] for j in openpose.joints[[0, 1, 5, 8, 20]]] == [
        "right_wrist", "right_thumb1", "right_index1", "right_index3", "right_pinky3",
    ]  # fmt: skip
    world = find_anchors(layout_of(["LEFT_WRIST"], "POSE_WORLD_LANDMARKS", "XYZC"), skeleton)
    assert world.joints.tolist() == [-1], "metres, no place in the image"


def encoded(clip: Clip, *, people: int = 1, frames: int | None = None, version: float = 0.2) -> bytes:
    """The bytes of a clip's landmarks with some numbers of the head changed."""
    content = bytearray(pose.encode(clip))
    assert clip.points is not None
    at = len(content) - clip.points.values.nbytes - clip.points.confidence.nbytes - 6
    if frames is not None:
        content[at : at + 4] = frames.to_bytes(4, "little")
    content[at + 4 : at + 6] = people.to_bytes(2, "little")
    content[:4] = np.float32(version).tobytes()
    return bytes(content)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda content: content[:-5], "it ends at byte"),
        (lambda content: content + b"1234", "4 bytes follow its last frame"),
        (lambda content: content[:3], "it ends at byte 3"),
        (lambda content: np.float32(0.7).tobytes() + content[4:], "version 0.7, expected 0.1 or 0.2"),
        (
            lambda content: content.replace(b"XYZC", b"XYZW"),
            "points have 'XYZW', expected coordinates and a confidence",
        ),
        (lambda content: content.replace(b"_SHOULDER", b"_SHOULDXX"), "it shows no signer"),
    ],
)
def test_a_broken_file_has_one_clear_line(change: object, message: str, seen: dict[str, Clip]) -> None:
    assert callable(change)
    with pytest.raises(FormatError, match=message) as error:
        ss.formats.parse(change(pose.encode(seen["YES"])), "a.pose")
    assert str(error.value).startswith("a.pose: ")
    assert "\n" not in str(error.value)


def test_empty_single_and_crowded_files(seen: dict[str, Clip]) -> None:
    clip = seen["YES"]
    assert clip.points is not None
    with pytest.raises(FormatError, match="it has no frames"):
        ss.formats.parse(
            encoded(clip, frames=0)[: -clip.points.values.nbytes - clip.points.confidence.nbytes], "a.pose"
        )
    one = ss.formats.parse(pose.encode(clip[:1]), "one.pose")
    assert len(one) == 1
    values, seen_at = clip.points.values[:, None], clip.points.confidence[:, None]
    body = np.concatenate([values, values], axis=1).tobytes() + np.concatenate([seen_at, seen_at], axis=1).tobytes()
    head = encoded(clip, people=2)[: -values.nbytes - seen_at.nbytes]
    with pytest.raises(FormatError, match="it shows 2 people, expected one"):
        ss.formats.parse(head + body, "two.pose")
    alone = np.concatenate([seen_at, np.zeros_like(seen_at)], axis=1).tobytes()
    chosen = ss.formats.parse(head + body[: 2 * values.nbytes] + alone, "two.pose")
    assert chosen.points is not None
    assert np.array_equal(chosen.points.values, clip.points.values)
    assert any("of 2 people one is seen" in line for line in chosen.notes)


def test_a_word_without_hands_is_a_person_with_relaxed_hands(seen: dict[str, Clip]) -> None:
    points = seen["DEAF"].points
    assert points is not None
    n_body = len(HOLISTIC.components[0].points)
    layout = PointLayout(HOLISTIC.components[:1], HOLISTIC.size)
    clip = pose.clip_of(layout, points.values[:, :n_body], points.confidence[:, :n_body], 30.0, "DEAF")
    assert np.median(np.linalg.norm((wrists(clip) - wrists(seen["DEAF"]))[..., :2], axis=-1)) < 0.05
    result = ss.splice([clip, clip])
    assert result.clip.points is not None


@settings(max_examples=40, deadline=None)
@given(data=st.data())
def test_damaged_bytes_are_read_or_refused_in_one_line(data: st.DataObject, seen: dict[str, Clip]) -> None:
    content = bytearray(pose.encode(seen["YES"][:3]))
    for _ in range(data.draw(st.integers(1, 6))):
        at = data.draw(st.integers(0, min(len(content) - 1, 2500)))
        content[at] = data.draw(st.integers(0, 255))
    try:
        clip = ss.formats.parse(bytes(content), "a.pose")
    except (FormatError, LimitError) as error:
        lines = str(error).splitlines()
    else:
        lines = [""] if np.isfinite(clip.local_rotations).all() else []
    assert len(lines) == 1


def test_wrong_points_are_refused() -> None:
    layout = layout_of(["LShoulder"])
    framing = Framing(1.0, 0.0, 0.0)
    with pytest.raises(InputError, match=r"points \(2, 2, 2\).*expected \(2, 1\) of 2 coordinates"):
        Points(layout, np.zeros((2, 2, 2), np.float32), np.ones((2, 1), np.float32), framing)
    with pytest.raises(InputError, match="not a finite number"):
        Points(layout, np.full((2, 1, 2), np.nan, np.float32), np.ones((2, 1), np.float32), framing)
    Points(
        layout, np.full((2, 1, 2), np.nan, np.float32), np.zeros((2, 1), np.float32), framing
    )  # what was not seen may be anything


def test_points_between_frames_fade_where_one_is_unseen() -> None:
    layout, values = layout_of(["A", "B"]), np.array([[[0, 0], [5, 5]], [[4, 8], [99, 99]]], np.float32)
    points = Points(layout, values, np.array([[1, 1], [1, 0]], np.float32), Framing(1.0, 0.0, 0.0))
    low, high, weight = np.array([0, 0]), np.array([1, 1]), np.array([0.25, 0.0])
    between = points.sample(low, high, weight)
    assert between.values[0].tolist() == [[1.0, 2.0], [5.0, 5.0]]
    assert between.confidence[0].tolist() == [1.0, 0.75]
    assert np.array_equal(between.values[1], values[0]), "a frame itself stays bit for bit"


def test_carried_points_are_those_of_both_ends(words: dict[str, Clip]) -> None:
    clip = seen_again(words["HELLO"])
    made = carry_points(clip, 20, clip[21:25], clip, 25)
    assert clip.points is not None
    assert made.values.shape == clip.points.values[21:25].shape
    assert np.abs(made.values - clip.points.values[21:25]).max() < 30.0


def test_a_projected_clip_shows_its_joints(words: dict[str, Clip]) -> None:
    points, clip = project(words["NAME"]), words["NAME"]
    at = wrists(clip)
    left, right = (HOLISTIC.names.index(("POSE_LANDMARKS", f"{side}_WRIST")) for side in ("LEFT", "RIGHT"))
    shoulders = [HOLISTIC.names.index(("POSE_LANDMARKS", f"{side}_SHOULDER")) for side in ("LEFT", "RIGHT")]
    middle = points.values[:, shoulders].mean(axis=1)
    offset = (points.values[:, [left, right]] - middle[:, None]) / points.framing.scale
    assert np.allclose(offset * (1.0, -1.0, -1.0), at, atol=1e-3)


def test_words_are_cut_between_their_rise_and_their_fall(seen: dict[str, Clip]) -> None:
    """Rest before the belly, where the network takes tremor for strokes: the hands of a dictionary on video."""
    generator = np.random.default_rng(0)
    clips = []
    for word in ("HELLO", "MOTHER", "YES"):
        points = seen[word].points
        assert points is not None
        noise = generator.normal(0.0, 1.0, points.values.shape).astype(np.float32)
        clips.append(pose.clip_of(HOLISTIC, points.values + noise, points.confidence, 30.0, word))
    result = ss.splice(clips)
    heights = wrists(result.clip)[..., 1].max(axis=1)
    for span in result.spans[1:-1]:
        if span.kind == "transition":
            start, stop = span.output
            ends = min(heights[start - 1], heights[stop])
            assert heights[start:stop].min() > ends - 0.05, "the arms do not drop between the words"
            assert ends > -0.25, "nor do the words end at rest"


@dataclass
class FakeBody:
    """A body of pose-format: frames, people, points, coordinates."""

    fps: float
    data: Any
    confidence: Any


@dataclass
class FakePose:
    """A pose of pose-format."""

    header: Any
    body: FakeBody


def as_pose(clip: Clip) -> FakePose:
    """A clip's landmarks as an object with the attributes of ``pose_format.Pose``."""
    points = clip.points
    assert points is not None
    width, height, depth = points.layout.size
    header = SimpleNamespace(
        components=points.layout.components, dimensions=SimpleNamespace(width=width, height=height, depth=depth)
    )
    data = np.ma.masked_array(points.values[:, None], np.repeat(points.confidence[:, None, :, None] <= 0.0, 3, axis=3))
    return FakePose(header, FakeBody(clip.fps, data, points.confidence[:, None]))


def test_stitch_takes_and_gives_poses(seen: dict[str, Clip]) -> None:
    poses = [as_pose(seen[word]) for word in WORDS[:3]]
    joined = ss.stitch(poses)
    assert joined.header is poses[0].header
    assert joined.body.data.shape[1:] == (1, len(HOLISTIC.names), 3)
    assert joined.body.confidence.shape == joined.body.data.shape[:3]
    expected = ss.splice([seen[word] for word in WORDS[:3]], ss.SpliceOptions(tempo="natural")).clip.points
    assert expected is not None
    assert np.array_equal(np.ma.getdata(joined.body.data)[:, 0], expected.values)
    spans = [(10, 60), None, (5, 50)]
    assert len(ss.stitch(poses, signing_spans=spans).body.data) < len(joined.body.data) + 10
    with pytest.raises(InputError, match="no poses"):
        ss.stitch([])
    crowd = as_pose(seen["HELLO"])
    crowd.body.data = np.concatenate([crowd.body.data] * 2, axis=1)
    with pytest.raises(InputError, match="pose 1: 86 frames of 2 people"):
        ss.stitch([poses[0], crowd])


def test_a_doubled_letter_is_formed_again(words: dict[str, Clip]) -> None:
    with ss.open_lexicon() as lexicon:
        letters = [seen_again(lexicon.clip(gloss), gloss) for gloss in ("fs-N", "fs-L")]
    fingers = [k for k, (group, name) in enumerate(HOLISTIC.names) if group.startswith("RIGHT") and "TIP" in name]
    for letter in letters:
        result = ss.splice([letter, letter])
        points = result.clip.points
        assert points is not None
        start, stop = next(span.output for span in result.spans if span.kind == "transition")
        held = points.values[[start - 1, stop]][:, fingers, :2]
        apart = np.linalg.norm(points.values[start:stop, fingers, :2] - held.mean(axis=0), axis=-1)
        assert apart.max() > 0.005 * points.framing.scale, "fingers leave the letter by over 5 mm"
        assert all(span.remade is None for span in result.spans)


def test_headers_are_limited_before_they_are_read() -> None:
    head = struct.pack("<f3HH", 0.2, 100, 100, 0, 40)
    group = struct.pack("<H1s", 1, b"A") + struct.pack("<H4s", 4, b"XYZC") + struct.pack("<3H", 0, 65_535, 65_535)
    with pytest.raises(LimitError, match="points, limbs and colours"):
        ss.formats.parse(head + 40 * (group + bytes(65_535 * 10)), "a.pose")
    empty = struct.pack("<f3HH", 0.2, 1, 1, 0, 0) + struct.pack("<fIH", 25.0, 4_000_000_000, 2)
    with pytest.raises(FormatError, match="it names no points"):
        ss.formats.parse(empty, "a.pose")


def test_stitch_has_the_rate_of_its_sentence(seen: dict[str, Clip]) -> None:
    points = seen["HELLO"].points
    assert points is not None
    slow = pose.clip_of(HOLISTIC, points.values[::2], points.confidence[::2], 15.0, "HELLO")
    joined = ss.stitch([as_pose(slow), as_pose(seen["NAME"])])
    assert joined.body.fps == ss.splice([slow, seen["NAME"]], ss.SpliceOptions(tempo="natural")).clip.fps
    with ss.open_lexicon() as words:
        onto = ss.SpliceOptions(onto=words.clip("NAME"))
    with pytest.raises(InputError, match="on another skeleton a sentence has no landmarks"):
        ss.stitch([as_pose(slow)] * 2, options=onto)


def test_hands_of_openpose_135_bend_as_those_of_holistic(seen: dict[str, Clip]) -> None:
    source = seen["YES"]
    assert source.points is not None
    parts = ("1CMC", "2Knuckles", "3IP", "4FingerTip"), ("1Knuckles", "2PIP", "3DIP", "4FingerTip")
    names, rows = [], []
    for side, letter in (("LEFT", "L"), ("RIGHT", "R")):
        for part in ("Shoulder", "Elbow", "Wrist", "Hip"):
            names.append(letter + part)
            rows.append(HOLISTIC.names.index(("POSE_LANDMARKS", f"{side}_{part.upper()}")))
        first = HOLISTIC.names.index((f"{side}_HAND_LANDMARKS", "WRIST"))
        for n in range(20):
            finger = ("Thumb", "Index", "Middle", "Ring", "Pinky")[n // 4]
            names.append(letter + finger + parts[min(n // 4, 1)][n % 4])
            rows.append(first + 1 + n)
    layout = layout_of(names, "BODY_135", "XYZC")
    clip = pose.clip_of(layout, source.points.values[:, rows], source.points.confidence[:, rows], 30.0, "YES")
    fingers = [k for k, name in enumerate(clip.skeleton.names) if name.startswith("right_index")]
    turned = rotation.angle_between(clip.local_rotations[:, fingers], source.local_rotations[:, fingers])
    assert np.median(turned) < 0.1
    middle = find_anchors(layout_of(["MidHip", "RHip"], "pose_keypoints_2d"), clip.skeleton)
    assert middle.rows["rightUpperLeg"] == (1,)
