"""Orientation of a camera at and between the samples of its gyro log, and points as it sees them from its poses."""

from __future__ import annotations

import numpy as np

from rsdeblur.kernels._jit import njit, read_only
from rsdeblur.types import FloatArray

# Angle below which the sine is its argument, rad: the difference is below the precision of float64.
SMALL = 1e-8


@njit(nogil=True)
def _turn(omega0, omega1, h, turn):
    """Fill `turn` with the rotation of a step `h`: `rotation_matrix(-magnus(...))` without temporaries."""
    ax, ay, az = omega0[0], omega0[1], omega0[2]
    bx, by, bz = omega1[0], omega1[1], omega1[2]
    x = -(0.5 * h * (ax + bx) + h * h / 12.0 * (ay * bz - az * by))
    y = -(0.5 * h * (ay + by) + h * h / 12.0 * (az * bx - ax * bz))
    z = -(0.5 * h * (az + bz) + h * h / 12.0 * (ax * by - ay * bx))
    squared = x * x + y * y + z * z
    angle = np.sqrt(squared)
    sine = np.sin(angle) / angle if angle > SMALL else 1.0
    half = np.sin(0.5 * angle) / (0.5 * angle) if angle > SMALL else 1.0
    bend = 0.5 * half * half
    turn[0, 0], turn[1, 1] = 1.0 - bend * (squared - x * x), 1.0 - bend * (squared - y * y)
    turn[2, 2] = 1.0 - bend * (squared - z * z)
    turn[0, 1], turn[1, 0] = bend * x * y - sine * z, bend * x * y + sine * z
    turn[0, 2], turn[2, 0] = bend * x * z + sine * y, bend * x * z - sine * y
    turn[1, 2], turn[2, 1] = bend * y * z - sine * x, bend * y * z + sine * x


@njit(nogil=True)
def _product(a, b, out):
    for row in range(3):
        for column in range(3):
            total = 0.0
            for k in range(3):
                total += a[row, k] * b[k, column]
            out[row, column] = total


@njit(nogil=True)
def _orientations(times, t, omega, rotations, out):
    last = len(t) - 2
    turn, rate = np.empty((3, 3)), np.empty(3)
    for n in range(len(times)):
        # The last sample that is not later. A comparison with NaN is false, so that NaN finds the first one.
        i, beyond = 0, last + 1
        while beyond - i > 1:
            middle = (i + beyond) // 2
            if t[middle] <= times[n]:
                i = middle
            else:
                beyond = middle
        h = times[n] - t[i]
        share = h / (t[i + 1] - t[i])
        for axis in range(3):
            rate[axis] = omega[i, axis] + share * (omega[i + 1, axis] - omega[i, axis])
        _turn(omega[i], rate, h, turn)
        _product(turn, rotations[i], out[n])


@njit(nogil=True)
def _integrated(t, omega, out):
    turn = np.empty((3, 3))
    for n in range(len(t) - 1):
        _turn(omega[n], omega[n + 1], t[n + 1] - t[n], turn)
        _product(turn, out[n], out[n + 1])


def orientations(times: FloatArray, t: FloatArray, omega: FloatArray, rotations: FloatArray) -> FloatArray:
    """Return the orientation (..., 3, 3) at `times` (...), see :class:`rsdeblur.motion.track.OrientationTrack`.

    The samples have increasing times `t` (n,), rates `omega` (n, 3) and `rotations` (n, 3, 3). Before the first one and
    after the last one, the track goes on as between the nearest two.
    """
    out = np.empty((times.size, 3, 3))
    _orientations(*(read_only(array) for array in (times.ravel(), t, omega, rotations)), out)
    return out.reshape(*times.shape, 3, 3)


def integrated(t: FloatArray, omega: FloatArray) -> FloatArray:
    """Return the orientation (n, 3, 3) at the samples of a log, relative to that at the first one.

    The rates `omega` (n, 3) change linearly between the times `t` (n,), which increase.
    """
    out = np.empty((len(t), 3, 3))
    out[0] = np.eye(3)
    _integrated(read_only(t), read_only(omega), out)
    return out


