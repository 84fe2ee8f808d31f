"""BVH files: numbers survive a round trip, curves are continuous, and pybvh reads the same motion."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pybvh
import pytest
from conftest import GOLDEN, random_clip
from hypothesis import given
from hypothesis import strategies as st

from broken_bvh import VALID
from signsplice.errors import InputError
from signsplice.formats import bvh, load, save
from signsplice.formats.bvh import format_rows
from signsplice.motion import Clip, concatenate, euler, resample, rotation
from signsplice.motion.euler import ROTATIONS
from signsplice.rig.inspection import left_out_warnings

MIXED = """HIERARCHY
ROOT Hips
{
	OFFSET 1.0 2.0 3.0
	CHANNELS 6 Zrotation Yrotation Xrotation Xposition Yposition Zposition
	JOINT Six
	{
		OFFSET 0.0 10.0 0.0
		CHANNELS 6 Xposition Yposition Zposition Yrotation Xrotation Zrotation
		JOINT One
		{
			OFFSET 0.0 5.0 0.0
			CHANNELS 1 Xrotation
			JOINT None
			{
				OFFSET 0.0 4.0 0.0
				CHANNELS 0
				End Site
				{
					OFFSET 0.0 1.0 0.0
				}
				End Site
				{
					OFFSET 1.0 1.0 0.0
				}
			}
		}
		JOINT Two
		{
			OFFSET 3.0 5.0 0.0
			CHANNELS 2 Zrotation Yrotation
		}
	}
}
MOTION
Frames: 3
Frame Time: 0.0333333
10.0 20.0 30.0 1.5 90.0 -3.25 0.0 12.0 0.0 5.0 400.0 -200.0 45.0 11.0 -7.0
11.0 20.0 30.0 1.5 90.1 -3.25 0.0 12.0 0.0 5.0 401.0 -200.0 46.0 11.0 -8.0
12.0 20.0 30.0 1.5 90.2 -3.25 0.0 12.0 0.0 5.0 402.0 -200.0 47.0 11.0 -9.0
"""


def test_each_joint_may_have_its_own_channels() -> None:
    clip = bvh.parse(MIXED.encode())
    assert clip.fps == 30.0
    assert np.allclose(clip.root_positions[0], [1.5, 90.0, -3.25])
    assert np.allclose(clip.skeleton.offsets[1], [0.0, 12.0, 0.0]), "a position channel replaces OFFSET"
    assert clip.translations is None
    wanted = rotation.from_euler(np.deg2rad([10.0, 20.0, 30.0]), "ZYX")
    assert np.all(rotation.angle_between(clip.local_rotations[0, 0], wanted) < 1e-9)
    assert np.allclose(rotation.log(clip.local_rotations[0, 2]), [np.deg2rad(45.0), 0.0, 0.0])
    assert np.allclose(clip.local_rotations[:, 3], rotation.IDENTITY)
    assert [site.joint for site in clip.skeleton.end_sites] == [3, 3]


def test_bone_lengths_that_change_are_kept_per_frame() -> None:
    text = MIXED.replace("0.0 12.0 0.0 5.0 402.0", "0.0 12.5 0.0 5.0 402.0")
    clip = bvh.parse(text.encode())
    assert clip.translations is not None
    assert np.allclose(clip.translations[:, 1, 1], [12.0, 12.0, 12.5])


@pytest.mark.parametrize("text", [MIXED, MIXED.replace("0.0 12.0 0.0 5.0 402.0", "0.0 12.5 0.0 5.0 402.0")])
def test_a_file_is_written_as_it_was_read(text: str, tmp_path: Path) -> None:
    clip = bvh.parse(text.encode(), "mixed.bvh")
    save(clip, tmp_path / "out.bvh")
    again = load(tmp_path / "out.bvh")
    assert again.channels is not None
    assert clip.channels is not None
    assert np.array_equal(again.channels.values, clip.channels.values)
    assert again.channels.names == clip.channels.names
    assert again.skeleton.names == clip.skeleton.names
    assert np.array_equal(again.channels.offsets, clip.channels.offsets)
    assert "Frame Time: 0.0333333\n" in (tmp_path / "out.bvh").read_text()
    assert bvh.encode(again) == bvh.encode(clip)


def test_real_files_are_written_with_the_same_numbers(real_clips: dict[str, Clip]) -> None:
    for clip in real_clips.values():
        again = bvh.parse(bvh.encode(clip))
        assert clip.channels is not None
        assert again.channels is not None
        assert np.array_equal(again.channels.values, clip.channels.values)
        assert again.channels.frame_time == clip.channels.frame_time


@pytest.mark.parametrize("seed", range(4))
def test_pybvh_reads_what_we_write(seed: int, tmp_path: Path) -> None:
    clip = random_clip(seed)
    save(clip, tmp_path / "clip.bvh")
    other = pybvh.read_bvh_file(tmp_path / "clip.bvh", world_up="+y")
    assert other.frame_count == len(clip)
    assert other.fps == pytest.approx(clip.fps)
    assert np.allclose(other.root_pos, clip.root_positions, atol=1e-7)


def test_positions_agree_with_a_file_written_by_pybvh() -> None:
    """tests/golden/pybvh_chain.bvh was written by pybvh; the positions beside it are its own forward kinematics."""
    from signsplice.motion import kinematics

    clip = load(GOLDEN / "pybvh_chain.bvh")
    with np.load(GOLDEN / "pybvh_chain.npz") as golden:
        assert str(golden["convention"]).startswith("positions (T, J, 3)")
        assert np.allclose(kinematics.forward(clip)[1], golden["positions"], atol=1e-9)


@pytest.mark.parametrize(
    ("frame_time", "fps"),
    [
        (0.033333, 30.0),
        (0.0333333333333, 30.0),
        (0.0333, 30.0),
        (0.033, 30.0),
        (0.04, 25.0),
        (0.041667, 24.0),
        (0.0416667, 24.0),
        (0.008333, 120.0),
        (0.00833333, 120.0),
        (0.016667, 60.0),
        (0.0333667, 30000 / 1001),
        (0.03336667, 30000 / 1001),
        (0.041708, 24000 / 1001),
        (0.01, 100.0),
        (0.5, 2.0),
        (1.0, 1.0),
        (2.5, 0.4),
        (0.0123456, 1 / 0.0123456),
        (0.0167, 60.0),
        (0.07, 1 / 0.07),
        (0.3, 1 / 0.3),
        (0.06, 1 / 0.06),
        (0.016, 62.5),
        (0.017, 1 / 0.017),
    ],
)
def test_frame_time_gives_the_rate_it_was_rounded_from(frame_time: float, fps: float) -> None:
    assert bvh.standard_fps(frame_time) == pytest.approx(fps, rel=1e-12)


@pytest.mark.parametrize("fps", [*range(1, 1001), *(n * 1000 / 1001 for n in (24, 30, 48, 60, 120, 240))])
def test_every_rate_comes_back_from_a_frame_time_of_seven_digits(fps: float) -> None:
    frame_time = float(f"{1 / fps:.7g}")
    assert bvh.standard_fps(frame_time) == fps


@pytest.mark.parametrize(("frame_time", "is_named"), [("0.0333333", False), ("0.07", False), ("0.033", True)])
def test_a_frame_time_that_is_brought_to_another_rate_is_named(frame_time: str, is_named: bool) -> None:
    clip = bvh.parse(MIXED.replace("0.0333333", frame_time).encode(), "WAVE.bvh")
    line = f"WAVE: its Frame Time of {frame_time} s is read as 30 fps, which it seems to be rounded from"
    assert left_out_warnings(clip) == ((line,) if is_named else ())
    assert f"Frame Time: {frame_time}\n".encode() in bvh.encode(clip)
    assert len(left_out_warnings(resample(clip, 24.0))) == is_named


def test_a_rate_in_the_place_of_a_time_is_read_as_one_and_written_as_a_time() -> None:
    for rate in ("15", "29.97", "120"):
        clip = bvh.parse(MIXED.replace("Frame Time: 0.0333333", f"Frame Time: {rate}").encode(), "WAVE.bvh")
        assert clip.fps == pytest.approx(float(rate), rel=1e-4)
        assert clip.notes == (f"its Frame Time of {rate} is read as a rate: {rate} fps",)
        again = bvh.parse(bvh.encode(clip), "WAVE.bvh")
        assert (again.fps, again.notes) == (clip.fps, ())


def spinning(start_deg: float, rate_deg: float, n_frames: int, shift: float = 0.0) -> Clip:
    """A clip parsed from text, in which one Euler angle of the second joint grows evenly."""
    clip = bvh.parse(MIXED.encode())
    assert clip.channels is not None
    values = np.repeat(clip.channels.values[:1], n_frames, axis=0)
    values[:, 10] = start_deg + rate_deg * np.arange(n_frames) + shift
    lines = MIXED.splitlines()
    head = [*lines[: lines.index("MOTION") + 1], f"Frames: {n_frames}", "Frame Time: 0.0333333"]
    return bvh.parse("\n".join([*head, *(" ".join(map(repr, row)) for row in values.tolist())]).encode())


@pytest.mark.parametrize("shift", [0.0, 360.0, -720.0])
def test_curves_are_continuous_through_a_transition(shift: float) -> None:
    """150 -> 170 | transition | 195 -> 215, where the second file's angles are off by whole revolutions."""
    before, after = spinning(150.0, 2.0, 11), spinning(195.0, 2.0, 11, shift)
    middle = after[:6]
    middle = replace(
        middle,
        local_rotations=rotation.slerp(
            before.local_rotations[-1], after.local_rotations[0], np.linspace(0.1, 0.9, 6)[:, None]
        ),
        channels=before.channels.forgotten(6) if before.channels else None,
    )
    joined = bvh.parse(bvh.encode(concatenate([before, middle, after])))
    assert joined.channels is not None
    columns = [i for i, name in enumerate(n for names in joined.channels.names for n in names) if name in ROTATIONS]
    steps = np.abs(np.diff(joined.channels.values[:, columns], axis=0))
    assert steps.max() < 30.0, "no jump by a half or whole revolution"
    assert np.array_equal(joined.channels.values[:11], np.asarray(before.channels.values if before.channels else 0))
    assert np.allclose(joined.channels.values[17:, 10], 195.0 + 2.0 * np.arange(11))
    whole = concatenate([before, middle, after])
    assert np.all(rotation.angle_between(joined.local_rotations, whole.local_rotations) < 1e-6)


