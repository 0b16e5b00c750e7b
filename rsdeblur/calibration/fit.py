"""Fit of a clip's parameters: where the gyro log moves the points of one frame in the next, against the matches.

A point on row y of a frame is exposed around `middle + readout (y - (H-1)/2) / H`, so matches on different rows test
different stretches of the log. A blurred point is seen near the mean of its path, so orientations are averaged over the
exposure.

The residual of a point is the sum of its own error and of four errors of its pair: a shift along x and y, a zoom and a
roll. The latter come from the camera's translation past things at one depth and from the gyro's noise, and are the same
for all points of a pair; a fit without them would believe in far too small deviations. Translation changes slowly, so
neighbouring pairs have nearly the same shared errors: each of the four is an autoregressive process of first order.
Shake that is faster than it then counts more. Variances and correlations are estimated from the residuals.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.interpolate import make_interp_spline
from scipy.optimize import least_squares
from scipy.sparse.linalg import splu
from scipy.spatial.transform import Rotation

from rsdeblur.calibration.matches import ClipMatches
from rsdeblur.motion import lens
from rsdeblur.motion.camera import Camera
from rsdeblur.motion.track import OrientationTrack
from rsdeblur.tuning.noise import MEDIAN
from rsdeblur.types import FloatArray

# s. Orientations are tabulated at this interval, and averaged over at least two of them.
TABLE_STEP = 5e-4
# A path is brightest where the camera is slow, and fine texture follows its brightest part. So the mean weights each
# moment by the rate of turn, and this much, rad/s, to this power. Without the weights, focal lengths came out up to 1 %
# too long (docs/developer/decisions.md).
LEAST_RATE, RATE_POWER = 0.1, -0.2


class MeanOrientation:
    """Orientations of the IMU, averaged over exposures as a tracker sees blurred points; from right-handed rates."""

    def __init__(self, t: FloatArray, omega: FloatArray) -> None:
        track = OrientationTrack.integrated(t, omega)
        times = np.arange(t[0], t[-1], TABLE_STEP)
        quaternions = Rotation.from_matrix(track.at(times)).as_quat()
        # q and -q are one rotation; neighbours must have the same sign for a mean.
        flips = np.sign(np.einsum("ij,ij->i", quaternions[1:], quaternions[:-1]))
        quaternions[1:] *= np.cumprod(flips)[:, None]
        rates = np.linalg.norm([np.interp(times, t, rate) for rate in omega.T], axis=0)
        # The scale of a quaternion does not matter, so the sum of the weights need not be known.
        quaternions *= ((rates + LEAST_RATE) ** RATE_POWER)[:, None]
        # Sample k covers the interval around its time.
        edges = t[0] + TABLE_STEP * (np.arange(len(times) + 1) - 0.5)
        self._integral = make_interp_spline(edges, np.pad(quaternions.cumsum(axis=0), ((1, 0), (0, 0))), k=1)

    def at(self, opens: FloatArray, durations: FloatArray) -> Rotation:
        """Return the mean rotations of exposures, IMU-from-world; times beyond the log are moved to its ends."""
        durations = np.maximum(durations, 2 * TABLE_STEP)
        # The mean over [opens, opens + duration] is that over a box, whose ends the integral interpolates.
        return Rotation.from_quat(self._integral(opens + durations) - self._integral(opens))


class Parameters(NamedTuple):
    """Unknowns of a clip."""

    offset: float = 0.0  # camera time minus gyro time in the middle row, s
    down: float = 0.0  # readout time along y, s; negative from bottom to top
    across: float = 0.0  # readout time along x, s; negative from right to left
    focal: float = 0.0  # logarithm of the focal length over that of the start
    turn_x: float = 0.0  # small rotation after the mounting, rad, camera axes
    turn_y: float = 0.0
    turn_z: float = 0.0
    bias_x: float = 0.0  # rates that the gyro shows at rest, rad/s, IMU axes
    bias_y: float = 0.0
    bias_z: float = 0.0
    drift: float = 0.0  # increase of the offset per second


# Steps of numerical derivatives: each moves a point by about a thousandth of a pixel or more.
STEPS = Parameters(1e-5, 1e-5, 1e-5, 1e-4, 1e-4, 1e-4, 1e-4, 1e-4, 1e-4, 1e-4, 1e-6)


class ClipModel:
    """Prediction of the matches of a clip from the gyro's orientations.

    `camera` has the start values of focal length and lens. `mounting` (3, 3) takes IMU axes to camera axes; where it
    mirrors, for a log with left-handed axes, the orientations are those of the negative rates.
    """

    def __init__(self, matches: ClipMatches, camera: Camera, track: MeanOrientation, mounting: FloatArray) -> None:
        self.matches, self._camera, self._track, self._mounting = matches, camera, track, mounting
        ends = matches.points, matches.moved
        self._ends = [(points - camera.principal_point) / camera.focal_length for points in ends]
        size = np.array([camera.width, camera.height], dtype=np.float64)
        # Reading order relative to the middle, in readout times.
        self._order = [(points - (size - 1) / 2) / size for points in ends]
        self._middle = 0.5 * float(matches.opens.min() + matches.opens.max())

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


# Pairs are left out whose shared errors exceed this many standard deviations.
OUTLYING = 6.0
# Least standard deviation of a point, px: no tracker is better.
LEAST_NOISE = 0.02
# Windows on one thing err alike in all frames that show it, and so do neighbouring windows. Over 24 simulated clips,
# errors of the parameters were 1.5 to 2.2 times the deviations of a fit that takes them as independent.
TEXTURE = 2.0
# Largest bias of a gyro that counts as usual, and the standard deviation of what exceeds it, rad/s: else the steady
# shift of a near scene, as from a driving car, passes for a bias. A prior that pulled small biases to 0 would leave
# them to the shared errors.
USUAL_BIAS, BEYOND_SD = 0.06, 0.02
# Pairs over which errors are correlated, about 0.1 s.
LAG = 4


@dataclass(frozen=True, slots=True, eq=False)
class ClipFit:
    """All parameters, names and covariance of the free ones, residuals in px (n, 2), and the pairs not left out."""

    parameters: Parameters
    free: tuple[str, ...]
    covariance: FloatArray
    residuals: FloatArray
    used: NDArray[np.bool_]

    def sd(self, **slopes: float) -> float:
        """Return the standard deviation of a sum of parameters times `slopes`; those that are not free count as 0."""
        weights = np.array([slopes.get(name, 0.0) for name in self.free])
        return float(np.sqrt(weights @ self.covariance @ weights))


class PairErrors:
    """Weights of the points and shared errors of the pairs, from residuals (n, 2), px, without outlying pairs."""

    def __init__(self, model: ClipModel, residuals: FloatArray, keep: NDArray[np.bool_]) -> None:
        self._matches = model.matches
        # Displacements of all points by a unit of each error that a pair shares, (n, 2, 4).
        self.modes = _modes(model.matches.moved)
        pair, own = model.matches.pair, residuals
        for _ in range(3):
            # Standard deviation of a point, px. Its variance is noise^2 / weight, with weights (n,).
            self.noise = max(float(np.median(np.abs(own))) / MEDIAN, LEAST_NOISE)
            # Cauchy's weights: with 2.385, 95 % efficient for Gaussian errors.
            self.weights = 1.0 / (1.0 + (np.linalg.norm(own, axis=1) / (2.385 * self.noise)) ** 2)
            shared, variances = self._shared(residuals)
            own = residuals - np.einsum("nim,nm->ni", self.modes, shared[pair])
        typical = np.median(shared[keep] ** 2, axis=0) / MEDIAN**2
        self.used = keep & (shared**2 < OUTLYING**2 * (typical + variances)).all(axis=1)
        self.weights *= self.used[pair]
        # Variances (4,) of the shared errors; their correlations (pairs, 4) with the pair before, 0 for the first one.
        spread = np.maximum(typical - np.median(variances[keep], axis=0), 0.0)
        correlation = _correlations(model.matches.opens[:, 0], shared, variances, self.used)
        # Displacements of the points by one standard deviation of each error, in standard deviations of the points.
        self._scale = np.repeat(np.sqrt(self.weights) / self.noise, 2)[:, None]
        displaced = self._scale * self.modes.reshape(-1, 4) * np.sqrt(spread)
        ends = 2 * np.searchsorted(pair, np.arange(len(keep) + 1))
        self._displaced: Any = sparse.block_diag([displaced[a:b] for a, b in pairwise(ends)], "csc")
        # The errors are those of the pair before times the correlation, and an innovation.
        innovation = np.sqrt(1.0 - correlation**2).ravel()
        below = -correlation.ravel()[4:] / innovation[4:]
        self._innovations = sparse.diags_array([(1.0 / innovation).tolist(), below.tolist()], offsets=[0, -4])
        precision = self._displaced.T @ self._displaced + self._innovations.T @ self._innovations
        self._solver = splu(precision.tocsc())
        #: Pair of each whitened value.
        self.pairs = np.concatenate([np.repeat(pair, 2), np.repeat(np.arange(len(keep)), 4)])

    def _shared(self, residuals: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the shared errors of each pair, and their variances due to the points' own errors."""
        weighted, sums = self.modes * self.weights[:, None, None], self._matches.sums
        inverse = np.linalg.inv(sums(np.einsum("nim,nik->nmk", weighted, self.modes)) + 1e-9 * np.eye(4))
        shared = np.einsum("pmk,pk->pm", inverse, sums(np.einsum("nim,ni->nm", weighted, residuals)))
        return shared, self.noise**2 * np.diagonal(inverse, axis1=1, axis2=2)

    def whiten(self, values: FloatArray) -> FloatArray:
        """Return values (n, 2, ...) with independent errors of variance 1, shape (2 n + 4 pairs, ...).

        The likeliest shared errors are taken off the points, and their innovations are appended.
        """
        white = self._scale * values.reshape(len(self._scale), -1)
        shared = self._solver.solve(self._displaced.T @ white)
        white = np.concatenate([white - self._displaced @ shared, self._innovations @ shared])
        return white.reshape(-1, *values.shape[2:])


