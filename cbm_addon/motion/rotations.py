"""Batched rotations: quaternions `[..., 4]` (w x y z), matrices `[..., 3, 3]`, 6D `[..., 6]`, Euler angles and rotation vectors `[..., 3]`.

Every function broadcasts over leading dimensions and keeps the dtype of its input. Angles are radians. A quaternion and its
negative are the same rotation; `continuous` picks the signs that make a curve smooth.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]

IDENTITY = np.array([1.0, 0.0, 0.0, 0.0], dtype=np.float32)
_TINY = 1e-12


def normalize(v: Array) -> Array:
    """Vectors or quaternions `[..., N]` of unit length; zero stays zero."""
    return v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), _TINY)


def across(v: Array, line: Array) -> Array:
    """What is left of vectors `v [..., 3]` across lines with the directions [..., 3]."""
    along = normalize(line)
    return v - np.sum(v * along, axis=-1, keepdims=True) * along


def multiply(a: Array, b: Array) -> Array:
    """Hamilton product: the rotation `b` first, then `a`."""
    aw, ax, ay, az = np.moveaxis(a, -1, 0)
    bw, bx, by, bz = np.moveaxis(b, -1, 0)
    return np.stack(
        (
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ),
        axis=-1,
    )


def inverse(q: Array) -> Array:
    """The opposite of a unit quaternion."""
    return q * np.array([1, -1, -1, -1], dtype=q.dtype)


def rotate(q: Array, v: Array) -> Array:
    """Vectors `v [..., 3]` turned by unit quaternions `q [..., 4]`."""
    w, u = q[..., :1], q[..., 1:]
    t = 2 * np.cross(u, v)
    return v + w * t + np.cross(u, t)


def angle(q: Array) -> Array:
    """How far `q` turns, 0 to pi."""
    return 2 * np.arctan2(np.linalg.norm(q[..., 1:], axis=-1), np.abs(q[..., 0]))


def difference(a: Array, b: Array) -> Array:
    """Geodesic angle between two rotations, 0 to pi."""
    return angle(multiply(inverse(a), b))


def quat_from_rotvec(v: Array) -> Array:
    """Rotation vector (axis times angle) to quaternion."""
    theta = np.linalg.norm(v, axis=-1, keepdims=True)
    half = theta / 2
    sinc = np.where(theta > 1e-8, np.sin(half) / np.maximum(theta, 1e-8), 0.5)
    return np.concatenate((np.cos(half), sinc * v), axis=-1)


def rotvec_from_quat(q: Array) -> Array:
    """Quaternion to the rotation vector of at most pi."""
    q = np.where(q[..., :1] < 0, -q, q)
    s = np.linalg.norm(q[..., 1:], axis=-1, keepdims=True)
    theta = 2 * np.arctan2(s, q[..., :1])
    return q[..., 1:] * np.where(s > 1e-8, theta / np.maximum(s, 1e-8), 2.0)


def quat_from_axis_angle(axis: Array, theta: Array) -> Array:
    """Rotation by `theta [...]` about the unit vector `axis [..., 3]`."""
    half = np.asarray(theta)[..., None] / 2
    return np.concatenate((np.cos(half), np.sin(half) * axis), axis=-1)


def matrix_from_quat(q: Array) -> Array:
    """Unit quaternion to rotation matrix."""
    w, x, y, z = np.moveaxis(q, -1, 0)
    rows = (
        1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
        2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
        2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
    )  # fmt: skip
    return np.stack(rows, axis=-1).reshape((*q.shape[:-1], 3, 3))


def quat_from_matrix(m: Array) -> Array:
    """Rotation matrix to unit quaternion (Shepperd's method: the largest of the four components is computed first)."""
    m00, m11, m22 = m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]
    squares = np.stack((1 + m00 + m11 + m22, 1 + m00 - m11 - m22, 1 - m00 + m11 - m22, 1 - m00 - m11 + m22), axis=-1)
    largest = np.argmax(squares, axis=-1)
    a, b, c = m[..., 2, 1] - m[..., 1, 2], m[..., 0, 2] - m[..., 2, 0], m[..., 1, 0] - m[..., 0, 1]
    d, e, f = m[..., 1, 0] + m[..., 0, 1], m[..., 0, 2] + m[..., 2, 0], m[..., 2, 1] + m[..., 1, 2]
    s0, s1, s2, s3 = np.moveaxis(squares, -1, 0)
    options = np.stack(
        (
            np.stack((s0, a, b, c), axis=-1),
            np.stack((a, s1, d, e), axis=-1),
            np.stack((b, d, s2, f), axis=-1),
            np.stack((c, e, f, s3), axis=-1),
        ),
        axis=-2,
    )
    return normalize(np.take_along_axis(options, largest[..., None, None], axis=-2)[..., 0, :])


def sixd_from_matrix(m: Array) -> Array:
    """The first two columns of a rotation matrix, one after the other (Zhou et al. 2019)."""
    return np.concatenate((m[..., :, 0], m[..., :, 1]), axis=-1)


def matrix_from_sixd(d: Array) -> Array:
    """Gram-Schmidt of two 3-vectors `[..., 6]`: any input that is not degenerate gives a rotation."""
    x = normalize(d[..., :3])
    y = normalize(d[..., 3:] - np.sum(x * d[..., 3:], axis=-1, keepdims=True) * x)
    return np.stack((x, y, np.cross(x, y)), axis=-1)


