"""Orientation of a camera at and between the samples of its gyro log, and points as it sees them from its poses."""

import numpy as np

from rsdeblur.kernels._jit import njit, read_only
from rsdeblur.types import FloatArray

# Angle below which the sine is its argument, rad: the difference is below the precision of float64.
SMALL = 1e-8


@njit(nogil=True)
def _orientations(times, before, t, omega, rotations, out):
    """Turn the rotations of the samples `before` on to `times`: `rotation_matrix(-magnus(...))` without temporaries."""
    for n in range(len(times)):
        i = before[n]
        h = times[n] - t[i]
        share = h / (t[i + 1] - t[i])
        ax, ay, az = omega[i, 0], omega[i, 1], omega[i, 2]
        bx, by, bz = omega[i + 1, 0] - ax, omega[i + 1, 1] - ay, omega[i + 1, 2] - az
        # The cross product of the rates at both ends is that of the first one and the change.
        third = share * h * h / 12.0
        x = -(h * (ax + 0.5 * share * bx) + third * (ay * bz - az * by))
        y = -(h * (ay + 0.5 * share * by) + third * (az * bx - ax * bz))
        z = -(h * (az + 0.5 * share * bz) + third * (ax * by - ay * bx))
        squared = x * x + y * y + z * z
        angle = np.sqrt(squared)
        sine = np.sin(angle) / angle if angle > SMALL else 1.0
        half = np.sin(0.5 * angle) / (0.5 * angle) if angle > SMALL else 1.0
        bend = 0.5 * half * half
        for column in range(3):
            # Rodrigues' formula: v + sine (r x v) + bend (r x (r x v)), where r x (r x v) = r (r v) - |r|^2 v.
            u, v, w = rotations[i, 0, column], rotations[i, 1, column], rotations[i, 2, column]
            along, rest = bend * (x * u + y * v + z * w), 1.0 - bend * squared
            out[n, 0, column] = rest * u + along * x + sine * (y * w - z * v)
            out[n, 1, column] = rest * v + along * y + sine * (z * u - x * w)
            out[n, 2, column] = rest * w + along * z + sine * (x * v - y * u)


def orientations(times: FloatArray, t: FloatArray, omega: FloatArray, rotations: FloatArray) -> FloatArray:
    """Return the orientation (..., 3, 3) at `times` (...), see :class:`rsdeblur.motion.track.OrientationTrack`.

    The samples have increasing times `t` (n,), rates `omega` (n, 3) and `rotations` (n, 3, 3). Before the first one and
    after the last one, the track goes on as between the nearest two.
    """
    out = np.empty((times.size, 3, 3))
    # The last sample that is not later; NaN comes after all.
    before = (np.searchsorted(t, times.ravel(), side="right") - 1).clip(0, len(t) - 2)
    _orientations(*(read_only(array) for array in (times.ravel(), before, t, omega, rotations)), out)
    return out.reshape(*times.shape, 3, 3)


def integrated(t: FloatArray, omega: FloatArray) -> FloatArray:
    """Return the orientation (n, 3, 3) at the samples of a log, relative to that at the first one.

    The rates `omega` (n, 3) change linearly between the times `t` (n,), which increase.
    """
    out = np.empty((len(t), 3, 3))
    out[0] = np.eye(3)
    # Each row is read after it was filled.
    _orientations(*(read_only(array) for array in (t[1:], np.arange(len(t) - 1), t, omega, out)), out[1:])
    return out


@njit(nogil=True)
def _see(x, y, z, row, matrices, seen):
    """Fill `seen` with the direction of a point from the pose of a row."""
    half, last = len(matrices) // 4, len(matrices) - 1
    # A comparison with NaN is false, so that NaN is taken for the first row.
    place = row + half if row + half > 0.0 else 0.0
    place = min(place, float(last))
    i = min(int(place), last - 1)
    for k in range(3):
        n, share = 4 * k, place - i
        low = matrices[i, n] * x + matrices[i, n + 1] * y + matrices[i, n + 2] * z + matrices[i, n + 3]
        high = matrices[i + 1, n] * x + matrices[i + 1, n + 1] * y + matrices[i + 1, n + 2] * z + matrices[i + 1, n + 3]
        seen[k] = low + share * (high - low)


@njit(nogil=True)
def _row_directions(world, rows, matrices, out):
    for n in range(len(rows)):
        _see(world[n, 0], world[n, 1], world[n, 2], rows[n], matrices, out[n])


@njit(nogil=True)
def _pinhole_paths(orientation, position, scene, rows, cols, matrices, pinhole, steps, out):
    fx, fy, cx, cy = pinhole
    seen = np.empty(3)
    for b in range(len(rows)):
        for t in range(orientation.shape[1]):
            for s in range(len(cols)):
                for k in range(3):
                    seen[k] = position[b, t, k]
                    for n in range(3):
                        seen[k] += orientation[b, t, n, k] * scene[b, s, n]
                u, v, w = seen[0], seen[1], seen[2]
                x, y = cols[s], rows[b]
                for _ in range(steps):
                    _see(u, v, w, y, matrices, seen)
                    near = 1.0 / seen[2] if seen[2] > 0.0 else np.nan
                    x, y = fx * (seen[0] * near) + cx, fy * (seen[1] * near) + cy
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