def _correlations(times: FloatArray, shared: FloatArray, variances: FloatArray, used: NDArray[np.bool_]) -> FloatArray:
    """Return the correlations of the shared errors of each pair with those of the pair before it, shape (pairs, 4).

    They fall exponentially with the time between pairs.
    """
    correlations = np.zeros_like(shared)
    steps = np.diff(times) / np.median(np.diff(times))
    near = used[1:] & used[:-1] & (steps < 1.5)
    products = (shared[1:] * shared[:-1])[near].sum(axis=0)
    power = shared**2 - variances
    power = 0.5 * (power[1:] + power[:-1])[near].sum(axis=0)
    ratio = np.divide(products, power, out=np.zeros(4), where=power > 0)
    correlations[1:] = ratio.clip(0.0, 0.99) ** steps[:, None]  # below 1, so that the matrix has an inverse
    return correlations


def _modes(points: FloatArray) -> FloatArray:
    """Return the displacements, shape (n, 2, 4), of points by a unit of each error that a pair shares."""
    centred = points - points.mean(axis=0)
    x, y = (centred / np.sqrt((centred**2).sum(axis=1).mean())).T
    one, zero = np.ones_like(x), np.zeros_like(x)
    return np.stack([np.stack([one, zero, x, -y], axis=-1), np.stack([zero, one, y, x], axis=-1)], axis=1)