def test_equivalent_euler_triples_continue_the_curve() -> None:
    """A file that writes (a + 180, 180 - b, c + 180) continues one that writes (a, b, c)."""
    before = spinning(20.0, 1.0, 5)
    assert before.channels is not None
    values = np.array(before.channels.values)
    values[:, :3] = np.stack([values[:, 0] + 180.0, 180.0 - values[:, 1], values[:, 2] + 180.0], axis=1)
    after = replace(before, channels=replace(before.channels, values=values))
    joined = bvh.parse(bvh.encode(concatenate([before, after])))
    assert joined.channels is not None
    assert np.allclose(joined.channels.values[5:, :3], before.channels.values[:, :3])


def test_a_joint_gets_the_rotation_channels_its_motion_needs() -> None:
    clip = bvh.parse(MIXED.encode())
    bent = np.array(clip.local_rotations)
    bent[:, 2] = rotation.exp([0.3, 0.2, 0.1])
    assert clip.channels is not None
    derived = replace(clip, local_rotations=bent, channels=clip.channels.forgotten(3))
    again = bvh.parse(bvh.encode(derived))
    assert again.channels is not None
    assert again.channels.names[2] == ("Xrotation", "Zrotation", "Yrotation")
    assert again.channels.names[3] == (), "a joint that does not rotate gets none"
    assert again.channels.names[4] == ("Zrotation", "Yrotation")
    assert np.all(rotation.angle_between(again.local_rotations, bent) < 1e-6)


