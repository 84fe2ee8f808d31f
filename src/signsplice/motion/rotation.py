"""Batched operations on rotations that scipy's ``Rotation`` lacks.

Convention: a rotation is a unit quaternion ``(..., 4)`` in scipy's order **x, y, z, w** (rejected: w first, which
every call of scipy would have to reorder). Quaternions act on column vectors; ``multiply(a, b)`` does ``b``
first, then ``a``, so that ``global = multiply(parent_global, local)``. Angles are radians. All functions broadcast over
leading axes, are pure and leave their arguments unchanged.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]
"""An array of 64-bit numbers; its docstring or comment gives the shape."""
IDENTITY: FloatArray = np.array([0.0, 0.0, 0.0, 1.0])
IDENTITY.flags.writeable = False

_AXIS = {"X": 0, "Y": 1, "Z": 2}
_TINY = 1e-12
_COMPONENTS = np.arange(4)
_NEXT = np.array([1, 2, 0])
"""Index of the axis after each axis, cyclically."""
_LAST = np.array([2, 0, 1])
"""Index of the axis before each axis, cyclically."""
_FEW = 1600
"""Largest total size of both factors for which a product with few numpy calls is fastest."""
_W_FIRST = np.array([[3], [0], [1], [2]])
_FACTORS = np.array([[0, 1, 2, 3], [3, 2, 1, 0], [2, 3, 0, 1], [1, 0, 3, 2]])
_SIGNS = np.array([[1.0, 1.0, 1.0, 1.0], [1.0, -1.0, 1.0, -1.0], [1.0, 1.0, -1.0, -1.0], [-1.0, 1.0, 1.0, -1.0]])
"""A product is the sum over w, x, y, z of the first factor, each times the second's components in ``_FACTORS``' order
with these signs.
"""


def cross(a: ArrayLike, b: ArrayLike) -> FloatArray:
    """Return the cross product (..., 3); several times as fast as numpy's on the small arrays of a seam."""
    a, b = np.asarray(a, np.float64), np.asarray(b, np.float64)
    product = a.take(_NEXT, axis=-1) * b.take(_LAST, axis=-1)
    product -= a.take(_LAST, axis=-1) * b.take(_NEXT, axis=-1)
    return np.asarray(product)


def multiply(a: ArrayLike, b: ArrayLike) -> FloatArray:
    """Product ``a * b`` (``b`` acts first), (..., 4)."""
    a, b = np.asarray(a, np.float64), np.asarray(b, np.float64)
    if a.size + b.size <= _FEW:
        terms = a.take(_W_FIRST, axis=-1) * (b.take(_FACTORS, axis=-1) * _SIGNS)
        return np.asarray(terms[..., 0, :] + terms[..., 1, :] + terms[..., 2, :] + terms[..., 3, :])
    (ax, ay, az, aw), (bx, by, bz, bw) = (np.ascontiguousarray(q.transpose(-1, *range(q.ndim - 1))) for q in (a, b))
    product = np.empty(np.broadcast_shapes(a.shape, b.shape))
    product[..., 0] = aw * bx + ax * bw + ay * bz - az * by
    product[..., 1] = aw * by - ax * bz + ay * bw + az * bx
    product[..., 2] = aw * bz + ax * by - ay * bx + az * bw
    product[..., 3] = aw * bw - ax * bx - ay * by - az * bz
    return product


def inverse(q: ArrayLike) -> FloatArray:
    """Inverse of unit quaternions, (..., 4)."""
    return np.asarray(np.asarray(q, np.float64) * np.array([-1.0, -1.0, -1.0, 1.0]))


def normalize(q: ArrayLike) -> FloatArray:
    """Scale quaternions (..., 4) to unit length. Raises ``ValueError`` if one has length 0."""
    q = np.asarray(q, np.float64)
    length = np.linalg.norm(q, axis=-1, keepdims=True)
    if np.any(length < _TINY):
        raise ValueError("a quaternion of length 0 is no rotation")
    return np.asarray(q / length)