def sixd_from_quat(q: Array) -> Array:
    return sixd_from_matrix(matrix_from_quat(q))


def quat_from_sixd(d: Array) -> Array:
    return quat_from_matrix(matrix_from_sixd(d))


def quat_from_euler(angles: Array, order: str) -> Array:
    """Intrinsic Euler angles `[..., 3]` in the sequence `order` (for example "ZXY": about Z, then the new X, then the new Y)."""
    result: Array | None = None
    for i, axis in enumerate(order.upper()):
        half = angles[..., i] / 2
        step = np.zeros((*half.shape, 4), dtype=angles.dtype)
        step[..., 0] = np.cos(half)
        step[..., 1 + "XYZ".index(axis)] = np.sin(half)
        result = step if result is None else multiply(result, step)
    assert result is not None
    return result


def euler_from_quat(q: Array, order: str) -> Array:
    """Intrinsic Euler angles in three different axes `order`; at gimbal lock the last angle is 0."""
    i, j, k = ("XYZ".index(axis) for axis in order.upper())
    sign = 1.0 if (j - i) % 3 == 1 else -1.0
    m = matrix_from_quat(q)
    middle = np.arcsin(np.clip(sign * m[..., i, k], -1, 1))
    locked = np.abs(m[..., i, k]) >= 1 - np.finfo(m.dtype).eps
    first = np.where(
        locked,
        np.arctan2(sign * m[..., k, j], m[..., j, j]),
        np.arctan2(-sign * m[..., j, k], m[..., k, k]),
    )
    last = np.where(locked, 0.0, np.arctan2(-sign * m[..., i, j], m[..., i, i]))
    return np.stack((first, middle, last), axis=-1).astype(q.dtype)


def quat_between(u: Array, v: Array) -> Array:
    """The shortest rotation that takes the direction `u` to `v` (opposite directions: half a turn about any normal)."""
    u, v = np.broadcast_arrays(normalize(u), normalize(v))
    w = 1 + np.sum(u * v, axis=-1, keepdims=True)
    axis = np.cross(u, v)
    helper = np.where(np.abs(u[..., :1]) < 0.9, np.array([1.0, 0, 0], u.dtype), np.array([0, 1.0, 0], u.dtype))
    opposite = np.concatenate((np.zeros_like(w), normalize(np.cross(u, helper))), axis=-1)
    return np.where(w > 1e-6, normalize(np.concatenate((w, axis), axis=-1)), opposite)


def slerp(a: Array, b: Array, t: Array | float) -> Array:
    """Spherical interpolation along the shorter arc; `t [...]` from 0 (a) to 1 (b)."""
    t = np.asarray(t, dtype=a.dtype)[..., None]
    dot = np.sum(a * b, axis=-1, keepdims=True)
    b = np.where(dot < 0, -b, b)
    dot = np.clip(np.abs(dot), 0, 1)
    theta = np.arccos(dot)
    sine = np.sin(theta)
    close = sine < 1e-5
    safe = np.where(close, 1, sine)
    wa = np.where(close, 1 - t, np.sin((1 - t) * theta) / safe)
    wb = np.where(close, t, np.sin(t * theta) / safe)
    return normalize(wa * a + wb * b)


def continuous(q: Array) -> Array:
    """The same rotations over time `[T, ..., 4]` with signs such that neighbours are close (no flips)."""
    if len(q) < 2:
        return q.copy()
    flips = np.sum(q[1:] * q[:-1], axis=-1) < 0
    sign = np.concatenate((np.ones((1, *flips.shape[1:]), dtype=bool), np.cumsum(flips, axis=0) % 2 == 0))
    return np.where(sign[..., None], q, -q)


def continuous_euler(angles: Array) -> Array:
    """The same rotations over time `[T, ..., 3]`, Euler angles in three different axes, with neighbours close (no flips, no wraps).

    Every rotation has two solutions, (a, b, c) and (a + pi, pi - b, c + pi). Whether the other one is closer to the frame before
    does not depend on which of the two that frame took.
    """
    other = np.stack((angles[..., 0] + np.pi, np.pi - angles[..., 1], angles[..., 2] + np.pi), axis=-1).astype(angles.dtype)

    def far(step: Array) -> Array:
        return np.abs(np.remainder(step + np.pi, 2 * np.pi) - np.pi).sum(axis=-1)

    flips = far(other[1:] - angles[:-1]) < far(angles[1:] - angles[:-1])
    taken = np.concatenate((np.zeros((1, *flips.shape[1:]), dtype=bool), np.cumsum(flips, axis=0) % 2 == 1))
    return np.unwrap(np.where(taken[..., None], other, angles), axis=0)


def yaw_from_quat(q: Array) -> Array:
    """The turn about Z that `q` contains (its twist): stays sound when the body looks straight up or down."""
    return 2 * np.arctan2(q[..., 3], q[..., 0])


def quat_from_yaw(yaw: Array) -> Array:
    """Rotation about Z."""
    half = np.asarray(yaw) / 2
    zero = np.zeros_like(half)
    return np.stack((np.cos(half), zero, zero, np.sin(half)), axis=-1)
