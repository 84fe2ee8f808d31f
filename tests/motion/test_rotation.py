"""motion.rotation: group axioms and round trips, and agreement with scipy."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from signsplice.motion import FloatArray, rotation

unit = arrays(np.float64, (5, 4), elements=st.floats(-1, 1)).filter(
    lambda q: bool((np.linalg.norm(q, axis=-1) > 0.1).all())
)
quaternions = unit.map(rotation.normalize)
vectors = arrays(np.float64, (5, 3), elements=st.floats(-10, 10))
ORDERS = ("XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX")


def same(a: FloatArray, b: FloatArray, tolerance: float = 1e-9) -> bool:
    return bool(np.all(rotation.angle_between(a, b) < tolerance))


@given(quaternions, quaternions, quaternions)
def test_rotations_form_a_group(a: FloatArray, b: FloatArray, c: FloatArray) -> None:
    assert np.allclose(
        rotation.multiply(rotation.multiply(a, b), c), rotation.multiply(a, rotation.multiply(b, c)), atol=1e-12
    )
    assert np.allclose(rotation.multiply(a, rotation.IDENTITY), a)
    assert same(rotation.multiply(a, rotation.inverse(a)), rotation.IDENTITY)
    assert same(rotation.inverse(rotation.multiply(a, b)), rotation.multiply(rotation.inverse(b), rotation.inverse(a)))


@given(quaternions, quaternions, vectors)
def test_operations_agree_with_scipy(a: FloatArray, b: FloatArray, v: FloatArray) -> None:
    ra, rb = Rotation.from_quat(a), Rotation.from_quat(b)
    assert np.allclose(rotation.rotate(a, v), ra.apply(v), atol=1e-9)
    assert np.allclose(rotation.to_matrix(a), ra.as_matrix(), atol=1e-12)
    assert np.allclose(rotation.to_matrix(rotation.multiply(a, b)), (ra * rb).as_matrix(), atol=1e-12)
    assert np.allclose(Rotation.from_rotvec(rotation.log(a)).as_matrix(), ra.as_matrix(), atol=1e-9)
    assert np.allclose(np.linalg.norm(rotation.log(a), axis=-1), ra.magnitude(), atol=1e-9)
    assert np.allclose(rotation.angle_between(a, b), (ra.inv() * rb).magnitude(), atol=1e-7)


def test_many_products_are_each_the_same_as_alone() -> None:
    a, b = rotation.normalize(np.random.default_rng(2).normal(size=(2, 500, 4)))
    alone = [rotation.multiply(x, y) for x, y in zip(a, b, strict=True)]
    assert np.array_equal(rotation.multiply(a, b), alone)


@given(quaternions)
def test_every_form_converts_there_and_back(q: FloatArray) -> None:
    assert same(rotation.exp(rotation.log(q)), q)
    assert same(rotation.from_matrix(rotation.to_matrix(q)), q, 1e-7)
    assert same(rotation.from_matrix(rotation.matrix_from_6d(rotation.to_6d(q))), q, 1e-7)
    for axes in ORDERS:
        assert same(rotation.from_euler(rotation.to_euler(q, axes), axes), q, 1e-6), axes


@pytest.mark.parametrize("axes", ORDERS)
def test_from_euler_is_the_intrinsic_product(axes: str) -> None:
    angles = np.random.default_rng(1).uniform(-4.0, 4.0, (50, 3))
    assert same(rotation.from_euler(angles, axes), Rotation.from_euler(axes, angles).as_quat(), 1e-7)
    assert same(
        rotation.from_euler(angles[:, :2], axes[:2]), Rotation.from_euler(axes[:2], angles[:, :2]).as_quat(), 1e-7
    )
    assert same(rotation.from_euler(angles[:, :0], ""), rotation.IDENTITY)


@pytest.mark.parametrize("axes", ORDERS)
@pytest.mark.parametrize("middle", [-np.pi / 2, np.pi / 2])
def test_gimbal_lock_keeps_the_rotation(axes: str, middle: float) -> None:
    q = rotation.from_euler([0.7, middle, -0.4], axes)
    angles = rotation.to_euler(q, axes)
    assert angles[0] == 0.0
    assert same(rotation.from_euler(angles, axes), q, 1e-7)


@given(quaternions, quaternions)
def test_slerp_starts_halves_and_ends_where_it_should(a: FloatArray, b: FloatArray) -> None:
    assert same(rotation.slerp(a, b, np.zeros(5)), a)
    assert same(rotation.slerp(a, b, np.ones(5)), b)
    half = rotation.slerp(a, b, np.full(5, 0.5))
    assert np.allclose(rotation.angle_between(a, half), 0.5 * rotation.angle_between(a, b), atol=1e-7)


@given(vectors, vectors)
def test_between_vectors_rotates_one_onto_the_other(u: FloatArray, v: FloatArray) -> None:
    lengths = np.linalg.norm(u, axis=-1) * np.linalg.norm(v, axis=-1)
    rotated = rotation.rotate(rotation.between_vectors(u, v), u) * np.linalg.norm(v, axis=-1, keepdims=True)
    expected = v * np.linalg.norm(u, axis=-1, keepdims=True)
    defined = lengths > 1e-3  # shorter vectors have no reliable direction
    assert np.allclose(rotated[defined], expected[defined], atol=1e-5 * max(1.0, float(lengths.max())))


def test_between_vectors_accepts_opposite_and_zero_vectors() -> None:
    u = np.array([[1.0, 0.0, 0.0], [0.0, -2.0, 0.0], [0.0, 0.0, 0.0]])
    q = rotation.between_vectors(u, -u)
    assert np.allclose(rotation.rotate(q, u), -u, atol=1e-9)
    assert np.allclose(q[2], rotation.IDENTITY)


def test_right_jacobian_inverse_is_the_rate_of_the_rotvec() -> None:
    rng = np.random.default_rng(3)
    x, w = rng.normal(size=(30, 3)), rng.normal(size=(30, 3))
    x *= (rng.uniform(0.0, 3.0, 30) / np.linalg.norm(x, axis=-1))[:, None]
    step = 1e-6
    moved = rotation.multiply(rotation.exp(x), rotation.exp(step * w))
    numeric = (rotation.log(moved) - x) / step
    assert np.allclose(rotation.right_jacobian_inverse(x, w), numeric, atol=1e-4)


def test_twist_angle_is_the_angle_of_the_twist() -> None:
    axis = np.array([0.0, 0.6, 0.8])
    swing = rotation.exp([0.5, 0.0, 0.0])
    for angle in (-3.0, -0.4, 0.0, 2.9):
        twist = rotation.exp(angle * axis)
        assert rotation.twist_angle(twist, axis) == pytest.approx(angle)
        assert rotation.twist_angle(-twist, axis) == pytest.approx(angle)
    assert abs(rotation.twist_angle(swing, axis)) < 1e-12


def test_continuous_has_no_sign_flips() -> None:
    q = rotation.exp(np.linspace(0.0, 12.0, 60)[:, None, None] * np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]))
    flipped = q * np.where(np.random.default_rng(0).random((60, 2, 1)) < 0.5, -1.0, 1.0)
    out = rotation.continuous(flipped)
    assert np.all(np.sum(out[1:] * out[:-1], axis=-1) > 0.0)
    assert same(out, flipped)


def test_nearest_euler_undoes_revolutions_and_the_other_triple() -> None:
    rng = np.random.default_rng(5)
    reference = rng.uniform(-3.0, 3.0, (40, 3))
    other = reference + 2.0 * np.pi * rng.integers(-3, 4, (40, 3))
    far = np.stack([other[:, 0] + np.pi, np.pi - other[:, 1], other[:, 2] - np.pi], axis=-1)
    assert np.allclose(rotation.nearest_euler(other, reference), reference)
    assert np.allclose(rotation.nearest_euler(far, reference), reference)


@pytest.mark.parametrize("has_start", [True, False])
def test_nearest_euler_sequence_is_nearest_euler_per_frame(has_start: bool) -> None:
    rng = np.random.default_rng(6)
    walk = np.cumsum(rng.normal(size=(80, 7, 3)) * 0.6, axis=0)  # many revolutions, and through gimbal lock
    angles = rotation.to_euler(rotation.from_euler(walk, "ZXY"), "ZXY")
    before = rng.uniform(-9.0, 9.0, (7, 3)) if has_start else None
    expected, last = [], before
    for frame in angles:
        last = frame if last is None else rotation.nearest_euler(frame, last)
        expected.append(last)
    sequence = rotation.nearest_euler_sequence(angles, before)
    assert np.allclose(sequence, expected, atol=1e-9)
    assert same(rotation.from_euler(sequence, "ZXY"), rotation.from_euler(walk, "ZXY"))
    assert np.ptp(sequence) > 4.0 * np.pi


@pytest.mark.parametrize("bad", [np.zeros(4), np.zeros((2, 4))])
def test_a_zero_quaternion_is_refused(bad: FloatArray) -> None:
    with pytest.raises(ValueError, match="length 0"):
        rotation.normalize(bad)


def test_a_degenerate_6d_rotation_is_refused() -> None:
    with pytest.raises(ValueError, match="parallel"):
        rotation.matrix_from_6d([1.0, 0.0, 0.0, 2.0, 0.0, 0.0])