def rotate(q: ArrayLike, v: ArrayLike) -> FloatArray:
    """Rotate vectors ``v`` (..., 3) by ``q`` (..., 4): v + 2w(u x v) + 2u x (u x v), u the vector part."""
    q, v = np.asarray(q, np.float64), np.asarray(v, np.float64)
    u = q[..., :3]
    t = 2.0 * cross(u, v)
    return np.asarray(v + q[..., 3:] * t + cross(u, t))


def to_matrix(q: ArrayLike) -> FloatArray:
    """Rotation matrices (..., 3, 3) of unit quaternions (..., 4)."""
    q = np.asarray(q, np.float64)
    x, y, z, w = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
    x2, y2, z2 = x + x, y + y, z + z
    xx, yy, zz = x * x2, y * y2, z * z2
    xy, xz, yz = x * y2, x * z2, y * z2
    wx, wy, wz = w * x2, w * y2, w * z2
    m = np.empty((*q.shape[:-1], 3, 3))
    m[..., 0, 0] = 1.0 - yy - zz
    m[..., 0, 1] = xy - wz
    m[..., 0, 2] = xz + wy
    m[..., 1, 0] = xy + wz
    m[..., 1, 1] = 1.0 - xx - zz
    m[..., 1, 2] = yz - wx
    m[..., 2, 0] = xz - wy
    m[..., 2, 1] = yz + wx
    m[..., 2, 2] = 1.0 - xx - yy
    return m


def from_matrix(m: ArrayLike) -> FloatArray:
    """Convert rotation matrices (..., 3, 3) to unit quaternions (..., 4), w >= 0 (Bar-Itzhack 2000, by the largest
    component).
    """
    m = np.asarray(m, np.float64)
    # Components first: long rows for many rotations, few operations for one.
    (m00, m01, m02), (m10, m11, m12), (m20, m21, m22) = m.transpose(m.ndim - 2, m.ndim - 1, *range(m.ndim - 2))
    trace = m00 + m11 + m22
    rows = np.empty((4, 4, *m.shape[:-2]))
    # Four times the squared components; the largest one is safe to divide by.
    rows[0, 0], rows[1, 1], rows[2, 2] = (1.0 + 2.0 * d - trace for d in (m00, m11, m22))
    rows[3, 3] = 1.0 + trace
    rows[0, 1], rows[0, 2], rows[1, 2] = m01 + m10, m02 + m20, m12 + m21
    rows[0, 3], rows[1, 3], rows[2, 3] = m21 - m12, m02 - m20, m10 - m01
    for i, j in ((1, 0), (2, 0), (2, 1), (3, 0), (3, 1), (3, 2)):
        rows[i, j] = rows[j, i]
    flat = rows.reshape(4, 4, -1)
    best = flat[_COMPONENTS, _COMPONENTS].argmax(axis=0)
    q = flat[best, :, np.arange(len(best))].reshape(*m.shape[:-2], 4)
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    return np.asarray(np.where(q[..., 3:] < 0.0, -q, q))


def nearest(m: FloatArray) -> FloatArray:
    """Return the rotations (..., 4) nearest to matrices (..., 3, 3) in least squares (Kabsch 1976)."""
    u, _, vt = np.linalg.svd(m)
    u[..., -1] *= np.linalg.det(u @ vt)[..., None]
    return from_matrix(u @ vt)


def exp(rotvec: ArrayLike) -> FloatArray:
    """Unit quaternions (..., 4) of rotation vectors (..., 3), radians."""
    v = np.asarray(rotvec, np.float64)
    angle = np.sqrt(np.einsum("...i,...i->...", v, v))[..., None]
    half = np.pi * (angle / (2.0 * np.pi))
    half = np.where(half, half, np.finfo(np.float64).eps)  # sin(a/2)/a is exact at 0 too
    scale = 0.5 * (np.sin(half) / half)
    return np.concatenate([v * scale, np.cos(0.5 * angle)], axis=-1)


