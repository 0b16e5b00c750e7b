"""Mounting of the gyro and clock offset of a clip: the rotation between its frames against the log's.

The 48 candidates take each camera axis from an IMU axis with either sign; half of them mirror, which is right for a log
with left-handed axes.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.signal import find_peaks
from scipy.spatial.transform import Rotation

from rsdeblur.calibration.fit import ClipFit
from rsdeblur.calibration.matches import ClipMatches
from rsdeblur.calibration.result import OBLIQUE, confidence, mounting_name
from rsdeblur.motion.axes import mountings
from rsdeblur.motion.camera import Camera
from rsdeblur.types import FloatArray

# Step of the offsets, s: a twentieth of the period of 12 Hz, the fastest tremor of a hand.
STEP = 4e-3
# Offsets nearer than this are one answer, s.
SAME = 0.02
# Least lead of a mounting over all pairs of frames, nats.
LEAST_LEAD = 3.0


class Candidate(NamedTuple):
    """A mounting and an offset that may explain the rotation between frames."""

    mounting: FloatArray  # orthogonal, from IMU axes to camera axes; its determinant is -1 for a left-handed log
    offset: float  # camera time minus gyro time, s


def frame_rotations(matches: ClipMatches, camera: Camera) -> FloatArray:
    """Return the camera's rotation vector between the frames of each pair, rad, camera axes, shape (pairs, 3)."""
    rays, ahead = camera.rays(matches.points), camera.rays(matches.moved)
    rotations = np.zeros((len(matches.opens), 3))
    for k, (a, b) in enumerate(pairwise(np.searchsorted(matches.pair, np.arange(len(rotations) + 1)))):
        weights = np.ones(b - a)
        for _ in range(4):
            # The scene turns against the camera.
            rotation, _ = Rotation.align_vectors(rays[a:b], ahead[a:b], weights)
            errors = np.linalg.norm(rays[a:b] - rotation.apply(ahead[a:b]), axis=1)
            weights = 1.0 / (1.0 + (errors / max(np.median(errors), 1e-9)) ** 2)
        rotations[k] = rotation.as_rotvec()
    return rotations


def candidates(
    matches: ClipMatches,
    camera: Camera,  # start values of focal length and lens; its mounting is a candidate too
    log: tuple[FloatArray, FloatArray],  # times (n,) on the matches' clock, s, and rates (n, 3), rad/s, IMU axes
    search: tuple[float, float],  # first and last offset, s
    count: int,
) -> list[Candidate]:
    """Return the mountings and offsets whose rotation between frames agrees best with the seen one, the best first.

    No two of them have one mounting and nearly one offset.
    """
    own = camera.imu_to_camera
    every = np.array([*mountings(), own][: None if mounting_name(own) == OBLIQUE else -1])
    t, omega = log
    angle = cumulative_trapezoid(omega, t, axis=0, initial=0)
    middles = matches.opens + 0.5 * matches.durations
    offsets = np.arange(search[0], search[1] + STEP, STEP)
    turned = np.stack([np.interp(middles - offsets[:, None, None], t, axis) for axis in angle.T], axis=-1)
    interval = np.diff(middles, axis=1)
    gyro = _without_constant_rate(turned[:, :, 1] - turned[:, :, 0], interval)
    seen = _without_constant_rate(frame_rotations(matches, camera), interval)
    # How far typical points move by a rotation about each axis, squared.
    x, y = (camera.rays(matches.points)[:, :2]).T
    reach = np.array([1.0, 1.0, float((x * x + y * y).mean())])
    agreement = np.einsum("i,ki,okj,mij->mo", reach, seen, gyro, every, optimize=True)
    energy = np.einsum("i,okj,mij->mo", reach, gyro**2, every**2, optimize=True)
    # A wrong focal length scales the rotation, which a correlation ignores.
    correlation = agreement / np.sqrt(np.maximum(energy * (reach @ (seen**2).sum(axis=0)), 1e-30))
    found: list[tuple[float, Candidate]] = []
    for mounting, row in zip(every, correlation, strict=True):
        places, _ = find_peaks(np.pad(row, 1, constant_values=-np.inf), distance=max(1, round(SAME / STEP)))
        found += [(float(row[place - 1]), Candidate(mounting, float(offsets[place - 1]))) for place in places]
    found.sort(key=lambda pair: -pair[0])
    return [candidate for _, candidate in found[:count]]


def ranked(tried: Sequence[Candidate], fits: Sequence[ClipFit], matches: ClipMatches) -> tuple[int, int, float]:
    """Return the places of the best fitted candidate and of its best rival, and the confidence of its mounting.

    Candidates are compared by the errors of their points in the `matches` that were fitted, pair by pair. Mountings
    that mirror are for logs with left-handed axes, which are rare: only one that leads counts.
    """
    energy = np.array([(fit.residuals**2).sum(axis=1) for fit in fits])
    scale = np.median(energy, axis=1).min() + 1e-4
    # Log-likelihoods in nats whose tails let wrong points be; all points of a pair together count as one.
    costs = matches.sums(np.log1p(energy / scale).T).T / np.maximum(matches.sums(np.ones(energy.shape[1])), 1.0)
    sums, mirrors = costs.sum(axis=1), np.array([np.linalg.det(each.mounting) < 0 for each in tried])
    best = int(np.argmin(sums + LEAST_LEAD * mirrors))
    others = [i for i in np.argsort(sums).tolist() if i != best and (mirrors[best] or not mirrors[i])]

    def same(i: int) -> bool:
        near = abs(fits[i].parameters.offset - fits[best].parameters.offset) < SAME
        return near and np.array_equal(tried[i].mounting, tried[best].mounting)

    rivals = [i for i in others if not same(i)]
    return best, rivals[0] if rivals else best, confidence(costs[rivals] - costs[best], LEAST_LEAD)


def _without_constant_rate(rotations: FloatArray, interval: FloatArray) -> FloatArray:
    """Return rotations, shape (..., pairs, 3), less the constant rate that fits best: it may be the gyro's bias."""
    rate = (interval * rotations).sum(axis=-2, keepdims=True) / (interval**2).sum()
    changing: FloatArray = rotations - rate * interval
    return changing