def test_numbers_of_an_edited_clip_are_computed_anew() -> None:
    """A file's numbers are written only where they still give the clip's rotations and positions."""
    clip = bvh.parse(MIXED.encode())
    rotated = np.array(clip.local_rotations)
    rotated[1:, 0] = rotation.multiply(rotation.exp([0.0, 0.4, 0.0]), rotated[1:, 0])
    edited = replace(clip, local_rotations=rotated, root_positions=clip.root_positions + np.array([0.0, 5.0, 0.0]))
    again = bvh.parse(bvh.encode(edited))
    assert np.all(rotation.angle_between(again.local_rotations, rotated) < 1e-6)
    assert np.allclose(again.root_positions, edited.root_positions, atol=1e-6)
    assert again.channels is not None
    assert clip.channels is not None
    assert np.array_equal(again.channels.values[:, 6:], clip.channels.values[:, 6:])


def test_a_root_gets_the_position_channels_its_motion_needs() -> None:
    text = MIXED.replace(
        "CHANNELS 6 Zrotation Yrotation Xrotation Xposition Yposition Zposition",
        "CHANNELS 5 Zrotation Yrotation Xrotation Xposition Zposition",
    )
    text = (
        text.replace("1.5 90.0 -3.25", "1.5 -3.25")
        .replace("1.5 90.1 -3.25", "1.5 -3.25")
        .replace("1.5 90.2 -3.25", "1.5 -3.25")
    )
    clip = bvh.parse(text.encode())
    raised = replace(clip, root_positions=clip.root_positions + np.array([0.0, 7.0, 0.0]))
    again = bvh.parse(bvh.encode(raised))
    assert np.allclose(again.root_positions, raised.root_positions, atol=1e-9)
    assert bvh.parse(bvh.encode(clip)).channels.names == clip.channels.names  # type: ignore[union-attr]