@njit(nogil=True)
def _component(low, high, share, n, x, y, z):
    """Return one component of a direction, between those from two poses."""
    before = low[n] * x + low[n + 1] * y + low[n + 2] * z + low[n + 3]
    after = high[n] * x + high[n + 1] * y + high[n + 2] * z + high[n + 3]
    return before + share * (after - before)


@njit(nogil=True)
def _direction(x, y, z, row, matrices):
    half, last = len(matrices) // 4, len(matrices) - 1
    # A comparison with NaN is false, so that NaN is taken for the first row.
    place = row + half if row + half > 0.0 else 0.0
    place = min(place, float(last))
    i = min(int(place), last - 1)
    low, high, share = matrices[i], matrices[i + 1], place - i
    across, down = _component(low, high, share, 0, x, y, z), _component(low, high, share, 4, x, y, z)
    return across, down, _component(low, high, share, 8, x, y, z)


@njit(nogil=True)
def _row_directions(world, rows, matrices, out):
    for n in range(len(rows)):
        x, y, z = _direction(world[n, 0], world[n, 1], world[n, 2], rows[n], matrices)
        out[n, 0], out[n, 1], out[n, 2] = x, y, z


@njit(nogil=True)
def _pinhole_paths(orientation, position, scene, rows, cols, matrices, pinhole, steps, out):
    fx, fy, cx, cy = pinhole
    for b in range(len(rows)):
        for t in range(orientation.shape[1]):
            c, p = orientation[b, t], position[b, t]
            for s in range(len(cols)):
                u, v, w = scene[b, s, 0], scene[b, s, 1], scene[b, s, 2]
                across = c[0, 0] * u + c[1, 0] * v + c[2, 0] * w + p[0]
                down = c[0, 1] * u + c[1, 1] * v + c[2, 1] * w + p[1]
                ahead = c[0, 2] * u + c[1, 2] * v + c[2, 2] * w + p[2]
                x, y = cols[s], rows[b]
                for _ in range(steps):
                    dx, dy, dz = _direction(across, down, ahead, y, matrices)
                    near = 1.0 / dz if dz > 0.0 else np.nan
                    x, y = fx * (dx * near) + cx, fy * (dy * near) + cy
                out[b, s, t, 0], out[b, s, t, 1] = cols[s] - x, rows[b] - y


def row_directions(world: FloatArray, rows: FloatArray, matrices: FloatArray) -> FloatArray:
    """Return the directions (..., 3) of points in camera axes, each from the pose of a row.

    `world` (..., 3) are points or directions in world axes, and `rows` (...) their rows. `matrices` (2 H, 12) are the
    poses `[C | -C P]` of the rows from -H/2 on, interpolated linearly; beyond the first and last ones, and for NaN,
    these count. A point of NaN gives NaN.
    """
    out = np.empty((rows.size, 3))
    _row_directions(read_only(world.reshape(-1, 3)), read_only(rows.ravel()), read_only(matrices), out)
    return out.reshape(*rows.shape, 3)


def pinhole_paths(
    orientation: FloatArray,
    position: FloatArray,
    scene: FloatArray,
    rows: FloatArray,
    cols: FloatArray,
    matrices: FloatArray,
    pinhole: tuple[float, float, float, float],
    steps: int,
) -> FloatArray:
    """Return the displacements (B, S, T, 2) of pixels, (x, y) in px; NaN behind the camera.

    Fixed-point iteration finds the rows that the pixels fall on, beginning at their own.

    - `orientation` (B, T, 3, 3) and `position` (B, T, 3): those of the camera at T times of each row.
    - `scene` (B, S, 3): point or direction in camera axes that each pixel of the grid `rows` (B,) x `cols` (S,) sees.
    - `matrices`: poses, see :func:`row_directions`.
    - `pinhole`: focal lengths along x and y, and principal point (x, y), px, of a camera without distortion.
    """
    arrays = (read_only(array) for array in (orientation, position, scene, rows, cols, matrices))
    out = np.empty((len(rows), len(cols), orientation.shape[1], 2))
    _pinhole_paths(*arrays, pinhole, steps, out)
    return out