def log(q: ArrayLike) -> FloatArray:
    """Rotation vectors (..., 3) of unit quaternions (..., 4), along the shorter arc (angle <= pi)."""
    q = np.asarray(q, np.float64)
    sign = np.where(q[..., 3:] < 0.0, -1.0, 1.0)
    v, w = q[..., :3] * sign, q[..., 3:] * sign
    s = np.sqrt(np.einsum("...i,...i->...", v, v))[..., None]
    small = s < 1e-9
    scale = np.where(small, 2.0, 2.0 * np.arctan2(s, w) / np.where(small, 1.0, s))
    return np.asarray(v * scale)


def difference(a: ArrayLike, b: ArrayLike) -> FloatArray:
    """Rotation vector (..., 3) that takes ``a`` to ``b`` in the frame of ``a``: log(a^-1 b)."""
    return log(multiply(inverse(a), b))


def angle_between(a: ArrayLike, b: ArrayLike) -> FloatArray:
    """Angle (...) between two rotations, radians in [0, pi]."""
    d = difference(a, b)
    return np.asarray(np.sqrt(np.einsum("...i,...i->...", d, d)))


def slerp(a: ArrayLike, b: ArrayLike, t: ArrayLike) -> FloatArray:
    """Great-circle interpolation (..., 4) from ``a`` (t = 0) to ``b`` (t = 1), along the shorter arc."""
    t = np.asarray(t, np.float64)
    return multiply(a, exp(difference(a, b) * t[..., None]))


def nlerp(a: ArrayLike, b: ArrayLike, t: ArrayLike) -> FloatArray:
    """Normalised linear interpolation (..., 4), along the shorter arc."""
    a, b = np.asarray(a, np.float64), np.asarray(b, np.float64)
    t = np.asarray(t, np.float64)[..., None]
    b = np.where(np.sum(a * b, axis=-1, keepdims=True) < 0.0, -b, b)
    q = (1.0 - t) * a + t * b
    return np.asarray(q / np.linalg.norm(q, axis=-1, keepdims=True))


def continuous(q: ArrayLike) -> FloatArray:
    """Choose signs of rotations (T, ..., 4) so that neighbours along the first axis have no negative dot product."""
    q = np.array(q, np.float64)
    if len(q) > 1:
        flip = np.sum(q[1:] * q[:-1], axis=-1) < 0.0
        q[1:] *= np.where(np.cumsum(flip, axis=0) % 2 == 1, -1.0, 1.0)[..., None]
    return q


def between_vectors(u: ArrayLike, v: ArrayLike) -> FloatArray:
    """Smallest rotations (..., 4) that turn the directions ``u`` (..., 3) into ``v`` (..., 3).

    Lengths do not matter. Opposite directions turn by pi about some axis normal to ``u``; a zero vector gives identity.
    """
    u, v = np.broadcast_arrays(np.asarray(u, np.float64), np.asarray(v, np.float64))
    length = np.linalg.norm(u, axis=-1) * np.linalg.norm(v, axis=-1)
    w = length + np.einsum("...i,...i->...", u, v)
    q = np.concatenate([cross(u, v), w[..., None]], axis=-1)
    opposite = (w < 1e-9 * length) & (length > 0.0)
    if np.any(opposite):
        least = np.eye(3)[np.argmin(np.abs(u), axis=-1)]
        axis = cross(u, least)
        q = np.where(opposite[..., None], np.concatenate([axis, np.zeros((*axis.shape[:-1], 1))], -1), q)
    norm = np.linalg.norm(q, axis=-1, keepdims=True)
    return np.where(norm < _TINY, IDENTITY, q / np.where(norm < _TINY, 1.0, norm))


def twist_angle(q: ArrayLike, axis: ArrayLike) -> FloatArray:
    """Signed angle (...) in (-pi, pi] by which ``q`` turns about the unit ``axis`` (..., 3) (swing-twist
    decomposition).
    """
    q = np.asarray(q, np.float64)
    axis_part = np.einsum("...i,...i->...", q[..., :3], np.asarray(axis, np.float64))
    angle = 2.0 * np.arctan2(axis_part, q[..., 3])
    return np.asarray(np.pi - np.mod(np.pi - angle, 2.0 * np.pi))