def fit_clip(
    model: ClipModel,
    start: Parameters,
    free: tuple[str, ...],
    keep: NDArray[np.bool_],
    *,
    rounds: int = 4,
) -> ClipFit:
    """Fit the `free` parameters to the pairs `keep`; weights and variances settle in three or four `rounds`."""
    units = np.array([getattr(STEPS, name) for name in free])

    def at(x: FloatArray) -> Parameters:
        return start._replace(**dict(zip(free, (x * units).tolist(), strict=True)))

    is_bias = np.array([name.startswith("bias") for name in free])

    def beyond(x: FloatArray) -> FloatArray:
        """Return by how much each bias exceeds the usual, with its sign, in standard deviations; 0 for the others."""
        excess: FloatArray = np.sign(x) * np.maximum(np.abs(x * units) - USUAL_BIAS, 0.0) * is_bias / BEYOND_SD
        return excess

    def whitened(x: FloatArray, errors: PairErrors) -> FloatArray:
        return np.concatenate([errors.whiten(model.residuals(at(x))), beyond(x)])

    def slopes(x: FloatArray, errors: PairErrors) -> FloatArray:
        here = whitened(x, errors)
        return np.stack([whitened(x + step, errors) - here for step in np.eye(len(x))], axis=-1)

    x = np.array([getattr(start, name) for name in free]) / units
    for _ in range(rounds):
        errors = PairErrors(model, model.residuals(at(x)), keep)
        found = least_squares(whitened, x, slopes, method="lm", max_nfev=4, args=(errors,))
        x = found.x
    covariance = _covariance(np.asarray(found.jac), found.fun, errors.pairs) * np.outer(units, units)
    return ClipFit(at(x), free, covariance, model.residuals(at(x)), errors.used)


def _covariance(jacobian: FloatArray, residuals: FloatArray, pairs: NDArray[np.intp]) -> FloatArray:
    """Return the covariance times `TEXTURE` squared, of errors that are correlated over `LAG` pairs or independent.

    The larger of both counts. The former is the sandwich estimator of Newey and West (1987), whose sums over each pair
    are correlated with those of its neighbours. `pairs` holds the pair of each row; rows of the prior follow.
    """
    inverse = np.linalg.pinv(jacobian.T @ jacobian)
    sums = np.zeros((pairs[-1] + 1, jacobian.shape[1]))
    np.add.at(sums, pairs, (jacobian * residuals[:, None])[: len(pairs)])
    middle = sums.T @ sums
    for lag in range(1, min(LAG, len(sums) - 1) + 1):
        product = (1.0 - lag / (LAG + 1)) * sums[lag:].T @ sums[:-lag]
        middle += product + product.T
    count, unknowns = sums.shape
    sandwich = inverse @ middle @ inverse * count / max(count - unknowns, 1)
    known = np.diag(inverse)
    ratios = np.divide(np.diag(sandwich), known, out=np.ones_like(known), where=known > 0)
    growth = np.sqrt(np.maximum(ratios, 1.0))
    covariance: FloatArray = TEXTURE**2 * inverse * np.outer(growth, growth)
    # The pseudo-inverse has no variance of a number that no match depends on.
    np.fill_diagonal(covariance, np.where(known > 0, np.diag(covariance), np.inf))
    return covariance
