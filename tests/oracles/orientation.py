"""Readable NumPy oracles of `rsdeblur.kernels.orientation`."""

from __future__ import annotations

from itertools import accumulate

import numpy as np

from rsdeblur.types import FloatArray


def orientations_numpy(times: FloatArray, t: FloatArray, omega: FloatArray, rotations: FloatArray) -> FloatArray:
    """Readable twin of :func:`orientations`."""
    i = np.clip(np.searchsorted(t, times, side="right") - 1, 0, len(t) - 2)
    elapsed = times - t[i]
    share = elapsed / (t[i + 1] - t[i])
    here = omega[i] + share[..., None] * (omega[i + 1] - omega[i])
    turned: FloatArray = rotation_matrix(-magnus(omega[i], here, elapsed)) @ rotations[i]
    return turned


def integrated_numpy(t: FloatArray, omega: FloatArray) -> FloatArray:
    """Readable twin of :func:`integrated`."""
    steps = rotation_matrix(-magnus(omega[:-1], omega[1:], np.diff(t)))
    return np.array(list(accumulate(steps, lambda rotation, step: step @ rotation, initial=np.eye(3))))


def magnus(omega0: FloatArray, omega1: FloatArray, dt: FloatArray) -> FloatArray:
    """Return the rotation vector of a step `dt` in which the rate changes linearly from `omega0` to `omega1`.

    Fourth-order Magnus expansion (Iserles and Norsett 1999): dt (w0 + w1)/2 + dt^2/12 (w0 x w1).
    """
    h = dt[..., None]
    return 0.5 * h * (omega0 + omega1) + h**2 / 12.0 * np.cross(omega0, omega1)


def rotation_matrix(vector: FloatArray) -> FloatArray:
    """Return the matrices `exp([v]x)` of rotation vectors v, shape (..., 3), by Rodrigues' formula."""
    angle = np.sqrt(np.sum(vector**2, axis=-1))[..., None, None]
    x, y, z = np.moveaxis(vector, -1, 0)
    zero = np.zeros_like(x)
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*vector.shape[:-1], 3, 3)
    # sinc(a/pi) = sin(a)/a, and (1 - cos a)/a^2 = sinc(a/2pi)^2 / 2: both regular at zero.
    rotation: FloatArray = (
        np.eye(3) + np.sinc(angle / np.pi) * cross + 0.5 * np.sinc(angle / (2 * np.pi)) ** 2 * (cross @ cross)
    )
    return rotation