def right_jacobian_inverse(rotvec: ArrayLike, w: ArrayLike) -> FloatArray:
    """Rate of the rotation vector (..., 3) at ``rotvec`` whose body angular velocity is ``w`` (..., 3).

    x' = J_r(x)^-1 w with J_r^-1 = I + [x]/2 + (1/|x|^2 - (1 + cos|x|) / (2|x| sin|x|)) [x]^2 (Chirikjian 2012, eq.
    10.86). Unbounded as the angle nears 2 pi; rotation vectors from ``log`` stay at or below pi, where it is finite.
    """
    x, w = np.asarray(rotvec, np.float64), np.asarray(w, np.float64)
    angle = np.sqrt(np.einsum("...i,...i->...", x, x))[..., None]
    small = angle < 1e-4
    a = np.where(small, 1.0, angle)
    # (1 + cos a)/(2 a sin a) written as cot(a/2)/(2a), which is finite at pi.
    k = np.where(small, 1.0 / 12.0, 1.0 / a**2 - 1.0 / (2.0 * a * np.tan(0.5 * a)))
    xw = cross(x, w)
    return np.asarray(w + 0.5 * xw + k * cross(x, xw))


def from_euler(angles: ArrayLike, axes: str) -> FloatArray:
    """Quaternions (..., 4) of intrinsic Euler angles (..., n), radians.

    ``axes`` holds n letters of XYZ in the order of the product: ``"ZXY"`` is Rz(a0) Rx(a1) Ry(a2), which is what BVH's
    channel order means. n may be 0 to 3.
    """
    half = 0.5 * np.asarray(angles, np.float64)
    q: list[FloatArray | float] = [0.0, 0.0, 0.0, 1.0]
    for n, letter in enumerate(axes):
        i = _AXIS[letter]
        j, k = (i + 1) % 3, (i + 2) % 3
        c, s = np.cos(half[..., n]), np.sin(half[..., n])
        # Multiplying by (0, .., s at i, .., 0, c) on the right mixes the pairs (i, w) and (j, k).
        q[i], q[3] = q[i] * c + q[3] * s, q[3] * c - q[i] * s
        q[j], q[k] = q[j] * c + q[k] * s, q[k] * c - q[j] * s
    quats = np.empty((*half.shape[:-1], 4))
    for n, component in enumerate(q):
        quats[..., n] = component
    return quats


def to_euler(q: ArrayLike, axes: str) -> FloatArray:
    """Intrinsic Euler angles (..., 3), radians, of rotations (..., 4) for three different ``axes`` ("ZXY", ...).

    The middle angle lies in [-pi/2, pi/2]. In gimbal lock the first angle is 0 and the third takes the whole rotation.
    """
    i, j, k = (_AXIS[letter] for letter in axes)
    sign = 1.0 if (j - i) % 3 == 1 else -1.0
    m = to_matrix(q)
    middle = np.arcsin(np.clip(sign * m[..., i, k], -1.0, 1.0))
    first = np.arctan2(-sign * m[..., j, k], m[..., k, k])
    third = np.arctan2(-sign * m[..., i, j], m[..., i, i])
    locked = np.hypot(m[..., i, j], m[..., i, i]) < 1e-8
    if np.any(locked):
        first = np.where(locked, 0.0, first)
        third = np.where(locked, np.arctan2(sign * m[..., j, i], m[..., j, j]), third)
    return np.stack([first, middle, third], axis=-1)


def nearest_euler(angles: ArrayLike, reference: ArrayLike) -> FloatArray:
    """Return the Euler angles (..., 3) of the same rotation nearest to ``reference`` (..., 3).

    A rotation has the triples (a, b, c) and (a + pi, pi - b, c + pi), each up to whole revolutions of any angle.
    """
    angles, reference = np.asarray(angles, np.float64), np.asarray(reference, np.float64)
    alternative = np.stack([angles[..., 0] + np.pi, np.pi - angles[..., 1], angles[..., 2] + np.pi], axis=-1)
    revolution = 2.0 * np.pi
    direct = angles + revolution * np.round((reference - angles) / revolution)
    flipped = alternative + revolution * np.round((reference - alternative) / revolution)
    cost_direct = np.sum(np.abs(direct - reference), axis=-1, keepdims=True)
    cost_flipped = np.sum(np.abs(flipped - reference), axis=-1, keepdims=True)
    return np.where(cost_flipped < cost_direct, flipped, direct)