def test_joints_in_any_order_are_written_correctly() -> None:
    from signsplice.motion import Skeleton, kinematics

    rng = np.random.default_rng(1)
    skeleton = Skeleton(("a", "b", "c", "b2", "c2"), np.array([-1, 0, 0, 1, 2]), rng.normal(size=(5, 3)))
    clip = Clip(skeleton, rotation.normalize(rng.normal(size=(6, 5, 4))), rng.normal(size=(6, 3)), 30.0)
    again = bvh.parse(bvh.encode(clip))
    assert again.skeleton.names == ("a", "b", "b2", "c", "c2")
    expected = dict(zip(skeleton.names, kinematics.forward(clip)[1].transpose(1, 0, 2), strict=True))
    for name, positions in zip(again.skeleton.names, kinematics.forward(again)[1].transpose(1, 0, 2), strict=True):
        assert np.allclose(positions, expected[name], atol=1e-6)


@pytest.mark.parametrize(
    ("name", "held"),
    [
        ("my hips", "my_hips"),
        (" hips", "hips"),
        ("hips\n", "hips"),
        ("\u2028a  b\u3000", "a_b"),
        ("a {", "a__"),
        ("}", "}"),
    ],
)
def test_names_of_other_formats_are_written_without_white_space(name: str, held: str, tmp_path: Path) -> None:
    clip = random_clip(0, n_joints=4)
    clip = replace(clip, skeleton=replace(clip.skeleton, names=(name, "my_hips_2", held + " ", "d")))
    assert bvh.written_names(clip) == list(bvh.parse(bvh.encode(clip)).skeleton.names)
    assert bvh.written_names(clip)[:2] == [held, "my_hips_2"]
    save(clip, tmp_path / "clip.bvh")
    assert np.allclose(
        pybvh.read_bvh_file(tmp_path / "clip.bvh", world_up="+y").root_pos, clip.root_positions, atol=1e-7
    )
    assert np.allclose(load(tmp_path / "clip.bvh").root_positions, clip.root_positions, atol=1e-7)


@pytest.mark.parametrize("name", ["", " ", "\x00"])
def test_joints_without_a_name_are_refused(name: str) -> None:
    clip = random_clip(0)
    names = (name, *clip.skeleton.names[1:])
    with pytest.raises(InputError, match=re.escape(f"joint name {name!r} is empty, which BVH cannot hold")):
        bvh.encode(replace(clip, skeleton=replace(clip.skeleton, names=names)))


def test_gimbal_lock_does_not_make_curves_jump() -> None:
    angles = np.stack([np.full(41, 30.0), np.linspace(70.0, 110.0, 41), np.linspace(0.0, 20.0, 41)], axis=1)
    clip = random_clip(0, n_frames=41)
    local = np.array(clip.local_rotations)
    local[:, 1] = rotation.from_euler(np.deg2rad(angles), "ZXY")
    again = bvh.parse(bvh.encode(replace(clip, local_rotations=local)))
    assert again.channels is not None
    assert np.abs(np.diff(again.channels.values[:, 6:9], axis=0)).max() < 5.0
    assert np.all(rotation.angle_between(again.local_rotations, local) < 1e-6)


