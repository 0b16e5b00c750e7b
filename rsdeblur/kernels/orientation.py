"""Orientation of a camera at and between the samples of its gyro log."""

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