def nearest_euler_sequence(angles: ArrayLike, before: ArrayLike | None = None) -> FloatArray:
    """Return Euler angles (T, ..., 3) of the same rotations, in each frame nearest to the frame before, in the first
    frame nearest to ``before`` (..., 3) if given: ``nearest_euler`` frame by frame, computed for all frames at once.
    """
    angles = np.asarray(angles, np.float64)
    revolution = 2.0 * np.pi
    alternative = np.stack([angles[..., 0] + np.pi, np.pi - angles[..., 1], angles[..., 2] + np.pi], axis=-1)
    both = np.stack([angles, alternative])
    # Cost of each step from either triple to either triple, up to whole revolutions.
    step = both[:, None, :-1] - both[None, :, 1:]
    cost = np.abs(step - revolution * np.round(step / revolution)).sum(axis=-1)
    goes_over = cost[:, 1] < cost[:, 0]  # (from, T - 1, ...)
    is_other = np.zeros(angles.shape[:-1], bool)
    if before is not None:
        step = np.asarray(before, np.float64) - both[:, 0]
        first = np.abs(step - revolution * np.round(step / revolution)).sum(axis=-1)
        is_other[0] = first[1] < first[0]
    for frame in range(1, len(angles)):
        is_other[frame] = np.where(is_other[frame - 1], goes_over[1, frame - 1], goes_over[0, frame - 1])
    chosen = np.where(is_other[..., None], alternative, angles)
    revolutions = np.zeros_like(chosen)
    revolutions[1:] = np.round((chosen[:-1] - chosen[1:]) / revolution)
    if before is not None:
        revolutions[0] = np.round((np.asarray(before, np.float64) - chosen[0]) / revolution)
    return np.asarray(chosen + revolution * np.cumsum(revolutions, axis=0))


def to_6d(q: ArrayLike) -> FloatArray:
    """First two columns of the rotation matrix (..., 6) (Zhou et al. 2019, eq. 13)."""
    q = np.asarray(q, np.float64)
    x, y, z, w = (q[..., k] for k in range(4))
    x2, y2, z2 = x + x, y + y, z + z
    xx, xy, zz, wz = x * x2, x * y2, z * z2, w * z2
    columns = np.empty((*q.shape[:-1], 6))
    columns[..., 0], columns[..., 1], columns[..., 2] = 1.0 - y * y2 - zz, xy + wz, x * z2 - w * y2
    columns[..., 3], columns[..., 4], columns[..., 5] = xy - wz, 1.0 - xx - zz, y * z2 + w * x2
    return columns


def matrix_to_6d(m: ArrayLike) -> FloatArray:
    """Return the same six numbers (..., 6) from rotation matrices (..., 3, 3)."""
    m = np.asarray(m, np.float64)
    return np.concatenate([m[..., :, 0], m[..., :, 1]], axis=-1)


def matrix_from_6d(r: ArrayLike) -> FloatArray:
    """Rotation matrices (..., 3, 3) of 6D (..., 6), from ``orthonormal_6d``."""
    columns = orthonormal_6d(r)
    x, y = columns[..., :3], columns[..., 3:]
    return np.stack([x, y, cross(x, y)], axis=-1)


def orthonormal_6d(r: ArrayLike) -> FloatArray:
    """First two columns of a rotation matrix (..., 6) from 6D (..., 6) by Gram-Schmidt (Zhou et al. 2019, eq. 14).
    Raises ``ValueError`` if degenerate.
    """
    r = np.asarray(r, np.float64)
    a, b = r[..., :3], r[..., 3:]
    na = np.linalg.norm(a, axis=-1, keepdims=True)
    x = a / np.where(na < _TINY, 1.0, na)
    b = b - np.sum(x * b, axis=-1, keepdims=True) * x
    nb = np.linalg.norm(b, axis=-1, keepdims=True)
    if np.any(na < _TINY) or np.any(nb < _TINY):
        raise ValueError("6D rotation with a zero or parallel column has no rotation")
    return np.concatenate([x, b / nb], axis=-1)
