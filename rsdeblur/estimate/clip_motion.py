"""Model of a clip: where the gyro log moves the points of one frame in the next, and how well that fits the matches.

A point on row y of a frame is exposed around `middle + readout (y - (H-1)/2) / H`, so matches on different rows test
different stretches of the log. A blurred point is seen near the mean of its path, so orientations are averaged over the
exposure.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from rsdeblur.estimate.clip_matches import ClipMatches
from rsdeblur.motion import lens
from rsdeblur.motion.camera import Camera
from rsdeblur.motion.track import OrientationTrack
from rsdeblur.types import FloatArray

# s. Orientations are tabulated at this interval, and averaged over at least two of them.
TABLE_STEP = 5e-4
# A path is brightest where the camera is slow, and fine texture follows its brightest part. So the mean weights each
# moment by the rate of turn, and this much, rad/s, to this power. Without the weights, focal lengths came out up to 1 %
# too long (docs/developer/decisions.md).
LEAST_RATE, RATE_POWER = 0.1, -0.2


class MeanOrientation:
    """Orientations of the IMU, averaged over exposures as a tracker sees blurred points.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Sample times in s.
    omega : ndarray, shape (n, 3)
        Rates in rad/s, IMU axes, right-handed.
    """

    def __init__(self, t: FloatArray, omega: FloatArray) -> None:
        track = OrientationTrack.integrated(t, omega)
        self._origin = float(t[0])
        times = np.arange(t[0], t[-1], TABLE_STEP)
        quaternions = Rotation.from_matrix(track.at(times)).as_quat()
        # q and -q are one rotation; neighbours must have the same sign for a mean.
        flips = np.sign(np.einsum("ij,ij->i", quaternions[1:], quaternions[:-1]))
        quaternions[1:] *= np.cumprod(flips)[:, None]
        rates = np.linalg.norm([np.interp(times, t, rate) for rate in omega.T], axis=0)
        # The scale of a quaternion does not matter, so the sum of the weights need not be known.
        quaternions *= ((rates + LEAST_RATE) ** RATE_POWER)[:, None]
        self._integral = np.concatenate([np.zeros((1, 4)), np.cumsum(quaternions, axis=0)])

    def at(self, opens: FloatArray, durations: FloatArray) -> Rotation:
        """Return the mean rotations of exposures, IMU-from-world; times beyond the log are moved to its ends."""
        durations = np.maximum(durations, 2 * TABLE_STEP)
        # The mean over [opens, opens + duration] is that over a box, whose ends the integral interpolates.
        return Rotation.from_quat(self._at(opens + durations) - self._at(opens))

    def _at(self, times: FloatArray) -> FloatArray:
        # Sample k covers the interval around its time.
        place = (times - self._origin) / TABLE_STEP + 0.5
        i = np.clip(place.astype(int), 0, len(self._integral) - 2)
        fraction = (place - i)[:, None]
        values: FloatArray = (1.0 - fraction) * self._integral[i] + fraction * self._integral[i + 1]
        return values


class Parameters(NamedTuple):
    """Unknowns of a clip.

    Parameters
    ----------
    offset : float
        Camera time minus gyro time in the middle row, s.
    down, across : float
        Readout time along y and along x, s; negative from bottom to top and from right to left.
    focal : float
        Logarithm of the focal length over that of the start.
    turn_x, turn_y, turn_z : float
        Small rotation after the mounting, rad, camera axes.
    bias_x, bias_y, bias_z : float
        Rates that the gyro shows at rest, rad/s, IMU axes.
    drift : float
        Increase of the offset per second.
    """

    offset: float = 0.0
    down: float = 0.0
    across: float = 0.0
    focal: float = 0.0
    turn_x: float = 0.0
    turn_y: float = 0.0
    turn_z: float = 0.0
    bias_x: float = 0.0
    bias_y: float = 0.0
    bias_z: float = 0.0
    drift: float = 0.0


# Steps of numerical derivatives: each moves a point by about a thousandth of a pixel or more.
STEPS = Parameters(1e-5, 1e-5, 1e-5, 1e-4, 1e-4, 1e-4, 1e-4, 1e-4, 1e-4, 1e-4, 1e-6)


class ClipModel:
    """Prediction of the matches of a clip from the gyro's orientations.

    Parameters
    ----------
    matches : ClipMatches
        The matches.
    camera : Camera
        Start values of focal length and lens.
    track : MeanOrientation
        Orientations of the IMU. For a log with left-handed axes, those of the negative rates.
    mounting : ndarray, shape (3, 3)
        Orthogonal matrix from IMU axes to camera axes.
    """

    def __init__(self, matches: ClipMatches, camera: Camera, track: MeanOrientation, mounting: FloatArray) -> None:
        self.matches, self._camera, self._track, self._mounting = matches, camera, track, mounting
        self._ends = [self._plane(points) for points in (matches.points, matches.moved)]
        size = np.array([camera.width, camera.height], dtype=np.float64)
        # Reading order relative to the middle, in readout times.
        self._order = [(points - (size - 1) / 2) / size for points in (matches.points, matches.moved)]
        self._middle = 0.5 * float(matches.opens.min() + matches.opens.max())

    def _plane(self, points: FloatArray) -> FloatArray:
        return (points - self._camera.principal_point) / self._camera.focal_length

    def residuals(self, parameters: Parameters) -> FloatArray:
        """Return predicted minus measured positions in the second frames, px, shape (n, 2)."""
        p, matches, lens_model = parameters, self.matches, (self._camera.distortion_model, self._camera.distortion)
        zoom = np.exp(p.focal)
        mounting = Rotation.from_rotvec([p.turn_x, p.turn_y, p.turn_z]).as_matrix() @ self._mounting
        times, orientations = [], []
        for end, order in enumerate(self._order):
            time = matches.opens[matches.pair, end] + order @ (p.across, p.down)
            times.append(time - p.offset - p.drift * (time - self._middle))
            orientations.append(self._track.at(times[-1], matches.durations[matches.pair, end]))
        # Half of the bias' turn before and half after: its axis changes with the camera's orientation.
        half = 0.5 * (times[1] - times[0])[:, None] * (p.bias_x, p.bias_y, p.bias_z) * np.linalg.det(self._mounting)
        rays = lens.rays(self._ends[0] / zoom, *lens_model) @ mounting
        rays = orientations[0].apply(rays + np.cross(half, rays), inverse=True)
        rays = orientations[1].apply(rays)
        rays = (rays + np.cross(half, rays)) @ mounting.T
        predicted = lens.project(rays, *lens_model) * zoom
        residuals: FloatArray = (predicted - self._ends[1]) * self._camera.focal_length
        # Directions outside the lens model are as wrong as the frame is large.
        return np.nan_to_num(residuals, nan=float(self._camera.width))

    def jacobian(self, parameters: Parameters, free: tuple[str, ...]) -> FloatArray:
        """Return derivatives of the residuals by the `free` parameters in units of `STEPS`, shape (n, 2, free)."""
        here = self.residuals(parameters)
        moved = [
            self.residuals(parameters._replace(**{name: getattr(parameters, name) + getattr(STEPS, name)}))
            for name in free
        ]
        return np.stack([there - here for there in moved], axis=-1)