def test_printed_numbers_are_read_back_unchanged() -> None:
    rng = np.random.default_rng(0)
    plain = np.round(rng.normal(size=(40, 23)) * 10.0 ** rng.integers(-6, 6, (40, 23)), 8).astype(np.float64)
    plain[0, :8] = [0.0, -0.0, 1.0, -1e-8, 999999.99999999, 5e-5, 10.0, -100.5]
    wild = np.array([[1e9, 2.0, 3.0], [0.1, -0.25, 7.0], [np.pi, 1e-12, -1.0]])
    for rows in (plain, wild, plain[:1, :1]):
        lines = format_rows(rows).split("\n")
        back = np.array([[float(number) for number in line.split(" ")] for line in lines])
        np.testing.assert_array_equal(back, rows)
        assert (np.signbit(back) == np.signbit(rows)).all()
    assert format_rows(plain[:1, :8]) == "0.0 -0.0 1.0 -0.00000001 999999.99999999 0.00005 10.0 -100.5"
    assert format_rows(wild[1:2]) == "0.1 -0.25 7.0"


decimals = st.one_of(
    st.from_regex(r"[+-]?([0-9]{1,25}(\.[0-9]{0,25})?|\.[0-9]{1,25})([eE][+-]?[0-9]{1,2})?", fullmatch=True),
    st.floats(allow_nan=False, allow_infinity=False, min_value=-1e11, max_value=1e11).map(repr),
)


@given(st.lists(decimals, min_size=3, max_size=3), st.sampled_from([" ", "\t", "  \v ", " \f"]))
def test_numbers_are_read_as_float_reads_them(tokens: list[str], between: str) -> None:
    row = between.join(["0 90 0", *tokens])
    clip = bvh.parse(VALID.replace("0 90 0 1 2 3", row).encode())
    assert clip.channels is not None
    read, wanted = clip.channels.values[0, 3:6], np.array([float(token) for token in tokens])
    assert np.array_equal(read, wanted)
    assert np.array_equal(np.signbit(read), np.signbit(wanted))


def test_files_longer_than_a_block_are_read_whole() -> None:
    values = np.round(np.random.default_rng(0).uniform(-180.0, 180.0, (9001, 9)), 6)
    head = VALID[: VALID.index("0 90 0 1")].replace("Frames: 2", "Frames: 9001")
    rows = [" ".join(map(repr, row)) + "\n" * (1 + n % 2) for n, row in enumerate(values.tolist())]
    clip = bvh.parse((head + "".join(rows)).encode())
    assert clip.channels is not None
    assert np.array_equal(clip.channels.values, values)
    for line, text, message in ((8000, "1 2 3", "3 numbers in a frame"), (4095, "1 2 3 4 5 6 7 8 x", "'x' is not")):
        broken = [*rows[:line], text + "\n", *rows[line + 1 :]]
        number = 19 + sum(row.count("\n") for row in rows[:line])
        with pytest.raises(InputError, match=f":{number}: {message}"):
            bvh.parse((head + "".join(broken)).encode())
    for count in (9000, 4096, 9002):
        other = bvh.parse((head.replace("9001", str(count)) + "".join(rows) + "the end\n" * (count < 9001)).encode())
        assert other.notes[0] == f"Frames: says {count}, but 9001 frames follow, which are read"
        assert np.array_equal(other.local_rotations, clip.local_rotations)


@pytest.mark.parametrize("channels", [("Zrotation", "Xrotation", "Yrotation"), ("Yrotation",), ()])
def test_rotations_do_not_depend_on_the_length_of_the_clip(channels: tuple[str, ...]) -> None:
    names = (("Xposition", "Yposition", "Zposition", "Zrotation"), *([channels] * 6))
    values = np.random.default_rng(0).uniform(-400.0, 400.0, (8200, 4 + 6 * len(channels)))
    whole = euler.to_motion(names, values, np.zeros((7, 3)))[0]
    for rows in (slice(0, 1), slice(4090, 4101), slice(8191, 8200)):
        assert np.array_equal(euler.to_motion(names, values[rows], np.zeros((7, 3)))[0], whole[rows])
